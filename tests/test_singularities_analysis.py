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
from spherekit.singularities.grashof import class_of, grashof

NAME = "singularities"
Z, SLANT = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.6, 0.8])


@pytest.fixture(scope="module")
def rocker_result():
    """Return the result of a double-rocker, and the listener that has its pages."""
    listener = SceneListener()
    result = sk.run(four_bar(ROCKER), NAME, samples=61, recorder=listener)
    assert not result.failures
    return result, listener


def columns_with_missing_numbers(frame):
    """Return the columns with NaN in rows whose status is OK."""
    good = frame[frame["status"].astype(str) == "OK"]
    numbers = good.select_dtypes("number")
    return set(numbers.columns[numbers.isna().any()])


def test_dead_centres_of_a_rocker_are_where_two_links_are_in_line(rocker_result):
    """Dead centres of a double-rocker are at the inputs that the cosine theorem gives.

    `rocker_result` is a run of the analysis. At a dead centre (type II) coupler and rocker
    are in line, the input reverses and two assembly modes meet. At type I the output
    reverses. All types are certain. No singularity is double: the rate that is zero there
    changes its sign.

    A pole axis is the axis of the relative rotation of two links. A singularity occurs
    where two pole axes are the same line. One of them is that of crank and rocker. The
    other is the fixed axis of the crank at type I, or of the rocker at type II. The column
    `condition` then has the label I.3 or II.3. Each row has a note in words.
    """
    result, _listener = rocker_result
    frame = result.frame()
    type_1 = frame[frame["kind"] == "I"]
    type_2 = frame[frame["kind"] == "II"]
    expected = np.sort(np.mod(angles_with_links_in_line(*ROCKER), 2.0 * np.pi))
    assert len(type_2) == len(expected) > 0
    assert len(frame) == len(type_2) + len(type_1)
    assert np.max(np.abs(np.sort(type_2["q"]) - expected)) < 1e-12
    assert set(type_2["reversal"]) == {"input"}
    assert set(type_1["reversal"]) == {"output"}
    assert all(len(modes.split("+")) == 2 for modes in type_2["assembly_mode"])
    for kind, rows in (("I", type_1), ("II", type_2)):
        assert all(f"{kind}.3" in labels.split() for labels in rows["condition"])
    assert set(frame["certain"]) == {"yes"}
    assert set(frame["double"]) == {"no"}
    assert set(frame["guarantee"]) == {"complete"}
    assert np.all(frame["residual"] < 1e-9)
    assert np.all(frame["note"] != "")


def test_the_relation_of_rates_holds_in_every_row(rocker_result):
    """c times the output's rate is d times the input's rate in every row with status OK.

    `rocker_result` is a run of a double-rocker. Triple products of pole axes give the
    coefficients c and d in two ways (`form`). Form i takes the axes of ground, input and
    output link, form ii also those of the fourth link. At samples where the loop does not
    close, rows have another status. In rows with status OK only the distance from a
    singularity (`input_margin_`) may be missing, where its type does not occur.
    """
    result, _listener = rocker_result
    frame = result.frame(NAME, "relation")
    good = frame[frame["status"].astype(str) == "OK"]
    assert 0 < len(good) < len(frame)
    misses = good["c"] * good["output_rate"] - good["d"] * good["input_rate"]
    assert np.max(np.abs(misses)) < 1e-12
    assert set(good["form"]) == {"i", "ii"}
    assert set(good["output"]) == {"4/1"}
    assert columns_with_missing_numbers(frame) <= {"input_margin_I", "input_margin_II"}


@pytest.mark.slow
def test_findings_count_singularities_by_type(rocker_result):
    result, _ = rocker_result
    findings, _ = findings_and_warnings(result)
    assert findings[NAME] == result.frame()["kind"].value_counts().to_dict()
    assert findings["guarantee"].startswith("complete")
    assert not findings["checks_failed"]
    assert not findings["notes"]


