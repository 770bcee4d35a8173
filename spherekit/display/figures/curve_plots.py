"""Quantities over one axis: an input, the time, or a quantity of an analysis.

The sphere on paper: workspaces, curves and paths of poles on maps of the directions, by
Lambert's equal-area and the stereographic azimuthal projection. Both keep the directions
from the centre; at the angle t from it a point is 2 sin(t/2) off in the former, which
keeps areas, and 2 tan(t/2) in the latter, which keeps angles (J. P. Snyder, Map
Projections: A Working Manual, USGS 1395, 1987, chapters 21 and 24).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.figures import style
from spherekit.display.figures.matplotlib_sdk import (
    Axes,
    BoundaryNorm,
    Figure,
    Normalize,
    Triangulation,
    withStroke,
)
from spherekit.display.figures.sheet import (
    Sheet,
    colour_bar,
    label_outside,
    spot_look,
    ticks_of,
)
from spherekit.display.figures.style import Look
from spherekit.escaping import plot_text
from spherekit.geometry.vectors import all_finite
from spherekit.scenes.plot_layout import (
    TURN_BY_UNIT,
    break_at_jumps,
    choose_map_range,
    choose_plot_range,
    insert_gaps,
    quantity_scale,
)
from spherekit.scenes.scene import (
    Arrow,
    InputMarks,
    Page,
    Scene,
    Series,
    SphereCurves,
    SphereMap,
    title_with_unit,
)
from spherekit.tables.column_units import format_unit

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
    several = len({scene.page for scene, _ in curves}) > 1
    together = not several and len(labels) <= MOST_IN_ONE
    titles = [""] if together else labels
    over, first = curves[0][0].over[0], curves[0][1]
    scale = quantity_scale(np.concatenate([item.values for _, item in curves]), first.unit)
    with style.look():
        figure, panels = sheet.panels(len(titles), RATIO, max(map(len, titles)))
        for panel, title in zip(panels, titles, strict=True):
            shown = [x for x in curves if together or x[1].label == title]
            looks = []
            for scene, item in shown:
                look = style.page_look(scene.page)
                look["label"] = sheet.title(scene.page) if several else ""
                if together and len(labels) > 1:
                    look |= style.series_look(labels.index(item.label))
                    look["label"] = plot_text(item.label)
                looks.append(look)
            _panel(panel, shown, scale, looks)
            for (page, mark), curve in product(marks, shown):
                if curve[0].page == page:
                    _mark(panel, curve, mark)
            panel.set_title(plot_text(title) if len(titles) > 1 else "")
        label_outside(panels, over.words, first.heading)
        return sheet.name(figure)


def _panel(
    panel: Axes, curves: Sequence[Curve], scale: float, looks: Sequence[Look]
) -> None:
    every = np.concatenate([item.values for _, item in curves])
    (first, item), resolution = curves[0], max(item.resolution for _, item in curves)
    over, unit = first.over[0], item.unit
    low, high = choose_plot_range(every, scale, resolution)
    alike = _alike([item.values for _, item in curves], high - low)
    for (scene, item), (place, count), look in zip(curves, alike, looks, strict=True):
        shown = np.isfinite(item.values)  # no stroke shows values beside none
        if place:
            look["linestyle"] = DASH * place, (DASH, DASH * (count - 1))
        if not shown.any():
            look["label"] = ""
        points = np.stack([scene.over[0].values, item.values], axis=1)
        panel.plot(
            *break_at_jumps(points, (low, high), TURN_BY_UNIT.get(unit)).T,
            dash_capstyle="butt",
            **look,
        )
        lone = points[shown & ~(np.convolve(shown, [True, False, True])[1:-1] > 0)]
        panel.plot(*lone.T, ".", color=look["color"], markersize=3.0)
    finite = every[np.isfinite(every)]
    spread = np.ptp(finite) if len(finite) else 0.0
    if 0.0 < spread <= resolution * scale:
        within = f"{spread:.0e} {format_unit(unit)}".strip()
        corner: Look = {"xycoords": "axes fraction", "ha": "right", "va": "top"}
        panel.annotate(f"all within {within}", (0.98, 0.95), fontsize=6.5, **corner)
    start, end = over.extent
    if start < end:
        panel.set_xlim(start, end)
    panel.set_ylim(low, high)
    ticks_of(panel, over.unit, unit)
    if low < 0.0 < high:
        panel.axhline(0.0, color=style.FAINT, linewidth=0.6, zorder=0.5)


def _mark(panel: Axes, curve: Curve, marks: InputMarks) -> None:
    """Mark places on a curve; where it has none in the frame, on the whole height."""
    (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
    scene, item = curve
    x = scene.over[0].values
    order = np.argsort(x)
    for position in marks.inputs[:, 0]:
        if not left <= position <= right:
            continue
        value = np.interp(position, x[order], item.values[order])
        if low <= value <= high:
            look = spot_look(marks.tone) | {"label": plot_text(marks.label)}
            panel.plot([position], [value], zorder=4.0, **look)
        else:
            look = style.tone_look(marks.tone) | RULE | {"label": plot_text(marks.label)}
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


AXES = "xyz"


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
    out = np.argmax(np.abs(mean))
    frame = np.roll(np.eye(3), 2 - out, axis=0)
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
ON_RIM = 1e-9
"""Sine of an angle to the rim of a map; larger: an axis is drawn on the far side by up to
this angle; smaller: rounding decides between the two directions of an axis on the rim."""
ABOVE_AXIS_NAME_PT = 16.0
"""Points from the rim of a map to its title; less: it covers the name of an axis."""
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
        meshed = len(item.triangles)
        every.append(item.vertices[np.unique(item.triangles)] if meshed else item.vertices)
    every += [mark.place[None] for item in curves for mark in item.marks]
    if len(every) == 1:
        every += [np.asarray(curve) for item in curves for curve in item.curves]
    directions = np.concatenate(every)
    return directions[all_finite(directions, 1)]


@dataclass(frozen=True)
class View:
    """A map about a centre on an axis of the ground, out to a rim at an angle (rad).

    `frame` (3, 3) has what is right, up and out of it as rows, see `centre_of`.
    """

    frame: Floats
    projection: Projection = EQUAL_AREA
    rim: float = HALF

    @property
    def sides(self) -> list[str]:
        """Names of the axes of the ground that point right, up and out, or into the map."""
        return [AXES[k] for k in np.argmax(np.abs(self.frame), axis=1)]

    @property
    def centre(self) -> str:
        """The axis of the ground on which the centre is, with its sign."""
        return f"{'−' if np.min(self.frame[2]) < 0.0 else '+'}{self.sides[2]}"

    def angles(self, directions: Floats) -> Floats:
        """Return the angles (n,) rad of directions (n, 3) from the centre."""
        right, up, out = self.frame @ directions.T
        return np.arctan2(np.hypot(right, up), out)

    def placed(self, directions: Floats) -> Floats:
        """Return polar places (n, 2): the angle from the right, and how far out.

        The sphere is seen from outside; NaN well beyond the rim.
        """
        right, up, _ = self.frame @ directions.T
        angles = self.angles(directions)
        away = np.where(angles > self.rim + BEYOND, np.nan, self.radius(angles))
        return np.stack([np.arctan2(up, right), away], axis=1)

    def radius(self, angle: Any) -> Any:
        """Return how far from the centre of the map points at an angle (rad) are."""
        return self.projection[1](angle)


def draw_sphere(
    maps: Sequence[SphereMap], curves: Sequence[SphereCurves], sheet: Sheet
) -> Figure:
    """Return a figure of a page in equal areas and stereographic, side by side."""
    focus = focus_of(maps, curves)
    frame = centre_of(focus)
    farthest = np.max(View(frame).angles(focus), initial=0.0)
    rim = max(RING if maps else HALF, STEP * np.ceil(farthest / STEP + 1e-9))
    frames, rim = ([frame], rim) if rim <= WIDEST else ([frame, opposite(frame)], HALF)
    views = [View(x, p, rim) for x in frames for p in (EQUAL_AREA, STEREOGRAPHIC)]
    with style.look():
        figure, panels = sheet.panels(len(views), 1.0, subplot=POLAR)
        for panel, view in zip(panels, views, strict=True):
            _graticule(panel, view, f"{view.projection[0]}, about {view.centre}")
            for drawn in curves:
                _curves(panel, view, drawn)
        if maps:
            _maps(figure, panels, views, maps)
        return sheet.name(figure)


def draw_paths(arrows: Sequence[tuple[Scene, Arrow]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of axes: a panel for each, a colour for each mode.

    An axis is drawn where it leaves the near hemisphere, by its direction or the opposite.
    """
    labels = list(dict.fromkeys(arrow.label for _, arrow in arrows))
    several = len({scene.page for scene, _ in arrows}) > 1
    directions = np.concatenate([arrow.directions for _, arrow in arrows])
    out = np.argmax(np.nansum(directions**2, axis=0))
    view = View(centre_of(np.eye(3)[[out]]))
    with style.look():
        figure, panels = sheet.panels(len(labels), 1.05, subplot=POLAR)
        by_label = dict(zip(labels, panels, strict=True))
        for label, panel in by_label.items():
            _graticule(panel, view, f"{plot_text(label)}, about {view.centre}")
        for scene, arrow in arrows:
            panel, look = by_label[arrow.label], style.page_look(scene.page)
            # The axis over the samples, with a gap where it goes round the rim.
            near = turn_to_side(arrow.directions, view.frame[2])
            near = insert_gaps(near, np.vecdot(near[1:], near[:-1]) < 0.0)
            name = sheet.title(scene.page) if several else ""
            panel.plot(*view.placed(near).T, label=name, **look)
            first = view.placed(near[all_finite(near, 1)][:1])
            panel.plot(*first.T, "o", color=look["color"], markersize=3.0)
        return sheet.name(figure)


