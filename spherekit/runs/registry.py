"""Finds analyses: entry points are listed without importing them, and loaded on request."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import NamedTuple

from spherekit.conventions import Names
from spherekit.errors import AnalysisError, PluginError
from spherekit.quantity import AngleUnit
from spherekit.runs.analysis_faults import (
    PLUGIN_LOG,
    convert_plugin_errors,
    describe_exception,
)
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.declaration_checks import find_class_fault
from spherekit.runs.parameter_text import parse_fields
from spherekit.wording import choices, listing

ENTRY_POINT_GROUP = "spherekit.analyses"
"""Name of the group of entry points in which packages declare analyses."""

_registered_classes: dict[str, type[AbstractAnalysis]] = {}
"""Analyses of this process by name, see `registered`."""


@contextmanager
def registered(*classes: type[AbstractAnalysis]) -> Iterator[None]:
    """Make analyses known for the length of a `with` block, for notebooks and tests.

    If an analysis of the same name is already known, the new one replaces it in the block.

    Raises
    ------
    PluginError
        If a class has no name.
    """
    for cls in classes:
        if not hasattr(cls, "name"):
            raise PluginError(f"{cls!r} cannot be registered: {find_class_fault(cls)}")
    class_by_name = {cls.name: cls for cls in classes}
    # An outer block may have registered the same names.
    outer_classes = {
        name: _registered_classes[name]
        for name in class_by_name
        if name in _registered_classes
    }
    _registered_classes.update(class_by_name)
    try:
        yield
    finally:
        for name in class_by_name:
            _registered_classes.pop(name, None)
        _registered_classes.update(outer_classes)


def _find_entry_points() -> Mapping[str, list[EntryPoint]]:
    """Return the entry points of all installed packages by name.

    Entry points are package metadata through which packages announce their analyses. Entry
    points are listed again only if a folder of packages has changed, because listing takes
    long.
    """
    folder_states = [(folder, _change_time(folder)) for folder in sys.path]
    return _list_entry_points(*folder_states)


def _change_time(folder: str) -> int | None:
    """Return when a folder was changed (ns), None if it is missing or cannot be read."""
    try:
        return Path(folder).stat().st_mtime_ns
    except (OSError, ValueError):
        return None


@lru_cache(maxsize=1)
def _list_entry_points(
    *_folder_states: tuple[str, int | None],
) -> Mapping[str, list[EntryPoint]]:
    """Return the entry points, through which packages announce analyses, by name.

    Results are cached, because listing takes long. The arguments serve only as the key of
    the cache: each folder of `sys.path`, and the time at which the folder was changed.
    """
    entries_by_name: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        entries = entries_by_name.setdefault(entry.name, [])
        # A package can be listed twice, in an installed and in an editable form.
        if all(other.value != entry.value for other in entries):
            entries.append(entry)
    return entries_by_name


def _distribution_name(entry: EntryPoint) -> str:
    """Return the name of the distribution with an entry point."""
    return entry.dist.name if entry.dist is not None else "unknown distribution"


def list_distributions(name: str) -> str:
    """Return the distributions with an analysis of this name, empty if there is none."""
    entries = _find_entry_points().get(name, ())
    return listing(_distribution_name(entry) for entry in entries)


def analysis_names() -> Names:
    """Return the names of all installed analyses, including broken analyses, sorted."""
    return tuple(sorted({*_find_entry_points(), *_registered_classes}))


class AnalysisRecord(NamedTuple):
    """An installed analysis, as in the list that users can ask for.

    Attributes
    ----------
    name
        Name of the analysis.
    origin
        Name of the installed package (distribution) that contains it.
    class_name
        Name of its class, or its entry point ``MODULE:CLASS``.
    error
        Reason why it cannot be used, empty if it can.
    """

    name: str
    origin: str
    class_name: str
    error: str


def list_analyses() -> list[AnalysisRecord]:
    """Return all installed analyses, sorted by name.

    Each analysis is loaded, so that errors are found.
    """
    # Classes that this process has registered itself, without an installed package.
    analysis_records = [
        AnalysisRecord(
            name,
            origin="this process",
            class_name=cls.__name__,
            error=find_class_fault(cls),
        )
        for name, cls in _registered_classes.items()
    ]
    # Analyses of installed packages, which declare them as entry points.
    for name, entries in _find_entry_points().items():
        for entry in entries:
            # Load by name, as in a run. If several packages have an analysis of this name,
            # each of them gets the error that the name is not unique.
            try:
                load_analysis(name)
                error = ""
            except PluginError as problem:
                error = str(problem)
            origin = _distribution_name(entry)
            analysis_records.append(AnalysisRecord(name, origin, entry.value, error))
    # Records are sorted by their first field, the name.
    return sorted(analysis_records)


def load_analysis(name: str) -> type[AbstractAnalysis]:
    """Return the class of the analysis with a certain name.

    Raises
    ------
    AnalysisError
        If no analysis has this name.
    PluginError
        If several packages have an analysis of this name, or if the analysis cannot be
        imported or has a faulty class.
    """
    # Either this process has registered the class, or an installed package declares the
    # class as an entry point.
    if name in _registered_classes:
        registered_class = _registered_classes[name]
        if fault := find_class_fault(registered_class):
            raise PluginError(f"analysis {name} of this process: {fault}")
        return registered_class
    entries = _find_entry_points().get(name, [])
    if not entries:
        raise AnalysisError(
            f'no analysis is named "{name}"{choices(name, analysis_names(), "Installed")}'
        )
    if len(entries) > 1:
        raise PluginError(
            f"analysis {name}: several installed packages offer it "
            f"({list_distributions(name)}); uninstall all but one"
        )
    (entry,) = entries
    origin = _distribution_name(entry)
    try:
        cls = entry.load()
    except (Exception, SystemExit) as problem:
        PLUGIN_LOG.debug("%s does not import", name, exc_info=True)
        raise PluginError(
            f"analysis {name} of {origin} does not import ({entry.value}): "
            f"{describe_exception(problem)}"
        ) from problem
    fault = find_class_fault(cls)
    if not fault and cls.name != name:
        fault = f"the class has another name, {cls.name!r}"
    if fault:
        raise PluginError(f"analysis {name} of {origin}: {fault}")
    return cls  # type: ignore[no-any-return]


def create_analysis(request: str, angle_unit: AngleUnit = "rad") -> AbstractAnalysis:
    """Return an analysis from ``NAME`` or ``NAME:key=value,key=value``.

    A list as value is written ``a+b+c``.

    Parameters
    ----------
    request
        The name and the parameters of the analysis.
    angle_unit
        The unit of an angle that is written without a unit: the angle unit of the
        mechanism.

    Raises
    ------
    AnalysisError
        If a parameter is unknown, or a value cannot be read. The message says what is
        allowed.
    PluginError
        If the analysis is a plugin that cannot be used.
    """
    name, _, text = request.partition(":")
    cls = load_analysis(name)
    parameters = parse_fields(text, cls, name, angle_unit=angle_unit)
    with convert_plugin_errors(name, "its constructor"):
        return cls(**parameters)
