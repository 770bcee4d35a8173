"""Imported mechanisms against MuJoCo's own kinematics and hand-written files."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import HERE, TABLES, check_call, mechanism_text

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import FileError
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.mjcf import MujocoModel
from spherekit.files.mechanism_reader import load, loads
from spherekit.mechanism.joint_construction import make_joints, make_joints_in_pose
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.positions.loop_closure import Closure

mujoco = pytest.importorskip("mujoco")

PLAIN = [each for each in map(load, sk.mechanisms()) if not each.has_contacts]
"""The shipped mechanisms of R pairs alone."""

GEARED = ("bevel_differential", "bevel_pair", "planetary_bevel", "rolling_cones")

WRIST = (HERE / "files" / "wrist.xml").read_text(encoding="utf-8")

URDF = (HERE / "files" / "two_inputs.urdf").read_text(encoding="utf-8")
LOOPS = tomllib.loads(mechanism_text("import_loops"))


def written(tmp_path, text, name="model.xml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def configurations(made, q):
    """Return the placed links at values of all inputs, followed from the pose."""
    closure = Closure.of_mechanism(made, make_joints(made))
    values = make_joints_in_pose(made)[1].copy()
    held = [made.angles[item.pair] for item in made.inputs]
    start = values[held]
    for part in np.linspace(0.0, 1.0, 5)[1:]:
        values[held] = start + part * (np.asarray(q) - start)
        values = closure.solve(values[None], held).values[0]
    assert closure.at(values[None]).closure_residual[0] < 1e-13
    return closure.at(values[None]).rotations[0]


def closed(mechanism):
    """Return a mechanism with its inputs, and a configuration found by Newton's method."""
    pairs = [mechanism.pairs[k].name for k in driven_pairs(mechanism)]
    mechanism = mechanism.with_inputs(*pairs)
    joints, reference = make_joints_in_pose(mechanism)
    if reference is not None:
        return mechanism, reference
    closure = Closure.of_mechanism(mechanism, joints)
    starts = np.random.default_rng(3).uniform(-2.0, 2.0, (60, len(closure.tree.owners)))
    found = closure.solve(starts, max_steps=40)
    good = found.values[found.closure_residual < 1e-14]
    free = [v for v in range(good.shape[1]) if mechanism.variable_names[v][6:] not in pairs]
    jacobian = closure.at(good).jacobian[:, :, free]
    least = np.linalg.svd(jacobian, compute_uv=False)[:, len(free) - 1]
    return mechanism, good[int(np.argmax(least))]


@pytest.mark.parametrize(
    "mechanism", [*PLAIN, *map(load, GEARED)], ids=lambda each: each.name
)
def test_out_and_in_again_is_the_same_mechanism(mechanism, tmp_path):
    made, values = closed(mechanism)
    path = written(tmp_path, MujocoModel(made, values).text)
    again = sk.import_mechanism(path).mechanism
    assert set(again.links) == set(made.links) and again.ground == made.ground
    assert {pair.name for pair in again.pairs} == {pair.name for pair in made.pairs}
    for one, other in zip(again.inputs, made.inputs, strict=True):
        assert one.pair == other.pair
        assert (one.start, one.stop) == pytest.approx((other.start, other.stop), abs=1e-12)
    closure = Closure.of_mechanism(made, make_joints(made))
    held = [made.angles[item.pair] for item in made.inputs]
    start = closure.at(values[None]).rotations[0]
    moved = values.copy()
    for _ in range(3):
        moved[held] += 0.02
        found = closure.solve(moved[None], held)
        assert found.closure_residual[0] < 1e-13
        moved = found.values[0]
    here = closure.at(moved[None]).rotations[0]
    there = configurations(again, moved[held])
    for link in made.links:
        k = made.link_number[link]
        assert here[k] @ start[k].T == pytest.approx(
            there[again.link_number[link]], abs=1e-12
        )


