"""Closed forms from the literature, written apart from spherekit to check it against.

[1] R. Di Gregorio (2024), "Dynamic model of single-DOF spherical mechanisms based on
    instantaneous pole axes and Eksergian's equation", Mechanism and Machine Theory.
    The spherical four-bar of its Fig. 5: link 1 is the frame, link 2 the input, and
    `arcs` = (alpha_1, alpha_2, alpha_3, alpha_4) in rad are the lengths of its links.
    Unit vectors are in the axes of the frame, whose z axis is the axis of pair 41.
[2] Z. Chen, X. Chen, M. Gao, C. Zhao, K. Zhao and Y. Li (2021), "Motion characteristics
    analysis of a novel spherical two-degree-of-freedom parallel mechanism", sections 2, 3.
    Base and end effector mirror each other in the mid-plane, which carries P, the middle
    of the end effector, to Q = x, and each axis B3 to B1, B4 to B6.
"""

import numpy as np
from oracles.exact_four_bar import four_bar
from scipy.integrate import dblquad

FOUR_BAR_ARCS = (np.pi / 3, np.pi / 9, 7 * np.pi / 18, 2 * np.pi / 9)
"""The numerical example of [1], Table 1: 60, 20, 70 and 40 degrees."""


def four_bar_angles(theta21, arcs, mode):
    """Return theta41 (n,), rad, by eq. (25) of [1]. `mode` is p, 0 or 1, in that equation.

    The angle is NaN where the four-bar does not close.
    """
    return _four_bar(theta21, arcs, mode).theta


def _four_bar(theta21, arcs, mode):
    with np.errstate(invalid="ignore"):
        return four_bar(arcs, theta21, mode, np)


def _rows(vector, like):
    """Return vectors (n, 3) from three components. Some may be the same in all rows."""
    return np.stack(np.broadcast_arrays(*vector, like)[:3], axis=-1)


def four_bar_axes(theta21, arcs, mode):
    """Return the axes u (n, 3) of the pairs 41, 21, 32 and 43, eqs. (22a), (22b)."""
    u = _four_bar(theta21, arcs, mode).u
    return {name: _rows(axis, theta21) for name, axis in u.items()}


def four_bar_frames(theta21, arcs, mode):
    """Return the frames (n, 3, 3) of the links, columns i_j, j_j, k_j, by eq. (22).

    Link j lies along its arc from k_j towards j_j, link 1 from k_1 towards j_1.
    """
    frames = _four_bar(theta21, arcs, mode).frames
    return {
        link: np.stack([_rows(v, theta21) for v in frame], axis=-1)
        for link, frame in frames.items()
    }


def four_bar_poles(theta21, arcs, mode):
    """Return the secondary pole axes u (n, 3) 31 and 42, by eq. (22e)."""
    lines = _four_bar(theta21, arcs, mode).poles()
    return {name: _rows(u, theta21) for name, u in zip(("31", "42"), lines, strict=True)}


def four_bar_coefficients(theta21, arcs, mode):
    """Return the velocity coefficients w31/w21 and w41/w21 (n,), eqs. (26a), (26b).

    The first one refers to the direction of the pole axis 31 in `four_bar_poles`. It is NaN
    or noise where link 3 does not turn relative to link 2.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return _four_bar(theta21, arcs, mode).coefficients()[1:]


MID_PLANE_BASE = np.pi / 3
MID_PLANE_LEG = np.deg2rad(40.0)
SMALLEST_ANGLE = np.deg2rad(10.0)
"""The numerical example of [2]: the smallest angle from B1 to B3, after the arcs B1B6 and
B1B2."""


def mid_plane_area():
    """Return the area (sr) of half of the workspace of a mid-plane mechanism.

    Tests compare computed workspaces with this area. The halves z > 0 and z < 0 are mirror
    images of each other.

    The mechanism is that of Z. Chen et al. (2021), source [2] of this module. Base and end
    effector are mirror images of each other in the mid-plane. B1 and B6 are axes on the
    base, with the mirror images B3 and B4 on the end effector. Q is the middle between B1
    and B6, in the direction of the x axis. The output P is the mirror image of Q. The
    workspace is the part of the sphere that P can reach.

    Let m be the unit normal of the mid-plane with m . Q > 0, s1 = m . B1 and s6 = m . B6.
    The arc from B1 to its mirror image B3 is 2 arcsin(s1). A leg of two equal links spans
    this arc. So the arc is at most twice the arc of a link, `MID_PLANE_LEG`. By a rule of
    [2] it is at least `SMALLEST_ANGLE`. So s1 has a fixed range, and s6 has the same one by
    the other leg.

    The area of P is the integral of the area per ds1 ds6 over this square.
    """
    half_base = 0.5 * MID_PLANE_BASE
    lowest = np.sin(0.5 * SMALLEST_ANGLE)
    highest = np.sin(MID_PLANE_LEG)

    def density(s1, s6):
        """Return the area that P sweeps per ds1 ds6.

        P is the mirror image of Q = (1, 0, 0) in a plane with the unit normal m. s1 and s6
        are the cosines between m and two axes, B1 and B6. With h = `half_base`, these axes
        are (cos h, +-sin h, 0). So s1 and s6 are cos(h) m_x +- sin(h) m_y, and ds1 ds6 =
        sin(2 h) dm_x dm_y.
        """
        m_x = (s1 + s6) / (2.0 * np.cos(half_base))
        m_y = (s1 - s6) / (2.0 * np.sin(half_base))
        m_z = np.sqrt(1.0 - m_x * m_x - m_y * m_y)
        # Polar coordinates about Q. -P is Q turned by half a turn about m. So if m is at
        # the angle b from Q, then -P is at the angle 2 b, at the same azimuth. The area of
        # m is sin(b) db per azimuth, and that of P is sin(2 b) d(2 b). Their ratio is
        # 4 cos(b) = 4 m_x.
        area_of_p_per_area_of_m = 4.0 * m_x
        # dm_x dm_y is the area of m, projected along z: m_z times the area on the sphere.
        return float(area_of_p_per_area_of_m / m_z / np.sin(2.0 * half_base))

    area, _ = dblquad(density, lowest, highest, lowest, highest, epsabs=1e-13, epsrel=1e-13)
    return area
