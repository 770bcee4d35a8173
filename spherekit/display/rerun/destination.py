"""Where a recording goes: a file, a server of our own, or a viewer that runs already.

Left alone, rerun drops data in silence when the disk is full or the viewer is gone.
Here every such loss is an `OutputError`.
"""

import errno
import os
import socket
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from spherekit.display.rerun.rerun_sdk import rr
from spherekit.display.rerun.viewer_program import RRD
from spherekit.errors import OutputError
from spherekit.storage.atomic_write import check_file, check_made_by_spherekit
from spherekit.storage.file_lock import try_lock

LIVE_TIMEOUT = 30.0
PROBE_TIMEOUT = 2.0

HTTP2_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
HTTP2_SETTINGS = b"\x04"


PIECE = 1 << 16


def check_place(path: Path) -> None:
    """Raise `OutputError` unless a recording can be written there."""
    if path.suffix != ".rrd":
        raise OutputError(
            f"{path}: a recording must be named *.rrd, since the viewer goes by that ending"
        )
    check_file(path)


class FileOutput:
    """A file that appears under its own name only when it is whole.

    When the disk fills, rerun's own file writer dies with a line on the error stream, and
    waiting for it may then last for ever. Here it writes to a pipe, which never fails, and
    a thread copies the pipe to the file and keeps the first error.
    """

    def __init__(self, stream: rr.RecordingStream, path: Path) -> None:
        self.stream, self.path = stream, path
        self.part = path.with_name(path.name + ".part")
        self._copier: threading.Thread | None = None
        self._error: OSError | None = None

    def open(self) -> None:
        """Start the part file beside the file, locked, and point the stream at it."""
        check_place(self.path)
        check_made_by_spherekit(self.part, RRD)
        try:
            self._lock = self.part.open("ab", buffering=0)
            if not try_lock(self._lock.fileno()):
                self._lock.close()
                raise OSError(errno.EAGAIN, "another run is recording there")
            self._file = self.part.open("wb", buffering=0)
            self._read, write = os.pipe()
            try:
                self.stream.save(f"/dev/fd/{write}")
            finally:
                os.close(write)
        except OSError as error:
            raise OutputError(
                f"cannot write {self.part}: {error.strerror}; choose a folder you may "
                "write to, on a disk with room"
            ) from error
        self._copier = threading.Thread(target=self._copy, daemon=True)
        self._copier.start()

    def _copy(self) -> None:
        with os.fdopen(self._read, "rb", buffering=0) as pipe, self._file as file:
            while piece := pipe.read(PIECE):
                if self._error is not None:
                    continue
                try:
                    rest = memoryview(piece)
                    while rest:
                        rest = rest[file.write(rest) :]
                except OSError as error:
                    self._error = error

    def flush(self) -> None:
        """Hand all that was logged to the file."""
        if self._copier is not None:
            self.stream.flush()
            self._complain()

    def complete(self) -> None:
        """Write the rest, and give the part file its name."""
        if self._copier is None:
            return
        self._end()
        self._complain()
        try:
            self.part.replace(self.path)
        except OSError as error:
            raise OutputError(
                f"cannot replace {self.path}: {error.strerror}; the whole recording is "
                f"in {self.part}"
            ) from error

    def close(self, keep: bool) -> str:
        """Close the part file of a run that stopped half-way; return what is kept of it."""
        if self._copier is None:
            return ""
        self._end()
        if keep:
            self._complain()
            return f"what was recorded until then is in {self.part}"
        self.part.unlink(missing_ok=True)
        return ""

    def _end(self) -> None:
        """Write the rest and close the file."""
        self.stream.disconnect()
        if self._copier is not None:
            self._copier.join()
            self._copier = None
            self._lock.close()

    def _complain(self) -> None:
        """Raise `OutputError`, without the part file, if the disk has refused something."""
        if self._error is not None:
            self._end()
            self.part.unlink(missing_ok=True)
            raise OutputError(
                f"{self.path} could not be written whole: {self._error.strerror}; make "
                "room or choose another disk. The part written was removed"
            ) from self._error


@dataclass
class LiveOutput:
    """Another program that takes the recording as it goes on; without a sink a notebook.

    `check` raises `OutputError` where the place cannot be reached at first, and later on
    where it is gone. A notebook's page has the recording when it is whole.
    """

    stream: rr.RecordingStream
    place: str
    check: Callable[[bool], None]
    sink: Callable[[], Any] | None = None

    def open(self) -> None:
        """Reach the place; everything is logged after this."""
        self.check(True)
        if self.sink is not None:
            self.stream.set_sinks(self.sink())

    def flush(self) -> None:
        """Wait until all that was logged has arrived."""
        if self.sink is None:
            return
        self.check(False)  # rerun would go on as if it were there
        try:
            self.stream.flush(timeout_sec=LIVE_TIMEOUT)
        except RuntimeError as error:
            raise OutputError(
                f"{self.place} no longer takes data ({_reason(error)}); start it again, or "
                "record to a file"
            ) from error

    def complete(self) -> None:
        """Wait until it has everything, and goes on showing it, or show it now."""
        if self.sink is None:
            rr.notebook_show(recording=self.stream)
        self.flush()

    def close(self, keep: bool) -> str:
        """Let go of it."""
        if self.sink is not None:
            self.stream.disconnect()
        return ""


Output = FileOutput | LiveOutput


