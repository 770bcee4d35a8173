"""The parts of a configuration curve on which the input only rises or only falls."""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import TURN
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.turns import in_range, turns_in_range
from spherekit.sphere.rotation import Floats

SHORTEST = 1e-6
"""Cuts of a curve (rad) nearer to each other than this are one."""


@final
@dataclass(frozen=True)
class MonotoneSegments:
    """The k parts of a curve whose input lies in a range, in order.

    Where the range is longer than what the curve returns with, the same part of the curve
    is there again for each time that the input passes it.

    `starts` and `stops` (k,) are s (rad), the last stop perhaps beyond the length of a
    closed curve; `middles` (k, variables) their middle points, the input in the range;
    `shifts` (k,) the whole periods by which it differs from the curve's (rad); `lowest`,
    `highest` (k,) the input at their ends. A curve on which the input stands still is one
    part.
    """

    starts: Floats
    stops: Floats
    middles: Floats
    shifts: Floats
    lowest: Floats
    highest: Floats

    @staticmethod
    def of(
        curve: ArcCurve, driven: int, low: float, high: float, period: float = TURN
    ) -> "MonotoneSegments":
        """Return those of a curve for the variable `driven` from `low` to `high` (rad).

        `period` is the growth of the variable with which the same configurations return,
        infinite where only the curve itself can say so.
        """
        period = curve.returns_after(driven, period)
        if curve.rests(driven):
            ends = np.array([0.0]), np.array([curve.length])
            return MonotoneSegments._between(curve, driven, low, high, period, *ends)
        cuts = np.unique(
            np.concatenate(
                [
                    curve.dead_points(driven).places,
                    curve.at_input(driven, low, period).places,
                    curve.at_input(driven, high, period).places,
                ]
            )
        )
        if curve.closed:
            first = cuts[0] if len(cuts) else 0.0
            cuts = np.append(cuts if len(cuts) else first, first + curve.length)
        else:
            cuts = np.concatenate([[0.0], cuts, [curve.length]])
        cuts = cuts[np.append(True, np.diff(cuts) > SHORTEST)]
        return MonotoneSegments._between(
            curve, driven, low, high, period, cuts[:-1], cuts[1:]
        )

    @staticmethod
    def _between(
        curve: ArcCurve,
        driven: int,
        low: float,
        high: float,
        period: float,
        starts: Floats,
        stops: Floats,
    ) -> "MonotoneSegments":
        """Return those of parts from `starts` to `stops` (m,) that lie in the range."""
        middles = curve.at(0.5 * (starts + stops)).values
        turned, which = turns_in_range(middles[:, driven], low, high, period)
        inside = in_range(turned, low, high)
        turned, which = turned[inside], which[inside]
        starts, stops, middles = starts[which], stops[which], middles[which]
        shifts = turned - middles[:, driven]
        middles[:, driven] = turned
        ends = [curve.at(cut).values[:, driven] + shifts for cut in (starts, stops)]
        return MonotoneSegments(
            starts, stops, middles, shifts, np.minimum(*ends), np.maximum(*ends)
        )

    def count(self, q: float) -> int:
        """Return how many have the input q."""
        return int(np.sum((self.lowest < q) & (q < self.highest)))


def turning_inputs(
    curve: ArcCurve, driven: int, low: float, period: float = TURN
) -> Floats:
    """Return the values (k,) from `low` on at which a variable turns back on a curve."""
    dead_points = curve.dead_points(driven)
    values = curve.at(dead_points.places[~dead_points.double]).values[:, driven]
    return _from(low, values, period)


def _from(low: float, values: Floats, period: float) -> Floats:
    """Return values (n,) less whole periods, from `low` on; those that have none as are."""
    return np.asarray(low + np.mod(values - low, period)) if np.isfinite(period) else values
