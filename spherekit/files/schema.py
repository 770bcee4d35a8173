"""The JSON Schemas of files: checks of data, messages about faults, conversion of values.

A JSON Schema is the one declaration of every key. `check` compares a file with it and
explains every fault. `convert_values` finds angles, rates and directions by their names in
the schema.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, time
from functools import cache
from importlib.resources import files
from itertools import islice
from typing import Any, Literal

import numpy as np

from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.errors import FileError
from spherekit.files.toml_document import Document, Table, key_path_text, values_in
from spherekit.files.toml_lines import KeyPath
from spherekit.wording import choices, counted, listing, nearest

FORMAT = 1
"""The format of mechanism and study files that this version reads and writes."""

Kind = Literal["mechanism", "study", "synthesis"]
"""The kinds of files that have a schema."""

MAX_INTEGER_BITS = 200
"""Larger integers are refused; their digits would make messages far too long."""

MAX_SHOWN_CHARACTERS = 60
"""Longest value of a file that a message shows in full."""

MAX_EXPLAINED_FAULTS = 100
"""Number of faults after which a file is not checked further."""

_SCHEMA_FILES: Mapping[Kind, str] = {
    "mechanism": f"format_{FORMAT}.schema.json",
    "study": f"study_{FORMAT}.schema.json",
    "synthesis": f"synthesis_{FORMAT}.schema.json",
}

_DEFINITIONS = "#/$defs/"
"""Beginning of a reference to a named part of a schema."""

_NUMBER_RULES = frozenset(
    {"title", "description", "type", "minimum", "maximum", "maxLength"}
)
"""The rules that the quick check of arrays of numbers understands."""

_TYPE_WORDS = {
    "object": "a table",
    "array": "an array [...]",
    "string": "text in quotes",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
}

_COUNTED_WORDS = {"Length": "character", "Items": "value", "Properties": "name"}
"""What the rules ``minLength``, ``maxItems``, ... count."""

_NAME_RULE = f"use 1 to {MAX_NAME_LENGTH} letters (A-Z, a-z), digits and underscores"

_Fault = tuple[KeyPath, str]
"""The path of a faulty key, and the message about it."""

Converter = Callable[[KeyPath, Any], Any]
"""Returns what a value becomes, from its path and the value."""

Converters = Mapping[str, Converter]
"""The converter of each named part of a schema, such as ``"angle"``."""


@cache
def schema(kind: Kind = "mechanism") -> Table:
    """Return the JSON Schema of a kind of file: every key, its limits and unit."""
    resource = files("spherekit.files") / _SCHEMA_FILES[kind]
    declaration: Table = json.loads(resource.read_text(encoding="utf-8"))
    return declaration


def check(document: Document, kind: Kind = "mechanism") -> None:
    """Raise an error unless a document fits the format of its kind of file.

    A JSON Schema has the rules of the format, for each kind of file.

    Raises
    ------
    FileError
        If the document has faults. The message has one line for each fault, in the order of
        the file.
    """
    _check_format_version(document)
    # Infinite, NaN or huge numbers are reported alone, because the rules of the schema
    # cannot compare them.
    faults = list(_unusable_numbers(document.data))
    if not faults:
        errors = validator(kind).iter_errors(document.data)
        explained = (fault for error in errors for fault in _explain_error(error, kind))
        faults = list(islice(explained, MAX_EXPLAINED_FAULTS))
    if faults:
        raise document.faults(faults)


def check_numbers(document: Document, numbers: Mapping[KeyPath, float]) -> None:
    """Raise `FileError` if numbers that were changed do not fit the format.

    The document was valid before the change, so only rules about numbers can be broken. To
    save time, only the parts with new numbers are checked, such as one link.

    Parameters
    ----------
    document
        The document with the new numbers.
    numbers
        The new numbers by their locations: table, name of the element in it, key, and so
        on.
    """
    # The changed elements, by table and name.
    entries: dict[str, dict[str, Any]] = {}
    for path in numbers:
        table, name, *_ = map(str, path)
        entries.setdefault(table, {})[name] = document.data[table][name]
    are_finite = all(math.isfinite(number) for number in numbers.values())
    # Only errors at the changed numbers count, because `entries` lacks the rest of the
    # document.
    errors = validator().iter_errors(entries)
    has_error = any(tuple(error.absolute_path) in numbers for error in errors)
    if not are_finite or has_error:
        # The check of the whole document raises the error.
        check(document)


def shown(value: object) -> str:
    """Return a value of a file for a message: as TOML text, cut to a readable length.

    Tables and huge integers appear as words only. Characters that cannot be printed are
    escaped.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table" if value else "an empty table"
    if isinstance(value, int) and value.bit_length() > MAX_INTEGER_BITS:
        return "a huge integer"
    if isinstance(value, list | tuple):
        text = f"[{', '.join(map(shown, value))}]"
    elif isinstance(value, date | time):
        text = value.isoformat()
    elif isinstance(value, str):
        quoted_text = json.dumps(value, ensure_ascii=False)
        # `ascii` returns the escape sequence of a character, such as "\x07", in quotes.
        text = "".join(
            character if character.isprintable() else ascii(character)[1:-1]
            for character in quoted_text
        )
    else:
        text = repr(value)
    if len(text) > MAX_SHOWN_CHARACTERS:
        return f"{text[: MAX_SHOWN_CHARACTERS - 3]}..."
    return text


