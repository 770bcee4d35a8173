"""Sweeps over designs against every design evaluated on its own."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.named_mechanisms import crank_rocker
from mechanism_examples.shipped_mechanisms import load_without_loads, with_file_numbers

import spherekit as sk
from spherekit.api.sweep import sweep_of
from spherekit.cli.main import main
from spherekit.designs.design_space import DesignSpace, parse_variation
from spherekit.designs.design_variables import design_variable
from spherekit.designs.figure_gradients import FigureGradients
from spherekit.designs.figures_of_merit import DesignSamples
from spherekit.designs.sweep_identity import DEFINITION_FILE
from spherekit.designs.sweep_parts import run_sweep
from spherekit.designs.synthesis_modes import SynthesisMode
from spherekit.errors import ModelError, OutputError
from spherekit.files.library import find
from spherekit.files.number_change import document_of
from spherekit.files.study import Study

SAMPLES = 25

FIGURES = {
    "least_rate": "min(rate_{pair})",
    "largest": "max(abs(velocity_coefficient_{link}_{ground}))",
    "bend": "max(abs(acceleration_coefficient_{link}_{ground}))",
    "mean": "mean(cos(theta_{pair}))",
    "swing": "swing(theta_{pair})",
    "place": "argmax(rate_{pair})",
    "there": "at(sin(theta_{pair}), 100)",
}


def of_mode(mechanism, mode, pair, pole):
    """Return the same figures from poles by the plan, in one mode."""
    (driven,) = mechanism.inputs
    q = np.linspace(driven.start, driven.stop, SAMPLES)
    here = sk.evaluate(mechanism, q, assembly_mode=mode)
    closed = here.status == 0
    theta, rate = here.variable(pair), here.variable_coefficient(pair)
    pieces = np.split(theta, np.flatnonzero(~closed))
    pieces = [np.unwrap(piece[np.isfinite(piece)]) for piece in pieces]
    there = sk.evaluate(mechanism, np.radians(100.0), assembly_mode=mode)
    return {
        "closes": np.mean(closed),
        "least_rate": np.nanmin(rate),
        "largest": np.nanmax(np.abs(here.velocity_coefficient(pole))),
        "bend": np.nanmax(np.abs(here.acceleration_coefficient(pole))),
        "mean": np.nanmean(np.cos(theta)),
        "swing": np.degrees(max(np.ptp(piece) for piece in pieces if len(piece))),
        "place": np.degrees(q[np.nanargmax(rate)]) % 360.0,
        "there": np.sin(there.variable(pair))[0],
    }


CASES = [
    ("four_bar", ["links.1.arc", "links.3.arc", "pairs.41.zero"], "41", "3"),
    ("stephenson", ["links.1.arcs.14", "links.3.angle", "links.6.arc"], "16", "5"),
    ("watt", None, None, None),
]


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, keys, pair, link", CASES)
def test_rows_are_those_of_each_design_on_its_own(name, keys, pair, link):
    mechanism, document = sk.load(name), document_of(name)
    ground = mechanism.ground
    if keys is None:
        sizes = mechanism.geometry.links.items()
        keys = [f"links.{k}.arcs.{leads}" for k, own in sizes for leads in own.axes[1:]]
        link = mechanism.links[-1]
        pair = next(p.name for p in mechanism.pairs if link in p.links)
    pole = f"{link}/{ground}"
    rng = np.random.default_rng(3)
    before = np.array([design_variable(document, key).value for key in keys])
    designs = before[:, None] + rng.normal(size=(len(keys), 4)) * 4.0
    designs[:, 0] = before
    words = {"pair": pair, "link": link, "ground": ground}
    reduce = [f"{k}={text.format(**words)}" for k, text in FIGURES.items()]
    for values in designs.T:
        design = dict(zip(keys, values, strict=True))
        vary = {key: [value] for key, value in design.items()}
        found = sk.sweep(name, vary, reduce, samples=SAMPLES).frame()
        changed = with_file_numbers(name, design)
        modes = sk.trace(changed, samples=SAMPLES).assembly_modes
        assert sorted(found["mode"]) == sorted(mode.label for mode in modes)
        for mode in modes:
            row = found[found["mode"] == mode.label].iloc[0].copy()
            wanted = of_mode(changed, mode.number, pair, pole)
            row["place"] %= 360.0
            for figure, value in wanted.items():
                assert row[figure] == pytest.approx(value, rel=1e-9, abs=1e-9), figure


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, middle", [("four_bar", "43"), ("stephenson", "56")])
def test_figures_of_analyses_are_those_of_their_tables(name, middle):
    """The plane of the fourth link of form ii gave another angle in six-bars."""
    analyses = ["singularities", "eksergian"][: 1 + (name == "four_bar")]
    vary = {"links.2.arc": [15.0]}
    found = sk.sweep(name, vary, analyses=analyses, samples=SAMPLES).frame()
    other = sk.load(name).with_sizes(angle_unit="deg", arcs={"2": 15.0})
    run = sk.run(other, analyses, samples=SAMPLES)
    labels = {m.label: m.number for m in sk.trace(other, samples=3).assembly_modes}
    near = run.frame("singularities", "relation").groupby("assembly_mode")
    near = np.degrees(near["transmission"].min())
    for _, row in found.iterrows():
        least = row[f"least_transmission_angle_{middle}"]
        assert least == pytest.approx(near[labels[row["mode"]]], abs=1e-7)
        if name == "four_bar":
            table = run.frame("eksergian")
            table = table[table["assembly_mode"] == labels[row["mode"]]]
            assert row["largest_torque"] == pytest.approx(table["tau"].abs().max())
            assert row["largest_inertia"] == pytest.approx(table["B"].max(), rel=1e-9)


def test_reactions_are_figures():
    found = sk.sweep("four_bar", {"links.2.arc": [20.0]}, analyses=["reactions"], samples=7)
    run = sk.run("four_bar", "reactions", samples=7).frame("reactions", "reactions")
    most = run[run["pair"] == "43"].groupby("assembly_mode")["transverse_moment"].max()
    assert found.frame()["largest_reaction_43"].tolist() == most.tolist()


@pytest.mark.slow
def test_tables_of_runs_give_figures_of_what_no_kernel_knows():
    key = "pairs.contact.profiles.cam.cosines.1"
    text = (
        "most=max(poles.poles link=follower relative_to=frame: abs(velocity_coefficient))"
    )
    found = sk.sweep("shaped_cam", {key: [4.0]}, text, samples=7).frame()
    own = found.set_index("mode")
    run = sk.run("shaped_cam", "poles", samples=7).frame("poles")
    run = run[(run["link"] == "follower") & (run["relative_to"] == "frame")]
    for mode, rows in run.groupby("assembly_mode"):
        assert own.loc[str(mode), "most"] == rows["velocity_coefficient"].abs().max()
    row = "max(abs(velocity_coefficient_follower_frame))"
    of_rows = sk.sweep("shaped_cam", {key: [4.0]}, f"most={row}", samples=7).frame()
    assert of_rows["most"].to_numpy() == pytest.approx(own["most"].to_numpy(), rel=1e-12)
    bend = "most=" + row.replace("velocity", "acceleration")
    of_rows = sk.sweep("shaped_cam", {key: [4.0]}, bend, samples=7).frame()
    for mode, rows in run.groupby("assembly_mode"):
        most = of_rows.loc[of_rows["mode"].str.startswith(str(mode)), "most"].item()
        own = rows["acceleration_coefficient"].abs().max()
        assert most == pytest.approx(own, rel=1e-10)


def test_designs_that_cannot_be_are_rows_with_their_reason():
    vary = {"links.2.arc": [20.0, 0.0, 190.0], "links.3.arc": [70.0, 5.0]}
    found = sk.sweep("four_bar", vary, "at(theta_41 + q, 30)", samples=9).frame()
    assert "at_theta_41_q_30" in found and sorted(set(found["design"])) == list(range(6))
    assert set(found["reason"][found["status"] == "OK"]) == {""}
    assert set(found["status"]) == {"OK", "IMPOSSIBLE"}
    reasons = found[found["status"] != "OK"].set_index("design")["reason"]
    assert reasons[2] == "links.2.arc = 0: not between 0 and 180 deg"
    assert reasons[4].startswith("links.2.arc = 190")
    assert found[found["design"] == 1]["closes"].max() < 1.0
    assert list(found["grashof"][found["design"] == 0]) == 2 * ["crank-rocker"]
    assert set(found["grashof"][found["status"] == "IMPOSSIBLE"]) == {""}
    vary = {"pairs.contact.profiles.cam.radius": [25.0, 169.0]}
    last = sk.sweep("roller_cam", vary, "max(q)", samples=3).frame().iloc[-1]
    assert last["status"] == "IMPOSSIBLE" and last["reason"] == (
        "roller_cam: pairs.contact: the profiles curve into each other, or alike"
    )


def test_the_command_prints_a_word_for_each_design_and_each_reason_once(capsys):
    vary = ["--vary", "links.2.arc=20,0,190", "--vary", "links.4.arc=45,179"]
    assert main(["sweep", "four_bar", *vary, "--reduce", "max(q)", "--samples", "9"]) == 0
    lines = capsys.readouterr().out.splitlines()
    table, reasons = "\n".join(lines[:-2]), lines[-2:]
    assert "IMPOSSIBLE" in table and "NEVER_CLOSES" in table and "between" not in table
    assert [line.strip() for line in reasons] == [
        "IMPOSSIBLE, designs 2, 3, 4, 5: of 2 links.2.arc = 0: not between 0 and 180 deg",
        "NEVER_CLOSES, design 1: does not close at any sample",
    ]


ACTED = mechanism_text("sweeps_acted")


@pytest.mark.slow
def test_masses_and_loads_are_inputs_of_the_kernel(tmp_path):
    path = tmp_path / "acted.toml"
    whole = find("four_bar").read_text()
    path.write_text(whole[: whole.index("[mass.2]")] + ACTED)
    vary = {
        "mass.3.mass": [2.0, 5.0, -1.0],
        "mass.3.centre.0": [0.1, 0.4],
        "loads.weight.acceleration.1": [-9.8, 4.0],
        "loads.back.rest": [20.0, -35.0],
        "loads.rub.torque": [0.4],
        "loads.push.point.1": [-0.5],
        "links.4.arc": [42.0],
    }
    reduce = ["peak=max(abs(torque))", "mean=mean(torque)", "most=max(B)"]
    sweep = sweep_of(
        path,
        DesignSpace.from_variations([parse_variation(*v) for v in vary.items()]),
        reduce,
    )
    sweep = replace(
        sweep, samples=DesignSamples.from_study(Study("", sweep.mechanism, samples=19))
    )
    assert sweep.evaluator.kernel is not None
    found = run_sweep(sweep).frame()
    bad = found["mass_3_mass"] < 0.0
    assert found["reason"][bad].str.contains("mass").all() and sum(bad) == 8
    for _, row in found[~bad].iloc[::5].iterrows():
        design = {key: row[key.replace(".", "_")] for key in vary}
        run = sk.run(with_file_numbers(path, design), "eksergian", samples=19)
        table = run.frame("eksergian")
        table = table[table["assembly_mode"] == (0 if row["mode"] == "+" else 1)]
        assert row["peak"] == pytest.approx(table["tau"].abs().max(), rel=1e-9)
        assert row["mean"] == pytest.approx(table["tau"].mean(), rel=1e-9)
        assert row["most"] == pytest.approx(table["B"].max(), rel=1e-9)


def test_masses_stated_by_sizes_follow_them(tmp_path):
    path = tmp_path / "bar.toml"
    path.write_text(mechanism_text("bar"))
    found = sk.sweep(path, {"links.c.arc": [20.0, 40.0]}, "max(B)", samples=5).frame()
    for arc in (20.0, 40.0):
        alpha = np.radians(arc)
        # A uniform arc about one of its ends: m R^2 times the mean of sin^2.
        wanted = 0.02 * (0.5 - np.sin(2.0 * alpha) / (4.0 * alpha))
        rows = found[found["links_c_arc"] == arc]
        assert np.allclose(rows["max_B"], wanted, rtol=1e-12)


@pytest.mark.parametrize("scheme", ["grid", "sobol", "latin", "random"])
def test_a_design_is_the_same_in_whatever_part_it_is_asked_for(scheme):
    variations = [
        parse_variation("a", "1:2:5"),
        parse_variation("b", "3,7,9"),
        parse_variation("c", "0:1:4"),
    ]
    count, seed = (None, 0) if scheme == "grid" else (60, 5)
    space = DesignSpace.from_variations(variations, count, scheme, seed=seed)
    whole = space.compute_designs(0, 60)
    assert whole.shape == (3, 60)
    cuts = [0, 1, 17, 18, 60]
    parts = [space.compute_designs(*ends) for ends in pairwise(cuts)]
    assert np.array_equal(np.concatenate(parts, axis=1), whole)
    assert set(whole[1]) <= {3.0, 7.0, 9.0}
    if scheme == "grid":
        assert len({tuple(design) for design in whole.T}) == 60


def test_conditions_leave_out_designs_and_rows():
    vary = {"links.2.arc": "10:40:7", "links.4.arc": "20:50:4"}
    reduce = "least=min(transmission_angle_43)"
    every = sk.sweep("four_bar", vary, reduce, samples=9).frame()
    where = ["links_2_arc < links_4_arc", "least > 30"]
    found = sk.sweep("four_bar", vary, reduce, where=where, samples=9).frame()
    kept = every[(every["links_2_arc"] < every["links_4_arc"]) & (every["least"] > 30.0)]
    assert 0 < len(found) < len(every)
    text = dict.fromkeys(("mode", "status", "grashof"), str)
    kept = kept.reset_index(drop=True).astype(text)
    pd.testing.assert_frame_equal(found.astype(text), kept)


def test_a_swing_goes_on_where_the_turn_begins_anew():
    """A range from 0 to 360 deg cuts through what -180 to 180 has in one piece."""
    sizes = {"base": 179.9, "crank": 30.0, "coupler": 100.0, "rocker": 110.0}
    vary, reduce = {"links.crank.arc": [30.0]}, "swing=swing(theta_hinge)"
    both = [crank_rocker(**sizes, inputs={"drive": x}) for x in ((0, 360), (-180, 180))]
    swings = [sk.sweep(x, vary, reduce, samples=361).frame()["swing"] for x in both]
    assert np.allclose(*swings, rtol=1e-9, atol=0.0)
    assert np.all(swings[0] > 150.0)


def test_nothing_left_is_no_row(capsys):
    command = ["sweep", "four_bar", "--vary", "links.2.arc=20", "--samples", "9"]
    assert main([*command, "--reduce", "a=min(rate_41)", "--where", "a > 100"]) == 0
    assert "0 rows" in (said := capsys.readouterr().out)
    assert "none meets a > 100" in said and "Empty" not in said


def test_sizes_of_a_mechanism_with_a_locked_pair_are_its_own(capsys):
    words = ["sweep", "five_bar", "--lock", "51=30", "--vary", "links.2.arc=50:70:3"]
    words += ["--reduce", "most=max(abs(velocity_coefficient_3_1))", "--samples", "9"]
    assert main([*words, "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    held = sk.lock(sk.load("five_bar"), {"51": 30.0}, angle_unit="deg")
    assert {row["design"] for row in rows} == {0, 1, 2}
    for row in rows:
        made = held.with_sizes(angle_unit="deg", arcs={"2": row["links_2_arc"]})
        (driven,) = made.inputs
        modes = {m.label: m.number for m in sk.trace(made, samples=3).assembly_modes}
        here = sk.evaluate(
            made,
            np.linspace(driven.start, driven.stop, 9),
            assembly_mode=modes[row["mode"]],
        )
        most = np.nanmax(np.abs(here.velocity_coefficient("3/1")))
        assert row["most"] == pytest.approx(most, rel=1e-9)


def rows_of(folder):
    """Return all rows of all data sets, in order of the parts."""
    parts = sorted(folder.rglob("part-*.parquet"))
    return [pq.ParquetFile(part).read().to_pandas() for part in parts]


def done_parts(folder):
    """Return the parts of the table of designs, which are written last."""
    return [part for kind in (".", "designs") for part in folder.glob(f"{kind}/part-*")]


VARIED = ["links.2.arc=10:40:40", "links.3.arc=50:90:41", "links.4.arc=30:60:40"]
FEWER = ["links.2.arc=10:40:12", "links.3.arc=0:90:10"]


@pytest.fixture(scope="module", params=["figures", "tables"])
def whole(request, tmp_path_factory):
    """A command for a sweep of several parts, and its rows when nothing disturbs it."""
    folder = tmp_path_factory.mktemp("whole")
    code = [sys.executable, "-m", "spherekit", "sweep", "four_bar", "--samples", "91"]
    if request.param == "figures":
        varied, what = VARIED, {"reduce": "max(rate_41)"}
        code += ["--reduce", "max(rate_41)"]
    else:
        varied, what = FEWER, {"analyses": ["poles"], "tables": True}
        code += ["-a", "poles", "--tables"]
    vary = dict(text.split("=") for text in varied)
    sk.sweep("four_bar", vary, **what, samples=91, folder=folder, workers=1)
    code += [word for text in varied for word in ("--vary", text)]
    assert len(done_parts(folder)) > 4
    return [*code, "-q", "-o"], rows_of(folder)


def first_part(running, folder):
    """Wait until a sweep has written something."""
    while not done_parts(folder):
        assert running.poll() is None
        time.sleep(0.002)


@pytest.mark.slow
def test_a_sweep_that_was_killed_goes_on_to_the_same_data_set(whole, tmp_path):
    code, rows = whole
    running = subprocess.Popen([*code, tmp_path, "--workers", "1"])
    first_part(running, tmp_path)
    running.send_signal(signal.SIGKILL)
    running.wait()
    left = {part: part.stat().st_mtime_ns for part in done_parts(tmp_path)}
    subprocess.run([*code, tmp_path, "--workers", "2"], check=True)
    assert all(part.stat().st_mtime_ns == when for part, when in left.items())
    for one, other in zip(rows, rows_of(tmp_path), strict=True):
        pd.testing.assert_frame_equal(one, other, check_exact=True)


def test_a_folder_holds_one_sweep_that_is_known(tmp_path):
    sweep = partial(sk.sweep, "four_bar", {"links.2.arc": [10.0, 20.0]}, "max(q)")
    sweep(samples=5, folder=tmp_path)
    again = sweep(samples=5, folder=tmp_path)
    assert again.computed == 0 and len(again.frame()) == 4
    with pytest.raises(OutputError, match="of another sweep.*samples: "):
        sweep(samples=6, folder=tmp_path)
    (tmp_path / DEFINITION_FILE).unlink()
    with pytest.raises(OutputError, match="does not say of what"):
        sweep(samples=5, folder=tmp_path)


@pytest.mark.many
@pytest.mark.parametrize("where", [(), "links_2_arc > 25"])
def test_a_folder_is_one_data_set(where, tmp_path, monkeypatch):
    """Also where no row of the first part is left."""
    monkeypatch.setattr("spherekit.designs.design_evaluation.CLOSED_FORM_PART_SIZE", 2)
    vary = {"links.2.arc": [10.0, 20.0, 30.0, 200.0, 40.0]}
    how = {"where": where, "folder": tmp_path, "workers": 1}
    found = sk.sweep("four_bar", vary, "max(rate_41)", samples=5, **how)
    assert found.sweep.part_count == 3
    read, wanted = pd.read_parquet(tmp_path), found.frame()
    assert len(read) == len(wanted) > 3
    for name in ("design", "links_2_arc", "closes", "max_rate_41"):
        assert np.array_equal(read[name], wanted[name], equal_nan=True)
    for name in ("mode", "status", "claim", "grashof"):
        assert list(read[name].astype(str)) == list(wanted[name].astype(str))


@pytest.mark.slow
def test_lost_workers_of_a_cluster_change_nothing(whole, tmp_path):
    pytest.importorskip("distributed")
    code, rows = whole
    file, folder = tmp_path / "scheduler.json", tmp_path / "parts"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    run = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1"]
    run += ["--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    processes = [subprocess.Popen(run, **quiet)]
    try:
        while not (file.exists() and file.read_text().endswith("}")):
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        work = [sys.executable, "-m", "distributed.cli.dask_worker", address]
        work += ["--nthreads", "1", "--no-dashboard", "--no-nanny"]
        processes += [subprocess.Popen(work, **quiet) for _ in range(2)]
        running = subprocess.Popen([*code, folder, "--dask", address])
        first_part(running, folder)
        os.kill(processes[1].pid, signal.SIGKILL)
        assert running.wait(300) == 0
    finally:
        for process in processes:
            process.kill()
            process.wait()
    for one, other in zip(rows, rows_of(folder), strict=True):
        pd.testing.assert_frame_equal(one, other, check_exact=True)


def test_a_mechanism_that_states_no_input_is_driven_as_in_runs():
    """Hooke's joint: its ratio goes from the cosine of the angle of the shafts to 1/it."""
    made = sk.load("universal_joint")
    assert made.inputs[0].is_default
    found = sk.sweep(made, {"links.1.arc": [10.0, 35.0]}, "s=range(rate_41)").frame()
    cosine = np.cos(np.radians(found["links_1_arc"].to_numpy()))
    assert found["s"].to_numpy() == pytest.approx(1.0 / cosine - cosine, rel=1e-12)


