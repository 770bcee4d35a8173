"""Maps of directions on the sphere: azimuthal projections about an axis of the ground.

Lambert's equal-area and the stereographic projection keep the azimuth about the centre of
the map. A direction at the angle t from the centre is at the radius 2 sin(t/2) in the
equal-area projection, and at 2 tan(t/2) in the stereographic projection, which keeps angles
(J. P. Snyder, Map Projections: A Working Manual, USGS 1395, 1987, chapters 21 and 24).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite
from spherekit.scenes.scene import SphereCurves, SphereMap

GROUND_AXES = "xyz"
"""Names of the axes of the ground."""

HEMISPHERE_RAD = np.radians(90.0)
"""Angle (rad) from the centre of a map of one hemisphere to its rim."""

CLIPPED_BAND_RAD = np.radians(12.0)
"""Angle (rad) beyond the rim up to which directions are placed.

Triangles across the rim are drawn and cut off at the rim. Smaller: large triangles are
missing; larger: in stereographic maps of large angles triangles become huge.
"""

RIM_SINE = 1e-9
"""Sine of the angle to the rim of a map up to which an axis is on the rim.

Larger: an axis is drawn on the far side by up to this angle; smaller: rounding decides
between the two directions of an axis on the rim.
"""


class Projection(NamedTuple):
    """An azimuthal projection: a map of directions that keeps the azimuth about its centre.

    Attributes
    ----------
    name
        Name of the projection.
    radius
        Function that returns the radius on the map at an angle (rad) from the centre of the
        map.
    """

    name: str
    radius: Callable[[Floats], Floats]


EQUAL_AREA = Projection("equal-area (Lambert)", lambda angle: 2.0 * np.sin(angle / 2.0))
STEREOGRAPHIC = Projection("stereographic", lambda angle: 2.0 * np.tan(angle / 2.0))


@dataclass(frozen=True)
class SphereView:
    """A map of the sphere as seen from outside.

    The centre of the map is the point where an axis of the ground meets the sphere.

    Attributes
    ----------
    frame
        (3, 3) matrix whose rows are three unit vectors: to the right, up, and out of the
        map. Each is along an axis of the ground.
    projection
        The projection, such as the equal-area one.
    rim
        Angle (rad) from the centre of the map to its rim.
    """

    frame: Floats
    projection: Projection = EQUAL_AREA
    rim: float = HEMISPHERE_RAD

    @property
    def axis_names(self) -> list[str]:
        """Names of the ground axes along the rows of the frame, without signs."""
        return [GROUND_AXES[k] for k in np.argmax(np.abs(self.frame), axis=1)]

    @property
    def centre_name(self) -> str:
        """The ground axis through the centre, with its sign."""
        sign = "−" if np.min(self.frame[2]) < 0.0 else "+"
        return f"{sign}{self.axis_names[2]}"

    def angles_from_centre(self, directions: Floats) -> Floats:
        """Return the angles (n,) rad of directions (n, 3) from the centre."""
        right, up, out = self.frame @ directions.T
        return np.arctan2(np.hypot(right, up), out)

    def project(self, directions: Floats) -> Floats:
        """Return the polar coordinates of directions on a map of the sphere.

        The rim of the map is the circle at the angle `rim` from its centre. Directions a
        little beyond the rim are projected, too, in a band of the width `CLIPPED_BAND_RAD`.
        They serve to draw triangles that cross the rim, which the plot cuts off there.

        Parameters
        ----------
        directions
            (n, 3) unit vectors.

        Returns
        -------
        (n, 2) azimuth (rad) from the right, and radius. The radius is NaN beyond the band.
        """
        # Components along the axes of the map.
        right, up, _ = self.frame @ directions.T
        angles = self.angles_from_centre(directions)
        is_beyond = angles > self.rim + CLIPPED_BAND_RAD
        radii = np.where(is_beyond, np.nan, self.radius(angles))
        return np.stack([np.arctan2(up, right), radii], axis=1)

    def radius(self, angle: Any) -> Any:
        """Return the radius on the map at an angle (rad) from the centre."""
        return self.projection.radius(angle)


def frame_about(directions: Floats) -> Floats:
    """Return the frame (3, 3) of a map of the sphere with some directions near its middle.

    The middle of the map is one of the directions +x, -x, +y, -y, +z and -z of the ground:
    the one nearest to the mean of the given directions. The rows of the frame are unit
    vectors to the right, up, and out of the map.

    Parameters
    ----------
    directions
        (n, 3) unit vectors. If there are none, the middle is +z.
    """
    mean = np.nanmean(directions, axis=0) if len(directions) else np.array([0.0, 0.0, 1.0])
    nearest_axis = np.argmax(np.abs(mean))
    # Cyclic order of the axes keeps the frame right-handed.
    frame = np.roll(np.eye(3), 2 - nearest_axis, axis=0)
    return frame if mean[nearest_axis] >= 0.0 else opposite_frame(frame)


def opposite_frame(frame: Floats) -> Floats:
    """Return the frame (3, 3) of the map about the opposite point of the sphere."""
    return frame[[1, 0, 2]] * [[1.0], [1.0], [-1.0]]


def directions_to_show(maps: Sequence[SphereMap], curves: Sequence[SphereCurves]) -> Floats:
    """Return the directions (n, 3) that a map of the sphere must contain.

    These are the directions of quantities on areas (`maps`) and of marks (labelled points).
    Points of curves count only if there are neither areas nor marks.

    Parameters
    ----------
    maps
        Quantities at the vertices of areas. If an area has triangles, only the vertices of
        triangles count.
    curves
        Curves on the sphere, with marks. Points may be NaN, which are left out.
    """
    parts = [np.zeros((0, 3))]
    for sphere_map in maps:
        if len(sphere_map.triangles):
            parts.append(sphere_map.vertices[np.unique(sphere_map.triangles)])
        else:
            parts.append(sphere_map.vertices)
    for sphere_curves in curves:
        parts += [mark.place[None] for mark in sphere_curves.marks]
    # `parts` has only the empty array if there are neither areas nor marks.
    if len(parts) == 1:
        for sphere_curves in curves:
            parts += [np.asarray(curve) for curve in sphere_curves.curves]
    directions = np.concatenate(parts)
    return directions[all_finite(directions, 1)]


def turn_to_side(directions: Floats, out: Floats) -> Floats:
    """Return for each sample the direction of an axis that a map of a hemisphere shows.

    An axis has two opposite directions. The direction on the side of `out` is visible. On
    the rim, at right angles to `out`, both directions are visible. On the rim the direction
    nearer to the direction at the neighbouring sample is taken, so that a path along the
    rim has no jump.

    Parameters
    ----------
    directions
        (n, 3) unit vectors, NaN at samples without a direction.
    out
        (3,) unit vector to the middle of the hemisphere.

    Returns
    -------
    (n, 3) for each sample the direction or its opposite. Samples without a direction divide
    the path into parts. If a part is wholly on the rim, its first direction stays as given.
    """
    heights = directions @ out
    is_on_rim = np.abs(heights) < RIM_SINE
    is_hidden = ~is_on_rim & (heights < 0.0)
    shown = np.where(is_hidden, -1.0, 1.0)[:, None] * directions

    # Decide the samples on the rim one after another, forwards from each sample off the
    # rim, then backwards. A sample without a direction decides nothing.
    is_decided = ~is_on_rim & np.isfinite(heights)
    for sample in range(1, len(shown)):
        if is_on_rim[sample] and is_decided[sample - 1]:
            shown[sample] = _choose_nearer(shown[sample], shown[sample - 1])
            is_decided[sample] = True
    for sample in range(len(shown) - 2, -1, -1):
        if is_on_rim[sample] and not is_decided[sample] and is_decided[sample + 1]:
            shown[sample] = _choose_nearer(shown[sample], shown[sample + 1])
            is_decided[sample] = True
    # The remaining samples are in parts of the path that are on the rim from end to end.
    # The first direction of such a part stays, and the others follow it.
    for sample in range(1, len(shown)):
        if is_on_rim[sample] and not is_decided[sample]:
            shown[sample] = _choose_nearer(shown[sample], shown[sample - 1])
    return shown


def _choose_nearer(direction: Floats, reference: Floats) -> Floats:
    """Return a direction (3,) or its opposite, whichever is nearer to another direction.

    The direction itself is returned if the reference is NaN.

    On the rim of a map the two opposite directions of an axis are visible. This choice
    keeps the path of the axis without jumps.
    """
    return -direction if direction @ reference < 0.0 else direction
