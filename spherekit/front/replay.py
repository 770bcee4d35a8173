"""A recorder that keeps what a run tells it, for other recorders."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, final

from spherekit.analysis.scene import Floats, Scene

if TYPE_CHECKING:
    from spherekit.analysis.recording_head import RecordingHead
    from spherekit.analysis.running.recording import Recorder


@final
@dataclass
class Replay:
    """All that a run told, in its order."""

    _heads: "list[RecordingHead]" = field(default_factory=list)
    _blocks: list[tuple[Scene, Any, Floats | None, Floats | None]] = field(
        default_factory=list
    )

    def start(self, head: "RecordingHead") -> None:
        """Keep what does not move."""
        self._heads.append(head)

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Keep one block of one page."""
        self._blocks.append((scene, samples, inputs, times))

    def play(self, recorder: "Recorder") -> None:
        """Tell a recorder the same."""
        for head in self._heads:
            recorder.start(head)
        for block in self._blocks:
            recorder.log(*block)
