"""Torques that are constant or follow a pair's variable and rate in proportion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.model.expression import ON_ARRAYS, Expression, fold


@final
@dataclass(frozen=True)
class Affine:
    """A magnitude: a constant, and factors of names that it is proportional to."""

    constant: float
    factors: Mapping[str, float]

    def times(self, factor: float) -> "Affine":
        """Return it by a factor."""
        return Affine(
            self.constant * factor, {k: x * factor for k, x in self.factors.items()}
        )

    def plus(self, other: "Affine") -> "Affine":
        """Return the sum of both."""
        both = dict(self.factors)
        for name, factor in other.factors.items():
            both[name] = both.get(name, 0.0) + factor
        return Affine(self.constant + other.constant, both)


def affine(expression: Expression) -> Affine | None:
    """Return an expression as a constant and factors; None where it is no such sum."""
    return fold(
        expression.root,
        lambda value: Affine(value, {}),
        lambda name: Affine(0.0, {name: 1.0}),
        _applied,
    )


def _applied(function: str, parts: list[Affine | None]) -> Affine | None:
    terms = [part for part in parts if part is not None]
    if len(terms) < len(parts):
        return None
    if not any(part.factors for part in terms):
        with np.errstate(all="ignore"):
            value = float(ON_ARRAYS[function](*(np.float64(p.constant) for p in terms)))
        return Affine(value, {}) if np.isfinite(value) else None
    if function == "negative":
        return terms[0].times(-1.0)
    if function in ("+", "-"):
        return terms[0].plus(terms[1].times(1.0 if function == "+" else -1.0))
    if function == "*":
        for part, factor in (terms, terms[::-1]):
            if not factor.factors:
                return part.times(factor.constant)
    if function == "/" and not terms[1].factors and terms[1].constant:
        return terms[0].times(1.0 / terms[1].constant)
    return None