def test_loads_and_masses_come_back(tmp_path):
    loads_there = (
        sk.Gravity("gravity", (1.0, 2.0, -9.0)),
        sk.Spring("spring_32", "32", 3.0, 0.2),
        sk.Damper("damper_51", "51", 0.1),
        sk.Friction("friction_43", "43", 0.2, 0.3, 0.01),
        sk.PairTorque("brake", "21", "0.5 - 0.25*theta_21 - 3*dtheta_21"),
        sk.PointForce("push", "3", (0.1, 0.2, 0.9), ("1", "-2", "6"), "ground"),
        sk.Moment("spin", "4", ("0.4", "-0.2", "0.1"), "link"),
    )
    mechanism = replace(
        load("five_bar"), loads=loads_there, joint_limits=(JointLimit("54", -2.0, 0.5),)
    )
    made, values = find_pose(mechanism, inputs=[1.2, 1.3])
    again = sk.import_mechanism(written(tmp_path, MujocoModel(made, values).text)).mechanism
    found = {load.name: load for load in again.loads}
    for load_there in loads_there[:4]:
        one, other = (
            np.hstack([x for x in vars(item).values() if not isinstance(x, str)])
            for item in (found[load_there.name], load_there)
        )
        assert one == pytest.approx(other, rel=1e-13)
    assert {*found} == {load.name for load in loads_there}
    (limit,) = again.joint_limits
    assert (limit.low, limit.high) == pytest.approx((-2.0, 0.5), rel=1e-13)
    placed = Closure.of_mechanism(made, make_joints(made)).at(values[None]).rotations[0]
    for mass in made.masses:
        turn = placed[made.link_number[mass.link]]
        other = next(each for each in again.masses if each.link == mass.link)
        assert other.mass == pytest.approx(mass.mass, rel=1e-12)
        assert other.centre == pytest.approx(turn @ mass.centre, abs=1e-13)
        tensor = turn @ np.array(mass.tensor) @ turn.T
        assert np.array(other.tensor) == pytest.approx(tensor, abs=3e-15)
    # The power of every load at some state is that of the file that was exported.
    kinematics = [_power(made, values, placed), _power(again, None, None)]
    assert kinematics[0] == pytest.approx(kinematics[1], rel=1e-11)


def _power(mechanism, values, placed):
    """Return the power of each load by name, while input 21 turns at 1 rad/s."""
    from spherekit.dynamics.coordinates import motion_by_variables
    from spherekit.dynamics.generalised_forces import Loads

    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    values = make_joints_in_pose(mechanism)[1] if values is None else values
    held = [mechanism.angles[item.pair] for item in mechanism.inputs]
    motion = motion_by_variables(closure, values[None], held)
    loads_here = Loads(mechanism)
    velocities = loads_here.velocities(motion)[0, 0]
    found = {}
    for owner, part, rate in zip(
        loads_here.owners, loads_here.components, velocities, strict=True
    ):
        known = {"t": np.zeros(1)}
        for k, name in enumerate(mechanism.variable_names):
            known[name] = motion.values[:, k]
            known[f"d{name}"] = motion.rates[:, 0, k]
        power = float(part.magnitude.evaluate(known)[0]) * rate
        name = loads_here.names[owner]
        found[name] = found.get(name, 0.0) + power
    return found


