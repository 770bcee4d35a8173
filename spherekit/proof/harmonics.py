"""The equations for real angles as sums of products of cosines and sines of multiples.

Each equation is a polynomial of known degree in the cosine and sine of each angle, so that
its values at evenly spaced angles, in balls, give its coefficients. With these, float64
values and derivatives take few products, and what they are off by is known: rounding, and
what sizes leave open, by the interpolation's norm (Ehlich and Zeller 1966) and Bernstein's
inequality for the derivatives.
"""

from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from math import prod
from typing import Any

import numpy as np

from spherekit.arrays import Array, Complexes, Floats, Indices
from spherekit.proof.balls import UNIT, Ball, exact, exactly, floats, middles, pi, upper

CHUNK = 2000
"""Configurations at once, so that the sums stay in the processor's cache."""
Values = Callable[[Sequence[Ball]], list[Ball]]
"""Equations at angles (rad) of all variables."""


class Harmonics:
    """Equations at real angles by their coefficients: values and derivatives in float64.

    Derivatives are off by at most `error` (k,) times products of degrees.
    """

    def __init__(self, degrees: Indices, values: Values) -> None:
        self.count, self.variables = degrees.shape
        self.waves = int(np.max(degrees, initial=1))
        at = cache(lambda place: values([2 * pi() * part / of for part, of in place]))
        self.terms = [_Term(row, k, at) for k, row in enumerate(degrees)]
        self.error = np.array([term.error for term in self.terms])

    def first(self, turns: Floats) -> tuple[Floats, Floats]:
        """Return values (n, k) and slopes (n, k, v) at cosines and sines (n, v, 2)."""
        values = np.zeros((len(turns), self.count))
        slopes = np.zeros((len(turns), self.count, self.variables))
        for start in range(0, len(turns), CHUNK):
            rows = slice(start, start + CHUNK)
            waves = _waves(np.moveaxis(turns[rows], 0, -1), self.waves, 1)
            for k, term in enumerate(self.terms):
                values[rows, k], by_variable = term.first(waves)
                for variable, slope in by_variable.items():
                    slopes[rows, k, variable] = slope
        return values, slopes

    def second(self, turns: Floats) -> tuple[Floats, Floats, Floats]:
        """Return values (k,), slopes (k, v), curvatures (k, v, v) at turns (v, 2)."""
        waves = _waves(turns, self.waves, 2)
        values = np.zeros(self.count)
        slopes = np.zeros((self.count, self.variables))
        curvatures = np.zeros((self.count, self.variables, self.variables))
        for k, term in enumerate(self.terms):
            derivatives = term.second(waves)
            values[k] = derivatives[0]
            slopes[k, term.variables] = derivatives[term.single]
            curvatures[k][term.block] = derivatives[term.double]
        return values, slopes, curvatures

    def powers(
        self, k: int, unknowns: Sequence[int], given: Array
    ) -> tuple[Complexes, Complexes]:
        """Return equation k as a polynomial in e^(i angle) of angles, the others given.

        Coefficients (n, sizes) of the powers from the lowest on, and their derivatives
        (n, given, sizes) by all others, in order, at cosines and sines (n, given, 2).
        """
        others = [j for j in range(self.variables) if j not in unknowns]
        waves = _waves(np.moveaxis(given, 0, -1), self.waves, 1)
        sides = [2 * degree + 1 for degree in self.terms[k].degrees]
        left: Array = self.terms[k].coefficients.reshape(sides)
        left = left.transpose([*others, *unknowns])
        for _ in unknowns:
            left = np.tensordot(left, _to_powers(left.shape[len(others)]), (len(others), 1))
        made = []
        for moved in (None, *others):
            part: Array = np.broadcast_to(left, (len(given), *left.shape))
            for wave, j in zip(waves, others, strict=True):
                part = np.einsum("nw...,wn->n...", part, wave[int(j == moved), : sides[j]])
            made.append(part)
        return made[0], np.stack(made[1:], axis=1)


def _to_powers(side: int) -> Complexes:
    """Return what takes factors of 1, cos x, sin x, ... to those of powers of e^(i x)."""
    out, half = np.zeros((side, side), dtype=complex), side // 2
    out[half, 0] = 1.0
    for wave in range(1, half + 1):
        out[[half - wave, half + wave], 2 * wave - 1] = 0.5
        out[[half - wave, half + wave], 2 * wave] = 0.5j, -0.5j
    return out


