"""Recordings for the rerun viewer, and pictures of them.

`RerunRecorder` takes the scenes of a run, as in ``spherekit.run(..., recorder=recorder)``.
A recording begins with a `RecordingHead`. `open_viewer` shows a recording, and `screenshot`
takes a picture of it. No other package of spherekit imports the rerun SDK.
"""

import lazy_loader

from spherekit.scenes.recording_head import RecordingHead as RecordingHead

# The other names load the rerun SDK when they are first read; see __init__.pyi.
__getattr__, _, _lazy_names = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted([*_lazy_names, "RecordingHead"])


def __dir__() -> list[str]:
    return __all__
