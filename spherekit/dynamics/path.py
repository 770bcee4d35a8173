"""Where a simulation went: its states at any time, whichever engine found them.

Gauss collocation with all nodes of a step at once: few, long, vectorised steps.

The method of Gauss is the implicit Runge-Kutta method of highest order, 2 N at the ends
of steps with N nodes (Hairer, Norsett and Wanner 1993, II.7). Its equations are solved by
Picard iteration: the right-hand side is evaluated at all nodes in one call, which costs
an array code little more than one node. Within a step the solution is a polynomial of
degree N, and the last coefficients of its derivative say how well it is resolved.
What happens within a step are zeros of functions known at its nodes or as polynomials.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import final

import numpy as np
from numpy.polynomial import legendre

from spherekit.arrays import Floats
from spherekit.conventions import EPS
from spherekit.dynamics.coordinates import inertia
from spherekit.dynamics.start import variable_of
from spherekit.dynamics.state import EquationOfMotion, Roots
from spherekit.engine.equation import CompiledEquation
from spherekit.engine.integration import Run, Stretch
from spherekit.engine.system import mass_size
from spherekit.model.dynamics import Stop
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.numeric.zeros import ArrayRows, Function, zeros

NODES = 24
"""Measured: fewest evaluations on linkages at tolerances of 1e-7 to 1e-11."""

MOST_ITERATIONS = 40
MANY_ITERATIONS = 24
"""Steps that take more are shortened: iterations grow faster than the step."""

RENEWED = (1, 4, 9)
"""Iterations in which Newton's method for a stiff state finds its slope anew."""

DIFFERENCE = 1e-7
"""Part of a state's size by which it is moved to find that slope."""

CONTINUED = 12
"""Coefficients of the last step that are continued as the first guess of the next."""

SAFETY, GROWTH, SHRINKAGE = 0.8, 1.4, 0.35


@final
@dataclass(frozen=True)
class Gauss:
    """Nodes (N,) in [-1, 1] and the matrices of Gauss collocation.

    `to_series` (N, N) turns values at the nodes into Legendre coefficients; `integral`
    (N, N) gives the integrals from -1 to each node, from such values.
    """

    nodes: Floats
    to_series: Floats
    integral: Floats


@lru_cache(maxsize=4)
def gauss(count: int) -> Gauss:
    """Return the method with this number of nodes."""
    nodes, weights = legendre.leggauss(count)
    basis = legendre.legvander(nodes, count - 1)
    to_series = (np.arange(count)[:, None] + 0.5) * basis.T * weights
    return Gauss(nodes, to_series, integrals(nodes, count) @ to_series)


def integrals(x: Floats, count: int) -> Floats:
    """Return the integrals (n, count) of the first Legendre polynomials from -1 to x."""
    basis = legendre.legvander(x, count)
    degree = np.arange(1, count)
    series = np.empty((len(x), count))
    series[:, 0] = x + 1.0
    series[:, 1:] = (basis[:, 2:] - basis[:, :-2]) / (2 * degree + 1)
    return series


@final
@dataclass(frozen=True)
class Step:
    """One accepted step: start, length, state at the start, and the rate's series.

    `series` (N, states) are Legendre coefficients of the state's rate over the step.
    """

    start: float
    length: float
    state: Floats
    series: Floats

    @property
    def stop(self) -> float:
        """Time at the end."""
        return self.start + self.length

    def at(self, t: Floats) -> Floats:
        """Return the state (n, states) at times (n,) within the step."""
        x = 2.0 * (t - self.start) / self.length - 1.0
        swept = integrals(x, len(self.series)) @ self.series
        return np.asarray(self.state + 0.5 * self.length * swept)

    def rate(self, t: Floats) -> Floats:
        """Return the state's rate (n, states) at times (n,) within the step."""
        x = 2.0 * (t - self.start) / self.length - 1.0
        return np.asarray(legendre.legvander(x, len(self.series) - 1) @ self.series)

    @property
    def end(self) -> Floats:
        """The state (states,) at the end, to the order 2 N."""
        return np.asarray(self.state + self.length * self.series[0])


Field = Callable[[Floats, Floats], Floats]
"""Rates (n, states) at times (n,) and states (n, states); NaN where there are none."""


