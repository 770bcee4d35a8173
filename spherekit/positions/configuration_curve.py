"""The configuration curve of a mechanism with one degree of freedom, in its arc length.

Unless curves cross, every configuration that a mechanism can reach without being taken
apart is a point of one curve in the space of its variables. At a dead centre of an input
the curve continues smoothly. On a closed curve everything is a periodic function of the arc
length.
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
from spherekit.numerics.zeros import Zeros, find_zeros
from spherekit.positions.curve_segment import (
    CurvePoints,
    bordered,
    bordered_reciprocal_condition,
    correct,
    curve_points,
    interpolate_between,
)
from spherekit.positions.input_revolutions import less_periods, whole_laps
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_closure import Closure
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS

ON_CURVE_DISTANCE_RAD = 1e-7
"""A configuration that is nearer to a curve than this is on the curve.

Larger: curves that pass each other closely are taken for one. Smaller: configurations near
crossings, which are less accurate, are followed as curves of their own.
"""
MAX_SAGITTA_RATIO = 0.3
"""Largest distance of a curve from the chord of two nodes, relative to the chord.

Larger: more chords are examined for each configuration. Smaller: configurations on strongly
curved segments are not recognised.
"""
CHORD_OVERHANG = 0.01
"""A projection may be outside its chord by this part of the chord, because of rounding.

Smaller: configurations at nodes can be missed. Larger: more chords are examined.
"""
MAX_PREDICTION_MISS_RATIO = 0.05
"""Largest distance of an interpolated point from the curve, relative to the chord.

Larger: Newton's method may lead to another curve. Smaller: a point that was found is NaN.
"""
CONFIGURATIONS_PER_BLOCK = 64
"""Number of configurations that are compared with all chords at once.

