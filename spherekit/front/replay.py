"""A recorder that keeps what a run tells it, for other recorders."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, final

from spherekit.analysis.scene import Floats, Scene

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from spherekit.analysis.running.recording import Recorder


@final
@dataclass
class Replay:
    """All that a run told, in its order."""

    _starts: list[tuple[Any, ...]] = field(default_factory=list)
    _blocks: list[tuple[Scene, Any, Floats | None, Floats | None]] = field(
        default_factory=list
    )

    def start(
        self,
        scenes: "Sequence[Scene]",
        inputs: Floats | None,
        *,
        assembly_modes: "Mapping[int, str] | None" = None,
        properties: "Mapping[str, str] | None" = None,
        focus: Floats | None = None,
        row: int | None = None,
        times: Floats | None = None,
    ) -> None:
        """Keep what does not move."""
        words: dict[str, Any] = {"assembly_modes": assembly_modes, "properties": properties}
        words |= {"focus": focus, "row": row, "times": times}
        self._starts.append((scenes, inputs, words))

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
        for scenes, inputs, words in self._starts:
            recorder.start(scenes, inputs, **words)
        for block in self._blocks:
            recorder.log(*block)
