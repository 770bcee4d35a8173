"""The analysis of singularities with several inputs: tables, conditions, recordings."""

import numpy as np
import pytest
from helpers.scene_listener import SceneListener
from mechanism_examples.wide_five_bar import wide_five_bar
from rerun.chunk import RrdReader

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

    `five_bar_run` is a run of the analysis. Let input k move at the rate q_k' while the
    other one is locked. The output then turns at a rate y' about an axis u_k, and c_k y' =
    d_k q_k'.

    - At type II both couplers are in line. Both c are 0, and both axes u_k coincide.
    - At type I either a d is 0, or u_k is along the direction that is the output. The
      direction then rests, because it lies on the axis of rotation.

    The column `signs` has the sign of the dyad (the two couplers). It is 0 where the
    assembly modes 0 and 1 meet.
    """
    result, _ = five_bar_run
    frame = result.frame("singularities")
    columns = "kind condition assembly_mode q_21 q_51 inside"
    assert list(frame)[:6] == columns.split()
    assert set(frame.guarantee) == {"complete to a box size"}
    assert frame.residual.max() < 1e-12
    conditions_1 = set(frame[frame.kind == "I"].condition)
    conditions_2 = set(frame[frame.kind == "II"].condition)
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

    An aspect is a region of inputs and modes that no singularity divides. `five_bar_run` is
    a run of the analysis of singularities. `row_counts` are the rows of each aspect.
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
    rows = {row[0].split(" (")[0].removeprefix("type "): row for row in table["rows"]}
    for kind in ("I", "II"):
        of_kind = points[points.kind == kind]
        inside = of_kind[of_kind.inside == "yes"]
        count = inside.curve.nunique()
        _, inside_text, outside_text, reach = rows[kind]
        word = "curve" if count == 1 else "curves"
        assert inside_text == (f"{count} {word}" if count else "none")
        outside = of_kind.curve.nunique() - count
        assert outside_text.startswith(str(outside) if outside else "none")
        reaches = [
            [[float(x) for x in part.split(" = ")[1].split(" to ")] for part in parts]
            for parts in (text.split(", ") for text in reach.split("; ") if text != "-")
        ]
        degrees = np.degrees(inside[["q_21", "q_51"]].to_numpy())
        for point in degrees:
            assert any(
                all(
                    limits[0] - 0.5 <= angle <= limits[-1] + 0.5
                    for limits, angle in zip(curve, point, strict=True)
                )
                for curve in reaches
            )


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
