"""MuJoCo's reading of MJCF and URDF files; the only module that imports mujoco."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, final
from xml.etree import ElementTree

import numpy as np

from spherekit.conventions import listing
from spherekit.errors import FileError
from spherekit.exchange.foreign import (
    ForeignBody,
    ForeignCoupling,
    ForeignHinge,
    ForeignHold,
    ForeignLoad,
    ForeignModel,
)
from spherekit.exchange.urdf_loops import RIGID, TURNING, driven, loops, tree_only
from spherekit.sphere.rotation import Floats

MASSLESS = 1e-14
"""kg: what bodies without a mass are given, since MuJoCo reads none without."""

ROUNDING, CLOSED = 1e-16, 1e-12
"""Loops open by less (m, rad) are closed: at once, and where no step brings more."""
MOST_STEPS = 60

NAMELESS = ("", "MuJoCo Model")
"""What MuJoCo calls models without a name."""


def read_foreign(path: Path) -> ForeignModel:
    """Return what an MJCF or URDF file holds, with its loops closed.

    Raises
    ------
    FileError
        If MuJoCo is not installed or cannot read it, it has joints that are no hinges,
        couplings of joints, or loops that do not close near its pose.
    """
    try:
        import mujoco
    except ImportError:
        raise FileError(
            f"{path}: MJCF and URDF are read by MuJoCo, which is not installed; install "
            'it with: pip install "spherekit-mechanisms[import]"'
        ) from None
    return _Reader(mujoco, path).model()


@final
class _Reader:
    def __init__(self, mujoco: Any, path: Path) -> None:
        self.mj, self.path = mujoco, path
        self.kinds = _numbers(mujoco.mjtEq) | _numbers(mujoco.mjtTrn)
        self.kinds |= _numbers(mujoco.mjtJoint) | _numbers(mujoco.mjtObj)
        self.kinds |= _numbers(mujoco.mjtConstraint) | _numbers(mujoco.mjtWrap)
        self.notes: list[str] = []
        self.hinged: dict[str, Floats] = {}
        self.urdf: ElementTree.Element | None = None
        spec = self.parsed()
        spec.compiler.boundmass = spec.compiler.boundmass or MASSLESS
        spec.compiler.boundinertia = spec.compiler.boundinertia or MASSLESS
        try:
            self.m: Any = spec.compile()
        except ValueError as error:
            raise self.refused(error) from None
        self.spec = spec
        self.m.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.d: Any = mujoco.MjData(self.m)

    def refused(self, error: object) -> FileError:
        said = " ".join(str(error).split())
        return FileError(f"{self.path}: MuJoCo does not read it: {said}")

    def parsed(self) -> Any:
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
        try:
            if root.tag == "mujoco":
                return self.mj.MjSpec.from_file(str(self.path))
            self.urdf = root
            spec = self.mj.MjSpec.from_string(tree_only(root))
        except ValueError as error:
            raise self.refused(error) from None
        spec.compiler.fusestatic = False
        try:
            for loop in loops(str(self.path), root):
                self.add_loop(spec, loop)
        except ValueError as error:
            raise FileError(f"{self.path}: a loop joint has no numbers: {error}") from None
        return spec

    def add_loop(self, spec: Any, loop: Any) -> None:
        """Take a loop joint of a URDF as constraints of sites."""
        bodies = [spec.body(link) for link in loop.links]
        for link, body in zip(loop.links, bodies, strict=True):
            if body is None:
                raise FileError(f'{self.path}: loop joint {loop.name}: no link "{link}"')
        kinds = self.mj.mjtEq
        if loop.kind in RIGID:
            spec.add_equality(
                name=loop.name,
                type=kinds.mjEQ_WELD,
                objtype=self.mj.mjtObj.mjOBJ_BODY,
                name1=loop.links[0],
                name2=loop.links[1],
            )
            return
        sites = []
        for k, (body, place) in enumerate(zip(bodies, loop.places, strict=True)):
            sites.append(f"{loop.name}_{k}")
            body.add_site(name=sites[-1], pos=place)
        if loop.kind in TURNING:
            self.hinged[loop.name] = loop.axis
        spec.add_equality(
            name=loop.name,
            type=kinds.mjEQ_CONNECT,
            objtype=self.mj.mjtObj.mjOBJ_SITE,
            name1=sites[0],
            name2=sites[1],
        )

    def model(self) -> ForeignModel:
        m = self.m
        self.need_hinges()
        drives = self.drives()
        self.close({int(m.joint(name).dofadr[0]) for name in drives})
        texts = {text.name: text.data for text in self.spec.texts}
        numbers = {numeric.name: list(numeric.data) for numeric in self.spec.numerics}
        self.made_up = texts.get("masses") == "made up"
        ranges: dict[str, tuple[float, float]] = {}
        for name in drives:
            ends = numbers.get(f"input_{name}", [])
            if len(ends) == 2:
                ranges[name] = (float(ends[0]), float(ends[1]))
        what = "URDF" if self.urdf is not None else "MuJoCo model"
        return ForeignModel(
            name=self.path.stem if self.spec.modelname in NAMELESS else self.spec.modelname,
            source=f"{what} {self.path.name}",
            bodies=[self.body(k) for k in range(m.nbody)],
            hinges=[self.hinge(k) for k in range(m.njnt)],
            holds=list(self.holds()),
            driven={name: ranges.get(name, ends) for name, ends in drives.items()},
            couplings=list(self.couplings()),
            loads=list(self.loads()),
            gravity=self.gravity(),
            values={
                name.removeprefix("value_"): float(data[0])
                for name, data in numbers.items()
                if name.startswith("value_")
            },
            made_up=self.made_up,
            notes=(*self.notes, *self.closing),
        )

    def need_hinges(self) -> None:
        m, kinds = self.m, self.kinds
        words = {
            kinds["mjJNT_FREE"]: "free",
            kinds["mjJNT_BALL"]: "ball",
            kinds["mjJNT_SLIDE"]: "slide",
        }
        wrong = [
            f"{_named(m.joint(k), 'joint', k)} ({words[int(m.jnt_type[k])]})"
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

    def equalities(self) -> Iterator[int]:
        return (k for k in range(self.m.neq) if self.m.eq_active0[k])

    def close(self, held: set[int]) -> None:
        """Close all loops, by the passive joints if that can be."""
        self.closing: list[str] = []
        start = self.d.qpos.copy()
        free = [k for k in range(self.m.nv) if k not in held]
        if not (self.converged(free) or self.converged(list(range(self.m.nv)))):
            self.d.qpos[:] = start
            gaps = listing(f"{name} by {gap:.3g}" for name, gap in self.gaps().items())
            raise FileError(
                f"{self.path}: loops do not close near the pose of the file: {gaps} (m or "
                "rad); give a pose in which they do, by ref of the joints"
            )
        moved = float(np.max(np.abs(self.d.qpos - start), initial=0.0))
        if moved > 1e-9:
            self.closing.append(
                f"loops are open in the file's pose; joints were turned by up to "
                f"{np.degrees(moved):.4g} deg to close them"
            )

    def converged(self, free: list[int]) -> bool:
        """Step by Newton's method until rounding is all that is left; say if it is."""
        m, d = self.m, self.d
        before = np.inf
        for _ in range(MOST_STEPS):
            self.mj.mj_forward(m, d)
            rows = d.efc_type == self.kinds["mjCNSTR_EQUALITY"]
            gap = d.efc_pos[rows].copy()
            size = float(np.max(np.abs(gap), initial=0.0))
            if size < ROUNDING or (size < CLOSED and size > 0.5 * before):
                return True
            before = size
            jacobian = d.efc_J.reshape(d.nefc, m.nv)[rows][:, free]
            step = -np.linalg.lstsq(jacobian, gap, rcond=1e-9)[0]
            largest = float(np.max(np.abs(step), initial=0.0))
            d.qpos[free] += step * min(1.0, 0.5 / largest if largest else 1.0)
        return False

    def gaps(self) -> dict[str, float]:
        m, d = self.m, self.d
        self.mj.mj_forward(m, d)
        rows = d.efc_type == self.kinds["mjCNSTR_EQUALITY"]
        gaps: dict[str, float] = {}
        for number, gap in zip(d.efc_id[rows], np.abs(d.efc_pos[rows]), strict=True):
            name = _named(m.eq(int(number)), "equality", int(number))
            gaps[name] = max(gaps.get(name, 0.0), float(gap))
        return gaps

    def drives(self) -> dict[str, tuple[float, float] | None]:
        """Return the actuated hinges with the range of their angle where there is one."""
        m = self.m
        drives: dict[str, tuple[float, float] | None] = {}
        joints = {m.joint(k).name for k in range(m.njnt)}
        for name in driven(self.urdf) if self.urdf is not None else ():
            if name in joints:
                drives[name] = None
        for k in range(m.nu):
            at_joint = m.actuator_trntype[k] == self.kinds["mjTRN_JOINT"]
            if at_joint and np.any(m.actuator_gainprm[k]):
                servo = m.actuator_ctrllimited[k] and m.actuator_biasprm[k][1] != 0.0
                low, high = m.actuator_ctrlrange[k]
                name = m.joint(int(m.actuator_trnid[k][0])).name
                drives[name] = (float(low), float(high)) if servo else None
        return drives

    def body(self, number: int) -> ForeignBody:
        m, d = self.m, self.d
        mass = float(m.body_mass[number])
        turn = d.ximat[number].reshape(3, 3)
        return ForeignBody(
            name=m.body(number).name or f"body{number}",
            parent=int(m.body_parentid[number]),
            mass=mass if mass > MASSLESS else None,
            centre=d.xipos[number].copy(),
            tensor=turn @ np.diag(m.body_inertia[number]) @ turn.T,
            weightless=bool(m.body_gravcomp[number] == 1.0),
        )

    def hinge(self, number: int) -> ForeignHinge:
        m, d = self.m, self.d
        place, dof = int(m.jnt_qposadr[number]), int(m.jnt_dofadr[number])
        low, high = map(float, m.jnt_range[number])
        name = m.joint(number).name
        if m.dof_armature[dof]:
            self.notes.append(
                f"armature of joint {name} left out, {m.dof_armature[dof]:g} kg m2"
            )
        if np.any(m.jnt_stiffnesspoly[number]) or np.any(m.dof_dampingpoly[dof]):
            self.notes.append(f"joint {name}: spring or damper left out where not linear")
        locks = [
            k
            for k in self.equalities()
            if m.eq_type[k] == self.kinds["mjEQ_JOINT"]
            and m.eq_obj1id[k] == number
            and m.eq_obj2id[k] < 0
        ]
        return ForeignHinge(
            name=name,
            body=int(m.jnt_bodyid[number]),
            point=d.xanchor[number].copy(),
            axis=d.xaxis[number].copy(),
            value=float(d.qpos[place]),
            limits=(low, high) if m.jnt_limited[number] else None,
            stiffness=float(m.jnt_stiffness[number]),
            rest=float(m.qpos_spring[place]),
            damping=float(m.dof_damping[dof]),
            dry=float(m.dof_frictionloss[dof]),
            locked=bool(locks),
        )

    def holds(self) -> Iterator[ForeignHold]:
        m, d = self.m, self.d
        kinds, site = self.kinds, self.kinds["mjOBJ_SITE"]
        for k in self.equalities():
            if m.eq_type[k] not in (kinds["mjEQ_CONNECT"], kinds["mjEQ_WELD"]):
                if m.eq_type[k] not in (kinds["mjEQ_JOINT"], kinds["mjEQ_TENDON"]):
                    self.notes.append(f"{_named(m.eq(k), 'equality', k)} left out")
                continue
            ends = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
            name = _named(m.eq(k), "loop", k)
            if m.eq_objtype[k] == site:
                point = d.site_xpos[ends[0]].copy()
                ends = int(m.site_bodyid[ends[0]]), int(m.site_bodyid[ends[1]])
            else:
                turn = d.xmat[ends[0]].reshape(3, 3)
                point = d.xpos[ends[0]] + turn @ m.eq_data[k][:3]
            if m.eq_type[k] == kinds["mjEQ_WELD"]:
                yield ForeignHold(name, *ends)
                continue
            yield ForeignHold(name, *ends, point)
            if name in self.hinged:
                axis = d.xmat[ends[0]].reshape(3, 3) @ self.hinged[name]
                yield ForeignHold(name, *ends, point + axis)

    def couplings(self) -> Iterator[ForeignCoupling]:
        """Yield the hinges that joint and tendon equalities couple at a constant ratio."""
        m = self.m
        for k in self.equalities():
            kind, name = int(m.eq_type[k]), _named(m.eq(k), "equality", k)
            first, second = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
            if kind not in (self.kinds["mjEQ_JOINT"], self.kinds["mjEQ_TENDON"]):
                continue
            joints = kind == self.kinds["mjEQ_JOINT"]
            if joints and second < 0:
                continue
            if np.any(m.eq_data[k][2:5]):
                raise FileError(
                    f"{self.path}: {name} couples joints at a ratio that changes; a "
                    "mechanism file has profiles in contact for that. Take it out of a copy"
                )
            factors: dict[str, float] = {}
            for item, ratio in ((first, 1.0), (second, -float(m.eq_data[k][1]))):
                parts = [(item, 1.0)] if joints else self.tendon(name, item)
                for joint, factor in parts if item >= 0 else ():
                    hinge = m.joint(joint).name
                    factors[hinge] = factors.get(hinge, 0.0) + ratio * factor
            yield ForeignCoupling(name, factors)

    def tendon(self, name: str, number: int) -> list[tuple[int, float]]:
        """Return the joints of a fixed tendon with their factors."""
        m = self.m
        first = int(m.tendon_adr[number])
        places = range(first, first + int(m.tendon_num[number]))
        if any(int(m.wrap_type[k]) != self.kinds["mjWRAP_JOINT"] for k in places):
            raise FileError(
                f"{self.path}: {name} holds a tendon that runs through space; a mechanism "
                "file has none. Take it out of a copy"
            )
        return [(int(m.wrap_objid[k]), float(m.wrap_prm[k])) for k in places]

    def gravity(self) -> Floats | None:
        """Return the acceleration (3,); a URDF has none."""
        if self.urdf is not None:
            self.notes.append("gravity left out: a URDF does not say where it acts")
            return None
        off = self.m.opt.disableflags & int(self.mj.mjtDisableBit.mjDSBL_GRAVITY)
        return None if off or not np.any(self.m.opt.gravity) else self.m.opt.gravity.copy()

    def loads(self) -> Iterator[ForeignLoad]:
        """Yield actuators without control as loads; note others that drive no hinge."""
        m, kinds = self.m, self.kinds
        for k in range(m.nu):
            name, transmission = _named(m.actuator(k), "actuator", k), m.actuator_trntype[k]
            gear, bias = m.actuator_gear[k], m.actuator_biasprm[k][:3]
            first, second = (int(number) for number in m.actuator_trnid[k])
            if np.any(m.actuator_gainprm[k]):
                if transmission != kinds["mjTRN_JOINT"]:
                    self.notes.append(f"actuator {name} left out: it drives no hinge")
                elif np.any(bias) and not self.made_up:
                    self.notes.append(f"feedback of actuator {name} left out")
            elif transmission == kinds["mjTRN_JOINT"]:
                c, s, r = (float(x) for x in gear[0] * bias)
                vector = (c, s * float(gear[0]), r * float(gear[0]))
                yield ForeignLoad(name, "torque", vector, m.joint(first).name)
            elif transmission == kinds["mjTRN_SITE"] and not np.any(bias[1:]):
                yield from self.on_site(name, gear * bias[0], first, second)
            else:
                self.notes.append(f"actuator {name} left out: it is no constant load")

    def on_site(
        self, name: str, wrench: Floats, site: int, seen: int
    ) -> Iterator[ForeignLoad]:
        """Yield the force and the moment that an actuator at a site is."""
        m, d = self.m, self.d
        if seen >= 0 and m.body_weldid[m.site_bodyid[seen]] != 0:
            self.notes.append(f"actuator {name} left out: its axes move with another body")
            return
        turn = d.site_xmat[site if seen < 0 else seen].reshape(3, 3)
        body, point = int(m.site_bodyid[site]), d.site_xpos[site].copy()
        x, y, z = (float(component) for component in turn @ wrench[:3])
        if np.any(wrench[:3]):
            yield ForeignLoad(name, "force", (x, y, z), "", body, point, seen < 0)
        x, y, z = (float(component) for component in turn @ wrench[3:])
        if np.any(wrench[3:]):
            yield ForeignLoad(name, "moment", (x, y, z), "", body, None, seen < 0)


def _numbers(kinds: Any) -> dict[str, int]:
    """Return the members of an enumeration, which arrays hold as numbers, by name."""
    return {name: int(kind) for name, kind in kinds.__members__.items()}


def _named(item: Any, what: str, number: int) -> str:
    return str(item.name or f"{what}{number}")
