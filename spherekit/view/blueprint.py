"""How the viewer's window is laid out: a page for each mode, others, one to compare."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.scene import Page
from spherekit.view import colours, entities
from spherekit.view.sdk import rr, rrb
from spherekit.view.timelines import SAMPLE, TIME

Floats = NDArray[np.float64]

TURN_SECONDS = 12.0
"""Playing the whole range takes this long."""

TRAIL = 24
"""Recent samples shown as dots behind a pole."""

LEGEND_SHARE = 0.5
"""Where modes are compared, the long legends stand beside the curves: so much of them."""

MOST_COMPARED = 60
"""A plot of all assembly modes with more curves is left out: nobody can tell them apart."""

EYE_DISTANCE = 3.0
EYE_ASIDE = 0.3
"""Tangent of the angle between the eye's direction and the middle of the mechanism."""
DEFAULT_FOCUS = (0.76, 0.47, 0.44)
STEEP = 0.8
"""A focus nearer to the z axis than this cosine is seen with x up instead of z."""


@final
@dataclass(frozen=True)
class SeriesEntry:
    """One series as the layout sees it."""

    page: Page
    path: str
    label: str


@final
@dataclass(frozen=True)
class Panel:
    """One graph or text as the layout sees it."""

    page: Page
    path: str
    label: str
    graph: bool


Entry = TypeVar("Entry", SeriesEntry, Panel)


