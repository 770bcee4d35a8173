"""Options of public functions that are fields of a study."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields, replace
from typing import Any, TypeVar

from spherekit.conventions import Facts
from spherekit.errors import AnalysisError
from spherekit.files.study import Study
from spherekit.files.study_reader import Subject as Subject
from spherekit.files.study_reader import study_of as of_subject
from spherekit.planning.assembly_plan import driven_at
from spherekit.type_checks import type_fault
from spherekit.wording import choices

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
        if fault := type_fault("input_pair", pairs, str | Sequence[str]):
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
