"""The locus of singular configurations of one type, as solutions of a regular system.

Let x be a unit vector of rates that close the loops. The singular configurations of a
mechanism with g degrees of freedom are those in which an x with E x = 0 exists. E says
that the inputs stand still (type II) or that the output stands still (type I), see
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
    ConfigurationChanges,
    OutputPart,
    SingularValueDecomposition,
    TangentSpace,
    decompose,
    tangent_space,
)
from spherekit.tolerances import CLOSURE_TOLERANCE

MAX_LOCUS_NEWTON_STEPS = 8
"""Largest number of Newton steps onto the locus. Larger: more remote starts converge;
smaller: failures end sooner."""
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

    A configuration is singular if the mechanism can move from it while the rates of the
    inputs (type II) or of the output (type I) are all zero. The rates x of such a
    motion close the loops and satisfy E x = 0.

    Attributes
    ----------
    constraint
        The condition E x = 0.
    space, motion_space
        Rates that close the loops of the mechanism, and those among which x is looked for.
    constrained_rates
        (n, m, k) the m rates E x that have to be zero, in each of k independent motions:
        the columns of `motion_space.basis`. In a singular configuration they are all zero
        in a combination of these motions.
    smallest_singular_value
        (n,) smallest singular value of `constrained_rates`, zero on the locus.
    motion
        (n, V) unit rates that belong to this singular value: the x with least |E x|.
    """

    constraint: StationarityConstraint
    space: TangentSpace
    motion_space: TangentSpace
    constrained_rates: Floats
    smallest_singular_value: Floats
    motion: Floats

    @property
    def changes_sign(self) -> bool:
        """Whether `value` changes its sign across the locus, the singular configurations.

        `value` is the determinant of `constrained_rates` if this matrix is square and the
        sense of its basis of motions is fixed, because the determinant would change its
        sign with that sense. Otherwise `value` is never negative and only touches zero.
        """
        _, rows, columns = self.constrained_rates.shape
        return self.motion_space.has_fixed_sense and rows == columns

    @cached_property
    def _square_matrix(self) -> Floats:
        """(n, k, k) the square matrix whose determinant is `value`.

        The matrix is B, that of `constrained_rates`, if det B changes its sign across the
        locus (the set of singular configurations). If not, the matrix is B^T B. B and B^T B
        are singular in the same configurations.
        """
        matrix = self.constrained_rates
        return matrix if self.changes_sign else np.swapaxes(matrix, 1, 2) @ matrix

    @property
    def value(self) -> Floats:
        """(n,) determinant, zero in singular configurations.

        The value is det B of the matrix B of `constrained_rates`, or det(B^T B). Rows
        without a configuration (NaN) have no determinant (NaN).
        """
        matrix = self._square_matrix
        is_finite = all_finite(matrix, (1, 2))
        # NaN is replaced by 0, because LAPACK warns of an invalid value if a matrix
        # contains NaN.
        determinant = np.linalg.det(np.where(is_finite[:, None, None], matrix, 0.0))
        return np.where(is_finite, determinant, np.nan)

    @property
    def gradient(self) -> Floats:
        """(n, g) derivatives of `value` along g changes of the configuration.

        The changes are the columns of `space.basis`, which keep the loops closed. `value`
        is the determinant of a matrix A, so Jacobi's formula gives its derivative:
        d det A = trace(adj(A) dA). The adjugate adj(A) exists at singular configurations,
        too, where A has no inverse.
        """
        # The letters are: n configuration, j change, a and b rows and columns of A.
        return np.einsum(
            "nab,njba->nj",
            adjugate(self._square_matrix),
            self._square_matrix_derivatives(),
        )

    def _square_matrix_derivatives(self) -> Floats:
        """Return the derivatives (n, g, k, k) of `_square_matrix` along g changes."""
        derivatives = self._constrained_rate_derivatives()
        if self.changes_sign:
            return derivatives
        # The product rule d(B^T B) = dB^T B + B^T dB: a matrix plus its transpose.
        half = np.swapaxes(derivatives, 2, 3) @ self.constrained_rates[:, None]
        return half + np.swapaxes(half, 2, 3)

    def _constrained_rate_derivatives(self) -> Floats:
        """Return the derivatives (n, g, m, k) of `constrained_rates` along g changes.

        `constrained_rates` (n, m, k) are products E x. Each of the k columns x is a motion:
        rates of all variables that close the loops. E x are the m rates that have to be
        zero at a singularity: those of the inputs or of the output. The g changes of the
        configuration are independent and keep the loops closed. The gradient of `value`
        follows from the result.

        Two things change with the configuration. The matrix E changes, and each motion x is
        corrected, because it has to close the loops of the changed configuration.
        """
        changes = self.space.closed_changes
        basis = self.motion_space.basis[:, None]  # (n, 1, variables, k) the motions x
        constraint_matrix = self.constraint.equations(self.space.linearisation)  # E
        # (n, g, variables, k)
        motion_changes = self.motion_space.rate_corrections(changes) @ basis
        from_constraint = self.constraint.equation_derivatives(changes) @ basis
        from_motions = constraint_matrix[:, None] @ motion_changes
        return from_constraint + from_motions


