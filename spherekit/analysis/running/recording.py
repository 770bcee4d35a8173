"""What of a run goes to a recorder: the scenes of every sample, or of every k-th."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from spherekit.analysis.link_scenes import (
    graph_scene,
    link_shapes,
    motion_scenes,
    static_scene,
)
from spherekit.analysis.result import MOTION
from spherekit.analysis.running.sampling import Sampling
from spherekit.analysis.scene import Axis, Portrait, RecordingHead, Scene
from spherekit.arrays import Bools, Floats, Integers
from spherekit.files.write import mechanism_hash
from spherekit.motion.motion import Motion
from spherekit.planning.poles import Plan
from spherekit.version import __version__

MOST_LOGGED = 20_000
"""Samples of an assembly mode that go to a recording unless more are asked for.

With all its poles a four-bar then takes 31 MB.
"""


class Recorder(Protocol):
    """What a run tells a viewer while it goes on; see `spherekit.view`.

    One that counts has a `finish`, which makes the recording whole, and then its `cost`:
    entities and rows logged, and bytes of the file.
    """

    def start(self, head: RecordingHead) -> None:
        """Take what is known before the first block."""

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Take one block of one mode: sample numbers (k,), inputs (k,) rad, times s.

        What stands still, and is known after the start only, has no samples.
        """


