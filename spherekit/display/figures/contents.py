"""The figures of a run by name: planned from its scenes, and drawn on request."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from spherekit.display.figures.curve_plots import draw_curves
from spherekit.display.figures.diagram_plots import draw_diagrams
from spherekit.display.figures.input_maps import draw_maps, find_grid, path_axis
from spherekit.display.figures.matplotlib_sdk import Figure
from spherekit.display.figures.plane_plots import draw_plane, is_path
from spherekit.display.figures.sheet import Sheet, as_data_url
from spherekit.display.figures.sphere_plots import draw_paths, draw_sphere
from spherekit.display.figures.sphere_projection import directions_to_show
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

MAX_PANELS = 12
"""Largest number of panels of one figure. More panels are divided into several figures."""

ShownItem = tuple[Scene, Any]
"""A primitive with the scene that shows it."""


class PlannedFigure(NamedTuple):
    """A figure that is not drawn yet.

    Attributes
    ----------
    subject
        Name of the figure within its analysis.
    draw
        Function that draws the figure.
    """

    subject: str
    draw: Callable[[], Figure]


class Figures(Mapping[str, Figure]):
    """The figures of a run by their names, ``analysis/subject``.

    A figure is drawn when it is requested for the first time.

    Parameters
    ----------
    draw_by_name
        For each figure, by its name ``analysis/subject``, the function that draws it.
    """

    def __init__(self, draw_by_name: Mapping[str, Callable[[], Figure]]) -> None:
        """Begin without drawn figures."""
        self._draw_by_name = draw_by_name
        self._figure_by_name: dict[str, Figure] = {}

    def __len__(self) -> int:
        return len(self._draw_by_name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._draw_by_name)

    def __getitem__(self, name: str) -> Figure:
        """Return the figure with a full or short name, and draw it if necessary.

        The full name is ``analysis/subject``. The subject is enough if only one figure has
        this subject. The analysis is enough if it has only one figure.

        Raises
        ------
        AnalysisError
            If no figure has this name, or several figures have it.
        """
        subject_by_name = {key: key.partition("/")[2] for key in self}
        names = [name] if name in self else []
        if not names:
            names = [key for key, subject in subject_by_name.items() if name == subject]
        if not names:
            names = [key for key in self if key.startswith(f"{name}/")]
        if not names:
            # Names for the message. The list is empty if no analysis drew anything.
            all_names = (
                listing(self, len(self))
                or "none, because no analysis of this run draws a figure"
            )
            suggestion = nearest(str(name), [*self, *subject_by_name.values()])
            raise AnalysisError(
                f"this run has no figure {name!r}{suggestion or '.'} Figures: {all_names}"
            )
        if len(names) > 1:
            raise AnalysisError(
                f"the name {name!r} matches several figures; give the whole name: "
                f"{listing(names, len(names))}"
            )
        (key,) = names
        # Each figure is drawn only once.
        if key not in self._figure_by_name:
            self._figure_by_name[key] = self._draw_by_name[key]()
        return self._figure_by_name[key]

    def __contains__(self, name: object) -> bool:
        return name in self._draw_by_name

    def __repr__(self) -> str:
        return f"<figures: {listing(self, len(self)) or 'none'}>"

    def _repr_html_(self) -> str:
        return "\n".join(
            f'<figure><img alt="{html_text(name)}" src="{as_data_url(self[name])}" '
            f'style="max-width: 100%"><figcaption>{html_text(name)}</figcaption></figure>'
            for name in self
        )


def plan_figures(
    scenes: Sequence[Scene],
    titles: Mapping[int, str],
    degrees: bool = True,
    columns: Columns = 2,
) -> Figures:
    """Return the figures of a run, which are drawn when they are first read.

    A scene has the objects that are drawn on one page. A page shows one assembly mode (way
    to assemble the mechanism), or has a title and shows other results.

    Parameters
    ----------
    scenes
        The scenes, each with all samples of the run.
    titles
        Titles of the assembly modes, by number.
    degrees
        Whether angles are in degrees, otherwise in rad.
    columns
        Width of a figure, as a number of columns of a journal.
    """
    if degrees:
        scenes = [convert_to_degrees(scene) for scene in scenes]
    sheet = Sheet(columns, titles)
    # The `source` of a scene is the analysis that it comes from.
    draw_by_name: dict[str, Callable[[], Figure]] = {}
    for source in dict.fromkeys(scene.source for scene in scenes):
        source_scenes = [scene for scene in scenes if scene.source == source]
        # An analysis can mark inputs, such as singular ones. The curves of every analysis
        # show all these marks, so `_plan_series` needs the scenes of all analyses.
        planned_figures = [
            *_plan_planes(source_scenes, sheet),
            *_plan_spheres(source_scenes, sheet),
            *_plan_series(source_scenes, scenes, sheet),
            *_plan_surfaces(source_scenes, sheet),
            *_plan_paths(source_scenes, sheet),
            *_plan_axodes(source_scenes, sheet),
            *_plan_diagrams(source_scenes, sheet),
        ]
        for planned_figure in planned_figures:  # of equal names the first one counts
            subject = planned_figure.subject
            name = f"{source}/{subject}" if source else subject
            draw_by_name.setdefault(name, planned_figure.draw)
    return Figures(draw_by_name)


def _plan_series(
    source_scenes: Sequence[Scene], all_scenes: Sequence[Scene], sheet: Sheet
) -> Iterator[PlannedFigure]:
    """Yield figures of series: curves over one axis, or maps over two inputs.

    A series has one number for each sample, and a label such as "pole 3/1". The `group` of
    a series is its kind of quantity. Curves of one group share a figure, or several figures
    if they need too many panels. Maps have a figure for each label.

    A scene has the objects that are drawn on one page. `Scene.page` is the number of an
    assembly mode (way to assemble the mechanism), or a title. `Scene.over` has the axes of
    the plot, such as inputs or time.

    Parameters
    ----------
    source_scenes
        Scenes of one analysis.
    all_scenes
        Scenes of all analyses. The inputs that these scenes mark are drawn on the curves.
    sheet
        Size of the figures, and titles of modes.
    """
    # Series of all assembly modes are grouped together. Series of a page with a title are
    # grouped separately.
    items_by_title_and_group = _group_items(source_scenes, Series, "group")
    for (_, group), items in items_by_title_and_group.items():
        shown_series = [
            (scene, series)
            for scene, series in items
            if scene.over and np.any(np.isfinite(series.values))
        ]
        if not shown_series:
            continue
        first_scene, _ = shown_series[0]
        axes = first_scene.over
        if len(axes) > 1 and find_grid(axes) is not None:
            # Maps: a figure for each label, with a panel for each assembly mode.
            for label in dict.fromkeys(series.label for _, series in shown_series):
                maps = [
                    (scene, series)
                    for scene, series in shown_series
                    if series.label == label
                ]
                subject = group if label == group else f"{group}: {label}"
                yield from _divide(subject, maps, _page_of, draw_maps, sheet)
            continue
        # Curves are drawn over one axis. With several inputs whose samples form no grid,
        # the samples are points of a path, and `path_axis` returns the length along it.
        curves = [
            (replace(scene, over=(path_axis(scene.over),)), series)
            for scene, series in shown_series
        ]
        # Inputs that an analysis marks, such as singular ones, are drawn on the curves. On
        # the length of a path such marks have no position.
        marks: list[tuple[Page, InputMarks]] = []
        if len(axes) == 1:
            marks = _find_marks(all_scenes, axes[0].label)
        # A panel for each label, with the curves of all assembly modes.
        yield from _divide(group, curves, _label_of, partial(draw_curves, marks), sheet)


def _find_marks(scenes: Sequence[Scene], axis_label: str) -> list[tuple[Page, InputMarks]]:
    """Return the marked values of the quantity on the x axis of a plot, with their pages.

    Analyses mark special values, such as the inputs at singularities. The caller draws the
    marks of all analyses in each plot of curves over the same quantity.

    A page is the number of an assembly mode (way to assemble the mechanism), or a title.

    Parameters
    ----------
    scenes
        Scenes (drawn objects of one page) of all analyses. Their attribute `over` lists the
        quantities on the axes.
    axis_label
        Label of the quantity on the x axis. Scenes over another quantity, or over several
        quantities, are left out.
    """
    marks: list[tuple[Page, InputMarks]] = []
    for scene in scenes:
        if [axis.label for axis in scene.over] == [axis_label]:
            marks += [
                (scene.page, primitive)
                for primitive in scene.primitives
                if isinstance(primitive, InputMarks)
            ]
    return marks


def _page_of(item: ShownItem) -> Hashable:
    """Return the mode number or title of the page on which a primitive is shown."""
    scene, _ = item
    return scene.page


def _label_of(item: ShownItem) -> Hashable:
    """Return the label of a primitive."""
    _, primitive = item
    label: str = primitive.label
    return label


def _divide(
    subject: str,
    items: Sequence[ShownItem],
    panel_of: Callable[[ShownItem], Hashable],
    draw: Callable[[Sequence[Any], Sheet], Figure],
    sheet: Sheet,
) -> Iterator[PlannedFigure]:
    """Plan a figure of drawn objects, or several figures if there are too many panels.

    Each figure has at most `MAX_PANELS` panels. The panels are divided evenly among the
    figures.

    Parameters
    ----------
    subject
        Name of the figure.
    items
        The drawn objects (curves, maps, arrows, ...) with their scenes.
    panel_of
        Function that returns the panel of an item. Items with equal results share a panel.
    draw
        Function that draws a figure of items.
    sheet
        Size of the figures, and titles of modes.
    """
    panels = list(dict.fromkeys(map(panel_of, items)))
    figure_count = -(-len(panels) // MAX_PANELS)  # rounded up
    panel_numbers = np.array_split(np.arange(len(panels)), figure_count)
    for figure_number, numbers in enumerate(panel_numbers, 1):
        figure_panels = [panels[number] for number in numbers]
        figure_items = [item for item in items if panel_of(item) in figure_panels]
        name = subject
        if figure_count > 1:
            name = f"{subject}, {figure_number} of {figure_count}"
        yield PlannedFigure(name, partial(draw, figure_items, sheet))


def _plan_planes(scenes: Sequence[Scene], sheet: Sheet) -> Iterator[PlannedFigure]:
    """Yield the figures of portraits (plots of one quantity against another).

    Portraits with equal labels share a figure. A figure without curves, marks and paths is
    left out.
    """
    for (_, label), items in _group_items(scenes, Portrait, "label").items():
        has_content = any(
            portrait.curves or portrait.marks or is_path((scene, portrait))
            for scene, portrait in items
        )
        if has_content:
            yield PlannedFigure(label, partial(draw_plane, items, sheet))


def _plan_spheres(scenes: Sequence[Scene], sheet: Sheet) -> Iterator[PlannedFigure]:
    """Plan the figures of curves and maps on the sphere, one for each page.

    A map is a part of the sphere that is coloured by a value at each point. A page is the
    number of an assembly mode (way to assemble the mechanism), or a title. If several
    scenes of one page have the same object, the object is drawn once.

    Parameters
    ----------
    scenes
        The scenes (drawn objects of one page) of one analysis.
    sheet
        Size of the figures, and titles of modes.
    """
    primitives_by_page: dict[Page, dict[str, Any]] = {}
    for scene in scenes:
        for primitive in scene.primitives:
            if isinstance(primitive, SphereCurves | SphereMap):
                primitives = primitives_by_page.setdefault(scene.page, {})
                primitives.setdefault(primitive.path, primitive)
    for page, primitives in primitives_by_page.items():
        maps = [item for item in primitives.values() if isinstance(item, SphereMap)]
        curves = [item for item in primitives.values() if isinstance(item, SphereCurves)]
        if not len(directions_to_show(maps, curves)):
            continue
        name = "on the sphere"
        if isinstance(page, int):
            name = f"on the sphere, {sheet.title(page)}"
        elif page:
            name = f"{page[:1].lower()}{page[1:]} on the sphere"
        yield PlannedFigure(name, partial(draw_sphere, maps, curves, sheet))


def _plan_surfaces(scenes: Sequence[Scene], sheet: Sheet) -> Iterator[PlannedFigure]:
    """Yield the surfaces: a figure for each space of three quantities."""
    surfaces_by_axes: dict[Any, dict[str, Surface]] = {}
    for (_, axes), items in _group_items(scenes, Surface, "axes").items():
        surface_by_path = {surface.path: surface for _, surface in items}
        surfaces_by_axes.setdefault(axes, {}).update(surface_by_path)
    for number, surface_by_path in enumerate(surfaces_by_axes.values(), 1):
        name = "surfaces" if len(surfaces_by_axes) == 1 else f"surfaces {number}"
        surfaces = list(surface_by_path.values())
        yield PlannedFigure(name, partial(draw_surfaces, surfaces, sheet))


def _plan_paths(scenes: Sequence[Scene], sheet: Sheet) -> Iterator[PlannedFigure]:
    """Plan the figures of the paths of pole axes on the sphere.

    A pole axis is the axis about which one link turns relative to another link. Axes of
    pairs (joints) are left out. A path is drawn for each assembly mode (way to assemble the
    mechanism). Samples over several inputs are not successive points of one motion, so they
    have no path.

    Parameters
    ----------
    scenes
        The scenes (drawn objects of one page) of one analysis.
    sheet
        Size of the figures, and titles of modes.
    """
    arrows: list[ShownItem] = []
    for scene in scenes:
        # The scenes of assembly modes have the number of the mode as their page. Only these
        # scenes are drawn. `over` has the axes of the plot, such as inputs or the time.
        if not isinstance(scene.page, int) or len(scene.over) != 1:
            continue
        for primitive in scene.primitives:
            # Arrows are left out if users have to switch them on (`shown`), if they have no
            # path, or if they are axes of pairs (`primary`).
            if (
                isinstance(primitive, Arrow)
                and primitive.shown
                and primitive.path_shown
                and not primitive.primary
            ):
                arrows.append((scene, primitive))
    if arrows:
        # Arrows of one label share a panel.
        yield from _divide("paths of the axes", arrows, _label_of, draw_paths, sheet)


def _plan_axodes(scenes: Sequence[Scene], sheet: Sheet) -> Iterator[PlannedFigure]:
    """Yield a figure of the axodes for each assembly mode (way to assemble the links).

    Axodes are the paths of the axes of relative rotation (poles), as seen from a link. The
    axodes are drawn with the link in the first pose of the motion.
    """
    for scene in scenes:
        # The page of an assembly mode is its number. Pages with a title get no figure.
        if not isinstance(scene.page, int):
            continue
        traces = [item for item in scene.primitives if isinstance(item, Trace)]
        curves = [
            # `at_first` has the directions of the axis as points of a curve, with the link
            # in its first pose.
            SphereCurves(
                path=trace.path,  # address in the tree of the scene
                label=trace.label,
                curves=[trace.at_first],
                tone=tone,
            )
            for tone, trace in enumerate(traces, start=1)
        ]
        if curves:
            name = f"axodes, {sheet.title(scene.page)}"
            draw = partial(draw_sphere, maps=[], curves=curves, sheet=sheet)
            yield PlannedFigure(name, draw)


def _plan_diagrams(scenes: Sequence[Scene], sheet: Sheet) -> Iterator[PlannedFigure]:
    """Yield diagrams of points in a plane over one input, a panel for each mode."""
    for (page, label), items in _group_items(scenes, Diagram, "label").items():
        diagrams = [(scene, item) for scene, item in items if len(scene.over) == 1]
        if diagrams and not page:
            yield from _divide(label, diagrams, _page_of, draw_diagrams, sheet)


def _group_items(
    scenes: Sequence[Scene], kind: type, attribute: str
) -> dict[tuple[str, Any], list[ShownItem]]:
    """Group the drawn objects of one class by page title and by one attribute.

    Figures are planned from these groups. The page of a scene is a title, or the number of
    an assembly mode (way to assemble the mechanism). Scenes of assembly modes have no
    title, so objects of different modes can be in one group.

    Parameters
    ----------
    scenes
        The scenes (drawn objects of one page) of one analysis.
    kind
        Class of the objects.
    attribute
        Name of the attribute by which they are grouped.

    Returns
    -------
    The objects with their scenes, by the title of the page and the value of the
    attribute. The title is ``""`` for assembly modes.
    """
    groups: dict[tuple[str, Any], list[ShownItem]] = {}
    for scene in scenes:
        page_title = scene.page if isinstance(scene.page, str) else ""
        for primitive in scene.primitives:
            if isinstance(primitive, kind):
                key = page_title, getattr(primitive, attribute)
                groups.setdefault(key, []).append((scene, primitive))
    return groups
