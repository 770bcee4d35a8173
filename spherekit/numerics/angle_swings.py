"""How far an angle swings over successive samples, with full revolutions counted."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.numerics.angles import SAME_ANGLE_RAD, wrap


@dataclass(frozen=True)
class AngleSwings:
    """The widest swing of an angle in each of n assembly modes.

    A swing is the difference of the largest and the smallest angle over successive samples,
    with full revolutions counted. A mode has several swings if the angle is unknown at some
    samples in between.

    Attributes
    ----------
    swing
        (n,) the widest swing (rad); NaN if the angle is known at no sample.
    low_sample, high_sample
        (n,) indices of the samples at which the angle is smallest and largest.
    """

    swing: Floats
    low_sample: Indices
    high_sample: Indices


def find_widest_swings(angles: Floats, is_closed_path: bool) -> AngleSwings:
    """Find how far angles swing over successive samples, with full revolutions counted.

    Samples at which a mode cannot be assembled divide the other samples into pieces. The
    change of an angle from sample to sample is taken in (-pi, pi] and added up within a
    piece. The piece with the widest swing counts.

    Parameters
    ----------
    angles
        (k, n) angles (rad) at k samples of n assembly modes (ways to assemble the
        mechanism), NaN where a mode cannot be assembled.
    is_closed_path
        Whether the last sample is the first one after full revolutions of the inputs. The
        first piece then continues the last one if the angle is the same at both samples.

    Returns
    -------
    The widest swing of each mode, and the samples at its ends.
    """
    # If the first piece continues the last one, the samples are appended once more, so that
    # both are one piece. A single piece without NaN need not be appended.
    pieces_meet = np.abs(wrap(angles[-1] - angles[0])) < SAME_ANGLE_RAD
    is_appended = pieces_meet & np.any(np.isnan(angles), axis=0)
    appended = np.where(is_appended, angles, np.nan)
    path = np.concatenate([angles, appended]) if is_closed_path else angles

    # (path samples, n) changes of the angles since the sample before, NaN if one of both
    # angles is unknown. The first change of each mode is NaN.
    changes = wrap(np.diff(path, axis=0, prepend=np.nan))
    # The angle relative to the first sample. NaN counts as no change.
    growth = np.cumsum(np.nan_to_num(changes), axis=0)

    mode_count = angles.shape[1]
    swings = np.full(mode_count, np.nan)
    low_samples = np.zeros(mode_count, np.intp)
    high_samples = np.zeros(mode_count, np.intp)
    for mode in range(mode_count):
        # Each NaN starts a piece. The extremes of a piece are the ends of its swing.
        piece_starts = np.flatnonzero(np.isnan(changes[:, mode]))
        piece_stops = np.append(piece_starts[1:], len(path))
        lowest = np.minimum.reduceat(growth[:, mode], piece_starts)
        highest = np.maximum.reduceat(growth[:, mode], piece_starts)
        widest = np.argmax(highest - lowest)
        if np.any(np.isfinite(angles[:, mode])):
            swings[mode] = highest[widest] - lowest[widest]
        # The first samples at both extremes. Samples that were appended are counted as the
        # samples that they repeat.
        piece = slice(piece_starts[widest], piece_stops[widest])
        low_step = piece.start + np.argmin(growth[piece, mode])
        high_step = piece.start + np.argmax(growth[piece, mode])
        low_samples[mode] = low_step % len(angles)
        high_samples[mode] = high_step % len(angles)
    return AngleSwings(swings, low_samples, high_samples)
