"""A recording in a web browser: the viewer's web build, served on this computer."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from spherekit.errors import OutputError
from spherekit.view.viewer import has_display

HOST = "127.0.0.1"
START_WITHIN = 30.0
"""Seconds in which the server has to answer."""


def serve_web(recording: Path | str, say: Callable[[str], None]) -> None:
    """Serve a recording on this computer until Ctrl-C, and open it in a browser.

    `say` is told the address. Without a display no browser is opened.

    Raises
    ------
    OutputError
        If there is no such recording, or the server does not start.
    """
    with served(recording) as url, suppress(KeyboardInterrupt):
        say(url)
        if has_display():
            webbrowser.open(url)
        while True:
            time.sleep(3600.0)


@contextmanager
def served(recording: Path | str) -> Iterator[str]:
    """Serve a recording within the context, and give the address of its page."""
    path = Path(recording)
    if not path.is_file():
        raise OutputError(f"{path}: no such recording")
    page, data = _free_ports()
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "rerun_cli", str(path.resolve()), "--serve-web"),
            *("--bind", HOST, "--web-viewer-port", str(page), "--port", str(data)),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=os.name == "posix",
        env={**os.environ, "CI": "true"},  # keeps the viewer from reporting home
    )
    try:
        _wait_for(f"http://{HOST}:{page}/", process)
        source = quote(f"rerun+http://{HOST}:{data}/proxy", safe="")
        yield f"http://{HOST}:{page}?url={source}"
    finally:
        _stop(process)


def _free_ports() -> tuple[int, int]:
    """Return two ports of this computer that nobody listens on."""
    with socket.socket() as first, socket.socket() as second:
        first.bind((HOST, 0))
        second.bind((HOST, 0))
        return first.getsockname()[1], second.getsockname()[1]


def _wait_for(url: str, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + START_WITHIN
    while process.poll() is None and time.monotonic() < end:
        try:
            with urllib.request.urlopen(url, timeout=2.0):
                return
        except (urllib.error.URLError, OSError):
            time.sleep(0.1)
    raise OutputError(
        f"the viewer's web page did not answer at {url}; `spherekit view X.rrd` opens a "
        "window, with --png it takes a picture"
    )


def _stop(process: subprocess.Popen[bytes]) -> None:
    """End the server and what it started."""
    if os.name == "posix" and process.poll() is None:
        os.killpg(process.pid, signal.SIGTERM)
    else:
        process.terminate()
    try:
        process.wait(timeout=10.0)
    except subprocess.TimeoutExpired:
        process.kill()
