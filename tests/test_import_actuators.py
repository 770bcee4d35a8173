"""Actuators and disabled constraints of MuJoCo models that are imported.

Ranges of servos are compared with MuJoCo: at an end of the range, its force is zero.
"""

import numpy as np
import pytest

import spherekit as sk

mujoco = pytest.importorskip("mujoco")

WRIST = """<mujoco model="wrist"><compiler angle="radian"/><option gravity="0 0 0">
<flag {flag}/></option><worldbody>
<body name="fork"><joint name="yaw" axis="0 0 1"/><geom size="0.1" pos="0.2 0 0"/>
<body name="hand"><joint name="pitch" axis="0 1 0"/><geom size="0.1" pos="0 0.2 0"/>
</body></body></worldbody><equality>{equality}</equality>
<actuator>{actuators}</actuator></mujoco>"""


def wrist(actuators="", equality="", flag=""):
    """Return a wrist with two hinges as a MuJoCo model."""
    flag = flag or 'gravity="enable"'
    return WRIST.format(actuators=actuators, equality=equality, flag=flag)


def import_text(tmp_path, text):
    """Return what a MuJoCo model becomes."""
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    return sk.import_mechanism(path)


def range_of(mechanism, pair):
    """Return the ends of the range (rad) of an input."""
    (item,) = (item for item in mechanism.inputs if item.pair == pair)
    return item.start, item.stop


def torque_by_mujoco(text, angle, control, is_activation):
    """Return the torque (N m) of all actuators at the hinge pitch at rest."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.joint("pitch").qpos[0] = angle
    if is_activation:
        data.act[0] = control
    else:
        data.ctrl[0] = control
    mujoco.mj_forward(model, data)
    return data.qfrc_actuator[model.joint("pitch").dofadr[0]]


@pytest.mark.parametrize(
    ("actuator", "controls"),
    [
        ('<position joint="pitch" kp="5" ctrlrange="-0.5 1"/>', (-0.5, 1.0)),
        ('<position joint="pitch" kp="5" ctrlrange="-0.5 1" gear="2"/>', (-0.5, 1.0)),
        ('<position joint="pitch" kp="5" ctrlrange="-0.5 1" gear="-2"/>', (1.0, -0.5)),
        ('<position jointinparent="pitch" kp="5" ctrlrange="-0.5 1"/>', (-0.5, 1.0)),
        (
            '<general joint="pitch" gainprm="10" biastype="affine" biasprm="1 -5 0" '
            'ctrlrange="-0.5 1"/>',
            (-0.5, 1.0),
        ),
        (
            '<intvelocity joint="pitch" kp="5" ctrlrange="-3 3" actrange="-0.5 1"/>',
            (-0.5, 1.0),
        ),
        ('<pid joint="pitch" kp="5" ctrlrange="-0.5 1"/>', (-0.5, 1.0)),
    ],
)
def test_the_range_of_a_servo_is_the_range_of_its_angle(actuator, controls, tmp_path):
    text = wrist(actuator)
    ends = range_of(import_text(tmp_path, text).mechanism, "pitch")
    assert ends[0] < ends[1]
    is_activation = "intvelocity" in actuator
    for angle, control in zip(ends, controls, strict=True):
        torque = torque_by_mujoco(text, angle, control, is_activation)
        assert torque == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    "actuator",
    [
        '<muscle joint="pitch" ctrlrange="0 1" lengthrange="0 1"/>',
        '<velocity joint="pitch" kv="2" ctrlrange="-3 3"/>',
        '<intvelocity joint="pitch" kp="5" ctrlrange="-3 3"/>',
        '<general joint="pitch" gainprm="9" biasprm="0 -5 0" ctrlrange="-1 1"/>',
    ],
)
def test_a_control_that_sets_no_angle_gives_no_range(actuator, tmp_path):
    mechanism = import_text(tmp_path, wrist(actuator)).mechanism
    assert mechanism.inputs[0].pair == "pitch"
    assert range_of(mechanism, "pitch") == pytest.approx((-np.pi, np.pi))


@pytest.mark.parametrize("is_reversed", [False, True])
def test_a_second_actuator_keeps_the_range_of_a_servo(is_reversed, tmp_path):
    actuators = [
        '<position joint="pitch" kp="5" ctrlrange="-0.5 1"/>',
        '<velocity joint="pitch" kv="2"/>',
    ]
    text = wrist("".join(actuators[::-1] if is_reversed else actuators))
    ends = range_of(import_text(tmp_path, text).mechanism, "pitch")
    assert ends == pytest.approx((-0.5, 1.0))


def test_actuators_after_one_with_two_controls_keep_their_ranges(tmp_path):
    text = wrist(
        '<pid joint="pitch" kp="3" ctrlrange="-2 2"/>'
        '<position joint="yaw" kp="5" ctrlrange="-0.5 1"/>'
    )
    mechanism = import_text(tmp_path, text).mechanism
    assert not mechanism.loads
    assert range_of(mechanism, "pitch") == pytest.approx((-2.0, 2.0))
    assert range_of(mechanism, "yaw") == pytest.approx((-0.5, 1.0))


LOCK = '<joint joint1="pitch" polycoef="0.3"/>'


@pytest.mark.parametrize("flag", ["equality", "constraint"])
def test_constraints_that_the_file_disables_are_left_out(flag, tmp_path):
    found = import_text(tmp_path, wrist(equality=LOCK, flag=f'{flag}="disable"'))
    assert [pair.name for pair in found.mechanism.pairs] == ["yaw", "pitch"]
    assert "equality constraints left out: the file disables them" in found.notes


@pytest.mark.parametrize(
    "equality", [LOCK, '<joint joint1="pitch" joint2="yaw" polycoef="0.3 0 0 0 0"/>']
)
def test_a_constant_angle_locks_a_joint(equality, tmp_path):
    found = import_text(tmp_path, wrist(equality=equality))
    assert [pair.name for pair in found.mechanism.pairs] == ["yaw"]
    assert "joint pitch is locked, so it does not become a pair" in found.notes