Larger: more memory. Smaller: slower.
"""
MIN_VARIATION_RAD = 1e-7
"""A variable that changes by less along a whole curve is constant on it."""
POINT_ROUNDING_FACTOR = 8.0
"""Rounding error of a point, in units of EPS over the reciprocal condition number."""

CurveFunction = Callable[[CurvePoints], tuple[Floats, Floats]]
"""Takes n points of a curve; returns a function and its derivative with respect to s, both
(n,)."""


@dataclass(frozen=True)
class ChordProjections:
    """Projections of configurations on nearby chords of a curve.

    A chord is the straight line between successive points of the curve, in the space of all
    variables. A configuration that is near several chords occurs several times.

    Attributes
    ----------
    configurations
        (m,) indices of the configurations.
    chords
        (m,) indices of the chords.
    offsets
        (m, variables) configurations minus starts of the chords (rad), less whole periods
        of the variables.
    distances_along
        (m,) distances (rad) from the starts of the chords to the projected configurations,
        measured along the chords, from 0 to the chord length.
    """

    configurations: Indices
    chords: Indices
    offsets: Floats
    distances_along: Floats

    def select(self, chosen: Bools) -> "ChordProjections":
        """Return some of the m projections."""
        return ChordProjections(
            configurations=self.configurations[chosen],
            chords=self.chords[chosen],
            offsets=self.offsets[chosen],
            distances_along=self.distances_along[chosen],
        )


@dataclass(frozen=True)
class Chords:
    """The straight segments (chords) between successive computed points of a curve.

    The curve lies in the space of the pair variables.

    Attributes
    ----------
    nodes
        k computed points of the curve, in order along it.
    """

    nodes: CurvePoints

    @cached_property
    def chord_lengths(self) -> Floats:
        """(k - 1,) lengths of the chords (rad)."""
        return np.linalg.norm(np.diff(self.nodes.values, axis=0), axis=1)

    @cached_property
    def directions(self) -> Floats:
        """(k - 1, variables) unit vectors along the chords."""
        return np.diff(self.nodes.values, axis=0) / self.chord_lengths[:, None]

    def predict(self, which: Indices, fractions: Floats) -> Floats:
        """Return predicted points (n, variables) of the curve (rad).

        A chord is the straight segment between two computed points of the curve. The
        predicted points are on polynomials that have the positions and the first two
        derivatives of the curve at these two points.

        Parameters
        ----------
        which
            (n,) indices of chords.
        fractions
            (n,) positions along these chords, from 0 at the start to 1 at the stop. The
            predicted point is in the plane normal to the chord at this position.
        """
        starts = self.nodes.rows(which)
        stops = self.nodes.rows(which + 1)
        return interpolate_between(starts, stops, fractions)

    def project(self, values: Floats, periods: Floats) -> ChordProjections:
        """Return the chords that are near configurations, with the projections on them.

        A chord is the straight line between two successive nodes of the curve, in the space
        of the variables. A chord is near if the configuration is close to its line,
        compared with the length of the chord, and the projection is between its ends.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).
        periods
            (variables,) growth of each variable (rad) after which the configuration is the
            same again, such as a full revolution.

        Returns
        -------
        The m pairs of a configuration and a chord near it. Configurations that are near no
        chord have no entry.
        """
        # Configurations are compared with all chords, in blocks to limit the memory. Each
        # list has one array of the result for each block. An offset leads from the start of
        # a chord to a configuration, less whole periods.
        configurations = []
        chords = []
        offsets = []
        # There is at least one block, so that there are arrays to join.
        for first in range(0, max(len(values), 1), CONFIGURATIONS_PER_BLOCK):
            block = values[first : first + CONFIGURATIONS_PER_BLOCK]
            row, chord, offset = self._find_near_chords(block, periods)
            configurations.append(first + row)
            chords.append(chord)
            offsets.append(offset)
        # The m pairs of a configuration and a chord near it, from all blocks.
        chord_indices = np.concatenate(chords)
        all_offsets = np.concatenate(offsets)
        # Components of the offsets along the chords, whose unit vectors are `directions`.
        distances = np.vecdot(all_offsets, self.directions[chord_indices])
        return ChordProjections(
            configurations=np.concatenate(configurations),
            chords=chord_indices,
            offsets=all_offsets,
            distances_along=np.clip(distances, 0.0, self.chord_lengths[chord_indices]),
        )

    def _find_near_chords(
        self, values: Floats, periods: Floats
    ) -> tuple[Indices, Indices, Floats]:
        """Return the pairs of a configuration and a chord of the curve that is near it.

        A chord is the straight line between two successive nodes (computed points) of the
        curve, in the space of the variables. `project` computes from these pairs where the
        configurations are along the chords.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).
        periods
            (variables,) growth of each variable (rad) after which the configuration is the
            same again.

        Returns
        -------
        configurations, chords
            (m,) index of the configuration and of the chord of each pair.
        offsets
            (m, variables) configurations minus starts of the chords (rad), less whole
            periods.
        """
        half_chords = 0.5 * np.diff(self.nodes.values, axis=0)
        middles = self.nodes.values[:-1] + half_chords
        # Differences of the configurations from the middles of all chords, less whole
        # periods. The axes are configuration, chord, variable. At a near chord, a
        # difference is about half a chord at most. This is far less than half a period, so
        # the number of periods is certain.
        from_middles = less_periods(values[:, None] - middles, periods)
        from_starts = from_middles + half_chords
        # Components along the chord and across it. `directions` are unit vectors along the
        # chords.
        along = np.vecdot(from_starts, self.directions)
        across = max_abs(from_starts - along[..., None] * self.directions, axis=2)
        # The curve deviates from its chord by at most `MAX_SAGITTA_RATIO` of the chord. A
        # configuration within `ON_CURVE_DISTANCE_RAD` of the curve is on it.
        is_near = across < MAX_SAGITTA_RATIO * self.chord_lengths + ON_CURVE_DISTANCE_RAD
        # The projection must be between the ends of the chord, from 0 to 1 of its length,
        # with a small overhang on both sides for rounding errors.
        is_near &= np.abs(along / self.chord_lengths - 0.5) < 0.5 + CHORD_OVERHANG
        row, chord = np.nonzero(is_near)
        return row, chord, from_starts[row, chord]


@dataclass(frozen=True)
class ArcCurve(Chords):
    """A curve of configurations of a mechanism, in the space of the pair variables.

    The curve is stored as nodes (computed points) between which every step was verified.

    Attributes
    ----------
    nodes
        k points in order of arc length s. A closed curve ends with its first node, where
        the variables may have grown by whole periods (`rise`).
    closure
        The loops of the mechanism.
    periods
        (variables,) growth of each variable (rad) that changes nothing: one revolution, the
        length of a closed profile on which a contact slides, or the least common multiple
        of the lengths of two wheels. Infinite for open profiles, for wheels whose lengths
        have no rational ratio, and for variables with limits of the caller.
    closed
        Whether the curve closes.
    ends
        Why the curve ends at s = 0 and at s = `length`. OK if it is closed, or if a limit
        of the caller or the greatest length was reached. Otherwise OFF_PROFILE, CURVATURE,
        MODE_LOST, or AT_SINGULARITY where two curves cross.
    """

    closure: Closure
    periods: Floats
    closed: bool
    ends: tuple[Status, Status]

    @cached_property
    def starts(self) -> Floats:
        """(k,) sum of the chord lengths up to each node (rad), the parameter u."""
        return np.concatenate([[0.0], np.cumsum(self.chord_lengths)])

    def _evaluate_parameter(self, u: Floats) -> tuple[CurvePoints, Indices]:
        """Return the points of the curve at parameters u (n,), and their chords (n,).

        The parameter u is the length along the chords: the straight lines between
        successive nodes (computed points). This length is cheaper to compute than the arc
        length.
        """
        # `starts` has the parameters of the nodes. The chord of u is the last one that
        # begins before it.
        which = np.searchsorted(self.starts, u) - 1
        which = np.clip(which, 0, len(self.chord_lengths) - 1)
        distances = u - self.starts[which]
        return self._evaluate_on_chords(which, distances), which

    def _evaluate_on_chords(self, which: Indices, distances: Floats) -> CurvePoints:
        """Return the points of the curve with given projections on chords.

        The curve is stored as nodes (points). A chord is the straight line between two
        successive nodes. A point is predicted by interpolation, and corrected by Newton's
        method in the plane normal to the chord.

        Parameters
        ----------
        which
            (n,) indices of chords.
        distances
            (n,) projections on these chords (rad), measured from their starts.

        Returns
        -------
        n exact points; NaN if Newton's method fails or ends far from the interpolation.
        """
        chord_lengths = self.chord_lengths[which]
        directions = self.directions[which]
        prediction = self.predict(which, distances / chord_lengths)
        # The loop equations leave one degree of freedom. One more linear equation selects
        # the point, that of the plane normal to the chord: direction . values = target.
        chord_starts = self.nodes.values[which]
        targets = np.vecdot(directions, chord_starts) + distances
        values, _ = correct(self.closure, prediction, borders=directions, targets=targets)
        # Add the tangents and second derivatives. Of the two opposite tangents, the one
        # with a positive component along the chord is taken.
        points, _ = curve_points(self.closure, values, borders=directions)
        miss = max_abs(values - prediction, axis=1)
        is_valid = points.residual < CLOSURE_TOLERANCE
        is_valid &= miss <= MAX_PREDICTION_MISS_RATIO * chord_lengths
        return points.set_nan_except(is_valid)

    @cached_property
    def table(self) -> ArcLength:
        """The arc length as a function of u, the sum of the chords between the nodes."""
        # A point is a solution of the loop equations and of one equation along the tangent.
        # The smaller the reciprocal condition number of these equations, the larger is the
        # rounding error of the point.
        jacobian = self.closure.linearise(self.nodes.values).jacobian
        equations = bordered(jacobian, self.nodes.tangents)
        at_nodes = bordered_reciprocal_condition(equations, left_inverse(equations))
        # The smaller number at the two ends of each chord counts.
        on_chords = np.minimum(at_nodes[:-1], at_nodes[1:])
        rounding = POINT_ROUNDING_FACTOR * EPS / on_chords
        # `_speed` is the derivative of the arc length with respect to u. The integration
        # does not resolve differences below its rounding errors.
        return integrate_rate(self._speed, self.starts, rounding)

    def _speed(self, u: Floats) -> Floats:
        """Return ds/du of the arc length s at parameters u of any shape.

        The curve is stored as nodes (points). The parameter u is the length along the
        chords (straight lines between successive nodes). The point of the curve at u is
        beside the chord, in the plane normal to it. The rate ds/du is therefore the
        reciprocal of the cosine between tangent and chord.

        Raises
        ------
        SolveError
            If the curve cannot be evaluated at one of the parameters.
        """
        points, chords = self._evaluate_parameter(u.ravel())
        cosine = np.vecdot(points.tangents, self.directions[chords])
        if not all_finite(cosine):
            lost = u.ravel()[~np.isfinite(cosine)][0]
            raise SolveError(
                "Newton's method does not close the loops between two nodes of the "
                f"configuration curve, {lost:.6g} rad from its start (measured along the "
                "chords between nodes)"
            )
        return (1.0 / cosine).reshape(u.shape)

    @property
    def length(self) -> float:
        """The arc length of the curve (rad), of one lap if it is closed."""
        return self.table.length

    @cached_property
    def s(self) -> Floats:
        """(k,) arc lengths of the nodes (rad)."""
        return self.table.evaluate_at_edges(self.starts)

    @cached_property
    def winding(self) -> Floats:
        """(variables,) number of periods in one lap, zero on an open curve."""
        return np.round(self.rise / self.periods)

    @cached_property
    def rise(self) -> Floats:
        """(variables,) growth of the variables in one lap (rad), zero on an open curve."""
        growth = self.closed * (self.nodes.values[-1] - self.nodes.values[0])
        # After a lap the configuration is the same, so the growth is whole periods. Only
        # rounding errors differ.
        return whole_laps(growth, self.periods)

    def returns_after(self, variable: int, period: float) -> float:
        """Return the growth of a variable after which the same configurations return.

        From it callers find how often parts of the curve are repeated in a range of the
        variable. The result is infinite if no such growth is known.

        Parameters
        ----------
        variable
            Index of the variable.
        period
            Growth (rad) of the variable after which all configurations of the mechanism
            return: 2 pi if no wheels roll on each other. Infinite if wheels follow the
            variable by gear ratios and no such growth is known. NaN if wheels roll on each
            other, but none follows the variable by a gear ratio.
        """
        if np.isfinite(period):
            return period
        # On a closed curve, configurations return after each lap (round). `rise` is the
        # growth of each variable in one lap, and zero on an open curve.
        growth_in_lap = abs(self.rise[variable])
        if growth_in_lap != 0.0:
            return growth_in_lap
        # The variable has no growth in a lap, or the curve is open. On a closed curve, the
        # angle plus 2 pi is the same position if no wheel counts revolutions of the
        # variable. On an open curve no growth is known.
        no_wheel_follows = np.isnan(period)
        if self.closed and no_wheel_follows:
            return TURN
        return np.inf

    def rests(self, variable: int) -> bool:
        """Return whether a variable is constant along the whole curve."""
        return bool(np.ptp(self.nodes.values[:, variable]) < MIN_VARIATION_RAD)

    def at(self, s: ArrayLike) -> CurvePoints:
        """Return the points of the curve at arc lengths s (n,) in rad, in any order.

        A closed curve continues lap after lap, and its variables grow by `rise` in each
        lap. Beyond the ends of an open curve the points are NaN.
        """
        s = np.atleast_1d(np.asarray(s, dtype=float))
        # Whole laps, which are 0 on an open curve, and the arc length within the last lap.
        laps = self.closed * np.floor(s / self.length)
        rest = s - laps * self.length
        # On the curve, `rest` is from 0 to 1 of the length, apart from rounding errors.
        is_inside = np.abs(rest / self.length - 0.5) <= 0.5 + 1e-12
        # The curve is evaluated by another parameter, the length u along the straight lines
        # between its nodes. `table` has the arc length as a function of u.
        u = self.table.invert(np.where(is_inside, rest, 0.0))
        points, _ = self._evaluate_parameter(u)
        points.values[:] += np.outer(laps, self.rise)
        return points.set_nan_except(is_inside)

    def locate(self, function: CurveFunction, variable: int | None = None) -> Zeros:
        """Return all zeros of a function along the curve.

        Parameters
        ----------
        function
            Takes n points of the curve. Returns the values of the function and its
            derivatives with respect to the arc length, both (n,).
        variable
            Index of a variable, if the function depends only on this variable. If the
            variable is constant along the curve, no zeros are returned, because the
            function is constant.

        Returns
        -------
        Arc lengths (rad) of the zeros: in [0, length) on a closed curve, in [0, length] on
        an open one.
        """
        if variable is not None and self.rests(variable):
            return Zeros(np.zeros(0), np.zeros(0, dtype=bool))
        # Zeros are searched between the arc lengths `s` of the nodes.
        zeros = find_zeros(lambda s: function(self.at(s)), self.s)
        if self.closed:
            # A zero at the point where the curve begins and ends may be found twice.
            return zeros.merge_seam(self.length)
        return zeros

    def dead_points(self, variable: int) -> Zeros:
        """Return all arc lengths s at which a pair variable v is stationary: dv/ds = 0.

        At these places the pair stops for a moment. The result is empty if the variable is
        constant along the whole curve.
        """

        def slope_and_bend(points: CurvePoints) -> tuple[Floats, Floats]:
            """Return the derivatives dv/ds and d2v/ds2 of the variable v."""
            return points.tangents[:, variable], points.bends[:, variable]

        return self.locate(slope_and_bend, variable)

    def find_value(self, variable: int, value: float, period: float | None = None) -> Zeros:
        """Return all arc lengths s at which a variable has a certain value.

        The arc length (rad) is measured in the space of all variables.

        Parameters
        ----------
        variable
            Index of the variable.
        value
            The value (rad). Values that differ by whole periods count as equal.
        period
            The period (rad), by default that of `periods`.

        Returns
        -------
        Arc lengths (rad) with a mark for double zeros, at which the variable turns back.
        The result is empty if the variable is constant along the whole curve.
        """
        if period is None:
            period = self.periods[variable]

        def periodic_difference(points: CurvePoints) -> tuple[Floats, Floats]:
            """Return period / pi sin(pi difference / period), and its derivative d/ds.

            The difference is the variable minus the searched value. The function is zero
            where the difference is a whole number of periods, so all such places are found.
            """
            # NumPy's sinc(x) is sin(pi x) / (pi x), and 1 at x = 0. The product below is
            # the sine above, and the difference itself for an infinite period.
            difference = points.values[:, variable] - value
            slope = np.cos(np.pi / period * difference) * points.tangents[:, variable]
            return difference * np.sinc(difference / period), slope

        # `locate` finds no zeros if this variable is constant.
        return self.locate(periodic_difference, variable)

    def find(self, values: Floats) -> Floats:
        """Return the arc lengths (n,) of configurations (n, variables) on this curve.

        Variables may differ from the curve by whole periods, such as revolutions. The
        result is NaN for configurations that are not on the curve.
        """
        lengths = nans(len(values))
        # The configurations on the curve, with their projections on chords.
        hits = self._find_on_curve(values)
        # The length along the chords up to each projection. `table` converts this length to
        # the arc length.
        u = self.starts[hits.chords] + hits.distances_along
        lengths[hits.configurations] = self.table.evaluate(u)
        return lengths

    def passes(self, values: Floats) -> Bools:
        """Return a mask (n,) of the configurations (n, variables) on this curve."""
        hits = self._find_on_curve(values)
        return np.isin(np.arange(len(values)), hits.configurations)

    def _find_on_curve(self, values: Floats) -> ChordProjections:
        """Return the projections, on chords, of the configurations that are on the curve.

        A chord is the straight line between two successive nodes (stored points) of the
        curve. Callers learn from the projections which of the configurations
        (n, variables) are on the curve, and find their arc lengths. A configuration at a
        node can have a projection on each of the two chords that meet there.
        """
        # A variable can grow by a period without a change of the configuration: an angle by
        # a revolution, an arc length by the circumference of its profile. `project`
        # subtracts whole periods from the offsets, which lead from the start of a chord to
        # a configuration.
        projections = self.project(values, self.periods)
        # For each projection, the point of the curve with the same position on the chord. A
        # configuration is on the curve if it is equal to this point. Both are compared by
        # their offsets from the start of the chord.
        curve_points = self._evaluate_on_chords(
            projections.chords, projections.distances_along
        )
        chord_starts = self.nodes.values[projections.chords]
        offsets_of_curve = curve_points.values - chord_starts
        deviations = max_abs(offsets_of_curve - projections.offsets, axis=1)
        return projections.select(deviations < ON_CURVE_DISTANCE_RAD)

    def wrapped(self, differences: Floats) -> Floats:
        """Return differences (..., variables) in rad without their whole periods."""
        return less_periods(differences, self.periods)
