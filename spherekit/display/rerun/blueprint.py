"""How the viewer's window is laid out: a page for each mode, others, one to compare."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.display.rerun import charts, entities
from spherekit.display.rerun.labels import Sight
from spherekit.display.rerun.rerun_sdk import rr, rrb
from spherekit.display.rerun.timelines import SAMPLE, TIME
from spherekit.runs.run_result import MOTION
from spherekit.scenes import colours
from spherekit.scenes.scene import Page, Primitive, Scene


def input_ticks(inputs: Floats, scale: int) -> Integers:
    """Return input angles (n,) rad as whole numbers, so many to a degree."""
    return np.rint(np.degrees(inputs) * scale).astype(np.int64)


TURN_SECONDS = 12.0
"""Playing the whole range takes this long."""

TRAIL = 24
"""Recent samples shown as dots behind a pole."""

MOST_COMPARED = 60
"""A plot of all assembly modes with more curves is left out: nobody can tell them apart."""

SPACE_EYE = (1.9, -2.2, 1.3)
"""From where a space of its own is seen, whose longest side is `entities.CUBE`."""


Span = tuple[float, float]
Bounds = tuple[Span, Span]
View = Callable[[], rrb.View]
Shown = rrb.View | rrb.Container

HIDDEN = rrb.EntityBehavior(visible=False)

UNASKED = ("", MOTION)
"""Sources of scenes that show what moves, and nothing that was asked for."""


def asked_for(scene: Scene) -> bool:
    """Return whether a scene shows more than what moves."""
    return scene.source not in UNASKED


def slug(title: str) -> str:
    """Return a title as a part of a path."""
    return re.sub(r"[^A-Za-z0-9]+", "_", title).strip("_").lower() or "plot"


class Plot(NamedTuple):
    """What stands beside the sphere as the layout sees it, a chart or a space."""

    page: Page
    path: str
    answers: bool
    view: View
    compared: str = ""
    """Path of the chart that it is compared by with those of other modes."""


@dataclass
class Layout:
    """What there is to show; it grows as the first block of each assembly mode comes in."""

    root: str
    timeline: str
    step: float
    span: Span | None
    """First and last time on the timeline, if known; in s on the timeline of time."""
    sight: Sight
    pages: dict[int | str, str] = field(default_factory=dict)
    solids: list[tuple[Page, str]] = field(default_factory=list)
    overrides: list[tuple[Page, str, Any]] = field(default_factory=list)
    """What is seen otherwise than from now on: hidden, or for the last samples."""
    answered: list[Page] = field(default_factory=list)
    """The pages with what was asked for, in the order in which it came."""
    plots: list[Plot] = field(default_factory=list)
    scales: list[tuple[Page, str]] = field(default_factory=list)
    compared: dict[str, str] = field(default_factory=dict)
    """Titles of the charts in which modes are compared, by their paths."""
    panels: list[tuple[Page, View]] = field(default_factory=list)
    """Graphs and texts."""

    def base(self, page: Page) -> str:
        """Return the path of a page."""
        if page is None:
            return self.root
        if isinstance(page, int):
            return f"{self.root}/assembly_mode_{page}"
        return f"{self.root}/{slug(page)}"

    def path(self, page: Page, primitive: Primitive) -> str:
        """Return the path of a primitive on a page."""
        return f"{self.base(page)}/{primitive.path.strip('/')}"

    def blueprint(self) -> rrb.Blueprint:
        """Return the layout in rerun's terms."""
        order = sorted(self.pages, key=[*self.answered, *self.pages].index)
        pages: list[rrb.Container] = [
            self._page(page, self.pages[page]) for page in order
        ] or [self._page(None, "Mechanism")]
        if self.compared:
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

    def _page(self, page: Page, title: str) -> rrb.Container:
        on_page = [plot for plot in self.plots if plot.page in (None, page)]
        plots = [plot.view() for plot in sorted(on_page, key=lambda x: not x.answers)]
        ordered = sorted(self.panels, key=lambda panel: panel[0] is None)
        panels = [view() for owner, view in ordered if owner in (None, page)]
        rows = [_tabs(views) for views in (plots[:1], plots[1:], panels) if views]
        own_page = (page,) if isinstance(page, str) else (None, page)
        if rows and not any(owner in own_page for owner, _ in self.solids):
            parts = [rows[0], *([rrb.Vertical(*rows[1:])] if len(rows) > 1 else [])]
            shares = [11, 9][: len(parts)]
            return rrb.Horizontal(*parts, column_shares=shares, name=title)
        solids: Shown = self._space(page, title)
        for path in [path for owner, path in self.scales if owner == page][:1]:
            scale = plane(path, "Scale", charts.SCALE_BOUNDS)
            solids = rrb.Vertical(solids, scale, row_shares=[7, 1], name=title)
        if not rows:
            return rrb.Horizontal(solids, name=title)
        shares = [11, 9] if plots else [2, 1]
        return rrb.Horizontal(solids, rrb.Vertical(*rows), column_shares=shares, name=title)

    def _space(self, page: Page, title: str) -> rrb.Spatial3DView:
        here = (None, page)
        position, target, up = self.sight
        solids = [path for owner, path in self.solids if owner in here]
        return rrb.Spatial3DView(
            origin=self.root,
            contents=[f"+ {path}/**" for path in (f"{self.root}/sphere", *solids)],
            name=title,
            background=colours.BACKGROUND,
            line_grid=False,
            eye_controls=rrb.EyeControls3D(
                position=position, look_target=target, eye_up=up
            ),
            overrides={path: [how] for owner, path, how in self.overrides if owner in here},
        )

    @property
    def recent(self) -> rrb.VisibleTimeRanges:
        """How the trail behind a pole is seen."""

        def place(timeline: str, value: float) -> rr.TimeRangeBoundary:
            if timeline == TIME:
                return rr.TimeRangeBoundary.cursor_relative(seconds=value)
            return rr.TimeRangeBoundary.cursor_relative(seq=round(value))

        return rrb.VisibleTimeRanges(
            [
                rr.VisibleTimeRange(
                    line, start=place(line, -TRAIL * step), end=place(line, 0)
                )
                for line, step in {SAMPLE: 1, self.timeline: self.step}.items()
            ]
        )

    def _comparison(self) -> rrb.Container:
        """Return the charts of all modes, each with the cursor of the first mode's."""
        views = []
        for path, title in self.compared.items():
            first = next(plot for plot in self.plots if plot.compared == path)
            views.append(plane(path, title, charts.BOUNDS, [f"{first.path}/cursor"]))
        return rrb.Grid(*views, grid_columns=1 if len(views) < 3 else 2, name="Compare")


def space(path: str, name: str) -> rrb.View:
    """Return the view of a space of its own."""
    return rrb.Spatial3DView(
        origin=path,
        name=name,
        background=colours.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=SPACE_EYE, look_target=(0, 0, -0.15), eye_up=(0, 0, 1)
        ),
    )


def plane(path: str, name: str, seen: Bounds, more: Sequence[str] = ()) -> rrb.View:
    """Return the view of a plane, of which a part is seen, and of `more` paths there."""
    return rrb.Spatial2DView(
        origin=path,
        name=name,
        contents=[f"+ {shown}/**" for shown in (path, *more)],
        background=colours.BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=seen[0], y_range=seen[1]),
    )


def graph(path: str) -> rrb.View:
    """Return the view of the graph of links and pairs."""
    wide, high = entities.GRAPH_SIZE
    return rrb.GraphView(
        origin=path,
        name="Links and pairs",
        background=rrb.archetypes.GraphBackground(color=colours.BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(
            x_range=(-70.0, wide + 70.0), y_range=(-40.0, high + 40.0)
        ),
    )


def _tabs(views: Sequence[rrb.View]) -> Shown:
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)
