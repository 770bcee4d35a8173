"""The result of a simulation: the motion at any time, events, and checks of its errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.dynamics.equation_of_motion import EquationOfMotion, StateDynamics
from spherekit.dynamics.generalised_forces import rates_by_time
from spherekit.dynamics.input_motion import InputMotion, only_column
from spherekit.dynamics.simulated_path import PathStates, StatePath
from spherekit.dynamics.simulation_end import SimulationEnd
from spherekit.dynamics.transmitted_forces import (
    DrivenState,
    JointReactions,
    compute_reactions,
)
from spherekit.errors import SolveError
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.timing import Timing
from spherekit.wording import counted

EventKind = Literal[
    "dead_centre", "type_2", "crossing", "rest", "joint_limit", "switch", "lift_off"
]
"""Kinds of events; see `Event`."""

MAX_MOMENTUM_ERROR_RATIO = 1000.0
"""Largest momentum error of a step, relative to the tolerance of the simulation.

A simulation with a larger error misses its tolerance. The momentum error of an accepted
step is an error of dp/dt times the length of the step. It may exceed the tolerance: the
NumPy engine divides such an error by 94 (`numpy_engine.ERROR_DIVISOR`) to estimate the
error of a step. Larger: missed tolerances are not reported. Smaller: accurate simulations
are reported as inaccurate.
"""

BALANCE_FRACTIONS = (0.03, 0.35, 0.7)
"""Fractions of each step at which the balances of energy and power are computed.

