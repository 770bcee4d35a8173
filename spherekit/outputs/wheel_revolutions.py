"""The revolutions of the inputs at which wheels mesh as the file of a mechanism says.

If the output is held, the loops close with the wheels in any mesh, and give the inputs up
to whole revolutions only. A file describes one mesh: the assembly in which the rolled
lengths follow from the inputs over any number of revolutions
(`spherekit.positions.gear_phases`). In another mesh, the mechanism of the file does not
have the held pose at the computed inputs.

An example is a bevel differential with a side gear as input, whose carrier makes half a
revolution while the input makes one. If the carrier is held after this half revolution, the
loops also close with an input of zero. In the mesh of the file, the input is one
revolution.
"""

from itertools import islice, product

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import TURN
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.planning.least_rolling import SAME_ROLLED_LENGTH_RAD
from spherekit.positions.gear_phases import (
    GEAR_RATIO_TOLERANCE,
    MAX_INPUT_REVOLUTIONS,
    MAX_LENGTH_COMBINATIONS,
    MAX_TRIED_ASSEMBLIES,
    GearPhases,
    list_equivalent_lengths,
)
from spherekit.positions.position_solver import PositionSolver
from spherekit.tolerances import CLOSURE_TOLERANCE

MAX_MESH_STEPS = 30
"""Largest number of Newton steps with which loops are closed for other rolled lengths.

Larger: more lengths far from the configuration converge, in more time.
"""


def find_assembled_configuration(
    held_solver: PositionSolver, released_solver: PositionSolver, values: Floats
) -> Floats | None:
    """Return a configuration in which all wheels mesh as in the file of the mechanism.

    If the output is held, the mechanism also closes with wheels that mesh in other teeth.
    The rolled length of each contact is the arc (rad) that one wheel has rolled on the
    other. In the assembly of the file it is a linear function of the inputs, over any
    number of revolutions. Therefore:

    1. The rolled lengths are changed by whole revolutions of the wheels. Many combinations
       of such changes are tried, up to a fixed number.
    2. The loops are closed again with each set of lengths.
    3. Closed loops give each input up to whole revolutions. The revolutions are chosen so
       that the linear functions of the inputs give this set of lengths. If there are no
       such revolutions, the wheels mesh in other teeth than in the file, and the set is
       dropped.

    Parameters
    ----------
    held_solver
        Solver of the mechanism with its output fixed by extra links. Its first variables
        are the variables of `released_solver`.
    released_solver
        Solver of the mechanism itself, whose inputs determine the rolled lengths.
    values
        (variables,) variables of `held_solver`, rad. The loops are closed, the wheels are
        in any mesh.

    Returns
    -------
    (variables,) rad of `held_solver`, in which inputs and rolled lengths agree. Of several
    configurations that differ by whole revolutions of wheels, the one with the smallest sum
    of absolute inputs is returned. None if there is none.
    """
    # The linear functions, and the numbers of the variables that are rolled lengths.
    gear_phases = released_solver.gear_phases
    if gear_phases is None or not gear_phases.variables:
        return values
    driven = list(released_solver.driven)
    rolled = list(gear_phases.variables)
    lengths = _list_possible_lengths(held_solver, gear_phases, values[rolled])
    start_values = np.repeat(values[None], len(lengths), axis=0)
    start_values[:, rolled] = lengths
    with np.errstate(all="ignore"):
        linearisation = held_solver.closure.solve(
            start_values, [*held_solver.driven, *rolled], max_steps=MAX_MESH_STEPS
        )
    is_closed = linearisation.closure_residual < CLOSURE_TOLERANCE
    # Choose the configuration with the smallest sum of absolute inputs among those whose
    # lengths belong to some inputs. If sums are equal up to rounding, the first is chosen.
    best_configuration = None
    least_sum = np.inf
    for configuration in linearisation.values[is_closed]:
        # Closed loops give the inputs only up to whole revolutions, which are removed
        # first.
        q = _find_input_revolutions(
            gear_phases, wrap(configuration[driven]), configuration[rolled]
        )
        if q is None:
            continue
        input_sum = np.sum(np.abs(q))
        # Sums that differ by less than this tolerance count as equal.
        if input_sum < least_sum - SAME_ROLLED_LENGTH_RAD:
            best_configuration = configuration.copy()
            best_configuration[driven] = q
            least_sum = input_sum
    return best_configuration


