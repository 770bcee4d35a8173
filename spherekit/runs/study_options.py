"""Options of public functions that are fields of a study."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, replace
from typing import Any, TypeVar

from spherekit.arrays import Floats
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError
from spherekit.files.study import Start, Study
from spherekit.files.study_reader import Subject as Subject
from spherekit.files.study_reader import study_of as read_study
from spherekit.mechanism.sizes import angles_in_radians
from spherekit.planning.assembly_plan import driven_at
from spherekit.quantity import AngleUnit
from spherekit.type_checks import type_fault
from spherekit.wording import choices

Options = TypeVar("Options")

Function = TypeVar("Function", bound=Callable[..., Any])

FIELDS_WITHOUT_OPTION = (
    "name",
    "mechanism",
    "analyses",
    "folder",
    "recording",
    "locate",
)
"""Fields of a study that are no options. Other arguments of the functions state them."""


def apply_study_options(
    function: str, subject: Subject, options: Facts, options_class: type[Options]
) -> tuple[Study, Options]:
    """Divide the keyword options of a public function between a study and other options.

    Functions such as `spherekit.run` take the fields of a `Study` (which motion is
    analysed) and the fields of another class (how it is done) as keyword options.

    Parameters
    ----------
    function
        Name of the function with these options, for messages.
    subject
        The study that the options change: an object, a path, or the name of an example. It
        can also be a mechanism.
    options
        Options by name: fields of `Study`, fields of `options_class`, and two more.
        `input_pair` are the names of the driven pairs. `angle_unit` is the unit of `path`
        and of the values in a mapping `start`. A name that is a field of both classes
        belongs to `options_class`.
    options_class
        Dataclass of the options that are not fields of `Study`. Its attribute
        `excluded_study_fields` names the fields of `Study` that are no options of the
        function.

    Returns
    -------
    study
        The study, changed by the options.
    other_options
        An object of `options_class`.

    Raises
    ------
    AnalysisError
        For a name that is not an option; the message suggests the most similar option. Also
        for a wrong type.
    FileError
        If there is no such file, or it is faulty.
    PlanError, ModelError
        If `input_pair` names no R pair (revolute joint).
    """
    class_names = {item.name for item in fields(options_class)}  # type: ignore[arg-type]
    allowed = _list_options(options_class)
    for name in options:
        if name not in allowed:
            raise AnalysisError(
                f'{function}: there is no option "{name}"'
                f"{choices(name, sorted(allowed), 'Options', len(allowed))}"
            )
    study = read_study(subject)
    class_options: Facts = {}
    study_changes: Facts = {}
    for name, value in options.items():
        if name in class_names:
            class_options[name] = value
        elif name not in ("input_pair", "angle_unit"):
            study_changes[name] = value
    input_pairs = options.get("input_pair")
    angle_unit = options.get("angle_unit", "rad")
    if fault := type_fault("angle_unit", angle_unit, AngleUnit):
        raise AnalysisError(f"{function}: {fault}")
    if angle_unit == "deg":
        path = study_changes.get("path")
        if fault := type_fault("path", path, Floats | None):
            raise AnalysisError(f"{function}: {fault}")
        if path is not None:
            study_changes["path"] = angles_in_radians(path, angle_unit)
        if isinstance(study_changes.get("start"), Mapping):
            study_changes["start"] = Start.of(study_changes["start"], angle_unit)
    # A study may list the values of its inputs at its samples (`path`). The list does not
    # fit other samples or inputs.
    if "samples" in study_changes or input_pairs is not None:
        study_changes.setdefault("path", None)
    if input_pairs is not None:
        if fault := type_fault("input_pair", input_pairs, str | Sequence[str]):
            raise AnalysisError(f"{function}: {fault}")
        study_changes["mechanism"] = driven_at(study.mechanism, input_pairs)
    if study_changes:
        study = replace(study, **study_changes)
    return study, options_class(**class_options)


def _list_options(options_class: type) -> dict[str, inspect.Parameter]:
    """Return the keyword options of a public function, with default values and types.

    Such a function takes a study (a mechanism with its motion), and options that replace
    fields of the study. Its options are:

    - most fields of `Study`; the attribute `excluded_study_fields` of `options_class` names
      further fields that are no options,
    - the fields of `options_class`, which belong to this function only,
    - `input_pair`, the names of the driven pairs, which changes the mechanism of the study,
    - `angle_unit`, the unit of the angles that the caller passes.

    Returns
    -------
    The options by name, as parameters that `inspect.signature` can show.
    """
    excluded = {
        *FIELDS_WITHOUT_OPTION,
        *getattr(options_class, "excluded_study_fields", ()),
    }
    study_fields = [item for item in fields(Study) if item.name not in excluded]
    # The default value and the type of each option.
    options: dict[str, tuple[Any, Any]] = {
        "input_pair": (None, str | Sequence[str] | None),
        "angle_unit": ("rad", AngleUnit),
    }
    for item in (*study_fields, *fields(options_class)):
        # A field has a default value, or a function that makes one.
        factory = item.default_factory
        default = item.default if factory is MISSING else factory()
        options[item.name] = (default, item.type)
    return {
        name: inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint
        )
        for name, (default, hint) in options.items()
    }


def takes_study_options(options_class: type) -> Callable[[Function], Function]:
    """Return a decorator that shows the options of a function in its signature.

    The function itself takes them as ``**options``. With the decorator, help texts and
    editors show the name, type and default of each option. The options are the fields of a
    study (a mechanism with its motion), and the fields of `options_class`. `_list_options`
    returns all of them.
    """

    def show_options(function: Function) -> Function:
        """Return the function, with all options in the signature that users see."""
        signature = inspect.signature(function)
        # All parameters but ``**options``.
        parameters = [
            parameter
            for parameter in signature.parameters.values()
            if parameter.kind is not parameter.VAR_KEYWORD
        ]
        function.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=[*parameters, *_list_options(options_class).values()]
        )
        return function

    return show_options
