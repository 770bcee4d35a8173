"""Makes the explicit formulas of a mechanism, from which sources are printed.

Positions follow from the signs of dyads where every group is one, or wheels and circles do;
then nothing is iterated. Elsewhere the variables of all pairs are arguments, and a step of
Newton's method brings them nearer to where loops close.
"""

from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from dataclasses import replace
from fnmatch import fnmatchcase
from itertools import chain
from typing import Any

import numpy as np

from spherekit.conventions import Names
from spherekit.designs.design_variables import (
    ACTIONS,
    DesignVariable,
    check_variables,
    design_variable,
)
from spherekit.designs.figures_of_merit import INERTIAL
from spherekit.designs.varied_mechanism import CONSTANT_SLOPE_TOLERANCE, VariedMechanism
from spherekit.dynamics.reduced_model import StoredModel
from spherekit.errors import DesignError, SpherekitError
from spherekit.exchange.formula_expressions import (
    Argument,
    Formulas,
    Mode,
    ModeTable,
    SeriesTable,
)
from spherekit.exchange.load_angles import find_swing_middles, turns_about
from spherekit.exchange.mode_table import compare_modes, passive_variables
from spherekit.exchange.size_arguments import check_numbers_are_followed
from spherekit.exchange.varied_masses import masses_in_terms
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.number_change import document_of
from spherekit.files.study import Crossings
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.planning.assembly_plan import driven_at, driven_pairs
from spherekit.positions.motion_cache import position_analysis_of
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    dot,
    function,
    iterate_nodes,
    substitute,
    symbols,
)
from spherekit.velocities.axis_rotations import ProfileSide
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import find_equivalent_linkage
from spherekit.velocities.load_numbers import list_numbers, masses_and_loads
from spherekit.velocities.row_quantities import row_quantities
from spherekit.wording import listing

CLOSURE = "closure_"
"""Of closed forms: the squares that are negative where a dyad does not close."""
ROUNDING = 1e-13
"""Derivatives that are smaller are those of numbers that do not change."""


def formulas(
    mechanism: AnyMechanism,
    quantities: Sequence[str] | None = None,
    vary: Sequence[str] = (),
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int | str | None = None,
    crossings: Crossings = "end",
) -> Formulas:
    """Return the formulas of quantities of a mechanism.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    quantities
        Names of `row_quantities`, or patterns of such (``"theta_*"``); by default angles,
        coefficients of links against the ground, transmission angles, and with masses the
        inertia, its derivative and the driving torque.
    vary
        Keys of the file, such as ``"links.2.arc"``, whose numbers are arguments.
    input_pair
        The driven pairs, by default those of the mechanism.
    assembly_mode
        The only assembly mode to be named, by default all.
    crossings
        Whether assembly modes keep the signs of their dyads where curves cross ("end"), or
        follow smooth curves through the crossings of the mechanism in the file ("pass").

    Raises
    ------
    EngineError
        If there is no such quantity, or the engine does not know the mechanism's groups.
    DesignError
        If a number cannot be varied so.
    SolveError, PlanError
        If the mechanism cannot be assembled, or has not one freedom for each input.
    """
    made = driven_at(mechanism_of(mechanism), input_pair)
    document = document_of(mechanism)
    variables = tuple(design_variable(document, key) for key in vary)
    check_variables(document, variables)
    inputs = tuple(made.names_of(driven_pairs(made)))
    wanted = _wanted(made, inputs, quantities)
    contacts = find_equivalent_linkage(made, inputs)
    follows = bool(vary) and any(name.startswith(INERTIAL) for name in wanted)
    varied = VariedMechanism(document, made, variables, inputs, contacts, follows)
    check_numbers_are_followed(varied)
    terms = varied.make_expressions()
    sizes = symbols(variable.name for variable in variables)
    stands = _numbers(varied, terms, sizes)
    closures = {f"{CLOSURE}{k + 1}": x for k, x in enumerate(terms.triple_squares)}
    results: dict[str, Expr] = {}
    for name in wanted:
        with suppress(*[SpherekitError] * (quantities is None)):
            results[name] = closures[name] if name in closures else terms.quantity(name)
    step: list[Expr] = []
    if not terms.has_closed_form:
        step = _step(terms)
        driven = (terms.configuration_symbols[v] for v in terms.structure.inputs)
        stands |= zip(driven, terms.sample_symbols, strict=False)
    passes_crossings = crossings == "pass" and bool(
        position_analysis_of(made, "pass").mode_meetings
    )
    if not passes_crossings and not any(map(_moves_links, variables)):
        # With other sizes of links, a pair that swings now may turn fully. So may one whose
        # mode continues through a crossing on the curve of another one.
        stands |= _turns_of_swings(made, terms, [*results.values()], stands)
    outputs, step = (substitute(x, stands) for x in ([*results.values()], step))
    units = row_quantities(made)
    motion, of_motion = _motion(terms, outputs)
    used = {x for x in iterate_nodes([*outputs, *step]) if x.operation == "variable"}
    profiles = [
        side
        for side in terms.structure.pairs.sides_with_columns
        if used & {*side.column_symbols, side.last_derivative}
    ]
    tables = tuple(_table(profile, terms.configuration_symbols) for profile in profiles)
    without_modes = Formulas(
        made,
        motion,
        tuple(place.arguments[0] for place in terms.configuration_symbols),
        tuple(
            Argument(v.name, ("as in the file", "rad")[v.is_angle], float(value), v.key)
            for v, value in zip(
                variables, varied.unit_scales * varied.nominal_values, strict=True
            )
        ),
        ModeTable(()),
        {name: units.get(name, "") for name in results},
        tuple(outputs),
        tuple(step),
        (of_motion, tuple(terms.configuration_symbols), tuple(sizes)),
        tables,
    )
    angles: list[Expr] = []
    if terms.has_closed_form:
        angles = [terms.angle(pair) for pair in passive_variables(terms)]
        angles = substitute(angles, stands)
    mode_table = compare_modes(
        without_modes, varied, terms, angles, assembly_mode, crossings
    )
    return replace(without_modes, mode_table=mode_table)


