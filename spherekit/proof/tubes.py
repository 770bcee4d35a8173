"""Pieces of configuration curves: parts of space in which there is one arc and no more.

A piece is z = z0 + t s + N y with |s| <= h and |y| <= r, in all variables z, t and N
orthonormal. Where Y F' N is next to 1 in all of it, Y near the inverse at z0, there is one
y at most for every s. And there is one: from z0 a way leads to F = 0 as in `root_ball`, and
on from there with y' = -(F' N)^-1 F' t, which bounds of Y F' bound, so that it does not
leave the piece. So the configurations in the piece are one arc without an end inside. No
variable is special, so a dead centre of the input is an ordinary place. Everything is
float64 with bounds of what it is off by.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import Equations
from spherekit.proof.balls import circle

LONGEST = 0.4
"""Largest half length (rad) of a piece."""
SHORTEST_PIECE = 1e-7
"""Pieces that would have to be shorter are not looked for."""
SHRINK = 0.7
STEPS = 12
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

    def _within(self, places: Floats, reach: Floats | float) -> Bools:
        return np.all(np.abs(self.coordinates(places)) + reach <= self.limits, axis=-1)

    def holds(self, place: Floats, off: float) -> bool:
        """Return whether a place that is off by at most `off` is in it."""
        return bool(self._within(place, off + 1e-13))

    def may_hold(self, place: Floats, off: float) -> bool:
        """Return whether a place that is off by at most `off` may be in it."""
        return bool(self._within(place, -off - 1e-13))

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
        return self.limits[0]

    @property
    def radius(self) -> float:
        """The radius, r."""
        return self.limits[1]

    @property
    def tangent(self) -> Floats:
        """T (v,)."""
        return self.frame[:, 0]

    def beside(self, half: float) -> float:
        """Return how far the arc is from the axis where |s| <= half, at most."""
        tight, _, _ = self.test.arc(half, self.radius)
        # it is in the piece, which says more where the bounds come to nothing
        return min(float(tight), self.radius)


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
) -> CertifiedArc | None:
    """Return a piece around a configuration, as long as can be proven up to `longest`."""
    derivatives = [x[0] for x in equations.real.derivatives(circle(centre[None]), 2)]
    made = frame_at(derivatives[1], along)
    if made is None:
        return None
    frame, inverse = made
    test = Test(equations, derivatives, frame, inverse)
    count = 1 + max(0, math.floor(math.log(SHORTEST_PIECE / longest) / math.log(SHRINK)))
    halves: Floats = longest * SHRINK ** np.arange(float(count))[:, None]
    radii: Floats = halves * WIDTHS
    tight, rows, _ = test.arc(halves, radii)
    proven = np.argwhere((tight * UP < radii) & (rows < 1.0))
    if not len(proven):
        return None
    at = tuple(proven[0])
    half, radius = halves[at[0], 0], radii[at]
    # lengths, not components: other pieces see them from other sides
    scale = math.sqrt(len(inverse)) * UP
    miss = float(test.arc(0.0, radius)[0])
    limits = np.array([half, *[radius] * len(inverse)])
    return CertifiedArc(centre, frame, limits, tight[at] * scale, miss * scale, test)


class Test:
    """Bounds of Y F and its derivatives next to a centre, in coordinates along a frame.

    The derivatives at the centre, values (k,), slopes (k, v) and curvatures (k, v, v), are
    off by at most `error` (k,) times products of `degrees` (k, v) of the coordinates,
    rounding included; those of order three are at most `constant` (k,) times such products.
    `inverse` is Y, `bent` (k, v, v) is Y F''.
    """

    def __init__(
        self,
        equations: Equations,
        derivatives: list[Floats],
        frame: Floats,
        inverse: Floats,
    ) -> None:
        values, slopes, curvatures = derivatives
        self.constant, self.inverse, self.size = equations.bound, inverse, np.abs(inverse)
        self.error = equations.real.error + 4.0 * ROUNDING * self.constant
        self.degrees = equations.degrees @ np.abs(frame) * UP
        self.bent = np.tensordot(inverse, frame.T @ curvatures @ frame, 1)
        self._ahead, self._bent = np.eye(1, len(frame))[0], np.abs(self.bent)
        self._miss = np.max(np.abs(inverse @ values) + self.size @ self.error)
        self._slopes = np.abs(
            inverse @ (slopes @ frame) - np.eye(len(inverse), len(frame), 1)
        )

    def change(self, reach: Floats) -> Floats:
        """Return bounds (..., k, v) of Y F' less (0, 1) within a reach (..., v)."""
        sums = reach @ self.degrees.T
        beyond = 0.5 * self.constant * sums**2 + self.error * (1.0 + sums)
        bent = (reach[..., None, None, :] @ self._bent)[..., 0, :]
        return (self._slopes + bent + self.size @ (beyond[..., None] * self.degrees)) * UP

    def arc(
        self, half: Floats | float, radius: Floats | float
    ) -> tuple[Floats, Floats, Floats]:
        """Return how far off the axis F is 0 where |s| <= half, if |y| <= radius there.

        That is if the sums of the rows of 1 - Y F' N, which come next, are below 1. The
        last is a bound of y'.
        """
        outer, ahead = np.multiply.outer, self._ahead
        reach = outer(outer((1.0, 0.0), half), ahead) + outer(radius, 1.0 - ahead)
        change = self.change(reach)
        rows = change[0, ..., 1:].sum(axis=-1).max(axis=-1) * UP
        spare = np.maximum(1.0 - rows, 1e-300)
        across, middle = change[..., 0].max(axis=-1) / spare * UP
        # a bound of y' is convex in s
        mean = 0.5 * across + 0.5 * middle
        return (self._miss / spare + half * mean) * UP, rows, across


def corrected(
    equations: Equations, place: Floats, moved: int | None = None
) -> Floats | None:
    """Return the configuration next to a place by Newton's method, None without one.

    Only the first `moved` variables are, by default all.
    """
    place = place.copy()
    for _ in range(STEPS):
        turns = np.stack([np.cos(place), np.sin(place)], axis=-1)
        (values,), (slopes,) = equations.real.derivatives(turns[None], 1)
        change, *_ = np.linalg.lstsq(slopes[:, :moved], -values, rcond=1e-13)
        place[:moved] += change
        size = np.max(np.abs(change))
        if not size < 1.0:
            return None
        if size < 1e-11:
            break
    return place if np.max(np.abs(values)) < 1e-10 else None
