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


FLAT = np.radians([60.0, 40.0, 60.0, 40.0])
FLAT_ONE = replace(example_mechanisms.four_bar(FLAT), loads=())
TURN = np.linspace(0.0, 2.0 * np.pi, 121)
DRIVING = "10*sin(2*t)"


# --- the four-bar in 50 digits ------------------------------------------------------


@pytest.fixture(scope="module")
def exact():
    """Columns of all 121 samples for p = 0 and 1, derivatives by central differences.

    With 60 digits and a step of 1e-18 their error is about 1e-36.
    """
    columns = {}
    with mp.workdps(60):
        tensors = {int(m.link): m.tensor for m in sk.load("four_bar").masses}
        arcs = [mp.radians(angle) for angle in (60, 20, 70, 40)]

        def at(q, p):
            here = four_bar_at(arcs, q, p)
            return here.theta, *here.coefficients(), mp.fsum(here.inertia(tensors))

        h = mp.mpf(10) ** -18
        for p in (0, 1):
            rows = []
            for q in TURN:
                q = mp.mpf(float(q))
                theta, u31, w31, w41, B = at(q, p)
                low, high = (at(q + k * h, p) for k in (-1, 1))
                d31, d41, dB = ((high[k] - low[k]) / (2 * h) for k in (2, 3, 4))
                loads = (-mp.sin(q) - 2, w41 * (-5 * mp.sin(theta) - 2 * w41))
                tau = dB / 2 - sum(loads)
                rows.append([theta, *u31, w31, w41, d31, d41, B, dB, *loads, tau])
            columns[p] = np.array(rows, dtype=float)
    return columns


@pytest.fixture(scope="module")
def four_bar():
    return sk.load("four_bar")


@pytest.fixture(scope="module")
def tabled(four_bar):
    return sk.run(four_bar, ["poles:only=31+41", Eksergian()], samples=121)


def rows_of(frame, assembly_mode, **chosen):
    for name, value in chosen.items():
        frame = frame[frame[name] == value]
    return frame[frame["assembly_mode"] == assembly_mode]


def mode_of(exact, theta41):
    """Return the p of eq. (25) that has this theta41 at the first sample."""
    return int(abs(np.sin(0.5 * (exact[1][0, 0] - theta41))) < 1e-9)


@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_tables_1_and_2_of_the_source(tabled, exact, assembly_mode):
    found = rows_of(tabled.frame("eksergian"), assembly_mode)
    motion = rows_of(tabled.frame("motion"), assembly_mode)
    theta = motion["theta_41"].to_numpy()
    want = exact[mode_of(exact, theta[0])].T
    assert np.max(np.abs(np.sin(0.5 * (theta - want[0])))) < 1e-12
    poles = tabled.frame("poles")
    w31, w41 = (rows_of(poles, assembly_mode, link=link) for link in ("3", "4"))
    u31 = w31[["ux", "uy", "uz"]].to_numpy()
    side = np.sign(np.sum(u31 * want[1:4].T, axis=1))
    assert np.max(np.abs(u31 * side[:, None] - want[1:4].T)) < 1e-12
    for name, k in (("velocity_coefficient", 4), ("acceleration_coefficient", 6)):
        assert np.max(np.abs(w31[name].to_numpy() * side - want[k])) < 1e-12
        assert np.max(np.abs(w41[name].to_numpy() - want[k + 1])) < 1e-12
    assert np.max(np.abs(found["B"].to_numpy() - want[8])) < 1e-12
    assert np.max(np.abs(found["dB_dq"].to_numpy() - want[9])) < 1e-12
    assert np.max(np.abs(found["Q"].to_numpy() - want[10] - want[11])) < 1e-12
    assert np.max(np.abs(found["tau"].to_numpy() - want[12])) < 1e-12
    loads = rows_of(tabled.frame("eksergian", "loads"), assembly_mode)
    for name, k in (("on_crank", 10), ("on_rocker", 11)):
        own = loads[loads["load"] == name]
        assert np.max(np.abs(own["Q"].to_numpy() - want[k])) < 1e-12
    parts = rows_of(tabled.frame("eksergian", "inertia"), assembly_mode)
    summed = parts.groupby("sample")["B"].sum().to_numpy()
    assert np.max(np.abs(summed - want[8])) < 1e-12


