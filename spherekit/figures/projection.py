"""The sphere on paper: Lambert's equal-area and the stereographic azimuthal projection.

Both keep the directions from the centre. At the angle t from it a point is 2 sin(t/2) off
in the former, which keeps areas, and 2 tan(t/2) in the latter, which keeps angles (J. P.
Snyder, Map Projections: A Working Manual, USGS 1395, 1987, chapters 21 and 24).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.arrays import Floats

AXES = ("x", "y", "z")
TINY = 1e-300


@final
@dataclass(frozen=True)
class Projection:
    """A map about a centre; `radius` gives the distance from it at an angle in rad."""

    name: str
    radius: Callable[[Floats], Floats]


EQUAL_AREA = Projection("equal-area (Lambert)", lambda angle: 2.0 * np.sin(angle / 2.0))
STEREOGRAPHIC = Projection("stereographic", lambda angle: 2.0 * np.tan(angle / 2.0))


@final
@dataclass(frozen=True)
class Centre:
    """A centre of maps on an axis of the ground, by right, up, out (3, 3)."""

    frame: Floats

    @property
    def name(self) -> str:
        """The axis of the ground on which it is, with its sign."""
        out = int(np.argmax(np.abs(self.frame[2])))
        return f"{'−' if self.frame[2, out] < 0.0 else '+'}{AXES[out]}"

    @property
    def opposite(self) -> "Centre":
        """The centre on the other side."""
        return Centre(self.frame[[1, 0, 2]] * [[1.0], [1.0], [-1.0]])

    @property
    def sides(self) -> tuple[str, str]:
        """Names of the axes of the ground that point right and up."""
        right, up = (AXES[int(np.argmax(np.abs(axis)))] for axis in self.frame[:2])
        return right, up

    def angles(self, directions: Floats) -> Floats:
        """Return the angles (n,) rad of directions (n, 3) from the centre."""
        across = directions @ self.frame[:2].T
        size = np.hypot(across[:, 0], across[:, 1])
        return np.arctan2(size, directions @ self.frame[2])

    def placed(self, directions: Floats, projection: Projection) -> Floats:
        """Return places (n, 2) of directions (n, 3), the sphere seen from outside."""
        across = directions @ self.frame[:2].T
        size = np.hypot(across[:, 0], across[:, 1])[:, None]
        radius = projection.radius(self.angles(directions))[:, None]
        return across * radius / np.maximum(size, TINY)


def centre_of(directions: Floats) -> Centre:
    """Return the axis of the ground that is nearest to the middle of directions (n, 3)."""
    mean = np.nanmean(directions, axis=0) if len(directions) else np.array([0.0, 0.0, 1.0])
    out = int(np.argmax(np.abs(mean)))
    centre = Centre(np.eye(3)[[(out + 1) % 3, (out + 2) % 3, out]])
    return centre if mean[out] >= 0.0 else centre.opposite
