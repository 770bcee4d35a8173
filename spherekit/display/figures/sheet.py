"""Figures with their panels, their legend, and their axes with units."""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import fill
from typing import Any, cast

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import (
    Axes,
    Figure,
    MaxNLocator,
    Normalize,
    ScalarMappable,
    withStroke,
)
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import place_labels
from spherekit.scenes.scene import Page

DEGREE_TICK_STEPS = (1, 1.2, 1.5, 1.8, 3, 4.5, 6, 9, 10)
"""Steps of ticks, times powers of ten.

Steps from 1 to 90 divide a revolution (360 degrees). Of the larger steps, only 120 and 180
do.
"""

DEGREE_TICK_RANGE = 60.0
"""Smallest range (deg) of an axis with these ticks. Shorter axes have decimal ticks."""

LEGEND_ROW_IN = 0.17
"""Height (inches) of a row of the legend."""

LEGEND_LETTER_IN = 0.062
"""Width (inches) of a letter in the legend."""

LEGEND_KEY_IN = 0.5
"""Width (inches) of the line in front of a name in the legend."""

PANEL_HEADING_IN = 0.25
"""Height (inches) of the title of a panel and of the name of its axis."""

LONG_TITLE_LETTERS = 28
"""Titles with more letters allow fewer panels side by side."""

SCREEN_DPI = 160
"""Dots per inch in a notebook."""

POINT_NAME_PT = 6.5
"""Size (points) of the letters of names in a panel."""


class Drawing(Figure):
    """A matplotlib figure in the style of spherekit, which notebooks display."""

    savefig = cast(Any, style.look())(Figure.savefig)

    def _repr_png_(self) -> bytes:
        return as_png(self)


