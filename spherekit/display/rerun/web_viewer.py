"""Shows a recording in a web browser, with the web viewer served on this computer."""

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
    recording_at,
    run_viewer,
    wait_for_port,
)
from spherekit.errors import OutputError


def serve_web(recording: Path | str, announce: Callable[[str], None]) -> None:
    """Serve a recording on this computer until Ctrl-C, and open it in a browser.

    Parameters
    ----------
    recording
        Path of the recording.
    announce
        Function that is called with the address of the page.

    Raises
    ------
    OutputError
        If there is no such recording, or the server does not start.
    """
    with served(recording) as url, suppress(KeyboardInterrupt):
        announce(url)
        if has_display():
            webbrowser.open(url)
        while True:
            time.sleep(3600.0)  # Ctrl-C ends the wait


@contextmanager
def served(recording: Path | str) -> Iterator[str]:
    """Serve a recording to web browsers for the duration of a `with` block.

    One program serves the page with the viewer at one port, and the data of the recording
    at a second port. The value of the block is the address of the page.
    """
    path = recording_at(recording)
    page_port, data_port = free_ports(2)
    words = [str(path.resolve()), "--serve-web", "--bind", HOST]
    words += ["--web-viewer-port", str(page_port), "--port", str(data_port)]
    with run_viewer(*words) as process:
        if not wait_for_port(process, page_port):
            raise OutputError(
                f"the viewer's web page did not answer at http://{HOST}:{page_port}/; "
                "use `spherekit view X.rrd` to open a window, with --png to save a picture"
            )
        # The page fetches the recording from the address in `url`.
        source = quote(f"rerun+http://{HOST}:{data_port}/proxy", safe="")
        yield f"http://{HOST}:{page_port}?url={source}"
