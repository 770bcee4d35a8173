"""Where an output comes near a singularity along its curves without meeting it.

Of type I the velocity coefficient is measured, of type II the transmission: neither
vanishes where the links of a relation c y' = d q' are badly chosen, as c and d do.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.conventions import Status
from spherekit.motion.arc_curve import ArcCurve
from spherekit.numeric.minima import minima
from spherekit.rates.transmission import SINGULAR
from spherekit.singular.relation import Type
from spherekit.singular.sampled import SampledSingularities
from spherekit.sphere.rotation import Floats

SAME_INPUT = 1e-7
"""Inputs (rad) that differ by less are one: an extremum is known to half its digits."""
AT_END = 1e-9
"""An input as near (rad) to the end of its range is at it."""
ALIKE = 1e-8
"""Angles (rad) that differ by less are one."""
INWARD = 1e-3
"""How far into an assembly mode is looked from its end, in parts of its length."""

Angles = Callable[[Floats], Floats]
"""Angles (n,) rad at places (n,) of a curve."""


@final
@dataclass(frozen=True)
class NearMiss:
    """A local least of the angle to a type of singularity of an output.

    `output` is its position; `curve` and `s` say where, `q` at which input of the range, in
    `assembly_modes`. `angle` (rad) is as in `RelationMeasures`, `velocity_coefficient` the
    size of y'/q' there.
    """

    type: Type
    output: int
    curve: int
    s: float
    q: float
    assembly_modes: tuple[int, ...]
    angle: float
    velocity_coefficient: float


def near_misses(sampled: SampledSingularities, near: float) -> list[NearMiss]:
    """Return where outputs come within `near` (rad) of types I and II in the range.

    What is singular itself, to a millionth, is none. The velocity coefficient counts in
    parts of the greatest on the curve, where that is less than 1: a reducer's output is
    slow throughout.
    """
    return [
        miss
        for kind in (Type.I, Type.II)
        for output in range(len(sampled.report.outputs))
        for number in range(len(sampled.curves))
        for miss in _on_curve(sampled, kind, output, number, near)
    ]


def _on_curve(
    sampled: SampledSingularities, kind: Type, output: int, number: int, near: float
) -> list[NearMiss]:
    """Return where an output comes near a type on one curve."""

    def angle(s: Floats, kind: Type = kind) -> Floats:
        return sampled.angle(kind, number, s, output)

    curve, limit = sampled.curves[number], np.sin(near)
    if kind is Type.I:
        limit *= min(1.0, np.tan(np.nanmax(angle(curve.s), initial=0.0)))
    places, sines = local_least(sampled, number, angle, limit)
    misses = []
    for s in places[sines > SINGULAR]:
        here, slope = (float(angle(s[None], one)[0]) for one in (kind, Type.I))
        misses += [
            NearMiss(kind, output, number, float(s), q, modes, here, np.tan(slope))
            for q, modes in _met_at(sampled, number, float(s), curve.at(s).values[0])
        ]
    return misses


@final
@dataclass(frozen=True)
class LeastAngle:
    """The least transmission angle (rad) of an output in the range, at which input q."""

    angle: float
    q: float
    assembly_modes: tuple[int, ...]


def least_transmission(sampled: SampledSingularities, output: int) -> LeastAngle | None:
    """Return the least transmission angle of an output, None if no dyad places it.

    Between samples too, and where curves cross.
    """
    every: list[LeastAngle] = []
    for number, curve in enumerate(sampled.curves):

        def angles(s: Floats, curve: ArcCurve = curve) -> Floats:
            return sampled.transmission_angles(curve.at(s).values)[output]

        places, _ = local_least(sampled, number, angles)
        candidates = [*zip(places, curve.at(places).values, strict=True)]
        for s, values in [*candidates, *sampled.crossing_ends(number)]:
            (angle,) = sampled.transmission_angles(values[None])[output]
            size = float(angle) if not angle <= SINGULAR else 0.0
            met = _met_at(sampled, number, float(s), values)
            every += [LeastAngle(size, q, modes) for q, modes in met]
    if not every or not np.isfinite(every[0].angle):
        return None
    least = min(every, key=lambda angle: angle.angle)
    alike = {m for e in every if e.angle - least.angle < ALIKE for m in e.assembly_modes}
    return replace(least, assembly_modes=tuple(sorted(alike)))


def _met_at(
    sampled: SampledSingularities, curve: int, s: float, values: Floats
) -> list[tuple[float, tuple[int, ...]]]:
    """Return the inputs of the range with a configuration of a curve, and its modes."""
    low, high = sampled.range
    met = []
    for q in sampled.inputs_of(curve, values).tolist():
        if high - q < SAME_INPUT and sampled.whole_range(curve):
            q = low
        modes = sampled.assembly_modes_at(curve, s, q)
        if modes and sampled.inside(q, [(curve, s)]):
            met.append((q, modes))
    return met


def local_least(
    sampled: SampledSingularities, number: int, angles: Angles, limit: float = np.inf
) -> tuple[Floats, Floats]:
    """Return places (k,) of a curve at which sines of angles are locally least, and these.

    Also the ends of the range, and of the curve where no others cross it, if what is
    beside them is larger.
    """
    curve = sampled.curves[number]
    grid = curve.s
    if curve.closed:
        grid = np.append(grid, grid[1:3] + curve.length)

    def square(s: Floats) -> Floats:
        return np.sin(angles(s)) ** 2

    places, squares = minima(square, grid, limit**2)
    if curve.closed:
        lap = (places >= grid[1]) & (places < grid[1] + curve.length)
        places, squares = np.mod(places[lap], curve.length), squares[lap]
    ends, inward = _ends(sampled, number)
    there = square(ends)
    least = (there <= square(inward)) & (there <= limit**2)
    squares = np.append(squares, there[least])
    return np.append(places, ends[least]), np.sqrt(squares)


def _ends(sampled: SampledSingularities, number: int) -> tuple[Floats, Floats]:
    """Return where the range or a curve ends, and places a little inward (k,)."""
    curve, whole = sampled.curves[number], sampled.whole_range(number)
    stops = Status.AT_SINGULARITY not in curve.ends and not curve.closed
    places = [np.zeros((2, 0))]
    for piece in sampled.configurations.curves[number].pieces:
        ends = np.array([piece.start, piece.stop])
        q = curve.at(ends).values[:, sampled.tracer.solver.single] + piece.shift
        at_end = np.min(np.abs(q[:, None] - sampled.range), axis=1) < AT_END
        taken = at_end & (not whole)
        taken |= stops & (np.minimum(ends, curve.length - ends) < AT_END)
        within = INWARD * (piece.stop - piece.start) * np.array([1.0, -1.0])
        places.append(np.stack([ends, ends + within])[:, taken])
    ends, inward = np.concatenate(places, axis=1)
    return ends, inward