def mismatch(value: object, allowed: str) -> str:
    """Return the message about a value of another type than is allowed."""
    value_text = shown(value)
    if not isinstance(value, dict):  # the text of a table says that it is one
        value_text = f"{value_text} ({_type_name(value)})"
    return f"found {value_text}, expected {allowed}"


@cache
def validator(kind: Kind = "mechanism") -> Any:
    """Return the object of the library jsonschema that checks a kind of file.

    The library checks every item of an array by its rule "items", which is slow for long
    arrays of numbers. The rule is replaced here. Arrays of valid floats pass in one quick
    test. All other arrays go to the rule of the library.
    """
    # Imported here, because the import takes longer than reading a mechanism file.
    from jsonschema import Draft202012Validator
    from jsonschema.validators import extend

    declaration = schema(kind)
    check_items = Draft202012Validator.VALIDATORS["items"]

    def check_items_quickly(
        validator: Any, item_schema: Any, array: Any, part: Any
    ) -> Iterator[Any]:
        """Yield the errors of the items of an array, like the rule "items" of jsonschema.

        An array of valid floats passes in one quick test, without that rule.

        Parameters
        ----------
        validator
            The validator of jsonschema that calls this rule.
        item_schema
            The schema that each item has to meet: the value of the key "items".
        array
            The array to be checked.
        part
            The schema that contains the key "items".
        """
        # The schema of the items may refer to a named definition.
        name = item_schema.get("$ref", "").removeprefix(_DEFINITIONS)
        rules = declaration["$defs"].get(name, item_schema)
        low = rules.get("minimum", -math.inf)
        high = rules.get("maximum", math.inf)
        # The quick check applies if the items are numbers, and the schema has no other
        # rules for them than a minimum and a maximum.
        has_other_rules = not set(rules) <= _NUMBER_RULES
        are_plain_numbers = (
            isinstance(array, list)
            and rules.get("type") in ("number", ["number", "string"])
            and not has_other_rules
        )
        # The quick check accepts floats only, because True counts as an integer in Python.
        if are_plain_numbers and all(
            isinstance(number, float) and low <= number <= high for number in array
        ):
            return
        yield from check_items(validator, item_schema, array, part)

    quick_validator = extend(  # type: ignore[no-untyped-call]
        Draft202012Validator, {"items": check_items_quickly}
    )
    return quick_validator(declaration)


def convert_values(data: Table, converters: Converters, kind: Kind = "mechanism") -> Any:
    """Return data of a file with converted values, for example angles in rad.

    The schema of the format (a JSON Schema) declares the kind of each value, such as
    "angle". Schema and data are followed together, from the outermost table inwards.

    Parameters
    ----------
    data
        Tables that fit the format.
    converters
        By kind of value in the schema, such as "angle", the function that converts it. Its
        arguments are the location of the value and the value. Values of other kinds become
        plain numbers, texts, truth values or tuples. Tables stay unchanged if the schema
        does not declare their content.
    kind
        The kind of file.
    """
    declaration = schema(kind)
    conversion = SchemaConversion(definitions=declaration["$defs"], converters=converters)
    return conversion.convert(declaration, data, ())


