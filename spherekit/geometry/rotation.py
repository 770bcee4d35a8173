"""Rotations as matrices, quaternions and rotation vectors, in arrays of many.

Matrices (..., 3, 3) act on column vectors. Quaternions (..., 4) have the components x, y,
z, w. A rotation vector (..., 3) is the axis times the angle (rad).
"""

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array, Floats
from spherekit.geometry.vectors import cross, unit_rows

SMALL_ANGLE_SINE = 1e-4
"""Sine of the angle below which angle / sine is computed from its series 1 + angle^2 / 6.

Larger: the omitted term 7 angle^4 / 360 exceeds the rounding error. Smaller: the
quotient is used for smaller angles, and only the angle 0 has none.
"""

HALF_TURN_SINE = 1e-3
"""Sine of an obtuse angle below which the axis is computed from the quaternion.

The antisymmetric part of the matrix, from which the axis is computed otherwise, is
proportional to the sine. Larger: quaternions are computed for more rotations. Smaller: the
axis loses more digits near half a turn.
"""


def transpose(matrix: Floats) -> Floats:
    """Return the transposes of matrices (..., 3, 3): the inverses of rotations."""
    return np.swapaxes(matrix, -1, -2)


def about_z(angle: ArrayLike) -> Floats:
    """Return the rotation matrices (..., 3, 3) about the z axis by angles (...), rad."""
    angle = np.asarray(angle, dtype=float)
    matrix = np.zeros((*angle.shape, 3, 3))
    c = np.cos(angle)
    s = np.sin(angle)
    matrix[..., 0, 0] = c
    matrix[..., 0, 1] = -s
    matrix[..., 1, 0] = s
    matrix[..., 1, 1] = c
    matrix[..., 2, 2] = 1.0
    return matrix


def rotation_about_axis(axis: Floats, angle: ArrayLike) -> Floats:
    """Return the rotation matrices (n, 3, 3) about one unit axis (3,) by angles (n,), rad.

    Rodrigues' formula R = 1 + sin(angle) K + (1 - cos(angle)) K^2, where K v is the cross
    product of the axis and v. The last factor is written as 2 sin^2(angle / 2), which keeps
    its digits at small angles.
    """
    angle = np.asarray(angle, dtype=float)[:, None, None]
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + 2.0 * np.sin(0.5 * angle) ** 2 * (K @ K)


