"""A figure with its panels, its legend beside them, and its axes with units."""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
)
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.scenes.plot_layout import place_labels
from spherekit.scenes.scene import Page

DEGREE_STEPS = (1, 1.2, 1.5, 1.8, 3, 4.5, 6, 9, 10)
LONG = 60.0
"""Degrees from which on an axis has these steps."""
LEGEND_ROW = 0.17
"""Inches that a row of the legend takes."""
HEADING = 0.25
"""Inches of a panel's title and the name of its axis."""
LONG_TITLE = 28
"""Letters of a title from which on fewer panels stand side by side."""
SCREEN = 160
"""Dots per inch in a notebook."""


class Drawing(Figure):
    """A matplotlib figure in the look of spherekit, shown in notebooks as it is."""

    savefig = cast(Any, style.look())(Figure.savefig)

    def _repr_png_(self) -> bytes:
        return as_bytes(self)


def as_bytes(figure: Figure) -> bytes:
    """Return a figure as a PNG picture for the screen."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=SCREEN)
    return buffer.getvalue()


def as_data_url(figure: Figure) -> str:
    """Return a figure as the address of a picture in a page."""
    return "data:image/png;base64," + base64.b64encode(as_bytes(figure)).decode()


@dataclass(frozen=True)
class Sheet:
    """How figures of a run are drawn: over one or two columns, modes by their titles."""

    columns: style.Columns
    titles: Mapping[int, str]

    @property
    def width(self) -> float:
        """Inches."""
        return style.WIDTHS[self.columns]

    def title(self, page: Page) -> str:
        """Return what a page is called in legends."""
        if isinstance(page, int):
            title = self.titles.get(page, f"Mode {page}")
            return plot_text(title.replace("Mode", "mode").replace("-", "−"))
        return plot_text(page or "")

    def figure(self, rows: int, row: float) -> Drawing:
        """Return an empty figure with rows of panels `row` inches high."""
        return Drawing(figsize=(self.width, rows * row), layout="constrained")

    def name(self, figure: Drawing) -> Drawing:
        """Return a figure with a legend below, of what is named in any of its panels."""
        named: dict[str, Any] = {}
        for panel in figure.axes:
            handles, labels = panel.get_legend_handles_labels()
            named = dict(zip(labels, handles, strict=True)) | named
        if named:
            columns = max(1, int(self.width / (0.062 * max(map(len, named)) + 0.5)))
            rows = -(-len(named) // columns)
            figure.set_figheight(figure.get_figheight() + LEGEND_ROW * rows)
            figure.legend(
                named.values(),
                named,
                loc="outside lower center",
                ncols=min(len(named), columns),
                handlelength=2.2,
                columnspacing=1.4,
            )
        return figure

    def panels(
        self, count: int, ratio: float, longest: int = 0, subplot: Look | None = None
    ) -> tuple[Drawing, Any]:
        """Return a figure with so many panels.

        `ratio` is the height of a panel over its width, `longest` the letters of the
        longest title, `subplot` the kind of panels.
        """
        fitting = count > 4 or count + self.columns == 5
        across = min(count, self.columns + (fitting and longest <= LONG_TITLE))
        rows = -(-count // across)
        widest = 0.55 if across == 1 and self.columns == 2 else 1.0
        figure = self.figure(rows, self.width / across * ratio * widest + HEADING)
        panels = figure.subplots(rows, across, squeeze=False, subplot_kw=subplot).ravel()
        for spare in panels[count:]:
            spare.remove()
        return figure, panels[:count]


def label_outside(panels: Sequence[Any], x: str, y: str) -> None:
    """Name the axes of panels that share them: x below the last ones, y once."""
    for panel in panels[-panels[0].get_gridspec().ncols :]:
        panel.set_xlabel(plot_text(x))
    panels[0].get_figure().supylabel(fill(plot_text(y), 30))


def spot_look(tone: int) -> Look:
    """Return how marks of a kind are drawn."""
    return {
        "linestyle": "none",
        "marker": style.MARKERS[tone % len(style.MARKERS)],
        "markersize": 4.0,
        "markerfacecolor": style.tone_colour(tone),
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
    }


LETTER = 6.5
"""Points of the letters of names in a panel."""


def name_points(
    panel: Axes, names: Sequence[str], places: Floats, colours: Sequence[str]
) -> None:
    """Write names beside points (n, 2), where they cover nothing; the layout is made."""
    dots = panel.figure.dpi / 72.0
    seen: Floats = panel.transData.transform(places)
    middles = place_labels(names, seen[None], LETTER * dots)[0]
    for name, place, offset, colour in zip(
        names, places, (middles - seen) / dots, colours, strict=True
    ):
        panel.annotate(
            plot_text(name),
            place,
            xytext=offset,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=LETTER,
            color=colour,
        )


def colour_bar(
    figure: Figure,
    panels: Any,
    values: Floats,
    tint: Normalize,
    colours: Any,
    words: str,
    pad: float = 0.03,
) -> Any:
    """Add the scale of the colours of values, with ends where some are beyond it."""
    parts = np.ma.compressed(tint(values[np.isfinite(values)]))
    return figure.colorbar(
        ScalarMappable(tint, colours),
        ax=panels,
        shrink=0.75,
        pad=pad,
        aspect=28,
        extend="both" if np.any((parts < 0.0) | (parts > 1.0)) else "neither",
        label=plot_text(words),
    )


def ticks_of(panel: Axes, *units: str) -> None:
    """Put ticks of many degrees along x and y at those that part a turn."""
    for axis, unit in zip((panel.xaxis, panel.yaxis), units, strict=False):
        low, high = axis.get_view_interval()
        if unit == "deg" and high - low >= LONG:
            axis.set_major_locator(MaxNLocator("auto", steps=DEGREE_STEPS))
