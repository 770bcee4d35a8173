"""One quantity against another: input-output curves, phase portraits, singular curves."""

from collections.abc import Sequence

import numpy as np

from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Axes, Figure
from spherekit.display.figures.sheet import Sheet, name_points, spot_look, ticks_of
from spherekit.escaping import plot_text
from spherekit.geometry.vectors import all_finite
from spherekit.scenes.plot_layout import MAX_LEGEND_KINDS, TURN_BY_UNIT, insert_gaps
from spherekit.scenes.scene import Portrait, Scene, title_with_unit

RATIO = 0.72
AROUND = 0.03
Plane = tuple[Scene, Portrait]
"""A portrait of a scene."""


def is_path(plane: Plane) -> bool:
    """Return whether its rows follow each other, and are not those of a grid or single."""
    scene, portrait = plane
    return len(portrait.x) > 1 and len(scene.over) < 2


def draw_plane(planes: Sequence[Plane], sheet: Sheet) -> Figure:
    """Return one figure of a portrait in all pages: their curves, marks and rows."""
    first = planes[0][1]
    curves = {curve.points.tobytes(): curve for _, item in planes for curve in item.curves}
    marks = {
        (mark.label, mark.place.tobytes()): mark
        for _, item in planes
        for mark in item.marks
    }
    named = len({mark.label for mark in marks.values()}) <= MAX_LEGEND_KINDS
    traced = [plane for plane in planes if is_path(plane)]
    with style.look():
        figure, (panel,) = sheet.panels(1, RATIO)
        for curve in curves.values():
            look = style.tone_look(curve.tone) | {"linewidth": 0.9, "zorder": 1.5}
            if len(curve.points) == 1:
                look = spot_look(curve.tone)
            panel.plot(*curve.points.T, label=plot_text(curve.label), **look)
        for plane in traced:
            _trace(panel, *plane, sheet.title(plane[0].page) if len(traced) > 1 else "")
        for mark in marks.values():
            look = spot_look(mark.tone) | {"label": plot_text(mark.label) if named else ""}
            panel.plot(*mark.place, zorder=4.0, **look)
        _frame(panel, first)
        if not traced and first.x_unit == first.y_unit and not first.logarithmic:
            panel.set_aspect("equal")
        sheet.name(figure)
        if not named:
            figure.draw_without_rendering()
            shown = list(marks.values())
            places = np.array([mark.place for mark in shown])
            tints = [style.tone_colour(mark.tone) for mark in shown]
            name_points(panel, [mark.label for mark in shown], places, tints)
    return figure


def _trace(panel: Axes, scene: Scene, portrait: Portrait, name: str) -> None:
    """Draw the rows of a page in its colour, from a dot on."""
    line = np.stack([portrait.x, portrait.y], axis=1)
    turns = [TURN_BY_UNIT.get(unit, np.inf) for unit in (portrait.x_unit, portrait.y_unit)]
    line = insert_gaps(
        line, np.any(np.abs(np.diff(line, axis=0)) >= np.multiply(0.5, turns), 1)
    )
    look = style.page_look(scene.page)
    panel.plot(*line.T, linewidth=1.4, zorder=2.5, label=name, **look)
    finite = line[all_finite(line, 1)]
    if len(finite) and not portrait.curves:
        panel.plot(*finite[0], "o", color=look["color"], markersize=4.0, zorder=3.0)


def _frame(panel: Axes, portrait: Portrait) -> None:
    x, y = portrait.x_range, portrait.y_range
    if portrait.logarithmic:
        panel.set(xscale="log", yscale="log", axisbelow=True)
        panel.grid(True, color="#e8e8e8", linewidth=0.5)
    else:
        x, y = (
            (low - around, high + around)
            for low, high in (x, y)
            for around in [AROUND * (high - low) or 0.05 * max(abs(low), 1.0)]
        )
    panel.set(
        xlim=x,
        ylim=y,
        xlabel=plot_text(title_with_unit(portrait.x_label, portrait.x_unit)),
        ylabel=plot_text(title_with_unit(portrait.y_label, portrait.y_unit)),
    )
    ticks_of(panel, portrait.x_unit, portrait.y_unit)
