"""The summary of a run: what was run, how far it came, what it found and what it took.

And what is said of rows that were verified in many digits.
"""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from spherekit.analysis.contract import Findings
from spherekit.analysis.link_scenes import plan_notes
from spherekit.analysis.result import MOTION, stem_of
from spherekit.analysis.running.cost import RECORDING, Timer, cost_of
from spherekit.analysis.running.recording import CountingRecorder, Recorder
from spherekit.analysis.running.run_plan import RunPlan
from spherekit.analysis.running.run_state import RunState
from spherekit.conventions import CLOSURE_TOLERANCE, listing
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


BOUNDED = {
    "directions": "pole directions",
    "rates": "rates",
    "rate_derivatives": "derivatives of rates",
}
"""What has an error bound, by its name in a verdict."""


def told(verdict: Mapping[str, Any]) -> list[str]:
    """Return a verdict in lines for people."""
    if "problem" in verdict:
        return [f"not verified: {verdict['problem']}"]
    if not verdict["rows"]:
        return ["verified: no row has a configuration and finite rates"]
    lines = [
        f"verified {verdict['rows']} rows in {verdict['digits']} digits "
        f"({verdict['seconds']:.1f} s): configurations within "
        f"{verdict['largest_distance_rad']:.1e} rad, conditioning up to "
        f"{verdict['largest_condition']:.1e}"
    ]
    variables = [item for item in verdict["columns"] if item["table"] == MOTION]
    shown = sorted(variables, key=lambda item: float(item["deviation"]))[-1:]
    shown += [item for item in verdict["columns"] if item["table"] != MOTION]
    for item in shown:
        if item["deviation"] == 0.0:
            continue
        lines.append(
            f"  {item['table']}.{item['column']}: off by {item['deviation']:.1e} "
            f"{item['unit']}".rstrip()
            + f" at {_place(item)} ({item['in_roundings']:.2g} roundings)"
        )
    for name, words in BOUNDED.items():
        judged = verdict[name]
        if judged["count"]:
            lines.append(
                f"  {judged['within_bound']} of {judged['count']} {words} lie within "
                f"their error bound; nearest to it {judged['error']:.1e}, "
                f"{judged['over_bound']:.2g} of the bound, at {_place(judged)}"
            )
    for row in verdict["without_reference"]:
        lines.append(f"  no reference at {_place(row)}: {row['status']}")
    worst = verdict["worst"]
    lines.append(
        f"  worst row: {_place(worst)}: {worst['column']} = {worst['value']!r}, "
        f"in {verdict['digits']} digits {worst['reference']!r}"
    )
    if verdict["not_verified"]:
        names = ", ".join(verdict["not_verified"])
        lines.append(
            f"  not verified, as they failed or find configurations of their own: {names}"
        )
    return lines


def faults(verdict: Mapping[str, Any]) -> list[str]:
    """Return what of a verdict is wrong beyond rounding, in sentences."""
    sentences = []
    if "problem" in verdict:
        sentences.append(f"verify: no row was verified: {verdict['problem']}")
    if verdict.get("beyond"):
        sentences.append(
            f"verify: {listing(verdict['beyond'])} deviate by more than rounding from "
            f"their values in {verdict['digits']} digits"
        )
    for name, words in BOUNDED.items():
        judged = verdict.get(name)
        if judged and judged["within_bound"] < judged["count"]:
            sentences.append(
                f"verify: {judged['count'] - judged['within_bound']} of "
                f"{judged['count']} {words} are off by more than their error bound"
            )
    if verdict.get("without_reference"):
        places = listing(
            f"{_place(row)} ({row['status']})" for row in verdict["without_reference"]
        )
        sentences.append(f"verify: no solution in many digits belongs to {places}")
    return sentences


def _place(item: Mapping[str, Any]) -> str:
    subject = "".join(f", {key} {name}" for key, name in item.get("subject", {}).items())
    return f"sample {item['sample']}, assembly mode {item['assembly_mode']}{subject}"
