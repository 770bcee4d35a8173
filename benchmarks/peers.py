"""Work and precision of forward dynamics beside general engines, from the same file."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.harness import Cell, Section
from spherekit.dynamics.compiled_engine import by_taylor_series
from spherekit.dynamics.coordinates import motion_by_variables
from spherekit.dynamics.numpy_engine import Collocation
from spherekit.dynamics.reduced_model_maker import reduced_model
from spherekit.dynamics.reduced_model_simulation import simulate_reduced
from spherekit.dynamics.simulation_start import Problem, prepare
from spherekit.errors import ModelError
from spherekit.exchange.mjcf import MujocoModel
from spherekit.exchange.rigid_bodies import RigidBodies, construct_rigid_bodies
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.mechanism.inertia import Mass, uniform_arc
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.symbolic.compiler import available

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Run = Callable[[], tuple[Floats, float]]
"""A run: the inputs (times, inputs) at `TIMES`, and the processor time (s) it took."""

TIMES = np.linspace(0.0, 10.0, 101)
CORRECTION = 10.0
"""Rate (1/s) at which Pinocchio's loops are corrected, critically damped."""
PROXIMAL = 1e-12, 1e-4, 20
"""Its accuracy, regularisation and steps: 1e-8 for the second, with a row that repeats
others, costs six digits."""


@dataclass(frozen=True)
class Push:
    """A torque at a pair, -a sin(theta) - k (theta - rest) - c dtheta + A sin(w t)."""

    pair: str
    sine: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    amplitude: float = 0.0
    frequency: float = 0.0

    @property
    def load(self) -> PairTorque:
        """The same as a load of a mechanism."""
        angle, rate = f"theta_{self.pair}", f"dtheta_{self.pair}"
        text = (
            f"-{self.sine}*sin({angle}) - {self.stiffness}*({angle} - {self.rest}) "
            f"- {self.damping}*{rate} + {self.amplitude}*sin({self.frequency}*t)"
        )
        return PairTorque(f"on_{self.pair}", self.pair, text)

    def at(self, t: float, angle: float, rate: float) -> float:
        """Return the torque (N m)."""
        return float(
            -self.sine * np.sin(angle)
            - self.stiffness * (angle - self.rest)
            - self.damping * rate
            + self.amplitude * np.sin(self.frequency * t)
        )


@dataclass(frozen=True)
class Case:
    """A mechanism with its start in assembly mode 0 and all its loads.

    `values`, `rates` (variables,) are those at the start, for engines that solve for none.
    """

    made: Mechanism
    start: Start
    pushes: tuple[Push, ...]
    values: Floats
    rates: Floats

    @property
    def inputs(self) -> list[str]:
        """The input pairs."""
        return [item.pair for item in self.made.inputs]

    @property
    def problem(self) -> Problem:
        """The direct problem over 10 s."""
        return prepare(self.made, self.start, float(TIMES[-1]))


def run(quick: bool) -> list[Section]:
    """Return one section for each mechanism."""
    sections = [
        _section(_single(load("four_bar"), "21", "41"), "one loop", quick),
        _section(_single(_heavy("stephenson"), "12", "16"), "two loops", quick),
        _section(_several(), "two freedoms", quick),
    ]
    return sections


def _single(made: Mechanism, crank: str, rocker: str) -> Case:
    pushes = (
        Push(crank, sine=1.0, damping=2.0, amplitude=10.0, frequency=2.0),
        Push(rocker, sine=5.0, damping=2.0),
    )
    return _case(made.with_inputs(crank), Start(0.3, 1.0), pushes)


def _several() -> Case:
    """Return the wrist with springs that hold it off where its modes cross."""
    drive = {"stiffness": 25.0, "damping": 2.0}
    pushes = (
        Push("21", rest=0.4, amplitude=4.0, frequency=2.0, **drive),
        Push("61", rest=0.9, amplitude=3.0, frequency=3.0, **drive),
    )
    return _case(_heavy("two_dof_spm"), Start((0.4, 0.9), (0.5, -0.3)), pushes)


