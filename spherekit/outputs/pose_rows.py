"""An output at poses in one working mode, and configurations of poses in rows.

Inverse and forward kinematics of one output, whatever way leads there: a closed form has a
row for each pose and working mode; on the graph of a mechanism with other groups there is
one for each configuration that was found.
"""

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.outputs.dyad_chain import rates_of_turns, reciprocal


def turns_of(rates: Floats, directions: Floats | None) -> Floats:
    """Return the output's angular velocity (k, 3, inputs) per unit rate of each input.

    From the rates (k, inputs, 3) of the inputs: with two inputs, at right angles to the
    directions (k, 3).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        turns, _ = rates_of_turns(np.swapaxes(rates, 1, 2), directions)
    return np.swapaxes(turns, 1, 2)


def sense_of(rates: Floats, directions: Floats | None) -> Integers:
    """Return the sign (k,) of the determinant of rates (k, inputs, 3), 0 for none.

    It changes at singularities only: poses of one mode and one sign that hang together
    are an aspect. With two inputs the determinant is seen along the directions (k, 3).
    """
    # On the border of a leg rates are infinite and their determinant has no sign.
    with np.errstate(over="ignore", invalid="ignore"):
        _, volume = reciprocal(rates, directions)
    return np.sign(np.nan_to_num(volume)).astype(np.int64)


JointRange = JointLimit
"""A pair whose variable stays within [low, high] (rad), as that of a joint limit."""
