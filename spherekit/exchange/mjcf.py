"""A mechanism as a MuJoCo model (MJCF): bodies, hinges, closed loops, loads, looks.

The loads and joint limits of a mechanism in what MuJoCo has, and those that it has not.
"""

from contextlib import suppress
from functools import cached_property
from typing import Any
from xml.etree import ElementTree

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.escaping import xml_comment
from spherekit.exchange.link_bodies import (
    LIGHT_CARRIER,
    LIGHT_END,
    BodyInertia,
    rigid_bodies,
    spokes,
)
from spherekit.exchange.mjcf_names import name_elements
from spherekit.geometry.rotation import quaternion
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.load import Called, Component, TorqueTable
from spherekit.mechanism.load_kinds import (
    Damper,
    Friction,
    Gravity,
    Moment,
    PairTorque,
    PointForce,
    Spring,
)
from spherekit.mechanism.mechanism import Mechanism
from spherekit.scenes.colours import link_colour
from spherekit.scenes.link_scenes import link_shapes
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.symbolic.expression_graph import has_variables, symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph
from spherekit.wording import listing

Attributes = dict[str, Any]
"""Of an element, as texts, numbers, or rows of numbers."""


_SUMS = ("stiffness", "damping", "frictionloss", "springref")


def _constant(mechanism: Mechanism, load: PairTorque | PointForce | Moment) -> Attributes:
    """Return a load as the attributes of an actuator; `EngineError` if it is none.

    Sites are given by the name of the load; `_actuators` puts in what the model calls them.
    """
    pair = load.pair if isinstance(load, PairTorque) else ""
    biases = [_bias(part, pair) for part in load.components(mechanism)]
    if isinstance(load, PairTorque):
        return {"joint": pair, "biasprm": biases[0]}
    vector, none = [bias[0] for bias in biases], [0.0] * 3
    gear = [*vector, *none] if isinstance(load, PointForce) else [*none, *vector]
    axes = {"refsite": load.name} if load.axes == "ground" else {}
    return {"site": load.name, **axes, "gear": gear, "biasprm": (1.0, 0.0, 0.0)}


def _bias(part: Component, pair: str) -> Floats:
    """Return a magnitude as a constant and factors of its pair's variable and rate (3,)."""
    law = part.magnitude
    if isinstance(law, Called | TorqueTable):
        raise EngineError("it is a Python function")
    if "t" in law.names:
        raise EngineError(f"MuJoCo has no loads that change in time: {law.text}")
    names = (f"theta_{pair}", f"dtheta_{pair}") if pair else ()
    if not law.names <= set(names):
        raise EngineError(f"it depends on other pairs: {law.text}")
    terms, made = symbols(names), np.array([np.nan])
    with suppress(EngineError), np.errstate(all="ignore"):
        named = {name: (x, x) for name, x in zip(names, terms, strict=True)}
        item = convert_to_graph(law, named)
        slopes = [differentiate([item], {term: 1.0})[0] for term in terms]
        if not any(map(has_variables, slopes)):
            made = array_function([item, *slopes], terms)(np.zeros((len(names), 1)))[:, 0]
    if not all_finite(made):
        raise EngineError(
            f"it is not constant, and not in proportion to an angle or rate: {law.text}"
        )
    return np.append(made, [0.0, 0.0])[:3]


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


FRAME = """<mujoco model="{name}">
<compiler angle="radian" autolimits="true"/>
<option timestep="{timestep!r}" integrator="RK4" gravity="{gravity}">
<flag contact="disable"/></option>
<statistic center="0 0 0" extent="{extent}"/>
<visual><headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5"/></visual>
<asset><texture type="skybox" builtin="gradient" rgb1="0.32 0.35 0.44"
 rgb2="0.08 0.09 0.12" width="64" height="64"/></asset>
<default><geom contype="0" conaffinity="0" group="0"/>
<default class="arc"><geom type="capsule" size="{arc}"/></default>
<default class="pin"><geom type="cylinder" size="{pin}" rgba="0.91 0.92 0.94 1"/></default>
</default>
<custom/>
<worldbody>
<light pos="{above}" dir="-1 1 -2"/>
<light pos="{beside}" dir="1 1 -1" diffuse="0.4 0.4 0.4"/>
<geom name="sphere" rgba="0.5 0.55 0.7 0.12" type="sphere" size="{ball}"/>
<body name="{ground}"/>
</worldbody>
<tendon/><equality/><actuator/><sensor/><keyframe/>
</mujoco>"""
"""What the models of all mechanisms have, and places for what is each one's own."""


class MujocoModel:
    """A mechanism in a closed configuration as a MuJoCo model (MJCF), its `text`.

    Its `notes` say what it has otherwise.

    Bodies are named as links and have their axes; joints are named as pairs, and their
    positions are the pair variables. Each pair that closes a loop is a `connect` on its
    axis, as stiff as the step allows, or, where a load acts at it, a joint of a second
    body with half of the link's inertia, welded to the link. Inputs have motors (N m).
    Without masses they have servos, whose controls are angles (rad).

    `hinges` are the attributes of joints, by pair: springs, friction and stops. `actuated`
    are loads that are actuators without control, with their attributes: at a pair such a
    load has a torque that is affine in its variable and rate; otherwise it is a force, or a
    moment, on a link, constant in the axes of the ground or of the link. Links are drawn on
    a sphere of `radius` (m), the distance of the farthest centre of mass, 1 m without any.

    Parameters
    ----------
    mechanism, values
        As for `rigid_bodies`, which says what is raised.
    timestep
        Step (s) of MuJoCo's integrator; the stiffness of the loops follows from it.
    """

    def __init__(
        self, mechanism: Mechanism, values: Floats, timestep: float = 1e-3
    ) -> None:
        self.mechanism, self.timestep = mechanism, timestep
        self.actuated: list[tuple[PairTorque | PointForce | Moment, Attributes]] = []
        self.gravity = np.zeros(3)
        self._lost: dict[str, str] = {}
        self._otherwise: list[str] = []
        self.hinges = self._taken()
        pulled = (x.pair for x, _ in self.actuated if isinstance(x, PairTorque))
        held = [*self.hinges, *pulled]
        self.made = made = rigid_bodies(mechanism, values, held)
        far = max(
            (np.linalg.norm(body.centre) for body in made.bodies if body.stated), default=0
        )
        self.radius = 1.0 if made.made_up else float(np.round(far, 3) or far or 1.0)
        self.connected = [cut for cut in made.cuts if cut.pair not in held]
        # Second bodies of links, at cut pairs where loads act.
        self.twins = [
            cut._replace(parent=cut.child, child=cut.parent, axis=-cut.axis)
            if cut.child == mechanism.ground
            else cut
            for cut in made.cuts
            if cut.pair in held
        ]
        self.names = name_elements(
            mechanism,
            list(dict.fromkeys([*mechanism.links, *(x.child for x in made.hinges)])),
            {twin.pair: twin.child for twin in self.twins},
        )
        self.shapes = link_shapes(mechanism)
        self.notes = tuple(self._noted())

    def _taken(self) -> dict[str, Attributes]:
        """Take loads as MuJoCo has them; return what hinges have of them, by pair."""
        mechanism = self.mechanism
        sums = {pair: dict.fromkeys(_SUMS, 0.0) for pair in mechanism.angles}
        for load in mechanism.loads:
            if isinstance(load, Gravity):
                self.gravity = self.gravity + load.acceleration
            elif isinstance(load, Spring):
                sums[load.pair]["stiffness"] += load.stiffness
                sums[load.pair]["springref"] += load.stiffness * load.rest
            elif isinstance(load, Damper):
                sums[load.pair]["damping"] += load.damping
            elif isinstance(load, Friction):
                sums[load.pair]["frictionloss"] += load.torque
                sums[load.pair]["damping"] += load.viscous
                self._otherwise.append(
                    f"load {load.name}: MuJoCo's dry friction jumps at rest, where the "
                    f"file smooths it below {load.speed:g} rad/s"
                )
            elif isinstance(load, PairTorque | PointForce | Moment):
                try:
                    self.actuated.append((load, _constant(mechanism, load)))
                except EngineError as why:
                    self._lost[load.name] = str(why)
            elif isinstance(load, TorqueTable):
                self._lost[load.name] = "MuJoCo has no tables in time"
            else:
                self._lost[load.name] = f"MuJoCo has no load of kind {load.kind}"
        stops = {stop.pair: (stop.low, stop.high) for stop in mechanism.joint_limits}
        hinges: dict[str, Attributes] = {}
        for pair, here in sums.items():
            here["springref"] /= here["stiffness"] or 1.0
            held: Attributes = {**here, "range": stops.get(pair)}
            if any(held.values()):
                hinges[pair] = {key: value for key, value in held.items() if value}
        return hinges

    def _noted(self) -> list[str]:
        """Return what the model has otherwise or not, in sentences."""
        made, mechanism = self.made, self.mechanism
        notes, lost = [], self._lost
        if made.made_up:
            notes.append(
                "kinematics only: the file has no masses, and MuJoCo moves none without, "
                "so links are wires of 1 kg/m on a sphere of 1 m, servos turn the inputs, "
                "and forces mean nothing"
            )
            names = (load.name for load in mechanism.loads)
            lost = dict.fromkeys(names, "the model has no masses of its own")
        notes += [f"load {name} left out: {reason}" for name, reason in lost.items()]
        notes += () if made.made_up else self._otherwise
        weighed = {mass.link for mass in mechanism.masses if np.any(mass.tensor)}
        light = [
            body.link
            for body in made.bodies
            if body.link not in weighed and not made.made_up
        ]
        bodies, limits = made.bodies, (stop.pair for stop in mechanism.joint_limits)
        for words, named in (
            (
                "joint limits of {} are MuJoCo's soft limits, where spherekit ends a "
                "simulation",
                limits,
            ),
            (
                "mass and centre chosen so that the tensor about the centre of the sphere "
                "is the file's, without weight: links {}",
                (b.link for b in bodies if not b.stated and b.link in weighed),
            ),
            (
                f"links without mass were given {LIGHT_CARRIER:g} of the largest inertia: "
                "{}",
                (link for link in light if link not in made.light_ends),
            ),
            (
                f"links without mass were given {LIGHT_END:g} of the largest inertia, and "
                "the loops that they close are soft, so that the motion is not exact; its "
                "error falls with the square of the timestep: {}",
                (link for link in light if link in made.light_ends),
            ),
        ):
            if told := listing(named):
                notes.append(words.format(told))
        return [*notes, *self.names.notes]

    @cached_property
    def text(self) -> str:
        """The model as MJCF."""
        made, radius, mechanism = self.made, self.radius, self.mechanism
        far = 3.0 * radius
        frame = FRAME.format(
            name=mechanism.name,
            timestep=self.timestep,
            gravity=_text(np.zeros(3) if made.made_up else self.gravity),
            extent=_drawn(2.4 * radius),
            arc=_drawn(LINK_RADIUS * radius),
            pin=_drawn(PIN_RADIUS * radius),
            above=_drawn((far, -far, 2.0 * far)),
            beside=_drawn((-far, -far, far)),
            ball=_drawn(0.97 * radius),
            ground=self.names.bodies[mechanism.ground],
        )
        root = ElementTree.fromstring("".join(frame.splitlines()))
        cited = (mechanism.source.citation,) if mechanism.source else ()
        for k, note in enumerate((*cited, *self.notes)):
            root.insert(k, ElementTree.Comment(f" {xml_comment(note)} "))
        part = {child.tag: child for child in root if isinstance(child.tag, str)}
        # What MuJoCo has no place for and `spherekit import` reads again.
        for item in mechanism.inputs:
            _add(
                part["custom"],
                "numeric",
                name=f"input_{item.pair}",
                data=(item.start, item.stop),
            )
        for cut in made.cuts:
            _add(part["custom"], "numeric", name=f"value_{cut.pair}", data=cut.value)
        if made.made_up:
            _add(part["custom"], "text", name="masses", data="made up")
        ground = part["worldbody"][-1]
        self._turned(ground, made.rotations[0])
        self._looks(ground, mechanism.ground)
        self._bodies(ground, mechanism.ground)
        for _, attributes in self.actuated:
            if axes := attributes.get("refsite"):
                name = self.names.axes_sites[axes]
                _add(part["worldbody"], "site", name=name, size=_drawn(1e-3 * radius))
        self._equalities(part["tendon"], part["equality"])
        self._actuators(part["actuator"])
        for output in mechanism.outputs:
            kinds = {"objtype": "body", "reftype": "body"}
            bodies = self.names.bodies
            ends = {
                "objname": bodies[output.link],
                "refname": bodies[output.relative_to],
            }
            _add(part["sensor"], "framequat", name=output.name, **kinds, **ends)
        if made.made_up:  # servos hold the pose that the model is in
            values = {hinge.pair: hinge.value for hinge in made.hinges}
            held = [values[item.pair] for item in mechanism.inputs]
            _add(part["keyframe"], "key", name="pose", ctrl=held)
        for empty in [x for x in root if not len(x) and not x.attrib and x.text is None]:
            root.remove(empty)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"

    def _bodies(self, parent: Element, link: str) -> None:
        """Add the bodies on the hinges of a link, second ones last, and those on these."""
        inertia = {body.link: body for body in self.made.bodies}
        for hinge in [*self.made.hinges, *self.twins]:
            if hinge.parent != link:
                continue
            twin = hinge in self.twins
            names = self.names
            name = names.twins[hinge.pair] if twin else names.bodies[hinge.child]
            body = _add(parent, "body", name=name)
            turn, held = self._turn(hinge.child), self.hinges.get(hinge.pair, {})
            self._turned(body, self._turn(link).T @ turn)
            named = {"name": hinge.pair, "type": "hinge", "ref": hinge.value}
            _add(body, "joint", **named, axis=turn.T @ hinge.axis, **held)
            self._inertia(body, inertia[hinge.child])
            if not twin:
                self._looks(body, hinge.child)
                self._bodies(body, hinge.child)

    def _turn(self, link: str) -> Floats:
        number = self.mechanism.link_number.get(link)
        return np.eye(3) if number is None else self.made.rotations[number]

    def _turned(self, body: Element, rotation: Floats) -> None:
        x, y, z, w = quaternion(rotation[None])[0]
        if abs(w) < 1.0:
            body.set("quat", _text((w, x, y, z)))

    def _inertia(self, body: Element, inertia: BodyInertia) -> None:
        share = 1.0 / (1 + sum(twin.child == inertia.link for twin in self.twins))
        turn = self._turn(inertia.link)
        t = share * (turn.T @ inertia.tensor @ turn)
        excess = 2.0 * np.linalg.eigvalsh(t)[-1] - np.trace(t)
        t = t + (THICKNESS * np.trace(t) + max(excess, 0.0)) * np.eye(3)
        inner = t[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        mass, centre = share * inertia.mass, turn.T @ inertia.centre
        _add(body, "inertial", mass=mass, pos=centre, fullinertia=inner)
        if not inertia.stated:
            body.set("gravcomp", "1")

    def _looks(self, body: Element, link: str) -> None:
        mechanism, radius = self.mechanism, self.radius
        number = mechanism.link_number.get(link)
        if number is None:
            return
        shape = self.shapes[number]
        rgba = " ".join(f"{part / 255:.3g}" for part in (*link_colour(number), 255))
        for line in shape.curves or spokes(shape.joints):
            corners = line[[*range(0, len(line) - 1, CHORD), -1]]
            for ends in np.hstack([corners[:-1], corners[1:]]):
                fromto = _drawn(radius * ends)
                _add(body, "geom", fromto=fromto, rgba=rgba, **{"class": "arc"})
        for name, axis in zip(shape.joint_labels, shape.joints, strict=True):
            if mechanism.pair(name).links[0] == link:
                half = 0.5 * PIN_LENGTH
                ends = _drawn(np.outer([1 - half, 1 + half], radius * axis))
                _add(body, "geom", fromto=ends, **{"class": "pin"})
        for output in mechanism.outputs:
            if output.link == link and output.direction is not None:
                drawn = {"size": _drawn(PIN_RADIUS * radius), "rgba": "1 0.77 0 1"}
                place = np.multiply(radius, output.direction)
                name = self.names.output_sites[output.name]
                _add(body, "site", name=name, pos=place, **drawn)
        for load, _ in self.actuated:
            if getattr(load, "link", None) == link:
                point = getattr(load, "point", np.zeros(3))
                name = self.names.load_sites[load.name]
                _add(body, "site", name=name, pos=point, size=_drawn(1e-3 * radius))

    def _equalities(self, tendons: Element, equal: Element) -> None:
        rate = STIFF / self.timestep
        hold = {"solref": (-(rate**2), -2.0 * rate), "solimp": IMPEDANCE}
        bodies = self.names.bodies
        for cut in self.connected:
            anchor = self.radius * (self._turn(cut.parent).T @ cut.axis)
            ends = {"body1": bodies[cut.parent], "body2": bodies[cut.child]}
            _add(equal, "connect", name=cut.pair, anchor=anchor, **ends, **hold)
        for twin in self.twins:
            ends = {"body1": bodies[twin.child], "body2": self.names.twins[twin.pair]}
            _add(equal, "weld", name=twin.pair, **ends, **hold)
        for name, factors in self.made.ratios.items():
            fixed = _add(tendons, "fixed", name=name)
            for pair, factor in factors.items():
                _add(fixed, "joint", joint=pair, coef=factor)
            _add(equal, "tendon", name=name, tendon1=name, **hold)

    def _actuators(self, actuators: Element) -> None:
        made = self.made
        inertia = sum(np.trace(mass.tensor) for mass in made.bodies)
        servo: Attributes = {"kp": float(f"{inertia * SERVO**2:.2g}"), "dampratio": "1"}
        for item in made.mechanism.inputs:
            ends = {"name": item.pair, "joint": item.pair}
            if made.made_up:
                _add(actuators, "position", **ends, **servo, ctrlrange=item.range)
            else:
                _add(actuators, "motor", **ends)
        affine = {"gainprm": "0", "biastype": "affine"}
        for load, attributes in () if made.made_up else self.actuated:
            named = dict(attributes)
            if "site" in attributes:
                named["site"] = self.names.load_sites[load.name]
            if "refsite" in attributes:
                named["refsite"] = self.names.axes_sites[load.name]
            name = self.names.load_actuators[load.name]
            _add(actuators, "general", name=name, **affine, **named)


def _add(parent: Element, tag: str, **attributes: Any) -> Element:
    """Return a new element whose attributes are texts, numbers, or rows of numbers."""
    texts = {k: x if isinstance(x, str) else _text(x) for k, x in attributes.items()}
    return ElementTree.SubElement(parent, tag, texts)


def _drawn(numbers: Any) -> str:
    """Return numbers that nothing is computed from, to five digits."""
    return " ".join(f"{x:.5g}" if abs(x) > 1e-12 else "0" for x in np.ravel(numbers))


def _text(numbers: Any) -> str:
    values = np.ravel(numbers)
    least = ROUNDING * max_abs(values)
    return " ".join(repr(float(x)) if abs(x) > least else "0" for x in values)