def _case(made: Mechanism, start: Start, pushes: tuple[Push, ...]) -> Case:
    inputs = [item.pair for item in made.inputs]
    q, dq = start.each(inputs)
    tracer = PositionAnalysis(made, path=q[None], assembly_mode=0)
    values = tracer.motion().values[0].copy()
    places = [made.angles[pair] for pair in inputs]
    values[places] = q
    motion = motion_by_variables(tracer.solver.closure, values[None], places)
    rates = dq @ motion.rates[0]
    made = replace(made, loads=tuple(push.load for push in pushes))
    return Case(made, start, pushes, values, rates)


def _heavy(name: str) -> Mechanism:
    """Return a mechanism with 1 kg on every unit arc between the axes of a link."""
    made = replace(load(name), loads=())
    axes, masses = link_axes(made), []
    for link, own in axes.items():
        if link == made.ground:
            continue
        lines, arcs = list(own.values()), []
        for other in lines[1:]:
            try:
                arcs.append(uniform_arc(lines[0], other, 1.0, 1.0))
            except ModelError:
                continue  # two axes on one line have no arc of their own
        tensor = np.sum([arc[0] for arc in arcs], axis=0)
        centre = np.mean([arc[1] for arc in arcs], axis=0)
        rows = tuple(tuple(map(float, row)) for row in tensor)
        masses.append(Mass(link, rows, float(len(arcs)), tuple(map(float, centre))))  # type: ignore[arg-type]
    return replace(made, masses=tuple(masses))


def _section(case: Case, kind: str, quick: bool) -> Section:
    exact, checked = _reference(case)
    single = len(case.inputs) == 1
    jobs: list[tuple[str, str, Run]] = []
    absent = []
    if available():
        for tolerance in (1e-9, 1e-13) if quick else (1e-6, 1e-8, 1e-10, 1e-12, 1e-15):
            # That of several freedoms takes more than a minute where it is not compact.
            full = single or tolerance == 1e-6
            for compact in (True, False) if full else (True,):
                mode = "compact" if compact else "full"
                jobs.append(
                    (
                        f"spherekit compiled, {mode}",
                        f"tolerance {tolerance:g}",
                        _compiled(case, tolerance, compact),
                    )
                )
    else:
        absent.append("heyoka")
    for tolerance in (1e-7,) if quick else (1e-6, 1e-9, 1e-12):
        jobs.append(
            ("spherekit NumPy", f"tolerance {tolerance:g}", _numpy(case, tolerance))
        )
    for tolerance in ((1e-9,) if quick else (1e-7, 1e-9, 1e-11)) if single else ():
        jobs.append(
            (
                "spherekit stored model",
                f"tolerance {tolerance:g}",
                _stored(case, tolerance),
            )
        )
    if find_spec("pinocchio"):
        for tolerance in (1e-8,) if quick else (1e-6, 1e-8, 1e-9, 1e-10, 1e-12):
            jobs.append(
                ("Pinocchio, DOP853", f"rtol {tolerance:g}", _pinocchio(case, tolerance))
            )
    else:
        absent.append("Pinocchio (pin)")
    if find_spec("mujoco"):
        for step in (1e-3,) if quick else (2e-3, 1e-3, 5e-4, 2.5e-4):
            jobs.append(("MuJoCo, RK4", f"step {step:g} s", _mujoco(case, step)))
    else:
        absent.append("MuJoCo (mujoco)")
    done = [[job() for *_, job in jobs] for _ in range(1 if quick else 5)]
    rows: list[tuple[Cell, ...]] = []
    for (name, setting, _), results in zip(jobs, zip(*done, strict=True), strict=True):
        error = float(np.max(np.abs(results[0][0] - exact)))
        times = [1e3 * seconds for _, seconds in results]
        rows.append((name, setting, error, float(np.median(times)), min(times)))
    missing = f" Not installed, so skipped: {', '.join(absent)}." if absent else ""
    loads = "; ".join(f"{push.load.torque} at {push.pair}" for push in case.pushes)
    return Section(
        f"Peers: forward dynamics, {kind}",
        f"{case.made.name}, q(0) = {case.start.q}, q'(0) = {case.start.dq}, {loads}; 10 s; "
        f"errors of all inputs at {len(TIMES)} times against the tightest run of the first "
        f"engine, which differs by {checked:.2g} rad from {_CHECKED[single]}." + missing,
        ("engine", "setting", "error of q, rad", "ms, median", "ms, fastest"),
        rows,
        "Processor time without compiling and without making the stored model. Pinocchio "
        "and MuJoCo are called from Python, once and four times a step, for the loads. "
        "OpenSim has no wheel and was not run. Settings: docs/dynamics.md.",
    )


