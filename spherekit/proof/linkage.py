"""A whole mechanism in balls, link by link: orientations, gaps of the loops, Jacobian.

All functions take the pair variables as balls, or as power series in whatever moves.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from spherekit.model.geometry import geometry_of
from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry
from spherekit.proof.balls import (
    Balls,
    coefficient,
    exactly,
    floats,
    library,
    middles,
    precision,
    series,
)
from spherekit.proof.frames import Frame, Frames, declared_frames
from spherekit.proof.profiles import ball_curve, harmonic
from spherekit.sphere.rotation import Floats

STEPS = 60
"""Most steps of Newton's method."""

SINGULAR = 1.0 / 64.0
"""A matrix whose condition times rounding is more has less than full column rank."""


Curve = Callable[[Balls], Balls]
"""Frames (n, 3, 3), columns t, n = p x t, p, of a curve at arc lengths (n,) rad."""


class _Joint(ABC):
    """A pair as declared, with the variables (n, m) of its own."""

    @abstractmethod
    def turn(self, values: Balls) -> Balls:
        """Return rotations (n, 3, 3) of the second link in the first's axes."""

    @abstractmethod
    def axis(self, values: Balls) -> Balls:
        """Return the axis, or the contact point, (n, 3) in the first link's axes."""

    def vectors(self, values: Balls) -> Balls:
        """Return the variables' vectors (n, m, 3) in the first link's axes, of balls."""
        vectors = []
        for column in range(values.shape[1]):
            moving = values.copy()
            one = exactly(np.ones(len(values)))
            moving[:, column] = series(values[:, column], one)
            vectors.append(turning_rates(self.turn(moving), 1)[0])
        return np.stack(vectors, axis=1)


@final
class _Revolute(_Joint):
    """An R pair with its frames in both links."""

    def __init__(self, first: Frame, second: Frame) -> None:
        x, y, z = first
        moved = [[0 * x, 0 * x, z], [x, y, 0 * x], [y, -x, 0 * x]]
        self._parts = np.array(moved).swapaxes(1, 2) @ second
        self._axis = z

    def turn(self, values: Balls) -> Balls:
        return harmonic(self._parts, values[:, 0])

    def axis(self, values: Balls) -> Balls:
        return np.broadcast_to(self._axis, (len(values), 3))

    def vectors(self, values: Balls) -> Balls:
        return self.axis(values)[:, None]


@final
class _Contact(_Joint):
    """A contact pair: two curves, whose frames agree at the contact.

    Each is run along by the variable of its number in `variables`, from its `start` (2,)
    on: in rolling both by the same one.
    """

    def __init__(
        self, curves: Sequence[Curve], variables: tuple[int, int], start: Balls
    ) -> None:
        self._curves, self._variables, self.start = curves, variables, start

    def turn(self, values: Balls) -> Balls:
        one, other = (self._frame(side, values) for side in (0, 1))
        return np.asarray(one @ other.swapaxes(1, 2))

    def axis(self, values: Balls) -> Balls:
        return self._frame(0, values)[:, :, 2]

    def _frame(self, side: int, values: Balls) -> Balls:
        return self._curves[side](values[:, self._variables[side]] + self.start[side])

    def touching(self) -> Balls:
        """Return the arc lengths (2,) near the start at which aligned links touch.

        Least squares, as profiles may miss each other by what the float64 geometry allows.
        """
        free = _Contact(self._curves, (0, 1), exactly(np.zeros(2)))
        s, last = self.start, np.inf
        for _ in range(STEPS):
            miss = skew_part(free.turn(s[None]))
            inverse, _ = left_inverse(free.vectors(s[None]).swapaxes(1, 2))
            step = (inverse @ miss[..., None])[0, :, 0]
            s = middles(s - step)
            size = float(np.max(np.abs(floats(step))))
            if size == 0.0 or not size < last / 2:
                break
            last = size
        return s


