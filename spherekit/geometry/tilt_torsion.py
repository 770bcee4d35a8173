"""Orientations as tilt and torsion, pointing directions as azimuth and tilt.

The z axis is tilted by `tilt` towards the azimuth, and `torsion` is what is left of the
turn about it: R = Z(azimuth) Y(tilt) Z(torsion - azimuth) (I. A. Bonev and J. Ryu, A new
approach to orientation workspace analysis of 6-DOF parallel manipulators, 2001). Unlike
Euler angles, torsion and tilt have no jump where the tilt is zero.
"""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.numerics.angles import wrap


def about_z(angle: ArrayLike) -> Floats:
    """Return rotation matrices (..., 3, 3) by angle (rad) about the z axis."""
    angle = np.asarray(angle, dtype=float)
    out = np.zeros((*angle.shape, 3, 3))
    c, s = np.cos(angle), np.sin(angle)
    out[..., 0, 0] = out[..., 1, 1] = c
    out[..., 0, 1], out[..., 1, 0] = -s, s
    out[..., 2, 2] = 1.0
    return out


def rotation(axis: Floats, angle: ArrayLike) -> Floats:
    """Return rotation matrices (n, 3, 3) by angles (n,) rad about one unit axis (3,)."""
    angle = np.asarray(angle, dtype=float)[:, None, None]
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + 2.0 * np.sin(0.5 * angle) ** 2 * (skew @ skew)


def azimuth_tilt(directions: Floats) -> Floats:
    """Return azimuth (-pi, pi] and tilt [0, pi] (n, 2) rad of unit vectors (n, 3)."""
    x, y, z = directions.T
    return np.stack([np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)], axis=1)


def pointing(angles: Floats) -> Floats:
    """Return the unit vectors (n, 3) of azimuth and tilt (n, 2) rad."""
    azimuth, tilt = angles.T
    across = np.sin(tilt)
    return np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), np.cos(tilt)], axis=1
    )


def euler_zyz(rotations: Floats) -> Floats:
    """Return the angles (n, 3) rad of rotations (n, 3, 3) = Z(a) Y(b) Z(c), b in [0, pi].

    The three together give the rotation back to rounding, also where b is 0 or pi and
    only the sum or difference of the others is determined.
    """
    r = rotations
    first = azimuth_tilt(r[:, :, 2])
    c, s = np.cos(first[:, 0]), np.sin(first[:, 0])
    sine, cosine = c * r[:, 1, :2].T - s * r[:, 0, :2].T
    return np.column_stack([first, np.arctan2(sine, cosine)])


def from_euler_zyz(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) = Z(a) Y(b) Z(c) of angles (n, 3) rad."""
    first, swing, last = angles.T
    return about_z(first) @ rotation(np.eye(3)[1], swing) @ about_z(last)


def tilt_torsion(rotations: Floats) -> Floats:
    """Return azimuth, tilt and torsion (n, 3) rad of rotations (n, 3, 3).

    Azimuth and torsion are in (-pi, pi], the tilt in [0, pi]. Where the tilt is pi only
    2 azimuth - torsion is determined; where it is 0 the azimuth is 0 or pi.
    """
    angles = euler_zyz(rotations)
    angles[:, 2] = wrap(angles[:, 0] + angles[:, 2])
    return angles


def from_tilt_torsion(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) of azimuth, tilt and torsion (n, 3) rad."""
    azimuth, tilt, torsion = angles.T
    return from_euler_zyz(np.stack([azimuth, tilt, torsion - azimuth], axis=1))