def test_torque_at_another_pair_does_the_same_work(four_bar):
    found = sk.inverse_dynamics(four_bar, ConstantSpeed(2.0), np.linspace(0.1, 3.0, 30))
    (number,) = four_bar.variables_of(four_bar.pair_number["41"])
    power = found.torque_at("41") * found.pair_rates[:, number] * found.dq
    np.testing.assert_allclose(power, found.tau * found.dq, rtol=1e-12)


# --- motion from torque ----------------------------------------------------------------


@pytest.mark.slow
def test_a_stored_model_gives_the_same_motion(four_bar):
    t = np.linspace(0.0, 10.0, 101)
    exactly = simulate(four_bar, Start(0.3, 1.0), 10.0, torque=DRIVING, tolerance=1e-11)
    bare = sk.reduced_model(four_bar, poles=())
    model = bare.with_torque(DRIVING)
    assert model.heading.by == ("q",)
    for tolerance in (1e-7, 1e-9):
        found = sk.simulate_reduced(model, t, 0.3, 1.0, tolerance)
        assert np.max(np.abs(found.q - exactly.at(t).q)) < tolerance
        assert np.max(np.abs(found.values - exactly.at(t).values)) < 10 * tolerance
        assert found.energy < 10 * tolerance and found.message == ""


def test_a_stored_model_ends_with_its_curve_and_knows_all_loads(tmp_path):
    mechanism, joint = with_masses_and_loads("four_bar", np.random.default_rng(8))
    table = sk.TorqueTable("motor_table", joint, (0.0, 0.4, 0.5), (3.0, -1.0, 3.0), True)
    mechanism = replace(
        mechanism,
        loads=(*mechanism.loads, table),
        joint_limits=(JointLimit("21", -2.0, 1.5),),
    )
    exactly = simulate(mechanism, Start(0.3, 4.0), 2.0, tolerance=1e-11)
    assert exactly.end.kind == "joint_limit"
    sk.reduced_model(mechanism, poles=()).save(tmp_path / "loads.npz")
    model = sk.load_reduced(tmp_path / "loads.npz")
    assert (model.heading.by, model.heading.periodic) == (("s",), False)
    (s,) = model.places("theta_21", 0.3 + 2.0 * np.pi)
    speed = 4.0 / model.value("d(theta_21)/ds", s)
    t = np.linspace(0.0, 2.0, 81)
    found = sk.simulate_reduced(model, t, s, speed)
    before = t < exactly.end.t
    assert np.max(np.abs(found.q[before] - exactly.at(t[before]).q)) < 1e-8
    assert np.all(np.isnan(found.q[t > exactly.end.t + 0.1]))
    assert "the curve ends" in found.message


def differences_of_the_source(mechanism, start, until, torque, step):
    """Return q at equal time steps by the finite differences of Di Gregorio (2024).

    With D the step, q_1 = q_0 + q'_0 D, and by eqs. (30) and (31)
    q_{i+1} = (D^2 Q - 1/2 dB/dq (q_i - q_{i-1})^2) / B + 2 q_i - q_{i-1}. The generalised
    inertia B is that of the closed forms of the source, in mode p = 1 of its eq. (25).
    """
    arcs = [mp.radians(angle) for angle in (60, 20, 70, 40)]
    tensors = {int(mass.link): mass.tensor for mass in mechanism.masses}

    def inertia(q):
        return mp.fsum(four_bar_at(arcs, q, 1).inertia(tensors))

    with mp.workdps(30):
        h = mp.mpf(10) ** -10
        q, change = [mp.mpf(start.q)], mp.mpf(start.dq) * step
        for number in range(round(until / step)):
            if number:
                slope = (inertia(q[-1] + h) - inertia(q[-1] - h)) / (2 * h)
                force = torque(number * step)
                change += (step**2 * force - slope * change**2 / 2) / inertia(q[-1])
            q.append(q[-1] + change)
    return np.array(q, dtype=float)


