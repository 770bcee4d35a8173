"""The analysis `inverse_kinematics`: rates, both ways, files, windows, bad input."""

from functools import partial
from itertools import product
from pathlib import Path

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
from spherekit.outputs.dyad_chain import invert_output_rates
from spherekit.outputs.forward_kinematics import ForwardKinematics, output_rates
from spherekit.outputs.pose_solver import GraphKinematics, output_kinematics
from spherekit.positions.motion import make_motion
from spherekit.scenes.scene import SphereMap

CLOSED = ("five_bar", "two_dof_spm", "three_rrr", "agile_eye")
AWAY = 0.05
"""Measures above this are not near a singularity."""


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


def test_values_close_and_rates_are_those_of_the_velocity_equations(solver):
    """Every pair's variable in the loops, and the Jacobian by a second formulation."""
    pairs = range(len(solver.mechanism.pairs))
    poses = poses_for(solver, 60)
    rows = solver.inverse(poses, solver.labels, pairs)
    good = np.asarray(rows.status == sk.Status.OK) & (rows.type_1.min(axis=1) > AWAY)
    good &= rows.type_2 > AWAY
    assert np.sum(good) > 40 and np.max(solver.residual(rows.values[good])) < 1e-13
    own = ForwardKinematics(solver.mechanism).solver
    turns = output_rates(make_motion(own, rows.values[good]), solver.output)
    directions = poses[rows.pose[good]] if solver.points else None
    rates, type_1 = invert_output_rates(turns, directions)
    known = np.isfinite(turns).all(axis=(1, 2))
    assert np.mean(known) > 0.9
    size = np.max(np.abs(rows.rates[good][known]), axis=(1, 2))
    gap = np.max(np.abs(rates - rows.rates[good])[known], axis=(1, 2))
    assert np.max(gap / size) < 1e-10
    assert np.max(np.abs(type_1 - rows.type_1[good])[known]) < 1e-10
    mechanism, output = solver.mechanism, solver.output
    at = own.closure.at(rows.values[good])
    placed, axes = at.rotations, at.vectors
    link, of = (mechanism.link_number[n] for n in (output.link, output.relative_to))
    for k in range(0, len(axes), 5):
        direction = None if directions is None else directions[k]
        if direction is not None:
            direction = placed[k, of] @ direction
        least = least_misfit(mechanism.ends, axes[k], own.driven, link, of, direction)
        assert abs(rows.type_2[good][k] - least) < 1e-12


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_forward_of_inverse_names_the_working_mode(name):
    solver = output_kinematics(sk.load(name))
    rows = solver.inverse(spiral_directions(40), solver.labels)
    good = np.flatnonzero((rows.status == sk.Status.OK) & (rows.type_2 > AWAY))[:40]
    names = solver.mechanism.input_pairs
    text = "+".join(
        f"{name}={value!r}"
        for q in rows.inputs[good].tolist()
        for name, value in zip(names, q, strict=True)
    )
    result, findings = found_in(name, poses=text, unit="rad")
    assert findings["inputs"] == len(good)
    table = result.frame("inverse_kinematics", "forward")
    places = spiral_directions(40)[rows.pose[good]]
    legs = list(solver.form.plane.driven) if solver.form else [0, 1]
    for number, at in enumerate(good):
        own = table[table["pose"] == number]
        gap = np.linalg.norm(own[["x", "y", "z"]].to_numpy() - places[number], axis=1)
        best = own[gap < 1e-11]
        assert len(best)
        signs = {"".join(label[k] for k in legs) for label in best["working_mode"]}
        assert signs == {"".join(rows.mode[at][k] for k in legs)}


def test_phi_and_gamma_of_the_paper():
    """Table 3's first pose: the four sets of driving angles."""
    result, findings = found_in("two_dof_spm", poses="phi=75+gamma=-20")
    table = result.frame()
    inputs = np.degrees(table[["q_21", "q_61"]].to_numpy())
    for each in product((5.3391, 113.7956), (56.7404, 100.7573)):
        assert np.min(np.abs(inputs - each).max(axis=1)) < 1e-4
    assert findings["poses_by_number_of_solutions"] == {"8": 1}
    assert findings["largest_closure_residual_rad"] < 1e-14


