"""Running analyses over the motion of a mechanism, block by block of samples.

`run` is the public function. It turns its options into a `Study` and an `Execution` and
calls `run_study`, which carries out the whole run. A `RunPlan` says what is evaluated;
`checkpoints.py` saves and resumes a run.
"""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from typing import Any

from spherekit.argument_validation import checked
from spherekit.errors import AnalysisError, OutputError, SpherekitError
from spherekit.files.study import Study
from spherekit.positions.motion import Motion
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.batch import Batch, ContinuedAngles, PoleFields
from spherekit.runs.checkpoints import checkpointing, resume_or_start, unfinished_identity
from spherekit.runs.contract import AbstractAnalysis, Analyses
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.execution import Execution
from spherekit.runs.recording_session import RecordingSession
from spherekit.runs.resource_checks import need_disk_for_run
from spherekit.runs.result_checks import compute_findings, compute_scenes
from spherekit.runs.run_cost import AXES, RECORDING, SEARCH_STAGE, SIMULATION, Timer
from spherekit.runs.run_folder import RunFolder
from spherekit.runs.run_plan import (
    RunPlan,
    collect_needs,
    describe_left_out,
    extract_needed_part,
    make_run_plan,
    motion_rows,
)
from spherekit.runs.run_result import MOTION, RunResult, make_result, tables_by_file_stem
from spherekit.runs.run_state import RunState
from spherekit.runs.sampling import Sampling, make_sampling
from spherekit.runs.study_analyses import make_run_analyses
from spherekit.runs.study_options import Subject, apply_study_options, takes_study_options
from spherekit.runs.summary import measure_cost, summarize_run
from spherekit.runs.table_scenes import table_scenes
from spherekit.runs.table_store import StoredTables, TableStore
from spherekit.runs.verification import Verifier
from spherekit.runs.verification_text import (
    describe_resumption,
    verification_failures,
)
from spherekit.scenes.scene import Scene
from spherekit.symbolic.compiler import ENGINE_CHOICES
from spherekit.tables.table import COLUMNS, Table, TableData
from spherekit.tables.table_formats import TABLE_FORMATS, Format


@takes_study_options(Execution)
@checked(AnalysisError)
def run(
    subject: Subject,
    analyses: str | AbstractAnalysis | Sequence[str | AbstractAnalysis] = (),
    **options: Any,
) -> RunResult:
    """Run analyses over the motion of a mechanism.

    Nothing is written to disk unless you give a `folder`.

    Parameters
    ----------
    subject
        A study, or a mechanism. The mechanism must have one input per degree of freedom.
        Study and mechanism can be passed as an object, as the path of a file, or as the
        name of a shipped example.
    analyses
        Names such as ``"poles"`` or ``"poles:only=31+42"``, or analysis objects. By
        default the analyses of the study are run, or ``"poles"`` if it names none. If no
        analysis reads samples, the motion is usually not computed. It is still computed
        with any of these options: assembly_mode, recorder, accuracy, setting, duration,
        verify.
    options
        Options by name. They replace values of the study.

        - The names of the driven pairs: input_pair. The unit of angles in path and start:
          angle_unit.
        - The motion, as in `spherekit.files.study.Study`: samples, grid, path,
          assembly_mode, search, laws, duration, start, torque, tolerance, crossings,
          verify, degrees.
        - How the run is done, as in `spherekit.runs.execution.Execution`: folder,
          unfinished, formats, tables, engine, only_needed, recorder, log_every, progress,
          block, setting, accuracy.

    Returns
    -------
    RunResult
        The tables of all analyses, and a summary. If an analysis fails, its error message
        is in `failures`, and the remaining analyses are not affected.

    Raises
    ------
    AnalysisError, ModelError, PlanError, SolveError
        Before any sample is computed, if a name is unknown, the mechanism cannot be
        assembled, the time laws, the duration and the start contradict each other, or an
        analysis that reads all samples at once needs more memory than there is.
    EngineError
        If a compiled engine is chosen and heyoka is not installed.
    FileError
        If a study file has an invalid value. The message gives the file and the line.
    OutputError
        If the folder cannot be written, the disk is full, or another run writes to the
        folder. Finished blocks are kept in the folder, and the run can be resumed. The
        error is also raised if the folder has unfinished work, unless the option
        `unfinished` discards this work, or resumes work of the same run.
    """
    study, execution = apply_study_options("run", subject, options, Execution)
    if isinstance(analyses, str | AbstractAnalysis):
        analyses = [analyses]
    return run_study(study, make_run_analyses(study, analyses), execution)


