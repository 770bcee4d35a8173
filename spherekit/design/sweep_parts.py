"""The parts of a sweep: computed by processes or elsewhere, and read again.

Processes that compute parts of a sweep and end with the one that asked them to.
"""

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from traceback import format_exc
from typing import TYPE_CHECKING, Any

import numpy as np

from spherekit.analysis.folder import need_disk, size_text
from spherekit.analysis.frames import columns_of_files, frame_of, frame_of_parts
from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, counted, listing, nearest
from spherekit.design.sweep import DESIGNS, TABLES, Columns, Sweep
from spherekit.design.sweep_identity import working_folder
from spherekit.errors import DesignError, OutputError, SpherekitError
from spherekit.files.atomic import make_folder
from spherekit.files.plain import as_json, locked
from spherekit.progress import ProgressReporter
from spherekit.resources import usable_memory

if TYPE_CHECKING:
    import pandas as pd


Part = Callable[[int], int]
"""Makes a part by its number, and returns that."""


def made_by(make: Part, numbers: Sequence[int], workers: int) -> Generator[int, None, None]:
    """Yield numbers as processes have made their parts, but those of processes that ended.

    No process outlives the generator, nor this process, whatever ends it.

    Raises
    ------
    Exception
        What `make` raises in a process.
    """
    context, left = get_context("spawn"), deque(numbers)
    with ExitStack() as ended:
        lines: list[Connection] = []
        for _ in range(min(workers, len(left))):
            here, there = context.Pipe()
            process = context.Process(target=_serve, args=(there,), daemon=True)
            with _no_stop():
                process.start()
                ended.callback(_end, process)
            there.close()
            with suppress(OSError):  # it has ended: told below
                here.send(make)
                here.send(left.popleft())
            lines.append(here)
        while lines:
            for line in wait(lines):
                assert isinstance(line, Connection)
                try:
                    answer = line.recv()
                except (EOFError, OSError):
                    lines.remove(line)
                    continue
                if isinstance(answer, Exception):
                    raise answer
                if left:
                    with suppress(OSError):
                        line.send(left.popleft())
                else:
                    lines.remove(line)
                yield answer


def _end(process: BaseProcess) -> None:
    process.kill()
    process.join()


@contextmanager
def _no_stop() -> Iterator[None]:
    """Put off what stops this process, and keep it from processes that are started.

    A terminal sends Ctrl-C to all of them, and one half started would speak of a fault.
    Where any thread takes a signal, its handler is called in the main one.
    """
    if not hasattr(signal, "pthread_sigmask"):  # not on Windows
        yield
        return
    came: list[int] = []
    stops = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    handlers = {x: signal.getsignal(x) for x in stops if callable(signal.getsignal(x))}
    if threading.current_thread() is not threading.main_thread():
        handlers = {}  # it handles none
    resource_tracker.ensure_running()  # it would let go of the mask
    for number in handlers:
        signal.signal(number, lambda number, _: came.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, stops)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for put_off in came:
            signal.raise_signal(put_off)


def _serve(line: Connection) -> None:
    """Make the parts whose numbers come, in a process of its own.

    What makes them comes first: libraries are loaded for it, and the parent may end then.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_SETMASK, [])
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # of a line whose other end has gone
        make = line.recv()
        while True:
            line.send(_answer(make, line.recv()))


def _answer(make: Part, number: int) -> int | Exception:
    try:
        return make(number)
    except Exception as problem:
        if not isinstance(problem, SpherekitError):
            problem.add_note(format_exc())
        return problem


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


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
        Where its parts are, None where they are in memory.
    computed
        How many parts were computed now; the others were there.
    """

    sweep: Sweep
    folder: Path | None
    computed: int
    _parts: tuple[tuple[Columns, Mapping[str, Any]], ...] = field(default=(), repr=False)

    def frame(self) -> "pd.DataFrame":
        """Return all rows as a pandas frame, with the units of its columns in `attrs`."""
        return frame_of(self._columns(), {"units": self.sweep.units()})

    @property
    def table_names(self) -> tuple[str, ...]:
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

    def _tables(self) -> dict[str, list[Any]]:
        """Return the parts of each table, as files or in memory."""
        made: dict[str, list[Any]] = {}
        if self.folder is None:
            for _, tables in self._parts:
                for name, rows in tables.items():
                    made.setdefault(name, []).append(rows)
            return made
        for number in range(self.sweep.parts):
            for path in self.sweep.files_of(self.folder, number)[1:]:
                made.setdefault(path.parent.name, []).append(path)
        return made

    def _columns(self) -> Columns:
        if self.folder is None:
            parts: Sequence[Columns] = [columns for columns, _ in self._parts]
            return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
        paths = [self.sweep.path_of(self.folder, k) for k in range(self.sweep.parts)]
        return columns_of_files(paths)

    def __repr__(self) -> str:
        space = self.sweep.space
        where = f", in {self.folder}" if self.folder else ""
        return (
            f"SweepResult({self.sweep.mechanism.name}, "
            f"{counted(space.count, 'design')}{where})"
        )


