"""All configuration curves over a range of the only input, proven complete.

The space of all variables is divided into boxes. Near each box that is not proven to be
empty, a configuration is searched, and the curve through it is followed. The curve is
stored as a chain of certified arcs. A certified arc has a box, which is proven to contain
no configurations other than the arc. If in the end every box is empty or inside the box of
an arc or of a crossing of curves, no other configurations exist.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.completeness import Completeness, Guarantee
from spherekit.conventions import TURN
from spherekit.errors import PlanError
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import Ball, centre_float, pi_ball, working_precision
from spherekit.proof.chains import Chain
from spherekit.proof.collinear_loops import Arm, Crossings
from spherekit.proof.construction import (
    Construction,
    find_construction,
    share_input_variable,
)
from spherekit.proof.curve_search import OVERLAPPING, CurveSearch
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.paving import FIRST_ANGLE_RAD, BoxSet, VariableRanges, pave
from spherekit.proof.saddle_arms import Quadrant
from spherekit.proof.saddles import Saddle
from spherekit.proof.stationary_points import StationaryPoints, find_stationary_points
from spherekit.wording import counted

CURVE_PRECISION_BITS = 80
"""Bits of ball centres for curves over a range.

More bits do not help: the tests along curves are in float64.
"""

MAX_CURVE_BOXES = 6_000_000
"""Number of boxes after which none is halved.

Larger: more is decided, in longer times. Smaller: more of the range stays undecided.
"""

SAME_PROVEN_INPUT_RAD = 1e-9
"""Inputs (rad) that differ by less count as one.

Larger: two curves of modes at neighbouring inputs are listed as one. Smaller: one is listed
several times.
"""

SHORTEST_INTERVAL_RAD = 1e-12
"""Length (rad) below which a part of the range gets no number of modes.

