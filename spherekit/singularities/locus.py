"""The locus of singular configurations of one type, as solutions of a regular system.

Let x be a unit vector of rates that close the loops. The singular configurations of a
mechanism with g degrees of freedom are those in which an x with E x = 0 exists. E says
that the inputs stand still (type II) or that the output does (type I), see
`spherekit.singularities.stationarity`. The configuration and x together solve

    loops closed,  J x = 0,  E x = 0,  |x| = 1,

whose solutions are a manifold of g - 1 dimensions, the locus. Newton's method solves this
system in the tangent space of the loops, with exact second derivatives of the closure.

Axes of arrays: n configurations, V variables, m equations E x = 0, g degrees of freedom, k
dimensions of the space of motions in which x is looked for (g, or fewer for a part).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import all_finite, max_abs, unit_rows
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.linear_equations import REDUNDANT_EQUATION_RATIO
from spherekit.positions.loop_closure import Closure, newton
from spherekit.singularities.stationarity import StationarityConstraint
from spherekit.singularities.tangent_space import (
    SMALLEST_NORMAL,
    OutputPart,
    TangentSpace,
    decompose,
    tangent_space,
)
from spherekit.tolerances import CLOSURE_TOLERANCE

MAX_LOCUS_NEWTON_STEPS = 8
"""Newton steps onto the locus. Larger: more remote starts converge; smaller: failures end
sooner."""
LOCUS_STEP_TOLERANCE = 1e-10
"""Newton's method ends after a step of variables (rad) or unit rates below this. Its error
is then about the square of the step. Larger: less accurate points; smaller: more steps."""
ON_LOCUS_TOLERANCE = CLOSURE_TOLERANCE
"""Largest closure residual (rad) and largest component of E x of a point on the locus.
Larger: points are less accurate; smaller: rounding rejects points."""
LOCUS_TRUST_REGION = 0.3
"""Largest change of a variable (rad) or unit rate in one Newton step. Longer steps are
shortened. Larger: faster, but points of remote parts of the locus may be reached."""


@dataclass(frozen=True)
class SingularityMeasure:
    """How near n configurations are to the locus, the set of singular configurations.

    A configuration is singular if unit rates x close the loops and satisfy E x = 0. For
    type II, E x are the rates of the inputs, for type I those of the output.

    Attributes
    ----------
    constraint
        The condition E x = 0.
    space, motion_space
        Rates that close the loops of the mechanism, and those among which x is looked for.
    constraint_on_basis
        (n, m, k) E applied to the basis of `motion_space`.
    smallest_singular_value
        (n,) smallest singular value of `constraint_on_basis`, zero on the locus.
    motion
        (n, V) unit rates that belong to this singular value: the x with least |E x|.
    """

    constraint: StationarityConstraint
    space: TangentSpace
    motion_space: TangentSpace
    constraint_on_basis: Floats
    smallest_singular_value: Floats
    motion: Floats

    @property
    def changes_sign(self) -> bool:
        """Whether `value` changes its sign across the locus, the singular configurations.

        `value` is a determinant that is zero in singular configurations. A configuration is
        singular if rates x close the loops and satisfy E x = 0, where E x are the rates of
        the inputs (type II) or of the output (type I). B is E applied to a basis of the
        rates that close the loops. det B is used if B is square and the sense of the basis
        is fixed, because det B would change its sign with that sense. Otherwise det(B^T B)
        is used, which is never negative, so it only touches zero.
        """
        _, rows, columns = self.constraint_on_basis.shape
        return self.motion_space.has_fixed_sense and rows == columns

    @cached_property
    def _square_matrix(self) -> Floats:
        """(n, k, k) the square matrix whose determinant is `value`.

        It is B = E N (`constraint_on_basis`): the equations E x = 0 of a singularity,
        applied to a basis N of the k rates x that close the loops. It is B^T B if B is not
        square, or if det B does not change its sign across the locus, the singular
        configurations.
        """
        matrix = self.constraint_on_basis
        return matrix if self.changes_sign else np.swapaxes(matrix, 1, 2) @ matrix

    @property
    def value(self) -> Floats:
        """(n,) determinant, zero in singular configurations: det B, or det(B^T B)."""
        return np.linalg.det(self._square_matrix)

    @property
    def gradient(self) -> Floats:
        """(n, g) derivatives of `value` as the configuration changes, with g freedoms.

        A configuration is singular if rates x close the loops and satisfy E x = 0, where E
        x are the rates of the inputs (type II) or of the output (type I). N is a basis of
        the k rates that close the loops, and B = E N (`constraint_on_basis`). `value` is
        det B if this determinant changes its sign at singularities (`changes_sign`), and
        otherwise det(B^T B). The derivative of a determinant is
        d det A = trace(adj(A) dA) for the matrix A = B or A = B^T B (`_square_matrix`). The
        adjugate adj(A) exists where A is singular, too.

        The derivatives are along the g columns of the basis of the tangent space, which
        are the changes of the configuration that keep the loops closed.
        """
        # B = E N has the derivative dB = dE N + E dN. N changes because its rates must
        # continue to close the loops: dN = C N with `rate_corrections` C. Axis 1 of dE and
        # C has g + 1 directions of change. The last one, a step that closes slightly open
        # loops, is left out.
        degrees_of_freedom = self.space.dimension
        basis = self.motion_space.basis[:, None]
        equation_derivatives = self.constraint.equation_derivatives(self.space)
        corrections = self.motion_space.rate_corrections[:, :degrees_of_freedom]
        equations = self.constraint.equations(self.space.linearisation)
        # (n, g, m, k) derivatives of B.
        derivatives = equation_derivatives[:, :degrees_of_freedom] @ basis
        derivatives += equations[:, None] @ corrections @ basis
        if not self.changes_sign:
            # `value` is det(B^T B) here. The derivative of B^T B is B'^T B + B^T B', the
            # sum of a matrix and its transpose.
            half = np.swapaxes(derivatives, 2, 3) @ self.constraint_on_basis[:, None]
            derivatives = half + np.swapaxes(half, 2, 3)
        # The letters are: n configuration, j direction of change, a and b rows and columns.
        return np.einsum("nab,njba->nj", adjugate(self._square_matrix), derivatives)


@dataclass(frozen=True)
class LocusPoints(ArrayRows):
    """n singular configurations: points of the locus of a mechanism.

    A configuration is singular if it has a singular motion x: unit rates of all variables
    that keep the loops closed while the inputs (type II) or the output (type I) rest. The
    rates that have to be zero are E x. The locus is the set of these configurations. In the
    shapes of the arrays,

    - n is the number of points, and V that of the variables,
    - g is the number of degrees of freedom; the locus has g - 1 dimensions,
    - m is the number of equations E x = 0,
    - k is the number of independent rates that keep the loops closed, before E x = 0 is
      demanded. Usually k = g. It is smaller if only a part of the mechanism can move the
      output, because x moves only this part.

    Rows in which Newton's method failed are NaN.

    Attributes
    ----------
    values
        (n, V) variables (rad).
    motions
        (n, V) unit rates x of the singular motion.
    tangents
        (n, V, g - 1) orthonormal changes of the variables along the locus.
    motion_derivatives
        (n, V, g - 1) derivatives of the singular motion along these tangents.
    residual
        (n,) the larger of the closure residual (rad) and the largest component of E x.
    reciprocal_condition
        (n,) smallest over largest singular value of `equations`: 0 where the locus crosses
        itself.
    first_step, step_ratio
        (n,) size of Newton's first step (rad), and of the second step relative to it. Steps
        along a curve are accepted only if both are small.
    equations
        (n, m + 1, g + k) the equations E x = 0 and |x| = 1, linearised at the point. The
        unknowns are coefficients of the columns of `basis`.
    basis
        (n, V, g + k) two bases side by side. The first g columns are changes of the
        configuration that keep the loops closed. The other k columns are changes of x.
    """

    values: Floats
    motions: Floats
    tangents: Floats
    motion_derivatives: Floats
    residual: Floats
    reciprocal_condition: Floats
    first_step: Floats
    step_ratio: Floats
    equations: Floats
    basis: Floats

    def __len__(self) -> int:
        return len(self.values)

    @property
    def is_on_locus(self) -> Bools:
        """(n,) whether Newton's method reached a singular configuration; False for NaN."""
        return self.residual < ON_LOCUS_TOLERANCE


