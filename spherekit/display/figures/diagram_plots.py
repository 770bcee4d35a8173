"""Figures of points that move in a plane with equal scales on the two axes."""

from collections.abc import Sequence

import numpy as np

from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Axes, Figure
from spherekit.display.figures.sheet import Sheet, label_shared_axes, name_points
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import insert_gaps
from spherekit.scenes.scene import Diagram, Scene

DIAGRAM_RATIO = 0.95
"""Height of a panel, relative to its width."""

INFINITE_STEP_RATIO = 0.5
"""Steps of a path that lead through infinity, relative to the frame.

Larger: a line across the frame joins the two ends of such a path; smaller: fast paths have
gaps.
"""


def draw_diagrams(items: Sequence[tuple[Scene, Diagram]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of points in a plane, each named at its start.

    An example is a gnomonic chart, with the points where axes through the centre of a
    sphere meet a tangent plane. The point of an axis that becomes parallel to the plane
    passes through infinity.

    Parameters
    ----------
    items
        A diagram for each assembly mode (way to assemble the mechanism), with its scene.
        The page of the scene is the number of the mode.
    sheet
        Size of the figure, and titles of modes.
    """
    with style.look():
        figure, panels = sheet.make_panels(len(items), DIAGRAM_RATIO)
        for panel, (scene, diagram) in zip(panels, items, strict=True):
            frame_size = np.ptp((diagram.x_range, diagram.y_range), axis=1)
            panel.set(xlim=diagram.x_range, ylim=diagram.y_range, aspect="equal")
            panel.set_title(sheet.title(scene.page))
            for point, name in enumerate(diagram.names):
                # (n, 2) x and y of the point in each sample.
                path = diagram.places[:, point]
                # A step between samples that is long relative to the frame leads through
                # infinity, so no line is drawn there.
                steps = np.abs(np.diff(path, axis=0))
                leads_through_infinity = np.any(steps > INFINITE_STEP_RATIO * frame_size, 1)
                look = _path_look(diagram, point) | {"label": plot_text(name)}
                panel.plot(*insert_gaps(path, leads_through_infinity).T, **look)
        _, first_diagram = items[0]
        label_shared_axes(panels, first_diagram.x_label, first_diagram.y_label)
        # This computes the layout. The places of names depend on it.
        figure.draw_without_rendering()
        for panel, (_, diagram) in zip(panels, items, strict=True):
            _name_starts(panel, diagram)
    return figure


def _path_look(diagram: Diagram, point: int) -> Look:
    """Return the line style of the path of a point in a plane figure, for matplotlib.

    A tone is a number that states the colour. Points of the tone 0 have the colour of text,
    and the others follow each other in a list of colours.
    """
    if diagram.tones[point] == 0:
        return {"color": style.INK}
    return style.series_look(point - diagram.tones[:point].count(0))


def _name_starts(panel: Axes, diagram: Diagram) -> None:
    """Draw a dot with a name at the place where the path of each point enters the frame."""
    low, high = np.transpose([diagram.x_range, diagram.y_range])
    # Mask (rows, points) of the points that are in the frame.
    is_inside = np.all((diagram.places >= low) & (diagram.places <= high), axis=2)
    visible_points = np.flatnonzero(is_inside.any(axis=0)).tolist()
    if not visible_points:
        return
    first_rows = np.argmax(is_inside, axis=0)[visible_points]
    starts = diagram.places[first_rows, visible_points]
    colours = [_path_look(diagram, point)["color"] for point in visible_points]
    for start, colour in zip(starts, colours, strict=True):
        panel.plot(*start, "o", color=colour, markersize=2.5)
    name_points(panel, [diagram.names[k] for k in visible_points], starts, colours)
