"""Folders of runs and sweeps: what in them is whole, whose it is, and if there is room.

The folder of a run is locked while it is written, with a journal of unfinished work.

What is unfinished lies in a hidden folder within it. The journal says what of that counts,
so that a run that was stopped at any moment, by whatever, can go on. Results appear in
the folder together at the end, the summary last. Its signature says that a run wrote what
it lists: nothing else is replaced or removed, and nothing behind a link.
"""

import hashlib
import json
import os
import platform
import re
import shutil
import stat
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import numpy as np

from spherekit.conventions import AnyPath
from spherekit.errors import AnalysisError, OutputError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.resources import usable_memory
from spherekit.storage.atomic_write import make_folder, refused, write_bytes
from spherekit.storage.file_lock import locked
from spherekit.tables.table import (
    CHUNK,
    FILE_SIZE,
    Format,
    Table,
    TableData,
    arrays,
    formats_of,
)
from spherekit.tables.table_rows import in_modes, typed
from spherekit.version import __version__
from spherekit.wording import listing, size_text

WORK = ".spherekit-run"
JOURNAL = "journal.json"
LOCK = "lock"
MADE = "made"
SUMMARY = "summary.json"
SIGNATURE = "signature"

BYTES = "bytes"
"""Where a run signs the sizes of its files."""

OWN = re.compile(
    r"lock|journal\.json|[^/]*\.(rows|parquet)|\.[^/]*\.part"
    r"|made/([^/]*\.(csv|parquet)|summary\.json|\.[^/]*\.part)"
)
"""Files that a run makes in the hidden folder, and in that of finished files there."""

Unfinished = Literal["refuse", "resume", "discard"]
"""What to do with the unfinished work in a folder."""


