"""Tracks the configurations of a mechanism whose output link turns about a fixed axis.

The target orientation turns about the axis by the angle theta, and the path consists of the
configurations nearest to it (`spherekit.outputs.target_deviation`). It is tracked in steps
that are verified as `spherekit.positions.verified_steps` describes, with exact first and
second derivatives with respect to theta. A singular configuration, at which the loops and
the target do not determine the links, is stepped over at once. This is a *leap*. It is
accepted if the path continues smoothly on the other side.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.rotation import rotation_about_axis
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.hermite import quintic_hermite
from spherekit.numerics.minima import minimize_in_brackets
from spherekit.outputs.target_deviation import OutputLink, TargetDeviation
from spherekit.positions.loop_closure import NewtonSteps, newton
from spherekit.positions.verified_steps import STEP_PARTS, Verification
from spherekit.status import Status
from spherekit.tolerances import (
    CLOSURE_TOLERANCE,
    END_AT_SINGULARITY_CONDITION,
    NEAREST_TOLERANCE_RAD,
    SINGULAR_TARGET_CONDITION,
)

LARGEST_ROTATION_STEP_RAD = 0.2
"""Longest step (rad of theta).

Larger: fewer nodes, and more steps that fail and are halved. Smaller: more nodes.
"""

FIRST_ROTATION_STEP_RAD = 0.05
"""First step (rad of theta) that is tried.

Larger: more halvings at the start. Smaller: more steps until the longest one.
"""

SMALLEST_ROTATION_STEP_RAD = 1e-9
"""Step (rad of theta) below which the path ends.

Larger: the path ends further before the limit of the reach. Smaller: rounding errors decide
whether a step is accepted.
"""

MAX_PATH_NODES = 5000
"""Largest number of nodes of a path.

A path that needs more ends as MODE_LOST. Larger: more memory and time before that.
"""

CURVED_PART_RAD = 0.05
"""Second-order part (rad) of the change of a variable at which a step aims.

Larger: longer steps, of which more fail. Smaller: more nodes where the path bends.
"""

MAX_PART_OF_BEND_DISTANCE = 0.3
"""Largest step as part of the ratio of the first to the second derivative.

Near a limit of the reach variables change with the square root of the distance to it. The
ratio is then twice the distance, and the step is at most 0.6 of the distance. Larger: steps
beyond the limit, which fail. Smaller: more nodes near the limit.
"""

LIMITED_STEP_RAD = 0.02
"""Step (rad of theta) below which `MAX_PART_OF_BEND_DISTANCE` limits the step.

Larger: steps are shortened far from any limit of the reach, where the first derivative is
small for other reasons. Smaller: more failed steps near a limit.
"""

LEAST_LIMITED_RATE = 1.0
"""Largest first derivative of a variable above which `MAX_PART_OF_BEND_DISTANCE` applies.

Near a limit of the reach first derivatives are large. Larger: more failed steps near a
limit. Smaller: steps are shortened where the variables stand still or reverse, and with 0
the path ends there.
"""

STEP_VERIFICATION = Verification()
"""Tests of a step. The change of the equations is that of their eigenvalues."""

MAX_TARGET_STEPS = 8
"""Largest number of Newton steps with which a predicted configuration is corrected.

Larger: worse predictions are corrected, and the mode can be lost. Smaller: more steps fail.
"""

MAX_TARGET_STEP_RAD = 0.5
"""Largest change of a variable (rad) in one Newton step.

Larger: Newton's method can change to another mode. Smaller: convergence takes more steps.
"""

CORRECTOR_STEP_TOLERANCE_RAD = 1e-14
"""Newton step (rad) below which only rounding errors remain.

A larger tolerance leaves errors that torques magnify near crossings. A smaller one costs
steps without effect.
"""

LEAP_LENGTHS_RAD = (0.004, 0.01, 0.02, 0.04)
"""Lengths (rad of theta) of the leaps that are tried, in this order.

Longer leaps pass worse conditioned neighbourhoods. Shorter ones are more certain to stay in
the same mode.
"""

LEAP_BELOW_STEP_RAD = 2e-3
"""Step (rad of theta) below which a leap is tried instead.

