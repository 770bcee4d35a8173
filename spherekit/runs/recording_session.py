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
    """A viewer or a file that receives the scenes of a run, block by block of samples.

    A scene is a set of drawings over some samples. Recorders in `spherekit.display` may
    have two more members. `finish` completes the recording. `cost` has the numbers of
    entities, rows and bytes that were written.
    """

    def start(self, head: RecordingHead) -> None:
        """Receive what is known before the first block, such as titles and the ground."""

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Show or keep the scene (drawings) of a block of samples.

        Parameters
        ----------
        scene
            The drawings of one page, such as the page of an assembly mode (way to assemble
            the mechanism). Drawings that move have k rows, one for each sample.
        samples
            (k,) numbers of the samples. Some scenes, such as a plot over a frequency, do
            not belong to samples. Their k rows have the numbers 0 to k - 1, and are spread
            evenly over the inputs and times of the recording.
        inputs
            (k,) values of the input (rad). None if there are several inputs, or if the
            samples of the run are times.
        times
            (k,) times (s). None if the samples of the run have no times.
        """


class RecordingSession:
    """Passes what a run shows to its recorder, which draws it or writes it to a file.

    The ground and the graph of links and pairs are passed at the start. Moving links and
    the scenes (drawings) of analyses are passed block by block, a block being a group of
    successive samples. Only one of `every` successive samples is recorded. In a grid of
    inputs the count starts again in each row of the grid. Along a path of samples the last
    sample is recorded too.
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
            Receives the scenes (drawings).
        every
            Number of successive samples of which one is recorded. By default it is chosen
            for about `MAX_RECORDED_SAMPLES` at most in each assembly mode.
        sampling
            The samples of the whole run.
        plans
            How the poles (axes of relative rotation) are found, for each input that moves.
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
        """Return which samples the recording (file for the viewer) has, ready for JSON."""
        return {"one_of": self._every, "from_sample": self._first_sample}

    def show_simulation_progress(self, sampling: Sampling) -> None:
        """Show the links at the samples that an unfinished simulation has passed.

        Users can so follow a long simulation in a viewer.

        Parameters
        ----------
        sampling
            All samples, and the part of the simulation up to the time that is solved so
            far.
        """
        assert sampling.t is not None and sampling.simulation is not None
        # `end.t` is the time (s) that the simulation has reached so far. Only every
        # `_every`-th sample is recorded.
        passed_count = np.searchsorted(sampling.t, sampling.simulation.end.t)
        new_samples = np.arange(self._shown_count, passed_count, self._every)
        if new_samples.size:
            self._sampling = sampling
            motion = sampling.motion_at(new_samples)
            self._shown_count += self._every * len(new_samples)
            scenes = moving_link_scenes(motion, self._link_shapes)
            # `MOTION` says that these scenes belong to the run itself, not to an analysis.
            self.record_scenes(scenes, motion, MOTION)

    def use_final_sampling(self, final_sampling: Sampling) -> None:
        """Record the samples of a finished simulation from now on.

        A recording is what a viewer shows. While a simulation is solved, links are already
        recorded at the samples that it passes, which reach up to the requested end time.
        The simulation may end earlier, and then has fewer samples. Links that were recorded
        after its end are hidden.

        If the simulation ends early, its last sample is at its end. While it was solved,
        the sample with this index could have a later time. Links that were recorded there
        are therefore hidden, too. The run records the last sample again.

        Parameters
        ----------
        final_sampling
            The samples of the finished simulation.
        """
        # Hide the samples from the last one of the finished simulation to the last one that
        # was shown. `_shown_count` grows in steps of `_every`, so it may be larger than the
        # number of samples.
        shown_sampling = self._sampling
        first_hidden = len(final_sampling) - 1
        shown_end = min(self._shown_count, len(shown_sampling))
        hidden_samples = np.arange(first_hidden, shown_end)
        if hidden_samples.size:
            motion = shown_sampling.motion_at(hidden_samples)
            # Links without a rotation (NaN) are not drawn, and replace the links that were
            # recorded at the same samples.
            motion = replace(motion, placed=np.full_like(motion.placed, np.nan))
            scenes = moving_link_scenes(motion, self._link_shapes)
            # `MOTION` says that these scenes belong to the run itself, not to an analysis.
            self.record_scenes(scenes, motion, MOTION)
        self._sampling = final_sampling

    def record_motion(self, motion: Motion) -> None:
        """Record the links at a block of samples, and the plots of every recording."""
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
        """Return the recorded part of a motion, and which of its k samples are recorded.

        The motion has the same k samples in each assembly mode, one mode after another. So
        the mask (k,) is read from the first mode.
        """
        is_recorded_row = self._is_recorded(motion.sample)
        is_recorded = is_recorded_row[: motion.samples]
        if not np.all(is_recorded):
            motion = replace(motion.rows(is_recorded_row), samples=int(np.sum(is_recorded)))
        return motion, is_recorded

    def _is_recorded(self, sample: Integers) -> Bools:
        """Return a mask (n,): whether the samples with the indices (n,) are recorded."""
        sample_count = len(self._sampling)
        is_last_of_path = (sample == sample_count - 1) & (self._row_length is None)
        index_in_row = sample % (self._row_length or sample_count)
        return (index_in_row % self._every == 0) | is_last_of_path

    def _log(self, scene: Scene, motion: Motion) -> None:
        """Pass a scene (a group of drawings) to the recorder, with the samples of a block.

        The drawings of some scenes have their own horizontal axis, `scene.over`, such as a
        frequency or a parameter of a curve. All other scenes are drawn over the samples.

        Parameters
        ----------
        scene
            The scene.
        motion
            The recorded samples of the block, in one or several assembly modes.
        """
        if scene.over:
            self._log_over_own_axes(scene)
        elif motion.samples:
            self._log_over_samples(scene, motion)

    def _log_over_own_axes(self, scene: Scene) -> None:
        """Pass a scene with separate axes, not the axes of the samples, to the recorder.

        Such a scene (drawing) belongs to no sample. To be shown with the recording, its
        rows are spread evenly over the inputs and times of the recording.
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
        """Pass a scene to the recorder, together with the samples to which it belongs.

        The samples form a block (group of successive samples). The inputs or times of the
        samples tell the recorder where each row of the scene belongs on a timeline.

        Parameters
        ----------
        scene
            The drawings, with one row for each sample. The axes over which values are
            plotted, the inputs or the time, are added here.
        motion
            The recorded samples of the block, in one or several assembly modes.
        """
        # A motion has all samples in the first assembly mode, then all in the second, ...
        # All modes have the same inputs and times, so those of the first mode are used.
        count = motion.samples
        scene_over_samples = replace(scene, over=self._axes(motion))
        inputs = None
        # `_inputs` is None with several inputs, or if the samples are times.
        is_over_single_input = self._inputs is not None
        if is_over_single_input:
            inputs = motion.q[:count]
        times = None
        if self._times is not None and motion.timing is not None:
            times = motion.timing.t[:count]
        self._recorder.log(scene_over_samples, motion.sample[:count], inputs, times)

    def _axes(self, motion: Motion) -> tuple[Axis, ...]:
        """Return the axes over which values at the samples of a block are plotted.

        The axes are the time if the samples are times, and otherwise each input. The range
        of an axis covers the whole run, so that plots of all blocks agree.

        Parameters
        ----------
        motion
            The configurations of the block, in all assembly modes.
        """
        # A motion has all samples in the first assembly mode, then all in the second, ...
        # All modes have the same inputs and times, so those of the first mode are used.
        count = motion.samples
        times = self._sampling.t  # None if the samples are values of the inputs
        if times is not None and motion.timing is not None:
            return (Axis("time", "s", motion.timing.t[:count], (times[0], times[-1])),)
        names = motion.mechanism.input_pairs
        # (2, inputs) the least and the greatest value of each input (rad).
        input_extents, _rate_extents = self._sampling.extents
        axes = []
        for name, values, input_range in zip(
            names, motion.inputs[:count].T, input_extents.T.tolist(), strict=True
        ):
            title = f"input {name}" if len(names) == 1 else name
            axes.append(Axis(title, "rad", values, input_range))
        return tuple(axes)


def _spread_evenly(timeline: Floats | None, count: int) -> Floats | None:
    """Return `count` values from the first value of a timeline on, before its last one."""
    if timeline is None:
        return None
    return np.linspace(timeline[0], timeline[-1], count + 1)[:-1]
