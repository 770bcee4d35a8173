"""Couplings and transmissions of other programs become bevel gears with their equations.

They are compared with the equations themselves: those of the equalities in a MuJoCo model,
and those of the package transmission_interface of ros_control, in `motor_angles`.
"""

import re

import numpy as np
import pytest
from helpers.refusals import HERE

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import FileError
from spherekit.exchange.gear_couplings import Coupling, ImportedPair, find_gears

pytest.importorskip("mujoco")

FILES = HERE / "files"
DIFFERENTIAL = (FILES / "diff_wrist.xml").read_text(encoding="utf-8")
TRANSMISSION = (FILES / "diff_trans.urdf").read_text(encoding="utf-8")


def import_text(tmp_path, text, name="model.xml"):
    """Return what a model becomes."""
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return sk.import_mechanism(path)


def rates_of_pairs(mechanism):
    """Return the rates (inputs,) of all R pairs by name, one for the rate of each input."""
    inputs = [item.pair for item in mechanism.inputs]
    at = [item.start + 0.3 * (item.stop - item.start) for item in mechanism.inputs]
    state = sk.evaluate(mechanism, [at], assembly_mode=0)
    assert state.status[0] == sk.Status.OK
    return {
        pair.name: np.array(
            [state.variable_coefficient(pair.name, item)[0] for item in inputs]
        )
        for pair in mechanism.pairs
        if pair.type == "R"
    }


def sums_of_tendons(text):
    """Return the couplings of a model: factors by joint."""
    terms = re.compile(r'joint="(\w+)" coef="(\S+)"')
    return [
        {joint: float(factor) for joint, factor in terms.findall(tendon)}
        for tendon in re.findall(r"<fixed.*?</fixed>", text)
    ]


def with_tendons(*sums):
    """Return the differential wrist as a MuJoCo model with other couplings of its joints.

    Each coupling is a sum that is zero; `sums` has its factors for the joints m_l, m_r,
    pitch and roll. In the model, a tendon is the sum, and an equality sets the tendon to
    zero.
    """
    joints = ("m_l", "m_r", "pitch", "roll")
    tendons = ""
    equalities = ""
    for number, factors in enumerate(sums):
        terms = ""
        for joint, factor in zip(joints, factors, strict=True):
            if factor:
                terms += f'<joint joint="{joint}" coef="{factor!r}"/>'
        tendons += f'<fixed name="t{number}">{terms}</fixed>'
        equalities += f'<tendon tendon1="t{number}"/>'
    text = DIFFERENTIAL
    for tag, content in (("tendon", tendons), ("equality", equalities)):
        text = re.sub(f"<{tag}>.*</{tag}>", f"<{tag}>{content}</{tag}>", text, flags=re.S)
    return text


COUPLINGS = {
    "sum and difference": [(1.0, 1.0, -2.0, 0.0), (1.0, -1.0, 0.0, -2.0)],
    "difference first": [(1.0, -1.0, 0.0, -2.0), (1.0, 1.0, -2.0, 0.0)],
    "each motor by itself": [(1.0, 0.0, -1.0, -1.0), (0.0, 1.0, -1.0, 1.0)],
    "unequal wheels": [(1.0, 0.5, -1.5, 0.0), (1.0, -1.0, 0.0, -3.0)],
    "three equations, one too many": [
        (1.0, 1.0, -2.0, 0.0),
        (1.0, -1.0, 0.0, -2.0),
        (2.0, 0.0, -2.0, -2.0),
    ],
    "one turns the cage": [(1.0, 0.0, -1.0, -0.4), (0.0, 1.0, -2.5, 0.0)],
    "motors geared to the joints": [(1.0, 0.0, -30.0, 0.0), (0.0, 1.0, -1.0, 7.0)],
}


@pytest.mark.parametrize("name", COUPLINGS)
def test_a_differential_by_tendons_keeps_its_equations(name, tmp_path):
    text = with_tendons(*COUPLINGS[name])
    rates = rates_of_pairs(import_text(tmp_path, text).mechanism)
    for factors in sums_of_tendons(text):
        total = sum(factor * rates[joint] for joint, factor in factors.items())
        assert total == pytest.approx(np.zeros(2), abs=1e-12)