It is also the least distance between two attempts. A leap over a configuration beyond the
end is accepted only within this distance from the end. Larger: leaps are tried where
ordinary steps succeed. Smaller: more halvings before a leap.
"""

MIN_CONDITION_PER_RAD = 2e-3
"""Smallest reciprocal condition number behind a leap, per rad of its length.

The reciprocal condition number grows linearly with the distance from the singular
configuration. Larger: more leaps are refused as too short. Smaller: a leap may end at
configurations that are still nearly singular.
"""

LEAP_SMOOTHNESS_RAD = 1e-7
"""Largest difference (rad) of configurations within a leap from the Hermite polynomial.

Larger: a leap may end in another mode. Smaller: rounding errors near the singular
configuration prevent leaps.
"""

LEAP_SINGULAR_RATIO = 0.01
"""Upper limit of the smallest singular value within a leap, relative to those at its ends.

Larger: a leap may pass a configuration that is not singular. Smaller: leaps over singular
configurations are refused if the interpolated path misses them slightly.
"""

COMPARABLE_CONDITION = 100.0 * SINGULAR_TARGET_CONDITION
"""Reciprocal condition number above which configurations within a leap are compared.

Larger: fewer configurations are left to show that the path is smooth. Smaller: rounding
errors of nearly singular configurations prevent leaps.
"""


@dataclass(frozen=True)
class PathNodes(ArrayRows):
    """n configurations on a path, with their derivatives with respect to theta.

    The path consists of the configurations nearest to a target orientation that turns about
    an axis by the angle theta.

    Attributes
    ----------
    theta
        (n,) angle of the target about the axis (rad).
    values
        (n, variables) pair variables (rad).
    first, second
        (n, variables) first and second derivatives of the variables with respect to theta.
    follows
        (n,) whether the output link turns exactly with the target.
    is_valid
        (n,) whether the configuration is the nearest one, with finite first derivatives.
    system
        (n, equations + 3, variables) matrices. The first rows are the derivatives of the
        closure equations with respect to the variables. The last three rows are the angular
        velocities of the output link per unit rate of each variable.
    condition
        (n,) reciprocal condition number of `system` in the Frobenius norm; 0 if the
        equations do not determine the motion.
    stability
        (n,) positive if no other configuration nearby is as near the target. It is the
        smaller one of two numbers. One is the least second derivative of half the squared
        angle to the target along the configurations. The other is the reciprocal condition
        number of the loops.
    reach
        (n,) smallest angular velocity of the output link for rates of unit length; 0 at a
        limit of its reach.
    """

    theta: Floats
    values: Floats
    first: Floats
    second: Floats
    follows: Bools
    is_valid: Bools
    system: Floats
    condition: Floats
    stability: Floats
    reach: Floats

    def extrapolate(self, distance: Floats) -> Floats:
        """Return predicted variables (n, variables) at n distances from one configuration.

        This object must have only this configuration (node) of the path. The distances are
        differences of the angle theta of the target (rad). The prediction is a Taylor
        series with the first and second derivatives with respect to theta. A second
        derivative that is NaN counts as 0.
        """
        distance = distance[:, None]
        bend = 0.5 * distance**2 * np.nan_to_num(self.second)
        return self.values + distance * self.first + bend

    def interpolate(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the variables at angles between the nodes of the path.

        A node is a computed configuration at an angle theta of the path, with derivatives
        with respect to theta. Between two nodes, each variable is a polynomial of degree 5
        that agrees with the values and the first and second derivatives at both nodes
        (quintic Hermite interpolation).

        Parameters
        ----------
        theta
            (n,) angles (rad).

        Returns
        -------
        values
            (n, variables) the variables (rad).
        cell_size
            (n,) rad, a scale for the error of the values. It is the larger one of the
            difference of theta and the largest difference of a variable between both nodes.
        """
        if len(self.theta) == 1:
            return np.repeat(self.values, len(theta), axis=0), np.zeros(len(theta))
        # Cell k lies between the nodes k and k + 1.
        cell = np.clip(np.searchsorted(self.theta, theta) - 1, 0, len(self.theta) - 2)
        start = (self.values[cell], self.first[cell], self.second[cell])
        stop = (self.values[cell + 1], self.first[cell + 1], self.second[cell + 1])
        cell_width = np.diff(self.theta)[cell]
        fraction = (theta - self.theta[cell]) / cell_width
        values = quintic_hermite(start, stop, cell_width, fraction)
        change = max_abs(stop[0] - start[0], axis=1)
        return values, np.maximum(cell_width, change)


