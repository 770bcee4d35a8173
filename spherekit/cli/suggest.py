"""What a shell may complete in the place of an argument."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from spherekit.conventions import Lines

Suggest = Callable[[str, Any], Lines]
"""Gives words for what is typed and what is known so far of the command line."""


def mechanisms(prefix: str, typed: Any = None) -> Lines:
    """Return shipped mechanisms and files."""
    from spherekit.files.library import shipped

    return [name for pack in shipped() for name in pack.files] + tables(prefix)


def studies(prefix: str, typed: Any = None) -> Lines:
    """Return shipped mechanisms, shipped studies and files."""
    from spherekit.files.library import shipped

    return [name for pack in shipped() for name in pack.studies] + mechanisms(prefix)


def analyses(prefix: str, typed: Any = None) -> Lines:
    """Return the installed analyses; after a colon the parameters of one."""
    name, colon, given = prefix.partition(":")
    if not colon:  # without the registry, which loads NumPy
        from importlib.metadata import entry_points

        return [point.name for point in entry_points(group="spherekit.analyses")]
    from spherekit.runs.parameter_text import parameters
    from spherekit.runs.registry import load

    before = prefix[: len(prefix) - len(given.rpartition(",")[2])]
    return [f"{before}{key}=" for key in parameters(load(name))]


def pairs(prefix: str, typed: Any) -> Lines:
    """Return the pairs of the mechanism that the command line names."""
    from spherekit.errors import SpherekitError
    from spherekit.files.study_reader import load_study

    with suppress(SpherekitError, AttributeError, TypeError):
        return [pair.name for pair in load_study(typed.file).mechanism.pairs]
    return []


def recordings(prefix: str, typed: Any = None) -> Lines:
    """Return recordings and folders."""
    return _files(prefix, ".rrd")


def tables(prefix: str, typed: Any = None) -> Lines:
    """Return TOML files and folders."""
    return _files(prefix, ".toml")


def _files(prefix: str, suffix: str) -> Lines:
    """Return the files with a suffix, and the folders, whose paths begin so."""
    folder, _, begun = prefix.rpartition("/")
    place = f"{folder}/" if "/" in prefix else ""
    with suppress(OSError):
        return [
            f"{place}{path.name}{'/' if path.is_dir() else ''}"
            for path in Path(place or ".").iterdir()
            if path.name.startswith(begun) and (path.is_dir() or path.suffix == suffix)
        ]
    return []
