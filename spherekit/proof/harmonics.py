"""The equations for real angles as sums of products of cosines and sines of multiples.

Each equation is a polynomial of known degree in the cosine and sine of each angle, so that
its values at evenly spaced angles, in balls, give its coefficients. With these, float64
values and derivatives take few products, and what they are off by is known: rounding, and
what sizes leave open, by the interpolation's norm (Ehlich and Zeller 1966) and Bernstein's
inequality for the derivatives.
"""

from collections.abc import Callable, Sequence
from functools import cache
from math import prod

import numpy as np

from spherekit.arrays import Array, Complexes, Floats, Indices
from spherekit.proof.balls import (
    UNIT,
    Ball,
    exact,
    exactly,
    floats,
    library,
    middles,
    pi,
    upper,
)

CHUNK = 2000
"""Configurations at once, so that the sums stay in the processor's cache."""
Values = Callable[[Sequence[Ball]], Array]
"""Equations at angles (rad) of all variables."""


class Harmonics:
    """Equations at real angles by their coefficients: values and derivatives in float64.

    Derivatives are off by at most `error` (k,) times products of degrees.
    """

    def __init__(self, degrees: Indices, values: Values) -> None:
        self.degrees, self.waves = degrees, int(np.max(degrees, initial=1))
        at = cache(lambda place: values([2 * pi() * part / of for part, of in place]))
        sides = (2 * degrees + 1).tolist()
        made = [_coefficients(row, k, at) for k, row in enumerate(sides)]
        self.coefficients = [coefficients for coefficients, _ in made]
        self.error = np.array([error for _, error in made])

    def first(self, turns: Floats) -> tuple[Floats, Floats]:
        """Return values (n, k) and slopes (n, k, v) at cosines and sines (n, v, 2)."""
        values = np.zeros((len(turns), len(self.degrees)))
        slopes = np.zeros((len(turns), *self.degrees.shape))
        for start in range(0, len(turns), CHUNK):
            rows = slice(start, start + CHUNK)
            waves = _waves(np.moveaxis(turns[rows], 0, -1), self.waves, 1)
            for k, coefficients in enumerate(self.coefficients):
                *before, last = variables = np.flatnonzero(self.degrees[k])
                left = np.squeeze(coefficients)
                parts = [left @ wave[: left.shape[-1]] for wave in waves[last]]
                for variable in before[::-1]:
                    plain, turned = waves[variable][:, : parts[0].shape[-2]]
                    more = _summed(parts[0], turned)
                    parts = [*(_summed(part, plain) for part in parts), more]
                values[rows, k] = parts[0]
                slopes[rows, k, variables[::-1]] = np.stack(parts[1:], axis=1)
        return values, slopes

    def second(self, turns: Floats) -> tuple[Floats, Floats, Floats]:
        """Return values (k,), slopes (k, v), curvatures (k, v, v) at turns (v, 2)."""
        waves = _waves(turns, self.waves, 2)
        rows = []
        for left in self.coefficients:
            # all derivatives up to the second by each variable
            for wave, side in zip(waves, left.shape, strict=True):
                left = left.reshape(side, -1).T @ wave[:, :side].T
            rows.append(left.ravel())
        once = 3 ** np.arange(len(turns))[::-1]
        every = np.array(rows)
        return every[:, 0], every[:, once], every[:, once[:, None] + once]

    def powers(
        self, k: int, unknowns: Sequence[int], given: Array
    ) -> tuple[Complexes, Complexes]:
        """Return equation k as a polynomial in e^(i angle) of angles, the others given.

        Coefficients (n, sizes) of the powers from the lowest on, and their derivatives
        (n, given, sizes) by all others, in order, at cosines and sines (n, given, 2).
        """
        left: Array = self.coefficients[k]
        others = [j for j in range(left.ndim) if j not in unknowns]
        waves = _waves(np.moveaxis(given, 0, -1), self.waves, 1)
        left = left.transpose([*others, *unknowns])
        for _ in unknowns:
            left = np.tensordot(left, _to_powers(left.shape[len(others)]), (len(others), 1))
        made = []
        for moved in (None, *range(len(others))):
            part: Array = np.broadcast_to(left, (len(given), *left.shape))
            for j, wave in enumerate(waves):
                part = np.einsum(
                    "nw...,wn->n...", part, wave[int(j == moved), : part.shape[1]]
                )
            made.append(part)
        return made[0], np.stack(made[1:], axis=1)


