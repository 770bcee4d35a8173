"""Figures: what is drawn is what tables say, and what is known of maps holds on them."""

import subprocess
import sys
from dataclasses import dataclass
from itertools import combinations, product
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from helpers.minimal_analysis import MinimalAnalysis, with_row_columns

pytest.importorskip("matplotlib")
from matplotlib.colors import to_rgb

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.figures import coinciding_paths, style
from spherekit.display.figures.coinciding_paths import find_coinciding_paths
from spherekit.display.figures.column_plots import draw_columns
from spherekit.display.figures.contents import Figures, plan_figures
from spherekit.display.figures.dark_figure import DARK_BACKGROUND, dark_copy
from spherekit.display.figures.figure_files import write_figures
from spherekit.display.figures.sheet import Drawing, Sheet
from spherekit.display.figures.sphere_projection import (
    EQUAL_AREA,
    STEREOGRAPHIC,
    SphereView,
    frame_about,
    opposite_frame,
)
from spherekit.errors import AnalysisError, OutputError
from spherekit.markup import html_table
from spherekit.scenes.plot_layout import place_labels
from spherekit.scenes.scene import (
    Axis,
    InputMarks,
    Mark,
    PlaneCurve,
    Portrait,
    Scene,
    Series,
)
from spherekit.tables.table import ASSEMBLY_MODE, INPUT, INPUTS, SAMPLE, Column, Table

CAP_RADIUS_RAD = 0.4
"""Angular radius of the small circles that are mapped."""


@pytest.fixture(scope="module")
def four_bar():
    return sk.run("four_bar", ["poles", "singularities"], samples=73)


def curves_by_mode(panel):
    """Return the points (n, 2) of the curves in a panel by number of the assembly mode.

    Curves of modes have the group id "mode 0", "mode 1", ...
    """
    return {
        int(line.get_gid().split()[1]): line.get_xydata()
        for line in panel.lines
        if line.get_gid()
    }


def legend_of(figure):
    """Return the colour of each entry of a figure's legend."""
    (legend,) = figure.legends
    return {
        text.get_text(): line.get_color()
        for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
    }


@pytest.mark.slow
def test_curves_of_velocity_coefficients_are_columns_of_the_table(four_bar):
    """Each panel of a figure shows one pole, with the numbers of the table of poles.

    A pole is the axis of the relative rotation of two links. `four_bar` is a run of the
    four-bar. `curves_by_mode` reads the points of the curves of each assembly mode. A title
    such as ω31/ω21 names the links 3 and 1 of the pole; the input turns link 2.
    """
    figure = four_bar.plot("poles/velocity coefficients")
    frame = four_bar.frame("poles")
    panels = {panel.get_title(): panel for panel in figure.axes}
    assert set(panels) == {f"ω{pole}/ω21" for pole in ("31", "41", "32", "42", "43")}
    for title, panel in panels.items():
        link = title[1]
        reference = title[2]
        for mode, points in curves_by_mode(panel).items():
            is_of_mode = frame["assembly_mode"] == mode
            is_of_pole = (frame["link"] == link) & (frame["relative_to"] == reference)
            rows = frame[is_of_mode & is_of_pole]
            inputs_deg, coefficients = points.T
            assert inputs_deg == pytest.approx(np.degrees(rows["q"].to_numpy()))
            assert coefficients == pytest.approx(rows["velocity_coefficient"].to_numpy())
        assert panel.get_xlim() == pytest.approx((0.0, 360.0))
    assert figure.axes[-1].get_xlabel() == "input 21, deg"
    assert figure.get_supylabel() == "velocity coefficients"
    assert four_bar.plot("acceleration coefficients").get_supylabel().endswith("1/rad")


@pytest.mark.slow
def test_angles_are_in_radians_where_asked(four_bar):
    figure = four_bar.plot("output 4/1 against the input", degrees=False)
    (panel,) = figure.axes
    assert panel.get_xlabel() == "input 21, rad" and panel.get_ylabel() == "output 4/1, rad"
    for points in curves_by_mode(panel).values():
        assert np.nanmax(points[:, 0]) == pytest.approx(2.0 * np.pi)


@pytest.mark.slow
def test_a_mode_has_one_colour_in_all_figures(four_bar):
    """Each assembly mode (way to assemble the links) has the same colour everywhere.

    `four_bar` is a run of the four-bar. Curves of its two modes have the group ids "mode 0"
    and "mode 1". `legend_of` returns the colours of a legend by text.
    """
    colours_by_mode = {}
    for name, figure in four_bar.plot().items():
        # A chart shows one mode only, with other meanings of its colours.
        if name.endswith("gnomonic chart"):
            continue
        for panel in figure.axes:
            for line in panel.lines:
                if line.get_gid():
                    colours_by_mode.setdefault(line.get_gid(), set()).add(line.get_color())
        legend_colours = legend_of(figure)
        both = {legend_colours["mode 0 (p1)"], legend_colours["mode 1 (p0)"]}
        assert both == set(style.MODE_COLOURS[:2])
    assert colours_by_mode == {
        "mode 0": {style.MODE_COLOURS[0]},
        "mode 1": {style.MODE_COLOURS[1]},
    }


