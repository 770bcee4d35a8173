"""The equations for real angles as sums of products of powers of e^(i angle).

Each equation is a polynomial of known degree in the cosine and sine of each angle, so that
its values at evenly spaced angles, in balls, give its coefficients, here those of powers of
e^(i angle). With these, float64 values and derivatives take few products, and what they are
off by is known: rounding, and what sizes leave open, by the interpolation's norm (Ehlich
and Zeller 1966) and Bernstein's inequality for the derivatives.
"""

from collections.abc import Callable, Sequence
from functools import cache
from math import prod

import numpy as np

from spherekit.arrays import Array, Complexes, Floats, Indices
from spherekit.proof.ball_frames import exact
from spherekit.proof.balls import UNIT, Ball, library, middles, pi, upper

Values = Callable[[Sequence[Ball]], Array]
"""Equations at angles (rad) of all variables."""


class Harmonics:
    """Equations at real angles by their coefficients: values and derivatives in float64.

    Derivatives are off by at most `error` (k,) times products of degrees.
    """

    def __init__(self, degrees: Indices, values: Values) -> None:
        self.degrees, self.waves = degrees, int(np.max(degrees, initial=1))
        at = cache(lambda place: values([2 * pi() * part / of for part, of in place]))
        made = [
            _coefficients(row, k, at) for k, row in enumerate((2 * degrees + 1).tolist())
        ]
        self.coefficients = [coefficients for coefficients, _ in made]
        self.error = np.array([error for _, error in made])

    def derivatives(self, turns: Floats, order: int) -> list[Floats]:
        """Return values (n, k), slopes (n, k, v) and, of order 2, curvatures (n, k, v, v).

        They are at cosines and sines (n, v, 2).
        """
        n, v, _ = turns.shape
        out = [np.zeros((n, len(self.error), *[v] * power)) for power in range(order + 1)]
        waves = _waves(turns, self.waves, order)
        for k, left in enumerate(self.coefficients):
            variables = np.flatnonzero(self.degrees[k])
            parts = _summed(np.squeeze(left), waves[variables]).real
            once = (order + 1) ** np.arange(len(variables))
            out[0][:, k], out[1][:, k, variables] = parts[0], parts[once].T
            if order > 1:
                out[2][:, k, variables[:, None], variables] = parts[once[:, None] + once].T
        return out

    def powers(
        self, k: int, unknowns: Sequence[int], given: Array
    ) -> tuple[Complexes, Complexes]:
        """Return equation k as a polynomial in e^(i angle) of angles, the others given.

        Coefficients (n, sizes) of the powers from the lowest on, and their derivatives
        (n, given, sizes) by all others, in order, at cosines and sines (n, given, 2).
        """
        others = [j for j in range(self.degrees.shape[1]) if j not in unknowns]
        left = self.coefficients[k].transpose([*unknowns, *others])
        parts = _summed(left, _waves(given, self.waves, 1))
        made = np.moveaxis(np.broadcast_to(parts, (*parts.shape[:-1], len(given))), -1, 0)
        return made[:, 0], made[:, 2 ** np.arange(len(others))]


def _summed(left: Complexes, waves: Complexes) -> Complexes:
    """Return sums (parts, ..., n) over the last axes of coefficients with waves of each.

    Part a + b r + ..., of r orders, has the derivative a by the first, b by the next.
    """
    parts: Complexes = left[None, ..., None]
    for wave in waves[::-1]:
        beyond = (wave.shape[1] - parts.shape[-2]) // 2
        wave = wave[:, beyond : wave.shape[1] - beyond]
        parts = np.einsum("p...wn,own->po...n", parts, wave)
        parts = parts.reshape(-1, *parts.shape[2:])
    return parts


def _waves(turns: Floats, most: int, order: int) -> Complexes:
    """Return e^(i k x), k = -most to most, and derivatives (v, order + 1, waves, n) by x.

    `turns` (n, v, 2) are cosines and sines.
    """
    z = (turns[..., 0] + 1j * turns[..., 1]).T
    up = [z]
    while len(up) < most:
        up.append(up[-1] * z)
    waves = np.array([*(wave.conj() for wave in up[::-1]), np.ones(z.shape), *up])
    factors = np.vander(1j * np.arange(-len(up), len(up) + 1), order + 1, increasing=True)
    return waves.swapaxes(0, 1)[:, None] * factors.T[..., None]


def _coefficients(
    sides: Sequence[int], k: int, at: Callable[..., Array]
) -> tuple[Complexes, float]:
    """Return the coefficients of equation k, an axis of each variable, of so many waves.

    `at` has the values of all equations in balls where each angle is so many parts of so
    many of a turn. Float64 values of this one are off by at most the second number.
    """
    balls = np.empty(sides, dtype=object)
    for place in np.ndindex(*sides):
        balls[place] = at(tuple(zip(place, sides, strict=True)))[k]
    sums = middles(balls)
    open_ = max(map(upper, (balls - sums).flat))
    for axis, side in enumerate(sides):
        # rows are those of the waves 0 to m, -m to -1
        rows = np.array(library().acb_mat.dft(side).tolist()) / exact(side).sqrt()
        waves = np.roll(rows, side // 2, axis=0)
        sums = np.moveaxis(np.tensordot(waves, sums, (1, axis)), 0, axis)
    coefficients = sums.astype(complex)
    missed = sum(map(upper, (sums - coefficients).flat))
    steps = sum(side + 2 + 8 * (side // 2) for side in sides if side > 1)
    rounded = 2.0 * steps * UNIT * np.sum(np.abs(coefficients))
    return coefficients, 1.001 * (open_ * prod(map(_norm, sides)) + missed) + rounded


def _norm(nodes: int) -> float:
    """Return the norm of interpolation at an odd number of evenly spaced angles."""
    halves = (2 * np.arange(nodes) + 1) * np.pi / (2 * nodes)
    return np.sum(1.0 / np.abs(np.sin(halves))) / nodes * (1 + 1e-9)
