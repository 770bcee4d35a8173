"""Expressions of a row that do not depend on which input moves, with error bounds.

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
    variables and axes. They use norms only, so they apply to openings in any direction.

    Attributes
    ----------
    passive_variables
        Numbers of the variables that no input sets.
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
        Closure residual (rad) that rounding alone can cause. A smaller one counts as zero.
    opening_rad
        Bound of the opening of all loops (rad), with closure residual and rounding.
    tilt_rad
        Bound of the tilt of an axis (rad) by the rounding of sizes on the path to its link.
    axis_errors, slide_errors
        Bounds of the errors of the vector of each variable (its axis), and of its slide:
        the derivative of the vector by the variable, which is zero except at contacts.
    loop_counts
        Number of loops that contain each variable.
    condition_number
        Product of the Frobenius norms of the Jacobian and of its left inverse.
    kantorovich_number
        Bound of h in the theorem of Kantorovich: |J^+|^2 times the opening of a loop, times
        a bound of the second derivatives of the loops. Below 1/2, exactly one closed
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
        """Write the expressions that the class lists.

        Parameters
        ----------
        mechanism
            The mechanism. Its contacts may have profiles of any shape.
        variables
            Symbols of all pair variables.
        pivots
            The order in which passive variables are eliminated from the loop equations.
            Each pivot is a loop with the variables (at most three) for which the equations
            of this loop are solved.
        inputs
            Numbers of the driven pairs.
        """
        # Tangent, point and curvature of a profile that is no circle are symbols.
        pairs = pair_rotations(mechanism, any_profile=True)
        placed = place_by_variables(mechanism, pairs, variables)
        # The vector of two rolling circles is (k1 - k2) p, with the curvatures k1 and k2
        # and the contact point p. The sum of vectors about the centres of the circles would
        # take fewer expressions, but loses digits if the circles are small.
        super().__init__(mechanism, pairs, placed, variables, about_centres=False)
        input_variables = [self.pair_variables[pair][0] for pair in inputs]
        self.passive_variables = [
            v for v in range(len(variables)) if v not in input_variables
        ]
        # (loops, 3, variables) the Jacobian of the loop equations: the vector of each
        # variable, with the sense in which the loop passes its pair. Inputs are fixed.
        equations = np.stack(self.vectors, axis=1) * self.tree.signs[:, None]
        equations[..., input_variables] = 0.0
        self.inverse = loop_inverse(equations, pivots)
        self.residual = root(self.closure_residual_square)
        self._set_error_bounds()

    def _set_error_bounds(self) -> None:
        """Set the bounds of the errors of variables, orientations and axes.

        All bounds are expressions. They follow from the inverse of the loop equations by
        norms: variables move by at most the norm of the inverse times the opening of the
        loops. The class explains the attributes that are set.
        """
        tree = self.tree
        inverse_squares = [dot(row.flat, row.flat) for row in self.inverse]
        self.variable_shifts = [root(square) for square in inverse_squares]
        inverse_norm = root(sum(inverse_squares, 0.0))
        self.link_turns = self.turns_along_paths(self.variable_shifts)

        # The opening of a loop: each pair of the loop adds the rounding of its axes.
        rounding = EPS * (2.0 + tree.longest_loop)
        component_opening = self.residual + rounding
        # A contact has two profiles, whose frames have a rounding error each.
        profile_count = 2.0 * len(self.pairs.sides)
        self.closure_rounding_rad = np.sqrt(2.0) * (
            rounding + profile_count * PROFILE_ROUNDING_RAD
        )
        # Every loop may be open by this much about each of the three axes.
        self.opening_rad = component_opening * float(np.sqrt(3.0 * len(tree.chords)))
        self.tilt_rad = 2.0 * EPS * (2.0 + tree.longest_path)

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

        second_derivative = float(tree.longest_loop) * largest(length_squares)
        inverse_square = inverse_norm * inverse_norm
        self.kantorovich_number = second_derivative * inverse_square * component_opening
        # Kantorovich: the solution is within (1 - sqrt(1 - 2h)) / h times the first step of
        # Newton's method. This form of the factor has no cancellation for small h.
        denominator = 1.0 + root(1.0 - 2.0 * self.kantorovich_number)
        step = inverse_norm * component_opening
        self.configuration_error = step * 2.0 / denominator + 2.0 * EPS

    def position_errors(
        self, carried: CarriedVector, variable_shift: Expr
    ) -> tuple[Expr, Expr]:
        """Return bounds of the errors of a carried vector and of its slide.

        A carried vector turns with a link. At a contact it also slides on this link as a
        variable changes; its slide is its derivative with respect to this variable. Because
        the loops stay open by rounding, the link is turned and the variable is shifted.

        Parameters
        ----------
        carried
            The vector with its link, its length and the length of its slide.
        variable_shift
            Bound of the movement of the variable per unit opening of all loops (rad per
            rad).
        """
        turn = self.link_turns[carried.link] * self.opening_rad + self.tilt_rad
        shift = variable_shift * self.opening_rad
        axis_error = carried.length * turn + carried.slide_length * shift
        slide_error = carried.slide_length * turn + carried.slide_change_bound * shift
        return axis_error, slide_error

    def turns_along_paths(self, variable_changes: Sequence[Expr]) -> list[Expr]:
        """Return a bound of the rotation of each link, given changes of the variables.

        Each variable on the path from the ground to a link turns the link by the length of
        the variable's vector times its change.
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
        """Return the rates of all variables for given offsets, while the inputs rest.

        `offsets` are vectors e (3,) by pair: the relative angular velocity of the links of
        a pair is that of its variables minus e. The sum of the offsets around a loop, times
        the inverse of the loop equations, gives the rates.
        """
        loop_offsets: list[Exprs] = []
        for signs in self.tree.signs:
            # The sense, 1 or -1, in which the loop passes each pair; 0 for other pairs.
            offset_sum = vector_sum(
                offset * signs[self.pair_variables[pair][0]]
                for pair, offset in offsets.items()
            )
            loop_offsets.append(offset_sum)
        return [dot(row.flat, np.ravel(loop_offsets)) for row in self.inverse]


def curvature_uncertainties(rows: RowExpressions) -> list[Expr]:
    """Return for each contact a number that exceeds 1 if its profiles nearly fit.

    The number is 2 `EQUAL_CURVATURE` / (k1 - k2), with the curvatures k1 and k2 of the two
    profiles. It is NaN if k2 exceeds k1, because the two profiles then overlap. Contacts of
    two circles are left out, because their curvatures do not change.
    """
    differences = (
        first.curvature - second.curvature for first, second in rows.pairs.sides.values()
    )
    # The product of two roots, not the difference itself, is NaN for negative differences.
    return [
        2.0 * EQUAL_CURVATURE / (root(difference) * root(difference))
        for difference in differences
        if isinstance(difference, ExpressionNode)
    ]