class RunFolder:
    """A folder for the results of one run, which holds its lock."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.work = path / WORK
        self._journal = self.work / JOURNAL

    @classmethod
    @contextmanager
    def opened(cls, place: AnyPath) -> "Iterator[RunFolder]":
        """Make and lock a folder; leave in it no more than results, or work to go on with.

        Raises
        ------
        OutputError
            If it cannot be written, another program writes there, or it has a summary or a
            hidden folder that no run has made.
        """
        folder = cls(make_folder(place))
        if others := foreign(folder.work, OWN, re.compile(MADE)):
            raise OutputError(
                f"{str(folder.work)!r}: runs make no {listing(others, 4)} there: it stays "
                "as it is; choose another folder for the results, or move it away"
            )
        lock = locked(folder.work / LOCK)
        if isinstance(lock, str):
            raise OutputError(
                f"{str(folder.path)!r}: {lock} is writing there; wait for its end, or "
                "choose another folder"
            )
        try:
            folder.claim([SUMMARY])
            if _content(folder.work / MADE / SUMMARY):  # it was stopped as results moved
                folder.publish()
                folder.discard()
            yield folder
        finally:
            kept = folder.unfinished or _content(folder.work / MADE / SUMMARY)
            if not kept:
                folder.discard()
                with suppress(OSError):  # Windows removes no open file
                    (folder.work / LOCK).unlink(missing_ok=True)
            lock.release()
            with suppress(OSError):  # what is kept is in it
                folder.work.rmdir()

    @property
    def unfinished(self) -> bool:
        """Whether a run was stopped here."""
        return has_unfinished(self.path)

    def read(self) -> dict[str, Any]:
        """Return what the journal says.

        Raises
        ------
        OutputError
            If it is damaged.
        """
        try:
            content = json.loads(self._journal.read_bytes())
            state = content["state"]
            whole = content["sha256"] == _digest(state)
        except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
            raise self.damaged(f"the journal does not read: {error}") from None
        if not whole or not isinstance(state, dict):
            raise self.damaged("the checksum of the journal is wrong")
        return state

    def damaged(self, why: str) -> OutputError:
        """Return the error that says that the unfinished work cannot be used."""
        return OutputError(
            f"{str(self.path)!r}: the unfinished run there cannot go on, since what it has "
            f'kept is damaged ({why}); begin again with --restart (unfinished="discard")'
        )

    def write(self, state: Mapping[str, Any]) -> None:
        """Write the journal, whole or not at all."""
        content = {"sha256": _digest(state), "state": state}
        write_bytes(self._journal, json.dumps(content).encode())

    def discard(self) -> None:
        """Remove unfinished work, the journal first; the lock stays."""
        with suppress(OSError):
            self._journal.unlink(missing_ok=True)
        for path in self.work.iterdir():
            if path.name != LOCK:
                with suppress(OSError):
                    shutil.rmtree(path) if path.is_dir() else path.unlink()

    def claim(self, names: Iterable[str]) -> None:
        """Raise `OutputError` if results of these names would replace what no run made."""
        record = self.path / SUMMARY
        owned = {*self._made(record), *self._made(self.work / MADE / SUMMARY)}
        if _content(record):
            owned.add(SUMMARY)
        others = [x for x in names if x not in owned and os.path.lexists(self.path / x)]
        if others:
            raise OutputError(
                f"{str(self.path)!r}: {listing(others, 4)} there would be replaced, and "
                "no run has made that, by what is known; choose another folder, or move it "
                "away"
            )

    def _made(self, record: Path) -> list[str]:
        """Return the names of results here that a summary lists, as they were made."""
        return [
            name
            for name, size in _content(record).get(BYTES, {}).items()
            if Path(name).name == name and _size(self.path / name) == size
        ]

    def publish(self) -> list[Path]:
        """Move finished files from the work folder to where they belong.

        The summary of an older run goes, after the files it lists; the new one is the last
        that comes. So a folder with a summary holds the files of one run.

        Raises
        ------
        OutputError
            If a file cannot be moved, or would replace what no run has made.
        """
        made = self.work / MADE
        listed = _content(made / SUMMARY)[BYTES]
        names = [*(name for name in listed if Path(name).name == name), SUMMARY]
        self.claim(names)
        try:
            for name in [*self._made(self.path / SUMMARY), SUMMARY]:
                (self.path / name).unlink(missing_ok=True)
            for name in names:
                if (made / name).exists():
                    (made / name).replace(self.path / name)
        except OSError as error:
            raise refused(self.path, "written", error) from None
        return [self.path / name for name in names]


def has_unfinished(path: Path) -> bool:
    """Return whether a run was stopped in a folder and can go on."""
    return (path / WORK / JOURNAL).exists()


def code_identity() -> dict[str, str]:
    """Return what parts of results depend on besides what was asked: versions, machine."""
    try:
        compiler = version("heyoka")
    except PackageNotFoundError:
        compiler = "none"
    return {
        "spherekit": __version__,
        "numpy": np.__version__,
        "scipy": version("scipy"),
        "heyoka": compiler,
        "texts_in_parts": "strings",
        "machine": f"{platform.system()} {platform.machine()}",
    }


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return in what two runs differ, in words; empty if in nothing."""
    changes = []
    for key in {**before, **now}:
        old = before.get(key)
        new = now.get(key)
        if json.dumps(old) != json.dumps(new):
            words = key.replace("_", " ")
            changes.append(f"{words}: {_short(old)} there, {_short(new)} now")
    return listing(changes, 4)


