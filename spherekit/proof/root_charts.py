"""All complex roots over boxes of the inputs, in charts without infinity.

In z = e^(i angle) the equations are polynomials of degree 2 m in each unknown. Of z and
1 / z one is at most 1, so that a root at infinity is a root like others, and all bounds
are sums over coefficients. A root is proven for all inputs of a box at once: one and only
one in a tube about z0 + z' (q - q0). Of a system that is solved after others, their
angles are inputs too. Numbers may be infinite: callers let NumPy divide by zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.proof.tubes import ROUNDING, UP

OUTSIDE = 1.05
"""A point is moved to the other chart where its size is more."""
AROUND, CLOSE = 1.7, 50.0
"""Radius in which a root is shown alone, over how far it moves and how near it is."""
NEWTON_STEPS = 8
STILL = 1e-13


@dataclass(frozen=True)
class Polynomials:
    """Coefficients of a system at m inputs, and of their derivatives by the inputs.

    `values[i]` (m, 2 m_i1 + 1, ...) and `slopes[i]` (m, inputs, ...) have the coefficients
    of the powers of z, each off by at most `error[i]`. All derivatives of an equation by
    angles are at most `constant[i]` times products of `degrees` (k, variables), the
    unknowns first.
    """

    values: tuple[Complexes, ...]
    slopes: tuple[Complexes, ...]
    error: Floats
    constant: Floats
    degrees: Indices


@dataclass(frozen=True)
class ChartRoots:
    """Points (n, k): `z`, or where `inverse` says so 1 / z, of the inputs `row` (n,)."""

    z: Complexes
    inverse: Bools
    row: Indices

    @staticmethod
    def of(points: Complexes, row: Indices) -> "ChartRoots":
        """Return e^(i angle) (n, k), infinite ones too, in the chart where it is small."""
        inverse = ~(np.abs(points) <= 1.0)
        z = np.where(inverse, 1.0 / points, points)
        return ChartRoots(np.where(np.isfinite(points), z, 0.0), inverse, row)

    @property
    def points(self) -> Complexes:
        """e^(i angle) (n, k), infinite ones too."""
        return np.where(self.inverse, 1.0 / self.z, self.z)

    def gaps(self, count: int) -> Floats:
        """Return how far roots of each input are from each other (m, count, count).

        There are `count` of each input, one input after the other.
        """
        shape = -1, count, self.z.shape[1]
        over = np.where(self.inverse, 1.0, self.z).reshape(shape)
        way = over[:, :, None] * np.where(self.inverse, self.z, 1.0).reshape(shape)[:, None]
        return np.max(np.abs(way - way.swapaxes(1, 2)), axis=3, initial=0.0)

    def take(self, kept: Any) -> "ChartRoots":
        """Return some of them."""
        return ChartRoots(self.z[kept], self.inverse[kept], self.row[kept])

    def derivatives(self, arrays: Sequence[Complexes], order: int = 0) -> Complexes:
        """Return all derivatives by z of an order, of polynomials (m, ..., sizes) each.

        They are (n, polynomials, unknowns, ...), with as many axes of unknowns as the
        order.
        """
        n, count = self.z.shape
        made = []
        for series in arrays:
            for key in np.ndindex(*[count] * order):
                part = series[self.row]
                for column in reversed(range(count)):
                    powers = self._powers(column, part.shape[-1], key.count(column))
                    part = np.einsum("n...p,np->n...", part, powers)
                made.append(part)
        out = np.stack(made, axis=1)
        return out.reshape(n, len(arrays), *[count] * order, *out.shape[2:])

    def _powers(self, column: int, size: int, order: int) -> Complexes:
        """Return (n, size) the powers of z that belong to coefficients, or derivatives."""
        up = np.arange(size)
        exponents = np.where(self.inverse[:, column, None], up[::-1], up)
        factor = np.prod([exponents - step for step in range(order)], axis=0)
        return factor * self.z[:, column, None] ** np.maximum(exponents - order, 0)

    def moved(self, z: Complexes) -> "ChartRoots":
        """Return the same with other points, each in the better chart."""
        over = np.abs(z) > OUTSIDE
        return ChartRoots(np.where(over, 1.0 / z, z), self.inverse ^ over, self.row)


def values_at(
    made: Polynomials, roots: ChartRoots
) -> tuple[Complexes, Complexes, Complexes]:
    """Return P (n, k), its derivatives by z (n, k, k) and by the inputs (n, k, inputs)."""
    first = roots.derivatives(made.values, 1)
    return roots.derivatives(made.values), first, roots.derivatives(made.slopes)


def polished(made: Polynomials, roots: ChartRoots) -> tuple[ChartRoots, Bools]:
    """Return what Newton's method makes of points, and where it ends well."""
    good = np.ones(len(roots.z), dtype=bool)
    for _ in range(NEWTON_STEPS):
        values, first, _ = values_at(made, roots)
        change = applied(inverses(first), values)
        size = np.max(np.abs(change), axis=1, initial=0.0)
        good &= size < 1.0
        roots = roots.moved(np.where(good[:, None], roots.z - change, roots.z))
        if np.max(size[good], initial=0.0) < STILL:
            break
    return roots, good & (size < 1e-9)