Larger: short parts are not listed. Smaller: parts between equal inputs with different
rounding are listed.
"""


class ModeInterval(NamedTuple):
    """A part of the range of the input with the same number of assembly modes throughout.

    Attributes
    ----------
    low, high
        Ends (rad) of the input.
    mode_count
        Number of modes at every input between them.
    """

    low: float
    high: float
    mode_count: int


@dataclass(frozen=True)
class CertifiedCurves:
    """The configuration curves over a range of the only input, as far as they are proven.

    Each configuration in the range is on a chain (curve), on an arm (branch) of a crossing,
    or in one of the undecided boxes.

    Attributes
    ----------
    decimal_mechanism
        The mechanism with its decimal sizes.
    construction
        The order in which the links are placed, with the indices of the variables.
    equations
        The equations of the mechanism for this order.
    range_text
        Ends of the range as decimal numbers in the unit of the file.
    low, high
        Ends of the range (rad).
    is_full_cycle
        Whether the range is exactly one cycle: the turns of the input after which all
        wheels have their initial angles again. Without wheels a cycle is one turn.
    chains
        The curves. A chain is a row of certified arcs: boxes with exactly one arc of a
        curve.
    crossings
        The places where curves cross or nearly do. Four arms, branches of curves, leave
        each place.
    box_count
        Number of boxes that were examined.
    undecided_boxes
        Boxes in the space of all variables that may contain other configurations.
    problems
        Why chains are not whole curves, or may belong to one curve.
    """

    decimal_mechanism: DecimalMechanism
    construction: Construction
    equations: ArcEquations
    range_text: tuple[str, str]
    low: float
    high: float
    is_full_cycle: bool
    chains: Sequence[Chain]
    crossings: Crossings
    box_count: int
    undecided_boxes: BoxSet
    problems: Sequence[str]

    @property
    def input_variable(self) -> int:
        """Index of the variable of the input."""
        return self.construction.unknown_count

    @property
    def cycle_turns(self) -> int:
        """Number of turns of the input after which all wheels are at their initial angles.

        The number is 1 without wheels. The equations use a variable that makes one turn
        while the input makes this number of turns. So the input angle is this number times
        the variable.
        """
        return self.construction.cycle_turns

    def input_angle(self, position: Floats) -> float:
        """Return the input (rad) at a position (v,) in the space of all variables."""
        return position[self.input_variable] * self.cycle_turns

    @cached_property
    def input_stationary_points(self) -> list[StationaryPoints]:
        """For each chain the configurations in which the input is stationary.

        A chain is one configuration curve. The configurations are singularities of type II,
        the dead centres of the input.
        """
        return self.locate_stationary_points(self.input_variable)

    def locate_stationary_points(self, variable: int) -> list[StationaryPoints]:
        """Return for each configuration curve the points at which a variable is stationary.

        The points are singularities: of type I for the variable of an output, of type II
        for the input. A curve is stored as a chain of boxes with one arc each. A point is
        either proven, or it is undecided whether the variable is stationary there. Curves
        along which the variable is constant have no points in the result.
        """
        points_of_chains = []
        with working_precision(CURVE_PRECISION_BITS):
            for chain, is_constant in zip(
                self.chains, self.find_constant_chains(variable), strict=True
            ):
                points = StationaryPoints()
                if not is_constant:
                    points = find_stationary_points(self.equations, chain, variable)
                points_of_chains.append(points)
        return points_of_chains

    @cached_property
    def chain_arms(self) -> list[tuple[Arm | None, Arm | None]]:
        """For each chain the arms on which it begins and ends, None for no arm.

        A chain is a configuration curve. An arm is one of the four branches of curves that
        leave a saddle, a place where curves cross or nearly do.
        """
        return [
            self.crossings.chain_ends(chain.pieces, chain.closed) for chain in self.chains
        ]

    @cached_property
    def has_constant_input(self) -> list[bool]:
        """For each chain whether the input is constant along it.

        A chain is a configuration curve. If the input is constant, the mechanism can move
        along the curve while the input is locked.
        """
        return self.find_constant_chains(self.input_variable)

    def find_constant_chains(self, variable: int) -> list[bool]:
        """Return for each chain whether a variable is exactly constant along it.

        A chain is one configuration curve.
        """
        with working_precision(CURVE_PRECISION_BITS):
            return [
                self.crossings.is_constant(chain.pieces, variable) for chain in self.chains
            ]

    @cached_property
    def undecided_ranges(self) -> list[tuple[float, float]]:
        """Parts (low, high) rad of the input's range in which modes cannot be counted.

        A mode is a way to assemble the mechanism. The number of modes can change where the
        input is stationary along a configuration curve, because the curve turns back there.
        There are three reasons why modes cannot be counted:

        - The search left a box of configuration space undecided.
        - It is not decided whether the input is stationary near a saddle, a place where
          configuration curves cross or nearly do.
        - It is not decided whether the input is stationary in some part of a curve.

        Overlapping parts are joined.
        """
        ranges = []
        # Boxes are in the space of all variables. `input_angle` takes the variable of the
        # input, and multiplies it by the turns of the input in one turn of this variable.
        for centre, half_widths in zip(
            self.undecided_boxes.centres, self.undecided_boxes.radii, strict=True
        ):
            low = self.input_angle(centre - half_widths)
            high = self.input_angle(centre + half_widths)
            ranges.append((low, high))
        # For each saddle the half width of the range of the input's variable in which the
        # input may be stationary, 0 if nothing is undecided.
        saddle_doubts = self.bound_saddle_doubts(self.input_variable)
        for saddle, variable_error in zip(self.saddles, saddle_doubts, strict=True):
            if variable_error > 0.0:
                ranges += self.ranges_around(saddle.centre, variable_error)
        for points in self.input_stationary_points:
            for point in points.undecided:
                ranges += self.ranges_around(point.position, point.error)
        return _join_ranges(ranges)

    def ranges_around(
        self, position: Floats, variable_error: float
    ) -> list[tuple[float, float]]:
        """Return the inputs near a position as intervals (low, high) rad.

        `undecided_ranges` collects these intervals where modes cannot be counted. All links
        return to the same place after a cycle of `cycle_turns` turns of the input. So the
        interval of inputs near the position repeats after each cycle. The result has the
        repetitions that overlap the range of inputs from `low` to `high`.

        Parameters
        ----------
        position
            (v,) values of all variables (rad).
        variable_error
            Largest difference (rad) of the input's variable from its value at the position.
        """
        cycle = self.cycle_turns * TURN
        # The input's variable in the equations is the input divided by `cycle_turns`.
        half_width = variable_error * self.cycle_turns
        if not half_width < 0.5 * cycle:  # also for an infinite or undefined width
            return [(self.low, self.high)]
        middle = self.input_angle(position)
        # The middle of a repetition is `middle` plus whole cycles. The repetition overlaps
        # the range if its middle is between these limits.
        lowest_middle = self.low - half_width - SAME_PROVEN_INPUT_RAD
        highest_middle = self.high + half_width + SAME_PROVEN_INPUT_RAD
        first_cycle = math.ceil((lowest_middle - middle) / cycle)
        last_cycle = math.floor((highest_middle - middle) / cycle)
        middles = [middle + k * cycle for k in range(first_cycle, last_cycle + 1)]
        return [(centre - half_width, centre + half_width) for centre in middles]

    def bound_saddle_doubts(self, variable: int) -> list[float]:
        """Return, for each saddle, a range of a variable in which it may be stationary.

        A saddle is a place where two configuration curves cross or narrowly miss each
        other. Elsewhere near the saddle, the variable is proven not to be stationary.
        Callers count the range as undecided, unless its width is 0.

        Four branches of curves, the arms, leave a saddle. Curves that miss each other bend
        from one arm to another in the central zone of the saddle. The variable may be
        stationary

        - in the central zone, unless the curves are proven to cross, or the variable is
          proven to be monotonic there,
        - on an arm, unless the sign of the rate of the variable is proven there.

        Curves along which the variable is constant are left out.

        Returns
        -------
        For each saddle the half width (rad) of the range. The middle of the range is the
        value of the variable at the centre of the saddle. The half width is 0 if the
        variable can only be stationary at the crossing itself.
        """
        # For each saddle its arms on curves along which the variable is not constant. An
        # arm is named by its quadrant: the signs of the saddle's two coordinates u and v.
        quadrants_of_saddles: list[list[Quadrant]] = [[] for _ in self.saddles]
        for saddle_number, quadrant in self._arms_of_moving_chains(variable):
            quadrants_of_saddles[saddle_number].append(quadrant)
        return [
            _bound_saddle_doubt(saddle, quadrants, variable)
            for saddle, quadrants in zip(self.saddles, quadrants_of_saddles, strict=True)
        ]

    def _arms_of_moving_chains(self, variable: int) -> list[Arm]:
        """Return the arms of saddles that belong to curves along which a variable moves.

        A saddle is a place where configuration curves cross or nearly do. An arm is one of
        the four branches of curves that leave a saddle. The index of the saddle and the
        quadrant of the branch name the arm. A chain is a curve as a row of boxes (products
        of intervals of the variables), each with one arc of the curve. It can begin or end
        on an arm. The caller looks for stationary values of the variable on these arms.
        """
        moving_arms = []
        for arms_at_ends, is_constant in zip(
            self.chain_arms, self.find_constant_chains(variable), strict=True
        ):
            if not is_constant:
                # `None` is an end that is not at a saddle.
                moving_arms += [arm for arm in arms_at_ends if arm is not None]
        return moving_arms

    @property
    def saddles(self) -> list[Saddle]:
        """The saddles, where curves cross or narrowly miss each other."""
        return self.crossings.saddles

    @cached_property
    def crossing_inputs(self) -> list[float]:
        """Inputs (rad) in the range at which curves cross or nearly do, in order."""
        return self._sorted_inputs(saddle.centre for saddle in self.saddles)

    def _sorted_inputs(self, positions: Iterable[Floats]) -> list[float]:
        """Return, in order, the inputs (rad) of the positions (v,) in the range."""
        inputs = (
            self.wrap_into_range(self.input_angle(position)) for position in positions
        )
        return sorted(q for q in inputs if q is not None)

    @cached_property
    def constant_input_values(self) -> list[float]:
        """Inputs (rad) in the range at which a whole curve of configurations exists.

        With the input locked, the mechanism can move along such a curve. Each input is
        listed once.
        """
        # A chain is a curve as a row of pieces. The input is the same in all of them.
        positions_on_constant_curves = [
            chain.pieces[0].centre
            for chain, is_constant in zip(self.chains, self.has_constant_input, strict=True)
            if is_constant
        ]
        inputs: list[float] = []
        for q in self._sorted_inputs(positions_on_constant_curves):
            if not any(self._are_same_input(q, listed_input) for listed_input in inputs):
                inputs.append(q)
        return inputs

    def _are_same_input(self, first: float, second: float) -> bool:
        """Return whether two inputs (rad) are the same, up to rounding and whole cycles.

        A cycle is `cycle_turns` turns of the input, after which all wheels have their
        initial angles again.
        """
        # The input's variable makes one turn in a cycle, and `wrap` removes whole turns.
        variable_difference = abs(wrap((first - second) / self.cycle_turns))
        return bool(variable_difference <= SAME_PROVEN_INPUT_RAD / self.cycle_turns)

    def wrap_into_range(self, q: float) -> float | None:
        """Return an input (rad), shifted by whole cycles into the range, or None.

        All links return to the same place after a cycle of the input. The result is None if
        no shift leads into the range.
        """
        period = self.cycle_turns * TURN
        wrapped = self.low + np.remainder(q - self.low, period)
        # If the range is a full cycle, its end means the same configurations as its start.
        # An input at the end is replaced by the start.
        if self.is_full_cycle and wrapped > self.high - SAME_PROVEN_INPUT_RAD:
            wrapped -= period
        # An input just below `low`, by rounding only, was shifted to the end of the cycle.
        # So the value one cycle lower is tried, too.
        for candidate in (wrapped, wrapped - period):
            if (
                self.low - SAME_PROVEN_INPUT_RAD
                <= candidate
                <= self.high + SAME_PROVEN_INPUT_RAD
            ):
                return candidate
        return None

    @cached_property
    def turning_points(self) -> list[float]:
        """Inputs (rad) in the range at which two modes meet and end, in order."""
        return self._sorted_inputs(
            point.position
            for points in self.input_stationary_points
            for point in points.proven
        )

    def count_modes_at(self, q: float) -> int:
        """Return the number of modes at an input (rad) that is not a turning point."""
        variable = q / self.cycle_turns
        # A path passes the input once for each change of the number of whole turns.
        turn_numbers = (np.floor((path - variable) / TURN) for path in self.input_paths)
        return int(sum(np.sum(np.abs(np.diff(turns))) for turns in turn_numbers))

    @cached_property
    def input_paths(self) -> list[Floats]:
        """For each configuration curve the input's variable (rad) at points along it.

        `count_modes_at` counts how often the curves pass an input. Each passage is one
        mode. The listed points are enough for this, because the variable is monotonic
        between them.

        A curve is stored as a chain of boxes in the space of all variables. Each box
        contains one arc (piece) of the curve. The points are the centres of the boxes, all
        stationary points of the variable, and the saddles at the ends of the chain. A
        saddle is a place where curves cross or nearly do.

        The variable is not reduced to one turn: it continues to grow or fall over whole
        turns. Curves along which the input is constant are left out.
        """
        paths = []
        for chain, points, arms, is_constant in zip(
            self.chains,
            self.input_stationary_points,
            self.chain_arms,
            self.has_constant_input,
            strict=True,
        ):
            if is_constant:
                continue
            positions = _list_positions(chain, points)
            # An arm is a branch of the curves that leave a saddle. Each end of the chain
            # has an arm, or None if this end is at no saddle.
            first_arm, last_arm = arms
            if first_arm is not None:
                positions.insert(0, self._saddle_centre(first_arm))
            if last_arm is not None:
                positions.append(self._saddle_centre(last_arm))
            variable = np.array(positions)[:, self.input_variable]
            # Neighbouring points differ by much less than half a turn. So `wrap` gives the
            # true changes, and their sum includes whole turns.
            changes = wrap(np.diff(variable))
            paths.append(np.cumsum([variable[0], *changes]))
        return paths

    def _saddle_centre(self, arm: Arm) -> Floats:
        """Return the centre (v,) rad of the saddle to which an arm belongs."""
        saddle_number, _quadrant = arm
        return self.saddles[saddle_number].centre

    @cached_property
    def intervals(self) -> list[ModeInterval]:
        """The parts of the range of the input, each with its number of assembly modes.

        An assembly mode is one way to assemble the mechanism at a given value of the input.
        Each mode is a point of a configuration curve. The range is cut where the number can
        change (`_find_cuts`). Undecided parts, in which modes may be missing, are left out.
        The list is empty if one curve may have been found twice, because its modes would be
        counted twice.
        """
        if OVERLAPPING in self.problems:
            return []
        shortest = self._shortest_interval()
        intervals = []
        for low, high in pairwise([self.low, *self._find_cuts(), self.high]):
            middle = 0.5 * (low + high)
            if high - low > shortest and not self._is_undecided(middle):
                intervals.append(ModeInterval(low, high, self.count_modes_at(middle)))
        return intervals

    def _find_cuts(self) -> list[float]:
        """Return the inputs (rad) at which the number of modes may change, in order.

        A mode is a way to assemble the mechanism. `intervals` cuts the range of the input
        at these inputs, and counts the modes between them. Inputs at the ends of the range
        are left out.
        """
        # In an undecided part of the range modes may be missing.
        undecided_ends = [end for part in self.undecided_ranges for end in part]
        inputs = (
            # Two modes meet and vanish where the input turns back along a curve.
            *self.turning_points,
            # Two modes meet where curves cross.
            *self.crossing_inputs,
            # At all points of some curves, the input has the same value.
            *self.constant_input_values,
            *undecided_ends,
        )
        first = self.low + SHORTEST_INTERVAL_RAD
        last = self.high - SHORTEST_INTERVAL_RAD
        return sorted(q for q in inputs if first < q < last)

    def _shortest_interval(self) -> float:
        """Return the length (rad) that an interval of the input must exceed.

        `intervals` cuts the range of the input, for example at turning points, where the
        input turns back. It counts the assembly modes in each interval between two cuts.
        The position of a turning point has an error. Two turning points that are nearer
        than twice the largest error may coincide, and then no interval is between them. So
        `intervals` leaves out shorter intervals. The result is at least
        `SHORTEST_INTERVAL_RAD`.
        """
        # The equations contain the input divided by `cycle_turns`. `point.error` is the
        # error of this quotient, so the error of the input is `cycle_turns` times as large.
        input_errors = [
            point.error * self.cycle_turns
            for points in self.input_stationary_points
            for point in points.proven
        ]
        return max(2.0 * max(input_errors, default=0.0), SHORTEST_INTERVAL_RAD)

    def _is_undecided(self, q: float) -> bool:
        """Return whether modes may be missing at an input (rad) in the range."""
        # Over a full cycle undecided parts may reach beyond the ends of the range.
        period = self.cycle_turns * TURN
        equivalent_inputs = (q - period, q, q + period) if self.is_full_cycle else (q,)
        return any(
            start <= equivalent_input <= end
            for start, end in self.undecided_ranges
            for equivalent_input in equivalent_inputs
        )

    @cached_property
    def completeness(self) -> Completeness:
        """What is guaranteed about the configuration curves, and why.

        A curve that was found is a chain of pieces: boxes that contain exactly one arc of
        the curve each. There are three levels:

        - `TO_BOX`: parts of the range are undecided. Along the input, a missing curve
          extends over the widest of these parts at most.
        - `COMPONENT`: no part is undecided, but the search reported a problem, which is
          stated. Whole curves may be missing.
        - `CERTIFIED`: nothing is missing.
        """
        # `saddles` are places where curves cross or nearly do.
        piece_count = sum(len(chain.pieces) for chain in self.chains)
        facts = (
            f"{counted(len(self.chains), 'curve')} of {piece_count} pieces with one arc "
            f"each, {self.box_count} boxes{_describe_saddles(self.saddles)}"
        )
        # If one curve may have been found twice, the property `intervals` counts no modes.
        # The text begins with this problem, which explains why.
        if OVERLAPPING in self.problems:
            facts = f"{OVERLAPPING}; {facts}"
        undecided_ranges = self.undecided_ranges
        if undecided_ranges:
            widths = [high - low for low, high in undecided_ranges]
            # The ends of a full cycle are the same input, so parts there are joined.
            start, first_end = undecided_ranges[0]
            last_start, end = undecided_ranges[-1]
            is_at_both_ends = (
                start <= self.low + SHORTEST_INTERVAL_RAD
                and end >= self.high - SHORTEST_INTERVAL_RAD
            )
            if self.is_full_cycle and is_at_both_ends:
                joined_width = (first_end - self.low) + (self.high - last_start)
                widths.append(min(joined_width, self.high - self.low))
            widest_box = 2.0 * np.max(self.undecided_boxes.radii, initial=0.0)
            are = "is" if len(undecided_ranges) == 1 else "are"
            return Completeness(
                Guarantee.TO_BOX,
                f"{counted(len(undecided_ranges), 'part')} of the range {are} undecided; "
                f"elsewhere {facts}",
                max(*widths, widest_box),
            )
        if self.problems:
            # `facts` begins with the problem `OVERLAPPING`. Of all other problems the text
            # has only the first one, so that it stays short.
            others = [problem for problem in self.problems if problem != OVERLAPPING]
            return Completeness(Guarantee.COMPONENT, "; ".join([*others[:1], facts]))
        return Completeness(Guarantee.CERTIFIED, f"all configurations; {facts}")


def _list_positions(chain: Chain, points: StationaryPoints) -> list[Floats]:
    """Return the centres of the pieces of a chain, and its stationary points, in order.

    A chain stores a configuration curve as a row of boxes. Each box contains one arc
    (piece) of the curve. A variable, such as that of the input, is stationary where its
    rate along the curve is zero. Between two neighbouring positions it is monotonic, so the
    caller can count how often it passes a value.

    Parameters
    ----------
    chain
        The chain. The positions on a closed chain end with the first centre once more.
    points
        Configurations in which the variable is stationary, proven or undecided.

    Returns
    -------
    Positions (v,) rad of all variables, in the order along the curve.
    """
    all_points = (*points.proven, *points.undecided)
    positions: list[Floats] = []
    for number, (piece, _next_piece) in enumerate(chain.successive_pieces):
        # The stationary points between the centres of this piece and the next one.
        stationary_positions = [
            point.position for point in all_points if point.piece == number
        ]
        # The first coordinate of a piece is the position along its arc.
        stationary_positions.sort(key=lambda position: piece.coordinates(position)[0])
        positions += [piece.centre, *stationary_positions]
    last_piece = chain.pieces[0] if chain.closed else chain.pieces[-1]
    positions.append(last_piece.centre)
    return positions


def _bound_saddle_doubt(
    saddle: Saddle, quadrants: Iterable[Quadrant], variable: int
) -> float:
    """Return the size of the region around a saddle in which a variable may be stationary.

    Elsewhere near the saddle, the variable is proven not to be stationary. The region
    remains undecided, so the caller reports it.

    Parameters
    ----------
    saddle
        A place where two curves of configurations cross or narrowly miss each other. Curves
        that miss each other bend in the central zone of the saddle.
    quadrants
        The arms on which the variable is not constant. The four arms of a saddle are the
        branches of curves that leave it. Each arm is in another quadrant, given by the
        signs of two coordinates.
    variable
        Index of the variable.

    Returns
    -------
    The largest change (rad) of the variable from the centre of the saddle to a point where
    it may be stationary. The change is 0 if the variable can only be stationary at the
    crossing itself.
    """
    distance = 0.0
    # 1. In the central zone. Curves that are proven to cross (`level_sign` 0) do not bend.
    #    `is_monotonic`: the variable is proven to grow or fall along the bend.
    is_proven_crossing = saddle.level_sign == 0
    if not (is_proven_crossing or saddle.is_monotonic[variable]):
        # Largest change (rad) of the variable from the centre to the end of the zone.
        distance = saddle.central_zone[variable]
    # 2. On the arms outside this zone.
    for quadrant in quadrants:
        # An outward sign is the sign of the rate along the arm; 0 means: not proven.
        has_proven_rate = saddle.outward_signs[quadrant][variable] != 0
        if not has_proven_rate:
            largest_change_on_arm = saddle.reach[quadrant][variable]
            distance = max(distance, largest_change_on_arm)
    return distance


def _join_ranges(ranges: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return ranges (low, high) in order. Ranges that overlap or touch are joined."""
    joined: list[tuple[float, float]] = []
    for low, high in sorted(ranges):
        if joined and low <= joined[-1][1] + SHORTEST_INTERVAL_RAD:
            joined_low, joined_high = joined.pop()
            joined.append((joined_low, max(joined_high, high)))
        else:
            joined.append((low, high))
    return joined


