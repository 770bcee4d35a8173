"""Running analyses: what they need is planned, evaluated in blocks, and handed over."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.execution import Execution
from spherekit.analysis.folder.on_disk import OnDisk
from spherekit.analysis.folder.resource_check import need_disk
from spherekit.analysis.folder.unfinished import (
    engine_of,
    kept,
    opened,
    setting_of,
    taken_up,
)
from spherekit.analysis.options import Subject, study_of, takes
from spherekit.analysis.result import RunResult, file_names, result_of
from spherekit.analysis.running.block import add_events, evaluate_block
from spherekit.analysis.running.cost import RECORDING, SEARCH, SIMULATION, Timer
from spherekit.analysis.running.needed import left_out, needed_part
from spherekit.analysis.running.recording import RecordingSession, thinning_of
from spherekit.analysis.running.run_plan import Asked, job_of
from spherekit.analysis.running.sampling import courses_of
from spherekit.analysis.running.setting import ORDINARY
from spherekit.analysis.running.summary import actual_cost, summary_of
from spherekit.analysis.running.verdict_words import faults
from spherekit.analysis.running.verify import Verifier
from spherekit.analysis.study import chosen
from spherekit.analysis.tables import Files
from spherekit.checked import checked
from spherekit.errors import AnalysisError
from spherekit.model.study import Study


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
        `spherekit.model.study.Study` (what the run goes through: samples, grid, path,
        assembly_mode, search, laws, duration, start, torque, tolerance, crossings,
        verify, degrees)
        and of `spherekit.analysis.execution.Execution` (how it is done: folder, unfinished,
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
    study: Study, analyses: Sequence[AbstractAnalysis], execution: Execution
) -> RunResult:
    """Return what a run of a study finds; see `run`."""
    for name, value, default in (
        ("engine", execution.engine, "auto"),
        ("crossings", study.crossings, "end"),
    ):
        if study.start is None and value != default:
            raise AnalysisError(
                f"run: {name} does nothing without a simulation: give start"
            )
    ledger, whole = Timer(), study.mechanism
    solving = SEARCH if study.start is None else SIMULATION
    if execution.only_needed:
        study = replace(study, mechanism=needed_part(study, analyses))
    recorder = execution.recorder
    with opened(execution.folder) as place:
        asked = Asked.of(analyses, study.mechanism)
        engine = engine_of(place, execution.unfinished, execution.engine)
        follow = traced(study, analyses, execution)
        with ledger.stage(solving):
            pending = courses_of(study, engine, follow)
            if asked.at_once or study.verify:  # only the whole course is of use
                pending = iter(deque(pending, maxlen=1))
            course = next(pending)
        setting, shown = execution.setting, recorder is not None or study.verify is not None
        if execution.accuracy is not None:
            setting = setting_of(place, execution.unfinished, setting)
        job = job_of(course, asked, execution.block, setting, shown)
        if place is not None:
            place.claim(file_names(job.tables(), execution.formats))
        standing, store = taken_up(job, place, execution.unfinished, execution.tables)
        ledger.before = standing.seconds
        stage = None
        if recorder is not None:
            with ledger.stage(RECORDING):
                stage = RecordingSession(
                    course,
                    job.plans,
                    [analysis.name for analysis in analyses],
                    recorder,
                    thinning_of(course, execution.log_every),
                    standing.done,
                )
        verifier = Verifier(job, study.verify) if study.verify else None
        with kept(job, place, standing, store) as after_block:
            while True:
                blocks = job.evaluation.blocks(job.block, standing.done)
                for motion in ledger.each("positions", blocks):
                    before = standing.done
                    fields, angles = evaluate_block(
                        job, motion, standing, store, stage, ledger
                    )
                    if verifier is not None:
                        verifier.see(motion, fields, angles)
                    standing.seconds = ledger.closed()
                    after_block(job)
                    done, total = standing.done, job.course.total
                    if isinstance(store, OnDisk) and before < job.block <= done < total:
                        need_disk(store, done, total, execution.formats)
                    if execution.progress is not None:
                        execution.progress(done, total)
                with ledger.stage(solving):
                    following = next(pending, None)
                if following is None:
                    break
                superseded = following.run is not job.course.run
                if superseded:
                    standing.begin_again(asked.refused)
                    if store is not None:
                        store.clear()
                if stage is not None:
                    stage.goes_on(following, superseded and not job.course.going_on)
                job = job.over(following)
            if stage is not None:
                with ledger.stage(RECORDING):
                    stage.finish()
            add_events(job, standing, store)
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
                reached = {"setting": str(job.evaluation.setting)}
                summary["accuracy"] = {**execution.accuracy, **reached}
            declared, failures = job.tables(standing.failures), standing.failures
            files = Files(study.degrees, execution.formats)
            return result_of(declared, failures, store, place, summary, files)


def traced(
    study: Study, analyses: Sequence[AbstractAnalysis], execution: Execution
) -> bool:
    """Return whether anything asks for the motion of a run."""
    return (
        execution.recorder is not None
        or study.verify is not None
        or study.assembly_mode is not None
        or execution.accuracy is not None
        or execution.setting != ORDINARY
        or any(analysis.reads_samples for analysis in analyses)
    )
