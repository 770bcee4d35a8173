"""The cases of the extremes: what one is, what it returns, and how it is judged."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.tolerances import EPS

ROUNDOFF = EPS / 2
"""Unit roundoff of float64."""
ALLOWED = 100.0
"""Errors may be so many times unit roundoff times conditioning."""
TRUSTED = 1e12
"""Beyond this conditioning no number may be further off than at it without a status."""
QUICK = 3
"""Parameters of a case in a quick run, unless it names them."""


@final
@dataclass(frozen=True)
class Row:
    """One quantity at one parameter.

    `conditioning` is the largest change of the quantity for changes of the data by one
    unit, `error` the deviation from higher precision in the same measure. `status` is
    what spherekit says of it, "OK" where the number is given without reserve.
    """

    parameter: float
    quantity: str
    conditioning: float
    error: float
    status: str = "OK"

    @property
    def ratio(self) -> float:
        """Return the error over unit roundoff times conditioning."""
        return self.error / (ROUNDOFF * self.conditioning)

    @property
    def given(self) -> bool:
        """Whether the number stands without a reserve."""
        return self.status == "OK"

    @property
    def trusted(self) -> bool:
        """Whether a number is given, and conditioning asks that it is right."""
        return self.given and self.conditioning <= TRUSTED

    @property
    def wrong(self) -> bool:
        """Whether a number stands without a reserve and is further off than allowed."""
        limit = ALLOWED * ROUNDOFF * min(self.conditioning, TRUSTED)
        return self.given and not self.error <= limit


Sweep = Callable[[Sequence[float]], Iterable[Row]]


@final
@dataclass(frozen=True)
class Case:
    """A sweep of one parameter.

    `held` says whether its numbers are held to what is allowed, or whether a formula is
    measured for where it breaks down.
    """

    name: str
    family: str
    parameter: str
    values: tuple[float, ...]
    few: tuple[float, ...]
    sweep: Sweep
    held: bool = True

    @property
    def text(self) -> str:
        """What the case is, the first paragraph of its docstring."""
        paragraph = (self.sweep.__doc__ or "").split("\n\n")[0]
        return " ".join(paragraph.split())

    def rows(self, quick: bool = False) -> list[Row]:
        """Return the rows of all parameters, or of a few of them."""
        return list(self.sweep(self.few if quick else self.values))


CASES: dict[str, Case] = {}


def case(
    family: str,
    parameter: str,
    values: Sequence[float],
    few: Sequence[float] = (),
    held: bool = True,
) -> Callable[[Sweep], Sweep]:
    """Register a function from values of a parameter to rows as a case of a family.

    `few` are the values of a quick run, by default some of `values` spread evenly.
    """
    if not few:
        count = min(QUICK, len(values))
        chosen = np.linspace(0, len(values) - 1, count).round().astype(int)
        few = [values[k] for k in chosen]

    def register(sweep: Sweep) -> Sweep:
        name = sweep.__name__
        assert name not in CASES, name
        given = tuple(values), tuple(few)
        CASES[name] = Case(name, family, parameter, *given, sweep, held)
        return sweep

    return register


def down(first: float, last: float, by: float = 10.0) -> tuple[float, ...]:
    """Return values from `first` to `last`, each the one before over `by`."""
    count = round(np.log(first / last) / np.log(by))
    return tuple(float(f"{first / by**k:.3g}") for k in range(count + 1))