@pytest.mark.slow
def test_singularities_are_warned_of_within_the_distance_that_near_states(rocker_result):
    """The parameter `near` (deg) says within which distance a singularity causes a warning.

    `rocker_result` is a run of a double-rocker with the default. A singularity that is met
    in the range always causes a warning, also with `near=0`.
    """
    _, default_warnings = findings_and_warnings(rocker_result[0])
    warnings_by_near = {}
    for near in (25, 0):
        result = sk.run(four_bar(ROCKER), f"{NAME}:near={near}", samples=61)
        _, warnings_by_near[near] = findings_and_warnings(result)
    meets = (
        "The output rocker (4/1) meets a singularity of type II in the range: there the "
        "locked input does not hold it"
    )
    for warnings in (default_warnings, *warnings_by_near.values()):
        assert f"{NAME}: {meets}" in warnings
    assert not any("without meeting" in text for text in warnings_by_near[0])
    assert len(warnings_by_near[25]) >= len(default_warnings)


def test_pages_list_every_singularity_and_mark_it_on_the_phase_portrait(rocker_result):
    """A recording lists every singularity on its page, and marks it on phase portraits.

    `rocker_result` has the tables of a run of a double-rocker, and a listener. The listener
    keeps the pages that a recording would have, with their drawings. A portrait is a plot
    over the input, with marks at the singularities of a whole configuration curve. Both
    assembly modes are parts of one curve. So the portrait of each mode marks all
    singularities.
    """
    result, listener = rocker_result
    frame = result.frame()
    page, _ = listener.last_scene("Singularities")
    # The page has a table with a row for each singularity. Instead of the samples of the
    # run, the page has the numbers of the singularities as its axis.
    (axis,) = page.over
    assert len(axis.values) == len(frame)
    (text,) = (item.markdown for item in page.primitives if isinstance(item, Text))
    table_lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len(table_lines) == 2 + len(frame)  # two head lines
    for mode in set(result.frame("motion")["assembly_mode"]):
        (portrait,) = listener.primitives(Portrait, mode).values()
        labels = sorted(mark.label for mark in portrait.marks)
        assert labels == sorted(f"type {kind}" for kind in frame["kind"])
        # Each singularity of the table has a mark within 1 deg.
        input_of_mark = np.array([mark.place[0] for mark in portrait.marks])
        distances = np.abs(frame["q"].to_numpy()[:, None] - input_of_mark)
        assert np.max(np.min(distances, axis=1)) < np.radians(1.0)


SWINGING = [
    "rocker (4/1) swings 180 deg, from 0 to 180 deg on configuration curves",
    "rocker (4/1) swings 180 deg, from -180 to 0 deg on configuration curves",
    "Curves of configurations cross (type III of output rocker (4/1)) at 21 = 0, 180 deg",
    "Least transmission angle of rocker (4/1): 0 deg",
]
FOLDING = {
    "parallelogram": ([60.0, 40.0, 60.0, 40.0], {"III": 2}, {}, SWINGING),
    "kite": ([60.0, 60.0, 40.0, 40.0], {"II": 4, "III": 2}, {"II": 2}, []),
    "rhombus": ([50.0] * 4, {"III": 3, "I": 2, "II": 2}, {"I": 2, "II": 2}, []),
    "all 90 deg": (
        [90.0] * 4,
        {"III": 4, "I": 4, "II": 4},
        {"I": 4, "II": 4},
        ["rocker (4/1) rests at 0 deg on configuration curves"],
    ),
}
"""A folding four-bar, its rows by type, those of them of whole curves, and what is said.

A link rests at its angle 0 or pi where the equation of the loop vanishes whatever the other
angle is; these circles are cut where the slope of the equation across them vanishes.
"""


