"""Runs the viewer of the installed package rerun-sdk as a separate program."""

import os
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from spherekit.conventions import AnyPath
from spherekit.errors import OutputError

HOST = "127.0.0.1"
"""The address of this computer; nothing is served to others."""

START_TIMEOUT_S = 30.0
"""Time within which the viewer has to answer after its start."""

RECORDING_HEADER = b"RRF"
"""The first bytes of a recording."""


def recording_at(file: AnyPath) -> Path:
    """Return the path of a file after checking that it is a recording of the viewer.

    Raises
    ------
    OutputError
        If the file cannot be read, is not named ``*.rrd``, or does not begin as a recording
        does.
    """
    path = Path(file)
    hint = "make a recording with: spherekit run FILE --save X.rrd"
    try:
        if path.is_fifo() or path.is_char_device():  # reading could wait for ever
            raise ValueError("it is a pipe or a device")
        with path.open("rb") as stream:
            start = stream.read(len(RECORDING_HEADER))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{path}: cannot be read: {reason}; {hint}") from None
    if start != RECORDING_HEADER:
        raise OutputError(f"{path}: this is not a recording; {hint}")
    if path.suffix.lower() != ".rrd":
        raise OutputError(
            f"{path}: name the recording *.rrd, because the viewer recognises recordings "
            "by this ending"
        )
    return path


def free_ports(count: int) -> list[int]:
    """Return different ports of this computer on which no program listens."""
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind((HOST, 0))
        return [probe.getsockname()[1] for probe in probes]


@contextmanager
def run_viewer(
    *words: str, messages: Any = subprocess.DEVNULL
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer as a separate program for the duration of a `with` block.

    The value of the block is the process of the viewer, which is killed at the end.

    Parameters
    ----------
    words
        Arguments of the program.
    messages
        A file for the error stream of the program.

    Raises
    ------
    OutputError
        If the viewer is not installed.
    """
    spec = find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise OutputError("the viewer is missing; install the package rerun-sdk")

    binary = Path(spec.origin).parent / ("rerun.exe" if os.name == "nt" else "rerun")
    environment = os.environ | {
        # The viewer is told that another program runs it, so it asks the user no questions.
        "RERUN_APP_ONLY": "true",
        # Log messages would appear in pictures, so only errors are logged.
        "RUST_LOG": "error",
        # With CI set, the viewer sends no statistics to its makers.
        "CI": "true",
    }
    process = subprocess.Popen(
        [str(binary), *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=messages,
        env=environment,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def wait_for_port(process: subprocess.Popen[bytes], port: int) -> bool:
    """Wait until a program listens at a port of this computer; return whether it listens.

    The result is False if the program ends, or if `START_TIMEOUT_S` is over.
    """
    deadline = time.monotonic() + START_TIMEOUT_S
    while process.poll() is None and time.monotonic() < deadline:
        try:  # a connection succeeds only if the program listens
            socket.create_connection((HOST, port), timeout=1.0).close()
        except OSError:
            time.sleep(0.05)
        else:
            return True
    return False