def test_derivatives_of_phi_and_gamma_by_differences():
    """Of rows at poses, in every working mode, by the poses at inputs beside."""
    step = 1e-6
    result, _ = found_in("two_dof_spm", poses="phi=40+gamma=9")
    solver = output_kinematics(sk.load("two_dof_spm"))
    for row in result.frame().to_dict("records"):
        at = np.array([row["q_21"], row["q_61"]])
        for k, pair in enumerate(("21", "61")):
            beside = [solver.forward((at + x * np.eye(2)[k])[None]) for x in (-step, step)]
            angles = [solver.form.angles_to(found.directions[:1]) for found in beside]
            for at_name, name in enumerate(("phi", "gamma")):
                one, other = (item[at_name][0] for item in angles)
                slope = row[f"d{name}_dq_{pair}"]
                assert abs((other - one) / (2.0 * step) - slope) < 1e-7 * (1.0 + abs(slope))


@pytest.mark.many
@pytest.mark.parametrize("name", [*CLOSED, "universal_joint"])
def test_the_pose_that_is_offered_is_one(name):
    with pytest.raises(AnalysisError, match="found no poses") as problem:
        sk.run(name, "inverse_kinematics")
    poses = str(problem.value).split("poses=")[1].split(",")[0]
    table = "forward" if name == "universal_joint" else "inverse_kinematics"
    assert len(found_in(name, poses=poses)[0].frame("inverse_kinematics", table))


def test_sets_of_inputs_are_counted_and_told():
    asked = "inverse_kinematics:poses=21=60+51=100+21=40+51=50"
    said = sk.run("five_bar", asked).summary["remarks"]
    assert "4 configurations at 2 sets of inputs" in said[0] and len(said) == 5
    assert "inputs 1: azimuth = 64.2121 deg, tilt = 113.683 deg, working mode" in said[4]


def test_all_ways_to_say_an_orientation(tmp_path):
    turn = Rotation.from_euler("ZYZ", [0.5, 0.7, -1.4])
    x, y, z, w = turn.as_quat()
    solver = output_kinematics(sk.load("three_rrr"))
    said = {
        "qx+qy+qz+qw": [x, y, z, w],
        "qz+qy+qx+qw": [z, y, x, w],
        "rx+ry+rz": turn.as_rotvec(),
        "azimuth+tilt+torsion": [0.5, 0.7, -0.9],
        "+".join(f"r{i}{k}" for i in "123" for k in "123"): turn.as_matrix().ravel(),
    }
    rows = []
    for names, numbers in said.items():
        path = tmp_path / "poses.csv"
        line = ",".join(repr(float(v)) for v in numbers)
        path.write_text(names.replace("+", ",") + f",note\n{line},7\n")
        poses = read_poses(solver, "test", file=str(path), unit="rad").poses
        rows.append(solver.inverse(poses, solver.labels).inputs)
    assert np.isfinite(rows[0]).all() and len(rows[0]) == 8
    for row in rows[1:]:
        assert np.max(wrapped(row - rows[0])) < 1e-14
    path.write_text("rx,ry,rz\n")
    _, findings = found_in("three_rrr", file=path)
    assert findings["poses"] == 0


def test_own_tables_are_read_again(tmp_path):
    """By the units in Parquet, beside CSV or in its header; inputs lead back to poses."""
    result, _ = found_in(
        "five_bar", window="azimuth:10:50:3+tilt:60:70:2", working_mode="+-"
    )
    for degrees in (False, True):
        result.write(tmp_path / str(degrees), degrees=degrees)
    path = tmp_path / "False" / "inverse_kinematics.parquet"
    alone = (tmp_path / "True" / "inverse_kinematics.csv").rename(tmp_path / "alone.csv")
    for file in (path, path.with_suffix(".csv"), alone):
        asked = {"file": file, "columns": "azimuth+tilt", "working_mode": "+-"}
        again, _ = found_in("five_bar", **asked)
        one, other = (each.frame()[["q_21", "q_51"]].to_numpy() for each in (result, again))
        assert np.max(np.abs(one - other)) < (1e-14 if file == path else 1e-12)
    back, findings = found_in("five_bar", file=path, columns="21+51")
    assert findings["inputs"] == len(one)
    table = back.frame("inverse_kinematics", "forward")
    own = table[table["working_mode"] == "+-"][["x", "y", "z"]].to_numpy()
    assert np.max(np.abs(own - result.frame()[["x", "y", "z"]].to_numpy())) < 1e-12


