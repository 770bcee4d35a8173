"""Makes the explicit formulas of a mechanism, from which sources are printed.

Positions have a closed form if every group is a dyad, or if every group becomes one when
wheels and circles are replaced by links. The positions then follow from the signs of the
dyads, and nothing is iterated. Otherwise the variables of all pairs are arguments, and a
step of Newton's method brings them nearer to a configuration in which the loops are closed.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.designs.design_evaluation import most_regular_configurations
from spherekit.designs.design_variables import (
    ACTIONS,
    DesignVariable,
    check_variables,
    design_variable,
)
from spherekit.designs.figures_of_merit import INERTIAL
from spherekit.designs.varied_mechanism import VariedMechanism
from spherekit.errors import DesignError, SpherekitError
from spherekit.exchange.dependent_numbers import express_dependent_numbers
from spherekit.exchange.formula_expressions import (
    Argument,
    Formulas,
    ModeTable,
    SeriesTable,
)
from spherekit.exchange.load_angles import find_swing_middles, revolutions_about
from spherekit.exchange.mode_table import compare_modes, passive_variables
from spherekit.exchange.size_arguments import check_sizes_change_no_constants
from spherekit.exchange.stored_formulas import profile_table
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.number_change import document_of
from spherekit.files.study import Crossings
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_at, driven_pairs
from spherekit.positions.motion_cache import position_analysis_of
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    iterate_nodes,
    substitute,
    symbols,
)
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import find_equivalent_linkage
from spherekit.velocities.row_quantities import row_quantities
from spherekit.wording import listing

CLOSURE_PREFIX = "closure_"
"""Beginning of the names of squares that are negative if a dyad does not close.

The number of the dyad follows, from 1 on. Only closed forms have these quantities.
"""


CONFIGURATION_SAMPLES = 31
"""Number of samples among which a configuration of an assembly mode is sought.

More: modes that exist at few inputs are found; fewer: the search is faster.
"""


@dataclass(frozen=True)
class MotionArguments:
    """The arguments of formulas that describe a motion, and their symbols.

    The arguments are inputs (rad). Rates, accelerations, the time, whole turns of pairs or
    torques are added if results depend on them.

    Attributes
    ----------
    arguments
        Name and unit of each argument in the source code.
    terms
        For each argument the symbol in the expressions that stands for it.
    """

    arguments: tuple[Argument, ...]
    terms: tuple[ExpressionNode, ...]


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
        Names of quantities, as `row_quantities` lists them, or patterns such as
        ``"theta_*"``. By default they are angles, velocity coefficients of links relative
        to the ground (angular velocity per unit rate of an input), their derivatives and
        transmission angles. If the mechanism has masses, the inertia and the driving torque
        are added, with one input also the derivative of the inertia.
    vary
        Keys of the mechanism file, such as ``"links.2.arc"``. Their numbers become
        arguments of the formulas.
    input_pair
        The driven pairs, by default the inputs of the mechanism.
    assembly_mode
        The only assembly mode of the formulas, by default all.
    crossings
        How an assembly mode continues where its curve of configurations crosses the curve
        of another mode. With "end" it keeps the signs of its dyads. A dyad is two links
        with three R pairs, and its sign is one of two ways to assemble it. With "pass" the
        mode follows the smooth curve through the crossings of the mechanism in the file.

    Raises
    ------
    EngineError
        If there is no such quantity, or the engine does not know the mechanism's groups.
    DesignError
        If a number cannot be an argument of the formulas.
    SolveError, PlanError
        If the mechanism cannot be assembled, or its mobility is not the number of inputs.
    """
    # Collect the numbers that are arguments, and the quantities to compute.
    driven_mechanism = driven_at(mechanism_of(mechanism), input_pair)
    document = document_of(mechanism)
    variables = tuple(design_variable(document, key) for key in vary)
    check_variables(document, variables)
    inputs = tuple(driven_mechanism.names_of(driven_pairs(driven_mechanism)))
    quantity_names = _list_quantities(driven_mechanism, inputs, quantities)
    needs_inertia = any(name.startswith(INERTIAL) for name in quantity_names)
    varied_mechanism = VariedMechanism(
        document,
        driven_mechanism,
        variables,
        inputs,
        equivalent_linkage=find_equivalent_linkage(driven_mechanism, inputs),
        masses_follow_sizes=bool(vary) and needs_inertia,
    )
    check_sizes_change_no_constants(varied_mechanism)
    design_expressions = varied_mechanism.make_expressions(
        closed=_find_configuration_of_mode(driven_mechanism, assembly_mode, crossings)
    )
    size_symbols = symbols(variable.name for variable in variables)
    # The expressions contain symbols that are no arguments of the formulas. Each is
    # replaced by an expression of the arguments.
    replacements = express_dependent_numbers(
        varied_mechanism, design_expressions, size_symbols
    )
    results = _find_results(design_expressions, quantity_names, can_omit=quantities is None)
    step: list[Expr] = []
    if not design_expressions.has_closed_form:
        step = _write_newton_step(design_expressions)
        # Symbols of driven variables are replaced by the symbols of the inputs.
        configuration_symbols = design_expressions.configuration_symbols
        for variable, sample_symbol in zip(
            design_expressions.structure.inputs,
            design_expressions.sample_symbols,
            strict=False,
        ):
            replacements[configuration_symbols[variable]] = sample_symbol
    passes_crossings = crossings == "pass" and bool(
        position_analysis_of(driven_mechanism, "pass").mode_meetings
    )
    if not passes_crossings and not any(map(_is_link_size, variables)):
        # Whole turns of a pair that only swings follow from its angle. With other sizes of
        # links, or beyond a crossing, the pair may turn fully.
        replacements |= _express_revolutions(
            driven_mechanism, design_expressions, [*results.values()], replacements
        )

    # Insert the replacements, and describe arguments and results.
    outputs = substitute([*results.values()], replacements)
    step = substitute(step, replacements)
    unit_by_quantity = row_quantities(driven_mechanism)
    motion = _find_motion_arguments(design_expressions, outputs)
    formulas_without_modes = Formulas(
        mechanism=driven_mechanism,
        motion=motion.arguments,
        mode_value_names=tuple(
            symbol.arguments[0] for symbol in design_expressions.configuration_symbols
        ),
        sizes=_list_size_arguments(varied_mechanism),
        mode_table=ModeTable(()),
        results={name: unit_by_quantity.get(name, "") for name in results},
        outputs=tuple(outputs),
        step=tuple(step),
        variables=(
            motion.terms,
            tuple(design_expressions.configuration_symbols),
            tuple(size_symbols),
        ),
        tables=_find_profile_tables(design_expressions, [*outputs, *step]),
        middle_pairs=design_expressions.middle_pairs,
    )

    # Find the assembly modes, and compare the formulas with the mechanism in each.
    angles: list[Expr] = []
    if design_expressions.has_closed_form:
        angles = [
            design_expressions.angle(pair) for pair in passive_variables(design_expressions)
        ]
        angles = substitute(angles, replacements)
    mode_table = compare_modes(
        formulas_without_modes,
        varied_mechanism,
        design_expressions,
        angles,
        assembly_mode,
        crossings,
    )
    return replace(formulas_without_modes, mode_table=mode_table)