def from_quaternion(quaternions: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of unit quaternions (..., 4) xyzw.

    Quaternions may be complex, for derivatives by complex steps. The sum of the squares of
    the components, without conjugation, must be 1.
    """
    vector = quaternions[..., :3]
    scalar = quaternions[..., 3, None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    # R = 2 v v^T + (2 w^2 - 1) 1 + 2 w K, where K u is the cross product of v and u.
    matrix = 2 * vector[..., :, None] * vector[..., None, :]
    matrix += (2 * scalar * scalar - 1) * np.eye(3)
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return matrix + 2 * scalar * K.reshape(matrix.shape)


def quaternion(matrix: Floats) -> Floats:
    """Return the unit quaternions (n, 4) xyzw of rotation matrices (n, 3, 3).

    Each rotation has two quaternions with opposite signs. The one with a positive largest
    component is returned. The result is NaN if the matrix is NaN.
    """
    # The elements of the matrix determine the symmetric matrix (n, 4, 4) with the elements
    # 4 q_i q_j. Each of its rows is the quaternion q times 4 q_i.
    trace = np.trace(matrix, axis1=1, axis2=2)
    vector_part = np.stack(  # 4 w (x, y, z)
        [
            matrix[:, 2, 1] - matrix[:, 1, 2],
            matrix[:, 0, 2] - matrix[:, 2, 0],
            matrix[:, 1, 0] - matrix[:, 0, 1],
        ],
        axis=1,
    )
    products = np.empty((len(matrix), 4, 4))
    diagonal = (1.0 - trace)[:, None, None] * np.eye(3)
    products[:, :3, :3] = matrix + transpose(matrix) + diagonal
    products[:, 3, :3] = vector_part
    products[:, :3, 3] = vector_part
    products[:, 3, 3] = 1.0 + trace
    # The row of the largest diagonal element 4 q_i^2 has the smallest rounding error. The
    # component q_i is positive in this row.
    diagonals = np.diagonal(products, axis1=1, axis2=2)
    largest = np.argmax(diagonals, axis=1)
    return unit_rows(products[np.arange(len(matrix)), largest])


def rotation_vector(matrix: Floats) -> Floats:
    """Return the rotation vectors (..., 3) of rotation matrices (..., 3, 3).

    A rotation vector is the unit axis times the angle (rad), from 0 to pi. Small angles are
    accurate to rounding.
    """
    r = matrix
    # The vector (x, y, z) of the antisymmetric part is the axis times twice the sine of the
    # angle.
    x = r[..., 2, 1] - r[..., 1, 2]
    y = r[..., 0, 2] - r[..., 2, 0]
    z = r[..., 1, 0] - r[..., 0, 1]
    twice_sine_vector = np.stack([x, y, z], axis=-1)
    sine = 0.5 * np.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    # For small angles, angle / sine is computed from its series. The series is wrong near
    # half a turn, where the sine is small as well. The vectors of these rotations are
    # replaced below.
    is_small = sine < SMALL_ANGLE_SINE
    angle_over_sine = np.where(
        is_small, 1.0 + angle * angle / 6.0, angle / np.where(is_small, 1.0, sine)
    )
    vectors: Floats = 0.5 * angle_over_sine[..., None] * twice_sine_vector

    is_half_turn = (cosine < 0.0) & (sine < HALF_TURN_SINE)
    if np.any(is_half_turn):
        vectors[is_half_turn] = _obtuse_rotation_vectors(
            r[is_half_turn], angle[is_half_turn]
        )
    return vectors


def _obtuse_rotation_vectors(matrix: Floats, angle: Floats) -> Floats:
    """Return the rotation vectors (n, 3) of rotations by nearly half a turn.

    For other angles, the axis follows from the antisymmetric part of the matrix. Here this
    part nearly vanishes, so the axis follows from the quaternion.

    Parameters
    ----------
    matrix
        (n, 3, 3) rotation matrices.
    angle
        (n,) angles (rad), at most pi.
    """
    xyzw = quaternion(matrix)
    # For w >= 0 the vector part points along the axis of a rotation by at most pi.
    sign = np.where(xyzw[:, 3:] < 0.0, -1.0, 1.0)
    axis = unit_rows(xyzw[:, :3] * sign)
    return axis * angle[:, None]


def angles_between(first: Floats, second: Floats) -> Floats:
    """Return the angles (n,), rad, of the rotations between two sets of orientations.

    Parameters
    ----------
    first, second
        (n, 3, 3) rotation matrices from body axes to fixed axes.
    """
    return np.linalg.norm(rotation_vector(second @ transpose(first)), axis=-1)


def rotation_between_pairs(
    first: Array, second: Array, to_first: Array, to_second: Array
) -> Array:
    """Return the rotations that carry two unit vectors to two others.

    Parameters
    ----------
    first, second
        (..., 3) the two vectors before the rotation, real or complex.
    to_first, to_second
        (..., 3) the same two vectors after the rotation. Their scalar product must be that
        of `first` and `second`.

    Returns
    -------
    (..., 3, 3) rotation matrices; NaN if the two vectors are parallel.
    """
    # The rotation carries first, second and normal = first x second to their images. The
    # rows of `dual` give the components of a vector along these three, times |normal|^2.
    normal = cross(first, second)
    dual = np.stack([cross(second, normal), cross(normal, first), normal], axis=-2)
    images = np.stack([to_first, to_second, cross(to_first, to_second)], axis=-1)
    return images @ dual / np.sum(normal * normal, axis=-1)[..., None, None]


def log_rate(vector: Floats, w: Floats) -> Floats:
    """Return the time derivatives of the rotation vectors of rotating bodies.

    A rotation vector d is the axis times the angle. Its derivative is d' = w - d x w / 2 +
    c d x (d x w), where c = (1 - (a / 2) cot(a / 2)) / a^2 and a is the length of d.

    Parameters
    ----------
    vector
        (n, 3) rotation vectors d, rad.
    w
        (n, 3) angular velocities in fixed axes, rad/s. If w is in the axes of the body, the
        derivative is log_rate(-d, w).

    Returns
    -------
    (n, 3) derivatives d', rad/s.

    References
    ----------
    F. Bullo, R. M. Murray, Proportional derivative (PD) control on the Euclidean group,
    1995, eq. 2.11.
    """
    first_product = cross(vector, w)
    second_product = cross(vector, first_product)
    # The factor c, a power series in a^2 that also holds at a = 0.
    c = _SECOND_ORDER_FACTOR(_square(vector))
    return w - 0.5 * first_product + c * second_product


def log_rate_change(vector: Floats, rate: Floats, w: Floats) -> Floats:
    """Return second time derivatives of rotation vectors at constant angular velocity.

    A rotation vector d is the axis times the angle. Its first derivative (`log_rate`) at
    the angular velocity w, in fixed axes, is

        d' = w - d x w / 2 + c d x (d x w),    c = (1 - (a / 2) cot(a / 2)) / a^2,

    where a is the length of d. If w is constant, its derivative is

        d'' = -(d' x w) / 2 + c' d x (d x w) + c (d' x (d x w) + d x (d' x w)).

    If w changes, `log_rate(d, w')` has to be added.

    Parameters
    ----------
    vector, rate
        (n, 3) rotation vectors d, rad, and their time derivatives d', rad/s.
    w
        (n, 3) angular velocities, rad/s, which are constant here.

    Returns
    -------
    (n, 3) derivatives d'', rad/s^2.
    """
    square = _square(vector)
    square_rate = 2.0 * np.sum(vector * rate, axis=1, keepdims=True)
    # Dividing by a^2 fails at a = 0. So c is computed from its power series in a^2, cut off
    # to a polynomial. `_SECOND_ORDER_SLOPE` is the derivative of this polynomial.
    c = _SECOND_ORDER_FACTOR(square)
    c_rate = _SECOND_ORDER_SLOPE(square) * square_rate
    product = cross(vector, w)
    product_rate = cross(rate, w)
    # The three terms of d''.
    first_order_term = -0.5 * product_rate
    factor_change_term = c_rate * cross(vector, product)
    product_change_term = c * (cross(rate, product) + cross(vector, product_rate))
    return first_order_term + factor_change_term + product_change_term


def _square(vector: Floats) -> Floats:
    """Return the squares (n, 1) of the lengths of vectors (n, 3)."""
    return np.sum(vector * vector, axis=1, keepdims=True)


def _second_order_coefficients() -> list[float]:
    """Return the first 32 power-series coefficients of the factor c in `log_rate`.

    The variable is the square of the angle. The coefficients are |B_2k| / (2k)! with the
    Bernoulli numbers B_2k, for k = 1, 2, ... Euler's recurrence for the zeta function of
    even numbers gives each from the convolution of those before it.
    """
    coefficients = [1.0 / 12.0]
    while len(coefficients) < 32:
        convolution = np.dot(coefficients, coefficients[::-1])
        coefficients.append(convolution / (2 * len(coefficients) + 3))
    return coefficients


_SECOND_ORDER_FACTOR = np.polynomial.Polynomial(_second_order_coefficients())
"""The factor c of `log_rate` as a function of the square of the angle, exact to rounding up
to pi."""

_SECOND_ORDER_SLOPE = _SECOND_ORDER_FACTOR.deriv()
"""The derivative of the factor c with respect to the square of the angle."""
