"""A figure of a proven map of two inputs.

The figure shows how many assembly modes there are, and at which inputs they are singular.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import Figure, PolyCollection
from spherekit.display.figures.sheet import Drawing
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text

TYPE_II_LABEL = "type II in the cell"
"""Name of the boxes that contain singularities of type II."""

UNDECIDED_LABEL = "undecided"
"""Name of the boxes of which nothing is proven."""

BOX_COLOURS = {TYPE_II_LABEL: "#B2182B", UNDECIDED_LABEL: "#222222"}
"""Colours of boxes that are not regular."""

REGULAR_COLOURS = (
    "#f3f0e6",
    "#c6dbef",
    "#9ecae1",
    "#74a9cf",
    "#4d8ebf",
    "#3071a9",
    "#1b5a94",
)
"""Colours of regular boxes, from few modes to many. Further areas repeat the colours."""

BOX_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
"""(4, 2) corners of a box, in half widths of the box from its centre."""


def draw_certified_map(
    areas: Mapping[str, tuple[Floats, Floats]], names: Sequence[str]
) -> Figure:
    """Return a figure of the proven numbers of assembly modes, over two inputs (deg).

    The plane of the inputs is divided into boxes. An assembly mode is one way to assemble
    the mechanism. A box is regular if it provably has no singularity of type II (at which
    locked inputs do not hold the output). The number of assembly modes in a regular box is
    constant.

    Parameters
    ----------
    areas
        Centres and half widths (n, 2) of boxes (deg), by label. An area is all boxes with
        the same label, and is drawn in one colour. The label of regular boxes is their
        number of modes. The label of other boxes is `TYPE_II_LABEL` or `UNDECIDED_LABEL`.
    names
        Names of the two inputs.
    """
    with style.look():
        # A square figure with the width of one column of a journal.
        width = style.WIDTHS[1]
        figure = Drawing(figsize=(width, width), layout="constrained")
        axes = figure.add_subplot()
        for position, (kind, (centres, half_widths)) in enumerate(areas.items()):
            if not len(centres):
                continue
            regular_colour = REGULAR_COLOURS[position % len(REGULAR_COLOURS)]
            colour = BOX_COLOURS.get(kind, regular_colour)
            # (n, 4, 2) corners of the boxes.
            corners = centres[:, None] + half_widths[:, None] * BOX_CORNERS
            look: Look = {"color": colour, "linewidth": 0.1, "label": plot_text(kind)}
            axes.add_collection(PolyCollection(corners, **look))
        axes.autoscale_view()
        x_label, y_label = (plot_text(f"input {name}, deg") for name in names)
        axes.set(aspect="equal", xlabel=x_label, ylabel=y_label)
        figure.legend(loc="outside lower center", ncols=2)
    return figure
