"""All closed configurations of one irreducible group at one sample, and by which method."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.geometry.parametric_curve import dot
from spherekit.geometry.rotation import cross, max_abs, rotation_between_pairs, transpose
from spherekit.geometry.trigonometric_system import (
    angle_factors,
    eliminant_degree,
    find_all_angles,
    find_near_real_angles,
    jacobian_determinants,
)
from spherekit.mechanism.graph import spanning
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import Group
from spherekit.positions.elimination import _TURN
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import pair_angle
from spherekit.positions.random_search import MOST_MODES, POLISHING_STEPS, Distinct, search
from spherekit.tolerances import CLOSURE_TOLERANCE

NEARLY_REAL = 0.03
"""Roots with a smaller imaginary part are tried: double ones have some by rounding."""


REAL = 1e-7
"""Roots with a smaller imaginary part are taken for real."""


POINTLIKE = 1e-5
"""A bar of smaller arc (its sine) is not well described by the cosine of its arc."""


MOST_ORDERS = 8
"""Orders of elimination tried until one is certain to have lost nothing."""


def has_elimination(group: Group) -> bool:
    """Return whether all solutions of a group may be found by elimination."""
    return group.revolute and len(group.bodies) in (5, 7) and bool(orders_of(group))


def eliminated(group: Group, closure: Closure) -> tuple[Floats, Bools, str]:
    """Return all solutions of a group that has an elimination, at one sample.

    `closure` is the group's own, with a single sample.

    Returns
    -------
    values, real, problem
        Angles (k, pairs) rad of nearly closed configurations; (k,) which are real as far as
        rounding tells, so that a closed one must be next to them; and why a real solution
        may be missing, empty if none can be.
    """
    states = closure.at(np.zeros((1, len(group.pairs)))).states
    frames = Frames(group, np.moveaxis(np.stack([states.first, states.second]), 1, 2))
    values, real = [np.empty((0, len(group.pairs)))], [np.empty(0, dtype=bool)]
    problem = "a link has an arc of about 0 or 180 deg"
    if min(map(frames.sine, bars_of(group))) < POINTLIKE:
        return values[0], real[0], problem
    for order in orders_of(group):
        solved, problem = find_near_real_angles(frames.equations(order)[0], order.involves)
        imaginary = max_abs(solved.imag, axis=1)
        tried = imaginary < NEARLY_REAL
        values.append(frames.angles(frames.placed(order, solved[None, tried].real)))
        real.append(imaginary[tried] < REAL)
        if not problem:
            return values[-1], real[-1], ""
    return np.concatenate(values), np.concatenate(real), problem


@lru_cache
def bars_of(group: Group) -> dict[int, list[tuple[int, int]]]:
    """Return the bodies of a group that have two pairs, with two other bodies.

    The pairs by their places in the group, each with the body that it leads to.
    """
    bars = {}
    for body in range(len(group.bodies)):
        ways = [(k, sum(ends) - body) for k, ends in enumerate(group.ends) if body in ends]
        if len(ways) == len({other for _, other in ways}) == 2:
            bars[body] = ways
    return bars


class Order(NamedTuple):
    """A tree left by bars, in an order in which its angles can be eliminated.

    `root` is a body of the tree, `pairs` are its pairs, that of the remaining angle first;
    `bars` are the bodies whose arcs are the equations, `ways` the pairs that each spans.
    """

    root: int
    pairs: tuple[int, ...]
    bars: tuple[int, ...]
    ways: tuple[tuple[int, ...], ...]

    @property
    def involves(self) -> Bools:
        """(t, t) which equation has which angle in it."""
        return np.array([[pair in way for pair in self.pairs] for way in self.ways])

    @property
    def roots(self) -> int:
        """Number of complex solutions, 0 if the angles cannot be eliminated so."""
        return 2 * eliminant_degree(self.involves)


@lru_cache
def orders_of(group: Group) -> tuple[Order, ...]:
    """Return the first orders of fewest solutions, the same ones every time."""
    orders, bars = [], bars_of(group)
    for out in combinations(bars, group.loops):
        root = min({*range(len(group.bodies))} - {*out})
        pairs = [k for k, ends in enumerate(group.ends) if not {*out} & {*ends}]
        spans = {bar: [body for _, body in bars[bar]] for bar in out}
        if len(pairs) != len(out) or any({*out} & {*span} for span in spans.values()):
            continue
        ways = {bar: _way(group, pairs, *span) for bar, span in spans.items()}
        for sequence in permutations(pairs):
            for taken in permutations(out):
                order = Order(root, sequence, taken, tuple(ways[bar] for bar in taken))
                # of the last two, one order is enough
                if order.roots and taken[-2:] == tuple(sorted(taken[-2:])):
                    orders.append(order)
    least = min((order.roots for order in orders), default=0)
    return tuple(order for order in orders if order.roots == least)[:MOST_ORDERS]


def _way(group: Group, pairs: Sequence[int], start: int, goal: int) -> tuple[int, ...]:
    """Return the pairs from one body of a tree to another, in order."""
    came = {
        body: (pair, other) for pair, other, body in spanning(group.ends, [start], pairs)
    }
    way: list[int] = []
    while goal in came:
        pair, goal = came[goal]
        way.insert(0, pair)
    return tuple(way)


@dataclass(frozen=True)
class Frames:
    """The pair frames (2, pairs, n, 3, 3) of a group's bodies: in the first, in the second.

    R_second = R_first first Z(angle) second^T, R from body axes to those of body 0, for n
    samples, real or complex.
    """

    group: Group
    sides: Array

    def of_pair(self, pair: int, body: int) -> Array:
        """Return the frames (n, 3, 3) of a pair in one of its bodies."""
        return self.sides[self.group.ends[pair].index(body), pair]

    def axes_of_bar(self, bar: int) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Return the unit axes (n, 3) of a bar's pairs: in it, in the bodies it joins."""
        ways = bars_of(self.group)[bar]
        outer = tuple(self.of_pair(pair, body)[..., 2] for pair, body in ways)
        return tuple(self.of_pair(pair, bar)[..., 2] for pair, _ in ways), outer

    def sine(self, bar: int) -> float:
        """Return the least sine of a bar's arc; at 0 it spins between its neighbours."""
        return float(np.min(np.linalg.norm(cross(*self.axes_of_bar(bar)[0]), axis=-1)))

    def equations(self, order: Order) -> Array:
        """Return the equations (n, t, 3, ..., 3) of bars in the tree's angles."""
        return np.stack([self._equation(order, k) for k in range(len(order.bars))], axis=1)

    def _equation(self, order: Order, number: int) -> Array:
        way, bar = order.ways[number], order.bars[number]
        inner, (spread, moving) = self.axes_of_bar(bar)
        body = bars_of(self.group)[bar][0][1]
        for pair in way:
            ahead = self.group.ends[pair][0] == body
            further = sum(self.group.ends[pair]) - body
            one, other = self.of_pair(pair, body), self.of_pair(pair, further)
            turn = one[:, None] @ (_TURN if ahead else transpose(_TURN))
            turned = turn @ transpose(other)[:, None]
            spread = np.einsum("n...i,nxik->n...xk", spread, turned)
            body = further
        spread = np.einsum("n...i,ni->n...", spread, moving)
        places = [1 + way.index(pair) for pair in order.pairs if pair in way]
        equation = np.zeros((len(spread), *[3] * len(order.pairs)), dtype=spread.dtype)
        held = (slice(None) if pair in way else 0 for pair in order.pairs)
        equation[:, *held] = np.transpose(spread, [0, *places])
        equation.reshape(len(spread), -1)[:, 0] -= dot(*inner)
        return equation

    def placed(self, order: Order, angles: Array) -> Array:
        """Return orientations (n, m, bodies, 3, 3) at angles (n, m, t) of the tree."""
        ends = self.group.ends
        placed = np.empty((*angles.shape[:2], len(self.group.bodies), 3, 3), angles.dtype)
        placed[:, :, order.root] = np.eye(3)
        for pair, body, further in spanning(ends, [order.root], order.pairs):
            sense = 1.0 if ends[pair][0] == body else -1.0
            angle = sense * angles[..., order.pairs.index(pair)]
            turn = np.tensordot(angle_factors(angle), _TURN, 1)
            one, other = self.of_pair(pair, body), self.of_pair(pair, further)
            step = one[:, None] @ turn @ transpose(other)[:, None]
            placed[:, :, further] = placed[:, :, body] @ step
        for bar in order.bars:
            inner, outer = self.axes_of_bar(bar)
            there = [
                (placed[:, :, body] @ axis[:, None, :, None])[..., 0]
                for (_, body), axis in zip(bars_of(self.group)[bar], outer, strict=True)
            ]
            turned = rotation_between_pairs(*(axis[:, None] for axis in inner), *there)
            placed[:, :, bar] = turned if np.iscomplexobj(placed) else turned.real
        return transpose(placed[:, :, :1]) @ placed

    def angles(self, placed: Floats) -> Floats:
        """Return the angles (m, pairs) rad of pairs between bodies (1, m, bodies, 3, 3)."""
        one, other = (
            placed[0][:, [ends[side] for ends in self.group.ends]] @ self.sides[side][:, 0]
            for side in (0, 1)
        )
        return pair_angle(one, other)

    def angles_at(self, placed: Floats, samples: Indices) -> Floats:
        """Return the angles (m, pairs) rad of pairs between bodies (m, bodies, 3, 3).

        `samples` (m,) are those whose frames belong to the bodies.
        """
        one, other = (
            placed[:, [ends[side] for ends in self.group.ends]]
            @ np.moveaxis(self.sides[side][:, samples], 0, 1)
            for side in (0, 1)
        )
        return pair_angle(one, other)

    def solutions(self, order: Order) -> tuple[Complexes, Complexes]:
        """Return all solutions (n, roots, t) of the tree's angles, rad, and determinants.

        Those (n, roots) of the equations' derivatives; NaN where a solution is missing.
        """
        equations = self.equations(order)
        angles = find_all_angles(equations, order.involves)
        return angles, jacobian_determinants(equations, angles)


