"""A recorder that keeps the blocks of samples of a run, and joins them to scenes."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Axis, Page, Primitive, Scene, sample_rows

if TYPE_CHECKING:
    from spherekit.runs.recording_session import Recorder


class LoggedBlock(NamedTuple):
    """Drawings of some successive samples of a motion: the arguments of `Recorder.log`.

    A recorder is a viewer or file that receives the drawings of a run, block by block. A
    block belongs to one page of the recording. A page (tab of the viewer's window) shows
    one assembly mode (way to assemble the mechanism), or has a title of its own.

    Attributes
    ----------
    scene
        The objects that are visible in the block, and the page on which they are shown.
    samples
        (n,) numbers of the samples of the motion, from 0. Empty if the scene does not move.
    inputs
        Inputs (rad) of the mechanism at the samples, or None.
    times
        (n,) times (s) of the samples, or None.
    """

    scene: Scene
    samples: Any
    inputs: Floats | None
    times: Floats | None


@dataclass
class Collector:
    """A recorder that keeps the drawings of a run in memory.

    The recorder first receives a head, with the titles of the assembly modes and the scenes
    (drawings) that do not move. After the head the recorder receives blocks, each with the
    scene of some successive samples.

    Attributes
    ----------
    another
        Another recorder, which receives the same calls. Attributes that this object does
        not have, such as `finish`, are read from it.
    """

    another: "Recorder | None" = None
    _heads: list[RecordingHead] = field(default_factory=list)
    _blocks: list[LoggedBlock] = field(default_factory=list)

    def start(self, head: RecordingHead) -> None:
        """Keep the titles of the assembly modes, and the scenes that do not move."""
        self._heads.append(head)
        if self.another is not None:
            self.another.start(head)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the recorder `another`, such as its method `finish`.

        Python calls this method only for attributes that a `Collector` does not have.
        """
        return getattr(self.another, name)

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Keep one block of one page; the parameters are the fields of `LoggedBlock`."""
        block = LoggedBlock(scene, samples, inputs, times)
        self._blocks.append(block)
        if self.another is not None:
            self.another.log(*block)

    def play(self, recorder: "Recorder") -> None:
        """Pass all heads and blocks to another recorder, in their order."""
        for head in self._heads:
            recorder.start(head)
        for block in self._blocks:
            recorder.log(*block)

    @property
    def titles(self) -> dict[int, str]:
        """The titles of the assembly modes by their numbers."""
        title_by_mode: dict[int, str] = {}
        for head in self._heads:
            title_by_mode |= head.assembly_modes
        return title_by_mode

    def scenes(self) -> tuple[Scene, ...]:
        """Return the scenes (drawings of a page) in their order, with the blocks joined.

        Blocks of one analysis on one page are successive samples of one scene.
        """
        still_scenes = [scene for head in self._heads for scene in head.scenes]
        block_scenes = [block.scene for block in self._blocks]
        # Scenes by their analysis (`source`) and page.
        parts_by_page: dict[tuple[str, Page], list[Scene]] = {}
        for scene in [*still_scenes, *block_scenes]:
            parts_by_page.setdefault((scene.source, scene.page), []).append(scene)
        return tuple(_join_scenes(parts) for parts in parts_by_page.values())


def _join_scenes(parts: Sequence[Scene]) -> Scene:
    """Join the scenes of successive blocks of samples to one scene.

    A scene has primitives: objects that are drawn, such as arrows and plots. The same
    primitive in several blocks is recognised by its class and its address (`path`). The
    values of the primitive, one row for each sample, are joined. The values of the axes
    `scene.over` (quantities over which the scene is plotted) are joined in the same way.
    """
    primitive_parts: dict[tuple[type, str], list[Primitive]] = {}
    for scene in parts:
        for primitive in scene.primitives:
            key = type(primitive), primitive.path
            primitive_parts.setdefault(key, []).append(primitive)
    axes: list[Axis] = []
    for axis_parts in zip(*(scene.over for scene in parts), strict=True):
        values = np.concatenate([axis.values for axis in axis_parts])
        # The joined values cover the whole run, so the axis needs no range (`span`).
        axes.append(Axis(axis_parts[0].label, axis_parts[0].unit, values))
    primitives = tuple(map(_join_primitives, primitive_parts.values()))
    return Scene(parts[0].page, primitives, tuple(axes), parts[0].source)


def _join_primitives(parts: Sequence[Any]) -> Primitive:
    """Join one drawn object (primitive) in successive blocks of samples to one object.

    Attributes with one row for each sample are joined. Other attributes are taken from the
    first block.
    """
    first: Primitive = parts[0]
    joined_attributes: dict[str, Any] = {}
    for name, rows in sample_rows(first).items():
        blocks = [getattr(part, name) for part in parts]
        if isinstance(rows, np.ndarray):
            joined_attributes[name] = np.concatenate(blocks)
        else:
            joined_attributes[name] = list(chain(*blocks))
    return replace(first, **joined_attributes)
