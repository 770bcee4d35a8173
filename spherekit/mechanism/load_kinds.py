"""The kinds of loads that act on pairs and links, and joint limits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.mechanism.elements import as_vector
from spherekit.mechanism.friction import Bearings, ContactFriction
from spherekit.mechanism.inertia import Tensor
from spherekit.mechanism.load import (
    Axes,
    LinkMoment,
    Load,
    LoadComponent,
    LoadComponents,
    LoadedMechanism,
    TorqueCallback,
    TorqueFunction,
    TorqueTable,
    check_angle_pair,
    make_component,
)
from spherekit.mechanism.sizes import Vector, check_finite
from spherekit.tolerances import EPS
from spherekit.wording import listing

JOINT_LIMIT_ROUNDING = 8.0 * EPS
"""Rounding error of an angle at a joint limit, relative to the limit (or to pi if larger).

A start that exceeds a joint limit by less is at the limit. Larger: such starts may be
outside. Smaller: starts at a limit are refused because of rounding.
"""

Expressions = tuple[str, str, str]
"""Expressions of the three components of a vector."""


def as_tensor(rows: Floats) -> Tensor:
    """Return a tensor (3, 3) as a tuple of three rows."""
    first, second, third = map(as_vector, rows)
    return first, second, third


DRIVE_LOAD_NAME = "driving_torque"
"""Name of the load for the torque that a simulation is given at its only input.

With several inputs, the name of the input follows.
"""


@checked_class(ModelError)
@dataclass(frozen=True)
class PairTorque(Load):
    """A torque about the axis of an R pair (hinge), on its second link.

    The reaction acts on the first link.

    Attributes
    ----------
    name
        Name of the load.
    pair
        Name of the R pair.
    torque
        The torque (N m): an expression in pair variables ``theta_PAIR`` (rad), their rates
        ``dtheta_PAIR`` (rad/s) and the time ``t`` (s). The torque may also be a function
        f(t, q, dq) of the time and of the variable and the rate of this pair. Only
        simulations by NumPy can use a function. They call the function at times that do not
        always rise, so its result must not depend on earlier calls.
    """

    kind = "torque"
    field_kinds = MappingProxyType({"pair": "pair", "torque": "text"})

    name: str
    pair: str
    torque: str | TorqueFunction

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return one component: the torque at the pair, an expression or a function."""
        if isinstance(self.torque, str):
            return (make_component(mechanism, self.torque, self.pair),)
        return (LoadComponent(TorqueCallback(self.pair, self.torque), self.pair),)


