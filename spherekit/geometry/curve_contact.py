"""Contact of two curves on the unit sphere: the same point with the same tangent."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.profile_curve import Curve
from spherekit.geometry.rotation import rotation_vector, transpose
from spherekit.numerics.least_squares import minimize_squares

FRAME_STEP_RAD = 0.03
"""Angle by which the frame of a curve rotates from one sample to the next. Smaller: more
samples, and contacts of strongly curved profiles are missed less easily."""

MAX_CURVE_SAMPLES = 3000
"""Largest number of samples of a curve. If it is reached, the frame rotates by more than
`FRAME_STEP_RAD` between samples."""

COARSE_SAMPLES = 1000
"""Number of samples from which the rotation of the frame along a curve is integrated."""

MAX_CONTACT_STEP_RAD = 0.1
"""Largest change of an arc length in a step of the search."""

EQUAL_CONTACT_RAD = 1e-12
"""Contacts whose frames differ by at most this much more than the best are equally good.
The choice among them is made by their position."""

START_SLACK_RAD = 1e-9
"""A contact nearer to the end of the first curve than this counts as being at its start.

Its arc length is almost the whole length of the curve, because of rounding.
"""


@dataclass(frozen=True)
class CurveSamples:
    """Samples of a curve between which its frame rotates by equal angles.

    Attributes
    ----------
    arc_lengths
        (n,) arc lengths (rad) of the samples.
    frame_step
        Angle (rad) by which the frame rotates from one sample to the next.
    """

    arc_lengths: Floats
    frame_step: float


def nearest_frames(first: Curve, second: Curve) -> tuple[Floats, float]:
    """Return the points at which two curves have the most similar frames.

    The frame of a curve on the unit sphere consists of three unit vectors: to the point,
    along the tangent, and at right angles to both. If two curves touch, their frames there
    are equal.

    Both curves are sampled. From several pairs of samples with similar frames, the angle
    between the frames is minimised (`_find_starts` chooses the pairs). The best of these
    minima is returned.

    Parameters
    ----------
    first, second
        The two curves.

    Returns
    -------
    arc_lengths
        (2,) arc lengths (rad) on the first and the second curve. If the curves touch at
        several points, they are those of the point that comes first on the first curve.
    angle
        Angle (rad) of the rotation between the two frames; 0 if the curves touch.
    """
    # Arc lengths on closed curves are not limited while the search goes on.
    curves = (first, second)
    lengths = np.array([curve.length for curve in curves])
    is_closed = np.array([curve.closed for curve in curves])
    low = np.where(is_closed, -np.inf, 0.0)
    high = np.where(is_closed, np.inf, lengths)
    # The residual is the rotation vector between both frames, so the root of the sum of its
    # squares is the angle.
    arc_lengths, squares = minimize_squares(
        lambda s, _: _frame_differences(curves, s),
        start=_find_starts(curves),
        low=low,
        high=high,
        longest_step=MAX_CONTACT_STEP_RAD,
    )
    angles = np.sqrt(squares)
    arc_lengths = np.where(is_closed, np.mod(arc_lengths, lengths), arc_lengths)
    # Among equally good contacts, the first one along the first curve is chosen. Rounding
    # can move a contact at the start of a closed curve to its end. Before the comparison
    # all arc lengths are therefore increased by a small amount, which takes such a contact
    # beyond the end, back to the start. (The same is done with open curves, where a contact
    # at the very end counts like one at the start.)
    best = np.flatnonzero(angles <= np.min(angles) + EQUAL_CONTACT_RAD)
    from_start = np.mod(arc_lengths[best, 0] + START_SLACK_RAD, lengths[0])
    chosen = best[np.argmin(from_start)]
    return arc_lengths[chosen], float(angles[chosen])


def _find_starts(curves: tuple[Curve, Curve]) -> Floats:
    """Return pairs of arc lengths (m, 2) from which the search of contacts starts.

    The frame of a curve on the unit sphere consists of its tangent, its normal and its
    point. Two curves touch where their frames are equal. Both curves are sampled. A pair of
    samples, one of each curve, is a start if its frames are similar enough for a contact
    next to it. The pair with the most similar frames is a start in any case.
    """
    first, second = (_sample_evenly(curve) for curve in curves)
    first_frames = curves[0].evaluate(first.arc_lengths).frame.reshape(-1, 9)
    second_frames = curves[1].evaluate(second.arc_lengths).frame.reshape(-1, 9)
    # Cosine of the angle between the frames R_1 and R_2 of each pair of samples. The trace
    # of R_1 R_2^T is the sum of the products of all elements. It is 1 + 2 cos(angle).
    cosine = 0.5 * (first_frames @ second_frames.T - 1.0)

    # Find the maxima along the second curve, for each sample of the first. A column is
    # added on both sides, so that the ends have neighbours: the last and the first sample
    # of a closed curve, -1 for an open one.
    padded = np.pad(cosine, ((0, 0), (1, 1)), "wrap")
    if not curves[1].closed:
        padded[:, [0, -1]] = -1.0
    is_maximum = (cosine >= padded[:, :-2]) & (cosine >= padded[:, 2:])
    # From a sample to the next one, the frame rotates by the angle `frame_step`. Next to a
    # contact there is a sample of each curve whose frame differs from that of the contact
    # by less than its step. The frames of the pair thus differ by less than both steps.
    is_start = is_maximum & (cosine > np.cos(first.frame_step + second.frame_step))
    is_start.flat[np.argmax(cosine)] = True
    first_index, second_index = np.nonzero(is_start)
    return np.stack(
        [first.arc_lengths[first_index], second.arc_lengths[second_index]], axis=1
    )


def _sample_evenly(curve: Curve) -> CurveSamples:
    """Return samples of a curve between which its frame rotates by equal angles."""
    coarse = np.linspace(0.0, curve.length, COARSE_SAMPLES)
    # The frame rotates about two perpendicular axes: by 1 as the point moves, and by the
    # geodesic curvature as the tangent turns.
    rotation_rate = np.hypot(1.0, curve.evaluate(coarse).curvature)
    mean_rates = 0.5 * (rotation_rate[1:] + rotation_rate[:-1])
    rotation = coarse[1] * np.append(0.0, np.cumsum(mean_rates))
    steps = int(min(np.ceil(rotation[-1] / FRAME_STEP_RAD), MAX_CURVE_SAMPLES))
    even_rotation = np.linspace(0.0, rotation[-1], steps + 1)
    arc_lengths = np.interp(even_rotation, rotation, coarse)
    if curve.closed:
        arc_lengths = arc_lengths[:-1]
    return CurveSamples(arc_lengths, frame_step=float(even_rotation[1]))


def _frame_differences(
    curves: tuple[Curve, Curve], arc_lengths: Floats
) -> tuple[Floats, Floats]:
    """Return the rotation vectors between the frames of two curves, and their derivatives.

    Parameters
    ----------
    curves
        The two curves.
    arc_lengths
        (m, 2) arc lengths (rad) on the first and the second curve.

    Returns
    -------
    vectors
        (m, 3) rotation vectors (rad) from the second frame to the first.
    derivatives
        (m, 3, 2) their derivatives by both arc lengths. They are exact if the frames are
        equal, which is enough for quadratic convergence to a contact.
    """
    first, second = (
        curve.evaluate(lengths)
        for curve, lengths in zip(curves, arc_lengths.T, strict=True)
    )
    vectors = rotation_vector(first.frame @ transpose(second.frame))
    # A frame has the columns tangent t, normal n and point p. Along the curve it rotates
    # with n + k p per unit of arc length, where k is the geodesic curvature.
    first_rotation = first.frame[:, :, 1] + first.curvature[:, None] * first.frame[:, :, 2]
    second_rotation = (
        second.frame[:, :, 1] + second.curvature[:, None] * second.frame[:, :, 2]
    )
    return vectors, np.stack([first_rotation, -second_rotation], axis=2)
