"""Configurations, poles and rates of spherekit, compared with those in 90 digits."""

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

INFINITE = float("inf")
"""Conditioning, or error, where there is no configuration or no rate."""

FAILED_DISTANCE = 2.0
"""Distance of a configuration that failed, larger than that of any other."""

NEAR_SINGULARITY_RAD = 1e-2
"""Distance (rad) at which a configuration with `AT_SINGULARITY` is accepted.

Beyond a dead centre, where no configuration exists, it stands for the dead centre.
"""


@final
@dataclass(frozen=True)
class Point:
    """A configuration at which a mechanism is judged.

    Attributes
    ----------
    parameter
        Value of the parameter of the case.
    inputs
        (inputs,) inputs (rad).
    near
        (variables,) a configuration (rad) near the solution, in 90 digits.
    """

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
    """Yield the errors of spherekit at points of one assembly mode.

    The assembly mode is that which is nearest to the first point. At the other points it is
    taken by its number, so that a jump to another mode is an error.

    Parameters
    ----------
    reference
        The mechanism.
    points
        The points. The first one must be far from singular configurations.
    poles, derivatives
        Whether poles, and derivatives of the rates, are computed.
    search
        Whether all assembly modes are searched, or only that of the reference pose.
    route
        How poles are computed.
    """
    path = np.array([np.asarray(point.inputs, dtype=float) for point in points])
    position_analysis = PositionAnalysis(reference.mechanism, path=path, search=search)
    motion = position_analysis.motion()
    mechanism = position_analysis.mechanism
    moved_pair = mechanism.pairs[reference.tree.pair_of_variable[reference.moved]].name
    requested_poles = all_poles(len(mechanism.links)) if poles else ()
    rates = [(0, link) for link in range(1, len(mechanism.links))]
    pole_request = request(
        mechanism, moved_pair, requested_poles, [*requested_poles, *rates], derivatives
    )
    field = evaluate(motion, pole_request, route=route)
    mode = -1
    for k, point in enumerate(points):
        with mp.workdps(DIGITS):
            start = point.near.copy()
            start[list(reference.inputs)] = exact(path[k])
            true_values = None
            try:
                configuration = reference.closed(start, reference.inputs)
                true_values = truth(reference, configuration, derivatives)
            except NoSolution:
                pass
            if mode < 0:
                # The rows of a motion are sorted by mode and then by sample.
                rows_of_modes = range(k, len(motion), len(points))
                mode = _find_nearest_row(reference, motion, rows_of_modes, point)
            row = mode * len(points) + k
            if true_values is None:
                yield from _judge_unreachable(reference, motion, field, row, point)
            else:
                yield from _compare(motion, field, row, point.parameter, true_values)


def _find_nearest_row(
    reference: Reference, motion: Motion, rows: Sequence[int], point: Point
) -> int:
    """Return the index in `rows` of the row whose angles are nearest to a point."""
    angles = reference.angles
    point_angles = point.near[angles].astype(float)
    differences = np.abs(np.sin(0.5 * (motion.values[:, angles] - point_angles)))
    distances = [
        np.max(np.nan_to_num(differences[row], nan=FAILED_DISTANCE)) for row in rows
    ]
    return int(np.argmin(distances))


def _judge_unreachable(
    reference: Reference, motion: Motion, field: PoleField, row: int, point: Point
) -> Iterator[Row]:
    """Yield rows where no configuration exists: numbers need a status.

    Parameters
    ----------
    reference
        The mechanism.
    motion, field
        Configurations and rates of spherekit.
    row
        Their row at the point.
    point
        The point.
    """
    status = Status(motion.status[row])
    error = 0.0
    if not motion.failed[row]:
        differences = (exact(motion.values[row]) - point.near)[reference.angles]
        error = float(max(abs(mp.sin(x / 2)) for x in differences)) * 2
        if status == Status.AT_SINGULARITY and error < NEAR_SINGULARITY_RAD:
            error = 0.0
    yield Row(point.parameter, "positions", INFINITE, error, status.name)
    rate_status = Status(field.status[row]).name
    yield Row(point.parameter, "rates", INFINITE, INFINITE, rate_status)


