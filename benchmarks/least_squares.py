"""The direction closest to lying in all great circles of a pole: a route not taken."""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import EPS
from spherekit.model.joints import PairRates
from spherekit.motion.motion import Motion
from spherekit.planning.poles import BlockPoles, LinePole, Plan, Pole
from spherekit.rates.lines import (
    Lines,
    block_rate,
    great_circle_rates,
    great_circles,
    solve_block,
)
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Intersection:
    """Where great circles meet, as well as they do.

    `unit` (3, n) the direction; `error` (n,) bound of its error (rad); `sharpness` (n,)
    middle over largest singular value of the weighted normals, 0 where all great circles
    coincide. `weights` (lines, n); `inverse` (n, 3, lines) of the weighted normals across
    the direction.
    """

    unit: Floats
    error: Floats
    sharpness: Floats
    weights: Floats
    inverse: Floats


def intersection(normals: Floats, errors: Floats) -> Intersection:
    """Return the unit vector u with the least sum of squares of w N u.

    Parameters
    ----------
    normals
        (lines, 3, n) normals N of the great circles, of any length.
    errors
        (lines, n) bounds of the errors of the normals; the weights w are their
        reciprocals.

    Notes
    -----
    u is the right singular vector of the least singular value (Golub and Van Loan 2013,
    section 6.5.1, total least squares through the origin). With exact normals N u = 0.
    Normals that are wrong by at most 1 / w turn it by at most the root of their number
    over the middle singular value.
    """
    weights = 1.0 / errors
    rows = np.moveaxis(normals * weights[:, None], -1, 0)
    usable = np.all(np.isfinite(rows), axis=(1, 2))
    n, count = len(rows), len(normals)
    vector, middle = np.full((n, 3), np.nan), np.full(n, np.nan)
    largest, inverse = np.full(n, np.nan), np.full((n, 3, count), np.nan)
    left, sizes, right = np.linalg.svd(rows[usable])
    vector[usable] = right[:, 2]
    largest[usable], middle[usable] = sizes[:, 0], sizes[:, 1]
    across = np.swapaxes(right[:, :2], 1, 2) / sizes[:, None, :2]
    inverse[usable] = across @ np.swapaxes(left[:, :, :2], 1, 2)
    error = np.sqrt(count) / middle
    return Intersection(
        np.ascontiguousarray(vector.T),
        np.nan_to_num(error, nan=1.0, posinf=1.0),
        middle / largest,
        weights,
        inverse,
    )


def intersection_rate(found: Intersection, normal_rates: Floats) -> Floats:
    """Return the derivative (3, n) of the direction, given those of the normals.

    N u = 0 stays true, so N u' = - N' u; the weights' own derivatives multiply N u. Exact
    to the first order in what the great circles miss each other by.
    """
    turned = np.einsum("lkn,kn->nl", normal_rates * found.weights[:, None], found.unit)
    return np.ascontiguousarray(-np.einsum("nkl,nl->kn", found.inverse, turned))


def directions_and_rates(
    plan: Plan, motion: Motion, turned: PairRates
) -> tuple[dict[Pole, Floats], dict[Pole, Floats]]:
    """Return the unit vectors (3, n) of all poles of a plan and their derivatives.

    Signs of secondary poles are arbitrary. `turned` is the motion of the pairs.
    """
    lines = Lines.of_pairs(plan, motion, "conditioned")
    fitted: dict[Pole, Intersection] = {}
    for step in plan.steps:
        if isinstance(step, LinePole):
            normals, length, error = great_circles(step, lines)
            found = intersection(normals, error * np.maximum(length, EPS))
            fitted[step.pole] = found
            lines.unit[step.pole] = found.unit
            lines.error[step.pole] = np.minimum(found.error, 1.0)
            lines.angle[step.pole] = found.sharpness
        elif isinstance(step, BlockPoles):
            solve_block(plan, step, motion, lines)
    for number in lines.contact:
        lines.contact_rate[number] = np.ascontiguousarray(turned.axes[:, number].T)
    for step in plan.steps:
        if isinstance(step, LinePole):
            _, changes = great_circle_rates(step, lines)
            lines.rate[step.pole] = intersection_rate(fitted[step.pole], changes)
        elif isinstance(step, BlockPoles):
            block_rate(plan, step, motion, turned, lines)
        else:
            lines.rate[step.pole] = np.ascontiguousarray(turned.axes[:, step.pair].T)
    return lines.unit, lines.rate