@pytest.mark.slow
def test_the_differences_of_the_source_tend_to_the_motion_found(four_bar):
    free, start = replace(four_bar, loads=()), Start(0.3, 1.0)
    exactly = simulate(free, start, 0.5, torque=DRIVING, tolerance=1e-11)
    errors = []
    for steps in (50, 100, 200):
        q = differences_of_the_source(
            free, start, 0.5, lambda t: 10.0 * np.sin(2.0 * t), 0.5 / steps
        )
        t = np.linspace(0.0, 0.5, steps + 1)
        errors.append(np.max(np.abs(q - exactly.at(t).q)))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 1.8) & (ratios < 2.2)), errors
    assert errors[-1] < 1e-3


@pytest.mark.slow
def test_a_rocker_is_driven_over_its_dead_centres_and_starts_on_none(four_bar):
    free = replace(four_bar, loads=())
    crank = simulate(free, Start(0.3, 3.0), 5.0, tolerance=1e-11)
    rocker, t = free.angles["41"], np.linspace(0.0, 5.0, 101)
    begin, way = crank.at([0.0]), {"input_pair": "41", "tolerance": 1e-11}
    rate = float(begin.value_rates[0, rocker])
    swung = simulate(free, PoseStart(begin.values[0], "41", rate), 5.0, **way)
    assert np.max(np.abs(swung.at(t).values - crank.at(t).values)) < 1e-8
    dead = [event for event in swung.events if event.kind == "dead_centre"]
    turns = (crank.at([5.0]).q[0] - 0.3) / (2.0 * np.pi)
    assert abs(len(dead) - 2.0 * turns) <= 2.0
    assert not [event for event in crank.events if event.kind == "dead_centre"]
    there = swung.at([event.t for event in dead])
    assert np.max(np.abs(there.dq)) < 1e-7
    with pytest.raises(SolveError, match="dead centre"):
        simulate(free, PoseStart(there.values[0], "41", 1.0), 1.0, input_pair="41")
    start = PoseStart(there.values[0], "21", float(there.value_rates[0, 0]))
    again = simulate(free, start, 5.0 - dead[0].t, input_pair="41")
    last = again.at([5.0 - dead[0].t]).values[0]
    assert np.max(np.abs(last - swung.at([5.0]).values[0])) < 1e-7


def test_steps_begin_anew_where_a_torque_table_has_kinks(four_bar):
    table = sk.TorqueTable("motor", "21", (0.0, 0.4, 0.5), (3.0, -1.0, 3.0), True)
    switched = replace(four_bar, loads=(*four_bar.loads, table))
    found = simulate(switched, Start(0.3, 1.0), 1.2, tolerance=1e-10, check=True)
    times = [event.t for event in found.events if event.kind == "switch"]
    np.testing.assert_allclose(times, [0.4, 0.5, 0.9, 1.0], atol=1e-12)
    assert found.checks.error < 1e-9 and found.checks.energy < 1e-10


@pytest.mark.slow
def test_a_contact_that_runs_off_its_profile_ends_with_the_reason():
    tensor = (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.15)
    opened = replace(example_mechanisms.open_cam(), masses=(Mass("2", tensor),))
    reached = sk.inverse_dynamics(
        opened, ConstantSpeed(1.0), TURN[::2], assembly_mode=0, search=False
    )
    first = reached.values[reached.status == sk.Status.OK][0]
    last = reached.q[reached.status == sk.Status.OK][-1]
    start = PoseStart(first, "12", 2.0)
    found = forward_dynamics.simulate(opened, start, 20.0, tolerance=1e-7)
    assert found.end.kind == "off_profile" and found.engine.name == "numpy"
    assert "points" in found.engine.reason
    history = found.at(np.linspace(0.0, found.end.t, 9))
    assert history.q[-1] > last - 0.01 and np.ptp(history.kinetic) < 1e-7