def _describe_saddles(saddles: Sequence[Saddle]) -> str:
    """Return a part of a sentence with the numbers of places where curves cross or miss."""
    parts = []
    # Level signs of a saddle: 0 if curves cross, 1 or -1 if they miss each other, None if
    # neither is proven.
    for words, level_signs in (
        ("cross", (0,)),
        ("miss each other", (1, -1)),
        ("cross, or miss each other,", (None,)),
    ):
        count = sum(saddle.level_sign in level_signs for saddle in saddles)
        if count:
            parts.append(f", which {words} at {counted(count, 'place')}")
    return "".join(parts)


def certify_curves(
    decimal_mechanism: DecimalMechanism,
    range_text: tuple[str, str],
    construction: Construction | None = None,
) -> CertifiedCurves:
    """Return all configuration curves over a range of the only input, as far as proven.

    A cycle is the number of turns of the input after which all wheels have their initial
    angles again; without wheels it is one turn. The range is at most one cycle.

    Parameters
    ----------
    decimal_mechanism
        The mechanism, with one input.
    range_text
        The ends of the range as decimal numbers in the unit of the file.
    construction
        The order of placing the links. By default that with the lowest bound of the number
        of complex modes.

    Raises
    ------
    PlanError
        If proofs do not apply to the mechanism, or if the range is longer than a cycle.
    """
    if construction is None:
        construction = find_construction(decimal_mechanism.structure)
    with working_precision(CURVE_PRECISION_BITS):
        # If wheels follow the input, input and wheels become multiples of one variable.
        if construction.follower_pairs:
            construction = share_input_variable(decimal_mechanism, construction)
        cycle_turns = construction.cycle_turns
        equations = ArcEquations(decimal_mechanism, construction)
        # Ends of the input's variable, which makes one turn in a cycle.
        low, high = (
            decimal_mechanism.input_angle(text) / cycle_turns for text in range_text
        )
        first, last = map(Decimal, range_text)
        # Only in degrees can a decimal number be exactly a whole turn.
        is_full_cycle = decimal_mechanism.in_degrees and last - first == 360 * cycle_turns
        if centre_float(high - low) > TURN and not is_full_cycle:
            raise PlanError(
                f"{decimal_mechanism.mechanism.name}: {first} to {last} is longer than "
                f"{counted(cycle_turns, 'turn')}, after which the motion repeats; give "
                "a range that is not longer"
            )
        search_result = _search_curves(equations, low, high, is_full_cycle)
    return CertifiedCurves(
        decimal_mechanism=decimal_mechanism,
        construction=construction,
        equations=equations,
        range_text=range_text,
        low=centre_float(low) * cycle_turns,
        high=centre_float(high) * cycle_turns,
        is_full_cycle=is_full_cycle,
        chains=search_result.search.chains,
        crossings=search_result.search.crossings,
        box_count=search_result.box_count,
        undecided_boxes=search_result.undecided_boxes,
        problems=search_result.search.problems(),
    )


