"""The closure equations of designs at any input, real or complex.

Sizes are real. The variables, the inputs among them, may be complex: the equations are
analytic, and off the real axis their solutions neither meet nor vanish.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.symbolic.compiler import available, compile_function
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.symbolic.expression_function import expression_function
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    dot,
    function,
    rewrite,
    separate_constant_parts,
    symbols,
)
from spherekit.symbolic.vector_algebra import cross
from spherekit.velocities.design_expressions import DesignExpressions

Parts = tuple[Expr, Expr]
"""The real and the imaginary part."""


ComplexFunction = Callable[[Array, Floats], Array]
"""Gives values (outputs, n) at complex variables (variables, n) and numbers (k, n)."""


def complex_function(
    outputs: Sequence[Expr],
    variables: Sequence[ExpressionNode],
    numbers: Sequence[ExpressionNode],
    compiled: bool,
) -> ComplexFunction:
    """Return expressions of variables that are complex, and of real numbers.

    Raises
    ------
    KeyError
        If a term to be compiled is no sum, product, quotient, sine or cosine.
    """
    if not compiled:
        plain = array_function(outputs, [*variables, *numbers], complex)
        return lambda values, given: plain(np.concatenate([values, given.astype(complex)]))
    real = symbols(f"real_{k}" for k in range(len(variables)))
    imaginary = symbols(f"imaginary_{k}" for k in range(len(variables)))
    parts = dict(zip(variables, zip(real, imaginary, strict=True), strict=True))

    def apply(term: ExpressionNode, arguments: list[Parts]) -> Parts:
        if term.operation == "variable":
            return parts.get(term, (term, 0.0))
        return _OPERATIONS[term.operation](*arguments)

    made = rewrite(outputs, lambda number: (number, 0.0), apply)
    columns = [part[k] for k in (0, 1) for part in made]
    by_parts = compile_function(columns, [*real, *imaginary, *numbers])

    def at(values: Array, given: Floats) -> Array:
        rows = by_parts(np.concatenate([values.real, values.imag, given]))
        made = np.empty((len(outputs), values.shape[1]), dtype=complex)
        made.real, made.imag = rows[: len(outputs)], rows[len(outputs) :]
        return made

    return at


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


NewtonStep = tuple[Array, Array, Array]
"""Newton's step (variables, n) at n places, the inputs held, the determinant (n,) of the
equations, and the square (n,) of how far loops are open."""


class PathKernel:
    """Newton's step of a topology whose sizes are inputs, at real and complex variables.

    `terms` are of variables, not of signs. `prepare` takes the sizes (sizes, n) to what is
    the same at all samples of a design, `at` the variables, the columns of profiles that
    are handed in, and these to `NewtonStep`. `driven` are the variables of the inputs.
    """

    def __init__(self, terms: DesignExpressions, compiled: bool = True) -> None:
        structure, flow, places = (
            terms.structure,
            terms.coordinate_rates,
            terms.configuration_symbols,
        )
        self.terms, self.compiled = terms, compiled and available()
        self.variables, self.driven = len(places), [*structure.inputs]
        change = flow.solve_loops(flow.closure_residuals)
        for variable, angle in enumerate(terms.variables):
            if angle is not places[variable]:
                change[variable] = angle - places[variable]
        given = [*places, *terms.profile_symbols]
        self._rows, fixed = separate_constant_parts(
            [*change, flow.scale, flow.closure_residual_square], given
        )
        self._inputs = [*given, *fixed]
        self.prepare = expression_function(
            [*fixed.values()], terms.size_symbols, self.compiled
        )
        self._real = expression_function(self._rows, self._inputs, self.compiled)

    @cached_property
    def _complex(self) -> ComplexFunction:
        places, numbers = self.terms.configuration_symbols, self._inputs[self.variables :]
        return complex_function(self._rows, places, numbers, self.compiled)

    def labels(self, values: Floats, sizes: Floats) -> list[str]:
        """Return the signs of dyads, ``~`` for other groups, at closed configurations."""
        groups, flow = self.terms.structure.assembly.groups, self.terms.coordinate_rates
        labels = np.full((len(groups), values.shape[1]), "~")
        for k, group in enumerate(groups):
            if group.is_dyad:
                axes = [flow.vectors[flow.pair_variables[pair][0]] for pair in group.pairs]
                turning = dot(axes[0], cross(axes[1], axes[2]))
                made = array_function(
                    [turning], [*self.terms.configuration_symbols, *self.terms.size_symbols]
                )
                positive = made(np.concatenate([values, sizes]))[0] >= 0.0
                labels[k] = np.where(positive, "+", "-")
        return ["".join(column) for column in labels.T]

    def at(self, values: Array, prepared: Floats) -> NewtonStep:
        """Return what the equations are at values (variables, n) and prepared (k, n)."""
        if np.iscomplexobj(values):
            columns = self._complex(values, prepared)
        else:
            columns = self._real(np.concatenate([values, prepared]))
        return columns[: self.variables], columns[-2], columns[-1]