@pytest.mark.many
@pytest.mark.parametrize("name", FOLDING)
def test_folding_four_bars_have_the_right_types(name):
    """Folding four-bars have singularities of the right types.

    `FOLDING` has the arcs of each shape and the expected number of rows by type. Where
    configuration curves cross, the singularity is of type III. The reason is that all axes
    are in one plane, a condition with the label III.a.

    A link can also rest on a whole curve. If it is the input, each configuration of the
    curve is singular of type II, and if it is the output, of type I. The table has one row
    for the whole curve; its column `q` is empty. The remarks must not say that the link
    swings by 0 deg.
    """
    arcs, count_by_type, resting_count_by_type, expected_remarks = FOLDING[name]
    result = sk.run(four_bar(np.radians(arcs)), NAME, samples=37)
    assert not result.failures
    remarks = "\n".join(result.summary["remarks"])
    assert "swings 0" not in remarks
    assert all(text in remarks for text in expected_remarks)

    frame = result.frame()
    assert frame["kind"].value_counts().to_dict() == count_by_type
    assert set(frame["certain"]) == {"yes"}
    crossings = frame[frame["kind"] == "III"]
    assert all("III.a" in labels.split() for labels in crossings["condition"])
    resting = frame[frame["q"].isna()]
    assert all("at rest on the whole" in note for note in resting["note"])
    assert resting["kind"].astype(str).value_counts().to_dict() == resting_count_by_type
    # In rows with status OK only the transmission angle may be missing.
    relation = result.frame(NAME, "relation")
    assert columns_with_missing_numbers(relation) <= {"transmission"}


@pytest.mark.slow
@pytest.mark.parametrize("power", [8, 12])
def test_near_a_parallelogram_the_type_is_right_or_said_to_be_undecided(power):
    """Near a parallelogram, the type of a singularity is right or called undecided.

    At type I the output rests while the input moves, at type II the input rests. Type III
    is where curves of configurations cross. With equal opposite links all axes lie in one
    plane at the inputs 0 and 180 deg, which are singularities of type III. Here the base is
    10^-power rad too long: 1e-8 or 1e-12 rad. The mechanism then has two singularities of
    type I close to the input 0, and two of type II close to 180 deg. At 1e-8 rad these
    types must be found. At 1e-12 rad rounding does not allow that. Each row must then have
    type III, the word "no" in the column `certain`, and "undecided" in its note.
    """
    arcs_deg, *_ = FOLDING["parallelogram"]  # base, crank, coupler and rocker
    arcs = np.radians(arcs_deg)
    arcs[0] += 10.0**-power
    result = sk.run(four_bar(arcs), NAME, samples=37)
    frame = result.frame()
    # The rates of input and output, in every sample.
    relation = result.frame(NAME, "relation")
    assert not columns_with_missing_numbers(relation)
    if power == 8:
        assert frame["kind"].value_counts().to_dict() == {"I": 2, "II": 2}
        assert set(frame["certain"]) == {"yes"}
        return
    assert set(frame["kind"]) == {"III"}
    assert set(frame["certain"]) == {"no"}
    assert all("undecided within tolerance" in words for words in frame["note"])
    # The samples at 0, 180 and 360 deg are singular within rounding.
    assert "AT_SINGULARITY" in set(relation["status"].astype(str))


@pytest.mark.many
@pytest.mark.parametrize(
    "distance_rad", [0.0, 1e-3, 1e-6, 1e-9, 1e-12, 1e-14, -1e-3, -1e-14]
)
def test_a_sample_on_a_dead_centre_or_beside_it_is_right_or_has_a_status(distance_rad):
    """A sample on or beside a dead centre has right numbers or a status.

    The input of the last of five samples is `distance_rad` less than that of a dead centre.
    If the distance is negative, the loop does not close there. Near the dead centre the
    input q is a quadratic function of the arc length s of the configuration curve. So dq/ds
    (`input_rate`) is proportional to the square root of the distance. `input_margin_II` is
    this distance. `input_margin_I` is missing if there is no singularity of type I on the
    curve. The table `relation` has these columns for each sample and assembly mode.
    """
    dead_centre = float(angles_with_links_in_line(*ROCKER)[0])
    span = Input("21", dead_centre - 0.5, dead_centre - distance_rad)
    mechanism = replace(four_bar(ROCKER), inputs=(span,))
    result = sk.run(mechanism, NAME, samples=5)
    assert not result.failures
    points = result.frame()
    relation = result.frame(NAME, "relation")
    type_2_inputs = points[points["kind"] == "II"]["q"]
    assert np.min(np.abs(type_2_inputs - dead_centre)) < 1e-13
    missing = columns_with_missing_numbers(relation)
    assert missing <= {"input_margin_I"}

    last = relation[relation["sample"] == 4]
    status = set(last["status"].astype(str))
    if distance_rad == -1e-3:
        assert status == {"OUT_OF_REACH"}
    elif distance_rad in (0.0, -1e-14):
        # On the dead centre up to rounding: the loop may close or not.
        assert status <= {"AT_SINGULARITY", "OUT_OF_REACH"}
    else:
        assert status == {"OK"}
        # The factor of the square root depends on the arcs; it is of the order of 1.
        root = np.sqrt(distance_rad)
        rates = np.abs(last["input_rate"])
        assert np.all(rates > 0.1 * root)
        assert np.all(rates < 10.0 * root)
        margins = last["input_margin_II"]
        assert np.allclose(margins, distance_rad, rtol=1e-3, atol=1e-15)


