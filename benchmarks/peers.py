"""Time and accuracy of forward dynamics, compared with general engines.

All engines simulate the same mechanisms with the same loads from the same state.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.harness import Cell, Section
from spherekit.arrays import Floats
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

TIMES = np.linspace(0.0, 10.0, 101)
"""Times (s) at which the inputs are compared."""

LOOP_CORRECTION_RATE = 10.0
"""Rate (1/s) at which errors of Pinocchio's loops decay, critically damped."""

PROXIMAL_SETTINGS = 1e-12, 1e-4, 20
"""Accuracy, regularisation and number of steps of Pinocchio's constraint solver.

With a regularisation of 1e-8, a constraint that repeats others costs six digits.
"""

REFERENCE_TOLERANCE = 1e-16
"""Tolerance of the simulation by the compiled engine from which errors are counted."""

ARC_MASS_KG = 1.0
ARC_RADIUS_M = 1.0
"""Mass and radius of each arc of the links that are given masses."""


@dataclass(frozen=True)
class EngineRun:
    """The result of one simulation.

    Attributes
    ----------
    inputs
        (times, inputs) the inputs (rad) at `TIMES`.
    seconds
        Processor time (s), without compilation.
    """

    inputs: Floats
    seconds: float


Simulate = Callable[[], EngineRun]
"""Simulates a case once."""


@dataclass(frozen=True)
class EngineSetting:
    """An engine with one setting of its accuracy.

    Attributes
    ----------
    engine
        Name of the engine in the table.
    setting
        Its tolerance or step in words.
    simulate
        Simulates the case.
    """

    engine: str
    setting: str
    simulate: Simulate


@dataclass(frozen=True)
class PairLoad:
    """A torque at a pair, in N m.

    It is -a sin(theta) - k (theta - rest) - c dtheta + A sin(w t), where theta is the angle
    of the pair and t the time.

    Attributes
    ----------
    pair
        Name of the pair.
    sine
        a (N m).
    stiffness
        k (N m/rad).
    rest
        Angle (rad) at which the spring is relaxed.
    damping
        c (N m s/rad).
    amplitude
        A (N m).
    frequency
        w (rad/s).
    """

    pair: str
    sine: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    amplitude: float = 0.0
    frequency: float = 0.0

    def as_load(self) -> PairTorque:
        """Return the same torque as a load of a mechanism."""
        angle = f"theta_{self.pair}"
        rate = f"dtheta_{self.pair}"
        text = (
            f"-{self.sine}*sin({angle}) - {self.stiffness}*({angle} - {self.rest}) "
            f"- {self.damping}*{rate} + {self.amplitude}*sin({self.frequency}*t)"
        )
        return PairTorque(f"on_{self.pair}", self.pair, text)

    @property
    def text(self) -> str:
        """The torque as a sum of the terms that are not zero, such as ``-2 dtheta_21``."""
        angle = f"theta_{self.pair}"
        deflection = f"({angle} - {self.rest:g})" if self.rest else angle
        terms = []
        if self.sine:
            terms.append(f"- {self.sine:g} sin({angle})")
        if self.stiffness:
            terms.append(f"- {self.stiffness:g} {deflection}")
        if self.damping:
            terms.append(f"- {self.damping:g} dtheta_{self.pair}")
        if self.amplitude:
            terms.append(f"+ {self.amplitude:g} sin({self.frequency:g} t)")
        return " ".join(terms).removeprefix("+ ").replace("- ", "-", 1)

    def torque(self, t: float, angle: float, rate: float) -> float:
        """Return the torque (N m) at a time (s), an angle (rad) and a rate (rad/s)."""
        return float(
            -self.sine * np.sin(angle)
            - self.stiffness * (angle - self.rest)
            - self.damping * rate
            + self.amplitude * np.sin(self.frequency * t)
        )


@dataclass(frozen=True)
class DynamicsCase:
    """A mechanism with all its loads, and its start in assembly mode 0.

    Attributes
    ----------
    mechanism
        The mechanism with the loads.
    start
        Inputs (rad) and their rates (rad/s) at the start.
    pair_loads
        The same loads, for other engines.
    values, rates
        (variables,) all pair variables (rad) and their rates (rad/s) at the start, for
        engines that do not close the loops themselves.
    """

    mechanism: Mechanism
    start: Start
    pair_loads: tuple[PairLoad, ...]
    values: Floats
    rates: Floats

    @property
    def inputs(self) -> list[str]:
        """Names of the driven pairs."""
        return [item.pair for item in self.mechanism.inputs]

    def make_problem(self) -> Problem:
        """Return the problem of forward dynamics until the last of `TIMES`."""
        return prepare(self.mechanism, self.start, float(TIMES[-1]))


