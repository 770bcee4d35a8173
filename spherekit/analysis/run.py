"""Running analyses: what they need is planned, evaluated in blocks, and handed over."""

import os
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np

from spherekit.analysis.contract import (
    AbstractAnalysis,
    Batch,
    Findings,
    Needs,
    run_status,
)
from spherekit.analysis.cost import AXES, RECORDING, Ledger, cost_of
from spherekit.analysis.course import EVENTS, Course, course_of
from spherekit.analysis.evaluation import Evaluation
from spherekit.analysis.forecast import ENOUGH, forecast
from spherekit.analysis.journal import RunFolder, Unfinished, differences
from spherekit.analysis.needed import left_out, needed_part
from spherekit.analysis.recording import CountingRecorder, Recorder, Stage, thinning_of
from spherekit.analysis.registry import create
from spherekit.analysis.result import (
    MOTION,
    AnalysisResult,
    RunResult,
    stem_of,
    write_results,
)
from spherekit.analysis.room import physical_memory, size_text
from spherekit.analysis.setting import ORDINARY, Setting
from spherekit.analysis.stage import plan_notes
from spherekit.analysis.standing import Standing, identity_of
from spherekit.analysis.store import AbstractStore, InMemory, Nowhere, OnDisk
from spherekit.analysis.tables import (
    BRANCH,
    FILE_SIZE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    TIME,
    Column,
    Format,
    Table,
    TableData,
    input_columns,
)
from spherekit.analysis.verify import Verifier, faults
from spherekit.conventions import CLOSURE_TOLERANCE, listing
from spherekit.engine.kernels import ENGINES, Engine
from spherekit.errors import AnalysisError, OutputError, SpherekitError
from spherekit.files.write import mechanism_hash
from spherekit.model.laws import Law, Start
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import DEFAULT_SAMPLES, Motion
from spherekit.planning.inputs import driven_pairs
from spherekit.planning.poles import Plan, pole_of
from spherekit.planning.rigidity import graph_mobility
from spherekit.rates.field import PoleField, SignMemory
from spherekit.rates.request import Request, request
from spherekit.sphere.rotation import Floats
from spherekit.version import __version__

Progress = Callable[[int, int], None]

FRAMES_HELD = 8
"""Frames held at once for each link and pair of a row: 5 to 7.6 were measured."""

DEFAULT_TOLERANCE = 1e-9
"""Error tolerated in each step of a simulation, for pair variables (rad)."""


def needs_of(mechanism: Mechanism, analyses: Sequence[AbstractAnalysis]) -> Needs:
    """Return what several analyses need together."""
    together = Needs()
    for analysis in analyses:
        together = together.union(analysis.needs(mechanism))
    return together


def requests_for(
    mechanism: Mechanism, needs: Needs, by_rank: bool = False
) -> tuple[Request, ...]:
    """Return the planned request behind some needs for each input, moved alone.

    `by_rank` is that of `spherekit.planning.poles.plan`.
    """
    ends = {link for name in needs.pair_rates for link in mechanism.pair(name).links}
    numbers = {mechanism.link_number[link] for link in needs.link_rates | ends} - {0}
    rates = sorted(needs.rates | {pole_of(0, number) for number in numbers})
    return tuple(
        request(
            mechanism,
            mechanism.pairs[driven].name,
            sorted(needs.directions),
            rates,
            needs.derivatives,
            sorted(needs.planes),
            by_rank,
        )
        for driven in driven_pairs(mechanism)
    )


