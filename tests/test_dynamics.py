"""Inertia, loads, torque from motion and motion from torque, against other ways to them.

The four-bar of Di Gregorio (2024), Tables 1 and 2, is evaluated from its closed forms,
eqs. (22) to (28), with 50 digits; other mechanisms by Newton's and Euler's equations of
their links with all reactions.
"""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from helpers.engines import ENGINES
from helpers.refusals import TABLES, check_call
from mechanism_examples import named_mechanisms as example_mechanisms
from oracles.exact_four_bar import four_bar as four_bar_at
from oracles.newton_euler import with_masses_and_loads
from spherekit_analyses.eksergian import Eksergian

import spherekit as sk
from spherekit.dynamics import forward_dynamics
from spherekit.dynamics.simulation_start import PoseStart
from spherekit.errors import SolveError
from spherekit.files.study import Start
from spherekit.files.time_law import ConstantSpeed
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import JointLimit, Spring
from spherekit.positions.position_analysis import PositionAnalysis


def simulate(*given, **options):
    """Return a simulation by NumPy; test_engine.py compares the two engines."""
    return forward_dynamics.simulate(*given, engine="numpy", **options)


PARALLELOGRAM_ARCS = np.radians([60.0, 40.0, 60.0, 40.0])
PARALLELOGRAM = replace(example_mechanisms.four_bar(PARALLELOGRAM_ARCS), loads=())
"""A four-bar with equal opposite arcs. It is flat at the input 0."""
TURN = np.linspace(0.0, 2.0 * np.pi, 121)
DRIVING = "10*sin(2*t)"
"""Torque (N m) of the input over time (s)."""


# --- the four-bar in 50 digits ------------------------------------------------------


@pytest.fixture(scope="module")
def exact():
    """Return exact quantities of the four-bar of Di Gregorio (2024), by mode p = 0 and 1.

    The closed forms of the source are evaluated in 60 digits. Derivatives are central
    differences with a step of 1e-18, with an error of about 1e-36. For each mode there is a
    table (121, 13) with a row for each input angle q of `TURN`; the input has the rate 1
    rad/s. The columns are:

    - 0: theta41, the angle of the rocker;
    - 1 to 3: u31, the pole axis (axis of relative rotation) of coupler and ground; 4, 5:
      the velocity coefficients w31 and w41; 6, 7: the derivatives of w31 and w41 by q;
    - 8, 9: the inertia B reduced to the input, and dB/dq;
    - 10, 11: the generalized forces of both loads of the file, torques on the crank and on
      the rocker; 12: the driving torque tau = dB/dq / 2 - sum of the forces.
    """
    columns = {}
    with mp.workdps(60):
        tensors = {int(mass.link): mass.tensor for mass in sk.load("four_bar").masses}
        arcs = [mp.radians(angle) for angle in (60, 20, 70, 40)]

        def evaluate(q, p):
            four_bar = four_bar_at(arcs, q, p)
            u31, w31, w41 = four_bar.coefficients()
            return four_bar.theta, u31, w31, w41, mp.fsum(four_bar.inertia(tensors))

        h = mp.mpf(10) ** -18
        for p in (0, 1):
            rows = []
            for q in TURN:
                q = mp.mpf(float(q))
                theta, u31, w31, w41, inertia = evaluate(q, p)
                before = evaluate(q - h, p)
                after = evaluate(q + h, p)
                dw31, dw41, inertia_dq = (
                    (after[k] - before[k]) / (2 * h) for k in (2, 3, 4)
                )
                # The file states the torques -sin(theta_21) - 2 dtheta_21 at the crank and
                # -5 sin(theta_41) - 2 dtheta_41 at the rocker, whose rate is w41.
                force_on_crank = -mp.sin(q) - 2
                force_on_rocker = w41 * (-5 * mp.sin(theta) - 2 * w41)
                tau = inertia_dq / 2 - force_on_crank - force_on_rocker
                rows.append([theta, *u31, w31, w41, dw31, dw41, inertia, inertia_dq])
                rows[-1] += [force_on_crank, force_on_rocker, tau]
            columns[p] = np.array(rows, dtype=float)
    return columns


@pytest.fixture(scope="module")
def four_bar():
    return sk.load("four_bar")


