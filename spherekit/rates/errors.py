"""What rates of links may be off by: loops that do not quite close, and rounding.

A configuration closes its loops up to their residual and the rounding of the numbers
they are made of. Whichever way they stay open, the links lie elsewhere, their axes with
them, and so the velocity equations have other coefficients. Each of these ways, three a
loop, is followed here to first order through the orientations, the rates and their
derivatives, so that nothing is left out where a number happens to be round.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS
from spherekit.motion.linearisation import Linearisation
from spherekit.motion.loops import LoopTree
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats

STEP = 1e-6
"""Largest move (rad) of the difference that contacts are followed with."""


@final
@dataclass(frozen=True)
class RateErrors:
    """How rates change when loops open, by how much they do, and what is rounding.

    Arrays are component-first, (..., 3, ways, n): `turned` (links) and `axes` (pairs) are
    what orientations and pair axes turn by when loops open by one radian in each of the
    ways, `w` and `dw` (links) what rates and their derivatives change by. `open`, `slip`,
    `bend` (n,) bound how far the loops, their velocity equations and those of second
    derivatives are from closed, in each way. `numbers` (rad) is the rounding of the axes
    themselves: two, and one for each pair on the way from the ground.
    """

    turned: Floats
    axes: Floats
    w: Floats
    dw: Floats
    open: Floats
    slip: Floats
    bend: Floats
    numbers: float

    def turned_between(self, i: int, j: int) -> Floats:
        """Return (n,) what link j turns by, seen from i, the ways added up."""
        return _sum_of_sizes(self.turned[j] - self.turned[i])

    def of_vectors(self, i: int, j: int) -> tuple[Floats, Floats, Floats]:
        """Return (n,) bounds of the errors of link j's orientation, w, dw, seen from i."""
        turned, w, dw = (
            _sum_of_sizes(part[j] - part[i]) for part in (self.turned, self.w, self.dw)
        )
        return (
            self.open * turned,
            self.open * w + self.slip * turned,
            self.open * dw + 3.0 * self.slip * w + self.bend * turned,
        )

    def largest(self, rows: NDArray[np.bool_]) -> tuple[Floats, Floats, Floats]:
        """Return bounds (rows,) of the errors of any link's orientation, w and dw."""
        turned, w, dw = (
            np.max(np.stack([_sum_of_sizes(link[..., rows]) for link in part]), axis=0)
            for part in (self.turned, self.w, self.dw)
        )
        gap, slip, bend = self.open[rows], self.slip[rows], self.bend[rows]
        return (
            gap * turned,
            gap * w + slip * turned,
            gap * dw + 3 * slip * w + bend * turned,
        )

    def along(self, i: int, j: int, unit: Floats) -> tuple[Floats, Floats, Floats]:
        """Return (n,) bounds of the errors of w and dw, of link j seen from i.

        Along `unit` (3, n); the third is that of w across it.
        """
        turned = self.turned_between(i, j)
        w, dw = self.w[j] - self.w[i], self.dw[j] - self.dw[i]
        part = _component(unit, w)
        whole = _sum_of_sizes(w)
        w -= unit[:, None] * part
        slip = self.slip * turned
        rate = self.open * np.sum(np.abs(part), axis=0) + slip
        change = self.open * np.sum(np.abs(_component(unit, dw)), axis=0)
        change += 3.0 * self.slip * whole + self.bend * turned
        return rate, change, self.open * _sum_of_sizes(w) + slip

    def of_axis(self, pair: int) -> Floats:
        """Return (n,) a bound of what the axis of a pair is off by, rad."""
        return self.numbers + self.open * _sum_of_sizes(self.axes[pair])


@final
@dataclass(frozen=True)
class RoughErrors:
    """The same of R pairs, from norms alone: quick, and two or three digits too wide.

    `turned` (links, n) and `w`, `dw` (n,) bound the sums of the ways; the rest is as in
    `RateErrors`.
    """

    turned: Floats
    first: tuple[int, ...]
    w: Floats
    dw: Floats
    open: Floats
    slip: Floats
    bend: Floats
    numbers: float

    @property
    def widest(self) -> Floats:
        """(n,) a bound of the error of any derivative."""
        turned = np.max(self.turned, axis=0)
        error = self.open * self.dw + 3.0 * self.slip * self.w + self.bend * turned
        return np.asarray(error)

    def turned_between(self, i: int, j: int) -> Floats:
        """See `RateErrors`."""
        return np.asarray(self.turned[i] + self.turned[j])

    def of_vectors(self, i: int, j: int) -> tuple[Floats, Floats, Floats]:
        """See `RateErrors`."""
        turned = self.turned_between(i, j)
        return (
            self.open * turned,
            2.0 * self.open * self.w + self.slip * turned,
            2.0 * self.open * self.dw + 6.0 * self.slip * self.w + self.bend * turned,
        )

    def along(self, i: int, j: int, unit: Floats) -> tuple[Floats, Floats, Floats]:
        """See `RateErrors`."""
        del unit
        _, w, dw = self.of_vectors(i, j)
        return w.copy(), dw, w

    def of_axis(self, pair: int) -> Floats:
        """See `RateErrors`."""
        return np.asarray(self.numbers + self.open * self.turned[self.first[pair]])

    def take(self, rows: NDArray[np.intp]) -> "RoughErrors":
        """Return some of the rows."""
        return RoughErrors(
            self.turned[:, rows],
            self.first,
            self.w[rows],
            self.dw[rows],
            self.open[rows],
            self.slip[rows],
            self.bend[rows],
            self.numbers,
        )


