"""A mechanism as a MuJoCo model (MJCF): bodies, hinges, closed loops, loads, looks.

The loads and stops of a mechanism in what MuJoCo has, and those that it has not.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import final
from xml.etree import ElementTree

import numpy as np

from spherekit.analysis.link_scenes import Shape, link_shapes
from spherekit.arrays import Floats
from spherekit.checked import checked
from spherekit.conventions import listing
from spherekit.engine.expression_graph import (
    derivatives,
    expression_terms,
    symbols,
    varies,
)
from spherekit.engine.system import array_function
from spherekit.errors import EngineError, ModelError
from spherekit.exchange.bodies import (
    SMALL,
    BodyInertia,
    Hinge,
    LoopCut,
    RigidBodies,
    rigid_bodies,
    spokes,
)
from spherekit.model.dynamics import (
    Damper,
    Friction,
    Gravity,
    Moment,
    PairTorque,
    PointForce,
    Spring,
)
from spherekit.model.expression import Expression
from spherekit.model.load import Called, Component, Load, TorqueTable
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import max_abs, quaternion
from spherekit.view.colours import Colour, link_colour

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
    terms = symbols(names)
    try:
        named = {name: (x, x) for name, x in zip(names, terms, strict=True)}
        item = expression_terms(expression, named)
    except EngineError:
        return None
    slopes = [derivatives([item], term)[0] for term in terms]
    with np.errstate(all="ignore"):
        made = array_function([item, *slopes], terms)(np.zeros((len(names), 1)))[:, 0]
    constant = np.all(np.isfinite(made)) and not any(map(varies, slopes))
    return np.asarray(made) if constant else None


Element = ElementTree.Element

STIFF = 0.3
"""Rate of the loops' correction times the step; RK4 is stable to about 1."""

IMPEDANCE = "0.9999 0.9999 1 0.5 2"
"""The largest that MuJoCo takes, at any distance."""

THICKNESS = 1e-13
"""Part of its trace added to each moment of a tensor, beside what rounding of the file
takes too far: for a thin arc two moments add up to the third, and MuJoCo refuses more."""

LINK_RADIUS, PIN_RADIUS, PIN_LENGTH = 0.018, 0.034, 0.07
"""Of the capsules and pins that draw links, as parts of the sphere's radius."""

CHORD = 4
"""Steps of a drawn curve that one capsule takes together."""

SERVO = 20.0
"""Rate (rad/s) at which the servos of a model without masses reach their angles."""

ROUNDING = 1e-16
"""Numbers below this part of the largest beside them are written as zero."""


@final
@dataclass(frozen=True)
class MujocoModel:
    """A model's text, and notes on what it has otherwise, or not at all."""

    text: str
    notes: tuple[str, ...]


@checked(ModelError)
def mjcf(
    mechanism: Mechanism,
    values: Floats,
    timestep: float = 1e-3,
    radius: float | None = None,
) -> MujocoModel:
    """Return a MuJoCo model (MJCF) of a mechanism in a closed configuration.

    Bodies are named as links and have their axes; joints are named as pairs, and their
    positions are the pair variables. Each pair that closes a loop is a `connect` on its
    axis, as stiff as the step allows, or, where a load acts at it, a joint of a second
    body with half of the link's inertia, welded to the link. Inputs have motors (N m).
    Without masses they have servos, whose controls are angles (rad).

    Parameters
    ----------
    mechanism, values
        As for `rigid_bodies`.
    timestep
        Step (s) of MuJoCo's integrator; the stiffness of the loops follows from it.
    radius
        Radius (m) of the sphere that links are drawn on, by default the distance of the
        farthest centre of mass, 1 m without any.

    Raises
    ------
    ModelError
        As of `rigid_bodies`, and if the step or the radius is not above zero.
    """
    for name, value, unit in (("timestep", timestep, "s"), ("radius", radius, "m")):
        if value is not None and not 0.0 < value < np.inf:
            raise ModelError(f"mjcf: {name} is {value} {unit}; it has to be above 0")
    loads = mujoco_loads(mechanism)
    made = rigid_bodies(mechanism, values, loads.held)
    distances = [np.linalg.norm(body.centre) for body in made.bodies if body.stated]
    size = (
        float(np.round(max(distances), 3) or max(distances))
        if distances and not made.made_up
        else 1.0
    )
    writer = _Writer(made, loads, timestep, radius or size)
    notes = _notes(made, loads)
    return MujocoModel(writer.text(notes), notes)


