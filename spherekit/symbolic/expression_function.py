"""The choice between compiled and interpreted evaluation of expressions."""

from collections.abc import Sequence

from spherekit.symbolic.compiler import compile_function
from spherekit.symbolic.expression_evaluation import ArrayFunction, array_function
from spherekit.symbolic.expression_graph import Expr, ExpressionNode


def expression_function(
    outputs: Sequence[Expr],
    inputs: Sequence[ExpressionNode],
    compiled: bool,
) -> ArrayFunction:
    """Return a function of arrays that evaluates expressions.

    The function maps an array (inputs, n), whose columns are n samples, to an array
    (outputs, n).

    Parameters
    ----------
    outputs
        The expressions to evaluate, which contain no other variables than `inputs`.
    inputs
        The variables, in the order of the first axis of the argument.
    compiled
        Whether heyoka compiles the expressions. Otherwise NumPy evaluates them operation by
        operation. NumPy is used in any case if there are no outputs.
    """
    if compiled and outputs:
        return compile_function(outputs, inputs)
    return array_function(outputs, inputs)
