"""The timelines of a recording: the sample number, and the input or the time."""

import re
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats, Integers
from spherekit.geometry.vectors import max_abs

SAMPLE_TIMELINE = "sample"
"""The timeline of sample numbers."""

INPUT_TIMELINE = "input_deg"
"""The beginning of the name of the timeline of the input."""

TIME_TIMELINE = "time"
"""The timeline of seconds. It replaces the timeline of the input if samples are times."""

TICKS_PER_DEGREE = (1, 10, 100, 1000)
"""The possible resolutions of the timeline of the input, which holds whole numbers only."""

TICK_TOLERANCE = 1e-6
"""Largest distance from a whole number of ticks of an input that counts as exact."""


@dataclass(frozen=True)
class InputTimeline:
    """The timeline of the input of a recording, along which the viewer plays the motion.

    A timeline of the viewer has whole numbers only. Inputs (rad) are therefore counted in
    ticks, which are fixed parts of a degree.

    Attributes
    ----------
    name
        ``input_deg`` if a tick is one degree. Smaller ticks have the number of ticks per
        degree at the end, as in ``input_deg_x10``.
    ticks_per_degree
        Number of ticks in a degree: 1, 10, 100 or 1000.
    is_exact
        Whether all inputs are whole numbers of ticks. If not, ticks are thousandths of a
        degree and inputs are rounded to them.
    """

    name: str
    ticks_per_degree: int
    is_exact: bool


def input_timeline(inputs: Floats) -> InputTimeline:
    """Return the coarsest time axis on which all inputs (n,) rad are whole numbers.

    The viewer plays samples along an axis of whole numbers. The resolution is a degree or a
    decimal fraction of a degree. If even thousandths of a degree are too coarse, the result
    has thousandths, and inputs are rounded.
    """
    # Axes: resolution, input.
    ticks = np.multiply.outer(TICKS_PER_DEGREE, np.degrees(inputs))
    fits = max_abs(ticks - np.rint(ticks), axis=1) <= TICK_TOLERANCE
    is_exact = bool(np.any(fits))
    scale = TICKS_PER_DEGREE[np.argmax(fits) if is_exact else -1]
    name = INPUT_TIMELINE if scale == 1 else f"{INPUT_TIMELINE}_x{scale}"
    return InputTimeline(name, scale, is_exact)


def ticks_per_degree(name: str) -> int | None:
    """Return the resolution of a timeline of the input; None for another timeline."""
    match = re.fullmatch(rf"{INPUT_TIMELINE}(?:_x(\d+))?", name)
    return int(match[1] or 1) if match else None


def input_ticks(inputs: Floats, scale: int) -> Integers:
    """Return inputs (n,) rad as whole numbers of ticks, `scale` of them per degree."""
    return np.rint(np.degrees(inputs) * scale).astype(np.int64)
