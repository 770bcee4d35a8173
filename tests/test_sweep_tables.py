"""Whole tables of designs against runs of each design, and sweeps of kernels and runs."""

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest
from helpers.minimal_analysis import MinimalAnalysis

import spherekit as sk
from spherekit.api.sweep import sweep_of
from spherekit.cli.main import main
from spherekit.designs import sweep_identity
from spherekit.designs.dask_cluster import PartComputer
from spherekit.designs.design_space import DesignSpace, parse_variation
from spherekit.designs.sweep_parts import run_sweep
from spherekit.errors import DesignError, OutputError
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of, number_path, with_numbers
from spherekit.files.schema import check
from spherekit.runs import resource_checks, run_identity
from spherekit.tables.table import SAMPLE, Column, Table

CASES = [
    (
        "four_bar",
        {"links.2.arc": [20.0, 200.0, 45.0], "links.4.arc": [40.0, 179.0]},
        ["poles", "singularities", "eksergian"],
        7,
    ),
    ("stephenson", {"links.2.arc": [15.0, 60.0]}, ["poles"], 9),
    ("shaped_cam", {"pairs.contact.profiles.cam.cosines.1": [4.0, 3.5]}, ["poles"], 7),
    ("five_bar", {"links.2.arc": [60.0, 75.0]}, ["workspace", "poles"], (5, 4)),
    ("single_flier", {"pairs.23.longitude": [20.0, 22.0]}, ["poles"], 5),
]


def alike(rows, wanted):
    """Say that two tables have the same rows, but for rounding."""
    assert list(rows.columns) == list(wanted.columns) and len(rows) == len(wanted)
    for name in wanted.columns:
        if wanted[name].dtype == float:
            assert np.allclose(rows[name], wanted[name], 1e-12, 1e-13, equal_nan=True), name
        else:
            assert list(rows[name].astype(str)) == list(wanted[name].astype(str)), name


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, vary, analyses, samples", CASES)
def test_tables_of_designs_are_those_of_runs(name, vary, analyses, samples, tmp_path):
    asked = {"analyses": analyses, "samples": samples, "tables": True}
    swept = sk.sweep(name, vary, **asked)
    in_folder = sk.sweep(name, vary, folder=tmp_path, workers=1, **asked)
    designs, document, with_rows = swept.frame(), document_of(name), set()
    alike(in_folder.frame(), designs)
    for number, rows in designs.groupby("design"):
        values = {
            number_path(document, key): float(rows[key.replace(".", "_")].iloc[0])
            for key in vary
        }
        try:
            changed = with_numbers(document, values)
            check(changed)
            run = sk.run(read(changed), analyses, samples=samples)
        except sk.SpherekitError as problem:
            assert set(rows["status"]) <= {"IMPOSSIBLE", "NEVER_CLOSES"}, problem
            assert all(rows["reason"] != "")
            continue
        assert set(rows["status"]) == {"OK"}
        with_rows.add(number)
        numbers = {mode["number"] for mode in run.summary["assembly_modes"]}
        assert set(rows["assembly_mode"].dropna()) <= numbers
        for analysis, result in run.results.items():
            for table in result.tables:
                main_one = table is result.tables[0]
                stem = analysis if main_one else f"{analysis}_{table.name}"
                whole = swept.table(stem)
                mine = whole[whole["design"] == number].drop(columns="design")
                wanted = run.frame(analysis, table.name)
                alike(mine, wanted)
                assert whole.attrs["units"] == wanted.attrs["units"]
                alike(pd.read_parquet(tmp_path / "tables" / stem), whole)
    assert with_rows and set(swept.table("motion")["design"]) == with_rows
    assert len(pd.read_parquet(tmp_path / "designs")) == len(designs)


def test_figures_of_kernels_and_of_tables_share_a_sweep():
    rate, area = "most=max(abs(rate_43_by_51))", "workspace"
    vary = {"links.2.arc": [60.0, 65.0]}
    both = sk.sweep("five_bar", vary, rate, analyses=[area], samples=(5, 5)).frame()
    kernel = sk.sweep("five_bar", vary, rate, samples=(5, 5)).frame()
    runs = sk.sweep("five_bar", vary, analyses=[area], samples=(5, 5)).frame()
    working = both["mode"].str.startswith("working ")
    assert list(both["most"][~working]) == list(kernel["most"])
    assert list(both["mode"][~working]) == list(kernel["mode"])
    assert list(both["workspace_area"][working]) == list(runs["workspace_area"])
    assert [m.split()[1] for m in both["mode"][working]] == list(runs["mode"])
    assert both["most"][working].isna().all()
    assert both["workspace_area"][~working].isna().all()


@pytest.mark.parametrize(
    "name, link, arc, modes", [("four_bar", "3", 25.0, 2), ("stephenson", "5", 16.0, 4)]
)
def test_figures_in_the_same_assembly_mode_share_a_row(name, link, arc, modes):
    of_table = f"poles.poles link={link} relative_to=1: abs(velocity_coefficient)"
    of_rows = f"abs(velocity_coefficient_{link}_1)"
    figures = [f"table=max({of_table})", f"kernel=max({of_rows})"]
    rows = sk.sweep(name, {"links.2.arc": [arc]}, figures, samples=9).frame()
    assert len(rows) == len(set(rows["mode"])) == modes
    assert rows["table"].to_numpy() == pytest.approx(rows["kernel"].to_numpy(), rel=1e-9)


