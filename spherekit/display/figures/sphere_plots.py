"""Figures of the sphere: workspaces, curves and paths of pole axes on maps."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.display.figures import style
from spherekit.display.figures.coinciding_paths import find_coinciding_paths
from spherekit.display.figures.matplotlib_sdk import (
    Axes,
    BoundaryNorm,
    Figure,
    Normalize,
    Triangulation,
    withStroke,
)
from spherekit.display.figures.sheet import Sheet, add_colour_bar, marker_look
from spherekit.display.figures.sphere_projection import (
    EQUAL_AREA,
    HEMISPHERE_RAD,
    STEREOGRAPHIC,
    SphereView,
    directions_to_show,
    frame_about,
    opposite_frame,
    turn_to_side,
)
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.geometry.vectors import all_finite
from spherekit.scenes.plot_layout import choose_map_range, insert_gaps
from spherekit.scenes.scene import (
    Arrow,
    Scene,
    SphereCurves,
    SphereMap,
    title_with_unit,
)

CIRCLE_STEP_RAD = np.radians(30.0)
"""Angle between circles of the graticule, and the smallest rim of a map with areas."""

FINE_CIRCLE_STEP_RAD = np.radians(15.0)
"""Angle between circles of the graticule on maps of small regions; step of the rim."""

FINE_RIM_RAD = np.radians(45.0)
"""Rim up to which the graticule has the fine step."""

MAX_RIM_RAD = np.radians(120.0)
"""Largest rim. Directions farther from the centre are shown on two hemispheres.

Larger: maps reach nearer to the point opposite to their centre, where the two projections
distort most. Smaller: more figures have two hemispheres.
"""

RIM_ROUNDING_RAD = 1e-9
"""Angle by which rounding may move a direction across a rim."""

RIM_ROUNDING_STEPS = 1e-9
"""Angle by which rounding may move a direction, as a part of `FINE_CIRCLE_STEP_RAD`.

