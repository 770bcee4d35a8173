"""The charts of a recording: cursors and legends in each block, curves at the end."""

from collections.abc import Mapping, Sequence
from functools import partial

from spherekit.display.rerun import charts
from spherekit.display.rerun.blueprint import (
    MOST_COMPARED,
    Layout,
    Plot,
    asked_for,
    plane,
    slug,
)
from spherekit.display.rerun.charts import Chart
from spherekit.display.rerun.destination import Output, Outputs
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.scenes.scene import Axis, InputMarks, Scene, Series


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
        layout = self.layout
        title = item.heading if len(over) == 1 else f"{item.label}: {item.heading}"
        where = f"{layout.base(scene.page)}/charts/{slug(title)}"
        is_new = where not in self.charts
        if is_new:
            self.charts[where] = Chart(title, over)
            alike = isinstance(scene.page, int) and len(over) == 1
            compared = f"{layout.root}/compare/{slug(title)}" if alike else ""
            view = partial(plane, where, title, charts.BOUNDS)
            layout.plots.append(Plot(scene.page, where, asked_for(scene), view, compared))
        path = layout.path(scene.page, item)
        self.charts[where].add(path, item, over)
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
        for where, paths in touched.items():
            chart, cursor, legend = self.charts[where], f"{where}/cursor", f"{where}/legend"
            self.outputs.first(cursor, [("", charts.cursor_style(chart))])
            columns = chart.cursor([axis.values for axis in over])
            self.outputs.columns(cursor, lines, columns, count)
            self.outputs.first(legend, [("", charts.legend_style(*chart.legend(paths)))])
            columns = rr.Points2D.columns(
                labels=charts.legend_words([chart.curves[path][-1][1] for path in paths])
            ).partition([len(paths)] * count)
            self.outputs.columns(legend, lines, columns, count)

    def draw(self, places: Sequence[Output]) -> None:
        """Draw all curves and maps as far as they are known, and those of all modes."""
        for where, chart in self.charts.items():
            base = where.partition("/charts/")[0]
            self.outputs.still(where, chart.drawn(self.marks.get(base, ())), places)
        alike: dict[str, list[Chart]] = {}
        for plot in self.layout.plots:
            if plot.compared:
                alike.setdefault(plot.compared, []).append(self.charts[plot.path])
        for path, of_modes in alike.items():
            curves = sum(len(chart.curves) for chart in of_modes)
            if len(of_modes) > 1 and curves <= MOST_COMPARED:
                whole, first = charts.compared(of_modes), of_modes[0].curves
                self.layout.compared[path] = whole.title
                style = charts.legend_style(
                    *whole.legend(first), [blocks[0][1].label for blocks in first.values()]
                )
                self.outputs.still(path, [*whole.drawn(), ("legend", style)], places)
