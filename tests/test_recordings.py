"""What recordings show, read back and compared with tables and closed forms."""

import os
import re
import shlex
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from helpers.scene_listener import SceneListener
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.cli.main import main
from spherekit.cli.view import find_recording
from spherekit.display.rerun.blueprint import MAX_COMPARED_CURVES
from spherekit.display.rerun.chart_frame import FRAME_HEIGHT, tick_text, ticks
from spherekit.display.rerun.charts import (
    Chart,
    grid_values,
    legend_places,
    legend_texts,
)
from spherekit.display.rerun.diagrams import _angle_text, moving_columns
from spherekit.display.rerun.entities import draw_path, draw_static
from spherekit.display.rerun.preview import preview
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.display.rerun.screenshot import check_picture, check_version
from spherekit.errors import OutputError, SolveError
from spherekit.files.mechanism_reader import loads
from spherekit.scenes.colours import HEAT_COLOURS, heat_colours
from spherekit.scenes.plot_layout import choose_plot_range, quantity_scale
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import (
    Axis,
    Diagram,
    Graph,
    InputMarks,
    Portrait,
    Scene,
    Series,
    Surface,
    Trace,
)


def recorded(path, name, *args, **options):
    """Record a run, return its result and the titles of the pages in order."""
    with RerunRecorder(name, path=path) as recorder:
        result = sk.run(name, *args, recorder=recorder, **options)
        recorder.finish()
        pages = recorder._charts.layout.blueprint().root_container.contents
    return result, [page.name for page in pages]


def read_component(path, entity, component):
    """Return the rows of one component of an entity, as recorded."""
    rows = []
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and component in batch.schema.names:
            rows += batch.column(component).to_pylist()
    return rows


def number(text):
    return float(text.replace("\u2212", "-"))


def test_cursors_legends_and_curves_of_charts_agree_with_the_table(tmp_path):
    """Charts of a recording agree with the table of poles.

    They show the velocity coefficients of links 3 and 4 relative to link 1. There is a
    chart for each assembly mode; "p1" and "p0" are names of the modes. The cursor of a
    chart is at the input, which goes from 0 to 360 deg. The legend shows the coefficients
    at the cursor to four significant digits. A curve shows the column of the table, scaled
    and shifted so that it fits into the frame. In a chart y points down, and y = 0 is the
    upper edge of the frame.
    """
    path = tmp_path / "a.rrd"
    result, pages = recorded(path, "four_bar", "poles:only=31+41", samples=73)
    assert pages == ["Mode 0 (p1)", "Mode 1 (p0)", "Compare"]
    frame = result.frame()
    for mode in (0, 1):
        chart = f"/four_bar/assembly_mode_{mode}/charts/velocity_coefficients"
        cursors = np.array(read_component(path, f"{chart}/cursor", "LineStrips2D:strips"))
        # Axes: row, line (one), end of the line, x or y. A cursor is a vertical line.
        x = cursors[:, 0, 0, 0]
        motion = result.frame("motion").query("assembly_mode == @mode")
        # The last cursor is at 360 deg.
        assert x / x[-1] == pytest.approx(np.degrees(motion["q"]) / 360.0, abs=1e-6)

        legends = read_component(path, f"{chart}/legend", "Points2D:labels")
        for k, link in enumerate("34"):
            is_pole = (frame["assembly_mode"] == mode) & (frame["link"] == link)
            coefficient = frame[is_pole]["velocity_coefficient"].to_numpy()
            # A label is the name of a curve, two spaces, and its value at the cursor.
            shown = np.array([number(labels[k].split("  ")[1]) for labels in legends])
            assert shown == pytest.approx(coefficient, rel=6e-4)  # four digits
            (curve,) = read_component(path, f"{chart}/curves/{k}", "LineStrips2D:strips")
            y = -np.array(curve[0])[:, 1]  # points up
            correlation = np.corrcoef(y, coefficient)[0, 1]
            assert correlation == pytest.approx(1.0, abs=1e-9)
            assert np.all((y < 0.0) & (y > -FRAME_HEIGHT))


def test_charts_over_time_step_from_sample_to_sample(tmp_path):
    """Nine samples over 2 s are 0.25 s apart."""
    with RerunRecorder("four_bar", path=tmp_path / "a.rrd") as recorder:
        sk.run("four_bar", "poles:only=31", duration=2.0, samples=9, recorder=recorder)
        assert recorder._charts.layout.step == 0.25


def test_over_a_grid_series_are_maps_of_the_inputs(tmp_path):
    path = tmp_path / "a.rrd"
    result, _ = recorded(path, "five_bar", "poles:only=31", samples=(5, 4), grid=True)
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    maps = {e for e in entities if e.endswith("/map")}
    assert maps and not any("/curves/" in entity for entity in entities)
    motion = result.frame("motion").query("assembly_mode == 0")
    values = np.arange(20.0)
    x, y, cells = grid_values(
        [motion["q_21"].to_numpy(), motion["q_51"].to_numpy()], values
    )
    assert np.degrees(x) == pytest.approx(np.linspace(40.0, 140.0, 5))
    assert np.degrees(y) == pytest.approx(np.linspace(40.0, 70.0, 4))
    assert np.array_equal(cells, values.reshape(5, 4))


def test_plot_ranges_have_a_margin_except_for_colours():
    values = np.array([np.nan, 1.0, 3.0])
    assert choose_plot_range(values, 3.0) == pytest.approx((0.9, 3.1))
    assert choose_plot_range(values, 3.0, shown_by="colours") == (1, 3)


@pytest.mark.parametrize("unit", ["rad", "N m"])
def test_plot_ranges_do_not_cut_off_peaks_above_rounding_errors(unit):
    """Most values are 0 up to rounding, and 5 % are 1. The range is that of all values."""
    values = 1e-16 * np.sin(np.arange(200.0))
    values[:10] = 1.0
    low, high = choose_plot_range(values, quantity_scale(values, unit))
    assert (low, high) == pytest.approx((-0.05, 1.05))


def test_plot_ranges_cut_off_huge_values():
    """All values but one are from 0 to 1, and so the range is not much longer."""
    values = np.append(np.linspace(0.0, 1.0, 200), 1e12)
    _, high = choose_plot_range(values, quantity_scale(values, "rad"))
    assert 1.0 < high < 3.0


def test_plots_over_time_have_every_angle_of_the_table_of_the_motion():
    """A crank with 7 rad/s turns by more than half a turn between samples."""
    listener = SceneListener()
    laws = {"21": sk.ConstantSpeed(7.0)}
    result = sk.run(
        "four_bar", "poles", laws=laws, duration=2.0, samples=5, recorder=listener
    )
    plots = listener.primitives(Series, page=0)
    motion = result.frame("motion").query("assembly_mode == 0")
    for name in ("theta_21", "theta_32", "theta_43", "theta_41"):
        assert np.array_equal(plots[f"plots/variable/{name}"].values, motion[name])


