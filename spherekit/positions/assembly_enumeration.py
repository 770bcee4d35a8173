"""The closed configurations of a mechanism at given inputs, or over their ranges.

All at one choice of the inputs are found group after group in the order of planning: both
modes of a dyad, and of an irreducible group all that elimination or a search finds.
"""

from collections.abc import Iterator
from itertools import chain, islice, repeat
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices, SmallIntegers
from spherekit.numerics.angles import wrap
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
    SEARCH,
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
    STARTS,
    Distinct,
    damped,
    search,
    starting_range,
)
from spherekit.tolerances import CLOSURE_TOLERANCE

FLAT_SIGN = 1e-8
"""Groups of a smaller reciprocal condition have no sign."""


MOST_ASSEMBLY_MODES = 64
"""Assembly modes of one run; a mechanism of many dyads has 2 to their number."""


MOST_CONFIGURATIONS = 4096
"""Configurations of a mechanism at one choice of its inputs."""


RANGE_ROUNDS = 4
"""Rounds of a search over a range at least."""


FLAT = 1e-5
"""Configurations nearer to a dead centre (relative singular value) are not told apart."""


class Assemblies(NamedTuple):
    """The k modes at one choice of the inputs.

    `signs` are those of dyads, `values` (k, variables) rad; `methods[g]` says how the modes
    of group g were found: the least complete way, None if none of the groups before closes.
    `is_truncated` says that there are more than `MOST_CONFIGURATIONS`, of which the first
    are here.
    """

    signs: tuple[tuple[int, ...], ...]
    values: Floats
    methods: tuple[SolutionMethod | None, ...]
    is_truncated: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether no real mode can be missing."""
        return all_complete(self.methods) and not self.is_truncated


def assemblies(solver: PositionSolver, q: Floats) -> Assemblies:
    """Return every mode found at inputs q (inputs,), and how."""
    methods: list[SolutionMethod | None] = [None] * len(solver.assembly.groups)
    searched = any(
        not group.revolute and number not in solver.wheel_trains
        for number, group in enumerate(solver.assembly.groups)
    )
    if searched and solver.gear_phases is not None and solver.gear_phases.all_known:
        there = _modes_in_mesh(solver, solver.gear_phases, q)
        signs = tuple(signs_at(solver, values) for values in there)
        return Assemblies(signs, there, (SEARCH,) * len(methods))
    every = chains(solver, q[None], MOST_CONFIGURATIONS + 1, methods)
    is_truncated = len(every) > MOST_CONFIGURATIONS
    every = every[:MOST_CONFIGURATIONS]
    if is_truncated:
        words = f"the first {MOST_CONFIGURATIONS} configurations are kept, there are more"
        methods[-1] = SolutionMethod(words, 1.0)
    values = np.reshape(
        [state.values[0] for _, state in every], (-1, len(solver.mechanism.variable_owners))
    )
    signs = tuple(signs for signs, _ in every)
    return Assemblies(signs, values, tuple(methods), is_truncated)


def _modes_in_mesh(solver: PositionSolver, meshes: GearPhases, q: Floats) -> Floats:
    """Return the closed configurations (n, variables) found with wheels in mesh."""
    near = q - whole_laps(q - meshes.anchor, meshes.periods)
    held = np.append(near, meshes.rolled_lengths(near[None]))[None]
    locked = solver.closure.locked([*solver.driven, *meshes.variables], held)
    distinct = Distinct(locked)
    search(locked, distinct)
    values = np.reshape(distinct.values, (-1, len(solver.closure.tree.owners)))
    return solver.shift_inputs(values, q[None])


def chains(
    solver: PositionSolver,
    q: Floats,
    most: int,
    methods: list[SolutionMethod | None] | None = None,
) -> list[tuple[tuple[int, ...], AssemblyState]]:
    """Return dyad signs and states of the modes that close at any of inputs q (n, inputs).

    At most so many. The `methods` of groups are noted; those other than dyads and trains of
    wheels are placed at a single input.
    """

    def extend(
        state: AssemblyState, signs: tuple[int, ...]
    ) -> Iterator[tuple[tuple[int, ...], AssemblyState]]:
        number = len(signs)
        if number == len(solver.assembly.groups):
            yield signs, state
            return
        grown, method = _grown(solver, state, number, q)
        if methods is not None:
            methods[number] = least_complete(methods[number], method)
        for sign, further in grown:
            yield from extend(further, (*signs, sign))

    with np.errstate(invalid="ignore", divide="ignore"):
        return list(islice(extend(solver.start(q), ()), most))


def _grown(
    solver: PositionSolver, state: AssemblyState, number: int, q: Floats
) -> tuple[list[tuple[int, AssemblyState]], SolutionMethod]:
    """Return the states in which a group is placed, with dyad signs, and the method.

    It is the group of that number; q (n, inputs) are the inputs.
    """
    group, grown = solver.assembly.groups[number], []
    if group.is_dyad or number in solver.wheel_trains:
        for sign in (1, -1) if group.is_dyad else (0,):
            further = state.copy()
            if sign:
                place_dyad(further, group, sign)
            else:
                further.is_open |= ~(
                    solver.place_wheel_train(further, number, q).gap < CLOSURE_TOLERANCE
                )
            if not np.all(further.is_open):
                grown.append((sign, further))
        return grown, CLOSED_FORM
    reference = solver.reference
    variables = group_variables(state, group)
    given = None if reference is None else reference[None, variables]
    closure = group_closure(state, group)
    configurations, method = find_group_configurations(group, closure, given)
    if configurations:
        at = closure.solve(np.array(configurations))
        for row, values in enumerate(at.values):
            further = state.copy()
            further.merge(group, at.placed[row : row + 1])
            further.values[:, variables] = values
            grown.append((0, further))
    return grown, method


def signs_at(solver: PositionSolver, values: Floats) -> tuple[int, ...]:
    """Return the dyad signs of a closed configuration (variables,), 0 for other groups."""
    signs = zip(
        solver.assembly.groups, group_signs(solver, values[None], 0.0)[0], strict=True
    )
    return tuple((1 if sign >= 0 else -1) if g.is_dyad else 0 for g, sign in signs)


def group_matrices(solver: PositionSolver, at: Linearisation, number: int) -> Floats:
    """Return matrices (n, k, m) of a group, whose determinants tell its modes apart.

    A dyad's axes, the velocity equations of another group.
    """
    group = solver.assembly.groups[number]
    if group.is_dyad:
        return at.axes[:, list(group.pairs)]
    variables = [v for pair in group.pairs for v in solver.mechanism.variables_of(pair)]
    return group_tree(group, solver.joints).jacobian(at.vectors[:, variables])


def group_signs(
    solver: PositionSolver, values: Floats, least: float = FLAT_SIGN
) -> SmallIntegers:
    """Return the signs (n, groups) that tell modes of closed configurations apart.

    Of the triple product of a dyad's axes and of the determinant of another group's
    velocity equations: 0 where their reciprocal condition is below the `least`, and of
    groups that have none, but 1 of these where the `least` is 0.
    """
    at = solver.closure.at(values)
    signs = np.zeros((len(values), len(solver.assembly.groups)), dtype=np.int8)
    for number in range(signs.shape[1]):
        matrices = group_matrices(solver, at, number)
        _, rows, columns = matrices.shape
        signs[:, number] = np.nan_to_num(determinant_sign(matrices))
        if least:
            signs[:, number] *= (rows == columns) & (
                condition_numbers(matrices) < 1.0 / least
            )
    return signs


def random_starts(
    solver: PositionSolver,
    low: Floats,
    high: Floats,
    samples: Floats | None = None,
    seed: int = SEED,
) -> Iterator[tuple[int, Floats, Indices]]:
    """Yield what rounds of random starts over a range lead to, the same ones every time.

    `RANGE_ROUNDS` rounds first, then one after another: how many starts, configurations
    (k, variables) that close, and the sample (k,) of each where the inputs are kept. Those
    whose contacts do not exist, or that lie at a dead centre, are left out.

    Parameters
    ----------
    low, high
        (inputs,) rad, the range.
    samples
        (n, inputs) the inputs to start at if they are to be kept.
    """
    random, closure, meshes = (
        np.random.default_rng(seed),
        solver.closure,
        solver.gear_phases,
    )
    driven = list(solver.driven)
    first, last = starting_range(closure)
    first[driven], last[driven] = low, high
    rolled = [] if meshes is None else list(meshes.variables)
    held = driven + rolled if meshes is not None or samples is not None else []
    is_input = np.isin(np.arange(len(first)), driven)
    least, most = np.where(is_input, first, -np.inf), np.where(is_input, last, np.inf)
    turning = [v for v in solver.angles if v not in driven]
    for count in chain([RANGE_ROUNDS], repeat(1)):
        values = random.uniform(first, last, (count * STARTS, len(first)))
        rows = np.zeros(len(values), dtype=np.intp)
        if samples is not None:
            rows = random.integers(0, len(samples), len(values))
            values[:, driven] = samples[rows]
        with np.errstate(all="ignore"):
            if meshes is not None:
                values[:, rolled] = meshes.rolled_lengths(values[:, driven])
            values, near = damped(closure, values, held, least, most)
            at = closure.solve(values[near], driven + rolled, iterations=POLISHING_STEPS)
            reciprocal_condition = group_reciprocal_condition(at.jacobian[:, :, ~is_input])
            good = (at.gap < CLOSURE_TOLERANCE) & np.all(at.states.inside, axis=1)
            good &= (reciprocal_condition > FLAT) & ~has_penetration(
                closure.joints, at.states
            )
        at.values[:, turning] = wrap(at.values[:, turning])
        yield len(near), at.values[good], rows[near][good]