@dataclass(frozen=True)
class TrackedPath:
    """The part of a path of configurations that was tracked.

    Along the path a target orientation turns about an axis by the angle theta. In each
    configuration the output link is as near to the target as possible.

    Attributes
    ----------
    nodes
        The computed configurations, in the order of theta.
    end
        OK if the path reached the requested angle, otherwise the reason why it ends.
    leaps
        Angles theta (rad) of singular configurations that the tracking stepped over. The
        equations do not determine the links there.
    """

    nodes: PathNodes
    end: Status
    leaps: tuple[float, ...]


def _measure_conditioning(deviation: TargetDeviation) -> Floats:
    """Return how well the loops and the output orientation determine each configuration.

    The path ends, or steps over a configuration, where these numbers are near 0.

    Parameters
    ----------
    deviation
        n configurations with their deviations from a target orientation. The matrices
        `system` give the rates of the loop equations and the angular velocity of the output
        link from the rates of the variables.

    Returns
    -------
    (n,) reciprocal condition numbers of `system`, with Frobenius norms. They are 0 if a
    motion of the mechanism does not turn the output link.
    """
    # The Frobenius norm of a matrix is the norm of its singular values. That of the inverse
    # is the norm of their reciprocals. A singular value of 0 gives an infinite norm and the
    # result 0. `deviation` has a pseudo-inverse too, but without small singular values.
    singular_values = np.linalg.svd(np.nan_to_num(deviation.system), compute_uv=False)
    norm = np.linalg.norm(singular_values, axis=1)
    with np.errstate(divide="ignore", over="ignore"):
        inverse_norm = np.linalg.norm(1.0 / singular_values, axis=1)
    return 1.0 / (norm * inverse_norm)


def _measure_isolation(deviation: TargetDeviation) -> Floats:
    """Return values (n,), positive if no nearby configuration is as near the target.

    The target is an orientation of the output link. Two numbers must be positive: the least
    second derivative of half the squared angle to the target over all motions, and the
    reciprocal condition number of the loops. Only the signs matter, so the smaller number
    is returned.
    """
    return np.minimum(deviation.least_eigenvalue, deviation.loop_conditioning)