@pytest.mark.slow
def test_a_crossing_of_curves_is_passed_where_that_is_asked():
    """A parallelogram that flattens may go on as one or as an antiparallelogram."""
    flat = FLAT_ONE
    found = simulate(flat, Start(1.0, -1.0), 5.0)
    assert found.end.kind == "singularity"
    on = forward_dynamics.simulate(
        flat, Start(1.0, -1.0), 2.0 * found.end.t, crossings="pass"
    )
    assert on.end.kind == "time" and on.checks.energy < 1e-12
    assert [event.kind for event in on.events if event.kind == "crossing"] == ["crossing"]
    # Of arcs alike in pairs one product or ratio of half tangents stays the same.
    moved = on.at(np.linspace(0.0, on.end.t, 12)).values[:, [0, 3]]
    crank, rocker = np.tan(0.5 * moved).T
    assert moved[0, 0] * moved[-1, 0] < 0.0
    assert min(np.ptp(crank / rocker), np.ptp(crank * rocker)) < 1e-8
    times = {"start": Start(1.0, -1.0), "duration": on.end.t, "samples": 12}
    table = sk.run(flat, "poles", crossings="pass", **times).frame("motion")
    assert table["theta_21"].to_numpy() == pytest.approx(moved[:, 0], abs=1e-9)


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("off", "end"), [(1e-12, "singularity"), (1e-9, "time")])
def test_both_engines_tell_curves_that_avoid_each_other_from_crossing_ones(
    engine, off, end
):
    """A parallelogram off by d misses the flat one by about the root of d.

    What passes it is still on the configuration curve that it started on, and without
    loads it keeps its energy.
    """
    flat = replace(example_mechanisms.four_bar(FLAT + [0.0, 0.0, off, 0.0]), loads=())
    found = forward_dynamics.simulate(
        flat, Start(1.0, -1.0), 4.0, tolerance=1e-7, engine=engine
    )
    assert found.end.kind == end
    if end == "time":
        history = found.at(np.linspace(0.0, found.end.t, 25))
        curves = [each.curve for each in PositionAnalysis(flat).configurations.curves]
        assert any(np.all(np.isfinite(curve.find(history.values))) for curve in curves)
        assert np.ptp(history.kinetic) < 1e-7 * np.max(history.kinetic)
    if engine == "numpy":
        on = forward_dynamics.simulate(
            flat, Start(1.0, -1.0), 4.0, tolerance=1e-7, crossings="pass"
        )
        crossed = any(event.kind == "crossing" for event in on.events)
        assert on.end.kind == "time" and crossed == (end == "singularity")


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
def test_totals_of_no_parts_are_empty_in_rows_that_failed(four_bar, left_out):
    """A sum over no loads, or over no masses, is 0 where a row is OK and nowhere else."""
    made = replace(four_bar, loads=(Spring("spring", "43", 0.3),))
    made = replace(made, **{left_out: ()}).with_inputs("41")
    frame = sk.run(made, "eksergian", samples=40).frame()
    failed = (frame["status"] != "OK").to_numpy()
    solved = sk.inverse_dynamics(made, ConstantSpeed(1.0), np.linspace(0.0, 6.0, 40))
    assert np.any(failed) and not np.all(failed)
    for name in ("B", "dB_dq", "Q", "tau"):
        column = frame[name].to_numpy()
        assert np.all(np.isnan(column[failed])) and np.all(np.isfinite(column[~failed]))
        column, lost = getattr(solved, name), solved.status != sk.Status.OK
        assert np.all(np.isnan(column[lost])) and np.all(np.isfinite(column[~lost]))
