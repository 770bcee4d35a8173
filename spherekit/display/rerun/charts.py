"""Charts of series (plotted quantities): curves over one axis, or a map over two."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats, Integers
from spherekit.display.rerun import shapes
from spherekit.display.rerun.chart_frame import (
    CHART_WIDTH,
    FRAME_HEIGHT,
    LABEL_DROP,
    LEFT_MARGIN,
    LEGEND_WIDTH,
    PORTRAIT_WIDTH,
    TOP_MARGIN,
    axis_side,
    draw_frame,
    draw_lines,
    draw_words,
    fraction_of_range,
    frame_side,
    place_in_frame,
    vertical_lines,
)
from spherekit.display.rerun.destination import Columns, Stills
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.geometry.vectors import nans
from spherekit.scenes import colours
from spherekit.scenes.plot_layout import (
    TURN_BY_UNIT,
    break_at_jumps,
    choose_plot_range,
    clip_to_frame,
    quantity_scale,
)
from spherekit.scenes.scene import Axis, InputMarks, Series
from spherekit.wording import listing

MAX_LEGEND_LETTERS = 17
"""Letters of a name for which the legend has space."""

MIN_LEGEND_LINE = 25.0
MAX_LEGEND_LINE = 36.0
"""Heights of a line of the legend: the least, and the height if there are few lines.