They are not at the ends of steps, where loads may jump.
"""

TIME_SLACK_RATIO = 1e-12
"""Largest time by which a requested time may be outside of the simulation because of
rounding, relative to the end time. Larger: times outside are moved to the ends without a
message."""

Forecast = Mapping[str, float]
"""Time (s) that each engine is expected to need for the rest, compiling included."""


@dataclass(frozen=True)
class Event:
    """An event of a simulation.

    Attributes
    ----------
    kind
        - "dead_centre": the only input reverses while the mechanism moves on.
        - "type_2": several inputs do not determine the motion.
        - "crossing": the simulation passed a configuration in which two curves (with
          several inputs, surfaces) of configurations cross.
        - "rest": a mechanism with one input stands still.
        - "joint_limit": a pair (joint) reached its limit.
        - "switch": a load changes abruptly, for example where it is switched on. This
          event is also reported at the times that the user passes as `switches`, and at
          the knots (listed times) of torque tables.
        - "lift_off": a one-sided contact loses its pressure.
    t
        The time, s.
    inputs
        The angle of each input, rad.
    pair
        Name of the pair to which the event belongs, or empty.
    """

    kind: EventKind
    t: float
    inputs: tuple[float, ...]
    pair: str

    @property
    def q(self) -> float:
        """The variable of the only input (rad); `SolveError` with several."""
        return float(only_column(np.array(self.inputs)))


@dataclass(frozen=True)
class EngineReport:
    """The engine that computed a simulation, and the computing time.

    Attributes
    ----------
    name
        "numpy" for collocation with NumPy, "compiled" for Taylor series by heyoka.
    reason
        The reason why this engine was chosen, in words.
    compile_seconds
        Computing time for compiling the equation of motion, s; 0 if the equation had been
        compiled before.
    seconds
        Computing time for solving the equation of motion, s.
    steps
        Number of integration steps.
    forecast
        The expected computing times by which the engine was chosen. None if there was no
        choice.
    """

    name: Literal["numpy", "compiled"]
    reason: str
    compile_seconds: float
    seconds: float
    steps: int
    forecast: Forecast | None = None


@dataclass(frozen=True)
class Checks:
    """Estimates of the errors of a simulation, to judge how accurate it is.

    The momenta are p = R u. Here u are the rates of the coordinates, and R is the symmetric
    root of the inertia matrix M = R R, so that the kinetic energy is p^2 / 2.

    Attributes
    ----------
    energy
        Largest difference between the gain of kinetic energy and the work of the loads, J.
    energy_scale
        Largest kinetic energy or work of the loads at any time, J.
    power
        Largest difference between the rate of the kinetic energy and the power of the
        loads, W.
    momentum
        Largest error of the momenta that a single step adds. This error is the length of
        the step times the error of dp/dt. The error of dp/dt is its value in the computed
        path minus its value by the equation of motion. The result is divided by the largest
        momentum, or by the momentum at coordinate rates of 1 rad/s if this is larger.
    closure
        Largest closure residual (opening of a loop), rad. Residuals that were removed by
        corrections during the integration are included.
    error
        Largest difference of a pair variable (joint angle) from a simulation with a smaller
        tolerance, rad. None if there is no such simulation.
    """

    energy: float
    energy_scale: float
    power: float
    momentum: float
    closure: float
    error: float | None = None


@dataclass(frozen=True)
class History(InputMotion):
    """The motion, forces and energies of a simulation at n times.

    Some quantities belong to the m coordinates of the integration, where m is the number of
    degrees of freedom. With one degree of freedom the coordinate is the arc length of the
    curve of configurations in the space of all pair variables (joint angles). With several
    degrees of freedom, the rate of each coordinate is a weighted sum of the rates of the
    pair variables. Each engine chooses these weights itself, and may change them on the
    way. So `speed`, `M` and `Q` depend on the engine; `kinetic`, `power` and `work` do not.

    Attributes
    ----------
    t
        (n,) times, s.
    inputs, input_rates, input_accelerations
        (n, inputs) values (rad), rates (rad/s) and accelerations (rad/s2) of the inputs.
    values, value_rates
        (n, variables) pair variables (rad) and their rates (rad/s).
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes.
    speed
        (n, m) rates of the coordinates, rad/s.
    M
        (n, masses, m, m) contribution of each link with mass to the inertia matrix.
    Q
        (n, m, loads) generalised force of each load.
    kinetic
        (n,) kinetic energy, J.
    power, work
        (n, loads) power (W) of each load, and its work (J) since the start.
    residual
        (n,) closure residual (opening of a loop), rad.
    """

    t: Floats
    inputs: Floats
    input_rates: Floats
    input_accelerations: Floats
    values: Floats
    value_rates: Floats
    rotations: Floats
    speed: Floats
    M: Floats
    Q: Floats
    kinetic: Floats
    power: Floats
    work: Floats
    residual: Floats

    def __repr__(self) -> str:
        return f"<History: {counted(len(self.t), 'time')}>"


@dataclass(frozen=True)
class Simulation:
    """The simulated motion of a mechanism under its loads, from the start to the end.

    Attributes
    ----------
    equation
        The equation of motion.
    driven
        Indices of the inputs among the pair variables.
    path
        The states (variables, momenta, works of loads) at any time.
    events
        Events in order of time, such as dead centres.
    end
        Time and reason of the end.
    engine
        The engine that computed the simulation, and its cost.
    error
        Largest difference of a pair variable from a simulation with a smaller tolerance,
        rad. None if there is no such simulation.
    tolerance
        The tolerance (rad) that the user requested, or None. The property `missed` says
        whether the simulation is less accurate.
    """

    equation: EquationOfMotion
    driven: tuple[int, ...]
    path: StatePath
    events: tuple[Event, ...]
    end: SimulationEnd
    engine: EngineReport
    error: float | None = None
    tolerance: float | None = None

    def __repr__(self) -> str:
        return (
            f"<Simulation of {self.mechanism.name}: {self.start:g} to {self.end.t:.6g} s, "
            f"{self.end.message}; {counted(len(self.events), 'event')}, "
            f"{self.engine.steps} steps by "
            f"{self.engine.name}>"
        )

    @property
    def missed(self) -> str | None:
        """A message if the simulation misses its tolerance, otherwise None.

        A simulation misses its tolerance in two cases:

        - The attribute `error` exceeds the tolerance. It is the largest difference of a
          pair variable from a simulation with a smaller tolerance.
        - The relative error `checks.momentum` exceeds 1000 times the tolerance, taken as a
          number without unit. Each step of the integration adds an error to the momenta,
          and `checks.momentum` is the largest of these errors.
        """
        if self.tolerance is None:
            return None
        # `not error <= limit` is true for an error of NaN.
        if self.error is not None and not self.error <= self.tolerance:
            evidence = self._describe_difference(self.error)
        elif not self.checks.momentum <= MAX_MOMENTUM_ERROR_RATIO * self.tolerance:
            # The message states the error as a power, which users can compare with the
            # power of the loads.
            evidence = self._describe_power_error()
        else:
            return None
        return (
            f"the simulation misses its tolerance of {self.tolerance:.1e} rad: {evidence}; "
            "simulate a shorter time, smooth the loads more, or give a larger tolerance"
        )

    def _describe_difference(self, error: float) -> str:
        """Return a text on the difference (rad) from a simulation with a smaller tolerance.

        This estimate of the error is infinite if the two simulations end for different
        reasons.
        """
        if np.isfinite(error):
            return f"its error is {error:.1e} rad"
        return "it ends in another way with a smaller tolerance"

    def _describe_power_error(self) -> str:
        """Return a text on the error of the momenta, as a power (W).

        The error of dp/dt times the momentum p is an error of the rate of the kinetic
        energy p^2 / 2. As a power it can be compared with the powers of the loads.
        """
        return (
            f"the power of the loads and the kinetic energy differ by "
            f"{self.checks.power:.1e} W"
        )

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with its inputs and with all loads that acted."""
        return self.equation.mechanism

    @property
    def start(self) -> float:
        """The first time, s."""
        return float(self.path.starts[0])

    @checked(SolveError)
    def at(self, t: ArrayLike) -> History:
        """Return the motion at times t (n,) in s, in any order.

        The times are between the start of the simulation and the time `end.t` at which it
        ended.

        Raises
        ------
        SolveError
            If a time is outside of this range, or if t has more than one dimension.
        """
        equation = self.equation
        times = np.atleast_1d(np.asarray(t, dtype=float))
        # Accelerations need the second derivatives of the pair variables (joint angles)
        # with respect to the coordinates.
        path_states, dynamics = self._evaluate(times, second=True)
        # Rows are times. Columns are the pair variables, the momenta, and the work of each
        # load.
        states = path_states.states
        input_columns = list(self.driven)  # among the pair variables
        # Momenta are defined as p = R u, with the rates u of the coordinates and the
        # symmetric root R of the inertia matrix M = R R. The kinetic energy u M u / 2 is
        # p^2 / 2.
        momenta = states[:, equation.momenta]
        kinetic_energy = 0.5 * np.sum(momenta**2, axis=1)
        motion = dynamics.motion
        masses = dynamics.masses
        assert masses is not None
        value_rates = rates_by_time(motion, dynamics.speed)
        value_accelerations = _accelerations_by_time(dynamics)
        # Only the closure residual (opening of the loops) of these configurations is used.
        closed = equation.closure.linearise(states[:, : equation.variable_count])
        return History(
            t=times,
            inputs=motion.values[:, input_columns],
            input_rates=value_rates[:, input_columns],
            input_accelerations=value_accelerations[:, input_columns],
            values=motion.values,
            value_rates=value_rates,
            rotations=motion.rotations,
            speed=dynamics.speed,  # rates of the coordinates
            M=masses.M_parts,  # for each link with mass its part of the inertia matrix
            Q=dynamics.forces,
            kinetic=kinetic_energy,
            power=dynamics.power,
            work=states[:, equation.works],
            residual=closed.closure_residual,
        )

    @checked(SolveError)
    def moments(self, t: ArrayLike) -> JointReactions:
        """Return the moments that every pair transmits at times t (n,) in s."""
        times = np.atleast_1d(np.asarray(t, dtype=float))
        _, dynamics = self._evaluate(times, second=True)
        timing = Timing(times, dynamics.speed, dynamics.accelerations)
        # All torques of a simulation are loads. There are no driving torques besides.
        no_torques = np.zeros_like(dynamics.speed)
        return compute_reactions(
            DrivenState(
                self.mechanism, dynamics.motion, timing, no_torques, dynamics.carried
            )
        )

    @cached_property
    def checks(self) -> Checks:
        """Estimates of the errors of the simulation, see `Checks`.

        The simulation uses scaled momenta p, so that the kinetic energy is p^2 / 2. The
        computed path and the equation of motion give slightly different rates dp/dt. Their
        difference is the error of dp/dt. These errors are computed at several times, and
        the largest of each kind is returned:

        - Energy: the change of kinetic energy minus the work of the loads.
        - Momentum: the error of p that a step adds, which is the error of dp/dt times the
          length of the step. It is divided by the largest p, or by the p at coordinate
          rates of 1 rad/s if this is larger.
        - Power: p times the error of dp/dt, since the rate of p^2 / 2 is p dp/dt.
        - Closure: the angle by which a loop is open.
        """
        equation = self.equation
        t, step_lengths = self._choose_check_times()
        path_states, dynamics = self._evaluate(t)
        # Rows are times. Columns are the pair variables (joint angles), the momenta, and
        # the work of each load.
        states = path_states.states
        closed = equation.closure.linearise(states[:, : equation.variable_count])
        momenta = states[:, equation.momenta]
        kinetic = 0.5 * np.sum(momenta**2, axis=1)
        work = np.sum(states[:, equation.works], axis=1)
        balance = kinetic - work

        rate_errors = path_states.rates[:, equation.momenta] - dynamics.momentum_rates
        # Errors at the end are ignored. A load may jump there, or the inertia matrix may be
        # singular.
        rate_errors[t >= self.end.t] = 0.0
        power_errors = np.vecdot(momenta, rate_errors)
        momentum_errors = np.linalg.norm(rate_errors, axis=1) * step_lengths
        # Errors of the momenta are divided by the largest momentum. A mechanism at rest has
        # none, so momenta at rates of 1 rad/s are considered, too. The momenta are p = R u
        # with the coordinate rates u and the root R of the inertia matrix. If u has the
        # length 1 rad/s and is along an eigenvector of R, the size of p is the eigenvalue.
        momentum_scale = _choose_momentum_scale(momenta, dynamics.roots.eigenvalues)
        # The integration closes loops after each step. The path has stored the largest
        # opening before these corrections.
        closure_error = max(
            self.path.max_closure_residual, float(np.max(closed.closure_residual))
        )
        return Checks(
            energy=float(max_abs(balance - balance[0])),
            energy_scale=float(max(np.max(kinetic), max_abs(work))),
            power=float(max_abs(power_errors)),
            momentum=float(np.max(momentum_errors) / momentum_scale),
            closure=closure_error,
            error=self.error,  # difference from a more accurate simulation, if there is one
        )

    def _choose_check_times(self) -> tuple[Floats, Floats]:
        """Return times (n,) at which errors are computed, and (n,) lengths of their steps.

        The check times are three times within each step of a selection (`checked_steps`),
        and the end of the simulation. The end gets the step length 0.
        """
        starts = self.path.starts[self.path.checked_steps]
        lengths = self.path.lengths[self.path.checked_steps]
        # First the first time of every step, then the second, then the third.
        inner_times = np.concatenate([starts + x * lengths for x in BALANCE_FRACTIONS])
        # The last step may be longer than the simulation.
        inner_times = np.minimum(inner_times, self.end.t)
        step_lengths = np.tile(lengths, len(BALANCE_FRACTIONS))
        return np.append(inner_times, self.end.t), np.append(step_lengths, 0.0)

    def _evaluate(
        self, t: Floats, second: bool = False
    ) -> tuple[PathStates, StateDynamics]:
        """Return the states at times (n,) in s, and the motion and forces in these states.

        Parameters
        ----------
        t
            (n,) times, s.
        second
            Whether to compute second derivatives, from which accelerations follow.

        Returns
        -------
        The states, with angles reduced by whole turns, and the motion and forces.

        Raises
        ------
        SolveError
            If a time is outside of the simulation, or if `t` is not one-dimensional.
            Rounding errors are tolerated.
        """
        low = self.start
        high = self.end.t
        if t.ndim != 1:
            raise SolveError(
                f"{self.mechanism.name}: times: found an array of shape {t.shape}, "
                "expected a one-dimensional array of times in s"
            )
        slack = TIME_SLACK_RATIO * max(abs(high), 1.0)
        if not np.all((t >= low - slack) & (t <= high + slack)):
            raise SolveError(
                f"{self.mechanism.name}: the simulation runs from {low:.6g} to {high:.6g} "
                f"s ({self.end.message}), but {np.min(t):.6g} to {np.max(t):.6g} s were "
                "requested"
            )
        t = np.clip(t, low, high)
        path_states = self.path.evaluate(t)
        # States are stored without whole turns. Loads may depend on these turns (rad).
        turn_angles = TURN * path_states.turns
        return path_states, self.equation.evaluate(
            t,
            states=path_states.states,
            # The coordinates are as many as the degrees of freedom. The rate of coordinate
            # i is row i of these weights times the rates of the pair variables.
            rate_weights=path_states.rate_weights,
            whole_turns=turn_angles,
            needs_second_order=second,
        )


