"""Newton's method for the closure equations of many designs, at real or complex variables.

The sizes of a design are real numbers. The variables of the pairs, inputs included, may be
complex: the closure equations are analytic, and their solutions neither meet nor disappear
if the inputs are not real.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

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

ComplexParts = tuple[Expr, Expr]
"""The real and the imaginary part of a complex expression."""


ComplexFunction = Callable[[Array, Floats], Array]
"""A function of complex variables (variables, n) and real numbers (k, n).

It returns complex values (outputs, n).
"""


def complex_function(
    outputs: Sequence[Expr],
    variables: Sequence[ExpressionNode],
    numbers: Sequence[ExpressionNode],
    compiled: bool,
) -> ComplexFunction:
    """Return expressions as a function of complex variables and real numbers.

    Parameters
    ----------
    outputs
        Expressions of `variables` and `numbers`.
    variables
        The variables whose values are complex.
    numbers
        The variables whose values are real.
    compiled
        Whether heyoka compiles the function. It knows real numbers only, so the real and
        the imaginary parts become expressions of their own.

    Returns
    -------
    A function of complex (variables, n) and real (numbers, n) values. It returns complex
    values (outputs, n).

    Raises
    ------
    KeyError
        If an expression to be compiled has an operation that is not in `_OPERATIONS`.
    """
    if not compiled:
        complex_array_function = array_function(outputs, [*variables, *numbers], complex)
        return lambda values, real_numbers: complex_array_function(
            np.concatenate([values, real_numbers.astype(complex)])
        )
    real = symbols(f"real_{k}" for k in range(len(variables)))
    imaginary = symbols(f"imaginary_{k}" for k in range(len(variables)))
    parts_by_variable = dict(zip(variables, zip(real, imaginary, strict=True), strict=True))

    def apply(node: ExpressionNode, arguments: list[ComplexParts]) -> ComplexParts:
        """Return the real and the imaginary part of a node from those of its arguments."""
        if node.operation == "variable":
            return parts_by_variable.get(node, (node, 0.0))
        return _OPERATIONS[node.operation](*arguments)

    output_parts = rewrite(outputs, lambda number: (number, 0.0), apply)
    real_parts = [part for part, _ in output_parts]
    imaginary_parts = [part for _, part in output_parts]
    real_function = compile_function(
        [*real_parts, *imaginary_parts], [*real, *imaginary, *numbers]
    )

    def evaluate(values: Array, real_numbers: Floats) -> Array:
        """Return the outputs, whose parts the compiled function computes one by one."""
        rows = real_function(np.concatenate([values.real, values.imag, real_numbers]))
        results = np.empty((len(outputs), values.shape[1]), dtype=complex)
        results.real = rows[: len(outputs)]
        results.imag = rows[len(outputs) :]
        return results

    return evaluate


def _add(x: ComplexParts, y: ComplexParts) -> ComplexParts:
    """Return the parts of x + y."""
    return x[0] + y[0], x[1] + y[1]


def _subtract(x: ComplexParts, y: ComplexParts) -> ComplexParts:
    """Return the parts of x - y."""
    return x[0] - y[0], x[1] - y[1]


def _multiply(x: ComplexParts, y: ComplexParts) -> ComplexParts:
    """Return the parts of (a + i b) (c + i d)."""
    a, b = x
    c, d = y
    return a * c - b * d, a * d + b * c


def _divide(x: ComplexParts, y: ComplexParts) -> ComplexParts:
    """Return the parts of (a + i b) / (c + i d)."""
    a, b = x
    c, d = y
    square = c * c + d * d
    return (a * c + b * d) / square, (b * c - a * d) / square


def _sine(angle: ComplexParts) -> ComplexParts:
    """Return the parts of sin(a + i b)."""
    a, b = angle
    return (
        function("sin", a) * function("cosh", b),
        function("cos", a) * function("sinh", b),
    )


def _cosine(angle: ComplexParts) -> ComplexParts:
    """Return the parts of cos(a + i b)."""
    a, b = angle
    return (
        function("cos", a) * function("cosh", b),
        -(function("sin", a) * function("sinh", b)),
    )


_OPERATIONS: Mapping[str, Callable[..., ComplexParts]] = {
    "+": _add,
    "-": _subtract,
    "*": _multiply,
    "/": _divide,
    "sin": _sine,
    "cos": _cosine,
}
"""The complex form of each operation that closure equations consist of."""


class NewtonStep(NamedTuple):
    """The closure equations of n configurations, linearised, with the inputs held.

    Attributes
    ----------
    change
        (variables, n) changes of the variables (rad) that close the loops to first order.
        The inputs do not change.
    determinant
        (n,) determinant of the equations. Its sign changes where two assembly modes meet.
    squared_residual
        (n,) square of the closure residual (rad2).
    """

    change: Array
    determinant: Array
    squared_residual: Array


class PathKernel:
    """Newton's method for the closure equations of all designs of one topology.

    First `prepare` computes what depends on the sizes of a design alone. Then `newton_step`
    evaluates the equations at configurations of this design.

    Parameters
    ----------
    expressions
        The mechanism as expressions of its variables, not of the signs of its dyads.
    compiled
        Whether heyoka compiles the equations, if it is installed.

    Attributes
    ----------
    variables
        Number of the variables of all pairs.
    driven
        Numbers of the variables of the inputs.
    prepare
        Function of sizes (sizes, n). It returns everything that does not depend on the
        configuration, (k, n).
    """

    def __init__(self, expressions: DesignExpressions, compiled: bool = True) -> None:
        """Write the Newton step as expressions, and make functions of them."""
        structure = expressions.structure
        coordinate_rates = expressions.coordinate_rates
        self.expressions = expressions
        self.compiled = compiled and available()
        self.variables = len(expressions.configuration_symbols)
        self.driven = [*structure.inputs]
        # The changes of all variables that close the loops to first order.
        change = coordinate_rates.solve_loops(coordinate_rates.closure_residuals)
        # Angles that gear ratios fix are set to what follows from the inputs.
        for variable, angle in enumerate(expressions.variables):
            if angle is not expressions.configuration_symbols[variable]:
                change[variable] = angle - expressions.configuration_symbols[variable]
        moving = [*expressions.configuration_symbols, *expressions.profile_symbols]
        # `prepared` are the parts of the expressions that depend on the sizes alone. The
        # scale of the rates is the determinant of the equations.
        self._outputs, prepared = separate_constant_parts(
            [*change, coordinate_rates.scale, coordinate_rates.closure_residual_square],
            moving,
        )
        self._arguments = [*moving, *prepared]
        self.prepare = expression_function(
            [*prepared.values()], expressions.size_symbols, self.compiled
        )
        self._evaluate_real = expression_function(
            self._outputs, self._arguments, self.compiled
        )

    @cached_property
    def _evaluate_complex(self) -> ComplexFunction:
        """The same outputs at complex variables; compiled when it is first needed."""
        variables = self.expressions.configuration_symbols
        numbers = self._arguments[self.variables :]
        return complex_function(self._outputs, variables, numbers, self.compiled)

    def mode_signs(self, values: Floats, sizes: Floats) -> list[str]:
        """Return the sign of each group at closed configurations.

        A group is a set of links that are placed together; a dyad is a group of two links
        with three R pairs. The sign of a dyad is that of the triple product of its axes,
        and tells in which of two ways the dyad is put together.

        Parameters
        ----------
        values
            (variables, n) pair variables (rad).
        sizes
            (sizes, n) sizes of the designs, as for `prepare`.

        Returns
        -------
        One text for each configuration with a sign for each group: ``+`` or ``-`` for
        dyads, ``~`` for other groups. An example is ``"+~"``.
        """
        coordinate_rates = self.expressions.coordinate_rates
        groups = self.expressions.structure.assembly.groups
        signs = np.full((len(groups), values.shape[1]), "~")
        for k, group in enumerate(groups):
            if group.is_dyad:
                # The axis of an R pair belongs to its only variable, which has index 0.
                axes = [
                    coordinate_rates.vectors[coordinate_rates.pair_variables[pair][0]]
                    for pair in group.pairs
                ]
                triple_product = dot(axes[0], cross(axes[1], axes[2]))
                evaluate = array_function(
                    [triple_product],
                    [
                        *self.expressions.configuration_symbols,
                        *self.expressions.size_symbols,
                    ],
                )
                is_positive = evaluate(np.concatenate([values, sizes]))[0] >= 0.0
                signs[k] = np.where(is_positive, "+", "-")
        return ["".join(column) for column in signs.T]

    def newton_step(self, values: Array, numbers: Floats) -> NewtonStep:
        """Return a step of Newton's method that closes the loops to first order.

        Parameters
        ----------
        values
            (variables, n) pair variables (rad), real or complex.
        numbers
            (k, n) columns of profiles, if there are some, followed by what `prepare`
            returns for the designs.

        Returns
        -------
        The changes of the variables, with the inputs held; the determinant of the
        equations; and the square of the closure residual.
        """
        if np.iscomplexobj(values):
            outputs = self._evaluate_complex(values, numbers)
        else:
            outputs = self._evaluate_real(np.concatenate([values, numbers]))
        return NewtonStep(
            change=outputs[: self.variables],
            determinant=outputs[-2],
            squared_residual=outputs[-1],
        )
