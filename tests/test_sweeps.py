"""Sweeps over designs against every design evaluated on its own.

A sweep evaluates many designs, that is values of varied numbers of a mechanism, and reduces
the columns of each to figures of merit. It is divided into parts, which are written as
Parquet files and can be computed by several processes.
"""

import json
import os
import re
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
from spherekit.errors import DesignError, ModelError, OutputError
from spherekit.files.library import find
from spherekit.files.number_change import document_of
from spherekit.files.study import Study
from spherekit.files.time_law import ConstantSpeed, Polynomial
from spherekit.runs.reductions import REDUCTION_BY_NAME

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
"""Figures of merit of a pair, and of a link relative to the ground."""


def compute_figures(mechanism, mode, pair, pole):
    """Compute `FIGURES` of one assembly mode in another way than a sweep.

    An assembly mode is a way to assemble the links. A sweep uses a compiled kernel. Here
    `sk.evaluate` computes configurations and poles (axes of relative rotation), and NumPy
    reduces them. The results are, over a range of the input:

    - "closes": share of the samples at which the loops close,
    - "least_rate": smallest rate of the pair per rate of the input,
    - "largest", "bend": largest velocity and acceleration coefficient of the pole (rates of
      rotation per rate of the input),
    - "mean": mean cosine of the angle of the pair,
    - "swing": range of this angle (deg), "place": input (deg) at which its rate is largest,
    - "there": sine of this angle at the input 100 deg.
    """
    (driven,) = mechanism.inputs
    q = np.linspace(driven.start, driven.stop, SAMPLES)
    motion = sk.evaluate(mechanism, q, assembly_mode=mode)
    closes = motion.status == 0
    theta = motion.variable(pair)
    rate = motion.variable_coefficient(pair)
    # The swing is that of the largest interval in which the loops close.
    intervals = np.split(theta, np.flatnonzero(~closes))
    intervals = [np.unwrap(interval[np.isfinite(interval)]) for interval in intervals]
    swing = max(np.ptp(interval) for interval in intervals if len(interval))
    at_100_deg = sk.evaluate(mechanism, np.radians(100.0), assembly_mode=mode)
    return {
        "closes": np.mean(closes),
        "least_rate": np.nanmin(rate),
        "largest": np.nanmax(np.abs(motion.velocity_coefficient(pole))),
        "bend": np.nanmax(np.abs(motion.acceleration_coefficient(pole))),
        "mean": np.nanmean(np.cos(theta)),
        "swing": np.degrees(swing),
        # An input at 0 is the same as at 360 deg.
        "place": np.degrees(q[np.nanargmax(rate)]) % 360.0,
        "there": np.sin(at_100_deg.variable(pair)),
    }


CASES = [
    ("four_bar", ["links.1.arc", "links.3.arc", "pairs.41.zero"], "41", "3"),
    ("stephenson", ["links.1.arcs.14", "links.3.angle", "links.6.arc"], "16", "5"),
    ("watt", None, None, None),
]
"""Mechanism, varied numbers, pair and link of the figures; None varies all arcs."""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, keys, pair, link", CASES)
def test_rows_of_a_sweep_are_the_figures_of_each_design(name, keys, pair, link):
    """Each mode of each design has a row, with the figures that a run of it leads to.

    A figure of merit is a number for each design and assembly mode (way to assemble the
    links), such as the smallest rate of a pair (`FIGURES`). `compute_figures` is the
    independent reference. The designs are the nominal one and three random ones. Each
    varied number of these differs from the nominal one by a normal random number with a
    deviation of 4 degrees.
    """
    mechanism = sk.load(name)
    document = document_of(name)
    ground = mechanism.ground
    if keys is None:
        # All arcs vary. An arc is that from the first axis of a link to another one, after
        # which it is named.
        keys = []
        for number, size in mechanism.geometry.links.items():
            keys += [f"links.{number}.arcs.{axis}" for axis in size.axes[1:]]
        link = mechanism.links[-1]
        pair = next(p.name for p in mechanism.pairs if link in p.links)
    random = np.random.default_rng(3)
    nominal = np.array([design_variable(document, key).value for key in keys])
    designs = nominal[:, None] + random.normal(size=(len(keys), 4)) * 4.0
    designs[:, 0] = nominal
    # Formulas such as "least_rate=min(rate_41)".
    figures = [
        f"{figure}={text.format(pair=pair, link=link, ground=ground)}"
        for figure, text in FIGURES.items()
    ]
    for values in designs.T:
        design = dict(zip(keys, values, strict=True))
        vary = {key: [value] for key, value in design.items()}
        frame = sk.sweep(name, vary, figures, samples=SAMPLES).frame()
        changed = with_file_numbers(name, design)
        modes = sk.trace(changed, samples=SAMPLES).assembly_modes
        assert sorted(frame["mode"]) == sorted(mode.label for mode in modes)
        for mode in modes:
            row = frame[frame["mode"] == mode.label].iloc[0].copy()
            # "place" is the input (deg) of an extreme. 0 and 360 deg are the same input.
            row["place"] %= 360.0
            expected = compute_figures(changed, mode.number, pair, f"{link}/{ground}")
            for figure, value in expected.items():
                assert row[figure] == pytest.approx(value, rel=1e-9, abs=1e-9), figure


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, middle_pair", [("four_bar", "43"), ("stephenson", "56")])
def test_figures_of_analyses_in_a_sweep_are_extremes_of_their_tables(name, middle_pair):
    """The figures that analyses add to a sweep are extremes of the tables of a run.

    A figure is one number for each design and assembly mode (way to assemble the links).
    Here the figures are the least transmission angle at the pair between coupler and
    output, the largest driving torque, and the largest inertia B reduced to the input. A
    run of the same analyses, `singularities` and `eksergian`, computes the tables.
    `eksergian` is left out for the six-bar, which has no loads.
    """
    analyses = ["singularities"]
    if name == "four_bar":
        analyses.append("eksergian")
    vary = {"links.2.arc": [15.0]}
    frame = sk.sweep(name, vary, analyses=analyses, samples=SAMPLES).frame()
    design = sk.load(name).with_sizes(angle_unit="deg", arcs={"2": 15.0})
    run = sk.run(design, analyses, samples=SAMPLES)
    modes = sk.trace(design, samples=3).assembly_modes
    numbers_by_label = {mode.label: mode.number for mode in modes}
    relation = run.frame("singularities", "relation").groupby("assembly_mode")
    least_transmission_deg = np.degrees(relation["transmission"].min())
    for _, row in frame.iterrows():
        mode = numbers_by_label[row["mode"]]
        least = row[f"least_transmission_angle_{middle_pair}"]
        assert least == pytest.approx(least_transmission_deg[mode], abs=1e-7)
        if name == "four_bar":
            table = run.frame("eksergian")
            table = table[table["assembly_mode"] == mode]
            assert row["largest_torque"] == pytest.approx(table["tau"].abs().max())
            assert row["largest_inertia"] == pytest.approx(table["B"].max(), rel=1e-9)


