"""Figures: what is drawn is what tables say, and what is known of maps holds on them."""

import subprocess
import sys
from dataclasses import dataclass
from itertools import product
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis, with_row_columns

pytest.importorskip("matplotlib")

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.figures import style
from spherekit.display.figures.contents import plan_figures
from spherekit.display.figures.sphere_projection import (
    EQUAL_AREA,
    STEREOGRAPHIC,
    SphereView,
    frame_about,
    opposite_frame,
)
from spherekit.errors import AnalysisError
from spherekit.markup import html_table
from spherekit.scenes.plot_layout import place_labels
from spherekit.scenes.scene import Axis, Scene, Series
from spherekit.tables.table import ASSEMBLY_MODE, INPUT, SAMPLE, Column, Table

CAP = 0.4


@pytest.fixture(scope="module")
def four_bar():
    return sk.run("four_bar", ["poles", "singularities"], samples=73)


def drawn(panel):
    """Return the curves of modes in a panel: (number, points (n, 2)), by their marks."""
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
def test_curves_are_the_columns_of_the_table(four_bar):
    figure = four_bar.plot("poles/velocity coefficients")
    frame = four_bar.frame("poles")
    panels = {panel.get_title(): panel for panel in figure.axes}
    assert set(panels) == {f"ω{pole}/ω21" for pole in ("31", "41", "32", "42", "43")}
    for title, panel in panels.items():
        link, reference = title[1], title[2]
        for mode, points in drawn(panel).items():
            rows = frame[
                (frame["assembly_mode"] == mode)
                & (frame["link"] == link)
                & (frame["relative_to"] == reference)
            ]
            assert points[:, 0] == pytest.approx(np.degrees(rows["q"].to_numpy()))
            assert points[:, 1] == pytest.approx(rows["velocity_coefficient"].to_numpy())
        assert panel.get_xlim() == pytest.approx((0.0, 360.0))
    assert figure.axes[-1].get_xlabel() == "input 21, deg"
    assert figure.get_supylabel() == "velocity coefficients"
    assert four_bar.plot("acceleration coefficients").get_supylabel().endswith("1/rad")


def test_angles_are_in_radians_where_asked(four_bar):
    figure = four_bar.plot("output 4/1 against the input", degrees=False)
    (panel,) = figure.axes
    assert panel.get_xlabel() == "input 21, rad" and panel.get_ylabel() == "output 4/1, rad"
    for points in drawn(panel).values():
        assert np.nanmax(points[:, 0]) == pytest.approx(2.0 * np.pi)


def test_a_mode_has_one_colour_in_all_figures(four_bar):
    seen = {}
    for name, figure in four_bar.plot().items():
        if name.endswith("gnomonic chart"):  # of one mode
            continue
        for panel in figure.axes:
            for line in panel.lines:
                if line.get_gid():
                    seen.setdefault(line.get_gid(), set()).add(line.get_color())
        colours = legend_of(figure)
        both = {colours["mode 0 (+, p1)"], colours["mode 1 (−, p0)"]}
        assert both == set(style.MODE_COLOURS[:2])
    assert seen == {"mode 0": {style.MODE_COLOURS[0]}, "mode 1": {style.MODE_COLOURS[1]}}


@pytest.mark.slow
def test_singularities_are_marked_in_all_plots_over_the_input(four_bar):
    frame = four_bar.frame("singularities")
    places = np.degrees(np.sort(frame["q"].to_numpy()))
    backwards = np.linspace(2.0 * np.pi, 0.0, 73)[:, None]
    runs = [four_bar, sk.run("four_bar", ["poles", "singularities"], path=backwards)]
    for run, name in product(runs, ("velocity coefficients", "angles, form i")):
        for panel in run.plot(name).axes:
            spots = [
                line.get_xydata()[0] for line in panel.lines if line.get_marker() == "v"
            ]
            assert np.sort(np.array(spots)[:, 0]) == pytest.approx(places)
            curves = [
                points[np.argsort(points[:, 0])].T for points in drawn(panel).values()
            ]
            for x, y in spots:  # on the curve of a mode
                ways = [np.interp(x, *points) for points in curves]
                assert np.min(np.abs(np.array(ways) - y)) < 1e-9
    assert "type I" in legend_of(four_bar.plot("velocity coefficients"))
    (panel,) = four_bar.plot("output 4/1 against the input").axes
    spots = [line.get_xdata()[0] for line in panel.lines if len(line.get_xdata()) == 1]
    assert np.sort(spots) == pytest.approx(places, abs=0.5)


