"""All complex roots over boxes of the inputs, in charts without infinity.

In z = e^(i angle) the equations are polynomials of degree 2 m in each unknown. Of z and
1 / z one is at most 1, so that a root at infinity is a root like others, and all bounds
are sums over coefficients. A root is proven for all inputs of a box at once: one and only
one in a tube about z0 + z' (q - q0). Of a system that is solved after others, their
angles are inputs too. Numbers may be infinite: callers let NumPy divide by zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.proof.tubes import ROUNDING, UP

WIDEST = 0.05
"""Largest radius of a tube: the bounds of derivatives are for it."""
MARGIN = 4.0
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
        every = list(combinations_with_replacement(range(count), order))
        places = [every.index(tuple(sorted(key))) for key in np.ndindex(*[count] * order)]
        rows = []
        for series in arrays:
            here = series[self.row]
            made = [self._derivative(here, key) for key in every]
            rows.append(np.stack([made[place] for place in places], axis=1))
        out = np.stack(rows, axis=1)
        return out.reshape(n, len(rows), *[count] * order, *out.shape[3:])

    def _derivative(self, series: Complexes, columns: tuple[int, ...]) -> Complexes:
        """Return (n, ...) that of series (n, ..., sizes) by the unknowns of `columns`."""
        sizes = series.shape[-self.z.shape[1] :]
        if any(sizes[column] == 1 for column in columns):
            return np.zeros(series.shape[: -len(sizes)], dtype=complex)
        out = series
        for column, size in reversed(list(enumerate(sizes))):
            powers = self._powers_of(column, size, columns.count(column))
            out = np.einsum("n...p,np->n...", out, powers)
        return out

    def _powers_of(self, column: int, size: int, order: int) -> Complexes:
        """Return (n, size) the powers of z that belong to coefficients, or derivatives."""
        key = column, size, order
        if key not in self._powers:
            up = np.arange(size)
            exponents = np.where(self.inverse[:, column, None], size - 1 - up, up)
            factor = np.ones(exponents.shape)
            for step in range(order):
                factor = factor * (exponents - step)
            z = self.z[:, column, None]
            self._powers[key] = factor * z ** np.maximum(exponents - order, 0)
        return self._powers[key]

    @cached_property
    def _powers(self) -> dict[tuple[int, int, int], Complexes]:
        return {}

    def moved(self, z: Complexes) -> "ChartRoots":
        """Return the same with other points, each in the better chart."""
        over = np.abs(z) > 1.0 + WIDEST
        return ChartRoots(np.where(over, 1.0 / z, z), self.inverse ^ over, self.row)


def values_at(
    made: Polynomials, roots: ChartRoots
) -> tuple[Complexes, Complexes, Complexes]:
    """Return P (n, k), its derivatives by z (n, k, k) and by the inputs (n, k, inputs)."""
    here, first = (roots.derivatives(made.values, order) for order in (0, 1))
    return here, first, roots.derivatives(made.slopes)


def polished(made: Polynomials, roots: ChartRoots) -> tuple[ChartRoots, Bools]:
    """Return what Newton's method makes of points, and where it ends well."""
    good = np.ones(len(roots.z), dtype=bool)
    for _ in range(NEWTON_STEPS):
        values, first, _ = values_at(made, roots)
        inverse, regular = inverses(first)
        change = applied(inverse, values)
        size = np.max(np.abs(change), axis=1, initial=0.0)
        good &= regular & (size < 1.0)
        roots = roots.moved(np.where(good[:, None], roots.z - change, roots.z))
        if np.max(size[good], initial=0.0) < STILL:
            break
    return roots, good & (size < 1e-9)


def inverses(first: Complexes) -> tuple[Complexes, Bools]:
    """Return inverses (n, k, k), zero where there are none, and which there are."""
    regular = np.all(np.isfinite(first), axis=(1, 2))
    regular &= np.abs(np.linalg.det(np.where(regular[:, None, None], first, 0))) > 0.0
    out = np.zeros_like(first)
    out[regular] = np.linalg.inv(first[regular])
    return out, regular & np.all(np.isfinite(out), axis=(1, 2))