def test_reactions_are_figures():
    found = sk.sweep("four_bar", {"links.2.arc": [20.0]}, analyses=["reactions"], samples=7)
    run = sk.run("four_bar", "reactions", samples=7).frame("reactions", "reactions")
    most = run[run["pair"] == "43"].groupby("assembly_mode")["transverse_moment"].max()
    assert found.frame()["largest_reaction_43"].tolist() == most.tolist()


@pytest.mark.slow
def test_figures_of_tables_are_those_of_a_run():
    """A figure may reduce a column of any table; here coefficients of a cam's follower."""
    vary = {"pairs.contact.profiles.cam.cosines.1": [4.0]}
    figure = (
        "most=max(poles.poles link=follower relative_to=frame: abs(velocity_coefficient))"
    )
    by_mode = sk.sweep("shaped_cam", vary, figure, samples=7).frame().set_index("mode")
    for mode, rows in follower_poles().groupby("assembly_mode"):
        assert by_mode.loc[str(mode), "most"] == rows["velocity_coefficient"].abs().max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quantity", "tolerance"),
    [("velocity_coefficient", 1e-12), ("acceleration_coefficient", 1e-10)],
)
def test_figures_of_kernel_columns_are_those_of_a_run(quantity, tolerance):
    """The compiled kernel computes the same coefficients without a table."""
    vary = {"pairs.contact.profiles.cam.cosines.1": [4.0]}
    figure = f"most=max(abs({quantity}_follower_frame))"
    frame = sk.sweep("shaped_cam", vary, figure, samples=7).frame()
    for mode, rows in follower_poles().groupby("assembly_mode"):
        largest = frame.loc[frame["mode"].str.startswith(str(mode)), "most"].item()
        expected = rows[quantity].abs().max()
        assert largest == pytest.approx(expected, rel=tolerance)


def follower_poles():
    """Return the rows of a run for the pole of the cam's follower in its frame."""
    poles = sk.run("shaped_cam", "poles", samples=7).frame("poles")
    return poles[(poles["link"] == "follower") & (poles["relative_to"] == "frame")]


@pytest.mark.parametrize(
    ("name", "key", "pair"),
    [
        pytest.param("double_butterfly", "pairs.D.longitude", "D", marks=pytest.mark.slow),
        ("roller_cam", "links.frame.arc", "follower_pivot"),
    ],
)
def test_a_stated_assembly_mode_is_that_of_a_run(name, key, pair):
    """Kernels that track solutions or replace contacts have other modes than a run."""
    value = design_variable(document_of(name), key).value
    study = Study("stated", sk.load(name), samples=3, assembly_mode=0)
    largest = sk.run(study, "poles").frame("motion")[f"theta_{pair}"].max()
    (row,) = sk.sweep(study, {key: [value]}, f"a=max(theta_{pair})").frame().iloc
    assert row["status"] == "OK"
    assert np.radians(row["a"]) == pytest.approx(largest, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "key", "mode_count"),
    [
        ("eight_bar_01", "pairs.78.longitude", 1),  # dyads
        ("double_butterfly", "pairs.D.longitude", 1),  # a kernel would track solutions
        ("miura_unit", "pairs.h23.value", 1),  # redundant constraints
        ("four_bar", "links.2.arc", 2),  # sizes, no reference pose
    ],
)
def test_without_a_search_a_sweep_has_the_modes_of_a_run(name, key, mode_count):
    """Only the mode of the reference pose is computed, or all if there is no such pose."""
    variable = design_variable(document_of(name), key)
    study = Study("unsearched", sk.load(name), samples=3, search=False)
    pair = sk.load(name).pairs[-1].name
    motion = sk.run(study, "poles").frame("motion")
    largest = motion.groupby("assembly_mode")[f"theta_{pair}"].max()
    frame = sk.sweep(study, {key: [variable.value] * 2}, f"a=max(theta_{pair})").frame()
    assert set(frame["status"]) == {"OK"}
    assert len(largest) == mode_count
    for _, rows in frame.groupby("design"):
        assert np.radians(sorted(rows["a"])) == pytest.approx(sorted(largest), rel=1e-9)


def test_impossible_designs_are_rows_with_a_reason():
    """Arcs have to lie between 0 and 180 degrees; other designs close in part or not."""
    vary = {"links.2.arc": [20.0, 0.0, 190.0], "links.3.arc": [70.0, 5.0]}
    frame = sk.sweep("four_bar", vary, "at(theta_41 + q, 30)", samples=9).frame()
    assert "at_theta_41_q_30" in frame
    assert sorted(set(frame["design"])) == list(range(6))
    assert set(frame["reason"][frame["status"] == "OK"]) == {""}
    assert set(frame["status"]) == {"OK", "IMPOSSIBLE"}
    reasons = frame[frame["status"] != "OK"].set_index("design")["reason"]
    assert reasons[2] == "links.2.arc = 0: not between 0 and 180 deg"
    assert reasons[4].startswith("links.2.arc = 190")
    assert frame[frame["design"] == 1]["closes"].max() < 1.0
    assert list(frame["grashof"][frame["design"] == 0]) == 2 * ["crank-rocker"]
    assert set(frame["grashof"][frame["status"] == "IMPOSSIBLE"]) == {""}