def test_ticks_are_round_numbers():
    for low, high, is_in_degrees, expected in (
        (0.0, 360.0, True, ["0", "60", "120", "180", "240", "300", "360"]),
        (0.0, 1.0, False, ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        (0.0, 36000.0, True, ["0", "7200", "14400", "21600", "28800", "36000"]),
        (-0.3, 0.2, False, ["\u22120.3", "\u22120.2", "\u22120.1", "0", "0.1", "0.2"]),
    ):
        step, values = ticks(low, high, is_in_degrees)
        assert [tick_text(value, step) for value in values] == expected


@pytest.mark.parametrize(
    ("low", "high"),
    [(1.0, 1.0001), (1.0, 1.000012), (-1e-5, 1e-5), (1e10, 1.0005e10), (-3e7, 2e7)],
)
def test_the_numbers_at_ticks_are_the_values_of_the_ticks(low, high):
    """The steps 2e-5, 2.5e-6, 5e-6, 1e6 and 1e7 are written with significant digits."""
    step, values = ticks(low, high, is_degrees=False)
    shown = [number(tick_text(value, step)) for value in values]
    assert shown == pytest.approx(values, abs=1e-6 * step, rel=0)


@pytest.mark.parametrize("value", [0.3, -40.5, 0.0, 1e300])
@pytest.mark.parametrize("is_degrees", [False, True])
def test_an_axis_with_one_value_has_this_value_at_its_tick(value, is_degrees):
    step, (place,) = ticks(value, value, is_degrees)
    assert number(tick_text(place, step)) == value


def test_an_axis_that_is_almost_as_short_as_the_least_number_has_a_tick():
    assert len(ticks(0.0, 2.5e-323, is_degrees=False)[1]) == 1


def test_legends_show_small_torques_but_no_rounding_errors_of_angles():
    values = np.array([3e-12, np.nan])
    torque = Series("t", "t", "t", values, "N m")
    angle = Series("a", "a", "a", values, "deg")
    assert legend_texts([torque]) == ["t  3e\u221212", "t  \u2013"]
    assert legend_texts([angle]) == ["a  0", "a  \u2013"]


def test_a_legend_without_names_has_no_places():
    assert legend_places(100.0, 0).shape == (0, 2)


def record_scenes(path, *scenes, name="x"):
    """Record scenes with three samples, for one mode 0 and other pages; return charts."""
    inputs = np.radians([0.0, 1.0, 2.0])
    with RerunRecorder(name, path=path) as recorder:
        recorder.start(RecordingHead([], inputs, {0: "mode"}))
        for scene in scenes:
            recorder.log(scene, np.arange(3), inputs)
        recorder.finish()
        return recorder._charts


RAMP = np.arange(3.0)


def test_a_page_that_has_charts_only_is_shown(tmp_path):
    curve = Series("b", "b", "b", RAMP)
    page = Scene("Response", (curve,), source="an analysis")
    charts = record_scenes(tmp_path / "a.rrd", Scene(0, (curve,)), page)
    tabs = charts.layout.blueprint().root_container.contents
    assert [tab.name for tab in tabs] == ["Response", "mode"]


@pytest.mark.parametrize("pages", [("P", "P"), ("\u03b1", "\u03b2")])
@pytest.mark.parametrize("groups", [("a/b", "a b"), ("\u03c9", "\u03b1")])
def test_titles_that_differ_in_symbols_only_do_not_share_a_chart(tmp_path, groups, pages):
    """Such titles have the same letters from a to z, of which paths are made."""
    scenes = [
        Scene(page, (Series("a", "a", groups[0], RAMP), Series("b", "b", groups[1], RAMP)))
        for page in pages
    ]
    charts = record_scenes(tmp_path / "a.rrd", *scenes).charts
    assert len(charts) == 2 * len(set(pages))
    assert all(len(chart.curves) == 1 for chart in charts.values())


def test_maps_whose_titles_differ_in_symbols_only_are_drawn(tmp_path):
    over = (Axis("x", "", RAMP), Axis("y", "", RAMP))
    curves = tuple(Series(name, name, "g", RAMP) for name in ("\u03b1", "\u03b2"))
    charts = record_scenes(tmp_path / "a.rrd", Scene("P", curves, over=over)).charts
    assert len(charts) == 2


@pytest.mark.parametrize(("name", "page"), [("charts", 0), ("x", "Charts")])
def test_inputs_are_marked_whatever_a_mechanism_or_a_page_is_called(tmp_path, name, page):
    path = tmp_path / "a.rrd"
    marks = InputMarks("m", "m", np.radians([[1.0]]))
    record_scenes(path, Scene(page, (Series("a", "a", "a", RAMP), marks)), name=name)
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    assert any(entity.endswith("/charts/a/marks/0") for entity in entities)


def test_texts_of_a_legend_keep_their_places_if_series_change_their_order(tmp_path):
    a = Series("a", "a", "g", RAMP)
    b = Series("b", "b", "g", RAMP)
    path = tmp_path / "a.rrd"
    record_scenes(path, Scene(0, (a, b)), Scene(0, (b, a)))
    legends = read_component(path, "/x/assembly_mode_0/charts/g/legend", "Points2D:labels")
    assert len(legends) == 6
    assert all(labels[0].startswith("a ") for labels in legends)


def test_a_comparison_drawn_for_a_viewer_is_dropped_if_more_modes_follow(tmp_path):
    curve = Series("a", "a", "a", RAMP)
    inputs = np.radians(RAMP)
    modes = {mode: f"Mode {mode}" for mode in range(MAX_COMPARED_CURVES + 1)}
    with RerunRecorder("x", path=tmp_path / "a.rrd") as recorder:
        recorder.start(RecordingHead([], inputs, modes))
        for mode in modes:
            recorder.log(Scene(mode, (curve,)), np.arange(3), inputs)
            if mode == 1:
                recorder._charts.draw(())
                assert recorder._charts.layout.comparisons
        recorder.finish()
        assert not recorder._charts.layout.comparisons


def test_marks_outside_the_range_of_a_chart_are_not_drawn():
    """Of marks at -30 and 45 degrees, a chart from 0 to 90 degrees shows the second."""
    over = (Axis("input", "deg", np.linspace(0.0, 90.0, 7)),)
    chart = Chart("c", over)
    chart.add("c", Series("c", "c", "c", np.arange(7.0)), over)
    marks = InputMarks("m", "m", np.array([[-30.0], [45.0]]))
    (line,) = dict(chart.draw([marks]))["marks/0"].strips.as_arrow_array().to_pylist()
    assert line[0][0] == pytest.approx(0.5 * chart.width)


def test_colours_go_from_the_first_to_the_last_of_the_scale():
    low, high = heat_colours(np.array([2.0, 5.0]), 2.0, 5.0).tolist()
    assert tuple(low) == HEAT_COLOURS[0]
    assert tuple(high) == HEAT_COLOURS[-1]


@pytest.mark.slow
def test_figures_and_recordings_of_a_result_share_one_pass_through_the_run(tmp_path):
    """After `plot`, further plots and `save` of a result do not repeat the run.

    A result has no drawings (scenes). It repeats its run when figures are first drawn, and
    then stores the scenes (`result.views`). The legend of the recording that is saved
    afterwards must equal that of a fresh result, in all 13 samples.
    """
    pytest.importorskip("matplotlib", reason="figures are drawn by matplotlib")
    options = {"samples": 13, "block": 5}
    sk.run("four_bar", "poles", **options).save(tmp_path / "a.rrd")
    result = sk.run("four_bar", "poles", **options)
    figure_names = list(result.plot())

    def refuse_second_pass(recorder):
        raise AssertionError("it repeated the run again")

    assert callable(result.views.repeat_run)
    result.views.repeat_run = refuse_second_pass
    assert list(result.plot(columns=1)) == figure_names
    result.save(tmp_path / "b.rrd")
    legend = "/four_bar/assembly_mode_1/charts/velocity_coefficients/legend"
    fresh = read_component(tmp_path / "a.rrd", legend, "Points2D:labels")
    saved_later = read_component(tmp_path / "b.rrd", legend, "Points2D:labels")
    assert fresh == saved_later
    assert len(fresh) == options["samples"]


@pytest.mark.slow
def test_what_was_asked_for_comes_first(tmp_path):
    pose = "inverse_kinematics:poses=x=0.5+y=0.6+z=0.62"
    _, pages = recorded(tmp_path / "a.rrd", "five_bar", [pose, "poles"], samples=3)
    assert pages[0] == "Inverse" and pages.index("Mode 0 (+)") > pages.index("Measure")
    _, pages = recorded(tmp_path / "b.rrd", "five_bar", ["poles", pose], samples=3)
    assert pages[0] == "Mode 0 (+)"
    _, pages = recorded(tmp_path / "c.rrd", "four_bar", "singularities", samples=9)
    assert pages[0] == "Singularities"


def test_solved_poses_are_drawn():
    listener = SceneListener()
    wanted = np.array([0.5, 0.6, 0.62]) / np.linalg.norm([0.5, 0.6, 0.62])
    pose = "inverse_kinematics:poses=x=0.5+y=0.6+z=0.62"
    result = sk.run("five_bar", pose, recorder=listener, samples=3)
    (page,) = [scene for scene in listener.scenes if scene.page == "Inverse"]
    bodies = {p.path: p for p in page.primitives if p.path.startswith("link/")}
    solved = result.frame("inverse_kinematics").query("status == 'OK'")
    assert len(bodies["link/3"].quaternions) == len(solved) == 4
    mechanism = sk.load("five_bar")
    axis = np.array(mechanism.outputs[0].direction)
    turned = Rotation.from_quat(bodies["link/3"].quaternions).apply(axis)
    assert np.max(np.abs(turned - wanted)) < 1e-9


def test_an_axode_that_is_asked_for_twice_is_drawn_once():
    listener = SceneListener()
    sk.run("four_bar", "poles:axodes=31+13", recorder=listener, samples=3)
    paths = []
    for scene in listener.scenes:
        if scene.page == 0:
            paths += [item.path for item in scene.primitives if isinstance(item, Trace)]
    assert paths == ["axode/P31/fixed", "axode/P31/moving"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "first_step"),
    [
        ("two_contacts", "0  1 axis of a pair is known"),
        ("four_bar", "0  4 axes of pairs are known"),
    ],
)
def test_the_construction_counts_its_first_axes(name, first_step):
    listener = SceneListener()
    sk.run(name, "poles", recorder=listener, samples=3)
    (page,) = [scene for scene in listener.scenes if scene.page == "Construction"]
    (steps,) = [item for item in page.primitives if item.path == "steps"]
    assert first_step in steps.markdown


