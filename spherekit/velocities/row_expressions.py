"""Expressions of a configuration that do not depend on which input moves, and error bounds.

A configuration closes its loops only up to their closure residual and the rounding of the
sizes of the mechanism. Because a loop stays open by a small rotation, links are turned,
axes are tilted with them, and the velocity equations have slightly different coefficients.
The bounds here use norms only, so they hold for openings in any direction.

With the closure Jacobian J of the passive variables, the opening g of the loops (rad) and a
left inverse J^+, variables move by J^+ g. `loop_inverse` gives J^+ as expressions. The
velocities and poles while one input moves are in `input_columns.py`.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot
from spherekit.symbolic.vector_algebra import Exprs, vector_sum
from spherekit.tolerances import EPS, EQUAL_CURVATURE
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.carried_vectors import CarriedVector, largest, root
from spherekit.velocities.elimination_order import Pivot
from spherekit.velocities.loop_inverse import loop_inverse
from spherekit.velocities.pose_expressions import place_by_variables
from spherekit.velocities.velocity_equations import VelocityEquations

PROFILE_ROUNDING_RAD = 4.0 * EPS
"""Bound of the tilt that rounding gives the moving frame of a profile.

Larger: contacts with a larger closure residual count as closed. Smaller: their rows take
another step of Newton's method, which cannot reduce the residual.
"""


class RowExpressions(VelocityEquations):
    """Closure, loop inverse and error bounds of one configuration, as expressions.

    The loops of a computed configuration are open by a small rotation, because of its
    closure residual and of the rounding of sizes. The bounds say by how much this changes
    variables and axes. The bounds use norms only, so they apply to openings in any
    direction.

    Attributes
    ----------
    passive_variables
        Indices of the variables that no input sets.
    inverse
        (variables, loops, 3) left inverse of the loop equations: the movement of each
        variable (rad) per unit opening (rad) of each loop about each ground axis. Zero for
        inputs.
    residual
        Closure residual: root of the sum of squares of the opening angles of all loops
        (rad). An angle x counts as 2 sin(x / 2).
    variable_shifts
        Bound of the movement of each variable per unit opening of all loops (rad per rad).
    link_turns
        Bound of the rotation of each link per unit opening of all loops (rad per rad).
    closure_rounding_rad
        Closure residual (rad) that rounding alone can cause. A smaller residual counts
        as zero.
    opening_rad
        Bound of the opening of all loops (rad), with closure residual and rounding.
    tilt_rad
        Bound of the tilt of an axis (rad) by the rounding of sizes on the path to its link.
    axis_errors, slide_errors
        Bounds of the errors of the vector of each variable (its axis), and of its
        slide: the derivative of the vector with respect to the variable, which is zero
        except at contacts.
    loop_counts
        Number of loops that contain each variable.
    condition_number
        Product of the Frobenius norms of the Jacobian and of its left inverse.
    kantorovich_number
        Bound of h in the theorem of Kantorovich: |J^+|^2 times the opening of all loops,
        times a bound of their second derivatives. Below 1/2, exactly one closed
        configuration is near.
    configuration_error
        Bound (rad) of the distance from that closed configuration.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        variables: Sequence[ExpressionNode],
        pivots: Sequence[Pivot],
        inputs: Sequence[int],
    ) -> None:
        """Write loop equations, their left inverse and error bounds as expressions.

        The left inverse gives the movements of the variables that close slightly open
        loops.

        The velocity equation of a loop says that the sum of the variables' vectors times
        their rates is 0. The vector of a variable is the relative angular velocity of the
        links of its pair (joint) per unit rate. For an R pair (revolute joint) the vector
        is the axis.

        The error bounds apply to variables and axes, which have errors for two reasons: the
        loops of a computed configuration are not closed exactly, and the sizes of the links
        are rounded.

        Parameters
        ----------
        mechanism
            The mechanism. Its contacts may have profiles (contact curves) of any shape.
        variables
            Symbols of all pair variables.
        pivots
            The order in which variables that are not inputs are eliminated. A pivot is a
            loop and up to three variables, for which the equations of the loop are solved.
        inputs
            Indices of the driven pairs.
        """
        # For a profile that is no circle, tangent, point and curvature at the contact are
        # symbols. Their values are computed elsewhere for each configuration.
        pairs = pair_rotations(mechanism, any_profile=True)
        # The orientation of each link.
        placed = place_by_variables(mechanism, pairs, variables)
        # The base class sets `vectors` (of the variables), `tree` (the loops) and
        # `closure_residual_square`. With `about_centres`, the vector of two circles that
        # roll on each other would be a sum of two vectors along the axes of the circles.
        # This sum loses digits for small circles, and its error bounds are not computed.
        super().__init__(mechanism, pairs, placed, variables, about_centres=False)
        input_variables = [self.pair_variables[pair][0] for pair in inputs]
        self.passive_variables = [
            v for v in range(len(variables)) if v not in input_variables
        ]
        # (loops, 3, variables) the coefficients of the velocity equations. The column of a
        # variable is its vector times a sign. The sign is 1 or -1 for the sense in which
        # the loop passes its pair, and 0 outside the loop. The columns of inputs are zero,
        # because inputs are no unknowns.
        equations = np.stack(self.vectors, axis=1) * self.tree.signs[:, None]
        equations[..., input_variables] = 0.0
        self.inverse = loop_inverse(equations, pivots)
        self.residual = root(self.closure_residual_square)
        self._set_error_bounds()

    def _set_error_bounds(self) -> None:
        """Set the bounds of the errors of variables, orientations and axes.

        The loops of a computed configuration are open by small rotations. The variables of
        the nearest closed configuration differ by the inverse J^+ of the loop equations
        times the opening. All bounds are expressions that follow from this by norms of rows
        of J^+.
        """
        tree = self.tree
        # The length of the row of J^+ of a variable is its largest movement per unit
        # opening of all loops. Each variable on the path to a link turns the link.
        inverse_squares = [dot(row.flat, row.flat) for row in self.inverse]
        self.variable_shifts = [root(square) for square in inverse_squares]
        inverse_norm = root(sum(inverse_squares, 0.0))
        self.link_turns = self.turns_along_paths(self.variable_shifts)

        # The opening of a loop about one axis: the closure residual, and the rounding of
        # the axes of the pairs in the longest loop. As a margin, two more roundings are
        # added.
        rounding = EPS * (2.0 + tree.longest_loop)
        component_opening = self.residual + rounding
        # The closure residual that rounding alone can cause. A contact has two profiles,
        # whose frames have a rounding error each. Larger factor: larger residuals count as
        # rounding.
        profile_count = 2.0 * len(self.pairs.sides)
        self.closure_rounding_rad = np.sqrt(2.0) * (
            rounding + profile_count * PROFILE_ROUNDING_RAD
        )
        # Every loop may be open by `component_opening` about each of the three axes.
        self.opening_rad = component_opening * float(np.sqrt(3.0 * len(tree.chords)))
        # The rounding of sizes tilts an axis: each pair on the longest path from the ground
        # to a link adds its part.
        self.tilt_rad = 2.0 * EPS * (2.0 + tree.longest_path)

        # Errors of the vector of each variable, and of the slide: the derivative of the
        # vector with respect to the variable, which is zero except at contacts.
        self.axis_errors: list[Expr] = []
        self.slide_errors: list[Expr] = []
        for carried, shift in zip(self.carried, self.variable_shifts, strict=True):
            axis_error, slide_error = self.position_errors(carried, shift)
            self.axis_errors.append(axis_error)
            self.slide_errors.append(slide_error)

        self.loop_counts = np.count_nonzero(tree.signs, axis=0).astype(float).tolist()
        length_squares = [carried.length * carried.length for carried in self.carried]
        jacobian_square = sum(
            (self.loop_counts[v] * length_squares[v] for v in self.passive_variables), 0.0
        )
        # Product of the Frobenius norms. A variable occurs in the equations of each loop
        # that contains it, with its vector.
        self.condition_number = inverse_norm * root(jacobian_square)

        # A second derivative of a loop is a vector product of two vectors of variables. The
        # bound sums them over the longest loop. The vector of a contact also slides with
        # its own variable. Each of L loops can have this bound, so all together have it
        # times sqrt(L). With it Kantorovich's number h is
        # |second derivative| |J^+|^2 |opening|.
        slide_lengths = [carried.slide_length for carried in self.carried]
        loop_derivative = float(tree.longest_loop) * largest(length_squares) + largest(
            slide_lengths
        )
        second_derivative = float(np.sqrt(len(tree.chords))) * loop_derivative
        step = inverse_norm * self.opening_rad
        self.kantorovich_number = second_derivative * inverse_norm * step
        # Kantorovich: the solution is within (1 - sqrt(1 - 2h)) / h times the first step of
        # Newton's method. This form of the factor has no cancellation for small h.
        denominator = 1.0 + root(1.0 - 2.0 * self.kantorovich_number)
        self.configuration_error = step * 2.0 / denominator + 2.0 * EPS

    def position_errors(
        self, carried: CarriedVector, variable_shift: Expr
    ) -> tuple[Expr, Expr]:
        """Return bounds of the errors of a variable's vector and of its slide.

        The vector is the angular velocity of a pair (joint) per unit rate of the variable.
        It is carried by a link, and turns with this link. At a contact, it also changes
        relative to the link when the variable changes. The slide is the derivative of this
        change with respect to the variable.

        The loops of a computed configuration are open by up to `opening_rad`. This has two
        effects, compared with the closed configuration:

        - The link has another orientation. Rounding of the arcs and angles of links adds a
          tilt of up to `tilt_rad`. A rotation by a small angle changes a vector by up to
          its length times the angle.
        - The variable has another value. Its error changes the vector by up to the length
          of the slide times the error.

        Parameters
        ----------
        carried
            The vector with its link, its length, the length of its slide, and a bound of
            the derivative of its slide.
        variable_shift
            Bound of the movement of the variable, divided by the opening of the loops (rad
            per rad).
        """
        # Bounds of the rotation of the link and of the error of the variable. `link_turns`
        # are the rotations of the links per unit opening of all loops.
        turn = self.link_turns[carried.link] * self.opening_rad + self.tilt_rad
        shift = variable_shift * self.opening_rad
        vector_error = carried.length * turn + carried.slide_length * shift
        # Bound of the length of the derivative of the slide with respect to the variable.
        # `total` is the sum of the bounds of its terms.
        slide_change = carried.slide_change_bound.total
        slide_error = carried.slide_length * turn + slide_change * shift
        return vector_error, slide_error

    def turns_along_paths(self, variable_changes: Sequence[Expr]) -> list[Expr]:
        """Return a bound of the rotation of each link, given changes of the variables.

        The vector of a variable is the angular velocity of its pair at unit rate. Each
        variable on the path from the ground to a link turns the link by the length of this
        vector times the change of the variable.
        """
        return self.sum_along_paths(
            [
                carried.length * change
                for carried, change in zip(self.carried, variable_changes, strict=True)
            ]
        )

    def sum_along_paths(self, bounds: Sequence[Expr]) -> list[Expr]:
        """Return for each link the sum of the bounds of the variables on the path to it."""
        sums: list[Expr] = [0.0] * self.tree.count
        for pair, parent, child in self.tree.placements:
            sums[child] = sums[parent] + sum(
                (bounds[v] for v in self.pair_variables[pair]), 0.0
            )
        return sums

    @property
    def newton_step(self) -> list[Expr]:
        """The passive variables after a step of Newton's method that closes the loops."""
        step = self.solve_loops(self.closure_residuals)
        return [self.variables[v] + step[v] for v in self.passive_variables]

    def solve_loops(self, offsets: Mapping[int, Exprs]) -> list[Expr]:
        """Return the rates of all variables that solve the loop equations, inputs at rest.

        The equation of each loop is: the sum of a_v x_v equals the sum of e. The unknowns
        x_v are the rates of the variables v that are not inputs, and a_v are their vectors.
        The offsets e are given vectors of some pairs (joints). Each term has the sign of
        the sense in which the loop passes its pair. The method has three uses:

        - Velocities: an input has the angular velocity w. The offset of its pair is -w.
        - Accelerations: a pair has the part b of its angular acceleration that depends only
          on velocities. The offset of the pair is -b. The results are the accelerations of
          the variables.
        - Closing loops: the frame of a pair is computed along both sides of an open loop,
          and the results differ by a small rotation. The offset of the pair is this
          rotation. The results are a step of Newton's method.

        Parameters
        ----------
        offsets
            (3,) by the index of the pair, the offset e in ground axes. Other pairs have no
            offset.
        """
        loop_offsets: list[Exprs] = []
        for signs in self.tree.signs:
            # A sign is 1 or -1 for the sense in which the loop passes a pair, 0 for pairs
            # outside. It is the same for all variables of the pair, so the sign of the
            # first variable is used.
            offset_sum = vector_sum(
                offset * signs[self.pair_variables[pair][0]]
                for pair, offset in offsets.items()
            )
            loop_offsets.append(offset_sum)
        # `inverse` is the inverse of the loop equations. For each variable it has an array
        # (loops, 3): the rate of the variable per unit offset of each loop along x, y and
        # z. For inputs it is zero.
        flat_offsets = np.ravel(loop_offsets)
        return [dot(row.flat, flat_offsets) for row in self.inverse]


def curvature_uncertainties(rows: RowExpressions) -> list[Expr]:
    """Return, for each contact, a number that exceeds 1 if its curvatures are nearly equal.

    Two profiles (contact curves) of equal curvature do not determine their relative motion.
    The number is 2 `EQUAL_CURVATURE` / (k1 - k2), with the curvatures k1 and k2 of the
    first and the second profile. A curvature is positive if the profile is curved towards
    the first link. If k2 exceeds k1, the links would overlap, and the number is NaN.

    If the number exceeds 1, the row (configuration) is computed again more exactly. The row
    counts as undetermined if k1 - k2 is below `EQUAL_CURVATURE`; the factor 2 is a margin.
    Contacts of two circles are left out, because their curvatures are constant.
    """
    uncertainties: list[Expr] = []
    for first, second in rows.pairs.sides.values():
        difference = first.curvature - second.curvature
        # The difference is a plain number for two circles, and an expression otherwise.
        if isinstance(difference, ExpressionNode):
            # The product of two roots is NaN for negative differences.
            positive_difference = root(difference) * root(difference)
            uncertainties.append(2.0 * EQUAL_CURVATURE / positive_difference)
    return uncertainties
