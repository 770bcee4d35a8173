"""Diagrams: points and straight lines in a plane with equal scales on the two axes."""

from collections.abc import Iterator

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.display.rerun.chart_frame import (
    CHART_BOUNDS,
    FRAME_HEIGHT,
    LABEL_DROP,
    LEFT_MARGIN,
    LEGEND_WIDTH,
    draw_frame,
    frame_side,
)
from spherekit.display.rerun.charts import legend_places, legend_style
from spherekit.display.rerun.destination import Columns, Stills
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.geometry.vectors import all_finite
from spherekit.scenes import colours
from spherekit.scenes.plot_layout import place_labels
from spherekit.scenes.scene import Diagram

MAX_LISTED_READINGS = 14
"""Number of readings (angles of points) for which the legend has space."""

LETTER_WIDTH = 20.0
"""Width of a letter of a name, from which the distance between names is computed."""

STEP_TEXT_DROP = 46.0
"""Distance from the frame down to the text of a step."""

DIAGRAM_POINT_RADIUS = 4.0
DIAGRAM_LEADER_WIDTH = 0.7
DIAGRAM_LINE_WIDTH = 1.0
"""Radius of points, and widths of leaders and lines, in points of the screen."""

Moving = tuple[str, Columns]
"""Path below a primitive, and its columns for one block of rows."""


def draw_static(diagram: Diagram) -> Stills:
    """Yield what is the same in all rows of a diagram: its frame, line widths and colours.

    A diagram shows points and straight lines in a plane, which move from row to row. A row
    is a sample of a motion, or a step of a geometric construction. The results are logged
    once for all rows. They are the frame, the line widths, and the colours of lines, legend
    and step. `moving_columns` yields the rest: the positions and texts of all rows, and the
    colours of points and names.

    Each part is an entity (a name in the tree of the viewer rerun). The parts that move are
    ``points``, their ``names``, straight ``lines``, ``leaders`` (thin lines from a point to
    its name), ``legend`` and ``step``. If the diagram has `readings`, which are two angles
    of each point, the legend lists them. The part ``step`` is a text below the frame that
    explains the current row.

    Yields
    ------
    The name of each part below the path of the diagram, and the data to log there.
    """
    width = _frame_width(diagram)
    x = frame_side(diagram.x_label, diagram.x_range)
    y = frame_side(diagram.y_label, diagram.y_range)
    yield from draw_frame(width, x, y)
    yield "points", rr.Points2D.from_fields(radii=rr.Radius.ui_points(DIAGRAM_POINT_RADIUS))
    # The viewer writes texts only as labels of points. The radius 0 hides the point itself.
    yield "names", rr.Points2D.from_fields(radii=0.0, show_labels=True)
    for name, colour, line_width in (
        ("leaders", colours.GRATICULE, DIAGRAM_LEADER_WIDTH),
        ("lines", colours.VIOLET, DIAGRAM_LINE_WIDTH),
    ):
        radius = rr.Radius.ui_points(line_width)
        yield name, rr.LineStrips2D.from_fields(colors=colour, radii=radius)
    if diagram.readings is not None:
        # The tone of a point is the index of its colour. Its angles in the legend have the
        # same colour.
        tints = [colours.tone_colour(tone) for tone in diagram.tones[:MAX_LISTED_READINGS]]
        yield "legend", legend_style(legend_places(width, len(tints)), tints)
    yield "step", rr.Points2D.from_fields(radii=0.0, show_labels=True, colors=colours.PALE)


def moving_columns(diagram: Diagram) -> Iterator[Moving]:
    """Yield the parts of a diagram that move, for all rows of a recording at once.

    A row is the diagram at one sample of a motion, or in one step of a construction. The
    parts are points, their names, straight lines, and leaders (thin lines from a point to
    its name). If the diagram has two angles for each point (`readings`), a legend lists
    their numbers. If each row has a text (`words`), the text is written below the
    frame.

    Yields
    ------
    For each part its path below the path of the diagram, and the data of all its rows as
    columns for the viewer rerun (`rr`).
    """
    is_visible = _is_in_frame(diagram)
    # `_place` converts positions from units of the diagram's axes, with y up, to units of
    # the chart, with y down.
    places = _place(diagram, diagram.places)
    # Each name is written at its point, or beside the point if names would cover each
    # other. Hidden points (NaN) need no space for a name.
    visible_places = np.where(is_visible[..., None], places, np.nan)
    name_places = place_labels(diagram.names, visible_places, LETTER_WIDTH)

    yield "points", _point_columns(diagram, places, is_visible)
    yield "names", _name_columns(diagram, name_places, is_visible)
    yield "leaders", _leader_columns(places, name_places, is_visible)
    yield "lines", _line_columns(diagram)
    if diagram.readings is not None:
        yield "legend", _reading_columns(diagram)
    if diagram.words:
        place = [0.5 * _frame_width(diagram), FRAME_HEIGHT + STEP_TEXT_DROP]
        step_places = np.tile(place, (len(diagram.places), 1))
        yield "step", rr.Points2D.columns(positions=step_places, labels=diagram.words)