def test_the_moving_axode_rolls_on_the_fixed_one():
    """The moving axode of two links rolls on the fixed one without slip.

    Axodes are the paths of the pole 31 (axis of relative rotation of links 3 and 1) on the
    fixed sphere and on the moving link. They touch at the pole, have equal arc lengths, and
    are tangent there. Arc lengths and tangents are differences of 2881 samples.
    `SceneListener` collects what a run draws.
    """
    listener = SceneListener()
    result = sk.run("four_bar", "poles:only=31,axodes=31", recorder=listener, samples=2881)
    frame = result.frame().query("assembly_mode == 0")
    traces = []
    for scene in listener.scenes:
        if scene.page == 0:
            traces += [item for item in scene.primitives if isinstance(item, Trace)]
    fixed, moving = traces
    u = frame[["ux", "uy", "uz"]].to_numpy()
    assert fixed.quaternions is None
    assert np.max(np.abs(fixed.directions - u)) < 1e-14
    link_rotation = Rotation.from_quat(moving.quaternions)
    assert np.max(np.abs(link_rotation.apply(moving.directions) - u)) < 1e-12

    def arc_lengths(directions):
        return np.cumsum(np.linalg.norm(np.diff(directions, axis=0), axis=1))

    fixed_lengths = arc_lengths(fixed.directions)
    assert fixed_lengths[-1] > 1.0
    assert arc_lengths(moving.directions) == pytest.approx(fixed_lengths, rel=1e-4)

    fixed_tangent = np.gradient(fixed.directions, axis=0)
    moving_tangent = link_rotation.apply(np.gradient(moving.directions, axis=0))
    sine = np.linalg.norm(np.cross(moving_tangent, fixed_tangent), axis=1)
    sine /= np.linalg.norm(moving_tangent, axis=1) * np.linalg.norm(fixed_tangent, axis=1)
    assert np.max(sine[2:-2]) < 5e-3


