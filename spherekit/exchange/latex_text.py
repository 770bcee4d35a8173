r"""Expressions as LaTeX. Variables are printed by their names.

The names of vectors begin with ``\mathbf``. Factors are separated by a thin space, ``\,``,
so that the printed formula can be read back by a program.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from spherekit.symbolic.expression_graph import Expr, ExpressionNode, rewrite

_COMMAND_BY_FUNCTION: Mapping[str, str] = {
    "asin": r"\arcsin",
    "acos": r"\arccos",
    "atan": r"\arctan",
    "atan2": r"\operatorname{atan2}",
    "log": r"\ln",
    "maximum": r"\max",
}
"""Commands of functions. Other functions have the command of their name."""

_SIGN_BY_VECTOR_PRODUCT: Mapping[str, str] = {"cross": r"\times", "dot": r"\cdot"}

_TEMPLATE_BY_OPERATION: Mapping[str, str] = {
    "/": r"\frac{{{0}}}{{{1}}}",
    "**": r"\left({0}\right)^{{{1}}}",
    "norm": r"\left\|{0}\right\|",
    "sqrt": r"\sqrt{{{0}}}",
    "sign": r"\frac{{{0}}}{{\left|{0}\right|}}",
}
"""LaTeX of operations that need no brackets around them, with the arguments inserted."""


class Binding(IntEnum):
    """How loosely the parts of an expression are joined: a looser one needs brackets."""

    SYMBOL = 0
    PRODUCT = 1
    SUM = 2


class FactorRank(IntEnum):
    """Position of a factor in a product: factors of smaller rank are printed first.

    The order is numbers and scalars, functions, time derivatives, tensors, vectors.
    """

    SCALAR = 0
    FUNCTION = 1
    RATE = 2
    TENSOR = 3
    VECTOR = 4


_RANK_BY_MARK = (
    (r"\mathbf{I}", FactorRank.TENSOR),
    (r"\mathbf", FactorRank.VECTOR),
    ("dot{", FactorRank.RATE),
)
"""Ranks of symbols whose name contains a text; the first that matches applies."""


class LatexText(NamedTuple):
    """An expression as LaTeX, and how it joins with others.

    Attributes
    ----------
    text
        The LaTeX.
    binding
        How loosely its parts are joined: as a symbol, a product or a sum. A sum needs
        brackets as a factor of a product, for example.
    rank
        Its position among the factors of a product: numbers first, vectors last.
    """

    text: str
    binding: Binding
    rank: int = FactorRank.SCALAR

    def bracketed_beyond(self, loosest: Binding) -> str:
        """Return the text, in brackets if its binding is looser than `loosest`.

        A symbol is the tightest binding, a product is looser, and a sum is the loosest.
        """
        if self.binding <= loosest:
            return self.text
        return rf"\left({self.text}\right)"


def latex_of(expression: Expr) -> str:
    """Return an expression as LaTeX."""
    (latex_text,) = rewrite([expression], _print_number, _print_operation)
    text: str = latex_text.text
    return text


def number(value: float) -> str:
    """Return a number as LaTeX, with at most 15 digits."""
    digits, _, exponent = f"{value:.15g}".partition("e")
    return rf"{digits}\cdot 10^{{{int(exponent)}}}" if exponent else digits


def _print_number(value: float) -> LatexText:
    """Return a number as LaTeX; a negative one is bracketed like a sum."""
    text = r"\frac{1}{2}" if value == 0.5 else number(value)
    return LatexText(text, Binding.SUM if value < 0.0 else Binding.SYMBOL)


def _print_operation(node: ExpressionNode, arguments: list[LatexText]) -> LatexText:
    """Return a node of an expression as LaTeX.

    The result also has two properties for larger expressions. The binding tells where it
    needs brackets: a symbol nowhere, a product and a sum in what binds more tightly. The
    rank is its position among the factors of a product: scalars come before vectors.

    Parameters
    ----------
    node
        A variable, an operation or a function.
    arguments
        Its arguments as LaTeX; empty for a variable.
    """
    operation = node.operation
    if operation == "variable":
        return _print_symbol(node.arguments[0])
    # Fractions, roots, absolute values and the like enclose their arguments, which need no
    # brackets therefore.
    if operation in _TEMPLATE_BY_OPERATION:
        # A vector divided by a number remains a vector; all other results are scalars.
        rank = arguments[0].rank if operation == "/" else FactorRank.SCALAR
        template = _TEMPLATE_BY_OPERATION[operation]
        text = template.format(*(argument.text for argument in arguments))
        return LatexText(text, Binding.SYMBOL, rank)
    if operation in _SIGN_BY_VECTOR_PRODUCT:
        # All factors but symbols get brackets.
        a, b = (argument.bracketed_beyond(Binding.SYMBOL) for argument in arguments)
        rank = FactorRank.VECTOR if operation == "cross" else FactorRank.SCALAR
        text = f"{a} {_SIGN_BY_VECTOR_PRODUCT[operation]} {b}"
        return LatexText(text, Binding.PRODUCT, rank)
    if operation == "*":
        return _print_product(node, arguments)
    if operation in ("+", "-"):
        return _print_sum(operation, *arguments)
    return _print_function(operation, arguments)


def _print_symbol(name: str) -> LatexText:
    """Return a variable, with the rank that its name shows."""
    for mark, rank in _RANK_BY_MARK:
        if mark in name:
            return LatexText(name, Binding.SYMBOL, rank)
    return LatexText(name, Binding.SYMBOL)


def _print_function(name: str, arguments: list[LatexText]) -> LatexText:
    """Return a function of arguments; a sine or cosine of a symbol has no brackets."""
    command = _COMMAND_BY_FUNCTION.get(name, f"\\{name}")
    inside = ", ".join(argument.text for argument in arguments)
    is_sine_of_symbol = (
        name in ("sin", "cos")
        and arguments[0].binding == Binding.SYMBOL
        and "frac" not in inside
    )
    text = (
        f"{command} {inside}" if is_sine_of_symbol else rf"{command}\left({inside}\right)"
    )
    return LatexText(text, Binding.SYMBOL, FactorRank.FUNCTION)


def _print_product(node: ExpressionNode, arguments: list[LatexText]) -> LatexText:
    r"""Return a product of two factors as LaTeX.

    A factor -1 becomes a minus sign, and two equal factors a square. Other factors are
    printed in the order of their ranks (numbers first, vectors last), separated by a thin
    space ``\,``. A factor has brackets if it binds more loosely than a product: symbols
    bind most tightly, then products, then sums.

    Parameters
    ----------
    node
        The product as an expression. It shows whether factors are equal, or numbers.
    arguments
        Its two factors as LaTeX.
    """
    first_argument, second_argument = node.arguments
    first_text, second_text = arguments
    if first_argument == -1.0:
        # `bracketed_beyond` adds brackets to what binds more loosely than a product.
        negative = "-" + second_text.bracketed_beyond(Binding.PRODUCT)
        return LatexText(negative, Binding.SUM, second_text.rank)
    if first_argument is second_argument:
        base = first_text.bracketed_beyond(Binding.SYMBOL)
        if "^" in first_text.text:  # LaTeX refuses two exponents on one symbol
            base = rf"\left({first_text.text}\right)"
        # A square is a scalar, and has its place among the first factors.
        return LatexText(f"{base}^{{2}}", Binding.SYMBOL, FactorRank.SCALAR)
    factors = sorted(arguments, key=lambda factor: factor.rank)
    factor_texts: list[str] = []
    for factor in factors:
        # A factor can be a product itself. Such a product needs no brackets if its factors
        # are separated by thin spaces. A vector product, such as "a \times b", needs them.
        is_spaced_product = r" \, " in factor.text
        loosest = Binding.PRODUCT if is_spaced_product else Binding.SYMBOL
        factor_texts.append(factor.bracketed_beyond(loosest))
    if isinstance(first_argument, float):
        # A number comes first, also after sorting, because it has the smallest rank. It
        # needs no brackets there even if it is negative.
        factor_texts[0] = factors[0].text
    binding = Binding.SUM if factor_texts[0].startswith("-") else Binding.PRODUCT
    # The product has the rank of its last factor: a scalar times a vector is a vector.
    return LatexText(r" \, ".join(factor_texts), binding, factors[1].rank)


def _print_sum(operation: str, a: LatexText, b: LatexText) -> LatexText:
    """Return the sum ("+") or difference ("-") of two expressions as LaTeX."""
    if operation == "+" and b.text.startswith("-"):
        return LatexText(f"{a.text} - {b.text[1:]}", Binding.SUM, a.rank)
    # a - (b + c) needs its brackets, a + (b + c) does not.
    loosest = Binding.PRODUCT if operation == "-" else Binding.SUM
    text = f"{a.text} {operation} {b.bracketed_beyond(loosest)}"
    return LatexText(text, Binding.SUM, a.rank)
