"""Finding the assembly modes of a mechanism over the ranges of its inputs.

With one input they are looked for between all inputs at which modes meet, where those
are known, else at several. All modes of dyads are enumerated; those of irreducible
groups are all found by elimination or some by a search, and each new one is followed as
far as it goes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import Status
from spherekit.errors import PlanError, SolveError
from spherekit.guarantee import Claim, Guarantee
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.branches import Branch, Solver, determinant_signs
from spherekit.motion.dead_inputs import dead_inputs
from spherekit.motion.distinct import are_far
from spherekit.motion.follow import Curve, follow
from spherekit.motion.groups import (
    State,
    group_closure,
    group_variables,
    place_dyad,
    place_group,
)
from spherekit.motion.lattice import Lattice
from spherekit.motion.pairs import pair_axes
from spherekit.motion.sheet import Sheet, spread
from spherekit.motion.solutions import CLOSED_FORM, Method, least_complete, solutions
from spherekit.motion.steps import walk
from spherekit.motion.stretches import Stretches
from spherekit.planning.assembly import Group
from spherekit.planning.rigidity import graph_mobility, inputs_to_declare
from spherekit.sphere.rotation import Floats

MOST_BRANCHES = 64
"""Branches of one run; a mechanism of many dyads has 2 to their number."""
PROBED_INPUTS = 721
"""Inputs over the range at which the modes of dyads are looked for."""
PROBES = 5
"""Inputs at which modes are looked for where those at which they meet are not known."""
FINER = 3
"""So many times more of them where elimination finds all modes at an input."""
MOST_COST = 3e-3
"""Time (s) that a value of the functions of meeting modes may take here."""
NEAREST = 8
"""Samples nearest to a reference pose that straight ways are tried to."""

REFERENCE_ONLY = Claim(Guarantee.COMPONENT, "the mode of the reference pose")


@final
@dataclass(frozen=True)
class Found:
    """The branches of a mechanism, and how they were found.

    `probes` is the number of inputs at which modes were looked for, 0 if a reference
    pose was enough; `methods[g]` the least complete way in which those of group g were
    found at any of them, None if at none. `claim` says what holds of their number.
    """

    branches: tuple[Branch, ...]
    probes: int
    methods: tuple[Method | None, ...]
    claim: Claim


def find_branches(solver: Solver, lattice: Lattice, search: bool = True) -> Found:
    """Return the branches that have at least one configuration at the inputs given.

    The mode of a given reference pose comes first. For one input the range between the
    first and the last sample is what counts; for several the samples of the lattice.

    Raises
    ------
    SolveError
        If the arcs close nowhere.
    PlanError
        If the rank of a mechanism with redundant constraints leaves another number of
        freedoms than there are inputs.
    """
    if solver.assembly.has_closed_form:
        found = _dyad_branches(solver, lattice, search)
    else:
        found = _guided_branches(solver, lattice, search)
    if not found.branches:
        raise SolveError(_why_nothing_closes(solver, lattice))
    return found


def _dyad_branches(solver: Solver, lattice: Lattice, search: bool) -> Found:
    ends = solver.mechanism.ends
    groups = solver.assembly.groups
    found: list[tuple[int, ...]] = []

    def extend(state: State, signs: tuple[int, ...]) -> None:
        if len(found) >= MOST_BRANCHES or np.all(state.lost):
            return
        if len(signs) == len(groups):
            found.append(signs)
            return
        for sign in (1, -1):
            grown = state.copy()
            place_dyad(grown, groups[len(signs)], ends, sign)
            extend(grown, (*signs, sign))

    reference = solver.geometry.reference
    own: tuple[int, ...] | None = None
    if reference is not None:
        own = _signs_at(solver, reference)
    probes, methods = 0, tuple[Method | None, ...]([None] * len(groups))
    claim = REFERENCE_ONLY
    if search or own is None:
        probed, claim = _probed(solver, lattice)
        probes, methods = len(probed), (CLOSED_FORM,) * len(groups)
        with np.errstate(invalid="ignore", divide="ignore"):
            extend(solver.start(probed), ())
    if own is not None:
        found = [own, *(signs for signs in found if signs != own)][:MOST_BRANCHES]
    branches = tuple(Branch(number, signs) for number, signs in enumerate(found))
    return Found(branches, probes, methods, _limited(claim, len(branches)))


def _probed(solver: Solver, lattice: Lattice) -> tuple[Floats, Claim]:
    """Return the inputs (k, inputs) at which the modes of dyads are looked for."""
    if lattice.q.shape[1] > 1:
        q = lattice.thinned(PROBED_INPUTS).q
        return q, Claim(Guarantee.SAMPLED, f"modes at {len(q)} of the samples")
    low, high = _range(lattice)
    dead = dead_inputs(solver, low, high, MOST_COST)
    step = (high - low) / (PROBED_INPUTS - 1)
    return dead.probes(step)[:, None], dead.claim(step)


def _limited(claim: Claim, count: int) -> Claim:
    """Return what is claimed of so many branches."""
    if count < MOST_BRANCHES:
        return claim
    return Claim(Guarantee.SAMPLED, f"stopped at {MOST_BRANCHES} modes; there may be more")


def _range(lattice: Lattice) -> tuple[float, float]:
    """Return the least and the greatest value of a single input."""
    return float(np.min(lattice.q)), float(np.max(lattice.q))


def _signs_at(solver: Solver, values: Floats) -> tuple[int, ...]:
    """Return the dyad signs of a closed configuration (variables,), 0 for other groups."""
    placed, states = solver.closure.place(values[None])
    axes = pair_axes(solver.joints, solver.closure.frames(placed, states))[0]
    signs = []
    for group in solver.assembly.groups:
        if group.is_dyad:
            triple = float(np.linalg.det(axes[list(group.pairs)]))
            signs.append(1 if triple >= 0.0 else -1)
        else:
            signs.append(0)
    return tuple(signs)


def _guided_branches(solver: Solver, lattice: Lattice, search: bool) -> Found:
    driven = list(solver.driven)
    branches: list[Branch] = []
    freedoms: list[int] = []
    reference = solver.geometry.reference
    redundant = any(group.redundant for group in solver.assembly.groups)

    def add(values: Floats) -> None:
        values = solver.closure.solve(values[None], driven).values[0]
        if redundant:
            freedoms.append(solver.freedoms(values))
            if freedoms[-1] != len(driven):
                return
        guide = _guide(solver, lattice, values)
        if guide is not None:
            branch = Branch(len(branches), _signs_at(solver, values), guide)
            branches.append(_with_determinants(solver, branch, values))

    meshes = solver.meshes
    rolls = meshes is not None and not meshes.all_known
    if reference is not None and meshes is not None:
        middle = 0.5 * (np.min(lattice.q, axis=0) + np.max(lattice.q, axis=0))
        add(meshes.moved(reference, driven, middle))
    elif reference is not None:
        values = reference.copy()
        middle = 0.5 * (np.min(lattice.q, axis=0) + np.max(lattice.q, axis=0))
        half = 0.5 * np.ptp(lattice.q, axis=0)
        turns = np.round((middle - reference[driven]) / (2 * np.pi))
        outside = np.abs(reference[driven] - middle) > half
        values[driven] += np.where(outside, 2 * np.pi * turns, 0.0)
        add(values)
    if reference is not None and freedoms and freedoms[0] < len(driven):
        # Where the pose given cannot move, a search of other modes takes long and is not
        # what was asked.
        raise _other_rank(solver, freedoms[0])
    probes = 0
    methods: list[Method | None] = [None] * len(solver.assembly.groups)
    claim = REFERENCE_ONLY

    def probe(inputs: Floats) -> None:
        nonlocal probes, methods
        for q in inputs:
            if (rolls and branches) or len(branches) >= MOST_BRANCHES:
                break
            here = assemblies(solver, q)
            probes += 1
            methods = [
                least_complete(*both) for both in zip(methods, here.methods, strict=True)
            ]
            add_new([values for _, values in here.modes], q)

    def add_new(modes: Sequence[Floats], q: Floats) -> None:
        known = _known_at(solver, lattice, branches, q)
        for values in modes:
            placed, _ = solver.closure.place(values[None])
            if len(branches) < MOST_BRANCHES and all(
                are_far(placed[0], other) for other in known
            ):
                add(values)
                known.append(placed[0])

    if search or not branches:
        if len(driven) > 1:
            probe(_scattered(lattice))
            claim = Claim(Guarantee.SAMPLED, f"modes at {probes} of the samples")
        else:
            dead = dead_inputs(solver, *_range(lattice), MOST_COST)
            step = np.ptp(lattice.q) / PROBES
            probe(lattice.q[:1] if rolls else np.zeros((0, 1)))
            probe(dead.probes(step)[:, None])
            complete = all(method is None or method.is_complete for method in methods)
            if complete and dead.gap(step) and not rolls:
                done = dead.probes(step)
                step = step / FINER
                finer = dead.probes(step)
                apart = np.abs(finer[:, None] - done).min(axis=1) > 1e-9
                probe(finer[apart, None])
            complete = all(method is None or method.is_complete for method in methods)
            if dead.gap(step) and not rolls:
                for values in _beyond_dead_centres(solver, lattice, branches):
                    if len(branches) >= MOST_BRANCHES:
                        break
                    add_new([values], values[driven])
            claim = dead.claim(step)
            if rolls or not complete:
                claim = Claim(Guarantee.SAMPLED, f"modes found at {_inputs(probes)}")
    if freedoms and not branches and min(freedoms) != len(driven):
        raise _other_rank(solver, min(freedoms))
    claim = _limited(claim, len(branches))
    return Found(tuple(branches), probes, tuple(methods), claim)


def _other_rank(solver: Solver, freedoms: int) -> PlanError:
    return PlanError(
        f"{solver.mechanism.name}: mobility {freedoms} by rank with "
        f"{graph_mobility(solver.mechanism)} by the graph, but the number of inputs is "
        f"{len(solver.driven)}; {inputs_to_declare(freedoms)}"
    )


def _beyond_dead_centres(
    solver: Solver, lattice: Lattice, branches: Sequence[Branch]
) -> Iterator[Floats]:
    """Yield configurations (variables,) of all modes on the curves of branches.

    Only branches that end within the range lead to others.
    """
    curves: list[ArcCurve] = []
    for branch in tuple(branches):
        guide = branch.guide
        if not isinstance(guide, Curve) or guide.ends == (Status.OK, Status.OK):
            continue
        values = guide.values[len(guide.values) // 2]
        if any(np.isfinite(curve.find(values[None])[0]) for curve in curves):
            continue
        try:
            curves.append(follow_arc(solver.closure, values))
        except SolveError:
            continue
        yield from Stretches.of(curves[-1], solver.single, *_range(lattice)).middles


def _inputs(count: int) -> str:
    return "1 input" if count == 1 else f"{count} inputs"


def _guide(solver: Solver, lattice: Lattice, values: Floats) -> Curve | Sheet | None:
    """Return the guide through a closed configuration, None if it is out of range."""
    driven = list(solver.driven)
    here = values[driven]
    if len(driven) == 1:
        low, high = _range(lattice)
        q = float(here[0])
        curve = follow(solver.closure, driven[0], values, min(low, q), max(high, q))
        return curve if curve.inputs[0] <= high and curve.inputs[-1] >= low else None
    near = lattice.nearest(here, NEAREST)
    start = np.repeat(values[None], len(near), axis=0)
    found, status = walk(solver.closure, driven, start, lattice.q[near])
    arrived = np.flatnonzero(status == Status.OK)
    if not len(arrived):
        return None
    first = arrived[0]
    return spread(solver.closure, driven, lattice, int(near[first]), found[first])


def _scattered(lattice: Lattice) -> Floats:
    """Return samples (k, inputs) spread over a lattice, its middle first."""
    parts = (np.arange(PROBES) + 0.5) / PROBES
    order = np.argsort(np.abs(parts - 0.5), kind="stable")
    rows = np.zeros(PROBES, dtype=np.intp)
    for axis, count in enumerate(lattice.shape):
        step = np.roll(parts[order], axis * (PROBES // 2)) if axis else parts[order]
        place = np.minimum((step * count).astype(np.intp), count - 1)
        rows = rows * count + place
    return lattice.q[np.unique(rows)]


def _with_determinants(solver: Solver, branch: Branch, values: Floats) -> Branch:
    """Give the branch the signs of its irreducible groups' determinants."""
    state = solver.start(values[None, list(solver.driven)])
    determinants = []
    for group, sign in zip(solver.assembly.groups, branch.signs, strict=True):
        if sign:
            place_dyad(state, group, solver.mechanism.ends, sign)
            determinants.append(float(sign))
        else:
            start = values[None, group_variables(state, group)]
            _, _, jacobian = place_group(state, group, solver.mechanism.ends, start)
            determinant, _ = determinant_signs(jacobian)
            determinants.append(float(determinant[0]))
    return Branch(branch.number, branch.signs, branch.guide, tuple(determinants))


