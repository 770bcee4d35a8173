"""Which sweep a folder holds."""

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

DEFINITION = "_sweep.json"
"""What readers of a folder of Parquet pass over begins with _ or a point."""

PARTS = ("part-*.parquet", "designs/part-*.parquet", "tables/*/part-*.parquet")

WORK = ".sweep-work"
MADE = re.compile(r"(.+/)?(part-\d{6}\.parquet|\.part-\d{6}\.parquet\.\w{8}\.part)")
ANY = re.compile(r".+")
"""Where parts are made, and what the files and folders there are called."""


@contextmanager
def working_folder(place: Path, definition: Facts) -> Iterator[str]:
    """Claim a folder for a sweep, and give one within it in which parts are made.

    Who holds the lock moves them to their places, so that nobody else changes these.

    Raises
    ------
    OutputError
        If there are parts of another sweep, parts made by other code, or what no sweep
        has made.
    """
    path = place / DEFINITION
    work = place / WORK
    patterns = (DEFINITION, "designs", "tables", "tables/*", *PARTS)
    links = (x.name for pattern in patterns for x in place.glob(pattern) if x.is_symlink())
    others = [*links, *find_foreign_files(work, MADE, ANY)]
    if others:
        raise OutputError(
            f"{place}: {listing(others)} in it is a link or no file of sweeps; "
            "choose another folder, or move it away"
        )
    stored = _stored(path) if path.exists() else {}
    if stored != definition:
        if any(part for pattern in PARTS for part in place.glob(pattern)):
            unsaid = f"{DEFINITION} does not say of what"
            other = differences(stored, definition) if stored else unsaid
            raise OutputError(
                f"{place}: holds parts of another sweep, or made by other code ({other}), "
                "and a data set is of one; go on with that, choose another folder, or "
                "remove this one"
            )
        write_text(path, json.dumps(definition, indent=2) + "\n")
    shutil.rmtree(work, ignore_errors=True)
    try:
        yield str(make_folder(work / os.urandom(4).hex()))
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _stored(path: Path) -> Facts:
    """Return a definition that a sweep has written; `OutputError` if it is none."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        stored = None
    if not isinstance(stored, dict) or "spherekit" not in stored:
        raise OutputError(
            f"{path}: is not, or no longer, the definition of a sweep; choose another "
            "folder, or move it away"
        )
    return stored