def _accelerations_by_time(dynamics: StateDynamics) -> Floats:
    """Return the accelerations (n, variables) of the pair variables, rad/s2.

    The pair variables v depend on the coordinates x, which have the rates u. So the
    accelerations are

        sum_i dv/dx_i du_i/dt + sum_ij d2v/(dx_i dx_j) u_i u_j.
    """
    motion = dynamics.motion
    u = dynamics.speed
    # Letters: n row, i j coordinates, v variable.
    at_constant_rates = np.einsum("nijv,ni,nj->nv", motion.second, u, u)
    return rates_by_time(motion, dynamics.accelerations) + at_constant_rates


def _choose_momentum_scale(momenta: Floats, root_eigenvalues: Floats) -> float:
    """Return the size relative to which errors of the momenta are judged.

    The size is the largest momentum during the simulation. For a mechanism at rest this
    would be zero. So the result is at least a typical momentum: the momentum at coordinate
    rates of 1 rad/s.

    Parameters
    ----------
    momenta
        (n, m) momenta p = R u at n times, with the rates u of m coordinates.
    root_eigenvalues
        (n, m) eigenvalues of R, the symmetric root of the inertia matrix. Each is the size
        of p if u has the length 1 rad/s and is along the eigenvector of this eigenvalue.
        NaN if the inertia matrix is not positive.
    """
    momentum_sizes = np.linalg.norm(momenta, axis=1)
    unit_momentum_sizes = root_eigenvalues.ravel()
    return float(np.nanmax(np.concatenate([momentum_sizes, unit_momentum_sizes])))
