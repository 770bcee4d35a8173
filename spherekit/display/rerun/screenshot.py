"""Takes pictures of a recording with a viewer that has no window."""

import io
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np

from spherekit.argument_validation import checked
from spherekit.display.rerun.rerun_sdk import RrdReader, ViewerClient
from spherekit.display.rerun.timelines import (
    SAMPLE_TIMELINE,
    TIME_TIMELINE,
    ticks_per_degree,
)
from spherekit.display.rerun.viewer_program import (
    HOST,
    free_ports,
    recording_at,
    run_viewer,
    wait_for_port,
)
from spherekit.errors import OutputError
from spherekit.storage.atomic_write import check_file, write_bytes
from spherekit.wording import listing, nearest

Size = tuple[int, int]

LOAD_TIMEOUT_S = 60.0
"""Time within which the viewer has to load a recording."""

MAX_FRAMES = 20
"""Number of pictures after which a picture that still changes is taken as it is."""

FRAME_INTERVAL_S = 0.1

VIEW_BORDER = (7, 71)
"""Width and height that bars and frames take in a window filled by a single view."""

NOTICE_TIMEOUT_S = 12.0
"""Time after which a picture is taken although a notice covers it."""

NOTICE_COLOUR = (33, 33, 33)
NOTICE_INSET = 14
"""Colour of a notice of the viewer, and distance of the notice from the right edge."""

WINDOW_NOTICE_ROWS = range(50, 100)
VIEW_NOTICE_ROWS = range(20)
"""Rows that a notice covers in a picture of the window, and of a view that fills it."""

MAX_SIDE_PIXELS = 8192
"""Largest side of a picture: graphics drivers draw no more at once."""

MIN_SIDE_PIXELS = 100

OLDEST_READABLE_VERSION = (0, 23)
"""Recordings of this version of rerun and later are read by all later versions."""

EXIT_TIMEOUT_S = 2.0
"""Time within which a viewer that has lost its graphics ends."""

NO_VULKAN = (
    "the viewer found no graphics driver; install a Vulkan driver, on Debian and "
    "Ubuntu the package mesa-vulkan-drivers, which needs no graphics card"
)


@checked(OutputError)
def screenshot(
    recording: Path | str,
    picture: Path | str,
    *,
    sample: int | None = None,
    input_deg: float | None = None,
    view: Literal["all", "3D"] = "all",
    size: Size = (1600, 1000),
    front: Sequence[str] = (),
) -> Path:
    """Write a PNG of a recording at one sample, or at one input angle.

    Parameters
    ----------
    recording : Path or str
        The ``*.rrd`` file.
    picture : Path or str
        The PNG to write.
    sample, input_deg : optional
        The sample, or the input angle, to show. By default it is the first sample with a
        configuration.
    view : "all" or "3D"
        The whole window, or only the 3D view of the page in front.
    size : (width, height)
        Size of the picture in points; the picture may have two pixels to a point.
    front : sequence of str, optional
        Titles of pages and tabs to select before the picture is taken, such as ``Compare``.

    Raises
    ------
    OutputError
        If the recording cannot be shown at this place, or the picture cannot be written.
    """
    recording = recording_at(recording)
    picture = Path(picture)
    if sample is not None and input_deg is not None:
        raise OutputError("give a sample or an input angle, not both")
    check_picture(picture, size)
    check_version(recording)
    # Bars and frames make a view smaller than its window.
    border = VIEW_BORDER if view == "3D" else (0, 0)
    with _headless_viewer((size[0] + border[0], size[1] + border[1])) as client:
        client.open(str(recording.resolve()))
        timelines = _wait_until_loaded(client, recording)
        if front:
            _activate_tabs(client, recording, front)
        view_id = _maximise_3d_view(client, recording) if view == "3D" else None
        # Set the cursor and let the viewer stand still there.
        timeline, tick = _cursor_position(timelines, sample, input_deg, recording)
        if sample is None and input_deg is None:
            tick = _first_valid_time(client, recording, timeline, tick)
        if timeline == TIME_TIMELINE:
            client.set_time(
                timeline, duration=np.timedelta64(tick, "ns"), play_state="paused"
            )
        else:
            client.set_time(timeline, sequence=tick, play_state="paused")
        problems = [
            report.summary for panel in client.get_state().views for report in panel.reports
        ]
        if problems:
            raise OutputError(f"the viewer cannot show {recording}: {problems[0]}")
        data = _take_stable_picture(client, view_id)
    write_bytes(picture, data)
    return picture