@pytest.mark.slow
def test_singularities_are_marked_in_all_plots_over_the_input(four_bar):
    """Triangles mark singularities on the curves of the modes, at the right inputs.

    The expected inputs are those of the table of singularities. `four_bar` is a run over
    the whole range of the input. The second run goes through the inputs from 360 to 0
    degrees.
    """
    expected_inputs = np.degrees(np.sort(four_bar.frame("singularities")["q"].to_numpy()))
    backwards = np.linspace(2.0 * np.pi, 0.0, 73)[:, None]
    runs = [four_bar, sk.run("four_bar", ["poles", "singularities"], path=backwards)]
    # The figure "angles, form i" shows the transmission angle and two other angles. Form i
    # is one of two relations of input and output by Di Gregorio.
    for run, name in product(runs, ("velocity coefficients", "angles, form i")):
        for panel in run.plot(name).axes:
            marks = [x.get_xydata()[0] for x in panel.lines if x.get_marker() == "v"]
            assert np.sort(np.array(marks)[:, 0]) == pytest.approx(expected_inputs)
            for x, y in marks:
                distances = []
                for points in curves_by_mode(panel).values():
                    inputs, values = points[np.argsort(points[:, 0])].T
                    distances.append(abs(np.interp(x, inputs, values) - y))
                assert min(distances) < 1e-9


def test_singularities_have_a_legend_and_marks_on_the_output_curve(four_bar):
    """The legend names dead centres (type I); marks lie within half a degree."""
    expected_inputs = np.degrees(np.sort(four_bar.frame("singularities")["q"].to_numpy()))
    assert "type I" in legend_of(four_bar.plot("velocity coefficients"))
    (panel,) = four_bar.plot("output 4/1 against the input").axes
    marks = [line.get_xdata()[0] for line in panel.lines if len(line.get_xdata()) == 1]
    assert np.sort(marks) == pytest.approx(expected_inputs, abs=0.5)


def circle(pole, angle, count=4000):
    """Return points (count, 3) of a small circle at an angle (rad) from its pole."""
    pole = pole / np.linalg.norm(pole)
    across = np.cross(pole, np.eye(3)[int(np.argmin(np.abs(pole)))])
    across /= np.linalg.norm(across)
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)[:, None]
    ring = np.cos(around) * across + np.sin(around) * np.cross(pole, across)
    return np.cos(angle) * pole + np.sin(angle) * ring


def on_paper(view, directions):
    """Return the points (n, 2) of a map, to the right and upwards, of directions (n, 3)."""
    turn, away = view.project(directions).T
    return np.stack([away * np.cos(turn), away * np.sin(turn)], axis=1)


POLES = np.random.default_rng(1).normal(size=(6, 3))


@pytest.mark.parametrize("pole", POLES)
def test_the_lambert_map_keeps_the_area_of_a_cap(pole):
    """The area on paper of a small circle is that of its cap, 2 pi (1 - cos radius)."""
    view = SphereView(frame_about(pole[None]), EQUAL_AREA, np.pi)
    x, y = on_paper(view, circle(pole, CAP_RADIUS_RAD)).T
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    assert area == pytest.approx(2.0 * np.pi * (1.0 - np.cos(CAP_RADIUS_RAD)), rel=1e-5)


@pytest.mark.parametrize("pole", POLES)
def test_the_stereographic_map_keeps_angles(pole):
    """The angle between two tangents at a point of the sphere is the same on paper.

    It also has the same sign: positive is counterclockwise on paper, and for an observer
    outside the sphere.
    """
    # The map is centred on x, y or z (`frame_about`), not on the point. At the centre of a
    # map, maps of other kinds would keep angles, too.
    whole_sphere = np.pi
    view = SphereView(frame_about(pole[None]), STEREOGRAPHIC, rim=whole_sphere)
    point = pole / np.linalg.norm(pole)
    # Two tangents a and b of the sphere at the point.
    a = np.cross(point, [0.3, -0.8, 0.5])
    b = np.cross(point, a) + 0.7 * a
    angle_on_sphere = np.arctan2(point @ np.cross(a, b), a @ b)

    # Their directions on paper, by central differences.
    step = 1e-6
    neighbours = np.stack(
        [point + step * a, point + step * b, point - step * a, point - step * b]
    )
    neighbours /= np.linalg.norm(neighbours, axis=1)[:, None]
    a_forward, b_forward, a_back, b_back = on_paper(view, neighbours)
    a_on_paper = a_forward - a_back
    b_on_paper = b_forward - b_back
    sine = a_on_paper[0] * b_on_paper[1] - a_on_paper[1] * b_on_paper[0]
    angle_on_paper = np.arctan2(sine, a_on_paper @ b_on_paper)
    assert angle_on_paper == pytest.approx(angle_on_sphere, abs=1e-8)


@pytest.mark.parametrize("pole", POLES)
def test_the_stereographic_map_keeps_circles(pole):
    """A small circle is a circle on paper: its points are equally far from the middle."""
    view = SphereView(frame_about(pole[None]), STEREOGRAPHIC, np.pi)
    points = on_paper(view, circle(pole, CAP_RADIUS_RAD))
    middle = np.mean([points.max(axis=0), points.min(axis=0)], axis=0)
    assert np.ptp(np.linalg.norm(points - middle, axis=1)) < 1e-5


def test_maps_centred_on_a_ground_axis_have_the_other_axes_to_the_right_and_upwards():
    """A map about a ground axis has the other two ground axes to the right and upwards.

    The centre of the map is a ground axis or its opposite. The positive directions of the
    other two axes are to the right and upwards, in the order in which the map is not
    mirrored. On an equal-area map, a direction 90 degrees from the centre is at the radius
    sqrt(2). The view opposite to the opposite view is the first one.
    """
    ground_axes = np.eye(3)
    for centre_axis in range(3):
        for sign in (1.0, -1.0):
            # The rows of a frame are three unit vectors. They are to the right on the map,
            # upwards on it, and at its centre.
            frame = frame_about(sign * ground_axes[[centre_axis]])
            view = SphereView(frame)
            assert np.linalg.det(frame) == pytest.approx(1.0)  # not mirrored
            right, up = ("xyz".index(name) for name in view.axis_names[:2])
            right_point = on_paper(view, ground_axes[[right]])[0]
            assert right_point == pytest.approx([np.sqrt(2.0), 0.0])
            up_point = on_paper(view, ground_axes[[up]])[0]
            assert up_point == pytest.approx([0.0, np.sqrt(2.0)])
            assert np.array_equal(opposite_frame(opposite_frame(frame)), frame)


