"""Which designs there are: grids, lists, and sets that fill a space evenly."""

import math
import re
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import listing, nearest
from spherekit.errors import DesignError, ModelError
from spherekit.model.expression import Expression, parse
from spherekit.sphere.rotation import Floats

Scheme = Literal["grid", "sobol", "latin", "random"]

SCHEMES: tuple[Scheme, ...] = ("grid", "sobol", "latin", "random")
"""All combinations; a scrambled Sobol sequence; Latin hypercube; independent, uniform."""

Values = Sequence[float] | tuple[float, float, int] | tuple[float, float]


@final
@dataclass(frozen=True)
class Variation:
    """What a variable takes on: listed `values`, or all from `low` to `high`."""

    key: str
    low: float
    high: float
    values: tuple[float, ...] | None = None


def variation(key: str, text: str) -> Variation:
    """Return the variation of ``10:40:31``, ``10:40`` or ``10,20,25``.

    Raises
    ------
    DesignError
        If it is none of these.
    """
    try:
        if ":" in text:
            low, high, *count = text.split(":")
            ends = float(low), float(high)
            if not count:
                return between(key, *ends)
            (number,) = count
            return listed(key, np.linspace(*ends, int(number)).tolist())
        return listed(key, [float(part) for part in text.split(",")])
    except ValueError:
        raise DesignError(
            f"{key}={text}: write LOW:HIGH:COUNT, such as 10:40:31, a list such as "
            "10,20,25, or LOW:HIGH for --designs"
        ) from None


def between(key: str, low: float, high: float) -> Variation:
    """Return a variation over a range."""
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise DesignError(
            f"{key}: {low:g} to {high:g} is no range; give the lower end first"
        )
    return Variation(key, low, high)


def listed(key: str, values: Sequence[float]) -> Variation:
    """Return a variation over a list."""
    if not values or not np.all(np.isfinite(values)):
        raise DesignError(f"{key}: give at least one value, and finite ones")
    return Variation(key, min(values), max(values), tuple(values))


@final
@dataclass(frozen=True)
class DesignSpace:
    """Designs by number, the same whenever and wherever they are asked for."""

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
        """Return the space of variations: their grid, or so many designs by a scheme.

        Raises
        ------
        DesignError
            If ranges have no count for a grid, or nothing is varied.
        """
        if not variations:
            raise DesignError("nothing is varied: give --vary KEY=LOW:HIGH:COUNT")
        chosen = scheme or ("grid" if designs is None else "sobol")
        if chosen not in SCHEMES:
            hint = nearest(chosen, SCHEMES) or ";"
            raise DesignError(f'scheme "{chosen}" is not known{hint} {listing(SCHEMES)}')
        if chosen == "grid":
            if designs is not None:
                raise DesignError(
                    "a grid has as many designs as combinations: leave out "
                    "the number of designs, or take sobol, latin or random"
                )
            counts = [len(item.values) if item.values else 0 for item in variations]
            for varied in variations:
                if varied.values is None:
                    raise DesignError(
                        f"{varied.key}: a grid needs how many values, "
                        f"{varied.key}={varied.low:g}:{varied.high:g}:11; "
                        "or give --designs N"
                    )
            return DesignSpace(tuple(variations), chosen, math.prod(counts), seed)
        if designs is None or designs < 1:
            raise DesignError(f"{chosen}: give how many designs, at least 1")
        return DesignSpace(tuple(variations), chosen, designs, seed)

    def designs(self, start: int, stop: int) -> Floats:
        """Return the designs from one number to before another, (variables, n)."""
        if self.scheme == "grid":
            values = [np.array(varied.values) for varied in self.variations]
            numbers = np.arange(start, min(stop, self.count))
            places = np.unravel_index(numbers, [len(axis) for axis in values])
            return np.stack([axis[k] for axis, k in zip(values, places, strict=True)])
        return self._scaled(self._unit(start, min(stop, self.count)))

    def _scaled(self, unit: Floats) -> Floats:
        rows = []
        for varied, share in zip(self.variations, unit, strict=True):
            if varied.values is None:
                rows.append(varied.low + (varied.high - varied.low) * share)
            else:
                values = np.array(varied.values)
                place = (share * len(values)).astype(int)
                rows.append(values[np.minimum(place, len(values) - 1)])
        return np.stack(rows)

    def _unit(self, start: int, stop: int) -> Floats:
        """Return points of the unit cube (variables, n)."""
        from scipy.stats import qmc

        size = len(self.variations)
        if self.scheme == "sobol":
            sobol = qmc.Sobol(size, scramble=True, rng=self.seed)
            if start:
                sobol.fast_forward(start)
            with warnings.catch_warnings():
                # A number that is no power of 2 costs balance only, which parts have not.
                warnings.simplefilter("ignore", UserWarning)
                return np.asarray(sobol.random(stop - start).T)
        if self.scheme == "latin":
            whole = qmc.LatinHypercube(size, rng=self.seed).random(self.count)
            return np.asarray(whole[start:stop].T)
        generator = np.random.Generator(np.random.PCG64(self.seed).advance(start * size))
        return np.asarray(generator.random((stop - start, size)).T)


_COMPARED = re.compile(r"(<=|>=|<|>)")

_HOLDS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}


@final
@dataclass(frozen=True)
class Condition:
    """``left < right`` of two expressions; where a value is NaN it does not hold."""

    text: str
    left: Expression
    sign: str
    right: Expression

    @property
    def names(self) -> frozenset[str]:
        """What it depends on."""
        return self.left.names | self.right.names

    def _sides(self, columns: Mapping[str, Any]) -> Iterator[Any]:
        for side in (self.left, self.right):
            yield side.evaluate({name: columns[name] for name in side.names})

    def holds(self, columns: Mapping[str, Any]) -> NDArray[np.bool_]:
        """Return for which rows it holds, from columns (n,) by name."""
        with np.errstate(invalid="ignore"):
            return np.asarray(_HOLDS[self.sign](*self._sides(columns)))

    def slack(self, columns: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return by how much it holds (n,): negative where it does not."""
        left, right = self._sides(columns)
        return np.asarray(right - left if self.sign.startswith("<") else left - right)


def condition(text: str, names: Collection[str]) -> Condition:
    """Return the condition that a text states.

    Raises
    ------
    DesignError
        If it is no comparison, or of other names.
    """
    parts = _COMPARED.split(text)
    if len(parts) != 3:
        raise DesignError(
            f'"{text}" is no condition: write one comparison, such as '
            "links_2_arc < links_4_arc; give several one by one"
        )
    left, sign, right = parts
    try:
        return Condition(text, parse(left, names), sign, parse(right, names))
    except ModelError as problem:
        raise DesignError(f'"{text}": {problem}') from None