def run(quick: bool) -> list[Section]:
    """Return one section for each mechanism."""
    four_bar = _one_input_case(load("four_bar"), "21", "41")
    stephenson = _one_input_case(load_with_uniform_arcs("stephenson"), "12", "16")
    return [
        _compare_engines(four_bar, "one loop", quick),
        _compare_engines(stephenson, "two loops", quick),
        _compare_engines(_wrist_case(), "two freedoms", quick),
    ]


def _one_input_case(mechanism: Mechanism, crank: str, rocker: str) -> DynamicsCase:
    """Return a case with loads at the pairs of a crank, which is driven, and a rocker."""
    pair_loads = (
        PairLoad(crank, sine=1.0, damping=2.0, amplitude=10.0, frequency=2.0),
        PairLoad(rocker, sine=5.0, damping=2.0),
    )
    return _make_case(mechanism.with_inputs(crank), Start(0.3, 1.0), pair_loads)


def _wrist_case() -> DynamicsCase:
    """Return a wrist with springs that keep it away from crossings of its modes."""
    mechanism = load_with_uniform_arcs("two_dof_spm")
    spring = {"stiffness": 25.0, "damping": 2.0}
    pair_loads = (
        PairLoad("21", rest=0.4, amplitude=4.0, frequency=2.0, **spring),
        PairLoad("61", rest=0.9, amplitude=3.0, frequency=3.0, **spring),
    )
    return _make_case(mechanism, Start((0.4, 0.9), (0.5, -0.3)), pair_loads)


def _make_case(
    mechanism: Mechanism, start: Start, pair_loads: tuple[PairLoad, ...]
) -> DynamicsCase:
    """Return a case with the pair variables and rates at its start."""
    input_pairs = [item.pair for item in mechanism.inputs]
    q, dq = start.each(input_pairs)
    position_analysis = PositionAnalysis(mechanism, path=q[None], assembly_mode=0)
    values = position_analysis.motion().values[0].copy()
    input_variables = [mechanism.angles[pair] for pair in input_pairs]
    values[input_variables] = q
    motion = motion_by_variables(
        position_analysis.solver.closure, values[None], input_variables
    )
    rates = dq @ motion.rates[0]
    loads = tuple(pair_load.as_load() for pair_load in pair_loads)
    return DynamicsCase(replace(mechanism, loads=loads), start, pair_loads, values, rates)


def load_with_uniform_arcs(name: str) -> Mechanism:
    """Return a shipped mechanism without loads, whose links are uniform arcs.

    Each link has a thin arc from its first axis to each other one.
    """
    mechanism = replace(load(name), loads=())
    masses = []
    for link, axis_by_pair in link_axes(mechanism).items():
        if link == mechanism.ground:
            continue
        first_axis, *other_axes = axis_by_pair.values()
        arcs = []
        for axis in other_axes:
            try:
                arcs.append(uniform_arc(first_axis, axis, ARC_MASS_KG, ARC_RADIUS_M))
            except ModelError:
                continue  # two axes on one line have no arc of their own
        tensor = np.sum([arc[0] for arc in arcs], axis=0)
        centre = np.mean([arc[1] for arc in arcs], axis=0)
        rows = tuple(tuple(map(float, row)) for row in tensor)
        mass = ARC_MASS_KG * len(arcs)
        masses.append(Mass(link, rows, mass, tuple(map(float, centre))))  # type: ignore[arg-type]
    return replace(mechanism, masses=tuple(masses))


