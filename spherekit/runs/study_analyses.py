"""The analyses that a study names, checked against their plugins."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from spherekit.conventions import Facts, Names
from spherekit.errors import PluginError, SpherekitError
from spherekit.files.schema import mismatch, shown
from spherekit.files.study import Study
from spherekit.runs.analysis_faults import faults_of
from spherekit.runs.contract import AbstractAnalysis, BrokenAnalysis
from spherekit.runs.declaration_checks import declared
from spherekit.runs.parameter_text import given
from spherekit.runs.registry import create, load
from spherekit.type_descriptions import TypeWording, describe_type, read_value
from spherekit.wording import listing

DEFAULT_ANALYSIS = "poles"
_FILE = TypeWording(
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
    return [
        _named(study, name, values)
        for name, values in (study.analyses or {DEFAULT_ANALYSIS: {}}).items()
    ]


def chosen(
    study: Study, asked: Sequence[str | AbstractAnalysis] = ()
) -> list[AbstractAnalysis]:
    """Return the analyses of a run: those asked for, else those that the study names.

    For one that is broken there is an `BrokenAnalysis` one, so that the others go on.

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
            analyses.append(BrokenAnalysis(item.partition(":")[0], str(fault)))
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


def _given(study: Study, cls: type[AbstractAnalysis], values: Mapping[str, Any]) -> Facts:
    def fault(path: Names, message: str) -> SpherekitError:
        return study.fault(("analyses", cls.name, *path), message)

    def read(key: str, value: Any, hint: Any) -> Any:
        def items(value: Any) -> list[Any]:
            if not isinstance(value, list):
                raise ValueError(value)
            return value

        try:
            return read_value(hint, value, _one, items)
        except ValueError:
            raise fault((key,), mismatch(value, describe_type(hint, _FILE))) from None

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
