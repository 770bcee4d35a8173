"""The parts of a sweep: computed by processes or elsewhere, and read again."""

import os
import shutil
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING
from weakref import finalize

from spherekit.analysis.folder import need_disk
from spherekit.analysis.frames import frame_of_parts
from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, Names, counted, listing, nearest
from spherekit.design.sweep import DESIGNS, TABLES, Sweep
from spherekit.design.sweep_identity import working_folder
from spherekit.errors import DesignError, OutputError
from spherekit.files.atomic import make_folder
from spherekit.files.plain import as_json, locked
from spherekit.progress import ProgressReporter

if TYPE_CHECKING:
    import pandas as pd


@contextmanager
def _deaf() -> Iterator[None]:
    """Let processes that are started in the block ignore Ctrl-C from their first moment.

    A terminal sends it to all of them, and one half started would speak of a fault.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)


_at_work: list[tuple[Sweep, str]] = []
"""Of what a process makes parts, and where."""


def _begin(line: Connection, sweep: Sweep, folder: str) -> None:
    """Make a process ready, which ends with the other end of a line, whatever ends that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _at_work.append((sweep, folder))

    def end() -> None:
        wait([line])
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _part(number: int) -> int:
    sweep, folder = _at_work[-1]
    return sweep.write(folder, number)


def _in_processes(
    sweep: Sweep, folder: str, numbers: Sequence[int], workers: int
) -> Generator[int, None, None]:
    """Yield parts as processes finish them; those of processes that end are made again.

    No process outlives the generator, nor this process, whatever ends it.

    Raises
    ------
    DesignError
        If all processes end before any part is made.
    """
    context = get_context("spawn")
    left = set(numbers)
    while left:
        there, here = context.Pipe(duplex=False)
        given = (there, sweep, folder)
        made = set[int]()
        pool = ProcessPoolExecutor(min(workers, len(left)), context, _begin, given)
        try:
            with _deaf():
                parts = [pool.submit(_part, number) for number in sorted(left)]
            for part in as_completed(parts):
                with suppress(BrokenProcessPool):
                    made.add(part.result())
                    yield part.result()
        finally:
            here.close()
            pool.shutdown(cancel_futures=True)
        if not made:
            raise DesignError(
                f"{sweep.mechanism.name}: the system ended a process of the sweep, "
                "perhaps for want of memory; parts that are written stay, and the same "
                "command goes on, with --workers 1 in less memory"
            )
        left -= made


LOCK = ".sweep.lock"
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
    """

    sweep: Sweep
    folder: Path | None
    computed: int
    _store: Path = field(repr=False)

    def frame(self) -> "pd.DataFrame":
        """Return all rows as a pandas frame, with the units of its columns in `attrs`."""
        frame = frame_of_parts(
            [self.sweep.path_of(self._store, k) for k in range(self.sweep.parts)]
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
        return frame_of_parts(tables[name])

    def _tables(self) -> dict[str, list[Path]]:
        """Return the parts of each table."""
        made: dict[str, list[Path]] = {}
        for number in range(self.sweep.parts):
            for path in self.sweep.files_of(self._store, number)[1:]:
                made.setdefault(path.parent.name, []).append(path)
        return made

    def __repr__(self) -> str:
        where = f", in {self.folder}" if self.folder else ""
        return (
            f"SweepResult({self.sweep.mechanism.name}, "
            f"{counted(self.sweep.space.count, 'design')}{where})"
        )


Workers = Callable[[Sweep, str, Sequence[int]], Generator[int, None, None]]
"""Computes parts somewhere, and yields the number of each when it is written."""


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
        If the folder holds another sweep, is in use, or cannot be written.
    """
    kept = None if folder is None else make_folder(folder)
    place = kept or Path(mkdtemp(prefix="spherekit-sweep-"))
    with ExitStack() as failed:
        if kept is None:
            failed.callback(shutil.rmtree, place, ignore_errors=True)
        result = SweepResult(
            sweep, kept, _computed(sweep, place, workers, elsewhere), place
        )
        finalize(result, failed.pop_all().close)
    return result


def _computed(sweep: Sweep, place: Path, workers: int, elsewhere: Workers | None) -> int:
    """Compute the parts that are missing in a folder; return how many were."""
    working = ProgressReporter(f"{sweep.mechanism.name}: sweep")
    lock = locked(place / LOCK)
    if isinstance(lock, str):
        raise OutputError(f"{place}: another sweep is at work in it ({lock})")
    with lock, working_folder(place, as_json(sweep.definition())) as work:
        files = [sweep.files_of(place, number) for number in range(sweep.parts)]
        missing = [number for number, paths in enumerate(files) if not paths]
        size = sum(path.stat().st_size for paths in files for path in paths)
        done = sweep.parts - len(missing)
        made: Generator[int, None, None] = (sweep.write(work, number) for number in missing)
        if elsewhere is not None:
            made = elsewhere(sweep, work, missing)
        elif workers > 1 and len(missing) > 1:
            made = _in_processes(sweep, work, missing, workers)
        try:
            for number in made:
                size += sweep.settle(work, place, number)
                done += 1
                if sweep.tables:
                    what = f"the tables of {counted(sweep.space.count, 'design')}"
                    need_disk(place, size, size * sweep.parts / done, what, FEWER)
                designs = min(done * sweep.part_size, sweep.space.count)
                working.tell(f"{designs} of {counted(sweep.space.count, 'design')}".__str__)
        except KeyboardInterrupt as stop:
            stop.add_note(
                f"{done} of {counted(sweep.parts, 'part')} are in {place}, and the same "
                "command goes on from there"
            )
            raise
        finally:
            made.close()
    return len(missing)
