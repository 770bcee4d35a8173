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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Protocol, TypeVar, final

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.motion.arc_curve import Chords, CurvePoints
from spherekit.motion.closure import Closure
from spherekit.motion.loops import Linearisation, contact_tracks, left_inverse
from spherekit.motion.turns import whole_laps
from spherekit.numeric.zeros import ArrayRows
from spherekit.sphere.rotation import all_finite, max_abs, unit_rows

CONTRACTION = 0.1
"""The second step of Newton's method may be this part of the first."""
NEARLY_THERE = 1e-6
"""How near (rad) a node is to the start of a lap, or to a limit, that it has reached."""
AIMED = 0.6
"""Part of the allowed change of the equations that the next step aims at."""
STEP_PARTS = np.array([0.5, 1.0])
"""Where a step is verified."""


@final
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

    def corrected(self, first: Floats, ratio: Floats, size: Floats | float) -> Bools:
        """Return (n,) whether Newton's first steps (n,), and second by first, are fine."""
        near = first <= self.correction * size + self.slack
        return np.asarray(near & ((first <= self.settled) | (ratio <= CONTRACTION)))

    def regular(self, change: Floats, cosine: Floats | float = 1.0) -> Bools:
        """Return (n,) whether equations and tangents changed little enough."""
        return np.asarray((change < self.change) & (np.asarray(cosine) > self.turn))

    def predicted(
        self, miss: Floats | float, size: Floats | float, rounding: Floats | float = 0.0
    ) -> Bools:
        """Return (n,) whether the middles of steps lie where both ends predict them."""
        return np.asarray(miss <= self.middle * size + rounding)


class Paths(Protocol):
    """Paths that are followed side by side, each by steps of its own length."""

    @property
    def going(self) -> Indices:
        """The paths that have not ended."""

    def allowed(self, rows: Indices, step: Floats) -> Floats:
        """Return the steps (k,) to try on these paths, at most as long as `step`."""

    def advance(self, rows: Indices, step: Floats) -> Floats:
        """Go on by steps that hold; return how (k,) the next may grow, 0 if none holds."""

    def smallest(self, rows: Indices) -> Floats:
        """Return the steps (k,) at which these paths end if not even they hold."""

    def stop(self, row: int) -> None:
        """End a path that no step leaves."""


def follow_paths(paths: Paths, step: Floats) -> None:
    """Follow paths to their ends, the first steps `step` (n,)."""
    step = step.copy()
    while len(rows := paths.going):
        step[rows] = paths.allowed(rows, step[rows])
        growth = paths.advance(rows, step[rows])
        held = growth > 0.0
        failed = rows[~held]
        for row in failed[~(step[failed] > paths.smallest(failed))]:
            paths.stop(int(row))
        step[rows] *= np.where(held, growth, 0.5)


def taylor(values: Floats, tangents: Floats, bends: Floats, ways: Floats) -> Floats:
    """Return curves at arc lengths (n, k) from points (n, variables), to second order.

    Row after row, (n k, variables).
    """
    way = ways[:, :, None]
    there = values[:, None] + way * tangents[:, None] + 0.5 * way**2 * bends[:, None]
    return np.asarray(there.reshape(-1, values.shape[1]))


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
        self.closed, self.way = np.zeros(n, dtype=bool), np.zeros(n)
        self._count, self._trail = np.zeros(n, dtype=np.intp), list[tuple[Indices, Node]]()

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

    def smallest(self, rows: Indices) -> Floats:
        """Return the steps (k,) at which curves end."""
        return np.full(len(rows), self.smallest_step)

    def advance(self, rows: Indices, step: Floats) -> Floats:
        """Go on by a step each."""
        at = self.at.rows(rows)
        new, holds, change = self.steps_to(rows, at, step)
        ends, closes = self._closing(rows, at, new, step, holds)
        self.reach(rows[closes], ends.rows(closes))
        self.end[rows[closes]], self.closed[rows[closes]] = Status.OK, True
        on = self.within(rows, step, new, holds & ~closes)
        self.reach(rows[on], new.rows(on))
        growth = np.clip(AIMED * self.tests.change / (change + 1e-300), 0.5, 2.0)
        return np.where(on, growth, np.where(self.end[rows] == GOING, 0.0, 1.0))

    def reach(self, rows: Indices, new: Node) -> None:
        """Go on to nodes."""
        if len(rows):
            way = np.linalg.norm(new.values - self.at.values[rows], axis=1)
            self.way[rows] += way
            self._count[rows] += 1
            self.at.put(rows, new)
            self._trail.append((rows, new))

    def _closing(
        self, rows: Indices, at: Node, new: Node, step: Floats, holds: Bools
    ) -> tuple[Node, Bools]:
        """Return starts, whole periods on, and which of the steps run through them."""
        start, tests = self.start.rows(rows), self.tests
        middle = 0.5 * (at.values + new.values)
        values = start.values + whole_laps(middle - start.values, self.periods)
        ends = self.again(start, at, values)
        closes = holds & all_finite(ends.values, 1)
        way = np.sum(at.tangents * (values - at.values), axis=1)
        there = taylor(at.values, at.tangents, at.bends, way[:, None])
        miss = max_abs(values - there, axis=1)
        closes &= self.way[rows] > 4.0 * NEARLY_THERE
        closes &= (way > -NEARLY_THERE) & (way <= step) & (miss <= tests.correction * step)
        closes &= np.sum(start.tangents * at.tangents, axis=1) >= 0.8
        far = np.abs(way) > NEARLY_THERE
        closes &= far | (miss <= self.same)
        (some,) = np.nonzero(closes & far)
        if len(some):
            made, held, _ = self.steps_to(rows[some], at.rows(some), way[some])
            away = max_abs(made.values - values[some], axis=1)
            closes[some] = held & (away <= self.same)
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
        holds = np.all(good.reshape(-1, 2), axis=1)
        (some,) = np.nonzero(holds)
        order = np.arange(2 * len(some)).reshape(2, -1).T.ravel()
        parts = [part.plain.rows(some) for part in (at, last)]
        chord = Chords(CurvePoints.joined(parts).rows(order))
        which = 2 * np.arange(len(some))
        away = middles[some] - at.values[some]
        along = np.sum(away * chord.directions[which], axis=1) / chord.chords[which]
        wrong = chord.predict(which, along) - middles[some]
        miss = max_abs(wrong, axis=1, initial=0.0)
        allowed = np.broadcast_to(rounding, len(ways))[some]
        holds[some] = self.tests.predicted(miss, ways[some], allowed)
        return np.asarray(holds)

    def nodes_of(self, row: int) -> Node:
        """Return the nodes of a curve in order, the start first."""
        parts = [new.rows(rows == row) for rows, new in self._trail if row in rows]
        nodes = self.start.joined([self.start.rows(slice(row, row + 1)), *parts])
        count = len(nodes.values)
        kept = np.ones(count, dtype=bool)
        if self.closed[row]:
            away = max_abs(nodes.values[-1] - nodes.values[-2])
            kept[-2] = away >= NEARLY_THERE
        return nodes.rows(kept)


LARGEST_STEP = 0.2
"""Longest step of the input (rad)."""
BEND = 0.02
"""Second-order part of a step that is aimed at (rad)."""
NEARER = 0.3
"""Part of slope / bend stepped at most: 0.6 of the way to a dead centre, where a
variable goes as the square root of the way left and slope / bend is twice that way."""
TOWARDS_END = 0.9
"""Part of the way to the end of an open profile that is stepped at most."""
VERIFIED = Verification(correction=0.1, slack=1e-9, settled=1e-6, turn=0.95)
LARGEST_MOVE = 0.5
"""A prediction may be wrong by no larger part than of such a step (rad)."""
MOST_NODES = 20000
SMALLEST_STEP = 4e-13
"""A step below this means that the input has reached a dead centre (rad)."""
NEARLY_FLAT, NEARLY_EQUAL, NEARLY_ENDED = 1e-3, 1e-3, 1e-6
"""How near the last node is to a dead centre (relative singular value), to equal
curvatures, and to the end of an open profile (rad), to name it as the reason."""


@final
@dataclass(frozen=True)
class Nodes(ArrayRows):
    """Closed configurations and how they change when the inputs move along directions.

    `direction` (n, inputs); `values`, `slope`, `bend` (n, variables): the variables and
    their first and second derivatives by the way along the direction; `sign` (n,) of the
    determinant of the closure Jacobian without the inputs; `reciprocal_condition` (n,) its
    relative smallest singular value.
    """

    direction: Floats
    values: Floats
    slope: Floats
    bend: Floats
    sign: Floats
    reciprocal_condition: Floats


def nodes_at(at: Linearisation, driven: Sequence[int], direction: Floats) -> Nodes:
    """Return the nodes at closed configurations.

    `driven` are the variables of the inputs, `direction` (n, inputs) how those move.
    """
    values = at.values
    jacobian = at.jacobian
    held = list(driven)
    free = [v for v in range(values.shape[1]) if v not in driven]
    square = jacobian[:, :, free]
    finite = all_finite(square, (1, 2))
    reciprocal_condition = np.ones(len(values))
    if free:
        filled = np.where(finite[:, None, None], square, 1.0)
        sizes = np.linalg.svd(filled, compute_uv=False)
        reciprocal_condition = np.where(finite, sizes[:, -1] / sizes[:, 0], 0.0)
    slope, bend = np.zeros_like(values), np.zeros_like(values)
    inverse = left_inverse(square)
    slope[:, held] = direction
    moved = np.einsum("nij,nj->ni", jacobian[:, :, held], direction)
    slope[:, free] = -np.einsum("nij,nj->ni", inverse, moved)
    bend[:, free] = -np.einsum("nij,nj->ni", inverse, at.bias(slope))
    return Nodes(
        direction,
        values,
        slope,
        bend,
        determinant_sign(square),
        reciprocal_condition,
    )


def determinant_sign(matrices: Floats) -> Floats:
    """Return the signs (n,) of determinants; 1 for matrices with extra rows."""
    if matrices.shape[1] != matrices.shape[2]:
        return np.ones(len(matrices))
    return np.asarray(np.linalg.slogdet(matrices)[0])


def safe_step(at: Nodes, longest: Floats) -> Floats:
    """Return the step (n,) that the bend of the way allows, at most `longest` (n,)."""
    bend = max_abs(at.bend, axis=1) + 1e-300
    slope = max_abs(at.slope, axis=1)
    step = np.minimum(np.minimum(longest, LARGEST_STEP), np.sqrt(2 * BEND / bend))
    step = np.minimum(step, NEARER * slope / bend)
    return np.asarray(np.fmax(step, SMALLEST_STEP))


def _advanced(
    closure: Closure, driven: Sequence[int], at: Nodes, step: Floats, q: Floats
) -> tuple[Nodes, Bools]:
    """Return the nodes one step (n,) on, at inputs q (n, inputs), and which hold."""
    h = step[:, None]
    guess = at.values + h * at.slope + 0.5 * h * h * at.bend
    guess[:, list(driven)] = q
    finite = all_finite(guess, 1)  # a slope may be endless
    guess = np.where(finite[:, None], guess, at.values)
    moved = max_abs(guess - at.values, axis=1)
    result = closure.solve(guess, driven, iterations=6)
    holds = finite & (result.residual < CLOSURE_TOLERANCE)
    size = np.minimum(LARGEST_MOVE, moved)
    holds &= VERIFIED.corrected(result.first_step, result.ratio, size)
    new = nodes_at(result.at, driven, at.direction)
    holds &= (new.sign == at.sign) & all_finite(new.slope, 1)
    cosine = np.sum(_unit(at.slope) * _unit(new.slope), axis=1)
    return new, holds & (cosine > VERIFIED.turn)


def _unit(slope: Floats) -> Floats:
    return np.asarray(unit_rows(slope))


def why_ended(closure: Closure, at: Nodes, row: int) -> Status:
    """Return the status of the samples beyond the last node that could be reached."""
    values = at.values[row]
    states = closure.at(values[None]).states
    for k, tracks in contact_tracks(closure.joints):
        if states.curvatures[0, k, 0] - states.curvatures[0, k, 1] < NEARLY_EQUAL:
            return Status.CURVATURE
        for track in tracks:
            s = values[track.variable] + track.start
            if not track.curve.closed and min(s, track.curve.length - s) < NEARLY_ENDED:
                return Status.OFF_PROFILE
    return (
        Status.OUT_OF_REACH
        if at.reciprocal_condition[row] < NEARLY_FLAT
        else Status.MODE_LOST
    )


@final
class InputPaths:
    """Straight ways of the inputs, from closed configurations to inputs q (n, inputs).

    Attributes
    ----------
    at
        The nodes (n) reached so far.
    status
        (n,) OK, or why a way ended before its goal.
    trail
        What was reached in each step, with the ways it belongs to, if it is kept.
    tried
        (n,) how many steps were tried on each way, those that did not hold too.
    """

    def __init__(
        self,
        closure: Closure,
        driven: Sequence[int],
        values: Floats,
        q: Floats,
        keeps_trail: bool = False,
    ) -> None:
        self.closure, self.driven, self.q = closure, list(driven), q
        way = q - values[:, self.driven]
        length = np.linalg.norm(way, axis=1)
        direction = way / np.maximum(length, 1e-300)[:, None]
        self.at = nodes_at(closure.at(values.copy()), driven, direction)
        self.status = np.full(len(q), Status.OK, dtype=np.int8)
        self.trail: list[tuple[Indices, Nodes]] | None = [] if keeps_trail else None
        self.going = np.flatnonzero(length > 0.0)
        self.tried = np.zeros(len(q), dtype=np.intp)
        self._left = np.full(len(q), MOST_NODES)
        self._open = [
            track
            for _, tracks in contact_tracks(closure.joints)
            for track in tracks
            if not track.curve.closed
        ]
        follow_paths(self, np.full(len(q), np.inf))

    def allowed(self, rows: Indices, step: Floats) -> Floats:
        """See `Paths`, as the further methods."""
        at = self.at.rows(rows)
        step = safe_step(at, step)
        for track in self._open:
            place = at.values[:, track.variable] + track.start
            slope = at.slope[:, track.variable]
            rest = np.where(slope > 0.0, track.curve.length - place, place)
            way = TOWARDS_END * rest / (np.abs(slope) + 1e-300)
            step = np.minimum(step, np.maximum(way, SMALLEST_STEP))
        return step

    def advance(self, rows: Indices, step: Floats) -> Floats:
        """Go on by steps, the last ones exactly to the inputs wanted."""
        self.tried[rows] += 1
        at, q = self.at.rows(rows), self.q[rows]
        here = at.values[:, self.driven]
        rest = np.sum((q - here) * at.direction, axis=1)
        last = step >= rest * (1 - 1e-9)
        ahead = np.where(last, rest, step)
        goal = np.where(last[:, None], q, here + ahead[:, None] * at.direction)
        new, holds = _advanced(self.closure, self.driven, at, ahead, goal)
        moved, new = rows[holds], new.rows(holds)
        self.at.put(moved, new)
        if self.trail is not None:
            self.trail.append((moved, new))
        self._left[moved] -= 1
        tired = rows[(self._left[rows] == 0) & ~(holds & last)]
        self.status[tired] = Status.MODE_LOST
        ended = np.concatenate([rows[holds & last], tired])
        self.going = np.setdiff1d(self.going, ended, assume_unique=True)
        return np.where(holds, 2.0, 0.0)

    def smallest(self, rows: Indices) -> Floats:
        """Return the steps below which inputs cannot go on."""
        q = max_abs(self.at.values[rows][:, self.driven], axis=1)
        return np.asarray(2 * SMALLEST_STEP * np.maximum(1.0, q))

    def nodes_of(self, rows: Sequence[int]) -> list[Nodes]:
        """Return what ways reached in their steps, in order, of a kept trail."""
        assert self.trail is not None
        if not self.trail:
            return [self.at.rows(slice(0, 0)) for _ in rows]
        ways = np.concatenate([moved for moved, _ in self.trail])
        nodes = Nodes.joined([made for _, made in self.trail])
        return [nodes.rows(ways == row) for row in rows]

    def stop(self, row: int) -> None:
        """End a way at its last node."""
        self.status[row] = why_ended(self.closure, self.at, row)
        self.going = self.going[self.going != row]


def walk(
    closure: Closure, driven: Sequence[int], values: Floats, q: Floats
) -> tuple[Floats, SmallIntegers]:
    """Return configurations reached by straight ways of the inputs, and statuses (n,).

    Parameters
    ----------
    closure
        Loop closure of the whole mechanism.
    driven
        Numbers of the inputs' variables.
    values
        (n, variables) closed configurations to start from.
    q
        (n, inputs) inputs to arrive at. Status OK says that a way of verified steps leads
        there; other rows hold the last configuration reached.
    """
    paths = InputPaths(closure, driven, values, q)
    return paths.at.values, paths.status
