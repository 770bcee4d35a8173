"""What a stored model is of, without its numbers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

from spherekit.conventions import listing, nearest
from spherekit.errors import SolveError
from spherekit.model.dynamics import TorqueTable
from spherekit.model.expression import Expression, load_names, parse

SLACK = 1e-12
"""The ends of a range may be overstepped by this part of it, which is rounding."""


@final
@dataclass(frozen=True)
class StoredFunction:
    """A stored function of the coordinate: its `largest` value and measured `error`.

    The error is relative to the largest value, which belongs to all components of a
    vector alike.
    """

    name: str
    unit: str
    largest: float
    error: float


@final
@dataclass(frozen=True)
class StoredLoad:
    """The magnitudes of a load's components, and the stored functions they work on.

    `components` are expressions in pair variables, their rates and the time; a torque
    given by a table has `times` (s) and `torques` (N m) instead. `works_on` names a
    function for each: the rate of a pair's variable, or a velocity of the load's own.
    """

    name: str
    works_on: tuple[str, ...]
    components: tuple[str, ...] = ()
    times: tuple[float, ...] = ()
    torques: tuple[float, ...] = ()
    repeats: bool = False

    @property
    def table(self) -> TorqueTable | None:
        """The torque as a table, None where there is none."""
        if self.components:
            return None
        return TorqueTable(self.name, "", self.times, self.torques, self.repeats)


def magnitudes(
    loads: Sequence[StoredLoad], angles: Sequence[str]
) -> tuple[Expression | TorqueTable, ...]:
    """Return the magnitude of each component of each load, N m or N."""
    names = load_names(angles)
    laws: list[Expression | TorqueTable] = []
    for load in loads:
        table = load.table
        laws += [table] if table else [parse(text, names) for text in load.components]
    return tuple(laws)


@final
@dataclass(frozen=True)
class ModelMetadata:
    """What a stored model is of, without its numbers.

    `coordinate` is "q", the variable of pair `input`, on a closed curve along which it
    turns fully, or "s", the arc length of the curve (rad). `low`, `high` bound the
    coordinate; of a periodic model they are one period apart, in which the variables grow
    by `rise`. `variables` and `angles` name the pair variables, and the R pairs among
    them. The first of `groups` has what the motion needs, each further one a pole, in
    the order of `poles`, named
    LINK/RELATIVE_TO. `mechanism_sha256` is of the mechanism's canonical file in radians,
    `made_by` the version of spherekit.
    """

    mechanism: str
    mechanism_sha256: str
    made_by: str
    input: str
    assembly_mode: int
    coordinate: str
    periodic: bool
    low: float
    high: float
    variables: tuple[str, ...]
    angles: tuple[str, ...]
    poles: tuple[str, ...]
    loads: tuple[StoredLoad, ...]
    rise: tuple[float, ...]
    groups: tuple[tuple[StoredFunction, ...], ...]

    @property
    def functions(self) -> tuple[StoredFunction, ...]:
        """All stored functions."""
        return tuple(function for group in self.groups for function in group)

    def derivative(self, name: str) -> str:
        """Return the name of a function's derivative by the coordinate."""
        return f"d({name})/d{self.coordinate}"

    def place(self, name: str) -> tuple[int, int]:
        """Return the group and the column of a function."""
        if name not in self._places:
            raise SolveError(
                f'{self.mechanism}: "{name}" is not stored'
                f"{nearest(name, self._places) or ';'} Stored are {listing(self._places)}"
            )
        return self._places[name]

    def magnitudes(self) -> tuple[Expression | TorqueTable, ...]:
        """Return the magnitude of each component of each load, N m or N."""
        return magnitudes(self.loads, self.angles)

    def read(self) -> Mapping[str, tuple[str, bool]]:
        """Return what each name in magnitudes stands for, the time left out.

        A stored function, and whether it is to be multiplied by the coordinate's rate.
        """
        names = {f"theta_{pair}": (f"theta_{pair}", False) for pair in self.angles}
        for pair in self.angles:
            names[f"dtheta_{pair}"] = (self.derivative(f"theta_{pair}"), True)
        return names

    def within(self, x: float) -> tuple[float, int]:
        """Return a coordinate within `low` and `high`, and how many laps were taken off.

        Raises
        ------
        SolveError
            If it is not finite, or beyond the ends of a model that is not periodic.
        """
        lap = self.high - self.low
        if self.periodic and math.isfinite(x):
            laps = math.floor((x - self.low) / lap)
            return x - laps * lap, laps
        slack = SLACK * lap
        if self.periodic or not self.low - slack <= x <= self.high + slack:
            raise self.outside(x)
        return x, 0

    def outside(self, x: float) -> SolveError:
        """Return the error of a coordinate that the model does not have."""
        allowed = "is finite"
        if not self.periodic:
            allowed = f"lies within {self.low:.9g} to {self.high:.9g} rad"
        return SolveError(
            f"{self.mechanism}: the model is asked for {self.coordinate} = {x:.9g}, but "
            f"the coordinate {allowed}"
        )

    @cached_property
    def _places(self) -> Mapping[str, tuple[int, int]]:
        return {
            function.name: (k, column)
            for k, group in enumerate(self.groups)
            for column, function in enumerate(group)
        }
