"""Arcs and angles between the axes of a link, measured in a reference pose."""

from typing import Literal, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import cross
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE


class PoseSize(NamedTuple):
    """An arc or an angle of a link, measured in the reference pose.

    The file of the mechanism has the axes of one configuration, the reference pose, instead
    of arcs and angles. Designs vary the arcs and angles, so these are measured.

    All arcs of a link begin at the axis of its first R pair (hinge). For the axes 1, 2 and
    3, the arcs are 1-2 and 1-3. The angle of axis 3 is at axis 1, from the arc 1-2 to the
    arc 1-3, counter-clockwise about axis 1.

    Attributes
    ----------
    kind
        Whether it is one of the link's arcs or one of its angles.
    pair
        Name of a pair, such as that of axis 3. The arc ends at its axis, or the angle is
        the angle of its axis.
    value
        Arc or angle (rad).
    growth_axis
        (3,) unit vector in ground axes. When this arc or angle increases, the axis of
        `pair` rotates counter-clockwise about this vector.
    """

    kind: Literal["arcs", "angles"]
    pair: str
    value: float
    growth_axis: Floats


def pose_sizes(mechanism: Mechanism, link: str) -> tuple[PoseSize, ...]:
    """Return the arcs and angles of a link, from the axes of a reference pose.

    The reference pose is one configuration with known axes. A mechanism with a reference
    pose states no arcs and angles. They are derived here, so that designs can vary them.

    All arcs begin at the axis of the first R pair (hinge) of the link. For the axes 1, 2
    and 3, the arcs are 1-2 and 1-3. The angle of axis 3 is at axis 1, from the arc 1-2 to
    the arc 1-3, counter-clockwise about axis 1. The result has the order
    arc 1-2, arc 1-3, angle of axis 3. An axis on the line of the first one has no sizes.
    Axes are in the order of the pairs of the mechanism.
    """
    assert isinstance(mechanism.geometry, PoseGeometry)
    axes = [
        (pair.name, np.array(mechanism.geometry.axes[pair.name], dtype=float))
        for pair in mechanism.pairs
        if pair.kind.has_axis and link in pair.links
    ]
    if not axes:
        return ()
    _, first_axis = axes[0]
    # When a size grows, the axis at the end of its arc rotates about `growth_axis`. For an
    # arc this is the normal of the plane of the arc, for an angle it is the first axis.
    sizes: list[PoseSize] = []
    # Normal of the plane of the first arc, from which angles are counted.
    first_normal: Floats | None = None
    for name, axis in axes[1:]:
        normal = cross(first_axis, axis)
        sine = float(np.linalg.norm(normal))
        if sine < COLLINEAR_SINE:
            continue
        normal = normal / sine
        arc = float(np.arctan2(sine, first_axis @ axis))
        sizes.append(PoseSize(kind="arcs", pair=name, value=arc, growth_axis=normal))
        if first_normal is None:
            first_normal = normal
        else:
            angle = float(
                np.arctan2(cross(first_normal, normal) @ first_axis, first_normal @ normal)
            )
            sizes.append(
                PoseSize(kind="angles", pair=name, value=angle, growth_axis=first_axis)
            )
    return tuple(sizes)
