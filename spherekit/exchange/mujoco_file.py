"""MuJoCo's reading of MJCF and URDF files; the only module that imports mujoco."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from spherekit.arrays import Floats
from spherekit.conventions import Lines
from spherekit.errors import FileError
from spherekit.exchange.mujoco_cleaning import drop_missing_files, replace_ball_joints
from spherekit.exchange.urdf_loops import TURNING, Element, _vector
from spherekit.exchange.urdf_transmissions import (
    DrivenJoint,
    DrivenWheel,
    describe_motors,
    name_wheels,
    read_transmissions,
)
from spherekit.geometry.vectors import max_abs
from spherekit.wording import counted, listing

KINDS = (*TURNING, "spherical", "ball", "fixed")
"""The types of loop joints."""
ENDS = ("link1", "link2", "predecessor", "successor", "parent", "child")
"""What their links are called."""


MASSLESS = 1e-14
"""kg: what bodies without a mass are given, since MuJoCo reads none without."""

ROUNDING, CLOSED = 1e-16, 1e-12
"""Loops open by less (m, rad) are closed: at once, and where no step brings more."""
MOST_STEPS = 60

NAMELESS = ("", "MuJoCo Model")
"""What MuJoCo calls models without a name."""


class ObservedLink(NamedTuple):
    """An output: a body, the one it is observed from, and a point (3,) it points to."""

    name: str
    body: int
    reference: int
    point: Floats | None


class ForeignModel:
    """What an MJCF or URDF file holds, with its loops closed.

    `mj` is MuJoCo, `m` and `d` are its model and its data in that pose, in which each
    joint has one variable; `joints` and `bodies` are names. `holds` are the points (3,) by
    which loops are closed, with their names and the two bodies that they hold to each
    other, `welds` the two bodies of each weld. `locked` are the joints that do not turn,
    `couplings` the sums of rates that are zero, as factors by joint, with their names,
    `balls` the three hinges by number that stand for each ball joint, `outputs` what
    sensors observe, `drives` the actuated joints with the ends of their range where the
    file has some, `values` the variables of holds where it says so; `made_up` says that the
    masses are; `gravity` is the acceleration (3,) or None; `notes` what is not here.

    Raises
    ------
    FileError
        If MuJoCo is not installed or cannot read the file, it has joints that are no
        hinges, or loops that do not close near its pose.
    """

    def __init__(self, path: Path) -> None:
        try:
            import mujoco
        except ImportError:
            raise FileError(
                f"{path}: MJCF and URDF are read by MuJoCo, which is not installed; "
                'install it with: pip install "spherekit-mechanisms[import]"'
            ) from None
        self.mj: Any = mujoco
        self.path, self.notes = path, list[str]()
        self.hinged: dict[str, Floats] = {}
        self.transmissions: list[DrivenJoint | DrivenWheel] = []
        root = self._root()
        urdf = root.tag == "robot"
        try:
            spec = self._of_urdf(root) if urdf else self.mj.MjSpec.from_file(str(path))
            if not urdf:
                self.notes += drop_missing_files(mujoco, spec, path.parent)
            ball_hinges, notes = replace_ball_joints(mujoco, spec)
            self.notes += notes
            spec.compiler.boundmass = spec.compiler.boundmass or MASSLESS
            spec.compiler.boundinertia = spec.compiler.boundinertia or MASSLESS
            m = self.m = spec.compile()
        except ValueError as error:
            said = " ".join(str(error).split())
            raise FileError(f"{path}: MuJoCo does not read it: {said}") from None
        m.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.d: Any = mujoco.MjData(m)
        self.joints: Lines = [m.joint(k).name for k in range(m.njnt)]
        self.bodies = [named(m.body(k), "body", k) for k in range(m.nbody)]
        self._need_hinges()
        self.balls = {
            ball: [self.joints.index(hinge) for hinge in hinges]
            for ball, hinges in ball_hinges.items()
        }
        numbers = {numeric.name: numeric.data for numeric in spec.numerics}
        self.drives = self._drives(root, numbers)
        self._close()
        self.holds: list[tuple[str, tuple[int, int], Floats]] = []
        self.welds: list[tuple[int, int]] = []
        self.couplings: list[tuple[str, Mapping[int, float]]] = []
        self.locked: set[int] = set()
        for k in np.flatnonzero(m.eq_active0).tolist():
            self._take_equality(k)
        self.outputs = self._observed_links()
        texts = {text.name: text.data for text in spec.texts}
        self.made_up = texts.get("masses") == "made up"
        self.values = {
            name.removeprefix("value_"): float(data[0])
            for name, data in numbers.items()
            if name.startswith("value_")
        }
        self.name = path.stem if spec.modelname in NAMELESS else str(spec.modelname)
        self.source = f"{'URDF' if urdf else 'MuJoCo model'} {path.name}"
        off = m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        acts = not (urdf or off) and np.any(m.opt.gravity)
        self.gravity: Floats | None = m.opt.gravity.copy() if acts else None
        if urdf:
            self.notes.append("gravity left out: a URDF does not say where it acts")

    def _root(self) -> Element:
        try:
            root = ElementTree.parse(self.path).getroot()
        except OSError as error:
            raise FileError(
                f"{self.path}: cannot be read: {error.strerror or error}"
            ) from None
        except (ElementTree.ParseError, ValueError) as error:
            raise FileError(f"{self.path}: is no XML: {error}") from None
        if root.tag not in ("mujoco", "robot"):
            raise FileError(
                f"{self.path}: its first element is <{root.tag}>; allowed: <mujoco> (MJCF) "
                "and <robot> (URDF)"
            )
        return root

    def _of_urdf(self, root: Element) -> Any:
        """Return what MuJoCo makes of a URDF, with its loops as constraints."""
        # Looks and contacts name files that may be missing.
        for link in root.iter("link"):
            for looks in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(looks)
        transmissions, notes = read_transmissions(root, self.path)
        self.transmissions = name_wheels(root, transmissions)
        self.notes += [*notes, *describe_motors(self.transmissions)]
        spec = self.mj.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        spec.compiler.fusestatic = False
        for drive in self.transmissions:
            if isinstance(drive, DrivenWheel):
                self._add_wheel(spec, drive)
        try:
            for item in [*root.findall("loop_joint"), *root.findall("loop")]:
                self._add_loop(spec, item)
        except ValueError as error:
            raise FileError(f"{self.path}: a loop joint has no numbers: {error}") from None
        return spec

    def _add_wheel(self, spec: Any, drive: DrivenWheel) -> None:
        """Add the wheel of a motor, coupled with two joints by a tendon of fixed length."""
        joint = spec.joint(drive.inner_joint)
        if joint is None or spec.joint(drive.outer_joint) is None:
            raise FileError(
                f"{self.path}: transmission {drive.transmission}: joints "
                f"{drive.inner_joint} and {drive.outer_joint} do not both turn"
            )
        carrier = joint.parent.parent
        # The wheel stands where the link of the inner joint does, and turns about its axis.
        wheel = carrier.add_body(
            name=drive.wheel, pos=joint.parent.pos, quat=joint.parent.quat
        )
        wheel.add_joint(name=drive.wheel, type=joint.type, pos=joint.pos, axis=joint.axis)
        tendon = spec.add_tendon(name=drive.wheel)
        tendon.wrap_joint(drive.wheel, 1.0)
        tendon.wrap_joint(drive.inner_joint, -1.0)
        tendon.wrap_joint(drive.outer_joint, -drive.ratio)
        spec.add_equality(
            name=f"{drive.wheel}_mesh",
            type=self.mj.mjtEq.mjEQ_TENDON,
            objtype=self.mj.mjtObj.mjOBJ_TENDON,
            name1=drive.wheel,
        )

    def _add_loop(self, spec: Any, item: Element) -> None:
        """Take a loop joint of a URDF as constraints of sites.

        It has two links, with the place and the axes of the joint on each; its axis is the
        first one's.
        """
        kind, name = item.get("type", "spherical"), item.get("name", "loop")
        where = f"{self.path}: loop joint {name}"
        if kind not in KINDS:
            raise FileError(f'{where}: type "{kind}"; allowed: {listing(KINDS)}')
        ends = [(tag, end) for tag in ENDS for end in item.findall(tag)]
        if len(ends) != 2:
            raise FileError(
                f"{where}: has {counted(len(ends), 'link')}, needs 2: link1 and link2, "
                "predecessor and successor, or parent and child with origins"
            )
        for k, (tag, end) in enumerate(ends):
            places = end.find("origin"), item.find(f"{tag}_origin"), end
            origin = next(place for place in places if place is not None)
            body = spec.body(end.get("link", ""))
            if body is None:
                raise FileError(f'{where}: no link "{end.get("link", "")}"')
            body.add_site(name=f"{name}_{k}", pos=_vector(origin, "xyz"))
            if kind in TURNING and not k:
                given = item.find("axis")
                axis = np.eye(3)[0] if given is None else _vector(given, "xyz")
                turn = Rotation.from_euler("xyz", _vector(origin, "rpy"))
                self.hinged[name] = turn.apply(axis) / np.linalg.norm(axis)
        eq, objects = self.mj.mjtEq, self.mj.mjtObj
        held = {"type": eq.mjEQ_CONNECT, "objtype": objects.mjOBJ_SITE}
        one, other = f"{name}_0", f"{name}_1"
        if kind == "fixed":
            held = {"type": eq.mjEQ_WELD, "objtype": objects.mjOBJ_BODY}
            one, other = (end.get("link", "") for _, end in ends)
        spec.add_equality(name=name, name1=one, name2=other, **held)

    def _need_hinges(self) -> None:
        kinds = [self.mj.mjtJoint(int(k)).name[6:].lower() for k in self.m.jnt_type]
        wrong = [
            f"{name or f'joint{k}'} ({kind})"
            for k, (name, kind) in enumerate(zip(self.joints, kinds, strict=True))
            if kind != "hinge"
        ]
        if wrong:
            raise FileError(
                f"{self.path}: links of spherical mechanisms turn on hinges and ball "
                f"joints; other joints: {listing(wrong)}. Fix the base; weld what slides"
            )
        if not kinds:
            raise FileError(f"{self.path}: has no hinge, so that nothing moves")
        if not all(self.joints):
            raise FileError(
                f"{self.path}: joint {self.joints.index('')} has no name; name all joints, "
                "since pairs are named after them"
            )

    def _close(self) -> None:
        """Close all loops, by the passive joints if that can be."""
        d, every = self.d, range(self.m.nv)
        start = d.qpos.copy()
        passive = [k for k in every if k not in self.drives]
        if not (self._converged(passive) or self._converged([*every])):
            d.qpos[:] = start
            rows, gap = self._gaps()
            gaps: dict[str, float] = {}
            for number, size in zip(d.efc_id[rows].tolist(), np.abs(gap), strict=True):
                name = named(self.m.eq(number), "equality", number)
                gaps[name] = max(gaps.get(name, 0.0), size)
            told = listing(f"{name} by {gap:.3g}" for name, gap in gaps.items())
            raise FileError(
                f"{self.path}: loops do not close near the pose of the file: {told} (m or "
                "rad); give a pose in which they do, by ref of the joints"
            )
        moved = max_abs(d.qpos - start)
        if moved > 1e-9:
            self.notes.append(
                f"loops are open in the file's pose; joints were turned by up to "
                f"{np.degrees(moved):.4g} deg to close them"
            )

    def _gaps(self) -> tuple[Any, Floats]:
        """Return which constraints are those of loops, and by how much they are open."""
        self.mj.mj_forward(self.m, self.d)
        rows = self.d.efc_type == self.mj.mjtConstraint.mjCNSTR_EQUALITY
        return rows, self.d.efc_pos[rows]

    def _converged(self, free: list[int]) -> bool:
        """Step by Newton's method until rounding is all that is left; say if it is."""
        d, before = self.d, np.inf
        for _ in range(MOST_STEPS):
            rows, gap = self._gaps()
            size = max_abs(gap)
            if size < ROUNDING or CLOSED > size > 0.5 * before:
                return True
            before = size
            jacobian = d.efc_J.reshape(d.nefc, self.m.nv)[rows][:, free]
            step = np.linalg.lstsq(jacobian, gap, rcond=1e-9)[0]
            d.qpos[free] -= step * (0.5 / max(max_abs(step), 0.5))
        return False

    def _drives(
        self, root: Element, numbers: Mapping[str, Sequence[float]]
    ) -> dict[int, Sequence[float] | None]:
        m = self.m
        drives: dict[int, Sequence[float] | None] = {}
        through_wheels = set[str]()
        for drive in self.transmissions:
            name = drive.wheel if isinstance(drive, DrivenWheel) else drive.joint
            if isinstance(drive, DrivenWheel):
                through_wheels |= {drive.inner_joint, drive.outer_joint}
            if name in self.joints:
                drives[self.joints.index(name)] = None
        for joint in root.iterfind(".//ros2_control/joint"):
            name = joint.get("name", "")
            commanded = joint.find("command_interface") is not None
            if commanded and name in self.joints and name not in through_wheels:
                drives[self.joints.index(name)] = None
        for k in range(m.nu):
            at_joint = m.actuator_trntype[k] == self.mj.mjtTrn.mjTRN_JOINT
            if at_joint and np.any(m.actuator_gainprm[k]):
                servo = m.actuator_ctrllimited[k] and m.actuator_biasprm[k][1] != 0.0
                ends = m.actuator_ctrlrange[k].tolist() if servo else None
                drives[int(m.actuator_trnid[k][0])] = ends
        for k in drives:
            ends = numbers.get(f"input_{self.joints[k]}", [])
            if len(ends) == 2:
                drives[k] = [*map(float, ends)]
        return drives

    def _take_equality(self, k: int) -> None:
        """Take what an equality holds, locks or couples; note one that is left out."""
        m, d, eq = self.m, self.d, self.mj.mjtEq
        kind, one, other = eq(int(m.eq_type[k])), m.eq_obj1id[k], m.eq_obj2id[k]
        name = named(m.eq(k), "equality", k)
        if kind == eq.mjEQ_TENDON and not m.eq(k).name:
            name = named(m.tendon(one), "equality", k)
        if kind == eq.mjEQ_JOINT and other < 0:
            self.locked.add(one)
        elif kind in (eq.mjEQ_JOINT, eq.mjEQ_TENDON):
            self.couplings.append((name, self._factors(k, name)))
        elif kind not in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            self.notes.append(f"{name} left out")
        else:
            name = named(m.eq(k), "loop", k)
            if m.eq_objtype[k] == self.mj.mjtObj.mjOBJ_SITE:
                points = [d.site_xpos[one].copy()]
                one, other = m.site_bodyid[one], m.site_bodyid[other]
            else:
                points = [d.xpos[one] + d.xmat[one].reshape(3, 3) @ m.eq_data[k][:3]]
            if name in self.hinged:
                points.append(points[0] + d.xmat[one].reshape(3, 3) @ self.hinged[name])
            if kind == eq.mjEQ_WELD:
                self.welds.append((one, other))
            else:
                self.holds += [(name, (one, other), point) for point in points]

    def _observed_links(self) -> list[ObservedLink]:
        """Return the bodies whose orientation a sensor reads relative to another body."""
        m, body = self.m, self.mj.mjtObj.mjOBJ_BODY
        observed: list[ObservedLink] = []
        for k in range(m.nsensor):
            is_orientation = m.sensor_type[k] == self.mj.mjtSensor.mjSENS_FRAMEQUAT
            kinds = {int(m.sensor_objtype[k]), int(m.sensor_reftype[k])}
            if not is_orientation or kinds != {int(body)}:
                continue
            name = named(m.sensor(k), "output", k)
            link, reference = int(m.sensor_objid[k]), int(m.sensor_refid[k])
            # An exported output that points has a site of its name on the link.
            sites = [
                site
                for site in range(m.nsite)
                if m.site(site).name == name and m.site_bodyid[site] == link
            ]
            point = self.d.site_xpos[sites[0]].copy() if sites else None
            observed.append(ObservedLink(name, link, reference, point))
        return observed

    def _factors(self, k: int, name: str) -> Mapping[int, float]:
        """Return the factors of the rates of joints, by joint, that an equality couples."""
        m, factors = self.m, defaultdict[int, float](float)
        if np.any(m.eq_data[k][2:5]):
            raise FileError(
                f"{self.path}: {name} couples joints at a ratio that changes; a "
                "mechanism file has profiles in contact for that. Take it out of a copy"
            )
        ends = (m.eq_obj1id[k], 1.0), (m.eq_obj2id[k], -m.eq_data[k][1])
        for item, ratio in (end for end in ends if end[0] >= 0):
            if m.eq_type[k] == self.mj.mjtEq.mjEQ_JOINT:
                factors[item] += ratio
                continue
            first = m.tendon_adr[item]
            places = slice(first, first + m.tendon_num[item])
            if np.any(m.wrap_type[places] != self.mj.mjtWrap.mjWRAP_JOINT):
                raise FileError(
                    f"{self.path}: {name} holds a tendon that runs through space; a "
                    "mechanism file has none. Take it out of a copy"
                )
            for joint, factor in zip(m.wrap_objid[places], m.wrap_prm[places], strict=True):
                factors[joint] += ratio * factor
        return factors


def named(item: Any, what: str, number: int) -> str:
    """Return the name of something in a model, or what it is and its number."""
    return str(item.name or f"{what}{number}")
