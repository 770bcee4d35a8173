"""The analysis `inverse_kinematics`: rates, both ways, files, windows, bad input."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.analysis_runs import run_single_analysis
from helpers.refusals import TABLES, check_call
from helpers.scene_listener import SceneListener
from oracles.velocity_equations import least_misfit
from scipy.spatial.transform import Rotation
from spherekit_analyses.inverse_kinematics.pose_lists import read_poses

import spherekit as sk
from spherekit.errors import AnalysisError, FileError
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.outputs.dyad_chain import invert_jacobian
from spherekit.outputs.forward_kinematics import ForwardKinematics, output_rates
from spherekit.outputs.output_kinematics import InverseRows
from spherekit.outputs.pose_solver import GraphKinematics, output_kinematics
from spherekit.positions.motion import make_motion
from spherekit.scenes.scene import SphereMap
from spherekit.status import Status

CLOSED = ("five_bar", "two_dof_spm", "three_rrr", "agile_eye")
LEAST_MEASURE = 0.05
"""Configurations with a larger measure of type I or II are not near a singularity."""


found_in = partial(run_single_analysis, "inverse_kinematics")


def poses_for(solver, count, seed=1):
    if solver.points:
        return spiral_directions(count)
    return Rotation.random(count, random_state=seed).as_matrix()


def wrapped(angle):
    return np.abs(np.angle(np.exp(1j * angle)))


@pytest.fixture(params=CLOSED, scope="module")
def solver(request):
    return output_kinematics(sk.load(request.param))


@dataclass(frozen=True)
class RegularSolutions:
    """Solutions of inverse kinematics (inputs for a wanted pose), away from singularities.

    At a singularity of type I an input turns without moving the output. At type II the
    output can move although all inputs are locked.

    Attributes
    ----------
    values
        (n, variables) joint angles in rad.
    rates
        (n, inputs, 3) how fast the inputs turn per angular velocity of the output.
    type_1
        (n, inputs) measure of type I of each leg, from 0 (singular, dead centre) to 1.
    type_2
        (n,) measure of type II, from 0 (singular) to 1.
    directions
        (n, 3) unit vectors, if the output is the direction of a pointer, otherwise None.
    """

    values: Any
    rates: Any
    type_1: Any
    type_2: Any
    directions: Any


@pytest.fixture(scope="module")
def regular(solver):
    """Return the solutions of inverse kinematics at 60 poses that are not near singular.

    Tests check the angles, rates and measures of these solutions. A pose is a direction or
    an orientation of the output. Solutions in all working modes are taken. A working mode
    is a choice of one of two ways to bend each leg (chain from an input to the output).
    `solver` has the mechanism.

    At a singularity of type I an input turns without moving the output; at type II the
    output can move although the inputs are locked. A measure of 0 to 1 says how far a
    solution is from each type: `type_1` for each input, and `type_2`.
    """
    all_pairs = range(len(solver.mechanism.pairs))
    poses = poses_for(solver, 60)
    rows = solver.inverse(poses, solver.labels, all_pairs)
    is_regular = np.asarray(rows.status == sk.Status.OK)
    worst_input = rows.type_1.min(axis=1)
    is_regular &= worst_input > LEAST_MEASURE
    is_regular &= rows.type_2 > LEAST_MEASURE
    assert np.sum(is_regular) > 40
    directions = None
    # The solver is for a pointer if its output is a direction and no orientation.
    if solver.points:
        directions = poses[rows.pose[is_regular]]
    return RegularSolutions(
        values=rows.values[is_regular],
        rates=rows.rates[is_regular],
        type_1=rows.type_1[is_regular],
        type_2=rows.type_2[is_regular],
        directions=directions,
    )


def test_joint_angles_of_inverse_kinematics_close_the_loops(solver, regular):
    assert np.max(solver.residual(regular.values)) < 1e-13


def test_rates_and_type_i_measures_invert_the_velocities_of_the_output(solver, regular):
    """Rates of the inputs per rate of the output are the inverse of forward kinematics.

    `regular` has solutions of inverse kinematics of the mechanism of `solver`. For their
    joint angles, forward kinematics gives the velocities of the output per rate of the
    inputs.

    The measure of type I (`type_1`) is compared too. It is the least angular speed of the
    output while one input has the rate 1 and the others have any rates. It also follows
    from the velocities by forward kinematics. If the output is a direction, which is in
    `regular.directions`, a rotation about this direction is ignored.
    """
    position_solver = ForwardKinematics(solver.mechanism).solver
    motion = make_motion(position_solver, regular.values)
    output_velocities = output_rates(motion, solver.output)
    inverted = invert_jacobian(output_velocities, regular.directions)
    # Forward velocities are NaN where the inputs do not determine the motion, which may be
    # so in few rows only.
    is_finite = np.isfinite(output_velocities).all(axis=(1, 2))
    assert np.mean(is_finite) > 0.9
    size = np.max(np.abs(regular.rates[is_finite]), axis=(1, 2))
    gap = np.max(np.abs(inverted.rates - regular.rates)[is_finite], axis=(1, 2))
    assert np.max(gap / size) < 1e-10
    type_1_gap = np.abs(inverted.type_1 - regular.type_1)
    assert np.max(type_1_gap[is_finite]) < 1e-10


def test_the_type_ii_measure_is_the_least_misfit_of_the_velocity_equations(solver, regular):
    """The measure of type II is that of an independent computation by velocity equations.

    It says how strongly locked inputs keep the output from turning. `least_misfit` turns
    the output at unit rate, and returns how much the velocity equations of all links are
    violated at least. `regular` has solutions of inverse kinematics away from
    singularities, of which every fifth is compared. If the output is a pointer, its
    rotation about the direction in which it points is not counted.
    """
    mechanism = solver.mechanism
    position_solver = ForwardKinematics(mechanism).solver
    closed = position_solver.closure.linearise(regular.values)
    link = mechanism.link_number[solver.output.link]
    base = mechanism.link_number[solver.output.relative_to]
    for k in range(0, len(regular.values), 5):
        pointing_direction = None
        if regular.directions is not None:
            base_orientation = closed.rotations[k, base]
            pointing_direction = base_orientation @ regular.directions[k]
        misfit = least_misfit(
            mechanism.ends,
            closed.vectors[k],  # axes of the pairs
            position_solver.driven,  # numbers of the variables of the inputs
            link,
            base,
            pointing_direction,
        )
        assert abs(regular.type_2[k] - misfit) < 1e-12


def driven_legs(solver):
    """Return the numbers of the legs with an input: positions in the label of a mode.

    A working mode has a sign for each leg, the chain of links from an input to the output.
    A mechanism that can be symmetric about a plane has a `form`, which names its driven
    legs; the third leg of `two_dof_spm` is not driven. Other mechanisms of two inputs have
    the driven legs 0 and 1.
    """
    if solver.form:
        return list(solver.form.plane.driven)
    return [0, 1]


def text_of_inputs(input_pairs, inputs):
    """Return rows (n, 2) of inputs in rad as text, "PAIR=VALUE+PAIR=VALUE+..."."""
    texts = []
    for values in inputs.tolist():
        for pair, value in zip(input_pairs, values, strict=True):
            texts.append(f"{pair}={value!r}")
    return "+".join(texts)


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_forward_of_inverse_names_the_working_mode(name):
    """Forward kinematics of inverse solutions returns their direction and working mode.

    The inputs that inverse kinematics computes for a direction are passed to the forward
    analysis, as text in radians. That direction must be among its solutions. All solutions
    with it must have the same signs of the driven legs: the sign of a leg (chain from an
    input to the output) says to which side it is bent.
    """
    solver = output_kinematics(sk.load(name))
    directions = spiral_directions(40)
    rows = solver.inverse(directions, solver.labels)
    # Rows near a singularity of type II are left out: the output is uncertain there.
    is_regular = (rows.status == sk.Status.OK) & (rows.type_2 > LEAST_MEASURE)
    # There are rows of several working modes for each direction. The first 40 are taken.
    chosen = np.flatnonzero(is_regular)[:40]
    poses = text_of_inputs(solver.mechanism.input_pairs, rows.inputs[chosen])
    result, findings = found_in(name, poses=poses, unit="rad")
    assert findings["inputs"] == len(chosen)

    forward_table = result.frame("inverse_kinematics", "forward")
    legs = driven_legs(solver)
    for number, row in enumerate(chosen):
        solutions = forward_table[forward_table["pose"] == number]
        expected_direction = directions[rows.pose[row]]
        computed_directions = solutions[["x", "y", "z"]].to_numpy()
        gap = np.linalg.norm(computed_directions - expected_direction, axis=1)
        matching = solutions[gap < 1e-11]
        assert len(matching)
        signs = {"".join(label[k] for k in legs) for label in matching["working_mode"]}
        expected_signs = "".join(rows.mode[row][k] for k in legs)
        assert signs == {expected_signs}


def test_phi_and_gamma_of_the_paper():
    """The first pose of Table 3 (Chen et al. 2021) has the four printed sets of angles
    (deg).
    """
    result, findings = found_in("two_dof_spm", poses="phi=75+gamma=-20")
    table = result.frame()
    inputs = np.degrees(table[["q_21", "q_61"]].to_numpy())
    for printed in product((5.3391, 113.7956), (56.7404, 100.7573)):
        assert np.min(np.abs(inputs - printed).max(axis=1)) < 1e-4
    assert findings["poses_by_number_of_solutions"] == {"8": 1}
    assert findings["largest_closure_residual_rad"] < 1e-14


def test_derivatives_of_phi_and_gamma_by_differences():
    """Derivatives of the mid-plane's angles by the inputs agree with central differences.

    Base and output link of this mechanism are mirror images in a plane, the mid-plane,
    which the angles phi and gamma describe. For each row of the analysis, forward
    kinematics is evaluated 1e-6 rad beside each input.
    """
    step = 1e-6
    result, _ = found_in("two_dof_spm", poses="phi=40+gamma=9")
    solver = output_kinematics(sk.load("two_dof_spm"))

    def phi_and_gamma(inputs):
        # At given inputs there are two configurations. The output has the same direction in
        # both, which determines the mid-plane and its angles.
        solutions = solver.forward(inputs[None])
        phi, gamma, _ = solver.form.angles_to(solutions.directions[:1])
        return phi[0], gamma[0]

    for row in result.frame().to_dict("records"):
        inputs = np.array([row["q_21"], row["q_61"]])
        for k, pair in enumerate(("21", "61")):
            before = phi_and_gamma(inputs - step * np.eye(2)[k])
            after = phi_and_gamma(inputs + step * np.eye(2)[k])
            for angle, name in enumerate(("phi", "gamma")):
                expected = row[f"d{name}_dq_{pair}"]
                derivative = (after[angle] - before[angle]) / (2.0 * step)
                assert abs(derivative - expected) < 1e-7 * (1.0 + abs(expected))


@pytest.mark.many
@pytest.mark.parametrize("name", [*CLOSED, "universal_joint"])
def test_the_pose_that_is_offered_is_one(name):
    """Without poses the analysis is refused with an example, which then works."""
    with pytest.raises(AnalysisError, match="no poses are given") as problem:
        sk.run(name, "inverse_kinematics")
    poses = str(problem.value).split("poses=")[1].split(",")[0]
    table = "forward" if name == "universal_joint" else "inverse_kinematics"
    assert len(found_in(name, poses=poses)[0].frame("inverse_kinematics", table))


def test_remarks_list_the_configurations_at_each_set_of_inputs():
    analysis = "inverse_kinematics:poses=21=60+51=100+21=40+51=50"
    remarks = sk.run("five_bar", analysis).summary["remarks"]
    assert "4 configurations at 2 sets of inputs" in remarks[0] and len(remarks) == 5
    assert "Inputs 1: azimuth = 64.2121 deg, tilt = 113.683 deg, working mode" in remarks[4]


def test_columns_of_a_file_state_an_orientation_in_five_ways(tmp_path):
    """An orientation in a file gives the same inputs in each of five notations.

    They are a quaternion, the same with its columns in another order, a rotation vector,
    tilt and torsion, and a matrix. SciPy computes their numbers from one rotation. Other
    columns of the file, such as a note, are ignored.
    """
    rotation = Rotation.from_euler("ZYZ", [0.5, 0.7, -1.4])
    x, y, z, w = rotation.as_quat()
    solver = output_kinematics(sk.load("three_rrr"))
    numbers_by_columns = {
        "qx,qy,qz,qw": [x, y, z, w],
        "qz,qy,qx,qw": [z, y, x, w],
        "rx,ry,rz": rotation.as_rotvec(),
        # The Euler angles ZYZ are azimuth, tilt, and torsion less azimuth.
        "azimuth,tilt,torsion": [0.5, 0.7, 0.5 - 1.4],
        "r11,r12,r13,r21,r22,r23,r31,r32,r33": rotation.as_matrix().ravel(),
    }
    path = tmp_path / "poses.csv"
    inputs = []
    for columns, numbers in numbers_by_columns.items():
        line = ",".join(repr(float(number)) for number in numbers)
        path.write_text(f"{columns},note\n{line},7\n")
        # Messages would name "test" as the analysis that reads the file.
        poses = read_poses(solver, "test", file=str(path), unit="rad").poses
        all_working_modes = solver.labels
        inputs.append(solver.inverse(poses, all_working_modes).inputs)
    # Three legs with two ways to bend each.
    assert len(inputs[0]) == 8
    assert np.isfinite(inputs[0]).all()
    for other_inputs in inputs[1:]:
        assert np.max(wrapped(other_inputs - inputs[0])) < 1e-14


def test_a_file_of_poses_may_be_empty(tmp_path):
    """A file with a heading only has no poses, and the run does not fail."""
    path = tmp_path / "poses.csv"
    path.write_text("rx,ry,rz\n")
    _, findings = found_in("three_rrr", file=path)
    assert findings["poses"] == 0


def test_written_tables_are_read_again(tmp_path):
    """The poses in a written table, Parquet or CSV, can be the poses of another analysis.

    The first analysis `inverse_kinematics` computes inputs at the poses of a window of
    directions, and writes both to a table. The second one reads the poses from this file,
    and must find the same inputs. For this it must know the unit of the angles. The unit is
    in the Parquet file, in `columns.csv` beside the CSV, or in the heading of the CSV. The
    working mode "+-" has a sign for each leg, which can be bent in two ways.
    """
    result, _ = found_in(
        "five_bar", window="azimuth:10:50:3+tilt:60:70:2", working_mode="+-"
    )
    for degrees in (False, True):
        result.write(tmp_path / str(degrees), degrees=degrees)
    parquet = tmp_path / "False" / "inverse_kinematics.parquet"
    csv_beside_parquet = parquet.with_suffix(".csv")
    csv_in_degrees = tmp_path / "True" / "inverse_kinematics.csv"
    csv_alone = csv_in_degrees.rename(tmp_path / "alone.csv")
    inputs = result.frame()[["q_21", "q_51"]].to_numpy()
    for file in (parquet, csv_beside_parquet, csv_alone):
        again, _ = found_in(
            "five_bar", file=file, columns="azimuth+tilt", working_mode="+-"
        )
        inputs_again = again.frame()[["q_21", "q_51"]].to_numpy()
        tolerance = 1e-14 if file == parquet else 1e-12
        assert np.max(np.abs(inputs_again - inputs)) < tolerance


def test_the_inputs_of_a_written_table_lead_back_to_its_poses(tmp_path):
    """Forward kinematics of the columns of inputs has the directions of the table."""
    result, _ = found_in(
        "five_bar", window="azimuth:10:50:3+tilt:60:70:2", working_mode="+-"
    )
    result.write(tmp_path)
    poses = result.frame()[["x", "y", "z"]].to_numpy()
    path = tmp_path / "inverse_kinematics.parquet"
    forward_result, findings = found_in("five_bar", file=path, columns="21+51")
    assert findings["inputs"] == len(poses)
    table = forward_result.frame("inverse_kinematics", "forward")
    directions = table[table["working_mode"] == "+-"][["x", "y", "z"]].to_numpy()
    assert np.max(np.abs(directions - poses)) < 1e-12


def read_bad_file(name, lines):
    Path("bad.csv").write_text(lines)
    found_in(name, file="bad.csv")


@pytest.mark.parametrize("call", TABLES["poses asked for"])
def test_bad_poses_are_refused(call, tmp_path, monkeypatch):
    """Each call of "poses asked for" in `refusals.toml` raises the error stated there."""
    monkeypatch.chdir(tmp_path)
    check_call(call, globals(), TABLES["poses asked for"][call])


def test_forward_of_one_freedom():
    """Hooke's joint: tan(output) = tan(input) / cos(shaft angle), here 35 degrees."""
    result, findings = found_in("universal_joint", window="21:5:355:36")
    table = result.frame("inverse_kinematics", "forward")
    assert findings["inputs"] == 36
    assert len(table) == 72 and (table["tilt"] - np.radians(35.0)).abs().max() < 1e-14
    turned = np.tan(table["torsion"] - 0.5 * np.pi) * np.cos(np.radians(35.0))
    assert np.max(np.abs(turned - np.tan(table["q"]))) < 1e-12


