"""The singularities analysis with one input: tables, findings, pages, special cases."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from helpers.scene_listener import SceneListener
from mechanism_examples.linkages import mechanism_from_chain
from mechanism_examples.named_mechanisms import dixon_mechanism, four_bar
from oracles.four_bar_singularities import (
    ROCKER,
    angles_with_links_in_line,
    findings_and_warnings,
)

import spherekit as sk
from spherekit.cli.main import main
from spherekit.mechanism.elements import Input
from spherekit.scenes.scene import Portrait, Text
from spherekit.singularities.grashof import class_of

NAME = "singularities"
Z, SLANT = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.6, 0.8])


@pytest.fixture(scope="module")
def rocker():
    pages = SceneListener()
    result = sk.run(four_bar(ROCKER), NAME, samples=61, recorder=pages)
    assert not result.failures
    return result, pages


def silent(frame):
    """Return the columns with NaN in rows whose status is OK."""
    good = frame[frame["status"].astype(str) == "OK"]
    numbers = good.select_dtypes("number")
    return set(numbers.columns[numbers.isna().any()])


def test_dead_centres_of_a_rocker_are_where_two_links_are_in_line(rocker):
    """By the cosine theorem, with kinds, assembly modes and conditions."""
    frame = rocker[0].frame()
    still, dead = (frame[frame["kind"] == kind] for kind in ("I", "II"))
    angles = np.sort(np.mod(angles_with_links_in_line(*ROCKER), 2.0 * np.pi))
    assert len(dead) == len(angles) > 0 and len(frame) == len(dead) + len(still)
    assert np.max(np.abs(np.sort(dead["q"]) - angles)) < 1e-12
    assert set(dead["reversal"]) == {"input"} and set(still["reversal"]) <= {"output"}
    assert all(len(modes.split("+")) == 2 for modes in dead["assembly_mode"])
    for kind, rows in (("I", still), ("II", dead)):
        assert all(f"{kind}.3" in labels.split() for labels in rows["condition"])
    for name, word in (("certain", "yes"), ("double", "no"), ("guarantee", "complete")):
        assert set(frame[name]) == {word}
    assert np.all(frame["residual"] < 1e-9) and np.all(frame["note"] != "")


def test_the_relation_holds_in_every_row(rocker):
    frame = rocker[0].frame(NAME, "relation")
    good = frame[frame["status"].astype(str) == "OK"]
    assert 0 < len(good) < len(frame)
    gap = good["c"] * good["output_rate"] - good["d"] * good["input_rate"]
    assert np.max(np.abs(gap)) < 1e-12
    assert set(good["form"]) == {"i", "ii"} and set(good["output"]) == {"4/1"}
    assert silent(frame) <= {"transmission", "input_margin_I", "input_margin_II"}
    assert np.all(good[good["form"] == "ii"]["transmission"].notna())


@pytest.mark.slow
def test_findings_count_and_warn_as_near_asks(rocker):
    figures, warnings = findings_and_warnings(rocker[0])
    assert figures[NAME] == rocker[0].frame()["kind"].value_counts().to_dict()
    assert figures["guarantee"].startswith("complete")
    assert not figures["checks_failed"] and not figures["notes"]
    (_, wide), (_, none) = (
        findings_and_warnings(sk.run(four_bar(ROCKER), f"{NAME}:near={near}", samples=61))
        for near in (25, 0)
    )
    meets = "output 4/1 meets type II in the range: the locked input does not hold it there"
    assert all(f"{NAME}: {meets}" in told for told in (warnings, none, wide))
    assert not any("without meeting" in words for words in none)
    assert len(wide) >= len(warnings)


def test_pages_show_every_singularity_and_mark_it_on_the_portrait(rocker):
    result, pages = rocker
    frame = result.frame()
    page, _ = pages.last_scene("Singularities")
    assert len(page.over[0].values) == len(frame)
    (words,) = (p.markdown for p in page.primitives if isinstance(p, Text))
    listed = [line for line in words.splitlines() if line.startswith("|")]
    assert len(listed) == 2 + len(frame)
    for assembly_mode in set(result.frame("motion")["assembly_mode"]):
        (portrait,) = pages.primitives(Portrait, assembly_mode).values()
        marked = sorted(mark.label for mark in portrait.marks)
        assert marked == sorted(f"type {kind}" for kind in frame["kind"])
        places = np.array([mark.place for mark in portrait.marks])
        gaps = np.abs(frame["q"].to_numpy()[:, None] - places[:, 0])
        assert np.max(np.min(gaps, axis=1)) < np.radians(1.0)


SWINGING = [
    "4/1 swings 180 deg, from 0 to 180 deg on configuration curves",
    "4/1 swings 180 deg, from -180 to 0 deg on configuration curves",
    "curves of configurations cross: at 21 = 0, 180 deg",
    "least transmission angle of 4/1: 0 deg",
]
FOLDING = {
    "parallelogram": ([60.0, 40.0, 60.0, 40.0], {"III": 2}, {}, SWINGING),
    "kite": ([60.0, 60.0, 40.0, 40.0], {"II": 4, "III": 2}, {"II": 2}, []),
    "rhombus": ([50.0] * 4, {"III": 3, "I": 2, "II": 2}, {"I": 2, "II": 2}, []),
    "all 90 deg": (
        [90.0] * 4,
        {"III": 4, "I": 4, "II": 4},
        {"I": 4, "II": 4},
        ["4/1 rests at 0 deg on configuration curves"],
    ),
}
"""A folding four-bar, its rows by type, those of them of whole curves, and what is said.

