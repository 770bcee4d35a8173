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

MAP_MIDDLE = np.array([0.0, 0.0, 1.0])
"""Direction at the middle of a map; directions across to it are on the rim."""
CIRCLE_ANGLES = np.linspace(0.0, 2.0 * np.pi, 49)
ZERO = np.zeros(len(CIRCLE_ANGLES))
PATHS = {
    "a great circle through the middle": np.stack(
        [np.sin(CIRCLE_ANGLES), ZERO, np.cos(CIRCLE_ANGLES)], axis=1
    ),
    "along the rim": np.stack([np.cos(CIRCLE_ANGLES), np.sin(CIRCLE_ANGLES), ZERO], axis=1),
    "along the rim, with rounding": np.stack(
        [
            np.cos(CIRCLE_ANGLES),
            np.sin(CIRCLE_ANGLES),
            1e-16 * np.cos(40.0 * CIRCLE_ANGLES),
        ],
        axis=1,
    ),
    "touching the rim": np.stack(
        [np.cos(CIRCLE_ANGLES), np.sin(CIRCLE_ANGLES), np.cos(CIRCLE_ANGLES) - 1.0], axis=1
    ),
    "from the rim inwards": np.stack(
        [np.cos(CIRCLE_ANGLES / 9), ZERO, -np.sin(CIRCLE_ANGLES / 9)], axis=1
    ),
    "inwards to the rim": np.stack(
        [np.sin(CIRCLE_ANGLES / 4), ZERO, np.cos(CIRCLE_ANGLES / 4)], axis=1
    ),
    "one sample": np.array([[1.0, 0.0, 0.0]]),
}
PATHS = {name: unit_rows(path) for name, path in PATHS.items()}
PATHS["with gaps"] = PATHS["along the rim"].copy()
PATHS["with gaps"][[0, 7, 8, -1]] = np.nan
PATHS_ALONG_RIM = (
    "along the rim",
    "along the rim, with rounding",
    "one sample",
    "with gaps",
)


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_axis_is_drawn_by_its_direction_on_the_visible_side(name, sign):
    """Of the two opposite directions of an axis, that on the visible hemisphere is drawn.

    A path has one of both directions of an axis at each sample; with the sign -1 it has the
    opposite ones. The visible hemisphere is that about the middle of the map. On its rim
    both directions are visible. Rounding may not let the path jump from one to the other
    there.
    """
    path = sign * PATHS[name]
    directions = turn_to_side(path, MAP_MIDDLE)
    is_finite = np.isfinite(path[:, 0])
    assert np.array_equal(is_finite, np.isfinite(directions[:, 0]))
    # Each drawn direction is that of the path or the opposite one.
    cosines = np.vecdot(directions, path)[is_finite]
    np.testing.assert_allclose(np.abs(cosines), 1.0, atol=1e-12)
    assert np.all(directions[is_finite] @ MAP_MIDDLE >= -1e-9)
    if name in PATHS_ALONG_RIM:
        cosines_of_steps = np.vecdot(directions[1:], directions[:-1])
        assert not np.any(cosines_of_steps < 0.0)


def test_an_axis_at_rest_on_the_rim_is_drawn_by_its_own_direction_whatever_the_rounding():
    for height in (0.0, 1e-17, -1e-17):
        path = np.tile([1.0, 0.0, height], (3, 1))
        assert np.array_equal(turn_to_side(path, MAP_MIDDLE), path)


@pytest.mark.parametrize("order", [1, -1])
def test_a_gap_before_a_part_on_the_rim_leads_to_no_jump_within_that_part(order):
    """A sample off the rim decides the direction of its neighbours up to the next gap."""
    gap = [np.nan] * 3
    on_rim = [-1.0, 0.0, 0.0]
    path = [[0.0, 0.6, 0.8], gap, on_rim, on_rim, [0.8, 0.0, 0.6], gap, on_rim, on_rim]
    expected = np.array(path)
    expected[2:4] *= -1.0
    directions = turn_to_side(np.array(path)[::order], MAP_MIDDLE)
    np.testing.assert_array_equal(directions, expected[::order])


def axes_of_panel(title):
    """Return link, reference link and middle axis of a panel titled like "P31 ... x"."""
    return title[1], title[2], title[-1]


def drawn_distances_from_middle(panel):
    """Return the distances (n,) of all drawn points of paths from the middle of a map.

    Maps have polar axes: the y data of a line are its radii. Lines of a single point are no
    paths. Gaps (NaN) are left out.
    """
    radii = [line.get_ydata() for line in panel.lines if len(line.get_ydata()) > 1]
    radii = np.concatenate(radii)
    return radii[np.isfinite(radii)]


