"""What acts on the links of a mechanism: inertia, loads, and stops of pairs."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, final

from spherekit.checked import checked_class
from spherekit.conventions import listing
from spherekit.errors import ModelError
from spherekit.model.bearings import Bearings, ContactFriction
from spherekit.model.load import (
    Axes,
    Called,
    Component,
    LinkMoment,
    Load,
    TorqueFunction,
    Vector,
    law_of,
    number_text,
    vector_of,
)
from spherekit.model.needs import (
    need_angle,
    need_at_least_zero,
    need_expression,
    need_finite,
    need_function,
    need_smoothing,
)
from spherekit.model.torque_table import TorqueTable

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism

Tensor = tuple[Vector, Vector, Vector]
Expressions = tuple[str, str, str]


DRIVE = "driving_torque"
"""Name of the load that a torque at the input becomes."""


@final
@dataclass(frozen=True)
class Mass:
    """Inertia of a link, in link axes.

    `tensor` is the inertia tensor about the centre of the sphere (kg m2). `mass` (kg) and
    `centre`, the centre of mass (m), are needed by gravity only.
    """

    link: str
    tensor: Tensor
    mass: float | None = None
    centre: Vector | None = None


@final
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

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_angle(f"{key}.pair", self.pair, mechanism)
        if callable(self.torque):
            need_function(f"{key}.torque", self.torque)
        else:
            need_expression(f"{key}.torque", self.torque, mechanism)

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        if isinstance(self.torque, str):
            return (Component(law_of(mechanism, self.torque), self.pair),)
        return (Component(Called(self.pair, self.torque), self.pair),)


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class Gravity(Load):
    """The same acceleration (m/s2, ground axes) on every link with a mass."""

    kind = "gravity"
    keys = MappingProxyType({"acceleration": "vector"})
    velocity_unit = "N m"

    name: str
    acceleration: Vector

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_finite(f"{key}.acceleration", self.acceleration)
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

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        weights = []
        for mass in mechanism.masses:
            if mass.link == mechanism.ground:
                continue
            assert mass.mass is not None and mass.centre is not None
            x, y, z = (mass.mass * float(part) for part in self.acceleration)
            at = vector_of(mass.centre)
            weights.append(LinkMoment(mass.link, (x, y, z), "ground", at))
        return (Component(law_of(mechanism, "1"), moments=tuple(weights)),)


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class PointForce(Load):
    """A force (N) at a point (m, link axes) fixed in a link; its reaction on the ground.

    The components of `force` are expressions as in `PairTorque`, along the axes of the
    ground or of the link.
    """

    kind = "force"
    keys = MappingProxyType(
        {"link": "link", "point": "vector", "force": "texts", "axes": "text"}
    )
    velocity_unit = "m"

    name: str
    link: str
    point: Vector
    force: Expressions
    axes: Axes = "ground"

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_finite(f"{key}.point", self.point)
        _check_on_link(key, "force", self.force, mechanism)

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        return _on_link(mechanism, self, self.force, vector_of(self.point))


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class Moment(Load):
    """A moment (N m) on a link; its reaction on the ground.

    The components are expressions as in `PairTorque`, along the axes of the ground or of
    the link.
    """

    kind = "moment"
    keys = MappingProxyType({"link": "link", "moment": "texts", "axes": "text"})

    name: str
    link: str
    moment: Expressions
    axes: Axes = "ground"

    def check(self, key: str, mechanism: "Mechanism") -> None:
        _check_on_link(key, "moment", self.moment, mechanism)

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        return _on_link(mechanism, self, self.moment, None)


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class Spring(Load):
    """A spring at an R pair: the torque -stiffness (v - rest) for the variable v (rad).

    `stiffness` is in N m/rad. The variable is not reduced to a turn.
    """

    kind = "spring"
    keys = MappingProxyType({"pair": "pair", "stiffness": "number", "rest": "angle"})

    name: str
    pair: str
    stiffness: float
    rest: float = 0.0

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_angle(f"{key}.pair", self.pair, mechanism)
        push = "; a torque that pushes away is a load of kind torque, an expression"
        need_at_least_zero(f"{key}.stiffness", self.stiffness, "N m/rad", push)
        need_finite(f"{key}.rest", [self.rest])

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        away = f"(theta_{self.pair} - {number_text(self.rest)})"
        torque = f"-{number_text(self.stiffness)}*{away}"
        return (Component(law_of(mechanism, torque), self.pair),)


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class Damper(Load):
    """A viscous damper at an R pair: the torque -damping v' for the rate v' (rad/s).

    `damping` is in N m s/rad.
    """

    kind = "damper"
    keys = MappingProxyType({"pair": "pair", "damping": "number"})

    name: str
    pair: str
    damping: float

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_angle(f"{key}.pair", self.pair, mechanism)
        drive = "; a torque that drives is a load of kind torque, an expression"
        need_at_least_zero(f"{key}.damping", self.damping, "N m s/rad", drive)

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        torque = f"-{number_text(self.damping)}*dtheta_{self.pair}"
        return (Component(law_of(mechanism, torque), self.pair),)


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class Friction(Load):
    """Dry and viscous friction at an R pair: -(torque tanh(v' / speed) + viscous v').

    `torque` (N m) is the dry friction at rates v' well above `speed` (rad/s), below which
    the jump of Coulomb's law is smoothed; `viscous` is in N m s/rad.
    """

    kind = "friction"
    keys = MappingProxyType(
        {"pair": "pair", "torque": "number", "speed": "rate", "viscous": "number"}
    )
    absent = MappingProxyType({"viscous": 0.0})

    name: str
    pair: str
    torque: float
    viscous: float
    speed: float

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_angle(f"{key}.pair", self.pair, mechanism)
        need_at_least_zero(f"{key}.torque", self.torque, "N m")
        need_at_least_zero(f"{key}.viscous", self.viscous, "N m s/rad")
        need_smoothing(f"{key}.speed", self.speed)

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        rate = f"dtheta_{self.pair}"
        dry = f"{number_text(self.torque)}*tanh({rate}/{number_text(self.speed)})"
        torque = f"-({dry} + {number_text(self.viscous)}*{rate})"
        return (Component(law_of(mechanism, torque), self.pair),)


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
    mechanism: "Mechanism",
    load: PointForce | Moment,
    texts: Expressions,
    arm: Vector | None,
) -> tuple[Component, ...]:
    return tuple(
        Component(
            law_of(mechanism, text), moments=(LinkMoment(load.link, axis, load.axes, arm),)
        )
        for text, axis in zip(texts, _UNITS, strict=True)
    )


def _check_on_link(key: str, what: str, parts: Expressions, mechanism: "Mechanism") -> None:
    for number, text in enumerate(parts):
        need_expression(f"{key}.{what}[{number}]", text, mechanism)


@final
@dataclass(frozen=True)
class Stop:
    """An R pair whose variable (rad) may not leave [low, high]; a simulation ends there."""

    pair: str
    low: float
    high: float
