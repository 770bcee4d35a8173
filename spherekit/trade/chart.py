"""The work-precision chart: error against time, both logarithmic."""

from collections.abc import Sequence
from html import escape

import numpy as np

from spherekit.analysis.scene import Axis, Mark, PlaneCurve, Portrait, Scene, Text
from spherekit.sphere.rotation import Floats
from spherekit.trade.record import Measured, Trade
from spherekit.trade.text import as_text, seconds

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 1100, 600, 90, 330, 50, 70
INK, FRONT, FAINT = "#1f2933", "#d1495b", "#c3cbd3"
LETTER, NEAR = 10, 11.0
"""Size of the labels in the chart, and how far from its point a label is."""
DOTTED = 'stroke-dasharray="2 4"'
ROUND = (1.0, 2.0, 5.0)
SERIES = {"linear": "#8d99ae", "cubic": "#3a86c8", "spectral": "#2a9d62"}
"""Colours of representations; a line joins the settings of one, by their nodes."""


def scene(trade: Trade, tolerance: float | None = None) -> Scene:
    """Return the page of a recording: the chart with a mark per setting, and the table."""
    own = [each for each in trade.settings if each.counts]
    logarithms = _points(trade, own)
    (left, bottom), (right, top) = (10.0**end for end in _frame(logarithms))
    points, front = 10.0**logarithms, 10.0 ** _points(trade, trade.pareto)
    chart = Portrait(
        "trade/chart",
        "work and precision",
        x=points[:1, 0],
        y=points[:1, 1],
        x_label="processor time with compiling",
        y_label="largest error of a column",
        x_range=(float(left), float(right)),
        y_range=(float(bottom), float(top)),
        x_unit="s",
        curves=[
            *(
                PlaneCurve(points[which], 2 + k, f"{kind}, by number of nodes")
                for k, (kind, which) in enumerate(_by_series(own).items())
            ),
            PlaneCurve(front, 1, "no other is quicker and as accurate"),
        ],
        logarithmic=True,
        marks=[
            Mark(each.name, place, 1 if each in trade.pareto else 0)
            for each, place in zip(own, points, strict=True)
        ],
    )
    words = f"```\n{as_text(trade, tolerance)}\n```"
    return Scene(
        "Trade",
        (chart, Text("trade/table", "Trade", words)),
        (Axis("setting", "", np.zeros(1)),),
    )


def svg(trade: Trade, tolerance: float | None = None) -> str:
    """Return the chart as an SVG picture; a tolerance is a line, its choice a ring."""
    own = [each for each in trade.settings if each.counts]
    low, high = _close_frame(_points(trade, own))
    size = np.array([WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM])
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM

    def placed(points: Floats) -> Floats:
        share = (points - low) / (high - low)
        return np.asarray(np.array([LEFT, bottom]) + share * size * np.array([1.0, -1.0]))

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        _words(
            LEFT, 28, f"{trade.mechanism}, {trade.analysis}: {trade.samples} samples", 16
        ),
        _words(
            (LEFT + right) / 2, HEIGHT - 18, "processor time with compiling", 13, "middle"
        ),
        f'<text x="20" y="{HEIGHT / 2}" fill="{INK}" font-size="13" text-anchor="middle" '
        f'transform="rotate(-90 20 {HEIGHT / 2})">largest error of a column</text>',
    ]
    for time in _round_times(low[0], high[0], ROUND if high[0] - low[0] < 3.0 else (1.0,)):
        ((x, _),) = placed(np.array([[np.log10(time), low[1]]]))
        number, unit = seconds(time).split()
        parts += [
            _line(x, TOP, x, bottom),
            _words(x, bottom + 18, f"{float(number):g} {unit}", 12, "middle"),
        ]
    for decade in range(int(low[1]), int(high[1]) + 1, 2):
        ((_, y),) = placed(np.array([[low[0], decade]]))
        parts += [
            _line(LEFT, y, right, y),
            _words(LEFT - 8, y + 4, f"1e{decade}", 12, "end"),
        ]
    if tolerance is not None and low[1] <= np.log10(tolerance) <= high[1]:
        ((_, y),) = placed(np.array([[low[0], np.log10(tolerance)]]))
        line = np.array([[LEFT, y], [right, y]])
        parts.append(_polyline(line, INK, DOTTED))
    places = placed(_points(trade, own))
    series = _by_series(own)
    parts += [_polyline(places[which], SERIES[kind]) for kind, which in series.items()]
    parts.append(
        _polyline(placed(_points(trade, trade.pareto)), FRONT, 'stroke-dasharray="4 3"')
    )
    chosen = None if tolerance is None else trade.cheapest(tolerance)
    texts, numbered = [], []
    for each, (x, y) in zip(own, places, strict=True):
        kind = _series(each)
        colour = FRONT if each in trade.pareto else SERIES.get(kind, INK)
        parts.append(_dot(x, y, 4, colour))
        if each is chosen:
            parts.append(_dot(x, y, 8, "none", FRONT))
        if each.setting is not None and kind in SERIES:
            texts.append(str(each.setting.nodes))
        else:
            numbered.append((each, colour))
            texts.append(str(len(numbered)))
    for text, (x, y), at in zip(texts, places, labels(texts, places), strict=True):
        if np.hypot(*(at - (x, y))) > NEAR:
            parts.append(_line(x, y, *at))
        parts.append(_words(at[0], at[1] + 4, text, LETTER, "middle"))
    rows = iter(TOP + 10 + 18 * k for k in range(len(own) + 10))
    parts.append(_words(right + 20, next(rows), "every sample evaluated:", 12))
    for k, (each, colour) in enumerate(numbered):
        y = next(rows)
        words = f"{k + 1}  {each.name}: {each.error:.1e}"
        parts += [_dot(right + 25, y - 4, 4, colour), _words(right + 36, y, words, 11)]
    next(rows)
    if series:
        parts.append(
            _words(right + 20, next(rows), "functions read from so many nodes:", 12)
        )
    for kind in series:
        y = next(rows)
        ends = np.array([[right + 20, y - 4], [right + 42, y - 4]])
        parts += [_polyline(ends, SERIES[kind]), _words(right + 50, y, kind, 11)]
    next(rows)
    parts.append(
        _words(right + 20, next(rows), "red: no other is quicker and as accurate", 11)
    )
    if tolerance is not None:
        y = next(rows)
        line = np.array([[right + 20, y - 4], [right + 42, y - 4]])
        parts.append(_polyline(line, INK, DOTTED))
        parts.append(_words(right + 50, y, f"tolerance {tolerance:g}", 11))
    if chosen is not None:
        parts.append(_words(right + 20, next(rows), f"ring: taken, {chosen.name}", 11))
    return "\n".join([*parts, "</svg>", ""])