def run(
    mechanism: Mechanism,
    analyses: str | AbstractAnalysis | Sequence[str | AbstractAnalysis] = "poles",
    *,
    samples: int | Sequence[int] = DEFAULT_SAMPLES,
    input_pair: str | Sequence[str] | None = None,
    branch: int | None = None,
    search: bool = True,
    grid: bool = False,
    path: Floats | None = None,
    laws: Mapping[str, Law] | None = None,
    duration: float | None = None,
    start: Start | None = None,
    torque: str | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    engine: Engine = "auto",
    only_needed: bool = False,
    folder: str | os.PathLike[str] | None = None,
    unfinished: Unfinished = "refuse",
    degrees: bool = False,
    formats: Sequence[Format] = tuple(FILE_SIZE),
    tables: bool = True,
    recorder: Recorder | None = None,
    log_every: int | None = None,
    progress: Progress | None = None,
    block: int | None = None,
    verify: int | None = None,
    setting: Setting = ORDINARY,
    accuracy: Mapping[str, Any] | None = None,
) -> RunResult:
    """Run analyses over the motion of a mechanism.

    Parameters
    ----------
    mechanism
        A mechanism with a freedom for each of its inputs.
    analyses
        Names such as ``"poles"`` or ``"poles:only=31+42"``, or analysis objects.
    samples, input_pair, branch, search, grid, path
        Which inputs and assembly modes; see `spherekit.motion.motion.Tracer`.
    laws, duration
        Time law of each driven pair, and the time (s) from t = 0 that the samples divide,
        both ends included. With a duration alone the only input turns at 1 rad/s.
    start, torque, tolerance, engine
        State of the only input at t = 0: the motion over `duration` then follows from the
        loads and the `torque` at the input, as `spherekit.dynamics.forward.simulate` finds
        it from the `branch` (default 0) among all that there are.
    only_needed
        Whether to leave out the groups of links that no analysis needs. Branches are then
        modes of the part that is left, and only that part has to close.
    folder
        Where tables go while the run goes on, so that memory does not grow with the
        samples; the files are there at the end. Without it tables stay in memory.
    unfinished
        What to do with the work of a run that was stopped in that folder: ``"refuse"`` to
        start, ``"resume"`` it (or start, if there is none), or ``"discard"`` it.
    degrees, formats
        Whether the files have angles in degrees, and which files are written.
    tables
        Whether tables are kept in memory where there is no folder.
    recorder
        Receives the scenes block by block while the run goes on.
    log_every
        Of how many successive samples one goes to the recorder; by default so many that
        no branch has more than `MOST_LOGGED`.
    progress
        Called with samples done and samples in all after each block.
    block
        Samples evaluated at once, by default as `Tracer.blocks` has them; all, if an
        analysis wants whole batches.
    verify
        How many rows to compute once more in 50 digits; what that says is in the summary
        under `verified`, see `spherekit.analysis.verify`. Of a run that goes on after it
        was stopped, these are rows of the part that was left.
    setting, accuracy
        How samples are computed, and what is known of the errors of that, for the summary.

    Returns
    -------
    RunResult
        An analysis that fails is in its `failures`; the others are not affected.

    Raises
    ------
    AnalysisError, ModelError, PlanError, SolveError
        Before any sample is computed, for unknown names, impossible mechanisms, times
        that do not fit together, or a run at once that this machine has no memory for.
    OutputError
        If the folder cannot be written, the disk is full, another run writes there, or
        has left work that does not fit. What is done is kept, to be resumed.
    """
    ledger, whole = Ledger(), mechanism
    if isinstance(analyses, str | AbstractAnalysis):
        analyses = [analyses]
    chosen = [create(item) if isinstance(item, str) else item for item in analyses]
    if only_needed:
        mechanism = needed_part(mechanism, chosen, input_pair, start)
    with _opened(folder) as place:
        with ledger.stage("search"):
            course = course_of(
                mechanism,
                samples=samples,
                input_pair=input_pair,
                branch=branch,
                search=search,
                grid=grid,
                path=path,
                laws=laws or {},
                duration=duration,
                start=start,
                torque=torque,
                tolerance=tolerance,
                engine=_engine(place, unfinished, engine),
            )
        if accuracy is not None:
            setting = _setting(place, unfinished, setting)
        job = _job(course, chosen, block, setting, recorder is not None or bool(verify))
        standing, store = _begin(job, place, unfinished, tables)
        ledger.before = standing.seconds
        expected = _expected(job, ledger)
        stage = None
        if recorder is not None:
            with ledger.stage(RECORDING):
                stage = Stage(
                    course,
                    job.plans,
                    [analysis.name for analysis in chosen],
                    recorder,
                    thinning_of(course, log_every),
                    standing.done,
                )
        verifier = None
        if verify:
            verifier = Verifier(
                job.plans,
                job.requests,
                job.analyses,
                job.needs,
                len(course),
                verify,
                course.timed,
            )
        with _kept(job, place, standing, store) as after_block:
            blocks = job.evaluation.blocks(job.block, standing.done)
            for motion in ledger.each("positions", blocks):
                _evaluate(job, motion, standing, store, stage, verifier, ledger)
                standing.seconds = ledger.closed()
                after_block()
                if isinstance(store, OnDisk):
                    _check_room(job, store, standing.done, formats)
                if progress is not None:
                    progress(standing.done, len(course))
            summary = _summary(job, standing)
            if stage is not None:
                summary["recording"] = stage.summary()
            if only_needed:
                summary["part_of"] = left_out(whole, course.tracer.mechanism)
            summary["cost"] = _cost(job, standing, ledger, recorder) | course.cost()
            summary["cost"]["predicted"] = expected
            if verifier is not None:
                summary["verified"] = verifier.verdict(standing.failures)
                summary["warnings"] += faults(summary["verified"])
            if accuracy is not None:
                summary["accuracy"] = {**accuracy, "setting": str(job.evaluation.setting)}
            return _result(job, standing, store, place, summary, degrees, formats)


