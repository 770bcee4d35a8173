"""The spline of a profile through points, while the points move.

Its knots are lengths along the curve and move with it. By complex steps the same spline
is laid once more: on each panel a quintic through the points at both ends, with
derivatives that agree where panels meet.
"""

from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np

from spherekit.sphere.arclength import ArcLength, integrated
from spherekit.sphere.complex_step import slope_of, stepped
from spherekit.sphere.paths import SplinePath, dot
from spherekit.sphere.profile import spline_fits
from spherekit.sphere.rotation import Floats, cross


@final
@dataclass(frozen=True)
class QuinticPanels:
    """A spline in powers of u from each knot on: `coefficients` (panels, 6, 3)."""

    knots: Floats
    coefficients: Floats

    def __call__(self, u: Floats, order: int = 0) -> Floats:
        """Return the derivative (..., 3) of an order at u of any shape."""
        last = len(self.knots) - 2
        inner = np.real(self.knots)
        panel = np.clip(np.searchsorted(inner, np.real(u), side="right") - 1, 0, last)
        x = (u - self.knots[panel])[..., None]
        total = np.zeros((*np.shape(u), 3), dtype=self.coefficients.dtype)
        for power in range(5, order - 1, -1):
            factor = float(np.prod(np.arange(power - order + 1, power + 1)))
            total = total * x + factor * self.coefficients[panel, power]
        return np.asarray(total)


def quintic_panels(knots: Floats, points: Floats, closed: bool) -> QuinticPanels:
    """Return the quintic spline through points (m, 3) at knots (m,), periodic if closed.

    An open one has no knots at the two points next to each end. Numbers may be complex.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    h, panels = np.diff(knots), len(knots) - 1
    mean = float(np.real(np.mean(h)))
    entries: list[tuple[complex, int, int]] = []
    right = np.zeros((6 * panels, 3), dtype=points.dtype)
    row = 0

    def add(panel: int, part: float, order: int, sign: float = 1.0) -> None:
        """Add a derivative at the start or end (0 or 1) of a panel to the last equation."""
        scale = sign * (mean / h[panel]) ** order
        for power in range(order, 6 if part else order + 1):
            factor = np.prod(np.arange(power - order + 1, power + 1))
            entries.append((scale * factor, row, 6 * (panel % panels) + power))

    for panel, part in product(range(panels), (0, 1)):
        add(panel, part, 0)
        right[row] = points[panel + part]
        row += 1
    for knot in range(0 if closed else 1, panels):
        no_knot = not closed and knot in (1, 2, panels - 2, panels - 1)
        for order in range(1, 6 if no_knot else 5):
            add(knot - 1, 1, order)
            add(knot, 0, order, -1.0)
            row += 1
    values, rows, columns = (np.array(item) for item in zip(*entries, strict=True))
    system = coo_array((values, (rows, columns)), shape=(row, row)).tocsc()
    solved = splu(system).solve(right).reshape(panels, 6, 3)
    return QuinticPanels(knots, solved / h[:, None, None] ** np.arange(6.0)[:, None])


def varied_spline(
    points: Floats, change: Floats, closed: bool
) -> tuple[SplinePath, ArcLength, ArcLength, float]:
    """Return the spline of `through` with what it changes by, as complex steps.

    Also the table of its arc length, that of how the arc length changes at the same
    parameter, and by what the whole of it does.

    Parameters
    ----------
    points, change
        (m, 3) unit vectors, and their derivatives by what moves them.
    """
    moved = stepped(points, change)
    moved = moved / np.sqrt(dot(moved, moved))[:, None]
    if closed:
        moved = np.concatenate([moved, moved[:1]])
    steps = _chords(moved)
    fits = list(spline_fits(points, closed))
    for path, _ in fits:
        knots = stepped(path.knots, np.concatenate([[0.0], np.cumsum(steps)]))
        varied = SplinePath(quintic_panels(knots, moved, closed), path.knots, closed)
        stretch = integrated(lambda u: slope_of(varied.speed(stepped(u, 0.0))), path.knots)  # noqa: B023
        steps = np.diff(
            stretch.at_edge(path.knots) + path.speed(path.knots) * slope_of(knots)
        )
    return varied, fits[-1][1], stretch, float(np.sum(steps))


def _chords(points: Floats) -> Floats:
    """Return how the angles between successive points change (m - 1,)."""
    across = cross(points[:-1], points[1:])
    sine, cosine = np.sqrt(dot(across, across)), dot(points[:-1], points[1:])
    return np.asarray(np.real(cosine) * slope_of(sine) - np.real(sine) * slope_of(cosine))
