"""Contact of two curves on the unit sphere: the same point with the same tangent."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.profile_curve import Curve, CurvePoint
from spherekit.geometry.rotation import rotation_vector, transpose
from spherekit.numerics.least_squares import minimize_squares

FRAME_STEP_RAD = 0.03
"""Largest mean angle by which the frame of a curve rotates from one sample to the next.
Smaller: more samples, and contacts of strongly curved profiles are missed less easily."""

MAX_CURVE_SAMPLES = 3000
"""Largest number of steps between the samples of a curve. If it is reached, the frame can
rotate by more than `FRAME_STEP_RAD` between samples."""

COARSE_SAMPLES = 1000
"""Smallest number of samples from which the rotation of the frame along a curve is
integrated."""

MAX_COARSE_ROTATION_RAD = 0.1
"""Angle between the frames of two such samples above which another sample is put between
them. Larger: the rotation at sharp tips is less accurate, and contacts there are missed."""

MAX_COARSE_HALVINGS = 40
"""Largest number of halvings of the steps between such samples."""

MAX_CONTACT_STEP_RAD = 0.1
"""Largest change of an arc length in a step of the search."""

EQUAL_CONTACT_RAD = 1e-12
"""Contacts whose frames differ by at most this much more than the best are equally good.
The choice among them is made by their position."""

START_SLACK_RAD = 1e-9
"""A contact nearer to the end of a closed first curve than this counts as at its start.

