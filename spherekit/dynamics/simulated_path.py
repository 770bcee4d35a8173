"""States of a simulation at any time, whichever engine computed them.

The steps of NumPy's engine are those of Gauss collocation, the implicit Runge-Kutta method
of highest order, 2 N at the ends of steps with N nodes (Hairer, Norsett and Wanner 1993,
II.7): within a step the solution is a polynomial of degree N. What happens within a step
are zeros of functions known at its nodes or as polynomials.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.polynomial import legendre

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN
from spherekit.dynamics.compiled_equation import CompiledEquation
from spherekit.dynamics.equation_of_motion import EquationOfMotion, InertiaRoots
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.multi_dof_equation import total_moment_of_inertia
from spherekit.dynamics.simulation_start import variable_of
from spherekit.dynamics.taylor_integration import CROSSING_RATIO, Segment, TaylorRun
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.zeros import DifferentiableFunction, find_zeros
from spherekit.positions.loop_closure import Closure

NODES = 24
"""Measured: fewest evaluations on linkages at tolerances of 1e-7 to 1e-11."""

GAUSS, _WEIGHTS = legendre.leggauss(NODES)
"""The nodes (N,) of a step in [-1, 1]."""

TO_SERIES = (
    (np.arange(NODES)[:, None] + 0.5) * _WEIGHTS * legendre.legvander(GAUSS, NODES - 1).T
)
"""(N, N) turns values at the nodes into Legendre coefficients."""

INTEGRAL = legendre.legvander(GAUSS, NODES) @ legendre.legint(TO_SERIES, lbnd=-1)
"""(N, N) gives the integrals from -1 to each node, from values at all."""


@dataclass(frozen=True)
class Step:
    """One step of Gauss collocation with N nodes.

    Attributes
    ----------
    start, length
        Time at the start, and length, s.
    state
        (states,) state at the start.
    series
        (N, states) Legendre coefficients of the state's rate over the step.
    frames
        (k, m, variables) frames of the momenta, evenly along the step: with one degree of
        freedom the unit tangents of the curve at the nodes, with several one frame for all
        of it.
    """

    start: float
    length: float
    state: Floats
    series: Floats
    frames: Floats

    @property
    def stop(self) -> float:
        """Time at the end."""
        return self.start + self.length

    @property
    def end(self) -> Floats:
        """The state (states,) at the end, to the order 2 N."""
        return self.state + self.length * self.series[0]

    @cached_property
    def swept(self) -> Floats:
        """(N + 1, states) the series of what the state has changed by since the start."""
        return np.asarray(0.5 * self.length * legendre.legint(self.series, lbnd=-1))

    def summed(self, series: Floats, t: Floats) -> Floats:
        """Return a Legendre series (k, states) over the step at times (n,)."""
        x = 2.0 * (t - self.start) / self.length - 1.0
        return legendre.legvander(x, len(series) - 1) @ series

    def at(self, t: Floats) -> Floats:
        """Return the state (n, states) at times (n,) within the step."""
        return self.state + self.summed(self.swept, t)

    def rate(self, t: Floats) -> Floats:
        """Return the state's rate (n, states) at times (n,) within the step."""
        return self.summed(self.series, t)

    @cached_property
    def times(self) -> Floats:
        """(N + 2,) times of the nodes and both ends."""
        return self.start + 0.5 * self.length * (np.array([-1.0, *GAUSS, 1.0]) + 1.0)

    def column(self, number: int, level: float = 0.0) -> Floats:
        """Return the series (N + 1,) of a state over a level."""
        series = self.swept[:, number].copy()
        series[0] += self.state[number] - level
        return series

    def _function(self, series: Floats) -> DifferentiableFunction:
        """Return what a Legendre series (k,) over the step says, with its slope."""
        slope = legendre.legder(series) * 2.0 / self.length
        both = np.stack([series, np.append(slope, 0.0)], axis=1)
        return lambda t: tuple(self.summed(both, t).T)

    def passed(self, series: Floats) -> list[float]:
        """Return the times after the start at which a series (k,) changes its sign."""
        crossed = find_zeros(self._function(series), self.times)
        return crossed.places[(crossed.places > self.start) & ~crossed.double].tolist()

    def stopped(self, mechanism: Mechanism, whole: Floats) -> Iterator[tuple[float, str]]:
        """Yield times at which pairs are first beyond a joint limit, and their names.

        `whole` (variables,) rad are turns by which the states are less than stops.
        """
        for stop in mechanism.joint_limits:
            number = variable_of(mechanism, stop.pair)
            for limit, sense in ((stop.low, -1.0), (stop.high, 1.0)):
                beyond = self._function(self.column(number, limit - whole[number]))
                t = find_zeros(beyond, self.times).places
                outward = t[sense * beyond(t)[1] > 0.0]
                if len(outward) or sense * beyond(self.times[-1:])[0][0] > 0.0:
                    yield float([*outward, self.start][0]), stop.pair

    def orientation(self, closure: Closure, rates: Floats) -> Floats:
        """Return (N,) the determinant of the closure equations bordered by the rates.

        On one smooth curve it keeps its sign; where curves cross it passes through zero.
        Ones, if constraints are redundant.
        """
        values = self.at(self.times[1:-1])[:, : rates.shape[2]]
        bordered = np.concatenate([closure.at(values).jacobian, rates], axis=1)
        if bordered.shape[1] != bordered.shape[2]:
            return np.ones(len(values))
        return np.linalg.det(bordered)

    def crossing(self, orientation: Floats, largest: float) -> float | None:
        """Return the time at which the orientation (N,) vanishes, if it does.

        `largest` is the largest seen so far, with the sign it had at the last node;
        orientations smaller than the part `CROSSING_RATIO` of it are zero.
        """
        small = orientation * np.sign(largest) < CROSSING_RATIO * abs(largest)
        if not np.any(small):
            return None
        passed = self.passed(TO_SERIES @ orientation)
        return min([*passed, float(self.times[1 + np.argmax(small)])])