@dataclass(frozen=True)
class _LinearisedLocus:
    """The equations of a locus, linearised at n pairs of a configuration and a motion.

    The locus is the set of singular configurations of one type. Newton's method and the
    tangents of the locus use these linear equations. A configuration of V variables is on
    the locus if it has a singular motion. The rates x (V,) of this motion satisfy:

    - J x = 0, with the Jacobian J of the loop closure: the motion keeps the loops closed.
    - E x = 0, m equations. E x are the rates of the inputs for a singularity of type II,
      and those of the output for type I.
    - The length of x is 1.

    There may be b more linear equations in the variables, the borders, which select points
    of the locus.

    The unknowns are g coordinates of the change of the configuration in the basis of
    `space`, then k coordinates of the change of x in the basis of `motion_space`. Both
    bases consist of rates that close the loops. A change of the configuration along them
    keeps the loops closed, to first order. But it changes J, so x also changes by
    `motion_corrections`, which keeps J x = 0. The loops and J x = 0 therefore have no rows
    in `equations`.

    Attributes
    ----------
    space
        The g independent rates that close the loops.
    motion_space
        The k independent rates of which x is a combination. They are those of `space`. If
        only a part of the mechanism can move the output, they are those of this part, so
        that motions of other links do not count as singular.
    unit_motions
        (n, V) the motions x, projected onto `motion_space` and scaled to length 1.
    constraint_residual
        (n, m) E x.
    closing_change
        (n, m) the change of E x when slightly open loops are closed, by the step
        `space.closing_step` of the variables.
    motion_corrections
        (n, V, g + 1) changes of x. J depends on the configuration, so x has to change with
        it to keep J x = 0. The first g columns belong to changes of the configuration along
        the rates of `space`. The last one belongs to the step that closes slightly open
        loops.
    equations
        (n, m + 1 + b, g + k) the rows E x = 0, |x| = 1 and the borders.
    """

    space: TangentSpace
    motion_space: TangentSpace
    unit_motions: Floats
    constraint_residual: Floats
    closing_change: Floats
    motion_corrections: Floats
    equations: Floats


