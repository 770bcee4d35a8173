"""Maps of a quantity over two inputs, one for each mode, with zeros drawn as lines."""

from collections.abc import Sequence
from itertools import product
from textwrap import fill

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.curve_plots import Curve
from spherekit.display.figures.diagram_plots import RATIO
from spherekit.display.figures.matplotlib_sdk import Axes, Figure, Normalize
from spherekit.display.figures.sheet import Sheet, colour_bar, label_outside, ticks_of
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import choose_plot_range, quantity_scale
from spherekit.scenes.scene import Axis

SIGNED = "RdBu_r"


TURNED = 0.3
"""Neighbours of unlike signs that differ by more, over the range, pass no zero."""


MOST_SLICES = 3
"""Values of further inputs at which a map is drawn."""


def ticks(over: Sequence[Axis]) -> list[Floats] | None:
    """Return the values of each axis if the rows are a grid of them, the last quickest."""
    rows = [axis.values for axis in over]
    per_axis = [np.unique(values) for values in rows]
    counts = [len(values) for values in per_axis]
    if min(counts) < 2 or np.prod(counts) != len(rows[0]):
        return None
    mesh = np.meshgrid(*per_axis, indexing="ij")
    return per_axis if np.array_equal(rows, np.reshape(mesh, np.shape(rows))) else None


def along_path(over: Sequence[Axis]) -> Axis:
    """Return how far rows are along a path of several inputs; of one, its axis."""
    if len(over) == 1:
        return over[0]
    points = np.stack([axis.values for axis in over], axis=1)
    steps = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    return Axis("path of the inputs", over[0].unit, np.cumsum(steps))


def draw_maps(maps: Sequence[Curve], sheet: Sheet) -> Figure:
    """Return a figure of one quantity over two inputs, in every mode.

    With more inputs at the first, the middle and the last value of the others.
    """
    over, first = maps[0][0].over, maps[0][1]
    grid = ticks(over)
    assert grid is not None
    ends = (np.linspace(0, len(x) - 1, min(MOST_SLICES, len(x))) for x in grid[2:])
    slices = [*product(*(np.round(end).astype(int) for end in ends))]
    values = np.concatenate([item.values for _, item in maps])
    low, high = choose_plot_range(
        values, quantity_scale(values, first.unit), first.resolution, "colours"
    )
    signed = low < 0.0 < high and np.nanmin(values) < 0.0 < np.nanmax(values)
    if signed:
        low, high = -max(-low, high), max(-low, high)
    tint, colours = Normalize(low, high), SIGNED if signed else style.HEAT
    look: Look = {"norm": tint, "cmap": colours, "rasterized": True, "shading": "nearest"}
    shape = [len(axis) for axis in grid]
    with style.look():
        figure, panels = sheet.panels(len(maps) * len(slices), RATIO)
        for panel, ((scene, item), at) in zip(panels, product(maps, slices), strict=True):
            table = np.moveaxis(item.values.reshape(shape), (0, 1), (-2, -1))[at]
            panel.pcolormesh(grid[0], grid[1], table.T, **look)
            if signed:
                _zeros(panel, grid[0], grid[1], table, high - low)
            words = [sheet.title(scene.page)] if isinstance(scene.page, int) else []
            words += [
                f"{plot_text(axis.label)} = {values_of[k]:.4g} {axis.unit}"
                for axis, values_of, k in zip(over[2:], grid[2:], at, strict=True)
            ]
            panel.set_title("\n".join(words), color=style.page_look(scene.page)["color"])
            panel.set(facecolor="#eeeeee", box_aspect=1.0)
            ticks_of(panel, over[0].unit, over[1].unit)
        label_outside(panels, over[0].words, over[1].words)
        label = "" if first.label == first.group else f"{first.label}: "
        colour_bar(figure, panels, values, tint, colours, fill(label + first.heading, 42))
    return figure


def _zeros(panel: Axes, x: Floats, y: Floats, table: Floats, span: float) -> None:
    """Draw where a quantity passes zero, and not where its sign is turned."""
    still = table.copy()
    for axis, end in product((0, 1), ("prepend", "append")):
        beyond: Look = {end: np.nan}
        still[np.abs(np.diff(table, axis=axis, **beyond)) > TURNED * span] = np.nan
    if np.any(still < 0.0) and np.any(still > 0.0):
        panel.contour(x, y, still.T, levels=[0.0], colors=style.INK, linewidths=0.8)
