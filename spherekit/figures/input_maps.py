"""A quantity over a grid of two inputs: a map for each mode, zeros drawn as lines."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.analysis.plotted import plotted_range, scale_of
from spherekit.analysis.scene import Axis, Floats, Page, Series, titled
from spherekit.figures import style
from spherekit.figures.sdk import Axes, Figure, Normalize, ScalarMappable
from spherekit.figures.sheet import Sheet, ends, ticks_of, wrapped

SIGNED = "RdBu_r"
RATIO = 0.95
TURNED = 0.3
"""Neighbours of unlike signs that differ by more, over the range, pass no zero."""
MOST_SLICES = 3
"""Values of further inputs at which a map is drawn."""


@final
@dataclass(frozen=True)
class InputMap:
    """A series of a mode over several inputs."""

    page: Page
    series: Series
    over: tuple[Axis, ...]


def ticks(over: Sequence[Axis]) -> list[Floats] | None:
    """Return the values of each axis if the rows are a grid of them, the last quickest."""
    per_axis = [np.unique(axis.values) for axis in over]
    if any(len(values) < 2 for values in per_axis):
        return None
    if np.prod([len(values) for values in per_axis]) != len(over[0].values):
        return None
    mesh = np.meshgrid(*per_axis, indexing="ij")
    same = all(
        np.array_equal(axis.values, flat.ravel())
        for axis, flat in zip(over, mesh, strict=True)
    )
    return per_axis if same else None


def along_path(over: Sequence[Axis]) -> Axis:
    """Return how far rows are along a path of several inputs."""
    points = np.stack([axis.values for axis in over], axis=1)
    steps = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    return Axis("path of the inputs", over[0].unit, np.cumsum(steps))


def draw_maps(maps: Sequence[InputMap], sheet: Sheet) -> Figure:
    """Return a figure of one quantity over two inputs, in every mode.

    With more inputs at the first, the middle and the last value of the others.
    """
    grid = ticks(maps[0].over)
    assert grid is not None
    panels_of = [(item, at) for item in maps for at in _slices(grid[2:])]
    first = maps[0].series
    values = np.concatenate([item.series.values for item in maps])
    scale = scale_of(values, first.unit)
    low, high = plotted_range(values, scale, first.resolution, "colours")
    signed = low < 0.0 < high and np.nanmin(values) < 0.0 < np.nanmax(values)
    if signed:
        low, high = -max(-low, high), max(-low, high)
    with style.look():
        figure, panels, across = sheet.panels(len(panels_of), RATIO)
        tint = Normalize(low, high)
        colours = SIGNED if signed else style.HEAT
        for k, (panel, (input_map, at)) in enumerate(zip(panels, panels_of, strict=True)):
            shape = [len(axis) for axis in grid]
            table = np.moveaxis(input_map.series.values.reshape(shape), (0, 1), (-2, -1))[
                at
            ]
            panel.pcolormesh(
                grid[0],
                grid[1],
                table.T,
                norm=tint,
                cmap=colours,
                shading="nearest",
                rasterized=True,
            )
            if signed:
                _zeros(panel, grid[0], grid[1], table, high - low)
            panel.set_title(_title(input_map, grid, at, sheet), color=_ink(input_map.page))
            _axes(panel, input_map.over, k % across == 0, k + across >= len(panels))
        bar = figure.colorbar(
            ScalarMappable(tint, colours),
            ax=panels,
            shrink=0.8,
            pad=0.02,
            aspect=30,
            extend=ends(values, tint),
        )
        words = titled(first.group, first.unit)
        if first.label != first.group:
            words = f"{first.label}: {words}"
        bar.set_label(wrapped(words, 42))
    return figure


def _zeros(panel: Axes, x: Floats, y: Floats, table: Floats, span: float) -> None:
    """Draw where a quantity passes zero, and not where its sign is turned."""
    still = table.copy()
    for axis in (0, 1):
        step = np.diff(table, axis=axis)
        sign = np.moveaxis(np.abs(step) > TURNED * span, axis, 0)
        lines = np.moveaxis(still, axis, 0)
        lines[:-1][sign] = np.nan
        lines[1:][sign] = np.nan
    finite = still[np.isfinite(still)]
    if len(finite) and np.min(finite) < 0.0 < np.max(finite):
        panel.contour(x, y, still.T, levels=[0.0], colors=style.INK, linewidths=0.8)


def _axes(panel: Axes, over: Sequence[Axis], left: bool, bottom: bool) -> None:
    x, y = over[:2]
    panel.set_facecolor("#eeeeee")
    panel.set_box_aspect(1.0)
    ticks_of(panel, x.unit, "x", 5)
    ticks_of(panel, y.unit, "y", 5)
    if bottom:
        panel.set_xlabel(titled(x.label, x.unit))
    if left:
        panel.set_ylabel(titled(y.label, y.unit))


def _slices(rest: Sequence[Floats]) -> list[tuple[int, ...]]:
    """Return at which values of the further inputs maps are drawn."""
    chosen: list[tuple[int, ...]] = [()]
    for values in rest:
        ends = np.linspace(0, len(values) - 1, min(MOST_SLICES, len(values)))
        chosen = [(*at, k) for at in chosen for k in np.unique(np.round(ends).astype(int))]
    return chosen


def _title(
    input_map: InputMap, grid: Sequence[Floats], at: Sequence[int], sheet: Sheet
) -> str:
    words = [sheet.title(input_map.page)] if isinstance(input_map.page, int) else []
    for axis, values, k in zip(input_map.over[2:], grid[2:], at, strict=True):
        words.append(f"{axis.label} = {values[k]:.4g} {axis.unit}")
    return "\n".join(words)


def _ink(page: Page) -> Any:
    return style.mode_colour(page) if isinstance(page, int) else style.INK