@pytest.mark.many
@pytest.mark.parametrize("name", ["stephenson", "double_butterfly", "four_bar"])
def test_each_step_of_the_pole_construction_puts_a_pole_where_two_lines_meet(name):
    """A diagram shows how the pole axes follow from those of the pairs, step by step.

    A pole is the axis of the relative rotation of two links. The sphere is projected from
    its centre to a plane (a gnomonic chart), in which great circles are straight lines a x
    + b y + c = 0. The samples of the diagram are the steps of the construction, not those
    of the run. The first one has the poles that are axes of pairs. Each further one adds
    one other pole (a secondary pole) and shows the two lines on which it lies.

    In the double butterfly no pole follows from lines at first. One pole is computed from
    equations of a group of links instead. The text of this step says so.
    """
    listener = SceneListener()
    # Other pages show the great circles of a chosen pole. The construction does not depend
    # on this choice, even if the pole is the axis of a pair, such as 4/1 of the four-bar.
    poles = "poles:circles=4/1" if name == "four_bar" else "poles"
    result = sk.run(name, poles, recorder=listener, samples=3, assembly_mode=0)
    (page,) = [scene for scene in listener.scenes if scene.page == "Construction"]
    (diagram,) = [item for item in page.primitives if isinstance(item, Diagram)]
    is_shown = np.isfinite(diagram.places).all(axis=2)
    constructed_count = 0
    for step, (before, after) in enumerate(pairwise(is_shown), start=1):
        new_poles = np.flatnonzero(after & ~before)
        lines = diagram.lines[step]
        # The step of the group of links has no two lines. The number of other steps is
        # checked below.
        if not np.isfinite(lines).all() or len(new_poles) != 1:
            continue
        position = diagram.places[step, new_poles[0]]
        distances = lines[:, :2] @ position + lines[:, 2]
        distances /= np.linalg.norm(lines[:, :2], axis=1)
        size = max(1.0, np.max(np.abs(position)))
        assert np.max(np.abs(distances)) < 1e-7 * size
        constructed_count += 1

    mechanism = sk.load(name)
    link_count = len(mechanism.links)
    secondary_count = link_count * (link_count - 1) // 2 - len(mechanism.pairs)
    assert len(diagram.words) == 1 + secondary_count  # one text for each sample
    irreducible_count = 1 if name == "double_butterfly" else 0
    assert constructed_count == secondary_count - irreducible_count
    assert sum("velocity equations" in text for text in diagram.words) == irreducible_count
    assert len(result.frame()) > 0