def wound_up(pair, zero=0.0, range_=(0.0, 360.0), crank=20):
    """Return a four-bar with a coil whose rest is not where its angle begins anew."""
    coil = {"kind": "spring", "pair": pair, "stiffness": 2.0, "rest": 30.0}
    return crank_rocker(
        crank=crank,
        zero=zero,
        inputs={"drive": range_},
        mass={"rocker": {"tensor": [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 0.5]]}},
        loads={"coil": coil},
    )


def torques_of_runs(subject, samples):
    """Return the largest and least torque of each mode, by the analysis."""
    rows = sk.run(subject, "eksergian", samples=samples).frame()
    modes = rows.groupby("assembly_mode")["tau"]
    return np.sort(np.stack([modes.max(), modes.min()], axis=1), axis=0)


HIGH_AND_LOW = ["high=max(torque)", "low=min(torque)"]


@pytest.mark.many
@pytest.mark.parametrize(
    "pair, zero, range_, crank, samples",
    [
        ("hinge", -70.0, (0.0, 360.0), 20.0, 97),
        ("tip", 0.0, (0.0, 360.0), 20.0, 97),
        ("drive", 0.0, (0.0, 720.0), 20.0, 97),
        ("hinge", -70.0, (-100.0, 900.0), 20.0, 97),
        ("hinge", 161.5, (-390.0, 760.0), 20.0, 5),
        ("hinge", 161.5, (-390.0, 760.0), 56.566, 4),
        ("hinge", 161.5, (-390.0, 760.0), 85.162, 60),
    ],
)
def test_coils_are_wound_on_beyond_half_a_turn(pair, zero, range_, crank, samples):
    """Also of few samples, and of modes that do not reach zero, over three turns."""
    mechanism = wound_up(pair, zero, range_, crank)
    wanted = torques_of_runs(mechanism, samples)
    vary = {"links.crank.arc": [crank, crank + 1.0]}
    found = sk.sweep(mechanism, vary, HIGH_AND_LOW, samples=samples)
    rows = found.frame()
    rows = rows[rows["design"] == 0]
    assert np.allclose(np.sort(rows[["high", "low"]], axis=0), wanted, rtol=1e-9)
    gradients = FigureGradients(found.sweep.evaluator)
    modes = [SynthesisMode(sign) for sign in "+-"]
    highs = [gradients.evaluate(np.array([crank]), mode).figures[0] for mode in modes]
    assert np.allclose(np.sort(highs), wanted[:, 0], rtol=1e-9)


