"""Sections of a mechanism with several inputs: all inputs but one are locked.

A slice is the set of configurations with those inputs at given values: curves, each
followed in its own arc length through dead points of the free input.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.completeness import TimeLimit
from spherekit.errors import CountError
from spherekit.geometry.vectors import all_finite, max_abs, unit_rows
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.assembly_enumeration import assemblies
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_continuation import follow_arcs
from spherekit.positions.curve_segment import CurvePoints
from spherekit.positions.linear_equations import REDUNDANT_EQUATION_RATIO
from spherekit.positions.loop_closure import Closure, newton
from spherekit.positions.position_solver import PositionSolver
from spherekit.singularities.stationarity import StationarityConstraint
from spherekit.singularities.tangent_space import (
    TINY,
    OutputPart,
    TangentSpace,
    decomposed,
    tangent_space,
)
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE
from spherekit.wording import counted

MOST_CORRECTIONS = 8


CORRECTED = 1e-10
"""A Newton step (rad) below this leaves an error that its square bounds."""


ON_LOCUS = CLOSURE_TOLERANCE
"""Largest residual, of the loops (rad) and of E x, of a point that is given."""


TRUST = 0.3
"""Largest change of a variable (rad) in one step."""


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
        return np.linalg.det(self._square)

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
        return np.einsum("nab,njba->nj", adjugate(self._square), slopes)


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
    def good(self) -> Bools:
        """(n,) points on the locus."""
        return self.residual < ON_LOCUS


@dataclass(frozen=True)
class SingularityLocus:
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
        _, sizes, right, finite = decomposed(small)
        last = self.motions - 1
        smallest = np.where(finite, sizes[:, last], np.nan)
        return Measure(
            self.rest, space, moving, small, smallest, moving.along(right[:, last])
        )

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def onto(self, values: Floats) -> LocusPoints:
        """Return the points that Newton's method leads to by the shortest steps.

        What is not led to any is left out.
        """
        motion = self.measure(self.space(values)).motion
        none = np.zeros((len(values), 0, values.shape[1]))
        points = self.correct(values, motion, none, none[:, :, 0])
        return points.rows(points.good)

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

        def change(here: Floats, rows: Indices) -> Floats:
            near = None if like is None else like[rows]
            return self._step(here, borders[rows], targets[rows], near)

        both = np.concatenate([values, motions], axis=1)
        both, (first_step, ratio) = newton(change, both, most, CORRECTED, TRUST)
        values, motions = np.split(both, 2, axis=1)
        space, moving, motions, off, _, swing, equations = self._linearised(
            values, motions, borders, like
        )
        residual = np.maximum(space.at.gap, max_abs(off, axis=1))
        equations = equations[:, : self.rest.count + 1]
        tangents, turns, reciprocal_condition = self._tangents(
            space, moving, swing, equations
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
            first_step,
            ratio,
            equations,
            np.concatenate([space.basis, moving.basis], axis=2),
        )

    def _step(
        self, both: Floats, borders: Floats, targets: Floats, like: Floats | None
    ) -> Floats:
        """Return Newton's steps of variables and motions, in one row each (n, 2 V)."""
        values, motions = np.split(both, 2, axis=1)
        space, moving, unit, off, shift, swing, equations = self._linearised(
            values, motions, borders, like
        )
        miss = targets - np.matvec(borders, values + space.closing)
        right = np.concatenate([-off - shift, np.zeros((len(off), 1)), miss], axis=1)
        finite = all_finite(equations, (1, 2))
        change = np.zeros((len(off), equations.shape[2]))
        inverse = np.linalg.pinv(equations[finite], rcond=REDUNDANT_EQUATION_RATIO)
        change[finite] = np.matvec(inverse, right[finite])
        ways, turning = np.split(change, [self.freedoms], axis=1)
        turned = unit - motions + moving.along(turning)
        turned += swing[..., -1] + np.matvec(swing[..., :-1], ways)
        return np.concatenate([space.closing + space.along(ways), turned], axis=1)

    def _linearised(
        self, values: Floats, motions: Floats, borders: Floats, like: Floats | None
    ) -> tuple[TangentSpace, TangentSpace, Floats, Floats, Floats, Floats, Floats]:
        """Return tangent spaces, unit motions, E x, its change by closing, and equations.

        The motions are made to close the loops; before the equations is how they swing
        (n, V, g + 1) with the directions. The unknowns of the bordered equations are the
        way along the basis and the change of the motion in that of `moving`.
        """
        space = self.space(values, like)
        moving = self.moving(space, like)
        inside = unit_rows(np.vecmat(motions, moving.basis))
        unit = moving.along(inside)
        rows = self.rest.equations(space.at)
        swing = np.einsum("ngvw,nw->nvg", moving.bends, unit)
        slopes = np.einsum("ngmv,nv->nmg", self.rest.changes(space), unit) + rows @ swing
        g, n = self.freedoms, len(values)
        top = np.concatenate([slopes[:, :, :g], rows @ moving.basis], axis=2)
        along = np.pad(inside, ((0, 0), (g, 0)))[:, None]
        still = np.zeros((n, borders.shape[1], self.motions))
        low = np.concatenate([borders @ space.basis, still], axis=2)
        equations = np.concatenate([top, along, low], axis=1)
        return space, moving, unit, np.matvec(rows, unit), slopes[..., g], swing, equations

    def _tangents(
        self, space: TangentSpace, moving: TangentSpace, swing: Floats, equations: Floats
    ) -> tuple[Floats, Floats, Floats]:
        g, rank = self.freedoms, self.motions + 1
        _, sizes, right, finite = decomposed(equations)
        kernel = np.swapaxes(right[:, rank:], 1, 2)
        turned = moving.basis @ kernel[:, g:] + swing[..., :g] @ kernel[:, :g]
        left, lengths, mixing = np.linalg.svd(kernel[:, :g], full_matrices=False)
        scale = np.maximum(lengths, REDUNDANT_EQUATION_RATIO)[:, None]
        turns = turned @ np.swapaxes(mixing, 1, 2) / scale
        condition = sizes[:, rank - 1] * lengths[:, -1] / np.maximum(sizes[:, 0], TINY)
        return space.basis @ left, turns, np.where(finite, condition, 0.0)


