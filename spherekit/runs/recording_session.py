"""What of a run goes to a recorder: the scenes of every sample, or of every k-th."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from spherekit.arrays import Bools, Floats, Integers
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.planning.pole_plan import Plan
from spherekit.positions.motion import Motion
from spherekit.runs.run_result import MOTION
from spherekit.runs.sampling import Sampling
from spherekit.scenes.link_scenes import (
    graph_scene,
    link_shapes,
    motion_scenes,
    static_scene,
)
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Axis, Scene
from spherekit.version import __version__

MOST_LOGGED = 20_000
"""Samples of an assembly mode that go to a recording unless more are asked for.

With all its poles a four-bar then takes 31 MB.
"""


class Recorder(Protocol):
    """What a run tells a viewer while it goes on; see `spherekit.display`.

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
        analyses: Sequence[str],
        recorder: Recorder,
        every: int | None,
        course: Sampling,
        plans: Sequence[Plan],
        first: int = 0,
    ) -> None:
        """Start the recording of samples from `first` on."""
        mechanism = course.tracer.mechanism
        self._recorder, self._course, self._first = recorder, course, first
        self._every = every or -(-len(course) // MOST_LOGGED)
        self._row = course.shape[-1] if len(course.shape) > 1 else None
        self._shapes = link_shapes(mechanism)
        self._passed = 0
        logged = self._is_logged(np.arange(len(course)))
        times = course.t
        self._times = None if times is None else times[logged]
        single = times is None and course.inputs.shape[1] == 1
        self._inputs = course.inputs[logged, 0] if single else None
        properties = {
            "spherekit": __version__,
            "mechanism_hash": mechanism_hash(mechanism),
            "analyses": ", ".join(analyses),
        }
        if self._every > 1:
            properties["logged"] = f"one of {self._every} successive samples"
        if first:
            properties["resumed"] = f"samples before {first} are not in this recording"
        recorder.start(
            RecordingHead(
                [
                    static_scene(plans, self._shapes),
                    replace(graph_scene(mechanism), source=MOTION),
                ],
                self._inputs,
                course.titles,
                properties,
                course.middle,
                None if self._row is None else -(-self._row // self._every),
                self._times,
            )
        )

    def summary(self) -> dict[str, int]:
        """Return what the recording leaves out."""
        return {"one_of": self._every, "from_sample": self._first}

    def seen(self, course: Sampling) -> None:
        """Log the links at samples that a simulation has passed while it is solved."""
        assert course.t is not None and course.simulation is not None
        new = np.arange(
            self._passed, np.searchsorted(course.t, course.simulation.end.t), self._every
        )
        if new.size:
            self._course = course
            motion = course.motion_at(new)
            self._passed += self._every * len(new)
            self.scenes(motion_scenes(motion, self._shapes), motion, MOTION)

    def solved(self, course: Sampling) -> None:
        """Go on with what is solved; links seen after its end are hidden."""
        late = np.arange(len(self._course))[len(course) - 1 : self._passed]
        if late.size:
            gone = self._course.motion_at(late)
            gone = replace(gone, placed=np.full_like(gone.placed, np.nan))
            self.scenes(motion_scenes(gone, self._shapes), gone, MOTION)
        self._course = course

    def motion(self, motion: Motion) -> None:
        """Log the links of a block."""
        motion, _ = self._chosen(motion)
        if not motion.samples:
            return
        for scene in motion_scenes(motion, self._shapes, self._course.timed):
            self._log(replace(scene, source=MOTION), motion)

    def scenes(self, scenes: Sequence[Scene], motion: Motion, source: str) -> None:
        """Log what an analysis of this name shows of a block."""
        motion, shown = self._chosen(motion)
        for scene in scenes:
            self._log(replace(scene.thinned(shown), source=source), motion)

    def _chosen(self, motion: Motion) -> tuple[Motion, Bools]:
        """Return a block at the samples that are logged, and which (n,) these are."""
        chosen = self._is_logged(motion.sample)
        shown = chosen[: motion.samples]
        if not np.all(shown):
            motion = replace(motion.rows(chosen), samples=int(np.sum(shown)))
        return motion, shown

    def _is_logged(self, sample: Integers) -> Bools:
        """Return (n,) whether samples (n,) are logged."""
        last = (sample == len(self._course) - 1) & (self._row is None)
        return (sample % (self._row or len(self._course)) % self._every == 0) | last

    def _log(self, scene: Scene, motion: Motion) -> None:
        k = motion.samples
        timing = motion.timing
        if scene.over:
            k = len(scene.over[0].values)
            spread = (
                None if line is None else np.linspace(line[0], line[-1], k + 1)[:-1]
                for line in (self._inputs, self._times)
            )
            self._recorder.log(scene, np.arange(k), *spread)
        elif k:
            inputs = None if self._inputs is None else motion.q[:k]
            times = None if self._times is None or timing is None else timing.t[:k]
            scene = replace(scene, over=self._axes(motion))
            self._recorder.log(scene, motion.sample[:k], inputs, times)

    def _axes(self, motion: Motion) -> tuple[Axis, ...]:
        """Return what the samples of a block run over: the time, or each input."""
        k = motion.samples
        times = self._course.t
        if times is not None and motion.timing is not None:
            return (Axis("time", "s", motion.timing.t[:k], (times[0], times[-1])),)
        names = motion.mechanism.input_pairs
        label = "input {}" if len(names) == 1 else "{}"
        return tuple(
            Axis(label.format(name), "rad", values, span)
            for name, values, span in zip(
                names, motion.inputs[:k].T, self._course.extents[0].T.tolist(), strict=True
            )
        )
