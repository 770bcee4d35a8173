"""Which figures the scenes of a run make, by name, each drawn when it is asked for.

Triangulated surfaces in a space of three quantities.

Points that move in a plane with one scale on both axes: their paths, a panel a mode.

A quantity over a grid of two inputs: a map for each mode, zeros drawn as lines.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, product
from textwrap import fill
from typing import Any

import numpy as np

from spherekit.analysis.plotted import map_range, parted, plotted_range, scale_of
from spherekit.analysis.scene import (
    Arrow,
    Axis,
    Diagram,
    InputMarks,
    Page,
    Portrait,
    Scene,
    Series,
    SphereCurves,
    SphereMap,
    Surface,
    Trace,
    in_degrees,
    titled,
)
from spherekit.arrays import Floats
from spherekit.conventions import listing, nearest
from spherekit.errors import AnalysisError
from spherekit.escaping import html_text, plot_text
from spherekit.figures import style
from spherekit.figures.curves import Curve, draw_curves, draw_paths, draw_sphere, focus_of
from spherekit.figures.plane import draw_plane, is_path
from spherekit.figures.sdk import Axes, Figure, Normalize
from spherekit.figures.sheet import (
    Sheet,
    as_data_url,
    colour_bar,
    label_outside,
    name_points,
    ticks_of,
)
from spherekit.figures.style import Columns, Look


def draw_surfaces(surfaces: Sequence[Surface], sheet: Sheet) -> Figure:
    """Return a figure of surfaces in the same space."""
    with style.look():
        figure = sheet.figure(1, min(sheet.width, 4.5))
        panel: Any = figure.add_subplot(projection="3d")
        for surface in surfaces:
            colour, values = style.tone_colour(surface.tone), surface.values
            x, y, z = surface.vertices.T
            if len(surface.triangles):
                look: Look = {"color": colour, "alpha": 0.6, "linewidth": 0.0}
                panel.plot_trisurf(x, y, z, triangles=surface.triangles, **look)
                # An empty curve: what the legend takes for the surface.
                panel.plot([], [], [], color=colour, label=plot_text(surface.label))
            elif values is None:
                panel.scatter(x, y, z, c=colour, s=3.0)
            else:
                tint = Normalize(*map_range(values, surface.values_unit))
                panel.scatter(x, y, z, s=3.0, c=values, norm=tint, cmap=style.HEAT)
                words = titled(surface.label, surface.values_unit)
                colour_bar(figure, panel, values, tint, style.HEAT, words, 0.12)
        first = surfaces[0]
        x, y, z = (plot_text(titled(name, first.unit)) for name in first.axes)
        panel.set(xlabel=x, ylabel=y, zlabel=z)
        panel.set_box_aspect((1, 1, 1), zoom=0.85)
        return sheet.name(figure)


RATIO = 0.95
FAR = 0.5
"""Steps of a path longer than this part of the frame lead through infinity."""


def draw_diagrams(items: Sequence[tuple[Scene, Diagram]], sheet: Sheet) -> Figure:
    """Return a figure of the paths of points, each named where it starts."""
    with style.look():
        figure, panels = sheet.panels(len(items), RATIO)
        for panel, (scene, item) in zip(panels, items, strict=True):
            ranges = item.x_range, item.y_range
            panel.set(xlim=item.x_range, ylim=item.y_range, aspect="equal")
            panel.set_title(sheet.title(scene.page))
            for k, name in enumerate(item.names):
                path = item.places[:, k]
                far = np.abs(np.diff(path, axis=0)) > FAR * np.ptp(ranges, axis=1)
                look = _look(item, k) | {"label": plot_text(name)}
                panel.plot(*parted(path, np.any(far, 1)).T, **look)
        label_outside(panels, items[0][1].x_label, items[0][1].y_label)
        figure.draw_without_rendering()
        for panel, (_, item) in zip(panels, items, strict=True):
            _label(panel, item)
    return figure


def _look(item: Diagram, number: int) -> Look:
    """Return how a path is drawn: of a tone in ink, or one of its own."""
    if item.tones[number] == 0:
        return {"color": style.INK}
    return style.series_look(number - item.tones[:number].count(0))


def _label(panel: Axes, item: Diagram) -> None:
    """Name each point where its path is in the frame first, with a dot there."""
    low, high = np.transpose([item.x_range, item.y_range])
    seen = np.all((item.places >= low) & (item.places <= high), axis=2)
    shown = np.flatnonzero(seen.any(axis=0)).tolist()
    if not shown:
        return
    starts = item.places[np.argmax(seen, axis=0)[shown], shown]
    tints = [_look(item, k)["color"] for k in shown]
    for start, tint in zip(starts, tints, strict=True):
        panel.plot(*start, "o", color=tint, markersize=2.5)
    name_points(panel, [item.names[k] for k in shown], starts, tints)


SIGNED = "RdBu_r"
TURNED = 0.3
"""Neighbours of unlike signs that differ by more, over the range, pass no zero."""
MOST_SLICES = 3
"""Values of further inputs at which a map is drawn."""


def ticks(over: Sequence[Axis]) -> list[Floats] | None:
    """Return the values of each axis if the rows are a grid of them, the last quickest."""
    rows = [axis.values for axis in over]
    per_axis = [np.unique(values) for values in rows]
    counts = [len(values) for values in per_axis]
    if min(counts) < 2 or np.prod(counts) != len(rows[0]):
        return None
    mesh = np.meshgrid(*per_axis, indexing="ij")
    return per_axis if np.array_equal(rows, np.reshape(mesh, np.shape(rows))) else None


def along_path(over: Sequence[Axis]) -> Axis:
    """Return how far rows are along a path of several inputs; of one, its axis."""
    if len(over) == 1:
        return over[0]
    points = np.stack([axis.values for axis in over], axis=1)
    steps = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    return Axis("path of the inputs", over[0].unit, np.cumsum(steps))


def draw_maps(maps: Sequence[Curve], sheet: Sheet) -> Figure:
    """Return a figure of one quantity over two inputs, in every mode.

    With more inputs at the first, the middle and the last value of the others.
    """
    over, first = maps[0][0].over, maps[0][1]
    grid = ticks(over)
    assert grid is not None
    ends = (np.linspace(0, len(x) - 1, min(MOST_SLICES, len(x))) for x in grid[2:])
    slices = [*product(*(np.round(end).astype(int) for end in ends))]
    values = np.concatenate([item.values for _, item in maps])
    low, high = plotted_range(
        values, scale_of(values, first.unit), first.resolution, "colours"
    )
    signed = low < 0.0 < high and np.nanmin(values) < 0.0 < np.nanmax(values)
    if signed:
        low, high = -max(-low, high), max(-low, high)
    tint, colours = Normalize(low, high), SIGNED if signed else style.HEAT
    look: Look = {"norm": tint, "cmap": colours, "rasterized": True, "shading": "nearest"}
    shape = [len(axis) for axis in grid]
    with style.look():
        figure, panels = sheet.panels(len(maps) * len(slices), RATIO)
        for panel, ((scene, item), at) in zip(panels, product(maps, slices), strict=True):
            table = np.moveaxis(item.values.reshape(shape), (0, 1), (-2, -1))[at]
            panel.pcolormesh(grid[0], grid[1], table.T, **look)
            if signed:
                _zeros(panel, grid[0], grid[1], table, high - low)
            words = [sheet.title(scene.page)] if isinstance(scene.page, int) else []
            words += [
                f"{plot_text(axis.label)} = {values_of[k]:.4g} {axis.unit}"
                for axis, values_of, k in zip(over[2:], grid[2:], at, strict=True)
            ]
            panel.set_title("\n".join(words), color=style.page_look(scene.page)["color"])
            panel.set(facecolor="#eeeeee", box_aspect=1.0)
            ticks_of(panel, over[0].unit, over[1].unit)
        label_outside(panels, over[0].words, over[1].words)
        label = "" if first.label == first.group else f"{first.label}: "
        colour_bar(figure, panels, values, tint, colours, fill(label + first.heading, 42))
    return figure


def _zeros(panel: Axes, x: Floats, y: Floats, table: Floats, span: float) -> None:
    """Draw where a quantity passes zero, and not where its sign is turned."""
    still = table.copy()
    for axis, end in product((0, 1), ("prepend", "append")):
        beyond: Look = {end: np.nan}
        still[np.abs(np.diff(table, axis=axis, **beyond)) > TURNED * span] = np.nan
    if np.any(still < 0.0) and np.any(still > 0.0):
        panel.contour(x, y, still.T, levels=[0.0], colors=style.INK, linewidths=0.8)


MOST_PANELS = 12
"""A figure with more is parted in several."""

Scenes = Sequence[Scene]
Draw = Callable[[], Figure]
Drawn = Iterator[tuple[str, Draw]]
"""Figures by their names, each drawn when it is asked for."""
Shown = tuple[Scene, Any]
"""What a scene shows, with the scene."""


class Figures(Mapping[str, Figure]):
    """The figures of a run by their names, ``analysis/subject``; drawn when asked for."""

    def __init__(self, drawn: Mapping[str, Draw]) -> None:
        self._draw = drawn
        self._made: dict[str, Figure] = {}

    def __len__(self) -> int:
        return len(self._draw)

    def __iter__(self) -> Iterator[str]:
        return iter(self._draw)

    def __getitem__(self, name: str) -> Figure:
        """Return the figure of a name, or of a subject that only one name has.

        Raises
        ------
        AnalysisError
            If there is none, or several.
        """
        names = [figure for figure in self if name in (figure, figure.partition("/")[2])]
        names = names or [figure for figure in self if figure.startswith(f"{name}/")]
        if len(names) != 1:
            what = f"several figures are meant by {name!r}: {listing(names, len(names))}"
            if not names:
                all_names = listing(self, len(self)) or "none, as nothing was to be seen"
                close = nearest(
                    name, [*self, *(figure.partition("/")[2] for figure in self)]
                )
                what = f"this run has no figure {name!r}{close or '.'} Figures: {all_names}"
            raise AnalysisError(what)
        (key,) = names
        if key not in self._made:
            self._made[key] = self._draw[key]()
        return self._made[key]

    def __contains__(self, name: object) -> bool:
        return name in self._draw

    def __repr__(self) -> str:
        return f"<figures: {listing(self, len(self)) or 'none'}>"

    def _repr_html_(self) -> str:
        return "\n".join(
            f'<figure><img alt="{html_text(name)}" src="{as_data_url(self[name])}" '
            f'style="max-width: 100%"><figcaption>{html_text(name)}</figcaption></figure>'
            for name in self
        )


def figures_of(
    scenes: Scenes,
    titles: Mapping[int, str],
    degrees: bool = True,
    columns: Columns = 2,
) -> Figures:
    """Return the figures that scenes of a run make, with angles in degrees or rad.

    `titles` are the names of the assembly modes, `columns` says over how many columns of
    a journal a figure goes.
    """
    if degrees:
        scenes = [in_degrees(scene) for scene in scenes]
    sheet = Sheet(columns, titles)
    drawn: dict[str, Draw] = {}
    for source in dict.fromkeys(scene.source for scene in scenes):
        of_source = [scene for scene in scenes if scene.source == source]
        for subject, draw in chain(
            _planes(of_source, sheet),
            _spheres(of_source, sheet),
            _series(of_source, scenes, sheet),
            *(made(of_source, sheet) for made in (_surfaces, _paths, _axodes, _diagrams)),
        ):
            drawn.setdefault(f"{source}/{subject}" if source else subject, draw)
    return Figures(drawn)


def _series(of_source: Scenes, every: Scenes, sheet: Sheet) -> Drawn:
    for (_, name), items in _grouped(of_source, Series, "group").items():
        lines = [x for x in items if x[0].over and np.any(np.isfinite(x[1].values))]
        if not lines:
            continue
        over = lines[0][0].over
        if len(over) > 1 and ticks(over) is not None:
            for label in dict.fromkeys(item.label for _, item in lines):
                maps = [line for line in lines if line[1].label == label]
                subject = name if label == name else f"{name}: {label}"
                yield from _parted(subject, maps, _page, draw_maps, sheet)
            continue
        curves = [(replace(s, over=(along_path(s.over),)), item) for s, item in lines]
        marks = [  # on the axis, whatever analysis says it
            (scene.page, item)
            for scene in every
            for item in scene.primitives
            if isinstance(item, InputMarks)
            and [axis.label for axis in scene.over] == [over[0].label]
        ]
        draw = partial(draw_curves, marks if len(over) == 1 else [])
        yield from _parted(name, curves, _label_of, draw, sheet)


def _page(item: Shown) -> Hashable:
    return item[0].page


def _label_of(item: Shown) -> Hashable:
    return item[1].label


def _parted(
    name: str,
    items: Sequence[Shown],
    panel: Callable[[Shown], Hashable],
    draw: Callable[[Sequence[Any], Sheet], Figure],
    sheet: Sheet,
) -> Drawn:
    """Yield one figure of items, or several of as many panels as are readable."""
    panels = list(dict.fromkeys(map(panel, items)))
    parts = -(-len(panels) // MOST_PANELS)
    for k, chosen in enumerate(np.array_split(np.arange(len(panels)), parts), 1):
        some = [item for item in items if panels.index(panel(item)) in chosen]
        title = name if parts == 1 else f"{name}, {k} of {parts}"
        yield title, partial(draw, some, sheet)


def _planes(of_source: Scenes, sheet: Sheet) -> Drawn:
    for (_, name), items in _grouped(of_source, Portrait, "label").items():
        if any(x[1].curves or x[1].marks or is_path(x) for x in items):
            yield name, partial(draw_plane, items, sheet)


def _spheres(of_source: Scenes, sheet: Sheet) -> Drawn:
    """Yield what is on the sphere: a figure for each page, those of modes too."""
    pages: dict[Page, dict[str, Any]] = {}
    for scene in of_source:
        for item in scene.primitives:
            if isinstance(item, SphereCurves | SphereMap):
                pages.setdefault(scene.page, {}).setdefault(item.path, item)
    for page, items in pages.items():
        maps = [item for item in items.values() if isinstance(item, SphereMap)]
        curves = [item for item in items.values() if isinstance(item, SphereCurves)]
        if len(focus_of(maps, curves)):
            title = "on the sphere"
            if isinstance(page, int):
                title = f"{title}, {sheet.title(page)}"
            elif page:
                title = f"{page[:1].lower()}{page[1:]} {title}"
            yield title, partial(draw_sphere, maps, curves, sheet)


def _surfaces(of_source: Scenes, sheet: Sheet) -> Drawn:
    groups: dict[Any, dict[str, Surface]] = {}
    for (_, axes), items in _grouped(of_source, Surface, "axes").items():
        groups.setdefault(axes, {}).update({item.path: item for _, item in items})
    for number, surfaces in enumerate(groups.values(), 1):
        name = "surfaces" if len(groups) == 1 else f"surfaces {number}"
        yield name, partial(draw_surfaces, list(surfaces.values()), sheet)


def _paths(of_source: Scenes, sheet: Sheet) -> Drawn:
    """Yield the paths of axes of modes; over several inputs there are no paths."""
    arrows = [
        (scene, item)
        for scene in of_source
        for item in scene.primitives
        if isinstance(item, Arrow)
        and item.path_shown
        and item.shown
        and not item.primary
        and isinstance(scene.page, int)
        and len(scene.over) == 1
    ]
    if arrows:
        yield from _parted("paths of the axes", arrows, _label_of, draw_paths, sheet)


def _axodes(of_source: Scenes, sheet: Sheet) -> Drawn:
    """Yield for each mode the paths of directions in links, as these stand at first."""
    for scene in of_source:
        traces = [trace for trace in scene.primitives if isinstance(trace, Trace)]
        curves = [
            SphereCurves(trace.path, trace.label, [trace.at_first], tone)
            for tone, trace in enumerate(traces, start=1)
        ]
        if curves and isinstance(scene.page, int):
            yield (
                f"axodes, {sheet.title(scene.page)}",
                partial(draw_sphere, [], curves, sheet),
            )


def _diagrams(of_source: Scenes, sheet: Sheet) -> Drawn:
    for (page, label), items in _grouped(of_source, Diagram, "label").items():
        diagrams = [x for x in items if len(x[0].over) == 1]
        if diagrams and not page:
            yield from _parted(label, diagrams, _page, draw_diagrams, sheet)


def _grouped(
    scenes: Scenes, kinds: type | tuple[type, ...], key: str
) -> dict[tuple[str, Any], list[Shown]]:
    """Return items of kinds with their scenes, by their pages and what a field says.

    Modes share figures, and have no page of their own.
    """
    groups: dict[tuple[str, Any], list[Shown]] = {}
    for scene in scenes:
        page = scene.page if isinstance(scene.page, str) else ""
        for item in scene.primitives:
            if isinstance(item, kinds):
                groups.setdefault((page, getattr(item, key)), []).append((scene, item))
    return groups