@pytest.fixture(scope="module")
def four_bar_run(four_bar):
    return sk.run(four_bar, ["poles:only=31+41", Eksergian()], samples=121)


def rows_of(frame, assembly_mode, **chosen):
    """Return the rows of a mode, in which each column in `chosen` has the stated value."""
    for name, value in chosen.items():
        frame = frame[frame[name] == value]
    return frame[frame["assembly_mode"] == assembly_mode]


def mode_of(exact, theta41):
    """Return the number p (0 or 1) of the mode with this theta41 at the first sample.

    The closed forms depend on p, by eq. (25) of Di Gregorio (2024). So the caller finds the
    exact values for an assembly mode of a run.
    """
    return int(abs(np.sin(0.5 * (exact[1][0, 0] - theta41))) < 1e-9)


@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_tables_1_and_2_of_the_source(four_bar_run, exact, assembly_mode):
    """All columns of a run of 121 samples are those of the closed forms, to 1e-12.

    The source is Di Gregorio (2024), whose Tables 1 and 2 have these quantities.
    `four_bar_run` is the run. `exact` has a table of the closed forms for each of the two
    modes, which the source numbers p = 0 and 1. `mode_of` returns the p of an assembly mode
    of the run: the p with the same rocker angle at the first sample.

    A pole is the axis of the relative rotation of two links: pole 31 is that of the coupler
    (link 3) relative to the ground (link 1). The sign of a pole direction is arbitrary, and
    the coefficients of the pole 31 change their sign with it.
    """
    tolerance = 1e-12
    motion = rows_of(four_bar_run.frame("motion"), assembly_mode)
    theta = motion["theta_41"].to_numpy()
    # One row for each of the 13 columns of `exact`.
    reference = exact[mode_of(exact, theta[0])].T
    theta41 = reference[0]
    u31 = reference[1:4].T
    # Velocity coefficients w and acceleration coefficients dw of the poles 31 and 41.
    w31, w41, dw31, dw41 = reference[4:8]
    # Inertia of the equation of motion, generalized forces of the loads on crank and
    # rocker, and driving torque.
    inertia, inertia_dq, on_crank, on_rocker, tau = reference[8:]
    assert np.max(np.abs(np.sin(0.5 * (theta - theta41)))) < tolerance

    # This table has the poles of all moving links relative to the ground.
    poles = four_bar_run.frame("poles")
    pole_31 = rows_of(poles, assembly_mode, link="3")
    pole_41 = rows_of(poles, assembly_mode, link="4")
    direction = pole_31[["ux", "uy", "uz"]].to_numpy()
    sign = np.sign(np.sum(direction * u31, axis=1))
    assert np.max(np.abs(direction * sign[:, None] - u31)) < tolerance
    for name, exact_31, exact_41 in (
        ("velocity_coefficient", w31, w41),
        ("acceleration_coefficient", dw31, dw41),
    ):
        assert np.max(np.abs(pole_31[name].to_numpy() * sign - exact_31)) < tolerance
        assert np.max(np.abs(pole_41[name].to_numpy() - exact_41)) < tolerance

    # The analysis "eksergian" has the quantities of the equation of motion.
    rows = rows_of(four_bar_run.frame("eksergian"), assembly_mode)
    for name, values in (
        ("B", inertia),
        ("dB_dq", inertia_dq),
        ("Q", on_crank + on_rocker),
        ("tau", tau),
    ):
        assert np.max(np.abs(rows[name].to_numpy() - values)) < tolerance
    loads = rows_of(four_bar_run.frame("eksergian", "loads"), assembly_mode)
    for name, values in (("on_crank", on_crank), ("on_rocker", on_rocker)):
        force = loads[loads["load"] == name]["Q"].to_numpy()
        assert np.max(np.abs(force - values)) < tolerance
    parts = rows_of(four_bar_run.frame("eksergian", "inertia"), assembly_mode)
    sum_of_links = parts.groupby("sample")["B"].sum().to_numpy()
    assert np.max(np.abs(sum_of_links - inertia)) < tolerance


