"""Quantities over one axis: an input, the time, or a quantity of an analysis.

The sphere on paper: workspaces, curves and paths of poles on maps of the directions, by
Lambert's equal-area and the stereographic azimuthal projection. Both keep the directions
from the centre; at the angle t from it a point is 2 sin(t/2) off in the former, which
keeps areas, and 2 tan(t/2) in the latter, which keeps angles (J. P. Snyder, Map
Projections: A Working Manual, USGS 1395, 1987, chapters 21 and 24).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.analysis.plotted import TURNS, broken, map_range, plotted_range, scale_of
from spherekit.analysis.scene import (
    Arrow,
    Axis,
    InputMarks,
    Page,
    Series,
    SphereCurves,
    SphereMap,
    in_signs,
    titled,
)
from spherekit.arrays import Bools, Floats
from spherekit.figures import style
from spherekit.figures.sdk import (
    Axes,
    BoundaryNorm,
    Circle,
    Figure,
    Line2D,
    Normalize,
    Triangulation,
    withStroke,
)
from spherekit.figures.sheet import (
    Sheet,
    colour_bar,
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


@dataclass(frozen=True)
class Curve:
    """A series of a page over an axis, or over several inputs."""

    page: Page
    series: Series
    over: tuple[Axis, ...]

    @property
    def axis(self) -> Axis:
        """The only axis, or the first."""
        return self.over[0]


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
        figure, panels, across = sheet.panels(count, RATIO, entries, longest)
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


def _alone(values: Floats) -> Bools:
    """Return which values are known beside none, so that no stroke shows them."""
    finite = np.concatenate([[False], np.isfinite(values), [False]])
    return finite[1:-1] & ~finite[:-2] & ~finite[2:]


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
            panel.axvline(position, color=style.tone_colour(marks.tone), **RULE)


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


AXES = ("x", "y", "z")
TINY = 1e-300


@dataclass(frozen=True)
class Projection:
    """A map about a centre; `radius` gives the distance from it at an angle in rad."""

    name: str
    radius: Callable[[Floats], Floats]


EQUAL_AREA = Projection("equal-area (Lambert)", lambda angle: 2.0 * np.sin(angle / 2.0))
STEREOGRAPHIC = Projection("stereographic", lambda angle: 2.0 * np.tan(angle / 2.0))


@dataclass(frozen=True)
class Centre:
    """A centre of maps on an axis of the ground, by right, up, out (3, 3)."""

    frame: Floats

    @property
    def name(self) -> str:
        """The axis of the ground on which it is, with its sign."""
        out = int(np.argmax(np.abs(self.frame[2])))
        return f"{'−' if self.frame[2, out] < 0.0 else '+'}{AXES[out]}"

    @property
    def opposite(self) -> "Centre":
        """The centre on the other side."""
        return Centre(self.frame[[1, 0, 2]] * [[1.0], [1.0], [-1.0]])

    @property
    def sides(self) -> tuple[str, str]:
        """Names of the axes of the ground that point right and up."""
        right, up = (AXES[int(np.argmax(np.abs(axis)))] for axis in self.frame[:2])
        return right, up

    def angles(self, directions: Floats) -> Floats:
        """Return the angles (n,) rad of directions (n, 3) from the centre."""
        across = directions @ self.frame[:2].T
        return np.arctan2(np.hypot(across[:, 0], across[:, 1]), directions @ self.frame[2])

    def placed(self, directions: Floats, projection: Projection) -> Floats:
        """Return places (n, 2) of directions (n, 3), the sphere seen from outside."""
        across = directions @ self.frame[:2].T
        size = np.hypot(across[:, 0], across[:, 1])[:, None]
        radius = projection.radius(self.angles(directions))[:, None]
        return across * radius / np.maximum(size, TINY)


def centre_of(directions: Floats) -> Centre:
    """Return the axis of the ground that is nearest to the middle of directions (n, 3)."""
    mean = np.nanmean(directions, axis=0) if len(directions) else np.array([0.0, 0.0, 1.0])
    out = int(np.argmax(np.abs(mean)))
    centre = Centre(np.eye(3)[[(out + 1) % 3, (out + 2) % 3, out]])
    return centre if mean[out] >= 0.0 else centre.opposite


RING = np.radians(30.0)
"""Between the circles of the graticule."""
WIDEST = np.radians(120.0)
"""What reaches farther from the centre is shown as two hemispheres."""
HALF = np.radians(90.0)
STEP = np.radians(15.0)
BEYOND = np.radians(12.0)
"""So far beyond the rim triangles are drawn before they are cut off there."""
MOST_WHOLE = 12
"""Most whole numbers that have colours of their own."""
MOST_NAMED = 6
NET: dict[str, Any] = {"color": "#909090", "alpha": 0.55, "linewidth": 0.4, "zorder": 1.4}
"""How the graticule is drawn."""


@dataclass(frozen=True)
class OnSphere:
    """What of a page is on the sphere and does not move."""

    maps: Sequence[SphereMap]
    curves: Sequence[SphereCurves]

    @property
    def values(self) -> Floats:
        """The numbers that the maps show."""
        values = np.concatenate([item.shown_values for item in self.maps])
        return values[np.isfinite(values)]

    def focus(self) -> Floats:
        """Return the directions (n, 3) that have to be on a map.

        Those of maps and marks, or else of the curves, which may leave it at its rim.
        """
        every = [np.zeros((0, 3))]
        for item in self.maps:
            meshed = len(item.triangles) > 0
            used = np.unique(item.triangles) if meshed else slice(None)
            every.append(item.vertices[used])
        every += [mark.place[None] for curves in self.curves for mark in curves.marks]
        if len(every) == 1:
            every += [
                np.asarray(curve) for curves in self.curves for curve in curves.curves
            ]
        directions = np.concatenate(every)
        return directions[np.isfinite(directions).all(axis=1)]

    @property
    def content(self) -> bytes:
        """What tells it from others."""
        parts = [item.values.tobytes() for item in self.maps]
        parts += [np.asarray(c).tobytes() for curves in self.curves for c in curves.curves]
        return b"".join(parts)


@dataclass(frozen=True)
class View:
    """A map about a centre, out to a rim at an angle (rad)."""

    centre: Centre
    projection: Projection
    rim: float

    def placed(self, directions: Floats) -> Floats:
        """Return places (n, 2), NaN well beyond the rim."""
        places = self.centre.placed(directions, self.projection)
        places[self.centre.angles(directions) > self.rim + BEYOND] = np.nan
        return places

    @property
    def radius(self) -> float:
        """Of the rim on the map."""
        return float(self.projection.radius(np.array(self.rim)))


def draw_sphere(shown: OnSphere, sheet: Sheet) -> Figure:
    """Return a figure of a page in equal areas and stereographic, side by side."""
    focus = shown.focus()
    centre = centre_of(focus)
    farthest = float(np.max(centre.angles(focus), initial=0.0))
    rim = max(RING, STEP * np.ceil(farthest / STEP + 1e-9))
    if not shown.maps and rim < HALF:
        rim = HALF
    centres, rim = ([centre], rim) if rim <= WIDEST else ([centre, centre.opposite], HALF)
    views = [View(c, p, rim) for c in centres for p in (EQUAL_AREA, STEREOGRAPHIC)]
    entries = _entries(shown)
    with style.look():
        across = 2 if sheet.columns == 2 else 1
        rows = len(views) // across
        width = sheet.width * (0.85 if shown.maps else 1.0)
        figure = sheet.figure(rows, width / across + 0.3, entries)
        panels = figure.subplots(rows, across, squeeze=False).ravel().tolist()
        tint, colours = _tint(shown)
        for panel, view in zip(panels, views, strict=True):
            rim_patch = _graticule(panel, view)
            for item in shown.maps:
                _map(panel, view, item, tint, colours, rim_patch)
            for curves in shown.curves:
                _curves(panel, view, curves, rim_patch)
            panel.set_title(f"{view.projection.name}, about {view.centre.name}", pad=12)
        if shown.maps:
            first = shown.maps[0]
            words = titled(first.label, first.unit)
            bar = colour_bar(figure, panels, shown.values, tint, colours, words)
            if isinstance(tint, BoundaryNorm):
                whole = np.unique(np.round(tint.boundaries[:-1] + 0.5))
                bar.set_ticks(whole.tolist(), labels=[f"{n:.0f}" for n in whole])
    return figure


def draw_paths(arrows: Sequence[tuple[Page, Arrow]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of axes: a panel for each, a colour for each mode.

    An axis is drawn where it leaves the near hemisphere, by its direction or the opposite.
    """
    labels = list(dict.fromkeys(arrow.label for _, arrow in arrows))
    pages = list(dict.fromkeys(page for page, _ in arrows))
    directions = np.concatenate([arrow.directions for _, arrow in arrows])
    finite = directions[np.isfinite(directions).all(axis=1)]
    out = int(np.argmax(np.mean(finite**2, axis=0))) if len(finite) else 2
    centre = centre_of(np.eye(3)[[out]])
    view = View(centre, EQUAL_AREA, HALF)
    entries: list[tuple[str, Line2D]] = []
    if len(pages) > 1:
        entries = [(sheet.title(page), stroke(*page_look(page))) for page in pages]
    with style.look():
        figure, panels, _ = sheet.panels(len(labels), 1.05, entries)
        for panel, label in zip(panels, labels, strict=True):
            rim_patch = _graticule(panel, view)
            panel.set_title(f"{label}, about {centre.name}", pad=12)
            for page, arrow in arrows:
                if arrow.label == label:
                    _path(panel, view, arrow.directions, page, rim_patch)
    return figure