def _find_configuration_of_mode(
    mechanism: Mechanism, assembly_mode: int | str | None, crossings: Crossings
) -> Floats | None:
    """Return a configuration at which independent equations for the formulas are chosen.

    If constraints are redundant, some velocity equations repeat others. Which equations are
    independent can differ between assembly modes (ways to assemble the mechanism). The
    configuration belongs to the mode for which the formulas are made.

    Parameters
    ----------
    mechanism
        The mechanism, with its driven pairs.
    assembly_mode
        Number or name of the mode, if the formulas are for a single mode. None if they are
        for all modes.
    crossings
        How an assembly mode continues where curves of configurations cross.

    Returns
    -------
    The pair variables (variables,) in rad of the configuration of the mode that is farthest
    from a singular one. None if no single mode is requested, if constraints are not
    redundant, or if the mode has no configuration at the sampled inputs.
    """
    if assembly_mode is None:
        return None
    position_analysis = position_analysis_of(mechanism, crossings)
    # If constraints are redundant, the mobility follows from the rank of the velocity
    # equations.
    has_redundant_constraints = position_analysis.by_rank
    if not has_redundant_constraints:
        return None
    mode_index = position_analysis.find_mode_index(assembly_mode)
    mode_number = position_analysis.assembly_modes[mode_index].number
    # The motion has rows of all modes.
    motion = position_analysis.sparse(CONFIGURATION_SAMPLES)
    rows_of_mode = np.flatnonzero(motion.assembly_mode == mode_number)
    configurations = most_regular_configurations(motion.rows(rows_of_mode))
    if not configurations:
        return None
    return configurations[0]


def _is_link_size(variable: DesignVariable) -> bool:
    """Return whether configurations depend on a number of the file: a size of a link."""
    return variable.path[0] not in ACTIONS