def of_file(name, lines):
    Path("bad.csv").write_text(lines)
    found_in(name, file="bad.csv")


@pytest.mark.parametrize("call", TABLES["poses asked for"])
def test_what_is_asked_wrongly_is_refused(call, tmp_path, monkeypatch):
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
    mechanism = sk.load("five_bar")
    result, findings = found_in(
        mechanism, poses="x=0+y=0+z=-1+x=1+y=0+z=0+x=0.3+y=1+z=0.2", working_mode="++"
    )
    table = result.frame()
    out = table[table["status"] == "OUT_OF_REACH"]
    assert out[["q_21", "q_51", "rate_x_21", "type_2"]].isna().all(axis=None)
    assert (out["margin"] < 0.0).all() and out["limiting"].str.startswith("axes").all()
    near = out[["near_x", "near_y", "near_z"]].to_numpy(float)
    cosine = np.sum(near * out[["x", "y", "z"]].to_numpy(float), axis=1)
    assert len(out) and np.max(np.abs(np.arccos(cosine) - out["away"])) < 1e-7
    rows = output_kinematics(mechanism).inverse(near, ["++"])
    assert np.all(rows.margin >= 0.0) and findings["limits"]


def test_nearest_orientation_is_inside():
    poses = "azimuth=0+tilt=60+torsion=180+azimuth=240+tilt=80+torsion=90"
    table = found_in("three_rrr", poses=poses, working_mode="+++")[0].frame()
    out = table[table["status"] == "OUT_OF_REACH"]
    near = out[[f"near_{axis}" for axis in "xyzw"]].to_numpy(float)
    solver = output_kinematics(sk.load("three_rrr"))
    rows = solver.inverse(Rotation.from_quat(near).as_matrix(), ["+++"])
    assert len(out) and np.all(rows.margin >= 0.0) and np.all(out["away"] > 0.0)


@pytest.mark.parametrize("how", ["window", "poses"])
def test_scene(how):
    """A window is a mesh, a list is points; values are the numbers of solutions."""
    watcher = SceneListener()
    text = "azimuth:0:350:36+tilt:5:175:18"
    if how == "poses":
        text = "+".join(f"azimuth={a}+tilt={b}" for a, b in ((10, 20), (60, 70), (10, 179)))
    asked = [f"inverse_kinematics:{how}={text},nearest=0"]
    result = sk.run(sk.load("five_bar"), asked, samples=2, search=False, recorder=watcher)
    assert not result.failures
    shown = next(
        p for p in watcher.primitives_by_page["Inverse"] if isinstance(p, SphereMap)
    )
    assert len(shown.triangles) == (2 * 35 * 17 if how == "window" else 0)
    table = result.frame()
    solved = table[table["status"] != "OUT_OF_REACH"].groupby("pose").size()
    assert np.array_equal(np.flatnonzero(shown.values), solved.index)
    assert np.array_equal(shown.values[shown.values > 0], solved)
    assert set(watcher.primitives_by_page) >= {"Inverse", "Measure"}


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
def test_row_by_row_is_the_same(name):
    """The position analysis of all links, and its velocity equations, as a second way."""
    closed = output_kinematics(sk.load(name))
    graph = GraphKinematics(closed.kinematics)
    poses, pairs = poses_for(closed, 6), range(len(closed.mechanism.pairs))
    one, other = (x.inverse(poses, x.labels, pairs) for x in (closed, graph))
    rows = [
        np.array([k for k in np.lexsort((x.mode, x.pose)) if x.solved[k]])
        for x in (one, other)
    ]
    one, empty, other = one.rows(rows[0]), other.rows(~other.solved), other.rows(rows[1])
    assert np.array_equal(one.pose, other.pose) and np.array_equal(one.mode, other.mode)
    assert np.max(wrapped(one.values - other.values)) < 1e-12
    assert np.max(np.abs(one.rates - other.rates)) < 1e-11
    assert np.max(np.abs(one.type_2 - other.type_2)) < 1e-12
    assert np.all(empty.mode == "") and np.all(np.isnan(empty.inputs))


def test_what_is_no_parquet_file_is_refused(tmp_path):
    path = tmp_path / "poses.parquet"
    path.write_bytes(b"no such thing")
    with pytest.raises(FileError, match="is not a Parquet file"):
        found_in("five_bar", file=path)
