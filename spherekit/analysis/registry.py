"""Finding analyses: entry points are listed without importing, loaded on request."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any, final

from spherekit.analysis.arguments import given_in
from spherekit.analysis.contract import CONTRACT, AbstractAnalysis
from spherekit.analysis.result import MOTION
from spherekit.analysis.tables import COLUMNS
from spherekit.conventions import NAME_PATTERN, listing, nearest
from spherekit.errors import AnalysisError, PluginError

GROUP = "spherekit.analyses"

TAKEN = (MOTION, COLUMNS.partition(".")[0])
"""What no analysis is called: the stems of files that every run writes."""


@final
@dataclass(frozen=True)
class Record:
    """An installed analysis: where it comes from, and why it cannot be used if so."""

    name: str
    origin: str
    target: str
    error: str = ""


_added: dict[str, type[AbstractAnalysis]] = {}


@contextmanager
def registered(*classes: type[AbstractAnalysis]) -> Iterator[None]:
    """Make analyses known for the length of a `with` block, for notebooks and tests."""
    names = [cls.name for cls in classes]
    _added.update(zip(names, classes, strict=True))
    try:
        yield
    finally:
        for name in names:
            _added.pop(name, None)


def _entries() -> Mapping[str, list[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        same = found.setdefault(entry.name, [])
        if all(each.value != entry.value for each in same):
            same.append(entry)
    return found


def _origin(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else "unknown distribution"


def names() -> tuple[str, ...]:
    """Return the names of all installed analyses, broken ones too, sorted."""
    return tuple(sorted({*_entries(), *_added}))


def records() -> tuple[Record, ...]:
    """Return every installed analysis, loading each to learn whether it works."""
    found = [Record(name, "this process", cls.__name__) for name, cls in _added.items()]
    for name, entries in _entries().items():
        for entry in entries:
            try:
                load(name)
                error = ""
            except PluginError as problem:
                error = str(problem)
            found.append(Record(name, _origin(entry), entry.value, error))
    return tuple(sorted(found, key=lambda record: (record.name, record.origin)))


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
            f'no analysis is named "{name}"{nearest(name, names()) or "."} Installed: '
            f"{listing(names())}"
        )
    if len(entries) > 1:
        origins = listing(_origin(entry) for entry in entries)
        raise PluginError(
            f"analysis {name}: given by several distributions ({origins}); uninstall "
            "all but one"
        )
    entry = entries[0]
    try:
        cls = entry.load()
    except BaseException as problem:
        if isinstance(problem, KeyboardInterrupt):
            raise
        raise PluginError(
            f"analysis {name} of {_origin(entry)} does not import ({entry.value}): "
            f"{type(problem).__name__}: {problem}"
        ) from problem
    _check(name, _origin(entry), cls)
    return cls  # type: ignore[no-any-return]


def _check(name: str, origin: str, cls: Any) -> None:
    def refuse(why: str) -> None:
        raise PluginError(f"analysis {name} of {origin}: {why}")

    if not (isinstance(cls, type) and issubclass(cls, AbstractAnalysis)):
        refuse(f"{cls!r} is not a subclass of AbstractAnalysis")
    if not NAME_PATTERN.fullmatch(name):
        refuse("its name may hold letters, digits and underscores only")
    for key in ("name", "version", "summary", "tables"):
        if not hasattr(cls, key):
            refuse(f"the class attribute `{key}` is missing")
    if name in TAKEN:
        refuse("its name is that of a file that every run writes")
    if cls.name != name:
        refuse(f"the class calls itself {cls.name!r}")
    if cls.contract != CONTRACT:
        refuse(f"written for contract {cls.contract}, this spherekit has {CONTRACT}")
    if cls.__abstractmethods__:
        refuse(f"methods missing: {listing(sorted(cls.__abstractmethods__))}")


def create(request: str) -> AbstractAnalysis:
    """Return an analysis from ``NAME`` or ``NAME:key=value,key=value``.

    Lists are written ``a+b+c``. Unknown parameters and unreadable values raise
    `AnalysisError` with what is allowed.
    """
    name, _, text = request.partition(":")
    cls = load(name)
    return cls(**given_in(text, cls, name))