def test_a_preview_shows_sizes_and_angles_at_the_start_of_the_range(tmp_path):
    """A preview of a mechanism shows arcs of links in a table, and pair angles as fans.

    A row of the table is such as "| 2 | 12-23 15 |": link 2 has an arc of 15 deg between
    the axes of the pairs 12 and 23. A fan has two strips: a line that begins at the axis of
    the pair, and an arc about this axis. The arc is a list of points. Its angle is the sum
    of the angles between neighbouring points, with the sine in place of each small angle.
    So it is accurate to 2e-3. It must be the pair variable at the start of the input's
    range, which a run computes.
    """
    path = tmp_path / "a.rrd"
    # The empty text says that the mechanism can be assembled at the first input.
    assert preview(sk.load("stephenson"), path) == ""
    (text,) = read_component(path, "/stephenson/assembly_mode_0/sizes", "TextDocument:text")
    assert "| 2 | 12\u201323 15 |" in text[0]
    # The table "motion" of a run has the pair variables. A run needs an analysis; that of
    # one pole takes little time. The single sample is the start of the range.
    motion = sk.run("stephenson", "poles:only=21", samples=1).frame("motion")
    first_mode = motion.query("assembly_mode == 0")
    for pair in ("34", "16", "56"):
        # A fan begins at the zero of the pair variable, so its path contains "zero".
        entity = f"/stephenson/assembly_mode_0/zero/{pair}"
        (strips,) = read_component(path, entity, "LineStrips3D:strips")
        axis = np.array(strips[0][0])
        axis /= np.linalg.norm(axis)
        fan = np.array(strips[1])
        across = fan - np.outer(fan @ axis, axis)
        sines = np.cross(across[:-1], across[1:]) @ axis
        angle = np.sum(sines / np.sum(across[1:] ** 2, axis=1))
        expected = float(first_mode[f"theta_{pair}"].iloc[0])
        assert angle == pytest.approx(expected, rel=2e-3)


