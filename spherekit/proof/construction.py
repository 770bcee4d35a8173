"""The order in which links are placed, each across one pair or on two, and what is left.

A link across one pair turns by that pair's angle: an unknown, or an input. A link that has
two pairs with links placed before is put on these two axes, and the arc between them is one
equation. A structure that can just be assembled has at least one body with at most two
pairs, and has one again without it, so such an order always exists.

Where wheels turn p/q as fast as an input by ratios of teeth, all these angles are multiples
of one variable that goes round once while the input goes round q times. Then equations are
sums of its cosines and sines, as of any other angle, and configurations a turn of the input
apart are different unless everything is back.

Wheels that turn with an input by ratios of teeth, over all turns until they are back.

Where an input turns p/q as fast as others, all these angles are multiples of one variable
that goes round once while the input goes round q times. Then equations are sums of its
cosines and sines, as of any other angle, and configurations a turn of the input apart are
different unless everything is back.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, combinations
from math import lcm

import numpy as np

from spherekit.arrays import Bools, Indices
from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.planning.inputs import merged
from spherekit.proof.gears import Structure, Written

MOST_ORDERS = 20000
"""Orders looked at; those of eight-bars are some hundred."""
MOST_KEPT = 256
"""Structures whose order is kept: random geometries of one have the same."""


@dataclass(frozen=True)
class PlacedByJoint:
    """A link placed across a pair from a link placed before; `variable` is its angle.

    Or the pair turns by `turns` for one turn of the variable.
    """

    link: int
    parent: int
    pair: int
    variable: int
    turns: int = 1


@dataclass(frozen=True)
class PlacedByDyad:
    """A link put on the axes of two pairs with links placed before; one equation."""

    link: int
    pairs: tuple[int, int]
    parents: tuple[int, int]


Step = PlacedByJoint | PlacedByDyad
_Numbers = tuple[int, ...]
_Key = tuple[tuple[tuple[int, int], ...], int, _Numbers, _Numbers, frozenset[int]]


@dataclass(frozen=True)
class Construction:
    """All links of a mechanism in an order of placing them, from `root` on.

    Variables are numbered: the unknown angles, then those of the inputs, then those that
    follow from them through wheels; their pairs are `pairs` in that order. Where wheels
    turn with the variable of the input, and have none of their own, `laps` are the turns of
    the input after which they are back: its angle is `laps` times the variable.
    """

    root: int
    steps: tuple[Step, ...]
    pairs: tuple[int, ...]
    unknowns: int
    inputs: int
    laps: int = 1

    @property
    def driven(self) -> tuple[int, ...]:
        """The pairs of the inputs."""
        return self.pairs[self.unknowns : self.unknowns + self.inputs]

    @property
    def followers(self) -> tuple[int, ...]:
        """The pairs whose angles follow from the inputs through wheels."""
        return self.pairs[self.unknowns + self.inputs :]

    @property
    def equations(self) -> tuple[PlacedByDyad, ...]:
        """The links put on two axes, whose arcs are the equations, in order."""
        return tuple(step for step in self.steps if isinstance(step, PlacedByDyad))

    @cached_property
    def degrees(self) -> Indices:
        """(equations, variables): the degree of each equation in e^(i angle), halved."""
        ranks = Ranks(self)
        rows = [ranks.between(*step.parents)[1] for step in self.equations]
        return np.array(rows, dtype=np.intp).reshape(len(rows), len(self.pairs))

    @cached_property
    def bound(self) -> int:
        """Most isolated complex modes, by Bezout's theorem for products of lines.

        An equation has degree 2 m in the half tangent of an angle in which `degrees` is
        m; the bound is the permanent of these degrees.
        """
        degrees = 2 * self.degrees[:, : self.unknowns]
        return permanent(degrees)


def systems_of(made: Construction) -> list[tuple[list[int], list[int]]] | None:
    """Return equations and unknowns of systems to be solved one after the other."""
    used = made.degrees[:, : made.unknowns] > 0
    left = set(range(len(used)))
    determined: set[int] = set()
    systems = []
    while left:
        for size in range(1, len(left) + 1):
            system = _system(used, sorted(left), determined, size)
            if system is not None:
                break
        else:
            return None
        systems.append(system)
        left -= set(system[0])
        determined |= set(system[1])
    return systems


def _system(
    used: Bools, left: list[int], determined: set[int], size: int
) -> tuple[list[int], list[int]] | None:
    for rows in combinations(left, size):
        unknowns = (
            set(np.flatnonzero(np.any(used[list(rows)], axis=0)).tolist()) - determined
        )
        if len(unknowns) == size:
            return list(rows), sorted(unknowns)
    return None


def permanent(matrix: Indices) -> int:
    """Return the sum over permutations of the products of a square matrix's entries."""
    sums = {0: 1}
    for row in matrix:
        following: dict[int, int] = {}
        for used, total in sums.items():
            for column, entry in enumerate(row):
                if entry and not used >> column & 1:
                    key = used | 1 << column
                    following[key] = following.get(key, 0) + total * int(entry)
        sums = following
    return sum(sums.values())


