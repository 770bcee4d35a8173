"""The base of all loads: their components, the checks of their fields, and torque tables.

A load consists of components. Each has a magnitude, and a pair or moments on links on which
it works. The kinds of loads are in `spherekit.mechanism.load_kinds` and
`spherekit.mechanism.friction`.
"""

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
"""Axes of vector components: ground axes, or the axes of the link that is loaded."""


@dataclass(frozen=True)
class LinkMoment:
    """A moment, or a force at a point, that acts on a link.

    It is a part of a `LoadComponent`, whose magnitude is a function of angles, their rates
    and time. This magnitude times `direction` is the moment or the force.

    Attributes
    ----------
    link
        Name of the link.
    direction
        (3,) direction of the moment or, with `arm`, of a force. A force acts on the link by
        its moment about the centre of the sphere.
    axes
        Axes of the components of `direction`: "ground" or "link".
    arm
        (3,) point of the link (m, link axes) at which the force acts. None for a moment.
    """

    link: str
    direction: Vector
    axes: Axes
    arm: Vector | None = None


@dataclass(frozen=True)
class TorqueCallback:
    """A torque at a pair that a Python function f(t, q, dq) returns.

    The magnitude of a load is an `Expression`, a `TorqueTable`, or an object of this class
    if the user has a Python function. Only computations with numbers can use the function.

    Attributes
    ----------
    pair
        Name of the R pair, whose variable is q.
    function
        The function, which returns N m.
    """

    pair: str
    function: TorqueFunction

    @property
    def names(self) -> frozenset[str]:
        """Names of the variables on which the torque depends, spelled as in expressions.

        The variables are the time, the angle of the pair (joint) and the rate of this
        angle.
        """
        return frozenset({"t", f"theta_{self.pair}", f"dtheta_{self.pair}"})

    def evaluate(self, values: Mapping[str, Floats]) -> Floats:
        """Return the torques (n,), N m.

        Parameters
        ----------
        values
            (n,) values of each of the `names`: s, rad or rad/s.

        Raises
        ------
        ModelError
            If the function returns something that is not a number.
        """
        # The function is called with one number of each, row by row.
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


def require_expression(magnitude: Expression | TorqueCallback) -> Expression:
    """Return a magnitude that is an expression.

    Raises
    ------
    EngineError
        If it is a Python function.
    """
    if isinstance(magnitude, TorqueCallback):
        raise EngineError(no_expression_message(magnitude.pair))
    return magnitude


def no_expression_message(pair: str) -> str:
    """Return the message that a torque at a pair has to be an expression, but is none."""
    return (
        f"the torque at pair {pair} is a Python function, which works only in simulations "
        'with engine="numpy"; state the torque as an expression, or as a table of torques'
    )


@dataclass(frozen=True)
class LoadComponent:
    """A part of a load: a magnitude, and the pair or the links on which it acts.

    Attributes
    ----------
    magnitude
        Function of pair variables, their rates and the time. For friction that follows from
        a reaction (force in a pair), the function is a factor from -1 to 1 with the sign of
        the friction. The size of this friction (N m) is computed later.
    pair
        Name of the pair (joint) at which the component acts, or empty. The power of the
        component is the magnitude times a rate: that of the variable of an R pair, or the
        sliding rate of a contact.
    moments
        Moments on links, if the component does not act at a pair. Each is multiplied by the
        magnitude. The power of a moment is its dot product with the angular velocity of the
        link.
    bearing_friction
        If the component is friction that follows from a reaction, the load with the
        coefficient of this friction. None for other components.
    """

    magnitude: "Expression | TorqueCallback | TorqueTable"
    pair: str = ""
    moments: tuple[LinkMoment, ...] = ()
    bearing_friction: "BearingFriction | None" = None


LoadComponents = tuple[LoadComponent, ...]


