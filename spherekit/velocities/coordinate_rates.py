"""Rates of all variables while each input moves in turn, in homogeneous form.

While input i moves at the rate 1 and the others rest, the rates of all variables are
tau_i / D. The scale D is the determinant of the equations. It vanishes at configurations in
which the inputs do not determine the rates of all variables.

With one input, the numbers tau are the minors of the velocity equations
(`spherekit.velocities.group_equations`). They are rates with respect to a parameter p.
They contain no division by D, so they stay finite at dead centres of any pair, where
rates per unit rate of the input do not. These are tau / D. (In groups other than dyads,
the rates of two variables that are eliminated from a loop are not finite if their axes
coincide.) Rates per unit of arc length of the curve of all variables are ``tau / |tau|``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot
from spherekit.symbolic.vector_algebra import Exprs, vector, vector_sum
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.pose_expressions import (
    LinkOrientation,
    place_by_variables,
    sum_along_paths,
)
from spherekit.velocities.velocity_equations import VelocityEquations, rotation_between


@dataclass(frozen=True)
class MotionRates:
    """Rates of a mechanism as expressions, for the present rates of all its inputs.

    Attributes
    ----------
    scaled_speeds
        The rate of each input, divided by the determinant D of the velocity equations.
        `CoordinateRates` has the rates tau of all variables times D, while one input moves
        at unit rate. So the rate of a variable is a sum over the inputs: its tau for this
        input, times the scaled speed of the input. Angular velocities are such sums, too.
    variable_rates
        The rate of each pair (joint) variable.
    w
        (3,) angular velocity of each link in ground axes.
    """

    scaled_speeds: list[Expr]
    variable_rates: list[Expr]
    w: list[Exprs]


class CoordinateRates(VelocityEquations):
    """Homogeneous rates (rates times a determinant) of variables and links for each input.

    While input i moves at the rate 1 and the others rest, the rates of all variables are
    tau_i / D. The homogeneous rates tau_i are regular even if the scale D, the determinant
    of the velocity equations, vanishes. Inputs are counted by their index in
    `KinematicStructure.input_pairs`.
    """

    def __init__(
        self,
        structure: KinematicStructure,
        variables: Sequence[Expr],
        placed: Sequence[LinkOrientation] = (),
    ) -> None:
        """Form symbolic expressions of the vectors of all pair (joint) variables.

        The vector of a variable is the relative angular velocity of the links of its pair
        per unit rate of the variable. In the velocity equation of a loop, these vectors
        times the rates of the variables add up to zero.

        Parameters
        ----------
        structure
            The mechanism with its inputs and its pairs.
        variables
            Expressions (rad) of all variables: angles of R pairs, and arc lengths along
            profiles, which locate contact points.
        placed
            Orientations of all links. By default they follow from the variables.
        """
        self.structure = structure
        mechanism = structure.mechanism
        placed = placed or place_by_variables(mechanism, structure.pairs, variables)
        # If two circles roll on each other, their relative rotation is the sum of two
        # rotations about their centres (`about_centres`). This sum takes fewer expressions
        # than the same rotation about the contact point.
        super().__init__(mechanism, structure.pairs, placed, variables, about_centres=True)

    def _solve_groups(
        self, driven_rates: Mapping[int, Expr], offsets: Mapping[int, Exprs] | None = None
    ) -> tuple[list[Expr], Expr]:
        """Return the rates of all variables times a scale, and this scale.

        The loops of the mechanism are closed group by group. A group is a set of links that
        are placed together. Cramer's rule for the equations of a group divides by a
        determinant, which may be zero. This division is left out, so the rates of the group
        are multiplied by the determinant. The scale is the product of all determinants.

        Parameters
        ----------
        driven_rates
            The rate of each driven pair (joint), by the index of the pair.
        offsets
            By the index of a pair, a vector (3,) that is subtracted from the angular
            velocity of the pair in the loop equations. For accelerations the offset is
            minus the part of the relative acceleration that depends on velocities only.
        """
        # Each driven pair has a single variable.
        rate_by_variable = {
            self.pair_variables[pair][0]: rate for pair, rate in driven_rates.items()
        }
        scale: Expr = 1.0
        for group in self.structure.groups:
            # `rate_by_variable` has the rates of the driven pairs and of earlier groups,
            # all multiplied by `scale`.
            known_velocities = self._known_velocities(
                rate_by_variable, offsets or {}, scale
            )
            group_rates, group_scale = group.solve_rates(self.vectors, known_velocities)
            # The rates of earlier groups are multiplied by the determinant of this group,
            # so that all rates have the same scale and nothing is divided.
            rate_by_variable = {
                v: rate * group_scale for v, rate in rate_by_variable.items()
            } | group_rates
            scale = scale * group_scale
        return [rate_by_variable[v] for v in range(len(self.vectors))], scale

    def _known_velocities(
        self,
        rate_by_variable: Mapping[int, Expr],
        offsets: Mapping[int, Exprs],
        scale: Expr,
    ) -> list[Exprs]:
        """Return the known part (3,) of the relative angular velocity of each pair (joint).

        Groups of links are solved one after another. The caller needs the known parts for
        the equations of the next group. The known part of a pair comes from the variables
        whose rates are already known. The rates of all other variables count as zero.

        A pair can have an offset. In the loop equations, the offset is subtracted from the
        angular velocity of the pair. So the offset is also subtracted from the known part.

        Parameters
        ----------
        rate_by_variable
            The known rates, by variable, multiplied by `scale`.
        offsets
            Offset vectors (3,) by the index of the pair, not multiplied by `scale`.
        scale
            The product of the determinants of the groups solved before. Rates and result
            are multiplied by it, so that nothing is divided by these determinants.
        """
        rates = [rate_by_variable.get(v, 0.0) for v in range(len(self.vectors))]
        velocities = self.pair_velocities(rates)
        for pair, offset in offsets.items():
            velocities[pair] = velocities[pair] - offset * scale
        return velocities

    @cached_property
    def _rates_and_scales(self) -> list[tuple[list[Expr], Expr]]:
        """For each input the homogeneous rates of all variables, and their scale."""
        return [
            self._solve_groups(self.structure.driven_rates(pair))
            for pair in self.structure.input_pairs
        ]

    @property
    def tau(self) -> list[list[Expr]]:
        """For each input the rates of all variables, times the scale D."""
        return [rates for rates, _ in self._rates_and_scales]

    @property
    def scale(self) -> Expr:
        """The scale D, the determinant of the velocity equations.

        Rates are homogeneous rates divided by D. D is the same for all inputs.
        """
        _, scale = self._rates_and_scales[-1]
        return scale

    @cached_property
    def w(self) -> list[list[Exprs]]:
        """For each input the angular velocities (3,) of all links, times the scale D."""
        return [sum_along_paths(self.tree, self.pair_velocities(tau)) for tau in self.tau]

    def closure_residual_rates(self, size: ExpressionNode) -> dict[int, Exprs]:
        """Return the derivative (3,) of the opening of each loop with respect to a size.

        Each loop is cut at one pair (joint), the key of the result. The frame of this pair
        is computed in two ways: from the first link of the pair and its variable, and from
        the second link. The two frames coincide in a closed loop. The opening (closure
        residual) is the rotation vector from the former frame to the latter.

        The size of the mechanism grows at the rate 1, while the variables of pairs stay
        constant. The derivative of the opening is the difference of the angular velocities
        of the two frames. From these derivatives the caller computes the rates of the
        variables that close the loops again.
        """
        residual_rates: dict[int, Exprs] = {}
        for pair, frames in self._closing_frames.items():
            velocity_by_second_link = _frame_velocity(frames.by_second_link, size)
            velocity_by_pair = _frame_velocity(frames.by_pair, size)
            residual_rates[pair] = velocity_by_second_link - velocity_by_pair
        return residual_rates

    def solve_loops(self, offsets: Mapping[int, Exprs]) -> list[Expr]:
        """Return the rates of all variables for given offsets, while the inputs rest.

        An offset is a known vector of a pair in the loop equations, see the base class.
        """
        rates, scale = self._solve_groups(self.structure.rates_at_rest, offsets)
        inverse_scale = 1.0 / scale
        return [rate * inverse_scale for rate in rates]

    def link_velocity(self, input_index: int, link: int) -> Exprs:
        """Return the homogeneous angular velocity of a link in axes fixed in the link.

        A homogeneous velocity is the velocity while one input has the rate 1 and the others
        rest, times the determinant of the velocity equations. The factor avoids divisions.

        The components are along the columns of `LinkOrientation.basis`, three unit vectors
        that are fixed in the link. Along the basis the expressions are shorter than along
        the axes of the link.

        Parameters
        ----------
        input_index
            The input that moves.
        link
            Index of the link.

        Returns
        -------
        (3,) components along the basis.
        """
        orientation = self.placed[link]
        homogeneous_rates = self.tau[input_index]  # the rates of all variables
        # The angular velocities along the path of pairs from the ground to the link add up.
        # The sense is 1 or -1, and 0 for a variable that is not on the path.
        parts: list[Exprs] = []
        for variable, sense in enumerate(self.tree.paths[link]):
            if not sense:
                continue
            components = self._components_along_basis(variable, link, orientation)
            parts.append(components * (float(sense) * homogeneous_rates[variable]))
        return vector_sum(parts)

    def _components_along_basis(
        self, variable: int, link: int, orientation: LinkOrientation
    ) -> Exprs:
        """Return the vector of a pair variable in components along the basis of a link.

        The vector is the relative angular velocity of the two links of the pair (joint),
        per unit rate of its variable. The basis consists of three unit vectors fixed in the
        link. If the vector too is fixed in the link, its components are constant.

        Parameters
        ----------
        variable
            Index of the variable.
        link
            Index of the link.
        orientation
            Orientation of the link, with its basis.

        Returns
        -------
        (3,) components.
        """
        # The vector in link axes, for each link in which it is fixed. For example, the axis
        # of an R pair is fixed in both links of the pair.
        vector_in_link_axes = self.structure.fixed_vectors(variable)
        if link in vector_in_link_axes:
            return orientation.fixed_components(vector_in_link_axes[link])
        vector_in_ground_axes = self.vectors[variable]
        return orientation.components(vector_in_ground_axes)

    def motion_rates(self, speeds: Sequence[Expr]) -> MotionRates:
        """Return the rates of all variables and links for some rates of the inputs.

        For each input, `tau` has the rates of all variables, and `w` the angular velocities
        of all links, while this input moves at unit rate. `tau` and `w` are multiplied by
        the determinant D of the velocity equations (`scale`). The rates of the inputs are
        therefore divided by D. The contributions of all inputs add up.
        """
        scaled_speeds = [speed * (1.0 / self.scale) for speed in speeds]
        # For each variable, the sum over the inputs of its rate times the scaled speed.
        variable_rates = [
            dot(rates_by_input, scaled_speeds)
            for rates_by_input in zip(*self.tau, strict=True)
        ]
        # For each link, the sum over the inputs of its vector (3,) times the scaled speed.
        angular_velocities = [
            dot(vectors_by_input, scaled_speeds)
            for vectors_by_input in zip(*self.w, strict=True)
        ]
        return MotionRates(
            scaled_speeds=scaled_speeds,
            variable_rates=variable_rates,
            w=angular_velocities,
        )

    def bias_accelerations(self, rates: Sequence[Expr], w: Sequence[Exprs]) -> list[Exprs]:
        """Return the angular accelerations (3,) of links while no input accelerates.

        These accelerations come from the velocities alone.

        Parameters
        ----------
        rates
            Rates of all variables.
        w
            (3,) angular velocities of all links in ground axes.
        """
        _, pair_accelerations = self.solve_accelerations(rates, w)
        return sum_along_paths(self.tree, pair_accelerations)


def _frame_velocity(frame: Exprs, size: ExpressionNode) -> Exprs:
    """Return the angular velocity (3,) of a frame per unit rate of a size, in ground axes.

    A size is an arc or an angle of the mechanism. The columns b of the frame (3, 3) have
    the derivatives b' = w x b with respect to the size. Half the sum of b x b' over the
    three columns is w.
    """
    entries = [*frame.ravel()]
    derivative = vector(differentiate(entries, {size: 1.0})).reshape(3, 3)
    return rotation_between(frame, derivative)
