"""Whether a value has the type that an annotation states.

`type_fault` returns a message for a value of another type. Numbers of NumPy count as
numbers of Python, and arrays as sequences. An annotation of a kind that is not listed here
allows every value.
"""

import contextlib
import functools
import inspect
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array
from spherekit.type_descriptions import describe_type, is_text_array, union_members
from spherekit.wording import listing, nearest

NUMERIC_KINDS = "biuf"
"""Kinds (``dtype.kind``) of numeric arrays: truth values, integers and floats."""

MAX_SHOWN_CHARACTERS = 60
"""Longest value that a message shows in full."""

SIMPLE_TYPES: Mapping[Any, tuple[type, ...]] = {
    bool: (bool, np.bool_),
    int: (int, np.integer),
    float: (int, float, np.integer, np.floating),
    str: (str,),
    NoneType: (NoneType,),
}
"""The classes whose objects count as values of a simple type."""

CONTAINER_TYPES: Mapping[Any, Any] = {
    tuple: (tuple, list, np.ndarray),
    Sequence: (Sequence, np.ndarray),
    Iterable: Iterable,
    Mapping: Mapping,
    dict: dict,
    list: list,
    set: set,
    frozenset: frozenset,
}
"""The classes whose objects count as containers of a type."""


def type_fault(name: str, value: Any, annotation: Any) -> str:
    """Return a message if a value does not have the type that is expected, else "".

    Parameters
    ----------
    name
        Name of the argument or field, for the message.
    value
        Its value.
    annotation
        The expected type: a class or a type of `typing`, but not an annotation in quotes.
    """
    if has_type(value, annotation):
        return ""
    allowed_words = _literal_words(annotation)
    if allowed_words and isinstance(value, str):
        # `nearest` returns '; did you mean "x"?' if an allowed word is similar.
        hint = nearest(value, allowed_words) or "."
        words = listing(f'"{word}"' for word in allowed_words)
        return f'{name}: found "{_shortened(value)}"{hint} Allowed: {words}'

    shown_value = repr(value)
    if len(shown_value) > MAX_SHOWN_CHARACTERS and shown_value.startswith("<"):
        shown_value = "an object"  # part of a text such as "<Mechanism ...>" says little
    shown_value = _shortened(shown_value)
    allowed = describe_type(annotation)
    if isinstance(value, str | os.PathLike) and "Mechanism" in allowed:
        allowed += "; spherekit.load reads it by its name or path"
    hints = "".join(f". {hint}" for hint in _argument_hints(annotation))
    return (
        f"{name} is {shown_value} ({type(value).__name__}); it has to be {allowed}{hints}"
    )


def _shortened(text: str) -> str:
    """Return a text that is cut, and ends with "...", if it is too long for a message."""
    is_short = len(text) <= MAX_SHOWN_CHARACTERS
    return text if is_short else f"{text[: MAX_SHOWN_CHARACTERS - 3]}..."


def has_type(value: Any, annotation: Any) -> bool:
    """Return whether a value has the type of an annotation, as far as this can be decided.

    Kinds of types are tried in turn: any value, arrays, simple types such as `int`, choices
    (`Literal`), unions, containers with their items, classes and protocols. For an
    annotation of another kind the result is true.

    Parameters
    ----------
    value
        The value.
    annotation
        A class or a type of `typing`, but not `Annotated`.
    """
    if annotation is Any:
        return True
    # An `Array` may contain Python objects that represent numbers, such as intervals with
    # error bounds, or numbers of quad precision.
    if _is_object_array(value) and annotation == Array:
        return True
    # Other arrays contain numbers of NumPy, or texts if the annotation names `str`.
    if annotation is ArrayLike or get_origin(annotation) is np.ndarray:
        return _is_array_like(value, is_text_array(annotation))
    if annotation in SIMPLE_TYPES:
        # In Python True is an integer. Used as a number, True is nearly always a mistake.
        is_truth_value = isinstance(value, bool | np.bool_)
        return isinstance(value, SIMPLE_TYPES[annotation]) and (
            is_truth_value == (annotation is bool)
        )

    origin = get_origin(annotation)
    arguments = get_args(annotation)
    if origin is Literal:
        return any(
            has_type(value, type(choice)) and value == choice for choice in arguments
        )
    if origin in (Union, UnionType):
        return any(has_type(value, member) for member in union_members(arguments))
    if origin in CONTAINER_TYPES:
        return _is_container(value, origin, arguments)
    if origin is type:
        (base_class,) = arguments
        return inspect.isclass(value) and (
            base_class is Any or issubclass(value, base_class)
        )
    # Here `origin` is the class of a generic type, for example `Foo` for `Foo[int]`.
    cls = origin or annotation
    if getattr(cls, "_is_protocol", False):
        return _may_implement(value, cls)
    return isinstance(value, cls) if isinstance(cls, type) else True


