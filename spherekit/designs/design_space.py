"""Design spaces: numbered sets of designs, on a grid or spread over ranges."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import DesignError
from spherekit.geometry.vectors import all_finite
from spherekit.quantity import ANGLE, AngleUnit, QuantityError, read_quantity, split_unit
from spherekit.wording import choices

Scheme = Literal["grid", "sobol", "latin", "random"]
"""How the designs of a space are chosen, see `SCHEMES`."""

SCHEMES: tuple[Scheme, ...] = ("grid", "sobol", "latin", "random")
"""The schemes: how the designs of a space are chosen.

The designs are all combinations of listed values, a scrambled Sobol sequence, a Latin
hypercube, or independent random numbers of uniform distribution.
"""

MAX_DESIGNS = 2**30
"""Largest number of designs. The Sobol sequence of SciPy has no more points."""


@dataclass(frozen=True)
class Variation:
    """The possible values of one design variable, in the unit of the file.

    A design variable is a number of a mechanism file that differs from design to design.

    Attributes
    ----------
    key
        Key of the number in the mechanism file. An example is ``"links.2.arc"``.
    low, high
        Smallest and largest value.
    values
        The possible values; None if all numbers from `low` to `high` are possible.
    has_angle_unit
        Whether the user wrote a unit of angles, so that the number must be an angle.
        Variations that differ only in this attribute are equal.
    """

    key: str
    low: float
    high: float
    values: tuple[float, ...] | None = None
    has_angle_unit: bool = field(default=False, compare=False)


def parse_variation(
    key: str, values: str | Sequence[float], angle_unit: AngleUnit
) -> Variation:
    """Read the possible values of a number of a mechanism file that is varied.

    Parameters
    ----------
    key
        Key of the number in the mechanism file.
    values
        A list of values, or one of the texts ``"10:40:31"`` (31 values from 10 to 40),
        ``"10:40"`` (any number from 10 to 40) and ``"10,20,25"`` (three values). Angles in
        a text may have a unit, as in ``"10deg:40deg:31"``.
    angle_unit
        Unit of angles in the mechanism file. The variation has its numbers in this unit.

    Returns
    -------
    The variation, with listed values or a continuous range.

    Raises
    ------
    DesignError
        If the text has another form, if there is no value or more than `MAX_DESIGNS`, if a
        value is not finite, or if ``LOW:HIGH`` is no range (see `range_variation`).
    """
    has_angle_unit = False

    def read_number(text: str) -> float:
        """Return a number in the unit of the file; an angle may have another unit."""
        nonlocal has_angle_unit
        if not split_unit(text)[1]:
            return float(text)
        has_angle_unit = True
        return read_quantity(text, ANGLE, angle_unit, target=angle_unit)

    try:
        if isinstance(values, str) and ":" in values:
            low_text, high_text, *count = values.split(":")
            low = read_number(low_text)
            high = read_number(high_text)
            if not count:
                return range_variation(key, low, high, has_angle_unit)
            (count_text,) = count
            value_count = int(count_text)
            if value_count > MAX_DESIGNS:
                raise DesignError(
                    f"{key}: found {value_count} values; at most {MAX_DESIGNS} are possible"
                )
            numbers = np.linspace(low, high, value_count).tolist()
        elif isinstance(values, str):
            numbers = [read_number(number) for number in values.split(",")]
        else:
            numbers = [float(number) for number in values]
    except (ValueError, OverflowError) as problem:
        why = f"{problem}. Write" if isinstance(problem, QuantityError) else "write"
        raise DesignError(
            f"{key}={values}: {why} LOW:HIGH:COUNT, such as 10:40:31, a list such as "
            "10,20,25, or LOW:HIGH for --designs"
        ) from None
    if not numbers or not all_finite(numbers):
        raise DesignError(
            f"{key}: has no value, or one that is not finite; give at least "
            "one value, and only finite ones"
        )
    return Variation(key, min(numbers), max(numbers), tuple(numbers), has_angle_unit)


def range_variation(
    key: str, low: float, high: float, has_angle_unit: bool = False
) -> Variation:
    """Return a number of the mechanism file that varies over all values of a range.

    `has_angle_unit` says whether the user wrote the range with a unit of angles. The number
    of the file must then be an angle.

    Raises
    ------
    DesignError
        If `low` is not less than `high`, or one of them or their difference is not finite.
    """
    if not math.isfinite(high - low):
        raise DesignError(
            f"{key}: {low:g} to {high:g} is not a finite range; give two finite numbers"
        )
    if not low < high:
        raise DesignError(
            f"{key}: {low:g} to {high:g} is not a range; give the lower end first"
        )
    return Variation(key, low, high, has_angle_unit=has_angle_unit)


@dataclass(frozen=True)
class DesignSpace:
    """A numbered set of designs (choices of sizes), the same in every process.

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
    def from_variations(
        variations: Sequence[Variation],
        count: int | None = None,
        scheme: Scheme | None = None,
        seed: int = 0,
    ) -> "DesignSpace":
        """Create a design space.

        Parameters
        ----------
        variations
            The values of each design variable.
        count
            Number of designs; not given for a grid, which has all combinations.
        scheme
            One of `SCHEMES`; by default ``"grid"``, or ``"sobol"`` if `count` is given.
        seed
            Seed of the random numbers, at least 0. A grid has none.

        Raises
        ------
        DesignError
            If there is no variation, if a grid contains a range without a count, or if the
            scheme is unknown. Also if `count` is missing, below 1 or above `MAX_DESIGNS`,
            if `seed` is negative, or if a grid has a `count` or `seed`.
        """
        if not variations:
            raise DesignError("nothing is varied: give --vary KEY=LOW:HIGH:COUNT")
        if scheme is None:
            scheme = "grid" if count is None else "sobol"
        if scheme not in SCHEMES:
            raise DesignError(
                f'scheme: found "{scheme}"{choices(scheme, SCHEMES, "Allowed")}'
            )
        if scheme == "grid":
            if count is not None:
                raise DesignError(
                    "the number of designs of a grid follows from its values; leave the "
                    "number of designs out, or choose sobol, latin or random"
                )
            for variation in variations:
                if variation.values is None:
                    raise DesignError(
                        f"{variation.key}: a grid needs the number of values too, such as "
                        f"{variation.key}={variation.low:g}:{variation.high:g}:11; "
                        "or give --designs N"
                    )
            count = math.prod(len(variation.values or ()) for variation in variations)
            if seed != 0:
                raise DesignError(
                    f"seed: found {seed}; a grid has no random numbers, so a seed has no "
                    "effect. Leave it out, or choose sobol, latin or random with a number "
                    "of designs"
                )
        if count is None or count < 1:
            raise DesignError(
                f"{scheme}: the number of designs is missing or below 1; "
                "give at least 1 (--designs N)"
            )
        if count > MAX_DESIGNS:
            raise DesignError(
                f"{scheme}: found {count} designs; at most {MAX_DESIGNS} are possible"
            )
        if seed < 0:
            raise DesignError(f"seed: found {seed}; a seed is a whole number of at least 0")
        return DesignSpace(tuple(variations), scheme, count, seed)

    def compute_designs(self, start: int, stop: int) -> Floats:
        """Return the values of the variables of the designs `start` to `stop` - 1.

        Each design (choice of sizes) has a fixed number, so that parts of a sweep can be
        computed separately.

        Returns
        -------
        (variables, n) values of the variables, in the unit of the file. Numbers of designs
        from `count` on do not exist and are left out.
        """
        values = []
        # (variables, n) numbers from 0 to 1: the relative position in each range.
        stop = max(start, min(stop, self.count))
        unit_points = self._compute_unit_points(start, stop)
        for variation, fractions in zip(self.variations, unit_points, strict=True):
            if variation.values is None:
                # All numbers of the range are possible.
                width = variation.high - variation.low
                values.append(variation.low + width * fractions)
            else:
                # Only listed values are possible: each has an equal part of 0 to 1.
                listed_values = np.array(variation.values)
                index = (fractions * len(listed_values)).astype(int)
                index = np.minimum(index, len(listed_values) - 1)
                values.append(listed_values[index])
        return np.stack(values)

    def _compute_unit_points(self, start: int, stop: int) -> Floats:
        """Return designs as points of the unit cube: the relative position in each range.

        A design is one choice of the variables. Every design has a fixed number, so that
        parts of the space can be computed separately. Only the designs `start` to `stop` -
        1 are computed.

        Returns
        -------
        (variables, n) numbers from 0 to 1, which are the relative position in the range of
        each variable. If a variable has listed values, each value has an equal part of the
        interval from 0 to 1.
        """
        variable_count = len(self.variations)
        if self.scheme == "grid":
            # All combinations of listed values. Each value has an equal interval, and the
            # point is in its middle.
            shape = [len(variation.values or ()) for variation in self.variations]
            points = np.empty((variable_count, stop - start))
            # The index of the last variable changes fastest. `np.unravel_index` gives the
            # same indices, but for at most 64 variables.
            quotients = np.arange(start, stop)
            for k in reversed(range(variable_count)):
                quotients, indices = np.divmod(quotients, shape[k])
                points[k] = (indices + 0.5) / shape[k]
            return points
        from scipy.stats import qmc

        if self.scheme == "sobol":
            sobol = qmc.Sobol(variable_count, scramble=True, rng=self.seed)
            if start:
                sobol.fast_forward(start)
            with warnings.catch_warnings():
                # SciPy warns that points are less evenly spread if their number is not a
                # power of 2. The points here are one part of all, and can have any number.
                warnings.simplefilter("ignore", UserWarning)
                points = sobol.random(stop - start).T
        elif self.scheme == "latin":
            # A Latin hypercube can be computed only as a whole.
            hypercube = qmc.LatinHypercube(variable_count, rng=self.seed)
            points = hypercube.random(self.count)[start:stop].T
        else:
            # Random points. The generator skips the numbers of the designs before `start`.
            bits = np.random.PCG64(self.seed).advance(start * variable_count)
            points = np.random.Generator(bits).random((stop - start, variable_count)).T
        return points
