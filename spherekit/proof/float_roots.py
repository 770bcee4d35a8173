"""Many roots proven at once in float64: the test of `roots` with bounds of its rounding."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.proof.balls import Ball, circle, complex_ball, complex_circle
from spherekit.proof.charts import inverses
from spherekit.proof.equations import Equations
from spherekit.proof.jets import values_and_slopes
from spherekit.proof.roots import MARGIN, NEAR_REAL, WIDEST, Root
from spherekit.proof.tubes import ROUNDING, UP
from spherekit.sphere.rotation import Floats

Complexes = NDArray[np.complex128]
Bools = NDArray[np.bool_]

STEPS = 12
STILL = 1e-14
SAME = 1e-7
"""Approximations whose points differ by less are taken for one; nothing rests on it."""
FAR = 12.0
"""Imaginary parts (rad) beyond which no root is looked for."""


@final
@dataclass(frozen=True)
class FloatRoots:
    """Roots with centres (n, unknowns) rad: `radius` and `unique` (n,) as in `Root`.

    `row` (n,) says to which of the inputs given they belong.
    """

    centres: Complexes
    radius: Floats
    unique: Floats
    real: Bools
    row: NDArray[np.intp]

    def take(self, kept: NDArray[np.intp] | Bools) -> "FloatRoots":
        """Return some of them."""
        return FloatRoots(
            self.centres[kept],
            self.radius[kept],
            self.unique[kept],
            self.real[kept],
            self.row[kept],
        )

    def roots(self) -> list[Root]:
        """Return the roots with their centres as balls."""
        parts = zip(self.centres, self.radius, self.unique, self.real, strict=True)
        return [
            Root(
                tuple(complex_ball(complex(angle)) for angle in centre),
                float(radius),
                float(unique),
                bool(real),
            )
            for centre, radius, unique, real in parts
        ]


def float_roots(
    equations: Equations, driven: Sequence[Ball], near: Complexes
) -> list[Root]:
    """Return roots at inputs next to approximations (n, unknowns), proven different."""
    turns = circle(driven)
    rows = np.zeros(len(near), dtype=np.intp)
    return roots_at(equations, turns[None], near, rows).roots()


def roots_at(
    equations: Equations, driven: Floats, near: Complexes, row: NDArray[np.intp]
) -> FloatRoots:
    """Return the roots next to approximations, those of the same inputs all different.

    `driven` (m, inputs, 2) are the cosines and sines of inputs, `near` (n, unknowns) rad
    approximations at the inputs of number `row` (n,), of which those of the complex
    conjugates are tried too.
    """
    with np.errstate(all="ignore"):
        polished, good = _polished(equations, driven[row], near)
        polished, row = polished[good], row[good]
        both = np.concatenate([polished, polished.conj()])
        row = np.concatenate([row, row])
        kept = _first_of_each(both, row)
        centres, row = both[kept], row[kept]
        real = np.max(np.abs(centres.imag), axis=1, initial=0.0) < NEAR_REAL
        snapped = centres[real].real.astype(complex)
        snapped, _ = _polished(equations, driven[row[real]], snapped)
        proven = _proven(equations, driven, snapped, row[real], True)
        # what is not proven as a real root may be one beside the real axis
        missed = real.copy()
        missed[np.flatnonzero(real)] = ~_are_in(centres[real], row[real], proven)
        other = missed | ~real
        beside = _proven(equations, driven, centres[other], row[other], False)
        joined = FloatRoots(
            np.concatenate([proven.centres, beside.centres]),
            np.concatenate([proven.radius, beside.radius]),
            np.concatenate([proven.unique, beside.unique]),
            np.concatenate([proven.real, beside.real]),
            np.concatenate([proven.row, beside.row]),
        )
        return joined.take(_different(joined))


def _at(
    equations: Equations, driven: Floats, angles: Complexes, turns: Complexes
) -> tuple[Complexes, Complexes]:
    """Return F (n, k) and F' (n, k, k) at angles (n, k) with their cosines and sines."""
    whole = np.concatenate([turns, driven.astype(complex)], axis=1)
    values, slopes = values_and_slopes(equations.floats.at(whole, 1), equations.variables)
    return values, slopes[..., : angles.shape[1]]


