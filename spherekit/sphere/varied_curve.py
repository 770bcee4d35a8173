"""How a curve on the sphere changes with what it is made from, at the same arc length."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from spherekit.sphere.arclength import ArcLength, integrated, measure
from spherekit.sphere.complex_step import slope_of, stepped
from spherekit.sphere.paths import FourierPath, Path, axes_about
from spherekit.sphere.profile import azimuth_panels
from spherekit.sphere.rotation import Floats
from spherekit.sphere.varied_spline import varied_spline


@final
@dataclass(frozen=True)
class VariedCurve:
    """A curve with its derivatives by something that changes it.

    The `path` carries them as complex steps; `table` has its arc length, `stretch` how
    that changes at the same parameter, and the whole changes by `longer`.
    """

    path: Path
    table: ArcLength
    stretch: ArcLength
    longer: float
    closed: bool
    backwards: bool = False

    def at(self, s: Floats) -> Floats:
        """Return the derivatives (8, n) at arc lengths s (n,) rad that stay.

        Of the tangent, the point, the geodesic curvature k and dk/ds.
        """
        length = self.table.length
        forward, moved = s, np.zeros_like(s)
        if self.backwards:
            forward = -s
            if not self.closed:
                forward, moved = forward + length, moved + self.longer
        if self.closed:
            laps = np.floor(forward / length)
            forward, moved = forward - laps * length, moved - laps * self.longer
        u = self.table.invert(forward)
        moved = (moved - self.stretch.at(u)) / np.real(self.path.speed(stepped(u, 0.0)))
        frame, curvature, rate = (slope_of(x) for x in self.path.frame(stepped(u, moved)))
        sense = -1.0 if self.backwards else 1.0
        rows = [sense * frame[:, :, 0].T, frame[:, :, 2].T, sense * curvature[None]]
        return np.concatenate([*rows, rate[None]])


def varied_round(
    centre: tuple[ArrayLike, ArrayLike],
    cosines: tuple[ArrayLike, ArrayLike],
    sines: tuple[ArrayLike, ArrayLike] = ((), ()),
    backwards: bool = False,
) -> VariedCurve:
    """Return the curve of `fourier`; of one coefficient, the radius, that of `circle`.

    The unit vector `centre` (3,) and the coefficients each with their derivatives.
    """
    size = max(np.size(cosines[0]), np.size(sines[0]))
    series = np.zeros((2, 2, size))
    for row, both in enumerate((cosines, sines)):
        for k, given in enumerate(both):
            series[k, row, : np.size(given)] = given
    even, odd = stepped(*series)
    path = FourierPath(axes_about(stepped(*centre)), even, odd)
    still = FourierPath(axes_about(np.asarray(centre[0], dtype=float)), *series[0])
    edges = azimuth_panels(size)
    stretch = integrated(lambda u: slope_of(path.speed(stepped(u, 0.0))), edges)
    table = measure(still, edges)
    return VariedCurve(path, table, stretch, stretch.length, True, backwards)


def varied_through(
    points: ArrayLike, change: ArrayLike, closed: bool, backwards: bool = False
) -> VariedCurve:
    """Return the curve of `through` while its points move, both (m, 3)."""
    given, moved = (np.asarray(item, dtype=float) for item in (points, change))
    return VariedCurve(*varied_spline(given, moved, closed), closed, backwards)
