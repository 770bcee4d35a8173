"""The assembly modes of a mechanism at one choice of its inputs.

Group after group in the order of planning: both modes of a dyad, and of an irreducible
group all that elimination or a search finds.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.groups import (
    State,
    group_closure,
    group_variables,
    place_dyad,
)
from spherekit.motion.loops import LoopTree, condition
from spherekit.motion.solutions import (
    CLOSED_FORM,
    ONE_WAY,
    Method,
    least_complete,
    solutions,
)
from spherekit.sphere.rotation import Floats

MOST_ASSEMBLY_MODES = 64
"""Assembly modes of one run; a mechanism of many dyads has 2 to their number."""


@final
@dataclass(frozen=True)
class Assemblies:
    """The modes at one choice of the inputs.

    `modes` are dyad signs and variables of each, `methods[g]` says how the modes of
    group g were found: the least complete way, None if none of the groups before closes.
    """

    modes: tuple[tuple[tuple[int, ...], Floats], ...]
    methods: tuple[Method | None, ...]


def assemblies(solver: Solver, q: Floats) -> Assemblies:
    """Return every mode found at inputs q (inputs,), and how."""
    groups = solver.assembly.groups
    closed_modes: list[tuple[tuple[int, ...], Floats]] = []
    methods: list[Method | None] = [None] * len(groups)

    def extend(state: State, signs: tuple[int, ...]) -> None:
        if len(closed_modes) >= 4 * MOST_ASSEMBLY_MODES:
            return
        number = len(signs)
        if number == len(groups):
            closed_modes.append((signs, state.values[0].copy()))
            return
        grown, method = _grown(solver, state, number, q)
        methods[number] = least_complete(methods[number], method)
        for sign, further in grown:
            extend(further, (*signs, sign))

    searched = any(
        not group.revolute and number not in solver.trains
        for number, group in enumerate(groups)
    )
    if searched and solver.meshes is not None and solver.meshes.all_known:
        there = solver.meshes.modes(solver.closure, solver.driven, q)
        modes = tuple((signs_at(solver, values), values) for values in there)
        return Assemblies(modes, (Method(0),) * len(groups))
    with np.errstate(invalid="ignore", divide="ignore"):
        extend(solver.start(q[None]), ())
    return Assemblies(tuple(closed_modes), tuple(methods))


def _grown(
    solver: Solver, state: State, number: int, q: Floats
) -> tuple[list[tuple[int, State]], Method]:
    """Return the states in which a group is placed, with dyad signs, and the method.

    It is the group of that number; q (inputs,) are the inputs.
    """
    ends, group = solver.mechanism.ends, solver.assembly.groups[number]
    grown = []
    if number in solver.trains:
        further = state.copy()
        result, _ = solver.place(further, number, q[None])
        closes = result.residual[0] < CLOSURE_TOLERANCE
        return [(0, further)] if closes else [], ONE_WAY
    if group.is_dyad:
        for sign in (1, -1):
            further = state.copy()
            place_dyad(further, group, ends, sign)
            if not further.lost[0]:
                grown.append((sign, further))
        return grown, CLOSED_FORM
    reference = solver.geometry.reference
    variables = group_variables(state, group)
    given = None if reference is None else reference[None, variables]
    closure = group_closure(state, group, ends)
    configurations, method = solutions(group, closure, given)
    if configurations:
        result = closure.solve(np.array(configurations))
        for row, values in enumerate(result.values):
            further = state.copy()
            further.merge(group, result.at.placed[row : row + 1])
            further.values[:, variables] = values
            grown.append((0, further))
    return grown, method


FLAT_SIGN = 1e-8
"""Groups of a smaller reciprocal condition have no sign."""


def signs_at(solver: Solver, values: Floats) -> tuple[int, ...]:
    """Return the dyad signs of a closed configuration (variables,), 0 for other groups."""
    axes = solver.closure.at(values[None]).axes[0]
    signs = []
    for group in solver.assembly.groups:
        if group.is_dyad:
            triple = float(np.linalg.det(axes[list(group.pairs)]))
            signs.append(1 if triple >= 0.0 else -1)
        else:
            signs.append(0)
    return tuple(signs)


def group_signs(solver: Solver, values: Floats) -> NDArray[np.int8]:
    """Return the signs (n, groups) that tell modes of closed configurations apart.

    Of the triple product of a dyad's axes and of the determinant of another group's
    velocity equations: 0 where they lose their rank, and of groups that have none.
    """
    at = solver.closure.at(values)
    signs = np.zeros((len(values), len(solver.assembly.groups)), dtype=np.int8)
    for number, group in enumerate(solver.assembly.groups):
        owners = solver.mechanism.variable_owners
        variables = [v for v, owner in enumerate(owners) if owner in group.pairs]
        places = tuple(group.pairs.index(owners[v]) for v in variables)
        tree = LoopTree(len(group.bodies), group.ends, places)
        matrices = at.axes[:, list(group.pairs)]
        if not group.is_dyad:
            matrices = tree.jacobian(at.vectors[:, variables])
        if matrices.shape[1] != matrices.shape[2]:
            continue
        clear = condition(matrices) < 1.0 / FLAT_SIGN
        signs[clear, number] = np.sign(np.linalg.det(matrices[clear]))
    return signs
