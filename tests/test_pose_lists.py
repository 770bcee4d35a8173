"""Lists of poses and inputs: names, files, numbers of any size, and large windows."""

from functools import partial

import numpy as np
import pytest
from helpers.analysis_runs import run_single_analysis
from spherekit_analyses.inverse_kinematics.pose_lists import read_poses
from spherekit_analyses.output_poses import read_pose

import spherekit as sk
from spherekit.errors import AnalysisError
from spherekit.outputs.pose_solver import output_kinematics

found_in = partial(run_single_analysis, "inverse_kinematics")


def pan_tilt(first, second, inputs):
    """Return a pointer on two perpendicular axes, whose pairs have the given names."""
    return sk.build(
        "pan_tilt",
        angle_unit="deg",
        ground="base",
        links=["base", "yoke", "cage"],
        pairs={
            first: {"type": "R", "links": ["base", "yoke"], "xyz": [0.0, 0.0, 1.0]},
            second: {"type": "R", "links": ["yoke", "cage"], "xyz": [0.0, 1.0, 0.0]},
        },
        inputs={name: {} for name in inputs},
        outputs={"tool": {"link": "cage", "xyz": [1.0, 0.0, 0.0]}},
    )


def geared_pan_tilt():
    """Return a pointer whose pan axis is driven through gears, and its tilt axis directly.

    The inputs are the angle of the pinion (pair `motor`) and the tilt. Five turns of the
    pinion are two turns of the yoke, so an angle of the yoke has many angles of the pinion.
    """
    return sk.build(
        "geared_pan_tilt",
        angle_unit="deg",
        ground="base",
        links=["base", "yoke", "cage", "pinion"],
        pairs={
            "pan": {"type": "R", "links": ["base", "yoke"], "xyz": [0.0, 0.0, 1.0]},
            "tilt": {"type": "R", "links": ["yoke", "cage"], "xyz": [0.0, 1.0, 0.0]},
            "motor": {"type": "R", "links": ["base", "pinion"], "xyz": [1.0, 0.0, 0.0]},
            "mesh": {
                "type": "Cr",
                "links": ["pinion", "yoke"],
                "teeth": [20, 50],
                "axes": ["motor", "pan"],
            },
        },
        inputs={"motor": {}, "tilt": {}},
        outputs={"tool": {"link": "cage", "xyz": [1.0, 0.0, 0.0]}},
    )


@pytest.mark.parametrize("length", [1e200, 1e-200, 1e-310])
def test_directions_and_quaternions_may_have_any_length(length):
    five_bar = output_kinematics(sk.load("five_bar"))
    parts = [f"x={length!r}", "y=0", f"z={length!r}"]
    (direction,) = read_poses(five_bar, "test", parts).poses
    assert np.max(np.abs(direction - np.sqrt([0.5, 0.0, 0.5]))) < 1e-15
    three_rrr = output_kinematics(sk.load("three_rrr"))
    parts = ["qx=0", "qy=0", f"qz={length!r}", f"qw={length!r}"]
    (rotation,) = read_poses(three_rrr, "test", parts).poses
    # The quaternion is a quarter of a turn about z.
    assert np.max(np.abs(rotation - [[0, -1, 0], [1, 0, 0], [0, 0, 1]])) < 1e-15


@pytest.mark.parametrize("how", ["poses", "window", "file"])
def test_components_of_directions_are_no_angles_if_inputs_have_their_names(how, tmp_path):
    """Numbers x, y, z are a direction, even if the driven pairs are named x and y.

    A list of poses may state components of a direction (x, y, z) or, by the names of the
    driven pairs, input angles. Here the names x and y could mean either. Numbers x and y
    without z are input angles. `how` is the source of the list: texts, a grid ("window") or
    a file.
    """
    path = tmp_path / "poses.csv"
    path.write_text("x,y,z\n1,2,2\n")
    source = {
        "poses": ["x=1", "y=2", "z=2"],
        "window": ["x:1:1:1", "y:2:2:1", "z:2:2:1"],
        "file": str(path),
    }[how]
    solver = output_kinematics(pan_tilt("x", "y", ["x", "y"]))
    (direction,) = read_poses(solver, "test", **{how: source}).poses
    assert np.max(np.abs(direction - np.array([1.0, 2.0, 2.0]) / 3.0)) < 1e-15
    pose = read_pose("x=1+y=2+z=2", ("x", "y"), "test", "deg")
    assert np.array_equal(pose.direction, direction)
    # The names of the inputs alone are angles in deg.
    inputs = read_poses(solver, "test", ["x=10", "y=20"]).inputs
    assert np.array_equal(inputs, np.radians([[10.0, 20.0]]))


