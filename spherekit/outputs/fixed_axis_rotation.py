"""Rotations of an output link about a fixed axis, for any mechanism.

The target is an orientation that turns exactly about the axis.
`spherekit.outputs.rotation_path` tracks the configurations in which the output link is
nearest to it. Samples are interpolated between the nodes of this path and corrected by
Newton's method, so they do not depend on each other.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebpts1, chebval
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.rotation import angles_between, quaternion, rotation_about_axis
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import all_finite, max_abs, unit_rows
from spherekit.mechanism.output_choice import chosen_output
from spherekit.mechanism.sizes import to_radians
from spherekit.numerics.minima import minimize_in_brackets
from spherekit.outputs.rotation_path import (
    LEAP_LENGTHS_RAD,
    LEAP_SMOOTHNESS_RAD,
    STEP_VERIFICATION,
    PathNodes,
    RotationPath,
)
from spherekit.outputs.target_deviation import OutputLink, TargetDeviation
from spherekit.positions.assembly_mode import has_configuration
from spherekit.positions.linear_equations import condition_numbers
from spherekit.quantity import AngleUnit
from spherekit.status import Status
from spherekit.tolerances import (
    EPS,
    MODE_CHANGE_RAD,
    MODE_CHANGE_RATIO,
    NEAREST_TOLERANCE_RAD,
    SINGULAR_RATIO,
    SINGULAR_TARGET_CONDITION,
    SINGULAR_TRANSMISSION,
    USABLE_DIRECTION,
)
from spherekit.velocities.transmission_measure import Transmission
from spherekit.wording import counted

LEAP_NEIGHBOURHOOD_RAD = 0.08
"""Distance (rad of theta) from a leap within which rates are interpolated.

Larger: the rates vary more in this range, and the polynomial is less accurate. Smaller: the
interpolation points are nearer to the singular configuration and have larger rounding
errors.
"""

LEAP_CHEBYSHEV_POINTS = 14
"""Number of Chebyshev points through which rates near a leap are interpolated.

Larger: rounding errors of the rates are amplified more. Smaller: larger interpolation
error.
"""

CROSSING_GRID_SIZE = 257
"""Number of angles of a rotation at which crossings of type II are bracketed.

Larger: crossings that are close together are found more reliably, in more time.
"""

ORIENTATION_ROUNDING_RAD = 8.0 * EPS
"""Rounding error (rad) of a rotation that is computed from two orientations.

Larger: more pairs of orientations are refused, since their axis is not determined. Smaller:
axes with larger errors are returned.
"""

START_RESIDUAL_RAD = 1e-6
"""Largest closure residual (rad) of a configuration from which a rotation may start.

Larger: configurations that are far from closed are accepted and may be closed in another
mode. Smaller: values that were rounded in a table are refused.
"""

UNIT_ORIENTATION_TOLERANCE = 1e-9
"""Largest element of R R^T - 1 with which a matrix R counts as a rotation matrix.

Larger: matrices that are not rotations are accepted. Smaller: rounded ones are refused.
"""

RANGE_TOLERANCE = 1e-12
"""Part of a range, or of 1 if it is shorter, by which a value may be outside by rounding.

