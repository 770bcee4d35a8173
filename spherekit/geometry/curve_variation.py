"""How a curve on the sphere changes with what it is made from, at the same arc length.

The spline of a profile through points, while the points move.

Its knots are lengths along the curve and move with it. By complex steps the same spline
is laid once more: on each panel a quintic through the points at both ends, with
derivatives that agree where panels meet.
"""

from collections.abc import Callable
from math import perm

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.geometry.arc_length import ArcLength, integrated, measure
from spherekit.geometry.parametric_curve import (
    FourierPath,
    Path,
    SplinePath,
    axes_about,
    dot,
)
from spherekit.geometry.profile_curve import azimuth_panels, spline_fits
from spherekit.geometry.rotation import cross
from spherekit.numerics.complex_step import add_complex_step, extract_derivative

_DERIVATIVES = np.array([[perm(power, k) for power in range(6)] for k in range(6)], float)
"""The derivatives of each order of the powers of a number, at 1."""


def quintic_panels(
    knots: Floats, points: Floats, closed: bool
) -> Callable[[Floats, int], Floats]:
    """Return the quintic spline through points (m, 3) at knots (m,), periodic if closed.

    That is its derivative (..., 3) of an order at parameters of any shape.

    An open one has no knots at the two points next to each end. Numbers may be complex.
    """
    from scipy.sparse import block_diag, vstack
    from scipy.sparse.linalg import splu

    h, panels = np.diff(knots), len(knots) - 1
    per_panel = h[:, None] ** np.arange(6.0)
    scale = (np.real(np.mean(h)) ** np.arange(6.0) / per_panel)[..., None]
    starts, stops = scale * np.diag(np.diag(_DERIVATIVES)), scale * _DERIVATIVES
    ahead, behind = (block_diag([*x[:, 1:]], format="csr") for x in (starts, stops))
    smooth = behind - ahead[np.roll(np.arange(5 * panels), -5)]
    kept = np.tile(np.arange(5) < 4, (panels, 1))
    if not closed:
        kept[[0, 1, -3, -2]] = True
        kept[-1] = False
    ends = [block_diag([*x[:, :1]]) for x in (starts, stops)]
    system = vstack([*ends, smooth[kept.ravel()]], format="csc")
    right = np.zeros((6 * panels, 3), dtype=points.dtype)
    right[: 2 * panels] = np.concatenate([points[:-1], points[1:]])
    solved = splu(system).solve(right)
    coefficients = solved.reshape(panels, 6, 3) / per_panel[..., None]

    def spline(u: Floats, order: int) -> Floats:
        panel = np.searchsorted(np.real(knots[1:-1]), np.real(u), side="right")
        powers = (u - knots[panel])[..., None] ** np.arange(6.0 - order)
        factors = _DERIVATIVES[order, order:, None] * coefficients[panel, order:]
        return np.sum(factors * powers[..., None], axis=-2)

    return spline


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
    moved = add_complex_step(points, change)
    moved = moved / np.sqrt(dot(moved, moved))[:, None]
    if closed:
        moved = np.concatenate([moved, moved[:1]])
    steps = _chords(moved)
    fits = list(spline_fits(points, closed))
    for path, _ in fits:
        knots = add_complex_step(path.knots, np.append(0.0, np.cumsum(steps)))
        varied = SplinePath(quintic_panels(knots, moved, closed), path.knots, closed)

        def stretch_rate(u: Floats, path_varied: SplinePath = varied) -> Floats:
            return extract_derivative(path_varied.speed(add_complex_step(u, 0.0)))

        stretch = integrated(stretch_rate, path.knots)
        steps = np.diff(
            stretch.at_edge(path.knots) + path.speed(path.knots) * extract_derivative(knots)
        )
    return varied, fits[-1][1], stretch, float(np.sum(steps))


def _chords(points: Floats) -> Floats:
    """Return how the angles between successive points change (m - 1,)."""
    across = cross(points[:-1], points[1:])
    sine, cosine = np.sqrt(dot(across, across)), dot(points[:-1], points[1:])
    return np.real(cosine) * extract_derivative(sine) - np.real(sine) * extract_derivative(
        cosine
    )


Varied = Callable[[Floats], Floats]
"""The derivatives (8, n) of a curve by what changes it, at arc lengths (n,) rad that stay:
of the tangent, the point, the geodesic curvature k and dk/ds."""


def _varied(
    path: Path,
    table: ArcLength,
    stretch: ArcLength,
    longer: float,
    closed: bool,
    backwards: bool,
) -> Varied:
    """Return the derivatives of a curve whose `path` carries them as complex steps.

    `table` has its arc length, `stretch` how that changes at the same parameter, and the
    whole changes by `longer`.
    """

    def at(s: Floats) -> Floats:
        sense = -1.0 if backwards else 1.0
        forward, laps = sense * s, np.full_like(s, backwards)
        if closed:
            laps = -np.floor(forward / table.length)
        forward, moved = forward + laps * table.length, laps * longer
        u = table.invert(forward)
        moved = (moved - stretch.at(u)) / np.real(path.speed(add_complex_step(u, 0.0)))
        frame, curvature, rate = (
            extract_derivative(x) for x in path.frame(add_complex_step(u, moved))
        )
        rows = [sense * frame[:, :, 0].T, frame[:, :, 2].T, sense * curvature[None]]
        return np.concatenate([*rows, rate[None]])

    return at


def varied_round(
    centre: tuple[ArrayLike, ArrayLike],
    cosines: tuple[ArrayLike, ArrayLike],
    sines: tuple[ArrayLike, ArrayLike] = ((), ()),
    backwards: bool = False,
) -> Varied:
    """Return the curve of `fourier`; of one coefficient, the radius, that of `circle`.

    The unit vector `centre` (3,) and the coefficients each with their derivatives.
    """
    size = max(np.size(cosines[0]), np.size(sines[0]))
    series = np.zeros((2, 2, size))
    for row, both in enumerate((cosines, sines)):
        for k, given in enumerate(both):
            series[k, row, : np.size(given)] = given
    even, odd = add_complex_step(*series)
    path = FourierPath(axes_about(add_complex_step(*centre)), even, odd)
    still = FourierPath(axes_about(np.asarray(centre[0], dtype=float)), *series[0])
    edges = azimuth_panels(size)
    stretch = integrated(
        lambda u: extract_derivative(path.speed(add_complex_step(u, 0.0))), edges
    )
    longer = stretch.length
    return _varied(path, measure(still, edges), stretch, longer, True, backwards)


def varied_through(
    points: ArrayLike, change: ArrayLike, closed: bool, backwards: bool = False
) -> Varied:
    """Return the curve of `through` while its points move, both (m, 3)."""
    given, moved = (np.asarray(item, dtype=float) for item in (points, change))
    return _varied(*varied_spline(given, moved, closed), closed, backwards)
