"""Conversion of parsed text, such as the torque of a load, to a graph of nodes."""

import operator
from collections.abc import Callable, Mapping
from functools import reduce

from spherekit.errors import EngineError
from spherekit.mechanism.load_expression import Expression, fold
from spherekit.symbolic.expression_graph import Expr, function, power, sign_of

PERIODIC_FUNCTIONS = ("sin", "cos", "tan")
"""Functions whose value does not change if the argument grows by 2 pi."""

PRESERVES_WHOLE_REVOLUTIONS = ("+", "-", "negative")
"""Operations whose result changes by whole revolutions if their arguments do."""


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
        Full and reduced value of each name in the expression. Both are the same for names
        that are no angles.
    sign
        Function that returns the sign of an expression. The result has a kink or a jump
        where that expression is zero. An integrator gives a function here whose sign
        changes only at switches. By default it is `sign_of`.

    Raises
    ------
    EngineError
        If a denominator is zero for all values of the names.
    """

    def form_maximum(a: Expr, b: Expr) -> Expr:
        """Return the maximum of two expressions.

        If `sign` is given, the sign of their difference decides which of them is returned.
        """
        if sign is None:
            return function("maximum", a, b)
        difference = a - b
        return 0.5 * (a + b + sign(difference) * difference)

    sign_function = sign or sign_of
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

    def convert_operation(
        name: str, operands: list[tuple[Expr, Expr]]
    ) -> tuple[Expr, Expr]:
        """Return the full and the reduced value of an operation.

        A reduced value differs from the full value by a number of whole revolutions. An
        angle of many revolutions has fewer exact digits than a reduced angle. Sines,
        cosines and tangents are the same at both, so they are computed from the reduced
        values of their operands. All other operations compute their full value from full
        values.

        Parameters
        ----------
        name
            Name of the operation, such as "+" or "sin".
        operands
            Full and reduced value of each operand.
        """
        full_operands, reduced_operands = zip(*operands, strict=True)
        # Operands are numbers or nodes of the graph. A denominator that is the number 0 is
        # an error. A node, which may be zero at some values of its variables, differs from
        # 0.0 in this comparison.
        # In the message an expression without text is called a load.
        if name == "/" and full_operands[1] == 0.0:
            subject = f'"{expression.text}"' if expression.text else "a load"
            raise EngineError(f"{subject} divides by an expression that is zero everywhere")
        is_periodic = name in PERIODIC_FUNCTIONS
        arguments = reduced_operands if is_periodic else full_operands
        # All operations that are not in `operations`, such as "sin", are functions by name.
        if name in operations:
            full_result = operations[name](*arguments)
        else:
            full_result = function(name, *arguments)
        # Sums of reduced values differ from the full result by whole revolutions. So do
        # products of an angle x and an integer number k: k (x - n turns) is k x, less k n
        # turns. (Numbers are not reduced.)
        is_integer_multiple = name == "*" and any(
            isinstance(x, float) and x % 1.0 == 0.0 for x in full_operands
        )
        if name in PRESERVES_WHOLE_REVOLUTIONS or is_integer_multiple:
            return full_result, operations[name](*reduced_operands)
        # The reduced value of any other result is the full value.
        return full_result, full_result

    # Both values of a number are the number itself.
    full_value, _ = fold(
        expression.root, lambda x: (x, x), nodes_by_name.__getitem__, convert_operation
    )
    return full_value
