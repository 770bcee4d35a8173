"""A motion that follows from the loads: dense output, events, and what was checked."""

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
from spherekit.dynamics.inertia import inertia_matrix
from spherekit.dynamics.input_motion import InputMotion, only_column
from spherekit.dynamics.simulated_path import StatePath, Traced
from spherekit.dynamics.simulation_start import Problem
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
EndKind = Literal[
    "time",
    "joint_limit",
    "off_profile",
    "curvature",
    "singularity",
    "sticking",
    "locking",
    "lift_off",
    "no_inertia",
    "too_fast",
]

OVER = "the time asked for is over"

CROSSING = (
    "two curves of configurations cross here, so the loads do not say which way the "
    "mechanism goes on; start beyond the crossing, or ask for crossings to be passed"
)
NO_SERIES = (
    "a load has a value here but no series, as where exp overflows within it: write it by "
    "tanh, or take the NumPy engine"
)
JUMPS = "a load jumps or grows without bound here: smooth it, or give its time in switches"
NOISE = (
    "the noise of the loads, or of rates near a crossing of curves, exceeds the tolerance: "
    "no step is short enough to go on in; smooth the loads, or raise the tolerance"
)
LOCKING = (
    "bearings lock here: their friction raises the reactions it follows from by as much as "
    "it is, so rigid links do not say what it is; give them a smaller coefficient or "
    "radius, or set them farther apart"
)
NO_INERTIA = (
    "the equivalent inertia goes to zero here: no link with mass moves together with the "
    "input, and the mechanism would go on infinitely fast; give mass to links that move"
)

VANISHED = 1e-6
"""An inertia that is smaller than this part of its largest where steps end has vanished."""

UNBALANCED = 1000.0
"""Tolerances by which a step may change the momentum without a load that does.

The error of NumPy's steps is measured by the last coefficients of their series, which are
up to 94 times as large.
"""


