"""The parts of a sweep: computed by processes or elsewhere, and read again."""

import bisect
import shutil
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any
from weakref import finalize

from spherekit.analysis.folder import need_disk
from spherekit.analysis.frames import frame_of_parts
from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, Names, counted, listing, nearest
from spherekit.design.part_processes import compute_in_processes
from spherekit.design.sweep import DESIGNS, PROCESSOR, TABLES, Sweep
from spherekit.design.sweep_identity import working_folder
from spherekit.errors import DesignError, OutputError
from spherekit.files.atomic import make_folder
from spherekit.files.plain import as_json, locked
from spherekit.progress import ProgressReporter

if TYPE_CHECKING:
    import pandas as pd

LOCK = ".sweep.lock"
STORE = "spherekit-sweep-"
"""What folders of sweeps begin with that last as long as their result."""

FEWER = "what is written stays; choose another folder, or fewer designs or samples"


@dataclass(frozen=True)
class SweepResult:
    """The designs of a sweep with their figures of merit, and the tables of their runs.

    Attributes
    ----------
    sweep
        What was asked.
    folder
        Where its parts are, None where they last as long as this.
    computed
        How many parts were computed now; the others were there.
    processors
        The numbers of the parts that each kind of processor has computed, now or before.
        Kinds are given in words, see `spherekit.processor`.
    """

    sweep: Sweep
    folder: Path | None
    computed: int
    processors: dict[str, list[int]]
    _store: Path = field(repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """Return all of it; if no folder was given, with the contents of its files."""
        state = dict(vars(self))
        if self.folder is None:
            files = (path for path in self._store.rglob("*") if path.is_file())
            state["_store"] = {
                path.relative_to(self._store).as_posix(): path.read_bytes()
                for path in files
            }
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        if self_contained := isinstance(state["_store"], dict):
            store = Path(mkdtemp(prefix=STORE))
            for name, content in state["_store"].items():
                make_folder((store / name).parent)
                (store / name).write_bytes(content)
            state = {**state, "_store": store}
        vars(self).update(state)
        if self_contained:
            finalize(self, shutil.rmtree, self._store, ignore_errors=True)

    @property
    def remarks(self) -> Names:
        """What to know of these numbers, in sentences."""
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
        """Return all rows as a pandas frame, with the units of its columns in `attrs`."""
        numbers = range(self.sweep.parts)
        frame = frame_of_parts(
            [self.sweep.path_of(self._store, number) for number in numbers],
            [self.sweep.part_notes(number) for number in numbers],
        )
        frame.attrs = {"units": self.sweep.units()}
        return frame

    @property
    def table_names(self) -> Names:
        """The tables there are, as files of runs are called: motion, poles, ..."""
        return tuple(self._tables())

    @property
    def data_sets(self) -> tuple[Path, ...]:
        """The folders of the table of designs and of those of their runs."""
        if self.folder is None:
            return ()
        if not self.sweep.tables:
            return (self.folder,)
        tables = (self.folder / TABLES / name for name in self.table_names)
        return (self.folder / DESIGNS, *tables)

    @checked(DesignError)
    def table(self, name: str) -> "pd.DataFrame":
        """Return the rows of all designs in a table of their runs, by `design`.

        Parameters
        ----------
        name
            As the file of a run is called: ``"motion"``, ``"poles"``,
            ``"singularities_relation"``.

        Raises
        ------
        DesignError
            If there is no such table.
        """
        tables = self._tables()
        if name not in tables:
            some = f"tables: {listing(tables)}" if tables else "ask for tables=True"
            raise DesignError(
                f'{self.sweep.mechanism.name}: there is no table "{name}" of designs'
                f"{nearest(name, tables) or ';'} {some}"
            )
        paths = tables[name].values()
        notes = [self.sweep.part_notes(number) for number in tables[name]]
        frame = frame_of_parts([*paths], notes)
        frame.attrs = {"units": frame.attrs["units"]}
        return frame

    def _tables(self) -> dict[str, dict[int, Path]]:
        """Return the files of each table, by the numbers of the parts."""
        tables: dict[str, dict[int, Path]] = {}
        for number in range(self.sweep.parts):
            for path in self.sweep.files_of(self._store, number)[1:]:
                tables.setdefault(path.parent.name, {})[number] = path
        return tables

    def __repr__(self) -> str:
        where = f", in {self.folder}" if self.folder else ""
        return (
            f"SweepResult({self.sweep.mechanism.name}, "
            f"{counted(self.sweep.space.count, 'design')}{where})"
        )


Workers = Callable[[Sweep, str, Sequence[int]], Generator[int, None, None]]
"""Computes parts somewhere, and yields the number of each when it is in a folder."""


def run_sweep(
    sweep: Sweep,
    folder: AnyPath | None = None,
    workers: int = 1,
    elsewhere: Workers | None = None,
) -> SweepResult:
    """Compute all parts of a sweep.

    Parameters
    ----------
    sweep
        The sweep.
    folder
        Where parts are written; those that are there already are kept. Without it they
        last as long as the result.
    workers
        Processes at work.
    elsewhere
        What computes parts on other machines.

    Raises
    ------
    OutputError
        If the folder holds another sweep, is in use, or cannot be written, or a part is
        missing in the end.
    """
    kept = None if folder is None else make_folder(folder)
    # The absolute path is the same in all processes, wherever they stand.
    store = Path(mkdtemp(prefix=STORE)) if kept is None else kept.absolute()
    with ExitStack() as failed:
        if kept is None:
            failed.callback(shutil.rmtree, store, ignore_errors=True)
        progress = _Progress(sweep, store)
        progress.compute(workers, elsewhere)
        result = SweepResult(sweep, kept, progress.computed, progress.processors, store)
        finalize(result, failed.pop_all().close)
    return result


@contextmanager
def _locked(store: Path) -> Iterator[None]:
    """Hold the lock on a folder of parts.

    It is released as the block is left, even if an error keeps objects of the block alive.

    Raises
    ------
    OutputError
        If another program holds it.
    """
    lock = locked(store / LOCK)
    if isinstance(lock, str):
        raise OutputError(f"{store}: another sweep is at work in it ({lock})")
    try:
        yield
    finally:
        lock.release()


class _Progress:
    """The parts of a sweep that are in a folder, while the others are computed.

    Attributes
    ----------
    computed
        How many parts were computed by this command.
    processors
        The numbers of parts by the kind of processor that has computed them, in words.
    """

    def __init__(self, sweep: Sweep, store: Path) -> None:
        self.sweep = sweep
        self.store = store
        self.computed = 0
        self.processors: dict[str, list[int]] = {}
        self._bytes = 0
        self._done: set[int] = set()

    def compute(self, workers: int, elsewhere: Workers | None) -> None:
        """Compute the parts that are missing."""
        sweep = self.sweep
        reporter = ProgressReporter(f"{sweep.mechanism.name}: sweep")
        definition = as_json(sweep.definition())
        with _locked(self.store), working_folder(self.store, definition) as work:
            for number in range(sweep.parts):
                paths = sweep.files_of(self.store, number)
                if paths:
                    self._count(number, sum(path.stat().st_size for path in paths))
            missing = [x for x in range(sweep.parts) if x not in self._done]
            parts: Generator[int, None, None] = (sweep.write(work, x) for x in missing)
            if elsewhere is not None and missing:
                parts = elsewhere(sweep, work, missing)
            elif workers > 1 and len(missing) > 1:
                parts = compute_in_processes(sweep, work, missing, workers)
            try:
                for number in parts:
                    self._count(number, sweep.settle(work, self.store, number))
                    self.computed += 1
                    self._need_disk()
                    reporter.tell(self._in_words)
            except KeyboardInterrupt as stop:
                stop.add_note(
                    f"{len(self._done)} of {counted(sweep.parts, 'part')} are in "
                    f"{self.store}, and the same command goes on from there"
                )
                raise
            finally:
                parts.close()
        lacking = [number for number in missing if number not in self._done]
        if lacking:
            raise OutputError(
                f"{self.store}: {counted(len(lacking), 'part')} of {sweep.parts} are "
                f"missing in the end ({listing(map(str, lacking), 8)}); the same command "
                "makes them"
            )

    def _count(self, number: int, size: int) -> None:
        """Count a part that is there, of so many bytes."""
        self._bytes += size
        self._done.add(number)
        processor = self.sweep.notes_of_part(self.store, number).get(PROCESSOR, {})
        words = ", ".join(f"{key} {value}" for key, value in processor.items())
        bisect.insort(self.processors.setdefault(words or "an unknown one", []), number)

    def _need_disk(self) -> None:
        """Raise `OutputError` if the disk has no room for the parts that are missing."""
        if self.sweep.tables:
            whole = self._bytes * self.sweep.parts / len(self._done)
            what = f"the tables of {counted(self.sweep.space.count, 'design')}"
            need_disk(self.store, self._bytes, whole, what, FEWER)

    def _in_words(self) -> str:
        space = self.sweep.space
        designs = min(len(self._done) * self.sweep.part_size, space.count)
        return f"{designs} of {counted(space.count, 'design')}"