@dataclass(frozen=True)
class SingularityLocus:
    """The singular configurations of one type, as solutions of a system of equations.

    A configuration is singular if unit rates x of the pair variables exist that close the
    loops and satisfy E x = 0: the singular motion. E x are the rates of the inputs (type
    II) or of the output (type I).

    Attributes
    ----------
    closure
        Loop-closure equations of the mechanism.
    degrees_of_freedom
        Number g of the degrees of freedom.
    constraint
        The condition E x = 0: the inputs or the output rest.
    part
        If it is given, only pairs of this part of the mechanism move in the singular
        motion, which closes the loops of the part. None for the whole mechanism.
    """

    closure: Closure
    degrees_of_freedom: int
    constraint: StationarityConstraint
    part: OutputPart | None = None

    @property
    def motion_dimension(self) -> int:
        """The number k of independent motions among which a singular motion is sought.

        They are all motions of the mechanism or, if `part` is given, those of this part.
        """
        return self.degrees_of_freedom if self.part is None else len(self.part.driven)

    def tangent_space(
        self, values: Floats, reference_basis: Floats | None = None
    ) -> TangentSpace:
        """Return the tangent spaces at configurations (n, V).

        `reference_basis` (n, V, g + k) aligns the basis, see `LocusPoints.basis`.
        """
        if reference_basis is not None:
            reference_basis = reference_basis[..., : self.degrees_of_freedom]
        linearisation = self.closure.linearise(values)
        return tangent_space(linearisation, self.degrees_of_freedom, reference_basis)

    def motion_space(
        self, space: TangentSpace, reference_basis: Floats | None = None
    ) -> TangentSpace:
        """Return the space of motions among which singular motions are sought.

        A motion is given by the rates of all V variables, which close the loops. It is
        singular if the inputs rest in it (type II), or if the output does (type I). The
        space of motions is `space`, unless only a part of the mechanism moves with the
        output (`self.part`). It then has the k motions of the part, in which all other
        variables rest, since motions of other pairs are no singularities of this output.

        Parameters
        ----------
        space
            All g independent rates that close the loops of the mechanism.
        reference_basis
            (n, V, g + k) two bases side by side at neighbouring configurations: g columns
            of `space`, then k columns of motions. The basis of the result is rotated to be
            as near as possible to the k columns, so that it changes continuously.
        """
        if self.part is None:
            return space
        if reference_basis is not None:
            # The last k columns belong to the motions.
            reference_basis = reference_basis[..., self.degrees_of_freedom :]
        return tangent_space(
            space.linearisation, self.motion_dimension, reference_basis, self.part, space
        )

    def measure(self, space: TangentSpace) -> SingularityMeasure:
        """Return how near the configurations of a tangent space are to being singular.

        A configuration is singular if a unit vector x of rates closes the loops and has
        E x = 0, where E x are the rates of the inputs (type II) or of the output (type I).
        The least size of E x over all x that close the loops is the smallest singular value
        of E on an orthonormal basis of these rates. For a part of the mechanism only the
        rates of the part are used, with the other variables at rest.
        """
        motion_space = self.motion_space(space)
        equations = self.constraint.equations(space.linearisation)
        constraint_on_basis = equations @ motion_space.basis
        svd = decompose(constraint_on_basis)
        # Singular values are in descending order. The smallest one belongs to the last row
        # of `svd.right`, which has the coordinates of x.
        last = self.motion_dimension - 1
        smallest = np.where(svd.is_finite, svd.values[:, last], np.nan)
        motion = motion_space.to_rates(svd.right[:, last])
        return SingularityMeasure(
            constraint=self.constraint,
            space=space,
            motion_space=motion_space,
            constraint_on_basis=constraint_on_basis,
            smallest_singular_value=smallest,
            motion=motion,
        )

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def project(self, values: Floats) -> LocusPoints:
        """Return the singular configurations that Newton's shortest steps reach.

        Configurations (n, V) from which the method does not converge are left out, so that
        there may be fewer points.
        """
        motions = self.measure(self.tangent_space(values)).motion
        no_borders = np.zeros((len(values), 0, values.shape[1]))
        no_targets = np.zeros((len(values), 0))
        points = self.correct(values, motions, no_borders, no_targets)
        return points.rows(points.is_on_locus)

    def correct(
        self,
        values: Floats,
        motions: Floats,
        borders: Floats,
        targets: Floats,
        reference_basis: Floats | None = None,
        max_steps: int = MAX_LOCUS_NEWTON_STEPS,
    ) -> LocusPoints:
        """Return the points of the locus with borders @ values = targets.

        The locus is the set of configurations in which a singular motion exists: unit rates
        x of the V variables that close the loops, with E x = 0. E x are the rates of the
        inputs (type II) or of the output (type I). The mechanism has g degrees of freedom.
        Newton's method solves for the configuration and the motion together.

        Parameters
        ----------
        values, motions
            (n, V) starting values of the variables (rad) and of the singular motions.
        borders, targets
            (n, b, V) and (n, b) matrices and right-hand sides of b linear equations in the
            variables, which select a point of the locus of g - 1 dimensions. With fewer
            than g - 1 of them, Newton's steps are the shortest ones.
        reference_basis
            (n, V, g + k) the bases of the result are aligned to these, see
            `LocusPoints.basis`. They then change continuously from point to point. k is the
            dimension of the space of motions in which x is looked for.
        max_steps
            Most Newton steps.

        Returns
        -------
        n points; NaN where Newton's method failed.
        """
        variable_count = values.shape[1]

        def newton_step(unknowns: Floats, rows: Indices) -> Floats:
            """Return the steps (k, 2 V) of the unknowns of k of the n rows."""
            reference = None if reference_basis is None else reference_basis[rows]
            return self._newton_step(unknowns, borders[rows], targets[rows], reference)

        unknowns, (first_step, step_ratio) = newton(
            newton_step,
            np.concatenate([values, motions], axis=1),
            max_steps,
            LOCUS_STEP_TOLERANCE,
            LOCUS_TRUST_REGION,
        )
        # The system at the points that were reached gives the residuals and the tangents.
        values, motions = np.split(unknowns, [variable_count], axis=1)
        linearised = self._linearise(values, motions, borders, reference_basis)
        motions = linearised.unit_motions
        residual = np.maximum(
            linearised.space.linearisation.closure_residual,
            max_abs(linearised.constraint_residual, axis=1),
        )
        # Without the borders: the rows of E x = 0 and of |x| = 1.
        equations = linearised.equations[:, : self.constraint.equation_count + 1]
        tangents, motion_derivatives, reciprocal_condition = self._tangents(
            linearised, equations
        )
        has_failed = ~(residual < ON_LOCUS_TOLERANCE)
        for array in (values, motions, tangents, motion_derivatives, residual):
            array[has_failed] = np.nan
        return LocusPoints(
            values=values,
            motions=motions,
            tangents=tangents,
            motion_derivatives=motion_derivatives,
            residual=residual,
            reciprocal_condition=reciprocal_condition,
            first_step=first_step,
            step_ratio=step_ratio,
            equations=equations,
            basis=np.concatenate(
                [linearised.space.basis, linearised.motion_space.basis], axis=2
            ),
        )

    def _newton_step(
        self,
        unknowns: Floats,
        borders: Floats,
        targets: Floats,
        reference_basis: Floats | None,
    ) -> Floats:
        """Return Newton's steps (n, 2 V) of the unknowns: variables, then motions.

        The locus is the set of singular configurations. The equations of its points are:
        the loops are closed, the motion x is a unit vector of rates that close the loops,
        E x = 0, and borders @ values = targets. E x are the rates of the inputs (type II)
        or of the output (type I). The borders are further linear equations in the
        variables, which select one point of the locus.

        The unknowns of the linear system are g coordinates of the change of the
        configuration, along the rates that close the loops, and k coordinates of the change
        of x. The change of x is along the same rates (k = g) or, if only a part of the
        mechanism can move the output, along the k rates that move this part. The steps of
        the V variables and V rates follow from the coordinates. A row whose system is not
        finite only gets the step that closes the loops.

        Parameters
        ----------
        unknowns
            (n, 2 V) variables (rad), then rates of the motion.
        borders, targets
            (n, b, V) and (n, b) linear equations in the variables that select a point.
        reference_basis
            (n, V, g + k) bases of neighbouring configurations, to which those of the g and
            of the k coordinates are aligned, so that they change continuously; or None.
        """
        values, motions = np.split(unknowns, 2, axis=1)
        linearised = self._linearise(values, motions, borders, reference_basis)
        space = linearised.space
        # All residuals are those after the step that closes the loops, to first order.
        closed_values = values + space.closing_step
        border_residual = targets - np.matvec(borders, closed_values)
        constraint_residual = -linearised.constraint_residual - linearised.closing_change
        # `unit_motions` have |x| = 1 already. The steps to them are added below.
        norm_residual = np.zeros((len(values), 1))
        # The rows are in the order of `linearised.equations`.
        right_side = np.concatenate(
            [constraint_residual, norm_residual, border_residual], axis=1
        )
        equations = linearised.equations
        finite = all_finite(equations, (1, 2))
        coordinates = np.zeros((len(values), equations.shape[2]))
        # The pseudo-inverse gives the shortest step if there are fewer borders than
        # dimensions of the locus, and ignores equations that repeat others.
        inverse = np.linalg.pinv(equations[finite], rcond=REDUNDANT_EQUATION_RATIO)
        coordinates[finite] = np.matvec(inverse, right_side[finite])
        value_coordinates, motion_coordinates = np.split(
            coordinates, [self.degrees_of_freedom], axis=1
        )
        # The variables change by the step that closes the loops, and along the locus.
        value_steps = space.closing_step + space.to_rates(value_coordinates)
        # The motion is scaled to length 1, changes within the space of motions, and must
        # continue to close the loops when the variables change.
        motion_steps = linearised.unit_motions - motions
        motion_steps = motion_steps + linearised.motion_space.to_rates(motion_coordinates)
        # The corrections of the motion for unit changes of the configuration along the g
        # columns of the basis, and, in the last column, for the step that closes the loops.
        basis_corrections = linearised.motion_corrections[..., :-1]
        closing_correction = linearised.motion_corrections[..., -1]
        motion_steps += closing_correction + np.matvec(basis_corrections, value_coordinates)
        return np.concatenate([value_steps, motion_steps], axis=1)

    def _linearise(
        self,
        values: Floats,
        motions: Floats,
        borders: Floats,
        reference_basis: Floats | None,
    ) -> _LinearisedLocus:
        """Return the equations of the locus, linearised at configurations and motions.

        A singular configuration has a motion: unit rates x that close the loops, with
        E x = 0. E x are the rates of the inputs (type II) or of the output (type I). The
        borders are further linear equations in the variables, which select points of the
        locus.

        Rows of the matrix are: E x = 0 (m), |x| = 1 (one), and the borders (b). Columns are
        the coordinates of the change of the configuration (g), along the rates that close
        the loops, then those of the change of x (k). The change of x is along the same
        rates (k = g) or, if only a part of the mechanism can move the output, along the k
        rates that move this part. The derivative of E x by the configuration has two terms:
        E changes, and x changes because it must continue to close the loops.

        Parameters
        ----------
        values, motions
            (n, V) variables (rad), and motions that need not close the loops exactly.
        borders
            (n, b, V) rows of linear equations in the variables that select a point.
        reference_basis
            (n, V, g + k) bases of neighbouring configurations, to which those of the g and
            of the k coordinates are aligned, so that they change continuously; or None.
        """
        space = self.tangent_space(values, reference_basis)
        motion_space = self.motion_space(space, reference_basis)
        coordinates = unit_rows(np.vecmat(motions, motion_space.basis))
        unit_motions = motion_space.to_rates(coordinates)
        constraint = self.constraint.equations(space.linearisation)
        # `rate_corrections` has g + 1 directions of change: those of the basis of `space`,
        # then the step that closes the loops. The letters are: n configuration, g direction
        # of change, v and w variables, m equations E x.
        motion_corrections = np.einsum(
            "ngvw,nw->nvg", motion_space.rate_corrections, unit_motions
        )
        constraint_derivatives = self.constraint.equation_derivatives(space)
        # (n, m, g + 1) derivatives of E x along the tangent space, and, in the last column,
        # along the step that closes the loops.
        slopes = np.einsum("ngmv,nv->nmg", constraint_derivatives, unit_motions)
        slopes += constraint @ motion_corrections

        # The rows of the equations, over the g + k unknowns.
        g = self.degrees_of_freedom
        constraint_rows = np.concatenate(
            [slopes[:, :, :g], constraint @ motion_space.basis], axis=2
        )
        norm_row = np.pad(coordinates, ((0, 0), (g, 0)))[:, None]
        zeros = np.zeros((len(values), borders.shape[1], self.motion_dimension))
        border_rows = np.concatenate([borders @ space.basis, zeros], axis=2)
        equations = np.concatenate([constraint_rows, norm_row, border_rows], axis=1)
        return _LinearisedLocus(
            space=space,
            motion_space=motion_space,
            unit_motions=unit_motions,
            constraint_residual=np.matvec(constraint, unit_motions),
            closing_change=slopes[..., g],
            motion_corrections=motion_corrections,
            equations=equations,
        )

    def _tangents(
        self, linearised: _LinearisedLocus, equations: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return the tangents of the locus at n points of it, and how regular it is there.

        A point of the locus is a configuration of V variables with a singular motion: unit
        rates x that close the loops and satisfy the m equations E x = 0. Changes along the
        locus are the null space of the linearised equations. It has g - 1 dimensions at a
        regular point.

        The unknowns of these equations are g + k coordinates. The first g belong to the
        change of the configuration, along g independent rates that close the loops. The
        last k belong to the change of x. It is along the same rates (k = g) or, if only a
        part of the mechanism can move the output, along the k rates that move this part.

        For example, a mechanism with two inputs has g = k = 2. There are four coordinates.
        The equations that both inputs rest (m = 2) and |x| = 1 are three, so that the null
        space has one dimension: the locus is a curve.

        Parameters
        ----------
        linearised
            The equations of the locus at n points.
        equations
            (n, m + 1, g + k) the linearised equations E x = 0 and |x| = 1, over the g + k
            coordinates.

        Returns
        -------
        tangents, motion_derivatives
            (n, V, g - 1) orthonormal changes of the variables along the locus, and the
            derivatives of x along them.
        reciprocal_condition
            (n,) 0 where the locus crosses itself, or where a row is not finite.
        """
        g = self.degrees_of_freedom
        # At a regular point, k + 1 of the m + 1 equations are independent, so that the null
        # space has (g + k) - (k + 1) dimensions.
        rank = self.motion_dimension + 1
        svd = decompose(equations)
        null_space = np.swapaxes(svd.right[:, rank:], 1, 2)
        # The coordinates of the configuration. The k coordinates of x follow them.
        value_part = null_space[:, :g]
        # x changes along its k coordinates. In addition it changes with the g coordinates
        # of the configuration, because it has to close the loops in the changed
        # configuration: these changes are the first g columns of `motion_corrections`. (The
        # last column is for open loops, and the loops are closed here.)
        motion_changes = linearised.motion_space.basis @ null_space[:, g:]
        motion_changes += linearised.motion_corrections[..., :g] @ value_part
        # The basis of the null space is replaced by one whose changes of the variables are
        # orthonormal: with the singular value decomposition U S W of these changes, they
        # become U, and the changes of x are multiplied by W^T S^-1. If an element of S
        # (`lengths`) is zero, the locus is not regular. The smallest divisor, a ratio that
        # serves elsewhere to recognise redundant equations, then prevents a division by 0.
        left, lengths, mixing = np.linalg.svd(value_part, full_matrices=False)
        divisors = np.maximum(lengths, REDUNDANT_EQUATION_RATIO)[:, None]
        tangents = linearised.space.basis @ left
        motion_derivatives = motion_changes @ np.swapaxes(mixing, 1, 2) / divisors
        # The smallest singular value relative to the greatest one, times the smallest
        # length: at an irregular point a tangent hardly changes the variables.
        condition = svd.values[:, rank - 1] * lengths[:, -1]
        condition = condition / np.maximum(svd.values[:, 0], SMALLEST_NORMAL)
        return tangents, motion_derivatives, np.where(svd.is_finite, condition, 0.0)


def adjugate(matrices: Floats) -> Floats:
    """Return the adjugates of square matrices (n, k, k), zero for those not finite.

    adj(M) = det(M) M^-1 for regular matrices. From the singular value decomposition
    M = U S V^T it is det(U) det(V) V adj(S) U^T, which needs no division. The diagonal
    matrix adj(S) has the products of all singular values but one.
    """
    svd = decompose(matrices)
    count = svd.values.shape[1]
    products_of_others = np.array(
        [np.prod(np.delete(svd.values, k, axis=1), axis=1) for k in range(count)]
    )
    sense = np.linalg.det(svd.left) * np.linalg.det(svd.right)
    return np.einsum("n,nki,kn,njk->nij", sense, svd.right, products_of_others, svd.left)
