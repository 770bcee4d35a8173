"""Expressions as a function of arrays, compiled or run by NumPy."""

from collections.abc import Sequence
from typing import Any

from spherekit.symbolic.compiler import compile_function
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    TermFunction,
    array_function,
)


def term_function(
    outputs: Sequence[Expr],
    inputs: Sequence[ExpressionNode],
    compiled: bool,
    number: type[Any] = float,
    compact: bool = False,
) -> TermFunction:
    """Return expressions as a function; there is nothing to compile where none is."""
    if compiled and outputs:
        return compile_function(outputs, inputs, compact, number)
    return array_function(outputs, inputs, number)
