"""Pictures of a recording, taken by a viewer without a window."""

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
from spherekit.display.rerun.timelines import SAMPLE, TIME, input_scale
from spherekit.display.rerun.viewer_program import (
    HOST,
    free_ports,
    listens,
    program,
    recording_at,
)
from spherekit.errors import OutputError
from spherekit.storage.atomic_write import check_file, write_bytes
from spherekit.wording import listing, nearest

Size = tuple[int, int]

LOAD_TIMEOUT = 60.0
FRAMES = 20
AROUND_SPACE = (7, 71)
"""What of a window a view that fills it leaves to bars and frame."""
NOTICE_TIMEOUT = 12.0
NOTICE_COLOUR, NOTICE_INSET = (33, 33, 33), 14
NOTICE_ROWS = range(50, 100), range(20)
"""What a notice of the viewer looks like at its right edge, and how far in that is; and its
rows in a picture of the window and of a view that fills it."""
LARGEST = 8192
"""Pixels of a picture along a side: what graphics drivers draw at once."""
OLDEST = (0, 23)
"""Recordings of this version of rerun and later are read by all later ones."""
ENDING = 2.0
"""A viewer that has lost its graphics ends within this time (s) of its last answer."""

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
        Where to put the time cursor, one of the two; the first sample with a
        configuration if neither is given.
    view : "all" or "3D"
        The whole window, or only the 3D view of the page in front.
    size : (width, height)
        Size of the window in points; the picture may have two pixels to a point.
    front : sequence of str, optional
        Titles of pages and tabs to bring to the front, such as ``Compare``.

    """
    recording, picture = recording_at(recording), Path(picture)
    if sample is not None and input_deg is not None:
        raise ValueError("give a sample or an input angle, not both")
    check_picture(picture, size)
    check_version(recording)
    wide, high = AROUND_SPACE if view == "3D" else (0, 0)
    with _viewer((size[0] + wide, size[1] + high)) as client:
        client.open(str(recording.resolve()))
        timelines = _loaded(client, recording)
        if front:
            _bring_forward(client, recording, front)
        shown = _fill_window(client, recording) if view == "3D" else None
        timeline, tick = _cursor(timelines, sample, input_deg, recording)
        if sample is None and input_deg is None:
            tick = _first_shown(client, recording, timeline, tick)
        if timeline == TIME:
            client.set_time(
                timeline, duration=np.timedelta64(tick, "ns"), play_state="paused"
            )
        else:
            client.set_time(timeline, sequence=tick, play_state="paused")
        troubles = [
            report.summary for panel in client.get_state().views for report in panel.reports
        ]
        if troubles:
            raise OutputError(f"the viewer cannot show {recording}: {troubles[0]}")
        data = _settled(client, shown)
    write_bytes(picture, data)
    return picture


def check_picture(picture: Path, size: Size) -> None:
    """Raise `OutputError` unless a picture of a size (width, height) can be written."""
    if picture.suffix.lower() != ".png":
        raise OutputError(
            f"{picture}: pictures are PNG files; name it {picture.with_suffix('.png')}"
        )
    check_file(picture)
    if not all(100 <= side <= LARGEST for side in size):
        raise OutputError(
            f"{size[0]}x{size[1]} is no size of a picture; its sides are 100 to "
            f"{LARGEST} pixels"
        )


def check_version(recording: Path) -> None:
    """Raise `OutputError` if a recording was made by a rerun that this one cannot read."""
    with recording.open("rb") as stream:
        head = stream.read(6)
    installed = tuple(int(part) for part in version("rerun-sdk").split(".")[:2])
    made = tuple(head[4:6]) if head.startswith(b"RRF2") else ()
    if OLDEST <= made <= installed:
        return
    here, by = (".".join(map(str, number)) for number in (installed, made))
    what = (
        "make it again, `spherekit run FILE --save X.rrd`"
        if made < OLDEST
        else f"install that version, pip install rerun-sdk=={by}.*"
    )
    raise OutputError(
        f"{recording} was made by {f'rerun {by}' if any(made) else 'an older rerun'}, "
        f"which rerun {here} installed here does not read; {what}"
    )


def _fill_window(client: ViewerClient, recording: Path) -> str:
    """Let the 3D view that is in front fill the window, without bars; return its id."""
    parts = client.get_blueprint().blueprint
    spaces = {v.view_id for v in client.get_state().views if v.view_class == "3D"}
    seen = [view for view in _in_front(parts) if view in spaces]
    if not seen:
        raise OutputError(f"{recording} shows no 3D view")
    parts["/viewport"]["ViewportBlueprint"]["maximized"] = seen[0]
    parts["/time_panel"]["TimePanelBlueprint"]["state"] = "Hidden"
    client.set_blueprint(parts, "recording")
    return seen[0]


def _in_front(parts: Mapping[str, Any]) -> Iterator[str]:
    """Yield the ids of the views of a layout that are not hidden behind other tabs."""
    left = [f"container/{parts['/viewport']['ViewportBlueprint']['root_container']}"]
    while left:
        kind, _, name = left[0].partition("/")
        inner: list[str] = []
        if kind == "view":
            yield name
        else:
            fields = parts[f"/{left[0]}"]["ContainerBlueprint"]
            shown = "active_tab" if fields["container_kind"] == "Tabs" else "contents"
            inner = _several(fields[shown])
        left = inner + left[1:]


def _several(value: str | list[str]) -> list[str]:
    """Return a component of a layout, which is no list where it has one element."""
    return [value] if isinstance(value, str) else value


def _bring_forward(client: ViewerClient, recording: Path, titles: Sequence[str]) -> None:
    """Make the pages and tabs of these titles the active ones."""
    parts = client.get_blueprint().blueprint
    named: dict[str, list[str]] = {}
    for path, fields in parts.items():
        for values in fields.values():
            if "display_name" in values:
                named.setdefault(values["display_name"], []).append(path.strip("/"))
    tabs = [
        fields["ContainerBlueprint"]
        for fields in parts.values()
        if fields.get("ContainerBlueprint", {}).get("container_kind") == "Tabs"
    ]
    hidden = {path for tab in tabs for path in tab["contents"]}
    for title in titles:
        wanted = hidden.intersection(named.get(title, ()))
        if not wanted:
            offered = [name for name, paths in named.items() if hidden.intersection(paths)]
            raise OutputError(
                f'{recording} has no tab "{title}"{nearest(title, offered) or "."} Tabs: '
                f"{listing(map(repr, sorted(offered)))}"
            )
        for tab in tabs:
            for path in wanted.intersection(tab["contents"]):
                tab["active_tab"] = path
    client.set_blueprint(parts, "recording")


def _settled(client: ViewerClient, view_id: str | None) -> bytes:
    """Return a picture once it no longer changes: plots come some frames late.

    And once the viewer's notice that it listens is gone, which nothing keeps away.
    """
    deadline = time.monotonic() + NOTICE_TIMEOUT
    rows = NOTICE_ROWS[view_id is not None]
    data, frame = client.take_screenshot(view_id=view_id), 0
    while frame < FRAMES:
        time.sleep(0.1)
        last, data = data, client.take_screenshot(view_id=view_id)
        if not _shows_notice(data, rows) or time.monotonic() >= deadline:
            if data == last:
                break
            frame += 1
    return data


def _shows_notice(data: bytes, rows: range) -> bool:
    """Return whether a notice covers the upper right corner of a picture."""
    from PIL import Image

    with Image.open(io.BytesIO(data)) as picture:
        right = picture.width - NOTICE_INSET
        edge = picture.crop((right, rows.start, right + 1, rows.stop)).convert("RGB")
    return edge.getcolors() == [(len(rows), NOTICE_COLOUR)]


def _cursor(
    timelines: dict[str, int],
    sample: int | None,
    input_deg: float | None,
    recording: Path,
) -> tuple[str, int]:
    """Return the timeline and the time on it that were asked for, in ns on `TIME`."""
    inputs = [(name, scale) for name in timelines if (scale := input_scale(name))]
    if sample is None and input_deg is not None:
        if not inputs:
            raise OutputError(f"{recording} has no input timeline; name a sample")
        name, scale = inputs[0]
        return name, round(input_deg * scale)
    if SAMPLE not in timelines:
        raise OutputError(f"{recording} has no timeline named {SAMPLE}")
    if sample is not None:
        _check_sample(recording, sample)
        return SAMPLE, sample
    first = TIME if TIME in timelines else inputs[0][0] if inputs else SAMPLE
    return first, timelines[first]


def _first_shown(client: ViewerClient, recording: Path, timeline: str, start: int) -> int:
    """Return the first time at which what is in front has a configuration, or the start.

    Where there is none, the words that say so are at the centre.
    """
    parts = client.get_blueprint().blueprint
    words = {
        path.strip("+ ").removesuffix("/**")
        for view in _in_front(parts)
        for path in _several(parts[f"/view/{view}/ViewContents"]["ViewContents"]["query"])
        if path.endswith("/status/**")
    }
    shown = []
    for chunk in RrdReader(str(recording)).stream():
        if chunk.entity_path in words and not chunk.is_static:
            batch = chunk.to_record_batch()
            said = batch.column("Points3D:positions").to_pylist()
            ticks = batch.column(timeline).cast("int64").to_pylist()
            shown += [tick for tick, row in zip(ticks, said, strict=True) if not row]
    return min(shown, default=start)


def _check_sample(recording: Path, sample: int) -> None:
    """Raise `OutputError` if no page of a recording has a sample."""
    samples: set[int] = set()
    for chunk in RrdReader(str(recording)).stream():
        batch = chunk.to_record_batch()
        if not chunk.is_static and SAMPLE in batch.schema.names:
            samples.update(batch.column(SAMPLE).to_pylist())
    if sample not in samples:
        span = f"{min(samples)} to {max(samples)}" if samples else "none"
        raise OutputError(f"{recording} has no sample {sample}; its samples: {span}")


def _loaded(client: ViewerClient, recording: Path) -> dict[str, int]:
    """Wait until a recording is there; return its timelines and where they start."""
    deadline = time.monotonic() + LOAD_TIMEOUT
    while time.monotonic() < deadline:
        state = client.get_state()
        active = [r for r in state.recordings if r.store_id == state.active_recording]
        if active and not state.loading and active[0].timelines:
            return {line.name: line.start or 0 for line in active[0].timelines}
        time.sleep(0.05)
    raise OutputError(
        f"the viewer did not load {recording} within {LOAD_TIMEOUT:.0f} s; check it "
        "with `rerun rrd verify`"
    )


@contextmanager
def _viewer(size: Size) -> Iterator[ViewerClient]:
    """Run a viewer without a window for a while."""
    (port,) = free_ports(1)
    words = ["--headless", "--hide-welcome-screen", f"--bind={HOST}", f"--port={port}"]
    words.append(f"--window-size={size[0]}x{size[1]}")
    with tempfile.TemporaryFile() as messages, program(*words, messages=messages) as viewer:
        if not listens(viewer, port):
            reason = "it did not start" if viewer.poll() is None else "it ended at once"
            raise OutputError(_complaint(viewer, messages, reason))
        try:
            yield ViewerClient.connect(f"rerun+http://{HOST}:{port}/proxy")
        except (RuntimeError, ConnectionError) as error:
            raise OutputError(_complaint(viewer, messages, str(error))) from error


def _complaint(process: subprocess.Popen[bytes], messages: IO[bytes], reason: str) -> str:
    """Return why the viewer failed, from what it wrote on its error stream."""
    with suppress(subprocess.TimeoutExpired):
        process.wait(ENDING)
    messages.seek(0)
    said = messages.read().decode(errors="replace")
    lost = ("graphics adapter", "render context", "Vulkan", "wgpu")
    if any(word in said for word in lost) and process.poll() is not None:
        return NO_VULKAN
    return f"the viewer could not take a picture: {reason}"