@checked_class(ModelError)
@dataclass(frozen=True)
class Gravity(Load):
    """Gravity on every moving link with a mass.

    Attributes
    ----------
    name
        Name of the load.
    acceleration
        (3,) acceleration (m/s2) in ground axes.
    """

    kind = "gravity"
    field_kinds = MappingProxyType({"acceleration": "vector"})
    # A load is a magnitude times moments on links. Here the magnitude is 1, and the moments
    # of the weights have the unit N m.
    velocity_unit = "N m"

    name: str
    acceleration: Vector

    def check(self, key: str, mechanism: LoadedMechanism) -> None:
        """Check that the weights of all moving links with inertia can be computed.

        The weights need a finite acceleration, and the mass and the centre of mass of each
        such link. `key` is the key of the load in the mechanism file, for messages.

        Raises
        ------
        ModelError
            If the acceleration is not finite, no moving link has an inertia, or one has an
            inertia tensor, but no mass or centre of mass.
        """
        # The base class checks the fields, here the acceleration.
        super().check(key, mechanism)
        moving = [mass for mass in mechanism.masses if mass.link != mechanism.ground]
        if not moving:
            raise ModelError(
                f"{key}: gravity needs a moving link with a mass: give mass and centre in "
                "[mass.LINK], or leave gravity out"
            )
        lacking = [mass.link for mass in moving if mass.centre is None]
        if lacking:
            tables = [f"[mass.{link}]" for link in lacking]
            raise ModelError(
                f"{key}: gravity needs the mass and the centre of mass of every link with "
                f"inertia; add the keys mass and centre to {listing(tables)}"
            )

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return one component: the weights of all moving links.

        A component has a magnitude that multiplies its forces and moments on links. Here
        the magnitude is the number 1.
        """
        weights = []
        for mass in mechanism.masses:
            if mass.link != mechanism.ground:
                # A `LinkMoment` with an arm is the force `direction`, which acts at the
                # point `arm` of the link, here the centre of mass.
                x, y, z = (mass.mass * component for component in self.acceleration)
                weights.append(
                    LinkMoment(
                        link=mass.link,
                        direction=(x, y, z),
                        axes="ground",
                        arm=mass.centre,
                    )
                )
        return (make_component(mechanism, "1", moments=tuple(weights)),)


@checked_class(ModelError)
@dataclass(frozen=True)
class PointForce(Load):
    """A force on a link, at a point that is fixed in the link.

    The opposite force acts on the ground.

    Attributes
    ----------
    name
        Name of the load.
    link
        Name of the link.
    point
        (3,) point (m) in link axes.
    force
        Expressions of the components (N) in the time ``t``, the variable ``theta_21`` of a
        pair named 21, and its rate ``dtheta_21``.
    axes
        Axes of the components: those of the ground or of the link.
    """

    kind = "force"
    # What the fields contain, for functions that read and write mechanism files. "texts"
    # are expressions, and "axes" is the word "ground" or "link".
    field_kinds = MappingProxyType(
        {"link": "link", "point": "vector", "force": "texts", "axes": "axes"}
    )
    # Unit of the velocity of the point per unit rate of an angle: m/s per rad/s, thus m.
    # The force (N) times this velocity is a generalised force (N m).
    velocity_unit = "m"

    name: str
    link: str
    point: Vector
    force: Expressions
    axes: Axes = "ground"

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return the components of the force as moments on the link about the centre."""
        return _link_components(mechanism, self, self.force, as_vector(self.point))


