"""Compilation of symbolic expressions to machine code by heyoka.

heyoka is optional. It is imported only here, and only when a function needs it.
"""

import operator
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from types import ModuleType
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Array
from spherekit.errors import EngineError
from spherekit.symbolic.expression_evaluation import ArrayFunction
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, rewrite

EngineChoice = Literal["auto", "numpy", "compiled"]
"""What evaluates expressions: NumPy, heyoka, or whichever of the two is expected to
take less time."""

ENGINE_CHOICES: tuple[EngineChoice, ...] = ("auto", "numpy", "compiled")
"""All values of `EngineChoice`."""

_PYTHON_OPERATORS = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
}


def available() -> bool:
    """Return whether heyoka is installed."""
    return find_spec("heyoka") is not None


def heyoka() -> ModuleType:
    """Return the module heyoka, a compiler of expressions and Taylor integrators.

    Raises
    ------
    EngineError
        If it is not installed, or if its import fails.
    """
    try:
        import heyoka as heyoka_module
    except ImportError as error:
        fault = (
            f"the compiled engine needs heyoka, which does not import ({error}); "
            'install it with pip install "spherekit-mechanisms[compiled]" (Linux) or '
            "conda-forge"
        )
        advice = "or use the NumPy engine, which gives the same results"
        raise EngineError(fault, advice) from None
    module: ModuleType = heyoka_module
    return module


def heyoka_variables(variables: Sequence[ExpressionNode]) -> dict[ExpressionNode, Any]:
    """Return the heyoka variable of the same name for each variable."""
    return {variable: heyoka().expression(variable.arguments[0]) for variable in variables}


def heyoka_expressions(
    expressions: Sequence[Expr], variables: Mapping[ExpressionNode, Any]
) -> list[Any]:
    """Convert symbolic expressions to expressions of the library heyoka.

    Parameters
    ----------
    expressions
        Numbers, and nodes of expression graphs.
    variables
        For each variable in them, heyoka's expression: a variable, a parameter or the time.
    """
    module = heyoka()

    def convert_node(node: ExpressionNode, arguments: list[Any]) -> Any:
        """Return the heyoka expression of a node: a variable, or an operation.

        `arguments` are the heyoka expressions of the arguments of the node.
        """
        if node.operation == "variable":
            return variables[node]
        # heyoka has no functions sign and maximum. select(c, a, b) is a if c is true, else
        # b.
        if node.operation == "sign":
            (value,) = arguments
            plus_one = module.expression(1.0)
            zero = module.expression(0.0)
            # The sign of 0 is 0, and that of NaN is NaN, as in NumPy.
            minus_one_or_value = module.select(module.lt(value, zero), -plus_one, value)
            return module.select(module.gt(value, zero), plus_one, minus_one_or_value)
        if node.operation == "maximum":
            a, b = arguments
            # Both comparisons are false if a or b is NaN. The sum is NaN then.
            b_or_nan = module.select(module.gte(b, a), b, a + b)
            return module.select(module.gt(a, b), a, b_or_nan)
        # Operators such as + can be applied to heyoka expressions. All other functions have
        # the same name in heyoka.
        if node.operation in _PYTHON_OPERATORS:
            return _PYTHON_OPERATORS[node.operation](*arguments)
        function = getattr(module, node.operation)
        return function(*arguments)

    return rewrite(expressions, module.expression, convert_node)


def compile_function(
    outputs: Sequence[Expr],
    inputs: Sequence[ExpressionNode],
    compact: bool = False,
) -> ArrayFunction:
    """Compile expressions to machine code, in a function that evaluates them on arrays.

    The library heyoka compiles. The function maps an array (inputs, n) to an array
    (outputs, n), where n is the number of points of evaluation.

    Parameters
    ----------
    outputs
        Expressions that contain no other variables than the inputs.
    inputs
        Variables, in the order of the first axis of the argument.
    compact
        Whether heyoka writes shorter code, which compiles faster and runs more slowly.
    """
    variables = heyoka_variables(inputs)
    compiled_function = heyoka().cfunc(
        heyoka_expressions(outputs, variables),
        list(variables.values()),
        compact_mode=compact,
    )

    def evaluate(inputs_array: Array, out: Array | None = None) -> Any:
        """Return the outputs (outputs, n), which are written to `out` if it is given."""
        return compiled_function(np.ascontiguousarray(inputs_array), outputs=out)

    return evaluate
