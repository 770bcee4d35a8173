"""Records scenes for the rerun viewer, to a file or a running viewer, block by block."""

import re
import time
import uuid
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats, Integers
from spherekit.display.rerun import charts, diagrams, entities, portraits
from spherekit.display.rerun.arrow_labels import arrow_labels
from spherekit.display.rerun.blueprint import (
    HIDDEN,
    MAX_COMPARED_CURVES,
    Layout,
    Plot,
    View,
    graph_view,
    plane_view,
    shows_findings,
    space_view,
)
from spherekit.display.rerun.chart_frame import CHART_BOUNDS, draw_colour_scale
from spherekit.display.rerun.chart_log import Charts
from spherekit.display.rerun.destination import (
    ENTITY_ITSELF,
    FileOutput,
    LiveOutput,
    Output,
    Outputs,
    below,
    check_notebook,
    served,
    viewer_at,
)
from spherekit.display.rerun.labels import Name, Names, Sight, facing
from spherekit.display.rerun.rerun_sdk import rr, rrb
from spherekit.display.rerun.timelines import (
    SAMPLE_TIMELINE,
    TIME_TIMELINE,
    input_ticks,
    input_timeline,
)
from spherekit.errors import OutputError
from spherekit.escaping import markdown_text
from spherekit.geometry.vectors import all_finite
from spherekit.scenes.plot_layout import choose_map_range
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import (
    Arrow,
    Axis,
    Body,
    Diagram,
    Graph,
    GreatCircle,
    InputMarks,
    Page,
    Portrait,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    SphereMap,
    Surface,
    Text,
    Trace,
    convert_to_degrees,
    title_with_unit,
)

SPHERE_PRIMITIVES = (Body, GreatCircle, SphereCurves, SphereMap, Trace, Arrow)
"""The primitives that are drawn together with the sphere."""

LIVE_INTERVAL_S = 0.5
"""Least time after which the curves are drawn anew for a viewer during the run."""

LAYOUT_GROWTH = 4
"""Factor by which the number of paths grows before a file gets the layout again."""

NOTES = """\
# {name}

The sphere has radius 1; directions are in ground axes. Silver arrows are the axes of
pairs, and gold arrows are the other pole axes. The tip of a gold arrow leaves a path on the
sphere. Violet great circles are the planes whose intersections are the poles. A link has
the same colour here and in the graph. The page Compare has the plots of all assembly modes
together, except for plots with more than {compared} curves.

`sample` counts the samples of an assembly mode. {timeline}
Where an assembly mode has no configuration, its links and poles are not drawn and its
curves have a gap.
"""


