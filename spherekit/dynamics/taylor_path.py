"""Where a compiled run went, as states of `spherekit.dynamics.state`."""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.path import Traced
from spherekit.dynamics.state import EquationOfMotion, Roots
from spherekit.engine.integration import Run
from spherekit.engine.several_freedoms import mass_size
from spherekit.sphere.rotation import Floats


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
        owner = np.maximum(np.searchsorted(firsts, t, side="right") - 1, 0)
        if len(self.legs) == 1 or not len(t):
            return self.legs[0].at(t)
        order, parts = [], []
        for number in np.unique(owner):
            rows = np.flatnonzero(owner == number)
            order.append(rows)
            parts.append(self.legs[number].at(t[rows]))
        back = np.argsort(np.concatenate(order))
        columns = (
            np.concatenate([getattr(part, name) for part in parts])[back]
            for name in ("states", "rates", "frames", "turns")
        )
        return Traced(*columns)
