"""Computes all configurations of a mechanism at many samples of its inputs at once.

The groups of the mechanism (dyads and irreducible groups, see
`spherekit.planning.assembly_plan`) are placed one after another, in solving order. Each
configuration of the earlier groups can lead to several of the next group. A dyad has two
configurations in closed form. The equations of a triad, or of a group of seven bodies,
state that its binary links have the given arcs. These equations are solved by elimination
(`spherekit.positions.elimination`) for all samples together. A group without elimination
needs a search from random starts, which this module does not contain.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.trigonometric_system import estimate_real_angles
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import Group
from spherekit.positions.arc_equations import GroupGeometry
from spherekit.positions.elimination import MIN_ELIMINATION_ARC_SINE
from spherekit.positions.elimination_order import (
    EliminationOrder,
    find_binary_links,
    find_elimination_orders,
    has_elimination,
)
from spherekit.positions.group_assembly import (
    AssemblyState,
    group_closure,
    group_variables,
    place_dyad,
)
from spherekit.positions.group_solutions import (
    MAX_CORRECTION_RAD,
    find_distinct_by_elimination,
    sortable_angles,
)
from spherekit.positions.linear_equations import condition_numbers, solve_least_norm
from spherekit.positions.loop_closure import Closure
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import POLISHING_STEPS
from spherekit.tolerances import CLOSURE_TOLERANCE, SINGULAR_DYAD_SINE

SAMPLES_AT_ONCE = 256
"""Number of samples that are solved together. Larger: the arrays do not fit into the
caches, and each sample takes longer; smaller: more calls."""
REAL_BELOW_RAD = 1e-9
"""Solutions with a smaller imaginary part are real. The error of a simple solution is far
smaller. Samples with an imaginary part between this and `COMPLEX_ABOVE_RAD` are examined
one by one."""
COMPLEX_ABOVE_RAD = 1e-4
"""Solutions with a larger imaginary part are complex. Rounding gives two solutions that
coincide an imaginary part of about 1e-8."""
MIN_SEPARATION_RAD = 1e-4
"""Samples with two configurations that differ by less are examined one by one."""
MAX_CONDITION_NUMBER = 1e5
"""Samples with a configuration at which the Jacobian of the group has a larger condition
number are examined one by one. Two configurations may coincide there up to rounding."""
LARGEST_POLISHING_STEP_RAD = 1e-12
"""Largest change of a variable in the last Newton step of a configuration.

A larger step is not made.