def labels(texts: Sequence[str], places: Floats) -> Floats:
    """Return where the middle of each text goes: near its point, none over another.

    Each text takes the nearest free place of a few around its point; where there is none
    it takes the nearest.
    """
    taken = [(x - 4.0, y - 4.0, x + 4.0, y + 4.0) for x, y in places]
    found = np.zeros((len(texts), 2))
    for k, (text, (x, y)) in enumerate(zip(texts, places, strict=True)):
        half = np.array([0.31 * LETTER * len(text) + 1.0, 0.45 * LETTER])
        around = [
            np.array([x, y]) + reach * np.array([np.cos(turn), -np.sin(turn)])
            for reach in (NEAR, 1.6 * NEAR, 2.4 * NEAR, 3.4 * NEAR)
            for turn in np.radians([45, 135, 0, -45, 90, -90, -135, 180])
        ]
        boxes = [(*(at - half), *(at + half)) for at in around]
        free = [n for n, box in enumerate(boxes) if not any(_meet(box, o) for o in taken)]
        best = free[0] if free else 0
        found[k] = around[best]
        taken.append(boxes[best])
    return found


def _meet(one: Sequence[float], other: Sequence[float]) -> bool:
    return (
        one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
    )


def _round_times(low: float, high: float, leading: Sequence[float]) -> list[float]:
    """Return the times within two logarithms that have one of the leading digits."""
    decades = range(int(np.floor(low)), int(np.ceil(high)) + 1)
    times = [digit * 10.0**decade for decade in decades for digit in leading]
    return [time for time in times if low - 1e-9 <= np.log10(time) <= high + 1e-9]


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


def _close_frame(points: Floats) -> tuple[Floats, Floats]:
    """Return the least and greatest round times, and decades of the error."""
    low, high = _frame(points)
    if len(points):
        times = np.log10(_round_times(low[0], high[0], ROUND))
        first = times[times <= points[:, 0].min() + 1e-12].max()
        last = times[times >= points[:, 0].max() - 1e-12].min()
        if last > first:
            low[0], high[0] = first, last
    return low, high


def _line(x: float, y: float, to_x: float, to_y: float) -> str:
    ends = f'x1="{x:.1f}" y1="{y:.1f}" x2="{to_x:.1f}" y2="{to_y:.1f}"'
    return f'<line {ends} stroke="{FAINT}"/>'


def _dot(x: float, y: float, radius: float, fill: str, stroke: str = "none") -> str:
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{fill}" '
        f'stroke="{stroke}"/>'
    )


def _words(x: float, y: float, text: str, size: int, anchor: str = "start") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{INK}" font-size="{size}" '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )
