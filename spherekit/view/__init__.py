"""Recordings for the rerun viewer, and pictures of them; only here is it known.

`RerunRecorder` takes a run's scenes, as in ``spherekit.run(..., recorder=recorder)``, which
begin with a `RecordingHead`;
`open_viewer` shows a recording, `screenshot` takes a picture of it.
"""

from typing import TYPE_CHECKING

from spherekit.lazy_imports import offered as _offered

if TYPE_CHECKING:
    from spherekit.analysis.scene import RecordingHead as RecordingHead
    from spherekit.view.pictures import screenshot as screenshot
    from spherekit.view.rerun_view import RerunRecorder as RerunRecorder
    from spherekit.view.viewer import open_viewer as open_viewer

__all__, __getattr__, __dir__ = _offered(__name__, __file__)
