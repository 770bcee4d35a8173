"""All configurations of a mechanism at many samples of its inputs, side by side.

Groups are placed in solving order. A dyad has two configurations in closed form. The arc
equations of a triad, or of a group of seven bodies, are eliminated at all samples together.
A group without elimination needs a search from random starts, which is not done here.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.assembly_modes import FLAT_DYAD, Solver
from spherekit.motion.closure import Closure, least_change
from spherekit.motion.elimination import (
    MOVED,
    POINTLIKE,
    Frames,
    Order,
    bars_of,
    distinct_by_elimination,
    has_elimination,
    orders_of,
    sort_keys,
)
from spherekit.motion.groups import State, group_closure, group_variables, place_dyad
from spherekit.motion.loops import condition
from spherekit.motion.search import POLISHING_STEPS
from spherekit.numeric.crossings import wrap
from spherekit.planning.inputs import Group
from spherekit.sphere.rotation import all_finite, cross, max_abs
from spherekit.sphere.trigonometric import real_angles

SAMPLES_AT_ONCE = 256
"""Samples whose equations are eliminated together. More of them do not fit into the caches
and take longer for each sample; fewer cost more calls."""
REAL_RAD = 1e-9
"""Solutions with a smaller imaginary part (rad) are real. Simple ones are known far better.
Those between this and `COMPLEX_RAD` are examined sample by sample."""
COMPLEX_RAD = 1e-4
"""Solutions with a larger imaginary part (rad) are complex: rounding splits a double one
by about 1e-8."""
APART_RAD = 1e-4
"""Configurations of one sample that are nearer (rad) are examined in the same way."""
WELL_CONDITIONED = 1e5
"""Samples with a configuration of a larger condition number are examined one by one: two
configurations that meet there may be one up to rounding."""
LARGEST_POLISHING_STEP_RAD = 1e-12
"""Larger last steps (rad) are not made: no residual of a closed group is their reason."""
SAME_FRAMES = 1e-13
"""Pair frames that differ by less in all components give the same solutions."""
MOST_EXAMINED = 200
"""Samples of one group that are examined one by one, at some 6 ms each. Further ones are
reported as incomplete."""


@dataclass(frozen=True)
class SampleConfigurations:
    """Configurations at n samples: sample after sample, in each in a definite order.

    Attributes
    ----------
    sample
        (k,) number of the sample, rising.
    values
        (k, variables) rad.
    is_complete
        (n,) whether no real configuration of the sample can be missing.
    problem
        Why some may be missing at one of the others, in words.
    """

    sample: Indices
    values: Floats
    is_complete: Bools
    problem: str


def can_enumerate(solver: Solver) -> bool:
    """Return whether all groups are dyads, trains of wheels, or have an elimination."""
    return all(
        group.is_dyad or number in solver.trains or has_elimination(group)
        for number, group in enumerate(solver.assembly.groups)
    )


def enumerate_configurations(solver: Solver, q: Floats) -> SampleConfigurations:
    """Return all configurations at inputs q (n, inputs), rad.

    The mechanism must fulfil `can_enumerate`. The order within a sample is that of
    `spherekit.motion.elimination.assemblies`.
    """
    parts = []
    for first in range(0, len(q), SAMPLES_AT_ONCE):
        part = _enumerate_some(solver, q[first : first + SAMPLES_AT_ONCE])
        parts.append((first, part))
    problems = [part.problem for _, part in parts if part.problem]
    values = _polish(solver, np.concatenate([part.values for _, part in parts]))
    return SampleConfigurations(
        sample=np.concatenate([first + part.sample for first, part in parts]),
        values=values,
        is_complete=np.concatenate([part.is_complete for _, part in parts]),
        problem=problems[0] if problems else "",
    )


def _polish(solver: Solver, values: Floats) -> Floats:
    """Return closed configurations (k, variables) after one more Newton step.

    A group counts as closed at residuals below 1e-15. Times the inverse of its Jacobian
    that leaves some 1e-14 rad, a tenth of which is rounding.
    """
    at = solver.closure.at(values)
    passive = np.delete(np.arange(values.shape[1]), solver.driven)
    step = np.zeros_like(values)
    step[:, passive] = least_change(at.jacobian[:, :, passive], -at.residual)
    # Next to a singular configuration a step can be of any size.
    is_small = max_abs(step, axis=1) < LARGEST_POLISHING_STEP_RAD
    return np.where(is_small[:, None], values + step, values)


def _enumerate_some(solver: Solver, q: Floats) -> SampleConfigurations:
    """Return all configurations at a few inputs q (n, inputs)."""
    is_complete = np.ones(len(q), dtype=bool)
    sample = np.arange(len(q))
    problem = ""
    with np.errstate(all="ignore"):
        state = solver.start(q)
        for number, group in enumerate(solver.assembly.groups):
            if group.is_dyad:
                state, parent = _place_both_modes(state, group)
            elif number in solver.trains:
                closed = solver.place(state, number, q[sample]).gap < CLOSURE_TOLERANCE
                parent = np.flatnonzero(closed)
                state = state.rows(parent)
            else:
                closure = group_closure(state, group)
                solutions = _eliminate_once(group, closure, sample)
                is_complete[sample[~solutions.is_complete]] = False
                problem = problem or solutions.problem
                parent = solutions.sample
                placed = closure.take(parent).at(solutions.values).placed
                state = state.rows(parent)
                state.merge(group, placed)
                state.values[:, group_variables(state, group)] = solutions.values
            sample = sample[parent]
    return SampleConfigurations(sample, state.values, is_complete, problem)


def _place_both_modes(state: State, group: Group) -> tuple[State, Indices]:
    """Return the states in which a dyad is placed, and the row of `state` of each.

    A flat dyad has one configuration, which both formulas give.
    """
    states = []
    parents = []
    for sign in (1, -1):
        placed = state.copy()
        sine = place_dyad(placed, group, sign)
        closes = ~placed.lost
        if sign < 0:
            closes &= ~(sine < FLAT_DYAD)
        parents.append(np.flatnonzero(closes))
        states.append(placed.rows(parents[-1]))
    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")
    return State.joined(states).rows(order), parent[order]


def _eliminate_once(
    group: Group, closure: Closure, sample: Indices
) -> SampleConfigurations:
    """Return the configurations of one group at all rows of its closure.

    A group that stands beside the earlier ones has the same equations in all rows of a
    sample: they are solved once.

    Parameters
    ----------
    sample
        (k,) rising: the sample of each row.

    Returns
    -------
    SampleConfigurations
        Its `sample` are the rows.
    """
    first = np.searchsorted(sample, sample)
    assert closure.leads is not None
    differences = [max_abs(lead - lead[first], axis=(1, 2, 3)) for lead in closure.leads]
    alike = np.maximum(*differences) < SAME_FRAMES
    solved = np.flatnonzero(~alike | (first == np.arange(len(sample))))
    solutions = _eliminate(group, closure.take(solved))
    if len(solved) == len(sample):
        return solutions
    source = np.searchsorted(solved, np.where(alike, first, np.arange(len(sample))))
    starts = np.searchsorted(solutions.sample, np.arange(len(solved) + 1))
    counts = np.diff(starts)[source]
    rows = np.repeat(np.arange(len(sample)), counts)
    within = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    return SampleConfigurations(
        sample=rows,
        values=solutions.values[starts[source[rows]] + within],
        is_complete=solutions.is_complete[source],
        problem=solutions.problem,
    )


def _eliminate(group: Group, closure: Closure) -> SampleConfigurations:
    """Return the configurations of one group at all samples of its closure.

    Most samples are solved together. Those with a solution that is nearly double, or lost,
    are examined one by one with all checks of the elimination.
    """
    assert closure.leads is not None
    count = len(closure.leads[0])
    is_complete = np.zeros(count, dtype=bool)
    samples = [np.empty(0, dtype=np.intp)]
    values = [np.empty((0, len(group.pairs)))]
    for solve in (_solve_real_roots, _solve_all_roots):
        (left,) = np.nonzero(~is_complete)
        for first in range(0, len(left), SAMPLES_AT_ONCE):
            rows = left[first : first + SAMPLES_AT_ONCE]
            part = _solve_together(group, closure.take(rows), len(rows), solve)
            is_complete[rows] = part.is_complete
            samples.append(rows[part.sample])
            values.append(part.values)
    doubtful = np.flatnonzero(~is_complete)
    problem = "elimination was doubtful at too many samples"
    problems = [problem] if len(doubtful) > MOST_EXAMINED else []
    for row, configurations, why in _examine(group, closure, doubtful[:MOST_EXAMINED]):
        is_complete[row] = not why
        problems += [why] if why else []
        samples.append(np.full(len(configurations), row))
        values.append(configurations)
    sample = np.concatenate(samples)
    every = np.concatenate(values)
    order = np.lexsort((*sort_keys(every).T[::-1], sample))
    return SampleConfigurations(
        sample[order], every[order], is_complete, problems[0] if problems else ""
    )


def _solve_together(
    group: Group,
    closure: Closure,
    count: int,
    solve: Callable[[Frames, Order], tuple[Floats, Bools]],
) -> SampleConfigurations:
    """Return the configurations of the samples that need no other method.

    `is_complete` says which of the `count` samples these are. `solve` returns the real
    solutions (n, m, t) of the tree's angles, padded by NaN, and where (n,) these are all.
    """
    states = closure.at(np.zeros((count, len(group.pairs)))).states
    frames = Frames(group, np.moveaxis(np.stack([states.first, states.second]), 1, 2))
    order = orders_of(group)[0]
    tree_angles, is_clear = solve(frames, order)
    for bar in bars_of(group):
        axes = frames.axes_of_bar(bar)[0]
        is_clear &= np.linalg.norm(cross(*axes), axis=-1) >= POINTLIKE
    is_real = all_finite(tree_angles, 2)
    sample, number = np.nonzero(is_real & is_clear[:, None])
    placed = frames.placed(order, np.where(is_real[..., None], tree_angles, 0.0))
    near = frames.angles_at(placed[sample, number], sample)
    at = closure.take(sample).solve(near, iterations=POLISHING_STEPS)
    moved = max_abs(wrap(at.values - near), axis=1)
    is_sound = (at.gap < CLOSURE_TOLERANCE) & (moved < MOVED)
    is_sound &= condition(at.jacobian) < WELL_CONDITIONED
    is_clear[sample[~is_sound]] = False
    # Two real roots must not have led to one configuration.
    directions = np.full((*is_real.shape, len(group.pairs)), np.nan, dtype=complex)
    directions[sample, number] = np.exp(1j * at.values)
    distances = max_abs(directions[:, :, None] - directions[:, None], axis=3)
    distances[:, *np.diag_indices(is_real.shape[1])] = np.inf
    is_clear &= ~np.any(distances < APART_RAD, axis=(1, 2))
    kept = is_clear[sample]
    return SampleConfigurations(sample[kept], at.values[kept], is_clear, "")


def _solve_real_roots(frames: Frames, order: Order) -> tuple[Floats, Bools]:
    """Return the real solutions, and where they are counted by the roots on the circle."""
    return real_angles(frames.equations(order), order.involves)


def _solve_all_roots(frames: Frames, order: Order) -> tuple[Floats, Bools]:
    """Return the real ones of all complex solutions, and where none is missing."""
    tree_angles, _ = frames.solutions(order)
    imaginary_part = max_abs(tree_angles.imag, axis=2)
    is_real = imaginary_part < REAL_RAD
    is_clear = np.all(is_real | (imaginary_part > COMPLEX_RAD), axis=1)
    is_clear &= all_finite(tree_angles, (1, 2))
    return np.where(is_real[..., None], tree_angles.real, np.nan), is_clear


def _examine(
    group: Group, closure: Closure, rows: Indices
) -> Iterator[tuple[int, Floats, str]]:
    """Yield samples with their configurations (k, pairs), and why some may be missing."""
    for row in rows.tolist():
        distinct, problem = distinct_by_elimination(group, closure.take(np.array([row])))
        values = np.reshape(distinct.values, (-1, len(group.pairs)))
        if distinct.is_truncated:
            problem = problem or "only some of many singular configurations are kept"
        yield row, values, problem
