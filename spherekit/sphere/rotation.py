"""Batched rotations: matrices (n, 3, 3) acting on columns, quaternions xyzw.

The spherical triangle: the closed form behind every dyad (RR chain of two links).

Orientations as tilt and torsion, pointing directions as azimuth and tilt.

The z axis is tilted by `tilt` towards the azimuth, and `torsion` is what is left of the
turn about it: R = Z(azimuth) Y(tilt) Z(torsion - azimuth) (I. A. Bonev and J. Ryu, A new
approach to orientation workspace analysis of 6-DOF parallel manipulators, 2001). Unlike
Euler angles, torsion and tilt have no jump where the tilt is zero.

Planes through the sphere's centre as mirrors, and the angles that name them.

A mirror with unit normal n carries Q = x to P. Chen et al. 2021 name it by three angles:
P = (cos phi, sin phi sin omega, sin phi cos omega), and gamma, the angle by which the plane
y = 0 is turned. In the normal they are n = (-sin(phi / 2), sin(gamma / 2), n_z) and
tan omega = n_y / n_z, so phi and gamma alone name the mirror with n_z >= 0.

Derivatives by complex steps: functions of a + i h da have f + i h df, exactly.

With h so small that h squared is nothing beside 1, no difference is taken and no digit is
lost. Such numbers go through code that is written for real ones as long as that is
analytic: products, roots and sines, no absolute values. (W. Squire and G. Trapp, SIAM
Review 40, 1998.)
"""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Array, Bools, Floats
from spherekit.conventions import REACH_SLACK
from spherekit.errors import SolveError
from spherekit.numeric.crossings import wrap


