"""The summary of a run: what was run, its results, and its cost, ready for JSON."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from spherekit.conventions import Facts
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.mobility import graph_mobility
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.runs.completeness_text import can_prove_modes, describe_completeness
from spherekit.runs.contract import Findings
from spherekit.runs.overview_summary import summarize_overview
from spherekit.runs.run_cost import RECORDING, Timer, count_evaluations
from spherekit.runs.run_plan import RunPlan
from spherekit.runs.run_result import tables_by_file_stem
from spherekit.runs.run_state import BY_EQUATIONS, MODE, ROWS, RunState
from spherekit.runs.sampling import Sampling
from spherekit.tables.screen_table import row_sentences
from spherekit.tolerances import CLOSURE_TOLERANCE
from spherekit.version import __version__


def with_counts(texts: Iterable[str]) -> list[str]:
    """Return each distinct text once, in order, with the number of times it is repeated."""
    return [
        text if count == 1 else f"{text} ({count} times)"
        for text, count in Counter(texts).items()
    ]


def summarize_run(run_plan: RunPlan, run_state: RunState) -> Facts:
    """Return the summary of a complete run, ready for JSON.

    It states the mechanism, the samples, the assembly modes, statuses and errors, and the
    findings of each analysis. The cost and the verification are added by the runner.
    """
    sampling = run_plan.sampling
    mechanism = run_plan.mechanism
    position_analysis = sampling.position_analysis
    input_ranges = sampling.extents[0].T.tolist()
    # How poles are found while one input moves: "passes" are passes of the Aronhold-Kennedy
    # theorem, "irreducible_parts" the links that need the velocity equations instead.
    plans = {
        mechanism.pairs[plan.input].name: {
            "passes": max(plan.pass_numbers.values(), default=0),
            "poles": len(plan.pass_numbers),
            "irreducible_parts": [[*map(plan.name, x.links)] for x in plan.blocks],
        }
        for plan in run_plan.plans
    }
    assembly_modes = [
        _mode_names(mode) | {"status": run_state.status_counts(MODE, str(mode.number))}
        for mode in position_analysis.assembly_modes
    ]
    analyses = [
        {
            "name": analysis.name,
            "version": analysis.version,
            "parameters": asdict(analysis),  # type: ignore[call-overload]
            "failed": analysis.name in run_state.failures,
            "failed_rows": run_state.failed_rows(analysis.name),
            "cites": analysis.cites,
            "findings": dict(findings.figures),
            "remarks": with_counts(findings.remarks),
            "warnings": with_counts(findings.warnings),
            "screen_tables": [asdict(table) for table in findings.tables],
        }
        for analysis in run_plan.analyses
        for findings in [run_state.findings.get(analysis.name, Findings())]
    ]
    reads_rates = any(needs.time for needs in run_plan.needs)
    remarks = []
    warnings = [*sampling.warnings]
    for name, findings in run_state.findings.items():
        # Tables for the screen are added as sentences too, for those who read only the
        # remarks.
        for table in findings.tables:
            remarks += [f"{name}: {text}" for text in row_sentences(table)]
        remarks += [f"{name}: {text}" for text in with_counts(findings.remarks)]
        warnings += [f"{name}: {text}" for text in with_counts(findings.warnings)]
    return {
        "spherekit": __version__,
        "numpy": np.__version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "inputs": dict(zip(position_analysis.inputs, input_ranges, strict=True)),
        "inputs_unit": "rad",
        # The inputs at the first and the last sample. A range may be given downwards.
        "input_ends": dict(
            zip(position_analysis.inputs, sampling.inputs[[0, -1]].T.tolist(), strict=True)
        ),
        # The variable of a pair is the angle of its second link relative to the first.
        "input_links": {
            pair: list(mechanism.pair(pair).links) for pair in position_analysis.inputs
        },
        "sampling": "x".join(map(str, sampling.shape)),
        **sampling.summary(),
        # Only for analyses whose results depend on rates, such as driving torques.
        "assumed_rates_rad_per_s": sampling.assumed_rates if reads_rates else {},
        "samples": run_state.samples_done,
        "samples_in_a_block": run_plan.block_size,
        "mobility": {
            "graph": graph_mobility(mechanism),
            "rank": run_state.mobility_by_rank,
        },
        "redundant_constraints": run_state.redundant_constraints,
        "groups": [group.kind for group in position_analysis.assembly.groups],
        "plans": plans,
        "assembly_modes": assembly_modes,
        "other_modes": [_mode_names(mode) for mode in position_analysis.other_modes],
        "search": position_analysis.search,
        "completeness": describe_completeness(position_analysis),
        "can_prove_modes": can_prove_modes(position_analysis),
        "overview": summarize_overview(run_state.overview, run_plan.overview_plan),
        "crossings": position_analysis.crossings,
        "mode_meetings": _mode_meetings(sampling),
        **run_state.status_summary(),
        "closure_tolerance_rad": CLOSURE_TOLERANCE,
        "errors_reached": run_state.error_summary(),
        "analyses": analyses,
        "remarks": remarks,
        "warnings": warnings,
        "motion_warnings": list(sampling.warnings),
        "has_masses": bool(mechanism.masses),
        "unapplied_joint_limits_rad": _unapplied_joint_limits(mechanism, sampling),
    }


def _mode_names(mode: AssemblyMode) -> Facts:
    """Return the index of a mode, its signs and, if the file names the mode, its name."""
    names: Facts = {"number": mode.number, "mode": mode.label}
    if mode.name:
        names["name"] = mode.name
    return names


def _unapplied_joint_limits(
    mechanism: Mechanism, sampling: Sampling
) -> dict[str, list[float]]:
    """Return the joint limits (rad), by pair, that the motion of a run may exceed.

    The summary of the run warns of them. Only a simulation stops at joint limits. The
    limits of an input are listed if its range exceeds them. Those of all other pairs are
    always listed, because their angles are not examined.
    """
    if sampling.simulation is not None:
        return {}
    # (2, inputs) the least and the greatest value of each input (rad).
    input_extents, _rate_extents = sampling.extents
    input_ranges = dict(
        zip(sampling.position_analysis.inputs, input_extents.T.tolist(), strict=True)
    )
    limits = {}
    for limit in mechanism.joint_limits:
        # A pair that is no input counts as having an unlimited range.
        input_range = input_ranges.get(limit.pair, [-np.inf, np.inf])
        if min(input_range) < limit.low or max(input_range) > limit.high:
            limits[limit.pair] = [limit.low, limit.high]
    return limits


def _mode_meetings(sampling: Sampling) -> list[Facts]:
    """Return where curves of assembly modes meet. A simulation has events instead."""
    if sampling.simulation is not None:
        return []
    position_analysis = sampling.position_analysis
    return [
        {**meeting.facts, "sentence": sentence}
        for meeting, sentence in zip(
            position_analysis.mode_meetings,
            position_analysis.meeting_sentences,
            strict=True,
        )
    ]


def measure_cost(
    run_plan: RunPlan, run_state: RunState, timer: Timer, recorder: Any
) -> Facts:
    """Return the cost of a run for its summary: numbers of results, and times.

    The sizes of tables (bytes) are added when the files are written.

    Parameters
    ----------
    run_plan
        The analyses and the requested poles (axes of relative rotation) of the run.
    run_state
        The counts of the run.
    timer
        The time of each stage of the run.
    recorder
        The recorder, None without a recording. If it counts what it records, the recording
        is completed here.
    """
    # Numbers of recorded entities, rows and bytes. Only recorders with the method `finish`
    # count them, see `spherekit.runs.recording_session.Recorder`.
    recording = {}
    if hasattr(recorder, "finish"):
        with timer.stage(RECORDING):
            recorder.finish()
        recording = {"recording": recorder.cost}
    # How many results one configuration needs, by name of the input that moves: pole axes,
    # their derivatives with respect to the input, and angular velocities of links ("link
    # rates").
    counts_by_input = {}
    for request in run_plan.requests:
        moving_pair = run_plan.mechanism.pairs[request.plan.input]
        counts_by_input[moving_pair.name] = count_evaluations(request)
    # The sums over all inputs, times the number of configurations.
    totals = {}
    for name in ("poles", "axis_derivatives", "link_rates"):
        count = sum(counts[name] for counts in counts_by_input.values())
        totals[name] = run_state.configurations * count
    # Sizes of the tables, by name of the file without its ending. The keys of
    # `run_state.counts` are tuples: the kind of the count, and what is counted.
    tables = {}
    table_by_stem = tables_by_file_stem(run_plan.tables(run_state.failures))
    for stem, (analysis_name, table) in table_by_stem.items():
        tables[stem] = {
            "rows": run_state.counts[ROWS, analysis_name, table.name],
            "columns": len(table.columns),
        }
    # Rows with poles that were computed from the velocity equations of the whole mechanism,
    # in quad precision, because float64 left too few digits.
    equation_count = run_state.counts[BY_EQUATIONS,]
    # The engine that solved a simulation, with its steps and computing times.
    simulation = run_plan.sampling.simulation
    engine = {} if simulation is None else {"simulate": asdict(simulation.engine)}
    return {
        "configurations": run_state.configurations,
        "each_configuration": counts_by_input,
        **totals,
        "velocity_equation_solves": equation_count,
        "tables": tables,
        **recording,
        "seconds": timer.total_seconds(),
        **engine,
    }
