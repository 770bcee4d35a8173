"""The singularity report of mechanisms with one input: its cost."""

import time

import numpy as np

from benchmarks.harness import Cell, Section, own_mechanisms
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.input_output_relation import Type
from spherekit.singularities.single_freedom import SingleFreedomSingularities

UNIT = "four_bar"
QUICK = (UNIT, "stephenson", "roller_cam")
REPEATS = 2


def run(quick: bool) -> list[Section]:
    """Return the cost for the shipped mechanisms."""
    return [_shipped(quick)]


def _shipped(quick: bool) -> Section:
    every = own_mechanisms()
    names = [name for name in every if len(load(name).inputs) == 1 and name != UNIT]
    names = [UNIT, *(name for name in names if not quick or name in QUICK)]
    unit = 0.0
    rows: list[tuple[Cell, ...]] = []
    for name in names:
        best = min(_timed(name) for _ in range(REPEATS))
        total, modes, curves, points, counts = best
        unit = unit or total
        rows.append(
            (
                name,
                total / unit,
                total,
                100.0 * modes / total,
                100.0 * curves / total,
                100.0 * points / total,
                *counts,
            )
        )
    return Section(
        "Singularities: the whole report",
        "Processor time of one thread from the mechanism to all its singularities, for the "
        "output that it declares, or the last link relative to the ground: all modes at 9 "
        "inputs, all configuration curves with the checks of their number, and all points "
        "on them with their conditions. The faster of two.",
        (
            "mechanism",
            f"over {UNIT}",
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
        "Singular configurations of the spherical 3-RRR at a million orientations: "
        "section Inverse kinematics.",
    )


def _timed(name: str) -> tuple[float, float, float, float, tuple[Cell, ...]]:
    """Return the times (s) of the whole and its three parts, and what was found."""
    made = load(name)
    marks = [time.process_time()]
    tracer = PositionAnalysis(made, samples=9)
    marks.append(time.process_time())
    curves = [item.curve for item in tracer.configurations.curves]
    marks.append(time.process_time())
    report = SingleFreedomSingularities(tracer, curves, [_output(made)])
    kinds = [point.type for point in report.points]
    marks.append(time.process_time())
    crossed = len(report.crossings)
    counts = (
        len(curves),
        float(sum(curve.length for curve in curves)),
        kinds.count(Type.I),
        kinds.count(Type.II),
        kinds.count(Type.SELF_MOTION) + crossed,
    )
    modes, following, points = np.diff(marks)
    return marks[-1] - marks[0], modes, following, points, counts


def _output(made: Mechanism) -> tuple[str, str]:
    for output in made.outputs:
        return output.link, output.relative_to
    return made.links[-1], made.links[0]