@pytest.mark.parametrize("deviation_rad", [0.0, 1e-8])
@pytest.mark.parametrize(("coaxial", "freedoms"), [(2, 2), (3, 2), (4, 3)])
def test_a_mechanism_that_is_singular_everywhere_says_so(coaxial, freedoms, deviation_rad):
    """Two, three or all axes of a four-bar are one line, up to a tiny deviation.

    It then has two or three degrees of freedom everywhere, and no single singularities.
    """
    axes = np.array([Z] * coaxial + [SLANT] * (4 - coaxial))
    axes[0] = np.sin(deviation_rad), 0.0, np.cos(deviation_rad)
    mechanism = mechanism_from_chain("1-2 2-3 3-4 1-4", axes, span=(-1.0, 1.0))
    result = sk.run(mechanism, NAME, samples=9)
    findings, warnings = findings_and_warnings(result)
    assert not result.failures
    assert result.frame().empty
    assert findings["freedoms_everywhere"] == freedoms
    assert any("singular everywhere" in text for text in warnings)


@pytest.mark.slow
def test_a_chain_that_moves_against_its_count_has_its_singularities():
    """Dixon's K(3,3): the bars of one point turn about one line, so form i is empty."""
    result = sk.run(dixon_mechanism(np.random.default_rng(3)), NAME, samples=9)
    frame, relation = result.frame(), result.frame(NAME, "relation")
    assert not result.failures and set(frame["certain"]) == {"yes"}
    notes = " ".join(findings_and_warnings(result)[0]["notes"])
    assert "lie in one plane everywhere" in notes
    assert "are one line everywhere, so form i is undefined" in notes
    distances = {"distance_I", "distance_II", "transmission", "input_margin_II"}
    assert columns_with_missing_numbers(relation) <= {"c", "d"} | distances
    empty = relation[relation["c"].isna()]
    assert set(zip(empty["output"], empty["form"], strict=True)) == {("bar2/bar0", "i")}


def test_what_is_true_of_every_gear_train_is_noted_and_no_warning():
    """Its axes lie in one plane, three on one line; pages are made all the same."""
    result = sk.run("planetary_bevel", NAME, samples=5, recorder=SceneListener())
    findings, warnings = findings_and_warnings(result)
    assert not result.failures
    assert not warnings
    assert result.frame().empty
    assert any("lie in one plane everywhere" in note for note in findings["notes"])


QUICK = ("bevel_pair", "four_bar", "universal_joint")
SINGLE = """double_butterfly eight_bar_05 eight_bar_07 eight_bar_15 flat_cam planetary_bevel
    roller_cam rolling_cones shaped_cam shaped_flat_cam single_flier stephenson two_contacts
    watt"""
LONG = [pytest.param(name, marks=pytest.mark.long) for name in SINGLE.split()]


@pytest.mark.parametrize("name", [*QUICK, *LONG])
def test_shipped_mechanisms_run_from_the_shell(name, tmp_path, capsys):
    """The command finds singularities of shipped mechanisms with a type and a reason each.

    Numbers may be missing only where that is explained. c and d connect the rates of output
    and input, c y' = d q'. A note says that they are missing because three pole axes
    coincide everywhere. Distances to singularities (`input_margin_I` and `_II`) are missing
    where there are none. Transmission angles are missing if no dyad (two links joined by a
    pair) places the output.
    """
    command = ["run", name, "-a", NAME, "--samples", "13", "-o", str(tmp_path)]
    assert main(command) == 0
    capsys.readouterr()
    frame = pd.read_csv(tmp_path / f"{NAME}.csv", keep_default_na=False)
    assert set(frame["kind"]) <= {"I", "II", "III", "self-motion"}
    has_reason = frame["note"].astype(bool) | frame["condition"].astype(bool)
    assert all(has_reason)
    (analysis,) = json.loads((tmp_path / "summary.json").read_text())["analyses"]
    findings = analysis["findings"]
    assert not findings["checks_failed"]
    may_be_missing = {"transmission", "input_margin_I", "input_margin_II"}
    if any("are one line everywhere" in note for note in findings["notes"]):
        may_be_missing |= {"c", "d"}
    relation = pd.read_csv(tmp_path / f"{NAME}_relation.csv")
    assert columns_with_missing_numbers(relation) <= may_be_missing


