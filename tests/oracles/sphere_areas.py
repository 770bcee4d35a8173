"""Areas on the unit sphere by quadrature over parallels, written apart from spherekit.

A region is what several caps, or their outsides, have in common. On the parallel of
height z each leaves one interval of azimuth; how much they have in common is exact, and is
integrated over z between the places where it is not smooth, with z = m + h sin t, which
takes away the square roots at the ends.
"""

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(240)


def common_area(centres, radii, keep):
    """Return the area (sr) of the directions within each cap, or outside of it.

    `centres` (n, 3) are unit vectors, `radii` (n,) in rad, `keep` (n,) True for the inside.
    """
    centres, radii = np.asarray(centres, float), np.asarray(radii, float)
    places = [-1.0, 1.0]
    polar = np.arccos(np.clip(centres[:, 2], -1.0, 1.0))
    for a, r in zip(polar, radii, strict=True):
        places += [np.cos(a + r), np.cos(a - r)]
    for i in range(len(radii)):
        for j in range(i):
            places += list(meeting(centres[[i, j]], np.cos(radii[[i, j]]))[:, 2])
    places = np.unique(np.clip(places, -1.0, 1.0))
    places = places[np.concatenate([[True], np.diff(places) > 1e-15])]
    half, middle = 0.5 * np.diff(places), 0.5 * (places[1:] + places[:-1])
    t = 0.5 * np.pi * NODES
    z = (middle[:, None] + half[:, None] * np.sin(t)).ravel()
    share = (half[:, None] * (0.5 * np.pi * WEIGHTS * np.cos(t))).ravel()
    return float(np.sum(share * common_arc(z, centres, np.cos(radii), keep)))


def meeting(centres, cosines):
    """Return the points (0 or 2, 3) common to two circles."""
    a, b = centres
    normal = np.cross(a, b)
    square = normal @ normal
    if square < 1e-30:
        return np.zeros((0, 3))
    dot = a @ b
    base = (cosines[0] - dot * cosines[1]) * a + (cosines[1] - dot * cosines[0]) * b
    base = base / square
    rest = (1.0 - base @ base) / square
    if rest < 0.0:
        return np.zeros((0, 3))
    return np.stack([base + np.sqrt(rest) * normal, base - np.sqrt(rest) * normal])


def common_arc(z, centres, cosines, keep):
    """Return the azimuths (n,) in rad that the caps leave on the parallels z (n,)."""
    lows, highs = [], []
    for centre, cosine, inside in zip(centres, cosines, keep, strict=True):
        side = np.hypot(centre[0], centre[1]) * np.sqrt(np.maximum(0.0, 1.0 - z * z))
        gap = cosine - z * centre[2]
        ratio = np.where(
            side > 0.0, gap / np.where(side > 0.0, side, 1.0), np.sign(gap) * 2
        )
        half = np.arccos(np.clip(ratio, -1.0, 1.0))
        azimuth = np.arctan2(centre[1], centre[0])
        if inside:
            lows.append(azimuth - half)
            highs.append(azimuth + half)
        else:
            lows.append(azimuth + half)
            highs.append(azimuth + 2.0 * np.pi - half)
    lows, highs = np.array(lows), np.array(highs)
    ends = np.sort(np.mod(np.concatenate([lows, highs]), 2.0 * np.pi), axis=0)
    ends = np.concatenate([ends, ends[:1] + 2.0 * np.pi])
    middles, widths = 0.5 * (ends[1:] + ends[:-1]), np.diff(ends, axis=0)
    within = np.ones_like(middles, dtype=bool)
    for low, high in zip(lows, highs, strict=True):
        within &= np.mod(middles - low, 2.0 * np.pi) <= high - low
    return np.sum(np.where(within, widths, 0.0), axis=0)