@final
@dataclass
class Layout:
    """What there is to show; it grows as the first block of each assembly mode comes in."""

    root: str
    timeline: str
    step: float
    span: tuple[float, float] | None
    """First and last time on the timeline, if known; in s on the timeline of time."""

    pages: dict[int | str, str] = field(default_factory=dict)
    solids: list[tuple[Page, str]] = field(default_factory=list)
    trails: list[tuple[Page, str]] = field(default_factory=list)
    hidden: list[tuple[Page, str]] = field(default_factory=list)
    focus: Floats | None = None
    groups: dict[str, list[SeriesEntry]] = field(default_factory=dict)
    portraits: list[tuple[Page, str, str]] = field(default_factory=list)
    surfaces: list[tuple[Page, str, str]] = field(default_factory=list)
    panels: list[Panel] = field(default_factory=list)

    def blueprint(self) -> rrb.Blueprint:
        """Return the layout in rerun's terms."""
        pages: list[rrb.Container] = [
            self._page(page, title) for page, title in self.pages.items()
        ] or [self._page(None, "Mechanism")]
        if len({e.page for own in self._compared().values() for e in own}) > 1:
            pages.append(self._comparison())
        top = rrb.Tabs(*pages, active_tab=0) if len(pages) > 1 else pages[0]
        first, last = self.span or (0, 360)
        return rrb.Blueprint(
            top,
            rrb.TimePanel(
                state="collapsed",
                timeline=self.timeline,
                play_state="paused",
                loop_mode="all",
                fps=max((last - first) / TURN_SECONDS, 1.0),
            ),
            rrb.SelectionPanel(state="hidden"),
            rrb.BlueprintPanel(state="hidden"),
            rrb.TopPanel(state="hidden"),
            auto_views=False,
            auto_layout=False,
        )

    def colour(self, group: str, entry: SeriesEntry) -> colours.Colour:
        """Return the colour of a series: that of its position in the plot of its page."""
        own = [each for each in self.groups[group] if each.page == entry.page]
        return colours.series_colour(own.index(entry))

    def _page(self, page: Page, title: str) -> rrb.Container:
        plots: list[rrb.View] = [
            self._plot(group, _of(series, page))
            for group, series in self.groups.items()
            if _of(series, page)
        ]
        plots += [
            self._portrait(path, label)
            for owner, path, label in self.portraits
            if owner in (None, page)
        ]
        plots += [
            self._surface(path, label)
            for owner, path, label in self.surfaces
            if owner in (None, page)
        ]
        ordered = _of(self.panels, page)
        if isinstance(page, str):
            ordered.sort(key=lambda panel: panel.page is None)
        panels = [self._panel(panel) for panel in ordered]
        rows: list[rrb.View | rrb.Container] = [*plots[:1]]
        if len(plots) > 1:
            rows.append(_tabs(plots[1:]))
        if panels:
            rows.append(_tabs(panels))
        has_solids = any(owner in (None, page) for owner, _ in self.solids)
        if rows and not has_solids:
            return rrb.Horizontal(*rows, name=title)
        space = self._space(page, title)
        if not rows:
            return rrb.Horizontal(space, name=title)
        return rrb.Horizontal(space, rrb.Vertical(*rows), column_shares=[11, 9], name=title)

    def _space(self, page: Page, title: str) -> rrb.Spatial3DView:
        def here(owner: Page) -> bool:
            return owner is None or owner == page

        overrides: dict[Any, Any] = {
            path: [self._recent()] for owner, path in self.trails if here(owner)
        }
        for owner, path in self.hidden:
            if here(owner):
                overrides[path] = [rrb.EntityBehavior(visible=False)]
        contents = [f"+ {self.root}/sphere/**"]
        contents += [f"+ {path}/**" for owner, path in self.solids if here(owner)]
        return rrb.Spatial3DView(
            origin=self.root,
            contents=contents,
            name=title,
            background=colours.BACKGROUND,
            line_grid=False,
            eye_controls=self._eye(),
            overrides=overrides,
        )

    def _eye(self) -> rrb.EyeControls3D:
        """Face the mechanism a little from the side, with z up where that is possible."""
        focus = np.array(DEFAULT_FOCUS if self.focus is None else self.focus)
        focus = focus / np.linalg.norm(focus)
        up = np.array([0.0, 0.0, 1.0] if abs(focus[2]) < STEEP else [-1.0, 0.0, 0.0])
        right = np.cross(focus, up)
        right /= np.linalg.norm(right)
        eye = focus + EYE_ASIDE * (0.8 * right + 0.6 * np.cross(right, focus))
        position = EYE_DISTANCE * eye / np.linalg.norm(eye)
        return rrb.EyeControls3D(
            position=tuple(position), look_target=tuple(0.1 * focus), eye_up=tuple(up)
        )

    def _recent(self) -> rrb.VisibleTimeRanges:
        return rrb.VisibleTimeRanges(
            [
                rr.VisibleTimeRange(
                    timeline,
                    start=rr.TimeRangeBoundary.cursor_relative(
                        **self._ticks(timeline, -TRAIL * step)
                    ),
                    end=rr.TimeRangeBoundary.cursor_relative(**self._ticks(timeline, 0)),
                )
                for timeline, step in {SAMPLE: 1, self.timeline: self.step}.items()
            ]
        )

    def _ticks(self, timeline: str, value: float) -> dict[str, Any]:
        """Return a place on a timeline as the viewer takes it."""
        return {"seconds": value} if timeline == TIME else {"seq": round(value)}

    def _plot(
        self, group: str, series: Sequence[SeriesEntry], mixed: bool = False
    ) -> rrb.TimeSeriesView:
        overrides: dict[Any, Any] = {}
        order = list(self.pages)
        for entry in series:
            if mixed and entry.page is not None:
                colour = colours.shaded(self.colour(group, entry), order.index(entry.page))
                name = f"{entry.label}, {self.pages[entry.page]}"
                lines = entities.series_lines(name, colour)
                overrides[entry.path] = lines.visualizer()
        return rrb.TimeSeriesView(
            origin=self.root,
            contents=[f"+ {entry.path}" for entry in series],
            name=group,
            axis_x=self._axis(LEGEND_SHARE if mixed else 0.0),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop),
            background=rrb.archetypes.PlotBackground(color=colours.BACKGROUND),
            overrides=overrides,
        )

    def _axis(self, beyond: float) -> rrb.TimeAxis | None:
        """Return the axis over the whole span, and a share of it beyond its end."""
        if self.span is None:
            return None
        first, last = self.span
        last = max(last, first + (self.step or 1)) + beyond * (last - first)
        view_range = rr.TimeRange(
            start=rr.TimeRangeBoundary.absolute(**self._ticks(self.timeline, first)),
            end=rr.TimeRangeBoundary.absolute(**self._ticks(self.timeline, last)),
        )
        return rrb.TimeAxis(view_range=view_range)

    def _compared(self) -> dict[str, list[SeriesEntry]]:
        """Return the series of modes, which have the same samples, if not too many."""
        found = {
            group: [entry for entry in series if isinstance(entry.page, int)]
            for group, series in self.groups.items()
        }
        return {
            group: series
            for group, series in found.items()
            if 0 < len(series) <= MOST_COMPARED
        }

    def _comparison(self) -> rrb.Container:
        plots = [
            self._plot(group, series, mixed=True)
            for group, series in self._compared().items()
        ]
        columns = 1 if len(plots) < 3 else 2
        return rrb.Grid(*plots, grid_columns=columns, name="Compare")

    def _portrait(self, path: str, label: str) -> rrb.View:
        return rrb.Spatial2DView(
            origin=path,
            name=label,
            background=colours.BACKGROUND,
            visual_bounds=rrb.VisualBounds2D(
                x_range=(-0.2 * entities.PORTRAIT[0], 1.1 * entities.PORTRAIT[0]),
                y_range=(-1.1 * entities.PORTRAIT[1], 0.2 * entities.PORTRAIT[1]),
            ),
        )

    def _surface(self, path: str, label: str) -> rrb.View:
        return rrb.Spatial3DView(
            origin=path, name=label, background=colours.BACKGROUND, line_grid=False
        )

    def _panel(self, panel: Panel) -> rrb.View:
        if panel.graph:
            return rrb.GraphView(
                origin=panel.path,
                name=panel.label,
                background=rrb.archetypes.GraphBackground(color=colours.BACKGROUND),
                visual_bounds=rrb.VisualBounds2D(
                    x_range=(-70.0, entities.GRAPH_SIZE[0] + 70.0),
                    y_range=(-40.0, entities.GRAPH_SIZE[1] + 40.0),
                ),
            )
        return rrb.TextDocumentView(origin=panel.path, name=panel.label)


def _of(entries: Sequence[Entry], page: Page) -> list[Entry]:
    return [entry for entry in entries if entry.page in (None, page)]


def _tabs(views: Sequence[rrb.View]) -> rrb.View | rrb.Container:
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)