def series(values, unit="rad", label="a", group="angle"):
    return Series(f"plots/{label}", label, group, np.asarray(values, float), unit)


def one_figure(primitives, over, page=0):
    scene = Scene(page, tuple(primitives), over, "made")
    (figure,) = plan_figures([scene], {0: "Mode 0"}).values()
    return figure


OVER = (Axis("input", "rad", np.linspace(0.0, 1.0, 50)),)


def test_rounding_noise_is_not_scaled_up():
    """A curve constant but for rounding is drawn level, a small but real curve in full
    height.
    """
    noise = 1e-15 * np.random.default_rng(0).normal(size=50)
    (panel,) = one_figure([series(0.3 + noise)], OVER).axes
    low, high = panel.get_ylim()
    assert low < np.degrees(0.3) < high and high - low > 1.0
    (panel,) = one_figure([series(3e-5 * np.sin(OVER[0].values), "N m")], OVER).axes
    assert panel.get_ylim()[1] < 4e-5


def test_a_pole_of_a_curve_is_a_gap_and_leaves_the_frame():
    """A curve through infinity has a gap and is cut off; a steep finite one has none."""
    x = np.linspace(-1.0, 1.0, 100)
    over = (Axis("input", "", x),)
    (panel,) = one_figure([series(1e-3 / x + x, "")], over).axes
    (points,) = curves_by_mode(panel).values()
    assert np.sum(np.isnan(points[:, 1])) == 0
    (panel,) = one_figure([series(1.0 / x**3, "")], over).axes
    (points,) = curves_by_mode(panel).values()
    low, high = panel.get_ylim()
    (gap,) = np.nonzero(np.isnan(points[:, 1]))
    assert len(gap) == 1 and points[gap[0] - 1, 1] < low < high < points[gap[0] + 1, 1]


def test_a_grid_of_inputs_is_a_map_with_its_zeros():
    """Values over a grid of two inputs are drawn as a map with a line at zero.

    The values are a - 0.3 for the inputs a (horizontal) and b (vertical), both in rad. They
    are zero on the vertical line a = 0.3.
    """
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(1.0, 3.0, 5), indexing="ij")
    over = (Axis("left", "rad", a.ravel()), Axis("right", "rad", b.ravel()))
    values = (a - 0.3).ravel()
    drawn_series = series(values, unit="", label="c", group="c")
    panel, bar = one_figure([drawn_series], over).axes  # the map and its colour bar
    meshes = [x for x in panel.collections if x.get_array() is not None]
    mesh = meshes[0]
    assert np.asarray(mesh.get_array()).reshape(5, 6) == pytest.approx((a - 0.3).T)
    # The scale is symmetric, so that zero has the colour in its middle.
    assert mesh.norm.vmin == -mesh.norm.vmax
    assert panel.get_xlabel() == "left, deg"
    assert panel.figure.get_supylabel() == "right, deg"  # shared by all panels of a figure
    # The first collection is the mesh, the others are lines.
    zero_lines = []
    for collection in panel.collections[1:]:
        zero_lines += [path.vertices for path in collection.get_paths()]
    assert np.concatenate(zero_lines)[:, 0] == pytest.approx(np.degrees(0.3))
    assert bar.get_ylabel() == "c"


def zero_lines(panel):
    """Points of the zero lines of a map; its first collection is the mesh."""
    paths = [path for lines in panel.collections[1:] for path in lines.get_paths()]
    return [path.vertices for path in paths if len(path.vertices)]


@pytest.mark.parametrize(("height", "line_count"), [(1.0, 1), (-1.0, 0)])
def test_a_zero_beside_a_steep_part_of_one_sign_has_a_line(height, line_count):
    """The values are a - 0.48 up to a = 0.5, and a constant beyond.

    The step to the constant 1 keeps the sign, so the zero at a = 0.48 has a line. The step
    to the constant -1 changes the sign beside the zero, and no line is drawn there.
    """
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(0.0, 1.0, 5), indexing="ij")
    for first, second in ((a, b), (b.T, a.T)):
        over = (Axis("left", "", first.ravel()), Axis("right", "", second.ravel()))
        steep = first if first is a else second
        values = np.where(steep < 0.52, steep - 0.48, height).ravel()
        panel, _ = one_figure([series(values, "", "c", "c")], over).axes
        lines = zero_lines(panel)
        assert len(lines) == line_count
        for line in lines:
            assert line[:, int(first is not a)] == pytest.approx(0.48)


def mark_positions(values, unit, marked, x):
    """Return x and y of the marks drawn on a curve over x."""
    marks = InputMarks("marks/m", "mark", np.array([[marked]]), tone=1)
    (panel,) = one_figure([series(values, unit), marks], (Axis("t", "s", x),)).axes
    (drawn,) = [line for line in panel.lines if line.get_label() == "mark"]
    return list(drawn.get_xdata()), list(drawn.get_ydata())


