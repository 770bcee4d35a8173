"""Angles of passive pairs that loads see, in formulas without an argument for whole turns.

A load such as a spring follows the angle of its pair over any number of turns. Formulas in
closed form give that angle in (-pi, pi] only, so in general whole turns are an argument. A
pair that swings over less than one turn in all assembly modes together needs no such
argument: its angle is the value nearest to the middle of its swing.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from spherekit.conventions import TURN
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.angle_unwrapping import continue_angles
from spherekit.positions.motion import Motion
from spherekit.positions.motion_cache import kinematics_only
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, function

SWING_SAMPLES = 721
"""Number of inputs over one turn at which the swing of a pair is evaluated.

Fewer: a swing that is widest between samples is measured too small.
"""

BISECTIONS = 30
"""Number of bisections between two samples at the end of an assembly mode.

The angles of pairs change fast near such an end, where the input is at a dead centre.
Fewer: the swing is measured too small; more: the last bisections change nothing.
"""

LEAST_GAP_RAD = 0.05
"""Smallest part (rad) of a turn that a pair leaves out, if it cannot turn fully.

Larger: pairs that nearly turn fully keep their argument; smaller: an angle at one end of a
swing, between samples, could be taken for one at the other end.
"""


def find_swing_middles(mechanism: Mechanism, pairs: Sequence[str]) -> Mapping[str, float]:
    """Return the middle (rad) of the swing of pairs that cannot turn fully, by name.

    Loads such as springs depend on the angle with all whole turns, but formulas compute
    angles only up to whole turns. If a pair (joint) swings over less than a turn, the
    actual angle is the value nearest to the middle of the swing. The swing is the range of
    the angle in all assembly modes (ways to assemble the mechanism) together, over a whole
    turn of the input. The swing must be less than a turn by `LEAST_GAP_RAD`, because the
    angle is known at samples only.

    The result is empty if the mechanism has several inputs or contacts.

    Parameters
    ----------
    mechanism
        The mechanism, driven at its inputs.
    pairs
        Names of R pairs (revolute joints) that are not driven.
    """
    inputs = mechanism.input_pairs
    # With several inputs, angles depend on the path. With contacts, wheels may return only
    # after several turns.
    if len(inputs) != 1 or mechanism.has_contacts or not pairs:
        return {}
    # A whole turn covers every possible range of the input. `kinematics_only` removes
    # masses and loads, which positions do not depend on.
    one_turn = mechanism.with_inputs(
        *inputs, ranges={inputs[0]: (0.0, TURN)}, angle_unit="rad"
    )
    position_analysis = PositionAnalysis(kinematics_only(one_turn), samples=SWING_SAMPLES)
    motion = position_analysis.motion()
    # (n,) angles of each pair without jumps of whole turns, at the samples and at the ends
    # of modes. The last argument, the angles of earlier samples, is empty.
    angles_by_motion = [
        continue_angles(rows, pairs, position_analysis.angle_unwrapping, {})
        for rows in (motion, _find_ends_of_modes(position_analysis, motion))
    ]
    middles: dict[str, float] = {}
    for pair in pairs:
        angles = np.concatenate([part[pair] for part in angles_by_motion])
        low = np.nanmin(angles)
        high = np.nanmax(angles)
        if high - low < TURN - LEAST_GAP_RAD:
            middles[pair] = float(0.5 * (low + high))
    return middles


def _find_ends_of_modes(position_analysis: PositionAnalysis, motion: Motion) -> Motion:
    """Return the motion at the inputs at which assembly modes begin or end.

    The angle of a pair changes fast near such an input. Without its value there, the range
    of the angle would be measured too small.

    An assembly mode begins or ends between two samples if it has a configuration at only
    one of them. The end is found by bisection, and approached from the side with
    configurations. If no mode begins or ends, the result is the motion at the first sample.

    Parameters
    ----------
    position_analysis
        The analysis of a mechanism with one input.
    motion
        Its motion at all samples, one mode after the other.
    """
    inputs = motion.inputs[: motion.samples, 0]
    has_configuration = all_finite(motion.values, 1).reshape(-1, motion.samples)
    modes, samples = np.nonzero(has_configuration[:, 1:] != has_configuration[:, :-1])
    begins = has_configuration[modes, samples + 1]
    if not len(modes):
        return position_analysis.at(inputs[:1])
    # Each end is between an input inside the mode and an input outside it. Where the mode
    # begins, the later sample (index + 1) is inside. Where it ends, the earlier one is.
    inside = inputs[samples + begins]
    outside = inputs[samples + ~begins]
    ends = np.arange(len(modes))
    for _ in range(BISECTIONS):
        middle = 0.5 * (inside + outside)
        values = position_analysis.at(middle).values
        is_inside = all_finite(values, 1).reshape(-1, len(middle))[modes, ends]
        inside = np.where(is_inside, middle, inside)
        outside = np.where(is_inside, outside, middle)
    return position_analysis.at(inside)


def revolutions_about(angle: Expr, middle: float) -> ExpressionNode:
    """Return the multiple of 2 pi to add to an angle so that it is nearest to a middle.

    With the difference d = angle - middle, atan2(sin d, cos d) is d reduced to (-pi, pi].
    The angle nearest to the middle is middle + atan2(sin d, cos d). The difference between
    this angle and the original angle is a multiple of 2 pi.

    Parameters
    ----------
    angle
        The angle (rad), known up to whole turns.
    middle
        The middle (rad) of the range in which the angle of the pair swings.
    """
    difference = angle - middle
    reduced_difference = function(
        "atan2", function("sin", difference), function("cos", difference)
    )
    return reduced_difference + (middle - angle)
