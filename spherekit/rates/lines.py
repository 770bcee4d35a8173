"""Evaluating a plan: every pole axis as the intersection of great circles.

Each pole carries a bound of its error, propagated from those of its sources. Of all the
great circles that the plan keeps for a pole, a route takes the best two or the first two.
The best two are the one with the smallest error and then the partner that makes the
intersection most certain; both the angle between the two planes and the bound are reported.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS
from spherekit.model.joints import PairRates
from spherekit.motion.loops import LoopTree
from spherekit.motion.motion import Motion
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)
from spherekit.rates.core import NullMotion, null_motion, null_motion_rate
from spherekit.rates.routes import Route
from spherekit.rates.vectors import cross, dot, norm, unit_rate
from spherekit.sphere.rotation import Floats


@final
@dataclass
class Lines:
    """Unit vectors along pole axes, with error bounds, and what derivatives need.

    `unit[pole]`, `rate[pole]`: (3, n); `error[pole]`: (n,) bound of the direction's
    error (rad); `angle[pole]`: (n,) sine of the angle between the two planes used, 1
    for primary poles; `planes[pole]`: (2, 3, n) unit normals of those planes, kept for
    the poles they were asked for. `contact[pair]`, `contact_rate[pair]`: (3, n) unit
    normal of a sliding pair's contact plane and its derivative.
    """

    route: Route
    unit: dict[Pole, Floats]
    rate: dict[Pole, Floats]
    error: dict[Pole, Floats]
    angle: dict[Pole, Floats]
    planes: dict[Pole, Floats]
    contact: dict[int, Floats]
    contact_rate: dict[int, Floats]
    chosen: dict[Pole, NDArray[np.intp]]
    blocks: dict[BlockPoles, NullMotion]

    @staticmethod
    def of_pairs(plan: Plan, motion: Motion, route: Route) -> "Lines":
        """Return the poles and contact planes that the pairs give, and no others yet."""
        lines = Lines(route, {}, {}, {}, {}, {}, {}, {}, {}, {})
        axes = motion.axes
        n = len(axes)
        for number, pair in enumerate(plan.mechanism.pairs):
            if pair.kind.pole_line is None:
                lines.contact[number] = np.ascontiguousarray(axes[:, number].T)
        for step in plan.steps:
            if isinstance(step, PrimaryPole | CoaxialPole):
                lines.unit[step.pole] = np.ascontiguousarray(axes[:, step.pair].T)
                lines.error[step.pole] = np.full(n, EPS)
                lines.angle[step.pole] = np.ones(n)
        return lines


def evaluate_lines(
    plan: Plan, motion: Motion, keep_planes: Collection[Pole] = (), route: Route = "best"
) -> Lines:
    """Return the directions of all poles of a plan.

    Signs of secondary poles are arbitrary here.
    """
    lines = Lines.of_pairs(plan, motion, route)
    for step in plan.steps:
        if isinstance(step, LinePole):
            _intersect(step, lines, step.pole in keep_planes)
        elif isinstance(step, BlockPoles):
            solve_block(plan, step, motion, lines)
    for pole in keep_planes:
        if pole not in lines.planes:
            planes_through(plan, pole, lines)
    return lines


def evaluate_line_rates(
    plan: Plan, lines: Lines, motion: Motion, turned: PairRates
) -> None:
    """Add the derivatives of all directions, given those at the pairs.

    The product rule through the same intersections that `evaluate_lines` chose.
    """
    for number in lines.contact:
        lines.contact_rate[number] = np.ascontiguousarray(turned.axes[:, number].T)
    for step in plan.steps:
        if isinstance(step, PrimaryPole | CoaxialPole):
            lines.rate[step.pole] = np.ascontiguousarray(turned.axes[:, step.pair].T)
        elif isinstance(step, LinePole):
            _intersect_rate(step, lines)
        else:
            block_rate(plan, step, motion, turned, lines)


def line_sources(step: LinePole, k: int) -> tuple[Pole, Pole]:
    """Return the two poles through which link k draws a great circle of a pole."""
    i, j = step.pole
    return pole_of(i, k), pole_of(j, k)


def _intersect(step: LinePole, lines: Lines, keep_planes: bool) -> None:
    normals, length, error = great_circles(step, lines)
    best, partner, first, vector, size, doubt = _best_two(
        normals[:2] if lines.route == "first" else normals, length, error
    )
    across = norm(vector)
    lines.unit[step.pole] = vector / np.where(across > 0.0, across, np.nan)
    lines.error[step.pole] = np.minimum(doubt, 1.0)
    lines.angle[step.pole] = size
    lines.chosen[step.pole] = np.stack([best, partner])
    if keep_planes:
        pair = np.stack([first, _take(normals, partner)])
        lines.planes[step.pole] = pair / norm(pair)[:, None]


def great_circles(step: LinePole, lines: Lines) -> tuple[Floats, Floats, Floats]:
    """Return normals (lines, 3, n), their lengths and error bounds (lines, n).

    First those through pairs of known poles, then the contact planes.
    """
    sources, stack = _normals(step, lines)
    inherited = [lines.error[a] + lines.error[b] for a, b in sources]
    inherited += [np.zeros_like(stack[-1][0]) for _ in step.contacts]
    length = norm(stack)
    return stack, length, (np.stack(inherited) + EPS) / np.maximum(length, EPS)


def _best_two(
    normals: Floats, length: Floats, error: Floats
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats, Floats, Floats]:
    """Return for each sample the surest great circle and its surest partner.

    The two line numbers (n,), the first normal and the intersection (3, n), the sine of
    the angle between the planes and the error bound of the intersection (n,).
    """
    count, n = len(normals), normals.shape[2]
    length, error = length[:count], error[:count]
    every = np.arange(n)
    if count == 2:
        best, partner = np.zeros(n, dtype=int), np.ones(n, dtype=int)
    else:
        best = np.argmin(error, axis=0)
    first = _take(normals, best)
    along = cross(first[None], normals)
    size = norm(along) / np.maximum(length * length[best, every], EPS * EPS)
    doubt = (error + error[best, every]) / np.maximum(size, EPS)
    if count > 2:
        doubt[best, every] = np.inf
        partner = np.argmin(doubt, axis=0)
    return (
        best,
        partner,
        first,
        _take(along, partner),
        size[partner, every],
        doubt[partner, every],
    )


def planes_through(plan: Plan, pole: Pole, lines: Lines) -> None:
    """Keep two great circles through a pole that was found otherwise, if there are any."""
    i, j = pole
    via = tuple(
        k
        for k in plan.bodies
        if k not in pole and pole_of(i, k) in lines.unit and pole_of(j, k) in lines.unit
    )
    n = lines.unit[pole].shape[1]
    if len(via) < 2:
        lines.planes[pole] = np.full((2, 3, n), np.nan)
        return
    normals, length, error = great_circles(LinePole(pole, 0, via), lines)
    _, partner, first, *_ = _best_two(normals, length, error)
    pair = np.stack([first, _take(normals, partner)])
    lines.planes[pole] = pair / norm(pair)[:, None]


def _take(stack: Floats, which: NDArray[np.intp]) -> Floats:
    """Return (3, n) from (lines, 3, n) with its own line for each sample."""
    index = np.broadcast_to(which[None, None, :], (1, *stack.shape[1:]))
    return np.asarray(np.take_along_axis(stack, index, axis=0)[0])


def great_circle_rates(step: LinePole, lines: Lines) -> tuple[Floats, Floats]:
    """Return the normals (lines, 3, n) of `great_circles` and their derivatives."""
    sources, stack = _normals(step, lines)
    changes = [
        cross(lines.rate[a], lines.unit[b]) + cross(lines.unit[a], lines.rate[b])
        for a, b in sources
    ]
    changes += [lines.contact_rate[number] for number in step.contacts]
    return stack, np.stack(changes)


def _normals(step: LinePole, lines: Lines) -> tuple[list[tuple[Pole, Pole]], Floats]:
    """Return the poles that great circles pass, and all normals (lines, 3, n)."""
    sources = [line_sources(step, k) for k in step.via]
    normals = [cross(lines.unit[a], lines.unit[b]) for a, b in sources]
    normals += [lines.contact[number] for number in step.contacts]
    return sources, np.stack(normals)


def _intersect_rate(step: LinePole, lines: Lines) -> None:
    stack, stack_rate = great_circle_rates(step, lines)
    best, partner = lines.chosen[step.pole]
    one, other = _take(stack, best), _take(stack, partner)
    vector = cross(one, other)
    change = cross(_take(stack_rate, best), other) + cross(one, _take(stack_rate, partner))
    lines.rate[step.pole] = unit_rate(lines.unit[step.pole], norm(vector), change)


def _block_tree(plan: Plan, step: BlockPoles) -> tuple[LoopTree, list[int]]:
    """Return the loops of an irreducible part, and the numbers of its variables."""
    number = {link: k for k, link in enumerate(step.links)}
    mechanism = plan.mechanism
    ends = tuple(
        (number[a], number[b]) for a, b in (plan.ends[pair] for pair in step.pairs)
    )
    variables = [mechanism.variables_of(pair) for pair in step.pairs]
    owners = tuple(k for k, of_pair in enumerate(variables) for _ in of_pair)
    flat = [variable for of_pair in variables for variable in of_pair]
    return LoopTree(len(step.links), ends, owners), flat


def solve_block(plan: Plan, step: BlockPoles, motion: Motion, lines: Lines) -> None:
    """Add the poles of an irreducible part."""
    tree, variables = _block_tree(plan, step)
    block = null_motion(tree, motion.vectors[:, variables])
    lines.blocks[step] = block
    number = {link: k for k, link in enumerate(step.links)}
    growth = np.linalg.norm(block.inverse, axis=(1, 2))
    for pole in step.poles:
        vector = (block.w[:, number[pole[1]]] - block.w[:, number[pole[0]]]).T
        length = norm(vector)
        lines.unit[pole] = vector / np.where(length > 0.0, length, np.nan)
        lines.error[pole] = np.minimum(EPS * growth / np.maximum(length, EPS), 1.0)
        lines.angle[pole] = np.minimum(1.0, 1.0 / np.maximum(growth, 1.0))


def block_rate(
    plan: Plan, step: BlockPoles, motion: Motion, turned: PairRates, lines: Lines
) -> None:
    """Add the derivatives of the poles of an irreducible part."""
    tree, variables = _block_tree(plan, step)
    block = lines.blocks[step]
    change = null_motion_rate(
        tree, motion.vectors[:, variables], turned.vectors[:, variables], block
    )
    number = {link: k for k, link in enumerate(step.links)}
    for pole in step.poles:
        i, j = number[pole[0]], number[pole[1]]
        vector = (block.w[:, j] - block.w[:, i]).T
        rate = (change[:, j] - change[:, i]).T
        lines.rate[pole] = unit_rate(lines.unit[pole], norm(vector), rate)


def decompose(whole: Floats, one: Floats, other: Floats) -> tuple[Floats, Floats]:
    """Return the coefficient of `one` in whole = x one + y other, and the sine (n,).

    The vector form of eq. (5) of Di Gregorio 2024. It is 0/0 only where the axes `one`
    and `other` coincide, not where the rate of one of them vanishes.
    """
    normal = cross(one, other)
    square = dot(normal, normal)
    return dot(cross(whole, other), normal) / square, np.sqrt(square)


def decompose_rate(
    whole: tuple[Floats, Floats],
    one: tuple[Floats, Floats],
    other: tuple[Floats, Floats],
) -> Floats:
    """Return the derivative (n,) of the coefficient that `decompose` gives."""
    (w, dw), (a, da), (b, db) = whole, one, other
    normal = cross(a, b)
    change = cross(da, b) + cross(a, db)
    square = dot(normal, normal)
    numerator = dot(cross(w, b), normal)
    rate = dot(cross(dw, b) + cross(w, db), normal) + dot(cross(w, b), change)
    return np.asarray((rate - 2.0 * numerator * dot(normal, change) / square) / square)
