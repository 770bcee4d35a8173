"""What a load is made of: magnitudes, and what they work on."""

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.errors import EngineError, ModelError
from spherekit.mechanism.elements import Pair, check_table_rows
from spherekit.mechanism.joint import Numbers
from spherekit.mechanism.load_expression import Expression, load_names, parse
from spherekit.mechanism.sizes import Vector, check_finite
from spherekit.wording import listing

TorqueFunction = Callable[[float, float, float], float]
"""A torque (N m) from the time t (s), the variable q (rad) and the rate dq (rad/s)."""
Axes = Literal["ground", "link"]
"""Whether components are along the axes of the ground or of the link acted on."""


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

    def evaluate(self, values: Mapping[str, Floats]) -> Floats:
        """Return the torque (n,) N m at the values of its names, each (n,).

        Raises
        ------
        ModelError
            If the function returns what is not a number.
        """
        states = (values["t"], values[f"theta_{self.pair}"], values[f"dtheta_{self.pair}"])
        torques = []
        for t, q, dq in np.transpose(np.broadcast_arrays(*states)).tolist():
            torque = self.function(t, q, dq)
            try:
                torques.append(float(torque))
            except (TypeError, ValueError):
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


@dataclass(frozen=True)
class Component:
    """A part of a load: a magnitude, and the pair or the moments on links it works on.

    A component at `pair` works on the rate of the pair's variable, of a contact on that at
    which its second link slides along the first; otherwise on the angular velocities of
    links through `moments`, each times the magnitude. The magnitude of what `rubs` is per
    N m of its friction.
    """

    magnitude: "Expression | Called | TorqueTable"
    pair: str = ""
    moments: tuple[LinkMoment, ...] = ()
    rubs: "BearingFriction | None" = None


Components = tuple[Component, ...]


class Loaded(Protocol):
    """A mechanism as what acts on it sees it."""

    @property
    def name(self) -> str:
        """See `Mechanism`."""

    @property
    def ground(self) -> str:
        """See `Mechanism`."""

    @property
    def pairs(self) -> Sequence[Pair]:
        """See `Mechanism`."""

    @property
    def masses(self) -> Sequence[Any]:
        """See `Mechanism`."""

    @property
    def loads(self) -> "Sequence[Load]":
        """See `Mechanism`."""

    @property
    def angles(self) -> Mapping[str, int]:
        """See `Mechanism`."""

    def pair(self, name: str) -> Pair:
        """See `Mechanism`."""


class Load(ABC):
    """What acts on a mechanism; a kind says all there is to say of it.

    Its generalised force is its power per unit rate of the coordinate (Di Gregorio 2024,
    eq. (12)); reactions at ideal pairs have none.
    """

    name: str
    kind: ClassVar[str]
    """The word in files."""
    keys: ClassVar[Mapping[str, str]]
    """Its fields in files, in the order in which they are written, and what each holds.

    That is an R pair, a sliding contact, a link, axes, a text or texts (expressions), an
    angle (rad), a rate (rad/s) that smooths a jump, a vector, numbers or a flag; of a
    number that is not negative, its unit.
    """
    absent: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """What fields without a default are where a file leaves them out."""
    velocity_unit: ClassVar[str] = ""
    """The unit of what its components work on, per unit rate of an angle."""
    law: ClassVar[str] = ""
    """The torque at its pair as an expression, its fields in braces, if that is all."""

    def check(self, key: str, mechanism: Loaded) -> None:
        """Raise `ModelError` where its numbers or places at a key have no meaning.

        The links and pairs that it names exist.
        """
        for name, holds in self.keys.items():
            value = getattr(self, name)
            if value is not None:
                need(holds, f"{key}.{name}", value, mechanism)

    def components(self, mechanism: Loaded) -> Components:
        """Return what it is made of: magnitudes, and what they work on."""
        given = {
            name: x if isinstance(x, str) else number_text(x)
            for name, x in vars(self).items()
        }
        return acting(mechanism, self.law.format(**given), given["pair"])


