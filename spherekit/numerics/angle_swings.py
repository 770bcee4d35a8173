"""How far an angle swings over successive samples, with full revolutions counted."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.numerics.angles import SAME_ANGLE_RAD, wrap


@dataclass(frozen=True)
class AngleSwings:
    """The widest swing of an angle in each of n assembly modes (ways to assemble).

    A swing is the difference of the largest and the smallest angle over successive samples,
    with full revolutions counted. Samples at which the angle is unknown divide the samples
    of a mode into pieces. Each piece has a swing, and the widest one counts.

    Attributes
    ----------
    swing
        (n,) the widest swing (rad); NaN if the angle is known at no sample.
    low_sample, high_sample
        (n,) indices of the samples at which the angle is smallest and largest in the piece
        with the widest swing. If the swing is 0 or NaN, there are no such two samples. Both
        indices are then equal, and the angle may be unknown at this sample.
    """

    swing: Floats
    low_sample: Indices
    high_sample: Indices


def find_widest_swings(angles: Floats, is_closed_path: bool) -> AngleSwings:
    """Find the widest swing of angles over successive samples, counting full revolutions.

    A swing is the difference between the largest and the smallest angle. Where a mode
    cannot be assembled, the path of samples is divided into pieces. Within a piece, the
    change of the angle from sample to sample is taken in (-pi, pi] and added up. The piece
    with the widest swing counts.

    Parameters
    ----------
    angles
        (k, n) angles (rad) at k samples of n assembly modes (ways to assemble the
        mechanism), NaN where a mode cannot be assembled.
    is_closed_path
        Whether the last sample repeats the first one after full revolutions of the inputs.
        If the two angles are equal up to full revolutions, the last piece goes on in the
        first piece.

    Returns
    -------
    The widest swing of each mode, and the samples at its ends.
    """
    # A swing can pass the end of a closed path. The samples are therefore followed twice:
    # path sample k is sample 0 again, k + 1 is sample 1, and so on.
    path = _repeat_closed_paths(angles) if is_closed_path else angles
    # (path samples, n) change of each angle since the sample before. NaN if either angle is
    # unknown.
    changes = np.full(path.shape, np.nan)
    changes[1:] = wrap(path[1:] - path[:-1])
    # The angles relative to the first sample. NaN counts as no change.
    growth = np.cumsum(np.nan_to_num(changes), axis=0)
    begins_piece = np.isnan(changes)
    has_angles = np.any(np.isfinite(angles), axis=0)  # (n,)

    mode_count = angles.shape[1]
    swings = np.full(mode_count, np.nan)
    low_samples = np.zeros(mode_count, np.intp)
    high_samples = np.zeros(mode_count, np.intp)
    for mode in range(mode_count):
        path_swing = _find_widest_swing(growth[:, mode], begins_piece[:, mode])
        if has_angles[mode]:
            swings[mode] = path_swing.swing
        # The modulo (%) turns the index of a path sample into the index of the sample.
        sample_count = len(angles)
        low_samples[mode] = path_swing.low_sample % sample_count
        high_samples[mode] = path_swing.high_sample % sample_count
    return AngleSwings(swings, low_samples, high_samples)


def _repeat_closed_paths(angles: Floats) -> Floats:
    """Append the samples of a closed path to themselves, where this joins two pieces.

    The caller searches the widest swing: the difference of the largest and the smallest
    angle in one piece of the path. Samples at which the angle is unknown divide the path
    into pieces. If the angle is the same at the last and the first sample, the last piece
    goes on in the first piece. In the repeated path they are one piece.

    Parameters
    ----------
    angles
        (k, n) angles (rad) at k samples of n assembly modes, NaN where they are unknown.

    Returns
    -------
    (2 k, n) the angles twice. The second half is NaN in modes whose last and first piece do
    not meet, and in modes whose angles are all known.
    """
    # If all angles of a mode are known, they are a single piece, which needs no repetition.
    # If this angle makes full revolutions, a repetition would count them twice.
    pieces_meet = np.abs(wrap(angles[-1] - angles[0])) < SAME_ANGLE_RAD
    has_several_pieces = np.any(np.isnan(angles), axis=0)
    repetition = np.where(pieces_meet & has_several_pieces, angles, np.nan)
    return np.concatenate([angles, repetition])


class PathSwing(NamedTuple):
    """The widest swing of an angle along a path, and the samples at its ends.

    Attributes
    ----------
    swing
        Difference of the largest and the smallest angle (rad).
    low_sample, high_sample
        Indices of the samples at which the angle is smallest and largest. If several
        samples have the same angle, the first of them counts.
    """

    swing: float
    low_sample: int
    high_sample: int


def _find_widest_swing(growth: Floats, begins_piece: Bools) -> PathSwing:
    """Return the widest swing of an angle over the pieces of a path of samples.

    A swing is the difference of the largest and the smallest angle of a piece. Samples at
    which the angle is unknown divide the path into pieces. Each such sample is a piece by
    itself, too. Its swing is 0, so it is never wider than another swing.

    Parameters
    ----------
    growth
        (k,) angles (rad) relative to the first sample, with full revolutions counted. Steps
        from or to an unknown angle count as no change.
    begins_piece
        (k,) whether a piece of the path begins at a sample. True at the first sample.
    """
    piece_starts = np.flatnonzero(begins_piece)
    piece_stops = np.append(piece_starts[1:], len(growth))
    # `reduceat` returns the least and the greatest angle of each piece.
    lowest = np.minimum.reduceat(growth, piece_starts)
    highest = np.maximum.reduceat(growth, piece_starts)
    widest = np.argmax(highest - lowest)
    start = piece_starts[widest]
    angles_of_piece = growth[start : piece_stops[widest]]
    return PathSwing(
        swing=highest[widest] - lowest[widest],
        low_sample=start + np.argmin(angles_of_piece),
        high_sample=start + np.argmax(angles_of_piece),
    )