Workers = Callable[[Sweep, str, Sequence[int]], Generator[int, None, None]]
"""Computes parts somewhere, and yields the number of each when it is written."""


def run_sweep(
    sweep: Sweep,
    folder: AnyPath | None = None,
    workers: int = 1,
    resume: bool = True,
    elsewhere: Workers | None = None,
) -> SweepResult:
    """Compute all parts of a sweep.

    Parameters
    ----------
    sweep
        The sweep.
    folder
        Where parts are written; those that are there already are kept. Without it they
        stay in memory.
    workers
        Processes at work.
    resume
        Whether parts of the same sweep that are in the folder may be taken.
    elsewhere
        What computes parts on other machines.

    Raises
    ------
    OutputError
        If the folder holds another sweep, is in use, or cannot be written.
    """
    working = ProgressReporter(f"{sweep.mechanism.name}: sweep")
    if folder is None:
        parts = []
        for number in range(sweep.parts):
            parts.append(sweep.in_memory(number))
            bytes_now = sum(rows.nbytes for _, made in parts for rows in made.values())
            _need_memory(sweep, bytes_now, len(parts))
            working.tell(_how_far(sweep, len(parts)))
        return SweepResult(sweep, None, len(parts), tuple(parts))
    place = make_folder(folder)
    lock = locked(place / LOCK)
    if isinstance(lock, str):
        raise OutputError(f"{place}: another sweep is at work in it ({lock})")
    with lock, working_folder(place, as_json(sweep.definition()), resume) as work:
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
                working.tell(_how_far(sweep, done))
        except KeyboardInterrupt as stop:
            stop.add_note(
                f"{done} of {counted(sweep.parts, 'part')} are in {place}, and the same "
                "command goes on from there"
            )
            raise
        finally:
            made.close()
    return SweepResult(sweep, place, len(missing))


def _need_memory(sweep: Sweep, size: int, done: int) -> None:
    """Raise `DesignError` if memory has no room for the tables of all parts."""
    wanted, there = size * sweep.parts / done, usable_memory()
    if there is not None and wanted > there:
        raise DesignError(
            f"{sweep.mechanism.name}: the tables of "
            f"{counted(sweep.space.count, 'design')} take about {size_text(wanted)} of "
            f"memory, and this process may use {size_text(there)}; give a folder, to which "
            "they go part by part"
        )


def _how_far(sweep: Sweep, parts: int) -> Callable[[], str]:
    done = min(parts * sweep.part_size, sweep.space.count)
    return lambda: f"{done} of {counted(sweep.space.count, 'design')}"


def _part(sweep: Sweep, folder: str, number: int) -> int:
    return sweep.write(folder, number)


def _in_processes(
    sweep: Sweep, folder: str, numbers: Sequence[int], workers: int
) -> Generator[int, None, None]:
    """Yield parts as processes finish them; those of processes that end are made again.

    Raises
    ------
    DesignError
        If all processes end before any part is made.
    """
    left = set(numbers)
    while left:
        before = len(left)
        with closing(made_by(partial(_part, sweep, folder), sorted(left), workers)) as made:
            for number in made:
                left.discard(number)
                yield number
        if len(left) == before:
            raise DesignError(
                f"{sweep.mechanism.name}: the system ended a process of the sweep, "
                "perhaps for want of memory; parts that are written stay, and the same "
                "command goes on, with --workers 1 in less memory"
            )
