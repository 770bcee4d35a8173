"""What acts on the links of a mechanism: inertia, loads, and stops of pairs."""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.errors import ModelError

Vector = tuple[float, float, float]
Tensor = tuple[Vector, Vector, Vector]
Expressions = tuple[str, str, str]

TorqueFunction = Callable[[float, float, float], float]
"""A torque (N m) from the time t (s), the variable q (rad) and the rate dq (rad/s)."""

Axes = Literal["ground", "link"]
"""Whether components are along the axes of the ground or of the link acted on."""

AXES: tuple[Axes, ...] = ("ground", "link")

DRIVE = "driving_torque"
"""Name of the load that a torque at the input becomes."""


@final
@dataclass(frozen=True)
class Mass:
    """Inertia of a link, in link axes.

    `tensor` is the inertia tensor about the centre of the sphere (kg m2). `mass` (kg) and
    `centre`, the centre of mass (m), are needed by gravity only.
    """

    link: str
    tensor: Tensor
    mass: float | None = None
    centre: Vector | None = None


@final
@dataclass(frozen=True)
class PairTorque:
    """A torque (N m) about an R pair's axis on its second link, its reaction on the first.

    `torque` is an expression in pair variables ``theta_PAIR`` (rad), their rates
    ``dtheta_PAIR`` (rad/s) and the time ``t`` (s); or a function f(t, q, dq) of the time
    and of this pair's variable and rate, which only simulations by NumPy can call. It is
    called at any times in any order.
    """

    name: str
    pair: str
    torque: str | TorqueFunction


@final
@dataclass(frozen=True)
class Gravity:
    """The same acceleration (m/s2, ground axes) on every link with a mass."""

    name: str
    acceleration: Vector


@final
@dataclass(frozen=True)
class PointForce:
    """A force (N) at a point (m, link axes) fixed in a link; its reaction on the ground.

    The components of `force` are expressions as in `PairTorque`, along the axes of the
    ground or of the link.
    """

    name: str
    link: str
    point: Vector
    force: Expressions
    axes: Axes = "ground"


@final
@dataclass(frozen=True)
class Moment:
    """A moment (N m) on a link; its reaction on the ground.

    The components are expressions as in `PairTorque`, along the axes of the ground or of
    the link.
    """

    name: str
    link: str
    moment: Expressions
    axes: Axes = "ground"


@final
@dataclass(frozen=True)
class Spring:
    """A spring at an R pair: the torque -stiffness (v - rest) for the variable v (rad).

    `stiffness` is in N m/rad. The variable is not reduced to a turn.
    """

    name: str
    pair: str
    stiffness: float
    rest: float = 0.0


@final
@dataclass(frozen=True)
class Damper:
    """A viscous damper at an R pair: the torque -damping v' for the rate v' (rad/s).

    `damping` is in N m s/rad.
    """

    name: str
    pair: str
    damping: float


@final
@dataclass(frozen=True)
class Friction:
    """Dry and viscous friction at an R pair: -(torque tanh(v' / speed) + viscous v').

    `torque` (N m) is the dry friction at rates v' well above `speed` (rad/s), below which
    the jump of Coulomb's law is smoothed; `viscous` is in N m s/rad.
    """

    name: str
    pair: str
    torque: float
    viscous: float
    speed: float


@final
@dataclass(frozen=True)
class TorqueTable:
    """A torque (N m) at an R pair given at increasing times (s), linear in between.

    A periodic one repeats with the period ``times[-1] - times[0]``.
    """

    name: str
    pair: str
    times: tuple[float, ...]
    torques: tuple[float, ...]
    periodic: bool = False

    def at(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the torque (N m) at times (s) of any shape.

        Raises
        ------
        ModelError
            If a time is outside the table and the table is not periodic.
        """
        t = np.asarray(t, dtype=np.float64)
        first, last = self.times[0], self.times[-1]
        if self.periodic:
            t = first + np.mod(t - first, last - first)
        elif not np.all((t >= first) & (t <= last)):
            raise ModelError(
                f"loads.{self.name}: asked for t from {np.min(t):.6g} to {np.max(t):.6g} "
                f"s, but the table has {first:.6g} to {last:.6g} s; add rows, or set "
                "periodic = true"
            )
        return np.asarray(np.interp(t, self.times, self.torques), dtype=np.float64)

    def one(self, t: float) -> float:
        """Return the torque (N m) at one time (s): the same as `at`, in less time."""
        first, last = self.times[0], self.times[-1]
        if self.periodic:
            t = first + (t - first) % (last - first)
        elif not first <= t <= last:
            return float(self.at(t))
        after = min(bisect_right(self.times, t), len(self.times) - 1)
        start, before = self.times[after - 1], self.torques[after - 1]
        slope = (self.torques[after] - before) / (self.times[after] - start)
        return before + slope * (t - start)

    def knots(self, start: float, stop: float) -> Iterator[float]:
        """Yield the times (s) at which the slope changes, all between two and others."""
        if not self.periodic:
            yield from self.times
            return
        period = self.times[-1] - self.times[0]
        first = int(np.floor((start - self.times[-1]) / period))
        last = int(np.ceil((stop - self.times[0]) / period))
        for turn in range(first, last + 1):
            yield from (t + turn * period for t in self.times)


Load = PairTorque | Gravity | PointForce | Moment | Spring | Damper | Friction | TorqueTable


@final
@dataclass(frozen=True)
class Stop:
    """An R pair whose variable (rad) may not leave [low, high]; a simulation ends there."""

    pair: str
    low: float
    high: float
