"""Recordings for the rerun viewer, and pictures of them; only here is it known.

`RerunRecorder` takes a run's scenes, as in ``spherekit.run(..., recorder=recorder)``, which
begin with a `RecordingHead`;
`open_viewer` shows a recording, `screenshot` takes a picture of it.
"""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered

if TYPE_CHECKING:
    from spherekit.display.rerun.recorder import RerunRecorder as RerunRecorder
    from spherekit.display.rerun.screenshot import screenshot as screenshot
    from spherekit.display.rerun.viewer import open_viewer as open_viewer
    from spherekit.scenes.recording_head import RecordingHead as RecordingHead

__all__, __getattr__, __dir__ = _offered(__name__, __file__)
