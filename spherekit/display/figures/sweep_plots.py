"""Figures of a sweep: each figure of merit over the varied sizes."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Axes, Figure
from spherekit.display.figures.sheet import Drawing
from spherekit.errors import DesignError
from spherekit.escaping import plot_text

if TYPE_CHECKING:
    import pandas as pd

    from spherekit.designs.sweep_parts import SweepResult

PANEL_HEIGHT_IN = 2.6
"""Height of a panel (inches)."""

MAX_LINE_DESIGNS = 60
"""Number of designs up to which points are marked on a line."""

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
    frame = frame[np.array(frame["status"] == "OK")]
    units: Mapping[str, str | None] = result.sweep.units()
    sizes = [variable.name for variable in result.sweep.variables]
    figures = {}
    for merit in result.sweep.merits:
        if frame[merit.name].dtype.kind != "f":
            continue  # a text, such as a type of mechanism
        rows = frame[np.isfinite(frame[merit.name].to_numpy(float))]
        if len(rows):
            with style.look():
                figures[merit.name] = _draw_merit(rows, merit.name, sizes, units, columns)
    if not figures:
        raise DesignError(
            f"{result.sweep.mechanism.name}: no design has a figure of merit to draw"
        )
    return figures


def _draw_merit(
    rows: "pd.DataFrame",
    merit: str,
    sizes: Sequence[str],
    units: Mapping[str, str | None],
    columns: int,
) -> Figure:
    """Draw one figure of merit of a sweep over the sizes that vary.

    Parameters
    ----------
    rows
        The rows in which the figure of merit is a number. A row is a design in one assembly
        mode.
    merit
        Name of the column of the figure of merit.
    sizes
        The columns of the varied sizes.
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
        for number, (mode, mode_rows) in enumerate(rows_by_mode.items()):
            look = style.page_look(number)
            ordered = mode_rows.sort_values(size)
            if len(sizes) == 1:
                # Modes often have equal figures. Dashes let the line below be seen.
                if number > 0:
                    look["linestyle"] = "--"
                has_markers = number == 0 and len(ordered) <= MAX_LINE_DESIGNS
                axes.plot(
                    ordered[size],
                    ordered[merit],
                    marker="." if has_markers else "",
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
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


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
    # A table over the two sizes is mostly filled if the designs form a grid.
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
