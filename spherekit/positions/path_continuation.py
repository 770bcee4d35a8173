"""Paths of configurations, followed by verified steps, many at once.

Every path is followed in the same way, whatever its parameter: inputs on a straight way,
the arc length of a curve, the angle of a rotation. A step is predicted from the last node
by its derivatives, corrected by Newton's method, and accepted only if

- the prediction was nearly right,
- Newton's method contracted at once,
- the equations changed by less than would make them singular on the way, or the
  determinant kept its sign,
- the tangent turned little,
- the Hermite polynomial through both ends predicts the middle.

Otherwise it is halved. After a step that holds, the next one may be longer. A path ends
where it arrives, where its owner says so (a limit, a closed lap), or where no step holds.

A small closure residual does not prove the mode: Newton's method may close the loops on
a neighbouring one. A step is therefore verified,
with exact first and second derivatives, and the determinant of the closure Jacobian has to
keep its sign.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Generic, TypeVar

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.geometry.vectors import all_finite, max_abs, unit_rows
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.configuration_curve import between
from spherekit.positions.curve_segment import CurvePoints
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.linear_equations import condition_numbers, left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import iterate_contact_profiles
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, EQUAL_CURVATURE

CONTRACTION = 0.1
"""The second step of Newton's method may be this part of the first."""
NEARLY_THERE = 1e-6
"""How near (rad) a node is to the start of a lap, or to a limit, that it has reached."""
AIMED = 0.6
"""Part of the allowed change of the equations that the next step aims at."""
STEP_PARTS = np.array([0.5, 1.0])
"""Where a step is verified."""


@dataclass(frozen=True)
class Verification:
    """How well steps have to be predicted and corrected; `size` is that of a step.

    Attributes
    ----------
    correction, slack
        A prediction may be wrong by this part of the step and so much (rad) besides.
    settled
        Newton's method need not contract after a first step smaller than this (rad).
    change
        Change of the equations, relative; at 1 they may be singular on the way.
    turn
        Least cosine of the angle by which the tangent turns.
    middle
        The prediction of the middle from both ends may be wrong by this part of the step.
    """

    correction: float = 0.05
    slack: float = CLOSURE_TOLERANCE
    settled: float = 1e-7
    change: float = 0.6
    turn: float = 0.9
    middle: float = 1e-4

    def corrected(self, steps: Iterable[Floats], size: Floats | float) -> Bools:
        """Return (n,) whether Newton's first steps (n,), and second by first, are fine."""
        first, ratio = steps
        near = first <= self.correction * size + self.slack
        return near & ((first <= self.settled) | (ratio <= CONTRACTION))

    def regular(self, change: Floats, cosine: Floats | float = 1.0) -> Bools:
        """Return (n,) whether equations and tangents changed little enough."""
        return (change < self.change) & (np.asarray(cosine) > self.turn)

    def predicted(
        self, miss: Floats | float, size: Floats | float, rounding: Floats | float = 0.0
    ) -> Bools:
        """Return (n,) whether the middles of steps lie where both ends predict them."""
        return np.asarray(miss <= self.middle * size + rounding)


def taylor(values: Floats, tangents: Floats, bends: Floats, ways: Floats) -> Floats:
    """Return curves at arc lengths (n, k) from points (n, variables), to second order.

    Row after row, (n k, variables).
    """
    way = ways[:, :, None]
    there = values[:, None] + way * tangents[:, None] + 0.5 * way**2 * bends[:, None]
    return there.reshape(-1, values.shape[1])


GOING = -1
"""Status of a curve that has not ended."""
Node = TypeVar("Node", bound=CurvePoints)


