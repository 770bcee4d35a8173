"""A locked pair makes one link of two: poses, inertia and loads as with it held."""

import numpy as np
import pytest
from newton_euler import body, heavy
from refusals import TABLES, check_call

import spherekit as sk
from spherekit.cli.main import main
from spherekit.model.parts import Input, Output, Pair, PoseGeometry
from spherekit.model.study import ConstantSpeed
from spherekit.motion.motion import PositionAnalysis

CASES = {
    # mechanism: the pair that is locked, at what (rad), and values of the other inputs
    "five_bar": ("51", 1.2, (1.0,)),
    "two_dof_spm": ("61", 0.35, (0.3,)),
    "three_rrr": ("a2", 1.0, (0.9, 1.2)),
}


def pulled(name):
    made = heavy(name)
    return made.with_loads(
        sk.Gravity("weight", (1.0, -2.0, -9.0)),
        sk.PairTorque("pull", made.pairs[1].name, f"0.3 - theta_{CASES[name][0]}"),
    )


@pytest.mark.parametrize(
    "name", ["five_bar", "three_rrr", pytest.param("two_dof_spm", marks=pytest.mark.long)]
)
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
    one = sk.inverse_dynamics(
        made, laws | {p: ConstantSpeed(0.0, q) for p, q in held.items()}, t, assembly_mode=0
    )
    for other in (
        locked,
        sk.load(sk.dump(locked, tmp_path / "locked.toml") or tmp_path / "locked.toml"),
    ):
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
    tracer = PositionAnalysis(locked, path=np.array([[1.0]]))
    found = tracer.motion()
    near = [abs(np.sin(0.5 * (x - 1.2))) for x in found.values[:, locked.angles["51"]]]
    assert min(near) < 1e-12
    geared = sk.load("bevel_differential")
    single = sk.lock(geared, {"right_axle": 0.0}, angle_unit="deg")
    motion = sk.trace(single, samples=5)
    carrier = motion.values[:, single.angles["carrier_axle"]]
    assert carrier == pytest.approx(0.5 * motion.q, abs=1e-12)


def posed_wrist():
    """Return a wrist of three legs given in a reference pose, with masses and loads."""
    random = np.random.default_rng(20261123)
    legs = [
        (f"{kind}{k}", link)
        for k in (1, 2, 3)
        for kind, link in (
            ("a", ("base", f"crank{k}")),
            ("b", (f"crank{k}", f"rod{k}")),
            ("c", (f"rod{k}", "hand")),
        )
    ]
    axes = random.normal(size=(9, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    values = random.uniform(-1.0, 1.0, 9)
    names = [name for name, _ in legs]
    links = tuple(dict.fromkeys(link for _, both in legs for link in both))
    return sk.Mechanism(
        "posed",
        "base",
        links,
        tuple(Pair(name, "R", both) for name, both in legs),
        PoseGeometry(
            dict(zip(names, map(tuple, axes.tolist()), strict=True)),
            dict(zip(names, values.tolist(), strict=True)),
        ),
        inputs=tuple(
            Input(name, at - 0.02, at + 0.02)
            for name, at in zip(names, values.tolist(), strict=True)
            if name[0] == "a"
        ),
        outputs=(Output("tool", "hand", "base", (0.6, 0.0, 0.8)),),
        masses=tuple(body(random, link) for link in links[1:]),
        loads=(
            sk.PointForce("push", "rod2", (0.1, 0.2, 0.3), ("1", "theta_a1", "-2"), "link"),
            sk.Moment("twist", "crank3", ("0", "1", "sin(theta_a3)"), "link"),
            sk.Gravity("weight", (0.3, -1.0, -9.0)),
        ),
    )


def test_a_mechanism_of_a_reference_pose_is_locked_elsewhere(tmp_path):
    """Variables, poses and torques are those with the input held."""
    made = posed_wrist()
    at = made.geometry.values
    locked = sk.lock(made, {"a2": at["a2"] + 0.02}, angle_unit="rad")
    sk.dump(locked, tmp_path / "locked.toml")
    locked = sk.load(tmp_path / "locked.toml")
    t = [0.0, 0.1]
    laws = {"a1": ConstantSpeed(0.2, at["a1"]), "a3": ConstantSpeed(-0.1, at["a3"])}
    whole = sk.inverse_dynamics(
        made, laws | {"a2": ConstantSpeed(0.0, at["a2"] + 0.02)}, t, assembly_mode=0
    )
    found = sk.inverse_dynamics(locked, laws, t)
    shared = [made.angles[name] for name in locked.angles]
    apart = found.motion.values.reshape(-1, 2, len(shared)) - whole.motion.values[:, shared]
    gaps = np.max(np.abs(np.sin(0.5 * apart)), axis=(1, 2))
    mode = int(np.argmin(gaps))
    assert gaps[mode] < 1e-12
    rows = slice(2 * mode, 2 * mode + 2)
    assert found.torques[rows] == pytest.approx(whole.torques[:, [0, 2]], rel=1e-10)
    for link in locked.links:
        one = whole.motion.rotations[:, made.link_number[link]]
        other = found.motion.rotations[rows, locked.link_number[link]]
        assert np.max(np.abs(one - other)) < 1e-12
    assert locked.outputs == made.outputs


def test_commands_lock(tmp_path, capsys):
    held = ["five_bar", "--lock", "51=80"]
    assert main(["run", *held, "-a", "eksergian", "--samples", "5"]) == 0
    assert "input 21" in "".join(capsys.readouterr())
    assert main(["plan", *held]) == main(["validate", *held]) == 0
    model = str(tmp_path / "x.xml")
    assert main(["export", *held, "--to", "mjcf", "--at", "80", "-o", model]) == 0
    capsys.readouterr()
    assert main(["run", "five_bar", "--lock", "51"]) == 1
    assert "--lock" in capsys.readouterr().err
    study = tmp_path / "held.study.toml"
    study.write_text(
        'format = 1\nmechanism = "five_bar"\nangle_unit = "deg"\nsamples = 5\n'
        "[lock]\n51 = 80.0\n[analyses.poles]\n"
    )
    assert [item.pair for item in sk.load_study(study).mechanism.inputs] == ["21"]


def test_locked_mechanisms_are_verified(tmp_path, capsys):
    locked = ["--lock", "51=80", "--samples", "3", "--verify", "2"]
    assert main(["run", "five_bar", *locked]) == 0
    assert "rates lie within their error bound" in capsys.readouterr().out


@pytest.mark.parametrize("call", TABLES["locks"])
def test_what_cannot_be_locked_is_said(call):
    check_call(call, {"sk": sk}, TABLES["locks"][call])
