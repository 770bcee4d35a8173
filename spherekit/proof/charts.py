"""All complex roots over boxes of the inputs, in charts without infinity.

In z = e^(i angle) the equations are polynomials of degree 2 m in each unknown. Of z and
1 / z one is at most 1, so that a root at infinity is a root like others, and all bounds
are sums over coefficients. A root is proven for all inputs of a box at once: one and only
one in a tube about z0 + z' (q - q0). Of a system that is solved after others, their
angles are inputs too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices
from spherekit.proof.equations import Equations
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

    @staticmethod
    def at(
        equations: Equations,
        rows: Sequence[int],
        unknowns: Sequence[int],
        given: Array,
    ) -> "Polynomials":
        """Return those of equations `rows` in `unknowns`.

        `given` (m, inputs, 2) are the cosines and sines, each rounded once, of all other
        variables, in order.
        """
        real = equations.real
        others = [v for v in range(equations.variables) if v not in unknowns]
        made = [real.powers(row, unknowns, given) for row in rows]
        largest = [max(np.max(np.abs(array), initial=0.0) for array in two) for two in made]
        degrees = equations.construction.degrees[np.ix_(rows, [*unknowns, *others])]
        most = np.max(degrees, axis=1, initial=1)
        error = real.error[list(rows)] * most + ROUNDING * (1.0 + np.array(largest))
        values, slopes = zip(*made, strict=True)
        return Polynomials(values, slopes, error, equations.bound[list(rows)], degrees)


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
        with np.errstate(all="ignore"):
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
        under = np.where(self.inverse, self.z, 1.0).reshape(shape)
        way = over[:, :, None] * under[:, None]
        return np.max(np.abs(way - way.swapaxes(1, 2)), axis=3, initial=0.0)

    def take(self, kept: Any) -> "ChartRoots":
        """Return some of them."""
        return ChartRoots(self.z[kept], self.inverse[kept], self.row[kept])

    def moved(self, z: Complexes) -> "ChartRoots":
        """Return the same with other points, each in the better chart."""
        with np.errstate(all="ignore"):
            over = np.abs(z) > 1.0 + WIDEST
            inverted = np.where(over, 1.0 / z, z)
        return ChartRoots(inverted, self.inverse ^ over, self.row)


class _Derivatives:
    """Derivatives by z of polynomials at points, each power of z computed once."""

    def __init__(self, roots: ChartRoots) -> None:
        self.roots = roots
        self._powers: dict[tuple[int, int, int], Complexes] = {}

    def of(self, series: Complexes, *columns: int) -> Complexes:
        """Return (n, ...) that of series (n, ..., sizes) by the unknowns of `columns`."""
        k = self.roots.z.shape[1]
        out = series
        for column, size in reversed(list(enumerate(series.shape[-k:]))):
            key = column, size, columns.count(column)
            if key not in self._powers:
                self._powers[key] = self._power(*key)
            out = np.einsum("n...p,np->n...", out, self._powers[key])
        return out

    def _power(self, column: int, size: int, order: int) -> Complexes:
        """Return (n, size) the powers of z that belong to coefficients, or derivatives."""
        up = np.arange(size)
        exponents = np.where(self.roots.inverse[:, column, None], size - 1 - up, up)
        factor = np.ones(exponents.shape)
        for step in range(order):
            factor = factor * (exponents - step)
        z = self.roots.z[:, column, None]
        return factor * z ** np.maximum(exponents - order, 0)


def values_at(
    made: Polynomials, roots: ChartRoots
) -> tuple[Complexes, Complexes, Complexes]:
    """Return P (n, k), its derivatives by z (n, k, k) and by the inputs (n, k, inputs)."""
    n, count = roots.z.shape
    values = np.empty((n, count), dtype=complex)
    first = np.zeros((n, count, count), dtype=complex)
    by_input = np.empty((n, count, made.slopes[0].shape[1]), dtype=complex)
    derivatives = _Derivatives(roots)
    for row, (series, slopes) in enumerate(zip(made.values, made.slopes, strict=True)):
        here = series[roots.row]
        values[:, row] = derivatives.of(here)
        for column in (j for j in range(count) if here.shape[1 + j] > 1):
            first[:, row, column] = derivatives.of(here, column)
        by_input[:, row] = derivatives.of(slopes[roots.row])
    return values, first, by_input


def polished(
    made: Polynomials, roots: ChartRoots, most: int = NEWTON_STEPS
) -> tuple[ChartRoots, Bools]:
    """Return what Newton's method makes of points, and where it ends well."""
    good = np.ones(len(roots.z), dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(most):
            values, first, _ = values_at(made, roots)
            inverse, regular = inverses(first)
            change = np.einsum("nij,nj->ni", inverse, values)
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


@dataclass(frozen=True)
class Given:
    """Boxes of the inputs, and how what is given to a system moves with them.

    `half` (m, inputs) are the half widths (rad). A given angle moves by `rates` (m, given,
    inputs) times the inputs, and by at most `off` (m, given) rad more.
    """

    half: Floats
    rates: Floats
    off: Floats

    def take(self, rows: Indices) -> "Given":
        """Return those of some boxes."""
        return Given(self.half[rows], self.rates[rows], self.off[rows])


@dataclass(frozen=True)
class RootEnclosures:
    """What is proven of points over boxes: `good` (n,) and what else.

    At the centre of the box a root is within `radius` (n,), and alone within `unique`;
    over the box it is within `width` (n,) of the axis of its tube, whose slopes are `rates`
    (n, k, inputs), and within `reach` (n, k) of its place at the centre.
    """

    good: Bools
    radius: Floats
    unique: Floats
    width: Floats
    reach: Floats
    rates: Complexes


def tubes(made: Polynomials, roots: ChartRoots, given: Given) -> RootEnclosures:
    """Return where points have one root for every input of boxes."""
    with np.errstate(all="ignore"):
        return _tubes(made, roots, given.take(roots.row))


def _second(coefficients: Sequence[Complexes], roots: ChartRoots) -> Complexes:
    """Return the second derivatives (n, k, k, k) by z of polynomials at points."""
    n, count = roots.z.shape
    out = np.zeros((n, len(coefficients), count, count), dtype=complex)
    derivatives = _Derivatives(roots)
    for row, series in enumerate(coefficients):
        here = series[roots.row]
        held = [j for j in range(count) if here.shape[1 + j] > 1]
        for j, other in combinations_with_replacement(held, 2):
            bent = derivatives.of(here, j, other)
            out[:, row, j, other] = out[:, row, other, j] = bent
    return out


def _mixed(made: Polynomials, roots: ChartRoots) -> Complexes:
    """Return the derivatives (n, k, k, given) by z and by what is given."""
    n, count = roots.z.shape
    out = np.zeros((n, count, count, made.slopes[0].shape[1]), dtype=complex)
    derivatives = _Derivatives(roots)
    for row, series in enumerate(made.slopes):
        here = series[roots.row]
        for j in (j for j in range(count) if here.shape[2 + j] > 1):
            out[:, row, j] = derivatives.of(here, j)
    return out


def _along(
    made: Polynomials, roots: ChartRoots, given: Given, inverse: Complexes, rates: Complexes
) -> tuple[Complexes, Complexes, Floats]:
    """Return how the derivative changes along the axis by each input (n, k, k, inputs).

    Then its derivatives by what is given, and by how much the axis is curved (n, k).
    """
    half, mixed = given.half, _mixed(made, roots)
    along = np.einsum("nijl,nld->nijd", _second(made.values, roots), rates)
    along += np.einsum("nijg,ngd->nijd", mixed, given.rates)
    twice = np.einsum("nijd,nje->nide", along, rates)
    twice += np.einsum("nijg,nje,ngd->nide", mixed, rates, given.rates)
    bent = np.abs(np.einsum("nij,njde->nide", inverse, twice))
    bent = 0.5 * bent + ROUNDING * np.einsum(
        "nij,njde->nide", np.abs(inverse), np.abs(twice)
    )
    return along, mixed, np.einsum("nide,nd,ne->ni", bent, half, half)


def _tubes(made: Polynomials, roots: ChartRoots, given: Given) -> RootEnclosures:
    """Return what is proven: to second order along the axes of tubes, bounded beyond.

    All derivatives by z in `reach`, or by 1, are at most `constant`, on the axis `axis`,
    times powers of `steps`, those by what is given of `turned` (S. Bernstein).
    """
    count, half = roots.z.shape[1], given.half
    values, first, by_given = values_at(made, roots)
    inverse, regular = inverses(first)
    size = np.abs(inverse)
    by_input = by_given @ given.rates
    rates = -inverse @ by_input
    moved = np.einsum("njg,ng->nj", np.abs(rates), half) * UP
    reach = np.abs(roots.z) + moved + WIDEST
    steps = 2.0 * made.degrees[:, :count]
    turned = made.degrees[:, count:].astype(float)
    growth = np.exp(np.log(np.maximum(reach, 1.0)) @ steps.T) * UP
    constant = made.constant * growth
    near = np.maximum(np.abs(roots.z) + moved, 1.0)
    axis = made.constant * np.exp(np.log(near) @ steps.T) * UP
    # by how much the angles, in all, change at most in each equation
    across = moved @ steps.T
    spread = np.einsum("ngd,nd->ng", np.abs(given.rates), half) @ turned.T
    stray = given.off @ turned.T
    way = (across + spread + stray) * UP
    around = ChartRoots(reach.astype(complex), roots.inverse, roots.row)
    bent = np.abs(_second([np.abs(array) for array in made.values], around))
    along, mixed, curved = _along(made, roots, given, inverse, rates)
    count_of = np.array([array[0].size for array in made.values], dtype=float)
    off = made.error * count_of
    spare = (constant * (spread + stray) + off * growth) * UP
    bent = bent + spare[:, :, None, None] * steps[:, :, None] * steps[:, None, :]
    # rounding: of the coefficients, and of the sums over them
    sums = np.stack([np.sum(np.abs(v.reshape(len(v), -1)), axis=1) for v in made.values], 1)
    blur = (off + 4 * ROUNDING * count_of * sums[roots.row]) * growth
    far = axis * (0.5 * (spread + stray) ** 2 + across * stray + way**3 / 6.0)
    far += np.einsum("nig,ng->ni", np.abs(by_given), given.off)
    rest = np.einsum("nig,ng->ni", np.abs(first @ rates + by_input), half)
    far += rest + blur * (1.0 + way + 0.5 * way**2) + ROUNDING * np.abs(values)
    start = np.abs(np.einsum("nij,nj->ni", inverse, values))
    still = start + np.einsum("nij,nj->ni", size, blur + ROUNDING * np.abs(values))
    miss = start + curved + np.einsum("nij,nj->ni", size, far)
    miss = np.max(miss * UP, axis=1, initial=0.0)
    turning = np.einsum("nij,njld->nild", inverse, along)
    part = np.abs(np.eye(count) - inverse @ first)
    part += np.einsum("nild,nd->nil", np.abs(turning), half)
    change = np.einsum("nijg,ng->nij", np.abs(mixed), given.off)
    change += (0.5 * axis * way**2)[:, :, None] * steps
    change += (blur * (1.0 + way))[:, :, None] * np.maximum(steps, 1.0)
    change += ROUNDING * np.einsum("nijd,nd->nij", np.abs(along), half)
    part += size @ change + ROUNDING * (size @ np.abs(first) + 1.0)
    slack = np.max(np.sum(part, axis=2), axis=1, initial=0.0) * UP
    bend = np.einsum("nij,nj->ni", size, np.sum(bent, axis=(2, 3)))
    bend = np.max(bend, axis=1, initial=0.0) * UP
    unique, slope, good = _contracted(miss, slack, bend)
    good &= regular
    radius = MARGIN * np.max(still * UP, axis=1, initial=0.0) / (1.0 - slope)
    width = np.minimum(miss / (1.0 - slope) * UP, unique)
    reach = (moved + width[:, None]) * UP
    return RootEnclosures(good, np.minimum(radius, unique), unique, width, reach, rates)


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
    companion = np.zeros((m, size - 1, size - 1), dtype=complex)
    companion[:, 1:, :-1] = np.eye(size - 2)
    with np.errstate(all="ignore"):
        last = -coefficients[:, :-1] / coefficients[:, -1:]
    companion[:, :, -1] = np.where(np.isfinite(last), last, 0.0)
    points = np.linalg.eigvals(companion).astype(complex).reshape(-1, 1)
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


def are_real(roots: ChartRoots, proven: RootEnclosures) -> tuple[Bools, Bools]:
    """Return which roots are proven real, and which are proven not to be.

    With z also 1 / conj(z) is a root; where both are in a ball with one root they are
    the same, and |z| = 1.
    """
    size = np.abs(roots.z)
    r = proven.radius[:, None] * UP + 1e-14
    with np.errstate(all="ignore"):
        mirrored = r / ((size - r) * size) + np.abs(size - 1.0 / size) + 1e-14
        real = np.all((size > 2 * r) & (mirrored * UP < proven.unique[:, None]), axis=1)
    off = np.any(np.abs(size - 1.0) > r, axis=1)
    return np.asarray(real), np.asarray(off)


def stepped(made: Polynomials, roots: ChartRoots, ways: Array) -> ChartRoots:
    """Return roots moved by their rates where what is given moves by `ways` (m, given)."""
    with np.errstate(all="ignore"):
        _, first, by_input = values_at(made, roots)
        inverse, _ = inverses(first)
        change = np.einsum("njg,ng->nj", -inverse @ by_input, ways[roots.row])
        return roots.moved(roots.z + change)
