"""The middle axis of a dyad, in closed form from its two outer axes.

The middle axis b is at the arc A from the outer axis a and at the arc C from the outer axis
c. The axis b is a sum of three vectors that are perpendicular to each other:

    b = (cos A + cos C) (a + c) / |a + c|^2 + (cos A - cos C) (a - c) / |a - c|^2
        + t (a x c) / |a x c|^2,
    t^2 = (cos(A - C) - a . c) (a . c - cos(A + C)).

The two signs of the triple product t are the two assembly modes of the dyad. The formula is
the one for the intersection of two cones. All factors are written in half angles, so small
arcs lose no digits.

The numbers may be of any type with operators: floats, real or complex arrays, symbolic
expressions. The orientations of bodies with short arcs follow from the angles of a
spherical triangle instead, see `spherekit.geometry.triangle`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class HalfAngle:
    """An arc on the unit sphere by the sine and cosine of half the arc.

    Half angles lose no digits for short arcs. `+` and `-` add and subtract arcs.

    Attributes
    ----------
    sine, cosine
        Sine and cosine of half the arc: floats, arrays or symbolic expressions.
    """

    sine: Any
    cosine: Any

    @staticmethod
    def from_arc(arc: float) -> "HalfAngle":
        """Return the `HalfAngle` of an arc that is given in rad."""
        return HalfAngle(float(np.sin(0.5 * arc)), float(np.cos(0.5 * arc)))

    def __add__(self, other: "HalfAngle") -> "HalfAngle":
        return HalfAngle(
            self.sine * other.cosine + self.cosine * other.sine,
            self.cosine * other.cosine - self.sine * other.sine,
        )

    def __sub__(self, other: "HalfAngle") -> "HalfAngle":
        return self + HalfAngle(-1.0 * other.sine, other.cosine)


def triple_square(
    first_arc: HalfAngle, second_arc: HalfAngle, sum_square: Any, difference_square: Any
) -> Any:
    """Return t^2, the square of the triple product b . (a x c) of the axes of a dyad.

    A dyad is a chain of two bodies between two outer axes a and c, and b is the axis of the
    pair (joint) between its bodies. The sign of t tells in which of two ways the dyad is
    assembled. The arcs of the bodies are A and C, and cos B is a . c. The square of a
    triple product is the Gram determinant of the three vectors,

        t^2 = 1 + 2 cos A cos B cos C - cos^2 A - cos^2 B - cos^2 C
            = (cos(A - C) - cos B) (cos B - cos(A + C)).

    t^2 is negative if the dyad cannot be assembled. The result is the product of the two
    factors in brackets. `_cosine_minus_dot` computes each factor without loss of digits,
    from |a - c|^2 and |a + c|^2.

    Parameters
    ----------
    first_arc, second_arc
        Arcs A and C from the outer axes a and c to the middle axis.
    sum_square, difference_square
        |a + c|^2 and |a - c|^2: numbers, arrays or symbolic expressions.
    """
    # cos(A - C) - a . c, and then a . c - cos(A + C).
    first_factor = _cosine_minus_dot(first_arc - second_arc, sum_square, difference_square)
    second_factor = -1.0 * _cosine_minus_dot(
        first_arc + second_arc, sum_square, difference_square
    )
    return first_factor * second_factor


def middle_axis(
    first_arc: HalfAngle,
    second_arc: HalfAngle,
    sum_square: Any,
    difference_square: Any,
    root: Any,
) -> tuple[Any, Any, Any]:
    """Return the factors of three vectors whose sum is the middle axis b of a dyad.

    A dyad is a chain of two bodies between the outer axes a and c, both unit vectors. The
    axis b of the pair (joint) between its bodies is a sum of a + c, a - c and a x c, times
    the factors. There are two possible axes b, mirror images of each other in the plane of
    a and c. The two axes differ in the sign of the triple product t = b . (a x c).

    Parameters
    ----------
    first_arc, second_arc
        Arcs A and C from the outer axes a and c to the middle axis.
    sum_square, difference_square
        |a + c|^2 and |a - c|^2.
    root
        The triple product t, a square root of the result of `triple_square`. Its sign
        chooses the assembly mode, one of the two ways to assemble the dyad.

    Returns
    -------
    The factors (cos A + cos C) / |a + c|^2, (cos A - cos C) / |a - c|^2 and t / |a x c|^2.
    """
    # `total` and `difference` have the sines and cosines of (A + C) / 2 and (A - C) / 2.
    total = first_arc + second_arc
    difference = first_arc - second_arc
    # cos A + cos C = 2 cos((A + C) / 2) cos((A - C) / 2), and similar for the difference.
    # |a x c|^2 = |a + c|^2 |a - c|^2 / 4.
    return (
        2.0 * (total.cosine * difference.cosine) / sum_square,
        -2.0 * (total.sine * difference.sine) / difference_square,
        4.0 * root / (sum_square * difference_square),
    )


def _cosine_minus_dot(arc: HalfAngle, sum_square: Any, difference_square: Any) -> Any:
    """Return cos(arc) - a . c without cancellation, for unit vectors a and c.

    Parameters
    ----------
    arc
        The arc. Its fields `sine` and `cosine` are those of half the arc, sin(arc / 2) and
        cos(arc / 2), as numbers or symbolic expressions.
    sum_square, difference_square
        |a + c|^2 and |a - c|^2.

    Notes
    -----
    Two formulas give the result:

    1. |a - c|^2 / 2 - 2 sin^2(arc / 2), which is accurate if a and c nearly coincide,
    2. 2 cos^2(arc / 2) - |a + c|^2 / 2, which is accurate if a and c are nearly opposite.

    Digits matter where the result is near 0. There the angle between a and c is nearly the
    arc, so the first formula is used for arcs below 90 degrees and the second for others.
    This choice is possible if the arc is a single number. For arrays and symbolic
    expressions, a weighted mean of both formulas is used. The weights |a + c|^2 and
    |a - c|^2 make the accurate formula dominate. They add up to 4.
    """
    first = 0.5 * difference_square - 2.0 * (arc.sine * arc.sine)
    second = 2.0 * (arc.cosine * arc.cosine) - 0.5 * sum_square
    if isinstance(arc.sine, float):
        if abs(arc.sine) < abs(arc.cosine):
            return first
        return second
    return 0.25 * (first * sum_square + second * difference_square)