A link rests at its angle 0 or pi where the equation of the loop vanishes whatever the other
angle is; these circles are cut where the slope of the equation across them vanishes.
"""


@pytest.mark.many
@pytest.mark.parametrize("name", FOLDING)
def test_folding_four_bars_run_with_the_right_types(name):
    """At each crossing all axes are in one plane, III.a; a coincidence adds its own."""
    arcs, kinds, resting, said = FOLDING[name]
    result = sk.run(four_bar(np.radians(arcs)), NAME, samples=37)
    remarks = "\n".join(result.summary["remarks"])
    assert "swings 0" not in remarks and all(words in remarks for words in said)
    frame = result.frame()
    assert not result.failures
    assert frame["kind"].value_counts().to_dict() == kinds
    crossing = frame[frame["kind"] == "III"]
    assert all("III.a" in labels.split() for labels in crossing["condition"])
    assert set(frame["certain"]) == {"yes"}
    whole = frame["q"].isna()
    assert all("at rest on the whole" in words for words in frame[whole]["note"])
    assert frame[whole]["kind"].astype(str).value_counts().to_dict() == resting
    relation = result.frame(NAME, "relation")
    assert silent(relation) <= {"transmission"}


@pytest.mark.parametrize("power", [8, 12])
def test_near_a_parallelogram_the_type_is_right_or_said_to_be_undecided(power):
    arcs = np.radians(FOLDING["parallelogram"][0])
    arcs[0] += 10.0**-power
    result = sk.run(four_bar(arcs), NAME, samples=37)
    frame, relation = result.frame(), result.frame(NAME, "relation")
    assert silent(relation) <= {"transmission"}
    if power < 12:
        assert frame["kind"].value_counts().to_dict() == {"I": 2, "II": 2}
        assert set(frame["certain"]) == {"yes"}
        return
    assert set(frame["kind"]) == {"III"} and set(frame["certain"]) == {"no"}
    assert all("undecided within tolerance" in words for words in frame["note"])
    assert "AT_SINGULARITY" in set(relation["status"].astype(str))


@pytest.mark.many
@pytest.mark.parametrize("away", [0.0, 1e-3, 1e-6, 1e-9, 1e-12, 1e-14, -1e-3, -1e-14])
def test_a_sample_on_a_dead_centre_or_beside_it_is_right_or_has_a_status(away):
    """There the input is a quadratic function of the arc length, its rate goes as a root.

    Both modes end there; beyond it neither closes.
    """
    dead = float(angles_with_links_in_line(*ROCKER)[0])
    made = replace(four_bar(ROCKER), inputs=(Input("21", dead - 0.5, dead - away),))
    result = sk.run(made, NAME, samples=5)
    points, frame = result.frame(), result.frame(NAME, "relation")
    assert not result.failures
    assert np.min(np.abs(points[points["kind"] == "II"]["q"] - dead)) < 1e-13
    assert silent(frame) <= {"transmission", "input_margin_I"}
    last = frame[frame["sample"] == 4]
    if away == -1e-3:
        assert set(last["status"].astype(str)) == {"OUT_OF_REACH"}
        return
    if away >= 1e-14:
        assert set(last["status"].astype(str)) == {"OK"}
        rates = np.abs(last["input_rate"])
        assert np.all((rates > 0.1 * np.sqrt(away)) & (rates < 10.0 * np.sqrt(away)))
        assert np.allclose(last["input_margin_II"], away, rtol=1e-3, atol=1e-15)
    else:
        assert set(last["status"].astype(str)) <= {"AT_SINGULARITY", "OUT_OF_REACH"}


@pytest.mark.parametrize("off", [0.0, 1e-8])
@pytest.mark.parametrize(("coaxial", "freedoms"), [(2, 2), (3, 2), (4, 3)])
def test_a_mechanism_that_is_singular_everywhere_says_so(coaxial, freedoms, off):
    axes = np.array([Z] * coaxial + [SLANT] * (4 - coaxial))
    axes[0] = np.sin(off), 0.0, np.cos(off)
    made = mechanism_from_chain("1-2 2-3 3-4 1-4", axes, span=(-1.0, 1.0))
    result = sk.run(made, NAME, samples=9)
    figures, warnings = findings_and_warnings(result)
    assert not result.failures and not len(result.frame())
    assert figures["freedoms_everywhere"] == freedoms
    assert any("singular everywhere" in words for words in warnings)


@pytest.mark.slow
def test_a_chain_that_moves_against_its_count_has_its_singularities():
    """Dixon's K(3,3): the bars of one point turn about one line, so form i is empty."""
    result = sk.run(dixon_mechanism(np.random.default_rng(3)), NAME, samples=9)
    frame, relation = result.frame(), result.frame(NAME, "relation")
    assert not result.failures and set(frame["certain"]) == {"yes"}
    notes = " ".join(findings_and_warnings(result)[0]["notes"])
    assert "lie in one plane everywhere" in notes
    assert "are one line everywhere, so form i says nothing" in notes
    distances = {"distance_I", "distance_II", "transmission", "input_margin_II"}
    assert silent(relation) <= {"c", "d"} | distances
    empty = relation[relation["c"].isna()]
    assert set(zip(empty["output"], empty["form"], strict=True)) == {("bar2/bar0", "i")}


