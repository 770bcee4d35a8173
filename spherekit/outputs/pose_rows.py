"""Rates and aspects of configurations of an output, row by row.

The rates and aspects follow from the rates of the inputs, whether these were computed in
closed form or from the graph of all links.
"""

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.outputs.dyad_chain import reciprocal_vectors


def turns_of(rates: Floats, directions: Floats | None) -> Floats:
    """Return the output's angular velocity per unit rate of each input.

    Column i of the result is the angular velocity while input i has the rate 1 and the
    others are locked. A matrix (inputs, 3) takes the angular velocity of the output to the
    rates of the inputs. With two inputs, the output is the direction of a link, and the
    unit vector along it is added as a third row. So the angular velocity has no component
    along the direction. The result is the inverse of this matrix, without the column that
    belongs to the direction.

    Parameters
    ----------
    rates
        (k, inputs, 3) the matrices at k configurations. The three columns have the rates of
        the inputs while the output turns about x, y or z at unit rate.
    directions
        (k, 3) if there are two inputs, the unit vectors in which the output link points.
        None for three inputs.

    Returns
    -------
    (k, 3, inputs) angular velocities. They are not finite in singular configurations, where
    the determinant of the matrix is zero. Some are NaN where a rate is infinite.
    """
    # The columns of the inverse of a matrix are the reciprocal vectors of its rows.
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        scaled_reciprocals, volume = reciprocal_vectors(rates, directions)
        angular_velocities = scaled_reciprocals / volume[:, None, None]
    # From (k, inputs, 3) to (k, 3, inputs).
    return np.swapaxes(angular_velocities, 1, 2)


def sense_of(rates: Floats, directions: Floats | None) -> Integers:
    """Return the sign (k,) of the determinant of the rates; 0 if this is 0 or NaN.

    The sign changes at singularities only. Connected poses with the same sign and the same
    working mode (choice of one of two positions for each leg) form an aspect. The mechanism
    can move between all poses of an aspect without passing a singularity.

    Parameters
    ----------
    rates
        (k, inputs, 3) rates of the inputs per unit angular velocity of the output.
    directions
        (k, 3) if there are two inputs, the unit vector in which the output link points. It
        becomes the third row of the determinant. None for three inputs.
    """
    # Where a leg is stretched or folded, rates are infinite, and their determinant is
    # infinite or NaN.
    with np.errstate(over="ignore", invalid="ignore"):
        _, determinant = reciprocal_vectors(rates, directions)
    return np.sign(np.nan_to_num(determinant)).astype(np.int64)


JointRange = JointLimit
"""A pair whose variable stays within [low, high] (rad), as that of a joint limit."""
