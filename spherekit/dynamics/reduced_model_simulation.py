"""Integrates the motion of a reduced model of one input under its loads.

The state is the coordinate x of the model (the input variable q or the arc length s), the
momentum p = sqrt(B) dx/dt and the work W of all loads. The equations of
`spherekit.dynamics.equation_of_motion` hold in any coordinate:

    dx/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),   dW/dt = Q dx/dt

with the generalised inertia B(x) and the generalised force Q of all loads.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from math import isfinite, sqrt

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.dynamics.reduced_model import StoredModel
from spherekit.errors import SolveError
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.sizes import to_radians
from spherekit.quantity import AngleUnit

STEP_TOLERANCE_RATIO = 0.03
"""Tolerance of an integration step, relative to the tolerance of the whole motion.

The errors of steps add up. Larger: the final error exceeds the tolerance more often.
Smaller: more steps.
"""

MIN_REDUCED_TOLERANCE_RAD = 1e-12
"""Smallest tolerance of a motion. LSODA refuses the steps of much smaller ones."""

MAX_REDUCED_TOLERANCE_RAD = 1e-2
"""Largest tolerance of a motion."""


@dataclass(frozen=True)
class TabulatedMotion:
    """The motion of a reduced model at n times.

    A reduced model of one input stores functions of a mechanism, such as its pair variables
    (joint angles) and its inertia, along the curve of all configurations. If the motion
    reaches an end of the curve, later rows are NaN.

    Attributes
    ----------
    t
        (n,) times, s.
    x
        (n,) coordinate along the curve, rad. The model names it in `StoredHeading.by`: "q"
        is the variable of the input, and "s" is the arc length of the curve.
    values, value_rates
        (n, variables) pair variables and their rates, rad and rad/s.
    q, dq
        (n,) variable of the input and its rate, rad and rad/s.
    kinetic
        (n,) kinetic energy, J.
    work
        (n,) work of all loads since the start, J.
    message
        The reason why the motion ended early, empty if it did not.
    evaluations
        Number of evaluations of the right-hand side of the equation of motion.
    """

    t: Floats
    x: Floats
    values: Floats
    value_rates: Floats
    q: Floats
    dq: Floats
    kinetic: Floats
    work: Floats
    message: str
    evaluations: int

    @property
    def energy(self) -> float:
        """Error of the energy balance (J).

        This error is the largest difference between the gained kinetic energy and the work
        of the loads.
        """
        return float(np.nanmax(np.abs(self.kinetic - self.kinetic[0] - self.work)))


@checked(SolveError)
def simulate_reduced(
    model: StoredModel,
    times: Sequence[float] | Floats,
    x: float,
    dx: float,
    tolerance: float = 1e-9,
    switches: Iterable[float] = (),
    angle_unit: AngleUnit = "rad",
) -> TabulatedMotion:
    """Return the motion of a reduced model at given times, integrated by SciPy's LSODA.

    A reduced model stores functions of a mechanism, such as its inertia, and replaces the
    mechanism in simulation and control.

    Parameters
    ----------
    model
        A reduced model of a mechanism with masses and one input. `StoredModel.with_torque`
        adds a driving torque to a model.
    times
        (n,) increasing times, s. The motion starts at the first one.
    x, dx
        Coordinate of the model (variable of the input, or arc length of the curve of
        configurations) and its rate at the start, in `angle_unit`, by default rad and
        rad/s.
    tolerance
        Intended error of x, from 1e-12 to 1e-2 rad.
    switches
        Times (s) at which expressions of loads have kinks. The integrator can step over a
        kink that is not given. The kinks of torque tables are known and need not be given.
    angle_unit
        Unit of `x` and `dx`, ``"rad"`` or ``"deg"`` (and per s). The result is in rad.

    Raises
    ------
    SolveError
        If times do not increase, the tolerance is out of its range, the model has several
        inputs, its inertia is or becomes zero, x is outside the curve, or the integrator
        gives up.
    """
    x = to_radians(x, angle_unit)
    dx = to_radians(dx, angle_unit)
    heading = model.heading
    name = heading.mechanism
    if not heading.is_curve:
        raise SolveError(
            f"{name}: the model has several inputs, but a simulation needs a model with "
            "one input"
        )
    # The texts in the message are the two constants.
    if not MIN_REDUCED_TOLERANCE_RAD <= tolerance <= MAX_REDUCED_TOLERANCE_RAD:
        raise SolveError(
            f"{name}: tolerance: found {tolerance:g}, expected a number from 1e-12 to 1e-2"
        )
    if not isfinite(dx):
        raise SolveError(f"{name}: dx: found {dx:g}, expected a finite number")
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if t.ndim > 1 or len(t) < 2 or not (all_finite(t) and np.all(np.diff(t) > 0.0)):
        raise SolveError(f"{name}: give two or more finite, increasing times")
    # A function that returns the inertia B, dB/dx and the other functions on which the
    # torque depends.
    evaluate_configuration = model.evaluate_configuration
    (low,) = heading.low
    (high,) = heading.high
    start_inertia, *_ = evaluate_configuration(x)
    if not start_inertia > 0.0:
        raise SolveError(
            f"{name}: the model has no inertia, so a load would cause an "
            "infinite acceleration; store a model of a mechanism with masses"
        )

    # Times at which the integrator tried coordinates beyond the ends of an open curve.
    outside_times: list[float] = []

    def state_rates(time: float, state: Floats) -> tuple[float, float, float]:
        """Return the time derivatives of the state: coordinate x, momentum p and work W.

        With the inertia B of the model, the momentum is p = sqrt(B) dx/dt, so the kinetic
        energy is p^2 / 2. With the generalised force Q of all loads, the rates are p /
        sqrt(B), Q / sqrt(B) and Q dx/dt.

        The integrator also tries coordinates beyond the ends `low` and `high` of an open
        curve of configurations. The rates beyond an end are the rates at this end. The time
        is then noted, so that a motion that leaves the curve is recognised later.
        """
        coordinate, momentum, _ = state.tolist()
        if not heading.periodic and not low <= coordinate <= high:
            outside_times.append(time)
            coordinate = min(max(coordinate, low), high)
        # The inertia B, dB/dx, and the functions on which loads depend.
        configuration_values = evaluate_configuration(coordinate)
        if not configuration_values[0] > 0.0:
            raise SolveError(
                f"{name}: the inertia goes to zero near t = {time:.6g} s, so the speed "
                "would become infinite; give mass to links that move"
            )
        inverse_root = 1.0 / sqrt(configuration_values[0])
        speed = momentum * inverse_root
        force = _generalised_force(model, configuration_values, coordinate, speed, time)
        return speed, force * inverse_root, force * speed

    # The integrator does not step over kinks of loads.
    start = float(t[0])
    end = float(t[-1])
    knots = [table.knots(start, end) for table in heading.tables]
    kinks = sorted(time for time in {*chain(switches, *knots)} if start < time < end)
    from scipy.integrate import odeint

    def integrate(state_times: Floats) -> tuple[Floats, int]:
        """Return the states at n times, and how often `state_rates` was called.

        The states (n, 3) have the columns x, p and W, which `state_rates` describes. The
        motion starts with the given coordinate and rate, and without work W.
        """
        # The times of kinks of the loads are added. SciPy can step over a kink that is not
        # one of its times.
        all_times = np.union1d(state_times, kinks)
        states, report = odeint(
            state_rates,
            [x, sqrt(start_inertia) * dx, 0.0],
            all_times,
            tfirst=True,
            rtol=STEP_TOLERANCE_RATIO * tolerance,
            atol=STEP_TOLERANCE_RATIO * tolerance,
            mxstep=100_000,
            tcrit=kinks or None,
            full_output=True,
        )
        if report["message"] != "Integration successful.":
            raise SolveError(f"{name}: {report['message']}")
        states = states[np.searchsorted(all_times, state_times)]
        return states, int(report["nfe"][-1])

    states, evaluations = integrate(t)
    # The motion may leave an open curve and return between two of the times. It is then
    # outside at some of the times at which the integrator was outside.
    tried_times = [time for time in outside_times if start < time < end]
    if tried_times:
        more_times = np.union1d(t, tried_times)
        more_coordinates = integrate(more_times)[0][:, 0]
        is_outside = more_coordinates < low - tolerance
        is_outside |= more_coordinates > high + tolerance
        if np.any(is_outside):
            states[t >= more_times[np.argmax(is_outside)]] = np.nan
    return _tabulate_motion(model, t, states, evaluations)


def _generalised_force(
    model: StoredModel,
    configuration_values: list[float],
    x: float,
    dx: float,
    t: float,
) -> float:
    """Return the generalised force Q of all loads, from the torque that a motion needs.

    The simulation needs Q for the rates of momentum and work. The model has a function for
    the torque only. At zero acceleration the torque is 1/2 dB/dx (dx/dt)^2 - Q, with the
    inertia B.

    Parameters
    ----------
    model
        A reduced model along a curve of configurations.
    configuration_values
        B, dB/dx and the functions on which loads depend, at the coordinate x.
    x, dx
        The coordinate (rad) and its rate dx/dt.
    t
        The time, s.
    """
    inertia_derivative = configuration_values[1]
    torque = model.torque_from_values(configuration_values, x=x, dx=dx, ddx=0.0, t=t)
    return 0.5 * inertia_derivative * dx * dx - torque


def _tabulate_motion(
    model: StoredModel, t: Floats, states: Floats, evaluations: int
) -> TabulatedMotion:
    """Return the motion at all times, from the integrated states of a reduced model.

    A reduced model stores functions of a mechanism with one input along the curve of all
    configurations. This curve is closed, or open with two ends.

    Parameters
    ----------
    model
        The integrated model.
    t
        (n,) times, s.
    states
        (n, 3) coordinate x along the curve (rad), momentum sqrt(B) dx/dt with the inertia
        B, and work of the loads (J). Rows after the end of an open curve are NaN, or are
        set to NaN in place.
    evaluations
        Number of evaluations of the right-hand side.
    """
    # The heading has the names of the stored functions and the range of the coordinate.
    heading = model.heading
    message = ""
    if not heading.periodic:
        coordinates = states[:, 0]
        is_inside = (coordinates >= heading.low[0]) & (coordinates <= heading.high[0])
        outside_rows = np.flatnonzero(~is_inside)
        if len(outside_rows):
            first_outside = outside_rows[0]
            message = f"the curve ends before t = {t[first_outside]:.6g} s"
            states[first_outside:] = np.nan
    # Pair variables (joint angles) and their rates, in rows before the end of the curve.
    coordinates, momenta, work = states.T
    finite = np.isfinite(coordinates)
    # The rates dx/dt. Time derivatives of variables are derivatives with respect to x times
    # dx/dt.
    speeds = momenta[finite] / np.sqrt(model.inertia(coordinates[finite]))
    derivative_names = [heading.derivative(name) for name in heading.variables]
    values, value_rates = nans((2, len(t), len(heading.variables)))
    values[finite] = model.functions(heading.variables, coordinates[finite])
    derivatives = model.functions(derivative_names, coordinates[finite])
    value_rates[finite] = derivatives * speeds[:, None]
    # A model along a curve has one input.
    input_variable = heading.variables.index(f"theta_{heading.inputs[0]}")
    return TabulatedMotion(
        t=t,
        x=coordinates,
        values=values,
        value_rates=value_rates,
        q=values[:, input_variable],
        dq=value_rates[:, input_variable],
        kinetic=0.5 * momenta**2,
        work=work,
        message=message,
        evaluations=evaluations,
    )
