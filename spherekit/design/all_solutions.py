"""All solutions of the closure equations of one design, complex ones included.

From those that are known, by loops in the space of designs and complex inputs: where a
loop comes back, each solution has become one of the design's (monodromy; Sommese and
Wampler, The Numerical Solution of Systems of Polynomials, 2005). Loops go on until none
brings a new one; where elimination knows how many there are, until all are there.

Solutions of the closure equations followed from design to design, off the real axis.

Where the inputs leave the real axis, solutions neither meet nor vanish on the way, so all
of one design lead to all of another (coefficient-parameter continuation; Sommese and
Wampler, The Numerical Solution of Systems of Polynomials, 2005, chapter 7).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.engine.design_kernel import PathKernel, path_kernel
from spherekit.engine.row_quantities import (
    VariedTerms,
)
from spherekit.model.parts import Input
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.elimination import assemblies
from spherekit.sphere.rotation import all_finite, max_abs

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
    seeds, roots = _seeds(terms, general, of_every, _seeded(inputs))
    if not seeds.shape[1] or roots > MOST_SOLUTIONS:
        return None
    rng = np.random.default_rng(20)
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
    at_rest = np.repeat(sizes[:, None], values.shape[1], axis=1)
    _, closed = settled(kernel, values, kernel.prepare(at_rest))
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


def _seeded(inputs: Sequence[Input]) -> Floats:
    """Return the inputs (m, k) at which solutions to start from are looked for.

    Of several no direction is a special one: each takes its own order.
    """
    shares = np.linspace(0.0, 1.0, SEEDED + 2)[1:-1]
    ways = np.array([np.roll(shares, 2 * k) for k in range(len(inputs))])
    low, high = (np.array([getattr(i, end) for i in inputs]) for end in ("start", "stop"))
    return np.asarray((low[:, None] + (high - low)[:, None] * ways).T)


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
        now, reached = tracked(kernel, HomotopyPath((one, other), (begin, end)), now)
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
    made, arrived = tracked(kernel, HomotopyPath((one[:, None], other[:, None]), q), values)
    return made[:, arrived]


def _joined(solutions: Array, more: Array) -> Array:
    """Return solutions with those of `more` that are new."""
    kept = list(solutions.T)
    for solution in more.T:
        if not kept or np.min(apart(np.array(kept).T, solution[:, None])) > SAME:
            kept.append(solution)
    return np.array(kept).reshape(-1, len(solutions)).T


FIRST, LEAST, MOST = 0.125, 1e-5, 600
"""The first and the least step, as parts of a way, and most of them."""
NEAR = 0.3
"""Most (rad) by which a prediction may be off."""
CONTRACTS = 0.2
"""Newton's second step is at most this part of the first."""
POLISHING = 5
"""Newton's steps at most at the end of a way."""
CONVERGED = 1e-10
"""Newton's last step (rad) is smaller."""
CLOSED = 1e-11
"""Loops are open by less (rad)."""
FARTHEST = 12.0
"""Solutions whose imaginary parts (rad) are larger are not told from infinite ones."""
SAME = 1e-6
"""Solutions that differ by less (rad) are one."""


@dataclass(frozen=True)
class HomotopyPath:
    """Ways of n rows in sizes and inputs: straight, and bent off the real axis between.

    `sizes` (k, n) and `q` (inputs, n) at both ends, or (k, 1) and (inputs, 1) of all;
    `bend` (inputs, 1) is how far off the inputs are halfway.
    """

    sizes: tuple[Floats, Floats]
    q: tuple[Array, Array]
    bend: Array | float = 0.0

    def at(self, rows: Indices, t: Floats) -> tuple[Floats, Array]:
        """Return sizes (k, m) and inputs (inputs, m) of rows, parts t (m,) of ways on."""
        one, other, a, b = (
            end[:, rows] if end.shape[1] > 1 else end for end in (*self.sizes, *self.q)
        )
        q = a + (b - a) * t + 4.0 * self.bend * t * (1.0 - t)
        return one + (other - one) * t, q