@pytest.mark.many
@pytest.mark.parametrize("samples", [9, 37, 91])
def test_paths_of_axes_are_as_far_from_the_middle_as_the_axes(samples):
    """Each axis of the table of poles is drawn once, at the right distance from the middle.

    A pole is the axis of the relative rotation of two links. A panel shows the hemisphere
    about a coordinate axis, its middle, as an equal-area map. The expected distance is the
    radius of the map for the angle between axis and middle.
    """
    result = sk.run("four_bar", "poles", samples=samples)
    figure = result.plot("poles/paths of the axes")
    frame = result.frame("poles")
    for panel in figure.axes:
        link, reference_link, middle_axis = axes_of_panel(panel.get_title())
        is_in_panel = (frame["link"] == link) & (frame["relative_to"] == reference_link)
        # Of both directions of an axis, the one on the visible hemisphere is drawn. Its
        # component along the middle is the cosine of its angle to the middle.
        cosine = np.abs(frame[is_in_panel][f"u{middle_axis}"].to_numpy())
        cosine = cosine[np.isfinite(cosine)]
        expected = EQUAL_AREA.radius(np.arccos(np.clip(cosine, 0.0, 1.0)))
        drawn = drawn_distances_from_middle(panel)
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
    """Over a grid, magnitudes of relative angular velocities are drawn, without a sign.

    The sign of a velocity coefficient (relative rate per rate of the input) depends on the
    direction of its axis. Along a closed path over the grid, this direction can come back
    reversed. A figure of magnitudes has "|" in its name, as in "|w31/w21|", no negative
    values, and no contour line for the value zero. Axes of pairs are fixed in a link and
    keep their sign, so they have no such figure.
    """
    links = sk.load(name).links
    poles = poles or [f"{links[-1]}/{links[0]}"]
    result = sk.run(name, f"poles:only={'+'.join(poles)}", samples=grid)
    magnitude_figures = 0
    for subject, figure in result.views.figures(degrees=True, columns=2).items():
        if "velocity" not in subject or "|" not in subject:
            continue
        magnitude_figures += 1
        assert not lines_of_zeros(figure)
        for panel in figure.axes:
            for artist in panel.collections:
                array = artist.get_array() if hasattr(artist, "norm") else None
                if array is not None:
                    values = np.ma.filled(array, np.nan)
                    assert not np.any(values < 0.0)
    axes_of_pairs = {frozenset(pair.links) for pair in sk.load(name).pairs}
    are_all_pairs = all(frozenset(pole.split("/")) in axes_of_pairs for pole in poles)
    assert magnitude_figures or are_all_pairs


@pytest.mark.slow
def test_sizes_over_a_grid_are_those_of_the_angular_velocities():
    """Magnitudes of angular velocities drawn over a grid are those of `sk.evaluate`.

    They are the angular velocities of link 3 relative to link 1 over the rate of input 21.
    The derivative of a magnitude by this input is compared with a central difference.
    """
    result = sk.run("five_bar", "poles:only=3/1", samples=(7, 7))
    # The series of numbers that figures of assembly mode 0 (page 0) show, by path. A path
    # names the input that moves, 21, and the two links.
    series_by_path = {}
    for scene in result.views._collector.scenes():
        for primitive in scene.primitives:
            if isinstance(primitive, Series) and scene.page == 0:
                series_by_path[primitive.path] = (scene, primitive)
    scene, velocity = series_by_path["plots/velocity/21/3_1"]
    _, acceleration = series_by_path["plots/acceleration/21/3_1"]
    assert (velocity.label, acceleration.label) == ("|ω31/ω21|", "|ω31/ω21|′")

    def relative_speed(inputs):
        """Return the angular velocity |w31| at unit rate of input 21, the other locked."""
        row = sk.evaluate("five_bar", inputs, assembly_mode=0)
        return np.linalg.norm(row.angular_velocity("3", "21"))

    # `over` are the axes of the grid, one for each input.
    q = np.stack([axis.values for axis in scene.over], axis=1)
    step = 1e-5
    for row in np.flatnonzero(np.isfinite(velocity.values))[::5]:
        speed = relative_speed(q[row])
        assert velocity.values[row] == pytest.approx(speed, rel=1e-9)
        change = relative_speed(q[row] + [step, 0.0]) - relative_speed(q[row] - [step, 0.0])
        derivative = change / (2.0 * step)
        assert acceleration.values[row] == pytest.approx(derivative, rel=1e-5, abs=1e-6)


def test_coefficients_along_a_path_of_two_inputs_keep_their_signs():
    """Signs are continuous there, and nothing is drawn by its size."""
    result = sk.run("five_bar", "poles:only=3/1", samples=31)
    assert not any("|" in name for name in result.views.figures(True, 2))


