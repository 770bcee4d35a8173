"""Quantities over one axis: an input, the time, or a quantity of an analysis.

The sphere on paper: workspaces, curves and paths of poles on maps of the directions, by
Lambert's equal-area and the stereographic azimuthal projection. Both keep the directions
from the centre; at the angle t from it a point is 2 sin(t/2) off in the former, which
keeps areas, and 2 tan(t/2) in the latter, which keeps angles (J. P. Snyder, Map
Projections: A Working Manual, USGS 1395, 1987, chapters 21 and 24).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherekit.analysis.plotted import (
    TURNS,
    broken,
    map_range,
    parted,
    plotted_range,
    scale_of,
)
from spherekit.analysis.scene import (
    Arrow,
    InputMarks,
    Mark,
    Page,
    Scene,
    Series,
    SphereCurves,
    SphereMap,
    in_signs,
    titled,
)
from spherekit.arrays import Floats
from spherekit.figures import style
from spherekit.figures.sdk import (
    Axes,
    BoundaryNorm,
    Figure,
    Normalize,
    Transform,
    Triangulation,
    withStroke,
)
from spherekit.figures.sheet import (
    Sheet,
    colour_bar,
    label_x,
    spot_look,
    ticks_of,
    wrapped,
)
from spherekit.figures.style import Look
from spherekit.sphere.rotation import all_finite

MOST_IN_ONE = 7
"""Quantities of one mode that share a panel."""
RATIO = 0.68
DASH = 5.0
"""Length of a dash of curves that lie on each other, in widths of their lines."""
ALIKE = 0.003
"""Curves nearer to each other than this part of the frame lie on each other."""
RULE: Look = {"linestyle": (0, (1, 1.5)), "linewidth": 0.8, "zorder": 1.0}


Curve = tuple[Scene, Series]
"""A series of a scene, over one axis."""


def draw_curves(
    marks: Sequence[tuple[Page, InputMarks]], curves: Sequence[Curve], sheet: Sheet
) -> Figure:
    """Return a figure of series of one group: a panel for each, a colour for each mode.

    In one mode, or on a page of its own, few of them share one panel.
    """
    labels = list(dict.fromkeys(item.label for _, item in curves))
    pages = list(dict.fromkeys(scene.page for scene, _ in curves))
    together = len(pages) == 1 and 1 < len(labels) <= MOST_IN_ONE
    count = 1 if together else len(labels)
    with style.look():
        longest = max(map(len, labels)) if count > 1 else 0
        figure, panels, across = sheet.panels(count, RATIO, longest)
        every = np.concatenate([item.values for _, item in curves])
        scale = scale_of(every, curves[0][1].unit)
        for k, panel in enumerate(panels):
            shown = [x for x in curves if together or x[1].label == labels[k]]
            looks = []
            for scene, item in shown:
                look = style.page_look(scene.page)
                look["label"] = sheet.title(scene.page) if len(pages) > 1 else ""
                if together:
                    look |= style.series_look(labels.index(item.label))
                    look["label"] = item.label
                looks.append(look)
            _panel(panel, shown, scale, looks)
            for page, mark in marks:
                for curve in shown:
                    if curve[0].page == page:
                        _mark(panel, curve, mark)
            if count > 1:
                panel.set_title(labels[k])
            words = shown[0][1].heading
            if k == 0 and count > across:
                figure.supylabel(words, fontsize=8.0)
            elif k == 0:
                panel.set_ylabel(wrapped(words))
            if k + across < count:
                panel.set_xlabel("")
        return sheet.name(figure)


def _panel(
    panel: Axes, curves: Sequence[Curve], scale: float, looks: Sequence[Look]
) -> None:
    every = np.concatenate([item.values for _, item in curves])
    unit = curves[0][1].unit
    resolution = max(item.resolution for _, item in curves)
    low, high = plotted_range(every, scale, resolution)
    alike = _alike([item.values for _, item in curves], high - low)
    for k, (scene, item) in enumerate(curves):
        (place, count), look = alike[k], looks[k]
        shown = np.isfinite(item.values)  # no stroke shows values beside none
        if place:
            look["linestyle"] = DASH * place, (DASH, DASH * (count - 1))
        if not shown.any():
            look["label"] = ""
        points = np.stack([scene.over[0].values, item.values], axis=1)
        look |= {"zorder": 2.0 + 0.01 * k, "dash_capstyle": "butt"}
        panel.plot(*broken(points, (low, high), TURNS.get(unit)).T, **look)
        lone = points[shown & ~(np.convolve(shown, [True, False, True])[1:-1] > 0)]
        panel.plot(*lone.T, ".", color=look["color"], markersize=3.0)
    finite = every[np.isfinite(every)]
    if len(finite) and np.ptp(finite) <= resolution * scale and np.any(finite != finite[0]):
        within = f"{float(np.ptp(finite)):.0e} {in_signs(unit)}".strip()
        panel.annotate(
            f"all within {within}",
            (0.98, 0.95),
            xycoords="axes fraction",
            ha="right",
            va="top",
            fontsize=6.5,
        )
    label_x(panel, curves[0][0].over[0])
    panel.set_ylim(low, high)
    ticks_of(panel, unit, "y", 5)
    if low < 0.0 < high:
        panel.axhline(0.0, color=style.FAINT, linewidth=0.6, zorder=0.5)


def _mark(panel: Axes, curve: Curve, marks: InputMarks) -> None:
    """Mark places on a curve; where it has none in the frame, on the whole height."""
    (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
    scene, item = curve
    order = np.argsort(scene.over[0].values)
    x, y = scene.over[0].values[order], item.values[order]
    for position in marks.inputs[:, 0].tolist():
        if not left <= position <= right:
            continue
        value = float(np.interp(position, x, y))
        if low <= value <= high:
            look = spot_look(marks.tone) | {"zorder": 4.0, "label": marks.label}
            panel.plot([position], [value], **look)
        else:
            look = style.tone_look(marks.tone) | RULE | {"label": marks.label}
            panel.axvline(position, **look)


def _alike(every: Sequence[Floats], span: float) -> list[tuple[int, int]]:
    """Return of each curve which of those it is that it lies on, and how many these are.

    They cannot be told apart where both are, over as many rows.
    """
    leader: list[int] = []
    for k, values in enumerate(every):
        leader.append(k)
        for n in range(k):
            if leader[n] == n and len(every[n]) == len(values):
                gap = np.abs(every[n] - values)
                gap = gap[np.isfinite(gap)]
                if len(gap) and np.quantile(gap, 0.9) < ALIKE * span:
                    leader[k] = n
                    break
    return [(leader[:k].count(n), leader.count(n)) for k, n in enumerate(leader)]


AXES = ("x", "y", "z")
TINY = 1e-300


Projection = tuple[str, Callable[[Floats], Floats]]
"""A name, and how far from the centre of the map a point at an angle (rad) is."""

EQUAL_AREA: Projection = (
    "equal-area (Lambert)",
    lambda angle: 2.0 * np.sin(angle / 2.0),
)
STEREOGRAPHIC: Projection = "stereographic", lambda angle: 2.0 * np.tan(angle / 2.0)


def centre_of(directions: Floats) -> Floats:
    """Return right, up and out (3, 3) of a map about the middle of directions (n, 3).

    That is the axis of the ground nearest to it.
    """
    mean = np.nanmean(directions, axis=0) if len(directions) else np.array([0.0, 0.0, 1.0])
    out = int(np.argmax(np.abs(mean)))
    frame = np.eye(3)[[(out + 1) % 3, (out + 2) % 3, out]]
    return frame if mean[out] >= 0.0 else opposite(frame)


def opposite(frame: Floats) -> Floats:
    """Return right, up and out of the map about the other side."""
    return frame[[1, 0, 2]] * [[1.0], [1.0], [-1.0]]


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
NET: Look = {"color": "#909090", "alpha": 0.55, "linewidth": 0.4}
"""How the graticule is drawn."""
POLAR: Look = {"projection": "polar", "axisbelow": "line"}
"""The panels of maps, whose circles and clipping at the rim are those of polar axes."""


def focus_of(maps: Sequence[SphereMap], curves: Sequence[SphereCurves]) -> Floats:
    """Return the directions (n, 3) that have to be on a map of what is on the sphere.

    Those of maps and marks, or else of the curves, which may leave it at its rim.
    """
    every = [np.zeros((0, 3))]
    for item in maps:
        meshed = len(item.triangles) > 0
        every.append(item.vertices[np.unique(item.triangles) if meshed else slice(None)])
    every += [mark.place[None] for item in curves for mark in item.marks]
    if len(every) == 1:
        every += [np.asarray(curve) for item in curves for curve in item.curves]
    directions = np.concatenate(every)
    return directions[np.isfinite(directions).all(axis=1)]


@dataclass(frozen=True)
class View:
    """A map about a centre on an axis of the ground, out to a rim at an angle (rad).

    `frame` (3, 3) has what is right, up and out of it as rows, see `centre_of`.
    """

    frame: Floats
    projection: Projection = EQUAL_AREA
    rim: float = HALF

    @property
    def title(self) -> str:
        """The projection, and the axis of the ground on which the centre is."""
        return f"{self.projection[0]}, about {self.centre}"

    @property
    def centre(self) -> str:
        """The axis of the ground on which the centre is, with its sign."""
        out = int(np.argmax(np.abs(self.frame[2])))
        return f"{'−' if self.frame[2, out] < 0.0 else '+'}{AXES[out]}"

    @property
    def sides(self) -> tuple[str, str]:
        """Names of the axes of the ground that point right and up."""
        right, up = (AXES[int(np.argmax(np.abs(axis)))] for axis in self.frame[:2])
        return right, up

    def angles(self, directions: Floats) -> Floats:
        """Return the angles (n,) rad of directions (n, 3) from the centre."""
        across = directions @ self.frame[:2].T
        return np.arctan2(np.hypot(across[:, 0], across[:, 1]), directions @ self.frame[2])

    def placed(self, directions: Floats) -> Floats:
        """Return places (n, 2), the sphere seen from outside; NaN well beyond the rim."""
        across, angles = directions @ self.frame[:2].T, self.angles(directions)
        size = np.hypot(across[:, 0], across[:, 1])
        places = across * self.radius(angles)[:, None] / np.maximum(size, TINY)[:, None]
        places[angles > self.rim + BEYOND] = np.nan
        return places

    def radius(self, angle: Any) -> Any:
        """Return how far from the centre of the map points at an angle (rad) are."""
        return self.projection[1](angle)


def draw_sphere(
    maps: Sequence[SphereMap], curves: Sequence[SphereCurves], sheet: Sheet
) -> Figure:
    """Return a figure of a page in equal areas and stereographic, side by side."""
    focus = focus_of(maps, curves)
    frame = centre_of(focus)
    farthest = float(np.max(View(frame).angles(focus), initial=0.0))
    rim = max(RING, STEP * np.ceil(farthest / STEP + 1e-9))
    if not maps and rim < HALF:
        rim = HALF
    frames, rim = ([frame], rim) if rim <= WIDEST else ([frame, opposite(frame)], HALF)
    kinds = {(mark.label, mark.tone) for item in curves for mark in _marks(item)}
    views = [View(x, p, rim) for x in frames for p in (EQUAL_AREA, STEREOGRAPHIC)]
    with style.look():
        across = 2 if sheet.columns == 2 else 1
        rows = len(views) // across
        width = sheet.width * (0.85 if maps else 1.0)
        figure = sheet.figure(rows, width / across + 0.3)
        panels = (
            figure.subplots(rows, across, squeeze=False, subplot_kw=POLAR).ravel().tolist()
        )
        values = np.concatenate([np.zeros(0), *(item.shown_values for item in maps)])
        values = values[np.isfinite(values)]
        tint = _tint(values, maps[0].unit) if maps else Normalize(0.0, 1.0)
        for panel, view in zip(panels, views, strict=True):
            way = _graticule(panel, view)
            for item in maps:
                _map(panel, view, item, tint, way)
            for drawn in curves:
                _curves(panel, view, drawn, way, len(kinds) <= MOST_NAMED)
            panel.set_title(view.title)
        if maps:
            words = titled(maps[0].label, maps[0].unit)
            bar = colour_bar(figure, panels, values, tint, style.HEAT, words)
            if isinstance(tint, BoundaryNorm):
                whole = np.unique(np.round(tint.boundaries[:-1] + 0.5))
                bar.set_ticks(whole.tolist(), labels=[f"{n:.0f}" for n in whole])
        return sheet.name(figure)


def draw_paths(arrows: Sequence[tuple[Scene, Arrow]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of axes: a panel for each, a colour for each mode.

    An axis is drawn where it leaves the near hemisphere, by its direction or the opposite.
    """
    labels = list(dict.fromkeys(arrow.label for _, arrow in arrows))
    pages = list(dict.fromkeys(scene.page for scene, _ in arrows))
    directions = np.concatenate([arrow.directions for _, arrow in arrows])
    finite = directions[np.isfinite(directions).all(axis=1)]
    out = int(np.argmax(np.mean(finite**2, axis=0))) if len(finite) else 2
    view = View(centre_of(np.eye(3)[[out]]))
    with style.look():
        figure, panels, _ = sheet.panels(len(labels), 1.05, subplot=POLAR)
        for panel, label in zip(panels, labels, strict=True):
            way = _graticule(panel, view)
            panel.set_title(f"{label}, about {view.centre}")
            for scene, arrow in arrows:
                if arrow.label == label:
                    look = style.page_look(scene.page)
                    look["label"] = sheet.title(scene.page) if len(pages) > 1 else ""
                    _path(panel, view, arrow.directions, look, way)
        return sheet.name(figure)


