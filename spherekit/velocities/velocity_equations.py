"""Velocity and acceleration equations of the loops, as symbolic expressions.

A tree of pairs reaches all links. Each of the other pairs closes a loop. The vector a_v of
a variable v is the angular velocity of the second link of its pair relative to the first,
per unit rate of the variable. With the sum over the variables v of a pair,

    w_second - w_first = sum of a_v x_v - e.

The rates x_v of the passive variables are solved from these equations such that w is the
same on every path to a link. The vectors e of pairs are right-hand sides, here called
offsets:

- With the closure residuals of a configuration that is nearly closed, x is the step of
  Newton's method that closes it.
- With the derivatives of the residuals with respect to a size of the mechanism, x is
  the derivative of the variables with respect to this size.
- With the velocity-dependent part of relative accelerations (with a minus sign), x are the
  accelerations of the variables.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.loop_tree import LoopTree
from spherekit.symbolic.expression_graph import Expr, dot
from spherekit.symbolic.vector_algebra import Exprs, cross, vector_sum
from spherekit.velocities.axis_rotations import PairRotations
from spherekit.velocities.carried_vectors import carried_vectors
from spherekit.velocities.pose_expressions import LinkOrientation, place_link


@dataclass(frozen=True)
class ClosingFrames:
    """The frame of a pair that closes a loop, computed along both sides of the loop.

    The difference of both results shows by how much the loop is open.

    Attributes
    ----------
    by_second_link
        (3, 3) frame that is fixed in the second link of the pair, in ground axes.
    by_pair
        (3, 3) frame that is fixed in the first link of the pair and then moved by the
        variables of the pair, in ground axes. Both frames are equal if the loop is closed.
    """

    by_second_link: Exprs
    by_pair: Exprs


def rotation_between(frame: Exprs, other_columns: Exprs) -> Exprs:
    """Return half the sum of b x c (3,) over the columns b, c of two matrices (3, 3).

    If the second matrix is a frame that nearly coincides with the first, the result is the
    rotation vector between them to first order. If the second matrix is the derivative of
    the first frame, the result is the angular velocity of the frame.
    """
    return vector_sum(map(cross, frame.T, other_columns.T)) * 0.5


class VelocityEquations(ABC):
    """Velocities and accelerations of a mechanism at given orientations of its links.

    Attributes
    ----------
    mechanism, pairs
        The mechanism, and the rotations of its pairs.
    placed
        Orientations of all links.
    variables
        Expressions (rad) of all variables, on which contacts depend.
    tree
        The loops.
    carried
        The vector of each variable with the link with which it turns.
    contact_lines
        By pair, the line from the centre of the sphere to the contact point of each rolling
        contact. Contacts are left out if their vector is the sum of two vectors along the
        axes of their circles (`about_centres`).
    vectors
        (3,) vector a_v of each variable in ground axes.
    pair_variables
        The indices of the variables of each pair.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        pairs: PairRotations,
        placed: Sequence[LinkOrientation],
        variables: Sequence[Expr],
        about_centres: bool,
    ) -> None:
        """Write the vectors of all pair (joint) variables as expressions in ground axes.

        The vector of a variable is the angular velocity of the second link of its pair
        relative to the first, per unit rate of the variable.

        Parameters
        ----------
        mechanism, pairs
            The mechanism, and the rotations of its pairs as expressions.
        placed
            Orientations of all links as expressions.
        variables
            Expressions (rad) of all pair variables. The points of contact depend on them.
        about_centres
            How the vector is computed if two circles roll on each other. True: as the sum
            of two vectors along the axes of the circles. The sum takes fewer expressions,
            but loses digits if the circles are small. False: as a multiple of the direction
            to the contact point.
        """
        self.mechanism = mechanism
        self.pairs = pairs
        self.placed = placed
        self.variables = variables
        self.tree = LoopTree.of_mechanism(mechanism)
        # For each variable, `carried` has the vector and a link with which the vector
        # turns. As seen from this link, the vector of an R pair is fixed. The vector of a
        # contact can change, so its derivative with respect to the variable is stored.
        #
        # `contact_lines` has the direction from the centre of the sphere to the contact
        # point of each rolling contact, by the number of the pair. Both links turn relative
        # to each other about this line. Contacts whose vector is the sum of two vectors
        # along the axes of circles are left out.
        self.carried, self.contact_lines = carried_vectors(
            mechanism, pairs, placed, variables, about_centres
        )
        self.vectors = [carried.vector for carried in self.carried]
        self.pair_variables = [
            mechanism.variables_of(pair) for pair in range(len(self.tree.ends))
        ]

    @abstractmethod
    def solve_loops(self, offsets: Mapping[int, Exprs]) -> list[Expr]:
        """Return the rates of all variables for given offsets, while the inputs rest.

        Around each loop, the angular velocities of the pairs add up to zero. The angular
        velocity of a pair is the sum of its vectors times their rates, minus the offset of
        the pair. An offset is thus a known part of the equations. It can stand for a known
        velocity or acceleration, or for the small rotation by which a loop is open.

        Parameters
        ----------
        offsets
            (3,) by the index of the pair, the offset in ground axes. Other pairs have no
            offset.
        """

    @cached_property
    def _closing_frames(self) -> dict[int, ClosingFrames]:
        """The frames of the pairs that close loops, by pair."""
        frames: dict[int, ClosingFrames] = {}
        for pair in self.tree.chords:
            first, second = self.tree.ends[pair]
            chain = self.pairs.chains[pair]
            by_pair = place_link(chain, self.placed[first], self.variables)
            frames[pair] = ClosingFrames(
                by_second_link=self.placed[second].direction(chain.constants[-1].T),
                by_pair=by_pair.basis,
            )
        return frames

    @property
    def closure_residuals(self) -> dict[int, Exprs]:
        """(3,) rotation vector (rad, to first order) by which each loop is open.

        A loop is closed by a pair, whose frame is reached along both sides of the loop: in
        its second link, and from its first link by the rotation of the pair. The dictionary
        has by this pair the rotation between both frames, which is zero if the loop is
        closed.
        """
        return {
            pair: rotation_between(frames.by_pair, frames.by_second_link)
            for pair, frames in self._closing_frames.items()
        }

    @property
    def closure_residual_square(self) -> Expr:
        """Sum of the squares of the angles by which loops are open, rad2.

        An angle x counts as 2 sin(x / 2). Half a turn counts as 2, while its
        `closure_residuals` are zero.
        """
        differences = (
            (frames.by_second_link - frames.by_pair).ravel()
            for frames in self._closing_frames.values()
        )
        return 0.5 * sum((dot(entries, entries) for entries in differences), 0.0)

    def pair_velocities(self, rates: Sequence[Expr]) -> list[Exprs]:
        """Return the relative angular velocity (3,) of each pair at rates of variables."""
        return [
            vector_sum([self.vectors[v] * rates[v] for v in variables])
            for variables in self.pair_variables
        ]

    def solve_accelerations(
        self, rates: Sequence[Expr], w: Sequence[Exprs]
    ) -> tuple[list[Expr], list[Exprs]]:
        """Return the accelerations of variables and pairs (joints) at constant input rates.

        The relative angular velocity of a pair is the sum of a_v x_v over its variables v,
        with their vectors a_v and rates x_v. Its time derivative has two parts. The first
        is the sum of a_v dx_v, with the unknown accelerations dx_v. The second, the bias,
        is the sum of da_v x_v and follows from velocities alone.

        Parameters
        ----------
        rates
            Rates of all variables.
        w
            (3,) angular velocities of all links in ground axes.

        Returns
        -------
        variable_accelerations
            Second derivatives of the variables.
        pair_accelerations
            (3,) derivative of the relative angular velocity of each pair.
        """
        # da_v x_v of each variable. The vector a_v turns with its link. At a contact it
        # also changes relative to the link, in proportion to the rate of the variable.
        vector_derivatives = [
            carried.derivative(w[carried.link], rate) * rate
            for carried, rate in zip(self.carried, rates, strict=True)
        ]
        # The bias of each pair, the part that depends on velocities only.
        bias = [
            vector_sum(vector_derivatives[v] for v in variables)
            for variables in self.pair_variables
        ]
        # Around each loop, the accelerations of the pairs add up to zero, so the sum of a_v
        # dx_v is minus the sum of the bias.
        variable_accelerations = self.solve_loops(
            {pair: part * -1.0 for pair, part in enumerate(bias)}
        )
        # `pair_velocities` forms the sum of a_v x_v of each pair. With dx_v in place of
        # x_v, this is the first part.
        first_parts = self.pair_velocities(variable_accelerations)
        pair_accelerations = [
            first_part + bias_part
            for first_part, bias_part in zip(first_parts, bias, strict=True)
        ]
        return variable_accelerations, pair_accelerations
