"""Running analyses: what they need is planned, evaluated in blocks, and handed over.

Work in a folder is taken up as it was left, and kept if the run is stopped.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from typing import Any

from spherekit.argument_validation import checked
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError, OutputError, SpherekitError
from spherekit.files.study import Study
from spherekit.positions.motion import Motion
from spherekit.runs.analysis_faults import faults_of
from spherekit.runs.contract import AbstractAnalysis, Analyses
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.execution import Execution
from spherekit.runs.recording_session import RecordingSession
from spherekit.runs.result_checks import findings_of, scenes_of
from spherekit.runs.run_cost import AXES, RECORDING, SEARCH, SIMULATION, Timer
from spherekit.runs.run_folder import (
    RunFolder,
    StoredParts,
    Unfinished,
    differences,
    need_disk_for_run,
)
from spherekit.runs.run_plan import (
    RunPlan,
    job_of,
    left_out,
    motion_rows,
    needed_part,
    needs_of_each,
)
from spherekit.runs.run_result import MOTION, RunResult, result_of, stems
from spherekit.runs.run_state import RunState
from spherekit.runs.sampling import Sampling, course_of
from spherekit.runs.study_analyses import chosen
from spherekit.runs.study_options import Subject, study_of, takes
from spherekit.runs.summary import actual_cost, faults, summary_of
from spherekit.runs.table_scenes import Angles, Fields, table_scenes
from spherekit.runs.verification import Verifier
from spherekit.tables.table import COLUMNS, FILE_SIZE
from spherekit.tables.table_rows import InMemory
from spherekit.velocities.direction_signs import SignContinuation
from spherekit.velocities.kernels import ENGINES
from spherekit.wording import listing


@takes(Execution)
@checked(AnalysisError)
def run(
    subject: Subject,
    analyses: str | AbstractAnalysis | Sequence[str | AbstractAnalysis] = (),
    **options: Any,
) -> RunResult:
    """Run analyses over the motion of a mechanism.

    Nothing is written unless a `folder` is given.

    Parameters
    ----------
    subject
        A study, or a mechanism with a freedom for each of its inputs; or the path or the
        shipped name of either.
    analyses
        Names such as ``"poles"`` or ``"poles:only=31+42"``, or analysis objects; by
        default those of the study, or ``"poles"``. No motion is traced where none reads
        samples, unless a `assembly_mode`, a `recorder`, times or what is to be verified ask
        for one.
    options
        `input_pair`, names of the driven pairs, and fields of
        `spherekit.files.study.Study` (what the run goes through: samples, grid, path,
        assembly_mode, search, laws, duration, start, torque, tolerance, crossings,
        verify, degrees)
        and of `spherekit.runs.execution.Execution` (how it is done: folder, unfinished,
        formats, tables, engine, only_needed, recorder, log_every, progress, block, setting,
        accuracy). Those that are given replace what a study says.

    Returns
    -------
    RunResult
        An analysis that fails is in its `failures`; the others are not affected.

    Raises
    ------
    AnalysisError, ModelError, PlanError, SolveError
        Before any sample is computed, for unknown names, impossible mechanisms, times
        that do not fit together, or a run at once that there is no memory for.
    FileError
        With file and line of what a study file asks for wrongly.
    OutputError
        If the folder cannot be written, the disk is full, another run writes there, or
        has left work that does not fit. What is done is kept, to be resumed.
    """
    study, execution = study_of("run", subject, options, Execution)
    if isinstance(analyses, str | AbstractAnalysis):
        analyses = [analyses]
    return executed(study, chosen(study, analyses), execution)


def executed(
    study: Study,
    analyses: Analyses,
    execution: Execution,
    follow: bool = False,
    most_poles: int | None = None,
) -> RunResult:
    """Return what a run of a study finds; see `run`.

    Its motion is traced where anything asks for it, or to `follow` it. With `most_poles`
    only so many poles are evaluated, and tables have the right size and wrong numbers.
    """
    if study.start is None and execution.engine != "auto":
        raise AnalysisError("run: engine does nothing without a simulation: give start")
    ledger = Timer()
    whole = study.mechanism
    solving = SEARCH if study.start is None else SIMULATION
    if execution.only_needed:
        study = replace(study, mechanism=needed_part(study, analyses))
    recorder: Any = execution.recorder
    folder = execution.folder
    with nullcontext() if folder is None else RunFolder.opened(folder) as place:
        asked = needs_of_each(analyses, study.mechanism)
        began = began_with(place, execution.unfinished)
        engine = execution.engine
        setting = execution.setting
        if engine == "auto" and began.get("engine") in ENGINES:
            engine = began["engine"]
        if execution.accuracy is not None and "setting" in began:
            with suppress(TypeError):  # of another version, which is refused below
                setting = Setting(**began["setting"])
        follow = follow or traced(study, analyses, execution)
        begin = partial(
            RecordingSession, [x.name for x in analyses], recorder, execution.log_every
        )
        stage: RecordingSession | None = None

        def seen(course: Sampling) -> None:
            nonlocal stage
            stage = stage or begin(course, job_of(course, analyses, asked).plans)
            stage.seen(course)

        looks_on = None if recorder is None or (place and place.unfinished) else seen
        with ledger.stage(solving):
            course = course_of(study, engine, follow, looks_on)
        shown = recorder is not None or study.verify is not None
        job = job_of(course, analyses, asked, execution.block, setting, shown)
        job = replace(job, most_poles=most_poles)
        if place is not None:
            files = [
                f"{stem}.{kind}"
                for stem in stems(job.tables())
                for kind in execution.formats or FILE_SIZE
            ]
            place.claim([*files, COLUMNS])
        standing, store = taken_up(job, place, execution.unfinished, execution.tables)
        ledger.before = standing.seconds
        if recorder is not None:
            with ledger.stage(RECORDING):
                stage = stage or begin(course, job.plans, standing.done)
                stage.solved(course)
        verifier = Verifier(job, study.verify) if study.verify else None
        with kept(job, place, standing, store) as after_block:
            blocks = job.source.blocks(job.block, standing.done)
            while True:
                with ledger.stage("positions"):
                    motion = next(blocks, None)
                if motion is None:
                    break
                before = standing.done
                fields, angles = evaluate_block(job, motion, standing, store, stage, ledger)
                if verifier is not None:
                    verifier.see(motion, fields, angles)
                standing.seconds = ledger.closed()
                after_block()
                done = standing.done
                total = len(course)
                if isinstance(store, StoredParts) and before < job.block <= done < total:
                    need_disk_for_run(store, done, total, execution.formats)
                if execution.progress is not None:
                    execution.progress(done, total)
            for table in job.motion_tables[1:]:
                job.hand_over(MOTION, table, course.events(), standing, store)
            summary = summary_of(job, standing)
            if stage is not None:
                summary["recording"] = stage.summary()
            if execution.only_needed:
                summary["part_of"] = left_out(whole, job.mechanism)
            summary["cost"] = actual_cost(job, standing, ledger, recorder)
            if verifier is not None:
                summary["verified"] = verifier.verdict(standing.failures)
                summary["warnings"] += faults(summary["verified"])
            if execution.accuracy is not None:
                summary["accuracy"] = {**execution.accuracy, "setting": str(job.setting)}
            declared = job.tables(standing.failures)
            result = result_of(
                declared, store, place, summary, study.degrees, execution.formats
            )
            return replace(result, failures=standing.failures)


def traced(study: Study, analyses: Analyses, execution: Execution) -> bool:
    """Return whether anything asks for the motion of a run."""
    return (
        execution.recorder is not None
        or study.verify is not None
        or study.assembly_mode is not None
        or execution.accuracy is not None
        or execution.setting != ORDINARY
        or any(analysis.reads_samples for analysis in analyses)
    )


def evaluate_block(
    job: RunPlan,
    motion: Motion,
    standing: RunState,
    store: StoredParts | InMemory | None,
    stage: RecordingSession | None,
    ledger: Timer,
) -> tuple[Fields, Angles]:
    """Evaluate a block for all analyses, and hand over what they make of it.

    Return its poles for each input, and the variables that go on. An analysis that fails
    is noted in `standing`, and not asked again.
    """
    course = job.course
    with ledger.stage(AXES):
        fields = job.fields(motion, standing.signs)
        angles = job.angles(motion, standing.angles)
    if stage is not None:
        with ledger.stage(RECORDING):
            stage.motion(motion)
    for analysis in job.analyses:
        is_asked = analysis.reads_samples or standing.done == 0
        if analysis.name in standing.failures or not is_asked:
            continue
        batch = job.batch(analysis, motion, fields, angles)
        declared = job.tables_of(analysis)
        try:
            with ledger.stage(f"analysis {analysis.name}"):
                tables = job.given(analysis, batch)
                before = standing.findings.get(analysis.name)
                findings = findings_of(analysis, batch, before)
            if stage is not None:
                with ledger.stage(RECORDING):
                    scenes = scenes_of(analysis, batch) or table_scenes(
                        declared, tables, batch
                    )
                    with faults_of(analysis.name, "showing its scene"):
                        stage.scenes(scenes, motion, analysis.name)
        except OutputError:
            raise
        except SpherekitError as problem:
            standing.failures[analysis.name] = str(problem)
            continue
        standing.findings[analysis.name] = findings
        for table in declared:
            job.hand_over(analysis.name, table, tables[table.name], standing, store, batch)
    for table in job.motion_tables[:1]:
        job.hand_over(MOTION, table, motion_rows(course, motion, fields), standing, store)
    standing.add(course.tracer, motion, fields)
    standing.done += motion.samples
    return fields, angles


def began_with(place: RunFolder | None, unfinished: Unfinished) -> Facts:
    """Return the identity of an unfinished run that is gone on with, else {}."""
    if place is None or unfinished != "resume" or not place.unfinished:
        return {}
    identity = place.read().get("identity")
    return identity if isinstance(identity, dict) else {}


def taken_up(
    job: RunPlan, place: RunFolder | None, unfinished: Unfinished, tables: bool
) -> tuple[RunState, StoredParts | InMemory | None]:
    """Return where the run stands, at the start or as it was stopped, and its store.

    Raises
    ------
    OutputError
        If there is unfinished work that is not to be gone on with, is of another run, or
        is damaged.
    """
    standing = RunState(
        [SignContinuation() for _ in job.requests], failures=dict(job.refused)
    )
    if place is None:
        return standing, InMemory() if tables else None
    if not place.unfinished or unfinished == "discard":
        place.discard()
        if job.is_single_block and not job.at_once:
            return standing, InMemory()  # a block that was not whole is begun again
        return standing, StoredParts(place.work, not job.is_single_block, ())
    state = place.read()
    try:
        differs = differences(state["identity"], job.identity)
        done = int(state["standing"]["done"])
        if not differs and unfinished == "resume":
            store = StoredParts(place.work, not job.is_single_block, state["store"])
            for name, declared in job.tables().items():
                for table in declared:
                    deque(store.pieces(name, table), maxlen=0)
            return RunState.restored(state["standing"]), store
    except (SpherekitError, LookupError, TypeError, ValueError, AttributeError) as problem:
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
def kept(
    job: RunPlan,
    place: RunFolder | None,
    standing: RunState,
    store: StoredParts | InMemory | None,
) -> Iterator[Callable[[], None]]:
    """Give what is called after each block; if the run is stopped, keep what was done."""
    done = standing.done

    def after_block() -> None:
        nonlocal done
        if place is not None and isinstance(store, StoredParts):
            place.write(
                {
                    "identity": job.identity,
                    "standing": standing.state(),
                    "store": store.state(),
                }
            )
            done = standing.done

    try:
        yield after_block
    except BaseException as error:
        if place is not None and done:
            error.add_note(
                f"{done} of {len(job.course)} samples are done and kept in {place.path}"
            )
        elif place is not None:
            why = f", since {listing(job.at_once)} looks at all samples at once"
            error.add_note(f"nothing was kept{why if job.at_once else ''}")
        raise
    if place is not None:
        place.discard()