@final
@dataclass(frozen=True)
class Attempt:
    """A step as tried: it is accepted where `error` is at most 1.

    `error` is the size of what the polynomial leaves out over what is tolerated,
    infinite where the iteration failed; `iterations` counts evaluations of the field.
    """

    step: Step
    error: float
    iterations: int


def attempt(
    field: Field,
    start: float,
    length: float,
    state: Floats,
    tolerance: float,
    before: Step | None = None,
    sizes: Floats | None = None,
    stiff: int | None = None,
) -> Attempt:
    """Try one step of a system of ordinary differential equations.

    Parameters
    ----------
    field
        The right-hand side.
    start, length, state
        Time and state (states,) at the start, and the length of the step.
    tolerance
        Error tolerated over the step in states of their usual size; larger ones by theirs.
    before
        The step that ends here, from which the first guess is continued.
    sizes
        Usual sizes of the states (states,), 1 by default.
    stiff
        Number of the state whose rate may depend on itself so much that Picard's iteration
        of it does not converge: it is found by Newton's method.
    """
    method = gauss(NODES)
    t = start + 0.5 * length * (method.nodes + 1.0)
    scale = np.maximum(np.ones(len(state)) if sizes is None else sizes, np.abs(state))
    if before is None:
        rates = np.repeat(field(np.array([start]), state[None]), NODES, axis=0)
    else:
        x = 2.0 * (t - before.start) / before.length - 1.0
        low = before.series[:CONTINUED]
        rates = legendre.legvander(x, len(low) - 1) @ low
    states = state + 0.5 * length * (method.integral @ rates)
    enough = max(0.05 * tolerance, 8 * EPS)
    last = np.inf
    for count in range(1, MOST_ITERATIONS + 1):
        rates = field(t, states)
        moved = state + 0.5 * length * (method.integral @ rates)
        if stiff is not None:
            if count in RENEWED:
                slope = _slope(field, t, states, rates, stiff, scale[stiff])
                inverse = _inverse(method, 0.5 * length * slope)
            moved[:, stiff] = states[:, stiff] + inverse @ (moved - states)[:, stiff]
        change = float(np.max(np.abs(moved - states) / scale))
        states = moved
        if not np.isfinite(change) or (count > 4 and change > 4.0 * last):
            return Attempt(Step(start, length, state, rates), np.inf, count)
        if change < enough or (change < 64 * EPS and change >= 0.5 * last):
            break
        last = change
    else:
        return Attempt(Step(start, length, state, rates), np.inf, count)
    series = method.to_series @ rates
    left_out = np.max(np.abs(series[-3:]), axis=0) * length / (4 * NODES - 2)
    error = float(np.max(left_out / scale)) / tolerance
    return Attempt(Step(start, length, state, series), error, count)


def _slope(
    field: Field, t: Floats, states: Floats, rates: Floats, column: int, size: float
) -> Floats:
    """Return how the rate of one state depends on it (N,), by differences."""
    other = states.copy()
    shift = DIFFERENCE * size
    other[:, column] += shift
    slope = (field(t, other)[:, column] - rates[:, column]) / shift
    return np.asarray(np.where(np.isfinite(slope), slope, 0.0))


def _inverse(method: Gauss, slope: Floats) -> Floats:
    """Return what turns misses (N,) of a linear collocation into corrections."""
    matrix = np.eye(len(slope)) - method.integral * slope
    return np.asarray(np.linalg.inv(matrix))


def next_length(tried: Attempt) -> float:
    """Return the length to try next: shorter after a step that was not accepted."""
    length = tried.step.length
    if not np.isfinite(tried.error):
        return SHRINKAGE * length
    factor = SAFETY * max(tried.error, EPS) ** (-1.0 / NODES)
    if tried.iterations > MANY_ITERATIONS:
        factor = min(factor, SAFETY)
    return length * float(np.clip(factor, SHRINKAGE, GROWTH))


