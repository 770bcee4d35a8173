"""Where directions of a block's poles may reverse from one row to the next."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.row_kernel import RowFunction
from spherekit.rates.signs import Stops
from spherekit.sphere.rotation import Floats

FEW = 128
"""So many angular velocities are compared one by one where their box leaves it open."""
PARTS = 8
"""Parts that more of them are divided into."""
ASIDE = 1e-8
"""The least cosine of successive directions: those of rows that are still open may be off
by a tenth of that, as those that are vouched for."""

Numbers = NDArray[np.intp]


@final
@dataclass(frozen=True)
class Seen:
    """What was seen of a slice's rows that are vouched for, while they were in the cache.

    `first` and `last` are the numbers of the outermost, `ends` for each input the relative
    angular velocities (poles, 3, 2) there, and `gaps` (2, k) the rows between which some
    direction may reverse. `errors` are for each input the largest of directions, rates,
    changes.
    """

    first: int
    last: int
    ends: tuple[Floats, ...]
    gaps: tuple[Numbers, ...]
    errors: tuple[tuple[float, ...], ...]

    @classmethod
    def of(
        cls,
        deciding: RowFunction,
        columns: Floats,
        rows: Numbers | range,
        counted: NDArray[np.bool_] | None = None,
    ) -> "Seen":
        """Return what is seen of successive rows; errors are those of the `counted`."""
        every = range(len(deciding.inputs))
        turning = [deciding.turning(columns, k) for k in every]
        boxes = [deciding.ends(columns, k) for k in every]
        at = [_gaps(deciding, turning[k], k, boxes[k][:2]) for k in every]
        errors = tuple(box[2] for box in boxes)
        return cls(
            int(rows[0]),
            int(rows[-1]),
            tuple(deciding.relative(k, turning[k][..., [0, -1]]) for k in every),
            tuple(np.array([numbered(rows, k), numbered(rows, k + 1)]) for k in at),
            errors if counted is None else largest(deciding, columns, counted),
        )


def numbered(rows: Numbers | range, chosen: Numbers) -> Numbers:
    """Return the numbers of chosen ones of rows or samples."""
    return chosen + rows.start if isinstance(rows, range) else rows[chosen]


def largest(
    deciding: RowFunction, columns: Floats, chosen: NDArray[np.bool_]
) -> tuple[tuple[float, ...], ...]:
    """Return the largest errors of chosen rows by input: directions, rates, changes."""
    some = slice(None) if np.all(chosen) else chosen
    every = (deciding.errors(columns, k) for k in range(len(deciding.inputs)))
    return tuple(
        tuple(np.maximum.reduce(errors[:, some], axis=1, initial=0.0).tolist())
        for errors in every
    )


def stops_of(
    seen: Sequence[tuple[int, Seen]],
    number: int,
    held: NDArray[np.bool_],
    careful: Numbers,
) -> dict[int, Stops]:
    """Return where directions of an input are looked at, by the modes' places.

    `seen` are slices with their modes, in order; `held` (modes, samples) says which rows
    have a configuration, `careful` are those that were found with care.
    """
    gaps: dict[int, list[Numbers]] = defaultdict(list)
    for mode, here in seen:
        gaps[mode].append(here.gaps[number])
    ends = np.array([here.ends[number] for _, here in seen])
    if len(seen) > 1:
        reverses = ~np.all(_along(ends[:-1, ..., 1], ends[1:, ..., 0]), axis=1)
        for k in np.flatnonzero(reverses).tolist():
            (mode, one), (other, two) = seen[k : k + 2]
            if mode == other:
                gaps[mode].append(np.array([[one.last], [two.first]]))
    stops: dict[int, Stops] = {}
    for mode, of_mode in enumerate(held):
        if not np.any(of_mode):
            continue
        start, count = mode * len(of_mode), len(of_mode)
        outer = int(np.argmax(of_mode)), count - 1 - int(np.argmax(of_mode[::-1]))
        some = careful[(careful >= start) & (careful < start + count)]
        if len(some):
            rows = np.flatnonzero(of_mode) + start
            at = np.searchsorted(rows, some)
            at, going_on = at[at > 0], at[at < len(rows) - 1]
            gaps[mode].append(np.array([rows[at - 1], rows[at]]))
            gaps[mode].append(np.array([rows[going_on], rows[going_on + 1]]))
        stops[mode] = _stops(np.array(outer) + start, gaps[mode])
    return stops


def _stops(ends: Numbers, parts: Sequence[Numbers]) -> Stops:
    gaps = np.concatenate([np.empty((2, 0), dtype=np.intp), *parts], axis=1)
    rows = np.unique(np.concatenate([ends, gaps.ravel()]))
    depth = np.zeros(len(rows), dtype=np.intp)
    first, second = np.searchsorted(rows, gaps)
    np.add.at(depth, first, 1)
    np.add.at(depth, second, -1)
    return Stops(rows, np.cumsum(depth)[:-1] > 0)


def largest_errors(
    seen: Sequence[tuple[tuple[float, ...], ...]], number: int
) -> list[float | None]:
    """Return the largest errors of an input's directions, rates and changes in a block."""
    parts = [errors[number] for errors in seen]
    return [max(of_kind) for of_kind in zip(*parts, strict=True)] or [None] * 3


def _along(one: Floats, two: Floats) -> NDArray[np.bool_]:
    """Return which directions (..., 3) do not reverse from one to the other."""
    sizes = np.sum(one * one, axis=-1) * np.sum(two * two, axis=-1)
    return np.asarray(np.sum(one * two, axis=-1) >= ASIDE * np.sqrt(sizes))


def _gaps(
    deciding: RowFunction,
    turning: Floats,
    number: int,
    box: tuple[Floats, Floats] | None = None,
    first: int = 0,
) -> Numbers:
    """Return after which rows a direction of an input may reverse to the next one.

    By the angular velocities (links, 3, n) of what turns: within their `box`, least and
    largest, first, then, where that leaves it open, in parts.
    """
    none = np.empty(0, dtype=np.intp)
    n = turning.shape[2]
    if not turning.size or n < 2:
        return none
    if n <= FEW:
        v = np.moveaxis(deciding.relative(number, turning), 1, 2)
        return first + np.flatnonzero(~np.all(_along(v[:, :-1], v[:, 1:]), axis=0))
    low, high = box or (
        np.minimum.reduce(turning, axis=2),
        np.maximum.reduce(turning, axis=2),
    )
    least, most = deciding.relative(number, low, high), deciding.relative(number, high, low)
    # No product of two in a box falls below the one, no size exceeds the other.
    across, one, other = least * most, least * least, most * most
    inner = np.where(across > 0.0, np.minimum(one, other), across)
    product, size = np.sum(inner, axis=1), np.sum(np.maximum(one, other), axis=1)
    if np.all(product >= ASIDE * size):
        return none
    step = -(-n // PARTS)
    starts = range(0, n - 1, step)
    parts = (
        _gaps(deciding, turning[..., k : k + step + 1], number, None, first + k)
        for k in starts
    )
    return np.concatenate([none, *parts])
