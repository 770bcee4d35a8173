"""Computes a coupling table on a grid of the inputs, and measures its errors.

The grid is refined until enough cells are sure (interpolation in them is accurate enough).
Errors of interpolation are measured on a finer grid, with a third of the step of the table.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.dynamics.coordinates import motion_by_variables
from spherekit.dynamics.reduced_model_samples import pole_name
from spherekit.errors import SolveError
from spherekit.exchange.coupling_table import CouplingTable
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_at
from spherekit.planning.pole_plan import Pole, parse_pole
from spherekit.positions.angle_unwrapping import unwrap_motion
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.progress import ProgressReporter
from spherekit.version import __version__
from spherekit.wording import counted, listing, numbered

FIRST_NODE_COUNTS = (61, 13, 5)
"""Nodes along each of one, two, and more inputs on the first grid that is tried."""

PARTS_PER_CELL = 3
"""Parts of a cell along each input between which errors are measured.

Larger: errors are measured at more points, and the table takes longer; smaller: fewer.
"""

ERROR_BETWEEN_POINTS = 1.3
"""Factor by which errors between the measured points may be larger.

With one input, the leading remainder of coefficients is x (1/2 - x) (1 - x). Between the
thirds of a cell it is 1.30 times as large as at them. For angles the factor is 1.13. With
several inputs, remainders of angles can exceed the factor.
"""

MAX_REFINED_POINTS = 25_000
"""Largest number of points at which modes are computed on a refined grid.

The first grid and requested grids may have more points.

Larger: more cells are sure, and the table takes longer; smaller: the reverse.
"""

SUFFICIENT_SURE_RATIO = 0.98
"""Part of the cells with a measured error that are sure on a sufficient grid.

A cell has no error if the mode is missing at a corner or at a measured point.

The others contain jumps or changes of modes, which no grid resolves.
"""

RETURN_TOLERANCE = 1e-9
"""Largest difference (rad, or of a coefficient) of values that return after a revolution.