def tilted_circle(radius, tilt=0.0):
    """Return points of a small circle (radius in rad) about z, tilted about x (rad)."""
    points = np.column_stack(
        [
            np.sin(radius) * np.cos(CIRCLE_ANGLES),
            np.sin(radius) * np.sin(CIRCLE_ANGLES),
            np.full(len(CIRCLE_ANGLES), np.cos(radius)),
        ]
    )
    c = np.cos(tilt)
    s = np.sin(tilt)
    return points @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def test_curves_on_pages_of_modes_are_drawn_for_every_mode():
    """A curve on the pages of three modes has three figures, one on a named page a fourth.

    A page is a scene for one mode (way to assemble the links). Circles of 0.2, 0.4, 0.6 and
    1 rad about the z axis, the middle of the map, are drawn. They are circles on the map,
    with the radius of an equal-area map. The sign "-" of a mode becomes a minus sign.
    """
    scenes = []
    for mode in range(3):
        curve = SphereCurves("c/x", "reach", [tilted_circle(0.2 + 0.2 * mode)])
        scenes.append(Scene(mode, (curve,), source="an"))
    border = SphereCurves("c/x", "border", [tilted_circle(1.0)])
    scenes.append(Scene("Border", (border,), source="an"))
    figures = plan_figures(scenes, {0: "Mode 0 (+)", 1: "Mode 1 (-)"})
    assert list(figures) == [
        "an/on the sphere, mode 0 (+)",
        "an/on the sphere, mode 1 (−)",
        "an/on the sphere, mode 2",
        "an/border on the sphere",
    ]
    for radius, figure in zip((0.2, 0.4, 0.6, 1.0), figures.values(), strict=True):
        (line,) = [x for x in figure.axes[0].lines if x.get_label() in ("reach", "border")]
        # Maps have polar axes, so y is the radius.
        np.testing.assert_allclose(line.get_ydata(), EQUAL_AREA.radius(radius), atol=1e-9)


def sphere_page(*parts):
    """Return a page with curves or maps of values on the sphere."""
    return Scene("Page", parts, source="analysis")


def pages_of_arrows(count):
    """Return the pages of two modes, each with the paths of this number of axes."""
    axis_of_input = (Axis("q", "rad", CIRCLE_ANGLES),)
    arrows = []
    for k in range(count):
        directions = tilted_circle(radius=1.2, tilt=0.2 * k)
        arrows.append(Arrow(f"p{k}", f"P{k}1", directions, primary=False))
    return [
        Scene(mode, tuple(arrows), over=axis_of_input, source="analysis")
        for mode in range(2)
    ]


def drawn_figures():
    """Yield groups of figures with maps of a hemisphere, to test where titles are drawn.

    They have one and two columns, legends, colours, and up to five maps. `sphere_page` and
    `pages_of_arrows` return what the figures show.
    """
    small_circle = tilted_circle(radius=0.3, tilt=0.4)
    border = SphereCurves("c", "border", [small_circle])
    # A large circle on one hemisphere, and a small one on the other, with other colours.
    border_on_both_sides = SphereCurves(
        "c",
        "border",
        [tilted_circle(radius=1.4), -small_circle],
        tone=1,
        marks=[Mark("a mark with a long name", np.array([0.0, 0.6, 0.8]), tone=2)],
    )
    # A map of values (here z) without triangles is drawn as coloured points.
    points = np.concatenate([tilted_circle(r) for r in (0.2, 0.5, 0.8)])
    no_triangles = np.zeros((0, 3), int)
    coloured_points = SphereMap(
        "m", "margin", points, no_triangles, values=points[:, 2], unit=""
    )
    for columns, scenes in (
        (1, [sphere_page(border)]),
        (2, [sphere_page(border)]),
        (2, [sphere_page(border_on_both_sides)]),
        (2, [sphere_page(border, coloured_points)]),
        (2, pages_of_arrows(1)),
        (1, pages_of_arrows(3)),
        (2, pages_of_arrows(5)),
    ):
        # The modes have no titles of their own.
        yield plan_figures(scenes, titles={}, columns=columns)


@pytest.mark.slow
def test_titles_of_round_panels_are_inside_their_figures():
    """Titles of maps are inside their figure, and do not cover names on the rim.

    A map is a round panel, whose rim has names of directions. `drawn_figures` has figures
    of maps only. Some maps have no title; the count at the end makes sure that titles were
    tested.
    """
    title_count = 0
    figures = [figure for group in drawn_figures() for figure in group.values()]
    for figure in figures:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        figure_box = figure.bbox.padded(0.5)
        for panel in figure.axes:
            title = panel.title
            if not title.get_text():
                continue
            title_count += 1
            title_box = title.get_window_extent(renderer)
            assert figure_box.contains(*title_box.min), title
            assert figure_box.contains(*title_box.max), title
            for name in panel.get_xticklabels():
                if name.get_text():
                    name_box = name.get_window_extent(renderer)
                    assert not name_box.overlaps(title_box), title
    assert title_count > 15


@pytest.mark.slow
def test_whole_numbers_below_zero_are_drawn_on_the_sphere():
    """Only small whole numbers, up to 12 in magnitude, have colours of their own."""
    points = np.eye(3)
    no_triangles = np.empty((0, 3), int)
    for least, has_own_colours in ((-300.0, False), (-12.0, True), (-13.0, False)):
        values = np.array([least, 0.0, 2.0])
        coloured_points = SphereMap("m", "level", points, no_triangles, values, unit="")
        (figure,) = plan_figures([sphere_page(coloured_points)], {}).values()
        figure.draw_without_rendering()
        norms = [artist.norm for panel in figure.axes[:2] for artist in panel.collections]
        assert [type(norm).__name__ == "BoundaryNorm" for norm in norms] == (
            [has_own_colours] * len(norms)
        )
