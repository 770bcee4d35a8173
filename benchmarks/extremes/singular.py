"""Configurations near singular ones, at distances from 1e-1 down to rounding.

The singular configuration is found in 90 digits, and points on the curve near it. The
inputs of these points are then rounded to doubles, and solved for again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import mpmath as mp
import numpy as np

from benchmarks.extremes.kinematics import Point, judged
from benchmarks.extremes.reference import DIGITS, Exact, Reference, exact
from benchmarks.extremes.registry import Row, case, down
from benchmarks.extremes.shapes import four_bar
from spherekit.arrays import Floats
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.position_analysis import PositionAnalysis

SINGULAR_FAMILY = "singularities"
ALONG = "distance on the curve, rad"

TO_DEAD_CENTRE = down(1e-1, 1e-8, 10**0.5)
"""Distances (rad) from a dead centre along the curve. The distances of the input from its
value at the dead centre are about the squares of these, and reach 1e-16."""

TO_STANDSTILL = down(1e-1, 1e-15)
"""Distances (rad) from a configuration in which an output is stationary."""

SEARCHED_MODE_SAMPLES = 9
"""Number of inputs at which assembly modes are searched."""

POSE_DISTANCE_RAD = 0.1
"""Distance (rad) from a singular configuration at which a mechanism is given by a pose."""


def list_points_near(
    reference: Reference, singular: Exact, distances: Sequence[float], sign: int
) -> list[Point]:
    """Return configurations near a singular one, on the curve through it.

    The variable that moves most along the curve is held, so that the configurations on both
    sides of a dead centre of the input are different. With several inputs, those that do
    not move keep their values.

    Parameters
    ----------
    reference
        The mechanism.
    singular
        (variables,) the singular configuration (rad).
    distances
        Distances (rad) along the curve.
    sign
        1 or -1, the side.
    """
    points = []
    with mp.workdps(DIGITS):
        held = [v for v in reference.inputs if v != reference.moved]
        tangent = reference.tangent(singular, held)
        fastest = int(np.argmax(np.abs(tangent)))
        for distance in distances:
            start = singular + sign * mp.mpf(distance) * tangent
            configuration = reference.closed(start, [*held, fastest])
            inputs = [float(configuration[v]) for v in reference.inputs]
            points.append(Point(sign * distance, inputs, configuration))
    return points


def find_standstill(
    mechanism: Mechanism, pair: str, other_inputs: Sequence[float] = ()
) -> Floats:
    """Return a configuration (variables,), in rad, in which a pair is stationary.

    It is the first such configuration on the curve along which the first input moves, in
    the first assembly mode that has one. Its numbers are doubles.

    Parameters
    ----------
    mechanism
        The mechanism.
    pair
        Name of the pair.
    other_inputs
        Values (rad) of the inputs that do not move.

    Raises
    ------
    LookupError
        If the pair is stationary in no mode.
    """
    reference = Reference(mechanism)
    first_input = mechanism.inputs[0]
    q = np.linspace(first_input.start, first_input.stop, SEARCHED_MODE_SAMPLES)
    path = np.array([[angle, *other_inputs] for angle in q])
    position_analysis = PositionAnalysis(mechanism, path=path)
    motion = position_analysis.motion()
    (variable,) = mechanism.variables_of(mechanism.pair_number[pair])
    held = [v for v in reference.inputs if v != reference.moved]
    for mode in range(len(motion.assembly_modes)):
        rows = slice(mode * motion.samples, (mode + 1) * motion.samples)
        configurations = motion.values[rows][~motion.failed[rows]]
        if not len(configurations):
            continue
        closure = position_analysis.solver.closure
        locked = closure.locked(held, configurations[:1, held])
        curve = follow_arc(locked, configurations[0])
        arc_lengths = curve.dead_points(variable).places
        if len(arc_lengths):
            return curve.at(arc_lengths[:1]).values[0]
    raise LookupError(f"{mechanism.name}: pair {pair} stands still nowhere")


def move_reference_pose(mechanism: Mechanism, values: Floats) -> Mechanism:
    """Return a mechanism of R pairs with its reference pose at a configuration.

    `values` (variables,) are the pair variables (rad) there.
    """
    with mp.workdps(DIGITS):
        axes = Reference(mechanism).place(exact(values)).vectors.astype(float)
    axis_by_pair = {}
    value_by_pair = {}
    for pair, axis, value in zip(mechanism.pairs, axes, values, strict=True):
        axis_by_pair[pair.name] = tuple(axis.tolist())
        value_by_pair[pair.name] = float(value)
    return replace(mechanism, geometry=PoseGeometry(axis_by_pair, value_by_pair))


def judge_approach(
    mechanism: Mechanism,
    pair: str,
    distances: Sequence[float],
    other_inputs: Sequence[float] = (),
    from_pose: bool = False,
) -> Iterator[Row]:
    """Yield the rows on both sides of a configuration in which a pair is stationary.

    Parameters
    ----------
    mechanism
        The mechanism.
    pair
        Name of the pair.
    distances
        Distances (rad) along the curve.
    other_inputs
        Values (rad) of the inputs that do not move.
    from_pose
        Whether the mechanism is given by a pose near the singular configuration, so that
        its mode needs no search.
    """
    values = find_standstill(mechanism, pair, other_inputs)
    for sign in (1, -1):
        judged_mechanism = mechanism
        if from_pose:
            reference = Reference(mechanism)
            singular = _find_singular(reference, exact(values), pair)
            (pose_point,) = list_points_near(
                reference, singular, (POSE_DISTANCE_RAD,), sign
            )
            judged_mechanism = move_reference_pose(mechanism, pose_point.near.astype(float))
        reference = Reference(judged_mechanism)
        singular = _find_singular(reference, exact(values), pair)
        points = list_points_near(reference, singular, distances, sign)
        yield from judged(reference, points)


def _find_singular(reference: Reference, start: Exact, pair: str) -> Exact:
    """Return the configuration (variables,) in which a pair is stationary, in 90 digits."""
    mechanism = reference.mechanism
    (variable,) = mechanism.variables_of(mechanism.pair_number[pair])
    held = [v for v in reference.inputs if v != reference.moved]
    with mp.workdps(DIGITS):
        return reference.find_singular(start, variable, held)


@case(SINGULAR_FAMILY, ALONG, TO_DEAD_CENTRE)
def four_bar_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II: the shipped four-bar driven at its rocker, near the rocker's dead centre."""
    yield from judge_approach(load("four_bar").with_inputs("41"), "41", distances)