def _list_possible_lengths(
    held_solver: PositionSolver, gear_phases: GearPhases, lengths: Floats
) -> Floats:
    """Return rolled lengths with which the wheels may mesh as in the mechanism file.

    The rolled length of a contact is the arc (rad) that one wheel has rolled on the other.
    If the same teeth mesh as in the file, the rolled lengths are linear functions of the
    inputs. The given lengths close the loops, but other teeth may mesh.

    The function adds whole revolutions of wheels to the given lengths. It returns the sets
    of lengths that the linear functions have at some inputs. The caller closes the loops
    with each set, and chooses the configuration with the smallest inputs.

    Parameters
    ----------
    held_solver
        Solver of the mechanism with its output held, in which the lengths are variables.
    gear_phases
        The ratios by which the lengths follow from the inputs.
    lengths
        (m,) rolled lengths (rad) that close the loops, one for each contact.

    Returns
    -------
    (n, m) rolled lengths (rad), those nearest to the lengths at inputs of zero first (by
    the sum of absolute differences). There are at most `MAX_TRIED_ASSEMBLIES` sets.
    """
    # The caller prefers small inputs. Lengths are therefore compared with those at inputs
    # of zero. A reference pose may be many revolutions away from there.
    zero_inputs = np.zeros((1, len(gear_phases.anchor_inputs)))
    lengths_at_zero = gear_phases.rolled_lengths(zero_inputs)[0]
    combinations = _combine_equivalent_lengths(
        held_solver, gear_phases, lengths, lengths_at_zero
    )
    possible_lengths = combinations[_can_be_rolled(gear_phases, combinations)]
    changes = np.sum(np.abs(possible_lengths - lengths_at_zero), axis=1)
    order = np.argsort(changes, kind="stable")
    return possible_lengths[order[:MAX_TRIED_ASSEMBLIES]]


def _combine_equivalent_lengths(
    held_solver: PositionSolver,
    gear_phases: GearPhases,
    lengths: Floats,
    lengths_at_zero: Floats,
) -> Floats:
    """Return sets of rolled lengths that differ by whole revolutions of wheels.

    A rolled length is the arc (rad) that one wheel has rolled on another. Wheels look the
    same after a whole revolution. So lengths that close the loops do not show how many
    revolutions the wheels have made. For each contact, several lengths are possible. The
    result has their combinations, one length for each contact. The caller keeps the sets of
    lengths that some values of the inputs produce.

    Parameters
    ----------
    held_solver
        Solver of the mechanism with its output held, in which the lengths are variables.
    gear_phases
        The object whose `variables` are the numbers of the variables that are rolled
        lengths.
    lengths
        (m,) rolled lengths (rad) that close the loops, one for each contact.
    lengths_at_zero
        (m,) rolled lengths (rad) at inputs of zero. Lengths near these are preferred.

    Returns
    -------
    (n, m) rolled lengths (rad). There are at most `MAX_LENGTH_COMBINATIONS` sets, so in a
    mechanism with many contacts some combinations are missing.
    """
    closure = held_solver.closure
    # A change is the difference between a length and the length at inputs of zero. For each
    # contact, the list has the given change, and those that differ from it by whole
    # revolutions of a wheel. The smallest absolute values come first.
    equivalent_changes = []
    changes = lengths - lengths_at_zero
    for variable, change in zip(gear_phases.variables, changes, strict=True):
        contact = closure.tree.pair_of_variable[variable]
        equivalent_changes.append(
            list_equivalent_lengths(closure.joints[contact], float(change))
        )
    combinations = list(islice(product(*equivalent_changes), MAX_LENGTH_COMBINATIONS))
    return lengths_at_zero + np.array(combinations)


def _can_be_rolled(gear_phases: GearPhases, lengths: Floats) -> Bools:
    """Return whether there are inputs at which wheels have rolled the given lengths.

    A rolled length is the arc (rad) that one wheel has rolled on another. The lengths are
    linear functions of the inputs: reference lengths plus ratios @ (change of the inputs).
    The reference lengths are the lengths at one value of the inputs. They say which teeth
    of the wheels mesh. Lengths that belong to no inputs would mean that other teeth mesh,
    so the caller discards them.

    A change of the lengths is possible if it is in the range (column space) of the matrix
    `ratios`: then the projection onto this range does not alter it.

    Parameters
    ----------
    gear_phases
        The reference lengths, and the ratios.
    lengths
        (n, m) sets of rolled lengths (rad).

    Returns
    -------
    (n,) flags.
    """
    ratios = gear_phases.ratios
    projection = ratios @ np.linalg.pinv(ratios)
    length_change = lengths - gear_phases.lengths
    projected_change = length_change @ projection.T
    misfit = max_abs(length_change - projected_change, axis=1)
    return misfit < SAME_ROLLED_LENGTH_RAD


