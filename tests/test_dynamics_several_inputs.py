"""Equations of motion of several inputs, against Newton's and Euler's of the links."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.engines import needs_heyoka
from helpers.refusals import TABLES, check_call, mechanism_text
from oracles.newton_euler import check_simulated_motion, with_point_masses

import spherekit as sk
from spherekit.dynamics.inertia import christoffel
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.errors import SolveError
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.plugin.rotations import normal_at

STARTS = {
    "two_dof_spm": (0.3, 0.35),
    "five_bar": (1.0, 1.2),
    "three_rrr": (0.9, 1.0, 1.2),
    "bevel_differential": (0.5, 0.4),
}


def laws_of(made, name):
    return {
        item.pair: sk.Polynomial((q, 0.2 * (-1) ** k, 0.15, 0.1 * k))
        for k, (item, q) in enumerate(zip(made.inputs, STARTS[name], strict=True))
    }


@pytest.mark.parametrize("name", STARTS)
def test_inertia_matrix_is_positive_definite_and_agrees_with_christoffel_symbols(name):
    """The inertia matrix M of the inputs has the properties that mechanics demands.

    M is symmetric and positive definite, and M' - 2 C is skew-symmetric, with the matrix C
    of Christoffel symbols times rates. The rate M' along a motion of 0.4 s is computed
    twice: from the partial derivatives of M, and from M alone, by a Chebyshev series
    through 28 times.
    """
    mechanism = with_point_masses(name)
    nodes = np.cos(np.pi * (np.arange(28)[::-1] + 0.5) / 28)
    times = 0.2 + 0.2 * nodes
    solution = inverse_dynamics(mechanism, laws_of(mechanism, name), times, assembly_mode=0)
    M = solution.M
    size = np.max(np.abs(M))
    assert np.max(np.abs(M - np.swapaxes(M, 1, 2))) < 1e-14 * size
    assert np.min(np.linalg.eigvalsh(M)) > 1e-3 * size

    C = np.einsum("nijk,nk->nij", christoffel(solution.dM), solution.input_rates)
    chebyshev = np.polynomial.chebyshev
    series = chebyshev.chebfit(nodes, M.reshape(len(M), -1), 27)
    derivative_series = chebyshev.chebder(series) / 0.2
    M_rate_by_series = chebyshev.chebval(nodes, derivative_series).T.reshape(M.shape)
    M_rate = np.einsum("nijk,nk->nij", solution.dM, solution.input_rates)
    # The derivative of the series has some thousand times the rounding of M.
    for rate, tolerance in ((M_rate_by_series, 3e-11), (M_rate, 1e-13)):
        skew = rate - 2.0 * C
        assert np.max(np.abs(skew + np.swapaxes(skew, 1, 2))) < tolerance * size


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "engine", "until"),
    [
        ("two_dof_spm", "numpy", 0.6),
        ("three_rrr", "numpy", 0.6),
        pytest.param("three_rrr", "compiled", 0.6, marks=needs_heyoka),
        ("five_bar", "numpy", 2.6),
        pytest.param("five_bar", "compiled", 1.8, marks=needs_heyoka),
        ("bevel_differential", "numpy", 1.0),
        pytest.param("bevel_differential", "compiled", 1.0, marks=needs_heyoka),
        pytest.param(
            "two_dof_spm", "compiled", 0.6, marks=[needs_heyoka, pytest.mark.long]
        ),
    ],
)
def test_simulations_of_several_inputs_satisfy_euler_s_equations(name, engine, until):
    """Simulations of mechanisms with several inputs satisfy Euler's equations of all links.

    `check_simulated_motion` solves these equations with all reactions, independently of
    spherekit. The first input is driven by 5 sin(2 t) - 0.5 rate N m, the others are free.
    At 1.588 s the five-bar passes a singularity of type II, in which it could move with
    locked inputs. `until` is the end of the simulation (s).
    """
    mechanism = with_point_masses(name)
    driven, *free_inputs = [item.pair for item in mechanism.inputs]
    rates = tuple(0.1 * (-1) ** (k + 1) for k in range(len(mechanism.inputs)))
    simulation = sk.simulate(
        mechanism,
        sk.Start(STARTS[name], rates),
        until,
        torque={driven: f"5*sin(2*t) - 0.5*dtheta_{driven}"},
        tolerance=1e-12,
        engine=engine,
    )
    assert simulation.end.kind == "time"
    assert simulation.engine.name == engine
    assert free_inputs
    event_kinds = [event.kind for event in simulation.events]
    assert event_kinds == (["type_2"] if name == "five_bar" else [])
    assert simulation.checks.energy < 1e-12 * simulation.checks.energy_scale
    # The drive is the only load. Its work since the start is the gain of kinetic energy.
    history = simulation.at(np.linspace(0.0, until, 7))
    energy_gain = history.kinetic - history.kinetic[0]
    (work_of_drive,) = history.work.T
    assert np.max(np.abs(energy_gain - work_of_drive)) < 1e-12

    def driving_torques(t, rates):
        torque_of_first = 5.0 * np.sin(2.0 * t) - 0.5 * rates[0]
        torques_of_free = [0.0] * len(free_inputs)
        return [torque_of_first, *torques_of_free]

    check_simulated_motion(simulation, driving_torques, within=1e-10)


@needs_heyoka
def test_a_stop_beyond_a_singularity_of_type_2_ends_both_engines_alike():
    held = replace(
        with_point_masses("five_bar"), joint_limits=(JointLimit("51", -1.0, 1.35),)
    )
    ends = [
        sk.simulate(
            held, sk.Start((1.0, 1.2), (0.3, 0.2)), 3.0, engine=engine, tolerance=1e-12
        )
        for engine in ("numpy", "compiled")
    ]
    assert [found.end.kind for found in ends] == ["joint_limit"] * 2
    assert ends[0].end.t == pytest.approx(ends[1].end.t, abs=1e-12)
    assert ends[0].events[-1].inputs == pytest.approx(ends[1].events[-1].inputs, abs=1e-12)


@pytest.mark.slow
def test_inverse_dynamics_of_a_planned_rotation_drives_the_same_motion():
    """The torques that inverse dynamics finds for a planned motion drive this motion.

    The plan is the rotation of the end effector (link 4) between two poses of Chen et al.
    2021, Table 3, in shortest time under limits of rate and acceleration. Base and end
    effector are mirror images of each other, so a pose is stated by the normal of the
    mirror plane (`normal_at`). Two angles phi and gamma (deg) determine this normal: its
    first two components are -sin(phi / 2) and sin(gamma / 2). At 0.6423 of the duration the
    motion passes a crossing, a configuration from which the mechanism could also move in
    another way. With `crossings="pass"` the simulation continues there.
    """
    mechanism = with_point_masses("two_dof_spm")
    start = normal_at(phi=np.radians(75.0), gamma=np.radians(-20.0))
    stop = normal_at(phi=np.radians(70.0), gamma=np.radians(20.0))
    form = sk.mid_plane_form(mechanism)
    # `modes` are the signs of the three legs, each of which can be bent in two ways. Here
    # the driven links point outward, as in Fig. 5(a).
    rotation_path = form.rotation_between(start, stop, modes=(-1, 1, 1))
    # Limits of the inputs, in rad/s and rad/s^2.
    plan = sk.time_optimal(rotation_path, speed=0.5, acceleration=1.3)
    duration = plan.duration
    inputs = plan.rotation.inputs

    # The simulation needs torques at any time. They are interpolated by Chebyshev series
    # through their values at 200 times, which are enough for the checked 1e-10 rad.
    nodes = np.cos(np.pi * (np.arange(200)[::-1] + 0.5) / 200)
    needed = inverse_dynamics(mechanism, plan, 0.5 * duration * (nodes + 1.0))
    assert np.all(needed.status == 0)
    chebyshev = np.polynomial.chebyshev
    series = chebyshev.chebfit(nodes, needed.torques, 199)

    def torque_of(column):
        def torque(t, q, dq):
            return chebyshev.chebval(2.0 * t / duration - 1.0, series[:, column])

        return torque

    # First and last row of the plan; theta is the angle of rotation about the axis.
    ends = plan.at([0.0, duration])
    first_pose = rotation_path.at(ends.theta[:1])
    # The simulation starts with all pair angles of the first pose.
    simulation = sk.simulate(
        mechanism,
        sk.PoseStart(first_pose.values[0], inputs, ends.rates[0]),
        duration,
        torque={pair: torque_of(column) for column, pair in enumerate(inputs)},
        tolerance=1e-11,
        crossings="pass",
    )
    assert simulation.end.kind == "time"
    assert simulation.checks.energy < 1e-12
    assert [event.kind for event in simulation.events] == ["crossing"]
    # Before the crossing, immediately after it, and later.
    times = np.array([0.6, 0.643, 0.7, 1.0]) * duration
    assert simulation.at(times).inputs == pytest.approx(plan.at(times).inputs, abs=1e-10)

    end_effector = mechanism.link_number["4"]
    first, last = simulation.at([0.0, duration]).rotations[:, end_effector]
    last_pose = rotation_path.at(ends.theta[1:])
    rotation = last_pose.orientation[0] @ first_pose.orientation[0].T
    assert np.max(np.abs(last @ first.T - rotation)) < 1e-9


@pytest.mark.parametrize(
    "engine", ["numpy", pytest.param("compiled", marks=[needs_heyoka, pytest.mark.long])]
)
def test_where_sets_of_configurations_cross_a_simulation_ends(engine):
    made = with_point_masses("two_dof_spm")
    found = sk.simulate(made, sk.Start((0.3, 0.25), (0.3, -0.3)), 3.0, engine=engine)
    assert found.end.t == pytest.approx(0.379394747, abs=1e-6)
    assert found.end.kind == "singularity" and 0.1 < found.end.t < 1.0
    assert "cross" in found.end.message


FIVE = with_point_masses("five_bar")


@pytest.mark.parametrize("call", TABLES["several inputs"])
def test_what_is_wrong_is_said(call):
    check_call(call, {"sk": sk, "FIVE": FIVE}, TABLES["several inputs"][call])


def test_the_command_recovers_the_torques_that_acted(tmp_path):
    study = tmp_path / "pushed.study.toml"
    study.write_text(mechanism_text("dynamics_several_inputs_text.study"))
    found = sk.run(sk.load_study(study))
    table = found.frame("dynamics")
    assert np.all(table["status"] == "OK")
    assert table["tau_21"].to_numpy() == pytest.approx(
        0.002 * np.sin(2.0 * table["t"].to_numpy()), abs=1e-7
    )
    assert table["tau_51"].to_numpy() == pytest.approx(np.zeros(len(table)), abs=1e-7)


def test_inputs_without_laws_go_along_their_ranges():
    found = sk.run("bevel_differential", "dynamics", samples=5)
    table = found.frame("dynamics")
    assert table["dq_left_axle"].to_numpy() == pytest.approx(np.ones(5))
    assert table["dq_right_axle"].to_numpy() == pytest.approx(np.full(5, 0.5))
    # Its masses are balanced, and its ratios constant: nothing is needed.
    needed = table[["tau_left_axle", "tau_right_axle"]].to_numpy()
    assert np.max(np.abs(needed)) < 1e-15


@pytest.mark.parametrize("rates", [(1.0, 1.0), (0.0, 0.0)])
def test_a_start_that_names_a_pair_twice_is_refused(rates):
    values = sk.simulate(FIVE, sk.Start((0.5, 1.0), (0.0, 0.0)), 0.01).at([0.0]).values[0]
    start = sk.PoseStart(values, ("21", "21"), rates)
    with pytest.raises(SolveError, match="several rates of the same pair: 21, 21"):
        sk.simulate(FIVE, start, 0.01)
