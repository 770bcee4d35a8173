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


@contextmanager
def _refusing(path: AnyPath, what: str) -> Iterator[None]:
    """Raise `OutputError` where the block fails: a file or folder cannot be `what`."""
    try:
        _named(path)
        yield
    except (OSError, ValueError) as error:
        raise refused(path, what, error) from None


def make_folder(path: AnyPath) -> Path:
    """Return a folder as a path, made with the folders around it if it is not there.

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    with _refusing(path, "made"):
        Path(path).mkdir(parents=True, exist_ok=True)
    return Path(path)


def check_folder(path: AnyPath) -> None:
    """Raise `OutputError` unless a folder is there or can be made; nothing is made."""
    with _refusing(path, "made"):
        places = (Path(path), *Path(path).parents)
        nearest = next(folder for folder in places if folder.exists())
        _writable(nearest, errno.EEXIST if nearest == Path(path) else errno.ENOTDIR)


def check_file(path: AnyPath) -> None:
    """Raise `OutputError` unless a file can be made there; nothing is made."""
    with _refusing(path, "written"):
        _replaceable(Path(path))
        around = Path(path).parent
        _writable(around, errno.ENOTDIR if around.exists() else errno.ENOENT)


def _writable(folder: Path, fault: int) -> None:
    """Raise `OSError` with `fault` if there is no folder, or none that can be changed."""
    if not folder.is_dir():
        raise OSError(fault, "")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OSError(errno.EACCES, "")


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
    with _refusing(path, "written"):
        target = Path(path).resolve()
        _replaceable(target)
        unfinished = target.with_name(f".{target.name[:100]}.{os.urandom(4).hex()}.part")
        handle = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        try:
            with open(handle, "wb") as stream:  # noqa: PTH123 (an open descriptor)
                yield stream
                stream.flush()
                os.fsync(handle)
            unfinished.replace(target)
        finally:
            # After success the name is gone; after a fault or Ctrl-C the rest goes too.
            unfinished.unlink(missing_ok=True)


def refused(path: object, what: str, error: OSError | ValueError) -> OutputError:
    """Return the error that says why a file or folder cannot be `what`."""
    reason = str(error)
    if isinstance(error, OSError):
        reason = _REASONS.get(error.errno or 0, error.strerror or reason)
    return OutputError(f"{str(path)!r}: cannot be {what}: {reason}")
