"""MuJoCo models against MuJoCo itself: poses, forces and motion are what they should be."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call, mechanism_text
from mechanism_examples.shipped_mechanisms import load_without_loads

import spherekit as sk
from spherekit.cli.main import main
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.mjcf import MujocoModel
from spherekit.files.mechanism_reader import loads as read_text
from spherekit.files.mechanism_writer import dumps
from spherekit.mechanism.joint_construction import make_joints
from spherekit.positions.loop_closure import Closure

mujoco = pytest.importorskip("mujoco")


def load_model(text):
    """Return the MuJoCo model of a text, and its data in the reference pose."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def close_loops(mechanism, values, inputs):
    """Close the loops of a mechanism at some inputs by Newton's method.

    Tests compare the result with the pose of MuJoCo.

    Parameters
    ----------
    mechanism
        The mechanism.
    values
        (variables,) joint angles (rad) from which the method starts.
    inputs
        Angles (rad) of the input joints.

    Returns
    -------
    values
        (variables,) joint angles.
    rotations
        (links, 3, 3) rotations of all links.
    """
    driven = [mechanism.angles[item.pair] for item in mechanism.inputs]
    values = values.copy()
    values[driven] = inputs
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    solution = closure.solve(values[None], driven)
    assert solution.closure_residual[0] < 1e-12
    return solution.values[0], closure.linearise(solution.values).rotations[0]


def largest_rotation_gap(mechanism, data, rotations):
    """Return the largest difference of any entry of a link's rotation from MuJoCo's."""
    return max(
        np.max(np.abs(data.body(link).xmat.reshape(3, 3) - rotations[k]))
        for k, link in enumerate(mechanism.links)
    )


@pytest.mark.parametrize(
    ("name", "inputs"),
    [
        ("two_dof_spm", [0.4, 0.3]),
        ("three_rrr", None),
        ("universal_joint", 0.5),
        ("bevel_differential", [0.3, 0.2]),
    ],
)
def test_a_model_has_the_pose_of_the_mechanism_and_motors_at_its_inputs(name, inputs):
    """An exported MuJoCo model has the pose of the mechanism, and motors at its inputs.

    At `inputs` (rad), the rotations of all links are equal and MuJoCo's loops are closed.
    Every link has a visible geometry. `find_pose` closes the mechanism and returns its
    joint angles.
    """
    # Loads have no influence on the pose.
    mechanism, values = find_pose(replace(sk.load(name), loads=()), inputs=inputs)
    model, data = load_model(MujocoModel(mechanism, values).text)
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    rotations = closure.linearise(values[None]).rotations[0]
    assert largest_rotation_gap(mechanism, data, rotations) < 1e-14
    # `efc_pos` are the errors of MuJoCo's constraints, which close the loops.
    assert np.max(np.abs(data.efc_pos), initial=0.0) < 1e-14
    motors = [model.actuator(k).name for k in range(model.nu)]
    assert motors == [item.pair for item in mechanism.inputs]
    bodies_with_geometry = {model.geom_bodyid[k] for k in range(model.ngeom)}
    assert bodies_with_geometry >= {model.body(link).id for link in mechanism.links}


def with_prescribed_inputs(text, inputs):
    """Return a model whose inputs are held by constraints as stiff as its loops."""
    stiffness = re.search(r'solref="[^"]*" solimp="[^"]*"', text)[0]
    constraints = "".join(
        f'<joint joint1="{pair}" polycoef="0 0 0 0 0" {stiffness}/>' for pair in inputs
    )
    return text.replace("</equality>", f"{constraints}</equality>")


