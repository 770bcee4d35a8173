"""What happens within a step: zeros of functions known at its nodes or as polynomials."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.polynomial import legendre

from spherekit.dynamics.collocation import NODES, Step, gauss
from spherekit.dynamics.start import variable_of
from spherekit.model.dynamics import Stop
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.sphere.rotation import Floats


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
        return self._zeros_of_samples(np.linalg.det(self.rates[:, :, list(variables)]))

    def rests(self, column: int) -> list[float]:
        """Return the times at which a column of the state is zero."""
        return self._zeros(self._column(column, 0.0), self.states[:, column])

    def stop(self, mechanism: Mechanism) -> tuple[float, Stop] | None:
        """Return the first time at which a pair passes a stop, and that stop."""
        reached: list[tuple[float, Stop]] = []
        for stop in mechanism.stops:
            column = variable_of(mechanism, stop.pair)
            for limit, sense in ((stop.low, -1.0), (stop.high, 1.0)):
                level = limit - self.whole[column]
                beyond = sense * (self.states[:, column] - level)
                beyond[0] = min(beyond[0], 0.0)
                value = self._column(column, level)
                t, beyond = self._with_turns(value, sense, beyond)
                for k in np.flatnonzero((beyond[1:] > 0.0) & (beyond[:-1] <= 0.0))[:1]:
                    reached.append((_root(value, t[k], t[k + 1]), stop))
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
        zeros = self._zeros_of_samples(orientation) if np.any(turned) else []
        first = int(np.argmax(turned | near))
        return min([*zeros, float(self.t[1 + first])])

    def _with_turns(
        self, value: Callable[[float], float], sense: float, samples: Floats
    ) -> tuple[Floats, Floats]:
        """Return times and samples, and the highest place where samples rise and fall.

        Only where it is not beyond zero already, so that a short visit there is seen.
        """
        from scipy.optimize import minimize_scalar

        rising, inside = np.diff(samples) > 0.0, samples[1:-1] <= 0.0
        steep = np.abs(np.diff(samples))
        within = -samples[1:-1] <= np.maximum(steep[1:], steep[:-1])
        t, values = self.t, samples
        for k in np.flatnonzero(rising[:-1] & ~rising[1:] & inside & within)[::-1] + 1:
            low, high = self.t[k - 1], self.t[k + 1]
            best = minimize_scalar(
                lambda t: -sense * value(t),
                bounds=(low, high),
                method="bounded",
                options={"xatol": 1e-9 * (high - low)},
            )
            place = int(np.searchsorted(t, best.x))
            t, values = np.insert(t, place, best.x), np.insert(values, place, -best.fun)
        return t, values

    def _column(self, column: int, level: float) -> Callable[[float], float]:
        return lambda t: float(self.step.at(np.array([t]))[0, column]) - level

    def _zeros_of_samples(self, samples: Floats) -> list[float]:
        """Return the zeros of the polynomial through samples (N,) at the nodes."""
        series = gauss(NODES).to_series @ samples

        def value(t: float) -> float:
            x = 2.0 * (t - self.step.start) / self.step.length - 1.0
            return float(legendre.legval(x, series))

        ends = value(self.t[0]), value(self.t[-1])
        return self._zeros(value, np.array([ends[0], *samples, ends[1]]))

    def _zeros(self, value: Callable[[float], float], samples: Floats) -> list[float]:
        changes = (samples[:-1] != 0.0) & (samples[:-1] * samples[1:] <= 0.0)
        return [_root(value, self.t[k], self.t[k + 1]) for k in np.flatnonzero(changes)]


def _root(value: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function that changes sign between two times is zero."""
    from scipy.optimize import brentq

    one, other = value(low), value(high)
    if one * other >= 0.0:
        return float(low if abs(one) <= abs(other) else high)
    return float(brentq(value, low, high, xtol=1e-15, rtol=1e-15))
