"""Stored functions as formulas: reduced models and contact profiles as series."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from spherekit.dynamics.reduced_model import StoredModel
from spherekit.exchange.formula_expressions import (
    Argument,
    Formulas,
    Mode,
    ModeTable,
    SeriesTable,
)
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.symbolic.expression_graph import ExpressionNode, substitute, symbols
from spherekit.velocities.axis_rotations import ProfileSide


def reduced_formulas(mechanism: Mechanism, model: StoredModel) -> Formulas:
    """Return a reduced model of one coordinate as formulas, for export as source code.

    A reduced model stores the inertia, its derivative and the pair variables along one
    configuration curve as series of one coordinate. The results of the formulas are these
    functions and the driving torque. The arguments of the formulas are the motion that a
    user gives: the coordinate, its rate and acceleration, and the time. If the mechanism
    file states the torque of a load by a table, the present torque of this load is a
    further argument.

    Parameters
    ----------
    mechanism
        The mechanism of the model.
    model
        The reduced model, along one configuration curve.
    """
    # The model stores its functions in groups. Group 0 has the functions of the motion.
    # Their names and units are in the heading, their series in the model.
    heading = model.heading
    series: Any = model.groups[0]
    unit_by_result = {function.name: function.unit for function in heading.groups[0]}
    # The arguments. `heading.by` has the name of the only coordinate. `motion_symbols` are
    # its rate, its acceleration, the time, and a torque for each of `heading.tables`, the
    # torque tables.
    (coordinate,) = symbols(heading.by)
    motion_symbols = (coordinate, *heading.motion_symbols)
    motion_units = ("rad", "rad/s", "rad/s2", "s", *["N m"] * len(heading.tables))
    # The only argument of the node of a symbol is its name.
    motion = tuple(
        Argument(symbol.arguments[0], unit)
        for symbol, unit in zip(motion_symbols, motion_units, strict=True)
    )
    # The formulas have a symbol for each function. The table gives the values of the
    # functions. The range of the table begins at the least coordinate, so the coordinate
    # needs no offset (`start`).
    series_symbols = tuple(symbols(unit_by_result))
    # `heading.torques` is the driving torque as an expression of the symbols above.
    outputs = [*series_symbols, *heading.torques]
    table_symbols = series_symbols
    length = heading.high[0] - heading.low[0]
    if heading.periodic and any(heading.rise):
        # The pair variables, which are the first functions, grow by `rise` in each period.
        # The table moves the coordinate into the period. One more function of the table is
        # the coordinate after this, so that its difference from the coordinate is the
        # length of all whole periods.
        (moved_coordinate,) = symbols(["coordinate moved into the period"])
        table_symbols = (*series_symbols, moved_coordinate)
        series = _append_position(series)
        periods = (coordinate - moved_coordinate) / length
        continued_variables = {
            symbol: symbol + growth * periods
            for symbol, growth in zip(series_symbols, heading.rise, strict=False)
            if growth
        }
        outputs = substitute(outputs, continued_variables)
    table = SeriesTable(
        terms=table_symbols,
        variable=coordinate,
        start=0.0,
        series=series,
        length=length,
        closed=heading.periodic,
    )
    # The model belongs to one mode and one set of sizes, so there are no arguments that
    # select the mode or change sizes.
    mode = Mode(heading.assembly_mode, name="", at=heading.low, values=())
    return Formulas(
        mechanism=mechanism,
        motion=motion,
        mode_value_names=(),
        sizes=(),
        mode_table=ModeTable((mode,)),
        results={**unit_by_result, "torque": "N m"},
        outputs=tuple(outputs),
        step=(),
        # Symbols of the motion; there are no symbols of mode values and of sizes.
        variables=(motion_symbols, (), ()),
        tables=(table,),
        title=f"stored functions, errors up to {model.error:.2g} of the largest of each",
    )


def _append_position(functions: PiecewiseChebyshev) -> PiecewiseChebyshev:
    """Return series of several functions, and of their variable itself."""
    edges = functions.edges
    # Axes of the coefficients: cells, orders, functions. In a cell the variable is its
    # middle plus half the width times T_1.
    position = np.zeros((*functions.coefficients.shape[:2], 1))
    position[:, 0, 0] = (edges[1:] + edges[:-1]) / 2.0
    position[:, 1, 0] = np.diff(edges) / 2.0
    coefficients = np.concatenate([functions.coefficients, position], axis=2)
    return PiecewiseChebyshev(edges, coefficients)


def profile_table(
    profile_side: ProfileSide, configuration_symbols: Sequence[ExpressionNode]
) -> SeriesTable:
    """Return the Chebyshev series of a contact profile, for formulas that contain it.

    A profile is the curve along which the contact point moves on one link. Formulas of a
    mechanism contain nine functions of the arc length s of a profile as symbols. The table
    gives the values of these symbols, so it is exported together with the formulas. The
    nine functions are:

    - the unit tangent (3 components) and the point on the unit sphere (3 components),
    - the geodesic curvature k and its derivatives dk/ds and d2k/ds2.

    The contact has a pair variable that is the arc length, counted from s = `start`.

    Parameters
    ----------
    profile_side
        The profile of one link of a contact, with the symbols of its functions in the
        formulas.
    configuration_symbols
        Symbols of all pair variables.
    """
    # `contact_symbols` are the first eight symbols, `last_derivative` stands for d2k/ds2.
    function_symbols: Any = (*profile_side.contact_symbols, profile_side.last_derivative)
    profile_series = profile_side.series
    # The series of the profile has the first eight functions. Its derivative gives
    # d2k/ds2, the ninth function.
    nine_functions = _append_last_derivative(profile_series.series)
    # Which pair variable belongs to the profile, and where it starts on the profile.
    contact_profile = profile_side.track
    contact_variable = configuration_symbols[contact_profile.variable]
    return SeriesTable(
        terms=function_symbols,
        variable=contact_variable,
        start=contact_profile.start,
        series=nine_functions,
        length=profile_series.length,
        closed=profile_series.closed,
    )


def _append_last_derivative(functions: PiecewiseChebyshev) -> PiecewiseChebyshev:
    """Return series of several functions, and of the derivative of the last function."""
    # Axes of the coefficients: cells, orders, functions.
    last_derivative = functions.derivative.coefficients[:, :, -1:]
    # A derivative has one order less, so a highest coefficient of zero is added.
    padded_derivative = np.pad(last_derivative, ((0, 0), (0, 1), (0, 0)))
    coefficients = np.concatenate([functions.coefficients, padded_derivative], axis=2)
    return PiecewiseChebyshev(functions.edges, coefficients)