GRASHOF = {
    "crank-rocker": (60.0, 20.0, 70.0, 40.0),
    "rocker-crank": (60.0, 40.0, 70.0, 20.0),
    "double-crank": (20.0, 60.0, 50.0, 70.0),
    "double-rocker": (60.0, 50.0, 20.0, 70.0),
    "triple-rocker": (70.0, 40.0, 50.0, 45.0),
}


@pytest.mark.parametrize("name", GRASHOF)
def test_the_grashof_class_of_a_four_bar_says_which_links_turn_fully(name):
    """The Grashof class of a four-bar says which links turn fully.

    The reference: a link turns fully against a neighbour if the loop closes at all of 2001
    angles between them. The diagonal is the arc between the far ends of the two links, and
    follows from the law of cosines. The loop closes if the other two links can span it.
    """
    ground, crank, coupler, rocker = np.radians(GRASHOF[name])
    angles = np.linspace(0.0, np.pi, 2001)

    def turns_fully(fixed, moving, first, second):
        """Return whether `moving` turns fully against `fixed`; all arcs in rad."""
        cosine = np.cos(fixed) * np.cos(moving)
        cosine = cosine + np.sin(fixed) * np.sin(moving) * np.cos(angles)
        diagonal = np.arccos(cosine)
        longest = min(first + second, 2.0 * np.pi - first - second)
        shortest = abs(first - second)
        return np.all((diagonal >= shortest) & (diagonal <= longest))

    crank_turns = name in ("crank-rocker", "double-crank")
    rocker_turns = name in ("rocker-crank", "double-crank")
    assert turns_fully(ground, crank, coupler, rocker) == crank_turns
    assert turns_fully(ground, rocker, coupler, crank) == rocker_turns
    if not crank_turns and not rocker_turns:
        # In a double-rocker the coupler turns fully against its neighbours.
        coupler_turns = turns_fully(coupler, crank, ground, rocker)
        assert coupler_turns == (name == "double-rocker")
    assert class_of(ground, crank, coupler, rocker) == name
    # With this ground arc all links can lie in one great circle, with crank and coupler
    # folded onto each other: ground = rocker + |crank - coupler|.
    change_point = class_of(abs(crank - coupler) + rocker, crank, coupler, rocker)
    assert change_point == "change-point"


def test_the_grashof_remark_names_the_fixed_link_if_it_is_not_the_ground():
    """With pair 32 driven, links 3 and 1 turn fully relative to the crank 2.

    Link 1 is the ground, which does not turn otherwise.
    """
    mechanism = sk.load("four_bar")
    assert str(grashof(mechanism)) == "Crank-rocker: link 2 turns fully, link 4 swings"
    driven = replace(mechanism, inputs=(replace(mechanism.inputs[0], pair="32"),))
    text = "Double-crank (relative to link 2): links 3 and 1 turn fully"
    assert str(grashof(driven)) == text


