"""MJCF and URDF files as read by MuJoCo; the only module that imports mujoco."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import FileError
from spherekit.exchange.gear_couplings import Coupling
from spherekit.exchange.mujoco_cleaning import drop_missing_files, replace_ball_joints
from spherekit.exchange.mujoco_loops import close_loops, element_name
from spherekit.exchange.urdf_file import read_urdf
from spherekit.exchange.urdf_loops import Element
from spherekit.exchange.urdf_transmissions import DrivenJoint, DrivenWheel
from spherekit.wording import listing

MASSLESS_KG = 1e-14
"""Mass (kg) and moment of inertia (kg m2) that bodies without mass are given.

MuJoCo refuses moving bodies without mass. Bodies with more are imported with their mass.
"""

UNNAMED_MODELS = ("", "MuJoCo Model")
"""Names that MuJoCo gives to models without a name."""


class ObservedLink(NamedTuple):
    """A body of a MuJoCo model whose orientation a sensor reads.

    The body becomes an output (observed link) of the imported mechanism.

    Attributes
    ----------
    name
        Name of the sensor.
    body, reference
        Number of the body, and of the body relative to which the sensor reads the
        orientation; 0 (the world) if the sensor names none.
    point
        (3,) a point of the body (m, world axes), or None. The direction from the centre of
        the sphere to this point becomes the direction of the output.
    """

    name: str
    body: int
    reference: int
    point: Floats | None


class LoopPoint(NamedTuple):
    """A point that two bodies of a MuJoCo model have in common, which closes a loop.

    Attributes
    ----------
    name
        Name of the equality constraint that holds the bodies together.
    bodies
        Numbers of the two bodies in the model.
    point
        (3,) the point in world axes (m).
    """

    name: str
    bodies: tuple[int, int]
    point: Floats


class ForeignModel:
    """The content of an MJCF or URDF file, in a pose in which its loops are closed.

    Joints, bodies and constraints are numbered as in MuJoCo. Body 0 is the world. All
    joints are hinges, so a joint has one variable of the same number.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    mj_model, mj_data
        MuJoCo's model, and its data in the closed pose.
    name
        Name of the model, or of the file if the model has none.
    source
        The format and name of the file, in words.
    joint_names, body_names
        Names of the joints and of the bodies.
    loop_points
        The points at which constraints close loops.
    welded_bodies
        The two bodies of each weld (constraint that joins bodies rigidly).
    couplings
        Linear equations between the rates of joints.
    locked_joints
        Joints that a constraint keeps at a constant angle.
    hinges_by_ball
        For each ball joint of the file, by name, the three hinges that replace it.
    observed_links
        Bodies whose orientation a sensor reads.
    driven_ranges
        For each driven joint the ends of its range (rad), or None if the file states none.
    loop_values
        Variables (rad) of the pairs that close loops, by the name of the constraint, if the
        file states them.
    has_made_up_masses
        Whether the file says that its masses are invented (spherekit writes this at
        export).
    gravity
        (3,) acceleration (m/s2) in world axes, or None if none acts.
    notes
        What was left out or changed, in sentences.

    Raises
    ------
    FileError
        If MuJoCo is not installed or cannot read the file, or if the file has joints that
        are no hinges, numbers that are not finite, or loops that do not close near its
        pose.
    """

    def __init__(self, path: Path) -> None:
        """Compile a model with MuJoCo, close its loops, and read its constraints."""
        try:
            import mujoco
        except ImportError:
            raise FileError(
                f"{path}: MJCF and URDF are read by MuJoCo, which is not installed; "
                'install it with: pip install "spherekit-mechanisms[import]"'
            ) from None
        self.mujoco: Any = mujoco
        self._path = path
        self.notes: list[str] = []
        self._loop_axes: Mapping[str, Floats] = {}
        self._transmissions: Sequence[DrivenJoint | DrivenWheel] = []
        root = _parse_xml(path)
        is_urdf = root.tag == "robot"
        try:
            spec = self._read_spec(root, is_urdf)
            ball_hinges, notes = replace_ball_joints(mujoco, spec)
            self.notes += notes
            self._check_stated_inertias(spec)
            # MuJoCo refuses moving bodies without mass, so a tiny mass is the lower bound.
            spec.compiler.boundmass = spec.compiler.boundmass or MASSLESS_KG
            spec.compiler.boundinertia = spec.compiler.boundinertia or MASSLESS_KG
            mj_model = spec.compile()
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise FileError(f"{path}: MuJoCo cannot read the file: {reason}") from None
        mj_model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # `close_loops` reads it
        # At a hinge, both of these transmissions are the same.
        transmissions = mj_model.actuator_trntype
        is_in_parent = transmissions == mujoco.mjtTrn.mjTRN_JOINTINPARENT
        transmissions[is_in_parent] = mujoco.mjtTrn.mjTRN_JOINT
        self.mj_model: Any = mj_model
        self._drop_disabled_parts()
        self.mj_data: Any = mujoco.MjData(mj_model)
        self.joint_names: list[str] = [
            mj_model.joint(joint).name for joint in range(mj_model.njnt)
        ]
        self.body_names = [
            element_name(mj_model.body(body), "body", body)
            for body in range(mj_model.nbody)
        ]
        self._check_joints()
        self._check_numbers()
        self.hinges_by_ball = {
            ball: [self.joint_names.index(hinge) for hinge in hinges]
            for ball, hinges in ball_hinges.items()
        }
        numbers_by_name = {numeric.name: numeric.data for numeric in spec.numerics}
        self.driven_ranges = self._find_driven_ranges(root, numbers_by_name)
        self.notes += close_loops(mujoco, mj_model, self.mj_data, self.driven_ranges, path)

        self.loop_points: list[LoopPoint] = []
        self.welded_bodies: list[tuple[int, int]] = []
        self.couplings: list[Coupling] = []
        self.locked_joints: set[int] = set()
        equalities = np.flatnonzero(mj_model.eq_active0).tolist()
        bits = mujoco.mjtDisableBit
        disabled = int(bits.mjDSBL_CONSTRAINT) | int(bits.mjDSBL_EQUALITY)
        if equalities and mj_model.opt.disableflags & disabled:
            self.notes.append("equality constraints left out: the file disables them")
            equalities = []
        for equality in equalities:
            self._read_equality(equality)
        self.observed_links = self._find_observed_links()

        # Custom numbers and texts that `spherekit export` writes.
        texts_by_name = {text.name: text.data for text in spec.texts}
        self.has_made_up_masses = texts_by_name.get("masses") == "made up"
        self.loop_values = {
            name.removeprefix("value_"): float(data[0])
            for name, data in numbers_by_name.items()
            if name.startswith("value_")
        }
        has_name = spec.modelname not in UNNAMED_MODELS
        self.name = str(spec.modelname) if has_name else path.stem
        self.source = f"{'URDF' if is_urdf else 'MuJoCo model'} {path.name}"
        is_disabled = mj_model.opt.disableflags & int(bits.mjDSBL_GRAVITY)
        has_gravity = not (is_urdf or is_disabled) and np.any(mj_model.opt.gravity)
        self.gravity: Floats | None = mj_model.opt.gravity.copy() if has_gravity else None
        if is_urdf:
            self.notes.append("gravity left out: a URDF does not say where it acts")

    def _read_spec(self, root: Element, is_urdf: bool) -> Any:
        """Return the `MjSpec` of the file, before it is compiled."""
        if is_urdf:
            urdf_content = read_urdf(self.mujoco, root, self._path)
            self._transmissions = urdf_content.transmissions
            self._loop_axes = urdf_content.loop_axes
            self.notes += urdf_content.notes
            return urdf_content.spec
        spec = self.mujoco.MjSpec.from_file(str(self._path))
        self.notes += drop_missing_files(self.mujoco, spec, self._path.parent)
        return spec

    def _drop_disabled_parts(self) -> None:
        """Set to zero what flags of the file disable, so that it is not imported.

        Flags can disable springs, dampers, dry friction, limits, and the compensation of
        weight. A note tells the user what was left out.
        """
        mj_model = self.mj_model
        bits = self.mujoco.mjtDisableBit
        flags = mj_model.opt.disableflags
        no_springs = bool(flags & int(bits.mjDSBL_SPRING))
        no_dampers = bool(flags & int(bits.mjDSBL_DAMPER))
        no_constraints = bool(flags & int(bits.mjDSBL_CONSTRAINT))
        no_friction = no_constraints or bool(flags & int(bits.mjDSBL_FRICTIONLOSS))
        no_limits = no_constraints or bool(flags & int(bits.mjDSBL_LIMIT))
        for what, is_disabled, arrays in (
            (
                "springs",
                no_springs,
                (
                    mj_model.jnt_stiffness,
                    mj_model.jnt_stiffnesspoly,
                    mj_model.tendon_stiffness,
                    mj_model.tendon_stiffnesspoly,
                ),
            ),
            (
                "dampers",
                no_dampers,
                (
                    mj_model.dof_damping,
                    mj_model.dof_dampingpoly,
                    mj_model.tendon_damping,
                    mj_model.tendon_dampingpoly,
                    mj_model.actuator_damping,
                    mj_model.actuator_dampingpoly,
                ),
            ),
            (
                "dry friction",
                no_friction,
                (mj_model.dof_frictionloss, mj_model.tendon_frictionloss),
            ),
            ("limits", no_limits, (mj_model.jnt_limited, mj_model.tendon_limited)),
            # Without springs and dampers, MuJoCo does not compensate weight either.
            ("weight compensation", no_springs and no_dampers, (mj_model.body_gravcomp,)),
        ):
            if is_disabled and any(np.any(array) for array in arrays):
                self.notes.append(f"{what} left out: disabled by a flag of the file")
                for array in arrays:
                    array[:] = 0

    def _check_joints(self) -> None:
        """Raise `FileError` unless there are joints, and all of them are hinges with names.

        Ball joints of the file were replaced by hinges before this check.
        """
        other_joints: list[str] = []
        for joint, joint_type in enumerate(self.mj_model.jnt_type):
            # MuJoCo's names of types are mjJNT_HINGE and the like.
            type_name = self.mujoco.mjtJoint(int(joint_type)).name
            kind = type_name.removeprefix("mjJNT_").lower()
            if kind != "hinge":
                joint_name = self.joint_names[joint] or f"joint{joint}"
                other_joints.append(f"{joint_name} ({kind})")
        if other_joints:
            raise FileError(
                f"{self._path}: links of a spherical mechanism are joined by hinges and "
                f"ball joints, but the file has other joints: {listing(other_joints)}. Fix "
                "the base, and weld bodies that slide"
            )
        if not self.joint_names:
            raise FileError(f"{self._path}: has no hinge, so no link can move")
        if not all(self.joint_names):
            raise FileError(
                f"{self._path}: joint {self.joint_names.index('')} has no name; name all "
                "joints, since pairs are named after them"
            )

    def _check_stated_inertias(self, spec: Any) -> None:
        """Raise `FileError` unless the stated masses, tensors and densities are finite.

        Only the numbers that MuJoCo would use for a body are checked. MuJoCo takes some of
        these numbers as not stated if they are ``nan`` or ``inf``.

        Parameters
        ----------
        spec
            The `MjSpec`, before it is compiled.
        """
        always_from_shapes = (
            spec.compiler.inertiafromgeom
            == self.mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        )
        for number, body in enumerate(spec.bodies):
            if always_from_shapes or not body.explicitinertial:
                # MuJoCo's mark of a mass that is not stated is nan.
                numbers = [geom.density for geom in body.geoms if np.isnan(geom.mass)]
            else:
                numbers = [body.mass, *body.ipos, *body.iquat, *body.inertia]
                # A tensor that is not stated is (nan, 0, 0, 0, 0, 0).
                if not np.isnan(body.fullinertia[0]) or np.any(body.fullinertia[1:]):
                    numbers += [*body.fullinertia]
            for value in numbers:
                if not np.isfinite(value):
                    name = element_name(body, "body", number)
                    raise FileError(
                        f"{self._path}: body {name}: found {value}, expected finite numbers"
                    )

    def _check_numbers(self) -> None:
        """Raise `FileError` unless numbers of bodies, joints and constraints are finite.

        MuJoCo reads ``nan`` and ``inf`` as numbers.
        """
        mj_model = self.mj_model
        # One row for each body, joint and equality constraint. A tendon that is a sum of
        # joint angles has a row for each joint, with the factor of its angle (`wrap_prm`).
        bodies = (
            mj_model.body_pos,
            mj_model.body_quat,
            mj_model.body_mass,
            mj_model.body_ipos,
            mj_model.body_inertia,
        )
        joints = (mj_model.jnt_pos, mj_model.jnt_axis, mj_model.qpos0)
        rows_by_kind = {
            "body": np.column_stack(bodies),
            "joint": np.column_stack(joints),
            "equality": mj_model.eq_data,
            "tendon": mj_model.wrap_prm[:, None],
        }
        tendon_of_wrap = np.repeat(np.arange(mj_model.ntendon), mj_model.tendon_num)
        for kind, rows in rows_by_kind.items():
            for row in np.flatnonzero(~np.all(np.isfinite(rows), axis=1)).tolist():
                number = tendon_of_wrap[row] if kind == "tendon" else row
                # The method of the model with the name `kind` returns one element.
                name = getattr(mj_model, kind)(number).name or number
                value = rows[row][~np.isfinite(rows[row])][0]
                raise FileError(
                    f"{self._path}: {kind} {name}: found {value}, expected finite numbers"
                )

    def _find_driven_ranges(
        self, root: Element, numbers_by_name: Mapping[str, Sequence[float]]
    ) -> dict[int, Sequence[float] | None]:
        """Return the driven joints with the ends of their ranges (rad).

        The import chooses the inputs of the mechanism among the driven joints first. Joints
        of a URDF are driven by transmissions and by command interfaces of ros2_control.
        Joints of an MJCF file are driven by actuators.

        Parameters
        ----------
        root
            The first element of the file.
        numbers_by_name
            Numbers in ``numeric`` elements of an MJCF file, by name. The numbers
            ``input_JOINT`` are the range (rad) of a joint.

        Returns
        -------
        The ends of the range, by the number of the joint; None if the file states no range.
        """
        mj_model = self.mj_model
        ranges: dict[int, Sequence[float] | None] = {}
        joints_on_wheels: set[str] = set()
        for drive in self._transmissions:
            if isinstance(drive, DrivenWheel):
                # In a differential, a motor turns a wheel that turns two joints together.
                # Only the wheel is driven.
                driven_name = drive.wheel
                joints_on_wheels |= {drive.inner_joint, drive.outer_joint}
            else:
                driven_name = drive.joint
            if driven_name in self.joint_names:
                ranges[self.joint_names.index(driven_name)] = None
        for joint_element in root.iterfind(".//ros2_control/joint"):
            name = joint_element.get("name", "")
            is_commanded = joint_element.find("command_interface") is not None
            # A joint that is turned by a wheel is not driven itself.
            if is_commanded and name in self.joint_names and name not in joints_on_wheels:
                ranges[self.joint_names.index(name)] = None
        for actuator in range(mj_model.nactuator):
            is_at_joint = (
                mj_model.actuator_trntype[actuator] == self.mujoco.mjtTrn.mjTRN_JOINT
            )
            # An actuator without control is a load, not a drive.
            if is_at_joint and self.is_controlled(actuator):
                joint = int(mj_model.actuator_trnid[actuator][0])
                # A second actuator, such as a velocity servo, may state no range.
                ranges[joint] = self._find_servo_range(actuator) or ranges.get(joint)
        # The numbers ``input_JOINT`` take precedence over other ranges.
        for joint in ranges:
            stated_range = numbers_by_name.get(f"input_{self.joint_names[joint]}", [])
            if len(stated_range) == 2:
                ranges[joint] = [float(end) for end in stated_range]
        return ranges

    def is_controlled(self, actuator: int) -> bool:
        """Return whether the force of a MuJoCo actuator depends on a control signal.

        The force is gain * control + bias, where only the bias may depend on the motion. A
        gain other than zero means that control changes the force. PID controllers have
        their gain in the bias.
        """
        mj_model = self.mj_model
        is_pid = mj_model.actuator_gaintype[actuator] == self.mujoco.mjtGain.mjGAIN_PID
        return bool(is_pid or np.any(mj_model.actuator_gainprm[actuator]))

    def _find_servo_range(self, actuator: int) -> list[float] | None:
        """Return the range (rad) of the angles that a servo at a hinge can be told to take.

        A servo is an actuator with position feedback. Its force is gain * control + bias[0]
        + bias[1] * length + bias[2] * rate, where the length is the gear ratio times the
        angle. The control tells the servo to take the angle at which this force is 0 at
        rest. The range of these angles follows from the limits of the control.

        The result is None if the actuator is no servo, or if its control has no limits.
        """
        mj_model = self.mj_model
        gains = self.mujoco.mjtGain
        gear = mj_model.actuator_gear[actuator][0]
        bias = mj_model.actuator_biasprm[actuator]
        gain_type = gains(int(mj_model.actuator_gaintype[actuator]))
        has_feedback = (
            mj_model.actuator_biastype[actuator] == self.mujoco.mjtBias.mjBIAS_AFFINE
            and gain_type in (gains.mjGAIN_FIXED, gains.mjGAIN_PID)
            and bias[1] != 0.0
        )
        if gear == 0.0 or not has_feedback:
            return None
        # A PID controller has its gain in the bias only: -bias[1] times the difference of
        # control and length.
        is_pid = gain_type == gains.mjGAIN_PID
        gain = -bias[1] if is_pid else mj_model.actuator_gainprm[actuator][0]
        if mj_model.actuator_dyntype[actuator] == self.mujoco.mjtDyn.mjDYN_INTEGRATOR:
            # The control is a rate. Its integral (activation) takes its place in the force.
            is_limited = mj_model.actuator_actlimited[actuator]
            controls = mj_model.actuator_actrange[actuator]
        else:
            # An actuator can have further controls, such as the rate.
            first_control = mj_model.actuator_ctrladr[actuator]
            is_limited = mj_model.actuator_ctrllimited[first_control]
            controls = mj_model.actuator_ctrlrange[first_control]
        if not is_limited:
            return None
        lengths = -(gain / bias[1]) * controls - bias[0] / bias[1]
        ends: list[float] = sorted((lengths / gear).tolist())
        return ends

    def _read_equality(self, equality: int) -> None:
        """Store the meaning of an equality constraint: lock, coupling, weld or loop.

        A constraint of one joint locks this joint. A constraint of two joints gives the
        first angle as a polynomial in the second, and locks the first joint if the
        polynomial is constant. Other constraints of two joints, or of tendons (sums of
        joint angles), couple their rates. A weld joins two bodies rigidly, and a common
        point of two bodies closes a loop. Constraints of other kinds are left out with a
        note.

        Parameters
        ----------
        equality
            Number of the constraint in the model.
        """
        mj_model = self.mj_model
        kinds = self.mujoco.mjtEq
        kind = kinds(int(mj_model.eq_type[equality]))
        element = mj_model.eq(equality)
        first_object = mj_model.eq_obj1id[equality]
        second_object = mj_model.eq_obj2id[equality]
        # There is no second joint, or all coefficients of the polynomial in its angle but
        # the constant are zero.
        is_constant = second_object < 0 or not np.any(mj_model.eq_data[equality][1:5])
        if kind == kinds.mjEQ_JOINT and is_constant:
            self.locked_joints.add(first_object)
        elif kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
            named_element = element
            if kind == kinds.mjEQ_TENDON and not element.name:
                # A constraint without a name is called after its tendon.
                named_element = mj_model.tendon(first_object)
            name = element_name(named_element, "equality", equality)
            self.couplings.append(Coupling(name, self._find_factors(equality, name)))
        elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            self._read_loop(equality, is_weld=kind == kinds.mjEQ_WELD)
        else:
            self.notes.append(f"{element_name(element, 'equality', equality)} left out")

    def _read_loop(self, equality: int, is_weld: bool) -> None:
        """Store a weld of two bodies, or a common point that closes a loop.

        The point is computed in world axes in the present pose, in which loops are closed.
        If the model is a URDF file, a joint that closes a loop has an axis, see
        `_loop_axes`. A second common point, on this axis, is then stored too.

        Parameters
        ----------
        equality
            Number of the constraint.
        is_weld
            Whether the constraint is a weld. Otherwise one point of both bodies coincides.
        """
        mj_model = self.mj_model
        mj_data = self.mj_data
        name = element_name(mj_model.eq(equality), "loop", equality)
        # The two objects are sites (points marked on bodies), or bodies.
        first_object = mj_model.eq_obj1id[equality]
        second_object = mj_model.eq_obj2id[equality]
        if mj_model.eq_objtype[equality] == self.mujoco.mjtObj.mjOBJ_SITE:
            point = mj_data.site_xpos[first_object].copy()
            bodies = mj_model.site_bodyid[first_object], mj_model.site_bodyid[second_object]
            rotation = mj_data.xmat[bodies[0]].reshape(3, 3)
        else:
            bodies = first_object, second_object
            rotation = mj_data.xmat[first_object].reshape(3, 3)
            anchor = mj_model.eq_data[equality][:3]
            point = mj_data.xpos[first_object] + rotation @ anchor
        if is_weld:
            self.welded_bodies.append(bodies)
            return
        self.loop_points.append(LoopPoint(name, bodies, point))
        if name in self._loop_axes:
            # The axis is given in the axes of the first body. A second point of this axis
            # coincides in both bodies as well.
            second_point = point + rotation @ self._loop_axes[name]
            self.loop_points.append(LoopPoint(name, bodies, second_point))

    def _find_observed_links(self) -> list[ObservedLink]:
        """Return the bodies whose orientation is read by a sensor.

        Each of these bodies becomes an output (observed link) of the mechanism.
        """
        mj_model = self.mj_model
        objects = self.mujoco.mjtObj
        # MuJoCo has two sets of axes of a body, as two types of object. Both are fixed to
        # the body. A sensor of either type observes the body.
        body_types = {objects.mjOBJ_BODY, objects.mjOBJ_XBODY}
        reference_types = {*body_types, objects.mjOBJ_UNKNOWN}
        orientation_type = self.mujoco.mjtSensor.mjSENS_FRAMEQUAT
        observed_links: list[ObservedLink] = []
        for sensor in range(mj_model.nsensor):
            if (
                mj_model.sensor_type[sensor] != orientation_type
                or objects(int(mj_model.sensor_objtype[sensor])) not in body_types
                or objects(int(mj_model.sensor_reftype[sensor])) not in reference_types
            ):
                continue
            name = element_name(mj_model.sensor(sensor), "output", sensor)
            body = int(mj_model.sensor_objid[sensor])
            # The number is -1 if the orientation is read relative to the world.
            reference = max(int(mj_model.sensor_refid[sensor]), 0)
            # In models that spherekit exported, an output with a direction has a site
            # (marked point) of its name on the link.
            sites = [
                site
                for site in range(mj_model.nsite)
                if mj_model.site(site).name == name and mj_model.site_bodyid[site] == body
            ]
            point = self.mj_data.site_xpos[sites[0]].copy() if sites else None
            observed_links.append(ObservedLink(name, body, reference, point))
        return observed_links

    def _find_factors(self, equality: int, name: str) -> Mapping[int, float]:
        """Return the factors of joint rates in the equation of an equality constraint.

        The constraint says: first object = ratio * second object + constant. The objects
        are joints or tendons (sums of joint angles with factors). In rates: first rate -
        ratio * second rate = 0. The result has the factor of each joint rate in this
        equation.

        Parameters
        ----------
        equality
            Number of a constraint between two joints, or one or two tendons.
        name
            Name of the constraint, for messages.

        Returns
        -------
        The factors, by joint, in a sum of rates that is zero.

        Raises
        ------
        FileError
            If the ratio is not constant, or a tendon runs through space.
        """
        mj_model = self.mj_model
        # The constraint has the coefficients of a polynomial in the second object x:
        # data[0] + data[1] x + data[2] x^2 + ... The ratio is constant if only the first
        # two are used.
        polynomial = mj_model.eq_data[equality]
        if np.any(polynomial[2:5]):
            raise FileError(
                f"{self._path}: {name} couples joints at a ratio that changes; a "
                f"mechanism file expresses this by profiles in contact. Take {name} out of "
                "a copy of the file, and import the copy"
            )
        is_between_joints = mj_model.eq_type[equality] == self.mujoco.mjtEq.mjEQ_JOINT
        factors = defaultdict[int, float](float)
        for item, ratio in (
            (mj_model.eq_obj1id[equality], 1.0),
            (mj_model.eq_obj2id[equality], -polynomial[1]),
        ):
            if item < 0:
                continue  # The constraint has no second object.
            if is_between_joints:
                factors[item] += ratio
                continue
            # A tendon is a sum of joint angles with factors, if it wraps nothing else.
            first_wrap = mj_model.tendon_adr[item]
            wraps = slice(first_wrap, first_wrap + mj_model.tendon_num[item])
            if np.any(mj_model.wrap_type[wraps] != self.mujoco.mjtWrap.mjWRAP_JOINT):
                raise FileError(
                    f"{self._path}: {name} uses a spatial tendon, which a mechanism file "
                    f"cannot have. Take {name} out of a copy of the file, and import the "
                    "copy"
                )
            for joint, factor in zip(
                mj_model.wrap_objid[wraps], mj_model.wrap_prm[wraps], strict=True
            ):
                factors[joint] += ratio * factor
        return factors


def _parse_xml(path: Path) -> Element:
    """Return the first element of a file; raise `FileError` unless it is MJCF or URDF."""
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ElementTree.ParseError, ValueError) as error:
        raise FileError(f"{path}: is not XML: {error}") from None
    if root.tag not in ("mujoco", "robot"):
        raise FileError(
            f"{path}: its first element is <{root.tag}>; allowed: <mujoco> (MJCF) "
            "and <robot> (URDF)"
        )
    return root