@final
@dataclass(frozen=True)
class StepEvents:
    """An accepted step with the coordinates' rates (N, m, variables) at its nodes.

    Of one freedom they are tangents of the curve. `whole` (variables,) rad are turns by
    which its variables are less than those of stops.
    """

    step: Step
    rates: Floats
    whole: Floats

    @cached_property
    def t(self) -> Floats:
        """(N + 2,) times of the nodes and both ends."""
        x = np.concatenate([[-1.0], gauss(NODES).nodes, [1.0]])
        return np.asarray(self.step.start + 0.5 * self.step.length * (x + 1.0))

    @cached_property
    def states(self) -> Floats:
        """(N + 2, states) there."""
        return self.step.at(self.t)

    def dead_centres(self, variables: Sequence[int]) -> list[float]:
        """Return the times at which so many variables do not say how all others move.

        A single one turns back on the curve there.
        """
        samples = np.linalg.det(self.rates[:, :, list(variables)])
        return self._passed(self._through(samples))

    def rests(self, column: int) -> list[float]:
        """Return the times at which a column of the state is zero."""
        return self._passed(self._column(column, 0.0))

    def stop(self, mechanism: Mechanism) -> tuple[float, Stop] | None:
        """Return the first time at which a pair passes a stop, and that stop."""
        reached: list[tuple[float, Stop]] = []
        for stop in mechanism.stops:
            column = variable_of(mechanism, stop.pair)
            for limit, sense in ((stop.low, -1.0), (stop.high, 1.0)):
                beyond = self._column(column, limit - self.whole[column])
                t = zeros(beyond, self.t).places
                outward = t[sense * beyond(t)[1] > 0.0]
                if len(outward) or sense * beyond(self.t[-1:])[0][0] > 0.0:
                    reached.append((float([*outward, self.t[0]][0]), stop))
        return min(reached, key=lambda item: item[0], default=None)

    def orientation(self, closure: Closure) -> Floats:
        """Return (N,) the determinant of the closure equations bordered by the rates.

        On one smooth curve it keeps its sign; where curves cross it passes through zero.
        Ones, if constraints are redundant.
        """
        values = self.states[1:-1, : self.rates.shape[2]]
        bordered = np.concatenate([closure.at(values).jacobian, self.rates], axis=1)
        if bordered.shape[1] != bordered.shape[2]:
            return np.ones(len(values))
        return np.asarray(np.linalg.det(bordered))

    def crossing(self, orientation: Floats, largest: float, least: float) -> float | None:
        """Return the time at which the orientation (N,) vanishes, if it does.

        `largest` is the largest seen so far, with the sign it had at the last node;
        orientations smaller than the part `least` of it are zero.
        """
        turned = orientation * largest < 0.0
        near = np.abs(orientation) < least * abs(largest)
        if not np.any(turned | near):
            return None
        passed = self._passed(self._through(orientation)) if np.any(turned) else []
        first = int(np.argmax(turned | near))
        return min([*passed, float(self.t[1 + first])])

    def _column(self, column: int, level: float) -> Function:
        """Return a column of the state over a level, with its rate."""
        step = self.step
        return lambda t: (step.at(t)[:, column] - level, step.rate(t)[:, column])

    def _through(self, samples: Floats) -> Function:
        """Return the polynomial through samples (N,) at the nodes, with its slope."""
        series = gauss(NODES).to_series @ samples
        slope = legendre.legder(series) * (2.0 / self.step.length)

        def through(t: Floats) -> tuple[Floats, Floats]:
            x = 2.0 * (t - self.step.start) / self.step.length - 1.0
            value, rate = (legendre.legval(x, part) for part in (series, slope))
            return np.asarray(value), np.asarray(rate)

        return through

    def _passed(self, function: Function) -> list[float]:
        """Return the times after the start at which a function changes its sign."""
        crossed = zeros(function, self.t)
        later = crossed.places > self.step.start
        return [float(t) for t in crossed.places[later & ~crossed.double]]


@final
@dataclass(frozen=True)
class Traced(ArrayRows):
    """States and their rates (n, states) at n times, as in `spherekit.dynamics.state`.

    The variables in them are less `turns` (n, variables) whole turns. `frames`
    (n, m, variables) are those of the momenta: of one freedom a vector to the side of the
    curve on which momentum is positive.
    """

    states: Floats
    rates: Floats
    frames: Floats
    turns: Floats