def circle(pole, angle, count=4000):
    """Return points (count, 3) at an angle from a direction."""
    pole = pole / np.linalg.norm(pole)
    across = np.cross(pole, np.eye(3)[int(np.argmin(np.abs(pole)))])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)[:, None]
    ring = np.cos(turn) * across + np.sin(turn) * np.cross(pole, across)
    return np.cos(angle) * pole + np.sin(angle) * ring


def on_paper(view, directions):
    """Return the places (n, 2) of directions right and up."""
    turn, away = view.project(directions).T
    return np.stack([away * np.cos(turn), away * np.sin(turn)], axis=1)


POLES = np.random.default_rng(1).normal(size=(6, 3))


@pytest.mark.parametrize("pole", POLES)
def test_the_lambert_map_keeps_the_area_of_a_cap(pole):
    view = SphereView(frame_about(pole[None]), EQUAL_AREA, np.pi)
    x, y = on_paper(view, circle(pole, CAP)).T
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    assert area == pytest.approx(2.0 * np.pi * (1.0 - np.cos(CAP)), rel=1e-5)


@pytest.mark.parametrize("pole", POLES)
def test_the_stereographic_map_keeps_angles_and_circles(pole):
    view = SphereView(frame_about(pole[None]), STEREOGRAPHIC, np.pi)
    u = pole / np.linalg.norm(pole)
    a = np.cross(u, [0.3, -0.8, 0.5])
    b = np.cross(u, a) + 0.7 * a
    step = 1e-6
    moved = np.stack([u + step * v for v in (a, b)] + [u - step * v for v in (a, b)])
    moved /= np.linalg.norm(moved, axis=1)[:, None]
    p = on_paper(view, moved)
    s, t = p[0] - p[2], p[1] - p[3]
    angle = np.arctan2(s[0] * t[1] - s[1] * t[0], s @ t)
    wanted = np.arctan2(u @ np.cross(a, b), a @ b)  # seen from outside: the same sense
    assert angle == pytest.approx(wanted, abs=1e-8)
    ring = on_paper(view, circle(pole, CAP))
    middle = np.mean([ring.max(axis=0), ring.min(axis=0)], axis=0)
    assert np.ptp(np.linalg.norm(ring - middle, axis=1)) < 1e-5


def test_a_centre_is_an_axis_of_the_ground_and_its_sides_point_along_others():
    for out in range(3):
        for positive in (True, False):
            frame = frame_about(np.eye(3)[[out]] * (1.0 if positive else -1.0))
            view = SphereView(frame)
            assert np.linalg.det(frame) == pytest.approx(1.0)
            right, up = ("xyz".index(name) for name in view.axis_names[:2])
            for axis, to in ((right, (1.0, 0.0)), (up, (0.0, 1.0))):
                place = on_paper(view, np.eye(3)[[axis]])[0]
                assert place == pytest.approx(np.sqrt(2.0) * np.array(to))
            assert np.array_equal(opposite_frame(opposite_frame(frame)), frame)


def series(values, unit="rad", label="a", group="angle"):
    return Series(f"plots/{label}", label, group, np.asarray(values, float), unit)


def one_figure(primitives, over, page=0):
    scene = Scene(page, tuple(primitives), over, "made")
    (figure,) = plan_figures([scene], {0: "Mode 0"}).values()
    return figure


OVER = (Axis("input", "rad", np.linspace(0.0, 1.0, 50)),)


def test_rounding_noise_is_not_scaled_up():
    noise = 1e-15 * np.random.default_rng(0).normal(size=50)
    (panel,) = one_figure([series(0.3 + noise)], OVER).axes
    low, high = panel.get_ylim()
    assert low < np.degrees(0.3) < high and high - low > 1.0
    (panel,) = one_figure([series(3e-5 * np.sin(OVER[0].values), "N m")], OVER).axes
    assert panel.get_ylim()[1] < 4e-5