@dataclass(frozen=True)
class Traced(ArrayRows):
    """States of a simulation at n times.

    Attributes
    ----------
    states, rates
        (n, states) states of `spherekit.dynamics.equation_of_motion` and their rates by
        time. The variables are less whole turns.
    frames
        (n, m, variables) frames of the momenta: with one degree of freedom a vector to the
        side of the curve on which the momentum is positive.
    turns
        (n, variables) these whole turns.
    """

    states: Floats
    rates: Floats
    frames: Floats
    turns: Floats

    @property
    def values(self) -> Floats:
        """(n, variables) rad with all their turns."""
        return self.states[:, : self.turns.shape[1]] + TURN * self.turns


CHECKED = 2000
"""Most steps at which balances are formed, evenly chosen."""

BLOCK = 1024
"""Times at which states are evaluated together."""


@dataclass(frozen=True)
class StatePath:
    """The states of a simulation over time, whichever engine computed them.

    Attributes
    ----------
    firsts
        (parts,) times from which each part applies, s.
    parts
        Functions that return the states at times (n,), s.
    starts, lengths
        (steps,) start times and lengths of the steps, s.
    drift
        Largest closure residual that was removed, rad.
    """

    firsts: Floats
    parts: tuple[Callable[[Floats], Traced], ...]
    starts: Floats
    lengths: Floats
    drift: float

    @property
    def chosen(self) -> Indices:
        """The numbers of `CHECKED` steps at most, evenly chosen."""
        count = len(self.starts)
        return np.linspace(0, count - 1, min(CHECKED, count)).astype(np.intp)

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the path."""
        owner = np.searchsorted(self.firsts[1:], t, side="right")
        order = np.argsort(owner, kind="stable")
        cuts = np.flatnonzero(np.diff(owner[order], prepend=-1))[1:]
        rows = [
            block
            for some in np.split(order, cuts)
            for block in np.split(some, range(BLOCK, len(some), BLOCK))
        ]
        parts = [self.parts[owner[some[0]] if len(some) else 0](t[some]) for some in rows]
        return Traced.joined(parts).rows(np.argsort(order))


def through_steps(steps: Sequence[Step], turns: Floats, drift: float) -> StatePath:
    """Return the path of steps whose states are polynomials, in order of time.

    The variables in them are less `turns` (variables,) whole turns.
    """
    starts, lengths = np.array([(step.start, step.length) for step in steps]).T
    parts = tuple(partial(_in_step, step, turns) for step in steps)
    return StatePath(starts, parts, starts, lengths, drift)


def _in_step(step: Step, turns: Floats, t: Floats) -> Traced:
    place = (t - step.start) / step.length * len(step.frames)
    frames = np.take(step.frames, place.astype(int), axis=0, mode="clip")
    return Traced(step.at(t), step.rate(t), frames, np.tile(turns, (len(t), 1)))


Frames = Callable[[Floats, Floats], Floats]
"""Sets the momenta of a run's states and rates (n, states), returns their frames."""