def test_a_mark_in_a_gap_of_a_curve_is_a_vertical_line():
    """An angle that jumps by a turn, and a pole, have no value between two samples."""
    x = np.linspace(0.0, 2.0 * np.pi, 37)
    wrapped = np.angle(np.exp(1j * (x + 0.05)))
    marked = np.pi - 0.02
    assert mark_positions(wrapped, "rad", marked, x) == ([marked, marked], [0, 1])
    # Beside the jump, and at a sample next to it, the mark is on the curve.
    for on_curve in (1.0, x[17]):
        assert mark_positions(wrapped, "rad", on_curve, x) == (
            [on_curve],
            pytest.approx([np.degrees(on_curve + 0.05)]),
        )
    x = np.linspace(-1.0, 1.0, 100)
    assert mark_positions(x**-3.0, "", 0.0, x) == ([0.0, 0.0], [0, 1])


def test_a_mark_beyond_the_end_of_a_curve_is_a_vertical_line():
    x = np.linspace(0.0, 1.0, 11)
    marks = InputMarks("marks/m", "mark", np.array([[0.8]]), tone=1)
    scenes = [
        Scene(0, (series(x, ""),), (Axis("t", "s", x),), "made"),
        Scene(1, (series(x[:6], ""), marks), (Axis("t", "s", x[:6]),), "made"),
    ]
    (figure,) = plan_figures(scenes, {0: "Mode 0", 1: "Mode 1"}).values()
    (panel,) = figure.axes
    (drawn,) = [line for line in panel.lines if line.get_label() == "mark"]
    assert list(drawn.get_xdata()) == [0.8, 0.8]


def test_inputs_that_are_no_grid_are_drawn_as_a_path():
    """If both inputs grow together, values are a curve over the path."""
    inputs = np.linspace(0.0, 1.0, 30)
    over = (Axis("left", "rad", inputs), Axis("right", "rad", 1.0 + 2.0 * inputs))
    (panel,) = one_figure([series(inputs - 0.3, "", "c", "c")], over).axes
    assert panel.get_xlabel() == "path of the inputs, deg"


def test_labels_of_crowded_points_do_not_cover_each_other():
    """Labels of 12 random points keep apart and near their points, in each of 5 pictures.

    With the letter size 6, a label "ab" is about 4 wide and 6 high, of which 0.1 may
    overlap. Its distance from the point is at most 4.5 letter sizes, so that a reader finds
    the point. A point that is NaN has no label. A picture is placed as if it were the only
    one.
    """
    points = np.random.default_rng(3).uniform(0.0, 100.0, (5, 12, 2))
    points[2, 4] = np.nan
    labels = ["ab"] * 12
    letter_size = 6.0
    places = place_labels(labels, points, letter_size)
    # (pictures, points, points, 2)
    gaps = np.abs(places[:, :, None] - places[:, None])
    is_apart = (gaps[..., 0] > 4.0) | (gaps[..., 1] > 5.9) | np.isnan(gaps[..., 0])
    assert np.all(is_apart | np.eye(12, dtype=bool))
    assert np.array_equal(np.isnan(places), np.isnan(points))
    assert np.nanmax(np.linalg.norm(places - points, axis=2)) < 4.5 * letter_size
    assert np.array_equal(places[3], place_labels(labels, points[3:4], letter_size)[0])


@pytest.mark.many
@pytest.mark.parametrize("pair", ["21", "41"])
def test_axodes_touch_at_the_pole(pair):
    """At the first configuration the fixed and the moving axode meet at the pole.

    Axodes are the cones that the axis of relative rotation of two links describes in either
    link. A figure shows each as a curve on two panels, one for each hemisphere.
    `run_with_axodes` runs the four-bar with the given input pair.
    """
    result = run_with_axodes(pair)
    # Driven at pair 41, the mechanism has no configuration at the first samples.
    first = np.argmax(np.isfinite(result.frame("poles")["ux"].to_numpy()))
    # For the input 21 the file names mode 0 "p1" and mode 1 "p0". With another input, a
    # mode has only a number and a sign.
    mode_names = ("0 (p1)", "1 (p0)") if pair == "21" else ("0 (+)", "1 (\u2212)")
    for mode_name in mode_names:
        figure = result.plot(f"axodes, mode {mode_name}")
        assert list(legend_of(figure)) == ["fixed axode of P31", "moving axode of P31"]
        touching_panels = 0
        for panel in figure.axes:
            # Axodes have a point for each of the 91 samples, other lines do not.
            curves = [line.get_xydata() for line in panel.lines]
            starts = np.array([curve[first] for curve in curves if len(curve) == 91])
            # Both axodes begin at the pole. It is on the hemisphere of one panel; on the
            # other panel both starts are NaN.
            if not np.isfinite(starts).all():
                continue
            assert starts.shape == (2, 2)
            # Panels are maps with polar coordinates.
            angle, radius = starts.T
            assert abs(np.diff(radius * np.exp(1j * angle))[0]) < 1e-9
            touching_panels += 1
        assert touching_panels


@pytest.mark.many
@pytest.mark.parametrize("pair", ["21", "41"])
def test_the_gnomonic_chart_has_the_poles_of_the_table(pair):
    """A gnomonic chart shows ratios of the components of the pole, such as ux / uz.

    The pole is the axis of the relative rotation of links 3 and 1; the reference is the
    table of poles. `run_with_axodes` runs the four-bar with the given input pair.
    """
    result = run_with_axodes(pair)
    frame = result.frame().query("assembly_mode == 0 and link == '3'")
    poles = frame[["ux", "uy", "uz"]].to_numpy()
    panel = result.plot("gnomonic chart").axes[0]
    x_label = panel.get_xlabel()  # such as "x/z"
    y_label = panel.figure.get_supylabel()
    x_axis = "xyz".index(x_label[-3])
    y_axis = "xyz".index(y_label[-3])
    denominator = "xyz".index(x_label[-1])
    expected = poles[:, [x_axis, y_axis]] / poles[:, [denominator]]
    (line,) = [x for x in panel.lines if x.get_label() == "P31"]
    points = line.get_xydata()
    points = points[np.isfinite(points).all(axis=1)]
    expected = expected[np.isfinite(expected).all(axis=1)]
    assert points == pytest.approx(expected, rel=1e-9)