FAR = mechanism_text("far")


def test_a_mechanism_that_does_not_close_everywhere_says_where_it_is_shown(tmp_path):
    """The crank's tip is at 0 at the start, and the others reach 5 to 15 deg."""
    file = tmp_path / "far.toml"
    file.write_text(FAR.format("0.0", "40.0"))
    assert "shown at 21 = 10 deg" in preview(sk.load(file), tmp_path / "a.rrd")
    file.write_text(FAR.format("100.0", "200.0"))
    with pytest.raises(SolveError):
        preview(sk.load(file), tmp_path / "b.rrd")
    assert not (tmp_path / "b.rrd").exists()


@pytest.mark.slow
def test_a_preview_shows_the_first_input_tried_at_which_any_mode_exists(tmp_path):
    """Modes 0 to 3 of this mechanism exist near 100 deg, the others already at 70 deg.

    The inputs tried are 60, 70, ..., 140 deg.
    """
    mechanism = sk.load("two_contacts")
    (driven,) = mechanism.inputs
    wide = replace(driven, start=np.radians(60.0), stop=np.radians(140.0))
    note = preview(replace(mechanism, inputs=(wide,)), tmp_path / "a.rrd")
    assert note.endswith("shown at 12 = 70 deg")


def test_underscores_around_names_are_no_emphasis_in_texts_of_previews(tmp_path):
    """Markdown reads `_21_` as 21 in italics. The name of a pair keeps its underscores."""
    text = FAR.format("0.0", "40.0").replace('"far"', '"_far_"')
    text = text.replace('"21"', '"_21_"').replace(".21", "._21_")
    path = tmp_path / "a.rrd"
    assert "shown at _21_ = 10 deg" in preview(loads(text, "far"), path)
    (sizes,) = read_component(path, "/far/assembly_mode_0/sizes", "TextDocument:text")
    assert r"shown at \_21\_ = 10 deg" in sizes[0]
    (about,) = read_component(path, "/far/notes", "TextDocument:text")
    assert about[0].startswith("# \\_far\\_\n")


def test_a_recording_of_another_version_is_refused(tmp_path):
    """A recording begins with its format and the version of the viewer that reads it."""
    path = tmp_path / "a.rrd"
    path.write_bytes(b"RRF2" + bytes([0, 99, 0, 0]) + bytes(40))
    with pytest.raises(OutputError, match=re.escape("rerun-sdk==0.99.*")):
        check_version(path)
    path.write_bytes(b"RRF0" + bytes(44))
    with pytest.raises(OutputError, match="make it again"):
        check_version(path)


def test_a_screenshot_that_cannot_be_written_is_refused(tmp_path, capsys):
    for name, size, message in (
        ("x.jpg", (800, 600), "name it"),
        ("none/x.png", (800, 600), "does not exist"),
        ("x.png", (800, 60), "100 to 8192"),
    ):
        with pytest.raises(OutputError, match=message):
            check_picture(tmp_path / name, size)
    recorded(tmp_path / "b.rrd", "four_bar", "poles:only=31", samples=3)
    assert main(["view", str(tmp_path), "--png", str(tmp_path / "x.jpg")]) == 1
    assert "x.png" in capsys.readouterr().err


def test_view_says_which_picture_it_wrote(tmp_path, capsys, monkeypatch):
    """The picture itself needs a graphics driver, so it is not drawn here."""
    recorded(tmp_path / "b.rrd", "four_bar", "poles:only=31", samples=3)
    module = "spherekit.display.rerun.screenshot.screenshot"
    monkeypatch.setattr(module, lambda *arguments, **options: None)
    picture = str(tmp_path / "x.png")
    assert main(["view", str(tmp_path / "b.rrd"), "--png", picture]) == 0
    assert f"Files: {picture}" in capsys.readouterr().out
    assert main(["view", str(tmp_path / "b.rrd"), "--png", picture, "-q"]) == 0
    assert capsys.readouterr().err == ""


