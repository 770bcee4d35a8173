"""Configurations of assembly modes at input angles with any number of whole turns.

A position analysis covers the range of its input. Angles outside of this range are shifted
into it by whole turns. If gear wheels make the configuration depend on the number of turns,
angles are shifted only by periods, after which all links are in the same position again. If
this is not enough, a position analysis over a longer range is made.
"""

from dataclasses import replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.input_revolutions import into_range as shift_by_periods
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis


def wrap_to_pi(angles: Floats) -> Floats:
    """Return angles (rad) reduced by whole turns to -pi ... pi, to the last digit."""
    # Sine and cosine reduce large angles by more digits of pi than a float64 has.
    wrapped = np.arctan2(np.sin(angles), np.cos(angles))
    return np.where(np.abs(angles) <= np.pi, angles, wrapped)


def count_whole_turns(angles: Floats) -> Floats:
    """Return the number of whole turns by which angles (rad) exceed the wrapped ones."""
    return np.round((angles - wrap_to_pi(angles)) / TURN)


def shift_into_range(position_analysis: PositionAnalysis, q: Floats) -> Floats:
    """Return input angles shifted by whole periods into the range of the input.

    Configurations are computed in this range only. A period is the growth of the input
    after which all links are in the same position again. If the range is shorter than a
    period, angles are shifted as close to the range as possible.

    Parameters
    ----------
    position_analysis
        A position analysis of a mechanism with one input; it has the range and the period.
    q
        (n,) angles of the input, rad.
    """
    low, high = position_analysis.range
    (period,) = position_analysis.solver.periods
    # With an infinite period the position never repeats, so angles cannot be shifted.
    if not np.isfinite(period):
        return q
    # Reduce the angles to -period / 2 ... period / 2. Division by `scale` makes a period
    # one turn, because `wrap_to_pi` subtracts whole turns without loss of digits.
    scale = period / TURN
    wrapped = scale * wrap_to_pi(q / scale)
    shifted = shift_by_periods(wrapped, low, high, period)
    # Angles within the range do not change, not even by rounding.
    return np.where((q >= low) & (q <= high), q, shifted)


def analysis_covering(
    position_analysis: PositionAnalysis,
    q: Floats,
    assembly_mode: int | None = None,
    search: bool = True,
) -> PositionAnalysis:
    """Return a position analysis over a range that contains the input angles q.

    In most mechanisms the configuration does not depend on the number of turns of the
    input. The present analysis is then returned.

    Meshing gear wheels can make the configuration depend on the number of turns. Angles are
    then shifted by whole periods (the turns after which all links are in the same position
    again). If angles remain outside of the range, a new analysis over a longer range is
    returned.

    Parameters
    ----------
    position_analysis
        A position analysis of a mechanism with one input.
    q
        (n,) angles of the input, rad.
    assembly_mode
        The assembly mode (way to assemble the mechanism) that a new analysis computes, or
        None for all of them.
    search
        Whether a new analysis searches for modes other than the mode of the reference pose.
    """
    has_gear_meshes = position_analysis.solver.gear_phases is not None
    if not has_gear_meshes:
        return position_analysis
    # The smallest range that contains the present range and all shifted inputs.
    angles = np.append(shift_into_range(position_analysis, q), position_analysis.range)
    covering_range = np.array([np.min(angles), np.max(angles)])
    if np.array_equal(covering_range, position_analysis.range):
        return position_analysis
    return PositionAnalysis(
        position_analysis.mechanism,
        input_pair=None,  # the input of the mechanism itself
        assembly_mode=assembly_mode,
        search=search,
        # An analysis covers the range of its samples, here the two ends of the range.
        path=covering_range,
        crossings=position_analysis.crossings,
    )


def compute_modes_at_inputs(
    mechanism_or_analysis: Mechanism | PositionAnalysis,
    q: Floats,
    assembly_mode: int | None = None,
    search: bool = True,
) -> tuple[PositionAnalysis, Motion]:
    """Return the configurations of one or all assembly modes at the inputs q.

    An assembly mode is one of the ways to assemble the mechanism at the same inputs. With
    one input, modes are computed by a position analysis over the range of the input.

    Parameters
    ----------
    mechanism_or_analysis
        A mechanism, or with one input its position analysis over the range of the input.
    q
        (n, inputs) angles of the inputs with any number of whole turns, rad.
    assembly_mode
        The assembly mode to compute, or None for all of them. A position analysis that is
        passed, and has a sufficient range, keeps its own modes.
    search
        Whether modes other than the mode of the reference pose are searched for, if a
        position analysis has to be made.

    Returns
    -------
    The position analysis, and the motion. The rows of the motion are the configurations at
    all n inputs in the first mode, then those in the second mode, and so on.
    """
    if q.shape[1] > 1:
        assert isinstance(mechanism_or_analysis, Mechanism)
        # The n inputs are the samples of a path, along which the modes are followed.
        position_analysis = PositionAnalysis(
            mechanism_or_analysis,
            input_pair=None,  # the inputs of the mechanism
            assembly_mode=assembly_mode,
            search=search,
            path=q,
        )
        return position_analysis, position_analysis.motion()
    if isinstance(mechanism_or_analysis, Mechanism):
        position_analysis = PositionAnalysis(
            mechanism_or_analysis,
            input_pair=None,
            assembly_mode=assembly_mode,
            search=search,
        )
    else:
        position_analysis = mechanism_or_analysis
    # The range is extended if configurations depend on the number of turns of the input.
    position_analysis = analysis_covering(position_analysis, q[:, 0], assembly_mode, search)
    # Configurations are computed at shifted inputs, but returned with the inputs q.
    motion = position_analysis.at(shift_into_range(position_analysis, q))
    mode_count = len(position_analysis.assembly_modes)
    return position_analysis, replace(motion, inputs=np.tile(q, (mode_count, 1)))
