"""Configurations, poles and rates of spherekit judged by those in 90 digits."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, final

import mpmath as mp
import numpy as np

from benchmarks.extremes.reference import (
    DIGITS,
    Exact,
    NoSolution,
    Reference,
    Truth,
    cross,
    exact,
    length,
    truth,
)
from benchmarks.extremes.registry import ROUNDOFF, Row
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_field import PoleField
from spherekit.velocities.pole_request import Route, request

BEYOND = float("inf")
"""Conditioning where there is no configuration, or no rate."""


@final
@dataclass(frozen=True)
class Point:
    """A parameter, inputs (inputs,) of a mechanism, and variables near the solution."""

    parameter: float
    inputs: Any
    near: Exact


def judged(
    reference: Reference,
    points: Sequence[Point],
    *,
    poles: bool = True,
    derivatives: bool = True,
    search: bool = True,
    route: Route = "best",
) -> Iterator[Row]:
    """Yield what spherekit makes of points of one assembly mode, the surest point first.

    The assembly mode is the one that is nearest to the first point; at the others it is
    taken by its number, so a flip of modes shows as an error. `poles`, `derivatives`,
    `search` and `route` say what is asked for.
    """
    path = np.array([np.asarray(point.inputs, dtype=float) for point in points])
    tracer = PositionAnalysis(reference.mechanism, path=path, search=search)
    motion, mechanism = tracer.motion(), tracer.mechanism
    driven = mechanism.pairs[reference.tree.owners[reference.moved]].name
    every = all_poles(len(mechanism.links)) if poles else ()
    rates = [(0, link) for link in range(1, len(mechanism.links))]
    wanted = request(mechanism, driven, every, [*every, *rates], derivatives)
    field = evaluate(motion, wanted, route=route)
    number = -1
    for k, point in enumerate(points):
        with mp.workdps(DIGITS):
            start = point.near.copy()
            start[list(reference.inputs)] = exact(path[k])
            try:
                known = truth(
                    reference, reference.closed(start, reference.inputs), derivatives
                )
            except NoSolution:
                known = None
            if number < 0:
                number = _nearest(
                    reference, motion, range(k, len(motion), len(points)), point
                )
            row = number * len(points) + k
            if known is None:
                yield from _unreachable(reference, motion, field, row, point)
            else:
                yield from _compared(motion, field, row, point.parameter, known)


def _nearest(
    reference: Reference, motion: Motion, rows: Sequence[int], point: Point
) -> int:
    """Return the number of the row whose angles are nearest to those of a point."""
    near = point.near[reference.angles].astype(float)
    gaps = np.abs(np.sin(0.5 * (motion.values[:, reference.angles] - near)))
    return int(np.argmin([np.max(np.nan_to_num(gaps[row], nan=2.0)) for row in rows]))


def _unreachable(
    reference: Reference, motion: Motion, field: PoleField, row: int, point: Point
) -> Iterator[Row]:
    """Yield rows where no configuration exists: none may be given without a status."""
    status = Status(motion.status[row])
    error = 0.0
    if not motion.failed[row]:
        near = exact(motion.values[row]) - point.near
        error = float(max(abs(mp.sin(x / 2)) for x in near[reference.angles])) * 2
        if status == Status.AT_SINGULARITY and error < 1e-2:
            error = 0.0
    yield Row(point.parameter, "positions", BEYOND, error, status.name)
    yield Row(point.parameter, "rates", BEYOND, BEYOND, Status(field.status[row]).name)


def _compared(
    motion: Motion, field: PoleField, row: int, parameter: float, known: Truth
) -> Iterator[Row]:
    status = Status(motion.status[row])
    held = not motion.failed[row]
    angles = [v for v in range(motion.values.shape[1]) if _is_angle(motion, v)]
    if held:
        turn = exact(motion.values[row, angles]) - known.angles
        error = float(max(abs(2 * mp.sin(x / 2)) for x in turn))
        yield Row(parameter, "angles", known.condition["angles"], error)
        gap = np.max(np.abs(exact(motion.rotations[row]) - known.rotations))
        yield Row(parameter, "orientations", known.condition["rotations"], float(gap))
    else:
        condition = known.condition["angles"]
        yield Row(parameter, "angles", condition, BEYOND, status.name)
    status = Status(field.status[row])
    for name, given, right in (
        ("rates", field.w, known.rates),
        ("derivatives", field.dw, known.derivatives),
    ):
        if right is None:
            continue
        error = BEYOND
        if status == Status.OK:
            size = max(mp.mpf(1), max(length(right)))
            found = np.stack([given[link][row] for link in sorted(given)])
            gap = exact(found) - right[sorted(given)]
            error = float(max(length(gap)) / size)
        yield Row(parameter, name, known.condition[name], error, status.name)
    if status == Status.OK:
        yield from _poles(field, row, parameter, known)


def _is_angle(motion: Motion, variable: int) -> bool:
    pair = motion.mechanism.variable_owners[variable]
    return motion.mechanism.pairs[pair].type == "R"


def _poles(field: PoleField, row: int, parameter: float, known: Truth) -> Iterator[Row]:
    """Yield the worst of the directions given, and the worst refused."""
    given: list[Row] = []
    refused: list[Row] = []
    largest = max(mp.mpf(1), max(length(known.rates)))
    for (i, j), directions in field.direction.items():
        unit, condition, size = known.pole(i, j)
        status = Status(field.pole_status[i, j][row])
        if status == Status.OK:
            rate = abs(float(field.velocity_coefficient[i, j][row]))
            off = float(abs(exact(rate) - mp.mpf(size)) / largest)
            given.append(Row(parameter, "coefficients", known.condition["rates"], off))
            if size == 0.0:
                continue
            error = float(length(cross(exact(directions[row]), unit)))
            given.append(Row(parameter, "poles", condition, error))
        elif size > 0.0:
            refused.append(Row(parameter, "poles", condition, BEYOND, status.name))
    for quantity in ("coefficients", "poles"):
        of = [each for each in given if each.quantity == quantity]
        if of:
            yield max(of, key=lambda each: (each.wrong, _known(each.ratio)))
    if refused:
        yield min(refused, key=lambda each: each.conditioning)


def _known(ratio: float) -> float:
    return ratio if np.isfinite(ratio) else 1 / ROUNDOFF
