"""Derivatives of symbolic expressions by the chain rule."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    negated_operand,
    power,
    rewrite,
    sign_of,
    vector_product,
)


def differentiate(
    expressions: Sequence[Expr], rates: Mapping[ExpressionNode, Expr]
) -> list[Expr]:
    """Return the derivatives of expressions by the chain rule.

    All derivatives are with respect to one parameter, such as the time. If both arguments
    of a maximum are equal, its derivative is the mean of their derivatives. The derivative
    of a sign is 0 everywhere, even at the jump.

    Parameters
    ----------
    expressions
        Numbers, and nodes of expression graphs. A node is a variable or an operation.
    rates
        Known derivatives of variables or of whole operations, by node. The arguments of a
        known operation are not differentiated. Variables without an item have the
        derivative zero.
    """
    # If the derivative of a node -1 * x is known, the derivative of x is added. Graphs
    # store (-1 * x) * y as -1 * (x * y), in which x occurs without its sign.
    known_rates: dict[Any, Expr] = {}
    for node, rate in rates.items():
        negated_node = negated_operand(node)  # None if the node is not -1 * x
        if negated_node is not None:
            known_rates[negated_node] = -1.0 * rate
    known_rates |= rates

    def differentiate_node(node: ExpressionNode, argument_rates: list[Expr]) -> Expr:
        """Return the derivative of a node, from the derivatives of its arguments."""
        if node in known_rates:
            return known_rates[node]
        # If the derivatives of all arguments are the number 0.0, so is that of the node.
        # For `any`, 0.0 counts as false, and a node counts as true.
        if not any(argument_rates):
            return 0.0
        return _CHAIN_RULES[node.operation](node, node.arguments, argument_rates)

    return rewrite(expressions, lambda number: 0.0, differentiate_node)


_ChainRule = Callable[[ExpressionNode, Sequence[Expr], Sequence[Expr]], Expr]
"""The derivative of a node, from the node, its arguments x and their derivatives dx."""


def _differentiate_power(
    node: ExpressionNode, x: Sequence[Expr], dx: Sequence[Expr]
) -> Expr:
    """Return d(b ** p) = p b ** (p - 1) db + b ** p log(b) dp."""
    base, exponent = x
    total: Expr = exponent * power(base, exponent - 1.0) * dx[0]
    if dx[1] != 0.0:
        total = total + node * function("log", base) * dx[1]
    return total


def _differentiate_vector_product(
    node: ExpressionNode, x: Sequence[Expr], dx: Sequence[Expr]
) -> Expr:
    """Return the derivative of a dot or cross product of two vectors."""
    first = vector_product(node.operation, dx[0], x[1])
    return first + vector_product(node.operation, x[0], dx[1])


_CHAIN_RULES: Mapping[str, _ChainRule] = {
    "+": lambda node, x, dx: dx[0] + dx[1],
    "-": lambda node, x, dx: dx[0] - dx[1],
    "*": lambda node, x, dx: dx[0] * x[1] + x[0] * dx[1],
    "/": lambda node, x, dx: (dx[0] - node * dx[1]) / x[1],
    "**": _differentiate_power,
    "sin": lambda node, x, dx: function("cos", x[0]) * dx[0],
    "cos": lambda node, x, dx: -1.0 * (function("sin", x[0]) * dx[0]),
    "tan": lambda node, x, dx: (1.0 + node * node) * dx[0],
    "asin": lambda node, x, dx: dx[0] / function("sqrt", 1.0 - x[0] * x[0]),
    "acos": lambda node, x, dx: -1.0 * dx[0] / function("sqrt", 1.0 - x[0] * x[0]),
    "atan": lambda node, x, dx: dx[0] / (1.0 + x[0] * x[0]),
    "atan2": lambda node, x, dx: (
        (x[1] * dx[0] - x[0] * dx[1]) / (x[0] * x[0] + x[1] * x[1])
    ),
    "sqrt": lambda node, x, dx: 0.5 * dx[0] / node,
    "exp": lambda node, x, dx: node * dx[0],
    "log": lambda node, x, dx: dx[0] / x[0],
    "tanh": lambda node, x, dx: (1.0 - node * node) * dx[0],
    "dot": _differentiate_vector_product,
    "cross": _differentiate_vector_product,
    "norm": lambda node, x, dx: vector_product("dot", x[0], dx[0]) / node,
    "sign": lambda node, x, dx: 0.0,
    "maximum": lambda node, x, dx: (
        0.5 * ((1.0 + sign_of(x[0] - x[1])) * dx[0] + (1.0 - sign_of(x[0] - x[1])) * dx[1])
    ),
}
"""The chain rule of each operation and function."""
