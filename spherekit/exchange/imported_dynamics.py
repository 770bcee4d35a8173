"""Masses and loads of an imported mechanism, as tables of its file."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.exchange.gear_couplings import ImportedPair
from spherekit.exchange.imported_linkage import ImportedLinkage
from spherekit.exchange.imported_tables import Table
from spherekit.exchange.mujoco_file import MASSLESS_KG
from spherekit.exchange.mujoco_loops import element_name
from spherekit.exchange.short_decimals import (
    round_components,
    round_to_short_decimal,
    round_to_short_degrees,
)
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.inertia import shift_to_sphere_centre
from spherekit.wording import listing

TENSOR_ROUNDING = 2e-12
"""Largest change of an element of a tensor, relative to its largest element.

Larger: digits of the model are lost; smaller: tensors of exported models do not return,
since the export adds up to this part to their moments (`TENSOR_THICKNESS` in
`spherekit.exchange.mjcf`).
"""

SMOOTHING_RATE_RAD_S = 0.01
"""Rate (rad/s) below which imported dry friction is smoothed.

MuJoCo's friction jumps at rest. Larger: slow motion has too little friction; smaller:
simulations take shorter steps.
"""


class ImportedDynamics:
    """The masses and loads of an imported model, as tables of a mechanism file.

    Notes on parts that are left out are added to the notes of the linkage.

    Parameters
    ----------
    linkage
        The links and pairs of the mechanism.

    Attributes
    ----------
    mass_comments
        Comments on the masses of links, by the names of the links.
    """

    def __init__(self, linkage: ImportedLinkage) -> None:
        """Store the linkage, and find the damping and the armature of each joint.

        Armature is a moment of inertia that MuJoCo adds about a hinge (a rotor).
        `mass_tables` and `load_tables` later make the tables of the mechanism file.
        """
        self._linkage = linkage
        self._mj_model = linkage.foreign_model.mj_model
        self._mj_data = linkage.foreign_model.mj_data
        self.mass_comments: dict[str, str] = {}  # `mass_tables` adds the comments
        # Damping (N m s/rad) and armature (kg m2) by joint. All joints of the model are
        # hinges. An actuator can have damping and armature too. Both act at its hinge,
        # multiplied by the square of the gear ratio.
        self._damping = self._mj_model.dof_damping.copy()
        self._armature = self._mj_model.dof_armature.copy()
        for actuator in self._list_actuators_at_joints():
            joint = self._mj_model.actuator_trnid[actuator][0]
            factor = self._mj_model.actuator_gear[actuator][0] ** 2
            self._damping[joint] += factor * self._mj_model.actuator_damping[actuator]
            self._armature[joint] += factor * self._mj_model.actuator_armature[actuator]

    def _list_actuators_at_joints(self) -> list[int]:
        """Return the numbers of the actuators at hinges."""
        at_joint = self._linkage.foreign_model.mujoco.mjtTrn.mjTRN_JOINT
        is_at_joint = self._mj_model.actuator_trntype == at_joint
        numbers: list[int] = np.flatnonzero(is_at_joint).tolist()
        return numbers

    # Masses

    def mass_tables(self) -> dict[str, Table]:
        """Return the masses of the moving links, as tables of a mechanism file.

        The result has a table for each link with inertia, by the name of the link. The
        table has the inertia tensor about the centre of the sphere. `_add_up_bodies` says
        when it also has the mass and the centre of mass.

        The tensor of a link is the sum over its bodies and over rotors. A rotor is a moment
        of inertia that MuJoCo adds about a hinge.
        """
        tables: dict[str, Table] = {}
        # (3, 3) tensor of the rotor, by number of the link that has one.
        rotors = self._find_rotors()
        for link in self._linkage.links[1:]:
            bodies = self._find_bodies_with_inertia(link)
            if bodies or link in rotors:  # a rotor may be the only inertia of the link
                table = self._add_up_bodies(link, bodies, rotors.get(link))
                tables[self._linkage.link_name(link)] = table
        return tables

    def _find_bodies_with_inertia(self, link: int) -> list[int]:
        """Return the bodies with mass or moments of inertia that are parts of a link."""
        mj_model = self._mj_model
        has_moments = np.any(mj_model.body_inertia > MASSLESS_KG, axis=1)
        has_inertia = (mj_model.body_mass > MASSLESS_KG) | has_moments
        return [
            body
            for body in range(mj_model.nbody)
            if self._linkage.link_by_body[body] == link and has_inertia[body]
        ]

    def _find_masses(self, bodies: list[int]) -> Floats:
        """Return the masses (bodies,) of some bodies (kg), 0 for bodies without mass."""
        masses = self._mj_model.body_mass[bodies]
        return np.where(masses > MASSLESS_KG, masses, 0.0)

    def _add_up_bodies(self, link: int, bodies: list[int], rotor: Floats | None) -> Table:
        """Return the table of the inertia of a link: the sum over its bodies.

        The table has the inertia tensor about the centre of the sphere. It also has the
        mass and the centre of mass, except in two cases:

        - spherekit invented the masses when it exported the model.
        - The bodies have no mass, and no gravity acts. If gravity acts, the link gets a
          tiny mass at the centre of the sphere, since gravity needs a mass.

        MuJoCo can compensate the weight of a body by a force. The compensated mass counts
        as if it were at the centre of the sphere, where its weight has no moment.

        Parameters
        ----------
        link
            Number of the link.
        bodies
            Numbers of its bodies with inertia; none if it has only the rotor.
        rotor
            (3, 3) tensor (kg m2) of a rotor that turns with the link, or None.
        """
        tensor = self._sum_tensors(bodies)
        if rotor is not None:
            tensor = tensor + rotor
        table: Table = {"tensor": _tensor_rows(tensor)}
        if self._has_invented_masses(bodies):
            return table
        name = self._linkage.link_name(link)
        total_mass = np.sum(self._find_masses(bodies))
        if total_mass == 0.0:
            if self._linkage.foreign_model.gravity is not None:
                table["mass"] = MASSLESS_KG
                table["centre"] = [0.0, 0.0, 0.0]
                self.mass_comments[name] = "The model has no mass for it, only inertia."
            return table
        centre = self._find_centre_of_weight(bodies)
        # Coordinates are rounded like numbers as large as the radius of gyration, since the
        # centre itself can be zero.
        gyration_radius = np.sqrt(np.trace(tensor) / total_mass)
        table["mass"] = round_to_short_decimal(total_mass, scale=total_mass)
        table["centre"] = [round_to_short_decimal(x, gyration_radius) for x in centre]
        if np.any(self._mj_model.body_gravcomp[bodies]):
            self.mass_comments[name] = (
                "Its weight is compensated: its centre counts as the sphere's."
                if np.all(self._is_weightless(bodies))
                else "Its weight is partly compensated: its centre is moved accordingly."
            )
        return table

    def _is_weightless(self, bodies: list[int]) -> Bools:
        """Return whether MuJoCo compensates all the weight of each body (bodies,).

        Bodies with moments of inertia but no mass have no weight.
        """
        is_compensated: Bools = self._mj_model.body_gravcomp[bodies] == 1.0
        return is_compensated | (self._find_masses(bodies) == 0.0)

    def _has_invented_masses(self, bodies: list[int]) -> bool:
        """Return whether spherekit invented the masses of a link's bodies at an export.

        A mechanism file may state the inertia tensor of a link without its mass. MuJoCo
        needs a mass, so an export invents one and marks the body as weightless. On import
        such masses are left out again. Masses count as invented if all bodies of the link
        are weightless and no gravity acts.
        """
        has_gravity = self._linkage.foreign_model.gravity is not None
        return bool(np.all(self._is_weightless(bodies))) and not has_gravity

    def _sum_tensors(self, bodies: list[int]) -> Floats:
        """Return the inertia tensor (3, 3) of some bodies about the centre of the sphere.

        MuJoCo has the principal moments of inertia of a body about its centre of mass, and
        the rotation R with its principal axes as columns. The tensor of the body about its
        centre of mass is R diag(moments) R^T.
        """
        rotations = self._mj_data.ximat[bodies].reshape(-1, 3, 3)
        principal_moments = self._mj_model.body_inertia[bodies]
        # Column k of R is multiplied by moment k.
        scaled_rotations = rotations * principal_moments[:, None]
        tensors = scaled_rotations @ np.swapaxes(rotations, 1, 2)
        masses = self._find_masses(bodies)
        arms = self._find_arms(bodies)
        shifted_tensors = [
            shift_to_sphere_centre(tensor, mass, arm)
            for tensor, mass, arm in zip(tensors, masses, arms, strict=True)
        ]
        return sum(shifted_tensors, np.zeros((3, 3)))

    def _find_arms(self, bodies: list[int]) -> Floats:
        """Return the vectors (bodies, 3) from the sphere's centre to centres of mass, m."""
        arms: Floats = self._mj_data.xipos[bodies] - self._linkage.centre
        return arms

    def _find_centre_of_weight(self, bodies: list[int]) -> Floats:
        """Return the point (3,) of a link at which the weight of its mass acts.

        A mechanism file has one mass and one centre of mass for a link. The weight of the
        link has a moment about the centre of the sphere, which follows from these two. In
        MuJoCo, a link can consist of several bodies, and the weight of some may be
        compensated, as a whole or in part. The mass that is compensated is placed at the
        centre of the sphere here, so that its weight has no moment. Without compensation
        the result is the centre of mass.

        Returns
        -------
        (3,) vector from the centre of the sphere, m.
        """
        masses = self._find_masses(bodies)
        # Weightless bodies get the mass 0 here. The total mass includes these bodies.
        masses_with_weight = masses * (1.0 - self._mj_model.body_gravcomp[bodies])
        arms = self._find_arms(bodies)  # from the sphere's centre to the centres of mass
        centre: Floats = masses_with_weight @ arms / np.sum(masses)
        return centre

    def _find_rotors(self) -> dict[int, Floats]:
        """Return inertia tensors (3, 3) for links that turn with a rotor, by link number.

        MuJoCo can add a moment of inertia (armature) about the axis of a hinge, such as the
        inertia of a motor's rotor. If the hinge is on the ground, a thin disc that turns
        with the moving link has the same effect. The moments of the disc about the other
        two axes are half as large. The tensor of the disc is added to that of the link. If
        the hinge joins two moving links, no rigid body has this effect. The armature is
        then left out with a note.
        """
        rotors: dict[int, Floats] = {}
        for pair in self._linkage.pairs:
            # A pair that only closes a loop is not a joint of the model and has the number
            # -1.
            is_joint = pair.joint >= 0
            armature = self._armature[pair.joint] if is_joint else 0.0
            if armature and 0 in pair.links:
                # The ground is link 0. Either link can be the ground: the second one is, if
                # the body that the hinge carries is welded to the world.
                moving_link = max(pair.links)
                disc = 0.5 * armature * (np.eye(3) + np.outer(pair.axis, pair.axis))
                rotors[moving_link] = rotors.get(moving_link, np.zeros((3, 3))) + disc
            elif armature:
                self._linkage.notes.append(
                    f"armature of joint {pair.name} left out, {armature:g} kg m2: the link "
                    "that carries the joint moves"
                )
        return rotors

    # Loads

    def load_tables(self, has_masses: bool) -> dict[str, Table]:
        """Return the tables of the loads, by their names. No two loads have the same name.

        Parameters
        ----------
        has_masses
            Whether the imported mechanism has masses. Without masses, gravity is left out.
        """
        tables: dict[str, Table] = {}
        for name, table in self._list_loads(has_masses):
            tables[self._linkage.make_unique_name(name, tables)] = table
        return tables

    def _list_loads(self, has_masses: bool) -> Iterator[tuple[str, Table]]:
        """Yield the name and table of each load.

        Two loads may get the same name, and the caller makes the names different. Loads are
        gravity, springs, friction and dampers at joints, and actuators without control.
        Parts that a mechanism file can't have are left out with a note.

        Parameters
        ----------
        has_masses
            Whether the imported mechanism has masses. Otherwise there is no gravity.
        """
        gravity = self._linkage.foreign_model.gravity
        if gravity is not None and has_masses:
            # Digits below the rounding error of 1 m/s^2 are removed, so that
            # 9.810000000000002 becomes 9.81.
            acceleration = [round_to_short_decimal(component, 1.0) for component in gravity]
            yield "gravity", {"kind": "gravity", "acceleration": acceleration}
        for pair in self._linkage.pairs:
            # A pair that only closes a loop is not a joint of the model and has the number
            # -1.
            if pair.joint >= 0:
                yield from self._list_joint_loads(pair)
        yield from self._list_actuator_loads()
        self._note_lost_loads()

    def _note_lost_loads(self) -> None:
        """Add notes on what acts in the MuJoCo model, but can't be in a mechanism file.

        These are springs and dampers of joints that are not linear, properties of tendons
        such as dry friction, and forces of the surrounding fluid.
        """
        mj_model = self._mj_model
        notes = self._linkage.notes
        # All joints of the model are hinges, so a joint and its velocity (dof) have the
        # same number. The arrays with "poly" are coefficients of terms of higher order than
        # linear, which can't be imported. An actuator can damp its joint, too.
        nonlinear_joints = {
            int(mj_model.actuator_trnid[actuator][0])
            for actuator in self._list_actuators_at_joints()
            if np.any(mj_model.actuator_dampingpoly[actuator])
        }
        for joint, joint_name in enumerate(self._linkage.foreign_model.joint_names):
            has_nonlinear_spring = np.any(mj_model.jnt_stiffnesspoly[joint]) or (
                mj_model.jnt_stiffness[joint] and mj_model.jnt_springyield[joint]
            )
            has_nonlinear_damper = np.any(mj_model.dof_dampingpoly[joint])
            if has_nonlinear_spring or has_nonlinear_damper or joint in nonlinear_joints:
                notes.append(
                    f"joint {joint_name}: spring or damper left out where not linear"
                )
        parts_of_tendons = {
            "spring": (mj_model.tendon_stiffness, mj_model.tendon_stiffnesspoly),
            "damper": (mj_model.tendon_damping, mj_model.tendon_dampingpoly),
            "dry friction": (mj_model.tendon_frictionloss,),
            "armature": (mj_model.tendon_armature,),
            "limit": (mj_model.tendon_limited,),
        }
        for tendon in range(mj_model.ntendon):
            lost = [
                f"its {word}"
                for word, arrays in parts_of_tendons.items()
                if any(np.any(array[tendon]) for array in arrays)
            ]
            if lost:
                name = element_name(mj_model.tendon(tendon), "tendon", tendon)
                notes.append(f"tendon {name}: {listing(lost)} left out")
        if mj_model.opt.density or mj_model.opt.viscosity:
            notes.append("forces of the surrounding fluid left out")

    def _list_joint_loads(self, pair: ImportedPair) -> Iterator[tuple[str, Table]]:
        """Yield the name and table of each load at the joint of a pair.

        Loads are a spring, dry friction and a damper. Dry friction and damping together
        become one load, with damping as its viscous part. Numbers are written as short
        decimals, without the digits that are only rounding errors.
        """
        mj_model = self._mj_model
        # All joints of the model are hinges. Joints, velocities (dof) and coordinates
        # (qpos) therefore have the same numbers.
        joint = pair.joint
        name = pair.name
        stiffness = _round_alone(mj_model.jnt_stiffness[joint])  # N m/rad
        viscous = _round_alone(self._damping[joint])  # N m s/rad
        dry = _round_alone(mj_model.dof_frictionloss[joint])  # N m
        if stiffness:
            rest_angle = round_to_short_degrees(mj_model.qpos_spring[joint])
            yield (
                f"spring_{name}",
                {
                    "kind": "spring",
                    "pair": name,
                    "stiffness": stiffness,
                    "rest": rest_angle,
                },
            )
        if dry:
            friction = {
                "kind": "friction",
                "pair": name,
                "torque": dry,
                # From rad/s to deg/s.
                "speed": round_to_short_degrees(SMOOTHING_RATE_RAD_S),
            }
            if viscous:
                friction["viscous"] = viscous
            yield f"friction_{name}", friction
            self._linkage.notes.append(
                f"dry friction of {name} is smoothed below {SMOOTHING_RATE_RAD_S:g} rad/s"
            )
        elif viscous:
            yield f"damper_{name}", {"kind": "damper", "pair": name, "damping": viscous}

    def _list_actuator_loads(self) -> Iterator[tuple[str, Table]]:
        """Yield the name and table of each load that comes from an actuator.

        The force of an actuator may follow a control signal. An actuator with a control
        signal is no load: at a hinge it becomes an input of the mechanism, and elsewhere it
        is left out. An actuator without control signal is a load in two cases:

        - It exerts a torque at a hinge that is linear in angle and rate.
        - It exerts a constant force or moment at a point of a body (a site).

        Other actuators are left out. The user gets a note on all that is lost.
        """
        mj_model = self._mj_model
        kinds = self._linkage.foreign_model.mujoco.mjtTrn
        pair_by_joint = {pair.joint: pair for pair in self._linkage.pairs}
        for actuator in range(mj_model.nactuator):
            transmission = mj_model.actuator_trntype[actuator]
            is_at_joint = transmission == kinds.mjTRN_JOINT
            is_at_site = transmission == kinds.mjTRN_SITE
            name = element_name(mj_model.actuator(actuator), "actuator", actuator)
            if self._linkage.foreign_model.is_controlled(actuator):
                self._note_lost_control(actuator, name, is_at_joint)
                continue
            bias = self._find_bias(actuator)
            joint, _ = mj_model.actuator_trnid[actuator]
            if self._is_disabled(actuator):
                self._linkage.notes.append(
                    f"actuator {name} left out: the file disables it"
                )
            elif is_at_joint and joint not in pair_by_joint:
                self._linkage.notes.append(
                    f"actuator {name} left out: its joint cannot turn"
                )
            elif is_at_joint and bias is not None:
                pair = pair_by_joint[joint]
                yield name, self._write_pair_torque(actuator, name, bias, pair.name)
            elif is_at_site and bias is not None and self._is_constant(actuator, bias):
                for table in self._write_wrench(actuator, bias[0]):
                    yield name, table
            else:
                self._linkage.notes.append(
                    f"actuator {name} left out: it is not a constant load"
                )

    def _is_disabled(self, actuator: int) -> bool:
        """Return whether the file disables an actuator: all of them, or its group."""
        options = self._mj_model.opt
        bits = self._linkage.foreign_model.mujoco.mjtDisableBit
        group = int(self._mj_model.actuator_group[actuator])
        # MuJoCo can disable the groups 0 to 30.
        is_group_disabled = 0 <= group <= 30 and options.disableactuator >> group & 1
        return bool(options.disableflags & int(bits.mjDSBL_ACTUATION) or is_group_disabled)

    def _find_bias(self, actuator: int) -> Floats | None:
        """Return the coefficients (3,) of the force of an actuator without control signal.

        The force is bias[0] + bias[1] * length + bias[2] * rate, with the length of the
        actuator and the rate of this length. The result is None if the force is not linear,
        as that of a muscle. If the force is constant, bias[0] is limited to the force range
        of the actuator.
        """
        mj_model = self._mj_model
        kinds = self._linkage.foreign_model.mujoco.mjtBias
        kind = mj_model.actuator_biastype[actuator]
        if kind == kinds.mjBIAS_NONE:
            return np.zeros(3)
        if kind != kinds.mjBIAS_AFFINE:
            return None
        bias: Floats = mj_model.actuator_biasprm[actuator][:3].copy()
        if mj_model.actuator_forcelimited[actuator] and not np.any(bias[1:]):
            bias[0] = np.clip(bias[0], *mj_model.actuator_forcerange[actuator])
        return bias

    def _note_lost_control(self, actuator: int, name: str, is_at_joint: bool) -> None:
        """Add a note on what is lost of an actuator that is driven by a control signal.

        At a hinge such an actuator becomes an input. The feedback of the actuator, a force
        that depends on the angle or rate of the hinge, is lost. An actuator elsewhere is
        lost as a whole.

        Parameters
        ----------
        actuator, name
            Number and name of the actuator.
        is_at_joint
            Whether the actuator acts at a hinge.
        """
        if not is_at_joint:
            self._linkage.notes.append(f"actuator {name} left out: it drives no hinge")
            return
        # In MuJoCo, the feedback is bias[0] + bias[1] * length + bias[2] * rate, where the
        # length of the actuator is proportional to the angle of the hinge.
        kinds = self._linkage.foreign_model.mujoco.mjtBias
        has_bias = self._mj_model.actuator_biastype[actuator] != kinds.mjBIAS_NONE
        has_feedback = has_bias and np.any(self._mj_model.actuator_biasprm[actuator][:3])
        # When spherekit exports a mechanism without masses, it makes up masses and adds
        # feedback. The loss of this feedback needs no note.
        is_added_by_export = self._linkage.foreign_model.has_made_up_masses
        if has_feedback and not is_added_by_export:
            self._linkage.notes.append(f"feedback of actuator {name} left out")

    def _write_pair_torque(
        self, actuator: int, name: str, bias: Floats, pair_name: str
    ) -> Table:
        """Return the table of an actuator's torque, linear in a pair angle and its rate.

        In MuJoCo, an actuator at a hinge acts like a cable of the length L = g theta, with
        the gear ratio g and the angle theta of the pair (joint). Without control, its force
        is b0 + b1 L + b2 dL/dt. The torque at the pair is g times the force:

            g b0 + g^2 b1 theta + g^2 b2 dtheta.

        The table has this formula as text. Summands that are zero are left out. Limits of
        the torque are left out with a note to the user.

        Parameters
        ----------
        actuator, name
            Number and name of an actuator at a hinge, without control.
        bias
            (3,) b0, b1 and b2.
        pair_name
            Name of the pair.
        """
        mj_model = self._mj_model
        joint, _ = mj_model.actuator_trnid[actuator]
        # The limits of a constant force are not lost: `_find_bias` has applied them to b0.
        is_force_limited = mj_model.actuator_forcelimited[actuator] and np.any(bias[1:])
        if is_force_limited or mj_model.jnt_actfrclimited[joint]:
            self._linkage.notes.append(f"limits of the torque of actuator {name} left out")
        gear = mj_model.actuator_gear[actuator][0]
        factors = round_components(gear * bias * [1.0, gear, gear])
        multiplied_names = ("", f"*theta_{pair_name}", f"*dtheta_{pair_name}")
        summands = [
            f"({factor}){multiplied_name}"
            for factor, multiplied_name in zip(factors, multiplied_names, strict=True)
            if factor
        ]
        return {"pair": pair_name, "torque": " + ".join(summands) or "0"}

    def _is_constant(self, actuator: int, bias: Floats) -> bool:
        """Return whether an actuator at a site is a constant force or moment.

        A mechanism file can only have such loads, constant in the axes of their link or of
        the ground. A site is a frame on a body. The actuator acts along axes of its own
        site, or of a reference site if it has one. The reference site must be fixed to the
        world.

        Parameters
        ----------
        actuator
            Number of an actuator at a site, without control signal.
        bias
            (3,) the coefficients b of its force b[0] + b[1] * length + b[2] * rate. The
            length of the actuator and the rate of this length depend on the motion.
        """
        mj_model = self._mj_model
        has_feedback = np.any(bias[1:3])
        if has_feedback:
            return False
        _, reference_site = mj_model.actuator_trnid[actuator]
        has_reference_site = reference_site >= 0
        if not has_reference_site:
            return True
        # `body_weldid` is the body to which a body is welded; the world is body 0.
        reference_body = mj_model.site_bodyid[reference_site]
        return bool(mj_model.body_weldid[reference_body] == 0)

    def _write_wrench(self, actuator: int, magnitude: float) -> Iterator[Table]:
        """Yield the tables of the constant force and moment of an actuator at a site.

        A site is a frame on a body. A force or moment of zero is left out. Force and moment
        are constant in the axes of the link. If the actuator has a reference site, which is
        fixed to the ground, they are constant in ground axes.

        Parameters
        ----------
        actuator
            Number of an actuator for which `_is_constant` is true.
        magnitude
            Scalar force of the actuator. Its six gear factors turn it into the components
            of force and moment.
        """
        mj_model = self._mj_model
        # The actuator acts at `site`. A `reference_site` of -1 means that there is none.
        site, reference_site = mj_model.actuator_trnid[actuator]
        is_in_link_axes = reference_site < 0
        axes_site = site if is_in_link_axes else reference_site
        # From axes of the site to world axes. In the pose of the model, the axes of all
        # imported links coincide with the world axes. So a vector has the same components
        # in link axes and in ground axes.
        rotation = self._mj_data.site_xmat[axes_site].reshape(3, 3)
        link = self._linkage.link_by_body[mj_model.site_bodyid[site]]
        # MuJoCo multiplies the scalar force of an actuator by six numbers, its gear. This
        # gives the components of the force and then those of the moment.
        wrench = mj_model.actuator_gear[actuator] * magnitude
        # From the centre of the sphere to the point at which the force acts (m).
        arm = self._mj_data.site_xpos[site] - self._linkage.centre
        link_name = self._linkage.link_name(link)
        axes = "link" if is_in_link_axes else "ground"
        force = wrench[:3]
        moment = wrench[3:]
        if np.any(force):
            yield {
                "kind": "force",
                "link": link_name,
                "point": round_components(arm),
                "force": _as_texts(rotation @ force),
                "axes": axes,
            }
        if np.any(moment):
            yield {
                "kind": "moment",
                "link": link_name,
                "moment": _as_texts(rotation @ moment),
                "axes": axes,
            }


def _round_alone(value: float) -> float:
    """Return a number without the digits that are only its own rounding errors."""
    return round_to_short_decimal(value, value)


def _tensor_rows(tensor: Floats) -> list[list[float]]:
    """Return a tensor (3, 3) as short decimals, row by row."""
    largest = max_abs(tensor)
    return [
        [round_to_short_decimal(x, largest, TENSOR_ROUNDING) for x in row] for row in tensor
    ]


def _as_texts(vector: Floats) -> list[Any]:
    """Return the components of a vector (3,) as texts of short decimals."""
    return [str(component) for component in round_components(vector)]