class Ranks:
    """How links depend on variables: for each link the one it is placed in, and degrees.

    A link put on two axes counts as placed in the last link that both ways to its parents
    share. `stretch[link]` is None for a link across a pair, else its two parents.
    """

    def __init__(self, construction: Construction) -> None:
        count = len(construction.pairs)
        self.parent: dict[int, int | None] = {construction.root: None}
        self.local: dict[int, Indices] = {}
        self.parents: dict[int, tuple[int, int] | None] = {}
        for step in construction.steps:
            if isinstance(step, PlacedByJoint):
                self.parent[step.link] = step.parent
                self.local[step.link] = np.zeros(count, dtype=np.intp)
                self.local[step.link][step.variable] = abs(step.turns)
                self.parents[step.link] = None
            else:
                shared, degrees = self.between(*step.parents)
                self.parent[step.link], self.local[step.link] = shared, degrees
                self.parents[step.link] = step.parents

    def way(self, link: int) -> list[int]:
        """Return a link and all that it is placed in, up to the root."""
        way = [link]
        while (above := self.parent[way[-1]]) is not None:
            way.append(above)
        return way

    def apart(self, one: int, other: int) -> tuple[int, list[int], list[int]]:
        """Return the last link that two ways share, and the links of each before it."""
        first, second = self.way(one), self.way(other)
        shared = next(link for link in first if link in second)
        return shared, first[: first.index(shared)], second[: second.index(shared)]

    def between(self, one: int, other: int) -> tuple[int, Indices]:
        """Return the last link shared, and the degrees of the relative orientation."""
        shared, first, second = self.apart(one, other)
        total = sum(self.local[link] for link in [*first, *second])
        count = len(next(iter(self.local.values()), ()))
        return shared, np.asarray(total + np.zeros(count, dtype=np.intp))


_FOUND: dict[_Key, Construction | None] = {}


def construct(structure: Structure, wanted: Collection[int] = ()) -> Construction:
    """Return the order of placing links that has the lowest bound of complex modes.

    Parameters
    ----------
    structure
        The links and pairs.
    wanted
        Numbers of pairs of which as many as possible are to be variables.

    Raises
    ------
    PlanError
        If there is none, since the pairs do not leave one freedom for each input.
    """
    inputs, followers = structure.inputs, structure.followers
    key = structure.ends, len(structure.links), inputs, followers, frozenset(wanted)
    if key not in _FOUND:
        if len(_FOUND) >= MOST_KEPT:
            _FOUND.clear()
        _FOUND[key] = _searched(structure, (*inputs, *followers), wanted)
    best = _FOUND[key]
    if best is None:
        raise PlanError(
            f"{structure.name}: its links cannot be placed one after another on at most "
            f"two axes each; proofs need one freedom for each input by counting"
        )
    if not best.unknowns and not best.followers:
        raise PlanError(
            f"{structure.name}: it has no closed loop, so that all angles are inputs and "
            "there is nothing to prove"
        )
    return best


def _searched(
    structure: Structure, given: tuple[int, ...], wanted: Collection[int]
) -> Construction | None:
    """Return the order with the lowest bound of all, None if there is none."""
    best: tuple[tuple[float, ...], Construction] | None = None
    bodies = merged(structure, given)
    roots = sorted(
        set(bodies), key=lambda body: body != bodies[structure.ends[given[0]][0]]
    )
    orders = chain.from_iterable(_orders(structure, given, root) for root in roots)
    for number, made in enumerate(orders):
        if made.bound:
            missing = len(set(wanted) - set(made.pairs))
            weight = float(missing), float(made.bound), float(np.sum(made.degrees))
            if best is None or weight < best[0]:
                best = weight, made
        if number >= MOST_ORDERS:
            break
    return None if best is None else best[1]


def _orders(
    structure: Structure, given: tuple[int, ...], first: int
) -> Iterator[Construction]:
    """Yield constructions from a body on, no two that differ only in what comes when."""
    bodies = merged(structure, given)
    members: dict[int, list[int]] = {}
    for link, body in enumerate(bodies):
        members.setdefault(body, []).append(link)
    free = [pair for pair in range(len(structure.pairs)) if pair not in given]
    if any(len(set(structure.ends[p])) < 2 for p in free):
        return
    joins = {p: (bodies[structure.ends[p][0]], bodies[structure.ends[p][1]]) for p in free}
    if any(one == other for one, other in joins.values()):
        return
    for order in removals(joins, frozenset(members), first):
        made = _constructed(structure, given, members, first, order)
        if made is not None:
            yield made


