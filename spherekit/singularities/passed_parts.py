"""Parts of curves of configurations that a simulation passes.

A curve consists of the configurations that a mechanism with one input can reach. A
simulation has rows (samples) on one or several curves, and passes from curve to curve at
crossings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats, Indices, Integers
from spherekit.geometry.vectors import nans
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.input_revolutions import whole_laps
from spherekit.singularities.singular_point import SingularPoint

CROSSING_TOLERANCE_RAD = 1e-3
"""Ends of curves whose inputs differ by less can be at one passage of a crossing. Curves
end about 1e-4 rad before a crossing at most. Larger: another end of the same curve may be
taken; smaller: no end."""


@dataclass(frozen=True)
class SimulatedRows:
    """The n rows (samples) of a simulation, in the order of time.

    Attributes
    ----------
    curve, s
        (n,) index of the curve of configurations on which each row is, -1 if it is on none,
        and (n,) its arc length on the curve (rad).
    q
        (n,) inputs (rad), including whole revolutions.
    assembly_mode
        (n,) number of the assembly mode (way to assemble the mechanism).
    crossing
        (n,) index of the crossing of curves at which the row is, -1 if it is at none.
    """

    curve: Integers
    s: Floats
    q: Floats
    assembly_mode: Integers
    crossing: Integers


@dataclass(frozen=True)
class PassedPart:
    """A part of one curve of configurations that a simulation passes without leaving it.

    Curves end a little before the points at which they cross. If the simulation passes a
    crossing, the part reaches to the end of its curve.

    Attributes
    ----------
    curve
        Index of the curve.
    start, stop
        Smallest and largest arc length (rad) of the part. On a closed curve arc lengths
        continue from lap to lap.
    lap
        Length of a closed curve (rad), infinite for an open one.
    shift
        Input of the simulation minus input on the curve (rad). It is a multiple of the
        period of the input, after which configurations repeat.
    assembly_modes
        Numbers of the assembly modes (ways to assemble the mechanism) of all rows (samples)
        of the simulation on this part.
    """

    curve: int
    start: float
    stop: float
    lap: float
    shift: float
    assembly_modes: frozenset[int]

    def find_passages(self, s: Floats, tolerance: float = 0.0) -> Floats:
        """Return the arc lengths (k,) at which the simulation passes points of the curve.

        The points are singularities, for example. The part may extend over several laps of
        a closed curve, and then passes a point once in each lap.

        Parameters
        ----------
        s
            (n,) arc lengths (rad) of the points. On a closed curve they may be in any lap.
        tolerance
            Points beyond an end of the part by at most this arc length (rad) count as
            passed. The result has the end itself for them.
        """
        if np.isfinite(self.lap):
            # The points are repeated in all laps of the part, and in one more lap at each
            # end. There, points can be within the tolerance of the end.
            first_lap = np.floor(self.start / self.lap) - 1.0
            last_lap = np.floor(self.stop / self.lap) + 1.0
            laps = np.arange(first_lap, last_lap + 1.0)
            s = np.add.outer(self.lap * laps, np.mod(s, self.lap)).ravel()
        is_passed = (s >= self.start - tolerance) & (s <= self.stop + tolerance)
        return np.clip(s[is_passed], self.start, self.stop)


def find_passed_parts(
    rows: SimulatedRows,
    curves: Sequence[ArcCurve],
    crossings: Sequence[SingularPoint],
    driven: int,
    periods: Sequence[float],
) -> list[PassedPart]:
    """Return the parts of curves of configurations that a simulation passes, in order.

    The caller needs them to tell which points of the curves, such as singularities, the
    simulation passes. A part is a range of arc lengths on one curve, from the smallest to
    the largest arc length of the rows on it. A curve ends a little before a crossing, and
    the rows of the simulation may not reach this end. If the simulation passes a crossing,
    the part is therefore extended to the end of the curve.

    Parameters
    ----------
    rows
        The rows of the simulation.
    curves, crossings
        All curves, and the points at which they cross.
    driven
        Index of the variable of the input.
    periods
        For each curve, the growth of the input (rad) after which configurations repeat.
    """
    if not curves:
        return []
    finder = _PartFinder(rows, curves, crossings, driven, periods)
    # A visit is the indices of the rows that are on one part. The part first has the
    # smallest and the largest arc length (rad) of these rows as `start` and `stop`.
    visits = finder.split_into_visits()
    parts = [finder.make_part(visit) for visit in visits]
    for number, (visit, part) in enumerate(zip(visits, parts, strict=True)):
        # The ends (arc lengths, rad) of the curve of this part, at crossings that the
        # simulation passes. First those at crossings at which a row is.
        ends = list(finder.find_ends_at_rows(visits, number))
        # Then the ends at which it passes from the previous part and to the next part.
        # `find_common_ends` returns the end of the earlier part and that of the later part,
        # or an empty list. Only the end of this part is used.
        if number > 0:
            ends += finder.find_common_ends(visits[number - 1], visit)[1:]
        if number + 1 < len(visits):
            ends += finder.find_common_ends(visit, visits[number + 1])[:1]
        start = min([part.start, *ends])
        stop = max([part.stop, *ends])
        parts[number] = replace(part, start=start, stop=stop)
    return parts


@dataclass(frozen=True)
class _PartFinder:
    """Finds the parts of curves that a simulation passes.

    A visit is the indices (k,) of rows that are on one part of a curve. The attributes are
    the parameters of `find_passed_parts`.
    """

    rows: SimulatedRows
    curves: Sequence[ArcCurve]
    crossings: Sequence[SingularPoint]
    driven: int
    periods: Sequence[float]

    def split_into_visits(self) -> list[Indices]:
        """Return the rows on each part, part after part; rows on no curve are left out.

        A simulation leaves a curve at a crossing only. It may go on at the other end of the
        same curve, where the input differs by whole periods.
        """
        (located,) = np.nonzero(self.rows.curve >= 0)
        curve = self.rows.curve[located]
        # On a closed curve, the input may grow by whole periods in each lap.
        is_open = np.array([not self.curves[number].closed for number in curve], dtype=bool)
        is_next_turn = is_open[1:] & (np.diff(self._shifts[located]) != 0.0)
        (last_rows,) = np.nonzero((np.diff(curve) != 0) | is_next_turn)
        visits = np.split(located, last_rows + 1)
        return [visit for visit in visits if len(visit)]

    @cached_property
    def _curve_inputs(self) -> Floats:
        """(n,) inputs on the curves at the rows (rad), NaN for rows on no curve."""
        inputs = nans(len(self.rows.s))
        for number in np.unique(self.rows.curve[self.rows.curve >= 0]):
            (rows,) = np.nonzero(self.rows.curve == number)
            points = self.curves[number].at(self.rows.s[rows])
            inputs[rows] = points.values[:, self.driven]
        return inputs

    @cached_property
    def _shifts(self) -> Floats:
        """(n,) inputs of the rows minus those on the curves (rad): whole periods."""
        periods = np.array(self.periods, dtype=float)[self.rows.curve]
        return whole_laps(self.rows.q - self._curve_inputs, periods)

    def make_part(self, visit: Indices) -> PassedPart:
        """Return the part of a curve that the rows of a visit cover.

        A visit is the indices (k,) of rows that are on one part of a curve. The part ends
        at the rows with the smallest and the largest arc length.
        """
        number = int(self.rows.curve[visit[0]])
        curve = self.curves[number]
        s = self.rows.s[visit]
        shift = float(self._shifts[visit[0]])
        if curve.closed:
            # `s` and the input on the curve are within one lap. Over several laps, `s` has
            # to be continued.
            #
            # `rise` is the change of the input in one lap. In each lap, the input of a row
            # exceeds the input on the curve by one more `rise`. The shift is this
            # difference at the first row, so it is subtracted to count laps from there.
            rise = float(curve.rise[self.driven])
            changes_in_laps = self.rows.q[visit] - self._curve_inputs[visit] - shift
            s = continue_over_laps(s, changes_in_laps, curve.length, rise)
        return PassedPart(
            curve=number,
            start=float(np.min(s)),
            stop=float(np.max(s)),
            lap=curve.length if curve.closed else np.inf,
            shift=shift,
            assembly_modes=frozenset(self.rows.assembly_mode[visit].tolist()),
        )

    def find_ends_at_rows(self, visits: Sequence[Indices], number: int) -> Iterator[float]:
        """Yield the ends of a visited curve at which the simulation has a row (sample).

        A visit is the indices of successive rows on one part of a curve. The caller extends
        this part to the ends that are yielded. Curves end a little before the points at
        which they cross, so a row at a crossing can be beyond the end of its curve.

        Parameters
        ----------
        visits, number
            All visits, and the index of the visit whose curve is searched for ends.

        Yields
        ------
        Arc lengths (rad) of the ends.
        """
        visit = visits[number]
        # The rows of this visit, and the rows between it and the neighbouring visits. The
        # rows between two visits are on no curve. They can be at an end of either curve.
        first = visits[number - 1][-1] + 1 if number > 0 else 0
        is_last_visit = number + 1 == len(visits)
        stop = len(self.rows.s) if is_last_visit else visits[number + 1][0]
        for row in range(first, stop):
            # A row that is at no crossing is at no end.
            for s in self._ends_at_crossing(visit[0], self.rows.crossing[row]):
                miss = self._input_at_end(visit[0], s) - self.rows.q[row]
                # Both ends of the curve may be at this crossing, with nearly equal inputs.
                # The arc length of a row on the curve tells which end is at the row.
                distance = abs(s - self.rows.s[row]) if row in visit else 0.0
                if max(abs(miss), distance) < CROSSING_TOLERANCE_RAD:
                    yield s

    def find_common_ends(self, visit: Indices, next_visit: Indices) -> list[float]:
        """Return the ends of two curves at which a simulation passes between them.

        The caller extends the passed part of each curve to the end of the curve. Curves end
        a little before a crossing, and an end is given by its arc length. A visit is the
        indices (k,) of rows (samples of the simulation) that are on one part of a curve.

        Parameters
        ----------
        visit, next_visit
            Two successive visits, before and behind the crossing.

        Returns
        -------
        The arc lengths (rad) of the end of the first curve and of the end of the second.
        Both ends are at one crossing and have the same input. If several pairs of ends are
        possible, the pair nearest to the last row before and the first row behind the
        crossing is returned. The list is empty if there are none.
        """
        last_row, next_row = visit[-1], next_visit[0]
        # For each possible pair: the sum of the distances from the rows, and both ends.
        candidates: list[tuple[float, list[float]]] = []
        for crossing in range(len(self.crossings)):
            for s in self._ends_at_crossing(last_row, crossing):
                for next_s in self._ends_at_crossing(next_row, crossing):
                    miss = self._input_at_end(last_row, s)
                    miss -= self._input_at_end(next_row, next_s)
                    if abs(miss) < CROSSING_TOLERANCE_RAD:
                        distance = abs(s - self.rows.s[last_row])
                        distance += abs(next_s - self.rows.s[next_row])
                        candidates.append((float(distance), [s, next_s]))
        _, ends = min(candidates, default=(np.inf, []))
        return ends

    def _input_at_end(self, row: int, s: float) -> float:
        """Return the input of the simulation (rad) at an end s of the curve of a row."""
        (values,) = self.curves[self.rows.curve[row]].at(s).values
        return float(values[self.driven] + self._shifts[row])

    def _ends_at_crossing(self, row: int, crossing: int) -> list[float]:
        """Return the ends (rad) of the curve of a row at a crossing, none at index -1."""
        if crossing < 0:
            return []
        places = self.crossings[crossing].places
        return [s for curve, s in places if curve == self.rows.curve[row]]


def continue_over_laps(
    s: Floats, changes_in_laps: Floats, length: float, rise: float
) -> Floats:
    """Return the arc lengths of rows on a closed curve, continued from lap to lap.

    The rows are successive samples of a motion on a closed curve of configurations. Their
    arc lengths begin again in each lap. To make them continuous, the length of the
    curve is added for each whole lap since the first one.

    - If the input changes by `rise` in each lap, this change tells the number of laps.
    - If the input returns in each lap, successive rows are taken to be at most half a lap
      apart.

    Parameters
    ----------
    s
        (n,) arc lengths (rad) within one lap.
    changes_in_laps
        (n,) changes of the input (rad) in the whole laps before each row. They are
        multiples of `rise`, except for rounding. They are not used if `rise` is 0.
    length
        Length of the curve (rad).
    rise
        Change of the input in one lap (rad); 0 if the input returns in each lap.
    """
    if rise != 0.0:
        return s + length * np.round(changes_in_laps / rise)
    # If `s` jumps by more than half a lap, another lap has begun.
    steps_in_laps = np.diff(s) / length
    laps_since_first_row = np.append(0.0, np.cumsum(-np.round(steps_in_laps)))
    return s + length * laps_since_first_row
