"""Whole tables of designs against runs of each design, and sweeps of kernels and runs.

A sweep with `tables` writes every row of the tables of its analyses, with the number of the
design as the first column.
"""

import json
from dataclasses import dataclass
from types import SimpleNamespace
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
from spherekit.designs.figures_of_merit import DesignTable
from spherekit.designs.sweep_parts import run_sweep
from spherekit.errors import DesignError, FileError, OutputError
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of, number_path, with_numbers
from spherekit.files.schema import check
from spherekit.files.study import Study
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
"""Mechanism, varied numbers (deg), analyses and numbers of samples."""


def assert_equal_tables(table, expected):
    """Assert that two tables have the same columns and rows, numbers up to rounding."""
    assert list(table.columns) == list(expected.columns)
    assert len(table) == len(expected)
    for name in expected.columns:
        if expected[name].dtype == float:
            assert np.allclose(
                table[name], expected[name], rtol=1e-12, atol=1e-13, equal_nan=True
            ), name
        else:
            assert list(table[name].astype(str)) == list(expected[name].astype(str)), name


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, vary, analyses, samples", CASES)
def test_tables_of_a_sweep_are_those_of_separate_runs(
    name, vary, analyses, samples, tmp_path
):
    """Each table of each design in a sweep equals that of a separate run of the design.

    A sweep evaluates all combinations of the numbers in `vary` (designs). With `tables` it
    returns all rows of the tables of its analyses, in memory and in a folder. A design that
    a run refuses has a reason, and no rows in any table.
    """
    options = {"analyses": analyses, "samples": samples, "tables": True}
    sweep = sk.sweep(name, vary, **options)
    sweep_in_folder = sk.sweep(name, vary, folder=tmp_path, workers=1, **options)
    designs = sweep.frame()
    assert_equal_tables(sweep_in_folder.frame(), designs)
    document = document_of(name)
    designs_with_rows = set()
    for number, rows in designs.groupby("design"):
        values = {}
        for key in vary:
            column = key.replace(".", "_")
            values[number_path(document, key)] = float(rows[column].iloc[0])
        try:
            changed = with_numbers(document, values)
            check(changed)
            run = sk.run(read(changed), analyses, samples=samples)
        except sk.SpherekitError as error:
            assert set(rows["status"]) <= {"IMPOSSIBLE", "NEVER_CLOSES"}, error
            assert all(rows["reason"] != "")
            continue
        assert set(rows["status"]) == {"OK"}
        designs_with_rows.add(number)
        mode_numbers = {mode["number"] for mode in run.summary["assembly_modes"]}
        assert set(rows["assembly_mode"].dropna()) <= mode_numbers
        for analysis, result in run.results.items():
            for table in result.tables:
                is_main_table = table is result.tables[0]
                stem = analysis if is_main_table else f"{analysis}_{table.name}"
                all_designs = sweep.table(stem)
                is_design = all_designs["design"] == number
                expected = run.frame(analysis, table.name)
                assert_equal_tables(all_designs[is_design].drop(columns="design"), expected)
                assert all_designs.attrs["units"] == expected.attrs["units"]
                in_folder = pd.read_parquet(tmp_path / "tables" / stem)
                assert_equal_tables(in_folder, all_designs)
    assert designs_with_rows
    assert set(sweep.table("motion")["design"]) == designs_with_rows
    assert len(pd.read_parquet(tmp_path / "designs")) == len(designs)


@pytest.mark.slow
def test_figures_of_the_kernel_and_of_an_analysis_share_a_sweep():
    """A sweep can have figures of merit of two kinds, in separate rows.

    A figure of merit is a number for each design and mode. A compiled kernel computes
    figures that are formulas of rates or angles, in each assembly mode (way to assemble the
    links). The analysis `workspace` has figures for each working mode (inverse solution of
    the legs). A sweep with figures of both kinds has the rows that two sweeps with one kind
    each would have. In each row the figure of the other kind is NaN.
    """
    figure = "most=max(abs(rate_43_by_51))"
    vary = {"links.2.arc": [60.0, 65.0]}
    samples = (5, 5)
    both = sk.sweep(
        "five_bar", vary, figure, analyses=["workspace"], samples=samples
    ).frame()
    kernel_only = sk.sweep("five_bar", vary, figure, samples=samples).frame()
    analysis_only = sk.sweep(
        "five_bar", vary, analyses=["workspace"], samples=samples
    ).frame()

    is_working_mode = both["mode"].str.startswith("working ")
    assembly_rows = both[~is_working_mode]
    working_rows = both[is_working_mode]
    assert list(assembly_rows["most"]) == list(kernel_only["most"])
    assert list(assembly_rows["mode"]) == list(kernel_only["mode"])
    assert assembly_rows["workspace_area"].isna().all()
    assert list(working_rows["workspace_area"]) == list(analysis_only["workspace_area"])
    working_modes = [mode.split()[1] for mode in working_rows["mode"]]
    assert working_modes == list(analysis_only["mode"])
    assert working_rows["most"].isna().all()


