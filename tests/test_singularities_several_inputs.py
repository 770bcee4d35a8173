"""The analysis of singularities with several inputs: tables, conditions, recordings."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scene_listener import SceneListener
from mechanism_examples.wide_five_bar import wide_five_bar
from rerun.chunk import RrdReader
from spherekit_analyses.singularities import several_inputs

import spherekit as sk
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.scenes.scene import Portrait, SphereCurves, Surface

COARSE = "singularities:slices=3,input_grid=5,near=10"
"""Few slices and inputs, so that it is quick; `near` is a warning distance in deg."""


@pytest.fixture(scope="module")
def five_bar_run(tmp_path_factory):
    """Return a run of the five-bar, which has inputs 21 and 51, and its recording."""
    path = tmp_path_factory.mktemp("singular") / "five_bar.rrd"
    five_bar = wide_five_bar()
    with RerunRecorder("five bar", path=path) as recorder:
        result = sk.run(five_bar, COARSE, samples=[7, 7], recorder=recorder)
    return result, path


@pytest.mark.slow
def test_points_of_singular_curves_say_why_they_are_singular(five_bar_run):
    """Points of singular curves of a five-bar with two inputs state their condition.

    `five_bar_run` is a run of the analysis. One input, k, moves at a rate q_k' while the
    other one is locked. The output link then turns about an axis u_k, at a rate y'. The two
    rates are related by the equation c_k y' = d_k q_k', whose factors depend on the
    configuration. The output is a direction that is fixed in this link.

    - At type II both couplers are in line. Then c_k is 0 for both inputs, and both axes u_k
      coincide.
    - At type I the output rests. Either d_k is 0 for an input, or the axis u_k is along the
      output itself, which then does not move.

    The column `signs` has the sign of the dyad (the two couplers). It is 0 where the
    assembly modes 0 and 1 meet.
    """
    result, _ = five_bar_run
    frame = result.frame("singularities")
    columns = "kind condition assembly_mode q_21 q_51 inside"
    assert list(frame)[:6] == columns.split()
    # No curve larger than a box of inputs is missing.
    assert set(frame.guarantee) == {"complete to a box size"}
    assert frame.residual.max() < 1e-12
    conditions_1 = set(frame[frame.kind == "I"].condition)
    conditions_2 = set(frame[frame.kind == "II"].condition)
    # The last part says that the axes u_21 and u_51 coincide.
    assert conditions_2 == {"c_21=0 c_51=0 u of 21, 51 coincide"}
    assert conditions_1 <= {"u_21 along the direction", "d_51=0"}
    assert set(frame[frame.signs == "0"].assembly_mode) == {"0+1"}


def test_the_relation_of_rates_holds_for_every_input(five_bar_run):
    """c times the velocity coefficient of the output is d, for each moving input."""
    result, _ = five_bar_run
    frame = result.frame("singularities", "relation")
    assert list(frame)[-3:] == ["moving", "type", "group"]
    good = frame[frame.status == "OK"]
    misses = np.abs(good.c * good.velocity_coefficient - good.d)
    assert np.nanmax(misses) < 1e-12
    assert np.all(good.sigma > 0.0)
    assert set(good.moving) == {"21", "51"}
    assert set(good.type) == {"regular"}
    assert np.all(good.group == 0)


def test_findings_count_aspects_and_singular_curves_as_the_tables_do(five_bar_run):
    """The summary of a run counts aspects and singular curves as its tables do.

    `five_bar_run` is a run of the analysis of singularities. An aspect is a region of
    inputs and modes that no singularity divides. The table of aspects has a row for each
    configuration, with the number of its aspect. The finding "aspects" of the summary lists
    how many configurations each aspect has.

    The finding "curves_II" is the number of singular curves of type II, on which the output
    can move while the inputs rest. The output is that of link 3 relative to link 1.
    """
    result, _ = five_bar_run
    frame = result.frame("singularities", "aspects")
    assert list(frame) == ["aspect", "q_21", "q_51", "sign_II", "sign_I", "assembly_modes"]
    (summary,) = result.summary["analyses"]
    findings = summary["findings"]
    row_counts = frame.aspect.value_counts().sort_index()
    assert findings["aspects"] == row_counts.tolist()
    points = result.frame("singularities")
    curves_2 = points.curve[points.kind == "II"].nunique()
    assert findings["3/1"]["curves_II"] == curves_2
    assert any(
        "type II of output pointer (3/1)" in text for text in result.summary["warnings"]
    )


def parse_reach(text):
    """Return the inputs that singular curves reach, from a cell of the printed table.

    A cell is a text such as "21 = 74, 51 = 41 to 140". Curves are separated by "; ", and
    inputs by ", ". An input is one angle (deg) or a range. Without a curve the text is "-".

    Returns
    -------
    list with an item for each curve: a list of (lowest, highest) angle of each input
    """
    if text == "-":
        return []
    curves = []
    for text_of_curve in text.split("; "):
        limits = []
        for text_of_input in text_of_curve.split(", "):
            _, angles = text_of_input.split(" = ")
            numbers = [float(angle) for angle in angles.split(" to ")]
            limits.append((min(numbers), max(numbers)))
        curves.append(limits)
    return curves


def is_within(point, limits):
    """Return whether inputs (deg) are within limits that are rounded to a degree."""
    for angle, (lowest, highest) in zip(point, limits, strict=True):
        if not lowest - 0.5 <= angle <= highest + 0.5:
            return False
    return True


def test_the_screen_says_how_many_singular_curves_there_are_and_where(five_bar_run):
    """The printed table of singular curves agrees with the table of their points.

    `five_bar_run` is a run of the analysis of singularities. The printed table counts the
    curves inside and outside of the input ranges, and says which inputs (deg) each curve
    reaches. All points inside must be within these inputs, up to the rounding to a degree.
    """
    result, _ = five_bar_run
    (summary,) = result.summary["analyses"]
    (table,) = summary["screen_tables"]
    assert table["title"].startswith(
        "Singularities of the output pointer (3/1) in the ranges"
    )
    points = result.frame("singularities")
    row_by_kind = {}
    for row in table["rows"]:
        # Such as "type II (the locked inputs do not hold the output)".
        kind, *_ = row[0].removeprefix("type ").split(" (")
        row_by_kind[kind] = row
    words_of_count = {0: "none", 1: "1 curve"}
    for kind in ("I", "II"):
        of_kind = points[points.kind == kind]
        inside = of_kind[of_kind.inside == "yes"]
        inside_count = inside.curve.nunique()
        _, inside_text, outside_text, reach_text = row_by_kind[kind]
        assert inside_text == words_of_count.get(inside_count, f"{inside_count} curves")
        outside_count = of_kind.curve.nunique() - inside_count
        if outside_count:
            assert outside_text.startswith(str(outside_count))
        else:
            assert outside_text.startswith("none")
        limits_of_curves = parse_reach(reach_text)
        for point in np.degrees(inside[["q_21", "q_51"]].to_numpy()):
            assert any(is_within(point, limits) for limits in limits_of_curves)


def test_recording_has_the_curves_on_the_sphere_and_in_the_plane_of_inputs(
    five_bar_run,
):
    _, path = five_bar_run
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    for name in (
        "singular/pointer/II",
        "plots/inputs/pointer/curve_0",
        "plots/inputs/pointer/mark",
    ):
        assert f"/five_bar/assembly_mode_0/{name}" in entities


def test_three_inputs_have_coefficients_and_no_surface_if_it_is_left_out():
    """With three inputs singularities are a surface; `mesh=0` leaves it out."""
    pages = SceneListener()
    result = sk.run(
        "three_rrr", "singularities:input_grid=3,mesh=0", samples=3, recorder=pages
    )
    assert result.frame("singularities").empty
    assert set(result.frame("singularities", "relation").moving) == {"a1", "a2", "a3"}
    for primitives in pages.primitives_by_page.values():
        for primitive in primitives:
            assert not isinstance(primitive, Surface | Portrait | SphereCurves)


def test_reciprocal_condition_is_that_of_the_loop_equations_with_locked_inputs():
    """With one loop it is the reciprocal of the condition number of the motion."""
    result = sk.run("five_bar", "singularities:slices=0,input_grid=0", samples=3)
    frame = result.frame("singularities", "relation")
    motion = sk.trace(sk.load("five_bar"), samples=3)
    expected = 1.0 / motion.conditioning
    for pair in ("21", "51"):
        rows = frame[frame.moving == pair]
        np.testing.assert_allclose(rows.reciprocal_condition, expected, rtol=1e-9)


def test_modes_of_type_three_in_every_row_are_remarked_and_not_warned_of(monkeypatch):
    """If a mode is of type III in every row, a remark says so, and there is no warning.

    At type I inputs can move while the output rests, at type II the output can move while
    the inputs rest. Type III is both at once. The analysis warns if rows (configurations)
    come near to type I or II, that is, if `type_one` or `type_two` is small. It must leave
    out modes of type III in every row. Here all rows are changed to such rows, for which
    both measures are zero.
    """
    computed = several_inputs.coefficients

    def all_of_type_three(*arguments):
        rows = computed(*arguments)
        zeros = np.zeros(len(rows.type))
        types = np.full_like(rows.type, several_inputs.RowType.III)
        return replace(rows, type=types, type_one=zeros, type_two=zeros)

    monkeypatch.setattr(several_inputs, "coefficients", all_of_type_three)
    analysis = "singularities:slices=0,input_grid=0"
    (summary,) = sk.run("five_bar", analysis, samples=2).summary["analyses"]
    assert any("of type III in every row" in remark for remark in summary["remarks"])
    assert not summary["warnings"]


def test_reached_angles_that_round_to_zero_have_no_sign():
    """Angles from -0.3 to 0.2 degrees are 0, not from -0 to 0."""
    points = np.radians([[-0.3, 10.2], [0.2, 12.0]])
    text = several_inputs._reach_text([points], ["21", "51"])
    assert text == "21 = 0, 51 = 10 to 12"


@pytest.mark.slow
def test_each_surface_of_an_output_has_its_own_number():
    """Surfaces of types I and II of one output have different numbers."""
    analysis = "singularities:input_grid=0,mesh=30,seconds=10"
    points = sk.run("three_rrr", analysis, samples=2).frame("singularities")
    numbers_1 = set(points.curve[points.kind == "I"])
    numbers_2 = set(points.curve[points.kind == "II"])
    assert numbers_1
    assert numbers_2
    assert not numbers_1 & numbers_2
