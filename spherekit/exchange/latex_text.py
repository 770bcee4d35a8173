r"""Terms as LaTeX, variables by their names; ``\mathbf`` begins those of vectors.

Factors stand at a thin space, ``\,``, so that what is printed can be read back.
"""

from collections.abc import Mapping
from typing import NamedTuple

from spherekit.symbolic.expression_graph import Expr, ExpressionNode, rewrite

_NAMED: Mapping[str, str] = {
    "asin": r"\arcsin",
    "acos": r"\arccos",
    "atan": r"\arctan",
    "atan2": r"\operatorname{atan2}",
    "log": r"\ln",
    "maximum": r"\max",
}
_SIGNS: Mapping[str, str] = {"cross": r"\times", "dot": r"\cdot"}
_FORMS: Mapping[str, str] = {
    "/": r"\frac{{{0}}}{{{1}}}",
    "**": r"\left({0}\right)^{{{1}}}",
    "norm": r"\left\|{0}\right\|",
    "sqrt": r"\sqrt{{{0}}}",
    "sign": r"\frac{{{0}}}{{\left|{0}\right|}}",
}
SYMBOL, PRODUCT, SUM = range(3)
_RANKS = (r"\mathbf{I}", 3), (r"\mathbf", 4), ("dot{", 2)
_LATE = 1


class _Printed(NamedTuple):
    """A text, how loosely it is joined, and how late it stands in products."""

    text: str
    joint: int
    rank: int = 0

    def within(self, most: int) -> str:
        """Return the text, in brackets if it is joined more loosely."""
        return self.text if self.joint <= most else rf"\left({self.text}\right)"


def text_of(item: Expr) -> str:
    """Return an expression as LaTeX."""
    (made,) = rewrite([item], _number, _applied)
    text: str = made.text
    return text


def number(value: float) -> str:
    """Return a number with 15 digits at most."""
    digits, _, exponent = f"{value:.15g}".partition("e")
    return rf"{digits}\cdot 10^{{{int(exponent)}}}" if exponent else digits


def _number(value: float) -> _Printed:
    half = r"\frac{1}{2}" if value == 0.5 else number(value)
    return _Printed(half, SUM if value < 0.0 else SYMBOL)


def _applied(term: ExpressionNode, given: list[_Printed]) -> _Printed:
    name = term.operation
    if name == "variable":
        symbol: str = term.arguments[0]
        rank = next((rank for mark, rank in _RANKS if mark in symbol), 0)
        return _Printed(symbol, SYMBOL, rank)
    if name in _FORMS:
        rank = given[0].rank if name == "/" else 0
        return _Printed(_FORMS[name].format(*(x.text for x in given)), SYMBOL, rank)
    if name not in ("+", "-", "*", *_SIGNS):
        inside = ", ".join(x.text for x in given)
        alone = name in ("sin", "cos") and given[0].joint == SYMBOL and "frac" not in inside
        inside = f" {inside}" if alone else rf"\left({inside}\right)"
        return _Printed(_NAMED.get(name, f"\\{name}") + inside, SYMBOL, _LATE)
    a, b = given
    if name in _SIGNS:
        text = f"{a.within(SYMBOL)} {_SIGNS[name]} {b.within(SYMBOL)}"
        return _Printed(text, PRODUCT, 4 * (name == "cross"))
    if name == "*":
        if term.arguments[0] == -1.0:
            return _Printed("-" + b.within(PRODUCT), SUM, b.rank)
        if term.arguments[0] is term.arguments[1]:
            base = a.within(SYMBOL) if "^" not in a.text else rf"\left({a.text}\right)"
            return _Printed(f"{base}^{{2}}", SYMBOL)
        first, last = sorted(given, key=lambda x: x.rank)
        inner = [x.within(PRODUCT if r" \, " in x.text else SYMBOL) for x in (first, last)]
        if isinstance(term.arguments[0], float):
            inner[0] = first.text
        joint = SUM if inner[0].startswith("-") else PRODUCT
        return _Printed(r" \, ".join(inner), joint, last.rank)
    if name == "+" and b.text.startswith("-"):
        return _Printed(f"{a.text} - {b.text[1:]}", SUM, a.rank)
    return _Printed(f"{a.text} {name} {b.within(SUM - (name == '-'))}", SUM, a.rank)