BLOCK = 1024
"""Times at which states are evaluated together."""


@final
@dataclass(frozen=True)
class StatePath:
    """The states of a simulation over time, whichever engine found them.

    `parts` give them at times (n,), each from its time among `firsts` (s) on; `starts`,
    `lengths` (steps,) s are those of the steps, `drift` is the largest closure residual
    (rad) that was taken out.
    """

    firsts: Floats
    parts: tuple[Callable[[Floats], Traced], ...]
    starts: Floats
    lengths: Floats
    drift: float

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the path."""
        owner = np.maximum(np.searchsorted(self.firsts, t, side="right") - 1, 0)
        order = np.argsort(owner, kind="stable")
        alike = np.split(order, np.flatnonzero(np.diff(owner[order])) + 1)
        rows = [
            block
            for some in alike
            for block in np.split(some, range(BLOCK, len(some), BLOCK))
        ]
        parts = [self.parts[owner[some[0]] if len(some) else 0](t[some]) for some in rows]
        return Traced.joined(parts).rows(np.argsort(order))


def through_steps(
    items: Sequence[tuple[Step, Floats]], turns: Floats, drift: float
) -> StatePath:
    """Return the path of steps whose states are polynomials, in order of time.

    Each with the frames (k, m, variables) of its momenta, evenly along it: of one freedom
    tangents of the curve, of several one frame for all of it. The variables in them are
    less `turns` (variables,) whole turns.
    """
    starts = np.array([step.start for step, _ in items])
    parts = tuple(partial(_in_step, step, frames, turns) for step, frames in items)
    lengths = np.array([step.length for step, _ in items])
    return StatePath(starts, parts, starts, lengths, drift)


def _in_step(step: Step, frames: Floats, turns: Floats, t: Floats) -> Traced:
    place = (t - step.start) / step.length * len(frames)
    nearest = np.clip(place.astype(int), 0, len(frames) - 1)
    whole = np.broadcast_to(turns, (len(t), len(turns)))
    return Traced(step.at(t), step.rate(t), frames[nearest], whole)


Frames = Callable[[Floats, Floats], Floats]
"""Sets the momenta of a run's states and rates (n, states), returns their frames."""


def on_curve(equation: CompiledEquation, sense: float = 1.0) -> Frames:
    """Return the frames of one freedom: homogeneous rates, in the sense of a tangent."""
    count = equation.layout.variables

    def framed(states: Floats, changes: Floats) -> Floats:
        for array in (states, changes):
            array[:, count] *= sense
        return sense * equation.rates(states[:, :count])

    return framed


def in_coordinates(equation: EquationOfMotion, frame: Floats) -> Frames:
    """Return those of several freedoms: a frame (m, variables), momenta from rates."""
    root, momenta = np.sqrt(mass_size(equation.mechanism)), equation.momenta

    def framed(states: Floats, changes: Floats) -> Floats:
        u, change = states[:, momenta] / root, changes[:, momenta] / root
        motion = equation.motion(states[:, : equation.variables], frame, order=2)
        masses = inertia(equation.mechanism, motion)
        roots = Roots.of(masses.M)
        states[:, momenta] = roots.times(u)
        changes[:, momenta] = roots.changing(masses.dM, u) + roots.times(change)
        return np.broadcast_to(frame, (len(states), *frame.shape))

    return framed


def through_runs(runs: Sequence[Run], framed: Sequence[Frames]) -> StatePath:
    """Return the path of compiled runs, one after the other, with their frames."""
    every = [
        (x, frames) for run, frames in zip(runs, framed, strict=True) for x in run.stretches
    ]
    return StatePath(
        np.array([stretch.starts[0] for stretch, _ in every]),
        tuple(partial(_in_stretch, stretch, frames) for stretch, frames in every),
        np.concatenate([stretch.starts for stretch, _ in every]),
        np.concatenate([stretch.lengths for stretch, _ in every]),
        max(run.drift for run in runs),
    )


def _in_stretch(stretch: Stretch, framed: Frames, t: Floats) -> Traced:
    states, rates = stretch.at(t)
    whole = np.broadcast_to(stretch.turns, (len(t), len(stretch.turns)))
    return Traced(states, rates, framed(states, rates), whole)
