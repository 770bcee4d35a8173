"""Recomputes rows in quad precision when float64 loses too many digits.

Newton's method closes the loops to 33 digits and the same expressions are evaluated again.
The remaining error is then caused by the rounding of the input file. It is measured with a
complex step along each loop-closure error.
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
"""Largest last step of Newton's method of a closed configuration.

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
    """Rows (configurations) that were computed in quad precision, rounded to float64.

    Attributes
    ----------
    columns
        (columns, n) all columns of the kernel: velocities, poles and their error bounds.
    bounds
        (numbers, n) numbers on the loop equations at each row: their condition number, all
        entries of their inverse, and residuals. `RowKernel.row_bounds` describes them.
    opening_changes
        (columns, n) sensitivity of each column to the opening of loops. Each loop can open
        about three axes. For each loop and axis the derivative of the column by the opening
        angle (rad) is taken without its sign, and all are added.
    is_closed
        (n,) whether Newton's method closed the loops. Other rows were computed at the
        variables that were given.
    """

    columns: Floats
    bounds: Floats
    opening_changes: Floats
    is_closed: Bools


def recompute_in_quad(kernel: RowKernel, values: Floats) -> QuadPrecisionRows:
    """Return all columns (quantities) of rows, computed in quad precision.

    A row is a configuration. Newton's method closes its loops to 33 digits first. The
    result also has the changes of the columns if loops open a little, from which error
    bounds follow.

    Parameters
    ----------
    kernel
        A kernel whose functions are evaluated by NumPy. Compiled functions compute in
        float64 only, but NumPy arrays can have numbers of quad precision.
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
    """Return at most `BATCH_ROWS` rows, computed in quad precision.

    The loops are closed first. The columns of a row in which this fails are computed at the
    given variables, and `is_closed` is False. The caller then adds the opening of its loops
    to the error bounds.

    Parameters
    ----------
    kernel
        The functions of all output columns, such as poles and angular velocities of links.
    values
        (variables, n) nearly closed configurations (rad).
    """
    x, is_closed = _close_loops(kernel, values)
    extended = append_profile_columns(x, kernel.profiles, expansion_point=values)
    columns = kernel.all_columns.function(extended).astype(float)
    # Numbers by which a row is judged. Among them is the inverse of the loop equations: the
    # movement of each passive variable per unit opening of each loop about three axes.
    bounds = kernel.row_bounds.function(extended).astype(float)
    inverse = bounds[kernel.row_bounds.slices["inverse"]].reshape(
        len(kernel.passive_variables), 3 * kernel.loop_count, values.shape[1]
    )
    # How much each column changes per unit opening of the loops. The sizes of a mechanism
    # are rounded to float64, so the loops of the true mechanism are open by tiny angles. An
    # estimate of these angles times the changes is a bound of the errors of the columns.
    opening_changes = _sum_opening_changes(kernel, x.astype(float), inverse)
    return QuadPrecisionRows(columns, bounds, opening_changes, is_closed)


def _close_loops(kernel: RowKernel, values: Floats) -> tuple[Array, Bools]:
    """Close the loops of rows by Newton's method in quad precision.

    Steps are made for all rows together, until all of them are small or their number is
    `MAX_NEWTON_STEPS`. The method fails in a row if the last step was not small, or if the
    row has moved by more than `MAX_QUAD_CORRECTION_RAD` and may have reached another
    solution.

    Parameters
    ----------
    kernel
        The functions of all output columns, and of a step of Newton's method.
    values
        (variables, n) nearly closed configurations (rad).

    Returns
    -------
    x
        (variables, n) closed configurations (rad) in quad precision. Rows in which the
        method fails have the given values.
    is_closed
        (n,) whether the method has closed the loops of a row.
    """
    passive = list(kernel.passive_variables)
    start = values.astype(quad())
    # (variables, n) the present iterate.
    x = start.copy()
    for _ in range(MAX_NEWTON_STEPS):
        # Profiles of contacts that are no circles are stored as float64 series. They are
        # evaluated at `values` and extrapolated linearly to the iterate, which is near.
        extended = append_profile_columns(x, kernel.profiles, expansion_point=values)
        # The passive variables after a step. Inputs are not changed.
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

    Output columns are the computed quantities, such as angular velocities of links. The
    sizes of a mechanism are rounded, so that its computed loops remain open by tiny angles.
    Such an angle times the sum is a bound of the error of a column. A loop can open about
    three axes, so there are three directions for each loop.

    The derivatives are computed with complex steps: f'(x) = Im f(x + ih) / h (Squire and
    Trapp 1998).

    Parameters
    ----------
    kernel
        The functions of all columns.
    values
        (variables, n) closed configurations (rad).
    inverse
        (passive variables, directions, n) movement of the variables per unit opening of a
        loop in each direction, rad per rad.

    Returns
    -------
    (columns, n) sums of sizes, per rad.
    """
    passive = list(kernel.passive_variables)
    direction_count, count = inverse.shape[1:]
    changes = np.zeros((kernel.column_count, count))
    # One call takes several directions. For few rows, a call takes about as long as it does
    # for `BATCH_ROWS` rows.
    directions_per_call = max(1, BATCH_ROWS // max(count, 1))
    for start in range(0, direction_count, directions_per_call):
        # All n configurations are repeated, once for each direction of this call. The
        # movements (variables, directions, n) are put in the same order.
        movements = inverse[:, start : start + directions_per_call]
        repeated = np.tile(values, movements.shape[1])
        stepped = repeated.astype(complex)
        stepped.imag[passive] = COMPLEX_STEP_RAD * movements.reshape(len(passive), -1)
        # Stored series of profiles cannot be evaluated at complex numbers. They are
        # evaluated at the real configurations and extrapolated linearly by the step.
        extended = append_profile_columns(
            stepped, kernel.profiles, expansion_point=repeated
        )
        columns = kernel.all_columns.function(extended)
        # (columns, directions, n)
        sizes = np.abs(columns.imag).reshape(len(columns), movements.shape[1], count)
        # The directions are added one after another. The rounding of the sum then does not
        # depend on the number of directions in a call, and so not on the number of rows.
        for size in sizes.swapaxes(0, 1):
            changes += size / COMPLEX_STEP_RAD
    return changes
