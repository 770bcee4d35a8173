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
    """Return a function that evaluates expressions at complex values of some variables.

    The closure equations are solved at complex inputs, where their solutions neither meet
    nor disappear.

    Parameters
    ----------
    outputs
        The expressions, which depend on `variables` and `numbers`.
    variables
        Symbols that have complex values.
    numbers
        Symbols that have real values.
    compiled
        Whether the library heyoka compiles the function. heyoka computes with real numbers
        only, so each expression is split into its real and its imaginary part. If false,
        NumPy evaluates the expressions with complex numbers.

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

    # Two real symbols stand for each complex variable.
    real = symbols(f"real_{k}" for k in range(len(variables)))
    imaginary = symbols(f"imaginary_{k}" for k in range(len(variables)))
    parts_by_variable = dict(zip(variables, zip(real, imaginary, strict=True), strict=True))

    def split_node(node: ExpressionNode, arguments: list[ComplexParts]) -> ComplexParts:
        """Return the real and the imaginary part of a node from the parts of its arguments.

        A node is a variable, or an operation such as "*" with its arguments.
        """
        if node.operation == "variable":
            # One of `numbers` is real: its imaginary part is 0.
            return parts_by_variable.get(node, (node, 0.0))
        # An operation returns the two parts of its result, from the parts of its arguments.
        return _OPERATIONS[node.operation](*arguments)

    def split_constant(number: float) -> ComplexParts:
        return number, 0.0

    # `rewrite` replaces all nodes, from the variables and constants to the outputs.
    output_parts = rewrite(outputs, split_constant, split_node)
    real_parts = [real_part for real_part, _ in output_parts]
    imaginary_parts = [imaginary_part for _, imaginary_part in output_parts]
    real_function = compile_function(
        [*real_parts, *imaginary_parts], [*real, *imaginary, *numbers]
    )

    def evaluate(values: Array, real_numbers: Floats) -> Array:
        """Return the values of the expressions at complex values of the variables.

        The compiled function has real arguments only, so it takes the real and imaginary
        parts of the variables as separate arguments. It returns the parts of the results.

        Parameters
        ----------
        values
            (variables, n) complex values of the variables.
        real_numbers
            (numbers, n) values of the other arguments, which are real.

        Returns
        -------
        (outputs, n) complex values of the expressions.
        """
        # Real parts of all outputs, then imaginary parts.
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
    """A step of Newton's method for the loop-closure equations, at n configurations.

    The equations say that the product of all rotations around a loop of links is the
    identity. The equations are solved for the variables of the pairs (joints), at constant
    inputs.

    Attributes
    ----------
    change
        (variables, n) changes of the variables (rad) that solve the linearised equations.
        The inputs do not change.
    determinant
        (n,) determinant of the linearised equations. Its sign changes where two assembly
        modes (ways to assemble the mechanism) meet.
    squared_residual
        (n,) square of the norm of the closure errors (rad2), before the step.
    """

    change: Array
    determinant: Array
    squared_residual: Array


class StepExpressions(NamedTuple):
    """A step of Newton's method as expressions, with the same fields as `NewtonStep`."""

    change: Sequence[Expr]
    determinant: Expr
    squared_residual: Expr


def _newton_step_expressions(expressions: DesignExpressions) -> StepExpressions:
    """Return one step of Newton's method that closes the loops of links, as expressions.

    The result has the change of each pair (joint) variable, the determinant of the
    linearised equations, and the squared closure error. The change of an input is 0.
    """
    coordinate_rates = expressions.coordinate_rates
    # Solve the linearised equations, with the small gaps (residuals) of the loops of links
    # on the right-hand side. The result is what is added to each variable to close the
    # loops, while the inputs rest.
    change = coordinate_rates.solve_loops(coordinate_rates.closure_residuals)
    # A gear that the inputs drive has an angle that is a linear function of the inputs.
    # The other variables are just symbols. The change of the gear leads from its present
    # angle (its symbol) to the value of the function.
    symbols_and_angles = zip(
        expressions.configuration_symbols, expressions.variables, strict=True
    )
    for index, (symbol, angle) in enumerate(symbols_and_angles):
        is_driven_gear = angle is not symbol
        if is_driven_gear:
            change[index] = angle - symbol
    # `scale` is the determinant of the linearised equations.
    return StepExpressions(
        change,
        determinant=coordinate_rates.scale,
        squared_residual=coordinate_rates.closure_residual_square,
    )


