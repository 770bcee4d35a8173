"""Finds the rows of a block between which the direction of a pole may reverse.

A pole is the axis about which one link rotates relative to another. It is a line, so its
direction is known up to a sign, which is chosen such that directions are continuous from
row to row. A direction can reverse only where the relative angular velocity of the two
links does. All other rows keep the sign of the row before and need not be compared.
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

Directions of rows that are not closed yet can have errors up to a tenth of it, like those
of certified rows. Larger: more rows are compared; smaller: reversals are missed.
"""

MAX_ROWS_COMPARED = 256
"""Number of rows that are compared one by one; see `_find_reversals`."""


@dataclass(frozen=True, eq=False)
class InputReversals:
    """The rows of a slice between which a pole direction may reverse, if one input moves.

    All other inputs are locked. A slice is a number of successive rows. A gap is the step
    from one row to the next, if a direction may reverse in it.

    Attributes
    ----------
    gaps
        (2, k) numbers of the rows before and after each gap.
    first_velocities, last_velocities
        (poles, 3) relative angular velocities, per unit rate of the input, at the first and
        last row. They are compared with those of the adjacent slices.
    largest_errors
        (3,) largest error bounds of directions (rad), of velocity coefficients and of their
        derivatives.
    """

    gaps: Indices
    first_velocities: Floats
    last_velocities: Floats
    largest_errors: Floats


@dataclass(frozen=True, eq=False)
class SliceReversals:
    """The rows of a slice between which pole directions may reverse.

    A slice is a number of successive rows of one assembly mode. Only its certified rows,
    whose error bounds are small enough, are examined.

    Attributes
    ----------
    mode
        Index of the assembly mode.
    first_row, last_row
        Numbers of the first and the last examined row in the block.
    by_input
        The result for each input that moves while the others are locked.
    """

    mode: int
    first_row: int
    last_row: int
    by_input: Sequence[InputReversals]


def find_slice_reversals(
    kernel: RowKernel,
    quality_function: ColumnFunction,
    columns: Floats,
    mode: int,
    rows: Indices,
) -> SliceReversals:
    """Return the rows of a slice between which pole directions may reverse.

    Parameters
    ----------
    kernel
        Its `input_columns` know the two links of each pole, for each input that moves.
    quality_function
        The function that has computed the columns. Its attribute `slices` says which
        columns have a quantity, by the name of the quantity and the index of an input.
    columns
        (width, n) results of this function for n certified rows of the slice.
    mode
        Index of the assembly mode of the slice.
    rows
        (n,) numbers of these rows in the block, rising.
    """
    by_input: list[InputReversals] = []
    for input_index, input_columns in enumerate(kernel.input_columns):
        # (components, n) angular velocities of all links per unit rate of this input.
        velocities = columns[quality_function.slices["velocities", input_index]]
        errors = columns[quality_function.slices["errors", input_index]]
        before_gaps = _find_reversals(input_columns, velocities)
        # (poles, 3, 2) the velocity of the second link of each pole relative to the first.
        end_velocities = input_columns.relative_velocities(velocities[:, [0, -1]])
        by_input.append(
            InputReversals(
                gaps=np.array([rows[before_gaps], rows[before_gaps + 1]]),
                first_velocities=end_velocities[..., 0],
                last_velocities=end_velocities[..., 1],
                largest_errors=np.max(errors, axis=1, initial=0.0),
            )
        )
    return SliceReversals(mode, int(rows[0]), int(rows[-1]), by_input)


def _keeps_direction(first: Floats, second: Floats) -> Bools:
    """Return which of the vectors (..., 3) surely do not reverse from first to second."""
    squared = np.vecdot(first, first) * np.vecdot(second, second)
    return np.vecdot(first, second) >= MIN_DIRECTION_COSINE * np.sqrt(squared)


def _find_reversals(input_columns: InputColumns, velocities: Floats) -> Indices:
    """Return the rows after which a pole direction may reverse.

    A pole is the axis about which one link rotates relative to another. Its direction is
    that of the relative angular velocity of the two links. It does not reverse between two
    rows if the scalar product of the velocities in these rows is positive.

    In most cases no direction reverses, which a bound for all rows together shows fast. If
    it does not, each half of the rows is treated in the same way, and small numbers of rows
    are compared one by one.

    Parameters
    ----------
    input_columns
        The columns of the moving input. It subtracts the angular velocities of the two
        links of each pole.
    velocities
        (components, n) components of the angular velocities of all links, per unit rate of
        the input, at n successive rows.

    Returns
    -------
    (k,) indices of rows, each less than n - 1.
    """
    if _keeps_all_directions(input_columns, velocities):
        return NO_ROWS
    half = velocities.shape[1] // 2
    if half > MAX_ROWS_COMPARED:
        # The halves share a row, so that the step between them is compared too.
        return np.append(
            _find_reversals(input_columns, velocities[:, : half + 1]),
            _find_reversals(input_columns, velocities[:, half:]) + half,
        )
    # (poles, rows, 3). With one argument both links are taken from it.
    relative_velocities = np.moveaxis(input_columns.relative_velocities(velocities), 1, 2)
    keeps_direction = _keeps_direction(
        relative_velocities[:, :-1], relative_velocities[:, 1:]
    )
    return np.flatnonzero(~np.all(keeps_direction, axis=0))


