"""Exact derivatives of expressions by variables, as expressions."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    in_order,
    power,
)

_Chain = Callable[[ExpressionNode, Sequence[Expr], Sequence[Expr]], Expr]
"""The derivative of a node from its arguments and their derivatives."""


def _quotient(node: ExpressionNode, x: Sequence[Expr], dx: Sequence[Expr]) -> Expr:
    return (dx[0] - node * dx[1]) / x[1]


def _power(node: ExpressionNode, x: Sequence[Expr], dx: Sequence[Expr]) -> Expr:
    base, exponent = x
    total: Expr = exponent * power(base, exponent - 1.0) * dx[0]
    if isinstance(dx[1], ExpressionNode) or dx[1] != 0.0:
        total = total + node * function("log", base) * dx[1]
    return total


def _atan2(node: ExpressionNode, x: Sequence[Expr], dx: Sequence[Expr]) -> Expr:
    y, z = x
    return (z * dx[0] - y * dx[1]) / (y * y + z * z)


_DERIVATIVES: Mapping[str, _Chain] = {
    "+": lambda node, x, dx: dx[0] + dx[1],
    "-": lambda node, x, dx: dx[0] - dx[1],
    "*": lambda node, x, dx: dx[0] * x[1] + x[0] * dx[1],
    "/": _quotient,
    "**": _power,
    "sin": lambda node, x, dx: function("cos", x[0]) * dx[0],
    "cos": lambda node, x, dx: -1.0 * (function("sin", x[0]) * dx[0]),
    "tan": lambda node, x, dx: (1.0 + node * node) * dx[0],
    "asin": lambda node, x, dx: dx[0] / function("sqrt", 1.0 - x[0] * x[0]),
    "acos": lambda node, x, dx: -1.0 * dx[0] / function("sqrt", 1.0 - x[0] * x[0]),
    "atan": lambda node, x, dx: dx[0] / (1.0 + x[0] * x[0]),
    "atan2": _atan2,
    "sqrt": lambda node, x, dx: 0.5 * dx[0] / node,
    "exp": lambda node, x, dx: node * dx[0],
    "log": lambda node, x, dx: dx[0] / x[0],
    "tanh": lambda node, x, dx: (1.0 - node * node) * dx[0],
    "sign": lambda node, x, dx: 0.0,
}


def derivatives(items: Sequence[Expr], by: ExpressionNode) -> list[Expr]:
    """Return the derivatives of expressions by a variable; 0.0 of what is without it.

    Kinks and jumps have the derivative of the side they are on.
    """
    made: dict[ExpressionNode, Expr] = {}

    def of(item: Any) -> Expr:
        return made[item] if isinstance(item, ExpressionNode) else 0.0

    for node in in_order(items):
        if node.operation == "variable":
            made[node] = 1.0 if node is by else 0.0
            continue
        changes = [of(argument) for argument in node.arguments]
        if all(isinstance(change, float) and change == 0.0 for change in changes):
            made[node] = 0.0
        else:
            made[node] = _DERIVATIVES[node.operation](node, node.arguments, changes)
    return [of(item) for item in items]