def adjugate(matrices: Floats) -> Floats:
    """Return the adjugates of square matrices (n, k, k), those not finite as zero."""
    left, sizes, right, _ = decomposed(matrices)
    others = [np.prod(np.delete(sizes, k, 1), axis=1) for k in range(sizes.shape[1])]
    sense = np.linalg.det(left) * np.linalg.det(right)
    return np.einsum("n,nki,kn,njk->nij", sense, right, np.array(others), left)


PROBED = 181
"""Values of the free input, over one turn, at which modes of dyads are looked for."""


PROBES = 7
"""The same for mechanisms with irreducible groups."""


LONGEST = 200.0


TOGETHER = 12
"""Slices of dyads that are followed side by side."""


def solver_of(mechanism: Mechanism) -> PositionSolver:
    """Return the solver of a mechanism, its modes not looked for.

    Raises
    ------
    PlanError
        If the mechanism has not one freedom for each input.
    """
    try:
        return PositionSolver(mechanism, plan_assembly(mechanism))
    except CountError:
        return PositionSolver(mechanism, plan_assembly(mechanism, by_rank=True))


def configurations(solver: PositionSolver, q: Floats) -> tuple[Floats, Indices]:
    """Return the closed configurations (n, V) of all modes at inputs q (k, inputs).

    With them the row (n,) of q that each belongs to.
    """
    parts = [np.zeros((0, len(solver.mechanism.variable_owners)))]
    rows = [np.zeros(0, dtype=np.intp)]
    if solver.assembly.has_closed_form:
        for signs in product((1, -1), repeat=len(solver.assembly.groups)):
            here = solver.evaluate(AssemblyMode(0, signs), q)
            closed = np.flatnonzero(here.status == Status.OK)
            parts.append(here.values[closed])
            rows.append(closed)
    else:
        for row, wanted in enumerate(q):
            parts.append(assemblies(solver, wanted).values)
            rows.append(np.full(len(parts[-1]), row))
    return np.concatenate(parts), np.concatenate(rows)


