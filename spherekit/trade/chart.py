"""The work-precision chart: error against time, both logarithmic."""

from collections.abc import Sequence
from html import escape

import numpy as np

from spherekit.analysis.scene import Mark, Portrait, Scene, Text
from spherekit.sphere.rotation import Floats
from spherekit.trade.record import Measured, Trade
from spherekit.trade.text import as_text

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 1100, 600, 90, 330, 50, 70
INK, FRONT, FAINT = "#1f2933", "#d1495b", "#c3cbd3"
SERIES = {"linear": "#8d99ae", "cubic": "#3a86c8", "spectral": "#2a9d62"}
"""Colours of representations; a line joins the settings of one, by their nodes."""


def scene(trade: Trade, tolerance: float | None = None) -> Scene:
    """Return the page of a recording: the chart with a mark per setting, and the table."""
    own = [each for each in trade.settings if each.counts]
    points = _points(trade, own)
    low, high = _frame(points)
    front = _points(trade, trade.pareto)
    chart = Portrait(
        "trade/chart",
        "work and precision",
        x=points[:1, 0],
        y=points[:1, 1],
        x_label="log10 of time / s",
        y_label="log10 of error",
        x_range=(float(low[0]), float(high[0])),
        y_range=(float(low[1]), float(high[1])),
        curves=[
            *((points[which], 2 + k) for k, which in enumerate(_by_series(own).values())),
            (front, 1),
        ],
        marks=[
            Mark(each.name, place, 1 if each in trade.pareto else 0)
            for each, place in zip(own, points, strict=True)
        ],
    )
    words = f"```\n{as_text(trade, tolerance)}\n```"
    return Scene("Trade", (chart, Text("trade/table", "Trade", words)), rows=1)


def svg(trade: Trade) -> str:
    """Return the chart as an SVG picture."""
    own = [each for each in trade.settings if each.counts]
    low, high = _frame(_points(trade, own))
    size = np.array([WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM])

    def placed(points: Floats) -> Floats:
        share = (points - low) / (high - low)
        x = LEFT + share[:, 0] * size[0]
        y = HEIGHT - BOTTOM - share[:, 1] * size[1]
        return np.stack([x, y], axis=1)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        _words(
            LEFT, 28, f"{trade.mechanism}, {trade.analysis}: {trade.samples} samples", 16
        ),
        _words(
            (LEFT + WIDTH - RIGHT) / 2,
            HEIGHT - 18,
            "time of a run with compiling, s",
            13,
            "middle",
        ),
        f'<text x="20" y="{HEIGHT / 2}" fill="{INK}" font-size="13" text-anchor="middle" '
        f'transform="rotate(-90 20 {HEIGHT / 2})">largest error of a column</text>',
    ]
    for decade in range(int(low[0]), int(high[0]) + 1):
        ((x, _),) = placed(np.array([[decade, low[1]]]))
        parts += [
            _line(x, TOP, x, HEIGHT - BOTTOM),
            _words(x, HEIGHT - BOTTOM + 18, f"1e{decade}", 12, "middle"),
        ]
    for decade in range(int(low[1]), int(high[1]) + 1, 2):
        ((_, y),) = placed(np.array([[low[0], decade]]))
        parts += [
            _line(LEFT, y, WIDTH - RIGHT, y),
            _words(LEFT - 8, y + 4, f"1e{decade}", 12, "end"),
        ]
    places = placed(_points(trade, own))
    series = _by_series(own)
    parts += [_polyline(places[which], SERIES[kind]) for kind, which in series.items()]
    parts.append(
        _polyline(placed(_points(trade, trade.pareto)), FRONT, 'stroke-dasharray="4 3"')
    )
    legend, number = [_words(WIDTH - RIGHT + 20, TOP + 10, "every sample", 12)], 0
    for each, (x, y) in zip(own, places, strict=True):
        kind = _series(each)
        colour = FRONT if each in trade.pareto else SERIES.get(kind, INK)
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>')
        if each.setting is not None and kind in SERIES:
            parts.append(_words(x + 6, y - 5, str(each.setting.nodes), 10))
            continue
        number += 1
        parts.append(_words(x + 6, y - 5 if number % 2 else y + 13, str(number), 10))
        line = f"{number}  {each.name}: {each.error:.1e}"
        legend.append(_words(WIDTH - RIGHT + 20, TOP + 10 + 18 * number, line, 11))
    for k, kind in enumerate(series):
        y = TOP + 10 + 18 * (number + 2 + k)
        legend.append(_words(WIDTH - RIGHT + 50, y, f"{kind}, by nodes", 11))
        ends = np.array([[WIDTH - RIGHT + 20, y - 4], [WIDTH - RIGHT + 42, y - 4]])
        legend.append(_polyline(ends, SERIES[kind]))
    y = TOP + 10 + 18 * (number + 2 + len(series))
    legend.append(_words(WIDTH - RIGHT + 20, y, "red: none is quicker and as accurate", 11))
    return "\n".join([*parts, *legend, "</svg>", ""])


def _by_series(own: Sequence[Measured]) -> dict[str, list[int]]:
    """Return the positions of the settings of each representation that is there."""
    found = {
        kind: [k for k, each in enumerate(own) if _series(each) == kind] for kind in SERIES
    }
    return {kind: which for kind, which in found.items() if which}


def _series(each: Measured) -> str:
    return "" if each.setting is None else each.setting.representation


def _polyline(points: Floats, colour: str, more: str = "") -> str:
    way = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{way}" fill="none" stroke="{colour}" {more}/>'


def _points(trade: Trade, own: Sequence[Measured]) -> Floats:
    """Return (n, 2) decimal logarithms of time and error."""
    rows = [(each.total(trade.samples), each.error) for each in own]
    return np.asarray(np.log10(np.maximum(np.array(rows).reshape(-1, 2), 1e-17)))


def _frame(points: Floats) -> tuple[Floats, Floats]:
    """Return the least and greatest decades that hold all points."""
    if not len(points):
        return np.zeros(2), np.ones(2)
    low, high = np.floor(points.min(axis=0)), np.ceil(points.max(axis=0))
    return low, np.maximum(high, low + 1.0)


def _line(x: float, y: float, to_x: float, to_y: float) -> str:
    ends = f'x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}"'
    return f'<line {ends} stroke="{FAINT}"/>'


def _words(x: float, y: float, text: str, size: int, anchor: str = "start") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{INK}" font-size="{size}" '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )
