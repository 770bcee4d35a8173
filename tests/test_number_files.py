"""Numbers of CSV and Parquet files are those below the header, or the file is refused."""

import pandas as pd
import pytest

import spherekit as sk
from spherekit.errors import FileError
from spherekit.tables.number_files import read_numbers


def read_poses(path):
    """Return the table of inverse kinematics for the poses of a file."""
    analysis = f"inverse_kinematics:file={path}"
    return sk.run("five_bar", analysis, samples=3).frame(degrees=True)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("azimuth,tilt\n30,5,60,5\n35,5,61,5\n", "more cells than the header"),
        ("azimuth,tilt\n30,5,60,5,\n35,5,\n", "more cells than the header"),
        ("azimuth,tilt,\n30,60,\n\n30,60,,1\n", "is not a CSV file"),
        ("azimuth,tilt,azimuth\n30,60,40\n", "several columns have the name azimuth"),
        ("azimuth, tilt, azimuth\n30,60,40\n31,61,41\n", "several columns"),
        ("azimuth [deg],azimuth [rad],tilt\n30,1,60\n", "have the same name"),
    ],
)
def test_a_csv_file_with_surplus_cells_or_repeated_columns_is_refused(
    text, words, tmp_path
):
    """Decimal commas, for example, would otherwise give the pose 30, 5 without a word."""
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(FileError, match=words):
        read_poses(path)


@pytest.mark.parametrize(
    "text",
    [
        "azimuth [deg],tilt [deg]\n30,60,\n\n35,61,\n",
        "azimuth [deg],tilt [deg],,\n30,60,,\n35,61,,\n",
        "tilt [deg],note,note,azimuth [deg]\n60,1,2,30\n61,1,2,35\n",
    ],
)
def test_empty_cells_after_a_row_and_repeated_columns_that_are_not_read_are_accepted(
    text, tmp_path
):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    rows = read_poses(path)
    assert sorted({round(x, 9) for x in rows["azimuth"]}) == [30, 35]
    assert sorted({round(x, 9) for x in rows["tilt"]}) == [60, 61]


@pytest.mark.parametrize("index", [["left", "right"], [7, 9], [(1, 2), (3, 4)]])
def test_the_index_of_a_pandas_frame_in_a_parquet_file_is_no_row_number(index, tmp_path):
    """The rows are counted from 1 in messages, whatever the index is."""
    path = tmp_path / "poses.parquet"
    if isinstance(index[0], tuple):
        index = pd.MultiIndex.from_tuples(index)
    frame = pd.DataFrame({"tilt": [60.0, 61.0], "azimuth": [30.0, 35.0]}, index=index)
    frame.to_parquet(path)
    numbers = read_numbers(path, ["azimuth", "tilt"])
    assert numbers.values.tolist() == [[30.0, 60.0], [35.0, 61.0]]
    assert numbers.places == ["row 1", "row 2"]


def test_the_index_of_a_pandas_frame_in_a_parquet_file_can_be_a_column_of_poses(tmp_path):
    path = tmp_path / "poses.parquet"
    frame = pd.DataFrame({"azimuth": [30.0, 35.0], "tilt": [60.0, 61.0]})
    frame.set_index("azimuth").to_parquet(path)
    assert set(read_numbers(path, ["azimuth"]).values[:, 0]) == {30.0, 35.0}


def test_a_frame_that_pandas_writes_to_a_parquet_file_keeps_its_units(tmp_path):
    path = tmp_path / "poses.parquet"
    frame = sk.run("five_bar", "inverse_kinematics:poses=azimuth=30+tilt=60").frame()
    frame.to_parquet(path)
    assert frame.attrs["units"]["azimuth"] == "rad"
    assert read_numbers(path, ["azimuth", "tilt"]).units == frame.attrs["units"]


@pytest.mark.parametrize(
    "text",
    [
        "table,table,column,unit\nposes,poses,azimuth,rad\n",
        "table,column,column,unit\nposes,azimuth,tilt,rad\n",
        "table,unit\nposes,rad\n",
    ],
)
def test_a_columns_file_of_another_program_beside_the_numbers_is_ignored(text, tmp_path):
    (tmp_path / "poses.csv").write_text("azimuth,tilt\n1,2\n")
    (tmp_path / "columns.csv").write_text(text)
    assert read_numbers(tmp_path / "poses.csv", ["azimuth"]).units == {}