def inverses(first: Complexes) -> Complexes:
    """Return inverses (n, k, k), NaN where there are none."""
    regular = np.all(np.isfinite(first), axis=(1, 2))
    regular &= np.abs(np.linalg.det(np.where(regular[:, None, None], first, 0))) > 0.0
    out = np.full_like(first, np.nan)
    out[regular] = np.linalg.inv(first[regular])
    return out


def applied(matrices: Array, vectors: Array) -> Array:
    """Return products (n, i) of matrices (n, i, j) and vectors (n, j)."""
    return np.matvec(matrices, vectors)


def _rounding(made: Polynomials, rows: Indices) -> Floats:
    """Return by how much values (n, k) are off by coefficients and sums of them."""
    sizes = [np.abs(array).reshape(len(array), -1) for array in made.values]
    count = [array.shape[1] for array in sizes]
    total = np.stack([np.sum(array, axis=1) for array in sizes], axis=1)
    return np.multiply(count, made.error + 4 * ROUNDING * total)[rows]


def _changes(
    made: Polynomials, roots: ChartRoots, wide: Floats, swing: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return by how much P (n, k) and P' (n, k, k) are off, and more within `wide` (n,).

    Last is by how much P' times a way may be off for what is given, which moves by at most
    `swing` (n, given). Derivatives of order three are at most the constant times powers of
    `steps`, and by what is given of `turned` (S. Bernstein).
    """
    count = roots.z.shape[1]
    steps, turned = 2.0 * made.degrees[:, :count], made.degrees[:, count:]
    reach = np.maximum(np.abs(roots.z) + wide[:, None], 1.0)
    growth = np.exp(np.log(reach) @ steps.T) * UP
    most, blur = made.constant * growth, growth * _rounding(made, roots.row)
    across, given = wide[:, None] * np.sum(steps, axis=1), swing @ turned.T
    way, least = across + given, np.maximum(steps, 1.0)
    mixed = np.einsum("nijg,ng->nij", np.abs(roots.derivatives(made.slopes, 1)), swing)
    bent = np.sum(np.abs(roots.derivatives(made.values, 2)), axis=3)
    more = bent * wide[:, None, None] + mixed
    more += (0.5 * most * way**2 + blur * way)[:, :, None] * least
    drift = np.sum(mixed, axis=2) * wide[:, None] + most * given * (given + across**2)
    return blur, more, 0.5 * drift + blur * (1.0 + way) * way


def tubes(
    made: Polynomials, roots: ChartRoots, half: Floats, moving: Floats, off: Floats
) -> tuple[Bools, Floats, Floats, Floats, Floats, Complexes]:
    """Return where points (n,) have one root for every input of boxes, and where it is.

    At the centre it is within the first distance (n,), and everywhere alone within the
    second; in the box within the third of its tube's axis, whose slopes (n, k, inputs) are
    last, and within (n, k) of its place there. What is given to the system moves by
    `moving` (m, given, inputs) times the inputs, `half` (m, inputs) at most, and by at most
    `off` (m, given) rad more.

    With Y P' within `slack` of 1 all over, Y next to the inverse at the point, roots are no
    farther from any place there than the largest of Y P over 1 - `slack`. On the axis this
    is small: as far as Y P' and Y P_g change, which grow evenly at most, for half the way.
    So the way of the root, z' = -P'^-1 P and then -P'^-1 P_g g', does not leave.
    """
    count = roots.z.shape[1]
    half, stray, moving = (box[roots.row] for box in (half, off, moving))
    values, first, by_given = values_at(made, roots)
    inverse = inverses(first)
    size, pull = np.abs(inverse), inverse @ by_given
    rates = -pull @ moving
    moved = applied(np.abs(rates), half) * UP
    swing = (applied(np.abs(moving), half) + stray) * UP
    astray, missed = applied(np.abs(pull), stray), np.abs(applied(inverse, values))
    bent = made.constant * (swing @ made.degrees[:, count:].T) ** 2
    goes = moved + astray + applied(size, bent)
    begins = missed + applied(size, _rounding(made, roots.row))
    wide = np.max(AROUND * goes + CLOSE * begins, axis=1) + 1e-12
    blur, more, drift = _changes(made, roots, wide, swing)
    steps = np.maximum(2.0 * made.degrees[:, :count], 1.0)
    part = np.abs(np.eye(count) - inverse @ first) + ROUNDING
    part += size @ (blur[:, :, None] * steps + ROUNDING * np.abs(first))
    more = size @ more
    slack = np.max(np.sum(part + more, axis=2), axis=1) * UP
    start = missed + applied(size, blur + ROUNDING * np.abs(values))
    drift += ROUNDING * applied(np.abs(by_given), swing)
    strays = start + astray + applied(size, drift) + applied(part + 0.5 * more, moved)
    radius, width = (
        np.max(bound, axis=1) / (1.0 - slack) * UP for bound in (start, strays)
    )
    good = (slack < 1.0) & (np.max(moved, axis=1) + width < wide)
    return good, radius, wide, width, (moved + width[:, None]) * UP, rates


def roots_of_one(made: Polynomials) -> ChartRoots:
    """Return approximations of all roots of one polynomial at each of m inputs."""
    (coefficients,) = made.values
    m, size = coefficients.shape
    companion = np.tile(np.eye(size - 1, k=-1, dtype=complex), (m, 1, 1))
    last = -coefficients[:, :-1] / coefficients[:, -1:]
    companion[:, :, -1] = np.where(np.isfinite(last), last, 0.0)
    points = np.linalg.eigvals(companion).reshape(-1, 1)
    return ChartRoots.of(points, np.repeat(np.arange(m), size - 1))


def are_apart(roots: ChartRoots, radius: Floats, good: Bools, count: int) -> Bools:
    """Return at which inputs all roots are good and proven different from each other.

    There are `count` roots of each input, one input after the other.
    """
    r = radius.reshape(-1, count)
    one, other = r[:, :, None], r[:, None]
    limit = 1.5 * (one + other + one * other) * UP + 1e-14
    apart = (roots.gaps(count) > limit) | np.eye(count, dtype=bool)
    return np.all(apart, axis=(1, 2)) & np.all(good.reshape(r.shape), axis=1)


def are_real(roots: ChartRoots, radius: Floats, unique: Floats) -> tuple[Bools, Bools]:
    """Return which roots are proven real, and which are proven not to be.

    With z also 1 / conj(z) is a root; where both are in a ball with one root they are
    the same, and |z| = 1.
    """
    size = np.abs(roots.z)
    r = radius[:, None] * UP + 1e-14
    mirrored = r / ((size - r) * size) + np.abs(size - 1.0 / size) + 1e-14
    real = np.all((size > 2 * r) & (mirrored * UP < unique[:, None]), axis=1)
    return real, np.any(np.abs(size - 1.0) > r, axis=1)