@final
@dataclass(frozen=True)
class _Writer:
    made: RigidBodies
    loads: MujocoLoads
    timestep: float
    radius: float

    def text(self, notes: Sequence[str]) -> str:
        made = self.made
        root = Element("mujoco", model=made.mechanism.name)
        source = made.mechanism.source
        for note in [*([source.citation] if source else ()), *notes]:
            root.append(ElementTree.Comment(f" {note.replace('--', '- -')} "))
        _add(root, "compiler", angle="radian", autolimits="true")
        gravity = (0.0, 0.0, 0.0) if made.made_up else self.loads.gravity
        option = _add(
            root,
            "option",
            timestep=repr(self.timestep),
            integrator="RK4",
            gravity=gravity,
        )
        _add(option, "flag", contact="disable")
        _add(root, "statistic", center="0 0 0", extent=_drawn(2.4 * self.radius))
        self.sky(root)
        self.defaults(root)
        self.ranges(root)
        self.world(root)
        self.equalities(root)
        self.actuators(root)
        self.sensors(root)
        if made.made_up:
            self.pose(root)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"

    def sky(self, root: Element) -> None:
        visual = _add(root, "visual")
        _add(visual, "headlight", ambient="0.45 0.45 0.45", diffuse="0.5 0.5 0.5")
        _add(
            _add(root, "asset"),
            "texture",
            type="skybox",
            builtin="gradient",
            rgb1="0.32 0.35 0.44",
            rgb2="0.08 0.09 0.12",
            width="64",
            height="64",
        )

    def defaults(self, root: Element) -> None:
        drawn = _add(root, "default")
        looks = {"contype": "0", "conaffinity": "0", "group": "0"}
        _add(drawn, "geom", **looks)
        arc = _add(drawn, "default", **{"class": "arc"})
        _add(arc, "geom", type="capsule", size=_drawn(LINK_RADIUS * self.radius))
        pin = _add(drawn, "default", **{"class": "pin"})
        rgba = "0.91 0.92 0.94 1"
        _add(pin, "geom", type="cylinder", size=_drawn(PIN_RADIUS * self.radius), rgba=rgba)

    def ranges(self, root: Element) -> None:
        """Keep what MuJoCo has no place for and `spherekit import` reads again."""
        custom = _add(root, "custom")
        for item in self.made.mechanism.inputs:
            _add(custom, "numeric", name=f"input_{item.pair}", data=(item.start, item.stop))
        for cut in self.made.cuts:
            _add(custom, "numeric", name=f"value_{cut.pair}", data=cut.value)
        if self.made.made_up:
            _add(custom, "text", name="masses", data="made up")

    def world(self, root: Element) -> None:
        made, far = self.made, 3.0 * self.radius
        world = _add(root, "worldbody")
        _add(world, "light", pos=_drawn((far, -far, 2.0 * far)), dir="-1 1 -2")
        _add(
            world,
            "light",
            pos=_drawn((-far, -far, far)),
            dir="1 1 -1",
            diffuse="0.4 0.4 0.4",
        )
        ball = {"type": "sphere", "size": _drawn(0.97 * self.radius)}
        _add(world, "geom", name="sphere", rgba="0.5 0.55 0.7 0.12", **ball)
        ground = _add(world, "body", name=made.mechanism.ground)
        self.turned(ground, made.rotations[0])
        self.looks(ground, made.mechanism.ground)
        self.bodies(ground, made.mechanism.ground)
        for load in self.loads.actuated:
            if load.load is not None and load.load.axes == "ground":
                _add(
                    world, "site", name=f"{load.name}_axes", size=_drawn(1e-3 * self.radius)
                )

    def bodies(self, parent: Element, link: str) -> None:
        for hinge, inertia, name in self.tree:
            if hinge.parent != link:
                continue
            body = _add(parent, "body", name=name)
            self.turned(body, self.turn(link).T @ self.turn(hinge.child))
            self.joint(body, hinge)
            self.inertia(body, inertia)
            if name == hinge.child:
                self.looks(body, name)
                self.bodies(body, name)

    @cached_property
    def tree(self) -> list[tuple[Hinge, BodyInertia, str]]:
        """Every hinge with the inertia and the name of its body, second bodies last."""
        pairs = zip(self.made.hinges, self.made.bodies, strict=True)
        shared = {body.link: body for body in self.made.bodies}
        return [
            *((hinge, body, hinge.child) for hinge, body in pairs),
            *((twin, shared[twin.child], _twin(twin)) for twin in self.twins),
        ]

    @cached_property
    def twins(self) -> list[Hinge]:
        """The hinges of second bodies, at cut pairs where loads act."""
        held, ground = self.loads.held, self.made.mechanism.ground
        return [
            Hinge(cut.pair, cut.first, cut.second, cut.point, cut.value)
            if cut.second != ground
            else Hinge(cut.pair, cut.second, cut.first, -cut.point, cut.value)
            for cut in self.made.cuts
            if cut.pair in held
        ]

    @property
    def connected(self) -> list[LoopCut]:
        """The cut pairs that no load acts at."""
        return [cut for cut in self.made.cuts if cut.pair not in self.loads.held]

    def turn(self, link: str) -> Floats:
        number = self.made.mechanism.link_number.get(link)
        return np.eye(3) if number is None else np.asarray(self.made.rotations[number])

    def turned(self, body: Element, rotation: Floats) -> None:
        x, y, z, w = quaternion(rotation[None])[0]
        if abs(w) < 1.0:
            body.set("quat", _text((w, x, y, z)))

    def joint(self, body: Element, hinge: Hinge) -> None:
        here = self.loads.hinges.get(hinge.pair, AtHinge())
        held = {
            "stiffness": here.stiffness,
            "springref": here.rest,
            "damping": here.damping,
            "frictionloss": here.dry,
            "range": here.stop,
        }
        _add(
            body,
            "joint",
            name=hinge.pair,
            type="hinge",
            axis=self.turn(hinge.child).T @ hinge.axis,
            ref=hinge.value,
            **{key: value for key, value in held.items() if value},
        )

    def inertia(self, body: Element, inertia: BodyInertia) -> None:
        share = 1.0 / (1 + sum(twin.child == inertia.link for twin in self.twins))
        turn = self.turn(inertia.link)
        t = share * (turn.T @ inertia.tensor @ turn)
        excess = 2.0 * np.linalg.eigvalsh(t)[-1] - np.trace(t)
        t = t + (THICKNESS * np.trace(t) + max(excess, 0.0)) * np.eye(3)
        inner = [t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2]]
        _add(
            body,
            "inertial",
            mass=share * inertia.mass,
            pos=turn.T @ inertia.centre,
            fullinertia=inner,
        )
        if not inertia.stated:
            body.set("gravcomp", "1")

    def looks(self, body: Element, link: str) -> None:
        mechanism = self.made.mechanism
        number = mechanism.link_number.get(link)
        if number is None:
            return
        shape = self.shapes[number]
        rgba = _rgba(link_colour(number))
        for line in [*shape.curves, *(() if shape.curves else spokes(shape.joints))]:
            corners = line[sorted({*range(0, len(line), CHORD), len(line) - 1})]
            for a, b in itertools.pairwise(corners):
                ends = _drawn(self.radius * np.concatenate([a, b]))
                _add(body, "geom", fromto=ends, rgba=rgba, **{"class": "arc"})
        for name, axis in zip(shape.names, shape.joints, strict=True):
            if mechanism.pair(name).links[0] == link:
                half = 0.5 * PIN_LENGTH
                place = self.radius * axis
                ends = _drawn(np.concatenate([(1 - half) * place, (1 + half) * place]))
                _add(body, "geom", fromto=ends, **{"class": "pin"})
        for output in mechanism.outputs:
            if output.link == link and output.direction is not None:
                place = self.radius * np.array(output.direction)
                size = _drawn(PIN_RADIUS * self.radius)
                _add(
                    body, "site", name=output.name, pos=place, size=size, rgba="1 0.77 0 1"
                )
        for load in self.loads.actuated:
            if load.load is not None and load.load.link == link:
                point = load.load.point if isinstance(load.load, PointForce) else (0.0,) * 3
                size = _drawn(1e-3 * self.radius)
                _add(body, "site", name=load.name, pos=point, size=size)

    @cached_property
    def shapes(self) -> list[Shape]:
        return link_shapes(self.made.mechanism)

    def equalities(self, root: Element) -> None:
        rate = STIFF / self.timestep
        hold = {"solref": (-(rate**2), -2.0 * rate), "solimp": IMPEDANCE}
        made = self.made
        if made.ratios:
            tendons = _add(root, "tendon")
            for ratio in made.ratios:
                fixed = _add(tendons, "fixed", name=ratio.pair)
                for pair, factor in ratio.factors.items():
                    _add(fixed, "joint", joint=pair, coef=factor)
        equal = _add(root, "equality")
        for cut in self.connected:
            anchor = self.radius * (self.turn(cut.first).T @ cut.point)
            ends = {"body1": cut.first, "body2": cut.second}
            _add(equal, "connect", name=cut.pair, **ends, anchor=anchor, **hold)
        for twin in self.twins:
            ends = {"body1": twin.child, "body2": _twin(twin)}
            _add(equal, "weld", name=twin.pair, **ends, **hold)
        for ratio in made.ratios:
            _add(equal, "tendon", name=ratio.pair, tendon1=ratio.pair, **hold)

    def actuators(self, root: Element) -> None:
        made = self.made
        actuators = _add(root, "actuator")
        inertia = sum(float(np.trace(mass.tensor)) for mass in made.bodies)
        for item in made.mechanism.inputs:
            ends = {"name": item.pair, "joint": item.pair}
            if made.made_up:
                strength = float(f"{inertia * SERVO**2:.2g}")
                _add(
                    actuators,
                    "position",
                    **ends,
                    kp=strength,
                    dampratio="1",
                    ctrlrange=item.range,
                )
            else:
                _add(actuators, "motor", **ends)
        for load in () if made.made_up else self.loads.actuated:
            _add(
                actuators,
                "general",
                name=load.name,
                **_transmission(load),
                gainprm="0",
                biastype="affine",
                biasprm=load.bias,
            )

    def sensors(self, root: Element) -> None:
        outputs = self.made.mechanism.outputs
        sensors = _add(root, "sensor") if outputs else root
        for output in outputs:
            ends = {"objtype": "body", "objname": output.link}
            seen = {"reftype": "body", "refname": output.relative_to}
            _add(sensors, "framequat", name=output.name, **ends, **seen)

    def pose(self, root: Element) -> None:
        """Let servos hold the pose that the model is in."""
        values = {hinge.pair: hinge.value for hinge in self.made.hinges}
        held = [values[item.pair] for item in self.made.mechanism.inputs]
        _add(_add(root, "keyframe"), "key", name="pose", ctrl=held)