def check_picture(picture: Path, size: Size) -> None:
    """Raise `OutputError` unless a picture of a size (width, height) can be written."""
    check_file(picture)  # refuses folders, so the path has a name below
    if picture.suffix.lower() != ".png":
        raise OutputError(
            f"{picture}: pictures are PNG files; name it {picture.with_suffix('.png')}"
        )
    if not all(MIN_SIDE_PIXELS <= side <= MAX_SIDE_PIXELS for side in size):
        raise OutputError(
            f"{size[0]}x{size[1]} is not a valid size of a picture; its sides can be "
            f"{MIN_SIDE_PIXELS} to {MAX_SIDE_PIXELS} pixels"
        )


def check_version(recording: Path) -> None:
    """Raise `OutputError` if the installed version of rerun cannot read a recording."""
    with recording.open("rb") as stream:
        header = stream.read(6)
    installed = tuple(int(part) for part in version("rerun-sdk").split(".")[:2])
    # The header is RRF2 and then the version of rerun, one byte for each part.
    recorded = tuple(header[4:6]) if header.startswith(b"RRF2") else ()
    if OLDEST_READABLE_VERSION <= recorded <= installed:
        return
    installed_text = ".".join(map(str, installed))
    recorded_text = ".".join(map(str, recorded))
    if recorded < OLDEST_READABLE_VERSION:
        hint = "make it again, `spherekit run FILE --save X.rrd`"
    else:
        hint = f"install that version, pip install rerun-sdk=={recorded_text}.*"
    maker = f"rerun {recorded_text}" if any(recorded) else "an older rerun"
    raise OutputError(
        f"{recording} was made by {maker}, which the installed rerun {installed_text} "
        f"cannot read; {hint}"
    )


def _maximise_3d_view(client: ViewerClient, recording: Path) -> str:
    """Let the 3D view of the visible page fill the window, without the time panel.

    Returns the id of the view, of which a picture is taken.

    The layout of the window (blueprint of rerun) is a nested mapping that is read from the
    viewer, changed and sent back.

    Parameters
    ----------
    client
        The connection to the viewer, which has loaded the recording.
    recording
        Path of the recording, for messages.
    """
    blueprint = client.get_blueprint().blueprint
    ids_of_3d_views = {
        view.view_id for view in client.get_state().views if view.view_class == "3D"
    }
    visible = [view for view in _visible_views(blueprint) if view in ids_of_3d_views]
    if not visible:
        raise OutputError(f"{recording} shows no 3D view")
    blueprint["/viewport"]["ViewportBlueprint"]["maximized"] = visible[0]
    blueprint["/time_panel"]["TimePanelBlueprint"]["state"] = "Hidden"
    # The viewer has layouts for recordings and for tables. This is one for a recording.
    client.set_blueprint(blueprint, of="recording")
    return visible[0]


def _visible_views(blueprint: Mapping[str, Any]) -> Iterator[str]:
    """Yield the ids of the views that are not hidden behind other tabs, from left to right.

    The layout of the window is a tree: containers consist of views and other containers. A
    container of tabs shows only its active tab. The tree is walked depth first.

    Parameters
    ----------
    blueprint
        The layout: blueprint[path of a part][type of its data][name of a setting]. An
        example of a path is ``/container/ID``, and of a type ``ContainerBlueprint``.
    """
    root = blueprint["/viewport"]["ViewportBlueprint"]["root_container"]
    pending = [f"container/{root}"]
    while pending:
        path = pending[0]
        kind, _, name = path.partition("/")
        contents: list[str] = []
        if kind == "view":
            yield name
        else:
            container = blueprint[f"/{path}"]["ContainerBlueprint"]
            is_tabs = container["container_kind"] == "Tabs"
            # Parts of a container, each as "view/ID" or "container/ID".
            contents = _as_list(container["active_tab" if is_tabs else "contents"])
        pending = contents + pending[1:]  # the contents come before the next part


def _as_list(value: str | list[str]) -> list[str]:
    """Return a component of a layout as a list; one element comes without a list."""
    return [value] if isinstance(value, str) else value


def _activate_tabs(client: ViewerClient, recording: Path, titles: Sequence[str]) -> None:
    """Bring the pages and tabs with given titles to the front.

    Parameters
    ----------
    client
        The viewer.
    recording
        Path of the recording, for messages.
    titles
        Titles of pages and tabs. One title may name several tabs, such as one per page.

    Raises
    ------
    OutputError
        If there is no tab with one of the titles.
    """
    # The layout of the window is a nested dictionary: blueprint[path of a part][type of its
    # data][name of a setting].
    blueprint = client.get_blueprint().blueprint
    # Find the title of every part of the layout, and the containers that show tabs.
    paths_of_title: dict[str, list[str]] = {}
    for path, settings_by_type in blueprint.items():
        for settings in settings_by_type.values():
            if "display_name" in settings:
                title = settings["display_name"]
                paths_of_title.setdefault(title, []).append(path.strip("/"))
    tab_containers = [
        settings_by_type["ContainerBlueprint"]
        for settings_by_type in blueprint.values()
        if settings_by_type.get("ContainerBlueprint", {}).get("container_kind") == "Tabs"
    ]
    tab_paths = {path for tabs in tab_containers for path in tabs["contents"]}
    for title in titles:
        paths = tab_paths.intersection(paths_of_title.get(title, ()))
        if not paths:
            tab_titles = [
                name
                for name, named_paths in paths_of_title.items()
                if tab_paths.intersection(named_paths)
            ]
            raise OutputError(
                f'{recording} has no tab "{title}"{nearest(title, tab_titles) or "."} '
                f"Tabs: {listing(map(repr, sorted(tab_titles)))}"
            )
        for tabs in tab_containers:
            for path in paths.intersection(tabs["contents"]):
                tabs["active_tab"] = path
    client.set_blueprint(blueprint, "recording")