@dataclass(frozen=True)
class _InputVariableRange:
    """The range of the input's variable in which configuration curves are searched.

    Attributes
    ----------
    start, end
        Smallest and largest value of the variable in the range (rad).
    is_full_cycle
        Whether `start` and `end` are exactly one turn apart. Then every angle is in the
        range.
    """

    start: float
    end: float
    is_full_cycle: bool

    def side(self, variable: float, margin: float) -> int:
        """Return on which side of the range a value (rad) of the input's variable is.

        The result is 1 if the value is above the range by more than the margin (rad), -1 if
        it is below by more than the margin, otherwise 0. The margin lets curves be followed
        a little beyond the range.
        """
        if self.is_full_cycle:
            return 0
        if variable > self.end + margin:
            return 1
        return -1 if variable < self.start - margin else 0


@dataclass(frozen=True)
class _CurveSearchResult:
    """What a search for configuration curves over the whole range has found.

    The search divides the space of all variables into boxes. A box is decided if it is
    proven to be empty, if a known curve covers it, or if it is at a place where curves
    cross or nearly do.

    Attributes
    ----------
    search
        The search, which has the curves that were found.
    box_count
        Number of boxes that were examined.
    undecided_boxes
        The boxes that are not decided. They may contain configurations that are on none of
        the curves.
    """

    search: CurveSearch
    box_count: int
    undecided_boxes: BoxSet


