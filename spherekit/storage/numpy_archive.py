"""NumPy archives (.npz) with a heading and a checksum.

The heading is text in JSON that says what the arrays are. An archive ends with its own
SHA-256 sum as hexadecimal digits after a mark. The mark and the sum are the comment of the
zip archive, which other programs ignore. A change of any byte, or a program that writes the
archive anew, invalidates the checksum. Without the checksum, a changed heading could cause
any amount of work before a fault is noticed.
"""

import hashlib
import io
import json
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from spherekit.arrays import Array
from spherekit.conventions import AnyPath
from spherekit.errors import FileError
from spherekit.storage.atomic_write import write_bytes
from spherekit.version import __version__

CHECKSUM_MARK = b"sha256:"
"""Text before the checksum."""

CHECKSUM_LENGTH = 64
"""Number of digits of the checksum."""

DAMAGE_ERRORS: tuple[type[Exception], ...] = (
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    RuntimeError,
    ArithmeticError,
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
)
"""Errors that NumPy, zipfile and constructors raise for archives with other content."""

Content = TypeVar("Content")


@dataclass(frozen=True)
class ArchiveFormat:
    """The name and version of a kind of archive files that spherekit writes.

    Attributes
    ----------
    name, version
        Name and version of the format, which are stored in each archive.
    remedy
        Advice how to make such an archive, for error messages.
    """

    name: str
    version: int
    remedy: str


def write_archive(
    path: AnyPath,
    archive_format: ArchiveFormat,
    heading: Mapping[str, Any],
    arrays: Mapping[str, Any],
) -> None:
    """Write a heading and arrays to a NumPy archive (.npz) that ends with its checksum.

    Parameters
    ----------
    path
        The file, which is replaced as a whole.
    archive_format
        Name and version of the format, which are added to the heading.
    heading
        Entries that JSON can store, by key.
    arrays
        Arrays by their names.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    entries = {
        "format": archive_format.name,
        "version": archive_format.version,
        **heading,
    }
    stream = io.BytesIO()
    header = np.array(json.dumps(entries, indent=1))
    np.savez_compressed(stream, header=header, **arrays)
    # An archive is a zip file, which ends with a comment. The checksum is the end of this
    # comment, and is computed from all bytes before it. The comment is first written with
    # zeros in place of the checksum, since these bytes include the length of the comment.
    with zipfile.ZipFile(stream, "a") as archive:
        archive.comment = CHECKSUM_MARK + bytes(CHECKSUM_LENGTH)
    content = stream.getvalue()[:-CHECKSUM_LENGTH]
    write_bytes(path, content + _checksum(content))


def _checksum(content: bytes) -> bytes:
    """Return the SHA-256 sum as hexadecimal digits."""
    return hashlib.sha256(content).hexdigest().encode()


def read_archive(
    path: AnyPath,
    archive_format: ArchiveFormat,
    construct: Callable[[dict[str, Any], dict[str, Array]], Content],
) -> Content:
    """Read an archive that `write_archive` has written, and construct an object from it.

    Parameters
    ----------
    path
        The file.
    archive_format
        Name and version of the format that the file must have.
    construct
        Function of the header (in which lists are tuples) and the arrays by name, which
        returns the object. It may raise any of `DAMAGE_ERRORS` if the data are faulty.

    Raises
    ------
    FileError
        If the file cannot be read, has another format or version, or was changed.
    """
    where = repr(str(path))
    name = archive_format.name
    data = _read_file(path, where)
    # The file ends with the checksum of the bytes before it.
    content = data[:-CHECKSUM_LENGTH]
    is_whole = content.endswith(CHECKSUM_MARK) and data == content + _checksum(content)
    try:
        if not is_whole:
            raise ValueError("its checksum is missing or wrong")
        # The checksum is in the comment at the end of the archive, which NumPy ignores.
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            header = json.loads(str(archive.get("header", "null")))
            if not isinstance(header, dict) or header.get("format") != name:
                raise FileError(f"{where}: is not a {name}; {archive_format.remedy}")
            if header.get("version") != archive_format.version:
                raise FileError(
                    f"{where}: has version {header.get('version')} of the format, but "
                    f"spherekit {__version__} reads version {archive_format.version}; "
                    "create the file again with this version of spherekit"
                )
            arrays = {item: archive[item] for item in archive.files if item != "header"}
        return construct(_lists_to_tuples(header), arrays)
    except DAMAGE_ERRORS as error:  # `FileError` is none of them
        raise FileError(
            f"{where}: is not a {name}, or is damaged or from another version ({error}); "
            f"create it again: {archive_format.remedy}"
        ) from None


def _read_file(path: AnyPath, where: str) -> bytes:
    """Return the bytes of a file.

    Parameters
    ----------
    path
        The file.
    where
        The path in quotes, for error messages.

    Raises
    ------
    FileError
        If the file cannot be read, or if it is a pipe or a device.
    """
    try:
        mode = Path(path).stat().st_mode
        # Reading a pipe or a device could wait for ever.
        if stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise FileError(f"{where}: is a pipe or a device; give the name of a file")
        return Path(path).read_bytes()
    except OSError as error:
        raise FileError(f"{where}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # a null character in the name
        raise FileError(f"{where}: cannot be read: {error}") from None


def _lists_to_tuples(value: Any) -> Any:
    """Return a value of JSON with tuples in place of all lists within it."""
    if isinstance(value, dict):
        return {name: _lists_to_tuples(part) for name, part in value.items()}
    if isinstance(value, list):
        return tuple(map(_lists_to_tuples, value))
    return value
