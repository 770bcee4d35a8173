"""Orientations as tilt and torsion, pointing directions as azimuth and tilt.

The z axis is tilted by `tilt` towards the azimuth, and `torsion` is what is left of the
turn about it: R = Z(azimuth) Y(tilt) Z(torsion - azimuth) (I. A. Bonev and J. Ryu, A new
approach to orientation workspace analysis of 6-DOF parallel manipulators, 2001). Unlike
Euler angles, torsion and tilt have no jump where the tilt is zero.
"""

import numpy as np

from spherekit.numeric.turns import wrap
from spherekit.sphere.poses import rotation
from spherekit.sphere.rotation import Floats, about_z


def azimuth_tilt(directions: Floats) -> Floats:
    """Return azimuth (-pi, pi] and tilt [0, pi] (n, 2) rad of unit vectors (n, 3)."""
    x, y, z = directions[:, 0], directions[:, 1], directions[:, 2]
    return np.stack([np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)], axis=1)


def pointing(angles: Floats) -> Floats:
    """Return the unit vectors (n, 3) of azimuth and tilt (n, 2) rad."""
    azimuth, tilt = angles[:, 0], angles[:, 1]
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
    last = np.arctan2(
        c * r[:, 1, 0] - s * r[:, 0, 0],
        c * r[:, 1, 1] - s * r[:, 0, 1],
    )
    return np.concatenate([first, last[:, None]], axis=1)


def from_euler_zyz(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) = Z(a) Y(b) Z(c) of angles (n, 3) rad."""
    first, swing, last = angles.T
    return np.asarray(about_z(first) @ rotation(np.eye(3)[1], swing) @ about_z(last))


def tilt_torsion(rotations: Floats) -> Floats:
    """Return azimuth, tilt and torsion (n, 3) rad of rotations (n, 3, 3).

    Azimuth and torsion are in (-pi, pi], the tilt in [0, pi]. Where the tilt is pi only
    2 azimuth - torsion is determined; where it is 0 the azimuth is 0 or pi.
    """
    angles = euler_zyz(rotations)
    torsion = angles[:, 0] + angles[:, 2]
    angles[:, 2] = wrap(torsion)
    return angles


def from_tilt_torsion(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) of azimuth, tilt and torsion (n, 3) rad."""
    azimuth, tilt, torsion = angles.T
    return from_euler_zyz(np.stack([azimuth, tilt, torsion - azimuth], axis=1))
