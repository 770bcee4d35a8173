"""Pieces of configuration curves: parts of space in which there is one arc and no more.

A piece is z = z0 + t s + N y with |s| <= h and |y| <= r, in all variables z, t and N
orthonormal. With Y near the inverse of F_z N, the test of `roots` is made for all s at
once: then for every s there is exactly one y, so the configurations in the piece are one
arc without an end inside. No variable is special, so a dead centre of the input is an
ordinary place. Everything is float64 with bounds of what it is off by.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Floats
from spherekit.numeric.crossings import wrap
from spherekit.proof.balls import circle
from spherekit.proof.equations import Equations

LONGEST = 0.4
"""Largest half length (rad) of a piece."""
SHORTEST_PIECE = 1e-7
"""Pieces that would have to be shorter are not looked for."""
SHRINK = 0.7
WIDTHS = (1.0, 0.6, 0.35, 0.2, 0.1, 0.03, 0.01)
"""Radii tried, over the half length."""
UP = 1.0 + 1e-12
"""More than any rounding in the sums of bounds, which have positive terms only."""
ROUNDING = 1e-14
"""More than the relative rounding of products of matrices of up to 16 rows."""


@dataclass(frozen=True)
class Zone:
    """A part of space about `centre`: coordinates along `frame` (v, v) within `limits`."""

    centre: Floats
    frame: Floats
    limits: Floats

    def coordinates(self, places: Floats) -> Floats:
        """Return coordinates (..., v) of places (..., v), whole turns away or not."""
        return wrap(places - self.centre) @ self.frame

    def _within(self, places: Floats, reach: Floats) -> Bools:
        return np.all(np.abs(self.coordinates(places)) + reach <= self.limits, axis=-1)

    def holds(self, place: Floats, off: float) -> bool:
        """Return whether a place that is off by at most `off` is in it."""
        return bool(self._within(place, np.array(off + 1e-13)))

    def may_hold(self, places: Floats, off: Floats | float) -> Bools:
        """Return whether places (..., v), off by at most `off` (...), may be in it."""
        return self._within(places, -np.asarray(off)[..., None] - 1e-13)

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return whether boxes (n, v) of radii (n, v) are in it."""
        return self._within(centres, radii @ np.abs(self.frame) * UP + 1e-13)


def covered(zones: Iterable[Zone], centres: Floats, radii: Floats) -> Bools:
    """Return whether boxes (n, v) of radii (n, v) are each in one of several parts."""
    nowhere = np.zeros(len(centres), dtype=bool)
    return np.any([nowhere, *(z.covers(centres, radii) for z in zones)], axis=0)


@dataclass(frozen=True)
class CertifiedArc(Zone):
    """A part of space with one arc in it: `frame` (v, v) has the columns t and N.

    The arc is within `tight` of the axis, y = 0; at s = 0 within `miss`. `test` is what
    proved it.
    """

    tight: float
    miss: float
    test: "Test"

    @property
    def half(self) -> float:
        """The half length, h."""
        return float(self.limits[0])

    @property
    def radius(self) -> float:
        """The radius, r."""
        return float(self.limits[1])

    @property
    def tangent(self) -> Floats:
        """T (v,)."""
        return self.frame[:, 0]


def frame_at(slopes: Floats, along: Floats | None) -> tuple[Floats, Floats] | None:
    """Return the frame at a configuration and Y, from slopes (k, v); None at low rank.

    t is the one of two senses that goes on `along` (v,).
    """
    left, sizes, rows = np.linalg.svd(slopes)
    if not sizes[-1] > 1e-13 * sizes[0]:
        return None
    t = -rows[-1] if along is not None and rows[-1] @ along < 0 else rows[-1]
    return np.column_stack([t, rows[:-1].T]), left.T / sizes[:, None]


def piece_at(
    equations: Equations,
    centre: Floats,
    along: Floats | None,
    longest: float,
    shortest: float = SHORTEST_PIECE,
) -> CertifiedArc | None:
    """Return a piece around a configuration, as long as can be proven up to `longest`."""
    derivatives = equations.real.second(circle(centre))
    made = frame_at(derivatives[1], along)
    if made is None:
        return None
    frame, inverse = made
    test = Test(equations, derivatives, frame, inverse)
    count = 1 + max(0, math.floor(math.log(shortest / longest) / math.log(SHRINK)))
    halves = np.asarray(longest * SHRINK ** np.arange(count), dtype=float)
    inside = test.first_inside(halves)
    if inside is None:
        return None
    half, radius, tight, miss = inside
    limits = np.array([half, *[radius] * len(inverse)])
    return CertifiedArc(centre, frame, limits, tight, miss, test)


