"""The loads and stops of a mechanism in what MuJoCo has, and those that it has not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

from spherekit.exchange.affine import affine
from spherekit.model.dynamics import (
    Damper,
    Friction,
    Gravity,
    Moment,
    PairTorque,
    PointForce,
    Spring,
)
from spherekit.model.load import Called, Component, Load, TorqueTable
from spherekit.model.mechanism import Mechanism

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
    form = affine(law)
    if form is None:
        return f"it is not constant, and not in proportion to an angle or rate: {law.text}"
    of_variable, of_rate = (form.factors.get(name, 0.0) for name in names or ("", ""))
    return form.constant, of_variable, of_rate
