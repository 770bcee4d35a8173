"""The compiled engine against NumPy, closed forms and each other."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from helpers.engines import ENGINES, needs_heyoka
from helpers.refusals import TABLES, check_call
from mechanism_examples.named_mechanisms import four_bar
from oracles.newton_euler import random_mass, with_masses_and_loads

import spherekit as sk
from spherekit.dynamics.compiled_equation import compile_equation
from spherekit.dynamics.simulation_start import PoseStart
from spherekit.errors import EngineError, SolveError
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.mechanism.cache import MechanismCache
from spherekit.mechanism.elements import Input, Pair, PoseGeometry, Profile
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.mechanism.mechanism import Mass, Mechanism
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.symbolic.expression_function import expression_function
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

MECHANISMS = "four_bar", "stephenson", "double_butterfly", "roller_cam", "flat_cam"
MECHANISMS += "bevel_pair", "planetary_bevel"
COEFFICIENTS = ["velocity_coefficient", "acceleration_coefficient"]


def with_masses(mechanism):
    """Return a mechanism whose links have arbitrary physical tensors."""
    random = np.random.default_rng(3)
    masses = tuple(random_mass(random, link) for link in mechanism.links[1:])
    return replace(mechanism, masses=masses, loads=())


def reference(mechanism, motion):
    """Return the poles of a motion and B, dB/dq, all by the NumPy route."""
    every = all_poles(len(mechanism.links))
    field = evaluate(motion, request(mechanism, mechanism.inputs[0].pair, every, every))
    inertia, change = np.zeros(len(motion)), np.zeros(len(motion))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn = motion.rotations[:, link]
        tensor = turn @ np.array(mass.tensor) @ np.swapaxes(turn, 1, 2)
        moment = np.einsum("nij,nj->ni", tensor, field.w[link])
        inertia += np.sum(field.w[link] * moment, axis=1)
        change += 2.0 * np.sum(field.dw[link] * moment, axis=1)
    return field, inertia, change


def agree(values, field, inertia, change, tolerance):
    for pole, unit in field.direction.items():
        rate, second = (getattr(field, name)[pole] for name in COEFFICIENTS)
        own = values["velocity_coefficient"][pole]
        known = np.abs(rate) > 1e-6
        gap = values["direction"][pole] * own[:, None] - unit * rate[:, None]
        # The plan's own bound: long chains of intersections multiply rounding.
        allowed = tolerance + 40.0 * np.nan_to_num(field.direction_error[pole])
        gap = np.max(np.abs(gap), axis=1)
        assert np.all((gap < allowed * (1.0 + np.abs(rate)))[known]), pole
        gap = values["acceleration_coefficient"][pole] * np.sign(own * rate) - second
        scale = 1.0 + np.abs(rate) + np.abs(second)
        assert np.all((np.abs(gap) < allowed * scale)[known]), pole
    assert np.max(np.abs(values["B"] - inertia) / inertia) < tolerance
    assert np.max(np.abs(values["dB_dq"] - change) / inertia) < 40 * tolerance


def expression_values(mechanism, configurations, closed_form, engine):
    """Return poles, coefficients, B and dB/dq by expressions, at (k, n) configurations.

    Configurations are all variables, or in closed form the input and the signs of dyads.
    """
    pair, links = mechanism.inputs[0].pair, mechanism.links
    terms = DesignExpressions(mechanism, [pair], closed_form=closed_form)
    outputs = {name: [terms.quantity(name)] for name in ("B", "dB_dq")}
    for i, j in all_poles(len(links)):
        ends = f"{links[j]}_{links[i]}"
        outputs["direction", (i, j)] = [terms.quantity(f"pole_{ends}_{k}") for k in "xyz"]
        for name in COEFFICIENTS:
            outputs[name, (i, j)] = [terms.quantity(f"{name}_{ends}")]
    inputs = (
        [*terms.sample_symbols[:1], *terms.configuration_symbols]
        if closed_form
        else terms.configuration_symbols
    )
    columns = [column for items in outputs.values() for column in items]
    rows = iter(expression_function(columns, inputs, engine == "compiled")(configurations))
    values = {"direction": {}} | {name: {} for name in COEFFICIENTS}
    for key, items in outputs.items():
        part = np.array([next(rows) for _ in items]).T
        if isinstance(key, tuple):
            values[key[0]][key[1]] = part if len(items) > 1 else part[:, 0]
        else:
            values[key] = part[:, 0]
    return values


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", MECHANISMS)
def test_expressions_equal_the_plan(name, engine):
    made = with_masses(load(name))
    tracer = PositionAnalysis(made, search=False)
    motion = tracer.at(np.linspace(tracer.range[0] + 0.1, tracer.range[1] - 0.2, 24))
    assert not np.any(motion.failed)
    values = expression_values(made, motion.values.T, False, engine)
    agree(values, *reference(made, motion), 2e-14)


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "watt", "eight_bar_01"])
def test_closed_form_positions_equal_the_plan(name, engine):
    made = with_masses(load(name))
    tracer = PositionAnalysis(made)
    q = np.linspace(tracer.range[0] + 0.1, tracer.range[1] - 0.2, 24)
    for assembly_mode in tracer.assembly_modes:
        motion = PositionAnalysis(made, assembly_mode=assembly_mode.number).at(q)
        signs = [np.full(len(q), float(sign)) for sign in assembly_mode.signs]
        values = expression_values(made, np.vstack([q, *signs]), True, engine)
        agree(values, *reference(made, motion), 2e-14)


@pytest.mark.parametrize("engine", ENGINES)
def test_positions_beyond_reach_are_nan(engine):
    made = with_masses(rocker())
    rows = np.array([[0.0, 2.0], [1.0, 1.0]])
    values = expression_values(made, rows, True, engine)
    rates = [values["B"], values["dB_dq"], *values["velocity_coefficient"].values()]
    assert all(np.isnan(rate[0]) and np.isfinite(rate[1]) for rate in rates)


DRIVING = "10*sin(2*t)"


def start_of(mechanism, q, assembly_mode=0):
    """Return a configuration (variables,) at an input."""
    return PositionAnalysis(mechanism).at(np.array([q])).values[assembly_mode]


def with_torque(mechanism, pair, torque):
    """Return a mechanism with this as its only load."""
    return replace(mechanism, loads=(sk.PairTorque("only", pair, torque),))


run = partial(sk.simulate, engine="compiled")


def with_all_loads(name):
    """Return a shipped mechanism with masses and loads of every kind."""
    made, pair = with_masses_and_loads(name, np.random.default_rng(3))
    twist = sk.Moment("twist", made.links[-1], ("0.3*t", "-1", f"theta_{pair}"), "ground")
    table = sk.TorqueTable("table", pair, (0.0, 0.4, 0.5), (3.0, -1.0, 3.0), True)
    return replace(made, loads=(*made.loads, twist, table))


def case_of(name):
    """Return a mechanism, its start, and what else a simulation is given."""
    if name == "paper":
        return load("four_bar"), Start(0.3, 1.0), {"torque": DRIVING}
    if name == "rocker":
        made = with_torque(rocker(), "41", "-5*sin(theta_41)")
        return made, PoseStart(start_of(made, 2.0), "41", 3.0), {}
    if name != "stephenson":
        return with_all_loads(name), Start(0.5, 1.0), {}
    made = with_masses(load(name))
    coil = sk.Spring("coil", made.pairs[-1].name, 2.0, 0.4)
    hung = replace(made, loads=(sk.Gravity("weight", (0.0, 0.0, -9.81)), coil))
    return hung, Start(0.5, 1.0), {}


CASES = "paper", "stephenson", "rocker", "four_bar", "roller_cam", "planetary_bevel"


@pytest.mark.many
@needs_heyoka
@pytest.mark.parametrize("case", CASES)
def test_both_engines_find_the_same_motion(case):
    made, start, options = case_of(case)
    one, other = (
        sk.simulate(made, start, 2.0, engine=engine, tolerance=1e-11, **options)
        for engine in ("compiled", "numpy")
    )
    assert (one.engine.name, one.engine.reason) == ("compiled", "it was asked for")
    assert other.engine.name == "numpy" and one.end == other.end
    for a, b in zip(one.events, other.events, strict=True):
        assert (a.kind, a.pair) == (b.kind, b.pair) and abs(a.t - b.t) < 1e-8
    times = np.linspace(0.0, 2.0, 31)
    a, b = one.at(times), other.at(times)
    names = "q", "values", "dq", "value_rates", "ddq", "speed", "Q", "kinetic", "work"
    for name in names:
        size = 1.0 + np.max(np.abs(getattr(b, name)), initial=0.0)
        gap = np.max(np.abs(getattr(a, name) - getattr(b, name)), initial=0.0)
        assert gap < 2e-10 * size, name
    for each in (one, other):
        assert each.checks.energy < 1e-10 * each.checks.energy_scale
        assert each.checks.closure < 1e-10


def kite(*arcs):
    """Return a change-point four-bar: at q = 0 or pi it can be flat."""
    return replace(four_bar(np.radians(arcs)), loads=())


@pytest.mark.many
@needs_heyoka
@pytest.mark.parametrize("arcs", [(60, 40, 60, 40), (60, 50, 70, 40)])
@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_a_change_point_ends_both_engines_at_any_tolerance(arcs, assembly_mode):
    made = kite(*arcs)
    given = made, Start(1.0, 1.3), 5.0
    ends = [
        sk.simulate(*given, assembly_mode=assembly_mode, engine=engine, tolerance=reached)
        for engine, reached in (("compiled", 1e-3), ("compiled", 1e-13), ("numpy", 1e-5))
    ]
    for found in ends:
        assert found.end.kind == "singularity" and "cross" in found.end.message
        assert abs(found.at([found.end.t]).q[0] - np.pi) < 0.01
    assert abs(ends[0].at([ends[0].end.t]).q[0] - np.pi) < 1e-4
    assert abs(ends[0].end.t - ends[1].end.t) < 1e-6


@needs_heyoka
def test_friction_that_sticks_ends_the_motion_where_it_rests():
    made = with_torque(load("four_bar"), "21", "-3*sign(dtheta_21)")
    found = run(made, Start(0.3, 0.5), 50.0)
    assert found.end.kind == "sticking" and "turn back at once" in found.end.message
    ends = found.at([0.0, found.end.t])
    assert abs(3.0 * np.diff(ends.q)[0] - ends.kinetic[0]) < 1e-12
    kicked = run(made, Start(0.3, 0.0), 1.0, torque="-4")
    pulled = run(with_torque(made, "21", "-1"), Start(0.3, 0.0), 1.0)
    assert np.max(np.abs(kicked.at([0.5, 1.0]).q - pulled.at([0.5, 1.0]).q)) < 1e-13


def rocker():
    """Return a four-bar none of whose grounded links turns fully."""
    return kite(60.0, 55.0, 70.0, 40.0)


@needs_heyoka
def test_a_rocker_swings_over_its_dead_centre_1000_times():
    made = with_torque(rocker(), "41", "-5*sin(theta_41)")
    found = run(made, PoseStart(start_of(made, 2.0), "41", 5.0), 400.0, tolerance=1e-15)
    dead = [each for each in found.events if each.kind == "dead_centre"]
    assert len(dead) > 1000
    # At a dead centre links 3 and 4 are one arc of 70 - 40 or 70 + 40 degrees.
    c, s = np.cos(np.deg2rad([60.0, 55.0])), np.sin(np.deg2rad([60.0, 55.0]))
    limits = (np.cos(np.deg2rad([30.0, 110.0])) - c[0] * c[1]) / (s[0] * s[1])
    reached = np.array([each.q for each in dead])
    gaps = np.abs(reached[:, None] - np.arccos(limits))
    assert np.max(np.min(gaps, axis=1)) < 1e-12 and np.all(np.min(gaps, axis=0) < 1e-12)
    history = found.at(np.linspace(0.0, 400.0, 201))
    angle = history.values[:, made.variable_names.index("theta_41")]
    energy = history.kinetic - 5.0 * np.cos(angle)
    assert np.max(np.abs(energy - energy[0])) / history.kinetic.max() < 1e-12


@pytest.mark.parametrize("engine", ENGINES)
def test_a_stop_beyond_a_turn_ends_the_motion_where_it_is(engine):
    free = replace(load("four_bar"), loads=())
    made, further = (
        replace(free, joint_limits=(JointLimit("21", -1.0, stop),)) for stop in (9.0, 9.5)
    )
    for rate, stop in ((1.0, 9.0), (-1.0, -1.0)):
        found = sk.simulate(made, Start(0.3, rate), 60.0, engine=engine)
        assert found.end.message == f"pair 21 reached its joint limit at {stop:g} rad"
        assert found.end.kind == "joint_limit"
        assert abs(found.at([found.end.t]).q[0] - stop) < 1e-10
        with pytest.raises(SolveError, match="reached its joint limit"):
            found.at([59.0])
        on = sk.simulate(further, Start(0.3, rate), 60.0, engine=engine)
        t = np.linspace(0.0, found.end.t, 11)
        assert np.max(np.abs(found.at(t).q - on.at(t).q)) < 1e-9
        assert on.engine.compile_seconds == 0.0
    with pytest.raises(SolveError, match="outside its joint limits"):
        sk.simulate(made, Start(9.2, 1.0), 10.0, engine=engine)
    made = replace(free, joint_limits=(JointLimit("21", 0.3, 2.0),))
    left, stayed = (sk.simulate(made, Start(0.3, x), 5.0, engine=engine) for x in (1, -1))
    assert left.end.message.endswith("2 rad")
    assert (stayed.end.kind, stayed.end.t) == ("joint_limit", 0.0)
    assert [each.kind for each in stayed.events] == ["joint_limit"]
    assert stayed.at([0.0]).q[0] == 0.3


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("text", ["sqrt(1 - t)", "1/(1 - t)**2"])
def test_a_load_beyond_its_domain_or_bounds_ends_the_motion(text, engine):
    made = with_torque(load("four_bar"), "21", text)
    found = sk.simulate(made, Start(0.3, 1.0), 2.0, tolerance=1e-7, engine=engine)
    assert found.end.kind == "too_fast"
    assert "/" not in text or "smooth it" in found.end.message
    assert (0.9 if "/" in text else 1.0 - 1e-6) < found.end.t <= 1.0 + 1e-6
    assert np.isfinite(found.at([found.end.t]).q[0])


def geared_five_bar():
    """Return a five-bar whose cranks carry equal wheels in mesh: an equation too many."""
    ends = {"left": "ga", "right": "gb", "ac": "ac", "cd": "cd", "bd": "bd"}
    axes = np.array([[0, 0, 1], [0.846889512904878, 0, 0.531768890526456]])
    axes = np.vstack([axes, [[-42, -78, 46], [-75, 62, -24], [55, 36, -75]]])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    half = 0.5 * np.arctan2(axes[1, 0], axes[1, 2])
    wheels = tuple(Profile("circle", tuple(axis), half) for axis in axes[:2])
    pairs = [Pair(name, "R", tuple(links)) for name, links in ends.items()]
    posed = PoseGeometry(dict(zip(ends, map(tuple, axes), strict=True)))
    inputs = (Input("left", -2.0 * np.pi, 2.0 * np.pi),)
    pairs = (*pairs, Pair("mesh", "Cr", ("a", "b"), wheels))
    tensor = tuple(map(tuple, np.diag([2e-2, 1e-2, 2e-2]).tolist()))
    masses = tuple(Mass(link, tensor) for link in "abcd")
    return Mechanism("geared", "g", tuple("gabcd"), pairs, posed, inputs, masses=masses)


@pytest.mark.slow
@needs_heyoka
def test_chosen_equations_that_come_to_depend_on_each_other_are_no_crossing(monkeypatch):
    """Of a loop too many the equations chosen at one pose are dependent at another.

    With both cranks held by the wheels the outer three links are held as long as their
    three axes are not plane: the compiled engine may not end in a crossing of curves there.
    It is so where nothing is known of the wheels, and all is one group.
    """
    held = "spherekit.planning.assembly_plan.find_carried_contacts"
    monkeypatch.setattr(held, lambda mechanism: frozenset())
    made = geared_five_bar()
    driving = {"torque": "0.1*sin(2*t)"}
    start, until = Start(1.117, 0.4), 1.5
    reference = sk.simulate(made, start, until, engine="numpy", **driving)
    assert reference.end.kind == "time"
    t = np.linspace(0.0, until, 61)
    motion = PositionAnalysis(made, samples=3, search=False).given(reference.at(t).values)
    assert np.min(np.abs(np.linalg.det(motion.axes[:, 2:5]))) > 0.1
    with pytest.raises(EngineError, match=r"redundant equations.*use NumPy's"):
        sk.simulate(made, start, until, engine="compiled", **driving)
    found = sk.simulate(made, start, until, tolerance=1e-9, **driving)
    assert found.end.kind == "time" and "use NumPy" not in found.engine.reason
    assert np.max(np.abs(found.at(t).values - reference.at(t).values)) < 1e-8


@needs_heyoka
@pytest.mark.slow
def test_both_engines_move_a_loop_too_many_whose_wheels_are_known():
    """The same mechanism, with the wheels known to hold the cranks."""
    made = geared_five_bar()
    lighter = replace(made, masses=made.masses[:3])
    start, until = Start(1.117, 0.4), 1.5
    t = np.linspace(0.0, until, 61)
    one, other = (
        sk.simulate(lighter, start, until, engine=name, torque="0.1*sin(2*t)")
        for name in ("numpy", "compiled")
    )
    assert other.end.kind == "time"
    assert np.max(np.abs(one.at(t).values - other.at(t).values)) < 1e-8


@needs_heyoka
def test_another_torque_table_needs_no_compiling():
    made = replace(load("four_bar"), masses=load("four_bar").masses[:1])
    masses = (Mass("2", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.5))),)
    tables = ((0.0, 1.0, 3.0), (0.0, 2.0, -2.0)), ((0.0, 3.0), (1.0, 4.0))
    for k, rows in enumerate(tables):
        table = sk.TorqueTable("table", "21", *rows)
        found = run(replace(made, masses=masses, loads=(table,)), Start(0.1, 0.0), 3.0)
        # A link of constant inertia about its fixed axis: the table integrated twice.
        nodes, at, (q, rate) = rows[0], table.at(np.array(rows[0])), (0.1, 0.0)
        for h, one, other in zip(np.diff(nodes), at, at[1:], strict=False):
            q += rate * h + (2.0 * one + other) * h**2 / 6.0 / 0.5
            rate += 0.5 * (one + other) * h / 0.5
        assert found.at([3.0]).q[0] == pytest.approx(q, abs=1e-10)
        assert (found.engine.compile_seconds == 0.0) == (k == 1)


@needs_heyoka
def test_what_was_compiled_is_kept():
    made = load("four_bar")
    engines = ("compiled", "auto")
    given = made, Start(0.3, 1.0), 0.1
    again = [sk.simulate(*given, torque="-1*t", engine=each).engine for each in engines]
    assert [each.name for each in again] == ["compiled", "compiled"]
    assert again[0].compile_seconds > 0.0 == again[1].compile_seconds
    assert again[1].reason == "it was compiled before"


@pytest.mark.slow
@needs_heyoka
def test_a_short_run_is_not_compiled_and_a_long_one_is():
    heavy = with_masses(load("double_butterfly"))
    pose = PoseStart(start_of(heavy, 0.5), heavy.inputs[0].pair, 1.0)
    found = sk.simulate(heavy, pose, 1e-3)
    assert found.engine.name == "numpy"
    assert found.engine.forecast["numpy"] < found.engine.forecast["compiled"]
    found = sk.simulate(load("four_bar"), Start(0.3, 1.0), 500.0, torque="0.2*sin(t)")
    assert found.engine.name == "compiled"
    forecast = found.engine.forecast
    assert forecast["compiled"] < forecast["numpy"]
    assert found.engine.reason.startswith("expected NumPy ")
    kinked = sk.simulate(load("four_bar"), Start(0.3, 1.0), 1e-3, torque="abs(t) - 1")
    assert (kinked.engine.name, kinked.engine.forecast) == ("compiled", None)
    assert "kinks" in kinked.engine.reason


@needs_heyoka
def test_two_threads_may_use_one_compiled_equation_and_compile_it_once():
    made = with_torque(load("four_bar"), "21", "0.125*cos(t)")
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda _: compile_equation(made, 1e-9), range(2)))
    assert found[0][0] is found[1][0]
    assert sorted(known for _, known in found) == [False, True]
    made = load("four_bar")
    starts = [Start(0.3, rate) for rate in (1.0, -1.0, 2.0, 0.5)]

    def rows(start):
        found = run(made, start, 20.0, torque="sin(3*t)")
        return found.at(np.linspace(0.0, 20.0, 60)).values, found.events

    alone = [rows(start) for start in starts]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(rows, starts * 3))
    for (one, events), (other, same) in zip(alone * 3, together, strict=True):
        assert np.array_equal(one, other)
        assert events == same


def test_without_heyoka_numpy_runs_and_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "heyoka", None)
    made = load("four_bar")
    found = sk.simulate(made, Start(0.3, 1.0), 0.2, torque="0.5 - t")
    assert found.engine.name == "numpy" and "pip install" in found.engine.reason
    assert "NumPy engine" not in found.engine.reason  # it is what ran
    with pytest.raises(EngineError, match=r"spherekit-mechanisms\[compiled\].*NumPy"):
        run(made, Start(0.3, 1.0), 0.2, torque="0.5 - t")


MADE = load("four_bar")


@needs_heyoka
@pytest.mark.parametrize("call", TABLES["engines"])
def test_bad_input_is_refused_before_any_integration(call):
    check_call(call, globals(), TABLES["engines"][call])


def test_a_cache_with_a_limit_forgets_what_was_wanted_longest_ago():
    kept, made = MechanismCache(max_results=2), []

    def get(name):
        kept.get(load("four_bar"), name, lambda: made.append(name))

    for name in ("a", "b", "a", "c", "a", "b"):
        get(name)
    assert made == ["a", "b", "c", "b"]
    assert kept.has(load("four_bar"), "a") and not kept.has(load("four_bar"), "c")
    assert not kept.has(load("watt"), "a")