def _waves(turns: Floats, most: int, order: int) -> Floats:
    """Return 1, cos x, sin x, cos 2x, ... and derivatives (v, order + 1, 2 most + 1, ...).

    `turns` (v, 2, ...) are cosines and sines.
    """
    cosine, sine = turns[:, 0], turns[:, 1]
    shape = len(turns), order + 1, 2 * most + 1, *turns.shape[2:]
    out = np.zeros(shape, dtype=turns.dtype)
    out[:, 0, 0] = 1.0
    c, s = cosine, sine
    for wave in range(1, most + 1):
        if wave > 1:
            c, s = c * cosine - s * sine, s * cosine + c * sine
        out[:, 0, 2 * wave - 1], out[:, 0, 2 * wave] = c, s
        for k in range(order):
            out[:, k + 1, 2 * wave - 1] = -wave * out[:, k, 2 * wave]
            out[:, k + 1, 2 * wave] = wave * out[:, k, 2 * wave - 1]
    return out


class _Term:
    """One equation: its variables and the coefficients, an axis of each variable.

    `at` has the values of all equations in balls where each angle is so many parts of so
    many of a turn. Float64 values of this one, number k, are off by at most `error`.
    """

    def __init__(self, degrees: Indices, k: int, at: Callable[..., list[Ball]]) -> None:
        self.degrees = degrees.tolist()
        self.variables = [j for j, degree in enumerate(self.degrees) if degree]
        sides = [2 * degree + 1 for degree in self.degrees]
        self.shape = [sides[j] for j in self.variables]
        places = 3 ** np.arange(len(self.shape) - 1, -1, -1, dtype=np.intp)
        self.single, self.double = places, places[:, None] + places
        self.block = np.ix_(self.variables, self.variables)
        balls = [
            at(tuple(zip(place, sides, strict=True)))[k]
            for place in product(*map(range, sides))
        ]
        sums = middles(np.array(balls, dtype=object))
        open_ = max(map(upper, balls - sums))
        sums = sums.reshape(self.shape)
        for axis, side in enumerate(self.shape):
            sums = np.moveaxis(np.tensordot(_transform(side), sums, (1, axis)), 0, axis)
        self.coefficients = floats(sums)
        missed = sum(map(upper, (sums - exactly(self.coefficients)).ravel()))
        size = float(np.sum(np.abs(self.coefficients)))
        steps = sum(side + 2 + 8 * (side // 2) for side in self.shape)
        norm = prod(_norm(side) for side in sides)
        self.error = 1.001 * (open_ * norm + missed) + 2.0 * steps * UNIT * size

    def first(self, waves: Floats) -> tuple[Floats, dict[int, Floats]]:
        """Return values (n,) and slopes (n,) by variable, of waves (v, 2, w, n)."""
        *before, last = self.variables
        flat = self.coefficients.reshape(-1, self.shape[-1])
        value = flat @ waves[last, 0, : self.shape[-1]]
        slopes = {last: flat @ waves[last, 1, : self.shape[-1]]}
        for variable, side in zip(before[::-1], self.shape[-2::-1], strict=True):
            plain, turned = waves[variable, 0, :side], waves[variable, 1, :side]
            slopes = {j: _summed(part, plain) for j, part in slopes.items()}
            slopes[variable] = _summed(value, turned, True)
            value = _summed(value, plain)
        return value[0], {j: slope[0] for j, slope in slopes.items()}

    def second(self, waves: Floats) -> Floats:
        """Return all derivatives up to the second by each variable, of waves (v, 3, w)."""
        left = self.coefficients
        for variable, side in zip(self.variables, self.shape, strict=True):
            left = left.reshape(side, -1).T @ waves[variable, :, :side].T
        return left.ravel()


def _summed(parts: Floats, waves: Floats, derived: bool = False) -> Floats:
    """Return sums over the last axis but one, that of waves (w, n).

    The first wave is 1, and that of derivatives 0.
    """
    split = parts.reshape(-1, *waves.shape)
    total = split[:, 1] * waves[1]
    if not derived:
        total += split[:, 0]
    for wave in range(2, len(waves)):
        total += split[:, wave] * waves[wave]
    return total


def _norm(nodes: int) -> float:
    """Return the norm of interpolation at an odd number of evenly spaced angles."""
    halves = (2 * np.arange(nodes) + 1) * np.pi / (2 * nodes)
    return float(np.sum(1.0 / np.abs(np.sin(halves))) / nodes) * (1 + 1e-9)


def _transform(nodes: int) -> Any:
    """Return what takes values at evenly spaced angles to coefficients (nodes, nodes)."""
    rows = [[exact(1.0) / nodes] * nodes]
    for wave in range(1, nodes // 2 + 1):
        angles = [2 * pi() * (wave * part % nodes) / nodes for part in range(nodes)]
        rows.append([2 * angle.cos() / nodes for angle in angles])
        rows.append([2 * angle.sin() / nodes for angle in angles])
    return np.array(rows, dtype=object)