@dataclass(frozen=True)
class RotationPath:
    """The configurations nearest to an orientation that turns about a fixed axis.

    Attributes
    ----------
    output_link
        The output link and the closure of its mechanism.
    axis
        (3,) unit vector of the axis, in the axes of the link that the output is relative
        to.
    start
        (3, 3) target orientation at the angle theta = 0 of rotation. It leads from the axes
        of the output link to those of the link that the output is relative to.
    exact
        Whether the output link can follow the target exactly. Otherwise the path has the
        configurations nearest to the target.
    """

    output_link: OutputLink
    axis: Floats
    start: Floats
    exact: bool

    def target_orientations(self, theta: Floats) -> Floats:
        """Return the target orientations (n, 3, 3) at angles (n,) in rad."""
        return rotation_about_axis(self.axis, theta) @ self.start

    def find_nearest(
        self, theta: Floats, guess: Floats
    ) -> tuple[TargetDeviation, NewtonSteps]:
        """Return the configurations in which the output link is nearest to its targets.

        The target is an orientation that turns about a fixed axis. Nearest means the
        smallest angle between output link and target. The method is Newton's.

        Parameters
        ----------
        theta
            (n,) angles (rad) by which the target has turned.
        guess
            (n, variables) pair variables (rad) from which the method starts.

        Returns
        -------
        deviation
            The configurations at which the method ended, converged or not.
        newton_steps
            The sizes of the first two steps. Large ones show that the guess was bad, so
            that the result may be on another path.
        """
        targets = self.target_orientations(theta)

        def newton_step(values: Floats, rows: Indices) -> Floats:
            """Return the steps (k, variables) at values (k, variables) of some rows."""
            # If `exact`, the step closes the loops and turns the output link to exactly the
            # target's orientation. If not, the step closes the loops and minimises the
            # angle to the target.
            deviation = self.output_link.compare(values, targets[rows])
            # A step that is NaN becomes 0, which ends the iteration of its row. The caller
            # tests the error of the result.
            return np.nan_to_num(deviation.newton_step(self.exact))

        values, newton_steps = newton(
            newton_step,
            values=guess,
            max_steps=MAX_TARGET_STEPS,
            # A row has converged when its step is shorter than this.
            last_step=CORRECTOR_STEP_TOLERANCE_RAD,
            longest_step=MAX_TARGET_STEP_RAD,
        )
        return self.output_link.compare(values, targets), newton_steps

    def make_nodes(self, theta: Floats, deviation: TargetDeviation) -> PathNodes:
        """Return nodes of the path: configurations with derivatives and quality measures.

        Along the path a target orientation turns about a fixed axis by the angle theta. In
        each configuration the output link is as near to the target as possible.

        Parameters
        ----------
        theta
            (n,) angles of the target (rad).
        deviation
            The configurations at these angles, compared with the target. A configuration
            that is not the nearest one to the target becomes a node that is not valid.
        """
        # First and second derivatives of the variables with respect to theta.
        rates = deviation.rates(self.axis)
        has_rates = all_finite(rates.first, 1)
        # At the nearest configuration the loops are closed. The output link has the
        # orientation of the target if it can reach the target (`exact`), and the least
        # angle to the target if not. `error` (rad) is 0 at such a configuration.
        is_nearest = deviation.error(self.exact) < NEAREST_TOLERANCE_RAD
        return PathNodes(
            theta=theta,
            values=deviation.values,
            first=rates.first,
            second=rates.second,
            # Whether the output link turns exactly with the target.
            follows=rates.follows,
            is_valid=has_rates & is_nearest,
            # Derivatives, with respect to the variables, of the loop equations and of the
            # orientation of the output link. Their change from node to node shows whether a
            # singular configuration can lie between the nodes.
            system=deviation.system,
            # How well `system` determines the variables: its reciprocal condition number.
            condition=_measure_conditioning(deviation),
            # Positive if no other configuration nearby is as near to the target.
            stability=_measure_isolation(deviation),
            # The smallest angular velocity of the output link in motions with closed loops,
            # if the vector of the rates of the variables has unit length. It is 0 at a
            # limit of the reach of the link.
            reach=deviation.output_singular_value,
        )

    def _correct_nodes(self, theta: Floats, guess: Floats) -> tuple[PathNodes, NewtonSteps]:
        """Return the nodes at angles (n,), and the step sizes as `find_nearest` does."""
        deviation, newton_steps = self.find_nearest(theta, guess)
        return self.make_nodes(theta, deviation), newton_steps

    def step(self, node: PathNodes, goal: float) -> PathNodes | None:
        """Return the next node of the path, None if the step to it fails a test.

        The path consists of the configurations nearest to a target orientation, which turns
        about an axis by the angle theta. A node is predicted from the derivatives at the
        last one and corrected by Newton's method. The middle of the step is computed too.
        The tests are that the corrections are small, that no singular configuration is
        between the two nodes, and that the interpolation agrees with the middle.

        Parameters
        ----------
        node
            The last node of the path.
        goal
            Angle theta (rad) of the next node.
        """
        # 1. Predict and correct the middle and the end of the step. STEP_PARTS is 1/2 and
        # 1, so `distances` (2,) are the differences of theta from the node to both.
        distances = STEP_PARTS * (goal - node.theta)
        guess = node.extrapolate(distances)
        if not all_finite(guess):
            return None
        theta = np.append(node.theta + distances[:1], goal)
        nodes, newton_steps = self._correct_nodes(theta, guess)
        middle_node = nodes.rows(slice(0, 1))
        next_node = nodes.rows(slice(1, 2))

        # 2. The corrections have to be small compared to the step. `follows`, whether the
        # output link turns exactly with the target, must not change in a step.
        change = max_abs(next_node.values - node.values)
        is_corrected = (
            STEP_VERIFICATION.accepts_correction(newton_steps, change) & nodes.is_valid
        )
        if not np.all(is_corrected & (nodes.follows == node.follows)):
            return None

        # 3. No singular configuration may lie between the nodes.
        if node.follows[0]:
            # The equations of the loops and of the orientation determine the links. Their
            # matrix, the system A, may have more rows than columns. With its pseudo-inverse
            # A+, the relative change C = A+ (A_next - A) is square. Between the nodes the
            # system is about A (1 + x C), with x from 0 to 1. It is singular only if x C
            # has the eigenvalue -1, which is impossible if all eigenvalues of C are small.
            relative_change = np.linalg.pinv(node.system[0]) @ (nodes.system - node.system)
            eigenvalues = np.abs(np.linalg.eigvals(relative_change))
            is_regular = STEP_VERIFICATION.accepts_change(eigenvalues)
        else:
            # The link does not reach the target, so its configuration is the nearest one.
            # `stability` contains the second derivative of the squared distance. If it is
            # zero, neighbouring configurations are equally near: none is determined.
            is_regular = nodes.stability > SINGULAR_TARGET_CONDITION

        # 4. The interpolation between both ends has to agree with the middle.
        interpolated, _ = PathNodes.concatenate([node, next_node]).interpolate(
            middle_node.theta
        )
        middle_error = max_abs(interpolated - middle_node.values)
        is_predicted = STEP_VERIFICATION.accepts_middle(
            middle_error, change, CLOSURE_TOLERANCE
        )
        return next_node if is_predicted and np.all(is_regular) else None

    def leap(self, node: PathNodes, end: float) -> tuple[PathNodes, float] | None:
        """Step over a singular configuration shortly ahead of a node.

        Ordinary steps fail near a singular configuration, where the equations do not
        determine the links. A step over it is called a leap. Several lengths are tried. A
        leap is accepted if the configuration behind it is regular, if the configurations
        within it lie on a smooth curve through both ends, and if one of them is singular.

        Parameters
        ----------
        node
            The last node of the path.
        end
            Angle (rad) at which the path ends. The leap may pass it.

        Returns
        -------
        The node beyond the singular configuration, and the angle theta (rad) of that
        configuration. None if there is none within the longest leap, or if the path does
        not continue smoothly.
        """
        # A singular configuration beyond the end is stepped over only from nearby. From
        # elsewhere ordinary steps can reach the end.
        is_close_to_end = node.theta[0] >= end - LEAP_BELOW_STEP_RAD
        for length in LEAP_LENGTHS_RAD:
            goal = node.theta + length
            next_node, newton_steps = self._correct_nodes(
                goal, node.extrapolate(np.array([length]))
            )
            change = max_abs(next_node.values - node.values)
            is_regular = (
                next_node.is_valid[0]
                and next_node.condition[0] > MIN_CONDITION_PER_RAD * length
            )
            correction = newton_steps.first_step[0]
            if not is_regular or correction > STEP_VERIFICATION.correction * change:
                continue

            # Is the path smooth? Configurations at 20, 40, 60 and 80 % of the leap have to
            # agree with the Hermite polynomial through both nodes. Configurations next to
            # the singular one are too inaccurate to be compared.
            inner_theta = node.theta + length * np.arange(0.2, 0.9, 0.2)
            both_nodes = PathNodes.concatenate([node, next_node])
            guess, _ = both_nodes.interpolate(inner_theta)
            inner_nodes, _ = self._correct_nodes(inner_theta, guess)
            is_comparable = inner_nodes.condition > COMPARABLE_CONDITION
            error = max_abs(inner_nodes.values - guess, axis=1)[is_comparable]
            is_smooth = len(error) >= 2 and np.max(error) <= LEAP_SMOOTHNESS_RAD
            if not is_smooth or not np.all(inner_nodes.is_valid):
                continue

            # Is there a singular configuration within? The least singular value has to have
            # a minimum far below its values at both ends.
            def least_singular_value(
                theta: Floats, nodes: PathNodes = both_nodes
            ) -> Floats:
                """Return the least singular value (n,) of the system at angles (n,)."""
                values, _ = nodes.interpolate(theta)
                # The system does not depend on the target, so any target will do.
                deviation = self.output_link.compare(values, np.eye(3)[None])
                singular_values = np.linalg.svd(deviation.system, compute_uv=False)
                return np.asarray(singular_values[:, -1])

            singular_theta = minimize_in_brackets(least_singular_value, node.theta, goal)
            value_at_minimum = least_singular_value(singular_theta)[0]
            values_at_ends = least_singular_value(both_nodes.theta)
            is_singular = value_at_minimum < LEAP_SINGULAR_RATIO * np.min(values_at_ends)
            if is_singular and (is_close_to_end or singular_theta[0] <= end):
                return next_node, float(singular_theta[0])
        return None

    def track(self, first_node: PathNodes, end: float) -> TrackedPath:
        """Track the path from a node to the angle `end` (rad), or as far as possible.

        Along the path a target orientation turns about an axis by the angle theta. A node
        is a configuration in which the output link is as near to the target as possible. A
        step that fails is halved, and the step after a success is twice as long. Where
        short steps fail, the next configurations may be singular. One step over them is
        then tried, a leap. The path ends where even the smallest step fails, or when there
        are too many nodes.
        """
        nodes = [first_node]
        # Angles (rad) of the singular configurations over which leaps have led.
        singular_thetas: list[float] = []
        step = FIRST_ROTATION_STEP_RAD
        # A leap is tried only beyond this angle, so that the path advances between leaps.
        next_leap_theta = -np.inf
        end_status = Status.OK
        while (theta := float(nodes[-1].theta[0])) < end:
            node = nodes[-1]
            step = min(step, _longest_step(node))
            if len(nodes) >= MAX_PATH_NODES:
                # MODE_LOST stands for all reasons without a status of their own.
                end_status = Status.MODE_LOST
                break
            if step < SMALLEST_ROTATION_STEP_RAD:
                end_status = _end_reason(node)
                break

            # 1. An ordinary step. A remainder shorter than the smallest step is added.
            reaches_end = end - theta - step < SMALLEST_ROTATION_STEP_RAD
            next_node = self.step(node, end if reaches_end else theta + step)
            if next_node is not None:
                nodes.append(next_node)
                step *= 2.0
                continue

            # 2. A leap, if the step was short.
            if step < LEAP_BELOW_STEP_RAD and theta > next_leap_theta:
                next_leap_theta = theta + LEAP_BELOW_STEP_RAD
                leap = self.leap(node, end)
                if leap is not None:
                    node_behind, singular_theta = leap
                    nodes.append(node_behind)
                    singular_thetas.append(singular_theta)
                    theta_behind = float(node_behind.theta[0])
                    next_leap_theta = theta_behind + LEAP_BELOW_STEP_RAD
                    step = 2.0 * (theta_behind - theta)
                    continue

            # 3. Both have failed.
            step *= 0.5
        return TrackedPath(PathNodes.concatenate(nodes), end_status, tuple(singular_thetas))


