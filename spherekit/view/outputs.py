"""Where a recording goes: a file, a server of our own, or a viewer that runs already.

Left alone, rerun drops data in silence when the disk is full or the viewer is gone.
Here every such loss is an `OutputError`.
"""

import errno
import os
import socket
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

from spherekit.errors import OutputError
from spherekit.files.atomic import check_file, check_own
from spherekit.files.plain import take
from spherekit.view.sdk import RrdReader, rr

LIVE_TIMEOUT = 30.0
PROBE_TIMEOUT = 2.0

RRD = b"RRF"
"""What a recording has at its beginning."""

HTTP2_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
HTTP2_SETTINGS = 4


PIECE = 1 << 16


class PipedFile:
    """The file behind one stream, from its opening to its last byte.

    When the disk fills, rerun's own file writer dies with a line on the error stream, and
    waiting for it may then last for ever. Here it writes to a pipe, which never fails, and
    a thread copies the pipe to the file and keeps the first error.
    """

    def __init__(self, stream: rr.RecordingStream, path: Path) -> None:
        """Create the file, locked, and point the stream at it; OSError if it cannot be."""
        self._stream = stream
        self._lock = path.open("ab", buffering=0)
        if not take(self._lock.fileno()):
            self._lock.close()
            raise OSError(errno.EAGAIN, "another run is recording there")
        self._file = path.open("wb", buffering=0)
        self._error: OSError | None = None
        self._read, write = os.pipe()
        try:
            stream.save(f"/dev/fd/{write}")
        finally:
            os.close(write)
        self._copier = threading.Thread(target=self._copy, daemon=True)
        self._copier.start()

    def flush(self) -> None:
        """Hand over all that was logged; raise the OSError met so far, if any."""
        self._stream.flush()
        self._complain()

    def close(self) -> None:
        """Write the rest and close the file; raise the OSError met, if any."""
        self._stream.disconnect()
        self._copier.join()
        self._lock.close()
        self._complain()

    def _complain(self) -> None:
        if self._error is not None:
            raise self._error

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


class AbstractOutput(ABC):
    """One stream of a recording and the place it goes to."""

    stream: rr.RecordingStream

    @abstractmethod
    def open(self) -> None:
        """Reach the place; everything is logged after this."""

    @abstractmethod
    def flush(self) -> None:
        """Wait until all that was logged has arrived."""

    @abstractmethod
    def complete(self, rows: int) -> None:
        """Make the recording final; `rows` rows of columns were sent."""

    @abstractmethod
    def close(self, keep: bool) -> str:
        """Let go of the place; return what is kept of an unfinished recording."""


class _LiveOutput(AbstractOutput):
    """Another program that takes the recording as it goes on, called `place`."""

    place: str

    def flush(self) -> None:
        """Wait until it has everything."""
        try:
            self.stream.flush(timeout_sec=LIVE_TIMEOUT)
        except RuntimeError as error:
            raise OutputError(
                f"{self.place} no longer takes data ({_reason(error)}); start it again, or "
                "record to a file"
            ) from error

    def complete(self, rows: int) -> None:
        """Wait until it has everything; it goes on showing it."""
        self.flush()

    def close(self, keep: bool) -> str:
        """Let go of it."""
        self.stream.disconnect()
        return ""


def check_place(path: Path) -> None:
    """Raise `OutputError` unless a recording can be written there."""
    if path.suffix != ".rrd":
        raise OutputError(
            f"{path}: a recording must be named *.rrd, since the viewer goes by that ending"
        )
    check_file(path)


