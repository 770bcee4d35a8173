"""A proven map of two inputs: how many modes there are, and where they are singular."""

from collections.abc import Mapping, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Figure, PolyCollection
from spherekit.display.figures.sheet import Drawing
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text

CONTAINS, UNDECIDED = "type II in the cell", "undecided"
COLOURS = {CONTAINS: "#B2182B", UNDECIDED: "#222222"}
CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
SHADES = ("#f3f0e6", "#c6dbef", "#9ecae1", "#74a9cf", "#4d8ebf", "#3071a9", "#1b5a94")


def draw_certified_map(
    areas: Mapping[str, tuple[Floats, Floats]], names: Sequence[str]
) -> Figure:
    """Return a figure of boxes of two inputs, in degrees.

    Parameters
    ----------
    areas
        Centres and half widths (n, 2) of boxes: regular ones under how many modes are
        proven, the others under `CONTAINS` and `UNDECIDED`.
    names
        Those of the inputs.
    """
    with style.look():
        figure = Drawing(figsize=(style.WIDTHS[1], style.WIDTHS[1]), layout="constrained")
        axes = figure.add_subplot()
        for k, (kind, (centres, half)) in enumerate(areas.items()):
            if len(centres):
                colour = COLOURS.get(kind, SHADES[k % len(SHADES)])
                corners = centres[:, None] + half[:, None] * CORNERS
                look: Look = {"color": colour, "linewidth": 0.1, "label": plot_text(kind)}
                axes.add_collection(PolyCollection(corners, **look))
        axes.autoscale_view()
        first, second = (f"input {name}, deg" for name in names)
        axes.set(aspect="equal", xlabel=plot_text(first), ylabel=plot_text(second))
        figure.legend(loc="outside lower center", ncols=2)
    return figure