def test_torque_at_another_pair_does_the_same_work(four_bar):
    found = sk.inverse_dynamics(four_bar, ConstantSpeed(2.0), np.linspace(0.1, 3.0, 30))
    (number,) = four_bar.variables_of(four_bar.pair_number["41"])
    power = found.torque_at("41") * found.pair_rates[:, number] * found.dq
    np.testing.assert_allclose(power, found.tau * found.dq, rtol=1e-12)


def test_a_torque_at_a_contact_is_refused():
    law = ConstantSpeed(1.0)
    found = sk.inverse_dynamics("roller_cam", law, [0.3], assembly_mode=0)
    with pytest.raises(sk.SpherekitError, match="is a contact pair"):
        found.torque_at("contact")


# --- motion from torque ----------------------------------------------------------------


@pytest.mark.slow
def test_a_reduced_model_moves_as_the_mechanism(four_bar):
    """A reduced model moves as the mechanism itself, up to the tolerance asked for.

    A reduced model has the equation of motion of one input as stored functions. The
    reference is a simulation of the mechanism with a tolerance of 1e-11. Pair variables and
    energy may deviate by ten times the tolerance of the input angle.
    """
    t = np.linspace(0.0, 10.0, 101)
    simulation = simulate(four_bar, Start(0.3, 1.0), 10.0, torque=DRIVING, tolerance=1e-11)
    history = simulation.at(t)
    # Poles (axes of rotation) are not needed for the motion.
    model = sk.reduced_model(four_bar, poles=()).with_torque(DRIVING)
    # The stored functions are functions of the input angle q, because the crank turns
    # fully. For an input that turns back they would be functions of an arc length.
    assert model.heading.by == ("q",)
    for tolerance in (1e-7, 1e-9):
        # The input starts at 0.3 rad with 1 rad/s, as above.
        reduced = sk.simulate_reduced(model, t, 0.3, 1.0, tolerance)
        assert np.max(np.abs(reduced.q - history.q)) < tolerance
        assert np.max(np.abs(reduced.values - history.values)) < 10 * tolerance
        assert reduced.energy < 10 * tolerance
        assert reduced.message == ""


@pytest.mark.slow
def test_a_loaded_reduced_model_has_all_loads_and_ends_at_a_joint_limit(tmp_path):
    """A reduced model moves as the loaded mechanism until the crank reaches its limit.

    A reduced model has the equation of motion of one input as stored functions. The
    four-bar has a load of every kind (`with_masses_and_loads`), a table of torques over
    time, and a limit of its crank. The model is written to a file and read from it. Its
    rows after the limit are NaN.
    """
    mechanism, joint = with_masses_and_loads("four_bar", np.random.default_rng(8))
    table = sk.TorqueTable(
        "motor_table", joint, times=(0.0, 0.4, 0.5), torques=(3.0, -1.0, 3.0), periodic=True
    )
    mechanism = replace(
        mechanism,
        loads=(*mechanism.loads, table),
        joint_limits=(JointLimit("21", -2.0, 1.5),),
    )
    start = Start(0.3, 4.0)
    simulation = simulate(mechanism, start, 2.0, tolerance=1e-11)
    assert simulation.end.kind == "joint_limit"

    sk.reduced_model(mechanism, poles=()).save(tmp_path / "loads.npz")
    model = sk.load_reduced(tmp_path / "loads.npz")
    # The crank does not turn fully, so the functions depend on s. This is the arc length
    # along the curve that the configurations form in the space of the joint angles.
    assert model.heading.by == ("s",)
    assert not model.heading.periodic
    # `places` returns the arc lengths at which the angle of the crank has a value, here
    # that of the start. An added revolution must make no difference.
    (s,) = model.places("theta_21", 0.3 + 2.0 * np.pi)
    s_rate = 4.0 / model.value("d(theta_21)/ds", s)
    t = np.linspace(0.0, 2.0, 81)
    reduced = sk.simulate_reduced(model, t, s, s_rate)
    is_before_end = t < simulation.end.t
    q = simulation.at(t[is_before_end]).q
    assert np.max(np.abs(reduced.q[is_before_end] - q)) < 1e-8
    # 0.1 s are four steps of t: both may reach the limit at slightly different times.
    assert np.all(np.isnan(reduced.q[t > simulation.end.t + 0.1]))
    assert "the curve ends" in reduced.message


