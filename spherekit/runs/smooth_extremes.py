"""Estimates the extremes that a quantity has between successive samples."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Facts


@dataclass
class SmoothExtremes:
    """The lowest and the highest value of a quantity, estimated between samples.

    At a sample whose value b is at least as large as the values a and c at its two
    neighbours, the parabola through the three has its maximum b + (c - a)**2 / (8 k) with
    k = abs(a - 2 b + c). Minima are found likewise. The result does not depend on how the
    samples are divided into blocks.

    Attributes
    ----------
    lowest, highest
        The smallest minimum and the largest maximum of all parabolas, None if there is
        none.
    last_values
        The last two values, which are neighbours of the values of the next block. None
        stands for an unknown value, because NaN cannot be stored as JSON.
    """

    lowest: float | None = None
    highest: float | None = None
    last_values: list[float | None] = field(default_factory=list)

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the extremes from the data of `dataclasses.asdict`."""
        return cls(**entries)

    def add(self, values: Floats) -> None:
        """Add the values (n,) at the next samples, NaN where they are unknown."""
        earlier = [np.nan if value is None else value for value in self.last_values]
        values = np.concatenate([earlier, values])
        self.last_values = [
            float(value) if np.isfinite(value) else None for value in values[-2:]
        ]
        if len(values) < 3:
            return
        before, middle, after = values[:-2], values[1:-1], values[2:]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            curvature = np.abs(before - 2.0 * middle + after)
            excess = np.where(
                curvature > 0.0, (after - before) ** 2 / (8.0 * curvature), 0.0
            )
            is_maximum = (middle >= before) & (middle >= after) & np.isfinite(excess)
            is_minimum = (middle <= before) & (middle <= after) & np.isfinite(excess)
        if np.any(is_maximum):
            highest = float(np.max((middle + excess)[is_maximum]))
            self.highest = highest if self.highest is None else max(self.highest, highest)
        if np.any(is_minimum):
            lowest = float(np.min((middle - excess)[is_minimum]))
            self.lowest = lowest if self.lowest is None else min(self.lowest, lowest)

    def excess(self, lowest: float | None, highest: float | None) -> float:
        """Return how far the extremes exceed a range, 0 if they do not.

        Parameters
        ----------
        lowest, highest
            The bounds of the range; None leaves out a bound.
        """
        excess = 0.0
        if self.highest is not None and highest is not None:
            excess = max(excess, self.highest - highest)
        if self.lowest is not None and lowest is not None:
            excess = max(excess, lowest - self.lowest)
        return excess
