"""All solutions of the closure equations of one design, complex ones included.

From those that are known, by loops in the space of designs and complex inputs: where a
loop comes back, each solution has become one of the design's (monodromy; Sommese and
Wampler, The Numerical Solution of Systems of Polynomials, 2005). Loops go on until none
brings a new one; where elimination knows how many there are, until all are there.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.design.homotopy import SAME, apart, distinct, settled, straight, tracked
from spherekit.engine.design_kernel import PathKernel, path_kernel
from spherekit.engine.row_quantities import (
    VariedTerms,
)
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.elimination import assemblies

MOST_SOLUTIONS = 64
"""Complex solutions up to which all of them are followed."""
TOGETHER, ROUNDS, IN_VAIN = 16, 24, 4
"""Loops that are gone round together, how often, and rounds without a new solution after
which there are no more."""
ASIDE = 0.5
"""How far (rad) loops go off in each size."""
NEARBY = 0.1
"""How far (rad) in each size the design is from that of the file."""
SEEDED = 5
"""Inputs at which solutions to start from are looked for."""


@dataclass(frozen=True)
class StartSolutions:
    """The solutions (variables, m) of a design with `sizes` (k,) at complex inputs q.

    `counted` says whether their number is known, and was found.
    """

    values: Array
    sizes: Floats
    q: Array
    counted: bool


def start_set(
    kernel: PathKernel, sizes: Floats, terms: VariedTerms, of_every: Floats
) -> StartSolutions | None:
    """Return all solutions of the mechanism of a file; None if they are not found.

    `sizes` are its numbers that `kernel` has as inputs. Loops go through all its sizes,
    those that `terms` have, where it has the numbers `of_every`.
    """
    structure = terms.structure
    names = structure.mechanism.names_of(structure.input_pairs)
    inputs = structure.mechanism.with_inputs(*names).inputs
    q = np.array([complex(0.5 * (i.start + i.stop), 0.7) for i in inputs])
    general = path_kernel(terms, compiled=False)
    rng = np.random.default_rng(20)
    low, high = np.sort([(i.start, i.stop) for i in inputs], axis=1).T
    places = rng.uniform(low, high, (SEEDED, len(inputs)))
    seeds, roots = _seeds(terms, general, of_every, places)
    if not seeds.shape[1] or roots > MOST_SOLUTIONS:
        return None
    base = of_every + rng.uniform(-NEARBY, NEARBY, len(of_every))
    there = q[:, None]
    seeded = _moved(general, seeds, (of_every, base), (seeds[general.driven], there))
    solutions = _all(general, _joined(seeded[:, :0], seeded), base, q, roots, rng)
    if solutions is None:
        return None
    values = _moved(general, solutions, (base, of_every), (there, there))
    # Sizes that stay may be special ones, for which there are fewer.
    values = _joined(values[:, :0], values)
    if not values.shape[1] or not distinct(values[:, None])[0]:
        return None
    counted = roots > 0 and values.shape == solutions.shape
    at_rest = kernel.prepare(np.repeat(sizes[:, None], values.shape[1], axis=1))
    _, closed = settled(lambda now, some: kernel.at(now, at_rest[:, some]), values)
    return StartSolutions(values, sizes, q, counted) if np.all(closed) else None


def _all(
    kernel: PathKernel,
    solutions: Array,
    sizes: Floats,
    q: Array,
    roots: int,
    rng: np.random.Generator,
) -> Array | None:
    """Return all solutions from some; None if too many, or not as many as known."""
    in_vain = 0
    for _ in range(ROUNDS):
        if solutions.shape[1] == roots or (not roots and in_vain == IN_VAIN):
            break
        if solutions.shape[1] > MOST_SOLUTIONS:
            return None
        more = _joined(solutions, _around(kernel, solutions, sizes, q, rng))
        in_vain = 0 if more.shape[1] > solutions.shape[1] else in_vain + 1
        solutions = more
    count = solutions.shape[1]
    return solutions if count and count == (roots or count) else None


def _seeds(
    terms: VariedTerms, kernel: PathKernel, sizes: Floats, inputs: Floats
) -> tuple[Floats, int]:
    """Return solutions (variables, n) at inputs (m, k), and how many there are in all.

    0 where that is not known.
    """
    structure = terms.structure
    mechanism, driven = structure.mechanism, structure.assembly.inputs
    moving = mechanism.with_inputs(*(mechanism.pairs[pair].name for pair in driven))
    solver = Solver(moving, structure.assembly)
    # Newton's first step takes pairs that follow the inputs to their places.
    values = np.zeros((kernel.variables, len(inputs)))
    values[kernel.driven] = inputs.T
    prepared = kernel.prepare(np.repeat(sizes[:, None], len(inputs), axis=1))
    with np.errstate(all="ignore"):
        step = kernel.at(values, prepared).step
    following = [v for v in solver.driven if v not in kernel.driven]
    values[following] += step[following]
    configurations, roots = [], 0
    for q in values[list(solver.driven)].T:
        here = assemblies(solver, q)
        configurations += [closed for _, closed in here.modes]
        counts = [method.roots if method else 0 for method in here.methods]
        roots = max(roots, int(np.prod(counts)))
    return np.array(configurations).reshape(-1, kernel.variables).T, roots


def _around(
    kernel: PathKernel,
    values: Array,
    sizes: Floats,
    q: Array,
    rng: np.random.Generator,
) -> Array:
    """Return where solutions come to along random triangles that return to a place."""
    count = values.shape[1]
    corners = [(sizes[:, None], q[:, None])]
    for _ in range(2):
        aside = rng.uniform(-ASIDE, ASIDE, (len(sizes), TOGETHER))
        some = len(q), TOGETHER
        away = rng.uniform(-4.0, 4.0, some) + 1j * rng.uniform(-1.5, 0.5, some)
        there = sizes[:, None] + np.repeat(aside, count, axis=1)
        corners.append((there, q[:, None] + np.repeat(away, count, axis=1)))
    now, arrived = np.tile(values, (1, TOGETHER)), np.ones(TOGETHER * count, dtype=bool)
    for (one, begin), (other, end) in zip(corners, corners[1:] + corners[:1], strict=True):
        now, reached = tracked(kernel, straight((one, other), (begin, end)), now)
        arrived &= reached
    return now[:, arrived]


def _moved(
    kernel: PathKernel,
    values: Array,
    sizes: tuple[Floats, Floats],
    q: tuple[Array, Array],
) -> Array:
    """Return where solutions come to, those that do."""
    one, other = sizes
    way = straight((one[:, None], other[:, None]), q)
    made, arrived = tracked(kernel, way, values.astype(complex))
    return made[:, arrived]


def _joined(solutions: Array, more: Array) -> Array:
    """Return solutions with those of `more` that are new."""
    kept = list(solutions.T)
    for solution in more.T:
        if not kept or np.min(apart(np.array(kept).T, solution[:, None])) > SAME:
            kept.append(solution)
    return np.array(kept).reshape(-1, len(solutions)).T
