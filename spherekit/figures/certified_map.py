"""A proven map of two inputs: how many modes there are, and where they are singular."""

from collections.abc import Mapping, Sequence

from spherekit.arrays import Floats
from spherekit.figures import style
from spherekit.figures.sdk import Figure, PatchCollection, Rectangle
from spherekit.figures.sheet import Drawing

CONTAINS, UNDECIDED = "type II in the cell", "undecided"
CONTAINING, DOUBTFUL = "#B2182B", "#222222"
SHADES = ("#f3f0e6", "#c6dbef", "#9ecae1", "#74a9cf", "#4d8ebf", "#3071a9", "#1b5a94")


def draw_certified_map(
    areas: Mapping[str, tuple[Floats, Floats]],
    counts: Sequence[int],
    names: Sequence[str],
) -> Figure:
    """Return a figure of boxes of two inputs, in degrees.

    Parameters
    ----------
    areas
        Centres and half widths (n, 2) of boxes: under each number of modes of `counts`,
        under `CONTAINS` and under `UNDECIDED`.
    counts
        Numbers of modes, proven, of the regular boxes.
    names
        Those of the inputs.
    """
    with style.look():
        figure = Drawing(figsize=(style.WIDTHS[1], style.WIDTHS[1]), layout="constrained")
        axes = figure.add_subplot()
        colours = {str(count): SHADES[k % len(SHADES)] for k, count in enumerate(counts)}
        colours |= {CONTAINS: CONTAINING, UNDECIDED: DOUBTFUL}
        for kind, colour in colours.items():
            centres, half = areas[kind]
            if not len(centres):
                continue
            boxes = [
                Rectangle((x - a, y - b), 2 * a, 2 * b)
                for (x, y), (a, b) in zip(centres, half, strict=True)
            ]
            axes.add_collection(
                PatchCollection(boxes, facecolor=colour, edgecolor=colour, linewidth=0.1)
            )
            words = f"{kind} modes" if kind.isdigit() else kind
            axes.plot([], [], "s", color=colour, label=words)  # for the legend
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_xlabel(f"input {names[0]}, deg")
        axes.set_ylabel(f"input {names[1]}, deg")
        figure.legend(loc="outside lower center", ncols=2)
    return figure