@dataclass(frozen=True)
class LocusBases(ArrayRows):
    """Bases for the changes of n points of the locus (set of all singular configurations).

    A point of the locus is a configuration with its singular motion x: unit rates that
    close the loops while the inputs (type II) or the output (type I) rest.

    Attributes
    ----------
    configuration
        (n, V, g) orthonormal columns: g independent changes of the V pair variables that
        keep the loops closed. Changes of the configuration are combinations of these.
    motion
        (n, V, k) orthonormal columns: k independent sets of rates that close the loops. x
        and the changes of x are combinations of these. Usually the array is equal to
        `configuration`. If only a part of the mechanism moves the output, the columns are
        rates of this part only.
    """

    configuration: Floats
    motion: Floats


@dataclass(frozen=True)
class LocusPoints(ArrayRows):
    """n singular configurations: points of the locus of a mechanism.

    A configuration is singular if it has a singular motion x: unit rates of all variables
    that keep the loops closed while the inputs (type II) or the output (type I) rest. The
    rates that have to be zero are E x. The locus is the set of these configurations. In the
    shapes of the arrays,

    - n is the number of points, and V the number of variables,
    - g is the number of degrees of freedom; the locus has g - 1 dimensions,
    - m is the number of equations E x = 0,
    - k is the number of independent rates that keep the loops closed, before E x = 0 is
      demanded. Usually k = g. It is smaller if only a part of the mechanism can move the
      output, because x moves only this part.

    Where Newton's method failed, the values, the motions, the tangents, the derivatives and
    the residual are NaN.

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
        (n,) how regular the locus is (`_measure_regularity`), at most 1: 0 where it crosses
        itself.
    first_step, step_ratio
        (n,) size of Newton's first step (rad), and of the second step relative to it. Steps
        along a curve are accepted only if both are small.
    equations
        (n, m + 1, g + k) the equations E x = 0 and |x| = 1, linearised at the point. The
        unknowns are g coordinates of the change of the configuration and k coordinates of
        the change of x, in `bases`.
    bases
        The bases of these changes.
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
    bases: LocusBases

    def __len__(self) -> int:
        return len(self.values)

    @property
    def is_on_locus(self) -> Bools:
        """(n,) whether Newton's method reached a singular configuration; False for NaN."""
        return self.residual < ON_LOCUS_TOLERANCE


