"""The configuration curve of a single-DOF mechanism in its own arc length.

Every configuration that a mechanism can reach without being taken apart is a point of
one curve in the space of its variables. Where an input has a dead centre the curve runs
on smoothly, and on a closed curve everything is a periodic function of the arc length.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN
from spherekit.errors import SolveError
from spherekit.geometry.arc_length import ArcLength, integrate_rate
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.numerics.hermite import quintic_hermite
from spherekit.numerics.zeros import Zeros, find_zeros
from spherekit.positions.curve_segment import (
    LARGEST_MISS,
    CurvePoints,
    bordered,
    bordered_condition,
    correct,
    curve_points,
)
from spherekit.positions.input_revolutions import less_periods, whole_laps
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_closure import Closure
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS

NEAR = 1e-7
"""Configurations (rad) nearer than this to the curve lie on it."""
BESIDE = 0.3
"""A segment of the curve is nowhere farther from its chord than this part of it."""
AT_ONCE = 64
"""Configurations that are looked for on all of a curve at once."""


def between(starts: CurvePoints, stops: CurvePoints, along: Floats) -> Floats:
    """Return quintic Hermite values (n, variables) at parts (n,) of chords, 0 to 1."""
    ways = stops.values - starts.values
    chords = np.linalg.norm(ways, axis=1)
    e = ways / chords[:, None]

    def end(points: CurvePoints) -> tuple[Floats, Floats, Floats]:
        speed = np.vecdot(points.tangents, e)[:, None]
        slope = points.tangents / speed
        swing = np.vecdot(points.bends, e)[:, None]
        return points.values, slope, (points.bends - slope * swing) / speed**2

    return quintic_hermite(end(starts), end(stops), chords, along)


@dataclass(frozen=True)
class Chords:
    """The chords of the curve through k nodes."""

    nodes: CurvePoints

    @cached_property
    def chords(self) -> Floats:
        """Lengths (k - 1,) of the chords (rad)."""
        return np.linalg.norm(np.diff(self.nodes.values, axis=0), axis=1)

    @cached_property
    def directions(self) -> Floats:
        """Unit vectors (k - 1, variables) of the chords."""
        return np.diff(self.nodes.values, axis=0) / self.chords[:, None]

    def predict(self, which: Indices, along: Floats) -> Floats:
        """Return quintic Hermite values (n, variables) at parts of chords (n,), 0 to 1."""
        return between(self.nodes.rows(which), self.nodes.rows(which + 1), along)

    def beside(
        self, values: Floats, periods: Floats
    ) -> tuple[Indices, Indices, Floats, Floats]:
        """Return which configurations (n, variables) lie beside which chords (m,).

        With the ways (m, variables) there from the chords' starts, less whole periods, and
        how far along the chords (m,) that is.
        """
        half = 0.5 * np.diff(self.nodes.values, axis=0)
        middles = self.nodes.values[:-1] + half
        hits = []
        for first in range(0, max(len(values), 1), AT_ONCE):
            away = values[first : first + AT_ONCE, None] - middles
            away = less_periods(away, periods) + half
            along = np.vecdot(away, self.directions)
            off = max_abs(away - along[..., None] * self.directions, axis=2)
            near = off < BESIDE * self.chords + NEAR
            near &= np.abs(along / self.chords - 0.5) < 0.51
            which, chord = np.nonzero(near)
            hits.append((first + which, chord, away[which, chord]))
        row, number, way = (np.concatenate(part) for part in zip(*hits, strict=True))
        along = np.vecdot(way, self.directions[number])
        return row, number, way, np.clip(along, 0.0, self.chords[number])


AT_REST = 1e-7
"""A variable that changes by less (rad) along a whole curve stands still on it."""

Along = Callable[[CurvePoints], tuple[Floats, Floats]]
"""A function along the curve and its derivative by s, both (n,)."""


@dataclass(frozen=True)
class ArcCurve(Chords):
    """A configuration curve through verified nodes.

    Attributes
    ----------
    nodes
        In order of arc length; those of a closed curve end with the first one, its
        variables grown by `winding` periods.
    periods
        (variables,) growth of each variable that changes nothing: a turn, the length of
        a closed profile that a contact slides on, the least common length of two that
        roll; infinite for open profiles and lengths without a ratio.
    closed
        Whether the curve closes.
    ends
        Why the curve goes no further at s = 0 and at s = `length`: OK if it is closed, or
        a stop or the greatest length was reached; else OFF_PROFILE, CURVATURE,
        AT_SINGULARITY where two curves cross, MODE_LOST.
    """

    closure: Closure
    periods: Floats
    closed: bool
    ends: tuple[Status, Status]

    @cached_property
    def starts(self) -> Floats:
        """The lengths u (k,) of the chords up to each node, the curve's parameter."""
        return np.concatenate([[0.0], np.cumsum(self.chords)])

    def _on(self, u: Floats) -> tuple[CurvePoints, Indices]:
        """Return the curve at lengths u (n,) of chords, and which chords (n,) these are."""
        which = np.clip(np.searchsorted(self.starts, u) - 1, 0, len(self.chords) - 1)
        return self._beside(which, u - self.starts[which]), which

    def _beside(self, which: Indices, way: Floats) -> CurvePoints:
        """Return the curve where its projection on the chord `which` (n,) is `way` (n,)."""
        chords = self.chords[which]
        e = self.directions[which]
        guess = self.predict(which, way / chords)
        targets = np.vecdot(e, self.nodes.values[which]) + way
        values, _ = correct(self.closure, guess, e, targets)
        points, _ = curve_points(self.closure, values, e)
        miss = max_abs(values - guess, axis=1)
        good = (points.residual < CLOSURE_TOLERANCE) & (miss <= LARGEST_MISS * chords)
        return points.only(good)

    @cached_property
    def table(self) -> ArcLength:
        """Arc length against the length of the chords."""
        jacobian = self.closure.at(self.nodes.values).jacobian
        equations = bordered(jacobian, self.nodes.tangents)
        condition = bordered_condition(equations, left_inverse(equations))
        rounding = 8.0 * EPS / np.minimum(condition[:-1], condition[1:])
        return integrate_rate(self._speed, self.starts, rounding)

    def _speed(self, u: Floats) -> Floats:
        """Return ds/du at u of any shape."""
        points, which = self._on(u.ravel())
        cosine = np.vecdot(points.tangents, self.directions[which])
        if not all_finite(cosine):
            lost = u.ravel()[~np.isfinite(cosine)][0]
            raise SolveError(
                f"the configuration curve is lost at the length {lost:.6g} rad of its "
                "chords: Newton's method does not close the loops between two nodes"
            )
        return (1.0 / cosine).reshape(u.shape)

    @property
    def length(self) -> float:
        """The arc length of the curve, of one lap if it is closed (rad)."""
        return self.table.length

    @cached_property
    def s(self) -> Floats:
        """Arc lengths (k,) of the nodes (rad)."""
        return self.table.evaluate_at_edges(self.starts)

    @cached_property
    def winding(self) -> Floats:
        """The whole periods (variables,) of one lap, zero on an open curve."""
        return np.round(self.rise / self.periods)

    @cached_property
    def rise(self) -> Floats:
        """Growth (variables,) of the variables in one lap (rad), zero on an open curve."""
        grown = self.closed * (self.nodes.values[-1] - self.nodes.values[0])
        return whole_laps(grown, self.periods)

    def returns_after(self, variable: int, period: float) -> float:
        """Return the growth of a variable with which the curve's configurations return.

        That is `period` where it is finite; where it is not, as with wheels whose rolled
        length does not follow from the variable alone, a closed curve returns all the same
        once it went round. One that swings to and fro is where it was after a turn of the
        variable, if no rolled length depends on it, which a period that is NaN says.
        Infinite if it does not return.
        """
        if np.isfinite(period):
            return period
        once = abs(self.rise[variable])
        if once == 0.0:
            return TURN if self.closed and np.isnan(period) else np.inf
        return once

    def rests(self, variable: int) -> bool:
        """Return whether a variable stands still along the whole curve."""
        return bool(np.ptp(self.nodes.values[:, variable]) < AT_REST)

    def at(self, s: ArrayLike) -> CurvePoints:
        """Return the curve at arc lengths s (n,) in rad, any order.

        A closed curve goes on lap after lap, its variables growing; off the ends of an
        open one the points are NaN.
        """
        s = np.atleast_1d(np.asarray(s, dtype=float))
        laps = self.closed * np.floor(s / self.length)
        rest = s - laps * self.length
        inside = np.abs(rest / self.length - 0.5) <= 0.5 + 1e-12
        points, _ = self._on(self.table.invert(np.where(inside, rest, 0.0)))
        points.values[:] += np.outer(laps, self.rise)
        return points.only(inside)

    def locate(self, function: Along, variable: int | None = None) -> Zeros:
        """Return all zeros along the curve of a function, its derivative by s known.

        Zeros are s in [0, length), or [0, length] on an open curve, to rounding. See
        `spherekit.numerics.zeros` for pairs that are too near to part. None of a function
        of a `variable` that stands still along the whole curve.
        """
        if variable is not None and self.rests(variable):
            return Zeros(np.zeros(0), np.zeros(0, dtype=bool))
        roots = find_zeros(lambda s: function(self.at(s)), self.s)
        return roots.merge_seam(self.length) if self.closed else roots

    def dead_points(self, variable: int) -> Zeros:
        """Return all s at which a variable stands still: dv/ds = 0.

        None if it does so along the whole curve, see `rests`.
        """
        return self.locate(
            lambda p: (p.tangents[:, variable], p.bends[:, variable]), variable
        )

    def at_input(self, variable: int, value: float, period: float | None = None) -> Zeros:
        """Return all s at which a variable has a value (rad), whole periods apart or not.

        `period` is that of `periods` unless it is given. Double zeros are those at which
        the variable turns back. None if it stands still along the whole curve.
        """
        period = self.periods[variable] if period is None else period

        def chord(points: CurvePoints) -> tuple[Floats, Floats]:
            away = points.values[:, variable] - value
            slope = np.cos(np.pi / period * away) * points.tangents[:, variable]
            return away * np.sinc(away / period), slope

        return self.locate(chord, variable)

    def find(self, values: Floats) -> Floats:
        """Return s (n,) of configurations (n, variables) on this curve, NaN for others.

        Whole periods of the variables do not matter.
        """
        lengths = nans(len(values))
        row, number, along = self._hits(values)
        lengths[row] = self.table.evaluate(self.starts[number] + along)
        return lengths

    def passes(self, values: Floats) -> Bools:
        """Return which configurations (n, variables) are on this curve, as `find` does."""
        return np.isin(np.arange(len(values)), self._hits(values)[0])

    def _hits(self, values: Floats) -> tuple[Indices, Indices, Floats]:
        """Return which configurations are on which chords, and where along these."""
        row, number, way, along = self.beside(values, self.periods)
        miss = self._beside(number, along).values - self.nodes.values[number] - way
        hits = max_abs(miss, axis=1) < NEAR
        return row[hits], number[hits], along[hits]

    def wrapped(self, differences: Floats) -> Floats:
        """Return differences of variables (..., variables) less whole periods."""
        return less_periods(differences, self.periods)
