"""Estimates the extremes that a quantity has between successive samples."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Facts


@dataclass
class SmoothExtremes:
    """The lowest and the highest value of a quantity, estimated between samples.

    They are the extremes of parabolas through the values at three successive samples.
    Values are added block by block (a block is a group of successive samples). The result
    does not depend on how the samples are divided into blocks.

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
        """Add the values of a quantity at the next samples, and update its extremes.

        An extreme usually is between two samples. It is estimated by the parabola through a
        value and its two neighbours. The last two values are stored, because they are
        neighbours of later values.

        Parameters
        ----------
        values
            (n,) values at successive samples, NaN where unknown.
        """
        values = np.concatenate([self._restore_last_values(), values])
        self._store_last_values(values)
        if len(values) < 3:
            return
        parabola_extremes = find_parabola_extremes(values[:-2], values[1:-1], values[2:])
        if len(parabola_extremes.maxima):
            highest = float(np.max(parabola_extremes.maxima))
            self.highest = highest if self.highest is None else max(self.highest, highest)
        if len(parabola_extremes.minima):
            lowest = float(np.min(parabola_extremes.minima))
            self.lowest = lowest if self.lowest is None else min(self.lowest, lowest)

    def _store_last_values(self, values: Floats) -> None:
        """Store the last two of some values (n,), with None for values that are unknown."""
        self.last_values = [
            float(value) if np.isfinite(value) else None for value in values[-2:]
        ]

    def _restore_last_values(self) -> list[float]:
        """Return the last values of earlier samples, with NaN for unknown values."""
        return [np.nan if value is None else value for value in self.last_values]

    def excess(self, lowest: float | None, highest: float | None) -> float:
        """Return how far the estimated extremes exceed a range, 0 if they do not.

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


@dataclass(frozen=True)
class ParabolaExtremes:
    """The extremes of parabolas through three successive values of a quantity.

    They estimate the extremes of the quantity between samples.

    Attributes
    ----------
    maxima, minima
        The maxima and the minima, as far as they are near the middle one of their three
        values.
    """

    maxima: Floats
    minima: Floats


def find_parabola_extremes(
    before: Floats, middle: Floats, after: Floats
) -> ParabolaExtremes:
    """Return the extremes of parabolas through the values at three successive samples.

    They estimate the extremes of a quantity between samples. The samples count as equally
    spaced. The parabola through the values a, b and c has an extreme near the middle sample
    if b is not between a and c. The maximum exceeds b by (c - a)**2 / (8 abs(a - 2 b + c)).
    A minimum is below b by the same amount.

    Parameters
    ----------
    before, middle, after
        (n,) the values a, b and c of n parabolas. A parabola with a value that is not
        finite has no extreme.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        # The second difference of the values, which is zero on a straight line.
        curvature = np.abs(before - 2.0 * middle + after)
        excess = np.where(curvature > 0.0, (after - before) ** 2 / (8.0 * curvature), 0.0)
        # An infinite middle value has the excess 0.
        is_finite = np.isfinite(middle) & np.isfinite(excess)
        is_maximum = (middle >= before) & (middle >= after) & is_finite
        is_minimum = (middle <= before) & (middle <= after) & is_finite
    return ParabolaExtremes(
        maxima=(middle + excess)[is_maximum], minima=(middle - excess)[is_minimum]
    )
