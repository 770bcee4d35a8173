"""Vectors and matrices whose entries are expressions, and first derivatives with them.

Arrays are NumPy object arrays of numbers and expressions. Terms drop products with 0 and
1 and share what occurs twice, so nothing is simplified here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.terms import Expr
from spherekit.sphere.rotation import Floats

Exprs = NDArray[np.object_]
"""An array of numbers, expressions or jets."""

SNAP = 1e-15
"""A direction cosine this near to 0, 1 or -1 is that number; it is so up to rounding."""


@final
@dataclass(frozen=True)
class Jet:
    """A value and its derivative along the motion; sums and products follow the rules."""

    value: Expr
    rate: Expr = 0.0

    @staticmethod
    def of(item: "Jet | Expr") -> "Jet":
        """Return a number as a constant jet, a jet as it is."""
        return item if isinstance(item, Jet) else Jet(item)

    def __add__(self, other: Any) -> "Jet":
        right = Jet.of(other)
        return Jet(self.value + right.value, self.rate + right.rate)

    __radd__ = __add__

    def __sub__(self, other: Any) -> "Jet":
        right = Jet.of(other)
        return Jet(self.value - right.value, self.rate - right.rate)

    def __rsub__(self, other: Any) -> "Jet":
        return Jet.of(other) - self

    def __neg__(self) -> "Jet":
        return Jet(-1.0 * self.value, -1.0 * self.rate)

    def __mul__(self, other: Any) -> "Jet":
        right = Jet.of(other)
        return Jet(
            self.value * right.value, self.rate * right.value + self.value * right.rate
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Jet":
        right = Jet.of(other)
        quotient = self.value / right.value
        return Jet(quotient, (self.rate - quotient * right.rate) / right.value)


def vector(items: Sequence[Expr]) -> Exprs:
    """Return an array of expressions."""
    made = np.empty(len(items), dtype=object)
    made[:] = items
    return made


def jets(values: Exprs, rates: Exprs) -> Exprs:
    """Return the vector of jets from values and rates."""
    return vector([Jet(one, other) for one, other in zip(values, rates, strict=True)])


def rates_of(items: Exprs) -> Exprs:
    """Return the derivatives of jets."""
    return vector([Jet.of(item).rate for item in items])


def constants(matrix: Floats) -> Exprs:
    """Return numbers as entries, those within rounding of 0, 1, -1 made exact."""
    near = np.round(matrix)
    exact = np.where(np.abs(matrix - near) < SNAP, near, matrix) + 0.0
    made: Exprs = np.empty(exact.shape, dtype=object)
    for index, item in np.ndenumerate(exact):
        made[index] = float(item)
    return made


def cross(a: Exprs, b: Exprs) -> Exprs:
    """Return a x b of vectors (3,)."""
    return vector(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


def dot(a: Exprs, b: Exprs) -> Expr:
    """Return a . b of vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def determinant(rows: Sequence[Sequence[Expr]]) -> Expr:
    """Return a determinant by expansion along rows, each minor formed once."""
    known: dict[tuple[int, ...], Expr] = {(): 1.0}

    def minor(columns: tuple[int, ...]) -> Expr:
        if columns not in known:
            row = rows[len(rows) - len(columns)]
            total: Expr = 0.0
            for place, column in enumerate(columns):
                if isinstance(row[column], float) and row[column] == 0.0:
                    continue
                rest = columns[:place] + columns[place + 1 :]
                term = row[column] * minor(rest)
                total = total + term if place % 2 == 0 else total - term
            known[columns] = total
        return known[columns]

    return minor(tuple(range(len(rows))))
