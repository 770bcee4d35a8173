"""Running analyses: what they need is planned, evaluated in blocks, and handed over."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from spherekit.analysis.block import evaluate_block
from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.cost import RECORDING, Ledger
from spherekit.analysis.course import DEFAULT_TOLERANCE, course_of
from spherekit.analysis.forecast import ENOUGH, forecast
from spherekit.analysis.job import Job, job_of
from spherekit.analysis.journal import Unfinished
from spherekit.analysis.needed import left_out, needed_part
from spherekit.analysis.recording import Recorder, Stage, thinning_of
from spherekit.analysis.registry import create
from spherekit.analysis.result import RunResult, result_of
from spherekit.analysis.room import need_disk
from spherekit.analysis.setting import ORDINARY, Setting
from spherekit.analysis.store import OnDisk
from spherekit.analysis.summary import actual_cost, summary_of
from spherekit.analysis.tables import FILE_SIZE, Format
from spherekit.analysis.unfinished import engine_of, kept, opened, setting_of, taken_up
from spherekit.analysis.verify import Verifier, faults
from spherekit.checked import checked
from spherekit.engine.kernels import Engine
from spherekit.errors import AnalysisError
from spherekit.model.laws import Law, Start
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import DEFAULT_SAMPLES
from spherekit.sphere.rotation import Floats

Progress = Callable[[int, int], None]


@checked(AnalysisError)
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
        Which inputs and assembly modes; see `spherekit.motion.motion.Tracer`. No motion is
        traced where no analysis reads samples, unless a `branch`, a `recorder`, times or
        what is to be verified ask for one.
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
    for name, number in (("block", block), ("verify", verify), ("log_every", log_every)):
        if number is not None and number < 1:
            raise AnalysisError(f"run: {name} must be at least 1, not {number}")
    if start is None and engine != "auto":
        raise AnalysisError("run: engine does nothing without a simulation: give start")
    if folder is None and unfinished != "refuse":
        raise AnalysisError("run: unfinished does nothing without a folder")
    ledger, whole = Ledger(), mechanism
    if isinstance(analyses, str | AbstractAnalysis):
        analyses = [analyses]
    chosen = [create(item) if isinstance(item, str) else item for item in analyses]
    if only_needed:
        mechanism = needed_part(mechanism, chosen, input_pair, start)
    with opened(folder) as place:
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
                engine=engine_of(place, unfinished, engine),
                follow=bool(
                    recorder is not None
                    or verify
                    or branch is not None
                    or accuracy is not None
                    or setting != ORDINARY
                    or any(analysis.reads_samples for analysis in chosen)
                ),
            )
        if accuracy is not None:
            setting = setting_of(place, unfinished, setting)
        job = job_of(course, chosen, block, setting, recorder is not None or bool(verify))
        standing, store = taken_up(job, place, unfinished, tables)
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
        with kept(job, place, standing, store) as after_block:
            blocks = job.evaluation.blocks(job.block, standing.done)
            for motion in ledger.each("positions", blocks):
                evaluate_block(job, motion, standing, store, stage, verifier, ledger)
                standing.seconds = ledger.closed()
                after_block()
                is_first = standing.done == job.block
                if is_first and not job.is_single_block and isinstance(store, OnDisk):
                    need_disk(store, standing.done, len(course), formats)
                if progress is not None:
                    progress(standing.done, len(course))
            summary = summary_of(job, standing)
            if stage is not None:
                summary["recording"] = stage.summary()
            if only_needed:
                summary["part_of"] = left_out(whole, course.tracer.mechanism)
            summary["cost"] = actual_cost(job, standing, ledger, recorder)
            summary["cost"]["predicted"] = expected
            if verifier is not None:
                summary["verified"] = verifier.verdict(standing.failures)
                summary["warnings"] += faults(summary["verified"])
            if accuracy is not None:
                summary["accuracy"] = {**accuracy, "setting": str(job.evaluation.setting)}
            declared, failures = job.tables(standing.failures), standing.failures
            return result_of(declared, failures, store, place, summary, degrees, formats)


def _expected(job: Job, ledger: Ledger) -> dict[str, Any] | None:
    """Return the predicted cost of a run that is worth a prediction."""
    course, samples = job.course, len(job.course)
    if course.simulation is not None or samples * len(course.tracer.branches) < ENOUGH:
        return None
    with ledger.stage("forecast"):
        return forecast(course, job.analyses, job.needs, job.requests, samples, job.block)
