"""What loads do: each a sum of components, a magnitude times the velocity it works on.

A load's generalised force is its power per unit rate of the coordinate (Di Gregorio
2024, eq. (12)); reactions at ideal pairs have none. A magnitude depends on the pair
variables, their rates and the time; the velocity on the configuration only. A torque
works on the rate of its pair; a force and a moment on a link work on the angular velocity
of the link through their moment about the centre of the sphere.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import EngineError, ModelError
from spherekit.model.dynamics import (
    Axes,
    Damper,
    Expressions,
    Friction,
    Gravity,
    Load,
    Moment,
    PairTorque,
    PointForce,
    Spring,
    TorqueFunction,
    TorqueTable,
    Vector,
)
from spherekit.model.expression import Expression, load_names, parse
from spherekit.model.mechanism import Mechanism


@final
@dataclass(frozen=True)
class LinkMoment:
    """A moment about the centre of the sphere, on a link.

    It is `direction`, or the cross product of `arm` (m, link axes) with it, where there
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

    def evaluate(self, known: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return the torque (n,) N m at the values of its names, each (n,).

        Raises
        ------
        ModelError
            If the function returns what is not a number.
        """
        states = (known["t"], known[f"theta_{self.pair}"], known[f"dtheta_{self.pair}"])
        found = []
        for state in zip(*(x.tolist() for x in np.broadcast_arrays(*states)), strict=True):
            torque = self.function(*state)
            try:
                found.append(float(torque))
            except (TypeError, ValueError):
                t, q, dq = state
                raise ModelError(
                    f"the torque at pair {self.pair}: the function returned {torque!r} at "
                    f"t = {t:g}, q = {q:g}, dq = {dq:g}; it has to return a number (N m)"
                ) from None
        return np.array(found)


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
    angular velocities of links through `moments`, each times the magnitude.
    """

    magnitude: Expression | Called | TorqueTable
    pair: str = ""
    moments: tuple[LinkMoment, ...] = ()


def components(mechanism: Mechanism, load: Load) -> tuple[Component, ...]:
    """Return the components of one of a mechanism's loads."""
    if isinstance(load, Gravity):
        return (Component(_law(mechanism, "1"), moments=_weights(mechanism, load)),)
    if isinstance(load, PointForce):
        return _on_link(mechanism, load, load.force, _floats(load.point))
    if isinstance(load, Moment):
        return _on_link(mechanism, load, load.moment, None)
    if isinstance(load, TorqueTable):
        return (Component(load, load.pair),)
    if isinstance(load, PairTorque) and not isinstance(load.torque, str):
        return (Component(Called(load.pair, load.torque), load.pair),)
    return (Component(_law(mechanism, _torque(load)), load.pair),)


def used_pairs(mechanism: Mechanism) -> frozenset[str]:
    """Return the R pairs whose variable or rate the loads depend on."""
    names = _revolute(mechanism)
    found: set[str] = set()
    for part in _all(mechanism):
        if part.pair:
            found.add(part.pair)
        if isinstance(part.magnitude, Expression):
            used = part.magnitude.names
            found |= {n for n in names if {f"theta_{n}", f"dtheta_{n}"} & used}
    return frozenset(found)


def smooth(mechanism: Mechanism) -> bool:
    """Return whether no load has kinks or jumps, those of tables left out."""
    laws = [part.magnitude for part in _all(mechanism)]
    return all(law.smooth for law in laws if isinstance(law, Expression))


def steep(mechanism: Mechanism) -> tuple[Expression, ...]:
    """Return the arguments in all loads at whose zeros and turns these may change at once.

    See `spherekit.model.expression.Expression.steep`; the knots of tables are known.
    """
    laws = [part.magnitude for part in _all(mechanism)]
    every = [law.steep for law in laws if isinstance(law, Expression)]
    return tuple({each.root: each for own in every for each in own}.values())


def used_links(mechanism: Mechanism) -> frozenset[str]:
    """Return the links whose angular velocity or orientation the loads depend on."""
    return frozenset(m.link for part in _all(mechanism) for m in part.moments)


_UNITS: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _all(mechanism: Mechanism) -> Sequence[Component]:
    return [part for load in mechanism.loads for part in components(mechanism, load)]


def _revolute(mechanism: Mechanism) -> list[str]:
    return [pair.name for pair in mechanism.pairs if pair.type == "R"]


def _law(mechanism: Mechanism, text: str) -> Expression:
    return parse(text, load_names(_revolute(mechanism)))


def _torque(load: PairTorque | Spring | Damper | Friction) -> str:
    """Return the torque of a load at its pair as an expression."""
    if isinstance(load, PairTorque):
        assert isinstance(load.torque, str)
        return load.torque
    angle, rate = f"theta_{load.pair}", f"dtheta_{load.pair}"
    if isinstance(load, Spring):
        return f"-{_number(load.stiffness)}*({angle} - {_number(load.rest)})"
    if isinstance(load, Damper):
        return f"-{_number(load.damping)}*{rate}"
    dry = f"{_number(load.torque)}*tanh({rate}/{_number(load.speed)})"
    return f"-({dry} + {_number(load.viscous)}*{rate})"


def _floats(given: Vector) -> Vector:
    x, y, z = map(float, given)
    return x, y, z


def _number(value: float) -> str:
    return f"({float(value)!r})"


def _on_link(
    mechanism: Mechanism,
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


def _weights(mechanism: Mechanism, load: Gravity) -> tuple[LinkMoment, ...]:
    found = []
    for mass in mechanism.masses:
        if mass.link == mechanism.ground:
            continue
        assert mass.mass is not None and mass.centre is not None
        x, y, z = (mass.mass * each for each in _floats(mass.centre))
        down = _floats(load.acceleration)
        found.append(LinkMoment(mass.link, down, "ground", (x, y, z)))
    return tuple(found)
