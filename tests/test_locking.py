"""A locked pair makes one link of two: poses, inertia and loads as with it held."""

import json
import re

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call, mechanism_text
from mechanism_examples.named_mechanisms import posed_three_rrr, two_followers
from oracles.newton_euler import with_point_masses

import spherekit as sk
from spherekit.cli.main import main
from spherekit.files.mechanism_reader import loads
from spherekit.files.mechanism_writer import dumps
from spherekit.files.time_law import ConstantSpeed
from spherekit.positions.position_analysis import PositionAnalysis

CASES = {
    # mechanism: (locked pair, its locked angle (rad), start angles (rad) of other inputs)
    "five_bar": ("51", 1.2, (1.0,)),
    "two_dof_spm": ("61", 0.35, (0.3,)),
    "three_rrr": ("a2", 1.0, (0.9, 1.2)),
    "posed": ("a2", -0.38, (0.3, 0.0)),
}
"""`posed` is the three_rrr whose axes are given in a reference pose instead of by arcs."""


def loaded_mechanism(name):
    """Return a mechanism of `CASES` with masses, gravity and a torque.

    The torque acts at pair 1 and depends on the angle of the pair that will be locked.
    """
    mechanism = with_point_masses(posed_three_rrr() if name == "posed" else name)
    return mechanism.with_loads(
        sk.Gravity("weight", (1.0, -2.0, -9.0)),
        sk.PairTorque("pull", mechanism.pairs[1].name, f"0.3 - theta_{CASES[name][0]}"),
    )


LONG = pytest.param("two_dof_spm", marks=pytest.mark.long)


@pytest.mark.many
@pytest.mark.parametrize("name", ["five_bar", "three_rrr", "posed", LONG])
def test_a_mechanism_with_a_locked_input_moves_as_with_this_input_held_still(
    name, tmp_path
):
    """A mechanism with a locked input moves as if this input had a constant angle.

    Locking an input pair joins its two links to one. Inverse dynamics of both are compared:
    the rotations of all remaining links, and the inertia matrix M and the torques of the
    other inputs. The assembly mode is the one with the nearest links at the first time. The
    locked mechanism is tried as it is, and after writing and reading its file. `CASES` has
    the locked pairs.
    """
    # The start angles are those of the inputs that move, in order.
    locked_pair, locked_angle, start_angles = CASES[name]
    mechanism = loaded_mechanism(name)
    locked = sk.lock(mechanism, {locked_pair: locked_angle}, angle_unit="rad")
    assert len(locked.links) == len(mechanism.links) - 1
    assert len(locked.inputs) == len(mechanism.inputs) - 1
    sk.dump(locked, tmp_path / "locked.toml")

    moving_inputs = [item.pair for item in mechanism.inputs if item.pair != locked_pair]
    moving_laws = {}
    for k, (pair, start) in enumerate(zip(moving_inputs, start_angles, strict=True)):
        moving_laws[pair] = ConstantSpeed(0.4 - 0.7 * k, start)
    all_laws = {**moving_laws, locked_pair: ConstantSpeed(0.0, locked_angle)}
    times = [0.0, 0.1]
    held = sk.inverse_dynamics(mechanism, all_laws, times, assembly_mode=0)
    moving = [k for k, item in enumerate(mechanism.inputs) if item.pair != locked_pair]
    expected_M = held.M[:, moving][:, :, moving]
    expected_torques = held.torques[:, moving]

    locked_laws = moving_laws if len(moving_laws) > 1 else moving_laws[moving_inputs[0]]
    for locked_mechanism in (locked, sk.load(tmp_path / "locked.toml")):
        solution = sk.inverse_dynamics(locked_mechanism, locked_laws, times)
        rotations = solution.motion.rotations
        links = [mechanism.link_number[link] for link in locked_mechanism.links]
        # Rows are ordered by mode and then by time.
        difference = rotations[:: len(times)] - held.motion.rotations[0, links]
        distance = np.max(np.abs(difference), axis=(1, 2, 3))
        assert np.min(distance) < 1e-12
        first_row = int(np.argmin(distance)) * len(times)
        rows = slice(first_row, first_row + len(times))
        for link in locked_mechanism.links:
            expected = held.motion.rotations[:, mechanism.link_number[link]]
            rotation = rotations[rows, locked_mechanism.link_number[link]]
            assert np.max(np.abs(rotation - expected)) < 1e-12
        assert solution.M[rows] == pytest.approx(expected_M, rel=1e-11)
        assert solution.torques[rows] == pytest.approx(
            expected_torques, rel=1e-11, abs=1e-11
        )