def test_axodes_of_several_moving_inputs_are_refused():
    """Curves that belong to the motion of one input would not roll on each other."""
    with pytest.raises(AnalysisError, match=r"one moving input.*--lock 51=VALUE"):
        sk.run("five_bar", "poles:axodes=31", samples=5)
    locked = sk.lock(sk.load("five_bar"), {"51": 60.0}, angle_unit="deg")
    sk.run(locked, "poles:axodes=31", samples=5)


def run_with_axodes(pair):
    """Run the four-bar, driven at a pair, with the axodes of links 3 and 1."""
    return sk.run(
        "four_bar", "poles:only=31,axodes=31", samples=91, block=40, input_pair=pair
    )


@dataclass(frozen=True)
class AnalysisWithoutScene(MinimalAnalysis):
    """An analysis whose column is sin q + number of the mode.

    A scene says what the figures of an analysis show. This analysis defines none, so the
    columns of its table are drawn.
    """

    name: ClassVar[str] = "bare"
    rowwise: ClassVar[bool] = True
    tables: ClassVar[tuple[Table, ...]] = (
        Table("bare", "", (SAMPLE, ASSEMBLY_MODE, INPUT, Column("v", "rad", "some angle"))),
    )

    def compute(self, batch):
        angle = np.sin(batch.q) + batch.assembly_mode
        return {"bare": with_row_columns(batch, q=batch.q, v=angle)}


def test_an_analysis_without_a_scene_has_its_columns_drawn_over_blocks():
    result = sk.run("four_bar", AnalysisWithoutScene(), samples=41, block=17)
    figures = result.plot()
    assert list(figures) == ["bare/some angle"]
    (panel,) = figures["some angle"].axes
    assert figures["some angle"].get_supylabel() == "some angle, deg"
    for mode, points in curves_by_mode(panel).items():
        assert points[:, 1] == pytest.approx(
            np.degrees(np.sin(np.radians(points[:, 0])) + mode)
        )


@dataclass(frozen=True)
class AnalysisOfTwoInputs(MinimalAnalysis):
    """An analysis with a column v, and a column for each of two inputs of a run.

    A scene says what the figures of an analysis show. This analysis defines none, so the
    columns of its table are drawn, except for the inputs.
    """

    name: ClassVar[str] = "bare"
    rowwise: ClassVar[bool] = True
    tables: ClassVar[tuple[Table, ...]] = (
        Table(
            "bare", "", (SAMPLE, ASSEMBLY_MODE, INPUTS, Column("v", "rad", "some angle"))
        ),
    )

    def compute(self, batch):
        first, second = batch.inputs.T
        columns = {"q_21": first, "q_51": second, "v": first + second}
        return {"bare": with_row_columns(batch, **columns)}


def test_inputs_are_not_drawn_as_results_if_an_analysis_has_no_scene():
    """The columns q_21 and q_51 are the inputs, so only the column v has a figure."""
    result = sk.run("five_bar", AnalysisOfTwoInputs(), samples=11)
    assert list(result.plot()) == ["bare/some angle"]


def test_an_unknown_figure_is_refused_with_those_there_are(four_bar):
    with pytest.raises(AnalysisError, match="did you mean"):
        four_bar.plot("velocity coeficients")
    with pytest.raises(AnalysisError, match="the name 'poles' matches several figures"):
        four_bar.plot("poles")
    assert "velocity coefficients" in repr(four_bar.plot())


def test_the_full_name_of_a_figure_chooses_it_even_if_it_is_the_subject_of_another():
    figures = Figures({"made/angle": lambda: "first", "angle": lambda: "second"})
    assert figures["angle"] == "second"
    assert list(figures.values()) == ["first", "second"]


def test_a_number_is_refused_as_the_name_of_a_figure(four_bar):
    with pytest.raises(AnalysisError, match="no figure 3"):
        four_bar.plot()[3]


@pytest.mark.parametrize("names", [("a/p+q", "a/p-q"), ("Ä", "Ö"), ("a/P", "a/p")])
def test_each_figure_has_a_file_of_its_own(names, tmp_path):
    paths = write_figures({name: Drawing(figsize=(1.0, 1.0)) for name in names}, tmp_path)
    assert len({path.name.lower() for path in paths}) == len(names)
    assert all(path.is_file() and path.stem for path in paths)
    # Another run replaces the same files.
    again = write_figures({name: Drawing(figsize=(1.0, 1.0)) for name in names}, tmp_path)
    assert again == paths


def test_a_name_that_is_too_long_for_a_file_is_called_too_long(tmp_path):
    with pytest.raises(OutputError, match="cannot be written: the name is too long"):
        write_figures({"a" * 300: Drawing(figsize=(1.0, 1.0))}, tmp_path)


@pytest.mark.parametrize("count", [200, 201, 399, 4000])
def test_a_limited_number_of_points_of_a_path_is_compared(count, monkeypatch):
    compared_counts = []
    quantile = np.quantile

    def quantile_of_distances(distances, part):
        compared_counts.append(len(distances))
        return quantile(distances, part)

    monkeypatch.setattr(coinciding_paths.np, "quantile", quantile_of_distances)
    path = np.stack([np.linspace(0.0, 1.0, count), np.zeros(count)], axis=1)
    find_coinciding_paths([path, path], size=1.0)
    assert 0 < max(compared_counts) <= coinciding_paths.MAX_COMPARED_POINTS


