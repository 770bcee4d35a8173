"""The style of figures: widths, letters, and the meaning of each colour.

In the figures of a run, each mode has a colour by its number, the same in every figure. The
first six of these colours are from Okabe and Ito (2008), who chose them for readers with
and without colour blindness.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any, Literal

from spherekit.display.figures.matplotlib_sdk import style
from spherekit.scenes.scene import Page

Columns = Literal[1, 2]
"""Columns of a journal over which a figure extends."""

Look = dict[str, Any]
"""Keywords of matplotlib that say how something is drawn."""

WIDTHS: Mapping[int, float] = {1: 3.5, 2: 7.2}
"""Widths (inches) of figures over one column of a journal, and over two."""

FILE_DPI = 300
"""Dots per inch of images in files."""

INK = "#222222"
"""Colour of text and axes."""

PAPER = "#ffffff"
"""Colour of the background, and of halos around names."""

FAINT = "#c8c8c8"
"""Colour of lines at zero."""

MODE_COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#E69F00",
    "#5B4FA2",
    "#7A5A2F",
)
"""Colours of assembly modes."""

SERIES_COLOURS = (
    "#332288",
    "#DDAA33",
    "#117733",
    "#AA4499",
    "#88CCEE",
    "#661100",
    "#999933",
)
"""Colours of several quantities in one mode. Most are in the muted set of Tol (2021)."""

TONE_COLOURS = (INK, "#B2182B", "#7B3294", "#1B7837", "#9E9E9E", "#8C510A", "#2166AC")
"""Colours of kinds of curves and marks; 1, 2 and 3 are the types of singularities."""

MARKERS = ("o", "v", "s", "D", "o", "P", "X")
"""Markers of kinds of marks."""

DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)))
"""Dashes of modes, or quantities, that have the same colour."""

HEAT_COLOUR_MAP = "viridis"
"""Colours of values on maps."""

MATPLOTLIB_SETTINGS: Look = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "figure.titlesize": 9.0,
    "figure.labelsize": 8.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "axes.formatter.useoffset": False,
    "lines.linewidth": 1.1,
    # Margins (inches) of the layout. The default of 0.04 puts titles at the edge.
    "figure.constrained_layout.w_pad": 0.09,
    "figure.constrained_layout.h_pad": 0.09,
    "savefig.dpi": FILE_DPI,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}


def look() -> AbstractContextManager[None]:
    """Return a context in which matplotlib draws in this style, whatever its settings."""
    return style.context(["default", MATPLOTLIB_SETTINGS])


def page_look(page: Page) -> Look:
    """Return the line style of the curves of a page, which shows one assembly mode.

    The number of a mode determines its colour. If two modes have the same colour, the first
    mode has solid lines and the second mode has dashes. Curves of pages that are not for a
    mode have the colour of text.
    """
    if not isinstance(page, int):
        return {"color": INK, "linestyle": "-"}
    return {
        "color": MODE_COLOURS[page % len(MODE_COLOURS)],
        "linestyle": DASHES[page // len(MODE_COLOURS) % len(DASHES)],
        "gid": f"mode {page}",
    }


def series_look(position: int) -> Look:
    """Return how the quantity at a position in its panel is drawn."""
    dashes = DASHES[position // len(SERIES_COLOURS) % len(DASHES)]
    colour = SERIES_COLOURS[position % len(SERIES_COLOURS)]
    return {"color": colour, "linestyle": dashes}


def tone_colour(number: int) -> str:
    """Return the colour of a kind of curve or mark."""
    return TONE_COLOURS[number % len(TONE_COLOURS)]


def tone_look(number: int) -> Look:
    """Return how curves of a kind are drawn."""
    return {"color": tone_colour(number)}
