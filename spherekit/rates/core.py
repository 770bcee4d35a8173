"""Angular velocities straight from the loop-closure velocity equations.

The independent route beside the pole axes: exact wherever the mechanism has a unique
motion, whatever its topology. It solves irreducible parts, takes over from the plan at
configurations where that is badly conditioned, and gives mobility by rank.

Vector algebra on component-first arrays (..., 3, n), the layout of the kernels.

What rates of links may be off by: loops that do not quite close, and rounding.

A configuration closes its loops up to their residual and the rounding of the numbers
they are made of. Whichever way they stay open, the links lie elsewhere, their axes with
them, and so the velocity equations have other coefficients. Each of these ways, three a
loop, is followed here to first order through the orientations, the rates and their
derivatives, so that nothing is left out where a number happens to be round.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS, SINGULAR_RATIO
from spherekit.motion.loops import Linearisation, LoopTree, left_inverse
from spherekit.motion.motion import Motion
from spherekit.numeric.zeros import ArrayRows
from spherekit.sphere.rotation import Floats


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b for arrays (..., 3, n)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    a0, a1, a2 = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    b0, b1, b2 = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    out[..., 0, :] = a1 * b2 - a2 * b1
    out[..., 1, :] = a2 * b0 - a0 * b2
    out[..., 2, :] = a0 * b1 - a1 * b0
    return out


def dot(a: Floats, b: Floats) -> Floats:
    """Return a . b (..., n) for arrays (..., 3, n)."""
    return np.asarray(
        a[..., 0, :] * b[..., 0, :]
        + a[..., 1, :] * b[..., 1, :]
        + a[..., 2, :] * b[..., 2, :]
    )


def norm(a: Floats) -> Floats:
    """Return |a| (..., n) for arrays (..., 3, n)."""
    return np.sqrt(dot(a, a))


INCONSISTENT = 1e-10
"""Velocity or acceleration equations that leave over more, relatively, have no solution."""
NEARLY_FLAT = 1e-3
"""Only equations flatter than this can lose their rates to what loops stay open by."""
TRUSTED_CHANGE = 1e-2
"""Rates, or derivatives, that may be off by a larger part than this are lost."""
SECOND_ORDER = 4.0
"""Errors of second order, over those of first times the bend of the loops, at most."""
GOOD = 1e-10
"""Where no derivative can be off by more, norms are enough to say so."""
PIECE = 1024
"""Rows whose errors are followed at once."""
STEP = 1e-6
"""Largest move (rad) of the difference that these are followed with."""


@final
@dataclass(frozen=True)
class LinkRates:
    """First and second derivatives by the motion's parameter of a set of bodies.

    `w`, `dw`: (n, bodies, 3) angular velocity relative to body 0 and its derivative;
    `reciprocal_condition`: (n,) reciprocal condition of the equations, 0 where what loops
    stay open by leaves nothing of the rates or of their derivatives.
    """

    w: Floats
    dw: Floats
    reciprocal_condition: Floats

    def relative(self, i: int, j: int) -> tuple[Floats, Floats]:
        """Return w and dw (n, 3) of body j relative to body i."""
        return self.w[:, j] - self.w[:, i], self.dw[:, j] - self.dw[:, i]


@final
@dataclass(frozen=True)
class Equations(ArrayRows):
    """The velocity equations of all rows of a motion, solved while one input moves.

    `rates`, `change` (n, variables): first and second derivatives of all variables by the
    input; `inverse` (n, free variables, equations) of the closure Jacobian; `w`, `dw`
    (n, links, 3) those of the links; `reciprocal_condition` (n,) the reciprocal condition,
    0 where redundant equations contradict each other.
    """

    motion: Motion
    rates: Floats
    change: Floats
    inverse: Floats
    w: Floats
    dw: Floats
    reciprocal_condition: Floats

    @cached_property
    def errors(self) -> "RateErrors":
        """What the rates may be off by."""
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            return rate_errors(self)

    @cached_property
    def _largest(self) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Which rows (n,) are near, and how far any w and dw may be off there.

        Elsewhere the loops hold the links so well that neither can be lost.
        """
        near = ~(self.reciprocal_condition >= NEARLY_FLAT)
        off = np.zeros((2, len(near)))
        if np.any(near):
            off[:, near] = self.rows(near).errors.largest()[1:]
        return near, *off

    @cached_property
    def loss(self) -> Floats:
        """(n,) the part of w or dw, whichever is larger, that may be off.

        Of the largest of all links, or of 1, where that is smaller. Infinite where they are
        lost; 0 where it cannot matter.
        """
        near, *off = self._largest
        with np.errstate(invalid="ignore"):
            parts = np.maximum(
                off[0] / np.maximum(_longest(self.w), 1.0),
                off[1] / np.maximum(_longest(self.dw), 1.0),
            )
        held = (parts <= TRUSTED_CHANGE) & (self.reciprocal_condition >= SINGULAR_RATIO)
        return np.where(held | ~near, parts, np.inf)

    @cached_property
    def second_order(self) -> tuple[Floats, Floats]:
        """(n,) twice: what errors of w and dw may have beyond those of first order."""
        _, *off = self._largest
        part = SECOND_ORDER * np.fmin(self.motion.bend, 0.5)
        return part * off[0], part * off[1]

    def parts(self) -> Iterator[tuple[NDArray[np.intp], "Equations", "RoughErrors"]]:
        """Yield all rows in groups: their numbers, their equations, and their errors.

        First those that norms alone show to be good.
        """
        left = np.ones(len(self.motion), dtype=bool)
        if not self.motion.mechanism.has_contacts:
            with np.errstate(invalid="ignore", over="ignore"):
                rough = rough_errors(self)
                _, _, widest = rough.off(np.max(rough.turned, axis=1), rough.w, rough.dw)
                left = ~((widest < GOOD) & (self.reciprocal_condition >= NEARLY_FLAT))
            good = self.rows(~left) if np.any(left) else self
            yield np.flatnonzero(~left), good, rough.rows(~left)
        rest = np.flatnonzero(left)
        for start in range(0, len(rest), PIECE):
            rows = rest[start : start + PIECE]
            part = self if len(rows) == len(left) else self.rows(rows)
            yield rows, part, part.errors