def _path(panel: Axes, view: View, directions: Floats, page: Page, rim: Circle) -> None:
    """Draw an axis over the samples, with a gap where it goes round the rim."""
    near = np.sign(directions @ view.centre.frame[2])[:, None] * directions
    turned = np.sum(near[1:] * near[:-1], axis=1) < 0.0
    near = np.insert(near, np.nonzero(turned)[0] + 1, np.nan, axis=0)
    colour, dashes = page_look(page)
    (line,) = panel.plot(*view.placed(near).T, color=colour, linestyle=dashes)
    line.set_clip_path(rim)
    line.set_gid(f"mode {page}" if isinstance(page, int) else None)
    first = view.placed(near[np.isfinite(near).all(axis=1)][:1])
    panel.plot(*first.T, "o", color=colour, markersize=3.0)


def _entries(shown: OnSphere) -> list[tuple[str, Line2D]]:
    entries = [
        (curves.label, stroke(style.tone_colour(curves.tone)))
        for curves in shown.curves
        if len(curves.curves)
    ]
    kinds = {
        (mark.label if len(curves.curves) else _told(curves.label, mark.label), mark.tone)
        for curves in shown.curves
        for mark in curves.marks
        if mark.label != curves.label or not len(curves.curves)
    }
    if len(kinds) <= MOST_NAMED:
        entries += [(label, spot(tone)) for label, tone in sorted(kinds)]
    return entries


