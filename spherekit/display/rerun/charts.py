"""Plots over a quantity and maps over two, drawn in the plane: the viewer has none.

A chart is `WIDTH` x `HEIGHT` units, y down, one unit a pixel of the pictures in it; the
frame of its axes has its upper left corner at the origin, and the legend is beside it.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.display.rerun import shapes
from spherekit.display.rerun.destination import Columns, Stills
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.geometry.vectors import nans
from spherekit.scenes import colours
from spherekit.scenes.plot_layout import (
    MARGIN,
    MOST_KINDS,
    TURNS,
    broken,
    cut,
    plotted_range,
    scale_of,
)
from spherekit.scenes.scene import Axis, InputMarks, Portrait, Primitive, Series, titled
from spherekit.wording import listing

WIDTH, HEIGHT = 930.0, 372.0
LEFT, TOP, BOTTOM = 92.0, 32.0, 66.0
LEGEND = 235.0
"""Width of one column of the legend."""
LONGEST = 17
"""Letters of a name for which the legend has room."""
LINE = 25.0
"""Least height of one line of it."""
WIDEST_LINE = 36.0
"""Height of one line of few, which keep apart in a small window too."""
LABEL = 14.0
"""The viewer writes a label so far below its point."""
FRAME_HEIGHT = HEIGHT - TOP - BOTTOM
PORTRAIT_WIDTH = WIDTH - LEFT - LEGEND
MOST_LABELS = 24
"""With more marks than this, their labels are seen when they are pointed at."""
BAR = (24.0, 20.0)
"""Between a map and its scale of colours, and the width of that."""
TICKS = 5
ROWS = int(FRAME_HEIGHT / LINE)
"""Most lines of a column of the legend."""
MOST_COLUMNS = 2
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
ANGLE_STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0, 360.0)

BOUNDS = (-LEFT, WIDTH - LEFT), (-TOP, HEIGHT - TOP)
"""What of the plane a view of a chart shows."""
SCALE_BOUNDS = ((-40.0, WIDTH + 40.0), (-46.0, 62.0))
"""What a view of a scale of colours shows."""


def _line(count: int) -> float:
    """Return the height of each of so many lines in a column of the legend."""
    return min(WIDEST_LINE, max(LINE, FRAME_HEIGHT / count))


Block = tuple[tuple[Axis, ...], Series]
"""Some rows of a series, and what these are over."""


@dataclass
class Chart:
    """Curves over one axis, or one series over two: a map."""

    title: str
    over: tuple[Axis, ...]
    curves: dict[str, list[Block]] = field(default_factory=dict)
    """Their series by their paths, block by block."""
    tints: dict[str, colours.Colour] = field(default_factory=dict)
    columns: int = 0
    """Of the legend, if not as many as its curves need."""

    @property
    def is_map(self) -> bool:
        """Whether it is over two quantities."""
        return len(self.over) > 1

    @property
    def width(self) -> float:
        """The width of the frame, beside which the legend has its place."""
        if self.is_map:
            return PORTRAIT_WIDTH
        if not self.columns:
            self.columns = min(-(-len(self.curves) // ROWS), MOST_COLUMNS)
        return WIDTH - LEFT - self.columns * LEGEND

    def add(self, path: str, series: Series, over: tuple[Axis, ...]) -> None:
        """Take a block of a series, a new one in a colour of its own."""
        if path not in self.curves:
            self.tints[path] = colours.of_series(series.link, [*self.tints.values()])
        self.curves.setdefault(path, []).append(
            (over, replace(series, values=series.values.copy()))
        )

    def whole(self, path: str) -> tuple[list[Floats], Floats]:
        """Return the places on each axis, and the values, of all blocks of a series."""
        blocks = self.curves[path]
        axes = zip(*(over for over, _ in blocks), strict=True)
        places = [np.concatenate([axis.values for axis in every]) for every in axes]
        return places, np.concatenate([series.values for _, series in blocks])

    def across(self, values: Floats) -> Floats:
        """Return where values on the first axis are in the frame."""
        return self.width * _part(values, *self.over[0].extent)

    def cursor(self, rows: Sequence[Floats]) -> Columns:
        """Return a line that moves through the plot, or a mark that moves on the map."""
        x = self.across(rows[0])
        if self.is_map:
            y = FRAME_HEIGHT * (1.0 - _part(rows[1], *self.over[1].extent))
            return rr.Points2D.columns(positions=np.stack([x, y], axis=1))
        return rr.LineStrips2D.columns(strips=[*_upright(x)])

    def legend(self, paths: Collection[str]) -> tuple[Floats, list[colours.Colour]]:
        """Return where the names (k, 2) of some curves are, and their colours."""
        tints = [self.tints[path] for path in self.curves if path in paths]
        if self.is_map:
            return np.array([[self.width + 0.5 * LEGEND, -TOP]]), tints
        numbers = [number for number, path in enumerate(self.curves) if path in paths]
        column, row = np.divmod(numbers, ROWS)
        rows = _line(min(len(self.curves), ROWS)) * (row + 0.5) - LABEL
        return np.stack([self.width + (column + 0.5) * LEGEND, rows], axis=1), tints

    def drawn(self, marks: Sequence[InputMarks] = ()) -> Stills:
        """Yield what stands still: the frame, the curves or the map, marks, words."""
        if self.is_map:
            yield from self._map()
            return
        first = [blocks[0][1] for blocks in self.curves.values()]
        unit, resolution = first[0].unit, max(series.resolution for series in first)
        curves = {path: self.whole(path) for path in self.curves}
        every = np.concatenate([values for _, values in curves.values()])
        span = plotted_range(every, scale_of(every, unit), resolution)
        yield from frame(self.width, side_of(self.over[0]), side("", span, unit == "deg"))
        for number, (path, (rows, values)) in enumerate(curves.items()):
            line = np.stack([_part(rows[0], *self.over[0].extent), values], axis=1)
            line = cut(broken(line, span, TURNS.get(unit)), span)
            line[:, 1] = _part(line[:, 1], *span)
            lines = shapes.unbroken(in_frame(line, self.width))
            if lines:
                yield f"curves/{number}", strips(lines, self.tints[path])
        if self.over[0].unit == "deg":
            yield from self._marked(marks)

    def _marked(self, marks: Sequence[InputMarks]) -> Stills:
        """Yield a line at each place on the axis where something is, with its name."""
        for number, mark in enumerate(marks):
            if mark.inputs.shape[1:] != (1,):
                continue
            x = self.across(mark.inputs[:, 0])
            x = x[(x >= 0.0) & (x <= self.width)]
            tint = colours.tone(mark.tone)
            yield f"marks/{number}", strips([*_upright(x)], tint, 0.9)
            names = [(at, LINE * (number % 2 - 0.4), mark.label) for at in x]
            yield f"marks/{number}/words", _words(names, tint, len(x) <= MOST_LABELS)

    def _map(self) -> Stills:
        (path,) = self.curves
        _, series = self.curves[path][0]
        x, y, cells = gridded(*self.whole(path))
        first, second = self.over[:2]
        yield from frame(self.width, side_of(first), side_of(second), lined=False)
        low, high = plotted_range(
            cells, scale_of(cells, series.unit), series.resolution, "colours"
        )
        across = _nearest(x, first.extent, round(self.width))
        down = _nearest(y, second.extent, round(FRAME_HEIGHT))[::-1]
        shown = cells[np.ix_(across, down)].T
        picture = np.full(
            (len(down), len(across) + round(sum(BAR)), 3), colours.BACKGROUND, np.uint8
        )
        body = colours.heat_of(shown, low, high)
        body[~np.isfinite(shown)] = colours.BACKGROUND
        picture[:, : len(across)] = body
        scale = colours.heat_of(np.linspace(1.0, 0.0, len(down)))
        picture[:, -round(BAR[1]) :] = scale[:, None]
        yield "map", rr.Image(picture)
        words = [
            (self.width + sum(BAR) + 40.0, FRAME_HEIGHT * (1.0 - at) - LABEL, text)
            for at, text in side("", (low, high))[1]
        ]
        yield "scale", _words(words)


def compared(modes: Sequence[Chart]) -> Chart:
    """Return the chart of all modes: the first in full colours, others lighter."""
    whole = replace(modes[0], curves={}, tints={})
    for step, chart in enumerate(modes):
        whole.curves |= chart.curves
        for path, tint in chart.tints.items():
            whole.tints[path] = colours.shaded(tint, step)
    return whole


def cursor_style(chart: Chart) -> rr.AsComponents:
    """Return how the cursor of a chart looks."""
    if chart.is_map:
        return dot()
    return rr.LineStrips2D.from_fields(
        colors=colours.SILVER, radii=rr.Radius.ui_points(0.6)
    )


def dot() -> rr.Points2D:
    """Return how the dot looks that moves on a map or a curve."""
    return rr.Points2D.from_fields(colors=colours.GOLD, radii=rr.Radius.ui_points(5.0))


def listed(width: float, count: int) -> Floats:
    """Return where so many names (count, 2) stand beside a frame, one below the other."""
    rows = _line(count) * (np.arange(count) + 0.5) - LABEL
    return np.stack([np.full(count, width + 0.5 * LEGEND), rows], axis=1)


def legend_style(
    places: Floats, tints: Sequence[colours.Colour], names: Sequence[str] | None = None
) -> rr.AsComponents:
    """Return where the names of curves stand; the names too if they do not change."""
    return rr.Points2D.from_fields(
        positions=places, colors=tints, radii=0.0, show_labels=True, labels=names
    )


Side = tuple[str, Sequence[tuple[float, str]]]
"""The words of an axis of a frame, and the places from 0 to 1 of its ticks with theirs."""


def side(
    words: str,
    span: tuple[float, float],
    degrees: bool = False,
    logarithmic: bool = False,
) -> Side:
    """Return an axis with a span, perhaps of degrees."""
    if logarithmic:
        low, high = np.log10(span)
        powers = np.arange(np.ceil(low - 1e-9), np.floor(high + 1e-9) + 1.0)
        texts = [f"1e{power:z.0f}" for power in powers]
        parts = (powers - low) / max(high - low, 1e-300)
    else:
        step, values = ticks(*span, degrees)
        texts, parts = [written(value, step) for value in values], _part(values, *span)
    return words, [*zip(parts, texts, strict=True)]


def side_of(axis: Axis) -> Side:
    """Return the side of a chart over an axis."""
    return side(axis.words, axis.extent, axis.unit == "deg")


def frame(width: float, x: Side, y: Side, lined: bool = True) -> Stills:
    """Yield the box with its lines, and the words at its axes."""
    lines = [np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])]
    lines += [np.array([[part, 0.0], [part, 1.0]]) for part, _ in x[1]]
    words = [(width * part, FRAME_HEIGHT + 4.0, text) for part, text in x[1]]
    words.append((0.5 * width, FRAME_HEIGHT + 27.0, x[0]))
    for part, text in y[1]:
        lines.append(np.array([[0.0, part], [1.0, part]]))
        words.append((-0.5 * LEFT, FRAME_HEIGHT * (1.0 - part) - LABEL, text))
    if y[0]:
        words.append((0.2 * width, -TOP, f"up: {y[0]}"))
    shown = [in_frame(line, width) for line in (lines if lined else lines[:1])]
    yield "frame", strips(shown, colours.GRATICULE, 0.5)
    yield "words", _words(words)


def roomy(item: Primitive) -> Primitive:
    """Return what is shown; curves of a portrait do not touch its frame."""
    if not isinstance(item, Portrait) or item.logarithmic:
        return item
    low, high = item.y_range
    around = MARGIN * (high - low)
    return replace(item, y_range=(low - around, high + around))


def portrait(item: Portrait) -> Stills:
    """Yield the frame of a portrait, its curves and marks."""
    x, y = (
        side(titled(label, unit), span, unit.startswith("deg"), item.logarithmic)
        for label, unit, span in (
            (item.x_label, item.x_unit, item.x_range),
            (item.y_label, item.y_unit, item.y_range),
        )
    )
    yield from frame(PORTRAIT_WIDTH, x, y)
    for number, curve in enumerate(item.curves):
        placed = item.framed(curve.points)
        yield f"curve_{number}", portrait_line(placed, colours.tone(curve.tone))
    kinds = {mark.label: mark.tone for mark in item.marks}
    named = {curve.label: curve.tone for curve in item.curves if curve.label}
    named |= kinds if len(kinds) <= MOST_KINDS else {}
    if named:
        places = listed(PORTRAIT_WIDTH, len(named))
        yield "legend", legend_style(places, [*map(colours.tone, named.values())], [*named])
    if item.marks:
        places = in_frame(item.framed(np.array([mark.place for mark in item.marks])))
        yield (
            "marks",
            rr.Points2D(
                places,
                labels=[mark.label for mark in item.marks],
                colors=[colours.tone(mark.tone) for mark in item.marks],
                radii=rr.Radius.ui_points(4.0),
                show_labels=len(kinds) > MOST_KINDS and len(places) <= MOST_LABELS,
            ),
        )


def portrait_line(placed: Floats, colour: colours.Colour) -> rr.LineStrips2D:
    """Return a curve of a portrait from its placed points (n, 2)."""
    return strips(shapes.unbroken(in_frame(placed)), colour)


def strips(
    lines: Sequence[Floats], colour: colours.Colour, width: float = 1.0
) -> rr.LineStrips2D:
    """Return polylines (k, 2), so many points wide."""
    return rr.LineStrips2D(lines, colors=colour, radii=rr.Radius.ui_points(width))


def in_frame(placed: Floats, width: float = PORTRAIT_WIDTH) -> Floats:
    """Return points placed from 0 to 1 both ways in a frame, by default a portrait's."""
    return placed * [width, -FRAME_HEIGHT] + [0.0, FRAME_HEIGHT]


