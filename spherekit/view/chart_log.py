"""The charts of a recording: cursors and legends block by block, curves in the end."""

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from spherekit.analysis.scene import Axis, InputMarks, Scene, Series
from spherekit.view import charts
from spherekit.view.blueprint import MOST_COMPARED, Layout, Plot, asked_for, slug
from spherekit.view.charts import Chart, Curve
from spherekit.view.output_group import Outputs
from spherekit.view.outputs import AbstractOutput
from spherekit.view.sdk import rr


@final
class Charts:
    """The charts of all pages; `marks` are inputs to be marked, by the page's path."""

    def __init__(self, layout: Layout, outputs: Outputs) -> None:
        self.layout, self.outputs = layout, outputs
        self.charts: dict[str, Chart] = {}
        self.marks: dict[str, list[InputMarks]] = {}

    def enter(
        self,
        scene: Scene,
        item: Series,
        over: tuple[Axis, ...],
        touched: dict[str, list[str]],
    ) -> bool:
        """Add a block of a series to its chart, now `touched`; return if that is new."""
        title = item.heading
        if len(over) > 1:
            title = f"{item.label}: {title}"
        where = f"{self.layout.base(scene.page)}/charts/{slug(title)}"
        is_new = where not in self.charts
        if is_new:
            self.charts[where] = Chart(title, over)
            self._place_chart(scene, where, title)
        path = self.layout.path(scene.page, item)
        curve = self.charts[where].add(path, item)
        curve.values.append(np.array(item.values))
        curve.places.append(tuple(axis.values for axis in over))
        touched.setdefault(where, []).append(path)
        return is_new

    def log(
        self,
        touched: Mapping[str, Sequence[str]],
        lines: Sequence[rr.TimeColumn],
        over: tuple[Axis, ...],
        count: int,
    ) -> None:
        """Log the cursors and legends of charts that got a block of some series."""
        rows = [axis.values for axis in over]
        for where, paths in touched.items():
            chart = self.charts[where]
            if self.outputs.first(f"{where}/cursor"):
                self.outputs.still(f"{where}/cursor", charts.cursor_style(chart))
            self.outputs.columns(f"{where}/cursor", lines, chart.cursor(rows), count)
            curves = [chart.curves[path] for path in paths]
            self._log_legend(f"{where}/legend", chart, paths, curves, lines)

    def _log_legend(
        self,
        path: str,
        chart: Chart,
        paths: Sequence[str],
        curves: Sequence[Curve],
        lines: Sequence[rr.TimeColumn],
    ) -> None:
        """Log the names of curves with their values at each row."""
        places, tints = chart.legend(paths)
        if self.outputs.first(path):
            self.outputs.still(path, charts.legend_style(places, tints))
        words = charts.legend_words([(c.label, c.values[-1], c.resolution) for c in curves])
        rows = len(curves[0].values[-1])
        columns = rr.Points2D.columns(labels=words).partition([len(curves)] * rows)
        self.outputs.columns(path, lines, columns, rows)

    def _place_chart(self, scene: Scene, where: str, title: str) -> None:
        compared = ""
        if isinstance(scene.page, int) and len(self.charts[where].over) == 1:
            compared = f"{self.layout.root}/compare/{where.rsplit('/', 1)[1]}"
        answers = asked_for(scene)
        self.layout.plots.append(
            Plot(scene.page, where, title, answers, charts.bounds(), compared)
        )

    def draw(self, outputs: Sequence[AbstractOutput]) -> None:
        """Draw all curves and maps as far as they are known, and those of all modes."""
        for where, chart in self.charts.items():
            base = where.partition("/charts/")[0]
            for suffix, archetype in chart.drawn(self.marks.get(base, ())):
                self.outputs.still(f"{where}/{suffix}", archetype, outputs)
        for path, plots in self._compared().items():
            whole = charts.compared([self.charts[plot.path] for plot in plots])
            self.layout.compared[path] = whole.title
            for suffix, archetype in whole.drawn():
                self.outputs.still(f"{path}/{suffix}", archetype, outputs)
            places, tints = whole.legend(list(self.charts[plots[0].path].curves))
            names = [curve.label for curve in self.charts[plots[0].path].curves.values()]
            self.outputs.still(
                f"{path}/legend", charts.legend_style(places, tints, names), outputs
            )

    def _compared(self) -> dict[str, list[Plot]]:
        """Return the charts of several modes that are alike, if not of too many curves."""
        alike: dict[str, list[Plot]] = {}
        for plot in self.layout.plots:
            if plot.compared:
                alike.setdefault(plot.compared, []).append(plot)
        return {
            path: plots
            for path, plots in alike.items()
            if len(plots) > 1
            and sum(len(self.charts[plot.path].curves) for plot in plots) <= MOST_COMPARED
        }
