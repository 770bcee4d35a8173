"""The analyses that a study names, checked against their plugins.

Options of public functions that are fields of a study, or of a second object.

What several analyses need together, and the planned requests behind it.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields, replace
from functools import reduce
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin

from spherekit.analysis.arguments import given
from spherekit.analysis.batch import Needs
from spherekit.analysis.contract import AbstractAnalysis, Analyses, BrokenAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.faults import faults_of
from spherekit.analysis.registry import create, load
from spherekit.argument_validation import Style, fault_of, in_words, read_as
from spherekit.conventions import Facts, Names, choices, listing
from spherekit.errors import AnalysisError, PluginError, SpherekitError
from spherekit.files.schema import mismatch, shown
from spherekit.files.study import Subject as Subject
from spherekit.files.study import study_of as of_subject
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import Study
from spherekit.planning.inputs import driven_at, driven_pairs
from spherekit.rates.request import Request, request

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
            return read_as(hint, value, _one, items)
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


Second = TypeVar("Second")
Function = TypeVar("Function", bound=Callable[..., Any])

GIVEN = ("name", "mechanism", "analyses", "folder", "recording", "locate")
"""Fields of a study that no option changes: its subject or another argument says them."""


def study_of(
    function: str, subject: Subject, options: Facts, second: type[Second]
) -> tuple[Study, Second]:
    """Return a study changed by options, and an object that has the others as fields.

    Parameters
    ----------
    function
        The name of the function that takes them, for complaints.
    subject
        The study, or what it is of.
    options
        Fields of `Study`, of `second`, or `input_pair`, the names of the driven pairs.
        One that both have is the second's.
    second
        The class of the second object; `unused` of it are fields of `Study` that say
        nothing to the function.

    Raises
    ------
    AnalysisError
        For a name that is not an option, with the nearest that is; for a wrong type.
    FileError
        If there is no such file, or it is faulty.
    PlanError, ModelError
        If `input_pair` names no R pair.
    """
    extra = {item.name for item in fields(second)}  # type: ignore[arg-type]
    allowed = _options_of(second)
    for name in options:
        if name not in allowed:
            raise AnalysisError(
                f'{function}: there is no option "{name}"'
                f"{choices(name, sorted(allowed), 'options', len(allowed))}"
            )
    study = of_subject(subject)
    changes = {k: v for k, v in options.items() if k not in extra and k != "input_pair"}
    pairs = options.get("input_pair")
    if "samples" in changes or pairs is not None:
        changes.setdefault("path", None)
    if pairs is not None:
        if fault := fault_of("input_pair", pairs, str | Sequence[str]):
            raise AnalysisError(f"{function}: {fault}")
        changes["mechanism"] = driven_at(study.mechanism, pairs)
    if changes:
        study = replace(study, **changes)
    return study, second(**{k: v for k, v in options.items() if k in extra})


def _options_of(second: type) -> dict[str, inspect.Parameter]:
    """Return the options of `study_of` by name, as parameters of a function."""
    without = {*GIVEN, *getattr(second, "unused", ())}
    items = [item for item in fields(Study) if item.name not in without]
    named: dict[str, tuple[Any, Any]] = {"input_pair": (None, str | Sequence[str] | None)}
    for item in (*items, *fields(second)):
        factory = item.default_factory
        default = item.default if factory is MISSING else factory()
        named[item.name] = default, item.type
    return {
        name: inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint
        )
        for name, (default, hint) in named.items()
    }


def takes(second: type) -> Callable[[Function], Function]:
    """Return a decorator that shows the options of `study_of` in a function's signature."""

    def shown(function: Function) -> Function:
        signature = inspect.signature(function)
        first = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        function.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=[*first, *_options_of(second).values()]
        )
        return function

    return shown


def needs_of(mechanism: Mechanism, analyses: Analyses) -> Needs:
    """Return what several analyses need together; see `declared` for what it raises."""
    return reduce(Needs.union, (declared(x, mechanism) for x in analyses), Needs())


def requests_for(
    mechanism: Mechanism, needs: Needs, by_rank: bool = False
) -> tuple[Request, ...]:
    """Return the planned request behind some needs for each input, moved alone.

    `by_rank` is that of `spherekit.planning.poles.plan`.
    """
    ends = (mechanism.pair(name).links for name in needs.pair_rates)
    links = needs.link_rates.union(*ends)
    numbers = sorted(mechanism.link_number[link] for link in links)
    return tuple(
        request(
            mechanism,
            mechanism.pairs[driven].name,
            sorted(needs.directions),
            sorted(needs.rates | needs.turns),
            needs.derivatives,
            sorted(needs.planes),
            by_rank,
            numbers,
        )
        for driven in driven_pairs(mechanism)
    )
