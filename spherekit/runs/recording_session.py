"""Passes the scenes of a run to a recorder, for every sample or for every k-th sample."""

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
    moving_link_scenes,
    static_scene,
)
from spherekit.scenes.motion_plots import motion_plots
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Axis, Scene
from spherekit.version import __version__

MAX_RECORDED_SAMPLES = 20_000
"""Samples of each assembly mode in a recording, unless `log_every` says otherwise.

A recording of a four-bar with all its poles then takes 31 MB. Larger: larger files;
smaller: fewer of the successive samples are shown.
"""


class Recorder(Protocol):
    """A viewer or file that receives the scenes of a run; see `spherekit.display`.

    A scene is a set of drawings over some samples. Some recorders have two more members:
    `finish`, which completes the recording, and `cost`, the numbers of entities, rows and
    bytes that it has written.
    """

    def start(self, head: RecordingHead) -> None:
        """Receive what is known before the first block."""

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Receive the scene of a block of samples in one assembly mode.

        Parameters
        ----------
        scene
            The drawings.
        samples
            (k,) sample numbers. Empty for a scene that does not move.
        inputs
            (k,) values of the input, rad.
        times
            (k,) times, s.
        """


class RecordingSession:
    """Passes what a run shows to its recorder.

    The ground and the graph of links and pairs are passed at the start. Moving links and
    the scenes (drawings) of analyses are passed block by block. Only one of `every`
    successive samples is recorded. In a grid of inputs the count starts again in each row
    of the grid. Along a path of samples the last sample is recorded too.
    """

    def __init__(
        self,
        analyses: Sequence[str],
        recorder: Recorder,
        every: int | None,
        sampling: Sampling,
        plans: Sequence[Plan],
        first_sample: int = 0,
    ) -> None:
        """Start the recording.

        Parameters
        ----------
        analyses
            Names of the analyses, which the recording states.
        recorder
            Receives the scenes.
        every
            Number of successive samples of which one is recorded. By default it is chosen
            for at most `MAX_RECORDED_SAMPLES` in each assembly mode.
        sampling
            The samples of the whole run.
        plans
            The plan of the poles for each input that moves.
        first_sample
            The first sample of a resumed run.
        """
        mechanism = sampling.position_analysis.mechanism
        self._recorder = recorder
        self._sampling = sampling
        self._first_sample = first_sample
        self._every = every or -(-len(sampling) // MAX_RECORDED_SAMPLES)
        # Samples in a row of a grid of inputs; None along a path.
        self._row_length = sampling.shape[-1] if len(sampling.shape) > 1 else None
        self._link_shapes = link_shapes(mechanism)
        # Samples of an unfinished simulation that are already shown.
        self._shown_count = 0

        is_recorded = self._is_recorded(np.arange(len(sampling)))
        times = sampling.t
        self._times = None if times is None else times[is_recorded]
        # With several inputs, or over time, no single input orders the samples.
        has_one_input = times is None and sampling.inputs.shape[1] == 1
        self._inputs = sampling.inputs[is_recorded, 0] if has_one_input else None

        properties = {
            "spherekit": __version__,
            "mechanism_hash": mechanism_hash(mechanism),
            "analyses": ", ".join(analyses),
        }
        if self._every > 1:
            properties["logged"] = f"one of {self._every} successive samples"
        if first_sample:
            properties["resumed"] = (
                f"samples before {first_sample} are not in this recording"
            )
        recorded_row_length = None
        if self._row_length is not None:
            # Divided and rounded up.
            recorded_row_length = -(-self._row_length // self._every)
        recorder.start(
            RecordingHead(
                scenes=[
                    static_scene(plans, self._link_shapes),
                    replace(graph_scene(mechanism), source=MOTION),
                ],
                inputs=self._inputs,
                assembly_modes=sampling.mode_titles,
                properties=properties,
                focus=sampling.mean_axis_direction,
                row=recorded_row_length,
                times=self._times,
            )
        )

    def summary(self) -> dict[str, int]:
        """Return which samples the recording has, ready for JSON."""
        return {"one_of": self._every, "from_sample": self._first_sample}

    def show_simulation_progress(self, sampling: Sampling) -> None:
        """Show the links at samples that an unfinished simulation has passed.

        They are shown before their poles are evaluated, so that a viewer follows a long
        simulation. When the simulation is finished, `use_final_sampling` is called instead.
        """
        assert sampling.t is not None and sampling.simulation is not None
        # `end.t` is the time (s) that the simulation has reached so far. One of `_every`
        # successive samples is recorded.
        passed_count = np.searchsorted(sampling.t, sampling.simulation.end.t)
        new_samples = np.arange(self._shown_count, passed_count, self._every)
        if new_samples.size:
            self._sampling = sampling
            motion = sampling.motion_at(new_samples)
            self._shown_count += self._every * len(new_samples)
            scenes = moving_link_scenes(motion, self._link_shapes)
            # `MOTION` says that the run itself shows these scenes, and no analysis.
            self.record_scenes(scenes, motion, MOTION)

    def use_final_sampling(self, final_sampling: Sampling) -> None:
        """Record the samples of a finished simulation from now on.

        While a simulation is solved, its links are shown at samples up to the requested end
        time. The finished simulation can end earlier, and then has fewer samples. Samples
        after its end that are already shown are hidden. The last sample of the finished
        simulation is at its end, which can be another time than that of the shown sample
        with the same number. This shown sample is hidden too.
        """
        # The samples that are hidden: from the last one of the finished simulation to the
        # last one that has been shown. `_shown_count` counts whole steps of `_every`
        # samples, so it can exceed the number of samples.
        shown_sampling = self._sampling
        first_hidden = len(final_sampling) - 1
        shown_end = min(self._shown_count, len(shown_sampling))
        hidden_samples = np.arange(first_hidden, shown_end)
        if hidden_samples.size:
            motion = shown_sampling.motion_at(hidden_samples)
            # Links without a rotation (NaN) are not drawn. To record them again, without
            # rotations, hides them.
            motion = replace(motion, placed=np.full_like(motion.placed, np.nan))
            scenes = moving_link_scenes(motion, self._link_shapes)
            # `MOTION` says that the run itself shows these scenes, and no analysis.
            self.record_scenes(scenes, motion, MOTION)
        self._sampling = final_sampling

    def record_motion(self, motion: Motion) -> None:
        """Record the links of a block, and the plots that every recording has."""
        motion, _ = self._recorded_part(motion)
        if not motion.samples:
            return
        link_scenes = moving_link_scenes(motion, self._link_shapes)
        plots_by_mode = motion_plots(motion, self._sampling.is_over_time)
        for scene, plots in zip(link_scenes, plots_by_mode, strict=True):
            contents = (*scene.primitives, *plots)
            self._log(replace(scene, primitives=contents, source=MOTION), motion)

    def record_scenes(self, scenes: Sequence[Scene], motion: Motion, source: str) -> None:
        """Record the scenes of a block; `source` is the name of their analysis."""
        motion, is_recorded = self._recorded_part(motion)
        for scene in scenes:
            self._log(replace(scene.thinned(is_recorded), source=source), motion)

    def _recorded_part(self, motion: Motion) -> tuple[Motion, Bools]:
        """Return the recorded samples of a block, and which of its samples (k,) they are.

        All assembly modes have the same samples, so the first mode decides.
        """
        is_recorded_row = self._is_recorded(motion.sample)
        is_recorded = is_recorded_row[: motion.samples]
        if not np.all(is_recorded):
            motion = replace(motion.rows(is_recorded_row), samples=int(np.sum(is_recorded)))
        return motion, is_recorded

    def _is_recorded(self, sample: Integers) -> Bools:
        """Return (n,) whether the samples with the numbers (n,) are recorded."""
        sample_count = len(self._sampling)
        is_last_of_path = (sample == sample_count - 1) & (self._row_length is None)
        index_in_row = sample % (self._row_length or sample_count)
        return (index_in_row % self._every == 0) | is_last_of_path

    def _log(self, scene: Scene, motion: Motion) -> None:
        """Pass a scene to the recorder, with the samples of a block.

        Some scenes are drawn over an axis of their own, such as a parameter of a curve. All
        others are drawn over the samples.

        Parameters
        ----------
        scene
            The drawings.
        motion
            The recorded samples of the block, in one or several assembly modes.
        """
        if scene.over:
            self._log_over_own_axes(scene)
        elif motion.samples:
            self._log_over_samples(scene, motion)

    def _log_over_own_axes(self, scene: Scene) -> None:
        """Pass a scene with axes of its own to the recorder.

        Its points are spread evenly over the timeline of the recording.
        """
        # The axes of a scene have one value for each row of the scene.
        count = len(scene.over[0].values)
        self._recorder.log(
            scene,
            samples=np.arange(count),
            inputs=_spread_evenly(self._inputs, count),
            times=_spread_evenly(self._times, count),
        )

    def _log_over_samples(self, scene: Scene, motion: Motion) -> None:
        """Pass a scene of a block to the recorder, with inputs or times as its timeline.

        Parameters
        ----------
        scene
            The drawings, without axes.
        motion
            The recorded samples of the block.
        """
        # The rows of the first assembly mode, which come first, have all samples.
        count = motion.samples
        scene_over_samples = replace(scene, over=self._axes(motion))
        inputs = None
        if self._inputs is not None:
            # A single input orders the samples.
            inputs = motion.q[:count]
        times = None
        if self._times is not None and motion.timing is not None:
            times = motion.timing.t[:count]
        self._recorder.log(scene_over_samples, motion.sample[:count], inputs, times)

    def _axes(self, motion: Motion) -> tuple[Axis, ...]:
        """Return the axes over which the samples of a block are drawn.

        They are the time if the samples are times, and otherwise each input. The range of
        an axis is that of the whole run.
        """
        # The first `count` rows, which belong to the first assembly mode, have all samples.
        count = motion.samples
        # If the samples are times, the motion has them in `timing`, too. It can also have a
        # `timing` while the samples are inputs.
        times = self._sampling.t
        if times is not None and motion.timing is not None:
            return (Axis("time", "s", motion.timing.t[:count], (times[0], times[-1])),)
        names = motion.mechanism.input_pairs
        has_one_input = len(names) == 1
        # `extents[0]` (2, inputs) are the least and greatest inputs (rad), `extents[1]` are
        # those of their rates.
        input_ranges = self._sampling.extents[0].T.tolist()
        return tuple(
            Axis(f"input {name}" if has_one_input else name, "rad", values, input_range)
            for name, values, input_range in zip(
                names, motion.inputs[:count].T, input_ranges, strict=True
            )
        )


def _spread_evenly(timeline: Floats | None, count: int) -> Floats | None:
    """Return `count` values from the first value of a timeline on, before its last one."""
    if timeline is None:
        return None
    return np.linspace(timeline[0], timeline[-1], count + 1)[:-1]