class BearingFriction(Load):
    """A load at a pair whose friction follows from the reaction of that pair."""

    pair: str

    @property
    @abstractmethod
    def grip(self) -> float:
        """The friction (N m) per unit of what is `carried`."""

    @property
    def asks_forces(self) -> bool:
        """Whether it follows from the force through the centre too."""
        return False

    @abstractmethod
    def carried(self, moments: Floats, forces: Floats | None = None) -> Floats:
        """Return the vectors (..., places, 3) whose lengths in sum the friction follows.

        `moments` (..., 3) N m and `forces` (..., 3) N are those of the pair, in its axes.
        """


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
    times: Numbers
    torques: Numbers
    periodic: bool = False

    def at(self, t: ArrayLike) -> Floats:
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

    def knots(self, start: float, stop: float) -> Iterator[float]:
        """Yield the times (s) at which the slope changes, all between two and others."""
        if not self.periodic:
            yield from self.times
            return
        period = self.times[-1] - self.times[0]
        first = math.floor((start - self.times[-1]) / period)
        for turn in range(first, math.ceil((stop - self.times[0]) / period) + 1):
            yield from (t + turn * period for t in self.times)

    def check(self, key: str, mechanism: Loaded) -> None:
        """See `Load`."""
        super().check(key, mechanism)
        check_table_rows(f"{key}.", "torques", self.times, self.torques, 2)
        if self.periodic and self.torques[0] != self.torques[-1]:
            raise ModelError(
                f"{key}.torques: a periodic table ends with the torque it starts with, but "
                f"this one has {self.torques[0]:g} and {self.torques[-1]:g} N m"
            )

    def components(self, mechanism: Loaded) -> Components:
        """See `Load`."""
        return (Component(self, self.pair),)


def need(holds: str, key: str, value: Any, mechanism: Loaded) -> None:
    """Refuse what a key cannot hold; see `Load.keys`."""
    match holds:
        case "pair":
            need_angle(key, value, mechanism)
        case "contact":
            pair = mechanism.pair(value)
            if pair.type != "Cs":
                sliding = listing(x.name for x in mechanism.pairs if x.type == "Cs")
                raise ModelError(
                    f'{key}: "{value}" is of type {pair.type}, whose links do not slide on '
                    "each other; that of an R pair is a load of kind friction or "
                    f"bearings. Cs pairs: {sliding or 'none'}"
                )
        case "text" if callable(value):
            with suppress(ValueError):  # those of compiled modules have no signature
                try:
                    inspect.signature(value).bind(0.0, 0.0, 0.0)
                except TypeError as error:
                    raise ModelError(
                        f"{key}: the function has to take time, variable and rate "
                        f"(t, q, dq): {error}"
                    ) from None
        case "text":
            _need_expression(key, value, mechanism)
        case "texts":
            for number, text in enumerate(value):
                _need_expression(f"{key}[{number}]", text, mechanism)
        case "vector" | "numbers":
            check_finite(key, value)
        case "angle" | "rate":
            check_finite(key, [value])
            if holds == "rate" and value <= 0:
                raise ModelError(
                    f"{key}: found {value:g} rad/s, needs more than 0: the rate below "
                    "which the jump of dry friction is smoothed"
                )
        case "link" | "axes" | "flag":
            pass
        case unit:
            need_at_least_zero(key, value, unit)


def need_angle(key: str, pair: str, mechanism: Loaded) -> None:
    """Refuse a pair whose variable is not an angle, at a key."""
    if pair in mechanism.angles:
        return
    raise ModelError(
        f'{key}: "{pair}" is a contact pair ({mechanism.pair(pair).type}), whose variables '
        "are arc lengths; only R pairs have torques and joint limits. R pairs: "
        f"{listing(mechanism.angles)}"
    )


def _need_expression(key: str, text: Any, mechanism: Loaded) -> None:
    """Refuse a text that is not an expression in the variables of R pairs and the time."""
    if not isinstance(text, str):
        raise ModelError(
            f'{key}: found {text!r}, needs an expression in quotes, such as "0.5*sin(t)"'
        )
    try:
        parse(text, load_names(mechanism.angles))
    except ModelError as error:
        raise ModelError(f"{key}: in the expression, {error}") from None


def need_at_least_zero(key: str, number: float, unit: str) -> None:
    """Refuse a number that is negative or not finite."""
    check_finite(key, [number])
    if number < 0:
        torque = "; what pushes or drives is a load of kind torque, an expression"
        hint = torque if unit.startswith("N m") else ""
        raise ModelError(f"{key}: found {number:g} {unit}, needs at least 0{hint}")


def acting(
    mechanism: Loaded,
    text: str,
    pair: str = "",
    moments: tuple[LinkMoment, ...] = (),
    rubs: BearingFriction | None = None,
) -> tuple[Component]:
    """Return a component with a magnitude in pair variables, their rates and the time."""
    return (Component(parse(text, load_names(mechanism.angles)), pair, moments, rubs),)


def number_text(value: float) -> str:
    """Return a number as it is written in a magnitude."""
    return f"({float(value)!r})"
