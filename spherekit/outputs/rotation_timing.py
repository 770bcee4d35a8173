"""Time on a rotation about a fixed axis: the shortest duration that the drives allow.

The angle is theta(t) = angle s(t / T) with a law shape s that leads from 0 to 1. Speeds of
the inputs are proportional to 1 / T and accelerations to 1 / T^2. The shortest duration T
therefore follows from their largest values at T = 1, which are computed to rounding.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import ModelError, SolveError
from spherekit.files.time_law import Cycloidal, Law, Polynomial
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.sizes import angles_in_radians
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.numerics.zeros import find_zeros
from spherekit.outputs.fixed_axis_rotation import RotationSamples, check_range
from spherekit.quantity import AngleUnit
from spherekit.status import Status
from spherekit.wording import listing, nearest

DEAD_CENTRE_RATE = 1e3
"""Smallest rate of an input, per rate of the output link, at which it is at a dead centre.

Larger: fewer inputs are named as the reason why a rotation ends. Smaller: inputs that only
turn quickly are named too.
"""

SHAPES: Mapping[str, Law] = MappingProxyType(
    {
        "cycloidal": Cycloidal(0.0, 1.0, 1.0),
        "cubic": Polynomial((0.0, 0.0, 3.0, -2.0)),
        "quintic": Polynomial((0.0, 0.0, 0.0, 10.0, -15.0, 6.0)),
        "septic": Polynomial((0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0)),
    }
)
"""Law shapes from 0 to 1 in unit time, by their names.

All start and stop at rest. The acceleration of the cubic jumps at both ends.
"""

SCHEDULE_TOLERANCE = 1e-9
"""Relative error of the interpolants in which the largest values are searched.

Only the positions of the largest values are read from the interpolants. Larger: less exact
positions. Smaller: more cells.
"""

MAX_SCHEDULE_CELLS = 64
"""Largest number of cells of these interpolants.

Larger: more time for rotations whose rates are nearly singular. Smaller: the tolerance is
reached for fewer rotations.
"""

EXTREMUM_PARTS_PER_CELL = 8
"""Number of parts of a cell; in each a derivative is assumed to have one zero at most.

Larger: close extrema are found more reliably, in more time.
"""

MAX_SCHEDULE_ROWS = 1_000_000
"""Largest number of cycles of a schedule; its table has a row for each, and a last one.

Larger: longer schedules, with more memory. Smaller: they are refused.
"""

STANDSTILL_RATIO = 1e-10
"""Part of the largest speed or acceleration, or of the output's, that counts as 0.

Larger: schedules limited only by slow inputs are refused. Smaller: rounding errors of
inputs that stand still set the duration.
"""

CYCLE_ROUNDING = 1e-12
"""Part of a duration by which it may exceed a whole number of cycles.

Larger: a limit may be exceeded by this part. Smaller: rounding errors add a cycle.
"""

LAW_END_TOLERANCE = 1e-12
"""Largest error of a law shape at its ends, and outside of the range from 0 to 1.

Larger: laws that end elsewhere are accepted. Smaller: rounding errors are refused.
"""

LAW_CHECK_SAMPLES = 1001
"""Number of samples at which a law shape has to be in the range from 0 to 1.

