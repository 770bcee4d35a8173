"""The quantities that an interactive page computes, by their names.

The names are formed by `spherekit.velocities.row_quantities.row_quantities`.
"""

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import combinations, permutations
from typing import NamedTuple

from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Plan
from spherekit.velocities.row_quantities import middle_pairs, row_quantities

COORDINATE_NAMES = "xyz"
"""Names of the components of vectors."""


class OutputPath(NamedTuple):
    """The path of a direction of an output on the sphere, which the page draws.

    Attributes
    ----------
    vector
        Name of the direction, to which "_x", "_y" and "_z" are added for its components.
    link
        Name of the link on which the direction is fixed.
    """

    vector: str
    link: str


class ReversiblePole(NamedTuple):
    """A pole axis for which the page chooses one of two opposite directions.

    A pole axis is the axis about which one link rotates relative to another link. If the
    direction is reversed, the quantities along the axis change their signs.

    Attributes
    ----------
    link, reference
        Name of the link, and of the other link relative to which it moves.
    input_suffix
        End of the names of the quantities of the pole, which says which input moves. For
        example, this end is "_by_21" in ``velocity_coefficient_4_1_by_21``, for the input
        at the pair 21. The end is empty if the mechanism has one input.
    """

    link: str
    reference: str
    input_suffix: str

    @property
    def signed_quantities(self) -> list[str]:
        """Names of the quantities that change their signs if the axis is reversed."""
        links = f"{self.link}_{self.reference}"
        return [
            f"velocity_coefficient_{links}{self.input_suffix}",
            f"acceleration_coefficient_{links}{self.input_suffix}",
            *(f"pole_{links}_{x}{self.input_suffix}" for x in COORDINATE_NAMES),
        ]