Larger: more directions that are close to a circle, but inside, get the next circle as rim.
"""

MAX_COUNTED_COLOURS = 12
"""Largest magnitude up to which whole numbers have colours of their own."""

TITLE_ABOVE_RIM_PT = 16.0
"""Distance (points) of the title of a map from its rim; less: it covers an axis name."""

GRATICULE_LOOK: Look = {"color": "#909090", "alpha": 0.55, "linewidth": 0.4}
"""Lines of the graticule."""

POLAR_PANEL: Look = {"projection": "polar", "axisbelow": "line"}
"""The kind of panel of maps. Polar axes have circles, and cut off drawings at the rim."""


def draw_sphere(
    maps: Sequence[SphereMap], curves: Sequence[SphereCurves], sheet: Sheet
) -> Figure:
    """Return a figure of quantities and curves on the sphere, in two projections.

    The equal-area and the stereographic projection are drawn side by side, as round panels.
    The middle of a panel is a ground axis (+x, -x, +y and so on): the one nearest to the
    mean direction of all areas and marks. The rim of a panel encloses all areas and marks.
    Curves are cut off at the rim. Without areas and marks, middle and rim follow from the
    points of the curves.

    If the rim would be more than `MAX_RIM_RAD` from the middle, each projection has two
    panels, one for each hemisphere.

    Parameters
    ----------
    maps
        Quantities on areas of the sphere, drawn in colours.
    curves
        Curves on the sphere, with marks.
    sheet
        Size of the figure, and titles of modes.
    """
    shown_directions = directions_to_show(maps, curves)
    frame = frame_about(shown_directions)
    angles = SphereView(frame).angles_from_centre(shown_directions)
    farthest_angle = np.max(angles, initial=0.0)
    rim = _choose_rim(farthest_angle)
    if not maps:
        # Curves without areas are drawn on at least a hemisphere. Areas may fill a smaller
        # map.
        rim = max(rim, HEMISPHERE_RAD)
    frames = [frame]
    if rim > MAX_RIM_RAD:
        rim = HEMISPHERE_RAD
        frames = [frame, opposite_frame(frame)]
    views = [  # one panel each
        SphereView(view_frame, projection, rim)
        for view_frame in frames
        for projection in (EQUAL_AREA, STEREOGRAPHIC)
    ]
    with style.look():
        figure, panels = sheet.make_panels(len(views), ratio=1.0, subplot=POLAR_PANEL)
        for panel, view in zip(panels, views, strict=True):
            title = f"{view.projection.name}, about {view.centre_name}"
            _draw_graticule(panel, view, title)
            for sphere_curves in curves:
                _draw_sphere_curves(panel, view, sphere_curves)
        if maps:
            _draw_sphere_maps(figure, panels, views, maps)
        return sheet.add_legend(figure)


def _choose_rim(farthest_angle: float) -> float:
    """Return the angle (rad) from the centre of a map to its rim.

    The rim is one of the circles of the grid, and contains all directions to be shown. If
    the farthest direction is on a circle, the next larger circle is the rim, so that
    rounding has no effect.

    Parameters
    ----------
    farthest_angle
        Angle (rad) from the centre to the farthest direction.
    """
    steps_to_rim = np.ceil(farthest_angle / FINE_CIRCLE_STEP_RAD + RIM_ROUNDING_STEPS)
    return max(CIRCLE_STEP_RAD, FINE_CIRCLE_STEP_RAD * steps_to_rim)


def draw_paths(arrows: Sequence[tuple[Scene, Arrow]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of axes on the sphere.

    There is a panel for each axis and a colour for each assembly mode (way to assemble the
    mechanism). All panels show the same hemisphere. An axis that leaves this hemisphere is
    drawn by the opposite direction.

    Parameters
    ----------
    arrows
        The directions of axes over the samples, with the scene of the mode. The page of the
        scene is the number of the mode.
    sheet
        Size of the figure, and titles of modes.
    """
    labels = list(dict.fromkeys(arrow.label for _, arrow in arrows))
    has_several_modes = len({scene.page for scene, _ in arrows}) > 1
    view = _choose_hemisphere([arrow for _, arrow in arrows])
    with style.look():
        # The map is a circle, and its title needs some height.
        figure, panels = sheet.make_panels(len(labels), ratio=1.05, subplot=POLAR_PANEL)
        panel_by_label = dict(zip(labels, panels, strict=True))
        for label, panel in panel_by_label.items():
            title = f"{plot_text(label)}, about {view.centre_name}"
            _draw_graticule(panel, view, title)
        for label, panel in panel_by_label.items():
            panel_arrows = [
                (scene, arrow) for scene, arrow in arrows if arrow.label == label
            ]
            paths = [_visible_path(arrow, view) for _, arrow in panel_arrows]
            # Paths that coincide get different dashes, so that all are visible. The figure
            # has the size 2, the diameter of the unit sphere.
            dashes = find_coinciding_paths(paths, size=2.0)
            for (scene, _), path, dash in zip(panel_arrows, paths, dashes, strict=True):
                look = style.page_look(scene.page)
                if dash.linestyle is not None:
                    look |= {"linestyle": dash.linestyle, "dash_capstyle": "butt"}
                look["label"] = sheet.title(scene.page) if has_several_modes else ""
                _draw_path(panel, view, path, look)
        return sheet.add_legend(figure)


def _choose_hemisphere(arrows: Sequence[Arrow]) -> SphereView:
    """Return the view, along an axis of the ground, that shows the given axes best.

    The axes (directions at all samples) are drawn on a hemisphere. The middle of the
    hemisphere is the ground axis x, y or z along which the directions have the largest
    components.
    """
    directions = np.concatenate([arrow.directions for arrow in arrows])
    squared_components = np.nansum(directions**2, axis=0)
    ground_axis = np.eye(3)[np.argmax(squared_components)]
    return SphereView(frame_about(ground_axis[None]))


def _visible_path(arrow: Arrow, view: SphereView) -> Floats:
    """Return the path of an axis on the hemisphere that a map shows.

    An axis meets the sphere at two opposite points, of which one is visible. At the rim the
    path continues at the opposite point. The result (samples and gaps, 3) has a row of NaN
    at such a jump.
    """
    path = turn_to_side(arrow.directions, view.frame[2])
    is_jump = np.vecdot(path[1:], path[:-1]) < 0.0
    return insert_gaps(path, is_jump)