Lines of the second height do not overlap in small windows either.
"""

LEGEND_ROWS = int(FRAME_HEIGHT / MIN_LEGEND_LINE)
"""Largest number of lines of a column of the legend."""

MAX_LEGEND_COLUMNS = 2

MAX_SHOWN_LABELS = 24
"""Number of marks above which a label is shown only when its mark is pointed at."""

MAP_SCALE_GAP = 24.0
MAP_SCALE_WIDTH = 20.0
MAP_SCALE_TEXT_GAP = 40.0
"""Distance from a map to its scale of colours, the width of the scale, and the distance
from the scale to the middles of its numbers."""


@dataclass(frozen=True)
class SeriesBlock:
    """Values of a plotted quantity (series) at some consecutive samples.

    A recording is written block by block. The blocks are joined when the chart is drawn.

    Attributes
    ----------
    axes
        The values (rows,) over which the quantity is drawn: one axis, or two for a map.
    series
        The series with its values (rows,).
    """

    axes: tuple[Axis, ...]
    series: Series


@dataclass
class Chart:
    """A chart of the viewer: curves over one axis, or a map of one quantity over two axes.

    Attributes
    ----------
    title
        Heading of the chart.
    axes
        The axes over which the chart is drawn, with the first block of their values.
    curves
        The blocks of each series (plotted quantity) so far, by the path of the series in
        the recording.
    tints
        The colour of each series.
    legend_columns
        Number of columns of the legend; 0 until `width` chooses it.
    """

    title: str
    axes: tuple[Axis, ...]
    curves: dict[str, list[SeriesBlock]] = field(default_factory=dict)
    tints: dict[str, colours.Colour] = field(default_factory=dict)
    legend_columns: int = 0

    @property
    def is_map(self) -> bool:
        """Whether the chart is drawn over two quantities."""
        return len(self.axes) > 1

    @property
    def width(self) -> float:
        """The width of the frame, which leaves space for the legend.

        The first call fixes the number of columns of the legend. Curves that are added
        later do not change the width. The cursor (a line at the present sample) already has
        a position that depends on the width.
        """
        if self.is_map:
            return PORTRAIT_WIDTH
        if not self.legend_columns:
            columns = -(-len(self.curves) // LEGEND_ROWS)  # rounded up
            self.legend_columns = min(columns, MAX_LEGEND_COLUMNS)
        return CHART_WIDTH - LEFT_MARGIN - self.legend_columns * LEGEND_WIDTH

    def add(self, path: str, series: Series, axes: tuple[Axis, ...]) -> None:
        """Add a block of rows to the series at a path. A new series gets a new colour."""
        if path not in self.curves:
            used_colours = [*self.tints.values()]
            self.tints[path] = colours.series_colour(series.link, used_colours)
        block = SeriesBlock(axes, replace(series, values=series.values.copy()))
        self.curves.setdefault(path, []).append(block)

    def joined_blocks(self, path: str) -> tuple[list[Floats], Floats]:
        """Return all values of a series so far, from all its blocks.

        A series is a plotted quantity. A recording is written in blocks of consecutive rows
        (samples).

        Parameters
        ----------
        path
            The path of the series.

        Returns
        -------
        The values (rows,) on each axis of the plot (an input or the time), and the values
        (rows,) of the series.
        """
        blocks = self.curves[path]
        axis_values = [
            np.concatenate([block.axes[number].values for block in blocks])
            for number in range(len(blocks[0].axes))
        ]
        return axis_values, np.concatenate([block.series.values for block in blocks])

    def x_places(self, values: Floats) -> Floats:
        """Return where values of the first axis are in the frame, in units of the chart."""
        return self.width * fraction_of_range(values, *self.axes[0].extent)

    def cursor_columns(self, axis_values: Sequence[Floats]) -> Columns:
        """Return the cursor, which marks the present sample: a line, or a point on a map.

        The result has one cursor for each row (sample), in the form of the library rerun.

        Parameters
        ----------
        axis_values
            The values (rows,) on each axis.
        """
        x = self.x_places(axis_values[0])
        if self.is_map:
            fraction = fraction_of_range(axis_values[1], *self.axes[1].extent)
            y = FRAME_HEIGHT * (1.0 - fraction)  # the viewer's y points down
            return rr.Points2D.columns(positions=np.stack([x, y], axis=1))
        return rr.LineStrips2D.columns(strips=[*vertical_lines(x)])

    def legend(self, paths: Collection[str]) -> tuple[Floats, list[colours.Colour]]:
        """Return the positions and colours of names in the legend of the chart.

        The legend is to the right of the frame. The legend has a line for each series of
        the chart, requested or not. A map (one series over two axes, drawn in colours) has
        a single name.

        Parameters
        ----------
        paths
            The paths of the k series that are requested.

        Returns
        -------
        Positions (k, 2) in units of the chart, y down, and k colours. Both are in the order
        of the series in the chart.
        """
        tints = [self.tints[path] for path in self.curves if path in paths]
        if self.is_map:  # the name is in the upper right corner of the chart
            return np.array([[self.width + 0.5 * LEGEND_WIDTH, -TOP_MARGIN]]), tints
        numbers = [number for number, path in enumerate(self.curves) if path in paths]
        # The lines fill one column of the legend after the other.
        column, row = np.divmod(numbers, LEGEND_ROWS)
        line_height = _legend_line_height(min(len(self.curves), LEGEND_ROWS))
        x = self.width + (column + 0.5) * LEGEND_WIDTH
        # The viewer writes a text `LABEL_DROP` below its position, so the position is
        # higher.
        y = line_height * (row + 0.5) - LABEL_DROP
        return np.stack([x, y], axis=1), tints

    def draw(self, marks: Sequence[InputMarks] = ()) -> Stills:
        """Yield what does not move in the chart: frame, curves or map, and marks.

        Each item is the name of a part, such as ``frame``, and its data. The caller stores
        the data once in a recording for the viewer rerun. Data in a recording have paths,
        like files: the name of a part follows the path of the chart. A recording is written
        in blocks of consecutive rows (samples). The curves show the rows of all blocks so
        far.

        Parameters
        ----------
        marks
            Inputs (deg) that are marked by vertical lines, if the first axis is in deg.
        """
        if self.is_map:
            yield from self._draw_map()
            return
        # All blocks of a series (plotted quantity) have the same unit and resolution, so
        # the first blocks are read. The resolution of a series is a relative change. A
        # change below the resolution times the `scale` of the values is a rounding error.
        first_series = [blocks[0].series for blocks in self.curves.values()]
        unit = first_series[0].unit
        resolution = max(series.resolution for series in first_series)
        # If values differ by rounding only, the range of the vertical axis is so wide that
        # the curve looks straight.
        rows_by_path = {path: self.joined_blocks(path) for path in self.curves}
        all_values = np.concatenate([values for _, values in rows_by_path.values()])
        scale = quantity_scale(all_values, unit)
        y_range = choose_plot_range(all_values, scale, resolution)
        x_axis = self.axes[0]
        no_title = ""
        y_side = frame_side(no_title, y_range, is_degrees=unit == "deg")
        yield from draw_frame(self.width, axis_side(x_axis), y_side)

        for number, (path, (axis_values, values)) in enumerate(rows_by_path.items()):
            # A chart of curves has one axis.
            lines = self._curve_lines(axis_values[0], values, y_range, unit)
            if lines:
                yield f"curves/{number}", draw_lines(lines, self.tints[path])
        if x_axis.unit == "deg":
            yield from self._draw_marks(marks)

    def _curve_lines(
        self, axis_values: Floats, values: Floats, y_range: tuple[float, float], unit: str
    ) -> list[Floats]:
        """Return the lines (points, 2) of a curve, in units of the chart.

        In these units the frame is `width` wide and `FRAME_HEIGHT` high. A curve of angles
        is broken where it jumps by half a turn or more. Every curve is cut where it leaves
        the frame through its upper or lower side.

        Parameters
        ----------
        axis_values, values
            (rows,) values on the horizontal axis, and values of the series.
        y_range
            Lowest and highest value in the frame of the chart.
        unit
            Unit of the values.
        """
        x = fraction_of_range(axis_values, *self.axes[0].extent)
        turn = TURN_BY_UNIT.get(unit)  # None if the values are no angles
        unbroken = np.stack([x, values], axis=1)
        in_frame = clip_to_frame(break_at_jumps(unbroken, y_range, turn), y_range)
        y = fraction_of_range(in_frame[:, 1], *y_range)
        fractions = np.stack([in_frame[:, 0], y], axis=1)
        return shapes.split_at_nan(place_in_frame(fractions, self.width))

    def _draw_marks(self, marks: Sequence[InputMarks]) -> Stills:
        """Yield a vertical line with its name at each marked input."""
        for number, mark in enumerate(marks):
            if mark.inputs.shape[1:] != (1,):  # marks of several inputs are no lines
                continue
            x = self.x_places(mark.inputs[:, 0])
            x = x[(x >= 0.0) & (x <= self.width)]
            tint = colours.tone_colour(mark.tone)
            yield f"marks/{number}", draw_lines([*vertical_lines(x)], tint, width=0.9)
            # The names of one item of `marks` are in one row. Successive items use an upper
            # and a lower row in turn, so that names overlap less.
            y = MIN_LEGEND_LINE * (number % 2 - 0.4)
            names = [(line_x, y, mark.label) for line_x in x]
            are_names_shown = len(x) <= MAX_SHOWN_LABELS
            yield f"marks/{number}/words", draw_words(names, tint, are_names_shown)

    def _draw_map(self) -> Stills:
        """Yield a map with its frame, its scale of colours, and the numbers at the scale.

        A map shows one quantity over two inputs by colours, as an image. The scale of
        colours is in the same image, to the right.
        """
        (path,) = self.curves  # a map has one series (plotted quantity)
        # A series consists of blocks of successive samples. All blocks have the same unit
        # and resolution.
        first_block = self.curves[path][0]
        series = first_block.series
        # Values on the two axes, and the quantity (len(x), len(y)), NaN where there is no
        # sample.
        x, y, cells = grid_values(*self.joined_blocks(path))
        x_axis, y_axis = self.axes[:2]  # the first two inputs
        yield from draw_frame(
            self.width, axis_side(x_axis), axis_side(y_axis), has_grid=False
        )
        # The image has `self.width` columns of pixels and `FRAME_HEIGHT` rows. Each pixel
        # shows the nearest sample. The top row of the picture is the highest y.
        column_samples = _nearest_sample(x, x_axis.extent, round(self.width))
        row_samples = _nearest_sample(y, y_axis.extent, round(FRAME_HEIGHT))[::-1]
        # The picture has rows and columns, so y comes before x.
        pixel_values = cells.T[row_samples][:, column_samples]
        # Values of the first and the last colour. Changes below `resolution` times the
        # largest value are rounding errors. If there are no other changes, the range is so
        # wide that the map has one colour.
        magnitude = quantity_scale(cells, series.unit)
        low, high = choose_plot_range(
            cells, magnitude, series.resolution, shown_by="colours"
        )
        yield "map", rr.Image(_map_picture(pixel_values, low, high))
        yield "scale", draw_words(self._scale_words(low, high))

    def _scale_words(self, low: float, high: float) -> list[tuple[float, float, str]]:
        """Return the texts at the colour scale of a map: round values, and their positions.

        Parameters
        ----------
        low, high
            Values at the bottom and at the top of the scale.

        Returns
        -------
        For each value its position x, y in units of the chart, y down, and its text.
        """
        x = self.width + MAP_SCALE_GAP + MAP_SCALE_WIDTH + MAP_SCALE_TEXT_GAP
        words = []
        # A tick is a fraction of the height of the scale, and a text. The viewer writes a
        # text `LABEL_DROP` below its position.
        for fraction, text in frame_side("", (low, high)).ticks:
            words.append((x, FRAME_HEIGHT * (1.0 - fraction) - LABEL_DROP, text))
        return words


def compare_modes(charts: Sequence[Chart]) -> Chart:
    """Return one chart with the curves of several charts, one chart per assembly mode.

    An assembly mode is one way to assemble the mechanism at the same inputs. The curves of
    the first mode have full colours. The curves of each later mode have a lighter shade of
    these colours.
    """
    comparison = replace(charts[0], curves={}, tints={})
    for number, chart in enumerate(charts):
        comparison.curves |= chart.curves
        for path, tint in chart.tints.items():
            comparison.tints[path] = colours.lighten(tint, number)
    return comparison


def cursor_style(chart: Chart) -> rr.AsComponents:
    """Return the appearance of the cursor of a chart."""
    if chart.is_map:
        return dot_style()
    return rr.LineStrips2D.from_fields(
        colors=colours.SILVER, radii=rr.Radius.ui_points(0.6)
    )


def dot_style() -> rr.Points2D:
    """Return the appearance of the dot that moves on a map or a curve."""
    return rr.Points2D.from_fields(colors=colours.GOLD, radii=rr.Radius.ui_points(5.0))


def legend_places(width: float, count: int) -> Floats:
    """Return the positions (count, 2) of the names of the legend, right of a frame.

    The positions are in units of the chart, in one column.

    Parameters
    ----------
    width
        Width of the frame, in units of the chart.
    count
        Number of names.
    """
    y = _legend_line_height(count) * (np.arange(count) + 0.5) - LABEL_DROP
    return np.stack([np.full(count, width + 0.5 * LEGEND_WIDTH), y], axis=1)


def legend_style(
    places: Floats, tints: Sequence[colours.Colour], names: Sequence[str] | None = None
) -> rr.AsComponents:
    """Return the names in the legend of a chart, as points of size 0 with labels.

    Parameters
    ----------
    places, tints
        (k, 2) position of each name in the chart, and the k colours of the names.
    names
        The names, if they never change. None if the names contain values of the current row
        (sample in an assembly mode). The caller then logs the names for each row.
    """
    return rr.Points2D.from_fields(
        positions=places, colors=tints, radii=0.0, show_labels=True, labels=names
    )


def legend_texts(legend_series: Sequence[Series]) -> list[str]:
    """Return the texts of a legend: the name of each series with its value in each row.

    A row is one sample. While the viewer plays a recording, the legend shows the values of
    the current row. Angles, rates and pure numbers below the `resolution` of a series are
    rounding errors and are written as 0. Torques and the like may be small, so all their
    digits count.

    Parameters
    ----------
    legend_series
        All series of the legend, with their values in consecutive rows.

    Returns
    -------
    The texts of the first row, then the texts of the second row, and so on.
    """
    texts_of_series = []
    for series in legend_series:
        name = series.label
        if len(name) > MAX_LEGEND_LETTERS:
            name = f"{name[: MAX_LEGEND_LETTERS - 1]}…"
        # Values below `smallest` are written as 0. Without values, `quantity_scale` returns
        # its lower limit: 0 for torques and the like, 1 for other quantities.
        smallest = series.resolution * quantity_scale(nans(0), series.unit)
        numbers = [_number_text(x, smallest) for x in series.values.tolist()]
        texts_of_series.append([f"{name}  {number}" for number in numbers])
    return [text for row in zip(*texts_of_series, strict=True) for text in row]


def path_axis(axes: Sequence[Axis]) -> Axis:
    """Return one axis for samples on a path of several inputs.

    The result is the axis of the first input that moves, or the first axis if no input
    moves. The label of this axis names all other inputs.
    """
    moving_axes = [axis for axis in axes if axis.extent[0] < axis.extent[1]]
    path_input = (moving_axes or axes)[0]
    further_labels = [axis.label for axis in axes if axis is not path_input]
    label = f"input {path_input.label} with {listing(further_labels)}"
    return replace(path_input, label=label)


def grid_values(
    axis_values: Sequence[Floats], values: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the values of a series as a grid over its first two axes, for a map.

    With more than two axes, only the middle value of each further axis is used.

    Parameters
    ----------
    axis_values
        The values (rows,) on each axis. A row is one sample.
    values
        The values (rows,) of the series.

    Returns
    -------
    The different values (x,) on the first and (y,) on the second axis, increasing. Then the
    values (x, y) of the series, NaN where there is no row.
    """
    is_chosen = np.ones(len(values), bool)
    for further_values in axis_values[2:]:
        samples = np.unique(further_values)
        is_chosen &= further_values == samples[len(samples) // 2]
    x, x_index = np.unique(axis_values[0][is_chosen], return_inverse=True)
    y, y_index = np.unique(axis_values[1][is_chosen], return_inverse=True)
    cells = nans((len(x), len(y)))
    cells[x_index, y_index] = values[is_chosen]
    return x, y, cells


def _legend_line_height(count: int) -> float:
    """Return the height of each of `count` lines in a column of the legend."""
    return min(MAX_LEGEND_LINE, max(MIN_LEGEND_LINE, FRAME_HEIGHT / max(count, 1)))


def _number_text(value: float, smallest: float) -> str:
    """Return a value of a legend: a dash for NaN, and 0 for magnitudes below `smallest`."""
    if np.isnan(value):
        return "\u2013"
    if abs(value) < smallest:
        return "0"
    return f"{value:.4g}".replace("-", "\u2212")


def _nearest_sample(
    samples: Floats, value_range: tuple[float, float], pixel_count: int
) -> Integers:
    """Return for each pixel of a map the index (pixels,) of the nearest sample.

    Parameters
    ----------
    samples
        Increasing values of an input at the samples.
    value_range
        Lowest and highest value of the input. The pixels divide this range into equal
        parts.
    pixel_count
        Number of pixels.
    """
    low, high = value_range
    pixel_values = low + (high - low) * (np.arange(pixel_count) + 0.5) / pixel_count
    middles = 0.5 * (samples[1:] + samples[:-1])  # where the nearest sample changes
    return np.searchsorted(middles, pixel_values).astype(np.int64)


def _map_picture(values: Floats, low: float, high: float) -> NDArray[np.uint8]:
    """Return the image of a map of colours, with the scale of colours to its right.

    Parameters
    ----------
    values
        (height, width) value of each pixel, the top row first. Pixels without a value are
        NaN and get the colour of the background.
    low, high
        Values at the ends of the scale of colours.

    Returns
    -------
    (height, width of the map and its scale, 3) red, green and blue from 0 to 255.
    """
    height, width = values.shape
    full_width = width + round(MAP_SCALE_GAP + MAP_SCALE_WIDTH)
    picture = np.full((height, full_width, 3), colours.BACKGROUND, np.uint8)

    map_pixels = colours.heat_colours(values, low, high)
    map_pixels[~np.isfinite(values)] = colours.BACKGROUND
    picture[:, :width] = map_pixels

    # The scale has the highest value at the top. A pixel at the fraction f of its height
    # has the colour of low + f (high - low).
    colour_column = colours.heat_colours(np.linspace(1.0, 0.0, height))
    picture[:, -round(MAP_SCALE_WIDTH) :] = colour_column[:, None]
    return picture