@final
@dataclass(frozen=True)
class _Job:
    """A run made ready: what is evaluated for whom, in blocks of how many samples."""

    course: Course
    analyses: tuple[AbstractAnalysis, ...]
    needs: tuple[Needs, ...]
    requests: tuple[Request, ...]
    block: int
    evaluation: Evaluation

    @property
    def mechanism(self) -> Mechanism:
        return self.course.tracer.mechanism

    @property
    def plans(self) -> tuple[Plan, ...]:
        return tuple(item.plan for item in self.requests)

    @property
    def is_single_block(self) -> bool:
        return self.block >= len(self.course)

    @cached_property
    def identity(self) -> dict[str, Any]:
        return identity_of(self.course, self.analyses, self.block, self.evaluation.setting)

    def tables(self, analysis: AbstractAnalysis) -> tuple[Table, ...]:
        return tuple(table.of(self.mechanism) for table in analysis.tables)

    @cached_property
    def motion_tables(self) -> tuple[Table, ...]:
        """The table of the motion, and of what happened in a simulation."""
        course, mechanism = self.course, self.mechanism
        variables = [
            Column(name, "rad", f"variable of pair {mechanism.pairs[owner].name}")
            for name, owner in zip(
                mechanism.variable_names, mechanism.variable_owners, strict=True
            )
        ]
        table = Table(
            MOTION,
            "the configurations: one row per sample and branch",
            (
                SAMPLE,
                BRANCH,
                *([TIME] if course.timed else []),
                INPUTS,
                *variables,
                RESIDUAL,
                STATUS,
            ),
        ).of(mechanism)
        return (table,) if course.simulation is None else (table, EVENTS)


def _job(
    course: Course,
    analyses: Sequence[AbstractAnalysis],
    block: int | None,
    setting: Setting,
    all_links: bool,
) -> _Job:
    mechanism, tracer = course.tracer.mechanism, course.tracer
    own = tuple(analysis.needs(mechanism) for analysis in analyses)
    _need_times(course, analyses, own)
    together = needs_of(mechanism, analyses)
    wanted = requests_for(mechanism, together, tracer.by_rank)
    evaluation = Evaluation(setting, course, wanted, together, all_links)
    whole = [analysis.name for analysis in analyses if not analysis.rowwise]
    if whole:
        block = len(course)
        _check_memory(mechanism, block * len(tracer.branches), whole)
    block = min(block or tracer.block, len(course))
    return _Job(course, tuple(analyses), own, wanted, block, evaluation)


def _need_times(
    course: Course, chosen: Sequence[AbstractAnalysis], own: Sequence[Needs]
) -> None:
    for analysis, what in zip(chosen, own, strict=True):
        if what.time and course.timing is None:
            raise AnalysisError(
                f"{analysis.name}: needs time, but with several inputs nothing says how "
                "they move; give a law for every input, and a duration"
            )


