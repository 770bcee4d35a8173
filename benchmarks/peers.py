"""Work and precision of forward dynamics beside general engines, from the same file."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np

from benchmarks.report import Cell, Section
from spherekit.dynamics import forward
from spherekit.dynamics.compiled_engine import by_taylor_series
from spherekit.dynamics.kinematics import by_variables
from spherekit.dynamics.start import prepare
from spherekit.dynamics.tabulate import online_model
from spherekit.dynamics.tabulated_motion import online_motion
from spherekit.engine.compiler import available
from spherekit.exchange.bodies import RigidBodies, rigid_bodies
from spherekit.exchange.mjcf import mjcf
from spherekit.files.read import load
from spherekit.model.dynamics import Mass, PairTorque
from spherekit.model.geometry import link_axes
from spherekit.model.inertia import uniform_arc
from spherekit.model.laws import Start
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Tracer

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Run = Callable[[], tuple[Floats, float]]
"""A run: q at `TIMES`, and the seconds that the integration took."""

TIMES = np.linspace(0.0, 10.0, 101)
DRIVE = "10*sin(2*t)"
CORRECTION = 10.0
"""Rate (1/s) at which Pinocchio's loops are corrected, critically damped."""
PROXIMAL = 1e-12, 1e-4, 20
"""Its accuracy, regularisation and steps: 1e-8 for the second, with a row that repeats
others, costs six digits."""


@dataclass(frozen=True)
class Case:
    """A mechanism with its loads at the start: q(0) = 0.3, q'(0) = 1, assembly mode 0.

    `sines` and `damping` are its loads in another form, for engines that read none: pair,
    factor of -sin(theta) (N m) and of -dtheta (N m s).
    """

    made: Mechanism
    input: str
    sines: tuple[tuple[str, float, float], ...]
    values: Floats
    rates: Floats

    def torques(self, pairs: Sequence[str]) -> list[tuple[int, float, float]]:
        """Return the loads with numbers in a list of pairs."""
        return [(list(pairs).index(pair), a, c) for pair, a, c in self.sines]


def run(quick: bool) -> list[Section]:
    """Return one section for each mechanism."""
    return [
        _section(_case(load("four_bar"), "21", "41"), "one loop", quick),
        _section(_case(_heavy_stephenson(), "12", "16"), "two loops", quick),
    ]


def _case(made: Mechanism, crank: str, rocker: str) -> Case:
    tracer = Tracer(made, crank, 0)
    values = tracer.at(np.array([0.3])).values[0].copy()
    values[tracer.solver.single] = 0.3
    motion = by_variables(tracer.solver.closure, values[None], [tracer.solver.single])
    rates = motion.rates[0, 0]
    sines = ((crank, 1.0, 2.0), (rocker, 5.0, 2.0))
    return Case(made, crank, sines, values, rates)


def _heavy_stephenson() -> Mechanism:
    """Return the Stephenson with 1 kg on every unit arc between the axes of a link."""
    made = load("stephenson")
    axes, masses = link_axes(made), []
    for link, own in axes.items():
        if link == made.ground:
            continue
        lines = list(own.values())
        arcs = [uniform_arc(lines[0], other, 1.0, 1.0) for other in lines[1:]]
        tensor = np.sum([arc[0] for arc in arcs], axis=0)
        centre = np.mean([arc[1] for arc in arcs], axis=0)
        rows = tuple(tuple(map(float, row)) for row in tensor)
        masses.append(Mass(link, rows, float(len(arcs)), tuple(map(float, centre))))  # type: ignore[arg-type]
    loads = (
        PairTorque("on_crank", "12", "-sin(theta_12) - 2*dtheta_12"),
        PairTorque("on_rocker", "16", "-5*sin(theta_16) - 2*dtheta_16"),
    )
    return replace(made, masses=tuple(masses), loads=loads)


def _section(case: Case, kind: str, quick: bool) -> Section:
    exact, checked = _reference(case)
    jobs: list[tuple[str, str, Run]] = []
    absent = []
    if available():
        for tolerance in (1e-9, 1e-13) if quick else (1e-8, 1e-10, 1e-12, 1e-15):
            for compact in (True, False):
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
    for tolerance in (1e-9,) if quick else (1e-7, 1e-9, 1e-11):
        jobs.append(
            (
                "spherekit stored model",
                f"tolerance {tolerance:g}",
                _stored(case, tolerance),
            )
        )
    if find_spec("pinocchio"):
        for tolerance in (1e-8,) if quick else (1e-6, 1e-8, 1e-10, 1e-12):
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
    return Section(
        f"Peers: forward dynamics, {kind}",
        f"{case.made.name}, q(0) = 0.3, q'(0) = 1, sines and dampers on input and rocker, "
        f"a torque 10 sin 2t on the input, 10 s; errors of q at {len(TIMES)} times against "
        "the tightest run of the first engine, which differs by "
        f"{checked:.2g} rad from SciPy's DOP853 on Eksergian's equation in q." + missing,
        ("engine", "setting", "error of q, rad", "ms, median", "ms, fastest"),
        rows,
        "Without compiling, and without the stored model's making. Pinocchio and MuJoCo "
        "are called from Python, once and four times a step, for the loads. OpenSim has no "
        "wheel and was not run. Settings: docs/dynamics.md.",
    )


