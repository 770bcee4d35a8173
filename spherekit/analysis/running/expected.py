"""How large the tables and the recording of a study will be, judged from a short run."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.execution import Execution
from spherekit.analysis.result import stems
from spherekit.analysis.rows import InMemory
from spherekit.analysis.run import evaluate_block, executed, traced
from spherekit.analysis.running.cost import Timer
from spherekit.analysis.running.evaluation import ORDINARY
from spherekit.analysis.running.recording import MOST_LOGGED
from spherekit.analysis.running.run_state import RunState
from spherekit.analysis.running.sampling import course_of
from spherekit.analysis.running.summary import RequestedAnalyses, job_of
from spherekit.analysis.tables import TableArrays
from spherekit.conventions import Status
from spherekit.model.study import Study
from spherekit.motion.motion import samples_in_block
from spherekit.planning.inputs import Assembly
from spherekit.rates.request import SignContinuation

LEAST = 4
"""Samples below which no short run is smaller than the run."""

FEW = 48
"""Samples of a short run."""

SHORT = 16
"""Samples of the shortest recording that is made."""


def expected(
    study: Study, analyses: Sequence[AbstractAnalysis], assembly: Assembly
) -> dict[str, Any]:
    """Return what a run of the study will evaluate and write, ready for JSON.

    Where all groups are dyads the assembly modes are found, as the run will; otherwise the
    search may take long, `assembly_modes` is None, and the figures are those of each
    assembly mode. `reason` says why there are none, where there are none.

    Raises
    ------
    SolveError
        If the mechanism cannot be assembled over its range.
    """
    if study.start is not None:
        return {"reason": "the motion follows from the loads, and is not known before"}
    samples = study.count
    if samples < LEAST:
        return {"reason": f"a run of {samples} samples is over before it is predicted"}
    few = shortened(study, min(samples, FEW))
    if not assembly.has_closed_form:
        few = replace(few, search=False)
    able = [analysis for analysis in analyses if analysis.rowwise]
    course = course_of(few, follow=traced(study, analyses, Execution()))
    job = job_of(
        course,
        RequestedAnalyses.of(able, course.tracer.mechanism),
        None,
        ORDINARY,
        all_links=False,
    )
    signs, store = [SignContinuation() for _ in job.requests], InMemory()
    standing = RunState(signs, failures=dict(job.refused))
    for motion in job.evaluation.blocks(job.block):
        evaluate_block(job, motion, standing, store, None, Timer())
    tried, solves = standing.tally.configurations, standing.tally.by_equations
    every = len(course.tracer.assembly_modes)
    assembly_modes = every if assembly.has_closed_form else None
    rows = samples * (min(every, 1) if assembly_modes is None else assembly_modes)
    tables = {}
    for stem, (name, table) in stems(job.tables(standing.failures)).items():
        data = store.table(name, table)
        count = round(standing.rows[name, table.name] * rows / max(tried, 1))
        tables[stem] = {
            "rows": count,
            "columns": len(table.columns),
            "csv_bytes": round(count * csv_row(data, samples)),
            "parquet_bytes": round(count * parquet_row(data, count, samples)),
        }
    names = {analysis.name for analysis in able} - set(standing.failures)
    return {
        "assembly_modes": assembly_modes,
        "configurations": rows,
        "tables": tables,
        "velocity_equation_solves": round(solves * rows / max(tried, 1)),
        "not_predicted": [a.name for a in analyses if a.name not in names],
    }


def shortened(study: Study, samples: int) -> Study:
    """Return the study with so many of its samples, along a path through its ranges."""
    path = study.path
    if path is not None:
        path = path[np.linspace(0, len(path) - 1, samples).astype(int)]
    return replace(study, samples=samples, grid=False, path=path, verify=None)


def extrapolated_recording(
    study: Study,
    analyses: Sequence[AbstractAnalysis],
    made: Callable[[int], Any],
) -> dict[str, int]:
    """Return the entities, rows and bytes that the recording of a study will have.

    From three short ones: what stays once, each block of samples and each sample take
    bytes of their own. `made` gives a recorder of `spherekit.view` for each.
    """

    def recorded(samples: int, block: int) -> tuple[int, int, int, int]:
        with made(samples + block) as recorder:
            execution = Execution(recorder=recorder, block=block)
            result = executed(shortened(study, samples), analyses, execution)
            cost = recorder.cost
        assembly_modes = len(result.summary["assembly_modes"])
        return assembly_modes, cost["entities"], cost["rows"], cost["bytes"]

    _, _, few, one = recorded(SHORT, SHORT)
    _, _, _, cut = recorded(2 * SHORT, SHORT)
    assembly_modes, entities, many, two = recorded(2 * SHORT, 2 * SHORT)
    each_block, per_sample = cut - two, (two - one) / SHORT
    total = study.count
    samples = -(-total // -(-total // MOST_LOGGED))
    blocks = min(samples, -(-total // samples_in_block(assembly_modes)))
    return {
        "entities": entities,
        "rows": round(few + (many - few) / SHORT * (samples - SHORT)),
        "bytes": round(one + each_block * (blocks - 1) + per_sample * (samples - SHORT)),
    }


DICTIONARY = 1 << 17
"""Different numbers (8 bytes each) that fill the dictionary of a Parquet column: 1 MiB."""

COMPRESSED = 0.8
"""What compression leaves of numbers along smooth motions: 0.64 to 0.97 was measured."""

LONG_RUN = 8
"""Equal values in a row from which Parquet counts them instead of listing them."""


def csv_row(data: TableArrays, samples: int) -> float:
    """Return the mean bytes of a row as CSV, numbers with the fewest digits that do."""
    total = 0.0
    for name, values in data.items():
        if name == "sample":
            total += _digits(samples)
        elif name == "status":
            names = [Status(code).name for code in values.tolist()]
            total += _mean([len(word) for word in names])
        else:
            texts = [
                "" if isinstance(value, float) and value != value else str(value)
                for value in values.tolist()
            ]
            total += _mean([len(text) for text in texts])
    return total + len(data)


def _digits(count: int) -> float:
    """Return the mean number of digits of 0 to count - 1."""
    total, digits, low = 0, 1, 0
    while low < count:
        high = min(10**digits, count)
        total += digits * (high - low)
        low, digits = high, digits + 1
    return total / max(count, 1)


def _mean(lengths: list[int]) -> float:
    return sum(lengths) / max(len(lengths), 1)


def parquet_row(data: TableArrays, rows: int, samples: int) -> float:
    """Return the mean bytes of a row as Parquet with dictionaries, without the frame.

    Different numbers are kept once, each of so many `rows` as a place among them; equal
    neighbours cost little. How many differ follows from every second sample of `data`.
    """
    total = 0.0
    for name, values in data.items():
        some = data["sample"] % 2 == 0 if "sample" in data else slice(None, None, 2)
        less, more = (len(np.unique(subset)) for subset in (values[some], values))
        growing = (more - less) / max(len(values) - len(values[some]), 1)
        different = max(more + growing * (rows - len(values)), 1.0)
        if name == "sample":
            different = float(samples)
        held = min(different, DICTIONARY)
        width = 8.0 if values.dtype.kind in "fi" and name != "status" else 0.0
        place = np.log2(held) / 8.0
        run = len(values) / max(1, int(np.sum(values[1:] != values[:-1])) + 1)
        if run >= LONG_RUN:
            place = min(place, (1.0 + np.ceil(place)) / run)
        share = min(1.0, different / max(rows, 1))
        plain = max(0.0, 1.0 - DICTIONARY / different) if different > DICTIONARY else 0.0
        total += (1.0 - plain) * place + width * share
    return COMPRESSED * total
