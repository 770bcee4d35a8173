"""What runs evaluate and log is the closure of what was asked, and costs what they say."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples import linkages as chains
from rerun.chunk import RrdReader

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.errors import AnalysisError
from spherekit.files.library import find
from spherekit.files.mechanism_reader import loads
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.planning.submechanism import moving_pairs
from spherekit.runs import expected_size
from spherekit.runs.analysis_requests import plan_requests, unite_needs
from spherekit.runs.registry import create_analysis
from spherekit.runs.run_cost import count_evaluations
from spherekit.velocities.pole_evaluation import evaluate

ONE_POLE = "poles:only=6/1"
"""The analysis of the pole of links 6 and 1, the axis of their relative rotation."""
ALL_POLES = "poles"
"""The analysis of all poles: 66 of the 12 links of the twelve-bar."""


@pytest.fixture(scope="module")
def twelve_bar():
    return sk.load("twelve_bar")


def request_of(mechanism, text):
    (wanted,) = plan_requests(mechanism, unite_needs(mechanism, [create_analysis(text)]))
    return wanted


def test_an_irreducible_part_gives_the_poles_that_are_needed():
    made = sk.load("double_butterfly")
    assert not request_of(made, "poles:only=21").plan.blocks
    (block,) = request_of(made, "poles:only=31").plan.blocks
    assert len(block.poles) < 18
    alone, whole = (
        sk.run(made, text, samples=7, search=False).frame()
        for text in ("poles:only=31", "poles")
    )
    part = whole[(whole["link"] == "3") & (whole["relative_to"] == "1")]
    for name in ("ux", "velocity_coefficient", "acceleration_coefficient"):
        assert np.allclose(alone[name], part[name], rtol=0.0, atol=1e-12)


def test_no_derivatives_are_evaluated_if_none_are_needed(twelve_bar):
    """A pole is computed without derivatives if no analysis needs them.

    A pole is the axis of the relative rotation of two links, here 6 and 1 of the
    twelve-bar. By default, each evaluated pole has a derivative of its axis. The pole 6/1
    follows from fewer than 20 of all 66 poles. Its rates must be the same with and without
    derivatives.
    """
    needs = unite_needs(twelve_bar, [create_analysis(ONE_POLE)])
    (request,) = plan_requests(twelve_bar, replace(needs, derivatives=False))
    without_derivatives = count_evaluations(request)
    assert without_derivatives["axis_derivatives"] == 0
    assert without_derivatives["rate_derivatives"] == 0
    with_derivatives = count_evaluations(request_of(twelve_bar, ONE_POLE))
    assert with_derivatives["axis_derivatives"] == with_derivatives["poles"]
    assert without_derivatives["poles"] == with_derivatives["poles"] < 20
    all_poles = count_evaluations(request_of(twelve_bar, ALL_POLES))
    assert all_poles["poles"] == 66

    motion = sk.trace(twelve_bar, samples=3, assembly_mode=0)
    # Links are counted from 0 here, so that (0, 5) are links 1 and 6.
    rate = np.abs(evaluate(motion, request).velocity_coefficient[0, 5])
    frame = sk.run(twelve_bar, ONE_POLE, samples=3, assembly_mode=0).frame()
    assert np.allclose(rate, np.abs(frame["velocity_coefficient"]), rtol=0.0, atol=1e-12)


def logged(path):
    """Entities of a recording with the rows that each has, read back."""
    rows = Counter()
    for chunk in RrdReader(path).stream():
        if chunk.entity_path.startswith("/twelve_bar"):
            rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
    return rows


@pytest.mark.slow
def test_a_recording_holds_the_requested_poles_only(twelve_bar, tmp_path):
    """A recording of one pole of the twelve-bar shows this pole only, not all 66.

    A pole is the axis of the relative rotation of two links. A recording (file of the
    viewer Rerun) has entities, such as an arrow or a plot, by their paths; `logged` reads
    them back. The size of the file and its numbers of entities and rows must be those in
    the summary of the run.
    """
    rows = {}
    sizes = {}
    for name, text in (("narrow", ONE_POLE), ("wide", ALL_POLES)):
        path = tmp_path / f"{name}.rrd"
        with RerunRecorder("twelve_bar", path=path) as recorder:
            result = sk.run(twelve_bar, text, samples=9, assembly_mode=0, recorder=recorder)
        rows[name] = logged(path)  # number of rows by entity
        sizes[name] = path.stat().st_size
        cost = result.summary["cost"]["recording"]
        assert cost["entities"] == len(rows[name])
        assert cost["rows"] == sum(rows[name].values())
        assert cost["bytes"] == sizes[name]
    narrow = set(rows["narrow"])
    wide = set(rows["wide"])

    def poles_of(entities):
        return {x.split("/pole/")[1].split("/")[0] for x in entities if "/pole/" in x}

    assert poles_of(narrow) == {"6_1"}
    assert len(poles_of(wide)) == 66
    plots = {x for x in narrow if "/plots/" in x}
    # Velocity and acceleration coefficient of the pole.
    assert len(plots) == 2
    # Both recordings show all links. That of all poles has a second page with links, the
    # construction of the poles.
    links = {x for x in narrow if "/link/" in x}
    all_links = {x for x in wide if "/link/" in x}
    assert links == {x for x in all_links if "/construction/" not in x}
    assert len(wide) > 4 * len(narrow)
    assert sizes["wide"] > 3 * sizes["narrow"]


@pytest.mark.slow
def test_tables_hold_the_requested_poles_only(twelve_bar, tmp_path):
    """A table of one pole of the twelve-bar has only the rows of this pole.

    A pole is the axis of the relative rotation of two links. The table of all 66 poles has
    66 times as many rows. The summary of the run must state the rows and bytes of every
    file as they are.
    """
    csv_bytes = {}
    row_counts = {}
    for name, text in (("narrow", ONE_POLE), ("wide", ALL_POLES)):
        folder = tmp_path / name
        result = sk.run(twelve_bar, text, samples=40, assembly_mode=0, folder=folder)
        tables = result.summary["cost"]["tables"]
        for stem, table in tables.items():
            assert table["rows"] == len(result.frame(stem))
            for suffix in ("csv", "parquet"):
                size = (folder / f"{stem}.{suffix}").stat().st_size
                assert table[f"{suffix}_bytes"] == size
        csv_bytes[name] = tables["poles"]["csv_bytes"]
        row_counts[name] = tables["poles"]["rows"]
        summary = json.loads((folder / "summary.json").read_text())
        assert summary["cost"]["tables"] == tables
    assert row_counts["wide"] == 66 * row_counts["narrow"]
    # Bytes of text are only roughly proportional to rows.
    assert 50 < csv_bytes["wide"] / csv_bytes["narrow"] < 90


@pytest.mark.slow
def test_the_needed_part_of_a_mechanism_moves_as_the_whole(twelve_bar):
    """With `only_needed`, a part of the twelve-bar moves as in the whole mechanism.

    Links 7 to 12 are left out, because the pole (axis of relative rotation) of links 6 and
    1 does not depend on them. The 32 modes of the whole have only four different motions of
    the part. They are compared as sets of rounded tables: cosines and sines of angles, and
    the angular velocity of the pole.
    """
    whole = sk.run(twelve_bar, ONE_POLE, samples=13)
    part = sk.run(twelve_bar, ONE_POLE, samples=13, only_needed=True)
    assert len(whole.summary["assembly_modes"]) == 32
    assert len(part.summary["assembly_modes"]) == 4
    assert part.summary["part_of"]["left_out_links"] == ["7", "8", "9", "10", "11", "12"]
    assert part.summary["part_of"]["mechanism_hash"] == whole.summary["mechanism_hash"]
    names = ["theta_1_4", "theta_1_6", "theta_3_5"]

    def motions(result):
        poles = result.frame("poles")
        distinct = set()
        for mode, rows in result.frame("motion").groupby("assembly_mode"):
            angles = rows[names].to_numpy()
            pole = poles[poles["assembly_mode"] == mode]
            w = pole[["ux", "uy", "uz"]].mul(pole["velocity_coefficient"], axis=0)
            table = np.column_stack([np.cos(angles), np.sin(angles), w])
            distinct.add((np.round(table, 9) + 0.0).tobytes())  # + 0.0: no negative zero
        return distinct

    assert motions(whole) == motions(part)
    assert len(motions(part)) == 4


def test_inputs_that_move_no_link_asked_are_not_of_its_part():
    """Two driven links beside the four-bar, one on the other."""
    wider = '"21", "51"]\narcs = [60.0, 30.0]\nangles = [90.0]'
    text = find("four_bar").read_text().split("[modes.p0]")[0]
    text = text.replace('"21"]\narcs = [60.0]', wider, 1)
    for name, pair, axes in (("5", "51", '"51", "65"]\narcs = [20.0'), ("6", "65", '"65"')):
        text += f"[links.{name}]\naxes = [{axes}]\n"
        text += f'[pairs.{pair}]\ntype = "R"\nlinks = ["{pair[1]}", "{pair[0]}"]\n'
        text += f"[inputs.{pair}]\nfrom = 0.0\nto = 90.0\n"
    pointed = loads(text)
    for link, pairs in (("3", {"21", "32", "43", "41"}), ("6", {"51", "65"})):
        links = pointed.link_number["1"], pointed.link_number[link]
        moving = moving_pairs(pointed, plan_assembly(pointed), links)
        assert set(pointed.names_of(moving)) == pairs


def test_frames_and_zeros_stay_where_sizes_are_given():
    """Watt gives sizes: axes without pairs still carry the frames of their links."""
    watt = sk.load("watt")
    whole = sk.run(watt, "poles:only=41", samples=9).frame()
    part = sk.run(watt, "poles:only=41", samples=9, only_needed=True)
    assert len(part.summary["part_of"]["left_out_pairs"]) == 3
    for number, own in part.frame().groupby("assembly_mode"):
        same = whole[whole["assembly_mode"] == 2 * number]
        for name in ("ux", "uy", "uz", "velocity_coefficient", "acceleration_coefficient"):
            assert np.array_equal(own[name].to_numpy(), same[name].to_numpy()), name


def test_only_needed_refuses_what_looks_at_the_whole(twelve_bar):
    with pytest.raises(AnalysisError, match="needs the whole mechanism"):
        sk.run("four_bar", "reactions", only_needed=True)
    with pytest.raises(AnalysisError, match="follows from loads"):
        start = sk.Start(0.3, 1.0)
        sk.run(twelve_bar, ONE_POLE, only_needed=True, start=start, duration=1.0)


@pytest.mark.slow
def test_singularities_of_a_part_are_listed_once_for_all_modes_that_have_them(twelve_bar):
    """A singularity of an output is listed once, with all assembly modes that have it.

    Links 4 and 1 of the twelve-bar belong to a part that has two assembly modes (ways to
    assemble the links). The whole mechanism has 32 modes, 16 for each of these two. The
    output 4/1 has four singularities. Each must be listed with 16 modes: those in which the
    velocity coefficient of the pole 4/1 changes its sign there. A second run computes only
    the links that the output needs (`only_needed`), so only this part. It must find the
    singularities at the same input angles.
    """
    text = "singularities:output=4/1"
    run = sk.run(twelve_bar, [text, "poles:only=41"], samples=73)  # pole 4/1 only
    singularities = run.frame("singularities")
    rates = {
        int(mode): rows["velocity_coefficient"].to_numpy()
        for mode, rows in run.frame("poles").groupby("assembly_mode")
    }
    part = sk.run(twelve_bar, text, samples=73, only_needed=True)
    assert len(part.summary["assembly_modes"]) == 2
    assert len(singularities) == 4
    q_of_part = np.sort(part.frame()["q"])
    assert np.allclose(np.sort(singularities["q"]), q_of_part, atol=1e-12)

    q = np.linspace(0.0, 2.0 * np.pi, 73)
    for _, singularity in singularities.iterrows():
        sample_after = int(np.searchsorted(q, singularity["q"]))
        sample_before = sample_after - 1
        modes_with_change = [
            str(mode)
            for mode, rate in rates.items()
            if rate[sample_before] * rate[sample_after] < 0.0
        ]
        assert singularity["assembly_mode"].split("+") == modes_with_change
        assert len(modes_with_change) == 16

    # The table `relation` has the relation between the rates of input and output, in
    # the forms i and ii. In the form i the output rate is the velocity coefficient. Its
    # sign depends on the direction of the pole, so sizes are compared.
    relation = run.frame("singularities", "relation")
    for mode, rows in relation[relation["form"] == "i"].groupby("assembly_mode"):
        coefficients = rows["velocity_coefficient"].to_numpy()
        assert np.max(np.abs(np.abs(coefficients) - np.abs(rates[mode]))) < 1e-11


DERIVATIVE = "sensitivity:of=theta_14,by=links.2.arc,draws=0"


@pytest.mark.parametrize("analysis", ["dynamics", "statics", DERIVATIVE])
def test_only_needed_leaves_the_numbers_of_dynamics_statics_and_sensitivity(analysis):
    """With `only_needed`, a run has the same numbers as a run of the whole mechanism.

    `only_needed` leaves out the links and pairs on which no result depends. The first
    four-bar of Watt's six-bar has a mass and a spring at its rocker, link 4 on pair 14. So
    the other two links are left out, with three pairs.

    An assembly mode is a way to assemble the links. The whole mechanism has more modes than
    the part, and several of them have the same column. So the rounded columns of all modes
    are compared as sets.
    """
    # Sensitivity has a derivative, dynamics and statics have a driving torque.
    column = "derivative" if analysis == DERIVATIVE else "tau"
    spring = sk.Spring("spring", "14", 1.0, 0.2)
    mechanism = sk.load("watt").with_mass("4", 1e-3 * np.eye(3))
    # Without outputs, only masses and loads decide which links are needed.
    mechanism = replace(mechanism, loads=(spring,), outputs=())
    whole = sk.run(mechanism, analysis, samples=9)
    part = sk.run(mechanism, analysis, samples=9, only_needed=True)
    assert len(part.summary["part_of"]["left_out_pairs"]) == 3

    def columns_of_modes(run):
        modes = run.frame().groupby("assembly_mode")
        return {tuple(rows[column].round(9)) for _, rows in modes}

    assert columns_of_modes(whole) == columns_of_modes(part)
    assert len(columns_of_modes(part)) == len(part.summary["assembly_modes"])


@pytest.mark.slow
def test_explain_predicts_rows_and_bytes_of_a_run(tmp_path, capsys):
    """The command `explain` predicts the files that a run of the four-bar writes.

    Rows and columns of tables are predicted exactly. Bytes may be off: of CSV files by 3 %,
    of Parquet files by 30 % and of the recording by 40 %. An entity of a recording is one
    object in it, such as an arrow or a plot.
    """
    options = ["four_bar", "--samples", "2000", "--json"]
    assert main(["explain", *options, "--recording"]) == 0
    predicted = json.loads(capsys.readouterr().out)["predicted"]
    files = ["-o", str(tmp_path), "--save", str(tmp_path / "x.rrd")]
    assert main(["run", *options, *files]) == 0
    cost = json.loads(capsys.readouterr().out)["cost"]

    assert predicted["configurations"] == cost["configurations"]
    assert predicted["assembly_modes"] == 2
    assert predicted["not_predicted"] == []
    for stem, table in cost["tables"].items():
        predicted_table = predicted["tables"][stem]
        assert predicted_table["rows"] == table["rows"]
        assert predicted_table["columns"] == table["columns"]
        assert 0.97 < table["csv_bytes"] / predicted_table["csv_bytes"] < 1.03
        assert 0.7 < table["parquet_bytes"] / predicted_table["parquet_bytes"] < 1.3
    recording = cost["recording"]
    predicted_recording = predicted["recording"]
    assert predicted_recording["entities"] == recording["entities"]
    assert abs(predicted_recording["rows"] / recording["rows"] - 1.0) < 0.01
    assert 0.7 < recording["bytes"] / predicted_recording["bytes"] < 1.4


def test_what_is_not_known_is_not_predicted(capsys):
    assert main(["explain", "single_flier", "-a", "singularities", "-a", "poles"]) == 0
    out = capsys.readouterr().out
    assert "361 configurations for each assembly mode" in out
    assert "not predicted: the number of assembly modes, analysis singularities" in out
    assert main(["explain", "four_bar", "--samples", "2"]) == 0
    assert "sizes: not predicted; a run of 2 samples" in capsys.readouterr().out


def test_the_suggested_run_has_no_abbreviated_option_of_explain(capsys):
    assert main(["explain", "four_bar", "--samples", "2", "--rec", "--verb"]) == 0
    assert "spherekit run four_bar --samples 2  compute this" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("triads", [False, True])
def test_explain_of_a_long_chain_measures_few_rows(triads, tmp_path, capsys, monkeypatch):
    """The command `explain` predicts the files of a 30-link chain from three small runs.

    The chain is a four-bar with dyads (two links each); with `triads` also groups of four
    links are added. Two small runs have 12 and 24 samples and no analysis. The third has 4
    samples and one analysis. None of them searches assembly modes, so the number of modes
    is not predicted (None). The predicted sizes are estimates. CSV files may differ by 25 %
    and Parquet files by a factor of 2.5.
    """
    mechanism = chains.grow_dyad_chain(np.random.default_rng(5), 30, triads)
    path = tmp_path / "chain.toml"
    sk.dump(mechanism, path)
    small_runs = []
    run_study = expected_size.run_study

    def counting_run_study(study, analyses, *arguments):
        small_runs.append((study.count, len(analyses), study.search))
        return run_study(study, analyses, *arguments)

    monkeypatch.setattr(expected_size, "run_study", counting_run_study)
    samples = 24
    assert main(["explain", str(path), "--samples", str(samples), "--json"]) == 0
    predicted = json.loads(capsys.readouterr().out)["predicted"]
    assert small_runs == [(12, 0, False), (24, 0, False), (4, 1, False)]
    assert predicted["assembly_modes"] is None

    out = tmp_path / "out"
    sk.run(path, samples=samples, search=False, folder=out, formats=("csv", "parquet"))
    assert predicted["tables"]["poles"]["rows"] == samples * 30 * 29 // 2
    for name, table in predicted["tables"].items():
        # Rows that fail have empty cells, and few samples do not show how many fail.
        csv_size = (out / f"{name}.csv").stat().st_size
        assert table["csv_bytes"] == pytest.approx(csv_size, rel=0.25)
        parquet_size = (out / f"{name}.parquet").stat().st_size
        assert parquet_size / 2.5 < table["parquet_bytes"] < 2.5 * parquet_size
