"""The part of a mechanism's kinematics that does not depend on the configuration.

A `KinematicStructure` knows the inputs, the groups in solving order, the rotations of all
pairs, and how the loop equations of each group are solved.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, driven_at, plan_assembly
from spherekit.positions.loop_closure import Closure
from spherekit.positions.motion_cache import assembly_by_count_or_rank, position_analysis_of
from spherekit.symbolic.expression_graph import ADVICE_WITHOUT_EXPRESSIONS, Expr, dot
from spherekit.symbolic.vector_algebra import constants, cross
from spherekit.velocities.axis_rotations import (
    Entries,
    PairRotations,
    ProfileSide,
    pair_rotations,
)
from spherekit.velocities.carried_vectors import root
from spherekit.velocities.group_equations import GroupEquations

MIN_AXIS_SINE = 1e-9
"""Smallest sine of the angle between two axes of a link that count as different.

Larger: mechanisms with nearly coincident axes are refused. Smaller: the equations of such
axes are solved, with few correct digits.
"""

CLOSED_CONFIGURATION_SAMPLES = 9
"""Number of samples of the input among which a closed configuration is sought."""


@dataclass(frozen=True)
class KinematicStructure:
    """Inputs, groups and pair rotations of a mechanism.

    Groups are sets of links that are closed together, one group after another (dyads or
    larger ones). Inputs are driven pairs whose variables are free. Other driven pairs can
    follow the inputs through wheels. Pairs, variables and links are given by their
    indices in the mechanism.

    Attributes
    ----------
    mechanism
        The mechanism.
    assembly
        The driven pairs of the mechanism, and its groups in solving order.
    pairs
        The rotations of the pairs as expressions, in which sizes can be symbols.
    groups
        The solution of the velocity equations of each group.
    """

    mechanism: Mechanism
    assembly: Assembly
    pairs: PairRotations
    groups: tuple[GroupEquations, ...]

    @property
    def input_pairs(self) -> tuple[int, ...]:
        """The inputs: all driven pairs except pairs that follow inputs through wheels."""
        driven_pairs = self.assembly.inputs
        return tuple(pair for pair in driven_pairs if pair not in self.pairs.followers)

    @property
    def inputs(self) -> tuple[int, ...]:
        """Indices of the variables of the inputs."""
        return tuple(self.mechanism.variables_of(pair)[0] for pair in self.input_pairs)

    @property
    def rates_at_rest(self) -> dict[int, Expr]:
        """The rate of each driven pair while no input moves: all rates are zero."""
        return dict.fromkeys(self.assembly.inputs, 0.0)

    def driven_rates(self, input_pair: int) -> dict[int, Expr]:
        """Return the rate of each driven pair while one input moves at the rate 1."""
        index = self.input_pairs.index(input_pair)
        follower_rates = {pair: row[index] for pair, row in self.pairs.followers.items()}
        return self.rates_at_rest | {input_pair: 1.0} | follower_rates

    def follower_angles(self, q: Sequence[Expr]) -> dict[int, Expr]:
        """Return the angles, by variable, that follow from the angles q of the inputs."""
        # The last number of a follower is its angle at q = 0.
        return {
            self.mechanism.variables_of(pair)[0]: dot(row, [*q, 1.0])
            for pair, row in self.pairs.followers.items()
        }

    @staticmethod
    def from_mechanism(
        mechanism: Mechanism,
        input_pairs: str | Sequence[str],
        pairs: PairRotations | None = None,
        closed: Floats | None = None,
        by_rank: bool = False,
    ) -> "KinematicStructure":
        """Return the structure of a mechanism with given inputs.

        Parameters
        ----------
        mechanism
            The mechanism.
        input_pairs
            Names of the pairs that are inputs.
        pairs
            Rotations of the pairs, by default the rotations of the pairs of the mechanism.
            The rotations can contain symbols for sizes. `pairs.followers` are the pairs
            that follow the inputs through wheels.
        closed
            (variables,) a closed configuration (rad). If equations repeat each other,
            those that are independent at this configuration are chosen. By default a
            configuration is computed if necessary.
        by_rank
            Whether the rank of the velocity equations has shown that there is one degree of
            freedom for each input, although counting links and pairs gives fewer. By
            default the rank is examined if counting gives fewer.

        Raises
        ------
        EngineError
            If a profile is not a circle, if a group (set of links that are closed together)
            has too many equations for expressions, or if two axes of a link coincide whose
            variables are eliminated together.
        PlanError
            If the mechanism does not have a degree of freedom for each input.
        """
        # Pairs that follow the inputs through wheels are driven too.
        driven_names = [input_pairs] if isinstance(input_pairs, str) else [*input_pairs]
        pairs = pairs or pair_rotations(mechanism)
        driven_names += mechanism.names_of(pairs.followers)
        driven_mechanism = driven_at(mechanism, driven_names)
        if by_rank:
            assembly = plan_assembly(driven_mechanism, by_rank)
        else:
            assembly = assembly_by_count_or_rank(driven_mechanism)

        def compute_vectors() -> Floats:
            """Return the vectors of all variables at a closed configuration.

            The vector of a variable is the relative angular velocity of the links of its
            pair per unit rate. The result is (variables, 3) numbers in ground axes.
            """
            values = closed
            if values is None:
                values = _find_closed_configuration(mechanism, input_pairs)
            return _compute_vectors(mechanism, values)

        groups = tuple(
            GroupEquations(mechanism, assembly, group, compute_vectors)
            for group in assembly.groups
        )
        structure = KinematicStructure(mechanism, assembly, pairs, groups)
        structure._refuse_coincident_axes()
        return structure

    def has_independent_equations(self, values: Floats) -> bool:
        """Return whether the velocity equations that are solved determine the rates.

        If equations are redundant, independent ones were chosen at one configuration. In
        another assembly mode (way to assemble the mechanism) the chosen equations can
        depend on each other, and do not determine the rates there.

        Parameters
        ----------
        values
            (variables,) variables (rad) of a closed configuration that is not singular.
        """
        vectors = _compute_vectors(self.mechanism, values)
        return all(group.has_independent_equations(vectors) for group in self.groups)

    def _refuse_coincident_axes(self) -> None:
        """Raise `EngineError` if two private variables of a loop have the same axis.

        The velocity equation of a loop is a vector equation: a sum of axes times rates is
        zero. Two private variables (in no other loop) are eliminated by the component along
        the normal of both axes. If the axes coincide in a link, there is no normal, and the
        equations determine only the sum or the difference of the two rates.
        """
        for group in self.groups:
            for private_variables in group.private_variables:
                # A loop has two private variables or none.
                if not private_variables:
                    continue
                first, second = private_variables
                if self._have_coincident_axes(first, second):
                    names = self.mechanism.variable_names
                    raise EngineError(
                        f"{self.mechanism.name}: the axes of {names[first]} and "
                        f"{names[second]} coincide in a link, so these two cannot "
                        "be distinguished",
                        ADVICE_WITHOUT_EXPRESSIONS,
                    )

    def _have_coincident_axes(self, first_variable: int, second_variable: int) -> bool:
        """Return whether two variables turn about the same axis of a common link.

        Two variables with this property cannot be eliminated from the equations together.
        Axes can contain symbols for sizes of the mechanism. If their angle depends on
        symbols, the axes count as different.
        """
        first_axes = self.fixed_vectors(first_variable)
        second_axes = self.fixed_vectors(second_variable)
        common_links = first_axes.keys() & second_axes.keys()
        for link in common_links:
            normal = cross(constants(first_axes[link]), constants(second_axes[link]))
            sine = root(dot(normal, normal))
            if isinstance(sine, float) and sine < MIN_AXIS_SINE:
                return True
        return False

    def fixed_vectors(self, variable: int) -> dict[int, Entries]:
        """Return the vector (3,) of a variable in each link in which it is fixed.

        The vector of a variable is the relative angular velocity of the links of its pair
        (joint), per unit rate of the variable. In the axes of a link in which it is fixed,
        it is constant, which gives shorter expressions. There are three cases:

        - R pair (revolute joint): the vector is the axis, which is fixed in both links.
        - Sliding contact: there is one variable for each of the two profiles, the arc
          length to the contact point. Its vector is fixed in the link of the profile if the
          profile is a circle.
        - Rolling contact: there is one variable. Its vector is fixed in no link.

        Parameters
        ----------
        variable
            Index of the variable.

        Returns
        -------
        By the index of the link, the vector in the axes of this link. Empty if there is
        none.
        """
        pair = self.mechanism.variable_owners[variable]
        first_link, second_link = self.mechanism.ends[pair]
        # `sides` has the two profiles of each contact.
        is_r_pair = pair not in self.pairs.sides
        if is_r_pair:
            first_axis, second_axis = self.pairs.axes(pair)
            return {first_link: first_axis, second_link: second_axis}
        first_side, second_side = self.pairs.sides[pair]
        pair_variables = self.mechanism.variables_of(pair)
        is_rolling = len(pair_variables) == 1
        if is_rolling:
            return {}
        # The vector is the angular velocity of the second link relative to the first. If
        # the contact moves along a circle of the first link, the second link turns about
        # the centre of this circle. Along a circle of the second link, the first link turns
        # in this way. Relative to the first link, the second link then turns in the
        # opposite sense, so the sign is -1.
        if variable == pair_variables[0]:
            return _vector_about_circle(first_side, first_link, sign=1.0)
        return _vector_about_circle(second_side, second_link, sign=-1.0)


def _vector_about_circle(side: ProfileSide, link: int, sign: float) -> dict[int, Entries]:
    """Return the relative angular velocity as a sliding contact moves along a circle.

    Each of the two profiles of a contact has a variable: the arc length to the contact
    point. Here only the variable of one profile changes, and this profile is a circle. So
    the contact moves along the circle, and stays at the same point of the other link. Seen
    from the link with the circle, the other link turns about the centre of the circle. The
    result is the angular velocity of the second link relative to the first, per unit of arc
    length. It is constant in the axes of the link with the circle.

    Parameters
    ----------
    side
        The profile whose variable changes.
    link
        Index of the link of the profile.
    sign
        1.0 for the profile of the first link: the second link turns. -1.0 for the
        profile of the second link: the first link turns, so the vector has the opposite
        sign.

    Returns
    -------
    The angular velocity (3,) in the axes of this link, by the index of the link. The
    mapping is empty for a profile that is not a circle. Its vector is not constant in the
    link, so `fixed_vectors` then returns no vector.
    """
    circle = side.circle
    if circle is None:
        return {}
    return {link: circle.axis * (sign * circle.angle_per_length)}


def _compute_vectors(mechanism: Mechanism, values: Floats) -> Floats:
    """Return the vectors (variables, 3) of all variables, in ground axes.

    The vector of a variable is the relative angular velocity of the two links of its pair,
    per unit rate. `values` are the variables (variables,) in rad of a configuration.
    """
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    return closure.linearise(values[None]).vectors[0]


def _find_closed_configuration(
    mechanism: Mechanism, input_pairs: str | Sequence[str]
) -> Floats:
    """Return the variables (rad) of a closed configuration within the input range.

    If velocity equations are redundant, the caller chooses independent ones at this
    configuration. A few evenly spaced inputs are tried in all assembly modes (ways to
    assemble the mechanism).

    Raises
    ------
    EngineError
        If the mechanism closes at none of these inputs.
    """
    position_analysis = position_analysis_of(driven_at(mechanism, input_pairs))
    # All modes at some evenly spaced inputs.
    motion = position_analysis.sparse(CLOSED_CONFIGURATION_SAMPLES)
    if all(motion.failed):
        raise EngineError(
            f"{mechanism.name}: no configuration was found at which to choose independent "
            "equations; give a range of the input in which the mechanism closes"
        )
    first_closed_row = int(motion.failed.argmin())
    return motion.values[first_closed_row]
