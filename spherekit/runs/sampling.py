"""The samples of a run: values of its inputs, times of laws, or times of a simulation.

`make_sampling` finds the assembly modes, or solves the simulation, of a `Study`.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN, Names
from spherekit.dynamics.forward_dynamics import check_engine_and_tolerance, simulate
from spherekit.dynamics.simulation import Event, Simulation
from spherekit.dynamics.simulation_start import make_input_torques
from spherekit.errors import ModelError, SolveError
from spherekit.files.study import Study
from spherekit.files.time_law import ConstantSpeed, Law
from spherekit.geometry.vectors import nans
from spherekit.mechanism.load_kinds import DRIVE_LOAD_NAME
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.angle_unwrapping import LastAngles, continue_angles
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import BLOCK_ROWS, PositionAnalysis
from spherekit.positions.timing import Timing, evaluate_time_laws, input_extents
from spherekit.status import Status
from spherekit.symbolic.compiler import EngineChoice
from spherekit.tables.table import INPUTS, Column, Table, TableArrays, input_columns

DEFAULT_INPUT_SPEED = 1.0
"""The speed (rad/s) of an input without a law.

Rates are proportional to it, accelerations to its square. The value is taken from the
example in the source.
"""

DURATION_ADVICE = "give one with --duration T or duration = T"
"""Advice of messages about a duration that is missing."""

MAX_SUMMARIZED_EVENTS = 100
"""Number of events of a simulation in the summary; the table of events has all."""

DIRECTION_CANCELS = 1e-9
"""Length of the mean of unit vectors below which they have no mean direction.

