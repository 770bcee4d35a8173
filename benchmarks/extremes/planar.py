"""Mechanisms so small that they are nearly planar."""

from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.extremes.kinematics import judged
from benchmarks.extremes.parallel import EIGHT_BAR_NUMBERS, judge_reference_pose
from benchmarks.extremes.registry import Row, case, down
from benchmarks.extremes.shapes import four_bar, point_of
from benchmarks.samples import EIGHT_BARS, make_mechanism

PLANAR_FAMILY = "near-planar"
SIZE = "size, rad"
SIZES = down(1e-1, 1e-8)


@case(PLANAR_FAMILY, SIZE, SIZES)
def small_four_bar(sizes: Sequence[float]) -> Iterator[Row]:
    """A four-bar given by arcs of this size, at an input far from its reference."""
    for size in sizes:
        arcs = [size * arc for arc in (1.0, 0.4, 1.1, 0.8)]
        reference, point = point_of(four_bar(arcs), size, 2.0)
        yield from judged(reference, [point])


@case(PLANAR_FAMILY, SIZE, SIZES)
def small_eight_bars(sizes: Sequence[float]) -> Iterator[Row]:
    """Three eight-bars, one of them the double butterfly, with all axes in a small cap."""
    for number in EIGHT_BAR_NUMBERS:
        for size in sizes:
            rng = np.random.default_rng(number)
            axes = np.column_stack([size * rng.uniform(-1, 1, (10, 2)), np.ones(10)])
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
            yield from judge_reference_pose(make_mechanism(EIGHT_BARS[number], axes), size)