@pytest.mark.slow
def test_coils_are_wound_on_in_groups_beyond_dyads_and_at_inputs():
    spring = sk.Spring("coil", "C", stiffness=2.0, rest=0.3)
    mechanism = load_without_loads("double_butterfly").with_loads(spring)
    inertia = [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    mechanism = mechanism.with_mass("8", inertia)
    wanted = torques_of_runs(mechanism, 73)
    latitude = design_variable(document_of(mechanism), "pairs.C.latitude")
    reduce = [*HIGH_AND_LOW, "there=at(torque, 185)"]
    vary = {latitude.key: [latitude.value]}
    rows = sk.sweep(mechanism, vary, reduce, samples=73).frame()
    assert set(rows["claim"]) == {"complete"}
    assert np.allclose(np.sort(rows[["high", "low"]], axis=0), wanted, rtol=1e-7, atol=1e-9)
    run = sk.run(mechanism, "eksergian", samples=73).frame()
    run = run[np.isclose(run["q"], np.radians(185.0))]["tau"].dropna()
    assert np.allclose(np.sort(rows["there"].dropna()), np.sort(run), rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_angles_in_groups_beyond_dyads_are_those_of_runs():
    keys = ["C.longitude", "E.latitude", "H.latitude", "F.longitude"]
    changed = dict(zip([f"pairs.{key}" for key in keys], [5, 15, 12, 30], strict=True))
    motion = sk.trace(with_file_numbers("double_butterfly", changed), samples=37)
    theta = np.degrees(motion.values[:, motion.mechanism.variable_names.index("theta_F")])
    theta = theta.reshape(-1, 37)
    wanted = np.stack([np.nanmax(theta, axis=1), np.nanmin(theta, axis=1)], axis=1)
    assert np.max(np.ptp(wanted, axis=1)) > 350.0
    reduce, vary = ["max(theta_F)", "min(theta_F)"], {k: [v] for k, v in changed.items()}
    rows = sk.sweep("double_butterfly", vary, reduce, samples=37).frame()
    rows = np.sort(rows[["max_theta_F", "min_theta_F"]], axis=0)
    assert np.allclose(rows, np.sort(wanted, axis=0), rtol=0.0, atol=1e-8)


def test_sensitivities_are_of_coils_that_are_wound_on():
    mechanism = wound_up("tip")
    asked = "sensitivity:of=torque,by=links.crank.arc,draws=0"
    table, rows = (sk.run(mechanism, x, samples=37).frame() for x in (asked, "eksergian"))
    assert np.allclose(table["value"], rows["tau"], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("periodic", [False, True])
def test_tables_of_torques_are_those_of_runs(periodic):
    times = [0.0, 0.7, 1.0, 2.5] if periodic else [-1.0, 0.7, 1.0, 7.0]
    torques = [1.0, -2.0, 3.0, 1.0]
    base = wound_up("tip")
    table = sk.TorqueTable("gust", "hinge", tuple(times), tuple(torques), periodic)
    mechanism = base.with_loads(*base.loads, table)
    wanted = torques_of_runs(mechanism, 61)
    varied = {"loads.gust.torques.1": [-2.0, -1.0]}
    rows = sk.sweep(mechanism, varied, HIGH_AND_LOW, samples=61).frame()
    rows = rows[["high", "low"]].to_numpy().reshape(2, 2, 2)
    assert np.allclose(np.sort(rows[0], axis=0), wanted, rtol=1e-9)
    assert np.all(np.any(rows[0] != rows[1], axis=1))
    if not periodic:
        longer = mechanism.with_inputs(ranges={"drive": (0, 720)}, angle_unit="deg")
        with pytest.raises(ModelError, match="but the table has"):
            sk.sweep(longer, {"links.crank.arc": [20.0]}, HIGH_AND_LOW)