Larger: short excursions from the range are noticed. Smaller: they are missed.
"""


class FixedAxisRotation(Protocol):
    """Interface of a rotation of an output link about a fixed axis.

    The mechanism moves so that its output link turns about the axis by the angle theta. The
    configuration is known at any theta. The functions of this module find the shortest
    duration of the rotation that the drives of the inputs allow.
    """

    @property
    def axis(self) -> Floats:
        """Unit vector (3,) in the axes of the base."""

    @property
    def angle(self) -> float:
        """The whole angle (rad) of the wanted rotation, 0 or more."""

    @property
    def inputs(self) -> Names:
        """Names of the driven pairs."""

    @property
    def reached(self) -> float:
        """The angle (rad) up to which the mechanism follows the rotation."""

    @property
    def end(self) -> Status:
        """Status beyond `reached`: the reason why the mechanism follows no further."""

    @property
    def crossings(self) -> tuple[float, ...]:
        """Angles (rad) at which the inputs do not determine the output (type II)."""

    def at(self, theta: ArrayLike) -> RotationSamples:
        """Return the samples at angles theta (n,) from 0 to the whole angle, any order."""


def dead_centre(rotation: FixedAxisRotation) -> str:
    """Return the input at a dead centre where the tracking of a rotation ends, or ``""``.

    Such an input is the reason why the output link cannot turn further. An input counts as
    at a dead centre if it turns more than `DEAD_CENTRE_RATE` times as fast as the output
    link.
    """
    last_rates = rotation.at([rotation.reached]).rates[0]
    input_rates = np.nan_to_num(np.abs(last_rates), posinf=np.inf)
    fastest = np.argmax(input_rates)
    is_at_dead_centre = input_rates[fastest] > DEAD_CENTRE_RATE
    return rotation.inputs[fastest] if is_at_dead_centre else ""


@dataclass(frozen=True)
class Extreme:
    """The largest speed or acceleration of an input during a rotation of the output.

    The value shows how near the drive of this input is to its limits.

    Attributes
    ----------
    input
        Name of the driven pair.
    quantity
        Whether the value is a speed or an acceleration.
    value
        The value with its sign (rad/s or rad/s2).
    t
        Time (s) at which the value occurs.
    theta
        Angle (rad) of the rotation at this time.
    limit
        Largest allowed size of the value; infinite without a limit.
    """

    input: str
    quantity: Literal["speed", "acceleration"]
    value: float
    t: float
    theta: float
    limit: float


@dataclass(frozen=True)
class Trajectory:
    """The inputs at n times while an output link turns about a fixed axis.

    A controller can follow these values.

    Attributes
    ----------
    names
        Names of the inputs.
    t
        (n,) times (s).
    theta
        (n,) angles (rad) by which the output link has turned about the axis.
    inputs, rates, accelerations
        (n, inputs) values (rad) of the inputs, speeds (rad/s), accelerations (rad/s2).
    type_2
        (n,) transmission measure, at most 1. It is 0 at a singularity of type II, where
        locked inputs do not hold the output.
    status
        (n,) codes of `Status`: OK, or AT_SINGULARITY. Both have inputs and their rates.
    """

    names: Names
    t: Floats
    theta: Floats
    inputs: Floats
    rates: Floats
    accelerations: Floats
    type_2: Floats
    status: SmallIntegers


@dataclass(frozen=True)
class TimeScaling:
    """A schedule of a rotation: the time at which it reaches each angle.

    The angle at the time t is (whole angle) * shape(t / duration).

    Attributes
    ----------
    rotation
        The rotation.
    shape
        The law shape, from 0 to 1 in unit time.
    duration
        Time (s) for the whole angle.
    extremes
        Largest absolute speed of each input, then largest absolute acceleration of each
        input, with their limits.
    error
        Error of the interpolants in which the extremes were searched, relative to the
        largest value.
    cycle
        Cycle time (s) of the controller, None without one. The duration is a whole number
        of cycles.
    """

    rotation: FixedAxisRotation
    shape: Law
    duration: float
    extremes: tuple[Extreme, ...]
    error: float
    cycle: float | None = None

    @property
    def binding(self) -> Extreme:
        """The speed or acceleration that sets the duration.

        Each input has a largest speed and a largest acceleration, with a limit for each.
        The returned one needs the longest duration to keep its limit. Its limit is reached,
        unless the duration was rounded up to whole cycles of the controller.
        """

        def required_duration_ratio(extreme: Extreme) -> float:
            """Return the shortest duration that this limit allows, over the present one."""
            # Accelerations are proportional to the square of 1 / duration.
            power = 1.0 if extreme.quantity == "speed" else 0.5
            return (abs(extreme.value) / extreme.limit) ** power

        return max(self.extremes, key=required_duration_ratio)

    @checked(SolveError)
    def at(self, t: ArrayLike) -> Trajectory:
        """Return the inputs, their speeds and accelerations at times in the duration.

        The output link turns by the angle theta, which follows a law of time, `shape`.

        Parameters
        ----------
        t
            (n,) times (s) from 0 to the duration.

        Raises
        ------
        SolveError
            If a time is outside.
        """
        t = check_range(t, self.duration, "t", "s")
        # First evaluate the motion as if it took 1 s. Speeds are then divided by the
        # duration, accelerations by its square.
        samples, unit_motion = _evaluate_unit_motion(
            self.rotation, self.shape, t / self.duration
        )
        unit_speeds, unit_accelerations = np.split(unit_motion, 2, axis=1)
        return Trajectory(
            names=self.rotation.inputs,
            t=t,
            theta=samples.theta,
            inputs=samples.inputs,
            rates=unit_speeds / self.duration,
            accelerations=unit_accelerations / self.duration**2,
            type_2=samples.type_2,
            status=samples.status,
        )

    @checked(SolveError)
    def table(self, samples: int) -> Trajectory:
        """Return the inputs of the mechanism at equally spaced times of the schedule.

        The times include the start and the end.

        Parameters
        ----------
        samples
            Number of times, at least 2. If the controller has a cycle time, `samples` is
            ignored, and the times are those at which cycles begin or end.
        """
        if self.cycle is not None:
            # The duration is a whole number of cycles, up to rounding errors. `round` gives
            # this number. `minimum` keeps the last time from exceeding the duration.
            cycle_count = round(self.duration / self.cycle)
            ticks = np.arange(cycle_count + 1)
            return self.at(np.minimum(ticks * self.cycle, self.duration))
        if samples < 2:
            raise SolveError(f"samples: found {samples}, expected at least 2")
        return self.at(np.linspace(0.0, self.duration, samples))


@checked(SolveError)
def time_optimal(
    rotation: FixedAxisRotation,
    speed: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    shape: str | Law = "cycloidal",
    cycle: float | None = None,
    angle_unit: AngleUnit = "rad",
) -> TimeScaling:
    """Return the shortest schedule of a law shape that keeps to the limits of the drives.

    A law shape states which fraction of the angle is reached after each fraction of the
    duration. First the largest speeds and accelerations are computed for a duration of 1 s.
    Speeds are proportional to 1 / duration, accelerations to 1 / duration^2. The shortest
    duration follows from the limits.

    Parameters
    ----------
    rotation
        A rotation of the output link about a fixed axis. The mechanism must be able to turn
        the link by the whole angle.
    speed, acceleration
        Limits of the inputs, in `angle_unit` per s and per s2: one for all, or one for
        each. None stands for no limits.
    shape
        A name in `SHAPES`, or a law from 0 at t = 0 to 1 at t = 1.
    cycle
        Cycle time (s) of the controller. The duration is then the shortest whole number of
        cycles. None for no cycles.
    angle_unit
        Unit of angles of the limits, ``"rad"`` or ``"deg"``. The result is in rad.

    Raises
    ------
    SolveError
        - If no limit is given, or a limit or the cycle time is not positive.
        - If no shape has the name, or the law does not lead from 0 to 1.
        - If the duration has more than `MAX_SCHEDULE_ROWS` cycles.
        - If all limited speeds and accelerations are zero during the rotation.
        - If the output link cannot turn by the whole angle, or if the accelerations of the
          inputs are not known.
    """
    input_count = len(rotation.inputs)
    law, limits = schedule_limits(rotation.inputs, speed, acceleration, shape, cycle)
    limits = angles_in_radians(limits, angle_unit)
    if not np.any(np.isfinite(limits)):
        raise SolveError(
            "speed, acceleration: no limit is given; give at least one, because without a "
            "limit there is no shortest time"
        )

    # 1. The largest values in the unit motion, which takes 1 s. Its columns are the speeds
    # of all inputs, then their accelerations.
    unit_motion = PiecewiseChebyshev.fit(
        lambda unit_time: _evaluate_unit_motion(rotation, law, unit_time)[1],
        0.0,
        1.0,
        SCHEDULE_TOLERANCE,
        max_cells=MAX_SCHEDULE_CELLS,
    )
    # Part of the duration at which each column has its largest value.
    parts = np.array(
        [_find_largest(unit_motion, column) for column in range(2 * input_count)]
    )
    # The values themselves come from the rotation, not from its interpolant. Row k is at
    # the time of the largest value of column k, so the diagonal has all largest values.
    _, motion_at_parts = _evaluate_unit_motion(rotation, law, parts)
    unit_values = np.diagonal(motion_at_parts)

    sizes = np.abs(unit_values)
    moves = sizes > STANDSTILL_RATIO * np.max(sizes, initial=rotation.angle)
    if not np.any(moves & np.isfinite(limits)):
        raise SolveError(
            "speed, acceleration: all limited speeds and accelerations are 0 in this "
            "rotation, so there is no shortest time; limit an input that moves"
        )

    # 2. The duration. A speed is proportional to duration^(-1), an acceleration to
    # duration^(-2), that is to duration^(-1 / power).
    powers = np.repeat([1.0, 0.5], input_count)
    duration = float(np.max((sizes / limits) ** powers))
    if cycle is not None:
        if duration / cycle > MAX_SCHEDULE_ROWS:
            raise SolveError(
                f"cycle: {duration:.6g} s in cycles of {cycle:g} s are more than "
                f"{MAX_SCHEDULE_ROWS} rows; give a longer cycle"
            )
        cycles = np.ceil(duration / cycle * (1.0 - CYCLE_ROUNDING))
        duration = cycle * max(1.0, cycles)

    # 3. The largest values for this duration.
    values = unit_values / duration ** (1.0 / powers)
    law_values, _, _ = law.at(parts)
    theta = rotation.angle * law_values
    columns: list[tuple[Literal["speed", "acceleration"], str]] = [
        *(("speed", name) for name in rotation.inputs),
        *(("acceleration", name) for name in rotation.inputs),
    ]
    extremes = tuple(
        Extreme(
            input=name,
            quantity=quantity,
            value=float(values[column]),
            t=float(duration * parts[column]),
            theta=float(theta[column]),
            limit=float(limits[column]),
        )
        for column, (quantity, name) in enumerate(columns)
    )
    return TimeScaling(
        rotation=rotation,
        shape=law,
        duration=duration,
        extremes=extremes,
        error=unit_motion.error,
        cycle=cycle,
    )


def schedule_limits(
    inputs: Sequence[str],
    speed: ArrayLike | None,
    acceleration: ArrayLike | None,
    shape: str | Law,
    cycle: float | None,
) -> tuple[Law, Floats]:
    """Return the law and the limits of a schedule, after checking the arguments.

    A schedule is the angle of a rotation as a function of time. Its law shape states which
    fraction of the rotation is reached after each fraction of its duration.

    Parameters
    ----------
    inputs
        Names of the driven pairs.
    speed, acceleration
        Limits of the inputs in any unit: one for all, or one for each. None stands for no
        limits.
    shape
        Name of a law shape, or a law from 0 at t = 0 to 1 at t = 1.
    cycle
        Cycle time (s) of the controller, or None. It is only checked.

    Raises
    ------
    SolveError
        If a limit or the cycle time is not positive, if no law shape has this name, or if
        the law does not lead from 0 to 1.

    Returns
    -------
    law
        The law shape.
    limits
        (2 inputs,) largest speeds of all inputs, then their largest accelerations, in the
        units of the arguments; infinite without a limit.
    """
    if cycle is not None and not 0.0 < cycle < np.inf:
        raise SolveError(f"cycle: found {cycle:g}, expected a time above 0 s")
    limits = []
    for quantity, bound in (("speed", speed), ("acceleration", acceleration)):
        limit = np.asarray(np.inf if bound is None else bound, dtype=float)
        if limit.shape not in ((), (1,), (len(inputs),)) or not np.all(limit > 0.0):
            raise SolveError(
                f"{quantity}: found {'+'.join(map(str, limit.ravel()))}, expected one "
                f"limit above 0 for all inputs, or one for each of {listing(inputs)}"
            )
        limits.append(np.broadcast_to(limit, (len(inputs),)))
    return _check_shape(shape), np.concatenate(limits)


def _check_shape(shape: str | Law) -> Law:
    """Return the law shape that the user has chosen, by its name or as a law.

    A law shape is the fraction of the total angle that is reached, as a function of the
    fraction t of the total time.

    Raises
    ------
    SolveError
        If the name is unknown, or if the law does not lead from 0 at t = 0 to 1 at t = 1
        with all values between.
    """
    if isinstance(shape, str):
        if shape not in SHAPES:
            raise SolveError(
                f'shape: no law shape is named "{shape}"{nearest(shape, SHAPES) or "."} '
                f"Shapes: {listing(SHAPES)}"
            )
        return SHAPES[shape]
    # The law gives values and two derivatives; only the values are checked. A law can be a
    # table. If its times do not cover 0 to 1, `at` raises `ModelError`.
    try:
        values, _, _ = shape.at(np.linspace(0.0, 1.0, LAW_CHECK_SAMPLES))
    except ModelError as problem:
        raise SolveError(f"shape: {problem}") from None
    end_errors = values[[0, -1]] - [0.0, 1.0]
    range_errors = values - np.clip(values, 0.0, 1.0)
    if not max_abs(np.append(end_errors, range_errors)) < LAW_END_TOLERANCE:
        raise SolveError(
            f"shape: found a law from {values[0]:.6g} at t = 0 to {values[-1]:.6g} at "
            f"t = 1, with values from {np.min(values):.6g} to {np.max(values):.6g}; it has "
            "to go from 0 to 1 with all values between 0 and 1"
        )
    return shape


def _find_largest(functions: PiecewiseChebyshev, column: int) -> float:
    """Return the position at which one of several functions has its largest absolute value.

    The functions are the speeds and accelerations of the inputs during a rotation. The
    caller then computes the largest value itself, more accurately. The functions are
    polynomials in cells (piecewise Chebyshev interpolants). Candidates
    for the position are the zeros of the derivative, and the edges of the cells, where the
    derivative can jump.

    Parameters
    ----------
    functions
        The functions.
    column
        Number of the function.
    """
    derivative = functions.derivative
    second_derivative = derivative.derivative

    def evaluate_derivatives(x: Floats) -> tuple[Floats, Floats]:
        """Return the first and the second derivative (n,) at positions (n,)."""
        return derivative.evaluate(x)[:, column], second_derivative.evaluate(x)[:, column]

    grid = functions.spread_positions(EXTREMUM_PARTS_PER_CELL)
    stationary_positions = find_zeros(evaluate_derivatives, grid).places
    positions = np.append(functions.edges, stationary_positions)
    sizes = np.abs(functions.evaluate(positions)[:, column])
    return float(positions[np.argmax(sizes)])


def _evaluate_unit_motion(
    rotation: FixedAxisRotation, law: Law, unit_time: Floats
) -> tuple[RotationSamples, Floats]:
    """Return the motion of the inputs if the whole rotation takes 1 s.

    The law s(t) goes from 0 to 1 while the time t goes from 0 to 1 s. The angle of the
    rotation is theta = angle s(t), and the inputs are functions of theta.

    Parameters
    ----------
    rotation
        The rotation.
    law
        The law s(t).
    unit_time
        (n,) times t from 0 to 1 (s).

    Returns
    -------
    samples
        The samples of the rotation at these times.
    motion
        (n, 2 * inputs) speeds (rad/s) of all inputs, then their accelerations (rad/s2).

    Raises
    ------
    SolveError
        If the mechanism does not follow the rotation at one of the times, or if the second
        derivatives of the inputs are not known there.
    """
    s, ds, dds = law.at(unit_time)
    angle = rotation.angle
    # Rounding errors can move s a little outside of 0 to 1, where the rotation is not
    # defined.
    samples = rotation.at(angle * np.clip(s, 0.0, 1.0))
    # Where the mechanism does not follow the rotation, there are no derivatives.
    is_lost = ~all_finite(samples.second_rates, 1)
    if np.any(is_lost):
        first_lost = np.argmin(np.where(is_lost, samples.theta, np.inf))
        if samples.status[first_lost] == Status.OK:
            raise SolveError(
                "the accelerations of the inputs are not known: the output link cannot "
                "turn exactly about the axis, and the mechanism has contact pairs; choose "
                "an axis about which it can turn"
            )
        dead_input = dead_centre(rotation)
        raise SolveError(
            "the mechanism cannot follow the whole rotation: at theta = "
            f"{np.degrees(samples.theta[first_lost]):.6g} of {np.degrees(angle):.6g} deg "
            f"it is {Status(samples.status[first_lost]).name}"
            + (f", as input {dead_input} is at a dead centre" if dead_input else "")
            + "; choose another start or end"
        )
    # Chain rule: q' = (dq/dtheta) theta', q'' = (d2q/dtheta2) theta'^2 + (dq/dtheta)
    # theta''.
    theta_rate = (angle * ds)[:, None]
    theta_acceleration = (angle * dds)[:, None]
    speeds = samples.rates * theta_rate
    accelerations = (
        samples.second_rates * theta_rate**2 + samples.rates * theta_acceleration
    )
    return samples, np.concatenate([speeds, accelerations], axis=1)