@dataclass(frozen=True)
class SchemaConversion:
    """Converts values of a file by the parts of a JSON Schema that declare them.

    In all methods, `part` is the part of the schema that declares a value, `value` is this
    value, and `path` are the keys and indices that lead to it in the file.

    Attributes
    ----------
    definitions
        The named definitions of the schema.
    converters
        Functions that convert values, by the name of the schema's definition of such a
        value; see `convert_values`.
    """

    definitions: Table
    converters: Converters

    def convert(self, part: Any, value: Any, path: KeyPath) -> Any:
        """Return a value, converted by the part of the schema that declares it."""
        # A part may refer to a named definition, such as "angle". The name is empty without
        # a reference.
        name = part.get("$ref", "").removeprefix(_DEFINITIONS)
        if name in self.converters:
            return self.converters[name](path, value)
        part = self.definitions.get(name, part)
        if isinstance(value, Mapping):
            return self._convert_table(part, value, path)
        if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str):
            return self._convert_array(part, value, path)
        return self._convert_single_value(part, value, path)

    def _convert_table(self, part: Any, value: Table, path: KeyPath) -> Any:
        """Return a table in which all values are converted, for example angles to rad.

        `part` is the part of the schema that declares the table, and `path` are the keys
        that lead to the table in the file.

        The keys of a table can depend on its values, for example on the value of the key
        "kind". For such a table the schema has a list of rules "if the table has this
        value, then ...". A rule can refer ("$ref") to a definition that declares the whole
        table. The first rule with such a reference and a true condition is used. Rules
        without a reference only restrict keys and values.
        """
        for rule in part.get("allOf", ()):
            declares_table = "$ref" in rule.get("then", ())
            if declares_table and _is_met(rule["if"], value):
                return self.convert(rule["then"], value, path)
        # The declared keys, and the declaration of all other keys, if these are allowed.
        properties = part.get("properties", {})
        other_properties = part.get("additionalProperties")
        if not (properties or other_properties):
            return value
        return {
            key: self.convert(properties.get(key, other_properties), item, (*path, key))
            for key, item in value.items()
        }

    def _convert_array(self, part: Any, value: Any, path: KeyPath) -> Any:
        """Return the converted items of an array as a tuple."""
        return tuple(
            self.convert(part.get("items"), item, (*path, index))
            for index, item in enumerate(value)
        )

    def _convert_single_value(self, part: Any, value: Any, path: KeyPath) -> Any:
        """Return a converted number, text or truth value.

        `part` is the part of the schema that declares the value. The schema can declare an
        array of quantities, such as the values q of all inputs. In a file, a single value
        may replace such an array, for example q = 40 if there is one input. This value is
        converted like an item of the array, and returned without an array.
        """
        # If the schema declares an array, `item_part` declares its items. Quantities with a
        # unit, such as "40deg", refer ("$ref") to a definition, such as "angle".
        item_part = part.get("items")
        refers_to_definition = item_part and "$ref" in item_part
        if refers_to_definition and isinstance(value, int | float | str):
            return self.convert(item_part, value, path)
        if isinstance(value, bool | str):
            return value
        if part.get("type") == "number":
            return float(value)
        # The value can only be an integer, because the data have been checked.
        return int(value)


def _is_met(condition: Table, table: Table) -> bool:
    """Return whether a table meets a condition of the schema: keys with constant values.

    The condition is the ``if`` part of a JSON Schema: each key has to have a constant
    value. Keys that are not required may be missing.
    """
    required = condition.get("required", ())
    for key, rule in condition["properties"].items():
        value_if_missing = None if key in required else rule["const"]
        if table.get(key, value_if_missing) != rule["const"]:
            return False
    return True


def _check_format_version(document: Document) -> None:
    """Raise `FileError` unless this version reads the format that a document names."""
    if "format" not in document.data:
        raise FileError(
            f'{document.name}:1: the key "format" is missing; begin the file with '
            f"format = {FORMAT}"
        )
    version = document.data["format"]
    if type(version) is not int or version != FORMAT:
        raise document.fault(
            ("format",),
            f"found {shown(version)}, expected {FORMAT}. This version of spherekit reads "
            f"format {FORMAT}; a later format needs a newer version of spherekit",
        )


def _unusable_numbers(data: Table) -> Iterator[_Fault]:
    """Yield faults for numbers that are infinite, NaN or huge, except in user data."""
    for path, value in values_in({k: item for k, item in data.items() if k != "user"}):
        if isinstance(value, float) and not math.isfinite(value):
            yield path, f"found {float(value)}, expected a finite number"
        elif isinstance(value, int) and value.bit_length() > MAX_INTEGER_BITS:
            yield (
                path,
                f"found {shown(value)}, expected an integer below 2^{MAX_INTEGER_BITS}",
            )