def _longest_step(node: PathNodes) -> float:
    """Return the longest step (rad of the rotation) that the curvature of the path allows.

    Longer steps often fail. Let f and b be the largest first and second derivatives of the
    variables with respect to the rotation. There are two bounds:

    - The second-order part of the change in a step, b step^2 / 2, is at most
      `CURVED_PART_RAD`.
    - A step must not pass the end of the reach, beyond which the output cannot rotate. Near
      this end, variables change with the square root of the distance to it. The distance is
      then f / (2 b). The step is at most `MAX_PART_OF_BEND_DISTANCE` f / b.

    The second bound counts only if it is small and f is large. Otherwise the path is not
    near the end of the reach.
    """
    # `rate` is f and `bend` is b. The tiny summand prevents a division by zero on a
    # straight path.
    rate: float = max_abs(node.first)
    bend: float = max_abs(np.nan_to_num(node.second)) + 1e-300
    step = min(LARGEST_ROTATION_STEP_RAD, (2.0 * CURVED_PART_RAD / bend) ** 0.5)
    limited_step: float = MAX_PART_OF_BEND_DISTANCE * rate / bend
    if limited_step < LIMITED_STEP_RAD and rate > LEAST_LIMITED_RATE:
        return min(step, limited_step)
    return step


def _end_reason(node: PathNodes) -> Status:
    """Return why the path ends at a configuration from which every step fails.

    OUT_OF_REACH: the output link does not follow the target, or hardly turns with the
    inputs. AT_SINGULARITY: the equations hardly determine the links. MODE_LOST: any other
    reason.
    """
    if not node.follows[0] or node.reach[0] < END_AT_SINGULARITY_CONDITION:
        return Status.OUT_OF_REACH
    if node.condition[0] < END_AT_SINGULARITY_CONDITION:
        return Status.AT_SINGULARITY
    return Status.MODE_LOST
