"""Stored functions at one place, and inertia and loads in one state: the quick way."""

from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from spherekit.dynamics.model_metadata import ModelMetadata
from spherekit.model.expression import Expression
from spherekit.model.torque_table import TorqueTable
from spherekit.numeric.chebyshev import PiecewiseChebyshev
from spherekit.numeric.local import LocalPolynomials

RowMagnitude = Callable[[Sequence[float]], float]


@final
class ScalarFunctions:
    """Functions of one group of a stored model, in the order of `names`."""

    def __init__(
        self,
        heading: ModelMetadata,
        groups: Sequence[PiecewiseChebyshev],
        names: Sequence[str],
    ) -> None:
        self.heading = heading
        places = [heading.place(name) for name in names]
        number, columns = places[0][0], [column for _, column in places]
        size = np.array([heading.groups[number][column].largest for column in columns])
        self._polynomials = LocalPolynomials.of(groups[number], columns, size)
        self._low, self._high = heading.low, heading.high
        self._rises = [
            (k, heading.rise[column])
            for k, column in enumerate(columns)
            if number == 0 and column < len(heading.rise)
        ]

    def at(self, x: float) -> list[float]:
        """Return the functions at one place."""
        if self._low <= x < self._high:
            return self._polynomials.at(x)
        within, laps = self.heading.within(x)
        row = self._polynomials.at(within)
        for k, rise in self._rises:
            row[k] += laps * rise
        return row


@final
class ScalarEvaluation:
    """Inertia and generalised force of a stored model, one state at a time."""

    def __init__(
        self, heading: ModelMetadata, groups: Sequence[PiecewiseChebyshev]
    ) -> None:
        names = ["B", heading.derivative("B")]

        def column(name: str) -> int:
            if name not in names:
                names.append(name)
            return names.index(name)

        magnitudes = heading.magnitudes
        works_on = [column(name) for name in heading.works_on]
        stands_for = heading.read()
        used = {
            name for law in magnitudes if isinstance(law, Expression) for name in law.names
        }
        read: dict[str, int] = {}
        rates = []
        for name in sorted(used - {"t"}):
            function, is_rate = stands_for[name]
            if is_rate:
                rates.append((name, column(function)))
            else:
                read[name] = column(function)
        self._functions = ScalarFunctions(heading, groups, names)
        self._rates = tuple(place for _, place in rates)
        for k, (name, _) in enumerate(rates):
            read[name] = len(names) + 1 + k
        read["t"] = len(names)
        self._parts = tuple(
            (_of_row(law, read), place)
            for law, place in zip(magnitudes, works_on, strict=True)
        )

    def at(self, x: float) -> list[float]:
        """Return B (kg m2) and dB/dx at one place, and what `force` needs after them."""
        return self._functions.at(x)

    def force(self, row: list[float], dx: float, t: float) -> float:
        """Return the generalised force Q (N m) of all loads; `row` is from `at`."""
        row.append(t)
        for place in self._rates:
            row.append(row[place] * dx)
        force = 0.0
        for magnitude, place in self._parts:
            force += magnitude(row) * row[place]
        return force


def _of_row(law: Expression | TorqueTable, read: dict[str, int]) -> RowMagnitude:
    if isinstance(law, Expression):
        return law.scalar(read)
    time, one = read["t"], law.one
    return lambda row: one(row[time])