def refuse_link_sizes(mechanism: AnyMechanism, vary: Sequence[str]) -> None:
    """Raise an error if sizes of links are to be arguments of code with fixed crossings.

    The configurations of an assembly mode (way to assemble the mechanism) form a curve over
    the input. The curves of two modes can cross. If modes continue smoothly through
    crossings (option "pass"), the generated code contains the inputs of all crossings as
    fixed numbers. The numbers would be wrong for other sizes of links.

    Parameters
    ----------
    mechanism
        The mechanism, whose file has the numbers.
    vary
        Keys in the file of the numbers that are to be arguments.

    Raises
    ------
    DesignError
        If one of them is the size of a link.
    """
    document = document_of(mechanism)
    variables = [design_variable(document, key) for key in vary]
    keys = [variable.key for variable in variables if _is_link_size(variable)]
    if keys:
        raise DesignError(
            f"{document.name}: {listing(keys)}: cannot be an argument of source code with "
            'crossings "pass", because the inputs at which assembly modes cross are fixed '
            "numbers in the source code, but change with the sizes of links; choose "
            'crossings "end", export source code for each design, or export a page, which '
            "finds the crossings itself"
        )


def _list_quantities(
    mechanism: Mechanism, inputs: Names, quantities: Sequence[str] | None
) -> list[str]:
    """Return the names of the quantities of which formulas are requested.

    A requested name that matches no quantity is returned unchanged.

    Parameters
    ----------
    mechanism
        The mechanism.
    inputs
        Names of the driven pairs.
    quantities
        Requested names or patterns. None stands for the default: pair angles, velocity and
        acceleration coefficients relative to ground, transmission angles, inertia and
        torques.
    """
    all_names = row_quantities(mechanism)
    if quantities is not None:
        requested_names: list[str] = []
        for pattern in quantities:
            matching = [name for name in all_names if fnmatchcase(name, pattern)]
            requested_names += matching or [pattern]
        return list(dict.fromkeys(requested_names))
    patterns = [
        "theta_*",
        *(f"velocity_coefficient_{link}_{mechanism.ground}" for link in mechanism.links),
        *(
            f"acceleration_coefficient_{link}_{mechanism.ground}"
            for link in mechanism.links
        ),
        "transmission_angle_*",
        "B",  # equivalent inertia of one input
        "dB_dq",  # its derivative with respect to the input
        "torque",  # driving torque
        *(f"B_{pair}" for pair in inputs),  # inertia matrix of several inputs
    ]
    # With several inputs, names end in the name of the moving input.
    patterns += [f"{pattern}_by_*" for pattern in patterns]
    input_angles = {f"theta_{pair}" for pair in inputs}
    return [
        name
        for name in all_names
        if name not in input_angles
        and any(fnmatchcase(name, pattern) for pattern in patterns)
    ]


def _find_results(
    design_expressions: DesignExpressions, names: Iterable[str], can_omit: bool
) -> dict[str, Expr]:
    """Return quantities as expressions, by their names.

    Most expressions come from `design_expressions`. The exceptions are quantities such as
    "closure_2", which belongs to the second dyad (two links with three revolute joints).
    The axes of the three joints are the corners of a spherical triangle. The quantity is
    the square of their triple product, computed from the arcs of the triangle. If no
    triangle has these arcs, the square is negative, and the dyad cannot be assembled.

    Parameters
    ----------
    design_expressions
        Expressions of the mechanism.
    names
        Names of the quantities.
    can_omit
        Whether quantities without an expression are left out. If not, an error is raised.
    """
    closure_by_name = {
        f"{CLOSURE_PREFIX}{dyad + 1}": square
        for dyad, square in enumerate(design_expressions.triple_squares)
    }
    results: dict[str, Expr] = {}
    for name in names:
        if name in closure_by_name:
            results[name] = closure_by_name[name]
            continue
        try:
            results[name] = design_expressions.quantity(name)
        except SpherekitError:
            if not can_omit:
                raise
    return results


def _list_size_arguments(varied_mechanism: VariedMechanism) -> tuple[Argument, ...]:
    """Return the numbers in the mechanism file that are arguments; angles are in rad."""
    values = varied_mechanism.unit_scales * varied_mechanism.nominal_values
    return tuple(
        Argument(
            name=variable.name,
            unit="rad" if variable.is_angle else "as in the file",
            value=float(value),
            key=variable.key,
        )
        for variable, value in zip(varied_mechanism.variables, values, strict=True)
    )


def _list_symbols(expressions: Sequence[Expr]) -> set[ExpressionNode]:
    """Return the symbols of variables that expressions contain."""
    return {node for node in iterate_nodes(expressions) if node.operation == "variable"}


def _find_profile_tables(
    design_expressions: DesignExpressions, expressions: Sequence[Expr]
) -> tuple[SeriesTable, ...]:
    """Return the series of the profiles that expressions contain."""
    used_symbols = _list_symbols(expressions)
    return tuple(
        profile_table(profile, design_expressions.configuration_symbols)
        for profile in design_expressions.structure.pairs.sides_with_symbols
        if used_symbols & {*profile.contact_symbols, profile.last_derivative}
    )


