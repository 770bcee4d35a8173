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
"""Ground axis at whose end the chart touches the sphere.

``"yes"`` selects the axis that is nearest to the axes of the ground, and ``"no"`` stands
for no columns of the chart, while its drawing is the same as with ``"yes"``.
"""


def chart_axes(mechanism: Mechanism, chart: ChartAxis = "yes") -> tuple[int, int, int]:
    """Return the numbers of the ground axes that the chart uses as x, y and z.

    Axis x is the one that was chosen, by default the coordinate axis nearest to the middle
    of the ground's pair axes. The axes y and z follow cyclically, so that the system
    remains right-handed.
    """
    if chart in ("x", "y", "z"):
        x = "xyz".index(chart)
    else:
        ground_axes = link_axes(mechanism)[mechanism.links[0]]
        # The zero vector makes the sum a vector if contacts alone join links to the ground.
        middle = np.sum([*ground_axes.values(), np.zeros(3)], axis=0)
        x = int(np.argmax(np.abs(middle)))
    return x, (x + 1) % 3, (x + 2) % 3


def chart_coordinates(directions: Floats) -> tuple[Floats, Floats]:
    """Return the angles xi and zeta (n,) of axes, rad, between -pi/2 and pi/2.

    They are defined by tan xi = y/x and tan zeta = z/x, so that both directions of an axis
    have the same angles. R. Di Gregorio calls them pseudo-Cartesian coordinates (lecture 2,
    Barcelona 2019). An axis with x = 0 is parallel to the plane of the chart, and a point
    at infinity in it. Its angles are those of one of its two directions: that with positive
    y, or with positive z if y is zero.

    Parameters
    ----------
    directions
        (n, 3) vectors along the axes, in the axes x, y, z of the chart.
    """
    x, y, z = _choose_positive_directions(directions).T
    # x is 0 or positive. -0.0 is replaced by 0.0, because arctan2(0.0, -0.0) is pi.
    x = x + 0.0
    return np.arctan2(y, x), np.arctan2(z, x)


def _choose_positive_directions(directions: Floats) -> Floats:
    """Return for each axis that of its two directions whose first component is positive.

    The first component that is not zero counts. `directions` and the result are (n, 3).
    """
    x, y, z = directions.T
    is_reversed = (x < 0.0) | ((x == 0.0) & ((y < 0.0) | ((y == 0.0) & (z < 0.0))))
    return np.where(is_reversed, -1.0, 1.0)[:, None] * directions


def circle_coordinates(normals: Floats) -> tuple[Floats, Floats]:
    """Return the slope epsilon and the distance angle theta (n,) of great circles, rad.

    A great circle is a straight line in the gnomonic chart. The line has two coordinates:

    - Its slope, the angle epsilon from the axis of tan xi to the line, from -pi/2
      (exclusive) to pi/2.
    - Its distance from the origin, tan theta. It is positive if the origin is to the right
      of the direction (cos epsilon, sin epsilon) of the line.

    The great circle x = 0 is the line at infinity. Its slope is not defined (NaN), and its
    theta is pi/2 with either sign.

    Parameters
    ----------
    normals
        (n, 3) normals of the planes of the circles, in the axes x, y, z of the chart. Both
        normals of a plane give the same result, except for the circle x = 0.
    """
    # The points (x, y, z) of the circle with the normal (a, b, c) satisfy a x + b y + c z =
    # 0. Division by x gives the line a + b tan xi + c tan zeta = 0 with the direction
    # (c, -b).
    a, b, c = _orient_normals(normals)
    length = np.hypot(b, c)
    epsilon = np.where(length > 0.0, np.arctan2(-b, c), np.nan)
    # The distance of the origin from the line is a / length.
    theta = np.arctan2(-a, length)
    return epsilon, theta


def _orient_normals(normals: Floats) -> Floats:
    """Return the components (3, n) of that normal of each plane for which c is positive.

    The slope arctan2(-b, c) is then between -pi/2 and pi/2. If c is zero, the normal with
    negative b is returned, so that the slope is pi/2.
    """
    a, b, c = np.moveaxis(normals, 1, 0)
    is_reversed = (c < 0.0) | ((c == 0.0) & (b > 0.0))
    sign = np.where(is_reversed, -1.0, 1.0)
    # The sum with 0.0 turns -0.0 into 0.0, for which arctan2 returns angles up to pi/2.
    return np.stack([sign * a, sign * b, sign * c + 0.0])
