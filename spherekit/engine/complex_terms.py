"""Terms of complex variables as terms of their real and imaginary parts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.compiler import CompiledFunction, compile_function
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    rewrite,
    symbols,
)
from spherekit.sphere.rotation import Floats

Parts = tuple[Expr, Expr]
"""The real and the imaginary part."""


@final
@dataclass(frozen=True)
class ComplexFunction:
    """A compiled function of complex variables and real numbers, with complex values.

    `function` is of the variables' real parts, their imaginary parts, and the numbers; it
    gives real parts, then imaginary ones.
    """

    function: CompiledFunction

    def __call__(self, values: NDArray[Any], numbers: Floats) -> NDArray[Any]:
        """Return the values (outputs, n) at variables (variables, n), numbers (k, n)."""
        columns = self.function(np.concatenate([values.real, values.imag, numbers]))
        half = len(columns) // 2
        made = np.empty((half, values.shape[1]), dtype=complex)
        made.real, made.imag = columns[:half], columns[half:]
        return made


def compile_complex(
    outputs: Sequence[Expr],
    variables: Sequence[ExpressionNode],
    numbers: Sequence[ExpressionNode],
) -> ComplexFunction:
    """Compile expressions of variables that are complex, and of real numbers.

    Raises
    ------
    KeyError
        If a term is no sum, product, quotient, sine or cosine.
    """
    real = symbols(f"real_{k}" for k in range(len(variables)))
    imaginary = symbols(f"imaginary_{k}" for k in range(len(variables)))
    parts = dict(zip(variables, zip(real, imaginary, strict=True), strict=True))

    def apply(term: ExpressionNode, arguments: list[Parts]) -> Parts:
        if term.operation == "variable":
            return parts.get(term, (term, 0.0))
        return _OPERATIONS[term.operation](*arguments)

    made = rewrite(outputs, lambda number: (number, 0.0), apply)
    columns = [part[k] for k in (0, 1) for part in made]
    return ComplexFunction(compile_function(columns, [*real, *imaginary, *numbers]))


def _product(one: Parts, other: Parts) -> Parts:
    (a, b), (c, d) = one, other
    return a * c - b * d, a * d + b * c


def _quotient(one: Parts, other: Parts) -> Parts:
    (a, b), (c, d) = one, other
    square = c * c + d * d
    return (a * c + b * d) / square, (b * c - a * d) / square


def _sine(angle: Parts) -> Parts:
    a, b = angle
    return (
        function("sin", a) * function("cosh", b),
        function("cos", a) * function("sinh", b),
    )


def _cosine(angle: Parts) -> Parts:
    a, b = angle
    return (
        function("cos", a) * function("cosh", b),
        -(function("sin", a) * function("sinh", b)),
    )


_OPERATIONS: Mapping[str, Callable[..., Parts]] = {
    "+": lambda x, y: (x[0] + y[0], x[1] + y[1]),
    "-": lambda x, y: (x[0] - y[0], x[1] - y[1]),
    "*": _product,
    "/": _quotient,
    "sin": _sine,
    "cos": _cosine,
}
