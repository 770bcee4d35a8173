"""The order in which positions follow from the inputs: dyads and irreducible groups.

With the inputs locked the mechanism is a structure without freedom. Its smallest rigid
part is a group that can be placed on its own; made one body, the next one follows, and
so on until one body is left. No frame is singled out (theory of Assur groups), so an
input between two floating links needs no special treatment.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import final

from spherekit.errors import CountError, PlanError
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import driven_pairs, merged
from spherekit.planning.rigidity import FREEDOMS, Pebbles, counted_freedom
from spherekit.planning.wheels import (
    held_meshes,
)


@final
@dataclass(frozen=True)
class Group:
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
        near, middle, far = self.dyad_places
        return 1 if (middle, near, far) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1

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


@final
@dataclass(frozen=True)
class Assembly:
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
    counted = counted_freedom(mechanism, inputs, inputs[1:], by_rank)
    merged_links = merged(mechanism, inputs)
    open_pairs = [n for n in range(len(mechanism.pairs)) if n not in inputs]
    if counted.game is not None:
        return Assembly(inputs, merged_links, split(mechanism, merged_links, open_pairs))
    meshes = held_meshes(mechanism)
    try:
        groups = split(mechanism, merged_links, open_pairs, meshes)
    except CountError:
        groups = (_whole(mechanism, list(merged_links), open_pairs),)
    return Assembly(inputs, merged_links, groups)


def split(
    mechanism: Mechanism,
    bodies: tuple[int, ...],
    pairs: Iterable[int],
    meshes: Collection[int] = (),
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
    body_of = list(bodies)
    open_pairs = {n: mechanism.ends[n] for n in pairs}
    taken = [
        1 if n in meshes else pair.constraints for n, pair in enumerate(mechanism.pairs)
    ]
    game = Pebbles(len(mechanism.links))
    covered = True
    for n, ends in open_pairs.items():
        one, other = body_of[ends[0]], body_of[ends[1]]
        for _ in range(taken[n]):
            covered = one != other and game.insert(one, other) and covered
    joined = {body_of[link] for ends in open_pairs.values() for link in ends}
    equations = sum(taken[n] for n in open_pairs)
    if open_pairs and not (covered and equations == FREEDOMS * (len(joined) - 1)):
        raise CountError(
            f"{mechanism.name}: {len(joined)} bodies joined by {len(open_pairs)} pairs are "
            "no structure that can just be assembled"
        )
    groups: list[Group] = []
    while open_pairs:
        part = _smallest_part(game, open_pairs, body_of, taken)
        base = _base(part, body_of)
        members = {body: _links_of(body, body_of) for body in part}
        order = [base, *sorted(part - {base}, key=lambda body: members[body])]
        position = {body: k for k, body in enumerate(order)}
        inside = [
            n
            for n, ends in open_pairs.items()
            if body_of[ends[0]] in part and body_of[ends[1]] in part
        ]
        groups.append(
            Group(
                bodies=tuple(members[body] for body in order),
                pairs=tuple(inside),
                ends=tuple(
                    (
                        position[body_of[open_pairs[n][0]]],
                        position[body_of[open_pairs[n][1]]],
                    )
                    for n in inside
                ),
                revolute=all(mechanism.pairs[n].kind.has_axis for n in inside),
                redundant=any(n in meshes for n in inside),
            )
        )
        game.gather(base, 3)
        game.merge(part, base)
        body_of = [base if body in part else body for body in body_of]
        for n in inside:
            del open_pairs[n]
    return tuple(groups)


def _whole(mechanism: Mechanism, body_of: list[int], pairs: list[int]) -> Group:
    """Return all bodies as one group, for mechanisms with redundant constraints."""
    bodies = sorted(set(body_of), key=lambda body: (body != body_of[0], body))
    position = {body: k for k, body in enumerate(bodies)}
    ends = [mechanism.ends[n] for n in pairs]
    return Group(
        bodies=tuple(_links_of(body, body_of) for body in bodies),
        pairs=tuple(pairs),
        ends=tuple((position[body_of[a]], position[body_of[b]]) for a, b in ends),
        revolute=False,
        redundant=True,
    )


def _links_of(body: int, body_of: list[int]) -> tuple[int, ...]:
    return tuple(link for link, owner in enumerate(body_of) if owner == body)


def _base(part: set[int], body_of: list[int]) -> int:
    """The body with the ground if there is one, else the largest, else the first."""
    ground = body_of[0]
    if ground in part:
        return ground
    return min(part, key=lambda body: (-body_of.count(body), body))


def _smallest_part(
    game: Pebbles,
    open_pairs: dict[int, tuple[int, int]],
    body_of: list[int],
    taken: list[int],
) -> set[int]:
    joined: dict[int, set[int]] = {}
    for one, other in open_pairs.values():
        a, b = body_of[one], body_of[other]
        joined.setdefault(a, set()).add(b)
        joined.setdefault(b, set()).add(a)
    if all(taken[n] == 2 for n in open_pairs):
        for a in sorted(joined):
            for b in sorted(joined[a]):
                common = joined[a] & joined[b]
                if b > a and common:
                    return {a, b, min(common)}
    best: set[int] | None = None
    for a in sorted(joined):
        game.gather(a, 3)
        for b in sorted(joined[a]):
            if b > a:
                part = game.reach([a, b])
                if best is None or len(part) < len(best):
                    best = part
    assert best is not None
    return best
