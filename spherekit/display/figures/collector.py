"""A recorder that keeps the scenes of a run, its blocks put together again."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Axis, Page, Primitive, Scene, sample_rows

if TYPE_CHECKING:
    from spherekit.runs.recording_session import Recorder


@dataclass
class Collector:
    """A recorder that keeps all that a run tells it, for others and as whole scenes.

    What it is told `another` is told too, whose further attributes it has.
    """

    another: "Recorder | None" = None
    _heads: list[RecordingHead] = field(default_factory=list)
    _told: list[tuple[Scene, Any, Floats | None, Floats | None]] = field(
        default_factory=list
    )

    def start(self, head: RecordingHead) -> None:
        """Take the names of the assembly modes, and what does not move."""
        self._heads.append(head)
        if self.another is not None:
            self.another.start(head)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.another, name)

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Take one block of one page."""
        self._told.append((scene, samples, inputs, times))
        if self.another is not None:
            self.another.log(*self._told[-1])

    def play(self, recorder: "Recorder") -> None:
        """Tell another recorder the same."""
        for head in self._heads:
            recorder.start(head)
        for block in self._told:
            recorder.log(*block)

    @property
    def titles(self) -> dict[int, str]:
        """The names of the assembly modes by their numbers."""
        return {
            n: title for head in self._heads for n, title in head.assembly_modes.items()
        }

    def scenes(self) -> tuple[Scene, ...]:
        """Return the scenes in the order in which they came, each of all its blocks."""
        blocks: dict[tuple[str, Page], list[Scene]] = {}
        still = [scene for head in self._heads for scene in head.scenes]
        for scene in [*still, *(block[0] for block in self._told)]:
            blocks.setdefault((scene.source, scene.page), []).append(scene)
        return tuple(map(_joined, blocks.values()))


def _joined(blocks: Sequence[Scene]) -> Scene:
    """Return one scene of successive blocks."""
    parts: dict[tuple[type, str], list[Primitive]] = {}
    for scene in blocks:
        for primitive in scene.primitives:
            parts.setdefault((type(primitive), primitive.path), []).append(primitive)
    over = tuple(
        Axis(axes[0].label, axes[0].unit, np.concatenate([axis.values for axis in axes]))
        for axes in zip(*(scene.over for scene in blocks), strict=True)
    )
    primitives = tuple(_whole(pieces) for pieces in parts.values())
    return Scene(blocks[0].page, primitives, over, blocks[0].source)


def _whole(parts: Sequence[Any]) -> Primitive:
    """Return one primitive of those of successive blocks."""
    first: Primitive = parts[0]
    whole: dict[str, Any] = {}
    for name, rows in sample_rows(first).items():
        blocks = [getattr(part, name) for part in parts]
        is_array = isinstance(rows, np.ndarray)
        whole[name] = np.concatenate(blocks) if is_array else list(chain(*blocks))
    return replace(first, **whole)
