"""The order of a run's rows: by assembly mode, then sample."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    SAMPLE,
    Interleaved,
    TableArrays,
)
from spherekit.numeric.lent_memory import SetAside

Pieces = list[tuple[int, int, int, slice]] | None
"""Runs of rows of one block in one mode: it, the first and last sample, and the rows.

None where modes fall in a block, or samples in a mode.
"""


def pieces_of(block: Mapping[str, NDArray[Any] | SetAside | Interleaved]) -> Pieces:
    """Return the runs of rows of a block, mode after mode."""
    (modes, repeats), (samples, _) = (
        _once(block[column.name]) for column in (ASSEMBLY_MODE, SAMPLE)
    )
    if len(modes) != len(samples):
        return None
    changes = np.flatnonzero(modes[1:] != modes[:-1]) + 1
    edges = [0, *changes.tolist(), len(modes)] if len(modes) else []
    if np.any(np.diff(modes[edges[:-1]]) < 0):
        return None
    pieces = []
    for start, stop in itertools.pairwise(edges):
        piece = samples[start:stop]
        if not np.all(piece[1:] >= piece[:-1]):
            return None
        rows = slice(repeats * start, repeats * stop)
        pieces.append((int(modes[start]), int(piece[0]), int(piece[-1]), rows))
    return pieces


def _once(column: NDArray[Any] | SetAside | Interleaved) -> tuple[NDArray[Any], int]:
    """Return a column without the rows that repeat, and how often each is there."""
    if not isinstance(column, Interleaved):
        return np.asarray(column), 1
    first = column.parts[0]
    if all(part is first for part in column.parts):
        return np.asarray(first), len(column.parts)
    return np.asarray(column), 1


def parts_in_order(blocks: Sequence[Pieces]) -> list[tuple[int, slice]] | None:
    """Return pieces of successive blocks, mode after mode; None if that is not their order.

    In each block modes rise, in each mode samples, and from block to block these go on.
    """
    parts: list[tuple[int, int, slice]] = []
    last: dict[int, int] = {}
    for number, pieces in enumerate(blocks):
        if pieces is None:
            return None
        for mode, lowest, highest, rows in pieces:
            if lowest < last.get(mode, lowest):
                return None
            last[mode] = highest
            parts.append((mode, number, rows))
    return [(number, rows) for _, number, rows in sorted(parts, key=lambda part: part[:2])]


def order_of(data: TableArrays) -> NDArray[np.intp]:
    """Return the order of rows by mode, then sample; rows of one sample keep theirs."""
    return np.lexsort((data[SAMPLE.name], data[ASSEMBLY_MODE.name]))
