"""A run: tables, files, summary, blocks, recording, and what can go wrong outside."""

import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from helpers.scene_listener import SceneListener

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import OutputError
from spherekit.positions import assembly_mode as assembly_mode
from spherekit.scenes.link_scenes import link_shapes
from spherekit.tables.table_files import read_parquet

POLES = [
    "sample", "assembly_mode", "mode_name", "q", "link", "relative_to", "ux", "uy", "uz",
    "dux_dq", "duy_dq", "duz_dq",
    "velocity_coefficient", "acceleration_coefficient", "conditioning", "error_bound",
    "velocity_coefficient_error_bound",
    "acceleration_coefficient_error_bound", "direction_dq_error_bound",
    "residual", "status", "moving",
]  # fmt: skip


@pytest.fixture(scope="module")
def result():
    return sk.run(sk.load("four_bar"), "poles", samples=37)


def test_frame_is_tidy_and_complete(result):
    frame = result.frame()
    assert list(frame.columns) == POLES
    assert len(frame) == 37 * 2 * 6
    keys = frame.set_index(["sample", "assembly_mode", "link", "relative_to"]).index
    assert keys.is_unique
    assert set(frame["status"]) == {"OK"}
    length = np.sqrt(frame["ux"] ** 2 + frame["uy"] ** 2 + frame["uz"] ** 2)
    assert np.max(np.abs(length - 1.0)) < 1e-14
    frame.loc[:, "ux"] = 9.0
    assert result.frame()["ux"].max() <= 1.0  # frames are their own
    motion = result.frame("motion")
    assert len(motion) == 37 * 2
    assert [c for c in motion.columns if c.startswith("theta_")] == [
        "theta_21", "theta_32", "theta_43", "theta_41",
    ]  # fmt: skip


def test_written_files_read_back_equal(result, tmp_path):
    paths = result.write(tmp_path / "new" / "folder")
    assert sorted(p.name for p in paths) == [
        "columns.csv", "motion.csv", "motion.parquet", "poles.csv", "poles.parquet",
        "summary.json",
    ]  # fmt: skip
    frame = result.frame()
    parquet = read_parquet(tmp_path / "new" / "folder" / "poles.parquet")
    assert parquet.attrs["units"]["q"] == "rad"
    csv = pd.read_csv(
        tmp_path / "new" / "folder" / "poles.csv",
        dtype={"link": str, "relative_to": str, "moving": str},
        engine="pyarrow",  # reads the nearest float, which pandas 2 does not
    )
    for column in POLES:
        if frame[column].dtype == float:
            assert np.array_equal(frame[column], csv[column], equal_nan=True)
            assert np.array_equal(frame[column], parquet[column], equal_nan=True)
        else:
            assert list(frame[column]) == list(csv[column]) == list(parquet[column])
    summary = json.loads((tmp_path / "new" / "folder" / "summary.json").read_text())
    assert summary["mobility"] == {"graph": 1, "rank": 1}
    assert summary["status"] == {"OK": 74}
    assert summary["errors_reached"]["largest_closure_residual_rad"] < 1e-14
    assert len(summary["mechanism_hash"]) == 64
    assert not list(tmp_path.rglob("*.part"))


def test_unreachable_samples_are_rows_with_a_reason():
    made = sk.load("four_bar").with_inputs("43")
    frame = sk.run(made, "poles", samples=61).frame()
    assert len(frame) == 61 * 6 * frame["assembly_mode"].nunique()
    lost = frame[frame["status"] == "OUT_OF_REACH"]
    assert 0 < len(lost) < len(frame)
    names = "ux uy uz velocity_coefficient acceleration_coefficient conditioning"
    assert lost[names.split()].isna().all().all()
    fine = frame[frame["status"] == "OK"]
    assert fine.drop(columns=["status"]).notna().all().all()


def test_wrong_names_of_results(result):
    with pytest.raises(sk.SpherekitError, match='did you mean "poles"'):
        result.frame("pole")
    with pytest.raises(sk.SpherekitError, match="has no table"):
        result.frame("poles", "pols")


def test_folders_that_cannot_be_written(result, tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(OutputError, match="taken"):
        result.write(tmp_path / "taken")
    with pytest.raises(OutputError, match="taken"):
        result.write(tmp_path / "taken" / "below")
    taken = str(tmp_path / "taken")
    assert main(["run", "four_bar", "--samples", "5", "-o", taken]) == 1
    said = capsys.readouterr().err
    assert said.startswith("spherekit: ") and taken in said and "Traceback" not in said
    assert (tmp_path / "taken").read_text() == "mine"
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    if os.access(folder, os.W_OK):
        folder = Path("/proc/spherekit")
    with pytest.raises(OutputError):
        result.write(folder)


def test_scenes_come_block_by_block_while_the_run_goes_on():
    listener, order = SceneListener(), []
    how = {"samples": 25, "block": 10, "recorder": listener}
    how["progress"] = lambda *counts: order.append((*counts, len(listener.row_counts)))
    sk.run(sk.load("four_bar"), "poles", **how)
    assert [entry[:2] for entry in order] == [(10, 25), (20, 25), (25, 25)]
    assert order[0][2] < order[1][2] < order[2][2]
    assert listener.assembly_modes == {0: "Mode 0 (+, p1)", 1: "Mode 1 (-, p0)"}
    assert listener.static_paths == ["link/1", "plan", "graph"]
    for (page, _), rows in listener.samples_by_primitive.items():
        steps = page == "Construction"  # a page with rows of its own
        assert rows == list(range(3 if steps else 25))
    assert np.linalg.norm(listener.focus) == pytest.approx(1.0)


def test_several_inputs_are_told_apart_on_the_stage():
    listener = SceneListener()
    sk.run(sk.load("five_bar"), "poles", samples=(3, 4), assembly_mode=0, recorder=listener)
    assert listener.inputs is None and listener.row == 4
    plots = {path for path in listener.paths if path.startswith("plots/velocity/")}
    assert "plots/velocity/21/4_1" in plots and "plots/velocity/51/4_1" in plots
    # links that a locked input joins have no coefficient to show
    assert "plots/velocity/21/5_1" not in plots and "plots/velocity/51/2_1" not in plots


def test_axes_that_coincide_are_drawn_once():
    for shape in link_shapes(sk.load("bevel_differential")):
        assert all(np.isfinite(curve).all() for curve in shape.curves)