def _known_at(
    solver: Solver, lattice: Lattice, branches: Sequence[Branch], q: Floats
) -> list[Floats]:
    """Return the orientations (links, 3, 3) that branches have at an input (inputs,)."""
    row = lattice.nearest(q, 1)
    known = []
    for branch in branches:
        if isinstance(branch.guide, Curve) and not branch.guide.covers(q)[0]:
            continue
        there = solver.evaluate(branch, q[None], row)
        if there.status[0] in (Status.OK, Status.AT_SINGULARITY):
            known.append(there.rotations[0])
    return known


def _why_nothing_closes(solver: Solver, lattice: Lattice) -> str:
    name = solver.mechanism.name
    inputs = [solver.mechanism.pairs[pair].name for pair in solver.assembly.inputs]
    lows, highs = np.degrees([np.min(lattice.q, axis=0), np.max(lattice.q, axis=0)])
    degrees = ", ".join(
        f"{pair} in [{low:.6g}, {high:.6g}] deg"
        for pair, low, high in zip(inputs, lows, highs, strict=True)
    )
    state = solver.start(lattice.thinned(PROBED_INPUTS).q)
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
    return (
        f"{name}: no configuration was found for inputs {degrees}: the {group.kind} "
        f"of pairs {pairs} did not close from any start, or only with profiles that enter "
        "each other; change its arcs, profiles or the range, or give a reference pose"
    )


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
    found: list[tuple[tuple[int, ...], Floats]] = []
    methods: list[Method | None] = [None] * len(groups)

    def extend(state: State, signs: tuple[int, ...]) -> None:
        if len(found) >= 4 * MOST_BRANCHES:
            return
        number = len(signs)
        if number == len(groups):
            found.append((signs, state.values[0].copy()))
            return
        grown, method = _grown(solver, state, groups[number])
        methods[number] = least_complete(methods[number], method)
        for sign, further in grown:
            extend(further, (*signs, sign))

    if solver.meshes is not None and solver.meshes.all_known:
        there = solver.meshes.modes(solver.closure, solver.driven, q)
        modes = tuple((_signs_at(solver, values), values) for values in there)
        return Assemblies(modes, (Method(0),) * len(groups))
    with np.errstate(invalid="ignore", divide="ignore"):
        extend(solver.start(q[None]), ())
    return Assemblies(tuple(found), tuple(methods))


def _grown(
    solver: Solver, state: State, group: Group
) -> tuple[list[tuple[int, State]], Method]:
    """Return the states in which a group is placed, with dyad signs, and the method."""
    ends = solver.mechanism.ends
    grown = []
    if group.is_dyad:
        for sign in (1, -1):
            further = state.copy()
            place_dyad(further, group, ends, sign)
            if not further.lost[0]:
                grown.append((sign, further))
        return grown, CLOSED_FORM
    found, method = solutions(group, group_closure(state, group, ends))
    for values in found:
        further = state.copy()
        place_group(further, group, ends, values[None])
        grown.append((0, further))
    return grown, method
