"""Finding analyses: entry points are listed without importing, loaded on request."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from spherekit.conventions import Names
from spherekit.errors import AnalysisError, PluginError
from spherekit.runs.analysis_faults import LOG, described, faults_of
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.declaration_checks import fault_of_class
from spherekit.runs.parameter_text import given_in
from spherekit.wording import choices, listing

GROUP = "spherekit.analyses"


_added: dict[str, type[AbstractAnalysis]] = {}


@contextmanager
def registered(*classes: type[AbstractAnalysis]) -> Iterator[None]:
    """Make analyses known for the length of a `with` block, for notebooks and tests."""
    given = {cls.name: cls for cls in classes}
    _added.update(given)
    try:
        yield
    finally:
        for name in given:
            _added.pop(name, None)


def _entries() -> Mapping[str, list[EntryPoint]]:
    """Return the entry points of the folders that packages are in, as these are now."""
    return _entries_of(
        *((x, Path(x).exists() and Path(x).stat().st_mtime_ns) for x in sys.path)
    )


@lru_cache(maxsize=1)
def _entries_of(*_: tuple[str, int]) -> Mapping[str, list[EntryPoint]]:
    """Return the entry points, which take long to list, of folders as they are now."""
    entries: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        same = entries.setdefault(entry.name, [])
        if all(other.value != entry.value for other in same):
            same.append(entry)
    return entries


def _origin(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else "unknown distribution"


def origin_of(name: str) -> str:
    """Return the distributions that offer an analysis of this name, or nothing."""
    return listing(_origin(entry) for entry in _entries().get(name, ()))


def names() -> Names:
    """Return the names of all installed analyses, broken ones too, sorted."""
    return tuple(sorted({*_entries(), *_added}))


def records() -> list[tuple[str, str, str, str]]:
    """Return every installed analysis, loading each to learn whether it works.

    By name: that, where it comes from, its class, and why it cannot be used, if so.
    """
    listed = [(name, "this process", cls.__name__, "") for name, cls in _added.items()]
    for name, entries in _entries().items():
        for entry in entries:
            try:
                load(name)
                error = ""
            except PluginError as problem:
                error = str(problem)
            listed.append((name, _origin(entry), entry.value, error))
    return sorted(listed)


def load(name: str) -> type[AbstractAnalysis]:
    """Return the class of an analysis.

    Raises
    ------
    AnalysisError
        If no analysis has this name.
    PluginError
        If it is given twice, does not import, or breaks the contract.
    """
    if name in _added:
        return _added[name]
    entries = _entries().get(name, [])
    if not entries:
        raise AnalysisError(
            f'no analysis is named "{name}"{choices(name, names(), "Installed")}'
        )
    entry, *others = entries
    if others:
        raise PluginError(
            f"analysis {name}: given by several distributions ({origin_of(name)}); "
            "uninstall all but one"
        )
    try:
        cls = entry.load()
    except (Exception, SystemExit) as problem:
        LOG.debug("%s does not import", name, exc_info=True)
        raise PluginError(
            f"analysis {name} of {_origin(entry)} does not import ({entry.value}): "
            f"{described(problem)}"
        ) from problem
    fault = fault_of_class(cls)
    if not fault and cls.name != name:
        fault = f"the class calls itself {cls.name!r}"
    if fault:
        raise PluginError(f"analysis {name} of {_origin(entry)}: {fault}")
    return cls  # type: ignore[no-any-return]


def create(request: str) -> AbstractAnalysis:
    """Return an analysis from ``NAME`` or ``NAME:key=value,key=value``.

    Lists are written ``a+b+c``. Unknown parameters and unreadable values raise
    `AnalysisError` with what is allowed, a broken plugin `PluginError`.
    """
    name, _, text = request.partition(":")
    cls = load(name)
    given = given_in(text, cls, name)
    with faults_of(name, "its constructor"):
        return cls(**given)
