"""Whether memory and disk have room for a run, and sizes in words."""

from collections.abc import Sequence

from spherekit.analysis.folder.on_disk import OnDisk
from spherekit.analysis.tables import FILE_SIZE, Files, Format
from spherekit.conventions import listing
from spherekit.errors import AnalysisError, OutputError
from spherekit.model.mechanism import Mechanism
from spherekit.resources import usable_memory

FRAMES_HELD = 8
"""Frames held at once for each link and pair of a row: 5 to 7.6 were measured."""


def size_text(count: float) -> str:
    """Return a number of bytes as ``1.5 GB``."""
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= scale:
            return f"{count / scale:.3g} {unit}"
    return f"{count / 1e3:.3g} kB"


def memory_at_once(mechanism: Mechanism, rows: int) -> int:
    """Return about how many bytes it takes to evaluate so many rows at once.

    Frames (3, 3) of links and pairs are most of it.
    """
    return rows * FRAMES_HELD * 72 * (len(mechanism.links) + len(mechanism.pairs))


def need_memory(mechanism: Mechanism, rows: int, whole: Sequence[str]) -> None:
    """Raise `AnalysisError` if rows that analyses want at once need too much memory."""
    wanted, there = memory_at_once(mechanism, rows), usable_memory()
    if there is not None and wanted > there:
        raise AnalysisError(
            f"{listing(whole)} looks at all samples at once: that takes about "
            f"{size_text(wanted)} of memory for {rows} rows, and this process may use "
            f"{size_text(there)}; ask for {max(1, int(rows * there / wanted / 2))} rows "
            "(samples of all assembly modes) or fewer, or for one assembly mode"
        )


def need_disk(
    store: OnDisk, done: int, total: int, formats: Sequence[Format] | None
) -> None:
    """Raise `OutputError` if the disk has no room for a whole run and its files.

    Judged by the size of the store when `done` of `total` samples are done.
    """
    whole = store.size * total / done
    formats = Files(formats=formats).formats_of(FILE_SIZE["csv"] * whole)
    wanted = whole * (1.0 + sum(FILE_SIZE[kind] for kind in formats))
    if wanted - store.size <= store.free:
        return
    less = whole * (1.0 + FILE_SIZE["parquet"])
    hint = f"; Parquet alone (--format parquet) takes {size_text(less)}"
    raise OutputError(
        f"{str(store.folder.parent)!r}: the run will take about {size_text(wanted)}, work "
        f"and files together, and the disk has {size_text(store.free)} left; choose "
        f"another folder or fewer samples{hint if 'csv' in formats else ''}"
    )
