"""The cases of the extremes: their rows, how rows are judged, and a list of all cases."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.tolerances import EPS

ROUNDOFF = EPS / 2
"""Unit roundoff of float64."""

ALLOWED = 100.0
"""Largest allowed error, as a multiple of the unit roundoff times the conditioning."""

TRUSTED = 1e12
"""Largest conditioning for which numbers must be right within the allowed error.

A number whose conditioning is larger, and which is given without a warning status, may
deviate by at most the error that is allowed at this conditioning.
"""

QUICK_VALUE_COUNT = 3
"""Number of values of the parameter in a quick run, unless the case states the values."""

NO_RESERVE = "OK"
"""Status of a number that spherekit returns without a warning."""


@final
@dataclass(frozen=True)
class Row:
    """The error of one quantity at one value of the parameter.

    Attributes
    ----------
    parameter
        Value of the parameter.
    quantity
        Name of the quantity.
    conditioning
        Largest change of the quantity for changes of the data by one unit.
    error
        Deviation from a computation of higher precision, in the same measure.
    status
        What spherekit says about the number, `NO_RESERVE` or another status.
    """

    parameter: float
    quantity: str
    conditioning: float
    error: float
    status: str = NO_RESERVE

    @property
    def ratio(self) -> float:
        """The error over unit roundoff times conditioning."""
        return self.error / (ROUNDOFF * self.conditioning)

    @property
    def given(self) -> bool:
        """Whether the number is given without reserve."""
        return self.status == NO_RESERVE

    @property
    def trusted(self) -> bool:
        """Whether the number is given, and its conditioning requires that it is right."""
        return self.given and self.conditioning <= TRUSTED

    @property
    def wrong(self) -> bool:
        """Whether the number is given and deviates by more than is allowed, or is NaN."""
        limit = ALLOWED * ROUNDOFF * min(self.conditioning, TRUSTED)
        return self.given and not self.error <= limit


Sweep = Callable[[Sequence[float]], Iterable[Row]]
"""A function that returns the rows of some values of a parameter."""


@final
@dataclass(frozen=True)
class Case:
    """A sweep of one parameter to where numbers are no longer trustworthy.

    Attributes
    ----------
    name
        Name of the case.
    family
        Name of the family of similar cases.
    parameter
        What the parameter is, with its unit.
    values
        Its values.
    few
        The values of a quick run.
    sweep
        Computes the rows. The first paragraph of its docstring describes the case.
    held
        Whether the errors must be within what is allowed. Otherwise the case shows where a
        formula fails.
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
        """The description of the case."""
        paragraph = (self.sweep.__doc__ or "").split("\n\n")[0]
        return " ".join(paragraph.split())

    def rows(self, quick: bool = False) -> list[Row]:
        """Return the rows of all values, or of those of a quick run."""
        return list(self.sweep(self.few if quick else self.values))


CASES: dict[str, Case] = {}
"""All cases by name, in the order in which their modules were imported."""


def case(
    family: str,
    parameter: str,
    values: Sequence[float],
    few: Sequence[float] = (),
    held: bool = True,
) -> Callable[[Sweep], Sweep]:
    """Return a decorator that registers a function as a case.

    The name of the function is that of the case.

    Parameters
    ----------
    family
        Name of the family.
    parameter
        What the parameter is, with its unit.
    values
        Its values.
    few
        The values of a quick run, by default some of `values` that are spread evenly.
    held
        Whether the errors must be within what is allowed.
    """
    if not few:
        count = min(QUICK_VALUE_COUNT, len(values))
        indices = np.linspace(0, len(values) - 1, count).round().astype(int)
        few = [values[k] for k in indices]

    def register(sweep: Sweep) -> Sweep:
        name = sweep.__name__
        assert name not in CASES, name
        CASES[name] = Case(name, family, parameter, tuple(values), tuple(few), sweep, held)
        return sweep

    return register


def down(first: float, last: float, by: float = 10.0) -> tuple[float, ...]:
    """Return a decreasing geometric sequence, rounded to three digits.

    Parameters
    ----------
    first, last
        First and last value.
    by
        Ratio of each value to the next.
    """
    count = round(np.log(first / last) / np.log(by))
    return tuple(float(f"{first / by**k:.3g}") for k in range(count + 1))