def memory_at_once(mechanism: Mechanism, rows: int) -> int:
    """Return about how many bytes it takes to evaluate so many rows at once.

    Frames (3, 3) of links and pairs are most of it.
    """
    return rows * FRAMES_HELD * 72 * (len(mechanism.links) + len(mechanism.pairs))


def _check_memory(mechanism: Mechanism, rows: int, whole: Sequence[str]) -> None:
    """Raise `AnalysisError` if a run that cannot be cut into blocks needs too much."""
    wanted, there = memory_at_once(mechanism, rows), physical_memory()
    if there is not None and wanted > there:
        raise AnalysisError(
            f"{listing(whole)} looks at all samples at once: that takes about "
            f"{size_text(wanted)} of memory for {rows} rows, and this machine has "
            f"{size_text(there)}; ask for {max(1, int(rows * there / wanted / 2))} rows "
            "(samples of all branches) or fewer, or for one branch"
        )


@contextmanager
def _opened(folder: str | os.PathLike[str] | None) -> Iterator[RunFolder | None]:
    if folder is None:
        yield None
        return
    with RunFolder.opened(Path(folder)) as place:
        yield place


def _engine(place: RunFolder | None, unfinished: Unfinished, engine: Engine) -> Engine:
    """Return the engine: to go on, the one that was chosen when the run began."""
    if engine != "auto" or place is None or unfinished != "resume" or not place.unfinished:
        return engine
    identity = place.read().get("identity")
    began = identity.get("engine") if isinstance(identity, dict) else None
    return next((each for each in ENGINES if each == began), engine)


def _setting(place: RunFolder | None, unfinished: Unfinished, setting: Setting) -> Setting:
    """Return the setting: to go on, the one that was chosen when the run began."""
    if place is None or unfinished != "resume" or not place.unfinished:
        return setting
    identity = place.read().get("identity")
    began = identity.get("setting") if isinstance(identity, dict) else None
    try:
        return Setting(**began) if isinstance(began, dict) else setting
    except TypeError:
        return setting


def _begin(
    job: _Job, place: RunFolder | None, unfinished: Unfinished, tables: bool
) -> tuple[Standing, AbstractStore]:
    """Return where the run stands, at the start or as it was stopped, and its store."""
    standing = Standing([SignMemory() for _ in job.requests])
    if place is None:
        return standing, InMemory() if tables else Nowhere()
    if not place.unfinished or unfinished == "discard":
        place.discard()
        return standing, OnDisk(place.work, not job.is_single_block, {})
    state = place.read()
    try:
        differs = differences(state["identity"], job.identity)
        done = int(state["standing"]["done"])
        if not differs and unfinished == "resume":
            store = OnDisk(place.work, not job.is_single_block, state["store"])
            every = [(a.name, table) for a in job.analyses for table in job.tables(a)]
            store.check([*every, *((MOTION, table) for table in job.motion_tables)])
            return Standing.restored(state["standing"]), store
    except OutputError as problem:
        raise place.damaged(str(problem)) from None
    except (LookupError, TypeError, ValueError, AttributeError) as problem:
        raise place.damaged(f"{type(problem).__name__}: {problem}") from None
    if differs:
        raise OutputError(
            f"{str(place.path)!r}: unfinished work of a different run is there "
            f"({differs}); choose another folder, or throw that work away with --restart "
            '(unfinished="discard")'
        )
    raise OutputError(
        f"{str(place.path)!r}: this run was stopped there when {done} of "
        f"{len(job.course)} samples were done; go on with --resume "
        '(unfinished="resume"), or begin again with --restart (unfinished="discard")'
    )


@contextmanager
def _kept(
    job: _Job, place: RunFolder | None, standing: Standing, store: AbstractStore
) -> Iterator[Callable[[], None]]:
    """Give what is called after each block; if the run is stopped, keep what was done."""
    if place is None or not isinstance(store, OnDisk):
        yield lambda: None
        return
    last: dict[str, Any] = {}
    kept = standing.done

    def write() -> None:
        nonlocal kept
        store.settle()
        place.write(last)
        kept = last["standing"]["done"]

    def after_block() -> None:
        last.update(identity=job.identity, standing=standing.state(), store=store.state())
        if place.due:
            write()

    try:
        yield after_block
    except BaseException as error:
        if last:
            with suppress(OutputError):  # a full disk: then the journal before counts
                write()
        if kept:
            total = len(job.course)
            error.add_note(f"{kept} of {total} samples are done and kept in {place.path}")
        else:
            whole = [item.name for item in job.analyses if not item.rowwise]
            why = f", since {listing(whole)} looks at all samples at once" if whole else ""
            error.add_note(f"nothing was kept{why}")
        raise
    place.discard()