def run_study(
    study: Study,
    analyses: Analyses,
    execution: Execution,
    computes_motion: bool = False,
    max_poles: int | None = None,
) -> RunResult:
    """Run analyses over the motion of a study.

    The run first finds the assembly modes, or solves the simulation. Blocks of samples are
    evaluated for all analyses, and a checkpoint is saved after each block. At the end the
    summary and, if there is a folder, the files are written. `run` lists the errors.

    Parameters
    ----------
    study
        The mechanism and its motion: samples of the inputs, time laws, or a simulation.
    analyses
        The analyses to run. Names and parameters are already checked.
    execution
        How the run is done: folder, engine, recorder and so on.
    computes_motion
        Whether to compute the configurations even if `needs_motion` is False. They are then
        in the table ``"motion"``.
    max_poles
        Number of poles to evaluate, if the run only measures the size of its tables; see
        `RunPlan`.
    """
    if study.start is None and execution.engine != "auto":
        raise AnalysisError(
            'run: the option "engine" applies only to a simulation; give the option '
            '"start" for a simulation, or leave "engine" out'
        )
    timer = Timer()
    whole_mechanism = study.mechanism
    if execution.only_needed:
        study = replace(study, mechanism=extract_needed_part(study, analyses))
    recorder: Any = execution.recorder

    # A run without a folder has no lock, no journal and no files.
    folder = execution.folder
    with nullcontext() if folder is None else RunFolder.open(folder) as run_folder:
        declared_needs = collect_needs(analyses, study.mechanism)

        # Engine "auto" and the setting for a required accuracy depend on measured times. A
        # resumed run takes both from its journal, so that its rows fit the rows that are
        # already stored.
        identity = unfinished_identity(run_folder, execution.unfinished)
        engine = execution.engine
        if engine == "auto" and identity.get("engine") in ENGINE_CHOICES:
            engine = identity["engine"]
        setting = execution.setting
        if execution.accuracy is not None and "setting" in identity:
            # The journal of another version can have other fields. `resume_or_start`
            # refuses such a journal with a message.
            with suppress(AnalysisError, TypeError):
                setting = Setting(**identity["setting"])

        recording_session: RecordingSession | None = None

        def show_simulation_progress(partial_sampling: Sampling) -> None:
            """Show the part of a simulation up to the time that is solved so far."""
            nonlocal recording_session
            if recording_session is None:
                partial_plan = make_run_plan(partial_sampling, analyses, declared_needs)
                recording_session = _start_recording(partial_plan, execution)
            recording_session.show_simulation_progress(partial_sampling)

        # A viewer shows the links while a simulation is solved. If the folder has
        # unfinished work, the recording starts later, because this run may be refused.
        has_unfinished_work = run_folder is not None and run_folder.has_unfinished_work
        shows_progress = recorder is not None and not has_unfinished_work
        with timer.stage(SEARCH_STAGE if study.start is None else SIMULATION):
            sampling = make_sampling(
                study,
                engine,
                follow=computes_motion or needs_motion(study, analyses, execution),
                on_progress=show_simulation_progress if shows_progress else None,
            )

        run_plan = make_run_plan(
            sampling,
            analyses,
            declared_needs,
            block_size=execution.block,
            setting=setting,
            shows_all_links=recorder is not None or study.verify is not None,
        )
        run_plan = replace(run_plan, max_poles=max_poles)
        if run_folder is not None:
            file_names = [*_table_files(run_plan, execution.formats), COLUMNS]
            run_folder.refuse_foreign_results(file_names)
        run_state, table_store = resume_or_start(
            run_plan, run_folder, execution.unfinished, execution.tables
        )
        timer.earlier_seconds = run_state.stage_seconds

        if recorder is not None:
            with timer.stage(RECORDING):
                if recording_session is None:
                    recording_session = _start_recording(
                        run_plan, execution, first_sample=run_state.samples_done
                    )
                recording_session.use_final_sampling(sampling)
        verifier = Verifier(run_plan, study.verify) if study.verify else None
        # Only samples from here on can be verified. It is 0 if no run is resumed.
        resumed_at = run_state.samples_done

        with checkpointing(run_plan, run_folder, run_state, table_store) as save_checkpoint:
            blocks = run_plan.source.blocks(run_plan.block_size, run_state.samples_done)
            while True:
                # The iterator computes the configurations of a block when it is asked for.
                with timer.stage("positions"):
                    motion = next(blocks, None)
                if motion is None:
                    break
                samples_before = run_state.samples_done
                pole_fields, continued_angles = evaluate_block(
                    run_plan,
                    motion,
                    run_state,
                    table_store=table_store,
                    recording_session=recording_session,
                    timer=timer,
                )
                if verifier is not None:
                    verifier.select_from_block(motion, pole_fields, continued_angles)
                run_state.stage_seconds = timer.total_seconds()
                save_checkpoint()

                # The first block shows how much space on the disk the whole run needs.
                samples_done = run_state.samples_done
                total = len(sampling)
                is_first = samples_before < run_plan.block_size <= samples_done < total
                if isinstance(table_store, StoredTables) and is_first:
                    need_disk_for_run(table_store, samples_done, total, execution.formats)
                if execution.progress is not None:
                    execution.progress(samples_done, total)

            # The first motion table has the configurations and was filled block by block. A
            # simulation has a second one, for its events.
            for table in run_plan.motion_tables[1:]:
                run_plan.append_rows(
                    MOTION, table, sampling.events(), run_state, table_store
                )

            summary = summarize_run(run_plan, run_state)
            if recording_session is not None:
                summary["recording"] = recording_session.summary()
            if execution.only_needed:
                summary["part_of"] = describe_left_out(whole_mechanism, run_plan.mechanism)
            summary["cost"] = measure_cost(run_plan, run_state, timer, recorder)
            if verifier is not None:
                verification = verifier.verify(run_state.failures)
                verification |= describe_resumption(resumed_at, len(sampling))
                summary["verified"] = verification
                summary["warnings"] += verification_failures(verification)
            if execution.accuracy is not None:
                summary["accuracy"] = {
                    **execution.accuracy,
                    "setting": str(run_plan.setting),
                }

            # The files are written before the checkpoints are removed. If that fails, for
            # instance because the disk is full, a run with stored rows can be resumed.
            result = make_result(
                run_plan.tables(failed=run_state.failures),
                table_store,
                run_folder,
                summary,
                study.degrees,
                execution.formats,
            )
            return replace(result, failures=run_state.failures)


