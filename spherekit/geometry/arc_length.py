"""Arc length of a curve as a function of its own parameter, and its inverse."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss, legint, legval, legvander

from spherekit.arrays import Floats, Indices
from spherekit.geometry.parametric_curve import FourierPath, SplinePath
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.tolerances import EPS

MIN_SPEED_RATIO = 1e-5
"""Speed of a path, relative to its mean speed, below which it has a cusp.

Larger: smooth curves with slow parts are refused. Smaller: cusps between the checked
parameters are missed.
"""

SERIES_ORDER = 16
"""Number of Legendre coefficients of the speed on a panel.

Larger: fewer panels, each of which takes longer.
"""

MAX_PIECE_HALVINGS = 40
"""Largest number of halvings of a panel. Smaller: speeds with kinks get a larger error."""

SERIES_TOLERANCE = 1e-15
"""Largest of the last two coefficients of a panel, divided by `SERIES_ORDER` and the whole
length.

Larger: fewer panels and a larger error. Smaller: panels are halved for rounding errors.
"""

INVERSE_TOLERANCE = 4.0 * EPS
"""Largest error of the parameter at an arc length, relative to the largest parameter.

Larger: fewer cells and a larger error. Smaller: cells are halved for rounding errors.
"""

INVERSE_ROUNDING_TOLERANCE = 1e-12
"""Accepted error of the parameter, if halving the cells does not reduce it any further.