def _joints(mechanism: Mechanism, frames: Frames) -> list[_Joint]:
    """Return the pairs of a mechanism, in their order.

    Which axes a zero direction is taken from, and near which place two profiles touch,
    is read off the float64 geometry; every number is computed anew.
    """
    made: list[_Joint] = []
    for pair, joint in zip(mechanism.pairs, geometry_of(mechanism).joints, strict=True):
        if pair.profiles is None:
            made.append(_Revolute(*frames[pair.name]))
            continue
        one, other = map(ball_curve, pair.profiles)
        curves = one.frame, other.backwards if pair.contact == "external" else other.frame
        tracks = joint.tracks
        start = exactly([track.start for track in tracks])
        contact = _Contact(curves, (tracks[0].variable, tracks[1].variable), start)
        if joint.rolled and isinstance(mechanism.geometry, PoseGeometry):
            contact.start = contact.touching()
        made.append(contact)
    return made


@final
class Linkage:
    """The links of a mechanism placed one after another from the ground.

    Every link is placed once, across the pair that reaches it first; each further pair
    closes a loop, which is open by the skew part of the rotation left over.
    """

    def __init__(self, mechanism: Mechanism, frames: Frames | None = None) -> None:
        self.mechanism, ends = mechanism, mechanism.ends
        joints = _joints(mechanism, frames or declared_frames(mechanism))
        self._joints = [
            (joint, list(mechanism.variables_of(pair)), ends[pair])
            for pair, joint in enumerate(joints)
        ]
        self._way = spanning(ends)
        used = {pair for pair, _, _ in self._way}
        self._chords = [pair for pair in range(len(joints)) if pair not in used]
        ways = np.zeros((len(mechanism.links), len(joints)))
        for pair, parent, child in self._way:
            ways[child] = ways[parent]
            ways[child, pair] = 1.0 if ends[pair][0] == parent else -1.0
        passes = np.array([ways[a] - ways[b] for a, b in (ends[p] for p in self._chords)])
        passes = passes.reshape(len(self._chords), len(joints))
        passes[range(len(self._chords)), self._chords] += 1.0
        owners = list(mechanism.variable_owners)
        # the sense in which the way to a link, or a loop, passes the pair of a variable
        self._ways, self._passes = ways[:, owners], passes[:, owners]

    def place(self, values: Balls) -> tuple[Balls, Balls]:
        """Return link orientations (n, links, 3, 3), and by how much the loops stay open.

        At all pair variables (n, variables); gaps (n, 3 loops) rad.
        """
        turns = [joint.turn(values[:, columns]) for joint, columns, _ in self._joints]
        placed = {0: np.broadcast_to(exactly(np.eye(3)), (len(values), 3, 3))}
        for pair, parent, child in self._way:
            turn = turns[pair]
            if self.mechanism.ends[pair][0] == child:
                turn = turn.swapaxes(1, 2)
            placed[child] = turn if parent == 0 else placed[parent] @ turn
        gaps = [exactly(np.zeros((len(values), 0)))]
        for pair in self._chords:
            a, b = self.mechanism.ends[pair]
            gaps.append(skew_part(placed[a] @ turns[pair] @ placed[b].swapaxes(1, 2)))
        orientations = np.stack([placed[link] for link in range(len(placed))], axis=1)
        return orientations, np.concatenate(gaps, axis=1)

    def vectors(self, values: Balls, placed: Balls) -> Balls:
        """Return the variables' vectors (n, variables, 3) in ground axes, of balls.

        A variable's vector is the angular velocity of its pair's second link relative to
        the first per unit rate.
        """
        vectors = [
            joint.vectors(values[:, columns]) @ placed[:, ends[0]].swapaxes(1, 2)
            for joint, columns, ends in self._joints
        ]
        return np.concatenate(vectors, axis=1)

    def axes(self, values: Balls, placed: Balls) -> Balls:
        """Return (n, pairs, 3): the axis of each R pair, the contact point of others."""
        axes = [
            (placed[:, ends[0]] @ joint.axis(values[:, columns])[..., None])[..., 0]
            for joint, columns, ends in self._joints
        ]
        return np.stack(axes, axis=1)

    def velocities(self, vectors: Balls, rates: Balls) -> Balls:
        """Return angular velocities (n, links, 3) relative to the ground, in its axes.

        At `vectors` (n, variables, 3) and rates (n, variables) of the variables.
        """
        return np.asarray(self._ways @ (vectors * rates[:, :, None]))

    def jacobian(self, vectors: Balls) -> Balls:
        """Return (n, 3 loops, variables): gaps change by it times the variables' rates."""
        moved = self._passes[:, None] * vectors.swapaxes(1, 2)[:, None]
        return np.asarray(
            moved.reshape(len(vectors), 3 * len(self._passes), vectors.shape[1])
        )

    def inverse(self, values: Balls, free: Sequence[int]) -> tuple[Balls, Floats, Balls]:
        """Return the inverse of the Jacobian's free columns, its condition, and gaps."""
        placed, gaps = self.place(values)
        jacobian = self.jacobian(self.vectors(values, placed))[:, :, list(free)]
        return *left_inverse(jacobian), gaps

    def motion(
        self, values: Balls, inverse: Balls, free: Sequence[int], moved: int, order: int
    ) -> list[Balls]:
        """Return the coefficients (k, variables) of all variables' series in one.

        At closed configurations (k, variables); `inverse` is that of the Jacobian's columns
        of the `free` variables, all but those that are held and the moved one. The
        coefficient of each order solves linear equations with the same matrix.
        """
        coefficients = [values, *(exactly(np.zeros(values.shape)) for _ in range(order))]
        coefficients[1][:, moved] = exactly(np.ones(len(values)))
        for power in range(1, order + 1):
            _, gaps = self.place(series(*coefficients[: power + 1]))
            open_ = coefficient(gaps, power)[..., None]
            coefficients[power][:, list(free)] = -(inverse @ open_)[..., 0]
        return coefficients