def dashes_of(line):
    """Return the pattern of a line: its dashes and gaps, or "-" for a full line."""
    _, pattern = line._unscaled_dash_pattern
    return "-" if pattern is None else tuple(pattern)


def test_a_path_on_another_one_is_dashed_so_that_both_are_visible(four_bar):
    """Modes of the four-bar follow one path of P42, in opposite directions; not of P31."""
    patterns = {}
    for panel in four_bar.plot("paths of the axes").axes:
        lines = [line for line in panel.lines if len(line.get_xdata()) > 2]
        patterns[panel.get_title().split(",")[0]] = [dashes_of(line) for line in lines]
    assert patterns["P31"] == ["-", "-"]
    assert patterns["P42"][0] == "-" and patterns["P42"][1] != "-"


def test_paths_coincide_as_sets_of_points_up_to_gaps_and_parts():
    """Paths that cover each other are recognized, so that all but one are drawn dashed.

    A path may have a gap, other samples, the opposite direction, or only a part of the
    other path. `position` counts a path within its group of coinciding paths; `curve_count`
    is the size of the group.
    """
    steps = np.linspace(0.0, 1.0, 40)[:, None]
    line = np.hstack([steps, steps])
    line_with_gap = np.insert(line, 20, np.nan, axis=0)
    reversed_half_of_line = 0.5 * line[::-1]
    line_apart = line + [0.0, 0.05]
    empty_path = np.empty((0, 2))
    paths = [line, line_with_gap, reversed_half_of_line, line_apart, empty_path]
    # The paths fill a frame of size 1, in which 0.05 is more than the thickness of a line.
    dashes = find_coinciding_paths(paths, size=1.0)
    assert [dash.curve_count for dash in dashes] == [3, 3, 3, 1, 1]
    assert [dash.position for dash in dashes] == [0, 1, 2, 0, 0]
    # The first path of each group is a full line, and the others are dashed.
    is_full_line = [dash.linestyle is None for dash in dashes]
    assert is_full_line == [True, False, False, True, True]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four_bar", "stephenson"])
def test_names_in_the_chart_cover_no_other_name_and_are_inside_the_panel(name):
    figure = sk.run(name, "poles", samples=61).plot("gnomonic chart")
    figure.draw_without_rendering()
    for panel in figure.axes:
        # Boxes contain space above and below letters, which may touch.
        boxes = [text.get_window_extent().padded(-0.5) for text in panel.texts]
        assert len(boxes) >= 4
        overlaps = [one.overlaps(other) for one, other in combinations(boxes, 2)]
        assert not any(overlaps)
        assert all(panel.bbox.padded(2.0).containsy(box.y0) for box in boxes)
        assert all(panel.bbox.padded(2.0).containsy(box.y1) for box in boxes)


LETTER_SIZE = 6.0
LABEL_HALF_SIZE = LETTER_SIZE * np.array([0.31 * 3 + 0.1, 0.5])
"""Half width and half height of a label of three letters, as `place_labels` estimates them:
0.31 letters for half of each letter, and a margin of 0.1 letters."""


def place_label_at_origin(**options):
    """Return the middle (2,) of the label "P31" of a point at the origin."""
    point = np.array([[[0.0, 0.0]]])
    labels_of_first_picture = place_labels(["P31"], point, LETTER_SIZE, **options)[0]
    (middle,) = labels_of_first_picture
    return middle


def test_names_avoid_curves():
    """A name covers a diagonal line through its point unless it has to avoid the line."""
    steps = np.linspace(-50.0, 50.0, 101)
    diagonal = np.stack([steps, steps], axis=1)

    def covers_diagonal(middle):
        """Return whether a point of the line is within the label about this middle."""
        return np.any(np.all(np.abs(diagonal - middle) < LABEL_HALF_SIZE, axis=1))

    assert covers_diagonal(place_label_at_origin())
    assert not covers_diagonal(place_label_at_origin(curve_points=diagonal))


def test_names_are_placed_beside_a_path_with_a_huge_outlier():
    """The part of the path outside of the panel takes no time and memory."""
    count = 50
    x = np.linspace(0.0, 360.0, count)
    y = np.sin(np.radians(x))
    y[20] = 1e12
    marks = [Mark(f"m{number}", np.array([50.0 * number, 0.5])) for number in range(7)]
    portrait = Portrait(
        "p", "p", x, y, "x", "y", (0.0, 360.0), (-1.0, 1.0), "deg", marks=marks
    )
    scene = Scene(0, (portrait,), (Axis("t", "s", np.arange(count)),), "s")
    (figure,) = plan_figures([scene], {}).values()
    (panel,) = figure.axes
    assert {text.get_text() for text in panel.texts} == {mark.label for mark in marks}


def test_two_curves_at_one_point_are_both_in_the_legend():
    point = np.array([[0.5, 0.5]])
    curves = [PlaneCurve(point, 1, "front"), PlaneCurve(point.copy(), 0, "setting")]
    at_point = point[:, 0]
    unit = (0.0, 1.0)
    portrait = Portrait("p", "p", at_point, at_point, "x", "y", unit, unit, curves=curves)
    scene = Scene("Trade", (portrait,), (Axis("t", "s", at_point),), "s")
    (figure,) = plan_figures([scene], {}).values()
    (panel,) = figure.axes
    assert panel.get_legend_handles_labels()[1] == ["front", "setting"]


def test_names_are_inside_their_frame():
    """The frame ends 5 to the right of the point, nearer than half the label is wide."""
    lower_left = np.array([-50.0, -50.0])
    upper_right = np.array([5.0, 5.0])
    middle = place_label_at_origin(frame=(lower_left, upper_right))
    assert np.all(middle + LABEL_HALF_SIZE <= upper_right)


