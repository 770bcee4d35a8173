"""Closed forms from the literature, written apart from spherekit to check it against.

[1] R. Di Gregorio (2024), "Dynamic model of single-DOF spherical mechanisms based on
    instantaneous pole axes and Eksergian's equation", Mechanism and Machine Theory.
    The spherical four-bar of its Fig. 5: link 1 is the frame, link 2 the input, and
    `arcs` = (alpha_1, alpha_2, alpha_3, alpha_4) in rad are the lengths of its links.
    Unit vectors are in the axes of the frame, z along the axis of pair 41.
[2] Z. Chen, X. Chen, M. Gao, C. Zhao, K. Zhao and Y. Li (2021), "Motion characteristics
    analysis of a novel spherical two-degree-of-freedom parallel mechanism", sections 2, 3.
    Base and end effector mirror each other in the mid-plane, which carries P, the middle
    of the end effector, to Q = x, and each axis B3 to B1, B4 to B6.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import dblquad, quad

Floats = NDArray[np.float64]
Arcs = tuple[float, float, float, float]

FOUR_BAR_ARCS: Arcs = (np.pi / 3, np.pi / 9, 7 * np.pi / 18, 2 * np.pi / 9)
"""The numerical example of [1], Table 1: 60, 20, 70 and 40 degrees."""


def four_bar_angles(theta21: Floats, arcs: Arcs, mode: int) -> Floats:
    """Return theta41 (n,) rad by eq. (25) of [1]; `mode` is its p, 0 or 1.

    NaN where the four-bar does not close.
    """
    s1, s2, _, s4 = np.sin(arcs)
    c1, c2, c3, c4 = np.cos(arcs)
    a0 = c4 * (np.cos(theta21) * s2 * s1 + c1 * c2) - c3
    a1 = np.sin(theta21) * s2 * s4
    a2 = s4 * (np.cos(theta21) * s2 * c1 - s1 * c2)
    square = a1**2 + a2**2 - a0**2
    root = np.sqrt(np.where(square >= 0.0, square, np.nan))
    theta41: Floats = 2.0 * np.arctan2(-a1 + (-1) ** mode * root, a0 - a2)
    return theta41


def four_bar_axes(theta21: Floats, arcs: Arcs, mode: int) -> dict[str, Floats]:
    """Return the axes u (n, 3) of the pairs 41, 21, 32 and 43, eqs. (22a), (22b)."""
    frames = four_bar_frames(theta21, arcs, mode)
    return {
        "41": frames[1][:, :, 2],
        "21": frames[2][:, :, 2],
        "32": frames[3][:, :, 2],
        "43": frames[4][:, :, 2],
    }


def four_bar_frames(theta21: Floats, arcs: Arcs, mode: int) -> dict[int, Floats]:
    """Return the frames (n, 3, 3) of the links, columns i_j, j_j, k_j, by eq. (22).

    Link j lies along its arc from k_j towards j_j, link 1 from k_1 towards j_1.
    """
    theta41 = four_bar_angles(theta21, arcs, mode)
    s1, s2, s3, s4 = np.sin(arcs)
    c1, c2, _, c4 = np.cos(arcs)
    i1, j1, k1 = (np.broadcast_to(e, (len(theta21), 3)) for e in np.eye(3))
    k2 = j1 * s1 + k1 * c1
    j2 = i1 * np.sin(theta21)[:, None]
    j2 = j2 + np.cos(theta21)[:, None] * (k1 * s1 - j1 * c1)
    k3 = k2 * c2 + j2 * s2
    swing = i1 * np.sin(theta41)[:, None] - j1 * np.cos(theta41)[:, None]
    k4 = k1 * c4 + s4 * swing
    i3 = np.cross(k4, k3) / s3
    i4 = np.cross(k1, k4) / s4
    return {
        1: np.stack([i1, j1, k1], axis=-1),
        2: np.stack([np.cross(j2, k2), j2, k2], axis=-1),
        3: np.stack([i3, np.cross(k3, i3), k3], axis=-1),
        4: np.stack([i4, np.cross(k4, i4), k4], axis=-1),
    }


def four_bar_poles(theta21: Floats, arcs: Arcs, mode: int) -> dict[str, Floats]:
    """Return the secondary pole axes u (n, 3) 31 and 42, by eq. (22e)."""
    u = four_bar_axes(theta21, arcs, mode)

    def meet(a: str, b: str, c: str, d: str) -> Floats:
        line = np.cross(np.cross(u[a], u[b]), np.cross(u[c], u[d]))
        unit: Floats = line / np.linalg.norm(line, axis=1, keepdims=True)
        return unit

    return {"31": meet("41", "43", "21", "32"), "42": meet("21", "41", "32", "43")}


def four_bar_coefficients(theta21: Floats, arcs: Arcs, mode: int) -> tuple[Floats, Floats]:
    """Return the velocity coefficients w31/w21 and w41/w21 (n,), eqs. (26a), (26b).

    The first belongs to the pole 31 in the sense of `four_bar_poles`. Eq. (26a) is 0/0
    where link 3 does not turn relative to link 2, at theta41 = 0 or pi: NaN or noise
    there, although the limit is finite. (Eq. (5) as printed in [1] differs in sign
    from (26a), (26b), which hold.)
    """
    u = four_bar_axes(theta21, arcs, mode) | four_bar_poles(theta21, arcs, mode)

    def ratio(j1: str, j2: str) -> Floats:
        side = np.cross(u[j1], u["21"])
        above = np.einsum("ij,ij->i", side, np.cross(u[j2], u["21"]))
        below = np.einsum("ij,ij->i", side, np.cross(u[j2], u[j1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            out: Floats = above / below
        return out

    return ratio("31", "32"), ratio("41", "42")


MID_PLANE_BASE = np.pi / 3
MID_PLANE_LEG = np.deg2rad(40.0)
SMALLEST_ANGLE = np.deg2rad(10.0)
"""The numerical example of [2]: the arcs B1B6 and B1B2, and the least angle B1 to B3."""


def mid_plane_margins(points: Floats) -> Floats:
    """Return the margins (n, 4) of [2] where P is at points (n, 3).

    B1 is sin(s) from the mid-plane, so that B1 and B3 are 2 s apart and the leg of two
    arcs reaches if s is at most one arc. Margins are those of s for both legs, the angle
    rule first, then the reach. NaN where P is Q, as every mid-plane through Q is possible.
    """
    half = 0.5 * MID_PLANE_BASE
    axes = np.array([[np.cos(half), -np.sin(half), 0], [np.cos(half), np.sin(half), 0]])
    toward = np.array([1.0, 0.0, 0.0]) - points
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = toward @ axes.T / np.linalg.norm(toward, axis=1, keepdims=True)
    low, high = np.sin(0.5 * SMALLEST_ANGLE), np.sin(MID_PLANE_LEG)
    return np.concatenate([sine - low, high - sine], axis=1)


def mid_plane_area() -> float:
    """Return the area (sr) of [2]'s workspace on one side of the plane z = 0.

    The normal n of the mid-plane has n . B1 = -s1, n . B6 = -s6, and P is the mirror image
    of Q, so that the area is 4 (-n . Q) times that of n. Over s1 and s6 the region is a
    square.
    """
    half = 0.5 * MID_PLANE_BASE
    low, high = np.sin(0.5 * SMALLEST_ANGLE), np.sin(MID_PLANE_LEG)

    def density(one: float, other: float) -> float:
        x, y = (one + other) / (2.0 * np.cos(half)), (one - other) / (2.0 * np.sin(half))
        return float(4.0 * x / np.sqrt(1.0 - x * x - y * y) / np.sin(2.0 * half))

    area, _ = dblquad(density, low, high, low, high, epsabs=1e-13, epsrel=1e-13)
    return float(area)


def mid_plane_angles(points: Floats) -> tuple[Floats, Floats]:
    """Return phi and |gamma| (n,) of [2] in rad, from P, by its eqs. (2) and (18)."""
    phi = np.arccos(points[:, 0])
    sine = points[:, 1] / np.hypot(points[:, 1], points[:, 2])
    return phi, np.abs(2.0 * np.arcsin(sine * np.cos(0.5 * phi)))


def five_bar_margins(points: Floats, base: float, legs: Arcs) -> Floats:
    """Return the margins (n, 4) of reach of a spherical five-bar that points to points.

    The driven axes are x and the direction `base` from it towards y; `legs` are the arcs
    of the two links from the first, then of those from the second.
    """
    axes = np.array([[1.0, 0.0, 0.0], [np.cos(base), np.sin(base), 0.0]])
    cosine = points @ axes.T
    near = np.cos([legs[0] - legs[1], legs[2] - legs[3]])
    far = np.cos([legs[0] + legs[1], legs[2] + legs[3]])
    return np.concatenate([near - cosine, cosine - far], axis=1)


def five_bar_area(base: float, legs: Arcs) -> float:
    """Return the area (sr) that a spherical five-bar can point to, by quadrature.

    About the first driven axis the region is an annulus, of whose circles the second leg
    reaches two arcs.
    """
    low, high = abs(legs[0] - legs[1]), legs[0] + legs[1]
    near, far = abs(legs[2] - legs[3]), legs[2] + legs[3]

    def azimuth(distance: float, to_other: float) -> float:
        cosine = np.cos(to_other) - np.cos(distance) * np.cos(base)
        cosine /= np.sin(distance) * np.sin(base)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def density(distance: float) -> float:
        width = azimuth(distance, far) - azimuth(distance, near)
        return float(2.0 * width * np.sin(distance))

    breaks = {low, high}
    for limit in (near, far):
        breaks |= {abs(base - limit), base + limit, 2.0 * np.pi - base - limit}
    places = sorted(each for each in breaks if low <= each <= high)
    return sum(quad(density, a, b, epsabs=1e-13)[0] for a, b in pairwise(places))
