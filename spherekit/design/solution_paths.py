"""Solutions of the closure equations followed from design to design, off the real axis.

Where the inputs leave the real axis, solutions neither meet nor vanish on the way, so all
of one design lead to all of another (coefficient-parameter continuation; Sommese and
Wampler, The Numerical Solution of Systems of Polynomials, 2005, chapter 7).
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.path_kernel import Numbers, PathKernel
from spherekit.sphere.rotation import Floats

Flags = NDArray[np.bool_]

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


@final
@dataclass(frozen=True)
class Way:
    """Ways of n rows in sizes and inputs: straight, and bent off the real axis between.

    `sizes` (k, n) and `q` (inputs, n) at both ends; `bend` (inputs, 1) is how far off the
    inputs are halfway.
    """

    sizes: tuple[Floats, Floats]
    q: tuple[Numbers, Numbers]
    bend: Numbers | float = 0.0

    def at(self, rows: NDArray[np.intp], t: Floats) -> tuple[Floats, Numbers]:
        """Return sizes (k, m) and inputs (inputs, m) of rows, parts t (m,) of ways on."""
        one, other = (sizes[:, rows] for sizes in self.sizes)
        a, b = (inputs[:, rows] for inputs in self.q)
        q = a + (b - a) * t + 4.0 * self.bend * t * (1.0 - t)
        return one + (other - one) * t, q


def tracked(kernel: PathKernel, way: Way, start: Numbers) -> tuple[Numbers, Flags]:
    """Return the solutions (variables, n) at the ends of ways, and which arrived (n,)."""
    n = start.shape[1]
    now = start.astype(complex)
    moved = np.zeros_like(now)
    t, step, last = np.zeros(n), np.full(n, FIRST), np.full(n, np.inf)
    active = np.flatnonzero(np.all(np.isfinite(now), axis=0))
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
    kernel: PathKernel, values: Numbers, prepared: Floats
) -> tuple[Numbers, Floats, Floats]:
    """Return values after two of Newton's steps, and the lengths (n,) of both."""
    first = kernel.at(values, prepared).step
    values = values + first
    second = kernel.at(values, prepared).step
    return values + second, _length(first), _length(second)


def settled(kernel: PathKernel, values: Numbers, prepared: Floats) -> tuple[Numbers, Flags]:
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


def _length(step: Numbers) -> Floats:
    return np.asarray(np.max(np.abs(step), axis=0, initial=0.0))


def apart(one: Numbers, other: Numbers) -> Floats:
    """Return by how much solutions (variables, ...) differ, whole turns left out."""
    gap = one - other
    turned = gap.real - 2.0 * np.pi * np.round(gap.real / (2.0 * np.pi))
    return np.asarray(np.max(np.hypot(turned, gap.imag), axis=0))


def distinct(values: Numbers) -> Flags:
    """Return for each design whether its solutions (variables, designs, m) all differ."""
    m = values.shape[2]
    made: Flags = np.all(np.isfinite(values), axis=(0, 2))
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
