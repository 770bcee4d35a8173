"""Where a configuration curve has to end: bounds of variables, equal curvatures."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import EQUAL_CURVATURE, Status
from spherekit.model.geometry import Contact
from spherekit.motion.closure import Closure
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Bound:
    """A variable that may not pass a value, from below (`sense` -1) or from above (1)."""

    variable: int
    value: float
    sense: float
    status: Status

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


Limit = Bound | EqualCurvatures


def limits_of(
    closure: Closure, stops: Mapping[int, tuple[float, float]]
) -> tuple[Limit, ...]:
    """Return the ends of open profiles, equal curvatures, and stops.

    `stops` has the lowest and the highest value (rad) of variables by their numbers.
    """
    limits: list[Limit] = []
    for variable, (low, high) in stops.items():
        limits.append(Bound(variable, low, 1.0, Status.OK))
        limits.append(Bound(variable, high, -1.0, Status.OK))
    for pair, joint in enumerate(closure.joints):
        if not isinstance(joint, Contact):
            continue
        first, second = contact_variables(closure, pair)
        limits.append(EqualCurvatures(pair, (first, second)))
        start = joint.start if joint.rolling else (0.0, 0.0)
        for variable, curve, offset in zip(
            (first, second), (joint.first, joint.second), start, strict=True
        ):
            if not curve.closed:
                limits += [
                    Bound(variable, -offset, 1.0, Status.OFF_PROFILE),
                    Bound(variable, curve.length - offset, -1.0, Status.OFF_PROFILE),
                ]
    return tuple(limits)


def contact_variables(closure: Closure, pair: int) -> tuple[int, int]:
    """Return the variables that run along a contact pair's two profiles."""
    first = closure.tree.owners.index(pair)
    joint = closure.joints[pair]
    return first, first if isinstance(joint, Contact) and joint.rolling else first + 1
