"""Finds the closed configurations of a mechanism at given inputs, or over their ranges.

At one choice of the inputs, the groups are placed one after another in solving order. A
dyad has two modes, in closed form; an irreducible group has all modes that elimination or a
search finds. Each mode of a group is combined with all modes of the groups after it.
"""

from collections.abc import Iterator
from itertools import chain, islice, repeat
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices, SmallIntegers
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import Group
from spherekit.positions.elimination_order import has_elimination
from spherekit.positions.gear_phases import GearPhases
from spherekit.positions.group_assembly import (
    AssemblyState,
    group_closure,
    group_tree,
    group_variables,
    place_dyad,
)
from spherekit.positions.group_conditioning import group_reciprocal_condition
from spherekit.positions.group_solutions import (
    CLOSED_FORM,
    RANDOM_SEARCH,
    SolutionMethod,
    all_complete,
    find_group_configurations,
    least_complete,
)
from spherekit.positions.input_paths import determinant_sign
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.linear_equations import condition_numbers
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.pair_states import has_penetration
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import (
    POLISHING_STEPS,
    SEED,
    STARTS_PER_ROUND,
    DistinctConfigurations,
    descend_to_closure,
    search_group,
    starting_range,
)
from spherekit.tolerances import CLOSURE_TOLERANCE

SIGN_RECIPROCAL_CONDITION = 1e-8
"""A group with a smaller reciprocal condition number has no sign.

Larger: more configurations near dead centres have no sign. Smaller: signs can be rounding.
"""
MAX_ASSEMBLY_MODES = 64
"""Largest number of assembly modes in a run. A mechanism of n dyads has up to 2^n."""
MAX_CONFIGURATIONS = 4096
"""Largest number of configurations at one choice of the inputs. Larger: more memory."""
RANGE_ROUNDS = 4
"""Least number of rounds of random starts over a range of inputs."""
START_RECIPROCAL_CONDITION = 1e-5
"""A search over a range leaves out configurations with a smaller reciprocal condition.

Two modes near a dead centre are not distinguished. Larger: more modes are missed. Smaller:
one mode may be found as two.
"""


