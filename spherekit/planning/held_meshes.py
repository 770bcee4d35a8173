"""Rolling contacts between wheels whose axes another link holds apart.

That the wheels touch is then said twice, by the contact and by the link that carries both
axes; of the two constraints of the contact one is left, that they roll.
"""

import numpy as np

from spherekit.model.geometry import geometry_of
from spherekit.model.joints import revolute
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats, cross

SAME_AXIS = 1e-9
"""Axes (rad) that differ by less are one."""


def held_meshes(mechanism: Mechanism) -> frozenset[int]:
    """Return the numbers of the rolling pairs whose wheels a third link carries.

    Both profiles are circles about axes of R pairs that join the wheels to one link.
    """
    carriers: dict[int, list[tuple[int, Floats]]] = {}
    joints = geometry_of(mechanism).joints
    for number, ends in enumerate(mechanism.ends):
        if mechanism.pairs[number].kind.has_axis:
            joint = revolute(joints[number])
            for wheel, carrier, frame in zip(
                ends, ends[::-1], (joint.first, joint.second), strict=True
            ):
                carriers.setdefault(wheel, []).append((carrier, frame[:, 2]))
    held = []
    for number, pair in enumerate(mechanism.pairs):
        if not pair.kind.may_repeat or pair.profiles is None:
            continue
        common = [
            {
                carrier
                for carrier, axis in carriers.get(wheel, [])
                if profile.round_axis and _same(axis, np.array(profile.round_axis))
            }
            for wheel, profile in zip(mechanism.ends[number], pair.profiles, strict=True)
        ]
        if common[0] & common[1]:
            held.append(number)
    return frozenset(held)


def _same(one: Floats, other: Floats) -> bool:
    return bool(np.linalg.norm(cross(one, other)) < SAME_AXIS * np.linalg.norm(other))
