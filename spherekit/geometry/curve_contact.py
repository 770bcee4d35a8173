"""Where two curves on the unit sphere touch: the same point with the same tangent."""

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.mirror import rotation_vector
from spherekit.geometry.profile_curve import Curve
from spherekit.geometry.rotation import transpose
from spherekit.numerics.least_squares import descent

TURN = 0.03
"""Angle (rad) by which the frame of a curve turns from one sample to the next."""

MOST = 3000
"""Samples of a curve at most; its frame then turns more from one to the next."""

ROUGH = 1000
LONGEST = 0.1
"""Longest step (rad) along a curve."""

SAME = 1e-12
"""Places whose frames differ by no more than this above the least (rad) touch alike."""

NEAR_START = 1e-9
"""What lies less than this (rad) before the start of the first curve counts as there."""


def nearest_frames(first: Curve, second: Curve) -> tuple[Floats, float]:
    """Return the arc lengths (2,) at which two curves have the most similar frames.

    Also the angle (rad) between these frames: 0 where the curves touch. Both curves are
    sampled so densely that next to every place where they touch there are samples whose
    frames differ by less than those of neighbours; from all such samples the search goes
    downhill. Where the curves touch at several places, it is the first along the first one.
    """
    curves = (first, second)
    lengths = np.array([curve.length for curve in curves])
    around = np.array([curve.closed for curve in curves])
    low, high = np.where(around, -np.inf, 0.0), np.where(around, np.inf, lengths)
    s, squares = descent(
        lambda some, _: _apart(curves, some), _starts(curves), low, high, longest=LONGEST
    )
    miss = np.sqrt(squares)
    s = np.where(around, np.mod(s, lengths), s)
    alike = np.flatnonzero(miss <= np.min(miss) + SAME)
    chosen = alike[np.argmin(np.mod(s[alike, 0] + NEAR_START, lengths[0]))]
    return s[chosen], float(miss[chosen])


def _starts(curves: tuple[Curve, Curve]) -> Floats:
    """Return arc lengths (m, 2) next to all places where two curves touch.

    At least the one where frames are nearest, if they touch nowhere.
    """
    (one, turn), (other, second_turn) = map(_samples, curves)
    first, second = (
        curve.at(s).frame.reshape(-1, 9)
        for curve, s in zip(curves, (one, other), strict=True)
    )
    cosine = 0.5 * (first @ second.T - 1.0)
    along = np.pad(cosine, ((0, 0), (1, 1)), "wrap")
    if not curves[1].closed:
        along[:, [0, -1]] = -1.0
    top = (cosine >= along[:, :-2]) & (cosine >= along[:, 2:])
    maxima = top & (cosine > np.cos(turn + second_turn))
    maxima.flat[np.argmax(cosine)] = True
    at_one, at_other = np.nonzero(maxima)
    return np.stack([one[at_one], other[at_other]], axis=1)


def _samples(curve: Curve) -> tuple[Floats, float]:
    """Return arc lengths (n,) along a curve, and how far its frame turns in between."""
    rough = np.linspace(0.0, curve.length, ROUGH)
    speed = np.hypot(1.0, curve.at(rough).curvature)
    turned = rough[1] * np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1])))
    even = np.linspace(0.0, turned[-1], int(min(np.ceil(turned[-1] / TURN), MOST)) + 1)
    s = np.interp(even, turned, rough)
    return (s[:-1] if curve.closed else s), float(even[1])


def _apart(curves: tuple[Curve, Curve], s: Floats) -> tuple[Floats, Floats]:
    """Return the rotation vectors (m, 3) between frames, and their derivatives (m, 3, 2).

    The derivatives are those at equal frames.
    """
    one, other = (curve.at(lengths) for curve, lengths in zip(curves, s.T, strict=True))
    vector = rotation_vector(one.frame @ transpose(other.frame))
    columns = np.stack(
        [
            one.frame[:, :, 1] + one.curvature[:, None] * one.frame[:, :, 2],
            -(other.frame[:, :, 1] + other.curvature[:, None] * other.frame[:, :, 2]),
        ],
        axis=2,
    )
    return vector, columns
