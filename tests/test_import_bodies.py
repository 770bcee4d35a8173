"""Ball joints, armatures, missing meshes and outputs of MuJoCo models that are imported."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import HERE

import spherekit as sk
from spherekit.cli.main import main
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.mjcf import MujocoModel
from spherekit.mechanism.elements import Output

mujoco = pytest.importorskip("mujoco")

PARALLEL_WRIST = (HERE / "files" / "spm45_ball.xml").read_text(encoding="utf-8")
WRIST = (HERE / "files" / "wrist.xml").read_text(encoding="utf-8")


def import_text(tmp_path, text):
    """Return what a MuJoCo model becomes."""
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    return sk.import_mechanism(path)


def test_a_ball_joint_at_the_centre_is_left_out_by_the_command(tmp_path, capsys):
    target = tmp_path / "wrist.toml"
    source = HERE / "files" / "spm45_ball.xml"
    assert main(["import", str(source), "-o", str(target)]) == 0
    assert "ball joint centre left out" in capsys.readouterr().out
    mechanism = sk.load(target)
    names = {"m1", "w1", "m2", "w2", "m3", "w3", "loop0", "loop1", "loop2"}
    assert {pair.name for pair in mechanism.pairs} == names
    assert [output.link for output in mechanism.outputs] == ["platform"]
    # The forward kinematics of a 3-RRR wrist has at most 8 solutions.
    state = sk.evaluate(mechanism, [[0.1, -0.2, 0.15]])
    assert np.sum(state.status == sk.Status.OK) == 8


def orientations_by_mujoco(text, angles):
    """Return the rotation (3, 3) of the platform from its first pose, by MuJoCo alone.

    It is the reference for an imported model. The inputs m1 to m3 turn to `angles` (rad) in
    ten steps. After each, Newton's method closes the loops: it moves all other joints until
    the equality constraints of the model (residual `efc_pos`, Jacobian `efc_J`) are met.
    """
    input_joints = ("m1", "m2", "m3")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    first_orientation = data.body("platform").xmat.reshape(3, 3).copy()
    input_dofs = [model.joint(name).dofadr[0] for name in input_joints]
    free_dofs = [dof for dof in range(model.nv) if dof not in input_dofs]
    for fraction in np.linspace(0.0, 1.0, 11)[1:]:
        for name, angle in zip(input_joints, angles, strict=True):
            data.joint(name).qpos[0] = fraction * angle
        for _ in range(8):
            mujoco.mj_forward(model, data)
            jacobian = data.efc_J.reshape(data.nefc, model.nv)[:, free_dofs]
            step = np.zeros(model.nv)
            # Least squares, because the constraints of loops repeat one another.
            step[free_dofs] = -np.linalg.lstsq(jacobian, data.efc_pos, rcond=1e-9)[0]
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
    mujoco.mj_forward(model, data)
    assert np.max(np.abs(data.efc_pos)) < 1e-12
    return data.body("platform").xmat.reshape(3, 3) @ first_orientation.T


@pytest.mark.parametrize("angles", [(0.1, 0.1, 0.1), (0.3, -0.2, 0.1), (-0.2, 0.25, 0.4)])
def test_a_wrist_on_a_ball_turns_as_in_mujoco(angles, tmp_path):
    mechanism = import_text(tmp_path, PARALLEL_WRIST).mechanism
    expected = orientations_by_mujoco(PARALLEL_WRIST, angles)
    start = sk.evaluate(mechanism, [[0.0, 0.0, 0.0]])
    state = sk.evaluate(mechanism, [angles])
    # The pose of the file is the one without rotation; its axes are those of the ground.
    assert any(np.allclose(each, np.eye(3), atol=1e-9) for each in rotations(start))
    assert min(np.max(np.abs(each - expected)) for each in rotations(state)) < 1e-7


def rotations(state):
    """Return the orientations of the platform in all assembly modes."""
    rows = state.rotation("platform")
    return rows[np.isfinite(rows[:, 0, 0])]


SERIAL = """<mujoco model="serial"><worldbody><body name="fork">
<joint name="yaw" axis="0 0 1"/><geom size="0.1" pos="0.2 0 0"/>
<body name="hand"><joint name="neck" type="ball"{ball}/><geom size="0.1" pos="0 0.2 0"/>
</body></body></worldbody>{rest}</mujoco>"""


def test_a_ball_joint_that_alone_holds_a_link_is_three_hinges(tmp_path):
    found = import_text(tmp_path, SERIAL.format(ball="", rest=""))
    names = [pair.name for pair in found.mechanism.pairs]
    assert names == ["yaw", "neck_x", "neck_y", "neck_z"]
    assert "ball joint neck is three hinges" in found.text
    assert [output.link for output in found.mechanism.outputs] == ["hand"]


def test_what_a_ball_joint_had_is_said(tmp_path):
    rest = (
        '<actuator><motor name="twist" joint="neck" gear="0 0 1 0 0 0"/></actuator>'
        '<sensor><ballquat joint="neck"/></sensor>'
        '<keyframe><key qpos="0 1 0 0 0"/></keyframe>'
    )
    text = SERIAL.format(ball=' damping="0.1" range="0 30" limited="true"', rest=rest)
    found = import_text(tmp_path, text)
    assert "ball joint neck: its limit, its damper left out" in found.text
    assert "actuator twist left out: it drives a ball joint" in found.text


def test_a_range_of_a_ball_joint_is_a_limit_that_is_lost(tmp_path):
    found = import_text(tmp_path, SERIAL.format(ball=' range="0 30"', rest=""))
    assert "ball joint neck: its limit left out" in found.text


def test_actuators_of_ball_joints_are_left_out_with_their_sensors(tmp_path):
    rest = (
        '<actuator><motor joint="neck" gear="0 0 1 0 0 0"/>'
        '<motor name="twist" joint="neck" gear="0 1 0 0 0 0"/></actuator>'
        '<sensor><actuatorfrc actuator="twist"/></sensor>'
    )
    text = SERIAL.format(ball="", rest=rest)
    found = import_text(tmp_path, text)
    left_out = [note.partition(" left out")[0] for note in found.notes if "drives" in note]
    assert left_out == ["actuator actuator0", "actuator twist"]


def test_hinges_of_a_ball_joint_have_names_of_their_own(tmp_path):
    text = SERIAL.format(ball="", rest="").replace('"yaw"', '"neck_y"')
    found = import_text(tmp_path, text)
    names = [pair.name for pair in found.mechanism.pairs]
    assert names == ["neck_y", "neck_x", "neck_y_2", "neck_z"]
    assert "is three hinges, neck_x, neck_y_2, neck_z" in found.text


def test_a_ball_joint_away_from_the_centre_is_refused(tmp_path):
    text = PARALLEL_WRIST.replace('name="centre" type="ball"', 'type="ball" pos="0 0 0.01"')
    with pytest.raises(sk.SpherekitError, match="do not meet in one point") as refused:
        import_text(tmp_path, text)
    assert "joint ball0_x: 0.01 m" in str(refused.value)


# Armature


def torque_by_mujoco(text, joint, q, dq, ddq):
    """Return the torque (N m) at each joint by MuJoCo's inverse dynamics."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse[model.joint(joint).dofadr[0]]


