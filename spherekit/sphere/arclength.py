"""Arc length of a curve against its own parameter: measured once, inverted when asked."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import final

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from spherekit.conventions import EPS
from spherekit.numeric import chebyshev
from spherekit.sphere.paths import Parametrised
from spherekit.sphere.rotation import Floats

SLOWEST = 1e-5
"""A curve whose speed falls below this part of its mean speed has a cusp."""

_ORDER = 16
_DEEPEST = 40
_TAIL = 1e-15
_DEGREES = (19, 31)
"""Of inverse series: the second where the first is not exact on every panel."""
_EXACT = 16.0 * EPS
"""Part of half a panel by which places read from the inverse series may be off."""


@final
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
        return np.asarray(self.starts[np.searchsorted(self.edges, u)])

    def invert(self, s: Floats) -> Floats:
        """Return u (n,) at arc lengths s (n,).

        Where a panel's inverse series is not exact, by Newton steps kept inside a bracket.
        """
        panel = np.searchsorted(self.starts[1:-1], s, side="right")
        target = s - self.starts[panel]
        series, exact = self._inverse
        part = 2.0 * target / (self.starts[panel + 1] - self.starts[panel]) - 1.0
        part = _within_panel(part)
        x = part + _sum(series, panel, part)
        left = ~exact[panel]
        if np.any(left):
            x[left] = self._solved(panel[left], target[left], x[left])
        half = 0.5 * (self.edges[panel + 1] - self.edges[panel])
        return np.asarray(self.edges[panel] + half * (1.0 + _within_panel(x)))

    @cached_property
    def _inverse(self) -> tuple[Floats, NDArray[np.bool_]]:
        """Powers (order, panels) of x less the part of a panel's length, -1 to 1, by that.

        And which of them are exact, measured between the places at which they are made.
        """
        lengths = np.diff(self.starts)
        for degree in _DEGREES:
            between = np.cos(np.arange(degree + 2) * np.pi / (degree + 1))
            parts = np.concatenate([chebyshev.nodes(degree), between])
            panel = np.repeat(np.arange(len(lengths)), len(parts))
            parts = np.tile(parts, len(lengths))
            x = self._solved(panel, 0.5 * (1.0 + parts) * lengths[panel], parts)
            away = (x - parts).reshape(len(lengths), -1)
            series = chebyshev.through(away[:, : degree + 1, None])[..., 0]
            powers = np.ascontiguousarray(_powers(degree) @ series.T)
            miss = _sum(powers, panel, parts).reshape(away.shape) - away
            exact = np.all(np.abs(miss) <= _EXACT, axis=1)
            if np.all(exact):
                break
        return powers, exact

    def _solved(self, panel: NDArray[np.intp], target: Floats, x: Floats) -> Floats:
        """Return x (n,) at lengths from panels' starts, by Newton steps from x (n,)."""
        low, high = np.full(x.shape, -1.0), np.full(x.shape, 1.0)
        done = ~np.isfinite(x)
        for _ in range(100):
            covered, rate = self.within(panel, x)
            low = np.where(covered <= target, x, low)
            high = np.where(covered >= target, x, high)
            new = x - (covered - target) / rate
            lost = (new < low - 1e-9) | (new > high + 1e-9)
            new = np.where(lost, 0.5 * (low + high), new)
            near = ~lost & (np.abs(new - x) < 1e-9)
            x, done = np.where(done, x, new), done | near
            if np.all(done):
                break
        return x

    def at(self, u: Floats) -> Floats:
        """Return the arc lengths (n,) of parameters u (n,)."""
        panel = np.searchsorted(self.edges[1:-1], u, side="right")
        low, high = self.edges[panel], self.edges[panel + 1]
        covered, _ = self.within(panel, (2.0 * u - low - high) / (high - low))
        return np.asarray(self.starts[panel] + covered)

    def within(self, panel: NDArray[np.intp], x: Floats) -> tuple[Floats, Floats]:
        """Return the arc length from a panel's start to x, and ds/dx, both (n,)."""
        before, here = np.ones_like(x), x
        rate = self.speeds[0, panel]
        covered = rate * (1.0 + x)
        for degree in range(1, len(self.speeds)):
            after = ((2 * degree + 1) * x * here - degree * before) / (degree + 1)
            part = self.speeds[degree, panel]
            rate = rate + part * here
            covered = covered + part * (after - before) / (2 * degree + 1)
            before, here = here, after
        return covered, rate