@pytest.mark.parametrize(
    "name", ["four_bar", "stephenson", "five_bar", "bevel_differential"]
)
def test_a_motion_of_the_inputs_moves_all_links_as_in_spherekit(name):
    """While the inputs follow a law of time, MuJoCo's links move as those of spherekit.

    MuJoCo closes loops by soft constraints, which leaves differences below 1e-7.
    `with_prescribed_inputs` adds constraints that move the inputs. At every 60th step,
    `close_loops` computes the rotations by spherekit for the inputs that MuJoCo has
    reached.
    """
    mechanism, values = find_pose(replace(sk.load(name), loads=()))
    inputs = [item.pair for item in mechanism.inputs]
    text = MujocoModel(mechanism, values).text
    model, data = load_model(with_prescribed_inputs(text, inputs))
    first_input_constraint = model.neq - len(inputs)
    largest_gap = 0.0
    for step in range(600):
        t = (step + 1) * model.opt.timestep
        angles = [0.4 * np.sin(3 * t) ** 2, 0.5 * t**2][: len(inputs)]
        model.eq_data[first_input_constraint:, 0] = angles
        mujoco.mj_step(model, data)
        if step % 60 == 59:
            mujoco.mj_forward(model, data)
            q = [data.joint(pair).qpos[0] for pair in inputs]
            values, rotations = close_loops(mechanism, values, q)
            gap = largest_rotation_gap(mechanism, data, rotations)
            largest_gap = max(largest_gap, gap)
    # The joints must have moved, or equal poses would say nothing.
    assert np.ptp(data.qpos - model.qpos0) > 0.1
    assert largest_gap < 1e-7


LOADS = (
    sk.Spring("coil", "32", 3.0, 0.2),
    sk.Spring("second_coil", "32", 4.0, -0.1),
    sk.Damper("damper", "43", 0.1),
    sk.PairTorque("brake", "41", "0.5 - 2*(theta_41 - 1)/4 - dtheta_41*3"),
    sk.PointForce("push", "3", (0.1, 0.2, 0.9), ("1", "-2", "3*2"), "ground"),
    sk.PointForce("jet", "4", (0.3, 0.2, 0.1), ("1", "2", "-1"), "link"),
    sk.Moment("twist", "2", ("0.1", "0.2", "0.3"), "ground"),
    sk.Moment("spin", "3", ("0.4", "-0.2", "0.1"), "link"),
)


def test_loads_have_the_power_that_they_say():
    """The power of all loads in an exported MuJoCo model is that of their formulas.

    Power is torque times joint rate, force times velocity of the point, or moment times
    angular velocity. The formulas below have the numbers of `LOADS`.

    MuJoCo's model is a tree of joints. Pair 41 closes the loop of links and has a load. It
    is therefore a joint of a second body of link 4, and a weld joins both bodies.

    Angles and rates of all joints are random and independent. They need not satisfy the
    weld, because the formulas of the loads are true for any angles and rates.
    """
    loaded = replace(sk.load("four_bar"), loads=LOADS)
    mujoco_model = MujocoModel(*find_pose(loaded, inputs=0.7))
    assert not [note for note in mujoco_model.notes if note.startswith("load")]
    model, data = load_model(mujoco_model.text)
    rng = np.random.default_rng(5)
    data.qvel[:] = rng.uniform(-1.0, 1.0, model.nv)
    data.qpos += rng.uniform(-0.3, 0.3, model.nq)
    mujoco.mj_forward(model, data)
    power = data.qvel @ (data.qfrc_actuator + data.qfrc_passive)

    theta = {pair: data.joint(pair).qpos[0] for pair in ("32", "43", "41")}
    rate = {pair: data.joint(pair).qvel[0] for pair in theta}
    # The springs coil and second_coil, with their stiffnesses and rest angles.
    springs = -3.0 * (theta["32"] - 0.2) - 4.0 * (theta["32"] + 0.1)
    expected = springs * rate["32"]
    expected -= 0.1 * rate["43"] ** 2  # damper
    brake = 0.5 - 0.5 * (theta["41"] - 1.0) - 3.0 * rate["41"]
    expected += brake * rate["41"]

    def angular_velocity_and_rotation(link):
        velocity = np.zeros(6)  # angular, then linear
        body = model.body(link).id
        kind = mujoco.mjtObj.mjOBJ_BODY
        mujoco.mj_objectVelocity(model, data, kind, body, velocity, 0)
        return velocity[:3], data.body(link).xmat.reshape(3, 3)

    w2, _ = angular_velocity_and_rotation("2")
    w3, rotation3 = angular_velocity_and_rotation("3")
    w4, rotation4 = angular_velocity_and_rotation("4")
    # The components of push and twist are in ground axes, those of jet and spin in the axes
    # of their link.
    push_velocity = np.cross(w3, rotation3 @ [0.1, 0.2, 0.9])
    expected += push_velocity @ [1.0, -2.0, 6.0]
    jet_velocity = np.cross(w4, rotation4 @ [0.3, 0.2, 0.1])
    expected += jet_velocity @ (rotation4 @ [1.0, 2.0, -1.0])
    expected += w2 @ [0.1, 0.2, 0.3]  # twist
    expected += w3 @ (rotation3 @ [0.4, -0.2, 0.1])  # spin
    assert power == pytest.approx(expected, rel=1e-10)


