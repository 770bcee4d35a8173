"""Which figures the scenes of a run make, by name, each drawn when it is asked for."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from spherekit.display.figures.curve_plots import (
    draw_curves,
    draw_paths,
    draw_sphere,
    focus_of,
)
from spherekit.display.figures.diagram_plots import draw_diagrams
from spherekit.display.figures.input_maps import along_path, draw_maps, ticks
from spherekit.display.figures.matplotlib_sdk import Figure
from spherekit.display.figures.plane_plots import draw_plane, is_path
from spherekit.display.figures.sheet import Sheet, as_data_url
from spherekit.display.figures.style import Columns
from spherekit.display.figures.surface_plots import draw_surfaces
from spherekit.errors import AnalysisError
from spherekit.escaping import html_text
from spherekit.scenes.scene import (
    Arrow,
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
    convert_to_degrees,
)
from spherekit.wording import listing, nearest

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
        scenes = [convert_to_degrees(scene) for scene in scenes]
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