def test_rows_out_of_reach_offer_the_nearest_pose():
    """The row of a direction out of reach states the nearest direction that is in reach.

    Columns of inputs are empty in this row. So are `rate_x_21`, the rate of input 21 while
    the output turns about x, and `type_2`, a measure that is 0 at a singularity of type II.
    The margin is the angle (rad) that is left until a leg is stretched or folded; here it
    is negative. The column `limiting` names this limit by the two end axes of the leg and
    the angle between them, as in "axes 54/61 at most 80 deg". `away` is the angle (rad)
    from the wanted direction to the nearest one.
    """
    mechanism = sk.load("five_bar")
    directions = ["x=0+y=0+z=-1", "x=1+y=0+z=0", "x=0.3+y=1+z=0.2"]
    # One working mode is taken, that with both signs positive: one sign for each leg.
    result, findings = found_in(mechanism, poses="+".join(directions), working_mode="++")
    table = result.frame()
    unreached = table[table["status"] == "OUT_OF_REACH"]
    assert unreached[["q_21", "q_51", "rate_x_21", "type_2"]].isna().all(axis=None)
    assert (unreached["margin"] < 0.0).all()
    assert unreached["limiting"].str.startswith("axes").all()
    nearest = unreached[["near_x", "near_y", "near_z"]].to_numpy(float)
    cosine = np.sum(nearest * unreached[["x", "y", "z"]].to_numpy(float), axis=1)
    assert len(unreached) and np.max(np.abs(np.arccos(cosine) - unreached["away"])) < 1e-7
    rows = output_kinematics(mechanism).inverse(nearest, ["++"])
    assert np.all(rows.margin >= 0.0)
    # The summary lists the names of all limits.
    assert findings["limits"]


