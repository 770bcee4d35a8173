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
def test_inertia_is_symmetric_positive_and_changes_as_its_derivatives_say(name):
    """M' along a motion comes from M alone, by the series through it at 28 times."""
    made = with_point_masses(name)
    nodes = np.cos(np.pi * (np.arange(28)[::-1] + 0.5) / 28)
    found = inverse_dynamics(made, laws_of(made, name), 0.2 + 0.2 * nodes, assembly_mode=0)
    M = found.M
    size = np.max(np.abs(M))
    assert np.max(np.abs(M - np.swapaxes(M, 1, 2))) < 1e-14 * size
    assert np.min(np.linalg.eigvalsh(M)) > 1e-3 * size
    series = np.polynomial.chebyshev.chebfit(nodes, M.reshape(len(M), -1), 27)
    slope = np.polynomial.chebyshev.chebder(series) / 0.2
    change = np.polynomial.chebyshev.chebval(nodes, slope).T.reshape(M.shape)
    C = np.einsum("nijk,nk->nij", christoffel(found.dM), found.input_rates)
    left = change - 2.0 * C
    # The slope of the series has some thousand times the rounding of M.
    assert np.max(np.abs(left + np.swapaxes(left, 1, 2))) < 3e-11 * size
    own = np.einsum("nijk,nk->nij", found.dM, found.input_rates) - 2.0 * C
    assert np.max(np.abs(own + np.swapaxes(own, 1, 2))) < 1e-13 * size


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
def test_bodies_held_together_move_the_same_way(name, engine, until):
    """The five-bar passes a configuration at 1.588 s where its inputs do not hold it."""
    made = with_point_masses(name)
    driven, *passive = [item.pair for item in made.inputs]
    dq = tuple(0.1 * (-1) ** (k + 1) for k in range(len(made.inputs)))
    torque = {driven: f"5*sin(2*t) - 0.5*dtheta_{driven}"}
    start = sk.Start(STARTS[name], dq)
    found = sk.simulate(made, start, until, torque=torque, tolerance=1e-12, engine=engine)
    assert found.end.kind == "time" and found.engine.name == engine and passive
    kinds = [event.kind for event in found.events]
    assert kinds == (["type_2"] if name == "five_bar" else [])
    checks = found.checks
    assert checks.energy < 1e-12 * checks.energy_scale
    history = found.at(np.linspace(0.0, until, 7))
    assert np.max(np.abs(history.kinetic - history.kinetic[0] - history.work[:, 0])) < 1e-12

    def drive(t, rates):
        return [5.0 * np.sin(2.0 * t) - 0.5 * rates[0], *(0.0 for _ in passive)]

    check_simulated_motion(found, drive, within=1e-10)


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


def test_the_mid_plane_s_rotation_is_driven_by_its_torques():
    """Chen et al. 2021, Table 3: from pose to pose, straight on where sets cross.

    The torques are handed to the direct problem as functions of time alone.
    """
    made = with_point_masses("two_dof_spm")
    form = sk.mid_plane_form(made)
    start, stop = (normal_at(*np.radians(pose)) for pose in [(75, -20), (70, 20)])
    turn = form.rotation_between(start, stop, modes=(-1, 1, 1))
    plan = sk.time_optimal(turn, speed=0.5, acceleration=1.3)
    span, inputs = plan.duration, plan.rotation.inputs
    nodes = np.cos(np.pi * (np.arange(200)[::-1] + 0.5) / 200)
    needed = inverse_dynamics(made, plan, 0.5 * span * (nodes + 1.0))
    assert np.all(needed.status == 0)
    series = np.polynomial.chebyshev.chebfit(nodes, needed.torques, 199)

    def at(t, column):
        return np.polynomial.chebyshev.chebval(2.0 * t / span - 1.0, series[:, column])

    ends = plan.at([0.0, span])
    begun = turn.at(ends.theta[:1])
    moved = sk.simulate(
        made,
        sk.PoseStart(begun.values[0], inputs, ends.rates[0]),
        span,
        torque={pair: lambda t, q, dq, k=k: at(t, k) for k, pair in enumerate(inputs)},
        tolerance=1e-11,
        crossings="pass",
    )
    assert moved.end.kind == "time" and moved.checks.energy < 1e-12
    assert [event.kind for event in moved.events] == ["crossing"]
    t = np.array([0.6, 0.643, 0.7, 1.0]) * span
    assert moved.at(t).inputs == pytest.approx(plan.at(t).inputs, abs=1e-10)
    number = made.link_number["4"]
    first, last = moved.at([0.0, span]).rotations[:, number]
    want = turn.at(ends.theta[1:]).orientation[0] @ begun.orientation[0].T
    assert np.max(np.abs(last @ first.T - want)) < 1e-9


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
