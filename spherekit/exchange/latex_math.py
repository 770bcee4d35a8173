r"""Sums, products and vectors as LaTeX: what is 0 or 1 is left out, factors have brackets.

Factors of a product stand at a thin space, ``\,``, so that it can be read back.
"""

import re
from collections.abc import Callable, Mapping

from spherekit.model.expression import Expression, fold

_BRACKETS = re.compile(r"\\(left|right)\\?[(|)]")
_INNERMOST = re.compile(r"\{[^{}]*\}")
_JOINED = re.compile(r" [+-] | \\times | \\cdot |^-")
_SUM = re.compile(r" [+-] |^-")


def _has(joint: re.Pattern[str], text: str) -> bool:
    """Return whether a text is joined so outside of braces and brackets."""
    text = _BRACKETS.sub(lambda found: "{" if found[1] == "left" else "}", text)
    while (shorter := _INNERMOST.sub("", text)) != text:
        text = shorter
    return bool(joint.search(text))


def grouped(text: str) -> str:
    """Return a text in brackets if it is a sum, a product of vectors or negative."""
    return rf"\left({text}\right)" if _has(_JOINED, text) else text


def _parted(text: str) -> tuple[str, str]:
    """Return the sign and the rest of a text that is no sum."""
    negative = text.startswith("-") and not _has(_SUM, text[1:])
    return ("-", text[1:]) if negative else ("", text)


def product(*factors: str) -> str:
    """Return the product of scalars, or with one vector among them."""
    if "0" in factors:
        return "0"
    signs, rest = zip(*map(_parted, factors), strict=True)
    parts, sign = [x for x in rest if x != "1"], "-" * (signs.count("-") % 2)
    if len(parts) > 1 or (sign and any(_has(_SUM, x) for x in parts)):
        parts = [*map(grouped, parts)]
    return sign + (r" \, ".join(parts) or "1")


def minus(text: str) -> str:
    """Return the opposite."""
    return product("-1", text)


def total(*terms: str) -> str:
    """Return the sum."""
    first, *others = [term for term in terms if term != "0"] or ["0"]
    more = (f" - {x[1:]}" if x.startswith("-") else f" + {x}" for x in others)
    return first + "".join(more)


def quotient(over: str, under: str) -> str:
    """Return a fraction."""
    sign, over = _parted(over)
    return sign + (over if over == "0" or under == "1" else rf"\frac{{{over}}}{{{under}}}")


def dot(a: str, b: str, operation: str = r"\cdot") -> str:
    """Return a . b, or another product of vectors."""
    (one, a), (other, b) = _parted(a), _parted(b)
    if "0" in (a, b):
        return "0"
    made = f"{grouped(a)} {operation} {grouped(b)}"
    return made if one == other else minus(made)


def cross(a: str, b: str) -> str:
    """Return a x b."""
    return dot(a, b, r"\times")


def number(value: float) -> str:
    """Return a number with 15 digits at most."""
    digits, _, exponent = f"{value:.15g}".partition("e")
    return rf"{digits}\cdot 10^{{{int(exponent)}}}" if exponent else digits


_NAMED: Mapping[str, str] = {
    "asin": r"\arcsin",
    "acos": r"\arccos",
    "atan": r"\arctan",
    "atan2": r"\operatorname{atan2}",
    "log": r"\ln",
    "sign": r"\operatorname{sgn}",
}
_OPERATIONS: Mapping[str, Callable[..., str]] = {
    "+": total,
    "-": lambda a, b: total(a, minus(b)),
    "*": product,
    "/": quotient,
    "**": lambda a, b: rf"\left({a}\right)^{{{b}}}",
    "negative": minus,
    "sqrt": r"\sqrt{{{}}}".format,
    "abs": r"\left|{}\right|".format,
}


def law(expression: Expression, named: Callable[[str], str]) -> str:
    """Return the expression of a load, with symbols for its names."""

    def apply(name: str, parts: list[str]) -> str:
        if name in _OPERATIONS:
            return _OPERATIONS[name](*parts)
        return rf"{_NAMED.get(name, chr(92) + name)}\left({', '.join(parts)}\right)"

    return fold(expression.root, number, named, apply)
