"""Where a simulation went: its states at any time, whichever engine found them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, final

import numpy as np

from spherekit.dynamics.collocation import Step
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.state import EquationOfMotion, Roots
from spherekit.engine.integration import Run
from spherekit.engine.several_freedoms import mass_size
from spherekit.numeric.rows import ArrayRows
from spherekit.sphere.rotation import Floats


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


class StatePath(Protocol):
    """The states of a simulation over time."""

    @property
    def starts(self) -> Floats:
        """(steps,) times at which steps start (s)."""

    @property
    def lengths(self) -> Floats:
        """(steps,) their lengths (s)."""

    @property
    def drift(self) -> float:
        """Largest closure residual (rad) that was taken out."""

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the path."""


@final
@dataclass(frozen=True)
class CollocationPath:
    """Steps whose states are polynomials, in order of time.

    Each with the frames (k, m, variables) of its momenta, evenly along it: of one freedom
    tangents of the curve, of several one frame for all of it. The variables in them are
    less `turns` (variables,) whole turns.
    """

    items: tuple[tuple[Step, Floats], ...]
    turns: Floats
    drift: float

    @cached_property
    def starts(self) -> Floats:
        """(steps,) times at which steps start (s)."""
        return np.array([step.start for step, _ in self.items])

    @cached_property
    def lengths(self) -> Floats:
        """(steps,) their lengths (s)."""
        return np.array([step.length for step, _ in self.items])

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the path."""

        def within(number: int, t: Floats) -> Traced:
            step, frames = self.items[number]
            place = (t - step.start) / step.length * len(frames)
            nearest = np.clip(place.astype(int), 0, len(frames) - 1)
            turns = np.broadcast_to(self.turns, (len(t), len(self.turns)))
            return Traced(step.at(t), step.rate(t), frames[nearest], turns)

        return _in_parts(self.starts, t, within)


def _in_parts(starts: Floats, t: Floats, at: Callable[[int, Floats], Traced]) -> Traced:
    """Return the states at times (n,), each by the last part that starts before it."""
    owner = np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)
    rows = [np.flatnonzero(owner == number) for number in np.unique(owner)]
    if len(rows) < 2:
        return at(int(owner[0]) if len(t) else 0, t)
    parts = [at(int(owner[some[0]]), t[some]) for some in rows]
    return Traced.joined(parts).rows(np.argsort(np.concatenate(rows)))


@final
@dataclass(frozen=True)
class CurveLeg:
    """A compiled run of one freedom; `sense` is that of the homogeneous rates."""

    run: Run
    sense: float

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the run."""
        states, rates, turns = self.run.at(t)
        count = turns.shape[1]
        states[:, count] *= self.sense
        rates[:, count] *= self.sense
        frames = self.sense * self.run.equation.rates(states[:, :count])
        return Traced(states, rates, frames, turns)


@final
@dataclass(frozen=True)
class CoordinateLeg:
    """A compiled run of several freedoms by pair variables, whose numbers are `places`."""

    equation: EquationOfMotion
    run: Run
    places: tuple[int, ...]

    @property
    def frame(self) -> Floats:
        """(m, variables) the coordinates as sums of the pair variables."""
        return np.eye(self.equation.variables)[list(self.places)]

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the run."""
        states, rates, turns = self.run.at(t)
        root = np.sqrt(mass_size(self.equation.mechanism))
        momenta = self.equation.momenta
        u, change = states[:, momenta] / root, rates[:, momenta] / root
        motion = self.equation.motion(
            states[:, : self.equation.variables], self.frame, order=2
        )
        masses = inertia(self.equation.mechanism, motion)
        roots = Roots.of(masses.M)
        states[:, momenta] = roots.times(u)
        rates[:, momenta] = roots.changing(masses.dM, u) + roots.times(change)
        frames = np.broadcast_to(self.frame, (len(t), *self.frame.shape))
        return Traced(states, rates, frames, turns)


@final
@dataclass(frozen=True)
class TaylorPath:
    """Compiled runs, one after the other."""

    legs: tuple[CurveLeg | CoordinateLeg, ...]

    @cached_property
    def starts(self) -> Floats:
        """(steps,) times at which steps start (s)."""
        return np.concatenate([leg.run.starts for leg in self.legs])

    @cached_property
    def lengths(self) -> Floats:
        """(steps,) their lengths (s)."""
        return np.concatenate([leg.run.lengths for leg in self.legs])

    @property
    def drift(self) -> float:
        """Largest closure residual (rad) that was taken out."""
        return max(leg.run.drift for leg in self.legs)

    @property
    def last(self) -> Run:
        """The run that the path ends with."""
        return self.legs[-1].run

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the path."""
        firsts = np.array([leg.run.starts[0] for leg in self.legs])
        return _in_parts(firsts, t, lambda number, some: self.legs[number].at(some))
