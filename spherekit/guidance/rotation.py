"""What a rotation of the output link about a fixed axis is, sample by sample."""

from dataclasses import dataclass
from typing import Protocol, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.sphere.poses import TURN_MEANING, TurnStatus, turns_between
from spherekit.sphere.rotation import Floats

DEAD = 1e3
"""An input that turns by more for each rad of the output link is at a dead centre."""


@final
@dataclass(frozen=True)
class RotationSamples:
    """n samples of a rotation about a fixed axis, in the axes of the base.

    Attributes
    ----------
    theta
        (n,) rad, the angle turned through about the axis.
    inputs, rates, second_rates
        (n, inputs): the driven variables (rad) and their first and second derivatives by
        theta.
    values
        (n, variables) rad, of all pairs.
    orientation
        (n, 3, 3) from the axes of the output link to those of the base.
    departure
        (n,) rad, the angle between this orientation and the one turned exactly about
        the axis.
    drift
        (n,) rad, the angle between the axis about which the link turns there and the
        fixed one.
    type_2
        (n,) how surely the inputs hold the output, 0 where they do not: the measure of
        type II, see `spherekit.rates.transmission`.
    status
        (n,) codes of `Status`. A row that is not OK is NaN, except at AT_SINGULARITY:
        there the inputs do not hold the mechanism, but the rotation goes on; rates that
        are not finite are NaN.
    """

    theta: Floats
    inputs: Floats
    rates: Floats
    second_rates: Floats
    values: Floats
    orientation: Floats
    departure: Floats
    drift: Floats
    type_2: Floats
    status: NDArray[np.int8]


class FixedAxisRotation(Protocol):
    """A rotation of an output link by `angle` (rad) about the unit vector `axis` (3,)."""

    @property
    def axis(self) -> Floats:
        """Unit vector (3,) in the axes of the base."""
        ...

    @property
    def angle(self) -> float:
        """The whole angle (rad), 0 or more."""
        ...

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the driven pairs."""
        ...

    @property
    def reached(self) -> float:
        """The angle (rad) up to which the mechanism follows."""
        ...

    @property
    def end(self) -> Status:
        """Status of what lies beyond."""
        ...

    @property
    def crossings(self) -> tuple[float, ...]:
        """Angles (rad) on the way at which the inputs do not hold the mechanism."""
        ...

    def at(self, theta: ArrayLike) -> RotationSamples:
        """Return the samples at angles theta (n,) from 0 to the whole angle, any order."""
        ...


def dead_centre(rotation: FixedAxisRotation) -> str:
    """Return the input at a dead centre where a rotation is followed no further, or ``""``.

    There the output link asks it to turn by `DEAD` or more for each rad of its own.
    """
    rates = np.nan_to_num(np.abs(rotation.at([rotation.reached]).rates[0]), posinf=np.inf)
    most = int(np.argmax(rates))
    return rotation.inputs[most] if rates[most] > DEAD else ""


def turn_to(first: Floats, second: Floats) -> tuple[Floats, float]:
    """Return axis (3,) and angle (rad) of the rotation between orientations (3, 3).

    Raises
    ------
    SolveError
        If the axis or its sense is not determined.
    """
    turn = turns_between(first[None], second[None])
    status = TurnStatus(turn.status[0])
    if status != TurnStatus.OK:
        what = {
            TurnStatus.NO_AXIS: "there is nothing to turn",
            TurnStatus.NO_SENSE: "give the axis, with the sense wanted, and the angle",
        }[status]
        raise SolveError(f"{TURN_MEANING[status]}; {what}")
    return np.asarray(turn.axis[0]), float(turn.angle[0])


def unit(axis: ArrayLike) -> Floats:
    """Return a direction (3,) with length 1; `SolveError` if it has none."""
    given = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(given))
    if given.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise SolveError(
            f"direction: found {given.tolist()}, needs three finite numbers, not all zero"
        )
    return np.asarray(given / length)


def within(theta: ArrayLike, angle: float) -> Floats:
    """Return angles (n,) as an array.

    Raises
    ------
    SolveError
        If one is not between 0 and the whole angle.
    """
    theta = np.atleast_1d(np.asarray(theta, dtype=float))
    slack = 1e-12 * max(1.0, angle)
    if theta.ndim != 1 or not np.all((theta >= -slack) & (theta <= angle + slack)):
        raise SolveError(
            f"theta has to be an array (n,) of angles from 0 to {angle:.6g} rad, the "
            "angle of the rotation"
        )
    return np.asarray(np.clip(theta, 0.0, angle))
