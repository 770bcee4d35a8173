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
from spherekit.symbolic.expression_graph import ExpressionNode, symbols
from spherekit.velocities.axis_rotations import ProfileSide


def reduced_formulas(mechanism: Mechanism, model: StoredModel) -> Formulas:
    """Return a reduced model of one coordinate as formulas.

    The results are the functions of its series, such as inertia, its derivative and
    variables, and the driving torque.

    Parameters
    ----------
    mechanism
        The mechanism of the model.
    model
        The reduced model, along one configuration curve.
    """
    heading = model.heading
    series: Any = model.groups[0]
    unit_by_result = {function.name: function.unit for function in heading.groups[0]}
    (coordinate,) = symbols(heading.by)
    motion_symbols = (coordinate, *heading.motion_symbols)
    motion_units = ("rad", "rad/s", "rad/s2", "s", *["N m"] * len(heading.tables))
    motion = tuple(
        Argument(symbol.arguments[0], unit)
        for symbol, unit in zip(motion_symbols, motion_units, strict=True)
    )
    series_symbols = tuple(symbols(unit_by_result))
    table = SeriesTable(
        terms=series_symbols,
        of=coordinate,
        start=0.0,
        series=series,
        length=heading.high[0] - heading.low[0],
        closed=heading.periodic,
    )
    mode = Mode(heading.assembly_mode, name="", at=heading.low, values=())
    return Formulas(
        mechanism=mechanism,
        motion=motion,
        places=(),
        sizes=(),
        mode_table=ModeTable((mode,)),
        results={**unit_by_result, "torque": "N m"},
        outputs=(*series_symbols, *heading.torques),
        step=(),
        variables=(motion_symbols, (), ()),
        tables=(table,),
        title=f"stored functions, errors up to {model.error:.2g} of the largest of each",
    )


def profile_table(
    profile: ProfileSide, configuration_symbols: Sequence[ExpressionNode]
) -> SeriesTable:
    """Return the functions of a contact profile, and the derivative of the last one.

    Parameters
    ----------
    profile
        The profile of one link of a contact, with the symbols of its functions.
    configuration_symbols
        Symbols of all pair variables.
    """
    profile_series = profile.series
    track = profile.track
    series = profile_series.series
    # The derivative has one order less, so its highest coefficient is zero here.
    last_derivative = series.derivative.coefficients[:, :, -1:]
    padded_derivative = np.pad(last_derivative, ((0, 0), (0, 1), (0, 0)))
    coefficients = np.concatenate([series.coefficients, padded_derivative], axis=2)
    terms: Any = (*profile.column_symbols, profile.last_derivative)
    return SeriesTable(
        terms=terms,
        of=configuration_symbols[track.variable],
        start=track.start,
        series=PiecewiseChebyshev(series.edges, coefficients),
        length=profile_series.length,
        closed=profile_series.closed,
    )
