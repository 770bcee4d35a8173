"""The loads and stops of a mechanism in what MuJoCo has, and those that it has not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np

from spherekit.model.dynamics import (
    Damper,
    Friction,
    Gravity,
    Moment,
    PairTorque,
    PointForce,
    Spring,
)
from spherekit.model.expression import ON_ARRAYS, Expression, fold
from spherekit.model.load import Called, Component, Load, TorqueTable
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

Bias = tuple[float, float, float]


@final
@dataclass
class AtHinge:
    """What a hinge holds: springs (stiffness and what it takes to zero), friction, stop."""

    stiffness: float = 0.0
    pull: float = 0.0
    damping: float = 0.0
    dry: float = 0.0
    stop: tuple[float, float] | None = None

    @property
    def rest(self) -> float:
        """The variable (rad) at which all springs together pull nowhere."""
        return self.pull / self.stiffness if self.stiffness else 0.0


@final
@dataclass(frozen=True)
class Actuated:
    """A load that is an actuator without control.

    At a pair it has the torque ``bias[0] + bias[1] variable + bias[2] rate``; otherwise it
    is a force, or a moment, on a link, constant in the axes of the ground or of the link.
    """

    name: str
    pair: str = ""
    bias: Bias = (1.0, 0.0, 0.0)
    load: PointForce | Moment | None = None
    vector: tuple[float, ...] = ()


@final
@dataclass(frozen=True)
class MujocoLoads:
    """What MuJoCo has of a mechanism's loads; `lost` are the others with the reason."""

    hinges: Mapping[str, AtHinge]
    actuated: Sequence[Actuated]
    gravity: tuple[float, float, float]
    lost: Mapping[str, str]
    otherwise: Sequence[str] = field(default=())

    @property
    def held(self) -> list[str]:
        """The pairs that loads or stops need as hinges."""
        pairs = [pair for pair, here in self.hinges.items() if here != AtHinge()]
        return list(dict.fromkeys([*pairs, *(x.pair for x in self.actuated if x.pair)]))


def mujoco_loads(mechanism: Mechanism) -> MujocoLoads:
    """Return the loads and stops of a mechanism as MuJoCo has them."""
    hinges = {pair: AtHinge() for pair in mechanism.angles}
    actuated: list[Actuated] = []
    lost: dict[str, str] = {}
    otherwise: list[str] = []
    gravity = [0.0, 0.0, 0.0]
    for load in mechanism.loads:
        if isinstance(load, Gravity):
            gravity = [
                a + float(b) for a, b in zip(gravity, load.acceleration, strict=True)
            ]
        elif isinstance(load, Spring):
            hinges[load.pair].stiffness += load.stiffness
            hinges[load.pair].pull += load.stiffness * load.rest
        elif isinstance(load, Damper):
            hinges[load.pair].damping += load.damping
        elif isinstance(load, Friction):
            hinges[load.pair].dry += load.torque
            hinges[load.pair].damping += load.viscous
            otherwise.append(
                f"load {load.name}: MuJoCo's dry friction jumps at rest, where the file "
                f"smooths it below {load.speed:g} rad/s"
            )
        elif isinstance(made := _constant(mechanism, load), Actuated):
            actuated.append(made)
        else:
            lost[load.name] = made
    for stop in mechanism.stops:
        if stop.pair in hinges:
            hinges[stop.pair].stop = (stop.low, stop.high)
    x, y, z = gravity
    return MujocoLoads(hinges, actuated, (x, y, z), lost, tuple(otherwise))


def _constant(mechanism: Mechanism, load: Load) -> Actuated | str:
    """Return a load as an actuator, or why it is none."""
    if isinstance(load, TorqueTable):
        return "MuJoCo has no tables in time"
    if not isinstance(load, PairTorque | PointForce | Moment):
        return f"MuJoCo has no load of kind {load.kind}"
    answers = [
        _bias(part, getattr(load, "pair", "")) for part in load.components(mechanism)
    ]
    reasons = [answer for answer in answers if isinstance(answer, str)]
    if reasons:
        return reasons[0]
    biases = [answer for answer in answers if not isinstance(answer, str)]
    if isinstance(load, PairTorque):
        return Actuated(load.name, load.pair, biases[0])
    return Actuated(load.name, load=load, vector=tuple(bias[0] for bias in biases))


def _bias(part: Component, pair: str) -> Bias | str:
    """Return a magnitude as a constant and factors of its pair's variable and rate."""
    law = part.magnitude
    if isinstance(law, Called | TorqueTable):
        return "it is a Python function"
    if "t" in law.names:
        return f"MuJoCo has no loads that change in time: {law.text}"
    names = (f"theta_{pair}", f"dtheta_{pair}") if pair else ()
    if not law.names <= set(names):
        return f"it depends on other pairs: {law.text}"
    factors = _affine(law, names)
    if factors is None:
        return f"it is not constant, and not in proportion to an angle or rate: {law.text}"
    constant, of_variable, of_rate = map(float, (*factors, 0.0, 0.0)[:3])
    return constant, of_variable, of_rate


def _affine(expression: Expression, names: Sequence[str]) -> Floats | None:
    """Return a constant and the factors of names (1 + names,) that an expression adds up.

    None where it is no such sum.
    """
    unit = np.eye(1 + len(names))

    def applied(function: str, parts: list[Floats | None]) -> Floats | None:
        terms = [part for part in parts if part is not None]
        varying = [bool(np.any(term[1:])) for term in terms]
        if len(terms) < len(parts):
            return None
        if not any(varying):
            with np.errstate(all="ignore"):
                value = float(ON_ARRAYS[function](*(term[0] for term in terms)))
            return np.asarray(value * unit[0]) if np.isfinite(value) else None
        if function in ("+", "-", "negative"):
            return np.asarray(ON_ARRAYS[function](*terms))
        if function == "*" and not all(varying):
            return np.asarray(
                terms[0] * terms[1][0] if varying[0] else terms[0][0] * terms[1]
            )
        if function == "/" and not varying[1] and terms[1][0]:
            return np.asarray(terms[0] / terms[1][0])
        return None

    def constant(value: float) -> Floats | None:
        return np.asarray(value * unit[0])

    places = {name: unit[k] for k, name in enumerate(names, 1)}
    return fold(expression.root, constant, places.get, applied)