ARMATURE = (
    '<mujoco model="one"><compiler angle="radian"/><worldbody><body name="arm">'
    '<joint name="turn" axis="{axis}" armature="{armature}"/>'
    '<geom size="0.05" pos="0.2 0.1 0.3" mass="{mass}"/></body></worldbody>'
    '<actuator><motor joint="turn"/></actuator></mujoco>'
)


@pytest.mark.parametrize("axis", ["0 0 1", "1 2 -2"])
@pytest.mark.parametrize(("mass", "armature"), [(0.4, 0.001), (0.4, 2.0), (0.01, 0.03)])
def test_an_armature_on_the_ground_is_kept(axis, mass, armature, tmp_path):
    text = ARMATURE.format(axis=axis, mass=mass, armature=armature)
    found = import_text(tmp_path, text)
    assert "armature" not in found.text
    law = sk.Polynomial((0.2, 0.5, 0.35))
    torques = sk.inverse_dynamics(found.mechanism, law, [0.0]).torques
    expected = torque_by_mujoco(text, "turn", 0.2, 0.5, 0.7)
    assert np.ravel(torques)[0] == pytest.approx(expected, rel=1e-9)


def test_an_armature_on_a_moving_link_is_said(tmp_path):
    text = WRIST.replace('name="pitch"', 'name="pitch" armature="0.02"')
    found = import_text(tmp_path, text)
    assert (
        "armature of joint pitch left out, 0.02 kg m2: the link that carries" in found.text
    )