@dataclass(frozen=True)
class RoughErrors(ArrayRows):
    """What rates of R pairs may be off by, from norms alone.

    Quick, and two or three digits too wide. A configuration closes its loops up to their
    residual and the rounding of the numbers they are made of. Whichever way they stay open,
    the links lie elsewhere, their axes with them, and so the velocity equations have other
    coefficients. `turned` (n, links) and `w`, `dw` (n,) bound the sums over these ways,
    three a loop, of what orientations, rates and their derivatives change by when loops
    open by one radian. `open`, `slip`, `bend` (n,) bound how far the loops, their velocity
    equations and those of second derivatives are from closed, in each way. `numbers` (rad)
    is the rounding of the axes themselves: two, and one for each pair on the way from the
    ground.
    """

    turned: Floats
    w: Floats
    dw: Floats
    open: Floats
    slip: Floats
    bend: Floats
    numbers: float
    tree: LoopTree

    def sizes(self, i: int, j: int) -> tuple[Floats, Floats, Floats]:
        """Return (n,) what link j turns by, its w and dw change by, seen from link i."""
        return self.turned[:, i] + self.turned[:, j], 2.0 * self.w, 2.0 * self.dw

    def off(self, turned: Floats, w: Floats, dw: Floats) -> tuple[Floats, Floats, Floats]:
        """Return (n,) bounds of the errors of an orientation, w and dw, from such sizes."""
        return (
            self.open * turned,
            self.open * w + self.slip * turned,
            self.open * dw + 3.0 * self.slip * w + self.bend * turned,
        )

    def along(self, i: int, j: int, unit: Floats) -> tuple[Floats, Floats, Floats]:
        """Return (n,) bounds of the errors of w and dw, of link j seen from i.

        Along `unit` (3, n); the third is that of w across it.
        """
        del unit
        _, w, dw = self.off(*self.sizes(i, j))
        return w.copy(), dw, w

    def of_axis(self, pair: int) -> Floats:
        """Return (n,) a bound of what the axis of a pair is off by, rad."""
        return np.asarray(self.numbers + self.open * self.turned[:, self.tree.firsts[pair]])