def test_locking_a_pair_between_moving_links_keeps_the_configuration():
    """The five-bar is locked at the coupler angle that it has at inputs 1.0 and 1.2 rad.

    It then has one input, 21. At 1.0 rad one of its modes must have 51 at 1.2 rad again.
    """
    five_bar = sk.load("five_bar")
    motion = PositionAnalysis(
        five_bar, path=np.array([[1.0, 1.2]]), assembly_mode=0
    ).motion()
    coupler_angle = float(motion.values[0, five_bar.angles["43"]])
    locked = sk.lock(five_bar, {"43": coupler_angle}, angle_unit="rad").with_inputs("21")
    locked_motion = PositionAnalysis(locked, path=np.array([[1.0]])).motion()
    angles_51 = locked_motion.values[:, locked.angles["51"]]
    assert np.min(np.abs(np.sin(0.5 * (angles_51 - 1.2)))) < 1e-12


def test_a_differential_with_one_locked_side_halves_the_angle_of_the_other():
    """The carrier turns by the mean of both side gears, one of which is at 0."""
    locked = sk.lock(sk.load("bevel_differential"), {"right_axle": 0.0}, angle_unit="deg")
    motion = sk.trace(locked, samples=5)
    carrier_angle = motion.values[:, locked.angles["carrier_axle"]]
    assert carrier_angle == pytest.approx(0.5 * motion.q, abs=1e-12)


def test_a_lock_one_revolution_from_the_reference_pose_keeps_the_pose():
    """Without rolling contacts, all axes are the same after a whole revolution."""
    mechanism = posed_three_rrr()
    value = mechanism.geometry.values.get("a2", 0.0) + 2.0 * np.pi
    locked = sk.lock(mechanism, {"a2": value}, angle_unit="rad")
    assert "a2" not in locked.geometry.axes


def test_locking_a_pair_keeps_the_name_of_a_link_with_a_contact():
    """Link 5 is a wheel: of the links 4 and 5 that become one, its name stays."""
    text = mechanism_text("geared_five_bar_wheels").format(20, 30, 0, 360)
    assert "5" in sk.lock(loads(text), {"54": 20.0}, angle_unit="deg").links


def rows_with_start_angles(motion, start_angles):
    """Return the rows of the assembly mode in which some pairs begin at certain angles.

    A motion has all samples of its first assembly mode, then those of the next one.

    Parameters
    ----------
    motion
        Motion of a mechanism with several assembly modes.
    start_angles
        Angles (rad) of pairs in the first sample, by the names of the pairs.
    """
    sample_count = int(np.sum(motion.assembly_mode == motion.assembly_mode[0]))
    variables = [motion.mechanism.angles[pair] for pair in start_angles]
    first_samples = motion.values[::sample_count, variables]
    distances = np.max(np.abs(first_samples - [*start_angles.values()]), axis=1)
    first_row = sample_count * int(np.argmin(distances))
    return motion.rows(np.arange(first_row, first_row + sample_count))


def column(motion, variable):
    """Return the values (rows,) of a variable by its name."""
    return motion.values[:, motion.mechanism.variable_names.index(variable)]