def removals(
    joins: Mapping[int, tuple[int, int]], bodies: frozenset[int], first: int
) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Yield orders of placing bodies from `first` on, each body with one or two pairs.

    An order has (body, pairs) for each other body; no two orders have the same ones. The
    pairs are the keys of `joins`, which has the bodies that they join.
    """
    seen: set[frozenset[tuple[int, ...]]] = set()

    def removed(
        left: frozenset[int], last: tuple[tuple[int, ...], ...]
    ) -> Iterator[tuple[tuple[int, ...], ...]]:
        """Take bodies away, the one placed last first; `last` holds their pairs."""
        # what can still come depends on what was taken away, and not on when
        key = frozenset(last)
        if key in seen:
            return
        seen.add(key)
        if left == {first}:
            yield last
            return
        for body in sorted(left - {first}):
            joining = tuple(
                p for p, two in joins.items() if body in two and set(two) <= left
            )
            if 1 <= len(joining) <= 2:
                yield from removed(left - {body}, ((body, *joining), *last))

    yield from removed(bodies, ())


def _constructed(
    structure: Structure,
    given: tuple[int, ...],
    members: dict[int, list[int]],
    first: int,
    order: tuple[tuple[int, ...], ...],
) -> Construction | None:
    """Return the construction in which bodies come in an order, None if it is none."""
    ends = structure.ends
    unknown = [joined[0] for _, *joined in order if len(joined) == 1]
    pairs = (*unknown, *given)
    steps: list[Step] = []
    placed: set[int] = set()

    def spread(link: int) -> None:
        """Take a link as placed, and place those that known angles join to it."""
        placed.add(link)
        for pair in given:
            other = sum(ends[pair]) - link
            if link in ends[pair] and other not in placed:
                steps.append(PlacedByJoint(other, link, pair, pairs.index(pair)))
                spread(other)

    root = members[first][0]
    spread(root)
    for body, *joining in order:
        links = [next(link for link in ends[p] if link in members[body]) for p in joining]
        parents = [sum(ends[p]) - link for p, link in zip(joining, links, strict=True)]
        if len(set(links)) != 1 or (len(parents) == 2 and parents[0] == parents[1]):
            return None
        if len(joining) == 1:
            steps.append(
                PlacedByJoint(links[0], parents[0], joining[0], pairs.index(joining[0]))
            )
        else:
            steps.append(
                PlacedByDyad(links[0], (joining[0], joining[1]), (parents[0], parents[1]))
            )
        spread(links[0])
    equations = sum(isinstance(step, PlacedByDyad) for step in steps)
    if equations != len(unknown):
        return None
    return Construction(root, tuple(steps), pairs, len(unknown), len(structure.inputs))


MOST_LAPS = 64
"""Turns until wheels are back, and turns of wheels meanwhile, at most."""


def turned_together(written: Written, construction: Construction) -> Construction:
    """Return a construction in which wheels turn with the variable of the only input.

    Raises
    ------
    PlanError
        If the ratios are not those of teeth, or are back after too many turns.
    """
    structure = written.structure
    wheels = listing(structure.pairs[pair] for pair in construction.followers)
    ratios = written.exact_ratios()
    if ratios is None:
        raise PlanError(
            f"{structure.name}: wheels turn {wheels} with the input; proofs over ranges "
            "are for ratios of teeth, with which wheels come back: give teeth, or give "
            "values of the inputs with --at"
        )
    laps = lcm(*(ratio.denominator for ratio in ratios))
    turns = dict(zip(structure.followers, (int(laps * r) for r in ratios), strict=True))
    most = max(laps, *map(abs, turns.values()))
    if most > MOST_LAPS:
        raise PlanError(
            f"{structure.name}: wheels turn {wheels} with the input, up to {most} turns "
            f"until they are back; proofs over ranges are for at most {MOST_LAPS}: give "
            "values of the inputs with --at"
        )
    (driven,) = construction.driven
    turns[driven] = laps
    variable = construction.unknowns
    steps = tuple(
        replace(step, variable=variable, turns=turns[step.pair])
        if isinstance(step, PlacedByJoint) and step.pair in turns
        else step
        for step in construction.steps
    )
    pairs = construction.pairs[: variable + 1]
    return replace(construction, steps=steps, pairs=pairs, laps=laps)
