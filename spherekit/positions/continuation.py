"""Base class for following curves by verified steps, many curves side by side.

The steps are tested as `spherekit.positions.verified_steps` describes. After a step that
failed, half the step is tried; after a good one the next may be longer or shorter. A curve
ends when it closes, when a subclass ends it (at a limit, for example), when no step is
accepted, or when it has its greatest length or number of nodes.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.positions.curve_segment import CurvePoints, interpolate_between
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.verified_steps import Verification, extrapolate
from spherekit.status import Status

NEAR_END_RAD = 1e-6
"""A node nearer than this to the start of a lap, or to a limit, has reached it.

Larger: curves end earlier before a limit. Smaller: tiny last steps are tried.
"""
AIMED_CHANGE_RATIO = 0.6
"""The next step aims at this part of the allowed change of the equations.

Larger: more steps fail. Smaller: more steps are necessary.
"""
MIN_LAP_COSINE = 0.8
"""Least cosine between the tangents at the end and at the start of a lap.

Larger: a lap whose tangent turns in its last step is not seen to close. Smaller: a curve
that crosses its start at an angle counts as closed.
"""
UNFINISHED = -1
"""Stands for the status of a curve that has not ended."""
Node = TypeVar("Node", bound=CurvePoints)


@dataclass(frozen=True)
class TriedSteps(Generic[Node]):
    """The results of k steps, one along each of k curves.

    A step predicts a point of the curve and corrects it. Tests show whether it is still on
    the same curve.

    Attributes
    ----------
    nodes
        The points at which the steps end.
    is_verified
        (k,) whether the step passed all tests of `Verification`: the prediction is nearly
        right, and the Jacobian and the tangent of the curve change little.
    changes
        (k,) changes of the Jacobian of the curve in the step, as fractions of a change that
        could make it singular. The length of the next step follows from these numbers.
    """

    nodes: Node
    is_verified: Bools
    changes: Floats


class StepOutcome(NamedTuple):
    """What has become of one step on each of k curves that are followed step by step.

    Attributes
    ----------
    has_failed
        (k,) whether the step was not taken, although the curve has not ended.
    growth
        (k,) factors for the lengths of the next steps; 1 if the step was not taken.
    """

    has_failed: Bools
    growth: Floats


@dataclass
class CurveContinuation(ABC, Generic[Node]):
    """Follows n curves in the space of the pair variables, each in one sense.

    Each curve is followed by steps from node to node (computed points). A step is taken
    only if tests verify that it stays on the same curve.

    Attributes
    ----------
    step_tests
        Limits for the tests of a step.
    smallest_step
        Smallest step (rad). A curve ends at a node from which no step of this length is
        verified.
    same_point_rad
        A curve is closed if it returns to its start up to this distance.
    max_nodes
        Largest number of nodes of a curve after its first one. A curve that reaches it
        ends with `MODE_LOST`.
    start_nodes
        (n) first node of each curve.
    periods
        (variables,) growth of each variable (rad) after which the configuration is the same
        again, such as a revolution.
    max_length
        Length (rad) after which a curve ends.
    max_step
        Longest step (rad).
    last_nodes
        (n) last node of each curve.
    end_status
        (n,) why each curve ends at its last node, as a `Status`, or `UNFINISHED`.
    is_closed
        (n,) whether the last node is the first one again, up to whole periods of variables.
    lengths
        (n,) length of each curve (rad), as the sum of its chords.
    """

    step_tests: ClassVar[Verification]
    smallest_step: ClassVar[float]
    same_point_rad: ClassVar[float]
    max_nodes: ClassVar[int]

    start_nodes: Node
    periods: Floats
    max_length: float
    max_step: float

    def __post_init__(self) -> None:
        """Begin n curves that consist of their first node only."""
        n = len(self.start_nodes.values)
        self.last_nodes = self.start_nodes.rows(np.arange(n))
        self.end_status = np.full(n, UNFINISHED, dtype=np.int8)
        self.is_closed = np.zeros(n, dtype=bool)
        self.lengths = np.zeros(n)
        self._node_counts = np.zeros(n, dtype=np.intp)
        # Curves (k,) and their new nodes (k), step after step.
        self._trail: list[tuple[Indices, Node]] = []

    @abstractmethod
    def try_steps(self, rows: Indices, nodes: Node, distances: Floats) -> TriedSteps[Node]:
        """Try a step on each of some curves (abstract method).

        A subclass computes the ends of the steps, and tests whether they are on the same
        curves, with the limits `step_tests`.

        Parameters
        ----------
        rows
            (k,) indices of the curves.
        nodes
            The k points (nodes) from which the steps start.
        distances
            (k,) lengths of the steps (rad), measured along the tangents at the nodes.

        Returns
        -------
        For each step its end, whether it passed all tests, and the relative change of the
        Jacobian of the curve in the step. The length of the next step follows from this
        change.
        """

    @abstractmethod
    def select_steps(
        self, rows: Indices, steps: Floats, new_nodes: Node, is_verified: Bools
    ) -> Bools:
        """Return a mask (k,) of the verified steps that are taken (abstract method).

        A verified step has passed the tests that its end is still on the same curve. A
        subclass takes no steps beyond its limits, such as the end of a contact profile.
        A subclass may also end curves that reach a limit, by setting their status in
        `end_status`.

        Parameters
        ----------
        rows
            (k,) indices of the curves.
        steps
            (k,) lengths of the steps (rad).
        new_nodes
            The k points (nodes) at which the steps end.
        is_verified
            (k,) whether the step is verified.
        """

    @abstractmethod
    def end_finished_curves(self, rows: Indices) -> None:
        """Set the status of curves (k,) that must not continue from their last node."""

    @abstractmethod
    def end_stuck_curve(self, row: int) -> None:
        """Set the status of a curve that no verified step continues."""

    def start_after_periods(self, starts: Node, nodes: Node, values: Floats) -> Node:
        """Return the first nodes of curves, with variables moved by whole periods.

        A closed curve returns to its start after one lap, but angles may have changed by
        whole periods (revolutions). The moved start is compared with the end of the lap, to
        find out whether the curve closes.

        A subclass with further unknowns, such as rates of links, overrides this method. A
        curve closes only if these unknowns are the same in the first and the last node. If
        they differ, the variables of the returned node are NaN, so the curve does not
        close.

        Parameters
        ----------
        starts
            First nodes (points) of k curves.
        nodes
            Last nodes, from which a step may lead to the start.
        values
            (k, variables) variables of the first nodes, moved by whole periods (rad).

        Returns
        -------
        The k first nodes with these values.
        """
        return replace(starts, values=values)

    def _end_and_find_unfinished(self) -> Indices:
        """End curves that are finished or too long; return the indices of the others."""
        rows = np.flatnonzero(self.end_status == UNFINISHED)
        self.end_finished_curves(rows)
        has_max_nodes = self._node_counts[rows] >= self.max_nodes
        self.end_status[rows[has_max_nodes]] = Status.MODE_LOST
        self.end_status[rows[self.lengths[rows] >= self.max_length]] = Status.OK
        return np.flatnonzero(self.end_status == UNFINISHED)

    def limit_steps(self, rows: Indices, steps: Floats) -> Floats:
        """Return the next steps (k,) of curves (rad), at most the longest allowed one.

        `rows` (k,) are the indices of the curves, which a subclass may use.
        """
        return np.minimum(steps, self.max_step)

    def follow(self, first_step: float) -> None:
        """Follow all curves to their ends, beginning with a first step (rad)."""
        steps = np.full(len(self.end_status), first_step)
        while len(rows := self._end_and_find_unfinished()):
            steps[rows] = self.limit_steps(rows, steps[rows])
            outcome = self._advance(rows, steps[rows])
            failed_rows = rows[outcome.has_failed]
            for row in failed_rows[steps[failed_rows] <= self.smallest_step]:
                self.end_stuck_curve(int(row))
            steps[rows] *= np.where(outcome.has_failed, 0.5, outcome.growth)

    def _advance(self, rows: Indices, steps: Floats) -> StepOutcome:
        """Try a step on each curve, and append the new points (nodes).

        Curves that return to their start or reach a limit end, and get an `end_status`.

        Parameters
        ----------
        rows
            (k,) indices of the curves.
        steps
            (k,) lengths of the steps (rad).

        Returns
        -------
        Which steps have failed, and the factors (`growth`) for the lengths of the next
        steps.
        """
        # A step starts from the last node of each of the k curves.
        nodes = self.last_nodes.rows(rows)
        # The ends of the steps, and tests whether they are still on the same curves.
        tried_steps = self.try_steps(rows, nodes, steps)
        # Curves whose step passes their start end there.
        is_closed_now = self._close_laps(rows, nodes, steps, tried_steps=tried_steps)
        # The subclass selects the verified steps that pass no limit, and may end curves.
        is_taken = self.select_steps(
            rows,
            steps,
            new_nodes=tried_steps.nodes,
            is_verified=tried_steps.is_verified & ~is_closed_now,
        )
        self.append_nodes(rows[is_taken], tried_steps.nodes.rows(is_taken))
        # A curve that has ended needs no step, so its step has not failed.
        has_ended = self.end_status[rows] != UNFINISHED
        # The less the Jacobian of the curve has changed in a step, the longer the next step
        # may be. The factor is 1 after a step that was not taken.
        growth = self._choose_growth(tried_steps.changes)
        return StepOutcome(
            has_failed=~is_taken & ~has_ended, growth=np.where(is_taken, growth, 1.0)
        )

    def _close_laps(
        self, rows: Indices, nodes: Node, steps: Floats, tried_steps: TriedSteps[Node]
    ) -> Bools:
        """End the curves whose step passes their start, and mark them as closed.

        A lap is one round of a closed curve. A copy of the start node is appended as the
        last node, with variables moved by whole periods (such as revolutions).

        Parameters
        ----------
        rows
            (k,) indices of the curves.
        nodes
            Last node (point) of each of the k curves.
        steps
            (k,) lengths of the steps (rad).
        tried_steps
            The steps from these nodes.

        Returns
        -------
        (k,) whether the curve is closed.
        """
        end_nodes, closes = self._find_closing_laps(
            rows, nodes, steps, tried_steps=tried_steps
        )
        self.append_nodes(rows[closes], end_nodes.rows(closes))
        self.end_status[rows[closes]] = Status.OK
        self.is_closed[rows[closes]] = True
        return closes

    def _choose_growth(self, changes: Floats) -> Floats:
        """Return factors (k,) between 0.5 and 2 for the lengths of the next steps.

        A step is verified only if the Jacobian changes by no more than the limit
        `step_tests.change`. The change is about proportional to the length of the step. The
        next step aims at a part of the limit, so that most steps are verified.

        `changes` (k,) are the changes of the Jacobian in the last steps.
        """
        aimed_change = AIMED_CHANGE_RATIO * self.step_tests.change
        # The tiny number prevents a division by zero on straight curves.
        return np.clip(aimed_change / (changes + 1e-300), 0.5, 2.0)

    def append_nodes(self, rows: Indices, new_nodes: Node) -> None:
        """Append one node to each of some curves (k,)."""
        if len(rows):
            chords = new_nodes.values - self.last_nodes.values[rows]
            self.lengths[rows] += np.linalg.norm(chords, axis=1)
            self._node_counts[rows] += 1
            self.last_nodes.assign_rows(rows, new_nodes)
            self._trail.append((rows, new_nodes))

    def _find_closing_laps(
        self, rows: Indices, nodes: Node, steps: Floats, tried_steps: TriedSteps[Node]
    ) -> tuple[Node, Bools]:
        """Find the curves whose step passes their start, so that they are closed.

        A lap is one round of a closed curve, after which it returns to its start. Angles
        may have grown by whole periods (such as revolutions) in a lap. A lap closes under
        these conditions:

        - The start is ahead of the last node, within the length of the verified step.
        - The start is near the curve that is extrapolated from the last node, and the
          tangents at both have about the same direction.
        - A verified step of the length up to the start ends at the start.

        Parameters
        ----------
        rows
            (k,) indices of the curves.
        nodes
            (k) last nodes of the curves.
        steps
            (k,) lengths of the steps (rad).
        tried_steps
            The steps from these nodes.

        Returns
        -------
        end_nodes
            (k) start nodes, shifted by whole periods to be near the step.
        closes
            (k,) whether the lap closes.
        """
        # The start of each curve, shifted by whole periods to be near the middle of the
        # step.
        starts = self.start_nodes.rows(rows)
        middle = 0.5 * (nodes.values + tried_steps.nodes.values)
        values = starts.values + whole_laps(middle - starts.values, self.periods)
        end_nodes = self.start_after_periods(starts, nodes, values)
        # Distance of the start along the tangent at the last node, and its deviation from
        # the curve that is extrapolated from there.
        distances = np.sum(nodes.tangents * (values - nodes.values), axis=1)
        predicted = extrapolate(
            nodes.values, nodes.tangents, nodes.bends, distances[:, None]
        )
        miss = max_abs(values - predicted, axis=1)
        # Points up to `NEAR_END_RAD` from the start count as the start. A lap is possible
        # only on a curve that is clearly longer.
        was_away = self.lengths[rows] > 4.0 * NEAR_END_RAD
        closes = tried_steps.is_verified & all_finite(end_nodes.values, 1) & was_away
        closes &= (distances > -NEAR_END_RAD) & (distances <= steps)
        # The error that is allowed for the prediction of a step.
        closes &= miss <= self.step_tests.correction * steps
        # The curve must pass its start in the same direction as it began.
        closes &= np.vecdot(starts.tangents, nodes.tangents) >= MIN_LAP_COSINE
        # If the start is practically the last node, the curve is closed without a step. If
        # not, a step up to the start is tried, which must be verified and end at the start.
        needs_step = np.abs(distances) > NEAR_END_RAD
        closes &= needs_step | (miss <= self.same_point_rad)
        last_steps = np.flatnonzero(closes & needs_step)
        if len(last_steps):
            last = self.try_steps(
                rows[last_steps], nodes.rows(last_steps), distances[last_steps]
            )
            miss_of_start = max_abs(last.nodes.values - values[last_steps], axis=1)
            closes[last_steps] = last.is_verified & (miss_of_start <= self.same_point_rad)
        return end_nodes, closes

    def verify_steps(
        self,
        starts: CurvePoints,
        stops: CurvePoints,
        middles: Floats,
        distances: Floats,
        is_good: Bools,
        rounding: Floats | float,
    ) -> Bools:
        """Return a mask (k,) of the steps that are on one smooth curve.

        The middle of a step is a point that was computed separately. A polynomial has the
        position and the first two derivatives of the curve at both ends of the step. It
        must agree with the middle. The step must also have passed the other tests.

        Parameters
        ----------
        starts, stops
            The k points at the starts and at the ends of the steps.
        middles
            (k, variables) points of the curves near the middles of the steps (rad).
        distances
            (k,) lengths of the steps (rad).
        is_good
            (k, 2) whether the middle [0] and the end [1] of each step passed the other
            tests.
        rounding
            (k,) rounding errors of the middles (rad).
        """
        chords = stops.values - starts.values
        with np.errstate(all="ignore"):  # Steps that failed can have chords of length 0.
            # The parameter of the polynomial is the projection on the chord (straight line
            # from start to end), as a part of the chord. At the middle it is about one
            # half.
            projections = np.vecdot(middles - starts.values, chords)
            fractions = projections / np.vecdot(chords, chords)
            predicted = interpolate_between(starts, stops, fractions)
            miss = max_abs(predicted - middles, axis=1)
            is_middle_predicted = self.step_tests.accepts_middle(miss, distances, rounding)
        return is_middle_predicted & np.all(is_good, axis=1)

    def collect_nodes(self, row: int) -> Node:
        """Return all nodes of a curve in order, as rows of one object.

        While curves are followed, nodes are stored by rounds of steps. This method gathers
        the nodes of one curve. The first is the start node. A closed curve ends with a copy
        of its start node.
        """
        nodes = [self.start_nodes.rows(slice(row, row + 1))]
        # `_trail` has an item for each round: the indices (k,) of the curves that got a new
        # node in this round, and these nodes (k).
        for rows, new_nodes in self._trail:
            if row in rows:
                nodes.append(new_nodes.rows(rows == row))
        all_nodes = self.start_nodes.concatenate(nodes)
        is_kept = np.ones(len(all_nodes.values), dtype=bool)
        if self.is_closed[row]:
            # The last node is the copy of the start node. The node before the copy is left
            # out if it is practically the same point.
            last_chord = max_abs(all_nodes.values[-1] - all_nodes.values[-2])
            is_kept[-2] = last_chord >= NEAR_END_RAD
        return all_nodes.rows(is_kept)