def _express_revolutions(
    mechanism: Mechanism,
    design_expressions: DesignExpressions,
    results: Sequence[Expr],
    replacements: Mapping[ExpressionNode, Expr],
) -> dict[ExpressionNode, Expr]:
    """Return expressions for the whole revolutions (rad) of pairs that can't turn fully.

    The formulas compute angles in (-pi, pi]. Loads such as springs depend on the angle with
    all whole revolutions. If a pair (joint) swings over less than a turn, its actual angle
    is the one nearest to the middle of its swing. This angle gives the revolutions of the
    pair. Pairs that turn fully are left out.

    Parameters
    ----------
    mechanism
        The mechanism, driven at its inputs.
    design_expressions
        Its expressions, with a symbol for the revolutions of each pair.
    results
        The results. Some of them may depend on revolutions.
    replacements
        The expressions that replace other symbols, such as those of driven variables. They
        are inserted into the results.

    Returns
    -------
    The expression of the revolutions of each pair, by the symbol of these revolutions.
    """
    used_symbols = _list_symbols(results)
    # `mechanism.angles` has the R pairs (revolute joints). Contacts have no angle, and so
    # no revolutions.
    pairs = [
        pair
        for pair, symbol in design_expressions.revolution_symbols.items()
        if symbol in used_symbols and pair in mechanism.angles
    ]
    middle_by_pair = find_swing_middles(mechanism, pairs)
    revolutions = [
        revolutions_about(design_expressions.angle(pair), middle)
        for pair, middle in middle_by_pair.items()
    ]
    revolution_symbols = [
        design_expressions.revolution_symbols[pair] for pair in middle_by_pair
    ]
    expressions = substitute(revolutions, replacements)
    return dict(zip(revolution_symbols, expressions, strict=True))


def _write_newton_step(design_expressions: DesignExpressions) -> list[Expr]:
    """Return expressions for a step of Newton's method that closes the loops.

    Returns
    -------
    All pair variables (joint angles) after the step, and then the closure residual: how far
    (rad) the loops were open before the step. Variables that the inputs determine through
    toothed wheels are linear functions of the inputs, so they need no step.
    """
    coordinate_rates = design_expressions.coordinate_rates
    # A residual is the small rotation by which a loop is open. `solve_loops` returns the
    # changes of the variables that cancel all residuals, to first order. The inputs do not
    # change.
    changes = coordinate_rates.solve_loops(coordinate_rates.closure_residuals)
    variables_after_step: list[Expr] = []
    for symbol, variable, change in zip(
        design_expressions.configuration_symbols,
        design_expressions.variables,
        changes,
        strict=True,
    ):
        # An unknown variable is its own symbol. Other variables are functions of the
        # inputs.
        is_unknown = variable is symbol
        variables_after_step.append(symbol + change if is_unknown else variable)
    closure_residual = function("sqrt", coordinate_rates.closure_residual_square)
    return [*variables_after_step, closure_residual]


def _find_motion_arguments(
    design_expressions: DesignExpressions, outputs: Sequence[Expr]
) -> MotionArguments:
    """Return the arguments of the generated functions that describe a motion.

    The angles of the inputs are always arguments. The following are arguments only if the
    results contain them:

    - rates and accelerations of the inputs, and the time;
    - whole revolutions (rad, a multiple of 2 pi) of pairs (joints) with a load that depends
      on the angle, such as a spring. The formulas give the angle of a passive pair (without
      an input) only in (-pi, pi]. They add the argument to this angle;
    - torques that loads take from a table over time.

    Parameters
    ----------
    design_expressions
        The quantities of the mechanism as expressions, with the symbols in them.
    outputs
        Expressions of the results that the generated functions compute.
    """
    # Sample symbols are the inputs, their rates, their accelerations, and the time.
    inputs = design_expressions.inputs
    sample_units = []
    for unit in ("rad", "rad/s", "rad/s2"):
        sample_units += [unit] * len(inputs)
    sample_units.append("s")
    unit_by_symbol = dict(zip(design_expressions.sample_symbols, sample_units, strict=True))
    for pair, symbol in design_expressions.revolution_symbols.items():
        unit_by_symbol[symbol] = (
            f"rad: whole turns of theta_{pair}, 0 while it is in (-pi, pi]"
        )
    unit_by_symbol |= dict.fromkeys(design_expressions.table_symbols.values(), "N m")
    # The inputs are arguments in any case.
    used_symbols = _list_symbols(outputs)
    used_symbols |= {*design_expressions.sample_symbols[: len(inputs)]}
    argument_symbols = tuple(symbol for symbol in unit_by_symbol if symbol in used_symbols)
    # A symbol is a node of an expression graph whose first argument is the name.
    arguments = tuple(
        Argument(name=symbol.arguments[0], unit=unit_by_symbol[symbol])
        for symbol in argument_symbols
    )
    return MotionArguments(arguments=arguments, terms=argument_symbols)
