"""How far an output link is from a target orientation, and the configuration nearest to it.

The remaining rotation d (rotation vector, rad) turns the output link from its orientation
to the target. Of all closed configurations the nearest one has the smallest angle a = |d|.
With the variables v, the closure Jacobian J, the angular velocity w = G v' of the output
link and one multiplier m for each closure equation, it satisfies

    G^T d + J^T m = 0,        J v' = 0.

The first equation says that the gradient of a^2 / 2 vanishes along the configurations. It
is the equilibrium of a torsional spring of unit stiffness between output link and target:
a^2 / 2 is its energy, d its moment on the output link, and m are the reactions that keep
the loops closed. If the mechanism can reach the target, d and m are zero. Differentiated
once and twice with respect to the angle through which the target turns, the equations give
exact rates of the variables.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.rotation import (
    log_rate,
    log_rate_change,
    rotation_vector,
    transpose,
)
from spherekit.geometry.vectors import all_finite, cross, max_abs
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure

ON_TARGET_RAD = 1e-10
"""Largest remaining rotation (rad) at which the output link counts as on the target.

The misfit of the rates, per rad of the target, is compared with the same number. Larger:
a link that slowly leaves the target is said to follow it. Smaller: rounding errors count as
a departure.
"""

SYSTEM_RCOND = 1e-14
"""Relative singular value below which a direction is left out of the pseudo-inverse.

Larger: near singular configurations the link cannot be turned in all directions. Smaller:
directions that only rounding errors span get large rates.
"""

MIN_CONVEXITY_RATIO = 1e-6
"""Smallest curvature of a^2 / 2 with which Newton steps use the exact second derivative.

