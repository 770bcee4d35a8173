"""The folder of a run: locked while it is written, with a journal of unfinished work.

What is unfinished lies in a hidden folder within it. The journal says what of that counts,
so that a run that was stopped at any moment, by whatever, can go on. Results appear in
the folder together at the end, the summary last. Its signature says that a run wrote what
it lists: nothing else is replaced or removed, and nothing behind a link.
"""

import fnmatch
import hashlib
import json
import os
import shutil
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal, final

from spherekit.conventions import listing
from spherekit.errors import OutputError
from spherekit.files.atomic import make_folder, refused, write_bytes
from spherekit.files.plain import BaseFileLock, locked

WORK = ".spherekit-run"
JOURNAL = "journal.json"
LOCK = "lock"
MADE = "made"
PUBLISHED = "published.json"
SUMMARY = "summary.json"
SIGNATURE = "signature"

BYTES, OLDER = "bytes", "older"
"""Keys of what a run signs: sizes of its files, and of those that these replace."""

OWN = (LOCK, JOURNAL, MADE, PUBLISHED, "*.rows", ".*.part")
FILES = ("*.csv", "*.parquet", SUMMARY, ".*.part")
"""What a run makes in the hidden folder, and in the folder of finished files there."""

EVERY = 2.0
"""Seconds of work that may be lost: a journal is written after a block when so many
passed."""

Unfinished = Literal["refuse", "resume", "discard"]
"""What to do with the unfinished work in a folder."""


@final
class RunFolder:
    """A folder for the results of one run, which holds its lock."""

    def __init__(self, path: Path, lock: BaseFileLock) -> None:
        self.path = path
        self.work = path / WORK
        self._lock = lock
        self._journal = self.work / JOURNAL
        self._written = time.monotonic()

    @classmethod
    @contextmanager
    def opened(cls, place: str | os.PathLike[str]) -> "Iterator[RunFolder]":
        """Make and lock a folder; leave in it no more than results, or work to go on with.

        Raises
        ------
        OutputError
            If it cannot be written, another program writes there, or it has a summary or a
            hidden folder that no run has made.
        """
        path = make_folder(place)
        _check_work(path / WORK)
        lock = locked(path / WORK / LOCK)
        if isinstance(lock, str):
            raise OutputError(
                f"{str(path)!r}: {lock} is writing there; wait for its end, or choose "
                "another folder"
            )
        folder = cls(path, lock)
        try:
            folder.claim([SUMMARY])
            yield folder
        finally:
            folder._leave()

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
        self._written = time.monotonic()

    @property
    def due(self) -> bool:
        """Whether a journal is due."""
        return time.monotonic() - self._written >= EVERY

    def discard(self) -> None:
        """Remove unfinished work, the journal first; the lock stays."""
        with suppress(OSError):
            self._journal.unlink(missing_ok=True)
        for path in self.work.iterdir():
            if path.name not in (LOCK, PUBLISHED):
                with suppress(OSError):
                    shutil.rmtree(path) if path.is_dir() else path.unlink()

    def claim(self, names: Iterable[str]) -> None:
        """Raise `OutputError` if results of these names would replace what no run made."""
        owned = self._owned()
        others = [x for x in names if x not in owned and os.path.lexists(self.path / x)]
        if others:
            raise OutputError(
                f"{str(self.path)!r}: {listing(others, 4)} there would be replaced, and "
                "no run has made that, by what is known; choose another folder, or move it "
                "away"
            )

    def _owned(self) -> set[str]:
        """Return the names of the results here that runs have made, as they made them."""
        sizes = [*_listed(self.path / SUMMARY), *_listed(self.work / PUBLISHED)]
        made = {name for name, size in sizes if _size(self.path / name) == size}
        return made | {SUMMARY} if _content(self.path / SUMMARY) else made

    def publish(self, made: Path, names: Iterable[str]) -> list[Path]:
        """Move finished files from a folder in the work folder to where they belong.

        The summary of an older run goes first, with the files it lists; the new one comes
        last. So a folder with a summary holds the files of one run.

        Raises
        ------
        OutputError
            If a file cannot be moved, or would replace what no run has made.
        """
        names = list(names)
        self.claim(names)
        older, moved = self._owned(), self.work / PUBLISHED
        sizes = {
            BYTES: {name: _size(made / name) for name in names},
            OLDER: {name: _size(self.path / name) for name in older},
        }
        write_bytes(moved, json.dumps(signed(sizes)).encode())
        target = self.path / SUMMARY
        try:
            target.unlink(missing_ok=True)
            for name in older - set(names):
                (self.path / name).unlink(missing_ok=True)
            for name in [*(name for name in names if name != SUMMARY), SUMMARY]:
                (made / name).replace(self.path / name)
            moved.unlink()
        except OSError as error:
            raise refused(self.path, "written", error) from None
        return [self.path / name for name in names]

    def _leave(self) -> None:
        """Let go of the folder; remove the work folder unless work is left in it."""
        kept = self.unfinished
        if not kept:
            self.discard()
            with suppress(OSError):  # Windows removes no open file
                (self.work / LOCK).unlink(missing_ok=True)
        self._lock.release()
        if not kept:
            with suppress(OSError):
                self.work.rmdir()


