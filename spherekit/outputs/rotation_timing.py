"""Time on a rotation about a fixed axis: the quickest that the drives allow.

The angle goes as theta(t) = angle s(t / T) with a law shape s from 0 to 1. Speeds of the
inputs then go with 1 / T and accelerations with 1 / T^2, so the shortest duration T follows
from their largest values at T = 1, which are found to rounding.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import SolveError
from spherekit.files.time_law import Cycloidal, Law, Polynomial
from spherekit.geometry.rotation import all_finite, max_abs
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.numerics.zeros import find_zeros
from spherekit.outputs.fixed_axis_rotation import RotationSamples, within
from spherekit.status import Status
from spherekit.wording import listing, nearest

DEAD = 1e3
"""An input that turns by more for each rad of the output link is at a dead centre."""


class FixedAxisRotation(Protocol):
    """A rotation of an output link by `angle` (rad) about the unit vector `axis` (3,)."""

    @property
    def axis(self) -> Floats:
        """Unit vector (3,) in the axes of the base."""

    @property
    def angle(self) -> float:
        """The whole angle (rad), 0 or more."""

    @property
    def inputs(self) -> Names:
        """Names of the driven pairs."""

    @property
    def reached(self) -> float:
        """The angle (rad) up to which the mechanism follows."""

    @property
    def end(self) -> Status:
        """Status of what lies beyond."""

    @property
    def crossings(self) -> tuple[float, ...]:
        """Angles (rad) on the way at which the inputs do not hold the mechanism."""

    def at(self, theta: ArrayLike) -> RotationSamples:
        """Return the samples at angles theta (n,) from 0 to the whole angle, any order."""


def dead_centre(rotation: FixedAxisRotation) -> str:
    """Return the input at a dead centre where a rotation is followed no further, or ``""``.

    There the output link asks it to turn by `DEAD` or more for each rad of its own.
    """
    rates = np.nan_to_num(np.abs(rotation.at([rotation.reached]).rates[0]), posinf=np.inf)
    most = np.argmax(rates)
    return rotation.inputs[most] if rates[most] > DEAD else ""


SHAPES: Mapping[str, Law] = MappingProxyType(
    {
        "cycloidal": Cycloidal(0.0, 1.0, 1.0),
        "cubic": Polynomial((0.0, 0.0, 3.0, -2.0)),
        "quintic": Polynomial((0.0, 0.0, 0.0, 10.0, -15.0, 6.0)),
        "septic": Polynomial((0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0)),
    }
)
"""Law shapes from 0 to 1 in unit time; all start and stop at rest, the cubic with a jump of
acceleration."""

TOLERANCE = 1e-9
"""Relative error of the interpolants in which the largest values are looked for."""
MOST_CELLS = 64
PARTS = 8
"""Of each of their cells, in which a derivative is simple."""
MOST_ROWS = 1_000_000
WHOLE = 1e-12
"""Part of a duration by which it may miss a whole number of cycles: rounding."""


@dataclass(frozen=True)
class Extreme:
    """The largest speed (rad/s) or acceleration (rad/s2) of an input, with its sign.

    `t` (s) and `theta` (rad) say where; `limit` is what is allowed, infinite for no limit.
    """

    input: str
    quantity: Literal["speed", "acceleration"]
    value: float
    t: float
    theta: float
    limit: float


@dataclass(frozen=True)
class Trajectory:
    """What a controller needs: n rows in time.

    `t` (n,) s; `theta` (n,) rad; `inputs` rad, `rates` rad/s, `accelerations` rad/s2, all
    (n, inputs), the inputs named by `names`; `type_2` (n,) and `status` (n,) as in
    `RotationSamples`.
    """

    names: Names
    t: Floats
    theta: Floats
    inputs: Floats
    rates: Floats
    accelerations: Floats
    type_2: Floats
    status: SmallIntegers


@dataclass(frozen=True)
class TimeScaling:
    """A rotation in time.

    `duration` in s; `extremes` for each input, speeds first; `error` is that of the
    interpolants from which these were found, relative to the largest. `cycle` (s) is the
    controller's, of which the duration is a whole number; None for none.
    """

    rotation: FixedAxisRotation
    shape: Law
    duration: float
    extremes: tuple[Extreme, ...]
    error: float
    cycle: float | None = None

    @property
    def binding(self) -> Extreme:
        """The extreme that sets the duration, at its limit but for whole cycles."""
        return max(
            self.extremes,
            key=lambda x: (
                (abs(x.value) / x.limit) ** (1.0 if x.quantity == "speed" else 0.5)
            ),
        )

    def at(self, t: ArrayLike) -> Trajectory:
        """Return the rows at times t (n,) from 0 to the duration (s).

        Raises
        ------
        SolveError
            If a time is outside.
        """
        t = within(t, self.duration, "t", "s")
        samples, motion = _moved(self.rotation, self.shape, t / self.duration)
        speeds, accelerations = np.split(motion, 2, axis=1)
        return Trajectory(
            self.rotation.inputs,
            t,
            samples.theta,
            samples.inputs,
            speeds / self.duration,
            accelerations / self.duration**2,
            samples.type_2,
            samples.status,
        )

    def table(self, samples: int) -> Trajectory:
        """Return rows at equally spaced times, both ends included.

        With a cycle there is a row for each, whatever number of samples is asked for.
        """
        if self.cycle is not None:
            ticks = np.arange(round(self.duration / self.cycle) + 1)
            return self.at(np.minimum(ticks * self.cycle, self.duration))
        if samples < 2:
            raise SolveError(f"samples: found {samples}, needs at least 2")
        return self.at(np.linspace(0.0, self.duration, samples))


@checked(SolveError)
def time_optimal(
    rotation: FixedAxisRotation,
    speed: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    shape: str | Law = "cycloidal",
    cycle: float | None = None,
) -> TimeScaling:
    """Return the shortest schedule of a law shape that keeps to the limits of the drives.

    Parameters
    ----------
    rotation
        Of a mechanism that follows it all the way.
    speed, acceleration
        Limits (rad/s, rad/s2) of the inputs: one for all, or one for each; None for none.
    shape
        A name in `SHAPES`, or a law from 0 at t = 0 to 1 at t = 1.
    cycle
        That of the controller (s): the duration is the shortest whole number of cycles.

    Raises
    ------
    SolveError
        If no limit is given or one is not positive, the shape is no such law, the cycle
        is not positive or makes more than `MOST_ROWS` rows, or the mechanism does not
        follow all the way.
    """
    count = len(rotation.inputs)
    law, limits = schedule_limits(rotation.inputs, speed, acceleration, shape, cycle)
    if not np.any(np.isfinite(limits)):
        raise SolveError("a schedule needs a limit of speed or of acceleration")
    fitted = PiecewiseChebyshev.fit(
        lambda part: _moved(rotation, law, part)[1],
        0.0,
        1.0,
        TOLERANCE,
        max_cells=MOST_CELLS,
    )

    places = np.array([_place_of_largest(fitted, k) for k in range(2 * count)])
    values = np.diagonal(_moved(rotation, law, places)[1])
    powers = np.repeat([1.0, 0.5], count)
    duration = float(np.max((np.abs(values) / limits) ** powers))
    if cycle is not None:
        if duration / cycle > MOST_ROWS:
            raise SolveError(
                f"cycle: {duration:.6g} s in cycles of {cycle:g} s are more than "
                f"{MOST_ROWS} rows; give a longer cycle"
            )
        duration = cycle * max(1.0, np.ceil(duration / cycle * (1.0 - WHOLE)))
    names = product(("speed", "acceleration"), rotation.inputs)
    reached, theta = values / duration ** (1.0 / powers), rotation.angle * law.at(places)[0]
    rows = np.stack([reached, duration * places, theta, limits], axis=1).tolist()
    extremes = tuple(
        Extreme(name, what, *row)  # type: ignore[arg-type]
        for (what, name), row in zip(names, rows, strict=True)
    )
    return TimeScaling(rotation, law, duration, extremes, fitted.error, cycle)


def schedule_limits(
    inputs: Sequence[str],
    speed: ArrayLike | None,
    acceleration: ArrayLike | None,
    shape: str | Law,
    cycle: float | None,
) -> tuple[Law, Floats]:
    """Return the law, and the limits (2 inputs,) of speeds and accelerations of inputs.

    See `time_optimal`, as for the errors.
    """
    if cycle is not None and not 0.0 < cycle < np.inf:
        raise SolveError(f"cycle: found {cycle:g}, needs a time above 0 s")
    limits = []
    for what, given in (("speed", speed), ("acceleration", acceleration)):
        limit = np.asarray(np.inf if given is None else given, dtype=float)
        if limit.shape not in ((), (1,), (len(inputs),)) or not np.all(limit > 0.0):
            raise SolveError(
                f"{what}: found {'+'.join(map(str, limit.ravel()))}, needs one limit above "
                f"0 for all inputs, or one for each of {listing(inputs)}"
            )
        limits.append(np.broadcast_to(limit, (len(inputs),)))
    return _shape(shape), np.concatenate(limits)


def _shape(shape: str | Law) -> Law:
    if isinstance(shape, str):
        if shape not in SHAPES:
            raise SolveError(
                f'shape: no law shape is named "{shape}"{nearest(shape, SHAPES) or "."} '
                f"Shapes: {listing(SHAPES)}"
            )
        return SHAPES[shape]
    part, _, _ = shape.at(np.linspace(0.0, 1.0, 1001))
    ends = np.append(part[[0, -1]] - [0.0, 1.0], part - np.clip(part, 0.0, 1.0))
    if not max_abs(ends) < 1e-12:
        raise SolveError(
            "a law shape goes from 0 at t = 0 to 1 at t = 1 and stays between these, but "
            f"this one goes from {part[0]:.6g} to {part[-1]:.6g}, or leaves that"
        )
    return shape


def _place_of_largest(fitted: PiecewiseChebyshev, number: int) -> float:
    """Return where a function is largest in size."""
    slope, bend = fitted.derivative, fitted.derivative.derivative

    def rate(x: Floats) -> tuple[Floats, Floats]:
        return slope.evaluate(x)[:, number], bend.evaluate(x)[:, number]

    places = np.append(
        fitted.edges, find_zeros(rate, fitted.spread_positions(PARTS)).places
    )
    return float(places[np.argmax(np.abs(fitted.evaluate(places)[:, number]))])


def _moved(
    rotation: FixedAxisRotation, law: Law, part: Floats
) -> tuple[RotationSamples, Floats]:
    """Return samples at parts (n,) of unit time, with speeds and accelerations there.

    The latter (n, 2 inputs) are those of the inputs if the whole takes 1 s.
    """
    s, ds, dds = law.at(part)
    whole = rotation.angle
    samples = rotation.at(whole * np.clip(s, 0.0, 1.0))
    lost = ~all_finite(samples.second_rates, 1)
    if np.any(lost):
        first = np.argmin(np.where(lost, samples.theta, np.inf))
        dead = dead_centre(rotation)
        raise SolveError(
            f"the mechanism does not follow all the way: at theta = "
            f"{np.degrees(samples.theta[first]):.6g} of {np.degrees(whole):.6g} deg it is "
            f"{Status(samples.status[first]).name}"
            + (f", as input {dead} is at a dead centre" if dead else "")
            + "; choose another start or end"
        )
    turned, swung = (whole * ds)[:, None], (whole * dds)[:, None]
    speeds = samples.rates * turned
    accelerations = samples.second_rates * turned**2 + samples.rates * swung
    return samples, np.concatenate([speeds, accelerations], axis=1)
