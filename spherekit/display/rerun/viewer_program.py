"""The viewer of the installed package as a program of its own, for a while."""

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
START_WITHIN = 30.0
"""Seconds in which the viewer has to answer."""


RRD = b"RRF"
"""What a recording has at its beginning."""


def recording_at(given: AnyPath) -> Path:
    """Return the path of a recording; `OutputError` if there is none."""
    path, make = Path(given), "make one: run FILE --save X.rrd"
    try:
        with path.open("rb") as stream:
            start = stream.read(len(RRD))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"{path}: cannot be read: {reason}; {make}") from None
    if start != RRD:
        raise OutputError(f"{path}: is not a recording; {make}")
    return path


def free_ports(count: int) -> list[int]:
    """Return so many ports of this computer that nobody listens on."""
    with ExitStack() as opened:
        probes = [opened.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind((HOST, 0))
        return [probe.getsockname()[1] for probe in probes]


@contextmanager
def program(
    *words: str, messages: Any = subprocess.DEVNULL
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer, whatever the PATH, until the block is left; it says `messages`."""
    spec = find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise OutputError("the viewer is missing; install the package rerun-sdk")
    binary = Path(spec.origin).parent / ("rerun.exe" if os.name == "nt" else "rerun")
    # Silent, since log messages would appear in pictures; panics are still heard.
    # CI keeps it from reporting home.
    process = subprocess.Popen(
        [str(binary), *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=messages,
        env=os.environ | {"RERUN_APP_ONLY": "true", "RUST_LOG": "error", "CI": "true"},
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def listens(process: subprocess.Popen[bytes], port: int) -> bool:
    """Wait until a program listens at a port; return whether it does."""
    deadline = time.monotonic() + START_WITHIN
    while process.poll() is None and time.monotonic() < deadline:
        try:
            socket.create_connection((HOST, port), timeout=1.0).close()
        except OSError:
            time.sleep(0.05)
        else:
            return True
    return False
