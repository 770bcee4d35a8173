"""Closed configurations followed from design to design and through inputs.

Off the real axis of the inputs solutions of the closure equations neither meet nor vanish,
so all of one design lead to all of another (coefficient-parameter continuation; Sommese and
Wampler, The Numerical Solution of Systems of Polynomials, 2005, chapter 7). Real ones are
followed in steps that do not leap to another assembly mode, as far as there are some.

All solutions of one design, complex ones included, are found from those that are known, by
loops in the space of designs and complex inputs: where a loop comes back, each solution has
become one of the design's (monodromy; chapter 7 there). Loops go on until none brings a new
one; where elimination knows how many there are, until all are there.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.engine.design_kernel import At, PathKernel
from spherekit.engine.row_quantities import VariedTerms
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.elimination import assemblies
from spherekit.numeric.crossings import wrap
from spherekit.sphere.rotation import all_finite, max_abs

SOON = 2.0**-8
"""Part of a way at which it is looked at first, for its direction."""
LEAST, MOST = 2.0**-20, 600
"""The least step, as a part of a way, and most of them."""
NEAR = 0.3
"""Most (rad) by which a prediction may be off, off the real axis."""
CONTRACTS = 0.2
"""Newton's second step is at most this part of the first there."""
SHORT, LONG = 0.125, 0.03125
"""Newton's steps on the real axis are at most this part of the one before, the first of
how far a configuration is foreseen (Kantorovich 1948): on ways of small deviations, on
others."""
EAGER = 0.1
"""Where they shrink by this part of that, the next step along the way is twice as long."""
STILL = 1e-9
"""Steps (rad) so short do not leap."""
NEARLY = 1e-6
"""Configurations on the way may be off by less (rad)."""
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

Profiles = Callable[[Floats, Indices, Floats], Floats]
"""Columns (w, k) of profiles at variables (v, k) of rows (k,) at parts (k,) of their ways.

NaN where there is no design."""

Equations = Callable[[Array, Indices], At]
"""The closure equations at variables (v, m) of rows (m,)."""

HELD = np.zeros((0, 1)), np.zeros((0, 1))
"""Inputs that kernels hold, at both ends."""


def tracked(
    kernel: PathKernel,
    start: Array,
    sizes: tuple[Floats, Floats],
    q: tuple[Array, Array] = HELD,
    bend: Array | float = 0.0,
    profiles: Profiles | None = None,
    contracts: float = CONTRACTS,
) -> tuple[Array, Bools]:
    """Return the solutions (variables, n) at the ends of ways, and which arrived (n,).

    Ways are straight in sizes and inputs, but for a bend off the real axis.

    Parameters
    ----------
    kernel
        Newton's step of the topology.
    start
        (variables, n) solutions where ways begin. Real ones keep the sign of the
        equations' determinant.
    sizes, q
        (k, n) and (inputs, n) at both ends, or (k, 1) and (inputs, 1) of all.
    bend
        (inputs, 1) how far off the inputs are halfway.
    profiles
        The columns of profiles, where some are handed in.
    contracts
        By what part Newton's steps shrink.
    """
    n, real = start.shape[1], not np.iscomplexobj(start)

    def at(rows: Indices, t: Floats) -> tuple[Array, Equations]:
        one, other, a, b = (
            end[:, rows] if end.shape[1] > 1 else end for end in (*sizes, *q)
        )
        prepared = kernel.prepare(one + (other - one) * t)

        def equations(values: Array, some: Indices) -> At:
            rest = prepared[:, some]
            if profiles is not None:
                rest = np.concatenate([profiles(values, rows[some], t[some]), rest])
            return kernel.at(values, rest)

        return a + (b - a) * t + 4.0 * bend * t * (1.0 - t), equations

    now, step, places = start.copy(), np.ones(n), np.zeros((3, n))
    places[0], slopes, side = -1.0, np.zeros((2, *start.shape), start.dtype), np.zeros(n)
    rows = np.flatnonzero(all_finite(start, 0))
    with np.errstate(all="ignore"):
        soon = start[:, rows]
        driven, every = kernel.driven[: len(q[0])], np.arange(len(rows))
        soon[driven], equations = at(rows, np.full(len(rows), SOON))
        begun = equations(soon, every)
        slopes[:, :, rows] = (soon + begun.step - start[:, rows]) / SOON
        side[rows] = np.sign(begun.determinant.real)
        for _ in range(MOST):
            if not len(rows):
                break
            there = np.minimum(places[2, rows] + step[rows], 1.0)
            guess = _foreseen(places[:, rows], now[:, rows], slopes[:, :, rows], there)
            guess[driven], equations = at(rows, there)
            every = np.arange(len(rows))
            made = guess + equations(guess, every).step
            after = equations(made, every)
            first, second = _length(made - guess), _length(after.step)
            good = (first < NEAR) & (second <= np.maximum(contracts * first, STILL))
            if real:
                foreseen = _length(guess - now[:, rows])
                good &= first <= np.maximum(contracts * foreseen, NEARLY)
                good &= np.sign(after.determinant) == side[rows]
            onward, ahead = rows[good], (made + after.step)[:, good]
            slopes[0][:, onward] = slopes[1][:, onward]
            gone = there[good] - places[2, onward]
            slopes[1][:, onward] = (ahead - now[:, onward]) / gone
            now[:, onward] = ahead
            places[:, onward] = *places[1:, onward], there[good]
            step[rows[good & (second < EAGER * contracts * first)]] *= 2.0
            step[rows[~good]] *= 0.5
            rows = rows[(places[2, rows] < 1.0) & (step[rows] > LEAST)]
        arrived = places[2] >= 1.0
        rows = np.flatnonzero(arrived)
        _, equations = at(rows, np.ones(len(rows)))
        now[:, rows], arrived[rows] = settled(equations, now[:, rows])
    return now, arrived


