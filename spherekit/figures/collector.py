"""A recorder that keeps the scenes of a run, its blocks put together again."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np

from spherekit.analysis.recording_head import RecordingHead
from spherekit.analysis.scene import (
    Arrow,
    Axis,
    Body,
    Diagram,
    Floats,
    GreatCircle,
    Page,
    Portrait,
    Primitive,
    Scene,
    Series,
    Trace,
)


@final
@dataclass
class Collector:
    """What a run tells a recorder, as whole scenes in the order in which they came.

    `titles` are the names of the assembly modes by their numbers.
    """

    titles: dict[int, str] = field(default_factory=dict)
    _blocks: dict[tuple[str, Page], list[Scene]] = field(default_factory=dict)

    def start(self, head: RecordingHead) -> None:
        """Take the names of the assembly modes, and what does not move."""
        self.titles = dict(head.assembly_modes)
        for scene in head.scenes:
            self._blocks.setdefault((scene.source, scene.page), []).append(scene)

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Take one block of one page."""
        del samples, inputs, times
        self._blocks.setdefault((scene.source, scene.page), []).append(scene)

    def scenes(self) -> tuple[Scene, ...]:
        """Return the scenes, each of all its blocks."""
        return tuple(_joined(blocks) for blocks in self._blocks.values())


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
    if len(parts) == 1:
        return first

    def rows(name: str) -> Floats:
        return np.concatenate([getattr(part, name) for part in parts])

    match first:
        case Series():
            return replace(first, values=rows("values"))
        case Arrow():
            return replace(first, directions=rows("directions"))
        case Trace(quaternions=turned):
            whole = None if turned is None else rows("quaternions")
            return replace(first, directions=rows("directions"), quaternions=whole)
        case GreatCircle():
            return replace(first, normals=rows("normals"))
        case Body(quaternions=turned) if turned is not None:
            return replace(first, quaternions=rows("quaternions"))
        case Portrait():
            return replace(first, x=rows("x"), y=rows("y"))
        case Diagram():
            words = [word for part in parts for word in part.words]
            return replace(
                first,
                places=rows("places"),
                lines=rows("lines"),
                words=words,
                readings=None if first.readings is None else rows("readings"),
            )
        case _:
            return first
