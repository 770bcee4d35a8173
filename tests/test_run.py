"""A run: tables, files, summary, blocks, recording, and folders that cannot be written."""

import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from helpers.broken_plugins import Sound
from helpers.scene_listener import SceneListener

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import AnalysisError, FileError, OutputError
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


SAMPLES, ASSEMBLY_MODES, POLES_OF_FOUR_LINKS = 37, 2, 6


@pytest.fixture(scope="module")
def result():
    """Return a run of the four-bar: 37 samples, 2 assembly modes, 6 poles."""
    return sk.run(sk.load("four_bar"), "poles", samples=SAMPLES)


def test_the_table_of_poles_has_a_row_for_every_pole_mode_and_sample(result):
    """Rows are unique by these keys, and all poles are unit vectors, to rounding."""
    frame = result.frame()
    assert list(frame.columns) == POLES
    assert len(frame) == SAMPLES * ASSEMBLY_MODES * POLES_OF_FOUR_LINKS
    keys = frame.set_index(["sample", "assembly_mode", "link", "relative_to"]).index
    assert keys.is_unique
    assert set(frame["status"]) == {"OK"}
    length = np.sqrt(frame["ux"] ** 2 + frame["uy"] ** 2 + frame["uz"] ** 2)
    assert np.max(np.abs(length - 1.0)) < 1e-14


def test_the_table_of_motion_has_the_angle_of_every_pair(result):
    motion = result.frame("motion")
    assert len(motion) == SAMPLES * ASSEMBLY_MODES
    angles = [name for name in motion.columns if name.startswith("theta_")]
    assert angles == ["theta_21", "theta_32", "theta_43", "theta_41"]


def test_a_frame_that_is_changed_does_not_change_the_result(result):
    frame = result.frame()
    frame.loc[:, "ux"] = 9.0
    assert result.frame()["ux"].max() <= 1.0


@pytest.mark.parametrize(
    ("name", "column", "meaning"),
    [
        ("four_bar", "theta_41", 'angle of pair "41"'),
        (
            "roller_cam",
            "s_contact_cam",
            'arc length (on the unit sphere) along the profile of link "cam", from its '
            'start to the contact point of pair "contact"',
        ),
        (
            "bevel_differential",
            "s_left_mesh",
            'arc length (on the unit sphere) by which links "left" and "planet" have '
            'rolled on each other at pair "left_mesh"',
        ),
    ],
)
def test_a_column_of_a_pair_says_what_its_variable_measures(
    name, column, meaning, tmp_path
):
    """The file columns.csv explains columns of R pairs and of both kinds of contacts."""
    sk.run(name, samples=2).write(tmp_path)
    columns = pd.read_csv(tmp_path / "columns.csv")
    of_motion = columns[columns["table"] == "motion"].set_index("column")
    assert of_motion.loc[column, "meaning"] == meaning


def test_written_tables_are_read_back_bit_by_bit(result, tmp_path):
    """Tables written as CSV and Parquet are read back with the same numbers bit by bit.

    `result` is a run of the four-bar. The folder is new. No file with the suffix .part,
    used while writing, is left behind.
    """
    folder = tmp_path / "new" / "folder"
    paths = result.write(folder)
    assert sorted(path.name for path in paths) == [
        "columns.csv", "motion.csv", "motion.parquet", "poles.csv", "poles.parquet",
        "summary.json",
    ]  # fmt: skip
    frame = result.frame()
    parquet = read_parquet(folder / "poles.parquet")
    assert parquet.attrs["units"]["q"] == "rad"
    csv = pd.read_csv(
        folder / "poles.csv",
        dtype={"link": str, "relative_to": str, "moving": str},
        engine="pyarrow",  # reads the nearest float, which pandas 2 does not
    )
    for column in POLES:
        if frame[column].dtype == float:
            assert np.array_equal(frame[column], csv[column], equal_nan=True)
            assert np.array_equal(frame[column], parquet[column], equal_nan=True)
        else:
            assert list(frame[column]) == list(csv[column]) == list(parquet[column])
    assert not list(tmp_path.rglob("*.part"))


