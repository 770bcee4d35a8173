"""What a shell may complete in the place of an argument."""

import argparse
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

Suggest = Callable[[str, argparse.Namespace], Iterable[str]]


def suggesting(argument: argparse.Action, words: Suggest) -> None:
    """Let a shell complete an argument by `words` of what is typed and known so far."""

    def _completer(prefix: str, parsed_args: argparse.Namespace, **_: Any) -> Iterable[str]:
        return words(prefix, parsed_args)

    argument.completer = _completer  # type: ignore[attr-defined]


def mechanisms(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return shipped mechanisms and files."""
    from spherekit.files.library import shipped

    return [name for pack in shipped() for name in pack.files] + files(prefix, ".toml")


def studies(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return shipped mechanisms, shipped studies and files."""
    from spherekit.files.library import shipped

    return [name for pack in shipped() for name in pack.studies] + mechanisms(
        prefix, options
    )


def analyses(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return the installed analyses; after a colon the parameters of one."""
    name, colon, given = prefix.partition(":")
    if not colon:  # without the registry, which loads NumPy
        return [point.name for point in entry_points(group="spherekit.analyses")]
    from spherekit.analysis.arguments import parameters
    from spherekit.analysis.registry import load

    before = prefix[: len(prefix) - len(given.rpartition(",")[2])]
    return [f"{before}{key}=" for key in parameters(load(name))]


def pairs(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return the pairs of the mechanism that the command line names."""
    from spherekit.errors import SpherekitError
    from spherekit.files.study import load_study

    with suppress(SpherekitError, AttributeError, TypeError):
        return [pair.name for pair in load_study(options.file).mechanism.pairs]
    return []


def recordings(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return recordings and folders."""
    return files(prefix, ".rrd")


def files(prefix: str, suffix: str) -> list[str]:
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
