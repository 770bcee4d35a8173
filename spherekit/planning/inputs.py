"""The driven pairs of a mechanism, and the bodies that are left when some are locked.

The order in which positions follow from the inputs: dyads and irreducible groups.

With the inputs locked the mechanism is a structure without freedom. Its smallest rigid
part is a group that can be placed on its own; made one body, the next one follows, and
so on until one body is left. No frame is singled out (theory of Assur groups), so an
input between two floating links needs no special treatment.

Counting freedoms of parts of a chain: which are rigid, which move with one freedom.

Each link has 3 freedoms, a pair takes 2 (R, Cr) or 1 (Cs). The freedoms of every part
are counted at once by the pebble game for (3, 3)-sparse graphs (Jacobs and Hendrickson
1997; Lee and Streinu 2008): each link owns three pebbles, a constraint covers one of
them, and constraints point from the link whose pebble they hold to the other link.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

from spherekit.conventions import listing
from spherekit.errors import CountError, PlanError
from spherekit.model.graph import clusters, joined
from spherekit.model.mechanism import Mechanism
from spherekit.planning.wheels import (
    held_meshes,
)


def driven_pairs(mechanism: Mechanism) -> tuple[int, ...]:
    """Return the numbers of the driven pairs.

    Raises
    ------
    PlanError
        If an input is a contact pair, or there is no R pair at all.
    """
    revolute = list(mechanism.angles)
    names = mechanism.input_pairs
    for name in names:
        if not mechanism.pair(name).kind.has_axis:
            raise PlanError(
                f"{mechanism.name}: inputs.{name}: pair {name} is a contact pair; choose "
                f"an R pair as input: {listing(revolute) or 'there is none'}"
            )
    if not names:
        raise PlanError(f"{mechanism.name}: an input is an R pair, but there is none")
    return tuple(mechanism.pair_number[name] for name in names)


def driven_at(mechanism: Mechanism, names: str | Sequence[str] | None = None) -> Mechanism:
    """Return a mechanism driven at the pairs of these names, by default at its inputs.

    Raises
    ------
    PlanError
        If no pair is named, or there is none that can be driven.
    ModelError
        If there is no such pair, or one is named twice.
    """
    if names is None:
        driven_pairs(mechanism)
        return mechanism
    if not names:
        raise PlanError(f"{mechanism.name}: input_pair names no pair; name one or more")
    return mechanism.with_inputs(*([names] if isinstance(names, str) else names))


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


class Group(NamedTuple):
    """Bodies that become one body when their pairs are closed together.

    `bodies` are sets of link numbers already rigid relative to each other; the first
    is the one the others are placed in. `ends[k]` are the positions in `bodies` that
    pair `pairs[k]` joins, first link first. `redundant` says that it has more equations
    than unknowns, which agree for the geometry given.
    """

    bodies: tuple[tuple[int, ...], ...]
    pairs: tuple[int, ...]
    ends: tuple[tuple[int, int], ...]
    revolute: bool = True
    redundant: bool = False

    @property
    def is_dyad(self) -> bool:
        """Whether the group has the closed form of a spherical triangle."""
        return self.revolute and len(self.bodies) == 3

    @property
    def dyad_places(self) -> tuple[int, int, int]:
        """Positions in `pairs` of a dyad's: one outer, the middle, the other outer."""
        near, middle, far = (
            next(k for k, pair in enumerate(self.ends) if set(pair) == joined)
            for joined in ({0, 1}, {1, 2}, {0, 2})
        )
        return near, middle, far

    @property
    def dyad_parity(self) -> int:
        """1 if the middle, one and the other outer pair are in the order of `pairs`, or -1.

        A dyad's sign, that of u_1 . (u_2 x u_3) of its axes in the order of `pairs`, is
        this times that of the axes in the order named.
        """
        near, middle, _ = self.dyad_places
        return 1 if (near - middle) % 3 == 1 else -1

    @property
    def middle(self) -> int:
        """The number of the pair in the middle of a dyad."""
        return self.pairs[self.dyad_places[1]]

    @property
    def loops(self) -> int:
        """Number of independent closed loops within the group."""
        return len(self.pairs) - len(self.bodies) + 1

    @property
    def kind(self) -> str:
        """The group's name: dyad, triad, or its count of links and loops."""
        if self.is_dyad:
            return "dyad"
        if self.redundant:
            return f"over-constrained group of {len(self.bodies)} bodies"
        if not self.revolute:
            return f"contact group of {len(self.bodies)} bodies"
        if len(self.bodies) == 5:
            return "triad"
        return f"{len(self.bodies)}-body group with {self.loops} loops"


