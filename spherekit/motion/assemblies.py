"""The closed configurations of a mechanism: all at its inputs, or some over their ranges.

All at one choice of the inputs are found group after group in the order of planning: both
modes of a dyad, and of an irreducible group all that elimination or a search finds.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.assembly_modes import Solver, determinant_signs
from spherekit.motion.groups import (
    State,
    group_closure,
    group_variables,
    place_dyad,
)
from spherekit.motion.loops import LoopTree, condition
from spherekit.motion.pairs import penetrates
from spherekit.motion.search import POLISHING_STEPS, SEED, STARTS, damped, starting_range
from spherekit.motion.solutions import (
    CLOSED_FORM,
    ONE_WAY,
    Method,
    least_complete,
    solutions,
)
from spherekit.numeric.turns import wrap
from spherekit.sphere.rotation import Floats

MOST_ASSEMBLY_MODES = 64
"""Assembly modes of one run; a mechanism of many dyads has 2 to their number."""
FLAT_SIGN = 1e-8
"""Groups of a smaller reciprocal condition have no sign."""
RANGE_ROUNDS = 4
"""Rounds of a search over a range at least."""
FLAT = 1e-5
"""Configurations nearer to a dead centre (relative singular value) are not told apart."""


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
    methods: list[Method | None] = [None] * len(solver.assembly.groups)
    searched = any(
        not group.revolute and number not in solver.trains
        for number, group in enumerate(solver.assembly.groups)
    )
    if searched and solver.meshes is not None and solver.meshes.all_known:
        there = solver.meshes.modes(solver.closure, solver.driven, q)
        modes = tuple((signs_at(solver, values), values) for values in there)
        return Assemblies(modes, (Method(0),) * len(methods))
    every = chains(solver, q[None], 4 * MOST_ASSEMBLY_MODES, methods)
    modes = tuple((signs, state.values[0].copy()) for signs, state in every)
    return Assemblies(modes, tuple(methods))


def chains(
    solver: Solver, q: Floats, most: int, methods: list[Method | None] | None = None
) -> list[tuple[tuple[int, ...], State]]:
    """Return dyad signs and states of the modes that close at any of inputs q (n, inputs).

    At most so many. The `methods` of groups are noted; those other than dyads and trains of
    wheels are placed at a single input.
    """

    def extend(
        state: State, signs: tuple[int, ...]
    ) -> Iterator[tuple[tuple[int, ...], State]]:
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
    solver: Solver, state: State, number: int, q: Floats
) -> tuple[list[tuple[int, State]], Method]:
    """Return the states in which a group is placed, with dyad signs, and the method.

    It is the group of that number; q (n, inputs) are the inputs.
    """
    ends, group = solver.mechanism.ends, solver.assembly.groups[number]
    if group.is_dyad or number in solver.trains:
        signs = (1, -1) if group.is_dyad else (0,)
        placed = [(sign, state.copy()) for sign in signs]
        for sign, further in placed:
            if sign:
                place_dyad(further, group, ends, sign)
            else:
                residual = solver.place(further, number, q).residual
                further.lost |= ~(residual < CLOSURE_TOLERANCE)
        closed = [(sign, further) for sign, further in placed if not np.all(further.lost)]
        return closed, CLOSED_FORM if group.is_dyad else ONE_WAY
    reference = solver.geometry.reference
    variables = group_variables(state, group)
    given = None if reference is None else reference[None, variables]
    closure = group_closure(state, group, ends)
    configurations, method = solutions(group, closure, given)
    grown = []
    if configurations:
        result = closure.solve(np.array(configurations))
        for row, values in enumerate(result.values):
            further = state.copy()
            further.merge(group, result.at.placed[row : row + 1])
            further.values[:, variables] = values
            grown.append((0, further))
    return grown, method


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


@final
class RangeSearch:
    """Rounds of random starts over a range of the inputs, the same ones every time.

    `low`, `high` (inputs,) rad; `samples` (n, inputs) are the inputs to start at if they
    are to be kept.
    """

    def __init__(
        self,
        solver: Solver,
        low: Floats,
        high: Floats,
        samples: Floats | None = None,
        seed: int = SEED,
    ) -> None:
        self.solver, self.samples = solver, samples
        self._random = np.random.default_rng(seed)
        self._low, self._high = starting_range(solver.closure)
        driven = list(solver.driven)
        self._low[driven], self._high[driven] = low, high
        self._least, self._most = (np.full(len(self._low), x) for x in (-np.inf, np.inf))
        self._least[driven], self._most[driven] = low, high

    def _drawn(self) -> tuple[Floats, NDArray[np.intp]]:
        """Return the starts (n, variables) of a round, and the sample (n,) of each."""
        starts = self._random.uniform(self._low, self._high, (STARTS, len(self._low)))
        if self.samples is None:
            return starts, np.zeros(STARTS, dtype=np.intp)
        rows = self._random.integers(0, len(self.samples), STARTS)
        starts[:, list(self.solver.driven)] = self.samples[rows]
        return starts, rows

    def rounds(self, count: int = 1) -> tuple[Floats, NDArray[np.intp]]:
        """Return closed configurations (k, variables) that so many rounds lead to.

        With them the sample (k,) of each where the inputs are kept. Those whose contacts
        do not exist, or that lie at a dead centre, are left out.
        """
        solver, driven = self.solver, list(self.solver.driven)
        drawn = [self._drawn() for _ in range(count)]
        starts, rows = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
        closure = solver.closure
        with np.errstate(all="ignore"):
            held = driven
            if solver.meshes is not None:
                held = driven + list(solver.meshes.variables)
                starts[:, held[len(driven) :]] = solver.meshes.rolled(starts[:, driven])
            if self.samples is None and solver.meshes is None:
                values, near = damped(closure, starts, (), self._least, self._most)
            else:
                values, near = damped(closure, starts, held)
            values, rows = values[near], rows[near]
            if not len(values):
                return values, rows
            result = closure.solve(values, held, iterations=POLISHING_STEPS)
            values = result.values
            at = closure.at(values)
            free = [v for v in range(values.shape[1]) if v not in driven]
            _, reciprocal_condition = determinant_signs(at.jacobian[:, :, free])
            good = (result.residual < CLOSURE_TOLERANCE) & (reciprocal_condition > FLAT)
            good &= np.all(at.states.inside, axis=1)
            good &= ~penetrates(closure.joints, at.states)
        turning = [v for v in solver.angles if v not in driven]
        values[:, turning] = wrap(values[:, turning])
        return values[good], rows[good]