def cross(a: Array, b: Array) -> Array:
    """Return a x b for arrays (..., 3); much faster on small arrays than NumPy's own."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    out = np.empty((*x.shape, 3), dtype=x.dtype)
    out[..., 0], out[..., 1], out[..., 2] = x, az * bx - ax * bz, ax * by - ay * bx
    return out


def about_z(angle: ArrayLike) -> Floats:
    """Return rotation matrices (..., 3, 3) by angle (rad) about the z axis."""
    angle = np.asarray(angle, dtype=float)
    out = np.zeros((*angle.shape, 3, 3))
    c, s = np.cos(angle), np.sin(angle)
    out[..., 0, 0] = out[..., 1, 1] = c
    out[..., 0, 1], out[..., 1, 0] = -s, s
    out[..., 2, 2] = 1.0
    return out


def transpose(matrix: Floats) -> Floats:
    """Return the inverse of rotation matrices (..., 3, 3)."""
    return np.swapaxes(matrix, -1, -2)


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


def rotation_vector(matrix: Floats) -> Floats:
    """Return the rotation vectors (..., 3), axis times angle in [0, pi], of matrices.

    Accurate to rounding for small angles, where closure residuals live; near a half
    turn the axis comes from the quaternion.
    """
    r = matrix
    twice_sine = np.empty(r.shape[:-1])
    x = np.subtract(r[..., 2, 1], r[..., 1, 2], out=twice_sine[..., 0])
    y = np.subtract(r[..., 0, 2], r[..., 2, 0], out=twice_sine[..., 1])
    z = np.subtract(r[..., 1, 0], r[..., 0, 1], out=twice_sine[..., 2])
    sine = 0.5 * np.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2] - 1.0)
    angle = np.arctan2(sine, cosine)
    small = sine < 1e-4
    factor = np.where(small, 1.0 + angle * angle / 6.0, angle / np.where(small, 1.0, sine))
    out: Floats = 0.5 * factor[..., None] * twice_sine
    flipped = (cosine < 0.0) & (sine < 1e-3)
    if np.any(flipped):
        four = quaternion(r[flipped])
        axis = unit_rows(four[:, :3] * np.where(four[:, 3:] < 0.0, -1.0, 1.0))
        out[flipped] = axis * angle[flipped][:, None]
    return out


def quaternion(matrix: Floats) -> Floats:
    """Return unit quaternions (n, 4) xyzw of rotation matrices (n, 3, 3).

    The sign is the one with the largest component positive; NaN in, NaN out.
    """
    r, trace = matrix, np.trace(matrix, axis1=1, axis2=2)[:, None]
    # four times the products of the quaternion's components
    rows = np.empty((len(r), 4, 4))
    rows[:, :3, :3] = r + transpose(r) + (1.0 - trace)[..., None] * np.eye(3)
    back, ahead = [2, 0, 1], [1, 2, 0]
    rows[:, 3, :3] = rows[:, :3, 3] = r[:, back, ahead] - r[:, ahead, back]
    rows[:, 3, 3:] = 1.0 + trace
    best = np.argmax(np.diagonal(rows, axis1=1, axis2=2), axis=1)
    return unit_rows(rows[np.arange(len(r)), best])


def from_quaternion(quaternions: Array) -> Array:
    """Return rotation matrices (..., 3, 3) of unit quaternions (..., 4) xyzw.

    Complex ones are taken as they are: the squares of their parts must have the sum 1.
    """
    vector, scalar = quaternions[..., :3], quaternions[..., 3, None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    out = 2 * vector[..., :, None] * vector[..., None, :]
    out += (2 * scalar * scalar - 1) * np.eye(3)
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return out + 2 * scalar * skew.reshape(out.shape)


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


def angles_between(first: Floats, second: Floats) -> Floats:
    """Return the angles (n,) rad of the rotations that carry orientations to others.

    Both are rotation matrices (n, 3, 3) from body axes to fixed axes.
    """
    return np.linalg.norm(rotation_vector(second @ transpose(first)), axis=-1)


def rotation(axis: Floats, angle: ArrayLike) -> Floats:
    """Return rotation matrices (n, 3, 3) by angles (n,) rad about one unit axis (3,)."""
    angle = np.asarray(angle, dtype=float)[:, None, None]
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + 2.0 * np.sin(0.5 * angle) ** 2 * (skew @ skew)


def log_rate(vector: Floats, w: Floats) -> Floats:
    """Return the change d' (n, 3) of rotation vectors d as Q turns at w (n, 3).

    d' = w - d x w / 2 + c d x (d x w) with c = (1 - (a / 2) cot(a / 2)) / a^2 and a the
    length of d, w the spatial angular velocity of Q (Bullo and Murray 1995, eq. 2.11). With
    w in the axes of the rotated body the second term is added: it is that of -d.
    """
    first = cross(vector, w)
    return w - 0.5 * first + _C(_square(vector)) * cross(vector, first)


def log_rate_change(vector: Floats, rate: Floats, w: Floats) -> Floats:
    """Return the change (n, 3) of `log_rate` for fixed w while d changes at `rate`."""
    along = 2.0 * np.sum(vector * rate, axis=1, keepdims=True)
    first, turned = cross(vector, w), cross(rate, w)
    return (
        -0.5 * turned
        + _C_RATE(_square(vector)) * along * cross(vector, first)
        + _C(_square(vector)) * (cross(rate, first) + cross(vector, turned))
    )


def _square(vector: Floats) -> Floats:
    return np.sum(vector * vector, axis=1, keepdims=True)


def _terms() -> list[float]:
    """Return the first terms of c by the square of the angle, |B_2k| / (2k)!.

    By Euler's rule for sums of even powers, from the convolution of those before.
    """
    terms = [1.0 / 12.0]
    while len(terms) < 32:
        terms.append(np.dot(terms, terms[::-1]) / (2 * len(terms) + 3))
    return terms


_C = np.polynomial.Polynomial(_terms())
"""The factor c of `log_rate`, exact to rounding for angles up to pi."""
_C_RATE = _C.deriv()


def azimuth_tilt(directions: Floats) -> Floats:
    """Return azimuth (-pi, pi] and tilt [0, pi] (n, 2) rad of unit vectors (n, 3)."""
    x, y, z = directions.T
    return np.stack([np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)], axis=1)


def pointing(angles: Floats) -> Floats:
    """Return the unit vectors (n, 3) of azimuth and tilt (n, 2) rad."""
    azimuth, tilt = angles.T
    across = np.sin(tilt)
    return np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), np.cos(tilt)], axis=1
    )


def euler_zyz(rotations: Floats) -> Floats:
    """Return the angles (n, 3) rad of rotations (n, 3, 3) = Z(a) Y(b) Z(c), b in [0, pi].

    The three together give the rotation back to rounding, also where b is 0 or pi and
    only the sum or difference of the others is determined.
    """
    r = rotations
    first = azimuth_tilt(r[:, :, 2])
    c, s = np.cos(first[:, 0]), np.sin(first[:, 0])
    sine, cosine = c * r[:, 1, :2].T - s * r[:, 0, :2].T
    return np.column_stack([first, np.arctan2(sine, cosine)])


def from_euler_zyz(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) = Z(a) Y(b) Z(c) of angles (n, 3) rad."""
    first, swing, last = angles.T
    return about_z(first) @ rotation(np.eye(3)[1], swing) @ about_z(last)


def tilt_torsion(rotations: Floats) -> Floats:
    """Return azimuth, tilt and torsion (n, 3) rad of rotations (n, 3, 3).

    Azimuth and torsion are in (-pi, pi], the tilt in [0, pi]. Where the tilt is pi only
    2 azimuth - torsion is determined; where it is 0 the azimuth is 0 or pi.
    """
    angles = euler_zyz(rotations)
    angles[:, 2] = wrap(angles[:, 0] + angles[:, 2])
    return angles


