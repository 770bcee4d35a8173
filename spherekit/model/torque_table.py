"""Torques given at times."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked_class
from spherekit.conventions import counted
from spherekit.errors import ModelError
from spherekit.model.laws import need_increasing
from spherekit.model.load import Component, Load
from spherekit.model.needs import need_angle, need_finite

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism


@final
@checked_class(ModelError, "at")
@dataclass(frozen=True)
class TorqueTable(Load):
    """A torque (N m) at an R pair given at increasing times (s), linear in between.

    A periodic one repeats with the period ``times[-1] - times[0]``.
    """

    kind = "table"
    keys = MappingProxyType(
        {"pair": "pair", "times": "numbers", "torques": "numbers", "periodic": "flag"}
    )

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

    def check(self, key: str, mechanism: "Mechanism") -> None:
        """See `Load`."""
        need_angle(f"{key}.pair", self.pair, mechanism)
        if len(self.times) != len(self.torques):
            raise ModelError(
                f"{key}.torques: has {counted(len(self.torques), 'value')}, but times has "
                f"{len(self.times)}"
            )
        if len(self.times) < 2:
            has = counted(len(self.times), "value")
            raise ModelError(f"{key}.times: has {has}, needs at least 2")
        need_finite(f"{key}.times", self.times)
        need_finite(f"{key}.torques", self.torques)
        need_increasing(f"{key}.times", self.times)
        if self.periodic and self.torques[0] != self.torques[-1]:
            raise ModelError(
                f"{key}.torques: a periodic table ends with the torque it starts with, but "
                f"this one has {self.torques[0]:g} and {self.torques[-1]:g} N m"
            )

    def components(self, mechanism: "Mechanism") -> tuple[Component, ...]:
        """See `Load`."""
        return (Component(self, self.pair),)