def _summed(parts: Floats, waves: Floats) -> Floats:
    """Return sums over the last axis but one, that of waves (w, n)."""
    return np.asarray(np.einsum("...wn,wn->...n", parts, waves))


def _to_powers(side: int) -> Complexes:
    """Return what takes factors of 1, cos x, sin x, ... to those of powers of e^(i x)."""
    out, half = np.zeros((side, side), dtype=complex), side // 2
    out[half, 0] = 1.0
    for wave in range(1, half + 1):
        rows = [half - wave, half + wave]
        out[rows, 2 * wave - 1], out[rows, 2 * wave] = 0.5, (0.5j, -0.5j)
    return out


def _waves(turns: Floats, most: int, order: int) -> Floats:
    """Return 1, cos x, sin x, cos 2x, ... and derivatives (v, order + 1, 2 most + 1, ...).

    `turns` (v, 2, ...) are cosines and sines.
    """
    z = power = turns[:, 0] + 1j * turns[:, 1]
    out = np.zeros((len(turns), order + 1, 2 * most + 1, *turns.shape[2:]))
    out[:, 0, 0] = 1.0
    for wave in range(1, most + 1):
        even, odd = 2 * wave - 1, 2 * wave
        out[:, 0, even], out[:, 0, odd] = power.real, power.imag
        for k in range(order):
            out[:, k + 1, even] = -wave * out[:, k, odd]
            out[:, k + 1, odd] = wave * out[:, k, even]
        power = power * z
    return out


def _coefficients(
    sides: Sequence[int], k: int, at: Callable[..., Array]
) -> tuple[Floats, float]:
    """Return the coefficients of equation k, an axis of each variable, of so many waves.

    `at` has the values of all equations in balls where each angle is so many parts of so
    many of a turn. Float64 values of this one are off by at most the second number.
    """
    places = np.ndindex(*sides)
    balls = np.array([at(tuple(zip(place, sides, strict=True)))[k] for place in places])
    sums = middles(balls)
    open_ = max(map(upper, balls - sums))
    sums = sums.reshape(sides)
    for axis, side in enumerate(sides):
        sums = np.moveaxis(np.tensordot(_transform(side), sums, (1, axis)), 0, axis)
    coefficients = floats(sums)
    missed = sum(map(upper, (sums - exactly(coefficients)).ravel()))
    steps = sum(side + 2 + 8 * (side // 2) for side in sides if side > 1)
    rounded = 2.0 * steps * UNIT * float(np.sum(np.abs(coefficients)))
    norm = prod(_norm(side) for side in sides)
    return coefficients, 1.001 * (open_ * norm + missed) + rounded


def _norm(nodes: int) -> float:
    """Return the norm of interpolation at an odd number of evenly spaced angles."""
    halves = (2 * np.arange(nodes) + 1) * np.pi / (2 * nodes)
    return float(np.sum(1.0 / np.abs(np.sin(halves))) / nodes) * (1 + 1e-9)


def _transform(nodes: int) -> Array:
    """Return what takes values at evenly spaced angles to coefficients (nodes, nodes)."""
    waves = np.array(library().acb_mat.dft(nodes).tolist()) / exact(nodes).sqrt()
    rows = [[z.real for z in waves[0]]]
    for row in waves[1 : nodes // 2 + 1]:
        rows += [[2 * z.real for z in row], [-2 * z.imag for z in row]]
    return np.array(rows)