def _draw_path(panel: Axes, view: SphereView, path: Floats, look: Look) -> None:
    """Draw the path of an axis on a map of the sphere, with a dot at its first direction.

    Parameters
    ----------
    panel
        A polar panel.
    view
        The projection of the sphere onto this panel.
    path
        (n, 3) unit vectors of the axis at successive samples, NaN at gaps.
    look
        Colour, line style and label.
    """
    panel.plot(*view.project(path).T, **look)
    first_direction = path[all_finite(path, 1)][:1]
    first_point = view.project(first_direction)
    panel.plot(*first_point.T, "o", color=look["color"], markersize=3.0)


def _draw_graticule(panel: Any, view: SphereView, title: str) -> None:
    """Draw the grid of a map of the sphere: circles about its centre, and rays.

    The circles are labelled with their angles from the centre. Two rays name axes of the
    ground.

    Parameters
    ----------
    panel
        A polar panel.
    view
        The projection of the sphere onto this panel.
    title
        Title of the panel.
    """
    step = CIRCLE_STEP_RAD if view.rim > FINE_RIM_RAD else FINE_CIRCLE_STEP_RAD
    # The rim is drawn in any case, so no other circle may be too near to it.
    inner_angles = np.arange(step, view.rim - RIM_ROUNDING_RAD, step)
    angles = np.append(inner_angles, view.rim)
    panel.set_rgrids(
        view.radius(angles),
        [f"{angle:.0f}°" for angle in np.degrees(angles)],
        angle=-75.0,
        fontsize=6.0,
        color="#555555",
        path_effects=[withStroke(linewidth=1.5, foreground="white", alpha=0.7)],
    )
    right_name, up_name, _ = view.axis_names
    # Twelve rays. Only the rays to the right and up have names.
    ray_names = [right_name, "", "", up_name, *[""] * 8]
    panel.set_thetagrids(np.arange(0.0, 360.0, 30.0), ray_names)
    panel.tick_params(axis="x", pad=0.0)
    panel.grid(**GRATICULE_LOOK)
    panel.set(ylim=(0.0, view.radius(view.rim)))
    # A round panel is put at the top ("N") of the rectangle that it gets. In the middle of
    # a high rectangle, matplotlib's layout would reserve too little space for the title.
    panel.set_anchor("N")
    panel.set_title(title, y=1.0, pad=TITLE_ABOVE_RIM_PT)


def _choose_colour_scale(values: Floats, unit: str) -> Normalize:
    """Return the scale of the colours of values.

    Small whole numbers, such as counts of assembly modes, have a colour each. Other values
    have continuous colours.
    """
    low, high = choose_map_range(values, unit)
    are_whole = unit == "" and np.all(values == np.round(values))
    if are_whole and max(-low, high) <= MAX_COUNTED_COLOURS:
        return BoundaryNorm(np.arange(low - 0.5, high + 1.0), 256)
    return Normalize(low, high)


def _draw_sphere_maps(
    figure: Figure,
    panels: Sequence[Any],
    views: Sequence[SphereView],
    maps: Sequence[SphereMap],
) -> None:
    """Draw quantities on areas of the sphere in all panels, and a colour bar.

    Parameters
    ----------
    panels, views
        The polar panels of the figure, and the projection of the sphere onto each.
    maps
        The quantities on areas of the sphere. All have one unit.
    """
    values = np.concatenate([sphere_map.shown_values for sphere_map in maps])
    values = values[np.isfinite(values)]
    colour_scale = _choose_colour_scale(values, maps[0].unit)
    look: Look = {
        "norm": colour_scale,
        "cmap": style.HEAT_COLOUR_MAP,
        "zorder": 1.0,
        "rasterized": True,
    }
    for (panel, view), sphere_map in product(zip(panels, views, strict=True), maps):
        _draw_sphere_map(panel, view, sphere_map, look)
    colour_bar = add_colour_bar(
        figure,
        panels,
        values,
        colour_scale,
        style.HEAT_COLOUR_MAP,
        title_with_unit(maps[0].label, maps[0].unit),
    )
    # Counts have a scale of intervals (`BoundaryNorm`). The interval of a count begins half
    # a unit below it. The ticks of the bar are the counts.
    if isinstance(colour_scale, BoundaryNorm):
        whole_numbers = np.unique(np.round(colour_scale.boundaries[:-1] + 0.5))
        colour_bar.set_ticks(whole_numbers, labels=[f"{n:.0f}" for n in whole_numbers])