def test_a_folder_says_which_recording_it_took(tmp_path, capsys):
    for age, name in enumerate(("old.rrd", "new.rrd")):
        path = tmp_path / name
        path.write_bytes(b"RRF2")
        os.utime(path, (age, age))
    assert find_recording(str(tmp_path)).name == "new.rrd"
    assert "old.rrd" in capsys.readouterr().err


def test_a_folder_is_searched_for_files_only(tmp_path):
    """A folder named as a recording, or a link to nowhere, does not hide a recording."""
    (tmp_path / "a.rrd").write_bytes(b"RRF2")
    (tmp_path / "folder.rrd").mkdir()
    (tmp_path / "link.rrd").symlink_to(tmp_path / "nowhere")
    assert find_recording(str(tmp_path)) == tmp_path / "a.rrd"


def test_names_of_recordings_send_no_control_sequences(tmp_path, capsys):
    for name in ("a.rrd", "\x1b[31m.rrd"):
        (tmp_path / name).write_bytes(b"RRF2")
    find_recording(str(tmp_path))
    message = capsys.readouterr().err
    assert "[U+001B]" in message
    assert "\x1b" not in message


@pytest.mark.parametrize(
    "words",
    [["--sample", "0"], ["--front", "Compare"], ["--only-3d"], ["--size", "800x600"]],
)
def test_options_of_a_picture_are_refused_without_one(words, capsys):
    assert main(["view", "four_bar", *words]) == 1
    assert "add --png" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["stephenson_output", "my wrist.study.toml"])
def test_a_study_is_refused_with_the_command_that_runs_it(name, capsys):
    assert main(["view", name]) == 1
    message = " ".join(capsys.readouterr().err.split())
    assert "a study cannot be shown before it is run" in message
    assert f"`{shlex.join(['spherekit', 'run', name, '--view'])}`" in message


def test_a_diagram_without_points_shows_its_lines():
    """The line x = 0 is in the middle of a frame from -1 to 1."""
    diagram = Diagram(
        "d", "d", "x", "y", (-1.0, 1.0), (-1.0, 1.0),
        names=[], places=np.zeros((2, 0, 2)), tones=[],
        lines=np.tile([1.0, 0.0, 0.0], (2, 1, 1)),
    )  # fmt: skip
    parts = dict(moving_columns(diagram))
    strips = [list(column.as_arrow_array()) for column in parts["lines"]]
    assert [len(rows) for rows in strips] == [2]
    assert all(len(row) == 1 for row in strips[0])


@pytest.mark.parametrize(
    "primitive",
    [
        Graph("g", nodes=[], edges=[], positions=[]),
        Surface("s", "s", np.zeros((0, 3)), np.zeros((0, 3), int), axes=("a", "b", "c")),
    ],
)
def test_an_empty_graph_or_surface_draws_nothing(primitive):
    assert list(draw_static(primitive)) == []


def test_angles_of_a_diagram_have_no_minus_before_zero():
    texts = [_angle_text(angle) for angle in (-0.04, -0.0, -0.06, np.nan)]
    assert texts == ["0.0\u00b0", "0.0\u00b0", "\u22120.1\u00b0", "\u2013"]


def test_the_path_of_a_point_of_a_plot_is_broken_at_the_ends_of_the_rows_of_a_grid():
    """Two rows of three points: two lines, or a single one without a grid."""
    x, y = np.tile([0.0, 1.0, 2.0], 2), np.repeat([0.0, 1.0], 3)
    portrait = Portrait("p", "p", x, y, "x", "y", (0.0, 2.0), (0.0, 1.0))
    for row_length, line_lengths in [(None, [6]), (3, [3, 3])]:
        [(_, curve)] = draw_path(portrait, portrait.placed(), row_length)
        strips = curve.strips.as_arrow_array().to_pylist()
        assert [len(strip) for strip in strips] == line_lengths
