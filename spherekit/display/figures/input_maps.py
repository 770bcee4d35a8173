"""Maps of a quantity over two inputs, one for each mode, with zeros drawn as lines."""

from collections.abc import Sequence
from itertools import product
from textwrap import fill

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.curve_plots import Curve
from spherekit.display.figures.matplotlib_sdk import Axes, Figure, Normalize
from spherekit.display.figures.sheet import (
    Sheet,
    add_colour_bar,
    label_shared_axes,
    set_degree_ticks,
)
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import choose_plot_range, quantity_scale
from spherekit.scenes.scene import Axis

MAP_RATIO = 0.95
"""Height of a panel, relative to its width."""

SIGNED_COLOURS = "RdBu_r"
"""Colours of quantities that have positive and negative values, white at zero."""

SIGN_JUMP_RATIO = 0.3
"""Difference of neighbours of opposite signs that is a jump, relative to the range.

Larger: a line of zeros is drawn where a quantity jumps; smaller: steep zeros have no line.
"""

MAX_SLICES = 3
"""Largest number of values of each further input at which a map is drawn."""


def find_grid(axes: Sequence[Axis]) -> list[Floats] | None:
    """Return the values of each axis if samples form a grid, else None.

    In a grid, all combinations of the values occur in ascending order, and the last axis
    varies fastest. A map is drawn only over a grid.

    Parameters
    ----------
    axes
        The axes, such as inputs. Each has one value for every sample.
    """
    rows = [axis.values for axis in axes]
    values_by_axis = [np.unique(values) for values in rows]
    counts = [len(values) for values in values_by_axis]
    if min(counts) < 2 or np.prod(counts) != len(rows[0]):
        return None
    grid = np.meshgrid(*values_by_axis, indexing="ij")
    is_grid = np.array_equal(rows, np.reshape(grid, np.shape(rows)))
    return values_by_axis if is_grid else None


def path_axis(axes: Sequence[Axis]) -> Axis:
    """Return one axis for a plot over samples on a path of the inputs: the path length.

    With one input, the result is the axis of this input. With several inputs, it is the
    distance along the path in the space of the inputs.
    """
    if len(axes) == 1:
        return axes[0]
    points = np.stack([axis.values for axis in axes], axis=1)
    steps = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    return Axis("path of the inputs", axes[0].unit, np.cumsum(steps))


def draw_maps(maps: Sequence[Curve], sheet: Sheet) -> Figure:
    """Return a figure with maps of a quantity over two inputs, one for each assembly mode.

    With more than two inputs, there are maps at the first, the middle and the last value of
    each further input. If a quantity has positive and negative values, its colours are
    symmetrical about zero, and its zeros are drawn as a line.

    Parameters
    ----------
    maps
        For each mode the scene, and the series of the quantity. The rows of the series are
        a grid of the inputs.
    sheet
        Size of the figure, and titles of modes.
    """
    first_scene, first_series = maps[0]
    axes = first_scene.over
    grid = find_grid(axes)
    assert grid is not None
    # Maps are drawn at a few values of each further input. A slice (one map) is given by
    # one index for each further input.
    indices_by_input = [
        np.round(np.linspace(0, len(values) - 1, min(MAX_SLICES, len(values)))).astype(int)
        for values in grid[2:]
    ]
    slices = [*product(*indices_by_input)]
    values = np.concatenate([series.values for _, series in maps])
    scale = quantity_scale(values, first_series.unit)
    low, high = choose_plot_range(values, scale, first_series.resolution, "colours")
    has_both_signs = low < 0.0 < high and np.nanmin(values) < 0.0 < np.nanmax(values)
    if has_both_signs:
        largest = max(-low, high)
        low = -largest
        high = largest
    colour_scale = Normalize(low, high)
    colours = SIGNED_COLOURS if has_both_signs else style.HEAT_COLOUR_MAP
    look: Look = {
        "norm": colour_scale,
        "cmap": colours,
        "rasterized": True,
        "shading": "nearest",
    }
    grid_shape = [len(axis_values) for axis_values in grid]
    with style.look():
        figure, panels = sheet.make_panels(len(maps) * len(slices), MAP_RATIO)
        for panel, ((scene, series), slice_indices) in zip(
            panels, product(maps, slices), strict=True
        ):
            # The axes of the first two inputs become the last axes of the array. The
            # indices of the other inputs select one map.
            table = series.values.reshape(grid_shape)
            table = np.moveaxis(table, (0, 1), (-2, -1))[slice_indices]
            panel.pcolormesh(grid[0], grid[1], table.T, **look)
            if has_both_signs:
                _draw_zeros(panel, grid[0], grid[1], table, high - low)
            title_lines: list[str] = []
            if isinstance(scene.page, int):
                title_lines.append(sheet.title(scene.page))
            for axis, axis_values, index in zip(
                axes[2:], grid[2:], slice_indices, strict=True
            ):
                value = axis_values[index]
                title_lines.append(f"{plot_text(axis.label)} = {value:.4g} {axis.unit}")
            colour = style.page_look(scene.page)["color"]
            panel.set_title("\n".join(title_lines), color=colour)
            panel.set(facecolor="#eeeeee", box_aspect=1.0)
            set_degree_ticks(panel, axes[0].unit, axes[1].unit)
        label_shared_axes(panels, axes[0].words, axes[1].words)
        label = first_series.heading
        if first_series.label != first_series.group:
            label = f"{first_series.label}: {first_series.heading}"
        add_colour_bar(figure, panels, values, colour_scale, colours, fill(label, 42))
    return figure


def _draw_zeros(panel: Axes, x: Floats, y: Floats, table: Floats, span: float) -> None:
    """Draw the contour on which a quantity is zero, over two inputs.

    Where the quantity jumps from positive to negative, it is not zero, and no line is
    drawn.

    Parameters
    ----------
    x, y
        Values of the two inputs on the grid.
    table
        (len(x), len(y)) the quantity on the grid.
    span
        Range of the colours, in the unit of the quantity.
    """
    # Where a value jumps from one sign to the other along x or y, the values on the two
    # sides of the jump are removed (NaN).
    continuous_table = table.copy()
    # Views of the tables whose first index runs along x, then views whose first index runs
    # along y. `before` and `after` are the values on both sides of each grid step.
    for table_view, result_view in (
        (table, continuous_table),
        (table.T, continuous_table.T),
    ):
        before, after = table_view[:-1], table_view[1:]
        has_sign_change = np.sign(before) * np.sign(after) < 0.0
        jumps = has_sign_change & (np.abs(after - before) > SIGN_JUMP_RATIO * span)
        result_view[:-1][jumps] = np.nan
        result_view[1:][jumps] = np.nan
    if np.any(continuous_table < 0.0) and np.any(continuous_table > 0.0):
        panel.contour(
            x, y, continuous_table.T, levels=[0.0], colors=style.INK, linewidths=0.8
        )