@pytest.mark.parametrize("order", [("azimuth", "tilt"), ("tilt", "azimuth")])
def test_names_of_inputs_mean_inputs_in_any_order(order, tmp_path):
    """Pairs named azimuth and tilt are inputs, whichever of them is declared first."""
    solver = output_kinematics(pan_tilt("azimuth", "tilt", order))
    value = {"azimuth": 10.0, "tilt": 20.0}
    expected = np.radians([[value[name] for name in order]])
    path = tmp_path / "inputs.csv"
    path.write_text("azimuth,tilt\n10,20\n")
    for source in ({"poses": ["azimuth=10", "tilt=20"]}, {"file": str(path)}):
        assert np.array_equal(read_poses(solver, "test", **source).inputs, expected)


def test_columns_of_inputs_may_be_named_as_in_the_file(tmp_path):
    path = tmp_path / "inputs.csv"
    path.write_text("q_21,q_51,x,y,z\n40,110,1,0,0\n")
    solver = output_kinematics(sk.load("five_bar"))
    for columns in (("q_21", "q_51"), ("21", "51")):
        inputs = read_poses(solver, "test", file=str(path), columns=columns).inputs
        assert np.array_equal(inputs, np.radians([[40.0, 110.0]]))
    with pytest.raises(AnalysisError, match="has no column q_52;"):
        read_poses(solver, "test", file=str(path), columns=("q_21", "q_52"))


def test_a_written_table_with_one_input_is_read_again(tmp_path):
    """The input of a mechanism with one input is in the column q of its tables."""
    result, _ = found_in("universal_joint", window="21:5:355:3")
    result.write(tmp_path)
    path = tmp_path / "inverse_kinematics_forward.parquet"
    written = result.frame("inverse_kinematics", "forward")
    again, _ = found_in("universal_joint", file=path)
    read = again.frame("inverse_kinematics", "forward")
    # Each of the 6 rows of the table is a set of inputs, with two solutions.
    assert np.allclose(read["q"], np.repeat(written["q"], 2), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm", "universal_joint"])
def test_a_file_of_inputs_may_be_empty(name, tmp_path):
    """A file with a heading only has no inputs, and the run does not fail."""
    mechanism = sk.load(name)
    path = tmp_path / "inputs.csv"
    path.write_text(",".join(mechanism.input_pairs) + "\n")
    result, findings = found_in(mechanism, file=path)
    assert findings["inputs"] == 0
    assert len(result.frame("inverse_kinematics", "forward")) == 0


def test_windows_with_too_many_values_are_refused_before_they_are_made():
    solver = output_kinematics(sk.load("five_bar"))
    window = ["azimuth:0:10:1e15", "tilt:0:1:1"]
    with pytest.raises(AnalysisError, match="found 1000000000000000 poses, at most"):
        read_poses(solver, "test", window=window)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ({"poses": ["21=5foo"]}, 'the unit "foo"'),
        ({"window": ["21:0:360"]}, "NAME:FROM:TO:COUNT"),
        ({"window": ["21:0:360:600000"]}, "at most 500000"),
    ],
)
def test_what_is_wrong_with_inputs_is_said_if_no_poses_can_be_reached(source, message):
    """Errors in inputs are reported, although inputs of poses cannot be computed."""
    solver = output_kinematics(sk.load("universal_joint"))
    with pytest.raises(AnalysisError, match=message):
        read_poses(solver, "test", **source)


def test_the_working_mode_is_known_after_any_revolutions_of_wheels():
    """Turns of the pinion that return the yoke to its angle do not change the mode.

    The pinion has 20 teeth and the wheel on the yoke 50, so that 5 turns of the pinion are
    2 turns of the yoke.
    """
    texts = [f"motor={angle}deg+tilt=50" for angle in (40, 40 + 1800, 40 - 1800)]
    result, _ = found_in(geared_pan_tilt(), poses="+".join(texts))
    table = result.frame("inverse_kinematics", "forward")
    assert np.ptp(table["azimuth"]) < 1e-12
    modes = table["working_mode"].tolist()
    assert modes[0] in ("+", "-")
    assert modes == [modes[0]] * 3