The residual of a closed group causes a larger step only near a singular configuration.
"""
SAME_FRAME_TOLERANCE = 1e-13
"""Pair frames whose components all differ by less have the same solutions."""
MAX_EXAMINED_ROWS = 200
"""Largest number of rows of one group that are examined one by one, at about 6 ms each, in
each batch of `SAMPLES_AT_ONCE` samples. Further rows are reported as incomplete."""


@dataclass(frozen=True)
class SampleConfigurations:
    """All configurations of a mechanism at n samples (values) of its inputs, in one table.

    At a sample the mechanism can be assembled in several ways, so it can have several
    configurations. The configurations are sorted by sample.

    A dyad is two links that a middle pair joins to each other, and two outer pairs to links
    that are placed before. It closes in two configurations. They coincide at the dead
    centre, where the three axes of the dyad are in one plane. If the sine of the angle at
    the middle axis is below `SINGULAR_DYAD_SINE`, the two configurations count as one. A
    dyad turns freely if its outer axes lie on one line. Of its infinitely many
    configurations, one is in the table.

    Attributes
    ----------
    sample
        (k,) index of the sample of each configuration, rising.
    values
        (k, variables) variables (rad) of the mechanism.
    is_complete
        (n,) whether all real configurations of the sample are certainly in the table,
        except those of singular dyads, as stated above.
    problem
        Why configurations may be missing at samples that are not complete. Empty if no
        reason is known.
    """

    sample: Indices
    values: Floats
    is_complete: Bools
    problem: str


@dataclass(frozen=True)
class GroupConfigurations:
    """Configurations of one group of links, which is placed after other groups.

    A *row* is one configuration of all earlier groups at one sample of the inputs. For each
    of the n rows, the group can have any number of configurations. All k configurations are
    stored in common arrays.

    Attributes
    ----------
    row
        (k,) row to which each configuration belongs, rising.
    values
        (k, pairs) variables (rad) of the pairs of the group.
    is_complete
        (n,) whether all real configurations of the group at the row are certainly in the
        table.
    problem
        Why configurations may be missing at rows that are not complete. Empty if no reason
        is known.
    """

    row: Indices
    values: Floats
    is_complete: Bools
    problem: str


@dataclass(frozen=True)
class GroupPlacement:
    """The placed bodies, after one more group of links was placed in all possible ways.

    Before, there were n old rows. A row is one configuration of all groups placed so far,
    at one sample of the inputs. Each old row leads to a new row for each configuration of
    the group.

    Attributes
    ----------
    state
        The bodies in the k new rows. An old row has no new row if the group cannot be
        closed.
    parent
        (k,) old row from which each new row comes, in rising order.
    is_complete
        (n,) whether all real configurations of the group at the old row are in the result.
    problem
        Why configurations may be missing at rows that are not complete. Empty if no reason
        is known.
    """

    state: AssemblyState
    parent: Indices
    is_complete: Bools
    problem: str = ""


def can_enumerate(solver: PositionSolver) -> bool:
    """Return whether each group is a dyad, a train of wheels, or has an elimination."""
    return all(
        group.is_dyad or number in solver.wheel_trains or has_elimination(group)
        for number, group in enumerate(solver.assembly.groups)
    )


def enumerate_configurations(solver: PositionSolver, q: Floats) -> SampleConfigurations:
    """Return all configurations of a mechanism at many samples of its inputs.

    At a sample the mechanism can be assembled in several ways. Many samples are computed
    together, which is faster.

    Parameters
    ----------
    solver
        The mechanism. Each of its groups of links must be a dyad, a train of wheels, or
        have equations that elimination solves (see `can_enumerate`).
    q
        (n, inputs) values of the inputs (rad) at each sample.

    Returns
    -------
    The configurations. `is_complete` says for each sample whether all were found, and
    `problem` why some may be missing. The order within a sample is the same as in
    `spherekit.positions.assembly_enumeration.enumerate_assemblies`.
    """
    batches = []
    for first in range(0, len(q), SAMPLES_AT_ONCE):
        batch = _enumerate_batch(solver, q[first : first + SAMPLES_AT_ONCE])
        batches.append((first, batch))
    problems = [batch.problem for _, batch in batches if batch.problem]
    # One more Newton step for all loops removes most of the remaining error.
    values = _polish(solver, np.concatenate([batch.values for _, batch in batches]))
    return SampleConfigurations(
        sample=np.concatenate([first + batch.sample for first, batch in batches]),
        values=values,
        is_complete=np.concatenate([batch.is_complete for _, batch in batches]),
        problem=problems[0] if problems else "",
    )


def _polish(solver: PositionSolver, values: Floats) -> Floats:
    """Return closed configurations after one more Newton step of all their loops.

    Before, the loops are closed to about 1e-15 rad. This leaves errors of about 1e-15 rad
    in most variables, and larger ones near singular configurations. The step removes most
    of the larger errors; the rest is rounding.

    Parameters
    ----------
    solver
        The mechanism. Its inputs stay constant.
    values
        (k, variables) closed configurations (rad).

    Returns
    -------
    (k, variables) corrected configurations (rad). Configurations stay unchanged if the step
    is larger than `LARGEST_POLISHING_STEP_RAD`, because such a step is not a correction.
    """
    linearisation = solver.closure.linearise(values)
    passive = np.delete(np.arange(values.shape[1]), solver.driven)
    step = np.zeros_like(values)
    step[:, passive] = solve_least_norm(
        linearisation.jacobian[:, :, passive], -linearisation.residual
    )
    # Next to a singular configuration the step is meaningless and can be large.
    is_small = max_abs(step, axis=1) < LARGEST_POLISHING_STEP_RAD
    return np.where(is_small[:, None], values + step, values)


def _enumerate_batch(solver: PositionSolver, q: Floats) -> SampleConfigurations:
    """Return all configurations at one batch of inputs q (n, inputs), in rad.

    A group is a set of links that are placed together, such as a dyad (two links). Groups
    are placed one after the other. Each partial configuration is continued in all ways to
    place the next group.
    """
    # (n,) whether all configurations of each sample were found.
    is_complete = np.ones(len(q), dtype=bool)
    # The first reason why some may be missing, or an empty text.
    problem = ""
    # A row is one partial configuration of one sample. `sample` has the sample of each row,
    # and `state` the bodies that are placed in it.
    sample = np.arange(len(q))
    with np.errstate(all="ignore"):
        state = solver.start(q)
        for position, group in enumerate(solver.assembly.groups):
            if group.is_dyad:
                placement = _place_both_modes(state, group)
            elif position in solver.wheel_trains:
                placement = _place_wheel_train(solver, position, state=state, q=q[sample])
            else:
                placement = _place_by_elimination(state, group, sample)
            is_complete[sample[~placement.is_complete]] = False
            problem = problem or placement.problem
            # The rows of the next group: one for each way to place this group at each old
            # row. `parent` has the old row of each new row.
            state = placement.state
            sample = sample[placement.parent]
    return SampleConfigurations(
        sample=sample, values=state.values, is_complete=is_complete, problem=problem
    )


def _place_both_modes(state: AssemblyState, group: Group) -> GroupPlacement:
    """Place a dyad (two links joined by a pair) in both ways in which it closes.

    A formula gives both ways, told apart by a sign. An old row is one configuration of the
    groups that are already placed. A new row is an old row with the dyad in one of its two
    ways. New rows that come from the same old row follow each other, sign 1 first.

    Parameters
    ----------
    state
        The bodies at n old rows, before the dyad is placed. This object is not changed.
    group
        The dyad.

    Returns
    -------
    The new rows. A dyad that does not close at an old row gives none.
    """
    states = []
    parents = []
    for sign in (1, -1):
        placed = state.copy()
        # The sine of the angle at the middle axis is zero at the dead centre, where the
        # three axes of the dyad are in one plane.
        sine = place_dyad(placed, group, sign)
        # `is_open` marks the rows at which the dyad does not close.
        closes = ~placed.is_open
        # In a flat dyad both signs give nearly the same configuration, which is counted for
        # sign 1 only. A dyad that turns freely also counts as flat.
        is_flat = sine < SINGULAR_DYAD_SINE
        if sign < 0:
            closes &= ~is_flat
        parents.append(np.flatnonzero(closes))
        states.append(placed.rows(parents[-1]))
    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")
    return GroupPlacement(
        state=AssemblyState.concatenate(states).rows(order),
        parent=parent[order],
        # The formula finds both ways, so every old row counts as complete. A dyad that
        # turns freely counts as complete, too: by convention one of its infinitely many
        # configurations stands for all (see `SampleConfigurations`).
        is_complete=np.ones(len(state.values), dtype=bool),
    )


def _place_wheel_train(
    solver: PositionSolver, position: int, state: AssemblyState, q: Floats
) -> GroupPlacement:
    """Place a train of wheels, which has a single configuration at given inputs.

    Gear ratios determine the configuration. A row is one configuration of the earlier
    groups of links.

    Parameters
    ----------
    solver
        The mechanism.
    position
        Position of the train among the groups, in solving order.
    state
        The bodies at n rows. This object is changed: the train is placed in it.
    q
        (n, inputs) values of the inputs (rad) at the rows.

    Returns
    -------
    New rows for the old rows at which the loops of the train close.
    """
    train = solver.place_wheel_train(state, position, q)
    parent = np.flatnonzero(train.closure_residual < CLOSURE_TOLERANCE)
    return GroupPlacement(
        state=state.rows(parent),
        parent=parent,
        # No configuration is missing at any old row, as the train has only one.
        is_complete=np.ones(len(q), dtype=bool),
    )


def _place_by_elimination(
    state: AssemblyState, group: Group, sample: Indices
) -> GroupPlacement:
    """Place a group of links in all configurations that elimination finds.

    A row is one configuration of the groups placed before, at one sample of the inputs.
    Elimination reduces the equations of the group to a polynomial in one angle.

    Parameters
    ----------
    state
        The bodies at n rows, before the group is placed. This object is not changed.
    group
        A group of revolute pairs only.
    sample
        (n,) index of the sample of the inputs of each row, rising. Rows of the same sample
        can have equal equations, which are then solved only once.

    Returns
    -------
    New rows, one for each configuration of the group at each old row.
    """
    closure = group_closure(state, group)
    configurations = _eliminate_distinct_rows(group, closure, sample)
    # For each configuration, the index of the old row from which it comes.
    parent = configurations.row
    # Continue each row with each of its configurations of the group.
    closed_loops = closure.select_rows(parent).linearise(configurations.values)
    new_state = state.rows(parent)
    new_state.merge(group, closed_loops.rotations)
    # Store the angles of the pairs of this group.
    new_state.values[:, group_variables(new_state, group)] = configurations.values
    return GroupPlacement(
        state=new_state,
        parent=parent,
        is_complete=configurations.is_complete,
        problem=configurations.problem,
    )


def _eliminate_distinct_rows(
    group: Group, closure: Closure, sample: Indices
) -> GroupConfigurations:
    """Return the configurations of one group of links at all rows; solve equal rows once.

    A row is one configuration of the groups that are placed before, so a sample of the
    inputs can have several rows. If this group does not depend on the earlier groups, its
    equations are equal in all rows of a sample. Equal equations are solved once for each
    sample.

    Parameters
    ----------
    group
        A group of revolute pairs. Elimination reduces its equations to a polynomial.
    closure
        The loop equations of the group at n rows.
    sample
        (n,) index of the sample of each row, rising.
    """
    representative = _find_representative_rows(closure, sample)
    solved_rows = np.unique(representative)
    solved = _eliminate_rows(group, closure.select_rows(solved_rows))
    if len(solved_rows) == len(sample):
        return solved
    # In `solved`, rows are numbered by their position in `solved_rows`.
    return _repeat_configurations(solved, np.searchsorted(solved_rows, representative))


def _find_representative_rows(closure: Closure, sample: Indices) -> Indices:
    """Return, for each row (n,), the index of a row with equal equations.

    The result serves to solve equal equations once. Groups of links are placed one after
    the other. A row is one configuration of the groups placed so far, at one sample of the
    inputs. So a sample has several rows if the earlier groups have several configurations.
    Each row is compared with the first row of its sample. The result is this first row if
    the equations of the next group are equal in both, otherwise the row itself.

    Parameters
    ----------
    closure
        The loop equations of the next group at n rows.
    sample
        (n,) index of the sample of each row, rising.
    """
    # For each row the first row with the same sample (`sample` is sorted).
    first_row = np.searchsorted(sample, sample)
    # At given angles of the pairs that have been placed, the links that these pairs join
    # form rigid bodies. The next group joins these bodies by its pairs. Its equations
    # depend on the earlier groups only by the orientations of links in their bodies. So
    # these orientations are compared, for the first and the second link of each pair.
    assert closure.body_from_links is not None
    first_links, second_links = closure.body_from_links  # (n, pairs, 3, 3) each
    # (n,) largest difference of any number of a row.
    first_difference = max_abs(first_links - first_links[first_row], axis=(1, 2, 3))
    second_difference = max_abs(second_links - second_links[first_row], axis=(1, 2, 3))
    difference = np.maximum(first_difference, second_difference)
    has_equal_equations = difference < SAME_FRAME_TOLERANCE
    return np.where(has_equal_equations, first_row, np.arange(len(sample)))


def _repeat_configurations(
    solved: GroupConfigurations, solved_row: Indices
) -> GroupConfigurations:
    """Copy the configurations of solved rows to all rows with the same equations.

    A row is one configuration of earlier groups of links. Equal equations were solved once.

    Parameters
    ----------
    solved
        Configurations of a group at m solved rows, which are numbered from 0.
        `is_complete` (m,) says for each row whether all were found.
    solved_row
        (n,) for each row the index of the solved row with the same equations.

    Returns
    -------
    Configurations at the n rows.
    """
    solved_row_count = len(solved.is_complete)
    # (m + 1,) where the configurations of each solved row begin. Example: [0, 4, 6] means
    # that row 0 has the configurations 0 to 3, and row 1 has 4 and 5.
    first_configurations = np.searchsorted(solved.row, np.arange(solved_row_count + 1))
    copied_indices = [
        np.arange(first_configurations[row], first_configurations[row + 1])
        for row in solved_row
    ]
    counts = [len(indices) for indices in copied_indices]
    return GroupConfigurations(
        row=np.repeat(np.arange(len(solved_row)), counts),
        values=solved.values[np.concatenate(copied_indices)],
        is_complete=solved.is_complete[solved_row],
        problem=solved.problem,
    )


def _eliminate_rows(group: Group, closure: Closure) -> GroupConfigurations:
    """Return the configurations of one group at n rows.

    A row is one configuration of the groups placed before, at one sample of the inputs.
    Elimination turns the equations of the group into a polynomial in exp(i angle) of one
    angle. Real angles are its roots on the unit circle. Three methods are applied in turn,
    each to the rows that the methods before left open:

    1. The real roots on the unit circle, for all rows together.
    2. All complex roots, for all rows together.
    3. The elimination with all its checks, row by row. Rows are left for this method if two
       solutions nearly coincide, or if a solution was lost. At most `MAX_EXAMINED_ROWS`
       rows are examined in this way; the others are incomplete and have no configurations.

    Parameters
    ----------
    group
        A group that has an elimination.
    closure
        The loop equations of the group at n rows.

    Returns
    -------
    The configurations, sorted by row and then by angles. The result also states for each
    row whether no configuration can be missing, and the first reason why at the others.
    """
    assert closure.body_from_links is not None
    count = len(closure.body_from_links[0])
    is_complete = np.zeros(count, dtype=bool)
    # Parts of the result: rows, and the configurations there.
    row_parts = [np.empty(0, dtype=np.intp)]
    value_parts = [np.empty((0, len(group.pairs)))]
    # 1. and 2.: all rows that are not complete yet, in batches.
    for solve in (_solve_real_roots, _solve_all_roots):
        (unsolved_rows,) = np.nonzero(~is_complete)
        for first in range(0, len(unsolved_rows), SAMPLES_AT_ONCE):
            rows = unsolved_rows[first : first + SAMPLES_AT_ONCE]
            batch = _solve_batch(
                group, closure.select_rows(rows), count=len(rows), solve=solve
            )
            is_complete[rows] = batch.is_complete
            row_parts.append(rows[batch.row])
            value_parts.append(batch.values)
    # 3.: the remaining rows one by one.
    doubtful = np.flatnonzero(~is_complete)
    problem = "elimination was doubtful at too many samples"
    problems = [problem] if len(doubtful) > MAX_EXAMINED_ROWS else []
    for row, configurations, reason in _examine_rows(
        group, closure, doubtful[:MAX_EXAMINED_ROWS]
    ):
        is_complete[row] = not reason
        problems += [reason] if reason else []
        row_parts.append(np.full(len(configurations), row))
        value_parts.append(configurations)
    # Sort by row, then by the angles. `lexsort` takes the last key first.
    all_rows = np.concatenate(row_parts)
    all_values = np.concatenate(value_parts)
    order = np.lexsort((*sortable_angles(all_values).T[::-1], all_rows))
    return GroupConfigurations(
        row=all_rows[order],
        values=all_values[order],
        is_complete=is_complete,
        problem=problems[0] if problems else "",
    )


def _solve_batch(
    group: Group,
    closure: Closure,
    count: int,
    solve: Callable[[GroupGeometry, EliminationOrder], tuple[Floats, Bools]],
) -> GroupConfigurations:
    """Return the configurations of a group at the rows where a method has found all.

    A row is one configuration of the groups placed before, at one sample of the inputs.
    Newton's method closes the loops from each real solution. A row passes if each solution
    converges nearby, is well conditioned, and differs from the others.

    Parameters
    ----------
    group
        A group that has an elimination.
    closure
        The loop equations of the group at n rows.
    count
        Number n of rows.
    solve
        The method. It returns the real solutions (n, m, t), padded by NaN, and (n,) whether
        these are all. A solution has the t angles (rad) of the pairs of a tree, which is
        the group without the binary links whose arcs are the equations.

    Returns
    -------
    Configurations only of the rows that pass. `is_complete` (n,) is True for these rows.
    """
    # At zero angles the pair states are the frames of the pairs in their bodies.
    states = closure.linearise(np.zeros((count, len(group.pairs)))).states
    frames = np.stack([states.first, states.second])
    geometry = GroupGeometry(group, pair_frames=np.moveaxis(frames, 1, 2))
    order = find_elimination_orders(group)[0]
    tree_angles, is_clear = solve(geometry, order)
    # The arc of a very short binary link is not well described by its cosine.
    for link in find_binary_links(group):
        is_clear &= geometry.arc_sines(link) >= MIN_ELIMINATION_ARC_SINE
    is_real = all_finite(tree_angles, 2)
    # Close the group by Newton's method from the angles of all pairs. `number` counts the
    # solutions of a row.
    row, number = np.nonzero(is_real & is_clear[:, None])
    placed = geometry.place_bodies(order, np.where(is_real[..., None], tree_angles, 0.0))
    start_values = geometry.measure_pair_angles_at(placed[row, number], row)
    linearisation = closure.select_rows(row).solve(start_values, max_steps=POLISHING_STEPS)
    correction = max_abs(wrap(linearisation.values - start_values), axis=1)
    is_sound = (linearisation.closure_residual < CLOSURE_TOLERANCE) & (
        correction < MAX_CORRECTION_RAD
    )
    is_sound &= condition_numbers(linearisation.jacobian) < MAX_CONDITION_NUMBER
    is_clear[row[~is_sound]] = False
    # Two real solutions must not converge to the same configuration. Points on the unit
    # circle are compared, which do not depend on whole turns.
    directions = np.full((*is_real.shape, len(group.pairs)), np.nan, dtype=complex)
    directions[row, number] = np.exp(1j * linearisation.values)
    distances = max_abs(directions[:, :, None] - directions[:, None], axis=3)
    distances[:, *np.diag_indices(is_real.shape[1])] = np.inf
    is_clear &= ~np.any(distances < MIN_SEPARATION_RAD, axis=(1, 2))
    is_kept = is_clear[row]
    return GroupConfigurations(
        row=row[is_kept],
        values=linearisation.values[is_kept],
        is_complete=is_clear,
        problem="",
    )


def _solve_real_roots(
    geometry: GroupGeometry, order: EliminationOrder
) -> tuple[Floats, Bools]:
    """Return the real solutions of the equations of a group, without complex ones.

    A group is a set of bodies that are placed together. Its pairs (joints) form t closed
    loops, where t is 2 or 3. The equations are formed in three steps:

    1. Remove t bodies that have two pairs each. The other bodies form a tree without loops.
    2. The angles of the t pairs of the tree are the unknowns.
    3. Each removed body gives an equation: the arc between its two axes is known.

    All unknowns but one are eliminated. A root of the remaining polynomial is exp(i angle),
    so real angles belong to roots on the unit circle. The other unknowns are computed only
    for these roots. In contrast, `_solve_all_roots` computes them for all roots.

    Parameters
    ----------
    geometry
        The geometry of the group at n rows (configurations of earlier groups).
    order
        The t unknown angles and the removed bodies. All angles but the first are
        eliminated.

    Returns
    -------
    tree_angles
        (n, m, t) real solutions (rad), as starts of Newton's method. Rows with fewer than m
        solutions are filled with NaN.
    is_clear
        (n,) whether the result is reliable: one solution for each root on the unit circle,
        and all other roots clearly off the circle.
    """
    # `incidence` (t, t) says which equation contains which unknown.
    return estimate_real_angles(geometry.form_equations(order), order.incidence)


def _solve_all_roots(
    geometry: GroupGeometry, order: EliminationOrder
) -> tuple[Floats, Bools]:
    """Return the real solutions of the equations of a group, from all complex ones.

    A group is a set of bodies that are placed together. The equations are the same as in
    `_solve_real_roots`: t bodies with two pairs (joints) each are removed, so that the
    other bodies form a tree without loops. The angles of the t pairs of this tree are the
    unknowns. Each removed body gives an equation: the arc between its two axes is known.

    Parameters
    ----------
    geometry
        The geometry of the group at n rows (configurations of earlier groups).
    order
        The t unknown angles and the removed bodies. They also determine the number m of
        complex solutions.

    Returns
    -------
    tree_angles
        (n, m, t) solutions (rad), NaN for those that are not real.
    is_clear
        (n,) whether the result is reliable: all complex solutions were computed, and each
        is clearly real or clearly complex.
    """
    tree_angles, _ = geometry.solve_equations(order)
    imaginary_part = max_abs(tree_angles.imag, axis=2)
    is_real = imaginary_part < REAL_BELOW_RAD
    is_clear = np.all(is_real | (imaginary_part > COMPLEX_ABOVE_RAD), axis=1)
    is_clear &= all_finite(tree_angles, (1, 2))
    return np.where(is_real[..., None], tree_angles.real, np.nan), is_clear


def _examine_rows(
    group: Group, closure: Closure, rows: Indices
) -> Iterator[tuple[int, Floats, str]]:
    """Compute the configurations of a group of links at some rows, one by one.

    A row is one configuration of the groups placed before, at one sample of the inputs. For
    each row the elimination checks whether solutions were lost, and whether nearly equal
    solutions are different. The caller passes only rows at which the methods for many rows
    together have left this open.

    Parameters
    ----------
    group
        A group of revolute pairs. Elimination reduces its equations to a polynomial.
    closure
        The loop equations of the group at all rows.
    rows
        (m,) rows of the closure to examine.

    Yields
    ------
    The row, its configurations (k, pairs) in rad, and why some may be missing (empty if
    none is).
    """
    for row in rows.tolist():
        distinct, problem = find_distinct_by_elimination(
            group, closure.select_rows(np.array([row]))
        )
        values = np.reshape(distinct.values, (-1, len(group.pairs)))
        # There were more configurations than are stored.
        if distinct.is_truncated:
            problem = problem or "only some of many singular configurations are kept"
        yield row, values, problem
