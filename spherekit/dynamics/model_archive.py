"""The file of a stored model: a NumPy archive with a heading that describes it."""

import io
import json
import os
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from spherekit.dynamics.model_metadata import StoredHeading, StoredLoad
from spherekit.errors import FileError
from spherekit.version import __version__

FORMAT = "spherekit reduced model"
VERSION = 1

DAMAGED: tuple[type[Exception], ...] = (
    *(ValueError, KeyError, TypeError, EOFError, RuntimeError, ArithmeticError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)
"""What NumPy and zipfile raise of archives in which a bit has changed."""


def write_archive(
    path: str | os.PathLike[str],
    heading: Mapping[str, Any],
    arrays: Mapping[str, NDArray[np.float64]],
) -> None:
    """Write a heading and arrays; `OutputError` if that cannot be done."""
    from spherekit.files.atomic import write_bytes

    text = json.dumps({"format": FORMAT, "version": VERSION, **heading}, indent=1)
    stream = io.BytesIO()
    given: dict[str, Any] = dict(arrays)
    np.savez_compressed(stream, header=np.array(text), **given)
    write_bytes(path, stream.getvalue())


def read_archive(
    path: str | os.PathLike[str],
) -> tuple[dict[str, Any], dict[str, NDArray[np.float64]]]:
    """Return the heading and the arrays of a file; `FileError` if it is none of these."""
    where = repr(str(path))
    with np.load(Path(path), allow_pickle=False) as archive:
        if not isinstance(archive, np.lib.npyio.NpzFile) or "header" not in archive:
            raise FileError(f"{where}: is not a {FORMAT}; write one with `--to model`")
        header = json.loads(str(archive["header"]))
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            raise FileError(f"{where}: is not a {FORMAT}; write one with `--to model`")
        if header.get("version") != VERSION:
            raise FileError(
                f"{where}: has version {header.get('version')} of the format, and "
                f"spherekit {__version__} reads version {VERSION}; make it anew with this "
                "spherekit"
            )
        return header, {name: archive[name] for name in archive.files if name != "header"}


Heading = TypeVar("Heading", bound=StoredHeading)


def stored_heading(
    kind: type[Heading], header: Mapping[str, Any], made: Mapping[str, Any]
) -> Heading:
    """Return the heading of a file, whose lists are tuples, with what is made of it."""
    given = {name: header[name] for name in kind.__dataclass_fields__ if name not in made}
    rows = {name: tuple(x) if isinstance(x, list) else x for name, x in given.items()}
    return kind(**{**rows, "loads": _stored_loads(header), **made})


def _stored_loads(header: Mapping[str, Any]) -> tuple[StoredLoad, ...]:
    names = ("works_on", "components", "times", "torques")
    return tuple(
        StoredLoad(**{**given, **{name: tuple(given[name]) for name in names}})
        for given in header["loads"]
    )
