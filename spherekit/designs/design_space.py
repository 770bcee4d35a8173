"""Sets of designs: grids, lists, and sets that fill a space evenly."""

import math
import re
import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.errors import DesignError, ModelError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.load_expression import Expression, parse
from spherekit.wording import choices

Scheme = Literal["grid", "sobol", "latin", "random"]


SCHEMES: tuple[Scheme, ...] = ("grid", "sobol", "latin", "random")
"""How the designs of a space are chosen.

They are all combinations of listed values, a scrambled Sobol sequence, a Latin hypercube,
or independent random numbers of uniform distribution.
"""


MOST_DESIGNS = 2**30
"""Largest number of designs. The Sobol sequence of SciPy has no more points."""


Values = Sequence[float] | tuple[float, float, int] | tuple[float, float]


@dataclass(frozen=True)
class Variation:
    """The values of one design variable, in the unit of the file.

    `key` is its key in the file. If `values` is None, all numbers from `low` to `high` are
    possible. Otherwise only `values` are, and `low` and `high` are their extremes.
    """

    key: str
    low: float
    high: float
    values: tuple[float, ...] | None = None


def variation(key: str, given: str | Sequence[float]) -> Variation:
    """Create a variation from numbers or from a text.

    Parameters
    ----------
    key
        Key of the number in the mechanism file.
    given
        A list of values; or one of the texts ``"10:40:31"`` (31 values from 10 to 40),
        ``"10:40"`` (all numbers from 10 to 40) and ``"10,20,25"`` (three values).

    Raises
    ------
    DesignError
        If the text has another form, or there is no value or one that is not finite.
    """
    try:
        if isinstance(given, str) and ":" in given:
            low, high, *count = given.split(":")
            if not count:
                return between(key, float(low), float(high))
            (number,) = count
            values = np.linspace(float(low), float(high), int(number)).tolist()
        else:
            values = [*map(float, given.split(",") if isinstance(given, str) else given)]
    except ValueError:
        raise DesignError(
            f"{key}={given}: write LOW:HIGH:COUNT, such as 10:40:31, a list such as "
            "10,20,25, or LOW:HIGH for --designs"
        ) from None
    if not values or not all_finite(values):
        raise DesignError(f"{key}: give at least one value, and finite ones")
    return Variation(key, min(values), max(values), tuple(values))


def between(key: str, low: float, high: float) -> Variation:
    """Create a variation over all numbers from `low` to `high`.

    Raises
    ------
    DesignError
        If `low` is not less than `high`, or one of them is not finite.
    """
    if not -math.inf < low < high < math.inf:
        raise DesignError(
            f"{key}: {low:g} to {high:g} is no range; give the lower end first"
        )
    return Variation(key, low, high)


