"""Fields of a dataclass from text such as ``key=value,key=value``, or from a file."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from spherekit.conventions import Facts, Names
from spherekit.errors import AnalysisError, SpherekitError
from spherekit.type_descriptions import TypeWording, describe_type, read_value
from spherekit.wording import listing, nearest

_SWITCHES = {"true": True, "1": True, "false": False, "0": False}
_TEXT = TypeWording(
    {
        str: "text",
        float: "number",
        int: "integer",
        bool: "true|false",
        NoneType: "none",
    },
    lambda choices: "|".join(map(str, choices)),
    "+".join,
    "{}+...",
)


def parameters(cls: type) -> dict[str, tuple[str, Any]]:
    """Return each parameter's type as text and default (`MISSING` if it has none)."""
    hints = get_type_hints(cls)
    return {
        item.name: (
            describe_type(hints[item.name], _TEXT),
            item.default if item.default_factory is MISSING else item.default_factory(),
        )
        for item in fields(cls)
    }


def given(
    cls: type,
    name: str,
    items: Mapping[str, Any],
    read: Callable[[str, Any, Any], Any],
    fault: Callable[[Names, str], SpherekitError],
    words: Mapping[str, str] | None = None,
) -> Facts:
    """Return the fields of a dataclass that items give.

    Parameters
    ----------
    cls, name
        The dataclass, and what it is called in complaints.
    items
        What is given by key.
    read
        Makes the value of a key one of the type that its field has.
    fault
        Makes the error about a key, or about all, in words.
    words
        What fields are called in items, where that is not their name.
    """
    declared = parameters(cls)
    hints = get_type_hints(cls)
    field = {(words or {}).get(key, key): key for key in declared}
    made: Facts = {}
    for key, value in items.items():
        if key not in field:
            allowed = listing(f"{k}={declared[item][0]}" for k, item in field.items())
            raise fault(
                (key,),
                f'"{key}" is not a parameter of {name}{nearest(key, field) or "."} '
                f"Allowed: {allowed or 'none'}",
            )
        made[field[key]] = read(key, value, hints[field[key]])
    missing = [
        key
        for key, item in field.items()
        if declared[item][1] is MISSING and item not in made
    ]
    if missing:
        raise fault((), f"parameters missing: {listing(missing)}")
    return made


def given_in(
    text: str, cls: type, name: str, words: Mapping[str, str] | None = None
) -> Facts:
    """Return the fields of a dataclass that a text gives; lists are ``a+b+c``.

    Raises
    ------
    AnalysisError
        For unknown keys, unreadable values and missing fields, with what is allowed.
    """

    def fault(_: Names, message: str) -> AnalysisError:
        return AnalysisError(f"{name}: {message}")

    def read(key: str, value: str, hint: Any) -> Any:
        try:
            return read_value(hint, value, _one, lambda several: several.split("+"))
        except ValueError:
            raise fault(
                (),
                f'parameter {key}: "{value}" does not read as {describe_type(hint, _TEXT)}',
            ) from None

    items: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        key, equals, items[key] = part.partition("=")
        if not equals:
            raise fault((), f'"{part}" is not a parameter; write {part}=VALUE')
    return given(cls, name, items, read, fault, words)


def _one(hint: Any, text: str) -> Any:
    """Return text as a value of a simple type, or raise `ValueError`."""
    if hint is bool and text.lower() in _SWITCHES:
        return _SWITCHES[text.lower()]
    if hint in (int, float, str):
        return hint(text)
    if hint is NoneType and text.lower() == "none":
        return None
    for value in get_args(hint) if get_origin(hint) is Literal else ():
        if str(value) == text:
            return value
    raise ValueError(text)
