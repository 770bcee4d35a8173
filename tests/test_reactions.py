"""Reactions in the pairs, holding torques and stiffness, against equations of the links."""

import re
from dataclasses import replace

import numpy as np
import pytest
from oracles.newton_euler import newton_euler, row_of_torques, with_masses_and_loads

import spherekit as sk
from spherekit.cli.main import main
from spherekit.dynamics.inverse_dynamics import holding_torques
from spherekit.dynamics.output_stiffness import output_stiffness
from spherekit.dynamics.reactions import reactions
from spherekit.files.time_law import Polynomial
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.timing import evaluate_time_laws
from spherekit.status import Status

STARTS = {
    "two_dof_spm": (0.3, 0.35),
    "three_rrr": (0.9, 1.0, 1.2),
    **dict.fromkeys(("stephenson", "shaped_flat_cam", "roller_cam"), (0.4,)),
}
OTHERS = {
    "five_bar": (1.0, 1.2),
    "bevel_differential": (0.5, 0.4),
    **dict.fromkeys(("four_bar", "planetary_bevel"), (0.4,)),
    "double_butterfly": (0.05,),
}


def moving(made, starts, t, rate=0.3, bend=0.2):
    laws = {
        item.pair: Polynomial((q, rate * (-1) ** k, bend))
        for k, (item, q) in enumerate(zip(made.inputs, starts, strict=True))
    }
    q, timing = evaluate_time_laws(list(laws), laws, np.asarray(t, dtype=float))
    motion = PositionAnalysis(made, None, 0, False, path=q).motion()
    return replace(motion, timing=timing)


@pytest.mark.parametrize("name", [*STARTS, *OTHERS])
def test_newton_and_euler_give_the_same_torques_and_reactions(name):
    made, joint = with_masses_and_loads(name, np.random.default_rng(sum(map(ord, name))))
    made = made.with_inputs(*[item.pair for item in made.inputs])
    found = reactions(moving(made, (STARTS | OTHERS)[name], [0.0, 0.2, 0.4]))
    torques = found.torques
    size = np.nanmax(np.abs(found.moments))
    assert np.max(found.unbalanced) < 1e-12 * size
    assert np.any(found.is_open) == (name == "bevel_differential")
    for row in range(len(torques.t)):
        want = newton_euler(*row_of_torques(torques, row, joint))
        assert torques.torques[row] == pytest.approx(want, rel=1e-10, abs=1e-10)
        if np.any(found.is_open) or any(pair.pressure_angle for pair in made.pairs):
            continue  # the equations leave how teeth press open
        want = newton_euler(*row_of_torques(torques, row, joint), full=True)
        for k, pair in enumerate(made.pairs):
            held = len(want[pair.name])
            got = found.moments[row, k]
            assert got[:held] == pytest.approx(want[pair.name], abs=1e-11 * size)
            if not pair.kind.has_axis:
                assert np.all(got[held:] == 0.0)


def pressed(torque):
    """Return the flat-faced follower with a torque at its pivot and inertia."""
    made = sk.load("flat_cam").with_inputs("cam_shaft")
    tensor = np.diag([0.02, 0.02, 0.01])
    made = made.with_mass("follower", tensor).with_mass("cam", tensor)
    return made.with_loads(sk.PairTorque("press", "follower_pivot", torque))


@pytest.mark.parametrize("torque", ["5", "-5"])
def test_a_contact_presses_away_from_the_side_of_the_first_body(torque):
    made = pressed(torque)
    found = reactions(moving(made, (0.5,), [0.0, 0.1]))
    contact = made.pair_number["contact"]
    frame, moment = found.frames[0, contact], found.moments[0, contact]
    point = frame[:, 2]
    # The force at the point on the follower, of which p x F is the moment.
    force = np.cross(frame @ moment, point)
    cam = made.pair("contact").profiles[0]
    rotation = found.torques.motion.rotations[0, made.link_number["cam"]]
    centre = rotation @ np.array(cam.centre)
    presses = force @ (centre - point) < 0.0
    assert presses == (found.push[0, contact] > 0.0)
    assert np.linalg.norm(force) == pytest.approx(abs(found.push[0, contact]))
    # The follower turns about its pivot: what presses it balances its torque there.
    assert presses == (found.status[0, contact] == Status.OK)
    # In the other mode it is the other way round, in a run of several blocks too.
    run = sk.run(made, "reactions", samples=7, block=3)
    modes = run.frame("reactions").query("status == 'LIFT_OFF'")["assembly_mode"]
    facts = run.summary["analyses"][0]["findings"]["pairs"]["contact"]
    assert {*modes} == {int(presses)} and facts["rows_that_lift_off"] == 7


