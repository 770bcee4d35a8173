"""Axes that are parallel, or in one plane, to within a small angle."""

from collections.abc import Iterator, Sequence

import mpmath as mp
import numpy as np

from benchmarks.extremes.kinematics import Point, judged
from benchmarks.extremes.reference import DIGITS, Reference, exact
from benchmarks.extremes.registry import Row, case, down
from benchmarks.extremes.shapes import four_bar, point_of
from benchmarks.samples import EIGHT_BARS, make_mechanism, random_axes
from spherekit.mechanism.joint_construction import make_joints_in_pose
from spherekit.mechanism.mechanism import Mechanism
from spherekit.velocities.pole_request import Route

FAMILY = "parallel axes"
APART = "angle between, rad"
ANGLES = down(1e-1, 1e-14)
CHAINS = (0, 5, 13)
"""A chain of dyads, the double butterfly, and one with a triad."""


def at_pose(
    made: Mechanism, parameter: float, derivatives: bool = True, route: Route = "best"
) -> Iterator[Row]:
    """Yield the rows of a mechanism in its reference pose."""
    reference = Reference(made)
    values = make_joints_in_pose(made)[1]
    assert values is not None
    with mp.workdps(DIGITS):
        point = Point(parameter, values[list(reference.inputs)], exact(values))
    yield from judged(
        reference, [point], derivatives=derivatives, search=False, route=route
    )


@case(FAMILY, APART, ANGLES)
def crank_without_length(angles: Sequence[float]) -> Iterator[Row]:
    """A four-bar whose crank has two nearly coaxial pairs: nothing moves but the crank."""
    for angle in angles:
        reference, point = point_of(four_bar((1.0, angle, 1.0, 0.7)), angle, 0.7)
        yield from judged(reference, [point])


@case(FAMILY, APART, ANGLES)
def axes_of_one_link(angles: Sequence[float]) -> Iterator[Row]:
    """Three eight-bars with two nearly parallel axes in a link that has three."""
    for number in CHAINS:
        for angle in angles:
            yield from at_pose(_eight_bar(number, angle, adjacent=True), angle)


@case(FAMILY, APART, ANGLES)
def axes_of_two_lines(angles: Sequence[float]) -> Iterator[Row]:
    """Three eight-bars with nearly parallel axes in links that are not joined."""
    for number in CHAINS:
        for angle in angles:
            yield from at_pose(_eight_bar(number, angle, adjacent=False), angle)


def _eight_bar(number: int, angle: float, adjacent: bool) -> Mechanism:
    """Return a random eight-bar with two axes `angle` apart, the first such two."""
    random = np.random.default_rng(number)
    axes = random_axes(random, 10)
    chain = make_mechanism(EIGHT_BARS[number], axes)
    ends = chain.ends
    one, other = next(
        (a, b)
        for a in range(1, 10)
        for b in range(a + 1, 10)
        if bool(set(ends[a]) & set(ends[b])) == adjacent
        and (not adjacent or 0 not in (*ends[a], *ends[b]))
    )
    axes[other] = _beside(axes[one], axes[other], angle)
    return make_mechanism(EIGHT_BARS[number], axes)


def _beside(axis: np.ndarray, toward: np.ndarray, angle: float) -> np.ndarray:
    side = toward - (toward @ axis) * axis
    found = np.cos(angle) * axis + np.sin(angle) * side / np.linalg.norm(side)
    return np.asarray(found / np.linalg.norm(found))


@case(FAMILY, "angle out of the plane, rad", ANGLES)
def three_axes_in_a_plane(angles: Sequence[float]) -> Iterator[Row]:
    """A four-bar in an eight-bar with three axes nearly in a plane: one pair stands still.

    The fourth axis is elsewhere, so the planes of the lecture's construction are well
    apart, but one of the coefficients is nearly zero.
    """
    for angle in angles:
        yield from at_pose(_flat(angle, out=3), angle)


@case(FAMILY, "angle out of the plane, rad", ANGLES)
def two_lines_in_a_plane(angles: Sequence[float]) -> Iterator[Row]:
    """The same with all four axes nearly in a plane: both lines of a pole coincide."""
    for angle in angles:
        yield from at_pose(_flat(angle, out=4), angle)


def _flat(angle: float, out: int) -> Mechanism:
    """Return an eight-bar whose first four-bar has `out` axes nearly in a plane."""
    random = np.random.default_rng(5)
    axes = random_axes(random, 10)
    chain = make_mechanism(EIGHT_BARS[0], axes)
    loop = [chain.pair_number[name] for name in ("p1_2", "p2_3", "p3_4", "p1_4")]
    for pair in loop[:out]:
        turn, up = random.uniform(0, 2 * np.pi), random.uniform(0.5, 1.0) * angle
        axes[pair] = [np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)]
    return make_mechanism(EIGHT_BARS[0], axes / np.linalg.norm(axes, axis=1, keepdims=True))