def differences_of_the_source(mechanism, start, duration, torque, step):
    """Return q (rad) at equal time steps by the finite differences of Di Gregorio (2024).

    This is an independent integration of the equation of motion. With the step D, q_1 = q_0
    + q'_0 D, and by eqs. (30) and (31) q_{i+1} = (D^2 Q - 1/2 dB/dq (q_i - q_{i-1})^2) / B
    + 2 q_i - q_{i-1}. B is the inertia reduced to the input, by the closed forms of the
    same paper. The assembly mode is that with p = 1 in its eq. (25).

    Parameters
    ----------
    mechanism, start
        The four-bar of the source with masses, and `Start` with q and its rate.
    duration, step
        Seconds.
    torque
        Function of time that returns the generalized force Q.
    """
    arcs = [mp.radians(angle) for angle in (60, 20, 70, 40)]  # of this four-bar
    tensors = {int(mass.link): mass.tensor for mass in mechanism.masses}

    def inertia(q):
        return mp.fsum(four_bar_at(arcs, q, 1).inertia(tensors))

    with mp.workdps(30):
        h = mp.mpf(10) ** -10
        q = [mp.mpf(start.q)]
        change = mp.mpf(start.dq) * step  # q_i - q_{i-1}
        for number in range(round(duration / step)):
            if number > 0:
                inertia_dq = (inertia(q[-1] + h) - inertia(q[-1] - h)) / (2 * h)
                force = torque(number * step)
                numerator = step**2 * force - inertia_dq * change**2 / 2
                change += numerator / inertia(q[-1])
            q.append(q[-1] + change)
    return np.array(q, dtype=float)


@pytest.mark.slow
def test_the_finite_differences_of_the_source_converge_to_the_simulation(four_bar):
    """The finite differences of Di Gregorio (2024) converge to the simulation.

    They are of first order: half the step, half the error. `differences_of_the_source` has
    only one torque, a function of time. So the loads of the file are removed from the
    simulation. Both have the torque `DRIVING`, 10 sin(2 t).
    """
    mechanism = replace(four_bar, loads=())
    start = Start(0.3, 1.0)
    duration = 0.5
    simulation = simulate(mechanism, start, duration, torque=DRIVING, tolerance=1e-11)
    errors = []
    for step_count in (50, 100, 200):
        q = differences_of_the_source(
            mechanism,
            start,
            duration,
            torque=lambda t: 10.0 * np.sin(2.0 * t),
            step=duration / step_count,
        )
        t = np.linspace(0.0, duration, step_count + 1)
        errors.append(np.max(np.abs(q - simulation.at(t).q)))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 1.8) & (ratios < 2.2)), errors
    assert errors[-1] < 1e-3


@pytest.fixture(scope="module")
def crank_driven(four_bar):
    """Return a free motion of 5 s without loads, simulated by the crank (pair 21)."""
    free = replace(four_bar, loads=())
    return simulate(free, Start(0.3, 3.0), 5.0, tolerance=1e-11)


@pytest.fixture(scope="module")
def rocker_driven(four_bar, crank_driven):
    """Return the same motion simulated by the rocker (pair 41) as input.

    It starts at the same pose with the rate that the rocker has there.
    """
    free = replace(four_bar, loads=())
    first = crank_driven.at([0.0])
    rocker_rate = float(first.value_rates[0, free.angles["41"]])
    start = PoseStart(first.values[0], "41", rocker_rate)
    return simulate(free, start, 5.0, input_pair="41", tolerance=1e-11)


@pytest.mark.slow
def test_a_motion_by_the_rocker_is_that_by_the_crank(crank_driven, rocker_driven):
    """The same free motion is simulated with the crank and with the rocker as input.

    `crank_driven` and `rocker_driven` are the two simulations. The motion passes dead
    centres of the rocker, where its rate is zero. They must be events of the second
    simulation only, two in each turn of the crank.
    """
    t = np.linspace(0.0, 5.0, 101)
    gap = rocker_driven.at(t).values - crank_driven.at(t).values
    assert np.max(np.abs(gap)) < 1e-8

    def dead_centre_times(simulation):
        return [event.t for event in simulation.events if event.kind == "dead_centre"]

    times = dead_centre_times(rocker_driven)
    # The crank starts at 0.3 rad. The first and the last turn may be incomplete, so the
    # number of dead centres can deviate by 2.
    crank_turns = (crank_driven.at([5.0]).q[0] - 0.3) / (2.0 * np.pi)
    assert abs(len(times) - 2.0 * crank_turns) <= 2.0
    rocker_rates = rocker_driven.at(times).dq  # the input of this simulation
    assert np.max(np.abs(rocker_rates)) < 1e-7
    assert dead_centre_times(crank_driven) == []