def has_unfinished(path: Path) -> bool:
    """Return whether a run was stopped in a folder and can go on."""
    return (path / WORK / JOURNAL).exists()


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return in what two runs differ, in words; empty if in nothing."""
    changes = []
    for key in dict.fromkeys([*before, *now]):
        old, new = (_short(state.get(key)) for state in (before, now))
        if json.dumps(before.get(key)) != json.dumps(now.get(key)):
            changes.append(f"{key.replace('_', ' ')}: {old} there, {new} now")
    return listing(changes, 4)


def _short(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."


def _digest(state: object) -> str:
    return hashlib.sha256(json.dumps(state, sort_keys=True).encode()).hexdigest()


def signed(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return a summary with the signature that says that a run wrote it."""
    plain = json.loads(json.dumps(summary))
    return {**summary, SIGNATURE: _digest(plain)}


def _content(record: Path) -> dict[str, Any]:
    """Return what a run has signed, nothing if none has."""
    try:
        content = json.loads(record.read_bytes())
        whole = not record.is_symlink() and content.pop(SIGNATURE) == _digest(content)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}
    return content if whole else {}


def _listed(record: Path) -> list[tuple[str, int]]:
    """Return the files that a run has signed, and their bytes."""
    content = _content(record)
    listed = [*content.get(BYTES, {}).items(), *content.get(OLDER, {}).items()]
    return [(name, size) for name, size in listed if Path(name).name == name]


def _size(path: Path) -> int:
    """Return the bytes of a file, -1 if there is none; a link is none."""
    try:
        status = path.lstat()
    except OSError:
        return -1
    return status.st_size if stat.S_ISREG(status.st_mode) else -1


def _check_work(work: Path) -> None:
    """Raise `OutputError` if the hidden folder is not one that runs have made."""
    why = ""
    if work.is_symlink():
        why = "is a link"
    elif work.is_dir():
        others = [path.name for path in work.iterdir() if not _own(path, OWN)]
        if not others and (work / MADE).is_dir():
            within = (work / MADE).iterdir()
            others = [f"{MADE}/{x.name}" for x in within if not _own(x, FILES)]
        why = f"holds {listing(others, 4)}" if others else ""
    elif os.path.lexists(work):
        why = "is no folder"
    if why:
        raise OutputError(
            f"{str(work)!r} {why}, and runs make no such thing: it stays as it is; choose "
            "another folder for the results, or move it away"
        )


def _own(path: Path, patterns: Iterable[str]) -> bool:
    """Return whether a run may have made this: a file called so, or what is made."""
    if path.name == MADE and MADE in patterns:
        return path.is_dir() and not path.is_symlink()
    return _size(path) >= 0 and any(fnmatch.fnmatchcase(path.name, x) for x in patterns)