@checked_class(OutputError)
class RerunRecorder:
    """Records scenes (drawings) for the 3D viewer rerun, with one or more destinations.

    Use it in a `with` block: call `start` once, then `log` for each block of samples in
    order. The end of the block finishes the recording. After an exception, the samples so
    far are kept in ``NAME.rrd.part``. If there are none, or if the disk was full, no file
    remains.

    Positions and directions are only for display and are stored as float32. Series, the
    numbers that are plotted over the samples, keep all their digits.
    """

    def __init__(
        self,
        name: str,
        *,
        path: Path | str | None = None,
        port: int | None = None,
        url: str | None = None,
        notebook: bool = False,
    ) -> None:
        """Choose the destinations; nothing is opened yet.

        Parameters
        ----------
        name : str
            Name of the mechanism.
        path : Path or str, optional
            File to write, ``*.rrd``. Until the recording is complete, ``.part`` is appended
            to its name.
        port : int, optional
            Port of this computer at which viewers find the recording.
        url : str, optional
            Address of a running viewer.
        notebook : bool, optional
            Whether a notebook shows the recording when it is complete.

        """
        self.name = name
        self.url = None if port is None else f"rerun+http://127.0.0.1:{port}/proxy"
        """Address at which the recording is served, if it is."""
        self.root = "/" + (re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "m")
        outputs: list[Output] = []
        application = f"spherekit-{self.root[1:]}"  # a viewer keeps one layout for each
        recording = str(uuid.uuid4())

        def stream() -> rr.RecordingStream:
            """Return one more stream of the same recording."""
            return rr.RecordingStream(application, recording_id=recording)

        if path is not None:
            outputs.append(FileOutput(stream(), Path(path)))
        if port is not None:
            outputs.append(served(stream(), port))
        if url is not None:
            outputs.append(viewer_at(stream(), url))
        if notebook:
            outputs.append(LiveOutput(stream(), "the notebook", check_notebook))
        if not outputs:
            raise ValueError("a recorder needs a path, a port, a url or a notebook")
        self._outputs = Outputs(outputs)
        self._ticks_per_degree: int | None = None  # of the timeline of the input
        self._axis_range: tuple[float, float] | None = None  # of times (s) or inputs (deg)
        self._names: dict[Page, Names] = {}
        """Chooses the positions of the names of links and pairs, for each page (view of one
        assembly mode or analysis). The key None has the names that all pages show."""
        # Number of samples in one row of a grid of several inputs, None without a grid.
        self._grid_row_length: int | None = None
        self._path_rows: dict[str, tuple[Primitive, list[Floats]]] = {}
        """Primitives whose moving point leaves a curve that is drawn at the end: the
        primitive and its rows (n, 2 or 3) so far. The key is its name in the tree of the
        recording."""
        self._charts: Charts | None = None
        self._live_draw_time = 0.0  # s, when curves were last drawn for live viewers
        # Number of things in the recording when its layout (the arrangement of the viewer's
        # window) was last written to files. The layout is written again when this number
        # has grown.
        self._layout_size = 0
        self._is_finished = False

    @property
    def cost(self) -> dict[str, int]:
        """Entities and rows logged so far; bytes of the file, 0 before it is complete."""
        return self._outputs.cost(self._is_finished)

    @property
    def _open_charts(self) -> Charts:
        """The charts; `ValueError` before `start` and after the end."""
        if self._charts is None or self._is_finished:
            raise ValueError("log: call it after start and before the end of the recording")
        return self._charts

    @property
    def _layout(self) -> Layout:
        """The arrangement of the viewer's window; errors as for `_open_charts`."""
        return self._open_charts.layout

    def __enter__(self) -> Self:
        """Open all destinations."""
        self._outputs.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the recording, or draw the curves so far; close all destinations."""
        try:
            if error is None:
                self.finish()
            elif self._charts is not None and not self._is_finished:
                self._charts.draw(self._outputs.destinations)
        finally:
            self._outputs.close(error)

    def start(self, head: RecordingHead) -> None:
        """Begin the recording: choose its timeline, and log everything that does not move.

        Parameters
        ----------
        head
            What is known before the motion: times or inputs of all samples, titles of
            assembly modes (ways to assemble the mechanism), and scenes (drawings) that do
            not move.
        """
        # From where the viewer looks at the sphere: eye, target and upward direction.
        # `focus` is the direction from the centre to the middle of the mechanism.
        sight = facing(head.focus)
        layout, timeline_note = self._make_layout(head, sight)
        # Each assembly mode has a page of the window, with a number and a title.
        layout.pages.update(head.assembly_modes.items())
        # The recording has the property "logged" if not all samples are recorded. Its value
        # is a text, such as "one of 5 successive samples".
        if "logged" in head.properties:
            timeline_note += f" This recording has {head.properties['logged']}."
        self._charts = Charts(layout, self._outputs)
        # Number of samples in one row of a grid of several inputs, None without a grid.
        self._grid_row_length = head.row
        # `Names` places names so that they do not cover each other as seen from `sight`.
        # The key None stands for names that all pages show.
        self._names[None] = Names(sight)
        self._outputs.send_name(self.name, head.properties)
        # `ENTITY_ITSELF` is the empty path, so z is declared as up for the root itself.
        self._outputs.log_static(
            self.root,
            [(ENTITY_ITSELF, rr.ViewCoordinates.RIGHT_HAND_Z_UP), *entities.draw_sphere()],
        )
        for scene in head.scenes:
            self._introduce_scene_without_motion(convert_to_degrees(scene))
        # A text explains the recording, unless there is nothing to look at.
        if head.scenes or layout.pages:
            notes = NOTES.format(
                name=markdown_text(self.name),
                timeline=timeline_note,
                # One page compares the assembly modes. Plots with more curves than this are
                # left out there.
                compared=MAX_COMPARED_CURVES,
            )
            self._introduce(None, Text("notes", "About", notes))
        if layout.pages:
            self._send_layout()

    def _make_layout(self, head: RecordingHead, sight: Sight) -> tuple[Layout, str]:
        """Return an empty window layout, and a sentence about its timeline.

        The text "About" of the recording contains the sentence.

        The viewer plays a recording along a timeline: of times if there are times,
        otherwise of inputs, otherwise of sample numbers. A timeline of inputs counts whole
        ticks of 1, 0.1, 0.01 or 0.001 degrees, because rerun has only whole numbers there.

        This method also stores the range of times (s) or inputs (deg) for the axes of
        charts, and the number of ticks of the timeline per degree.

        Parameters
        ----------
        head
            Properties of the recording, with its times (s) or inputs (rad). Inputs are
            given only if the mechanism has a single input.
        sight
            Eye, target and upward direction of the view of the sphere.

        Returns
        -------
        The layout and the sentence, which is empty if there are neither times nor inputs.
        """
        times = head.times
        inputs = head.inputs
        if times is not None and len(times):
            first, last = times[0], times[-1]
            self._axis_range = (first, last)
            step = (last - first) / max(len(times) - 1, 1)
            layout = Layout(self.root, TIME_TIMELINE, step, (first, last), sight)
            return layout, f"`{TIME_TIMELINE}` is the time."
        if inputs is not None and len(inputs):
            timeline = input_timeline(inputs)
            scale = timeline.ticks_per_degree
            input_range = np.array([inputs.min(), inputs.max()])
            self._ticks_per_degree = scale
            self._axis_range = tuple(np.degrees(input_range))
            first_tick, last_tick = input_ticks(input_range, scale)
            tick_step = max(1, round((last_tick - first_tick) / max(len(inputs) - 1, 1)))
            unit = "degrees" if scale == 1 else f"1/{scale} degrees"
            rounded = "" if timeline.is_exact else ", rounded"
            note = f"`{timeline.name}` is the input in {unit}{rounded}."
            tick_span = (first_tick, last_tick)
            return Layout(self.root, timeline.name, tick_step, tick_span, sight), note
        return Layout(self.root, SAMPLE_TIMELINE, 1.0, None, sight), ""

    def log(
        self,
        scene: Scene,
        samples: Integers,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Record a scene (drawing) at a block of samples, of a mode or of another page.

        Parameters
        ----------
        scene : Scene
            Drawn objects (primitives), which have n rows each: one for each sample. Objects
            that do not move may be among them.
        samples : array (n,)
            Numbers of the samples.
        inputs : array (n,) rad, optional
            Input values; required if `start` got inputs.
        times : array (n,) s, optional
            Times; required if `start` got times.
        """
        charts_of_recording = self._open_charts
        layout = charts_of_recording.layout
        row_count = len(samples)
        scene = convert_to_degrees(scene)
        primitives = tuple(map(portraits.with_margin, scene.primitives))
        scene = replace(scene, primitives=primitives)
        has_findings = shows_findings(scene)
        timelines = self._timelines(samples, inputs, times)
        for primitive in scene.primitives:
            entities.check_rows(primitive, row_count)
        axes = scene.over or (self._default_axis(np.asarray(samples), inputs, times),)
        is_mode_page = isinstance(scene.page, int)
        if len(axes) > 1 and self._grid_row_length is None and is_mode_page:
            axes = (charts.path_axis(axes),)  # samples on a path make no map

        # Log objects that occur for the first time. They get a place in the window, so the
        # layout changes.
        is_layout_changed = False
        changed_series: dict[str, list[str]] = {}
        names = self._names_of_new_links(scene)
        for primitive in scene.primitives:
            if isinstance(primitive, Series):
                is_new = charts_of_recording.add_series(
                    scene, primitive, axes, changed_series
                )
            else:
                is_new = self._introduce(
                    scene.page, primitive, has_findings, names.get(primitive.path, ())
                )
            is_layout_changed |= is_new
        pages_with_findings = layout.pages_with_findings
        is_own_page = scene.page is not None
        if has_findings and is_own_page and scene.page not in pages_with_findings:
            pages_with_findings.append(scene.page)
            is_layout_changed = True

        # Log the rows, and draw the curves so far for viewers that are watching.
        charts_of_recording.log_block(changed_series, timelines, axes, row_count)
        self._log_rows(scene, timelines, row_count)
        is_layout_changed |= self._log_failures(scene, timelines, row_count)
        if is_layout_changed:
            self._send_layout()
        live = self._outputs.live
        if live and time.monotonic() - self._live_draw_time > LIVE_INTERVAL_S:
            charts_of_recording.draw(live)
            self._live_draw_time = time.monotonic()
        self._outputs.for_each(lambda output: output.flush())

    def _log_rows(
        self, scene: Scene, timelines: list[rr.TimeColumn], row_count: int
    ) -> None:
        """Log the rows of all primitives (things that are drawn) of a scene.

        A row is the scene at one sample of the motion. Some primitives leave a curve: pole
        axes (about which two links turn relative to each other), traced directions, and
        points that move in a plot. The curve is drawn at the end of the recording, so the
        positions of these points are stored.

        Parameters
        ----------
        scene
            The scene of one block of rows.
        timelines
            The positions of the rows on the timelines of the viewer.
        row_count
            Number of rows of the block.
        """
        layout = self._layout
        # Arrows with the same direction share one label, so labels change with the row.
        labels = arrow_labels(scene.primitives)
        for primitive in scene.primitives:
            # The parts of a primitive have names (`suffix`) below the name of the primitive
            # in the tree of the recording.
            # `moving_columns` returns the data of each part that change from row to row.
            name_in_tree = layout.path(scene.page, primitive)
            for suffix, columns in entities.moving_columns(
                primitive, labels.get(primitive.path)
            ):
                self._outputs.log_rows(
                    below(name_in_tree, suffix), timelines, columns, row_count
                )
            # The positions (rows, 2 or 3) of a point that leaves a curve. None if the
            # primitive leaves no curve.
            curve_rows = entities.rows_for_path(primitive)
            if curve_rows is not None:
                _, blocks = self._path_rows.setdefault(name_in_tree, (primitive, []))
                blocks.append(np.array(curve_rows))

    def _log_failures(
        self, scene: Scene, timelines: list[rr.TimeColumn], row_count: int
    ) -> bool:
        """Log a label at the rows without a configuration.

        In such a row the orientation of a link is NaN. The label is the text "no
        configuration here". A page (the drawings of an assembly
        mode or an analysis) has a view of the sphere, which shows the label. A label that
        is new on a page is added to this view, which changes the layout of the window.

        Parameters
        ----------
        scene
            A block of samples, with its links. Without links there is no label.
        timelines
            The time of each row (sample) on each timeline.
        row_count
            Number of rows of the block.

        Returns
        -------
        Whether the layout has changed.
        """
        bodies = [item for item in scene.primitives if isinstance(item, Body)]
        if not bodies:
            return False
        layout = self._layout
        is_failed = np.zeros(row_count, bool)
        for body in bodies:
            # The ground does not move and has no quaternions.
            if body.quaternions is not None:
                # One quaternion of four numbers in each row.
                is_failed |= ~all_finite(body.quaternions, axis=1)
        path = f"{layout.base(scene.page)}/status"
        # `ENTITY_ITSELF`, the empty path, puts the label at `path` itself.
        is_new = self._outputs.log_first(path, [(ENTITY_ITSELF, entities.failure_label())])
        if is_new:
            # The view of the sphere shows the entities of this list.
            layout.sphere_view_paths.append((scene.page, path))
        columns = entities.failure_columns(is_failed)
        self._outputs.log_rows(path, timelines, columns, row_count)
        return is_new

    def _timelines(
        self, samples: Integers, inputs: Floats | None, times: Floats | None
    ) -> list[rr.TimeColumn]:
        """Return the positions of a block of rows on all timelines of the recording.

        A row is one sample of the motion. Every recording has a timeline of sample numbers.
        A second timeline can have times (s), or inputs in ticks (fixed parts of a degree).

        Parameters
        ----------
        samples
            (rows,) sample numbers.
        inputs, times
            (rows,) inputs (rad) and times (s).

        Raises
        ------
        ValueError
            If the recording has a timeline of inputs or times and these are missing.
        """
        timelines = [
            rr.TimeColumn(SAMPLE_TIMELINE, sequence=np.asarray(samples, dtype=np.int64))
        ]
        # Name of the timeline that the viewer plays. `_ticks_per_degree` is set only for a
        # timeline of inputs.
        name = self._layout.timeline
        if name == TIME_TIMELINE:
            if times is None or len(times) != len(samples):
                raise ValueError("each sample needs its time")
            timelines.append(rr.TimeColumn(name, duration=times))
        if self._ticks_per_degree is not None:
            if inputs is None or len(inputs) != len(samples):
                raise ValueError("each sample needs its input value")
            ticks = input_ticks(inputs, self._ticks_per_degree)
            timelines.append(rr.TimeColumn(name, sequence=ticks))
        return timelines

    def _default_axis(
        self, samples: Integers, inputs: Floats | None, times: Floats | None
    ) -> Axis:
        """Return the horizontal axis of charts for a scene that does not name one.

        The result is the axis of times, of inputs or of sample numbers. An axis of times or
        inputs has the range of the whole recording, which `start` has stored. The total
        number of samples is not known in advance, so an axis of sample numbers has the
        range of this block of rows.

        Parameters
        ----------
        samples
            (rows,) sample numbers; a row is one sample of the motion.
        inputs, times
            (rows,) inputs (rad) and times (s).
        """
        if self._axis_range is not None and times is not None:
            return Axis("time", "s", times, self._axis_range)
        if self._axis_range is not None and inputs is not None:
            return Axis("input", "deg", np.degrees(inputs), self._axis_range)
        numbers = samples.astype(float)
        # Without rows, `np.min` and `np.max` need the initial values.
        low = np.min(numbers, initial=np.inf)
        high = np.max(numbers, initial=-np.inf)
        return Axis("sample", "", numbers, (low, high))

    def finish(self) -> None:
        """Draw all charts and paths, and complete all files; further calls do nothing."""
        if self._is_finished:
            return
        if self._charts is not None:
            self._charts.draw(self._outputs.destinations)
            self._send_layout(is_final=True)
        self._is_finished = True
        for path, (primitive, blocks) in self._path_rows.items():
            rows = np.concatenate(blocks)
            self._outputs.log_static(
                path, entities.draw_path(primitive, rows, self._grid_row_length)
            )
        self._outputs.for_each(lambda output: output.complete())

    def serve_until_interrupted(self) -> None:
        """Finish, and keep serving until the user presses Ctrl-C."""
        try:
            self.finish()
            while self.url is not None:
                time.sleep(0.5)
        except KeyboardInterrupt:
            return

    def _introduce_scene_without_motion(self, scene: Scene) -> None:
        """Log the drawings of a scene that does not move, such as the ground or texts.

        The ground is drawn with its name and the names of its pairs (joints).
        """
        names = self._names_of_new_links(scene)
        for primitive in scene.primitives:
            self._introduce(
                scene.page,
                primitive,
                has_findings=False,  # findings are results of analyses
                names=names.get(primitive.path, ()),
            )

    def _names_of_new_links(self, scene: Scene) -> dict[str, list[Name]]:
        """Choose places for the names of links that a page shows for the first time.

        Names are logged once, together with the link.

        Returns
        -------
        By the path of a new link in the recording: the names to draw with the link (the
        link's own name and the names of its pairs), with their positions.
        """
        new_bodies = []
        for item in scene.primitives:
            if isinstance(item, Body):
                # The layout of the window gives each link its path on this page. A link is
                # new if nothing has been recorded at its path.
                path = self._layout.path(scene.page, item)
                if path not in self._outputs.known_paths:
                    new_bodies.append(item)
        return self._find_names(scene.page).place_names(new_bodies)

    def _find_names(self, page: Page) -> Names:
        """Return the object that chooses the places of names on a page.

        The object stores where names are, so that new names do not cover them. The page
        None stands for everything that all pages show. A new page therefore begins with a
        copy of the object of the page None.
        """
        if page not in self._names:
            self._names[page] = deepcopy(self._names[None])
        return self._names[page]

    def _introduce(
        self,
        page: Page,
        primitive: Primitive,
        has_findings: bool = True,
        names: Sequence[Name] = (),
    ) -> bool:
        """Write the static data of a primitive to the recording if they are not there yet.

        A new primitive is added to the layout. The layout arranges the viewer's window, and
        gives each primitive its path (name in the recording).

        Parameters
        ----------
        page
            The page (tab of the window) that shows the primitive; None for all pages.
        primitive
            An object to draw. Page and path identify the object.
        has_findings
            Whether the primitive shows results of an analysis, and not only the motion.
            Plots with such results come first on a page.
        names
            The texts to draw on a link, with their positions.

        Returns
        -------
        Whether the primitive is new.
        """
        path = self._layout.path(page, primitive)
        is_new = self._outputs.log_first(path, entities.draw_static(primitive, names))
        if is_new:
            self._add_to_layout(page, path, primitive, has_findings)
        return is_new

    def _add_to_layout(
        self, page: Page, path: str, primitive: Primitive, has_findings: bool
    ) -> None:
        """Add a new drawn object (primitive) to the views of the window that show it.

        Objects on the sphere share the view of the sphere. Charts, diagrams and surfaces
        get a view of their own among the plots, and graphs and texts among the panels. The
        layout stores functions that create the views when the layout is sent to the viewer.

        Parameters
        ----------
        page
            The page that shows the primitive; None for all pages.
        path
            Path of the primitive in the recording.
        has_findings
            Whether the primitive shows results of an analysis, and not only the motion. On
            a page, plots with such results come before the other plots.
        """
        layout = self._open_charts.layout
        layout.add_page(page)
        if isinstance(primitive, SPHERE_PRIMITIVES):
            layout.sphere_view_paths.append((page, path))
        match primitive:
            case SphereMap(label=label, unit=unit):
                low, high = choose_map_range(primitive.shown_values, unit)
                # Only the first map on a page gets a scale of colours. `log_first` records
                # it and returns True if the page has none yet.
                scale_path = f"{layout.base(page)}/scale"
                scale = draw_colour_scale(low, high, title_with_unit(label, unit))
                if self._outputs.log_first(scale_path, scale):
                    layout.scales.append((page, scale_path))
            case Arrow(primary=primary, shown=shown, path_shown=path_shown):
                # Overrides change the appearance of single things in the viewer.
                if not shown:
                    layout.overrides.append((page, path, HIDDEN))
                # An arrow is the axis of a pair (`primary`), or another pole axis. Only the
                # other pole axes have trails: dots at their last positions. `trail_range`
                # says how far a trail goes back.
                has_trail = shown and path_shown and not primary
                if has_trail:
                    trail = f"{path}/trail"
                    layout.overrides.append((page, trail, layout.trail_range))
            case Diagram(label=label):
                bounds = diagrams.view_bounds(primitive)
                view: View = partial(plane_view, path, label, bounds)
                layout.plots.append(Plot(page, path, has_findings, view))
            case Portrait(label=label):
                view = partial(plane_view, path, label, CHART_BOUNDS)
                layout.plots.append(Plot(page, path, has_findings, view))
            case Surface(label=label):
                view = partial(space_view, path, label)
                layout.plots.append(Plot(page, path, has_findings, view))
            case InputMarks():
                # Marked inputs, such as singular ones, have no view. They are drawn later,
                # in all charts of the page.
                marks = self._open_charts.marks.setdefault(layout.base(page), [])
                marks.append(primitive)
            case Graph():
                layout.panels.append((page, partial(graph_view, path)))
            case Text(label=label):
                view = partial(rrb.TextDocumentView, origin=path, name=label)
                layout.panels.append((page, view))

    def _send_layout(self, is_final: bool = False) -> None:
        """Send the layout of the window to the destinations of the recording.

        Viewers get each new layout. Files get a layout only when it has grown enough, and
        at the end. A layout has items for every assembly mode. With a layout for each mode,
        a file would grow with the square of the number of modes.
        """
        size = len(self._outputs.known_paths)
        destinations = self._outputs.live
        if is_final or size >= LAYOUT_GROWTH * self._layout_size:
            self._layout_size = size
            destinations = self._outputs.destinations
        for output in destinations:
            output.stream.send_blueprint(self._open_charts.layout.blueprint())