def needs_motion(study: Study, analyses: Analyses, execution: Execution) -> bool:
    """Return whether anything in a run reads the configurations of its samples.

    If nothing does, and the samples are not times, the run skips the search for assembly
    modes (ways to assemble the mechanism).
    """
    return (
        execution.recorder is not None
        or study.verify is not None
        or study.assembly_mode is not None
        or execution.accuracy is not None
        or execution.setting != ORDINARY
        or any(analysis.reads_samples for analysis in analyses)
    )


def evaluate_block(
    run_plan: RunPlan,
    motion: Motion,
    run_state: RunState,
    table_store: TableStore | None,
    recording_session: RecordingSession | None,
    timer: Timer,
) -> tuple[PoleFields, ContinuedAngles]:
    """Evaluate all analyses for one block of samples, and store and record their results.

    An analysis that fails is noted in `run_state.failures` and skipped in later blocks. Its
    findings in earlier blocks are removed.

    Parameters
    ----------
    run_plan
        The analyses with their needs, and the poles to evaluate.
    motion
        Configurations of the block: n rows. All samples of the first assembly mode (way to
        assemble the mechanism) come first, then all samples of the next mode.
    run_state
        The state after the previous block. It is updated in place.
    table_store
        Receives the rows of the tables, if they are kept.
    recording_session
        Receives the scenes, if the run is recorded.
    timer
        Measures the time of each stage.

    Returns
    -------
    pole_fields
        Poles at the n rows, one field per input that moves while the other inputs are
        locked.
    continued_angles
        (n,) variables in rad by pair, without jumps of whole revolutions.

    Raises
    ------
    OutputError
        If the disk is full.
    """
    with timer.stage(AXES):
        pole_fields = run_plan.evaluate_poles(motion, run_state.sign_continuations)
        continued_angles = run_plan.continue_angles(motion, run_state.last_angles)
    if recording_session is not None:
        with timer.stage(RECORDING):
            recording_session.record_motion(motion)

    # Each analysis: its tables and findings, then its scenes if the run is recorded.
    is_first_block = run_state.samples_done == 0
    for analysis in run_plan.analyses:
        name = analysis.name
        if name in run_state.failures:
            continue
        # An analysis that reads no samples has the same result in every block.
        if not analysis.reads_samples and not is_first_block:
            continue
        batch = run_plan.make_batch(analysis, motion, pole_fields, continued_angles)
        declared_tables = run_plan.tables_of(analysis)
        try:
            with timer.stage(f"analysis {name}"):
                rows_by_table = run_plan.compute_tables(analysis, batch)
                findings = compute_findings(analysis, batch, run_state.findings.get(name))
            if recording_session is not None:
                with timer.stage(RECORDING):
                    _record_analysis(
                        recording_session,
                        analysis,
                        batch,
                        motion,
                        declared_tables,
                        rows_by_table,
                    )
        except OutputError:
            raise  # a full disk ends the run
        except SpherekitError as error:
            run_state.failures[name] = str(error)
            # Findings in earlier blocks do not hold for the whole run.
            run_state.findings.pop(name, None)
            continue

        # All parts of the analysis have succeeded for this block. Store and count its rows.
        run_state.findings[name] = findings
        for table in declared_tables:
            run_plan.append_rows(
                name, table, rows_by_table[table.name], run_state, table_store, batch
            )

    # There is no motion table if no motion is computed. The second one, the events of a
    # simulation, is stored at the end of the run.
    for table in run_plan.motion_tables[:1]:
        configuration_rows = motion_rows(run_plan.sampling, motion, pole_fields)
        run_plan.append_rows(MOTION, table, configuration_rows, run_state, table_store)
    run_state.count_block(run_plan.sampling.position_analysis, motion, pole_fields)
    # A run that only measures the size of its tables has no right numbers to report.
    if run_plan.max_poles is None:
        run_state.overview.add_block(run_plan.overview_plan, motion)
    run_state.samples_done += motion.samples
    return pole_fields, continued_angles