@pytest.mark.parametrize(
    ("contact_links", "contact"),
    [(("3", "5"), "external"), (("5", "3"), "external"), (("5", "3"), "internal")],
)
def test_a_displacement_whose_zero_is_moved_by_a_lock_is_announced(contact_links, contact):
    """A warning says by how much a lock changes the displacement of a contact.

    The displacement s_35_3 of contact 35 is an arc length along the circular profile of
    link 3, from a zero that the axes of link 3 define. Locked at pair 23, link 3 becomes a
    part of link 2, whose axes define the zero: the displacement is now s_35_2. In the same
    configuration it must differ by the number in the warning, up to full circumferences.
    """
    mechanism = two_followers(contact_links, contact)
    # Two samples of the inputs 12 and 23. The second input is constant.
    path = np.array([[0.0, 0.7], [0.2, 0.7]])
    motion = PositionAnalysis(mechanism, path=path, assembly_mode=0).motion()
    with pytest.warns(UserWarning, match="s_35_3 .* becomes s_35_2") as warned:
        locked = sk.lock(mechanism, {"23": 0.7}, angle_unit="rad")
    announced_shift = float(re.search(r"adds (\S+) rad", str(warned[0].message))[1])
    assert abs(announced_shift) > 0.1

    # The same configurations are found by the angles of the followers, links 4 and 5.
    theta_14 = column(motion, "theta_14")
    theta_15 = column(motion, "theta_15")
    locked_motion = rows_with_start_angles(
        PositionAnalysis(locked, path=path[:, :1]).motion(),
        {"14": theta_14[0], "15": theta_15[0]},
    )
    assert column(locked_motion, "theta_14") == pytest.approx(theta_14, abs=1e-12)
    assert column(locked_motion, "theta_15") == pytest.approx(theta_15, abs=1e-12)

    shift = column(locked_motion, "s_35_2") - column(motion, "s_35_3")
    profile = mechanism.pair("35").profiles[contact_links.index("3")]
    circumference = 2.0 * np.pi * np.sin(profile.radius)
    further_laps = (shift - announced_shift) / circumference
    assert further_laps == pytest.approx(np.round(further_laps), abs=1e-8)


@pytest.mark.slow
def test_commands_lock_pairs_that_are_named_with_lock(tmp_path, capsys):
    """`--lock 51=80` (deg) leaves input 21 to run, plan, validate and export."""
    locked = ["five_bar", "--lock", "51=80"]
    assert main(["run", *locked, "-a", "eksergian", "--samples", "5"]) == 0
    assert "input 21" in "".join(capsys.readouterr())
    assert main(["plan", *locked]) == 0
    assert main(["validate", *locked]) == 0
    model_path = str(tmp_path / "x.xml")
    assert main(["export", *locked, "--to", "mjcf", "--at", "80", "-o", model_path]) == 0


@pytest.mark.slow
def test_a_study_locks_the_pairs_of_its_table_lock(tmp_path):
    study = tmp_path / "held.study.toml"
    study.write_text(
        'format = 1\nmechanism = "five_bar"\nangle_unit = "deg"\nsamples = 5\n'
        "[lock]\n51 = 80.0\n[analyses.poles]\n"
    )
    assert [item.pair for item in sk.load_study(study).mechanism.inputs] == ["21"]


@pytest.mark.parametrize(
    ("name", "other_name"), [("21", "1_z"), ("21", "1_y"), ("1", "ground" * 10 + "base")]
)
def test_a_locked_mechanism_is_written_whatever_its_names(name, other_name):
    """The joined link gets extra axes, whose names follow from that of the link."""
    text = re.sub(rf'(?<=[".]){name}(?=["\]])', other_name, dumps(sk.load("five_bar")))
    locked = sk.lock(loads(text), {"51": 80.0}, angle_unit="deg")
    assert loads(dumps(locked)) == locked


@pytest.mark.slow
def test_certificates_of_locked_mechanisms_state_the_rounding_of_the_joined_link(tmp_path):
    """The sizes of the link that two links become are rounded to the digits of a file."""
    pytest.importorskip("flint")
    certificate = tmp_path / "x.json"
    locked = ["five_bar", "--lock", "51=80"]
    assert main(["certify", *locked, "--at", "40", "-o", str(certificate)]) == 0
    assert json.loads(certificate.read_text())["tolerance_rad"] == 1e-14


@pytest.mark.parametrize("call", TABLES["locks"])
def test_a_lock_that_is_impossible_is_refused_with_its_reason(call):
    check_call(call, {"sk": sk}, TABLES["locks"][call])


def test_a_negative_tolerance_is_refused_although_locked_sizes_have_one(capsys):
    """Sizes of a locked link have a tolerance of their own, which may hide a mistake."""
    words = ["five_bar", "--lock", "51=80", "--at", "60", "--tolerance=-1"]
    assert main(["certify", *words]) == 1
    assert "--tolerance -1: found -0.0174533 rad" in capsys.readouterr().err
