"""The layout of the viewer's window: pages (tabs) for modes, others, a comparison."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from spherekit.display.rerun.chart_frame import CHART_BOUNDS, COLOUR_SCALE_BOUNDS
from spherekit.display.rerun.entities import GRAPH_SIZE
from spherekit.display.rerun.labels import Sight
from spherekit.display.rerun.rerun_sdk import rr, rrb
from spherekit.display.rerun.timelines import SAMPLE_TIMELINE, TIME_TIMELINE
from spherekit.runs.run_result import MOTION
from spherekit.scenes import colours
from spherekit.scenes.scene import Page, Primitive, Scene

PLAY_SECONDS = 12.0
"""Time (s) in which the viewer plays the whole range of a timeline of inputs.

A range with fewer than `PLAY_SECONDS` ticks takes less time. A timeline of times is played
in real time.
"""

TRAIL_SAMPLES = 24
"""Number of recent samples that are shown as dots behind a pole."""

MAX_COMPARED_CURVES = 60
"""Number of curves above which a plot of all modes is left out.

More curves could not be distinguished.
"""

SURFACE_EYE = (1.9, -2.2, 1.3)
"""Eye of a space with a surface, whose longest side is `entities.CUBE_SIDE`."""

Span = tuple[float, float]
"""The lower and the upper end of a range."""

View = Callable[[], rrb.View]
"""Returns a view when the layout is written, since rerun allows each view only once."""

HIDDEN = rrb.EntityBehavior(visible=False)

MOTION_SOURCES = ("", MOTION)
"""Sources of scenes that show the moving mechanism only, and no findings."""


def shows_findings(scene: Scene) -> bool:
    """Return whether a scene shows results of an analysis, not only the motion."""
    return scene.source not in MOTION_SOURCES


def slug(title: str) -> str:
    """Return a title as a part of a path."""
    return re.sub(r"[^A-Za-z0-9]+", "_", title).strip("_").lower() or "plot"


def unique_slug(title: str, slugs: dict[str, str]) -> str:
    """Return a title as a part of a path that no other title has.

    The paths name charts and pages in the Rerun viewer.

    Parameters
    ----------
    title
        The title of a chart or page.
    slugs
        The parts of paths by title so far. The part of a new title is added.
    """
    if title not in slugs:
        name = word = slug(title)
        number = 1
        while name in slugs.values():
            number += 1
            name = f"{word}_{number}"
        slugs[title] = name
    return slugs[title]


class Plot(NamedTuple):
    """A view beside the sphere: a chart, a diagram, or a surface in three dimensions.

    Attributes
    ----------
    page
        The page (tab of the window) on which the plot is shown. None for all pages.
    path
        Path of the chart, diagram or surface in the recording.
    has_findings
        Whether the plot shows results of an analysis. Such plots come first.
    view
        A function without arguments that creates the view. The function is called each time
        the layout is written, since rerun allows a view in one layout only.
    comparison
        Path of the chart that has the curves of this plot for all assembly modes (ways to
        assemble the mechanism). Empty if there is none.
    """

    page: Page
    path: str
    has_findings: bool
    view: View
    comparison: str = ""


@dataclass
class Layout:
    """The layout of the viewer's window, which grows as new things are recorded.

    A page is a number (an assembly mode), a title (any other page), or None for everything
    that all pages show.

    Attributes
    ----------
    root
        Path below which everything is logged.
    timeline
        Name of the timeline that the viewer plays.
    step
        Distance of samples on the timeline.
    span
        First and last time on the timeline (s, or ticks of the input), if known.
    sight
        The view of the sphere in three dimensions: the position of the eye, the point that
        it looks at, and the direction that is up.
    pages
        Titles of pages by page.
    sphere_view_paths
        Page and path of everything that is seen in the view of the sphere.
    overrides
        Page and path of objects that are not drawn as usual, and how they are drawn:
        hidden, or visible for the last samples.
    pages_with_findings
        Pages that show results of analyses, in the order in which they arrived.
    plots
        The charts and diagrams beside the sphere.
    scales
        Page and path of scales of colours.
    comparisons
        Titles of the charts that compare modes, by path.
    panels
        Page and view of graphs and texts.
    page_slugs
        The parts of paths that stand for pages with a title, by title.
    """

    root: str
    timeline: str
    step: float
    span: Span | None
    sight: Sight
    pages: dict[int | str, str] = field(default_factory=dict)
    sphere_view_paths: list[tuple[Page, str]] = field(default_factory=list)
    overrides: list[tuple[Page, str, Any]] = field(default_factory=list)
    pages_with_findings: list[Page] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)
    scales: list[tuple[Page, str]] = field(default_factory=list)
    comparisons: dict[str, str] = field(default_factory=dict)
    panels: list[tuple[Page, View]] = field(default_factory=list)
    page_slugs: dict[str, str] = field(default_factory=dict)

    def add_page(self, page: Page) -> None:
        """Add a page if it is new and not None, which stands for all pages."""
        if page is not None:
            title = f"Assembly mode {page}" if isinstance(page, int) else page
            self.pages.setdefault(page, title)

    def base(self, page: Page) -> str:
        """Return the path of a page."""
        if page is None:
            return self.root
        if isinstance(page, int):
            return f"{self.root}/assembly_mode_{page}"
        return f"{self.root}/{unique_slug(page, self.page_slugs)}"

    def path(self, page: Page, primitive: Primitive) -> str:
        """Return the path of a primitive on a page."""
        return f"{self.base(page)}/{primitive.path.strip('/')}"

    def blueprint(self) -> rrb.Blueprint:
        """Return the layout of the viewer window as a blueprint of rerun.

        Each page is a tab, for example one for each assembly mode (way to assemble the
        mechanism). Panels that are not needed are hidden.
        """
        # Pages with results of analyses come first. `order` has them twice, and `index`
        # finds the first of the two places.
        order = [*self.pages_with_findings, *self.pages]
        pages = [
            self._page(page, self.pages[page])
            for page in sorted(self.pages, key=order.index)
        ]
        if not pages:
            pages = [self._page(None, "Mechanism")]
        # A page with charts that compare the assembly modes.
        if self.comparisons:
            pages.append(self._comparison_page())
        window = rrb.Tabs(*pages, active_tab=0) if len(pages) > 1 else pages[0]
        # First and last value of the timeline, in its unit. The two values only determine
        # the speed of playing. The viewer ignores `fps` on a timeline of times.
        first, last = self.span or (0, 360)
        return rrb.Blueprint(
            window,
            rrb.TimePanel(
                state="collapsed",
                timeline=self.timeline,
                play_state="paused",
                loop_mode="all",
                fps=max((last - first) / PLAY_SECONDS, 1.0),
            ),
            rrb.SelectionPanel(state="hidden"),
            rrb.BlueprintPanel(state="hidden"),
            rrb.TopPanel(state="hidden"),
            auto_views=False,
            auto_layout=False,
        )

    def _has_sphere(self, page: Page) -> bool:
        """Return whether a page of the viewer window shows the sphere.

        A page of an assembly mode (its number) shows the objects of this mode, and those
        that belong to all pages (owner None). A page with a title has a sphere only if it
        has objects of its own on the sphere.
        """
        owners = {owner for owner, _ in self.sphere_view_paths}
        has_title = isinstance(page, str)
        if has_title:
            return page in owners
        return page in owners or None in owners

    def _page(self, page: Page, title: str) -> rrb.Container:
        """Return the views of one page (tab) of the viewer window.

        The sphere is on the left. On the right are the first plot, the further plots, and
        the panels (graph and texts). Plots with results of an analysis (`has_findings`)
        come before plots of the motion.

        `page` is the number of an assembly mode (way to assemble the mechanism), or a text
        for a page with other results. `title` has the words on the tab.
        """
        # Items that all pages show have the page None.
        page_plots = [plot for plot in self.plots if plot.page in (None, page)]
        # `False` is sorted before `True`, so plots with findings come first.
        page_plots.sort(key=lambda plot: not plot.has_findings)
        plots = [plot.view() for plot in page_plots]
        # Panels of this page come before panels that all pages show.
        ordered_panels = sorted(self.panels, key=lambda panel: panel[0] is None)
        panels = [view() for owner, view in ordered_panels if owner in (None, page)]
        # The first plot has a row of its own. Further plots share a row, and so do panels.
        rows = [_tabs(views) for views in (plots[:1], plots[1:], panels) if views]
        if rows and not self._has_sphere(page):
            return _page_without_sphere(rows, title)

        sphere: rrb.View | rrb.Container = self._sphere_view(page, title)
        # A colour scale is a bar of the colours of a map on the sphere, with their values.
        page_scales = [path for owner, path in self.scales if owner == page]
        if page_scales:
            scale = plane_view(page_scales[0], "Scale", COLOUR_SCALE_BOUNDS)
            # Shares are relative heights of rows or widths of columns.
            sphere = rrb.Vertical(sphere, scale, row_shares=[7, 1], name=title)
        if not rows:
            return rrb.Horizontal(sphere, name=title)
        # Plots need more width than a graph or texts.
        shares = [11, 9] if plots else [2, 1]
        return rrb.Horizontal(sphere, rrb.Vertical(*rows), column_shares=shares, name=title)

    def _sphere_view(self, page: Page, title: str) -> rrb.Spatial3DView:
        """Return the view of the sphere, with everything that a page (tab) shows on it.

        Things that belong to all pages are included.

        Parameters
        ----------
        page
            The page: the number of an assembly mode (way to assemble the mechanism), or a
            title.
        title
            Title of the view.
        """
        # Things that belong to all pages have the owner None.
        owners = (None, page)
        position, target, up = self.sight
        paths = [path for owner, path in self.sphere_view_paths if owner in owners]
        return rrb.Spatial3DView(
            origin=self.root,
            contents=[f"+ {path}/**" for path in (f"{self.root}/sphere", *paths)],
            name=title,
            background=colours.BACKGROUND,
            line_grid=False,
            eye_controls=rrb.EyeControls3D(
                position=position, look_target=target, eye_up=up
            ),
            overrides={
                path: [appearance]
                for owner, path, appearance in self.overrides
                if owner in owners
            },
        )

    @property
    def trail_range(self) -> rrb.VisibleTimeRanges:
        """The range of time in which the trail of a pole axis is shown.

        The trail shows the motion of the axis in the last `TRAIL_SAMPLES` samples before
        the cursor. A recording has a timeline of sample numbers. It may have a second
        timeline, of the input or the time. The user may switch between the timelines, so
        the range is stated for each.
        """

        def boundary(timeline: str, offset: float) -> rr.TimeRangeBoundary:
            """Return the position on a timeline at an offset from its cursor."""
            # Only the timeline of times is in seconds. Others count samples, or ticks
            # (small parts of a degree) of the input.
            if timeline == TIME_TIMELINE:
                return rr.TimeRangeBoundary.cursor_relative(seconds=offset)
            return rr.TimeRangeBoundary.cursor_relative(seq=round(offset))

        # Distance of two samples on each timeline.
        steps = {SAMPLE_TIMELINE: 1.0, self.timeline: self.step}
        return rrb.VisibleTimeRanges(
            [
                rr.VisibleTimeRange(
                    timeline,
                    start=boundary(timeline, -TRAIL_SAMPLES * step),
                    end=boundary(timeline, 0),
                )
                for timeline, step in steps.items()
            ]
        )

    def _comparison_page(self) -> rrb.Container:
        """Return the page of the charts that show all assembly modes together.

        The cursor of each chart, which marks the present sample, is the cursor of the same
        chart of the first mode.
        """
        views = []
        for path, title in self.comparisons.items():
            mode_plots = [plot for plot in self.plots if plot.comparison == path]
            cursor = f"{mode_plots[0].path}/cursor"
            views.append(plane_view(path, title, CHART_BOUNDS, [cursor]))
        return rrb.Grid(*views, grid_columns=1 if len(views) < 3 else 2, name="Compare")


def space_view(path: str, name: str) -> rrb.View:
    """Return the view of a space with a surface."""
    return rrb.Spatial3DView(
        origin=path,
        name=name,
        background=colours.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=SURFACE_EYE, look_target=(0, 0, -0.15), eye_up=(0, 0, 1)
        ),
    )


def plane_view(
    path: str, name: str, bounds: tuple[Span, Span], further_paths: Sequence[str] = ()
) -> rrb.View:
    """Return the view of a plane, such as a chart, for the layout of the viewer.

    Parameters
    ----------
    path
        Path of the chart in the recording. Everything below this path is shown.
    name
        Title of the view.
    bounds
        The x and the y range that are visible.
    further_paths
        Paths of other things in the recording that are shown in the plane.
    """
    x_range, y_range = bounds
    return rrb.Spatial2DView(
        origin=path,
        name=name,
        contents=[f"+ {shown_path}/**" for shown_path in (path, *further_paths)],
        background=colours.BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=x_range, y_range=y_range),
    )


def graph_view(path: str) -> rrb.View:
    """Return the view of the graph of links and pairs."""
    width, height = GRAPH_SIZE
    return rrb.GraphView(
        origin=path,
        name="Links and pairs",
        background=rrb.archetypes.GraphBackground(color=colours.BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(
            x_range=(-70.0, width + 70.0), y_range=(-40.0, height + 40.0)
        ),
    )


def _page_without_sphere(
    rows: Sequence[rrb.View | rrb.Container], title: str
) -> rrb.Container:
    """Return a page with the first row on the left, and the others on the right."""
    parts = [rows[0]]
    if len(rows) > 1:
        parts.append(rrb.Vertical(*rows[1:]))
    # Relative widths: the left part is a little wider.
    shares = [11, 9][: len(parts)]
    return rrb.Horizontal(*parts, column_shares=shares, name=title)


def _tabs(views: Sequence[rrb.View]) -> rrb.View | rrb.Container:
    """Return the only view, or tabs for several views."""
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)
