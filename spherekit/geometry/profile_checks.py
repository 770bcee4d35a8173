"""Checks of profiles: colatitudes, points, and self-intersections of closed curves."""

from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.parametric_curve import (
    UNIT_LENGTH_TOLERANCE,
    FourierPath,
    SplinePath,
)
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross, dot, max_abs, unit_rows

MIN_POINT_COUNT = 6
"""Smallest number of points of a curve: they determine one polynomial of degree 5."""

MIN_POINT_DISTANCE_RAD = 1e-9
"""Arc (rad) between successive points below which they coincide.

Larger: closely spaced points are refused. Smaller: the direction between two points can
consist of rounding errors.
"""

ON_CIRCLE_TOLERANCE = 1e-13
"""Distance from a great circle up to which a point of a polyline is on the circle.

It is also the gap (rad) between two arcs up to which they can touch. Larger: nearby arcs
count as touching. Smaller: arcs that touch up to rounding are missed.
"""

MIN_CHECKED_ARCS = 400
"""Smallest number of arcs of the polyline by which self-intersections are found.

Larger: smaller loops are found, in more time. There are also at least
`MIN_ARCS_PER_PANEL` between successive points.
"""

MIN_ARCS_PER_PANEL = 8
"""Smallest number of arcs of this polyline between successive points of the curve."""

ROOT_DIGITS = 30
"""Decimals of the coefficients (rad) from which the extrema of a colatitude are computed.

Larger: quotients of extremely small coefficients overflow. Smaller: coefficients that
matter are lost.
"""


def check_colatitude(path: FourierPath) -> None:
    """Check that the colatitude of a curve stays between 0 and 180 degrees.

    The colatitude (angle from the centre) is a Fourier series of the azimuth.

    Raises
    ------
    ValueError
        If the colatitude reaches 0 or 180 degrees. A coefficient of more than 180 degrees
        proves this alone.
    """
    # No coefficient of an allowed colatitude exceeds 180 deg. The coefficient of order 0 is
    # the mean colatitude. The others are also the coefficients of colatitude - 90 deg, a
    # function of less than 90 deg in size. A Fourier coefficient is at most twice the mean
    # size of the function. Larger coefficients could overflow below. `sines[0]` has no
    # effect.
    largest = float(max_abs(np.append(path.cosines, path.sines[1:]), axis=0))
    if largest > np.pi:
        raise ValueError(
            f"a coefficient of the colatitude has the size {np.rad2deg(largest):.6g} deg; "
            "the colatitude then cannot stay between 0 and 180 deg"
        )
    azimuths = _find_extremum_azimuths(path)
    (colatitudes,) = path.colatitude(azimuths, derivative_count=0)
    extreme = int(np.argmax(np.abs(colatitudes - 0.5 * np.pi)))
    if not 0.0 < colatitudes[extreme] < np.pi:
        raise ValueError(
            f"the colatitude is {np.rad2deg(colatitudes[extreme]):.6g} deg at "
            f"{path.describe_position(float(azimuths[extreme]))}; it has to stay between 0 "
            "and 180 deg, both excluded"
        )


def _find_extremum_azimuths(path: FourierPath) -> Floats:
    """Return azimuths (m,), rad, among which are all extrema of the colatitude of a curve.

    The colatitude (angle from a fixed axis) is a Fourier series of the azimuth about this
    axis. Its slope at the azimuth a is the sum of c_k cos(k a) + s_k sin(k a) for k from 1
    to n. With z = e^(i a) the slope is the sum of b_k z^k for k from -n to n.
    Here b_k is (c_k - i s_k) / 2, b_(-k) its conjugate, and b_0 = 0. The slope times z^n is
    a polynomial. The extrema are at the angles of its roots with |z| = 1.
    """
    cosines, sines = path.derivative_coefficients[1]  # those of the first derivative
    # `np.roots` divides by the first coefficient that is not 0. With a tiny one the
    # quotients can overflow. Coefficients too small to change the colatitude are therefore
    # rounded to 0. The arrays of `derivative_coefficients` begin with k = 0, where a slope
    # has zeros.
    not_negative = np.round(0.5 * (cosines - 1j * sines), ROOT_DIGITS)  # k = 0, 1, ..., n
    negative = np.conj(not_negative[1:])  # k = -1, ..., -n
    highest_first = np.concatenate([not_negative[::-1], negative])
    # Rounding moves roots off |z| = 1, so the angles of all roots are returned. The root 1
    # (azimuth 0) is added, because there may be no roots.
    return np.angle(np.append(np.roots(highest_first), 1.0))


