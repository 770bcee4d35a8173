"""What is said of the singularities of a mechanism with one input, in a few lines."""

from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np

from spherekit.plugin import Floats, Status, numbered
from spherekit.plugin.rotations import wrap
from spherekit.plugin.singularities import (
    NearMiss,
    SampledSingularities,
    least_transmission,
)

from .scenes import SELF_MOTION, words_of

Row = Mapping[str, Any]

MOST_SHOWN = 6
"""Places of one type that are told one by one."""
TRACED = 721
"""Points of a curve among which an output's extremes are looked for."""
FULL_TURN = 355.0
"""An output that turned by more (deg) between the points of a curve turns fully."""
MEANING = (
    ("I", "it rests or turns back"),
    ("II", "the locked input does not hold it"),
    (SELF_MOTION, "it rests with the input while other links move"),
    ("III", "curves of configurations cross"),
)


def places(points: Row, output: str, input_pair: str) -> list[str]:
    """Return a line for each type of singularity of an output within the range."""
    lines = []
    shown = (points["output"] == output) & (points["inside"] == "yes")
    for kind, meaning in MEANING:
        here = shown & (points["kind"] == kind)
        at = np.degrees(points["q"][here])
        where = "everywhere on a curve"
        if np.all(np.isfinite(at)):
            where = f"at {input_pair} = " + "; ".join(
                f"{_angles(values)} deg" + (f" in {modes}" if modes else "")
                for modes, values in _by_modes(at, points["assembly_mode"][here]).items()
            )
        if len(at):
            lines.append(f"{words_of(kind)} of {output}, {meaning}: {where}")
    return lines


def _by_modes(at: Floats, modes: Iterable[str]) -> dict[str, list[str]]:
    """Return the places (deg) by the modes that have them, as they are shown."""
    having: dict[str, set[int]] = {}
    for value, joined in sorted(zip(at.tolist(), modes, strict=True)):
        having.setdefault(_degrees(value), set()).update(_numbers([joined]))
    grouped: dict[str, list[str]] = {}
    for place, numbers in having.items():
        words = numbered("mode", sorted(numbers)) if numbers else ""
        grouped.setdefault(words, []).append(place)
    return grouped


def _numbers(modes: Iterable[str]) -> set[int]:
    """Return the numbers of modes that are joined by plus signs."""
    return {int(number) for number in "+".join(modes).split("+") if number}


def _angles(places: list[str]) -> str:
    rest = len(places) - MOST_SHOWN
    shown = ", ".join(places[:MOST_SHOWN])
    return f"{shown} and {rest} more" if rest > 0 else shown


def _degrees(value: float) -> str:
    """Return an angle (deg) as text, zero but for rounding as 0."""
    return f"{round(value, 6) + 0.0:.6g}"


def swings(sampled: SampledSingularities, names: list[str]) -> list[str]:
    """Return how far each output turns on the configuration curves, curves alike in one."""
    lines: dict[str, list[int]] = {}
    every = len(sampled.curves)
    for number, (output, name) in product(range(every), enumerate(names)):
        words = f"{name} {_turning(sampled, number, output)}"
        lines.setdefault(words, []).append(number)
    return [
        words
        + ("" if len(curves) == every else f" on {numbered('configuration curve', curves)}")
        for words, curves in lines.items()
    ]


def _turning(sampled: SampledSingularities, number: int, output: int) -> str:
    """Return how far an output turns on a configuration curve.

    It swings where it turns back, or where the curve ends before it has turned fully.
    """
    curve = sampled.curves[number]
    links = sampled.report.outputs[output]
    variable = sampled.tracer.mechanism.angle_between(*links)
    points = [
        point
        for point in sampled.report.points
        if (point.curve, point.output) == (number, links)
    ]
    s = np.linspace(0.0, curve.length * (1.0 - 1e-12), TRACED)
    s = np.unique(np.append(s, [point.s for point in points]))
    angle = along = sampled.output_angle(number, output, s)
    if variable is not None:
        beyond = [values[variable] for _, values in sampled.crossing_ends(number)]
        angle = np.append(along, beyond) - along[0] + wrap(along[0])
    low, high = np.degrees([np.min(angle), np.max(angle)])
    swing = _degrees(high - low)
    reverses = any(point.output_turns for point in points)
    left = not curve.closed and Status.OK in curve.ends
    far = ", as far as the curve was followed" if left else ""
    if swing == "0":
        return "rests" + (f" at {_degrees(high)} deg" if variable is not None else "")
    input_ends = curve.at(s[[0, -1]]).values[:, sampled.tracer.solver.input_variable]
    input_turns = np.ptp(input_ends) / (2.0 * np.pi)
    if left and input_turns > 1.0 and not reverses:
        ratio = _degrees(np.degrees(np.ptp(along)) / input_turns)
        return f"turns in one sense, by {ratio} deg in a turn of the input"
    if variable is None:
        to_and_fro = "to and fro " if reverses else ""
        return f"turns {to_and_fro}by {swing} deg about its moving pole{far}"
    if abs(along[-1] - along[0]) > np.pi and high - low > FULL_TURN:
        return "turns fully"
    if left and not reverses:
        return f"turns in one sense, by {swing} deg{far}"
    return f"swings {swing} deg, from {_degrees(low)} to {_degrees(high)} deg{far}"


def least_angles(
    sampled: SampledSingularities, names: list[str], input_pair: str
) -> list[str]:
    """Return the least transmission angle of each output that has one."""
    lines = []
    for output, name in enumerate(names):
        least = least_transmission(sampled, output)
        if least is None:
            continue
        angle, q, modes = least
        lines.append(
            f"least transmission angle of {name}: {np.degrees(angle):.4g} deg at "
            f"{input_pair} = {_degrees(np.degrees(q))} deg in {numbered('mode', modes)}"
        )
    return lines


def coming_near(
    misses: list[NearMiss], points: Row, names: list[str], near: float, input_pair: str
) -> list[str]:
    """Return a line for each output that comes near a type without meeting it.

    Assembly modes that meet it elsewhere in the range are left out.
    """
    lines = []
    for kind, output in dict.fromkeys((miss.type, miss.output) for miss in misses):
        name = names[output]
        met = _met(points, kind, name)
        beside = [
            (miss, modes)
            for miss in misses
            if (miss.type, miss.output) == (kind, output)
            and (modes := set(miss.assembly_modes) - met)
        ]
        if not beside:
            continue
        least, having = min(beside, key=lambda entry: entry[0].angle)
        every = sorted(set().union(*(modes for _, modes in beside)))
        lines.append(
            f"{numbered('assembly mode', every)} of output {name} "
            f"come{'s' * (len(every) == 1)} within {near:g} deg of type {kind} without "
            f"meeting it, nearest {np.degrees(least.angle):.3g} deg in "
            f"{numbered('mode', sorted(having))} at {input_pair} = "
            f"{_degrees(np.degrees(least.q))} deg, velocity coefficient "
            f"{least.velocity_coefficient:.3g}"
        )
    return lines


def _met(points: Row, kind: str, output: str) -> set[int]:
    """Return the assembly modes in which an output meets a type of singularity."""
    here = (points["kind"] == kind) & (points["output"] == output)
    return _numbers(points["assembly_mode"][here & (points["inside"] == "yes")])
