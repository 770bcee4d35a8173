"""The summary of a run: what was run, how far it came, what it found and what it took."""

from dataclasses import asdict
from typing import Any

import numpy as np

from spherekit.analysis.contract import Findings
from spherekit.analysis.link_scenes import plan_notes
from spherekit.analysis.result import stem_of
from spherekit.analysis.running.cost import RECORDING, Timer, cost_of
from spherekit.analysis.running.recording import CountingRecorder, Recorder
from spherekit.analysis.running.run_plan import RunPlan
from spherekit.analysis.running.run_state import RunState
from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.files.write import mechanism_hash
from spherekit.planning.rigidity import graph_mobility
from spherekit.version import __version__


def summary_of(job: RunPlan, standing: RunState) -> dict[str, Any]:
    """Return what is to be said of a run that is done, ready for JSON."""
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
        "inputs_unit": "rad",
        "sampling": "x".join(map(str, course.shape)),
        **course.summary(),
        "samples": standing.done,
        "samples_in_a_block": job.block,
        "mobility": {"graph": graph_mobility(mechanism), "rank": tally.rank},
        "redundant_constraints": tally.redundant,
        "groups": [group.kind for group in tracer.assembly.groups],
        "plans": {mechanism.pairs[p.input].name: plan_notes(p) for p in job.plans},
        "assembly_modes": [
            {
                "number": item.number,
                "mode": item.label,
                **({"name": item.name} if item.name else {}),
                "status": tally.of_assembly_mode(item.number),
            }
            for item in tracer.assembly_modes
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
                "failed_rows": tally.failed_rows(analysis.name),
                "cites": list(analysis.cites),
                "findings": dict(findings.get(analysis.name, Findings()).figures),
            }
            for analysis in job.analyses
        ],
        "remarks": [
            f"{name}: {text}"
            for name, finding in findings.items()
            for text in finding.remarks
        ],
        "warnings": [
            *course.warnings,
            *(
                f"{name}: {text}"
                for name, finding in findings.items()
                for text in finding.warnings
            ),
        ],
    }


def actual_cost(
    job: RunPlan, standing: RunState, ledger: Timer, recorder: Recorder | None
) -> dict[str, Any]:
    """Return what was evaluated, made and logged; a recorder that counts is finished."""
    tables = {
        stem_of(name, declared, table): (
            standing.rows[name, table.name],
            len(table.columns),
        )
        for name, declared in job.tables(standing.failures).items()
        for table in declared
    }
    logged = None
    if isinstance(recorder, CountingRecorder):
        with ledger.stage(RECORDING):
            recorder.finish()
        logged = recorder.cost
    tally = standing.tally
    counts = tally.configurations, tally.by_equations
    cost = cost_of(ledger, job.requests, *counts, tables, logged)
    return cost | job.course.cost()