class PathKernel:
    """Newton's method for the loop closure equations of designs with equal links and pairs.

    First `prepare` computes what depends only on the sizes of a design. Then `newton_step`
    evaluates the equations at configurations of this design.

    Parameters
    ----------
    expressions
        The mechanism as expressions of the variables of its pairs (joints). The expressions
        must not be in closed form.
    compiled
        Whether heyoka compiles the equations, if it is installed.

    Attributes
    ----------
    variable_count
        Number of the variables of all pairs.
    driven
        Indices of the variables that are inputs.
    prepare
        Function of sizes (sizes, n). It returns everything that does not depend on the
        configuration, (k, n).
    """

    def __init__(self, expressions: DesignExpressions, compiled: bool = True) -> None:
        """Create the functions that compute Newton steps of the loop-closure equations.

        Newton's method follows configurations of many designs (choices of sizes) along
        paths. Some lead through complex configurations, so that no two paths meet.

        Parameters
        ----------
        expressions
            The closure equations of a mechanism, as expressions of its pair (joint)
            variables (`configuration_symbols`) and of its sizes.
        compiled
            Whether the library heyoka compiles the functions, if it is installed.
        """
        variable_symbols = expressions.configuration_symbols
        self.expressions = expressions
        self.compiled = compiled and available()
        self.variable_count = len(variable_symbols)
        # Indices of the variables that are inputs.
        self.driven = [*expressions.structure.inputs]

        # The outputs of the compiled functions, in the order in which `newton_step` reads
        # them: changes of the variables, the determinant of the equations (0 at a
        # singularity), and how far the loops are from being closed.
        step = _newton_step_expressions(expressions)
        outputs = [*step.change, step.determinant, step.squared_residual]
        # Symbols of values that change along a path: the pair variables, and the geometry
        # (tangent, point, curvature) of contact curves that are not circles.
        moving = [*variable_symbols, *expressions.profile_symbols]
        # Parts that depend only on the sizes are replaced by symbols. `prepare` computes
        # these parts once for each design.
        self._outputs, expression_by_symbol = separate_constant_parts(outputs, moving)
        prepared_symbols = [*expression_by_symbol]
        prepared_expressions = [*expression_by_symbol.values()]
        # The order of the arguments: pair variables, geometry of contact curves, prepared
        # numbers.
        self._arguments = [*moving, *prepared_symbols]
        self.prepare = expression_function(
            prepared_expressions, expressions.size_symbols, self.compiled
        )
        # The function for real configurations. `_evaluate_complex` is the one for complex
        # configurations.
        self._evaluate_real = expression_function(
            self._outputs, self._arguments, self.compiled
        )

    @cached_property
    def _evaluate_complex(self) -> ComplexFunction:
        """The same outputs at complex variables; compiled when it is first needed."""
        variables = self.expressions.configuration_symbols
        numbers = self._arguments[self.variable_count :]
        return complex_function(self._outputs, variables, numbers, self.compiled)

    def mode_signs(self, values: Floats, sizes: Floats) -> list[str]:
        """Return the sign of each group of links at closed configurations.

        The signs distinguish assembly modes (ways to assemble the mechanism). A group
        consists of links whose positions are found together. A dyad is a group of two links
        with three revolute pairs, and can be assembled in two ways. The sign of the triple
        product ``a . (b x c)`` of its three axes tells which way. At a singularity the
        product is zero, and ``+`` is returned.

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
        argument_symbols = [
            *self.expressions.configuration_symbols,
            *self.expressions.size_symbols,
        ]
        groups = self.expressions.structure.assembly.groups
        # (groups, n) characters.
        signs = np.full((len(groups), values.shape[1]), "~")
        for k, group in enumerate(groups):
            if not group.is_dyad:
                continue
            # A revolute pair has one variable, and its vector is the axis.
            axes = []
            for pair in group.pairs:
                (variable,) = coordinate_rates.pair_variables[pair]
                axes.append(coordinate_rates.vectors[variable])
            triple_product = dot(axes[0], cross(axes[1], axes[2]))
            evaluate = array_function([triple_product], argument_symbols)
            is_positive = evaluate(np.concatenate([values, sizes]))[0] >= 0.0
            signs[k] = np.where(is_positive, "+", "-")
        return ["".join(signs_of_configuration) for signs_of_configuration in signs.T]

    def newton_step(self, values: Array, numbers: Floats) -> NewtonStep:
        """Return one step of Newton's method for the loop-closure equations.

        The step belongs to n configurations on the paths that are followed. The equations
        are linearised at these configurations. The inputs stay constant.

        Parameters
        ----------
        values
            (variables, n) pair (joint) variables in rad before the step. They are complex
            on paths that lead through complex configurations.
        numbers
            (k, n) the other numbers in the equations, which are real. First come the
            tangent, point and curvature of contact curves, if these are not circles. Then
            come the numbers that `prepare` computes from the sizes of the mechanism.

        Returns
        -------
        The changes of the variables, the determinant of the closure equations, and their
        squared residual before the step.
        """
        # The complex function takes the complex and the real numbers separately.
        if np.iscomplexobj(values):
            outputs = self._evaluate_complex(values, numbers)
        else:
            outputs = self._evaluate_real(np.concatenate([values, numbers]))
        return NewtonStep(
            change=outputs[: self.variable_count],
            determinant=outputs[-2],
            squared_residual=outputs[-1],
        )
