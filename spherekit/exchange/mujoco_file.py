"""MuJoCo's reading of MJCF and URDF files; the only module that imports mujoco.

What URDF files say of loops and drives in elements that the format itself lacks.

Tree joints cannot close loops. In use are `<loop_joint>` with two links and the places on
them (Drake, Isaac Sim, and exporters that write parent and child with origins), and
`<loop>` with `<predecessor>` and `<successor>` (URDF+, Chignoli et al. 2024).
"""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from spherekit.arrays import Floats
from spherekit.conventions import counted, listing
from spherekit.errors import FileError
from spherekit.sphere.rotation import max_abs

Element = ElementTree.Element

TURNING = ("revolute", "continuous")
POINT = ("spherical", "ball")
RIGID = ("fixed",)
ENDS = ("link1", "link2", "predecessor", "successor", "parent", "child")
"""What the links of loop joints are called."""


def _vector(item: Element, key: str) -> Floats:
    return np.array([float(part) for part in (item.get(key) or "0 0 0").split()])


MASSLESS = 1e-14
"""kg: what bodies without a mass are given, since MuJoCo reads none without."""

ROUNDING, CLOSED = 1e-16, 1e-12
"""Loops open by less (m, rad) are closed: at once, and where no step brings more."""
MOST_STEPS = 60

NAMELESS = ("", "MuJoCo Model")
"""What MuJoCo calls models without a name."""