def _moves_links(variable: DesignVariable) -> bool:
    """Return whether configurations depend on a number of the file: a size of a link."""
    return variable.path[0] not in ACTIONS


def check_sizes_keep_crossings(mechanism: AnyMechanism, vary: Sequence[str]) -> None:
    """Refuse sizes as arguments of formulas whose modes pass through crossings.

    Raises
    ------
    DesignError
        If one of the keys `vary` is the size of a link.
    """
    document = document_of(mechanism)
    variables = (design_variable(document, key) for key in vary)
    keys = [variable.key for variable in variables if _moves_links(variable)]
    if keys:
        raise DesignError(
            f"{document.name}: {listing(keys)}: with other sizes curves cross at other "
            "inputs or nowhere, so a source that passes crossings is written for the sizes "
            'of the file; leave crossings at "end", write a source for each design, or '
            "write a page, which finds the crossings for its sizes"
        )


def reduced_formulas(mechanism: Mechanism, model: StoredModel) -> Formulas:
    """Return a stored model along a curve as formulas: what its series give.

    Inertia, its derivative, variables and the driving torque by the coordinate.
    """
    heading = model.heading
    (series,) = model.groups[:1]
    results = {function.name: function.unit for function in heading.groups[0]}
    (x,) = symbols(heading.by)
    given = (x, *heading.motion)
    units = ("rad", "rad/s", "rad/s2", "s", *["N m"] * len(heading.tables))
    motion = zip((y.arguments[0] for y in given), units, strict=True)
    terms = tuple(symbols(results))
    curve: Any = series
    table = SeriesTable(
        terms, x, 0.0, curve, heading.high[0] - heading.low[0], heading.periodic
    )
    return Formulas(
        mechanism,
        tuple(Argument(name, unit) for name, unit in motion),
        (),
        (),
        ModeTable((Mode(heading.assembly_mode, "", heading.low, ()),)),
        {**results, "torque": "N m"},
        (*terms, *heading.torques),
        (),
        (given, (), ()),
        (table,),
        f"stored functions, errors up to {model.error:.2g} of the largest of each",
    )


def _table(profile: ProfileSide, places: Sequence[ExpressionNode]) -> SeriesTable:
    """Return what a profile is along its arc, with the derivative of its last column."""
    of, track = profile.series, profile.track
    slopes = of.series.derivative.coefficients[:, :, -1:]
    last = np.pad(slopes, ((0, 0), (0, 1), (0, 0)))
    series = PiecewiseChebyshev(
        of.series.edges, np.concatenate([of.series.coefficients, last], axis=2)
    )
    terms: Any = (*profile.column_symbols, profile.last_derivative)
    return SeriesTable(
        terms, places[track.variable], track.start, series, of.length, of.closed
    )


def _wanted(
    mechanism: Mechanism, inputs: Names, quantities: Sequence[str] | None
) -> list[str]:
    """Return the names that are asked for, whether there are such or not."""
    every = row_quantities(mechanism)
    if quantities is not None:
        names = (
            [x for x in every if fnmatchcase(x, name)] or [name] for name in quantities
        )
        return list(dict.fromkeys(chain(*names)))
    patterns = [
        "theta_*",
        f"*_coefficient_*_{mechanism.ground}",
        "transmission_angle_*",
        *("B", "dB_dq", "torque"),
        *(f"B_{pair}" for pair in inputs),
    ]
    patterns += [f"{pattern}_by_*" for pattern in patterns]
    driven = {f"theta_{pair}" for pair in inputs}
    return [
        x for x in every if x not in driven and any(fnmatchcase(x, y) for y in patterns)
    ]


