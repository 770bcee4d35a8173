"""The spline of a profile through points, while the points move.

Its knots are lengths along the curve and move with it. By complex steps the same spline
is laid once more, from its slopes and bends at the knots: on each panel the quintic that
has these at both ends, with third and fourth derivatives that agree where panels meet.
"""

from dataclasses import dataclass
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

    panels = len(knots) - 1
    h = np.diff(knots)[:, None]
    steps = (points[1:] - points[:-1]) / h**3
    rows = _Rows(h[:, 0], steps, closed)
    # Third and fourth derivatives over 6 and 24, and fifth ones over 120, by how far the
    # values, slopes and bends at the ends of a panel are from those of a parabola.
    for knot in range(0 if closed else 1, panels):
        before, after = knot - 1, knot
        rows.equal(before, (10.0, -6.0, 1.5), 0, after, (10.0, -4.0, 0.5))
        rows.equal(before, (15.0, -8.0, 1.5), 1, after, (-15.0, 7.0, -1.0))
        if not closed and knot in (1, 2, panels - 2, panels - 1):
            rows.equal(before, (6.0, -3.0, 0.5), 2, after, (6.0, -3.0, 0.5))
    matrix, right = rows.made()
    count = right.shape[0]
    system = coo_array(matrix, shape=(count, count)).tocsc()
    solved = splu(system).solve(np.ascontiguousarray(right)).reshape(-1, 2, 3)
    ends = np.arange(panels + 1) % len(solved)
    (a0, b0), (a1, b1) = (
        (solved[some, 0], solved[some, 1]) for some in (ends[:-1], ends[1:])
    )
    d = steps - a0 / h**2 - 0.5 * b0 / h
    e = (a1 - a0) / h**2 - b0 / h
    f = (b1 - b0) / h
    coefficients = [
        points[:-1],
        a0,
        0.5 * b0,
        10.0 * d - 4.0 * e + 0.5 * f,
        (-15.0 * d + 7.0 * e - f) / h,
        (6.0 * d - 3.0 * e + 0.5 * f) / h**2,
    ]
    return QuinticPanels(knots, np.stack(coefficients, axis=1))


class _Rows:
    """Linear equations of slopes and bends (2 for each knot) by panels of lengths h."""

    def __init__(self, h: Floats, steps: Floats, closed: bool) -> None:
        self.h, self.steps = h, steps
        self.count = len(h) if closed else len(h) + 1
        self.entries: list[tuple[int, int, complex]] = []
        self.right: list[Floats] = []

    def equal(
        self,
        one: int,
        of_one: tuple[float, float, float],
        power: int,
        other: int,
        of_other: tuple[float, float, float],
    ) -> None:
        """Add that a derivative is the same on two panels, over a power of lengths."""
        total = np.zeros(3, dtype=self.steps.dtype)
        for panel, weights, sign in ((one, of_one, 1.0), (other, of_other, -1.0)):
            d, e, f = (sign * weight for weight in weights)
            h = self.h[panel]
            start, end = panel % self.count, (panel + 1) % self.count
            share = h**-power
            for column, entry in (
                (2 * start, -(d + e) / h**2),
                (2 * start + 1, -(0.5 * d + e + f) / h),
                (2 * end, e / h**2),
                (2 * end + 1, f / h),
            ):
                self.entries.append((len(self.right), column, share * entry))
            total = total - share * d * self.steps[panel]
        self.right.append(total)

    def made(self) -> tuple[tuple[Floats, tuple[Floats, Floats]], Floats]:
        """Return the entries with their rows and columns, and the right sides (k, 3)."""
        row, column, entry = (np.array(item) for item in zip(*self.entries, strict=True))
        return (entry, (row, column)), np.stack(self.right)


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
