"""Runs a sweep part by part, and reads the results from the files of the parts.

A sweep computes figures of merit (and tables) of many designs of one mechanism. It is
divided into parts: a part is a group of successive designs, which are computed together and
written to Parquet files. Parts are numbered from 0. This process computes them, or worker
processes (`worker_processes`), or a cluster (`dask_cluster`). A sweep that was interrupted
is continued with the parts that are missing in its folder.
"""

import bisect
import shutil
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any
from weakref import finalize

from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, Names
from spherekit.designs.sweep import DESIGNS_FOLDER, PROCESSOR_NOTE, TABLES_FOLDER, Sweep
from spherekit.designs.sweep_identity import working_folder
from spherekit.designs.worker_processes import compute_in_processes
from spherekit.errors import DesignError, FileError, OutputError
from spherekit.progress import ProgressReporter
from spherekit.runs.resource_checks import need_disk
from spherekit.runs.run_result import Columns
from spherekit.storage.atomic_write import make_folder
from spherekit.storage.file_lock import acquire_lock
from spherekit.storage.json_data import as_json
from spherekit.tables.table_files import read_frame
from spherekit.wording import counted, listing, nearest

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    DrawSweep = Callable[["SweepResult", Columns], dict[str, Figure]]

LOCK_FILE = ".sweep.lock"
"""Name of the file in the folder of a sweep that only one program at a time can lock."""

TEMPORARY_PREFIX = "spherekit-sweep-"
"""Beginning of the names of temporary folders, which are deleted with their result."""