@dataclass(frozen=True)
class DesignSpace:
    """A numbered set of designs, which is the same in every process and at every call.

    Attributes
    ----------
    variations
        The values of each design variable.
    scheme
        How the designs are chosen, see `SCHEMES`.
    count
        Number of designs. They are numbered from 0.
    seed
        Seed of the random numbers of all schemes but ``"grid"``.
    """

    variations: tuple[Variation, ...]
    scheme: Scheme
    count: int
    seed: int

    @staticmethod
    def of(
        variations: Sequence[Variation],
        designs: int | None = None,
        scheme: Scheme | None = None,
        seed: int = 0,
    ) -> "DesignSpace":
        """Create a design space.

        Parameters
        ----------
        variations
            The values of each design variable.
        designs
            Number of designs. It is not given for a grid, which has all combinations.
        scheme
            One of `SCHEMES`; by default ``"grid"``, or ``"sobol"`` if `designs` is given.
        seed
            Seed of the random numbers, at least 0. A grid has none.

        Raises
        ------
        DesignError
            If there is no variation, a range without a count is in a grid, the number of
            designs is missing, exceeds `MOST_DESIGNS` or is given for a grid, the scheme is
            unknown, or the seed is negative or is given for a grid.
        """
        if not variations:
            raise DesignError("nothing is varied: give --vary KEY=LOW:HIGH:COUNT")
        chosen = scheme or ("grid" if designs is None else "sobol")
        if chosen not in SCHEMES:
            raise DesignError(
                f'scheme "{chosen}" is not known{choices(chosen, SCHEMES, "allowed")}'
            )
        if chosen == "grid":
            if designs is not None:
                raise DesignError(
                    "a grid has as many designs as combinations: leave out "
                    "the number of designs, or take sobol, latin or random"
                )
            for varied in variations:
                if varied.values is None:
                    raise DesignError(
                        f"{varied.key}: a grid needs how many values, "
                        f"{varied.key}={varied.low:g}:{varied.high:g}:11; "
                        "or give --designs N"
                    )
            designs = math.prod(len(item.values or ()) for item in variations)
            if seed != 0:
                raise DesignError(
                    f"seed: found {seed}; a grid has no random numbers, so a seed does "
                    "nothing there: leave it out, or give how many designs"
                )
        if designs is None or designs < 1:
            raise DesignError(f"{chosen}: give how many designs, at least 1")
        if designs > MOST_DESIGNS:
            raise DesignError(
                f"{chosen}: found {designs} designs; at most {MOST_DESIGNS} are possible"
            )
        if seed < 0:
            raise DesignError(f"seed: found {seed}; a seed is a whole number from 0 on")
        return DesignSpace(tuple(variations), chosen, designs, seed)

    def designs(self, start: int, stop: int) -> Floats:
        """Return the designs with the numbers `start` to `stop` - 1.

        Returns
        -------
        (variables, n) values of the variables, in the unit of the file. Numbers from
        `count` on are left out.
        """
        made = []
        unit = self._unit(start, min(stop, self.count))
        for varied, fraction in zip(self.variations, unit, strict=True):
            if varied.values is None:
                made.append(varied.low + (varied.high - varied.low) * fraction)
            else:
                values = np.array(varied.values)
                place = (fraction * len(values)).astype(int)
                made.append(values[np.minimum(place, len(values) - 1)])
        return np.stack(made)

    def _unit(self, start: int, stop: int) -> Floats:
        """Return the designs `start` to `stop` - 1 as points of the unit cube.

        Returns
        -------
        (variables, n) numbers from 0 to 1, which are the relative position in the range of
        each variable. Listed values share the interval from 0 to 1 evenly.
        """
        size = len(self.variations)
        if self.scheme == "grid":
            shape = [len(varied.values or ()) for varied in self.variations]
            places = np.unravel_index(np.arange(start, stop), shape)
            return (np.array(places) + 0.5) / np.reshape(shape, (-1, 1))
        from scipy.stats import qmc

        if self.scheme == "sobol":
            sobol = qmc.Sobol(size, scramble=True, rng=self.seed)
            if start:
                sobol.fast_forward(start)
            with warnings.catch_warnings():
                # SciPy warns if the number of points is not a power of 2, because the
                # points are then less evenly spread. This cannot be avoided for parts.
                warnings.simplefilter("ignore", UserWarning)
                made = sobol.random(stop - start)
        elif self.scheme == "latin":
            made = qmc.LatinHypercube(size, rng=self.seed).random(self.count)[start:stop]
        else:
            bits = np.random.PCG64(self.seed).advance(start * size)
            made = np.random.Generator(bits).random((stop - start, size))
        return np.transpose(made)


Columns = dict[str, Any]
"""The columns (rows,) of a table, by name."""


_COMPARISON_SIGN = re.compile(r"(<=|>=|<|>)")


@dataclass(frozen=True)
class Condition:
    """A condition ``less < more``, or ``less <= more`` if `equal`, on two expressions.

    It is not met where a value is NaN. `text` is the condition as the user wrote it.
    """

    text: str
    less: Expression
    more: Expression
    equal: bool

    @property
    def names(self) -> frozenset[str]:
        """Names of the columns on which the condition depends."""
        return self.less.names | self.more.names

    def sides(self, columns: Columns) -> tuple[Floats, Floats]:
        """Return the values (n,) of `less` and of `more` for columns (n,) by name."""
        less, more = (
            side.evaluate({name: columns[name] for name in side.names})
            for side in (self.less, self.more)
        )
        return less, more

    def holds(self, columns: Columns) -> Bools:
        """Return which rows (n,) meet the condition, for columns (n,) by name."""
        with np.errstate(invalid="ignore"):
            return (np.less_equal if self.equal else np.less)(*self.sides(columns))


def condition(text: str, names: Collection[str]) -> Condition:
    """Parse a condition such as ``"links_2_arc < links_4_arc"``.

    Parameters
    ----------
    text
        The condition: two expressions with ``<``, ``<=``, ``>`` or ``>=`` between them.
    names
        Names that the expressions may contain.

    Raises
    ------
    DesignError
        If the text is not one comparison, or contains another name.
    """
    parts = _COMPARISON_SIGN.split(text)
    if len(parts) != 3:
        raise DesignError(
            f'"{text}" is no condition: write one comparison, such as '
            "links_2_arc < links_4_arc; give several one by one"
        )
    left, sign, right = parts
    try:
        sides = parse(left, names), parse(right, names)
    except ModelError as problem:
        raise DesignError(f'"{text}": {problem}') from None
    less, more = sides if sign[0] == "<" else sides[::-1]
    return Condition(text, less, more, sign[1:] == "=")
