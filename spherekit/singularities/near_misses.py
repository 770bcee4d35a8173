"""Where an output comes near a singularity along its curves without reaching it.

Of type I the velocity coefficient is measured, of type II the transmission: neither
vanishes where the links of a relation c y' = d q' are badly chosen, as c and d do.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from spherekit.arrays import Floats
from spherekit.numerics.minima import find_local_minima
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.singularities.input_output_relation import Type
from spherekit.singularities.sampled_singularities import SampledSingularities
from spherekit.status import Status
from spherekit.velocities.transmission import SINGULAR

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


@dataclass(frozen=True)
class NearMiss:
    """A local least of the angle to a type of singularity of an output.

    `output` is its position; `curve` and `s` say where, `q` at which input of the range, in
    `assembly_modes`. `angle` (rad) is that of the samples, `velocity_coefficient` the
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
    slow throughout. The transmission counts in parts of the largest sine of an arc, so that
    small arcs alone are not near type II. Where dyads place the output, one of them also
    has to be within `near` of being stretched or folded.
    """
    misses = []
    for kind, output, number in product(
        (Type.I, Type.II), range(len(sampled.report.outputs)), range(len(sampled.curves))
    ):
        angle = partial(sampled.angle, kind, number, output=output)
        curve, limit = sampled.curves[number], np.sin(near)
        if kind is Type.I:
            limit *= min(1.0, np.tan(np.nanmax(angle(curve.s), initial=0.0)))
        size = sampled.largest_arc_sine if kind is Type.II else 1.0
        places, sines = local_least(sampled, number, angle, limit * size)
        for s in places[sines > SINGULAR * size]:
            values = curve.at(s).values
            if kind is Type.II and sampled.least_dyad_angle(values, output)[0] > near:
                continue
            here, slope = (
                float(sampled.angle(one, number, s[None], output)[0])
                for one in (kind, Type.I)
            )
            misses += [
                NearMiss(kind, output, number, float(s), q, modes, here, np.tan(slope))
                for q, modes in _met(sampled, number, float(s), curve.at(s).values[0])
            ]
    return misses


def least_transmission(
    sampled: SampledSingularities, output: int
) -> tuple[float, float, tuple[int, ...]] | None:
    """Return the least transmission angle (rad) of an output in the range.

    With it at which input q (rad), and in which assembly modes; None if no dyad places
    the output. Between samples too, and where curves cross.
    """
    every: list[tuple[float, float, tuple[int, ...]]] = []
    for number, curve in enumerate(sampled.curves):

        def angles(s: Floats, curve: ArcCurve = curve) -> Floats:
            return sampled.transmission_angles(curve.at(s).values)[output]

        places, _ = local_least(sampled, number, angles)
        candidates = [*zip(places, curve.at(places).values, strict=True)]
        for s, values in [*candidates, *sampled.crossing_ends(number)]:
            (angle,) = sampled.transmission_angles(values[None])[output]
            size = 0.0 if angle <= SINGULAR else float(angle)
            every += [(size, *met) for met in _met(sampled, number, float(s), values)]
    if not every or not np.isfinite(every[0][0]):
        return None
    least, q, _ = min(every, key=lambda candidate: candidate[0])
    alike = {mode for size, _, modes in every if size - least < ALIKE for mode in modes}
    return least, q, tuple(sorted(alike))


def _met(
    sampled: SampledSingularities, curve: int, s: float, values: Floats
) -> list[tuple[float, tuple[int, ...]]]:
    """Return the inputs of the range with a configuration of a curve, and its modes."""
    met = sampled.met([(curve, s)], values, SAME_INPUT)
    return [(q, tuple(modes)) for q, modes, inside in met if modes and inside]


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

    places, squares = find_local_minima(square, grid, limit**2)
    if curve.closed:
        lap = (places >= grid[1]) & (places < grid[1] + curve.length)
        places = np.mod(places[lap], curve.length)
        squares = squares[lap]
    ends, inward = _ends(sampled, number)
    there = square(ends)
    least = there <= np.minimum(square(inward), limit**2)
    squares = np.append(squares, there[least])
    return np.append(places, ends[least]), np.sqrt(squares)


def _ends(sampled: SampledSingularities, number: int) -> tuple[Floats, Floats]:
    """Return where the range or a curve ends, and places a little inward (k,)."""
    curve = sampled.curves[number]
    pieces = sampled.configurations.curves[number].pieces
    rows = [(piece.start, piece.stop, piece.shift) for piece in pieces]
    ends, shifts = np.split(np.reshape(rows, (-1, 3)), [2], axis=1)
    turned = curve.at(ends.ravel()).values[:, sampled.tracer.solver.input_variable]
    q = turned.reshape(ends.shape) + shifts
    taken = np.zeros(ends.shape, dtype=bool)
    if not sampled.whole_range(number):
        taken |= np.min(np.abs(q[..., None] - sampled.range), axis=2) < AT_END
    if Status.AT_SINGULARITY not in curve.ends and not curve.closed:
        taken |= np.minimum(ends, curve.length - ends) < AT_END
    inward = ends + INWARD * np.diff(ends) * [1.0, -1.0]
    return ends[taken], inward[taken]