@case(SINGULAR_FAMILY, ALONG, TO_STANDSTILL)
def four_bar_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I: the shipped four-bar driven at its crank, where the rocker turns back."""
    yield from judge_approach(load("four_bar"), "41", distances)


@case(SINGULAR_FAMILY, ALONG, TO_DEAD_CENTRE)
def stephenson_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of a triad: the shipped Stephenson driven outside its four-bar, at 16."""
    yield from judge_approach(
        load("stephenson").with_inputs("16"), "16", distances, from_pose=True
    )


@case(SINGULAR_FAMILY, ALONG, TO_STANDSTILL)
def stephenson_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I: the shipped Stephenson driven at its crank, where link 6 turns back."""
    yield from judge_approach(load("stephenson"), "16", distances)


@case(SINGULAR_FAMILY, ALONG, TO_DEAD_CENTRE)
def double_butterfly_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of a group of seven bodies: the double butterfly driven at pair B."""
    yield from judge_approach(
        load("double_butterfly").with_inputs("B"), "B", distances, from_pose=True
    )


@case(SINGULAR_FAMILY, ALONG, TO_STANDSTILL)
def double_butterfly_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I: the double butterfly driven at pair A, where link 5 turns back."""
    yield from judge_approach(load("double_butterfly"), "B", distances, from_pose=True)


@case(SINGULAR_FAMILY, ALONG, TO_DEAD_CENTRE)
def five_bar_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of two inputs: the shipped five-bar, its second crank at 90 deg."""
    yield from judge_approach(load("five_bar"), "21", distances, (np.pi / 2,))