def _draw_sphere_map(
    panel: Any, view: SphereView, sphere_map: SphereMap, look: Look
) -> None:
    """Draw a quantity on an area of the sphere: points, or coloured triangles.

    Parameters
    ----------
    panel
        A panel with polar coordinates.
    view
        The projection of the sphere onto this panel, up to its rim.
    sphere_map
        The area: vertices with values of the quantity, and triangles if the area has any.
    look
        Colours of the values.
    """
    points = view.project(sphere_map.vertices)  # (n, 2) azimuth and radius
    if not len(sphere_map.triangles):
        panel.scatter(*points.T, c=sphere_map.values, s=7.0, linewidths=0.0, **look)
        return
    # Points far outside of the rim are NaN, and their triangles are left out. matplotlib
    # cuts triangles across the rim of the panel.
    is_projected = all_finite(points, 1)
    triangles = sphere_map.triangles[is_projected[sphere_map.triangles].all(axis=1)]
    if not len(triangles):
        return
    # matplotlib cannot shade triangles in polar coordinates.
    mesh = _cartesian_mesh(points, triangles)
    transform = _cartesian_transform(panel)
    # Values that are counts have a colour for each whole number (`BoundaryNorm`).
    are_counts = isinstance(look["norm"], BoundaryNorm)
    if are_counts:
        # A triangle has one colour, for the smallest count of its vertices.
        counts = np.min(sphere_map.values[triangles], axis=1)
        panel.tripcolor(mesh, facecolors=counts, transform=transform, **look)
    else:
        panel.tripcolor(
            mesh, sphere_map.values, shading="gouraud", transform=transform, **look
        )
    panel.grid(**GRATICULE_LOOK)  # `tripcolor` has switched the graticule off


def _cartesian_mesh(polar_points: Floats, triangles: Indices) -> Triangulation:
    """Return a mesh of triangles in Cartesian coordinates from points in polar coordinates.

    Parameters
    ----------
    polar_points
        (n, 2) azimuth (rad) and radius. Points that no triangle uses may be NaN.
    triangles
        (m, 3) indices of the corner points of each triangle.
    """
    # A `Triangulation` needs finite points, so NaN becomes zero.
    azimuth, radius = np.nan_to_num(polar_points).T
    return Triangulation(radius * np.cos(azimuth), radius * np.sin(azimuth), triangles)


def _cartesian_transform(panel: Any) -> Any:
    """Return the transform from Cartesian map coordinates to the paper in a polar panel.

    Shaded triangles need an affine transform. matplotlib transforms polar coordinates in
    four parts. The first part makes them Cartesian and is not affine. The other three parts
    are affine, and are put together here.
    """
    return panel.transProjectionAffine + panel.transWedge + panel.transAxes


def _draw_sphere_curves(panel: Axes, view: SphereView, sphere_curves: SphereCurves) -> None:
    """Draw curves on the sphere, and marks (labelled points).

    Parameters
    ----------
    panel
        A panel with polar coordinates.
    view
        The projection of the sphere onto this panel, up to its rim.
    sphere_curves
        Curves of one kind with a label and the number of a colour (`tone`), and marks.
    """
    label = sphere_curves.label
    has_curves = bool(sphere_curves.curves)
    curve_look = style.tone_look(sphere_curves.tone) | {
        "linewidth": 1.3,
        "label": plot_text(label),
    }
    for curve in sphere_curves.curves:
        panel.plot(*view.project(np.asarray(curve)).T, **curve_look)
    for mark in sphere_curves.marks:
        # The legend already has the label of the curves. A mark with the same label is not
        # drawn.
        if has_curves and mark.label == label:
            continue
        (angle,) = view.angles_from_centre(mark.place[None])
        is_on_map = angle <= view.rim + RIM_ROUNDING_RAD
        if not is_on_map:
            continue
        mark_label = mark.label
        if not has_curves and mark.label != label:
            # No curve brings the label of the marks into the legend.
            mark_label = f"{label}: {mark.label}"
        panel.plot(
            *view.project(mark.place[None])[0],
            label=plot_text(mark_label),
            zorder=4.0,
            clip_on=False,
            **marker_look(mark.tone),
        )
