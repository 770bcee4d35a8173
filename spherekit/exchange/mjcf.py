"""A mechanism as a MuJoCo model (MJCF): bodies, hinges, loops, loads and appearance."""

from dataclasses import replace
from functools import cached_property
from typing import Any
from xml.etree import ElementTree

import numpy as np

from spherekit.arrays import Floats
from spherekit.escaping import xml_comment
from spherekit.exchange.body_inertia import (
    BodyInertia,
    find_link_inertias,
    radial_lines,
)
from spherekit.exchange.mjcf_loads import Attributes, convert_loads
from spherekit.exchange.mjcf_names import name_elements
from spherekit.exchange.rigid_bodies import (
    LIGHT_CARRIER_RATIO,
    LIGHT_END_RATIO,
    Hinge,
    construct_rigid_bodies,
)
from spherekit.geometry.rotation import quaternion
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.load_kinds import Moment, PointForce
from spherekit.mechanism.mechanism import Mechanism
from spherekit.scenes.colours import link_colour
from spherekit.scenes.link_scenes import link_shapes
from spherekit.wording import listing

Element = ElementTree.Element

CORRECTION_PER_STEP = 0.3
"""Rate of the correction of open loops times the time step.

Larger: RK4 is unstable from about 1 on; smaller: loops open further under loads.
"""

LOOP_IMPEDANCE = "0.9999 0.9999 1 0.5 2"
"""MuJoCo's `solimp` of loops: the largest impedance that it accepts, at any distance."""

TENSOR_THICKNESS = 1e-13
"""Part of its trace that is added to each moment of a tensor.

Two moments of a thin arc add up to the third, and MuJoCo refuses tensors whose third moment
is larger. Smaller: rounding makes it larger; larger: the motion differs.
"""

LINK_RADIUS_RATIO = 0.018
"""Radius of the capsules that draw links, relative to the radius of the sphere."""

PIN_RADIUS_RATIO = 0.034
"""Radius of the cylinders that draw pairs, relative to the radius of the sphere."""

PIN_LENGTH_RATIO = 0.07
"""Length of the cylinders that draw pairs, relative to the radius of the sphere."""

POINTS_PER_CAPSULE = 4
"""Steps of a drawn curve that one capsule covers. Larger: arcs look angular; smaller: the
model has more shapes."""

SERVO_RATE_PER_S = 20.0
"""Rate (1/s) at which the servos of a model without masses approach their angles."""

WRITTEN_ZERO_RATIO = 1e-16
"""Numbers below this part of the largest number beside them are written as zero."""

DRAWN_ZERO = 1e-12
"""Numbers of the appearance that are smaller are written as zero."""

INVISIBLE_SITE_RATIO = 1e-3
"""Size of sites at which loads act, relative to the radius of the sphere."""

EXTENT_RATIO = 2.4
"""Size of the model as MuJoCo's `extent`, relative to the radius of the sphere. Larger: the
camera begins farther away."""

LIGHT_DISTANCE_RATIO = 3.0
"""Distance of the lights along two axes, relative to the radius of the sphere."""

DRAWN_SPHERE_RATIO = 0.97
"""Radius of the sphere as it is drawn, relative to that on which links are drawn. Below
1 - `LINK_RADIUS_RATIO` links are drawn outside of the sphere."""


