"""Pole axes at the edge of the reference hemisphere, where gnomonic charts end."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.extremes.parallel import judge_reference_pose
from benchmarks.extremes.registry import Row, case, down
from benchmarks.samples import make_mechanism, random_axes
from spherekit.arrays import Floats
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

CHARTS_FAMILY = "charts of the sphere"
HEIGHT = "height over the edge, rad"
HEIGHTS = (*down(1e-1, 1e-15), 0.0)

CHART_AXES = (
    np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 2.0]])
    / np.sqrt([3.0, 2.0, 6.0])[:, None]
)
"""The axes of the gnomonic chart in ground axes, row by row.

The first one points to the middle of the hemisphere.
"""

SIX_BAR = "1-2 1-4 1-6 2-3 3-4 3-5 5-6"
"""The chain of the Stephenson mechanism."""

FIRST_POLE = (0, 2)
"""Links of a pole that is found by intersecting great circles."""

INPUT_POLE = (0, 1)
"""Links of the pole that is the axis of the input."""


def rotate_pole_to_edge(axes: Floats, pole: Floats, height: float) -> Floats:
    """Return axes rotated together with a pole to the edge of the chart.

    Parameters
    ----------
    axes
        (n, 3) unit vectors.
    pole
        (3,) direction of the pole.
    height
        Height (rad) over the edge that the pole gets.

    Returns
    -------
    (n, 3) unit vectors.
    """
    goal = np.array([np.sin(height), *(np.cos(height) * np.array([0.6, 0.8]))])
    # A half turn about the vector in the middle takes the pole to its goal.
    middle = pole + goal @ CHART_AXES
    middle /= np.linalg.norm(middle)
    rotated = 2 * np.outer(axes @ middle, middle) - axes
    return np.asarray(rotated / np.linalg.norm(rotated, axis=1, keepdims=True))


def six_bar_with_pole(pole: tuple[int, int], height: float) -> Mechanism:
    """Return a six-bar with a pole at this height (rad) over the edge in its pose."""
    axes = random_axes(np.random.default_rng(11), 7)
    mechanism = make_mechanism(SIX_BAR, axes)
    motion = PositionAnalysis(mechanism, search=False).at(np.zeros(1))
    pole_request = request(mechanism, mechanism.inputs[0].pair, [pole], [pole])
    direction = evaluate(motion, pole_request).direction[pole][0]
    return make_mechanism(SIX_BAR, rotate_pole_to_edge(axes, direction, height))


@case(CHARTS_FAMILY, HEIGHT, HEIGHTS)
def secondary_pole_at_the_edge(heights: Sequence[float]) -> Iterator[Row]:
    """A six-bar whose pole of links 1 and 3, the first that is found, is at the edge."""
    for height in heights:
        yield from judge_reference_pose(six_bar_with_pole(FIRST_POLE, height), height)


@case(CHARTS_FAMILY, HEIGHT, HEIGHTS)
def primary_pole_at_the_edge(heights: Sequence[float]) -> Iterator[Row]:
    """A six-bar with the axis of its input at the edge."""
    for height in heights:
        yield from judge_reference_pose(six_bar_with_pole(INPUT_POLE, height), height)


@case(CHARTS_FAMILY, HEIGHT, HEIGHTS, held=False)
def first_two_great_circles(heights: Sequence[float]) -> Iterator[Row]:
    """The first of these without a choice of great circles and without equations."""
    for height in heights:
        yield from judge_reference_pose(
            six_bar_with_pole(FIRST_POLE, height), height, route="first"
        )


@case(CHARTS_FAMILY, "samples a turn", (36.0, 90.0, 361.0, 1801.0))
def poles_across_the_edge(counts: Sequence[float]) -> Iterator[Row]:
    """Over a turn of the shipped four-bar poles cross the edge; none may change its sign.

    The error is the number of samples at which a direction is opposite to the one before,
    less those where the rate times the direction is continuous through zero.
    """
    poles = [(0, 2), (1, 3)]
    for count in counts:
        motion = PositionAnalysis(load("four_bar"), samples=int(count)).motion()
        field = evaluate(motion, request(motion.mechanism, "21", poles, poles))
        mode_count = len(motion.assembly_modes)
        reversals = 0
        edge_crossings = 0
        for directions in field.direction.values():
            # (modes, samples, 3) directions of each mode along its samples.
            by_mode = directions.reshape(mode_count, motion.samples, 3)
            for path in by_mode:
                cosines = np.sum(path[1:] * path[:-1], axis=1)
                reversals += int(np.sum(cosines < 0.0))
                edge_crossings += int(np.sum(path[1:, 2] * path[:-1, 2] < 0.0))
        assert edge_crossings > 0
        yield Row(count, "signs", 1.0, float(reversals))
