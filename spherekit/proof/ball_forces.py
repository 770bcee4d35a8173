"""Inertia and forces of loads in balls, with switches where loads have kinks.

What a load is made of is said in `spherekit.mechanism.load_kinds`. An expression that is
not smooth is continued beyond its kinks: each `abs`, `sign`, `min` and `max` depends on the
sign of a condition, which is held on the side it is said to be on.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.mechanism import Mechanism
from spherekit.proof.ball_frames import exactly
from spherekit.proof.reference_rows import ExactRows

Sides = Floats | None
"""The sides (switches,) +1 or -1 of all conditions; None takes those they are on."""


@dataclass(frozen=True)
class Moving:
    """A mechanism in motion at n rows, by a coordinate of its own.

    `values` (n, variables) rad, whole turns included; `rates` (n, variables) and `w`
    (n, links, 3), in ground axes, per unit rate of the coordinate; `rotations`
    (n, links, 3, 3).
    """

    values: Array
    rates: Array
    w: Array
    rotations: Array


def exact_inertia(exact: ExactRows) -> tuple[Array, Array]:
    """Return the equivalent inertia B (n,), kg m2, and its derivative by the input (n,).

    Twice the kinetic energy per squared rate of the input that moves (Di Gregorio 2024,
    eqs. (14), (15)). Inertia tensors are taken as the float64 numbers they are given by.

    Raises
    ------
    ValueError
        If the rows were made with order 1, without derivatives.
    """
    with exact.arithmetic.within():
        return inertia(exact.mechanism, exact.rotations, exact.w, exact.slopes)


def inertia(
    mechanism: Mechanism, rotations: Array, w: Array, dw: Array
) -> tuple[Array, Array]:
    """Return B (n,) of a coordinate and its derivative by it, see `exact_inertia`.

    From orientations (n, links, 3, 3), angular velocities (n, links, 3) per unit rate of
    the coordinate, and their derivatives by it.
    """
    B = dB = exactly(np.zeros(len(w)))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn, turning = rotations[:, link], w[:, link, :, None]
        momentum = turn @ (exactly(mass.tensor) @ (turn.swapaxes(1, 2) @ turning))
        B = B + np.sum(turning * momentum, axis=(1, 2))
        dB = dB + 2 * np.sum(dw[:, link, :, None] * momentum, axis=(1, 2))
    return B, dB


def _of_table(table: TorqueTable, t: Array, inside: float) -> Array:
    """Return a table's torque along the line that it has at the time `inside`."""
    times, torques = exactly(table.times), exactly(table.torques)
    period = times[-1] - times[0]
    passed = np.floor((inside - table.times[0]) / float(period))
    turn = passed if table.periodic else 0
    k = 1 + np.searchsorted(table.times[1:-1], inside - turn * float(period))
    slope = (torques[k] - torques[k - 1]) / (times[k] - times[k - 1])
    return torques[k - 1] + slope * (t - turn * period - times[k - 1])