@pytest.mark.slow
def test_titles_have_a_margin_from_the_edge_of_their_figure(four_bar):
    for name, figure in four_bar.plot().items():
        figure.draw_without_rendering()
        width, height = figure.bbox.size
        box = figure.get_tightbbox().transformed(figure.dpi_scale_trans)
        margin_px = 0.04 * figure.dpi
        assert box.x0 > margin_px and box.y0 > margin_px, name
        assert box.x1 < width - margin_px and box.y1 < height - margin_px, name


MIN_TEXT_CONTRAST = 4.5
"""Contrast that WCAG 2.1 asks of text."""


def contrast_on_dark_page(artist):
    """Return the contrast of a text or line with the dark background (WCAG 2.1)."""
    foreground = luminance(to_rgb(artist.get_color()))
    return (foreground + 0.05) / (luminance(DARK_BACKGROUND) + 0.05)


def test_a_dark_copy_can_be_read_on_a_dark_page(four_bar):
    """Texts and lines have the contrast of text, and the background is transparent."""
    dark = dark_copy(four_bar.plot("gnomonic chart"))
    assert dark.patch.get_alpha() == 0.0
    for panel in dark.axes:
        assert panel.patch.get_alpha() == 0.0
        names = [text for text in panel.texts if text.get_text()]
        curves = [line for line in panel.lines if len(line.get_xdata()) > 2]
        assert names and curves
        for artist in [panel.title, panel.xaxis.label, *names, *curves]:
            assert contrast_on_dark_page(artist) >= MIN_TEXT_CONTRAST


def test_a_dark_copy_leaves_the_figure_as_it_is(four_bar):
    """The figure keeps its colours, and its lines are those of the copy."""
    figure = four_bar.plot("gnomonic chart")
    dark = dark_copy(figure)
    for panel, dark_panel in zip(figure.axes, dark.axes, strict=True):
        assert panel.title.get_color() == style.INK
        assert panel.patch.get_alpha() is None
        for line, dark_line in zip(panel.lines, dark_panel.lines, strict=True):
            assert np.array_equal(line.get_xydata(), dark_line.get_xydata(), equal_nan=True)


