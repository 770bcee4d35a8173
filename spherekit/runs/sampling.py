"""What a run goes through: the samples of its inputs, or the times of a simulation."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN, Names
from spherekit.dynamics.forward_dynamics import need_allowed, simulate
from spherekit.dynamics.simulation import Simulation
from spherekit.dynamics.simulation_start import make_input_torques
from spherekit.errors import ModelError, SolveError
from spherekit.files.study import Study
from spherekit.files.time_law import ConstantSpeed, Law
from spherekit.geometry.rotation import nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.angle_unwrapping import LastAngles, continue_angles
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import BLOCK_ROWS, PositionAnalysis
from spherekit.positions.timing import Timing, evaluate_time_laws, input_extents
from spherekit.status import Status
from spherekit.tables.table import INPUTS, Column, Table, TableArrays, input_columns
from spherekit.velocities.kernels import Engine

UNIT_SPEED = 1.0
"""An input without a law turns at this speed (rad/s), as in the source's example."""

EVENTS = Table(
    "events",
    "what happened in the course of a simulation, in order of time",
    (
        Column("t", "s", "time"),
        Column("kind", "", "dead_centre, type_2, rest, joint_limit or switch", "text"),
        Column("pair", "", "the pair concerned, if it is one", "text"),
        INPUTS,
    ),
)