def from_tilt_torsion(angles: Floats) -> Floats:
    """Return the rotations (n, 3, 3) of azimuth, tilt and torsion (n, 3) rad."""
    azimuth, tilt, torsion = angles.T
    return from_euler_zyz(np.stack([azimuth, tilt, torsion - azimuth], axis=1))


def reflections(normals: Floats) -> Floats:
    """Return the matrices (..., 3, 3) of mirrors with unit normals (..., 3)."""
    return np.eye(3) - 2.0 * normals[..., :, None] * normals[..., None, :]


def upward(normals: Floats) -> Floats:
    """Return the normals (..., 3) of the same mirrors with n_z >= 0."""
    return np.where(normals[..., 2:] < 0.0, -normals, normals)


def mirror_angles(normals: Floats) -> tuple[Floats, Floats, Floats]:
    """Return phi, gamma and omega (n,) rad of mirrors with unit normals (n, 3).

    In the paper's axes, for n_z >= 0. phi runs from -pi to pi: it is the arc from Q to P,
    negative where P is on the side z < 0, so that all three angles are smooth where P
    passes through Q. gamma runs from -pi to pi, omega from -pi / 2 to pi / 2. The paper has
    phi >= 0 only.
    """
    x, y, z = np.moveaxis(upward(normals), -1, 0)
    phi = -2.0 * np.arctan2(x, np.hypot(y, z))
    return phi, 2.0 * np.arctan2(y, np.hypot(x, z)), np.arctan2(y, z)


def normals_of(phi: ArrayLike, gamma: ArrayLike) -> Floats:
    """Return the unit normals (n, 3) of mirrors with these phi and gamma (n,) rad.

    NaN where no mirror has them: sin^2(phi / 2) + sin^2(gamma / 2) > 1.
    """
    half, other = (0.5 * np.asarray(angle, dtype=float) for angle in (phi, gamma))
    x, y = -np.sin(half), np.sin(other)
    # cos(a + b) cos(a - b) loses nothing near the edge, where 1 - x^2 - y^2 does
    square = np.cos(half + other) * np.cos(half - other)
    with np.errstate(invalid="ignore"):
        z = np.sqrt(square)
    return np.stack([x, y, z], axis=-1) + 0.0 * z[..., None]


def normal_at(phi: float, gamma: float) -> Floats:
    """Return the unit normal (3,) of one mirror.

    Raises
    ------
    SolveError
        If no mirror has these angles (rad).
    """
    normal = normals_of(phi, gamma)
    if np.any(np.isnan(normal)):
        raise SolveError(
            f"no mirror has phi = {np.degrees(phi):.6g} deg with gamma = "
            f"{np.degrees(gamma):.6g} deg: sin^2(phi / 2) + sin^2(gamma / 2) is above 1; "
            "make one of them smaller"
        )
    return normal


def mirror_of(matrices: Floats) -> tuple[Floats, Floats]:
    """Return the mirrors nearest to improper orthogonal matrices, and how far they are.

    Parameters
    ----------
    matrices
        (n, 3, 3), determinant -1.

    Returns
    -------
    normals, departure
        Unit normals (n, 3) with n_z >= 0, and the angle (n,) rad of the rotation between
        the mirror and the matrix: 0 where the matrix is a reflection.
    """
    _, vectors = np.linalg.eigh(0.5 * (matrices + transpose(matrices)))
    normals = upward(vectors[..., 0])
    return normals, angles_between(reflections(normals), matrices)


STEP = 2.0**-120


def stepped(values: ArrayLike, change: ArrayLike) -> Floats:
    """Return numbers that carry their derivatives; they are complex."""
    given = np.asarray(values, dtype=float) + 1j * STEP * np.asarray(change, dtype=float)
    return cast(Floats, given)


def slope_of(values: Floats) -> Floats:
    """Return the derivatives that numbers carry."""
    return np.imag(values) / STEP


def all_finite(values: ArrayLike, axis: int | tuple[int, ...] | None = None) -> Any:
    """Return whether numbers are finite: all, or all along some axes."""
    return np.all(np.isfinite(values), axis=axis)


def unit_rows(vectors: Floats) -> Floats:
    """Return vectors (..., k) of length 1 along those given."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def nans(shape: int | tuple[int, ...]) -> Floats:
    """Return an array of numbers that are not known."""
    return np.full(shape, np.nan)


def max_abs(values: ArrayLike, axis: int | tuple[int, ...] | None = None) -> Any:
    """Return the largest size of numbers, of all or along axes; 0 of none."""
    return np.max(np.abs(values), axis=axis, initial=0.0)