@dataclass(frozen=True)
class CurveFrames:
    """Frames of a mechanism with one degree of freedom: the tangent of its curve.

    It is a class and not a nested function, so that simulations can be pickled.

    Attributes
    ----------
    equation
        The equation of motion, which gives the homogeneous rates of the variables.
    sense
        +1 or -1, the sense of the tangent.
    """

    equation: CompiledEquation
    sense: float

    def __call__(self, states: Floats, changes: Floats) -> Floats:
        """Turn momenta (n, states) into the sense of the tangent; return the frames."""
        count = self.equation.layout.variable_count
        for array in (states, changes):
            array[:, count] *= self.sense
        return self.sense * self.equation.homogeneous_rates(states[:, :count])


@dataclass(frozen=True)
class CoordinateFrames:
    """The constant frame of a mechanism with several degrees of freedom.

    Attributes
    ----------
    equation
        The equation of motion, whose states are scaled rates.
    frame
        (m, variables) the rates of all variables for each of the m coordinates.
    """

    equation: EquationOfMotion
    frame: Floats

    def __call__(self, states: Floats, changes: Floats) -> Floats:
        """Compute momenta (n, states) from scaled rates; return the frames."""
        equation = self.equation
        root = np.sqrt(total_moment_of_inertia(equation.mechanism))
        momenta = equation.momenta
        u = states[:, momenta] / root
        change = changes[:, momenta] / root
        motion = equation.compute_motion(
            states[:, : equation.variable_count], self.frame, order=2
        )
        masses = inertia(equation.mechanism, motion)
        roots = InertiaRoots.from_inertia(masses.M)
        states[:, momenta] = roots.multiply(u)
        changes[:, momenta] = roots.multiply_derivative(masses.dM, u) + roots.multiply(
            change
        )
        return np.broadcast_to(self.frame, (len(states), *self.frame.shape))


def through_runs(runs: Sequence[TaylorRun], framed: Sequence[Frames]) -> StatePath:
    """Return the path of compiled runs, one after the other, with their frames."""
    every = [
        (x, frames) for run, frames in zip(runs, framed, strict=True) for x in run.segments
    ]
    return StatePath(
        np.array([segment.starts[0] for segment, _ in every]),
        tuple(partial(_in_segment, segment, frames) for segment, frames in every),
        np.concatenate([segment.starts for segment, _ in every]),
        np.concatenate([segment.lengths for segment, _ in every]),
        max(run.max_closure_residual for run in runs),
    )


def _in_segment(segment: Segment, framed: Frames, t: Floats) -> Traced:
    states, rates = segment.evaluate(t)
    whole = np.broadcast_to(segment.turns, (len(t), len(segment.turns)))
    return Traced(states, rates, framed(states, rates), whole)
