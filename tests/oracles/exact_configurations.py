"""Compares the configurations of a motion with the closure equations in many digits.

The sizes are the decimal degrees of the file, inputs are the float64 numbers that they are.
The equations are those of `spherekit.proof.linkage`, which shares no solver with the
motion.
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
"""Loops that are open by less are closed, in 50 digits."""


def _linkage(motion):
    """Return the linkage of a motion with decimal sizes, its inputs, and its rows."""
    mechanism = motion.mechanism
    linkage = Linkage(mechanism, read_decimals(mechanism).revolute_frames())
    held = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    start = exact_balls(motion.values)
    start[:, held] = exact_balls(motion.inputs)
    return linkage, held, start


def deviations(motion):
    """Return (rows,) rad how far variables are from the solution, NaN where none is found.

    Newton's method starts from the rows. At a dead centre it halves the distance with each
    step, and where nothing closes it does not converge.
    """
    arithmetic = Digits(DIGITS)
    with arithmetic.within(), np.errstate(all="ignore"):
        linkage, held, start = _linkage(motion)
        solution = linkage.close_loops(start, held, arithmetic.eps)
        away = np.max(np.abs(centre_floats(solution.values - start)), axis=1)
    return np.where(solution.status == Status.OK, away, np.nan)


def deviations_beside(motion):
    """Return how far variables and inputs are from the nearest closed configuration.

    Inputs move too, so a solution is found also beside a dead centre, where nothing closes
    at the input of the row itself.

    Returns
    -------
    away, shift
        (rows,) rad the largest change of a variable, and of an input in roundings of it.
        NaN where no solution is found.
    """
    arithmetic = Digits(DIGITS)
    with arithmetic.within(), np.errstate(all="ignore"):
        linkage, held, start = _linkage(motion)
        values = start.copy()
        for _ in range(25):
            placed, gaps = linkage.place_links(values)
            jacobian = centre_floats(
                linkage.jacobian(linkage.variable_vectors(values, placed))
            )
            jacobian = np.nan_to_num(jacobian)
            # The residual has 50 digits, so each step gains the digits of the inverse.
            inverse = exact_balls(np.linalg.pinv(jacobian, rcond=1e-7))
            values = exact_centres(values - np.matvec(inverse, gaps))
        _, gaps = linkage.place_links(values)
        is_closed = np.max(np.abs(centre_floats(gaps)), axis=1) < CLOSED_RAD
        change = np.abs(centre_floats(values - start))
    away = np.max(change, axis=1)
    rounding = EPS * np.maximum(1.0, np.max(np.abs(motion.inputs), axis=1))
    shift = np.max(change[:, held], axis=1) / rounding
    return np.where(is_closed, away, np.nan), np.where(is_closed, shift, np.nan)
