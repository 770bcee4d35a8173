"""The folder of a run: its lock, its journal and its results.

An unfinished run keeps its work in a hidden folder there. The rows in it are written by
`table_store.py`.
"""

import hashlib
import json
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

from spherekit.conventions import AnyPath
from spherekit.errors import OutputError
from spherekit.storage.atomic_write import make_folder, output_error, write_bytes
from spherekit.storage.file_lock import BaseFileLock, acquire_lock
from spherekit.wording import listing

WORK = ".spherekit-run"
"""The hidden folder of unfinished work."""

JOURNAL = "journal.json"
"""File in `WORK` with the identity and the state of an unfinished run."""

LOCK = "lock"
"""File in `WORK` that is locked while a run writes to the folder."""

FINISHED = "made"
"""Folder in `WORK` with the complete results, before they are moved to the run folder."""

SUMMARY = "summary.json"

SIGNATURE = "signature"
"""Key in a summary of the checksum of its other entries."""

FILE_BYTES = "bytes"
"""Key in a summary of the size of each file of the run."""

WORK_FILES = re.compile(
    r"lock|journal\.json|[^/]*\.(rows|parquet)|\.[^/]*\.part"
    r"|made/([^/]*\.(csv|parquet)|summary\.json|\.[^/]*\.part)"
)
"""Paths of the files that runs make in `WORK`."""

Unfinished = Literal["refuse", "resume", "discard"]
"""What to do with the unfinished work in a folder."""


