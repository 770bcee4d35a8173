"""The timelines: the sample number, and the input in whole units of an angle, or time."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.scene import Floats

SAMPLE = "sample"
INPUT = "input_deg"
TIME = "time"
"""A timeline of seconds, in place of the input where samples are times."""
SCALES = (1, 10, 100, 1000)
"""A viewer timeline holds whole numbers only; these are the units to a degree."""


@final
@dataclass(frozen=True)
class InputTimeline:
    """The input angle counted in 1/`scale` degrees."""

    scale: int
    exact: bool
    """False if even thousandths of a degree round some of the samples."""
    first: int
    last: int

    @property
    def name(self) -> str:
        """Name of the timeline, such as ``input_deg`` or ``input_deg_x10``."""
        return INPUT if self.scale == 1 else f"{INPUT}_x{self.scale}"

    def ticks(self, inputs: Floats) -> NDArray[np.int64]:
        """Return input angles (n,) rad as whole units of this timeline."""
        ticks: NDArray[np.int64] = np.rint(np.degrees(inputs) * self.scale)
        return ticks.astype(np.int64)

    def describe(self) -> str:
        """Return one sentence for the notes of a recording."""
        unit = "degrees" if self.scale == 1 else f"1/{self.scale} degrees"
        rounded = "" if self.exact else ", rounded"
        return f"`{self.name}` is the input in {unit}{rounded}."


def input_timeline(inputs: Floats) -> InputTimeline:
    """Return the coarsest timeline on which all input angles (n,) rad are whole."""
    degrees = np.degrees(inputs)

    def whole(scale: int) -> bool:
        ticks = degrees * scale
        return bool(np.all(np.abs(ticks - np.rint(ticks)) <= 1e-6))

    scale = next((scale for scale in SCALES if whole(scale)), SCALES[-1])
    ticks = np.rint(degrees * scale).astype(np.int64)
    return InputTimeline(scale, whole(scale), int(ticks.min()), int(ticks.max()))


def input_scale(name: str) -> int | None:
    """Return the scale of a timeline made here, or None for another timeline."""
    if name == INPUT:
        return 1
    scale = name.removeprefix(f"{INPUT}_x")
    return int(scale) if scale != name and scale.isdigit() else None