def test_a_pole_of_a_curve_is_a_gap_and_leaves_the_frame():
    x = np.linspace(-1.0, 1.0, 100)
    over = (Axis("input", "", x),)
    (panel,) = one_figure([series(1e-3 / x + x, "")], over).axes
    (points,) = drawn(panel).values()
    assert np.sum(np.isnan(points[:, 1])) == 0
    (panel,) = one_figure([series(1.0 / x**3, "")], over).axes
    (points,) = drawn(panel).values()
    low, high = panel.get_ylim()
    (gap,) = np.nonzero(np.isnan(points[:, 1]))
    assert len(gap) == 1 and points[gap[0] - 1, 1] < low < high < points[gap[0] + 1, 1]


def test_a_grid_of_inputs_is_a_map_with_its_zeros():
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(1.0, 3.0, 5), indexing="ij")
    over = (Axis("left", "rad", a.ravel()), Axis("right", "rad", b.ravel()))
    values = (a - 0.3).ravel()
    panel, bar = one_figure([series(values, "", "c", "c")], over).axes
    (mesh,) = [each for each in panel.collections if each.get_array() is not None][:1]
    assert np.asarray(mesh.get_array()).reshape(5, 6) == pytest.approx((a - 0.3).T)
    assert mesh.norm.vmin == -mesh.norm.vmax  # so that zero has the colour between
    assert panel.get_xlabel() == "left, deg"
    assert panel.figure.get_supylabel() == "right, deg"
    zeros = [p.vertices for each in panel.collections[1:] for p in each.get_paths()]
    assert np.concatenate(zeros)[:, 0] == pytest.approx(np.degrees(0.3))
    assert bar.get_ylabel() == "c"
    (panel,) = one_figure(
        [series(values, "", "c", "c")],
        tuple(Axis(axis.label, axis.unit, np.sort(axis.values)) for axis in over),
    ).axes
    assert panel.get_xlabel() == "path of the inputs, deg"


def test_labels_of_crowded_points_do_not_cover_each_other():
    places = np.random.default_rng(3).uniform(0.0, 100.0, (5, 12, 2))
    places[2, 4] = np.nan
    found = place_labels(["ab"] * 12, places, 6.0)
    gaps = np.abs(found[:, :, None] - found[:, None])
    apart = (gaps[..., 0] > 4.0) | (gaps[..., 1] > 5.9) | np.isnan(gaps[..., 0])
    assert np.all(apart | np.eye(12, dtype=bool))
    assert np.array_equal(np.isnan(found), np.isnan(places))
    assert np.nanmax(np.linalg.norm(found - places, axis=2)) < 6.0 * 4.5
    assert np.array_equal(found[3], place_labels(["ab"] * 12, places[3:4], 6.0)[0])


@pytest.mark.many
@pytest.mark.parametrize("pair", ["21", "41"])
def test_axodes_touch_and_the_gnomonic_chart_has_the_poles(pair):
    """Driven at 41 no mode has a configuration at the first samples."""
    options = {"samples": 91, "block": 40, "input_pair": pair}
    result = sk.run("four_bar", "poles:only=31,axodes=31", **options)
    first = np.argmax(np.isfinite(result.frame("poles")["ux"].to_numpy()))
    for mode in ("0 (+, p1)", "1 (\u2212, p0)"):
        figure = result.plot(f"axodes, mode {mode if pair == '21' else mode[:4] + ')'}")
        fixed, moving = legend_of(figure)
        assert (fixed, moving) == ("fixed axode of P31", "moving axode of P31")
        lines = [[x.get_xydata() for x in panel.lines] for panel in figure.axes]
        starts = [np.array([x[first] for x in each if len(x) == 91]) for each in lines]
        seen = [each.T for each in starts if np.isfinite(each).all()]
        assert seen and all(each.shape == (2, 2) for each in seen)
        assert all(abs(np.diff(r * np.exp(1j * turn))[0]) < 1e-9 for turn, r in seen)
    frame = result.frame().query("assembly_mode == 0 and link == '3'")
    u = frame[["ux", "uy", "uz"]].to_numpy()
    panel = result.plot("gnomonic chart").axes[0]
    words = panel.get_xlabel(), panel.figure.get_supylabel()
    axes = ["xyz".index(each) for each in (words[0][-1], words[0][-3], words[1][-3])]
    expected = u[:, axes[1:]] / u[:, axes[:1]]
    (line,) = [each for each in panel.lines if each.get_label() == "P31"]
    drawn = line.get_xydata()
    drawn, expected = (x[np.isfinite(x).all(axis=1)] for x in (drawn, expected))
    assert drawn == pytest.approx(expected, rel=1e-9)


