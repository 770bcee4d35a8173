"""Opens a recording in a window of the viewer."""

import os
import subprocess
import sys
from pathlib import Path

from spherekit.argument_validation import checked
from spherekit.display.rerun.viewer_program import recording_at
from spherekit.errors import OutputError


@checked(OutputError)
def open_viewer(recording: Path | str) -> str:
    """Open a recording in a window of the viewer, which stays open when this process ends.

    Returns
    -------
    str
        Empty if a window was opened. Without a display, advice on how to see the recording.

    Raises
    ------
    OutputError
        If there is no such recording.
    """
    path = recording_at(recording)
    if not has_display():
        return (
            f"no display here: make a picture with `spherekit view {path} --png X.png`, "
            f"or copy {path} to a machine with one and run `spherekit view` there"
        )
    subprocess.Popen(
        [sys.executable, "-m", "rerun_cli", str(path.resolve())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "CI": "true"},  # keeps the viewer from reporting home
    )
    return ""


def has_display() -> bool:
    """Return whether this computer has a display for windows."""
    displays = map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
    return sys.platform in ("win32", "darwin") or any(displays)