@pytest.mark.slow
def test_a_start_at_a_dead_centre_needs_the_rate_of_another_pair(four_bar, rocker_driven):
    """At a dead centre of the rocker (41), its rate says nothing about the motion.

    `rocker_driven` is a simulation with the rocker as input, which passes dead centres. A
    start there that states the rate of the rocker is refused. A start that states the rate
    of the crank (21) continues the motion to the same end.
    """
    free = replace(four_bar, loads=())
    time = next(event.t for event in rocker_driven.events if event.kind == "dead_centre")
    at_dead_centre = rocker_driven.at([time])
    pose = at_dead_centre.values[0]
    with pytest.raises(SolveError, match="dead centre"):
        simulate(free, PoseStart(pose, "41", 1.0), 1.0, input_pair="41")

    crank_rate = float(at_dead_centre.value_rates[0, free.angles["21"]])
    remaining = 5.0 - time  # `rocker_driven` takes 5 s
    continued = simulate(
        free, PoseStart(pose, "21", crank_rate), remaining, input_pair="41"
    )
    end_gap = continued.at([remaining]).values[0] - rocker_driven.at([5.0]).values[0]
    assert np.max(np.abs(end_gap)) < 1e-7


def test_steps_begin_anew_where_a_torque_table_has_kinks(four_bar):
    table = sk.TorqueTable("motor", "21", (0.0, 0.4, 0.5), (3.0, -1.0, 3.0), True)
    switched = replace(four_bar, loads=(*four_bar.loads, table))
    found = simulate(switched, Start(0.3, 1.0), 1.2, tolerance=1e-10, check=True)
    times = [event.t for event in found.events if event.kind == "switch"]
    np.testing.assert_allclose(times, [0.4, 0.5, 0.9, 1.0], atol=1e-12)
    assert found.checks.error < 1e-9 and found.checks.energy < 1e-10


@pytest.mark.slow
def test_a_simulation_ends_where_a_contact_leaves_its_profile():
    """A cam with an open profile moves until its roller reaches the end of the profile.

    It starts with 2 rad/s and has no loads, so the kinetic energy stays constant. Inverse
    dynamics gives the last of 61 equally spaced cam angles at which the mechanism can be
    assembled. The end of the profile lies at this angle or beyond. The simulation must
    reach at least this angle less 0.01 rad.
    """
    tensor = (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.15)
    cam = replace(example_mechanisms.open_cam(), masses=(Mass("2", tensor),))
    # At 1 rad/s the cam angles (rad) equal the times. Inverse dynamics is used for its
    # configurations only.
    times = TURN[::2]  # every other one of 121 numbers from 0 to 2 pi
    solution = sk.inverse_dynamics(
        cam, ConstantSpeed(1.0), times, assembly_mode=0, search=False
    )
    is_ok = solution.status == sk.Status.OK
    # The first configuration; the cam (pair 12) turns with 2 rad/s.
    start = PoseStart(solution.values[is_ok][0], "12", 2.0)
    simulation = forward_dynamics.simulate(cam, start, 20.0, tolerance=1e-7)
    assert simulation.end.kind == "off_profile"
    # The compiled engine has no profiles through points, so NumPy is used.
    assert simulation.engine.name == "numpy"
    assert "points" in simulation.engine.reason
    history = simulation.at(np.linspace(0.0, simulation.end.t, 9))
    assert history.q[-1] > solution.q[is_ok][-1] - 0.01
    assert np.ptp(history.kinetic) < 1e-7


