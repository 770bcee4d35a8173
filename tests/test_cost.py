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
from spherekit.runs.analysis_requests import collect_needs, plan_requests
from spherekit.runs.registry import create_analysis
from spherekit.runs.run_cost import count_evaluations
from spherekit.velocities.pole_evaluation import evaluate

NARROW, WIDE = "poles:only=6/1", "poles"


@pytest.fixture(scope="module")
def twelve():
    return sk.load("twelve_bar")


def request_of(mechanism, text):
    (wanted,) = plan_requests(mechanism, collect_needs(mechanism, [create_analysis(text)]))
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


def test_no_derivatives_where_none_were_asked(twelve):
    needs = collect_needs(twelve, [create_analysis(NARROW)])
    (wanted,) = plan_requests(twelve, replace(needs, derivatives=False))
    counts = count_evaluations(wanted)
    assert counts["axis_derivatives"] == counts["rate_derivatives"] == 0
    narrow, wide = (count_evaluations(request_of(twelve, text)) for text in (NARROW, WIDE))
    assert counts["poles"] == narrow["poles"] == narrow["axis_derivatives"] < 20
    assert wide["poles"] == 66
    motion = sk.trace(twelve, samples=3, assembly_mode=0)
    rate = np.abs(evaluate(motion, wanted).velocity_coefficient[0, 5])
    frame = sk.run(twelve, NARROW, samples=3, assembly_mode=0).frame()
    assert np.allclose(rate, np.abs(frame["velocity_coefficient"]), rtol=0.0, atol=1e-12)


def logged(path):
    """Entities of a recording with the rows that each has, read back."""
    rows = Counter()
    for chunk in RrdReader(path).stream():
        if chunk.entity_path.startswith("/twelve_bar"):
            rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
    return rows


@pytest.mark.slow
def test_recordings_hold_what_was_asked(twelve, tmp_path):
    found, sizes = {}, {}
    for name, text in (("narrow", NARROW), ("wide", WIDE)):
        path = tmp_path / f"{name}.rrd"
        with RerunRecorder("twelve_bar", path=path) as recorder:
            result = sk.run(twelve, text, samples=9, assembly_mode=0, recorder=recorder)
        found[name], sizes[name] = logged(path), path.stat().st_size
        cost = result.summary["cost"]["recording"]
        assert cost["entities"] == len(found[name])
        assert cost["rows"] == sum(found[name].values()) and cost["bytes"] == sizes[name]
    narrow, wide = set(found["narrow"]), set(found["wide"])
    arrows = {entity for entity in narrow if "/pole/" in entity}
    assert {entity.split("/pole/")[1].split("/")[0] for entity in arrows} == {"6_1"}
    plots = {entity for entity in narrow if "/plots/" in entity}
    assert len({entity for entity in plots if "/plots/chart/" not in entity}) == 2
    turning = {entity for entity in narrow if "/link/" in entity}
    every = {entity for entity in wide if "/link/" in entity}
    assert turning == {entity for entity in every if "/construction/" not in entity}
    assert len({e.split("/pole/")[1].split("/")[0] for e in wide if "/pole/" in e}) == 66
    assert len(wide) > 4 * len(narrow)
    assert sizes["wide"] > 3 * sizes["narrow"]


@pytest.mark.slow
def test_tables_fall_with_the_request(twelve, tmp_path):
    size = {}
    for name, text in (("narrow", NARROW), ("wide", WIDE)):
        result = sk.run(twelve, text, samples=40, assembly_mode=0, folder=tmp_path / name)
        tables = result.summary["cost"]["tables"]
        for stem, own in tables.items():
            assert own["rows"] == len(result.frame(stem))
            for kind in ("csv", "parquet"):
                path = tmp_path / name / f"{stem}.{kind}"
                assert own[f"{kind}_bytes"] == path.stat().st_size
        size[name] = tables["poles"]["csv_bytes"], tables["poles"]["rows"]
        kept = json.loads((tmp_path / name / "summary.json").read_text())["cost"]
        assert kept["tables"] == tables
    assert size["wide"][1] == 66 * size["narrow"][1]
    assert 50 < size["wide"][0] / size["narrow"][0] < 90


def test_the_part_moves_as_the_whole(twelve):
    """Each assembly mode of the part is that of several of the whole, number for number."""
    text = "poles:only=6/1"
    whole = sk.run(twelve, text, samples=13)
    part = sk.run(twelve, text, samples=13, only_needed=True)
    counts = [len(run.summary["assembly_modes"]) for run in (whole, part)]
    assert counts == [32, 4]
    assert part.summary["part_of"]["left_out_links"] == ["7", "8", "9", "10", "11", "12"]
    assert part.summary["part_of"]["mechanism_hash"] == whole.summary["mechanism_hash"]
    names = ["theta_1_4", "theta_1_6", "theta_3_5"]

    def curves(result):
        motion, poles = result.frame("motion"), result.frame("poles")
        found = set()
        for number, own in motion.groupby("assembly_mode"):
            angles, w = own[names].to_numpy(), poles[poles["assembly_mode"] == number]
            w = w[["ux", "uy", "uz"]].mul(w["velocity_coefficient"], axis=0)
            key = np.column_stack([np.cos(angles), np.sin(angles), w])
            found.add((np.round(key, 9) + 0.0).tobytes())
        return found

    assert curves(whole) == curves(part) and len(curves(part)) == 4


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


def test_only_needed_refuses_what_looks_at_the_whole(twelve):
    with pytest.raises(AnalysisError, match="looks at the whole mechanism"):
        sk.run("four_bar", "reactions", only_needed=True)
    with pytest.raises(AnalysisError, match="follows from loads"):
        start = sk.Start(0.3, 1.0)
        sk.run(twelve, NARROW, only_needed=True, start=start, duration=1.0)


