"""Inputs many revolutions away from zero."""

from collections.abc import Iterator, Sequence

import mpmath as mp

from benchmarks.extremes.kinematics import Point, judged
from benchmarks.extremes.reference import DIGITS
from benchmarks.extremes.registry import Row, case
from benchmarks.extremes.shapes import point_of
from spherekit.files.mechanism_reader import load

TURNS_FAMILY = "many turns"
TURNS = "whole turns"
TURN_COUNTS = (0.0, 1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6)

INPUT_RAD = 0.7
"""The input (rad) beyond the whole revolutions."""


def judge_turns(name: str, counts: Sequence[float]) -> Iterator[Row]:
    """Yield the rows of a shipped mechanism at inputs 2 pi k + 0.7, rounded to doubles.

    The exact configuration is that of the rounded input.
    """
    reference, start = point_of(load(name), 0.0, INPUT_RAD)
    points = []
    for count in counts:
        with mp.workdps(DIGITS):
            q = float(2 * mp.pi * mp.mpf(count) + mp.mpf(INPUT_RAD))
            points.append(Point(count, [q], start.near))
    for point in points:
        yield from judged(reference, [point])


@case(TURNS_FAMILY, TURNS, TURN_COUNTS)
def turns_of_the_four_bar(counts: Sequence[float]) -> Iterator[Row]:
    """The shipped four-bar, dyads only."""
    yield from judge_turns("four_bar", counts)


@case(TURNS_FAMILY, TURNS, TURN_COUNTS)
def turns_of_the_stephenson(counts: Sequence[float]) -> Iterator[Row]:
    """The shipped Stephenson, two dyads."""
    yield from judge_turns("stephenson", counts)


@case(TURNS_FAMILY, TURNS, TURN_COUNTS)
def turns_of_the_double_butterfly(counts: Sequence[float]) -> Iterator[Row]:
    """The shipped double butterfly, one group of seven bodies that is followed."""
    yield from judge_turns("double_butterfly", counts)


@case(TURNS_FAMILY, TURNS, TURN_COUNTS)
def turns_of_a_cam(counts: Sequence[float]) -> Iterator[Row]:
    """The shipped cam with a roller."""
    yield from judge_turns("roller_cam", counts)
