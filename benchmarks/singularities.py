"""Time of the singularity report of mechanisms with one input."""

import time
from dataclasses import dataclass

from benchmarks.harness import Cell, Section, list_own_mechanisms
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.input_output_relation import Type
from spherekit.singularities.single_freedom import SingleFreedomSingularities

UNIT_MECHANISM = "four_bar"
"""Mechanism whose time is the unit in which the times of other mechanisms are stated."""

QUICK_MECHANISMS = (UNIT_MECHANISM, "stephenson", "roller_cam")

SEARCH_REPETITIONS = 2
"""Number of measurements. The fastest one is the result."""

SEARCHED_MODE_SAMPLES = 9
"""Number of inputs at which all assembly modes are searched."""


@dataclass(frozen=True)
class ReportTimes:
    """Processor times (s) of a report, and what it contains.

    Attributes
    ----------
    modes
        Time of the search for assembly modes.
    curves
        Time of the configuration curves.
    points
        Time of the singular points on them.
    counts
        Number and length (rad) of the curves, and numbers of points of type I, of type II,
        and of self-motions and type III.
    """

    modes: float
    curves: float
    points: float
    counts: tuple[Cell, ...]

    @property
    def total(self) -> float:
        """Time (s) of the whole report."""
        return self.modes + self.curves + self.points


def run(quick: bool) -> list[Section]:
    """Return the times for the shipped mechanisms."""
    names = [
        name
        for name in list_own_mechanisms()
        if len(load(name).inputs) == 1 and name != UNIT_MECHANISM
    ]
    if quick:
        names = [name for name in names if name in QUICK_MECHANISMS]
    unit = _measure_report(UNIT_MECHANISM)
    rows: list[tuple[Cell, ...]] = [_row(UNIT_MECHANISM, unit, unit)]
    rows += [_row(name, _measure_report(name), unit) for name in names]
    return [
        Section(
            "Singularities: the whole report",
            "Processor time of one thread that finds all singularities of a mechanism, the "
            "faster of two runs. The output is the declared one, or the last link relative "
            "to the ground. The time has three parts: the search of all modes at 9 inputs, "
            "the computation of all configuration curves with checks of their number, and "
            "the computation of all singular points on them with their conditions.",
            (
                "mechanism",
                f"over {UNIT_MECHANISM}",
                "whole, s",
                "modes, %",
                "curves, %",
                "points, %",
                "curves found",
                "length, rad",
                "type I",
                "type II",
                "self-motion, type III",
            ),
            rows,
            "The section Inverse kinematics has the singularity measures of a spherical "
            "3-RRR at a million orientations.",
        )
    ]


def _row(name: str, times: ReportTimes, unit: ReportTimes) -> tuple[Cell, ...]:
    """Return a table row with the times of a report and its parts, and its contents."""
    return (
        name,
        times.total / unit.total,
        times.total,
        100.0 * times.modes / times.total,
        100.0 * times.curves / times.total,
        100.0 * times.points / times.total,
        *times.counts,
    )


def _measure_report(name: str) -> ReportTimes:
    """Return the times of the fastest of several reports of a shipped mechanism."""
    measurements = [_measure_once(name) for _ in range(SEARCH_REPETITIONS)]
    return min(measurements, key=lambda times: times.total)


def _measure_once(name: str) -> ReportTimes:
    """Return the times of one report of a shipped mechanism."""
    mechanism = load(name)
    start = time.process_time()
    position_analysis = PositionAnalysis(mechanism, samples=SEARCHED_MODE_SAMPLES)
    modes_end = time.process_time()
    curves = [item.curve for item in position_analysis.configurations.curves]
    curves_end = time.process_time()
    report = SingleFreedomSingularities(position_analysis, curves, [_output(mechanism)])
    types = [point.type for point in report.points]
    points_end = time.process_time()
    counts = (
        len(curves),
        float(sum(curve.length for curve in curves)),
        types.count(Type.I),
        types.count(Type.II),
        types.count(Type.SELF_MOTION) + len(report.crossings),
    )
    return ReportTimes(
        modes_end - start, curves_end - modes_end, points_end - curves_end, counts
    )


def _output(mechanism: Mechanism) -> tuple[str, str]:
    """Return the output link and the link relative to which it moves."""
    for output in mechanism.outputs:
        return output.link, output.relative_to
    return mechanism.links[-1], mechanism.links[0]