@dataclass
class Curves(ABC, Generic[Node]):
    """Curves in the space of the variables, followed side by side in one sense each.

    Attributes
    ----------
    tests, smallest_step, same, most_nodes
        The tests of a step, the step at which a curve ends if not even that holds, how
        near (rad) to its start a lap ends, and the most nodes.
    start, at
        The first and the last nodes (n).
    periods
        (variables,) growth of each variable that changes nothing.
    longest, largest
        Length (rad) after which a curve is ended, and the longest step.
    end, closed
        (n,) the status of what lies beyond, and whether the last node is the start again,
        whole periods on.
    """

    tests: ClassVar[Verification]
    smallest_step: ClassVar[float]
    same: ClassVar[float]
    most_nodes: ClassVar[int]

    start: Node
    periods: Floats
    longest: float
    largest: float

    def __post_init__(self) -> None:
        n = len(self.start.values)
        self.at = self.start.rows(np.arange(n))
        self.end = np.full(n, GOING, dtype=np.int8)
        self.closed = np.zeros(n, dtype=bool)
        self.way = np.zeros(n)
        self._count = np.zeros(n, dtype=np.intp)
        self._trail: list[tuple[Indices, Node]] = []

    @abstractmethod
    def steps_to(self, rows: Indices, at: Node, ways: Floats) -> tuple[Node, Bools, Floats]:
        """Return the nodes at projections (k,) on the tangents at nodes of some curves.

        And which of them pass all tests, and the relative changes of the equations.
        """

    @abstractmethod
    def within(self, rows: Indices, step: Floats, new: Node, holds: Bools) -> Bools:
        """Return which of the steps that hold are to be taken.

        Where a limit is reached the end of a curve is set.
        """

    @abstractmethod
    def exhaust(self, rows: Indices) -> None:
        """End curves of which there is a reason not to go on from the last node."""

    @abstractmethod
    def stop(self, row: int) -> None:
        """End a curve that no step leaves."""

    def again(self, start: Node, at: Node, values: Floats) -> Node:
        """Return starts at values whole periods on, not finite where it is another one."""
        return replace(start, values=values)

    @property
    def going(self) -> Indices:
        """The curves that have not ended."""
        rows = np.flatnonzero(self.end == GOING)
        self.exhaust(rows)
        self.end[rows[self._count[rows] >= self.most_nodes]] = Status.MODE_LOST
        self.end[rows[self.way[rows] >= self.longest]] = Status.OK
        return np.flatnonzero(self.end == GOING)

    def allowed(self, rows: Indices, step: Floats) -> Floats:
        """Return the steps (k,), no longer than the longest."""
        return np.minimum(step, self.largest)

    def follow(self, first: float) -> None:
        """Follow all curves to their ends, from a first step (rad) on."""
        step = np.full(len(self.end), first)
        while len(rows := self.going):
            step[rows] = self.allowed(rows, step[rows])
            growth = self.advance(rows, step[rows])
            failed = rows[growth == 0.0]
            for row in failed[step[failed] <= self.smallest_step]:
                self.stop(int(row))
            step[rows] *= np.where(growth > 0.0, growth, 0.5)

    def advance(self, rows: Indices, step: Floats) -> Floats:
        """Go on by a step each; return how (k,) the next may grow, 0 if none holds."""
        at = self.at.rows(rows)
        new, holds, change = self.steps_to(rows, at, step)
        ends, closes = self._closing(rows, at, new, step, holds)
        self.reach(rows[closes], ends.rows(closes))
        self.end[rows[closes]] = Status.OK
        self.closed[rows[closes]] = True
        on = self.within(rows, step, new, holds & ~closes)
        self.reach(rows[on], new.rows(on))
        growth = np.clip(AIMED * self.tests.change / (change + 1e-300), 0.5, 2.0)
        return np.where(on, growth, np.where(self.end[rows] == GOING, 0.0, 1.0))

    def reach(self, rows: Indices, new: Node) -> None:
        """Go on to nodes."""
        if len(rows):
            self.way[rows] += np.linalg.norm(new.values - self.at.values[rows], axis=1)
            self._count[rows] += 1
            self.at.put(rows, new)
            self._trail.append((rows, new))

    def _closing(
        self, rows: Indices, at: Node, new: Node, step: Floats, holds: Bools
    ) -> tuple[Node, Bools]:
        """Return starts, whole periods on, and which of the steps run through them."""
        start = self.start.rows(rows)
        middle = 0.5 * (at.values + new.values)
        values = start.values + whole_laps(middle - start.values, self.periods)
        ends = self.again(start, at, values)
        way = np.sum(at.tangents * (values - at.values), axis=1)
        there = taylor(at.values, at.tangents, at.bends, way[:, None])
        miss = max_abs(values - there, axis=1)
        closes = holds & all_finite(ends.values, 1) & (self.way[rows] > 4.0 * NEARLY_THERE)
        closes &= (way > -NEARLY_THERE) & (way <= step)
        closes &= miss <= self.tests.correction * step
        closes &= np.vecdot(start.tangents, at.tangents) >= 0.8
        far = np.abs(way) > NEARLY_THERE
        closes &= far | (miss <= self.same)
        some = np.flatnonzero(closes & far)
        if len(some):
            made, held, _ = self.steps_to(rows[some], at.rows(some), way[some])
            closes[some] = held & (max_abs(made.values - values[some], axis=1) <= self.same)
        return ends, closes

    def judged(
        self,
        at: CurvePoints,
        last: CurvePoints,
        middles: Floats,
        ways: Floats,
        good: Bools,
        rounding: Floats | float,
    ) -> Bools:
        """Return (k,) which steps hold whose halves are `good` (2 k,).

        Those whose middles (k, variables) lie where nodes at both ends predict them.
        """
        chords = last.values - at.values
        with np.errstate(all="ignore"):  # of steps that do not hold
            along = np.vecdot(middles - at.values, chords) / np.vecdot(chords, chords)
            miss = max_abs(between(at, last, along) - middles, axis=1)
            holds = self.tests.predicted(miss, ways, rounding)
        return holds & np.all(good.reshape(-1, 2), axis=1)

    def nodes_of(self, row: int) -> Node:
        """Return the nodes of a curve in order, the start first."""
        parts = [new.rows(rows == row) for rows, new in self._trail if row in rows]
        nodes = self.start.joined([self.start.rows(slice(row, row + 1)), *parts])
        kept = np.ones(len(nodes.values), dtype=bool)
        if self.closed[row]:
            kept[-2] = max_abs(nodes.values[-1] - nodes.values[-2]) >= NEARLY_THERE
        return nodes.rows(kept)