Its arc length is almost the whole length of the curve, because of rounding.
"""


@dataclass(frozen=True)
class CurveSamples:
    """Samples of a curve, with nearly equal rotations of its frame between neighbours.

    The frame of the curve has the tangent, the normal and the point as columns. The search
    of contacts of two curves compares the frames of their samples. Even rotations make sure
    that some sample has nearly the frame of a contact, also where a curve bends strongly.

    Attributes
    ----------
    arc_lengths
        (n,) arc lengths (rad) of the samples.
    frame_step
        Mean angle (rad) by which the frame rotates from one sample to the next.
    """

    arc_lengths: Floats
    frame_step: float


def nearest_frames(first: Curve, second: Curve) -> tuple[Floats, float]:
    """Return the points at which two curves have the most similar frames.

    The frame of a curve on the unit sphere consists of three unit vectors: to the point,
    along the tangent, and at right angles to both. If two curves touch, their frames there
    are equal. The caller locates by this the contact of two profiles in the reference pose
    of a mechanism.

    Both curves are sampled, and `_find_starts` chooses pairs of samples with similar
    frames. From each pair, the angle between the frames is minimised. The best minimum is
    returned.

    Parameters
    ----------
    first, second
        The two curves.

    Returns
    -------
    arc_lengths
        (2,) arc lengths (rad) on the first and the second curve. Of several points of
        contact, the first one along the first curve is chosen.
    angle
        Angle (rad) of the rotation between the two frames; 0 if the curves touch.
    """
    # A closed curve may be searched over several laps, so its arc length has no limits
    # here.
    curves = (first, second)
    lengths = np.array([curve.length for curve in curves])
    is_closed = np.array([curve.closed for curve in curves])
    low = np.where(is_closed, -np.inf, 0.0)
    high = np.where(is_closed, np.inf, lengths)
    # The residual is the rotation vector between both frames. Its length is the angle.
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
    # can move a contact from the start of a closed curve to its end. A small amount is
    # therefore added to all arc lengths, which moves such a contact back to the start.
    best = np.flatnonzero(angles <= np.min(angles) + EQUAL_CONTACT_RAD)
    from_start = arc_lengths[best, 0]
    if first.closed:
        from_start = np.mod(from_start + START_SLACK_RAD, lengths[0])
    chosen = best[np.argmin(from_start)]
    return arc_lengths[chosen], float(angles[chosen])


def _find_starts(curves: tuple[Curve, Curve]) -> Floats:
    """Return pairs of arc lengths (m, 2) from which the search of contacts starts.

    The frame of a curve on the unit sphere consists of its tangent, its normal and its
    point. Two curves touch where their frames are equal. Both curves are sampled. A pair of
    samples, one of each curve, is a start if a contact can be next to it. The angle between
    their frames must then be small. It must also be a local minimum among the samples of
    the second curve, for this sample of the first curve.
    """
    first_samples = _sample_evenly(curves[0])
    second_samples = _sample_evenly(curves[1])
    cosine = _frame_cosines(
        curves[0].evaluate(first_samples.arc_lengths).frame,
        curves[1].evaluate(second_samples.arc_lengths).frame,
    )
    # `frame_step` is the angle between the frames of successive samples. The nearest sample
    # of a curve differs from a contact by at most about half this angle. So the frames of
    # the two nearest samples differ by about half the sum of both angles. The limit is the
    # whole sum.
    largest_angle = first_samples.frame_step + second_samples.frame_step
    # The angle is least where its cosine is greatest.
    is_maximum = _find_row_maxima(cosine, curves[1].closed)
    is_start = is_maximum & (cosine > np.cos(largest_angle))
    # The pair with the most similar frames is a start in any case.
    best = np.unravel_index(np.argmax(cosine), cosine.shape)
    is_start[best] = True

    first_index, second_index = np.nonzero(is_start)
    return np.stack(
        [
            first_samples.arc_lengths[first_index],
            second_samples.arc_lengths[second_index],
        ],
        axis=1,
    )


def _frame_cosines(first_frames: Floats, second_frames: Floats) -> Floats:
    """Return the cosines (n, m) of the angles between frames (n, 3, 3) and (m, 3, 3).

    A frame is a rotation matrix. The trace of the rotation R_1 R_2^T between two frames is
    1 + 2 cos(angle). The trace is also the sum of the products of the elements of R_1 and
    R_2.
    """
    traces = first_frames.reshape(-1, 9) @ second_frames.reshape(-1, 9).T
    return 0.5 * (traces - 1.0)


def _find_row_maxima(values: Floats, closed: bool) -> Bools:
    """Return a mask (n, m) of the values that are local maxima of their row.

    A value that equals a neighbour can be a maximum, too.

    Parameters
    ----------
    values
        (n, m) cosines of angles between samples of two curves. A row has all samples of the
        second curve.
    closed
        Whether the first and the last value of a row are neighbours.
    """
    before = np.roll(values, 1, axis=1)
    after = np.roll(values, -1, axis=1)
    if not closed:
        # The ends have one neighbour only. No cosine is less than -1.
        before[:, 0] = -1.0
        after[:, -1] = -1.0
    return (values >= before) & (values >= after)


def _sample_evenly(curve: Curve) -> CurveSamples:
    """Return samples of a curve, with even rotations of its frame between neighbours."""
    coarse = _sample_coarsely(curve)
    # The frame rotates about two perpendicular axes: by 1 as the point moves, and by the
    # geodesic curvature as the tangent turns.
    rotation_rate = np.hypot(1.0, curve.evaluate(coarse).curvature)
    mean_rates = 0.5 * (rotation_rate[1:] + rotation_rate[:-1])
    rotation = np.append(0.0, np.cumsum(np.diff(coarse) * mean_rates))
    steps = int(min(np.ceil(rotation[-1] / FRAME_STEP_RAD), MAX_CURVE_SAMPLES))
    even_rotation = np.linspace(0.0, rotation[-1], steps + 1)
    arc_lengths = np.interp(even_rotation, rotation, coarse)
    if curve.closed:
        arc_lengths = arc_lengths[:-1]
    return CurveSamples(arc_lengths, frame_step=float(even_rotation[1]))


def _sample_coarsely(curve: Curve) -> Floats:
    """Return rising arc lengths (n,), denser where the frame of a curve rotates fast."""
    coarse = np.linspace(0.0, curve.length, COARSE_SAMPLES)
    for _ in range(MAX_COARSE_HALVINGS):
        frames = curve.evaluate(coarse).frame
        # The trace of the rotation between two frames is 1 + 2 cos(angle).
        traces = np.sum(frames[1:] * frames[:-1], axis=(1, 2))
        is_wide = 0.5 * (traces - 1.0) < np.cos(MAX_COARSE_ROTATION_RAD)
        if not is_wide.any():
            break
        middles = 0.5 * (coarse[1:] + coarse[:-1])
        coarse = np.sort(np.append(coarse, middles[is_wide]))
    return coarse


def _frame_differences(
    curves: tuple[Curve, Curve], arc_lengths: Floats
) -> tuple[Floats, Floats]:
    """Return the rotation vectors between the frames of two curves, and their derivatives.

    A frame consists of the tangent, the normal and the point of a curve on the unit sphere.
    Two curves touch where their frames are equal, so these vectors are the residuals of a
    search for a contact.

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
        (m, 3, 2) their derivatives with respect to both arc lengths, exact where the frames
        are equal.
    """
    first = curves[0].evaluate(arc_lengths[:, 0])
    second = curves[1].evaluate(arc_lengths[:, 1])
    vectors = rotation_vector(first.frame @ transpose(second.frame))
    # The derivative of a small rotation vector is the difference of the rotation rates of
    # both frames.
    by_first = _frame_rotation_rates(first)
    by_second = -_frame_rotation_rates(second)
    return vectors, np.stack([by_first, by_second], axis=2)


def _frame_rotation_rates(point: CurvePoint) -> Floats:
    """Return the rotation (m, 3) of the frame of a curve per unit of arc length.

    At each of m points, the frame has the columns tangent t, normal n = p x t and point p.
    With the geodesic curvature k, dp/ds = t and dt/ds = k n - p. The angular velocity w = n
    + k p gives both: w x p = t and w x t = k n - p.
    """
    normal = point.frame[:, :, 1]
    direction = point.frame[:, :, 2]
    return normal + point.curvature[:, None] * direction
