"""What is said of the singularities of a mechanism with one input, in a few lines."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from spherekit.plugin import Floats, numbered
from spherekit.plugin.singularities import SampledSingularities

Row = Mapping[str, Any]

MOST_SHOWN = 6
"""Places of one type that are told one by one."""
SAME_PLACE = 1e-6
"""Inputs (deg) that differ by less are one place."""
TRACED = 721
"""Points of a curve among which an output's extremes are looked for."""
MEANING = {
    "I": "it rests or turns back",
    "II": "the locked input does not hold it",
    "III": "curves of configurations cross",
}


def places(points: Row, output: str, input_pair: str) -> list[str]:
    """Return a line for each type of singularity of an output within the range."""
    lines = []
    for kind, meaning in MEANING.items():
        here = (
            (points["kind"] == kind)
            & (points["output"] == output)
            & (points["inside"] == "yes")
        )
        if not np.any(here):
            continue
        at = np.degrees(points["q"][here])
        if not np.all(np.isfinite(at)):
            lines.append(f"type {kind} of {output}, {meaning}: everywhere on a curve")
            continue
        told = "; ".join(
            f"{_angles(values)} deg" + (f" in {modes}" if modes else "")
            for modes, values in _by_modes(at, points["assembly_mode"][here]).items()
        )
        lines.append(f"type {kind} of {output}, {meaning}: at {input_pair} = {told}")
    return lines


def _by_modes(at: Floats, modes: Iterable[str]) -> dict[str, list[float]]:
    """Return the places (deg) by the modes that have them, rounded."""
    having: dict[float, set[int]] = {}
    for value, joined in zip(at.tolist(), modes, strict=True):
        place = next((x for x in having if abs(x - value) < SAME_PLACE), value)
        having.setdefault(place, set()).update(int(k) for k in joined.split("+") if k)
    grouped: dict[str, list[float]] = {}
    for place, numbers in sorted(having.items()):
        words = numbered("mode", sorted(numbers)) if numbers else ""
        grouped.setdefault(words, []).append(place)
    return grouped


def _angles(values: list[float]) -> str:
    rest = len(values) - MOST_SHOWN
    shown = ", ".join(f"{value:.6g}" for value in values[:MOST_SHOWN])
    return f"{shown} and {rest} more" if rest > 0 else shown


def swings(sampled: SampledSingularities, names: list[str]) -> list[str]:
    """Return how far each output turns on the configuration curves, curves alike in one."""
    lines: dict[tuple[str, str], list[int]] = {}
    for number, curve in enumerate(sampled.curves):
        s = np.linspace(0.0, curve.length * (1.0 - 1e-12), TRACED)
        turning = [
            p.s for p in sampled.report.points if p.curve == number and np.isfinite(p.s)
        ]
        s = np.unique(np.concatenate([s, np.array(turning)]))
        for output, name in enumerate(names):
            angle = np.degrees(np.unwrap(sampled.output_angle(number, output, s)))
            low, high = float(np.min(angle)), float(np.max(angle))
            around = abs(angle[-1] - angle[0]) > 180.0 and high - low > 355.0
            words = (
                "turns fully"
                if around
                else f"swings {high - low:.6g} deg, from {low:.6g} to {high:.6g} deg"
            )
            lines.setdefault((name, words), []).append(number)
    every = len(sampled.curves)
    return [
        f"{name} {words}"
        + ("" if len(curves) == every else f" on {numbered('configuration curve', curves)}")
        for (name, words), curves in lines.items()
    ]


def least_transmission(relation: Row, input_pair: str) -> list[str]:
    """Return the least transmission angle of each output that has one, at the samples."""
    lines = []
    for output in dict.fromkeys(relation["output"].tolist()):
        angle = np.where(relation["output"] == output, relation["transmission"], np.nan)
        if not np.any(np.isfinite(angle)):
            continue
        row = int(np.nanargmin(angle))
        alike = np.flatnonzero(np.abs(angle - angle[row]) < np.radians(SAME_PLACE))
        modes = numbered("mode", np.unique(relation["assembly_mode"][alike]))
        lines.append(
            f"least transmission angle of {output}: {np.degrees(angle[row]):.4g} deg at "
            f"{input_pair} = {np.degrees(relation['q'][row]):.6g} deg in {modes}"
        )
    return lines