@dataclass(frozen=True)
class Event:
    """What happened at time `t` (s), at the variables of the `inputs` (rad).

    dead_centre: the only input's variable turns back though the mechanism moves on; type_2:
    several inputs do not hold the mechanism; crossing: it went straight on where sets of
    configurations cross; rest: a mechanism with one input stands still;
    stop: a pair reached its joint limit; switch: a load has a kink; lift_off: a one-sided
    contact presses no more.
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
class SimulationEnd:
    """Why a simulation ended, and when (s); `time` is the end that was asked for."""

    kind: EndKind
    t: float
    message: str


def stop_end(t: float, pair: str, value: float) -> SimulationEnd:
    """Return the end at a stop of a pair whose variable is `value` (rad)."""
    return SimulationEnd(
        "joint_limit", t, f"pair {pair} reached its joint limit at {value:.6g} rad"
    )


def too_many(steps: int) -> str:
    """Return what to do where this many steps are not enough."""
    return (
        f"{steps} steps are not enough; the loads change the speed too fast: raise the "
        "speed that smooths friction, or the tolerance, or simulate a shorter time"
    )


def given_up(
    equation: EquationOfMotion, path: StatePath, t: float, why: str
) -> SimulationEnd:
    """Return the end where no step is short enough: `why`, or the inertia has vanished."""
    traced = path.at(np.append(path.starts[path.chosen], t))
    motion = equation.compute_motion(
        traced.states[:, : equation.variable_count], traced.frames
    )
    sizes = np.linalg.eigvalsh(inertia_matrix(equation.mechanism, motion))
    if sizes[-1, 0] < VANISHED * np.max(sizes):
        return SimulationEnd("no_inertia", t, NO_INERTIA)
    return SimulationEnd("too_fast", t, why)


def cannot_leave(problem: Problem, why: str) -> SolveError:
    """Return the error of a motion that has not even a first step."""
    return SolveError(
        f"{problem.equation.mechanism.name}: the motion cannot leave its start: {why}"
    )


Forecast = Mapping[str, float]
"""What each engine was expected to take for what is left (s), compiling included."""


@dataclass(frozen=True)
class EngineReport:
    """Which engine found a simulation, and what that cost.

    `reason` says why it was this one. `compile_seconds` is what compiling took now, 0
    where it had been compiled before; `seconds` what solving took; `forecast` what the
    choice went by, None where there was none to make.
    """

    name: Literal["numpy", "compiled"]
    reason: str
    compile_seconds: float
    seconds: float
    steps: int
    forecast: Forecast | None = None


@dataclass(frozen=True)
class Checks:
    """What a simulation says about its own errors.

    `energy` (J): largest difference of kinetic energy gained and work of the loads;
    `energy_scale` (J): largest of both; `power` (W): largest difference of the rate of
    kinetic energy and the power of the loads along the dense output; `momentum`: largest
    part of the momentum that such a difference would be, did it last its step; `closure`
    (rad):
    largest closure residual, before it was taken out; `error` (rad): largest difference
    of a pair variable from a tighter run, None unless it was asked for.
    """

    energy: float
    energy_scale: float
    power: float
    momentum: float
    closure: float
    error: float | None = None


@dataclass(frozen=True)
class History(InputMotion):
    """A simulation at n times, rows in order of time.

    `t` s; `inputs`, `input_rates`, `input_accelerations` (n, inputs) rad and s; `values`,
    `value_rates` (n, variables); `rotations` (n, links, 3, 3); `speed` (n, m) rates of the
    coordinates of the integration, of one freedom along the curve, 1/s; `M` (n, masses, m,
    m) and `Q` (n, m, loads) link by link and load by load, in these coordinates; `kinetic`
    J; `power` (n, loads) W; `work` (n, loads) J since the start; `residual` rad.
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
    """The solution of the direct problem, kept as far as it went.

    `path` gives the states at any time; `events` are what happened; `end` says why it
    ended, `engine` what found it; `error` see `Checks`; `tolerance` what was asked for,
    None where steps are not made for one.
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
        """What says that the tolerance is missed, None if nothing does.

        The balance of power always can; the error only where it was asked for.
        """
        if self.tolerance is None:
            return None
        if self.error is not None and not self.error <= self.tolerance:
            said = (
                f"its error is {self.error:.1e} rad"
                if np.isfinite(self.error)
                else "it ends in another way with a smaller tolerance"
            )
        elif not self.checks.momentum <= UNBALANCED * self.tolerance:
            said = (
                f"the power of the loads and the kinetic energy differ by "
                f"{self.checks.power:.1e} W"
            )
        else:
            return None
        return (
            f"the simulation misses its tolerance of {self.tolerance:.1e} rad: {said}; "
            "simulate a shorter time, smooth the loads more, or ask for less"
        )

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with its input and with all loads that acted."""
        return self.equation.mechanism

    @property
    def start(self) -> float:
        """The first time, s."""
        return float(self.path.starts[0])

    @checked(SolveError)
    def at(self, t: ArrayLike) -> History:
        """Return the motion at times t (n,) in s, any order, within [start, end.t].

        Raises
        ------
        SolveError
            If a time lies outside.
        """
        equation = self.equation
        driven = list(self.driven)
        times = np.atleast_1d(np.asarray(t, dtype=float))
        traced, dynamics = self._at(times, second=True)
        motion = dynamics.motion
        masses = dynamics.masses
        speed = dynamics.speed
        assert masses is not None
        bend = np.einsum("nijv,ni,nj->nv", motion.second, speed, speed)
        rates = rates_by_time(motion, speed)
        second = rates_by_time(motion, dynamics.accelerations) + bend
        return History(
            t=times,
            inputs=motion.values[:, driven],
            input_rates=rates[:, driven],
            input_accelerations=second[:, driven],
            values=motion.values,
            value_rates=rates,
            rotations=motion.rotations,
            speed=speed,
            M=masses.M_parts,
            Q=dynamics.forces,
            kinetic=0.5 * np.sum(traced.states[:, equation.momenta] ** 2, axis=1),
            power=dynamics.power,
            work=traced.states[:, equation.works],
            residual=equation.closure.at(traced.states[:, : equation.variable_count]).gap,
        )

    @checked(SolveError)
    def moments(self, t: ArrayLike) -> JointReactions:
        """Return the moments that every pair transmits at times (n,), in pair axes."""
        times = np.atleast_1d(np.asarray(t, dtype=float))
        _, dynamics = self._at(times, second=True)
        timing = Timing(times, dynamics.speed, dynamics.accelerations)
        none = np.zeros_like(dynamics.speed)
        return compute_reactions(
            DrivenState(self.mechanism, dynamics.motion, timing, none, dynamics.carried)
        )

    @cached_property
    def checks(self) -> Checks:
        """The balance of energy and power, closure, and the error if it was asked for."""
        path = self.path
        equation = self.equation
        starts = path.starts[path.chosen]
        lengths = path.lengths[path.chosen]
        # Not at the ends of steps, where loads may jump.
        t = np.concatenate([starts + x * lengths for x in (0.03, 0.35, 0.7)])
        t = np.append(np.minimum(t, self.end.t), self.end.t)
        traced, dynamics = self._at(t)
        states = traced.states
        closed = equation.closure.at(states[:, : equation.variable_count])
        momenta = states[:, equation.momenta]
        kinetic = 0.5 * np.sum(momenta**2, axis=1)
        work = np.sum(states[:, equation.works], axis=1)
        missed = traced.rates[:, equation.momenta] - dynamics.momentum_rates
        missed[t >= self.end.t] = 0.0
        sizes = np.append(np.linalg.norm(momenta, axis=1), dynamics.roots.sizes)
        push = np.linalg.norm(missed, axis=1)
        steps = np.append(np.tile(lengths, 3), 0.0)
        balance = kinetic - work
        return Checks(
            energy=float(max_abs(balance - balance[0])),
            energy_scale=float(max(np.max(kinetic), max_abs(work))),
            power=float(max_abs(np.vecdot(momenta, missed))),
            momentum=float(np.max(push * steps) / np.nanmax(sizes)),
            closure=max(path.drift, float(np.max(closed.gap))),
            error=self.error,
        )

    def _at(self, t: Floats, second: bool = False) -> tuple[Traced, StateDynamics]:
        """Return the states of the dense output, and forces there."""
        low = self.start
        high = self.end.t
        slack = 1e-12 * max(abs(high), 1.0)
        if not np.all((t >= low - slack) & (t <= high + slack)):
            raise SolveError(
                f"{self.mechanism.name}: the simulation runs from {low:.6g} to "
                f"{high:.6g} s ({self.end.message}), but {np.min(t):.6g} to "
                f"{np.max(t):.6g} s are asked for"
            )
        t = np.clip(t, low, high)
        traced = self.path.at(t)
        whole = TURN * traced.turns
        return traced, self.equation.evaluate(
            t, traced.states, traced.frames, whole, second
        )