The error is relative to the largest parameter. Some arc lengths lose digits. Smaller: such
curves get as many cells as allowed.
"""


@dataclass(frozen=True)
class ArcLength:
    """The arc length s of a curve as a function of its parameter u.

    The range of u is divided into panels. On each panel the speed is a Legendre series in
    the position x in the panel, from -1 to 1. The series are integrated exactly.

    Attributes
    ----------
    edges
        (panels + 1,) parameters u at the edges of the panels, rising.
    starts
        (panels + 1,) arc lengths at the edges.
    speeds
        (order, panels) Legendre coefficients of ds/dx on each panel.
    """

    edges: Floats
    starts: Floats
    speeds: Floats

    @property
    def length(self) -> float:
        """The whole arc length."""
        return float(self.starts[-1])

    def evaluate(self, u: Floats) -> Floats:
        """Return the arc lengths (n,) at parameters u (n,)."""
        panel = np.searchsorted(self.edges[1:-1], u, side="right")
        low = self.edges[panel]
        high = self.edges[panel + 1]
        position = (2.0 * u - low - high) / (high - low)
        return self.starts[panel] + self._evaluate_in_panels(panel, position)

    def evaluate_at_edges(self, u: Floats) -> Floats:
        """Return the stored arc lengths (n,) at parameters u (n,) that are panel edges."""
        return self.starts[np.searchsorted(self.edges, u)]

    def invert(self, s: Floats) -> Floats:
        """Return the parameters u (n,) at arc lengths s (n,)."""
        (deviations,) = self._inverse_deviation.evaluate_pointwise(s)
        return s * self._mean_slope + deviations

    @property
    def _mean_slope(self) -> float:
        """The mean derivative du/ds."""
        return float(self.edges[-1] - self.edges[0]) / self.length

    @cached_property
    def _inverse_deviation(self) -> PiecewiseChebyshev:
        """Interpolant of the curve parameter u minus its linear part, as a function of s.

        Here s is the arc length. `invert` uses the interpolant to find the point at an arc
        length. The linear part is s times the mean slope of u over s. It is left out here,
        and `invert` adds it again: the interpolant of the smaller remaining part has
        smaller rounding errors and fewer cells.
        """

        def find_deviations(s: Floats) -> Floats:
            """Return the parameters at arc lengths s (n,), minus the linear part (n, 1)."""
            return (self._find_parameters(s) - s * self._mean_slope)[:, None]

        # `edges` are the parameters u at the ends of the panels (parts of the curve), and
        # `starts` the arc lengths there. Errors are relative to the largest parameter.
        largest_parameter = self.edges[-1:]
        # The fit begins with one cell for each panel. It halves cells until the first
        # tolerance is reached. The second tolerance counts where rounding prevents this.
        return PiecewiseChebyshev.fit(
            find_deviations,
            low=0.0,
            high=self.length,
            tolerance=INVERSE_TOLERANCE,
            scales=largest_parameter,
            first_cells=self.starts,
            rounding_tolerance=INVERSE_ROUNDING_TOLERANCE,
        )

    def _find_parameters(self, s: Floats) -> Floats:
        """Return the parameters u (n,) at arc lengths s (n,), by iteration.

        `invert` interpolates the parameters that are computed here.
        """
        panel = np.searchsorted(self.starts[1:-1], s, side="right")
        length_in_panel = s - self.starts[panel]
        panel_length = np.diff(self.starts)[panel]
        x = self._find_positions(panel, length_in_panel, panel_length)
        # Convert the positions from -1 to 1 in the panel to the parameter.
        half_width = 0.5 * np.diff(self.edges)[panel]
        return self.edges[panel] + half_width * (1.0 + x)

    def _find_positions(
        self, panel: Indices, length_in_panel: Floats, panel_length: Floats
    ) -> Floats:
        """Return the positions x in panels at which the arc length has given values.

        The curve is divided into panels. Along a panel, x runs from -1 to 1 and the arc
        length rises. So there is one position for each value.

        Parameters
        ----------
        panel
            (n,) indices of the panels.
        length_in_panel
            (n,) arc lengths from the starts of the panels to the positions.
        panel_length
            (n,) arc lengths of the whole panels.

        Returns
        -------
        (n,) positions x from -1 to 1.
        """

        def evaluate_excess(x: Floats, rows: Indices) -> Floats:
            """Return the arc lengths at x, minus the given ones, for some of the rows."""
            return self._evaluate_in_panels(panel[rows], x) - length_in_panel[rows]

        ones = np.ones_like(length_in_panel)
        positions, _ = find_bracketed_zeros(
            evaluate_excess,
            low=-ones,
            high=ones,
            # At the start of a panel the arc length is zero, at its end the length of the
            # panel.
            values_at_low=-length_in_panel,
            values_at_high=panel_length - length_in_panel,
            tolerance=EPS,
        )
        return positions

    def _evaluate_in_panels(self, panel: Indices, x: Floats) -> Floats:
        """Return arc lengths (n,) from the starts of panels (n,) to positions x (n,)."""
        return np.asarray(legval(x, self._integrals[:, panel], tensor=False))

    @cached_property
    def _integrals(self) -> Floats:
        """(order + 1, panels) series of the arc length from the start of each panel."""
        return np.asarray(legint(self.speeds, lbnd=-1))


def measure_arc_length(path: FourierPath | SplinePath, edges: Floats) -> ArcLength:
    """Return the arc length of a path as a function of its parameter.

    Parameters
    ----------
    path
        A curve on the unit sphere that is smooth between the edges.
    edges
        (panels + 1,) parameters that divide the path into panels. In each panel a series
        approximates the speed. Panels are halved until the series is accurate enough.

    Raises
    ------
    ValueError
        If the path has a cusp (point without speed and tangent).
    """
    arc_length = integrate_rate(path.speed, edges)
    # The speed is zero at a cusp. The speed is checked at the edges and middles of all
    # panels.
    middles = 0.5 * (arc_length.edges[1:] + arc_length.edges[:-1])
    u = np.sort(np.append(arc_length.edges, middles))
    mean_speed = arc_length.length / (edges[-1] - edges[0])
    is_slow = path.speed(u) < MIN_SPEED_RATIO * mean_speed
    if np.any(is_slow):
        raise ValueError(
            f"the curve has a cusp near {path.describe_position(u[np.argmax(is_slow)])}: "
            "its speed vanishes there; a profile has to be smooth"
        )
    return arc_length


def integrate_rate(
    rate: Callable[[Floats], Floats], edges: Floats, rounding: Floats | None = None
) -> ArcLength:
    """Return the integral of a function, such as the arc length from a speed.

    Each panel is sampled at Gauss-Legendre nodes, which give a Legendre series. Panels are
    halved until the last coefficients of their series are negligible, or
    `MAX_PIECE_HALVINGS` times.

    Parameters
    ----------
    rate
        Function of parameters of any shape. The function is analytic between the edges.
    edges
        (panels + 1,) parameters of the first panels.
    rounding
        (panels,) relative error of the function, if it exceeds the machine precision.
        Panels are not halved to resolve this error.
    """
    low = edges[:-1]
    high = edges[1:]
    relative_error = np.zeros(len(low)) if rounding is None else rounding
    # The coefficient of order k is k + 1/2 times the integral of the function times the
    # Legendre polynomial P_k, which Gauss's rule gives from values at the nodes.
    nodes, weights = leggauss(SERIES_ORDER)
    to_coefficients = legvander(nodes, SERIES_ORDER - 1) * weights[:, None]
    to_coefficients *= np.arange(SERIES_ORDER) + 0.5

    final_starts: list[Floats] = []
    final_series: list[Floats] = []
    scale = 0.0  # size of the whole integral, set in the first round
    for halvings in range(MAX_PIECE_HALVINGS + 1):
        # (panels, order) series of the rate as a function of the position x from -1 to 1 in
        # each panel.
        half = 0.5 * (high - low)[:, None]
        series = half * (rate(low[:, None] + half * (1.0 + nodes)) @ to_coefficients)
        largest = max_abs(series, axis=1)
        # The integral over a panel is twice its first coefficient. The scale is taken from
        # the largest coefficient, because the first one can vanish where the function
        # changes its sign.
        if halvings == 0:
            scale = 2.0 * float(np.sum(largest))
        # Integration divides the coefficient of order k by 2 k + 1, so the last ones are
        # divided by more than the order.
        last_coefficients = max_abs(series[:, -2:], axis=1) / SERIES_ORDER
        is_final = (last_coefficients <= SERIES_TOLERANCE * scale) | (
            last_coefficients <= relative_error * largest
        )
        is_final |= halvings == MAX_PIECE_HALVINGS
        final_starts.append(low[is_final])
        final_series.append(series[is_final])

        # The other panels are halved, and examined in the next round.
        is_halved = ~is_final
        middle = low[is_halved] + 0.5 * (high[is_halved] - low[is_halved])
        low = np.concatenate([low[is_halved], middle])
        high = np.concatenate([middle, high[is_halved]])
        relative_error = np.tile(relative_error[is_halved], 2)
        if not len(low):
            break
    # Panels have become final in any order.
    starts = np.concatenate(final_starts)
    order = np.argsort(starts)
    rate_series = np.ascontiguousarray(np.concatenate(final_series)[order].T)
    # The integral of a Legendre series over its panel is twice the first coefficient.
    integrals = np.append(0.0, np.cumsum(2.0 * rate_series[0]))
    panel_edges = np.append(starts[order], edges[-1])
    return ArcLength(edges=panel_edges, starts=integrals, speeds=rate_series)
