"""Parts of scenes of the analysis `singularities`, for one input and for several."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from spherekit.plugin import (
    Floats,
    Mark,
    PlaneCurve,
    Portrait,
    Primitive,
    Series,
)

SELF_MOTION: Final = "self-motion"
"""The kind of singularity in which links move while inputs and output rest."""

COLOUR_OF_KIND = {"I": 1, "II": 2, "III": 3, "self-motion": 4}
"""Index of the colour of each kind of singularity."""


@dataclass(frozen=True)
class PlottedColumn:
    """How one column of the table of relations appears in plots.

    The table has two kinds of columns. The coefficients c and d belong to the relation c y'
    = d q'. y' is the rate of an output, and q' the rate of the one input that moves
    while the others are locked. The other columns are angles that measure how near
    singularities are.

    Attributes
    ----------
    label
        The quantity in words.
    group
        Plots of one group are drawn together.
    unit
        Unit of the quantity, empty for the coefficients c and d.
    """

    label: str
    group: str
    unit: str

    @property
    def depends_on_input(self) -> bool:
        """Whether the column depends on which input moves. Only c and d do."""
        return not self.unit


PLOTTED_COLUMNS = {
    "c": PlottedColumn("c", "input-output relation", ""),
    "d": PlottedColumn("d", "input-output relation", ""),
    "distance_I": PlottedColumn("to type I", "angles", "rad"),
    "distance_II": PlottedColumn("to type II", "angles", "rad"),
    "transmission": PlottedColumn("transmission angle", "angles", "rad"),
}
"""The drawn columns of the table of relations by name."""


def break_at_jumps(line: Floats) -> Floats:
    """Return points (n, 2) of a line of angles (rad), broken where an angle jumps.

    At a jump by more than half a revolution, the angle has left its range at one end and
    come back at the other. A row of NaN is inserted between the two points, so that they
    are not connected in the drawing.
    """
    jumps = np.max(np.abs(np.diff(line, axis=0)), axis=1) > np.pi
    return np.insert(line, np.flatnonzero(jumps) + 1, np.nan, axis=0)


def plot_plane(
    path: str,
    label: str,
    rows: Floats,
    axes: tuple[str, str],
    curves: Sequence[PlaneCurve],
    marks: Sequence[Mark],
    further_points: Iterable[Floats] = (),
) -> Portrait:
    """Return a drawing of curves in a plane of two angles (rad), with a moving point.

    Parameters
    ----------
    path, label
        Address of the plot among the objects of a recording for the viewer, and title of
        the plot.
    rows
        (n, 2) position of the moving point in each row of a motion.
    axes
        Names of the two angles.
    curves, marks
        Curves and marked points.
    further_points
        Arrays (k, 2) of points that must be in the visible part of the plane, in addition
        to the curves.
    """
    # The visible part contains all points. Without points it is the origin.
    point_arrays = [*(curve.points for curve in curves), *further_points]
    points = np.concatenate(point_arrays or [np.zeros((1, 2))])
    low = np.nanmin(points, axis=0)
    high = np.nanmax(points, axis=0)
    x_range, y_range = zip(low, high, strict=True)
    x_label, y_label = axes
    return Portrait(
        path,
        label,
        x=rows[:, 0],
        y=rows[:, 1],
        x_label=x_label,
        y_label=y_label,
        x_range=x_range,
        y_range=y_range,
        x_unit="rad",
        y_unit="rad",
        curves=curves,
        marks=marks,
    )


def relation_plots(
    relation: Mapping[str, Any], rows_of_batch: int, rows: slice
) -> list[Primitive]:
    """Return plots of the input-output relation of each output in one assembly mode.

    The relation is c y' = d q'. y' is the rate of an output, and q' the rate of the one
    input that moves while the others are locked. There are up to two forms of the relation,
    i and ii, with different reference links of the output. The coefficients c and d are
    plotted, and angles that measure how near singularities are (`PLOTTED_COLUMNS`).

    Parameters
    ----------
    relation
        The table of relations by column. It has a row for each row of the batch (each
        sample in each assembly mode). These rows are repeated for every output, form of the
        relation and moving input.
    rows_of_batch
        Number of rows of the batch.
    rows
        The rows of the batch that are drawn: those of one assembly mode (way to assemble
        the links).
    """
    plots: dict[str, Primitive] = {}
    has_several_inputs = len(set(relation["moving"])) > 1
    for start in range(0, len(relation["c"]), rows_of_batch):
        output = relation["output"][start]
        form = relation["form"][start]
        moving_input = relation["moving"][start]
        table_rows = slice(start + rows.start, start + rows.stop)
        for name, column in PLOTTED_COLUMNS.items():
            # c and d have a plot for each moving input. The angles do not depend on the
            # moving input. Their plots have the same path for all inputs, so only one plot
            # remains.
            by_input = ""
            if has_several_inputs and column.depends_on_input:
                by_input = f" by {moving_input}"
            values = relation[name][table_rows]
            file_name = (name + by_input).replace(" ", "_")
            path = f"plots/{form}/{output.replace('/', '_')}/{file_name}"
            if np.any(np.isfinite(values)):
                label = f"{column.label}{by_input}, output {output}"
                title = f"{column.group}, form {form}"
                plots[path] = Series(path, label, title, values, column.unit)
    return list(plots.values())


def name_kind(kind: str) -> str:
    """Return a kind of singularity in words, such as ``type II`` or ``self-motion``."""
    return kind if kind == SELF_MOTION else f"type {kind}"