GEARS = (HERE / "files" / "import_gears.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize("ratio", [-0.5, 0.5, 3.0, -1.0])
def test_joints_at_a_constant_ratio_are_gears(ratio, tmp_path):
    text = GEARS.format(axis="0 0.6 0.8", ratio=ratio, bent=0)
    made = sk.import_mechanism(written(tmp_path, text)).mechanism
    (contact,) = [pair for pair in made.pairs if pair.type == "Cr"]
    rate = sk.evaluate(made, 0.3, poles=[], assembly_mode=0).variable_coefficient("two")
    assert rate == pytest.approx(ratio, abs=1e-12)
    sizes = np.sin([profile.radius for profile in contact.profiles])
    by_link = dict(zip(contact.links, sizes, strict=True))
    assert by_link["one"] / by_link["two"] == pytest.approx(abs(ratio), rel=1e-12)


def test_a_serial_wrist_turns_as_in_mujoco(tmp_path, capsys):
    path = written(tmp_path, WRIST)
    target = tmp_path / "wrist.toml"
    assert main(["import", str(path), "-o", str(target)]) == 0
    assert "feedback of actuator" in capsys.readouterr().err
    made = load(target)
    assert made.links == ("stand", "fork", "hand_pitch", "hand")
    assert [item.pair for item in made.inputs] == ["yaw", "roll", "pitch"]
    limits = {item.pair: np.degrees([item.start, item.stop]) for item in made.inputs}
    assert limits["yaw"] == pytest.approx([-60.0, 60.0])
    assert limits["pitch"] == pytest.approx(np.degrees([-0.7, 0.5]))
    text = target.read_text(encoding="utf-8")
    assert "centre of the sphere is at 0.1, 0.2, 0.4 m" in text
    model = mujoco.MjModel.from_xml_string(WRIST)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = {name: data.body(name).xmat.reshape(3, 3).copy() for name in ("fork", "hand")}
    data.qpos[:] = [0.3, -0.4, 0.7]
    mujoco.mj_forward(model, data)
    placed = configurations(made, [0.3, 0.7, -0.4])
    for name, before in start.items():
        turned = data.body(name).xmat.reshape(3, 3) @ before.T
        assert placed[made.link_number[name]] == pytest.approx(turned, abs=1e-14)
    hand = next(mass for mass in made.masses if mass.link == "hand")
    assert hand.mass == pytest.approx(0.3)
    kinds = {load.name: load.kind for load in made.loads}
    assert kinds == {
        "gravity": "gravity",
        "damper_yaw": "damper",
        "spring_pitch": "spring",
        "friction_roll": "friction",
    }


@pytest.mark.parametrize("loop", LOOPS)
def test_a_urdf_closes_loops_by_elements_in_use(loop, tmp_path):
    path = written(tmp_path, URDF.format(pivot=-0.1, loop=LOOPS[loop]), "wrist.urdf")
    found = sk.import_mechanism(path)
    made = found.mechanism
    assert [item.pair for item in made.inputs] == ["left_axle", "right_axle"]
    assert made.links == ("base", "left", "left_rod", "right", "hand")
    pairs = {"left_axle", "left_elbow", "right_axle", "pivot", "tip"}
    assert {pair.name for pair in made.pairs} == pairs
    assert np.abs(made.geometry.axes["tip"]) == pytest.approx([0.0, 0.0, 1.0])
    assert made.masses[0].tensor[0] == pytest.approx((1e-4 + 0.2 * 0.0029, 0.0, 0.0))
    assert loads(found.text).pairs == made.pairs
    motion = sk.evaluate(made, [[0.2, 0.1]], assembly_mode=0)
    assert motion.status[0] == sk.Status.OK


def test_axes_that_miss_are_refused_with_their_distances(tmp_path, capsys):
    path = written(tmp_path, URDF.format(pivot=-0.09, loop=LOOPS["origins"]), "off.urdf")
    assert main(["import", str(path), "-o", str(tmp_path / "x.toml")]) == 1
    said = capsys.readouterr().err
    assert (
        "do not meet in a point" in said and "4 of 5 pass the point 0.0, 0.0, 0.3" in said
    )
    assert "joint pivot: 0.01 m" in said and "joint left_axle: 0 m" in said
    assert not (tmp_path / "x.toml").exists()
    assert sk.import_mechanism(path, within=0.02).mechanism.pairs


WORLD = "<mujoco><worldbody>{}</worldbody></mujoco>"


def imported(text, name="model.xml"):
    return sk.import_mechanism(written(Path(), text, name))


@pytest.mark.parametrize("call", TABLES["imports"])
def test_what_is_no_spherical_mechanism_is_refused(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_call(call, globals(), TABLES["imports"][call])


def test_a_loop_that_is_open_in_the_file_is_closed(tmp_path):
    """The tip on the hand is 0.2 rad away from that on the rod where joints are zero."""
    place = f"{0.1 * np.sin(0.2)} 0 {0.1 * np.cos(0.2) - 0.2}"
    loop = LOOPS["two link1"].replace("0 0 -0.1", place)
    found = sk.import_mechanism(
        written(tmp_path, URDF.format(pivot=-0.1, loop=loop), "wrist.urdf")
    )
    assert "loops are open in the file's pose" in found.text
    axes = {name: np.array(axis) for name, axis in found.mechanism.geometry.axes.items()}
    assert axes["tip"] @ axes["left_elbow"] == pytest.approx(0.8, abs=1e-13)
    wanted = 0.6 * np.sin(0.2) + 0.8 * np.cos(0.2)
    assert axes["tip"] @ axes["pivot"] == pytest.approx(wanted, abs=1e-13)
    assert axes["left_axle"] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)
    values = found.mechanism.geometry.values
    assert "left_axle" not in values and abs(values["pivot"]) > 0.01


def test_a_model_whose_joints_are_all_locked_is_refused(tmp_path):
    path = written(
        tmp_path,
        '<mujoco><worldbody><body name="a"><joint name="j"/>'
        '<inertial mass="1" pos="0.1 0 0" diaginertia="1 1 1"/></body></worldbody>'
        '<equality><joint joint1="j"/></equality></mujoco>',
    )
    with pytest.raises(FileError, match="nothing moves: all joints are locked"):
        sk.import_mechanism(path)