# Missing files

MESHED = """<mujoco model="meshed"><compiler meshdir="assets" {compiler}/><asset>
<mesh name="hand" file="hand.stl"/><mesh file="fork.obj"/>
<texture name="wood" type="2d" file="wood.png"/><material name="oak" texture="wood"/>
<texture type="skybox" file="sky.png"/>
<hfield name="hill" file="hill.png" size="1 1 1 1"/></asset>
<worldbody><geom type="hfield" hfield="hill"/><geom type="mesh" mesh="hand"/>
<body name="fork"><joint name="yaw" axis="0 0 1"/>{fork}
<geom type="mesh" mesh="fork" material="oak"/>
<body name="hand"><joint name="pitch" axis="0 1 0"/>{hand}
<geom type="mesh" mesh="hand" {geom}/></body></body></worldbody></mujoco>"""
INERTIAL = '<inertial pos="0 0 0.1" mass="{}" diaginertia="0.01 0.01 0.01"/>'


def test_meshes_may_be_missing_where_inertias_are_given(tmp_path):
    text = MESHED.format(
        compiler="", fork=INERTIAL.format(2), hand=INERTIAL.format(3), geom=""
    )
    found = import_text(tmp_path, text)
    assert {mass.link: mass.mass for mass in found.mechanism.masses} == {
        "fork": 2,
        "hand": 3,
    }
    assert "missing" not in found.text


@pytest.mark.parametrize(
    ("compiler", "hand", "geom", "named"),
    [
        ("", "", "", ["hand"]),
        ("", "", 'mass="0"', []),
        ("", "", 'density="0"', []),
        ('inertiafromgeom="true"', INERTIAL.format(3), "", ["fork", "hand"]),
        ('inertiagrouprange="0 1"', "", 'group="2"', []),
    ],
)
def test_a_mass_that_is_in_a_missing_mesh_is_named(compiler, hand, geom, named, tmp_path):
    text = MESHED.format(compiler=compiler, fork=INERTIAL.format(2), hand=hand, geom=geom)
    found = import_text(tmp_path, text)
    assert re.findall(r"the mass of body (\w+) lacks that of mesh", found.text) == named


def test_a_body_without_name_whose_mesh_is_missing_has_its_number(tmp_path):
    text = MESHED.format(compiler="", fork=INERTIAL.format(2), hand="", geom="")
    found = import_text(tmp_path, text.replace('<body name="hand">', "<body>"))
    assert "the mass of body body2 lacks that of mesh hand" in found.text


def test_contacts_and_sensors_of_missing_meshes_are_left_out(tmp_path):
    text = MESHED.format(
        compiler="", fork=INERTIAL.format(2), hand=INERTIAL.format(3), geom='name="palm"'
    )
    text = text.replace("<worldbody>", '<worldbody><geom name="floor" size="1"/>')
    text = text.replace(
        "</mujoco>",
        '<contact><pair geom1="floor" geom2="palm"/></contact>'
        '<sensor><framepos objtype="geom" objname="palm"/></sensor></mujoco>',
    )
    pairs = import_text(tmp_path, text).mechanism.pairs
    assert [pair.name for pair in pairs] == ["yaw", "pitch"]


