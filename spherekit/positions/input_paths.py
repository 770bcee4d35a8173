"""Follows configurations while the inputs move along straight lines, by verified steps.

The corrections and the directions of the steps are tested as
`spherekit.positions.verified_steps` describes. In addition the closure Jacobian with locked
inputs must not become nearly singular, and its determinant must keep its sign. A path
therefore does not pass a configuration at which the inputs do not determine the motion.
With redundant constraints there is no determinant, and a step can pass one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.geometry.vectors import all_finite, max_abs, unit_rows
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.curve_limits import CurveLimits
from spherekit.positions.linear_equations import condition_numbers, left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.verified_steps import Verification, extrapolate
from spherekit.status import Status
from spherekit.tolerances import (
    CLOSURE_TOLERANCE,
    END_AT_EQUAL_CURVATURE,
    END_AT_PROFILE_END_RAD,
    END_AT_SINGULARITY_CONDITION,
)

LARGEST_INPUT_STEP_RAD = 0.2
"""Longest step of the inputs.

Larger: fewer steps, of which more fail. Smaller: more steps.
"""
AIMED_SECOND_ORDER_RAD = 0.02
"""The step length aims at this second-order part of the Taylor polynomial in a step.

Larger: more steps fail. Smaller: more steps are necessary.
"""
SLOPE_TO_BEND_RATIO = 0.3
"""Longest step, relative to the ratio of first to second derivative of the variables.

Near a dead centre a variable grows like the square root of the remaining input, and this
ratio is twice the remaining input. The step is then 0.6 of it.
"""
INPUT_STEP_TESTS = Verification(correction=0.1, slack=1e-9, settled=1e-6, turn=0.95)
"""Limits for the tests of a step."""
LARGEST_PREDICTED_MOVE_RAD = 0.5
"""The error of a prediction is compared with the predicted move, but at most with this.

Larger: more steps near dead centres are accepted, perhaps on another path.
"""
MAX_TRIED_STEPS = 20000
"""Largest number of tried steps of one path. After so many steps the mode is lost."""
SMALLEST_INPUT_STEP_RAD = 4e-13
"""If not even a step of about this length is verified, the path ends.

Larger: paths end farther from dead centres. Smaller: steps are rounding errors of the
inputs.
"""
SMALLEST_PATH_CONDITION = 1e-8
"""Reciprocal condition of the closure Jacobian with locked inputs at which no step ends.