def turning_rates(placed: Balls, order: int) -> list[Balls]:
    """Return w, dw, ddw (..., 3) so far, of series (..., 3, 3) of rotations."""
    parts = [coefficient(placed, power) for power in range(order + 1)]
    rates = []
    for power in range(order):
        spin = sum(
            (k + 1) * parts[k + 1] @ parts[power - k].swapaxes(-1, -2)
            for k in range(power + 1)
        )
        rates.append((2 if power == 2 else 1) * skew_part(np.asarray(spin)))
    return rates


def skew_part(a: Balls) -> Balls:
    """Return the vectors (..., 3) of the skew parts of matrices (..., 3, 3)."""
    turns = ((2, 1), (0, 2), (1, 0))
    return np.stack([(a[..., p, q] - a[..., q, p]) / 2 for p, q in turns], axis=-1)


def left_inverse(matrices: Balls) -> tuple[Balls, Floats]:
    """Return the pseudo-inverses (n, k, m) of matrices (n, m, k) of full column rank.

    And their conditions (n,) in Frobenius norms, 1 at least. NaN where a matrix has less.
    By the normal equations, with more than twice the digits that they lose.
    """
    flint = library()
    bits, (n, m, k) = precision(), matrices.shape
    inverses = np.full((n, k, m), flint.arb.nan(), dtype=object)
    condition = np.full(n, np.nan)
    for row, given in enumerate(matrices):
        with flint.ctx.workprec(2 * bits + 64):
            a = flint.arb_mat(m, k, list(given.ravel())).mid()
            across = a.transpose()
            try:
                inverse = ((across * a).inv().mid() * across).mid()
            except ZeroDivisionError:
                continue
        made = np.array(inverse.entries(), dtype=object).reshape(k, m)
        sizes = [np.linalg.norm(floats(matrix)) for matrix in (given, made)]
        size = max(float(np.prod(sizes)), 1.0)
        if size * 2.0**-bits < SINGULAR:
            inverses[row], condition[row] = made, size
    return inverses, condition