@pytest.mark.slow
def test_a_crossing_of_curves_ends_a_simulation_unless_it_may_be_passed():
    """A flattened parallelogram may continue as a parallelogram or an antiparallelogram.

    The curves of both kinds of configurations cross in the flat pose. By default the
    simulation ends there. With `crossings="pass"` it must continue on the same curve. With
    t1 and t2, tan(angle / 2) of crank and rocker, t1 / t2 is constant on one of the curves,
    and t1 t2 on the other one.
    """
    start = Start(1.0, -1.0)  # input (rad) and its rate (rad/s)
    # This helper computes with NumPy, one of two engines. Below, the program chooses the
    # engine.
    stopped = simulate(PARALLELOGRAM, start, 5.0)
    assert stopped.end.kind == "singularity"
    passed = forward_dynamics.simulate(
        PARALLELOGRAM, start, 2.0 * stopped.end.t, crossings="pass"
    )
    assert passed.end.kind == "time"
    assert passed.checks.energy < 1e-12
    crossings = [event for event in passed.events if event.kind == "crossing"]
    assert len(crossings) == 1

    t = np.linspace(0.0, passed.end.t, 12)
    crank_and_rocker = passed.at(t).values[:, [0, 3]]
    t1, t2 = np.tan(0.5 * crank_and_rocker).T
    # The crank passed the angle 0, where the parallelogram is flat.
    assert crank_and_rocker[0, 0] * crank_and_rocker[-1, 0] < 0.0
    assert min(np.ptp(t1 / t2), np.ptp(t1 * t2)) < 1e-8

    # A run with the same start has the same motion.
    run = sk.run(
        PARALLELOGRAM,
        "poles",
        crossings="pass",
        start=start,
        duration=passed.end.t,
        samples=12,
    )
    table = run.frame("motion")
    assert table["theta_21"].to_numpy() == pytest.approx(crank_and_rocker[:, 0], abs=1e-9)


CROSSING_ERROR_RAD = 1e-12
"""An arc of a parallelogram that is longer by this angle moves its two curves apart by
about its square root, 1e-6 rad. Simulations treat such a point as a crossing."""
AVOIDING_ERROR_RAD = 1e-9
"""The same for curves that are about 3e-5 rad apart. Simulations stay on one of them."""


def imperfect_parallelogram(error_rad):
    """Return a parallelogram with one arc that is too long, so that its curves avoid.

    Near the flat configuration, configurations satisfy a quadratic equation. The error of
    the arc changes its constant term, which moves the two curves of configurations apart by
    about the square root of the error. Without loads a simulation keeps its energy.
    """
    arcs = PARALLELOGRAM_ARCS + [0.0, 0.0, error_rad, 0.0]
    return replace(example_mechanisms.four_bar(arcs), loads=())


def is_on_one_curve(mechanism, values):
    """Return whether all configurations (n, variables) are on the same curve."""
    curves = [item.curve for item in PositionAnalysis(mechanism).configurations.curves]
    # `find` returns NaN for a configuration that is not on the curve.
    return any(np.all(np.isfinite(curve.find(values))) for curve in curves)


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
def test_a_simulation_ends_where_curves_are_too_near_to_be_told_from_a_crossing(engine):
    simulation = forward_dynamics.simulate(
        imperfect_parallelogram(CROSSING_ERROR_RAD),
        Start(1.0, -1.0),
        4.0,
        tolerance=1e-7,
        engine=engine,
    )
    assert simulation.end.kind == "singularity"


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
def test_a_simulation_stays_on_its_curve_where_curves_avoid_each_other(engine):
    """The simulation reaches its end time on one curve, and keeps its energy."""
    mechanism = imperfect_parallelogram(AVOIDING_ERROR_RAD)
    simulation = forward_dynamics.simulate(
        mechanism, Start(1.0, -1.0), 4.0, tolerance=1e-7, engine=engine
    )
    assert simulation.end.kind == "time"
    history = simulation.at(np.linspace(0.0, simulation.end.t, 25))
    assert is_on_one_curve(mechanism, history.values)
    assert np.ptp(history.kinetic) < 1e-7 * np.max(history.kinetic)


@pytest.mark.many
@pytest.mark.parametrize(
    ("error_rad", "passes_a_crossing"),
    [(CROSSING_ERROR_RAD, True), (AVOIDING_ERROR_RAD, False)],
)
def test_a_simulation_that_may_pass_crossings_passes_curves_that_are_very_near(
    error_rad, passes_a_crossing
):
    """With `crossings="pass"` both simulations reach their end time."""
    simulation = forward_dynamics.simulate(
        imperfect_parallelogram(error_rad),
        Start(1.0, -1.0),
        4.0,
        tolerance=1e-7,
        crossings="pass",
    )
    assert simulation.end.kind == "time"
    has_crossed = any(event.kind == "crossing" for event in simulation.events)
    assert has_crossed == passes_a_crossing


