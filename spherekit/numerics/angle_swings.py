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

    Samples at which a mode does not close divide the samples into pieces. The change of an
    angle from sample to sample is taken in (-pi, pi] and added up within a piece. The piece
    with the widest swing counts.

    Parameters
    ----------
    angles
        (k, n) angles (rad) at k samples of n assembly modes (ways to assemble the
        mechanism), NaN where a mode does not close.
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

    # (n, path samples) changes of the angles. The first one of each mode is NaN. From here
    # on, the steps of all modes are one long array, in which each NaN starts a piece:
    # successive samples at which the angle is known.
    steps = wrap(np.diff(path, axis=0, prepend=np.nan)).T
    piece_starts = np.flatnonzero(np.isnan(steps))
    piece_of_step = np.cumsum(np.isnan(steps)) - 1
    # The angle relative to the first sample. NaN counts as no change.
    growth = np.cumsum(np.nan_to_num(steps), axis=1).ravel()

    # (pieces,) extremes of each piece, and the mode to which the piece belongs.
    lowest = np.minimum.reduceat(growth, piece_starts)
    highest = np.maximum.reduceat(growth, piece_starts)
    swings = highest - lowest
    mode_of_piece = piece_starts // len(path)
    # Sorted by mode, and in each mode by falling swing, the first piece is the widest one.
    order = np.lexsort((-swings, mode_of_piece))
    widest = order[np.searchsorted(mode_of_piece, np.arange(angles.shape[1]))]

    def find_extreme_samples(extremes: Floats) -> Indices:
        """Return for each mode the sample at an end of its widest swing.

        A piece is a row of successive samples at which the angle of a mode is known. The
        growth is the change of the angle since the first sample, with full revolutions
        counted. The result is the first sample in the widest piece of the mode at which the
        growth has its extreme value.

        Parameters
        ----------
        extremes
            (pieces,) the lowest growth in each piece, or the highest growth in each.

        Returns
        -------
        (n,) numbers of samples.
        """
        extreme_steps = np.flatnonzero(growth == extremes[piece_of_step])
        # The first such step from the start of the piece on.
        step = extreme_steps[np.searchsorted(extreme_steps, piece_starts[widest])]
        # From the long array to the path of the mode, then to samples without repetition.
        return step % len(path) % len(angles)

    is_known = np.any(np.isfinite(angles), axis=0)
    return AngleSwings(
        swing=np.where(is_known, swings[widest], np.nan),
        low_sample=find_extreme_samples(lowest),
        high_sample=find_extreme_samples(highest),
    )