def luminance(colour):
    """Return the relative luminance of WCAG 2.1 of a colour (red, green, blue)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_two_columns_of_a_table_are_drawn_with_a_curve_for_each_mode(four_bar):
    """`plot(x, y)` draws two columns of a table, with names and units on the axes.

    `four_bar` is a run of the four-bar. Each assembly mode (way to assemble the links) has
    a curve with the numbers of the table, and an entry in the legend. The file names the
    modes 0 and 1 p1 and p0.
    """
    figure = four_bar.plot("q", "theta_41")
    frame = four_bar.frame("motion", degrees=True)
    (panel,) = figure.axes
    assert (panel.get_xlabel(), figure.get_supylabel()) == ("q, deg", "theta_41, deg")
    curves = curves_by_mode(panel)
    assert sorted(curves) == [0, 1]
    for mode, points in curves.items():
        rows = frame[frame["assembly_mode"] == mode]
        assert points == pytest.approx(rows[["q", "theta_41"]].to_numpy())
    assert list(legend_of(figure)) == ["mode 0 (p1)", "mode 1 (p0)"]
    (panel,) = four_bar.plot("q", "theta_41", degrees=False).axes
    assert panel.get_xlabel() == "q, rad"
    assert panel.get_xlim() == pytest.approx((0.0, 2.0 * np.pi))


def test_rows_of_several_subjects_have_a_panel_each_unless_where_chooses_one(four_bar):
    titles = {axes.get_title() for axes in four_bar.plot("q", "velocity_coefficient").axes}
    assert titles == {
        f"link {link}, relative to {reference}"
        for link, reference in ("21", "31", "41", "32", "42", "43")
    }
    rocker = {"link": "4", "relative_to": "1"}
    figure = four_bar.plot("q", "velocity_coefficient", where=rocker)
    (panel,) = figure.axes
    frame = four_bar.frame("poles")
    is_rocker = (frame["link"] == "4") & (frame["relative_to"] == "1")
    for mode, points in curves_by_mode(panel).items():
        rows = frame[is_rocker & (frame["assembly_mode"] == mode)]
        assert points[:, 1] == pytest.approx(rows["velocity_coefficient"].to_numpy())


def test_rows_that_do_not_follow_each_other_are_points(four_bar):
    """No line joins the rows of a table without samples, or those of a grid of inputs."""
    points = four_bar.plot("q", "x", table="singularities")
    grid = sk.run("five_bar", samples=(3, 4)).plot("q_21", "theta_43")
    for figure, count in ((points, 4), (grid, 24)):
        (panel,) = figure.axes
        drawn = [line.get_xydata() for line in panel.lines if line.get_marker() == "."]
        assert 0 < sum(map(len, drawn)) <= count
        for line in panel.lines:
            if line.get_marker() == "None" and len(line.get_xdata()) > 2:
                finite = np.isfinite(line.get_ydata().astype(float))
                assert not np.any(finite[1:] & finite[:-1])


def test_an_angle_that_jumps_by_a_turn_interrupts_its_curve():
    """A curve is interrupted where its angle on the axis x jumps by a turn.

    Otherwise a line would lead back across the figure. Here the azimuth jumps from 175 to
    -180 deg, so NaN comes before the third point; the other steps are 5 deg.

    A column is declared in rad. With `degrees` the caller has converted its numbers to
    degrees before, as here.
    """
    columns = (SAMPLE, ASSEMBLY_MODE, Column("azimuth", "rad", "an angle"), INPUT)
    azimuths = [170.0, 175.0, -180.0, -175.0]  # deg
    data = {"sample": range(4), "assembly_mode": 0, "azimuth": azimuths, "q": azimuths}
    figure = draw_columns(
        Table("directions", "rows of samples", columns),
        pd.DataFrame(data),
        "azimuth",
        "sample",
        degrees=True,
        sheet=Sheet(1, {}),
    )
    (points,) = curves_by_mode(figure.axes[0]).values()
    drawn_azimuths = points[:, 0]
    assert np.isnan(drawn_azimuths[2])
    assert np.nanmax(np.abs(np.diff(drawn_azimuths))) == 5.0


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("q", "theta41"), {}, r'no column is named "theta41"; did you mean "theta_41"\?'),
        (
            ("q", "status"),
            {},
            r'"status" of the table poles has no numbers; use it in the argument where',
        ),
        (
            ("sigma", "ux"),
            {},
            r'no table has both columns: "sigma" is in relation; "ux" is',
        ),
        (("q", "ux"), {"where": {"link": "5"}}, r"no row has link = '5'\. Values: 2, 3, 4"),
        (("q", "ux"), {"where": {"lnk": "4"}}, r'no column "lnk"; did you mean "link"\?'),
        (("q", "ux"), {"where": {"link": ["3", "4"]}}, r"link is of type list; give one"),
        (("q", "ux"), {"table": "polse"}, r'no table "polse"; did you mean "poles'),
        (("q",), {"where": {"link": "4"}}, r"give the columns x and y"),
    ],
)
def test_a_figure_of_unknown_columns_is_refused(four_bar, arguments, options, message):
    with pytest.raises(AnalysisError, match=message):
        four_bar.plot(*arguments, **options)


@pytest.mark.slow
def test_run_draws_figures_into_its_folder(tmp_path, capsys):
    """`spherekit run --figures svg` writes four figures; without a folder it is refused."""
    folder = tmp_path / "out"
    arguments = [
        "run",
        "four_bar",
        "--samples",
        "19",
        "-o",
        str(folder),
        "--figures",
        "svg",
    ]
    assert main(arguments) == 0
    names = sorted(path.name for path in (folder / "figures").iterdir())
    assert "poles_velocity_coefficients.svg" in names and len(names) == 4
    assert "4 figures in" in capsys.readouterr().out
    assert main(["run", "four_bar", "--figures"]) == 1
    assert "--figures has no effect without" in capsys.readouterr().err


@pytest.mark.slow
def test_without_matplotlib_it_says_what_to_install():
    code = (
        "import sys; sys.modules['matplotlib'] = None\nimport spherekit as sk\ntry:\n    "
        "sk.run('four_bar', 'poles', samples=5).plot()\nexcept sk.SpherekitError as "
        "error:\n    print(error)\n"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert 'pip install "spherekit-mechanisms[plot]"' in out.stdout


def elements_of(text):
    """Return the names and texts of the elements of a page, which is well formed."""
    return [(x.tag, x.text) for x in ElementTree.fromstring(f"<p>{text}</p>").iter()]


def test_pages_of_notebooks_show_plan_mechanism_and_result(four_bar):
    """In notebooks, plans, mechanisms and results are shown as tables in HTML.

    `four_bar` is a run of the four-bar; `elements_of` returns the tags and texts of a page.
    The plan says how the pole (axis of relative rotation) of each two links is found. Poles
    that are not axes of pairs are found in passes, from poles that are already known.
    """
    mechanism = sk.load("four_bar")
    # The table has a row and a column for each of 4 links. The pole of links a and b is in
    # the cells (a, b) and (b, a). x: the 4 axes of pairs. I: the 2 poles found in the first
    # pass, as intersections of great circles. ■: the diagonal.
    marks = [
        text for tag, text in elements_of(sk.plan(mechanism)._repr_html_()) if tag == "td"
    ]
    assert marks.count("x") == 8 and marks.count("I") == 4 and marks.count("■") == 4
    assert (
        "p",
        "Each cell is the pole axis of two links. x: axis of a pair; I: pass that finds "
        "the pole as the intersection of great circles.",
    ) in elements_of(sk.plan(mechanism)._repr_html_())
    # The tables of pairs and links have the range of the input and the arcs in degrees.
    assert {
        ("td", "21"),
        ("td", "R (revolute)"),
        ("td", "1 and 2"),
        ("td", "input from 0 to 360 deg"),
        ("td", "41 to 21: 60"),
        ("td", "ground"),
    } <= {*elements_of(mechanism._repr_html_())}
    # Without arcs the table of links has no column of them.
    gears = elements_of(sk.load("bevel_differential")._repr_html_())
    assert ("td", "Cr (rolling contact)") in gears and ("th", "arcs (deg)") not in gears
    cells = elements_of(four_bar._repr_html_())
    frame = four_bar.frame("poles")
    assert ("caption", f"poles: {len(frame)} rows") in cells
    assert ("th", "q [rad]") in cells
    row = f"{frame['velocity_coefficient'].iloc[1]:.6g}"
    assert ("td", row) in cells
    # Findings are list items. In each of the two modes the output rests at both ends of its
    # motion: four singularities of type I.
    assert any(tag == "li" and "4 of type I" in text for tag, text in cells)


def test_names_in_pages_are_escaped():
    text = html_table(["<a>", "b"], [["<script>", "a & b"]], "<b>")
    assert "<script>" not in text and "<b>" not in text
    shown = [words for _, words in elements_of(text) if words]
    assert shown == ["<b>", "<a>", "b", "<script>", "a & b"]