@final
@dataclass(frozen=True)
class RateErrors(RoughErrors):
    """The same of any pairs, with each way followed to first order through the rates.

    `turned`, `w` and `dw` (links, 3, ways, n) are what links do, `axes` (pairs, 3, ways, n)
    is what axes turn by; nothing is left out where a number happens to be round.
    """

    axes: Floats

    def sizes(self, i: int, j: int) -> tuple[Floats, Floats, Floats]:
        """See `RoughErrors`."""
        parts = (self.turned, self.w, self.dw)
        turned, w, dw = (_sum_of_sizes(part[j] - part[i]) for part in parts)
        return turned, w, dw

    def largest(self) -> tuple[Floats, Floats, Floats]:
        """Return bounds (n,) of the errors of any link's orientation, w and dw."""
        every = [self.sizes(0, link) for link in range(self.tree.count)]
        turned, w, dw = (
            np.max(np.stack(sizes), axis=0) for sizes in zip(*every, strict=True)
        )
        return self.off(turned, w, dw)

    def along(self, i: int, j: int, unit: Floats) -> tuple[Floats, Floats, Floats]:
        """See `RoughErrors`."""
        turned, _, _ = self.sizes(i, j)
        w, dw = (part[j] - part[i] for part in (self.w, self.dw))
        along, bent = (np.einsum("kn,kwn->wn", unit, part) for part in (w, dw))
        slip, whole = self.slip * turned, _sum_of_sizes(w)
        across = _sum_of_sizes(w - unit[:, None] * along)
        rate = self.open * np.sum(np.abs(along), axis=0) + slip
        change = self.open * np.sum(np.abs(bent), axis=0)
        change += 3.0 * self.slip * whole + self.bend * turned
        return rate, change, self.open * across + slip

    def of_axis(self, pair: int) -> Floats:
        """See `RoughErrors`."""
        return np.asarray(self.numbers + self.open * _sum_of_sizes(self.axes[pair]))


def _sum_of_sizes(vectors: Floats) -> Floats:
    """Return (n,) the sum of the sizes, by components, of vectors (3, ways, n)."""
    return np.asarray(np.sum(np.abs(vectors), axis=(0, 1)))


def _numbers(tree: LoopTree) -> float:
    """Return the rounding (rad) of axes that are placed from the ground."""
    return EPS * (2.0 + tree.longest_path)


def rough_errors(solved: Equations) -> RoughErrors:
    """Return what the rates of links that R pairs join may be off by, from norms."""
    motion, tree = solved.motion, solved.motion.linearisation.tree
    moved = np.zeros((solved.rates.shape[1], *solved.inverse.shape[2:], len(motion)))
    moved[list(motion.free)] = np.abs(np.moveaxis(solved.inverse, 0, -1))
    speed, bent = np.abs(solved.rates.T), np.abs(solved.change.T)
    used = np.abs(tree.paths)
    ways = _summed(used, moved)
    most = np.sum(np.max(ways, axis=0), axis=0)
    fast, bends = np.sum(speed, axis=0), np.sum(bent, axis=0)
    spin = np.max(used @ speed, axis=0)
    dw = bends * most + fast * (fast * most * (1.0 + most) + spin * most)
    dw += spin * np.sum(moved, axis=(0, 1)) * fast * most
    numbers = _numbers(tree)
    return RoughErrors(
        np.sum(ways, axis=1).T,
        fast * most * (1.0 + most),
        dw * (1.0 + most),
        motion.gap,
        numbers * fast,
        numbers * (bends + 2.0 * fast * spin),
        numbers,
        tree,
    )


