"""Reads fields of a dataclass from text such as ``key=value,key=value``, or from a file."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from types import NoneType
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from spherekit.conventions import Facts, Names
from spherekit.errors import AnalysisError, SpherekitError
from spherekit.quantity import AngleUnit, QuantityError, field_unit_of, read_quantity
from spherekit.type_descriptions import TypeWording, describe_type, read_value
from spherekit.wording import listing, nearest

BOOLEAN_BY_TEXT = {"true": True, "1": True, "false": False, "0": False}
"""Texts of true and false."""

_TEXT_WORDING = TypeWording(
    {
        str: "text",
        float: "number",
        int: "integer",
        bool: "true|false",
        NoneType: "none",
    },
    lambda choices: "|".join(map(str, choices)),
    "+".join,
    lambda item: f"{item}+{item}+...",
)
"""Words for the types of parameters in text."""


class Parameter(NamedTuple):
    """A parameter of an analysis, as texts show it to users.

    Attributes
    ----------
    type_text
        Type of the parameter as text.
    default
        Default value of the parameter, `dataclasses.MISSING` if it has none.
    unit
        Unit of the default value, empty if the parameter is no angle, rate or time.
    """

    type_text: str
    default: Any
    unit: str = ""

    @property
    def default_text(self) -> str:
        """The default value as text, with its unit."""
        # A default such as None or an empty list is shown without the unit.
        has_unit = self.unit and isinstance(self.default, int | float)
        return f"{self.default:g} {self.unit}" if has_unit else repr(self.default)


def describe_parameters(cls: type) -> dict[str, Parameter]:
    """Return the parameters of a dataclass by their names."""
    hints = get_type_hints(cls, include_extras=True)
    parameters = {}
    for item in fields(cls):
        if not item.init:
            continue  # users cannot give it
        factory = item.default_factory
        default = item.default if factory is MISSING else factory()
        type_text = describe_type(hints[item.name], _TEXT_WORDING)
        unit = field_unit_of(hints[item.name])
        parameters[item.name] = Parameter(type_text, default, unit.text if unit else "")
    return parameters


def read_fields(
    cls: type,
    name: str,
    items: Mapping[str, Any],
    read: Callable[[str, Any, Any], Any],
    make_error: Callable[[Names, str], SpherekitError],
    key_of_field: Mapping[str, str] | None = None,
) -> Facts:
    """Return the values of the fields of a dataclass that a user has given.

    A key is the name of a value in the text of the user. The dataclass is, for example, an
    analysis with its parameters. The user gives values by keys, in a file or on the command
    line.

    Parameters
    ----------
    cls, name
        The dataclass, and its name in messages.
    items
        The given values by key.
    read
        Function of a key, the given value and the type of the field, which returns the
        value of the field.
    make_error
        Function of the faulty key in a tuple (empty if no single key is at fault) and a
        message, which returns the error to raise.
    key_of_field
        For fields with a key in the text that differs from the field name: the key, by
        field name.

    Returns
    -------
    The values by field name. Fields that were not given are left out.

    Raises
    ------
    SpherekitError
        The error of `make_error`, for unknown keys and for missing fields.
    """
    parameters = describe_parameters(cls)
    hints = get_type_hints(cls, include_extras=True)
    field_by_key = {(key_of_field or {}).get(field, field): field for field in parameters}
    values: Facts = {}
    for key, given_value in items.items():
        if key not in field_by_key:
            allowed = listing(
                f"{allowed_key}={parameters[field].type_text}"
                for allowed_key, field in field_by_key.items()
            )
            raise make_error(
                (key,),
                f'"{key}" is not a parameter of {name}{nearest(key, field_by_key) or "."} '
                f"Allowed: {allowed or 'none'}",
            )
        field = field_by_key[key]
        values[field] = read(key, given_value, hints[field])
    # Every field without a default must have been given.
    missing = [
        key
        for key, field in field_by_key.items()
        if parameters[field].default is MISSING and field not in values
    ]
    if missing:
        words = [f'"{key}" ({parameters[field_by_key[key]].type_text})' for key in missing]
        if len(words) == 1:
            raise make_error((), f"the parameter {words[0]} is missing; add it")
        raise make_error((), f"the parameters {listing(words)} are missing; add them")
    return values


def parse_fields(
    text: str,
    cls: type,
    name: str,
    key_of_field: Mapping[str, str] | None = None,
    angle_unit: AngleUnit = "rad",
    readers: Mapping[str, Callable[[str], Any]] | None = None,
) -> Facts:
    """Return the values of fields of a dataclass that a text of the command line gives.

    Parameters
    ----------
    text
        The text, such as ``key=value,key=value``, where a key is the name of a field or
        its key in `key_of_field`. A list is written ``a+b+c``.
    cls, name
        The dataclass, and its name in messages.
    key_of_field
        For fields with a key in the text that differs from the field name: the key, by
        field name.
    angle_unit
        Unit of angles without a unit.
    readers
        Functions that read the text of single fields, by field name, and raise
        `QuantityError`. Other fields are read by their type.

    Returns
    -------
    The values by field name. Fields that were not given are left out.

    Raises
    ------
    AnalysisError
        For unknown and repeated keys, unreadable values and missing fields.
    """

    def make_error(_faulty_keys: Names, message: str) -> AnalysisError:
        """Return an error with a message.

        `read_fields` calls this function with the faulty keys and a message. The message
        names the keys already, so they are not used here.
        """
        return AnalysisError(f"{name}: {message}")

    def split_list(text: str) -> list[str]:
        return text.split("+")

    def read_simple(hint: Any, text: str) -> Any:
        return read_simple_value(hint, text, angle_unit)

    def read(key: str, value: str, hint: Any) -> Any:
        """Return the value of a field from its text; `hint` is the type of the field."""
        read_field = (readers or {}).get(field_of_key.get(key, key))
        try:
            if read_field is not None:
                return read_field(value)
            return read_value(hint, value, read_simple, split_list)
        except QuantityError as problem:
            raise make_error((), f"parameter {key}: {problem}") from None
        except ValueError:
            type_text = describe_type(hint, _TEXT_WORDING)
            raise make_error(
                (), f'parameter {key}: "{value}" does not read as {type_text}'
            ) from None

    field_of_key = {key: field for field, key in (key_of_field or {}).items()}
    items: dict[str, str] = {}
    # Empty parts are ignored.
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals:
            raise make_error((), f'"{part}" is not a parameter; write {part}=VALUE')
        if key in items:
            raise make_error((), f'the parameter "{key}" is given twice; give it once')
        items[key] = value
    return read_fields(cls, name, items, read, make_error, key_of_field)


def read_simple_value(hint: Any, text: str, angle_unit: AngleUnit) -> Any:
    """Convert a text that a user wrote to a value of a simple type.

    Parameters
    ----------
    hint
        The type: bool, int, float, str, None, a choice (`Literal`), or a number with a
        unit, such as `Degrees`.
    text
        The text, such as ``5deg`` or ``none``.
    angle_unit
        The unit of an angle that is written without a unit.

    Raises
    ------
    ValueError
        If the text is no value of this type.
    """
    # A type such as `Degrees` states the kind of the quantity, and in which unit Python
    # uses the number. The result is converted to this unit.
    if (unit := field_unit_of(hint)) is not None:
        return read_quantity(text, unit.dimension, angle_unit, target=unit.angle_unit)
    if hint is bool and text.lower() in BOOLEAN_BY_TEXT:
        return BOOLEAN_BY_TEXT[text.lower()]
    if hint in (int, float, str):
        # For other texts than numbers, int and float raise `ValueError` themselves.
        return hint(text)
    if hint is NoneType and text.lower() == "none":
        return None
    if get_origin(hint) is Literal:
        for value in get_args(hint):
            if str(value) == text:
                return value
    raise ValueError(text)