def test_second_bodies_share_the_inertia_of_their_link():
    """A link that needs a second body for a hinge has the same mass in total."""
    dampers = tuple(sk.Damper(f"d{pair}", pair, 0.1) for pair in ("21", "32", "43", "41"))
    plain, values = find_pose(replace(sk.load("four_bar"), loads=()), inputs=0.7)
    model, _ = load_model(MujocoModel(plain, values).text)
    with_second_body, _ = load_model(
        MujocoModel(replace(plain, loads=dampers), values).text
    )
    assert with_second_body.nv == model.nv + 1 and np.all(
        with_second_body.dof_damping == 0.1
    )
    assert np.sum(with_second_body.body_mass) == pytest.approx(
        np.sum(model.body_mass), rel=1e-14
    )


MASSLESS = mechanism_text("massless_crank")
"""A four-bar with the links c (crank), k and r (rocker), of which the crank has no mass."""

MASSLESS_HEAD = MASSLESS[: MASSLESS.index("[mass.k]")]
MASSLESS_LOADS = MASSLESS[MASSLESS.index("[loads.g]") :]
MASSES = {
    "c": '[mass.c]\nmass = 0.9\narc = ["d", "t"]\nradius = 0.4\n',
    "k": MASSLESS[MASSLESS.index("[mass.k]") : MASSLESS.index("[mass.r]")],
    "r": MASSLESS[MASSLESS.index("[mass.r]") : MASSLESS.index("[loads.g]")],
}


def largest_difference(mechanism, seconds, timestep):
    """Return how far (rad) MuJoCo ends from a simulation, and the notes of the export.

    Both start from rest in the same pose. `seconds` is the duration, `timestep` the step of
    MuJoCo (s). The difference is the largest of all joint angles.
    """
    mechanism, values = find_pose(mechanism)
    mujoco_model = MujocoModel(mechanism, values, timestep=timestep)
    model, data = load_model(mujoco_model.text)
    mujoco.mj_step(model, data, round(seconds / timestep))
    q = tuple(float(values[mechanism.angles[item.pair]]) for item in mechanism.inputs)
    start = sk.Start(q=q, dq=(0.0,) * len(q))
    result = sk.simulate(mechanism, start, seconds, assembly_mode=0)
    end = result.at([seconds])
    # The mechanism must have moved, or a small difference would say nothing.
    assert abs(end.inputs[0][0] - q[0]) > 0.05
    joints = {model.joint(k).name for k in range(model.njnt)}
    differences = []
    for pair, column in mechanism.angles.items():
        if pair in joints:
            differences.append(abs(data.joint(pair).qpos[0] - end.values[0][column]))
    assert len(differences) >= 3
    return max(differences), mujoco_model.notes


