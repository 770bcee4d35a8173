"""The configuration in which a mechanism goes to a program that wants a pose."""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.configurations_at_inputs import compute_modes_at_inputs
from spherekit.errors import SolveError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.angle_unwrapping import unwrap_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.wording import counted, listing

SAMPLES = 61
"""Places on the way through the inputs' ranges where a configuration is looked for."""


def posed(
    mechanism: Mechanism,
    assembly_mode: int = 0,
    at: float | Sequence[float] | None = None,
) -> tuple[Mechanism, Floats]:
    """Return a mechanism with its inputs declared, and one configuration (variables,).

    Parameters
    ----------
    at
        The inputs (rad), by default the first sample on the way through their ranges at
        which the assembly mode exists.

    Raises
    ------
    SolveError
        If there are not as many inputs as given, or the mode does not exist there.
    """
    if at is None:
        tracer = PositionAnalysis(mechanism, None, assembly_mode, samples=SAMPLES)
        motion = tracer.motion()
        where = f"any of {len(motion)} samples of the inputs' ranges"
        other = "inputs, or another assembly mode"
    else:
        q = np.array(at, dtype=float, ndmin=1)
        if not all_finite(q):
            raise SolveError(f"export: at is {at}, it has to be finite numbers of rad")
        mechanism = PositionAnalysis(mechanism, follow=False).mechanism
        inputs = mechanism.input_pairs
        if len(q) != len(inputs):
            raise SolveError(
                f"{mechanism.name}: at has {counted(len(q), 'value')}, but the inputs are "
                f"{listing(inputs)}: give one value for each"
            )
        tracer, motion = compute_modes_at_inputs(mechanism, q[None], assembly_mode)
        where = listing(
            f"{pair} = {value:.6g} rad ({np.degrees(value):.6g} deg)"
            for pair, value in zip(inputs, q, strict=True)
        )
        other = "another input to be at"
    good = np.flatnonzero(~motion.failed)
    if not len(good):
        raise SolveError(
            f"{mechanism.name}: assembly mode {assembly_mode} has no configuration at "
            f"{where}; give {other}"
        )
    return tracer.mechanism, unwrap_motion(motion, tracer.angle_unwrapping).values[good[0]]
