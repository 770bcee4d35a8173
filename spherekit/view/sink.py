"""A file that rerun writes through a pipe of ours, so that a full disk is heard.

When the disk fills, rerun's own file writer dies with a line on the error stream, and
waiting for it may then last for ever. Here it writes to a pipe, which never fails, and
a thread copies the pipe to the file and keeps the first error.
"""

import errno
import os
import threading
from pathlib import Path
from typing import final

from spherekit.files.plain import take
from spherekit.view.sdk import rr

PIECE = 1 << 16


@final
class PipedFile:
    """The file behind one stream, from its opening to its last byte."""

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
