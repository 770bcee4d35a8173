"""Axes that are parallel, or in one plane, up to a small angle."""

from collections.abc import Iterator, Sequence

import mpmath as mp
import numpy as np

from benchmarks.extremes.kinematics import Point, judged
from benchmarks.extremes.reference import DIGITS, Reference, exact
from benchmarks.extremes.registry import Row, case, down
from benchmarks.extremes.shapes import four_bar, point_of
from benchmarks.samples import EIGHT_BARS, make_mechanism, random_axes
from spherekit.arrays import Floats
from spherekit.mechanism.joint_construction import make_joints_in_pose
from spherekit.mechanism.mechanism import Mechanism
from spherekit.velocities.pole_request import Route

PARALLEL_FAMILY = "parallel axes"
AXIS_ANGLE = "angle between, rad"
PLANE_ANGLE = "angle out of the plane, rad"
ANGLES = down(1e-1, 1e-14)

EIGHT_BAR_NUMBERS = (0, 5, 13)
"""Eight-bars: a chain of dyads, the double butterfly, and one with a triad."""

PAIR_COUNT = 10
"""Number of pairs of an eight-bar."""


def judge_reference_pose(
    mechanism: Mechanism,
    parameter: float,
    derivatives: bool = True,
    route: Route = "best",
) -> Iterator[Row]:
    """Yield the errors of a mechanism in its reference pose.

    Parameters
    ----------
    mechanism
        A mechanism that is given by a reference pose.
    parameter
        Value of the parameter of the case.
    derivatives
        Whether derivatives of the rates are computed.
    route
        How poles are computed.
    """
    reference = Reference(mechanism)
    _, values = make_joints_in_pose(mechanism)
    assert values is not None
    with mp.workdps(DIGITS):
        point = Point(parameter, values[list(reference.inputs)], exact(values))
    yield from judged(
        reference, [point], derivatives=derivatives, search=False, route=route
    )


@case(PARALLEL_FAMILY, AXIS_ANGLE, ANGLES)
def crank_without_length(angles: Sequence[float]) -> Iterator[Row]:
    """A four-bar whose crank has two nearly coaxial pairs: nothing moves but the crank."""
    for angle in angles:
        reference, point = point_of(four_bar((1.0, angle, 1.0, 0.7)), angle, 0.7)
        yield from judged(reference, [point])


@case(PARALLEL_FAMILY, AXIS_ANGLE, ANGLES)
def axes_of_one_link(angles: Sequence[float]) -> Iterator[Row]:
    """Three eight-bars with two nearly parallel axes in a link that has three."""
    for number in EIGHT_BAR_NUMBERS:
        for angle in angles:
            mechanism = _eight_bar_with_parallel_axes(number, angle, share_link=True)
            yield from judge_reference_pose(mechanism, angle)


@case(PARALLEL_FAMILY, AXIS_ANGLE, ANGLES)
def axes_of_two_lines(angles: Sequence[float]) -> Iterator[Row]:
    """Three eight-bars with nearly parallel axes in links that are not joined."""
    for number in EIGHT_BAR_NUMBERS:
        for angle in angles:
            mechanism = _eight_bar_with_parallel_axes(number, angle, share_link=False)
            yield from judge_reference_pose(mechanism, angle)


def _eight_bar_with_parallel_axes(number: int, angle: float, share_link: bool) -> Mechanism:
    """Return a random eight-bar with two nearly parallel axes.

    Parameters
    ----------
    number
        Number of the eight-bar, and seed of its axes.
    angle
        Angle (rad) between the two axes.
    share_link
        Whether the two pairs have a link in common, which is not the ground. Otherwise they
        have none.
    """
    axes = random_axes(np.random.default_rng(number), PAIR_COUNT)
    ends = make_mechanism(EIGHT_BARS[number], axes).ends

    def is_wanted(pair_a: int, pair_b: int) -> bool:
        has_common_link = bool(set(ends[pair_a]) & set(ends[pair_b]))
        at_ground = 0 in (*ends[pair_a], *ends[pair_b])
        if share_link:
            return has_common_link and not at_ground
        return not has_common_link

    # Pair 0 is the input.
    first, second = next(
        (a, b)
        for a in range(1, PAIR_COUNT)
        for b in range(a + 1, PAIR_COUNT)
        if is_wanted(a, b)
    )
    axes[second] = _rotate_towards(axes[first], axes[second], angle)
    return make_mechanism(EIGHT_BARS[number], axes)


def _rotate_towards(axis: Floats, target: Floats, angle: float) -> Floats:
    """Return an axis (3,) rotated by an angle (rad) towards another one."""
    perpendicular = target - (target @ axis) * axis
    length = np.linalg.norm(perpendicular)
    rotated = np.cos(angle) * axis + np.sin(angle) * perpendicular / length
    return np.asarray(rotated / np.linalg.norm(rotated))


@case(PARALLEL_FAMILY, PLANE_ANGLE, ANGLES)
def three_axes_in_a_plane(angles: Sequence[float]) -> Iterator[Row]:
    """A four-bar in an eight-bar with three axes nearly in a plane: one pair stands still.

    The fourth axis is elsewhere, so the planes of the lecture's construction are well
    apart, but one of the coefficients is nearly zero.
    """
    for angle in angles:
        mechanism = _eight_bar_with_flat_loop(angle, flat_count=3)
        yield from judge_reference_pose(mechanism, angle)


@case(PARALLEL_FAMILY, PLANE_ANGLE, ANGLES)
def two_lines_in_a_plane(angles: Sequence[float]) -> Iterator[Row]:
    """The same with all four axes nearly in a plane: both lines of a pole coincide."""
    for angle in angles:
        mechanism = _eight_bar_with_flat_loop(angle, flat_count=4)
        yield from judge_reference_pose(mechanism, angle)


def _eight_bar_with_flat_loop(angle: float, flat_count: int) -> Mechanism:
    """Return an eight-bar whose first four-bar has axes nearly in a plane.

    Parameters
    ----------
    angle
        Largest angle (rad) of an axis out of the plane.
    flat_count
        Number of axes near the plane.
    """
    rng = np.random.default_rng(5)
    axes = random_axes(rng, PAIR_COUNT)
    chain = make_mechanism(EIGHT_BARS[0], axes)
    loop = [chain.pair_number[name] for name in ("p1_2", "p2_3", "p3_4", "p1_4")]
    for pair in loop[:flat_count]:
        longitude = rng.uniform(0, 2 * np.pi)
        latitude = rng.uniform(0.5, 1.0) * angle
        axes[pair] = [
            np.cos(longitude) * np.cos(latitude),
            np.sin(longitude) * np.cos(latitude),
            np.sin(latitude),
        ]
    return make_mechanism(EIGHT_BARS[0], axes / np.linalg.norm(axes, axis=1, keepdims=True))
