"""The work-precision chart of a trade: error against time, both logarithmic."""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.runs.trade_record import Measured, Trade
from spherekit.runs.trade_text import as_text
from spherekit.scenes.scene import Axis, Mark, PlaneCurve, Portrait, Scene, Text

FRONT, EVALUATED, TOLERANCE = 1, 0, 5
"""Tones: of settings that no other beats, of other settings, of the tolerance."""


LEAST = 1e-17


def scene(trade: Trade, tolerance: float | None = None) -> Scene:
    """Return the chart with a mark for each setting, and the table.

    Settings are numbered; a tolerance is a line, and its choice a mark.
    """
    counting = [candidate for candidate in trade.settings if candidate.counts]
    points = _points(counting)
    (left, bottom), (right, top) = _frame(points)
    curves = [
        PlaneCurve(_points(trade.pareto), FRONT, "no other is quicker and as accurate")
    ]
    marks = []
    for numbered, (measured, place) in enumerate(zip(counting, points, strict=True), 1):
        tone = FRONT if measured in trade.pareto else EVALUATED
        marks.append(Mark(str(numbered), place, tone))
        words = f"{numbered}: {measured.name}, {measured.error:.1e}"
        curves.append(PlaneCurve(place[None], tone, words))
    if tolerance is not None:
        line = np.array([[left, tolerance], [right, tolerance]])
        curves.append(PlaneCurve(line, TOLERANCE, f"tolerance {tolerance:g}"))
        chosen = trade.cheapest(tolerance)
        if chosen is not None:
            (place,) = _points([chosen])
            marks.append(Mark("taken", place, TOLERANCE))
    chart = Portrait(
        "trade/chart",
        "work and precision",
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
    words = f"```\n{as_text(trade, tolerance)}\n```"
    return Scene(
        "Trade",
        (chart, Text("trade/table", "Trade", words)),
        (Axis("setting", "", np.zeros(1)),),
        "trade",
    )


def _points(counting: Sequence[Measured]) -> Floats:
    """Return (n, 2) times and errors."""
    rows = [(measured.total, measured.error) for measured in counting]
    return np.maximum(np.reshape(rows, (-1, 2)), LEAST)


def _frame(points: Floats) -> tuple[Floats, Floats]:
    """Return the round times and the powers of ten that hold all points with some room."""
    if not len(points):
        return np.array([0.1, 0.1]), np.array([1.0, 1.0])
    low, high = np.log10([points.min(axis=0), points.max(axis=0)])
    room = np.maximum(0.06 * (high - low), 0.1)
    return 10.0 ** (low - room), 10.0 ** (high + room)