@pytest.mark.parametrize("figures", [[], ["most=max(abs(rate_43_by_51))"]])
def test_figures_of_working_modes_remain_with_a_stated_assembly_mode(figures):
    """Working modes belong to no assembly mode, and a run of the study has them all."""
    vary = {"links.2.arc": [60.0]}
    figures = ["area=max(workspace.areas part=whole: size)", *figures]
    all_rows = sk.sweep("five_bar", vary, figures, samples=(5, 5)).frame()
    study = Study("stated", sk.load("five_bar"), samples=(5, 5), assembly_mode=1)
    rows = sk.sweep(study, vary, figures).frame()
    assert set(rows["status"]) == {"OK"}
    assert list(rows["area"].dropna()) == list(all_rows["area"].dropna())
    assert len(rows["area"].dropna()) == 4
    other_rows = rows[rows["area"].isna()]
    assert list(other_rows["mode"]) == ["-"] * (len(figures) - 1)


def test_a_design_with_working_modes_is_said_not_to_close_in_the_stated_mode():
    study = Study("stated", sk.load("five_bar"), samples=(5, 5), assembly_mode=1)
    space = DesignSpace.from_variations([parse_variation("links.2.arc", [60.0], "deg")])
    figures = ["area=max(workspace.areas part=whole: size)", "a=max(theta_43)"]
    sweep = sweep_of(study, space, figures, [])
    labels = ["+", "working -", "working +"]
    is_working_mode = [False, True, True]
    table = DesignTable.from_columns(
        [0, 0, 0], ["area", "a"], mode=labels, is_working_mode=is_working_mode
    )
    remaining = sweep._rows_of_wanted_mode(table)
    assert list(remaining.mode) == ["working -", "working +", "-"]
    assert list(remaining.status) == ["OK", "OK", "NEVER_CLOSES"]


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
class DoubledInput(MinimalAnalysis):
    """Analysis for tests: twice the input, or an error for an arc of 45 degrees.

    Sweeps must report such an error as the reason why the design failed, and go on.
    """

    name: ClassVar[str] = "doubled"
    tables: ClassVar[tuple[Table, ...]] = (
        Table("doubled", "twice the input", (SAMPLE, Column("twice", "rad", "2 q"))),
    )
    rowwise: ClassVar[bool] = True  # samples are independent of each other

    def compute(self, batch):
        for size in batch.mechanism.geometry.links.values():
            (arc,) = size.arcs
            if abs(arc - np.pi / 4.0) < 0.01:
                raise ValueError("not this one")
        return {"doubled": {"sample": batch.sample, "twice": 2.0 * batch.q}}


def sweep_doubled_input(vary, folder=None, **options):
    """Sweep the four-bar with the analysis above and all its tables."""
    variations = [parse_variation(key, values, "deg") for key, values in vary.items()]
    space = DesignSpace.from_variations(variations)
    sweep = sweep_of("four_bar", space, (), [DoubledInput()], samples=5, tables=True)
    return run_sweep(sweep, folder, **options)


def test_a_failing_analysis_is_the_reason_of_its_design(tmp_path):
    """The first design has tables; the second, of 45 degrees, has none."""
    result = sweep_doubled_input({"links.2.arc": [20.0, 45.0]}, tmp_path)
    designs = result.frame()
    assert list(designs["status"]) == ["OK", "OK", "FAILED"]
    assert "not this one" in designs["reason"].iloc[-1]
    assert set(result.table("doubled")["design"]) == {0}
    assert set(result.table("motion")["design"]) == {0}