@checked_class(ModelError)
@dataclass(frozen=True)
class Moment(Load):
    """A moment on a link.

    The opposite moment acts on the ground. `field_kinds` declares what each field contains.
    By these kinds, the reader of mechanism files checks and converts the fields.

    Attributes
    ----------
    name
        Name of the load.
    link
        Name of the link.
    moment
        Expressions of the components (N m) in the time ``t``, the variable ``theta_21`` of
        a pair named 21, and its rate ``dtheta_21``.
    axes
        Axes of the components: those of the ground or of the link.
    """

    kind = "moment"
    field_kinds = MappingProxyType({"link": "link", "moment": "texts", "axes": "axes"})

    name: str
    link: str
    moment: Expressions
    axes: Axes = "ground"

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return the components of the moment on the link."""
        # A force would have an arm. A moment has none.
        return _link_components(mechanism, self, self.moment, arm=None)


@checked_class(ModelError)
@dataclass(frozen=True)
class Spring(Load):
    """A spring at an R pair (hinge), with the torque -stiffness (v - rest).

    Here v is the variable of the pair, which counts whole revolutions.

    Attributes
    ----------
    name
        Name of the load.
    pair
        Name of the R pair.
    stiffness
        Stiffness (N m/rad).
    rest
        Value of the variable (rad) at which the torque is zero.
    """

    # The word for springs in mechanism files.
    kind = "spring"
    # The expression of the torque (N m). `components` of the base class inserts the values
    # of the fields; theta_21 is the variable of a pair named 21.
    torque_template = "-{stiffness}*(theta_{pair} - {rest})"
    # The values that state a spring in a mechanism file: the name of a pair, a number of
    # the unit N m/rad that is not negative, and an angle. They are read and checked
    # accordingly.
    field_kinds = MappingProxyType(
        {"pair": "pair", "stiffness": "N m/rad", "rest": "angle"}
    )

    name: str
    pair: str
    stiffness: float
    rest: float = 0.0


@checked_class(ModelError)
@dataclass(frozen=True)
class Damper(Load):
    """A viscous damper at an R pair (hinge).

    The torque is minus the damping times the rate of the pair angle. `torque_template` is
    the expression of the torque with names of fields in braces. The method `components`
    replaces these names by the values of the fields.

    Attributes
    ----------
    name
        Name of the load.
    pair
        Name of the R pair.
    damping
        Damping (N m s/rad).
    """

    kind = "damper"
    torque_template = "-{damping}*dtheta_{pair}"
    field_kinds = MappingProxyType({"pair": "pair", "damping": "N m s/rad"})

    name: str
    pair: str
    damping: float


@checked_class(ModelError)
@dataclass(frozen=True)
class Friction(Load):
    """Friction at an R pair (hinge): the torque -(torque tanh(v' / speed) + viscous v').

    Here v' is the rate (rad/s) of the variable of the pair. `torque_template` is the
    expression of the torque with names of fields in braces. The method `components`
    replaces these names by the values of the fields.

    Attributes
    ----------
    name
        Name of the load.
    pair
        Name of the R pair.
    torque
        Dry friction (N m) at rates v' well above `speed`.
    viscous
        Viscous friction (N m s/rad).
    speed
        Rate (rad/s) below which the jump of Coulomb's law is smoothed.
    """

    kind = "friction"
    torque_template = "-({torque}*tanh(dtheta_{pair}/{speed}) + {viscous}*dtheta_{pair})"
    field_kinds = MappingProxyType(
        {"pair": "pair", "torque": "N m", "speed": "rate", "viscous": "N m s/rad"}
    )
    defaults_in_files = MappingProxyType({"viscous": 0.0})

    name: str
    pair: str
    torque: float
    viscous: float
    speed: float


LOADS: Mapping[str, type[Load]] = MappingProxyType(
    {
        load.kind: load
        for load in (
            PairTorque,
            Gravity,
            PointForce,
            Moment,
            Spring,
            Damper,
            Friction,
            Bearings,
            ContactFriction,
            TorqueTable,
        )
    }
)
"""The kinds of loads by their words in files. A load without a kind is a torque."""


_UNIT_VECTORS: tuple[Vector, ...] = (
    (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, 0.0, 1.0),
)


def _link_components(
    mechanism: LoadedMechanism,
    load: PointForce | Moment,
    magnitudes: Expressions,
    arm: Vector | None,
) -> LoadComponents:
    """Return one component for each axis of a force or a moment on a link.

    Parameters
    ----------
    mechanism
        The mechanism on which the load acts.
    load
        The force or moment, with its link and axes.
    magnitudes
        Expressions of the three components in these axes.
    arm
        (3,) point of the link (m, link axes) at which a force acts; None for a moment.
    """
    components = []
    for magnitude, unit_vector in zip(magnitudes, _UNIT_VECTORS, strict=True):
        moment = LinkMoment(link=load.link, direction=unit_vector, axes=load.axes, arm=arm)
        components.append(make_component(mechanism, magnitude, moments=(moment,)))
    return tuple(components)


@dataclass(frozen=True)
class JointLimit:
    """A range [low, high] (rad) of the variable of an R pair, at which simulations end."""

    pair: str
    low: float
    high: float


def joint_limit_roundings(limit: JointLimit) -> tuple[float, float]:
    """Return the rounding errors (rad) of an angle at the lower and the upper limit.

    The angle is the sum of an angle without whole turns and of these turns.
    """
    sizes = (max(abs(limit.low), math.pi), max(abs(limit.high), math.pi))
    return JOINT_LIMIT_ROUNDING * sizes[0], JOINT_LIMIT_ROUNDING * sizes[1]


def check_joint_limit(limit: JointLimit, mechanism: LoadedMechanism) -> None:
    """Raise `ModelError` if a joint limit is not a rising range of an R pair."""
    key = f"joint_limits.{limit.pair}"
    check_angle_pair(key, limit.pair, mechanism)
    check_finite(key, (limit.low, limit.high))
    if not limit.low < limit.high:
        raise ModelError(
            f"{key}: `from` must be less than `to`, but the range is from "
            f"{limit.low:.6g} to {limit.high:.6g} rad"
        )
