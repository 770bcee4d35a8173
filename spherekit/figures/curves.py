"""Quantities over one axis: an input, the time, or a quantity of an analysis."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.plotted import TURNS, broken, plotted_range, scale_of
from spherekit.analysis.scene import Axis, Floats, InputMarks, Page, Series, titled
from spherekit.analysis.units import in_signs
from spherekit.figures import style
from spherekit.figures.sdk import Axes, Figure, Line2D
from spherekit.figures.sheet import (
    Sheet,
    label_x,
    line_between,
    spot,
    spot_look,
    stroke,
    ticks_of,
    wrapped,
)

MOST_IN_ONE = 7
"""Quantities of one mode that share a panel."""
RATIO = 0.68
DASH = 5.0
"""Length of a dash of curves that lie on each other, in widths of their lines."""
ALIKE = 0.003
"""Curves nearer to each other than this part of the frame lie on each other."""
RULE: dict[str, Any] = {"linestyle": (0, (1, 1.5)), "linewidth": 0.8, "zorder": 1.0}


@final
@dataclass(frozen=True)
class Curve:
    """A series of a page over an axis."""

    page: Page
    series: Series
    axis: Axis


def draw_curves(
    curves: Sequence[Curve], marks: Sequence[tuple[Page, InputMarks]], sheet: Sheet
) -> Figure:
    """Return a figure of series of one group: a panel for each, a colour for each mode.

    In one mode, or on a page of its own, few of them share one panel.
    """
    labels = list(dict.fromkeys(curve.series.label for curve in curves))
    pages = list(dict.fromkeys(curve.page for curve in curves))
    together = len(pages) == 1 and 1 < len(labels) <= MOST_IN_ONE
    entries: list[tuple[str, Line2D]] = []
    if together:
        entries += [
            (label, stroke(*style.series_look(k))) for k, label in enumerate(labels)
        ]
    elif len(pages) > 1:
        seen = [c.page for c in curves if np.any(np.isfinite(c.series.values))]
        entries += [
            (sheet.title(page), stroke(*page_look(page))) for page in pages if page in seen
        ]
    visible = [(page, item) for page, item in marks if page in pages and len(item.inputs)]
    named = {item.label: item for _, item in visible}
    entries += [(label, spot(item.tone)) for label, item in named.items()]
    count = 1 if together else len(labels)
    with style.look():
        longest = max(map(len, labels)) if count > 1 else 0
        rows = sheet.legend_rows(entries)
        figure, panels, across = sheet.panels(count, RATIO, rows, longest)
        scale = scale_of(
            np.concatenate([curve.series.values for curve in curves]), curves[0].series.unit
        )
        for k, panel in enumerate(panels):
            shown = curves if together else _of(curves, labels[k])
            _panel(panel, shown, scale, labels if together else None)
            for page, mark in visible:
                for curve in shown:
                    if curve.page == page:
                        _mark(panel, curve, mark)
            heading = shown[0].series
            if count > 1:
                panel.set_title(labels[k])
            words = titled(heading.group, heading.unit)
            if k == 0 and count > across:
                figure.supylabel(words, fontsize=8.0)
            elif k == 0:
                panel.set_ylabel(wrapped(words))
            if k + across < count:
                panel.set_xlabel("")
        sheet.legend(figure, entries)
    return figure


def page_look(page: Page) -> tuple[str, Any]:
    """Return colour and dashes of a mode, or of a page of its own."""
    if isinstance(page, int):
        return style.mode_colour(page), style.mode_dashes(page)
    return style.INK, "-"


def _panel(
    panel: Axes, curves: Sequence[Curve], scale: float, labels: Sequence[str] | None
) -> None:
    every = np.concatenate([curve.series.values for curve in curves])
    unit = curves[0].series.unit
    resolution = max(curve.series.resolution for curve in curves)
    low, high = plotted_range(every, scale, resolution)
    alike = _alike([curve.series.values for curve in curves], high - low)
    for k, curve in enumerate(curves):
        if labels is None:
            colour, dashes = page_look(curve.page)
        else:
            colour, dashes = style.series_look(labels.index(curve.series.label))
        place, count = alike[k]
        if place and labels is None:
            dashes = (DASH * place, (DASH, DASH * (count - 1)))
        points = np.stack([curve.axis.values, curve.series.values], axis=1)
        look = {"color": colour, "linestyle": dashes, "label": curve.series.label}
        look |= {"zorder": 2.0 + 0.01 * k, "dash_capstyle": "butt"}
        line = line_between(panel, broken(points, (low, high), TURNS.get(unit)), look)
        line.set_gid(f"mode {curve.page}" if isinstance(curve.page, int) else None)
        lone = points[_alone(curve.series.values)]
        panel.plot(lone[:, 0], lone[:, 1], ".", color=colour, markersize=3.0)
    finite = every[np.isfinite(every)]
    if len(finite) and np.ptp(finite) <= resolution * scale and np.any(finite != finite[0]):
        within = f"{float(np.ptp(finite)):.0e} {in_signs(unit)}".strip()
        words = f"all within {within}"
        panel.annotate(
            words,
            (0.98, 0.95),
            xycoords="axes fraction",
            ha="right",
            va="top",
            fontsize=6.5,
        )
    label_x(panel, curves[0].axis)
    panel.set_ylim(low, high)
    ticks_of(panel, unit, "y", 5)
    if low < 0.0 < high:
        panel.axhline(0.0, color=style.FAINT, linewidth=0.6, zorder=0.5)


def _alone(values: Floats) -> NDArray[np.bool_]:
    """Return which values are known beside none, so that no stroke shows them."""
    finite = np.concatenate([[False], np.isfinite(values), [False]])
    return np.asarray(finite[1:-1] & ~finite[:-2] & ~finite[2:])


def _mark(panel: Axes, curve: Curve, marks: InputMarks) -> None:
    """Mark places on a curve; where it has none in the frame, on the whole height."""
    (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
    order = np.argsort(curve.axis.values)
    x, y = curve.axis.values[order], curve.series.values[order]
    for position in marks.inputs[:, 0].tolist():
        if not left <= position <= right:
            continue
        value = float(np.interp(position, x, y))
        if low <= value <= high:
            panel.plot([position], [value], zorder=4.0, **spot_look(marks.tone))
        else:
            colour = style.tone_colour(marks.tone)
            panel.axvline(position, color=colour, **RULE)


def _alike(every: Sequence[Floats], span: float) -> list[tuple[int, int]]:
    """Return of each curve which of those it is that it lies on, and how many these are."""
    leader: list[int] = []
    for k, values in enumerate(every):
        earlier = (n for n in range(k) if leader[n] == n and _same(values, every[n], span))
        leader.append(next(earlier, k))
    return [
        (leader[:k].count(leader[k]), leader.count(leader[k])) for k in range(len(every))
    ]


def _same(one: Floats, other: Floats, span: float) -> bool:
    """Return whether curves of as many rows cannot be told apart where both are."""
    if len(one) != len(other):
        return False
    gap = np.abs(one - other)
    gap = gap[np.isfinite(gap)]
    return bool(len(gap)) and float(np.quantile(gap, 0.9)) < ALIKE * span


def _of(curves: Sequence[Curve], label: str) -> list[Curve]:
    return [curve for curve in curves if curve.series.label == label]