@dataclass(frozen=True)
class Limits:
    """Where curves have to end: bounds of variables, and equal curvatures of profiles.

    A bound is a variable with its value, 1 from above or -1 from below, and what lies
    beyond. A contact is a pair with the variables of its arc lengths.
    """

    bounds: tuple[tuple[int, float, float, Status], ...]
    contacts: tuple[tuple[int, tuple[int, ...]], ...]

    @staticmethod
    def of(closure: Closure, stops: Mapping[int, tuple[float, float]]) -> "Limits":
        """Return the ends of open profiles, equal curvatures, and stops.

        `stops` has the lowest and the highest value (rad) of variables by their numbers.
        """
        contacts = list(iterate_contact_profiles(closure.joints))
        ranges = [(variable, ends, Status.OK) for variable, ends in stops.items()]
        ranges += [
            (x.variable, (-x.start, x.curve.length - x.start), Status.OFF_PROFILE)
            for _, tracks in contacts
            for x in tracks
            if not x.curve.closed
        ]
        return Limits(
            tuple(
                (variable, end, sense, status)
                for variable, ends, status in ranges
                for end, sense in zip(ends, (1.0, -1.0), strict=True)
            ),
            tuple((pair, tuple(x.variable for x in tracks)) for pair, tracks in contacts),
        )

    @cached_property
    def statuses(self) -> tuple[Status, ...]:
        """What lies beyond each limit."""
        beyond = tuple(status for *_, status in self.bounds)
        return beyond + (Status.CURVATURE,) * len(self.contacts)

    def margins(
        self, values: Floats, bends: Floats, rates: Floats
    ) -> tuple[Floats, Floats]:
        """Return how far (n, limits) limits are, negative beyond, and the gradients.

        These (n, limits, variables) are by the variables (n, variables); curvatures of
        profiles and their rates are (n, pairs, 2).
        """
        margins = np.empty((len(values), len(self.statuses)))
        gradients = np.zeros((*margins.shape, values.shape[1]))
        for number, (variable, place, sense, _) in enumerate(self.bounds):
            margins[:, number] = sense * (values[:, variable] - place)
            gradients[:, number, variable] = sense
        for number, (pair, along) in enumerate(self.contacts, len(self.bounds)):
            margins[:, number] = bends[:, pair, 0] - bends[:, pair, 1] - EQUAL_CURVATURE
            for variable, rate in zip(along, (rates[:, pair] * [1.0, -1.0]).T, strict=True):
                gradients[:, number, variable] += rate
        return margins, gradients

    def words(self, number: int) -> str:
        """Return what a limit is of."""
        if number >= len(self.bounds):
            pair, _ = self.contacts[number - len(self.bounds)]
            return f"equal curvatures of the profiles of pair {pair}"
        variable, place, sense, _ = self.bounds[number]
        side = "lowest" if sense > 0.0 else "highest"
        return f"the {side} value {place:.6g} rad of variable {variable}"