class ForeignModel:
    """What an MJCF or URDF file holds, with its loops closed.

    `m` and `d` are MuJoCo's model and its data in that pose, `kinds` the numbers of
    MuJoCo's words. `holds` are the points (3,) by which loops are closed, with their names
    and the two bodies that they hold to each other, `welds` the two bodies of each weld.
    `locked` are the joints that do not turn, `drives` the actuated ones with the ends of
    their range where the file has some, `values` the variables of holds where it says so;
    `made_up` says that the masses are; `notes` what is not here.

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
        kinds = (mujoco.mjtEq, mujoco.mjtTrn, mujoco.mjtJoint, mujoco.mjtObj)
        self.kinds = SimpleNamespace(
            **{
                name: int(number)
                for words in (*kinds, mujoco.mjtConstraint, mujoco.mjtWrap)
                for name, number in words.__members__.items()
            }
        )
        self.hinged: dict[str, Floats] = {}
        root = self._root()
        self.urdf = root if root.tag == "robot" else None
        try:
            spec = self._spec(root)
            spec.compiler.boundmass = spec.compiler.boundmass or MASSLESS
            spec.compiler.boundinertia = spec.compiler.boundinertia or MASSLESS
            m = self.m = spec.compile()
        except ValueError as error:
            said = " ".join(str(error).split())
            raise FileError(f"{path}: MuJoCo does not read it: {said}") from None
        m.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.d: Any = mujoco.MjData(m)
        self._need_hinges()
        numbers = {numeric.name: list(numeric.data) for numeric in spec.numerics}
        self.drives = self._drives(numbers)
        self._close({int(m.jnt_dofadr[k]) for k in self.drives})
        self.holds: list[tuple[str, tuple[int, int], Floats]] = []
        self.welds: list[tuple[int, int]] = []
        self.couplings: list[tuple[str, dict[int, float]]] = []
        self.locked: set[int] = set()
        for k in np.flatnonzero(m.eq_active0).tolist():
            self._take_equality(k)
        self.made_up = {text.name: text.data for text in spec.texts}.get("masses") == (
            "made up"
        )
        self.values = {
            name.removeprefix("value_"): float(data[0])
            for name, data in numbers.items()
            if name.startswith("value_")
        }
        self.name = path.stem if spec.modelname in NAMELESS else str(spec.modelname)
        what = "URDF" if self.urdf is not None else "MuJoCo model"
        self.source = f"{what} {path.name}"

    def _root(self) -> ElementTree.Element:
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

    def _spec(self, root: ElementTree.Element) -> Any:
        if self.urdf is None:
            return self.mj.MjSpec.from_file(str(self.path))
        # Looks and contacts name files that may be missing.
        for link in root.iter("link"):
            for looks in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(looks)
        text = ElementTree.tostring(root, encoding="unicode")
        spec = self.mj.MjSpec.from_string(text)
        spec.compiler.fusestatic = False
        try:
            for item in [*root.findall("loop_joint"), *root.findall("loop")]:
                self._add_loop(spec, item)
        except ValueError as error:
            raise FileError(f"{self.path}: a loop joint has no numbers: {error}") from None
        return spec

    def _add_loop(self, spec: Any, item: Element) -> None:
        """Take a loop joint of a URDF as constraints of sites.

        It has two links, with the place and the axes of the joint on each; its axis is the
        first one's.
        """
        kind, name = item.get("type", "spherical"), item.get("name", "loop")
        where = f"{self.path}: loop joint {name}"
        if kind not in (*TURNING, *POINT, *RIGID):
            allowed = ", ".join((*TURNING, *POINT, *RIGID))
            raise FileError(f'{where}: type "{kind}"; allowed: {allowed}')
        ends = [(tag, end) for tag in ENDS for end in item.findall(tag)]
        if len(ends) != 2:
            raise FileError(
                f"{where}: has {counted(len(ends), 'link')}, needs 2: link1 and link2, "
                "predecessor and successor, or parent and child with origins"
            )
        links, turns = [end.get("link", "") for _, end in ends], []
        for k, (tag, end) in enumerate(ends):
            within = end.find("origin")
            beside = item.find(f"{tag}_origin")
            origin = next((x for x in (within, beside) if x is not None), end)
            turns.append(Rotation.from_euler("xyz", _vector(origin, "rpy")).as_matrix())
            body = spec.body(links[k])
            if body is None:
                raise FileError(f'{where}: no link "{links[k]}"')
            body.add_site(name=f"{name}_{k}", pos=_vector(origin, "xyz"))
        if kind in TURNING:
            given = item.find("axis")
            axis = np.eye(3)[0] if given is None else _vector(given, "xyz")
            self.hinged[name] = turns[0] @ axis / np.linalg.norm(axis)
        eq, objects = self.mj.mjtEq, self.mj.mjtObj
        held = {"type": eq.mjEQ_CONNECT, "objtype": objects.mjOBJ_SITE}
        one, other = f"{name}_0", f"{name}_1"
        if kind in RIGID:
            held = {"type": eq.mjEQ_WELD, "objtype": objects.mjOBJ_BODY}
            one, other = links
        spec.add_equality(name=name, name1=one, name2=other, **held)

    def _need_hinges(self) -> None:
        m, kinds = self.m, self.kinds
        words = {kinds.mjJNT_FREE: "free", kinds.mjJNT_BALL: "ball"}
        words[kinds.mjJNT_SLIDE] = "slide"
        wrong = [
            f"{named(m.joint(k), 'joint', k)} ({words[int(m.jnt_type[k])]})"
            for k in range(m.njnt)
            if int(m.jnt_type[k]) in words
        ]
        if wrong:
            raise FileError(
                f"{self.path}: links of spherical mechanisms turn on hinges alone; other "
                f"joints: {listing(wrong)}. Fix the base, and give a ball joint as three "
                "hinges"
            )
        if not m.njnt:
            raise FileError(f"{self.path}: has no hinge, so that nothing moves")
        names = [m.joint(k).name for k in range(m.njnt)]
        if not all(names):
            raise FileError(
                f"{self.path}: joint {names.index('')} has no name; name all joints, since "
                "pairs are named after them"
            )

    def _close(self, held: set[int]) -> None:
        """Close all loops, by the passive joints if that can be."""
        d, every = self.d, list(range(self.m.nv))
        start = d.qpos.copy()
        if not (
            self._converged([k for k in every if k not in held]) or (self._converged(every))
        ):
            d.qpos[:] = start
            rows, gap = self._gaps()
            gaps: dict[str, float] = {}
            for number, size in zip(d.efc_id[rows], np.abs(gap), strict=True):
                name = named(self.m.eq(int(number)), "equality", int(number))
                gaps[name] = max(gaps.get(name, 0.0), float(size))
            told = listing(f"{name} by {gap:.3g}" for name, gap in gaps.items())
            raise FileError(
                f"{self.path}: loops do not close near the pose of the file: {told} (m or "
                "rad); give a pose in which they do, by ref of the joints"
            )
        moved = float(max_abs(d.qpos - start))
        if moved > 1e-9:
            self.notes.append(
                f"loops are open in the file's pose; joints were turned by up to "
                f"{np.degrees(moved):.4g} deg to close them"
            )

    def _gaps(self) -> tuple[Any, Floats]:
        """Return which constraints are those of loops, and by how much they are open."""
        self.mj.mj_forward(self.m, self.d)
        rows = self.d.efc_type == self.kinds.mjCNSTR_EQUALITY
        return rows, self.d.efc_pos[rows].copy()

    def _converged(self, free: list[int]) -> bool:
        """Step by Newton's method until rounding is all that is left; say if it is."""
        d, before = self.d, np.inf
        for _ in range(MOST_STEPS):
            rows, gap = self._gaps()
            size = float(max_abs(gap))
            if size < ROUNDING or (size < CLOSED and size > 0.5 * before):
                return True
            before = size
            jacobian = d.efc_J.reshape(d.nefc, self.m.nv)[rows][:, free]
            step = -np.linalg.lstsq(jacobian, gap, rcond=1e-9)[0]
            largest = float(max_abs(step))
            d.qpos[free] += step * min(1.0, 0.5 / largest if largest else 1.0)
        return False

    def _drives(
        self, numbers: Mapping[str, list[float]]
    ) -> dict[int, tuple[float, float] | None]:
        m = self.m
        joints = {m.joint(k).name: k for k in range(m.njnt)}
        drives: dict[int, tuple[float, float] | None] = {}
        for tag in ("transmission", "ros2_control"):
            path = f".//{tag}/joint"
            for joint in self.urdf.iterfind(path) if self.urdf is not None else ():
                commanded = joint.find("command_interface") is not None
                name = joint.get("name", "")
                if name in joints and (commanded or tag == "transmission"):
                    drives[joints[name]] = None
        for k in range(m.nu):
            at_joint = m.actuator_trntype[k] == self.kinds.mjTRN_JOINT
            if at_joint and np.any(m.actuator_gainprm[k]):
                servo = m.actuator_ctrllimited[k] and m.actuator_biasprm[k][1] != 0.0
                low, high = map(float, m.actuator_ctrlrange[k])
                drives[int(m.actuator_trnid[k][0])] = (low, high) if servo else None
        for k in drives:
            ends = numbers.get(f"input_{m.joint(k).name}", [])
            if len(ends) == 2:
                drives[k] = (float(ends[0]), float(ends[1]))
        return drives

    def _take_equality(self, k: int) -> None:
        """Take what an equality holds, locks or couples; note one that is left out."""
        m, kinds, kind = self.m, self.kinds, int(self.m.eq_type[k])
        one, other = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
        name = named(m.eq(k), "equality", k)
        if kind == kinds.mjEQ_JOINT and other < 0:
            self.locked.add(one)
        elif kind in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON):
            self.couplings.append((name, self._factors(k, name)))
        elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            self._take_hold(k, one, other)
        else:
            self.notes.append(f"{name} left out")

    def _take_hold(self, k: int, one: int, other: int) -> None:
        """Take the points by which a connection holds bodies or sites, or their weld."""
        m, d, name = self.m, self.d, named(self.m.eq(k), "loop", k)
        if m.eq_objtype[k] == self.kinds.mjOBJ_SITE:
            points = [d.site_xpos[one].copy()]
            one, other = int(m.site_bodyid[one]), int(m.site_bodyid[other])
        else:
            points = [d.xpos[one] + d.xmat[one].reshape(3, 3) @ m.eq_data[k][:3]]
        if m.eq_type[k] == self.kinds.mjEQ_WELD:
            self.welds.append((one, other))
            return
        if name in self.hinged:
            points.append(points[0] + d.xmat[one].reshape(3, 3) @ self.hinged[name])
        self.holds += [(name, (one, other), point) for point in points]

    def _factors(self, k: int, name: str) -> dict[int, float]:
        """Return the factors of the rates of joints, by joint, that an equality couples."""
        m = self.m
        if np.any(m.eq_data[k][2:5]):
            raise FileError(
                f"{self.path}: {name} couples joints at a ratio that changes; a "
                "mechanism file has profiles in contact for that. Take it out of a copy"
            )
        factors: dict[int, float] = {}
        ends = (m.eq_obj1id[k], 1.0), (m.eq_obj2id[k], -float(m.eq_data[k][1]))
        for item, ratio in ends:
            parts = [(int(item), 1.0)]
            if m.eq_type[k] == self.kinds.mjEQ_TENDON and item >= 0:
                parts = self._tendon(name, int(item))
            for joint, factor in parts if item >= 0 else ():
                factors[joint] = factors.get(joint, 0.0) + ratio * factor
        return factors

    def _tendon(self, name: str, number: int) -> list[tuple[int, float]]:
        """Return the joints of a fixed tendon with their factors."""
        m = self.m
        first = int(m.tendon_adr[number])
        places = range(first, first + int(m.tendon_num[number]))
        if any(int(m.wrap_type[k]) != self.kinds.mjWRAP_JOINT for k in places):
            raise FileError(
                f"{self.path}: {name} holds a tendon that runs through space; a mechanism "
                "file has none. Take it out of a copy"
            )
        return [(int(m.wrap_objid[k]), float(m.wrap_prm[k])) for k in places]

    @cached_property
    def gravity(self) -> Floats | None:
        """The acceleration (3,); a URDF has none."""
        if self.urdf is not None:
            self.notes.append("gravity left out: a URDF does not say where it acts")
            return None
        gravity: Floats = self.m.opt.gravity.copy()
        off = self.m.opt.disableflags & int(self.mj.mjtDisableBit.mjDSBL_GRAVITY)
        return None if off or not np.any(gravity) else gravity


def named(item: Any, what: str, number: int) -> str:
    """Return the name of something in a model, or what it is and its number."""
    return str(item.name or f"{what}{number}")