def test_the_summary_of_a_four_bar_states_swing_transmission_angle_and_limits():
    """A run states swing, transmission angle and limits of the four-bar in its remarks.

    All are angles of spherical triangles, by the law of cosines. The rocker swings between
    two limits, in which crank and coupler are in line. The remarks also state the crank
    angles at these limits. The transmission angle, between coupler and rocker, is least
    where the crank lies on the ground arc.
    """
    result = sk.run("four_bar", NAME)
    findings, warnings = findings_and_warnings(result)
    assert findings["grashof"] == "crank-rocker"
    assert not warnings
    remarks = "\n".join(result.summary["remarks"])
    ground, crank, coupler, rocker = np.radians([60.0, 20.0, 70.0, 40.0])

    def corner_deg(opposite, first, second):
        """Return the angle (deg) opposite to a side of a spherical triangle."""
        cosine = np.cos(opposite) - np.cos(first) * np.cos(second)
        return np.degrees(np.arccos(cosine / (np.sin(first) * np.sin(second))))

    rocker_stretched = corner_deg(coupler + crank, ground, rocker)
    rocker_folded = corner_deg(coupler - crank, ground, rocker)
    assert f"swings {rocker_stretched - rocker_folded:.6g} deg" in remarks

    at_0_deg = corner_deg(ground - crank, coupler, rocker)
    # The corner is obtuse there, and the transmission angle is the acute one.
    at_180_deg = 180.0 - corner_deg(ground + crank, coupler, rocker)
    least = min(at_0_deg, at_180_deg)
    assert (
        f"Least transmission angle of rocker (4/1): {least:.4g} deg at 21 = 0 deg"
        in remarks
    )

    # The direction from the crank's axis to the rocker's tip. A stretched crank has this
    # direction. If the coupler is folded back, the crank has the opposite direction.
    crank_stretched = corner_deg(rocker, coupler + crank, ground)
    crank_folded = corner_deg(rocker, coupler - crank, ground) + 180.0
    # The second assembly mode is the mirror image of the first, with opposite angles.
    for angle in (crank_stretched, crank_folded):
        assert f"{angle % 360.0:.6g}" in remarks
        assert f"{-angle % 360.0:.6g}" in remarks


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("rate", [6.0, -2.0])
def test_a_simulation_lists_the_singularities_that_it_passes_in_each_turn(rate):
    """A simulation lists the singularities that it passes in each turn of the input.

    Their inputs count on over several turns. At a singularity of type I the rate of the
    rocker changes its sign. The reference are sign changes between 4001 times of the same
    simulation. The four-bar has two configuration curves. The simulation stays on curve 0;
    the two singularities of curve 1 are marked as outside.
    """
    mechanism = replace(sk.load("four_bar"), loads=())
    start = {"q": 0.3, "dq": rate}
    duration = 4.0
    run = sk.run(
        mechanism,
        "singularities",
        start=start,
        duration=duration,
        samples=41,
        engine="numpy",
    )
    rows = run.frame("singularities")
    passed = np.sort(rows["q"][rows["inside"] == "yes"])

    simulation = sk.simulate(mechanism, start, duration, engine="numpy")
    states = simulation.at(np.linspace(0.0, duration, 4001))
    rocker_angle = states.values[:, mechanism.angles["41"]]
    reversals = np.flatnonzero(np.diff(np.sign(np.diff(rocker_angle))))
    assert np.ptp(states.q) > 4.0
    assert len(reversals) == len(passed) >= 2
    assert np.allclose(np.sort(states.q[reversals + 1]), passed, atol=0.02)

    not_passed = rows[rows["inside"] == "no"]
    assert set(not_passed["curve"]) == {1}
    assert len(not_passed) == 2


@pytest.mark.slow
def test_relations_keep_their_sense_where_an_axis_rests():
    """The sense of an axis is arbitrary, so c and d could change sign between samples.

    They do not: their steps between 361 samples are below 0.1. At one sample links rest
    relative to each other, and the curve closes there.
    """
    rows = sk.run("four_bar", "singularities").frame("singularities", "relation")
    for _, relation in rows.groupby(["assembly_mode", "output", "form"]):
        steps = relation[["c", "d"]].dropna().diff().abs().to_numpy()
        assert np.nanmax(steps, initial=0.0) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("near", ["180deg", "360deg"])
def test_a_limit_beyond_a_right_angle_warns_as_a_right_angle_does(near):
    """Distances from singularities are at most a right angle."""

    def warnings(limit):
        found = sk.run("four_bar", f"{NAME}:near={limit}", samples=5).summary["warnings"]
        return [text.replace(f"within {limit[:-3]} deg", "near") for text in found]

    assert any("of type II without meeting it" in text for text in warnings(near))
    assert warnings(near) == warnings("90deg")