LARGEST_STEP = 0.2
"""Longest step of the input (rad)."""
BEND = 0.02
"""Second-order part of a step that is aimed at (rad)."""
NEARER = 0.3
"""Part of slope / bend stepped at most: 0.6 of the way to a dead centre, where a
variable goes as the square root of the way left and slope / bend is twice that way."""
VERIFIED = Verification(correction=0.1, slack=1e-9, settled=1e-6, turn=0.95)
LARGEST_MOVE = 0.5
"""A prediction may be wrong by no larger part than of such a step (rad)."""
MOST_TRIED = 20000
SMALLEST_STEP = 4e-13
"""A step below this means that the input has reached a dead centre (rad)."""
NEARLY_FLAT = NEARLY_EQUAL = 1e-3
"""How near the last node is to a dead centre (relative singular value), or to equal
curvatures (rad), to name it as the reason."""
NEARLY_ENDED = 1e-6
"""The same of the end of an open profile (rad)."""


@dataclass(frozen=True)
class Nodes(ArrayRows):
    """Closed configurations and how they change when the inputs move along directions.

    `direction` (n, inputs); `values`, `slope`, `bend` (n, variables): the variables and
    their first and second derivatives by the way along the direction; `sign` (n,) of the
    determinant of the closure Jacobian without the inputs.
    """

    direction: Floats
    values: Floats
    slope: Floats
    bend: Floats
    sign: Floats


def nodes_at(at: Linearisation, driven: Sequence[int], direction: Floats) -> Nodes:
    """Return the nodes at closed configurations.

    `driven` are the variables of the inputs, `direction` (n, inputs) how those move.
    """
    free = np.delete(np.arange(at.values.shape[1]), driven)
    square = at.jacobian[:, :, free]
    inverse = left_inverse(square)
    slope = np.zeros_like(at.values)
    bend = slope.copy()
    slope[:, driven] = direction
    moved = np.einsum("nij,nj->ni", at.jacobian, slope)
    slope[:, free] = -np.einsum("nij,nj->ni", inverse, moved)
    bend[:, free] = -np.einsum("nij,nj->ni", inverse, at.bias(slope))
    return Nodes(direction, at.values, slope, bend, determinant_sign(square))


def determinant_sign(matrices: Floats) -> Floats:
    """Return signs (n,) of determinants, NaN as they are; 1 of matrices with extra rows."""
    if matrices.shape[1] != matrices.shape[2]:
        return np.ones(len(matrices))
    with np.errstate(invalid="ignore"):
        return np.linalg.slogdet(matrices)[0]


def _advanced(
    closure: Closure, driven: Sequence[int], at: Nodes, step: Floats, q: Floats
) -> tuple[Nodes, Bools, Bools]:
    """Return the nodes one step (n,) on towards inputs q (n, inputs).

    And which of them hold, and which are there, exactly.
    """
    here = at.values[:, driven]
    rest = np.vecdot(q - here, at.direction)
    last = step >= rest * (1 - 1e-9)
    h = np.where(last, rest, step)[:, None]
    guess = taylor(at.values, at.slope, at.bend, h)
    guess[:, driven] = np.where(last[:, None], q, here + h * at.direction)
    finite = all_finite(guess, 1)  # a slope may be endless
    guess[~finite] = at.values[~finite]
    there, steps = closure.solve_with_step_sizes(guess, driven, iterations=6)
    holds = finite & (there.gap < CLOSURE_TOLERANCE)
    moved = np.minimum(LARGEST_MOVE, max_abs(guess - at.values, axis=1))
    holds &= VERIFIED.corrected(steps, moved)
    new = nodes_at(there, driven, at.direction)
    holds &= (new.sign == at.sign) & all_finite(new.slope, 1)
    holds &= np.all(there.states.inside, axis=1)
    cosine = np.vecdot(unit_rows(at.slope), unit_rows(new.slope))
    return new, holds & (cosine > VERIFIED.turn), last


