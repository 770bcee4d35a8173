"""The analyses that a study names, checked against their plugins."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from spherekit.analysis.arguments import given
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.faults import faults_of
from spherekit.analysis.registry import create, load
from spherekit.analysis.unusable import Unusable
from spherekit.checked import Style, in_words, read_as
from spherekit.conventions import listing
from spherekit.errors import PluginError, SpherekitError
from spherekit.files.schema import mismatch, shown
from spherekit.model.study import Study

DEFAULT_ANALYSIS = "poles"
_FILE = Style(
    {
        bool: "true or false",
        int: "a whole number",
        float: "a number",
        str: "text in quotes",
        NoneType: "",
    },
    lambda choices: f"one of {listing(map(shown, choices))}",
    lambda items: f"an array of {len(items)} values: {listing(items)}",
    "an array [...] with in each place {}",
)


def analyses_of(study: Study) -> list[AbstractAnalysis]:
    """Return the analyses that a study names, poles by default.

    Raises
    ------
    FileError
        If there is no such analysis or parameter, a value has the wrong type, a
        parameter is missing, or the analysis refuses the mechanism.
    PluginError
        If an analysis that is asked for cannot be used.
    """
    named = study.analyses or {DEFAULT_ANALYSIS: {}}
    return [_named(study, name, values) for name, values in named.items()]


def chosen(
    study: Study, asked: Sequence[str | AbstractAnalysis] = ()
) -> list[AbstractAnalysis]:
    """Return the analyses of a run: those asked for, else those that the study names.

    For one that is broken there is an `Unusable` one, so that the others go on.

    Raises
    ------
    AnalysisError, FileError
        As `create` and `analyses_of`.
    """
    analyses = []
    named = {} if asked else study.analyses or {DEFAULT_ANALYSIS: {}}
    for item in [*asked, *named]:
        if isinstance(item, AbstractAnalysis):
            analyses.append(item)
            continue
        try:
            analyses.append(create(item) if asked else _named(study, item, named[item]))
        except PluginError as fault:
            analyses.append(Unusable(item.partition(":")[0], str(fault)))
    return analyses


def _named(study: Study, name: str, values: Mapping[str, Any]) -> AbstractAnalysis:
    with _located(study, name):
        cls = load(name)
    fields = _given(study, cls, values)
    with _located(study, name):
        with faults_of(name, "its constructor"):
            analysis = cls(**fields)
        declared(analysis, study.mechanism)
    return analysis


@contextmanager
def _located(study: Study, name: str) -> Iterator[None]:
    """Give complaints about an analysis the file and line that ask for it."""
    try:
        yield
    except PluginError:
        raise
    except SpherekitError as problem:
        raise study.fault(("analyses", name), str(problem)) from None


def _given(
    study: Study, cls: type[AbstractAnalysis], values: Mapping[str, Any]
) -> dict[str, Any]:
    def fault(path: tuple[str, ...], message: str) -> SpherekitError:
        return study.fault(("analyses", cls.name, *path), message)

    def read(key: str, value: Any, hint: Any) -> Any:
        try:
            return read_as(hint, value, _one, _items)
        except ValueError:
            raise fault((key,), mismatch(value, in_words(hint, _FILE))) from None

    return given(cls, cls.name, values, read, fault)


def _one(hint: Any, value: Any) -> Any:
    """Return a value of a file as one of a simple type, or raise `ValueError`."""
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if hint in (bool, int, str) and type(value) is hint:
        return value
    if get_origin(hint) is Literal and value in get_args(hint):
        return value
    raise ValueError(value)


def _items(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(value)
    return value