def test_nearest_orientation_is_inside():
    """The nearest orientation offered for one out of reach can be reached."""
    poses = "azimuth=0+tilt=60+torsion=180+azimuth=240+tilt=80+torsion=90"
    table = found_in("three_rrr", poses=poses, working_mode="+++")[0].frame()
    unreached = table[table["status"] == "OUT_OF_REACH"]
    nearest = unreached[[f"near_{axis}" for axis in "xyzw"]].to_numpy(float)
    solver = output_kinematics(sk.load("three_rrr"))
    rows = solver.inverse(Rotation.from_quat(nearest).as_matrix(), ["+++"])
    assert len(unreached) and np.all(rows.margin >= 0.0) and np.all(unreached["away"] > 0.0)


@pytest.mark.parametrize("how", ["window", "poses"])
def test_the_scene_shows_the_number_of_solutions_of_each_pose(how):
    """The recording shows wanted directions on a sphere, coloured by their solutions.

    A window (grid of azimuths and tilts) is drawn as a mesh, a list as points. 36 x 18
    directions have 2 x 35 x 17 triangles. `SceneListener` collects what is drawn, by page.
    The values must be the numbers of solutions in the table.
    """
    scene_listener = SceneListener()
    if how == "window":
        text = "azimuth:0:350:36+tilt:5:175:18"
    else:
        text = "azimuth=10+tilt=20+azimuth=60+tilt=70+azimuth=10+tilt=179"
    # Two computations are left out, which saves time: the nearest poses of those out of
    # reach (`nearest=0`), and the assembly modes without a closed form (`search=False`).
    analysis = f"inverse_kinematics:{how}={text},nearest=0"
    result = sk.run(
        sk.load("five_bar"), [analysis], samples=2, search=False, recorder=scene_listener
    )
    assert not result.failures
    pages = scene_listener.primitives_by_page
    assert set(pages) >= {"Inverse", "Measure"}
    sphere_map = next(x for x in pages["Inverse"] if isinstance(x, SphereMap))
    assert len(sphere_map.triangles) == (2 * 35 * 17 if how == "window" else 0)
    table = result.frame()
    solutions = table[table["status"] != "OUT_OF_REACH"].groupby("pose").size()
    shown = sphere_map.values
    assert np.array_equal(np.flatnonzero(shown), solutions.index)
    assert np.array_equal(shown[shown > 0], solutions)


