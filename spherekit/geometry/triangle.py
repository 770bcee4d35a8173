"""Great-circle arcs, frames along them, and the spherical triangle that closes a dyad.

A dyad is a chain of two bodies and three R pairs. Its outer axes are known, and its bodies
are the sides of a spherical triangle whose base is the arc between the outer axes.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.rotation import transpose
from spherekit.geometry.vectors import cross, unit_rows
from spherekit.tolerances import REACH_SLACK

MIN_SIDE_SINE = 1e-12
"""Sine of the arc of a body below which its direction counts as rounding error.

Larger: more dyads count as singular. Smaller: the angle at the middle axis can be an angle
between two rounding errors.
"""


def frame_from(axis: Floats, tangent: Floats) -> Floats:
    """Return frames (..., 3, 3) with the columns tangent, axis x tangent and axis.

    Parameters
    ----------
    axis, tangent
        (..., 3) unit vectors that are perpendicular to each other.
    """
    return np.stack([tangent, cross(axis, tangent), axis], axis=-1)


def frame_toward(axis: Floats, target: Floats) -> Floats:
    """Return frames (..., 3, 3) with z along an axis and x towards another axis.

    Parameters
    ----------
    axis
        (..., 3) unit vectors, the third columns of the frames.
    target
        (..., 3) unit vectors. The first column is perpendicular to the axis and points
        along the arc to the target. The frame is NaN if both lie on one line.
    """
    return frame_from(axis, cross(unit_rows(_cross_of_units(axis, target)), axis))


def _cross_of_units(a: Floats, b: Floats) -> Floats:
    """Return the cross products of unit vectors (..., 3).

    The rounding error is small compared with the product even if the vectors nearly
    coincide or are nearly opposite. The product is then perpendicular to both.
    """
    return 0.5 * cross(a + b, b - a)


def perpendicular(axis: Floats) -> Floats:
    """Return a unit vector perpendicular to each unit vector (..., 3).

    The cross product with the coordinate axis most nearly at right angles to the vector is
    long, so no digits are lost.
    """
    return unit_rows(cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=-1)]))


def arc(a: Floats, b: Floats) -> Floats:
    """Return the angles (...), rad, from 0 to pi, between unit vectors (..., 3).

    Unlike with the arc cosine, the error stays about 1e-16 rad near 0 and pi.
    """
    return np.arctan2(np.linalg.norm(cross(a, b), axis=-1), np.sum(a * b, axis=-1))


@dataclass(frozen=True)
class TriangleAngles:
    """Angles at both ends of one side, the base, of n spherical triangles.

    Attributes
    ----------
    at_first
        (n,) angle (rad, 0 to pi) at the first end of the base. The angle has no meaning if
        the triangle does not close.
    at_second
        (n,) angle (rad, 0 to pi) at the second end of the base. The angle has no meaning if
        the triangle does not close.
    closes
        (n,) whether a triangle with these sides exists: the sides satisfy the triangle
        inequalities, and their sum is at most a full turn. These conditions may be violated
        by up to twice the angle `slack` of the function `vertex_angles`.
    """

    at_first: Floats
    at_second: Floats
    closes: Bools


def vertex_angles(
    base: Floats,
    first_side: Floats,
    second_side: Floats,
    slack: Floats | float = REACH_SLACK,
) -> TriangleAngles:
    """Return the angles at both ends of the base of spherical triangles.

    Parameters
    ----------
    base, first_side, second_side
        (n,) sides of n triangles (rad, 0 to pi): the base, the side at its first end and
        the side at its second end.
    slack
        Accepted error (rad), (n,) or the same for all. A side may exceed the sum of the
        other two sides by up to twice this angle, and the perimeter may exceed a full turn
        by as much.
    """
    # The triangle inequalities: none of these differences is negative. Each difference is
    # half of what may be violated by twice the slack.
    half_perimeter = 0.5 * (base + first_side + second_side)
    less_base = half_perimeter - base
    less_first = half_perimeter - first_side
    less_second = half_perimeter - second_side
    supplement = np.pi - half_perimeter
    differences = np.stack([less_base, less_first, less_second, supplement])
    closes = np.all(differences >= -slack, axis=0)

    # Sines of half the perimeter minus each side. Negative differences within the slack
    # count as zero. The sine of the supplement equals the sine of half the perimeter.
    sines = np.sin(np.clip(differences, 0.0, np.pi))
    sine_less_base, sine_less_first, sine_less_second, sine_half_perimeter = sines
    # The angle at the first end is between the first side and the base, and opposite to the
    # second side.
    at_first = _half_angle_formula(
        sine_less_first, sine_less_base, sine_less_second, sine_half_perimeter
    )
    at_second = _half_angle_formula(
        sine_less_second, sine_less_base, sine_less_first, sine_half_perimeter
    )
    return TriangleAngles(at_first, at_second, closes)


def _half_angle_formula(
    sine_less_side: Floats,
    sine_less_base: Floats,
    sine_less_opposite: Floats,
    sine_half_perimeter: Floats,
) -> Floats:
    """Return the angle between a side and the base of spherical triangles, 0 to pi.

    The half-angle formula tan^2(A / 2) = sin(s - b) sin(s - c) / (sin s sin(s - a)), with
    half the perimeter s, has no cancellation for small sides. The angle A is between the
    sides b and c, and opposite to the side a. Here the side c is the base.

    Parameters
    ----------
    sine_less_side, sine_less_base
        (n,) sin(s - b) and sin(s - c) for the sides at the angle.
    sine_less_opposite
        (n,) sin(s - a) for the opposite side.
    sine_half_perimeter
        (n,) sin(s).

    Returns
    -------
    (n,) angles (rad).
    """
    numerator = np.sqrt(sine_less_side * sine_less_base)
    denominator = np.sqrt(sine_half_perimeter * sine_less_opposite)
    return 2 * np.arctan2(numerator, denominator)


@dataclass(frozen=True)
class DyadClosure:
    """Orientations of the two bodies of n dyads, and measures of their quality.

    A dyad is a chain of two bodies and three R pairs (hinges). The arc of each body leads
    from its outer axis, which is known, to the common middle axis. Both arcs are sides of a
    spherical triangle. Its third side is the arc between the outer axes.

    Attributes
    ----------
    first_rotation, second_rotation
        (n, 3, 3) rotations from the axes of each body to the axes in which the outer axes
        are known. If the outer axes lie on one line, one of infinitely many orientations is
        returned. If a dyad does not close, its bodies have different middle axes.
    sine
        (n,) sine of the angle between the arcs of the two bodies at the middle axis. The
        sine is 0 at a dead centre of the dyad, and if an arc is too short to have a
        direction.
    side_ratio
        (n,) smallest over largest sine of the three sides of the triangle. A small ratio
        means that the direction of the shortest side has a large relative rounding error.
    closes
        (n,) whether the arcs reach each other at the middle axis.
    """

    first_rotation: Floats
    second_rotation: Floats
    sine: Floats
    side_ratio: Floats
    closes: Bools


def close_dyad(
    first: Floats,
    second: Floats,
    first_body: tuple[Floats, Floats],
    second_body: tuple[Floats, Floats],
    sign: Floats | float,
    slack: Floats | float = REACH_SLACK,
) -> DyadClosure:
    """Compute the orientations of the two bodies of a dyad between two known axes.

    A dyad is a chain of two bodies and three R pairs. Its bodies are sides of a spherical
    triangle; the third side, the base, is the arc between the axes of the outer pairs.

    Parameters
    ----------
    first, second
        (n, 3) unit axes of the outer pairs, both in the same coordinates. The orientations
        of the bodies are relative to these coordinates.
    first_body, second_body
        Outer axis and middle axis (n, 3) of the body at `first` and of the body at
        `second`, each in the coordinates of its body.
    sign
        +1 or -1, or (n,) of these: the sign of middle . (first x second), which determines
        the assembly mode.
    slack
        Accepted error (rad) of each outer axis, (n,) or one number for all. A triangle that
        fails to close by at most twice this angle counts as closed.
    """
    outer_product = _cross_of_units(first, second)
    base_sine = np.linalg.norm(outer_product, axis=-1, keepdims=True)
    normal = outer_product / np.where(base_sine > 0.0, base_sine, 1.0)
    base_sine = base_sine[:, 0]
    base = np.arctan2(base_sine, np.sum(first * second, axis=-1))
    first_side = arc(*first_body)
    second_side = arc(*second_body)
    angles = vertex_angles(base, first_side, second_side, slack)

    # Outer axes along one line have no normal. The dyad can then rotate about this line,
    # and any plane is chosen.
    is_free = base_sine <= REACH_SLACK
    if np.any(is_free):
        normal[is_free] = perpendicular(first[is_free])
        angles.at_first[is_free] = 0.5 * np.pi
        angles.at_second[is_free] = 0.5 * np.pi

    def orient_body(
        axis: Floats, base_tangent: Floats, angle: Floats, body: tuple[Floats, Floats]
    ) -> Floats:
        """Return the rotation (n, 3, 3) of a body of the dyad.

        It transforms vectors from the coordinates of the body to those of `first` and
        `second`. A dyad is a chain of two bodies and three R pairs. The axes of the pairs
        are the corners of a spherical triangle. One side is the arc of the body from its
        outer axis to the middle axis. The base is the side between both outer axes.

        The outer function provides `normal` and `sign`. `normal` is the unit normal of the
        plane of the base. `sign`, +1 or -1, says on which side of this plane the middle
        axis is.

        Parameters
        ----------
        axis
            (n, 3) outer axis of the body: `first` or `second`.
        base_tangent
            (n, 3) unit tangent of the base at this axis, towards the other outer axis.
        angle
            (n,) angle (rad, 0 to pi) of the triangle at this axis.
        body
            Outer and middle axis (n, 3) of the body, in the coordinates of the body.
        """
        # The tangent of the body's arc at its outer axis: that of the base, turned by the
        # angle towards the side of the middle axis.
        normal_part = (sign * np.sin(angle))[:, None]
        tangent = np.cos(angle)[:, None] * base_tangent + normal_part * normal
        return frame_from(axis, tangent) @ transpose(_body_frame(*body))

    first_rotation = orient_body(first, cross(normal, first), angles.at_first, first_body)
    second_rotation = orient_body(
        second, -cross(normal, second), angles.at_second, second_body
    )

    # Quality measures; see `DyadClosure`.
    side_sines = np.sin([first_side, second_side])
    # The triple product of the three axes: the sine of the base times the sine of the
    # height of the triangle above it.
    height = np.sin(base) * np.sin(angles.at_first) * side_sines[0]
    has_direction = ~is_free & np.all(side_sines >= MIN_SIDE_SINE, axis=0)
    sine = np.where(
        has_direction,
        height / np.where(has_direction, side_sines[0] * side_sines[1], 1.0),
        0.0,
    )
    all_sines = np.array([base_sine, *np.broadcast_arrays(*np.abs(side_sines))])
    largest = np.max(all_sines, axis=0)
    side_ratio = np.min(all_sines, axis=0) / np.where(largest > 0.0, largest, 1.0)
    return DyadClosure(first_rotation, second_rotation, sine, side_ratio, angles.closes)


def _body_frame(outer: Floats, middle: Floats) -> Floats:
    """Return frames (n, 3, 3) with z along the outer axis and x to the middle axis.

    The body is a link of a dyad (two links with a middle joint and two outer joints). If
    both axes lie on one line, the x axis is any direction at right angles to them.
    """
    with np.errstate(invalid="ignore"):
        frames = frame_toward(outer, middle)
    is_undefined = np.isnan(frames[:, 0, 0])
    frames[is_undefined] = frame_from(
        outer[is_undefined], perpendicular(outer[is_undefined])
    )
    return frames
