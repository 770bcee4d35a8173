"""Finding the assembly modes of a mechanism over the ranges of its inputs.

With one input they are looked for between all inputs at which modes meet, where those
are known, else at several and by a search over the range. All modes of dyads are
enumerated, those of irreducible groups gathered (`gathering`).
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE, counted
from spherekit.errors import SolveError
from spherekit.guarantee import Claim, Guarantee
from spherekit.model.parts import PoseGeometry
from spherekit.motion.assemblies import MOST_ASSEMBLY_MODES, signs_at
from spherekit.motion.assembly_modes import AssemblyMode, Solver
from spherekit.motion.gathering import MOST_COST, MOST_TIME, Gathering, other_rank
from spherekit.motion.groups import State, place_dyad
from spherekit.motion.input_grid import InputGrid
from spherekit.motion.input_turning_points import input_turning_points
from spherekit.motion.solutions import CLOSED_FORM, ONE_WAY, Method
from spherekit.sphere.rotation import Floats

PROBED_INPUTS = 721
"""Inputs over the range at which the modes of dyads are looked for."""
RANKED = 5
"""Configurations at which the mobility by rank is asked for: some may be singular."""

REFERENCE_ONLY = Claim(Guarantee.COMPONENT, "the mode of the reference pose")


@final
@dataclass(frozen=True)
class FoundModes:
    """The assembly modes of a mechanism, and how they were found.

    `probes` is the number of inputs at which modes were looked for, 0 if a reference
    pose was enough; `methods[g]` the least complete way in which those of group g were
    found at any of them, None if at none. `claim` says what holds of their number.
    """

    assembly_modes: tuple[AssemblyMode, ...]
    probes: int
    methods: tuple[Method | None, ...]
    claim: Claim


def find_assembly_modes(
    solver: Solver, input_grid: InputGrid, search: bool = True
) -> FoundModes:
    """Return the assembly modes that have at least one configuration at the inputs given.

    The mode of a given reference pose comes first. For one input the range between the
    first and the last sample is what counts; for several the samples of the input grid.

    Raises
    ------
    SolveError
        If the arcs close nowhere.
    PlanError
        If the rank of a mechanism with redundant constraints leaves another number of
        freedoms than there are inputs.
    """
    if solver.has_closed_form:
        found_modes = _closed_assembly_modes(solver, input_grid, search)
    else:
        found_modes = _guided_assembly_modes(solver, input_grid, search)
    if not found_modes.assembly_modes:
        raise SolveError(_why_nothing_closes(solver, input_grid))
    return found_modes


def _closed_assembly_modes(
    solver: Solver, input_grid: InputGrid, search: bool
) -> FoundModes:
    ends = solver.mechanism.ends
    groups = solver.assembly.groups
    closing: list[tuple[int, ...]] = []

    def extend(state: State, q: Floats, signs: tuple[int, ...]) -> None:
        if len(closing) >= MOST_ASSEMBLY_MODES or np.all(state.lost):
            return
        number = len(signs)
        if number == len(groups):
            closing.append(signs)
            _check_rank(solver, state)
            return
        if number in solver.trains:
            grown = state.copy()
            result, _ = solver.place(grown, number, q)
            grown.lost |= ~(result.residual < CLOSURE_TOLERANCE)
            extend(grown, q, (*signs, 0))
            return
        for sign in (1, -1):
            grown = state.copy()
            place_dyad(grown, groups[number], ends, sign)
            extend(grown, q, (*signs, sign))

    reference = solver.geometry.reference
    of_reference: tuple[int, ...] | None = None
    if reference is not None:
        of_reference = signs_at(solver, reference)
    probes, methods = 0, tuple[Method | None, ...]([None] * len(groups))
    claim = REFERENCE_ONLY
    if search or of_reference is None:
        probed, claim = _probed(solver, input_grid)
        probes = len(probed)
        methods = tuple(
            ONE_WAY if number in solver.trains else CLOSED_FORM
            for number in range(len(groups))
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            extend(solver.start(probed), probed, ())
    if of_reference is not None:
        closing = [of_reference, *(signs for signs in closing if signs != of_reference)][
            :MOST_ASSEMBLY_MODES
        ]
    assembly_modes = tuple(
        AssemblyMode(number, signs) for number, signs in enumerate(closing)
    )
    return FoundModes(assembly_modes, probes, methods, _limited(claim, len(assembly_modes)))


def _check_rank(solver: Solver, state: State) -> None:
    """Refuse redundant constraints that leave another mobility than there are inputs.

    The rank is the greatest of the configurations of a state that close.
    """
    if not any(group.redundant for group in solver.assembly.groups):
        return
    closed = state.values[~state.lost]
    rows = np.linspace(0, len(closed) - 1, min(len(closed), RANKED)).astype(np.intp)
    freedoms = min(solver.freedoms(values) for values in closed[rows])
    if freedoms != len(solver.driven):
        raise other_rank(solver, freedoms)


def _probed(solver: Solver, input_grid: InputGrid) -> tuple[Floats, Claim]:
    """Return the inputs (k, inputs) at which the modes of dyads are looked for."""
    if not solver.assembly.groups:
        return input_grid.q[:1], Claim(Guarantee.COMPLETE, "no loop has to close")
    if len(solver.trains) == len(solver.assembly.groups):
        return input_grid.q[:1], Claim(Guarantee.COMPLETE, "wheels in mesh have one")
    if input_grid.q.shape[1] > 1:
        q = input_grid.thinned(PROBED_INPUTS).q
        return q, Claim(Guarantee.SAMPLED, f"modes at {len(q)} of the samples")
    low, high = input_grid.range
    dead = input_turning_points(solver, low, high, MOST_COST, MOST_TIME)
    step = (high - low) / (PROBED_INPUTS - 1)
    return dead.probes(step)[:, None], dead.claim(step)


def _limited(claim: Claim, count: int) -> Claim:
    """Return what is claimed of so many assembly modes."""
    if count < MOST_ASSEMBLY_MODES:
        return claim
    return Claim(
        Guarantee.SAMPLED, f"stopped at {MOST_ASSEMBLY_MODES} modes; there may be more"
    )


def _guided_assembly_modes(
    solver: Solver, input_grid: InputGrid, search: bool
) -> FoundModes:
    gathering = Gathering(solver, input_grid)
    gathering.add_reference()
    claim = REFERENCE_ONLY
    if search or not gathering.assembly_modes:
        claim = gathering.all_modes()
    assembly_modes, freedoms = gathering.assembly_modes, gathering.freedoms
    if freedoms and not assembly_modes and min(freedoms) != len(solver.driven):
        raise other_rank(solver, min(freedoms))
    claim = _limited(claim, len(assembly_modes))
    if gathering.is_spent:
        steps = gathering.nodes + gathering.in_vain
        modes = counted(len(assembly_modes), "mode")
        words = f"stopped after {steps} steps along {modes}"
        claim = Claim(Guarantee.SAMPLED, f"{words}; there may be more")
    return FoundModes(
        tuple(assembly_modes), gathering.probes, tuple(gathering.methods), claim
    )


def _why_nothing_closes(solver: Solver, input_grid: InputGrid) -> str:
    name = solver.mechanism.name
    inputs = [solver.mechanism.pairs[pair].name for pair in solver.assembly.inputs]
    lows, highs = np.degrees([np.min(input_grid.q, axis=0), np.max(input_grid.q, axis=0)])
    degrees = ", ".join(
        f"{pair} in [{low:.6g}, {high:.6g}] deg"
        for pair, low, high in zip(inputs, lows, highs, strict=True)
    )
    state = solver.start(input_grid.thinned(PROBED_INPUTS).q)
    with np.errstate(invalid="ignore", divide="ignore"):
        for group in solver.assembly.groups:
            pairs = ", ".join(solver.mechanism.pairs[p].name for p in group.pairs)
            if not group.is_dyad:
                break
            place_dyad(state, group, solver.mechanism.ends, 1)
            if np.all(state.lost):
                return (
                    f"{name}: arcs cannot close: the {group.kind} of pairs {pairs} "
                    f"reaches nowhere for inputs {degrees}; change the arcs of its "
                    "links or the range"
                )
    posed = isinstance(solver.mechanism.geometry, PoseGeometry)
    cure = "the axes of its pose" if posed else "its arcs"
    return (
        f"{name}: no configuration was found for inputs {degrees}: the {group.kind} "
        f"of pairs {pairs} did not close from any start, or only with profiles that enter "
        f"each other; change {cure}, profiles or the range"
        f"{'' if posed else ', or give a reference pose'}"
    )
