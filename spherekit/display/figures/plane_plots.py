"""Figures of one quantity against another.

Examples are input-output curves, phase portraits and singular curves.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.coinciding_paths import find_coinciding_paths
from spherekit.display.figures.matplotlib_sdk import Axes, Figure
from spherekit.display.figures.sheet import (
    Sheet,
    marker_look,
    name_points,
    set_degree_ticks,
)
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.geometry.vectors import all_finite
from spherekit.scenes.plot_layout import MAX_LEGEND_KINDS, TURN_BY_UNIT, insert_gaps
from spherekit.scenes.scene import Mark, PlaneCurve, Portrait, Scene, title_with_unit

PLANE_RATIO = 0.72
"""Height of the panel, relative to its width."""

FRAME_MARGIN_RATIO = 0.03
"""Distance of the frame from the curves, relative to their range."""

CONSTANT_MARGIN_RATIO = 0.05
"""Distance of the frame from a constant value, relative to the value or, if larger, 1."""

PlaneItem = tuple[Scene, Portrait]
"""A portrait with its scene."""


def is_path(item: PlaneItem) -> bool:
    """Return whether the rows of a portrait follow each other along one axis."""
    scene, portrait = item
    return len(portrait.x) > 1 and len(scene.over) < 2


def draw_plane(items: Sequence[PlaneItem], sheet: Sheet) -> Figure:
    """Return a figure with one panel, in which one quantity is plotted against another.

    A `Portrait` has the values of the two quantities in all samples of one assembly mode (a
    way to assemble the mechanism). If the samples follow each other along one input, the
    values are drawn as a path. A portrait may also have curves and marks that do not depend
    on the samples, such as the singular curves of a mechanism with two inputs.

    Parameters
    ----------
    items
        The portraits, all of the same two quantities, each with its scene. Usually there is
        one for each assembly mode. Curves and marks that occur in several portraits are
        drawn once.
    sheet
        Size of the figure, and titles of modes.
    """
    _, first_portrait = items[0]
    # Labels and the bytes of the points serve as keys, so that equal curves and marks
    # occur once.
    curve_by_points: dict[tuple[str, bytes], PlaneCurve] = {}
    mark_by_place: dict[tuple[str, bytes], Mark] = {}
    for _, portrait in items:
        for curve in portrait.curves:
            curve_by_points[curve.label, curve.points.tobytes()] = curve
        for mark in portrait.marks:
            mark_by_place[mark.label, mark.place.tobytes()] = mark
    marks = list(mark_by_place.values())
    # With few kinds of marks the legend names the kinds. With many kinds each mark has its
    # name beside it.
    is_named_in_legend = len({mark.label for mark in marks}) <= MAX_LEGEND_KINDS
    paths = [item for item in items if is_path(item)]
    with style.look():
        figure, (panel,) = sheet.make_panels(1, PLANE_RATIO)
        for curve in curve_by_points.values():
            look = style.tone_look(curve.tone) | {"linewidth": 0.9, "zorder": 1.5}
            if len(curve.points) == 1:  # a single point is drawn as a marker
                look = marker_look(curve.tone)
            panel.plot(*curve.points.T, label=plot_text(curve.label), **look)
        lines = [_path_line(portrait) for _, portrait in paths]
        # Paths are compared in units of the frame, whose two axes have different units.
        ranges = np.array([first_portrait.x_range, first_portrait.y_range])
        frame_size = np.maximum(np.diff(ranges, axis=1)[:, 0], np.finfo(float).tiny)
        dashes = find_coinciding_paths([line / frame_size for line in lines], size=1.0)
        for (scene, portrait), line, dash in zip(paths, lines, dashes, strict=True):
            look = style.page_look(scene.page)
            if dash.linestyle is not None:
                look |= {"linestyle": dash.linestyle, "dash_capstyle": "butt"}
            look["label"] = sheet.title(scene.page) if len(paths) > 1 else ""
            _draw_path(panel, line, look, has_start_dot=not portrait.curves)
        for mark in marks:
            label = plot_text(mark.label) if is_named_in_legend else ""
            look = marker_look(mark.tone) | {"label": label}
            panel.plot(*mark.place, zorder=4.0, **look)
        _set_frame(panel, first_portrait)
        # Without paths, two quantities of one unit, such as two inputs, have axes of the
        # same scale.
        has_one_unit = first_portrait.x_unit == first_portrait.y_unit
        if not paths and has_one_unit and not first_portrait.logarithmic:
            panel.set_aspect("equal")
        sheet.add_legend(figure)
        if not is_named_in_legend:
            figure.draw_without_rendering()  # makes the layout, in which names are placed
            places = np.array([mark.place for mark in marks])
            colours = [style.tone_colour(mark.tone) for mark in marks]
            name_points(panel, [mark.label for mark in marks], places, colours)
    return figure


def _path_line(portrait: Portrait) -> Floats:
    """Return the points (n, 2) of one quantity against another along the samples.

    Rows of NaN interrupt the path where an angle jumps by a whole turn, so that no line is
    drawn there.
    """
    line = np.stack([portrait.x, portrait.y], axis=1)
    # Half a revolution or more between two rows is a jump of the angle.
    revolutions = [
        TURN_BY_UNIT.get(unit, np.inf) for unit in (portrait.x_unit, portrait.y_unit)
    ]
    steps = np.abs(np.diff(line, axis=0))
    is_jump = np.any(steps >= np.multiply(0.5, revolutions), 1)
    return insert_gaps(line, is_jump)


def _draw_path(panel: Axes, line: Floats, look: Look, has_start_dot: bool) -> None:
    """Draw one quantity against another along the samples of one assembly mode.

    An assembly mode is one way to assemble the mechanism.

    Parameters
    ----------
    panel
        The panel of the figure.
    line
        (n, 2) points of the path, NaN in gaps.
    look
        Colour and dashes of the mode, and its name in the legend.
    has_start_dot
        Whether a dot marks the first point. A plot that also has fixed curves, such as
        singular curves, has no such dot, because dots mark other points in it.
    """
    panel.plot(*line.T, linewidth=1.4, zorder=2.5, **look)
    finite_points = line[all_finite(line, 1)]
    if len(finite_points) and has_start_dot:
        panel.plot(*finite_points[0], "o", color=look["color"], markersize=4.0, zorder=3.0)


def _set_frame(panel: Axes, portrait: Portrait) -> None:
    """Set ranges, names and ticks of the two axes of a panel.

    Parameters
    ----------
    panel
        The panel (axes of matplotlib).
    portrait
        The plot of one quantity against another, with ranges, labels and units. Linear axes
        get a small margin at both ends of these ranges.
    """
    x_range = portrait.x_range
    y_range = portrait.y_range
    if portrait.logarithmic:
        panel.set(xscale="log", yscale="log", axisbelow=True)
        panel.grid(True, color="#e8e8e8", linewidth=0.5)
    else:
        x_range = _widen(*x_range)
        y_range = _widen(*y_range)
    panel.set(
        xlim=x_range,
        ylim=y_range,
        xlabel=plot_text(title_with_unit(portrait.x_label, portrait.x_unit)),
        ylabel=plot_text(title_with_unit(portrait.y_label, portrait.y_unit)),
    )
    set_degree_ticks(panel, portrait.x_unit, portrait.y_unit)


def _widen(low: float, high: float) -> tuple[float, float]:
    """Return a range with a margin below and above."""
    margin = FRAME_MARGIN_RATIO * (high - low)
    margin = margin or CONSTANT_MARGIN_RATIO * max(abs(low), 1.0)
    return low - margin, high + margin