def measure(path: Parametrised, edges: Floats, rounding: Floats | None = None) -> ArcLength:
    """Return the table of arc length over panels, halved until the series has ended.

    The curve has to be smooth between `edges`. `rounding` as in `integrated`.
    """
    slowest, where = np.inf, 0.0

    def speed(u: Floats) -> Floats:
        nonlocal slowest, where
        here = path.speed(u)
        at = np.unravel_index(int(np.argmin(here)), here.shape)
        if here[at] < slowest:
            slowest, where = float(here[at]), float(u[at])
        return here

    table = integrated(speed, edges, rounding)
    speed(edges)
    if slowest < SLOWEST * table.length / (edges[-1] - edges[0]):
        raise ValueError(
            f"the curve has a cusp near {path.place(where)}: its speed vanishes there; a "
            "profile has to be smooth"
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
    ready: list[tuple[Floats, Floats, Floats]] = []
    total = 0.0
    noise = np.zeros(len(low)) if rounding is None else rounding
    for depth in range(_DEEPEST + 1):
        series = gauss_series(rate, low, high)
        largest = np.max(np.abs(series), axis=1)
        if depth == 0:
            total = 2.0 * float(np.sum(largest))
        tail = np.max(np.abs(series[:, -2:]), axis=1) / _ORDER
        smooth = (tail <= _TAIL * total) | (tail <= noise * largest)
        smooth |= depth == _DEEPEST
        ready.append((low[smooth], high[smooth], series[smooth]))
        rest = ~smooth
        middle = low[rest] + 0.5 * (high[rest] - low[rest])
        low = np.concatenate([low[rest], middle])
        high = np.concatenate([middle, high[rest]])
        noise = np.tile(noise[rest], 2)
        if not len(low):
            break
    starts = np.concatenate([part[0] for part in ready])
    order = np.argsort(starts)
    speeds = np.concatenate([part[2] for part in ready])[order]
    return ArcLength(
        edges=np.append(starts[order], edges[-1]),
        starts=np.concatenate([[0.0], np.cumsum(2.0 * speeds[:, 0])]),
        speeds=np.ascontiguousarray(speeds.T),
    )


def gauss_series(rate: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Return the Legendre series (panels, order) of a rate by x, -1 to 1 on each panel."""
    nodes, weights = leggauss(_ORDER)
    rows = np.polynomial.legendre.legvander(nodes, _ORDER - 1) * weights[:, None]
    rows *= np.arange(_ORDER) + 0.5
    half = 0.5 * (high - low)[:, None]
    return np.asarray(half * (rate(low[:, None] + half * (1.0 + nodes)) @ rows))


def _within_panel(x: Floats) -> Floats:
    """Return places of panels brought into -1 to 1; much faster than NumPy's own."""
    return np.minimum(np.maximum(x, -1.0), 1.0)


def _sum(powers: Floats, panel: NDArray[np.intp], x: Floats) -> Floats:
    """Return polynomials (order, panels) of panels (n,) at x (n,), by Horner's scheme."""
    rows = powers.take(panel, axis=1)
    total: Floats = rows[-1]
    for row in rows[-2::-1]:
        total *= x
        total += row
    return total


@cache
def _powers(degree: int) -> Floats:
    """Return the matrix that makes powers of Chebyshev series.

    Series that have ended at 16 terms fall by more than a half from each to the next, so
    that their powers lose nothing.
    """
    made = np.zeros((degree + 1, degree + 1))
    for order, unit in enumerate(np.eye(degree + 1)):
        row = np.polynomial.chebyshev.cheb2poly(unit)
        made[: len(row), order] = row
    return made
