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

TURN = mechanism_text("units_turn.study")


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A run with rad and one with degrees, by that."""
    top = tmp_path_factory.mktemp("units")
    path = top / "turn.study.toml"
    path.write_text(TURN)
    study = load_study(path)
    result = sk.run(
        study.mechanism,
        ["poles", "eksergian"],
        samples=study.samples,
        laws=study.laws,
        duration=study.duration,
    )
    for degrees in (False, True):
        result.write(top / str(degrees), degrees=degrees)
    return {degrees: top / str(degrees) for degrees in (False, True)}


def stated(folder):
    """Return the units that the side file states, by table and column."""
    table = pd.read_csv(folder / "columns.csv", dtype=str, keep_default_na=False)
    assert table["meaning"].str.len().min() > 0
    units = table.set_index(["table", "column"])["unit"]
    assert units.index.is_unique
    return units


@pytest.mark.parametrize("degrees", [False, True])
def test_side_file_summary_and_parquet_say_the_same(folders, degrees):
    folder = folders[degrees]
    units, summary = stated(folder), json.loads((folder / "summary.json").read_text())
    assert "columns.csv" in summary["files"] and summary["inputs_unit"] == "rad"
    tables = {path.stem: path for path in folder.glob("*.csv") if path.stem != "columns"}
    assert set(tables) == set(summary["units"])
    for name, path in tables.items():
        held = list(pd.read_csv(path, nrows=1).columns)
        frame = read_parquet(path.with_suffix(".parquet"))
        assert held == list(units[name].index) == list(frame.columns)
        assert dict(units[name]) == summary["units"][name] == frame.attrs["units"]
        for column in frame.select_dtypes(float):
            assert units[name][column] != ""


def test_numbers_change_as_their_units_say(folders):
    seen = set()
    for path in folders[False].glob("*.csv"):
        if path.stem == "columns":
            continue
        one, other = (
            pd.read_csv(folders[degrees] / path.name, engine="pyarrow")
            for degrees in (False, True)
        )
        before, after = (stated(folders[degrees])[path.stem] for degrees in (False, True))
        headers = dict(zip(one, other, strict=True))
        for column in one.select_dtypes(float):
            old, new = before[column], after[headers[column]]
            seen.add((old, new))
            ratio = 1.0 if old == new else 180.0 / np.pi
            assert np.allclose(
                other[headers[column]],
                ratio * one[column],
                rtol=1e-14,
                atol=0.0,
                equal_nan=True,
            )
            assert headers[column] == (column if old == new else f"{column} [{new}]")
            if old != new:
                assert new == old.replace("rad", "deg") and old.startswith("rad")
    assert {("rad", "deg"), ("rad/s", "deg/s"), ("rad/s2", "deg/s2")} <= seen
    assert {("1/rad", "1/rad"), ("kg m2/rad", "kg m2/rad"), ("N m", "N m")} <= seen


def test_every_column_of_every_analysis_has_a_unit_that_is_one():
    """Units are products of known ones; what is called an angle is in rad."""
    from spherekit.runs.registry import load_analysis

    known = {"1", "rad", "s", "s2", "kg", "m2", "N", "m", "W", "J", "sr", "or"}
    for name in analysis_names():
        for table in load_analysis(name).tables:
            for column in table.columns:
                for degrees in (False, True):
                    unit = column.stated_unit(degrees)
                    if column.kind != "number":
                        assert unit == ""
                        continue
                    words = unit.replace("/", " ").replace("deg", "rad").split()
                    assert words and set(words) <= known, (name, column)