DIGITS = 6
"""Decimals of an angle (rad) that tell modes apart where they are put in order."""


MOVED = 1e-2
"""Farthest (rad) that an angle of a real root moves until the group is closed."""


class Method(NamedTuple):
    """How the modes of one group were found.

    `doubt` orders methods: 0 where no real mode at the inputs probed can be missing, the
    more the worse.
    """

    words: str
    doubt: float = 0.0


CLOSED_FORM = Method("closed form")
"""The method of dyads, and of trains of wheels, which have one mode."""


SEARCH = Method("search", 1.0)


def solutions(
    group: Group, closure: Closure, given: Floats | None = None
) -> tuple[list[Floats], Method]:
    """Return the closed configurations (variables,) of a group, and the method.

    All of them where an elimination applies and is sound, else those that it and a
    search from random starts find, which tries those `given` (n, variables) first.
    `closure` is the group's own, with a single sample.
    The order is that of the angles and the same every time.
    """
    if not has_elimination(group):
        distinct, problem, words = Distinct(closure), "", SEARCH.words
    else:
        distinct, problem = distinct_by_elimination(group, closure)
        if not problem:
            words = f"elimination: all {orders_of(group)[0].roots} complex roots"
            doubt = 0.0
            if distinct.is_truncated:
                words += f", of whose real ones {len(distinct.values)} are kept"
                doubt = 1.0
            return sorted(distinct.values, key=in_order), Method(words, doubt)
        words = f"{SEARCH.words} ({problem})"
    census = search(closure, distinct, given)
    words = f"{words}: {census.words('modes')}"
    if distinct.is_truncated or len(distinct.values) >= MOST_MODES:
        words += f"; the first {len(distinct.values)} are kept, there may be more"
    return sorted(distinct.values, key=in_order), Method(words, census.share)