def normalised_points(points: ArrayLike, closed: bool) -> Floats:
    """Check the points of a curve, and return them with exactly unit length.

    Parameters
    ----------
    points
        (m, 3) points. Their lengths are 1 up to `UNIT_LENGTH_TOLERANCE`.
    closed
        Whether the curve is closed.

    Returns
    -------
    (m, 3) unit vectors; if the curve is closed (m + 1, 3), with the first one repeated.

    Raises
    ------
    ValueError
        If there are too few points, if one is not a unit vector, or if successive points
        coincide or are 90 degrees or more apart.
    """
    vectors = np.array(points, dtype=float)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ValueError(f"the points have shape {vectors.shape}; they have to be (m, 3)")
    point_count = len(vectors)
    if point_count < MIN_POINT_COUNT:
        raise ValueError(
            f"the curve has {point_count} points; it needs at least {MIN_POINT_COUNT}"
        )
    size = np.sqrt(dot(vectors, vectors))
    has_wrong_length = ~(np.abs(size - 1.0) <= UNIT_LENGTH_TOLERANCE)
    if np.any(has_wrong_length):
        k = int(np.argmax(has_wrong_length))
        raise ValueError(
            f"point {k + 1} has length {size[k]:.9g}; it has to be a unit vector"
        )
    unit_points = vectors / size[:, None]
    if closed:
        if arc(unit_points[-1], unit_points[0]) < UNIT_LENGTH_TOLERANCE:
            raise ValueError(
                f"the last point, {point_count}, repeats the first; leave it out: a "
                "closed curve returns to its first point by itself"
            )
        unit_points = np.concatenate([unit_points, unit_points[:1]])
    _check_steps(unit_points, point_count)
    return unit_points


def _check_steps(unit_points: Floats, point_count: int) -> None:
    """Check that the arcs between successive points are neither zero nor too long.

    Parameters
    ----------
    unit_points
        Unit vectors. If the curve is closed, the first point is repeated at the end.
    point_count
        Number of different points.

    Raises
    ------
    ValueError
        If two points coincide, or are 90 degrees or more apart.
    """
    steps = arc(unit_points[:-1], unit_points[1:])
    for k, step in enumerate(steps):
        # Messages number points from 1. The first point follows the last one.
        names = f"points {k + 1} and {(k + 1) % point_count + 1}"
        if step < MIN_POINT_DISTANCE_RAD:
            raise ValueError(f"{names} coincide; leave one of them out")
        if step >= 0.5 * np.pi:
            raise ValueError(
                f"{names} are {np.rad2deg(step):.6g} deg apart; successive points have to "
                "be less than 90 deg apart, so give more of them"
            )


