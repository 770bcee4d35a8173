"""A recording in a web browser: the web build of the viewer, served on this computer."""

import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

from spherekit.display.rerun.viewer import has_display
from spherekit.display.rerun.viewer_program import (
    HOST,
    free_ports,
    listens,
    program,
    recording_at,
)
from spherekit.errors import OutputError


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
    path = recording_at(recording)
    page, data = free_ports(2)
    ports = "--web-viewer-port", str(page), "--port", str(data)
    with program(str(path.resolve()), "--serve-web", "--bind", HOST, *ports) as process:
        if not listens(process, page):
            raise OutputError(
                f"the viewer's web page did not answer at http://{HOST}:{page}/; "
                "`spherekit view X.rrd` opens a window, with --png it takes a picture"
            )
        source = quote(f"rerun+http://{HOST}:{data}/proxy", safe="")
        yield f"http://{HOST}:{page}?url={source}"