def _path(panel: Axes, view: View, directions: Floats, look: Look, way: Transform) -> None:
    """Draw an axis over the samples, with a gap where it goes round the rim."""
    near = np.sign(directions @ view.frame[2])[:, None] * directions
    turned = np.sum(near[1:] * near[:-1], axis=1) < 0.0
    near = parted(near, turned)
    panel.plot(*view.placed(near).T, transform=way, **look)
    first = view.placed(near[np.isfinite(near).all(axis=1)][:1])
    panel.plot(*first.T, "o", color=look["color"], markersize=3.0, transform=way)


def _graticule(panel: Any, view: View) -> Transform:
    """Draw circles about the centre, named by their angles, and axes of the ground.

    Returns the way from places of the view to the paper.
    """
    panel.set_ylim(0.0, view.radius(view.rim))
    step = RING if view.rim > np.radians(45.0) else STEP
    angles = np.append(np.arange(step, view.rim - 1e-9, step), view.rim)
    outline = withStroke(linewidth=1.5, foreground="white", alpha=0.7)
    panel.set_rgrids(
        [view.radius(angle) for angle in angles],
        [f"{angle:.0f}°" for angle in np.degrees(angles)],
        angle=-75.0,
        fontsize=6.0,
        color="#555555",
        path_effects=[outline],
    )
    right, up = view.sides
    panel.set_thetagrids(np.arange(0.0, 360.0, 30.0), [right, "", "", up, *[""] * 8])
    panel.tick_params(axis="x", pad=0.0)
    panel.grid(**NET)
    way: Transform = panel.transProjectionAffine + panel.transWedge + panel.transAxes
    return way