class ConfigurationsAtInput(NamedTuple):
    """The k closed configurations of a mechanism that were found at one choice of inputs.

    The mechanism is placed group by group. A group is a set of links that are placed
    together. A dyad is a group of two links, which closes in two ways. The sign of a dyad
    says in which way it is closed.

    Attributes
    ----------
    signs
        For each configuration the sign of each group: +1 or -1 for dyads, 0 for others.
    values
        (k, variables) pair variables (rad).
    methods
        For each group the method that found its modes (ways to close it): closed form,
        elimination, or a search that can miss some. If several methods were used for a
        group, the least complete one is stored. None for a group that was never solved,
        because the groups before it do not close.
    is_truncated
        Whether there are more configurations than `MAX_CONFIGURATIONS`.
    """

    signs: tuple[tuple[int, ...], ...]
    values: Floats
    methods: tuple[SolutionMethod | None, ...]
    is_truncated: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether no real configuration of the mechanism at these inputs can be missing."""
        return all_complete(self.methods) and not self.is_truncated


def can_find_all_modes(solver: PositionSolver) -> bool:
    """Return whether all assembly modes of a mechanism can be found.

    An assembly mode is one way to assemble the links. The links are placed in groups. Dyads
    (two links joined by a pair) and trains of wheels have closed forms. Some other groups
    can be solved by elimination. For the rest only a random search is left, which may miss
    modes.
    """
    return all(
        group.is_dyad or position in solver.wheel_trains or has_elimination(group)
        for position, group in enumerate(solver.assembly.groups)
    )


class ModePlacement(NamedTuple):
    """The placed bodies of a mechanism in one assembly mode (one way to assemble it).

    Attributes
    ----------
    signs
        The sign of each group of links that is placed together. A dyad (two links joined by
        a pair) has +1 or -1 in its two modes. Other groups have 0.
    state
        The placed bodies and the pair variables, at all inputs.
    """

    signs: tuple[int, ...]
    state: AssemblyState


class ModeEnumeration(NamedTuple):
    """The assembly modes in which a mechanism was placed, and how they were found.

    The links are placed in groups, one after another.

    Attributes
    ----------
    placements
        The mechanism in each mode.
    methods
        For each group the method that found the ways to close it: closed form, elimination
        or random search. None for a group that was never solved: no way was found to close
        all groups before it.
    """

    placements: list[ModePlacement]
    methods: list[SolutionMethod | None]


def enumerate_assemblies(solver: PositionSolver, q: Floats) -> ConfigurationsAtInput:
    """Return all closed configurations that are found at inputs q (inputs,) in rad.

    Usually the mechanism is placed group by group (sets of links that are placed together).
    Some mechanisms have wheels that a search of a single group cannot place, because a
    wheel looks the same after each revolution. If the inputs determine how far all wheels
    have rolled, the search prescribes these rolled lengths. It then finds the configuration
    of the whole mechanism at once.
    """
    # The rolled lengths of the wheels as functions of the inputs. None if the mechanism is
    # placed group by group.
    gear_phases = _find_phases_of_common_search(solver)
    if gear_phases is None:
        return _combine_group_modes(solver, q)
    values = _search_in_gear_phase(solver, gear_phases, q)
    # The signs tell apart the two ways to close a group of two links.
    return ConfigurationsAtInput(
        signs=tuple(signs_at(solver, row) for row in values),
        values=values,
        methods=(RANDOM_SEARCH,) * len(solver.assembly.groups),
    )


def _find_phases_of_common_search(solver: PositionSolver) -> GearPhases | None:
    """Return how far wheels have rolled, if all groups have to be searched together.

    Usually a mechanism is placed group by group (sets of links that are placed together). A
    group with contacts needs a search, except a train of wheels, which gear ratios place. A
    wheel looks the same after each revolution, so a search of a single group cannot tell
    how far the wheel has rolled.

    The rolled length of a contact is the arc length by which its two wheels have rolled on
    each other. If the inputs determine the rolled lengths of all contacts, the caller
    prescribes them in a search of the whole mechanism.

    Returns
    -------
    The rolled lengths as functions of the inputs. None if the mechanism is placed group by
    group.
    """
    # A group that is not `revolute` has contacts.
    has_general_contacts = any(
        not group.revolute and position not in solver.wheel_trains
        for position, group in enumerate(solver.assembly.groups)
    )
    gear_phases = solver.gear_phases
    if has_general_contacts and gear_phases is not None and gear_phases.all_known:
        return gear_phases
    return None


def _combine_group_modes(solver: PositionSolver, q: Floats) -> ConfigurationsAtInput:
    """Return the configurations at inputs q (inputs,), placing group after group of links.

    A group can close in several ways, its modes. Each mode of a group is combined with all
    modes of the groups after it. At most `MAX_CONFIGURATIONS` configurations are returned.
    """
    # `placements` are the modes of the whole mechanism. `methods` has for each group the
    # method that found its modes. One mode more than the limit is requested, to see whether
    # there are more modes than the limit.
    placements, methods = enumerate_modes(solver, q[None], MAX_CONFIGURATIONS + 1)
    is_truncated = len(placements) > MAX_CONFIGURATIONS
    placements = placements[:MAX_CONFIGURATIONS]
    if is_truncated:
        description = (
            f"the first {MAX_CONFIGURATIONS} configurations are kept, and there are more"
        )
        # A doubt of 1 says that modes may have been left out. The largest doubt of all
        # groups counts. So it is enough to give one group this doubt, here the last one.
        methods[-1] = SolutionMethod(description, doubt=1.0)
    variable_count = len(solver.mechanism.variable_owners)
    values = [placement.state.values[0] for placement in placements]
    return ConfigurationsAtInput(
        signs=tuple(placement.signs for placement in placements),
        values=np.reshape(values, (-1, variable_count)),
        methods=tuple(methods),
        is_truncated=is_truncated,
    )


def _search_in_gear_phase(
    solver: PositionSolver, gear_phases: GearPhases, q: Floats
) -> Floats:
    """Search the configurations of a whole mechanism with wheels, from random starts.

    All links are placed together, not group by group. The inputs and the rolled lengths
    (lengths by which wheels have rolled on each other) are locked. A wheel looks the same
    after each revolution, so only the rolled lengths tell the revolutions.

    Parameters
    ----------
    solver
        The mechanism.
    gear_phases
        The rolled lengths, as linear functions of the inputs.
    q
        (inputs,) values of the inputs (rad).

    Returns
    -------
    (n, variables) closed configurations (rad) in which wheels have rolled as far as the
    inputs require.
    """
    # The same configurations return when an input grows by its period. The search is
    # therefore done at inputs that are whole periods away from q, and as near as possible
    # to the anchor. The anchor is the inputs of the reference pose, or zero. Far from it
    # the rolled lengths are large.
    near_anchor = q - whole_laps(q - gear_phases.anchor_inputs, gear_phases.periods)
    rolled_lengths = gear_phases.rolled_lengths(near_anchor[None])
    locked_values = np.append(near_anchor, rolled_lengths)[None]
    locked_variables = [*solver.driven, *gear_phases.variables]
    closure = solver.closure.locked(locked_variables, locked_values)
    distinct = DistinctConfigurations(closure)
    search_group(closure, distinct)  # adds what it finds to `distinct`
    variable_count = len(solver.closure.tree.pair_of_variable)
    values = np.reshape(distinct.values, (-1, variable_count))
    # Shift the configurations back to q, together with the rolled lengths.
    return solver.shift_inputs(values, q[None])


def enumerate_modes(solver: PositionSolver, q: Floats, max_modes: int) -> ModeEnumeration:
    """Return the assembly modes of a mechanism at n given values of the inputs.

    The links are placed in groups, one after another. A group can close in several ways,
    its modes. Each mode of a group is combined with all modes of the groups after it. A
    mode is returned if all its groups close together at one or more of the n values. At the
    other values `state.is_open` is true in the placement of the mode.

    Parameters
    ----------
    solver
        The mechanism.
    q
        (n, inputs) values of the inputs (rad). Dyads (two links and three R pairs) and
        trains of wheels have closed forms for all n inputs at once. With other groups n has
        to be 1.
    max_modes
        Largest number of modes that are returned.

    Returns
    -------
    The placed bodies in each mode, and for each group the method that found its modes. The
    methods tell whether modes may be missing.
    """
    group_count = len(solver.assembly.groups)
    methods: list[SolutionMethod | None] = [None] * group_count

    def place_next_groups(placement: ModePlacement) -> Iterator[ModePlacement]:
        """Yield all modes of the mechanism in which its first groups are already placed.

        `placement` has the first groups of links, each in one of its modes (ways to close
        the group). The next group is placed at the inputs `q` in each of its modes. The
        groups after it follow recursively. `methods` stores for each group how its modes
        were found: closed form, elimination or search.
        """
        position = len(placement.signs)
        if position == group_count:
            yield placement
            return
        states_by_mode, method = _place_group_modes(solver, placement.state, position, q)
        # The same group is solved again for each combination of modes of the groups before,
        # maybe with other methods. The one most likely to miss modes is stored.
        methods[position] = least_complete(methods[position], method)
        # The sign tells apart the two modes of a dyad. Other groups have the sign 0.
        for sign, next_state in states_by_mode:
            yield from place_next_groups(
                ModePlacement((*placement.signs, sign), next_state)
            )

    # Samples at which a dyad does not close must not give warnings of NumPy.
    with np.errstate(invalid="ignore", divide="ignore"):
        modes = place_next_groups(ModePlacement(signs=(), state=solver.start(q)))
        return ModeEnumeration(list(islice(modes, max_modes)), methods)


def _place_group_modes(
    solver: PositionSolver, state: AssemblyState, position: int, q: Floats
) -> tuple[list[tuple[int, AssemblyState]], SolutionMethod]:
    """Place a group of links in each of its modes (ways to close it).

    Parameters
    ----------
    solver
        Solver of the positions of the mechanism.
    state
        The bodies placed so far, which are not changed.
    position
        Position of the group in the order of placing.
    q
        (n, inputs) values of the inputs (rad). Dyads (groups of two links) and trains of
        wheels can be placed at many values at once. For any other group, n is 1.

    Returns
    -------
    states_by_mode
        For each mode that closes for at least one row of `q`: the sign of the group, which
        is 0 unless it is a dyad, and the new state.
    method
        How the modes were found.
    """
    group = solver.assembly.groups[position]
    if group.is_dyad:
        return _place_dyad_modes(state, group), CLOSED_FORM
    if position in solver.wheel_trains:
        return _place_train_mode(solver, state, position, q), CLOSED_FORM
    return _place_computed_modes(solver, state, group)


def _place_dyad_modes(
    state: AssemblyState, group: Group
) -> list[tuple[int, AssemblyState]]:
    """Place a dyad with both signs, as far as it closes, on the bodies placed so far."""
    states_by_mode = []
    for sign in (1, -1):
        next_state = state.copy()
        place_dyad(next_state, group, sign)
        if not np.all(next_state.is_open):
            states_by_mode.append((sign, next_state))
    return states_by_mode


def _place_train_mode(
    solver: PositionSolver, state: AssemblyState, position: int, q: Floats
) -> list[tuple[int, AssemblyState]]:
    """Place a train of wheels, if its loops can be closed for at least one row of `q`.

    The gear ratios determine all its angles, so there is only one way to place it (mode).
    The result is still a list of modes, as for the other groups of links.

    Parameters
    ----------
    solver
        The mechanism.
    state
        The bodies placed so far, which are not changed.
    position
        Position of the train among the groups, in the order of placing.
    q
        (n, inputs) values of the inputs (rad).

    Returns
    -------
    A list with one item, or an empty list if the train closes nowhere. The item has the
    sign 0, because only dyads have signs, and the state with the train placed.
    """
    next_state = state.copy()
    closure = solver.place_wheel_train(next_state, position, q)
    # `is_open` marks the rows of `q` at which some group does not close.
    next_state.is_open |= ~(closure.closure_residual < CLOSURE_TOLERANCE)
    return [] if np.all(next_state.is_open) else [(0, next_state)]


def _place_computed_modes(
    solver: PositionSolver, state: AssemblyState, group: Group
) -> tuple[list[tuple[int, AssemblyState]], SolutionMethod]:
    """Place a group of links without a closed form, at a single value of the inputs.

    All its modes (ways to close it) follow from elimination of the unknowns down to one
    polynomial equation. If this is not possible, they are searched from the reference pose
    and random starts.

    Parameters
    ----------
    solver
        Solver of the positions of the mechanism.
    state
        The bodies placed so far, which are not changed.
    group
        The group.

    Returns
    -------
    states_by_mode
        For each mode the sign 0 (the mark of groups without a sign) and the new state.
    method
        How the modes were found.
    """
    variables = group_variables(state, group)
    start_values = None
    if solver.reference is not None:
        start_values = solver.reference[None, variables]
    group_loops = group_closure(state, group)
    configurations, method = find_group_configurations(group, group_loops, start_values)
    states_by_mode: list[tuple[int, AssemblyState]] = []
    if configurations:
        # Close the loops exactly by Newton's method. The result also has the rotations of
        # the bodies.
        closed = group_loops.solve(np.array(configurations))
        for row, values in enumerate(closed.values):
            next_state = state.copy()
            next_state.merge(group, closed.rotations[row : row + 1])
            next_state.values[:, variables] = values
            states_by_mode.append((0, next_state))
    return states_by_mode, method


def signs_at(solver: PositionSolver, values: Floats) -> tuple[int, ...]:
    """Return the sign of each group in a configuration with closed loops.

    `values` (variables,) are the pair variables. A dyad (two links joined by a pair) can be
    assembled in two ways, which its sign 1 or -1 tells apart. Other groups have the sign 0.
    """
    determinant_signs = group_signs(solver, values[None], 0.0)[0]
    signs = []
    for group, sign in zip(solver.assembly.groups, determinant_signs, strict=True):
        if group.is_dyad:
            signs.append(1 if sign >= 0 else -1)
        else:
            signs.append(0)
    return tuple(signs)


def group_matrices(
    solver: PositionSolver, linearisation: Linearisation, position: int
) -> Floats:
    """Return the matrices of a group that are singular where two of its modes meet.

    A group is a set of links that are placed together, and its modes are the ways to place
    them. Between meetings of modes, the determinant of the matrix keeps its sign.
    `group_signs` distinguishes modes by this sign.

    Parameters
    ----------
    solver
        The mechanism.
    linearisation
        Its closure at n configurations.
    position
        Position of the group in the order of placing.

    Returns
    -------
    For a dyad (two links), (n, 3, 3) axes of its three R pairs in rows. For other groups
    (n, equations, variables) matrices of the velocity equations, with three equations for
    each loop. The matrices are square unless constraints are redundant.
    """
    group = solver.assembly.groups[position]
    if group.is_dyad:
        return linearisation.axes[:, list(group.pairs)]
    return _group_velocity_matrices(solver, linearisation, group)


def _group_velocity_matrices(
    solver: PositionSolver, linearisation: Linearisation, group: Group
) -> Floats:
    """Return the matrices of the velocity equations of a group at n configurations.

    A group is a set of links that are placed together. The relative angular velocities in
    the pairs around each loop add up to zero, which gives 3 equations per loop. The
    unknowns are the rates of the pair variables of the group.

    The matrices have the shape (n, 3 * loops, variables). They are square unless
    constraints are redundant. There are several ways to place the group. The caller
    distinguishes these ways by the sign of the determinant.
    """
    variables: list[int] = []
    for pair in group.pairs:
        variables += solver.mechanism.variables_of(pair)
    # For each variable the angular velocity in its pair per unit rate.
    unit_velocities = linearisation.vectors[:, variables]
    return group_tree(group, solver.joints).jacobian(unit_velocities)


def group_signs(
    solver: PositionSolver, values: Floats, least: float = SIGN_RECIPROCAL_CONDITION
) -> SmallIntegers:
    """Return the signs that distinguish the modes of each group of links.

    A group is placed as a whole, and its modes are the ways to place it. Its sign is that
    of the determinant of a matrix. For a dyad (two links) the matrix has the three pair
    axes in its rows. For any other group it is the matrix of the velocity equations. A sign
    can change only where two modes meet.

    Parameters
    ----------
    solver
        The mechanism.
    values
        (n, variables) closed configurations (rad).
    least
        Least reciprocal condition number of a matrix with a reliable sign. With 0, all
        signs count as reliable, and a matrix that is not square has the sign 1.

    Returns
    -------
    (n, groups) signs, 0 if the sign is not reliable.
    """
    linearisation = solver.closure.linearise(values)
    signs = np.zeros((len(values), len(solver.assembly.groups)), dtype=np.int8)
    for position in range(signs.shape[1]):
        matrices = group_matrices(solver, linearisation, position)
        _, rows, columns = matrices.shape
        group_sign = np.nan_to_num(determinant_sign(matrices))
        if least == 0.0:
            signs[:, position] = group_sign
        elif rows != columns:
            # Redundant constraints give a matrix without a determinant, so without a sign.
            signs[:, position] = 0
        else:
            # Near a singular matrix, rounding decides the sign.
            is_reliable = condition_numbers(matrices) < 1.0 / least
            signs[:, position] = group_sign * is_reliable
    return signs


def random_starts(
    solver: PositionSolver,
    low: Floats,
    high: Floats,
    samples: Floats | None = None,
    seed: int = SEED,
) -> Iterator[tuple[int, Floats, Indices]]:
    """Yield configurations with closed loops, found from random starts over an input range.

    Starts are drawn in rounds of a fixed number. The first `RANGE_ROUNDS` rounds are
    yielded together, then one round after another. The numbers are the same in every run.
    Left out are configurations near a dead centre (where an input turns back), and those
    with a contact that does not exist.

    Parameters
    ----------
    solver
        The mechanism.
    low, high
        (inputs,) ranges of the inputs (rad).
    samples
        (n, inputs) inputs (rad) at which the loops have to close. If None, the inputs are
        drawn from the range. Without wheels they change until the loops close.
    seed
        Seed of the random numbers.

    Yields
    ------
    starts
        Number of starts of the round, including starts that led to no configuration.
    values
        (k, variables) closed configurations (rad), passive angles in (-pi, pi].
    rows
        (k,) sample of each configuration, 0 if there are no samples.
    """
    random = np.random.default_rng(seed)
    closure = solver.closure
    gear_phases = solver.gear_phases
    driven = list(solver.driven)
    # Limits (variables,) between which starts are drawn.
    start_low, start_high = starting_range(closure)
    start_low[driven] = low
    start_high[driven] = high
    # If there are wheels, the lengths that they have rolled (`rolled`) are computed from
    # the inputs, if they follow from them. Inputs and these lengths then stay fixed while
    # the loops are closed.
    rolled = [] if gear_phases is None else list(gear_phases.variables)
    keeps_inputs = gear_phases is not None or samples is not None
    fixed = driven + rolled if keeps_inputs else []
    # Inputs that are not fixed stay within their ranges; other variables have no limits.
    is_input = np.isin(np.arange(len(start_low)), driven)
    lower_limits = np.where(is_input, start_low, -np.inf)
    upper_limits = np.where(is_input, start_high, np.inf)
    passive_angles = [v for v in solver.angles if v not in driven]
    for rounds in chain([RANGE_ROUNDS], repeat(1)):
        starts = random.uniform(
            start_low, start_high, (rounds * STARTS_PER_ROUND, len(start_low))
        )
        rows = np.zeros(len(starts), dtype=np.intp)
        if samples is not None:
            rows = random.integers(0, len(samples), len(starts))
            starts[:, driven] = samples[rows]
        with np.errstate(all="ignore"):  # Starts that fail can become infinite.
            if gear_phases is not None:
                starts[:, rolled] = gear_phases.rolled_lengths(starts[:, driven])
            # Close the loops first roughly, within the ranges of the inputs; then exactly,
            # with constant inputs.
            values, is_near_closed = descend_to_closure(
                closure, starts, fixed, lower_limits, upper_limits
            )
            linearisation = closure.solve(
                values[is_near_closed], driven + rolled, max_steps=POLISHING_STEPS
            )
            reciprocal_condition = group_reciprocal_condition(
                linearisation.jacobian[:, :, ~is_input]
            )
            is_good = (linearisation.closure_residual < CLOSURE_TOLERANCE) & np.all(
                linearisation.states.inside, axis=1
            )
            is_good &= reciprocal_condition > START_RECIPROCAL_CONDITION
            is_good &= ~has_penetration(closure.joints, linearisation.states)
        linearisation.values[:, passive_angles] = wrap(
            linearisation.values[:, passive_angles]
        )
        yield len(starts), linearisation.values[is_good], rows[is_near_closed][is_good]
