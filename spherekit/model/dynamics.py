"""What acts on the links of a mechanism: inertia, loads, and joint limits.

Inertia tensors about the centre of the sphere, from what is known of a link.

Bearings of pairs and contacts that slide: what of reactions rubs in them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.conventions import listing
from spherekit.errors import ModelError
from spherekit.model.expression import parse
from spherekit.model.joints import Numbers
from spherekit.model.load import (
    Axes,
    BearingFriction,
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
    need_at_least_zero,
    number_text,
)
from spherekit.model.parts import Vector, need_finite, vector_of
from spherekit.sphere.rotation import cross, frame_from, max_abs

PARALLEL = 1e-9
"""Below this sine two axes count as one line, which has no arc and gives no frame."""


def moments_of_point(mass: float, place: Floats) -> Floats:
    """Return the tensor (3, 3), kg m2, about O of a mass (kg) at a place (3,), m."""
    return mass * (place @ place * np.eye(3) - np.outer(place, place))


def moved_to_sphere_centre(tensor: Floats, mass: float, centre: Floats) -> Floats:
    """Return the tensor (3, 3) about O, given that about the centre of mass (kg m2).

    `mass` is in kg, `centre` (3,) in m from O. Steiner's theorem.
    """
    return tensor + moments_of_point(mass, centre)


def axes_frame(first: Floats, second: Floats) -> Floats:
    """Return the frame (3, 3) with z along `first` and `second` at x = 0, y > 0.

    The columns are x, y, z, as the frame of Di Gregorio 2024, Fig. 3, on the two axes.

    Raises
    ------
    ModelError
        If the axes, unit vectors (3,), are parallel.
    """
    across = cross(second, first)
    length = np.linalg.norm(across)
    if length < PARALLEL:
        raise ModelError(
            "the two axes are parallel, so that no plane and no arc is theirs; name "
            "others, or give tensor in link axes"
        )
    return frame_from(first, across / length)


def uniform_arc(
    first: Floats, second: Floats, mass: float, radius: float
) -> tuple[Floats, Floats]:
    """Return tensor about O (kg m2) and centre of mass (m) of a thin uniform arc.

    The mass (kg) is spread evenly over the shorter great-circle arc of a radius (m) from
    the unit vector `first` (3,) to `second`.

    Raises
    ------
    ModelError
        If the two axes are parallel.

    Notes
    -----
    With the length a of the arc, means over it along and across the direction e of its
    middle are <cos^2> = 1/2 + sin a / (2 a) and <sin^2> = 1/2 - sin a / (2 a); the centre
    is at radius sin(a/2) / (a/2) along e.
    """
    frame = axes_frame(first, second)
    length = np.arctan2(second @ frame[:, 1], second @ first)
    half = length / 2
    middle = np.cos(half) * frame[:, 2] + np.sin(half) * frame[:, 1]
    across = np.cos(half) * frame[:, 1] - np.sin(half) * frame[:, 2]
    spread = np.sin(length) / (2 * length)
    taken = (0.5 + spread) * np.outer(middle, middle)
    taken += (0.5 - spread) * np.outer(across, across)
    return mass * radius**2 * (np.eye(3) - taken), radius * np.sin(half) / half * middle


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


Tensor = tuple[Vector, Vector, Vector]
Expressions = tuple[str, str, str]


def tensor_of(rows: Floats) -> Tensor:
    """Return a tensor (3, 3) as rows of floats."""
    first, second, third = map(vector_of, rows)
    return first, second, third


DRIVE = "driving_torque"
"""Name of the load that a torque at the input becomes."""


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
        return _on_link(mechanism, self, self.force, vector_of(self.point))


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
    _need_moments(key, moved, MOMENT_TOLERANCE * max_abs(tensor), about)


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
    largest = max_abs(tensor)
    for i, j in np.argwhere(np.abs(tensor - tensor.T) > ASYMMETRY * largest):
        raise ModelError(
            f"{key}: not symmetric: row {i + 1}, column {j + 1} has {tensor[i, j]}, "
            f"row {j + 1}, column {i + 1} has {tensor[j, i]}"
        )
    _need_moments(key, tensor, MOMENT_TOLERANCE * largest, "")


def _need_moments(key: str, tensor: Floats, slack: float, about: str) -> None:
    small, middle, large = np.linalg.eigvalsh(tensor)
    excess = large - middle - small
    if small < -slack:
        what = f"smallest principal moment{about} is {small:.6g} kg m2; none is below 0"
    elif excess > slack:
        what = (
            f"largest principal moment{about} exceeds the sum of the others by "
            f"{excess:.6g} kg m2 ({large:.6g} > {middle:.6g} + {small:.6g}); check units, "
            "signs of products of inertia, and the point it is about"
        )
    else:
        return
    raise ModelError(f"{key}: not physical: the {what}")


def check_stop(stop: JointLimit, mechanism: Loaded) -> None:
    """Refuse a stop that is not a range of an R pair's variable."""
    key = f"joint_limits.{stop.pair}"
    need_angle(key, stop.pair, mechanism)
    need_finite(key, (stop.low, stop.high))
    if not stop.low < stop.high:
        raise ModelError(
            f"{key}: the range must rise from `from` to `to`, but it is "
            f"{stop.low:.6g} to {stop.high:.6g} rad"
        )
