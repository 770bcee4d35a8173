"""Portraits: curves and marks over two quantities, and a point that moves along them."""

from dataclasses import replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.rerun import shapes
from spherekit.display.rerun.chart_frame import (
    PORTRAIT_WIDTH,
    draw_frame,
    draw_lines,
    frame_side,
    place_in_frame,
)
from spherekit.display.rerun.charts import MAX_SHOWN_LABELS, legend_places, legend_style
from spherekit.display.rerun.destination import Stills
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.scenes import colours
from spherekit.scenes.plot_layout import MAX_LEGEND_KINDS, PLOT_MARGIN
from spherekit.scenes.scene import Portrait, Primitive, title_with_unit


def with_margin(primitive: Primitive) -> Primitive:
    """Return a primitive; a portrait gets a margin above and below its curves.

    Portraits with logarithmic axes get no margin.
    """
    if not isinstance(primitive, Portrait) or primitive.logarithmic:
        return primitive
    low, high = primitive.y_range
    margin = PLOT_MARGIN * (high - low)
    return replace(primitive, y_range=(low - margin, high + margin))


def draw_portrait(portrait: Portrait) -> Stills:
    """Yield the parts of a portrait (a plot of one quantity against another).

    The parts are frame, words at its axes, curves, legend and marks (labelled points).
    Marks with equal labels are one kind. Up to `MAX_LEGEND_KINDS` kinds are named in the
    legend. With more kinds, each mark has its label beside it. Labels of more than
    `MAX_SHOWN_LABELS` marks are hidden, because they would cover each other.

    Yields
    ------
    The name of each part, and its drawing.
    """
    # Angles (units deg, deg/s and so on) have ticks with steps such as 30 or 45.
    x = frame_side(
        title_with_unit(portrait.x_label, portrait.x_unit),
        portrait.x_range,
        is_degrees=portrait.x_unit.startswith("deg"),
        is_logarithmic=portrait.logarithmic,
    )
    y = frame_side(
        title_with_unit(portrait.y_label, portrait.y_unit),
        portrait.y_range,
        is_degrees=portrait.y_unit.startswith("deg"),
        is_logarithmic=portrait.logarithmic,
    )
    yield from draw_frame(PORTRAIT_WIDTH, x, y)
    for number, curve in enumerate(portrait.curves):
        # Points as fractions of the width and the height of the frame.
        points = portrait.framed(curve.points)
        yield (
            f"curve_{number}",
            draw_portrait_curve(points, colours.tone_colour(curve.tone)),
        )

    # The legend lists labels of curves and kinds of marks. The tone is the number of a
    # colour in a list.
    tone_of_kind = {mark.label: mark.tone for mark in portrait.marks}
    has_few_kinds = len(tone_of_kind) <= MAX_LEGEND_KINDS
    legend = {curve.label: curve.tone for curve in portrait.curves if curve.label}
    if has_few_kinds:
        legend |= tone_of_kind
    if legend:
        tints = [colours.tone_colour(tone) for tone in legend.values()]
        places = legend_places(PORTRAIT_WIDTH, len(legend))
        yield "legend", legend_style(places, tints, list(legend))
    if portrait.marks:
        mark_points = np.array([mark.place for mark in portrait.marks])
        fractions_of_frame = portrait.framed(mark_points)
        shows_labels = not has_few_kinds and len(mark_points) <= MAX_SHOWN_LABELS
        yield (
            "marks",
            rr.Points2D(
                # Fractions of the frame become units of the drawing, with y down.
                place_in_frame(fractions_of_frame),
                labels=[mark.label for mark in portrait.marks],
                colors=[colours.tone_colour(mark.tone) for mark in portrait.marks],
                radii=rr.Radius.ui_points(4.0),
                show_labels=shows_labels,
            ),
        )


def draw_portrait_curve(points: Floats, colour: colours.Colour) -> rr.LineStrips2D:
    """Return a curve of a portrait from points (n, 2), from 0 to 1 in its frame."""
    return draw_lines(shapes.split_at_nan(place_in_frame(points)), colour)
