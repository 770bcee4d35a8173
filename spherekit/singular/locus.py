"""Where a mechanism is singular: its locus in the space of configurations, made regular.

With x a unit vector of rates that close the loops, the singular configurations of a
mechanism with g freedoms are those with E x = 0: the inputs stand still in a motion
(type II), or the output does (type I). Configuration and x together solve a regular
system: loops closed, J x = 0, E x = 0, |x| = 1, whose solutions have g - 1 dimensions.
Newton's method works in the tangent space of the loops, with exact second derivatives.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.closure import Closure
from spherekit.motion.continuation import NewtonSteps
from spherekit.motion.loops import REDUNDANT
from spherekit.numeric.rows import ArrayRows
from spherekit.singular.stationarity import (
    TINY,
    OutputPart,
    StationarityConstraint,
    TangentSpace,
    tangent_space,
)
from spherekit.sphere.rotation import Floats

MOST_CORRECTIONS = 8
CORRECTED = 1e-10
"""A Newton step (rad) below this leaves an error that its square bounds."""
ON_LOCUS = CLOSURE_TOLERANCE
"""Largest residual, of the loops (rad) and of E x, of a point that is given."""
TRUST = 0.3
"""Largest change of a variable (rad) in one step."""


@final
@dataclass(frozen=True)
class Measure:
    """How singular n configurations are.

    `small` (n, m, k) is E on the basis of the motions looked at, `smallest` (n,) its
    smallest singular value and `motion` (n, V) the unit rates of that. Where `signed` is
    false, as E has more than k rows or the sense of the basis is not fixed, `value` is that
    of E^T E.
    """

    rest: StationarityConstraint
    space: TangentSpace
    moving: TangentSpace
    small: Floats
    smallest: Floats
    motion: Floats

    @property
    def signed(self) -> bool:
        """Whether `value` changes its sign on the locus, instead of touching zero."""
        return self.moving.oriented and self.small.shape[1] == self.small.shape[2]

    @cached_property
    def _square(self) -> Floats:
        return self.small if self.signed else np.swapaxes(self.small, 1, 2) @ self.small

    @property
    def value(self) -> Floats:
        """(n,) the determinant of E on the motions, zero on the locus."""
        return np.asarray(np.linalg.det(self._square))

    @property
    def gradient(self) -> Floats:
        """(n, g) the derivative of the value along the basis of the tangent space."""
        space, g = self.space, self.space.freedoms
        basis = self.moving.basis[:, None]
        slopes = self.rest.changes(space)[:, :g] @ basis
        slopes += self.rest.equations(space.at)[:, None] @ self.moving.bends[:, :g] @ basis
        if not self.signed:
            turned = np.swapaxes(slopes, 2, 3) @ self.small[:, None]
            slopes = turned + np.swapaxes(turned, 2, 3)
        return np.asarray(np.einsum("nab,njba->nj", adjugate(self._square), slopes))


@final
@dataclass(frozen=True)
class LocusPoints(ArrayRows):
    """n points of a locus of k = g - 1 dimensions; NaN where Newton's method failed.

    Attributes
    ----------
    values, motions
        The variables (n, V), and the unit rates x (n, V) of the singular motion.
    tangents, turns
        (n, V, k) orthonormal changes of the variables along the locus, and the changes of
        the singular motion with them.
    residual
        (n,) the larger of the loops' residual (rad) and that of E x.
    flatness
        (n,) reciprocal condition of the equations; 0 where the locus crosses itself.
    first_step, ratio
        (n,) size of Newton's first step, and of the second by the first.
    equations
        (n, m + 1, g + k): the linear equations without borders.
    basis
        (n, V, g + k) the bases that `equations` refer to: g of the tangent space, k of the
        motions that x is one of.
    """

    values: Floats
    motions: Floats
    tangents: Floats
    turns: Floats
    residual: Floats
    reciprocal_condition: Floats
    first_step: Floats
    ratio: Floats
    equations: Floats
    basis: Floats

    def __len__(self) -> int:
        return len(self.values)

    @property
    def good(self) -> NDArray[np.bool_]:
        """(n,) points on the locus."""
        return self.residual < ON_LOCUS


@final
@dataclass(frozen=True)
class Locus:
    """Singular configurations of a closure with g freedoms, of one type.

    With a `part` the singular motion is one of that part alone, which closes its loops.
    """

    closure: Closure
    freedoms: int
    rest: StationarityConstraint
    part: OutputPart | None = None

    @property
    def motions(self) -> int:
        """The number k of motions in which a singular one is looked for."""
        return self.freedoms if self.part is None else len(self.part.driven)

    def space(self, values: Floats, like: Floats | None = None) -> TangentSpace:
        """Return the tangent spaces at configurations (n, V)."""
        near = None if like is None else like[..., : self.freedoms]
        return tangent_space(self.closure.at(values), self.freedoms, near)

    def moving(self, space: TangentSpace, like: Floats | None = None) -> TangentSpace:
        """Return the motions among which singular ones are looked for."""
        if self.part is None:
            return space
        near = None if like is None else like[..., self.freedoms :]
        return tangent_space(space.at, self.motions, near, self.part, space)

    def measure(self, space: TangentSpace) -> Measure:
        """Return how singular configurations are."""
        moving = self.moving(space)
        small = self.rest.equations(space.at) @ moving.basis
        finite = np.all(np.isfinite(small), axis=(1, 2))
        _, sizes, right = np.linalg.svd(np.where(finite[:, None, None], small, 0.0))
        last = self.motions - 1
        smallest = np.where(finite, sizes[:, last], np.nan)
        motion = moving.along(right[:, last])
        return Measure(self.rest, space, moving, small, smallest, motion)

    def onto(self, values: Floats, most: int = MOST_CORRECTIONS) -> LocusPoints:
        """Return the points that Newton's method leads to by at most so many steps.

        Each step is the shortest one.
        """
        motion = self.measure(self.space(values)).motion
        none = np.zeros((len(values), 0, values.shape[1]))
        return self.correct(values, motion, none, np.zeros((len(values), 0)), most=most)

    def correct(
        self,
        values: Floats,
        motions: Floats,
        borders: Floats,
        targets: Floats,
        like: Floats | None = None,
        most: int = MOST_CORRECTIONS,
    ) -> LocusPoints:
        """Return the points with border . values = target, by Newton's method.

        Parameters
        ----------
        values, motions
            (n, V) starting values of variables and of singular motions.
        borders, targets
            (n, k, V) and (n, k) linear equations that pick a point of the locus; with
            k = 0 the steps are the shortest ones.
        like, most
            (n, V, g + k) bases that the equations' bases are turned to, and the steps that
            Newton's method may take.
        """
        steps = NewtonSteps(len(values), TRUST)
        values, motions = values.copy(), motions.copy()
        active = np.arange(len(values))
        for _ in range(most):
            near = None if like is None else like[active]
            unit, moved, turned = self._step(
                values[active], motions[active], borders[active], targets[active], near
            )
            size = np.max(np.abs(np.concatenate([moved, turned], axis=1)), axis=1)
            part = steps.part(size, active)
            values[active] += part * moved
            motions[active] = unit + part * turned
            active = active[size > CORRECTED]
            if not len(active):
                break
        space, moving, motions, off, _, equations = self._linearised(
            values, motions, borders, like
        )
        residual = np.maximum(space.at.gap, np.max(np.abs(off), axis=1))
        equations = equations[:, : self.rest.count + 1]
        tangents, turns, reciprocal_condition = self._tangents(
            space, moving, motions, equations
        )
        bad = ~(residual < ON_LOCUS)
        for array in (values, motions, tangents, turns, residual):
            array[bad] = np.nan
        return LocusPoints(
            values,
            motions,
            tangents,
            turns,
            residual,
            reciprocal_condition,
            steps.first,
            steps.ratio,
            equations,
            np.concatenate([space.basis, moving.basis], axis=2),
        )

    def _step(
        self,
        values: Floats,
        motions: Floats,
        borders: Floats,
        targets: Floats,
        like: Floats | None,
    ) -> tuple[Floats, Floats, Floats]:
        """Return unit motions, and Newton's steps of variables and motions (n, V)."""
        space, moving, unit, off, shift, equations = self._linearised(
            values, motions, borders, like
        )
        miss = targets - np.einsum("nkv,nv->nk", borders, values + space.closing)
        right = np.concatenate([-off - shift, np.zeros((len(off), 1)), miss], axis=1)
        finite = np.all(np.isfinite(equations), axis=(1, 2))
        change = np.zeros((len(off), equations.shape[2]))
        inverse = np.linalg.pinv(equations[finite], rcond=REDUNDANT)
        change[finite] = np.einsum("nij,nj->ni", inverse, right[finite])
        ways, turning = np.split(change, [self.freedoms], axis=1)
        turned = np.einsum("ng,ngvw,nw->nv", ways, moving.bends[:, :-1], unit)
        turned += np.einsum("nvw,nw->nv", moving.bends[:, -1], unit) + moving.along(turning)
        return unit, space.closing + space.along(ways), turned

    def _linearised(
        self, values: Floats, motions: Floats, borders: Floats, like: Floats | None
    ) -> tuple[TangentSpace, TangentSpace, Floats, Floats, Floats, Floats]:
        """Return tangent spaces, unit motions, E x, its change by closing, and equations.

        The motions are made to close the loops. The unknowns of the bordered equations are
        the way along the basis and the change of the motion in that of `moving`.
        """
        space = self.space(values, like)
        moving = self.moving(space, like)
        inside = np.einsum("nvg,nv->ng", moving.basis, motions)
        inside = inside / np.linalg.norm(inside, axis=1, keepdims=True)
        unit, rows = moving.along(inside), self.rest.equations(space.at)
        slopes = np.einsum("ngmv,nv->nmg", self.rest.changes(space), unit)
        slopes += rows @ np.einsum("ngvw,nw->nvg", moving.bends, unit)
        g, n = self.freedoms, len(values)
        top = np.concatenate([slopes[:, :, :g], rows @ moving.basis], axis=2)
        along = np.concatenate([np.zeros((n, g)), inside], axis=1)[:, None]
        still = np.zeros((n, borders.shape[1], self.motions))
        low = np.concatenate([borders @ space.basis, still], axis=2)
        equations = np.concatenate([top, along, low], axis=1)
        off = np.einsum("nmv,nv->nm", rows, unit)
        return space, moving, unit, off, slopes[:, :, g], equations

    def _tangents(
        self,
        space: TangentSpace,
        moving: TangentSpace,
        motions: Floats,
        equations: Floats,
    ) -> tuple[Floats, Floats, Floats]:
        g, rank = self.freedoms, self.motions + 1
        finite = np.all(np.isfinite(equations), axis=(1, 2))
        clean = np.where(finite[:, None, None], equations, 0.0)
        _, sizes, right = np.linalg.svd(clean)
        kernel = np.swapaxes(right[:, rank:], 1, 2)
        ways, turned = kernel[:, :g], moving.basis @ kernel[:, g:]
        turned += np.einsum("ngk,ngvw,nw->nvk", ways, moving.bends[:, :g], motions)
        left, lengths, mixing = np.linalg.svd(ways, full_matrices=False)
        scale = 1.0 / np.maximum(lengths, REDUNDANT)[:, None]
        turns = turned @ np.swapaxes(mixing, 1, 2) * scale
        conditioning = sizes[:, rank - 1] * lengths[:, -1]
        reciprocal_condition = conditioning / np.maximum(sizes[:, 0], TINY)
        return space.basis @ left, turns, np.where(finite, reciprocal_condition, 0.0)


def adjugate(matrices: Floats) -> Floats:
    """Return the adjugates of square matrices (n, k, k), exact where those are singular."""
    size = matrices.shape[1]
    out = np.empty_like(matrices)
    for i in range(size):
        for j in range(size):
            rows = [k for k in range(size) if k != j]
            columns = [k for k in range(size) if k != i]
            minor = matrices[:, rows][:, :, columns]
            out[:, i, j] = (-1.0) ** (i + j) * np.linalg.det(minor)
    return out