def as_png(figure: Figure) -> bytes:
    """Return a figure as a PNG image for the screen."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=SCREEN_DPI)
    return buffer.getvalue()


def as_data_url(figure: Figure) -> str:
    """Return a figure as the address of an image in an HTML page."""
    return "data:image/png;base64," + base64.b64encode(as_png(figure)).decode()


@dataclass(frozen=True)
class Sheet:
    """Makes the figures of a run, with a given width and titles of the assembly modes.

    Attributes
    ----------
    columns
        Number of columns of a journal over which a figure extends.
    titles
        Titles of the assembly modes, by number.
    """

    columns: style.Columns
    titles: Mapping[int, str]

    @property
    def width(self) -> float:
        """Width of a figure (inches)."""
        return style.WIDTHS[self.columns]

    def title(self, page: Page) -> str:
        """Return the name of a page (a mode or a title) in legends."""
        if isinstance(page, int):
            title = self.titles.get(page, f"Mode {page}")
            return plot_text(title.replace("Mode", "mode").replace("-", "−"))
        return plot_text(page or "")

    def make_figure(self, row_count: int, row_height: float) -> Drawing:
        """Return an empty figure for rows of panels of a height (inches)."""
        figure_size = (self.width, row_count * row_height)
        return Drawing(figsize=figure_size, layout="constrained")

    def add_legend(self, figure: Drawing) -> Drawing:
        """Add a legend below the panels, with each name that occurs in them once.

        The figure grows by the height of the legend, and is returned.
        """
        handle_by_label: dict[str, Any] = {}
        for panel in figure.axes:
            handles, labels = panel.get_legend_handles_labels()
            # A handle is the line or marker of a name. The first panel with a name provides
            # its handle.
            handle_by_label = dict(zip(labels, handles, strict=True)) | handle_by_label
        if handle_by_label:
            longest_label = max(map(len, handle_by_label))
            entry_width = LEGEND_LETTER_IN * longest_label + LEGEND_KEY_IN
            column_count = max(1, int(self.width / entry_width))
            row_count = -(-len(handle_by_label) // column_count)  # rounded up
            figure.set_figheight(figure.get_figheight() + LEGEND_ROW_IN * row_count)
            figure.legend(
                handle_by_label.values(),
                handle_by_label,
                loc="outside lower center",
                ncols=min(len(handle_by_label), column_count),
                handlelength=2.2,
                columnspacing=1.4,
            )
        return figure

    def make_panels(
        self,
        panel_count: int,
        ratio: float,
        longest_title: int = 0,
        subplot: Look | None = None,
    ) -> tuple[Drawing, Any]:
        """Return a figure with a number of panels in rows and columns.

        Parameters
        ----------
        panel_count
            Number of panels.
        ratio
            Height of a panel divided by its width.
        longest_title
            Number of letters of the longest title. Long titles need wide panels.
        subplot
            Keywords with which matplotlib creates each panel, such as ``{"projection":
            "polar"}`` for polar diagrams.

        Returns
        -------
        figure
            The figure.
        panels
            Its panels, row by row.
        """
        column_count = self._count_panel_columns(panel_count, longest_title)
        row_count = -(-panel_count // column_count)  # rounded up
        # `self.columns` is how many text columns of a journal page the figure spans. A
        # single panel over two text columns would be too high, so its height is reduced.
        is_wide = column_count == 1 and self.columns == 2
        height_factor = 0.55 if is_wide else 1.0
        panel_height = self.width / column_count * ratio * height_factor
        figure = self.make_figure(row_count, panel_height + PANEL_HEADING_IN)
        panels = figure.subplots(
            row_count, column_count, squeeze=False, subplot_kw=subplot
        ).ravel()
        for unused_panel in panels[panel_count:]:
            unused_panel.remove()
        return figure, panels[:panel_count]

    def _count_panel_columns(self, panel_count: int, longest_title: int) -> int:
        """Return how many panels are beside each other in a figure.

        A figure is one or two text columns of a journal wide (`self.columns`). Usually it
        has the same number of panels beside each other.

        Parameters
        ----------
        panel_count
            Number of all panels of the figure.
        longest_title
            Number of letters of the longest title.
        """
        column_count: int = self.columns
        has_many_panels = panel_count > 4
        fills_square = panel_count == 4 and self.columns == 1  # two by two
        fills_row = panel_count == 3 and self.columns == 2
        has_short_titles = longest_title <= LONG_TITLE_LETTERS
        if has_short_titles and (has_many_panels or fills_square or fills_row):
            column_count += 1
        return min(panel_count, column_count)


def label_shared_axes(panels: Sequence[Any], x_label: str, y_label: str) -> None:
    """Name the axes of panels once: x below the last row of panels, y beside all panels."""
    column_count = panels[0].get_gridspec().ncols
    for panel in panels[-column_count:]:
        panel.set_xlabel(plot_text(x_label))
    panels[0].get_figure().supylabel(fill(plot_text(y_label), 30))


def marker_look(tone: int) -> Look:
    """Return how marks of a kind are drawn."""
    return {
        "linestyle": "none",
        "marker": style.MARKERS[tone % len(style.MARKERS)],
        "markersize": 4.0,
        "markerfacecolor": style.tone_colour(tone),
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
    }


def name_points(
    panel: Axes, names: Sequence[str], points: Floats, colours: Sequence[str]
) -> None:
    """Write names beside points of a panel, where they cover no point, name or curve.

    A halo keeps a name readable if a curve cannot be avoided.

    Parameters
    ----------
    panel
        The panel. Its layout must be final, since positions are measured on the paper.
    names
        Names of the points.
    points
        (n, 2) positions in the units of the axes.
    colours
        Colour of each name.
    """
    pixels_per_point = panel.figure.dpi / 72.0
    pixel_positions: Floats = panel.transData.transform(points)
    letter_size = POINT_NAME_PT * pixels_per_point
    # `place_labels` places the names in several pictures. Here there is one picture.
    middles_by_picture = place_labels(
        names,
        pixel_positions[np.newaxis],
        letter_size,
        curve_points=_points_on_lines(panel, 0.5 * letter_size),
        frame=(np.array(panel.bbox.min), np.array(panel.bbox.max)),
    )
    name_middles = middles_by_picture[0]
    offsets = (name_middles - pixel_positions) / pixels_per_point
    for name, point, offset, colour in zip(names, points, offsets, colours, strict=True):
        panel.annotate(
            plot_text(name),
            point,
            xytext=offset,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=POINT_NAME_PT,
            color=colour,
            path_effects=[withStroke(linewidth=2.0, foreground=style.PAPER)],
            zorder=5.0,
        )


def _points_on_lines(panel: Axes, distance: float) -> Floats:
    """Return points (m, 2) on the lines in a panel, in pixels.

    Names are later placed where they cover few of these points, and so few lines. Points
    are rounded to a square grid, and equal points occur once.

    Parameters
    ----------
    panel
        The panel. Its layout must be final.
    distance
        Largest distance (pixels) of successive points of a line, and mesh of the grid.
    """
    frame = panel.bbox.padded(distance)
    frame_diagonal = np.hypot(frame.width, frame.height)
    points_of_lines: list[Floats] = [np.empty((0, 2))]
    for line in panel.lines:
        corners = np.asarray(line.get_transform().transform(line.get_xydata()), float)
        for start, end in pairwise(corners):
            length = np.linalg.norm(end - start)
            has_gap = not np.isfinite(length)  # NaN separates the parts of a line
            # Only the start of a segment is tested. Most segments are short, so segments
            # that only end in the frame hardly matter.
            if has_gap or not frame.contains(*start):
                continue
            # Positions along the segment: 0 at its start, 1 at its end. A segment may end
            # at an outlier very far away. Beyond the diagonal it is outside of the frame.
            visible_length = min(length, frame_diagonal)
            visible_fraction = visible_length / length if length else 1.0
            fractions = np.linspace(
                0.0, visible_fraction, int(visible_length / distance) + 2
            )
            points_of_lines.append(start + fractions[:, None] * (end - start))
    points = np.concatenate(points_of_lines)
    return np.unique(np.round(points / distance), axis=0) * distance


def add_colour_bar(
    figure: Figure,
    panels: Any,
    values: Floats,
    colour_scale: Normalize,
    colours: Any,
    label: str,
    distance: float = 0.03,
) -> Any:
    """Add a colour bar, with pointed ends if some values are beyond its scale.

    Parameters
    ----------
    figure, panels
        The figure, and the panels beside which the bar is drawn.
    values
        (n,) the values that colours show in the panels. NaN and infinity are ignored.
    colour_scale
        Scale from values to the range 0 to 1.
    colours
        Colours over this range.
    label
        Name and unit of the quantity.
    distance
        Distance of the bar from the panels, relative to the width of the panels.

    Returns
    -------
    The colour bar of matplotlib.
    """
    positions = np.ma.compressed(colour_scale(values[np.isfinite(values)]))
    has_values_beyond = np.any((positions < 0.0) | (positions > 1.0))
    return figure.colorbar(
        ScalarMappable(colour_scale, colours),
        ax=panels,
        shrink=0.75,
        pad=distance,
        aspect=28,
        extend="both" if has_values_beyond else "neither",
        label=plot_text(label),
    )


def set_degree_ticks(panel: Axes, *units: str) -> None:
    """Set ticks such as 0, 90, 180 on axes in degrees that cover a wide range.

    Parameters
    ----------
    panel
        The panel.
    units
        Units of the axes: x, or x and y.
    """
    for axis, unit in zip((panel.xaxis, panel.yaxis), units, strict=False):
        low, high = axis.get_view_interval()
        if unit == "deg" and high - low >= DEGREE_TICK_RANGE:
            axis.set_major_locator(MaxNLocator("auto", steps=DEGREE_TICK_STEPS))
