"""The timelines of a recording: the sample number, and the input or the time."""

import re

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs

SAMPLE = "sample"


INPUT = "input_deg"


TIME = "time"
"""A timeline of seconds, in place of the input where samples are times."""


SCALES = (1, 10, 100, 1000)
"""A viewer timeline holds whole numbers only; these are the units to a degree."""


def input_timeline(inputs: Floats) -> tuple[str, int, bool]:
    """Return the coarsest timeline on which all input angles (n,) rad are whole.

    That is its name, such as ``input_deg`` or ``input_deg_x10``, its units to a degree, and
    whether these are exact: even thousandths of a degree may round some of the samples.
    """
    ticks = np.multiply.outer(SCALES, np.degrees(inputs))
    fits = max_abs(ticks - np.rint(ticks), axis=1) <= 1e-6
    exact = bool(np.any(fits))
    scale = SCALES[np.argmax(fits) if exact else -1]
    return INPUT if scale == 1 else f"{INPUT}_x{scale}", scale, exact


def input_scale(name: str) -> int | None:
    """Return the scale of a timeline made here, or None for another timeline."""
    scale = re.fullmatch(rf"{INPUT}(?:_x(\d+))?", name)
    return int(scale[1] or 1) if scale else None