@case(SINGULAR_FAMILY, ALONG, TO_STANDSTILL)
def five_bar_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I of two inputs: the same, where the first crank does not move the pointer."""
    yield from judge_approach(load("five_bar"), "54", distances, (np.pi / 2,))


@case(SINGULAR_FAMILY, ALONG, TO_DEAD_CENTRE)
def three_rrr_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of three inputs: the shipped 3-RRR, two of its cranks in the middle."""
    others = [0.5 * (item.start + item.stop) for item in load("three_rrr").inputs[1:]]
    yield from judge_approach(load("three_rrr"), "a1", distances, others, from_pose=True)


@case(SINGULAR_FAMILY, ALONG, TO_STANDSTILL)
def three_rrr_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I of three inputs: the same, where the platform does not follow a crank."""
    others = [0.5 * (item.start + item.stop) for item in load("three_rrr").inputs[1:]]
    yield from judge_approach(load("three_rrr"), "b2", distances, others, from_pose=True)


@case(SINGULAR_FAMILY, "input beside the change point, rad", TO_STANDSTILL)
def change_point(distances: Sequence[float]) -> Iterator[Row]:
    """Type III: a four-bar with opposite arcs equal, where its two modes cross."""
    mechanism = four_bar(np.radians([60.0, 40.0, 60.0, 40.0]).tolist())
    motion = PositionAnalysis(mechanism, path=np.array([[0.5]])).motion()
    reference = Reference(mechanism)
    for values in motion.values:
        with mp.workdps(DIGITS):
            points = _continue_to_inputs(reference, exact(values), distances)
        yield from judged(reference, points)


def _continue_to_inputs(
    reference: Reference, values: Exact, inputs: Sequence[float]
) -> list[Point]:
    """Return configurations at decreasing inputs (rad).

    Each step at most halves the input, and starts from the configuration before along the
    tangent of the curve, so that the mode does not change.

    Parameters
    ----------
    reference
        A mechanism with one input.
    values
        (variables,) a configuration (rad) at a larger input.
    inputs
        The inputs (rad), which decrease to 0.
    """
    points = []
    for final_input in inputs:
        while True:
            current_input = values[reference.moved]
            next_input = max(mp.mpf(final_input), current_input / 2)
            rates, _ = reference.rates(reference.place(values))
            values = values + (next_input - current_input) * rates
            values[reference.moved] = next_input
            values = reference.closed(values, reference.inputs)
            if next_input == mp.mpf(final_input):
                break
        points.append(Point(final_input, [final_input], values))
    return points


REFERENCE_DISTANCE_RAD = 1e-3
"""Distance from the folded dyad of the start of Newton's method in 90 digits.

From farther away it does not reach the nearest configurations.
"""


@case(SINGULAR_FAMILY, "distance of the cranks' ends, rad", TO_STANDSTILL)
def folded_dyad(distances: Sequence[float]) -> Iterator[Row]:
    """Type III of two inputs: the shipped five-bar, its two outer links nearly folded.

    If the ends of both cranks coincide, the outer links lie on each other. They can turn
    together about the common end while the inputs rest. `distances` (rad) are those of the
    first input from this position, on both sides. As in all cases, the rows are errors of
    spherekit against a computation in 90 digits.
    """
    mechanism = load("five_bar")
    reference = Reference(mechanism)
    # At these inputs the ends of the cranks coincide.
    meeting_input = float(np.arccos(1.0 / np.tan(np.radians(75.0))))
    for sign in (1.0, -1.0):
        path = np.array(
            [[meeting_input - sign * distance, -meeting_input] for distance in distances]
        )
        motion = PositionAnalysis(mechanism, path=path).motion()
        nearest = np.argmin(np.abs(np.array(distances) - REFERENCE_DISTANCE_RAD))
        # Newton's method in 90 digits starts from this configuration at all points.
        start = exact(motion.values[nearest])
        points = [
            Point(sign * distance, inputs, start)
            for distance, inputs in zip(distances, path, strict=True)
        ]
        yield from judged(reference, points)
