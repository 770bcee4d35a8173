"""Orientations as tilt and torsion or Euler angles, and directions as azimuth and tilt.

In the rotation R = Z(azimuth) Y(tilt) Z(torsion - azimuth), where Y and Z are rotations
about the axes of the same name, the z axis is tilted by `tilt` in the direction `azimuth`.
The torsion is the remaining rotation about the tilted axis. Unlike Euler angles, tilt and
torsion do not jump where the tilt is zero.

References
----------
I. A. Bonev, J. Ryu, A new approach to orientation workspace analysis of 6-DOF parallel
manipulators, Mechanism and Machine Theory, 2001.
"""

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.rotation import about_z, rotation_about_axis
from spherekit.numerics.angles import wrap


def azimuth_tilt(directions: Floats) -> Floats:
    """Return azimuth and tilt (n, 2), rad, of unit vectors (n, 3).

    The tilt is the angle from the z axis, the azimuth the direction of the tilt, counted
    about z from the x axis.

    The azimuth is in [-pi, pi], the tilt in [0, pi]. The azimuth is -pi if x is negative
    and y is -0.0 or negative and tiny.
    """
    x, y, z = directions.T
    return np.stack([np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)], axis=1)


def pointing(angles: Floats) -> Floats:
    """Return the unit vectors (n, 3) with given azimuth and tilt (n, 2), rad."""
    azimuth, tilt = angles.T
    radius = np.sin(tilt)
    return np.stack(
        [radius * np.cos(azimuth), radius * np.sin(azimuth), np.cos(tilt)], axis=1
    )


def euler_zyz(rotations: Floats) -> Floats:
    """Return the angles (a, b, c) (n, 3), rad, of rotations (n, 3, 3) = Z(a) Y(b) Z(c).

    Y and Z are rotations about the axes of the same name. The angle b is in [0, pi]. If b
    is 0 or pi, only the sum or the difference of a and c is determined.
    """
    azimuth_and_tilt = azimuth_tilt(rotations[:, :, 2])
    c = np.cos(azimuth_and_tilt[:, 0])
    s = np.sin(azimuth_and_tilt[:, 0])
    # The second row of Z(-a) R = Y(b) Z(c) is (sin c, cos c, 0), whatever b is.
    sine, cosine = c * rotations[:, 1, :2].T - s * rotations[:, 0, :2].T
    return np.column_stack([azimuth_and_tilt, np.arctan2(sine, cosine)])


def from_euler_zyz(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) = Z(a) Y(b) Z(c) of angles (a, b, c) (n, 3), rad."""
    a, b, c = angles.T
    y_axis = np.eye(3)[1]
    return about_z(a) @ rotation_about_axis(y_axis, b) @ about_z(c)


def tilt_torsion(rotations: Floats) -> Floats:
    """Return azimuth, tilt and torsion (n, 3), rad, of rotations (n, 3, 3).

    The z axis is tilted by the tilt in the direction of the azimuth, and the body is
    rotated by the torsion about its tilted z axis. The azimuth is in [-pi, pi], the torsion
    in (-pi, pi], the tilt in [0, pi]. If the tilt is pi, only 2 azimuth - torsion is
    determined. If the tilt is 0, the azimuth is 0, pi or -pi.
    """
    angles = euler_zyz(rotations)
    angles[:, 2] = wrap(angles[:, 0] + angles[:, 2])
    return angles


def from_tilt_torsion(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) with azimuth, tilt and torsion (n, 3), rad."""
    azimuth, tilt, torsion = angles.T
    return from_euler_zyz(np.stack([azimuth, tilt, torsion - azimuth], axis=1))