def _record_analysis(
    recording_session: RecordingSession,
    analysis: AbstractAnalysis,
    batch: Batch,
    motion: Motion,
    declared_tables: Sequence[Table],
    rows_by_table: Mapping[str, TableData],
) -> None:
    """Record the scenes of an analysis at a block, or its table columns if it has none."""
    scenes: Sequence[Scene] = compute_scenes(analysis, batch)
    if not scenes:
        scenes = table_scenes(declared_tables, rows_by_table, batch)
    with convert_plugin_errors(analysis.name, "showing its scene"):
        recording_session.record_scenes(scenes, motion, analysis.name)


def _start_recording(
    run_plan: RunPlan, execution: Execution, first_sample: int = 0
) -> RecordingSession:
    """Start the recording of samples from `first_sample` on. There must be a recorder."""
    assert execution.recorder is not None
    return RecordingSession(
        [analysis.name for analysis in run_plan.analyses],
        recorder=execution.recorder,
        every=execution.log_every,
        sampling=run_plan.sampling,
        plans=run_plan.plans,
        first_sample=first_sample,
    )


def _table_files(run_plan: RunPlan, formats: Sequence[Format] | None) -> list[str]:
    """Return the names of all table files that the run can write to its folder."""
    return [
        f"{file_stem}.{TABLE_FORMATS[name].ending}"
        for file_stem in tables_by_file_stem(run_plan.tables())
        for name in formats or TABLE_FORMATS
    ]
