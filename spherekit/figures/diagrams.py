"""Points that move in a plane with one scale on both axes: their paths, a panel a mode."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from spherekit.analysis.plotted import placed_labels
from spherekit.analysis.scene import Diagram, Floats, Page
from spherekit.figures import style
from spherekit.figures.sdk import Axes, Figure
from spherekit.figures.sheet import Sheet, line_between

RATIO = 0.95
FAR = 0.5
"""Steps of a path longer than this part of the frame lead through infinity."""
LETTER = 6.5


def draw_diagrams(items: Sequence[tuple[Page, Diagram]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of points, each named where it starts."""
    with style.look():
        figure, panels, across = sheet.panels(len(items), RATIO)
        for place, (panel, (page, item)) in enumerate(zip(panels, items, strict=True)):
            panel.set_title(sheet.title(page))
            panel.set_xlim(*item.x_range)
            panel.set_ylim(*item.y_range)
            panel.set_aspect("equal")
            if place + across >= len(items):
                panel.set_xlabel(item.x_label)
            if place % across == 0:
                panel.set_ylabel(item.y_label)
            for k, name in enumerate(item.names):
                colour, dashes = _look(item, k)
                look = {"color": colour, "linestyle": dashes, "label": name}
                line_between(panel, _joined(item.places[:, k], item), look)
        figure.draw_without_rendering()
        for panel, (_, item) in zip(panels, items, strict=True):
            _label(panel, item)
    return figure


def _look(item: Diagram, number: int) -> tuple[str, Any]:
    """Return colour and dashes of a path: of a tone in ink, or one of its own."""
    tones = item.tones
    if tones[number] == 0:
        return style.INK, "-"
    return style.series_look(sum(tone != 0 for tone in tones[:number]))


def _joined(path: Floats, item: Diagram) -> Floats:
    """Return a path (n, 2) with gaps where it passes through infinity."""
    size = np.array([np.ptp(item.x_range), np.ptp(item.y_range)])
    far = np.any(np.abs(np.diff(path, axis=0)) > FAR * size, axis=1)
    return np.insert(path, np.flatnonzero(far) + 1, np.nan, axis=0)


def _label(panel: Axes, item: Diagram) -> None:
    """Name each point where its path is in the frame first, with a dot there."""
    (left, right), (low, high) = item.x_range, item.y_range
    x, y = np.moveaxis(item.places, -1, 0)
    seen = (x >= left) & (x <= right) & (y >= low) & (y <= high)
    shown = np.flatnonzero(seen.any(axis=0))
    if not len(shown):
        return
    starts = item.places[np.argmax(seen, axis=0)[shown], shown]
    figure = panel.get_figure(root=True)
    assert figure is not None
    dots = figure.dpi / 72.0
    places = panel.transData.transform(starts)
    names = [item.names[k] for k in shown.tolist()]
    middles = placed_labels(names, places[None], LETTER * dots)[0]
    for k, start, offset in zip(
        shown.tolist(), starts.tolist(), (middles - places) / dots, strict=True
    ):
        colour, _ = _look(item, k)
        panel.plot(*start, "o", color=colour, markersize=2.5)
        panel.annotate(
            item.names[k],
            start,
            xytext=offset.tolist(),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=LETTER,
            color=colour,
        )