class FileOutput(AbstractOutput):
    """A file that appears under its own name only when it is whole."""

    def __init__(self, stream: rr.RecordingStream, path: Path) -> None:
        self.stream = stream
        self.path = path
        self.part = path.with_name(path.name + ".part")
        self._file: PipedFile | None = None

    def open(self) -> None:
        """Start the part file beside the file."""
        check_place(self.path)
        check_own(self.part, RRD)
        try:
            self._file = PipedFile(self.stream, self.part)
        except OSError as error:
            raise OutputError(
                f"cannot write {self.part}: {error.strerror}; choose a folder you may "
                "write to, on a disk with room"
            ) from error

    def flush(self) -> None:
        """Hand all that was logged to the file."""
        if self._file is not None:
            self._try(self._file.flush)

    def complete(self, rows: int) -> None:
        """Close the part file, read it back, and give it its name."""
        if self._file is None:
            return
        self._try(self._file.close)
        self._check(rows)
        self._file = None
        try:
            self.part.replace(self.path)
        except OSError as error:
            raise OutputError(
                f"cannot replace {self.path}: {error.strerror}; the whole recording is "
                f"in {self.part}"
            ) from error

    def close(self, keep: bool) -> str:
        """Close the part file of a run that stopped half-way; `keep` it or not."""
        if self._file is None:
            return ""
        if not keep:
            self._give_up()
            return ""
        self._try(self._file.close)
        self._file = None
        return f"what was recorded until then is in {self.part}"

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except OSError as error:
            self._give_up()
            raise OutputError(
                f"{self.path} could not be written whole: {error.strerror}; make room "
                "or choose another disk. The part written was removed"
            ) from error

    def _check(self, rows: int) -> None:
        try:
            chunks = RrdReader(self.part).stream()
            rows_read = sum(chunk.num_rows for chunk in chunks if not chunk.is_static)
        except Exception as error:  # the reader's exceptions have no common base
            self._give_up()
            raise OutputError(
                f"{self.path} was written but does not read back ({_reason(error)}); "
                "another program may be writing to it. The part file was removed"
            ) from error
        if rows_read != rows:
            self._give_up()
            raise OutputError(
                f"{self.path} was written, but only {rows_read} of {rows} rows read back; "
                "the disk may be full. The part file was removed"
            )

    def _give_up(self) -> None:
        """Remove the part file."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
            self._file = None
        self.part.unlink(missing_ok=True)


class ServedOutput(_LiveOutput):
    """A server on this computer that keeps the recording for viewers that come."""

    def __init__(self, stream: rr.RecordingStream, port: int) -> None:
        self.stream = stream
        self.port = port
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        self.place = f"the server on port {port}"

    def open(self) -> None:
        """Start to listen, on the loopback address only."""
        if self.port == 0:  # the system would choose one, which viewers do not know
            raise OutputError("cannot serve on port 0; choose one from 1 to 65535")
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", self.port))
            except (OSError, OverflowError) as error:
                raise OutputError(
                    f"cannot serve on port {self.port} ({_reason(error)}); choose "
                    "another port, or connect to the viewer that listens there"
                ) from error
        self.stream.set_sinks(rr.GrpcServerSink("127.0.0.1", self.port))


class NotebookOutput(AbstractOutput):
    """The page of a notebook; the recording is in it when it is whole."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self.stream = stream

    def open(self) -> None:
        """Check that notebooks can show recordings; data stay in memory until then."""
        if find_spec("rerun_notebook") is None:
            raise OutputError(
                "a notebook shows recordings by the package rerun-notebook, which is not "
                'installed; install it with: pip install "spherekit-mechanisms[notebook]", '
                "or write a file with save(path)"
            )

    def flush(self) -> None:
        """Nothing has to arrive before the end."""

    def complete(self, rows: int) -> None:
        """Hand the recording to the page, which empties it."""
        rr.notebook_show(recording=self.stream)

    def close(self, keep: bool) -> str:
        """Let go of the recording."""
        return ""


class ViewerOutput(_LiveOutput):
    """A viewer, or another server, that listens at a URL."""

    def __init__(self, stream: rr.RecordingStream, url: str) -> None:
        self.stream = stream
        self.url = url
        self.place = f"the viewer at {url}"
        self._address = ("", 0)

    def open(self) -> None:
        """Check that a viewer listens there, and connect."""
        try:
            parts = urlsplit(self.url)
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if not host or not port or not parts.scheme.startswith("rerun"):
            raise OutputError(
                f'"{self.url}" is not the address of a viewer; it looks like '
                "rerun+http://127.0.0.1:9876/proxy"
            )
        self._address = (host, port)
        if not _speaks_http2(*self._address):
            raise OutputError(
                f"no viewer listens at {self.url}; start one with `rerun --port {port}`"
                " or leave the recording in a file"
            )
        self.stream.set_sinks(rr.GrpcSink(self.url))

    def flush(self) -> None:
        """Wait until the viewer has everything."""
        if not _speaks_http2(*self._address):  # rerun would go on as if it were there
            raise OutputError(
                f"the viewer at {self.url} is gone; start it again, or record to a file"
            )
        super().flush()


def _speaks_http2(host: str, port: int) -> bool:
    """Return whether a server at this port answers as gRPC servers do.

    Rerun itself would wait for seconds, or for ever if something else listens there.
    """
    try:
        with socket.create_connection((host, port), timeout=PROBE_TIMEOUT) as probe:
            probe.settimeout(PROBE_TIMEOUT)
            probe.sendall(HTTP2_HELLO)
            answer = probe.recv(9)
    except OSError:
        return False
    return len(answer) > 3 and answer[3] == HTTP2_SETTINGS


def _reason(error: BaseException) -> str:
    """Return the innermost words of an error, in one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__