def _reference(case: Case) -> tuple[Floats, float]:
    """Return q at `TIMES`, and its largest difference from an independent integration."""
    from scipy.integrate import solve_ivp

    model = online_model(case.made, input_pair=case.input, poles=())

    def right(t: float, state: Floats) -> tuple[float, float]:
        q, dq = float(state[0]), float(state[1])
        drive = 10.0 * np.sin(2.0 * t)
        return dq, (drive - model.torque(q, dq, 0.0, t)) / model.inertia(q)

    plain = solve_ivp(
        right, (0.0, 10.0), (0.3, 1.0), "DOP853", TIMES, rtol=1e-13, atol=1e-14
    ).y[0]
    if available():
        problem = prepare(case.made, Start(0.3, 1.0), 10.0, DRIVE, case.input)
        exact = by_taylor_series(problem, 1e-16, True, "it is the reference").at(TIMES).q
    else:
        exact, _ = _numpy(case, 1e-13)()
    return exact, float(np.max(np.abs(plain - exact)))


def _compiled(case: Case, tolerance: float, compact: bool) -> Run:
    return _simulated(case, tolerance, "compiled", compact)


def _numpy(case: Case, tolerance: float) -> Run:
    return _simulated(case, tolerance, "numpy", True)


def _simulated(
    case: Case, tolerance: float, engine: Literal["numpy", "compiled"], compact: bool
) -> Run:
    def job() -> tuple[Floats, float]:
        found = forward.simulate(
            case.made,
            Start(0.3, 1.0),
            10.0,
            torque=DRIVE,
            input_pair=case.input,
            tolerance=tolerance,
            engine=engine,
            compact=compact,
        )
        return found.at(TIMES).q, found.engine.seconds

    return job


def _stored(case: Case, tolerance: float) -> Run:
    model = online_model(case.made, input_pair=case.input, poles=()).with_torque(DRIVE)
    # The first state asked for makes the table of single states.
    model.torque(0.3, 1.0, 0.0, 0.0)

    def job() -> tuple[Floats, float]:
        started = time.perf_counter()
        found = online_motion(model, TIMES, 0.3, 1.0, tolerance)
        return found.q, time.perf_counter() - started

    return job


def _mujoco(case: Case, step: float) -> Run:
    import mujoco

    written = mjcf(case.made, case.values, step).text
    model: Any = mujoco.MjModel.from_xml_string(written)
    pairs = [model.joint(k).name for k in range(model.njnt)]
    dofs = [int(model.joint(pair).dofadr[0]) for pair in pairs]
    driven = dofs[pairs.index(case.input)]
    loads = [(dofs[k], a, c) for k, a, c in case.torques(pairs)]
    rates = [case.rates[case.made.variable_names.index(f"theta_{pair}")] for pair in pairs]
    every = round(float(TIMES[1]) / step)

    def drive(_: Any, data: Any) -> None:
        q, v, force = data.qpos, data.qvel, data.qfrc_applied
        force[driven] = 10.0 * np.sin(2.0 * data.time)
        for k, a, c in loads:
            torque = -a * np.sin(q[k]) - c * v[k]
            force[k] = torque + (force[k] if k == driven else 0.0)

    def job() -> tuple[Floats, float]:
        data = mujoco.MjData(model)
        data.qvel[dofs] = rates
        mujoco.set_mjcb_control(drive)
        try:
            found = [float(data.qpos[driven])]
            started = time.perf_counter()
            for _ in TIMES[1:]:
                mujoco.mj_step(model, data, every)
                found.append(float(data.qpos[driven]))
            return np.array(found), time.perf_counter() - started
        finally:
            mujoco.set_mjcb_control(None)

    return job


def _pinocchio(case: Case, tolerance: float) -> Run:
    from scipy.integrate import solve_ivp

    made = rigid_bodies(case.made, case.values)
    pin, model, cuts = _pinocchio_model(made)
    pairs = [hinge.pair for hinge in made.hinges]
    data = model.createData()
    held = pin.StdVec_RigidConstraintData()
    for cut in cuts:
        held.append(cut.createData())
    pin.initConstraintDynamics(model, data, cuts, held)
    settings = pin.ProximalSettings(*PROXIMAL)
    order = [model.joints[model.getJointId(pair)].idx_v for pair in pairs]
    driven = order[pairs.index(case.input)]
    loads = [(order[k], a, c) for k, a, c in case.torques(pairs)]
    count = model.nv
    shift, rates = np.zeros(count), np.zeros(count)
    for k, hinge in zip(order, made.hinges, strict=True):
        shift[k] = hinge.value
        rates[k] = case.rates[case.made.variable_names.index(f"theta_{hinge.pair}")]

    def right(t: float, state: Floats) -> Floats:
        q, v = state[:count], state[count:]
        torque = np.zeros(count)
        torque[driven] = 10.0 * np.sin(2.0 * t)
        for k, a, c in loads:
            torque[k] += -a * np.sin(q[k] + shift[k]) - c * v[k]
        found = pin.constraintDynamics(model, data, q, v, torque, cuts, held, settings)
        return np.concatenate([v, found])

    def job() -> tuple[Floats, float]:
        started = time.perf_counter()
        start = np.concatenate([np.zeros(count), rates])
        found = solve_ivp(
            right, (0.0, 10.0), start, "DOP853", TIMES, rtol=tolerance, atol=tolerance
        )
        seconds = time.perf_counter() - started
        return np.asarray(found.y[driven] + shift[driven]), seconds

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
    for cut in made.cuts:
        there = pin.SE3(np.eye(3), cut.point)
        ends = (number[cut.first], there, number[cut.second], there)
        held = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.LOCAL)
        held.setBaumgarteCorrectorParameters(
            pin.BaumgarteCorrectorParameters(CORRECTION**2, 2.0 * CORRECTION)
        )
        cuts.append(held)
    return pin, model, cuts