def _slices(
    solver: PositionSolver, free: int, held: Floats, budget: TimeLimit
) -> Iterator[ArcCurve]:
    """Yield all curves found with all inputs but one locked at values (m, inputs).

    A curve of each slice is followed side by side. Modes are looked for at values of the
    free input, a position in `solver.driven`, over one turn: a curve that meets none of
    them is missed.
    """
    probes = PROBED if solver.assembly.has_closed_form else PROBES
    turn = (np.arange(probes) + 0.5) * (2.0 * np.pi / probes) - np.pi
    q = np.repeat(held, probes, axis=0)
    q[:, free] = np.tile(turn, len(held))
    starts, row = configurations(solver, q)
    others = np.delete(solver.driven, free).tolist()
    values = np.delete(held, free, axis=1)
    todo = {k: starts[row // probes == k] for k in range(len(held))}
    while left := [k for k, of_slice in todo.items() if len(of_slice)]:
        if not budget.goes_on(f"curves of {counted(len(left), 'slice')}"):
            return
        locked = solver.closure.locked(others, values[left])
        curves = follow_arcs(locked, np.stack([todo[k][0] for k in left]), longest=LONGEST)
        for k, curve in zip(left, curves, strict=True):
            todo[k] = todo[k][1:]
            if curve is not None:
                todo[k] = todo[k][~curve.passes(todo[k])]
                yield curve


@dataclass(frozen=True)
class LockedInputSection:
    """The slices of a mechanism at some values of each input, in the order made.

    `gaps` (rad) are the distances of the values of each input; `note` says what was left
    out as time was spent, or is empty.
    """

    slices: tuple[ArcCurve, ...]
    gaps: tuple[float, ...]
    note: str


def cut(
    solver: PositionSolver,
    ranges: Sequence[tuple[float, float]],
    values_of_each: int,
    budget: TimeLimit | None = None,
) -> LockedInputSection:
    """Return the slices with each input free, the others at values over their ranges.

    The values are taken in an order that is spread out wherever time is spent.
    """
    budget = budget or TimeLimit()
    many = TOGETHER if solver.assembly.has_closed_form else 1
    spread = [
        low + (high - low) * (np.arange(values_of_each) + 0.5) / values_of_each
        for low, high in ranges
    ]
    sections: list[ArcCurve] = []
    notes = []
    for free in range(len(ranges)):
        grid = [*product(*spread[:free], [0.0], *spread[free + 1 :])]
        digits = f"0{(len(grid) - 1).bit_length()}b"
        order = sorted(range(len(grid)), key=lambda k: format(k, digits)[::-1])
        held = np.array(grid)[order]
        share = budget.part(1.0 / (len(ranges) - free))
        for first in range(0, len(held), many):
            if not share.goes_on(f"slice {first + 1} of {len(held)}"):
                break
            sections += _slices(solver, free, held[first : first + many], share)
        if share.note:
            notes.append(f"{share.note} with input {free + 1} free")
    gaps = tuple((high - low) / values_of_each for low, high in ranges)
    return LockedInputSection(tuple(sections), gaps, "; ".join(notes))


def seeds(curve: ArcCurve, locus: SingularityLocus) -> LocusPoints:
    """Return the singular configurations on a slice."""

    def along(points: CurvePoints) -> tuple[Floats, Floats]:
        space = locus.space(points.values)
        measure = locus.measure(space)
        ways = np.vecmat(points.tangents, space.basis)
        return measure.value, np.vecdot(measure.gradient, ways)

    return locus.onto(curve.at(curve.locate(along).places).values)
