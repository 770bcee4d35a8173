"""What a stored model is of, without its numbers."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import listing, nearest
from spherekit.errors import ModelError, SolveError
from spherekit.model.expression import Expression, load_names, parse
from spherekit.model.torque_table import TorqueTable

Floats = NDArray[np.float64]

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


@dataclass(frozen=True)
class StoredHeading:
    """What a stored model is of, without its numbers: what all models have.

    `variables` and `angles` name the pair variables, and the R pairs among them; `poles`
    the poles, as LINK/RELATIVE_TO. `mechanism_sha256` is of the mechanism's canonical file
    in radians, `made_by` the version of spherekit.
    """

    mechanism: str
    mechanism_sha256: str
    made_by: str
    assembly_mode: int
    variables: tuple[str, ...]
    angles: tuple[str, ...]
    poles: tuple[str, ...]
    loads: tuple[StoredLoad, ...]

    @cached_property
    def magnitudes(self) -> tuple[Expression | TorqueTable, ...]:
        """The magnitude of each component of each load, N m or N."""
        names = load_names(self.angles)
        laws: list[Expression | TorqueTable] = []
        for load in self.loads:
            table = load.table
            laws += [table] if table else [parse(text, names) for text in load.components]
        return tuple(laws)

    @property
    def works_on(self) -> tuple[str, ...]:
        """The names of what these magnitudes work on."""
        return tuple(name for load in self.loads for name in load.works_on)

    def sizes(self, names: Mapping[str, Floats], t: Floats) -> list[Floats]:
        """Return these magnitudes at values of their names and at times (s)."""
        return [
            law.at(t) if isinstance(law, TorqueTable) else law.evaluate(names)
            for law in self.magnitudes
        ]

    def by_load(self, parts: Floats) -> dict[str, Floats]:
        """Return the sums of forces (..., components) by the names of loads."""
        made, at = {}, 0
        for load in self.loads:
            made[load.name] = np.sum(parts[..., at : at + len(load.works_on)], axis=-1)
            at += len(load.works_on)
        return made

    def pole(self, name: str) -> tuple[str, float]:
        """Return the name by which a pole is stored, and -1 if that turns its links round.

        Raises
        ------
        SolveError
            If it is not stored.
        """
        reverse = "/".join(reversed(name.split("/")))
        for stored, sense in ((name, 1.0), (reverse, -1.0)):
            if stored in self.poles:
                return stored, sense
        raise self.not_stored(f'pole "{name}"', name, self.poles, "; make the model anew")

    def not_stored(
        self, what: str, name: str, stored: Collection[str], then: str = ""
    ) -> SolveError:
        """Return the error of what the model has not."""
        return SolveError(
            f"{self.mechanism}: {what} is not stored{nearest(name, stored) or ';'} Stored "
            f"are {listing(stored) or 'none'}{then}"
        )

    def torque_load(self, name: str, works_on: str, text: str) -> StoredLoad:
        """Return a torque (N m), an expression as in a file, as one more load.

        Raises
        ------
        ModelError
            If it breaks the grammar.
        """
        try:
            parse(text, load_names(self.angles))
        except ModelError as error:
            raise ModelError(f"{self.mechanism}: torque: {error}") from None
        return StoredLoad(name, (works_on,), (text,))


@final
@dataclass(frozen=True)
class ModelMetadata(StoredHeading):
    """What a stored model of one curve is of, without its numbers.

    `coordinate` is "q", the variable of pair `input`, on a closed curve along which it
    turns fully, or "s", the arc length of the curve (rad). `low`, `high` bound the
    coordinate; of a periodic model they are one period apart, in which the variables grow
    by `rise`. The first of `groups` has what the motion needs, each further one a pole, in
    the order of `poles`. The other entries are as in `StoredHeading`.
    """

    input: str
    coordinate: str
    periodic: bool
    low: float
    high: float
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
            raise self.not_stored(f'"{name}"', name, self._places)
        return self._places[name]

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