_CHECKED = {
    True: "SciPy's DOP853 on Eksergian's equation in q",
    False: "NumPy's collocation at 1e-13",
}


def _reference(case: Case) -> tuple[Floats, float]:
    """Return the inputs at `TIMES`, and the largest difference from another integration."""
    plain = _plain(case) if len(case.inputs) == 1 else _numpy(case, 1e-13)()[0]
    if not available():
        return plain, 0.0
    made = by_taylor_series(case.problem, 1e-16, "it is the reference")
    exact = made.at(TIMES).inputs
    return exact, float(np.max(np.abs(plain - exact)))


def _plain(case: Case) -> Floats:
    """Return the only input by SciPy's DOP853 on Eksergian's equation in q."""
    from scipy.integrate import solve_ivp

    model = reduced_model(case.made, poles=())

    def right(t: float, state: Floats) -> tuple[float, float]:
        q, dq = float(state[0]), float(state[1])
        return dq, -model.torque(q, dq, 0.0, t) / model.inertia(q)

    (q,), (dq,) = case.start.each(case.inputs)
    found = solve_ivp(right, (0.0, 10.0), (q, dq), "DOP853", TIMES, rtol=1e-13, atol=1e-14)
    return np.asarray(found.y[:1].T)


def _compiled(case: Case, tolerance: float, compact: bool) -> Run:
    problem = replace(case.problem, compact=compact)
    by_taylor_series(problem, tolerance, "it is compiled now")

    def job() -> tuple[Floats, float]:
        started = time.process_time()
        found = by_taylor_series(problem, tolerance, "it was asked for")
        seconds = time.process_time() - started
        return found.at(TIMES).inputs, seconds

    return job


def _numpy(case: Case, tolerance: float) -> Run:
    problem = case.problem

    def job() -> tuple[Floats, float]:
        started = time.process_time()
        solver = Collocation(problem, tolerance)
        while solver.advance():
            pass
        seconds = time.process_time() - started
        return solver.simulation("it was asked for").at(TIMES).inputs, seconds

    return job


def _stored(case: Case, tolerance: float) -> Run:
    model = reduced_model(case.made, poles=())
    (q,), (dq,) = case.start.each(case.inputs)
    # The first state asked for makes the table of single states.
    model.torque(q, dq, 0.0, 0.0)

    def job() -> tuple[Floats, float]:
        started = time.process_time()
        found = simulate_reduced(model, TIMES, q, dq, tolerance)
        return found.q[:, None], time.process_time() - started

    return job


