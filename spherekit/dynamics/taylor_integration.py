"""A run of the compiled equation of motion, kept as the Taylor series of its steps.

The integrator's tolerance is relative to the largest element of its state. So that a run
stays accurate over thousands of turns, every few steps angles are reduced by whole turns,
the work done is set aside, and the unit of momentum grows with the momentum. The loops
open by little more than rounding, but that adds up, so they are closed now and then.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN
from spherekit.dynamics.compiled_equation import CompiledEquation
from spherekit.dynamics.motion_expressions import ParameterLayout
from spherekit.dynamics.step_probes import first_missed
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.mechanism import Mechanism
from spherekit.progress import ProgressReporter
from spherekit.symbolic.compiler import MOST_SWITCHES, EventKind, Integrator

STRETCH = 50
"""Steps after which the state is reduced."""

CLOSED = 20
"""Stretches after which the configuration is put back onto its curve."""

MOST_STEPS = 300_000
"""Their series take about 2 kB each."""

SHORTEST = 1e-11
"""Steps shorter than this part of the whole time end a run, by either engine."""

CROSSED = 1e-5
"""Where |tau| is smaller than this part of its largest, curves cross, for either engine.

A configuration off its curve by d misses a crossing by sqrt(d), so this suits
`spherekit.dynamics.compiled_equation.LOOSEST`.
"""

MISSED = 100.0
"""Tolerances of a step by which its series may miss the momentum within it."""

SHORTER, SHRUNK, GROWN = 0.9, 0.03, 4.0
"""The part of a step before the first place that missed which is tried next, the least part
of the step, and by what those after it are longer."""

_FULL_TURN_REST = 2.4492935982947064e-16
"""2 pi less its nearest float64."""

_Step = tuple[float, float, Floats, int, Floats]
"""The start of a step, its length and its series; how many events were seen before it, and
the sides of the switches then."""

RunEnd = Literal[
    "time",
    "joint_limit",
    "singularity",
    "coordinates",
    "sticking",
    "too_fast",
    "too_many",
    "not_finite",
]


@dataclass(frozen=True)
class Stretch:
    """Some steps between two reductions of the state.

    `starts`, `lengths` (k,) s; `series` (k, states, order + 1) Taylor coefficients;
    `turns` (variables,), `unit` of momentum and `work` (loads,) J set aside.
    """

    layout: ParameterLayout
    starts: Floats
    lengths: Floats
    series: Floats
    turns: Floats
    unit: float
    work: Floats

    def at(self, t: Floats) -> tuple[Floats, Floats]:
        """Return states and their rates (n, states) at times t (n,).

        The variables less the whole turns, the momenta and the work of each load, in units
        of the SI.
        """
        step = np.searchsorted(self.starts[1:], t, side="right")
        value, rate = _powers(self.series[step], t - self.starts[step])
        for array in (value, rate):
            array[:, self.layout.momenta] *= self.unit
            array[:, self.layout.works] *= self.unit**2
        value[:, self.layout.works] += self.work
        return value, rate


@dataclass(frozen=True)
class Run:
    """A run as far as it came: its stretches, events, and why and when it ended (s).

    Of events it has the time (s), the kind, and the variable that it is about or -1.
    `drift` is the largest closure residual (rad) that was taken out, `largest` the largest
    measure of independence.
    """

    equation: CompiledEquation
    stretches: tuple[Stretch, ...]
    passages: tuple[tuple[float, EventKind, int], ...]
    end: RunEnd
    time: float
    drift: float
    largest: float

    @property
    def last(self) -> Floats:
        """The state (states,) at its end, less the turns of the last stretch."""
        return self.stretches[-1].at(np.array([self.time]))[0][0]


def _powers(series: Floats, h: Floats) -> tuple[Floats, Floats]:
    """Return values and rates (n, states) of Taylor series (n, states, order + 1) at h."""
    h = h[:, None]
    value = series[:, :, -1]
    rate = np.zeros_like(value)
    for order in range(series.shape[2] - 2, -1, -1):
        rate = rate * h + value
        value = value * h + series[:, :, order]
    return value, rate


class Integration:
    """A run while it goes on, of an equation compiled for this mechanism.

    Parameters
    ----------
    equation, mechanism
        The mechanism's tables and joint limits are used.
    values, turns, momenta
        (variables,) a closed configuration (rad) less whole turns, and (m,) the momenta: of
        one freedom sqrt(B) u, positive in the sense of the homogeneous rates.
    unit
        A momentum of usual size, not zero.
    close
        Puts a configuration back onto its curve, and says what its residual was.
    crossed
        Root of the part of the largest measure of independence at which the run ends.
    before, gap
        The run that this one goes on from, if any, and the closure residual (rad) that was
        taken out between them.
    """

    def __init__(
        self,
        equation: CompiledEquation,
        mechanism: Mechanism,
        values: Floats,
        turns: Floats,
        momenta: Floats,
        unit: float,
        close: Callable[[Floats], tuple[Floats, float]],
        crossed: float,
        before: Run | None,
        gap: float,
    ) -> None:
        self.equation = equation
        self.close, self.crossed = close, crossed
        self.tables = [x for x in mechanism.loads if isinstance(x, TorqueTable)]
        self.count = len(values)
        self.layout = equation.layout
        self.turns, self.work = turns, np.zeros(len(mechanism.loads))
        self.time, self.drift = 0.0, gap
        self.largest = float(equation.measure(values[None])[0])
        if before is not None:
            self.time, self.drift = before.time, max(before.drift, gap)
            last = before.equation
            self.largest *= before.largest / float(last.measure(values[None])[0])
            self.work = before.last[last.layout.works]
        self.unit = max(unit, float(np.linalg.norm(momenta)))
        self.turning = np.isin(np.arange(self.count), [*mechanism.angles.values()])
        self.stops = [v for stop in mechanism.joint_limits for v in (stop.low, stop.high)]
        self.sides = np.zeros(len(equation.layout.conditions))
        self.first = np.concatenate([values, momenta / self.unit, np.zeros_like(self.work)])
        self.stretches: list[Stretch] = []
        self.longest = np.inf
        """Longest step that is tried, where longer ones missed what a load does."""

    def run(self, targets: Sequence[float]) -> Run:
        """Return the run to the last of rising times (s) between which no load has a knot.

        Runs of one equation in several threads wait for each other.
        """
        integrator, steps = self.equation.integrator, 0
        working = ProgressReporter("simulating")
        with self.equation.lock:
            self._set_sides(targets[0])
            integrator.start(self.first, self.time, self._parameters(targets[0]))
            for target in targets:
                end: RunEnd | None = None
                while end is None:
                    taken, end = self._stretch(integrator, target, SHORTEST * targets[-1])
                    steps += taken
                    working.tell(lambda: f"{self.time:.4g} of {targets[-1]:.6g} s")
                    if end is None and steps >= MOST_STEPS:
                        end = "too_many"
                if end != "time":
                    break
            assert end is not None
            passed = ((t, integrator.events[which]) for which, t in integrator.seen)
            return Run(
                self.equation,
                tuple(self.stretches),
                tuple((t, event.kind, event.variable) for t, event in passed),
                end,
                self.time,
                self.drift,
                self.largest,
            )

    @property
    def least(self) -> float:
        """The measure of independence at which the run ends."""
        return self.crossed**2 * self.largest

    def _stretch(
        self, integrator: Integrator, target: float, shortest: float
    ) -> tuple[int, RunEnd | None]:
        self._reduce(integrator, target)
        steps: list[_Step] = []
        looks = self.equation.steep is not None
        right = tried = 0
        end: RunEnd | None = None
        while end is None and len(steps) < STRETCH:
            tried += 1
            start, seen = integrator.time, len(integrator.seen)
            longest = target - start
            limited = self.longest < longest
            sides = self._constants(integrator)[self.layout.side :] if looks else self.sides
            outcome, length = integrator.step(min(longest, self.longest))
            if outcome == "not_finite":
                end = "not_finite"
            elif length > 0.0 or outcome == "event":
                self.time = integrator.time
                steps.append((start, length, integrator.coefficients, seen, sides))
            if outcome == "limit" and not limited:
                end = "time"
            elif outcome == "event":
                end = self._event(integrator)
            elif length < shortest and outcome in ("step", "limit"):
                end = "too_fast"
            if not looks or not (limited or end is not None or len(steps) == STRETCH):
                continue
            agree, self.longest = self._agree(integrator, steps[right:])
            right += agree
            if right < len(steps):
                end = None if self.longest > shortest else "too_fast"
                self._go_back(integrator, steps[right])
                del steps[right:]
            elif limited and outcome == "limit":
                self.longest = GROWN * length
        if steps:
            starts, lengths, series = (
                np.array([step[k] for step in steps]) for k in range(3)
            )
            kept = self.turns, self.unit, self.work
            self.stretches.append(Stretch(self.layout, starts, lengths, series, *kept))
            first = self.equation.measure(series[:, : self.count, 0])
            self.largest = max(self.largest, float(np.max(first)))
        return tried, end

    def _constants(self, integrator: Integrator) -> Floats:
        """Return the parameters, 0 for those beyond the last that occurs."""
        given = integrator.parameters
        beyond = self.layout.side + len(self.sides) - len(given)
        return np.pad(given, (0, beyond))

    def _go_back(self, integrator: Integrator, step: _Step) -> None:
        """Return to the start of a step."""
        self.time, _, series, count, sides = step
        constants, seen = self._constants(integrator), integrator.seen[:count]
        constants[self.layout.side :] = sides
        integrator.start(series[:, 0], self.time, constants)
        integrator.seen.extend(seen)

    def _agree(self, integrator: Integrator, steps: Sequence[_Step]) -> tuple[int, float]:
        """Return how many steps agree with what the loads do, and how long the next may be.

        After one that does not agree the next ends before it missed, otherwise anywhere.
        """
        if not steps:
            return 0, np.inf
        starts, lengths, series, _, sides = (
            np.array(column) for column in zip(*steps, strict=True)
        )
        steep, constants = self.equation.steep, self._constants(integrator)
        assert steep is not None

        def look(step: Indices, x: Floats) -> tuple[Floats, Floats]:
            h = x * lengths[step]
            states, rates = _powers(series[step], h)
            given = np.repeat(constants[: self.layout.side, None], len(x), axis=1)
            rows = states.T, (starts[step] + h)[None], given, sides[step].T
            values = np.split(steep(np.concatenate(rows)), [self.layout.freedoms])
            missed = np.abs(rates[:, self.layout.momenta] - values[0].T)
            missed = np.max(missed, axis=1) * lengths[step]
            return missed / (MISSED * self.equation.tolerance), values[1].T

        for agree, part in enumerate(first_missed(look, len(starts))):
            if part <= 1.0:
                return agree, float(max(SHORTER * part, SHRUNK) * lengths[agree])
        return len(starts), np.inf

    def _event(self, integrator: Integrator) -> RunEnd:
        kind = integrator.events[integrator.seen[-1][0]].kind
        if kind == "switch":
            return "too_many" if len(integrator.seen) >= MOST_SWITCHES else "sticking"
        return kind if kind in ("coordinates", "joint_limit") else "singularity"

    def _reduce(self, integrator: Integrator, target: float) -> None:
        """Take whole turns off the angles, set work aside, adapt the unit of momentum.

        Tables run along lines until the next knot.
        """
        state = integrator.state
        values = state[: self.count]
        turns = np.round(values / TURN) * self.turning
        values -= turns * TURN
        values -= turns * _FULL_TURN_REST
        if self.stretches and len(self.stretches) % CLOSED == 0:
            values[:], gap = self.close(values)
            self.drift = max(self.drift, gap)
        self.turns = self.turns + turns
        works, momenta = state[self.layout.works], state[self.layout.momenta]
        self.work = self.work + works * self.unit**2
        works[:] = 0.0
        size = float(np.linalg.norm(momenta))
        if size > 1.0:
            self.unit *= size
            momenta /= size
        self.sides = self._constants(integrator)[self.layout.side :]
        given = integrator.parameters
        given[:] = self._parameters(target)[: len(given)]

    def _parameters(self, target: float) -> Floats:
        # Within the interval, for at its ends a periodic table may jump.
        lines, span = [self.time], target - self.time
        for table in self.tables:
            one, other = table.at(self.time + span * np.array([0.25, 0.75]))
            lines += [1.5 * one - 0.5 * other, 2.0 * (other - one) / span]
        scales = self.unit, 1.0 / self.unit, self.least
        return np.array([*self.turns, *scales, *self.stops, *lines, *self.sides])

    def _set_sides(self, target: float) -> None:
        """Find the signs of the loads' conditions at the start.

        Where a condition is zero, that towards which it goes; positive if it stays.
        """
        if self.equation.conditions is None:
            return
        count = len(self.sides)
        for k in range(count):
            given = np.concatenate([self.first, [self.time], self._parameters(target)])
            values = np.sign(self.equation.conditions(given[:, None])[:, 0])
            self.sides[k] = values[k] or values[count + k] or 1.0
