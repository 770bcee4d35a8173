"""Checks of profiles: colatitudes, points, and self-intersections of closed curves."""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats
from spherekit.geometry.parametric_curve import (
    UNIT_LENGTH_TOLERANCE,
    FourierPath,
    SplinePath,
)
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross, dot

MIN_POINT_COUNT = 6
"""Smallest number of points of a curve: they determine one polynomial of degree 5."""

MIN_POINT_DISTANCE_RAD = 1e-9
"""Arc (rad) between successive points below which they coincide.

Larger: closely spaced points are refused. Smaller: the direction between two points can
consist of rounding errors.
"""

ON_CIRCLE_TOLERANCE = 1e-13
"""Distance from a great circle up to which a point of a polyline is on the circle.

Larger: nearby arcs count as touching. Smaller: arcs that touch up to rounding are missed.
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
    """Check that a Fourier colatitude stays between 0 and 180 degrees.

    Raises
    ------
    ValueError
        If it does not.
    """
    # With z = e^(i a), the slope of the colatitude at azimuth a is a polynomial in z,
    # divided by a power of z. The extrema of the colatitude are at the angles of the roots
    # with |z| = 1. All roots are examined, because rounding moves roots off |z| = 1. The
    # angle of any other root is one more azimuth at which the colatitude is checked.
    cosines, sines = path.derivative_coefficients[1]  # those of the first derivative
    # Coefficients of z^k: (c_k - i s_k) / 2 for k >= 0, and their conjugates for -k. They
    # are rounded to `ROOT_DIGITS` decimals. Otherwise quotients of extremely small ones
    # would overflow, which do not change the colatitude in float64.
    positive_orders = np.round(0.5 * (cosines - 1j * sines), ROOT_DIGITS)
    negative_orders = np.conj(positive_orders[1:])
    roots = np.roots(np.concatenate([positive_orders[::-1], negative_orders]))
    # Azimuth 0 is examined too, also if there are no roots.
    azimuths = np.angle(np.append(roots, 1.0))
    (colatitudes,) = path.colatitude(azimuths, derivatives=0)
    extreme = int(np.argmax(np.abs(colatitudes - 0.5 * np.pi)))
    if not 0.0 < colatitudes[extreme] < np.pi:
        raise ValueError(
            f"the colatitude is {np.rad2deg(colatitudes[extreme]):.6g} deg at "
            f"{path.describe_position(float(azimuths[extreme]))}; it has to stay between 0 "
            "and 180 deg, both excluded"
        )


def normalised_points(points: ArrayLike, closed: bool) -> Floats:
    """Return the points of a curve with exactly unit length, after checks.

    Parameters
    ----------
    points
        (m, 3) unit vectors up to `UNIT_LENGTH_TOLERANCE`.
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
    unit_points = np.array(points, dtype=float)
    if unit_points.ndim != 2 or unit_points.shape[1] != 3:
        raise ValueError(
            f"the points have shape {unit_points.shape}; they have to be (m, 3)"
        )
    if len(unit_points) < MIN_POINT_COUNT:
        raise ValueError(
            f"the curve has {len(unit_points)} points; it needs at least {MIN_POINT_COUNT}"
        )
    size = np.sqrt(dot(unit_points, unit_points))
    has_wrong_length = ~(np.abs(size - 1.0) <= UNIT_LENGTH_TOLERANCE)
    if np.any(has_wrong_length):
        k = int(np.argmax(has_wrong_length))
        raise ValueError(
            f"point {k + 1} has length {size[k]:.9g}; it has to be a unit vector"
        )
    unit_points = unit_points / size[:, None]
    if closed:
        if arc(unit_points[-1], unit_points[0]) < UNIT_LENGTH_TOLERANCE:
            raise ValueError(
                f"the last point, {len(unit_points)}, repeats the first; leave it out: a "
                "closed curve returns to its first point by itself"
            )
        unit_points = np.concatenate([unit_points, unit_points[:1]])
    # Arcs between successive points. Points are numbered from 1 in messages.
    steps = arc(unit_points[:-1], unit_points[1:])
    point_count = len(unit_points) - closed
    for k, step in enumerate(steps):
        names = f"points {k + 1} and {(k + 1) % point_count + 1}"
        if step < MIN_POINT_DISTANCE_RAD:
            raise ValueError(f"{names} coincide; leave one of them out")
        if step >= 0.5 * np.pi:
            raise ValueError(
                f"{names} are {np.rad2deg(step):.6g} deg apart; successive points have to "
                "be less than 90 deg apart, so give more of them"
            )
    return unit_points


def check_no_self_intersection(path: SplinePath) -> None:
    """Check that a closed curve through points neither crosses nor touches itself.

    The curve is replaced by a polyline of short great-circle arcs, so loops that are
    smaller than an arc are not found.

    Raises
    ------
    ValueError
        If two arcs of the polyline meet. The message names the points of the spline.
    """
    from scipy.spatial import cKDTree

    panel_count = len(path.knots) - 1
    arcs_per_panel = max(MIN_ARCS_PER_PANEL, -(-MIN_CHECKED_ARCS // panel_count))
    # The ends of the arcs of the polyline, evenly spaced in the parameter of each panel.
    u = path.knots[:-1, None] + np.diff(path.knots)[:, None] * (
        np.arange(arcs_per_panel) / arcs_per_panel
    )
    x = path.spline(u.ravel())
    starts = x / np.sqrt(dot(x, x))[:, None]
    ends = np.roll(starts, -1, axis=0)
    middles = 0.5 * (starts + ends)
    lengths = np.sqrt(dot(ends - starts, ends - starts))
    arc_count = len(starts)

    # Two arcs can meet only if their middles are closer than the length of the longer arc.
    # The factor covers rounding.
    neighbours = cKDTree(middles).query_ball_point(middles, lengths * (1.0 + 1e-9))
    # All pairs (i, j) of such arcs.
    i = np.repeat(np.arange(arc_count), [*map(len, neighbours)])
    j = np.concatenate([*neighbours])
    # Adjacent arcs share an end.
    are_separate = np.minimum((i - j) % arc_count, (j - i) % arc_count) > 1
    i = i[are_separate]
    j = j[are_separate]
    # Arcs meet if each has its ends on both sides of the great circle of the other.
    meets = _lie_on_both_sides(a=starts[i], b=ends[i], c=starts[j], d=ends[j])
    meets &= _lie_on_both_sides(a=starts[j], b=ends[j], c=starts[i], d=ends[i])
    if np.any(meets):
        first = np.argmax(meets)
        panels = sorted((i[first] // arcs_per_panel, j[first] // arcs_per_panel))
        places = " and ".join(
            f"between points {k + 1} and {(k + 1) % panel_count + 1}" for k in panels
        )
        raise ValueError(f"the closed curve meets itself: {places}")


def _lie_on_both_sides(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Return (n,) whether c and d are on different sides of a great circle, or on it.

    An arc from c to d then meets the circle. A vector that is within `ON_CIRCLE_TOLERANCE`
    of the circle counts as being on it: otherwise arcs that touch would be missed because
    of rounding errors.

    Parameters
    ----------
    a, b
        (n, 3) unit vectors that span great circles.
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