def _compare_engines(case: DynamicsCase, kind: str, quick: bool) -> Section:
    """Return the section of a case.

    Parameters
    ----------
    case
        The case.
    kind
        The kind of mechanism, for the heading.
    quick
        Whether there are fewer settings and repetitions.
    """
    reference, difference = _simulate_reference(case)
    has_one_input = len(case.inputs) == 1
    settings = _list_settings(case, quick)
    repetitions = 1 if quick else 5
    # The engines alternate, so that a busy machine slows all of them alike.
    rounds = [[item.simulate() for item in settings] for _ in range(repetitions)]
    rows: list[tuple[Cell, ...]] = []
    for item, engine_runs in zip(settings, zip(*rounds, strict=True), strict=True):
        error = float(np.max(np.abs(engine_runs[0].inputs - reference)))
        milliseconds = [1e3 * engine_run.seconds for engine_run in engine_runs]
        median_milliseconds = float(np.median(milliseconds))
        rows.append(
            (item.engine, item.setting, error, median_milliseconds, min(milliseconds))
        )
    absent = _absent_engines()
    skipped = f" Not installed, so skipped: {', '.join(absent)}." if absent else ""
    loads = " and ".join(
        f"`{pair_load.text}` at the pair {pair_load.pair}" for pair_load in case.pair_loads
    )
    start = ", ".join(
        f"q_{pair}(0) = {q:g} rad, q_{pair}'(0) = {dq:g} rad/s"
        for pair, q, dq in _list_start(case)
    )
    return Section(
        f"Peers: forward dynamics, {kind}",
        f"The mechanism `{case.mechanism.name}` starts with {start} and moves for 10 s "
        f"under the torques (N m) {loads}. The error is the largest error of an input at "
        f"{len(TIMES)} times. The reference is the compiled engine at the tolerance "
        f"{REFERENCE_TOLERANCE:g}. It differs by {difference:.2g} rad from "
        f"{_REFERENCE_CHECKS[has_one_input]}." + skipped,
        ("engine", "setting", "error of q, rad", "ms, median", "ms, fastest"),
        rows,
        "The times are processor times of the simulation alone. Compiling, and computing a "
        "[stored model](dynamics.md#stored-models) from the mechanism, are not included. "
        "For Pinocchio and MuJoCo, the loads are computed in Python, at each evaluation of "
        "the accelerations. OpenSim cannot be installed with pip and was not run. The "
        "settings are described in [dynamics](dynamics.md#other-engines).",
    )


def _list_start(case: DynamicsCase) -> list[tuple[str, float, float]]:
    """Return the pair, the angle (rad) and the rate (rad/s) of each input at the start."""
    angles, rates = case.start.each(case.inputs)
    return list(zip(case.inputs, angles, rates, strict=True))


_REFERENCE_CHECKS = {
    True: "SciPy's DOP853 on Eksergian's equation in q",
    False: "NumPy's collocation at 1e-13",
}
"""The integration with which the reference is compared. The key True is for one input."""


def _absent_engines() -> list[str]:
    """Return the names of the engines that are not installed."""
    absent = []
    if not available():
        absent.append("heyoka")
    if not find_spec("pinocchio"):
        absent.append("Pinocchio (pin)")
    if not find_spec("mujoco"):
        absent.append("MuJoCo (mujoco)")
    return absent


def _list_settings(case: DynamicsCase, quick: bool) -> list[EngineSetting]:
    """Return the installed engines with the settings that are compared."""
    has_one_input = len(case.inputs) == 1
    settings: list[EngineSetting] = []

    def add(engine: str, setting: str, simulate: Simulate) -> None:
        settings.append(EngineSetting(engine, setting, simulate))

    if available():
        for tolerance in (1e-9, 1e-13) if quick else (1e-6, 1e-8, 1e-10, 1e-12, 1e-15):
            # Full code for several inputs compiles for more than a minute.
            has_full_code = has_one_input or tolerance == 1e-6
            for compact in (True, False) if has_full_code else (True,):
                engine = f"spherekit compiled, {'compact' if compact else 'full'}"
                simulate = _compiled_simulation(case, tolerance, compact)
                add(engine, f"tolerance {tolerance:g}", simulate)
    for tolerance in (1e-7,) if quick else (1e-6, 1e-9, 1e-12):
        simulate = _numpy_simulation(case, tolerance)
        add("spherekit NumPy", f"tolerance {tolerance:g}", simulate)
    if has_one_input:
        for tolerance in (1e-9,) if quick else (1e-7, 1e-9, 1e-11):
            simulate = _reduced_simulation(case, tolerance)
            add("spherekit stored model", f"tolerance {tolerance:g}", simulate)
    if find_spec("pinocchio"):
        for tolerance in (1e-8,) if quick else (1e-6, 1e-8, 1e-9, 1e-10, 1e-12):
            simulate = _pinocchio_simulation(case, tolerance)
            add("Pinocchio, DOP853", f"rtol {tolerance:g}", simulate)
    if find_spec("mujoco"):
        for step in (1e-3,) if quick else (2e-3, 1e-3, 5e-4, 2.5e-4):
            add("MuJoCo, RK4", f"step {step:g} s", _mujoco_simulation(case, step))
    return settings


