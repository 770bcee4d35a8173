"""Degrees of freedom counted on the graph: which parts are rigid, which move.

Each link has 3 freedoms, a pair takes 2 (R, Cr) or 1 (Cs). The freedoms of every part
are counted at once by the pebble game for (3, 3)-sparse graphs (Jacobs and Hendrickson
1997; Lee and Streinu 2008): each link owns three pebbles, a constraint covers one of
them, and constraints point from the link whose pebble they hold to the other link.
"""

from collections.abc import Iterable, Sequence

from spherekit.errors import CountError, PlanError
from spherekit.mechanism.graph import clusters, joined
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import listing


def merged(mechanism: Mechanism, locked: Iterable[int]) -> tuple[int, ...]:
    """Return for each link the smallest link of its body when pairs are locked."""
    return tuple(joined(len(mechanism.links), (mechanism.ends[pair] for pair in locked)))


FREEDOMS, SMALLEST = 3, 3
"""Those of a body, and the bodies of a dyad, the smallest group."""


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
        """Move a free pebble to `body` along constraints; False if none can be reached."""
        for other in self.out[body]:
            if other not in closed:
                closed.add(other)
                if self.free[other] or self._fetch(other, closed):
                    self.free[other] -= 1
                    self.free[body] += 1
                    self.out[body].remove(other)
                    self.out[other].append(body)
                    return True
        return False

    def insert(self, a: int, b: int) -> bool:
        """Add one constraint between two bodies; False if it is redundant there."""
        if self.gather(a, FREEDOMS) < FREEDOMS or not self.gather(b, 1, [a]):
            return False
        self.free[a] -= 1
        self.out[a].append(b)
        return True

    def cover(self, a: int, b: int, constraints: int) -> bool:
        """Add the constraints of a pair of two bodies; False if any is redundant there."""
        return a != b and all(self.insert(a, b) for _ in range(constraints))

    def reach(self, bodies: Iterable[int]) -> set[int]:
        """Return the bodies that constraints lead to from these, themselves included."""
        seen, stack = set[int](), list(bodies)
        while stack:
            body = stack.pop()
            if body not in seen:
                seen.add(body)
                stack += self.out[body]
        return seen

    def rigid_part(self, a: int, b: int) -> set[int] | None:
        """Return the smallest rigid set of bodies with both, or None if there is none."""
        self.gather(a, FREEDOMS)
        return None if self.gather(b, 1, [a]) else self.reach([a, b])

    def merge(self, part: set[int], into: int) -> None:
        """Make one body of a rigid part, its free pebbles gathered on `into`."""
        self.gather(into, FREEDOMS)
        for body, targets in enumerate(self.out):
            if body in part:
                self.out[body], self.free[body] = [], 0
            else:
                self.out[body] = [into if t in part else t for t in targets]
        self.free[into] = FREEDOMS


def graph_mobility(mechanism: Mechanism) -> int:
    """Return 3 (m - 1) - 2 n_R - 2 n_Cr - n_Cs, the freedoms by counting."""
    taken = sum(pair.constraints for pair in mechanism.pairs)
    return FREEDOMS * (len(mechanism.links) - 1) - taken


def counted_freedom(
    mechanism: Mechanism,
    driven: Sequence[int],
    locked: Sequence[int] = (),
    by_rank: bool = False,
) -> tuple[tuple[int, ...], Pebbles | None]:
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

    Returns
    -------
    body, game
        The smallest link of the rigid body that each link belongs to while one input moves
        and others are locked; and the game played on those bodies, for questions about
        parts of the chain, None where the rank at a configuration decides instead.

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
    mobility = graph_mobility(mechanism)
    try:
        game = _play(mechanism)
        if mobility != len(driven):
            raise CountError(
                f"{mechanism.name}: mobility 3(m - 1) - 2 n_R - 2 n_Cr - n_Cs = "
                f"{mobility}, but the number of inputs is {len(driven)} "
                f"({listing(mechanism.names_of(driven))}); {inputs_to_declare(mobility)}"
            )
    except CountError:
        rolls = any(pair.rolls for pair in mechanism.pairs)
        if (by_rank or rolls) and mobility <= len(driven):
            return merged(mechanism, locked), None
        raise
    if locked:
        return _locked(mechanism, driven, locked)
    return tuple(range(len(mechanism.links))), game


def _check_connected(mechanism: Mechanism) -> None:
    parts = clusters(len(mechanism.links), mechanism.ends)
    if len(parts) > 1:
        names = mechanism.links
        loose = "; ".join(", ".join(names[k] for k in part) for part in parts[1:])
        raise PlanError(
            f"{mechanism.name}: the graph is not connected: no pairs join the ground to "
            f"[{loose}]; add the missing pairs or remove these links"
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
        if not game.cover(a, b, pair.constraints):
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


def _covered(
    mechanism: Mechanism,
    body: Sequence[int],
    pairs: Iterable[int],
    meshes: frozenset[int] = frozenset(),
) -> tuple[Pebbles, bool]:
    """Return the game of bodies with the constraints of pairs; False if any is redundant.

    Of `meshes` one constraint counts.
    """
    game, independent = Pebbles(len(body)), True
    for n in pairs:
        taken = 1 if n in meshes else mechanism.pairs[n].constraints
        a, b = mechanism.ends[n]
        independent &= game.cover(body[a], body[b], taken)
    return game, independent


def _locked(
    mechanism: Mechanism, driven: Sequence[int], locked: Sequence[int]
) -> tuple[tuple[int, ...], Pebbles]:
    """Play the game with inputs locked, and make one body of each part that is rigid."""
    body = merged(mechanism, locked)
    left = [k for k in range(len(mechanism.pairs)) if k not in locked]
    game, independent = _covered(mechanism, body, left)
    for number in left:
        part = game.rigid_part(*(body[link] for link in mechanism.ends[number]))
        if part is not None:
            into = min(part)
            game.merge(part, into)
            body = tuple(into if owner in part else owner for owner in body)
    moved = [pair for pair in driven if pair not in locked]
    turning = (mechanism.ends[number] for number in moved)
    if not independent or any(body[a] == body[b] for a, b in turning):
        names, others, stuck = map(mechanism.names_of, (driven, locked, moved))
        raise CountError(
            f"{mechanism.name}: the inputs {listing(names)} are not independent freedoms: "
            f"with {listing(others)} locked, {listing(stuck)} cannot move; choose other "
            "inputs"
        )
    return body, game