@pytest.mark.parametrize(
    ("name", "figure", "words"),
    [
        ("four_bar", "at(poles.poles: velocity_coefficient, 0)", "several for one sample"),
        ("five_bar", "argmin(poles.poles: ux, 51)", "no column q_51"),
        ("five_bar", "argmax(workspace.areas: size)", "no column of an input"),
    ],
)
def test_a_figure_of_a_table_without_its_input_is_refused(name, figure, words):
    """The first table has several poles at q = 0; the others lack the requested input."""
    designs = sk.sweep(name, {"links.2.arc": [60.0]}, figure, samples=3).frame()
    assert list(designs["status"]) == ["FAILED"]
    assert words in designs["reason"].iloc[0]


def test_a_figure_at_an_input_is_that_row_of_the_table():
    figure = "x=at(poles.poles link=3 relative_to=1: velocity_coefficient, 90)"
    designs = sk.sweep("four_bar", {"links.2.arc": [20.0]}, figure, samples=5).frame()
    poles = sk.run("four_bar", "poles:only=31", samples=5).frame("poles")
    expected = poles.loc[poles["sample"] == 1, "velocity_coefficient"]
    assert np.allclose(designs["x"], expected, rtol=1e-12)


@pytest.mark.slow
def test_a_part_without_one_of_its_files_is_computed_again(tmp_path):
    """Three parts have three files each; the file that is made again is the same."""
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 40))}
    first = sweep_doubled_input(vary, tmp_path)
    contents = {path: path.read_bytes() for path in tmp_path.rglob("part-*")}
    assert first.computed == 3
    assert len(contents) == 9
    (tmp_path / "tables" / "motion" / "part-000001.parquet").unlink()
    assert sweep_doubled_input(vary, tmp_path).computed == 1
    assert {path: path.read_bytes() for path in contents} == contents
    assert sweep_doubled_input(vary, tmp_path).computed == 0


def test_a_condition_leaves_designs_out_of_tables_too():
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 7)), "links.3.arc": [70.0]}
    figure = "least=min(transmission_angle_43)"
    options = {"analyses": ["poles"], "samples": 7}
    unconditional = sk.sweep("four_bar", vary, figure, **options).frame()
    limit = float(unconditional["least"].median())
    expected = set(unconditional["design"][unconditional["least"] > limit])
    assert 0 < len(expected) < 7
    condition = f"least > {limit!r}"
    result = sk.sweep("four_bar", vary, figure, tables=True, where=condition, **options)
    assert set(result.frame()["design"]) == expected
    assert set(result.table("poles")["design"]) == expected


def test_parts_by_other_versions_are_refused(tmp_path):
    vary = {"links.2.arc": [20.0]}
    sweep_doubled_input(vary, tmp_path)
    path = tmp_path / sweep_identity.DEFINITION_FILE
    definition = json.loads(path.read_text())
    path.write_text(json.dumps({**definition, "spherekit": "0.0.9", "numpy": "1.0"}))
    message = r"other code \(spherekit: 0\.0\.9 there, .* now, numpy: 1\.0 there"
    with pytest.raises(OutputError, match=message):
        sweep_doubled_input(vary, tmp_path)
    del definition["machine"]
    path.write_text(json.dumps(definition))
    with pytest.raises(OutputError, match="machine: null there"):
        sweep_doubled_input(vary, tmp_path)


def test_a_worker_with_other_versions_writes_nothing(tmp_path):
    sweep = sweep_doubled_input({"links.2.arc": [20.0]}).sweep
    code = run_identity.code_identity() | {"numpy": "1.0"}
    with pytest.raises(DesignError, match=r"other versions \(numpy: .* there, 1\.0 now"):
        PartComputer(sweep, str(tmp_path), code)(0)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_tables_that_do_not_fit_on_the_disk_are_refused(tmp_path, monkeypatch):
    """The disk is said to have 1000 bytes left."""
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 40))}
    monkeypatch.setattr(
        resource_checks.shutil, "disk_usage", lambda _: SimpleNamespace(free=1000)
    )
    with pytest.raises(OutputError, match="the tables of 40 designs will take about"):
        sweep_doubled_input(vary, tmp_path)
    with pytest.raises(OutputError, match="choose another folder"):
        sweep_doubled_input(vary)