@dataclass(frozen=True)
class Sampling:
    """The samples of a run with their times.

    `tracer` has the assembly modes; `inputs` (k, inputs) rad are those of each sample and
    `shape` their number along each axis; `timing` (k rows) is None where nothing says how
    the inputs move. `timed` says that
    samples are times. The motion is that of the `simulation`, if there is one, otherwise
    the tracer evaluates it.
    """

    tracer: PositionAnalysis
    inputs: Floats
    shape: tuple[int, ...]
    timing: Timing | None
    timed: bool
    laws: Mapping[str, Law]
    duration: float | None = None
    simulation: Simulation | None = None
    tolerance: float | None = None

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def t(self) -> Floats | None:
        """(k,) times of the samples (s), if the samples are times."""
        return self.timing.t if self.timed and self.timing is not None else None

    @cached_property
    def extents(self) -> list[Floats]:
        """Least and greatest inputs and rates of all samples."""
        return input_extents(self.inputs, self.timing)

    @property
    def block(self) -> int:
        """Samples in a block, as many as are quick together."""
        return self.tracer.block

    def blocks(self, size: int, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples."""
        for start in range(first, len(self), size):
            yield self.motion_at(np.arange(start, min(start + size, len(self))))

    def motion_at(self, sample: Indices) -> Motion:
        """Return the motion at some samples (n,), by their numbers in rising order."""
        if self.simulation is None:
            motion = self.tracer.samples(sample)
            timing = self.timing
            if timing is not None:
                timing = timing.rows(sample).repeated(len(motion.assembly_modes))
            return replace(motion, timing=timing)
        assert self.timing is not None
        tracer = self.tracer
        simulation = self.simulation
        t = np.minimum(self.timing.t[sample], simulation.end.t)
        states = simulation.at(t)
        solver = tracer.solver
        values = states.values
        values[:, solver.angles] = wrap(values[:, solver.angles])
        values[:, list(simulation.driven)] = states.inputs
        turns = [
            event.t
            for event in simulation.events
            if event.kind == "dead_centre" and event.pair == tracer.inputs[0]
        ]
        return Motion(
            mechanism=tracer.mechanism,
            joints=solver.joints,
            assembly=tracer.assembly,
            assembly_modes=tracer.assembly_modes,
            samples=len(t),
            sample=sample,
            assembly_mode=np.full(len(t), tracer.assembly_modes[0].number),
            inputs=states.inputs,
            values=values,
            placed=states.rotations,
            status=np.full(len(t), Status.OK, dtype=np.int8),
            residual=states.residual,
            timing=Timing(t, states.input_rates, states.input_accelerations),
            sense=np.where(np.searchsorted(turns, t) % 2 == 1, -1.0, 1.0),
        )

    def angles(
        self, motion: Motion, names: Collection[str], last: LastAngles
    ) -> Mapping[str, Floats]:
        """Return the variables that go on, by pair, at the next block of a motion."""
        solver = self.tracer.solver
        if self.simulation is not None and set(names) - set(self.tracer.inputs):
            assert motion.timing is not None
            whole = self.simulation.at(motion.timing.t).values - motion.values
            values = motion.values.copy()
            values[:, solver.angles] += TURN * np.round(whole / TURN)[:, solver.angles]
            motion = replace(motion, values=values)
        return continue_angles(motion, names, self.tracer.angle_unwrapping, last)

    @property
    def titles(self) -> dict[int, str]:
        """A page title for each assembly mode; the signs of dyads if there are any."""
        assembly_modes = self.tracer.assembly_modes
        signed = any(set(assembly_mode.label) != {"~"} for assembly_mode in assembly_modes)
        words = "From mode" if self.simulation is not None else "Mode"
        return {
            assembly_mode.number: f"{words} {assembly_mode.number}"
            + (f" ({assembly_mode.title})" if signed or assembly_mode.name else "")
            for assembly_mode in assembly_modes
        }

    @property
    def middle(self) -> Floats | None:
        """The mean direction (3,) of axes and contacts of the first mode, if any."""
        coarse = self.motion_at(np.arange(0, len(self), max(1, len(self) // 24)))
        first_mode = ~coarse.failed & (coarse.assembly_mode == coarse.assembly_mode[0])
        mean = np.sum(coarse.frames[first_mode, :, :, 2], axis=(0, 1))
        size = np.linalg.norm(mean)
        return None if size < 1e-9 else mean / size

    def events(self) -> TableArrays:
        """Return the table of the simulation's events."""
        assert self.simulation is not None
        mechanism = self.tracer.mechanism
        return EVENTS.stacked(
            mechanism,
            (
                {"t": event.t, "kind": event.kind, "pair": event.pair}
                | input_columns(mechanism, np.array([event.inputs]))
                for event in self.simulation.events
            ),
        )

    @property
    def warnings(self) -> Names:
        """What is to be heeded of names of modes, and in the rows of a simulation."""
        missed = self.simulation.missed if self.simulation is not None else None
        return self.tracer.unused_mode_names + (() if missed is None else (missed,))

    def summary(self) -> dict[str, Any]:
        """Return what is to be said of time, and of a simulation's checks."""
        if not self.timed:
            return {}
        facts: dict[str, Any] = {"duration_s": self.duration}
        if self.simulation is None:
            facts["laws"] = {pair: repr(law) for pair, law in self.laws.items()}
            return {"time": facts}
        done = self.simulation
        facts |= {
            "end": {"kind": done.end.kind, "t": done.end.t, "reason": done.end.message},
            "tolerance": self.tolerance,
            "achieved_error_rad": done.checks.error,
            "missed": done.missed,
            "energy_imbalance_J": done.checks.energy,
            "energy_scale_J": done.checks.energy_scale,
            "power_imbalance_W": done.checks.power,
            "closure_drift_rad": done.checks.closure,
            "engine": {"name": done.engine.name, "steps": done.engine.steps},
            "events": len(done.events),
        }
        return {"simulation": facts}


def course_of(
    study: Study,
    engine: Engine = "auto",
    follow: bool = True,
    seen: Callable[[Sampling], None] | None = None,
) -> Sampling:
    """Return the course of a study, simulated and checked if loads say the motion.

    Without `follow` samples over no time have no assembly modes: nothing is read there.
    `seen` is given all samples with a simulation that is being solved, as far as it is.

    Raises
    ------
    AnalysisError, FileError
        If what is said of time does not fit together.
    PlanError, SolveError, ModelError
        See `PositionAnalysis` and `simulate`.
    """
    check_time(study)
    mechanism = driven_at(study.mechanism)
    assembly_mode = study.assembly_mode
    samples = study.samples
    inputs = mechanism.input_pairs
    if study.duration is None:
        tracer = PositionAnalysis(
            mechanism,
            None,
            assembly_mode,
            study.search,
            samples,
            study.grid,
            study.path,
            follow,
            study.crossings,
        )
        input_grid = tracer.input_grid
        straight = study.path is None and input_grid.is_path
        moves = straight or len(inputs) == 1
        timing = _at_unit_speed(input_grid.q, straight) if moves else None
        return Sampling(tracer, input_grid.q, input_grid.shape, timing, False, {})
    assert isinstance(samples, int)
    t = np.linspace(0.0, study.duration, samples)
    if study.start is not None:
        need_allowed(mechanism, engine, study.tolerance)
        several = study.start.each(inputs)[0][None] if len(inputs) > 1 else None
        tracer = PositionAnalysis(
            mechanism, None, assembly_mode or 0, samples=2, path=several
        )
        unknown = nans((samples, 1))
        rows = tracer, unknown, (samples,), Timing(t, unknown, unknown), True
        simulation = simulate(
            tracer.mechanism,
            study.start,
            study.duration,
            torque=study.driving_torque,
            assembly_mode=tracer.assembly_modes[0].number,
            tolerance=study.tolerance,
            crossings=study.crossings,
            check=True,
            engine=engine,
            seen=seen and (lambda so_far: seen(Sampling(*rows, {}, simulation=so_far))),
        )
        return simulated_course(tracer, simulation, t, study.tolerance)
    laws = study.laws
    if not laws:  # through its range
        driven = mechanism.inputs[0]
        laws = {driven.pair: ConstantSpeed(driven.sense * UNIT_SPEED, driven.start)}
    q, timing = evaluate_time_laws(inputs, laws, t)
    tracer = PositionAnalysis(
        mechanism, None, assembly_mode, study.search, path=q, crossings=study.crossings
    )
    return Sampling(tracer, q, (len(q),), timing, True, laws, study.duration)


def check_time(study: Study) -> None:
    """Refuse a study in which laws, duration, start and samples do not fit together.

    Raises
    ------
    AnalysisError, FileError
        With what does not fit, and with file and line if the study is from a file.
    """
    for fault in _time_faults(study, driven_at(study.mechanism)):
        raise study.fault(*fault)


def _time_faults(study: Study, mechanism: Mechanism) -> Iterator[tuple[Names, str]]:
    """Yield what is wrong with how time is given, by the keys of a study that say it."""
    inputs = mechanism.input_pairs
    start, duration, torque = study.start, study.duration, study.driving_torque
    for pair in study.laws:
        law = ("inputs", pair, "law")
        if pair not in inputs:
            yield law, f"pair {pair} is not an input; inputs: {', '.join(inputs)}"
        if start is not None:
            yield (
                law,
                "excluded by the start: there the motion follows from the loads; give a "
                "law or a start",
            )
        if duration is None:
            yield law, "a time law needs a duration in s, --duration T or duration = T"
    if start is not None:
        if duration is None:
            yield ("start",), "a start needs a duration in s, --duration T or duration = T"
        try:
            start.each(inputs)
        except ModelError as problem:
            yield ("start",), str(problem).removeprefix("start: ")
    elif torque is not None:
        yield ("start",), "a driving torque needs a start"
    if torque is not None:
        given = (
            study.torque.values() if isinstance(study.torque, Mapping) else [study.torque]
        )
        for size in given:
            if isinstance(size, int | float) and not np.isfinite(size):
                yield ("start", "torque"), f"{size} is not finite"
        try:
            mechanism.with_loads(*make_input_torques(mechanism, torque))
        except (ModelError, SolveError) as problem:
            yield ("start", "torque"), str(problem)
    if duration is None:
        return
    if not 0.0 < duration < np.inf:
        yield ("duration",), f"found {duration:g} s, needs a finite time above 0"
    lacking = [name for name in inputs if name not in study.laws]
    if start is None and lacking and len(inputs) > 1:
        yield (
            ("inputs",),
            f"input {lacking[0]} has no law; give one for every input, such as "
            f"--law {lacking[0]}=constant_speed:speed=1",
        )
    if study.path is not None:
        yield (
            ("inputs", inputs[0], "values"),
            "excluded by the duration: over time the samples are times",
        )
    if study.grid or not isinstance(study.samples, int):
        yield (
            ("samples",),
            "over time the samples are times; give a single number of them",
        )


def simulated_course(
    tracer: PositionAnalysis, simulation: Simulation, t: Floats, tolerance: float
) -> Sampling:
    """Return a simulation at times t (n,) s, as far as it went, as a course.

    Where it ended before the last of them, its end is the last row.
    """
    duration = float(t[-1])
    last = simulation.end.t
    if last < duration:
        t = np.append(t[t < last], last)
    states = (simulation.at(t[k : k + BLOCK_ROWS]) for k in range(0, len(t), BLOCK_ROWS))
    parts = ((x.inputs, x.input_rates, x.input_accelerations) for x in states)
    q, dq, ddq = map(np.concatenate, zip(*parts, strict=True))
    return Sampling(
        tracer, q, (len(q),), Timing(t, dq, ddq), True, {}, duration, simulation, tolerance
    )


def _at_unit_speed(q: Floats, straight: bool) -> Timing:
    """Return the timing of inputs (k, inputs) on a straight path, the fastest at 1 rad/s.

    A single input on another path turns from its least value at 1 rad/s.
    """
    ends = q[[0, -1]] if straight else input_extents(q)[0]
    way = ends[1] - ends[0]
    fastest = np.argmax(np.abs(way))
    t = np.abs(q[:, fastest] - ends[0, fastest]) / UNIT_SPEED
    share = way / np.abs(way[fastest]) if way[fastest] else np.ones_like(way)
    return Timing(
        t, np.broadcast_to(UNIT_SPEED * share, q.shape), np.broadcast_to(0.0, q.shape)
    )
