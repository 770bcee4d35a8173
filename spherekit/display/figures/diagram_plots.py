"""Points that move in a plane with one scale on both axes, a panel for each mode."""

from collections.abc import Sequence

import numpy as np

from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Axes, Figure
from spherekit.display.figures.sheet import Sheet, label_outside, name_points
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import insert_gaps
from spherekit.scenes.scene import Diagram, Scene

RATIO = 0.95


FAR = 0.5
"""Steps of a path longer than this part of the frame lead through infinity."""


def draw_diagrams(items: Sequence[tuple[Scene, Diagram]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of points, each named where it starts."""
    with style.look():
        figure, panels = sheet.panels(len(items), RATIO)
        for panel, (scene, item) in zip(panels, items, strict=True):
            ranges = item.x_range, item.y_range
            panel.set(xlim=item.x_range, ylim=item.y_range, aspect="equal")
            panel.set_title(sheet.title(scene.page))
            for k, name in enumerate(item.names):
                path = item.places[:, k]
                far = np.abs(np.diff(path, axis=0)) > FAR * np.ptp(ranges, axis=1)
                look = _look(item, k) | {"label": plot_text(name)}
                panel.plot(*insert_gaps(path, np.any(far, 1)).T, **look)
        label_outside(panels, items[0][1].x_label, items[0][1].y_label)
        figure.draw_without_rendering()
        for panel, (_, item) in zip(panels, items, strict=True):
            _label(panel, item)
    return figure


def _look(item: Diagram, number: int) -> Look:
    """Return how a path is drawn: of a tone in ink, or one of its own."""
    if item.tones[number] == 0:
        return {"color": style.INK}
    return style.series_look(number - item.tones[:number].count(0))


def _label(panel: Axes, item: Diagram) -> None:
    """Name each point where its path is in the frame first, with a dot there."""
    low, high = np.transpose([item.x_range, item.y_range])
    seen = np.all((item.places >= low) & (item.places <= high), axis=2)
    shown = np.flatnonzero(seen.any(axis=0)).tolist()
    if not shown:
        return
    starts = item.places[np.argmax(seen, axis=0)[shown], shown]
    tints = [_look(item, k)["color"] for k in shown]
    for start, tint in zip(starts, tints, strict=True):
        panel.plot(*start, "o", color=tint, markersize=2.5)
    name_points(panel, [item.names[k] for k in shown], starts, tints)