def turn_to_side(directions: Floats, out: Floats) -> Floats:
    """Return an axis over samples by that of its two directions that is on one side.

    On the rim, at right angles to `out`, both are. There the direction is the one nearer
    to that of the sample before, or after where none is before, so that a path that
    reaches the rim or runs along it has no jump.

    Parameters
    ----------
    directions
        (n, 3) unit vectors; NaN where there is none.
    out
        (3,) unit vector to the middle of the side.

    Returns
    -------
    (n, 3) each direction or its opposite.
    """
    heights = directions @ out
    turned = np.where(heights < 0.0, -1.0, 1.0)[:, None] * directions
    on_rim = np.abs(heights) < ON_RIM
    # Forwards from decided samples, then backwards to those before the first of them.
    decided = np.flatnonzero(~on_rim & np.isfinite(heights))
    first = decided[0] if len(decided) else 0
    order = [(k, k - 1) for k in range(first + 1, len(turned))]
    order += [(k, k + 1) for k in range(first - 1, -1, -1)]
    for sample, neighbour in order:
        if on_rim[sample] and turned[sample] @ turned[neighbour] < 0.0:
            turned[sample] = -turned[sample]
    return turned


def _graticule(panel: Any, view: View, title: str) -> None:
    """Draw circles about the centre, named by their angles, and axes of the ground."""
    step = RING if view.rim > np.radians(45.0) else STEP
    angles = np.append(np.arange(step, view.rim - 1e-9, step), view.rim)
    panel.set_rgrids(
        view.radius(angles),
        [f"{angle:.0f}°" for angle in np.degrees(angles)],
        angle=-75.0,
        fontsize=6.0,
        color="#555555",
        path_effects=[withStroke(linewidth=1.5, foreground="white", alpha=0.7)],
    )
    right, up, _ = view.sides
    panel.set_thetagrids(np.arange(0.0, 360.0, 30.0), [right, "", "", up, *[""] * 8])
    panel.tick_params(axis="x", pad=0.0)
    panel.grid(**NET)
    panel.set(ylim=(0.0, view.radius(view.rim)))
    # The layout measures how far the title reaches above the place of the panel. A round
    # panel fills that place up to its top only if it is put there; in the middle of a
    # place that is higher than wide, too little space would be reserved.
    panel.set_anchor("N")
    panel.set_title(title, y=1.0, pad=ABOVE_AXIS_NAME_PT)


