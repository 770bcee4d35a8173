"""The driven pairs of a mechanism, and the bodies that are left when some are locked.

The order in which positions follow from the inputs: dyads and irreducible groups.

With the inputs locked the mechanism is a structure without freedom. Its smallest rigid
part is a group that can be placed on its own; made one body, the next one follows, and
so on until one body is left. No frame is singled out (theory of Assur groups), so an
input between two floating links needs no special treatment.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

from spherekit.errors import CountError, PlanError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.mobility import (
    FREEDOMS,
    SMALLEST,
    Pebbles,
    _covered,
    counted_freedom,
    merged,
)
from spherekit.planning.wheel_train import held_meshes
from spherekit.wording import listing


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