def test_pairs_asked_for():
    result, _ = found_in(
        "five_bar", poses="azimuth=10+tilt=20", pairs="32+51", working_mode="-+"
    )
    pairs = result.frame("inverse_kinematics", "pairs").set_index("pair")["value"]
    assert abs(pairs["51"] - result.frame()["q_51"][0]) < 1e-15
    assert "32" in pairs


def test_at_the_image_of_the_output_nothing_is_determined():
    """Where every mid-plane serves, a row is one of them and says that it is singular."""
    solver = output_kinematics(sk.load("two_dof_spm"))
    rows = solver.inverse(solver.form.home[None] @ solver.form.frame.T, ["+++"])
    assert rows.status[0] == sk.Status.AT_SINGULARITY and np.all(rows.type_1 < 1e-14)


@pytest.mark.parametrize("name", ["five_bar", "three_rrr"])
def test_closed_form_rows_equal_those_of_the_graph_of_links(name):
    """Inverse kinematics in closed form equals that by the position analysis of all links.

    The second way solves the loops and velocity equations of the whole graph of links. Rows
    are sorted by pose and working mode before they are compared. ``rates`` are those of the
    inputs per unit angular velocity of the output. ``type_2`` is a measure that is 0 at a
    singularity of type II. A pose without a solution has one row without a working mode.
    """
    closed_form = output_kinematics(sk.load(name))
    graph = GraphKinematics(closed_form.kinematics)
    poses = poses_for(closed_form, 6)
    pairs = range(len(closed_form.mechanism.pairs))

    def solved_rows(kinematics):
        """Return the rows with a solution, sorted, and the rows without one."""
        all_working_modes = kinematics.labels
        rows = kinematics.inverse(poses, all_working_modes, pairs)
        order = [k for k in np.lexsort((rows.mode, rows.pose)) if rows.solved[k]]
        return rows.rows(np.array(order)), rows.rows(~rows.solved)

    rows, _ = solved_rows(closed_form)
    graph_rows, unsolved = solved_rows(graph)
    assert np.array_equal(rows.pose, graph_rows.pose)
    assert np.array_equal(rows.mode, graph_rows.mode)
    assert np.max(wrapped(rows.values - graph_rows.values)) < 1e-12
    assert np.max(np.abs(rows.rates - graph_rows.rates)) < 1e-11
    assert np.max(np.abs(rows.type_2 - graph_rows.type_2)) < 1e-12
    assert np.all(unsolved.mode == "")
    assert np.all(np.isnan(unsolved.inputs))


