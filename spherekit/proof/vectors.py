"""Vectors of three balls."""

from spherekit.proof.balls import Ball

Vector = tuple[Ball, Ball, Ball]
Frame = tuple[Vector, Vector, Vector]
"""The unit vectors of a pair in one of its links: zero direction, side, axis."""


def dot(a: Vector, b: Vector) -> Ball:
    """Return the product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def unit(a: Vector) -> Vector:
    """Return a vector over its length."""
    length = dot(a, a).sqrt()
    return a[0] / length, a[1] / length, a[2] / length


def carried(vector: Vector, start: Frame, goal: Frame) -> Vector:
    """Return the vector that has in one frame the coordinates that another has in a second.

    `vector` is in the axes in which `start` is given, the result in those of `goal`.
    """
    parts = [dot(axis, vector) for axis in start]
    coordinates = [
        sum((part * axis[k] for part, axis in zip(parts, goal, strict=True)), 0 * parts[0])
        for k in range(3)
    ]
    return coordinates[0], coordinates[1], coordinates[2]
