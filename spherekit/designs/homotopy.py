"""Closed configurations followed from design to design and through inputs.

Off the real axis of the inputs solutions of the closure equations neither meet nor vanish,
so all of one design lead to all of another (coefficient-parameter continuation; Sommese and
Wampler, The Numerical Solution of Systems of Polynomials, 2005, chapter 7). Real ones are
followed in steps that do not leap to another assembly mode, as far as there are some.

All solutions of one design, complex ones included, are those of elimination.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import prod

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.designs.path_kernel import NewtonStep, PathKernel
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.numerics.angles import wrap
from spherekit.positions.elimination_order import find_elimination_orders, has_elimination
from spherekit.positions.mode_coalescence import ModeCoalescence
from spherekit.positions.position_solver import PositionSolver

SOON = 2.0**-8
"""Part of a way at which it is looked at first, for its direction."""
LEAST = 2.0**-20
MOST = 600
"""The least step, as a part of a way, and most of them."""
NEAR = 0.3
"""Most (rad) by which a prediction may be off, off the real axis."""
CONTRACTS = 0.2
"""Newton's second step is at most this part of the first there."""
SHORT = 0.125
LONG = 0.03125
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

Equations = Callable[[Array, Indices], NewtonStep]
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

        def equations(values: Array, some: Indices) -> NewtonStep:
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
        first_step, determinant, _ = equations(soon, every)
        slopes[:, :, rows] = (soon + first_step - start[:, rows]) / SOON
        side[rows] = np.sign(determinant.real)
        for _ in range(MOST):
            if not len(rows):
                break
            there = np.minimum(places[2, rows] + step[rows], 1.0)
            guess = _foreseen(places[:, rows], now[:, rows], slopes[:, :, rows], there)
            guess[driven], equations = at(rows, there)
            every = np.arange(len(rows))
            made = guess + equations(guess, every)[0]
            further, determinant, _ = equations(made, every)
            first, second = max_abs(made - guess, 0), max_abs(further, 0)
            good = (first < NEAR) & (second <= np.maximum(contracts * first, STILL))
            if real:
                foreseen = max_abs(guess - now[:, rows], 0)
                good &= first <= np.maximum(contracts * foreseen, NEARLY)
                good &= np.sign(determinant) == side[rows]
            onward, ahead = rows[good], (made + further)[:, good]
            slopes[0][:, onward] = slopes[1][:, onward]
            slopes[1][:, onward] = (ahead - now[:, onward]) / (
                there[good] - places[2, onward]
            )
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
    closed = np.zeros(values.shape[1], bool)
    left = np.arange(values.shape[1])
    with np.errstate(all="ignore"):
        for _ in range(POLISHING):
            moved, _, opened = equations(made[:, left], left)
            made[:, left] += moved
            # Sines of complex angles grow, and with them the rounding of what they give.
            far = max_abs(made[:, left].imag, 0)
            reach = np.exp(2.0 * far)
            done = (max_abs(moved, 0) < CONVERGED * reach) & (far < FARTHEST)
            closed[left] = done & (np.abs(opened) < (CLOSED * reach) ** 2)
            left = np.flatnonzero(~closed)
            if not len(left):
                break
    return made, closed


def apart(one: Array, other: Array) -> Floats:
    """Return by how much solutions (variables, ...) differ, whole turns left out."""
    gap = one - other
    return np.max(np.hypot(wrap(gap.real), gap.imag), axis=0)


def distinct(values: Array) -> Bools:
    """Return for each design whether its solutions (variables, designs, m) all differ."""
    made: Bools = all_finite(values, (0, 2))
    one, other = np.triu_indices(values.shape[2], 1)
    for k in np.flatnonzero(made):
        gaps = apart(values[:, k, one], values[:, k, other])
        made[k] = np.min(gaps, initial=np.inf) > SAME
    return made


MOST_SOLUTIONS = 64
"""Complex solutions up to which all of them are followed."""


@dataclass(frozen=True)
class StartSolutions:
    """The solutions (variables, m) of a design with `sizes` (k,) at complex inputs q.

    `counted` says whether all that designs in general have are there.
    """

    values: Array
    sizes: Floats
    q: Array
    counted: bool


def start_set(kernel: PathKernel, sizes: Floats) -> StartSolutions | None:
    """Return all solutions of the mechanism of a file; None if they are not known.

    `sizes` are its numbers that `kernel` has as inputs. Elimination gives the solutions at
    some inputs, from where these leave the real axis.
    """
    structure = kernel.terms.structure
    mechanism = structure.mechanism
    groups = structure.assembly.groups
    if not all(group.is_dyad or has_elimination(group) for group in groups):
        return None
    roots = prod(find_elimination_orders(group)[0].root_count for group in groups)
    if roots > MOST_SOLUTIONS:
        return None
    moving = mechanism.with_inputs(*mechanism.names_of(structure.assembly.inputs))
    solver = PositionSolver(moving, structure.assembly)
    inputs = mechanism.with_inputs(*mechanism.names_of(structure.input_pairs)).inputs
    ends = np.array([(item.start, item.stop) for item in inputs])
    there = np.mean(ends, axis=1)[:, None] + 0.7j
    here = np.random.default_rng(20).uniform(*np.sort(ends, axis=1).T)[:, None]
    # Newton's first step takes pairs that follow the inputs to their places.
    start = np.zeros((kernel.variables, 1))
    column = sizes[:, None]
    start[kernel.driven] = here
    with np.errstate(all="ignore"):
        step = kernel.at(start, kernel.prepare(column))[0]
    following = [v for v in solver.driven if v not in kernel.driven]
    start[following] += step[following]
    driven = start[list(solver.driven)]
    values = ModeCoalescence(solver).configurations(driven[:, 0]).T
    values = values[:, all_finite(values, 0)]
    values[list(solver.driven)] = driven
    values, arrived = tracked(kernel, values, (column, column), (here, there))
    values = values[:, arrived]
    count = values.shape[1]
    if not count or not distinct(values[:, None])[0]:
        return None
    return StartSolutions(values, sizes, there[:, 0], count == roots)
