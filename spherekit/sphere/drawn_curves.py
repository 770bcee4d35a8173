"""Curves that differ a little from one, each at places of its own."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.sphere.arclength import ArcLength, gauss_series, measure
from spherekit.sphere.paths import FourierPath
from spherekit.sphere.profile import Curve, azimuth_panels, fourier_path
from spherekit.sphere.rotation import Floats

CORRECTIONS = 3
"""Newton steps from the azimuth of the curve that others differ from: 1e-3, 1e-6, 1e-12."""


@final
@dataclass(frozen=True)
class DrawnCurves:
    """Closed curves (d,) with a Fourier colatitude, near one whose arc length is a `table`.

    Their `axes` (3, 3, d), `cosines` and `sines` (k, d); `speeds` (order, panels, d) and
    `starts` (panels + 1, d) of their arc length on the panels of the table.
    """

    table: ArcLength
    axes: Floats
    cosines: Floats
    sines: Floats
    speeds: Floats
    starts: Floats
    backwards: bool

    @staticmethod
    def of(nominal: Curve, curves: Sequence[Curve]) -> "DrawnCurves | None":
        """Return curves that are near a nominal one; None where they are splines."""
        both = fourier_path(nominal)
        paths = [path for curve in curves if (path := fourier_path(curve))]
        if both is None or len(paths) < len(curves):
            return None
        table = measure(both[0], azimuth_panels(len(both[0].cosines)))
        low, high = table.edges[:-1], table.edges[1:]
        speeds = np.stack([gauss_series(p.speed, low, high).T for p, _ in paths], axis=2)
        return DrawnCurves(
            table,
            np.stack([path.axes for path, _ in paths], axis=2),
            np.stack([path.cosines for path, _ in paths], axis=1),
            np.stack([path.sines for path, _ in paths], axis=1),
            speeds,
            np.pad(np.cumsum(2.0 * speeds[0], axis=0), ((1, 0), (0, 0))),
            both[1],
        )

    def at(self, s: Floats, curve: NDArray[np.intp]) -> Floats:
        """Return tangent, point, k and dk/ds (8, n) at arc lengths (n,) of curves (n,)."""
        forward = np.mod(-s if self.backwards else s, self.starts[-1, curve])
        path = FourierPath(
            self.axes[:, :, curve], self.cosines[:, curve], self.sines[:, curve]
        )
        frame, bend, slope = path.frame(self._azimuth(forward, curve))
        sense = -1.0 if self.backwards else 1.0
        tangent, point = frame[:, :, 0].T, frame[:, :, 2].T
        return np.concatenate([sense * tangent, point, sense * bend[None], slope[None]])

    def _azimuth(self, s: Floats, curve: NDArray[np.intp]) -> Floats:
        u = self.table.invert(s * (self.table.length / self.starts[-1, curve]))
        edges = self.table.edges
        panel = np.searchsorted(edges[1:-1], u, side="right")
        half = 0.5 * (edges[panel + 1] - edges[panel])
        x, target = (u - edges[panel]) / half - 1.0, s - self.starts[panel, curve]
        drawn = ArcLength(edges, edges, self.speeds[:, panel, curve])
        every = np.arange(len(s))
        for _ in range(CORRECTIONS):
            covered, rate = drawn.within(every, x)
            x = x - (covered - target) / rate
        return edges[panel] + half * (1.0 + x)
