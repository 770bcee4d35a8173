"""Two orientations of a body: the rotation between them, and rotation about a fixed axis.

Any two orientations differ by one rotation about one axis. The axis is not determined
where they coincide, and its sense is not where they differ by half a turn.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import EPS, USABLE_DIRECTION
from spherekit.sphere.rotation import Floats, cross, quaternion, transpose

ROUNDING = 8.0 * EPS
"""Error of the axis times angle of a rotation computed from two orientations (rad)."""


class TurnStatus(IntEnum):
    """What is known of the axis of a rotation between two orientations."""

    OK = 0
    NO_AXIS = 1
    NO_SENSE = 2


TURN_MEANING = {
    TurnStatus.OK: "axis and angle are determined",
    TurnStatus.NO_AXIS: "the orientations coincide: every axis will do, none is given",
    TurnStatus.NO_SENSE: "the orientations differ by half a turn: the line of the axis is "
    "determined, but both senses lead from one to the other",
}


@final
@dataclass(frozen=True)
class Turns:
    """n rotations: unit `axis` (n, 3), `angle` (n,) in [0, pi] rad, `status` (n,).

    The axis is NaN where the status is NO_AXIS. Where it is NO_SENSE the largest
    component of the axis is positive.
    """

    axis: Floats
    angle: Floats
    status: NDArray[np.int8]


def turns_between(first: Floats, second: Floats) -> Turns:
    """Return the rotations that carry first orientations to second ones.

    Parameters
    ----------
    first, second
        Rotation matrices (n, 3, 3) from body axes to fixed axes.

    Returns
    -------
    Turns
        In fixed axes: ``second = rotation(axis, angle) @ first``.
    """
    four = quaternion(second @ transpose(first))
    vector = np.where(four[:, 3:] < 0.0, -four[:, :3], four[:, :3])
    scalar = np.abs(four[:, 3])
    sine = np.linalg.norm(vector, axis=1)
    angle = 2.0 * np.arctan2(sine, scalar)
    status = np.full(len(angle), TurnStatus.OK, dtype=np.int8)
    status[2.0 * scalar <= ROUNDING] = TurnStatus.NO_SENSE
    status[angle * USABLE_DIRECTION <= ROUNDING] = TurnStatus.NO_AXIS
    has_axis = (status != TurnStatus.NO_AXIS)[:, None]
    axis = np.where(has_axis, vector / np.where(has_axis, sine[:, None], 1.0), np.nan)
    largest = np.argmax(np.abs(vector), axis=1)
    back = (status == TurnStatus.NO_SENSE) & (vector[np.arange(len(vector)), largest] < 0.0)
    return Turns(np.where(back[:, None], -axis, axis), angle, status)


def rotation(axis: Floats, angle: ArrayLike) -> Floats:
    """Return rotation matrices (n, 3, 3) by angles (n,) rad about one unit axis (3,)."""
    angle = np.asarray(angle, dtype=float)[:, None, None]
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(
        np.eye(3) + np.sin(angle) * skew + 2.0 * np.sin(0.5 * angle) ** 2 * (skew @ skew)
    )


@final
@dataclass(frozen=True)
class LogRate:
    """How the rotation vector d of Q changes with the spatial angular velocity w of Q.

    d' = w - d x w / 2 + c d x (d x w) with c = (1 - (a / 2) cot(a / 2)) / a^2 and a the
    length of d (Bullo and Murray 1995, eq. 2.11). With `sense` = -1 the second term is
    added: that form takes the angular velocity in the axes of the rotated body.
    """

    vector: Floats
    sense: float = 1.0

    def of(self, w: Floats) -> Floats:
        """Return d' (n, 3) for angular velocities (n, 3)."""
        d = self.vector
        first = cross(d, w)
        factor, _ = _series(d)
        return np.asarray(w - 0.5 * self.sense * first + factor * cross(d, first))

    def changed(self, rate: Floats, w: Floats) -> Floats:
        """Return the change (n, 3) of `of(w)` for fixed w while d changes at `rate`."""
        d = self.vector
        factor, slope = _series(d)
        along = 2.0 * np.sum(d * rate, axis=1, keepdims=True)
        first, turned = cross(d, w), cross(rate, w)
        return np.asarray(
            -0.5 * self.sense * turned
            + slope * along * cross(d, first)
            + factor * (cross(rate, first) + cross(d, turned))
        )


def _series(vector: Floats) -> tuple[Floats, Floats]:
    """Return c (n, 1) of `LogRate` and its derivative by the square of the angle."""
    square = np.sum(vector * vector, axis=1, keepdims=True)
    small = square < 1.0
    safe = np.where(small, 1.0, square)
    half = 0.5 * np.sqrt(safe)
    cot = half / np.tan(half)
    factor = (1.0 - cot) / safe
    slope = ((half**2 / np.sin(half) ** 2 - cot) * 0.5 - (1.0 - cot)) / safe**2
    near, near_slope = _C(square), _C_RATE(square)
    return np.where(small, near, factor), np.where(small, near_slope, slope)


_C = np.polynomial.Polynomial(
    [
        1 / 12,
        1 / 720,
        1 / 30240,
        1 / 1209600,
        1 / 47900160,
        691 / 1307674368000,
        1 / 74724249600,
        3617 / 10670622842880000,
        43867 / 5109094217170944000,
        174611 / 802857662698291200000,
        77683 / 14101100039391805440000,
    ]
)
"""c as a series in the square of the angle: Bernoulli numbers |B_2k| / (2k)!."""
_C_RATE = _C.deriv()