def _find_input_revolutions(
    gear_phases: GearPhases, q: Floats, lengths: Floats
) -> Floats | None:
    """Return inputs that differ from q by whole revolutions and give certain lengths.

    Closed loops determine the inputs only up to whole revolutions. The lengths that the
    wheels have rolled on each other decide how many revolutions there are. Two searches
    propose inputs, and those that give the lengths are kept:

    - All combinations of whole revolutions up to half a period from q are tried, but at
      most `MAX_INPUT_REVOLUTIONS` of each input in both directions. A period is the change
      of an input after which all wheels are in their first positions again.
    - The linear equations of the lengths are solved for some of the inputs, while the rest
      stay at q. Every subset of the inputs is tried. The number of revolutions is not
      limited here.

    Parameters
    ----------
    gear_phases
        The ratios by which the lengths follow from the inputs.
    q
        (inputs,) values of the inputs (rad), known up to whole revolutions.
    lengths
        (m,) rolled lengths (rad): the arcs that wheels have rolled on each other.

    Returns
    -------
    (inputs,) rad, with the smallest sum of absolute values. None if none of the tried
    inputs give the lengths.
    """
    inputs = np.concatenate(
        [
            _list_inputs_of_one_period(gear_phases, q),
            _solve_input_revolutions(gear_phases, q, lengths),
        ]
    )
    misfit = max_abs(gear_phases.rolled_lengths(inputs) - lengths, axis=1)
    possible_inputs = inputs[misfit < SAME_ROLLED_LENGTH_RAD]
    if not len(possible_inputs):
        return None
    return possible_inputs[np.argmin(np.sum(np.abs(possible_inputs), axis=1))]


def _solve_input_revolutions(gear_phases: GearPhases, q: Floats, lengths: Floats) -> Floats:
    """Return inputs that differ from q by whole revolutions and may give certain lengths.

    A rolled length is the arc (rad) that one wheel has rolled on another. The lengths are
    linear functions of the inputs. The lengths may not determine all inputs. So these
    equations are solved for each subset of the inputs, while the other inputs stay at q.

    The solutions are rounded to whole revolutions. A rounded solution may belong to other
    lengths, so the caller compares the lengths.

    Parameters
    ----------
    gear_phases
        The ratios by which the lengths follow from the inputs.
    q
        (inputs,) values of the inputs (rad), known up to whole revolutions.
    lengths
        (m,) rolled lengths (rad).

    Returns
    -------
    (n, inputs) rad, one row for each subset of the inputs.
    """
    length_change = lengths - gear_phases.rolled_lengths(q[None])[0]
    candidates = []
    for is_changed in product((False, True), repeat=len(q)):
        # The pseudo-inverse has rows of zeros for the inputs that stay.
        input_change = np.linalg.pinv(gear_phases.ratios * is_changed) @ length_change
        candidates.append(q + TURN * np.round(input_change / TURN))
    return np.array(candidates)


def _list_inputs_of_one_period(gear_phases: GearPhases, q: Floats) -> Floats:
    """Return inputs that differ from q by whole revolutions, over one period of the wheels.

    The caller looks among these inputs for those that give certain rolled lengths. After
    one period of an input, all wheels are in their first positions again. Inputs beyond one
    period would only repeat these positions.

    Parameters
    ----------
    gear_phases
        `ratios` (contacts, inputs): the length that the wheels of a contact roll on each
        other per unit of each input. `periods` (inputs,): the period (rad) of each input.
    q
        (inputs,) values of the inputs (rad).

    Returns
    -------
    (n, inputs) rad: all combinations of whole revolutions of each input, up to half a
    period in both directions, but at most `MAX_INPUT_REVOLUTIONS`. Inputs that roll no
    wheel remain as they are.
    """
    rolls_wheels = max_abs(gear_phases.ratios, axis=0) > GEAR_RATIO_TOLERANCE
    # (inputs,) whole revolutions in half a period, and the most revolutions from q.
    half_period = np.ceil(0.5 * np.asarray(gear_phases.periods) / TURN)
    limited_half_period = np.minimum(MAX_INPUT_REVOLUTIONS, half_period)
    most_revolutions = np.where(rolls_wheels, limited_half_period, 0).astype(int)
    revolutions_of_inputs = [range(-most, most + 1) for most in most_revolutions.tolist()]
    combinations = np.array(list(product(*revolutions_of_inputs)), dtype=float)
    return q + TURN * combinations