class RunFolder:
    """A folder for the results of one run, which is locked by this process.

    Files that no run has written are never replaced or removed. A file counts as written by
    a run if a signed summary lists it with its size.

    Parameters
    ----------
    path
        The folder. Create objects by `open`, which also locks the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.work = path / WORK
        self._journal = self.work / JOURNAL

    @classmethod
    @contextmanager
    def open(cls, path: AnyPath) -> "Iterator[RunFolder]":
        """Create and lock the folder of a run for a `with` statement.

        The folder has a hidden work folder. A run stores unfinished work there. It also
        writes its results there first, and moves them to the folder when they are complete.
        At the end of the `with` statement, work that can be resumed stays in the work
        folder. Everything else is removed from it.

        Raises
        ------
        OutputError
            If the folder cannot be written, if another program writes to it, or if it has a
            summary or a work folder with files that no run has written.
        """
        run_folder = cls(make_folder(path))
        # The lock is a file in the work folder. Before it is written, this test makes sure
        # that the work folder is from a run.
        run_folder._refuse_foreign_work()
        with run_folder._lock():
            run_folder.refuse_foreign_results([SUMMARY])
            run_folder._finish_interrupted_publication()
            yield run_folder

    def _refuse_foreign_work(self) -> None:
        """Raise `OutputError` if the work folder has files that are not from a run."""
        foreign_files = find_foreign_files(self.work, WORK_FILES, re.compile(FINISHED))
        if foreign_files:
            raise OutputError(
                f"{str(self.work)!r}: contains {listing(foreign_files, 4)}, which no "
                "run of spherekit creates there, so nothing was changed; choose another "
                "folder for the results, or move these files away"
            )

    @contextmanager
    def _lock(self) -> Iterator[None]:
        """Lock the folder during a `with` statement, so that no other run writes there.

        At the end, the lock is released, and the work folder is removed if it is not
        needed.

        Raises
        ------
        OutputError
            If another program has locked the folder.
        """
        # If the folder is locked already, the result is a text about the other program.
        lock = acquire_lock(self.work / LOCK)
        if isinstance(lock, str):
            raise OutputError(
                f"{str(self.path)!r}: {lock} is writing there; wait until it ends, "
                "or choose another folder"
            )
        try:
            yield
        finally:
            self._close(lock)

    def _close(self, lock: BaseFileLock) -> None:
        """Release the lock of the folder, and remove the work folder if it is not needed.

        The hidden work folder stays if it has unfinished work, or complete results that are
        not moved yet.
        """
        if self.has_unfinished_work or self._has_finished_results:
            lock.release()
            return
        self.discard_work()
        # Remove the lock file while it is locked, so that no other program's lock is
        # removed. Windows cannot remove an open file; `lock.release` removes it there.
        with suppress(OSError):
            (self.work / LOCK).unlink(missing_ok=True)
        lock.release()
        with suppress(OSError):
            self.work.rmdir()

    def _finish_interrupted_publication(self) -> None:
        """Move the results of an earlier run that was stopped while it moved them."""
        if self._has_finished_results:
            self.publish()
            self.discard_work()

    @property
    def has_unfinished_work(self) -> bool:
        """Whether a run was stopped here and can be resumed."""
        return has_unfinished_work(self.path)

    @property
    def _has_finished_results(self) -> bool:
        """Whether complete results wait to be moved. Their summary is written last."""
        return bool(_signed_summary(self.work / FINISHED / SUMMARY))

    def read_journal(self) -> dict[str, Any]:
        """Return the entries of the journal, the record of progress of an unfinished run.

        The run is resumed from these entries. The file has a checksum of the entries, so
        that damage is noticed.

        Raises
        ------
        OutputError
            If the journal is damaged.
        """
        try:
            content = json.loads(self._journal.read_bytes())
            entries = content["state"]
            is_intact = content["sha256"] == _checksum(entries)
        except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
            raise self.damage_error(
                f"{JOURNAL}, its record of progress, cannot be read: {error}"
            ) from None
        if not is_intact or not isinstance(entries, dict):
            raise self.damage_error(
                f"the checksum of {JOURNAL}, its record of progress, is wrong"
            )
        return entries

    def damage_error(self, reason: str) -> OutputError:
        """Return the error which says that the unfinished work cannot be used."""
        return OutputError(
            f"{str(self.path)!r}: the unfinished run there cannot continue, because its "
            f"saved state is damaged ({reason}); start again with --restart "
            '(unfinished="discard")'
        )

    def write_journal(self, entries: Mapping[str, Any]) -> None:
        """Write the journal. If this is interrupted, the earlier journal stays."""
        # The checksum is computed from the entries as they are read again: keys are texts.
        entries = json.loads(json.dumps(entries))
        content = {"sha256": _checksum(entries), "state": entries}
        write_bytes(self._journal, json.dumps(content).encode())

    def discard_work(self) -> None:
        """Remove the unfinished work of a run, but not the lock of its folder.

        The journal (record of progress) is removed first. If the removal is interrupted, no
        journal is left that lists missing files.
        """
        with suppress(OSError):
            self._journal.unlink(missing_ok=True)
        # Someone may have removed the folder during the run.
        paths = [*self.work.iterdir()] if self.work.is_dir() else []
        for path in paths:
            if path.name == LOCK:
                continue
            with suppress(OSError):
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink()

    def refuse_foreign_results(self, names: Iterable[str]) -> None:
        """Raise `OutputError` if results would replace files that no run has written.

        The summary of a run lists its files, and these may be replaced. A summary counts
        only if it is signed, which means that it contains a checksum of itself. Other files
        of the same name are then not mistaken for a summary.

        Parameters
        ----------
        names
            Names of the files that results will have.
        """
        summary_path = self.path / SUMMARY
        replaceable_names = {
            *self._written_files(summary_path),
            # Complete results wait in a separate folder, with their summary. If moving them
            # (`publish`) was interrupted, some of them are here already.
            *self._written_files(self.work / FINISHED / SUMMARY),
        }
        # A summary without a valid signature is empty.
        if _signed_summary(summary_path):
            replaceable_names.add(SUMMARY)
        # `lexists` also finds links that lead nowhere.
        foreign_files = [
            name
            for name in names
            if name not in replaceable_names and os.path.lexists(self.path / name)
        ]
        if foreign_files:
            raise OutputError(
                f"{str(self.path)!r}: the run would replace {listing(foreign_files, 4)} "
                "there, which no run of spherekit seems to have written; choose another "
                "folder, or move these files away"
            )

    def _written_files(self, summary_path: Path) -> list[str]:
        """Return the files in this folder that a summary lists, if unchanged in size."""
        return [
            name
            for name, size in _signed_summary(summary_path).get(FILE_BYTES, {}).items()
            if Path(name).name == name and _file_size(self.path / name) == size
        ]

    def earlier_files(self) -> list[str]:
        """Return the names of the files of an earlier run, which `publish` replaces."""
        return self._written_files(self.path / SUMMARY)

    def publish(self) -> list[Path]:
        """Move complete results from the work folder to the folder of the run.

        First the files of an older run are removed. Then the new files are moved, and their
        summary last. While the summary of the new files is in the work folder, an
        interrupted call can be repeated.

        Returns
        -------
        Paths of the files, the summary last.

        Raises
        ------
        OutputError
            If a file cannot be moved, or would replace a file that no run has written.
        """
        finished_folder = self.work / FINISHED
        # The summary has a signature, which shows that a run has written it. It lists the
        # size in bytes of each file of the run, by file name.
        listed_names = _signed_summary(finished_folder / SUMMARY)[FILE_BYTES]
        # For safety, names that contain a folder are left out. A run lists no such names.
        names = [*(name for name in listed_names if Path(name).name == name), SUMMARY]
        self.refuse_foreign_results(names)
        try:
            # Remove the older files and their summary, then move the new ones.
            for name in [*self._written_files(self.path / SUMMARY), SUMMARY]:
                (self.path / name).unlink(missing_ok=True)
            for name in names:
                # A file is missing here if an interrupted call has moved it.
                if (finished_folder / name).exists():
                    (finished_folder / name).replace(self.path / name)
        except OSError as error:
            raise output_error(self.path, "written", error) from None
        return [self.path / name for name in names]


def has_unfinished_work(path: Path) -> bool:
    """Return whether a run was stopped in a folder and can be resumed."""
    return (path / WORK / JOURNAL).exists()


def sign_summary(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return a summary with a signature, by which later runs see that a run wrote it."""
    # The checksum is computed from the summary as it is read again: without tuples, for
    # example.
    return {**summary, SIGNATURE: _checksum(json.loads(json.dumps(summary)))}


