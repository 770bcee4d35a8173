"""Slices of the configurations of a mechanism: all inputs but one are locked.

A slice is the set of configurations with the locked inputs at given values. It consists of
curves. The parameter of each curve is its arc length, so the curve can be followed through
dead points of the free input.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.errors import AnalysisError, CountError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_continuation import follow_arcs
from spherekit.positions.curve_segment import CurvePoints
from spherekit.positions.position_solver import PositionSolver
from spherekit.singularities.locus import LocusPoints, SingularityLocus
from spherekit.status import Status
from spherekit.time_limit import TimeLimit
from spherekit.wording import counted

FREE_INPUT_VALUES_OF_DYADS = 181
"""Number of values of the free input, over one revolution, at which modes of a
mechanism of dyads are searched. Larger: smaller closed curves of a slice are found;
smaller: faster."""
FREE_INPUT_VALUES_OF_GROUPS = 7
"""The same number for mechanisms with larger groups, whose modes take longer to find."""
MAX_SLICE_CURVE_LENGTH_RAD = 200.0
"""Arc length after which a curve of a slice is ended. Larger: curves that do not close take
longer; smaller: long curves are cut."""
SLICES_AT_ONCE = 12
"""Number of slices of dyads whose curves are followed together, which saves time.
Larger: the time limit is checked less often."""


def solver_of(mechanism: Mechanism) -> PositionSolver:
    """Return the position solver of a mechanism; assembly modes are not searched here.

    The solver needs as many degrees of freedom as inputs. The degrees of freedom are
    counted from the numbers of links and pairs (joints). If this count is wrong because of
    special dimensions, the degrees of freedom follow from the rank of the closure
    equations.

    Raises
    ------
    PlanError
        If the mechanism does not have as many degrees of freedom as inputs.
    """
    try:
        return PositionSolver(mechanism, plan_assembly(mechanism))
    except CountError:
        return PositionSolver(mechanism, plan_assembly(mechanism, by_rank=True))


def configurations(solver: PositionSolver, q: Floats) -> tuple[Floats, Indices]:
    """Return the closed configurations of all assembly modes at given inputs.

    An assembly mode is one of the ways to assemble the links at the same inputs. A search
    for further configurations starts from the returned ones.

    Parameters
    ----------
    solver
        The position solver of the mechanism.
    q
        (k, inputs) values of the inputs (rad).

    Returns
    -------
    values
        (n, V) the V pair variables of n configurations (rad).
    input_rows
        (n,) row of `q` to which each configuration belongs.
    """
    value_parts = [np.zeros((0, len(solver.mechanism.variable_owners)))]
    row_parts = [np.zeros(0, dtype=np.intp)]
    if solver.assembly.has_closed_form:
        # Each group of links is a dyad (two links joined by a pair). A dyad can be
        # closed in two ways, which are distinguished by a sign.
        for signs in product((1, -1), repeat=len(solver.assembly.groups)):
            # `evaluate` uses only the signs of the mode, so its number has no meaning here.
            mode = AssemblyMode(number=0, signs=signs)
            motion = solver.evaluate(mode, q)
            closed_rows = np.flatnonzero(motion.status == Status.OK)
            value_parts.append(motion.values[closed_rows])
            row_parts.append(closed_rows)
    else:
        for row, input_values in enumerate(q):
            # The groups have more than two links, so all solutions have to be searched.
            values = enumerate_assemblies(solver, input_values).values
            value_parts.append(values)
            row_parts.append(np.full(len(values), row))
    return np.concatenate(value_parts), np.concatenate(row_parts)


def _follow_slices(
    solver: PositionSolver,
    free_input: int,
    input_values: Floats,
    time_limit: TimeLimit,
) -> Iterator[ArcCurve]:
    """Yield the curves of several slices. They are later searched for singularities.

    A slice is the set of configurations with all inputs but one locked at given values. A
    slice can consist of several curves. In each pass, one curve of every slice is followed.
    Curves start from the assembly modes (ways to assemble the links) at some values of the
    free input. A curve that passes none of these values is missed. A curve that does not
    close is ended after `MAX_SLICE_CURVE_LENGTH_RAD`.

    Parameters
    ----------
    solver
        The position solver of the mechanism.
    free_input
        Index of the free input among the inputs of the mechanism.
    input_values
        (slices, inputs) values of the inputs (rad). The column of the free input is not
        used.
    time_limit
        No further curves are followed after this time.
    """
    locked_variables = np.delete(solver.driven, free_input).tolist()
    locked_values = np.delete(input_values, free_input, axis=1)
    # Configurations of each slice that are on no curve yet.
    remaining_starts = _slice_starts(solver, free_input, input_values)
    while True:
        unfinished = [
            number for number, starts in enumerate(remaining_starts) if len(starts)
        ]
        if not unfinished:
            return
        if not time_limit.goes_on(f"curves of {counted(len(unfinished), 'slice')}"):
            return
        # The next curve of each slice, from its first remaining start.
        closure = solver.closure.locked(locked_variables, locked_values[unfinished])
        first_starts = np.stack([remaining_starts[number][0] for number in unfinished])
        curves = follow_arcs(closure, first_starts, longest=MAX_SLICE_CURVE_LENGTH_RAD)
        for number, curve in zip(unfinished, curves, strict=True):
            # The start is not tried again, even if no curve could be followed from it.
            other_starts = remaining_starts[number][1:]
            if curve is None:
                remaining_starts[number] = other_starts
            else:
                is_passed = curve.passes(other_starts)
                remaining_starts[number] = other_starts[~is_passed]
                yield curve


def _slice_starts(
    solver: PositionSolver, free_input: int, input_values: Floats
) -> list[Floats]:
    """Return start configurations for following the curves of each slice.

    A slice is the set of configurations in which all inputs but one are locked. The starts
    are all assembly modes (ways to assemble the links) at some values of the free input.
    These values are spread evenly over one revolution.

    Parameters
    ----------
    solver
        The position solver of the mechanism.
    free_input
        Index of the free input among the inputs.
    input_values
        (slices, inputs) values of the inputs (rad). The column of the free input is not
        used.

    Returns
    -------
    For each slice the variables (starts, V) of the configurations (rad).
    """
    # If all groups of links are dyads (two links joined by a pair), modes are computed by
    # formulas in little time. For other groups modes have to be searched, so fewer values
    # are examined.
    if solver.assembly.has_closed_form:
        value_count = FREE_INPUT_VALUES_OF_DYADS
    else:
        value_count = FREE_INPUT_VALUES_OF_GROUPS
    free_values = (np.arange(value_count) + 0.5) * (2.0 * np.pi / value_count) - np.pi
    # One row for each slice and free value, with the slice of each row.
    slice_count = len(input_values)
    slice_of_row = np.repeat(np.arange(slice_count), value_count)
    q = input_values[slice_of_row]
    q[:, free_input] = np.tile(free_values, slice_count)
    starts, rows = configurations(solver, q)
    slice_of_start = slice_of_row[rows]
    return [starts[slice_of_start == number] for number in range(slice_count)]


@dataclass(frozen=True)
class LockedInputSection:
    """Curves of configurations along which one input moves while the others are locked.

    A slice is the set of all configurations with all inputs but one locked at fixed values.
    It consists of curves. Each input is free in turn, and the others are locked at the
    values of a regular grid. The curves are searched for singular configurations.

    Attributes
    ----------
    slices
        The curves of all slices, in the order in which they were followed.
    gaps
        For each input the distance (rad) between successive values at which it is locked.
    note
        A text for users that says which slices were left out because the time limit was
        reached. It is empty if no slice was left out.
    """

    slices: tuple[ArcCurve, ...]
    gaps: tuple[float, ...]
    note: str


def cut(
    solver: PositionSolver,
    ranges: Sequence[tuple[float, float]],
    values_of_each: int,
    budget: TimeLimit | None = None,
) -> LockedInputSection:
    """Follow the curves of configurations with each input free in turn, the others locked.

    The configurations with all inputs but one at fixed values are a slice. The curves are
    searched for singular configurations afterwards. The locked values are spread evenly
    over the ranges of the inputs. The order of the slices covers the ranges evenly even if
    the time ends early.

    Parameters
    ----------
    solver
        The position solver of the mechanism.
    ranges
        Lowest and highest value (rad) of each input.
    values_of_each
        Number of values at which each input is locked, at least 1.
    budget
        Processor time to spend, unlimited by default. Each free input gets an equal share
        of the time that its predecessors leave.

    Returns
    -------
    The curves of all slices, the distances (rad) between successive locked values of each
    input (`gaps`), and a note of what was left out because the time was spent.

    Raises
    ------
    AnalysisError
        If `values_of_each` is not a whole number of at least 1.
    """
    if not values_of_each >= 1 or values_of_each % 1 != 0:
        raise AnalysisError(
            f"{solver.mechanism.name}: values_of_each: found {values_of_each}, expected a "
            "whole number of at least 1"
        )
    time_limit = budget or TimeLimit()
    # In closed form the curves of several slices are followed together, which saves time.
    slices_at_once = SLICES_AT_ONCE if solver.assembly.has_closed_form else 1
    # The middles of equal parts of the range of each input.
    numbers = np.arange(values_of_each) + 0.5
    locked_values = [low + (high - low) * numbers / values_of_each for low, high in ranges]
    curves: list[ArcCurve] = []
    notes = []
    for free_input in range(len(ranges)):
        # One row for each slice; the value of the free input is a placeholder.
        before = locked_values[:free_input]
        after = locked_values[free_input + 1 :]
        grid = np.array([*product(*before, [0.0], *after)])

        input_values = grid[_spread_order(len(grid))]
        # The remaining time is divided equally among the inputs that have not been free.
        remaining_inputs = len(ranges) - free_input
        share = time_limit.part(1.0 / remaining_inputs)
        for first in range(0, len(input_values), slices_at_once):
            if not share.goes_on(f"slice {first + 1} of {len(input_values)}"):
                break
            chunk = input_values[first : first + slices_at_once]
            curves += _follow_slices(solver, free_input, chunk, share)
        if share.note:
            notes.append(f"{share.note} with input {free_input + 1} free")
    # Closed curves of singularities that fit between the slices can be missed, so users are
    # told the distances.
    gaps = tuple((high - low) / values_of_each for low, high in ranges)
    return LockedInputSection(tuple(curves), gaps, "; ".join(notes))


def _spread_order(count: int) -> list[int]:
    """Return the numbers below `count` in an order whose beginnings are spread evenly.

    If a search in this order is stopped early, its values still cover the whole range.
    Numbers are sorted by their binary digits in reverse order (van der Corput). For
    example, 8 numbers have the order 0, 4, 2, 6, 1, 5, 3, 7.
    """
    digit_count = (count - 1).bit_length()

    def reversed_digits(number: int) -> str:
        """Return the binary digits of a number, the lowest one first."""
        return f"{number:0{digit_count}b}"[::-1]

    return sorted(range(count), key=reversed_digits)


def singular_points_on_slice(curve: ArcCurve, locus: SingularityLocus) -> LocusPoints:
    """Return the singular configurations of one type on a curve of configurations.

    A function of the configuration (the measure) is zero at singular configurations. The
    zeros of the measure along the curve are located first. From each zero, Newton's method
    computes a singular configuration more exactly, with its singular motion: rates that
    close the loops while the inputs (or the output) rest.

    Parameters
    ----------
    curve
        A curve of configurations in which all inputs but one have fixed values.
    locus
        The set of all singular configurations of the type.
    """

    def measure_along_curve(points: CurvePoints) -> tuple[Floats, Floats]:
        """Return a determinant that is zero in singular configurations, and its derivative.

        Determinant and derivative with respect to the arc length are arrays (n,), for n
        points of the curve.
        """
        # All rates that close the loops. The columns of `space.basis` are orthonormal.
        space = locus.tangent_space(points.values)
        measure = locus.measure(space)
        # The gradient has the derivatives along the columns of the basis. The derivative
        # along the curve is the scalar product of the gradient and the tangent, if the
        # tangent is given by its coordinates along the same columns.
        tangent_coordinates = np.vecmat(points.tangents, space.basis)
        return measure.value, np.vecdot(measure.gradient, tangent_coordinates)

    zeros = curve.locate(measure_along_curve)
    # `project` applies Newton's method to the configurations at the zeros.
    return locus.project(curve.at(zeros.places).values)
