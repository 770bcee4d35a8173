"""Loads and inertias of MuJoCo models that are imported."""

import numpy as np
import pytest

import spherekit as sk

mujoco = pytest.importorskip("mujoco")

WRIST = """<mujoco model="wrist"><compiler angle="radian"/><option {option}>
<flag {flag}/></option><worldbody>
<body name="fork"><joint name="yaw" axis="0 0 1" {yaw}/>
<geom size="0.1" pos="0.2 0 0"/>
<body name="hand" {body}><joint name="pitch" axis="0 1 0" {pitch}/>{hand}
</body></body></worldbody>{rest}</mujoco>"""

HAND = '<geom size="0.1" pos="0 0.2 0"/>'

SPRUNG = 'stiffness="2" damping="3" frictionloss="4" range="-1 1"'


def wrist(hand=HAND, flag='gravity="enable"', **parts):
    """Return a wrist with two hinges as a MuJoCo model, with some parts added."""
    texts = dict.fromkeys(("option", "yaw", "body", "pitch", "rest"), "") | parts
    return WRIST.format(hand=hand, flag=flag, **texts)


def import_text(tmp_path, text):
    """Return what a MuJoCo model becomes."""
    path = tmp_path / "model.xml"
    path.write_text(text, encoding="utf-8")
    return sk.import_mechanism(path)


def test_a_body_without_mass_does_not_weigh_on_a_compensated_link(tmp_path):
    """All the weight of a link is compensated if the other body of it has no mass."""
    rotor = '<body name="rotor"><inertial pos="0 0 0" mass="0" diaginertia="1 1 1"/></body>'
    text = wrist(hand=HAND + rotor, body='gravcomp="1"')
    assert "Its weight is compensated" in import_text(tmp_path, text).text
    weightless = wrist(hand=HAND + rotor, body='gravcomp="1"', option='gravity="0 0 0"')
    assert mass_of(import_text(tmp_path, weightless), "hand").mass is None


def load_names(found):
    """Return the names of all loads but gravity."""
    return {load.name for load in found.mechanism.loads} - {"gravity"}


def mass_of(found, link):
    """Return the inertia of a link."""
    (mass,) = (mass for mass in found.mechanism.masses if mass.link == link)
    return mass


@pytest.mark.parametrize(
    ("flags", "expected_loads", "has_limits", "lost"),
    [
        (["spring"], {"friction_pitch"}, True, ["springs"]),
        (["damper"], {"spring_pitch", "friction_pitch"}, True, ["dampers"]),
        (["frictionloss"], {"spring_pitch", "damper_pitch"}, True, ["dry friction"]),
        (["limit"], {"spring_pitch", "friction_pitch"}, False, ["limits"]),
        (
            ["constraint"],
            {"spring_pitch", "damper_pitch"},
            False,
            ["dry friction", "limits"],
        ),
        (["spring", "damper", "frictionloss"], set(), True, ["springs", "dry friction"]),
    ],
)
def test_loads_that_the_file_disables_are_left_out(
    flags, expected_loads, has_limits, lost, tmp_path
):
    flag = " ".join(f'{flag}="disable"' for flag in flags)
    found = import_text(tmp_path, wrist(flag=flag, pitch=SPRUNG))
    assert load_names(found) == expected_loads
    assert bool(found.mechanism.joint_limits) == has_limits
    for what in lost:
        assert f"{what} left out: disabled by a flag of the file" in found.notes


def test_without_springs_and_dampers_no_weight_is_compensated(tmp_path):
    text = wrist(body='gravcomp="1"', flag='spring="disable" damper="disable"')
    found = import_text(tmp_path, text)
    assert mass_of(found, "hand").centre == pytest.approx((0.0, 0.2, 0.0))
    assert "weight compensation left out: disabled by a flag of the file" in found.notes


