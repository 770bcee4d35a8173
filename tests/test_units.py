"""Every column says its unit, and has the numbers of that unit, with degrees or without."""

import json

import numpy as np
import pandas as pd
import pytest
from helpers.refusals import mechanism_text

import spherekit as sk
from spherekit.files.study_reader import load_study
from spherekit.runs.registry import analysis_names
from spherekit.tables.table_files import read_parquet

TURN_STUDY = mechanism_text("units_turn.study")
"""Study of a four-bar over time, whose columns have units with rad, rad/s and rad/s2."""


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Write one run twice; return its folders by whether columns are in degrees.

    The run is that of a four-bar over time, by the study in `TURN_STUDY`.
    """
    parent = tmp_path_factory.mktemp("units")
    path = parent / "turn.study.toml"
    path.write_text(TURN_STUDY)
    study = load_study(path)
    result = sk.run(
        study.mechanism,
        ["poles", "eksergian"],
        samples=study.samples,
        laws=study.laws,
        duration=study.duration,
    )
    folders = {False: parent / "radians", True: parent / "degrees"}
    for is_in_degrees, folder in folders.items():
        result.write(folder, degrees=is_in_degrees)
    return folders


def read_units(folder):
    """Return the units that `columns.csv` states, as a series by table and column."""
    table = pd.read_csv(folder / "columns.csv", dtype=str, keep_default_na=False)
    assert table["meaning"].str.len().min() > 0
    units = table.set_index(["table", "column"])["unit"]
    assert units.index.is_unique
    return units


@pytest.mark.parametrize("is_in_degrees", [False, True])
def test_side_file_summary_and_parquet_state_the_same_units(folders, is_in_degrees):
    """`columns.csv`, `summary.json` and each Parquet file state the same units.

    The fixture `folders` has the files of a run of the four-bar, with columns in radians
    and in degrees. The ranges of the inputs in the summary are in rad in both cases.
    """
    folder = folders[is_in_degrees]
    units = read_units(folder)
    summary = json.loads((folder / "summary.json").read_text())
    assert "columns.csv" in summary["files"]
    assert summary["inputs_unit"] == "rad"
    tables = {path.stem: path for path in folder.glob("*.csv") if path.stem != "columns"}
    assert set(tables) == set(summary["units"])
    for name, path in tables.items():
        columns = list(pd.read_csv(path, nrows=1).columns)
        frame = read_parquet(path.with_suffix(".parquet"))
        assert columns == list(units[name].index) == list(frame.columns)
        assert dict(units[name]) == summary["units"][name] == frame.attrs["units"]
        for column in frame.select_dtypes(float):
            assert units[name][column] != ""


def test_numbers_in_degrees_differ_by_the_factor_of_their_unit(folders):
    """Columns whose unit begins with rad are multiplied by 180/pi and get a new header.

    All other columns, also those in 1/rad, are equal in both folders of the same run.
    """
    unit_changes = set()
    units_by_rad = read_units(folders[False])
    units_by_deg = read_units(folders[True])
    for path in folders[False].glob("*.csv"):
        if path.stem == "columns":
            continue
        in_rad = pd.read_csv(folders[False] / path.name, engine="pyarrow")
        in_deg = pd.read_csv(folders[True] / path.name, engine="pyarrow")
        headers = dict(zip(in_rad, in_deg, strict=True))
        for column in in_rad.select_dtypes(float):
            header = headers[column]
            old_unit = units_by_rad[path.stem][column]
            new_unit = units_by_deg[path.stem][header]
            unit_changes.add((old_unit, new_unit))
            if old_unit == new_unit:
                factor = 1.0
                assert header == column
            else:
                factor = 180.0 / np.pi
                assert header == f"{column} [{new_unit}]"
                assert old_unit.startswith("rad")
                assert new_unit == old_unit.replace("rad", "deg")
            expected = factor * in_rad[column]
            assert np.allclose(
                in_deg[header], expected, rtol=1e-14, atol=0.0, equal_nan=True
            )
    changed = {("rad", "deg"), ("rad/s", "deg/s"), ("rad/s2", "deg/s2")}
    unchanged = {("1/rad", "1/rad"), ("kg m2/rad", "kg m2/rad"), ("N m", "N m")}
    assert changed | unchanged <= unit_changes


def test_every_column_of_every_analysis_has_a_unit():
    """Units of columns with numbers are products or quotients of known units.

    One column has a unit in words: "sr or sr rad", of an area or a volume. Columns without
    numbers have an empty unit. Radians may be written in degrees.
    """
    from spherekit.runs.registry import load_analysis

    known_units = {"1", "rad", "s", "s2", "kg", "m2", "N", "m", "W", "J", "sr", "or"}
    for name in analysis_names():
        for table in load_analysis(name).tables:
            for column in table.columns:
                for is_in_degrees in (False, True):
                    unit = column.stated_unit(is_in_degrees)
                    if column.kind != "number":
                        assert unit == ""
                        continue
                    words = unit.replace("/", " ").replace("deg", "rad").split()
                    assert words, (name, column)
                    assert set(words) <= known_units, (name, column)