class LoadedMechanism(Protocol):
    """The part of `spherekit.mechanism.mechanism.Mechanism` that loads use.

    Loads cannot import the class itself, because a mechanism contains loads.
    """

    @property
    def name(self) -> str:
        """Name of the mechanism."""

    @property
    def ground(self) -> str:
        """Name of the fixed link."""

    @property
    def pairs(self) -> Sequence[Pair]:
        """All pairs."""

    @property
    def masses(self) -> Sequence[Any]:
        """Inertia of links."""

    @property
    def loads(self) -> "Sequence[Load]":
        """All loads."""

    @property
    def angles(self) -> Mapping[str, int]:
        """Indices of the variables that are angles, by R pair."""

    def pair(self, name: str) -> Pair:
        """Return the pair with this name; `ModelError` if there is none."""


class Load(ABC):
    """Base class of everything that acts on a mechanism, except inertia and reactions.

    A load enters the equation of motion by its generalised force: its power per unit rate
    of the coordinate (Di Gregorio 2024, eq. (12)). Reactions of ideal joints have no power.
    """

    name: str

    kind: ClassVar[str]
    """The word for this kind of load in files."""

    field_kinds: ClassVar[Mapping[str, str]]
    """What each field contains, by the name of the field, in the order of files.

    - ``pair``: the name of an R pair
    - ``contact``: the name of a sliding contact
    - ``link``: the name of a link
    - ``axes``: see `Axes`
    - ``text``, ``texts``: one expression, or several
    - ``angle``: an angle (rad)
    - ``rate``: a positive rate (rad/s) below which a jump is smoothed
    - ``vector``, ``numbers``: three numbers, or any number of them
    - ``flag``: true or false
    - any other text: the unit of a number that is not negative
    """

    defaults_in_files: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """Values of fields that files may leave out although the class has no default."""

    velocity_unit: ClassVar[str] = ""
    """Unit of the velocity at which the load works; empty if it has no unit.

    It is the velocity per unit rate of a coordinate. The generalised force of the load is
    its magnitude times this velocity.
    """

    torque_template: ClassVar[str] = ""
    """Expression of the torque of a load that is one torque at a pair, otherwise empty.

    Fields of the load are in braces.
    """

    def check(self, key: str, mechanism: LoadedMechanism) -> None:
        """Check the values of the fields of the load.

        Parameters
        ----------
        key
            Key of the load in the file of the mechanism, for messages.
        mechanism
            The mechanism on which the load acts.

        Raises
        ------
        ModelError
            If a field cannot have its value, such as a negative stiffness.
        """
        for name, field_kind in self.field_kinds.items():
            value = getattr(self, name)
            if value is not None:
                check_field(field_kind, f"{key}.{name}", value, mechanism)

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return the components (magnitudes with their points of action) of the load.

        This method is for loads that are one torque at a pair (joint). The torque is the
        expression `torque_template`, with the values of the fields inserted.
        """
        fields = {
            name: value if isinstance(value, str) else format_number(value)
            for name, value in vars(self).items()
        }
        torque = self.torque_template.format(**fields)
        return (make_component(mechanism, torque, fields["pair"]),)


class BearingFriction(Load):
    """Base class of friction at a pair that follows from the reaction of that pair.

    An R pair (hinge) has friction in its bearings. The friction of a contact is in
    proportion to the push: the moment of its normal force about the centre of the sphere.
    """

    pair: str

    @property
    @abstractmethod
    def friction_coefficient(self) -> float:
        """The friction (N m) divided by the sum of magnitudes of the `supported_loads`.

        For bearings, which support forces (N), the coefficient is a length (m). For a
        contact, where the normal force is stated as a moment (N m), it has no unit.
        """

    @property
    def needs_forces(self) -> bool:
        """Whether the friction depends on the transmitted force as well as on the moment.

        The transmitted force acts through the centre of the sphere and has no moment about
        it. Computing this force takes extra work, which is saved if the friction does not
        depend on the force.
        """
        return False

    @abstractmethod
    def supported_loads(self, moments: Floats, forces: Floats | None = None) -> Floats:
        """Return the loads on the bearings of the pair, or on the contact.

        The friction torque (N m) at the pair is the sum of the magnitudes of these vectors,
        times the `friction_coefficient`. The coefficient is a length (m) for forces on
        bearings, and has no unit for the moment of a contact.

        Parameters
        ----------
        moments
            (..., 3) moment about the centre (N m) that the pair transmits, in pair axes.
        forces
            (..., 3) force through the centre (N) that the pair transmits, in pair axes.
            None if it was not computed. Bearings then get only the loads of the moment. The
            load of a contact does not depend on the force.

        Returns
        -------
        (..., k, 3) loads in pair axes: the forces (N) on the k bearings of an R pair. For a
        contact, k is 1, and the load is the moment (N m) of its normal force.
        """


@checked_class(ModelError, "at")
@dataclass(frozen=True)
class TorqueTable(Load):
    """A torque at an R pair that is given at some times and linear in between.

    Attributes
    ----------
    name
        Name of the load.
    pair
        Name of the R pair.
    times
        Rising times (s).
    torques
        Torques (N m) at these times.
    periodic
        Whether the torque repeats with the period ``times[-1] - times[0]``.
    """

    kind = "table"
    field_kinds = MappingProxyType(
        {"pair": "pair", "times": "numbers", "torques": "numbers", "periodic": "flag"}
    )

    name: str
    pair: str
    times: Numbers
    torques: Numbers
    periodic: bool = False

    def at(self, t: ArrayLike) -> Floats:
        """Return the torques (N m) of the table at times (s) of any shape, interpolated.

        Raises
        ------
        ModelError
            If a time is outside the table or not finite, and the table is not periodic.
        """
        t = np.asarray(t, dtype=np.float64)
        first = self.times[0]
        last = self.times[-1]
        if self.periodic:
            t = first + np.mod(t - first, last - first)
        elif not np.all(np.isfinite(t)):
            invalid_time = np.min(t[~np.isfinite(t)])
            raise ModelError(
                f"loads.{self.name}: found the time {invalid_time:.6g} s, expected finite "
                "times"
            )
        elif not np.all((t >= first) & (t <= last)):
            raise ModelError(
                f"loads.{self.name}: the load is needed from {np.min(t):.6g} to "
                f"{np.max(t):.6g} s, but its table covers {first:.6g} to {last:.6g} s; add "
                "rows, or set periodic = true"
            )
        return np.asarray(np.interp(t, self.times, self.torques), dtype=np.float64)

    def knots(self, start: float, stop: float) -> Iterator[float]:
        """Yield the times (s) at which the slope of the torque changes.

        An integrator ends its steps there. All such times from `start` to `stop` (s) are
        among the results. The results can contain other times and repetitions.
        """
        if not self.periodic:
            yield from self.times
            return
        period = self.times[-1] - self.times[0]
        first_period = math.floor((start - self.times[-1]) / period)
        last_period = math.ceil((stop - self.times[0]) / period)
        for number in range(first_period, last_period + 1):
            yield from (t + number * period for t in self.times)

    def check(self, key: str, mechanism: LoadedMechanism) -> None:
        """Check the fields, and that a periodic table ends with its first torque."""
        super().check(key, mechanism)
        check_table_rows(
            f"{key}.", "torques", times=self.times, values=self.torques, min_rows=2
        )
        if self.periodic and self.torques[0] != self.torques[-1]:
            raise ModelError(
                f"{key}.torques: a periodic table must start and end with the same torque, "
                f"but this one has {self.torques[0]:g} and {self.torques[-1]:g} N m"
            )

    def components(self, mechanism: LoadedMechanism) -> LoadComponents:
        """Return one load component, whose magnitude is the table itself."""
        return (LoadComponent(self, self.pair),)


def check_field(kind: str, key: str, value: Any, mechanism: LoadedMechanism) -> None:
    """Check the value of a field of a load.

    Parameters
    ----------
    kind
        What the field contains, as in `Load.field_kinds`. For example, "pair" means the
        name of an R pair. A unit such as "N m" means a number in this unit that is not
        negative.
    key
        Key of the field in the file of the mechanism, for messages.
    value
        Value of the field.
    mechanism
        The mechanism on which the load acts.

    Raises
    ------
    ModelError
        If the field cannot have this value.
    """
    match kind:
        case "pair":
            check_angle_pair(key, value, mechanism)
        case "contact":
            pair = mechanism.pair(value)
            if pair.type != "Cs":
                sliding = listing(x.name for x in mechanism.pairs if x.type == "Cs")
                raise ModelError(
                    f'{key}: "{value}" is of type {pair.type}, whose links do not slide on '
                    "each other; for friction at an R pair use a load of kind friction or "
                    f"bearings. Cs pairs: {sliding or 'none'}"
                )
        case "text" if callable(value):
            # The signature shows, without a call, whether the function takes (t, q, dq).
            with suppress(ValueError):  # functions of compiled modules can lack one
                try:
                    inspect.signature(value).bind(0.0, 0.0, 0.0)
                except TypeError as error:
                    raise ModelError(
                        f"{key}: the function must accept three arguments (t, q, dq): the "
                        "time, and the variable and the rate of the pair; calling it with "
                        f"them fails: {error}"
                    ) from None
        case "text":
            _check_expression(key, value, mechanism)
        case "texts":
            for index, text in enumerate(value):
                _check_expression(f"{key}[{index}]", text, mechanism)
        case "vector" | "numbers":
            check_finite(key, value)
        case "angle":
            check_finite(key, [value])
        case "rate":
            check_finite(key, [value])
            if value <= 0:
                raise ModelError(
                    f"{key}: found {value:g} rad/s, expected more than 0; below this rate, "
                    "the jump of dry friction at zero speed is smoothed"
                )
        case "link" | "axes" | "flag":
            pass
        case unit:
            check_not_negative(key, value, unit)


def check_angle_pair(key: str, pair: str, mechanism: LoadedMechanism) -> None:
    """Check that the variable of a pair (joint) is an angle, as loads at a pair require.

    Parameters
    ----------
    key
        Key in the file of the mechanism, for the message.
    pair
        Name of the pair.
    mechanism
        The mechanism of the pair.

    Raises
    ------
    ModelError
        If the pair is a contact. Its variables are arc lengths.
    """
    if pair in mechanism.angles:
        return
    raise ModelError(
        f'{key}: "{pair}" is a contact pair ({mechanism.pair(pair).type}), whose variables '
        "are arc lengths; only R pairs have torques and joint limits. R pairs: "
        f"{listing(mechanism.angles)}"
    )


def _check_expression(key: str, text: Any, mechanism: LoadedMechanism) -> None:
    """Raise `ModelError` if a field is no expression in angles, their rates and time."""
    if not isinstance(text, str):
        raise ModelError(
            f'{key}: found {text!r}, expected an expression in quotes, such as "0.5*sin(t)"'
        )
    try:
        parse(text, load_names(mechanism.angles))
    except ModelError as error:
        raise ModelError(f"{key}: in the expression, {error}") from None


def check_not_negative(key: str, number: float, unit: str) -> None:
    """Raise `ModelError` if a number, of this unit, is negative or not finite."""
    check_finite(key, [number])
    if number < 0:
        is_torque = unit.startswith("N m")
        hint = (
            '; for a load that drives the mechanism, use kind = "torque" with an expression'
        )
        raise ModelError(
            f"{key}: found {f'{number:g} {unit}'.rstrip()}, expected at least "
            f"0{hint if is_torque else ''}"
        )


def make_component(
    mechanism: LoadedMechanism,
    magnitude: str,
    pair: str = "",
    moments: tuple[LinkMoment, ...] = (),
    bearing_friction: BearingFriction | None = None,
) -> LoadComponent:
    """Return a component of a load from the text of its magnitude.

    Parameters
    ----------
    mechanism
        The mechanism whose R pairs have the variables.
    magnitude
        The expression of pair variables, rates and the time, such as ``-2.0*dtheta_21``.
    pair
        Name of the pair (joint) at which the component acts, or empty.
    moments
        Vectors of moments on links if there is no pair. The magnitude multiplies them.
    bearing_friction
        The load of the mechanism file that states this friction, if the component is
        friction in a bearing or contact. Its size follows from the reaction there, and the
        magnitude is only a factor between -1 and 1.
    """
    expression = parse(magnitude, load_names(mechanism.angles))
    return LoadComponent(
        magnitude=expression,
        pair=pair,
        moments=moments,
        bearing_friction=bearing_friction,
    )


def format_number(value: float) -> str:
    """Return a number as a magnitude contains it: in parentheses, with all digits."""
    return f"({float(value)!r})"
