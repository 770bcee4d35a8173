"""Where a simulation went: its states at any time, whichever engine found them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, final

import numpy as np

from spherekit.dynamics.collocation import Step
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Traced:
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
class Travelled:
    """An accepted step with the frames (k, m, variables) of its momenta, evenly along it.

    Of one freedom these are tangents of the curve, of several one frame for all of it.
    """

    step: Step
    frames: Floats


@final
@dataclass(frozen=True)
class CollocationPath:
    """Steps whose states are polynomials, in order of time.

    The variables in them are less `turns` (variables,) whole turns.
    """

    items: tuple[Travelled, ...]
    turns: Floats
    drift: float

    @cached_property
    def starts(self) -> Floats:
        """(steps,) times at which steps start (s)."""
        return np.array([item.step.start for item in self.items])

    @cached_property
    def lengths(self) -> Floats:
        """(steps,) their lengths (s)."""
        return np.array([item.step.length for item in self.items])

    def at(self, t: Floats) -> Traced:
        """Return the states at times (n,) within the path."""
        owner = np.maximum(np.searchsorted(self.starts, t, side="right") - 1, 0)
        width = len(self.items[0].step.state)
        states, rates = np.empty((len(t), width)), np.empty((len(t), width))
        frames = np.empty((len(t), *self.items[0].frames.shape[1:]))
        for number in np.unique(owner):
            rows, item = np.flatnonzero(owner == number), self.items[number]
            states[rows], rates[rows] = item.step.at(t[rows]), item.step.rate(t[rows])
            place = (t[rows] - item.step.start) / item.step.length * len(item.frames)
            nearest = np.clip(place.astype(int), 0, len(item.frames) - 1)
            frames[rows] = item.frames[nearest]
        turns = np.broadcast_to(self.turns, (len(t), len(self.turns)))
        return Traced(states, rates, frames, turns)