def test_what_is_true_of_every_gear_train_is_noted_and_no_warning():
    """Axes in one plane, three on one line, and pages though nothing is singular."""
    result = sk.run("planetary_bevel", NAME, samples=5, recorder=SceneListener())
    figures, warnings = findings_and_warnings(result)
    assert not warnings and not result.failures and result.frame().empty
    assert any("lie in one plane everywhere" in note for note in figures["notes"])


QUICK = ("bevel_pair", "four_bar", "universal_joint")
SINGLE = """double_butterfly eight_bar_05 eight_bar_07 eight_bar_15 flat_cam planetary_bevel
    roller_cam rolling_cones shaped_cam shaped_flat_cam single_flier stephenson two_contacts
    watt"""
LONG = [pytest.param(name, marks=pytest.mark.long) for name in SINGLE.split()]


@pytest.mark.parametrize("name", [*QUICK, *LONG])
def test_shipped_mechanisms_run_from_the_shell(name, tmp_path, capsys):
    """Run the command; every row has a kind, and NaN only with a reason."""
    command = ["run", name, "-a", NAME, "--samples", "13", "-o", str(tmp_path)]
    assert main(command) == 0
    capsys.readouterr()
    frame = pd.read_csv(tmp_path / f"{NAME}.csv", keep_default_na=False)
    assert set(frame["kind"]) <= {"I", "II", "III", "self-motion"}
    assert all(frame["note"].astype(bool) | frame["condition"].astype(bool))
    relation = pd.read_csv(tmp_path / f"{NAME}_relation.csv")
    (item,) = json.loads((tmp_path / "summary.json").read_text())["analyses"]
    assert not item["findings"]["checks_failed"]
    silence = {"transmission", "input_margin_I", "input_margin_II"}
    if any("are one line everywhere" in note for note in item["findings"]["notes"]):
        silence |= {"c", "d"}
    assert silent(relation) <= silence