def distinct_by_elimination(group: Group, closure: Closure) -> tuple[Distinct, str]:
    """Return the closed configurations of a group that has an elimination, at one sample.

    With them why a real one may be missing, empty if none can be. `closure` is the group's
    own, with a single sample.
    """
    distinct = Distinct(closure)
    near, real, problem = eliminated(group, closure)
    at = closure.solve(near, iterations=POLISHING_STEPS)
    closed = at.gap < CLOSURE_TOLERANCE
    moved = max_abs(wrap(at.values - near), axis=1)
    if np.any(real & ~(closed & (moved < MOVED))):
        problem = problem or "a real root led to no closed configuration"
    distinct.add(at.values[closed])
    return distinct, problem


def in_order(mode: Floats) -> list[float]:
    """Return a key that puts modes in order by their angles, whatever rounding does.

    Angles of a half turn are above zero, on either side of where they begin anew.
    """
    return sort_keys(mode).tolist()


def sort_keys(modes: Floats) -> Floats:
    """Return the keys of `in_order` as arrays (..., variables)."""
    angles = np.round(wrap(modes), DIGITS)
    return np.where(angles <= np.round(-np.pi, DIGITS), -angles, angles)


def least_complete(*methods: Method | None) -> Method | None:
    """Return the method that guarantees least; None stands for not used."""
    return max(filter(None, methods), key=lambda method: method.doubt, default=None)


def all_complete(methods: Iterable[Method | None]) -> bool:
    """Return whether no real mode can be missing."""
    return not any(method and method.doubt for method in methods)