def _is_in_frame(diagram: Diagram) -> Bools:
    """Return a mask (rows, points) of the points within the frame of the diagram."""
    low, high = np.transpose([diagram.x_range, diagram.y_range])  # corners (x, y)
    is_in_frame: Bools = np.all((diagram.places >= low) & (diagram.places <= high), axis=2)
    return is_in_frame


def _point_columns(diagram: Diagram, places: Floats, is_visible: Bools) -> Columns:
    """Return the places and colours of the visible points, as columns for the viewer.

    Parameters
    ----------
    diagram
        The diagram, with the colours of the points.
    places
        (rows, points, 2) places in units of the chart; a row is the diagram at one sample.
    is_visible
        (rows, points) whether a point is within the frame.
    """
    # The column lists the visible points of all rows, one row after another. `partition`
    # divides the list into rows by the number of visible points in each row.
    points = rr.Points2D.columns(
        positions=places[is_visible], colors=_visible_colours(diagram, is_visible)
    )
    return points.partition(is_visible.sum(axis=1))


def _name_columns(diagram: Diagram, name_places: Floats, is_visible: Bools) -> Columns:
    """Return places, texts and colours of the names of visible points, as viewer columns.

    Parameters
    ----------
    diagram
        The diagram, with the names and colours of the points.
    name_places
        (rows, points, 2) places of the names in units of the chart, with y down. A row is
        the diagram at one sample.
    is_visible
        (rows, points) whether a point is within the frame. Only the names of these points
        are written.
    """
    row_count = len(is_visible)
    # The viewer writes a text `LABEL_DROP` below its position, so names are moved up
    # (towards negative y) by this length.
    positions = name_places[is_visible] - [0.0, LABEL_DROP]
    names = rr.Points2D.columns(
        positions=positions,
        labels=np.tile(diagram.names, (row_count, 1))[is_visible].tolist(),
        colors=_visible_colours(diagram, is_visible),
    )
    # The columns list the names of all rows, one row after another. `partition` divides
    # them by the number of names in each row.
    return names.partition(is_visible.sum(axis=1))


def _visible_colours(diagram: Diagram, is_visible: Bools) -> np.ndarray:
    """Return the colours (visible points of all rows, 3), red, green and blue."""
    # Each point has a `tone`, the number of a colour.
    point_colours = [colours.tone_colour(tone) for tone in diagram.tones]
    # (points, 3); `reshape` keeps three columns even if there are no points
    rgb = np.reshape(point_colours, (-1, 3)).astype(np.uint8)
    visible_rgb: np.ndarray = np.broadcast_to(rgb, (*is_visible.shape, 3))[is_visible]
    return visible_rgb


def _leader_columns(places: Floats, name_places: Floats, is_visible: Bools) -> Columns:
    """Return the lines that lead from each visible point to its name, for each row.

    A row is one sample. The result is in the form of the library rerun.

    Parameters
    ----------
    places, name_places
        (rows, points, 2) places of the points and of their names, in the units of the
        chart.
    is_visible
        (rows, points) whether a point is drawn.
    """
    leaders = np.stack([places[is_visible], name_places[is_visible]], axis=1)
    columns = rr.LineStrips2D.columns(strips=list(leaders))
    return columns.partition(is_visible.sum(axis=1))


def _line_columns(diagram: Diagram) -> Columns:
    """Return the parts of the lines of all rows that are within the frame."""
    ends, is_line_visible = clip_lines(diagram)
    lines = rr.LineStrips2D.columns(strips=_place(diagram, ends)[is_line_visible])
    return lines.partition(is_line_visible.sum(axis=1))