def _explain_error(error: Any, kind: Kind) -> Iterator[_Fault]:
    """Translate an error of the library jsonschema into messages about a file.

    Parameters
    ----------
    error
        A `jsonschema.ValidationError`: a rule of the schema that a value breaks.
    kind
        The kind of file.

    Yields
    ------
    The location of a faulty value (keys and indices), and a message for users.
    """
    # The faulty value, the rule of the schema that it breaks, and what the rule demands.
    path: KeyPath = tuple(error.absolute_path)
    value = error.instance
    rule = error.validator
    limit = error.validator_value
    limits = limit if isinstance(limit, list) else [limit]
    bound = "at least" if rule.startswith("min") else "at most"
    if "propertyNames" in error.relative_schema_path:
        yield (*path, value), f"the name {shown(value)} is not allowed; {_NAME_RULE}"
    elif rule == "additionalProperties":
        where = f"in {key_path_text(path)}" if path else "at the top of the file"
        declared_keys = error.schema["properties"]
        for key in value:
            if key not in declared_keys:
                ending = choices(key, declared_keys, f"Allowed {where}", 20)
                yield (*path, key), f"unknown key{ending}"
    elif rule == "required":
        for key in limits:
            if key not in value:
                meaning = _meaning_of_key(key, error.schema, kind)
                yield path, f'the key "{key}" is missing; add it{meaning}'
    elif rule == "type":
        types = " or ".join(_TYPE_WORDS[name] for name in limits)
        yield path, mismatch(value, types) + _meaning(error.schema)
    elif limit is True and rule == "const":
        yield path, f"found {shown(value)}, but only true is allowed; or leave this key out"
    elif rule == "const" and "title" not in error.schema:
        # A condition: another key of the table restricts the value of this one.
        yield path, f"found {shown(value)}, but {error.schema['description']}"
    elif rule in ("enum", "const"):
        # Truth values are written as in TOML: true, not True.
        hint = nearest(value, limits) if isinstance(value, str) else ""
        words = [shown(choice) if isinstance(choice, bool) else choice for choice in limits]
        yield path, f"found {shown(value)}, allowed: {listing(words)}{hint}"
    elif rule in ("not", "anyOf"):
        # These rules combine others, and the schema describes in words what they demand.
        yield path, str(error.schema["description"])
    elif rule in ("pattern", "minLength", "maxLength") and "pattern" in error.schema:
        # A text with a pattern is a name.
        yield path, f"found {shown(value)}; {_NAME_RULE}"
    elif rule[3:] in _COUNTED_WORDS:
        # For the rules minItems, maxItems, minLength and so on, `quantity` is "Items" or
        # "Length".
        quantity = rule[3:]
        least = error.schema.get(f"min{quantity}")
        most = error.schema.get(f"max{quantity}")
        needs = f"{limit}" if least == most else f"{bound} {limit}"
        has = counted(len(value), _COUNTED_WORDS[quantity])
        yield path, f"has {has}, expected {needs}{_meaning(error.schema)}"
    elif rule in ("minimum", "maximum"):
        yield path, f"found {shown(value)}, expected {bound} {limit:g}"
    elif rule == "uniqueItems":
        repeated = next(item for item in value if value.count(item) > 1)
        yield path, f"{shown(repeated)} is listed twice; list each pair once"
    else:
        yield path, str(error.message)[:200]


def _meaning_of_key(key: str, part: Table, kind: Kind) -> str:
    """Return the meaning of a key that a file lacks, as the end of a message.

    Parameters
    ----------
    key
        The key that is missing in the file.
    part
        The part of the schema that requires the key. If this part has no description of the
        key, the first description in another part is used.
    kind
        The kind of file.
    """
    whole_schema = schema(kind)
    for table in (part, *whole_schema["$defs"].values(), whole_schema):
        if key_rules := table.get("properties", {}).get(key):
            return _meaning(key_rules)
    return ""


def _meaning(part: Table) -> str:
    """Return what a value of the file means, as the end of a message about an error.

    The text is the description of the value in the schema, for example ". Meaning: mass of
    the link, in kg". Some remarks of the description are left out: that the value has no
    unit, that it is true or false, and that a section may have at most 1000 tables. Allowed
    words that the description lacks are added. For names, the text is the rule for names.

    Parameters
    ----------
    part
        The part of the schema with the rules for the value.
    """
    # In the schema only names have a pattern.
    if "pattern" in part:
        return f"; {_NAME_RULE}"
    text = str(part.get("description", "")).rstrip(".")
    if not text:
        return ""
    for remark in (" (no unit)", " (true or false)", ". At most 1000"):
        text = text.replace(remark, "")
    allowed_words = part.get("enum", [])
    has_all_words = all(word in text for word in allowed_words)
    allowed = "" if has_all_words else f". Allowed: {listing(allowed_words)}"
    return f". Meaning: {text[0].lower()}{text[1:]}{allowed}"


def _type_name(value: object) -> str:
    """Return the name of a value's type in the words of TOML, or else of Python."""
    for types, name in (
        (bool, "boolean"),
        (dict, "table"),
        (list | tuple, "array"),
        (str, "text"),
        (int | float, "number"),
        (date | time, "date or time"),
    ):
        if isinstance(value, types):
            return name
    return type(value).__name__
