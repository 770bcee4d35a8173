"""The analyses that a study names, checked against their plugins."""

import types
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import MISSING
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from spherekit.analysis.arguments import parameters
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.faults import faults_of
from spherekit.analysis.registry import create, load
from spherekit.analysis.unusable import Unusable
from spherekit.conventions import listing, nearest
from spherekit.errors import PluginError, SpherekitError
from spherekit.files.schema import mismatch, shown
from spherekit.model.study import Study

DEFAULT_ANALYSIS = "poles"
_WORDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text in quotes",
}


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
    given = _given(study, cls, values)
    with _located(study, name):
        with faults_of(name, "its constructor"):
            analysis = cls(**given)
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
    path = ("analyses", cls.name)
    allowed, hints = parameters(cls), get_type_hints(cls)
    given = {}
    for key, value in values.items():
        if key not in allowed:
            listed = listing(
                f"{parameter} ({kind})" for parameter, (kind, _) in allowed.items()
            )
            raise study.fault(
                (*path, key),
                f"unknown parameter{nearest(key, allowed) or ';'} allowed for "
                f"{cls.name}: {listed or 'none'}",
            )
        try:
            given[key] = _typed(value, hints[key])
        except TypeError:
            wanted = mismatch(value, _words(hints[key]))
            raise study.fault((*path, key), wanted) from None
    missing = [
        key
        for key, (_, default) in allowed.items()
        if default is MISSING and key not in given
    ]
    if missing:
        raise study.fault(path, f"parameters missing: {listing(missing)}")
    return given


def _typed(value: Any, hint: Any) -> Any:
    """Return a value of a file as a parameter of this type, or raise `TypeError`."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if hint in (bool, int, str) and type(value) is hint:
        return value
    if origin is Literal and value in inner:
        return value
    if origin is tuple and isinstance(value, list):
        if inner[1:] == (...,):
            return tuple(_typed(item, inner[0]) for item in value)
        if len(inner) == len(value):
            pairs = zip(value, inner, strict=True)
            return tuple(_typed(item, part) for item, part in pairs)
    if origin in (Union, types.UnionType):
        for option in inner:
            with suppress(TypeError):
                return _typed(value, option)
    raise TypeError(hint)


def _words(hint: Any) -> str:
    """Return what a file has to hold for a parameter of this type."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        return f"one of {listing(map(shown, inner))}"
    if origin is tuple:
        if inner[1:] == (...,):
            return f"an array [...] with in each place {_words(inner[0])}"
        return f"an array of {len(inner)} values: {listing(map(_words, inner))}"
    if origin in (Union, types.UnionType):
        return " or ".join(
            _words(option) for option in inner if option is not types.NoneType
        )
    return _WORDS.get(hint, f"a value of type {hint}, which no file can give")
