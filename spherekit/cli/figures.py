"""`--figures`: what a run shows, drawn into its folder."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

from spherekit.analysis.recording_head import RecordingHead
from spherekit.analysis.scene import Floats, Scene
from spherekit.conventions import counted
from spherekit.figures.collector import Collector
from spherekit.figures.contents import figures_of
from spherekit.figures.write import FigureFormat, write_figures

FOLDER = "figures"


@final
@dataclass
class FigureDrawer:
    """What keeps the scenes of a run, beside another recorder if there is one."""

    beside: Any
    _collector: Collector = field(default_factory=Collector)

    @property
    def recorder(self) -> Any:
        """What the run tells its scenes."""
        return (
            self._collector if self.beside is None else Both(self._collector, self.beside)
        )

    def write(self, folder: Path, kind: FigureFormat, quiet: bool) -> None:
        """Draw all figures into a folder of the run's folder."""
        figures = figures_of(self._collector.scenes(), self._collector.titles)
        paths = write_figures(figures, folder / FOLDER, kind)
        if not quiet:
            print(f"{counted(len(paths), 'figure')} in {folder / FOLDER}", file=sys.stderr)


@final
@dataclass(frozen=True)
class Both:
    """Two recorders that are told the same; the second says what it holds."""

    first: Any
    second: Any

    def start(self, head: RecordingHead) -> None:
        """Pass on the beginning of a run."""
        for recorder in (self.first, self.second):
            recorder.start(head)

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Pass on a block."""
        for recorder in (self.first, self.second):
            recorder.log(scene, samples, inputs, times)

    def finish(self) -> None:
        """Make the recording of the second whole."""
        self.second.finish()

    @property
    def cost(self) -> Any:
        """What the second holds."""
        return self.second.cost
