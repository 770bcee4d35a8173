"""The compiled engine against NumPy, closed forms and each other."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from helpers.engines import ENGINES, needs_heyoka
from helpers.refusals import TABLES, check_call
from mechanism_examples.named_mechanisms import four_bar, one_link_mechanism
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
from spherekit.number_text import degrees_text
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
    """Return a mechanism whose links have random, physically possible inertia tensors."""
    random = np.random.default_rng(3)
    masses = tuple(random_mass(random, link) for link in mechanism.links[1:])
    return replace(mechanism, masses=masses, loads=())


def evaluate_with_numpy(mechanism, motion):
    """Return poles, inertia at the input and its derivative of a motion, by NumPy.

    They are the reference for symbolic expressions. A pole is the axis of the relative
    rotation of two links. The inertia reduced to the input is B = sum over links of w^T J
    w, where w is the angular velocity of the link at unit input speed and J its inertia
    tensor in the ground frame. J turns with the link; the terms of dJ/dq vanish in the
    product with w. So dB/dq = sum of 2 (dw/dq)^T J w.

    Returns
    -------
    field
        Poles of each two links with their coefficients.
    inertia, inertia_rate
        (n,) B and its derivative dB/dq by the input, for each row of the motion.
    """
    # Directions and velocity coefficients of all pairs of links.
    poles = all_poles(len(mechanism.links))
    pole_request = request(mechanism, mechanism.inputs[0].pair, poles, rates=poles)
    field = evaluate(motion, pole_request)
    inertia = np.zeros(len(motion))
    inertia_rate = np.zeros(len(motion))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        rotation = motion.rotations[:, link]
        tensor = rotation @ np.array(mass.tensor) @ np.swapaxes(rotation, 1, 2)
        angular_momentum = np.einsum("nij,nj->ni", tensor, field.w[link])
        inertia += np.sum(field.w[link] * angular_momentum, axis=1)
        inertia_rate += 2.0 * np.sum(field.dw[link] * angular_momentum, axis=1)
    return field, inertia, inertia_rate


def assert_expressions_agree(values, field, inertia, inertia_rate, tolerance):
    """Assert that quantities by symbolic expressions equal those of `evaluate_with_numpy`.

    A pole is the axis of the relative rotation of two links. Its direction and its
    coefficients may all have the opposite sign. So the direction times the velocity
    coefficient is compared. The acceleration coefficient is compared after its sign is
    matched. Links that hardly move relative to each other have no pole direction.

    Parameters
    ----------
    values
        Quantities of `expression_values`: `B` is the inertia reduced to the input, and
        `dB_dq` is its derivative by the input.
    field, inertia, inertia_rate
        Results of `evaluate_with_numpy`.
    tolerance
        Largest error relative to 1 + size. Forty times the reported bound of a pole's
        direction is added. Poles are intersections of great circles through other poles,
        and long chains of them multiply rounding errors.
    """
    for pole, direction in field.direction.items():
        velocity = field.velocity_coefficient[pole]
        acceleration = field.acceleration_coefficient[pole]
        expression_velocity = values["velocity_coefficient"][pole]
        expression_direction = values["direction"][pole]
        moves = np.abs(velocity) > 1e-6  # otherwise there is no direction
        allowed = tolerance + 40.0 * np.nan_to_num(field.direction_error[pole])

        expression_vector = expression_direction * expression_velocity[:, None]
        gap = np.max(np.abs(expression_vector - direction * velocity[:, None]), axis=1)
        assert np.all((gap < allowed * (1.0 + np.abs(velocity)))[moves]), pole

        sign = np.sign(expression_velocity * velocity)
        expression_acceleration = values["acceleration_coefficient"][pole] * sign
        gap = np.abs(expression_acceleration - acceleration)
        scale = 1.0 + np.abs(velocity) + np.abs(acceleration)
        assert np.all((gap < allowed * scale)[moves]), pole
    assert np.max(np.abs(values["B"] - inertia) / inertia) < tolerance
    # Each term of dB/dq has a factor dw/dq, the derivative of an angular velocity. Where
    # this factor is large, it multiplies rounding errors.
    assert np.max(np.abs(values["dB_dq"] - inertia_rate) / inertia) < 40 * tolerance


def expression_values(mechanism, configurations, closed_form, engine):
    """Evaluate poles, coefficients, inertia B and dB/dq by symbolic expressions.

    A pole is the axis of the relative rotation of two links. Its coefficients are the rate
    of this rotation, and the derivative of the rate, by the input. The result is compared
    with `evaluate_with_numpy`.

    Parameters
    ----------
    mechanism
        Mechanism with masses and one input.
    configurations
        (k, n) configurations, one per column. Without closed form a column has all pair
        variables. In closed form a column has the input and the signs of the dyads (two
        links each), which distinguish the assembly modes.
    closed_form
        Whether the pair variables are expressions, too: of the input and the signs.
    engine
        `"compiled"` or `"numpy"`, which evaluates the expressions.

    Returns
    -------
    values
        `B` and `dB_dq` (n,); `direction` (n, 3) and both coefficients (n,) by pole.
    """
    pair = mechanism.inputs[0].pair
    links = mechanism.links
    terms = DesignExpressions(mechanism, [pair], closed_form=closed_form)
    # The expressions of each quantity; three for a direction, one for all others.
    outputs = {name: [terms.quantity(name)] for name in ("B", "dB_dq")}
    for i, j in all_poles(len(links)):
        link_names = f"{links[j]}_{links[i]}"
        outputs["direction", (i, j)] = [
            terms.quantity(f"pole_{link_names}_{component}") for component in "xyz"
        ]
        for name in COEFFICIENTS:
            outputs[name, (i, j)] = [terms.quantity(f"{name}_{link_names}")]
    # Arguments of the expressions. In closed form, the first symbol of a sample is the
    # angle of the input, and the configuration symbols are the signs. Otherwise the latter
    # are all pair variables, among them the input.
    if closed_form:
        inputs = [*terms.sample_symbols[:1], *terms.configuration_symbols]
    else:
        inputs = terms.configuration_symbols
    columns = [column for items in outputs.values() for column in items]
    function = expression_function(columns, inputs, engine == "compiled")
    rows = iter(function(configurations))

    values = {"direction": {}, "velocity_coefficient": {}, "acceleration_coefficient": {}}
    for key, items in outputs.items():
        quantity_values = np.array([next(rows) for _ in items]).T
        if len(items) == 1:
            quantity_values = quantity_values[:, 0]
        if isinstance(key, tuple):
            name, pole = key
            values[name][pole] = quantity_values
        else:
            values[key] = quantity_values
    return values


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", MECHANISMS)
def test_expressions_of_joint_angles_equal_numpy(name, engine):
    """Poles, coefficients and inertia by expressions equal those of the NumPy route.

    The positions are solved numerically before; both routes get the same joint angles.
    """
    mechanism = with_masses(load(name))
    position_analysis = PositionAnalysis(mechanism, search=False)
    start, stop = position_analysis.range
    motion = position_analysis.at(np.linspace(start + 0.1, stop - 0.2, 24))
    assert not np.any(motion.failed)
    values = expression_values(mechanism, motion.values.T, closed_form=False, engine=engine)
    expected = evaluate_with_numpy(mechanism, motion)
    assert_expressions_agree(values, *expected, tolerance=2e-14)


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "watt", "eight_bar_01"])
def test_expressions_in_closed_form_equal_numpy_in_every_mode(name, engine):
    """Symbolic expressions in closed form give the numbers of NumPy in every mode.

    The expressions depend on the input and the signs of the dyads (two links joined by a
    pair). Each assembly mode (way to assemble the links) has one sign per dyad.

    Two engines can evaluate the expressions: compiled code, and NumPy (`engine`). The
    reference is the usual evaluation of motion and inertia without expressions
    (`evaluate_with_numpy`).
    """
    mechanism = with_masses(load(name))
    position_analysis = PositionAnalysis(mechanism)
    # Inputs away from the ends of the range
    start, stop = position_analysis.range
    q = np.linspace(start + 0.1, stop - 0.2, 24)
    for assembly_mode in position_analysis.assembly_modes:
        motion = PositionAnalysis(mechanism, assembly_mode=assembly_mode.number).at(q)
        signs = [np.full(len(q), float(sign)) for sign in assembly_mode.signs]
        inputs_and_signs = np.vstack([q, *signs])
        values = expression_values(
            mechanism, inputs_and_signs, closed_form=True, engine=engine
        )
        expected = evaluate_with_numpy(mechanism, motion)
        assert_expressions_agree(values, *expected, tolerance=2e-14)


@pytest.mark.parametrize("engine", ENGINES)
def test_positions_beyond_reach_are_nan(engine):
    """In closed form, an input (rad) at which the loop cannot close gives NaN."""
    mechanism = with_masses(rocker())
    rows = np.array([[0.0, 2.0], [1.0, 1.0]])
    values = expression_values(mechanism, rows, closed_form=True, engine=engine)
    rates = [values["B"], values["dB_dq"], *values["velocity_coefficient"].values()]
    assert all(np.isnan(rate[0]) and np.isfinite(rate[1]) for rate in rates)


DRIVING_TORQUE = "10*sin(2*t)"


def configuration_at(mechanism, q, assembly_mode=0):
    """Return a configuration (variables,) of an assembly mode at an input angle (rad)."""
    return PositionAnalysis(mechanism).at(np.array([q])).values[assembly_mode]


def with_torque(mechanism, pair, torque):
    """Return a mechanism whose only load is this torque (an expression) at a pair."""
    return replace(mechanism, loads=(sk.PairTorque("only", pair, torque),))


run = partial(sk.simulate, engine="compiled")


def with_all_loads(name):
    """Return a shipped mechanism with masses and loads of every kind."""
    mechanism, pair = with_masses_and_loads(name, np.random.default_rng(3))
    twist = sk.Moment(
        "twist", mechanism.links[-1], ("0.3*t", "-1", f"theta_{pair}"), "ground"
    )
    table = sk.TorqueTable("table", pair, (0.0, 0.4, 0.5), (3.0, -1.0, 3.0), True)
    return replace(mechanism, loads=(*mechanism.loads, twist, table))


def simulation_case(name):
    """Return a mechanism, its start, and further arguments of its simulation.

    "paper" is the four-bar of a publication, driven by a torque over time. "rocker" is a
    four-bar that swings over dead centres of its input. "stephenson" has weight and a
    spring. All others are shipped mechanisms with loads of every kind.
    """
    if name == "paper":
        return load("four_bar"), Start(0.3, 1.0), {"torque": DRIVING_TORQUE}
    if name == "rocker":
        mechanism = with_torque(rocker(), "41", "-5*sin(theta_41)")
        return mechanism, PoseStart(configuration_at(mechanism, 2.0), "41", 3.0), {}
    if name == "stephenson":
        mechanism = with_masses(load(name))
        spring = sk.Spring("coil", mechanism.pairs[-1].name, 2.0, 0.4)
        loads = (sk.Gravity("weight", (0.0, 0.0, -9.81)), spring)
        return replace(mechanism, loads=loads), Start(0.5, 1.0), {}
    return with_all_loads(name), Start(0.5, 1.0), {}


CASES = "paper", "stephenson", "rocker", "four_bar", "roller_cam", "planetary_bevel"


@pytest.mark.many
@needs_heyoka
@pytest.mark.parametrize("case", CASES)
def test_both_engines_find_the_same_motion(case):
    """Simulations by the compiled engine (Taylor series) and by NumPy agree.

    Events and all quantities at 31 times are compared. The balance of energy is a check
    that needs no other engine: the kinetic energy must grow by the work of the loads.
    `simulation_case` has the mechanism, start and further arguments.
    """
    mechanism, start, options = simulation_case(case)
    compiled, numpy_result = (
        sk.simulate(mechanism, start, 2.0, engine=engine, tolerance=1e-11, **options)
        for engine in ("compiled", "numpy")
    )
    assert compiled.engine.name == "compiled"
    assert compiled.engine.reason == "it was requested"
    assert numpy_result.engine.name == "numpy"
    assert compiled.end == numpy_result.end
    for event, numpy_event in zip(compiled.events, numpy_result.events, strict=True):
        assert (event.kind, event.pair) == (numpy_event.kind, numpy_event.pair)
        assert abs(event.t - numpy_event.t) < 1e-8
    times = np.linspace(0.0, 2.0, 31)
    rows = compiled.at(times)
    numpy_rows = numpy_result.at(times)
    names = "q", "values", "dq", "value_rates", "ddq", "speed", "Q", "kinetic", "work"
    for name in names:
        expected = getattr(numpy_rows, name)
        size = 1.0 + np.max(np.abs(expected), initial=0.0)
        gap = np.max(np.abs(getattr(rows, name) - expected), initial=0.0)
        assert gap < 2e-10 * size, name
    for result in (compiled, numpy_result):
        assert result.checks.energy < 1e-10 * result.checks.energy_scale
        assert result.checks.closure < 1e-10


def load_free_four_bar(*arcs):
    """Return a four-bar without loads of ground, crank, coupler and rocker arcs (deg)."""
    return replace(four_bar(np.radians(arcs)), loads=())


@pytest.mark.many
@needs_heyoka
@pytest.mark.parametrize("arcs", [(60, 40, 60, 40), (60, 50, 70, 40)])
@pytest.mark.parametrize("assembly_mode", [0, 1])
def test_a_simulation_ends_where_curves_cross_at_any_tolerance(arcs, assembly_mode):
    """Both engines stop at a change point, where the motion is not determined.

    With these arcs (deg) the linkage is flat at q = pi, where the configuration curves of
    its two assembly modes cross. All simulations end within 0.01 rad of it. The compiled
    ones end within 1e-4 rad, whatever their tolerance.
    """
    mechanism = load_free_four_bar(*arcs)
    coarse, fine, numpy_result = (
        sk.simulate(
            mechanism,
            Start(1.0, 1.3),
            5.0,
            assembly_mode=assembly_mode,
            engine=engine,
            tolerance=tolerance,
        )
        for engine, tolerance in (("compiled", 1e-3), ("compiled", 1e-13), ("numpy", 1e-5))
    )
    for result in (coarse, fine, numpy_result):
        assert result.end.kind == "singularity"
        assert "cross" in result.end.message
        assert abs(result.at([result.end.t]).q[0] - np.pi) < 0.01
    assert abs(coarse.at([coarse.end.t]).q[0] - np.pi) < 1e-4
    assert abs(coarse.end.t - fine.end.t) < 1e-6


@needs_heyoka
def test_dry_friction_ends_a_motion_when_its_work_has_used_the_energy():
    """A torque of 3 N m against the motion stops it after the angle kinetic energy / 3."""
    mechanism = with_torque(load("four_bar"), "21", "-3*sign(dtheta_21)")
    result = run(mechanism, Start(0.3, 0.5), 50.0)
    assert result.end.kind == "sticking"
    assert "reverse the motion at once" in result.end.message
    rows = result.at([0.0, result.end.t])
    turned_angle = np.diff(rows.q)[0]
    assert abs(3.0 * turned_angle - rows.kinetic[0]) < 1e-12


@needs_heyoka
def test_friction_acts_against_a_motion_that_begins_at_rest():
    """Backward torque -4 against friction 3 moves the crank as torque -1 alone does."""
    mechanism = with_torque(load("four_bar"), "21", "-3*sign(dtheta_21)")
    with_friction = run(mechanism, Start(0.3, 0.0), 1.0, torque="-4")
    without_friction = run(with_torque(mechanism, "21", "-1"), Start(0.3, 0.0), 1.0)
    times = [0.5, 1.0]
    assert np.max(np.abs(with_friction.at(times).q - without_friction.at(times).q)) < 1e-13


@needs_heyoka
def test_a_load_without_power_may_change_abruptly():
    """A moment across the axis of a wheel switches, which does not change the motion."""
    across = sk.Moment("across", "2", ("-0.5*sign(theta_12-0.1)", "abs(theta_12-0.2)", "0"))
    along = sk.PairTorque("along", "12", "-0.5*sign(theta_12-0.1)")
    results = [
        run(one_link_mechanism(np.eye(3).tolist(), load), Start(0.0, 1.0), 0.8)
        for load in (across, along)
    ]
    angles = [result.at([0.4, 0.8]).q for result in results]
    assert angles[0] == pytest.approx(angles[1], abs=1e-13)
    assert [event.kind for event in results[0].events] == ["switch", "switch"]


@needs_heyoka
def test_too_many_switches_are_not_called_too_many_steps(monkeypatch):
    """A simulation that ends because its loads switch too often says so."""
    modules = "symbolic.taylor_integrator", "dynamics.taylor_integration"
    for module in (*modules, "dynamics.compiled_engine"):
        monkeypatch.setattr(f"spherekit.{module}.CHATTERING_EVENT_COUNT", 20)
    torque = sk.PairTorque("drive", "12", "sign(sin(40*t))")
    mechanism = one_link_mechanism(np.eye(3).tolist(), torque)
    end = sk.simulate(mechanism, Start(0.0, 1.0), 5.0, engine="compiled").end
    assert end.kind == "too_fast"
    assert "loads switch too often" in end.message
    assert "steps are not enough" not in end.message


def rocker():
    """Return a four-bar none of whose grounded links turns fully."""
    return load_free_four_bar(60.0, 55.0, 70.0, 40.0)


@pytest.mark.slow
@needs_heyoka
def test_a_rocker_swings_over_its_dead_centre_1000_times():
    """A simulation of 400 s of swinging has exact dead centres and constant energy.

    A torque at the rocker (pair 41), like that of a pendulum, makes the four-bar swing. The
    input is the crank (pair 21). It turns back where the coupler (70 deg) and the rocker
    (40 deg) are in one plane, and form one arc of 30 or 110 degrees from the crank's end to
    the rocker's axis. The input follows by the spherical law of cosines with ground and
    crank (60 and 55 degrees).
    """
    mechanism = with_torque(rocker(), "41", "-5*sin(theta_41)")
    # The crank starts at 2 rad, and the rocker with 5 rad/s.
    start = PoseStart(configuration_at(mechanism, 2.0), "41", 5.0)
    result = run(mechanism, start, 400.0, tolerance=1e-15)
    dead_centres = [event for event in result.events if event.kind == "dead_centre"]
    assert len(dead_centres) > 1000
    ground_and_crank = np.deg2rad([60.0, 55.0])
    cosine = np.prod(np.cos(ground_and_crank))
    sine = np.prod(np.sin(ground_and_crank))
    limit_cosines = (np.cos(np.deg2rad([30.0, 110.0])) - cosine) / sine
    expected_inputs = np.arccos(limit_cosines)
    inputs = np.array([event.q for event in dead_centres])
    gaps = np.abs(inputs[:, None] - expected_inputs)
    assert np.max(np.min(gaps, axis=1)) < 1e-12
    assert np.all(np.min(gaps, axis=0) < 1e-12)  # both dead centres are reached

    history = result.at(np.linspace(0.0, 400.0, 201))
    rocker_angle = history.values[:, mechanism.variable_names.index("theta_41")]
    energy = history.kinetic - 5.0 * np.cos(rocker_angle)
    assert np.max(np.abs(energy - energy[0])) / history.kinetic.max() < 1e-12


@pytest.mark.parametrize("engine", ENGINES)
def test_a_stop_beyond_a_turn_ends_the_motion_at_its_angle(engine):
    """A joint limit at 9 rad, more than a turn away, stops the crank at 9 rad.

    `with_crank_limits` returns a four-bar with such limits. A limit farther away changes
    nothing of the motion before, and needs no new compilation.
    """
    mechanism = with_crank_limits(-1.0, 9.0)
    farther = with_crank_limits(-1.0, 9.5)
    for rate, stop in ((1.0, 9.0), (-1.0, -1.0)):
        result = sk.simulate(mechanism, Start(0.3, rate), 60.0, engine=engine)
        limit = f"{degrees_text(stop)} deg ({stop:g} rad)"
        assert result.end.message == f"pair 21 reached its joint limit at {limit}"
        assert result.end.kind == "joint_limit"
        assert abs(result.at([result.end.t]).q[0] - stop) < 1e-10
        with pytest.raises(SolveError, match="reached its joint limit"):
            result.at([59.0])
        farther_result = sk.simulate(farther, Start(0.3, rate), 60.0, engine=engine)
        times = np.linspace(0.0, result.end.t, 11)
        gaps = np.abs(result.at(times).q - farther_result.at(times).q)
        assert np.max(gaps) < 1e-9
        assert farther_result.engine.compile_seconds == 0.0


def with_crank_limits(lowest, highest):
    """Return the load-free four-bar whose crank (pair 21) has joint limits (rad)."""
    free = replace(load("four_bar"), loads=())
    return replace(free, joint_limits=(JointLimit("21", lowest, highest),))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_motion_may_start_at_a_joint_limit_but_not_outside(engine):
    """A crank at its lower limit (0.3 rad) may move inwards; outwards it ends at once."""
    message = r"starts at 527.121 deg \(9.2 rad\), outside its joint limits -57.2958 to"
    with pytest.raises(SolveError, match=message):
        sk.simulate(with_crank_limits(-1.0, 9.0), Start(9.2, 1.0), 10.0, engine=engine)
    mechanism = with_crank_limits(0.3, 2.0)
    inwards = sk.simulate(mechanism, Start(0.3, 1), 5.0, engine=engine)
    assert inwards.end.message.endswith("(2 rad)")
    outwards = sk.simulate(mechanism, Start(0.3, -1), 5.0, engine=engine)
    assert outwards.end.kind == "joint_limit"
    assert outwards.end.t == pytest.approx(0.0, abs=1e-12)
    assert [event.kind for event in outwards.events] == ["joint_limit"]
    assert outwards.at([0.0]).q[0] == 0.3


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("rate", [0.0, -1e-3])
def test_a_load_does_not_push_a_crank_beyond_the_limit_at_which_it_starts(engine, rate):
    """A crank at its upper limit, at rest or moving slowly inwards, is pushed outwards.

    With the initial acceleration a it is back at the limit at the time -2 rate / a.
    """
    mechanism = with_crank_limits(-1.0, 0.3)
    options = {"torque": 5.0, "engine": engine}
    free = sk.simulate(with_crank_limits(-1.0, 3.0), Start(0.3, rate), 0.1, **options)
    acceleration = free.at([0.0]).input_accelerations[0, 0]
    assert acceleration > 0.0
    pushed = sk.simulate(mechanism, Start(0.3, rate), 0.5, **options)
    assert pushed.end.kind == "joint_limit"
    assert pushed.end.t == pytest.approx(-2.0 * rate / acceleration, rel=1e-2, abs=1e-6)
    assert pushed.at([pushed.end.t]).q[0] == pytest.approx(0.3, abs=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_start_with_whole_turns_at_a_joint_limit_is_not_outside_by_rounding(engine):
    """The sum of -223 deg + 360 deg and -360 deg differs from -223 deg by rounding."""
    limit = np.radians(-223.0)
    mechanism = with_crank_limits(limit - 1.0, limit)
    inwards = sk.simulate(mechanism, Start(limit, -1.0), 0.1, engine=engine)
    assert inwards.end.kind == "time"
    assert inwards.at([0.1]).q[0] < limit
    outwards = sk.simulate(mechanism, Start(limit, 1.0), 0.1, engine=engine)
    assert outwards.end.kind == "joint_limit"
    assert outwards.end.t == pytest.approx(0.0, abs=1e-12)


@pytest.mark.many
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("text", ["sqrt(1 - t)", "1/(1 - t)**2"])
def test_a_load_without_a_value_ends_the_motion(text, engine):
    """A torque that is not defined after t = 1 s, or infinite then, ends the motion."""
    mechanism = with_torque(load("four_bar"), "21", text)
    result = sk.simulate(mechanism, Start(0.3, 1.0), 2.0, tolerance=1e-7, engine=engine)
    assert result.end.kind == "too_fast"
    if "/" in text:  # the pole of the torque is felt before it is reached
        assert "make the load smooth" in result.end.message
        earliest_end = 0.9
    else:
        earliest_end = 1.0 - 1e-6
    assert earliest_end < result.end.t <= 1.0 + 1e-6
    assert np.isfinite(result.at([result.end.t]).q[0])


def geared_five_bar():
    """Return a five-bar whose cranks a and b carry equal wheels in mesh.

    The mesh ("Cr", a rolling contact) adds a loop. Its three equations and the three of the
    five-bar have one equation too many, which follows from the others. The axes are
    arbitrary. The wheels touch in the middle of the arc between the axes of both cranks.
    """
    pair_links = {"left": "ga", "right": "gb", "ac": "ac", "cd": "cd", "bd": "bd"}
    ground_axes = np.array([[0, 0, 1], [0.846889512904878, 0, 0.531768890526456]])
    other_axes = [[-42, -78, 46], [-75, 62, -24], [55, 36, -75]]
    axes = np.vstack([ground_axes, other_axes])  # (5, 3) unit axes in the reference pose
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    half_ground_arc = 0.5 * np.arctan2(axes[1, 0], axes[1, 2])
    wheels = tuple(Profile("circle", tuple(axis), half_ground_arc) for axis in axes[:2])
    pairs = [Pair(name, "R", tuple(links)) for name, links in pair_links.items()]
    pairs.append(Pair("mesh", "Cr", ("a", "b"), wheels))
    pose = PoseGeometry(dict(zip(pair_links, map(tuple, axes), strict=True)))
    inputs = (Input("left", -2.0 * np.pi, 2.0 * np.pi),)
    tensor = tuple(map(tuple, np.diag([2e-2, 1e-2, 2e-2]).tolist()))
    masses = tuple(Mass(link, tensor) for link in "abcd")
    return Mechanism(
        "geared", "g", tuple("gabcd"), tuple(pairs), pose, inputs, masses=masses
    )


@pytest.mark.slow
@needs_heyoka
def test_dependent_equations_of_a_redundant_loop_are_no_crossing(monkeypatch):
    """The compiled engine refuses to go on where its chosen equations become dependent.

    With a redundant loop there are more closure equations than unknowns. The compiled
    engine chooses equations that are independent at the start. Later they can be dependent
    although the mechanism is regular. Dependent equations usually mean that two curves of
    configurations cross, but here there is no crossing. The engine therefore refuses and
    advises to use the NumPy engine. With the automatic choice of the engine, NumPy takes
    over. The reference is a simulation by NumPy.
    """
    # Normally wheels on a common carrier need no loop, because their ratio is constant.
    # Without this knowledge there is a redundant loop.
    monkeypatch.setattr(
        "spherekit.planning.assembly_plan.find_carried_contacts",
        lambda mechanism: frozenset(),
    )
    mechanism = geared_five_bar()
    start = Start(1.117, 0.4)
    duration = 1.5
    torque = "0.1*sin(2*t)"
    expected = sk.simulate(mechanism, start, duration, engine="numpy", torque=torque)
    assert expected.end.kind == "time"
    times = np.linspace(0.0, duration, 61)
    expected_values = expected.at(times).values
    position_analysis = PositionAnalysis(mechanism, samples=3, search=False)
    motion = position_analysis.given(expected_values)
    # The mechanism is regular with its input locked: the axes of three passive pairs are
    # never in one plane, so any motion of one of them opens the loop.
    assert np.min(np.abs(np.linalg.det(motion.axes[:, 2:5]))) > 0.1
    with pytest.raises(EngineError, match=r"equations are redundant.*use the NumPy engine"):
        sk.simulate(mechanism, start, duration, engine="compiled", torque=torque)
    automatic = sk.simulate(mechanism, start, duration, tolerance=1e-9, torque=torque)
    assert automatic.end.kind == "time"
    # The NumPy engine has been chosen already, so the reason does not advise to choose it.
    assert "use the NumPy engine" not in automatic.engine.reason
    assert np.max(np.abs(automatic.at(times).values - expected_values)) < 1e-8


@needs_heyoka
@pytest.mark.slow
def test_both_engines_move_a_geared_five_bar():
    """If the wheels are solved first, their redundant loop stops neither engine."""
    mechanism = geared_five_bar()
    mechanism = replace(mechanism, masses=mechanism.masses[:3])
    times = np.linspace(0.0, 1.5, 61)
    numpy_result, compiled = (
        sk.simulate(mechanism, Start(1.117, 0.4), 1.5, engine=engine, torque="0.1*sin(2*t)")
        for engine in ("numpy", "compiled")
    )
    assert compiled.end.kind == "time"
    gaps = np.abs(numpy_result.at(times).values - compiled.at(times).values)
    assert np.max(gaps) < 1e-8


@needs_heyoka
def test_torque_tables_move_a_crank_exactly_and_share_one_compilation():
    """Torque tables move a crank as computed by hand, and share one compiled equation.

    Only the crank has inertia, 0.5 kg m^2 about its fixed axis. So its angle is the torque,
    linear between the nodes of the table, integrated twice and divided by 0.5. The second
    table must need no compilation.
    """
    four_bar_of_file = load("four_bar")
    masses = (Mass("2", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.5))),)
    inertia = 0.5
    # Times (s) and torques (N m) of the nodes
    tables = ((0.0, 1.0, 3.0), (0.0, 2.0, -2.0)), ((0.0, 3.0), (1.0, 4.0))
    for number, (node_times, node_torques) in enumerate(tables):
        table = sk.TorqueTable("table", "21", node_times, node_torques)
        mechanism = replace(four_bar_of_file, masses=masses, loads=(table,))
        result = run(mechanism, Start(0.1, 0.0), 3.0)
        torques = table.at(np.array(node_times))
        # Angle and rate at each node follow from those at the node before.
        q = 0.1
        rate = 0.0
        for h, torque, next_torque in zip(
            np.diff(node_times), torques, torques[1:], strict=False
        ):
            q += rate * h + (2.0 * torque + next_torque) * h**2 / 6.0 / inertia
            rate += 0.5 * (torque + next_torque) * h / inertia
        assert result.at([3.0]).q[0] == pytest.approx(q, abs=1e-10)
        is_compiled_before = result.engine.compile_seconds == 0.0
        assert is_compiled_before == (number == 1)


@needs_heyoka
def test_a_compiled_equation_is_used_again():
    """After a compiled simulation the automatic choice takes the compiled engine."""
    compiled, automatic = (
        sk.simulate(
            load("four_bar"), Start(0.3, 1.0), 0.1, torque="-1*t", engine=engine
        ).engine
        for engine in ("compiled", "auto")
    )
    assert compiled.name == automatic.name == "compiled"
    assert compiled.compile_seconds > 0.0
    assert automatic.compile_seconds == 0.0
    assert automatic.reason == "its code was compiled before"


@pytest.mark.slow
@needs_heyoka
def test_a_short_run_is_not_compiled_and_a_long_one_is():
    """By default a simulation uses the engine with the smaller forecast of seconds.

    A short one uses NumPy, a long one is compiled. A torque with a kink is always compiled,
    without a forecast.
    """
    heavy = with_masses(load("double_butterfly"))
    pose = PoseStart(configuration_at(heavy, 0.5), heavy.inputs[0].pair, 1.0)
    short = sk.simulate(heavy, pose, 1e-3).engine
    assert short.name == "numpy"
    assert short.forecast["numpy"] < short.forecast["compiled"]
    linkage = load("four_bar")
    long = sk.simulate(linkage, Start(0.3, 1.0), 500.0, torque="0.2*sin(t)").engine
    assert long.name == "compiled"
    assert long.forecast["compiled"] < long.forecast["numpy"]
    assert long.reason.startswith("expected times: ")
    kinked = sk.simulate(linkage, Start(0.3, 1.0), 1e-3, torque="abs(t) - 1").engine
    assert (kinked.name, kinked.forecast) == ("compiled", None)
    assert "kinks" in kinked.reason


@needs_heyoka
def test_two_threads_compile_an_equation_once():
    """Two threads that need one equation get the same object; the second waits for it."""
    mechanism = with_torque(load("four_bar"), "21", "0.125*cos(t)")
    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(lambda _: compile_equation(mechanism, 1e-9), range(2)))
    (equation, was_compiled), (same_equation, same_was_compiled) = results
    assert equation is same_equation
    assert sorted([was_compiled, same_was_compiled]) == [False, True]


@needs_heyoka
def test_simulations_in_two_threads_equal_those_in_turn():
    """Simulations in two threads equal those one after the other, bit for bit.

    Four starts are simulated three times each in threads. Values and events are compared.
    """
    mechanism = load("four_bar")
    starts = [Start(0.3, rate) for rate in (1.0, -1.0, 2.0, 0.5)]

    def simulate_rows(start):
        result = run(mechanism, start, 20.0, torque="sin(3*t)")
        return result.at(np.linspace(0.0, 20.0, 60)).values, result.events

    in_turn = [simulate_rows(start) for start in starts]
    with ThreadPoolExecutor(2) as pool:
        in_threads = list(pool.map(simulate_rows, starts * 3))
    for expected, threaded in zip(in_turn * 3, in_threads, strict=True):
        expected_values, expected_events = expected
        values, events = threaded
        assert np.array_equal(values, expected_values)
        assert events == expected_events


def test_without_heyoka_numpy_runs_and_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "heyoka", None)
    mechanism = load("four_bar")
    result = sk.simulate(mechanism, Start(0.3, 1.0), 0.2, torque="0.5 - t")
    assert result.engine.name == "numpy" and "pip install" in result.engine.reason
    assert "NumPy engine" not in result.engine.reason  # it is what ran
    with pytest.raises(EngineError, match=r"spherekit-mechanisms\[compiled\].*NumPy"):
        run(mechanism, Start(0.3, 1.0), 0.2, torque="0.5 - t")


MADE = load("four_bar")


@needs_heyoka
@pytest.mark.parametrize("call", TABLES["engines"])
def test_bad_input_is_refused_before_any_integration(call):
    """Each call of the table "engines" of `refusals.toml` raises the error stated there."""
    check_call(call, globals(), TABLES["engines"][call])


def test_a_full_cache_drops_the_least_recently_used_result():
    """A cache of two results computes "b" again after "a" and "c" were used since."""
    cache = MechanismCache(max_results=2)
    computed = []

    def get(name):
        cache.get(load("four_bar"), name, lambda: computed.append(name))

    for name in ("a", "b", "a", "c", "a", "b"):
        get(name)
    assert computed == ["a", "b", "c", "b"]
    assert cache.has(load("four_bar"), "a")
    assert not cache.has(load("four_bar"), "c")
    assert not cache.has(load("watt"), "a")


@pytest.mark.parametrize(
    "options",
    [
        {"torque": lambda t, q, dq: 5.0 - 2.0 * dq},
        {"torque": "5 - 2*dtheta_21", "crossings": "pass"},
    ],
)
def test_a_tolerance_below_that_of_numpy_is_refused_if_only_numpy_is_possible(options):
    """The choice "auto" refuses what the choice "numpy" refuses, and says why."""
    simulate = partial(sk.simulate, "four_bar", Start(0.3, 1.0), 0.1, **options)
    assert simulate(tolerance=1e-13).engine.name == "numpy"
    with pytest.raises(SolveError, match="only the NumPy engine is possible"):
        simulate(tolerance=1e-15)
    with pytest.raises(SolveError, match="expected a number from 1e-13"):
        simulate(tolerance=1e-15, engine="numpy")