def _reading_columns(diagram: Diagram) -> Columns:
    """Return the legend of a diagram for each row (sample): each point with two angles.

    The two angles of a point are called its readings. The legend lists them in degrees, for
    the first `MAX_LISTED_READINGS` points at most.
    """
    assert diagram.readings is not None
    readings = np.degrees(diagram.readings[:, :MAX_LISTED_READINGS])
    first_name, second_name = diagram.reading_names
    words = [
        f"{name}  {first_name} {_angle_text(first)}  {second_name} {_angle_text(second)}"
        for row in readings.tolist()
        for name, (first, second) in zip(diagram.names, row, strict=False)
    ]
    # `words` lists the texts of all rows one after the other. `partition` divides this list
    # into rows of equal length.
    row_count, words_per_row, _ = readings.shape
    return rr.Points2D.columns(labels=words).partition([words_per_row] * row_count)


def _angle_text(degrees: float) -> str:
    """Return an angle with one decimal; a dash for NaN."""
    if np.isnan(degrees):
        return "\u2013"
    return f"{degrees:z.1f}\u00b0".replace("-", "\u2212")  # z: no minus before 0.0


def clip_lines(diagram: Diagram) -> tuple[Floats, np.ndarray]:
    """Return the part of each straight line of a diagram that is within the frame.

    A line (a, b, c) consists of the points with a x + b y + c = 0. Let f be the point of
    the line nearest to the origin, and d the unit vector along the line. All points of the
    line are f + t d with a number t. One interval of t is within the x limits of the frame,
    another interval within the y limits. The visible part is the intersection of the two
    intervals.

    Returns
    -------
    ends
        (rows, lines, 2, 2) the two ends (third axis) of the visible part, each with x and
        y. A row is the diagram at one sample.
    is_visible
        (rows, lines) whether the line crosses the frame at all.
    """
    normal = diagram.lines[..., :2]  # (rows, lines, 2)
    c = diagram.lines[..., 2:]  # (rows, lines, 1)
    # For a line parallel to a side, the division by zero gives infinite limits of t. For a
    # line that lies on a side, the division gives NaN, and the line counts as not visible.
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        foot = -normal * (c / length**2)  # f
        a_and_b = normal / length
        direction = np.stack([-a_and_b[..., 1], a_and_b[..., 0]], axis=-1)  # d
        x_enter, x_leave = _line_interval(foot[..., 0], direction[..., 0], diagram.x_range)
        y_enter, y_leave = _line_interval(foot[..., 1], direction[..., 1], diagram.y_range)
        enter = np.maximum(x_enter, y_enter)
        leave = np.minimum(x_leave, y_leave)
        first_end = foot + enter[..., None] * direction
        second_end = foot + leave[..., None] * direction
    ends = np.stack([first_end, second_end], axis=-2)
    is_visible = (enter < leave) & all_finite(ends, (-1, -2))
    return ends, is_visible


def _line_interval(
    foot: Floats, direction: Floats, limits: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Return the interval of t in which one coordinate of a line is within limits.

    The points of a straight line are foot + t direction. The foot is its point nearest to
    the origin. One call treats one coordinate, x or y. `clip_lines` intersects the
    intervals of both.

    If the coordinate does not change along a line, a division by zero makes t infinite. If
    the coordinate is within the limits, the interval is from -inf to inf. If it is outside,
    both ends are the same infinity. If it is at a limit, both ends are NaN.

    Parameters
    ----------
    foot, direction
        (rows, lines) this coordinate of the foot of each line, and of its unit vector.
    limits
        Lower and upper limit of the coordinate.

    Returns
    -------
    (rows, lines) smallest and largest t.
    """
    low, high = limits
    t_at_low = (low - foot) / direction
    t_at_high = (high - foot) / direction
    return np.minimum(t_at_low, t_at_high), np.maximum(t_at_low, t_at_high)


def view_bounds(diagram: Diagram) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the part of the plane (x and y range) that a view of a diagram shows."""
    right_margin = LEFT_MARGIN if diagram.readings is None else LEGEND_WIDTH
    _, (top, bottom) = CHART_BOUNDS
    x_range = (-LEFT_MARGIN, _frame_width(diagram) + right_margin)
    return x_range, (top, bottom + LABEL_DROP)


def _frame_width(diagram: Diagram) -> float:
    """Return the width of the frame, in which the two axes have equal scales."""
    left, right = diagram.x_range
    low, high = diagram.y_range
    return FRAME_HEIGHT * (right - left) / (high - low)


def _place(diagram: Diagram, points: Floats) -> Floats:
    """Return points (..., 2) of a diagram in units of the chart, where y points down."""
    left, _ = diagram.x_range
    low, high = diagram.y_range
    scale = FRAME_HEIGHT / (high - low)
    return (points - [left, high]) * [scale, -scale]
