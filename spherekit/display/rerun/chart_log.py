"""The charts of a recording: cursors and legends in each block, curves at the end."""

from collections.abc import Mapping, Sequence
from functools import partial

from spherekit.display.rerun.blueprint import (
    MAX_COMPARED_CURVES,
    Layout,
    Plot,
    plane_view,
    shows_findings,
    unique_slug,
)
from spherekit.display.rerun.chart_frame import CHART_BOUNDS
from spherekit.display.rerun.charts import (
    Chart,
    compare_modes,
    cursor_style,
    legend_style,
    legend_texts,
)
from spherekit.display.rerun.destination import ENTITY_ITSELF, Output, Outputs
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.scenes.scene import Axis, InputMarks, Scene, Series


class Charts:
    """Draws the charts of a recording (the data that the viewer rerun shows).

    A recording has several pages. A page shows one assembly mode (way to assemble the
    mechanism), or has a title.

    Attributes
    ----------
    layout
        The layout of the window, which gets a view for each chart.
    outputs
        The files and viewers to which the recording is written.
    charts
        The charts, by their paths in the recording.
    marks
        Values of the inputs that are marked in the charts of a page, such as inputs at
        singularities, by the path of the page.
    chart_slugs
        The parts of paths that stand for charts, by the titles of the charts.
    """

    def __init__(self, layout: Layout, outputs: Outputs) -> None:
        """Begin without charts."""
        self.layout = layout
        self.outputs = outputs
        self.charts: dict[str, Chart] = {}
        self.marks: dict[str, list[InputMarks]] = {}
        self.chart_slugs: dict[str, str] = {}

    def add_series(
        self,
        scene: Scene,
        series: Series,
        axes: tuple[Axis, ...],
        changed_paths: dict[str, list[str]],
    ) -> bool:
        """Add a block of values of a series to its chart; return whether the chart is new.

        A recording is written in blocks of consecutive rows (samples). A series is one
        quantity over an axis. A new chart gets a view in the layout of the window.

        Parameters
        ----------
        scene
            The scene (all drawings of one page in this block) with the series. A page is
            the number of an assembly mode (way to assemble the mechanism), or a title.
        series
            The series: values (rows,) of one quantity, a label (name of the curve) and a
            heading (quantity with unit). Series with one heading on one page share a chart.
            A series over two axes is drawn as a map, in a chart of its own.
        axes
            The axes over which the series is drawn: one for a curve, two for a map.
        changed_paths
            The paths of the series that were added in this block, by the path of their
            chart. The method appends the path of this series. The caller passes all paths
            to `log_block`, which writes the legends.
        """
        layout = self.layout
        is_map = len(axes) > 1
        title = f"{series.label}: {series.heading}" if is_map else series.heading
        name = unique_slug(title, self.chart_slugs)
        chart_path = f"{layout.base(scene.page)}/charts/{name}"
        is_new = chart_path not in self.charts
        if is_new:
            self.charts[chart_path] = Chart(title, axes)
            layout.add_page(scene.page)
            # Pages of assembly modes are numbers. Their curves are shown in a second chart
            # with the curves of all modes.
            is_comparable = isinstance(scene.page, int) and not is_map
            comparison = f"{layout.root}/compare/{name}" if is_comparable else ""
            view = partial(plane_view, chart_path, title, CHART_BOUNDS)
            # Plots with results of an analysis are placed before plots of the motion.
            has_findings = shows_findings(scene)
            layout.plots.append(
                Plot(scene.page, chart_path, has_findings, view, comparison)
            )
        series_path = layout.path(scene.page, series)
        self.charts[chart_path].add(series_path, series, axes)
        changed_paths.setdefault(chart_path, []).append(series_path)
        return is_new

    def log_block(
        self,
        changed_paths: Mapping[str, Sequence[str]],
        timelines: Sequence[rr.TimeColumn],
        axes: tuple[Axis, ...],
        row_count: int,
    ) -> None:
        """Write the cursors and legends of charts for one block of rows (samples).

        The cursor marks the current row in the chart. A series is one quantity over an
        axis. The legend has the names and values of the series. Each thing that is drawn
        has a path, which is its name in the recording.

        Some data do not change with the row, and are logged in the first block only: the
        appearance of cursor and legend, and the positions of the legend. Other data are
        logged for each row:

        - the position of the cursor, a line or a dot;
        - the texts of the legend: the name of each series and its value in the row.

        Parameters
        ----------
        changed_paths
            The paths of the series that got rows in this block, by the path of their
            chart.
        timelines
            Positions of the rows on the timelines of the viewer, such as time.
        axes
            The axes of the charts, with their values (rows,) in this block.
        row_count
            Number of rows of the block.
        """
        axis_values = [axis.values for axis in axes]
        for chart_path, series_paths in changed_paths.items():
            chart = self.charts[chart_path]
            cursor_path = f"{chart_path}/cursor"
            # `log_first` does nothing if the path was logged before. `ENTITY_ITSELF` is the
            # empty path below `cursor_path`.
            self.outputs.log_first(cursor_path, [(ENTITY_ITSELF, cursor_style(chart))])
            cursor_positions = chart.cursor_columns(axis_values)
            self.outputs.log_rows(cursor_path, timelines, cursor_positions, row_count)

            legend_path = f"{chart_path}/legend"
            # Position (k, 2) and colour of the name of each of the k series.
            positions, tints = chart.legend(series_paths)
            self.outputs.log_first(
                legend_path, [(ENTITY_ITSELF, legend_style(positions, tints))]
            )
            # A curve is a list of blocks. The last item is the current block.
            # Texts are in the order of the chart, like the positions.
            current_blocks = [
                blocks[-1].series
                for path, blocks in chart.curves.items()
                if path in series_paths
            ]
            texts = legend_texts(current_blocks)
            # The texts of all rows are one list. Each row has one text for each series.
            legend = rr.Points2D.columns(labels=texts).partition(
                [len(series_paths)] * row_count
            )
            self.outputs.log_rows(legend_path, timelines, legend, row_count)

    def draw(self, destinations: Sequence[Output]) -> None:
        """Draw the curves and maps of all charts, and the comparisons of assembly modes.

        A comparison is a chart with the curves of all assembly modes (ways to assemble the
        mechanism). A comparison is left out if it would have more than
        `MAX_COMPARED_CURVES` curves. Curves do not move, so they are logged as static data,
        valid at all times of the recording.

        Parameters
        ----------
        destinations
            The files or viewers that get the data.
        """
        for chart_path, chart in self.charts.items():
            # The path of a chart is "PAGE/charts/TITLE". All charts of a page show the same
            # marks: special inputs, such as singular ones. The path of the page may contain
            # "/charts/" too, since a mechanism or a page may be called "charts".
            page_path = chart_path.rpartition("/charts/")[0]
            marks = self.marks.get(page_path, ())
            self.outputs.log_static(chart_path, chart.draw(marks), destinations)

        charts_by_comparison: dict[str, list[Chart]] = {}
        for plot in self.layout.plots:
            if plot.comparison:
                chart = self.charts[plot.path]
                charts_by_comparison.setdefault(plot.comparison, []).append(chart)
        for path, charts in charts_by_comparison.items():
            curve_count = sum(len(chart.curves) for chart in charts)
            if len(charts) < 2 or curve_count > MAX_COMPARED_CURVES:
                # Live viewers may have a comparison of the first modes, which is dropped.
                self.layout.comparisons.pop(path, None)
                continue
            comparison = compare_modes(charts)
            self.layout.comparisons[path] = comparison.title
            # The legend names only the curves of the first mode. Other modes have lighter
            # shades of the same colours.
            first_curves = charts[0].curves
            # A curve is stored in blocks of successive samples, all with the same label.
            names = [blocks[0].series.label for blocks in first_curves.values()]
            # Positions (k, 2) of the k names in the chart, and their colours.
            positions, tints = comparison.legend(first_curves)
            legend = legend_style(positions, tints, names)
            # Each part has a name below the path of the comparison.
            self.outputs.log_static(
                path, [*comparison.draw(), ("legend", legend)], destinations
            )
