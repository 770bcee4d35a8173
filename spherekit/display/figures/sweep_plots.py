"""Figures of a sweep: each figure of merit over the varied sizes."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Axes, Figure
from spherekit.display.figures.sheet import LEGEND_KEY_IN, LEGEND_LETTER_IN, Drawing
from spherekit.errors import DesignError
from spherekit.escaping import plot_text

if TYPE_CHECKING:
    import pandas as pd

    from spherekit.designs.sweep_parts import SweepResult

PANEL_HEIGHT_IN = 2.6
"""Height of a panel (inches)."""

MAX_LINE_DESIGNS = 60
"""Number of designs up to which points are marked on the line of the first mode."""

MAX_SWEEP_LEGEND_COLUMNS = 4
"""Largest number of columns of the legend."""

MARKER_AREA_PT2 = 14.0
"""Area of the points of designs (square points)."""


def sweep_figures(result: "SweepResult", columns: int = 2) -> dict[str, Figure]:
    """Return a figure for each figure of merit of a sweep, over the varied sizes.

    A sweep evaluates many designs (choices of sizes), in each assembly mode (way to
    assemble the mechanism). A figure of merit is a number that rates a design.

    - With one varied size: a line for each assembly mode.
    - With two sizes: a panel for each assembly mode, with a colour map if the designs form
      a grid, otherwise with coloured points.
    - With more sizes: a panel for each size, with points and a colour for each assembly
      mode.

    Parameters
    ----------
    result
        The results of the sweep.
    columns
        Width of the figures, as a number of columns of a journal (1 or 2).

    Raises
    ------
    DesignError
        If no design has a numeric figure of merit.
    """
    frame = result.frame()
    designs = frame
    frame = frame[np.array(frame["status"] == "OK")]
    # A mode has the same colour in the figures of all figures of merit.
    modes = list(dict.fromkeys(frame["mode"].astype(str)))
    units: Mapping[str, str | None] = result.sweep.units()
    sizes = [variable.name for variable in result.sweep.variables]
    figures = {}
    for merit in result.sweep.merits:
        if frame[merit.name].dtype.kind != "f":
            continue  # a text, such as a type of mechanism
        rows = frame[np.isfinite(frame[merit.name].to_numpy(float))]
        if len(rows):
            with style.look():
                figures[merit.name] = _draw_merit(
                    rows, designs, merit.name, sizes, modes, units, columns
                )
    if not figures:
        raise DesignError(
            f"{result.sweep.mechanism.name}: no design has a figure of merit to draw"
        )
    return figures


def _draw_merit(
    rows: "pd.DataFrame",
    designs: "pd.DataFrame",
    merit: str,
    sizes: Sequence[str],
    modes: Sequence[str],
    units: Mapping[str, str | None],
    columns: int,
) -> Figure:
    """Draw one figure of merit of a sweep over the sizes that vary.

    Parameters
    ----------
    rows
        The rows in which the figure of merit is a number. A row is a design in one assembly
        mode.
    designs
        The rows of all designs, also of those that failed.
    merit
        Name of the column of the figure of merit.
    sizes
        The columns of the varied sizes.
    modes
        All assembly modes of the sweep. The position of a mode determines its colour.
    units
        Units of columns.
    columns
        Width in columns of a journal.
    """
    rows_by_mode = dict(list(rows.groupby(rows["mode"].astype(str), sort=False)))
    if len(sizes) == 2:
        panel_titles = [f"assembly mode {mode}" for mode in rows_by_mode]
    else:
        panel_titles = list(sizes)
    column_count = min(columns, len(panel_titles))
    row_count = -(-len(panel_titles) // column_count)
    figure = Drawing(
        figsize=(style.WIDTHS[columns], PANEL_HEIGHT_IN * row_count), layout="constrained"
    )
    grid = figure.subplots(row_count, column_count, squeeze=False)
    panels: list[Axes] = list(grid.flat)
    for unused in panels[len(panel_titles) :]:
        unused.remove()
    merit_label = _label(merit, units)
    if len(sizes) == 2:
        # All panels share the colours, so that modes can be compared.
        low, high = float(rows[merit].min()), float(rows[merit].max())
        drawn: Any = None
        for axes, title, mode_rows in zip(
            panels, panel_titles, rows_by_mode.values(), strict=False
        ):
            drawn = _draw_two_sizes(axes, mode_rows, merit, sizes, (low, high))
            axes.set(
                xlabel=_label(sizes[0], units),
                ylabel=_label(sizes[1], units),
                title=plot_text(title),
            )
        figure.colorbar(drawn, ax=panels[: len(panel_titles)], label=merit_label)
        return figure
    for axes, size in zip(panels, sizes, strict=False):
        for mode, mode_rows in rows_by_mode.items():
            number = modes.index(mode)
            look = style.page_look(number)
            ordered = mode_rows.sort_values(size)
            if len(sizes) == 1:
                line = _line_with_gaps(ordered, designs, size, merit)
                # Modes often have equal figures. Dashes let the line below be seen.
                if number > 0:
                    look["linestyle"] = "--"
                # A point without a line to a neighbour would not be seen without a marker.
                marked_points = _find_lone_points(line)
                if number == 0 and len(ordered) <= MAX_LINE_DESIGNS:
                    marked_points = list(range(len(line)))
                axes.plot(
                    *line.T,
                    marker="." if marked_points else "",
                    markevery=marked_points,
                    label=plot_text(f"assembly mode {mode}"),
                    **look,
                )
            else:
                # Points of equal figures would cover each other, so the points of each
                # further mode are larger rings.
                axes.scatter(
                    ordered[size],
                    ordered[merit],
                    s=MARKER_AREA_PT2 * (1 + 2 * number),
                    facecolors=look["color"] if number == 0 else "none",
                    edgecolors=look["color"],
                    label=plot_text(f"assembly mode {mode}"),
                )
        axes.set(xlabel=_label(size, units), ylabel=merit_label)
    handles, labels = panels[0].get_legend_handles_labels()
    entry_width = LEGEND_LETTER_IN * max(map(len, labels)) + LEGEND_KEY_IN
    legend_columns = min(MAX_SWEEP_LEGEND_COLUMNS, int(style.WIDTHS[columns] / entry_width))
    figure.legend(handles, labels, loc="outside lower center", ncols=max(1, legend_columns))
    return figure


def _line_with_gaps(
    rows: "pd.DataFrame", designs: "pd.DataFrame", size: str, merit: str
) -> Floats:
    """Return the points (n, 2) of the plot of a figure of merit over a size.

    The designs differ only in this size. The figure is NaN at designs without a row, so
    that no line is drawn across them.

    Parameters
    ----------
    rows
        The designs in one assembly mode that have the figure of merit.
    designs
        The rows of all designs, also of those that failed.
    size
        The column of the varied size.
    merit
        The column of the figure of merit.
    """
    points = rows[[size, merit]].to_numpy(float)
    missing = np.setdiff1d(designs[size].to_numpy(float), points[:, 0])
    gaps = np.stack([missing, np.full_like(missing, np.nan)], axis=1)
    points = np.concatenate([points, gaps])
    return points[np.argsort(points[:, 0], kind="stable")]


def _find_lone_points(line: Floats) -> list[int]:
    """Return the indices of the points (n, 2) that have no neighbour to draw a line to."""
    has_value = np.pad(np.isfinite(line[:, 1]), 1)
    is_lone = has_value[1:-1] & ~has_value[:-2] & ~has_value[2:]
    return np.flatnonzero(is_lone).tolist()


def _draw_two_sizes(
    axes: Axes,
    rows: "pd.DataFrame",
    merit: str,
    sizes: Sequence[str],
    limits: tuple[float, float],
) -> Any:
    """Draw a figure of merit over two varied sizes in colours.

    A figure of merit is a number that rates a design. The drawn object is returned, since
    the colour bar needs it.

    Parameters
    ----------
    axes
        The panel.
    rows
        The designs in one assembly mode (way to assemble the mechanism).
    merit
        Name of the column with the figure of merit.
    sizes
        Names of the columns with the two sizes.
    limits
        Least and largest value that colours distinguish.
    """
    look: dict[str, Any] = {
        "cmap": style.HEAT_COLOUR_MAP,
        "vmin": limits[0],
        "vmax": limits[1],
    }
    table = rows.pivot_table(index=sizes[1], columns=sizes[0], values=merit)
    # If the designs form a grid, both sizes have several values, and the designs fill most
    # cells of the table over both sizes. Half of the cells are enough here.
    is_grid = min(table.shape) > 1 and 2 * len(rows) >= table.size
    if is_grid:
        return axes.pcolormesh(
            table.columns, table.index, table.to_numpy(), shading="nearest", **look
        )
    return axes.scatter(
        rows[sizes[0]], rows[sizes[1]], c=rows[merit], s=MARKER_AREA_PT2, **look
    )


def _label(name: str, units: Mapping[str, str | None]) -> str:
    """Return the label of an axis: the name of a column with its unit."""
    unit = units.get(name)
    return plot_text(f"{name}, {unit}" if unit else name)
