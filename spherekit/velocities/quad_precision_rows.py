"""Recomputes rows in quad precision when float64 loses too many digits.

Newton's method closes the loops to 33 digits and the same expressions are evaluated again.
The remaining error is then caused by the rounding of the input file. It is measured with a
complex step along each loop-closure error. Profiles that are not circles are extrapolated
linearly from float64 numbers, so their loops are closed to fewer digits.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Floats
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.quad_precision import quad
from spherekit.velocities.axis_rotations import append_profile_columns
from spherekit.velocities.row_kernel import MAX_NEWTON_STEPS, RowKernel

MAX_QUAD_CORRECTION_RAD = 1e-4
"""Largest movement of a variable in Newton's method for which a row keeps its solution.

Larger: a solution of another assembly mode could be taken. Smaller: nearly singular rows,
which are open by more in float64, are not closed.
"""

CLOSED_ROW_STEP_RAD = 1e-25
"""Largest last step of Newton's method for which a configuration counts as closed.

The steps converge quadratically, so the next one is below the rounding of quad precision.
"""

COMPLEX_STEP_RAD = 1e-30
"""Opening of a loop by which derivatives are computed.

A complex step has no cancellation, so it can be smaller than the rounding of the values.
"""

BATCH_ROWS = 256
"""Number of rows that are computed at once. Larger: fewer calls, more memory."""


@dataclass(frozen=True)
class QuadPrecisionRows:
    """Results for n configurations, computed in quad precision and rounded to float64.

    A configuration is also called a row. A column is one computed number, such as a
    component of a velocity.

    Attributes
    ----------
    columns
        (columns, n) all computed quantities: velocities, poles and their error bounds.
    bounds
        (numbers, n) numbers from which the accuracy of each row is judged, such as the
        condition number of its loop equations. `RowKernel.row_bounds` describes them.
    opening_changes
        (columns, n) by how much each column changes if the loops open, per rad. Each loop
        can open about three axes. The absolute changes for all loops and axes are added.
        Link sizes are rounded, so the loops are open by tiny angles. Such an angle times
        the change bounds the error of a column.
    is_closed
        (n,) whether Newton's method closed the loops in quad precision. If it failed, the
        row was computed from the float64 variables at which the method started.
    """

    columns: Floats
    bounds: Floats
    opening_changes: Floats
    is_closed: Bools


def recompute_in_quad(kernel: RowKernel, values: Floats) -> QuadPrecisionRows:
    """Compute all columns (quantities) of rows in quad precision.

    A row is a configuration for which float64 loses too many digits. Newton's method first
    closes its loops to 33 digits. The remaining errors are caused by link sizes that are
    rounded to float64, because exact sizes would open the loops by tiny angles. To bound
    these errors, the result also has the change of each column per opening of the loops.

    Parameters
    ----------
    kernel
        The functions of all columns, evaluated by NumPy, because compiled functions compute
        in float64 only.
    values
        (variables, n) configurations (rad), closed up to errors of float64.
    """
    batches = [
        _recompute_batch(kernel, values[:, start : start + BATCH_ROWS])
        for start in range(0, values.shape[1], BATCH_ROWS)
    ]
    return QuadPrecisionRows(
        columns=np.hstack([batch.columns for batch in batches]),
        bounds=np.hstack([batch.bounds for batch in batches]),
        opening_changes=np.hstack([batch.opening_changes for batch in batches]),
        is_closed=np.hstack([batch.is_closed for batch in batches]),
    )


def _recompute_batch(kernel: RowKernel, values: Floats) -> QuadPrecisionRows:
    """Compute at most `BATCH_ROWS` rows (configurations) in quad precision.

    The loops are closed first. In a row whose loops cannot be closed, the columns are
    computed at the original variables, and `is_closed` is False.

    Parameters
    ----------
    kernel
        The functions of all output columns, such as poles and angular velocities of links.
    values
        (variables, n) nearly closed configurations (rad).
    """
    x, is_closed = _close_loops(kernel, values)
    # Points on the profiles (contact curves of links) are further arguments. The curves can
    # only be evaluated in float64. They are evaluated at `values`, and the points are
    # extrapolated to x linearly. The error grows with the square of the distance.
    extended = append_profile_columns(x, kernel.profiles, expansion_point=values)
    columns = kernel.all_columns.function(extended).astype(float)
    # Numbers from which the accuracy of rows is judged. Among them is the inverse of the
    # loop equations: for each loop and each of three axes, the movement of each passive
    # variable (not an input) that closes the loop, per rad of opening about this axis.
    bounds = kernel.row_bounds.function(extended).astype(float)
    inverse = bounds[kernel.row_bounds.slices["inverse"]].reshape(
        len(kernel.passive_variables), 3 * kernel.loop_count, values.shape[1]
    )
    # Arcs and angles of links are rounded to float64. With the exact numbers, the loops
    # would be open by tiny angles. The changes of columns per rad of opening serve as error
    # bounds.
    opening_changes = _sum_opening_changes(kernel, x.astype(float), inverse)
    return QuadPrecisionRows(columns, bounds, opening_changes, is_closed)


def _close_loops(kernel: RowKernel, values: Floats) -> tuple[Array, Bools]:
    """Close the loops of n configurations by Newton's method in quad precision.

    Steps are computed for all configurations together, until all steps are small or
    `MAX_NEWTON_STEPS` are done. The method fails for a configuration if its last step was
    not small. It also fails if the variables have changed by more than
    `MAX_QUAD_CORRECTION_RAD`, possibly to another solution.

    Parameters
    ----------
    kernel
        The kernel, which has the function of a step of Newton's method.
    values
        (variables, n) nearly closed configurations (rad).

    Returns
    -------
    x
        (variables, n) closed configurations (rad) in quad precision, or the original values
        where the method fails.
    is_closed
        (n,) whether the method has closed the loops of a configuration.
    """
    passive = list(kernel.passive_variables)
    start = values.astype(quad())
    # (variables, n) the present iterate.
    x = start.copy()
    for _ in range(MAX_NEWTON_STEPS):
        # A profile (contact curve of a link) that is not a circle is a float64 series. The
        # series and its derivative are evaluated at `values`. A linear function replaces
        # the series from there to the iterate x. The loops are closed with these profiles.
        extended = append_profile_columns(x, kernel.profiles, expansion_point=values)
        # The variables that are not inputs (passive), after a step.
        passive_values = kernel.newton_step.function(extended)
        step_sizes = max_abs((passive_values - x[passive]).astype(float), axis=0)
        x[passive] = passive_values
        if not np.any(step_sizes > CLOSED_ROW_STEP_RAD):
            break
    distances = max_abs((x - start).astype(float), axis=0)
    is_closed = (step_sizes <= CLOSED_ROW_STEP_RAD) & (distances < MAX_QUAD_CORRECTION_RAD)
    x[:, ~is_closed] = start[:, ~is_closed]
    return x, is_closed


def _sum_opening_changes(kernel: RowKernel, values: Floats, inverse: Floats) -> Floats:
    """Return how much each output column changes if loops open, as a sum of magnitudes.

    Output columns are the computed quantities, such as angular velocities of links. Because
    arcs and angles of links are rounded, computed loops are open by tiny angles. Such an
    angle times the sum bounds the error of a column. A loop opens by a small rotation,
    which has three components. So there are three directions for each loop.

    The derivatives are computed with complex steps: f'(x) = Im f(x + ih) / h (Squire and
    Trapp 1998).

    Parameters
    ----------
    kernel
        The functions of all columns.
    values
        (variables, n) closed configurations (rad).
    inverse
        (passive variables, directions, n) movement of the variables that are not inputs,
        per unit opening of a loop in each direction (rad per rad).

    Returns
    -------
    (columns, n) sums of the absolute changes, per rad.
    """
    passive = list(kernel.passive_variables)
    direction_count, count = inverse.shape[1:]
    changes = np.zeros((kernel.column_count, count))
    # One call evaluates several directions. With few rows, each call takes about the same
    # time as with `BATCH_ROWS` rows.
    directions_per_call = max(1, BATCH_ROWS // max(count, 1))
    for start in range(0, direction_count, directions_per_call):
        # (passive variables, directions of this call, n)
        movements = inverse[:, start : start + directions_per_call]
        # Each direction needs its own copy of all n configurations. The copies follow each
        # other: all configurations for the first direction, then all for the second, and so
        # on. The movements are put in the same order.
        repeated = np.tile(values, movements.shape[1])
        movements_in_order = movements.reshape(len(passive), -1)
        stepped = repeated.astype(complex)
        stepped.imag[passive] = COMPLEX_STEP_RAD * movements_in_order
        # Profiles (contact curves) that are series cannot be evaluated at complex numbers.
        # They are evaluated at the real configurations and extrapolated linearly by the
        # step.
        extended = append_profile_columns(
            stepped, kernel.profiles, expansion_point=repeated
        )
        columns = kernel.all_columns.function(extended)
        # (columns, directions, n)
        magnitudes = np.abs(columns.imag).reshape(len(columns), movements.shape[1], count)
        # One direction after another, so that rounding does not depend on the directions
        # per call.
        for magnitudes_of_direction in magnitudes.swapaxes(0, 1):
            changes += magnitudes_of_direction / COMPLEX_STEP_RAD
    return changes
