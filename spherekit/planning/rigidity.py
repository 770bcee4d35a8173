"""Counting freedoms of parts of a chain: which are rigid, which move with one freedom.

Each link has 3 freedoms, a pair takes 2 (R, Cr) or 1 (Cs). The freedoms of every part
are counted at once by the pebble game for (3, 3)-sparse graphs (Jacobs and Hendrickson
1997; Lee and Streinu 2008): each link owns three pebbles, a constraint covers one of
them, and constraints point from the link whose pebble they hold to the other link.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import final

from spherekit.conventions import listing
from spherekit.errors import CountError, PlanError
from spherekit.model.graph import pieces
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import merged

FREEDOMS = 3


class Pebbles:
    """Pebbles and covered constraints of a growing graph of `count` bodies."""

    def __init__(self, count: int) -> None:
        self.free = [FREEDOMS] * count
        self.out: list[list[int]] = [[] for _ in range(count)]

    def gather(self, body: int, wanted: int, keep: Sequence[int] = ()) -> int:
        """Move free pebbles to `body` without taking any from `keep`; return its count."""
        while self.free[body] < wanted and self._fetch(body, {body, *keep}):
            pass
        return self.free[body]

    def _fetch(self, body: int, closed: set[int]) -> bool:
        came_from: dict[int, int] = {}
        seen = {body} | closed
        stack = [body]
        while stack:
            at = stack.pop()
            for neighbour in self.out[at]:
                if neighbour in seen:
                    continue
                seen.add(neighbour)
                came_from[neighbour] = at
                if self.free[neighbour]:
                    self.free[neighbour] -= 1
                    while neighbour != body:
                        before = came_from[neighbour]
                        self.out[before].remove(neighbour)
                        self.out[neighbour].append(before)
                        neighbour = before
                    self.free[body] += 1
                    return True
                stack.append(neighbour)
        return False

    def insert(self, a: int, b: int) -> bool:
        """Add one constraint between two bodies; False if it is redundant there."""
        self.gather(a, FREEDOMS)
        if self.free[a] < FREEDOMS or self.gather(b, 1, keep=[a]) < 1:
            return False
        self.free[a] -= 1
        self.out[a].append(b)
        return True

    def reach(self, bodies: Iterable[int]) -> set[int]:
        """Return the bodies that constraints lead to from these, themselves included."""
        seen = set(bodies)
        stack = list(seen)
        while stack:
            for neighbour in self.out[stack.pop()]:
                if neighbour not in seen:
                    seen.add(neighbour)
                    stack.append(neighbour)
        return seen

    def rigid_part(self, a: int, b: int) -> set[int] | None:
        """Return the smallest rigid set of bodies with both, or None if there is none."""
        self.gather(a, FREEDOMS)
        if self.gather(b, 1, keep=[a]) >= 1:
            return None
        return self.reach([a, b])

    def moving_part(self, a: int, b: int) -> set[int]:
        """Return the smallest set with both bodies and one freedom.

        Valid where the whole has one freedom and no part is rigid: the sets with one
        freedom that contain both bodies are then closed under intersection.
        """
        self.gather(a, FREEDOMS)
        self.gather(b, 1, keep=[a])
        return self.reach([a, b])

    def merge(self, part: set[int], into: int) -> None:
        """Make one body of a rigid part whose free pebbles were gathered on `into`."""
        for body in part:
            self.out[body] = []
            self.free[body] = 0
        self.free[into] = FREEDOMS
        for body, targets in enumerate(self.out):
            if body not in part:
                self.out[body] = [into if t in part else t for t in targets]


def graph_mobility(mechanism: Mechanism) -> int:
    """Return 3 (m - 1) - 2 n_R - 2 n_Cr - n_Cs, the freedoms by counting."""
    taken = sum(pair.constraints for pair in mechanism.pairs)
    return FREEDOMS * (len(mechanism.links) - 1) - taken


@final
@dataclass(frozen=True)
class Freedom:
    """What counting says about a chain in which one input moves and others are locked.

    `body[link]` is the smallest link of the rigid body that a link belongs to. `game` is
    the played game on those bodies, for questions about parts of the chain; None where
    the rank at a configuration decides instead.
    """

    body: tuple[int, ...]
    game: Pebbles | None


def counted_freedom(
    mechanism: Mechanism,
    driven: Sequence[int],
    locked: Sequence[int] = (),
    by_rank: bool = False,
) -> Freedom:
    """Check by counting that a mechanism is one piece with a freedom for each input.

    Parameters
    ----------
    mechanism
        Any chain of R, Cr and Cs pairs.
    driven
        Numbers of all driven pairs.
    locked
        Those of them that are locked. Parts that only they move become one body.
    by_rank
        Whether the rank at a configuration is known to say otherwise than the count.

    Notes
    -----
    Counting does not decide where it leaves too few freedoms but the rank is known to
    leave enough, nor for rolling pairs, which may make constraints redundant as in every
    bevel pair whose axes are held apart. Too many freedoms by counting are too many by
    rank.

    Raises
    ------
    PlanError
        Naming the links that are loose.
    CountError
        Naming the links that are rigid or over-constrained, the mobility, or the inputs
        that are not independent freedoms.
    """
    _check_connected(mechanism)
    try:
        game = _play(mechanism)
        _check_mobility(mechanism, driven)
    except CountError:
        rolls = any(pair.rolls for pair in mechanism.pairs)
        if (by_rank or rolls) and graph_mobility(mechanism) <= len(driven):
            return Freedom(merged(mechanism, locked), None)
        raise
    if locked:
        return _locked(mechanism, driven, locked)
    return Freedom(tuple(range(len(mechanism.links))), game)


def _check_connected(mechanism: Mechanism) -> None:
    parts = pieces(mechanism)
    if len(parts) > 1:
        loose = "; ".join(", ".join(part) for part in parts[1:])
        raise PlanError(
            f"{mechanism.name}: the graph is not connected: no pairs join the ground to "
            f"[{loose}]; add the missing pairs or remove these links"
        )


def _check_mobility(mechanism: Mechanism, driven: Sequence[int]) -> None:
    mobility = graph_mobility(mechanism)
    if mobility != len(driven):
        names = listing(mechanism.pairs[pair].name for pair in driven)
        raise CountError(
            f"{mechanism.name}: mobility 3(m - 1) - 2 n_R - 2 n_Cr - n_Cs = {mobility}, "
            f"but the number of inputs is {len(driven)} ({names}); "
            f"{inputs_to_declare(mobility)}"
        )


def inputs_to_declare(mobility: int) -> str:
    """Return what to do about a mechanism with so many freedoms."""
    pairs = "an R pair" if mobility == 1 else f"{mobility} R pairs"
    return f"declare {pairs} as inputs, or add or remove pairs"


def _play(mechanism: Mechanism) -> Pebbles:
    """Play the game on all links; no part may be rigid."""
    names = mechanism.links
    game = Pebbles(len(names))
    for pair, (a, b) in zip(mechanism.pairs, mechanism.ends, strict=True):
        for _ in range(pair.constraints):
            if not game.insert(a, b):
                stuck = sorted(game.reach([a, b]))
                raise CountError(
                    f"{mechanism.name}: over-constrained: links "
                    f"[{', '.join(names[i] for i in stuck)}] cannot move relative to "
                    f'each other already without pair "{pair.name}"; remove a pair or '
                    "add a link"
                )
    for pair, (a, b) in zip(mechanism.pairs, mechanism.ends, strict=True):
        rigid = game.rigid_part(a, b)
        if rigid is not None:
            raise CountError(
                f"{mechanism.name}: rigid: links "
                f"[{', '.join(names[i] for i in sorted(rigid))}] cannot move relative to "
                f'each other (pair "{pair.name}" is locked); remove a pair or merge these '
                "links into one"
            )
    return game


def _locked(mechanism: Mechanism, driven: Sequence[int], locked: Sequence[int]) -> Freedom:
    """Play the game with inputs locked, and make one body of each part that is rigid."""
    body = merged(mechanism, locked)
    game = Pebbles(len(body))
    left = [k for k in range(len(mechanism.pairs)) if k not in locked]
    independent = True
    for number in left:
        a, b = (body[link] for link in mechanism.ends[number])
        for _ in range(mechanism.pairs[number].constraints):
            independent = independent and a != b and game.insert(a, b)
    for number in left:
        a, b = (body[link] for link in mechanism.ends[number])
        part = game.rigid_part(a, b) if a != b else None
        if part is not None:
            into = min(part)
            game.gather(into, FREEDOMS)
            game.merge(part, into)
            body = tuple(into if owner in part else owner for owner in body)
    moved = [pair for pair in driven if pair not in locked]
    for number in moved:
        a, b = (body[link] for link in mechanism.ends[number])
        independent = independent and a != b
    if not independent:
        names = [mechanism.pairs[pair].name for pair in driven]
        others = listing(mechanism.pairs[pair].name for pair in locked)
        raise CountError(
            f"{mechanism.name}: the inputs {listing(names)} are not independent freedoms: "
            f"with {others} locked, {listing(mechanism.pairs[k].name for k in moved)} "
            "cannot move; choose other inputs"
        )
    return Freedom(body, game)
