"""Friction in the bearings of pairs and in contacts that slide."""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.mechanism.joint import Numbers
from spherekit.mechanism.load import (
    BearingFriction,
    Component,
    Components,
    Loaded,
    acting,
    need_at_least_zero,
    number_text,
)
from spherekit.mechanism.load_expression import parse


@checked_class(ModelError)
@dataclass(frozen=True)
class Bearings(BearingFriction):
    """The bearings of an R pair, with Coulomb's friction that follows from its reaction.

    `positions` (m) are where they sit along the axis, from the centre of the sphere: one,
    which holds the pair together with the centre, or two, which carry a couple. `axial`
    are the parts that they take of the force along the axis, 1 a fixed bearing and 0 a
    floating one; where all are 0 the pair lets its links slide along the axis. Where it
    is None that is not said. Their friction is -(coefficient radius F tanh(v' / speed)) at
    rates v', with their `radius` (m) and the sum F of the forces on them: with `axial` of
    all forces, without of those of the couple alone.
    """

    kind = "bearings"
    keys = MappingProxyType(
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
        """Whether the pair transmits no force along its axis."""
        return self.axial is not None and not any(self.axial)

    @property
    def grip(self) -> float:
        """The friction (N m) per force (N) on the bearings."""
        return self.coefficient * self.radius

    @property
    def asks_forces(self) -> bool:
        """See `BearingFriction`."""
        return self.axial is not None

    def carried(self, moments: Floats, forces: Floats | None = None) -> Floats:
        """Return the forces (..., bearings, 3) N on the bearings, in pair axes.

        They have the moment about the centre that the pair transmits (..., 3) N m and,
        with the force through it (..., 3) N, this for their sum; without, they are those
        of the couple alone. Along the axis they are NaN where `axial` is not said.
        """
        bent = moments[..., [1, 0, 2]] * [1.0, -1.0, 0.0]
        first, *rest = self.positions
        pull = 0.0 * bent if forces is None else forces * [1.0, 1.0, 0.0]
        if rest:
            (second,) = rest
            span = second - first
            parts = [(second * pull - bent) / span, (bent - first * pull) / span]
        else:
            parts = [bent / first]
        if forces is not None:
            shares = self.axial or (np.nan,) * len(parts)
            for part, share in zip(parts, shares, strict=True):
                part[..., 2] = share * forces[..., 2] if share else 0.0
        return np.stack(parts, axis=-2)

    def check(self, key: str, mechanism: Loaded) -> None:
        """See `Load`."""
        super().check(key, mechanism)
        first, *rest = self.positions or (0.0,)
        if len(rest) > 1 or (rest[0] == first if rest else first == 0.0):
            raise ModelError(
                f"{key}.positions: found {list(self.positions)} m, needs one that is not "
                "0, or two that differ: distances of the bearings from the centre along "
                "the axis"
            )
        axial = (0.0,) * len(self.positions) if self.axial is None else self.axial
        for part in axial:
            need_at_least_zero(f"{key}.axial", part, "")
        partly = any(axial) and abs(sum(axial) - 1.0) >= 1e-9
        if partly or len(axial) != len(self.positions):
            raise ModelError(
                f"{key}.axial: found {list(axial)}, needs one part for each of the "
                f"{len(self.positions)} positions, 1 in all (a fixed bearing takes 1, a "
                "floating one 0), or 0 for each where the pair lets its links slide along "
                "its axis"
            )
        for load in mechanism.loads:
            if isinstance(load, Bearings) and load.pair == self.pair and load != self:
                raise ModelError(
                    f"{key}.pair: loads.{load.name} has the bearings of pair {self.pair} "
                    "too; give both positions in one of them"
                )

    def components(self, mechanism: Loaded) -> Components:
        """See `Load`."""
        text = f"-tanh(dtheta_{self.pair}/{number_text(self.speed)})"
        return acting(mechanism, text if self.grip > 0.0 else "0", self.pair, rubs=self)


@checked_class(ModelError)
@dataclass(frozen=True)
class ContactFriction(BearingFriction):
    """Coulomb's friction of a contact that slides, which follows from its push.

    It is `coefficient` times the push, against the rate v at which the second link slides
    along the first, smoothed by tanh(v / `speed`), in rad/s: at the distance r of the
    contact from the centre it slides at r v.
    """

    kind = "contact_friction"
    keys = MappingProxyType({"pair": "contact", "coefficient": "", "speed": "rate"})

    name: str
    pair: str
    coefficient: float
    speed: float = 1e-3

    @property
    def grip(self) -> float:
        """The friction (N m) per push (N m)."""
        return self.coefficient

    def carried(self, moments: Floats, forces: Floats | None = None) -> Floats:
        """Return the push (..., 1, 3) N m, see `BearingFriction`."""
        return (moments * [1.0, 0.0, 0.0])[..., None, :]

    def components(self, mechanism: Loaded) -> Components:
        """See `Load`."""
        if not self.grip > 0.0:
            return (Component(parse("0", [])),)
        rate = sliding_rate(self.pair)
        law = parse(f"-tanh({rate}/{number_text(self.speed)})", [rate])
        return (Component(law, self.pair, rubs=self),)


def sliding_rate(pair: str) -> str:
    """Return the name of the rate at which a contact slides, in magnitudes."""
    return f"sliding_{pair}"


def need_no_rubbing(mechanism: Loaded, what: str) -> None:
    """Raise `ModelError` if friction follows from reactions, which `what` does not know."""
    for load in mechanism.loads:
        if isinstance(load, BearingFriction) and load.grip > 0.0:
            raise ModelError(
                f"{mechanism.name}: loads.{load.name}: its friction follows from the "
                f"reaction of pair {load.pair}, which {what}; or take coefficient = 0, or "
                "at an R pair a load of kind friction, whose torque the analysis "
                "reactions can tell"
            )
