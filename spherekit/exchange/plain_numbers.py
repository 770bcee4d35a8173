"""Numbers of imported models as a person would have written them."""

import math
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.model.changes import AngleUnit
from spherekit.sphere.rotation import Floats

ROUNDING = 4e-15
"""Numbers that differ by less, relative to what is beside them, are one."""

DEGREES = 1e-14
"""The same of angles in degrees, relative, or absolute where they are below one."""


def plain(number: float, scale: float, rounding: float = ROUNDING) -> float:
    """Return the shortest decimal within the rounding of numbers as large as `scale`."""
    number = float(number)
    allowed = rounding * max(abs(scale), abs(number))
    for digits in range(1, 18):
        short = float(f"{number:.{digits}g}")
        if abs(short - number) <= allowed:
            return 0.0 if abs(number) <= allowed else short
    return number


SHORT = 24
"""Characters of the components of an axis that are plain to read."""


@final
@dataclass(frozen=True)
class Units:
    """Angles in the unit of a file."""

    unit: AngleUnit

    def angle(self, angle: float) -> float:
        """Return an angle (rad) as it stands in a file."""
        return plain(math.degrees(angle) if self.unit == "deg" else angle, 1.0, DEGREES)

    def axis(self, axis: Floats) -> dict[str, Any]:
        """Return the key of an axis (3,) in files: xyz, or lonlat if that is plainer."""
        x, y, z = (float(part) for part in axis)
        xyz = [plain(part, 1.0) for part in (x, y, z)]
        around = 0.0 if np.hypot(x, y) < ROUNDING else math.atan2(y, x)
        lonlat = [self.angle(around), self.angle(math.atan2(z, math.hypot(x, y)))]
        if len(repr(xyz)) > SHORT and len(repr(lonlat)) < len(repr(xyz)):
            return {"lonlat": lonlat}
        return {"xyz": xyz}
