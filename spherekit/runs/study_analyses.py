"""Creates the analyses that a study names, and checks their parameters."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from spherekit.conventions import Facts, Names
from spherekit.errors import PluginError, SpherekitError
from spherekit.files.schema import mismatch, shown
from spherekit.files.study import Study
from spherekit.quantity import AngleUnit, QuantityError, field_unit_of, read_quantity
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.contract import AbstractAnalysis, BrokenAnalysis
from spherekit.runs.declaration_checks import check_needs, find_class_fault
from spherekit.runs.parameter_text import read_fields
from spherekit.runs.registry import create_analysis, load_analysis
from spherekit.type_descriptions import TypeWording, describe_type, read_value
from spherekit.wording import counted, listing

DEFAULT_ANALYSIS = "poles"
"""The analysis of a study that names none."""


def _array_words(items: Sequence[str]) -> str:
    """Return words for an array with items of certain types, for messages.

    Examples are ``an array of 2 numbers`` and ``an array of 2 values: a number, text in
    quotes``.

    Parameters
    ----------
    items
        Words for the type of each item, such as ``a number``.
    """
    if set(items) == {"a number"}:
        return f"an array of {counted(len(items), 'number')}"
    return f"an array of {counted(len(items), 'value')}: {listing(items)}"


_FILE_WORDING = TypeWording(
    {
        bool: "true or false",
        int: "a whole number",
        float: "a number",
        str: "text in quotes",
        NoneType: "",
    },
    lambda choices: f"one of {listing(map(shown, choices))}",
    _array_words,
    lambda item: f"an array [...] in which each item is {item}",
)
"""Words for the types of parameters in a file."""


def make_study_analyses(study: Study) -> list[AbstractAnalysis]:
    """Return the analyses that a study names in its file.

    A study is a mechanism with the motion to analyse. If it names no analysis, the analysis
    of poles (axes of the relative rotation of two links) is returned.

    Raises
    ------
    FileError
        If there is no such analysis or parameter, a value has the wrong type, a
        parameter is missing, or the analysis refuses the mechanism. The message gives the
        line of the file.
    PluginError
        If an analysis cannot be imported, or is faulty.
    """
    parameters_by_name = study.analyses or {DEFAULT_ANALYSIS: {}}
    return [
        _make_study_analysis(study, name, parameters)
        for name, parameters in parameters_by_name.items()
    ]


def make_run_analyses(
    study: Study, requests: Sequence[str | AbstractAnalysis] = ()
) -> list[AbstractAnalysis]:
    """Return the analyses of a run, as objects.

    If an analysis of a plugin is faulty, a `BrokenAnalysis` takes its place. The other
    analyses are then still computed, and the run reports the reason.

    Parameters
    ----------
    study
        The study, which may name analyses in its file.
    requests
        Analyses that the user asks for: objects, or names with parameters, such as
        ``"poles:only=31+42"``. By default the analyses of the study, or poles if the study
        names none.

    Raises
    ------
    AnalysisError, FileError
        As `create_analysis` and `make_study_analyses`.
    """
    analyses: list[AbstractAnalysis] = []
    if not requests:
        for name, parameters in (study.analyses or {DEFAULT_ANALYSIS: {}}).items():
            try:
                analyses.append(_make_study_analysis(study, name, parameters))
            except PluginError as fault:
                analyses.append(BrokenAnalysis(name, str(fault)))
    for request in requests:
        if isinstance(request, AbstractAnalysis):
            analyses.append(_replace_faulty(request))
            continue
        try:
            analyses.append(create_analysis(request, study.mechanism.angle_unit))
        except PluginError as fault:
            name, _, _ = request.partition(":")
            analyses.append(BrokenAnalysis(name, str(fault)))
    return analyses


def _replace_faulty(analysis: AbstractAnalysis) -> AbstractAnalysis:
    """Return an analysis, or a `BrokenAnalysis` with its name if its class is faulty."""
    cls = type(analysis)
    fault = "" if cls is BrokenAnalysis else find_class_fault(cls)
    if not fault:
        return analysis
    name = str(getattr(analysis, "name", cls.__name__))
    return BrokenAnalysis(name, f"{name}: {fault}")


def _make_study_analysis(
    study: Study, name: str, parameters: Mapping[str, Any]
) -> AbstractAnalysis:
    """Create an analysis that a study names in its file, and check it.

    Parameters
    ----------
    study
        The study, with its mechanism.
    name
        Name of the analysis.
    parameters
        Values of its parameters in the file, by key.
    """
    # Errors in the `with` blocks get the line of the analysis in the file. Errors of
    # `_read_parameters` already have the line of the parameter.
    with _locate_errors(study, name):
        cls = load_analysis(name)
    fields = _read_parameters(study, cls, parameters)
    with _locate_errors(study, name):
        with convert_plugin_errors(name, "its constructor"):
            analysis = cls(**fields)
        check_needs(analysis, study.mechanism)
    return analysis


@contextmanager
def _locate_errors(study: Study, name: str) -> Iterator[None]:
    """Add the file and line that name an analysis to errors about it."""
    try:
        yield
    except PluginError:
        raise
    except SpherekitError as problem:
        raise study.fault(("analyses", name), str(problem)) from None


def _read_parameters(
    study: Study, cls: type[AbstractAnalysis], parameters: Mapping[str, Any]
) -> Facts:
    """Convert the parameters of an analysis in a study's file to fields of its class.

    Parameters
    ----------
    study
        The study, which knows the line of each parameter for error messages.
    cls
        Class of the analysis.
    parameters
        Values of the parameters in the file, by key.

    Returns
    -------
    Values of the fields of `cls`, by name. Fields that the file does not give are left out.
    """

    def make_error(keys: Names, message: str) -> SpherekitError:
        """Return an error that states the line of a faulty parameter, or of the analysis.

        The line is that in the file of the study. `keys` has the key of the faulty
        parameter. It is empty if the error concerns the analysis as a whole.
        """
        return study.fault(("analyses", cls.name, *keys), message)

    def read_parameter(key: str, value: Any, field_type: Any) -> Any:
        """Return a parameter as a field of the class, or raise an error with its line."""
        try:
            return _read_file_value(field_type, value, study.mechanism.angle_unit)
        except QuantityError as problem:  # a number with a wrong unit
            raise make_error((key,), str(problem)) from None
        except ValueError:
            expected = describe_type(field_type, _FILE_WORDING)
            raise make_error((key,), mismatch(value, expected)) from None

    # `read_parameter` is called for each parameter that the class has, and `make_error` for
    # unknown and missing parameters.
    return read_fields(cls, cls.name, parameters, read_parameter, make_error)


def _read_file_value(hint: Any, value: Any, angle_unit: AngleUnit) -> Any:
    """Convert a value of a file to a type, or raise `ValueError` if it is not of this type.

    Parameters
    ----------
    hint
        The type, either simple or composed of simple types, such as ``tuple[float, ...]``.
    value
        The value as it was read. An array of the file was read as a list.
    angle_unit
        The unit of an angle that the file states without a unit.

    Returns
    -------
    The converted value. An array becomes a tuple.
    """

    def read_simple(simple_hint: Any, simple_value: Any) -> Any:
        """Convert a value that is no array, or an item of an array."""
        return _read_simple_value(simple_hint, simple_value, angle_unit)

    return read_value(hint, value, read_simple, _check_array)


def _check_array(value: Any) -> list[Any]:
    """Return the items of an array of the file; raise `ValueError` if it is no array."""
    if not isinstance(value, list):
        raise ValueError(value)
    return value


def _read_simple_value(hint: Any, value: Any, angle_unit: AngleUnit) -> Any:
    """Convert a value of a file to a simple type, or raise `ValueError`.

    Parameters
    ----------
    hint
        The type: a simple one, a choice (`Literal`), or a number with a unit (`Degrees`).
    value
        The value in the file. A number with a unit is a text, such as "5deg".
    angle_unit
        The unit of an angle that the file states without a unit.
    """
    # A type such as `Degrees` states the kind of the quantity, and in which unit Python
    # uses the number. The result is converted to this unit. In Python a bool is also an
    # int, so bools are excluded for each type of number.
    if (unit := field_unit_of(hint)) is not None:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise ValueError(value)
        return read_quantity(value, unit.dimension, angle_unit, target=unit.angle_unit)
    if hint is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if hint in (bool, int, str) and type(value) is hint:
        return value
    if get_origin(hint) is Literal and value in get_args(hint):
        return value
    raise ValueError(value)
