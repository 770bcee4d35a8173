"""The configuration of a mechanism for programs that need a pose, such as MuJoCo."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.configurations_at_inputs import compute_modes_at_inputs
from spherekit.errors import SolveError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.angle_unwrapping import unwrap_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.wording import counted, listing, numbered

POSE_SEARCH_SAMPLES = 61
"""Samples on the path through the ranges of the inputs among which a pose is searched.

Fewer: a mode that exists in a short range only is not found; more: the search takes longer.
"""


class ExportedPose(NamedTuple):
    """A mechanism, and one of its configurations: the variables of all pairs.

    Attributes
    ----------
    mechanism
        The mechanism.
    values
        (variables,) the pair variables (joint angles, rad) of the configuration.
    """

    mechanism: Mechanism
    values: Floats


def find_pose(
    mechanism: Mechanism,
    assembly_mode: int = 0,
    inputs: float | Sequence[float] | None = None,
) -> ExportedPose:
    """Return a mechanism and one of its configurations in an assembly mode.

    An exported model starts in this configuration. An assembly mode is one of the ways to
    assemble the links at the same inputs.

    Parameters
    ----------
    mechanism
        The mechanism.
    assembly_mode
        Number of the assembly mode.
    inputs
        The inputs (rad). By default the inputs of the first sample on the path through
        their ranges at which the assembly mode exists.

    Raises
    ------
    SolveError
        If the number of inputs is wrong, or the mode does not exist at these inputs.
    """
    # Compute the assembly mode at samples of the input ranges, or at the given inputs. The
    # texts `searched` and `advice` are for the message if there is no configuration.
    if inputs is None:
        position_analysis = PositionAnalysis(
            mechanism, None, assembly_mode, samples=POSE_SEARCH_SAMPLES
        )
        motion = position_analysis.motion()
        searched = f"any of {len(motion)} samples of the inputs' ranges"
        advice = "inputs, or another assembly mode"
    else:
        input_values = np.array(inputs, dtype=float, ndmin=1)
        if not all_finite(input_values):
            raise SolveError(f"export: at: found {inputs}, expected finite numbers in rad")
        # Raise an error if the mobility of the mechanism is not its number of inputs. The
        # analysis is made for this check only.
        PositionAnalysis(mechanism, follow=False)
        input_pairs = mechanism.input_pairs
        if len(input_values) != len(input_pairs):
            raise SolveError(
                f"{mechanism.name}: at: has {counted(len(input_values), 'value')}, but the "
                f"mechanism has {counted(len(input_pairs), 'input')} "
                f"({numbered('pair', input_pairs)}); give one value for each input"
            )
        position_analysis, motion = compute_modes_at_inputs(
            mechanism, input_values[None], assembly_mode
        )
        searched = listing(
            f"{pair} = {value:.6g} rad ({np.degrees(value):.6g} deg)"
            for pair, value in zip(input_pairs, input_values, strict=True)
        )
        advice = "another input with the argument at"
    good_rows = np.flatnonzero(~motion.failed)  # rows with a configuration
    if not len(good_rows):
        raise SolveError(
            f"{mechanism.name}: assembly mode {assembly_mode} has no configuration at "
            f"{searched}; give {advice}"
        )
    # Angles beyond one turn are counted along the motion, not wrapped.
    continuous_motion = unwrap_motion(motion, position_analysis.angle_unwrapping)
    return ExportedPose(position_analysis.mechanism, continuous_motion.values[good_rows[0]])
