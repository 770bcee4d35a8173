"""Which figures the scenes of a run make, by name, each drawn when it is asked for."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from functools import partial
from html import escape
from typing import Any, TypeVar, final

import numpy as np

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
)
from spherekit.conventions import listing, nearest
from spherekit.errors import AnalysisError
from spherekit.figures.curves import Curve, draw_curves
from spherekit.figures.diagrams import draw_diagrams
from spherekit.figures.input_maps import InputMap, along_path, draw_maps, ticks
from spherekit.figures.plane import Plane, draw_plane
from spherekit.figures.sdk import Figure
from spherekit.figures.sheet import Sheet, as_data_url
from spherekit.figures.sphere import OnSphere, draw_paths, draw_sphere
from spherekit.figures.style import Columns
from spherekit.figures.surfaces import draw_surfaces

MOST_PANELS = 12
"""A figure with more is parted in several."""

Draw = Callable[[], Figure]
Item = TypeVar("Item")


@final
class Figures(Mapping[str, Figure]):
    """The figures of a run by their names, ``analysis/subject``; drawn when asked for."""

    def __init__(self, drawn: Mapping[str, Draw]) -> None:
        self._draw = dict(drawn)
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
            f'<figure><img alt="{escape(name)}" src="{as_data_url(self[name])}" '
            f'style="max-width: 100%"><figcaption>{escape(name)}</figcaption></figure>'
            for name in self
        )


def figures_of(
    scenes: Sequence[Scene],
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
        for subject, draw in _of_source(of_source, scenes, sheet):
            drawn.setdefault(f"{source}/{subject}" if source else subject, draw)
    return Figures(drawn)


def _of_source(
    of_source: Sequence[Scene], every: Sequence[Scene], sheet: Sheet
) -> Iterator[tuple[str, Draw]]:
    yield from _planes(of_source, sheet)
    yield from _spheres(of_source, sheet)
    yield from _series(of_source, every, sheet)
    yield from _surfaces(of_source, sheet)
    yield from _paths(of_source, sheet)
    yield from _axodes(of_source, sheet)
    yield from _diagrams(of_source, sheet)


def _series(
    of_source: Sequence[Scene], every: Sequence[Scene], sheet: Sheet
) -> Iterator[tuple[str, Draw]]:
    groups = _grouped(
        of_source, Series, lambda scene, item: (_kind(scene.page), item.group)
    )
    for (_, name), items in groups.items():
        lines = [
            (scene, item)
            for scene, item in items
            if scene.over and np.any(np.isfinite(item.values))
        ]
        if not lines:
            continue
        over = lines[0][0].over
        if len(over) > 1 and ticks(over) is not None:
            for label in dict.fromkeys(item.label for _, item in lines):
                maps = [InputMap(s.page, i, s.over) for s, i in lines if i.label == label]
                subject = name if label == name else f"{name}: {label}"
                yield from _parted(subject, maps, _each_page, draw_maps, sheet)
            continue
        curves = [Curve(scene.page, item, _axis(scene.over)) for scene, item in lines]
        marks = _marks(every, over)

        def draw(some: Sequence[Curve], sheet: Sheet, marks: Any = marks) -> Figure:
            return draw_curves(some, marks, sheet)

        yield from _parted(name, curves, lambda curve: curve.series.label, draw, sheet)


def _axis(over: Sequence[Axis]) -> Axis:
    return over[0] if len(over) == 1 else along_path(over)


def _each_page(item: InputMap) -> Hashable:
    return item.page


def _parted(
    name: str,
    items: Sequence[Item],
    panel: Callable[[Item], Hashable],
    draw: Callable[[Sequence[Item], Sheet], Figure],
    sheet: Sheet,
) -> Iterator[tuple[str, Draw]]:
    """Yield one figure of items, or several of as many panels as are readable."""
    panels = list(dict.fromkeys(panel(item) for item in items))
    parts = -(-len(panels) // MOST_PANELS)
    size = -(-len(panels) // parts)
    for k in range(parts):
        chosen = set(panels[k * size : (k + 1) * size])
        some = [item for item in items if panel(item) in chosen]
        title = name if parts == 1 else f"{name}, {k + 1} of {parts}"
        yield title, partial(draw, some, sheet)


def _marks(scenes: Sequence[Scene], over: Sequence[Axis]) -> list[tuple[Page, InputMarks]]:
    """Return what is marked on the axis of plots over one, whatever analysis says it."""
    return [
        (scene.page, item)
        for scene in scenes
        for item in scene.primitives
        if isinstance(item, InputMarks)
        and len(over) == 1
        and [axis.label for axis in scene.over] == [over[0].label]
    ]


def _planes(of_source: Sequence[Scene], sheet: Sheet) -> Iterator[tuple[str, Draw]]:
    groups = _grouped(
        of_source, Portrait, lambda scene, item: (_kind(scene.page), item.label)
    )
    of_modes = {name for page, name in groups if not page}
    for (page, name), items in groups.items():
        planes = [Plane(scene.page, item, scene.over) for scene, item in items]
        if page and name in of_modes:  # the same once more, for a page of its own
            continue
        if any(plane.shows for plane in planes):
            yield name, partial(draw_plane, planes, sheet)


def _spheres(of_source: Sequence[Scene], sheet: Sheet) -> Iterator[tuple[str, Draw]]:
    pages: dict[str, list[Scene]] = {}
    seen: set[bytes] = set()
    for scene in of_source:
        pages.setdefault(_kind(scene.page), []).append(scene)
    for name, scenes in pages.items():
        curves: dict[str, SphereCurves] = {}
        maps: dict[str, SphereMap] = {}
        for item in (item for scene in scenes for item in scene.primitives):
            if isinstance(item, SphereCurves):
                curves.setdefault(item.path, item)
            elif isinstance(item, SphereMap):
                maps.setdefault(item.path, item)
        shown = OnSphere(list(maps.values()), list(curves.values()))
        if len(shown.focus()) and shown.content not in seen:
            seen.add(shown.content)
            title = f"{name[:1].lower()}{name[1:]} on the sphere".strip()
            yield title, partial(draw_sphere, shown, sheet)


def _surfaces(of_source: Sequence[Scene], sheet: Sheet) -> Iterator[tuple[str, Draw]]:
    groups = _grouped(of_source, Surface, lambda scene, item: item.axes)
    for number, items in enumerate(groups.values()):
        surfaces = list({item.path: item for _, item in items}.values())
        name = "surfaces" if len(groups) == 1 else f"surfaces {number + 1}"
        yield name, partial(draw_surfaces, surfaces, sheet)


def _paths(of_source: Sequence[Scene], sheet: Sheet) -> Iterator[tuple[str, Draw]]:
    """Yield the paths of axes of modes; over several inputs there are no paths."""
    arrows = [
        (scene.page, item)
        for scene in of_source
        for item in scene.primitives
        if isinstance(item, Arrow)
        and item.path_shown
        and item.shown
        and not item.primary
        and isinstance(scene.page, int)
        and len(scene.over) == 1
    ]
    yield from (
        _parted(
            "paths of the axes", arrows, lambda entry: entry[1].label, draw_paths, sheet
        )
        if arrows
        else ()
    )


def _axodes(of_source: Sequence[Scene], sheet: Sheet) -> Iterator[tuple[str, Draw]]:
    """Yield for each mode the paths of directions in links, as these stand at first."""
    for scene in of_source:
        traces = [trace for trace in scene.primitives if isinstance(trace, Trace)]
        curves = [
            SphereCurves(trace.path, trace.label, [trace.at_first], tone)
            for tone, trace in enumerate(traces, start=1)
        ]
        if curves and isinstance(scene.page, int):
            title = f"axodes, {sheet.title(scene.page)}"
            yield title, partial(draw_sphere, OnSphere([], curves), sheet)


def _diagrams(of_source: Sequence[Scene], sheet: Sheet) -> Iterator[tuple[str, Draw]]:
    groups = _grouped(
        of_source, Diagram, lambda scene, item: (_kind(scene.page), item.label)
    )
    for (page, label), items in groups.items():
        diagrams = [(scene.page, item) for scene, item in items if len(scene.over) == 1]
        if diagrams and not page:
            yield from _parted(label, diagrams, lambda item: item[0], draw_diagrams, sheet)


def _kind(page: Page) -> str:
    """Return the title of a page of its own; modes share figures."""
    return page if isinstance(page, str) else ""


def _grouped(
    scenes: Sequence[Scene],
    kind: type[Item],
    key: Callable[[Scene, Item], Hashable],
) -> dict[Any, list[tuple[Scene, Item]]]:
    groups: dict[Any, list[tuple[Scene, Item]]] = {}
    for scene in scenes:
        for item in scene.primitives:
            if isinstance(item, kind):
                groups.setdefault(key(scene, item), []).append((scene, item))
    return groups