def test_what_is_no_parquet_file_is_refused(tmp_path):
    path = tmp_path / "poses.parquet"
    path.write_bytes(b"no such thing")
    with pytest.raises(FileError, match="is not a Parquet file"):
        found_in("five_bar", file=path)


def test_a_row_without_a_value_of_a_measure_is_at_a_singularity():
    """A row of inverse kinematics with a measure of NaN gets the status of a singularity.

    A measure of type I (the output rests while an input turns) or II (the output moves with
    locked inputs) is 0 at such a singularity. A measure of NaN does not show that a row is
    regular, so the row counts as singular. The first row has all measures. In the others,
    those of type I, of type II, or of both types are NaN.
    """
    type_1 = np.array([[0.5, 0.4], [0.5, np.nan], [0.5, 0.4], [np.nan, np.nan]])
    type_2 = np.array([0.3, 0.3, np.nan, np.nan])
    count = len(type_2)
    rows = InverseRows(
        pose=np.arange(count),
        mode=np.full(count, "++"),
        inputs=np.zeros((count, 2)),
        status=np.zeros(count, dtype=np.int8),
        margin=np.full(count, 0.1),
        limiting=np.zeros(count, dtype=np.intp),
        type_1=type_1,
        type_2=type_2,
        rates=np.zeros((count, 2, 3)),
        values=np.zeros((count, 0)),
        limits=("reach",),
    )
    assert rows.with_status().status.tolist() == [Status.OK, *[Status.AT_SINGULARITY] * 3]


