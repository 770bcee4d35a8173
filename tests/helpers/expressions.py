"""Parsed expressions as plain functions."""

from spherekit.symbolic.expression_evaluation import float_function
from spherekit.symbolic.expression_graph import symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph


def expression_as_function(expression, names):
    """Return a parsed expression as a function of a row of floats.

    The floats of the row are the values of the variables in the order of `names`.
    """
    variables = symbols(names)
    terms_by_name = {
        name: (variable, variable) for name, variable in zip(names, variables, strict=True)
    }
    evaluate = float_function([convert_to_graph(expression, terms_by_name)], variables)
    return lambda row: evaluate(row)[0]
