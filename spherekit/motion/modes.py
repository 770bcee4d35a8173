"""Finding the assembly modes of a mechanism over the ranges of its inputs.

All modes of dyads are enumerated; those of irreducible groups are searched for from many
random starts at several inputs, and each new one is followed as far as it goes.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.errors import PlanError, SolveError
from spherekit.model.geometry import Contact, Revolute
from spherekit.motion.branches import Branch, Solver, determinant_signs, penetrates, wrap
from spherekit.motion.closure import Closure
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
from spherekit.motion.steps import walk
from spherekit.planning.assembly import Group
from spherekit.planning.rigidity import graph_mobility, inputs_to_declare
from spherekit.sphere.rotation import Floats

MOST_BRANCHES = 64
"""Branches of one run; a mechanism of many dyads has 2 to their number."""
PROBED_INPUTS = 721
"""Inputs over the range at which the modes of dyads are looked for."""
PROBES = 5
"""Inputs at which all modes of irreducible groups are searched for."""
STARTS = 192
"""Random starts of one round of that search; it ends after two rounds without news."""
MOST_ROUNDS = 12
NEAREST = 8
"""Samples nearest to a reference pose that straight ways are tried to."""
SAME_MODE = 1e-6
"""Closed configurations whose rotation matrices differ by less are one."""


def find_branches(
    solver: Solver, lattice: Lattice, search: bool = True
) -> tuple[Branch, ...]:
    """Return the branches that have at least one configuration at the inputs given.

    The mode of a given reference pose comes first. All modes of dyads are found; those
    of irreducible groups by a search at several inputs, which may miss some. For one
    input the range between the first and the last sample is what counts; for several the
    samples of the lattice.

    Raises
    ------
    SolveError
        If the arcs close nowhere.
    PlanError
        If the rank of a mechanism with redundant constraints leaves another number of
        freedoms than there are inputs.
    """
    if solver.assembly.has_closed_form:
        branches = _dyad_branches(solver, lattice, search)
    else:
        branches = _guided_branches(solver, lattice, search)
    if not branches:
        raise SolveError(_why_nothing_closes(solver, lattice))
    return tuple(branches)


def _dyad_branches(solver: Solver, lattice: Lattice, search: bool) -> list[Branch]:
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
    with np.errstate(invalid="ignore", divide="ignore"):
        if search or own is None:
            extend(solver.start(_probed(lattice)), ())
    if own is not None:
        found = [own, *(signs for signs in found if signs != own)][:MOST_BRANCHES]
    return [Branch(number, signs) for number, signs in enumerate(found)]


def _probed(lattice: Lattice) -> Floats:
    """Return the inputs (k, inputs) at which the modes of dyads are looked for."""
    if lattice.q.shape[1] == 1:
        return np.linspace(*_range(lattice), PROBED_INPUTS)[:, None]
    return lattice.thinned(PROBED_INPUTS).q


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


def _guided_branches(solver: Solver, lattice: Lattice, search: bool) -> list[Branch]:
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

    if reference is not None:
        values = reference.copy()
        middle = 0.5 * (np.min(lattice.q, axis=0) + np.max(lattice.q, axis=0))
        half = 0.5 * np.ptp(lattice.q, axis=0)
        turns = np.round((middle - reference[driven]) / (2 * np.pi))
        outside = np.abs(reference[driven] - middle) > half
        values[driven] += np.where(outside, 2 * np.pi * turns, 0.0)
        add(values)
    if search or not branches:
        rolls = any(isinstance(j, Contact) and j.rolling for j in solver.joints)
        for q in _probes(solver, lattice):
            if rolls and branches:
                break
            for _, values in assemblies(solver, q):
                if len(branches) < MOST_BRANCHES and not _is_known(
                    solver, lattice, branches, values
                ):
                    add(values)
    if freedoms and not branches and min(freedoms) != len(driven):
        raise PlanError(
            f"{solver.mechanism.name}: mobility {min(freedoms)} by rank with "
            f"{graph_mobility(solver.mechanism)} by the graph, but the number of inputs is "
            f"{len(driven)}; {inputs_to_declare(min(freedoms))}"
        )
    return branches


def _guide(solver: Solver, lattice: Lattice, values: Floats) -> Curve | Sheet | None:
    """Return the guide through a closed configuration, None if it meets no sample."""
    driven = list(solver.driven)
    here = values[driven]
    if len(driven) == 1:
        low, high = _range(lattice)
        q = float(here[0])
        curve = follow(solver.closure, driven[0], values, min(low, q), max(high, q))
        covered = curve.covers(np.linspace(low, high, PROBED_INPUTS))
        return curve if np.any(covered) else None
    near = lattice.nearest(here, NEAREST)
    start = np.repeat(values[None], len(near), axis=0)
    found, status = walk(solver.closure, driven, start, lattice.q[near])
    arrived = np.flatnonzero(status == Status.OK)
    if not len(arrived):
        return None
    first = arrived[0]
    return spread(solver.closure, driven, lattice, int(near[first]), found[first])


def _probes(solver: Solver, lattice: Lattice) -> Floats:
    """Return the inputs (k, inputs) at which modes are searched for.

    Wheels mesh again after every turn, in another position of the train: those positions
    are one motion, so a mechanism with rolling pairs is assembled at the first of these
    inputs where it can be, and of modes that differ by whole turns of wheels the one
    nearest to the start is kept.
    """
    if len(solver.driven) == 1:
        low, high = _range(lattice)
        parts = (np.arange(PROBES) + 0.5) / PROBES
        inside = (low + parts * (high - low))[:, None]
    else:
        inside = _scattered(lattice)
    if any(isinstance(j, Contact) and j.rolling for j in solver.joints):
        return np.concatenate([lattice.q[:1], inside])
    return inside


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


def _is_known(
    solver: Solver, lattice: Lattice, branches: Sequence[Branch], values: Floats
) -> bool:
    """Return whether a configuration at a probed input lies on one of the branches."""
    q = values[None, list(solver.driven)]
    row = lattice.nearest(q[0], 1)
    for branch in branches:
        if isinstance(branch.guide, Curve) and not branch.guide.covers(q[0])[0]:
            continue
        there = solver.evaluate(branch, q, row)
        placed, _ = solver.closure.place(values[None])
        if there.status[0] in (Status.OK, Status.AT_SINGULARITY) and not _far(
            there.rotations[0], placed[0]
        ):
            return True
    return False


def _why_nothing_closes(solver: Solver, lattice: Lattice) -> str:
    name = solver.mechanism.name
    inputs = [solver.mechanism.pairs[pair].name for pair in solver.assembly.inputs]
    lows, highs = np.degrees([np.min(lattice.q, axis=0), np.max(lattice.q, axis=0)])
    degrees = ", ".join(
        f"{pair} in [{low:.6g}, {high:.6g}] deg"
        for pair, low, high in zip(inputs, lows, highs, strict=True)
    )
    state = solver.start(_probed(lattice))
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


def assemblies(solver: Solver, q: Floats) -> list[tuple[tuple[int, ...], Floats]]:
    """Return every mode found at inputs q (inputs,): dyad signs and variables.

    Complete for dyads; for irreducible groups a search from random starts.
    """
    found: list[tuple[tuple[int, ...], Floats]] = []

    def extend(state: State, signs: tuple[int, ...]) -> None:
        if len(found) >= 4 * MOST_BRANCHES:
            return
        if len(signs) == len(solver.assembly.groups):
            found.append((signs, state.values[0].copy()))
            return
        for sign, grown in _grow(solver, state, solver.assembly.groups[len(signs)]):
            extend(grown, (*signs, sign))

    with np.errstate(invalid="ignore", divide="ignore"):
        extend(solver.start(q[None]), ())
    return found


def _grow(solver: Solver, state: State, group: Group) -> Iterator[tuple[int, State]]:
    if group.is_dyad:
        for sign in (1, -1):
            grown = state.copy()
            place_dyad(grown, group, solver.mechanism.ends, sign)
            if not grown.lost[0]:
                yield sign, grown
        return
    for values in _search(solver, state, group):
        grown = state.copy()
        place_group(grown, group, solver.mechanism.ends, values[None])
        yield 0, grown


def _search(solver: Solver, state: State, group: Group) -> list[Floats]:
    random = np.random.default_rng(20240616)
    single = group_closure(state, group, solver.mechanism.ends)
    low, high = _starting_range(single)
    rolling = [variable for variable, _ in _rolling(single)]
    modes: list[Floats] = []
    poses: list[Floats] = []
    dry = 0
    for _ in range(MOST_ROUNDS):
        starts = random.uniform(low, high, (STARTS, len(low)))
        result = single.solve(starts, iterations=40)
        known = len(modes)
        good = result.values[result.residual < CLOSURE_TOLERANCE]
        placed, states = single.place(good)
        inside = np.all(states.inside, axis=1) & ~penetrates(single.joints, states)
        order = np.argsort(np.sum(np.abs(good[:, rolling]), axis=1), kind="stable")
        for row in order[inside[order]]:
            values, pose = good[row], placed[row]
            if any(_meshes_again(single, values, mode) for mode in modes):
                continue
            if all(_far(pose, other) for other in poses):
                modes.append(values)
                poses.append(pose)
            if len(modes) == MOST_BRANCHES:
                break
        dry = dry + 1 if len(modes) == known else 0
        if dry == 2 or len(modes) == MOST_BRANCHES:
            break
    return sorted(modes, key=lambda mode: [round(float(value), 6) for value in wrap(mode)])


def _starting_range(closure: Closure) -> tuple[Floats, Floats]:
    """Return the limits (variables,) between which random starts are drawn."""
    low: list[float] = []
    high: list[float] = []
    for joint in closure.joints:
        if isinstance(joint, Revolute):
            low, high = [*low, -np.pi], [*high, np.pi]
        elif joint.rolling:
            half = 0.5 * max(joint.first.length, joint.second.length)
            low, high = [*low, -half], [*high, half]
        else:
            low, high = [*low, 0.0, 0.0], [*high, joint.first.length, joint.second.length]
    return np.array(low), np.array(high)


def _rolling(closure: Closure) -> list[tuple[int, Contact]]:
    """Return the variable and joint of every rolling pair."""
    return [
        (variable, joint)
        for variable, pair in enumerate(closure.tree.owners)
        if isinstance(joint := closure.joints[pair], Contact) and joint.rolling
    ]


def _meshes_again(closure: Closure, one: Floats, other: Floats) -> bool:
    """Return whether two modes (variables,) differ by whole turns of rolling wheels."""
    shifted = False
    for variable, joint in _rolling(closure):
        way = one[variable] - other[variable]
        turns = [way / curve.length for curve in (joint.first, joint.second)]
        if min(abs(turn - round(turn)) for turn in turns) > SAME_MODE:
            return False
        shifted |= abs(way) > SAME_MODE
    return shifted


def _far(one: Floats, other: Floats) -> bool:
    """Return whether two sets of orientations (bodies, 3, 3) differ."""
    return bool(np.max(np.abs(one - other)) > SAME_MODE)
