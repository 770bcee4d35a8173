"""Axes in figures: on the rim of a map, over a grid, on pages of modes; titles."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.backends.backend_agg import FigureCanvasAgg

import spherekit as sk
from spherekit.display.figures.contents import plan_figures
from spherekit.display.figures.sphere_projection import EQUAL_AREA, turn_to_side
from spherekit.geometry.vectors import unit_rows
from spherekit.scenes.scene import Arrow, Axis, Mark, Scene, Series, SphereCurves, SphereMap

OUT = np.array([0.0, 0.0, 1.0])
t = np.linspace(0.0, 2.0 * np.pi, 49)
ZERO = np.zeros(len(t))
PATHS = {
    "a great circle through the middle": np.stack([np.sin(t), ZERO, np.cos(t)], axis=1),
    "along the rim": np.stack([np.cos(t), np.sin(t), ZERO], axis=1),
    "along the rim, with rounding": np.stack(
        [np.cos(t), np.sin(t), 1e-16 * np.cos(40.0 * t)], axis=1
    ),
    "touching the rim": np.stack([np.cos(t), np.sin(t), np.cos(t) - 1.0], axis=1),
    "from the rim inwards": np.stack([np.cos(t / 9), ZERO, -np.sin(t / 9)], axis=1),
    "inwards to the rim": np.stack([np.sin(t / 4), ZERO, np.cos(t / 4)], axis=1),
    "one sample": np.array([[1.0, 0.0, 0.0]]),
}
PATHS = {name: unit_rows(path) for name, path in PATHS.items()}
PATHS["with gaps"] = PATHS["along the rim"].copy()
PATHS["with gaps"][[0, 7, 8, -1]] = np.nan
TOUCHING = ("along the rim", "along the rim, with rounding", "one sample", "with gaps")


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_an_axis_on_the_rim_is_drawn_by_a_direction_of_its_own(name, sense):
    path = sense * PATHS[name]
    turned = turn_to_side(path, OUT)
    finite = np.isfinite(path[:, 0])
    assert np.array_equal(finite, np.isfinite(turned[:, 0]))
    signs = np.vecdot(turned, path)[finite]
    np.testing.assert_allclose(np.abs(signs), 1.0, atol=1e-12)
    assert np.all(turned[finite] @ OUT >= -1e-9)
    if name in TOUCHING:
        # Along the rim alone nothing has to jump: one sign does for each stretch.
        stretch = np.flatnonzero(np.diff(finite.astype(int)))
        turns = np.vecdot(turned[1:], turned[:-1])
        assert not np.any(turns < 0.0), stretch


@pytest.mark.many
@pytest.mark.parametrize("samples", [9, 37, 91])
def test_paths_of_axes_are_as_far_from_the_middle_as_the_axes(samples):
    """P31 of the four-bar is on the rim where the crank points along an axis."""
    result = sk.run("four_bar", "poles", samples=samples)
    figure = result.plot("poles/paths of the axes")
    frame = result.frame("poles")
    for panel in figure.axes:
        title = panel.get_title()
        high, low, side = title[1], title[2], title[-1]
        rows = frame[(frame["link"] == high) & (frame["relative_to"] == low)]
        height = np.abs(rows[f"u{side}"].to_numpy())
        height = height[np.isfinite(height)]
        expected = EQUAL_AREA.radius(np.arccos(np.clip(height, 0.0, 1.0)))
        radii = [line.get_ydata() for line in panel.lines if len(line.get_ydata()) > 1]
        drawn = np.concatenate(radii)
        drawn = drawn[np.isfinite(drawn)]
        # Gaps repeat no sample, and each is drawn once.
        np.testing.assert_allclose(np.sort(drawn), np.sort(expected), atol=1e-7)


def lines_of_zeros(figure):
    """Return the lines that are drawn where maps pass zero."""
    every = (artist for panel in figure.axes for artist in panel.collections)
    return [x for x in every if type(x).__name__ == "QuadContourSet"]


@pytest.mark.parametrize(
    "name, poles, grid",
    [
        ("five_bar", ["3/1", "4/2"], (31, 31)),
        ("five_bar", ["3/1"], (6, 11)),
        pytest.param("agile_eye", None, (3, 3, 3), marks=pytest.mark.slow),
    ],
)
def test_maps_over_a_grid_draw_no_reversal_of_an_axis(name, poles, grid):
    """Sizes are those of differences of angular velocities, which have no axis to turn."""
    links = sk.load(name).links
    poles = poles or [f"{links[-1]}/{links[0]}"]
    result = sk.run(name, f"poles:only={'+'.join(poles)}", samples=grid)
    figures = result.views.figures(True, 2)
    sizes = 0
    for subject, figure in figures.items():
        if "velocity" not in subject:
            continue
        maps = [x for panel in figure.axes for x in panel.collections if hasattr(x, "norm")]
        arrays = [x.get_array() for x in maps]
        values = [np.ma.filled(x, np.nan) for x in arrays if x is not None]
        if "|" in subject:
            sizes += 1
            assert not lines_of_zeros(figure)
            assert all(np.nanmin(x) >= 0.0 for x in values if np.isfinite(x).any())
    axes_of_pairs = {frozenset(pair.links) for pair in sk.load(name).pairs}
    free = [x for x in poles if frozenset(x.split("/")) not in axes_of_pairs]
    assert sizes or not free


def test_sizes_over_a_grid_are_those_of_the_angular_velocities():
    """Against `evaluate` at the same inputs, and a central difference of the size."""
    result = sk.run("five_bar", "poles:only=3/1", samples=(7, 7))
    parts = {
        part.path: (scene, part)
        for scene in result.views._collector.scenes()
        for part in scene.primitives
        if isinstance(part, Series) and scene.page == 0
    }
    scene, velocity = parts["plots/velocity/21/3_1"]
    _, acceleration = parts["plots/acceleration/21/3_1"]
    assert (velocity.label, acceleration.label) == ("|ω31/ω21|", "|ω31/ω21|′")
    q = np.stack([axis.values for axis in scene.over], axis=1)
    rows = np.flatnonzero(np.isfinite(velocity.values))[::5]
    step = 1e-5
    for row in rows:
        size = []
        for k in (-1, 0, 1):
            here = sk.evaluate("five_bar", q[row] + [k * step, 0.0], assembly_mode=0)
            size.append(np.linalg.norm(here.angular_velocity("3", "21")[0]))
        assert velocity.values[row] == pytest.approx(size[1], rel=1e-9)
        slope = (size[2] - size[0]) / (2.0 * step)
        assert acceleration.values[row] == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_coefficients_along_a_path_of_two_inputs_keep_their_signs():
    """Signs are continuous there, and nothing is drawn by its size."""
    result = sk.run("five_bar", "poles:only=3/1", samples=31)
    assert not any("|" in name for name in result.views.figures(True, 2))


def circle(radius, tilt=0.0):
    p = np.stack([np.sin(radius) * np.cos(t), np.sin(radius) * np.sin(t)], axis=1)
    points = np.column_stack([p, np.full(len(t), np.cos(radius))])
    c, s = np.cos(tilt), np.sin(tilt)
    return points @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def test_curves_on_pages_of_modes_are_drawn_for_every_mode():
    scenes = [
        Scene(mode, (SphereCurves("c/x", "reach", [circle(0.2 + 0.2 * mode)]),), (), "an")
        for mode in range(3)
    ]
    border = SphereCurves("c/x", "border", [circle(1.0)])
    scenes.append(Scene("Border", (border,), (), "an"))
    figures = plan_figures(scenes, {0: "Mode 0 (+)", 1: "Mode 1 (-)"})
    assert list(figures) == [
        "an/on the sphere, mode 0 (+)",
        "an/on the sphere, mode 1 (−)",
        "an/on the sphere, mode 2",
        "an/border on the sphere",
    ]
    for radius, figure in zip((0.2, 0.4, 0.6, 1.0), figures.values(), strict=True):
        (line,) = [x for x in figure.axes[0].lines if x.get_label() in ("reach", "border")]
        np.testing.assert_allclose(line.get_ydata(), EQUAL_AREA.radius(radius), atol=1e-9)


def drawn_figures():
    """Yield figures with round panels: one and two columns, legends, maps, many panels."""
    narrow, wide = circle(0.3, 0.4), circle(1.4)
    marks = [Mark("a mark with a long name", np.array([0.0, 0.6, 0.8]), 2)]
    plain = SphereCurves("c", "border", [narrow])
    far = SphereCurves("c", "border", [wide, -narrow], 1, marks)
    points = np.concatenate([circle(r) for r in (0.2, 0.5, 0.8)])
    colours = SphereMap("m", "margin", points, np.zeros((0, 3), int), points[:, 2], "")
    arrows = [Arrow(f"p{k}", f"P{k}1", circle(1.2, 0.2 * k), False, True) for k in range(5)]
    axis = (Axis("q", "rad", t),)
    for columns, parts in ((1, [plain]), (2, [plain]), (2, [far]), (2, [plain, colours])):
        yield plan_figures([Scene("Page", tuple(parts), (), "an")], {}, columns=columns)
    for columns, count in ((2, 1), (1, 3), (2, 5)):
        scenes = [Scene(k, tuple(arrows[:count]), axis, "an") for k in range(2)]
        yield plan_figures(scenes, {}, columns=columns)


@pytest.mark.slow
def test_titles_of_round_panels_are_inside_their_figures():
    count = 0
    for figures in drawn_figures():
        for figure in figures.values():
            canvas = FigureCanvasAgg(figure)
            canvas.draw()
            renderer = canvas.get_renderer()
            whole = figure.bbox.padded(0.5)
            for panel in figure.axes:
                title = panel.title
                if not title.get_text():
                    continue
                count += 1
                box = title.get_window_extent(renderer)
                assert whole.contains(*box.min) and whole.contains(*box.max), title
                names = [x for x in panel.get_xticklabels() if x.get_text()]
                for name in names:
                    assert not name.get_window_extent(renderer).overlaps(box), title
    assert count > 15
