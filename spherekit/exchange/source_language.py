"""The rules by which a programming language writes expressions."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from spherekit.exchange.identifiers import NameRules

CIRCULAR_FUNCTIONS = ("sin", "cos", "tan", "asin", "acos", "atan")
"""Functions of angles, and their inverses."""

UNARY_FUNCTIONS = (*CIRCULAR_FUNCTIONS, "sqrt", "exp", "log", "tanh", "cosh", "sinh")
"""Functions of one argument that expressions contain."""


@dataclass(frozen=True)
class Language:
    """The rules by which a programming language writes formulas.

    Formats are templates of `str.format`: texts with fields in braces, such as ``{0}``.

    Attributes
    ----------
    name
        Name of the language.
    operation_formats
        For each operation of expressions its format, with its arguments {0} and {1}.
    assignment_format
        An assignment of the value {1} to the new name {0}.
    table_format
        A statement that calls the function of table {k}, and assigns the values to an
        array. A table consists of several functions of one argument, stored as Chebyshev
        series. The other fields are:

        - {name}: name of the mechanism in the source code, a part of the function's name,
        - {argument}: the expression of the argument,
        - {columns}: number of functions in the table, the length of the array.
    comment_prefix
        Text that begins the lines of a comment.
    escape_comment
        Function that changes a text so that a comment can contain it.
    name_rules
        Rules for names of functions.
    helper_by_operation
        Functions that the source has to define, by the operation that needs them.
    nan_literal
        The constant NaN.
    first_index
        Index of the first element of an array.
    literal_format
        Format of a number.
    """

    name: str
    operation_formats: Mapping[str, str]
    assignment_format: str
    table_format: str
    comment_prefix: str
    escape_comment: Callable[[str], str]
    name_rules: NameRules
    helper_by_operation: Mapping[str, str]
    nan_literal: str
    first_index: int = 0
    literal_format: str = "{0}"


def operation_formats(prefix: str, differing: Mapping[str, str]) -> dict[str, str]:
    """Return the formats of all operations in a programming language.

    A format is a template of `str.format`, such as ``{0} + {1}`` for a sum.

    Parameters
    ----------
    prefix
        Text before the names of functions, such as ``Math.`` in JavaScript.
    differing
        Formats of operations that the language does not write in the usual way. These
        formats replace the usual formats.
    """
    formats = {operator: f"{{0}} {operator} {{1}}" for operator in "+-*/"}
    formats |= {name: f"{prefix}{name}({{0}})" for name in UNARY_FUNCTIONS}
    formats["atan2"] = f"{prefix}atan2({{0}}, {{1}})"
    formats["**"] = f"{prefix}pow({{0}}, {{1}})"
    return {**formats, **differing}