@pytest.mark.parametrize("spring", [True, False])
@pytest.mark.parametrize("links", ["ck", "cr", "kr"])
def test_one_link_without_mass_changes_no_motion(links, spring):
    """MuJoCo itself is off by up to 7e-8 rad with masses at all links, at this step."""
    head, loads = MASSLESS_HEAD, MASSLESS_LOADS
    if not spring:
        loads = loads[: loads.index("[loads.s]")]
    mechanism = read_text(head + "".join(MASSES[link] for link in links) + loads, "x.toml")
    worst, notes = largest_difference(mechanism, 0.2, 1e-3)
    assert worst < 2e-7
    assert any("given 1e-09 of the largest inertia" in note for note in notes)
    assert not any("not exact" in note for note in notes)


def test_links_without_mass_that_close_a_loop_are_named():
    """Only the crank has a mass; the spring acts on the others, whose loop is soft."""
    head, loads = MASSLESS_HEAD, MASSLESS_LOADS
    mechanism = read_text(head + MASSES["c"] + loads, "x.toml")
    coarse, notes = largest_difference(mechanism, 0.2, 1e-3)
    fine, _ = largest_difference(mechanism, 0.2, 2.5e-4)
    (said,) = [note for note in notes if "the motion is not exact" in note]
    assert said.endswith(": k, r")
    # As the note says: the error falls with the square of the timestep, here by 16.
    assert 1e-5 < coarse < 5e-3 and fine < coarse / 8


def test_the_command_says_which_links_were_given_a_mass(tmp_path, capsys):
    source, target = tmp_path / "massless.toml", tmp_path / "massless.xml"
    source.write_text(MASSLESS, encoding="utf-8")
    assert main(["export", str(source), "--to", "mjcf", "-o", str(target)]) == 0
    assert "links without mass were given 1e-09 of the largest" in capsys.readouterr().out


HELD = mechanism_text("mjcf_held")
"""Loads and joint limits that MuJoCo cannot have, or has in another form."""


def test_an_export_names_each_load_that_it_leaves_out(tmp_path, capsys):
    """Loads that MuJoCo cannot have are left out and named, on the screen and in the model.

    They are a torque ``motor`` that depends on time, a table ``profile`` of torques over
    time, a torque ``cross`` that depends on the angle of another pair, and a nonlinear
    torque ``swing``. The friction ``bearing`` at pair 32 becomes dry friction of 0.2 N m
    and viscous friction of 0.3 N m s/rad in MuJoCo. The joint limits of pair 41 become soft
    limits. The messages say where these differ from the file.
    """
    path = tmp_path / "held.toml"
    path.write_text(dumps(replace(sk.load("four_bar"), loads=())) + HELD)
    target = tmp_path / "m.xml"
    assert main(["export", str(path), "--to", "mjcf", "-o", str(target)]) == 0
    messages, text = capsys.readouterr().out, target.read_text(encoding="utf-8")
    for name, reason in (
        ("motor", "change in time"),
        ("profile", "no tables in time"),
        ("cross", "depends on other pairs"),
        ("swing", "neither constant"),
    ):
        (line,) = re.findall(rf"load {name} left out: .*", messages)
        assert reason in line and f"load {name} left out" in text
    assert (
        "bearing left out" not in messages
        and "load bearing: MuJoCo's dry friction" in messages
    )
    assert "joint limits of 41 are MuJoCo's soft limits" in messages
    model, _ = load_model(text)
    joint = model.joint("32")
    assert joint.frictionloss[0] == 0.2 and joint.damping[0] == 0.3
    assert model.joint("41").range == pytest.approx([-np.pi / 2, np.pi / 2])


def test_a_mechanism_without_masses_is_held_by_servos():
    """Without masses, servos move the inputs: after a step of 0.3 rad input 12 is there."""
    mechanism, values = find_pose(load_without_loads("stephenson"), inputs=0.5)
    written = MujocoModel(mechanism, values)
    assert "kinematics only" in written.notes[0]
    model, data = load_model(written.text)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[0] += 0.3
    mujoco.mj_step(model, data, 1500)
    assert data.joint("12").qpos[0] == pytest.approx(0.8, abs=1e-3)


