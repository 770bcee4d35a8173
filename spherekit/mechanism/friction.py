"""Friction of bearings and of sliding contacts, which follows from reactions."""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.mechanism.joint import Numbers
from spherekit.mechanism.load import (
    BearingFriction,
    LoadComponent,
    LoadComponents,
    LoadedMechanism,
    check_not_negative,
    format_number,
    make_component,
)
from spherekit.mechanism.load_expression import parse

AXIAL_SUM_TOLERANCE = 1e-9
"""Deviation from 1 of the sum of the axial shares of bearings that is accepted.

Larger: wrong shares are accepted. Smaller: shares such as thirds need more digits.
"""


@checked_class(ModelError)
@dataclass(frozen=True)
class Bearings(BearingFriction):
    """The bearings of an R pair, with Coulomb friction that follows from its reaction.

    The friction torque is -(coefficient radius F tanh(v' / speed)) at the rate v' of the
    pair. F is the sum of the absolute forces on the bearings. These forces exert the moment
    about the centre of the sphere that the pair transmits. If `axial` is stated, the
    bearings also exert the axial force and, if there are two, the radial force.

    Attributes
    ----------
    name
        Name of the load.
    pair
        Name of the R pair.
    positions
        Distances of one or two bearings from the centre of the sphere, along the axis (m).
        The moment needs two opposite forces. Two bearings exert both of them. With a single
        bearing, the second force acts at the centre, and is not part of F.
    radius
        Radius at which the friction acts (m).
    coefficient
        Coefficient of friction.
    speed
        Rate (rad/s) below which the jump of Coulomb's law is smoothed.
    axial
        Share of the axial force that each bearing supports: 1 for a fixed bearing, 0 for a
        floating one. The shares add up to 1. If all are 0, the links can slide along the
        axis. None: not stated.
    """

    kind = "bearings"
    field_kinds = MappingProxyType(
        {
            "pair": "pair",
            "positions": "numbers",
            "axial": "numbers",
            "radius": "m",
            "coefficient": "",
            "speed": "rate",
        }
    )

    name: str
    pair: str
    positions: Numbers
    radius: float = 0.0
    coefficient: float = 0.0
    speed: float = 1e-3
    axial: Numbers | None = None

    @property
    def floats(self) -> bool:
        """Whether the links can slide along the axis, so that it transmits no force."""
        return self.axial is not None and not any(self.axial)

    @property
    def friction_coefficient(self) -> float:
        """The friction (N m) divided by the sum of the forces (N) on the bearings."""
        return self.coefficient * self.radius

    @property
    def needs_forces(self) -> bool:
        """Whether the friction depends on the force through the sphere's centre."""
        return self.axial is not None

    def supported_loads(self, moments: Floats, forces: Floats | None = None) -> Floats:
        """Return the forces on the bearings, whose magnitudes determine the friction.

        A pair (hinge) has one or two bearings along its axis, at the distances `positions`
        from the centre of the sphere. Two bearings exert the moment and the force that the
        pair transmits. A single bearing exerts the moment by a force across the axis, at
        its distance from the centre. The rest of the force across the axis then acts at the
        centre, and is not in the result. Without `forces`, the force is taken to be zero.

        Parameters
        ----------
        moments
            (..., 3) moment about the centre (N m) that the pair transmits, in pair axes.
        forces
            (..., 3) force through the centre (N) that the pair transmits, in pair axes.

        Returns
        -------
        (..., bearings, 3) forces (N) in pair axes, with z along the axis of the pair. With
        `forces`, the z component is the part of the axial force that the bearing supports.
        This component is NaN if the shares `axial` are not stated.
        """
        # A force P at the distance h along z has the moment (-h P_y, h P_x, 0). The vector
        # (M_y, -M_x, 0) is therefore the sum of h P over all bearings.
        force_times_distance = moments[..., [1, 0, 2]] * [1.0, -1.0, 0.0]
        first, *others = self.positions
        # The part of the force across the axis.
        if forces is None:
            radial_force = 0.0 * force_times_distance
        else:
            radial_force = forces * [1.0, 1.0, 0.0]
        # With two bearings, the sum of P and the sum of h P are two equations for both
        # forces. A single bearing supports the moment only, and the centre of the sphere
        # supports the rest of the force.
        if others:
            (second,) = others
            span = second - first
            loads = [
                (second * radial_force - force_times_distance) / span,
                (force_times_distance - first * radial_force) / span,
            ]
        else:
            loads = [force_times_distance / first]
        # Along the axis each bearing supports its share (0 to 1).
        if forces is not None:
            shares = self.axial or (np.nan,) * len(loads)
            for load, share in zip(loads, shares, strict=True):
                if share == 0.0:
                    # Exactly 0, even if the force is infinite or NaN.
                    load[..., 2] = 0.0
                else:
                    load[..., 2] = share * forces[..., 2]
        return np.stack(loads, axis=-2)

    def check(self, key: str, mechanism: LoadedMechanism) -> None:
        """Check that the forces on the bearings can be computed from these fields.

        This load describes all bearings of one pair (hinge). They support a couple by two
        opposite forces at different positions on the axis. A single bearing must therefore
        not be at the centre of the sphere, where the second force then acts. Two bearings
        must not be at the same position.

        An axial share is the part of the axial force that a bearing supports. The shares
        add up to 1. If the pair transmits no axial force, all shares are 0.

        Parameters
        ----------
        key
            The key of the load in the mechanism file, for messages.
        mechanism
            The mechanism.

        Raises
        ------
        ModelError
            If the positions do not allow a couple, if the axial shares have another sum, or
            if another load has bearings of the same pair.
        """
        super().check(key, mechanism)
        # A pair has one or two bearings, which support a couple by opposite forces. With a
        # single bearing, the second force acts at the centre of the sphere. So the bearing
        # must not be at the centre. Two bearings must not be at the same position.
        if len(self.positions) == 1:
            has_lever = self.positions[0] != 0.0
        elif len(self.positions) == 2:
            has_lever = self.positions[0] != self.positions[1]
        else:
            has_lever = False
        if not has_lever:
            raise ModelError(
                f"{key}.positions: found {list(self.positions)} m, expected one position "
                "that is not 0, or two different ones; positions are distances of the "
                "bearings from the centre along the axis"
            )
        axial = (0.0,) * len(self.positions) if self.axial is None else self.axial
        for share in axial:
            check_not_negative(f"{key}.axial", share, "")
        has_wrong_sum = any(axial) and abs(sum(axial) - 1.0) >= AXIAL_SUM_TOLERANCE
        if has_wrong_sum or len(axial) != len(self.positions):
            raise ModelError(
                f"{key}.axial: found {list(axial)}, expected the share of the axial force "
                f"of each bearing, {len(self.positions)} in all as in positions; the "
                "shares add up to 1 (a fixed bearing takes 1, a floating one 0). If the "
                "pair lets its links slide along its axis, give 0 for each"
            )
        # The forces on bearings follow from the reaction only if all bearings of the pair
        # are in one load.
        for load in mechanism.loads:
            if isinstance(load, Bearings) and load.pair == self.pair and load != self:
                raise ModelError(
                    f"{key}.pair: loads.{load.name} already has the bearings of pair "
                    f"{self.pair}; give all positions in one of the two loads"
                )

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return the friction as one load component, without its unknown forces.

        A load component is an expression, called its magnitude, and the pair at which it
        acts. The friction moment (N m) is -tanh(v / speed) times the coefficient, the
        radius and the sum of the forces on the bearings. Here v is the rate of the pair,
        and below `speed` the jump of Coulomb's law is smoothed. The forces are known only
        after the reactions have been computed, so the magnitude here is the factor
        -tanh(v / speed). The solution of the reactions multiplies it by the coefficient,
        the radius and the forces. If the coefficient or the radius is 0, the magnitude is
        0.
        """
        magnitude = f"-tanh(dtheta_{self.pair}/{format_number(self.speed)})"
        if not self.friction_coefficient > 0.0:
            magnitude = "0"
        return (make_component(mechanism, magnitude, self.pair, bearing_friction=self),)


@checked_class(ModelError)
@dataclass(frozen=True)
class ContactFriction(BearingFriction):
    """Coulomb friction of a sliding contact, which follows from its normal force.

    A normal force N at the distance r from the centre of the sphere has the moment r N (N
    m), called the push. Forces are stated by such moments. The moment of the friction force
    is the coefficient times the push. The friction acts against the rate v (rad/s) at which
    the second link slides along the first. The factor tanh(v / speed) smooths the jump of
    the friction at v = 0.

    Attributes
    ----------
    name
        Name of the load.
    pair
        Name of the sliding contact.
    coefficient
        Coefficient of friction.
    speed
        Rate (rad/s) below which the jump of Coulomb's law is smoothed.
    """

    kind = "contact_friction"
    field_kinds = MappingProxyType({"pair": "contact", "coefficient": "", "speed": "rate"})

    name: str
    pair: str
    coefficient: float
    speed: float = 1e-3

    @property
    def friction_coefficient(self) -> float:
        """The friction (N m) divided by the push (N m), as `BearingFriction` requires."""
        return self.coefficient

    def supported_loads(self, moments: Floats, forces: Floats | None = None) -> Floats:
        """Return the moment (N m) of the contact's normal force about the sphere's centre.

        The friction of the contact follows from this moment, the *push*. The pair axes x,
        y, z are the tangent, the normal and the direction to the contact point. A force
        along y at a point on z has a moment about x. The push is therefore the x component
        of the moment that the contact transmits.

        Parameters
        ----------
        moments
            (..., 3) moment about the centre (N m) that the contact transmits, in pair axes.
        forces
            Not used: the push follows from the moment only.

        Returns
        -------
        (..., 1, 3) push (N m) as a vector in pair axes. The array axis of length 1 counts
        the places where friction acts: a contact has one, a hinge one for each bearing.
        """
        push = moments * [1.0, 0.0, 0.0]
        return push[..., None, :]

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return the friction as one load component, without its unknown normal force.

        A load component is an expression, called its magnitude, and the pair at which it
        acts. The friction moment (N m) is -tanh(v / speed) times the coefficient times the
        push. Here v is the sliding rate, and below `speed` the jump of Coulomb's law is
        smoothed. The push is the moment of the normal force about the centre. It is known
        only after the reactions have been computed, so the magnitude here is the factor
        -tanh(v / speed). The solution of the reactions multiplies it by the coefficient and
        the push. If the coefficient is 0, the magnitude is 0.
        """
        if not self.friction_coefficient > 0.0:
            return (LoadComponent(parse("0", [])),)
        rate = sliding_rate_name(self.pair)
        magnitude = parse(f"-tanh({rate}/{format_number(self.speed)})", [rate])
        return (LoadComponent(magnitude, self.pair, bearing_friction=self),)


