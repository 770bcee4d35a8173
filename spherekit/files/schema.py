"""The schemas of files: what they allow, what they refuse, and what values they name.

A JSON Schema is the one declaration of every key. From it follow the check of a file, with
faults that say what to write instead, and the conversion of angles, rates and directions
between the unit of a file and the radians used inside.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from itertools import islice
from typing import Any, Literal

import numpy as np

from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.errors import FileError
from spherekit.files.toml_document import Document, Table, spelt, values_in
from spherekit.files.toml_lines import KeyPath
from spherekit.wording import choices, counted, listing, nearest

FORMAT = 1
"""The format of mechanism and study files that this version reads and writes."""

Kind = Literal["mechanism", "study", "synthesis"]
_SCHEMAS: Mapping[Kind, str] = {
    "mechanism": f"format_{FORMAT}.schema.json",
    "study": f"study_{FORMAT}.schema.json",
    "synthesis": f"synthesis_{FORMAT}.schema.json",
}

_DEFS = "#/$defs/"
_INTEGER_BITS = 200
_PLAIN = frozenset({"title", "description", "type", "minimum", "maximum"})
_Fault = tuple[KeyPath, str]
_TYPES = {
    "object": "a table",
    "array": "an array [...]",
    "string": "text in quotes",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
}


@cache
def schema(kind: Kind = "mechanism") -> Table:
    """Return the JSON Schema of a kind of file: every key, its limits and unit."""
    resource = files("spherekit.files") / _SCHEMAS[kind]
    declaration: Table = json.loads(resource.read_text(encoding="utf-8"))
    return declaration


def check(document: Document, kind: Kind = "mechanism") -> None:
    """Refuse a document that breaks the format of its kind of file.

    Raises
    ------
    FileError
        With one line for each fault, in the order of the file.
    """
    _check_format(document)
    faults = list(_not_numbers(document.data))
    if not faults:
        errors = validator(kind).iter_errors(document.data)
        explained = (fault for error in errors for fault in _explain(error, kind))
        faults = list(islice(explained, 100))
    if faults:
        raise document.faults(faults)


def check_numbers(document: Document, numbers: Mapping[KeyPath, float]) -> None:
    """Refuse a document that fits the format but for some numbers that it allows not.

    What else the format asks depends on keys, names and kinds, so that only the entries of
    tables are looked at in which these numbers stand.
    """
    entries: dict[str, dict[str, Any]] = {}
    for table, name, *_ in (map(str, path) for path in numbers):
        entries.setdefault(table, {})[name] = document.data[table][name]
    faults = validator().iter_errors(entries)
    if not all(map(math.isfinite, numbers.values())) or any(
        tuple(fault.absolute_path) in numbers for fault in faults
    ):
        check(document)


def shown(value: object) -> str:
    """Return a value as it would stand in a file, cut to a readable length."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table" if value else "an empty table"
    if isinstance(value, int) and value.bit_length() > _INTEGER_BITS:
        return "a huge integer"
    text = repr(value).replace("'", '"')
    if isinstance(value, str):
        letters = json.dumps(value, ensure_ascii=False)
        text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in letters)
    return text if len(text) <= 60 else f"{text[:57]}..."


def mismatch(value: object, wanted: str) -> str:
    """Return the message about a value of another type than wanted."""
    return f"found {shown(value)} ({_kind(value)}), needs {wanted}"


@cache
def validator(kind: Kind = "mechanism") -> Any:
    """Return what holds data against the schema of a kind of file."""
    # jsonschema takes longer to import than a mechanism file takes to read.
    from jsonschema import Draft202012Validator
    from jsonschema.validators import extend

    whole, general = schema(kind), Draft202012Validator.VALIDATORS["items"]

    def items(validator: Any, item: Any, value: Any, part: Any) -> Iterator[Any]:
        limits = whole["$defs"].get(item.get("$ref", "").removeprefix(_DEFS), item)
        low, high = limits.get("minimum", -math.inf), limits.get("maximum", math.inf)
        plain = isinstance(value, list) and limits.get("type") == "number"
        plain = plain and _PLAIN.issuperset(limits)
        # A table of numbers is long, and a validator's call for each is slow.
        if not (plain and all(isinstance(x, float) and low <= x <= high for x in value)):
            yield from general(validator, item, value, part)

    validator = extend(Draft202012Validator, {"items": items})  # type: ignore[no-untyped-call]
    return validator(whole)


Leaves = Mapping[str, Callable[[KeyPath, Any], Any]]
"""What becomes of values, by the name or the type that the schema gives them."""