def _evaluate(
    job: _Job,
    motion: Motion,
    standing: Standing,
    store: AbstractStore,
    stage: Stage | None,
    verifier: Verifier | None,
    ledger: Ledger,
) -> None:
    """Evaluate a block for all analyses, and hand over what they make of it."""
    course = job.course
    with ledger.stage(AXES):
        found = job.evaluation.fields(motion, standing.memories)
    if stage is not None:
        with ledger.stage(RECORDING):
            stage.motion(motion)
    for analysis, what in zip(job.analyses, job.needs, strict=True):
        if analysis.name in standing.failures:
            continue
        batch = Batch(
            job.mechanism, job.plans, what, motion, found, course.timed, course.tracer
        )
        try:
            with ledger.stage(f"analysis {analysis.name}"):
                tables = dict(analysis.compute(batch))
                for table in job.tables(analysis):
                    table.check(tables[table.name], analysis.name)
                if not analysis.rowwise:
                    standing.findings[analysis.name] = analysis.findings(batch)
            with ledger.stage(RECORDING):
                scenes = analysis.scene(batch) if stage is not None else ()
        except SpherekitError as problem:
            standing.failures[analysis.name] = str(problem)
            continue
        except Exception:  # a plugin's own fault must not lose the others' results
            standing.failures[analysis.name] = traceback.format_exc()
            continue
        for table in job.tables(analysis):
            store.add(analysis.name, table, tables[table.name])
            standing.count(analysis.name, table.name, tables[table.name])
        if stage is not None:
            with ledger.stage(RECORDING):
                stage.scenes(scenes, motion)
    store.add(MOTION, job.motion_tables[0], _motion_rows(job, motion, found))
    if standing.done == 0 and course.simulation is not None:
        store.add(MOTION, EVENTS, course.events())
        standing.count(MOTION, EVENTS.name, course.events())
    if verifier is not None:
        verifier.see(motion, found)
    standing.count(MOTION, MOTION, {"sample": motion.sample})
    standing.tally.add(course.tracer, motion, found)
    standing.done += motion.samples


def _expected(job: _Job, ledger: Ledger) -> dict[str, Any] | None:
    """Return the predicted cost of a run that is worth a prediction."""
    course, samples = job.course, len(job.course)
    if course.simulation is not None or samples * len(course.tracer.branches) < ENOUGH:
        return None
    with ledger.stage("forecast"):
        return forecast(course, job.analyses, job.needs, job.requests, samples, job.block)


def _cost(
    job: _Job, standing: Standing, ledger: Ledger, recorder: Recorder | None
) -> dict[str, Any]:
    """Return what was evaluated, made and logged; a recorder that counts is finished."""
    declared = {MOTION: job.motion_tables}
    declared |= {analysis.name: job.tables(analysis) for analysis in job.analyses}
    tables = {
        stem_of(name, own, table): (standing.rows[name, table.name], len(table.columns))
        for name, own in declared.items()
        if name not in standing.failures
        for table in own
    }
    logged = None
    if isinstance(recorder, CountingRecorder):
        with ledger.stage(RECORDING):
            recorder.finish()
        logged = recorder.cost
    tally = standing.tally
    return cost_of(ledger, job.requests, tally.configurations, tally.solves, tables, logged)


def _motion_rows(job: _Job, motion: Motion, found: Sequence[PoleField]) -> TableData:
    rows: dict[str, Any] = {"sample": motion.sample, "branch": motion.branch}
    if job.course.timed and motion.timing is not None:
        rows["t"] = motion.timing.t
    rows |= input_columns(job.mechanism, motion.inputs)
    rows |= dict(zip(job.mechanism.variable_names, motion.values.T, strict=True))
    return rows | {"residual": motion.residual, "status": run_status(motion, found)}


