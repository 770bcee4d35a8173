"""A motion that follows from the loads: dense output, events, and what was checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, final

import numpy as np

from spherekit.dynamics.collocation import Step
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.kinematics import by_arc_length
from spherekit.dynamics.state import Dynamics, EquationOfMotion
from spherekit.errors import SolveError
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

EventKind = Literal["dead_centre", "rest", "stop", "switch"]
EndKind = Literal["time", "stop", "off_profile", "curvature", "singularity", "too_fast"]


@final
@dataclass(frozen=True)
class Event:
    """What happened at time `t` (s), at the input's variable `q` (rad).

    dead_centre: the input's variable turns back though the mechanism moves on; rest: the
    mechanism stands still; stop: a pair reached its stop; switch: a load has a kink.
    """

    kind: EventKind
    t: float
    q: float
    pair: str


@final
@dataclass(frozen=True)
class End:
    """Why a simulation ended, and when (s); `time` is the end that was asked for."""

    kind: EndKind
    t: float
    message: str


@final
@dataclass(frozen=True)
class Checks:
    """What a simulation says about its own errors.

    `energy` (J): largest difference of kinetic energy gained and work of the loads;
    `energy_scale` (J): largest of both; `power` (W): largest difference of the rate of
    kinetic energy and the power of the loads along the dense output; `closure` (rad):
    largest closure residual before it was taken out; `error` (rad): largest difference
    of a pair variable from a tighter run, None unless it was asked for.
    """

    energy: float
    energy_scale: float
    power: float
    closure: float
    error: float | None = None


@final
@dataclass(frozen=True)
class History:
    """A simulation at n times, rows in order of time.

    `t` s; `q`, `dq`, `ddq` of the input, rad and s; `values`, `value_rates`
    (n, variables); `rotations` (n, links, 3, 3); `speed` along the curve, 1/s; `B`
    (n, masses) and `Q` (n, loads) link by link and load by load, per unit arc length;
    `kinetic` J; `power` (n, loads) W; `work` (n, loads) J since the start; `residual`
    rad.
    """

    t: Floats
    q: Floats
    dq: Floats
    ddq: Floats
    values: Floats
    value_rates: Floats
    rotations: Floats
    speed: Floats
    B: Floats
    Q: Floats
    kinetic: Floats
    power: Floats
    work: Floats
    residual: Floats


@final
@dataclass(frozen=True)
class Travelled:
    """An accepted step with the tangents (k, variables) of the curve along it."""

    step: Step
    tangents: Floats


@final
@dataclass(frozen=True)
class Simulation:
    """The solution of the direct problem, kept as far as it went.

    `path` are the steps in order of time; `events` what happened; `end` why it ended;
    `evaluations` counts calls of the right-hand side.
    """

    equation: EquationOfMotion
    driven: int
    path: tuple[Travelled, ...]
    events: tuple[Event, ...]
    end: End
    drift: float
    evaluations: int
    error: float | None = None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with its input and with all loads that acted."""
        return self.equation.mechanism

    @property
    def start(self) -> float:
        """The first time, s."""
        return self.path[0].step.start

    def at(self, t: "Floats | Sequence[float]") -> History:
        """Return the motion at times t (n,) in s, any order, within [start, end.t].

        Raises
        ------
        SolveError
            If a time lies outside.
        """
        t = np.atleast_1d(np.asarray(t, dtype=float))
        states, _, found = self._at(t)
        equation, variables = self.equation, self.equation.variables
        values, speed = states[:, :variables], found.speed
        second = by_arc_length(equation.closure, values)
        signs = np.sign(np.sum(second.rates * found.motion.rates, axis=1))
        motion = second.turned(signs)
        masses = inertia(equation.mechanism, motion)
        drive = np.sum(found.forces, axis=1) - 0.5 * masses.dB * speed**2
        along, bend = motion.rates[:, self.driven], motion.second[:, self.driven]
        gap = equation.closure.residual(*equation.closure.place(values))
        return History(
            t=t,
            q=states[:, self.driven],
            dq=along * speed,
            ddq=along * drive / masses.B + bend * speed**2,
            values=values,
            value_rates=motion.rates * speed[:, None],
            rotations=motion.rotations,
            speed=speed,
            B=masses.B_parts,
            Q=found.forces,
            kinetic=0.5 * states[:, variables] ** 2,
            power=found.forces * speed[:, None],
            work=states[:, variables + 1 :],
            residual=np.max(np.abs(gap), axis=1, initial=0.0),
        )

    @cached_property
    def checks(self) -> Checks:
        """The balance of energy and power, closure, and the error if it was asked for."""
        ends = np.array([[p.step.start, p.step.length] for p in self.path])
        t = np.unique(np.concatenate([ends[:, 0] + x * ends[:, 1] for x in (0, 0.3, 0.7)]))
        t = np.append(t[t < self.end.t], self.end.t)
        states, rates, found = self._at(t)
        momentum = states[:, self.equation.variables]
        kinetic = 0.5 * momentum**2
        work = np.sum(states[:, self.equation.variables + 1 :], axis=1)
        gained = kinetic - kinetic[0]
        power = momentum * rates[:, self.equation.variables]
        power = power - found.speed * np.sum(found.forces, axis=1)
        return Checks(
            energy=float(np.max(np.abs(gained - work))),
            energy_scale=float(max(np.max(kinetic), np.max(np.abs(work)))),
            power=float(np.max(np.abs(power))),
            closure=self.drift,
            error=self.error,
        )

    def _at(self, t: Floats) -> tuple[Floats, Floats, Dynamics]:
        """Return states and their rates (n, states) of the dense output, and forces."""
        low, high = self.start, self.end.t
        slack = 1e-12 * max(abs(high), 1.0)
        if not np.all((t >= low - slack) & (t <= high + slack)):
            raise SolveError(
                f"{self.mechanism.name}: the simulation runs from {low:.6g} to "
                f"{high:.6g} s ({self.end.message}), but {np.min(t):.6g} to "
                f"{np.max(t):.6g} s are asked for"
            )
        t = np.clip(t, low, high)
        starts = np.array([item.step.start for item in self.path])
        owner = np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)
        width = len(self.path[0].step.state)
        states, rates = np.empty((len(t), width)), np.empty((len(t), width))
        along = np.empty((len(t), self.equation.variables))
        for number in np.unique(owner):
            rows, item = np.flatnonzero(owner == number), self.path[number]
            states[rows], rates[rows] = item.step.at(t[rows]), item.step.rate(t[rows])
            place = (t[rows] - item.step.start) / item.step.length * len(item.tangents)
            nearest = np.clip(place.astype(int), 0, len(item.tangents) - 1)
            along[rows] = item.tangents[nearest]
        return states, rates, self.equation.at(t, states, along)