@dataclass(frozen=True)
class _LinearisedLocus:
    """The equations of a locus, linearised at n configurations with a motion x each.

    The locus is the set of singular configurations: those with a unit motion x that closes
    the loops and satisfies E x = 0. E x are the m rates that have to be zero, of the inputs
    (type II) or of the output (type I).

    The unknowns are the coordinates of two changes, one below the other:

    - g configuration coordinates u: the variables change by `space.basis` u,
    - k motion coordinates z: x changes by `motion_space.basis` z + `motion_slopes` u. The
      second term is necessary because other rates close the loops after the change u.

    All these changes keep the loops closed, to first order, so that only two equations
    remain, E x = 0 and |x| = 1. Their matrix is

        [ d(E x)/du   d(E x)/dz ]   m rows
        [ d|x|/du     d|x|/dz   ]   1 row

    Attributes
    ----------
    space
        The g independent rates that close the loops.
    motion_space
        The k independent rates of which x is a combination. These are the rates of `space`,
        or of the part of the mechanism that can move the output.
    unit_motions
        (n, V) the motions x, of length 1.
    motion_slopes
        (n, V, g) changes of x that keep the loops closed, per unit of u.
    constraint_matrix
        (n, m, V) the matrices E.
    equations
        (n, m + 1, g + k) the matrices above.
    """

    space: TangentSpace
    motion_space: TangentSpace
    unit_motions: Floats
    motion_slopes: Floats
    constraint_matrix: Floats
    equations: Floats

    @property
    def constrained_rates(self) -> Floats:
        """(n, m) the rates E x, zero on the locus."""
        return np.matvec(self.constraint_matrix, self.unit_motions)

    def configuration_coordinates(self, coordinates: Floats) -> Floats:
        """Return the first g rows, u, of j columns of unknowns (n, g + k, j)."""
        return coordinates[:, : self.space.dimension]

    def motion_coordinates(self, coordinates: Floats) -> Floats:
        """Return the last k rows, z, of j columns of unknowns (n, g + k, j)."""
        return coordinates[:, self.space.dimension :]

    def value_changes(self, coordinates: Floats) -> Floats:
        """Return the changes (n, V, j) of the variables for j columns of unknowns.

        `coordinates` are (n, g + k, j).
        """
        return self.space.basis @ self.configuration_coordinates(coordinates)

    def motion_changes(self, coordinates: Floats) -> Floats:
        """Return the changes (n, V, j) of x for j columns (n, g + k, j) of unknowns."""
        changes = self.motion_space.basis @ self.motion_coordinates(coordinates)
        corrections = self.motion_slopes @ self.configuration_coordinates(coordinates)
        return changes + corrections


@dataclass(frozen=True)
class _ClosingStep:
    """Newton's step that closes slightly open loops at n configurations, and its effects.

    Newton's method looks for singular configurations. These have a motion x: rates that
    close the loops while the inputs, or the output, rest. The rates of the inputs, or of
    the output, are E x with a matrix E. The step changes the configuration, and so x and
    E x.

    Attributes
    ----------
    value_changes
        (n, V) changes of the V pair variables (rad).
    motion_changes
        (n, V) changes of the motion x, so that x still closes the loops after the step.
    constrained_rate_changes
        (n, m) changes of the m rates E x.
    """

    value_changes: Floats
    motion_changes: Floats
    constrained_rate_changes: Floats


