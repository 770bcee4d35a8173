"""Recordings for the rerun viewer, to a file and to a live viewer, block by block."""

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
from spherekit.display.rerun import charts, diagrams, entities
from spherekit.display.rerun.arrow_labels import labels_of_arrows
from spherekit.display.rerun.blueprint import (
    HIDDEN,
    MOST_COMPARED,
    Layout,
    Plot,
    View,
    asked_for,
    graph,
    input_ticks,
    plane,
    space,
)
from spherekit.display.rerun.chart_log import Charts
from spherekit.display.rerun.destination import (
    FileOutput,
    LiveOutput,
    Output,
    Outputs,
    below,
    check_notebook,
    served,
    viewer_at,
)
from spherekit.display.rerun.labels import Name, Names, facing
from spherekit.display.rerun.rerun_sdk import rr, rrb
from spherekit.display.rerun.timelines import SAMPLE, TIME, input_timeline
from spherekit.errors import OutputError
from spherekit.geometry.vectors import all_finite
from spherekit.scenes.plot_layout import map_range
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
    in_degrees,
    titled,
)

SOLID = (Body, GreatCircle, SphereCurves, SphereMap, Trace, Arrow)
"""What is seen with the sphere."""

LIVE_SECONDS = 0.5
"""A viewer that looks on gets the curves anew that often."""

NOTES = """\
# {name}

The sphere has radius 1; directions are in ground axes. Silver arrows are the axes of
pairs, gold ones are the other pole axes, with the path each leaves on the sphere.
Violet great circles are the planes that the construction cuts with each other.
Links have the same colour here and in the graph. Compare has the plots of all assembly
modes together, but for those of more than {compared} curves.

`sample` counts the samples of an assembly mode. {timeline}
Where an assembly mode has no configuration, its links and poles are not drawn and its
curves have a gap.
"""


