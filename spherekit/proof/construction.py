"""The order in which links are placed, each across one pair or on two, and what is left.

A link across one pair turns by that pair's angle: an unknown, or an input. A link that has
two pairs with links placed before is put on these two axes, and the arc between them is one
equation. A structure that can just be assembled has at least one body with at most two
pairs, and has one again without it, so such an order always exists.

Where wheels turn p/q as fast as an input by ratios of teeth, all these angles are multiples
of one variable that goes round once while the input goes round q times. Then equations are
sums of its cosines and sines, as of any other angle, and configurations a turn of the input
apart are different unless everything is back.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, islice, permutations
from math import lcm, prod

import numpy as np

from spherekit.arrays import Indices
from spherekit.errors import PlanError
from spherekit.mechanism.graph import component_labels, find_spanning_tree
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.structure import Structure
from spherekit.wording import listing

MOST_ORDERS = 20000
"""Orders looked at; those of eight-bars are some hundred."""
MOST_KEPT = 256
"""Structures whose order is kept: random geometries of one have the same."""


@dataclass(frozen=True)
class Step:
    """A link placed across one pair from a link before it, or on the axes of two such.

    Across one pair it turns by `turns` times the variable of the number `variable`. Two
    pairs, with links of `parents` each, give an equation: the arc between their axes.
    """

    link: int
    parents: tuple[int, ...]
    pairs: tuple[int, ...]
    variable: int = -1
    turns: int = 1

    @property
    def is_dyad(self) -> bool:
        """Whether it is put on two axes."""
        return len(self.pairs) == 2


@dataclass(frozen=True)
class Construction:
    """All links of a mechanism in an order of placing them, from `root` on.

    Variables are numbered: the unknown angles, then those of the inputs, then those that
    follow from them through wheels; their pairs are `pairs` in that order. Where wheels
    turn with the variable of the input, and have none of their own, `laps` are the turns of
    the input after which they are back: its angle is `laps` times the variable.
    """

    root: int
    steps: Sequence[Step]
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
    def equations(self) -> list[Step]:
        """The links put on two axes, whose arcs are the equations, in order."""
        return [step for step in self.steps if step.is_dyad]

    @cached_property
    def placed(self) -> dict[int, tuple[int, Indices]]:
        """The link that each link is placed in, and the degrees in all variables there.

        A link put on two axes is placed in the last link that both ways to its parents
        share, and the root in itself.
        """
        every = np.arange(len(self.pairs))
        placed: dict[int, tuple[int, Indices]] = {self.root: (self.root, 0 * every)}
        for step in self.steps:
            if step.is_dyad:
                shared, *ways = _apart(placed, *step.parents)
                degrees = [placed[link][1] for way in ways for link in way]
                placed[step.link] = shared, np.sum([0 * every, *degrees], axis=0)
            else:
                turns = abs(step.turns) * (every == step.variable)
                placed[step.link] = step.parents[0], turns
        return placed

    def apart(self, step: Step) -> tuple[int, list[int], list[int]]:
        """Return the last link that the ways to both parents share, and what is on each."""
        return _apart(self.placed, *step.parents)

    @cached_property
    def degrees(self) -> Indices:
        """(equations, variables): the degree of each equation in e^(i angle), halved."""
        rows = [self.placed[step.link][1] for step in self.equations]
        return np.array(rows, dtype=np.intp).reshape(-1, len(self.pairs))

    @cached_property
    def bound(self) -> int:
        """Most isolated complex modes, by Bezout's theorem for products of lines.

        An equation has degree 2 m in the half tangent of an angle in which `degrees` is
        m; the bound is the permanent of these degrees.
        """
        return permanent(2 * self.degrees[:, : self.unknowns])

    @cached_property
    def systems(self) -> list[tuple[list[int], list[int]]]:
        """Equations and unknowns of systems to be solved one after the other."""
        used = self.degrees[:, : self.unknowns] > 0
        left, systems = list(range(len(used))), []
        while left:
            parts = (
                ([*rows], np.flatnonzero(np.any(used[[*rows]], axis=0)).tolist())
                for size in range(1, len(left) + 1)
                for rows in combinations(left, size)
            )
            rows, unknowns = next(part for part in parts if len(part[0]) == len(part[1]))
            systems.append((rows, unknowns))
            # these are known from here on
            used[:, unknowns] = False
            left = [row for row in left if row not in rows]
        return systems


def _apart(
    placed: Mapping[int, tuple[int, Indices]], one: int, other: int
) -> tuple[int, list[int], list[int]]:
    """Return the last link that two ways share, and the links of each before it."""
    ways = []
    for link in (one, other):
        way = [link]
        while (above := placed[way[-1]][0]) != way[-1]:
            way.append(above)
        ways.append(way)
    first, second = ways
    shared = next(link for link in first if link in second)
    return shared, first[: first.index(shared)], second[: second.index(shared)]


def permanent(matrix: Indices) -> int:
    """Return the sum over permutations of the products of a square matrix's entries."""
    rows = matrix.tolist()
    return sum(
        prod(row[k] for row, k in zip(rows, order, strict=True))
        for order in permutations(range(len(rows)))
    )


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
    best = _best(
        structure.ends,
        len(structure.links),
        len(structure.inputs),
        (*structure.inputs, *structure.followers),
        frozenset(wanted),
    )
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