def served(stream: rr.RecordingStream, port: int) -> LiveOutput:
    """Return a server on this computer that keeps the recording for viewers that come."""

    def check(at_first: bool) -> None:
        if not at_first:
            return
        if port == 0:  # the system would choose one, which viewers do not know
            raise OutputError("cannot serve on port 0; choose one from 1 to 65535")
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except (OSError, OverflowError) as error:
                raise OutputError(
                    f"cannot serve on port {port} ({_reason(error)}); choose another port, "
                    "or connect to the viewer that listens there"
                ) from error

    place = f"the server on port {port}"
    return LiveOutput(stream, place, check, lambda: rr.GrpcServerSink("127.0.0.1", port))


def viewer_at(stream: rr.RecordingStream, url: str) -> LiveOutput:
    """Return a viewer, or another server, that listens at a URL."""

    def check(at_first: bool) -> None:
        try:
            parts = urlsplit(url)
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if not host or not port or not parts.scheme.startswith("rerun"):
            raise OutputError(
                f'"{url}" is not the address of a viewer; it looks like '
                "rerun+http://127.0.0.1:9876/proxy"
            )
        if not _speaks_http2(host, port):
            raise OutputError(
                f"no viewer listens at {url}; start one with `rerun --port {port}` or "
                "leave the recording in a file"
                if at_first
                else f"the viewer at {url} is gone; start it again, or record to a file"
            )

    return LiveOutput(stream, f"the viewer at {url}", check, lambda: rr.GrpcSink(url))


def check_notebook(at_first: bool) -> None:
    """Raise `OutputError` if notebooks cannot show recordings."""
    if find_spec("rerun_notebook") is None:
        raise OutputError(
            "a notebook shows recordings by the package rerun-notebook, which is not "
            'installed; install it with: pip install "spherekit-mechanisms[notebook]", '
            "or write a file with save(path)"
        )


def _speaks_http2(host: str, port: int) -> bool:
    """Return whether a server at this port answers as gRPC servers do.

    Rerun itself would wait for seconds, or for ever if something else listens there.
    """
    try:
        with socket.create_connection((host, port), timeout=PROBE_TIMEOUT) as probe:
            probe.sendall(HTTP2_HELLO)
            return probe.recv(9)[3:4] == HTTP2_SETTINGS
    except OSError:
        return False


def _reason(error: BaseException) -> str:
    """Return the innermost words of an error, in one line."""
    return (str(error).strip() or type(error).__name__).splitlines()[-1].strip()


Still = tuple[str, rr.AsComponents]
"""Path below something, and what is logged there once."""
Stills = Iterator[Still]
Columns = Iterable[rr.ComponentColumn]
"""What is logged of rows."""


def below(path: str, suffix: str) -> str:
    """Return a path below another one, or that itself without a suffix."""
    return f"{path}/{suffix}" if suffix else path


class Outputs:
    """Places that all get the same.

    `entities` and `rows` are those logged so far; `seen` the paths that came up.
    """

    def __init__(self, places: Iterable[Output]) -> None:
        self.places = list(places)
        self.entities: set[str] = set()
        self.seen: set[str] = set()
        self.rows = 0

    @property
    def live(self) -> list[Output]:
        """The places where somebody may look on."""
        return [place for place in self.places if not isinstance(place, FileOutput)]

    def cost(self, finished: bool) -> dict[str, int]:
        """Return entities and rows logged, and the bytes of a file that is finished."""
        whole = sum(
            place.path.stat().st_size
            for place in self.places
            if finished and isinstance(place, FileOutput)
        )
        return {"entities": len(self.entities), "rows": self.rows, "bytes": whole}

    def open(self) -> None:
        """Open all places, or none."""
        with ExitStack() as opened:
            for place in self.places:
                place.open()
                opened.callback(place.close, keep=False)
            opened.pop_all()

    def close(self, error: BaseException | None) -> None:
        """Let go of all places, and note on an error what was kept."""
        for place in self.places:
            left = place.close(keep=self.rows > 0)
            if left and error is not None:
                error.add_note(left)

    def name(self, name: str, properties: Mapping[str, Any]) -> None:
        """Send the name of the recording, and what is to be known of the run."""
        for place in self.places:
            place.stream.send_recording_name(name)
            if properties:
                place.stream.send_property("run", rr.AnyValues(False, **properties))

    def first(self, path: str, drawn: Iterable[Still]) -> bool:
        """Log what does not move when a path comes up first; return whether it does."""
        new = path not in self.seen
        if new:
            self.seen.add(path)
            self.still(path, drawn)
        return new

    def still(
        self, path: str, drawn: Iterable[Still], places: Sequence[Output] | None = None
    ) -> None:
        """Log what does not move below a path, to some places or to all."""
        for suffix, archetype in drawn:
            entity = below(path, suffix)
            self.entities.add(entity)
            for place in self.places if places is None else places:
                place.stream.log(entity, archetype, static=True)

    def columns(
        self,
        path: str,
        times: Sequence[rr.TimeColumn],
        columns: Columns,
        rows: int,
    ) -> None:
        """Log rows of what moves."""
        if rows == 0:
            return
        columns = list(columns)
        for output in self.places:
            output.stream.send_columns(path, times, columns)
        self.entities.add(path)
        self.rows += rows

    def each(self, action: Callable[[Output], None]) -> None:
        """Do something with each place; a lost viewer does not stop a file."""
        for output in tuple(self.places):
            try:
                action(output)
            except OutputError as error:
                kept = any(isinstance(other, FileOutput) for other in self.places)
                if isinstance(output, FileOutput) or not kept:
                    raise
                warnings.warn(f"{error}; the file goes on", stacklevel=3)
                self.places.remove(output)
                output.close(keep=False)
