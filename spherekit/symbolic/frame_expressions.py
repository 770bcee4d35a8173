"""Frames of R pairs in their links, as expressions of the sizes that determine them.

They are those of `spherekit.mechanism.pair_frames`, whose numbers may be terms here. In a
link given by arcs and angles the reference arc at the first axis leads to the second, at
every other axis to the first; in a reference pose any zero direction will do, for the
variable counts from its value there.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.mechanism.elements import LinkSizes, Pair, PoseGeometry, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE, axes_from_sizes, reference_frame
from spherekit.mechanism.pose_sizes import pose_sizes
from spherekit.symbolic.expression_graph import Expr
from spherekit.symbolic.vector_algebra import Exprs, cosine, sine, vector


def cross(a: Exprs, b: Exprs) -> Exprs:
    """Return a x b of vectors (3,)."""
    return vector(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


DesignGeometry = Mapping[tuple[str, Any], Expr]
"""Sizes that take the place of a mechanism's own: numbers (rad) or terms, by their kind.

``arcs`` and ``angles`` by link and the pair they lead to (in a reference pose those of
`pose_sizes`), ``zeros`` and ``values`` by pair; in a reference pose ``longitudes`` and
``latitudes`` of axes by pair, of both or none.
"""


Frames = tuple[Exprs, Exprs]
"""The frames (3, 3) of a pair in its first and its second link."""


def revolute_frames(mechanism: Mechanism, design: DesignGeometry) -> dict[str, Frames]:
    """Return the frames of every R pair in terms, by name.

    Raises
    ------
    EngineError
        If two axes of a link lie on one line, so that no arc between them varies.
    """
    geometry = mechanism.geometry
    made = {}
    for pair in mechanism.pairs:
        if not pair.kind.has_axis:
            continue
        if isinstance(geometry, PoseGeometry):
            made[pair.name] = _in_pose(mechanism, geometry, design, pair)
        else:
            zero = design.get(("zeros", pair.name), geometry.zeros.get(pair.name, 0.0))
            one, other = (
                _in_link(mechanism, geometry, design, link, pair.name)
                for link in pair.links
            )
            made[pair.name] = one @ about_z(zero), other
    return made


def _in_pose(
    mechanism: Mechanism, geometry: PoseGeometry, design: DesignGeometry, pair: Pair
) -> Frames:
    x, y, z = geometry.axes[pair.name]
    longitude = design.get(("longitudes", pair.name), float(np.arctan2(y, x)))
    latitude = design.get(("latitudes", pair.name), float(np.arctan2(z, np.hypot(x, y))))
    axis = pointed_at(longitude, latitude)
    east = vector([-1.0 * sine(longitude), cosine(longitude), 0.0])
    frame = np.stack([east, cross(axis, east), axis], axis=1)
    value = design.get(("values", pair.name), geometry.values.get(pair.name, 0.0))
    one, other = (_off(mechanism, design, link, pair.name, frame) for link in pair.links)
    return one, other @ about_z(value)


def pointed_at(longitude: Expr, latitude: Expr) -> Exprs:
    """Return the unit vector (3,) of numbers or terms."""
    level = cosine(latitude)
    return vector([level * cosine(longitude), level * sine(longitude), sine(latitude)])


def _off(
    mechanism: Mechanism, design: DesignGeometry, link: str, pair: str, frame: Exprs
) -> Exprs:
    """Return the frame of a pair in a link whose sizes are not those of the pose."""
    for kind, to, value, about in pose_sizes(mechanism, link):  # arcs before angles
        term = design.get((kind, (link, pair)))
        if to == pair and term is not None:
            frame = _about(about, term - value) @ frame
    return frame


def _in_link(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    design: DesignGeometry,
    link: str,
    pair: str,
) -> Exprs:
    sizes = geometry.links.get(link, LinkSizes(()))
    varied = (place[0] for kind, place in design if kind in ("arcs", "angles"))
    if link not in varied:
        return reference_frame(axes_from_sizes(sizes), pair).astype(object)
    place = sizes.axes.index(pair)
    leading = place or 1
    reference = sizes.arcs[leading - 1]
    if abs(np.sin(reference)) < COLLINEAR_SINE:
        raise EngineError(
            f"{mechanism.name}: links.{link}: the arc to {sizes.axes[leading]} is 0 or 180 "
            "deg, and where it opens its pair's zero jumps, so its sizes have no "
            "derivatives; vary another size, or compare with a file of an arc that is small"
        )
    key = link, sizes.axes[leading]
    arc = design.get(("arcs", key), reference)
    turn: Expr = 0.0
    if leading > 1:
        turn = design.get(("angles", key), sizes.angles[leading - 2])
    # Beyond half a turn the way to the other axis runs in the opposite direction.
    sense = 1.0 if np.sin(reference) > 0.0 else -1.0
    outward = vector([-1.0 * sine(turn), cosine(turn), 0.0])
    up = vector([0.0, 0.0, 1.0])
    if place == 0:
        axis, tangent = up, outward * sense
    else:
        axis = outward * sine(arc) + up * cosine(arc)
        tangent = (up * sine(arc) - outward * cosine(arc)) * sense
    return np.stack([tangent, cross(axis, tangent), axis], axis=1)


def about_z(angle: Expr) -> Exprs:
    """Return the rotation (3, 3) about z by a number or a term."""
    c, s = cosine(angle), sine(angle)
    return np.array([[c, -1.0 * s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=object)


def _about(axis: Floats, angle: Expr) -> Exprs:
    """Return the rotation about an axis of numbers (Rodrigues)."""
    x, y, z = axis.tolist()
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], dtype=object)
    one, along = np.eye(3).astype(object), np.outer(axis, axis).astype(object)
    c = cosine(angle)
    return one * c + across * sine(angle) + along * (1.0 - c)
