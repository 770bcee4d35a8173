"""Configurations of assembly modes at input angles with any number of whole turns.

A position analysis covers the range of its input. Angles outside are shifted into it by
whole turns. If a gear pair makes the configuration depend on the number of turns, only
periods of the whole mechanism are taken off, or a position analysis over a longer range is
made.
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
    """Return angles (rad) less whole turns, between -pi and pi, to the last digit."""
    # Sine and cosine reduce large angles by more digits of pi than a float64 has.
    wrapped = np.arctan2(np.sin(angles), np.cos(angles))
    return np.where(np.abs(angles) <= np.pi, angles, wrapped)


def count_whole_turns(angles: Floats) -> Floats:
    """Return the number of whole turns by which angles (rad) exceed the wrapped ones."""
    return np.round((angles - wrap_to_pi(angles)) / TURN)


def shift_into_range(position_analysis: PositionAnalysis, q: Floats) -> Floats:
    """Return input angles shifted by whole turns into the range of the input.

    If the range is shorter than a turn, the angles are shifted as near to it as possible.
    Gear wheels can make the configuration depend on the number of turns of the input. The
    shift is then a multiple of the period after which all links are in the same position
    again. Without such a period the angles are not changed.

    Parameters
    ----------
    position_analysis
        A position analysis of a mechanism with one input.
    q
        (n,) angles of the input, rad.
    """
    low, high = position_analysis.range
    (period,) = position_analysis.solver.periods
    if not np.isfinite(period):
        return q
    # Scaled so that a period becomes a turn: then no digits are lost.
    scale = period / TURN
    shifted = shift_by_periods(scale * wrap_to_pi(q / scale), low, high, period)
    return np.where((q >= low) & (q <= high), q, shifted)


def analysis_covering(
    position_analysis: PositionAnalysis,
    q: Floats,
    assembly_mode: int | None = None,
    search: bool = True,
) -> PositionAnalysis:
    """Return a position analysis over a range that contains given input angles.

    The given analysis is returned if the angles, shifted by whole periods, are in its
    range, or if the configuration does not depend on the number of turns of the input. A
    new one is made only for gear wheels, which can make it depend on this number.

    Parameters
    ----------
    position_analysis
        A position analysis of a mechanism with one input.
    q
        (n,) angles of the input, rad.
    assembly_mode, search
        Arguments of a new `PositionAnalysis`: the assembly mode to compute, or None for
        all of them, and whether all modes are searched for.
    """
    # The smallest range that contains the present range and all shifted inputs.
    angles = np.append(shift_into_range(position_analysis, q), position_analysis.range)
    path = np.array([np.min(angles), np.max(angles)])
    has_meshes = position_analysis.solver.gear_phases is not None
    if not has_meshes or np.array_equal(path, position_analysis.range):
        return position_analysis
    return PositionAnalysis(
        position_analysis.mechanism,
        input_pair=None,
        assembly_mode=assembly_mode,
        search=search,
        path=path,
        crossings=position_analysis.crossings,
    )


def compute_modes_at_inputs(
    mechanism_or_analysis: Mechanism | PositionAnalysis,
    q: Floats,
    assembly_mode: int | None = None,
    search: bool = True,
) -> tuple[PositionAnalysis, Motion]:
    """Return all assembly modes, or one, at given inputs, and their position analysis.

    Parameters
    ----------
    mechanism_or_analysis
        A mechanism, or with one input its position analysis over the range of the input.
    q
        (n, inputs) angles of the inputs with any number of whole turns, rad.
    assembly_mode, search
        The assembly mode to compute, or None for all of them, and whether all modes are
        searched for.

    Returns
    -------
    The position analysis, and the motion: the inputs `q` in each mode, mode after mode.
    """
    if q.shape[1] > 1:
        assert isinstance(mechanism_or_analysis, Mechanism)
        # Each row of inputs is a sample.
        position_analysis = PositionAnalysis(
            mechanism_or_analysis,
            input_pair=None,
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
    position_analysis = analysis_covering(position_analysis, q[:, 0], assembly_mode, search)
    # Computed within the range, and returned with the inputs as they were given.
    motion = position_analysis.at(shift_into_range(position_analysis, q))
    mode_count = len(position_analysis.assembly_modes)
    return position_analysis, replace(motion, inputs=np.tile(q, (mode_count, 1)))
