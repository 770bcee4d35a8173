"""The destinations of a recording: a file, a server of this process, a running viewer.

rerun itself loses data without an error if the disk is full or the viewer has ended. Here
every such loss raises an `OutputError`. If only a viewer is lost and a file remains, the
loss gives a warning instead.
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
from spherekit.display.rerun.viewer_program import RECORDING_HEADER
from spherekit.errors import OutputError
from spherekit.storage.atomic_write import (
    check_file,
    check_made_by_spherekit,
    output_error,
)
from spherekit.storage.file_lock import try_lock

LIVE_TIMEOUT_S = 30.0
"""Time within which a viewer has to take what was logged."""

PROBE_TIMEOUT_S = 2.0
"""Time within which a viewer has to answer when its address is checked."""

HTTP2_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
"""The preface of an HTTP/2 connection and an empty SETTINGS frame (RFC 9113, 3.4)."""

HTTP2_SETTINGS = b"\x04"
"""The type of the frame with which an HTTP/2 server answers."""

MAX_PORT = 65535
"""The largest number of a port."""

PIECE_BYTES = 1 << 16
"""Size (bytes) of the pieces in which a recording is copied to its file."""


def check_place(path: Path) -> None:
    """Raise `OutputError` unless a recording can be written there."""
    if path.suffix != ".rrd":
        raise OutputError(
            f"{path}: a recording must be named *.rrd, because the viewer recognises "
            "recordings by this ending"
        )
    check_file(path)


class FileOutput:
    """Writes a recording to a file, which gets its final name only when it is complete.

    The library rerun has a file writer of its own. If the disk is full, this writer only
    prints a line to the error stream, and waiting for it may last for ever. Here rerun
    therefore writes to a pipe, which never fails. A thread copies the pipe to
    ``NAME.rrd.part`` and stores the first error.

    Parameters
    ----------
    stream
        The stream to record.
    path
        The file, ``*.rrd``.
    """

    def __init__(self, stream: rr.RecordingStream, path: Path) -> None:
        """Choose the file; `open` creates it."""
        self.stream = stream
        self.path = path
        # `with_name` would raise an error for a path without a name, such as "" or "/".
        self.part = path.parent / (path.name + ".part")
        self._copier: threading.Thread | None = None  # only while the file is open
        self._error: OSError | None = None  # the first error of the copier

    def open(self) -> None:
        """Create and lock the file ``NAME.rrd.part``, and start the thread that fills it.

        The file has this name until the recording is complete. The library rerun writes
        into a pipe, and the thread copies the pipe to the file.

        Raises
        ------
        OutputError
            If the file cannot be written, or another run is recording to it.
        """
        check_place(self.path)
        check_made_by_spherekit(self.part, RECORDING_HEADER)
        try:
            self._lock_part()
            # This process has the lock, so no other run loses data when the file is
            # emptied.
            self._file = self.part.open("wb", buffering=0)
            self._connect_pipe()
        except OSError as error:
            raise output_error(self.part, "written", error) from error
        self._copier = threading.Thread(target=self._copy, daemon=True)
        self._copier.start()

    def _lock_part(self) -> None:
        """Create the part file of a recording if necessary, and lock it.

        The part file ``NAME.rrd.part`` has the recording until it is complete. The lock
        prevents two runs from writing to the same file. It belongs to a second file object,
        which writes nothing and stays open until the recording is complete. This object is
        opened for appending, so a run that gets no lock does not empty the file of another
        run.

        Raises
        ------
        OSError
            If another run has locked the file, or it cannot be opened.
        """
        self._lock = self.part.open("ab", buffering=0)
        if not try_lock(self._lock.fileno()):
            self._lock.close()
            raise OSError(
                errno.EAGAIN, "another run is recording there; choose another name"
            )

    def _connect_pipe(self) -> None:
        """Make the pipe through which rerun writes the recording.

        A thread of this object reads the pipe at one end. rerun opens the writing end once
        more, under a file number of its own. Therefore the first file number of the writing
        end is closed here. The pipe ends when rerun closes its own file number.
        """
        self._read, write_end = os.pipe()
        try:
            self.stream.save(f"/dev/fd/{write_end}")
        finally:
            os.close(write_end)

    def _copy(self) -> None:
        """Copy the recording from the pipe to ``NAME.rrd.part``, until the pipe ends.

        The method runs in a thread, while the library rerun writes the recording to the
        pipe. After an error the rest of the pipe is read and dropped, because rerun would
        wait for ever at a full pipe.
        """
        with os.fdopen(self._read, "rb", buffering=0) as pipe, self._file as file:
            while piece := pipe.read(PIECE_BYTES):
                if self._error is not None:
                    continue
                try:
                    unwritten = memoryview(piece)
                    while unwritten:  # one call may write only some of the bytes
                        unwritten = unwritten[file.write(unwritten) :]
                except OSError as error:
                    self._error = error

    def flush(self) -> None:
        """Write everything that was logged so far to the pipe.

        A thread copies the pipe to the file, possibly later.

        Raises
        ------
        OutputError
            If the thread could not write something that it has copied so far.
        """
        if self._copier is not None:
            self.stream.flush()
            self._raise_copy_error()

    def complete(self) -> None:
        """Complete the recording, and give the file its final name ``NAME.rrd``.

        During the recording the file is called ``NAME.rrd.part`` (the part file). Data that
        rerun has not yet written, and those still in the pipe, are written to it first.

        Raises
        ------
        OutputError
            If data could not be written, or the file cannot be renamed.
        """
        # Without a copying thread the file was never opened, or it is closed already.
        if self._copier is None:
            return
        # The lock lasts until the file has its final name. Otherwise another run could
        # empty the complete part file before it is renamed.
        with self._lock:
            self._finish_copy()
            self._raise_copy_error()
            try:
                self.part.replace(self.path)
            except OSError as error:
                if not self.part.exists():
                    raise OutputError(
                        f"{self.part} was deleted or renamed during the recording, so "
                        f"{self.path} could not be written; record again"
                    ) from error
                raise OutputError(
                    f"cannot replace {self.path}: {error.strerror}; the whole recording is "
                    f"in {self.part}"
                ) from error

    def close(self, keep: bool) -> str:
        """Close the part file of a recording that ends before it is complete.

        A thread (the copier) copies the recording to this file while it is open.

        Parameters
        ----------
        keep
            Whether the part file stays. If not, the part file is deleted.

        Returns
        -------
        A sentence that names the part file if it stays, otherwise an empty text.
        """
        # Without a thread the file was never opened, or it is closed already.
        if self._copier is None:
            return ""
        # This run has locked the part file. The lock ends only after the file is deleted.
        # Otherwise another run could begin to record in the file before it is deleted.
        with self._lock:
            self._finish_copy()
            # An error while writing matters only if the file stays.
            if keep:
                self._raise_copy_error()
                return f"the data recorded until then are in {self.part}"
            self.part.unlink(missing_ok=True)
        return ""

    def _finish_copy(self) -> None:
        """End the stream, copy the rest of the pipe to the part file, and close it.

        The part file stays locked; the caller ends the lock.
        """
        self.stream.disconnect()
        if self._copier is not None:
            self._copier.join()
            self._copier = None

    def _raise_copy_error(self) -> None:
        """Raise `OutputError` if the copying thread could not write to the disk.

        After such an error the incomplete file ``NAME.rrd.part`` is removed.
        """
        if self._error is not None:
            with self._lock:
                self._finish_copy()
                self.part.unlink(missing_ok=True)
            raise OutputError(
                f"{self.path} could not be written completely: {self._error.strerror}; "
                "free some space or choose another disk. The incomplete file was removed"
            ) from self._error


@dataclass
class LiveOutput:
    """Sends a recording to a running viewer during the run, or to a notebook at its end.

    The class has the same methods as a recording file (`FileOutput`), so that files and
    viewers can be used alike.

    Attributes
    ----------
    stream
        The stream of rerun into which the recording is logged.
    place
        Name of the program in messages.
    check
        Raises `OutputError` if the program cannot be reached. Its argument is true at the
        beginning of the recording, and false if an existing connection is checked.
    sink
        Returns the object by which rerun sends data to the program; None for a notebook.
    """

    stream: rr.RecordingStream
    place: str
    check: Callable[[bool], None]
    sink: Callable[[], Any] | None = None

    def open(self) -> None:
        """Connect to the program."""
        self.check(True)
        if self.sink is not None:
            self.stream.set_sinks(self.sink())

    def flush(self) -> None:
        """Wait until the program has received all that was logged."""
        if self.sink is None:
            return
        self.check(False)  # without it, rerun would drop data if the program has ended
        try:
            self.stream.flush(timeout_sec=LIVE_TIMEOUT_S)
        except RuntimeError as error:
            raise OutputError(
                f"{self.place} no longer accepts data ({_reason(error)}); start it again, "
                "or record to a file"
            ) from error

    def complete(self) -> None:
        """End a recording: wait until the program has all data, or show the notebook.

        A notebook (`sink` is None) gets the whole recording only now.
        """
        if self.sink is None:
            rr.notebook_show(recording=self.stream)
        self.flush()

    def close(self, keep: bool) -> str:
        """Disconnect from the program, and return an empty text.

        `keep` has no effect, since no file remains. `FileOutput.close` has the same
        parameter.
        """
        if self.sink is not None:
            self.stream.disconnect()
        return ""


Output = FileOutput | LiveOutput


def served(stream: rr.RecordingStream, port: int) -> LiveOutput:
    """Return an object that sends a recording to a server in this process.

    Viewers connect to the server, which stores the recording for them.

    Parameters
    ----------
    stream
        The stream of rerun into which the recording is logged.
    port
        Port of this computer on which viewers find the server.
    """

    def check(is_start: bool) -> None:
        """Raise `OutputError` if the server cannot start on its port.

        `is_start` is true when the recording begins, and false when the connection is
        checked later.
        """
        if not is_start:
            return  # the server runs in this process, so it is always reachable
        # For port 0 the system would choose a port that viewers do not know.
        if not 1 <= port <= MAX_PORT:
            raise OutputError(
                f"cannot serve on port {port}; choose one from 1 to {MAX_PORT}"
            )
        with socket.socket() as probe:
            # With this option, a port that another program has just left counts as free.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError as error:
                raise OutputError(
                    f"cannot serve on port {port} ({_reason(error)}); choose another port, "
                    "or connect to the viewer that listens there"
                ) from error

    place = f"the server on port {port}"
    return LiveOutput(stream, place, check, lambda: rr.GrpcServerSink("127.0.0.1", port))


def viewer_at(stream: rr.RecordingStream, url: str) -> LiveOutput:
    """Return an object that sends a recording to a viewer that already runs.

    A rerun server in another process can receive the recording in place of the viewer.

    Parameters
    ----------
    stream
        The stream of rerun into which the recording is logged.
    url
        Address of the viewer, such as ``rerun+http://127.0.0.1:9876/proxy``.
    """

    def check(is_start: bool) -> None:
        """Raise `OutputError` if the URL is not an address, or if no viewer answers there.

        `LiveOutput` calls this function when the recording begins, and later before it
        waits for the viewer. `is_start` is true at the beginning. Later a missing viewer
        has ended, so the message differs.
        """
        try:
            rr.GrpcSink(url)  # raises an error if the address is invalid; does not connect
            parts = urlsplit(url)
            host, port = parts.hostname, parts.port
        except (ValueError, RuntimeError):
            host, port = None, None
        if not host or not port:
            raise OutputError(
                f'"{url}" is not the address of a viewer; such an address looks like '
                "rerun+http://127.0.0.1:9876/proxy"
            )
        if not _speaks_http2(host, port):
            raise OutputError(
                f"no viewer listens at {url}; start one with `rerun --port {port}` or "
                "leave the recording in a file"
                if is_start
                else f"the viewer at {url} is gone; start it again, or record to a file"
            )

    return LiveOutput(stream, f"the viewer at {url}", check, lambda: rr.GrpcSink(url))


def check_notebook(is_start: bool) -> None:
    """Raise `OutputError` if notebooks cannot show recordings.

    `is_start` has no effect, but `LiveOutput` calls every check with this argument.
    """
    del is_start
    if find_spec("rerun_notebook") is None:
        raise OutputError(
            "to show a recording in a notebook, the package rerun-notebook is needed, "
            "which is not installed; install it with: pip install "
            '"spherekit-mechanisms[notebook]", or write a file with save(path)'
        )


def _speaks_http2(host: str, port: int) -> bool:
    """Return whether a server at a port speaks HTTP/2, as gRPC servers do.

    Without this check, rerun would wait for seconds, or for ever if another kind of server
    listens.
    """
    try:
        with socket.create_connection((host, port), timeout=PROBE_TIMEOUT_S) as probe:
            probe.sendall(HTTP2_HELLO)
            frame_header = probe.recv(9)
            return frame_header[3:4] == HTTP2_SETTINGS  # byte 3 is the type of the frame
    except (OSError, UnicodeError):  # the latter if no host can have such a name
        return False


def _reason(error: BaseException) -> str:
    """Return the last line of an error's message, or the name of its class."""
    return (str(error).strip() or type(error).__name__).splitlines()[-1].strip()