def test_servos_keep_a_pose_outside_of_the_range_of_the_input():
    """The control range contains the exported angle, so MuJoCo does not cut it off."""
    mechanism = load_without_loads("stephenson")
    short_range = replace(mechanism.inputs[0], start=0.2, stop=1.0)
    mechanism, values = find_pose(replace(mechanism, inputs=(short_range,)), inputs=1.5)
    model, data = load_model(MujocoModel(mechanism, values).text)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 1000)
    assert data.joint("12").qpos[0] == pytest.approx(1.5, abs=1e-6)


def test_a_model_without_masses_has_none_of_the_loads_that_are_left_out():
    loads = (
        sk.Spring("coil", "41", 3.0, 0.2),
        sk.Damper("damper", "32", 0.1),
        sk.Friction("bearing", "43", 0.1, 0.2, 0.1),
    )
    mechanism = replace(sk.load("four_bar"), masses=(), loads=loads)
    written = MujocoModel(*find_pose(mechanism, inputs=0.7))
    for load in loads:
        assert any(note.startswith(f"load {load.name} left out") for note in written.notes)
    model, _ = load_model(written.text)
    for numbers in (model.jnt_stiffness, model.dof_damping, model.dof_frictionloss):
        assert not np.any(numbers)


@pytest.mark.parametrize("law", ["-0.2*sign(dtheta_41)", "0.1*sign(theta_41 - 1)"])
def test_a_torque_with_a_jump_is_left_out_and_named(law):
    """The derivative of a sign is zero, but its torque is not constant."""
    load = sk.PairTorque("brake", "41", law)
    mechanism = replace(sk.load("four_bar"), loads=(load,))
    written = MujocoModel(*find_pose(mechanism, inputs=0.7))
    assert any(note.startswith("load brake left out") for note in written.notes)
    assert load_model(written.text)[0].nu == 1  # the motor of the input


def test_notes_name_only_elements_that_the_model_has():
    """Springs have no actuators, dampers no sites, so none of them has another name."""
    loads = (sk.Spring("21", "41", 1.0), sk.Damper("rocker", "41", 0.1))
    mechanism = replace(sk.load("four_bar"), loads=loads)
    assert not [
        note for note in MujocoModel(*find_pose(mechanism)).notes if "is called" in note
    ]


@pytest.mark.parametrize("name", ["bevel_pair", "five_bar", "stephenson"])
def test_a_pose_beside_zero_is_exact(name):
    """Bodies are turned by 1e-8 rad as well, of which the cosine is 1 up to rounding."""
    mechanism = replace(sk.load(name), loads=())
    inputs = [1e-8] * len(mechanism.inputs)
    mechanism, values = find_pose(mechanism, inputs=inputs)
    _, data = load_model(MujocoModel(mechanism, values).text)
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    rotations = closure.linearise(values[None]).rotations[0]
    assert largest_rotation_gap(mechanism, data, rotations) < 1e-14


CAM_MASSES = """
[mass.cam]
tensor = [[0.03, 0, 0], [0, 0.03, 0], [0, 0, 0.03]]
[mass.follower]
tensor = [[0.03, 0, 0], [0, 0.03, 0], [0, 0, 0.03]]
"""


@pytest.mark.parametrize("taken", ["cam_shaft", "follower_pivot", "follower"])
def test_a_body_between_circles_has_a_name_of_its_own(taken):
    """It would have the name of a pair or link that is called centres_contact."""
    text = dumps(sk.load("flat_cam")) + CAM_MASSES
    text = re.sub(rf"\b{taken}\b(?! =)", "centres_contact", text)
    mechanism = read_text(text, "x.toml")
    written = MujocoModel(*find_pose(mechanism))
    model, _ = load_model(written.text)
    assert model.body("centres_contact_2").id > 0
    assert model.joint("centres_contact_2").id > 0


