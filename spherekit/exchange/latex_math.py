r"""Sums, products and vectors as LaTeX: what is 0 or 1 is left out, factors have brackets.

Factors of a product stand at a thin space, ``\,``, so that it can be read back.
"""

import re
from collections.abc import Callable, Mapping

from spherekit.model.expression import Expression, fold

_BRACKETS = re.compile(r"\\(left|right)(\\?[(|)])")
_INNERMOST = re.compile(r"\{[^{}]*\}")
_JOINED = re.compile(r" [+-] | \\times | \\cdot |^-")
_SUM = re.compile(r" [+-] |^-")
_NAMED: Mapping[str, str] = {
    "asin": r"\arcsin",
    "acos": r"\arccos",
    "atan": r"\arctan",
    "atan2": r"\operatorname{atan2}",
    "log": r"\ln",
    "sign": r"\operatorname{sgn}",
}
WIDEST = 72
"""Letters of a line; longer sums are broken."""


def _outside(text: str) -> str:
    """Return a text with blanks for what stands in braces and brackets."""
    text = _BRACKETS.sub(lambda found: "{}"[found[1] == "right"].ljust(len(found[0])), text)
    while (shorter := _INNERMOST.sub(lambda found: "#" * len(found[0]), text)) != text:
        text = shorter
    return text


def grouped(text: str) -> str:
    """Return a text in brackets if it is a sum, a product of vectors or negative."""
    return rf"\left({text}\right)" if _JOINED.search(_outside(text)) else text


def product(*factors: str) -> str:
    """Return the product of scalars, or with one vector among them."""
    negative, parts = False, []
    for factor in factors:
        if factor == "0":
            return "0"
        if _is_negative(factor):
            negative, factor = not negative, factor[1:]
        if factor != "1":
            parts.append(factor)
    if len(parts) > 1 or (negative and _SUM.search(_outside("".join(parts)))):
        parts = [grouped(part) for part in parts]
    return "-" * negative + (r" \, ".join(parts) or "1")


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
    if over == "0" or under == "1":
        return over
    if _is_negative(over):
        return rf"-\frac{{{over[1:]}}}{{{under}}}"
    return rf"\frac{{{over}}}{{{under}}}"


def cross(a: str, b: str) -> str:
    """Return a x b."""
    return _of_vectors(r"\times", a, b)


def dot(a: str, b: str) -> str:
    """Return a . b."""
    return _of_vectors(r"\cdot", a, b)


def _of_vectors(operation: str, a: str, b: str) -> str:
    if "0" in (a, b):
        return "0"
    for one, other, sides in ((a, b, slice(None)), (b, a, slice(None, None, -1))):
        if _is_negative(one):
            return minus(_of_vectors(operation, *(one[1:], other)[sides]))
    return f"{grouped(a)} {operation} {grouped(b)}"


def _is_negative(text: str) -> bool:
    """Return whether a text is the opposite of what follows its sign."""
    return text.startswith("-") and not _SUM.search(_outside(text[1:]))


def size(text: str) -> str:
    """Return the norm of a vector."""
    return rf"\left\|{text}\right\|"


def power(base: str, exponent: str) -> str:
    """Return a power."""
    plain = re.fullmatch(r"[\w.]+|\\?[a-z]+(\{\w\})?(_\{[\w,]+\})?", base)
    return rf"{base}^{{{exponent}}}" if plain else rf"\left({base}\right)^{{{exponent}}}"


def applied(name: str, *arguments: str) -> str:
    """Return a function of scalars; of a single symbol without brackets."""
    name = _NAMED.get(name, f"\\{name}")
    (argument, *others) = arguments
    if not others and re.fullmatch(r"[a-z]|\\[a-z]+_\{[\w,]+\}|q_\{\d+\}", argument):
        return f"{name} {argument}"
    return rf"{name}\left({', '.join(arguments)}\right)"


def number(value: float) -> str:
    """Return a number with 15 digits at most."""
    digits, _, exponent = f"{value:.15g}".partition("e")
    return rf"{digits}\cdot 10^{{{int(exponent)}}}" if exponent else digits


_OPERATIONS: Mapping[str, Callable[..., str]] = {
    "+": total,
    "-": lambda a, b: total(a, minus(b)),
    "*": product,
    "/": quotient,
    "**": power,
    "negative": minus,
    "sqrt": lambda a: rf"\sqrt{{{a}}}",
    "abs": lambda a: rf"\left|{a}\right|",
}


def law(expression: Expression, named: Callable[[str], str]) -> str:
    """Return the expression of a load, with symbols for its names."""

    def apply(operation: str, parts: list[str]) -> str:
        if operation in _OPERATIONS:
            return _OPERATIONS[operation](*parts)
        return applied(operation, *parts)

    return fold(expression.root, number, named, apply)


def broken(text: str) -> str:
    """Return a sum in lines that are not too wide, as rows of ``align``."""
    marks = [found.start() for found in _SUM.finditer(_outside(text)) if found.start()]
    parts = [text[a:b] for a, b in zip([0, *marks], [*marks, len(text)], strict=True)]
    lines = [parts[0]]
    for part in parts[1:]:
        if _letters(lines[-1]) + _letters(part) > WIDEST:
            lines.append("")
        lines[-1] += part
    return " \\nonumber \\\\\n&\\quad {}".join(lines)


def _letters(text: str) -> int:
    """Return about how many letters wide a formula is."""
    text = re.sub(r"\\(frac|left|right|mathbf|dot)|\\[,;]|[{}_^& ]", "", text)
    return len(re.sub(r"\\[a-zA-Z]+", "x", text))