Larger: a recording of evenly spread axes is seen from its default side more often.
"""

EVENTS = Table(
    "events",
    "events of a simulation, in order of time: one row per event",
    (
        Column("t", "s", "time of the event"),
        Column(
            "kind",
            "",
            "kind of the event: dead_centre (the input turns back while the mechanism "
            "moves on), type_2 (the inputs do not determine the motion), crossing "
            "(configuration curves cross), rest (all links stop), joint_limit (a pair "
            "reaches its limit), switch (a load changes abruptly) or lift_off (a contact "
            "loses its pressure)",
            "text",
        ),
        Column(
            "pair",
            "",
            "pair that the event concerns; empty if the event concerns no pair",
            "text",
        ),
        INPUTS,
    ),
)


@dataclass(frozen=True)
class Sampling:
    """The samples of a run (values of its inputs, or times), and the motion at them.

    The motion comes from the `simulation`, if there is one. Otherwise the position analysis
    computes it from the inputs.

    Attributes
    ----------
    position_analysis
        The assembly modes (ways to assemble the mechanism), and the solver that computes
        configurations.
    inputs
        (k, inputs) variables of the driven pairs at the k samples, rad.
    shape
        Number of samples for each input of a grid. Along a path it is (k,).
    timing
        Times, and rates and accelerations of the inputs, at the k samples. None over a grid
        or a listed path of several inputs, where no motion is stated.
    is_over_time
        Whether the samples are times, of time laws or of a simulation. Otherwise an input
        moves at `DEFAULT_INPUT_SPEED`.
    laws
        Time law of each input, by the name of the driven pair.
    has_default_law
        Whether the only input moves over time at `DEFAULT_INPUT_SPEED`, without a law of
        the user.
    duration
        Duration that was asked for, s.
    simulation
        The solved simulation, if the motion follows from loads.
    tolerance
        Error tolerance of the simulation, rad.
    """

    position_analysis: PositionAnalysis
    inputs: Floats
    shape: tuple[int, ...]
    timing: Timing | None
    is_over_time: bool
    laws: Mapping[str, Law]
    has_default_law: bool = False
    duration: float | None = None
    simulation: Simulation | None = None
    tolerance: float | None = None

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def t(self) -> Floats | None:
        """(k,) times of the samples (s), if the samples are times."""
        return self.timing.t if self.is_over_time and self.timing is not None else None

    @cached_property
    def extents(self) -> list[Floats]:
        """Least and greatest inputs (2, inputs) in rad, and rates (2, inputs) in rad/s."""
        return input_extents(self.inputs, self.timing)

    @property
    def assumed_rates(self) -> dict[str, float]:
        """Rate (rad/s) of each driven pair, by name, if the user has given no time laws.

        Torques and reactions depend on these rates. The result is empty with time laws, for
        a simulation, and over a grid or a listed path of several inputs.
        """
        if self.timing is None or (self.is_over_time and not self.has_default_law):
            return {}
        # The rates are the same at all samples.
        rates = self.timing.dq[0].tolist()
        return dict(zip(self.position_analysis.inputs, rates, strict=True))

    @property
    def block_size(self) -> int:
        """Number of samples in a block for which the position analysis is fastest."""
        return self.position_analysis.block

    def blocks(self, size: int, first_sample: int = 0) -> Iterator[Motion]:
        """Yield the motion in blocks (groups) of `size` successive samples."""
        for start in range(first_sample, len(self), size):
            yield self.motion_at(np.arange(start, min(start + size, len(self))))

    def motion_at(self, samples: Indices) -> Motion:
        """Compute the motion at samples (n,), given by their numbers in rising order."""
        if self.simulation is not None:
            return self._simulated_motion(self.simulation, samples)
        motion = self.position_analysis.samples(samples)
        timing = self.timing
        if timing is not None:
            timing = timing.rows(samples).repeated(len(motion.assembly_modes))
        return replace(motion, timing=timing)

    def _simulated_motion(self, simulation: Simulation, samples: Indices) -> Motion:
        """Return the positions of the mechanism at some samples of a simulation.

        All positions get the number of the assembly mode (way to assemble the mechanism) in
        which the simulation starts. The number stays the same even if the mechanism passes
        a dead centre, where modes meet.

        Parameters
        ----------
        simulation
            The solved simulation, or the part of it that is already solved.
        samples
            (n,) indices of the samples.
        """
        assert self.timing is not None
        position_analysis = self.position_analysis
        solver = position_analysis.solver

        # Samples after the end of the simulation have the state at its end.
        t = np.minimum(self.timing.t[samples], simulation.end.t)
        states = simulation.at(t)
        # (n, variables). The angles of a simulation include whole revolutions. In a motion
        # only inputs do, and all other angles are in (-pi, pi].
        values = states.values
        values[:, solver.angles] = wrap(values[:, solver.angles])
        values[:, list(simulation.driven)] = states.inputs
        return Motion(
            mechanism=position_analysis.mechanism,
            joints=solver.joints,
            assembly=position_analysis.assembly,
            assembly_modes=position_analysis.assembly_modes,
            samples=len(t),
            sample=samples,
            assembly_mode=np.full(len(t), position_analysis.assembly_modes[0].number),
            inputs=states.inputs,
            values=values,
            placed=states.rotations,
            status=np.full(len(t), Status.OK, dtype=np.int8),
            residual=states.residual,
            timing=Timing(t, states.input_rates, states.input_accelerations),
            sense=_find_input_sense(simulation, position_analysis.inputs[0], t),
        )

    def continue_angles(
        self, motion: Motion, names: Collection[str], last_angles: LastAngles
    ) -> Mapping[str, Floats]:
        """Return pair variables of a block that continue from the previous block.

        Angles of a motion are in (-pi, pi], except for the inputs, and so they jump by
        whole revolutions. The returned variables have no such jumps, also from block to
        block.

        Parameters
        ----------
        motion
            A block of successive samples: n rows.
        names
            Pairs for which the variables are returned, inputs and passive pairs.
        last_angles
            The variables at the end of the previous block. They are updated in place.

        Returns
        -------
        (n,) variables in rad, by pair.
        """
        # The inputs of a motion contain their revolutions already.
        passive_names = set(names) - set(self.position_analysis.inputs)
        if self.simulation is not None and passive_names:
            # A simulation has counted the revolutions of all variables while it was solved.
            # The variables of this motion contain them, and the call below returns these
            # variables as they are.
            motion = self._add_simulated_revolutions(self.simulation, motion)
        # Without a simulation, this call counts the revolutions from sample to sample.
        angle_unwrapping = self.position_analysis.angle_unwrapping
        return continue_angles(motion, names, angle_unwrapping, last_angles)

    def _add_simulated_revolutions(self, simulation: Simulation, motion: Motion) -> Motion:
        """Return a motion with angles that contain the revolutions of a simulation.

        A simulation counts the revolutions of all variables while it is solved. The motion
        that is computed from the simulation has angles in (-pi, pi]. Only the inputs
        contain their revolutions.
        """
        assert motion.timing is not None  # a simulation always has times
        simulated_values = simulation.at(motion.timing.t).values
        revolutions = np.round((simulated_values - motion.values) / TURN)
        angle_indices = self.position_analysis.solver.angles
        values = motion.values.copy()
        values[:, angle_indices] += TURN * revolutions[:, angle_indices]
        return replace(motion, values=values)

    @property
    def mode_titles(self) -> dict[int, str]:
        """A page title for each assembly mode, by index of the mode.

        An assembly mode is one of the ways to assemble the mechanism. The title has the
        number, the name if there is one, and the signs of its dyads (groups of two links
        with three R pairs) if there are any.
        """
        assembly_modes = self.position_analysis.assembly_modes
        # Groups of links that are no dyads have the sign "~".
        has_signs = any(set(mode.label) != {"~"} for mode in assembly_modes)
        # A simulation can leave the mode in which it starts.
        prefix = "From mode" if self.simulation is not None else "Mode"
        titles = {}
        for mode in assembly_modes:
            titles[mode.number] = f"{prefix} {mode.number}"
            if has_signs or mode.name:
                titles[mode.number] += f" ({mode.title})"
        return titles

    @property
    def mean_axis_direction(self) -> Floats | None:
        """Mean direction of the axes and contact points in the first assembly mode.

        It is a unit vector (3,) in ground axes, from which recordings (files for the
        viewer) are viewed. At most 47 samples are used, to save time. The result is None if
        the axes cancel each other.
        """
        spread_samples = np.arange(0, len(self), max(1, len(self) // 24))
        motion = self.motion_at(spread_samples)
        is_first_mode = motion.assembly_mode == motion.assembly_mode[0]
        # (rows, pairs, 3) the third column of the frame of each pair (joint). It is the
        # axis of the pair, or points to the contact point of two links.
        axes = motion.frames[~motion.failed & is_first_mode, :, :, 2]
        axis_sum = np.sum(axes, axis=(0, 1))
        length = np.linalg.norm(axis_sum)
        return None if length < DIRECTION_CANCELS else axis_sum / length

    def events(self) -> TableArrays:
        """Return the rows of the table `EVENTS` of a simulation."""
        assert self.simulation is not None
        mechanism = self.position_analysis.mechanism
        return EVENTS.stacked(
            mechanism,
            (
                {"t": event.t, "kind": event.kind, "pair": event.pair}
                | input_columns(mechanism, np.array([event.inputs]))
                for event in self.simulation.events
            ),
        )

    def _summarize_events(self, events: Sequence[Event]) -> list[dict[str, Any]]:
        """Return the first events of a simulation for the summary.

        An event at which all links stop also has the swing that it ends. The swing is the
        change of the input (rad) since the previous stop, or since the start. A very small
        swing shows that a damper has nearly stopped the mechanism.
        """
        entries: list[dict[str, Any]] = []
        q_at_last_stop = float(self.inputs[0, 0])
        for event in events[:MAX_SUMMARIZED_EVENTS]:
            entry = {"kind": event.kind, "t": event.t, "pair": event.pair}
            if event.kind == "rest":
                entry["swing_rad"] = abs(event.q - q_at_last_stop)
                q_at_last_stop = event.q
            entries.append(entry)
        return entries

    @property
    def warnings(self) -> Names:
        """Warnings about mode names that fit no mode, and about a missed tolerance."""
        missed = self.simulation.missed if self.simulation is not None else None
        return self.position_analysis.unused_mode_names + (
            () if missed is None else (missed,)
        )

    def summary(self) -> dict[str, Any]:
        """Return facts about the motion over time for the summary of a run.

        Returns
        -------
        A key ``time`` with the duration and the time laws of the inputs. For a simulation
        the key is ``simulation``, with the start, the end and the checks of the simulation:

        - ``achieved_error_rad``: difference from a more accurate simulation;
        - ``missed``: a message if the requested tolerance is missed, otherwise None;
        - ``energy_imbalance_J``, ``power_imbalance_W``: errors of the balance between the
          kinetic energy and the work of the loads;
        - ``energy_scale_J``: the largest energy, with which its error is compared;
        - ``closure_drift_rad``: the largest opening of a loop of links;
        - ``event_list``: the first events only;
        - ``event_kinds``: the kinds of all events.

        The result is empty if the samples are not samples over time.
        """
        if not self.is_over_time:
            return {}
        facts: dict[str, Any] = {"duration_s": self.duration}
        simulation = self.simulation
        if simulation is None:
            facts["laws"] = {pair: repr(law) for pair, law in self.laws.items()}
            return {"time": facts}
        assert self.timing is not None  # a simulation always has times
        input_names = self.position_analysis.inputs
        start_inputs = self.inputs[0]
        start_rates = self.timing.dq[0]
        end = simulation.end
        checks = simulation.checks
        own_load_names = {load.name for load in self.position_analysis.mechanism.loads}
        facts |= {
            "end": {"kind": end.kind, "t": end.t, "reason": end.message},
            "tolerance": self.tolerance,
            "achieved_error_rad": checks.error,
            "missed": simulation.missed,
            "energy_imbalance_J": checks.energy,
            "energy_scale_J": checks.energy_scale,
            "power_imbalance_W": checks.power,
            "closure_drift_rad": checks.closure,
            "engine": {"name": simulation.engine.name, "steps": simulation.engine.steps},
            "events": len(simulation.events),
            "event_kinds": sorted({event.kind for event in simulation.events}),
            "event_list": self._summarize_events(simulation.events),
            # Driving torques are loads that the mechanism itself does not have.
            "loads": [
                {
                    "name": load.name,
                    "kind": load.kind,
                    "drives": load.name not in own_load_names,
                }
                for load in simulation.mechanism.loads
            ],
            "start": {
                pair: {"q_rad": float(q), "dq_rad_per_s": float(dq)}
                for pair, q, dq in zip(input_names, start_inputs, start_rates, strict=True)
            },
        }
        return {"simulation": facts}


def _find_input_sense(simulation: Simulation, input_pair: str, t: Floats) -> Floats:
    """Return the sense (n,) in which an input moves at times t (n,) of a simulation.

    At a dead centre the input turns back while the mechanism moves on. So the sense is -1
    after an odd number of dead centres, otherwise 1.
    """
    reversal_times = [
        event.t
        for event in simulation.events
        if event.kind == "dead_centre" and event.pair == input_pair
    ]
    # The number of dead centres before each time.
    reversal_counts = np.searchsorted(reversal_times, t)
    return np.where(reversal_counts % 2 == 1, -1.0, 1.0)


def make_sampling(
    study: Study,
    engine: EngineChoice = "auto",
    follow: bool = True,
    on_progress: Callable[[Sampling], None] | None = None,
) -> Sampling:
    """Return the samples of a study.

    The result also has the assembly modes (ways to assemble the mechanism), or the solved
    simulation. The samples are values of the inputs, or times. With time laws the inputs
    are given as functions of time. In a simulation they follow from loads.

    Parameters
    ----------
    study
        The mechanism, and the samples, the time laws or the start of its motion.
    engine
        The solver of a simulation; see `simulate`.
    follow
        False if no analysis of the run needs the motion (the configurations at the
        samples). If the samples are values of the inputs, no assembly modes are then
        searched and no configurations computed. If the samples are times, `follow` is not
        used.
    on_progress
        Function that is called while a simulation is solved. Its argument has all samples
        and the part of the simulation that is solved.

    Raises
    ------
    AnalysisError, FileError
        If laws, duration, start and samples do not fit together.
    PlanError, SolveError, ModelError
        See `PositionAnalysis` and `simulate`.
    """
    check_time(study)
    mechanism = driven_at(study.mechanism)  # the mechanism, after a check of its inputs
    if study.duration is None:
        return _sample_inputs(study, mechanism, follow)
    # With a duration the samples are times. With a start the motion is a simulation.
    assert isinstance(study.samples, int)
    t = np.linspace(0.0, study.duration, study.samples)
    if study.start is not None:
        return _simulate_study(study, mechanism, t, engine, on_progress)
    return _sample_laws(study, mechanism, t)


def _sample_inputs(study: Study, mechanism: Mechanism, follow: bool) -> Sampling:
    """Return samples that are values of the inputs.

    There are three kinds: samples on the straight path through the ranges of all inputs, on
    a grid over these ranges, or at the values that the study lists (`path`).

    Parameters
    ----------
    study
        The samples, and options of the search for assembly modes (ways to assemble the
        mechanism).
    mechanism
        The mechanism of the study, with the inputs of the run.
    follow
        False if no analysis of the run needs the motion. Assembly modes are then not
        searched, and there are no configurations.
    """
    # With `input_pair=None` the mechanism keeps its inputs. `crossings` says which curve a
    # mode follows where curves of configurations cross.
    position_analysis = PositionAnalysis(
        mechanism,
        input_pair=None,
        assembly_mode=study.assembly_mode,
        search=study.search,
        samples=study.samples,
        grid=study.grid,
        path=study.path,
        follow=follow,
        crossings=study.crossings,
    )
    # `q` has the values of the inputs at all samples, and `shape` the sample counts along
    # the axes of a grid. `is_path` says whether the samples are successive positions along
    # a path.
    input_grid = position_analysis.input_grid
    is_straight_path = study.path is None and input_grid.is_path
    # The times at which the inputs pass the samples with constant speed, and their rates.
    # None if several inputs have samples on a grid, or on a listed path, which may have
    # corners.
    timing = _time_input_values(input_grid.q, is_straight_path)
    return Sampling(
        position_analysis=position_analysis,
        inputs=input_grid.q,
        shape=input_grid.shape,
        timing=timing,
        is_over_time=False,
        laws={},
    )


def _time_input_values(q: Floats, is_straight_path: bool) -> Timing | None:
    """Return times and rates for samples that are values of the inputs, or None.

    The samples get times if the inputs can pass them at constant speed:

    - on a straight path from the first sample to the last one,
    - or if there is a single input. Its values may be listed in any order, but it moves
      from the least to the greatest one. So the times need not rise from sample to sample.

    Several inputs have no times on a grid, since its samples have no order. They have no
    times on a listed path either, because the path may have corners.

    Parameters
    ----------
    q
        (k, inputs) values of the inputs, rad.
    is_straight_path
        Whether the samples are on a straight path through the ranges of all inputs.
    """
    has_one_input = q.shape[1] == 1
    if is_straight_path or has_one_input:
        return _default_timing(q, is_straight_path)
    return None


def _sample_laws(study: Study, mechanism: Mechanism, t: Floats) -> Sampling:
    """Return samples at some times, at which the inputs follow their time laws.

    Parameters
    ----------
    study
        The time laws and the options of the search for assembly modes (ways to assemble the
        mechanism).
    mechanism
        The mechanism of the study, with the inputs of the run.
    t
        (n,) times of the samples, s.
    """
    laws = study.laws
    if not laws:
        # The single input moves from the start of its range at the default speed, in the
        # sense in which the range is given.
        driven = mechanism.inputs[0]
        law = ConstantSpeed(driven.sense * DEFAULT_INPUT_SPEED, driven.start)
        laws = {driven.pair: law}
    # (n, inputs) values of the inputs at the times, and their rates and accelerations.
    q, timing = evaluate_time_laws(mechanism.input_pairs, laws, t)
    # With `input_pair=None` the mechanism keeps its inputs. `crossings` says which curve a
    # mode follows where curves of configurations cross.
    position_analysis = PositionAnalysis(
        mechanism,
        input_pair=None,
        assembly_mode=study.assembly_mode,
        search=study.search,
        path=q,
        crossings=study.crossings,
    )
    return Sampling(
        position_analysis=position_analysis,
        inputs=q,
        shape=(len(q),),
        timing=timing,
        is_over_time=True,
        laws=laws,
        has_default_law=not study.laws,
        duration=study.duration,
    )


def _simulate_study(
    study: Study,
    mechanism: Mechanism,
    t: Floats,
    engine: EngineChoice,
    on_progress: Callable[[Sampling], None] | None,
) -> Sampling:
    """Solve the simulation of a study, in which the motion follows from loads.

    Parameters
    ----------
    study
        Duration, start, driving torques and tolerance of the simulation.
    mechanism
        The mechanism of the study, with the inputs of the run.
    t
        (n,) times of the samples, s.
    engine
        The solver; see `simulate`.
    on_progress
        Called repeatedly while the simulation is solved. The argument has the times of all
        samples, and the part of the simulation that is solved so far. None if no function
        follows the progress.

    Returns
    -------
    The samples at times t, or up to the end of the simulation if it ends earlier.
    """
    assert study.start is not None and study.duration is not None
    check_engine_and_tolerance(mechanism, engine, study.tolerance)
    # The position analysis only finds the assembly modes at the start. Its samples are the
    # two ends of the range of a single input, or the start (1, inputs) of several inputs.
    start_inputs = None
    if len(mechanism.input_pairs) > 1:
        start_values, *_ = study.start.each(mechanism.input_pairs)
        start_inputs = start_values[None]
    position_analysis = PositionAnalysis(
        mechanism,
        input_pair=None,
        assembly_mode=study.assembly_mode or 0,
        samples=2,
        path=start_inputs,
    )

    def show_progress(partial_simulation: Simulation) -> None:
        """Pass the part of a simulation that is solved so far to `on_progress`.

        This part is passed as a `Sampling` at all times `t`, including times that are not
        solved yet. `on_progress`, `t` and `position_analysis` belong to the enclosing
        function.
        """
        # Inputs and rates at later samples are not known yet. `on_progress` reads only how
        # many rows these arrays have, so one column of NaN stands for all inputs.
        unknown = nans((len(t), 1))
        assert on_progress is not None
        on_progress(
            Sampling(
                position_analysis=position_analysis,
                inputs=unknown,
                shape=(len(t),),
                timing=Timing(t, unknown, unknown),
                is_over_time=True,
                laws={},
                simulation=partial_simulation,
            )
        )

    simulation = simulate(
        position_analysis.mechanism,
        study.start,
        study.duration,
        torque=study.driving_torque,
        assembly_mode=position_analysis.assembly_modes[0].number,
        tolerance=study.tolerance,
        crossings=study.crossings,
        check=True,
        engine=engine,
        seen=None if on_progress is None else show_progress,
    )
    sampling = sample_simulation(position_analysis, simulation, t, study.tolerance)
    # A single sample is at time 0, not at the end.
    return replace(sampling, duration=study.duration)


def sample_simulation(
    position_analysis: PositionAnalysis,
    simulation: Simulation,
    t: Floats,
    tolerance: float,
) -> Sampling:
    """Return the samples of a solved simulation, with inputs, rates and accelerations.

    Parameters
    ----------
    position_analysis
        The position analysis with the assembly mode in which the simulation starts.
    simulation
        The solved simulation.
    t
        (n,) times of the samples, s. If the simulation ends earlier, its end is the last
        sample, and later times are left out.
    tolerance
        The tolerance of the simulation, rad.
    """
    duration = float(t[-1])
    end_time = simulation.end.t
    if end_time < duration:
        t = np.append(t[t < end_time], end_time)
    # The states are evaluated in blocks, because they contain the rotations of all links
    # and need much memory.
    inputs = []
    rates = []
    accelerations = []
    for start in range(0, len(t), BLOCK_ROWS):
        states = simulation.at(t[start : start + BLOCK_ROWS])
        inputs.append(states.inputs)
        rates.append(states.input_rates)
        accelerations.append(states.input_accelerations)
    q = np.concatenate(inputs)
    return Sampling(
        position_analysis=position_analysis,
        inputs=q,
        shape=(len(q),),
        timing=Timing(t, np.concatenate(rates), np.concatenate(accelerations)),
        is_over_time=True,
        laws={},
        duration=duration,
        simulation=simulation,
        tolerance=tolerance,
    )


def check_time(study: Study) -> None:
    """Refuse a study in which time laws, duration, start and samples do not fit together.

    The start is the start of a simulation: inputs and rates at time 0.

    Raises
    ------
    AnalysisError, FileError
        With what does not fit, and with file and line if the study is from a file.
    """
    for fault in _time_faults(study, driven_at(study.mechanism)):
        raise study.fault(*fault)


def _time_faults(study: Study, mechanism: Mechanism) -> Iterator[tuple[Names, str]]:
    """Yield faults of the time laws, the duration and the start of a simulation.

    Yields
    ------
    The keys that lead to the faulty value in the file of the study, and a sentence.
    """
    inputs = mechanism.input_pairs
    start = study.start
    duration = study.duration
    torque = study.driving_torque

    # The time laws of the inputs.
    for pair in study.laws:
        law_key = ("inputs", pair, "law")
        if pair not in inputs:
            yield law_key, f"pair {pair} is not an input. Inputs: {', '.join(inputs)}"
        if start is not None:
            yield (
                law_key,
                "cannot be given together with a start, because the motion then follows "
                "from the loads; give either a law or a start",
            )
        if duration is None:
            yield law_key, f"a time law needs a duration in s; {DURATION_ADVICE}"

    # The start of a simulation, and its driving torques.
    if start is not None:
        if duration is None:
            yield (
                ("start",),
                f"a simulation needs a duration in s; {DURATION_ADVICE}",
            )
        try:
            start.each(inputs)
        except ModelError as problem:
            yield ("start",), str(problem).removeprefix("start: ")
    elif torque is not None:
        yield (
            ("start",),
            "a driving torque acts in a simulation only; give a start (inputs and rates) "
            "and a duration for a simulation, or leave the torque out",
        )
    if torque is not None:
        torques: Iterable[Any] = [study.torque]
        if isinstance(study.torque, Mapping):
            torques = study.torque.values()
        for value in torques:
            if isinstance(value, int | float) and not np.isfinite(value):
                yield ("start", "torque"), f"found {value}, expected a finite number"
        try:
            mechanism.with_loads(*make_input_torques(mechanism, torque))
        except (ModelError, SolveError) as problem:
            # The user has written a torque, not the load that it becomes.
            message = str(problem).removeprefix(f"{mechanism.name}: ")
            message = message.removeprefix(f"loads.{DRIVE_LOAD_NAME}.torque: ")
            pattern = rf"loads\.{DRIVE_LOAD_NAME}_(\w+)\.torque:"
            yield ("start", "torque"), re.sub(pattern, r"input \1:", message)

    # All further faults are about samples at times.
    if duration is None:
        return
    if not 0.0 < duration < np.inf:
        yield ("duration",), f"found {duration:g} s, expected a finite time above 0"
    inputs_without_law = [name for name in inputs if name not in study.laws]
    if start is None and inputs_without_law and len(inputs) > 1:
        yield (
            ("inputs",),
            f"input {inputs_without_law[0]} has no law; give one for every input, such as "
            f"--law {inputs_without_law[0]}=constant_speed:speed=1rad/s",
        )
    if study.path is not None:
        yield (
            ("inputs", inputs[0], "values"),
            "cannot be given together with a duration, because with a duration the samples "
            "are times, not values of the input; leave out the values or the duration",
        )
    if study.grid or not isinstance(study.samples, int):
        yield (
            ("samples",),
            "with a duration the samples are times; give a single number of samples",
        )
    elif study.samples < 1:
        yield ("samples",), f"found {study.samples}, expected at least 1 sample"


def _default_timing(q: Floats, is_straight: bool) -> Timing:
    """Return times, rates and accelerations of inputs that have no time laws.

    The fastest input moves at the constant speed `DEFAULT_INPUT_SPEED`, the other inputs in
    proportion to it. Time begins at 0, and accelerations are 0.

    Parameters
    ----------
    q
        (k, inputs) values of the inputs, rad.
    is_straight
        Whether the inputs move on a straight path from the first to the last row. If not,
        there is a single input with values in any order, which moves from its least to its
        greatest value.
    """
    # (2, inputs): the first and the last values, or the least and the greatest. The first
    # result of `input_extents` is about the inputs, the second one about their rates.
    ends = q[[0, -1]] if is_straight else input_extents(q)[0]
    displacement = ends[1] - ends[0]
    fastest = np.argmax(np.abs(displacement))
    t = np.abs(q[:, fastest] - ends[0, fastest]) / DEFAULT_INPUT_SPEED
    if displacement[fastest]:
        relative_speed = displacement / np.abs(displacement[fastest])
    else:
        # No input moves, for example with a single sample. All inputs get the default
        # speed, so that velocities are not all zero.
        relative_speed = np.ones_like(displacement)
    return Timing(
        t,
        dq=np.broadcast_to(DEFAULT_INPUT_SPEED * relative_speed, q.shape),
        ddq=np.broadcast_to(0.0, q.shape),
    )