def _upright(x: Floats) -> Floats:
    """Return lines (n, 2, 2) from the top to the bottom of a frame."""
    ends = np.zeros((len(x), 2, 2))
    ends[:, :, 0] = x[:, None]
    ends[:, 1, 1] = FRAME_HEIGHT
    return ends


def horizontal_scale(low: float, high: float, label: str) -> Stills:
    """Yield a scale of colours from left to right, `WIDTH` long, with its words."""
    scale = colours.heat_of(np.linspace(0.0, 1.0, round(WIDTH)))
    yield "bar", rr.Image(np.tile(scale, (24, 1, 1)))
    words = [(WIDTH * part, 26.0, text) for part, text in side("", (low, high))[1]]
    yield "words", _words([*words, (0.5 * WIDTH, -44.0, label)])


def gridded(rows: Sequence[Floats], values: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the two first axes of a grid and its values (x, y), NaN where there is none.

    Of further axes the middle value is taken.
    """
    chosen = np.ones(len(values), bool)
    for further in rows[2:]:
        places = np.unique(further)
        chosen &= further == places[len(places) // 2]
    x, across = np.unique(rows[0][chosen], return_inverse=True)
    y, up = np.unique(rows[1][chosen], return_inverse=True)
    cells = nans((len(x), len(y)))
    cells[across, up] = values[chosen]
    return x, y, cells


def ticks(low: float, high: float, degrees: bool) -> tuple[float, Floats]:
    """Return a round step, and its multiples between two values, about `TICKS` of them."""
    wanted = (high - low) / TICKS
    if not 0.0 < wanted < np.inf:
        return 1.0, np.array([low])
    power = 10.0 ** np.floor(np.log10(wanted))
    steps = [power * factor for factor in STEPS]
    if degrees and wanted >= 1.0:
        steps = [*ANGLE_STEPS, *(360.0 * power * factor for factor in STEPS)]
    step = min(steps, key=lambda candidate: abs(np.log(candidate / wanted)))
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    return step, np.arange(first, last + 1.0) * step


def written(value: float, step: float) -> str:
    """Return a tick's number with the digits that its step has."""
    if abs(value) < 1e-9 * step:
        return "0"
    if not 1e-4 <= step < 1e6:
        return f"{value:.4g}"
    digits = max(0, int(np.ceil(-np.log10(step) - 1e-9)))
    if abs(round(step * 10**digits) - step * 10**digits) > 1e-6:
        digits += 1
    return f"{value:.{digits}f}".replace("-", "\u2212")


def legend_words(latest: Sequence[Series]) -> list[str]:
    """Return the names with their values, row after row of the last blocks."""
    columns = []
    for series in latest:
        label = series.label
        short = label if len(label) <= LONGEST else f"{label[: LONGEST - 1]}…"
        numbers = (_number(x, series.resolution) for x in series.values.tolist())
        columns.append([f"{short}  {number}" for number in numbers])
    return [words for row in zip(*columns, strict=True) for words in row]


def along(over: Sequence[Axis]) -> Axis:
    """Return the axis of samples on a path of several inputs: the first one that moves."""
    first = next((axis for axis in over if axis.extent[0] < axis.extent[1]), over[0])
    others = listing(axis.label for axis in over if axis is not first)
    return replace(first, label=f"input {first.label} with {others}")


def _number(value: float, resolution: float) -> str:
    if value != value:
        return "\u2013"
    if abs(value) < resolution:
        return "0"
    return f"{value:.4g}".replace("-", "\u2212")


def _words(
    words: Sequence[tuple[float, float, str]],
    colour: colours.Colour = colours.PALE,
    shown: bool = True,
) -> rr.Points2D:
    return rr.Points2D(
        np.reshape([(x, y) for x, y, _ in words], (-1, 2)),
        labels=[text for *_, text in words],
        colors=colour,
        radii=0.0,
        show_labels=shown,
    )


def _part(values: Floats, low: float, high: float) -> Floats:
    return (values - low) / (high - low if high > low else 1.0)


def _nearest(values: Floats, span: tuple[float, float], pixels: int) -> Integers:
    """Return the number of the known value nearest to each pixel of a span."""
    low, high = span
    at = low + (high - low) * (np.arange(pixels) + 0.5) / pixels
    return np.searchsorted(0.5 * (values[1:] + values[:-1]), at).astype(np.int64)
