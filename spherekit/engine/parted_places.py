"""Places of rates of which no two share a column, for rows that are given otherwise."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.columns import Place, PolePlaces, RatePlaces
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class PartedPlaces:
    """The places of all rates in columns of their own, and of the closure.

    `column` (k,) says which of the columns that are shared each is a copy of, `moves` (k,)
    where it is one, `numbers` (k,) what it is throughout otherwise.
    """

    rates: tuple[RatePlaces, ...]
    closure: int
    column: NDArray[np.intp]
    moves: NDArray[np.bool_]
    numbers: Floats

    @classmethod
    def of(cls, rates: Sequence[RatePlaces], closure: int) -> "PartedPlaces":
        """Return those of rates by input, and of the closure, that may be shared."""
        columns: list[int] = []
        numbers: list[float] = []

        def parted(place: Place) -> Place:
            first, count = len(columns), place.count
            fixed = bool(place.numbers)
            columns.extend([-1] * count if fixed else place.first + np.arange(count))
            numbers.extend(place.numbers or [0.0] * count)
            return Place(first, count)

        def of_pole(places: PolePlaces) -> PolePlaces:
            axis = None
            if places.axis is not None:
                unit, turn, rate, change = (parted(place) for place in places.axis)
                axis = unit, turn, rate, change
            one, other, last = (parted(place) for place in places.errors)
            return PolePlaces(axis, parted(places.angle), (one, other, last))

        made = tuple(
            RatePlaces(
                places.signed,
                parted(Place(places.block, 8 * len(places.signed))).first,
                {pole: of_pole(part) for pole, part in places.poles.items()},
                {link: parted(place) for link, place in places.w.items()},
                {link: parted(place) for link, place in places.dw.items()},
            )
            for places in rates
        )
        first = parted(Place(closure, 2)).first
        column = np.array(columns, dtype=np.intp)
        return cls(made, first, column, column >= 0, np.array(numbers, dtype=float))

    def fill(self, columns: Floats, out: Floats) -> None:
        """Write the columns (k, n) from those that are shared."""
        np.take(columns, self.column, axis=0, out=out, mode="clip")
        out[~self.moves] = self.numbers[~self.moves, None]