@pytest.mark.slow
def test_singularities_of_a_part_are_listed_once(twelve):
    """By default in the modes of the whole; its rows are those of the table of poles."""
    text = "singularities:output=4/1"
    run = sk.run(twelve, [text, "poles:only=41"], samples=73)
    places, poles = run.frame("singularities"), run.frame("poles").groupby("assembly_mode")
    rates = {int(mode): x["velocity_coefficient"].to_numpy() for mode, x in poles}
    alone = sk.run(twelve, text, samples=73, only_needed=True)
    assert len(alone.summary["assembly_modes"]) == 2 and len(places) == 4
    assert np.allclose(np.sort(places["q"]), np.sort(alone.frame()["q"]), atol=1e-12)
    q = np.linspace(0.0, 2.0 * np.pi, 73)
    for _, place in places.iterrows():
        k = int(np.searchsorted(q, place["q"]))
        turning = [m for m, rate in rates.items() if rate[k - 1] * rate[k] < 0.0]
        assert place["assembly_mode"].split("+") == [str(mode) for mode in turning]
        assert len(turning) == 16
    relation = run.frame("singularities", "relation")
    relation = relation[relation["form"] == "i"]
    for mode, rows in relation.groupby("assembly_mode"):
        own = rows["velocity_coefficient"].to_numpy()
        assert np.max(np.abs(np.abs(own) - np.abs(rates[mode]))) < 1e-11


DERIVATIVE = "sensitivity:of=theta_14,by=links.2.arc,draws=0"


@pytest.mark.parametrize("analysis", ["dynamics", "statics", DERIVATIVE])
def test_only_needed_keeps_numbers(analysis):
    """The rocker of Watt's first four-bar has mass and a load; the other dyad has none."""
    column = "derivative" if analysis == DERIVATIVE else "tau"
    made = sk.load("watt").with_mass("4", 1e-3 * np.eye(3))
    loads = (sk.Spring("spring", "14", 1.0, 0.2),)
    made = replace(made, loads=loads, outputs=())
    whole = sk.run(made, analysis, samples=9)
    part = sk.run(made, analysis, samples=9, only_needed=True)
    assert len(part.summary["part_of"]["left_out_pairs"]) == 3
    one, other = (
        {tuple(rows[column].round(9)) for _, rows in run.frame().groupby("assembly_mode")}
        for run in (whole, part)
    )
    assert one == other and len(other) == len(part.summary["assembly_modes"])


@pytest.mark.slow
def test_explain_predicts_rows_and_bytes(twelve, tmp_path, capsys):
    path = tmp_path / "x.rrd"
    words = ["explain", "four_bar", "--samples", "2000", "--json", "--recording"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)["predicted"]
    words = ["run", "four_bar", "--samples", "2000", "-o", str(tmp_path), "--json"]
    assert main([*words, "--save", str(path)]) == 0
    cost = json.loads(capsys.readouterr().out)["cost"]
    assert found["configurations"] == cost["configurations"]
    assert found["assembly_modes"] == 2 and found["not_predicted"] == []
    for stem, own in cost["tables"].items():
        guess = found["tables"][stem]
        assert (guess["rows"], guess["columns"]) == (own["rows"], own["columns"])
        assert 0.97 < own["csv_bytes"] / guess["csv_bytes"] < 1.03
        assert 0.7 < own["parquet_bytes"] / guess["parquet_bytes"] < 1.3
    assert found["recording"]["entities"] == cost["recording"]["entities"]
    assert abs(found["recording"]["rows"] / cost["recording"]["rows"] - 1.0) < 0.01
    assert 0.7 < cost["recording"]["bytes"] / found["recording"]["bytes"] < 1.4


def test_what_is_not_known_is_not_predicted(capsys):
    assert main(["explain", "single_flier", "-a", "singularities", "-a", "poles"]) == 0
    out = capsys.readouterr().out
    assert "predicted, for each assembly mode: 361 configurations" in out
    assert "not predicted: the number of assembly modes, analysis singularities" in out
    assert main(["explain", "four_bar", "--samples", "2"]) == 0
    assert "sizes: not predicted; a run of 2 samples" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("triads", [False, True])
def test_explain_of_a_long_chain_measures_few_rows(triads, tmp_path, capsys, monkeypatch):
    """Of one mode; and what it says is what a run of one mode writes."""
    made = chains.grow_dyad_chain(np.random.default_rng(5), 30, triads)
    path = tmp_path / "chain.toml"
    sk.dump(made, path)
    calls = []
    run = expected_size.run_study

    def counting(study, analyses, *others):
        calls.append((study.count, len(analyses), study.search))
        return run(study, analyses, *others)

    monkeypatch.setattr(expected_size, "run_study", counting)
    samples = 24
    assert main(["explain", str(path), "--samples", str(samples), "--json"]) == 0
    sizes = json.loads(capsys.readouterr().out)["predicted"]
    assert calls == [(12, 0, False), (24, 0, False), (4, 1, False)]
    assert sizes["assembly_modes"] is None
    out = tmp_path / "out"
    sk.run(path, samples=samples, search=False, folder=out, formats=("csv", "parquet"))
    poles = sizes["tables"]["poles"]
    assert poles["rows"] == samples * 30 * 29 // 2
    for name, table in sizes["tables"].items():
        size = (out / f"{name}.csv").stat().st_size
        # Rows that fail have empty cells, and few samples do not say how many fail.
        assert table["csv_bytes"] == pytest.approx(size, rel=0.25)
        size = (out / f"{name}.parquet").stat().st_size
        assert size / 2.5 < table["parquet_bytes"] < 2.5 * size