Near a crossing of curves, rounding errors can lead from one curve to another. Larger: paths
end farther from dead centres. Smaller: paths can pass a crossing.
"""

ARRIVAL_TOLERANCE = 1e-9
"""A step is extended to the goal if the remaining way, relative to the step, is smaller."""
MAX_CORRECTION_ITERATIONS = 6
"""Largest number of Newton steps from a prediction. Smaller: more path steps fail."""


@dataclass(frozen=True)
class InputPathNodes(ArrayRows):
    """n closed configurations with derivatives while the inputs move along straight lines.

    The derivatives serve to predict the next configuration.

    Attributes
    ----------
    direction
        (n, inputs) unit vectors along which the inputs move.
    values
        (n, variables) pair variables (rad).
    slope, bend
        (n, variables) first and second derivatives of the variables with respect to the
        distance that the inputs move.
    sign
        (n,) sign of the determinant of the closure Jacobian with locked inputs. It changes
        only at singular configurations, so a step that changes it is rejected.
    """

    direction: Floats
    values: Floats
    slope: Floats
    bend: Floats
    sign: Floats


def nodes_at(
    linearisation: Linearisation, driven: Sequence[int], direction: Floats
) -> InputPathNodes:
    """Return closed configurations with their derivatives as the inputs move.

    From the result, the configurations after a step of the inputs are predicted.

    With all variables v and the closure Jacobian J, the derivatives with respect to the
    distance that the inputs move satisfy J v' = 0 and J v'' + bias = 0. The bias is the
    part of the second derivative of the closure that is quadratic in v'.

    Parameters
    ----------
    linearisation
        The closure linearised at n closed configurations.
    driven
        Indices of the variables of the inputs.
    direction
        (n, inputs) unit vectors along which the inputs move.
    """
    passive = np.delete(np.arange(linearisation.values.shape[1]), driven)
    passive_jacobian = linearisation.jacobian[:, :, passive]
    # With redundant constraints there are more equations than passive variables.
    inverse = left_inverse(passive_jacobian)
    slope = np.zeros_like(linearisation.values)
    bend = slope.copy()
    slope[:, driven] = direction
    # The inputs open the loops at this rate, and the passive variables close them.
    opening_rate = np.einsum("nij,nj->ni", linearisation.jacobian, slope)
    slope[:, passive] = -np.einsum("nij,nj->ni", inverse, opening_rate)
    bend[:, passive] = -np.einsum("nij,nj->ni", inverse, linearisation.bias(slope))
    # The sign of the determinant changes only at singular configurations. It tells later
    # whether a step has passed one.
    return InputPathNodes(
        direction=direction,
        values=linearisation.values,
        slope=slope,
        bend=bend,
        sign=determinant_sign(passive_jacobian),
    )


def determinant_sign(matrices: Floats) -> Floats:
    """Return the signs (n,) of the determinants of matrices (n, rows, columns).

    The sign changes where a path of configurations passes a singularity. The sign is NaN
    for matrices that are NaN. Matrices that are not square have no determinant and get 1.
    """
    if matrices.shape[1] != matrices.shape[2]:
        return np.ones(len(matrices))
    with np.errstate(invalid="ignore"):
        return np.linalg.slogdet(matrices)[0]


def is_nearly_singular(
    linearisation: Linearisation, driven: Sequence[int], ratio: float
) -> Bools:
    """Return a mask (n,) of configurations with a nearly singular closure Jacobian.

    The Jacobian is the one with locked inputs. If it is nearly singular, the inputs hardly
    determine the configuration.

    Parameters
    ----------
    linearisation
        The closure at n configurations.
    driven
        Indices of the variables of the inputs.
    ratio
        The Jacobian is nearly singular if the ratio of its smallest to its largest singular
        value is at most this number.
    """
    passive_jacobian = np.delete(linearisation.jacobian, driven, axis=2)
    # The negated comparison is also true for NaN.
    return ~(condition_numbers(passive_jacobian) < 1.0 / ratio)


@dataclass(frozen=True)
class _InputSteps:
    """The results of one step on each of k paths.

    A path is a sequence of closed configurations while the inputs move straight to a goal.

    Attributes
    ----------
    nodes
        The configurations at which the steps end.
    is_verified
        (k,) whether the step passed all tests that it has not left its path (`_try_steps`).
    is_last
        (k,) whether the step leads exactly to the goal of the path.
    """

    nodes: InputPathNodes
    is_verified: Bools
    is_last: Bools


def _try_steps(
    closure: Closure,
    driven: Sequence[int],
    nodes: InputPathNodes,
    steps: Floats,
    q: Floats,
) -> _InputSteps:
    """Try one step on each of k paths.

    A step is a prediction by Taylor's formula and a correction by Newton's method. A step
    is verified if it passed these tests, which show that it has not left its path:

    - The correction is small compared with the predicted move, and converges.
    - The Jacobian with locked inputs is regular, and its determinant keeps its sign.
    - Contacts stay within their profiles.
    - The direction of motion turns little.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    driven
        Indices of the variables of the inputs.
    nodes
        (k) nodes from which the steps start.
    steps
        (k,) lengths of the steps (rad). A step that would pass the goal is shortened.
    q
        (k, inputs) goals of the inputs (rad).

    Returns
    -------
    The ends of the steps, and which steps passed all tests.
    """
    inputs = nodes.values[:, driven]
    # The remaining distance to the goal limits the step.
    rest = np.vecdot(q - inputs, nodes.direction)
    is_last = steps >= rest * (1 - ARRIVAL_TOLERANCE)
    lengths = np.where(is_last, rest, steps)[:, None]
    # Predict by the first two derivatives, and correct by Newton's method with the inputs
    # locked.
    prediction = extrapolate(nodes.values, nodes.slope, nodes.bend, lengths)
    # At the goal the inputs are exact, without rounding errors of the steps.
    prediction[:, driven] = np.where(
        is_last[:, None], q, inputs + lengths * nodes.direction
    )
    # At a dead centre a slope is infinite, and so is the prediction. Newton's method then
    # starts from the node, and the step is not verified.
    is_finite = all_finite(prediction, 1)
    prediction[~is_finite] = nodes.values[~is_finite]
    linearisation, newton_steps = closure.solve_and_report_steps(
        prediction, driven, max_steps=MAX_CORRECTION_ITERATIONS
    )
    # The loops are closed, and the corrections were small compared with the predicted move
    # and converged.
    is_verified = is_finite & (linearisation.closure_residual < CLOSURE_TOLERANCE)
    predicted_move = max_abs(prediction - nodes.values, axis=1)
    # After a correction that is large compared with the move, the step may be on another
    # path. Long moves count only up to a limited length.
    limited_move = np.minimum(LARGEST_PREDICTED_MOVE_RAD, predicted_move)
    is_verified &= INPUT_STEP_TESTS.accepts_correction(newton_steps, limited_move)
    # The Jacobian with locked inputs is regular, and its determinant keeps its sign.
    is_verified &= ~is_nearly_singular(linearisation, driven, SMALLEST_PATH_CONDITION)
    new_nodes = nodes_at(linearisation, driven, nodes.direction)
    is_verified &= (new_nodes.sign == nodes.sign) & all_finite(new_nodes.slope, 1)
    # Contacts stay within their profiles.
    is_verified &= np.all(linearisation.states.inside, axis=1)
    # The direction in the space of all variables turns little.
    cosine = np.vecdot(unit_rows(nodes.slope), unit_rows(new_nodes.slope))
    is_verified = is_verified & (cosine > INPUT_STEP_TESTS.turn)
    return _InputSteps(new_nodes, is_verified, is_last)


def _limit_steps(nodes: InputPathNodes, steps: Floats, smallest_step: float) -> Floats:
    """Return steps (n,) of inputs (rad), shortened so that predictions stay accurate.

    A step is predicted by Taylor's formula from a node (point of a path). The larger the
    second derivative (`bend`) at the node, the shorter is the step. `steps` (n,) are the
    lengths (rad) before shortening. No result is smaller than `smallest_step` (rad).
    """
    bend = max_abs(nodes.bend, axis=1) + 1e-300  # The tiny number avoids a division by 0.
    steps = np.minimum(steps, LARGEST_INPUT_STEP_RAD)
    steps = np.minimum(steps, np.sqrt(2 * AIMED_SECOND_ORDER_RAD / bend))
    steps = np.minimum(steps, SLOPE_TO_BEND_RATIO * max_abs(nodes.slope, axis=1) / bend)
    return np.fmax(steps, smallest_step)


def _explain_end(closure: Closure, driven: Sequence[int], values: Floats) -> Status:
    """Return why a path ends at its last configuration, as the status of samples beyond it.

    A path is a sequence of configurations while the inputs move to a goal.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    driven
        Indices of the variables of the inputs.
    values
        (1, variables) the last configuration (rad).

    Returns
    -------
    OFF_PROFILE near the end of a profile of a contact, CURVATURE where both profiles of a
    contact have nearly the same curvature, OUT_OF_REACH near a dead centre, otherwise
    MODE_LOST.
    """
    linearisation = closure.linearise(values)
    states = linearisation.states
    # The limits of the contacts.
    limits = CurveLimits.of_mechanism(closure, stops={})
    margins, _ = limits.margins(values, states.curvatures, states.curvature_rates)
    # A margin is the distance from a limit: a difference of curvatures, or an arc length
    # (rad) to the end of a profile. The reverse order examines curvatures first.
    for status, margin in zip(reversed(limits.statuses), reversed(margins[0]), strict=True):
        end_margin = END_AT_PROFILE_END_RAD
        if status == Status.CURVATURE:
            end_margin = END_AT_EQUAL_CURVATURE
        if margin < end_margin:
            return status
    is_singular = is_nearly_singular(linearisation, driven, END_AT_SINGULARITY_CONDITION)
    return Status.OUT_OF_REACH if is_singular else Status.MODE_LOST


@dataclass(frozen=True)
class FollowedPaths:
    """The ends of n paths along which inputs were moved straight to their goals.

    Attributes
    ----------
    nodes
        Last configuration of each path, with its derivatives.
    status
        (n,) OK if the path reached its goal, otherwise why it ended before.
    tried_steps
        (n,) number of steps that were tried, including those that failed.
    """

    nodes: InputPathNodes
    status: SmallIntegers
    tried_steps: Indices


Trail = list[tuple[Indices, InputPathNodes]]
"""Nodes that were reached: for each step the paths (k,), and their new nodes (k)."""


def follow_inputs(
    closure: Closure,
    driven: Sequence[int],
    values: Floats,
    q: Floats,
    trail: Trail | None = None,
    smallest_step: float = SMALLEST_INPUT_STEP_RAD,
) -> FollowedPaths:
    """Move the inputs along straight lines, and follow the configurations.

    A node is a computed point of a path, with derivatives.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    driven
        Indices of the variables of the inputs.
    values
        (n, variables) closed configurations (rad) from which the paths start.
    q
        (n, inputs) goals of the inputs (rad).
    trail
        All nodes after the first ones are appended to this list.
    smallest_step
        Smallest step (rad). A path ends where no step of this length is verified.

    Returns
    -------
    The last configuration of each path, and why it ended.
    """
    displacement = q - values[:, driven]
    length = np.linalg.norm(displacement, axis=1)
    direction = displacement / np.maximum(length, 1e-300)[:, None]
    nodes = nodes_at(closure.linearise(values.copy()), driven, direction)
    status = np.full(len(q), Status.OK, dtype=np.int8)
    # The first steps have the length that `_limit_steps` allows.
    steps = np.full(len(q), np.inf)
    tried_steps = np.zeros(len(q), dtype=np.intp)
    # Indices of the paths that have not ended. In each round, one step is tried on each
    # path. The step length is doubled after a success, and halved after a failure.
    active = np.flatnonzero(length > 0.0)
    while len(active):
        active_nodes = nodes.rows(active)
        tried_steps[active] += 1
        steps[active] = _limit_steps(active_nodes, steps[active], smallest_step)
        tried = _try_steps(closure, driven, active_nodes, steps[active], q[active])
        is_verified = tried.is_verified
        advanced = active[is_verified]
        new_nodes = tried.nodes.rows(is_verified)
        nodes.assign_rows(advanced, new_nodes)
        if trail is not None:
            trail.append((advanced, new_nodes))
        has_arrived = is_verified & tried.is_last
        is_given_up = ~has_arrived & (tried_steps[active] == MAX_TRIED_STEPS)
        status[active[is_given_up]] = Status.MODE_LOST
        # Large inputs have larger rounding errors, so their smallest step is larger.
        input_size = np.maximum(1.0, max_abs(active_nodes.values[:, driven], axis=1))
        is_stuck = ~is_verified & (steps[active] <= 2 * smallest_step * input_size)
        for row in active[is_stuck]:
            status[row] = _explain_end(closure, driven, nodes.values[row : row + 1])
        steps[active] *= np.where(is_verified, 2.0, 0.5)
        active = active[~(has_arrived | is_given_up | is_stuck)]
    return FollowedPaths(nodes, status, tried_steps)
