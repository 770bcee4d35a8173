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

SLOWEST = 1e-5
"""A curve whose speed falls below this part of its mean speed has a cusp."""


_ORDER = 16


_DEEPEST = 40


_TAIL = 1e-15


_EXACT = 4.0 * EPS
"""Error of u by the arc length, relative to its largest."""


_ROUNDING = 1e-12
"""What that may be where lengths lose digits."""


@dataclass(frozen=True)
class ArcLength:
    """Arc length against the parameter u, as Legendre series of the speed on panels.

    `edges` (panels + 1,) in u and `starts` (panels + 1,) in s bound the panels;
    `speeds` (order, panels) are the coefficients of ds/dx, x = -1 to 1 on each.
    """

    edges: Floats
    starts: Floats
    speeds: Floats

    @property
    def length(self) -> float:
        """The whole arc length (rad)."""
        return float(self.starts[-1])

    def at_edge(self, u: Floats) -> Floats:
        """Return the arc lengths of parameters that are edges."""
        return self.starts[np.searchsorted(self.edges, u)]

    def invert(self, s: Floats) -> Floats:
        """Return u (n,) at arc lengths s (n,)."""
        return s * self._pace + self._inverse.evaluate_pointwise(s)[0]

    @property
    def _pace(self) -> float:
        """The mean rate of u by the arc length."""
        return float(self.edges[-1] - self.edges[0]) / self.length

    @cached_property
    def _inverse(self) -> PiecewiseChebyshev:
        """What u is more than by its mean rate, by the arc length."""

        def more(s: Floats) -> Floats:
            panel = np.searchsorted(self.starts[1:-1], s, side="right")
            target = s - self.starts[panel]

            def gap(x: Floats, rows: Indices) -> Floats:
                return self.within(panel[rows], x) - target[rows]

            one, left = np.ones_like(s), np.diff(self.starts)[panel] - target
            x, _ = find_bracketed_zeros(gap, -one, one, -target, left, EPS)
            u = self.edges[panel] + 0.5 * np.diff(self.edges)[panel] * (1.0 + x)
            return (u - s * self._pace)[:, None]

        size, cells = self.edges[-1:], self.starts
        return PiecewiseChebyshev.fit(
            more, 0.0, self.length, _EXACT, size, cells, rounding_tolerance=_ROUNDING
        )

    def at(self, u: Floats) -> Floats:
        """Return the arc lengths (n,) of parameters u (n,)."""
        panel = np.searchsorted(self.edges[1:-1], u, side="right")
        low, high = self.edges[panel], self.edges[panel + 1]
        return self.starts[panel] + self.within(
            panel, (2.0 * u - low - high) / (high - low)
        )

    def within(self, panel: Indices, x: Floats) -> Floats:
        """Return the arc length (n,) from a panel's start to x."""
        return np.asarray(legval(x, self._covered[:, panel], tensor=False))

    @cached_property
    def _covered(self) -> Floats:
        """(order + 1, panels) the series of the arc length from the panel's start."""
        return np.asarray(legint(self.speeds, lbnd=-1))


def measure(path: FourierPath | SplinePath, edges: Floats) -> ArcLength:
    """Return the table of arc length over panels, halved until the series has ended.

    The curve has to be smooth between `edges`.
    """
    table = integrated(path.speed, edges)
    u = np.sort(np.append(table.edges, 0.5 * (table.edges[1:] + table.edges[:-1])))
    slow = path.speed(u) < SLOWEST * table.length / (edges[-1] - edges[0])
    if np.any(slow):
        raise ValueError(
            f"the curve has a cusp near {path.place(u[np.argmax(slow)])}: its speed "
            "vanishes there; a profile has to be smooth"
        )
    return table


def integrated(
    rate: Callable[[Floats], Floats], edges: Floats, rounding: Floats | None = None
) -> ArcLength:
    """Return the table of the integral of a rate over panels that are halved.

    Gauss-Legendre nodes give each series. `rounding` (panels,) is the relative error of
    the rate where it is known less well than to machine precision: no panel is halved to
    resolve that.
    """
    low, high = edges[:-1], edges[1:]
    ready: list[tuple[Floats, Floats]] = []
    total = 0.0
    noise = np.zeros(len(low)) if rounding is None else rounding
    nodes, weights = leggauss(_ORDER)
    rows = legvander(nodes, _ORDER - 1) * weights[:, None]
    rows *= np.arange(_ORDER) + 0.5
    for depth in range(_DEEPEST + 1):
        half = 0.5 * (high - low)[:, None]
        series = half * (rate(low[:, None] + half * (1.0 + nodes)) @ rows)
        largest = max_abs(series, axis=1)
        if depth == 0:
            total = 2.0 * float(np.sum(largest))
        tail = max_abs(series[:, -2:], axis=1) / _ORDER
        smooth = (tail <= _TAIL * total) | (tail <= noise * largest)
        smooth |= depth == _DEEPEST
        ready.append((low[smooth], series[smooth]))
        rest = ~smooth
        middle = low[rest] + 0.5 * (high[rest] - low[rest])
        low = np.concatenate([low[rest], middle])
        high = np.concatenate([middle, high[rest]])
        noise = np.tile(noise[rest], 2)
        if not len(low):
            break
    starts, speeds = map(np.concatenate, zip(*ready, strict=True))
    order = np.argsort(starts)
    speeds = np.ascontiguousarray(speeds[order].T)
    arcs = np.append(0.0, np.cumsum(2.0 * speeds[0]))
    return ArcLength(np.append(starts[order], edges[-1]), arcs, speeds)