def test_weight_that_is_compensated_in_part_has_the_moment_of_mujoco(tmp_path):
    text = wrist(
        hand='<geom size="0.1" pos="0.3 0.2 0"/>', body='gravcomp="0.75"', pitch='ref="0"'
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    dof = model.joint("pitch").dofadr[0]
    torque = data.qfrc_passive[dof] - data.qfrc_bias[dof]
    hand = mass_of(import_text(tmp_path, text), "hand")
    weight = hand.mass * np.array([0.0, 0.0, -9.81])
    assert np.cross(hand.centre, weight)[1] == pytest.approx(torque, rel=1e-12)


INERTIAL = '<inertial pos="0.3 0 0" mass="0" diaginertia="1 2 3"/>'


@pytest.mark.parametrize(("option", "mass"), [("", 1e-14), ('gravity="0 0 0"', None)])
def test_inertia_of_a_body_without_mass_is_imported(option, mass, tmp_path):
    """Gravity needs a mass for each link with inertia."""
    hand = mass_of(import_text(tmp_path, wrist(hand=INERTIAL, option=option)), "hand")
    assert np.array_equal(hand.tensor, np.diag([1.0, 2.0, 3.0]))
    assert hand.mass == mass


def test_a_link_with_a_rotor_alone_is_imported_with_gravity(tmp_path):
    text = wrist(yaw='armature="0.5"').replace('<geom size="0.1" pos="0.2 0 0"/>', "")
    fork = mass_of(import_text(tmp_path, text), "fork")
    assert np.array_equal(fork.tensor, np.diag([0.25, 0.25, 0.5]))


def test_the_armature_of_a_hinge_at_a_body_that_is_welded_to_the_world_is_kept(tmp_path):
    weld = '<equality><weld body1="hand" body2="world"/></equality>'
    text = wrist(pitch='armature="0.5"', rest=weld)
    rotor = np.subtract(
        mass_of(import_text(tmp_path, text), "fork").tensor,
        mass_of(import_text(tmp_path, text.replace("0.5", "0")), "fork").tensor,
    )
    assert rotor == pytest.approx(np.diag([0.25, 0.5, 0.25]), abs=1e-9)


@pytest.mark.parametrize("gain", [0, 1])
def test_damper_and_rotor_of_an_actuator_are_those_of_its_joint(gain, tmp_path):
    """MuJoCo multiplies both by the square of the gear ratio."""
    actuator = (
        f'<actuator><general name="a" joint="yaw" gainprm="{gain}" gear="3" '
        'damping="2" armature="0.5"/></actuator>'
    )
    found = import_text(tmp_path, wrist(rest=actuator))
    (damper,) = (load for load in found.mechanism.loads if load.name == "damper_yaw")
    assert damper.damping == 18.0
    plain = import_text(tmp_path, wrist())
    rotor = np.subtract(mass_of(found, "fork").tensor, mass_of(plain, "fork").tensor)
    assert rotor == pytest.approx(np.diag([2.25, 2.25, 4.5]), abs=1e-9)


ACTUATOR = """<actuator><general name="a" joint="pitch" gainprm="0" {bias} {rest}/>
</actuator>"""
CONSTANT = 'biastype="affine" biasprm="5 0 0"'
MUSCLE = (
    'biastype="muscle" lengthrange="0 1" biasprm="0.75 1.05 10 200 0.5 1.6 1.5 1.3 1.2"'
)


def torque_of(found):
    """Return the expression of the torque of the actuator a."""
    return found.text.split("[loads.a]")[1].split('torque = "')[1].split('"')[0]


@pytest.mark.parametrize(
    ("bias", "rest", "torque"),
    [
        (CONSTANT, "", "(5.0)"),
        (CONSTANT, 'forcerange="-1 2" gear="3"', "(6.0)"),
        (CONSTANT, 'forcerange="-1 2" forcelimited="false"', "(5.0)"),
        ('biastype="none" biasprm="5 0 0"', "", "0"),
    ],
)
def test_a_constant_actuator_has_the_torque_of_mujoco(bias, rest, torque, tmp_path):
    text = wrist(rest=ACTUATOR.format(bias=bias, rest=rest))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[1] == float(torque.strip("()"))
    assert torque_of(import_text(tmp_path, text)) == torque


@pytest.mark.parametrize(
    ("parts", "note"),
    [
        ({"flag": 'actuation="disable"'}, "the file disables it"),
        ({"option": 'actuatorgroupdisable="2"'}, "the file disables it"),
        ({"bias": MUSCLE}, "it is not a constant load"),
        ({"lock": '<joint joint1="pitch"/>'}, "its joint cannot turn"),
    ],
)
def test_actuators_that_exert_no_torque_are_left_out(parts, note, tmp_path):
    lock = f"<equality>{parts.pop('lock', '')}</equality>"
    actuator = ACTUATOR.format(bias=parts.pop("bias", CONSTANT), rest='group="2"')
    found = import_text(tmp_path, wrist(rest=lock + actuator, **parts))
    assert not load_names(found)
    assert f"actuator a left out: {note}" in found.notes


@pytest.mark.parametrize("place", ["actuator", "joint"])
def test_limits_of_a_torque_that_varies_are_noted(place, tmp_path):
    bias = 'biastype="affine" biasprm="5 -1 0"'
    rest = 'forcerange="-1 2"' if place == "actuator" else ""
    pitch = 'actuatorfrcrange="-1 2"' if place == "joint" else ""
    text = wrist(rest=ACTUATOR.format(bias=bias, rest=rest), pitch=pitch)
    found = import_text(tmp_path, text)
    assert "limits of the torque of actuator a left out" in found.notes


def test_feedback_that_mujoco_does_not_use_is_not_noted(tmp_path):
    text = wrist(rest=ACTUATOR.format(bias='biasprm="0 -5 0"', rest=""))
    found = import_text(tmp_path, text.replace('gainprm="0"', 'gainprm="1"'))
    assert not any("feedback" in note for note in found.notes)


@pytest.mark.parametrize(
    ("parts", "note"),
    [
        (
            {"pitch": 'stiffness="1" springyield="0.1"'},
            "joint pitch: spring or damper left out where not linear",
        ),
        (
            {
                "rest": '<tendon><fixed name="belt" stiffness="3" range="0 1">'
                '<joint joint="pitch" coef="1"/></fixed></tendon>'
            },
            "tendon belt: its spring, its limit left out",
        ),
        ({"option": 'density="1000"'}, "forces of the surrounding fluid left out"),
    ],
)
def test_loads_that_no_mechanism_file_can_have_are_noted(parts, note, tmp_path):
    assert note in import_text(tmp_path, wrist(**parts)).notes


def test_an_actuator_that_others_determine_is_not_counted(tmp_path):
    joints = "".join(
        f'<body name="{name}"><joint name="{name}" axis="{axis}"/>{HAND}</body>'
        for name, axis in (("a", "0 0 1"), ("b", "0 1 0"), ("c", "1 0 0"))
    )
    found = import_text(
        tmp_path,
        f"<mujoco><worldbody>{joints}</worldbody><equality>"
        '<joint joint1="a" joint2="b"/></equality><actuator><motor joint="a"/>'
        '<motor joint="b"/></actuator></mujoco>',
    )
    assert (
        "input c without actuator: there are more freedoms than independent actuators"
    ) in found.notes


PINNED = """<mujoco><compiler angle="radian"/><worldbody>
<body name="fork" pos="0.3 0.1 0.7">
<joint name="yaw" axis="0.1 0.2 1" pos="-0.3 -0.1 -0.7"/><geom size="0.1"/>
<body name="hand" pos="-0.3 -0.1 -0.3"><joint name="pitch" axis="0 1 0" pos="0 0 -0.4"/>
<geom size="0.1" pos="0.5 0 0"/><site name="look" pos="0 0 -0.4"/></body></body>
</worldbody>{rest}</mujoco>"""


def test_a_pin_at_the_centre_of_the_sphere_is_no_pair(tmp_path):
    pin = '<connect name="pin" body1="hand" body2="world" anchor="0 0 -0.4"/>'
    text = PINNED.format(rest=f"<equality>{pin}</equality>")
    found = import_text(tmp_path, text)
    assert [pair.name for pair in found.mechanism.pairs] == ["yaw", "pitch"]
    assert "loop pin left out: it holds the centre, which does not move" in found.notes


def test_an_observed_point_at_the_centre_of_the_sphere_gives_no_direction(tmp_path):
    sensor = '<framequat name="look" objtype="body" objname="hand"/>'
    text = PINNED.format(rest=f"<sensor>{sensor}</sensor>")
    found = import_text(tmp_path, text)
    (output,) = found.mechanism.outputs
    assert (output.name, output.link, output.direction) == ("look", "hand", None)


def test_a_pin_at_the_centre_leaves_the_limits_of_geared_joints(tmp_path):
    text = (
        '<mujoco><compiler angle="radian"/><worldbody>'
        f'<body name="a"><joint name="a" axis="0 0 1"/>{HAND}</body><body name="b">'
        f'<joint name="b" axis="0 1 0" range="-0.5 0.5"/>{HAND}</body></worldbody>'
        '<equality><connect name="pin" body1="a" body2="b" anchor="0 0 0"/>'
        '<joint joint1="b" joint2="a" polycoef="0 2"/></equality>'
        '<actuator><motor joint="a"/></actuator></mujoco>'
    )
    (item,) = import_text(tmp_path, text).mechanism.inputs
    assert (item.start, item.stop) == pytest.approx((-0.25, 0.25))


def test_an_idler_wheel_that_was_added_is_no_output(tmp_path):
    wheels = "".join(
        f'<body name="{name}"><joint name="{name}" axis="0 0 1"/>{HAND}</body>'
        for name in "ab"
    )
    found = import_text(
        tmp_path,
        f"<mujoco><worldbody>{wheels}</worldbody><equality>"
        '<joint joint1="a" joint2="b" polycoef="0 2"/></equality></mujoco>',
    )
    assert "idler_1" in found.mechanism.links
    assert [output.link for output in found.mechanism.outputs] == ["a", "b"]