def rough_errors(
    motion: Motion, inverse: Floats, rates: Floats, change: Floats
) -> RoughErrors:
    """Return the same as `rate_errors` from norms, of a mechanism that has R pairs only."""
    tree = motion.linearisation.tree
    size = np.abs(np.moveaxis(inverse, 0, -1))
    moved = np.zeros((rates.shape[1], *size.shape[1:]))
    moved[np.array(motion.free, dtype=np.intp)] = size
    ways = np.zeros((tree.count, *size.shape[1:]))
    swept = np.zeros((tree.count, len(rates)))
    speed, bent = np.abs(rates.T), np.abs(change.T)
    for pair, parent, child in tree.placements:
        (variable,) = motion.mechanism.variables_of(pair)
        ways[child] = ways[parent] + moved[variable]
        swept[child] = swept[parent] + speed[variable]
    turned = np.sum(ways, axis=1)
    most = np.sum(np.max(ways, axis=0), axis=0)
    all_moved = np.sum(moved, axis=(0, 1))
    fast, bends, spin = np.sum(speed, axis=0), np.sum(bent, axis=0), np.max(swept, axis=0)
    w = fast * most * (1.0 + most)
    dw = bends * most + fast * (w + spin * most) + spin * all_moved * fast * most
    numbers = _numbers(tree)
    slip, bend = numbers * fast, numbers * (bends + 2.0 * fast * spin)
    first = tuple(a for a, _ in tree.ends)
    dw *= 1.0 + most
    return RoughErrors(turned, first, w, dw, motion.gap, slip, bend, numbers)


def _numbers(tree: LoopTree) -> float:
    """Return the rounding (rad) of axes that are placed from the ground."""
    return EPS * (2.0 + float(np.max(np.count_nonzero(tree.paths, axis=1))))


def rate_errors(
    motion: Motion, inverse: Floats, rates: Floats, change: Floats
) -> RateErrors:
    """Return what the rates of links at the rows of a motion may be off by.

    `inverse` (n, free variables, equations) is that of the closure Jacobian without the
    inputs, `rates` and `change` (n, variables) are the first and second derivatives of all
    variables by the input that moves.
    """
    tree = motion.linearisation.tree
    pairs = _Pairs(motion)
    vectors = pairs.vectors[:, :, None]
    ways = inverse.shape[2]
    back = np.ascontiguousarray(np.moveaxis(inverse, 0, -1))
    count, n = rates.shape[1], len(rates)
    free = np.array(motion.free, dtype=np.intp)
    owned = [motion.mechanism.variables_of(pair) for pair in range(len(tree.ends))]

    def bodies(parts: Floats) -> Floats:
        """Return what links turn by (links, 3, ways, n), of `parts` of the variables."""
        turns = np.zeros((tree.count, *parts.shape[1:]))
        for pair, parent, child in tree.placements:
            turns[child] = turns[parent]
            for variable in owned[pair]:
                if tree.ends[pair][0] == parent:
                    turns[child] += parts[variable]
                else:
                    turns[child] -= parts[variable]
        return turns

    def solved(parts: Floats) -> Floats:
        """Return what variables change by (V, 1, ways, n) where `parts` open the loops."""
        loops = np.zeros((len(tree.signs), *parts.shape[1:]))
        for loop, row in zip(loops, tree.signs, strict=True):
            for variable in np.flatnonzero(row):
                if row[variable] > 0.0:
                    loop -= parts[variable]
                else:
                    loop += parts[variable]
        response = np.zeros((count, 1, *parts.shape[2:]))
        for way, opened in enumerate(loops.reshape(-1, *parts.shape[2:])):
            for variable, closing in zip(free, back[:, way], strict=True):
                response[variable, 0] += closing * opened
        return response

    moved = np.zeros((count, 1, ways, n))
    moved[free, 0] = back
    turned = bodies(vectors * moved)
    first, axes = pairs.turned(turned)
    speed, bent = rates.T[:, None, None], change.T[:, None, None]
    skew = first * speed
    faster = solved(skew)
    skew += vectors * faster
    w = bodies(skew)
    own_w = bodies(vectors * speed)
    changes, _ = pairs.turned(own_w)
    second = pairs.turned_on(turned, first, own_w, w, changes, moved[:, 0])
    for variable, skewed in enumerate(skew):
        np.multiply(first[variable], bent[variable], out=skewed)
        skewed += second[variable] * speed[variable]
        skewed += changes[variable] * faster[variable]
    skew += vectors * solved(skew)
    dw = bodies(skew)
    size = _size(vectors)
    held = [tree.ends[owner][0] for owner in tree.owners]
    swing = _size(changes) + _size(own_w)[held] * size
    numbers = _numbers(tree)
    slip = numbers * np.sum(np.abs(speed[:, 0]) * size, axis=0)[0]
    bend = (
        numbers * np.sum(np.abs(bent[:, 0]) * size + np.abs(speed[:, 0]) * swing, axis=0)[0]
    )
    return RateErrors(turned, axes, w, dw, motion.gap, slip, bend, numbers)


