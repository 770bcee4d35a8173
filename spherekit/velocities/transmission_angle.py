"""The transmission angle of a dyad: its formula, range and distance from type II.

A dyad is two links in series between two outer pairs. Its two arcs meet in the axis of the
middle pair. The transmission angle is the acute angle between the planes of these arcs. It
lies in [0, pi/2], and it is 0 exactly where the dyad is stretched or folded, which is a
singularity of type II: the output can move although the inputs are locked.

The range of the angle and its distance from type II are defined in this module. The
transmission *measure*, which exists for groups of all kinds, is in
`spherekit.velocities.transmission_measure`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry import vectors
from spherekit.planning.assembly_plan import Group
from spherekit.symbolic import vector_algebra
from spherekit.symbolic.expression_graph import Expr, dot, function, vector_product

NEAREST_TRANSMISSION_WORD = "least"
"""The word for the angle that is nearest to a singularity of type II.

It begins the names of figures of merit, such as ``least_transmission_angle_43``.
"""

NEAREST_TRANSMISSION_REDUCTION = "min"
"""The reduction of figures of merit that selects the angle nearest to type II."""

MAX_TYPE_II_DISTANCE_RAD = 0.5 * np.pi
"""The largest `distance_from_type_two`."""

Angle = TypeVar("Angle", float, Floats)
Vector = TypeVar("Vector")
Scalar = TypeVar("Scalar")


def distance_from_type_two(transmission_angle: Angle) -> Angle:
    """Return how far (rad) transmission angles are from 0, their value at type II."""
    return transmission_angle


@dataclass(frozen=True)
class VectorOperations(Generic[Vector, Scalar]):
    """The vector operations that the formula of `transmission_angle` uses.

    The formula is written once and is used for three kinds of vectors: arrays of numbers,
    symbolic components, and symbols of whole vectors. Each kind has its operations.

    Attributes
    ----------
    cross, dot
        The cross and the scalar product of two vectors.
    length
        The length of a vector.
    acute_angle
        The angle in [0, pi/2] with the tangent |a / b|, from a (not negative) and b.
    """

    cross: Callable[[Vector, Vector], Vector]
    dot: Callable[[Vector, Vector], Scalar]
    length: Callable[[Vector], Scalar]
    acute_angle: Callable[[Scalar, Scalar], Scalar]


def transmission_angle(
    operations: VectorOperations[Vector, Scalar],
    first_axis: Vector,
    middle_axis: Vector,
    last_axis: Vector,
) -> Scalar:
    """Return the transmission angle (rad, in [0, pi/2]) of a dyad.

    A dyad is two links that are joined by the middle one of three pairs (joints). Each link
    is a great-circle arc between the axes of its two pairs. The transmission angle is the
    acute angle between the planes of the two arcs. At 0 the dyad is stretched or folded, a
    singularity.

    Parameters
    ----------
    operations
        The operations on the vectors: `ARRAYS`, `COMPONENTS` or `VECTOR_NODES`.
    first_axis, middle_axis, last_axis
        Axes of the three pairs of the dyad in the order of its links, as unit vectors in
        one common frame.
    """
    first_normal = operations.cross(first_axis, middle_axis)
    second_normal = operations.cross(middle_axis, last_axis)
    # The angle between the normals of both planes, from its sine and cosine times the
    # lengths of the normals, which cancel. An arc cosine would be inaccurate near 0.
    double_normal = operations.cross(first_normal, second_normal)
    cosine = operations.dot(first_normal, second_normal)
    return operations.acute_angle(operations.length(double_normal), cosine)


def _acute_angle_of_arrays(sine: Floats, cosine: Floats) -> Floats:
    """Return the angle in [0, pi/2] of the tangent |sine / cosine| of arrays."""
    angle = np.arctan2(sine, cosine)
    return np.minimum(angle, np.pi - angle)


def _acute_angle_of_components(sine: Expr, cosine: Expr) -> Expr:
    """Return the expression of the angle in [0, pi/2] of the tangent |sine / cosine|."""
    return function("atan2", sine, function("sqrt", cosine * cosine))


def _acute_angle_in_print(sine: Expr, cosine: Expr) -> Expr:
    """Return the printed formula of the angle in [0, pi/2] of the tangent |sine / cosine|.

    Both numbers may have a common factor. The sine is a length, so it is not negative.
    """
    # Printed expressions have no operation for an absolute value. The operation "norm"
    # prints the bars of a length, and the length of a number is its absolute value.
    return function("atan", sine / function("norm", cosine))


ARRAYS: VectorOperations[Floats, Floats] = VectorOperations(
    cross=vectors.cross,
    dot=vectors.dot,
    length=lambda vector: np.linalg.norm(vector, axis=-1),
    acute_angle=_acute_angle_of_arrays,
)
"""Operations on arrays of vectors (n, 3)."""

COMPONENTS: VectorOperations[vector_algebra.Exprs, Expr] = VectorOperations(
    cross=vector_algebra.cross,
    dot=dot,
    length=lambda vector: function("sqrt", dot(vector, vector)),
    acute_angle=_acute_angle_of_components,
)
"""Operations on vectors (3,) whose components are expressions."""

VECTOR_NODES: VectorOperations[Expr, Expr] = VectorOperations(
    cross=partial(vector_product, "cross"),
    dot=partial(vector_product, "dot"),
    length=partial(function, "norm"),
    acute_angle=_acute_angle_in_print,
)
"""Operations on nodes that each represent a whole vector, as in printed formulas."""


def transmission_angle_of_group(group: Group | None, axes: Floats) -> Floats:
    """Return the transmission angle of a group of links at n configurations.

    Only a dyad (two links joined by a pair) has this angle. Each link is a great-circle arc
    between the axes of its two pairs. The transmission angle is the acute angle between the
    planes of the two arcs.

    Parameters
    ----------
    group
        The group, None if there is none.
    axes
        (n, pairs, 3) unit vectors of the axes of all pairs (joints), in one common frame.

    Returns
    -------
    (n,) angles (rad), NaN if the group is not a dyad.
    """
    if group is None or not group.is_dyad:
        return np.full(len(axes), np.nan)
    first, middle, last = group.dyad_pairs
    # `ARRAYS` has the operations on arrays of vectors (n, 3).
    return transmission_angle(ARRAYS, axes[:, first], axes[:, middle], axes[:, last])