def applied(matrices: Array, vectors: Array) -> Array:
    """Return products (n, i) of matrices (n, i, j) and vectors (n, j)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _rounding(made: Polynomials, rows: Indices) -> Floats:
    """Return by how much values (n, k) are off by coefficients and sums of them."""
    sizes = [np.abs(array).reshape(len(array), -1) for array in made.values]
    count = np.array([array.shape[1] for array in sizes], dtype=float)
    total = np.stack([np.sum(array, axis=1) for array in sizes], axis=1)
    return np.asarray(count * (made.error + 4 * ROUNDING * total)[rows])


def _along(
    made: Polynomials,
    roots: ChartRoots,
    moving: Floats,
    inverse: Complexes,
    rates: Complexes,
    half: Floats,
) -> tuple[Complexes, Complexes, Floats]:
    """Return how the derivative changes along the axis by each input (n, k, k, inputs).

    Then its derivatives by what is given, and by how much the axis is curved (n, k).
    """
    mixed = roots.derivatives(made.slopes, 1)
    along = np.einsum("nijl,nld->nijd", roots.derivatives(made.values, 2), rates)
    along += np.einsum("nijg,ngd->nijd", mixed, moving)
    twice = np.einsum("nijd,nje->nide", along, rates)
    twice += np.einsum("nijg,nje,ngd->nide", mixed, rates, moving)
    curves = 0.5 * np.abs(np.einsum("nij,njde->nide", inverse, twice))
    curves += ROUNDING * np.einsum("nij,njde->nide", np.abs(inverse), np.abs(twice))
    return along, mixed, np.einsum("nide,nd,ne->ni", curves, half, half)


def tubes(
    made: Polynomials, roots: ChartRoots, half: Floats, moving: Floats, off: Floats
) -> tuple[Bools, Floats, Floats, Floats, Floats, Complexes]:
    """Return where points (n,) have one root for every input of boxes, and where it is.

    At the centre it is within the first distance (n,), alone within the second; in the box
    within the third of its tube's axis, whose slopes (n, k, inputs) are last, and within
    (n, k) of its place there. What is given to the system moves by `moving` (m, given,
    inputs) times the inputs, `half` (m, inputs) at most, and by at most `off` (m, given)
    rad more. It is to second order along the axes, bounded beyond: derivatives are at most
    the constant times `growth` in `reach`, `axis` on the axis, times powers of `steps`,
    those by what is given of `turned` (S. Bernstein).
    """
    count = roots.z.shape[1]
    half, stray, moving = (box[roots.row] for box in (half, off, moving))
    values, first, by_given = values_at(made, roots)
    inverse, regular = inverses(first)
    size = np.abs(inverse)
    by_input = by_given @ moving
    rates = -inverse @ by_input
    moved = applied(np.abs(rates), half) * UP
    reach = np.abs(roots.z) + moved + WIDEST
    steps = 2.0 * made.degrees[:, :count]
    turned = made.degrees[:, count:].astype(float)
    growth = np.exp(np.log(np.maximum(reach, 1.0)) @ steps.T) * UP
    near = np.maximum(np.abs(roots.z) + moved, 1.0)
    axis = made.constant * np.exp(np.log(near) @ steps.T) * UP
    across, strays = moved @ steps.T, stray @ turned.T
    given = applied(np.abs(moving), half) @ turned.T + strays
    way = (across + given) * UP
    along, mixed, curved = _along(made, roots, moving, inverse, rates, half)
    blur = growth * _rounding(made, roots.row)
    spare = (made.constant * growth * given + blur) * UP
    far = axis * (0.5 * given**2 + across * strays + way**3 / 6.0)
    lost = ROUNDING * np.abs(values)
    far += applied(np.abs(by_given), stray) + blur * (1.0 + way + 0.5 * way**2) + lost
    far += applied(np.abs(first @ rates + by_input), half)
    start = np.abs(applied(inverse, values))
    still = start + applied(size, blur + lost)
    miss = start + curved + applied(size, far)
    turning = np.einsum("nij,njld->nild", inverse, along)
    part = np.abs(np.eye(count) - inverse @ first)
    part += np.einsum("nild,nd->nil", np.abs(turning), half)
    change = np.einsum("nijg,ng->nij", np.abs(mixed), stray)
    change += (0.5 * axis * way**2)[:, :, None] * steps
    change += (blur * (1.0 + way))[:, :, None] * np.maximum(steps, 1.0)
    change += ROUNDING * np.einsum("nijd,nd->nij", np.abs(along), half)
    part += size @ change + ROUNDING * (size @ np.abs(first) + 1.0)
    slack = np.max(np.sum(part, axis=2), axis=1, initial=0.0) * UP
    around = ChartRoots(reach.astype(complex), roots.inverse, roots.row)
    bent = np.abs(around.derivatives([np.abs(array) for array in made.values], 2))
    bent += spare[:, :, None, None] * steps[:, :, None] * steps[:, None, :]
    bend = applied(size, np.sum(bent, axis=(2, 3)))
    miss, bend = (np.max(bound * UP, axis=1, initial=0.0) for bound in (miss, bend))
    unique, slope, good = _contracted(miss, slack, bend)
    radius = MARGIN * np.max(still * UP, axis=1, initial=0.0) / (1.0 - slope)
    width = np.minimum(miss / (1.0 - slope) * UP, unique)
    reach = (moved + width[:, None]) * UP
    return good & regular, np.minimum(radius, unique), unique, width, reach, rates


def _contracted(miss: Floats, slack: Floats, bend: Floats) -> tuple[Floats, Floats, Bools]:
    """Return within what a root is alone, the slope of Newton's map, and if it is proven.

    With miss >= |Y P| on the axis, slack >= |1 - Y P'| there and bend r >= |Y| |P'(y) - P'|
    within r of it, y - Y P(y) takes a ball of radius r into itself and contracts if miss +
    (slack + bend r) r < r and slack + bend r < 1 (L. Kantorovich, 1948).
    """
    unique = np.minimum(WIDEST, 0.5 * (1.0 - slack) / bend)
    slope = (slack + bend * unique) * UP
    good = np.isfinite(miss) & np.isfinite(bend) & (slack < 1.0) & (slope < 1.0)
    return unique, slope, good & (miss < unique * (1.0 - slope) / UP)


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
    off = np.any(np.abs(size - 1.0) > r, axis=1)
    return np.asarray(real), np.asarray(off)