class Test:
    """Whether for every s of a length there is exactly one y in a radius.

    The derivatives at the centre, values (k,), slopes (k, v) and curvatures (k, v, v), are
    off by at most `error` (k,) times products of `degrees` (k, v); those of order three are
    at most `constant` (k,) times such products. `inverse` is Y.
    """

    def __init__(
        self,
        equations: Equations,
        derivatives: tuple[Floats, Floats, Floats],
        frame: Floats,
        inverse: Floats,
    ) -> None:
        self.error, self.constant = equations.real.error, equations.bound
        self.degrees, self.inverse, self.size = equations.degrees, inverse, np.abs(inverse)
        values, slopes, self.curvatures = derivatives
        t, normals = frame[:, 0], frame[:, 1:]
        self.along, across = self.degrees @ np.abs(t), self.degrees @ np.abs(normals)
        bend = np.einsum("ijl,j,l->i", self.curvatures, t, t)
        terms = np.stack([values, slopes @ t, bend], axis=1)
        ways = self.size @ (self.constant * (1.0 + self.along) ** 2)
        sizes = self.size @ np.abs(terms) + ways[:, None]
        self.moved = np.abs(inverse @ terms) + ROUNDING * sizes
        inner = slopes @ normals
        self.rest = np.sum(
            np.abs(np.eye(len(inner)) - inverse @ inner)
            + ROUNDING * (1.0 + self.size @ np.abs(inner)),
            axis=1,
        )
        mixed = np.abs(np.einsum("ijl,jc->icl", self.curvatures, normals))
        self.mixed = [
            np.sum(mixed @ side, axis=1)
            for side in (np.abs(t), np.sum(np.abs(normals), axis=1))
        ]
        self.sideways = np.sum(across, axis=1)

    def sums(self, half: Floats, radius: Floats) -> Floats:
        """Return (..., k) by how much the angles of each equation change at most."""
        return (self.along * half[..., None] + self.sideways * radius[..., None]) * UP

    def rows(self, half: Floats, radius: Floats) -> Floats:
        """Return bounds (..., k) of the sums of the rows of 1 - Y F_z N in the piece."""
        change = self.sums(half, radius)
        wide = self.mixed[0] * half[..., None] + self.mixed[1] * radius[..., None]
        third = 0.5 * self.constant * change**2
        third += self.error * (1.0 + change + 0.5 * change**2)
        return (self.rest + (wide + third * self.sideways) @ self.size.T) * UP

    def displacement(self, half: Floats) -> Floats:
        """Return bounds (..., k) of Y F on the axis."""
        length = half[..., None]
        way = self.along * length
        off = self.error * (1.0 + way + 0.5 * way**2) + self.constant * way**3 / 6.0
        start, slope, bend = self.moved.T
        axis = start + length * (slope + 0.5 * length * bend)
        return (axis + off @ self.size.T) * UP

    def first_inside(self, halves: Floats) -> tuple[float, float, float, float] | None:
        """Return the first half length that is proven, its radius, and two distances.

        The arc is within the first of the axis, its middle within the second of the centre.
        """
        half, radius = halves[:, None], np.outer(halves, WIDTHS)
        rows = self.rows(half, radius) * UP
        miss = self.displacement(half)
        fits = np.all(miss + rows * radius[..., None] < radius[..., None] / UP, axis=2)
        proven = np.argwhere(fits & (np.max(rows, axis=2) < 1.0 / UP))
        if not len(proven):
            return None
        row, column = proven[0]
        spare = 1.0 - float(np.max(rows[row, column])) * UP
        # lengths, not components: other pieces see them from other sides
        scale = math.sqrt(rows.shape[2]) / spare * UP
        tight = float(np.max(miss[row, 0])) * scale
        here = float(np.max(self.displacement(np.zeros(())))) * scale
        return float(halves[row]), float(radius[row, column]), tight, here


def corrected(
    equations: Equations, place: Floats, steps: int = 8, moved: int | None = None
) -> Floats | None:
    """Return the configuration next to a place by Newton's method, None without one.

    Only the first `moved` variables are, by default all.
    """
    place = place.copy()
    for _ in range(steps):
        values, slopes, _ = equations.real.second(turns_of(place))
        change, *_ = np.linalg.lstsq(slopes[:, :moved], -values, rcond=1e-13)
        place[:moved] += change
        size = float(np.max(np.abs(change)))
        if not size < 1.0:
            return None
        if size < 1e-14:
            break
    return place if float(np.max(np.abs(values))) < 1e-10 else None


def turns_of(q: Array) -> Array:
    """Return cosines and sines (..., 2) of angles, for approximations."""
    return np.stack([np.cos(q), np.sin(q)], axis=-1)
