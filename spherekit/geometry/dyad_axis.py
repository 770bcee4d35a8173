"""The closed form of a dyad: the axis at two given arcs from two others.

The middle axis b of a dyad between the axes a and c at arcs A and C is

    b = (cos A + cos C) (a + c) / |a + c|^2 + (cos A - cos C) (a - c) / |a - c|^2
        + t (a x c) / |a x c|^2,
    t^2 = (cos(A - C) - a . c) (a . c - cos(A + C)),

three terms at right angles to each other (derived here; it is the formula of two
intersecting cones, with both factors in half angles so that small arcs lose no digits).
The numbers are of any kind that has operators: floats, real or complex arrays, terms of
the engine. Rotations of bodies whose arcs are short follow from angles instead, see
`spherekit.geometry.rotation`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class HalfAngle:
    """An arc by the sine and the cosine of its half."""

    sine: Any
    cosine: Any

    @staticmethod
    def of(arc: float) -> "HalfAngle":
        """Return an arc given in rad."""
        return HalfAngle(float(np.sin(0.5 * arc)), float(np.cos(0.5 * arc)))

    def __add__(self, other: "HalfAngle") -> "HalfAngle":
        return HalfAngle(
            self.sine * other.cosine + self.cosine * other.sine,
            self.cosine * other.cosine - self.sine * other.sine,
        )

    def __sub__(self, other: "HalfAngle") -> "HalfAngle":
        return self + HalfAngle(-1.0 * other.sine, other.cosine)


def triple_square(near: HalfAngle, far: HalfAngle, more: Any, less: Any) -> Any:
    """Return t^2 from |a + c|^2 and |a - c|^2: negative where the arcs do not reach."""
    return _over(near - far, more, less) * (-1.0 * _over(near + far, more, less))


def middle_axis(
    near: HalfAngle, far: HalfAngle, more: Any, less: Any, root: Any
) -> tuple[Any, Any, Any]:
    """Return how much of a + c, of a - c and of a x c the middle axis is.

    From |a + c|^2, |a - c|^2 and the root t of `triple_square`, of either sign.
    """
    total = near + far
    rest = near - far
    return (
        2.0 * (total.cosine * rest.cosine) / more,
        -2.0 * (total.sine * rest.sine) / less,
        4.0 * root / (more * less),
    )


def _over(arc: HalfAngle, more: Any, less: Any) -> Any:
    """Return the cosine of an arc less a . c.

    It is |a - c|^2 / 2 - 2 sin^2 of half the arc, and 2 cos^2 of it - |a + c|^2 / 2. The
    first keeps its digits where a and c nearly coincide, the second where they are nearly
    opposite. Of an arc that varies both are taken, each with the other's square as weight;
    the squares add up to 4.
    """
    first = 0.5 * less - 2.0 * (arc.sine * arc.sine)
    second = 2.0 * (arc.cosine * arc.cosine) - 0.5 * more
    if isinstance(arc.sine, float):
        return first if abs(arc.sine) < abs(arc.cosine) else second
    return 0.25 * (first * more + second * less)
