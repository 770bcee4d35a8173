"""Options of public functions that are fields of a study, or of a second object."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, replace
from typing import Any, TypeVar

from spherekit.conventions import listing, nearest
from spherekit.errors import AnalysisError
from spherekit.files.study import Subject as Subject
from spherekit.files.study import study_of as of_subject
from spherekit.model.study import Study
from spherekit.planning.inputs import driven_at

Second = TypeVar("Second")
Function = TypeVar("Function", bound=Callable[..., Any])

GIVEN = ("name", "mechanism", "analyses", "folder", "recording", "locate")
"""Fields of a study that no option changes: its subject or another argument says them."""


def study_of(
    function: str, subject: Subject, options: Mapping[str, Any], second: type[Second]
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
    allowed = {"input_pair", *_of_study(second), *extra}
    for name in options:
        if name not in allowed:
            raise AnalysisError(
                f'{function}: there is no option "{name}"{nearest(name, allowed) or ";"} '
                f"options: {listing(sorted(allowed), len(allowed))}"
            )
    study = of_subject(subject)
    changes = {k: v for k, v in options.items() if k not in extra and k != "input_pair"}
    pairs = options.get("input_pair")
    if "samples" in changes or pairs is not None:
        changes.setdefault("path", None)
    if pairs is not None:
        named = isinstance(pairs, str | Sequence) and all(isinstance(p, str) for p in pairs)
        if not named:
            raise AnalysisError(
                f"{function}: input_pair is {pairs!r}, it has to be the name of a pair, or "
                "a sequence of names"
            )
        changes["mechanism"] = driven_at(study.mechanism, pairs)
    if changes:
        study = replace(study, **changes)
    return study, second(**{k: v for k, v in options.items() if k in extra})


def _of_study(second: type) -> list[str]:
    """Return the fields of a study that are options beside those of a second object."""
    without = {*GIVEN, *getattr(second, "unused", ())}
    return [item.name for item in fields(Study) if item.name not in without]


def takes(second: type) -> Callable[[Function], Function]:
    """Return a decorator that shows the options of `study_of` in a function's signature."""

    def shown(function: Function) -> Function:
        signature = inspect.signature(function)
        options = [item for item in fields(Study) if item.name in _of_study(second)]
        first = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        named = [_keyword("input_pair", str | Sequence[str] | None, None)]
        for item in (*options, *fields(second)):
            factory = item.default_factory
            default = item.default if factory is MISSING else factory()
            named.append(_keyword(item.name, item.type, default))
        function.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=[*first, *named]
        )
        return function

    return shown


def _keyword(name: str, hint: Any, default: Any) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=hint)
