"""All closed configurations of triads and of groups of seven bodies, by elimination.

Bars are taken out until what is left is two bodies (a triad) or a tree of four bodies;
the arc of each bar is one equation. For two bodies the equations are quadrics in the
quaternion of their rotation; for a tree they are linear in the cosine and sine of each
of its three angles. No structure is known by name: what matters is which bars there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations
from typing import final

import numpy as np

from spherekit.motion.bars import Arcs, Bar, Frames, bars_of, joined_by_three
from spherekit.motion.closure import Closure
from spherekit.planning.assembly import Group
from spherekit.sphere.quadrics import (
    COMMON_POINTS,
    arc_quadric,
    common_points,
    nearest_real,
)
from spherekit.sphere.rotation import Floats, about_z, from_quaternion
from spherekit.sphere.trigonometric import (
    Bools,
    Complexes,
    common_angles,
    determinants,
    eliminated_degree,
    followed,
)

NEARLY_REAL = 0.03
"""Roots with a smaller imaginary part are tried: double ones have some by rounding."""
REAL = 1e-7
"""Roots with a smaller imaginary part are taken for real."""
POINTLIKE = 1e-5
"""A bar of smaller arc (its sine) is not well described by the cosine of its arc."""
MOST_ORDERS = 8
"""Orders of elimination tried until one is certain to have lost nothing."""


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


def candidates(group: Group, closure: Closure) -> ModeCandidates | None:
    """Return all solutions of a group at one sample, None if there is no elimination.

    `closure` is the group's own, with a single sample.
    """
    if not has_elimination(group):
        return None
    frames = Frames.of(group, closure)
    return _triad(group, frames) or _tree(group, frames)


def has_elimination(group: Group) -> bool:
    """Return whether all solutions of a group may be found by elimination."""
    return group.revolute and len(group.bodies) in (5, 7)


def _triad(group: Group, frames: Frames) -> ModeCandidates | None:
    """Return the solutions of two bodies joined by three bars."""
    bars = bars_of(group)
    both = joined_by_three(bars)
    if both is None:
        return None
    base, platform = both
    arcs = frames.arcs(bars)
    if np.min(arcs.sines) < POINTLIKE:
        return _none(group, COMMON_POINTS, "a link has an arc of about 0 or 180 deg")
    places = np.arange(3)
    fixed = arcs.outer[places, [bar.bodies.index(base) for bar in bars]]
    moving = arcs.outer[places, [bar.bodies.index(platform) for bar in bars]]
    points = common_points(arc_quadric(fixed, moving, arcs.cosines)[None])[0]
    if np.any(np.isnan(points)):
        return _none(group, COMMON_POINTS, "there are infinitely many complex solutions")
    quaternions, imaginary = nearest_real(points)
    tried = imaginary < NEARLY_REAL
    placed = np.empty((int(np.sum(tried)), len(group.bodies), 3, 3))
    placed[:, base], placed[:, platform] = np.eye(3), from_quaternion(quaternions[tried])
    with np.errstate(invalid="ignore", divide="ignore"):
        arcs.place(placed, bars)
    return _placed_bodies(frames, placed, imaginary[tried] < REAL, COMMON_POINTS, "")


def _none(group: Group, roots: int, problem: str) -> ModeCandidates:
    nothing = np.empty((0, len(group.pairs)))
    return ModeCandidates(nothing, np.empty(0, dtype=bool), roots, problem)


def _placed_bodies(
    frames: Frames, placed: Floats, real: Bools, roots: int, problem: str
) -> ModeCandidates:
    """Return the candidates of bodies placed (n, bodies, 3, 3), where they could be."""
    angles = frames.angles(placed)
    finite = np.all(np.isfinite(angles), axis=1)
    if not np.all(finite):
        problem = problem or "the neighbours of a link have axes on one line"
    return ModeCandidates(angles[finite], real[finite], roots, problem)


@final
@dataclass(frozen=True)
class _Order:
    """A tree left by three bars, in an order in which its angles can be eliminated.

    `bodies` and `pairs` are those of the tree, the pair of the remaining angle first;
    `bars` are those of the equations, `ways` the pairs that each of them spans.
    """

    bodies: tuple[int, ...]
    pairs: tuple[int, ...]
    bars: tuple[Bar, ...]
    ways: tuple[tuple[int, ...], ...]

    @property
    def involves(self) -> Bools:
        """(3, 3) which equation has which angle in it."""
        return np.array([[pair in way for pair in self.pairs] for way in self.ways])

    @property
    def degree(self) -> int:
        """Degree of the eliminant in the remaining angle, 0 if there is none."""
        return eliminated_degree(self.involves)


@lru_cache
def _orders(group: Group) -> tuple[_Order, ...]:
    """Return the orders of lowest degree, the same ones every time."""
    orders = []
    bars = bars_of(group)
    for taken in combinations(bars, 3):
        out = {bar.body for bar in taken}
        left = tuple(body for body in range(len(group.bodies)) if body not in out)
        pairs = [k for k, ends in enumerate(group.ends) if not out & set(ends)]
        if len(pairs) != 3 or any(out & set(bar.bodies) for bar in taken):
            continue
        ways = {bar: _way(group, pairs, *bar.bodies) for bar in taken}
        for sequence in permutations(pairs):
            for first, second, third in permutations(taken):
                three = (first, second, third)
                order = _Order(left, sequence, three, tuple(ways[bar] for bar in three))
                if order.degree and taken.index(second) < taken.index(third):
                    orders.append(order)
    least = min((order.degree for order in orders), default=0)
    return tuple(order for order in orders if order.degree == least)


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


def _tree(group: Group, frames: Frames) -> ModeCandidates | None:
    """Return the solutions of four bodies in a tree joined by three bars."""
    orders = _orders(group)
    if not orders:
        return None
    parts = []
    for order in orders[:MOST_ORDERS]:
        roots = 2 * order.degree
        arcs = frames.arcs(order.bars)
        if np.min(arcs.sines) < POINTLIKE:
            problem = "a link has an arc of about 0 or 180 deg"
            parts.append(_none(group, roots, problem))
            continue
        equations = np.stack([_equation(frames, order, arcs, k) for k in range(3)])
        with np.errstate(all="ignore"):
            solutions = common_angles(equations, order.involves)
        imaginary = np.max(np.abs(solutions.angles.imag), axis=1, initial=0.0)
        tried = imaginary < NEARLY_REAL
        placed = _placed(group, frames, order, solutions.angles[tried].real)
        with np.errstate(invalid="ignore", divide="ignore"):
            arcs.place(placed, order.bars)
        real = imaginary[tried] < REAL
        parts.append(_placed_bodies(frames, placed, real, roots, solutions.problem))
        if not parts[-1].problem:
            return parts[-1]
    values = np.concatenate([part.values for part in parts])
    real = np.concatenate([part.real for part in parts])
    return ModeCandidates(values, real, parts[-1].roots, parts[-1].problem)


def count_orders(group: Group) -> int:
    """Return in how many ways four bodies in a tree with three bars can be eliminated."""
    return len(_orders(group)[:MOST_ORDERS]) if has_elimination(group) else 0


@final
@dataclass(frozen=True)
class AllSolutions:
    """All complex solutions of a group of seven bodies at one sample.

    `angles` (k, 3) complex are those of the tree, `determinants` (k,) those of its
    equations.
    """

    angles: Complexes
    determinants: Complexes


def all_solutions(
    group: Group, closure: Closure, which: int, near: Complexes | None
) -> AllSolutions | None:
    """Return all complex solutions of a group of seven bodies, None if one is missing.

    `which` is the number of the order of elimination: another one has other equations,
    and other determinants. `near` are the angles at a neighbouring sample, tried first:
    from wherever they are reached, as many solutions as there are roots are all.
    `closure` is the group's own, with a single sample.
    """
    order = _orders(group)[which]
    frames = Frames.of(group, closure)
    arcs = frames.arcs(order.bars)
    equations = np.stack([_equation(frames, order, arcs, k) for k in range(3)])
    with np.errstate(all="ignore"):
        angles = near if near is None else followed(equations, near)
        if angles is None or len(angles) != 2 * order.degree:
            angles = common_angles(equations, order.involves, farthest=np.inf).angles
        if len(angles) != 2 * order.degree:
            return None
        return AllSolutions(angles, determinants(equations, angles))


_TURN = np.zeros((3, 3, 3))
_TURN[0, 2, 2] = _TURN[1, 0, 0] = _TURN[1, 1, 1] = _TURN[2, 1, 0] = 1.0
_TURN[2, 0, 1] = -1.0
"""A rotation about z is this (3, 3, 3) times its point (1, cos, sin)."""


def _equation(frames: Frames, order: _Order, arcs: Arcs, number: int) -> Floats:
    """Return the equation (3, 3, 3) of one bar in the tree's three angles."""
    way, body = order.ways[number], order.bars[number].bodies[0]
    fixed, moving = arcs.outer[number]
    spread = fixed
    for pair in way:
        ahead = frames.ends[pair][0] == body
        further = sum(frames.ends[pair]) - body
        turn = _TURN if ahead else np.swapaxes(_TURN, 1, 2)
        one, other = frames.of_pair(pair, body), frames.of_pair(pair, further)
        spread = np.einsum("...i,jik->...jk", spread, one @ turn @ other.T)
        body = further
    spread = spread @ moving
    within = [angle for angle in range(3) if order.pairs[angle] in way]
    spread = np.transpose(spread, [way.index(order.pairs[angle]) for angle in within])
    equation = np.zeros((3, 3, 3))
    equation[tuple(slice(None) if a in within else 0 for a in range(3))] = spread
    equation[0, 0, 0] -= arcs.cosines[number]
    return equation


def _placed(group: Group, frames: Frames, order: _Order, angles: Floats) -> Floats:
    """Return orientations (n, bodies, 3, 3) with the tree placed at angles (n, 3)."""
    placed = np.full((len(angles), len(group.bodies), 3, 3), np.nan)
    placed[:, order.bodies[0]] = np.eye(3)
    reached = {order.bodies[0]}
    while len(reached) < len(order.bodies):
        for pair, angle in zip(order.pairs, angles.T, strict=True):
            for body, further in (group.ends[pair], group.ends[pair][::-1]):
                if body in reached and further not in reached:
                    sense = 1.0 if group.ends[pair][0] == body else -1.0
                    turn = about_z(sense * angle)
                    one, other = frames.of_pair(pair, body), frames.of_pair(pair, further)
                    placed[:, further] = placed[:, body] @ one @ turn @ other.T
                    reached.add(further)
    return placed
