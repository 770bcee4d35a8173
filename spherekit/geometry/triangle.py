"""The spherical triangle: the closed form behind every dyad (RR chain of two links)."""

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.rotation import cross, transpose, unit_rows
from spherekit.tolerances import REACH_SLACK


def frame_from(axis: Floats, tangent: Floats) -> Floats:
    """Return frames (..., 3, 3) with columns tangent, axis x tangent, axis.

    `axis` and `tangent` are perpendicular unit vectors (..., 3).
    """
    return np.stack([tangent, cross(axis, tangent), axis], axis=-1)


def frame_toward(axis: Floats, other: Floats) -> Floats:
    """Return frames (..., 3, 3) with the third column `axis`, the first toward `other`.

    `axis` and `other` are unit vectors (..., 3); NaN where they lie on one line.
    """
    return frame_from(axis, cross(unit_rows(cross(axis, other)), axis))


def perpendicular(axis: Floats) -> Floats:
    """Return one unit vector at right angles to each unit vector `axis` (..., 3)."""
    return unit_rows(cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=-1)]))


def arc(a: Floats, b: Floats) -> Floats:
    """Return the angle (rad, 0 to pi) between unit vectors (..., 3), exact near 0, pi."""
    return np.arctan2(np.linalg.norm(cross(a, b), axis=-1), np.sum(a * b, axis=-1))


SHORTEST = 1e-12
"""Rounding alone turns a body whose arc (rad) is nearer to 0 or pi than this."""


def vertex_angles(
    base: Floats, near: Floats, far: Floats, slack: Floats | float = REACH_SLACK
) -> tuple[Floats, Floats, Bools]:
    """Return the angles at both ends of a triangle's base, and whether it closes.

    Parameters
    ----------
    base, near, far
        Sides (n,) in rad, 0 to pi: the base, the side at its first end, the side at
        its second end.
    slack
        (n,) rad, what the sides may be off by.

    Returns
    -------
    at_first, at_second
        Angles (n,) in rad, 0 to pi; meaningless where the triangle does not close.
    closes
        (n,) whether the sides satisfy the triangle inequalities and sum to at most a
        full turn, up to the slack.

    Notes
    -----
    Half-angle form, free of cancellation for small sides:
    tan^2(A/2) = sin(s - b) sin(s - c) / (sin s sin(s - a)), s half the perimeter.
    """
    half = 0.5 * (base + near + far)
    parts = np.stack([half - base, half - near, half - far, np.pi - half])
    closes = np.all(parts >= -slack, axis=0)
    by_base, by_near, by_far, total = np.sin(np.clip(parts, 0.0, np.pi))
    at_first = 2 * np.arctan2(np.sqrt(by_near * by_base), np.sqrt(total * by_far))
    at_second = 2 * np.arctan2(np.sqrt(by_far * by_base), np.sqrt(total * by_near))
    return at_first, at_second, closes


def _frame_toward(outer: Floats, middle: Floats) -> Floats:
    """Return frames with z along an axis and the other, if it lies aside, at positive x."""
    with np.errstate(invalid="ignore"):
        frames = frame_toward(outer, middle)
    lost = np.isnan(frames[:, 0, 0])
    frames[lost] = frame_from(outer[lost], perpendicular(outer[lost]))
    return frames


def close_dyad(
    first: Floats,
    second: Floats,
    near: tuple[Floats, Floats],
    far: tuple[Floats, Floats],
    sign: Floats | float,
    slack: Floats | float = REACH_SLACK,
) -> tuple[Floats, Floats, Floats, Floats, Bools]:
    """Place the two bodies of a dyad between two known axes.

    Parameters
    ----------
    first, second
        Unit axes (n, 3) of the outer pairs, in base axes.
    near, far
        In the axes of the bodies at `first` and `second`: the outer and the middle axis,
        (n, 3).
    sign
        +1 or -1, or (n,) of these: the sign of middle . (first x second), which names the
        assembly mode.
    slack
        (n,) rad, what the outer axes may be off by.

    Returns
    -------
    near_rotation, far_rotation
        (n, 3, 3) from body axes to base axes.
    sine
        (n,) sine of the angle between the two bodies' arcs at the middle axis, 0 at the
        dead centre of the dyad and where an arc is too short to tell.
    slenderness
        (n,) smallest over largest sine of the three sides of the triangle. Directions along
        the shortest side have so much fewer digits.
    closes
        (n,) whether the arcs can reach each other. Where they can and the dyad can turn
        about one line, one of infinitely many configurations is returned.
    """
    # first x second, to rounding of its own size where the axes nearly coincide
    across = 0.5 * cross(first + second, second - first)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    normal = across / np.where(length > 0.0, length, 1.0)
    base = np.arctan2(length[..., 0], np.sum(first * second, axis=-1))
    side_near, side_far = arc(*near), arc(*far)
    at_first, at_second, closes = vertex_angles(base, side_near, side_far, slack)
    free = length[:, 0] <= REACH_SLACK
    if np.any(free):
        normal[free] = perpendicular(first[free])
        at_first[free] = at_second[free] = 0.5 * np.pi

    def placed(
        axis: Floats, toward: Floats, angle: Floats, body: tuple[Floats, Floats]
    ) -> Floats:
        swing = (sign * np.sin(angle))[:, None]
        tangent = np.cos(angle)[:, None] * toward + swing * normal
        return frame_from(axis, tangent) @ transpose(_frame_toward(*body))

    near_rotation = placed(first, cross(normal, first), at_first, near)
    far_rotation = placed(second, -cross(normal, second), at_second, far)
    sides = np.sin([side_near, side_far])
    height = np.sin(base) * np.sin(at_first) * sides[0]
    told = ~free & np.all(sides >= SHORTEST, axis=0)
    sine = np.where(told, height / np.where(told, sides[0] * sides[1], 1.0), 0.0)
    every_side = np.array([length[:, 0], *np.broadcast_arrays(*np.abs(sides))])
    largest = np.max(every_side, axis=0)
    slenderness = np.min(every_side, axis=0) / np.where(largest > 0.0, largest, 1.0)
    return near_rotation, far_rotation, sine, slenderness, closes