@dataclass(frozen=True)
class Doubled(MinimalAnalysis):
    """Twice the input; of inputs up to one turn only."""

    name: ClassVar[str] = "doubled"
    tables: ClassVar[tuple[Table, ...]] = (
        Table("doubled", "twice the input", (SAMPLE, Column("twice", "rad", "2 q"))),
    )
    rowwise: ClassVar[bool] = True
    most: float = 10.0

    def compute(self, batch):
        arcs = [size.arcs for size in batch.mechanism.geometry.links.values()]
        if any(abs(arc - np.pi / 4.0) < 0.01 for (arc,) in arcs):
            raise ValueError("not this one")
        return {"doubled": {"sample": batch.sample, "twice": 2.0 * batch.q}}


def swept(vary, folder=None, **options):
    space = DesignSpace.from_variations([parse_variation(*item) for item in vary.items()])
    made = sweep_of("four_bar", space, (), [Doubled()], samples=5, tables=True)
    return run_sweep(made, folder, **options)


def test_plugins_without_figures_have_tables_and_failures_have_reasons(tmp_path):
    result = swept({"links.2.arc": [20.0, 45.0]}, tmp_path)
    designs = result.frame()
    assert list(designs["status"]) == ["OK", "OK", "FAILED"]
    assert "not this one" in designs["reason"].iloc[-1]
    assert set(result.table("doubled")["design"]) == {0}
    assert set(result.table("motion")["design"]) == {0}


@pytest.mark.slow
def test_a_part_without_one_of_its_files_is_made_again(tmp_path):
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 40))}
    first = swept(vary, tmp_path)
    files = {path: path.read_bytes() for path in tmp_path.rglob("part-*")}
    assert first.computed == 3 and len(files) == 9
    (tmp_path / "tables" / "motion" / "part-000001.parquet").unlink()
    assert swept(vary, tmp_path).computed == 1
    assert {path: path.read_bytes() for path in files} == files
    assert swept(vary, tmp_path).computed == 0


def test_conditions_hold_for_tables_too(monkeypatch):
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 7)), "links.3.arc": [70.0]}
    least = "least=min(transmission_angle_43)"
    options = {"analyses": ["poles"], "samples": 7}
    every = sk.sweep("four_bar", vary, least, **options).frame()
    limit = float(every["least"].median())
    met = set(every["design"][every["least"] > limit])
    made = sk.sweep(
        "four_bar", vary, least, tables=True, where=f"least > {limit!r}", **options
    )
    assert 0 < len(met) < 7
    assert set(made.frame()["design"]) == set(made.table("poles")["design"]) == met


def test_parts_by_other_code_are_refused(tmp_path):
    swept({"links.2.arc": [20.0]}, tmp_path)
    path = tmp_path / sweep_identity.DEFINITION_FILE
    definition = json.loads(path.read_text())
    path.write_text(json.dumps({**definition, "spherekit": "0.0.9", "numpy": "1.0"}))
    words = r"other code \(spherekit: 0\.0\.9 there, .* now, numpy: 1\.0 there"
    with pytest.raises(OutputError, match=words):
        swept({"links.2.arc": [20.0]}, tmp_path)
    del definition["machine"]
    path.write_text(json.dumps(definition))
    with pytest.raises(OutputError, match="machine: null there"):
        swept({"links.2.arc": [20.0]}, tmp_path)


def test_a_worker_with_other_versions_writes_nothing(tmp_path):
    sweep = swept({"links.2.arc": [20.0]}).sweep
    code = run_identity.code_identity() | {"numpy": "1.0"}
    with pytest.raises(DesignError, match=r"other versions \(numpy: .* there, 1\.0 now"):
        PartComputer(sweep, str(tmp_path), code)(0)
    assert not list(tmp_path.iterdir())


def test_what_the_disk_does_not_hold_is_said(tmp_path, monkeypatch):
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 40))}
    free = type("", (), {"free": 1000})
    monkeypatch.setattr(resource_checks.shutil, "disk_usage", lambda _: free)
    with pytest.raises(OutputError, match="the tables of 40 designs will take about"):
        swept(vary, tmp_path)
    with pytest.raises(OutputError, match="choose another folder"):
        swept(vary)


def test_the_command_writes_tables_and_says_where(tmp_path, capsys):
    words = ["sweep", "four_bar", "--vary", "links.2.arc=20,25", "--samples", "5"]
    words += ["-a", "poles", "--tables"]
    assert main(words) == 1
    assert "--tables: give the folder" in capsys.readouterr().err
    assert main([*words, "-o", str(tmp_path), "--workers", "1"]) == 0
    said = capsys.readouterr().err
    assert str(tmp_path / "tables" / "poles") in said
    assert len(pd.read_parquet(tmp_path / "tables" / "poles")) == 120