def _short(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."


def _digest(state: object) -> str:
    return hashlib.sha256(json.dumps(state, sort_keys=True).encode()).hexdigest()


def signed(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return a summary with the signature that says that a run wrote it."""
    return {**summary, SIGNATURE: _digest(json.loads(json.dumps(summary)))}


def _content(record: Path) -> dict[str, Any]:
    """Return what a run has signed, nothing if none has."""
    try:
        content = json.loads(record.read_bytes())
        whole = not record.is_symlink() and content.pop(SIGNATURE) == _digest(content)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}
    return content if whole else {}


def _size(path: Path) -> int:
    """Return the bytes of a file, -1 if there is none; a link is none."""
    try:
        status = path.lstat()
    except OSError:
        return -1
    return status.st_size if stat.S_ISREG(status.st_mode) else -1


def foreign(place: Path, files: re.Pattern[str], folders: re.Pattern[str]) -> list[str]:
    """Return what lies in a folder and is a link, or is called as nothing of ours is."""
    if place.is_symlink() or (place.exists() and not place.is_dir()):
        return [f"link or file {place.name}"]
    others = []
    for path in place.rglob("*"):
        name = path.relative_to(place).as_posix()
        is_folder = path.is_dir()
        called = (folders if is_folder else files).fullmatch(name)
        if path.is_symlink() or not called or not (is_folder or _size(path) >= 0):
            others.append(name)
    return others


class StoredParts:
    """The tables of a run while it goes on: a file for each block of each table.

    A file is there whole or not at all, with checksums; how many there are says `state`,
    and others are overwritten. Memory does not grow with the rows. `more` says that other
    blocks come, whose rows are read by assembly mode.
    """

    def __init__(
        self, folder: Path, more: bool, state: Iterable[tuple[str, str, int]]
    ) -> None:
        self.folder = folder
        self._more = more
        self._parts = Counter({(name, table): parts for name, table, parts in state})

    def state(self) -> list[Any]:
        """Return how many parts each table has, ready for JSON."""
        return [[*key, parts] for key, parts in self._parts.items()]

    def add(self, analysis: str, table: Table, data: TableData) -> None:
        """Write the rows of one block.

        Raises
        ------
        OutputError
            If the disk is full.
        """
        from spherekit.tables.table_files import write_columns

        several = self._more and table.in_assembly_modes
        columns, runs = in_modes(typed(table, arrays(data)), several)
        groups = [
            (mode, slice(start, min(start + CHUNK, rows.stop)))
            for mode, rows in runs
            for start in range(rows.start, rows.stop, CHUNK)
        ]
        key = analysis, table.name
        write_columns(
            self._path(key, self._parts[key]),
            columns,
            {MODES: [mode for mode, _ in groups]},
            [rows for _, rows in groups],
            "none",
        )
        self._parts[key] += 1

    def pieces(self, analysis: str, table: Table) -> Iterator[Mapping[str, Any]]:
        """Yield all rows, mode after mode; `FileError` if they are not what was written."""
        from spherekit.tables.table_files import notes_of, pieces_in

        key = analysis, table.name
        paths = [self._path(key, number) for number in range(self._parts[key])]
        groups = [
            (mode, number, group)
            for number, path in enumerate(paths)
            for group, mode in enumerate(notes_of(path)[MODES])
        ]
        return pieces_in((paths[number], group) for _, number, group in sorted(groups))

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(path.stat().st_size for path in self.folder.glob("*.parquet"))

    def _path(self, key: tuple[str, str], number: int) -> Path:
        return self.folder / f"{'.'.join(key)}.{number:06d}.parquet"


MODES = "modes"
"""Where a file of a block says which assembly mode each group of its rows is of."""


FRAMES_HELD = 8
"""Frames held at once for each link and pair of a row: 5 to 7.6 were measured."""


def memory_at_once(mechanism: Mechanism, rows: int) -> int:
    """Return about how many bytes it takes to evaluate so many rows at once.

    Frames (3, 3) of links and pairs are most of it.
    """
    return rows * FRAMES_HELD * 72 * (len(mechanism.links) + len(mechanism.pairs))


def need_memory(mechanism: Mechanism, rows: int, whole: Sequence[str]) -> None:
    """Raise `AnalysisError` if rows that analyses want at once need too much memory."""
    wanted = memory_at_once(mechanism, rows)
    there = usable_memory()
    if there is not None and wanted > there:
        raise AnalysisError(
            f"{listing(whole)} looks at all samples at once: that takes about "
            f"{size_text(wanted)} of memory for {rows} rows, and this process may use "
            f"{size_text(there)}; ask for {max(1, int(rows * there / wanted / 2))} rows "
            "(samples of all assembly modes) or fewer, or for one assembly mode"
        )


def need_disk(place: Path, held: float, whole: float, what: str, advice: str) -> None:
    """Raise `OutputError` if the disk has no room for the whole, of which some is there."""
    free = shutil.disk_usage(place).free
    if whole - held > free:
        raise OutputError(
            f"{str(place)!r}: {what} will take about {size_text(whole)}, and the disk has "
            f"{size_text(free)} left; {advice}"
        )


def need_disk_for_run(
    store: StoredParts, done: int, total: int, formats: Sequence[Format] | None
) -> None:
    """Raise `OutputError` if the disk has no room for a whole run and its files.

    Judged by the size of the store when `done` of `total` samples are done.
    """
    held = store.size
    whole = held * total / done
    formats = formats_of(formats, FILE_SIZE["csv"] * whole)
    wanted = whole * (1.0 + sum(FILE_SIZE[kind] for kind in formats))
    less = size_text(whole * (1.0 + FILE_SIZE["parquet"]))
    hint = f"; Parquet alone (--format parquet) takes {less}" if "csv" in formats else ""
    need_disk(
        store.folder.parent,
        held,
        wanted,
        "the run, work and files together,",
        f"choose another folder or fewer samples{hint}",
    )