class PageQuantities:
    """Names of the quantities that an interactive page computes or shows.

    Parameters
    ----------
    mechanism
        The mechanism, driven at its inputs.
    inputs
        Names of the driven pairs.

    Attributes
    ----------
    unit_by_name
        Units of all quantities of the mechanism, by name.
    input_suffixes
        For each input the end of the names of quantities while this input moves and the
        others rest, such as "_by_21" for the input at the pair 21. Empty for the only
        input.
    """

    def __init__(self, mechanism: Mechanism, inputs: Sequence[str]) -> None:
        """List all quantities of the mechanism."""
        self._mechanism = mechanism
        self._inputs = inputs
        self.unit_by_name = row_quantities(mechanism)
        self.input_suffixes = [""]
        if len(inputs) > 1:
            self.input_suffixes = [f"_by_{pair}" for pair in inputs]

    def output_coefficients(self, suffix: str) -> list[str]:
        """Return the names of the velocity coefficients of the outputs for one input.

        A velocity coefficient is the relative angular velocity of two links per unit rate
        of the input. The other inputs are locked. Without declared outputs, the motion of
        the last link relative to the ground is the output.

        Parameters
        ----------
        suffix
            The end of the names that says which input moves, such as ``_by_21``. Empty if
            there is only one input.
        """
        mechanism = self._mechanism
        links = [(output.link, output.relative_to) for output in mechanism.outputs]
        if not links:
            links = [(mechanism.links[-1], mechanism.ground)]
        return [
            f"velocity_coefficient_{link}_{reference}{suffix}" for link, reference in links
        ]

    def default_names(self, with_torques: bool) -> list[str]:
        """Return the quantities that are shown by default."""
        names: list[str] = []
        for suffix in self.input_suffixes:
            names += self.output_coefficients(suffix)
        names += [f"transmission_angle_{pair}" for pair in middle_pairs(self._mechanism)]
        if with_torques and self._mechanism.masses:
            names += [f"torque{suffix}" for suffix in self.input_suffixes]
        return names

    @cached_property
    def output_paths(self) -> list[OutputPath]:
        """The paths on the sphere that the page draws for the outputs.

        An output is the motion of a link relative to a reference link. An output may
        declare a direction, which is a unit vector fixed on the link.

        - If the output declares a direction and the reference is the ground, the path of
          the direction is drawn. With another reference, the page does not have the ground
          components of the direction, which a drawing needs.
        - Otherwise the paths of the axes of all pairs (joints) of the link show its motion.
          Axes of pairs at the ground do not move and are left out.

        A path has the name of its vector and the link on which the vector is fixed.
        """
        mechanism = self._mechanism
        paths: list[OutputPath] = []
        for output in mechanism.outputs:
            if output.direction is not None and output.relative_to == mechanism.ground:
                paths.append(OutputPath(f"direction_{output.name}", output.link))
                continue
            for pair in mechanism.pairs:
                # Contact pairs have no axis.
                has_moving_axis = pair.kind.has_axis and mechanism.ground not in pair.links
                if has_moving_axis and output.link in pair.links:
                    paths.append(OutputPath(f"axis_{pair.name}", output.link))
        return paths

    @property
    def output_determinant(self) -> str:
        """Name of the Jacobian determinant of the first output that has one, or empty.

        The determinant is zero if the output can stop while inputs move.
        """
        for output in self._mechanism.outputs:
            name = f"jacobian_determinant_{output.name}"
            if name in self.unit_by_name:
                return name
        return ""

    @cached_property
    def _reversible_poles(self) -> list[ReversiblePole]:
        """The poles whose sense along the axis the page chooses, for each input that moves.

        A pole is the axis of the relative rotation of two links. Link a relative to b, and
        b relative to a, are two poles, because their quantities have different names. The
        suffix at the end of these names says which input moves.
        """
        reversible_poles: list[ReversiblePole] = []
        for link, reference in permutations(self._mechanism.links, 2):
            if not self._has_pair_axis(link, reference):
                for suffix in self.input_suffixes:
                    reversible_poles.append(ReversiblePole(link, reference, suffix))
        return reversible_poles

    def _has_pair_axis(self, link: str, reference: str) -> bool:
        """Return whether the axis of relative rotation of two links is the axis of a joint.

        The mechanism file states the sense of such an axis, so the page does not choose it.
        """
        return any(
            pair.kind.has_axis and {*pair.links} == {link, reference}
            for pair in self._mechanism.pairs
        )

    def signed_quantities(self, names: Iterable[str]) -> dict[ReversiblePole, list[str]]:
        """Return the quantities that change their signs with the direction of a pole axis.

        A pole axis (axis of relative rotation of two links) has two opposite directions.
        The script of the page chooses the one that is continuous from sample to sample. If
        it reverses a direction, it multiplies the quantities returned here by -1.

        Parameters
        ----------
        names
            Names of the quantities that the page computes. Other quantities are left out,
            and so are poles without quantities.
        """
        computed_names = [*names]
        names_by_pole: dict[ReversiblePole, list[str]] = {}
        for pole in self._reversible_poles:
            signed_names = [
                name for name in pole.signed_quantities if name in computed_names
            ]
            if signed_names:
                names_by_pole[pole] = signed_names
        return names_by_pole

    def sign_velocities(self, names: Iterable[str]) -> list[str]:
        """Return the names of the angular velocities that decide directions of pole axes.

        A pole axis is the axis about which a link rotates relative to a reference link. Of
        its two opposite directions the page chooses one, so that the direction is
        continuous from sample to sample. This choice depends on the relative angular
        velocity, the difference of the angular velocities of the two links.

        Parameters
        ----------
        names
            Quantities that the page computes.

        Returns
        -------
        Names of the x, y and z components. With several inputs, each name ends with the
        input that moves while the others rest (`input_suffix`).
        """
        components: list[str] = []
        for pole in self.signed_quantities(names):
            for link in (pole.link, pole.reference):
                # The ground is at rest.
                if link != self._mechanism.ground:
                    components += [
                        f"angular_velocity_{link}_{x}{pole.input_suffix}"
                        for x in COORDINATE_NAMES
                    ]
        return components

    def needed_names(self, wound_pairs: Sequence[str]) -> list[str]:
        """Return the quantities that the page needs at every sample, shown or not.

        Parameters
        ----------
        wound_pairs
            Passive (not driven) pairs (joints) of which the page counts whole turns, since
            loads such as springs depend on them.
        """
        names: list[str] = []
        # Velocity coefficients of the outputs while one input moves, for each input. The
        # names end with a suffix for this input. The page marks the inputs at which a
        # coefficient is zero, so that an output is at rest.
        for suffix in self.input_suffixes:
            names += self.output_coefficients(suffix)
        # Components of the vectors whose paths are drawn.
        names += [
            f"{path.vector}_{x}" for path in self.output_paths for x in COORDINATE_NAMES
        ]
        # Determinants that are zero at singularities.
        names += [
            name
            for name in ("determinant", self.output_determinant)
            if name in self.unit_by_name
        ]
        # Variables of pairs with joint limits, and of pairs whose turns are counted.
        # Variables of driven pairs are the inputs, which the page has anyway.
        names += [
            f"theta_{joint_limit.pair}"
            for joint_limit in self._mechanism.joint_limits
            if joint_limit.pair not in self._inputs
        ]
        names += [f"theta_{pair}" for pair in wound_pairs]
        return names

    def drawn_names(self, pole_plans: Sequence[Plan]) -> list[str]:
        """Return the names of the quantities with which the page draws the mechanism.

        The page draws one configuration, the one at its cursor. The quantities are axes of
        pairs (joints), orientations of links, and pole axes. Links that cannot move
        relative to each other form one body, which is named after its first link. A pole is
        the axis of the relative rotation of two bodies.

        Parameters
        ----------
        pole_plans
            For each input: the construction of the poles while only this input moves, with
            the links of each body.
        """
        mechanism = self._mechanism
        links = mechanism.links
        names = [
            f"axis_{pair.name}_{x}"
            for pair in mechanism.pairs
            if pair.kind.has_axis
            for x in COORDINATE_NAMES
        ]
        names += [
            f"orientation_{link}_{x}{y}"
            for link in links
            if link != mechanism.ground
            for x in COORDINATE_NAMES
            for y in COORDINATE_NAMES
        ]
        for suffix, pole_plan in zip(self.input_suffixes, pole_plans, strict=True):
            for i, j in combinations(pole_plan.bodies, 2):
                names += [
                    f"pole_{links[j]}_{links[i]}_{x}{suffix}" for x in COORDINATE_NAMES
                ]
        return names
