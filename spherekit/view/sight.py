"""From where the sphere is seen at first."""

import numpy as np

from spherekit.arrays import Floats

DISTANCE = 3.0
ASIDE = 0.3
"""Tangent of the angle between the eye's direction and the middle of the mechanism."""
DEFAULT_FOCUS = (0.76, 0.47, 0.44)
STEEP = 0.8
"""A focus nearer to the z axis than this cosine is seen with x up instead of z."""


Sight = tuple[Floats, Floats, Floats]
"""An eye, the point that it looks at, and what is up for it, each (3,)."""


def facing(focus: Floats | None) -> Sight:
    """Return what faces the mechanism a little from the side, with z up where possible."""
    focus = np.array(DEFAULT_FOCUS if focus is None else focus)
    focus = focus / np.linalg.norm(focus)
    up = np.array([0.0, 0.0, 1.0] if abs(focus[2]) < STEEP else [-1.0, 0.0, 0.0])
    right = np.cross(focus, up)
    right /= np.linalg.norm(right)
    eye = focus + ASIDE * (0.8 * right + 0.6 * np.cross(right, focus))
    return DISTANCE * eye / np.linalg.norm(eye), 0.1 * focus, up


def seen(sight: Sight, points: Floats) -> Floats:
    """Return where points (..., 3) are on the picture (..., 2), as long as there."""
    eye, target, up = sight
    way = target - eye
    distance = np.linalg.norm(way)
    forward = way / distance
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    across = np.stack([right, np.cross(right, forward)], axis=-1)
    from_eye = points - eye
    return distance * (from_eye @ across) / (from_eye @ forward)[..., None]
