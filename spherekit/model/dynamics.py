"""What acts on the links of a mechanism: inertia, loads, and stops of pairs."""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked_class
from spherekit.conventions import counted, listing
from spherekit.errors import EngineError, ModelError
from spherekit.model.expression import Expression, load_names, parse
from spherekit.model.laws import need_increasing
from spherekit.model.needs import (
    need_angle,
    need_at_least_zero,
    need_expression,
    need_finite,
    need_function,
    need_smoothing,
)

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism

Vector = tuple[float, float, float]
Tensor = tuple[Vector, Vector, Vector]
Expressions = tuple[str, str, str]

TorqueFunction = Callable[[float, float, float], float]
"""A torque (N m) from the time t (s), the variable q (rad) and the rate dq (rad/s)."""

Axes = Literal["ground", "link"]
"""Whether components are along the axes of the ground or of the link acted on."""

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
@dataclass(frozen=True)
class LinkMoment:
    """A moment about the centre of the sphere, on a link.

    It is `direction`, or that of a force `direction` at `arm` (m, link axes), where there
    is an arm. The direction is along the axes of the ground or of the link.
    """

    link: str
    direction: Vector
    axes: Axes
    arm: Vector | None = None


@final
@dataclass(frozen=True)
class Called:
    """A torque that a function f(t, q, dq) gives, of a pair's variable and rate.

    It stands where an `Expression` may, for what evaluates magnitudes at states.
    """

    pair: str
    function: TorqueFunction

    @property
    def names(self) -> frozenset[str]:
        """What it depends on, as an expression would say it."""
        return frozenset({"t", f"theta_{self.pair}", f"dtheta_{self.pair}"})

    def evaluate(self, values: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return the torque (n,) N m at the values of its names, each (n,).

        Raises
        ------
        ModelError
            If the function returns what is not a number.
        """
        states = (values["t"], values[f"theta_{self.pair}"], values[f"dtheta_{self.pair}"])
        torques = []
        for state in zip(*(x.tolist() for x in np.broadcast_arrays(*states)), strict=True):
            torque = self.function(*state)
            try:
                torques.append(float(torque))
            except (TypeError, ValueError):
                t, q, dq = state
                raise ModelError(
                    f"the torque at pair {self.pair}: the function returned {torque!r} at "
                    f"t = {t:g}, q = {q:g}, dq = {dq:g}; it has to return a number (N m)"
                ) from None
        return np.array(torques)


def expression_of(magnitude: "Expression | Called") -> Expression:
    """Return the expression of a magnitude; `EngineError` for a function."""
    if isinstance(magnitude, Called):
        raise EngineError(not_written(magnitude.pair))
    return magnitude


def not_written(pair: str) -> str:
    """Return what is to be said where a torque had to be an expression."""
    return (
        f"the torque at pair {pair} is a Python function, which only simulations by NumPy "
        "can call; write it as an expression, or as a table of torques"
    )


@final
@dataclass(frozen=True)
class Component:
    """A part of a load: a magnitude, and the pair or the moments on links it works on.

    A component at `pair` works on the rate of the pair's variable; otherwise on the
    angular velocities of links through `moments`, each times the magnitude. With
    `bearings` the magnitude is per N m of the friction that they have.
    """

    magnitude: "Expression | Called | TorqueTable"
    pair: str = ""
    moments: tuple[LinkMoment, ...] = ()
    bearings: "Bearings | None" = None


Form = Literal[
    "pair", "link", "text", "texts", "number", "numbers", "vector", "angle", "rate", "flag"
]
"""What a key of a file holds; angles (rad) and rates (rad/s) are there in its unit."""


class Load(ABC):
    """What acts on a mechanism; a kind says all there is to say of it.

    Its generalised force is its power per unit rate of the coordinate (Di Gregorio 2024,
    eq. (12)); reactions at ideal pairs have none.
    """

    name: str
    kind: ClassVar[str]
    """The word in files."""
    keys: ClassVar[Mapping[str, Form]]
    """Its fields in files, in the order in which they are written."""
    absent: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """What fields without a default are where a file leaves them out."""
    velocity_unit: ClassVar[str] = ""
    """The unit of what its components work on, per unit rate of an angle."""

    @abstractmethod
    def check(self, key: str, mechanism: "Mechanism") -> None:
        """Raise `ModelError` where its numbers or places at a key have no meaning.

        The links and pairs that it names exist.
        """

    @abstractmethod
    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        """Return what it is made of: magnitudes, and what they work on."""


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
            return (Component(_law(mechanism, self.torque), self.pair),)
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
            at = _floats(mass.centre)
            weights.append(LinkMoment(mass.link, (x, y, z), "ground", at))
        return (Component(_law(mechanism, "1"), moments=tuple(weights)),)


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
        return _on_link(mechanism, self, self.force, _floats(self.point))


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
        away = f"(theta_{self.pair} - {_number(self.rest)})"
        torque = f"-{_number(self.stiffness)}*{away}"
        return (Component(_law(mechanism, torque), self.pair),)


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
        torque = f"-{_number(self.damping)}*dtheta_{self.pair}"
        return (Component(_law(mechanism, torque), self.pair),)


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
        dry = f"{_number(self.torque)}*tanh({rate}/{_number(self.speed)})"
        torque = f"-({dry} + {_number(self.viscous)}*{rate})"
        return (Component(_law(mechanism, torque), self.pair),)


@final
@checked_class(ModelError)
@dataclass(frozen=True)
class Bearings(Load):
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
            "radius": "number",
            "coefficient": "number",
            "speed": "rate",
        }
    )
    absent = MappingProxyType(
        {"axial": None, "radius": 0.0, "coefficient": 0.0, "speed": 1e-3}
    )

    name: str
    pair: str
    positions: tuple[float, ...]
    radius: float = 0.0
    coefficient: float = 0.0
    speed: float = 1e-3
    axial: tuple[float, ...] | None = None

    @property
    def floats(self) -> bool:
        """Whether the pair transmits no force along its axis."""
        return self.axial is not None and not any(self.axial)

    @property
    def grip(self) -> float:
        """The friction (N m) per force (N) on the bearings."""
        return self.coefficient * self.radius

    def carried(
        self, moments: NDArray[np.float64], forces: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Return the forces (..., bearings, 3) N on the bearings, in pair axes.

        They have the moment about the centre that the pair transmits (..., 3) N m and,
        with the force through it (..., 3) N, this for their sum; without, they are those
        of the couple alone. Along the axis they are NaN where `axial` is not said.
        """
        bent = np.stack(
            [moments[..., 1], -moments[..., 0], np.zeros(moments.shape[:-1])], axis=-1
        )
        first, *rest = self.positions
        pull = np.zeros_like(bent) if forces is None else forces * [1.0, 1.0, 0.0]
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

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_angle(f"{key}.pair", self.pair, mechanism)
        need_finite(f"{key}.positions", self.positions)
        first, *rest = self.positions or (0.0,)
        if len(rest) > 1 or (rest[0] == first if rest else first == 0.0):
            raise ModelError(
                f"{key}.positions: found {list(self.positions)} m, needs one that is not "
                "0, or two that differ: distances of the bearings from the centre along "
                "the axis"
            )
        if self.axial is not None:
            self._check_axial(f"{key}.axial", self.axial)
        need_at_least_zero(f"{key}.radius", self.radius, "m")
        need_at_least_zero(f"{key}.coefficient", self.coefficient, "")
        need_smoothing(f"{key}.speed", self.speed)
        for load in mechanism.loads:
            if isinstance(load, Bearings) and load.pair == self.pair and load != self:
                raise ModelError(
                    f"{key}.pair: loads.{load.name} has the bearings of pair {self.pair} "
                    "too; give both positions in one of them"
                )

    def _check_axial(self, key: str, axial: tuple[float, ...]) -> None:
        for part in axial:
            need_at_least_zero(key, part, "")
        whole = abs(sum(axial) - 1.0) < 1e-9
        if len(axial) != len(self.positions) or not (whole or not any(axial)):
            raise ModelError(
                f"{key}: found {list(axial)}, needs one part for each of the "
                f"{len(self.positions)} positions, 1 in all (a fixed bearing takes 1, a "
                "floating one 0), or 0 for each where the pair lets its links slide along "
                "its axis"
            )

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        rate = f"dtheta_{self.pair}"
        text = f"-tanh({rate}/{_number(self.speed)})" if self.grip > 0.0 else "0"
        return (Component(_law(mechanism, text), self.pair, bearings=self),)


def need_no_rubbing(mechanism: "Mechanism", what: str) -> None:
    """Raise `ModelError` if friction follows from reactions, which `what` does not know."""
    for load in mechanism.loads:
        if isinstance(load, Bearings) and load.grip > 0.0:
            raise ModelError(
                f"{mechanism.name}: loads.{load.name}: its friction follows from the "
                f"reaction of pair {load.pair}, which {what}; take a load of kind friction "
                "there, whose torque the analysis reactions can tell, or coefficient = 0"
            )


@final
@checked_class(ModelError, "at")
@dataclass(frozen=True)
class TorqueTable(Load):
    """A torque (N m) at an R pair given at increasing times (s), linear in between.

    A periodic one repeats with the period ``times[-1] - times[0]``.
    """

    kind = "table"
    keys = MappingProxyType(
        {"pair": "pair", "times": "numbers", "torques": "numbers", "periodic": "flag"}
    )

    name: str
    pair: str
    times: tuple[float, ...]
    torques: tuple[float, ...]
    periodic: bool = False

    def at(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the torque (N m) at times (s) of any shape.

        Raises
        ------
        ModelError
            If a time is outside the table and the table is not periodic.
        """
        t = np.asarray(t, dtype=np.float64)
        first, last = self.times[0], self.times[-1]
        if self.periodic:
            t = first + np.mod(t - first, last - first)
        elif not np.all((t >= first) & (t <= last)):
            raise ModelError(
                f"loads.{self.name}: asked for t from {np.min(t):.6g} to {np.max(t):.6g} "
                f"s, but the table has {first:.6g} to {last:.6g} s; add rows, or set "
                "periodic = true"
            )
        return np.asarray(np.interp(t, self.times, self.torques), dtype=np.float64)

    def one(self, t: float) -> float:
        """Return the torque (N m) at one time (s): the same as `at`, in less time."""
        first, last = self.times[0], self.times[-1]
        if self.periodic:
            t = first + (t - first) % (last - first)
        elif not first <= t <= last:
            return float(self.at(t))
        after = min(bisect_right(self.times, t), len(self.times) - 1)
        start, before = self.times[after - 1], self.torques[after - 1]
        slope = (self.torques[after] - before) / (self.times[after] - start)
        return before + slope * (t - start)

    def knots(self, start: float, stop: float) -> Iterator[float]:
        """Yield the times (s) at which the slope changes, all between two and others."""
        if not self.periodic:
            yield from self.times
            return
        period = self.times[-1] - self.times[0]
        first = int(np.floor((start - self.times[-1]) / period))
        last = int(np.ceil((stop - self.times[0]) / period))
        for turn in range(first, last + 1):
            yield from (t + turn * period for t in self.times)

    def check(self, key: str, mechanism: "Mechanism") -> None:
        need_angle(f"{key}.pair", self.pair, mechanism)
        if len(self.times) != len(self.torques):
            raise ModelError(
                f"{key}.torques: has {counted(len(self.torques), 'value')}, but times has "
                f"{len(self.times)}"
            )
        if len(self.times) < 2:
            has = counted(len(self.times), "value")
            raise ModelError(f"{key}.times: has {has}, needs at least 2")
        need_finite(f"{key}.times", self.times)
        need_finite(f"{key}.torques", self.torques)
        need_increasing(f"{key}.times", self.times)
        if self.periodic and self.torques[0] != self.torques[-1]:
            raise ModelError(
                f"{key}.torques: a periodic table ends with the torque it starts with, but "
                f"this one has {self.torques[0]:g} and {self.torques[-1]:g} N m"
            )

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        return (Component(self, self.pair),)


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
            TorqueTable,
        )
    }
)
"""The kinds of loads by their words in files; without one it is a torque."""


_UNITS: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _law(mechanism: "Mechanism", text: str) -> Expression:
    return parse(text, load_names(mechanism.angles))


def _floats(given: Vector) -> Vector:
    x, y, z = map(float, given)
    return x, y, z


def _number(value: float) -> str:
    return f"({float(value)!r})"


def _on_link(
    mechanism: "Mechanism",
    load: PointForce | Moment,
    texts: Expressions,
    arm: Vector | None,
) -> tuple[Component, ...]:
    return tuple(
        Component(
            _law(mechanism, text), moments=(LinkMoment(load.link, axis, load.axes, arm),)
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
