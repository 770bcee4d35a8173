"""What a load is made of: magnitudes, and what they work on."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import EngineError, ModelError
from spherekit.model.expression import Expression, load_names, parse

if TYPE_CHECKING:
    from spherekit.model.bearings import Rubbing
    from spherekit.model.mechanism import Mechanism
    from spherekit.model.torque_table import TorqueTable


Vector = tuple[float, float, float]
TorqueFunction = Callable[[float, float, float], float]
"""A torque (N m) from the time t (s), the variable q (rad) and the rate dq (rad/s)."""
Axes = Literal["ground", "link"]
"""Whether components are along the axes of the ground or of the link acted on."""


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

    A component at `pair` works on the rate of the pair's variable, of a contact on that at
    which its second link slides along the first; otherwise on the angular velocities of
    links through `moments`, each times the magnitude. The magnitude of what `rubs` is per
    N m of its friction.
    """

    magnitude: "Expression | Called | TorqueTable"
    pair: str = ""
    moments: tuple[LinkMoment, ...] = ()
    rubs: "Rubbing | None" = None


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


def vector_of(numbers: Iterable[float]) -> Vector:
    """Return three numbers as floats."""
    x, y, z = map(float, numbers)
    return x, y, z


def law_of(mechanism: "Mechanism", text: str) -> Expression:
    """Return a magnitude written in pair variables, their rates and the time."""
    return parse(text, load_names(mechanism.angles))


def number_text(value: float) -> str:
    """Return a number as it is written in a magnitude."""
    return f"({float(value)!r})"