def rate_errors(solved: Equations) -> RateErrors:
    """Return what the rates of links at the rows of a motion may be off by."""
    motion, at = solved.motion, solved.motion.linearisation
    n, _, ways = solved.inverse.shape
    tree, free = at.tree, list(motion.free)
    back = np.ascontiguousarray(np.moveaxis(solved.inverse, 0, -1))
    vectors = np.tile(_columns(motion.vectors), ways)
    rates, change = (np.tile(x.T, ways)[:, None] for x in (solved.rates, solved.change))
    contacts = motion.mechanism.has_contacts
    if contacts:
        at = at.take(np.tile(np.arange(n), ways))

    def turn(w: Floats) -> tuple[Floats, Floats]:
        """Return how vectors and axes of pairs change as links (links, 3, rows) turn."""
        if contacts:
            turned = at.turned(_rows(w))
            return _columns(turned.vectors), _columns(turned.axes)
        carried = cross(w[tree.firsts], vectors)
        return carried, carried

    def moved_by(opened: Floats) -> Floats:
        """Return what variables (V, 1, rows) change by as loops open (ways, ways, n)."""
        moved = np.zeros(rates.shape)
        moved[free, 0] = np.einsum("fen,ewn->fwn", back, opened).reshape(len(free), -1)
        return moved

    def followed(skew: Floats) -> tuple[Floats, Floats]:
        """Return what variables and links do where vectors' parts (V, 3, rows) skew."""
        moved = moved_by(-_summed(tree.signs, skew).reshape(ways, ways, n))
        return moved, _summed(tree.paths, skew + vectors * moved)

    moved = moved_by(np.broadcast_to(np.eye(ways)[..., None], (ways, ways, n)))
    turned = _summed(tree.paths, vectors * moved)
    first, axes = turn(turned)
    faster, w = followed(first * rates)
    turning = _summed(tree.paths, vectors * rates)
    changes, _ = turn(turning)
    if contacts:
        # How the changes of vectors change themselves is a difference along the way.
        largest = [np.max(np.abs(x), axis=(0, 1), initial=1.0) for x in (turned, moved)]
        h = STEP / np.maximum(*largest)
        placed = at.placed + np.cross(_rows(h * turned)[..., None], at.placed, axis=2)
        values = at.values + (h * moved[:, 0]).T
        at = Linearisation(tree, at.joints, values, None, placed)
        second = (turn(turning + h * w)[0] - changes) / h
    else:
        second = turn(w)[0] + cross(turning[tree.firsts], first)
    _, dw = followed(first * change + second * rates + changes * faster)
    size, swing = norm(vectors), norm(changes)
    swing += norm(turning)[tree.firsts][list(tree.owners)] * size
    speed, bent, numbers = np.abs(rates[:, 0]), np.abs(change[:, 0]), _numbers(tree)
    shape = -1, 3, ways, n
    return RateErrors(
        turned.reshape(shape),
        w.reshape(shape),
        dw.reshape(shape),
        motion.gap,
        numbers * np.sum(speed * size, axis=0)[:n],
        numbers * np.sum(bent * size + speed * swing, axis=0)[:n],
        numbers,
        tree,
        axes.reshape(shape),
    )


def _summed(signs: Floats, parts: Floats) -> Floats:
    """Return the sums (m, 3, n) of parts (V, 3, n) with signs (m, V) of 1, 0 or -1."""
    add = np.add.reduce
    return np.stack([add(parts[row > 0.0]) - add(parts[row < 0.0]) for row in signs])


def _columns(rows: Floats) -> Floats:
    """Return (m, 3, n) from (n, m, 3)."""
    return np.ascontiguousarray(np.moveaxis(rows, 0, -1))


def _rows(columns: Floats) -> Floats:
    """Return (n, m, 3) from (m, 3, n)."""
    return np.ascontiguousarray(np.moveaxis(columns, -1, 0))


def driven_rates(motion: Motion, rows: NDArray[np.bool_], driven: int) -> LinkRates:
    """Return the rates of links relative to the ground, per unit rate of one input.

    `rows` (n,) says which rows of the motion are wanted, `driven` is the number of the
    input pair that moves; the other inputs stand still.
    """
    solved = equations(motion.rows(rows), driven)
    near = ~(solved.reciprocal_condition >= NEARLY_FLAT)
    reciprocal_condition = solved.reciprocal_condition.copy()
    if np.any(near):
        lost = np.isinf(solved.rows(near).loss)
        reciprocal_condition[near] = np.where(lost, 0.0, reciprocal_condition[near])
    return LinkRates(solved.w, solved.dw, reciprocal_condition)