def _told(label: str, mark: str) -> str:
    return label if label == mark else f"{label}: {mark}"


def _graticule(panel: Axes, view: View) -> Circle:
    """Draw circles about the centre, named by their angles, and axes of the ground."""
    panel.set_aspect("equal")
    panel.set_axis_off()
    panel.set_xlim(-1.18 * view.radius, 1.18 * view.radius)
    panel.set_ylim(-1.12 * view.radius, 1.12 * view.radius)
    for k in range(12):
        turn = np.radians(30.0 * k)
        ends = view.radius * np.array([np.cos(turn), np.sin(turn)])
        panel.plot([0.0, ends[0]], [0.0, ends[1]], **NET)
    step = RING if view.rim > np.radians(45.0) else STEP
    for angle in np.arange(step, view.rim - 1e-9, step).tolist():
        radius = float(view.projection.radius(np.array(angle)))
        panel.add_patch(Circle((0.0, 0.0), radius, fill=False, **NET))
        panel.annotate(
            f"{np.degrees(angle):.0f}°",
            (radius * np.cos(np.radians(-75.0)), radius * np.sin(np.radians(-75.0))),
            ha="center",
            va="center",
            fontsize=6.0,
            color="#555555",
            zorder=5.0,
            path_effects=[withStroke(linewidth=1.5, foreground="white", alpha=0.7)],
        )
    rim = Circle((0.0, 0.0), view.radius, fill=False, edgecolor=style.INK, linewidth=0.6)
    panel.add_patch(rim)
    for name, x, y in zip(view.centre.sides, (1.0, 0.0), (0.0, 1.0), strict=True):
        where = 1.08 * view.radius
        panel.annotate(name, (where * x, where * y), ha="center", va="center", fontsize=7.0)
    panel.annotate(
        f"{np.degrees(view.rim):.0f}°",
        (1.07 * view.radius * np.cos(np.radians(-75.0)), -1.05 * view.radius),
        ha="center",
        va="center",
        fontsize=6.0,
        color="#777777",
    )
    return rim


