"""Verified steps from one closed configuration to another, many at once.

A small closure residual does not prove the mode: Newton's method may close the loops on
a neighbouring one. A step is therefore verified as `spherekit.motion.closure` says,
with exact first and second derivatives, and the determinant of the closure Jacobian has to
keep its sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.motion.closure import Closure, Rows, Verification, follow_paths
from spherekit.motion.loops import Linearisation, contact_tracks, left_inverse
from spherekit.numeric.zeros import ArrayRows
from spherekit.sphere.rotation import Floats

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

    def put(self, rows: NDArray[np.intp], new: "Nodes") -> None:
        """Replace some of the nodes."""
        self.values[rows], self.slope[rows] = new.values, new.slope
        self.bend[rows], self.sign[rows] = new.bend, new.sign
        self.reciprocal_condition[rows] = new.reciprocal_condition


def nodes_at(at: Linearisation, driven: Sequence[int], direction: Floats) -> Nodes:
    """Return the nodes at closed configurations.

    `driven` are the variables of the inputs, `direction` (n, inputs) how those move.
    """
    values = at.values
    jacobian = at.jacobian
    held = list(driven)
    free = [v for v in range(values.shape[1]) if v not in driven]
    square = jacobian[:, :, free]
    finite = np.all(np.isfinite(square), axis=(1, 2))
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
    bend = np.max(np.abs(at.bend), axis=1) + 1e-300
    slope = np.max(np.abs(at.slope), axis=1)
    step = np.minimum(np.minimum(longest, LARGEST_STEP), np.sqrt(2 * BEND / bend))
    step = np.minimum(step, NEARER * slope / bend)
    return np.asarray(np.fmax(step, SMALLEST_STEP))


def _advanced(
    closure: Closure, driven: Sequence[int], at: Nodes, step: Floats, q: Floats
) -> tuple[Nodes, NDArray[np.bool_]]:
    """Return the nodes one step (n,) on, at inputs q (n, inputs), and which hold."""
    h = step[:, None]
    guess = at.values + h * at.slope + 0.5 * h * h * at.bend
    guess[:, list(driven)] = q
    finite = np.all(np.isfinite(guess), axis=1)  # a slope may be endless
    guess = np.where(finite[:, None], guess, at.values)
    moved = np.max(np.abs(guess - at.values), axis=1)
    result = closure.solve(guess, driven, iterations=6)
    holds = finite & (result.residual < CLOSURE_TOLERANCE)
    size = np.minimum(LARGEST_MOVE, moved)
    holds &= VERIFIED.corrected(result.first_step, result.ratio, size)
    new = nodes_at(result.at, driven, at.direction)
    holds &= (new.sign == at.sign) & np.all(np.isfinite(new.slope), axis=1)
    cosine = np.sum(_unit(at.slope) * _unit(new.slope), axis=1)
    return new, holds & (cosine > VERIFIED.turn)


def _unit(slope: Floats) -> Floats:
    return np.asarray(slope / np.linalg.norm(slope, axis=1, keepdims=True))


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
        self.trail: list[tuple[Rows, Nodes]] | None = [] if keeps_trail else None
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

    def allowed(self, rows: Rows, step: Floats) -> Floats:
        """See `spherekit.motion.closure`, as the further methods."""
        at = self.at.rows(rows)
        step = safe_step(at, step)
        for track in self._open:
            place = at.values[:, track.variable] + track.start
            slope = at.slope[:, track.variable]
            rest = np.where(slope > 0.0, track.curve.length - place, place)
            way = TOWARDS_END * rest / (np.abs(slope) + 1e-300)
            step = np.minimum(step, np.maximum(way, SMALLEST_STEP))
        return step

    def advance(self, rows: Rows, step: Floats) -> Floats:
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

    def smallest(self, rows: Rows) -> Floats:
        """Return the steps below which inputs cannot go on."""
        q = np.max(np.abs(self.at.values[rows][:, self.driven]), axis=1)
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
) -> tuple[Floats, NDArray[np.int8]]:
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