def test_profiles_that_curve_into_each_other_are_impossible():
    vary = {"pairs.contact.profiles.cam.radius": [25.0, 169.0]}
    last_row = sk.sweep("roller_cam", vary, "max(q)", samples=3).frame().iloc[-1]
    assert last_row["status"] == "IMPOSSIBLE"
    assert last_row["reason"] == (
        "roller_cam: pairs.contact: the profiles would cut into each other, or have equal "
        "curvature; change the size of one profile"
    )


@pytest.mark.parametrize(
    "old, new",
    [
        ("contact", "c" * 64),
        ("follower_pivot", "centres_contact_cam"),
        ("cam_shaft", "centres_contact_follower"),
    ],
)
def test_names_of_pairs_do_not_change_a_sweep_of_a_cam(old, new, tmp_path):
    """A link with two R pairs replaces the contact. Their names must be free and short."""
    coefficients = []
    for name in (old, new):
        text = re.sub(rf"\b{old}\b", name, find("roller_cam").read_text())
        path = tmp_path / "cam.toml"
        path.write_text(text)
        contact = name if old == "contact" else "contact"
        vary = {f"pairs.{contact}.profiles.cam.radius": [24.0, 25.0]}
        figure = "max(velocity_coefficient_frame_follower)"
        frame = sk.sweep(path, vary, figure, samples=5).frame()
        assert (frame["status"] == "OK").all()
        coefficients.append(frame["max_velocity_coefficient_frame_follower"])
    assert np.array_equal(*coefficients)