def _take_stable_picture(client: ViewerClient, view_id: str | None) -> bytes:
    """Return a PNG of the viewer once two successive pictures are equal.

    Plots appear some time after the recording is loaded. After the start the viewer shows a
    notice over the picture, which can't be switched off. The function waits until the
    notice disappears, at most `NOTICE_TIMEOUT_S`. After that the function takes at most
    `MAX_FRAMES` further pictures. If pictures still change, the last one is returned.

    Parameters
    ----------
    client
        The connection to the viewer.
    view_id
        The view that fills the window; None for the whole window.
    """
    deadline = time.monotonic() + NOTICE_TIMEOUT_S
    notice_rows = WINDOW_NOTICE_ROWS if view_id is None else VIEW_NOTICE_ROWS
    picture = client.take_screenshot(view_id=view_id)
    frame = 0
    while frame < MAX_FRAMES:
        time.sleep(FRAME_INTERVAL_S)
        last_picture = picture
        picture = client.take_screenshot(view_id=view_id)
        if _shows_notice(picture, notice_rows) and time.monotonic() < deadline:
            continue  # pictures with the notice are not counted
        if picture == last_picture:
            break
        frame += 1
    return picture


def _shows_notice(png: bytes, rows: range) -> bool:
    """Return whether a notice covers given rows at the right edge of a picture."""
    from PIL import Image

    with Image.open(io.BytesIO(png)) as picture:
        x = picture.width - NOTICE_INSET
        edge = picture.crop((x, rows.start, x + 1, rows.stop)).convert("RGB")
    return edge.getcolors() == [(len(rows), NOTICE_COLOUR)]


def _cursor_position(
    timelines: dict[str, tuple[int, int]],
    sample: int | None,
    input_deg: float | None,
    recording: Path,
) -> tuple[str, int]:
    """Return the timeline, and the position on it, at which a picture is to be taken.

    A recording can be shown along several timelines. Every recording of the project has a
    timeline of sample numbers. It can have another one, of times or of an input.

    Parameters
    ----------
    timelines
        The first and last position on each timeline of the recording, by its name.
    sample, input_deg
        A sample number or an input (deg), at most one of them. If neither is given, the
        result is the first position on the timeline of times. Without such a timeline it is
        that on the timeline of an input, or else on that of sample numbers.
    recording
        Path of the recording, for messages.

    Returns
    -------
    timeline
        Name of the timeline.
    tick
        The position on this timeline, a whole number: a sample number, the input in ticks
        (parts of a degree), or a time in ns.

    Raises
    ------
    OutputError
        If the recording does not have the timeline of the input, the input or the sample.
        Unless an input is given, also if it does not have a timeline of sample numbers.
    """
    # `ticks_per_degree` is None for timelines that are not of an input.
    input_timelines = []
    for name in timelines:
        scale = ticks_per_degree(name)
        if scale is not None:
            input_timelines.append((name, scale))
    if sample is None and input_deg is not None:
        if not input_timelines:
            raise OutputError(f"{recording} has no input timeline; name a sample")
        name, scale = input_timelines[0]
        first, last = timelines[name]
        # This condition also refuses NaN and infinity, which `round` cannot convert.
        if not first - 0.5 <= input_deg * scale <= last + 0.5:
            raise OutputError(
                f"{recording} has no input {input_deg:g} deg; its inputs: "
                f"{first / scale:g} to {last / scale:g} deg"
            )
        return name, round(input_deg * scale)
    # A file without this timeline is not a recording of the project.
    if SAMPLE_TIMELINE not in timelines:
        raise OutputError(f"{recording} has no timeline named {SAMPLE_TIMELINE}")
    if sample is not None:
        _check_sample(recording, sample)
        return SAMPLE_TIMELINE, sample
    if TIME_TIMELINE in timelines:
        name = TIME_TIMELINE
    elif input_timelines:
        name = input_timelines[0][0]
    else:
        name = SAMPLE_TIMELINE
    return name, timelines[name][0]


