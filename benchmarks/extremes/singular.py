"""Approaches to singular configurations, from 1e-1 down to rounding.

The singular configuration is found in 90 digits. Points on the curve beside it are found
by holding the variable that moves most, so both modes that meet at a dead centre of the
input are told apart; their inputs are then rounded to doubles and solved for again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import mpmath as mp
import numpy as np

from benchmarks.extremes.kinematics import Point, judged
from benchmarks.extremes.reference import DIGITS, Exact, Reference, exact
from benchmarks.extremes.registry import Row, case, down
from benchmarks.extremes.shapes import four_bar
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.position_analysis import PositionAnalysis

FAMILY = "singularities"
ALONG = "distance on the curve, rad"
TO_DEAD_CENTRE = down(1e-1, 1e-8, 10**0.5)
"""The input's distance goes with the square of it: down to 1e-16."""
TO_STANDSTILL = down(1e-1, 1e-15)


def beside(
    reference: Reference, singular: Exact, distances: Sequence[float], sign: int
) -> list[Point]:
    """Return points beside a singular configuration, at distances along the curve.

    With several inputs those that stand still keep their values.
    """
    points = []
    with mp.workdps(DIGITS):
        held = [v for v in reference.inputs if v != reference.moved]
        tangent = reference.tangent(singular, held)
        most = int(np.argmax(np.abs(tangent)))
        for distance in distances:
            guess = singular + sign * mp.mpf(distance) * tangent
            there = reference.closed(guess, [*held, most])
            inputs = [float(there[v]) for v in reference.inputs]
            points.append(Point(sign * distance, inputs, there))
    return points


def standstill(mechanism: Mechanism, stands: str, others: Sequence[float] = ()) -> Exact:
    """Return a configuration (variables,) in which one pair stands still, as doubles.

    The first on the curve of the first input through the first assembly mode that has one;
    `others` are the values of the inputs that stand still.
    """
    reference = Reference(mechanism)
    first = mechanism.inputs[0]
    path = np.array([[q, *others] for q in np.linspace(first.start, first.stop, 9)])
    tracer = PositionAnalysis(mechanism, path=path)
    motion = tracer.motion()
    (number,) = mechanism.variables_of(mechanism.pair_number[stands])
    for assembly_mode in range(len(motion.assembly_modes)):
        rows = slice(assembly_mode * motion.samples, (assembly_mode + 1) * motion.samples)
        known = motion.values[rows][~motion.failed[rows]]
        if not len(known):
            continue
        held = [v for v in reference.inputs if v != reference.moved]
        locked = tracer.solver.closure.locked(held, known[:1, held])
        curve = follow_arc(locked, known[0])
        places = curve.dead_points(number).places
        if len(places):
            return curve.at(places[:1]).values[0]
    raise LookupError(f"{mechanism.name}: pair {stands} stands still nowhere")


def posed(mechanism: Mechanism, values: Exact) -> Mechanism:
    """Return a mechanism of R pairs with its reference pose at a configuration."""
    with mp.workdps(DIGITS):
        axes = Reference(mechanism).place(exact(values)).vectors.astype(float)
    pairs = zip(mechanism.pairs, axes, values, strict=True)
    given = [(pair.name, tuple(axis.tolist()), float(x)) for pair, axis, x in pairs]
    geometry = PoseGeometry(
        {name: axis for name, axis, _ in given}, {name: x for name, _, x in given}
    )
    return replace(mechanism, geometry=geometry)


def approached(
    mechanism: Mechanism,
    stands: str,
    distances: Sequence[float],
    others: Sequence[float] = (),
    repose: bool = False,
) -> Iterator[Row]:
    """Yield rows on both sides of a configuration in which a pair stands still.

    With `repose` the mechanism is given by a pose at the first of the points, so that its
    mode needs no search.
    """
    values = standstill(mechanism, stands, others)
    for sign in (1, -1):
        made, start = mechanism, exact(values)
        if repose:
            reference = Reference(made)
            first = beside(reference, _singular(reference, start, stands), (0.1,), sign)
            made = posed(made, first[0].near.astype(float))
        reference = Reference(made)
        singular = _singular(reference, start, stands)
        yield from judged(reference, beside(reference, singular, distances, sign))


def _singular(reference: Reference, start: Exact, stands: str) -> Exact:
    mechanism = reference.mechanism
    (number,) = mechanism.variables_of(mechanism.pair_number[stands])
    held = [v for v in reference.inputs if v != reference.moved]
    with mp.workdps(DIGITS):
        return reference.turning(start, number, held)