def _simulate_reference(case: DynamicsCase) -> tuple[Floats, float]:
    """Return accurate inputs over time, and their difference from another integration.

    Returns
    -------
    inputs
        (times, inputs) the inputs (rad) at `TIMES`.
    difference
        The largest difference (rad) from an integration by another method; 0 if there is
        only this one, because heyoka is not installed.
    """
    if len(case.inputs) == 1:
        check = _integrate_reduced_equation(case)
    else:
        check = _numpy_simulation(case, 1e-13)().inputs
    if not available():
        return check, 0.0
    simulation = by_taylor_series(
        case.make_problem(), REFERENCE_TOLERANCE, "it is the reference"
    )
    reference = simulation.at(TIMES).inputs
    return reference, float(np.max(np.abs(check - reference)))


def _integrate_reduced_equation(case: DynamicsCase) -> Floats:
    """Integrate Eksergian's equation of the only input by SciPy's method DOP853."""
    from scipy.integrate import solve_ivp

    model = reduced_model(case.mechanism, poles=())

    def state_derivative(t: float, state: Floats) -> tuple[float, float]:
        q, dq = float(state[0]), float(state[1])
        # The torque at zero acceleration is what the loads and dB/dq resist.
        return dq, -model.torque(q, dq, 0.0, t) / model.inertia(q)

    (q,), (dq,) = case.start.each(case.inputs)
    solution = solve_ivp(
        state_derivative,
        (0.0, float(TIMES[-1])),
        (q, dq),
        "DOP853",
        TIMES,
        rtol=1e-13,
        atol=1e-14,
    )
    return np.asarray(solution.y[:1].T)


def _compiled_simulation(case: DynamicsCase, tolerance: float, compact: bool) -> Simulate:
    """Compile the equation of motion, and return a simulation by the compiled engine."""
    problem = replace(case.make_problem(), compact=compact)
    by_taylor_series(problem, tolerance, "it is compiled now")

    def simulate() -> EngineRun:
        started = time.process_time()
        simulation = by_taylor_series(problem, tolerance, "it was asked for")
        seconds = time.process_time() - started
        return EngineRun(simulation.at(TIMES).inputs, seconds)

    return simulate


def _numpy_simulation(case: DynamicsCase, tolerance: float) -> Simulate:
    """Return a simulation by collocation on NumPy arrays."""
    problem = case.make_problem()

    def simulate() -> EngineRun:
        started = time.process_time()
        solver = Collocation(problem, tolerance)
        while solver.advance():
            pass
        seconds = time.process_time() - started
        simulation = solver.simulation("it was asked for")
        return EngineRun(simulation.at(TIMES).inputs, seconds)

    return simulate


def _reduced_simulation(case: DynamicsCase, tolerance: float) -> Simulate:
    """Make a reduced model, and return a simulation of its motion."""
    model = reduced_model(case.mechanism, poles=())
    (q,), (dq,) = case.start.each(case.inputs)
    # The first evaluation of a single state makes a table for single states.
    model.torque(q, dq, 0.0, 0.0)

    def simulate() -> EngineRun:
        started = time.process_time()
        simulation = simulate_reduced(model, TIMES, q, dq, tolerance)
        seconds = time.process_time() - started
        return EngineRun(simulation.q[:, None], seconds)

    return simulate


def _mujoco_simulation(case: DynamicsCase, step: float) -> Simulate:
    """Return a simulation by MuJoCo with a constant step (s)."""
    import mujoco

    without_loads = replace(case.mechanism, loads=())
    text = MujocoModel(without_loads, case.values, step).text
    model: Any = mujoco.MjModel.from_xml_string(text)
    pairs = [model.joint(k).name for k in range(model.njnt)]
    joint_index = {pair: int(model.joint(pair).dofadr[0]) for pair in pairs}
    input_indices = [joint_index[pair] for pair in case.inputs]
    indexed_loads = [(joint_index[x.pair], x) for x in case.pair_loads]
    start_rates = [case.rates[case.mechanism.angles[pair]] for pair in pairs]
    steps_per_time = round(float(TIMES[1]) / step)

    def apply_loads(_: Any, data: Any) -> None:
        for index, pair_load in indexed_loads:
            angle = data.qpos[index]
            rate = data.qvel[index]
            data.qfrc_applied[index] = pair_load.torque(data.time, angle, rate)

    def simulate() -> EngineRun:
        data = mujoco.MjData(model)
        data.qvel[[joint_index[pair] for pair in pairs]] = start_rates
        mujoco.set_mjcb_control(apply_loads)
        try:
            inputs = [data.qpos[input_indices].copy()]
            started = time.process_time()
            for _ in TIMES[1:]:
                mujoco.mj_step(model, data, steps_per_time)
                inputs.append(data.qpos[input_indices].copy())
            return EngineRun(np.array(inputs), time.process_time() - started)
        finally:
            mujoco.set_mjcb_control(None)

    return simulate