def _tint(values: Floats, unit: str) -> Normalize:
    """Return the scale of colours of maps: by steps where values are few whole numbers."""
    low, high = map_range(values, unit)
    if unit == "" and np.all(values == np.round(values)) and high < MOST_WHOLE:
        return BoundaryNorm(np.arange(low - 0.5, high + 1.0), 256)
    return Normalize(low, high)


def _map(panel: Axes, view: View, item: SphereMap, tint: Normalize, way: Transform) -> None:
    places = view.placed(item.vertices)
    x, y = np.nan_to_num(places).T
    look: Look = {"norm": tint, "cmap": style.HEAT, "zorder": 1.0, "transform": way}
    if not len(item.triangles):
        panel.scatter(*places.T, **look | {"c": item.values, "s": 7.0, "linewidths": 0.0})
        return
    drawable = all_finite(places, 1)
    near = item.triangles[drawable[item.triangles].all(axis=1)]
    if not len(near):
        return
    mesh = Triangulation(x, y, near)
    look["rasterized"] = True
    if isinstance(tint, BoundaryNorm):
        panel.tripcolor(mesh, facecolors=np.min(item.values[near], axis=1), **look)
    else:
        panel.tripcolor(mesh, item.values, shading="gouraud", **look)
    panel.grid(**NET)  # which tripcolor puts out


def _curves(
    panel: Axes, view: View, item: SphereCurves, way: Transform, named: bool
) -> None:
    """Draw curves and marks; the names of marks may be in the legend."""
    look = style.tone_look(item.tone) | {"linewidth": 1.3, "zorder": 2.0}
    for curve in item.curves:
        place = view.placed(np.asarray(curve)).T
        panel.plot(*place, transform=way, label=item.label, **look)
    for mark in _marks(item):
        if view.angles(mark.place[None])[0] <= view.rim + 1e-9:
            look = spot_look(mark.tone) | {"zorder": 4.0, "clip_on": False}
            look["label"] = mark.label if named else ""
            panel.plot(*view.placed(mark.place[None])[0], transform=way, **look)


def _marks(item: SphereCurves) -> list[Mark]:
    """Return the marks that have to be told from curves, by names that say of what."""
    if len(item.curves):
        return [mark for mark in item.marks if mark.label != item.label]
    words = {True: item.label, False: f"{item.label}: "}
    return [
        replace(mark, label=words[alike] + mark.label * (not alike))
        for mark in item.marks
        for alike in [mark.label == item.label]
    ]