@final
class _Pairs:
    """The pairs of a motion's rows, component-first, as links turn."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._at = motion.linearisation
        self._revolute = not motion.mechanism.has_contacts
        self.vectors = np.ascontiguousarray(np.moveaxis(motion.vectors, 0, -1))

    def turned(self, w: Floats) -> tuple[Floats, Floats]:
        """Return how vectors and axes change, as links (links, 3, ways, n) turn."""
        if self._revolute:
            changes = np.zeros((len(self.vectors), *w.shape[1:]))
            self._add_turned(changes, w)
            return changes, changes
        rows = np.tile(np.arange(w.shape[3]), w.shape[2])
        return self._general(self._at if w.shape[2] == 1 else self._at.take(rows), w)

    def turned_on(
        self,
        turned: Floats,
        first: Floats,
        w: Floats,
        changed: Floats,
        changes: Floats,
        moved: Floats,
    ) -> Floats:
        """Return how the `changes` of vectors, links turning at w, change themselves.

        That is as links turn by `turned`, variables move by `moved` (V, ways, n), vectors
        change by `first`, and w by `changed`. With contacts it is a difference.
        """
        owners = self._at.tree.firsts
        if self._revolute:
            second_changes = np.zeros(first.shape)
            self._add_turned(second_changes, changed)
            for owner, changed_again, one in zip(
                owners, second_changes, first, strict=True
            ):
                _add_cross(changed_again, w[owner], one)
            return second_changes
        motion = self._motion
        ways = moved.shape[1]
        largest = np.max(np.abs(turned), axis=(0, 1), initial=1.0)
        h = STEP / np.maximum(largest, np.max(np.abs(moved), axis=0, initial=1.0))
        values = motion.values.T[:, None] + h * moved
        placed = np.tile(motion.rotations, (ways, 1, 1, 1))
        turn = _rows(h * turned)
        placed = placed + np.cross(turn[:, :, :, None], placed, axis=2)
        values = values.reshape(len(values), -1).T
        there = Linearisation(self._at.tree, motion.joints, values, None, placed)
        later, _ = self._general(there, w + h * changed)
        return np.asarray((later - changes) / h)

    def _add_turned(self, out: Floats, w: Floats) -> None:
        """Add how the vectors of R pairs turn with their first links."""
        owners = self._at.tree.firsts
        for change, owner, vector in zip(out, owners, self.vectors, strict=True):
            _add_cross(change, w[owner], vector[:, None])

    @staticmethod
    def _general(at: Linearisation, w: Floats) -> tuple[Floats, Floats]:
        changed, ways = at.turned(_rows(w)), w.shape[2]
        return _columns(changed.vectors, ways), _columns(changed.axes, ways)


def _rows(parts: Floats) -> Floats:
    """Return (ways * n, m, 3) from (m, 3, ways, n)."""
    return np.asarray(parts.transpose(2, 3, 0, 1).reshape(-1, len(parts), 3))


def _columns(rows: Floats, ways: int) -> Floats:
    """Return (m, 3, ways, n) from (ways * n, m, 3)."""
    split = rows.reshape(ways, -1, *rows.shape[1:])
    return np.ascontiguousarray(split.transpose(2, 3, 0, 1))


def _add_cross(out: Floats, a: Floats, b: Floats) -> None:
    """Add a x b of arrays (3, ways, n) to another."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k] += a[i] * b[j]
        out[k] -= a[j] * b[i]


def _size(vectors: Floats) -> Floats:
    return np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)


def _component(unit: Floats, vectors: Floats) -> Floats:
    """Return (ways, n) the component of vectors (3, ways, n) along unit (3, n)."""
    return np.asarray(unit[0] * vectors[0] + unit[1] * vectors[1] + unit[2] * vectors[2])


def _sum_of_sizes(vectors: Floats) -> Floats:
    """Return (n,) the sum of the sizes, by components, of vectors (3, ways, n)."""
    return np.asarray(np.sum(np.abs(vectors).reshape(-1, vectors.shape[2]), axis=0))
