"""Motions by polynomial laws, and inputs at which shipped mechanisms close."""

from dataclasses import replace

import numpy as np

from spherekit.files.time_law import Polynomial
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.timing import evaluate_time_laws

START_INPUTS = {
    "two_dof_spm": (0.3, 0.35),
    "three_rrr": (0.9, 1.0, 1.2),
    "five_bar": (1.0, 1.2),
    "bevel_differential": (0.5, 0.4),
    "double_butterfly": (0.05,),
    **dict.fromkeys(("stephenson", "shaped_flat_cam", "roller_cam"), (0.4,)),
    **dict.fromkeys(("four_bar", "planetary_bevel"), (0.4,)),
}
"""Inputs (rad) of shipped mechanisms, from which they move some tenths of a second."""


def motion_by_polynomial_laws(mechanism, starts, t, rate=0.3, quadratic=0.2):
    """Return a motion in which each input follows a quadratic law of time.

    The law of input k is start + (-1)^k rate t + quadratic t^2. The motion is in assembly
    mode 0 (one way to assemble the links).

    Parameters
    ----------
    mechanism
        Mechanism with one or several inputs.
    starts
        Value of each input at t = 0, rad.
    t
        Times of the rows, s.
    rate
        Rate of the first input at t = 0, rad/s; the rates of the others alternate in sign.
    quadratic
        Factor of t^2 in the law of every input, which is half its acceleration, rad/s^2.
    """
    laws = {}
    for k, (item, start) in enumerate(zip(mechanism.inputs, starts, strict=True)):
        laws[item.pair] = Polynomial((start, rate * (-1) ** k, quadratic))
    times = np.asarray(t, dtype=float)
    input_values, timing = evaluate_time_laws(list(laws), laws, times)
    position_analysis = PositionAnalysis(
        mechanism, assembly_mode=0, search=False, path=input_values
    )
    motion = position_analysis.motion()
    return replace(motion, timing=timing)