def _foreseen(places: Floats, now: Array, slopes: Array, there: Floats) -> Array:
    """Return the parabola through the last three places (3, m), further on.

    From the last values (v, m) and the slopes (2, v, m) between.
    """
    bend = (slopes[1] - slopes[0]) / (places[2] - places[0])
    return now + (there - places[2]) * (slopes[1] + (there - places[1]) * bend)


def settled(equations: Equations, values: Array) -> tuple[Array, Bools]:
    """Return values after Newton's last steps, and whether loops close there."""
    made = values.copy()
    closed = np.zeros(values.shape[1], dtype=bool)
    left = np.arange(values.shape[1])
    with np.errstate(all="ignore"):
        for _ in range(POLISHING):
            at = equations(made[:, left], left)
            made[:, left] += at.step
            # Sines of complex angles grow, and with them the rounding of what they give.
            far = _length(made[:, left].imag)
            reach = np.exp(2.0 * far)
            done = (_length(at.step) < CONVERGED * reach) & (far < FARTHEST)
            closed[left] = done & (np.abs(at.open) < (CLOSED * reach) ** 2)
            left = left[~closed[left]]
            if not len(left):
                break
    return made, closed


def _length(step: Array) -> Floats:
    return max_abs(step, axis=0)


def apart(one: Array, other: Array) -> Floats:
    """Return by how much solutions (variables, ...) differ, whole turns left out."""
    gap = one - other
    return np.max(np.hypot(wrap(gap.real), gap.imag), axis=0)


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
    general = PathKernel(terms, compiled=False)
    rng = np.random.default_rng(20)
    low, high = np.sort([(i.start, i.stop) for i in inputs], axis=1).T
    places = rng.uniform(low, high, (SEEDED, len(inputs)))
    seeds, roots = _seeds(terms, general, of_every, places)
    if not seeds.shape[1] or roots > MOST_SOLUTIONS:
        return None
    base = of_every + rng.uniform(-NEARBY, NEARBY, len(of_every))
    there, in_vain = q[:, None], 0
    seeded = _moved(general, seeds, (of_every, base), (seeds[general.driven], there))
    solutions = _distinct(seeded)
    for _ in range(ROUNDS):
        count = solutions.shape[1]
        if count == roots or (not roots and in_vain == IN_VAIN):
            break
        if count > MOST_SOLUTIONS:
            return None
        more = _around(general, solutions, base, q, rng)
        solutions = _distinct(np.concatenate([solutions, more], axis=1))
        in_vain = 0 if solutions.shape[1] > count else in_vain + 1
    count = solutions.shape[1]
    if not count or count != (roots or count):
        return None
    # Sizes that stay may be special ones, for which there are fewer.
    values = _distinct(_moved(general, solutions, (base, of_every), (there, there)))
    if not values.shape[1] or not distinct(values[:, None])[0]:
        return None
    at_rest = kernel.prepare(np.repeat(sizes[:, None], values.shape[1], axis=1))
    _, closed = settled(lambda now, some: kernel.at(now, at_rest[:, some]), values)
    counted = roots > 0 and values.shape[1] == count
    return StartSolutions(values, sizes, q, counted) if np.all(closed) else None


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
        configurations += [*here.values]
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
        now, reached = tracked(kernel, now, (one, other), (begin, end))
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
    ends = one[:, None], other[:, None]
    made, arrived = tracked(kernel, values.astype(complex), ends, q)
    return made[:, arrived]


def _distinct(solutions: Array) -> Array:
    """Return the first of solutions (variables, n) that are the same."""
    kept: list[Array] = []
    for solution in solutions.T:
        if not kept or np.min(apart(np.array(kept).T, solution[:, None])) > SAME:
            kept.append(solution)
    return np.array(kept).reshape(-1, len(solutions)).T