@pytest.mark.parametrize(
    ("noise", "end"),
    [(1e-7, "time"), pytest.param(1e-2, "too_fast", marks=pytest.mark.slow)],
)
def test_a_torque_with_noise_is_followed_or_ends_with_a_word(noise, end):
    """Steps are as long as the tolerance allows; where they cannot, it does not go on."""

    def torque(t, q, dq):
        return 5.0 - 2.0 * dq + noise * np.sin(1e9 * q)

    found = simulate(MADE, START, 0.4, torque=torque, tolerance=1e-8)
    assert found.end.kind == end and ("noise" in found.end.message) == (end == "too_fast")
    smooth = simulate(MADE, START, 0.4, torque=lambda t, q, dq: 5.0 - 2.0 * dq)
    t = found.end.t
    assert abs(found.at([t]).q[0] - smooth.at([t]).q[0]) < 1e-8


# --- what is refused --------------------------------------------------------------------


MADE, START, UNIT = sk.load("four_bar"), Start(0.3, 1.0), ConstantSpeed(1.0)


@pytest.mark.parametrize("call", TABLES["dynamics"])
def test_bad_input_is_refused_before_anything_is_integrated(call):
    check_call(call, globals(), TABLES["dynamics"][call])


@pytest.mark.parametrize("left_out", ["masses", "loads"])
def test_totals_of_no_masses_or_no_loads_are_nan_in_failed_rows(four_bar, left_out):
    """A sum over no loads, or over no masses, is a number only in rows that are OK.

    The four-bar is driven at its rocker (41), which can only oscillate. At other rocker
    angles it cannot be assembled, so rows fail. Both a run and `inverse_dynamics` are
    checked, for the inertia B, its derivative, the load Q and the torque tau.
    """
    mechanism = replace(four_bar, loads=(Spring("spring", "43", 0.3),))
    if left_out == "masses":
        mechanism = replace(mechanism, masses=())
    else:
        mechanism = replace(mechanism, loads=())
    mechanism = mechanism.with_inputs("41")
    frame = sk.run(mechanism, "eksergian", samples=40).frame()
    t = np.linspace(0.0, 6.0, 40)
    solution = sk.inverse_dynamics(mechanism, ConstantSpeed(1.0), t)
    frame_failed = (frame["status"] != "OK").to_numpy()
    solution_failed = solution.status != sk.Status.OK
    assert np.any(frame_failed)
    assert not np.all(frame_failed)
    for name in ("B", "dB_dq", "Q", "tau"):
        assert np.array_equal(np.isnan(frame[name].to_numpy()), frame_failed)
        assert np.array_equal(np.isnan(getattr(solution, name)), solution_failed)


# --- motion of reduced models -------------------------------------------------------


@pytest.mark.slow
def test_a_reduced_model_that_leaves_its_curve_between_two_times_does_not_return():
    """A model has no motion after the time at which the mechanism reaches a joint limit.

    A spring pulls the crank back, and so the integrator may come back from beyond the end
    of the curve before the next of the given times. The end is that of `simulate`.
    """
    spring = Spring("spring", "21", 20.0, 1.0)
    limits = JointLimit("21", 0.5, 1.5)
    mechanism = replace(sk.load("four_bar"), joint_limits=(limits,), loads=(spring,))
    model = sk.reduced_model(mechanism, poles=())
    (s,) = model.places("theta_21", 1.0)
    s_rate = 5.0
    q_rate = s_rate * model.value("d(theta_21)/ds", s)
    end = simulate(mechanism, Start(1.0, q_rate), 2.0).end
    assert end.kind == "joint_limit"
    for t in np.linspace(0.05, 2.0, 40):
        reduced = sk.simulate_reduced(model, [0.0, t], s, s_rate)
        assert np.isnan(reduced.q[1]) == (t > end.t)
        assert ("the curve ends" in reduced.message) == (t > end.t)


