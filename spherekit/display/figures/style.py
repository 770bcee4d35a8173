"""How figures look: sizes of columns, letters, and what each colour stands for.

Modes have the colours of Okabe and Ito (2008), told apart with any kind of colour vision,
by their number: the same in every figure.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any, Literal

from spherekit.display.figures.matplotlib_sdk import style
from spherekit.scenes.scene import Page

Columns = Literal[1, 2]
Look = dict[str, Any]
"""How matplotlib draws something."""

WIDTHS: Mapping[int, float] = {1: 3.5, 2: 7.2}
"""Inches: one column of a journal, and two."""
DPI = 300
INK, FAINT = "#222222", "#c8c8c8"

MODES = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#E69F00",
    "#5B4FA2",
    "#7A5A2F",
)
SERIES = ("#332288", "#DDAA33", "#117733", "#AA4499", "#88CCEE", "#661100", "#999933")
"""Of several quantities in one mode; the set of Tol (2021), muted."""
TONES = (INK, "#B2182B", "#7B3294", "#1B7837", "#9E9E9E", "#8C510A", "#2166AC")
"""Of kinds of curves and marks: 1, 2 and 3 are the types of singularities."""
MARKERS = ("o", "v", "s", "D", "o", "P", "X")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)))
HEAT = "viridis"

LOOK: Look = {
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
    "savefig.dpi": DPI,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}


def look() -> AbstractContextManager[None]:
    """Return a context in which matplotlib draws as figures here look, whatever is set."""
    return style.context(["default", LOOK])


def page_look(page: Page) -> Look:
    """Return how the curves of a mode are drawn, or those of a page of its own.

    Of modes with the same colour the first has a stroke, the others have dashes.
    """
    if not isinstance(page, int):
        return {"color": INK, "linestyle": "-"}
    return {
        "color": MODES[page % len(MODES)],
        "linestyle": DASHES[page // len(MODES) % len(DASHES)],
        "gid": f"mode {page}",
    }


def series_look(position: int) -> Look:
    """Return how the quantity at a position in its panel is drawn."""
    dashes = DASHES[position // len(SERIES) % len(DASHES)]
    return {"color": SERIES[position % len(SERIES)], "linestyle": dashes}


def tone_colour(number: int) -> str:
    """Return the colour of a kind of curve or mark."""
    return TONES[number % len(TONES)]


def tone_look(number: int) -> Look:
    """Return how curves of a kind are drawn."""
    return {"color": tone_colour(number)}