def tracked(kernel: PathKernel, way: HomotopyPath, start: Array) -> tuple[Array, Bools]:
    """Return the solutions (variables, n) at the ends of ways, and which arrived (n,)."""
    n = start.shape[1]
    now = start.astype(complex)
    moved = np.zeros_like(now)
    t, step, last = np.zeros(n), np.full(n, FIRST), np.full(n, np.inf)
    active = np.flatnonzero(all_finite(now, 0))
    with np.errstate(all="ignore"):
        for _ in range(MOST):
            if not len(active):
                break
            there = np.minimum(t[active] + step[active], 1.0)
            sizes, q = way.at(active, there)
            prepared = kernel.prepare(np.ascontiguousarray(sizes))
            ahead = (there - t[active]) / last[active]
            values = now[:, active] + moved[:, active] * ahead
            values[kernel.driven] = q
            made, first, second = corrected(kernel, values, prepared)
            good = (first < NEAR) & (second <= CONTRACTS * first + CONVERGED)
            onward = active[good]
            moved[:, onward] = made[:, good] - now[:, onward]
            now[:, onward] = made[:, good]
            last[onward] = there[good] - t[onward]
            t[onward] = there[good]
            eager = good & (second < 0.1 * CONTRACTS * first)
            step[active[eager]] *= 2.0
            step[active[~good]] *= 0.5
            active = active[(t[active] < 1.0) & (step[active] > LEAST)]
    arrived = t >= 1.0
    rows = np.flatnonzero(arrived)
    sizes, q = way.at(rows, np.ones(len(rows)))
    prepared = kernel.prepare(np.ascontiguousarray(sizes))
    now[:, rows], closed = settled(kernel, now[:, rows], prepared)
    arrived[rows] &= closed
    return now, arrived


def corrected(
    kernel: PathKernel, values: Array, prepared: Floats
) -> tuple[Array, Floats, Floats]:
    """Return values after two of Newton's steps, and the lengths (n,) of both."""
    first = kernel.at(values, prepared).step
    values = values + first
    second = kernel.at(values, prepared).step
    return values + second, _length(first), _length(second)


def settled(kernel: PathKernel, values: Array, prepared: Floats) -> tuple[Array, Bools]:
    """Return values after Newton's last steps, and whether loops close there."""
    made = values.copy()
    closed = np.zeros(values.shape[1], dtype=bool)
    left = np.arange(values.shape[1])
    with np.errstate(all="ignore"):
        for _ in range(POLISHING):
            at = kernel.at(made[:, left], np.ascontiguousarray(prepared[:, left]))
            made[:, left] += at.step
            imaginary = np.abs(made[:, left].imag)
            # Sines of complex angles grow, and with them the rounding of what they give.
            far = np.max(imaginary, axis=0, initial=0.0)
            reach = np.exp(2.0 * far)
            done = (_length(at.step) < CONVERGED * reach) & (far < FARTHEST)
            closed[left] = done & (np.abs(at.open) < (CLOSED * reach) ** 2)
            left = left[~closed[left]]
            if not len(left):
                break
    return made, closed


def _length(step: Array) -> Floats:
    return np.asarray(max_abs(step, axis=0, initial=0.0))


def apart(one: Array, other: Array) -> Floats:
    """Return by how much solutions (variables, ...) differ, whole turns left out."""
    gap = one - other
    turned = gap.real - 2.0 * np.pi * np.round(gap.real / (2.0 * np.pi))
    return np.max(np.hypot(turned, gap.imag), axis=0)


def distinct(values: Array) -> Bools:
    """Return for each design whether its solutions (variables, designs, m) all differ."""
    m = values.shape[2]
    made: Bools = all_finite(values, (0, 2))
    if m < 2:
        return made
    weights = np.random.default_rng(3).uniform(0.5, 1.5, (3, len(values), 1, 1))
    with np.errstate(all="ignore"):
        angle = values.real
        key = np.sum(weights[0] * np.cos(angle) + weights[1] * np.sin(angle), axis=0)
        key = np.sort(key + np.sum(weights[2] * np.tanh(values.imag), axis=0), axis=1)
        near = np.min(np.diff(key, axis=1), axis=1) < 6.0 * len(values) * SAME
    for k in np.flatnonzero(made & near):
        solutions = values[:, k]
        gaps = apart(solutions[:, :, None], solutions[:, None, :])
        made[k] = np.min(gaps[np.triu_indices(m, 1)]) > SAME
    return made
