"""Numbers of formulas that follow from the numbers of the mechanism file.

Formulas contain numbers of masses and loads, and angles of links that replace contacts. If
a number of the file is an argument of the formulas, some of these numbers depend on it. A
mass that the file states by axes of pairs is then an expression of the argument. Any other
number is a linear function of the argument, whose slope is found by trial.
"""

from collections.abc import Sequence
from copy import copy

import numpy as np

from spherekit.arrays import Floats
from spherekit.designs.design_variables import DesignVariable
from spherekit.designs.varied_mechanism import CONSTANT_SLOPE_TOLERANCE, VariedMechanism
from spherekit.errors import DesignError
from spherekit.exchange.varied_masses import express_masses
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    dot,
    substitute,
)
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.load_numbers import list_numbers, masses_and_loads
from spherekit.wording import listing

ZERO_SLOPE = 1e-13
"""Slopes that are smaller belong to numbers that do not change, in their units.

Larger: weak effects of a number are lost; smaller: rounding of a trial is written as an
effect.
"""


def express_dependent_numbers(
    varied_mechanism: VariedMechanism,
    design_expressions: DesignExpressions,
    arguments: Sequence[ExpressionNode],
) -> dict[ExpressionNode, Expr]:
    """Return expressions for numbers in formulas that depend on varied numbers of a file.

    The formulas contain these dependent numbers as symbols of their own: numbers that
    describe masses, loads and links that replace contacts. If a number of the file becomes
    an argument of the formulas, the dependent numbers have to follow it. The inertia of a
    mass that the file states by axes of pairs (joints) becomes an expression of the sizes
    of links. Any other number is a linear function of the numbers that vary. The slopes of
    the function are measured by changing these numbers.

    Parameters
    ----------
    varied_mechanism
        The mechanism, and the numbers of its file that vary.
    design_expressions
        The expressions that contain symbols for the dependent numbers.
    arguments
        Symbols of the numbers that vary, in rad or the units of the file.

    Returns
    -------
    For the symbol of each dependent number its expression.

    Raises
    ------
    DesignError
        If a number is no linear function of the numbers that vary, if this cannot be
        checked because the file allows too few other values, or if no number can vary.
    """
    # The list has the symbols of sizes first, then the symbols of dependent numbers.
    number_symbols = design_expressions.size_symbols[len(varied_mechanism.size_variables) :]
    if not len(number_symbols):
        return {}
    document = varied_mechanism.document
    variables = varied_mechanism.variables
    if not varied_mechanism.can_vary:
        raise DesignError(
            f"{document.name}: {listing(variable.key for variable in variables)}: the file "
            "allows no other value, because other numbers of the file determine it; vary "
            "those other numbers"
        )
    masses = express_masses(
        document,
        design_expressions.mechanism,
        design_expressions.structure.pairs,
        {
            variable.path: argument
            for variable, argument in zip(variables, arguments, strict=True)
        },
    )
    equivalent_linkage = varied_mechanism.equivalent_linkage
    contact_numbers = equivalent_linkage.numbers if equivalent_linkage else []
    mechanism = design_expressions.mechanism
    # The masses are set past the constructor, which could not check expressions.
    symbolic_mechanism = copy(mechanism)
    object.__setattr__(symbolic_mechanism, "masses", masses)
    symbolic_numbers = [
        *contact_numbers,
        *list_numbers(masses_and_loads(symbolic_mechanism)),
    ]
    file_numbers = [*contact_numbers, *list_numbers(masses_and_loads(mechanism))]
    # (variables, designs, numbers) slopes of all numbers with respect to each variable, at
    # the design of the file and at some designs near it.
    trial_slopes = np.stack(
        [varied_mechanism.trial_slopes(k) for k in range(len(variables))]
    )
    expression_by_symbol: dict[ExpressionNode, Expr] = {}
    # `number` is the position of a dependent number in both lists, and `slopes` (variables,
    # designs) are its slopes.
    for symbol, number, slopes in zip(
        number_symbols,
        varied_mechanism.varied_numbers,
        np.moveaxis(trial_slopes, 2, 0),
        strict=True,
    ):
        if isinstance(symbolic_numbers[number], ExpressionNode):
            # The expression may contain symbols of contact numbers, whose expressions are
            # known already.
            (expression_by_symbol[symbol],) = substitute(
                [symbolic_numbers[number]], expression_by_symbol
            )
            continue
        _check_linear(varied_mechanism, slopes)
        # The expression is number in the file + slopes . (arguments - their values there).
        # Slopes are converted to the units of the arguments.
        first_slopes = slopes[:, 0]
        slope_row = (
            np.where(np.abs(first_slopes) < ZERO_SLOPE, 0.0, first_slopes)
            / varied_mechanism.unit_scales
        )
        argument_values = varied_mechanism.unit_scales * varied_mechanism.nominal_values
        constant = float(file_numbers[number] - slope_row @ argument_values)
        expression_by_symbol[symbol] = dot(
            [*slope_row.tolist(), 1.0], [*arguments, constant]
        )
    return expression_by_symbol


def _check_linear(varied_mechanism: VariedMechanism, slopes: Floats) -> None:
    """Raise `DesignError` unless a number in formulas depends linearly on the variables.

    The variables are numbers of the mechanism file that vary, such as a radius. Numbers in
    the formulas, such as a component of an inertia tensor, depend on them. The formulas can
    only express a linear dependence, with the same slopes at all values of the variables.

    Parameters
    ----------
    varied_mechanism
        The mechanism, and the numbers of its file that vary.
    slopes
        (variables, designs) slopes of one number in the formulas with respect to each
        variable. A design is a set of values of the variables; the first one has the values
        of the file.

    Raises
    ------
    DesignError
        If the dependence is not linear, or if there is no second design to compare with.
    """
    file_name = varied_mechanism.document.name
    variables = varied_mechanism.variables
    differences = np.abs(slopes - slopes[:, :1])
    # A relative tolerance would be too strict for zero slopes, which have rounding errors.
    tolerance = CONSTANT_SLOPE_TOLERANCE * np.abs(slopes) + ZERO_SLOPE
    is_nonlinear = ~np.all(differences <= tolerance, axis=1)
    if np.any(is_nonlinear):
        refused = [variables[index] for index in np.flatnonzero(is_nonlinear)]
        raise DesignError(
            f"{file_name}: {listing(variable.key for variable in refused)}: cannot be "
            "varied, because the formulas contain values that were computed from "
            f"{'this number' if len(refused) == 1 else 'these numbers'} and do not depend "
            f"linearly on {_vary_other_keys(refused)}"
        )
    # Without a second design, nothing was compared above.
    if slopes.shape[1] == 1:
        raise DesignError(
            f"{file_name}: {listing(variable.key for variable in variables)}: cannot be "
            "varied, because the file allows too few other values to check that values in "
            f"the formulas depend linearly on {_vary_other_keys(variables)}"
        )


def _vary_other_keys(refused: Sequence[DesignVariable]) -> str:
    """Return the end of a message about numbers that cannot be arguments of formulas.

    It refers to the numbers as "it" or "them", and says what to vary instead.
    """
    pronoun = "it" if len(refused) == 1 else "them"
    advice = f"{pronoun}; vary other keys"
    # A single coordinate changes the length of the unit vector, which angles do not.
    if any("centre_xyz" in variable.path for variable in refused):
        advice += (
            ", or write centre_lonlat in place of centre_xyz and vary one of its angles"
        )
    return advice
