"""Pole axes at the edge of the reference hemisphere, where gnomonic charts end."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.extremes.parallel import at_pose
from benchmarks.extremes.registry import Row, case, down
from benchmarks.samples import make_mechanism, random_axes
from spherekit.files.mechanism_reader import load
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

FAMILY = "charts of the sphere"
HEIGHT = "height over the edge, rad"
HEIGHTS = (*down(1e-1, 1e-15), 0.0)
REFERENCE = (
    np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 2.0]])
    / np.sqrt([3.0, 2.0, 6.0])[:, None]
)
"""The axes of the chart in ground axes, row by row."""
SIX_BAR = "1-2 1-4 1-6 2-3 3-4 3-5 5-6"
"""The graph of the Stephenson mechanism."""


def turned(axes: np.ndarray, pole: np.ndarray, height: float) -> np.ndarray:
    """Return axes (n, 3) turned so that a pole has this height over the chart's edge."""
    goal = np.array([np.sin(height), *(np.cos(height) * np.array([0.6, 0.8]))])
    half = pole + goal @ REFERENCE
    half /= np.linalg.norm(half)
    out = 2 * np.outer(axes @ half, half) - axes
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def with_pole_at(pole: tuple[int, int], height: float) -> Mechanism:
    """Return a six-bar with one of its poles this height over the edge in its pose."""
    axes = random_axes(np.random.default_rng(11), 7)
    made = make_mechanism(SIX_BAR, axes)
    motion = PositionAnalysis(made, search=False).at(np.zeros(1))
    found = evaluate(motion, request(made, made.inputs[0].pair, [pole], [pole]))
    return make_mechanism(SIX_BAR, turned(axes, found.direction[pole][0], height))


@case(FAMILY, HEIGHT, HEIGHTS)
def secondary_pole_at_the_edge(heights: Sequence[float]) -> Iterator[Row]:
    """A six-bar whose pole of links 1 and 3, the first that is found, is at the edge."""
    for height in heights:
        yield from at_pose(with_pole_at((0, 2), height), height)


@case(FAMILY, HEIGHT, HEIGHTS)
def primary_pole_at_the_edge(heights: Sequence[float]) -> Iterator[Row]:
    """A six-bar with the axis of its input at the edge."""
    for height in heights:
        yield from at_pose(with_pole_at((0, 1), height), height)


@case(FAMILY, HEIGHT, HEIGHTS, held=False)
def first_two_great_circles(heights: Sequence[float]) -> Iterator[Row]:
    """The first of these without a choice of great circles and without equations."""
    for height in heights:
        yield from at_pose(with_pole_at((0, 2), height), height, route="first")


@case(FAMILY, "samples a turn", (36.0, 90.0, 361.0, 1801.0))
def poles_across_the_edge(counts: Sequence[float]) -> Iterator[Row]:
    """Over a turn of the shipped four-bar poles cross the edge; none may change its sign.

    The error is the number of samples at which a direction is opposite to the one before,
    less those where the rate times the direction is continuous through zero.
    """
    for count in counts:
        motion = PositionAnalysis(load("four_bar"), samples=int(count)).motion()
        made = motion.mechanism
        field = evaluate(motion, request(made, "21", [(0, 2), (1, 3)], [(0, 2), (1, 3)]))
        jumps, edges = 0, 0
        for directions in field.direction.values():
            for assembly_mode in directions.reshape(
                len(motion.assembly_modes), motion.samples, 3
            ):
                beside = np.sum(assembly_mode[1:] * assembly_mode[:-1], axis=1)
                jumps += int(np.sum(beside < 0.0))
                edges += int(np.sum(assembly_mode[1:, 2] * assembly_mode[:-1, 2] < 0.0))
        assert edges > 0
        yield Row(count, "signs", 1.0, float(jumps))
