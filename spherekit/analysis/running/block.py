"""One block of a run: evaluated, given to all analyses, and handed over."""

from collections.abc import Mapping

from spherekit.analysis.batch import Batch
from spherekit.analysis.computed import computed, findings_of, scenes_of
from spherekit.analysis.faults import faults_of
from spherekit.analysis.folder.on_disk import OnDisk
from spherekit.analysis.result import MOTION
from spherekit.analysis.rows import InMemory
from spherekit.analysis.running.cost import AXES, RECORDING, Timer
from spherekit.analysis.running.kernel_columns import UnreadField
from spherekit.analysis.running.motion_table import motion_rows
from spherekit.analysis.running.recording import RecordingSession
from spherekit.analysis.running.run_plan import RunPlan
from spherekit.analysis.running.run_state import RunState
from spherekit.analysis.running.sampling import EVENTS
from spherekit.analysis.table_scenes import table_scenes
from spherekit.errors import OutputError, SpherekitError
from spherekit.motion.motion import Motion
from spherekit.rates.pole_field import PoleField
from spherekit.sphere.rotation import Floats


def evaluate_block(
    job: RunPlan,
    motion: Motion,
    standing: RunState,
    store: OnDisk | InMemory | None,
    stage: RecordingSession | None,
    ledger: Timer,
) -> tuple[tuple[PoleField | UnreadField, ...], Mapping[str, Floats]]:
    """Evaluate a block for all analyses, and hand over what they make of it.

    Return its poles for each input, and the variables that go on. An analysis that fails
    is noted in `standing`, and not asked again.
    """
    course = job.course
    with ledger.stage(AXES):
        fields = job.evaluation.fields(motion, standing.signs)
        angles = job.evaluation.angles(motion, standing.angles)
    if stage is not None:
        with ledger.stage(RECORDING):
            stage.motion(motion)
    for analysis, what in zip(job.analyses, job.needs, strict=True):
        is_asked = analysis.reads_samples or standing.done == 0
        if analysis.name in standing.failures or not is_asked:
            continue
        batch = Batch(
            job.mechanism,
            job.plans,
            what,
            motion,
            fields,
            angles,
            course.timed,
            course.tracer,
            lambda: course.extent,
        )
        try:
            with ledger.stage(f"analysis {analysis.name}"):
                tables = computed(analysis, job.tables_of(analysis), batch)
                before = standing.findings.get(analysis.name)
                findings = findings_of(analysis, batch, before)
            if stage is not None:
                with ledger.stage(RECORDING):
                    scenes = scenes_of(analysis, batch)
                    scenes = scenes or table_scenes(job.tables_of(analysis), tables, batch)
                    with faults_of(analysis.name, "showing its scene"):
                        stage.scenes(scenes, motion, analysis.name)
        except OutputError:
            raise
        except SpherekitError as problem:
            standing.failures[analysis.name] = str(problem)
            continue
        standing.findings[analysis.name] = findings
        for table, stored in zip(
            job.tables_of(analysis), job.stored_tables_of(analysis), strict=True
        ):
            if store is not None:
                named = stored.named(tables[table.name], job.names)
                store.add(analysis.name, stored, named)
            standing.count(analysis.name, table.name, tables[table.name])
            standing.tally.add_rows(analysis.name, table, tables[table.name], batch)
    if job.motion_tables:
        stored = job.motion_tables[0]
        rows = stored.named(motion_rows(course, motion, fields), job.names)
        if store is not None:
            store.add(MOTION, stored, rows)
        standing.count(MOTION, MOTION, {"sample": motion.sample})
    standing.tally.add(course.tracer, motion, fields)
    standing.done += motion.samples
    return fields, angles


def add_events(job: RunPlan, standing: RunState, store: OnDisk | InMemory | None) -> None:
    """Hand over what happened in the course of a simulation, known when it is whole."""
    if job.course.simulation is not None:
        events = job.course.events()
        if store is not None:
            store.add(MOTION, EVENTS.of(job.mechanism), events)
        standing.count(MOTION, EVENTS.name, events)
