"""Compares the configurations of a motion with the closure equations in many digits.

The sizes of the mechanism are the decimal numbers of its file (deg). The inputs are the
float64 numbers of the motion. The equations are those of `spherekit.proof.linkage`, which
shares no solver with the motion.
"""

import numpy as np

from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import Digits, centre_floats, exact_centres
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.linkage import Linkage
from spherekit.status import Status
from spherekit.tolerances import EPS

DIGITS = 50
CLOSED_RAD = 1e-40
"""Largest closure error (rad) of a loop that counts as closed, in 50 digits."""


def _equations_and_start(motion):
    """Return the closure equations of a motion, and its rows as start of Newton's method.

    A row is one sample in one assembly mode (way to assemble the links).

    Returns
    -------
    linkage
        Closure equations. Their sizes are the decimal numbers of the mechanism file, not
        rounded to float64.
    input_variables
        Columns of `start` that are inputs.
    start
        (rows, variables) pair variables (rad) of the motion, as balls: numbers with 50
        digits and an error bound.
    """
    mechanism = motion.mechanism
    linkage = Linkage(mechanism, read_decimals(mechanism).revolute_frames())
    input_variables = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    start = exact_balls(motion.values)
    # The input variables get exactly the values of the inputs that were asked for.
    start[:, input_variables] = exact_balls(motion.inputs)
    return linkage, input_variables, start


def deviations(motion):
    """Return the largest deviation (rows,) of a variable from the solution, in rad.

    Newton's method starts from the rows and keeps the inputs. At a dead centre it halves
    the distance with each step. If no configuration closes at an input, it does not
    converge and the deviation is NaN.
    """
    arithmetic = Digits(DIGITS)
    with arithmetic.within(), np.errstate(all="ignore"):
        linkage, input_variables, start = _equations_and_start(motion)
        solution = linkage.close_loops(start, input_variables, arithmetic.eps)
        deviation = np.max(np.abs(centre_floats(solution.values - start)), axis=1)
    return np.where(solution.status == Status.OK, deviation, np.nan)


def closure_residuals(motion):
    """Return the closure residual (rows,) of each row, rad.

    They are evaluated in 50 digits, at the input of the row and with the decimal sizes.
    """
    arithmetic = Digits(DIGITS)
    with arithmetic.within(), np.errstate(all="ignore"):
        linkage, _, start = _equations_and_start(motion)
        _, residuals = linkage.place_links(start)
        return np.max(np.abs(centre_floats(residuals)), axis=1)


def deviations_with_free_inputs(motion):
    """Return how far each row of a motion is from the nearest closed configuration.

    Newton's method changes the inputs too. At a dead centre (the input reverses), the exact
    mechanism may not close at the rounded input; then a solution is found beside it.
    Numbers have `DIGITS` digits and are balls: each has a centre and an error bound.

    Returns
    -------
    deviation
        (rows,) largest change of a variable in rad; NaN if no solution is found.
    input_shift
        (rows,) largest change of an input, divided by the rounding error of an input in
        float64; NaN if no solution is found.
    """
    arithmetic = Digits(DIGITS)
    with arithmetic.within(), np.errstate(all="ignore"):
        linkage, input_variables, start = _equations_and_start(motion)
        values = start.copy()
        # The inverse has only the digits of float64, so each step gains no more than these.
        # If a step gains only two digits, 25 steps are enough.
        for _ in range(25):
            orientations, residuals = linkage.place_links(values)
            jacobian = centre_floats(
                linkage.jacobian(linkage.variable_vectors(values, orientations))
            )
            jacobian = np.nan_to_num(jacobian)
            # Singular values below 1e-7 of the largest count as zero, so that a step is not
            # long where the Jacobian is nearly singular.
            inverse = exact_balls(np.linalg.pinv(jacobian, rcond=1e-7))
            next_values = values - np.matvec(inverse, residuals)
            # Only the centres are kept: the error bounds would grow with each step.
            values = exact_centres(next_values)
        _, residuals = linkage.place_links(values)
        is_closed = np.max(np.abs(centre_floats(residuals)), axis=1) < CLOSED_RAD
        change = np.abs(centre_floats(values - start))
    deviation = np.max(change, axis=1)
    rounding = EPS * np.maximum(1.0, np.max(np.abs(motion.inputs), axis=1))
    input_shift = np.max(change[:, input_variables], axis=1) / rounding
    return np.where(is_closed, deviation, np.nan), np.where(is_closed, input_shift, np.nan)