def test_couplings_of_equal_names_all_become_gears(tmp_path):
    """An equality named like the tendon of a nameless equality does not replace it."""
    text = with_tendons(*COUPLINGS["sum and difference"])
    text = text.replace('<tendon tendon1="t1"/>', '<tendon name="t0" tendon1="t1"/>')
    mechanism = import_text(tmp_path, text).mechanism
    gears = [pair.name for pair in mechanism.pairs if pair.type == "Cr"]
    assert gears == ["t0", "t0_2"]
    rates = rates_of_pairs(mechanism)
    assert rates["pitch"] == pytest.approx([0.5, 0.5], abs=1e-13)
    assert rates["roll"] == pytest.approx([0.5, -0.5], abs=1e-13)


@pytest.mark.parametrize("number", ["nan", "inf"])
def test_a_factor_that_is_not_finite_is_refused_with_its_tendon(
    number, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log there.
    text = DIFFERENTIAL.replace('coef="-2"', f'coef="{number}"', 1)
    with pytest.raises(FileError, match=f"tendon sum: found {number}, expected finite"):
        import_text(tmp_path, text)


@pytest.mark.parametrize(
    ("element", "old", "new"),
    [
        ("joint pitch", r'(name="pitch"[^>]* axis=)"[^"]*"', r'\1"0 0 inf"'),
        ("joint pitch", r'(name="pitch")', r'\1 ref="nan"'),
        ("equality 0", "<equality>", '<equality><joint joint1="roll" polycoef="inf"/>'),
    ],
)
def test_numbers_that_are_not_finite_are_refused_with_their_element(
    element, old, new, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    text, count = re.subn(old, new, DIFFERENTIAL, count=1)
    assert count == 1
    with pytest.raises(FileError, match=f"{element}: found (nan|inf), expected finite"):
        import_text(tmp_path, text)


def test_gears_of_an_idler_do_not_replace_a_coupling_of_their_name():
    """Three wheels on one axis at two ratios; the second is named as an idler's gears."""
    x_axis, z_axis = np.eye(3)[[0, 2]]
    hinges = [
        ImportedPair("carrier", (0, 1), x_axis, 0.0, 0),
        *(ImportedPair(f"wheel_{k}", (1, k + 1), z_axis, 0.0, k) for k in (1, 2, 3)),
    ]
    couplings = [Coupling("a", {1: 1.0, 2: 2.0}), Coupling("a_idler", {2: 1.0, 3: 2.0})]
    found = find_gears(hinges, couplings, first_new_link=5)
    assert len(found.idlers) == 2
    assert [*found.gears] == ["a", "a_idler_2", "a_idler", "a_idler_idler"]


def test_the_usual_differential_by_the_command(tmp_path, capsys):
    target = tmp_path / "wrist.toml"
    assert main(["import", str(FILES / "diff_wrist.xml"), "-o", str(target)]) == 0
    assert "armature" not in capsys.readouterr().err
    mechanism = sk.load(target)
    rates = rates_of_pairs(mechanism)
    # The sum and the difference of the file, solved: pitch (l + r) / 2, roll (l - r) / 2.
    assert rates["pitch"] == pytest.approx([0.5, 0.5], abs=1e-13)
    assert rates["roll"] == pytest.approx([0.5, -0.5], abs=1e-13)
    assert {pair.name for pair in mechanism.pairs if pair.type == "Cr"} == {"sum", "dif"}
    assert [output.link for output in mechanism.outputs] == ["hand"]
    # The limit of the pitch, 1.2 rad, bounds both motors; that of the roll is wider.
    assert [item.stop for item in mechanism.inputs] == pytest.approx([1.2, 1.2], rel=1e-12)
    assert main(["run", str(target), "--samples", "3x3", "-q"]) == 0


GEARS = (FILES / "import_gears.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize("ratio", [2.0, -0.25, 1.0, 30.0, -1.0])
def test_coaxial_joints_at_a_ratio_get_an_idler_wheel(ratio, tmp_path):
    found = import_text(tmp_path, GEARS.format(axis="0 0 1", ratio=ratio, bent=0))
    assert "idler wheel was added" in found.text
    rates = rates_of_pairs(found.mechanism)
    assert rates["two"] == pytest.approx(ratio * rates["one"], abs=1e-12 * abs(ratio))


def test_couplings_without_gears_are_refused_in_plain_words(tmp_path):
    """Joints of two branches that share no crossing axes on one carrier."""
    text = with_tendons((1.0, 0.0, 1.0, 2.0))
    text = text.replace('name="roll" axis="0 0 1"', 'name="roll" axis="0 1 0"')
    with pytest.raises(sk.SpherekitError) as refused:
        import_text(tmp_path, text)
    message = str(refused.value)
    assert "joints are coupled by t0" in message
    assert "between m_l, pitch, roll" in message and "copy of the file" in message


def motor_angles(kind, actuators, joints, q):
    """Return the angles of two actuators by the equations of transmission_interface.

    `actuators` and `joints` are the mechanical reductions of both, and `q` the two joint
    angles. `kind` is "Differential" or "FourBarLinkage".
    """
    (n_a1, n_a2), (n_j1, n_j2) = actuators, joints
    if kind == "Differential":
        return n_a1 * (n_j1 * q[0] + n_j2 * q[1]), n_a2 * (n_j1 * q[0] - n_j2 * q[1])
    return n_a1 * n_j1 * q[0], n_a2 * (q[0] + n_j2 * q[1])


def transmission(kind, actuators, joints, form="ros_control"):
    """Return a robot description (URDF) in which a transmission couples two joints.

    In the description `TRANSMISSION` the element of the transmission is replaced. The
    joints are pitch and roll, the motors m_l and m_r. `kind` is "Differential" or
    "FourBarLinkage"; `actuators` and `joints` are the mechanical reductions of motors and
    joints. `form` is the dialect, "ros_control" or "ros2_control".
    """
    entries = [
        ("actuator", 1, "m_l", actuators[0]),
        ("actuator", 2, "m_r", actuators[1]),
        ("joint", 1, "pitch", joints[0]),
        ("joint", 2, "roll", joints[1]),
    ]
    elements = []
    for tag, number, name, reduction in entries:
        if form == "ros_control":
            elements.append(
                f'<{tag} name="{name}"><role>{tag}{number}</role>'
                f"<mechanicalReduction>{reduction!r}</mechanicalReduction></{tag}>"
            )
        else:
            elements.append(
                f'<{tag} name="{name}" role="{tag}{number}">'
                f"<mechanical_reduction>{reduction!r}</mechanical_reduction></{tag}>"
            )
    # Roles say which joint or motor is the first. The reversed order tests that the order
    # of elements has no meaning.
    text = "".join(reversed(elements))
    plugin = f"transmission_interface/{kind}Transmission"
    if form == "ros_control":
        element = f'<transmission name="wrist"><type>{plugin}</type>{text}</transmission>'
    else:
        element = (
            '<ros2_control name="arm" type="system"><joint name="pitch">'
            '<command_interface name="position"/></joint><joint name="roll">'
            '<command_interface name="position"/></joint>'
            f'<transmission name="wrist"><plugin>{plugin}</plugin>{text}</transmission>'
            "</ros2_control>"
        )
    return re.sub(r"<transmission.*</transmission>", element, TRANSMISSION, flags=re.S)


@pytest.mark.parametrize("form", ["ros_control", "ros2_control"])
@pytest.mark.parametrize(
    ("kind", "actuators", "joints"),
    [
        ("Differential", (30.0, 30.0), (1.0, 1.0)),
        ("Differential", (50.0, -50.0), (2.0, 1.5)),
        ("Differential", (1.0, 12.0), (-1.0, 0.3)),
        ("FourBarLinkage", (20.0, 20.0), (1.0, 1.0)),
        ("FourBarLinkage", (-8.0, 5.0), (2.0, -0.7)),
    ],
)
def test_motors_turn_by_the_equations_of_transmissions(
    kind, actuators, joints, form, tmp_path
):
    """Rates of motors in an imported transmission are those of its published equations.

    `motor_angles` has these equations. A transmission couples two motors with the joints
    pitch and roll. `kind` is its type, `actuators` and `joints` are the mechanical
    reductions of the motors and of the joints, and `form` is the dialect of URDF. The
    imported mechanism has bevel wheels in place of the transmission. Where a motor turns
    faster than the wheel, or than the joint, that it drives, a note says how many times.
    """
    text = transmission(kind, actuators, joints, form)
    imported = import_text(tmp_path, text, "wrist.urdf")
    mechanism = imported.mechanism
    # The rate of each pair per unit rate of each of the two inputs.
    rates = rates_of_pairs(mechanism)
    notes = re.findall(r"motor (\w+) .*turns (\S+) times as far", imported.text)
    ratio_by_motor = {motor: float(ratio) for motor, ratio in notes}
    input_pairs = [item.pair for item in mechanism.inputs]
    for input_number in range(2):
        joint_rates = rates["pitch"][input_number], rates["roll"][input_number]
        expected_rates = motor_angles(kind, actuators, joints, joint_rates)
        for motor, expected in zip(("m_l", "m_r"), expected_rates, strict=True):
            # The first motor of a "FourBarLinkage" drives the joint pitch directly. This
            # joint is then the input, and not a wheel with the name of the motor.
            driven_pair = motor if motor in input_pairs else "pitch"
            rate = ratio_by_motor.get(motor, 1.0) * rates[driven_pair][input_number]
            assert rate == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_differential_of_a_urdf_by_the_command(tmp_path, capsys):
    target = tmp_path / "wrist.toml"
    assert main(["import", str(FILES / "diff_trans.urdf"), "-o", str(target)]) == 0
    told = capsys.readouterr().out
    assert "motor m_l of transmission wrist drives bevel wheel m_l" in told
    assert "turns 30 times as far as the wheel" in told
    mechanism = sk.load(target)
    assert [item.pair for item in mechanism.inputs] == ["m_l", "m_r"]
    rates = rates_of_pairs(mechanism)
    assert rates["pitch"] == pytest.approx([0.5, 0.5], abs=1e-13)


def test_a_simple_reduction_is_said(tmp_path):
    element = (
        '<transmission name="drive"><type>transmission_interface/SimpleTransmission</type>'
        '<joint name="pitch"/><actuator name="motor"><mechanicalReduction>50'
        "</mechanicalReduction></actuator></transmission>"
    )
    text = re.sub(r"<transmission.*</transmission>", element, TRANSMISSION, flags=re.S)
    found = import_text(tmp_path, text, "wrist.urdf")
    assert "motor of transmission drive turns 50 times as far as joint pitch" in found.text


def test_a_wheel_has_a_name_of_its_own(tmp_path):
    text = TRANSMISSION.replace('actuator name="m_l"', 'actuator name="cage"')
    found = import_text(tmp_path, text, "wrist.urdf")
    assert "cage_wheel" in found.mechanism.links
    assert len(found.mechanism.inputs) == 2


def test_an_unknown_transmission_is_said(tmp_path):
    text = TRANSMISSION.replace("DifferentialTransmission", "HarmonicTransmission")
    found = import_text(tmp_path, text, "wrist.urdf")
    assert "of type HarmonicTransmission is not known" in found.text
    assert [item.pair for item in found.mechanism.inputs] == ["pitch", "roll"]


def test_an_unknown_transmission_without_joints_is_said(tmp_path):
    spare = '<transmission name="spare"><type>maker/Harmonic</type></transmission>'
    text = TRANSMISSION.replace("</robot>", f"{spare}</robot>")
    found = import_text(tmp_path, text, "wrist.urdf")
    assert "spare of type Harmonic is not known: left out" in found.text


REFUSED = {
    "zero": (
        TRANSMISSION.replace(">30<", ">0<", 1),
        'reduction of actuator m_l is "0"; it has to be a number other than zero',
    ),
    "word": (TRANSMISSION.replace(">1.0<", ">fast<", 1), 'of joint pitch is "fast"'),
    "one actuator": (
        re.sub(r'<actuator name="m_r">.*?</actuator>', "", TRANSMISSION),
        "has 2 actuators and 2 joints; found 1 actuator",
    ),
    "no such joint": (
        TRANSMISSION.replace('<joint name="roll"><role>', '<joint name="rool"><role>'),
        'no rotating joint is named "rool"',
    ),
    "side by side": (
        TRANSMISSION.replace('<parent link="cage"/>', '<parent link="forearm"/>'),
        "neither of them is on the link that the other one turns",
    ),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_transmission_that_cannot_be_is_refused(fault, tmp_path):
    text, fragment = REFUSED[fault]
    with pytest.raises(sk.SpherekitError) as refused:
        import_text(tmp_path, text, "wrist.urdf")
    assert fragment in str(refused.value)
    assert "transmission wrist" in str(refused.value)
