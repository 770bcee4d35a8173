"""The values of a type in words, for messages and help; and values read as a type."""

import functools
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
from numpy.typing import ArrayLike

from spherekit.quantity import field_unit_of


@dataclass(frozen=True)
class TypeWording:
    """How types are described to one kind of reader: of Python code, a file or a command.

    For example, `int` is "a whole number" in a message about a file.

    Parameters
    ----------
    simple_types
        Words for each simple type, such as ``"a whole number"`` for `int`.
    write_choices
        Returns words for the values of a `Literal`.
    write_items
        Returns words for a tuple, from the words for each of its items.
    write_sequence
        Returns words for a sequence of any length, from the words for an item.
    join_alternatives
        Returns words for a union, from the words for each of its members.
    """

    simple_types: Mapping[Any, str]
    write_choices: Callable[[Iterable[Any]], str]
    write_items: Callable[[Sequence[str]], str]
    write_sequence: Callable[[str], str]
    join_alternatives: Callable[[Iterable[str]], str] = " or ".join


_PLURALS = {
    "a whole number": "whole numbers",
    "a number": "numbers",
    "a string": "strings",
    "a path": "paths",
}
"""Plurals of the words for simple types of Python."""


def _quoted(choice: Any) -> str:
    """Return a value of a `Literal` as it is written in Python, a text in double quotes."""
    return f'"{choice}"' if isinstance(choice, str) else repr(choice)


def _python_sequence(item: str) -> str:
    """Return words for a sequence of Python with items of any number."""
    if item in _PLURALS:
        return f"a sequence of {_PLURALS[item]}"
    return f"a sequence in which each item is {item}"


def _python_alternatives(alternatives: Iterable[str]) -> str:
    """Return words for a union of Python types, such as ``a number, a string or None``.

    Tuples of fixed length and members with long words come last, for clarity. Before the
    last member there is a comma if it is long: ``None, or a mapping (...)``.
    """
    # `sorted` keeps the order of members of the same kind, and False precedes True.
    *first_words, last_words = sorted(
        alternatives, key=lambda words: "tuple" in words or _is_long(words)
    )
    if not first_words:
        return last_words
    comma = "," if _is_long(last_words) else ""
    return f"{', '.join(first_words)}{comma} or {last_words}"


def _is_long(words: str) -> bool:
    """Return whether the words contain a clause about each item, or describe a mapping."""
    return "each item" in words or "mapping" in words


def _python_items(items: Sequence[str]) -> str:
    """Return words for a tuple of fixed length, from the words for each item."""
    if len(items) > 1 and len(set(items)) == 1 and items[0] in _PLURALS:
        return f"a tuple of {len(items)} {_PLURALS[items[0]]}"
    return f"a tuple ({', '.join(items)})"


PYTHON_WORDING = TypeWording(
    simple_types={
        bool: "True or False",
        int: "a whole number",
        float: "a number",
        str: "a string",
        NoneType: "None",
    },
    write_choices=lambda choices: _python_alternatives(map(_quoted, choices)),
    write_items=_python_items,
    write_sequence=_python_sequence,
    join_alternatives=_python_alternatives,
)
"""The wording for arguments of Python functions."""


def describe_type(annotation: Any, wording: TypeWording = PYTHON_WORDING) -> str:
    """Return words for the values of a type, such as ``"a number or None"``.

    Parameters
    ----------
    annotation
        A class or a type of `typing`.
    wording
        The words for simple types, and functions that join words: `write_choices` for the
        values of a `Literal`, `write_items` for the items of a tuple, `write_sequence` for
        a sequence of any length, `join_alternatives` for a union.
    """
    if annotation in (Any, object):
        return "anything"
    origin = get_origin(annotation)
    if origin is Annotated:
        unit = field_unit_of(annotation)
        if unit is not None:
            # A noun has an article, such as "an angle", which is left out here.
            _, _, noun = unit.dimension.noun.partition(" ")
            return noun
        return describe_type(get_args(annotation)[0], wording)
    arguments = get_args(annotation)
    if annotation is ArrayLike or origin is np.ndarray:
        return f"an array of {'strings' if is_text_array(annotation) else 'real numbers'}"
    if annotation in wording.simple_types:
        return wording.simple_types[annotation]
    if origin is Literal:
        return wording.write_choices(arguments)
    if origin is Callable:
        return "a function"

    # The types of the members of a union or of the items of a container. The three dots of
    # `tuple[int, ...]` are no type.
    descriptions = [
        describe_type(member, wording)
        for member in union_members(arguments)
        if member is not ...
    ]
    if origin in (Union, UnionType):
        # Equal words are written once. None has the empty text in the wording of files,
        # where it is a key that is missing. Empty texts are left out.
        distinct_descriptions = dict.fromkeys(filter(None, descriptions))
        return wording.join_alternatives(distinct_descriptions)
    if origin is tuple and arguments[1:] != (...,):
        return wording.write_items(descriptions)
    if origin in (Sequence, Iterable, tuple):
        return wording.write_sequence(descriptions[0])
    if origin in (Mapping, dict):
        key_words, value_words = descriptions
        if value_words == "anything":
            return "a dict"
        return f"a mapping (keys: {key_words}; values: {value_words})"
    if origin in (list, set, frozenset):
        return f"a {origin.__name__} in which each item is {descriptions[0]}"
    if origin is type:
        return f"a class, {descriptions[0]} or one that extends it"
    if origin is os.PathLike:
        return "a path"
    class_name = str(getattr(origin or annotation, "__name__", annotation))
    article = "an" if class_name[0] in "AEIOU" else "a"
    return f"{article} {class_name}"


def read_value(
    annotation: Any,
    source: Any,
    read_simple_value: Callable[[Any, Any], Any],
    split_items: Callable[[Any], Sequence[Any]],
) -> Any:
    """Read a value of a stated type from a text of a command or a value in a file.

    The members of a union are tried in order, and the first that can be read is returned.
    The two functions know how the source writes values.

    Parameters
    ----------
    annotation
        The type: a simple one, a choice, a union or a tuple of these.
    source
        The text of the command, or the value in the file.
    read_simple_value
        Called with a type that is neither a union nor a tuple, and its source. It returns
        the value.
    split_items
        Called with the source of a tuple; returns the sources of its items.

    Raises
    ------
    ValueError
        If the source cannot be read as this type. The two functions raise it as well.
    """
    origin = get_origin(annotation)
    arguments = get_args(annotation)
    if origin in (Union, UnionType):
        for member in arguments:
            with suppress(ValueError):
                return read_value(member, source, read_simple_value, split_items)
        raise ValueError(source)
    if origin is not tuple:
        return read_simple_value(annotation, source)
    items = split_items(source)
    has_any_length = arguments[1:] == (...,)
    item_types = arguments[:1] * len(items) if has_any_length else arguments
    return tuple(
        read_value(item_type, item, read_simple_value, split_items)
        for item_type, item in zip(item_types, items, strict=True)
    )


@functools.cache
def union_members(members: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the members of a union, with the members of `ArrayLike` as that one type.

    `ArrayLike` is a union itself, and Python merges nested unions. Messages should name it
    as one type, not list its many members.
    """
    array_like_members = get_args(ArrayLike)
    if not set(array_like_members) <= set(members):
        return members
    return (ArrayLike, *(member for member in members if member not in array_like_members))


@functools.cache
def is_text_array(annotation: Any) -> bool:
    """Return whether a type stands for arrays of texts."""
    return annotation is not ArrayLike and "str" in str(annotation)