def _check_room(job: _Job, store: OnDisk, done: int, formats: Sequence[Format]) -> None:
    """Raise `OutputError` early if the disk has no room for the run and its files."""
    total = len(job.course)
    if done != job.block or done == total:
        return
    whole = store.size * total / done
    wanted = whole * (1.0 + sum(FILE_SIZE[kind] for kind in formats))
    if wanted - store.size <= store.free:
        return
    less = whole * (1.0 + FILE_SIZE["parquet"])
    hint = f"; Parquet alone (--format parquet) takes {size_text(less)}"
    raise OutputError(
        f"{str(store.folder.parent)!r}: the run will take about {size_text(wanted)}, work "
        f"and files together, and the disk has {size_text(store.free)} left; choose "
        f"another folder or fewer samples{hint if 'csv' in formats else ''}"
    )


def _result(
    job: _Job,
    standing: Standing,
    store: AbstractStore,
    place: RunFolder | None,
    summary: dict[str, Any],
    degrees: bool,
    formats: Sequence[Format],
) -> RunResult:
    """Return the tables of all analyses that did not fail, written if there is a folder."""
    declared = {MOTION: job.motion_tables} | {
        analysis.name: job.tables(analysis)
        for analysis in job.analyses
        if analysis.name not in standing.failures
    }
    files: list[Path] = []
    data: dict[str, dict[str, TableData]] = {name: {} for name in declared}
    if isinstance(store, InMemory):
        for name, tables in declared.items():
            data[name] = {table.name: store.table(name, table) for table in tables}
    elif isinstance(store, OnDisk):
        from spherekit.analysis.frames import ParquetColumns

        assert place is not None
        rows = [
            (name, table, store.table(name, table))
            for name, tables in declared.items()
            for table in tables
        ]
        files, summary = write_results(place, rows, summary, degrees, formats)
        for name, tables in declared.items():
            for table in tables:
                path = place.path / f"{stem_of(name, tables, table)}.parquet"
                if path in files:
                    data[name][table.name] = ParquetColumns(path, table, degrees)
    results = {
        name: AnalysisResult(name, tables, data[name]) for name, tables in declared.items()
    }
    return RunResult(results, standing.failures, summary, tuple(files))


def _summary(job: _Job, standing: Standing) -> dict[str, Any]:
    course, mechanism, tally = job.course, job.mechanism, standing.tally
    tracer, findings = course.tracer, standing.findings
    return {
        "spherekit": __version__,
        "numpy": np.__version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "inputs": {
            name: [float(np.min(column)), float(np.max(column))]
            for name, column in zip(tracer.inputs, course.inputs.T, strict=True)
        },
        "sampling": "x".join(map(str, course.shape)),
        **course.summary(),
        "samples": standing.done,
        "samples_in_a_block": job.block,
        "mobility": {"graph": graph_mobility(mechanism), "rank": tally.rank},
        "redundant_constraints": tally.redundant,
        "groups": [group.kind for group in tracer.assembly.groups],
        "plans": {mechanism.pairs[p.input].name: plan_notes(p) for p in job.plans},
        "branches": [
            {
                "number": item.number,
                "mode": item.label,
                "status": tally.of_branch(item.number),
            }
            for item in tracer.branches
        ],
        "search": tracer.search,
        **tally.statuses(),
        "closure_tolerance_rad": CLOSURE_TOLERANCE,
        "errors_reached": tally.errors(),
        "analyses": [
            {
                "name": analysis.name,
                "version": analysis.version,
                "parameters": asdict(analysis),  # type: ignore[call-overload]
                "failed": analysis.name in standing.failures,
                "cites": list(analysis.cites),
                "findings": dict(findings.get(analysis.name, Findings()).figures),
            }
            for analysis in job.analyses
        ],
        "remarks": [
            f"{name}: {text}" for name, own in findings.items() for text in own.remarks
        ],
        "warnings": [
            f"{name}: {text}" for name, own in findings.items() for text in own.warnings
        ],
    }
