from .rerun.recorder import RerunRecorder as RerunRecorder
from .rerun.screenshot import screenshot as screenshot
from .rerun.viewer import open_viewer as open_viewer
