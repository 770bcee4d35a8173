"""Profiles as series in their arc length, for many places in little time."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.profile_curve import Curve
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.chebyshev import PiecewiseChebyshev

ROUNDING = 1e-9
"""What curvatures, and more so their derivatives, may lose of their size to rounding."""
TOLERANCE = 1e-15
MOST = 2048
DEGREE = 11
BETWEEN = 17
"""Places in a cell at which the slope of the curvature is looked at."""


@dataclass(frozen=True)
class ProfileSeries:
    """A curve by its arc length: `series` of tangent, point, curvature k and dk/ds.

    `most_bent` bounds |d2k/ds2|, as far as differences between many places say.
    """

    series: PiecewiseChebyshev
    length: float
    closed: bool
    most_bent: float

    @staticmethod
    def of(curve: Curve) -> "ProfileSeries":
        """Return the series of a curve, as good as its own numbers but for rounding."""
        there = _columns(curve, np.linspace(0.0, curve.length, 257))
        size = np.maximum(1.0, max_abs(there, axis=0))
        fitted = PiecewiseChebyshev.fit(
            lambda s: _columns(curve, s),
            0.0,
            curve.length,
            TOLERANCE,
            size,
            curve.edges,
            DEGREE,
            MOST,
            ROUNDING,
        )
        slopes = np.abs(
            fitted.derivative.evaluate(fitted.spread_positions(BETWEEN - 1))[:, 7]
        )
        return ProfileSeries(
            fitted, curve.length, curve.closed, 1.5 * float(np.max(slopes))
        )

    def at(self, s: Floats) -> Floats:
        """Return (8, n) at arc lengths s (n,); NaN beyond the ends of an open curve."""
        values = self.series.evaluate(np.mod(s, self.length) if self.closed else s)
        if not self.closed:
            values[~((s >= 0.0) & (s <= self.length))] = np.nan
        return np.ascontiguousarray(values.T)

    def slopes(self, s: Floats) -> Floats:
        """Return the derivatives (8, n) of `at` by the arc length."""
        return self.series.derivative.evaluate(
            np.mod(s, self.length) if self.closed else s
        ).T


def _columns(curve: Curve, s: Floats) -> Floats:
    there = curve.at(s)
    tangent, point = there.frame[:, :, 0], there.frame[:, :, 2]
    return np.column_stack([tangent, point, there.curvature, there.curvature_rate])