def test_working_modes_are_chosen_by_numbers_of_any_length():
    solver = output_kinematics(sk.load("five_bar"))
    assert solver.chosen_modes("2") == solver.chosen_modes("02") == solver.modes[2:3]
    for text in ("4", "9" * 5000, "-1"):
        with pytest.raises(AnalysisError, match="is not known; give one of"):
            solver.chosen_modes(text)


def test_an_output_without_working_modes_says_so():
    with pytest.raises(AnalysisError, match="this output has no working modes"):
        found_in("four_bar", poses="21=10", working_mode="0")


def test_joint_limits_bound_the_rows_of_the_graph_of_links_as_those_in_closed_form():
    """0.4 <= q_51 <= 2.0 is |q_51 - 1.2| <= 0.8; other rows are out of reach, with NaN."""
    limited = replace(sk.load("five_bar"), joint_limits=(JointLimit("51", 0.4, 2.0),))
    closed_form = output_kinematics(limited)
    graph = GraphKinematics(closed_form.kinematics)
    unlimited = GraphKinematics(output_kinematics(sk.load("five_bar")).kinematics)
    poses = poses_for(closed_form, 12)
    rows = graph.inverse(poses, graph.labels)
    all_rows = unlimited.inverse(poses, graph.labels)
    assert np.array_equal(rows.pose, all_rows.pose)
    left = 0.8 - wrapped(all_rows.inputs[:, 1] - 1.2)
    assert np.any(left < 0.0)
    assert np.any(left > 0.0)
    assert np.array_equal(rows.solved, left >= 0.0)
    assert np.allclose(rows.margin, left, rtol=0.0, atol=1e-11, equal_nan=True)
    assert np.all(np.isnan(rows.inputs[~rows.solved]))
    (name,) = rows.limits
    assert name == closed_form.bounds[-1].name
    closed_rows = closed_form.inverse(poses, graph.labels)
    assert np.sum(closed_rows.solved) == np.sum(rows.solved)
