"""What is said of the singularities of a mechanism with one input, in a few lines."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import Floats, Status, numbered
from spherekit.plugin.singularities import SampledSingularities

Row = Mapping[str, Any]

MOST_SHOWN = 6
"""Places of one type that are told one by one."""
SAME_PLACE = 1e-6
"""Inputs (deg) that differ by less are one place."""
TRACED = 721
"""Points of a curve among which an output's extremes are looked for."""
FULL_TURN = 355.0
"""An output that turned by more (deg) between the points of a curve turns fully."""
CROSSED = "curves of configurations cross"
MEANING = (
    ("I", "it rests or turns back"),
    ("II", "the locked input does not hold it"),
    ("III", "it rests with the input while other links move"),
    ("III", CROSSED),
)


def places(
    sampled: SampledSingularities, points: Row, output: str, input_pair: str
) -> list[str]:
    """Return a line for each type of singularity of an output within the range."""
    lines = []
    crossed = _crossed(sampled, points)
    for kind, meaning in MEANING:
        here = (
            (points["kind"] == kind)
            & (points["output"] == output)
            & (points["inside"] == "yes")
            & (crossed == (meaning == CROSSED))
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
    shown = ", ".join(_degrees(value) for value in values[:MOST_SHOWN])
    return f"{shown} and {rest} more" if rest > 0 else shown


def _degrees(value: float) -> str:
    """Return an angle (deg) as text, zero but for rounding as 0."""
    return f"{round(value, 6) + 0.0:.6g}"


def _crossed(sampled: SampledSingularities, points: Row) -> NDArray[np.bool_]:
    """Return whether each row is a place at which curves cross."""
    ends = {
        (curve, s)
        for curve in range(len(sampled.curves))
        for s, _ in sampled.crossing_ends(curve)
    }
    places = zip(points["curve"].tolist(), points["s"].tolist(), strict=True)
    return np.array([place in ends for place in places], dtype=bool)


def swings(sampled: SampledSingularities, names: list[str]) -> list[str]:
    """Return how far each output turns on the configuration curves, curves alike in one."""
    lines: dict[tuple[str, str], list[int]] = {}
    for number in range(len(sampled.curves)):
        for output, name in enumerate(names):
            words = _turning(sampled, number, output)
            lines.setdefault((name, words), []).append(number)
    every = len(sampled.curves)
    return [
        f"{name} {words}"
        + ("" if len(curves) == every else f" on {numbered('configuration curve', curves)}")
        for (name, words), curves in lines.items()
    ]


def _turning(sampled: SampledSingularities, number: int, output: int) -> str:
    """Return how far an output turns on a configuration curve.

    It swings where it turns back, or where the curve ends before it has turned fully.
    """
    curve, links = sampled.curves[number], sampled.report.outputs[output]
    variable = sampled.tracer.mechanism.angle_between(*links)
    points = [p for p in sampled.report.points if p.curve == number and np.isfinite(p.s)]
    s = np.linspace(0.0, curve.length * (1.0 - 1e-12), TRACED)
    s = np.unique(np.concatenate([s, np.array([p.s for p in points])]))
    along = sampled.output_angle(number, output, s)
    along = along if variable is None else np.unwrap(along)
    ends = curve.at(s[[0, -1]]).values
    grown = np.abs(np.diff(ends, axis=0)[0])
    input_turns = float(grown[sampled.tracer.solver.single]) / (2.0 * np.pi)
    beyond = []
    if variable is not None:
        laps = ends[:, variable] - along[[0, -1]]
        for place, values in sampled.crossing_ends(number):
            beyond.append(values[variable] - laps[0 if place == 0.0 else 1])
    angle = np.append(along, beyond)
    low, high = np.degrees([np.min(angle), np.max(angle)])
    reverses = any(p.output == links and p.output_turns for p in points)
    left = not curve.closed and Status.OK in curve.ends
    far = ", as far as the curve was followed" if left else ""
    if _degrees(high - low) == "0":
        where = f" at {_degrees(high)} deg" if variable is not None else ""
        return f"rests{where}"
    if left and input_turns > 1.0 and not reverses:
        turned = np.ptp(along) if variable is None else grown[variable]
        ratio = _degrees(float(np.degrees(turned)) / input_turns)
        return f"turns in one sense, by {ratio} deg in a turn of the input"
    if variable is None:
        to_and_fro = "to and fro " if reverses else ""
        return f"turns {to_and_fro}by {_degrees(high - low)} deg about its moving pole{far}"
    if abs(along[-1] - along[0]) > np.pi and high - low > FULL_TURN:
        return "turns fully"
    if left and not reverses:
        return f"turns in one sense, by {_degrees(high - low)} deg{far}"
    return (
        f"swings {_degrees(high - low)} deg, from {_degrees(low)} to {_degrees(high)} deg"
        f"{far}"
    )


def least_transmission(
    sampled: SampledSingularities, points: Row, relation: Row, input_pair: str
) -> list[str]:
    """Return the least transmission angle of each output that has one.

    Of the samples, and of the places within the range at which the locked input does not
    hold the output.
    """
    lines = []
    for output, name in enumerate(dict.fromkeys(relation["output"].tolist())):
        rows = relation["output"] == name
        angles = [np.where(rows, relation["transmission"], np.nan)]
        inputs, modes = [relation["q"]], [str(k) for k in relation["assembly_mode"]]
        held_not = (points["output"] == name) & (points["inside"] == "yes")
        held_not &= np.isin(points["kind"], ("II", "III")) & np.isfinite(points["s"])
        for row in np.flatnonzero(held_not).tolist():
            curve, s = int(points["curve"][row]), float(points["s"][row])
            ends = dict(sampled.crossing_ends(curve))
            values = ends.get(s, sampled.curves[curve].at(s).values[0])
            angles.append(sampled.transmission_angles(values[None])[output])
            inputs.append(points["q"][[row]])
            modes.append(points["assembly_mode"][row])
        angle, q = np.concatenate(angles), np.concatenate(inputs)
        if not np.any(np.isfinite(angle)):
            continue
        least = int(np.nanargmin(angle))
        alike = np.flatnonzero(np.abs(angle - angle[least]) < np.radians(SAME_PLACE))
        having = {int(k) for row in alike for k in modes[row].split("+") if k}
        shown = float(f"{np.degrees(angle[least]):.4g}")
        lines.append(
            f"least transmission angle of {name}: {_degrees(shown)} deg at "
            f"{input_pair} = {_degrees(np.degrees(q[least]))} deg in "
            f"{numbered('mode', sorted(having))}"
        )
    return lines
