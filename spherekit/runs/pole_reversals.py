"""Finds the rows of a block between which the direction of a pole may reverse.

A pole is the axis about which one link rotates relative to another. Its unit vector is
computed in the sense of the relative angular velocity of the two links. So it can reverse
from row to row only where this velocity reverses. A sign in each row makes the vector
continuous. Rows before which nothing reverses keep the sign of the row before and need not
be compared. Poles that are the axis of a pair have a fixed sense and are left out.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.velocities.direction_signs import ComparedRows
from spherekit.velocities.input_columns import InputColumns
from spherekit.velocities.row_kernel import ColumnFunction, RowKernel

NO_ROWS: Indices = np.empty(0, dtype=np.intp)

MIN_DIRECTION_COSINE = 1e-8
"""Cosine of successive directions below which the direction may have reversed.

Directions of rows that are not closed yet can have errors up to a tenth of it, like
directions of certified rows. Larger: more rows are compared; smaller: reversals are missed.
"""

MAX_ROWS_COMPARED = 256
"""Rows are halved only if each half has more rows than this; see `_find_reversals`."""


@dataclass(frozen=True, eq=False)
class ReversalGaps:
    """Pairs of rows between which the direction of a pole may reverse (gaps).

    A pole is the axis about which one link rotates relative to another. Its direction is
    computed in the sense of the relative angular velocity, which may reverse from row to
    row. A row is one sample in one assembly mode. Directions are compared at both ends of a
    gap, to find signs with which they are continuous.

    Attributes
    ----------
    rows_before, rows_after
        (k,) indices of the rows at the beginning and at the end of each gap.
    """

    rows_before: Indices
    rows_after: Indices

    @classmethod
    def after_positions(cls, rows: Indices, positions: Indices) -> "ReversalGaps":
        """Return the gaps that begin at some of n rows and end at the next of these rows.

        The rows belong to one assembly mode. The caller has found out in which of the gaps
        between them a direction may reverse.

        Parameters
        ----------
        rows
            (n,) indices of the rows, rising.
        positions
            (k,) positions, from 0 to n - 2, of the rows at which gaps begin.
        """
        return cls(rows[positions], rows[positions + 1])


@dataclass(frozen=True, eq=False)
class InputReversals:
    """Where pole directions may reverse in a slice of rows, if one input moves.

    All other inputs are locked. A pole is the axis about which one link rotates relative to
    another. Its direction is computed in the sense of the relative angular velocity, which
    may reverse from row to row. A row is one sample in one assembly mode, and a slice is a
    number of successive rows. The signs of directions are later chosen such that directions
    are continuous.

    Attributes
    ----------
    gaps
        Pairs of successive examined rows between which a direction may reverse.
    first_velocities, last_velocities
        (poles, 3) relative angular velocity of the two links of each pole, per unit rate of
        the input, at the first and at the last row. They show whether a direction may also
        reverse between this slice and the next one.
    largest_errors
        (3,) largest error bounds in the slice: of the directions (rad), of the velocity
        coefficients, and of the derivatives of these coefficients.
    """

    gaps: ReversalGaps
    first_velocities: Floats
    last_velocities: Floats
    largest_errors: Floats


@dataclass(frozen=True, eq=False)
class SliceReversals:
    """The rows of a slice between which pole directions may reverse.

    A pole is the axis about which one link rotates relative to another. Its direction is
    computed in the sense of the relative angular velocity, which may reverse from row to
    row. The signs are later chosen such that directions are continuous. Rows between which
    no direction may reverse need no comparison for this.

    A block has the rows of a group of samples in all assembly modes. It is divided into
    slices. A slice is a number of successive rows of one mode. Only rows with small error
    bounds are examined.

    Attributes
    ----------
    mode
        Index of the assembly mode.
    first_row, last_row
        Indices, in the block, of the first and the last examined row of the slice.
    by_input
        The result for each input that moves while the other inputs are locked.
    """

    mode: int
    first_row: int
    last_row: int
    by_input: Sequence[InputReversals]


def find_slice_reversals(
    kernel: RowKernel,
    column_function: ColumnFunction,
    columns: Floats,
    mode: int,
    rows: Indices,
) -> SliceReversals:
    """Return the rows of a slice between which pole directions may reverse.

    A pole is the axis about which one link rotates relative to another. Its direction is
    computed in the sense of the relative angular velocity, which may reverse from row to
    row. Later, a sign in each row makes the direction continuous. Among the n rows given
    here, this sign can change only between those that are returned. The other rows need not
    be compared.

    A slice is a number of successive rows (samples) of one assembly mode. Its rows with
    large error bounds are left out here. `find_compared_rows` adds them, and the gaps
    between two slices.

    Parameters
    ----------
    kernel
        Compiled functions for many rows. For each input that moves, `input_columns` know
        the two links of each pole.
    column_function
        The function that has computed the columns. Its attribute `slices` has the Python
        slice of `columns` for the name of a quantity and the index of an input.
    columns
        (numbers, n) results of this function for n rows with small error bounds.
    mode
        Index of the assembly mode of the slice.
    rows
        (n,) indices of these rows in the block, rising.
    """
    by_input: list[InputReversals] = []
    for input_index, input_columns in enumerate(kernel.input_columns):
        # (components, n) angular velocities of all links per unit rate of this input.
        velocities = columns[column_function.slices["velocities", input_index]]
        # (3, n) error bounds of directions, velocity coefficients and their derivatives.
        errors = columns[column_function.slices["errors", input_index]]
        # If a direction may reverse from one of the n rows to the next, there is a gap
        # between the two rows.
        positions_before_gaps = _find_reversals(input_columns, velocities)
        by_input.append(
            InputReversals(
                gaps=ReversalGaps.after_positions(rows, positions_before_gaps),
                # These velocities are compared with those of adjacent slices later.
                first_velocities=input_columns.relative_velocities(velocities[:, 0]),
                last_velocities=input_columns.relative_velocities(velocities[:, -1]),
                largest_errors=np.max(errors, axis=1, initial=0.0),
            )
        )
    return SliceReversals(mode, int(rows[0]), int(rows[-1]), by_input)


def _keeps_direction(first: Floats, second: Floats) -> Bools:
    """Return a mask of vectors (..., 3) that do not reverse from first to second."""
    squared = np.vecdot(first, first) * np.vecdot(second, second)
    return np.vecdot(first, second) >= MIN_DIRECTION_COSINE * np.sqrt(squared)


def _find_reversals(input_columns: InputColumns, velocities: Floats) -> Indices:
    """Return the rows after which a pole direction may reverse.

    A pole is the axis about which one link rotates relative to another. The direction of
    the pole is the direction of the relative angular velocity. This direction may reverse
    between two rows if the scalar product of the velocities in these rows is not clearly
    positive.

    In most cases no direction reverses, and a bound for all rows together shows this fast.
    Otherwise each half of the rows is treated in the same way. Small numbers of rows are
    compared one by one.

    Parameters
    ----------
    input_columns
        Computes the relative angular velocities of the two links of each pole.
    velocities
        (components, n) components of the angular velocities of all links, per unit rate of
        the input that moves, at n successive rows.

    Returns
    -------
    (k,) indices of the rows before possible reversals, from 0 to n - 2.
    """
    if _keeps_all_directions(_bound_relative_velocities(input_columns, velocities)):
        return NO_ROWS
    half = velocities.shape[1] // 2
    if half > MAX_ROWS_COMPARED:
        # The halves share a row, so that the step between them is compared too.
        return np.append(
            _find_reversals(input_columns, velocities[:, : half + 1]),
            _find_reversals(input_columns, velocities[:, half:]) + half,
        )
    # (poles, 3, n) becomes (poles, n, 3).
    relative_velocities = np.moveaxis(input_columns.relative_velocities(velocities), 1, 2)
    keeps_direction = _keeps_direction(
        relative_velocities[:, :-1], relative_velocities[:, 1:]
    )
    return np.flatnonzero(~np.all(keeps_direction, axis=0))


@dataclass(frozen=True, eq=False)
class VelocityBounds:
    """Bounds of relative angular velocities, valid in several rows (configurations).

    A pole is the axis about which one link rotates relative to another. With the bounds,
    `_keeps_all_directions` proves that no pole reverses its direction between these rows.

    Attributes
    ----------
    least, greatest
        (poles, 3) lower and upper bound, over all rows, of the x, y and z component of the
        angular velocity of the second link relative to the first.
    """

    least: Floats
    greatest: Floats


def _bound_relative_velocities(
    input_columns: InputColumns, velocities: Floats
) -> VelocityBounds:
    """Return bounds of the relative angular velocities of the two links of each pole.

    A pole is the axis about which one link rotates relative to another. One pair of bounds
    is valid at all n rows. With these bounds, `_keeps_all_directions` can prove that no
    pole reverses its direction between any of the rows.

    The relative velocity is the velocity of the second link
    minus the velocity of the first. So the lower bound is the least velocity of the second
    link minus the greatest velocity of the first.

    Parameters
    ----------
    input_columns
        Computes relative velocities. Its first argument has the velocities of second links,
        its second argument the velocities of first links.
    velocities
        (components, n) components of the angular velocities of all links at n rows
        (samples).
    """
    least = np.min(velocities, axis=1)
    greatest = np.max(velocities, axis=1)
    return VelocityBounds(
        least=input_columns.relative_velocities(least, greatest),
        greatest=input_columns.relative_velocities(greatest, least),
    )


def _keeps_all_directions(bounds: VelocityBounds) -> bool:
    """Return whether no two relative velocities within the bounds can be opposite.

    For each pole, the bounds limit the three components of the relative angular velocity of
    its two links at many samples. The pole is the axis of this rotation. If its directions
    at any two samples are less than a right angle apart, the pole is proven not to reverse.
    Because of rounding, the cosine of the angle between them has to be at least
    `MIN_DIRECTION_COSINE`.

    Let a and b be two velocities within the bounds. The cosine of the angle between them is
    their scalar product, divided by the product of their lengths. The scalar product has a
    lower bound, and each length has an upper bound. Both together bound the cosine.
    """
    # (poles, 3) the least product of one component of a and the same component of b.
    least_products = _least_products(bounds.least, bounds.greatest)
    least_scalar_product = np.sum(least_products, axis=1)
    # (poles, 3) the greatest square of each component of a velocity.
    greatest_squares = np.maximum(
        bounds.least * bounds.least, bounds.greatest * bounds.greatest
    )
    # No product of the lengths of a and b is greater than this.
    greatest_squared_length = np.sum(greatest_squares, axis=1)
    least_allowed = MIN_DIRECTION_COSINE * greatest_squared_length
    return bool(np.all(least_scalar_product >= least_allowed))


def _least_products(low: Floats, high: Floats) -> Floats:
    """Return the least product of any two numbers between `low` and `high`.

    If both bounds have the same sign, both numbers are the bound that is nearer to zero.
    Otherwise one number is the lower bound and the other is the upper bound.
    """
    product = low * high
    has_same_sign = product > 0.0
    return np.where(has_same_sign, np.minimum(low * low, high * high), product)


def find_compared_rows(
    slices: Sequence[SliceReversals],
    input_index: int,
    is_assembled: Bools,
    is_uncertified: Bools,
) -> dict[int, ComparedRows]:
    """Return the rows of a block at which pole directions have to be compared.

    A row is one sample in one assembly mode. A block has the rows of a group of samples in
    all modes. A pole is the axis about which one link rotates relative to another. Its
    direction is computed in the sense of the relative angular velocity, which may reverse
    from row to row. Each row therefore needs a sign that makes the direction continuous.

    Two rows between which a direction may reverse are called a gap. Directions have to be
    compared at both rows of each gap, and at the first and the last row of each mode. Any
    other row has the same sign as the compared row before it.

    Parameters
    ----------
    slices
        The gaps that `find_slice_reversals` has found in each slice of the block. A slice
        is a number of successive rows of one mode. Rows with large error bounds were left
        out of this search.
    input_index
        Index of the input that moves while the other inputs are locked.
    is_assembled
        (modes, samples) whether the row has a configuration.
    is_uncertified
        (modes, samples) whether the row has a configuration, but poles with large error
        bounds. Between this row and the rows beside it, directions may reverse.

    Returns
    -------
    The compared rows by the index of the mode. Modes without a configuration are left out.
    """
    gaps_by_mode = _list_gaps_by_mode(slices, input_index)
    compared_rows: dict[int, ComparedRows] = {}
    for mode, is_assembled_in_mode in enumerate(is_assembled):
        samples = np.flatnonzero(is_assembled_in_mode)
        if not len(samples):
            continue
        # In the block, the rows of one mode are adjacent, one for each sample.
        rows = samples + mode * len(is_assembled_in_mode)
        uncertified_gaps = _gaps_beside(rows, is_uncertified[mode, samples])
        compared_rows[mode] = _compare_at_gaps(
            rows, [*gaps_by_mode[mode], uncertified_gaps]
        )
    return compared_rows


def _list_gaps_by_mode(
    slices: Sequence[SliceReversals], input_index: int
) -> dict[int, list[ReversalGaps]]:
    """Return where directions of poles may reverse in a block, for each assembly mode.

    A block has the rows of a group of samples in all modes. A slice of the block is a
    number of successive rows of one mode.

    A pole is the axis of the relative rotation of two links. Its direction is computed in
    the sense of the relative angular velocity of these links, so it reverses where the
    velocity does. If the direction of at least one pole may reverse between two rows, the
    two rows are called a gap. A gap lies within a slice, or between two slices of one mode.
    The caller compares directions only at gaps.

    Parameters
    ----------
    slices
        The slices of the block in their order, each with the gaps inside it.
    input_index
        Index of the input that moves while the other inputs are locked.

    Returns
    -------
    The gaps by the index of the assembly mode.
    """
    gaps_by_mode: dict[int, list[ReversalGaps]] = defaultdict(list)
    for reversals in slices:
        gaps_by_mode[reversals.mode].append(reversals.by_input[input_index].gaps)
    for before, after in pairwise(slices):
        # (poles, 3) relative angular velocities in the last examined row of a slice, and in
        # the first one of the next slice.
        last_velocities = before.by_input[input_index].last_velocities
        first_velocities = after.by_input[input_index].first_velocities
        keeps_direction = _keeps_direction(last_velocities, first_velocities)
        if before.mode == after.mode and not np.all(keeps_direction):
            gap_between_slices = ReversalGaps(
                rows_before=np.array([before.last_row]),
                rows_after=np.array([after.first_row]),
            )
            gaps_by_mode[before.mode].append(gap_between_slices)
    return gaps_by_mode


def _gaps_beside(rows: Indices, is_uncertified: Bools) -> ReversalGaps:
    """Return the gaps before and after each uncertified row.

    A gap lies between two successive rows. A row is uncertified if its poles have large
    error bounds, so that their directions may reverse before or after this row. `rows` (n,)
    are the successive rows of an assembly mode. The first one has no gap before it, and the
    last one none after it.
    """
    uncertified = np.flatnonzero(is_uncertified)
    last_position = len(rows) - 1
    # Position k stands for the gap after row k. -1 and `last_position` are no gaps.
    positions = np.setdiff1d([uncertified - 1, uncertified], [-1, last_position])
    return ReversalGaps.after_positions(rows, positions)


def _compare_at_gaps(rows: Indices, gap_lists: Sequence[ReversalGaps]) -> ComparedRows:
    """Return the rows at which the directions of poles have to be compared.

    A pole is the axis of the relative rotation of two links. Its direction is computed in
    the sense of the relative angular velocity, which may reverse from row to row. Two rows
    between which this is possible are called a gap.

    To find the reversals, `continue_signs` compares the rows at both ends of each gap. The
    first row of the mode is added because the signs begin there. The last row is added
    because the signs of the next block of samples continue from there.

    Parameters
    ----------
    rows
        (n,) the successive rows (samples) of an assembly mode in a block.
    gap_lists
        The gaps. They can overlap, because the two rows of a gap need not be neighbours.
    """
    gap_starts = np.concatenate([gaps.rows_before for gaps in gap_lists])
    gap_ends = np.concatenate([gaps.rows_after for gaps in gap_lists])
    compared = np.unique(np.concatenate([rows[[0, -1]], gap_starts, gap_ends]))
    return ComparedRows(
        compared,
        # A direction may reverse between two compared rows if a gap is there.
        may_reverse=_find_covered_steps(
            np.searchsorted(compared, gap_starts),
            np.searchsorted(compared, gap_ends),
            len(compared),
        ),
    )


def _find_covered_steps(starts: Indices, ends: Indices, point_count: int) -> Bools:
    """Return a mask of the steps between successive points that an interval covers.

    Parameters
    ----------
    starts, ends
        (k,) indices of the points (from 0) at which k intervals begin and end. The
        intervals can overlap.
    point_count
        Number n of points.

    Returns
    -------
    (n - 1,) whether the step from each point to the next one is within an interval.
    """
    started_count = np.cumsum(np.bincount(starts, minlength=point_count))
    ended_count = np.cumsum(np.bincount(ends, minlength=point_count))
    # A step is covered if more intervals have started than ended up to its first point.
    return started_count[:-1] > ended_count[:-1]