def sliding_rate_name(pair: str) -> str:
    """Return the name of the rate at which a contact slides.

    The name is used in the expression of the magnitude of a load. It stands for the rate
    (rad/s) at which the second link slides along the first.
    """
    return f"sliding_{pair}"


def check_no_reaction_friction(
    mechanism: LoadedMechanism, caller: str, alternative: str = ""
) -> None:
    """Refuse a mechanism with friction that depends on reactions (forces in pairs).

    Callers cannot compute such friction, because they do not solve for reactions.

    Parameters
    ----------
    mechanism
        The mechanism.
    caller
        What cannot compute the friction, such as "a page". The message is then "its
        friction depends on the reaction of pair 41, which a page does not compute. Set
        ...".
    alternative
        Another way to the result, which the message names first, if there is one.

    Raises
    ------
    ModelError
        If there is such friction.
    """
    for load in mechanism.loads:
        if isinstance(load, BearingFriction) and load.friction_coefficient > 0.0:
            advice = f"{alternative}; or set" if alternative else "Set"
            raise ModelError(
                f"{mechanism.name}: loads.{load.name}: its friction depends on the "
                f"reaction of pair {load.pair}, which {caller} does not compute. {advice} "
                "the coefficient of this load to 0; or, at an R pair, replace this load by "
                'one of kind "friction", whose constant torque you can estimate with the '
                "analysis reactions"
            )