@case(FAMILY, ALONG, TO_DEAD_CENTRE)
def four_bar_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II: the shipped four-bar driven at its rocker, near the rocker's dead centre."""
    yield from approached(load("four_bar").with_inputs("41"), "41", distances)


@case(FAMILY, ALONG, TO_STANDSTILL)
def four_bar_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I: the shipped four-bar driven at its crank, where the rocker turns back."""
    yield from approached(load("four_bar"), "41", distances)


@case(FAMILY, ALONG, TO_DEAD_CENTRE)
def stephenson_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of a triad: the shipped Stephenson driven outside its four-bar, at 16."""
    yield from approached(
        load("stephenson").with_inputs("16"), "16", distances, repose=True
    )


@case(FAMILY, ALONG, TO_STANDSTILL)
def stephenson_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I: the shipped Stephenson driven at its crank, where link 6 turns back."""
    yield from approached(load("stephenson"), "16", distances)


@case(FAMILY, ALONG, TO_DEAD_CENTRE)
def double_butterfly_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of a group of seven bodies: the double butterfly driven at pair B."""
    yield from approached(
        load("double_butterfly").with_inputs("B"), "B", distances, repose=True
    )


@case(FAMILY, ALONG, TO_STANDSTILL)
def double_butterfly_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I: the double butterfly driven at pair A, where link 5 turns back."""
    yield from approached(load("double_butterfly"), "B", distances, repose=True)


@case(FAMILY, ALONG, TO_DEAD_CENTRE)
def five_bar_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of two inputs: the shipped five-bar, its second crank at 90 deg."""
    yield from approached(load("five_bar"), "21", distances, (np.pi / 2,))


@case(FAMILY, ALONG, TO_STANDSTILL)
def five_bar_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I of two inputs: the same, where the first crank does not move the pointer."""
    yield from approached(load("five_bar"), "54", distances, (np.pi / 2,))


@case(FAMILY, ALONG, TO_DEAD_CENTRE)
def three_rrr_dead_centre(distances: Sequence[float]) -> Iterator[Row]:
    """Type II of three inputs: the shipped 3-RRR, two of its cranks in the middle."""
    others = [0.5 * (item.start + item.stop) for item in load("three_rrr").inputs[1:]]
    yield from approached(load("three_rrr"), "a1", distances, others, repose=True)


@case(FAMILY, ALONG, TO_STANDSTILL)
def three_rrr_output_stands(distances: Sequence[float]) -> Iterator[Row]:
    """Type I of three inputs: the same, where the platform does not follow a crank."""
    others = [0.5 * (item.start + item.stop) for item in load("three_rrr").inputs[1:]]
    yield from approached(load("three_rrr"), "b2", distances, others, repose=True)


@case(FAMILY, "input beside the change point, rad", TO_STANDSTILL)
def change_point(distances: Sequence[float]) -> Iterator[Row]:
    """Type III: a four-bar with opposite arcs equal, where its two modes cross."""
    made = four_bar(np.radians([60.0, 40.0, 60.0, 40.0]).tolist())
    first = PositionAnalysis(made, path=np.array([[0.5]])).motion()
    reference = Reference(made)
    for values in first.values:
        with mp.workdps(DIGITS):
            points = _continued(reference, exact(values), distances)
        yield from judged(reference, points)


def _continued(
    reference: Reference, values: Exact, distances: Sequence[float]
) -> list[Point]:
    """Return points at inputs from large to small, each start from half as far again."""
    points = []
    for distance in distances:
        while True:
            here = values[reference.moved]
            goal = max(mp.mpf(distance), here / 2)
            rates, _ = reference.rates(reference.place(values))
            values = values + (goal - here) * rates
            values[reference.moved] = goal
            values = reference.closed(values, reference.inputs)
            if goal == mp.mpf(distance):
                break
        points.append(Point(distance, [distance], values))
    return points


@case(FAMILY, "distance of the cranks' ends, rad", TO_STANDSTILL)
def folded_dyad(distances: Sequence[float]) -> Iterator[Row]:
    """Type III of two inputs: the shipped five-bar, its two outer links nearly folded."""
    made = load("five_bar")
    reference = Reference(made)
    meeting = float(np.arccos(1.0 / np.tan(np.radians(75.0))))
    for sign in (1.0, -1.0):
        path = np.array([[meeting - sign * each, -meeting] for each in distances])
        motion = PositionAnalysis(made, path=path).motion()
        # From farther away the reference does not reach configurations this near.
        near = exact(motion.values[np.argmin(np.abs(np.array(distances) - 1e-3))])
        points = [
            Point(sign * each, inputs, near)
            for each, inputs in zip(distances, path, strict=True)
        ]
        yield from judged(reference, points)
