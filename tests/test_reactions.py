"""Reactions in the pairs, holding torques and stiffness, against equations of the links."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.polynomial_motions import START_INPUTS, motion_by_polynomial_laws
from oracles.newton_euler import newton_euler, row_of_torques, with_masses_and_loads

import spherekit as sk
from spherekit.cli.main import main
from spherekit.dynamics.inverse_dynamics import holding_torques
from spherekit.dynamics.output_stiffness import output_stiffness
from spherekit.dynamics.reactions import reactions
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status


@pytest.mark.parametrize("name", START_INPUTS)
def test_newton_and_euler_give_the_same_torques_and_reactions(name):
    """Torques and moments in pairs solve the Newton-Euler equations of all links.

    The mechanism has random masses and loads and moves by polynomial laws. Reactions are
    not compared where redundant constraints leave them open, as in the differential, or
    where teeth press wheels apart, which the equations of the oracle leave out.
    """
    seed = sum(map(ord, name))
    mechanism, joint = with_masses_and_loads(name, np.random.default_rng(seed))
    mechanism = mechanism.with_inputs(*[item.pair for item in mechanism.inputs])
    starts = START_INPUTS[name]
    result = reactions(motion_by_polynomial_laws(mechanism, starts, [0.0, 0.2, 0.4]))
    torques = result.torques
    largest_moment = np.nanmax(np.abs(result.moments))
    assert np.max(result.unbalanced) < 1e-12 * largest_moment
    assert np.any(result.is_open) == (name == "bevel_differential")
    has_pressure_angle = any(pair.pressure_angle for pair in mechanism.pairs)
    for row in range(len(torques.t)):
        expected = newton_euler(*row_of_torques(torques, row, joint))
        assert torques.torques[row] == pytest.approx(expected, rel=1e-10, abs=1e-10)
        if np.any(result.is_open) or has_pressure_angle:
            continue
        expected = newton_euler(*row_of_torques(torques, row, joint), full=True)
        for k, pair in enumerate(mechanism.pairs):
            components = expected[pair.name]
            count = len(components)
            moment = result.moments[row, k]
            assert moment[:count] == pytest.approx(components, abs=1e-11 * largest_moment)
            if not pair.kind.has_axis:
                assert np.all(moment[count:] == 0.0)


def pressed(torque):
    """Return the flat-faced follower with a torque at its pivot and inertia."""
    made = sk.load("flat_cam").with_inputs("cam_shaft")
    tensor = np.diag([0.02, 0.02, 0.01])
    made = made.with_mass("follower", tensor).with_mass("cam", tensor)
    return made.with_loads(sk.PairTorque("press", "follower_pivot", torque))


@pytest.mark.parametrize("torque", ["5", "-5"])
def test_the_sign_of_a_contact_force_says_whether_it_presses(torque):
    """A positive `push` presses the follower away from the cam, a negative one would pull.

    The force F on the follower at the contact point p follows from its moment p x F. It
    presses if it points away from the centre of the cam's circle. A contact that would have
    to pull has the status LIFT_OFF. In the other assembly mode it is the other way round,
    also in a run of several blocks.
    """
    mechanism = pressed(torque)
    result = reactions(motion_by_polynomial_laws(mechanism, (0.5,), [0.0, 0.1]))
    contact = mechanism.pair_number["contact"]
    frame = result.frames[0, contact]
    contact_point = frame[:, 2]
    force = np.cross(frame @ result.moments[0, contact], contact_point)
    cam = mechanism.pair("contact").profiles[0]
    cam_rotation = result.torques.motion.rotations[0, mechanism.link_number["cam"]]
    cam_centre = cam_rotation @ np.array(cam.centre)
    presses = force @ (cam_centre - contact_point) < 0.0
    assert presses == (result.push[0, contact] > 0.0)
    assert np.linalg.norm(force) == pytest.approx(abs(result.push[0, contact]))
    assert presses == (result.status[0, contact] == Status.OK)

    run = sk.run(mechanism, "reactions", samples=7, block=3)
    lifted = run.frame("reactions").query("status == 'LIFT_OFF'")
    assert set(lifted["assembly_mode"]) == {int(presses)}
    findings = run.summary["analyses"][0]["findings"]
    assert findings["pairs"]["contact"]["rows_that_lift_off"] == 7


def test_the_stiffness_of_an_output_is_a_moment_over_the_turn_that_it_causes():
    """A small moment m turns each input by w . m / k; loop closure then moves the output.

    w is the output's rate per unit rate of an input, k the stiffness (N m/rad) of its
    drive. The turn of link 3 is the skew part of its relative rotation.
    """
    mechanism = sk.load("five_bar")
    inputs = np.array([[1.0, 1.2]])
    drive_stiffness = np.array([40.0, 90.0])

    def analysis_at(path):
        return PositionAnalysis(mechanism, None, 0, path=path)

    torques = holding_torques(analysis_at(inputs).motion())
    result = output_stiffness(torques, "3", "1", drive_stiffness)
    axis = result.axes[0, 0]
    stiffness = result.stiffness[0, 0]
    moment = 1e-6 * axis
    turned_inputs = inputs + (result.w[0] @ moment / drive_stiffness)[None]
    link_3 = 2
    rotation = analysis_at(inputs).motion().rotations[0, link_3]
    turned_rotation = analysis_at(turned_inputs).motion().rotations[0, link_3]
    relative = turned_rotation @ rotation.T
    turn = 0.5 * np.array(
        [
            relative[2, 1] - relative[1, 2],
            relative[0, 2] - relative[2, 0],
            relative[1, 0] - relative[0, 1],
        ]
    )
    assert turn == pytest.approx(moment / stiffness, rel=1e-4, abs=1e-13)


def test_an_output_on_a_crank_is_held_by_its_input_alone():
    made = sk.load("five_bar")
    crank = replace(made.outputs[0], name="crank", link="2", direction=None)
    made = replace(made, outputs=(*made.outputs, crank))
    rows = sk.run(made, "statics", samples=3).frame("statics", "outputs")
    rows = rows.query("output == 'crank' and status == 'OK'")
    assert np.allclose(rows[["advantage_21", "advantage_51"]], [1.0, np.inf]) and len(rows)


def test_redundant_constraints_are_named_and_left_open(capsys):
    """Some moments of a differential cannot be known: they are NaN, with a remark."""
    command = ["run", "bevel_differential", "-a", "reactions", "--samples", "3"]
    assert main(command) == 0
    output, error_text = capsys.readouterr()
    assert "redundant constraints leave open" in output
    assert "warning" not in output + error_text
    result = sk.run("bevel_differential", "reactions", samples=3)
    table = result.frame("reactions")
    assert table["moment_x"].isna().any()
    assert not table["moment_z"].isna().any()


def test_the_remark_names_the_row_with_the_largest_reaction():
    result = sk.run("roller_cam", "reactions", samples=9)
    pattern = r"([\d.]+) N m in pair (\w+) at sample (\d+) of assembly mode (\d+)"
    remarks = " ".join(result.summary["remarks"])
    ((size, pair, sample, mode),) = re.findall(pattern, remarks)
    table = result.frame("reactions").astype({"pair": str})
    table = table.set_index(["pair", "sample", "assembly_mode"])
    moments = table["transverse_moment"]
    named_moment = moments.loc[(pair, int(sample), int(mode))]
    assert named_moment == pytest.approx(moments.max())
    assert float(size) == pytest.approx(named_moment, rel=1e-4)


def test_the_remark_names_the_row_with_the_largest_holding_torque():
    result = sk.run("four_bar", "statics", samples=9)
    pattern = r"torque at 21: (\S+) N m at sample (\d+) of assembly mode (\d+)"
    remarks = " ".join(result.summary["remarks"])
    ((size, sample, mode),) = re.findall(pattern, remarks)
    torques = result.frame("statics").set_index(["sample", "assembly_mode"])["tau"]
    named_torque = torques.loc[(int(sample), int(mode))]
    assert named_torque == pytest.approx(float(size), rel=1e-4)
    assert abs(float(size)) == pytest.approx(torques.abs().max(), rel=1e-4)


def test_bearings_that_lock_are_refused(tmp_path):
    made, _ = with_masses_and_loads("stephenson", np.random.default_rng(5))
    tight = sk.Bearings("rub", "14", (0.1,), radius=0.5, coefficient=0.9, speed=0.01)
    locked = reactions(motion_by_polynomial_laws(made.with_loads(tight), (0.4,), [0.1]))
    assert locked.torques.status[0] != Status.OK
    rub = made.with_loads(replace(tight, coefficient=0.01))
    start = sk.Start(0.4, 1.0)
    for refused in (
        lambda: sk.simulate(rub, start, 1.0, engine="compiled"),
        lambda: sk.reference_simulation(rub, start, 1e-3),
        lambda: sk.export(rub, tmp_path / "stored.npz"),
    ):
        with pytest.raises(sk.SpherekitError, match="the reaction of pair 14"):
            refused()


@pytest.mark.slow
def test_a_simulation_ends_where_a_one_sided_contact_lifts_off(tmp_path):
    """Where the torque that presses the follower is all that its acceleration takes.

    The acceleration is that of the follower's angle, by differences of the motion found.
    """
    made = pressed("0.5")
    pairs = [replace(p, one_sided=p.name == "contact") for p in made.pairs]
    made = replace(made, pairs=tuple(pairs))
    sk.dump(made, tmp_path / "cam.toml")
    assert sk.load(tmp_path / "cam.toml").pair("contact").one_sided
    found = sk.simulate(made, sk.Start(0.5, 18.0), 1.0, tolerance=1e-11, engine="numpy")
    assert found.end.kind == "lift_off" and "contact lifts off" in found.end.message
    assert found.events[-1].kind == "lift_off" and 0.0 < found.end.t < 1.0
    way = {"start": "q=0.5,dq=18", "duration": 30.0, "samples": 61, "engine": "numpy"}
    late = sk.run(made, "dynamics", **way)
    end = late.summary["simulation"]["end"]
    assert end["kind"] == "lift_off" and end["t"] == pytest.approx(found.end.t, rel=1e-6)
    assert "simulation" in late.summary["cost"]["seconds"]
    assert "search" not in late.summary["cost"]["seconds"]
    torque = float(made.loads[0].torque)
    h, pivot = 1e-4, made.angles["follower_pivot"]
    t = found.end.t - h * np.arange(6)[::-1]
    series = np.polynomial.Polynomial.fit(t, found.at(t).values[:, pivot], 5)
    tensor = 0.01
    assert tensor * series.deriv(2)(found.end.t) == pytest.approx(torque, rel=1e-4)
    with pytest.raises(sk.SpherekitError, match="would have to pull at the start"):
        late = found.at([found.end.t])
        beyond = sk.Start(float(late.q[0]) + 0.05, float(late.dq[0]))
        sk.simulate(made, beyond, 1.0)