def test_the_written_summary_has_mobility_status_errors_and_hash(result, tmp_path):
    result.write(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["mobility"] == {"graph": 1, "rank": 1}
    assert summary["status"] == {"OK": SAMPLES * ASSEMBLY_MODES}
    assert summary["errors_reached"]["largest_closure_residual_rad"] < 1e-14
    assert len(summary["mechanism_hash"]) == 64


def test_unreachable_samples_are_rows_with_a_status_and_no_numbers():
    """Pair 43 of the four-bar swings only, so a whole turn of it has such samples."""
    mechanism = sk.load("four_bar").with_inputs("43")
    frame = sk.run(mechanism, "poles", samples=61).frame()
    assert len(frame) == 61 * 6 * frame["assembly_mode"].nunique()
    unreachable = frame[frame["status"] == "OUT_OF_REACH"]
    assert 0 < len(unreachable) < len(frame)
    names = "ux uy uz velocity_coefficient acceleration_coefficient conditioning"
    assert unreachable[names.split()].isna().all().all()
    good = frame[frame["status"] == "OK"]
    assert good.drop(columns=["status"]).notna().all().all()


def test_wrong_names_of_analyses_and_tables_are_refused(result):
    with pytest.raises(sk.SpherekitError, match='did you mean "poles"'):
        result.frame("pole")
    with pytest.raises(sk.SpherekitError, match="has no table"):
        result.frame("poles", "pols")


def test_a_file_in_the_place_of_the_folder_is_refused_and_stays(result, tmp_path, capsys):
    file = tmp_path / "a_file"
    file.write_text("mine")
    with pytest.raises(OutputError, match="a_file"):
        result.write(file)
    with pytest.raises(OutputError, match="a_file"):
        result.write(file / "below")
    assert main(["run", "four_bar", "--samples", "5", "-o", str(file)]) == 1
    message = capsys.readouterr().err
    assert message.startswith("spherekit: ")
    assert str(file) in message
    assert "Traceback" not in message
    assert file.read_text() == "mine"


def test_a_folder_without_permission_to_write_is_refused(result, tmp_path):
    """For root every folder can be written, but for one of the kernel."""
    folder = tmp_path / "locked"
    folder.mkdir()
    folder.chmod(0o500)
    if os.access(folder, os.W_OK):
        folder = Path("/proc/spherekit")
    with pytest.raises(OutputError):
        result.write(folder)


def test_scenes_come_block_by_block_while_the_run_goes_on():
    """A recorder gets the drawings of a run after each block of samples, not at the end.

    25 samples in blocks of 10: `SceneListener` records the drawings that it gets. Their
    number must grow with each report of progress. At the end every drawing has all samples.
    The page "Construction" has three rows, one for each step in which poles are
    constructed. `focus` is the direction in which the camera looks. p1 and p0 are the names
    of the assembly modes in the file.

    Static drawings are the same at all samples. The recorder gets three of them before the
    first block: the ground (link 1), the plan of the construction as a text, and the graph
    of links and pairs.
    """
    listener = SceneListener()
    reports = []

    def note_progress(done, total):
        reports.append((done, total, len(listener.row_counts)))

    sk.run(
        sk.load("four_bar"),
        "poles",
        samples=25,
        block=10,
        recorder=listener,
        progress=note_progress,
    )
    assert [report[:2] for report in reports] == [(10, 25), (20, 25), (25, 25)]
    scene_counts = [report[2] for report in reports]
    assert scene_counts == sorted(set(scene_counts))
    assert listener.assembly_modes == {0: "Mode 0 (p1)", 1: "Mode 1 (p0)"}
    assert listener.static_paths == ["link/1", "plan", "graph"]
    for (page, _), rows in listener.samples_by_primitive.items():
        row_count = 3 if page == "Construction" else 25
        assert rows == list(range(row_count))
    assert np.linalg.norm(listener.focus) == pytest.approx(1.0)


def test_plots_of_several_inputs_have_a_path_for_each_moving_input():
    """Links that a locked input joins do not turn relative to each other: no plot."""
    listener = SceneListener()
    sk.run(sk.load("five_bar"), "poles", samples=(3, 4), assembly_mode=0, recorder=listener)
    assert listener.inputs is None and listener.row == 4
    plots = {path for path in listener.paths if path.startswith("plots/velocity/")}
    assert "plots/velocity/21/4_1" in plots and "plots/velocity/51/4_1" in plots
    assert "plots/velocity/21/5_1" not in plots and "plots/velocity/51/2_1" not in plots


def test_links_with_coinciding_axes_are_drawn_with_finite_curves():
    """In a bevel differential several axes of a link are one line."""
    for shape in link_shapes(sk.load("bevel_differential")):
        assert all(np.isfinite(curve).all() for curve in shape.curves)


def test_a_result_of_a_run_with_a_folder_can_be_written_to_any_folder(tmp_path):
    """The summary there does not repeat facts about the files in the folder of the run."""
    first, copied = tmp_path / "first", tmp_path / "copied"
    sk.run("four_bar", "poles", samples=5, folder=first)
    result = sk.run("four_bar", "poles", samples=7, folder=first)
    assert "replaced_files" in result.summary
    result.write(first)
    result.write(copied, formats=["csv"])
    summary = json.loads((copied / "summary.json").read_text())
    assert "replaced_files" not in summary
    for stem, cost in summary["cost"]["tables"].items():
        assert cost["csv_bytes"] == (copied / f"{stem}.csv").stat().st_size
        assert "parquet_bytes" not in cost
    written = pd.read_csv(copied / "poles.csv", dtype={"link": str})
    np.testing.assert_array_equal(written["ux"], result.frame()["ux"])


def test_writing_a_result_does_not_change_it(tmp_path):
    result = sk.run("four_bar", "poles", samples=5)
    summary = json.dumps(result.summary)
    result.write(tmp_path / "out")
    assert json.dumps(result.summary) == summary


@pytest.mark.parametrize("change", ["more samples", "other input", "degrees"])
def test_a_result_never_has_the_tables_of_a_later_run_in_its_folder(change, tmp_path):
    result = sk.run("four_bar", "poles", samples=5, folder=tmp_path)
    if change == "more samples":
        sk.run("four_bar", "poles", samples=6, folder=tmp_path)
    elif change == "other input":
        sk.run("four_bar", "poles", samples=5, input_pair="41", folder=tmp_path)
    else:
        sk.run("four_bar", "poles", samples=5).write(tmp_path, degrees=True)
    for name in ("motion", "poles"):
        with pytest.raises(FileError, match="has been replaced"):
            result.frame(name)


def test_a_result_can_be_read_after_its_tables_are_written_again(tmp_path):
    result = sk.run("four_bar", "poles", samples=5, folder=tmp_path)
    before = result.frame()
    result.write(tmp_path)
    sk.run("four_bar", "poles", samples=5, folder=tmp_path)
    pd.testing.assert_frame_equal(result.frame(), before)


def test_a_run_without_motion_says_so_if_its_motion_is_read():
    result = sk.run("four_bar", "inverse_kinematics:poses=21=10")
    with pytest.raises(AnalysisError, match="motion has no table in this run"):
        result.frame("motion")


def test_the_default_frame_of_a_failed_first_analysis_is_its_error():
    """Otherwise the tables of another analysis are taken for those of the failed one."""

    class Failing(Sound):
        """An analysis that always fails."""

        def compute(self, batch):
            raise ZeroDivisionError

    result = sk.run("four_bar", [Failing(), "poles"], samples=5)
    with pytest.raises(AnalysisError, match="analysis sound failed"):
        result.frame()
    assert len(result.frame("poles"))