def _compare(
    motion: Motion, field: PoleField, row: int, parameter: float, true_values: Truth
) -> Iterator[Row]:
    """Yield the errors at a configuration that exists.

    Parameters
    ----------
    motion, field
        Configurations and rates of spherekit.
    row
        Their row.
    parameter
        Value of the parameter of the case.
    true_values
        The quantities in 90 digits.
    """
    position_status = Status(motion.status[row])
    condition = true_values.condition
    angles = [v for v in range(motion.values.shape[1]) if _is_angle(motion, v)]
    if motion.failed[row]:
        yield Row(parameter, "angles", condition["angles"], INFINITE, position_status.name)
    else:
        differences = exact(motion.values[row, angles]) - true_values.angles
        error = float(max(abs(2 * mp.sin(x / 2)) for x in differences))
        yield Row(parameter, "angles", condition["angles"], error)
        rotation_errors = np.abs(exact(motion.rotations[row]) - true_values.rotations)
        error = float(np.max(rotation_errors))
        yield Row(parameter, "orientations", condition["rotations"], error)
    status = Status(field.status[row])
    for name, link_vectors, true_vectors in (
        ("rates", field.w, true_values.rates),
        ("derivatives", field.dw, true_values.derivatives),
    ):
        if true_vectors is None:
            continue
        error = INFINITE
        if status == Status.OK:
            links = sorted(link_vectors)
            vectors = np.stack([link_vectors[link][row] for link in links])
            size = max(mp.mpf(1), max(length(true_vectors)))
            error = float(max(length(exact(vectors) - true_vectors[links])) / size)
        yield Row(parameter, name, condition[name], error, status.name)
    if status == Status.OK:
        yield from _compare_poles(field, row, parameter, true_values)


def _is_angle(motion: Motion, variable: int) -> bool:
    """Return whether a variable belongs to an R pair."""
    pair = motion.mechanism.variable_owners[variable]
    return motion.mechanism.pairs[pair].type == "R"


def _compare_poles(
    field: PoleField, row: int, parameter: float, true_values: Truth
) -> Iterator[Row]:
    """Yield the largest errors of poles and coefficients, and the best refused pole."""
    compared: list[Row] = []
    refused: list[Row] = []
    largest_rate = max(mp.mpf(1), max(length(true_values.rates)))
    for (i, j), directions in field.direction.items():
        true_direction, conditioning, true_rate = true_values.pole(i, j)
        status = Status(field.pole_status[i, j][row])
        if status == Status.OK:
            rate = abs(float(field.velocity_coefficient[i, j][row]))
            error = float(abs(exact(rate) - mp.mpf(true_rate)) / largest_rate)
            rate_conditioning = true_values.condition["rates"]
            compared.append(Row(parameter, "coefficients", rate_conditioning, error))
            if true_rate == 0.0:
                continue  # links that rest relative to each other have no pole
            error = float(length(cross(exact(directions[row]), true_direction)))
            compared.append(Row(parameter, "poles", conditioning, error))
        elif true_rate > 0.0:
            refused.append(Row(parameter, "poles", conditioning, INFINITE, status.name))
    for quantity in ("coefficients", "poles"):
        rows = [item for item in compared if item.quantity == quantity]
        if rows:
            yield max(rows, key=lambda item: (item.wrong, _finite_ratio(item.ratio)))
    if refused:
        yield min(refused, key=lambda item: item.conditioning)


def _finite_ratio(ratio: float) -> float:
    """Return a ratio, or a number larger than any ratio if it is not finite."""
    return ratio if np.isfinite(ratio) else 1 / ROUNDOFF
