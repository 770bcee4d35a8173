"""Arguments of public functions against the types that their signatures state."""

import contextlib
import functools
import inspect
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from types import NoneType, UnionType
from typing import (
    Any,
    Literal,
    NamedTuple,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array
from spherekit.errors import SpherekitError
from spherekit.wording import choices, listing, nearest

P = ParamSpec("P")
R = TypeVar("R")
Class = TypeVar("Class")

NUMBERS = "biuf"
"""Kinds of NumPy's types that arrays of numbers have: truth values, integers, floats."""

_MARK = "_judges_arguments"
_SIMPLE: Mapping[Any, tuple[tuple[type, ...], str]] = {
    bool: ((bool, np.bool_), "True or False"),
    int: ((int, np.integer), "a whole number"),
    float: ((int, float, np.integer, np.floating), "a number"),
    str: ((str,), "text"),
    NoneType: ((NoneType,), "None"),
}


_UNIONS = (Union, UnionType)
_HOLDERS: Mapping[Any, Any] = {
    tuple: (tuple, list, np.ndarray),
    Sequence: (Sequence, np.ndarray),
    **{kind: kind for kind in (Iterable, Mapping, dict, list, set, frozenset)},
}
"""What holds items where a type says so."""


def checked(error: type[SpherekitError]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that refuses arguments which a function's types do not allow.

    The function then raises this error, with its name, the argument, what was found and
    what is allowed. Types that cannot be judged pass.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(function)

        @functools.cache
        def hints() -> dict[str, Any]:
            return {
                name: _resolved(function, parameter.annotation)
                for name, parameter in signature.parameters.items()
            }

        @functools.wraps(function)
        def _judged(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                given = signature.bind(*args, **kwargs).arguments
            except TypeError as fault:
                words = _unbound(signature, kwargs, fault)
                raise error(f"{_called(function)}: {words}") from None
            for name, value in given.items():
                kind = signature.parameters[name].kind
                several = kind is inspect.Parameter.VAR_POSITIONAL
                for item in value if several else (value,):
                    if complaint := fault_of(name, item, hints()[name]):
                        raise error(f"{_called(function)}: {complaint}")
            return function(*args, **kwargs)

        return marked(_judged)

    return decorate


def marked(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function, marked as one that judges what it is called with."""
    vars(function)[_MARK] = True
    return function


def judges(function: object) -> bool:
    """Return whether a function judges what it is called with."""
    return hasattr(function, _MARK)


def checked_class(
    error: type[SpherekitError], *methods: str
) -> Callable[[type[Class]], type[Class]]:
    """Return a decorator that checks what a class, and methods of it, are called with."""

    def decorate(made: type[Class]) -> type[Class]:
        for name in ("__init__", *methods):
            setattr(made, name, checked(error)(getattr(made, name)))
        return made

    return decorate


def _called(function: Callable[..., Any]) -> str:
    """Return the name by which users call a function: of a class, that of the class."""
    *_, owner, name = ("", *function.__qualname__.split("."))
    return owner if name == "__init__" else name.strip("_")


def _unbound(signature: inspect.Signature, named: Iterable[str], fault: TypeError) -> str:
    """Return in words why arguments do not fit a signature."""
    kinds = {item.kind for item in signature.parameters.values()}
    parameters = [name for name in signature.parameters if name != "self"]
    others = [name for name in named if name not in parameters]
    if others and inspect.Parameter.VAR_KEYWORD not in kinds:
        said = choices(others[0], parameters, "Arguments", 30)
        return f'no argument is "{others[0]}"{said}'
    return f"{fault}. Arguments: {listing(parameters, 30)}"


def check_fields(made: object, error: type[SpherekitError], where: str) -> None:
    """Raise an error unless every field of a dataclass has a value of its type."""
    kind: Any = type(made)
    for name, hint in _hints_of(kind).items():
        if fault := fault_of(name, getattr(made, name), hint):
            raise error(f"{where}: {fault}")


_hints_of = functools.cache(get_type_hints)


def _resolved(function: Callable[..., Any], hint: Any) -> Any:
    """Return the type that an annotation says; of one that is nowhere, any."""
    if hint is inspect.Parameter.empty:
        return Any
    holder = type("_Holder", (), {"__annotations__": {"hint": hint}})
    names = inspect.unwrap(function).__globals__
    with contextlib.suppress(NameError):
        return get_type_hints(holder, names)["hint"]
    return Any


def fault_of(name: str, value: Any, hint: Any) -> str:
    """Return what is wrong with a value for a type, or nothing."""
    if _fits(value, hint):
        return ""
    allowed = _choices(hint)
    if allowed and isinstance(value, str):
        hint_of = nearest(value, allowed) or ";"
        words = listing(f'"{word}"' for word in allowed)
        return f'{name} "{value}" is not known{hint_of} allowed: {words}'
    shown = repr(value)
    words = in_words(hint)
    shown = shown if len(shown) <= 60 else f"{shown[:57]}..."
    if isinstance(value, str | os.PathLike) and "Mechanism" in words:
        words += "; spherekit.load reads it by its name or path"
    return f"{name} is {shown} ({type(value).__name__}), it has to be {words}"


def _choices(hint: Any) -> list[str]:
    """Return the words that a type allows, if it allows no other text."""
    if get_origin(hint) is Literal:
        return [word for word in get_args(hint) if isinstance(word, str)]
    if get_origin(hint) in _UNIONS:
        inner = get_args(hint)
        return [] if str in inner else [word for part in inner for word in _choices(part)]
    return []


def _fits(value: Any, hint: Any) -> bool:
    """Return whether a value is one of a type, as far as that can be judged."""
    if hint is Any:
        return True
    if isinstance(value, np.ndarray) and value.dtype == object and hint == Array:
        return True  # numbers of another arithmetic
    if hint is ArrayLike or get_origin(hint) is np.ndarray:
        with contextlib.suppress(TypeError, ValueError):
            return np.asarray(value).dtype.kind in ("U" if _is_text(hint) else NUMBERS)
        return False
    if hint in _SIMPLE:
        types, _ = _SIMPLE[hint]
        of_truth = isinstance(value, bool | np.bool_)
        return isinstance(value, types) and of_truth == (hint is bool)
    origin = get_origin(hint)
    inner = get_args(hint)
    if origin is Literal:
        return any(type(value) is type(choice) and value == choice for choice in inner)
    if origin in _UNIONS:
        return any(_fits(value, part) for part in _parts(inner))
    if origin in _HOLDERS:
        if isinstance(value, str | bytes) or not isinstance(value, _HOLDERS[origin]):
            return False
        if origin is tuple and inner[1:] != (...,):
            return len(value) == len(inner) and all(map(_fits, value, inner))
        if isinstance(value, Mapping):
            return all(all(map(_fits, item, inner)) for item in value.items())
        several = isinstance(value, Collection | np.ndarray)
        return not several or all(_fits(item, inner[0]) for item in value)
    if origin is type:
        return inspect.isclass(value) and (inner[0] is Any or issubclass(value, inner[0]))
    kind = origin or hint
    if getattr(kind, "_is_protocol", False):
        # Stand-ins need not have all of it; what has nothing of it is something else.
        attributes = {*dir(type(value)), *getattr(value, "__dict__", ())}
        asked = {name for name in dir(kind) if not name.startswith("_")}
        return "__getattr__" in attributes or not attributes.isdisjoint(asked)
    return isinstance(value, kind) if isinstance(kind, type) else True


@functools.cache
def _parts(inner: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the parts of a union, with `ArrayLike`, a union itself, as one."""
    numbers = get_args(ArrayLike)
    if not set(numbers) <= set(inner):
        return inner
    return (ArrayLike, *(part for part in inner if part not in numbers))


@functools.cache
def _is_text(hint: Any) -> bool:
    return hint is not ArrayLike and "str" in str(hint)


class Style(NamedTuple):
    """How types are said: simple ones, a choice of words, items one by one, and many."""

    simple: Mapping[Any, str]
    choice: Callable[[Iterable[Any]], str]
    items: Callable[[Sequence[str]], str]
    many: str


_PYTHON = Style(
    {kind: words for kind, (_, words) in _SIMPLE.items()},
    lambda choices: f"one of {listing(choices)}",
    lambda items: f"({', '.join(items)})",
    "a sequence, each {}",
)


def in_words(hint: Any, style: Style = _PYTHON) -> str:
    """Return what values of a type are, in words."""
    if hint in (Any, object):
        return "anything"
    if hint is ArrayLike or get_origin(hint) is np.ndarray:
        return "texts" if _is_text(hint) else "numbers"
    if hint in style.simple:
        return style.simple[hint]
    origin = get_origin(hint)
    inner = get_args(hint)
    if origin is Literal:
        return style.choice(inner)
    if origin is Callable:
        return "a function"
    said = [in_words(part, style) for part in _parts(inner) if part is not ...]
    if origin in _UNIONS:
        return " or ".join(dict.fromkeys(filter(None, said)))
    if origin is tuple and inner[1:] != (...,):
        return style.items(said)
    if origin in (Sequence, Iterable, tuple):
        return style.many.format(*said)
    if origin in (Mapping, dict):
        return f"a mapping of {' to '.join(said)}"
    if origin in (list, set, frozenset):
        return f"a {origin.__name__}, each {said[0]}"
    if origin is type:
        return f"a class, {said[0]} or one that extends it"
    if origin is os.PathLike:
        return "a path"
    return str(getattr(origin or hint, "__name__", hint))


def read_as(hint: Any, value: Any, one: Callable[[Any, Any], Any], parts: Any) -> Any:
    """Return what is given as a value of a type.

    `one` reads a value as a simple type or a choice, `parts` gives the items of several;
    both raise `ValueError`, as this does, where that is not possible.
    """
    origin = get_origin(hint)
    inner = get_args(hint)
    if origin in _UNIONS:
        for kind in inner:
            with contextlib.suppress(ValueError):
                return read_as(kind, value, one, parts)
        raise ValueError(value)
    if origin is not tuple:
        return one(hint, value)
    items = parts(value)
    kinds = inner[:1] * len(items) if inner[1:] == (...,) else inner
    return tuple(
        read_as(kind, item, one, parts) for kind, item in zip(kinds, items, strict=True)
    )