The ratio is to the squared smallest singular value of the output rates. Larger: more steps
leave the curvature out and converge linearly. Smaller: steps near a point of inflection
become very long.
"""


@dataclass(frozen=True)
class OutputLink:
    """An output link in a mechanism, prepared for comparing its orientation with targets.

    The ground of the mechanism is here the link that the output is relative to, also called
    body 0.

    Attributes
    ----------
    closure
        Equations of the closed loops of the mechanism.
    number
        Number of the output link.
    degrees_of_freedom
        Number of inputs of the mechanism.
    """

    closure: Closure
    number: int
    degrees_of_freedom: int

    @staticmethod
    def from_output(mechanism: Mechanism, output: Output) -> "OutputLink":
        """Return the output link of a declared output, with the equations of the mechanism.

        The link that the output is relative to becomes the ground, so that the rotation of
        the output link in ground axes is its orientation.
        """
        grounded = replace(mechanism, ground=output.relative_to)
        return OutputLink(
            closure=Closure.of_mechanism(grounded, make_joints(grounded)),
            number=grounded.link_number[output.link],
            degrees_of_freedom=len(grounded.inputs),
        )

    def compare(self, values: Floats, target_orientations: Floats) -> "TargetDeviation":
        """Return how far the output link is from target orientations.

        The result has the rotations that would turn the output link to the targets, and the
        derivatives that Newton's method needs.

        Parameters
        ----------
        values
            (n, variables) pair variables (rad).
        target_orientations
            (n or 1, 3, 3) rotations from the axes of the output link to those of body 0,
            the link that the output is relative to.
        """
        # `rotations` are the orientations of all links. `vectors` has for each variable the
        # relative angular velocity of the two links of its pair if the variable has the
        # rate 1.
        linearisation = self.closure.linearise(values)
        orientations = linearisation.rotations[:, self.number]
        # For each variable 1 or -1 if its pair is on the path from body 0 to the output
        # link, 0 otherwise.
        path_senses = self.closure.tree.paths[self.number]
        return TargetDeviation(
            output_link=self,
            linearisation=linearisation,
            output_jacobian=path_senses * np.swapaxes(linearisation.vectors, 1, 2),
            remaining_rotation=rotation_vector(
                target_orientations @ transpose(orientations)
            ),
        )


@dataclass(frozen=True)
class JacobianSplit:
    """The free motions and the pseudo-inverse of the closure Jacobian J.

    J has the derivatives of the loop closure equations with respect to the variables, at n
    configurations. A singular value decomposition splits it. Its rank r is set to the
    number of variables less the degrees of freedom, the rank at regular configurations.
    Near singular ones the rank could not be recognised safely from the singular values.

    Attributes
    ----------
    pseudo_inverse
        (n, variables, equations) pseudo-inverse of J, with rank r.
    null_space
        (n, variables, degrees of freedom) orthonormal rates that keep the loops closed.
    reciprocal_condition
        (n,) ratio of the r-th to the largest singular value of J.
    """

    pseudo_inverse: Floats
    null_space: Floats
    reciprocal_condition: Floats


@dataclass(frozen=True)
class TargetRates:
    """Derivatives of n configurations with respect to the angle theta of a target.

    The target is an orientation that turns about an axis by the angle theta. In each
    configuration, the angle between the output link and the target is as small as possible.

    Attributes
    ----------
    first, second
        (n, variables) first and second derivatives of the pair variables with respect to
        theta.
    follows
        (n,) whether the output link has the orientation of the target and turns exactly
        with it.
    """

    first: Floats
    second: Floats
    follows: Bools


@dataclass(frozen=True)
class TargetDeviation:
    """n configurations with the rotations from their output links to target orientations.

    The target is the orientation that an output link should reach. All vectors are in the
    axes of body 0, the link that the output is relative to.

    Attributes
    ----------
    output_link
        The output link and the closure of its mechanism.
    linearisation
        The closure and its derivatives at the configurations.
    output_jacobian
        G (n, 3, variables), angular velocity of the output link per rate of each variable.
    remaining_rotation
        d (n, 3) rad, rotation vector (axis times angle) from the output link to its target.
    """

    output_link: OutputLink
    linearisation: Linearisation
    output_jacobian: Floats
    remaining_rotation: Floats

    @property
    def values(self) -> Floats:
        """(n, variables) the pair variables (rad)."""
        return self.linearisation.values

    @property
    def orientations(self) -> Floats:
        """(n, 3, 3) rotations from the axes of the output link to those of body 0."""
        return self.linearisation.rotations[:, self.output_link.number]

    @cached_property
    def _jacobian_split(self) -> JacobianSplit:
        """The closure Jacobian J, split by its singular value decomposition.

        J has the derivatives of the loop closure equations. At a regular configuration its
        rank r is the number of variables minus the degrees of freedom of the mechanism. The
        pseudo-inverse (n, variables, equations) uses the r largest singular values. The
        other right singular vectors are the motions that keep the loops closed. These
        motions are the columns of the null space (n, variables, freedoms).

        If the mechanism cannot reach the target, Newton's method uses both parts. The
        pseudo-inverse gives a motion that closes the loops. A motion in the null space then
        reduces the angle to the target.
        """
        variable_count = self.values.shape[1]
        rank = variable_count - self.output_link.degrees_of_freedom
        left_vectors, singular_values, right_vectors = np.linalg.svd(
            self.linearisation.jacobian
        )
        regular = singular_values[:, :rank]
        # At singular configurations some singular values are zero. Quotients by them are
        # then not finite, without a warning.
        with np.errstate(all="ignore"):
            inverse = transpose(right_vectors[:, :rank]) / regular[:, None]
            inverse = inverse @ transpose(left_vectors)[:, :rank]
            # The initial value 1 is the result if there are no loops, so r = 0.
            reciprocal_condition = np.min(regular / regular[:, :1], axis=1, initial=1.0)
        return JacobianSplit(
            pseudo_inverse=inverse,
            null_space=transpose(right_vectors[:, rank:]),
            reciprocal_condition=reciprocal_condition,
        )

    @property
    def loop_conditioning(self) -> Floats:
        """(n,) reciprocal condition number of the loops; 0 if they lose their rank."""
        return self._jacobian_split.reciprocal_condition

    @cached_property
    def free_output_rates(self) -> Floats:
        """(n, 3, freedoms) angular velocities of the output link in possible motions.

        Possible motions keep the loops closed: they are the null space of the closure
        Jacobian. There is one column for each basis vector of this space.
        """
        return self.output_jacobian @ self._jacobian_split.null_space

    @cached_property
    def output_singular_value(self) -> Floats:
        """(n,) smallest angular velocity of the output link for rates of unit length.

        The rates are those of the pair variables, in motions that keep the loops closed.
        The value is zero at the limit of the reach, where some motion does not turn the
        link.
        """
        singular_values = np.linalg.svd(self.free_output_rates, compute_uv=False)
        return np.asarray(singular_values[:, -1])

    @cached_property
    def system(self) -> Floats:
        """(n, equations + 3, variables) Jacobian of the loops and of the output link.

        The first rows are the closure Jacobian, the last three rows `output_jacobian`.
        Multiplied by the rates of the variables, the first rows give the rates at which the
        loops open, and the last rows give the angular velocity of the output link. The
        matrix has full rank if every motion of the mechanism turns the output link.
        """
        return np.concatenate([self.linearisation.jacobian, self.output_jacobian], axis=1)

    @cached_property
    def system_inverse(self) -> Floats:
        """(n, variables, equations + 3) pseudo-inverse of `system`."""
        return np.linalg.pinv(np.nan_to_num(self.system), rcond=SYSTEM_RCOND)

    @cached_property
    def _is_off_target(self) -> Bools:
        """(n,) whether the output link is not on the target."""
        return np.linalg.norm(self.remaining_rotation, axis=1) > ON_TARGET_RAD

    @cached_property
    def _pair_moments(self) -> Floats:
        """(n, variables, 3) the moment that the pair of each variable transmits.

        Imagine a torsional spring of unit stiffness between the output link and its target.
        The configuration nearest to the target is its equilibrium: the moment f that a pair
        transmits is at right angles to its axis a, so a . f = 0. The derivatives of this
        condition are needed, for example for `stiffness`. They contain the term a' . f,
        because the axes turn when the mechanism moves.

        The moment of the spring on the link is the remaining rotation to the target, a
        rotation vector (n, 3). The pairs between the base and the link transmit this
        moment. The pairs of a closed loop also transmit the reaction that keeps the loop
        closed. The moment of a pair is the sum of these moments. If the link is on the
        target, all moments are zero.
        """
        spring_force = np.vecmat(self.remaining_rotation, self.output_jacobian)
        moments = self._transmitted_moments(
            output_moment=self.remaining_rotation,
            reactions=self._balancing_reactions(spring_force),
        )
        return np.where(self._is_off_target[:, None, None], moments, 0.0)

    def _balancing_reactions(self, force: Floats) -> Floats:
        """Return the reactions in the loops that balance forces on the variables.

        `_transmitted_moments` adds these reactions to the moments that the pairs of the
        loops transmit. The reactions m satisfy J^T m + force = 0. J is the closure
        Jacobian, with three rows for each loop. The solution is m = -(J^+)^T force, with
        the pseudo-inverse J^+.

        Parameters
        ----------
        force
            (n, variables) generalised force on each variable, such as a moment about a pair
            axis.

        Returns
        -------
        (n, loops, 3) moment vector of each loop at its chord, the pair that closes the
        loop.
        """
        reactions = -np.vecmat(force, self._jacobian_split.pseudo_inverse)
        return reactions.reshape(len(force), len(self.linearisation.tree.chords), 3)

    def _transmitted_moments(self, output_moment: Floats, reactions: Floats) -> Floats:
        """Return the moments (n, variables, 3) that pairs transmit, for each variable.

        Imagine a torsional spring between the output link and its target. The spring exerts
        a moment on the link, which the pairs transmit to the base. `_pair_moments` says why
        these moments are needed. The same sums give the rates of the moments from the rates
        of both arguments.

        Each variable belongs to a pair (joint), and has the moment of this pair. The pairs
        on the path from body 0 (the base) to the output link transmit the moment on this
        link. All pairs of a loop transmit the reaction of the loop. The moment of a pair is
        the sum of these moments.

        Parameters
        ----------
        output_moment
            (n, 3) moment on the output link.
        reactions
            (n, loops, 3) reaction of each loop: the moment at the pair that closes it.
        """
        # These arrays have 1 or -1 for the direction in which a path or a loop goes through
        # a pair, and 0 if it does not contain the pair.
        tree = self.linearisation.tree
        path_senses = tree.paths[self.output_link.number]
        loop_senses = tree.signs
        moments_along_path = path_senses[:, None] * output_moment[:, None]
        return transpose(loop_senses) @ reactions + moments_along_path

    def _vector_rates(self, rates: Floats) -> Floats:
        """Return the time derivatives (n, variables, 3) of the vectors of variables.

        The vector of a variable is the relative angular velocity of the links of its pair
        (joint) at unit rate. For an R pair it is the unit vector of the axis. The variables
        move at `rates` (n, variables).
        """
        return self.linearisation.vector_rates(self.linearisation.body_rates(rates))

    def _vector_accelerations(self, rates: Floats, vector_rates: Floats) -> Floats:
        """Return the second time derivatives of the axis vectors of all variables.

        The axis a of a pair is fixed in a body with the angular velocity w and the angular
        acceleration w', so a'' = w' x a + w x a'. With constant rates r_v of the variables
        v between body 0 and this body, and their axes a_v,

            w = sum of r_v a_v,    w' = sum of r_v a_v'.

        Parameters
        ----------
        rates
            (n, variables) constant rates of the variables.
        vector_rates
            (n, variables, 3) first derivatives of the axes at these rates.

        Returns
        -------
        (n, variables, 3). NaN for contact pairs: the derivatives of their profiles are not
        available.
        """
        tree = self.linearisation.tree
        vectors = self.linearisation.vectors
        # (n, bodies, 3)
        angular_velocities = tree.body_rates(vectors, rates)
        angular_accelerations = tree.body_rates(vector_rates, rates)
        # The axis of a variable is fixed in the first body of its pair.
        carrying_bodies = tree.first_bodies[list(tree.pair_of_variable)]
        w = angular_velocities[:, carrying_bodies]
        w_rate = angular_accelerations[:, carrying_bodies]
        result = cross(w_rate, vectors)
        result += cross(w, vector_rates)
        joints = self.linearisation.joints
        is_contact = [not joints[pair].has_axis for pair in tree.pair_of_variable]
        result[:, is_contact] = np.nan
        return result

    def _gradient_rates(self, rates: Floats) -> Floats:
        """Return the change (n, variables) of the gradient of a^2 / 2.

        The symbol a is the angle (rad) between the output link and its target. The gradient
        has the derivatives with respect to the pair variables. The variables move at rates
        (n, variables), and the target is fixed.
        """
        output_velocity = np.matvec(self.output_jacobian, rates)
        rotation_rate = log_rate(-self.remaining_rotation, output_velocity)
        # The axes of the pairs turn relative to the moments in the pairs, as if a spring
        # pulled the output link to its target.
        force_by_axes = np.vecdot(self._vector_rates(rates), self._pair_moments)
        return np.vecmat(rotation_rate, self.output_jacobian) - force_by_axes

    @cached_property
    def stiffness(self) -> Floats:
        """(n, freedoms, freedoms) second derivative of a^2 / 2 along the configurations.

        The symbol a is the angle between the output link and its target. If a^2 / 2 were
        the energy of a spring between the link and its target, this derivative would be the
        stiffness of the spring. Rows and columns belong to the motions that keep the loops
        closed, which are the null space of the closure Jacobian.
        """
        null_space = self._jacobian_split.null_space
        columns = [self._gradient_rates(motion) for motion in np.moveaxis(null_space, 2, 0)]
        return transpose(null_space) @ np.stack(columns, axis=2)

    @cached_property
    def least_eigenvalue(self) -> Floats:
        """(n,) smallest eigenvalue of the `stiffness`; -1 where this is not finite.

        The stiffness is the second derivative of half the squared angle to the target. If
        its smallest eigenvalue is positive, the configuration is nearer to the target than
        those around it.
        """
        symmetric_stiffness = 0.5 * (self.stiffness + transpose(self.stiffness))
        is_finite = all_finite(symmetric_stiffness, (1, 2))
        least = np.full(len(symmetric_stiffness), -1.0)
        least[is_finite] = np.linalg.eigvalsh(symmetric_stiffness[is_finite])[:, 0]
        return least

    def _solve_motion(
        self, force: Floats, closure_change: Floats, stiffness: Floats
    ) -> Floats:
        """Return the motion (n, variables) that closes the loops and balances forces.

        A torsional spring of unit stiffness acts between the output link and its target. If
        the variables change by x, its forces on the variables change by -K x, with the
        stiffness matrix K. The result is the x for which

            J x = closure_change,        N^T (force - K x) = 0.

        The first equation, with the Jacobian J of the loops, closes the loops. The second
        one balances the forces. The columns of N are the motions that keep the loops
        closed; other forces are balanced by reactions in the loops.

        The solution is a step of Newton's method towards the configuration nearest to the
        target, or the derivative of this configuration as the target turns.

        Parameters
        ----------
        force
            (n, variables) forces on the variables at x = 0.
        closure_change
            (n, equations) required change of the closure residuals.
        stiffness
            (n, degrees of freedom, degrees of freedom) N^T K N, the stiffness of the spring
            for motions that keep the loops closed, or an approximation of it.
        """
        split = self._jacobian_split
        # 1. The shortest motion that closes the loops. `_gradient_rates` returns K x.
        closing_motion = np.matvec(split.pseudo_inverse, closure_change)
        remaining_force = force - self._gradient_rates(closing_motion)
        # 2. The motion that balances the remaining forces and keeps the loops closed.
        # `left_inverse` returns NaN for a singular stiffness and raises no error.
        free_motion = np.matvec(
            left_inverse(stiffness), np.vecmat(remaining_force, split.null_space)
        )
        return closing_motion + np.matvec(split.null_space, free_motion)

    def newton_step(self, can_follow: bool) -> Floats:
        """Return the Newton step (n, variables), in rad, towards the nearest configuration.

        The nearest configuration has closed loops and the smallest angle a between the
        output link and its target orientation: it is a minimum of a^2 / 2. Imagine a
        torsional spring between the link and its target that has this energy.

        Parameters
        ----------
        can_follow
            Whether the mechanism can reach the target. The orientation of the output link
            then adds three equations to the equations of the loops.
        """
        if can_follow:
            # Close the loops, and turn the output link by the remaining rotation.
            right_side = np.concatenate(
                [-self.linearisation.residual, self.remaining_rotation], axis=1
            )
            return np.matvec(self.system_inverse, right_side)
        # Close the loops, and make the gradient of the energy a^2 / 2 zero. Minus this
        # gradient is the force of the spring on the variables. It is G^T d, with the
        # Jacobian G of the output link and the remaining rotation d (rotation vector).
        force = np.vecmat(self.remaining_rotation, self.output_jacobian)
        # The stiffness is the second derivative of the energy. Only with a positive
        # definite (convex) stiffness does the step certainly lead to a minimum, not to a
        # maximum. Where the true stiffness is not convex, an approximation replaces it.
        stiffness = self._convex_stiffness()
        return self._solve_motion(
            force=force,
            closure_change=-self.linearisation.residual,
            stiffness=stiffness,
        )

    def _convex_stiffness(self) -> Floats:
        """Return a stiffness (n, freedoms, freedoms) for steps that decrease the angle a.

        a is the angle between the output link and its target. The attribute `stiffness` is
        the second derivative of a^2 / 2 along motions that keep the loops closed. Where
        the stiffness is not clearly positive definite, a Newton step could increase the
        angle. The stiffness is replaced there by the Gauss-Newton matrix W^T W, which has
        no negative eigenvalues. The columns of W are the angular velocities of the output
        link in these motions.
        """
        # `free_output_rates` is W.
        gauss_newton = transpose(self.free_output_rates) @ self.free_output_rates
        # The eigenvalues of W^T W are the squares of the singular values of W. The smallest
        # singular value is `output_singular_value`.
        #
        # If the link is on its target, both matrices are equal, and so are their smallest
        # eigenvalues. Elsewhere, the smallest eigenvalue of the stiffness must exceed
        # `MIN_CONVEXITY_RATIO` times that of W^T W.
        least_gauss_newton_eigenvalue = self.output_singular_value**2
        # `least_eigenvalue` is the smallest eigenvalue of the stiffness.
        is_convex = (
            self.least_eigenvalue > MIN_CONVEXITY_RATIO * least_gauss_newton_eigenvalue
        )
        return np.where(is_convex[:, None, None], self.stiffness, gauss_newton)

    def error(self, can_follow: bool) -> Floats:
        """Return the error (n,), in rad, of configurations that should be the nearest ones.

        The nearest configuration has closed loops and the smallest angle a to the target.
        The error is the larger one of two numbers, the closure residual and an error of the
        output link.

        Parameters
        ----------
        can_follow
            Whether the mechanism can reach the target. If so, the error of the output link
            is the remaining rotation to the target. If not, it is the gradient of a^2 / 2
            in the motions that keep the loops closed, which is 0 at a minimum.
        """
        if can_follow:
            output_error = self.remaining_rotation
        else:
            # The remaining rotation d is a rotation vector of the length a. If the link has
            # the angular velocity w, the rate of a^2 / 2 is -d . w. Only its size matters.
            # `free_output_rates` (n, 3, freedoms) has w for motions that keep the loops
            # closed.
            output_error = np.vecmat(self.remaining_rotation, self.free_output_rates)
        return np.maximum(
            self.linearisation.closure_residual, max_abs(output_error, axis=1)
        )

    def rates(self, axis: Floats) -> TargetRates:
        """Return how the configurations change while the target turns about an axis.

        The target is an orientation of the output link, and turns by the angle theta. Each
        configuration must be the one nearest to the target: the angle between the output
        link and the target is smallest there. There are two cases:

        - The output link follows the target exactly. The rotation of the link then adds
          three equations to the equations of the loops.
        - The output link cannot follow. It moves so that the angle to the target stays
          smallest.

        Parameters
        ----------
        axis
            (3,) unit vector in the axes of body 0, the link from which the output is seen.

        Returns
        -------
        For each configuration the first and second derivatives of its variables with
        respect to theta, and whether the output link follows the target.
        """
        following = self._following_rates(axis)
        if np.all(following.follows):
            return following
        nearest_first, nearest_second = self._nearest_rates(axis)
        is_following_row = following.follows[:, None]  # (n, 1)
        return TargetRates(
            first=np.where(is_following_row, following.first, nearest_first),
            second=np.where(is_following_row, following.second, nearest_second),
            follows=following.follows,
        )

    def _following_rates(self, axis: Floats) -> TargetRates:
        """Return the derivatives with which the output link follows its target exactly.

        The target turns about the axis by the angle theta. With the Jacobians J of the
        loops and G of the output link, the first and second derivatives of the variables
        with respect to theta, x' and x'', have to satisfy

            J x' = 0,           G x' = axis,
            J x'' = -J' x',     G x'' = -G' x'.

        These equations are solved by least squares. The misfit, the difference between both
        sides of these equations, shows whether the link can follow the target. `follows` is
        true if the link is on the target and the misfit is zero, up to the tolerance
        `ON_TARGET_RAD`.

        Parameters
        ----------
        axis
            (3,) unit vector in the axes of body 0, the link from which the output is seen.
        """
        # `system` (n, equations + 3, variables) is J above G.
        right_side_shape = self.system.shape[:2]
        velocity_right = np.zeros(right_side_shape)
        velocity_right[:, -3:] = axis
        first = np.matvec(self.system_inverse, velocity_right)
        velocity_misfit = np.matvec(self.system, first) - velocity_right

        # J' x' and G' x'. J' and G' are the derivatives of the Jacobians with respect to
        # theta, while the variables have the rates x'.
        loop_bias, output_bias = self._velocity_biases(first, self._vector_rates(first))
        acceleration_right = -np.concatenate([loop_bias, output_bias], axis=1)
        second = np.matvec(self.system_inverse, acceleration_right)
        acceleration_misfit = np.matvec(self.system, second) - acceleration_right
        # Near singular configurations the right side and its rounding errors are large, so
        # the misfit is divided by 1 + the size of the right side.
        acceleration_misfit /= 1.0 + max_abs(acceleration_right, axis=1)[:, None]

        misfit = max_abs(np.hstack([velocity_misfit, acceleration_misfit]), axis=1)
        is_on_target = ~self._is_off_target
        return TargetRates(first, second, follows=is_on_target & (misfit < ON_TARGET_RAD))

    def _velocity_biases(
        self, rates: Floats, vector_rates: Floats
    ) -> tuple[Floats, Floats]:
        """Return J' v' (n, equations) and G' v' (n, 3) at rates v' (n, variables).

        J is the Jacobian of the loops and G the Jacobian of the output link; J' and G' are
        their time derivatives. Both Jacobians consist of the vectors of the variables
        (joint axes). These change at `vector_rates` (n, variables, 3).
        """
        tree = self.linearisation.tree
        loop_bias = np.matvec(tree.jacobian(vector_rates), rates)
        output_bias = tree.body_rates(vector_rates, rates)[:, self.output_link.number]
        return loop_bias, output_bias

    def _nearest_rates(self, axis: Floats) -> tuple[Floats, Floats]:
        """Return the first and second derivatives (n, variables) of nearest configurations.

        The target turns about the `axis` (3,) by the angle theta. The nearest configuration
        has the smallest angle between the output link and the target. This configuration is
        the equilibrium of a torsional spring of unit stiffness between the link and the
        target: no moment acts about the axis a_v of the pair of a variable v. With the
        moment f_v of spring and reactions at this pair, the equilibrium is

            a_v . f_v = 0 for all variables v, or together G^T d + J^T m = 0.

        Here the remaining rotation d to the target is the moment of the spring, G is the
        Jacobian of the output link, J the Jacobian of the loops, and m are the reactions in
        the loops.

        This equation is differentiated once and twice with respect to theta. Each
        derivative has the form stiffness @ unknown = force. The unknown is the first or
        second derivative of the variables, and `force` has all other terms. `_solve_motion`
        solves it.
        """
        d = self.remaining_rotation

        # 1. First derivatives. `target_rate` is the change of d if only the target turns.
        # The forces of the spring then change by G^T times this.
        target_rate = log_rate(d, axis)
        first = self._solve_motion(
            force=np.vecmat(target_rate, self.output_jacobian),
            closure_change=np.zeros_like(self.linearisation.residual),
            stiffness=self.stiffness,
        )

        # 2. Changes of all quantities in the equation at these rates.
        vector_rates = self._vector_rates(first)
        w = np.matvec(self.output_jacobian, first)  # angular velocity of the output link
        # Change of d. If the target turns, d changes by `target_rate`. If the output link
        # turns, -d, the rotation from the target to the link, changes likewise.
        d_rate = target_rate - log_rate(-d, w)
        # The rates f_v' of the moments follow from a_v' . f_v + a_v . f_v' = 0. A part of
        # f_v' is due to the rates m' of the reactions, and `force_rate` has all other terms
        # of these equations, so that J^T m' + force_rate = 0.
        force_rate = np.vecdot(vector_rates, self._pair_moments)
        force_rate = force_rate + np.vecmat(d_rate, self.output_jacobian)
        moment_rates = self._transmitted_moments(
            output_moment=d_rate, reactions=self._balancing_reactions(force_rate)
        )
        # Changes of J and G, times the first derivatives of the variables.
        loop_bias, output_bias = self._velocity_biases(first, vector_rates)

        # 3. Second derivatives. With L(d, w) = `log_rate(d, w)`, step 2 has computed
        #     d' = L(d, axis) - L(-d, w).
        # `d_bias` is the derivative of both terms at constant angular velocities `axis` and
        # w. Only w changes: w' = output_bias + G second. Since L is linear in w,
        #     d'' = d_bias - L(-d, output_bias) - L(-d, G second).
        # The last term contains the unknown `second`, so `force` has the other two.
        d_bias = log_rate_change(d, d_rate, axis)
        d_bias -= log_rate_change(-d, -d_rate, w)

        force_by_axes = np.vecdot(
            self._vector_accelerations(first, vector_rates), self._pair_moments
        )
        # On the target all moments are zero, so the product is set to 0. For contact pairs
        # the product would be NaN, like their vector accelerations.
        force_by_axes = np.where(self._is_off_target[:, None], force_by_axes, 0.0)
        # The second derivative of each product (a_v . f_v)'' = a_v'' . f_v + 2 a_v' . f_v'
        # + a_v . f_v'', without terms that contain second derivatives of the variables.
        force_by_output = np.vecmat(
            d_bias - log_rate(-d, output_bias), self.output_jacobian
        )
        force = force_by_axes + force_by_output
        force += 2.0 * np.vecdot(vector_rates, moment_rates)
        second = self._solve_motion(
            force=force, closure_change=-loop_bias, stiffness=self.stiffness
        )
        return first, second