def _checksum(entries: object) -> str:
    """Return the SHA-256 of entries as JSON with sorted keys."""
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()


def _signed_summary(path: Path) -> dict[str, Any]:
    """Return the entries of a summary with a valid signature, otherwise {}."""
    try:
        entries = json.loads(path.read_bytes())
        is_valid = not path.is_symlink() and entries.pop(SIGNATURE) == _checksum(entries)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}
    return entries if is_valid else {}


def _file_size(path: Path) -> int:
    """Return the size of a regular file in bytes, -1 if there is no regular file."""
    try:
        status = path.lstat()
    except OSError:
        return -1
    return status.st_size if stat.S_ISREG(status.st_mode) else -1


def find_foreign_files(
    folder: Path, files: re.Pattern[str], folders: re.Pattern[str]
) -> list[str]:
    """Return symbolic links in a folder, and paths that spherekit has not written there.

    Callers refuse to work in a folder with such files, so that none of them is lost.

    Parameters
    ----------
    folder
        The folder to search, with all folders in it. It need not exist.
    files, folders
        Patterns of the relative paths of files and folders that spherekit writes there.

    Returns
    -------
    Relative paths, or a phrase if `folder` is itself a symbolic link or a file.
    """
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        return [f"link or file {folder.name}"]
    foreign_files = []
    for path in folder.rglob("*"):
        relative_path = path.relative_to(folder).as_posix()
        is_folder = path.is_dir()
        pattern = folders if is_folder else files
        has_expected_name = pattern.fullmatch(relative_path)
        # `_file_size` is negative for a device or another special file.
        is_plain = is_folder or _file_size(path) >= 0
        if path.is_symlink() or not has_expected_name or not is_plain:
            foreign_files.append(relative_path)
    return foreign_files