def _tint(shown: OnSphere) -> tuple[Normalize, Any]:
    """Return the scale of colours of maps: by steps where values are few whole numbers."""
    if not shown.maps:
        return Normalize(0.0, 1.0), style.HEAT
    values, unit = shown.values, shown.maps[0].unit
    low, high = map_range(values, unit)
    if unit == "" and np.all(values == np.round(values)) and high < MOST_WHOLE:
        return BoundaryNorm(np.arange(low - 0.5, high + 1.0), 256), style.HEAT
    return Normalize(low, high), style.HEAT


def _map(
    panel: Axes, view: View, item: SphereMap, tint: Normalize, colours: Any, rim: Circle
) -> None:
    places = view.placed(item.vertices)
    if len(item.triangles):
        drawable = np.asarray(np.isfinite(places).all(axis=1))
        near = item.triangles[drawable[item.triangles].all(axis=1)]
        if not len(near):
            return
        x, y = np.nan_to_num(places).T
        mesh, look = Triangulation(x, y, near), {"norm": tint, "cmap": colours}
        look |= {"rasterized": True, "zorder": 1.0}
        if isinstance(tint, BoundaryNorm):
            least = np.min(item.values[near], axis=1)
            drawn: Any = panel.tripcolor(mesh, facecolors=least, **look)
        else:
            drawn = panel.tripcolor(mesh, item.values, shading="gouraud", **look)
    else:
        x, y = places.T
        dots: dict[str, Any] = {"s": 7.0, "linewidths": 0.0, "zorder": 1.0}
        drawn = panel.scatter(x, y, c=item.values, norm=tint, cmap=colours, **dots)
    drawn.set_clip_path(rim)


def _curves(panel: Axes, view: View, item: SphereCurves, rim: Circle) -> None:
    for curve in item.curves:
        (line,) = panel.plot(
            *view.placed(np.asarray(curve)).T,
            color=style.tone_colour(item.tone),
            linewidth=1.3,
            zorder=2.0,
        )
        line.set_clip_path(rim)
    for mark in item.marks:
        if mark.label == item.label and len(item.curves):
            continue
        place = view.placed(mark.place[None])[0]
        if view.centre.angles(mark.place[None])[0] <= view.rim + 1e-9:
            panel.plot(*place, zorder=4.0, **spot_look(mark.tone))
