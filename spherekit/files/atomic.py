"""Writing a file so that it is there completely or not at all."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from spherekit.conventions import AnyPath
from spherekit.errors import OutputError

MARK = "spherekit"
"""What pictures say who has made them."""

MOST = 1 << 24
"""Bytes of a file in which its mark is looked for."""

_REASONS = {
    errno.ENOSPC: "the disk is full; free some space or choose another folder",
    errno.EFBIG: "the file would be larger than this user or this disk allows; choose "
    "another folder, or fewer samples",
    errno.EDQUOT: "the disk quota is used up; free some space or choose another folder",
    errno.EACCES: "the folder is not writable; choose another one",
    errno.EPERM: "the folder is not writable; choose another one",
    errno.EROFS: "the folder is on a read-only disk; choose another one",
    errno.ENOENT: "the folder does not exist; create it first",
    errno.ENOTDIR: "a part of the path is a file, not a folder",
    errno.EISDIR: "is a folder; give the name of a file in it",
    errno.EEXIST: "is a file, not a folder; choose another name",
    errno.ENAMETOOLONG: "the name is too long",
}


def make_folder(path: AnyPath) -> Path:
    """Return a folder as a path, made with the folders around it if it is not there.

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    try:
        _named(path)
        folder = Path(path)
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise refused(path, "made", error) from None
    return folder


def check_folder(path: AnyPath) -> None:
    """Raise `OutputError` unless a folder is there or can be made; nothing is made."""
    places = (Path(path), *Path(path).parents)
    try:
        _named(path)
        nearest = next(folder for folder in places if folder.exists())
    except (OSError, ValueError) as error:
        raise refused(path, "made", error) from None
    if not nearest.is_dir():
        number = errno.EEXIST if nearest == Path(path) else errno.ENOTDIR
        raise refused(path, "made", OSError(number, ""))
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise refused(path, "made", OSError(errno.EACCES, ""))


def check_file(path: AnyPath) -> None:
    """Raise `OutputError` unless a file can be made there; nothing is made."""
    target = Path(path)
    try:
        _named(path)
        _replaceable(target)
        faults = (
            (not target.parent.exists(), errno.ENOENT),
            (not target.parent.is_dir(), errno.ENOTDIR),
            (not os.access(target.parent, os.W_OK | os.X_OK), errno.EACCES),
        )
    except (OSError, ValueError) as error:
        raise refused(path, "written", error) from None
    for fault, number in faults:
        if fault:
            raise refused(path, "written", OSError(number, ""))


def _named(path: AnyPath) -> None:
    """Raise `ValueError` if no file can have a name, or none was given."""
    if not os.fspath(path).strip():
        raise ValueError("the name is empty (an unset variable?)")
    if "\0" in os.fspath(path):
        raise ValueError("a null character is in the name")


def _replaceable(target: Path) -> None:
    """Raise an error if what is there is no file: a device would be gone."""
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder")
    if target.exists() and not target.is_file():
        raise ValueError("is a device or a pipe; give the name of a file")


def check_own(path: Path, mark: bytes) -> None:
    """Raise `OutputError` if a link, or a file without our mark, has a name of ours."""
    with suppress(OSError):
        if path.is_file() and not path.is_symlink():
            with path.open("rb") as stream:
                data = stream.read(MOST)
            if not data or mark in data:
                return
    if os.path.lexists(path):
        raise OutputError(
            f"{path}: would be replaced, and no command of spherekit has made that, by "
            "what is known; choose another folder, or move it away"
        )


def write_text(path: AnyPath, text: str) -> None:
    """Write a text file in UTF-8, replacing an older one only when complete.

    Raises
    ------
    OutputError
        If it cannot be written; an older file is then unchanged.
    """
    try:
        data = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise OutputError(f"{path}: character {error.start} has no UTF-8") from None
    write_bytes(path, data)


def write_bytes(path: AnyPath, data: bytes) -> None:
    """Write a file, replacing an older one only when complete.

    Raises
    ------
    OutputError
        If it cannot be written; an older file is then unchanged.
    """
    with writing(path) as stream:
        stream.write(data)


@contextmanager
def writing(path: AnyPath) -> Iterator[BinaryIO]:
    """Give a stream whose bytes become the file when the block is left without a fault.

    Raises
    ------
    OutputError
        If it cannot be written; an older file is then unchanged.
    """
    temporary: Path | None = None
    try:
        _named(path)
        target = Path(path).resolve()
        _replaceable(target)
        mark = os.urandom(4).hex()
        unfinished = target.with_name(f".{target.name[:100]}.{mark}.part")
        handle = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        temporary = unfinished
        with open(handle, "wb") as stream:  # noqa: PTH123 (an open descriptor)
            yield stream
            stream.flush()
            os.fsync(handle)
        temporary.replace(target)
    except (OSError, ValueError) as error:
        raise refused(path, "written", error) from None
    finally:
        # After success the name is gone; after a fault or Ctrl-C the rest goes too.
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def refused(path: object, what: str, error: OSError | ValueError) -> OutputError:
    """Return the error that says why a file or folder cannot be `what`."""
    reason = str(error)
    if isinstance(error, OSError):
        reason = _REASONS.get(error.errno or 0, error.strerror or reason)
    return OutputError(f"{str(path)!r}: cannot be {what}: {reason}")