@dataclass(frozen=True)
class SweepResult:
    """The result of a sweep: designs, their figures of merit, and tables of their runs.

    A sweep computes many designs. A part is a file with the results of successive designs.
    The rows are read from the files of the parts when a method asks for them.

    Attributes
    ----------
    sweep
        The sweep that was run.
    folder
        The folder that the user named, which has the parts. None if the parts are in a
        temporary folder, which is deleted when this object is deleted.
    computed
        Number of parts that this command computed. The other parts were in the folder
        before.
    processors
        For each kind of processor, the sorted numbers of the parts that it has computed, by
        this command or earlier ones. The key is a text made from
        `spherekit.processor.processor_identity`, or ``"an unknown one"``.
    draw
        Function that draws the figures of `plot` in a width of 1 or 2 columns; None if the
        result was not made by `spherekit.sweep`.
    """

    sweep: Sweep
    folder: Path | None
    computed: int
    processors: dict[str, list[int]]
    _store: Path = field(repr=False)
    draw: "DrawSweep | None" = field(default=None, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of this result for pickle.

        The results of a sweep are in files, called parts. If these are in a temporary
        folder, the state contains their contents (bytes by relative path), because the
        folder is deleted with this process.
        """
        state = dict(vars(self))
        # If the user named no folder, the parts are in a temporary one.
        if self.folder is None:
            files = (path for path in self._store.rglob("*") if path.is_file())
            state["_store"] = {
                path.relative_to(self._store).as_posix(): path.read_bytes()
                for path in files
            }
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled result of a sweep.

        The results are in files, called parts. If the state contains their contents, they
        are written to a new temporary folder. This folder is deleted together with the
        result.
        """
        if has_file_contents := isinstance(state["_store"], dict):
            parts_folder = Path(mkdtemp(prefix=TEMPORARY_PREFIX))
            for name, content in state["_store"].items():
                make_folder((parts_folder / name).parent)
                (parts_folder / name).write_bytes(content)
            state = {**state, "_store": parts_folder}
        vars(self).update(state)
        if has_file_contents:
            finalize(self, shutil.rmtree, self._store, ignore_errors=True)

    @checked(DesignError)
    def plot(self, columns: Columns = 2) -> "dict[str, Figure]":
        """Return a figure for each figure of merit, drawn over the varied sizes.

        One varied size gives a line for each assembly mode. Two give a colour map or, if
        the designs are on no grid, coloured points. More give points over each size.

        Parameters
        ----------
        columns
            Width of the figures in columns of a journal: 1 is 3.5 inches, 2 is 7.2 inches.

        Raises
        ------
        DesignError
            If no design has a figure of merit, or the sweep was not made by
            `spherekit.sweep`.
        OutputError
            If matplotlib is not installed.

        Examples
        --------
        >>> import spherekit as sk
        >>> sizes = {"links.2.arc": [10.0, 15.0, 20.0]}
        >>> result = sk.sweep("four_bar", sizes, "swing=swing(theta_41)", samples=31)
        >>> result.plot()["swing"].savefig("swing.png")
        """
        # `spherekit.sweep` stores the function that draws. Packages that compute do not
        # import packages that draw.
        if self.draw is None:
            raise DesignError(
                "plot: only a result that spherekit.sweep returned can be drawn"
            )
        return self.draw(self, columns)

    @property
    def remarks(self) -> Names:
        """Sentences about the accuracy of the results.

        If several kinds of processors have computed parts of the sweep, one sentence says
        so. Otherwise there is no sentence.
        """
        if len(self.processors) < 2:
            return ()
        kinds = [
            f"{counted(len(parts), 'part')} by {kind}"
            for kind, parts in self.processors.items()
        ]
        return (
            f"several kinds of processors have computed the parts ({'; '.join(kinds)}): "
            "their numbers agree to rounding, not bit by bit",
        )

    def frame(self) -> "pd.DataFrame":
        """Return the table of all designs of the sweep as one pandas frame.

        Each row is one design in one assembly mode (way to assemble the mechanism). The
        rows are read from the files of the parts. A part is a group of successive designs.
        ``attrs["units"]`` has the units of angles that vary and of figures of merit.

        Raises
        ------
        FileError
            If the file of a part is missing or damaged, or does not belong to this sweep.
        """
        # The notes (metadata) of a file identify its sweep and its part. `read_frame`
        # checks them against the notes given here, so that no wrong file is read.
        part_numbers = range(self.sweep.part_count)
        frame = read_frame(
            [self.sweep.path_of(self._store, number) for number in part_numbers],
            [self.sweep.part_notes(number) for number in part_numbers],
        )
        frame.attrs = {"units": self.sweep.units()}
        return frame

    @property
    def table_names(self) -> Names:
        """Names of the tables of all runs, such as ``"motion"`` and ``"poles"``.

        A run of a single mechanism writes tables with the same names.
        """
        return tuple(self._tables())

    @property
    def data_sets(self) -> tuple[Path, ...]:
        """The folders of Parquet files; the files of a folder together are one table.

        The first folder has the table of designs. The others have the tables of the runs,
        in the order of `table_names`. There are no folders if the result is in a temporary
        folder.
        """
        if self.folder is None:
            return ()
        if not self.sweep.tables:
            return (self.folder,)
        tables = (self.folder / TABLES_FOLDER / name for name in self.table_names)
        return (self.folder / DESIGNS_FOLDER, *tables)

    @checked(DesignError)
    def table(self, name: str) -> "pd.DataFrame":
        """Return one table of the runs, with the rows of all designs, as a pandas frame.

        The rows are read from the files of the parts (groups of successive designs). Each
        part has one file with the table of designs. This file lists the files with the
        tables of the runs. The column ``design`` has the number of the design.
        ``attrs["units"]`` has the unit of each column that has one.

        Parameters
        ----------
        name
            Name of the table, such as ``"motion"``, ``"poles"`` or
            ``"singularities_relation"``; see `table_names`.

        Raises
        ------
        DesignError
            If there is no such table.
        FileError
            If a file is missing or damaged, or a file of the requested table does not
            belong to this sweep.
        OutputError
            If a file with the table of designs does not belong to this sweep.
        """
        tables = self._tables()
        if name not in tables:
            advice = "A sweep keeps tables only if it is called with tables=True"
            if tables:
                advice = f"Tables: {listing(tables)}"
            elif self.sweep.tables:
                advice = "All designs have failed or are left out"
            raise DesignError(
                f'{self.sweep.mechanism.name}: the sweep has no table "{name}"'
                f"{nearest(name, tables) or '.'} {advice}"
            )
        # The path of the table in each part, by number of the part. The notes (metadata) of
        # a file identify its sweep and its part. `read_frame` checks them against the notes
        # given here, so that no wrong file is read.
        path_by_part = tables[name]
        notes = [self.sweep.part_notes(number) for number in path_by_part]
        frame = read_frame([*path_by_part.values()], notes)
        # The frame has the notes of the first part. Only the units apply to all parts.
        frame.attrs = {"units": frame.attrs["units"]}
        return frame

    def _tables(self) -> dict[str, dict[int, Path]]:
        """Return the paths of the files of each table of the runs.

        A sweep can run an analysis of each design, and the runs write tables. The table of
        designs is not one of them. The outer keys are the names of the tables, and the
        inner keys the numbers of the parts. A part (group of successive designs) has one
        file of each table, unless all of its designs have failed or are left out.

        Raises
        ------
        FileError
            If a file of a part is missing, or a file with the table of designs is damaged.
        OutputError
            If a file with the table of designs does not belong to this sweep.
        """
        tables: dict[str, dict[int, Path]] = {}
        for number in range(self.sweep.part_count):
            paths = self.sweep.files_of(self._store, number)
            if not paths:
                raise FileError(
                    f"{self._store}: a file of part {number} is missing; run the same "
                    "command again to compute the part"
                )
            # The first file has the table of designs, which is no table of the runs.
            for path in paths[1:]:
                tables.setdefault(path.parent.name, {})[number] = path
        return tables

    def __repr__(self) -> str:
        folder_text = f", in {self.folder}" if self.folder else ""
        return (
            f"SweepResult({self.sweep.mechanism.name}, "
            f"{counted(self.sweep.space.count, 'design')}{folder_text})"
        )


Workers = Callable[[Sweep, str, Sequence[int]], Generator[int, None, None]]
"""A function that computes parts of a sweep on other machines.

It takes the sweep, the absolute path of a folder and the numbers of the parts. It yields
the number of each part when the files of the part are in that folder.
"""


def run_sweep(
    sweep: Sweep,
    folder: AnyPath | None = None,
    workers: int = 1,
    elsewhere: Workers | None = None,
    draw: "DrawSweep | None" = None,
) -> SweepResult:
    """Compute all parts of a sweep.

    A sweep evaluates many designs of a mechanism, in numbered parts. Each part is written
    to a file.

    Parameters
    ----------
    sweep
        The sweep.
    folder
        Folder for the files of the parts. Parts of this sweep that are in the folder
        already are not computed again. By default a temporary folder is used, which is
        deleted with the result.
    workers
        Number of processes that compute parts at the same time. With 1, or if only one part
        is missing, no other process is started.
    elsewhere
        A function that computes parts on other machines, such as
        `dask_cluster.compute_on_cluster` with its address. If given, `workers` is not used.
    draw
        The function by which `SweepResult.plot` draws.

    Returns
    -------
    The result, which reads the files of the parts on demand.

    Raises
    ------
    DesignError
        If worker processes or the cluster fail; see `worker_processes.compute_in_processes`
        and `dask_cluster.compute_on_cluster`.
    OutputError
        If the folder has parts of another sweep, is used by another program, or cannot be
        written, if the disk is too small, or if a part is missing at the end.
    """
    user_folder = None if folder is None else make_folder(folder)
    # Worker processes may have other current folders, so the path must be absolute.
    parts_folder = (
        Path(mkdtemp(prefix=TEMPORARY_PREFIX))
        if user_folder is None
        else user_folder.absolute()
    )
    # If an error occurs, the temporary folder is deleted at the end of the block. Without
    # an error, `pop_all` moves this task to the finalizer, which runs when the result is
    # deleted.
    with ExitStack() as cleanup:
        if user_folder is None:
            cleanup.callback(shutil.rmtree, parts_folder, ignore_errors=True)
        progress = _Progress(sweep, parts_folder, keeps_parts=user_folder is not None)
        progress.compute(workers, elsewhere)
        result = SweepResult(
            sweep, user_folder, progress.computed, progress.processors, parts_folder, draw
        )
        finalize(result, cleanup.pop_all().close)
    return result


@contextmanager
def _lock_folder(parts_folder: Path) -> Iterator[None]:
    """Lock the folder of a sweep within a `with` block, against other programs.

    Two sweeps in one folder would mix their files.

    Raises
    ------
    OutputError
        If another program has locked the folder.
    """
    lock = acquire_lock(parts_folder / LOCK_FILE)
    if isinstance(lock, str):
        raise OutputError(
            f"{parts_folder}: another sweep is running in this folder "
            f"({lock}); wait until it ends, or choose another folder"
        )
    try:
        yield
    finally:
        lock.release()


class _Progress:
    """Computes the missing parts of a sweep and registers the finished ones.

    A part is a group of successive designs with a file of results.

    Attributes
    ----------
    sweep
        The sweep.
    parts_folder
        Absolute path of the folder with the finished parts.
    keeps_parts
        Whether the folder stays if the sweep ends early.
    computed
        Number of parts that this command has computed so far.
    processors
        For each kind of processor, as a text, the sorted numbers of the finished parts that
        it has computed; see `SweepResult`.
    """

    def __init__(self, sweep: Sweep, parts_folder: Path, keeps_parts: bool) -> None:
        """Begin before any part of the sweep is counted; see the class."""
        self.sweep = sweep
        self.parts_folder = parts_folder
        self.keeps_parts = keeps_parts
        self.computed = 0
        self.processors: dict[str, list[int]] = {}
        self._stored_bytes = 0
        self._done_parts: set[int] = set()

    def compute(self, workers: int, elsewhere: Workers | None) -> None:
        """Compute the parts that are missing in the folder.

        Parts are written to a working folder. This function moves each finished part to
        `parts_folder`, so that a part has all its files there or none. After each part, the
        room on the disk for the missing parts is checked.

        Parameters
        ----------
        workers
            Number of worker processes. With 1, or if only one part is missing, this process
            computes the parts itself.
        elsewhere
            A function that computes parts on other machines, or None.

        Raises
        ------
        DesignError
            If worker processes or the cluster fail.
        OutputError
            If the folder has parts of another sweep, is locked or cannot be written, if the
            disk is too small, or if a part is missing at the end.
        KeyboardInterrupt
            If the user stops the command. If the parts are kept, a note says how many are
            finished.
        """
        sweep = self.sweep
        reporter = ProgressReporter(f"{sweep.mechanism.name}: sweep")
        definition = as_json(sweep.definition())
        with (
            _lock_folder(self.parts_folder),
            working_folder(self.parts_folder, definition) as work_folder,
        ):
            for number in range(sweep.part_count):
                paths = sweep.files_of(self.parts_folder, number)
                if paths:
                    self._count(number, sum(path.stat().st_size for path in paths))
            missing = [
                part_number
                for part_number in range(sweep.part_count)
                if part_number not in self._done_parts
            ]
            # The generator `parts` yields the number of each part when it has been written
            # to `work_folder`.
            parts: Generator[int, None, None] = (
                sweep.write_part(work_folder, part_number) for part_number in missing
            )
            if elsewhere is not None and missing:
                parts = elsewhere(sweep, work_folder, missing)
            elif workers > 1 and len(missing) > 1:
                parts = compute_in_processes(sweep, work_folder, missing, workers)
            try:
                for number in parts:
                    self._count(
                        number, sweep.move_part(work_folder, self.parts_folder, number)
                    )
                    self.computed += 1
                    self._need_disk()
                    reporter.report_if_due(
                        self._describe_progress,
                        done=self._finished_design_count,
                        total=sweep.space.count,
                    )
            except KeyboardInterrupt as interrupt:
                if self.keeps_parts:
                    all_parts = counted(sweep.part_count, "part")
                    interrupt.add_note(
                        f"{len(self._done_parts)} of {all_parts} are in "
                        f"{self.parts_folder}, and the same command continues from there"
                    )
                raise
            finally:
                parts.close()  # ends the worker processes, or disconnects from the cluster
        # A generator that ended without an error may have skipped parts.
        absent = [number for number in missing if number not in self._done_parts]
        if absent:
            raise OutputError(
                f"{self.parts_folder}: the sweep is over, but "
                f"{len(absent)} of {counted(sweep.part_count, 'part')} are missing "
                f"({listing(map(str, absent), 8)}); run the same command again to compute "
                "them"
            )

    def _count(self, number: int, size: int) -> None:
        """Record that a part of the sweep is stored, and which processor has computed it.

        A sweep is computed in numbered parts, each with its files. Results of different
        kinds of processors can differ by rounding, so the kinds are reported.

        Parameters
        ----------
        number
            Number of the part.
        size
            Size of the files of the part together (bytes).

        Raises
        ------
        FileError
            If the file of the part cannot be read.
        OutputError
            If the file of the part does not belong to this sweep.
        """
        self._stored_bytes += size
        self._done_parts.add(number)
        # The notes (metadata) in the file of the part describe the processor.
        processor = self.sweep.notes_of_part(self.parts_folder, number).get(
            PROCESSOR_NOTE, {}
        )
        processor_text = ", ".join(f"{key} {value}" for key, value in processor.items())
        # The numbers of the parts of each processor are sorted.
        part_numbers = self.processors.setdefault(processor_text or "an unknown one", [])
        bisect.insort(part_numbers, number)

    def _need_disk(self) -> None:
        """Raise `OutputError` if the disk has too little room for the missing parts.

        A sweep evaluates many designs of a mechanism, in numbered parts. On request it
        stores the tables of the run of each design. Only such sweeps need much room and are
        checked. Each missing part is assumed to be as large as the mean of the finished
        parts, of which there is at least one.
        """
        if self.sweep.tables:
            total_bytes = self._stored_bytes * self.sweep.part_count / len(self._done_parts)
            kept_text = "parts that are written are kept; " if self.keeps_parts else ""
            need_disk(
                self.parts_folder,
                written_bytes=self._stored_bytes,
                total_bytes=total_bytes,
                subject=f"the tables of {counted(self.sweep.space.count, 'design')}",
                advice=f"{kept_text}choose another folder, or fewer designs or samples",
            )

    @property
    def _finished_design_count(self) -> int:
        """The number of designs in finished parts."""
        return min(len(self._done_parts) * self.sweep.part_size, self.sweep.space.count)

    def _describe_progress(self) -> str:
        """Return how many designs are finished, such as ``"512 of 1000 designs"``."""
        all_designs = counted(self.sweep.space.count, "design")
        return f"{self._finished_design_count} of {all_designs}"