Smaller: rounding makes an input not periodic; larger: a range that is nearly a revolution
is continued with a jump.
"""


@checked(SolveError)
def coupling_table(
    mechanism: AnyMechanism,
    *,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int | None = None,
    pairs: Sequence[str] | None = None,
    poles: Iterable[str] = (),
    samples: int | Sequence[int] | None = None,
    tolerance: float = 1e-6,
) -> CouplingTable:
    """Return passive variables and coefficients on a grid of the inputs, for controllers.

    Passive variables are the variables of pairs that are not driven. Coefficients are the
    rates of passive variables per unit rate of one input. A cell of the grid is *sure* if
    interpolation in it is accurate to the tolerance. This is measured at points between the
    nodes. The steps of the grid are halved until enough cells are sure.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    input_pair
        The driven pairs, by default the inputs of the mechanism.
    assembly_mode
        The only assembly mode to compute; by default all.
    pairs
        The passive pairs to compute; by default all.
    poles
        Pairs of links (poles) such as ``"4/1"``. Their relative angular velocities are
        computed too.
    samples
        Number of nodes (grid points) along each input, or one number for all inputs. By
        default the grid is refined until 98 % of the cells with a mode are sure. The
        refinement ends earlier if a finer grid would need more than 25 000 points.
    tolerance
        Error of angles (rad) up to which a cell is sure, greater than 0 and less than 1.

    Raises
    ------
    SolveError, PlanError, ModelError
        If there is no such mode, pair or pole, or no cell is sure.

    Examples
    --------
    >>> import spherekit as sk
    >>> table = sk.coupling_table("four_bar", assembly_mode=0, pairs=["41"])
    >>> here = table.at(0.7)
    >>> here.angles.shape, here.coefficients.shape
    ((1, 1), (1, 1, 1))
    """
    mechanism = driven_at(mechanism_of(mechanism), input_pair)
    if not 0.0 < tolerance < 1.0:
        raise SolveError(
            f"coupling_table: tolerance: found {tolerance} rad, expected a number greater "
            "than 0 and less than 1"
        )
    requested_poles = tuple(parse_pole(mechanism, text) for text in poles)
    passive_variables = _find_passive_variables(mechanism, pairs)
    node_counts = _choose_node_counts(mechanism, samples)
    progress = ProgressReporter("filling the table")
    while True:
        grid_text = "x".join(map(str, node_counts))
        progress.report_if_due(partial(str, grid_text))  # called only if a report is due
        table = _compute_table(
            mechanism,
            assembly_mode,
            passive_variables,
            requested_poles,
            node_counts,
            tolerance,
        )
        # Stop if the user chose the grid, enough cells are sure, or the next grid, whose
        # cells are half as long, has too many points.
        finer_counts = tuple(2 * count - 1 for count in node_counts)
        finer_point_count = np.prod(_refine_counts(finer_counts))
        cell_count = np.sum(np.isfinite(table.error))  # cells with a mode at all points
        is_sufficient = (
            cell_count > 0 and np.sum(table.sure) >= SUFFICIENT_SURE_RATIO * cell_count
        )
        if samples is not None or is_sufficient or finer_point_count > MAX_REFINED_POINTS:
            break
        node_counts = finer_counts
    _check_any_sure(table)
    return table


def _check_any_sure(table: CouplingTable) -> None:
    """Raise `SolveError` if interpolation is accurate enough in no cell of the table."""
    if np.any(table.sure):
        return
    errors = table.error[np.isfinite(table.error)]
    best = "no assembly mode exists at all measured points of a cell"
    if len(errors):
        best = f"the smallest error of a cell is {np.min(errors):.2g} rad"
    raise SolveError(
        f"{table.mechanism}: no cell of a table with {'x'.join(map(str, table.count))} "
        f"nodes has an interpolation error within {table.tolerance:g} rad ({best}); "
        "request more samples, a larger tolerance, or narrower ranges"
    )


def _choose_node_counts(
    mechanism: Mechanism, samples: int | Sequence[int] | None
) -> tuple[int, ...]:
    """Return the number of nodes along each input, on the first grid that is tried.

    A coupling table stores joint angles at the nodes of a grid of inputs.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    samples
        The requested number of nodes for each input, or one number for all inputs. Without
        a request, a small default is used.
    """
    input_count = len(mechanism.inputs)
    if samples is None:
        # The default depends on the number of inputs: one, two, or more.
        default = FIRST_NODE_COUNTS[min(input_count, len(FIRST_NODE_COUNTS)) - 1]
        return (default,) * input_count
    # Arrays and numbers of NumPy become lists and numbers of Python.
    samples = np.asarray(samples).tolist()
    counts = tuple(samples) if isinstance(samples, Sequence) else (samples,) * input_count
    if len(counts) != input_count or min(counts) < 2:
        raise SolveError(
            f"{mechanism.name}: samples: found {'x'.join(map(str, counts))}, but the "
            f"mechanism has {counted(input_count, 'input')} "
            f"({numbered('pair', mechanism.input_pairs)}); give a number of at least 2 for "
            "each input, such as 9 or 9x9"
        )
    return counts


def _refine_counts(node_counts: Sequence[int]) -> tuple[int, ...]:
    """Return the number of points along each input of the grid for measuring errors.

    `node_counts` are the numbers of nodes (grid points of the table) along each input. The
    finer grid divides each cell between nodes into `PARTS_PER_CELL` parts along each input.
    """
    return tuple(PARTS_PER_CELL * (count - 1) + 1 for count in node_counts)


def _find_passive_variables(mechanism: Mechanism, pairs: Sequence[str] | None) -> list[int]:
    """Return the indices of the variables of passive pairs (joints that are not driven).

    A coupling table has these variables as functions of the inputs.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    pairs
        Names of passive pairs, None for all of them.

    Raises
    ------
    SolveError
        If a pair is an input, if `pairs` is empty, or if the mechanism has no passive pair.
    """
    driven_pairs = mechanism.input_pairs
    passive_pairs = [pair.name for pair in mechanism.pairs if pair.name not in driven_pairs]
    requested_pairs = passive_pairs if pairs is None else [*dict.fromkeys(pairs)]
    for name in requested_pairs:
        if mechanism.pair(name).name in driven_pairs:
            raise SolveError(
                f"{mechanism.name}: pairs: {name} is an input, but only passive "
                f"pairs are allowed here: {listing(passive_pairs)}"
            )
    if not requested_pairs:
        raise SolveError(
            f"{mechanism.name}: a coupling table needs at least one passive pair (a pair "
            "that is not an input), but all pairs are inputs, or pairs is empty; name a "
            "passive pair in pairs"
        )
    variables: list[int] = []
    for name in requested_pairs:
        variables += mechanism.variables_of(mechanism.pair_number[name])
    return variables


@dataclass(frozen=True)
class GridValues:
    """Values of a coupling table in all assembly modes, at points of a grid of inputs.

    The attributes are those of `CouplingTable` with the same names. The grid is finer than
    that of the table, because the points between the nodes of the table measure errors.
    Values are NaN where a mode does not exist.
    """

    angles: Floats
    coefficients: Floats
    derivatives: Floats
    turning: Floats
    turning_derivatives: Floats


def _compute_grid_values(
    position_analysis: PositionAnalysis,
    motion: Motion,
    passive_variables: Sequence[int],
    poles: Sequence[Pole],
) -> GridValues:
    """Compute angles and coefficients of all assembly modes at the points of a grid.

    A row of the motion is one point (sample) of one assembly mode. Rows are all samples of
    one mode, then all samples of the next.

    Parameters
    ----------
    position_analysis
        The analysis that found the modes, with the solver of their positions.
    motion
        The motion of the mechanism, with continuous angles.
    passive_variables
        Indices of the passive variables (of joints that are not driven).
    poles
        The pairs of links (poles) of which the relative angular velocity is computed.
    """
    solver = position_analysis.solver
    good_rows = np.flatnonzero(~motion.failed)
    # The coordinates are the variables of the m driven pairs, so rates are per unit rate of
    # each input.
    coordinate_motion = motion_by_variables(
        solver.closure, motion.values[good_rows], variables=solver.driven
    )
    mode_count = len(position_analysis.assembly_modes)

    def place_by_mode(values: Floats) -> Floats:
        """Return values (good rows, ...) as (modes, samples, ...), NaN at failed rows."""
        all_values = nans((len(motion), *values.shape[1:]))
        all_values[good_rows] = values
        return all_values.reshape(mode_count, motion.samples, *values.shape[1:])

    # The motion has the K variables on the last axis: rates (rows, m, K), second
    # derivatives (rows, m, m, K). The table has its inputs last: (rows, K, m) and
    # (rows, K, m, m).
    rates = coordinate_motion.rates[:, :, passive_variables]
    second_rates = coordinate_motion.second[:, :, :, passive_variables]
    coefficients = place_by_mode(np.swapaxes(rates, 1, 2))
    derivatives = place_by_mode(np.moveaxis(second_rates, 3, 1))
    angles = place_by_mode(coordinate_motion.values[:, passive_variables])
    # At dead centres the angles are finite, but the coefficients are not. Such a point
    # counts as one at which the mode does not exist, so its angles are made NaN.
    has_derivatives = all_finite(coefficients, (2, 3)) & all_finite(derivatives, (2, 3, 4))
    # A pole is a pair of link numbers, the smaller one first. `turning` is the angular
    # velocity of the second link relative to the first.
    low_links = [low for low, _ in poles]
    high_links = [high for _, high in poles]
    velocities = coordinate_motion.w
    velocity_derivatives = coordinate_motion.dw
    turning = velocities[:, :, high_links] - velocities[:, :, low_links]
    turning_derivatives = (
        velocity_derivatives[:, :, :, high_links] - velocity_derivatives[:, :, :, low_links]
    )
    # Angular velocities have the axes (rows, m, P, 3), and (rows, m, m, P, 3) as
    # derivatives. The table has the P poles first.
    return GridValues(
        angles=np.where(has_derivatives[..., None], angles, np.nan),
        coefficients=coefficients,
        derivatives=derivatives,
        turning=place_by_mode(np.moveaxis(turning, 2, 1)),
        turning_derivatives=place_by_mode(np.moveaxis(turning_derivatives, 3, 1)),
    )


def _compute_table(
    mechanism: Mechanism,
    assembly_mode: int | None,
    passive_variables: list[int],
    poles: tuple[Pole, ...],
    node_counts: tuple[int, ...],
    tolerance: float,
) -> CouplingTable:
    """Return the coupling table of a grid, with the errors that were measured in its cells.

    Values are computed on a finer grid, of which every third point along each input is a
    node of the table. The other points measure the errors.

    Parameters
    ----------
    assembly_mode
        The only mode to compute, None for all.
    passive_variables
        Indices of the variables in the table.
    poles
        The poles (pairs of links) in the table.
    node_counts
        Number of nodes (grid points of the table) along each input.
    tolerance
        Error of angles (rad) up to which a cell is sure.
    """
    refined_counts = _refine_counts(node_counts)
    position_analysis = PositionAnalysis(
        mechanism, None, assembly_mode, samples=refined_counts
    )
    motion = unwrap_motion(position_analysis.motion(), position_analysis.angle_unwrapping)
    grid_values = _compute_grid_values(position_analysis, motion, passive_variables, poles)
    mode_numbers = [mode.number for mode in position_analysis.assembly_modes]
    inputs = position_analysis.input_grid.q
    # The nodes of the table among the points of the refined grid.
    node_indices = PARTS_PER_CELL * np.indices(node_counts)
    nodes = np.ravel_multi_index(tuple(node_indices), refined_counts).ravel()
    # Along each input there is one cell less than nodes.
    cell_shape = (len(mode_numbers), math.prod(count - 1 for count in node_counts))
    # Periods and errors are preliminary here, and are found from the table below.
    table = CouplingTable(
        mechanism=mechanism.name,
        mechanism_sha256=mechanism_hash(mechanism),
        made_by=__version__,
        inputs=position_analysis.inputs,
        variables=tuple(mechanism.variable_names[v] for v in passive_variables),
        poles=tuple(pole_name(mechanism, pole) for pole in poles),
        modes=tuple(mode_numbers),
        tolerance=tolerance,
        start=inputs[0],
        step=(inputs[-1] - inputs[0]) / np.subtract(node_counts, 1),
        count=np.array(node_counts),
        periodic=np.zeros(len(node_counts), dtype=bool),
        rise=np.zeros((len(mode_numbers), len(node_counts), len(passive_variables))),
        angles=grid_values.angles[:, nodes],
        coefficients=grid_values.coefficients[:, nodes],
        derivatives=grid_values.derivatives[:, nodes],
        turning=grid_values.turning[:, nodes],
        turning_derivatives=grid_values.turning_derivatives[:, nodes],
        error=np.zeros(cell_shape),
        sure=np.ones(cell_shape, dtype=bool),
        coefficient_error=0.0,
    )
    periods = np.array([period for joint in motion.joints for period in joint.periods])
    _find_periodic_inputs(table, periods[passive_variables])
    cell_errors = _measure_errors(table, grid_values, refined_counts)
    with np.errstate(invalid="ignore"):
        is_sure = cell_errors.angles <= tolerance
    return replace(
        table,
        error=cell_errors.angles,
        sure=is_sure,
        coefficient_error=float(np.max(cell_errors.rates[is_sure], initial=0.0)),
    )


@dataclass(frozen=True)
class InterpolationErrors:
    """The largest absolute errors of interpolation in each cell of a coupling table.

    A coupling table has values of assembly modes (ways to assemble the mechanism) at the
    nodes of a grid of inputs. A cell is a box between neighbouring nodes. The errors of
    a mode are NaN in a cell if the mode is missing at any point of the cell.

    Attributes
    ----------
    angles
        (modes, cells), or (cells,) for a single mode: largest error of all angles (rad).
    rates
        In the same shape: largest error of all rates of passive variables and angular
        velocities of links. Rates and velocities are per unit rate of an input, so the
        error has no unit.
    """

    angles: Floats
    rates: Floats


def _measure_errors(
    table: CouplingTable, grid_values: GridValues, refined_counts: tuple[int, ...]
) -> InterpolationErrors:
    """Return the errors (modes, cells) of interpolation in a coupling table.

    The table has values at the nodes of a grid of inputs, and a cell is a box between
    neighbouring nodes. Interpolated values are compared with computed values on a refined
    grid, which divides each cell into `PARTS_PER_CELL` parts along each input. Errors
    between these points may be larger, so they are multiplied by `ERROR_BETWEEN_POINTS`.

    Parameters
    ----------
    table
        The table.
    grid_values
        Computed values on the refined grid.
    refined_counts
        Number of points of that grid along each input.
    """
    angle_errors = np.zeros_like(table.error)
    rate_errors = np.zeros_like(table.error)
    # A point in a cell is described by numbers of parts from the first corner, one for each
    # input.
    for part in product(range(PARTS_PER_CELL + 1), repeat=len(refined_counts)):
        is_corner = all(number in (0, PARTS_PER_CELL) for number in part)
        if is_corner:
            continue  # The values there are stored, so the error is zero.
        for mode in range(len(table.modes)):
            errors = _measure_errors_at_part(table, grid_values, refined_counts, mode, part)
            # Once an error is NaN (no mode there), the maximum remains NaN.
            angle_errors[mode] = np.maximum(angle_errors[mode], errors.angles)
            rate_errors[mode] = np.maximum(rate_errors[mode], errors.rates)
    return InterpolationErrors(
        angles=ERROR_BETWEEN_POINTS * angle_errors,
        rates=ERROR_BETWEEN_POINTS * rate_errors,
    )


def _measure_errors_at_part(
    table: CouplingTable,
    grid_values: GridValues,
    refined_counts: tuple[int, ...],
    mode: int,
    part: tuple[int, ...],
) -> InterpolationErrors:
    """Return the errors (cells,) of interpolation at one point in each cell of a table.

    A cell is a box between neighbouring nodes of the table. The point has the same position
    in all cells. Interpolated values are compared with computed values on a refined grid:

    - angles of the passive variables (joint angles that are not inputs);
    - `coefficients`, the rates of these variables per unit rate of each input;
    - `turning`, angular velocities of links relative to other links, per unit rate of each
      input.

    Parameters
    ----------
    table
        The table.
    grid_values
        Computed values on the refined grid.
    refined_counts
        Number of points of that grid along each input.
    mode
        Position of the assembly mode (way to assemble the links) in the table.
    part
        The point, as numbers of steps of the refined grid along each input. They are
        counted from the corner of the cell with the lowest inputs, from 0 to
        `PARTS_PER_CELL`.
    """
    # (cells, inputs) index of each cell along each input.
    cells = np.indices(tuple(table.count - 1)).reshape(len(refined_counts), -1).T
    position_in_cell = np.array(part) / PARTS_PER_CELL  # from 0 to 1 along each input
    interpolated = table.interpolate(
        mode, cells, np.broadcast_to(position_in_cell, cells.shape)
    )
    # Index of the same point on the refined grid, along each input and in one row.
    point_indices = PARTS_PER_CELL * cells + part
    points = np.ravel_multi_index(tuple(point_indices.T), refined_counts)
    angle_errors = _largest_differences(
        interpolated.angles, grid_values.angles[mode, points]
    )
    coefficient_errors = _largest_differences(
        interpolated.coefficients, grid_values.coefficients[mode, points]
    )
    turning_errors = _largest_differences(
        interpolated.turning, grid_values.turning[mode, points]
    )
    return InterpolationErrors(
        angles=angle_errors, rates=np.maximum(coefficient_errors, turning_errors)
    )


def _largest_differences(interpolated: Floats, computed: Floats) -> Floats:
    """Return the largest absolute difference (n,) of two arrays (n, ...) at each point."""
    differences = np.abs(interpolated - computed)
    return np.max(differences.reshape(len(differences), -1), axis=1, initial=0.0)


def _find_periodic_inputs(table: CouplingTable, periods: Floats) -> None:
    """Find and mark the periodic inputs of a table.

    An input is periodic if all configurations are the same after one revolution of the
    input. A joint angle may differ by whole periods: 2 pi for a joint that turns.
    Interpolation can continue beyond the range of a periodic input.

    Parameters
    ----------
    table
        The table. Its arrays `periodic` and `rise` (growth of the joint angles in one
        revolution) are changed.
    periods
        (K,) period (rad) of each of the K passive variables (joint angles).
    """
    for input_index in range(len(table.inputs)):
        growth = _find_growth_per_revolution(table, input_index, periods)
        if growth is not None:
            table.periodic[input_index] = True
            table.rise[:, input_index] = growth


def _find_growth_per_revolution(
    table: CouplingTable, input_index: int, periods: Floats
) -> Floats | None:
    """Return the growth of each variable in a revolution of an input, or None.

    The caller marks an input with a growth as periodic. The result is None if the
    revolution does not lead back to the same configurations. A variable (joint angle) may
    grow by whole periods, such as the angle of a crank by a revolution. The growth has to
    be the same at all nodes of the other inputs. Coefficients (rates of variables per unit
    rate of the inputs) must not change.

    Parameters
    ----------
    table
        The table.
    input_index
        Position of the input in the table.
    periods
        (K,) period (rad) of each variable: 2 pi for a joint that turns.

    Returns
    -------
    (modes, K) growth (rad) of each variable. None if the range of the input is not exactly
    one revolution, if values do not return, or if a mode is missing at a node.
    """
    range_length = table.step[input_index] * (table.count[input_index] - 1)
    if abs(range_length - TURN) > RETURN_TOLERANCE:
        return None
    angle_change = _change_over_range(table, table.angles, input_index)
    coefficient_change = _change_over_range(table, table.coefficients, input_index)
    # The growth is read at the first node of the other inputs, and compared with the
    # changes at all of their nodes.
    growth = _round_to_whole_periods(angle_change[:, 0], periods)
    # At nodes without a mode the changes are NaN, and these comparisons are false.
    is_returning = (
        max_abs(angle_change - growth[:, np.newaxis]) < RETURN_TOLERANCE
        and max_abs(coefficient_change) < RETURN_TOLERANCE
    )
    return growth if is_returning else None


def _change_over_range(table: CouplingTable, values: Floats, input_index: int) -> Floats:
    """Return the change of values from the first to the last node of an input.

    If the range is one revolution of the input, the changes show whether the values return.
    The values are on a grid of inputs, with nodes at equal steps of each input.

    Parameters
    ----------
    table
        The table with the grid.
    values
        (modes, nodes, ...) values of each assembly mode at the nodes.
    input_index
        Position of the input in the table.

    Returns
    -------
    (modes, nodes of the other inputs, values of a node) changes.
    """
    mode_count = len(values)
    value_count = math.prod(values.shape[2:])
    # (modes, nodes along each input, values of a node)
    grid = values.reshape(mode_count, *table.count, value_count)
    first = np.take(grid, 0, axis=1 + input_index)
    last = np.take(grid, -1, axis=1 + input_index)
    return (last - first).reshape(mode_count, -1, value_count)


def _round_to_whole_periods(angle_change: Floats, periods: Floats) -> Floats:
    """Return changes of variables (..., K), rounded to whole periods (K,) of each variable.

    The changes are those over a revolution of an input. An angle then changes by whole
    periods (revolutions), apart from rounding errors. A variable that never repeats has an
    infinite period, and its rounded change is zero.
    """
    has_period = np.isfinite(periods)
    rounded = np.zeros_like(angle_change)
    period_counts = np.round(angle_change[..., has_period] / periods[has_period])
    rounded[..., has_period] = period_counts * periods[has_period]
    return rounded
