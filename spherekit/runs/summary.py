"""The summary of a run: what was run, its results, and the time that it took."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from spherekit.conventions import Facts
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.planning.mobility import graph_mobility
from spherekit.runs.contract import Findings
from spherekit.runs.run_cost import RECORDING, Timer, counts_of
from spherekit.runs.run_plan import RunPlan
from spherekit.runs.run_result import MOTION, stems
from spherekit.runs.run_state import BY_EQUATIONS, MODE, ROWS, RunState
from spherekit.runs.sampling import Sampling
from spherekit.tolerances import CLOSURE_TOLERANCE
from spherekit.version import __version__
from spherekit.wording import listing


def with_counts(texts: Iterable[str]) -> list[str]:
    """Return each text once, in order, with a count if it is said several times."""
    return [
        text if count == 1 else f"{text} ({count} times)"
        for text, count in Counter(texts).items()
    ]


def summary_of(job: RunPlan, standing: RunState) -> Facts:
    """Return what is to be said of a run that is done, ready for JSON."""
    course, mechanism, findings = job.course, job.mechanism, standing.findings
    tracer = course.tracer
    told = {
        kind: [
            f"{name}: {text}"
            for name, item in findings.items()
            for text in with_counts(getattr(item, kind))
        ]
        for kind in ("remarks", "warnings")
    }
    return {
        "spherekit": __version__,
        "numpy": np.__version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "inputs": dict(zip(tracer.inputs, course.extents[0].T.tolist(), strict=True)),
        "inputs_unit": "rad",
        "sampling": "x".join(map(str, course.shape)),
        **course.summary(),
        "samples": standing.done,
        "samples_in_a_block": job.block,
        "mobility": {"graph": graph_mobility(mechanism), "rank": standing.rank},
        "redundant_constraints": standing.redundant,
        "groups": [group.kind for group in tracer.assembly.groups],
        "plans": {
            mechanism.pairs[plan.input].name: {
                "passes": max(plan.rounds.values(), default=0),
                "poles": len(plan.rounds),
                "irreducible_parts": [[*map(plan.name, x.links)] for x in plan.blocks],
            }
            for plan in job.plans
        },
        "assembly_modes": [
            {
                "number": item.number,
                "mode": item.label,
                **({"name": item.name} if item.name else {}),
                "status": standing.counted(MODE, str(item.number)),
            }
            for item in tracer.assembly_modes
        ],
        "search": tracer.search,
        "crossings": tracer.crossings,
        "mode_meetings": _mode_meetings(course),
        **standing.statuses(),
        "closure_tolerance_rad": CLOSURE_TOLERANCE,
        "errors_reached": standing.errors(),
        "analyses": [
            {
                "name": analysis.name,
                "version": analysis.version,
                "parameters": asdict(analysis),  # type: ignore[call-overload]
                "failed": analysis.name in standing.failures,
                "failed_rows": standing.failed_rows(analysis.name),
                "cites": analysis.cites,
                "findings": dict(findings.get(analysis.name, Findings()).figures),
            }
            for analysis in job.analyses
        ],
        "remarks": told["remarks"],
        "warnings": [*course.warnings, *told["warnings"]],
    }


def _mode_meetings(course: Sampling) -> list[Facts]:
    """Return where curves of modes cross, ready for JSON; simulations have events."""
    if course.simulation is not None:
        return []
    tracer = course.tracer
    meetings = zip(tracer.mode_meetings, tracer.meeting_sentences, strict=True)
    return [{**meeting.facts, "sentence": sentence} for meeting, sentence in meetings]


def actual_cost(job: RunPlan, standing: RunState, ledger: Timer, recorder: Any) -> Facts:
    """Return what was evaluated, made and logged, ready for JSON.

    A recorder that counts is finished. Bytes of tables are added when files are written.
    """
    logged = {}
    if hasattr(recorder, "finish"):
        with ledger.stage(RECORDING):
            recorder.finish()
        logged = {"recording": recorder.cost}
    simulation = job.course.simulation
    per_input = {
        job.mechanism.pairs[item.plan.input].name: counts_of(item) for item in job.requests
    }
    return {
        "configurations": standing.configurations,
        "each_configuration": per_input,
        **{
            name: standing.configurations * sum(item[name] for item in per_input.values())
            for name in ("poles", "axis_derivatives", "link_rates")
        },
        "velocity_equation_solves": standing.counts[BY_EQUATIONS,],
        "tables": {
            stem: {
                "rows": standing.counts[ROWS, name, table.name],
                "columns": len(table.columns),
            }
            for stem, (name, table) in stems(job.tables(standing.failures)).items()
        },
        **logged,
        "seconds": ledger.closed(),
        **({} if simulation is None else {"simulate": asdict(simulation.engine)}),
    }


class Bounded(NamedTuple):
    """A quantity of poles with an error bound, in words, and the name of the bound.

    It is that of an attribute of `PoleField`.
    """

    words: str
    bound: str


BOUNDED = {
    "directions": Bounded("pole directions", "error"),
    "rates": Bounded("rates", "velocity_coefficient_error"),
    "rate_derivatives": Bounded("derivatives of rates", "acceleration_coefficient_error"),
    "direction_derivatives": Bounded(
        "derivatives of pole directions", "direction_dq_error"
    ),
}
"""What has an error bound, by its name in a verdict."""


def told(verdict: Facts) -> list[str]:
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
    shown = sorted(variables, key=lambda item: item["deviation"])[-1:]
    shown += [item for item in verdict["columns"] if item["table"] != MOTION]
    lines += [
        f"  {item['table']}.{item['column']}: off by {item['deviation']:.1e}"
        f"{' ' * bool(item['unit'])}{item['unit']} at {_place(item)} "
        f"({item['in_roundings']:.2g} roundings)"
        for item in shown
        if item["deviation"]
    ]
    for name, quantity in BOUNDED.items():
        judged = verdict[name]
        if judged["count"]:
            lines.append(
                f"  {judged['within_bound']} of {judged['count']} {quantity.words} "
                f"lie within their error bound; nearest to it {judged['error']:.1e}, "
                f"{judged['over_bound']:.2g} of the bound, at {_place(judged)}"
            )
    lines += [
        f"  no reference at {_place(row)}: {row['status']}"
        for row in verdict["without_reference"]
    ]
    worst = verdict["worst"]
    lines.append(
        f"  worst row: {_place(worst)}: {worst['column']} = {worst['value']!r}, "
        f"in {verdict['digits']} digits {worst['reference']!r}"
    )
    if verdict["not_verified"]:
        lines.append(
            "  not verified, as they failed or find configurations of their own: "
            + ", ".join(verdict["not_verified"])
        )
    return lines


def faults(verdict: Facts) -> list[str]:
    """Return what of a verdict is wrong beyond rounding, in sentences."""
    sentences = []
    if "problem" in verdict:
        sentences.append(f"verify: no row was verified: {verdict['problem']}")
    if verdict.get("beyond"):
        sentences.append(
            f"verify: {listing(verdict['beyond'])} deviate by more than rounding from "
            f"their values in {verdict['digits']} digits"
        )
    for name, quantity in BOUNDED.items():
        judged = verdict.get(name)
        if judged and judged["within_bound"] < judged["count"]:
            sentences.append(
                f"verify: {judged['count'] - judged['within_bound']} of "
                f"{judged['count']} {quantity.words} are off by more than their error bound"
            )
    if verdict.get("without_reference"):
        places = listing(
            f"{_place(row)} ({row['status']})" for row in verdict["without_reference"]
        )
        sentences.append(f"verify: no solution in many digits belongs to {places}")
    return sentences


def _place(item: Facts) -> str:
    subject = "".join(f", {key} {name}" for key, name in item.get("subject", {}).items())
    return f"sample {item['sample']}, assembly mode {item['assembly_mode']}{subject}"