def _turns_of_swings(
    mechanism: Mechanism,
    terms: DesignExpressions,
    results: Sequence[Expr],
    stands: dict[ExpressionNode, Expr],
) -> dict[ExpressionNode, Expr]:
    """Return what the turns (rad) of pairs that cannot turn fully are, by their term.

    Parameters
    ----------
    mechanism
        The mechanism, driven at its inputs.
    terms
        The terms in which the results are written.
    results
        The results, of which some may depend on turns.
    stands
        What other terms stand for.
    """
    used = {x for x in iterate_nodes(results) if x.operation == "variable"}
    pairs = [pair for pair, turns in terms.revolution_symbols.items() if turns in used]
    middles = find_swing_middles(mechanism, [x for x in pairs if x in mechanism.angles])
    turns = [turns_about(terms.angle(pair), middle) for pair, middle in middles.items()]
    keys = [terms.revolution_symbols[pair] for pair in middles]
    return dict(zip(keys, substitute(turns, stands), strict=True))


def _step(terms: DesignExpressions) -> list[Expr]:
    """Return all variables after a step of Newton's method, and how far loops are open."""
    flow, places = terms.coordinate_rates, terms.configuration_symbols
    change = flow.solve_loops(flow.closure_residuals)
    after = [
        x if x is not place else place + dx
        for place, x, dx in zip(places, terms.variables, change, strict=True)
    ]
    return [*after, function("sqrt", flow.closure_residual_square)]


def _motion(
    terms: DesignExpressions, outputs: Sequence[Expr]
) -> tuple[tuple[Argument, ...], tuple[ExpressionNode, ...]]:
    """Return the inputs and what else of a motion results follow from."""
    inputs = terms.inputs
    units = [unit for unit in ("rad", "rad/s", "rad/s2") for _ in inputs] + ["s"]
    every = dict(zip(terms.sample_symbols, units, strict=True))
    for pair, term in terms.revolution_symbols.items():
        every[term] = f"rad: whole turns of theta_{pair}, 0 while it is in (-pi, pi]"
    every |= dict.fromkeys(terms.table_symbols.values(), "N m")
    used = {x for x in iterate_nodes(outputs) if x.operation == "variable"}
    used |= {*terms.sample_symbols[: len(inputs)]}
    kept = {term: unit for term, unit in every.items() if term in used}
    named = (Argument(x.arguments[0], unit) for x, unit in kept.items())
    return tuple(named), tuple(kept)


def _numbers(
    varied: VariedMechanism, terms: DesignExpressions, sizes: Sequence[ExpressionNode]
) -> dict[ExpressionNode, Expr]:
    """Return what the numbers of kernels that follow the file's are, by the `sizes`.

    Raises
    ------
    DesignError
        If they follow in no form that is known, or nothing varies.
    """
    numbers = terms.size_symbols[len(varied.size_variables) :]
    if not len(numbers):
        return {}
    document, variables = varied.document, varied.variables
    if not varied.can_vary:
        raise DesignError(
            f"{document.name}: the file allows no other "
            f"{listing(variable.key for variable in variables)}: it follows from other "
            "numbers; vary these"
        )
    masses = masses_in_terms(
        document,
        terms.mechanism,
        terms.structure.pairs,
        {v.path: size for v, size in zip(variables, sizes, strict=True)},
    )
    contacts = varied.equivalent_linkage.numbers if varied.equivalent_linkage else []
    moved = copy(terms.mechanism)
    object.__setattr__(moved, "masses", masses)  # terms: no mechanism could be checked
    every, stated = (
        [*contacts, *list_numbers(masses_and_loads(x))] for x in (moved, terms.mechanism)
    )
    slopes = np.stack([varied.trial_slopes(k) for k in range(len(variables))])
    stands: dict[ExpressionNode, Expr] = {}
    for number, k, slope in zip(
        numbers, varied.varied_numbers, np.moveaxis(slopes, 2, 0), strict=True
    ):
        if isinstance(every[k], ExpressionNode):
            # Masses along the axes of pairs are terms of the numbers of contacts, which
            # stand before them.
            (stands[number],) = substitute([every[k]], stands)
            continue
        off = np.abs(slope - slope[:, :1])
        bent = ~np.all(off <= CONSTANT_SLOPE_TOLERANCE * np.abs(slope) + ROUNDING, axis=1)
        if np.any(bent):
            keys = (v.key for v, is_bent in zip(variables, bent, strict=True) if is_bent)
            raise DesignError(
                f"{document.name}: {listing(keys)}: what the formulas hold does not change "
                "in proportion; vary other numbers"
            )
        row = (
            np.where(np.abs(slope[:, 0]) < ROUNDING, 0.0, slope[:, 0]) / varied.unit_scales
        )
        start = stated[k] - row @ (varied.unit_scales * varied.nominal_values)
        stands[number] = dot([*row.tolist(), 1.0], [*sizes, float(start)])
    return stands
