"""Writing files so that they are complete or absent, and checks before computations."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from spherekit.conventions import AnyPath
from spherekit.errors import OutputError

SOFTWARE_MARK = "spherekit"
"""Name of the program in pictures, by which its files are recognised."""

MAX_MARK_OFFSET_BYTES = 1 << 24
"""Length of the beginning, and of the end, of a file in which spherekit looks for its mark.

Larger: more time for large files. Smaller: marks in large files are not found, and the
files are not replaced.
"""

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
    errno.EISDIR: "this is a folder; give the name of a file in it",
    errno.EEXIST: "this is a file, not a folder; choose another name",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}
"""What to tell the user, by the error number of the operating system."""


@contextmanager
def _raise_output_error(path: AnyPath, what: str) -> Iterator[None]:
    """Convert the errors `OSError` and `ValueError` of a ``with`` block into `OutputError`.

    A file name that is not allowed is refused before the block runs.

    Parameters
    ----------
    path
        The file or folder that the block makes.
    what
        Word for the message "cannot be ...": ``created`` or ``written``.
    """
    try:
        _check_name(path)
        yield
    except (OSError, ValueError) as error:
        raise output_error(path, what, error) from None


def make_folder(path: AnyPath) -> Path:
    """Create a folder and the folders around it, if necessary; return its path.

    Raises
    ------
    OutputError
        If the folder cannot be created.
    """
    with _raise_output_error(path, "created"):
        Path(path).mkdir(parents=True, exist_ok=True)
    return Path(path)


def check_folder(path: AnyPath) -> None:
    """Check that a folder exists or can be created, without creating it.

    Raises
    ------
    OutputError
        If the folder cannot be created, or if no files can be written into it.
    """
    with _raise_output_error(path, "created"):
        # Find the innermost folder of the path that exists.
        folders = (Path(path), *Path(path).parents)
        # A link that leads nowhere counts, since no folder can have its name.
        existing = next(
            folder for folder in folders if folder.exists() or folder.is_symlink()
        )
        # If the existing path is a file, the error number tells which message the user
        # gets: the wanted folder itself is a file, or a folder around it is one.
        if existing == Path(path):
            error_if_no_folder = errno.EEXIST
        else:
            error_if_no_folder = errno.ENOTDIR
        _check_writable(existing, error_if_no_folder)


def check_file(path: AnyPath) -> None:
    """Check that a file can be created or replaced, without doing so.

    Raises
    ------
    OutputError
        If the file cannot be created or replaced.
    """
    with _raise_output_error(path, "written"):
        target = _resolve(path)
        _check_replaceable(target)
        folder = target.parent
        _check_writable(folder, errno.ENOTDIR if folder.exists() else errno.ENOENT)


def _check_writable(folder: Path, error_if_no_folder: int) -> None:
    """Raise `OSError` if a path is not a folder in which files can be created.

    `error_if_no_folder` is the error number (`errno`) for a path that is not a folder.
    """
    if not folder.is_dir():
        raise OSError(error_if_no_folder, "")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OSError(errno.EACCES, "")


def _check_name(path: AnyPath) -> None:
    """Raise `ValueError` if a path is empty or blank, or contains a null character."""
    if not os.fspath(path).strip():
        raise ValueError("the name is empty; perhaps a shell variable is not set")
    if "\0" in os.fspath(path):
        raise ValueError("the name has a null character; choose another name")


def _resolve(path: AnyPath) -> Path:
    """Return the absolute path of the file to which a path leads, without links.

    Raises
    ------
    OSError
        If a link leads back to itself. Since Python 3.13 such a link is returned instead.
    """
    try:
        return Path(path).resolve()
    except RuntimeError:
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP)) from None


def _check_replaceable(target: Path) -> None:
    """Raise an error if a path is a folder, or a device, which replacing would destroy."""
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder")
    if target.exists() and not target.is_file():
        raise ValueError("it is a device or a pipe; give the name of a file")


def check_made_by_spherekit(path: Path, mark: bytes) -> None:
    """Refuse to replace a file that spherekit has not made.

    Files of spherekit contain a mark near their beginning, or near their end as PDF files
    do. The function does nothing if the file has the mark, is empty or does not exist.

    Parameters
    ----------
    path
        The file that will be written.
    mark
        The bytes of the mark.

    Raises
    ------
    OutputError
        If the path is a link, a folder or a file without the mark.
    """
    # A file that cannot be read counts as a file without the mark.
    with suppress(OSError):
        if path.is_file() and not path.is_symlink():
            with path.open("rb") as stream:
                data = stream.read(MAX_MARK_OFFSET_BYTES)
                end = stream.seek(0, os.SEEK_END)
                stream.seek(max(0, end - MAX_MARK_OFFSET_BYTES))
                last_data = stream.read(MAX_MARK_OFFSET_BYTES)
            if not data or mark in data or mark in last_data:
                return
    # Unlike `exists`, `lexists` is also true for a link to a file that does not exist.
    if os.path.lexists(path):
        raise OutputError(
            f"{path}: would be replaced, but no command of spherekit seems to have created "
            "it; choose another folder, or move it away"
        )


def write_text(path: AnyPath, text: str) -> None:
    """Write a text file in UTF-8; an older file is replaced only when it is complete.

    Raises
    ------
    OutputError
        If the file cannot be written; an older file is then unchanged.
    """
    try:
        data = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise OutputError(
            f"{path}: character {error.start} of the text cannot be written in UTF-8; "
            "leave it out"
        ) from None
    write_bytes(path, data)


def write_bytes(path: AnyPath, data: bytes) -> None:
    """Write a file; an older file is replaced only when the new one is complete.

    Raises
    ------
    OutputError
        If the file cannot be written; an older file is then unchanged.
    """
    with open_for_writing(path) as stream:
        stream.write(data)


@contextmanager
def open_for_writing(path: AnyPath) -> Iterator[BinaryIO]:
    """Open a stream for writing a file in a ``with`` block, completely or not at all.

    The bytes are first written to a hidden file in the same folder. The hidden file gets
    the name of the file when the block ends without error. An older file is replaced in one
    step, so other programs see one of the two complete files.

    Raises
    ------
    OutputError
        If the file cannot be written; an older file is then unchanged.
    """
    with _raise_output_error(path, "written"):
        target = _resolve(path)
        _check_replaceable(target)
        # The name has a random part, so two programs that write the same file have
        # different hidden files. The name is cut because file systems limit its length to
        # 255 bytes, and a character has up to four bytes.
        unfinished = target.with_name(f".{target.name[:50]}.{os.urandom(4).hex()}.part")
        descriptor = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        try:
            with open(descriptor, "wb") as stream:  # noqa: PTH123 (an open descriptor)
                yield stream
                # The bytes must be on the disk before the file gets its name.
                stream.flush()
                os.fsync(descriptor)
            unfinished.replace(target)
        finally:
            # After success the name does not exist. After an error or an interrupt the
            # unfinished file is removed.
            unfinished.unlink(missing_ok=True)


def output_error(path: object, what: str, error: OSError | ValueError) -> OutputError:
    """Return the error to raise if a file or folder cannot be created, written or locked.

    Users see a plain message if the caller raises this error.

    Parameters
    ----------
    path
        The file or folder.
    what
        Word for the message "cannot be ...": ``created``, ``written`` or ``locked``.
    error
        The error of the operating system, or of a check of the name.
    """
    reason = str(error)
    if isinstance(error, OSError):
        # Some error numbers have a plainer text here than in the operating system.
        reason = _REASONS.get(error.errno or 0, error.strerror or reason)
    return OutputError(f"{str(path)!r}: cannot be {what}: {reason}")
