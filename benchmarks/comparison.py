"""The short table of the benchmarks page: spherekit beside the best other program.

All numbers are taken from the sections of a record, so the table agrees with the tables
below it on the page.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.harness import Section, format_cell

SectionRecord = Mapping[str, Any]
"""A `Section` as a mapping, with the commit at which it was measured."""

MAX_ANGLE_ERROR_RAD = 1e-8
"""Largest error (rad) of an input that counts as accurate in the comparison.

Larger: faster and less accurate settings are compared.
"""

OWN_NAME = "spherekit"
"""Beginning of the names of all settings of spherekit in the sections."""

SIMULATED_CASES = {
    "one loop": "Simulate the published four-bar under loads for 10 s",
    "two loops": "Simulate a Stephenson six-bar under loads for 10 s",
    "two freedoms": "Simulate a wrist with two inputs under loads for 10 s",
}
"""The task that a section about simulations measures, by the end of the section's title."""

EXPORTED_CASES = (
    ("four_bar", "torque", "Newton", "Torque of the four-bar at an input, as C code"),
    ("two_dof_spm", "both", "Newton", "Torques and coefficients of the wrist, as C code"),
)
"""Compared rows of the section about exported sources.

Each item has the mechanism, the kind of results, the method by which the other program
closes the loops, and the task in words.
"""

INTRODUCTION = (
    "Each row compares spherekit with the fastest other program that was measured for the "
    "same task. Simulations have to reach an error below "
    f"1e{math.log10(MAX_ANGLE_ERROR_RAD):.0f} rad, and "
    "the fastest setting that does is shown. The last column is the time of the other "
    "program divided by that of spherekit: above 1, spherekit is faster."
)
"""Text above the table."""

REMARK = (
    "No other program was measured for assembly modes, singularities, workspaces and "
    "proofs. MuJoCo and Pinocchio simulate any mechanism, with more kinds of joints and "
    "with contacts between bodies. Both were called from Python."
)
"""Text below the table: what the comparison does not cover."""


@dataclass(frozen=True)
class Measurement:
    """The time of a program for a task.

    Attributes
    ----------
    program
        Name of the program with its setting.
    time
        Time, in the unit of the comparison.
    error
        Largest error of an input (rad), or None if the results are equal to rounding.
    """

    program: str
    time: float
    error: float | None = None


@dataclass(frozen=True)
class TaskComparison:
    """spherekit and the best peer at one task.

    Attributes
    ----------
    task
        What is computed.
    unit
        Unit of the times.
    own, peer
        The fastest measurement of spherekit and of the other programs.
    """

    task: str
    unit: str
    own: Measurement
    peer: Measurement


def comparison_section(benchmarks: Mapping[str, Sequence[SectionRecord]]) -> Section | None:
    """Return the short table, or None if no section with a peer was measured.

    Parameters
    ----------
    benchmarks
        The sections of each benchmark, by its name.
    """
    comparisons = [
        *_compare_simulations(benchmarks.get("peers", ())),
        *_compare_designs(benchmarks.get("designs", ())),
        *_compare_sources(benchmarks.get("source", ())),
    ]
    if not comparisons:
        return None
    rows = [
        (
            comparison.task,
            _format_measurement(comparison.own, comparison.unit),
            _format_measurement(comparison.peer, comparison.unit),
            comparison.peer.time / comparison.own.time,
        )
        for comparison in comparisons
    ]
    columns = ("task", "spherekit", "best other program", "ratio of times")
    return Section("spherekit beside other programs", INTRODUCTION, columns, rows, REMARK)


def _format_measurement(measurement: Measurement, unit: str) -> str:
    """Return the time, the error and the program of a measurement as text."""
    text = f"{format_cell(measurement.time)} {unit}"
    if measurement.error is not None:
        text += f", error {measurement.error:.1g} rad"
    setting = measurement.program.removeprefix(OWN_NAME).strip(" ,")
    return f"{text} ({setting})" if setting else text


def _rows_of(section: SectionRecord) -> list[dict[str, Any]]:
    """Return the rows of a section by the names of the columns."""
    return [dict(zip(section["columns"], row, strict=True)) for row in section["rows"]]


def _fastest(measurements: Sequence[Measurement]) -> Measurement | None:
    """Return the fastest measurement, or None if there is none."""
    return min(measurements, key=lambda item: item.time, default=None)


def _compare(
    task: str, unit: str, measurements: Sequence[Measurement]
) -> Iterator[TaskComparison]:
    """Yield the comparison of a task if both spherekit and a peer were measured."""
    is_own = [item.program.startswith(OWN_NAME) for item in measurements]
    own = _fastest([x for x, own in zip(measurements, is_own, strict=True) if own])
    peer = _fastest([x for x, own in zip(measurements, is_own, strict=True) if not own])
    if own is not None and peer is not None:
        yield TaskComparison(task, unit, own, peer)


def _compare_simulations(sections: Sequence[SectionRecord]) -> Iterator[TaskComparison]:
    """Yield the comparisons of simulations with sufficiently small errors."""
    for section in sections:
        for ending, task in SIMULATED_CASES.items():
            if section["title"].endswith(ending):
                measurements = [
                    Measurement(row["engine"], row["ms, median"], row["error of q, rad"])
                    for row in _rows_of(section)
                    if row["error of q, rad"] <= MAX_ANGLE_ERROR_RAD
                ]
                yield from _compare(task, "ms", measurements)


def _compare_designs(sections: Sequence[SectionRecord]) -> Iterator[TaskComparison]:
    """Yield the comparison of the time of one design of a four-bar."""
    for section in sections:
        if section["title"] == "Designs beside peers":
            measurements = [
                Measurement(row["job"].partition(":")[0], row["us per design"])
                for row in _rows_of(section)
            ]
            yield from _compare("Evaluate one design of a four-bar", "us", measurements)


def _compare_sources(sections: Sequence[SectionRecord]) -> Iterator[TaskComparison]:
    """Yield the comparisons of C code that also computes the positions."""
    for section in sections:
        for row in _rows_of(section):
            for mechanism, results, positions, task in EXPORTED_CASES:
                key = (row["mechanism"], row["results"], row["Pinocchio"])
                peer_time = row["Pinocchio, ns"]
                if key == (mechanism, results, positions) and not _is_missing(peer_time):
                    own = Measurement(OWN_NAME, row["spherekit, ns"])
                    peer = Measurement("Pinocchio through CasADi", peer_time)
                    yield from _compare(task, "ns", [own, peer])


def _is_missing(time: float | None) -> bool:
    """Return whether a time was not measured."""
    return time is None or math.isnan(time)