@dataclass(frozen=True)
class Bare(MinimalAnalysis):
    """An analysis that says nothing of what is to be seen."""

    name: ClassVar[str] = "bare"
    rowwise: ClassVar[bool] = True
    tables: ClassVar[tuple[Table, ...]] = (
        Table("bare", "", (SAMPLE, ASSEMBLY_MODE, INPUT, Column("v", "rad", "some angle"))),
    )

    def compute(self, batch):
        some = np.sin(batch.q) + batch.assembly_mode
        return {"bare": with_row_columns(batch, q=batch.q, v=some)}


def test_an_analysis_without_a_scene_has_its_columns_drawn_over_blocks():
    result = sk.run("four_bar", Bare(), samples=41, block=17)
    figures = result.plot()
    assert list(figures) == ["bare/some angle"]
    (panel,) = figures["some angle"].axes
    assert figures["some angle"].get_supylabel() == "some angle, deg"
    for mode, points in drawn(panel).items():
        assert points[:, 1] == pytest.approx(
            np.degrees(np.sin(np.radians(points[:, 0])) + mode)
        )


def test_an_unknown_figure_is_refused_with_those_there_are(four_bar):
    with pytest.raises(AnalysisError, match="did you mean"):
        four_bar.plot("velocity coeficients")
    with pytest.raises(AnalysisError, match="several figures are meant by 'poles'"):
        four_bar.plot("poles")
    assert "velocity coefficients" in repr(four_bar.plot())


def test_run_draws_figures_into_its_folder(tmp_path, capsys):
    folder = tmp_path / "out"
    words = ["run", "four_bar", "--samples", "19", "-o", str(folder), "--figures", "svg"]
    assert main(words) == 0
    made = sorted(path.name for path in (folder / "figures").iterdir())
    assert "poles_velocity_coefficients.svg" in made and len(made) == 4
    assert "4 figures in" in capsys.readouterr().err
    assert main(["run", "four_bar", "--figures"]) == 1
    assert "--figures does nothing without" in capsys.readouterr().err


@pytest.mark.slow
def test_without_matplotlib_it_says_what_to_install():
    code = (
        "import sys; sys.modules['matplotlib'] = None\nimport spherekit as sk\ntry:\n    "
        "sk.run('four_bar', 'poles', samples=5).plot()\nexcept sk.SpherekitError as "
        "error:\n    print(error)\n"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert 'pip install "spherekit-mechanisms[plot]"' in out.stdout


def cells_of(text):
    """Return the names and texts of the elements of a page, which is well formed."""
    return [(x.tag, x.text) for x in ElementTree.fromstring(f"<p>{text}</p>").iter()]


def test_pages_of_notebooks_show_plan_mechanism_and_result(four_bar):
    made = sk.load("four_bar")
    marks = [text for tag, text in cells_of(sk.plan(made)._repr_html_()) if tag == "td"]
    assert marks.count("x") == 8 and marks.count("I") == 4 and marks.count("■") == 4
    assert {("td", "21"), ("td", "input")} <= {*cells_of(made._repr_html_())}
    cells = cells_of(four_bar._repr_html_())
    frame = four_bar.frame("poles")
    assert ("caption", f"poles: {len(frame)} rows") in cells
    assert ("th", "q [rad]") in cells
    row = f"{frame['velocity_coefficient'].iloc[1]:.6g}"
    assert ("td", row) in cells
    assert any(tag == "li" and "4 of type I" in text for tag, text in cells)


def test_names_in_pages_are_escaped():
    text = html_table(["<a>"], [["<script>", "a & b"]], "<b>")
    assert "<script>" not in text and "<b>" not in text
    shown = [words for _, words in cells_of(text) if words]
    assert shown == ["<b>", "<a>", "<script>", "a & b"]