def _mujoco(case: Case, step: float) -> Run:
    import mujoco

    written = MujocoModel(replace(case.made, loads=()), case.values, step).text
    model: Any = mujoco.MjModel.from_xml_string(written)
    pairs = [model.joint(k).name for k in range(model.njnt)]
    dofs = [int(model.joint(pair).dofadr[0]) for pair in pairs]
    driven = [dofs[pairs.index(pair)] for pair in case.inputs]
    loads = [(dofs[pairs.index(push.pair)], push) for push in case.pushes]
    rates = [case.rates[case.made.angles[pair]] for pair in pairs]
    every = round(float(TIMES[1]) / step)

    def drive(_: Any, data: Any) -> None:
        for k, push in loads:
            angle, rate = data.qpos[k], data.qvel[k]
            data.qfrc_applied[k] = push.at(data.time, angle, rate)

    def job() -> tuple[Floats, float]:
        data = mujoco.MjData(model)
        data.qvel[dofs] = rates
        mujoco.set_mjcb_control(drive)
        try:
            found = [data.qpos[driven].copy()]
            started = time.process_time()
            for _ in TIMES[1:]:
                mujoco.mj_step(model, data, every)
                found.append(data.qpos[driven].copy())
            return np.array(found), time.process_time() - started
        finally:
            mujoco.set_mjcb_control(None)

    return job


def _pinocchio(case: Case, tolerance: float) -> Run:
    from scipy.integrate import solve_ivp

    made = construct_rigid_bodies(replace(case.made, loads=()), case.values)
    pin, model, cuts = _pinocchio_model(made)
    pairs = [hinge.pair for hinge in made.hinges]
    data = model.createData()
    held = pin.StdVec_RigidConstraintData()
    for cut in cuts:
        held.append(cut.createData())
    pin.initConstraintDynamics(model, data, cuts, held)
    settings = pin.ProximalSettings(*PROXIMAL)
    order = [model.joints[model.getJointId(pair)].idx_v for pair in pairs]
    driven = [order[pairs.index(pair)] for pair in case.inputs]
    loads = [(order[pairs.index(push.pair)], push) for push in case.pushes]
    count = model.nv
    shift, rates = np.zeros(count), np.zeros(count)
    for k, hinge in zip(order, made.hinges, strict=True):
        shift[k] = hinge.value
        rates[k] = case.rates[case.made.angles[hinge.pair]]

    def right(t: float, state: Floats) -> Floats:
        q, v = state[:count], state[count:]
        torque = np.zeros(count)
        for k, push in loads:
            torque[k] = push.at(t, q[k] + shift[k], v[k])
        found = pin.constraintDynamics(model, data, q, v, torque, cuts, held, settings)
        return np.concatenate([v, found])

    def job() -> tuple[Floats, float]:
        started = time.process_time()
        start = np.concatenate([np.zeros(count), rates])
        found = solve_ivp(
            right, (0.0, 10.0), start, "DOP853", TIMES, rtol=tolerance, atol=tolerance
        )
        seconds = time.process_time() - started
        return np.asarray((found.y[driven].T) + shift[driven]), seconds

    return job


def _pinocchio_model(made: RigidBodies) -> tuple[Any, Any, Any]:
    import pinocchio as pin

    model, here = pin.Model(), pin.SE3.Identity()
    model.gravity.linear = np.zeros(3)
    number = {made.mechanism.ground: 0}
    for hinge, body in zip(made.hinges, made.bodies, strict=True):
        joint = pin.JointModelRevoluteUnaligned(*map(float, hinge.axis))
        number[hinge.child] = model.addJoint(number[hinge.parent], joint, here, hinge.pair)
        inertia = pin.Inertia(body.mass, body.centre, body.tensor)
        model.appendBodyToJoint(number[hinge.child], inertia, here)
    cuts = pin.StdVec_RigidConstraintModel()
    for cut in made.loop_hinges:
        there = pin.SE3(np.eye(3), cut.axis)
        ends = (number[cut.parent], there, number[cut.child], there)
        held = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.LOCAL)
        held.setBaumgarteCorrectorParameters(
            pin.BaumgarteCorrectorParameters(CORRECTION**2, 2.0 * CORRECTION)
        )
        cuts.append(held)
    return pin, model, cuts