def walked(data: Table, leaves: Leaves, kind: Kind = "mechanism") -> Any:
    """Return data that fit the format, with what leaves make of values at their paths.

    Arrays become tuples; what the schema leaves free stays as it is.
    """
    whole = schema(kind)

    def of(part: Any, value: Any, path: KeyPath) -> Any:
        name = part.get("$ref", "").removeprefix(_DEFS)
        if name in leaves:
            return leaves[name](path, value)
        part = whole["$defs"].get(name, part)
        if isinstance(value, Mapping):
            for choice in part.get("allOf", ()):
                if "$ref" in choice.get("then", ()) and _holds(choice["if"], value):
                    return of(choice["then"], value, path)
            keys, other = part.get("properties", {}), part.get("additionalProperties")
            if not (keys or other):
                return value
            return {
                key: of(keys.get(key, other), item, (*path, key))
                for key, item in value.items()
            }
        inner = part.get("items")
        if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str):
            return tuple(of(inner, item, (*path, k)) for k, item in enumerate(value))
        if inner and "$ref" in inner and isinstance(value, int | float):
            return of(inner, value, path)  # one where several may stand
        if isinstance(value, bool | str):
            return value
        return float(value) if part.get("type") == "number" else int(value)

    return of(whole, data, ())


def _holds(condition: Table, value: Table) -> bool:
    """Return whether keys have the words of which a condition of the schema consists."""
    needed = condition.get("required", ())
    return all(
        value.get(key, None if key in needed else rule["const"]) == rule["const"]
        for key, rule in condition["properties"].items()
    )


def _check_format(document: Document) -> None:
    if "format" not in document.data:
        raise FileError(
            f"{document.name}:1: format: missing; files start with format = {FORMAT}"
        )
    version = document.data["format"]
    if type(version) is not int or version != FORMAT:
        raise document.fault(
            ("format",),
            f"found {shown(version)}, needs {FORMAT}: this version of spherekit reads "
            f"{FORMAT}; a greater one needs a newer spherekit",
        )


def _not_numbers(data: Table) -> Iterator[_Fault]:
    for path, value in values_in({k: item for k, item in data.items() if k != "user"}):
        if isinstance(value, float) and not math.isfinite(value):
            yield path, f"found {float(value)}, needs a finite number"
        elif isinstance(value, int) and value.bit_length() > _INTEGER_BITS:
            yield path, f"found {shown(value)}, needs a number of ordinary size"


_COUNTED = {"Length": "character", "Items": "value", "Properties": "name"}
"""What rules of the schema count."""


def _explain(error: Any, kind: Kind) -> Iterator[_Fault]:
    """Turn one error of jsonschema into a path and a message of ours."""
    path: KeyPath = tuple(error.absolute_path)
    rule, limit, value = error.validator, error.validator_value, error.instance
    limits = limit if isinstance(limit, list) else [limit]
    bound = "at least" if rule.startswith("min") else "at most"
    if "propertyNames" in error.relative_schema_path:
        yield (*path, value), f"the name {shown(value)} is not allowed; {_NAME_RULE}"
    elif rule == "additionalProperties":
        where = f"in {spelt(path)}" if path else "at the top of the file"
        declared = error.schema["properties"]
        for key in value:
            if key not in declared:
                said = choices(key, declared, f"allowed {where}", 20)
                yield (*path, key), f"unknown key{said}"
    elif rule == "required":
        whole = schema(kind)
        for key in (key for key in limits if key not in value):
            parts = (error.schema, *whole["$defs"].values(), whole)
            declared = (part.get("properties", {}).get(key) for part in parts)
            described = _in_words(next(filter(None, declared), {}))
            yield path, f"the key {key} is missing{described}"
    elif rule == "type":
        types = " or ".join(_TYPES[name] for name in limits)
        yield path, mismatch(value, types) + _in_words(error.schema)
    elif rule in ("enum", "const"):
        hint = nearest(value, limits) if isinstance(value, str) else ""
        words = [shown(choice) if isinstance(choice, bool) else choice for choice in limits]
        yield path, f"found {shown(value)}, allowed: {listing(words)}{hint}"
    elif rule in ("not", "anyOf"):
        yield path, str(error.schema["description"])
    elif rule in ("pattern", "minLength", "maxLength") and "pattern" in error.schema:
        yield path, f"found {shown(value)}; {_NAME_RULE}"
    elif rule[3:] in _COUNTED:
        least, most = (error.schema.get(f"{end}{rule[3:]}") for end in ("min", "max"))
        needs = f"{limit}" if least == most else f"{bound} {limit}"
        has = counted(len(value), _COUNTED[rule[3:]])
        yield path, f"has {has}, needs {needs}{_in_words(error.schema)}"
    elif rule in ("minimum", "maximum"):
        yield path, f"found {shown(value)}, needs {bound} {limit:g}"
    elif rule == "uniqueItems":
        twice = next(item for item in value if value.count(item) > 1)
        yield path, f"{shown(twice)} is given twice; list each once"
    else:
        yield path, str(error.message)[:200]


_NAME_RULE = f"use 1 to {MAX_NAME_LENGTH} letters (A-Z, a-z), digits and underscores"


def _in_words(part: Table) -> str:
    """Return what a part of the schema says of itself, to end a message with."""
    text = str(part.get("description", ""))
    return f": {text[0].lower()}{text[1:].rstrip('.')}" if text else ""


def _kind(value: object) -> str:
    for types, words in (
        (bool, "true or false"),
        (dict, "table"),
        (list, "array"),
        (str, "text"),
        (int | float, "number"),
    ):
        if isinstance(value, types):
            return words
    return "date or time"