def _is_object_array(value: Any) -> bool:
    """Return whether a value is an array of Python objects."""
    return isinstance(value, np.ndarray) and value.dtype == object


def _is_array_like(value: Any, of_texts: bool) -> bool:
    """Return whether NumPy makes an array of numbers, or of texts, from a value."""
    with contextlib.suppress(TypeError, ValueError):
        return np.asarray(value).dtype.kind in ("U" if of_texts else NUMERIC_KINDS)
    return False


def _is_container(value: Any, origin: Any, item_types: tuple[Any, ...]) -> bool:
    """Return whether a value is a container whose items have the stated types.

    Items of an iterator are not checked, since reading would use them up.

    Parameters
    ----------
    value
        The value. A text does not count as a container, nor does an array without
        dimensions.
    origin
        The type of the container, such as `tuple` or `Mapping`.
    item_types
        The types of the items. A tuple of fixed length has one type for each item, and a
        mapping has the types of its keys and of its values. Other containers have a single
        type for all items.
    """
    if isinstance(value, str | bytes) or not isinstance(value, CONTAINER_TYPES[origin]):
        return False
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return False
    if origin is tuple and item_types[1:] != (...,):  # of fixed length
        return len(value) == len(item_types) and all(map(has_type, value, item_types))
    if isinstance(value, Mapping):
        return all(all(map(has_type, item, item_types)) for item in value.items())
    if isinstance(value, Collection | np.ndarray):
        return all(has_type(item, item_types[0]) for item in value)
    return True


def _may_implement(value: Any, protocol: Any) -> bool:
    """Return whether a value has any public attribute of a protocol (`typing.Protocol`).

    A value counts as an implementation of the protocol even if it lacks some attributes,
    because an object that replaces it in tests need not have all of them.
    """
    attributes = {*dir(type(value)), *getattr(value, "__dict__", ())}
    protocol_names = {name for name in dir(protocol) if not name.startswith("_")}
    # An object with `__getattr__` can have any attribute.
    return "__getattr__" in attributes or not attributes.isdisjoint(protocol_names)


@functools.cache
def _argument_hints(annotation: Any) -> list[str]:
    """Return hints on how to write a value of a type, for messages.

    A class can have a hint: a sentence in its attribute `argument_hint`. The members of a
    union can each have one.
    """
    is_union = get_origin(annotation) in (Union, UnionType)
    members = union_members(get_args(annotation)) if is_union else (annotation,)
    return [cls.argument_hint for cls in members if hasattr(cls, "argument_hint")]


@functools.cache
def _literal_words(annotation: Any) -> list[str]:
    """Return the texts that a type allows; the list is empty if it allows any or none."""
    arguments = get_args(annotation)
    if get_origin(annotation) is Literal:
        return [word for word in arguments if isinstance(word, str)]
    if get_origin(annotation) in (Union, UnionType) and str not in arguments:
        words: list[str] = []
        for member in arguments:
            words += _literal_words(member)
        return words
    return []