Larger: values outside are accepted and moved to the end. Smaller: rounded ends are refused.
"""


@dataclass(frozen=True)
class RotationSamples:
    """n configurations of a mechanism whose output link turns about a fixed axis.

    Vectors and orientations are in the axes of the base. The motion of the output link is
    measured relative to this link.

    Attributes
    ----------
    theta
        (n,) rad, the angle by which the output link has turned about the axis.
    inputs, rates, second_rates
        (n, inputs): the driven variables (rad) and their first and second derivatives with
        respect to theta.
    values
        (n, variables) rad, the variables of all pairs.
    orientation
        (n, 3, 3) rotation matrices from the axes of the output link to those of the base.
    orientation_error
        (n,) rad, the angle between this orientation and that of an exact rotation by theta
        about the axis.
    drift
        (n,) rad, the angle between the momentary axis of the link (the direction of its
        angular velocity) and the fixed axis.
    type_2
        (n,) transmission measure of the inputs, 0 at a singularity of type II, see
        `spherekit.velocities.transmission_measure`.
    status
        (n,) codes of `Status`. Rows with other codes than OK and AT_SINGULARITY are NaN, as
        are rows beyond the end of the path. At AT_SINGULARITY the inputs do not determine
        the configuration, or the orientation of the output link does not. Rates that are
        not finite are NaN.
    """

    theta: Floats
    inputs: Floats
    rates: Floats
    second_rates: Floats
    values: Floats
    orientation: Floats
    orientation_error: Floats
    drift: Floats
    type_2: Floats
    status: SmallIntegers


@dataclass(frozen=True)
class FollowedRotation(RotationPath):
    """A rotation about a fixed axis as far as a mechanism follows it.

    Attributes
    ----------
    transmission
        The transmission measure of the output.
    driven
        Numbers of the driven variables.
    inputs
        Names of the driven pairs.
    axis, angle
        Unit vector (3,) in the axes of the base, and the whole angle (rad), 0 or more.
    exact
        Whether the output link turns exactly about the axis, up to the angle `reached`.
    nodes
        The configurations computed during tracking, in the order of the angle theta of
        rotation.
    end
        OK if the whole angle was reached, otherwise the status beyond `reached`:
        OUT_OF_REACH if the output link cannot turn further, AT_SINGULARITY if the equations
        hardly determine the links, MODE_LOST otherwise.
    leaps
        Angles (rad) of singular configurations that were stepped over. The rates near them
        are interpolated.
    """

    transmission: Transmission
    driven: list[int]
    inputs: Names
    angle: float
    nodes: PathNodes
    end: Status
    leaps: tuple[float, ...]

    @property
    def reached(self) -> float:
        """The angle (rad) up to which the rotation was tracked."""
        return min(float(self.nodes.theta[-1]), self.angle)

    @cached_property
    def crossings(self) -> tuple[float, ...]:
        """Angles (rad) at which the inputs do not determine the output (type II).

        Some angles are leaps: the tracking of the rotation has stepped over a singular
        configuration there. The other angles are found where the transmission measure falls
        to 0. This measure says how well the locked inputs hold the output. All angles are
        between 0 and `reached`, up to which the rotation was tracked.
        """
        # Evaluate the measure on a grid. A value that is not larger than its two neighbours
        # brackets a minimum. Beyond the ends of the grid the measure counts as infinite.
        grid = np.linspace(0.0, self.reached, CROSSING_GRID_SIZE)
        measure = np.nan_to_num(self._measure_transmission(grid), nan=np.inf)
        padded = np.pad(measure, 1, constant_values=np.inf)
        before = padded[:-2]
        after = padded[2:]
        (lowest,) = np.nonzero((measure <= before) & (measure < after))
        low = grid[np.maximum(lowest - 1, 0)]
        high = grid[np.minimum(lowest + 1, CROSSING_GRID_SIZE - 1)]
        minima = minimize_in_brackets(self._measure_transmission, low, high)
        # The measure can be NaN exactly at a singular configuration.
        least_measures = self._measure_transmission(minima)
        is_singular = (least_measures <= SINGULAR_RATIO) | np.isnan(least_measures)
        singular = minima[is_singular]
        # A minimum near a leap is the singular configuration of this leap, which is listed
        # already. Near means: at most the length of the longest leap away.
        longest_leap = LEAP_LENGTHS_RAD[-1]
        leaps = self._leaps_of_type_2()
        distances = np.abs(singular[:, None] - leaps)
        is_apart = np.all(distances > longest_leap, axis=1)
        crossings = np.concatenate([leaps, singular[is_apart]])
        # Adding 0.0 turns -0.0 into 0.0.
        angles_in_range = np.clip(crossings, 0.0, self.reached) + 0.0
        return tuple(np.sort(angles_in_range).tolist())

    def _leaps_of_type_2(self) -> Floats:
        """Return the leaps (n,) at which the inputs do not determine the output (rad).

        A leap is the angle of a singular configuration that the tracking of the path has
        stepped over. `crossings` lists only those at which the inputs do not determine the
        output, so all others are left out here. Leaps before the start or beyond the end of
        the rotation are also left out.
        """
        leaps = np.array(self.leaps)
        # The angle of a leap is computed on an interpolated path. `LEAP_SMOOTHNESS_RAD` is
        # the largest error of this interpolation. A leap at an end of the rotation may
        # therefore seem to lie slightly outside.
        is_in_range = (leaps >= -LEAP_SMOOTHNESS_RAD) & (
            leaps <= self.reached + LEAP_SMOOTHNESS_RAD
        )
        leaps = leaps[is_in_range]
        values, _ = self.nodes.interpolate(leaps)
        measure = self.transmission.measure_configurations(self.output_link.closure, values)
        # The measure can be NaN at a singular configuration.
        return leaps[~(measure > SINGULAR_TRANSMISSION)]

    def _measure_transmission(self, theta: Floats) -> Floats:
        """Return the transmission measure (n,) at angles (n,) rad up to `reached`.

        The measure tells how well the locked inputs hold the output link. The measure is 0
        where the output can move although the inputs are locked (type II singularity).
        """
        guess, _ = self.nodes.interpolate(theta)
        deviation, _ = self.find_nearest(theta, guess)
        return self.transmission.measure_configurations(
            self.output_link.closure, deviation.values
        )

    @checked(SolveError)
    def at(self, theta: ArrayLike) -> RotationSamples:
        """Return samples of the rotation at some angles.

        The configurations are interpolated between computed configurations (nodes) of the
        tracked path, and corrected by Newton's method. A correction that is large compared
        with the distance of the nodes may lead to another assembly mode. The sample then
        has the status MODE_LOST.

        Parameters
        ----------
        theta
            (n,) angles (rad) by which the output link has turned, from 0 to `angle`.

        Raises
        ------
        SolveError
            If `theta` is outside this range.
        """
        theta = check_range(theta, self.angle, name="theta", unit="rad")
        # Samples beyond the end of the path have the reason of the end as their status.
        status = np.where(theta <= self.reached, Status.OK, self.end).astype(np.int8)
        predicted, cell_size = self.nodes.interpolate(np.minimum(theta, self.reached))
        deviation, _ = self.find_nearest(theta, predicted)

        # The conditioning is 0 where the equations do not determine the links. If the
        # output link follows the target exactly, the equations include that it has the
        # target's orientation.
        conditioning = np.nan_to_num(1.0 / condition_numbers(deviation.system))
        if not self.exact:
            conditioning = np.minimum(
                deviation.least_eigenvalue, deviation.loop_conditioning
            )
        is_undetermined = (status == Status.OK) & ~(
            conditioning > SINGULAR_TARGET_CONDITION
        )
        if np.any(is_undetermined):
            # Where the links are not determined, Newton's method returns arbitrary values.
            # The interpolated values are accurate, since the path continues smoothly.
            values = np.where(is_undetermined[:, None], predicted, deviation.values)
            deviation = self.output_link.compare(values, self.target_orientations(theta))

        # Tests that the sample belongs to the path, and is regular. Comparisons are negated
        # so that NaN fails the test.
        correction = max_abs(deviation.values - predicted, axis=1)
        allowed_correction = MODE_CHANGE_RATIO * STEP_VERIFICATION.middle * cell_size
        allowed_correction = allowed_correction + MODE_CHANGE_RAD
        is_nearest = deviation.error(self.exact) < NEAREST_TOLERANCE_RAD
        is_on_profiles = np.all(deviation.linearisation.states.inside, axis=1)
        type_2 = self.transmission.measure_configurations(
            self.output_link.closure, deviation.values
        )
        # The first reason that applies to a row is reported.
        reasons = (
            (is_undetermined, Status.AT_SINGULARITY),
            (~is_nearest, Status.NOT_CONVERGED),
            (~(correction <= allowed_correction), Status.MODE_LOST),
            (~is_on_profiles, Status.OFF_PROFILE),
            (~(type_2 > SINGULAR_TRANSMISSION), Status.AT_SINGULARITY),
        )
        for applies, reason in reasons:
            status[(status == Status.OK) & applies] = reason

        first, second = self._compute_rates(theta, deviation)
        with np.errstate(all="ignore"):
            # The angular velocity of the output link at theta' = 1 has this direction.
            momentary_axis = unit_rows(np.matvec(deviation.output_jacobian, first))
        has_no_values = (theta > self.reached) | ~has_configuration(status)

        def blank(array: Floats) -> Floats:
            """Return the array (n, ...), with NaN in rows without a configuration."""
            array[has_no_values] = np.nan
            return array

        targets = self.target_orientations(theta)
        return RotationSamples(
            theta=theta,
            inputs=blank(deviation.values[:, self.driven]),
            rates=blank(first[:, self.driven]),
            second_rates=blank(second[:, self.driven]),
            values=blank(deviation.values),
            orientation=blank(deviation.orientations),
            orientation_error=blank(angles_between(deviation.orientations, targets)),
            drift=blank(arc(momentary_axis, self.axis)),
            type_2=blank(type_2),
            status=status,
        )

    def _compute_rates(
        self, theta: Floats, deviation: TargetDeviation
    ) -> tuple[Floats, Floats]:
        """Return the first and second derivatives of the variables with respect to theta.

        The target is an orientation that turns exactly about the fixed axis, by the angle
        theta. In each configuration the output link is as near to the target as it can be.

        Leaps are the angles at which the tracking of the path stepped over a singular
        configuration. The variables are smooth functions of theta there, but their computed
        derivatives have large rounding errors. Within `LEAP_NEIGHBOURHOOD_RAD` of a leap, a
        polynomial therefore replaces them. It interpolates the derivatives at Chebyshev
        points around the leap.

        Parameters
        ----------
        theta
            (n,) angles (rad).
        deviation
            The configurations at these angles, with the rotations that remain from the
            output link to the target.

        Returns
        -------
        first, second
            (n, variables) derivatives.
        """
        # Derivatives of the configurations that stay nearest to the target while it turns.
        rates = deviation.rates(self.axis)
        first_theta, last_theta = self.nodes.theta[[0, -1]]
        chebyshev_points = chebpts1(LEAP_CHEBYSHEV_POINTS)
        for leap in self.leaps:
            low, high = np.clip(
                [leap - LEAP_NEIGHBOURHOOD_RAD, leap + LEAP_NEIGHBOURHOOD_RAD],
                first_theta,
                last_theta,
            )
            is_near = (theta > low) & (theta < high)
            # The Chebyshev points are in [-1, 1]. Their number is even, so none is in the
            # middle, where the leap usually is.
            points = 0.5 * (low + high) + 0.5 * (high - low) * chebyshev_points
            # The nearest configurations at these points, from interpolated guesses.
            guess, _ = self.nodes.interpolate(points)
            deviation_at_points, _ = self.find_nearest(points, guess)
            rates_at_points = deviation_at_points.rates(self.axis)
            # The interval from low to high becomes -1 to 1.
            x = (2.0 * theta[is_near] - low - high) / (high - low)
            degree = LEAP_CHEBYSHEV_POINTS - 1
            first_series = chebfit(chebyshev_points, rates_at_points.first, degree)
            rates.first[is_near] = chebval(x, first_series).T
            second_series = chebfit(chebyshev_points, rates_at_points.second, degree)
            rates.second[is_near] = chebval(x, second_series).T
        return rates.first, rates.second


def axis_and_angle(first: Floats, second: Floats) -> tuple[Floats, float]:
    """Return the axis and the angle of the rotation from one orientation to another.

    Parameters
    ----------
    first, second
        (3, 3) rotation matrices, both from the axes of a link to the axes of a base.

    Returns
    -------
    axis
        (3,) unit vector in the axes of the base.
    angle
        Angle (rad) between 0 and pi.

    Raises
    ------
    SolveError
        If the axis or its sense is not determined.
    """
    # The quaternion is (axis sin(angle / 2), cos(angle / 2)), or its negative.
    xyzw = quaternion((second @ first.T)[None])[0]
    sine = float(np.linalg.norm(xyzw[:3]))
    angle = 2.0 * math.atan2(sine, abs(xyzw[3]))
    # The error (rad) of the axis is about `ORIENTATION_ROUNDING_RAD` / angle. If this is
    # not below `USABLE_DIRECTION`, the axis is refused.
    if angle * USABLE_DIRECTION <= ORIENTATION_ROUNDING_RAD:
        raise SolveError(
            "the two orientations are equal, so the axis of rotation is not determined; "
            "give two different orientations"
        )
    if np.pi - angle <= ORIENTATION_ROUNDING_RAD:
        raise SolveError(
            "the orientations differ by half a turn: the line of the axis is determined, "
            "but both senses lead from one to the other; give the axis with the wanted "
            "sense, and the angle"
        )
    return np.copysign(1.0, xyzw[3]) * xyzw[:3] / sine, angle


def unit(axis: ArrayLike) -> Floats:
    """Return a direction (3,) with length 1; `SolveError` if it has none."""
    direction = np.asarray(axis, dtype=float)
    size = max_abs(direction)
    if direction.shape != (3,) or not 0.0 < size < np.inf:
        raise SolveError(
            f"direction: found {direction.tolist()}, expected three finite numbers, not "
            "all zero"
        )
    # The largest component becomes 1, so that no square overflows or underflows.
    scaled = direction / size
    return scaled / float(np.linalg.norm(scaled))


def check_range(values: ArrayLike, maximum: float, name: str, unit: str) -> Floats:
    """Return angles or times of a rotation as an array, clipped to their range.

    Values outside the range by a rounding error are moved to its end.

    Parameters
    ----------
    values
        (n,) angles or times.
    maximum
        End of the range, which begins at 0.
    name, unit
        Name and unit of the values, for the message.

    Raises
    ------
    SolveError
        If a value is outside the range by more than rounding.
    """
    array = np.atleast_1d(np.asarray(values, dtype=float))
    clipped = np.clip(array, 0.0, maximum)
    tolerance = RANGE_TOLERANCE * max(1.0, maximum)
    if array.ndim != 1 or not np.all(np.abs(array - clipped) <= tolerance):
        raise SolveError(
            f"{name} has to be an array (n,) of numbers from 0 to {maximum:.6g} {unit}, "
            "where the rotation ends"
        )
    return clipped


@checked(SolveError)
def follow_rotation(
    mechanism: AnyMechanism,
    values: ArrayLike,
    axis: ArrayLike,
    angle: float,
    output: str | None = None,
    lead: float = 0.0,
    angle_unit: AngleUnit = "rad",
) -> FollowedRotation:
    """Return the rotation of an output link about a fixed axis.

    The angle theta of the rotation grows from 0 to `angle`. If the mechanism cannot go on,
    the rotation ends earlier, and `FollowedRotation.end` says why.

    The output link may be unable to turn exactly about the axis. At each theta, the result
    then has the configuration whose output link is nearest to the wanted orientation.
    `FollowedRotation.exact` tells whether it turns exactly.

    Parameters
    ----------
    mechanism
        A mechanism driven at as many R pairs as it has degrees of freedom, three at most.
    values
        (variables,) pair variables (rad) of the closed configuration to start from, as in a
        row of a `Motion`.
    axis
        Direction of the axis, (3,), in the axes of the link that the output is relative to.
    angle
        Angle of the rotation, above 0, in `angle_unit`, by default rad.
    output
        Name of the output; may be left out if there is one.
    lead
        Angle (in `angle_unit`), 0 or more, by which `values` lies before the start of the
        rotation: `values` is the configuration at theta = -lead. With a lead, a rotation
        can start at a singular configuration, in which some links can move while the output
        link is at rest. Tracking can pass through such a configuration, but cannot begin at
        one.
    angle_unit
        Unit of `angle` and `lead`, ``"rad"`` or ``"deg"``. The result is in rad.

    Raises
    ------
    ModelError
        If the output is unknown.
    SolveError
        If the configuration does not close, if the output link cannot turn from it in as
        many ways as there are inputs, or if it does not reach the start of the rotation.
    """
    mechanism = mechanism_of(mechanism)
    angle = to_radians(angle, angle_unit)
    lead = to_radians(lead, angle_unit)
    declared_output = chosen_output(mechanism, output)
    unit_axis = unit(axis)
    if not 0.0 < angle < np.inf:
        raise SolveError(f"angle: found {angle:g} rad, expected a finite angle above 0")
    if not 0.0 <= lead < np.inf:
        raise SolveError(f"lead: found {lead:g} rad, expected a finite angle, 0 or more")
    output_link = OutputLink.from_output(mechanism, declared_output)
    start_values = _check_values(output_link, values, mechanism.name)
    deviation = _close_start(output_link, start_values, mechanism.name)
    # The output link at theta = 0 is turned by `lead` from the given configuration.
    path = RotationPath(
        output_link=output_link,
        axis=unit_axis,
        start=rotation_about_axis(unit_axis, [lead])[0] @ deviation.orientations[0],
        exact=bool(deviation.rates(unit_axis).follows[0]),
    )
    # The link that the output is relative to becomes the ground of the measure.
    transmission = Transmission.from_mechanism(
        replace(mechanism, ground=declared_output.relative_to), declared_output
    )
    first_node = path.make_nodes(np.array([0.0 - lead]), deviation)
    tracked_path = path.track(first_node, angle)
    last_theta = float(tracked_path.nodes.theta[-1])
    if last_theta < 0.0:
        raise SolveError(
            f"{mechanism.name}: the rotation does not reach its start: {lead:.6g} rad lead "
            f"to it, but the path ends {-last_theta:.6g} rad before it "
            f"({tracked_path.end.name}); start from a nearer configuration"
        )
    return FollowedRotation(
        output_link=output_link,
        axis=unit_axis,
        start=path.start,
        exact=path.exact,
        transmission=transmission,
        driven=list(transmission.driven),
        inputs=mechanism.input_pairs,
        angle=float(angle),
        nodes=tracked_path.nodes,
        end=tracked_path.end,
        leaps=tracked_path.leaps,
    )


@checked(SolveError)
def follow_to(
    mechanism: AnyMechanism,
    values: ArrayLike,
    orientation: ArrayLike,
    output: str | None = None,
) -> FollowedRotation:
    """Return the motion in which an output link turns to an orientation about a fixed axis.

    The link turns by less than half a turn, which determines the axis.

    Parameters
    ----------
    mechanism
        A mechanism driven at as many R pairs as it has degrees of freedom, three at most.
    values
        (variables,) pair variables (rad) of the closed configuration at the start.
    output
        Name of the output; may be left out if there is one.
    orientation
        (3, 3) rotation matrix at the end, from the axes of the output link to those of the
        link that the output is relative to.

    Raises
    ------
    ModelError, SolveError
        As for `follow_rotation`. `SolveError` also if the axis is not determined.
    """
    mechanism = mechanism_of(mechanism)
    output_link = OutputLink.from_output(mechanism, chosen_output(mechanism, output))
    start_values = _check_values(output_link, values, mechanism.name)
    target = np.asarray(orientation, dtype=float)
    is_right_handed = target.shape == (3, 3) and np.linalg.det(target) > 0.0
    if (
        not is_right_handed
        or not max_abs(target @ target.T - np.eye(3)) < UNIT_ORIENTATION_TOLERANCE
    ):
        raise SolveError("the orientation has to be a rotation matrix (3, 3)")
    # Closing the loops can turn the output link, so the axis is computed afterwards.
    start = _close_start(output_link, start_values, mechanism.name)
    axis, angle = axis_and_angle(start.orientations[0], target)
    return follow_rotation(mechanism, start.values[0], axis, angle, output)


def _check_values(
    output_link: OutputLink, values: ArrayLike, mechanism_name: str
) -> Floats:
    """Return the pair variables from which a rotation starts, as an array.

    Parameters
    ----------
    output_link
        The output link, with the closure equations of its mechanism.
    values
        (variables,) the argument of the user (rad).
    mechanism_name
        Name for the message.

    Raises
    ------
    SolveError
        If the number of values is wrong or one of them is not finite.
    """
    array = np.asarray(values, dtype=float)
    variable_count = len(output_link.closure.tree.pair_of_variable)
    if array.shape != (variable_count,) or not all_finite(array):
        raise SolveError(
            f"{mechanism_name}: the configuration to start from needs {variable_count} "
            "finite values, one for each pair variable, such as a row of a computed motion"
        )
    return array


def _close_start(
    output_link: OutputLink, values: Floats, mechanism_name: str
) -> TargetDeviation:
    """Return the configuration from which a rotation starts, closed to rounding.

    The given variables may be rounded. Newton's method closes the loops again, and the
    output link keeps its orientation if possible. The result has one configuration.

    Parameters
    ----------
    output_link
        The output link and the closure of its mechanism.
    values
        (variables,) pair variables (rad) of the configuration.
    mechanism_name
        Name of the mechanism, for messages.

    Raises
    ------
    SolveError
        If the configuration does not close or is singular, if the mobility is not the
        number of inputs, or if the output link cannot turn in as many ways as there are
        inputs.
    """
    variable_count = len(values)
    input_count = output_link.degrees_of_freedom
    if input_count > 3:
        raise SolveError(
            f"{mechanism_name}: the mechanism has {input_count} inputs, but an orientation "
            "has only three degrees of freedom; lock some inputs"
        )
    # A chord is a pair that closes a loop, which gives at most three independent equations.
    least_mobility = variable_count - 3 * len(output_link.closure.tree.chords)
    if least_mobility > input_count:
        raise SolveError(
            f"{mechanism_name}: the mechanism has at least {least_mobility} degrees of "
            f"freedom, but {counted(input_count, 'input')}; declare {least_mobility} R "
            "pairs as inputs"
        )
    deviation = output_link.compare(values[None], np.eye(3)[None])
    residual = deviation.linearisation.closure_residual[0]
    if not residual < START_RESIDUAL_RAD:
        raise SolveError(
            f"{mechanism_name}: the configuration to start from does not close: its "
            f"residual is {residual:.3g} rad, but at most {START_RESIDUAL_RAD:g} is allowed"
        )

    # The nearest configuration to the present orientation, with closed loops. The axis
    # does not matter, since theta is 0.
    path = RotationPath(
        output_link,
        axis=np.eye(3)[2],
        start=deviation.orientations[0],
        exact=False,
    )
    deviation, _ = path.find_nearest(np.zeros(1), values[None])
    singular_values = np.linalg.svd(deviation.linearisation.jacobian[0], compute_uv=False)
    largest = np.max(singular_values, initial=0.0)
    # The Jacobian has the rank variables - inputs if the inputs are all degrees of freedom.
    # The remaining singular values, in falling order, are then 0.
    excess = singular_values[variable_count - input_count :]
    has_higher_rank = np.any(excess > SINGULAR_TARGET_CONDITION * largest)
    # Near singular configurations Newton's method may not converge.
    is_closed = (
        deviation.error(can_follow=False)[0] < NEAREST_TOLERANCE_RAD
        and deviation.loop_conditioning[0] > SINGULAR_TARGET_CONDITION
    )
    if has_higher_rank or not is_closed:
        raise SolveError(
            f"{mechanism_name}: the configuration to start from is singular, or the "
            f"mobility is not the number of inputs, {input_count}; start from another "
            "configuration"
        )
    if not deviation.output_singular_value[0] > SINGULAR_TARGET_CONDITION:
        raise SolveError(
            f"{mechanism_name}: at the start the output link has fewer degrees of freedom "
            f"than there are inputs ({input_count}); start elsewhere if the link is at the "
            "limit of its reach there, otherwise choose another output"
        )
    return deviation