def _polished(
    equations: Equations, driven: Floats, near: Complexes
) -> tuple[Complexes, Bools]:
    """Return what Newton's method makes of approximations, and where it ends well."""
    angles = near.astype(complex)
    good = np.all(np.abs(angles.imag) < FAR, axis=1) & np.all(np.isfinite(angles), axis=1)
    for _ in range(STEPS):
        if not np.any(good):
            break
        turns = np.stack([np.cos(angles[good]), np.sin(angles[good])], axis=-1)
        values, first = _at(equations, driven[good], angles[good], turns)
        inverse, regular = inverses(first)
        change = np.einsum("nij,nj->ni", inverse, values)
        angles[good] -= change
        size = np.max(np.abs(change), axis=1)
        good[good] = (
            regular & (size < 1.0) & np.all(np.abs(angles[good].imag) < FAR, axis=1)
        )
        if np.max(size, initial=0.0) < STILL:
            break
    return angles, good


def _first_of_each(angles: Complexes, row: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the places of approximations that are not copies of earlier ones."""
    kept = []
    points = np.exp(1j * angles)
    for number in np.unique(row):
        rows = np.flatnonzero(row == number)
        apart = np.max(np.abs(points[rows][:, None] / points[rows] - 1.0), axis=2)
        copies = np.any(np.tril(apart < SAME, -1), axis=1)
        kept.append(rows[~copies])
    return np.concatenate(kept) if kept else np.empty(0, dtype=np.intp)


def _are_in(angles: Complexes, row: NDArray[np.intp], roots: FloatRoots) -> Bools:
    """Return which approximations (n, k) lead to one of the roots found."""
    apart = np.abs(np.exp(1j * (angles[:, None] - roots.centres)) - 1.0)
    near = np.all(apart < 10.0 * NEAR_REAL, axis=2)
    return np.asarray(np.any(near & (row[:, None] == roots.row), axis=1))


def _proven(
    equations: Equations,
    driven: Floats,
    centres: Complexes,
    row: NDArray[np.intp],
    real: bool,
) -> FloatRoots:
    """Return the roots that are proven to be near centres (n, k), real ones or not."""
    centres = centres.real.astype(complex) if real else centres
    count = centres.shape[1]
    values, first = _at(equations, driven[row], centres, complex_circle(centres))
    inverse, regular = inverses(first)
    size = np.abs(inverse)
    away = np.abs(centres.imag)
    stretch = np.ones((len(centres), equations.variables))
    stretch[:, :count] = np.exp(away) * UP
    here = equations.floats.complex_bounds(stretch)
    degrees = here.degrees[:, :count]
    stretch[:, :count] = np.exp(away + 2 * WIDEST) * UP
    around = equations.bounds(stretch)
    sums = np.sum(degrees, axis=1)

    def spread(terms: Floats) -> Floats:
        return np.asarray(np.einsum("nij,nj->ni", size, terms) * UP)

    miss = np.abs(np.einsum("nij,nj->ni", inverse, values))
    miss = miss + spread(here.error + ROUNDING * np.abs(values))
    rest = np.abs(np.eye(count) - inverse @ first)
    rest = rest + ROUNDING * (size @ np.abs(first) + 1.0)
    rows = np.sum(rest, axis=2) + spread(here.error * sums)
    bend = np.max(spread(around.constant * sums**2), axis=1, initial=0.0) * UP
    miss, contraction = (np.max(part, axis=1, initial=0.0) * UP for part in (miss, rows))
    unique = np.minimum(WIDEST, 0.5 * (1.0 - contraction) / bend)
    slope = (contraction + bend * unique) * UP
    radius = np.maximum(MARGIN * miss / (1.0 - slope), 1e-300)
    good = regular & (contraction < 1.0) & np.isfinite(bend) & np.isfinite(miss)
    good &= (slope < 1.0) & (miss * UP < unique * (1.0 - slope))
    radius = np.minimum(radius, unique)
    if not real:
        good &= np.max(away, axis=1, initial=0.0) > radius
    roots = FloatRoots(centres, radius, unique, np.full(len(centres), real), row)
    return roots.take(good)


def _different(roots: FloatRoots) -> NDArray[np.intp]:
    """Return the places of roots that are proven different from all kept before them."""
    points = np.exp(1j * roots.centres)
    reach = np.abs(points) * (1.1 * roots.radius[:, None] + 1e-14)
    kept: list[NDArray[np.intp]] = []
    for number in np.unique(roots.row):
        rows = np.flatnonzero(roots.row == number)
        gap = np.abs(points[rows][:, None] - points[rows])
        apart = np.any(gap > (reach[rows][:, None] + reach[rows]) * UP, axis=2)
        doubtful = np.tril(~apart, -1)
        taken = np.ones(len(rows), dtype=bool)
        for place in range(len(rows)):
            taken[place] = not np.any(doubtful[place] & taken)
        kept.append(rows[taken])
    return np.concatenate(kept) if kept else np.empty(0, dtype=np.intp)