@pytest.mark.slow
def test_a_full_disk_keeps_no_parts_in_a_temporary_folder(tmp_path, monkeypatch):
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 40))}
    monkeypatch.setattr(
        resource_checks.shutil, "disk_usage", lambda _: SimpleNamespace(free=1000)
    )
    with pytest.raises(OutputError, match="parts that are written are kept"):
        sweep_doubled_input(vary, tmp_path)
    with pytest.raises(OutputError) as refusal:
        sweep_doubled_input(vary)
    assert "kept" not in str(refusal.value)


@pytest.mark.parametrize("name", ["tables/doubled", "designs"])
def test_a_table_without_the_file_of_a_part_is_refused(name, tmp_path):
    vary = {"links.2.arc": list(np.linspace(10.0, 40.0, 20))}
    result = sweep_doubled_input(vary, tmp_path)
    assert len(result.table("doubled")) == 20 * 2 * 5
    (tmp_path / name / "part-000001.parquet").unlink()
    with pytest.raises(FileError, match="a file of part 1 is missing"):
        result.table("doubled")


def test_tables_of_designs_that_all_fail_are_said_to_be_missing_for_this_reason():
    result = sweep_doubled_input({"links.2.arc": [45.0]})
    assert result.table_names == ()
    with pytest.raises(DesignError, match="All designs have failed or are left out"):
        result.table("doubled")


def test_the_command_writes_tables_and_prints_their_folder(tmp_path, capsys):
    command = ["sweep", "four_bar", "--vary", "links.2.arc=20,25", "--samples", "5"]
    command += ["-a", "poles", "--tables"]
    assert main(command) == 1
    assert "--tables needs an output folder" in capsys.readouterr().err
    assert main([*command, "-o", str(tmp_path), "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    assert str(tmp_path / "tables" / "poles") in printed
    # 2 designs, 2 modes, 5 samples, 6 poles
    assert len(pd.read_parquet(tmp_path / "tables" / "poles")) == 120


@pytest.mark.slow
def test_a_singularity_at_which_modes_meet_counts_for_each_of_them():
    """At the dead centres of this triple-rocker both assembly modes meet.

    One figure comes from a kernel, the other from the table of singularities.
    """
    figures = [
        "least=min(transmission_angle_43)",
        "total=sum(singularities.singularities: q)",
    ]
    designs = sk.sweep("four_bar", {"links.2.arc": [100.0]}, figures, samples=5).frame()
    mechanism = sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": 100.0})
    table = sk.run(mechanism, "singularities", samples=5).frame("singularities")
    modes = table["assembly_mode"].astype(str)
    assert "0+1" in set(modes)
    assert list(designs["mode"]) == ["+", "-"]
    for number, figure in enumerate(designs["total"]):
        belongs = [str(number) in text.split("+") for text in modes]
        assert figure == pytest.approx(np.degrees(table["q"][belongs].sum()), rel=1e-9)
    assert designs["least"].notna().all()


def test_a_figure_at_an_input_needs_a_table_with_inputs():
    """The table of areas has no inputs; the number of a row is not an input."""
    figure = "at(workspace.areas: size, 0)"
    designs = sk.sweep("five_bar", {"links.2.arc": [60.0]}, figure, samples=3).frame()
    assert list(designs["status"]) == ["FAILED"]
    assert "no column of an input" in designs["reason"].iloc[0]


@pytest.mark.slow
def test_a_figure_at_an_input_is_refused_if_samples_of_a_grid_share_it():
    """Poles have the moving input only; three samples of this grid have it in common."""
    row = "poles.poles link=3 relative_to=1 moving=21"
    sizes = {"links.2.arc": [60.0]}
    figures = [f"at({row}: velocity_coefficient, 40)", f"at({row} sample=1: ux, 40)"]
    refused, accepted = (
        sk.sweep("five_bar", sizes, figure, samples=(3, 3)).frame() for figure in figures
    )
    assert list(refused["status"]) == ["FAILED"]
    assert "one of the inputs" in refused["reason"].iloc[0]
    assert list(accepted["status"]) == ["OK", "OK"]