@dataclass(frozen=True)
class _LocusTangents:
    """The tangents of a locus at n points, and how regular the locus is there.

    The locus is the set of all singular configurations of one type. For a mechanism with V
    pair variables and g degrees of freedom it has g - 1 dimensions. Each point has a
    singular motion: rates that close the loops while the inputs or the output rest.
    `SingularityLocus.project` returns the tangents with the points of the locus.

    Attributes
    ----------
    values
        (n, V, g - 1) the tangents: columns of orthonormal changes of the V variables.
    motion_derivatives
        (n, V, g - 1) derivatives of the singular motion, one column for each tangent.
    reciprocal_condition
        (n,) how regular the locus is (`_measure_regularity`), at most 1. It is 0 where the
        locus crosses itself, and where its equations are not finite.
    """

    values: Floats
    motion_derivatives: Floats
    reciprocal_condition: Floats


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

        A singular motion has rates with which the inputs or the output rest. The
        independent motions are all motions of the mechanism or, if there is a `part`, those
        of this part.
        """
        return self.degrees_of_freedom if self.part is None else len(self.part.driven)

    def tangent_space(
        self, values: Floats, reference_basis: Floats | None = None
    ) -> TangentSpace:
        """Return the rates that close the loops at configurations (n, V).

        V is the number of variables and g the number of degrees of freedom. If there is a
        `reference_basis` (n, V, g), the basis is rotated to be as near to it as possible.
        """
        linearisation = self.closure.linearise(values)
        return tangent_space(linearisation, self.degrees_of_freedom, reference_basis)

    def motion_space(
        self, space: TangentSpace, reference_basis: Floats | None = None
    ) -> TangentSpace:
        """Return the rates among which singular motions are sought.

        A singular motion is a set of rates that close the loops while the inputs or the
        output rest. There are two cases:

        - The attribute `part` is None. Singular motions are sought among all rates that
          close the loops, so `space` is returned.
        - `part` has the pairs that can move the output. The result has only rates with
          which all other pairs rest, because a motion of other pairs is no singularity of
          this output.

        Parameters
        ----------
        space
            All rates that close the loops of the mechanism, at n configurations.
        reference_basis
            (n, V, k) for each configuration, the `basis` of this function's result at a
            neighbouring configuration. The new basis for a part is rotated to be as near
            as possible to it, so that it changes continuously. V is the number of
            variables and k the `motion_dimension`.
        """
        if self.part is None:
            return space
        return tangent_space(
            space.linearisation, self.motion_dimension, reference_basis, part=self.part
        )

    def measure(self, space: TangentSpace) -> SingularityMeasure:
        """Return how near configurations are to being singular.

        In a singular configuration the inputs (type II) or the output (type I) rest in some
        motion x (unit rates that close the loops). The rates of the inputs, or of the
        output, are E x. The measure is the smallest size of E x for any x: the smallest
        singular value of E times an orthonormal basis of the motions.

        Parameters
        ----------
        space
            All rates that close the loops at the configurations.
        """
        # The k independent motions in which x is sought: usually all of `space`, or only
        # those of the part of the mechanism that moves the output.
        motion_space = self.motion_space(space)
        constraint_matrix = self.constraint.equations(space.linearisation)  # E
        constrained_rates = constraint_matrix @ motion_space.basis
        svd = decompose(constrained_rates)
        # The k singular values are in descending order. The last one is the smallest. The
        # row of `svd.right` that belongs to it has the coordinates of x.
        last = self.motion_dimension - 1
        smallest = np.where(svd.is_finite, svd.values[:, last], np.nan)
        motion = motion_space.to_rates(svd.right[:, last])
        return SingularityMeasure(
            constraint=self.constraint,
            space=space,
            motion_space=motion_space,
            constrained_rates=constrained_rates,
            smallest_singular_value=smallest,
            motion=motion,
        )

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def project(self, values: Floats) -> LocusPoints:
        """Return singular configurations near n configurations (n, V), by Newton's method.

        V is the number of variables (rad). Each Newton step is the shortest possible.
        Configurations from which the method does not converge are left out.
        """
        motions = self.measure(self.tangent_space(values)).motion
        no_conditions = np.zeros((len(values), 0, values.shape[1]))
        no_targets = np.zeros((len(values), 0))
        points = self.correct(values, motions, no_conditions, no_targets)
        return points.rows(points.is_on_locus)

    def correct(
        self,
        values: Floats,
        motions: Floats,
        conditions: Floats,
        targets: Floats,
        reference: LocusBases | None = None,
        max_steps: int = MAX_LOCUS_NEWTON_STEPS,
    ) -> LocusPoints:
        """Return the points of the locus with conditions @ values = targets.

        The locus is the set of configurations in which a singular motion exists: unit rates
        x of the V variables that close the loops, with E x = 0. E x are the rates of the
        inputs (type II) or of the output (type I). The mechanism has g degrees of freedom.
        Newton's method solves for the configuration and the motion together.

        Parameters
        ----------
        values, motions
            (n, V) starting values of the variables (rad) and of the singular motions.
        conditions, targets
            (n, b, V) and (n, b) matrices and right-hand sides of b linear equations in the
            variables, which select a point of the locus of g - 1 dimensions. With fewer
            than g - 1 equations, Newton's steps are the shortest ones.
        reference
            Bases at neighbouring points. The bases of the result are aligned to these, so
            that bases change continuously from point to point.
        max_steps
            Largest number of Newton steps.

        Returns
        -------
        n points, with NaN where Newton's method failed.
        """

        def newton_step(unknowns: Floats, rows: Indices) -> Floats:
            """Return the steps (k, 2 V) of the unknowns of k of the n rows."""
            row_reference = None if reference is None else reference.rows(rows)
            return self._newton_step(
                unknowns, conditions[rows], targets[rows], row_reference
            )

        unknowns, (first_step, step_ratio) = newton(
            newton_step,
            np.concatenate([values, motions], axis=1),
            max_steps,
            LOCUS_STEP_TOLERANCE,
            LOCUS_TRUST_REGION,
        )
        # The system at the points that were reached gives the residuals and the tangents.
        values, motions = np.split(unknowns, 2, axis=1)
        linearised = self._linearise(values, motions, reference)
        motions = linearised.unit_motions
        residual = np.maximum(
            linearised.space.linearisation.closure_residual,
            max_abs(linearised.constrained_rates, axis=1),
        )
        tangents = self._find_tangents(linearised)
        has_failed = ~(residual < ON_LOCUS_TOLERANCE)
        for array in (
            values,
            motions,
            tangents.values,
            tangents.motion_derivatives,
            residual,
        ):
            array[has_failed] = np.nan
        return LocusPoints(
            values=values,
            motions=motions,
            tangents=tangents.values,
            motion_derivatives=tangents.motion_derivatives,
            residual=residual,
            reciprocal_condition=tangents.reciprocal_condition,
            first_step=first_step,
            step_ratio=step_ratio,
            equations=linearised.equations,
            bases=LocusBases(
                configuration=linearised.space.basis, motion=linearised.motion_space.basis
            ),
        )

    def _newton_step(
        self,
        unknowns: Floats,
        conditions: Floats,
        targets: Floats,
        reference: LocusBases | None,
    ) -> Floats:
        """Return Newton's steps from n configurations towards singular configurations.

        The unknowns are the V pair variables and the rates x of a motion. In a singular
        configuration the loops are closed, and x is a motion that closes the loops with
        E x = 0. E x are the rates of the inputs or of the output. Each step is the sum of
        three parts:

        1. x is replaced by the nearest unit rates that close the loops.
        2. The variables change so that slightly open loops are closed. x changes so that it
           closes the loops of the changed configuration.
        3. The variables and x change so that E x = 0 and conditions @ values = targets.
           Loops stay closed, and x keeps its length, to first order.

        Parts 1 and 2 follow from the unknowns directly. Part 3 is the solution of
        linear equations.

        Parameters
        ----------
        unknowns
            (n, 2 V) variables (rad), then rates of the motion.
        conditions, targets
            (n, b, V) and (n, b) linear equations in the variables that select a point.
        reference
            Bases (of changes of configuration and motion) at neighbouring points, with
            which the bases of the step are aligned. None without neighbours.
        """
        values, motions = np.split(unknowns, 2, axis=1)
        # Part 1: `unit_motions` are the nearest unit rates that close the loops.
        linearised = self._linearise(values, motions, reference)
        replacing_motion_steps = linearised.unit_motions - motions
        # Part 2: the changes of the variables, of x, and of E x by this part.
        closing = self._closing_step(linearised)
        # Part 3: by how much E x, |x| and the conditions must still change. After part 1,
        # E x is `constrained_rates`. Part 2 changes E x further. The sum has to vanish.
        rate_changes = -linearised.constrained_rates - closing.constrained_rate_changes
        length_changes = np.zeros((len(values), 1))
        closed_values = values + closing.value_changes
        condition_changes = targets - np.matvec(conditions, closed_values)
        right_side = np.concatenate(
            [rate_changes, length_changes, condition_changes], axis=1
        )
        # The unknowns are coordinates: first those of a change that keeps the loops closed,
        # then those of a change of x.
        equations = append_conditions(
            linearised.equations, conditions, linearised.space.basis
        )
        coordinates = _solve_least_norm(equations, right_side)
        # Each system of equations has one solution, so the last axis has length 1.
        value_changes = linearised.value_changes(coordinates)[:, :, 0]
        motion_changes = linearised.motion_changes(coordinates)[:, :, 0]

        value_steps = closing.value_changes + value_changes
        motion_steps = replacing_motion_steps + closing.motion_changes + motion_changes
        return np.concatenate([value_steps, motion_steps], axis=1)

    def _linearise(
        self, values: Floats, motions: Floats, reference: LocusBases | None
    ) -> _LinearisedLocus:
        """Return the equations of the locus, linearised at configurations and motions.

        The locus is the set of singular configurations. Each has a singular motion: unit
        rates x that close the loops, with E x = 0. E x are the rates of the inputs (type
        II) or of the output (type I). The equations are E x = 0 and |x| = 1.

        Both the configuration and x may change, but only so that the loops stay closed.
        The g coordinates u of the change of the configuration, and the k coordinates z of
        the change of x, are the unknowns. The matrix of the linearised equations is

            [ d(E x)/du   d(E x)/dz ]
            [ d|x|/du     d|x|/dz   ]

        Parameters
        ----------
        values, motions
            (n, V) variables (rad), and motions that need not close the loops exactly.
        reference
            Bases at neighbouring points, with which the bases of u and z are aligned. None
            without neighbours.
        """
        # `space` has g independent rates that close the loops. u are the coordinates along
        # them. `motion_space` has k independent rates of which x is a combination, with the
        # coordinates z. Usually they are the same rates. But if only a part of the
        # mechanism can move the output, x is sought among the rates of this part.
        if reference is None:
            space = self.tangent_space(values)
            motion_space = self.motion_space(space)
        else:
            space = self.tangent_space(values, reference.configuration)
            motion_space = self.motion_space(space, reference.motion)
        # (n, k) the motions, projected onto the rates that close the loops, with length 1.
        motion_coordinates = unit_rows(np.vecmat(motions, motion_space.basis))
        unit_motions = motion_space.to_rates(motion_coordinates)
        # (n, V, g) If the configuration changes, other rates close the loops. By these
        # changes per unit of u, x continues to close them.
        motion_slopes = _motion_slopes(space, motion_space, unit_motions)

        # The upper two blocks of the matrix: d(E x)/du and d(E x)/dz.
        rates_by_configuration = self._constrained_rate_slopes(
            space, unit_motions, motion_slopes
        )
        constraint_matrix = self.constraint.equations(space.linearisation)  # E
        rates_by_motion = constraint_matrix @ motion_space.basis
        # The lower two blocks: d|x|/du and d|x|/dz. The changes `motion_slopes` are
        # perpendicular to x, so u does not change |x|. As |x| is 1, its derivatives
        # with respect to the coordinates of x are these coordinates themselves.
        length_by_configuration = np.zeros((len(values), 1, space.dimension))
        length_by_motion = motion_coordinates[:, None]
        return _LinearisedLocus(
            space=space,
            motion_space=motion_space,
            unit_motions=unit_motions,
            motion_slopes=motion_slopes,
            constraint_matrix=constraint_matrix,
            equations=np.block(
                [
                    [rates_by_configuration, rates_by_motion],
                    [length_by_configuration, length_by_motion],
                ]
            ),
        )

    def _constrained_rate_slopes(
        self, space: TangentSpace, unit_motions: Floats, motion_slopes: Floats
    ) -> Floats:
        """Return the derivatives (n, m, g) of rates E x along changes of the configuration.

        x are the rates of a motion that closes the loops. E x are the m rates of the inputs
        or of the output, which are zero in a singular configuration. E x changes because E
        changes, and because other rates x close the loops of the changed configuration. The
        caller needs the derivatives for the linearised equations of the singular
        configurations.

        Parameters
        ----------
        space
            The g independent changes of the configuration that keep the loops closed, at n
            configurations.
        unit_motions
            (n, V) the rates x of the V pair variables.
        motion_slopes
            (n, V, g) the corrections of x, so that x still closes the loops.
        """
        constraint_matrix = self.constraint.equations(space.linearisation)  # E
        constraint_derivatives = self.constraint.equation_derivatives(space.closed_changes)
        # n configuration, g direction of change, m equation, v variable.
        slopes = np.einsum("ngmv,nv->nmg", constraint_derivatives, unit_motions)
        slopes += constraint_matrix @ motion_slopes
        return slopes

    def _closing_step(self, linearised: _LinearisedLocus) -> _ClosingStep:
        """Return the shortest step that closes slightly open loops, with its effects.

        The step is a part of a step of Newton's method, which looks for singular
        configurations. It changes the V pair variables of n configurations. x are the rates
        of a motion that closes the loops. E x are the m rates of the inputs or of the
        output, which are zero in a singular configuration.

        The step has two effects, which the other parts of Newton's step need. First, x gets
        the smallest change by which it closes the loops of the changed configuration.
        Second, E x changes, because E depends on the configuration and because x changes.
        """
        space = linearised.space
        x = linearised.unit_motions
        # The changes to first order are derivatives along a direction, here the step.
        directions = space.closing_step[:, :, None]
        step = ConfigurationChanges(space.linearisation, directions)
        # (n, 1, V, V) matrices by which x is multiplied to get the change of x. The second
        # axis counts the directions, and there is only one.
        correction_matrices = linearised.motion_space.rate_corrections(step)
        motion_changes = np.matvec(correction_matrices[:, 0], x)
        # (n, 1, m, V) changes of the matrix E.
        constraint_changes = self.constraint.equation_derivatives(step)
        # By the product rule, the change of E x is (change of E) x + E (change of x).
        from_constraint = np.matvec(constraint_changes[:, 0], x)
        from_motions = np.matvec(linearised.constraint_matrix, motion_changes)
        return _ClosingStep(
            value_changes=space.closing_step,
            motion_changes=motion_changes,
            constrained_rate_changes=from_constraint + from_motions,
        )

    def _find_tangents(self, linearised: _LinearisedLocus) -> _LocusTangents:
        """Return the tangents of the locus at n points, and how regular the locus is there.

        The locus is the set of singular configurations. Each has a singular motion: rates
        that close the loops while the inputs or the output rest. The rates are scaled to a
        vector of length 1. A tangent is a change of the configuration, together with a
        change of the singular motion, that satisfies all linearised equations of the locus.

        The tangents are the null space of the matrix of these equations. With two inputs it
        has one dimension, and the locus is a curve. With g degrees of freedom it has g - 1
        dimensions.
        """
        # The dimension of the null space is the number of unknowns minus the rank. At a
        # regular point it is the dimension of the locus, from which the rank follows.
        unknown_count = linearised.equations.shape[2]
        locus_dimension = self.degrees_of_freedom - 1
        rank = unknown_count - locus_dimension
        svd = decompose(linearised.equations)
        # The last right singular vectors are the null space. Each becomes a column with the
        # coordinates of a change of the configuration, and of a change of the motion.
        null_space = np.swapaxes(svd.right[:, rank:], 1, 2)
        configuration_columns = linearised.configuration_coordinates(null_space)
        motion_columns = linearised.motion_changes(null_space)
        # The tangents are combinations of these columns. In the combinations, the changes
        # of the configuration are orthonormal.
        orthonormalisation = _orthonormalise(configuration_columns)
        configuration_tangents = orthonormalisation.orthonormal
        motion_tangents = orthonormalisation.combine(motion_columns)
        # 0 at irregular points, where the tangents are not determined; at most 1.
        condition = _measure_regularity(svd, rank, orthonormalisation)
        return _LocusTangents(
            # A column of the basis is the change of the variables per unit of a coordinate.
            values=linearised.space.basis @ configuration_tangents,
            motion_derivatives=motion_tangents,
            reciprocal_condition=np.where(svd.is_finite, condition, 0.0),
        )


def _motion_slopes(
    space: TangentSpace, motion_space: TangentSpace, motions: Floats
) -> Floats:
    """Return how motions have to change to close the loops of changed configurations.

    A motion is a set of rates x of the V pair variables that close the loops: J x = 0 with
    the closure Jacobian J. If the configuration changes, J changes, and x has to change,
    too. Several changes of x are possible. The result is the smallest one, to first order.
    The caller needs it to linearise equations in which both the configuration and x are
    unknown.

    Parameters
    ----------
    space
        Tangent space of n configurations: g independent changes that keep all loops closed.
    motion_space
        Tangent space of which the motions are combinations: the same space, or the tangent
        space of a part of the mechanism.
    motions
        (n, V) rates of the variables.

    Returns
    -------
    (n, V, g) derivatives of the rates along the g changes of the configuration.
    """
    # (n, g, V, V) for each change of the configuration (`closed_changes`), the matrix whose
    # product with a motion is the change of this motion.
    correction_matrices = motion_space.rate_corrections(space.closed_changes)
    # The products of these matrices and the motions. The letters are: n configuration,
    # g change, v variable whose rate changes, w variable of the motion.
    return np.einsum("ngvw,nw->nvg", correction_matrices, motions)


def _solve_least_norm(equations: Floats, right_side: Floats) -> Floats:
    """Return the shortest solution of each of n systems of linear equations.

    The systems may have fewer equations than unknowns. Equations that repeat others are
    ignored.

    Parameters
    ----------
    equations, right_side
        (n, rows, unknowns) matrices and (n, rows) right sides.

    Returns
    -------
    (n, unknowns, 1) solutions as columns, zero if a matrix is not finite.
    """
    is_finite = all_finite(equations, (1, 2))
    inverse = np.linalg.pinv(equations[is_finite], rcond=REDUNDANT_EQUATION_RATIO)
    solutions = np.zeros((len(equations), equations.shape[2], 1))
    solutions[is_finite, :, 0] = np.matvec(inverse, right_side[is_finite])
    return solutions


@dataclass(frozen=True)
class _Orthonormalisation:
    """Combinations of the columns of a matrix M that are orthonormal, for n matrices.

    With the singular value decomposition M = U S V^T, they are the columns of U = M V S^-1.

    Each column can be a part of a longer vector, such as the change of the configuration in
    a tangent of the locus. The other part, the change of the singular motion, is then a
    column of another matrix C. It needs the same combinations, which are C V S^-1.

    Attributes
    ----------
    orthonormal
        (n, rows, j) the j orthonormal vectors U.
    singular_values
        (n, j) the diagonals of S, in descending order. If the smallest is zero, the columns
        of M are dependent.
    right_rows
        (n, j, j) the matrices V^T, with right singular vectors in rows.
    """

    orthonormal: Floats
    singular_values: Floats
    right_rows: Floats

    def combine(self, columns: Floats) -> Floats:
        """Return the same combinations C V S^-1 of other columns C (n, rows, j)."""
        # If the columns of M are dependent, a singular value is zero. The least divisor
        # prevents a division by zero. The result then has no meaning.
        divisors = np.maximum(self.singular_values, REDUNDANT_EQUATION_RATIO)
        return columns @ np.swapaxes(self.right_rows, 1, 2) / divisors[:, None]


def _orthonormalise(matrices: Floats) -> _Orthonormalisation:
    """Return orthonormal combinations of the columns of matrices (n, rows, j)."""
    left, singular_values, right_rows = np.linalg.svd(matrices, full_matrices=False)
    return _Orthonormalisation(left, singular_values, right_rows)


def _measure_regularity(
    svd: SingularValueDecomposition, rank: int, orthonormalisation: _Orthonormalisation
) -> Floats:
    """Return how regular n points of a locus are: 0 at irregular points, at most 1.

    The locus is the set of singular configurations. Each has a singular motion: rates that
    close the loops while the inputs or the output rest. A unit tangent of the locus has two
    parts: a change of the configuration, and a change of this motion. Two numbers from 0 to
    1 are multiplied:

    - The ratio of the smallest to the greatest singular value of the equations. It is 0 if
      an equation depends on the others.
    - The smallest size of the first part in all unit tangents. This is 0 if a tangent
      changes only the motion.

    Parameters
    ----------
    svd, rank
        The singular value decomposition of the equations, and how many equations are
        independent at regular points.
    orthonormalisation
        The singular value decomposition of the first parts of a basis of orthonormal
        tangents. Its smallest singular value is the smallest size of the first part in all
        unit tangents.
    """
    # `SMALLEST_NORMAL` prevents a division by zero.
    greatest_singular_value = np.maximum(svd.values[:, 0], SMALLEST_NORMAL)
    smallest_singular_value = svd.values[:, rank - 1]
    smallest_change = orthonormalisation.singular_values[:, -1]
    return smallest_singular_value * smallest_change / greatest_singular_value


def append_conditions(
    equations: Floats, conditions: Floats, configuration_basis: Floats
) -> Floats:
    """Add conditions on the pair variables to the linearised equations of a locus.

    The locus is the set of singular configurations. Each has a singular motion: rates that
    close the loops while the inputs or the output rest. The conditions select a point of
    the locus, for example by locked inputs.

    Parameters
    ----------
    equations
        (n, rows, g + k) matrices of the equations. The unknowns are two changes: that of
        the configuration, in g coordinates, then that of the singular motion, in k
        coordinates.
    conditions
        (n, b, V) matrices of b linear equations in the V variables.
    configuration_basis
        (n, V, g) changes of the variables per unit of the g coordinates.

    Returns
    -------
    (n, rows + b, g + k) matrices. The new rows do not depend on the singular motion.
    """
    condition_rows = np.zeros((len(equations), conditions.shape[1], equations.shape[2]))
    degrees_of_freedom = configuration_basis.shape[2]
    condition_rows[:, :, :degrees_of_freedom] = conditions @ configuration_basis
    return np.concatenate([equations, condition_rows], axis=1)


def adjugate(matrices: Floats) -> Floats:
    """Return the adjugates of square matrices (n, k, k), for k > 1 zero if not finite.

    adj(M) = det(M) M^-1 for regular matrices. From the singular value decomposition M = U S
    V^T it is det(U) det(V) V adj(S) U^T, which needs no division. Entry k of the diagonal
    matrix adj(S) is the product of all singular values except value k.
    """
    svd = decompose(matrices)
    count = svd.values.shape[1]
    products_of_others = np.array(
        [np.prod(np.delete(svd.values, k, axis=1), axis=1) for k in range(count)]
    )
    sense = np.linalg.det(svd.left) * np.linalg.det(svd.right)
    return np.einsum("n,nki,kn,njk->nij", sense, svd.right, products_of_others, svd.left)
