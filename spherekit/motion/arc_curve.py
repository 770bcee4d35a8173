"""The configuration curve of a single-DOF mechanism in its own arc length.

Every configuration that a mechanism can reach without being taken apart is a point of
one curve in the space of its variables. Where an input has a dead centre the curve runs
on smoothly, and on a closed curve everything is a periodic function of the arc length.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import Status
from spherekit.motion.segments import CurvePoints, Segments
from spherekit.numeric.chebyshev import PiecewiseChebyshev
from spherekit.numeric.periodic import Periodic
from spherekit.numeric.zeros import Zeros, zeros
from spherekit.sphere.arclength import ArcLength, measure
from spherekit.sphere.rotation import Floats

NEAR = 1e-7
"""Configurations (rad) nearer than this to the curve lie on it."""

Along = Callable[[CurvePoints], tuple[Floats, Floats]]
"""A function along the curve and its derivative by s, both (n,)."""


@final
@dataclass(frozen=True)
class ArcCurve:
    """A configuration curve through verified nodes.

    Attributes
    ----------
    segments
        The nodes and what lies between them; those of a closed curve end with the first
        one, its variables grown by `winding` periods.
    periods
        (variables,) growth of each variable that changes nothing: a turn, the length of
        a closed profile that a contact slides on, the least common length of two that
        roll; infinite for open profiles and lengths without a ratio.
    closed, winding
        Whether the curve closes, and then (variables,) the whole periods of one lap.
    ends
        Why the curve goes no further at s = 0 and at s = `length`: OK if it is closed, or
        a stop or the greatest length was reached; else OFF_PROFILE, CURVATURE,
        AT_SINGULARITY where two curves cross, BRANCH_LOST.
    start
        Number of the node that was given.
    """

    segments: Segments
    periods: Floats
    closed: bool
    winding: NDArray[np.int64]
    ends: tuple[Status, Status]
    start: int

    @property
    def nodes(self) -> CurvePoints:
        """The nodes in order of arc length."""
        return self.segments.nodes

    @cached_property
    def table(self) -> ArcLength:
        """Arc length against the length of the chords."""
        return measure(self.segments, self.segments.starts)

    @property
    def length(self) -> float:
        """The arc length of the curve, of one lap if it is closed (rad)."""
        return self.table.length

    @cached_property
    def s(self) -> Floats:
        """Arc lengths (k,) of the nodes (rad)."""
        return self.table.at_edge(self.segments.starts)

    @cached_property
    def rise(self) -> Floats:
        """Growth (variables,) of the variables in one lap (rad), zero on an open curve."""
        return np.where(self.winding != 0, self.winding * self.periods, 0.0)

    def at(self, s: ArrayLike) -> CurvePoints:
        """Return the curve at arc lengths s (n,) in rad, any order.

        A closed curve goes on lap after lap, its variables growing; off the ends of an
        open one the points are NaN.
        """
        s = np.atleast_1d(np.asarray(s, dtype=float))
        laps = np.floor(s / self.length) if self.closed else np.zeros_like(s)
        rest = s - laps * self.length
        slack = 1e-12 * self.length
        inside = (rest >= -slack) & (rest <= self.length + slack)
        u = self.table.invert(np.where(inside, rest, 0.0))
        points = self.segments.at(u)
        points.values[:] += np.outer(laps, self.rise)
        for array in (points.values, points.tangents, points.bends, points.residual):
            array[~inside] = np.nan
        return points

    def locate(self, function: Along) -> Zeros:
        """Return all zeros along the curve of a function, its derivative by s known.

        Zeros are s in [0, length), or [0, length] on an open curve, to rounding. See
        `spherekit.numeric.zeros` for pairs that are too near to part.
        """
        found = zeros(lambda s: function(self.at(s)), self.s)
        if not self.closed:
            return found
        once = found.places < self.length * (1.0 - 1e-12)
        return Zeros(found.places[once], found.double[once])

    def dead_points(self, variable: int) -> Zeros:
        """Return all s at which a variable stands still: dv/ds = 0."""
        return self.locate(lambda p: (p.tangents[:, variable], p.bends[:, variable]))

    def at_input(self, variable: int, value: float) -> Zeros:
        """Return all s at which a variable has a value (rad), whole periods apart or not.

        Double zeros are those at which the variable turns back.
        """
        period = float(self.periods[variable])
        rate = np.pi / period

        def chord(points: CurvePoints) -> tuple[Floats, Floats]:
            away = points.values[:, variable] - value
            slope = points.tangents[:, variable]
            if rate == 0.0:
                return away, slope
            return np.sin(rate * away) / rate, np.cos(rate * away) * slope

        return self.locate(chord)

    def find(self, values: Floats) -> Floats:
        """Return s (n,) of configurations (n, variables) on this curve, NaN for others.

        Whole periods of the variables do not matter.
        """
        nodes, segments = self.nodes.values, self.segments
        found = np.full(len(values), np.nan)
        for row, given in enumerate(values):
            way = given - nodes
            shift = np.where(
                np.isfinite(self.periods), np.round(way / self.periods) * self.periods, 0.0
            )
            near = int(np.argmin(np.linalg.norm(way - shift, axis=1)))
            for which in {max(near - 1, 0), min(near, len(nodes) - 2)}:
                target = given - shift[near] - nodes[which]
                along = float(target @ segments.directions[which])
                slack = 2.0 * NEAR
                if not -slack <= along <= segments.chords[which] + slack:
                    continue
                along = min(max(along, 0.0), float(segments.chords[which]))
                there = segments.on(np.array([which]), np.array([along])).values[0]
                if np.max(np.abs(there - nodes[which] - target)) < NEAR:
                    found[row] = self._length_at(which, along)
        return found

    def _length_at(self, which: int, along: float) -> float:
        """Return s where the projection on one chord is `along`."""
        u = float(self.segments.starts[which]) + along
        panel = np.searchsorted(self.table.edges, [u], side="right") - 1
        panel = np.clip(panel, 0, len(self.table.edges) - 2)
        low, high = self.table.edges[panel], self.table.edges[panel + 1]
        x = 2.0 * (u - low) / (high - low) - 1.0
        s = self.table.starts[panel] + self.table.within(panel, x)[0]
        return float(s[0])

    def represent(
        self,
        function: Callable[[CurvePoints], Floats] | None = None,
        tolerance: float = 1e-13,
    ) -> Periodic | PiecewiseChebyshev:
        """Return an interpolant in s of a function of the points, (n, m), or of the values.

        Its `error` is measured. On a closed curve it is periodic, the linear growth of
        winding variables apart; on an open one it is a Chebyshev series on equal cells.
        """
        rise = self.rise if function is None else None

        def sample(s: Floats) -> Floats:
            points = self.at(s)
            return points.values if function is None else function(points)

        if self.closed:
            return Periodic.fit(sample, self.length, rise, tolerance)
        return PiecewiseChebyshev.fit(sample, 0.0, self.length, tolerance)