def _keeps_all_directions(input_columns: InputColumns, velocities: Floats) -> bool:
    """Return whether no pole direction can reverse between any two rows.

    The scalar product of the velocities in any two rows is bounded by the ranges of their
    components. If a component is between a and b in all rows, the product of its values in
    two rows is at least min(a^2, b^2), or a b if a and b have different signs. The sum of
    these bounds over the three components, divided by the largest possible product of the
    lengths, is a bound of the cosine between two directions. Because of rounding it has to
    be at least `MIN_DIRECTION_COSINE`.

    Parameters
    ----------
    input_columns, velocities
        As in `_find_reversals`.
    """
    low = np.min(velocities, axis=1)
    high = np.max(velocities, axis=1)
    # (poles, 3) bounds a and b of each component of the relative velocities: the velocity
    # of the second link minus that of the first one. Its lower bound is the lower bound of
    # the second link minus the upper bound of the first one. The function takes the second
    # link from its first argument, and the first link from its second argument.
    least = input_columns.relative_velocities(low, high)
    greatest = input_columns.relative_velocities(high, low)
    least_squared = least * least
    greatest_squared = greatest * greatest
    product = least * greatest
    least_product = np.where(
        product > 0.0, np.minimum(least_squared, greatest_squared), product
    )
    # The square of the largest possible length.
    largest_square = np.sum(np.maximum(least_squared, greatest_squared), axis=1)
    least_scalar_product = np.sum(least_product, axis=1)
    return bool(np.all(least_scalar_product >= MIN_DIRECTION_COSINE * largest_square))


def find_compared_rows(
    slices: Sequence[SliceReversals],
    input_index: int,
    is_assembled: Bools,
    is_uncertified: Bools,
) -> dict[int, ComparedRows]:
    """Return the rows of a block at which pole directions have to be compared.

    These are the rows before and after each gap, in which a direction may reverse, and the
    first and the last row of each assembly mode. All rows in between have the sign of the
    compared row before them.

    Parameters
    ----------
    slices
        The certified rows of the block, slice by slice in their order.
    input_index
        Index of the input that moves while the others are locked.
    is_assembled
        (modes, samples) whether the row has a configuration.
    is_uncertified
        (modes, samples) whether the row has a configuration, but is not certified: the
        error bounds of its poles are large. Directions may reverse before and after it.

    Returns
    -------
    The rows of each assembly mode with a configuration, by the index of the mode.
    """
    gaps_by_mode = _list_certified_gaps(slices, input_index)
    compared_rows: dict[int, ComparedRows] = {}
    for mode, is_assembled_in_mode in enumerate(is_assembled):
        samples = np.flatnonzero(is_assembled_in_mode)
        if not len(samples):
            continue
        # The rows of a mode follow each other in the block, one for each sample.
        rows = samples + mode * len(is_assembled_in_mode)
        uncertified_gaps = _gaps_beside(rows, is_uncertified[mode, samples])
        gaps = np.concatenate([*gaps_by_mode[mode], uncertified_gaps], axis=1)
        compared_rows[mode] = _compare_at_gaps(rows, gaps)
    return compared_rows


def _list_certified_gaps(
    slices: Sequence[SliceReversals], input_index: int
) -> dict[int, list[Indices]]:
    """Return the gaps between certified rows, by the index of the assembly mode.

    A gap, a pair of rows between which a direction may reverse, is within a slice, or
    between the last row of a slice and the first row of the next one. Each item of a list
    is an array (2, k) with the numbers of the rows before and after k gaps.
    """
    gaps_by_mode: dict[int, list[Indices]] = defaultdict(list)
    for reversals in slices:
        gaps_by_mode[reversals.mode].append(reversals.by_input[input_index].gaps)
    for before, after in pairwise(slices):
        keeps_direction = _keeps_direction(
            before.by_input[input_index].last_velocities,
            after.by_input[input_index].first_velocities,
        )
        if before.mode == after.mode and not np.all(keeps_direction):
            gap = np.array([[before.last_row], [after.first_row]])
            gaps_by_mode[before.mode].append(gap)
    return gaps_by_mode


def _gaps_beside(rows: Indices, is_uncertified: Bools) -> Indices:
    """Return the gaps (2, k) before and after each uncertified row.

    `rows` (n,) are the successive rows of a mode. The first one has no gap before it, and
    the last one none after it.
    """
    uncertified = np.flatnonzero(is_uncertified)
    before_gaps = np.setdiff1d([uncertified - 1, uncertified], [-1, len(rows) - 1])
    return np.array([rows[before_gaps], rows[before_gaps + 1]])


def _compare_at_gaps(rows: Indices, gaps: Indices) -> ComparedRows:
    """Return the ends of all gaps, and the first and the last row, as rows to compare.

    Parameters
    ----------
    rows
        (n,) the successive rows of a mode.
    gaps
        (2, k) the rows before and after each gap. A gap beside an uncertified row can be
        within one between certified rows.
    """
    compared = np.unique(np.concatenate([rows[[0, -1]], gaps.ravel()]))
    first_indices, last_indices = np.searchsorted(compared, gaps)
    # A gap covers the step after a compared row if more gaps have begun than ended there.
    begun = np.bincount(first_indices, minlength=len(compared))
    ended = np.bincount(last_indices, minlength=len(compared))
    return ComparedRows(compared, may_reverse=np.cumsum(begun - ended)[:-1] > 0)
