"""Where a configuration curve has to end: bounds of variables, equal curvatures."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import EQUAL_CURVATURE, Status
from spherekit.motion.closure import Closure
from spherekit.motion.pairs import contact_tracks
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class VariableLimit:
    """A variable that may not pass a value, from above (`sense` 1) or from below (-1)."""

    variable: int
    value: float
    sense: float
    status: Status

    @property
    def words(self) -> str:
        """What the limit is, for messages."""
        side = "lowest" if self.sense > 0.0 else "highest"
        return f"the {side} value {self.value:.6g} rad of variable {self.variable}"

    def margin(
        self, values: Floats, curvatures: Floats, rates: Floats
    ) -> tuple[float, Floats]:
        """Return how far the limit is, negative beyond it, and the gradient of that.

        `values` (variables,); `curvatures` and `rates` (pairs, 2) of the profiles.
        """
        gradient = np.zeros(len(values))
        gradient[self.variable] = self.sense
        return self.sense * (float(values[self.variable]) - self.value), gradient


@final
@dataclass(frozen=True)
class EqualCurvatures:
    """The profiles of a contact pair, whose arc lengths are the variables `along`."""

    pair: int
    along: tuple[int, int]
    status: Status = Status.CURVATURE

    @property
    def words(self) -> str:
        """What the limit is, for messages."""
        return f"equal curvatures of the profiles of pair {self.pair}"

    def margin(
        self, values: Floats, curvatures: Floats, rates: Floats
    ) -> tuple[float, Floats]:
        """Return how far the limit is, negative beyond it, and the gradient of that.

        `values` (variables,); `curvatures` and `rates` (pairs, 2) of the profiles.
        """
        first, second = curvatures[self.pair]
        gradient = np.zeros(len(values))
        gradient[self.along[0]] += rates[self.pair, 0]
        gradient[self.along[1]] -= rates[self.pair, 1]
        return float(first - second) - EQUAL_CURVATURE, gradient


Limit = VariableLimit | EqualCurvatures


def limits_of(
    closure: Closure, stops: Mapping[int, tuple[float, float]]
) -> tuple[Limit, ...]:
    """Return the ends of open profiles, equal curvatures, and stops.

    `stops` has the lowest and the highest value (rad) of variables by their numbers.
    """
    limits: list[Limit] = []
    for variable, (low, high) in stops.items():
        limits.append(VariableLimit(variable, low, 1.0, Status.OK))
        limits.append(VariableLimit(variable, high, -1.0, Status.OK))
    for pair, (one, other) in contact_tracks(closure.joints):
        limits.append(EqualCurvatures(pair, (one.variable, other.variable)))
        for track in (one, other):
            if not track.curve.closed:
                low, high = -track.start, track.curve.length - track.start
                limits += [
                    VariableLimit(track.variable, low, 1.0, Status.OFF_PROFILE),
                    VariableLimit(track.variable, high, -1.0, Status.OFF_PROFILE),
                ]
    return tuple(limits)
