"""The singularity report of mechanisms with one input: its cost, and random four-bars."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.harness import Cell, Section, own_mechanisms
from spherekit.errors import SolveError
from spherekit.files.read import load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import SizeGeometry
from spherekit.motion.motion import Tracer
from spherekit.singular.relation import Type
from spherekit.singular.single import SingleFreedom

UNIT = "four_bar"
QUICK = (UNIT, "stephenson", "roller_cam")
SEED = 2
REPEATS = 2
FOUR_BARS = 1000
NEARLY_FOLDING = 1e-3
"""Random four-bars whose arcs miss a sum by less (rad) are left out."""
TURN = 2.0 * np.pi


def run(quick: bool) -> list[Section]:
    """Return the cost for the shipped mechanisms, and the check of random four-bars."""
    return [_shipped(quick), _four_bars(20 if quick else FOUR_BARS)]


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
            "apparent",
        ),
        rows,
        "Singular configurations of the spherical 3-RRR at a million orientations: "
        "section Inverse kinematics.",
    )


def _timed(name: str) -> tuple[float, float, float, float, tuple[Cell, ...]]:
    """Return the times (s) of the whole and its three parts, and what was found."""
    made = load(name)
    marks = [time.process_time()]
    tracer = Tracer(made, samples=9)
    marks.append(time.process_time())
    curves = [item.curve for item in tracer.configurations.curves]
    marks.append(time.process_time())
    report = SingleFreedom(tracer, curves, [_output(made)]).report()
    marks.append(time.process_time())
    kinds = [point.type for point in report.points]
    crossed = len(report.crossings)
    counts = (
        len(curves),
        float(sum(curve.length for curve in curves)),
        kinds.count(Type.I),
        kinds.count(Type.II),
        kinds.count(Type.SELF_MOTION) + crossed,
        kinds.count(Type.APPARENT),
    )
    modes, following, points = np.diff(marks)
    return marks[-1] - marks[0], modes, following, points, counts


def _output(made: Mechanism) -> tuple[str, str]:
    for output in made.outputs:
        return output.link, output.relative_to
    return made.links[-1], made.links[0]


def _four_bars(count: int) -> Section:
    """Compare the dead points of random four-bars with the cosine theorem."""
    found: dict[str, list[tuple[int, int, int, float]]] = {}
    started = time.process_time()
    for arcs, tracer in _random(count):
        kind, row = _compared(arcs, tracer)
        found.setdefault(kind, []).append(row)
    spent = time.process_time() - started
    rows: list[tuple[Cell, ...]] = []
    every = [row for each in found.values() for row in each]
    for kind, each in [*sorted(found.items()), ("all", every)]:
        points, missed, invented, errors = zip(*each, strict=True)
        rows.append((kind, len(each), sum(points), sum(missed), sum(invented), max(errors)))
    return Section(
        "Singularities: random four-bars",
        f"All points of type I and II of {count} four-bars with uniform random arcs (seed "
        f"{SEED}) that close and miss a folding one by more than {NEARLY_FOLDING:g} rad. "
        "The closed form: a dead centre is where two links are in line, and the arc across "
        f"is their sum or difference. {spent / count:.2g} s of processor time each.",
        ("input and output", "four-bars", "points", "missed", "invented", "error, rad"),
        rows,
    )


def _random(count: int) -> Iterator[tuple[np.ndarray, Tracer]]:
    random = np.random.default_rng(SEED)
    made = load(UNIT)
    assert isinstance(made.geometry, SizeGeometry)
    while count:
        arcs = random.uniform(0.25, np.pi - 0.25, 4)
        a, b, c, d = arcs
        folds = [a - b + c - d, a - b - c + d, a + b - c - d, TURN - a - b - c - d]
        if np.min(np.abs(folds)) <= NEARLY_FOLDING:
            continue
        links = {
            link: replace(size, arcs=(float(arc),))
            for (link, size), arc in zip(
                sorted(made.geometry.links.items()), arcs, strict=True
            )
        }
        sizes = replace(made.geometry, links=links)
        try:
            yield arcs, Tracer(replace(made, geometry=sizes, loads=()), samples=9)
        except SolveError:
            continue
        count -= 1


def _compared(arcs: np.ndarray, tracer: Tracer) -> tuple[str, tuple[int, int, int, float]]:
    """Return which of input and output turn fully, and points, missed, invented, error."""
    ground, crank, coupler, follower = arcs
    curves = [item.curve for item in tracer.configurations.curves]
    report = SingleFreedom(tracer, curves, ["4/1"]).report()
    points = missed = invented = 0
    error, turns = 0.0, []
    for kind, pair, near, far, shift in (
        (Type.II, "21", crank, follower, 0.0),
        (Type.I, "41", follower, crank, np.pi),
    ):
        number = tracer.mechanism.pair_number[pair]
        (variable,) = tracer.mechanism.variables_of(number)
        own = [p.values[variable] for p in report.points if p.type == kind]
        wanted = shift - _in_line(ground, near, coupler, far)
        gaps = np.abs(
            np.mod(np.subtract.outer(np.array(own), wanted) + np.pi, TURN) - np.pi
        )
        hits = gaps < 1e-6
        points += len(wanted)
        missed += int(np.sum(np.sum(hits, axis=0) != 1))
        invented += int(np.sum(np.sum(hits, axis=1) != 1))
        error = max(error, float(np.max(gaps[hits], initial=0.0)))
        turns.append("swings" if len(wanted) else "turns")
    return f"input {turns[0]}, output {turns[1]}", (points, missed, invented, error)


def _in_line(first: float, other: float, third: float, fourth: float) -> np.ndarray:
    """Return the angles between two arcs where the two others are in line."""
    angles: list[float] = []
    for way in (third + fourth, third - fourth):
        cosine = np.cos(way) - np.cos(first) * np.cos(other)
        cosine /= np.sin(first) * np.sin(other)
        if abs(cosine) < 1.0:
            angles += [np.arccos(cosine), -np.arccos(cosine)]
    return np.array(angles)