def test_the_command_prints_a_word_for_each_design_and_each_reason_once(capsys):
    vary = ["--vary", "links.2.arc=20,0,190", "--vary", "links.4.arc=45,179"]
    assert main(["sweep", "four_bar", *vary, "--reduce", "max(q)", "--samples", "9"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert (
        "5 of them have impossible dimensions or cannot be assembled at any sample"
        in lines[1]
    )
    assert [line for line in lines if line.startswith("Warning")] == [
        "Warning: IMPOSSIBLE, designs 2, 3, 4, 5: for example design 2: links.2.arc = 0: "
        "not between 0 and 180 deg",
        "Warning: NEVER_CLOSES, design 1: does not close at any sample",
    ]


def test_the_command_prints_the_best_designs_of_each_figure(capsys):
    """The four-bar is a crank-rocker: the longer the crank, the larger the swing."""
    vary = ["--vary", "links.2.arc=10,15,20", "--reduce", "swing=swing(theta_41)"]
    assert main(["sweep", "four_bar", *vary, "--samples", "91"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (highest,) = [line.split() for line in lines if "highest" in line]
    (lowest,) = [line.split() for line in lines if "lowest" in line]
    assert highest[:3] == ["swing", "(deg)", "highest"]
    assert (highest[-1], lowest[-1]) == ("20", "10")
    assert float(highest[3]) > float(lowest[1])


ACTED = mechanism_text("sweeps_acted")


@pytest.mark.slow
def test_a_sweep_over_masses_and_loads_has_the_torques_of_runs(tmp_path):
    """Driving torques in a sweep over masses, loads and an arc are those of runs.

    Mass, centre of mass, weight, spring, friction, force and an arc vary together. The
    designs are all combinations of the numbers, and every fifth possible one is compared
    with a run. A third of them has a negative mass, which is impossible: 2 * 2 * 2 designs.
    Figures are the largest and the mean torque, and the largest inertia B reduced to the
    input. The analysis `eksergian` of a run has the torque `tau` and B at each sample.
    """
    path = tmp_path / "acted.toml"
    four_bar_text = find("four_bar").read_text()
    path.write_text(four_bar_text[: four_bar_text.index("[mass.2]")] + ACTED)
    vary = {
        "mass.3.mass": [2.0, 5.0, -1.0],
        "mass.3.centre.0": [0.1, 0.4],
        "loads.weight.acceleration.1": [-9.8, 4.0],
        "loads.back.rest": [20.0, -35.0],
        "loads.rub.torque": [0.4],
        "loads.push.point.1": [-0.5],
        "links.4.arc": [42.0],
    }
    figures = ["peak=max(abs(torque))", "mean=mean(torque)", "largest_inertia=max(B)"]
    variations = [parse_variation(key, values, "deg") for key, values in vary.items()]
    sweep = sweep_of(path, DesignSpace.from_variations(variations), figures)
    samples = DesignSamples.from_study(Study("", sweep.mechanism, samples=19))
    sweep = replace(sweep, samples=samples)
    # Compiled formulas (the kernel) compute all designs of this sweep, not single runs.
    assert sweep.evaluator.kernel is not None
    frame = run_sweep(sweep).frame()

    is_impossible = frame["mass_3_mass"] < 0.0
    assert sum(is_impossible) == 8
    assert frame["reason"][is_impossible].str.contains("mass").all()
    for _, row in frame[~is_impossible].iloc[::5].iterrows():
        design = {key: row[key.replace(".", "_")] for key in vary}
        run = sk.run(with_file_numbers(path, design), "eksergian", samples=19)
        table = run.frame("eksergian")
        # A four-bar has one dyad, whose sign names its assembly mode.
        mode_number = 0 if row["mode"] == "+" else 1
        table = table[table["assembly_mode"] == mode_number]
        assert row["peak"] == pytest.approx(table["tau"].abs().max(), rel=1e-9)
        assert row["mean"] == pytest.approx(table["tau"].mean(), rel=1e-9)
        assert row["largest_inertia"] == pytest.approx(table["B"].max(), rel=1e-9)


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


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ("10:40:100000000000000", "at most 1073741824"),
        ("10:inf", "not a finite range"),
        ("-1e308:1e308", "not a finite range"),
        ([10**400], "LOW:HIGH:COUNT"),
    ],
)
def test_values_of_a_sweep_that_are_too_many_or_too_large_are_refused(values, words):
    with pytest.raises(DesignError, match=words):
        sk.sweep("four_bar", {"links.2.arc": values}, "max(q)", samples=3)


def test_a_grid_may_have_any_number_of_variables():
    """The last variable changes first, as in nested loops. NumPy allows 64 variables."""
    variations = [parse_variation(f"k{k}", "5", "deg") for k in range(70)]
    variations[3] = parse_variation("k3", "1,2,4", "deg")
    variations[69] = parse_variation("k69", "7,9", "deg")
    designs = DesignSpace.from_variations(variations).compute_designs(0, 6)
    expected = [(first, last) for first in (1.0, 2.0, 4.0) for last in (7.0, 9.0)]
    assert [(design[3], design[69]) for design in designs.T] == expected
    assert np.all(np.delete(designs, [3, 69], axis=0) == 5.0)


@pytest.mark.parametrize("scheme", ["sobol", "latin", "random"])
def test_designs_beyond_the_last_one_are_left_out(scheme):
    variations = [parse_variation("a", "1:2", "deg")]
    space = DesignSpace.from_variations(variations, 4, scheme)
    assert space.compute_designs(2, 9).shape == (1, 2)
    assert space.compute_designs(6, 9).shape == (1, 0)


@pytest.mark.parametrize("scheme", ["grid", "sobol", "latin", "random"])
def test_a_design_does_not_depend_on_the_part_in_which_it_is_computed(scheme):
    """Designs of a sweep are the same computed all at once and in parts.

    A design is a set of values of the three varied numbers. 60 designs are computed at
    once, and in four parts of unequal size. `scheme` is the way to choose them.
    """
    variations = [
        parse_variation("a", "1:2:5", "deg"),
        parse_variation("b", "3,7,9", "deg"),
        parse_variation("c", "0:1:4", "deg"),
    ]
    if scheme == "grid":
        space = DesignSpace.from_variations(variations, None, scheme, seed=0)
    else:
        space = DesignSpace.from_variations(variations, 60, scheme, seed=5)
    all_designs = space.compute_designs(0, 60)
    assert all_designs.shape == (3, 60)
    part_limits = [0, 1, 17, 18, 60]
    parts = [space.compute_designs(start, stop) for start, stop in pairwise(part_limits)]
    assert np.array_equal(np.concatenate(parts, axis=1), all_designs)
    assert set(all_designs[1]) <= {3.0, 7.0, 9.0}
    if scheme == "grid":
        assert len({tuple(design) for design in all_designs.T}) == 60


def test_conditions_leave_out_designs_and_rows():
    """A condition may use varied numbers and figures; the other rows are unchanged."""
    vary = {"links.2.arc": "10:40:7", "links.4.arc": "20:50:4"}
    figure = "least=min(transmission_angle_43)"
    unconditional = sk.sweep("four_bar", vary, figure, samples=9).frame()
    conditions = ["links_2_arc < links_4_arc", "least > 30"]
    frame = sk.sweep("four_bar", vary, figure, where=conditions, samples=9).frame()
    is_met = unconditional["links_2_arc"] < unconditional["links_4_arc"]
    is_met &= unconditional["least"] > 30.0
    assert 0 < len(frame) < len(unconditional)
    text_columns = dict.fromkeys(("mode", "status", "grashof"), str)
    expected = unconditional[is_met].reset_index(drop=True).astype(text_columns)
    pd.testing.assert_frame_equal(frame.astype(text_columns), expected)


def test_a_swing_does_not_depend_on_where_the_range_of_a_turn_begins():
    """0 to 360 degrees cuts through an interval that -180 to 180 has in one piece."""
    sizes = {"base": 179.9, "crank": 30.0, "coupler": 100.0, "rocker": 110.0}
    swings = []
    for limits in ((0, 360), (-180, 180)):
        mechanism = crank_rocker(**sizes, inputs={"drive": limits})
        vary = {"links.crank.arc": [30.0]}
        frame = sk.sweep(mechanism, vary, "swing=swing(theta_hinge)", samples=361).frame()
        swings.append(frame["swing"])
    assert np.allclose(swings[0], swings[1], rtol=1e-9, atol=0.0)
    assert np.all(swings[0] > 150.0)


def test_a_condition_that_no_design_meets_leaves_no_row(capsys):
    command = ["sweep", "four_bar", "--vary", "links.2.arc=20", "--samples", "9"]
    assert main([*command, "--reduce", "a=min(rate_41)", "--where", "a > 100"]) == 0
    printed = capsys.readouterr().out
    assert "0 rows" in printed
    assert "none meets a > 100" in printed
    assert "Warning" not in printed
    assert "Empty" not in printed


@pytest.mark.slow
def test_a_sweep_with_a_locked_input_is_that_of_the_locked_mechanism(capsys):
    """A sweep with a locked input has the figures of a mechanism locked in Python.

    `--lock 51=30` fixes one of two inputs of a five-bar at 30 degrees; an arc varies. The
    figure is the largest velocity coefficient of the pole 3/1 (rate of link 3 relative to 1
    per rate of the input). The reference is `sk.evaluate` of each design and mode.
    """
    command = ["sweep", "five_bar", "--lock", "51=30", "--vary", "links.2.arc=50:70:3"]
    command += ["--reduce", "most=max(abs(velocity_coefficient_3_1))", "--samples", "9"]
    assert main([*command, "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {row["design"] for row in rows} == {0, 1, 2}
    locked = sk.lock(sk.load("five_bar"), {"51": 30.0}, angle_unit="deg")
    for row in rows:
        design = locked.with_sizes(angle_unit="deg", arcs={"2": row["links_2_arc"]})
        (driven,) = design.inputs
        modes = sk.trace(design, samples=3).assembly_modes
        numbers_by_label = {mode.label: mode.number for mode in modes}
        q = np.linspace(driven.start, driven.stop, 9)
        motion = sk.evaluate(design, q, assembly_mode=numbers_by_label[row["mode"]])
        largest = np.nanmax(np.abs(motion.velocity_coefficient("3/1")))
        assert row["most"] == pytest.approx(largest, rel=1e-9)


def read_parts(folder):
    """Return all files of all data sets as data frames, sorted by path."""
    parts = sorted(folder.rglob("part-*.parquet"))
    return [pq.ParquetFile(part).read().to_pandas() for part in parts]


def finished_parts(folder):
    """Return the files of the table of designs, which are written last."""
    return [part for kind in (".", "designs") for part in folder.glob(f"{kind}/part-*")]


VARIED_FOR_FIGURES = [
    "links.2.arc=10:40:40",
    "links.3.arc=50:90:41",
    "links.4.arc=30:60:40",
]
VARIED_FOR_TABLES = ["links.2.arc=10:40:12", "links.3.arc=0:90:10"]


@pytest.fixture(scope="module", params=["figures", "tables"])
def undisturbed_sweep(request, tmp_path_factory):
    """Return a command for a sweep, and the files that it writes if nothing disturbs it.

    Tests that interrupt the command compare its files with these. A sweep is divided into
    parts (here more than four) with some designs each. Each part is written to a file. With
    the parameter "figures" the files have numbers to which each design is reduced, with
    "tables" whole tables of an analysis.

    Returns
    -------
    command
        The words of the command without the last one, the folder.
    expected
        The files as data frames, written by one process.
    """
    folder = tmp_path_factory.mktemp("whole")
    command = [sys.executable, "-m", "spherekit", "sweep", "four_bar", "--samples", "91"]
    if request.param == "figures":
        varied = VARIED_FOR_FIGURES
        options = {"reduce": "max(rate_41)"}
        command += ["--reduce", "max(rate_41)"]
    else:
        varied = VARIED_FOR_TABLES
        options = {"analyses": ["poles"], "tables": True}
        command += ["-a", "poles", "--tables"]
    vary = dict(text.split("=") for text in varied)
    sk.sweep("four_bar", vary, **options, samples=91, folder=folder, workers=1)
    for text in varied:
        command += ["--vary", text]
    assert len(finished_parts(folder)) > 4
    return [*command, "-q", "-o"], read_parts(folder)


def wait_for_first_part(process, folder):
    """Wait until a sweep has written its first part."""
    while not finished_parts(folder):
        assert process.poll() is None
        time.sleep(0.002)


def assert_equal_frames(first_frames, second_frames):
    """Assert that two lists of data frames are equal bit by bit."""
    for first, second in zip(first_frames, second_frames, strict=True):
        pd.testing.assert_frame_equal(first, second, check_exact=True)


@pytest.mark.slow
def test_a_killed_sweep_continues_to_the_same_data_set(undisturbed_sweep, tmp_path):
    """The parts that were finished are not written again, and all parts are equal."""
    command, expected = undisturbed_sweep
    process = subprocess.Popen([*command, tmp_path, "--workers", "1"])
    wait_for_first_part(process, tmp_path)
    process.send_signal(signal.SIGKILL)
    process.wait()
    times = {part: part.stat().st_mtime_ns for part in finished_parts(tmp_path)}
    subprocess.run([*command, tmp_path, "--workers", "2"], check=True)
    assert all(part.stat().st_mtime_ns == written for part, written in times.items())
    assert_equal_frames(expected, read_parts(tmp_path))


@pytest.mark.slow
def test_a_folder_takes_only_the_sweep_that_it_holds(tmp_path):
    """The same sweep computes nothing again; another one is refused."""
    sweep = partial(sk.sweep, "four_bar", {"links.2.arc": [10.0, 20.0]}, "max(q)")
    sweep(samples=5, folder=tmp_path)
    repeated = sweep(samples=5, folder=tmp_path)
    assert repeated.computed == 0
    assert len(repeated.frame()) == 4
    with pytest.raises(OutputError, match="of another sweep.*samples: "):
        sweep(samples=6, folder=tmp_path)
    (tmp_path / DEFINITION_FILE).unlink()
    with pytest.raises(OutputError, match="does not identify the sweep"):
        sweep(samples=5, folder=tmp_path)


def test_a_folder_does_not_mix_ways_of_crossing(tmp_path):
    """The designs are analysed one by one in both ways, so their parts are alike."""
    vary = {"pairs.contact.profiles.cam.cosines.1": [4.0]}
    sweep = partial(sk.sweep, "shaped_cam", vary, "max(q)", samples=3, folder=tmp_path)
    sweep(crossings="end", workers=1)
    with pytest.raises(OutputError, match="crossings: end there, pass now"):
        sweep(crossings="pass", workers=1)


@pytest.mark.parametrize("is_kept", [True, False])
def test_a_stopped_sweep_is_said_to_continue_only_in_a_folder(
    is_kept, tmp_path, monkeypatch
):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("spherekit.designs.sweep.Sweep.write_part", stop)
    folder = tmp_path if is_kept else None
    with pytest.raises(KeyboardInterrupt) as interrupt:
        sk.sweep("four_bar", {"links.2.arc": [20.0]}, "max(q)", folder=folder, workers=1)
    notes = getattr(interrupt.value, "__notes__", [])
    assert len(notes) == int(is_kept)
    assert all("the same command continues from there" in note for note in notes)


@pytest.mark.parametrize("name", ["four_bar", "roller_cam", "bevel_pair"])
def test_a_sweep_without_figures_suggests_one_that_exists(name):
    """The last pair of a mechanism may be a contact, which has no angle."""
    document = document_of(name)
    key = "pairs.contact.profiles.cam.radius" if name == "roller_cam" else None
    if key is None:
        key = next(f"links.{link}.arc" for link in document.data["links"])
    space = DesignSpace.from_variations([parse_variation(key, [30.0], "deg")])
    with pytest.raises(DesignError) as refusal:
        sweep_of(name, space, ())
    suggestion = re.search('"(swing=.*?)"', str(refusal.value))[1]
    assert sweep_of(name, space, [suggestion], samples=3).units()["swing"] == "deg"


def test_angles_of_loads_and_profiles_have_units_in_a_sweep(tmp_path):
    path = tmp_path / "acted.toml"
    four_bar_text = find("four_bar").read_text()
    path.write_text(four_bar_text[: four_bar_text.index("[mass.2]")] + ACTED)
    vary = {"loads.back.rest": [20.0], "mass.3.mass": [2.0]}
    assert sk.sweep(path, vary, "max(q)", samples=3).frame().attrs["units"] == {
        "loads_back_rest": "deg",
        "max_q": "deg",
    }
    vary = {"pairs.contact.profiles.cam.radius": [25.0]}
    units = sk.sweep("roller_cam", vary, "max(q)", samples=3).frame().attrs["units"]
    assert units["pairs_contact_profiles_cam_radius"] == "deg"


@pytest.mark.many
@pytest.mark.parametrize("condition", [(), "links_2_arc > 25"])
def test_a_folder_is_one_data_set(condition, tmp_path, monkeypatch):
    """pandas reads the three parts as one table, also if the first part has no row left."""
    monkeypatch.setattr("spherekit.designs.design_evaluation.CLOSED_FORM_PART_SIZE", 2)
    vary = {"links.2.arc": [10.0, 20.0, 30.0, 200.0, 40.0]}
    options = {"where": condition, "folder": tmp_path, "workers": 1}
    result = sk.sweep("four_bar", vary, "max(rate_41)", samples=5, **options)
    assert result.sweep.part_count == 3
    table = pd.read_parquet(tmp_path)
    expected = result.frame()
    assert len(table) == len(expected) > 3
    for name in ("design", "links_2_arc", "closes", "max_rate_41"):
        assert np.array_equal(table[name], expected[name], equal_nan=True)
    for name in ("mode", "status", "claim", "grashof"):
        assert list(table[name].astype(str)) == list(expected[name].astype(str))


@pytest.mark.slow
def test_losing_a_worker_of_a_cluster_does_not_change_the_data_set(
    undisturbed_sweep, tmp_path
):
    """The files of a sweep are the same if one of two Dask workers is killed.

    It is killed after the first part of the sweep is written; the other worker finishes.
    `undisturbed_sweep` has the command and the expected files as data frames.
    """
    pytest.importorskip("distributed")
    command, expected = undisturbed_sweep
    scheduler_file = tmp_path / "scheduler.json"
    folder = tmp_path / "parts"
    options = {
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "cwd": tmp_path,
    }
    python_module = [sys.executable, "-m"]
    scheduler = [*python_module, "distributed.cli.dask_scheduler", "--host", "127.0.0.1"]
    scheduler += ["--port", "0", "--no-dashboard", "--scheduler-file", str(scheduler_file)]
    processes = [subprocess.Popen(scheduler, **options)]
    try:
        # The scheduler writes its address into this file, which ends with a brace.
        while not (scheduler_file.exists() and scheduler_file.read_text().endswith("}")):
            time.sleep(0.05)
        address = json.loads(scheduler_file.read_text())["address"]
        worker = [*python_module, "distributed.cli.dask_worker", address]
        worker += ["--nthreads", "1", "--no-dashboard", "--no-nanny"]
        workers = [subprocess.Popen(worker, **options) for _ in range(2)]
        processes += workers
        sweep = subprocess.Popen([*command, folder, "--dask", address])
        wait_for_first_part(sweep, folder)
        os.kill(workers[0].pid, signal.SIGKILL)
        assert sweep.wait(300) == 0
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert_equal_frames(expected, read_parts(folder))


def test_a_sweep_of_hookes_joint_has_the_range_of_its_ratio():
    """The file states no input. The ratio goes from cos a to 1/cos a at shaft angle a."""
    mechanism = sk.load("universal_joint")
    assert mechanism.inputs[0].is_default
    vary = {"links.1.arc": [10.0, 35.0]}
    frame = sk.sweep(mechanism, vary, "s=range(rate_41)").frame()
    cosine = np.cos(np.radians(frame["links_1_arc"].to_numpy()))
    assert frame["s"].to_numpy() == pytest.approx(1.0 / cosine - cosine, rel=1e-12)


def four_bar_with_coil(pair, zero=0.0, range_=(0.0, 360.0), crank=20):
    """Return a crank-rocker with a torsion spring ("coil") at a pair.

    The torque of the coil depends on the whole angle of its pair, turns included.

    Parameters
    ----------
    pair
        Pair of the coil: drive (base and crank), tip (crank and coupler), joint (coupler
        and rocker) or hinge (base and rocker).
    zero
        Zero position of the hinge in degrees: the geometric angle at which its variable is
        zero.
    range_
        Range of the input in degrees.
    crank
        Arc of the crank in degrees.
    """
    coil = {"kind": "spring", "pair": pair, "stiffness": 2.0, "rest": 30.0}
    return crank_rocker(
        crank=crank,
        zero=zero,
        inputs={"drive": range_},
        mass={"rocker": {"tensor": [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 0.5]]}},
        loads={"coil": coil},
    )


def extreme_torques_of_runs(mechanism, samples):
    """Return the largest and the least torque (modes, 2) of a run, each column sorted."""
    rows = sk.run(mechanism, "eksergian", samples=samples).frame()
    torques_by_mode = rows.groupby("assembly_mode")["tau"]
    extremes = np.stack([torques_by_mode.max(), torques_by_mode.min()], axis=1)
    return np.sort(extremes, axis=0)


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
def test_torques_of_coils_in_a_sweep_count_whole_turns(pair, zero, range_, crank, samples):
    """Highest and lowest torques in a sweep are those of runs, also with whole turns.

    The torque of a torsion spring ("coil") at `pair` depends on the whole angle of this
    pair, turns included. The cases have long ranges of the input, few samples, and modes
    (ways to assemble the links) that close at some inputs only. `zero` is the zero position
    of the hinge between base and rocker, `range_` the range of the input, and `crank` an
    arc, all in degrees. The same torques follow from `FigureGradients`, which a synthesis
    uses. `four_bar_with_coil` returns the mechanism.
    """
    mechanism = four_bar_with_coil(pair, zero, range_, crank)
    # (modes, 2) highest and lowest torque of each mode, sorted.
    expected = extreme_torques_of_runs(mechanism, samples)
    vary = {"links.crank.arc": [crank, crank + 1.0]}
    result = sk.sweep(mechanism, vary, HIGH_AND_LOW, samples=samples)
    frame = result.frame()
    rows = frame[frame["design"] == 0]
    extremes = np.sort(rows[["high", "low"]], axis=0)
    assert np.allclose(extremes, expected, rtol=1e-9)

    figure_gradients = FigureGradients(result.sweep.evaluator)
    high_torques = []
    # The two assembly modes of a four-bar have the signs + and -.
    for sign in "+-":
        values = figure_gradients.evaluate(np.array([crank]), SynthesisMode(sign))
        high_torques.append(values.figures[0])
    assert np.allclose(np.sort(high_torques), expected[:, 0], rtol=1e-9)


@pytest.mark.slow
def test_torques_of_coils_count_whole_turns_in_groups_beyond_dyads():
    """Extreme torques in a sweep are those of runs also if no closed form exists.

    A group is a set of links that is solved together; a dyad (two links) has a closed form.
    The double butterfly has other groups, so the sweep follows its modes (ways to assemble
    the links) along the input. The torque of a torsion spring at pair C counts whole turns
    of this pair. In the sweep the claim "complete" says that no mode is missing. The modes
    of run and sweep may differ in order, so numbers are compared in sorted order. NaN
    stands for modes that do not close at 185 deg.
    """
    spring = sk.Spring("coil", "C", stiffness=2.0, rest=0.3)
    mechanism = load_without_loads("double_butterfly").with_loads(spring)
    tensor = [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    mechanism = mechanism.with_mass("8", tensor)  # torques need a mass
    expected = extreme_torques_of_runs(mechanism, 73)

    # A sweep with a single design: a number of the file is varied over its own value only.
    latitude = design_variable(document_of(mechanism), "pairs.C.latitude")
    vary = {latitude.key: [latitude.value]}
    figures = [*HIGH_AND_LOW, "there=at(torque, 185)"]
    rows = sk.sweep(mechanism, vary, figures, samples=73).frame()
    assert set(rows["claim"]) == {"complete"}
    extremes = np.sort(rows[["high", "low"]], axis=0)
    assert np.allclose(extremes, expected, rtol=1e-7, atol=1e-9)

    run = sk.run(mechanism, "eksergian", samples=73).frame()
    at_185_deg = run[np.isclose(run["q"], np.radians(185.0))]["tau"].dropna()
    swept = rows["there"].dropna()
    assert np.allclose(np.sort(swept), np.sort(at_185_deg), rtol=1e-7, atol=1e-9)


@pytest.mark.slow
def test_angles_in_groups_beyond_dyads_are_those_of_runs():
    """Extreme angles in a sweep are those of a trace also if no closed form exists.

    A group is a set of links that is solved together; a dyad (two links) has a closed form.
    The double butterfly has other groups, so the sweep follows its modes (ways to assemble
    the links) along the input. The sizes (deg) are changed so that in one mode pair F
    rotates by more than 350 degrees: its whole turns have to be counted. The modes of trace
    and sweep may differ in order, so maxima and minima are compared in sorted order.
    """
    numbers = {
        "pairs.C.longitude": 5,
        "pairs.E.latitude": 15,
        "pairs.H.latitude": 12,
        "pairs.F.longitude": 30,
    }
    motion = sk.trace(with_file_numbers("double_butterfly", numbers), samples=37)
    column = motion.mechanism.variable_names.index("theta_F")
    theta_by_mode = np.degrees(motion.values[:, column]).reshape(-1, 37)
    expected = np.stack(
        [np.nanmax(theta_by_mode, axis=1), np.nanmin(theta_by_mode, axis=1)], axis=1
    )
    assert np.max(np.ptp(expected, axis=1)) > 350.0
    figures = ["max(theta_F)", "min(theta_F)"]
    vary = {key: [number] for key, number in numbers.items()}
    rows = sk.sweep("double_butterfly", vary, figures, samples=37).frame()
    extremes = np.sort(rows[["max_theta_F", "min_theta_F"]], axis=0)
    assert np.allclose(extremes, np.sort(expected, axis=0), rtol=0.0, atol=1e-8)


def test_sensitivities_of_torques_count_whole_turns_of_coils():
    mechanism = four_bar_with_coil("tip")
    sensitivity = "sensitivity:of=torque,by=links.crank.arc,draws=0"
    torques = sk.run(mechanism, sensitivity, samples=37).frame()["value"]
    expected = sk.run(mechanism, "eksergian", samples=37).frame()["tau"]
    assert np.allclose(torques, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("periodic", [False, True])
def test_torque_tables_act_in_a_sweep_as_in_runs(periodic):
    """A table of torques over the angle of the hinge; one of its torques varies."""
    angles = (0.0, 0.7, 1.0, 2.5) if periodic else (-1.0, 0.7, 1.0, 7.0)
    torques = (1.0, -2.0, 3.0, 1.0)
    base = four_bar_with_coil("tip")
    table = sk.TorqueTable("gust", "hinge", angles, torques, periodic)
    mechanism = base.with_loads(*base.loads, table)
    expected = extreme_torques_of_runs(mechanism, 61)
    vary = {"loads.gust.torques.1": [-2.0, -1.0]}
    rows = sk.sweep(mechanism, vary, HIGH_AND_LOW, samples=61).frame()
    # (designs, modes, 2)
    extremes = rows[["high", "low"]].to_numpy().reshape(2, 2, 2)
    assert np.allclose(np.sort(extremes[0], axis=0), expected, rtol=1e-9)
    assert np.all(np.any(extremes[0] != extremes[1], axis=1))


def test_a_torque_table_that_is_too_short_for_the_range_is_refused():
    """Two turns of the input need more than the angles that the table has."""
    base = four_bar_with_coil("tip")
    angles = (-1.0, 0.7, 1.0, 7.0)
    table = sk.TorqueTable("gust", "hinge", angles, (1.0, -2.0, 3.0, 1.0), False)
    mechanism = base.with_loads(*base.loads, table)
    two_turns = mechanism.with_inputs(ranges={"drive": (0, 720)}, angle_unit="deg")
    with pytest.raises(ModelError, match="but its table covers"):
        sk.sweep(two_turns, {"links.crank.arc": [20.0]}, HIGH_AND_LOW)


def test_the_help_lists_all_reductions(capsys):
    """The help repeats the names, because it loads no module that defines reductions."""
    with pytest.raises(SystemExit):
        main(["sweep", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    (names,) = re.findall(r"that a reduction \(([^)]*)\)", text)
    assert names.split(", ") == list(REDUCTION_BY_NAME)


def test_figures_at_an_input_have_the_motion_of_the_time_law():
    """Figures of merit of a sweep at one input are those of the motion by a time law.

    A figure of merit is one number for a design in an assembly mode. The reduction `at`
    takes a value from the motion at one input, here 3 rad. By the law the input moves at 10
    rad/s, so it is there at 0.3 s. The driving torque must be that of a run with this law.
    Without a law the input would move at 1 rad/s, with another torque.
    """
    law = ConstantSpeed(10.0)
    study = Study("s", sk.load("four_bar"), samples=11, duration=1.0, laws={"21": law})
    figures = ["rate=at(dq, 3rad)", "time=at(t, 3rad)", "torque=at(torque, 3rad)"]
    rows = sk.sweep(study, {"links.2.arc": [20.0]}, figures).frame()
    assert np.allclose(rows["rate"], 10.0)
    assert np.allclose(rows["time"], 0.3)

    run = sk.run(replace(study, analyses={"eksergian": {}})).frame()
    torques_of_run = run[np.isclose(run["q"], 3.0)]["tau"]
    assert np.allclose(np.sort(rows["torque"]), np.sort(torques_of_run), rtol=1e-9)


@pytest.mark.parametrize(
    ("law", "place", "reason"),
    [
        (ConstantSpeed(10.0), "3.5rad", "no sample has the inputs 3.5 rad"),
        (Polynomial((0.0, 1.0, -1.0)), "0", "several samples have the inputs 0 rad"),
    ],
)
def test_a_figure_at_an_input_of_unknown_rate_is_refused(law, place, reason):
    study = Study("s", sk.load("four_bar"), samples=11, duration=1.0, laws={"21": law})
    sk.sweep(study, {"links.2.arc": [20.0]}, f"at(theta_41, {place})")
    with pytest.raises(DesignError, match=reason):
        sk.sweep(study, {"links.2.arc": [20.0]}, f"at(torque, {place})")


@pytest.mark.parametrize("path", [[3.0, 2.0, 1.0], [2.0, 1.0, 3.0], [1.0, 2.0, 3.0]])
def test_the_time_at_an_input_is_that_of_the_sample_with_this_input(path):
    """On a path the time counts from the smallest input, in any order of the samples."""
    study = Study("s", sk.load("four_bar"), path=np.array(path))
    figures = ["there=at(t, 2rad)", "last=max(t)"]
    rows = sk.sweep(study, {"links.2.arc": [20.0]}, figures).frame()
    assert np.allclose(rows["there"], 1.0)
    assert np.allclose(rows["last"], 2.0)


def test_derivatives_of_a_root_mean_square_of_zeros_are_zero():
    figures = ["zero=rms(theta_41 - theta_41)", "place=argmin(theta_41)"]
    swept = sk.sweep("four_bar", {"links.2.arc": [19.0, 20.0]}, figures, samples=5)
    figure_gradients = FigureGradients(swept.sweep.evaluator)
    values = figure_gradients.evaluate(np.array([20.0]), SynthesisMode("+"))
    # The derivatives of a place are not computed.
    assert np.array_equal(values.gradients, [[0.0], [np.nan]], equal_nan=True)


@pytest.mark.parametrize(
    ("name", "key", "other_key"),
    [
        ("four_bar", "pairs.41.value", "pairs.41.zero"),
        ("double_butterfly", "pairs.C.zero", "pairs.C.value"),
    ],
)
def test_an_angle_of_the_other_form_of_geometry_cannot_be_varied(name, key, other_key):
    """A zero exists only with dimensions of links, a value only with a reference pose."""
    with pytest.raises(DesignError, match=f"vary {other_key} instead"):
        sk.sweep(name, {key: [0.0, 10.0]}, "max(q)", samples=3)
    assert design_variable(document_of(name), other_key).is_angle


def test_designs_with_loads_outside_the_file_format_are_impossible(tmp_path):
    """A file may not state such a spring, so neither may a design."""
    spring = (
        '\n[loads.spring]\nkind = "spring"\npair = "41"\nstiffness = 0.5\nrest = 10.0\n'
    )
    path = tmp_path / "sprung.toml"
    path.write_text(find("four_bar").read_text() + spring)
    numbers = {"loads.spring.rest": [10.0, 2e6], "loads.spring.stiffness": [0.5, 1e101]}
    frame = sk.sweep(path, numbers, "m=max(torque)", samples=2).frame()
    assert set(frame["design"][frame["status"] == "OK"]) == {0}
    reasons = list(frame["reason"][frame["design"] > 0])
    assert len(reasons) == 3
    assert all("expected at most" in reason for reason in reasons)