def test_the_inertia_of_a_body_between_circles_is_said():
    """The body has 1e-6 of the inertia, and the loop that it closes is soft."""
    mechanism = read_text(dumps(sk.load("flat_cam")) + CAM_MASSES, "x.toml")
    (note,) = [
        note
        for note in MujocoModel(*find_pose(mechanism)).notes
        if "centres_contact" in note
    ]
    assert "1e-06 of the largest inertia" in note and "not exact" in note


def test_poses_take_an_input_for_each_freedom(tmp_path):
    target = tmp_path / "m.xml"
    arguments = ["export", "five_bar", "--to", "mjcf", "-o", str(target), "--at=80,80"]
    assert main(arguments) == 0
    _, data = load_model(target.read_text())
    found = [data.joint(pair).qpos[0] for pair in ("21", "51")]
    assert found == pytest.approx(np.radians([80.0, 80.0]), abs=1e-15)


@pytest.mark.parametrize("call", TABLES["exports"])
def test_what_cannot_be_exported_is_refused(call, tmp_path, monkeypatch):
    """Each call of the table "exports" of `refusals.toml` raises the error stated there."""
    monkeypatch.chdir(tmp_path)
    check_call(call, globals(), TABLES["exports"][call])


def test_the_inertia_of_a_link_without_mass_does_not_depend_on_the_mass_of_the_ground(
    tmp_path,
):
    text = dumps(sk.load("four_bar"))
    text = re.sub(r"\[mass\.3\]\n(\w.*\n)+", "", text)
    heavy_ground = "\n[mass.1]\ntensor = [[1e8, 0, 0], [0, 1e8, 0], [0, 0, 1e8]]\n"
    inertias = []
    for mechanism in (read_text(text, "x.toml"), read_text(text + heavy_ground, "x.toml")):
        sk.export(mechanism, tmp_path / "x.xml")
        model, _ = load_model((tmp_path / "x.xml").read_text(encoding="utf-8"))
        inertias.append(model.body("3").inertia)
    assert np.all(inertias[0] < 1e-7)
    assert inertias[1] == pytest.approx(inertias[0], rel=1e-12)


POINT_MASSES = """
[mass.2]
mass = 1.0
centre = [0.0, 0.0, 0.2]
tensor = [[0.04, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, 0.0, 0.0]]
[mass.4]
mass = 2.0
centre = [0.0, 0.3, 0.0]
tensor = [[0.18, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.18]]
"""


def exported_four_bar(tmp_path, masses):
    """Return the exported model of the four-bar with other masses."""
    text = re.sub(r"\[mass\.\d\]\n(\w.*\n)+", "", dumps(sk.load("four_bar")))
    mechanism = read_text(text + masses, "x.toml")
    sk.export(mechanism, tmp_path / "x.xml")
    model, _ = load_model((tmp_path / "x.xml").read_text(encoding="utf-8"))
    return model


def test_a_link_with_a_point_mass_has_its_inertia_about_the_centre_of_the_sphere(tmp_path):
    model = exported_four_bar(tmp_path, POINT_MASSES)
    for link, mass, distance in (("2", 1.0, 0.2), ("4", 2.0, 0.3)):
        body = model.body(link)
        assert body.mass[0] == mass
        assert np.linalg.norm(body.ipos) == pytest.approx(distance, rel=1e-12)
        assert np.all(body.inertia > 0.0) and np.all(body.inertia < 1e-9)


def test_a_small_mechanism_with_a_link_without_mass_is_read_by_mujoco(tmp_path):
    small = "\n[mass.2]\ntensor = [[2e-6, 0, 0], [0, 2e-6, 0], [0, 0, 2e-6]]\n"
    model = exported_four_bar(tmp_path, small + small.replace("mass.2", "mass.4"))
    assert np.all(model.body("3").inertia < 1e-6 * model.body("2").inertia)