Ends = tuple[tuple[int, int], ...]
Order = tuple[tuple[int, ...], ...]
"""Bodies, each with the one or two pairs by which it is placed."""


@lru_cache(MOST_KEPT)
def _best(
    ends: Ends, links: int, inputs: int, given: tuple[int, ...], wanted: frozenset[int]
) -> Construction | None:
    """Return the order with the lowest bound of all, None if there is none.

    The angles of the pairs in `given` are known, of which the first are the inputs.
    """
    bodies = component_labels(links, (ends[pair] for pair in given))
    joins = {
        pair: (bodies[one], bodies[other])
        for pair, (one, other) in enumerate(ends)
        if pair not in given
    }
    if any(one == other for one, other in joins.values()):
        return None
    roots = sorted(set(bodies), key=lambda body: body != bodies[ends[given[0]][0]])
    constructed = (
        _constructed(ends, bodies, inputs, given, root, order)
        for root in roots
        for order in removals(joins, frozenset(bodies), root)
    )
    return min(
        (made for made in islice(constructed, MOST_ORDERS) if made and made.bound),
        key=lambda made: (len(wanted - {*made.pairs}), made.bound, np.sum(made.degrees)),
        default=None,
    )


def removals(
    joins: Mapping[int, tuple[int, int]], bodies: frozenset[int], first: int
) -> Iterator[Order]:
    """Yield orders of placing bodies from `first` on, each body with one or two pairs.

    An order has (body, pairs) for each other body; no two orders have the same ones. The
    pairs are the keys of `joins`, which has the bodies that they join.
    """
    seen: set[frozenset[tuple[int, ...]]] = set()

    def removed(left: frozenset[int], last: Order) -> Iterator[Order]:
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
    ends: Ends,
    bodies: list[int],
    inputs: int,
    given: tuple[int, ...],
    root: int,
    order: Order,
) -> Construction | None:
    """Return the construction in which bodies come in an order, None if it is none."""
    unknown = [pairs[0] for _, *pairs in order if len(pairs) == 1]
    pairs = (*unknown, *given)
    steps: list[Step] = []
    for body, *joining in ((root,), *order):
        links = [next(k for k in ends[pair] if bodies[k] == body) for pair in joining]
        parents = tuple(sum(ends[p]) - k for p, k in zip(joining, links, strict=True))
        if len(set(links)) > 1 or len(set(parents)) < len(joining):
            return None
        if joining:
            variable = pairs.index(joining[0]) if len(joining) == 1 else -1
            steps.append(Step(links[0], parents, tuple(joining), variable))
        steps += [
            Step(link, (parent,), (pair,), pairs.index(pair))
            for pair, parent, link in find_spanning_tree(ends, links[:1] or [root], given)
        ]
    if sum(step.is_dyad for step in steps) != len(unknown):
        return None
    return Construction(root, steps, pairs, len(unknown), inputs)


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
    wheels = listing(structure.names_of(construction.followers))
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
    steps = [
        replace(step, variable=variable, turns=turns[step.pairs[0]])
        if step.pairs[0] in turns and not step.is_dyad
        else step
        for step in construction.steps
    ]
    return replace(
        construction, steps=steps, pairs=construction.pairs[: variable + 1], laps=laps
    )