Still = tuple[str, rr.AsComponents]
"""Path below the path of an entity, and the data that are logged there once."""

ENTITY_ITSELF = ""
"""The path below the path of an entity at which data of the entity itself are logged."""

Stills = Iterator[Still]

Columns = Iterable[rr.ComponentColumn]
"""Columns of components, logged row by row."""


def below(path: str, suffix: str) -> str:
    """Return a path extended by a suffix; an empty suffix adds nothing."""
    return f"{path}/{suffix}" if suffix else path


class Outputs:
    """Several destinations of a recording (files, viewers) that all get the same data.

    Attributes
    ----------
    destinations
        The destinations.
    entities
        Paths at which anything was logged.
    known_paths
        Paths at which `log_first` has logged something.
    rows
        Number of rows logged, of all entities together.
    """

    def __init__(self, destinations: Iterable[Output]) -> None:
        """Begin with nothing logged; `open` connects the destinations."""
        self.destinations = list(destinations)
        self.entities: set[str] = set()
        self.known_paths: set[str] = set()
        self.rows = 0

    @property
    def live(self) -> list[Output]:
        """The destinations that may show the recording while it is made."""
        return [item for item in self.destinations if not isinstance(item, FileOutput)]

    def cost(self, is_finished: bool) -> dict[str, int]:
        """Return the number of entities and rows, and the bytes of a finished file."""
        file_bytes = 0
        if is_finished:
            for destination in self.destinations:
                if isinstance(destination, FileOutput):
                    file_bytes += destination.path.stat().st_size
        return {"entities": len(self.entities), "rows": self.rows, "bytes": file_bytes}

    def open(self) -> None:
        """Open all destinations; if one fails, close the destinations that are open."""
        with ExitStack() as stack:
            for destination in self.destinations:
                destination.open()
                stack.callback(destination.close, keep=False)
            stack.pop_all()  # all are open, so none is closed at the end of the block

    def close(self, error: BaseException | None) -> None:
        """Close all destinations.

        Parameters
        ----------
        error
            The error that ended the recording, if any. The error gets a note on the file
            that remains with a part of the recording. Without rows (samples) no file
            remains.
        """
        for destination in self.destinations:
            kept_note = destination.close(keep=self.rows > 0)
            if kept_note and error is not None:
                error.add_note(kept_note)

    def send_name(self, name: str, properties: Mapping[str, Any]) -> None:
        """Send the name of the recording and the properties of the run."""
        for destination in self.destinations:
            destination.stream.send_recording_name(name)
            if properties:
                destination.stream.send_property("run", rr.AnyValues(False, **properties))

    def log_first(self, path: str, stills: Iterable[Still]) -> bool:
        """Log static data when a path occurs for the first time; return whether it does."""
        is_new = path not in self.known_paths
        if is_new:
            self.known_paths.add(path)
            self.log_static(path, stills)
        return is_new

    def log_static(
        self,
        path: str,
        stills: Iterable[Still],
        destinations: Sequence[Output] | None = None,
    ) -> None:
        """Write data that are valid at all times of a recording to its destinations.

        Parameters
        ----------
        path
            Path in the recording, below which the data are stored.
        stills
            The data, each with its path below `path`.
        destinations
            The destinations (files and viewers) that get the data. By default all.
        """
        for suffix, archetype in stills:
            entity = below(path, suffix)
            self.entities.add(entity)
            for destination in self.destinations if destinations is None else destinations:
                destination.stream.log(entity, archetype, static=True)

    def log_rows(
        self,
        path: str,
        timelines: Sequence[rr.TimeColumn],
        columns: Columns,
        row_count: int,
    ) -> None:
        """Write one block of rows (samples) to all destinations of a recording.

        Destinations are files and viewers.

        Parameters
        ----------
        path
            Path of the entity (thing that is drawn) in the recording.
        timelines
            Positions of the rows on the timelines of the viewer, such as time.
        columns
            Components of the entity, such as positions and labels, for all rows.
        row_count
            Number of rows.
        """
        if row_count == 0:
            return
        columns = list(columns)  # an iterator could be read for one destination only
        for destination in self.destinations:
            destination.stream.send_columns(path, timelines, columns)
        self.entities.add(path)
        self.rows += row_count

    def for_each(self, action: Callable[[Output], None]) -> None:
        """Call a function with each destination (file or viewer) of the recording.

        If a viewer no longer answers, but there is also a file, the viewer is removed with
        a warning. Any other error is raised.
        """
        for destination in tuple(self.destinations):  # a copy: the loop may remove some
            try:
                action(destination)
            except OutputError as error:
                has_file = any(isinstance(item, FileOutput) for item in self.destinations)
                if isinstance(destination, FileOutput) or not has_file:
                    raise
                warnings.warn(f"{error}; the recording in the file continues", stacklevel=3)
                self.destinations.remove(destination)
                destination.close(keep=False)
