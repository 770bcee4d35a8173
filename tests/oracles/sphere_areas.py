"""Areas on the unit sphere by quadrature over parallels, independent of spherekit.

A region is the intersection of several caps or of their complements. On the parallel of
height z, each cap covers one interval of azimuth. The common azimuth of all caps is
computed exactly, and integrated over z between the heights at which it is not smooth. The
substitution z = m + h sin t removes the square roots at the ends of each interval of z.
"""

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(240)


def common_area(centres, radii, keep):
    """Return the area (sr) of the intersection of several caps or their complements.

    A cap is all directions within a radius of its centre. `common_azimuth_width` gives the
    exact width of the intersection at the height z. This width is integrated over z by
    Gauss's rule, in parts between the heights at which it is not smooth: the poles, the
    lowest and highest points of the caps, and the points where two circles meet.

    Parameters
    ----------
    centres
        (n, 3) unit vectors.
    radii
        (n,) rad.
    keep
        (n,) True for the inside of a cap, False for its outside.
    """
    centres = np.asarray(centres, float)
    radii = np.asarray(radii, float)
    breaks = [-1.0, 1.0]
    colatitudes = np.arccos(np.clip(centres[:, 2], -1.0, 1.0))
    for colatitude, radius in zip(colatitudes, radii, strict=True):
        breaks += [np.cos(colatitude + radius), np.cos(colatitude - radius)]
    for i in range(len(radii)):
        for j in range(i):
            points = intersect_circles(centres[[i, j]], np.cos(radii[[i, j]]))
            breaks += list(points[:, 2])
    breaks = np.unique(np.clip(breaks, -1.0, 1.0))
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-15])]

    # In each part z = middle + half_height sin t. This removes the square roots at its
    # ends.
    half_heights = 0.5 * np.diff(breaks)
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    t = 0.5 * np.pi * NODES
    z = (middles[:, None] + half_heights[:, None] * np.sin(t)).ravel()
    weights = (half_heights[:, None] * (0.5 * np.pi * WEIGHTS * np.cos(t))).ravel()
    return float(np.sum(weights * common_azimuth_width(z, centres, np.cos(radii), keep)))


def intersect_circles(centres, cosines):
    """Return the points (0 or 2, 3) common to two circles, given by cosines of radii."""
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


def common_azimuth_width(z, centres, cosines, keep):
    """Return the width of azimuth (rad) on parallels that is common to several regions.

    A region is a cap (all directions within a radius of its centre), or the outside of one.
    The parallel of height z is all directions with this z coordinate. The width is the sum
    over all parts of the parallel that lie in every region.

    Parameters
    ----------
    z
        (n,) heights of the parallels on the unit sphere.
    centres, cosines
        (caps, 3) unit vectors, and (caps,) cosines of the radii.
    keep
        (caps,) True for the inside of a cap, False for its outside.

    Returns
    -------
    (n,) between 0 and 2 pi.
    """
    # Inside a cap: amplitude cos(azimuth - azimuth of the centre) >= gap. So each cap has
    # one interval of azimuth.
    lows = []
    highs = []
    for centre, cosine, is_inside in zip(centres, cosines, keep, strict=True):
        amplitude = np.hypot(centre[0], centre[1]) * np.sqrt(np.maximum(0.0, 1.0 - z * z))
        gap = cosine - z * centre[2]
        # With amplitude 0 the whole parallel is outside (gap > 0, half width 0) or inside
        # (gap < 0, half width pi).
        safe_amplitude = np.where(amplitude > 0.0, amplitude, 1.0)
        ratio = np.where(amplitude > 0.0, gap / safe_amplitude, np.sign(gap))
        half_width = np.arccos(np.clip(ratio, -1.0, 1.0))
        azimuth = np.arctan2(centre[1], centre[0])
        if is_inside:
            lows.append(azimuth - half_width)
            highs.append(azimuth + half_width)
        else:
            lows.append(azimuth + half_width)
            highs.append(azimuth + 2.0 * np.pi - half_width)
    lows = np.array(lows)
    highs = np.array(highs)

    # All ends of intervals cut the parallel into parts. The middle of a part decides for
    # it.
    ends = np.sort(np.mod(np.concatenate([lows, highs]), 2.0 * np.pi), axis=0)
    ends = np.concatenate([ends, ends[:1] + 2.0 * np.pi])
    middles = 0.5 * (ends[1:] + ends[:-1])
    widths = np.diff(ends, axis=0)
    is_common = np.ones_like(middles, dtype=bool)
    for low, high in zip(lows, highs, strict=True):
        is_common &= np.mod(middles - low, 2.0 * np.pi) <= high - low
    return np.sum(np.where(is_common, widths, 0.0), axis=0)
