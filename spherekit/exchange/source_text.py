"""Numbers and arrays as text of source code."""

import re
from textwrap import wrap
from typing import Any

import numpy as np

LINE_WIDTH = 84
"""Width of lines of numbers and comments, in characters."""


def number(value: float) -> str:
    """Return the shortest text that reads as the same number."""
    return repr(float(value))


def bracketed_number(value: float) -> str:
    """Return a number as text, in brackets if it is negative."""
    return f"({number(value)})" if value < 0.0 else number(value)


def nested(values: Any, brackets: str = "[]", literal_format: str = "{0}") -> str:
    """Return an array as source text, with brackets around each axis: ``[[1.0, 2.0]]``.

    Parameters
    ----------
    values
        The array, or a single number.
    brackets
        The opening and the closing bracket.
    literal_format
        How the programming language writes a number: ``{0}`` stands for its decimal text.
    """
    if np.ndim(values):
        items = ", ".join(nested(item, brackets, literal_format) for item in values)
        return brackets[0] + items + brackets[1]
    return literal_format.format(number(values))  # `number` returns text, such as "1.0"


def nested_with_nan(
    values: Any, brackets: str, nan_literal: str, infinity_literal: str
) -> str:
    """Return an array as source text, with brackets around each axis: ``[[1.0, NaN]]``.

    NaN and infinity are written as the language writes them. Long text is divided into
    lines.

    Parameters
    ----------
    values
        The array, or a single number.
    brackets
        The opening and the closing bracket.
    nan_literal, infinity_literal
        NaN and infinity in the programming language.
    """
    text = re.sub(r"\bnan\b", nan_literal, nested(values, brackets))
    return wrap_lines(re.sub(r"\binf\b", infinity_literal, text))


def wrap_lines(text: str, indent: str = "    ") -> str:
    """Return a text in lines of `LINE_WIDTH`, indented from the second line on."""
    return f"\n{indent}".join(wrap(text, LINE_WIDTH, break_long_words=False))
