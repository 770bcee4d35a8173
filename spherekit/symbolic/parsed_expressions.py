"""Conversion of parsed text, such as the torque of a load, to a graph of nodes."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce

from spherekit.errors import EngineError
from spherekit.mechanism.load_expression import Expression, fold
from spherekit.symbolic.expression_graph import (
    Expr,
    function,
    has_variables,
    power,
    sign_of,
)

PERIODIC_FUNCTIONS = ("sin", "cos", "tan")
"""Functions whose value does not change if the argument grows by 2 pi."""

PRESERVES_WHOLE_REVOLUTIONS = ("+", "-", "negative")
"""Operations that turn whole revolutions of arguments into whole revolutions."""


@dataclass(frozen=True)
class AngleForms:
    """A symbolic expression in two forms, as it is and without whole revolutions.

    Sines, cosines and tangents are computed from the second form. It is more accurate,
    because a large floating-point angle has fewer exact digits after the decimal point.

    Attributes
    ----------
    full
        The value, which may be an angle of many revolutions.
    reduced
        The value minus whole revolutions. The same as `full` if the value is no angle.
    """

    full: Expr
    reduced: Expr


def convert_to_graph(
    expression: Expression,
    nodes_by_name: Mapping[str, tuple[Expr, Expr]],
    sign: Callable[[Expr], Expr] | None = None,
) -> Expr:
    """Return a parsed expression, such as the torque of a load, as a graph of nodes.

    Each name, and each part of the expression, has two values: the full value, and a
    reduced value that differs from it by a number of whole revolutions (or not at all).
    Sines, cosines and tangents use the reduced value, which keeps its digits after many
    revolutions.

    Parameters
    ----------
    expression
        The parsed expression.
    nodes_by_name
        Full and reduced value of each name in the expression. The two values are the same
        for names that are no angles.
    sign
        Function that returns the sign of an expression, by default `sign_of`. An integrator
        gives a function whose sign changes only at switches (events of the integration).
        It is not called for expressions without variables, whose sign never changes.

    Raises
    ------
    EngineError
        If a denominator is the number 0 after simplification, such as x - x.
    """

    def sign_function(a: Expr) -> Expr:
        """Return the sign of an expression, by `sign` if the sign may change."""
        return sign(a) if sign and has_variables(a) else sign_of(a)

    def form_maximum(a: Expr, b: Expr) -> Expr:
        """Return the maximum of two expressions.

        With a function `sign`, max(a, b) is ((1 + s) a + (1 - s) b) / 2 with s = sign(a -
        b), so that an integrator can control when the sign changes. The smaller argument
        gets the factor 0 and so adds no rounding error, however large it is.
        """
        if sign is None:
            return function("maximum", a, b)
        s = sign_function(a - b)
        return 0.5 * ((1.0 + s) * a + (1.0 - s) * b)

    operations: Mapping[str, Callable[..., Expr]] = {
        "+": operator.add,
        "-": operator.sub,
        "*": operator.mul,
        "/": operator.truediv,
        "**": power,
        "negative": lambda a: -1.0 * a,
        "abs": lambda a: sign_function(a) * a,
        "sign": sign_function,
        "max": lambda *items: reduce(form_maximum, items),
        "min": lambda *items: -1.0 * reduce(form_maximum, (-1.0 * item for item in items)),
    }

    def convert_operation(name: str, operands: list[AngleForms]) -> AngleForms:
        """Return an operation of a parsed expression as a node of the graph, in two forms.

        The full form is the value. In the reduced form, whole revolutions are subtracted
        from angles. Sines and the like are computed from the reduced form, because small
        angles are more exact.

        Parameters
        ----------
        name
            Name of the operation, such as "+" or "sin".
        operands
            The operands in both forms.
        """
        full_operands = [operand.full for operand in operands]
        reduced_operands = [operand.reduced for operand in operands]
        _check_denominator(name, full_operands, expression.text)
        # Operations without an entry in `operations`, such as "sin", are named functions.
        operation: Callable[..., Expr] = operations.get(name) or partial(function, name)
        if name in PERIODIC_FUNCTIONS:
            result = operation(*reduced_operands)
        else:
            result = operation(*full_operands)
        # A sum of reduced angles is the sum of the angles, less whole revolutions. So the
        # sum has a reduced form. Half of an angle has none, because half of a reduced angle
        # may lack half a revolution.
        if _keeps_whole_revolutions(name, full_operands):
            return AngleForms(full=result, reduced=operation(*reduced_operands))
        return AngleForms(full=result, reduced=result)

    converted = fold(
        expression.root,
        convert_number=lambda number: AngleForms(full=number, reduced=number),
        convert_name=lambda name: AngleForms(*nodes_by_name[name]),
        convert_call=convert_operation,
    )
    return converted.full


def _check_denominator(name: str, operands: Sequence[Expr], text: str) -> None:
    """Raise an error if an operation divides by the number 0.

    A denominator with variables passes, although its value may be zero at some values of
    the variables.

    Parameters
    ----------
    name
        Name of the operation; operations other than "/" pass.
    operands
        Its operands: numbers, or nodes of symbolic expressions.
    text
        The whole expression, for the message. It is empty for a load that the user did not
        write as text.
    """
    if name == "/" and operands[1] == 0.0:
        subject = f'"{text}"' if text else "a load"
        raise EngineError(f"{subject} divides by an expression that is zero everywhere")


def _keeps_whole_revolutions(name: str, operands: Sequence[Expr]) -> bool:
    """Return whether an operation turns whole revolutions into whole revolutions.

    If an operand (an angle) changes by whole revolutions, the result then changes by whole
    revolutions, too. So the operation may be applied to angles from which whole revolutions
    were subtracted. Examples are a sum, and the product of an angle and an integer. Half of
    an angle is a counterexample.

    Parameters
    ----------
    name
        Name of the operation, such as "+".
    operands
        Its operands: numbers and nodes.
    """
    has_integer_factor = any(isinstance(x, float) and x % 1.0 == 0.0 for x in operands)
    return name in PRESERVES_WHOLE_REVOLUTIONS or (name == "*" and has_integer_factor)