@pytest.mark.slow
def test_a_reduced_model_stops_where_its_inertia_goes_to_zero(four_bar):
    """Only the rocker has mass. Its inertia, reduced to the crank, is 0 at its dead centre.

    `simulate` ends there too.
    """
    rocker_mass = tuple(mass for mass in four_bar.masses if mass.link == "4")
    mechanism = replace(four_bar, masses=rocker_mass, loads=())
    end = simulate(mechanism, Start(0.3, 1.0), 20.0).end
    assert end.kind == "no_inertia"
    model = sk.reduced_model(mechanism, poles=())
    with pytest.raises(SolveError, match=f"inertia goes to zero near t = {end.t:.6g} s"):
        sk.simulate_reduced(model, [0.0, 20.0], 0.3, 1.0)
    assert sk.simulate_reduced(model, [0.0, 0.99 * end.t], 0.3, 1.0).energy < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 0.1], 0.3, 1.0, np.nan), "tolerance: found nan"),
        (([0.0, 0.1], 0.3, 1.0, np.inf), "tolerance: found inf"),
        (([0.0, 0.1], 0.3, 1.0, 0.0), "tolerance: found 0, expected a number from 1e-12"),
        (([0.0, 0.1], 0.3, np.nan), "dx: found nan, expected a finite number"),
        (([[0.0, 0.1], [0.2, 0.3]], 0.3, 1.0), "increasing times"),
    ],
)
def test_a_motion_of_a_reduced_model_is_refused(four_bar, arguments, message):
    model = sk.reduced_model(four_bar, poles=())
    with pytest.raises(SolveError, match=message):
        sk.simulate_reduced(model, *arguments)


@pytest.mark.slow
def test_the_smallest_tolerance_of_a_reduced_model_is_reached(four_bar):
    model = sk.reduced_model(four_bar, poles=())
    reduced = sk.simulate_reduced(model, np.linspace(0.0, 2.0, 5), 0.3, 1.0, 1e-12)
    history = simulate(four_bar, Start(0.3, 1.0), 2.0, tolerance=1e-13).at(reduced.t)
    assert np.max(np.abs(reduced.q - history.q)) < 1e-11


@pytest.mark.parametrize("number", [np.int64(5), np.float32(5.0)])
def test_a_torque_may_be_a_number_of_numpy(number):
    """The type of the number 5 does not change the motion."""
    start = Start(0.3, 1.0)
    expected = sk.simulate("four_bar", start, 0.2, torque=5, engine="numpy").at([0.2])
    by_numpy = sk.simulate("four_bar", start, 0.2, torque=number, engine="numpy").at([0.2])
    assert by_numpy.q[0] == expected.q[0]


@pytest.mark.parametrize("torque", [np.inf, np.nan, {"21": -np.inf}])
def test_a_torque_that_is_not_finite_is_refused_as_a_number(torque):
    with pytest.raises(SolveError, match="the torque at 21 is .*; give a finite number"):
        sk.simulate("four_bar", Start(0.3, 1.0), 0.2, torque=torque)


@pytest.mark.parametrize("method", ["at", "moments"])
def test_a_simulation_refuses_times_in_several_dimensions(method):
    simulation = sk.simulate("four_bar", Start(0.3, 1.0), 0.2, engine="numpy")
    with pytest.raises(SolveError, match="one-dimensional array of times"):
        getattr(simulation, method)([[0.0, 0.1], [0.1, 0.2]])


@pytest.mark.slow
def test_a_short_pulse_between_two_times_moves_a_reduced_model(four_bar):
    """The times of the table are kinks. The motion is that of `simulate`."""
    times = (0.0, 1.0, 1.0005, 1.001, 3.0)
    pulse = sk.TorqueTable("pulse", "21", times, (0.0, 0.0, 500.0, 0.0, 0.0))
    mechanism = replace(four_bar, loads=(pulse,))
    model = sk.reduced_model(mechanism, poles=())
    reduced = sk.simulate_reduced(model, [0.0, 2.0], 0.3, 0.0)
    history = simulate(mechanism, Start(0.3, 0.0), 2.0, tolerance=1e-11).at([2.0])
    assert reduced.q[1] == pytest.approx(history.q[0], abs=1e-8)
