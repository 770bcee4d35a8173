"""Angular velocities straight from the loop-closure velocity equations.

The independent route beside the pole axes: exact wherever the mechanism has a unique
motion, whatever its topology. It solves irreducible parts, takes over from the plan at
configurations where that is badly conditioned, and gives mobility by rank.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import SINGULAR_RATIO
from spherekit.motion.loops import LoopTree, left_inverse
from spherekit.motion.motion import Motion
from spherekit.numeric.rows import ArrayRows
from spherekit.rates.errors import RateErrors, RoughErrors, rate_errors, rough_errors
from spherekit.sphere.rotation import Floats

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
PIECE = 4096
"""Rows whose errors are followed at once."""


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
    def errors(self) -> RateErrors:
        """What the rates may be off by."""
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            return rate_errors(self.motion, self.inverse, self.rates, self.change)

    @cached_property
    def _largest(self) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Which rows (n,) are near, and how far any w and dw may be off there.

        Elsewhere the loops hold the links so well that neither can be lost.
        """
        near = ~(self.reciprocal_condition >= NEARLY_FLAT)
        off = np.zeros((2, len(near)))
        if np.any(near):
            whole = len(near) <= PIECE
            errors = self.errors if whole else self.rows(near).errors
            rows = near if whole else np.ones(int(np.sum(near)), dtype=bool)
            off[:, near] = errors.largest(rows)[1:]
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

    def parts(
        self,
    ) -> Iterator[tuple[NDArray[np.intp], "Equations", RateErrors | RoughErrors]]:
        """Yield all rows in groups: their numbers, their equations, and their errors.

        First those that norms alone show to be good.
        """
        left = np.ones(len(self.motion), dtype=bool)
        if not self.motion.mechanism.has_contacts:
            with np.errstate(invalid="ignore", over="ignore"):
                rough = rough_errors(self.motion, self.inverse, self.rates, self.change)
                left = ~((rough.widest < GOOD) & (self.reciprocal_condition >= NEARLY_FLAT))
            rows = np.flatnonzero(~left)
            yield (
                rows,
                self if len(rows) == len(left) else self.rows(~left),
                rough.take(rows),
            )
        rest = np.flatnonzero(left)
        for start in range(0, len(rest), PIECE):
            rows = rest[start : start + PIECE]
            chosen = np.zeros(len(left), dtype=bool)
            chosen[rows] = True
            part = self if len(rows) == len(left) else self.rows(chosen)
            yield rows, part, part.errors


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