def _tint(values: Floats, unit: str) -> Normalize:
    """Return the scale of colours of maps: by steps where values are few whole numbers."""
    low, high = choose_map_range(values, unit)
    if unit == "" and np.all(values == np.round(values)) and high < MOST_WHOLE:
        return BoundaryNorm(np.arange(low - 0.5, high + 1.0), 256)
    return Normalize(low, high)


def _maps(
    figure: Figure, panels: Sequence[Any], views: Sequence[View], maps: Sequence[SphereMap]
) -> None:
    """Draw maps in all views, with the scale of their colours."""
    values = np.concatenate([item.shown_values for item in maps])
    values, first = values[np.isfinite(values)], maps[0]
    tint = _tint(values, first.unit)
    look: Look = {"norm": tint, "cmap": style.HEAT, "zorder": 1.0, "rasterized": True}
    for (panel, view), item in product(zip(panels, views, strict=True), maps):
        places = view.placed(item.vertices)
        if not len(item.triangles):
            panel.scatter(*places.T, c=item.values, s=7.0, linewidths=0.0, **look)
            continue
        near = item.triangles[all_finite(places, 1)[item.triangles].all(axis=1)]
        if len(near):
            turn, away = np.nan_to_num(places).T
            mesh = Triangulation(away * np.cos(turn), away * np.sin(turn), near)
            # Shades within triangles take a way to the paper that is affine.
            flat = panel.transProjectionAffine + panel.transWedge + panel.transAxes
            if isinstance(tint, BoundaryNorm):
                lowest = np.min(item.values[near], axis=1)
                panel.tripcolor(mesh, facecolors=lowest, transform=flat, **look)
            else:
                shade: Look = look | {"shading": "gouraud", "transform": flat}
                panel.tripcolor(mesh, item.values, **shade)
            panel.grid(**NET)  # which tripcolor puts out
    bar = colour_bar(
        figure, panels, values, tint, style.HEAT, title_with_unit(first.label, first.unit)
    )
    if isinstance(tint, BoundaryNorm):
        whole = np.unique(np.round(tint.boundaries[:-1] + 0.5))
        bar.set_ticks(whole, labels=[f"{n:.0f}" for n in whole])


def _curves(panel: Axes, view: View, item: SphereCurves) -> None:
    """Draw curves, and the marks that have to be told from them, by names of what."""
    look = style.tone_look(item.tone) | {"linewidth": 1.3, "label": plot_text(item.label)}
    for curve in item.curves:
        panel.plot(*view.placed(np.asarray(curve)).T, **look)
    for mark in item.marks:
        alike, look = mark.label == item.label, spot_look(mark.tone)
        if view.angles(mark.place[None])[0] <= view.rim + 1e-9 and not (
            alike and item.curves
        ):
            name = mark.label if alike or item.curves else f"{item.label}: {mark.label}"
            place = view.placed(mark.place[None])[0]
            panel.plot(*place, label=plot_text(name), zorder=4.0, clip_on=False, **look)
