"""Vectors and matrices whose entries are expressions, and derivatives with them.

Arrays are NumPy object arrays of numbers and expressions. Terms drop products with 0 and
1 and share what occurs twice, so nothing is simplified here.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.expression_graph import Expr, ExpressionNode, function
from spherekit.sphere.rotation import Floats

Exprs = NDArray[np.object_]
"""An array of numbers, expressions or series."""

SNAP = 1e-15
"""A direction cosine this near to 0, 1 or -1 is that number; it is so up to rounding."""


@final
@dataclass(frozen=True)
class SeriesExpressions:
    """A value along the motion: `coefficients[k]` is its k-th derivative over k!.

    Numbers are constant series. Results go as far as both operands.
    """

    coefficients: tuple[Expr, ...]

    def _with(self, other: Any) -> list[tuple[Expr, Expr]]:
        """Return the coefficients of this and another series in pairs."""
        if isinstance(other, SeriesExpressions):
            return list(zip(self.coefficients, other.coefficients, strict=False))
        return [(one, 0.0 if k else other) for k, one in enumerate(self.coefficients)]

    def __add__(self, other: Any) -> "SeriesExpressions":
        return SeriesExpressions(tuple(a + b for a, b in self._with(other)))

    __radd__ = __add__

    def __sub__(self, other: Any) -> "SeriesExpressions":
        return SeriesExpressions(tuple(a - b for a, b in self._with(other)))

    def __rsub__(self, other: Any) -> "SeriesExpressions":
        return SeriesExpressions(tuple(b - a for a, b in self._with(other)))

    def __neg__(self) -> "SeriesExpressions":
        return self * -1.0

    def __mul__(self, other: Any) -> "SeriesExpressions":
        if not isinstance(other, SeriesExpressions):
            return SeriesExpressions(
                tuple(coefficient * other for coefficient in self.coefficients)
            )
        pairs = self._with(other)
        made = [
            sum_of([pairs[k - i][0] * pairs[i][1] for i in range(k + 1)])
            for k in range(len(pairs))
        ]
        return SeriesExpressions(tuple(made))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "SeriesExpressions":
        pairs = self._with(other)
        made: list[Expr] = []
        for k, (a, _) in enumerate(pairs):
            products = [made[k - i] * pairs[i][1] for i in range(1, k + 1)]
            made.append((a - sum_of(products)) / pairs[0][1])
        return SeriesExpressions(tuple(made))

    def __rtruediv__(self, other: Any) -> "SeriesExpressions":
        return SeriesExpressions((other, *(0.0 for _ in self.coefficients[1:]))) / self

    def derivative(self) -> "SeriesExpressions":
        """Return the derivative along the motion, one coefficient shorter."""
        return SeriesExpressions(
            tuple(float(k) * c for k, c in enumerate(self.coefficients) if k > 0)
        )


def by_coordinate(value: SeriesExpressions, scale: SeriesExpressions) -> list[Expr]:
    """Return a value and its derivatives by a coordinate, `scale` being dp by it."""
    made = [value.coefficients[0]]
    while len(value.coefficients) > 1:
        value = value.derivative() * scale
        made.append(value.coefficients[0])
    return made


def sum_of(terms: Iterable[Expr]) -> Expr:
    """Return the sum of expressions, added in their order."""
    total: Expr = 0.0
    for term in terms:
        total = total + term
    return total


def vector(items: Sequence[Expr]) -> Exprs:
    """Return an array of expressions."""
    made = np.empty(len(items), dtype=object)
    made[:] = items
    return made


def vector_sum(parts: Iterable[Exprs]) -> Exprs:
    """Return the sum of vectors (3,), added in their order."""
    total = vector([0.0, 0.0, 0.0])
    for part in parts:
        total = total + part
    return total


def series(orders: Sequence[Exprs]) -> Exprs:
    """Return the vector of series from the vectors of their coefficients by order."""
    return vector(
        [
            SeriesExpressions(tuple(coefficients))
            for coefficients in zip(*orders, strict=True)
        ]
    )


def constants(matrix: Floats | Exprs) -> Exprs:
    """Return numbers as entries, those within rounding of 0, 1, -1 made exact."""
    made: Exprs = np.empty(matrix.shape, dtype=object)
    for index in np.ndindex(*matrix.shape):
        item: Any = matrix[index]
        if isinstance(item, ExpressionNode):
            made[index] = item
        else:
            near = round(float(item)) + 0.0
            made[index] = near if abs(item - near) < SNAP else float(item)
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
    """Return a . b."""
    return sum_of([x * y for x, y in zip(a, b, strict=True)])


def length(orders: Sequence[Exprs]) -> tuple[Exprs, SeriesExpressions]:
    """Return a vector's direction and its length, from its coefficients by order.

    From the coefficients of |w|^2 = w . w, solved for those of |w|.
    """
    size = function("sqrt", dot(orders[0], orders[0]))
    share = 1.0 / size
    unit = np.asarray(orders[0] * share)
    sizes = [size]
    for k in range(1, len(orders)):
        middle = sum_of(
            [dot(orders[i], orders[k - i]) - sizes[i] * sizes[k - i] for i in range(1, k)]
        )
        sizes.append(dot(unit, orders[k]) + 0.5 * (middle * share))
    return unit, SeriesExpressions(tuple(sizes))


def determinant(rows: Sequence[Sequence[Expr]]) -> Expr:
    """Return a determinant by expansion along rows, each minor formed once."""
    minors: dict[tuple[int, ...], Expr] = {(): 1.0}

    def minor(columns: tuple[int, ...]) -> Expr:
        if columns not in minors:
            row = rows[len(rows) - len(columns)]
            total: Expr = 0.0
            for place, column in enumerate(columns):
                if isinstance(row[column], float) and row[column] == 0.0:
                    continue
                rest = columns[:place] + columns[place + 1 :]
                term = row[column] * minor(rest)
                total = total + term if place % 2 == 0 else total - term
            minors[columns] = total
        return minors[columns]

    return minor(tuple(range(len(rows))))


def cofactors(rows: Sequence[Sequence[Expr]]) -> list[list[Expr]]:
    """Return the cofactors of a square matrix: the signed minors without row and column."""
    places = range(len(rows))

    def minor(i: int, j: int) -> Expr:
        return determinant(
            [[rows[a][b] for b in places if b != j] for a in places if a != i]
        )

    return [
        [minor(i, j) if (i + j) % 2 == 0 else -1.0 * minor(i, j) for j in places]
        for i in places
    ]
