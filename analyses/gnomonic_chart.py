"""Coordinates of pole axes and great circles in the gnomonic chart.

The chart is the projection of the sphere from its centre onto the plane that touches it at
the end of one axis, called x here. An axis (x, y, z) through the centre is the point
(tan xi, tan zeta) = (y/x, z/x). A great circle is a straight line with the slope epsilon,
at the signed distance tan theta from the origin (R. Di Gregorio, lecture 2, Barcelona
2019).
"""

from typing import Literal

import numpy as np

from spherekit.plugin import Floats, Mechanism, link_axes

ChartAxis = Literal["no", "yes", "x", "y", "z"]
"""Coordinate axis of the ground at whose end the chart touches the sphere.

``"yes"`` selects the coordinate axis that is nearest to the middle of the pair axes on the
ground. With ``"no"``, tables have no columns of the chart, and its drawing is the same as
with ``"yes"``.
"""


def chart_axes(mechanism: Mechanism, chart: ChartAxis = "yes") -> tuple[int, int, int]:
    """Return which coordinate axes of the ground are x, y and z of the chart.

    The result has the indices (0 to 2) of these axes. The chart projects the sphere from
    its centre onto the plane that touches it at the end of axis x. Opposite points of the
    sphere therefore have the same place on the chart.

    The user can choose a coordinate axis as x. With "yes" or "no", x is the coordinate axis
    nearest to the middle of the axes of the pairs (joints) on the ground. "no" only means
    that tables have no columns of the chart. The chart can be drawn all the same, so it
    needs axes. The axes y and z follow cyclically, so the system is right-handed.
    """
    if chart in ("x", "y", "z"):
        x = "xyz".index(chart)
    else:
        pair_axes = link_axes(mechanism)[mechanism.links[0]]
        # The zero vector makes the sum valid if the ground has no pair axes.
        middle = np.sum([*pair_axes.values(), np.zeros(3)], axis=0)
        # Either end of a coordinate axis may be near the middle, so the sign has no
        # meaning.
        x = int(np.argmax(np.abs(middle)))
    return x, (x + 1) % 3, (x + 2) % 3


def chart_coordinates(directions: Floats) -> tuple[Floats, Floats]:
    """Return the angles xi and zeta (n,) of axes, rad, between -pi/2 and pi/2.

    The chart is the projection of the sphere from its centre onto a plane x = 1. The
    coordinates are tan xi = y/x and tan zeta = z/x. R. Di Gregorio calls xi and zeta
    pseudo-Cartesian coordinates (lecture 2, Barcelona 2019). Both directions of an axis
    have the same angles.

    Parameters
    ----------
    directions
        (n, 3) vectors along the axes, in the axes x, y, z of the chart.
    """
    x, y, z = _choose_positive_directions(directions).T
    # x is 0 or positive. Adding 0.0 changes -0.0 to 0.0, because arctan2(0.0, -0.0) is pi.
    x = x + 0.0
    return np.arctan2(y, x), np.arctan2(z, x)


def _choose_positive_directions(directions: Floats) -> Floats:
    """Return, for each axis, which of its two directions counts as positive.

    In a positive direction the first component that is not zero is positive. `directions`
    and the result are (n, 3).
    """
    x, y, z = directions.T
    is_reversed = (x < 0.0) | ((x == 0.0) & ((y < 0.0) | ((y == 0.0) & (z < 0.0))))
    return np.where(is_reversed, -1.0, 1.0)[:, None] * directions


def circle_coordinates(normals: Floats) -> tuple[Floats, Floats]:
    """Return two angles (n,) of great circles in the chart: slope epsilon and theta, rad.

    The gnomonic chart projects the sphere from its centre onto a plane x = 1. The axis y of
    the chart is horizontal, the axis z vertical. In the chart a great circle is a straight
    line with two coordinates:

    - Its slope: the angle epsilon from the horizontal axis to the line, above -pi/2 and at
      most pi/2.
    - Its distance from the origin, tan theta. The distance is positive if the line is above
      the origin. A vertical line has a positive distance if it is on the left.

    The great circle x = 0 is the line at infinity. Its slope is NaN, and theta is pi/2 or
    -pi/2.

    Parameters
    ----------
    normals
        (n, 3) normals of the planes of the circles, in the axes x, y, z of the chart. The
        sign of a normal matters only for the circle x = 0, where it decides the sign of
        theta.
    """
    # Of both normals of a plane, the one with c > 0 is used, or with b < 0 if c is 0. The
    # slope of this normal is above -pi/2 and at most pi/2.
    a, b, c = _orient_normals(normals)
    # The circle has the equation a x + b y + c z = 0. In the chart x is 1. The line has the
    # equation b y + c z = -a and the direction (y, z) = (c, -b).
    length = np.hypot(b, c)
    epsilon = np.where(length > 0.0, np.arctan2(-b, c), np.nan)
    # The distance is -a / length. For example, the line z = 1 above the origin has a = -1,
    # b = 0 and c = 1, so its distance is 1.
    theta = np.arctan2(-a, length)
    return epsilon, theta


def _orient_normals(normals: Floats) -> Floats:
    """Return the components a, b, c (3, n) of the normal of each plane with positive c.

    A plane has two opposite normals. In the chart the plane is a line with the slope angle
    arctan2(-b, c), which lies between -pi/2 and pi/2 for positive c. If c is zero, the
    normal with negative b is returned, so that the slope is pi/2.
    """
    a, b, c = np.moveaxis(normals, 1, 0)
    is_reversed = (c < 0.0) | ((c == 0.0) & (b > 0.0))
    sign = np.where(is_reversed, -1.0, 1.0)
    return np.stack([sign * a, sign * b, sign * c])
