"""Reference values of the rows of a motion: configuration, rates and their derivatives.

The rows of a motion say only which solution is meant. From there Newton's method closes
the loops in as many digits as wanted, and the loop equations as power series in the input
give all derivatives. Nothing of the solvers that made the motion is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Array, Bools, Floats, SmallIntegers
from spherekit.conventions import TURN
from spherekit.errors import SolveError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.proof.ball_frames import Frames, exact, exactly
from spherekit.proof.balls import FEWEST, Digits, floats, middles, pi, series
from spherekit.proof.linkage import (
    ROUNDING,
    Closed,
    Linkage,
    largest,
    lengths,
    turning_rates,
)
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE
from spherekit.velocities.pole_field import PoleField
from spherekit.velocities.pole_request import Request
from spherekit.wording import listing

RADIUS = 1e-6
"""A solution farther (rad) from the row than this is not taken for the one meant."""

DIRECTED = 1e6
"""A vector gives a direction above this many roundings times the conditioning."""


@dataclass(frozen=True)
class ExactRows:
    """Reference values of n rows while one input moves at unit rate, the others held.

    In ground axes, as balls of the `arithmetic`: `values` (n, variables) rad;
    `rates` (n, variables) of them per unit rate of the input; `rotations`
    (n, links, 3, 3); `axes` (n, pairs, 3) the axis of an R pair, the contact point of
    others; `w` (n, links, 3) angular velocities relative to the ground; `dw`, `ddw` their
    first and second derivative by the input, None where the order asked for does not reach
    them. NaN where the status is not OK.

    In float64: `distance` (n,) rad, the largest change of a variable from the row to the
    solution; `residual` (n,) rad, by which the geometry as declared stays open (rounding,
    except in over-constrained chains); `condition` (n,) of the closure Jacobian without
    the inputs, in Frobenius norms: an error e of the geometry moves the configuration by
    up to about `condition` times e, and it grows without bound towards singularities of
    type II. `status` (n,): that of a row which failed already; NOT_CONVERGED;
    MODE_LOST where the solution is farther than 1e-6 rad and than the row may be off by
    its open loops, or others are as near;
    AT_SINGULARITY where the Jacobian has no full rank in these numbers; NOT_CLOSED.
    """

    arithmetic: Digits
    mechanism: Mechanism
    driven: int
    values: Array
    rates: Array
    rotations: Array
    axes: Array
    w: Array
    dw: Array | None
    ddw: Array | None
    distance: Floats
    residual: Floats
    condition: Floats
    status: SmallIntegers

    @property
    def slopes(self) -> Array:
        """`dw`, where it was asked for.

        Raises
        ------
        ValueError
            If the rows were made with order 1, without derivatives.
        """
        if self.dw is None:
            raise ValueError("this needs rows of order 2 or 3")
        return self.dw


@checked(SolveError)
def exact_rows(
    motion: Motion,
    rows: Bools,
    driven: int,
    arithmetic: Digits | None = None,
    order: int = 2,
    inputs: Array | None = None,
) -> ExactRows:
    """Return reference values of some rows of a motion.

    The inputs, arcs, angles, radii and coefficients are taken as the float64 numbers
    they are given by; axes and centres are made unit vectors of balls.

    Parameters
    ----------
    motion
        Any motion; its variables are the starts, its inputs are exact.
    rows
        (n,) which rows are wanted.
    driven
        Number of the input pair that moves.
    arithmetic
        By default of 20 digits.
    order
        1 for w alone, 2 for dw as well, 3 for ddw as well.
    inputs
        (rows wanted, inputs) balls (rad), which the motion's are rounded from; by default
        its own are exact.

    Raises
    ------
    SolveError
        If the pair is not an input, or the order is not 1, 2 or 3.
    """
    (reference,) = exact_rows_by_input(motion, rows, (driven,), arithmetic, order, inputs)
    return reference


def exact_rows_by_input(
    motion: Motion,
    rows: Bools,
    driven: Sequence[int],
    arithmetic: Digits | None = None,
    order: int = 2,
    inputs: Array | None = None,
    frames: Frames | None = None,
) -> tuple[ExactRows, ...]:
    """Return `exact_rows` for each of some inputs that move alone, the others held.

    The configurations are found once; `frames` of R pairs are those of the numbers as they
    are, or as written (`Written.r_frames`).
    """
    mechanism = motion.mechanism
    for pair in driven:
        if pair not in motion.assembly.inputs:
            names = listing(mechanism.names_of(motion.assembly.inputs))
            raise SolveError(
                f"{mechanism.name}: pair number {pair} is not an input; inputs: {names}"
            )
    if order not in (1, 2, 3):
        raise SolveError(f"order {order} was asked for; give 1, 2 or 3")
    arithmetic = arithmetic or Digits(FEWEST)
    chosen = motion.rows(np.asarray(rows, dtype=bool))
    with arithmetic.within(), np.errstate(all="ignore"):
        linkage = Linkage(mechanism, frames)
        held = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
        start = exactly(chosen.values)
        # variables may have been brought into one turn; then so are the inputs
        turns = np.round((chosen.inputs - chosen.values[:, held]) / TURN)
        given = exactly(chosen.inputs) if inputs is None else inputs
        start[:, held] = given - turns * (2 * pi())
        solution = linkage.closed(start, held, arithmetic.eps)
        status = _judged(chosen, solution)
        placed, _ = linkage.place(solution.values)
        axes = linkage.axes(solution.values, placed)
        made = []
        for pair in driven:
            (moved,) = mechanism.variables_of(pair)
            way = linkage.motion(solution, moved, order)
            w = turning_rates(linkage.place(series(*way))[0], order)
            balls = solution.values, way[1], placed, axes, *w
            entries: list[Any] = [
                *(_where(status == Status.OK, values) for values in balls),
                *[None] * (3 - order),
                *(solution.distance, solution.residual, solution.condition, status),
            ]
            made.append(ExactRows(arithmetic, mechanism, pair, *entries))
    return tuple(made)


def _where(good: Bools, balls: Array) -> Array:
    """Return balls (n, ...) with NaN in the rows that are not good."""
    kept = balls.copy()
    kept[~good] = exact(np.nan)
    return kept


def _judged(motion: Motion, solution: Closed) -> SmallIntegers:
    """Return the status of rows: that of the motion, where this has failed already."""
    status = solution.status.copy()
    ok = status == Status.OK
    status[ok & (solution.residual > CLOSURE_TOLERANCE)] = Status.NOT_CLOSED
    off = motion.configuration_error
    near = np.maximum(np.where(np.isfinite(off), 2.0 * off, 0.0), RADIUS)
    status[ok & (solution.wild | (solution.distance > near))] = Status.MODE_LOST
    unknown = motion.failed | ~np.all(np.isfinite(motion.values), axis=1)
    given = np.where(motion.status == Status.OK, Status.NOT_CONVERGED, motion.status)
    return np.where(unknown, given, status).astype(np.int8)


def exact_motion(motion: Motion, rows: Bools, exact: ExactRows) -> Motion:
    """Return some rows (n,) of a motion with the configurations that `exact` has of them.

    The residual is that by which the geometry as declared stays open.
    """
    return replace(
        motion.rows(rows),
        values=floats(exact.values),
        placed=floats(exact.rotations),
        residual=exact.residual,
        status=exact.status,
    )


def exact_direction(exact: ExactRows, pole: Pole, toward: Floats) -> Array:
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
    with exact.arithmetic.within(), np.errstate(all="ignore"):
        moving, change = (_relative(w, pole) for w in (exact.w, exact.slopes))
        joined = exact.mechanism.pole_pairs.get(pole)
        if joined is not None:
            along = exact.axes[:, joined]
        else:
            floor = exact.arithmetic.eps * exact.condition
            rate, bent = (
                largest(v) / np.maximum(largest(w[:, pole].reshape(len(v), 6)), 1.0)
                for v, w in ((moving, exact.w), (change, exact.slopes))
            )
            turns = rate > DIRECTED * floor
            rests = ~(rate > ROUNDING * floor)
            leaves = bent > DIRECTED * floor * exact.condition
            along = _where(
                turns | (rests & leaves), np.where(turns[:, None], moving, change)
            )
        side = np.where(np.sum(floats(along) * toward, axis=1) < 0.0, -1.0, 1.0)
        sure = np.all(np.isfinite(toward), axis=1)
        # of the centres: a ball about 0 has no root
        return _where(sure, along * (side / lengths(middles(along)))[:, None])


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
        NaN, with the status of the reference, where there is no reference; `conditioning`,
        `planes` and the bounds of errors are NaN, as they belong to the way in which poles
        were found.
    """
    unknown = (
        *("conditioning", "planes", "direction_error"),
        *("velocity_coefficient_error", "acceleration_coefficient_error"),
        "direction_dq_error",
    )
    made: dict[str, Any] = {
        name: dict.fromkeys(getattr(field, name), np.nan) for name in unknown
    }
    with exact.arithmetic.within():
        units = {
            pole: exact_direction(exact, pole, field.direction[pole])
            for pole in wanted.poles
        }
        made["direction"] = units
        made["direction_dq"] = {pole: _turn(exact, pole, units[pole]) for pole in units}
        for name, rate, w in (
            ("velocity_coefficient", "w", exact.w),
            ("acceleration_coefficient", "dw", exact.slopes),
        ):
            made[name] = {pole: _along(_relative(w, pole), units[pole]) for pole in units}
            made[rate] = {link: w[:, link] for link in getattr(field, rate)}
    for name, numbers in made.items():
        made[name] = {
            key: np.where(np.isnan(getattr(field, name)[key]), np.nan, floats(x))
            for key, x in numbers.items()
        }
    status, *codes = (
        np.where(exact.status == Status.OK, given, exact.status).astype(np.int8)
        for given in (field.status, *(field.pole_status[pole] for pole in wanted.poles))
    )
    made["pole_status"] = dict(zip(wanted.poles, codes, strict=True))
    return replace(field, status=status, **made)


def _along(v: Array, unit: Array) -> Array:
    """Return components (n,) of vectors along directions, lengths where these are NaN."""
    blind = ~np.all(np.isfinite(floats(unit)), axis=1)
    return np.where(blind, lengths(middles(v)), np.sum(v * unit, axis=1))


def _turn(exact: ExactRows, pole: Pole, unit: Array) -> Floats:
    """Return (n, 3) how a direction turns: carried by a link, or from v = r u."""
    pairs, joined = exact.mechanism.pairs, exact.mechanism.pole_pairs.get(pole)
    if joined is not None and pairs[joined].kind.has_axis:
        return np.cross(floats(exact.w[:, exact.mechanism.ends[joined][0]]), floats(unit))
    v, dv = _relative(exact.w, pole), _relative(exact.slopes, pole)
    across = dv - np.sum(dv * unit, axis=1)[:, None] * unit
    with np.errstate(all="ignore"):
        return floats(across) / floats(np.sum(v * unit, axis=1))[:, None]


def _relative(w: Array, pole: Pole) -> Array:
    return w[:, pole[1]] - w[:, pole[0]]
