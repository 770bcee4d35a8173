"""Running analyses: what they need is planned, evaluated in blocks, and handed over."""

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Protocol

import numpy as np

from spherekit.analysis.contract import (
    AbstractAnalysis,
    Batch,
    Findings,
    Needs,
    run_status,
)
from spherekit.analysis.course import EVENTS, Course, course_of
from spherekit.analysis.evaluation import Evaluation
from spherekit.analysis.registry import create
from spherekit.analysis.result import MOTION, AnalysisResult, RunResult
from spherekit.analysis.scene import Scene
from spherekit.analysis.setting import ORDINARY, Setting
from spherekit.analysis.stage import (
    Shape,
    link_shapes,
    motion_scenes,
    plan_notes,
    static_scene,
)
from spherekit.analysis.tables import (
    BRANCH,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    TIME,
    Column,
    Table,
    TableData,
    concatenate,
    input_columns,
)
from spherekit.analysis.verify import Verifier, faults
from spherekit.conventions import CLOSURE_TOLERANCE, STATUS_MEANING, Status
from spherekit.errors import AnalysisError, SpherekitError
from spherekit.files.write import mechanism_hash
from spherekit.model.laws import Law, Start
from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import rank_mobility, redundancy
from spherekit.motion.motion import (
    BLOCK,
    DEFAULT_SAMPLES,
    Motion,
    status_counts,
)
from spherekit.planning.inputs import driven_pairs
from spherekit.planning.poles import Plan, pole_of
from spherekit.planning.rigidity import graph_mobility
from spherekit.rates.field import PoleField, SignMemory
from spherekit.rates.request import Request, request
from spherekit.sphere.rotation import Floats
from spherekit.version import __version__


class Recorder(Protocol):
    """What a run tells a viewer while it goes on; see `spherekit.view`."""

    def start(
        self,
        scenes: Sequence[Scene],
        inputs: Floats | None,
        *,
        branches: Mapping[int, str] | None = None,
        properties: Mapping[str, str] | None = None,
        focus: Floats | None = None,
        row: int | None = None,
        times: Floats | None = None,
    ) -> None:
        """Take what does not move, all inputs (samples,) rad, the branches' names.

        `focus` (3,) is the unit vector to the middle of the mechanism. Samples of a grid
        come in rows of `row` neighbours; `times` (samples,) s are given instead of inputs
        where the samples are times.
        """

    def log(
        self,
        scene: Scene,
        samples: Any,
        inputs: Floats | None = None,
        times: Floats | None = None,
    ) -> None:
        """Take one block of one branch: sample numbers (k,), inputs (k,) rad, times s."""


