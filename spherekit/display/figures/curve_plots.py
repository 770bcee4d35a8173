"""Figures of quantities over one axis: an input, the time, or a quantity of an analysis."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.display.figures import style
from spherekit.display.figures.coinciding_paths import (
    COINCIDING_QUANTILE,
    COINCIDING_RATIO,
    DashPosition,
    dash_positions,
)
from spherekit.display.figures.matplotlib_sdk import Axes, Figure
from spherekit.display.figures.sheet import (
    Sheet,
    label_shared_axes,
    marker_look,
    set_degree_ticks,
)
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import (
    TURN_BY_UNIT,
    break_at_jumps,
    choose_plot_range,
    quantity_scale,
)
from spherekit.scenes.scene import InputMarks, Page, Scene, Series
from spherekit.tables.column_units import format_unit

MAX_CURVES_PER_PANEL = 7
"""Largest number of quantities of one mode that share a panel."""

PANEL_RATIO = 0.68
"""Height of a panel, relative to its width."""

RULE_LOOK: Look = {"linestyle": (0, (1, 1.5)), "linewidth": 0.8, "zorder": 1.0}
"""Vertical lines at marked inputs."""

Curve = tuple[Scene, Series]
"""A series of a scene, over one axis."""


def draw_curves(
    marks: Sequence[tuple[Page, InputMarks]], curves: Sequence[Curve], sheet: Sheet
) -> Figure:
    """Return a figure of curves of one unit, in a panel for each label.

    A series has a number for each sample, and is drawn as a curve. The label of a series
    names the quantity. A page shows one assembly mode (way to assemble the mechanism), or
    one analysis.

    - With several pages, each label has a panel. Each page has a colour and dashes of its
      own, and the legend names the pages.
    - With one page and few labels, all curves share one panel. Each label has a colour and
      dashes of its own, and the legend names the labels if there are several.
    - With one page and many labels, each label has a panel, and there is no legend.

    Parameters
    ----------
    marks
        Marked inputs, with the pages on which they are.
    curves
        For each curve two objects: its scene, which has the axis and the page, and its
        series of numbers over the axis.
    sheet
        Size of the figure, and titles of pages.
    """
    # With one page and few labels, the only panel has no title.
    labels = list(dict.fromkeys(series.label for _, series in curves))
    has_several_pages = len({scene.page for scene, _ in curves}) > 1
    share_panel = not has_several_pages and len(labels) <= MAX_CURVES_PER_PANEL
    titles = [""] if share_panel else labels
    first_scene, first_series = curves[0]
    # The only axis over which the samples of all curves run.
    axis = first_scene.over[0]
    all_values = np.concatenate([series.values for _, series in curves])
    scale = quantity_scale(all_values, first_series.unit)
    with style.look():
        longest_title = max(map(len, titles))
        figure, panels = sheet.make_panels(len(titles), PANEL_RATIO, longest_title)
        for panel, title in zip(panels, titles, strict=True):
            panel_curves = [
                (scene, series)
                for scene, series in curves
                if share_panel or series.label == title
            ]
            # A look has the keywords of matplotlib for a line: colour, dashes and label.
            looks: list[Look] = []
            for scene, series in panel_curves:
                look = style.page_look(scene.page)
                look["label"] = sheet.title(scene.page) if has_several_pages else ""
                if share_panel and len(labels) > 1:
                    # Colour and dashes distinguish the labels instead of the pages.
                    look |= style.series_look(labels.index(series.label))
                    look["label"] = plot_text(series.label)
                looks.append(look)
            _draw_panel(panel, panel_curves, scale, looks)
            for (page, input_marks), curve in product(marks, panel_curves):
                curve_scene, _ = curve
                if curve_scene.page == page:
                    _draw_marks(panel, curve, input_marks)
            panel.set_title(plot_text(title) if len(titles) > 1 else "")
        x_label = axis.words
        y_label = first_series.heading
        label_shared_axes(panels, x_label, y_label)
        return sheet.add_legend(figure)


def _draw_panel(
    panel: Axes, curves: Sequence[Curve], scale: float, looks: Sequence[Look]
) -> None:
    """Draw curves in a panel, and set the ranges and ticks of its axes.

    Parameters
    ----------
    panel
        The panel (axes of matplotlib).
    curves
        For each curve its scene, which has the values on the horizontal axis, and its
        series, which has the values on the vertical axis. All series have one unit.
    scale
        Largest magnitude of all values in the figure. Rounding errors are this magnitude
        times `resolution`, the relative error of a series.
    looks
        For each curve the colour, line style and label. Coinciding curves are drawn with
        other line styles.
    """
    first_scene, first_series = curves[0]
    # The quantity over which all curves are plotted, such as an input.
    axis = first_scene.over[0]
    unit = first_series.unit
    resolution = max(series.resolution for _, series in curves)
    all_values = np.concatenate([series.values for _, series in curves])
    value_range = choose_plot_range(all_values, scale, resolution)
    low, high = value_range

    dashes = _find_coinciding([series.values for _, series in curves], high - low)
    for curve, dash, look in zip(curves, dashes, looks, strict=True):
        dashed_look = look
        if dash.linestyle is not None:
            dashed_look = look | {"linestyle": dash.linestyle}
        _draw_curve(panel, curve, value_range, dashed_look)
    # Curves that differ from a constant by rounding errors only look like horizontal lines.
    # A note states by how much their values differ.
    _note_spread_of_rounding(panel, all_values, rounding=resolution * scale, unit=unit)

    start, end = axis.extent
    if start < end:
        panel.set_xlim(start, end)
    panel.set_ylim(low, high)
    set_degree_ticks(panel, axis.unit, unit)
    if low < 0.0 < high:
        panel.axhline(0.0, color=style.FAINT, linewidth=0.6, zorder=0.5)


def _draw_curve(
    panel: Axes, curve: Curve, value_range: tuple[float, float], look: Look
) -> None:
    """Draw a curve of a quantity over an axis in a panel.

    Jumps of angles by a whole turn become gaps. A value between missing values is drawn as
    a dot.

    Parameters
    ----------
    panel
        The panel of the figure.
    curve
        A scene, which has the values on the horizontal axis, and a series, which has those
        on the vertical axis.
    value_range
        Lowest and highest value in the panel.
    look
        Colour, line style and label. A curve without any value has no label.
    """
    scene, series = curve
    has_value = np.isfinite(series.values)
    if not has_value.any():
        look = look | {"label": ""}
    points = np.stack([scene.over[0].values, series.values], axis=1)
    line = break_at_jumps(points, value_range, TURN_BY_UNIT.get(series.unit))
    panel.plot(*line.T, dash_capstyle="butt", **look)
    lone_points = points[_has_no_neighbour(has_value)]
    panel.plot(*lone_points.T, ".", color=look["color"], markersize=3.0)


def _has_no_neighbour(has_value: Bools) -> Bools:
    """Return a mask (n,) of the samples with a value that have no neighbour with a value.

    A line connects at least two values. A single value would not be visible in a line, so a
    point is drawn.
    """
    value_before = np.zeros_like(has_value)
    value_before[1:] = has_value[:-1]
    value_after = np.zeros_like(has_value)
    value_after[:-1] = has_value[1:]
    return has_value & ~value_before & ~value_after


def _note_spread_of_rounding(
    panel: Axes, values: Floats, rounding: float, unit: str
) -> None:
    """Write into a panel how much values differ, if they differ by rounding only.

    Such curves look like straight horizontal lines, although the values vary a little.

    Parameters
    ----------
    panel
        The panel of the figure.
    values
        All values in the panel, which may be NaN.
    rounding
        Largest difference that counts as rounding.
    unit
        Unit of the values.
    """
    finite_values = values[np.isfinite(values)]
    spread = np.ptp(finite_values) if len(finite_values) else 0.0
    if 0.0 < spread <= rounding:
        spread_text = f"{spread:.0e} {format_unit(unit)}".strip()
        corner: Look = {"xycoords": "axes fraction", "ha": "right", "va": "top"}
        panel.annotate(f"all within {spread_text}", (0.98, 0.95), fontsize=6.5, **corner)


def _draw_marks(panel: Axes, curve: Curve, input_marks: InputMarks) -> None:
    """Draw marks at inputs, such as singular ones, on a curve.

    If the curve has no value or a gap at the input, or a value outside the frame, a
    vertical line is drawn.

    Parameters
    ----------
    panel
        The panel, whose ranges are set.
    curve
        A scene, which has the values on the horizontal axis, and a series, which has those
        on the vertical axis.
    input_marks
        The inputs, their label, and the number of their colour (`tone`).
    """
    left, right = panel.get_xlim()
    low, high = panel.get_ylim()
    scene, series = curve
    # The marks are inputs of the only axis of the scene.
    axis_values = scene.over[0].values
    points = np.stack([axis_values, series.values], axis=1)[np.argsort(axis_values)]
    # In each gap of the curve, `break_at_jumps` inserts a point whose two coordinates are
    # NaN. It gets an abscissa halfway between its neighbours, because `np.interp` needs
    # abscissas that are numbers. Its ordinate stays NaN, so values in the gap become NaN.
    line = break_at_jumps(points, (low, high), TURN_BY_UNIT.get(series.unit))
    gaps = np.flatnonzero(np.isnan(line).all(axis=1))
    gaps = gaps[(gaps > 0) & (gaps < len(line) - 1)]
    line[gaps, 0] = 0.5 * (line[gaps - 1, 0] + line[gaps + 1, 0])
    # All marks have one label. The legend shows it once.
    label = plot_text(input_marks.label)
    for position in input_marks.inputs[:, 0]:
        if not left <= position <= right:
            continue
        value = np.interp(position, line[:, 0], line[:, 1], left=np.nan, right=np.nan)
        if low <= value <= high:
            # With a zorder above 2, the zorder of lines, the marker covers the curve.
            look = marker_look(input_marks.tone) | {"label": label}
            panel.plot([position], [value], zorder=4.0, **look)
        else:
            look = style.tone_look(input_marks.tone) | RULE_LOOK | {"label": label}
            panel.axvline(position, **look)


def _find_coinciding(values_by_curve: Sequence[Floats], span: float) -> list[DashPosition]:
    """Return for each curve its position among the curves that coincide with it.

    Curves at different positions get different dashes, so that none hides another. Two
    curves coincide if they differ by less than the thickness of a drawn line at nearly all
    rows in which both have values. The first of several coinciding curves is their leader,
    at position 0.

    Parameters
    ----------
    values_by_curve
        Values (n,) of each curve.
    span
        Height of the frame, in the unit of the values.
    """
    # For each curve so far its leader: the first curve that coincides with it, or itself.
    leaders: list[int] = []
    for curve, values in enumerate(values_by_curve):
        leader = curve
        for earlier_curve in range(curve):
            earlier_values = values_by_curve[earlier_curve]
            is_leader = leaders[earlier_curve] == earlier_curve
            if not is_leader or len(earlier_values) != len(values):
                continue
            distances = np.abs(earlier_values - values)
            distances = distances[np.isfinite(distances)]
            if not len(distances):
                continue
            if np.quantile(distances, COINCIDING_QUANTILE) < COINCIDING_RATIO * span:
                leader = earlier_curve
                break
        leaders.append(leader)
    return dash_positions(leaders)
