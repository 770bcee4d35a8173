"""What acts on the links of a mechanism: inertia, loads, and stops of pairs."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import final

import numpy as np

from spherekit.checked import checked_class
from spherekit.conventions import listing
from spherekit.errors import ModelError
from spherekit.model.bearings import Bearings, ContactFriction
from spherekit.model.changes import need_finite
from spherekit.model.inertia import moments_of_point
from spherekit.model.load import (
    Axes,
    Called,
    Component,
    LinkMoment,
    Load,
    Loaded,
    TorqueFunction,
    TorqueTable,
    Vector,
    law_of,
    need_angle,
    number_text,
    vector_of,
)
from spherekit.sphere.rotation import Floats

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

    def components(self, mechanism: Loaded) -> tuple[Component, ...]:
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

    def components(self, mechanism: Loaded) -> tuple[Component, ...]:
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
        {"link": "link", "point": "vector", "force": "texts", "axes": "axes"}
    )
    velocity_unit = "m"

    name: str
    link: str
    point: Vector
    force: Expressions
    axes: Axes = "ground"

    def components(self, mechanism: Loaded) -> tuple[Component, ...]:
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
    keys = MappingProxyType({"link": "link", "moment": "texts", "axes": "axes"})

    name: str
    link: str
    moment: Expressions
    axes: Axes = "ground"

    def components(self, mechanism: Loaded) -> tuple[Component, ...]:
        return _on_link(mechanism, self, self.moment, None)


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class Spring(Load):
    """A spring at an R pair: the torque -stiffness (v - rest) for the variable v (rad).

    `stiffness` is in N m/rad. The variable is not reduced to a turn.
    """

    kind = "spring"
    keys = MappingProxyType({"pair": "pair", "stiffness": "N m/rad", "rest": "angle"})

    name: str
    pair: str
    stiffness: float
    rest: float = 0.0

    def components(self, mechanism: Loaded) -> tuple[Component, ...]:
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
    keys = MappingProxyType({"pair": "pair", "damping": "N m s/rad"})

    name: str
    pair: str
    damping: float

    def components(self, mechanism: Loaded) -> tuple[Component, ...]:
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
        {"pair": "pair", "torque": "N m", "speed": "rate", "viscous": "N m s/rad"}
    )
    absent = MappingProxyType({"viscous": 0.0})

    name: str
    pair: str
    torque: float
    viscous: float
    speed: float

    def components(self, mechanism: Loaded) -> tuple[Component, ...]:
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
    mechanism: Loaded,
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


@final
@dataclass(frozen=True)
class Stop:
    """An R pair whose variable (rad) may not leave [low, high]; a simulation ends there."""

    pair: str
    low: float
    high: float


MOMENT_TOLERANCE = 1e-3
"""Excess of a principal moment that passes for rounding, as part of the largest entry.

The moments of a thin arc stand exactly on the limit, and tables print few digits.
"""

ASYMMETRY = 1e-12
"""Difference of two mirrored entries that passes for rounding, as part of the largest."""


def check_mass(mass: Mass) -> None:
    """Refuse an inertia that no body has.

    Raises
    ------
    ModelError
        If the tensor is not symmetric, has a negative principal moment, or one that
        exceeds the sum of the two others; if the mass is not positive; if the tensor is
        smaller than that of the mass at its centre.
    """
    key = f"mass.{mass.link}"
    if mass.mass is not None:
        need_finite(f"{key}.mass", [mass.mass])
        if not mass.mass > 0:
            raise ModelError(f"{key}.mass: found {mass.mass:g} kg, needs more than 0")
    tensor = np.array(mass.tensor, dtype=np.float64)
    check_tensor(f"{key}.tensor", tensor)
    if mass.centre is None:
        return
    if mass.mass is None:
        raise ModelError(f"{key}.centre: needs a mass with it, in kg")
    need_finite(f"{key}.centre", mass.centre)
    moved = tensor - moments_of_point(mass.mass, np.array(mass.centre))
    about = f" about the centre of mass ({mass.mass:g} kg at {list(mass.centre)} m)"
    slack = MOMENT_TOLERANCE * float(np.max(np.abs(tensor)))
    _need_moments(key, moved, slack, about)


def check_tensor(key: str, tensor: Floats) -> None:
    """Refuse an inertia tensor that no body has about any point; `key` says where it is.

    Raises
    ------
    ModelError
        If it is not symmetric, has a negative principal moment, or one that exceeds the
        sum of the two others.
    """
    if tensor.shape != (3, 3):
        raise ModelError(f"{key}: has the shape {tensor.shape}, needs (3, 3)")
    need_finite(key, tensor.ravel())
    largest = float(np.max(np.abs(tensor)))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        if abs(tensor[i, j] - tensor[j, i]) > ASYMMETRY * largest:
            raise ModelError(
                f"{key}: not symmetric: row {i + 1}, column {j + 1} has {tensor[i, j]}, "
                f"row {j + 1}, column {i + 1} has {tensor[j, i]}"
            )
    _need_moments(key, tensor, MOMENT_TOLERANCE * largest, "")


def _need_moments(key: str, tensor: Floats, slack: float, about: str) -> None:
    small, middle, large = map(float, np.linalg.eigvalsh(tensor))
    if small < -slack:
        raise ModelError(
            f"{key}: not physical: the smallest principal moment{about} is {small:.6g} "
            "kg m2; none is below 0"
        )
    excess = large - middle - small
    if excess > slack:
        raise ModelError(
            f"{key}: not physical: the largest principal moment{about} exceeds the sum of "
            f"the others by {excess:.6g} kg m2 ({large:.6g} > {middle:.6g} + {small:.6g}); "
            "check units, signs of products of inertia, and the point it is about"
        )


def check_stop(stop: Stop, mechanism: Loaded) -> None:
    """Refuse a stop that is not a range of an R pair's variable."""
    key = f"stops.{stop.pair}"
    need_angle(key, stop.pair, mechanism)
    need_finite(key, (stop.low, stop.high))
    if not stop.low < stop.high:
        raise ModelError(
            f"{key}: the range must rise from `from` to `to`, but it is "
            f"{stop.low:.6g} to {stop.high:.6g} rad"
        )