GRASHOF = {
    "crank-rocker": (60.0, 20.0, 70.0, 40.0),
    "rocker-crank": (60.0, 40.0, 70.0, 20.0),
    "double-crank": (20.0, 60.0, 50.0, 70.0),
    "double-rocker": (60.0, 50.0, 20.0, 70.0),
    "triple-rocker": (70.0, 40.0, 50.0, 45.0),
}


@pytest.mark.parametrize("name", GRASHOF)
def test_the_class_of_a_four_bar_is_how_its_links_turn(name):
    """Against inputs at which the triangles of its diagonals close, one by one."""
    g, a, h, b = np.radians(GRASHOF[name])
    turns = np.linspace(0.0, np.pi, 2001)

    def closes(fixed, moved, one, other):
        aside = np.sin(fixed) * np.sin(moved) * np.cos(turns)
        across = np.arccos(np.cos(fixed) * np.cos(moved) + aside)
        longest = min(one + other, 2.0 * np.pi - one - other)
        return np.all((across >= abs(one - other)) & (across <= longest))

    turning = (
        name in ("crank-rocker", "double-crank"),
        name in ("rocker-crank", "double-crank"),
    )
    assert turning == (closes(g, a, h, b), closes(g, b, h, a))
    if not any(turning):  # the coupler against the input, seen from there
        assert closes(h, a, g, b) == (name == "double-rocker")
    assert name == class_of(g, a, h, b)
    assert class_of(abs(a - h) + b, a, h, b) == "change-point"


def test_the_summary_answers_what_a_designer_asks_of_a_four_bar():
    found = sk.run("four_bar", NAME)
    figures, warnings = findings_and_warnings(found)
    assert figures["grashof"] == "crank-rocker" and not warnings
    said = "\n".join(found.summary["remarks"])
    g, a, h, b = np.radians([60.0, 20.0, 70.0, 40.0])

    def corner(opposite, one, other):
        cosine = np.cos(opposite) - np.cos(one) * np.cos(other)
        return np.degrees(np.arccos(cosine / (np.sin(one) * np.sin(other))))

    swing = corner(h + a, g, b) - corner(h - a, g, b)
    assert f"swings {swing:.6g} deg" in said
    least = min(corner(g - a, h, b), 180.0 - corner(g + a, h, b))
    assert f"least transmission angle of 4/1: {least:.4g} deg at 21 = 0 deg" in said
    for turn in (corner(b, h + a, g), corner(b, h - a, g) + 180.0):
        assert all(f"{angle % 360.0:.6g}" in said for angle in (turn, -turn))


@pytest.mark.many
@pytest.mark.parametrize("rate", [6.0, -2.0])
def test_a_simulation_has_the_places_that_it_passes_with_their_turn(rate):
    """Type I of the rocker is where its rate changes sign, in whichever turn it is."""
    made = replace(sk.load("four_bar"), loads=())
    way = {"start": {"q": 0.3, "dq": rate}, "duration": 4.0, "samples": 41}
    run = sk.run(made, "singularities", **way, engine="numpy")
    rows = run.frame("singularities")
    passed = np.sort(rows["q"][rows["inside"] == "yes"])
    moved = sk.simulate(made, way["start"], 4.0, engine="numpy").at(np.linspace(0, 4, 4001))
    column = made.angles["41"]
    turned = np.flatnonzero(np.diff(np.sign(np.diff(moved.values[:, column]))))
    assert np.ptp(moved.q) > 4.0 and len(turned) == len(passed) >= 2
    assert np.allclose(np.sort(moved.q[turned + 1]), passed, atol=0.02)
    elsewhere = rows[rows["inside"] == "no"]
    assert set(elsewhere["curve"]) == {1} and len(elsewhere) == 2


def test_relations_keep_their_sense_where_an_axis_rests():
    """One sample is where links rest relative to each other and the curve closes."""
    rows = sk.run("four_bar", "singularities").frame("singularities", "relation")
    for _, relation in rows.groupby(["assembly_mode", "output", "form"]):
        steps = relation[["c", "d"]].dropna().diff().abs().to_numpy()
        assert np.nanmax(steps, initial=0.0) < 0.1
