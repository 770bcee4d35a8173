"""What acts on the links of a mechanism: inertia, loads, and joint limits."""

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
    Called,
    Component,
    Components,
    LinkMoment,
    Load,
    Loaded,
    TorqueFunction,
    TorqueTable,
    acting,
    need_angle,
)
from spherekit.mechanism.sizes import Vector, check_finite
from spherekit.wording import listing

Expressions = tuple[str, str, str]


def as_tensor(rows: Floats) -> Tensor:
    """Return a tensor (3, 3) as rows of floats."""
    first, second, third = map(as_vector, rows)
    return first, second, third


DRIVE = "driving_torque"
"""Name of the load that a torque at the input becomes."""


@checked_class(ModelError)
@dataclass(frozen=True)
class PairTorque(Load):
    """A torque (N m) about an R pair's axis on its second link, its reaction on the first.

    `torque` is an expression in pair variables ``theta_PAIR`` (rad), their rates
    ``dtheta_PAIR`` (rad/s) and the time ``t`` (s); or a function f(t, q, dq) of the time
    and of this pair's variable and rate, which only simulations by NumPy can call. It is
    called at any times in any order.
    """

    kind = "torque"
    keys = MappingProxyType({"pair": "pair", "torque": "text"})

    name: str
    pair: str
    torque: str | TorqueFunction

    def components(self, mechanism: Loaded) -> Components:
        if isinstance(self.torque, str):
            return acting(mechanism, self.torque, self.pair)
        return (Component(Called(self.pair, self.torque), self.pair),)


@checked_class(ModelError)
@dataclass(frozen=True)
class Gravity(Load):
    """The same acceleration (m/s2, ground axes) on every link with a mass."""

    kind = "gravity"
    keys = MappingProxyType({"acceleration": "vector"})
    velocity_unit = "N m"

    name: str
    acceleration: Vector

    def check(self, key: str, mechanism: Loaded) -> None:
        super().check(key, mechanism)
        moving = [mass for mass in mechanism.masses if mass.link != mechanism.ground]
        if not moving:
            raise ModelError(
                f"{key}: gravity needs a moving link with a mass: give mass and centre in "
                "[mass.LINK], or leave gravity out"
            )
        lacking = [mass.link for mass in moving if mass.centre is None]
        if lacking:
            raise ModelError(
                f"{key}: gravity needs mass and centre of every link with inertia; "
                f"[mass.LINK] lacks them for link {listing(lacking)}"
            )

    def components(self, mechanism: Loaded) -> Components:
        weights = []
        for mass in mechanism.masses:
            if mass.link != mechanism.ground:
                x, y, z = (mass.mass * part for part in self.acceleration)
                weights.append(LinkMoment(mass.link, (x, y, z), "ground", mass.centre))
        return acting(mechanism, "1", moments=tuple(weights))


@checked_class(ModelError)
@dataclass(frozen=True)
class PointForce(Load):
    """A force (N) at a point (m, link axes) fixed in a link; its reaction on the ground.

    The components of `force` are expressions as in `PairTorque`, along the axes of the
    ground or of the link.
    """

    kind = "force"
    keys = MappingProxyType(
        {"link": "link", "point": "vector", "force": "texts", "axes": "axes"}
    )
    velocity_unit = "m"

    name: str
    link: str
    point: Vector
    force: Expressions
    axes: Axes = "ground"

    def components(self, mechanism: Loaded) -> Components:
        return _on_link(mechanism, self, self.force, as_vector(self.point))


@checked_class(ModelError)
@dataclass(frozen=True)
class Moment(Load):
    """A moment (N m) on a link; its reaction on the ground.

    The components are expressions as in `PairTorque`, along the axes of the ground or of
    the link.
    """

    kind = "moment"
    keys = MappingProxyType({"link": "link", "moment": "texts", "axes": "axes"})

    name: str
    link: str
    moment: Expressions
    axes: Axes = "ground"

    def components(self, mechanism: Loaded) -> Components:
        return _on_link(mechanism, self, self.moment, None)


@checked_class(ModelError)
@dataclass(frozen=True)
class Spring(Load):
    """A spring at an R pair: the torque -stiffness (v - rest) for the variable v (rad).

    `stiffness` is in N m/rad. The variable is not reduced to a turn.
    """

    kind = "spring"
    law = "-{stiffness}*(theta_{pair} - {rest})"
    keys = MappingProxyType({"pair": "pair", "stiffness": "N m/rad", "rest": "angle"})

    name: str
    pair: str
    stiffness: float
    rest: float = 0.0


@checked_class(ModelError)
@dataclass(frozen=True)
class Damper(Load):
    """A viscous damper at an R pair: the torque -damping v' for the rate v' (rad/s).

    `damping` is in N m s/rad.
    """

    kind = "damper"
    law = "-{damping}*dtheta_{pair}"
    keys = MappingProxyType({"pair": "pair", "damping": "N m s/rad"})

    name: str
    pair: str
    damping: float


@checked_class(ModelError)
@dataclass(frozen=True)
class Friction(Load):
    """Dry and viscous friction at an R pair: -(torque tanh(v' / speed) + viscous v').

    `torque` (N m) is the dry friction at rates v' well above `speed` (rad/s), below which
    the jump of Coulomb's law is smoothed; `viscous` is in N m s/rad.
    """

    kind = "friction"
    law = "-({torque}*tanh(dtheta_{pair}/{speed}) + {viscous}*dtheta_{pair})"
    keys = MappingProxyType(
        {"pair": "pair", "torque": "N m", "speed": "rate", "viscous": "N m s/rad"}
    )
    absent = MappingProxyType({"viscous": 0.0})

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
"""The kinds of loads by their words in files; without one it is a torque."""


_UNITS: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _on_link(
    mechanism: Loaded,
    load: PointForce | Moment,
    texts: Expressions,
    arm: Vector | None,
) -> Components:
    return tuple(
        acting(mechanism, text, moments=(LinkMoment(load.link, axis, load.axes, arm),))[0]
        for text, axis in zip(texts, _UNITS, strict=True)
    )


@dataclass(frozen=True)
class JointLimit:
    """An R pair whose variable (rad) may not leave [low, high]; a simulation ends there."""

    pair: str
    low: float
    high: float


def check_stop(stop: JointLimit, mechanism: Loaded) -> None:
    """Refuse a stop that is not a range of an R pair's variable."""
    key = f"joint_limits.{stop.pair}"
    need_angle(key, stop.pair, mechanism)
    check_finite(key, (stop.low, stop.high))
    if not stop.low < stop.high:
        raise ModelError(
            f"{key}: the range must rise from `from` to `to`, but it is "
            f"{stop.low:.6g} to {stop.high:.6g} rad"
        )