def _pinocchio_simulation(case: DynamicsCase, tolerance: float) -> Simulate:
    """Return a simulation by Pinocchio's constraint dynamics and SciPy's DOP853."""
    from scipy.integrate import solve_ivp

    bodies = construct_rigid_bodies(replace(case.mechanism, loads=()), case.values)
    pin, model, constraints = _make_pinocchio_model(bodies)
    pairs = [hinge.pair for hinge in bodies.hinges]
    data = model.createData()
    constraint_data = pin.StdVec_RigidConstraintData()
    for constraint in constraints:
        constraint_data.append(constraint.createData())
    pin.initConstraintDynamics(model, data, constraints, constraint_data)
    proximal_settings = pin.ProximalSettings(*PROXIMAL_SETTINGS)
    joint_index = {pair: model.joints[model.getJointId(pair)].idx_v for pair in pairs}
    input_indices = [joint_index[pair] for pair in case.inputs]
    indexed_loads = [(joint_index[x.pair], x) for x in case.pair_loads]
    count = model.nv
    # Joints of Pinocchio have the angle 0 in the configuration at the start.
    start_angles = np.zeros(count)
    start_rates = np.zeros(count)
    for hinge in bodies.hinges:
        index = joint_index[hinge.pair]
        start_angles[index] = hinge.value
        start_rates[index] = case.rates[case.mechanism.angles[hinge.pair]]

    def state_derivative(t: float, state: Floats) -> Floats:
        q = state[:count]
        v = state[count:]
        torque = np.zeros(count)
        for index, pair_load in indexed_loads:
            angle = q[index] + start_angles[index]
            torque[index] = pair_load.torque(t, angle, v[index])
        acceleration = pin.constraintDynamics(
            model, data, q, v, torque, constraints, constraint_data, proximal_settings
        )
        return np.concatenate([v, acceleration])

    def simulate() -> EngineRun:
        started = time.process_time()
        solution = solve_ivp(
            state_derivative,
            (0.0, float(TIMES[-1])),
            np.concatenate([np.zeros(count), start_rates]),
            "DOP853",
            TIMES,
            rtol=tolerance,
            atol=tolerance,
        )
        seconds = time.process_time() - started
        inputs = solution.y[input_indices].T + start_angles[input_indices]
        return EngineRun(np.asarray(inputs), seconds)

    return simulate


def _make_pinocchio_model(bodies: RigidBodies) -> tuple[Any, Any, Any]:
    """Return the module of Pinocchio, the model of the tree, and the loop constraints."""
    import pinocchio as pin

    model = pin.Model()
    identity = pin.SE3.Identity()
    model.gravity.linear = np.zeros(3)
    joint_of_link = {bodies.mechanism.ground: 0}
    for hinge, body in zip(bodies.hinges, bodies.bodies, strict=True):
        joint = pin.JointModelRevoluteUnaligned(*map(float, hinge.axis))
        parent = joint_of_link[hinge.parent]
        joint_of_link[hinge.child] = model.addJoint(parent, joint, identity, hinge.pair)
        inertia = pin.Inertia(body.mass, body.centre, body.tensor)
        model.appendBodyToJoint(joint_of_link[hinge.child], inertia, identity)
    constraints = pin.StdVec_RigidConstraintModel()
    for hinge in bodies.loop_hinges:
        # A point on the axis of the hinge is the same on both bodies. The centre is so
        # anyway, so that the axes agree.
        point = pin.SE3(np.eye(3), hinge.axis)
        constraint = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D,
            model,
            joint_of_link[hinge.parent],
            point,
            joint_of_link[hinge.child],
            point,
            pin.LOCAL,
        )
        constraint.setBaumgarteCorrectorParameters(
            pin.BaumgarteCorrectorParameters(
                LOOP_CORRECTION_RATE**2, 2.0 * LOOP_CORRECTION_RATE
            )
        )
        constraints.append(constraint)
    return pin, model, constraints