# Numbers that are not finite

HAND = """<mujoco model="one"><compiler angle="radian" {compiler}/><worldbody>
<body name="hand"><joint name="turn" axis="0 0 1"/>{inertial}<geom size="0.1" {geom}/>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("number", ["nan", "inf"])
@pytest.mark.parametrize(
    "tensor", ["{} 1 1 0 0 0", "1 1 {} 0 0 0", "1 1 1 {} 0 0", "1 1 1 0 0 {}"]
)
def test_a_tensor_that_is_not_finite_is_refused(number, tensor, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log there.
    tensor = tensor.format(number)
    inertial = f'<inertial pos="0 0 1" mass="2" fullinertia="{tensor}"/>'
    text = HAND.format(compiler="", inertial=inertial, geom="")
    with pytest.raises(sk.SpherekitError, match=f"body hand: found {number}, expected fin"):
        import_text(tmp_path, text)
    # MuJoCo does not use the tensor here.
    text = HAND.format(compiler='inertiafromgeom="true"', inertial=inertial, geom="")
    assert len(import_text(tmp_path, text).mechanism.masses) == 1


@pytest.mark.parametrize(
    ("inertial", "geom"),
    [
        ('<inertial pos="nan 0 1" mass="2" diaginertia="1 1 1"/>', ""),
        ('<inertial pos="0 0 1" mass="nan" diaginertia="1 1 1"/>', ""),
        ("", 'density="nan"'),
    ],
)
def test_a_mass_that_is_not_finite_is_refused(inertial, geom, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = HAND.format(compiler="", inertial=inertial, geom=geom)
    with pytest.raises(sk.SpherekitError, match="body hand: found nan, expected finite"):
        import_text(tmp_path, text)


# Outputs


def test_outputs_come_back(tmp_path):
    outputs = (
        Output("tip", "3", "1", direction=(0.6, 0.0, 0.8)),
        Output("between", "4", "2"),
    )
    mechanism = replace(sk.load("four_bar"), outputs=outputs)
    made, values = find_pose(mechanism, inputs=0.7)
    again = import_text(tmp_path, MujocoModel(made, values).text).mechanism
    found = {output.name: output for output in again.outputs}
    assert set(found) == {"tip", "between"}
    assert (found["between"].link, found["between"].relative_to) == ("4", "2")
    placed = sk.evaluate(made, 0.7, assembly_mode=0)
    direction = placed.rotation("3") @ [0.6, 0.0, 0.8]
    assert found["tip"].direction == pytest.approx(direction, abs=1e-12)


TREE = """<mujoco model="tree"><worldbody><body name="neck"><joint name="yaw" axis="0 0 1"/>
<geom size="0.1" pos="0 0 1"/>
<body name="left"><joint name="l" axis="1 0 0"/><geom size="0.1" pos="0 1 1"/></body>
<body name="right"><joint name="r" axis="0 1 0"/><geom size="0.1" pos="1 0 1"/></body>
</body></worldbody></mujoco>"""


def test_the_last_links_of_a_tree_are_outputs(tmp_path):
    mechanism = import_text(tmp_path, TREE).mechanism
    assert [output.link for output in mechanism.outputs] == ["left", "right"]


@pytest.mark.parametrize("object_type", ["body", "xbody"])
@pytest.mark.parametrize("reference", ["", 'reftype="{}" refname="neck"'])
def test_links_whose_orientation_is_read_are_outputs(object_type, reference, tmp_path):
    sensor = (
        f'<framequat name="view" objtype="{object_type}" objname="left" '
        f"{reference.format(object_type)}/>"
    )
    text = TREE.replace("</mujoco>", f"<sensor>{sensor}</sensor></mujoco>")
    (output,) = import_text(tmp_path, text).mechanism.outputs
    assert (output.name, output.link) == ("view", "left")
    assert output.relative_to == ("neck" if reference else "ground")