def test_outputs_yield_by_what_a_moment_does_to_the_inputs():
    """Each input turned by w . m / k, the output moves by the closure itself."""
    made = sk.load("five_bar")
    q, k = np.array([[1.0, 1.2]]), np.array([40.0, 90.0])
    tracer = PositionAnalysis(made, None, 0, path=q)
    held = output_stiffness(holding_torques(tracer.motion()), "3", "1", k)
    axis, stiffness = held.axes[0, 0], held.stiffness[0, 0]
    moment = 1e-6 * axis
    turned = q + (held.w[0] @ moment / k)[None]
    ends = [
        PositionAnalysis(made, None, 0, path=x).motion().rotations[0, 2]
        for x in (q, turned)
    ]
    gap = ends[1] @ ends[0].T
    moved = 0.5 * np.array(
        [gap[2, 1] - gap[1, 2], gap[0, 2] - gap[2, 0], gap[1, 0] - gap[0, 1]]
    )
    assert moved == pytest.approx(moment / stiffness, rel=1e-4, abs=1e-13)


def test_an_output_on_a_crank_is_held_by_its_input_alone():
    made = sk.load("five_bar")
    crank = replace(made.outputs[0], name="crank", link="2", direction=None)
    made = replace(made, outputs=(*made.outputs, crank))
    rows = sk.run(made, "statics", samples=3).frame("statics", "outputs")
    rows = rows.query("output == 'crank' and status == 'OK'")
    assert np.allclose(rows[["advantage_21", "advantage_51"]], [1.0, np.inf]) and len(rows)


def test_redundant_constraints_are_named_and_left_open(capsys):
    assert main(["run", "bevel_differential", "-a", "reactions", "--samples", "3"]) == 0
    said = capsys.readouterr()
    assert "redundant constraints leave open" in said.out
    assert "warning" not in said.out + said.err
    found = sk.run("roller_cam", "reactions", samples=9)
    where = r"([\d.]+) N m in pair (\w+) at sample (\d+) of assembly mode (\d+)"
    ((size, *place),) = re.findall(where, " ".join(found.summary["remarks"]))
    table = found.frame("reactions").astype({"pair": str})
    at = table.set_index(["pair", "sample", "assembly_mode"])["transverse_moment"]
    there = at.loc[(place[0], int(place[1]), int(place[2]))]
    assert there == pytest.approx(at.max())
    assert float(size) == pytest.approx(there, rel=1e-4)
    found = sk.run("four_bar", "statics", samples=9)
    said = " ".join(found.summary["remarks"])
    where = r"torque at 21: (\S+) N m at sample (\d+) of assembly mode (\d+)"
    ((size, *place),) = re.findall(where, said)
    at = found.frame("statics").set_index(["sample", "assembly_mode"])["tau"]
    assert at.loc[tuple(map(int, place))] == pytest.approx(float(size), rel=1e-4)
    assert abs(float(size)) == pytest.approx(at.abs().max(), rel=1e-4)
    found = sk.run("bevel_differential", "reactions", samples=3)
    table = found.frame("reactions")
    assert table["moment_x"].isna().any() and not table["moment_z"].isna().any()


def test_bearings_that_lock_are_refused(tmp_path):
    made, _ = with_masses_and_loads("stephenson", np.random.default_rng(5))
    tight = sk.Bearings("rub", "14", (0.1,), radius=0.5, coefficient=0.9, speed=0.01)
    locked = reactions(moving(made.with_loads(tight), (0.4,), [0.1]))
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
