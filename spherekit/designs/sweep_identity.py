"""Checks which sweep a folder contains, and provides a working folder in it."""

import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spherekit.conventions import Facts
from spherekit.errors import OutputError
from spherekit.runs.run_folder import find_foreign_files
from spherekit.runs.run_identity import differences
from spherekit.storage.atomic_write import make_folder, write_text
from spherekit.wording import listing

DEFINITION_FILE = "_sweep.json"
"""Name of the file with the definition of the sweep in its folder.

Readers of Parquet data sets ignore names that begin with an underscore or a point.
"""

PART_PATTERNS = ("part-*.parquet", "designs/part-*.parquet", "tables/*/part-*.parquet")
"""Paths of the files of parts, relative to the folder of a sweep."""

WORKING_FOLDER = ".sweep-work"
"""Name of the folder, in the folder of a sweep, where unfinished parts are written."""

WORKING_FILE_NAME = re.compile(
    r"(.+/)?(part-\d{6}\.parquet|\.part-\d{6}\.parquet\.\w{8}\.part)"
)
"""Relative paths of files in the working folder: parts, and parts that are incomplete."""

WORKING_SUBFOLDER_NAME = re.compile(r".+")
"""Names of folders in the working folder; each command uses one with a random name."""


@contextmanager
def working_folder(folder: Path, definition: Facts) -> Iterator[str]:
    """Provide a working folder in the folder of a sweep, to be used in a ``with`` block.

    A part (file with the results of successive designs) is written to the working folder.
    The command that has locked the folder of the sweep then moves the part to that folder.
    The working folder is deleted at the end of the block.

    Parameters
    ----------
    folder
        Folder of the sweep.
    definition
        Definition of the sweep, see `Sweep.definition`, which is stored in the folder.

    Yields
    ------
    Path of the working folder.

    Raises
    ------
    OutputError
        If the folder has parts of another sweep or of another version of the software, or
        symbolic links, or if its working folder has files that no sweep has written.
    """
    definition_path = folder / DEFINITION_FILE
    work_path = folder / WORKING_FOLDER
    # A link could lead out of the folder, and its target would be changed.
    patterns = (DEFINITION_FILE, "designs", "tables", "tables/*", *PART_PATTERNS)
    links = [
        path.name
        for pattern in patterns
        for path in folder.glob(pattern)
        if path.is_symlink()
    ]
    foreign_files = find_foreign_files(work_path, WORKING_FILE_NAME, WORKING_SUBFOLDER_NAME)
    unexpected = [*links, *foreign_files]
    if unexpected:
        raise OutputError(
            f"{folder}: contains {listing(unexpected)}, which is a symbolic link or not a "
            "file of a sweep; choose another folder, or move it away"
        )
    stored_definition: Facts = {}
    if definition_path.exists():
        stored_definition = _read_definition(definition_path)
    if stored_definition != definition:
        if any(path for pattern in PART_PATTERNS for path in folder.glob(pattern)):
            difference = f"{DEFINITION_FILE} does not identify the sweep"
            if stored_definition:
                difference = differences(stored_definition, definition)
            raise OutputError(
                f"{folder}: contains parts of another sweep, or parts made by other code "
                f"({difference}); one data set cannot mix them. Continue the sweep that is "
                "there, choose another folder, or remove this folder"
            )
        write_text(definition_path, json.dumps(definition, indent=2) + "\n")
    # A command that was interrupted may have left its working folder.
    shutil.rmtree(work_path, ignore_errors=True)
    try:
        yield str(make_folder(work_path / os.urandom(4).hex()))
    finally:
        shutil.rmtree(work_path, ignore_errors=True)


def _read_definition(path: Path) -> Facts:
    """Read the file that says which sweep a folder contains.

    A sweep evaluates many designs of a mechanism, in numbered parts. The definition has
    everything on which its results depend.

    Raises
    ------
    OutputError
        If the file is not the definition of a sweep, or cannot be read.
    """
    try:
        definition = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        definition = None
    # Every definition has the version of spherekit.
    if not isinstance(definition, dict) or "spherekit" not in definition:
        raise OutputError(
            f"{path}: is not, or no longer, the definition of a sweep; choose another "
            "folder, or move it away"
        )
    return definition