@checked_class(OutputError)
class RerunRecorder:
    """Turns scenes into one rerun recording that goes to one or more places.

    Use it in a `with` block: call `start` once, then `log` for each block of samples
    in order. Leaving the block finishes the recording; leaving it by an exception
    keeps what was recorded in ``NAME.rrd.part``.

    Positions and directions become float32 in a recording and are not results;
    only series keep all their digits.
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
        """Choose the places, any of them together: nothing is touched yet.

        Parameters
        ----------
        name : str
            Name of the mechanism, as people read it.
        path : Path or str, optional
            File to write, ``*.rrd``; it appears when the recording is whole.
        port : int, optional
            Port of this computer at which viewers find the recording.
        url : str, optional
            Address of a viewer that runs already.
        notebook : bool, optional
            Whether the page of a notebook shows the recording when it is whole.

        """
        self.name = name
        self.url = None if port is None else f"rerun+http://127.0.0.1:{port}/proxy"
        """Address at which the recording is served, if it is."""
        self.root = "/" + (re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "m")
        outputs: list[Output] = []
        application = f"spherekit-{self.root[1:]}"  # a viewer keeps one layout for each
        recording = str(uuid.uuid4())

        def stream() -> rr.RecordingStream:
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
        self._scale: int | None = None
        """Units of the timeline of the input to a degree, if there is one."""
        self._span: tuple[float, float] | None = None
        self._names: dict[Page, Names] = {}
        self._row: int | None = None
        self._whole: dict[str, tuple[Primitive, list[Floats]]] = {}
        """What is drawn of all rows of a primitive, by its path, with these so far."""
        self._charts: Charts | None = None
        self._live_drawn = 0.0
        self._laid_out = 0
        self._finished = False

    @property
    def cost(self) -> dict[str, int]:
        """Entities and rows logged so far; bytes of the file, 0 before it is whole."""
        return self._outputs.cost(self._finished)

    @property
    def _started(self) -> Charts:
        if self._charts is None or self._finished:
            raise ValueError("log is called after start and before the end")
        return self._charts

    def __enter__(self) -> Self:
        """Open all places."""
        self._outputs.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Finish the recording, or keep the part there is, and let go of the places."""
        try:
            if error is None:
                self.finish()
            elif self._charts is not None and not self._finished:
                self._charts.draw(self._outputs.places)
        finally:
            self._outputs.close(error)

    def start(self, head: RecordingHead) -> None:
        """Begin the recording with all that does not move."""
        times, inputs, sight = head.times, head.inputs, facing(head.focus)
        line, step, span, words = SAMPLE, 1.0, None, ""
        if times is not None and len(times):
            self._span = span = times[0], times[-1]
            line, words = TIME, f"`{TIME}` is the time."
            step = (span[1] - span[0]) / max(len(times) - 1, 1)
        elif inputs is not None and len(inputs):
            line, scale, exact = input_timeline(inputs)
            ends = np.array([inputs.min(), inputs.max()])
            self._scale, self._span = scale, tuple(np.degrees(ends))
            span = tuple(input_ticks(ends, scale))
            step = max(1, round((span[1] - span[0]) / max(len(inputs) - 1, 1)))
            unit = "degrees" if scale == 1 else f"1/{scale} degrees"
            words = f"`{line}` is the input in {unit}{'' if exact else ', rounded'}."
        layout = Layout(self.root, line, step, span, sight)
        layout.pages.update(head.assembly_modes.items())
        if "logged" in head.properties:
            words += f" This recording has {head.properties['logged']}."
        self._charts = Charts(layout, self._outputs)
        self._row = head.row
        self._names[None] = Names(sight)
        self._outputs.name(self.name, head.properties)
        self._outputs.still(
            self.root, [("", rr.ViewCoordinates.RIGHT_HAND_Z_UP), *entities.world()]
        )
        for scene in map(in_degrees, head.scenes):
            named = self._links_named(scene)
            for primitive in scene.primitives:
                self._introduce(scene.page, primitive, False, named.get(primitive.path, ()))
        if head.scenes or layout.pages:
            words = NOTES.format(name=self.name, timeline=words, compared=MOST_COMPARED)
            self._introduce(None, Text("notes", "About", words))
        if layout.pages:
            self._lay_out()

    def log(
        self,
        scene: Scene,
        samples: Integers,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Record one block of samples of one mode, or the rows of a page of its own.

        Parameters
        ----------
        scene : Scene
            Primitives with n rows each; what does not move may be among them.
        samples : array (n,)
            Numbers of the samples.
        inputs : array (n,) rad, optional
            Input values; required if `start` got any.
        times : array (n,) s, optional
            Times; required if `start` got any.

        """
        plotted, layout = self._started, self._started.layout
        scene = in_degrees(scene)
        scene = replace(scene, primitives=tuple(map(charts.roomy, scene.primitives)))
        answers = asked_for(scene)
        lines = self._time(samples, inputs, times)
        for primitive in scene.primitives:
            entities.check_rows(primitive, len(samples))
        over = scene.over or self._axis(np.asarray(samples), inputs, times)
        if len(over) > 1 and self._row is None and isinstance(scene.page, int):
            over = (charts.along(over),)
        touched: dict[str, list[str]] = {}
        named = self._links_named(scene)
        fresh = [
            plotted.enter(scene, item, over, touched)
            if isinstance(item, Series)
            else self._introduce(scene.page, item, answers, named.get(item.path, ()))
            for item in scene.primitives
        ]
        if answers and scene.page is not None and scene.page not in layout.answered:
            layout.answered.append(scene.page)
            fresh.append(True)
        failed = np.zeros(len(samples), bool)
        plotted.log(touched, lines, over, len(samples))
        labels = labels_of_arrows(scene.primitives)
        for primitive in scene.primitives:
            path = layout.path(scene.page, primitive)
            for suffix, columns in entities.moving(primitive, labels.get(primitive.path)):
                self._outputs.columns(below(path, suffix), lines, columns, len(samples))
            rows = entities.drawn_whole(primitive)
            if rows is not None:
                self._whole.setdefault(path, (primitive, []))[1].append(np.array(rows))
            if isinstance(primitive, Body) and primitive.quaternions is not None:
                failed |= ~all_finite(primitive.quaternions, 1)
        if any(isinstance(item, Body) for item in scene.primitives):
            status = f"{layout.base(scene.page)}/status"
            if self._outputs.first(status, [("", entities.failure_label())]):
                layout.solids.append((scene.page, status))
                fresh.append(True)
            columns = entities.failure_columns(failed)
            self._outputs.columns(status, lines, columns, len(samples))
        if any(fresh):
            self._lay_out()
        live = self._outputs.live
        if live and time.monotonic() - self._live_drawn > LIVE_SECONDS:
            plotted.draw(live)
            self._live_drawn = time.monotonic()
        self._outputs.each(lambda output: output.flush())

    def _time(
        self, samples: Integers, inputs: Floats | None, times: Floats | None
    ) -> list[rr.TimeColumn]:
        """Return where rows are on the timelines."""
        lines = [rr.TimeColumn(SAMPLE, sequence=np.asarray(samples, dtype=np.int64))]
        line = self._started.layout.timeline
        if line == TIME:
            if times is None or len(times) != len(samples):
                raise ValueError("each sample needs its time")
            lines.append(rr.TimeColumn(line, duration=times))
        if self._scale is not None:
            if inputs is None or len(inputs) != len(samples):
                raise ValueError("each sample needs its input value")
            lines.append(rr.TimeColumn(line, sequence=input_ticks(inputs, self._scale)))
        return lines

    def _axis(
        self, samples: Integers, inputs: Floats | None, times: Floats | None
    ) -> tuple[Axis, ...]:
        """Return what a scene that does not say it is plotted over."""
        name, unit, values, span = "sample", "", samples.astype(float), self._span
        if span is not None and times is not None:
            name, unit, values = "time", "s", times
        elif span is not None and inputs is not None:
            name, unit, values = "input", "deg", np.degrees(inputs)
        else:
            span = np.min(values, initial=np.inf), np.max(values, initial=-np.inf)
        return (Axis(name, unit, values, span),)

    def finish(self) -> None:
        """Record the path of every pole, and make all files final; once is enough."""
        if self._finished:
            return
        if self._charts is not None:
            self._charts.draw(self._outputs.places)
            self._lay_out(final=True)
        self._finished = True
        for path, (primitive, blocks) in self._whole.items():
            self._outputs.still(
                path, entities.whole(primitive, np.concatenate(blocks), self._row)
            )
        self._outputs.each(lambda output: output.complete())

    def serve_until_interrupted(self) -> None:
        """Finish, and keep serving until the user presses Ctrl-C."""
        try:
            self.finish()
            while self.url is not None:
                time.sleep(0.5)
        except KeyboardInterrupt:
            return

    def _links_named(self, scene: Scene) -> dict[str, list[Name]]:
        """Return the names that links seen for the first time show, by their paths."""
        if scene.page not in self._names:
            self._names[scene.page] = deepcopy(self._names[None])
        bodies = [item for item in scene.primitives if isinstance(item, Body)]
        layout, seen = self._started.layout, self._outputs.seen
        return self._names[scene.page].give(
            [b for b in bodies if layout.path(scene.page, b) not in seen]
        )

    def _introduce(
        self,
        page: Page,
        primitive: Primitive,
        answers: bool = True,
        names: Sequence[Name] = (),
    ) -> bool:
        """Log what stays of a primitive seen for the first time; return if it was."""
        path = self._started.layout.path(page, primitive)
        new = self._outputs.first(path, entities.still(primitive, names))
        if new:
            self._place(page, path, primitive, answers)
        return new

    def _place(self, page: Page, path: str, primitive: Primitive, answers: bool) -> None:
        """Give a new primitive its place in the window."""
        layout = self._started.layout
        if page is not None:
            title = f"Assembly mode {page}" if isinstance(page, int) else page
            layout.pages.setdefault(page, title)
        if isinstance(primitive, SOLID):
            layout.solids.append((page, path))
        match primitive:
            case SphereMap(label=label, unit=unit):
                span, scale = (
                    map_range(primitive.shown_values, unit),
                    f"{layout.base(page)}/scale",
                )
                drawn = charts.horizontal_scale(*span, titled(label, unit))
                if self._outputs.first(scale, drawn):  # once for a page
                    layout.scales.append((page, scale))
            case Arrow(primary=primary, shown=shown, path_shown=path_shown):
                if not shown:
                    layout.overrides.append((page, path, HIDDEN))
                if shown and path_shown and not primary:
                    layout.overrides.append((page, f"{path}/trail", layout.recent))
            case Portrait() | Diagram() | Surface():
                view: View = partial(space, path, primitive.label)
                if isinstance(primitive, Diagram):
                    view = partial(plane, path, primitive.label, diagrams.bounds(primitive))
                elif isinstance(primitive, Portrait):
                    view = partial(plane, path, primitive.label, charts.BOUNDS)
                layout.plots.append(Plot(page, path, answers, view))
            case InputMarks():
                self._started.marks.setdefault(layout.base(page), []).append(primitive)
            case Graph():
                layout.panels.append((page, partial(graph, path)))
            case Text(label=label):
                view = partial(rrb.TextDocumentView, origin=path, name=label)
                layout.panels.append((page, view))

    def _lay_out(self, final: bool = False) -> None:
        """Send the layout to viewers; to files when it has grown fourfold, and in the end.

        A layout has an entity for every series of every assembly mode. One for each
        assembly mode that comes in would make a file grow with the square of their number.
        """
        size = len(self._outputs.seen)
        reached = self._outputs.live
        if final or size >= 4 * self._laid_out:
            self._laid_out, reached = size, self._outputs.places
        for output in reached:
            output.stream.send_blueprint(self._started.layout.blueprint())