def check_no_self_intersection(path: SplinePath) -> None:
    """Check that a closed curve through points neither crosses nor touches itself.

    The curve is replaced by a chain of short great-circle arcs (polyline). Loops that are
    smaller than an arc are not found.

    Raises
    ------
    ValueError
        If two arcs of the polyline meet. The message names the points of the spline.
    """
    # A panel is the part of the curve between two successive points.
    panel_count = len(path.knots) - 1
    arcs_per_panel = max(MIN_ARCS_PER_PANEL, ceil(MIN_CHECKED_ARCS / panel_count))
    starts = _sample_panels(path, arcs_per_panel)
    ends = np.roll(starts, -1, axis=0)
    # Indices of the arcs in each pair. Successive arcs share an end and are no pair.
    i, j = _find_close_arcs(starts, ends)
    # Arcs meet if each has its ends on both sides of the great circle of the other.
    meets = _lie_on_both_sides(a=starts[i], b=ends[i], c=starts[j], d=ends[j])
    meets &= _lie_on_both_sides(a=starts[j], b=ends[j], c=starts[i], d=ends[i])
    if np.any(meets):
        # The panels of the first two arcs that meet.
        first = np.argmax(meets)
        panels = sorted({i[first] // arcs_per_panel, j[first] // arcs_per_panel})
        # The last panel leads back to the first point. Users count points from 1.
        parts = [
            f"the part between points {panel + 1} and {(panel + 1) % panel_count + 1}"
            for panel in panels
        ]
        # A panel that meets itself is named once.
        places = f"{parts[0]} meets {parts[1] if len(parts) > 1 else 'itself'}"
        raise ValueError(f"the closed curve meets itself: {places}")


def _sample_panels(path: SplinePath, samples_per_panel: int) -> Floats:
    """Return points (m, 3) of a curve, evenly spaced in the parameter of each panel.

    A panel is the part of the spline between two knots. The first knot of each panel is a
    sample. The last knot is the first knot of the next panel, so it is left out.
    """
    fractions = np.arange(samples_per_panel) / samples_per_panel
    panel_starts = path.knots[:-1, None]
    panel_widths = np.diff(path.knots)[:, None]
    u = panel_starts + panel_widths * fractions  # (panels, samples)
    x = path.spline(u.ravel())
    return x / np.sqrt(dot(x, x))[:, None]


def _find_close_arcs(starts: Floats, ends: Floats) -> tuple[Indices, Indices]:
    """Return pairs of arcs of a closed chain of arcs that are near enough to meet.

    The caller examines only these pairs, to save time.

    Two arcs can meet only if the distance of their middles is at most the mean of their
    lengths. Arcs on one great circle meet if and only if this holds. Successive arcs share
    an end, so such pairs are left out. A pair can be returned in both orders.

    Parameters
    ----------
    starts, ends
        (n, 3) unit vectors: the ends of the arcs, in their order.

    Returns
    -------
    Numbers (k,) of the first and of the second arc of each pair.
    """
    from scipy.spatial import cKDTree

    middles = unit_rows(starts + ends)
    lengths = arc(starts, ends)
    # For each arc, the numbers of the arcs whose middles are not farther away than its own
    # length. The mean of two lengths is at most the longer one. So of two arcs that meet,
    # at least the longer one finds the other. The factor covers rounding.
    neighbours = cKDTree(middles).query_ball_point(middles, lengths * (1.0 + 1e-9))
    neighbour_counts = [len(numbers) for numbers in neighbours]
    arc_count = len(starts)
    i = np.repeat(np.arange(arc_count), neighbour_counts)
    j = np.concatenate(list(neighbours))
    # Number of steps between both arcs along the chain, the shorter way round.
    steps_between = np.minimum((i - j) % arc_count, (j - i) % arc_count)
    mean_lengths = 0.5 * (lengths[i] + lengths[j])
    are_near = arc(middles[i], middles[j]) <= mean_lengths + ON_CIRCLE_TOLERANCE
    is_pair = are_near & (steps_between > 1)
    return i[is_pair], j[is_pair]


def _lie_on_both_sides(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Return a mask (n,) of the pairs c, d on both sides of a great circle, or on it.

    An arc from such a c to d meets the circle. A vector within `ON_CIRCLE_TOLERANCE` of the
    circle counts as on the circle, so that rounding errors do not hide arcs that touch.

    Parameters
    ----------
    a, b
        (n, 3) unit vectors. The great circle runs through both.
    c, d
        (n, 3) unit vectors whose sides are compared.
    """
    normal = cross(a, b)
    normal = normal / np.sqrt(dot(normal, normal))[:, None]
    height_c = dot(normal, c)
    height_d = dot(normal, d)
    return (
        (height_c * height_d <= 0.0)
        | (np.abs(height_c) <= ON_CIRCLE_TOLERANCE)
        | (np.abs(height_d) <= ON_CIRCLE_TOLERANCE)
    )
