"""Counting freedoms of parts of a chain: which are rigid, which move with one freedom.

Each link has 3 freedoms, a pair takes 2 (R, Cr) or 1 (Cs). The freedoms of every part
are counted at once by the pebble game for (3, 3)-sparse graphs (Jacobs and Hendrickson
1997; Lee and Streinu 2008): each link owns three pebbles, a constraint covers one of
them, and constraints point from the link whose pebble they hold to the other link.
"""

from collections.abc import Iterable, Sequence

from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.model.graph import pieces
from spherekit.model.mechanism import CONSTRAINTS, Mechanism
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
    taken = sum(CONSTRAINTS[pair.type] for pair in mechanism.pairs)
    return FREEDOMS * (len(mechanism.links) - 1) - taken


def counted_freedom(
    mechanism: Mechanism, driven: Sequence[int], locked: Sequence[int] = ()
) -> Pebbles | None:
    """Check by counting that a mechanism is one piece with a freedom for each input.

    Parameters
    ----------
    mechanism
        Any chain of R, Cr and Cs pairs.
    driven
        Numbers of all driven pairs.
    locked
        Those of them that are locked; the game is played with their links merged.

    Returns
    -------
    Pebbles or None
        The played game, for questions about parts of the chain. None where the count
        fails but rolling pairs may make constraints redundant, as in every bevel pair
        whose axes are held apart: then only the rank at a configuration decides.

    Raises
    ------
    PlanError
        Naming the links that are loose, rigid or over-constrained, the mobility, or the
        inputs that are no independent freedoms.
    """
    _check_connected(mechanism)
    try:
        game = _play(mechanism)
        _check_mobility(mechanism, driven)
        return _play(mechanism, locked) if locked else game
    except PlanError:
        if any(pair.type == "Cr" for pair in mechanism.pairs):
            return None
        raise


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
        raise PlanError(
            f"{mechanism.name}: mobility 3(m - 1) - 2 n_R - 2 n_Cr - n_Cs = {mobility}, "
            f"but the number of inputs is {len(driven)} ({names}); "
            f"{inputs_to_declare(mobility)}"
        )


def inputs_to_declare(mobility: int) -> str:
    """Return what to do about a mechanism with so many freedoms."""
    pairs = "an R pair" if mobility == 1 else f"{mobility} R pairs"
    return f"declare {pairs} as inputs, or add or remove pairs"


def _play(mechanism: Mechanism, locked: Sequence[int] = ()) -> Pebbles:
    """Play the game with some driven pairs locked; no part may be rigid."""
    where = mechanism.name
    names = mechanism.links
    game = Pebbles(len(names))
    body = merged(mechanism, locked)
    joined = [
        (pair, body[a], body[b])
        for number, (pair, (a, b)) in enumerate(
            zip(mechanism.pairs, mechanism.ends, strict=True)
        )
        if number not in locked
    ]
    inputs = listing(mechanism.pairs[number].name for number in locked)
    given = f" with input {inputs} locked" if locked else ""

    def links(bodies: Iterable[int]) -> str:
        inside = set(bodies)
        return ", ".join(
            name for name, own in zip(names, body, strict=True) if own in inside
        )

    for pair, a, b in joined:
        for _ in range(CONSTRAINTS[pair.type]):
            if a == b or not game.insert(a, b):
                raise PlanError(
                    f"{where}: over-constrained{given}: links "
                    f"[{links(game.reach([a, b]))}] cannot move relative to each other "
                    f'already without pair "{pair.name}"; '
                    + ("choose other inputs" if locked else "remove a pair or add a link")
                )
    for pair, a, b in joined:
        rigid = game.rigid_part(a, b)
        if rigid is not None:
            raise PlanError(
                f"{where}: rigid{given}: links [{links(rigid)}] cannot move relative to "
                f'each other (pair "{pair.name}" is locked); '
                + (
                    "choose other inputs"
                    if locked
                    else "remove a pair or merge these links into one"
                )
            )
    return game