def _longest(vectors: Floats) -> Floats:
    """Return the length (n,) of the longest of vectors (n, bodies, 3)."""
    return np.asarray(np.max(np.linalg.norm(vectors, axis=2), axis=1))


def equations(motion: Motion, driven: int) -> Equations:
    """Return the velocity equations at all rows, solved while the input `driven` moves."""
    at, free = motion.linearisation, list(motion.free)
    tree = at.tree
    (moved,) = motion.mechanism.variables_of(driven)
    matrix, inverse = motion.free_jacobian, motion.closure_inverse
    rates = np.zeros_like(motion.values)
    rates[:, moved] = 1.0
    rates[:, free], over = _solved(matrix, inverse, -at.jacobian[:, :, moved])
    w = at.body_rates(rates)
    turned = at.turned(w).vectors
    change = np.zeros_like(rates)
    bias = (tree.jacobian(turned) @ rates[:, :, None])[..., 0]
    change[:, free], bent = _solved(matrix, inverse, -bias)
    dw = at.body_rates(change) + tree.body_rates(turned, rates)
    # An open chain whose pairs are all driven has no equations, and nothing to lose.
    reciprocal_condition = np.ones(len(w))
    if free:
        size = np.linalg.norm(matrix, axis=(1, 2))
        reciprocal_condition = 1.0 / (np.linalg.norm(inverse, axis=(1, 2)) * size)
    # Redundant constraints may admit a velocity, but no motion that goes on with it.
    reciprocal_condition[~(np.maximum(over, bent) < INCONSISTENT)] = 0.0
    return Equations(motion, rates, change, inverse, w, dw, reciprocal_condition)


def _solved(matrix: Floats, inverse: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return x (n, k) with matrix x = right, and what is left over (n,), relative.

    The product with an inverse loses digits where x is small beside the inverse; two
    steps of iterative refinement bring them back (Higham 2002, section 12.1).
    """
    x = _times(inverse, right)
    for _ in range(2):
        left = right - _times(matrix, x)
        x = x + _times(inverse, left)
    left = np.linalg.norm(right - _times(matrix, x), axis=1)
    scale = np.linalg.norm(right, axis=1) + np.linalg.norm(x, axis=1)
    return x, left / np.maximum(scale, 1.0)


def _times(matrices: Floats, vectors: Floats) -> Floats:
    return np.asarray((matrices @ vectors[:, :, None])[..., 0])


@final
@dataclass(frozen=True)
class NullMotion:
    """The motion of a single-freedom part up to its scale.

    `rates` (n, variables) has unit length; `inverse` (n, variables, variables) is of the
    equations bordered by them, and gives derivatives; `w` (n, bodies, 3).
    """

    rates: Floats
    inverse: Floats
    w: Floats


def null_motion(tree: LoopTree, vectors: Floats) -> NullMotion:
    """Return the null vector of a part's velocity equations, vectors (n, variables, 3)."""
    jacobian = tree.jacobian(vectors)
    n, _, count = jacobian.shape
    border = np.broadcast_to(np.cos(1.0 + np.arange(count)), (n, count))
    for _ in range(2):
        bordered = np.concatenate([jacobian, border[:, None, :]], axis=1)
        inverse = left_inverse(bordered)
        rates = inverse[:, :, -1]
        rates = rates / np.linalg.norm(rates, axis=1, keepdims=True)
        border = rates
    return NullMotion(rates, inverse, tree.body_rates(vectors, rates))


def null_second_rates(tree: LoopTree, turned: Floats, motion: NullMotion) -> Floats:
    """Return the derivative (n, variables) of `motion.rates` by arc length.

    `turned` (n, variables, 3) is that of the variables' vectors.
    """
    bias = np.einsum("nij,nj->ni", tree.jacobian(turned), motion.rates)
    return np.asarray(-np.einsum("nij,nj->ni", motion.inverse[:, :, :-1], bias))


def null_motion_rate(
    tree: LoopTree, vectors: Floats, turned: Floats, motion: NullMotion
) -> Floats:
    """Return the derivative (n, bodies, 3) of `motion.w`, given that of the vectors."""
    second = null_second_rates(tree, turned, motion)
    return tree.body_rates(vectors, second) + tree.body_rates(turned, motion.rates)
