"""The work-precision chart of a trade: error against time, both logarithmic."""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.runs.trade_record import Measured, Trade
from spherekit.runs.trade_text import as_text
from spherekit.scenes.scene import Axis, Mark, PlaneCurve, Portrait, Scene, Text

FRONT_TONE = 1
"""Tone of settings that no other setting beats."""

SETTING_TONE = 0
"""Tone (index of a colour) of settings that are not emphasised."""

TOLERANCE_TONE = 5
"""Tone of the tolerance and of its setting."""

MIN_LOGARITHM_ARGUMENT = 1e-17
"""Least time (s) and error in the chart, since 0 has no logarithm."""

CHART_MARGIN_RATIO = 0.06
"""Margin around the points, as a part of their range in decades."""

MIN_CHART_MARGIN_DECADES = 0.1
"""Least margin around the points, in decades."""


def scene(trade: Trade, tolerance: float | None = None) -> Scene:
    """Return the work-precision chart of a trade: error against time, with its table.

    A trade consists of the settings of a run (ways to compute it) with their times and
    errors. Each setting is a mark with a number, which the legend explains. A curve, the
    front, joins the best settings: no other setting is quicker and as accurate.

    Parameters
    ----------
    trade
        The measured settings.
    tolerance
        Largest error that is accepted. It is drawn as a line, and the cheapest setting that
        meets it is marked.
    """
    settings = [candidate for candidate in trade.settings if candidate.counts]
    # (settings, 2) time (s) and error.
    points = _make_points(settings)
    (left, bottom), (right, top) = _find_frame(points, tolerance)
    curves = [
        PlaneCurve(
            points=_make_points(trade.pareto),
            tone=FRONT_TONE,
            label="no other is quicker and as accurate",
        )
    ]
    marks = []
    for number, (measured, point) in enumerate(zip(settings, points, strict=True), 1):
        tone = FRONT_TONE if measured in trade.pareto else SETTING_TONE
        marks.append(Mark(str(number), point, tone))
        # Each setting is a curve of a single point, so that the legend has a label for it.
        label = f"{number}: {measured.name}, {measured.error:.1e}"
        curves.append(PlaneCurve(point[None], tone, label))
    if tolerance is not None:
        height = max(tolerance, MIN_LOGARITHM_ARGUMENT)
        line = np.array([[left, height], [right, height]])
        curves.append(PlaneCurve(line, TOLERANCE_TONE, f"tolerance {tolerance:g}"))
        chosen = trade.cheapest(tolerance)
        if chosen is not None:
            (point,) = _make_points([chosen])
            marks.append(Mark("taken", point, TOLERANCE_TONE))
    # A portrait has a mark that moves with the samples. Here the mark stays at the first
    # setting.
    chart = Portrait(
        path="trade/chart",
        label="work and precision",
        x=points[:1, 0],
        y=points[:1, 1],
        x_label="processor time with compiling",
        y_label="largest error of a column",
        x_range=(left, right),
        y_range=(bottom, top),
        x_unit="s",
        curves=curves,
        marks=marks,
        logarithmic=True,
    )
    table = f"```\n{as_text(trade, tolerance)}\n```"
    return Scene(
        page="Trade",
        primitives=(chart, Text(path="trade/table", label="Trade", markdown=table)),
        over=(Axis(label="setting", unit="", values=np.zeros(1)),),
        source="trade",
    )


def _make_points(settings: Sequence[Measured]) -> Floats:
    """Return the times (s) and errors (n, 2) of settings."""
    rows = [(measured.total, measured.error) for measured in settings]
    return np.maximum(np.reshape(rows, (-1, 2)), MIN_LOGARITHM_ARGUMENT)


def _find_frame(points: Floats, tolerance: float | None) -> tuple[Floats, Floats]:
    """Return the lower left and the upper right corner (2,) around points (n, 2).

    The line of the tolerance, if there is one, is also between them.
    """
    if not len(points):
        points = np.array([[0.1, 0.1], [1.0, 1.0]])
    if tolerance is not None:
        tolerance_point = (points[0, 0], max(tolerance, MIN_LOGARITHM_ARGUMENT))
        points = np.vstack([points, tolerance_point])
    low, high = np.log10([points.min(axis=0), points.max(axis=0)])
    margin = np.maximum(CHART_MARGIN_RATIO * (high - low), MIN_CHART_MARGIN_DECADES)
    return 10.0 ** (low - margin), 10.0 ** (high + margin)
