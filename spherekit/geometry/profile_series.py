"""Profiles as Chebyshev series in their arc length, which are fast to evaluate."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.profile_curve import Curve
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.chebyshev import PiecewiseChebyshev

SERIES_ERROR = 1e-15
"""Error of the series, relative to the scale of each column.

Larger: fewer cells and a larger error. Smaller: cells are halved for rounding errors.
"""

SERIES_ROUNDING_TOLERANCE = 1e-9
"""Accepted error of the series, if halving the cells does not reduce it any further.

Curvatures, and their derivatives even more, lose digits by rounding. Larger: cells with
kinks get a larger error. Smaller: such profiles get as many cells as allowed.
"""

MAX_PROFILE_CELLS = 2048
"""Cells of a series are not halved if there would be more cells than this.

A curve that consists of more pieces has more cells.

Larger: more memory. Smaller: the series of difficult profiles get a larger error.
"""

PROFILE_SERIES_DEGREE = 11
"""Degree of the series on a cell. Larger: fewer cells, each slower to evaluate."""

SLOPE_SAMPLES = 17
"""Number of positions in each cell at which d2k/ds2 is evaluated for its bound."""

SLOPE_SAFETY_FACTOR_OF_PROFILES = 1.5
"""The bound of d2k/ds2 divided by its largest value at the sampled positions."""

PROFILE_SCALE_SAMPLES = 257
"""Number of positions along the profile from which the scale of each column is taken."""


@dataclass(frozen=True)
class ProfileSeries:
    """A contact profile (curve on the unit sphere) as series in its arc length.

    The eight columns are the tangent t (3), the point p (3), the geodesic curvature k and
    dk/ds.

    Attributes
    ----------
    series
        The interpolant of the columns.
    length
        Arc length of the profile (rad).
    closed
        Whether the profile is closed.
    max_curvature_second
        Bound of |d2k/ds2|, the second derivative of the curvature, estimated from samples.
    """

    series: PiecewiseChebyshev
    length: float
    closed: bool
    max_curvature_second: float

    @staticmethod
    def fit(curve: Curve) -> "ProfileSeries":
        """Return Chebyshev series of the properties of a contact profile.

        The profile is a curve on the unit sphere. The series have eight columns, functions
        of the arc length s: the tangent (3), the point (3), the geodesic curvature k and
        dk/ds. The result has a bound of |d2k/ds2|, for error bounds of velocities.
        """
        sampled_lengths = np.linspace(0.0, curve.length, PROFILE_SCALE_SAMPLES)
        samples = _evaluate_columns(curve, sampled_lengths)
        # Errors are relative to these scales: the largest sampled value of each column, or
        # 1 if that value is smaller.
        scales = np.maximum(1.0, max_abs(samples, axis=0))
        series = PiecewiseChebyshev.fit(
            lambda s: _evaluate_columns(curve, s),
            low=0.0,
            high=curve.length,
            tolerance=SERIES_ERROR,
            scales=scales,
            # The arc lengths between which the curve is analytic. The fit halves cells that
            # are not accurate enough.
            first_cells=curve.edges,
            degree=PROFILE_SERIES_DEGREE,
            max_cells=MAX_PROFILE_CELLS,
            # Rounding errors of the curve do not become smaller in halved cells. Where
            # halving does not help, errors up to this limit are accepted.
            rounding_tolerance=SERIES_ROUNDING_TOLERANCE,
        )
        # Each cell of the series has `SLOPE_SAMPLES` samples, including both ends. The
        # samples divide the cell into one interval less.
        intervals_per_cell = SLOPE_SAMPLES - 1
        positions = series.spread_positions(intervals_per_cell)
        # Column 7 is dk/ds, so its derivative is d2k/ds2. The largest sampled value is
        # enlarged by a factor, because values between samples can be larger.
        curvature_second = np.abs(series.derivative.evaluate(positions)[:, 7])
        bound = SLOPE_SAFETY_FACTOR_OF_PROFILES * float(np.max(curvature_second))
        return ProfileSeries(
            series=series,
            length=curve.length,
            closed=curve.closed,
            max_curvature_second=bound,
        )

    def evaluate(self, s: Floats) -> Floats:
        """Return the columns (8, n) at arc lengths s (n,); NaN beyond an open end.

        The arc length of a closed profile is reduced to one turn. The rows of the result
        are the tangent (3), the point (3), the geodesic curvature k and dk/ds.
        """
        values = self.series.evaluate(np.mod(s, self.length) if self.closed else s)
        if not self.closed:
            values[~((s >= 0.0) & (s <= self.length))] = np.nan
        return np.ascontiguousarray(values.T)

    def evaluate_derivative(self, s: Floats) -> Floats:
        """Return the derivatives (8, n) of the columns with respect to arc length s (n,).

        The rows of the result are the derivatives of the tangent (3), of the point (3), of
        the geodesic curvature k and of dk/ds. Beyond an open end they are those at the end.
        """
        # The arc length of a closed profile is reduced to one turn.
        return self.series.derivative.evaluate(
            np.mod(s, self.length) if self.closed else s
        ).T


def _evaluate_columns(curve: Curve, s: Floats) -> Floats:
    """Return tangent, point, geodesic curvature k and dk/ds of a curve as columns (n, 8).

    The columns are evaluated at arc lengths s (n,), rad.
    """
    points = curve.evaluate(s)
    tangent = points.frame[:, :, 0]
    point = points.frame[:, :, 2]
    return np.column_stack([tangent, point, points.curvature, points.curvature_rate])
