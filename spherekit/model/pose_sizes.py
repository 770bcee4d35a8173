"""Arcs and angles within the links of a reference pose, which says them by its axes."""

from typing import Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.model.gears import COLLINEAR
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry
from spherekit.sphere.rotation import cross

PoseSize = tuple[Literal["arcs", "angles"], str, float, Floats]
"""An arc from the first R pair's axis of a link to another one's, or an angle there.

The kind: arcs start at the first axis; angles count at it, counter-clockwise, from the arc
to the second axis. The pair to which it leads. What it is in the pose (rad). What turns the
axis of the pair when the size grows, (3,) in ground axes.
"""


def pose_sizes(mechanism: Mechanism, link: str) -> tuple[PoseSize, ...]:
    """Return the sizes of a link in a reference pose, its axes in the order of the pairs.

    An axis on the line of the first one has none: no arc parts them.
    """
    assert isinstance(mechanism.geometry, PoseGeometry)
    first, *others = (
        (pair.name, np.array(mechanism.geometry.axes[pair.name], dtype=float))
        for pair in mechanism.pairs
        if pair.kind.has_axis and link in pair.links
    )
    _, start = first
    made: list[PoseSize] = []
    toward: Floats | None = None
    for name, axis in others:
        normal = cross(start, axis)
        sine = float(np.linalg.norm(normal))
        if sine < COLLINEAR:
            continue
        normal = normal / sine
        arc = float(np.arctan2(sine, start @ axis))
        made.append(("arcs", name, arc, normal))
        if toward is None:
            toward = normal
            continue
        angle = float(np.arctan2(cross(toward, normal) @ start, toward @ normal))
        made.append(("angles", name, angle, start))
    return tuple(made)