def _search_curves(
    equations: ArcEquations, low: Ball, high: Ball, is_full_cycle: bool
) -> _CurveSearchResult:
    """Search the whole range of the input for curves of configurations.

    The space of all variables is divided into boxes. If a box is not proven to be empty, a
    configuration in or near the box is searched. The curve through this configuration is
    then followed, and stored with boxes around its arcs. A box that lies inside such a box
    of a known curve is not examined further.

    Parameters
    ----------
    equations
        The equations of the mechanism. The input's variable is the last one.
    low, high
        Ends of the input's variable (rad), as balls: numbers with a bound of their error.
    is_full_cycle
        Whether both ends are exactly one turn apart.
    """
    unknown_count = equations.unknown_count
    turn = 2 * pi_ball()
    input_width = turn if is_full_cycle else high - low
    # The box to divide: a full turn of each unknown angle, and the range of the input.
    # Configurations at simple angles such as 0 or 90 deg are frequent. The turn begins at
    # -2.4 rad, so that they are not on the common side of two boxes.
    ranges = VariableRanges(
        low=[*[exact_ball(FIRST_ANGLE_RAD)] * unknown_count, low],
        width=[*[turn] * unknown_count, input_width],
    )

    input_range = _InputVariableRange(centre_float(low), centre_float(high), is_full_cycle)
    # The function `side` states whether a value of the input is above, below or in the
    # range. Curves are followed until they leave the range.
    search = CurveSearch(equations, input_range.side)
    # `pave` divides the box. The function `covers` says which boxes known curves cover.
    # `add_configuration` follows the curve of a new configuration.
    box_count, undecided_boxes = pave(
        equations,
        ranges,
        covers=search.covers,
        add_configuration=search.add_configuration,
        max_boxes=MAX_CURVE_BOXES,
    )
    # Boxes near places where curves cross are decided now.
    return _CurveSearchResult(search, box_count, search.resolve_undecided(undecided_boxes))