MODEL_TEMPLATE = """<mujoco model="{name}">
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
"""The elements that all models have, and empty ones that are filled for each mechanism."""


class MujocoModel:
    """A mechanism in a closed configuration as a MuJoCo model (MJCF).

    Bodies have the names and axes of links. Joints have the names of pairs, and their
    positions are the pair variables. Each pair that closes a loop is a constraint of the
    kind `connect` on its axis, as stiff as the time step allows. If a load acts at such a
    pair, the pair has to be a joint. This joint then carries a *twin*: a second body of the
    link, which has a part of the link's inertia and is welded to it. Inputs have motors
    (N m). If the mechanism has no masses, inputs have servos instead, whose controls are
    angles (rad). Links are drawn on a sphere whose radius is the distance of the farthest
    stated centre of mass, or 1 m if none is stated.

    Parameters
    ----------
    mechanism
        The mechanism.
    values
        (variables,) pair variables (rad) of a closed configuration.
    timestep
        Time step (s) of MuJoCo's integrator. The stiffness of the loops follows from it.

    Attributes
    ----------
    notes
        What the model has in another form or leaves out, in sentences.

    Raises
    ------
    ModelError
        If bodies on hinges cannot express the mechanism, see
        `spherekit.exchange.rigid_bodies.construct_rigid_bodies`.
    """

    def __init__(
        self, mechanism: Mechanism, values: Floats, timestep: float = 1e-3
    ) -> None:
        """Choose the bodies and names of the model. The property `text` writes the model.

        MuJoCo moves bodies on the joints of a tree, and closes loops by constraints. A pair
        (joint of the mechanism) that closes a loop is therefore a constraint. A load at a
        pair needs a joint of the tree. If a pair with a load closes a loop, one of its
        links gets a second body (twin). The pair is then the joint of the twin, and a weld
        joins both bodies of the link.

        Parameters
        ----------
        mechanism
            The mechanism.
        values
            (variables,) pair variables (rad) of a configuration in which all loops are
            closed.
        timestep
            Time step (s) of MuJoCo's integrator.
        """
        self._mechanism = mechanism
        self._timestep = timestep
        # If the export invents the masses, forces mean nothing, so all loads are left out.
        has_made_up_masses = find_link_inertias(mechanism).are_made_up
        loaded_mechanism = replace(mechanism, loads=()) if has_made_up_masses else mechanism
        self._loads = convert_loads(loaded_mechanism)
        loaded_pairs = self._loads.loaded_pairs
        self._rigid_bodies = construct_rigid_bodies(mechanism, values, loaded_pairs)
        self._radius = self._choose_radius()  # of the sphere on which links are drawn, m
        # Pairs that close loops: those without a load become constraints, and those with a
        # load become joints of twins.
        self._unloaded_loop_hinges: list[Hinge] = []
        self._loaded_loop_hinges: list[Hinge] = []
        for hinge in self._rigid_bodies.loop_hinges:
            if hinge.pair not in loaded_pairs:
                self._unloaded_loop_hinges.append(hinge)
            elif hinge.child == mechanism.ground:
                # The child of a hinge gets the twin. The ground cannot have a twin, so
                # parent and child change places.
                reversed_hinge = hinge._replace(
                    parent=hinge.child, child=hinge.parent, axis=-hinge.axis
                )
                self._loaded_loop_hinges.append(reversed_hinge)
            else:
                self._loaded_loop_hinges.append(hinge)
        # Bodies are the links and the couplers. A coupler is a body without mass between
        # the centres of two circles that slide on each other. The coupler replaces the
        # contact of the circles.
        children = [hinge.child for hinge in self._rigid_bodies.hinges]
        body_names = list(dict.fromkeys([*mechanism.links, *children]))
        link_by_twin_pair = {hinge.pair: hinge.child for hinge in self._loaded_loop_hinges}
        actuator_loads = self._loads.actuator_loads
        self._names = name_elements(
            mechanism,
            body_names,
            link_by_twin_pair,
            actuator_loads=[load.name for load, _ in actuator_loads],
            site_loads=[load.name for load, given in actuator_loads if "site" in given],
        )
        self._link_shapes = link_shapes(mechanism)
        self.notes = tuple(self._write_notes())

    def _choose_radius(self) -> float:
        """Return the radius (m) of the sphere on which links are drawn.

        Axes and arcs of a spherical mechanism are angles, so they have no size in metres.
        Only centres of mass have a size in metres. The radius is therefore the distance of
        the farthest stated centre of mass from the centre of the sphere, or 1 m if the file
        states none.
        """
        # If the export has invented the masses, the centres of mass mean nothing.
        if self._rigid_bodies.has_made_up_masses:
            return 1.0
        # Only bodies whose mass and centre of mass the file states are counted.
        centre_distances = [
            np.linalg.norm(body.centre)
            for body in self._rigid_bodies.bodies
            if body.is_stated
        ]
        farthest_centre = max(centre_distances, default=0)
        # The radius is rounded to whole millimetres, unless this would make it zero.
        return float(np.round(farthest_centre, 3) or farthest_centre or 1.0)

    def _write_notes(self) -> list[str]:
        """Return sentences on everything that the model leaves out or has in another form.

        The sentences name omitted loads, limits that MuJoCo enforces only softly, and
        masses that are invented because the file has none. Further sentences name links
        with a chosen mass, because the file has only an inertia tensor.
        """
        mechanism = self._mechanism
        rigid_bodies = self._rigid_bodies
        has_made_up_masses = rigid_bodies.has_made_up_masses
        notes: list[str] = []
        reason_by_omitted_load = self._loads.reason_by_omitted_load
        if has_made_up_masses:
            notes.append(
                "kinematics only: the file has no masses, and MuJoCo cannot move bodies "
                "without mass, so links are wires of 1 kg/m on a sphere of 1 m, servos "
                "turn the inputs, and forces have no meaning"
            )
            reason_by_omitted_load = {
                load.name: "the model has no masses of its own" for load in mechanism.loads
            }
        for load_name, reason in reason_by_omitted_load.items():
            notes.append(f"load {load_name} left out: {reason}")
        notes += self._loads.approximations
        limited_pairs = listing(joint_limit.pair for joint_limit in mechanism.joint_limits)
        if limited_pairs:
            notes.append(
                f"joint limits of {limited_pairs} are MuJoCo's soft limits, where "
                "spherekit ends a simulation"
            )
        # Links whose mass or centre is not stated, and links without mass.
        links_with_mass = {mass.link for mass in mechanism.masses if np.any(mass.tensor)}
        bodies = rigid_bodies.bodies
        chosen_links = listing(
            body.link
            for body in bodies
            if not body.is_stated and body.link in links_with_mass
        )
        if chosen_links:
            notes.append(
                "mass and centre chosen so that the tensor about the centre of the sphere "
                f"is the file's, without weight: links {chosen_links}"
            )
        light_links: list[str] = []
        if not has_made_up_masses:
            light_links = [body.link for body in bodies if body.link not in links_with_mass]
        carriers = listing(
            link for link in light_links if link not in rigid_bodies.light_ends
        )
        if carriers:
            notes.append(
                f"links without mass were given {LIGHT_CARRIER_RATIO:g} of the largest "
                f"inertia: {carriers}"
            )
        ends = listing(link for link in light_links if link in rigid_bodies.light_ends)
        if ends:
            notes.append(
                f"links without mass were given {LIGHT_END_RATIO:g} of the largest "
                "inertia, and the loops that they close are soft, so that the motion is "
                "not exact; its error falls with the square of the timestep: "
                f"{ends}"
            )
        return [*notes, *self._names.notes]

    @cached_property
    def text(self) -> str:
        """The model as MJCF, the XML format of MuJoCo.

        A template with empty parts is filled with bodies, constraints that close loops,
        actuators and sensors. Parts that remain empty are removed.
        """
        mechanism = self._mechanism
        rigid_bodies = self._rigid_bodies
        root = self._fill_template()
        citation = (mechanism.source.citation,) if mechanism.source else ()
        for position, note in enumerate((*citation, *self.notes)):
            root.insert(position, ElementTree.Comment(f" {xml_comment(note)} "))
        # The template has one part of each kind (``worldbody``, ``actuator``, ...), and
        # comments, whose tag is not a text.
        part_by_tag = {child.tag: child for child in root if isinstance(child.tag, str)}
        self._add_custom_numbers(part_by_tag["custom"])
        # Lights and the drawn sphere come before the body of the ground, which is last.
        ground = part_by_tag["worldbody"][-1]
        # Rotations lead from the axes of a link, here the ground, to those of the model.
        _set_rotation(ground, rigid_bodies.rotations[0])
        self._add_appearance(ground, mechanism.ground)
        self._add_bodies(ground, mechanism.ground)
        # Sites are marked points. Sites of the ground show axes for forces and moments.
        self._add_ground_sites(part_by_tag["worldbody"])
        self._add_loops(part_by_tag["tendon"], part_by_tag["equality"])
        self._add_actuators(part_by_tag["actuator"])
        # A `framequat` sensor gives the orientation of a body relative to another one.
        for output in mechanism.outputs:
            _add(
                part_by_tag["sensor"],
                "framequat",
                name=output.name,
                objtype="body",
                reftype="body",
                objname=self._names.bodies[output.link],
                refname=self._names.bodies[output.relative_to],
            )
        if rigid_bodies.has_made_up_masses:
            # With made-up masses, torques mean nothing. Inputs then have servos for their
            # angles instead of motors. A key frame has the angles that keep the pose.
            value_by_pair = {hinge.pair: hinge.value for hinge in rigid_bodies.hinges}
            controls = [value_by_pair[pair] for pair in mechanism.input_pairs]
            _add(part_by_tag["keyframe"], "key", name="pose", ctrl=controls)
        # Parts of the template that this mechanism does not need are still empty.
        unused_parts = [
            part for part in root if not len(part) and not part.attrib and part.text is None
        ]
        for part in unused_parts:
            root.remove(part)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"

    def _add_ground_sites(self, worldbody: Element) -> None:
        """Add a site of the world for each load whose direction is constant in ground axes.

        A site is a marked point with axes. MuJoCo lets an actuator state its vector in the
        axes of such a site ("refsite").
        """
        size = _format_drawn(INVISIBLE_SITE_RATIO * self._radius)
        for load, attributes in self._loads.actuator_loads:
            if "refsite" in attributes:
                site_name = self._names.axes_sites[load.name]
                _add(worldbody, "site", name=site_name, size=size)

    def _fill_template(self) -> Element:
        """Return the root element of a model whose only body is the ground.

        The template has options of the simulation, the looks of links and pins, two lights
        and the sphere. Drawn sizes are in proportion to the radius of the sphere (m). Empty
        elements, such as the one for actuators, are filled later. Numbers of the simulation
        are written with all digits, drawn sizes with five.
        """
        radius = self._radius
        light_distance = LIGHT_DISTANCE_RATIO * radius
        text = MODEL_TEMPLATE.format(
            name=self._mechanism.name,
            timestep=self._timestep,
            gravity=_format_numbers(self._loads.gravity),
            extent=_format_drawn(EXTENT_RATIO * radius),
            arc=_format_drawn(LINK_RADIUS_RATIO * radius),
            pin=_format_drawn(PIN_RADIUS_RATIO * radius),
            above=_format_drawn((light_distance, -light_distance, 2.0 * light_distance)),
            beside=_format_drawn((-light_distance, -light_distance, light_distance)),
            ball=_format_drawn(DRAWN_SPHERE_RATIO * radius),
            ground=self._names.bodies[self._mechanism.ground],
        )
        # The parser would store line breaks between elements as text, so they are removed.
        return ElementTree.fromstring("".join(text.splitlines()))

    def _add_custom_numbers(self, custom: Element) -> None:
        """Add numbers that only a later import by `spherekit import` reads.

        The numbers are the ranges of the inputs (rad), and the joint angles (rad) of the
        hinges that close loops. The angles are those of the exported configuration. If the
        mechanism states no masses, the export invents some. A text then says so, and an
        import does not take these masses for stated ones.

        Parameters
        ----------
        custom
            Element of the model to which the numbers are added.
        """
        for driven in self._mechanism.inputs:
            _add(
                custom,
                "numeric",
                name=f"input_{driven.pair}",
                data=(driven.start, driven.stop),
            )
        for hinge in self._rigid_bodies.loop_hinges:
            _add(custom, "numeric", name=f"value_{hinge.pair}", data=hinge.value)
        if self._rigid_bodies.has_made_up_masses:
            _add(custom, "text", name="masses", data="made up")

    def _add_bodies(self, parent_element: Element, parent: str) -> None:
        """Add all bodies that hang on a body by hinges, and then the bodies on these.

        The method calls itself for each new body, so it builds the whole tree of bodies.

        A hinge joins a child (body) to its parent, which is already in the tree. A hinge
        that closes a loop is not a joint of the tree, and only joints can have loads. If
        such a hinge has a load, it becomes a joint with a child of its own: a second body
        of the link `hinge.child`, called twin. A weld joins the twin to the first body of
        the link. All bodies of a link have equal parts of its inertia. Twins are not drawn.

        Parameters
        ----------
        parent_element
            Element of the body on which the new bodies hang.
        parent
            Name of this body, as in `hinge.parent`.
        """
        inertia_by_link = {body.link: body for body in self._rigid_bodies.bodies}
        for hinge in [*self._rigid_bodies.hinges, *self._loaded_loop_hinges]:
            if hinge.parent != parent:
                continue
            is_twin = hinge in self._loaded_loop_hinges
            if is_twin:
                name = self._names.twins[hinge.pair]
            else:
                name = self._names.bodies[hinge.child]
            body = _add(parent_element, "body", name=name)
            # `rotation` leads from the axes of the body to ground axes, and `hinge.axis` is
            # in ground axes. The file states the rotation of a body relative to its parent,
            # and the axis of a joint in the axes of its body.
            rotation = self._rotation_of(hinge.child)
            _set_rotation(body, self._rotation_of(parent).T @ rotation)
            _add(
                body,
                "joint",
                name=hinge.pair,
                type="hinge",
                ref=hinge.value,
                axis=rotation.T @ hinge.axis,
                **self._loads.hinge_attributes.get(hinge.pair, {}),
            )
            self._add_inertia(body, inertia_by_link[hinge.child])
            if not is_twin:
                self._add_appearance(body, hinge.child)
                self._add_bodies(body, hinge.child)

    def _rotation_of(self, link: str) -> Floats:
        """Return the rotation (3, 3) from the axes of a body to ground axes."""
        number = self._mechanism.link_number.get(link)
        if number is None:  # A body between the centres of circles has ground axes.
            return np.eye(3)
        return self._rigid_bodies.rotations[number]

    def _add_inertia(self, body: Element, inertia: BodyInertia) -> None:
        """Add the inertia of a body: an equal part of the inertia of its link.

        A link has one body, and a second body (twin) for each pair that closes a loop and
        has a load. All bodies of a link are welded together.

        MuJoCo refuses a tensor whose largest moment exceeds the sum of the two others. All
        moments are enlarged by this excess, if there is one. They are also enlarged by a
        small margin, so that rounding does not cause an excess.

        Parameters
        ----------
        body
            Element of the body.
        inertia
            Inertia of the whole link in ground axes, with the tensor about the centre of
            mass.
        """
        twin_count = sum(hinge.child == inertia.link for hinge in self._loaded_loop_hinges)
        share = 1.0 / (1 + twin_count)
        rotation = self._rotation_of(inertia.link)
        tensor = share * (rotation.T @ inertia.tensor @ rotation)
        # The trace is the sum of the three moments. The excess of the largest moment m over
        # the sum of the others is m - (trace - m). If an amount is added to all three
        # moments, the excess decreases by this amount.
        largest_moment = np.linalg.eigvalsh(tensor)[-1]
        excess = 2.0 * largest_moment - np.trace(tensor)
        margin = TENSOR_THICKNESS * np.trace(tensor)
        enlargement = margin + max(excess, 0.0)
        tensor = tensor + enlargement * np.eye(3)
        # MuJoCo's order: xx, yy, zz, xy, xz, yz.
        elements = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        _add(
            body,
            "inertial",
            mass=share * inertia.mass,
            pos=rotation.T @ inertia.centre,
            fullinertia=elements,
        )
        if not inertia.is_stated:
            # The export has chosen mass and centre of this link. Its weight is not a load
            # of the mechanism, so MuJoCo cancels gravity at this body.
            body.set("gravcomp", "1")

    def _add_appearance(self, body: Element, link: str) -> None:
        """Add the drawn shapes of a link, and the sites (points) of its outputs and loads.

        Parameters
        ----------
        body
            Element of the body.
        link
            Name of the link. A body that replaces a sliding contact is no link of the
            mechanism, so nothing is added to it.
        """
        number = self._mechanism.link_number.get(link)
        if number is None:
            return
        self._add_link_shape(body, link, number)
        self._add_output_sites(body, link)
        self._add_load_sites(body, link)

    def _add_link_shape(self, body: Element, link: str, number: int) -> None:
        """Draw a link with a number, as capsules along its arcs.

        The first link of each pair (joint) also has a pin along the axis of the pair.
        """
        radius = self._radius
        shape = self._link_shapes[number]
        rgba = " ".join(f"{part / 255:.3g}" for part in (*link_colour(number), 255))
        # Capsules between every `POINTS_PER_CAPSULE`-th point of the drawn curves. A link
        # without curves, such as one with a single pair, is drawn as lines from the centre.
        for curve in shape.curves or radial_lines(shape.joints):
            corners = curve[[*range(0, len(curve) - 1, POINTS_PER_CAPSULE), -1]]
            for ends in np.hstack([corners[:-1], corners[1:]]):
                attributes = {"fromto": _format_drawn(radius * ends), "rgba": rgba}
                _add(body, "geom", **attributes, **{"class": "arc"})
        for name, axis in zip(shape.joint_labels, shape.joints, strict=True):
            first_link = self._mechanism.pair(name).links[0]
            if first_link == link:
                half_length = 0.5 * PIN_LENGTH_RATIO
                ends = np.outer([1 - half_length, 1 + half_length], radius * axis)  # (2, 3)
                _add(body, "geom", fromto=_format_drawn(ends), **{"class": "pin"})

    def _add_output_sites(self, body: Element, link: str) -> None:
        """Add a yellow point for each output of a link that has a direction.

        An output is a link whose motion is of interest. An output may have a direction in
        the link that is observed. The point is drawn in this direction from the centre.
        """
        radius = self._radius
        for output in self._mechanism.outputs:
            if output.link == link and output.direction is not None:
                _add(
                    body,
                    "site",
                    name=self._names.output_sites[output.name],
                    pos=np.multiply(radius, output.direction),
                    size=_format_drawn(PIN_RADIUS_RATIO * radius),
                    rgba="1 0.77 0 1",
                )

    def _add_load_sites(self, body: Element, link: str) -> None:
        """Add an invisible site (point) for each force and moment on a link.

        In MuJoCo an actuator exerts the force or moment, and acts at this site.
        """
        for load, _actuator_attributes in self._loads.actuator_loads:
            if isinstance(load, PointForce | Moment) and load.link == link:
                # A moment has no point of action, so its site is at the centre.
                point = load.point if isinstance(load, PointForce) else np.zeros(3)
                _add(
                    body,
                    "site",
                    name=self._names.load_sites[load.name],
                    pos=point,
                    size=_format_drawn(INVISIBLE_SITE_RATIO * self._radius),
                )

    def _add_loops(self, tendons: Element, equalities: Element) -> None:
        """Add the constraints that close loops, and the constraints of rolling contacts.

        - A pair (joint) that closes a loop is a constraint: one point of its axis is the
          same in both links, parent and child. All links share the centre of the sphere
          too, so the whole axis coincides.
        - In MuJoCo, springs and torques act only at joints. If such a load acts at the
          pair, the child has a second body (twin), which hangs on the parent by this
          joint. The constraint welds the twin to the child.
        - In a rolling contact a sum of joint angles with factors is constant.

        Parameters
        ----------
        tendons, equalities
            Elements of the model to which they are added.
        """
        # MuJoCo reads negative numbers of `solref` as stiffness and damping. A critically
        # damped correction with the rate r (1/s) has the stiffness r^2 and the damping 2 r.
        # `LOOP_IMPEDANCE` is the largest impedance that MuJoCo accepts.
        rate = CORRECTION_PER_STEP / self._timestep
        stiffness: Attributes = {
            "solref": (-(rate**2), -2.0 * rate),
            "solimp": LOOP_IMPEDANCE,
        }
        body_names = self._names.bodies
        for hinge in self._unloaded_loop_hinges:
            axis_in_parent = self._rotation_of(hinge.parent).T @ hinge.axis
            _add(
                equalities,
                "connect",
                name=hinge.pair,
                anchor=self._radius * axis_in_parent,
                body1=body_names[hinge.parent],
                body2=body_names[hinge.child],
                **stiffness,
            )
        for hinge in self._loaded_loop_hinges:
            _add(
                equalities,
                "weld",
                name=hinge.pair,
                body1=body_names[hinge.child],
                body2=self._names.twins[hinge.pair],
                **stiffness,
            )
        for name, factors in self._rigid_bodies.gear_equations.items():
            # A tendon of constant length keeps the sum of its joint angles.
            tendon = _add(tendons, "fixed", name=name)
            for pair, factor in factors.items():
                _add(tendon, "joint", joint=pair, coef=factor)
            _add(equalities, "tendon", name=name, tendon1=name, **stiffness)

    def _add_actuators(self, actuators: Element) -> None:
        """Add motors or servos of the inputs, and the loads that MuJoCo has as actuators.

        Inputs (driven pairs) have motors. If the export has invented the masses, the
        torques of a simulation have no meaning. In such a model, inputs have servos that
        control their angles, and loads are left out.

        Parameters
        ----------
        actuators
            Element of the model to which the actuators are added.
        """
        rigid_bodies = self._rigid_bodies
        # Estimate of the inertia that a servo moves: the sum of the traces of all tensors.
        total_inertia = sum(np.trace(body.tensor) for body in rigid_bodies.bodies)
        # A servo with this stiffness follows its angle at the rate `SERVO_RATE_PER_S`,
        # which is the root of stiffness over inertia. Two digits are enough.
        servo_stiffness = float(f"{total_inertia * SERVO_RATE_PER_S**2:.2g}")
        value_by_pair = {hinge.pair: hinge.value for hinge in rigid_bodies.hinges}
        for driven in self._mechanism.inputs:
            if rigid_bodies.has_made_up_masses:
                # The exported pose may be outside of the range of the input.
                angles = (*driven.range, value_by_pair[driven.pair])
                _add(
                    actuators,
                    "position",
                    name=driven.pair,
                    joint=driven.pair,
                    kp=servo_stiffness,
                    dampratio="1",
                    ctrlrange=(min(angles), max(angles)),
                )
            else:
                _add(actuators, "motor", name=driven.pair, joint=driven.pair)
        for load, attributes in self._loads.actuator_loads:
            # A force or moment acts at a site, a marked point of a body. The components of
            # the force or moment can be in the axes of another site, "refsite". The
            # attributes get the final names of both sites here.
            named_attributes = dict(attributes)
            if "site" in attributes:
                named_attributes["site"] = self._names.load_sites[load.name]
            if "refsite" in attributes:
                named_attributes["refsite"] = self._names.axes_sites[load.name]
            # With the gain zero, the force does not depend on a control signal.
            _add(
                actuators,
                "general",
                name=self._names.load_actuators[load.name],
                gainprm="0",
                biastype="affine",
                **named_attributes,
            )


def _set_rotation(body: Element, rotation: Floats) -> None:
    """Set the orientation of a body of a MuJoCo model.

    `rotation` (3, 3) leads from the axes of the body to those of its parent. The identity
    is not written, because it is MuJoCo's default.
    """
    x, y, z, w = quaternion(rotation[None])[0]
    # `w` is no measure: it is 1 up to rounding for all rotations below 3e-8 rad.
    if max_abs((x, y, z)) > WRITTEN_ZERO_RATIO:
        body.set("quat", _format_numbers((w, x, y, z)))


def _add(parent: Element, tag: str, **attributes: Any) -> Element:
    """Return a new element whose attributes are texts, numbers, or arrays of numbers."""
    texts = {
        name: value if isinstance(value, str) else _format_numbers(value)
        for name, value in attributes.items()
    }
    return ElementTree.SubElement(parent, tag, texts)


def _format_drawn(numbers: Any) -> str:
    """Return numbers that only affect the drawing (sizes, positions), in five digits."""
    return " ".join(f"{x:.5g}" if abs(x) > DRAWN_ZERO else "0" for x in np.ravel(numbers))


def _format_numbers(numbers: Any) -> str:
    """Return numbers as text in all digits; a number that is zero up to rounding is 0."""
    values = np.ravel(numbers)
    least_written = WRITTEN_ZERO_RATIO * max_abs(values)
    return " ".join(
        repr(float(value)) if abs(value) > least_written else "0" for value in values
    )
