"""A locked pair makes one link of two: poses, inertia and loads as with it held."""

import json

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call, mechanism_text
from mechanism_examples.named_mechanisms import posed_three_rrr
from oracles.newton_euler import with_point_masses

import spherekit as sk
from spherekit.cli.main import main
from spherekit.files.mechanism_reader import loads
from spherekit.files.time_law import ConstantSpeed
from spherekit.positions.position_analysis import PositionAnalysis

CASES = {
    # mechanism: the pair that is locked, at what (rad), and values of the other inputs
    "five_bar": ("51", 1.2, (1.0,)),
    "two_dof_spm": ("61", 0.35, (0.3,)),
    "three_rrr": ("a2", 1.0, (0.9, 1.2)),
    "posed": ("a2", -0.38, (0.3, 0.0)),
}


def pulled(name):
    made = (
        with_point_masses(posed_three_rrr()) if name == "posed" else with_point_masses(name)
    )
    return made.with_loads(
        sk.Gravity("weight", (1.0, -2.0, -9.0)),
        sk.PairTorque("pull", made.pairs[1].name, f"0.3 - theta_{CASES[name][0]}"),
    )


LONG = pytest.param("two_dof_spm", marks=pytest.mark.long)


@pytest.mark.many
@pytest.mark.parametrize("name", ["five_bar", "three_rrr", "posed", LONG])
def test_poses_and_torques_are_those_with_the_input_held(name, tmp_path):
    pair, value, others = CASES[name]
    made = pulled(name)
    locked = sk.lock(made, {pair: value}, angle_unit="rad")
    assert len(locked.links) == len(made.links) - 1
    assert len(locked.inputs) == len(made.inputs) - 1
    held = {item.pair: value for item in made.inputs if item.pair == pair}
    free = [item.pair for item in made.inputs if item.pair != pair]
    laws = {
        p: ConstantSpeed(0.4 - 0.7 * k, q)
        for k, (p, q) in enumerate(zip(free, others, strict=True))
    }
    t = [0.0, 0.1]
    sk.dump(locked, tmp_path / "locked.toml")
    every = laws | {p: ConstantSpeed(0.0, q) for p, q in held.items()}
    one = sk.inverse_dynamics(made, every, t, assembly_mode=0)
    for other in (locked, sk.load(tmp_path / "locked.toml")):
        found = sk.inverse_dynamics(other, laws if len(laws) > 1 else laws[free[0]], t)
        turns = found.motion.rotations
        links = [made.link_number[link] for link in other.links]
        apart = turns[:: len(t)] - one.motion.rotations[0, links]
        gaps = np.max(np.abs(apart), axis=(1, 2, 3))
        row = int(np.argmin(gaps)) * len(t)
        assert np.min(gaps) < 1e-12
        for link in other.links:
            a = one.motion.rotations[:, made.link_number[link]]
            b = turns[row : row + len(t), other.link_number[link]]
            assert np.max(np.abs(a - b)) < 1e-12
        keep = [k for k, item in enumerate(made.inputs) if item.pair != pair]
        M = one.M[:, keep][:, :, keep]
        assert found.M[row : row + len(t)] == pytest.approx(M, rel=1e-11)
        torques = found.torques[row : row + len(t)]
        assert torques == pytest.approx(one.torques[:, keep], rel=1e-11, abs=1e-11)


def test_a_pair_between_moving_links_and_one_beside_a_contact():
    made = sk.load("five_bar")
    held = PositionAnalysis(made, path=np.array([[1.0, 1.2]]), assembly_mode=0).motion()
    coupler = float(held.values[0, made.angles["43"]])
    locked = sk.lock(made, {"43": coupler}, angle_unit="rad").with_inputs("21")
    found = PositionAnalysis(locked, path=np.array([[1.0]])).motion()
    near = [abs(np.sin(0.5 * (x - 1.2))) for x in found.values[:, locked.angles["51"]]]
    assert min(near) < 1e-12
    geared = sk.load("bevel_differential")
    single = sk.lock(geared, {"right_axle": 0.0}, angle_unit="deg")
    motion = sk.trace(single, samples=5)
    carrier = motion.values[:, single.angles["carrier_axle"]]
    assert carrier == pytest.approx(0.5 * motion.q, abs=1e-12)
    wheels = loads(mechanism_text("geared_five_bar_wheels").format(20, 30, 0, 360))
    assert "5" in sk.lock(wheels, {"54": 20.0}, angle_unit="deg").links  # it has a contact


@pytest.mark.slow
def test_commands_lock(tmp_path, capsys):
    held = ["five_bar", "--lock", "51=80"]
    assert main(["run", *held, "-a", "eksergian", "--samples", "5"]) == 0
    assert "input 21" in "".join(capsys.readouterr())
    assert main(["plan", *held]) == main(["validate", *held]) == 0
    model = str(tmp_path / "x.xml")
    assert main(["export", *held, "--to", "mjcf", "--at", "80", "-o", model]) == 0
    study = tmp_path / "held.study.toml"
    study.write_text(
        'format = 1\nmechanism = "five_bar"\nangle_unit = "deg"\nsamples = 5\n'
        "[lock]\n51 = 80.0\n[analyses.poles]\n"
    )
    assert [item.pair for item in sk.load_study(study).mechanism.inputs] == ["21"]
    pytest.importorskip("flint")
    proven = tmp_path / "x.json"
    assert main(["certify", *held, "--at", "40", "-o", str(proven)]) == 0
    # The sizes of the link that two become are rounded to the file's digits.
    assert json.loads(proven.read_text())["tolerance_rad"] == 1e-14


@pytest.mark.parametrize("call", TABLES["locks"])
def test_what_cannot_be_locked_is_said(call):
    check_call(call, {"sk": sk}, TABLES["locks"][call])