class RecordingSession:
    """Tells a recorder of a run: what stands still at once, what moves block by block.

    One of `every` so many samples is logged along rows of neighbours, and a path's last.
    """

    def __init__(
        self,
        course: Sampling,
        plans: Sequence[Plan],
        analyses: Sequence[str],
        recorder: Recorder,
        every: int | None,
        first: int,
    ) -> None:
        """Start the recording of samples from `first` on."""
        mechanism, is_grid = course.tracer.mechanism, len(course.shape) > 1
        self._recorder, self._course, self._first = recorder, course, first
        self._every = every or -(-course.total // MOST_LOGGED)
        self._row = course.shape[-1] if is_grid else None
        self._shapes = link_shapes(mechanism)
        self._seen, self._logged_to = first, 0
        self._held: list[tuple[Portrait, Scene, Motion]] = []
        self._has_graph = False
        logged = np.flatnonzero(self._is_logged(np.arange(course.total)))
        inputs, times = course.inputs, course.every_t
        single = inputs.shape[1] == 1 and times is None
        self._inputs = inputs[logged, 0] if single else None
        self._times = None if times is None else times[logged]
        properties = {
            "spherekit": __version__,
            "mechanism_hash": mechanism_hash(mechanism),
            "analyses": ", ".join(analyses),
        }
        if self._every > 1:
            properties["logged"] = f"one of {self._every} successive samples"
        if first:
            properties["resumed"] = f"samples before {first} are not in this recording"
        row = None if self._row is None else -(-self._row // self._every)
        recorder.start(
            RecordingHead(
                [static_scene(plans, self._shapes)],
                self._inputs,
                course.titles,
                properties,
                course.middle,
                row,
                self._times,
            )
        )

    def goes_on(self, course: Sampling, again: bool) -> None:
        """Go on with a course that is known further; `again` from its first sample.

        Otherwise samples that were logged stay, also where another run solves them.
        """
        self._course = course
        self._logged_to = 0 if again else self._seen
        if again:
            self._held.clear()

    def finish(self) -> None:
        """Log the portraits that waited for the extent of the whole motion."""
        ranges: dict[tuple[object, str], list[Floats]] = {}
        for portrait, scene, _ in self._held:
            span = np.array([portrait.x_range, portrait.y_range])
            ranges.setdefault((scene.page, portrait.path), []).append(span)
        for portrait, scene, motion in self._held:
            spans = np.array(ranges[scene.page, portrait.path])
            low, high = np.min(spans[:, :, 0], axis=0), np.max(spans[:, :, 1], axis=0)
            x_range, y_range = zip(low.tolist(), high.tolist(), strict=True)
            whole = replace(portrait, x_range=x_range, y_range=y_range)
            self._log([replace(scene, primitives=(whole,))], motion, scene.source)
        self._held.clear()

    def summary(self) -> dict[str, int]:
        """Return what the recording leaves out."""
        return {"one_of": self._every, "from_sample": self._first}

    def motion(self, motion: Motion) -> None:
        """Log the links of a block."""
        chosen = self._chosen(motion)
        self._seen = max(self._seen, int(motion.sample[-1]) + 1)
        shown = chosen[: motion.samples]
        if not np.any(shown):
            return
        if not np.all(shown):
            motion = replace(motion.rows(chosen), samples=int(np.sum(shown)))
        self._log(motion_scenes(motion, self._shapes, self._course.timed), motion, MOTION)
        if not self._has_graph:  # after the first rows, which should not wait for it
            self._has_graph = True
            still = replace(motion, samples=0)
            self._log_block(graph_scene(motion.mechanism), still, MOTION)

    def scenes(self, scenes: Sequence[Scene], motion: Motion, source: str) -> None:
        """Log what an analysis of this name shows of a block."""
        chosen = self._chosen(motion)
        shown = chosen[: motion.samples]
        if not np.all(shown):
            motion = replace(motion.rows(chosen), samples=int(np.sum(shown)))
            scenes = [scene.thinned(shown) for scene in scenes]
        if self._course.going_on or self._held:
            self._held += [
                (primitive, replace(scene, source=source), motion)
                for scene in scenes
                for primitive in scene.primitives
                if isinstance(primitive, Portrait) and not scene.over
            ]
            scenes = [
                scene
                if scene.over
                else replace(
                    scene,
                    primitives=tuple(
                        x for x in scene.primitives if not isinstance(x, Portrait)
                    ),
                )
                for scene in scenes
            ]
        self._log(scenes, motion, source)

    def _chosen(self, motion: Motion) -> Bools:
        """Return (n,) which rows of a block are logged."""
        fresh = motion.sample >= self._logged_to
        return self._is_logged(motion.sample) & fresh

    def _is_logged(self, sample: Integers) -> Bools:
        """Return (n,) whether samples (n,) are logged."""
        last = (sample == self._course.total - 1) & (self._row is None)
        return (sample % (self._row or self._course.total) % self._every == 0) | last

    def _log(self, scenes: Sequence[Scene], motion: Motion, source: str) -> None:
        for scene in scenes:
            if not scene.over:
                if motion.samples:
                    self._log_block(scene, motion, source)
                continue
            count = len(scene.over[0].values)
            spread = (
                None if line is None else np.linspace(line[0], line[-1], count + 1)[:-1]
                for line in (self._inputs, self._times)
            )
            self._recorder.log(replace(scene, source=source), np.arange(count), *spread)

    def _log_block(self, scene: Scene, motion: Motion, source: str) -> None:
        k, timing = motion.samples, motion.timing
        inputs = (
            motion.q[:k]
            if (motion.inputs.shape[1] == 1 and not self._course.timed)
            else None
        )
        times = timing.t[:k] if timing is not None and self._course.timed else None
        shown = replace(scene, over=self._axes(motion), source=source)
        self._recorder.log(shown, motion.sample[:k], inputs, times)

    def _axes(self, motion: Motion) -> tuple[Axis, ...]:
        """Return what the samples of a block run over: the time, or each input."""
        k = motion.samples
        if self._times is not None and motion.timing is not None:
            span = float(self._times[0]), float(self._times[-1])
            return (Axis("time", "s", motion.timing.t[:k], span),)
        names = motion.mechanism.input_pairs
        label = "input {}" if len(names) == 1 else "{}"
        return tuple(
            Axis(label.format(name), "rad", values, (float(low), float(high)))
            for name, values, (low, high) in zip(
                names, motion.inputs[:k].T, self._course.extents[0].T, strict=True
            )
        )