Progress = Callable[[int, int], None]

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
    recorder: Recorder | None = None,
    progress: Progress | None = None,
    block: int = BLOCK,
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
    start, torque, tolerance
        State of the only input at t = 0: the motion over `duration` then follows from the
        loads and the `torque` at the input, as `spherekit.dynamics.forward.simulate` finds
        it from the `branch` (default 0) among all that there are.
    recorder
        Receives the scenes block by block while the run goes on.
    progress
        Called with samples done and samples in all after each block.
    block
        Samples evaluated at once; all, if an analysis wants whole batches.
    verify
        How many rows to compute once more in 50 digits; what that says is in the
        summary under `verified`, see `spherekit.analysis.verify`.
    setting, accuracy
        How samples are computed, and what is known of the errors of that, for the summary.

    Returns
    -------
    RunResult
        An analysis that fails is in its `failures`; the others are not affected.

    Raises
    ------
    AnalysisError, ModelError, PlanError, SolveError
        Before any sample is computed, for unknown names, impossible mechanisms, or times
        that do not fit together.
    """
    started = time.perf_counter()
    if isinstance(analyses, str | AbstractAnalysis):
        analyses = [analyses]
    chosen = [create(item) if isinstance(item, str) else item for item in analyses]
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
    )
    tracer = course.tracer
    mechanism = tracer.mechanism
    own = [analysis.needs(mechanism) for analysis in chosen]
    _need_times(course, chosen, own)
    needs = needs_of(mechanism, chosen)
    wanted = requests_for(mechanism, needs, tracer.by_rank)
    plans = tuple(item.plan for item in wanted)
    planned = time.perf_counter()
    collected: dict[str, list[dict[str, TableData]]] = {a.name: [] for a in chosen}
    findings: dict[str, Findings] = {}
    failures: dict[str, str] = {}
    motions: list[Motion] = []
    fields: list[tuple[PoleField, ...]] = []
    memories = [SignMemory() for _ in wanted]
    inputs, times = course.inputs, course.t
    total = len(course)
    shapes: list[Shape] = []
    if recorder is not None:
        shapes = link_shapes(mechanism)
        recorder.start(
            [static_scene(plans, shapes)],
            inputs[:, 0] if inputs.shape[1] == 1 and times is None else None,
            branches=course.titles,
            properties={
                "spherekit": __version__,
                "mechanism_hash": mechanism_hash(mechanism),
                "analyses": ", ".join(analysis.name for analysis in chosen),
            },
            focus=course.middle,
            row=course.shape[-1] if len(course.shape) > 1 else None,
            times=times,
        )

    def attempt(
        analysis: AbstractAnalysis,
        what: Needs,
        motion: Motion,
        found: tuple[PoleField, ...],
    ) -> None:
        if analysis.name in failures:
            return
        batch = Batch(mechanism, plans, what, motion, found, course.timed, tracer)
        try:
            tables = dict(analysis.compute(batch))
            for table in analysis.tables:
                table.of(mechanism).check(tables[table.name], analysis.name)
            collected[analysis.name].append(tables)
            if not analysis.rowwise:
                findings[analysis.name] = analysis.findings(batch)
            if recorder is not None:
                _log(recorder, analysis.scene(batch), motion, course.timed)
        except SpherekitError as problem:
            failures[analysis.name] = str(problem)
        except Exception:  # a plugin's own fault must not lose the others' results
            failures[analysis.name] = traceback.format_exc()

    verifier = (
        Verifier(plans, wanted, chosen, own, total, verify, course.timed)
        if verify
        else None
    )
    done = 0
    if not all(analysis.rowwise for analysis in chosen):
        block = total
    evaluation = Evaluation(setting, course, wanted, needs, all_links=True)
    for motion in evaluation.blocks(block):
        found = evaluation.fields(motion, memories)
        if recorder is not None:
            _log(
                recorder, motion_scenes(motion, shapes, course.timed), motion, course.timed
            )
        for analysis, what in zip(chosen, own, strict=True):
            attempt(analysis, what, motion, found)
        if verifier is not None:
            verifier.see(motion, found)
        motions.append(motion)
        fields.append(found)
        done += motion.samples
        if progress is not None:
            progress(done, total)
    results = {MOTION: _motion_result(course, motions, fields)}
    for analysis in chosen:
        if analysis.name not in failures and collected[analysis.name]:
            parts = collected[analysis.name]
            results[analysis.name] = _gather(analysis, mechanism, parts)
    finished = time.perf_counter()
    summary = _summary(
        mechanism, course, plans, chosen, motions, fields, failures, findings
    )
    summary["seconds"] = {
        "plan_and_branches": planned - started,
        "evaluate": finished - planned,
    }
    if verifier is not None:
        summary["verified"] = verifier.verdict()
        summary["warnings"] += faults(summary["verified"])
    if accuracy is not None:
        summary["accuracy"] = dict(accuracy)
    return RunResult(results, failures, summary)


def _need_times(
    course: Course, chosen: Sequence[AbstractAnalysis], own: Sequence[Needs]
) -> None:
    for analysis, what in zip(chosen, own, strict=True):
        if what.time and course.timing is None:
            raise AnalysisError(
                f"{analysis.name}: needs time, but with several inputs nothing says how "
                "they move; give a law for every input, and a duration"
            )


def _log(recorder: Recorder, scenes: Sequence[Scene], motion: Motion, timed: bool) -> None:
    k = motion.samples
    single = motion.inputs.shape[1] == 1 and not timed
    inputs = motion.q[:k] if single else None
    times = motion.timing.t[:k] if motion.timing is not None and timed else None
    for scene in scenes:
        if scene.rows is None:
            recorder.log(scene, motion.sample[:k], inputs, times)
        else:
            own = (
                None
                if line is None
                else np.linspace(line[0], line[-1], scene.rows + 1)[:-1]
                for line in (inputs, times)
            )
            recorder.log(scene, np.arange(scene.rows), *own)


def _gather(
    analysis: AbstractAnalysis, mechanism: Mechanism, parts: list[dict[str, TableData]]
) -> AnalysisResult:
    data = {}
    for table in analysis.tables:
        whole = concatenate([part[table.name] for part in parts])
        data[table.name] = _in_order(whole) if len(parts) > 1 else whole
    tables = tuple(table.of(mechanism) for table in analysis.tables)
    return AnalysisResult(analysis.name, tables, data)


def _in_order(data: TableData) -> TableData:
    """Rows by branch, then sample; rows of one sample keep their order."""
    if "branch" not in data or "sample" not in data:
        return data
    order = np.lexsort((data["sample"], data["branch"]))
    return {name: np.asarray(values)[order] for name, values in data.items()}


def _motion_result(
    course: Course, motions: list[Motion], fields: list[tuple[PoleField, ...]]
) -> AnalysisResult:
    mechanism = course.tracer.mechanism
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
    parts: list[TableData] = []
    for motion, found in zip(motions, fields, strict=True):
        part: dict[str, Any] = {"sample": motion.sample, "branch": motion.branch}
        if course.timed and motion.timing is not None:
            part["t"] = motion.timing.t
        part |= input_columns(mechanism, motion.inputs)
        for number, column in enumerate(variables):
            part[column.name] = motion.values[:, number]
        part["residual"] = motion.residual
        part["status"] = run_status(motion, found)
        parts.append(part)
    whole = _in_order(concatenate(parts))
    if course.simulation is None:
        return AnalysisResult(MOTION, (table,), {MOTION: whole})
    data = {MOTION: whole, EVENTS.name: course.events()}
    return AnalysisResult(MOTION, (table, EVENTS), data)


def _summary(
    mechanism: Mechanism,
    course: Course,
    plans: tuple[Plan, ...],
    chosen: Sequence[AbstractAnalysis],
    motions: list[Motion],
    fields: list[tuple[PoleField, ...]],
    failures: dict[str, str],
    findings: dict[str, Findings],
) -> dict[str, Any]:
    tracer = course.tracer
    status = np.concatenate(
        [run_status(motion, found) for motion, found in zip(motions, fields, strict=True)]
    )
    every_field = [field for found in fields for field in found]
    poles = np.concatenate(
        [
            codes[f.status == Status.OK]
            for f in every_field
            for codes in f.pole_status.values()
        ]
        or [np.zeros(0, dtype=np.int8)]
    )
    residual = np.concatenate([motion.residual for motion in motions])
    branch = np.concatenate([motion.branch for motion in motions])
    closed = np.isfinite(residual)
    error = _largest([e for f in every_field for e in f.error.values()])
    by_equations = [float(np.mean(f.by_equations)) for f in every_field]
    rank, repeated = None, None
    for motion in motions:
        if np.any(motion.status == Status.OK):
            vectors = motion.vectors[int(np.argmax(motion.status == Status.OK))]
            rank = int(rank_mobility(tracer.solver.closure.tree, vectors[None])[0])
            found = redundancy(tracer.solver.closure.tree, vectors)
            names = [mechanism.pairs[pair].name for pair in found.pairs]
            repeated = {"count": found.count, "pairs": names}
            break
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
        "samples": sum(motion.samples for motion in motions),
        "mobility": {"graph": graph_mobility(mechanism), "rank": rank},
        "redundant_constraints": repeated,
        "groups": [group.kind for group in tracer.assembly.groups],
        "plans": {mechanism.pairs[plan.input].name: plan_notes(plan) for plan in plans},
        "branches": [
            {
                "number": item.number,
                "mode": item.label,
                "status": status_counts(status[branch == item.number]),
            }
            for item in tracer.branches
        ],
        "search": tracer.search,
        "status": status_counts(status),
        "pole_status": status_counts(poles),
        "status_meaning": {
            Status(code).name: STATUS_MEANING[Status(code)]
            for code in np.unique(np.concatenate([status, poles]))
        },
        "closure_tolerance_rad": CLOSURE_TOLERANCE,
        "errors_reached": {
            "largest_closure_residual_rad": float(np.max(residual[closed]))
            if np.any(closed)
            else None,
            "largest_direction_error_bound_rad": error,
            "fraction_by_velocity_equations": float(np.mean(by_equations))
            if by_equations
            else None,
        },
        "analyses": [
            {
                "name": analysis.name,
                "version": analysis.version,
                "parameters": asdict(analysis),  # type: ignore[call-overload]
                "failed": analysis.name in failures,
                "cites": list(analysis.cites),
                "findings": dict(findings.get(analysis.name, Findings()).figures),
            }
            for analysis in chosen
        ],
        "remarks": [
            f"{name}: {text}" for name, own in findings.items() for text in own.remarks
        ],
        "warnings": [
            f"{name}: {text}" for name, own in findings.items() for text in own.warnings
        ],
    }


def _largest(arrays: Sequence[Floats]) -> float | None:
    finite = [array[np.isfinite(array)] for array in arrays]
    finite = [array for array in finite if len(array)]
    return float(max(np.max(array) for array in finite)) if finite else None
