"""Figures of one column of a table against another column."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures.curve_plots import Curve, draw_curves
from spherekit.display.figures.input_maps import find_grid
from spherekit.display.figures.matplotlib_sdk import Figure
from spherekit.display.figures.sheet import Sheet
from spherekit.errors import AnalysisError
from spherekit.scenes.plot_layout import PLOT_MARGIN, TURN_BY_UNIT
from spherekit.scenes.scene import Axis, Page, Scene, Series
from spherekit.tables.table import ASSEMBLY_MODE, MODE_NAME, SAMPLE, Table

if TYPE_CHECKING:
    import pandas as pd


def draw_columns(
    table: Table,
    frame: "pd.DataFrame",
    x: str,
    y: str,
    *,
    degrees: bool,
    sheet: Sheet,
) -> Figure:
    """Return a figure of one column of a table against another column.

    A table with rows of samples has a curve for each assembly mode. Its text columns can
    tell several subjects apart, such as pairs of links. Each subject then has a panel. A
    few subjects in a single mode share one panel, with a curve for each subject. The rows
    of a table without samples, and rows on a grid of several inputs, do not follow each
    other and are drawn as points.

    Parameters
    ----------
    table
        Names, units and kinds of the columns.
    frame
        The rows of the table, with angles in the unit that `degrees` states.
    x, y
        Names of the columns on the axes.
    degrees
        Whether angles are in degrees, otherwise in rad.
    sheet
        Size of the figure, and titles of modes.

    Raises
    ------
    AnalysisError
        If no row has a number in both columns.
    """
    column_by_name = {column.name: column for column in table.columns}
    x_unit = column_by_name[x].unit_in(degrees)
    y_unit = column_by_name[y].unit_in(degrees)
    are_curves = table.in_assembly_modes and not _is_on_grid(table, frame)
    # All panels have the same range on the x axis, which contains all points that are
    # drawn.
    has_point = np.isfinite(frame[x].to_numpy(float)) & np.isfinite(
        frame[y].to_numpy(float)
    )
    if not has_point.any():
        raise AnalysisError(
            f"no row of the table {table.name} has a number in both columns {x} and {y}"
        )
    shown_x = frame[x].to_numpy(float)[has_point]
    span = (float(np.min(shown_x)), float(np.max(shown_x)))
    groups = list(_subjects(table, frame))
    is_monotonic = all(rows[x].is_monotonic_increasing for _, _, rows in groups)
    if not (are_curves and is_monotonic):
        # Points and closed curves would be cut in half by the frame.
        margin = PLOT_MARGIN * (span[1] - span[0])
        span = (span[0] - margin, span[1] + margin)
    curves: list[Curve] = []
    for page, label, rows in groups:
        x_values = rows[x].to_numpy(float)
        y_values = rows[y].to_numpy(float)
        if not np.any(np.isfinite(x_values) & np.isfinite(y_values)):
            continue
        if are_curves:
            x_values, y_values = _interrupt(x_values, y_values, TURN_BY_UNIT.get(x_unit))
        else:
            # Rows of NaN between the points: no line joins them, and each is a dot.
            x_values = np.repeat(x_values, 2)
            y_values = np.repeat(y_values, 2)
            y_values[1::2] = np.nan
        axis = Axis(x, x_unit, x_values, span)
        series = Series(f"{table.name}/{label}", label, y, y_values, y_unit)
        curves.append((Scene(page, (series,), (axis,)), series))
    return draw_curves([], curves, sheet)


def _is_on_grid(table: Table, frame: "pd.DataFrame") -> bool:
    """Return whether the samples of a table are a grid of several inputs."""
    names = [column.name for column in table.columns if column.name.startswith("q_")]
    if len(names) < 2:
        return False
    samples = frame.drop_duplicates(SAMPLE.name)
    axes = [Axis(name, "", samples[name].to_numpy(float)) for name in names]
    return find_grid(axes) is not None


def _subjects(
    table: Table, frame: "pd.DataFrame"
) -> Iterator[tuple[Page, str, "pd.DataFrame"]]:
    """Yield for each curve its page, its label and its rows of a table.

    The texts in a row name its subject, such as a pole. There is a curve for each subject
    in each assembly mode (way to assemble the mechanism). The label names the subject, such
    as "pole 3/1". All curves of an assembly mode belong to one page, the number of the
    mode. A table without assembly modes has one curve of all rows. Its page and its label
    are empty.

    Parameters
    ----------
    table
        The declaration of the table: kinds and units of its columns.
    frame
        The columns of the table.
    """
    if not table.in_assembly_modes:
        yield "", "", frame
        return
    subject_names = _subject_columns(table, frame)
    # Each group has the rows with the same texts and the same assembly mode.
    keys = [*subject_names, ASSEMBLY_MODE.name]
    key: Any
    for key, rows in frame.groupby(keys, observed=True, sort=False):
        *texts, mode_number = key
        parts_of_label = []
        for name, text in zip(subject_names, texts, strict=True):
            parts_of_label.append(f"{name.replace('_', ' ')} {text}")
        yield int(mode_number), ", ".join(parts_of_label), rows


def _subject_columns(table: Table, frame: "pd.DataFrame") -> list[str]:
    """Return the names of the columns whose texts distinguish the subjects of rows.

    The subject of a row is what its numbers describe, such as a pole. The caller groups the
    rows by these columns. A column with the same text in all rows is left out.

    Parameters
    ----------
    table
        The declaration of the table: kinds and units of its columns.
    frame
        The columns of the table.
    """
    names = []
    for column in table.columns:
        # The user's name of the assembly mode is no subject.
        is_mode_name = column == MODE_NAME
        if column.kind != "text" or is_mode_name:
            continue
        if frame[column.name].nunique() > 1:
            names.append(column.name)
    return names


def _interrupt(x: Floats, y: Floats, turn: float | None) -> tuple[Floats, Floats]:
    """Return the points of a curve with a gap (NaN) where an angle on the axis x jumps.

    Without the gap, a line would cross the whole figure. An angle jumps if it changes by
    half a turn or more between two rows.

    Parameters
    ----------
    x, y
        (n,) coordinates of the points.
    turn
        A whole turn in the unit of x, None if x is not an angle.
    """
    if turn is None:
        return x, y
    jumps = np.flatnonzero(np.abs(np.diff(x)) >= 0.5 * turn) + 1
    return np.insert(x, jumps, np.nan), np.insert(y, jumps, np.nan)