class Assembly(NamedTuple):
    """The locked input pairs, then the groups in solving order.

    `bodies[link]` is the smallest link that the locked inputs join a link to.
    """

    inputs: tuple[int, ...]
    bodies: tuple[int, ...]
    groups: tuple[Group, ...]

    @property
    def input(self) -> int:
        """The number of the only driven pair; `PlanError` if there are several."""
        if len(self.inputs) != 1:
            raise PlanError(
                f"this works for mechanisms with one input, not with {len(self.inputs)}; "
                "lock the others: --lock PAIR=VALUE, or spherekit.lock"
            )
        return self.inputs[0]

    @property
    def has_closed_form(self) -> bool:
        """Whether every group is a dyad."""
        return all(group.is_dyad for group in self.groups)


def plan_assembly(mechanism: Mechanism, by_rank: bool = False) -> Assembly:
    """Return the groups of a mechanism whose input pairs are locked.

    With `by_rank` it has as many freedoms as inputs by rank, though not by counting.

    Raises
    ------
    PlanError
        If there is not one freedom for each input, an input is a contact pair or no
        independent freedom, or a part is rigid.
    """
    inputs = driven_pairs(mechanism)
    _, game = counted_freedom(mechanism, inputs, inputs[1:], by_rank)
    merged_links = merged(mechanism, inputs)
    open_pairs = [n for n in range(len(mechanism.pairs)) if n not in inputs]
    if game is not None:
        return Assembly(inputs, merged_links, split(mechanism, merged_links, open_pairs))
    meshes = held_meshes(mechanism)
    try:
        groups = split(mechanism, merged_links, open_pairs, meshes)
    except CountError:
        # All bodies together, where constraints are redundant.
        whole = _group(mechanism, merged_links, merged_links[0], open_pairs, True)
        groups = (whole._replace(revolute=False),)
    return Assembly(inputs, merged_links, groups)


def split(
    mechanism: Mechanism,
    bodies: Sequence[int],
    pairs: Iterable[int],
    meshes: frozenset[int] = frozenset(),
) -> tuple[Group, ...]:
    """Return the groups of a structure without freedom, in solving order.

    `bodies[link]` is the smallest link of its body, `pairs` are the numbers of the pairs
    that join bodies; links that none of them reaches are left out. Of `meshes` one
    constraint counts, the other repeats what else holds their wheels.

    Raises
    ------
    CountError
        If the bodies that the pairs join could move, or are over-constrained.
    """
    open_pairs = {n: mechanism.ends[n] for n in pairs}
    game, covered = _covered(mechanism, bodies, open_pairs, meshes)
    joined = {bodies[link] for link in chain(*open_pairs.values())}
    left = sum(game.free[body] for body in joined)
    if open_pairs and not (covered and left == FREEDOMS):
        raise CountError(
            f"{mechanism.name}: {len(joined)} bodies joined by {len(open_pairs)} pairs are "
            "no structure that can just be assembled"
        )
    groups: list[Group] = []
    while open_pairs:
        part = _smallest_part(game, open_pairs, bodies)
        # The body with the ground if there is one, else the largest, else the first.
        base = min(part, key=lambda body: (body != bodies[0], -bodies.count(body), body))
        inside = [n for n, ends in open_pairs.items() if {bodies[k] for k in ends} <= part]
        redundant = not meshes.isdisjoint(inside)
        groups.append(_group(mechanism, bodies, base, inside, redundant))
        game.merge(part, base)
        bodies = [base if body in part else body for body in bodies]
        open_pairs = {n: ends for n, ends in open_pairs.items() if n not in inside}
    return tuple(groups)


def _group(
    mechanism: Mechanism,
    body_of: Sequence[int],
    base: int,
    pairs: Sequence[int],
    redundant: bool,
) -> Group:
    """Return the group of the bodies that pairs join, `base` first."""
    between = [(body_of[a], body_of[b]) for a, b in (mechanism.ends[n] for n in pairs)]
    members = {
        body: tuple(link for link, owner in enumerate(body_of) if owner == body)
        for body in chain(*between)
    }
    bodies = sorted(members, key=lambda body: (body != base, members[body]))
    position = {body: k for k, body in enumerate(bodies)}
    return Group(
        bodies=tuple(members[body] for body in bodies),
        pairs=tuple(pairs),
        ends=tuple((position[a], position[b]) for a, b in between),
        revolute=all(mechanism.pairs[n].kind.has_axis for n in pairs),
        redundant=redundant,
    )


def _smallest_part(
    game: Pebbles, open_pairs: dict[int, tuple[int, int]], body_of: Sequence[int]
) -> set[int]:
    """Return the smallest rigid part with both bodies of a pair, the first of them."""
    parts = []
    couples = (sorted(body_of[k] for k in ends) for ends in open_pairs.values())
    for a, b in sorted(couples):
        game.gather(a, FREEDOMS)
        parts.append(game.reach([a, b]))
        if len(parts[-1]) == SMALLEST:
            break
    return min(parts, key=len)
