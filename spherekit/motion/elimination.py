"""All closed configurations of groups of R pairs with up to three loops, by elimination.

Bars are taken out, one for each loop, until what is left is a tree; the arc of each bar is
one equation, linear in the cosine and sine of each angle of the tree
(`spherekit.sphere.trigonometric`). A bar is a body with two R pairs; with its neighbours
placed, its arc between them is the only condition, and it follows from its axes. No
structure is known by name: what matters is which bars there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.motion.closure import Closure
from spherekit.planning.assembly import Group
from spherekit.sphere.complex_rotation import dot, taking
from spherekit.sphere.rotation import Floats, cross, transpose
from spherekit.sphere.trigonometric import (
    Bools,
    Complexes,
    all_angles,
    common_angles,
    determinants,
    eliminated_degree,
    point,
)

Numbers = NDArray[Any]

NEARLY_REAL = 0.03
"""Roots with a smaller imaginary part are tried: double ones have some by rounding."""
REAL = 1e-7
"""Roots with a smaller imaginary part are taken for real."""
POINTLIKE = 1e-5
"""A bar of smaller arc (its sine) is not well described by the cosine of its arc."""
MOST_ORDERS = 8
"""Orders of elimination tried until one is certain to have lost nothing."""

_TURN = np.zeros((3, 3, 3))
_TURN[0, 2, 2] = _TURN[1, 0, 0] = _TURN[1, 1, 1] = _TURN[2, 1, 0] = 1.0
_TURN[2, 0, 1] = -1.0
"""A rotation about z is this (3, 3, 3) times its point (1, cos, sin)."""


@final
@dataclass(frozen=True)
class ModeCandidates:
    """Nearly closed configurations of a group of R pairs.

    `values` (k, pairs) rad: the angles. `real` (k,): whether they are real as far as
    rounding tells, so that a closed configuration must be next to them. `roots`: the
    number of complex solutions counted with multiplicity. `problem` says why a real
    solution may be missing; empty if none can be.
    """

    values: Floats
    real: Bools
    roots: int
    problem: str = ""


def has_elimination(group: Group) -> bool:
    """Return whether all solutions of a group may be found by elimination."""
    return group.revolute and len(group.bodies) in (5, 7)


def candidates(group: Group, closure: Closure) -> ModeCandidates | None:
    """Return all solutions of a group at one sample, None if there is no elimination.

    `closure` is the group's own, with a single sample.
    """
    orders = orders_of(group) if has_elimination(group) else ()
    if not orders:
        return None
    roots = orders[0].roots
    states = closure.at(np.zeros((1, len(group.pairs)))).states
    frames = Frames(group, np.moveaxis(np.stack([states.first, states.second]), 1, 2))
    values, real = np.empty((0, len(group.pairs))), np.empty(0, dtype=bool)
    if min(frames.sine(bar) for bar in bars_of(group)) < POINTLIKE:
        problem = "a link has an arc of about 0 or 180 deg"
        return ModeCandidates(values, real, roots, problem)
    for order in orders:
        solved = common_angles(frames.equations(order)[0], order.involves)
        imaginary = np.max(np.abs(solved.angles.imag), axis=1, initial=0.0)
        tried = imaginary < NEARLY_REAL
        with np.errstate(invalid="ignore", divide="ignore"):
            angles = frames.angles(frames.placed(order, solved.angles[None, tried].real))
        finite = np.all(np.isfinite(angles), axis=1)
        values = np.concatenate([values, angles[finite]])
        real = np.concatenate([real, imaginary[tried][finite] < REAL])
        problem = solved.problem
        if not problem and not np.all(finite):
            problem = "the neighbours of a link have axes on one line"
        if not problem:
            return ModeCandidates(angles, real[-len(angles) :], roots)
    return ModeCandidates(values, real, roots, problem)


@final
@dataclass(frozen=True)
class Bar:
    """A body with two pairs: the pairs, and the two bodies that it joins by them."""

    body: int
    pairs: tuple[int, int]
    bodies: tuple[int, int]


def bars_of(group: Group) -> tuple[Bar, ...]:
    """Return the bodies of a group that have two pairs, with two other bodies."""
    bars = []
    for body in range(len(group.bodies)):
        pairs = [k for k, ends in enumerate(group.ends) if body in ends]
        others = [sum(group.ends[k]) - body for k in pairs]
        if len(pairs) == 2 and others[0] != others[1]:
            bars.append(Bar(body, (pairs[0], pairs[1]), (others[0], others[1])))
    return tuple(bars)


@final
@dataclass(frozen=True)
class Order:
    """A tree left by bars, in an order in which its angles can be eliminated.

    `bodies` and `pairs` are those of the tree, the pair of the remaining angle first;
    `bars` are those of the equations, `ways` the pairs that each of them spans.
    """

    bodies: tuple[int, ...]
    pairs: tuple[int, ...]
    bars: tuple[Bar, ...]
    ways: tuple[tuple[int, ...], ...]

    @property
    def involves(self) -> Bools:
        """(t, t) which equation has which angle in it."""
        return np.array([[pair in way for pair in self.pairs] for way in self.ways])

    @property
    def roots(self) -> int:
        """Number of complex solutions, 0 if the angles cannot be eliminated so."""
        return 2 * eliminated_degree(self.involves)


@lru_cache
def orders_of(group: Group) -> tuple[Order, ...]:
    """Return the first orders of fewest solutions, the same ones every time."""
    orders = []
    for taken in combinations(bars_of(group), group.loops):
        out = {bar.body for bar in taken}
        left = tuple(body for body in range(len(group.bodies)) if body not in out)
        pairs = [k for k, ends in enumerate(group.ends) if not out & set(ends)]
        if len(pairs) != len(taken) or any(out & set(bar.bodies) for bar in taken):
            continue
        ways = {bar: _way(group, pairs, *bar.bodies) for bar in taken}
        for sequence in permutations(pairs):
            for bars in permutations(taken):
                order = Order(left, sequence, bars, tuple(ways[bar] for bar in bars))
                # of the last two, one order is enough
                if order.roots and list(bars[-2:]) == sorted(bars[-2:], key=taken.index):
                    orders.append(order)
    least = min((order.roots for order in orders), default=0)
    return tuple(order for order in orders if order.roots == least)[:MOST_ORDERS]


def _way(group: Group, pairs: Sequence[int], start: int, goal: int) -> tuple[int, ...]:
    """Return the pairs from one body of a tree to another, in order."""
    ways: dict[int, tuple[int, ...]] = {start: ()}
    waiting = [start]
    while waiting and goal not in ways:
        body = waiting.pop(0)
        for pair in pairs:
            if body in group.ends[pair]:
                further = sum(group.ends[pair]) - body
                if further not in ways:
                    ways[further] = (*ways[body], pair)
                    waiting.append(further)
    return ways.get(goal, ())


@final
@dataclass(frozen=True)
class Frames:
    """The pair frames (2, pairs, n, 3, 3) of a group's bodies: in the first, in the second.

    R_second = R_first first Z(angle) second^T, R from body axes to those of body 0, for n
    samples, real or complex.
    """

    group: Group
    sides: Numbers

    def of_pair(self, pair: int, body: int) -> Numbers:
        """Return the frames (n, 3, 3) of a pair in one of its bodies."""
        return np.asarray(self.sides[self.group.ends[pair].index(body), pair])

    def _axes(self, bar: Bar) -> tuple[tuple[Numbers, ...], tuple[Numbers, ...]]:
        """Return the unit axes (n, 3) of a bar's pairs: in it, in the bodies it joins."""
        both = zip(bar.pairs, bar.bodies, strict=True)
        outer = tuple(self.of_pair(pair, body)[..., 2] for pair, body in both)
        return tuple(self.of_pair(pair, bar.body)[..., 2] for pair in bar.pairs), outer

    def sine(self, bar: Bar) -> float:
        """Return the least sine of a bar's arc; at 0 it spins between its neighbours."""
        return float(np.min(np.linalg.norm(cross(*self._axes(bar)[0]), axis=-1)))

    def equations(self, order: Order) -> Numbers:
        """Return the equations (n, t, 3, ..., 3) of bars in the tree's angles."""
        return np.stack([self._equation(order, k) for k in range(len(order.bars))], axis=1)

    def _equation(self, order: Order, number: int) -> Numbers:
        way, bar = order.ways[number], order.bars[number]
        inner, (spread, moving) = self._axes(bar)
        body, count = bar.bodies[0], len(order.pairs)
        for pair in way:
            ahead = self.group.ends[pair][0] == body
            further = sum(self.group.ends[pair]) - body
            one, other = self.of_pair(pair, body), self.of_pair(pair, further)
            turn = one[:, None] @ (_TURN if ahead else np.swapaxes(_TURN, 1, 2))
            turn = turn @ transpose(other)[:, None]
            spread = np.einsum("n...i,nxik->n...xk", spread, turn)
            body = further
        spread = np.einsum("n...i,ni->n...", spread, moving)
        within = [angle for angle in range(count) if order.pairs[angle] in way]
        places = [1 + way.index(order.pairs[angle]) for angle in within]
        equation = np.zeros((len(spread), *[3] * count), dtype=spread.dtype)
        held = (slice(None) if angle in within else 0 for angle in range(count))
        equation[slice(None), *held] = np.transpose(spread, [0, *places])
        equation.reshape(len(spread), -1)[:, 0] -= dot(*inner)
        return equation

    def placed(self, order: Order, angles: Numbers) -> Numbers:
        """Return orientations (n, m, bodies, 3, 3) at angles (n, m, t) of the tree."""
        ends = self.group.ends
        placed = np.empty((*angles.shape[:2], len(self.group.bodies), 3, 3), angles.dtype)
        placed[:, :, order.bodies[0]] = np.eye(3)
        reached = {order.bodies[0]}
        while len(reached) < len(order.bodies):
            for pair, angle in zip(order.pairs, np.moveaxis(angles, 2, 0), strict=True):
                for sense, (body, further) in ((1, ends[pair]), (-1, ends[pair][::-1])):
                    if body in reached and further not in reached:
                        turn = np.tensordot(point(sense * angle), _TURN, 1)
                        one, other = self.of_pair(pair, body), self.of_pair(pair, further)
                        step = one[:, None] @ turn @ transpose(other)[:, None]
                        placed[:, :, further] = placed[:, :, body] @ step
                        reached.add(further)
        for bar in order.bars:
            inner, outer = self._axes(bar)
            there = [
                (placed[:, :, body] @ axis[:, None, :, None])[..., 0]
                for body, axis in zip(bar.bodies, outer, strict=True)
            ]
            turned = taking(*(axis[:, None] for axis in inner), *there)
            placed[:, :, bar.body] = turned if np.iscomplexobj(placed) else turned.real
        return np.asarray(transpose(placed[:, :, :1]) @ placed)

    def angles(self, placed: Floats) -> Floats:
        """Return the angles (m, pairs) rad of pairs between bodies (1, m, bodies, 3, 3)."""
        one, other = (
            placed[0][:, [ends[side] for ends in self.group.ends]] @ self.sides[side][:, 0]
            for side in (0, 1)
        )
        turn = transpose(one) @ other
        return np.asarray(np.arctan2(turn[..., 1, 0], turn[..., 0, 0]))

    def solutions(self, order: Order) -> tuple[Complexes, Complexes]:
        """Return all solutions (n, roots, t) of the tree's angles, rad, and determinants.

        Those (n, roots) of the equations' derivatives; NaN where a solution is missing.
        """
        equations = self.equations(order)
        angles = all_angles(equations, order.involves)
        return angles, determinants(equations, angles)
