r"""Expressions as LaTeX. Variables are printed by their names.

The names of vectors begin with ``\mathbf``. Factors are separated by a thin space, ``\,``,
so that the printed formula can be read back by a program.
"""

import math
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
    """How loosely the parts of an expression are joined.

    The smaller the number, the tighter. A symbol needs no brackets, a sum needs the most.
    Fractions, roots and functions count as symbols, because they enclose their arguments.
    """

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
    """An expression as LaTeX, with its properties for insertion into a larger expression.

    Attributes
    ----------
    text
        The LaTeX.
    binding
        Whether the expression counts as a symbol, a product or a sum. It decides about
        brackets: a sum needs brackets as a factor of a product, for example.
    rank
        Position of the expression among the factors of a product: numbers first, vectors
        last.
    is_variable
        Whether the expression is the name of a variable. Such a name needs no brackets in a
        sine or cosine, or before an exponent.
    has_exponent
        Whether the text ends with an exponent, as a square does, or is a name with one,
        such as ``c^{(1)}_{2}``. LaTeX refuses two exponents on one symbol, so the text
        needs brackets before another exponent.
    is_negative
        Whether the text begins with a minus sign. A sum shows it as ``a - b`` instead of
        ``a + -b``.
    is_spaced_product
        Whether the expression is a product with factors separated by thin spaces. Such a
        product needs no brackets as a factor, in contrast to a vector product.
    """

    text: str
    binding: Binding
    rank: int = FactorRank.SCALAR
    is_variable: bool = False
    has_exponent: bool = False
    is_negative: bool = False
    is_spaced_product: bool = False

    def bracketed_beyond(self, loosest: Binding) -> str:
        """Return the text, with brackets if its operators bind less tightly than `loosest`.

        A symbol binds most tightly, a product less, and a sum least.
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
    """Return a number as LaTeX; a negative number is bracketed like a sum."""
    text = r"\frac{1}{2}" if value == 0.5 else number(value)
    binding = Binding.SUM if value < 0.0 else Binding.SYMBOL
    # A zero can be negative, too.
    return LatexText(text, binding, is_negative=math.copysign(1.0, value) < 0.0)


def _print_operation(node: ExpressionNode, arguments: list[LatexText]) -> LatexText:
    """Return a node of an expression (a variable, operation or function) as LaTeX.

    Two properties of the result matter in all larger expressions. The binding tells whether
    brackets are necessary: as a factor of a product, for example, a sum needs them, and a
    symbol does not. The rank is the position among the factors of a product:
    scalars come before vectors.

    Parameters
    ----------
    node
        The node.
    arguments
        Arguments of the node as LaTeX; empty for a variable.
    """
    operation = node.operation
    if operation == "variable":
        return _print_symbol(node.arguments[0])
    # Fractions, roots, absolute values and the like enclose their arguments, so these need
    # no brackets.
    if operation in _TEMPLATE_BY_OPERATION:
        # A fraction has the rank of its numerator, so a vector divided by a number remains
        # a vector. All other results have the rank of scalars.
        rank = arguments[0].rank if operation == "/" else FactorRank.SCALAR
        template = _TEMPLATE_BY_OPERATION[operation]
        text = template.format(*(argument.text for argument in arguments))
        return LatexText(text, Binding.SYMBOL, rank, has_exponent=operation == "**")
    if operation in _SIGN_BY_VECTOR_PRODUCT:
        # Factors other than symbols get brackets.
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
    """Return a variable as LaTeX, with the rank (place in products) that its name shows.

    The name is LaTeX and shows the kind: bold letters mark a vector, for example.
    """
    rank = FactorRank.SCALAR
    for mark, rank_of_mark in _RANK_BY_MARK:
        if mark in name:
            rank = rank_of_mark
            break
    return LatexText(name, Binding.SYMBOL, rank, is_variable=True, has_exponent="^" in name)


def _print_function(name: str, arguments: list[LatexText]) -> LatexText:
    """Return a function of arguments; a sine or cosine of a variable has no brackets."""
    command = _COMMAND_BY_FUNCTION.get(name, f"\\{name}")
    inside = ", ".join(argument.text for argument in arguments)
    if name in ("sin", "cos") and arguments[0].is_variable:
        text = f"{command} {inside}"
    else:
        text = rf"{command}\left({inside}\right)"
    return LatexText(text, Binding.SYMBOL, FactorRank.FUNCTION)


def _print_product(node: ExpressionNode, arguments: list[LatexText]) -> LatexText:
    """Return a product of two factors as LaTeX.

    Parameters
    ----------
    node
        The product as an expression, which shows whether factors are equal, or numbers.
        Products are stored with a number first, so only the first factor can be a number.
    arguments
        The two factors of the product as LaTeX.
    """
    first_argument, second_argument = node.arguments
    first_text, second_text = arguments
    if first_argument == -1.0:
        return _print_negative(second_text)
    # Equal nodes are always one object.
    if first_argument is second_argument:
        return _print_square(first_text)
    if isinstance(first_argument, float):
        return _print_multiple(first_text, second_text)
    # Scalars have a smaller rank than vectors and are printed before them.
    first_factor, last_factor = sorted(arguments, key=lambda factor: factor.rank)
    return LatexText(
        rf"{_print_factor(first_factor)} \, {_print_factor(last_factor)}",
        Binding.PRODUCT,
        # A scalar times a vector is a vector.
        rank=last_factor.rank,
        is_spaced_product=True,
    )


def _print_negative(positive: LatexText) -> LatexText:
    """Return an expression with a minus sign as LaTeX.

    As a factor of a product, such an expression needs brackets, so the result has the
    binding of a sum.
    """
    text = "-" + positive.bracketed_beyond(Binding.PRODUCT)
    return LatexText(text, Binding.SUM, positive.rank, is_negative=True)


def _print_square(base: LatexText) -> LatexText:
    """Return the square of an expression as LaTeX.

    Without brackets, the exponent would seem to belong only to the last part of the base.
    Only the name of a variable without an exponent of its own needs no brackets.
    """
    text = base.text
    if not base.is_variable or base.has_exponent:
        text = rf"\left({text}\right)"
    squared = f"{text}^{{2}}"
    return LatexText(squared, Binding.SYMBOL, FactorRank.SCALAR, has_exponent=True)


def _print_multiple(number_text: LatexText, factor: LatexText) -> LatexText:
    """Return a number times an expression as LaTeX.

    A negative number at the beginning needs no brackets, as in "-2 x". As a factor of
    another product, "-2 x" needs brackets, so the result has the binding of a sum.
    """
    text = rf"{number_text.text} \, {_print_factor(factor)}"
    if number_text.is_negative:
        return LatexText(text, Binding.SUM, factor.rank, is_negative=True)
    return LatexText(text, Binding.PRODUCT, factor.rank, is_spaced_product=True)


def _print_factor(factor: LatexText) -> str:
    r"""Return a factor of a product with thin spaces, in brackets if it needs them.

    Symbols need no brackets, and neither do products with thin spaces. Sums, expressions
    with a minus sign and vector products such as ``a \times b`` need brackets.
    """
    if factor.is_spaced_product:
        return factor.text
    return factor.bracketed_beyond(Binding.SYMBOL)


def _print_sum(operation: str, a: LatexText, b: LatexText) -> LatexText:
    """Return the sum ("+") or difference ("-") of two expressions as LaTeX."""
    if operation == "+" and b.is_negative:
        text = f"{a.text} - {b.text.removeprefix('-')}"
    else:
        # a - (b + c) needs its brackets, a + (b + c) does not.
        loosest = Binding.PRODUCT if operation == "-" else Binding.SUM
        text = f"{a.text} {operation} {b.bracketed_beyond(loosest)}"
    return LatexText(text, Binding.SUM, a.rank, is_negative=a.is_negative)