def _longest(at: Nodes, step: Floats, smallest_step: float) -> Floats:
    """Return the steps (n,), at most as long as given, that bends allow."""
    bend = max_abs(at.bend, axis=1) + 1e-300
    step = np.minimum(np.minimum(step, LARGEST_STEP), np.sqrt(2 * BEND / bend))
    step = np.minimum(step, NEARER * max_abs(at.slope, axis=1) / bend)
    return np.fmax(step, smallest_step)


def flat(at: Linearisation, driven: Sequence[int], least: float) -> Bools:
    """Return where (n,) the closure Jacobian without the inputs has nearly lost rank.

    Where its smallest singular value is below this part of the largest.
    """
    square = np.delete(at.jacobian, driven, axis=2)
    return ~(condition_numbers(square) < 1.0 / least)


def _why_ended(closure: Closure, driven: Sequence[int], values: Floats) -> Status:
    """Return the status of the samples beyond the last node (1, variables) reached."""
    there = closure.at(values)
    states = there.states
    limits = Limits.of(closure, {})
    margins, _ = limits.margins(values, states.curvatures, states.curvature_rates)
    for status, margin in zip(reversed(limits.statuses), reversed(margins[0]), strict=True):
        if margin < (NEARLY_EQUAL if status == Status.CURVATURE else NEARLY_ENDED):
            return status
    return Status.OUT_OF_REACH if flat(there, driven, NEARLY_FLAT) else Status.MODE_LOST


Trail = list[tuple[Indices, Nodes]]
"""What was reached step after step, with the ways (k,) it belongs to."""


def follow_inputs(
    closure: Closure,
    driven: Sequence[int],
    values: Floats,
    q: Floats,
    trail: Trail | None = None,
    smallest_step: float = SMALLEST_STEP,
) -> tuple[Nodes, SmallIntegers, Indices]:
    """Follow straight ways of the inputs from configurations, by verified steps.

    Parameters
    ----------
    closure
        Loop closure of the whole mechanism.
    driven
        Numbers of the inputs' variables.
    values
        (n, variables) closed configurations to start from.
    q
        (n, inputs) inputs to arrive at.
    trail
        Gets what is reached on the way.
    smallest_step
        A way ends where not even such a step (rad) holds.

    Returns
    -------
    at, status, tried
        The last nodes (n), (n,) OK or why a way ended before its goal, and (n,) how many
        steps were tried on each, those that did not hold too.
    """
    way = q - values[:, driven]
    length = np.linalg.norm(way, axis=1)
    direction = way / np.maximum(length, 1e-300)[:, None]
    at = nodes_at(closure.at(values.copy()), driven, direction)
    status = np.full(len(q), Status.OK, dtype=np.int8)
    step = np.full(len(q), np.inf)
    tried = np.zeros(len(q), dtype=np.intp)
    going = np.flatnonzero(length > 0.0)
    while len(going):
        here = at.rows(going)
        tried[going] += 1
        step[going] = _longest(here, step[going], smallest_step)
        new, holds, last = _advanced(closure, driven, here, step[going], q[going])
        moved = going[holds]
        new = new.rows(holds)
        at.put(moved, new)
        if trail is not None:
            trail.append((moved, new))
        there = holds & last
        tired = ~there & (tried[going] == MOST_TRIED)
        status[going[tired]] = Status.MODE_LOST
        least = np.maximum(1.0, max_abs(here.values[:, driven], axis=1))
        stuck = ~holds & (step[going] <= 2 * smallest_step * least)
        for row in going[stuck]:
            status[row] = _why_ended(closure, driven, at.values[row : row + 1])
        step[going] *= np.where(holds, 2.0, 0.5)
        going = going[~(there | tired | stuck)]
    return at, status, tried
