"""A motion and its poles with the float64 numbers nearest to reference values.

An analysis computed once more from these shows the error of what it was computed from.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.exact.arithmetic import Numbers
from spherekit.exact.rows import ROUNDING, ExactRows
from spherekit.motion.motion import Motion
from spherekit.planning.poles import Pole
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.sphere.rotation import Floats

DIRECTED = 1e6
"""A vector gives a direction above this many roundings times the conditioning."""


def exact_motion(motion: Motion, rows: NDArray[np.bool_], exact: ExactRows) -> Motion:
    """Return some rows (n,) of a motion with the configurations that `exact` has of them.

    The residual is that by which the geometry as declared stays open.
    """
    floats = exact.arithmetic.floats
    return replace(
        motion.rows(rows),
        values=floats(exact.values),
        placed=floats(exact.rotations),
        residual=exact.residual,
        status=exact.status,
    )


def exact_direction(exact: ExactRows, pole: Pole, toward: Floats) -> Numbers:
    """Return the unit vectors (n, 3) along a pole, on the side of `toward` (n, 3).

    That is the axis or contact point of a pair of the two links, or else the direction of
    their relative angular velocity; of its derivative, where they are at rest. In ground
    axes; NaN where `toward` or the rows are, or where rounding could turn the direction by
    1e-6 rad, as where the derivative vanishes as well.

    Raises
    ------
    ValueError
        If the rows were made with order 1, without derivatives.
    """
    if exact.dw is None:
        raise ValueError("a direction needs rows of order 2 or 3")
    arithmetic = exact.arithmetic
    side = arithmetic.exact(toward)
    joined = exact.mechanism.pole_pairs.get((min(pole), max(pole)))
    if joined is not None:
        along = exact.axes[:, joined]
    else:
        i, j = pole
        along = exact.w[:, j] - exact.w[:, i]
        change = exact.dw[:, j] - exact.dw[:, i]
        floor = arithmetic.eps * exact.condition
        nothing = arithmetic.exact(np.full(along.shape, np.nan))
        moving = _above(exact, along, exact.w[:, [i, j]], DIRECTED * floor)
        at_rest = ~_above(exact, along, exact.w[:, [i, j]], ROUNDING * floor)
        leaving = _above(
            exact, change, exact.dw[:, [i, j]], DIRECTED * floor * exact.condition
        )
        along = np.where(moving, along, np.where(at_rest & leaving, change, nothing))
    length = arithmetic.root(np.sum(along * along, axis=1))
    over = np.sum(along * side, axis=1)
    sign = np.where(over < 0, -1, 1) + 0 * over
    return np.asarray(along * (sign / length)[:, None])


def exact_field(exact: ExactRows, wanted: Request, field: PoleField) -> PoleField:
    """Return a field's poles with the numbers nearest to the reference values.

    Parameters
    ----------
    exact
        Reference rows, of order 2 at least, for the input that the request moves.
    wanted
        The request behind the field.
    field
        What was found for the same rows: signs are taken from it, and NaN stays NaN.

    Returns
    -------
    PoleField
        NaN, with the status of the reference, where there is no reference; `angle`,
        `planes` and the bounds of errors are NaN, as they belong to the way in which poles
        were found.
    """
    if exact.dw is None:
        raise ValueError("a field needs rows of order 2 or 3")
    floats = exact.arithmetic.floats
    none = exact.status != Status.OK
    made = replace(
        field,
        direction={},
        velocity_coefficient={},
        acceleration_coefficient={},
        angle={pole: np.full_like(x, np.nan) for pole, x in field.angle.items()},
        error={pole: np.full_like(x, np.nan) for pole, x in field.error.items()},
        velocity_coefficient_error={
            pole: np.full_like(x, np.nan) for pole, x in field.velocity_coefficient.items()
        },
        acceleration_coefficient_error={
            pole: np.full_like(x, np.nan) for pole, x in field.velocity_coefficient.items()
        },
        planes={pole: np.full_like(x, np.nan) for pole, x in field.planes.items()},
        w={},
        dw={},
        status=np.where(none, exact.status, field.status).astype(np.int8),
        pole_status={},
    )
    for pole in wanted.poles:
        i, j = pole
        given = field.direction[pole]
        unit = exact_direction(exact, pole, given)
        v, dv = exact.w[:, j] - exact.w[:, i], exact.dw[:, j] - exact.dw[:, i]
        rate, acceleration_coefficient = (floats(np.sum(x * unit, axis=1)) for x in (v, dv))
        blind = ~np.all(np.isfinite(floats(unit)), axis=1)
        rate = np.where(blind, floats(_length(exact, v)), rate)
        acceleration_coefficient = np.where(
            blind, floats(_length(exact, dv)), acceleration_coefficient
        )
        made.direction[pole] = floats(unit)
        made.velocity_coefficient[pole] = np.where(
            np.isnan(field.velocity_coefficient[pole]), np.nan, rate
        )
        made.acceleration_coefficient[pole] = np.where(
            np.isnan(field.acceleration_coefficient[pole]), np.nan, acceleration_coefficient
        )
        codes = field.pole_status[pole]
        made.pole_status[pole] = np.where(none, exact.status, codes).astype(np.int8)
    for given_w, exact_rates, result in (
        (field.w, exact.w, made.w),
        (field.dw, exact.dw, made.dw),
    ):
        for link, vectors in given_w.items():
            result[link] = np.where(np.isnan(vectors), np.nan, floats(exact_rates[:, link]))
    return made


def _above(
    exact: ExactRows, vectors: Numbers, parts: Numbers, floor: Floats
) -> NDArray[np.bool_]:
    """Return (n, 1) whether differences (n, 3) of parts (n, 2, 3) are not rounding."""
    floats = exact.arithmetic.floats
    size = np.max(np.abs(floats(parts)), axis=(1, 2))
    largest = np.max(np.abs(floats(vectors)), axis=1)
    return np.asarray(largest > floor * np.maximum(size, 1.0))[:, None]


def _length(exact: ExactRows, vectors: Numbers) -> Numbers:
    return exact.arithmetic.root(np.sum(vectors * vectors, axis=1))
