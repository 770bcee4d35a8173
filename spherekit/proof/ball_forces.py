"""The equivalent inertia of a mechanism and the torque of a table, in balls."""

import numpy as np

from spherekit.arrays import Array
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.mechanism import Mechanism
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.reference_rows import ExactRows


def exact_inertia(rows: ExactRows) -> tuple[Array, Array]:
    """Return the equivalent inertia and its derivative with respect to the moving input.

    The equivalent inertia is the moment of inertia that the input seems to have: twice the
    kinetic energy at unit rate of the input (Di Gregorio 2024, eqs. (14), (15)). The
    results are balls: numbers with a bound of their error. The inertia tensors count as
    exact.

    Parameters
    ----------
    rows
        n configurations with the rotations and angular velocities of all links, in balls.

    Returns
    -------
    inertia
        (n,) balls, kg m2.
    derivative
        (n,) balls, kg m2/rad.

    Raises
    ------
    ValueError
        If the rows were computed without derivatives.
    """
    # All balls are computed with the digits of `rows.arithmetic`. `slopes` are the
    # derivatives of the angular velocities with respect to the input. Reading them raises
    # the ValueError if they are missing.
    with rows.arithmetic.within():
        return equivalent_inertia(rows.mechanism, rows.rotations, rows.w, rows.slopes)


def equivalent_inertia(
    mechanism: Mechanism, rotations: Array, w: Array, dw: Array
) -> tuple[Array, Array]:
    """Return the equivalent inertia B of a coordinate, and its derivative, in balls.

    B is twice the kinetic energy at unit rate of the coordinate: the sum of w_j . I_j w_j
    over all links j with mass. Here w_j is the angular velocity at unit rate, and I_j the
    inertia tensor about the centre of the sphere. The derivative of B is twice the sum of
    w_j' . I_j w_j. The rotation of I_j adds only terms w_j . (w_j x I_j w_j), which are
    zero. A ball is a number with a bound of its error.

    Parameters
    ----------
    mechanism
        The mechanism with its inertia tensors in link axes (kg m2).
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes.
    w
        (n, links, 3) angular velocities in ground axes at unit rate of the coordinate.
    dw
        (n, links, 3) their derivatives with respect to the coordinate.

    Returns
    -------
    B, dB
        (n,) balls each, kg m2 and kg m2/rad.
    """
    B = exact_balls(np.zeros(len(w)))
    dB = exact_balls(np.zeros(len(w)))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        rotation = rotations[:, link]
        w_column = w[:, link, :, None]
        tensor = exact_balls(mass.tensor)
        # I_j w_j in ground axes: rotate to link axes, multiply, and rotate back.
        momentum = rotation @ (tensor @ (rotation.swapaxes(1, 2) @ w_column))
        B = B + np.sum(w_column * momentum, axis=(1, 2))
        dB = dB + 2 * np.sum(dw[:, link, :, None] * momentum, axis=(1, 2))
    return B, dB


def interpolate_table(table: TorqueTable, t: Array, time_inside: float) -> Array:
    """Return the torque of a table, continued along one of its straight lines.

    The table is piecewise linear in time, with a kink at each listed time. For smooth
    results, the line that is valid at `time_inside` is used for all times. A table may be
    periodic, that is, repeat its listed times. Balls are numbers with a bound of their
    error.

    Parameters
    ----------
    table
        Times (s) and torques (N m).
    t
        (n,) balls of times (s).
    time_inside
        A time (s) between two neighbouring kinks. It selects the line.

    Returns
    -------
    (n,) balls of torques (N m).
    """
    times = exact_balls(table.times)
    torques = exact_balls(table.torques)
    # In a periodic table the line is one of the first period, shifted by whole periods.
    period = times[-1] - times[0]
    if table.periodic:
        periods_passed = np.floor((time_inside - table.times[0]) / float(period))
    else:
        periods_passed = 0
    time_in_first_period = time_inside - periods_passed * float(period)
    # The line leads from one listed time to the next: `start` and `end` are the indices of
    # the two times. Before all times the first line holds, after all times the last.
    start = np.searchsorted(table.times[1:-1], time_in_first_period)
    end = start + 1
    slope = (torques[end] - torques[start]) / (times[end] - times[start])
    time_on_line = t - periods_passed * period - times[start]
    return torques[start] + slope * time_on_line