def _first_valid_time(
    client: ViewerClient, recording: Path, timeline: str, start: int
) -> int:
    """Return the first time at which the visible page shows a configuration.

    A mechanism may not be assembled at its first samples, and a picture would be empty
    there. Each page has a failure label ("no configuration here"). The label has a position
    only in rows (samples) without a configuration, so it shows which rows have a
    configuration.

    Parameters
    ----------
    client
        The connection to the viewer.
    recording
        Path of the recording.
    timeline
        Name of the timeline.
    start
        The time to return if no row has a configuration.
    """
    # Rules say what a view shows, such as "+ /four_bar/assembly_mode_0/status/**". The
    # failure label of a page has a path that ends in "/status".
    blueprint = client.get_blueprint().blueprint
    label_paths = set()
    for view in _visible_views(blueprint):
        contents = blueprint[f"/view/{view}/ViewContents"]["ViewContents"]["query"]
        for rule in _as_list(contents):
            if rule.endswith("/status/**"):
                label_paths.add(rule.strip("+ ").removesuffix("/**"))
    valid_times = []
    for chunk in RrdReader(str(recording)).stream():
        if chunk.entity_path in label_paths and not chunk.is_static:
            batch = chunk.to_record_batch()
            label_positions = batch.column("Points3D:positions").to_pylist()
            times = batch.column(timeline).cast("int64").to_pylist()
            valid_times += [
                valid_time
                for valid_time, positions in zip(times, label_positions, strict=True)
                if not positions
            ]
    return min(valid_times, default=start)


def _check_sample(recording: Path, sample: int) -> None:
    """Raise `OutputError` if no page of a recording has a sample."""
    samples: set[int] = set()
    for chunk in RrdReader(str(recording)).stream():
        batch = chunk.to_record_batch()
        if not chunk.is_static and SAMPLE_TIMELINE in batch.schema.names:
            samples.update(batch.column(SAMPLE_TIMELINE).to_pylist())
    if sample not in samples:
        span = f"{min(samples)} to {max(samples)}" if samples else "none"
        raise OutputError(f"{recording} has no sample {sample}; its samples: {span}")


def _wait_until_loaded(client: ViewerClient, recording: Path) -> dict[str, tuple[int, int]]:
    """Wait until the viewer has loaded a recording, and return the ends of its timelines.

    Returns
    -------
    The first and last time on each timeline of the recording, by the name of the timeline.
    """
    deadline = time.monotonic() + LOAD_TIMEOUT_S
    while time.monotonic() < deadline:
        state = client.get_state()
        active = [
            loaded
            for loaded in state.recordings
            if loaded.store_id == state.active_recording
        ]
        if active and not state.loading and active[0].timelines:
            return {
                line.name: (line.start or 0, line.end or 0) for line in active[0].timelines
            }
        time.sleep(0.05)
    raise OutputError(
        f"the viewer did not load {recording} within {LOAD_TIMEOUT_S:.0f} s; check it "
        "with `rerun rrd verify`"
    )


@contextmanager
def _headless_viewer(size: Size) -> Iterator[ViewerClient]:
    """Run a viewer without a window for the duration of a `with` block.

    The value of the block is a client (a connection that controls the viewer).

    Raises
    ------
    OutputError
        If the viewer does not start, or fails within the block.
    """
    (port,) = free_ports(1)
    words = ["--headless", "--hide-welcome-screen", f"--bind={HOST}", f"--port={port}"]
    words.append(f"--window-size={size[0]}x{size[1]}")
    with (
        tempfile.TemporaryFile() as messages,
        run_viewer(*words, messages=messages) as process,
    ):
        if not wait_for_port(process, port):
            reason = "it did not start" if process.poll() is None else "it ended at once"
            raise OutputError(_failure_message(process, messages, reason))
        try:
            yield ViewerClient.connect(f"rerun+http://{HOST}:{port}/proxy")
        except (RuntimeError, ConnectionError) as error:
            raise OutputError(_failure_message(process, messages, str(error))) from error


def _failure_message(
    process: subprocess.Popen[bytes], messages: IO[bytes], reason: str
) -> str:
    """Return a message for the user about a viewer that failed.

    A missing graphics driver is recognised by words in the error stream of a viewer that
    has ended. The message for this case says how to install a driver.

    Parameters
    ----------
    process
        The process of the viewer, which may still run.
    messages
        The error stream of the process.
    reason
        The reason for the message in all other cases.
    """
    # Give a viewer that is about to end the time to end.
    with suppress(subprocess.TimeoutExpired):
        process.wait(EXIT_TIMEOUT_S)
    messages.seek(0)
    text = messages.read().decode(errors="replace")
    graphics_words = ("graphics adapter", "render context", "Vulkan", "wgpu")
    has_ended = process.poll() is not None
    if has_ended and any(word in text for word in graphics_words):
        return NO_VULKAN
    return f"the viewer could not take a picture: {reason}"
