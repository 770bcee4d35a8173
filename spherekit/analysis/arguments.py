"""Fields of a dataclass from text such as ``key=value,key=value``."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, fields
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from spherekit.conventions import listing, nearest
from spherekit.errors import AnalysisError

_SWITCHES = {"true": True, "1": True, "false": False, "0": False}
_WRITTEN = {
    str: "text",
    float: "number",
    int: "integer",
    bool: "true|false",
    NoneType: "none",
}


def parameters(cls: type) -> dict[str, tuple[str, Any]]:
    """Return each parameter's type as text and default (`MISSING` if it has none)."""
    hints = get_type_hints(cls)
    signature: dict[str, tuple[str, Any]] = {}
    for item in fields(cls):
        default = item.default
        if item.default_factory is not MISSING:
            default = item.default_factory()
        signature[item.name] = (_shown(hints[item.name]), default)
    return signature


def _shown(hint: Any) -> str:
    """Return how the values of a type are written."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Literal:
        return "|".join(map(str, inner))
    if origin is tuple:
        if inner[1:] == (...,):
            return f"{_shown(inner[0])}+..."
        return "+".join(map(_shown, inner))
    if origin in (Union, UnionType):
        return " or ".join(map(_shown, inner))
    return _WRITTEN.get(hint, getattr(hint, "__name__", str(hint)))


def given_in(
    text: str, cls: type, name: str, words: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return the fields of a dataclass that a text gives; lists are ``a+b+c``.

    Parameters
    ----------
    text
        ``key=value,key=value``.
    cls, name
        The dataclass, and what it is called in complaints.
    words
        What fields are called in the text, where that is not their name.

    Raises
    ------
    AnalysisError
        For unknown keys, unreadable values and missing fields, with what is allowed.
    """
    words, hints = words or {}, get_type_hints(cls)
    declared = parameters(cls)
    allowed = {words.get(key, key): value for key, value in declared.items()}
    field = {words.get(key, key): key for key in declared}
    given: dict[str, Any] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if key not in allowed or not equals:
            hint = nearest(key, allowed) or "."
            raise AnalysisError(
                f'{name}: "{part}" is not a parameter{hint} Allowed: '
                + (listing(f"{k}={shown}" for k, (shown, _) in allowed.items()) or "none")
            )
        given[field[key]] = _convert(name, key, value, hints[field[key]])
    missing = [
        key
        for key, (_, default) in allowed.items()
        if default is MISSING and field[key] not in given
    ]
    if missing:
        raise AnalysisError(f"{name}: parameters missing: {listing(missing)}")
    return given


def _convert(name: str, key: str, text: str, hint: Any) -> Any:
    try:
        return _read(text, hint)
    except ValueError:
        raise AnalysisError(
            f'{name}: parameter {key}: "{text}" does not read as {_shown(hint)}'
        ) from None


def _read(text: str, hint: Any) -> Any:
    """Return text as a value of a parameter's type, or raise `ValueError`."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint is bool and text.lower() in _SWITCHES:
        return _SWITCHES[text.lower()]
    if hint in (int, float, str):
        return hint(text)
    if hint is NoneType and text.lower() == "none":
        return None
    if origin is Literal:
        for value in inner:
            if str(value) == text:
                return value
    if origin is tuple:
        parts = text.split("+")
        kinds = inner[:1] * len(parts) if inner[1:] == (...,) else inner
        if len(kinds) == len(parts):
            return tuple(_read(part, kind) for part, kind in zip(parts, kinds, strict=True))
    if origin in (Union, UnionType):
        for kind in inner:
            with suppress(ValueError):
                return _read(text, kind)
    raise ValueError(text)
