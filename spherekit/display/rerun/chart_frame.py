"""The frame of a chart in a plane: axes with ticks, words and lines.

The viewer has only charts over time, so charts are drawn with lines and points. One unit of
the plane is one pixel of the pictures in it, and y points down. A chart is `CHART_WIDTH` x
`CHART_HEIGHT` units. The upper left corner of the frame is the origin. The legend stands to
the right of the frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.rerun.destination import Stills
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.scenes import colours
from spherekit.scenes.scene import Axis

CHART_WIDTH = 930.0
CHART_HEIGHT = 372.0

LEFT_MARGIN = 92.0
TOP_MARGIN = 32.0
BOTTOM_MARGIN = 66.0
"""Space around the frame for the words of the axes."""

LEGEND_WIDTH = 235.0
"""Width of one column of the legend."""

FRAME_HEIGHT = CHART_HEIGHT - TOP_MARGIN - BOTTOM_MARGIN
PORTRAIT_WIDTH = CHART_WIDTH - LEFT_MARGIN - LEGEND_WIDTH
"""Width of the frame of a chart whose legend has one column."""

CHART_BOUNDS = (
    (-LEFT_MARGIN, CHART_WIDTH - LEFT_MARGIN),
    (-TOP_MARGIN, CHART_HEIGHT - TOP_MARGIN),
)
"""The part of the plane (x and y range) that a view of a chart shows."""

COLOUR_SCALE_BOUNDS = ((-40.0, CHART_WIDTH + 40.0), (-46.0, 62.0))
"""The part of the plane that a view of a scale of colours shows."""

COLOUR_SCALE_HEIGHT = 24
"""Height of the bar of a scale of colours."""

LABEL_DROP = 14.0
"""Distance from a point down to the label that the viewer writes for it."""

X_TICK_DROP = 4.0
X_TITLE_DROP = 27.0
"""Distances from the frame down to the numbers at the ticks of the x axis and to its title.
The title is below the numbers."""

Y_TITLE_FRACTION = 0.2
"""Middle of the title of the y axis above the frame, as a fraction of the width."""

SCALE_TICK_DROP = COLOUR_SCALE_HEIGHT + 2.0
SCALE_TITLE_RISE = 44.0
"""Distance from the top of a scale of colours down to its numbers, and up to its title."""

TICKS = 5
"""Number of ticks of an axis, about."""

TICK_ROUNDING = 1e-9
"""Part of a tick step within which a value counts as a multiple of the step."""

SINGLE_TICK_DIGITS = 6
"""Significant digits of the number at the only tick of an axis."""

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
"""Steps between ticks, times a power of ten."""

ANGLE_STEPS = (1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 180.0, 360.0)
"""Steps (deg) between ticks of an axis of angles."""


@dataclass(frozen=True)
class FrameSide:
    """The title and the ticks of one axis of a chart.

    Attributes
    ----------
    title
        The words of the axis; may be empty.
    ticks
        Position of each tick along the axis, from 0 to 1, and its text.
    """

    title: str
    ticks: Sequence[tuple[float, str]]


def frame_side(
    title: str,
    value_range: tuple[float, float],
    is_degrees: bool = False,
    is_logarithmic: bool = False,
) -> FrameSide:
    """Return one side of the frame of a chart: its title, and ticks at round values.

    Parameters
    ----------
    title
        Title of the axis.
    value_range
        Lowest and highest value.
    is_degrees
        Whether values are angles (deg). Their ticks have steps such as 30 or 45.
    is_logarithmic
        Whether the axis is logarithmic; its ticks are powers of ten.
    """
    low, high = value_range
    if is_logarithmic:
        log_low, log_high = np.log10(value_range)
        # All whole exponents within the range. `TICK_ROUNDING` also includes an end that
        # rounding has moved out of the range.
        powers = np.arange(
            np.ceil(log_low - TICK_ROUNDING), np.floor(log_high + TICK_ROUNDING) + 1.0
        )
        texts = [f"1e{power:z.0f}" for power in powers]  # z writes -0 as 0
        fractions = (powers - log_low) / max(log_high - log_low, 1e-300)  # never 0 / 0
    else:
        # Ticks are stored as fractions of the range, from 0 to 1.
        step, values = ticks(low, high, is_degrees)
        texts = [tick_text(value, step) for value in values]
        fractions = fraction_of_range(values, low, high)
    return FrameSide(title, list(zip(fractions, texts, strict=True)))


def axis_side(axis: Axis) -> FrameSide:
    """Return the side of a frame for an axis of a scene."""
    return frame_side(axis.words, axis.extent, axis.unit == "deg")


def draw_frame(width: float, x: FrameSide, y: FrameSide, has_grid: bool = True) -> Stills:
    """Yield the frame of a chart with its grid lines, and the words at its axes.

    Each item is the name of a part, such as ``frame``, and its data. The caller stores the
    data once in a recording for the viewer rerun. Data in a recording have paths, like
    files: the name of a part follows the path of the chart.

    Parameters
    ----------
    width
        Width of the frame, in units of the chart.
    x, y
        The horizontal and the vertical side: title and ticks.
    has_grid
        Whether lines are drawn at the ticks.
    """
    # Lines have coordinates from 0 to 1 in the frame, and 1 is at the top. The first line
    # is the box.
    lines = [np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])]
    # Places of words are in units of the chart: to the right and downwards from the upper
    # left corner of the frame.
    words: list[tuple[float, float, str]] = []
    for fraction, text in x.ticks:
        if has_grid:
            lines.append(np.array([[fraction, 0.0], [fraction, 1.0]]))
        words.append((width * fraction, FRAME_HEIGHT + X_TICK_DROP, text))
    words.append((0.5 * width, FRAME_HEIGHT + X_TITLE_DROP, x.title))
    for fraction, text in y.ticks:
        if has_grid:
            lines.append(np.array([[0.0, fraction], [1.0, fraction]]))
        # Numbers of the y axis are in the middle of the left margin, beside their ticks.
        # The viewer writes a text below its place, so the place is above the tick.
        tick_drop = FRAME_HEIGHT * (1.0 - fraction)
        words.append((-0.5 * LEFT_MARGIN, tick_drop - LABEL_DROP, text))
    if y.title:
        # The viewer cannot turn a text, so it is above the frame. "up" says that it belongs
        # to the y axis.
        words.append((Y_TITLE_FRACTION * width, -TOP_MARGIN, f"up: {y.title}"))
    placed_lines = [place_in_frame(line, width) for line in lines]
    yield "frame", draw_lines(placed_lines, colours.GRATICULE, 0.5)
    yield "words", draw_words(words)


def draw_colour_scale(low: float, high: float, label: str) -> Stills:
    """Yield a horizontal scale of colours, with numbers below it and a title above it.

    Each item is the name of a part, such as ``bar``, and its data. The caller stores the
    data once in a recording for the viewer rerun. Data in a recording have paths, like
    files: the name of a part follows the path of the scale, as in ``scale/bar``.

    Parameters
    ----------
    low, high
        The values at the ends of the scale.
    label
        The quantity with its unit.
    """
    # The scale lies in a plane, in which one unit is one pixel of the image.
    scale = colours.heat_colours(np.linspace(0.0, 1.0, round(CHART_WIDTH)))
    yield "bar", rr.Image(np.tile(scale, (COLOUR_SCALE_HEIGHT, 1, 1)))
    # The side of a frame supplies the round numbers below the scale, and their places as
    # fractions of the width. Its title is not used.
    side = frame_side("", (low, high))
    words = [
        (CHART_WIDTH * fraction, SCALE_TICK_DROP, text) for fraction, text in side.ticks
    ]
    words.append((0.5 * CHART_WIDTH, -SCALE_TITLE_RISE, label))
    yield "words", draw_words(words)


def ticks(low: float, high: float, is_degrees: bool) -> tuple[float, Floats]:
    """Return about `TICKS` round values for the ticks of an axis, and their step.

    Parameters
    ----------
    low, high
        Ends of an axis.
    is_degrees
        Whether the axis has angles (deg), which have steps such as 30 or 45.

    Returns
    -------
    The step, and the values of the ticks. If the length of the axis is 0, below 1e-307 or
    infinite, the step is 0 and the only tick is at the low end.
    """
    ideal_step = (high - low) / TICKS
    if not np.finfo(float).tiny <= ideal_step < np.inf:
        return 0.0, np.array([low])
    power = 10.0 ** np.floor(np.log10(ideal_step))
    steps = [power * factor for factor in STEPS]
    if is_degrees and ideal_step >= 1.0:
        # If the step exceeds a turn, it is a round number of turns.
        turn_power = max(1.0, 10.0 ** np.floor(np.log10(ideal_step / 360.0)))
        steps = [*ANGLE_STEPS, *(360.0 * turn_power * factor for factor in STEPS)]
    # Choose the step that is nearest on a logarithmic scale.
    step = min(steps, key=lambda candidate: abs(np.log(candidate / ideal_step)))
    first = np.ceil(low / step - TICK_ROUNDING)
    last = np.floor(high / step + TICK_ROUNDING)
    return step, np.arange(first, last + 1.0) * step


def tick_text(value: float, step: float) -> str:
    """Return the number at a tick, with enough digits to tell it from its neighbours.

    A single tick has the step 0. Its number has `SINGLE_TICK_DIGITS` digits.
    """
    if abs(value) <= TICK_ROUNDING * step:
        return "0"
    if not 1e-4 <= step < 1e6:
        significant_digits = SINGLE_TICK_DIGITS
        if step > 0.0:
            # The last two digits have the places of the two digits of the step, such as
            # 1e-6 and 1e-7 for the step 2.5e-6.
            value_power, step_power = np.floor(np.log10([abs(value), step]))
            significant_digits = max(1, int(value_power - step_power)) + 2
        return f"{value:.{significant_digits}g}".replace("-", "\u2212")
    digits = max(0, int(np.ceil(-np.log10(step) - TICK_ROUNDING)))
    if abs(round(step * 10**digits) - step * 10**digits) > 1e-6:
        digits += 1  # a step of 2.5 times a power of ten
    return f"{value:.{digits}f}".replace("-", "\u2212")


def fraction_of_range(values: Floats, low: float, high: float) -> Floats:
    """Return the positions of values in a range, from 0 at its low to 1 at its high end."""
    return (values - low) / (high - low if high > low else 1.0)


def place_in_frame(points: Floats, width: float = PORTRAIT_WIDTH) -> Floats:
    """Convert points from fractions of the frame of a chart to units of the chart.

    The result (..., 2) has y down, with the origin in the upper left corner of the frame.

    Parameters
    ----------
    points
        (..., 2) coordinates from 0 to 1 in the frame, with y up.
    width
        Width of the frame, in units of the chart.
    """
    return points * [width, -FRAME_HEIGHT] + [0.0, FRAME_HEIGHT]


def vertical_lines(x: Floats) -> Floats:
    """Return lines (n, 2, 2) from the top to the bottom of a frame at places x (n,)."""
    ends = np.zeros((len(x), 2, 2))
    ends[:, :, 0] = x[:, None]
    ends[:, 1, 1] = FRAME_HEIGHT
    return ends


def draw_lines(
    lines: Sequence[Floats], colour: colours.Colour, width: float = 1.0
) -> rr.LineStrips2D:
    """Return polylines (k, 2), whose line width is given in points of the screen."""
    return rr.LineStrips2D(lines, colors=colour, radii=rr.Radius.ui_points(width))


def draw_words(
    words: Sequence[tuple[float, float, str]],
    colour: colours.Colour = colours.PALE,
    is_shown: bool = True,
) -> rr.Points2D:
    """Return texts at places of a chart, as points of size 0 with labels.

    Parameters
    ----------
    words
        Place (x, y) and text of each label.
    colour
        Colour of the texts.
    is_shown
        Whether the texts are always visible. Otherwise the viewer shows a text when its
        place is pointed at.
    """
    return rr.Points2D(
        np.reshape([(x, y) for x, y, _ in words], (-1, 2)),
        labels=[text for *_, text in words],
        colors=colour,
        radii=0.0,
        show_labels=is_shown,
    )