def _twin(hinge: Hinge) -> str:
    return f"{hinge.child}_at_{hinge.pair}"


def _transmission(load: Actuated) -> Mapping[str, object]:
    if load.load is None:
        return {"joint": load.pair}
    none = (0.0, 0.0, 0.0)
    force = isinstance(load.load, PointForce)
    gear = [*load.vector, *none] if force else [*none, *load.vector]
    axes = {"refsite": f"{load.name}_axes"} if load.load.axes == "ground" else {}
    return {"site": load.name, **axes, "gear": gear}


def _notes(made: RigidBodies, loads: MujocoLoads) -> tuple[str, ...]:
    """Return what of a mechanism its MuJoCo model has otherwise or not, in sentences."""
    mechanism = made.mechanism
    notes = []
    if made.made_up:
        notes.append(
            "kinematics only: the file has no masses, and MuJoCo moves none without, so "
            "links are wires of 1 kg/m on a sphere of 1 m, servos turn the inputs, and "
            "forces mean nothing"
        )
    lost = dict(loads.lost)
    if made.made_up:
        lost = {load.name: "the model has no masses of its own" for load in mechanism.loads}
    notes += [f"load {name} left out: {reason}" for name, reason in lost.items()]
    notes += () if made.made_up else loads.otherwise
    if mechanism.stops:
        pairs = listing(stop.pair for stop in mechanism.stops)
        notes.append(
            f"stops of {pairs} are MuJoCo's soft limits, where spherekit ends a simulation"
        )
    weighed = {mass.link for mass in mechanism.masses if np.any(np.array(mass.tensor))}
    unknown = [b.link for b in made.bodies if not b.stated and b.link in weighed]
    if unknown:
        notes.append(
            f"mass and centre chosen so that the tensor about the centre of the sphere is "
            f"the file's, without weight: links {listing(unknown)}"
        )
    massless = [body.link for body in made.bodies if body.link not in weighed]
    if massless and not made.made_up:
        notes.append(
            f"links without mass were given {SMALL:g} of the largest inertia: "
            f"{listing(massless)}"
        )
    return tuple(notes)


def _add(parent: Element, tag: str, **attributes: object) -> Element:
    """Return a new element whose attributes are texts, numbers, or rows of numbers."""
    texts = {k: x if isinstance(x, str) else _text(x) for k, x in attributes.items()}
    return ElementTree.SubElement(parent, tag, texts)


def _rgba(colour: Colour) -> str:
    return " ".join(f"{part / 255:.3g}" for part in (*colour, 255))


def _drawn(numbers: object) -> str:
    """Return numbers that nothing is computed from, to five digits."""
    values = np.asarray(numbers, dtype=float).ravel()
    return " ".join(f"{x:.5g}" if abs(x) > 1e-12 else "0" for x in values)


def _text(numbers: object) -> str:
    values = np.asarray(numbers, dtype=float).ravel()
    least = ROUNDING * max_abs(values, initial=0.0)
    return " ".join(repr(float(x)) if abs(x) > least else "0" for x in values)
