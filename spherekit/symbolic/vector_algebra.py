"""Vectors and matrices whose entries are expressions.

Arrays are NumPy object arrays of numbers and expressions. Terms drop products with 0 and
1 and share what occurs twice, so nothing is simplified here.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, function

Exprs = NDArray[np.object_]
"""An array of numbers and expressions."""

SNAP = 1e-15
"""A direction cosine this near to 0, 1 or -1 is that number; it is so up to rounding."""


def vector(items: Sequence[Expr]) -> Exprs:
    """Return an array of expressions."""
    made = np.empty(len(items), dtype=object)
    made[:] = items
    return made


def vector_sum(parts: Iterable[Exprs]) -> Exprs:
    """Return the sum of vectors (3,), added in their order."""
    return sum(parts, vector([0.0, 0.0, 0.0]))


def constants(matrix: Floats | Exprs) -> Exprs:
    """Return numbers as entries, those within rounding of 0, 1, -1 made exact."""
    made: Exprs = np.array(matrix, dtype=object)
    for index, item in np.ndenumerate(made):
        if not isinstance(item, ExpressionNode):
            near = round(float(item)) + 0.0
            made[index] = near if abs(item - near) < SNAP else float(item)
    return made


def determinant(rows: Sequence[Sequence[Expr]]) -> Expr:
    """Return a determinant by expansion along rows, each minor formed once."""
    minors: dict[tuple[int, ...], Expr] = {(): 1.0}

    def minor(columns: tuple[int, ...]) -> Expr:
        if columns not in minors:
            row = rows[len(rows) - len(columns)]
            total: Expr = 0.0
            for place, column in enumerate(columns):
                if row[column] == 0.0:
                    continue
                term = row[column] * minor(columns[:place] + columns[place + 1 :])
                total = total + term if place % 2 == 0 else total - term
            minors[columns] = total
        return minors[columns]

    return minor(tuple(range(len(rows))))


def cofactors(rows: Sequence[Sequence[Expr]]) -> list[list[Expr]]:
    """Return the cofactors of a square matrix: the signed minors without row and column."""
    places = range(len(rows))

    def cofactor(i: int, j: int) -> Expr:
        rest = [[rows[a][b] for b in places if b != j] for a in places if a != i]
        return (-1.0) ** (i + j) * determinant(rest)

    return [[cofactor(i, j) for j in places] for i in places]


SWEEPS = 5
"""Rounds of rotations after which three columns are at right angles, to rounding."""


def singular_values(columns: Sequence[Exprs]) -> list[Expr]:
    """Return the singular values of a matrix of two or three columns, the largest first.

    By rotations that bring two columns at a time to right angles, the longer one first
    (Hestenes 1958), as often as it takes.
    """
    columns = [*columns]
    pairs = [*combinations(range(len(columns)), 2)]
    for one, other in pairs * (SWEEPS if len(pairs) > 1 else 1):
        a, b = columns[one], columns[other]
        angle = 0.5 * function("atan2", 2.0 * dot(a, b), dot(a, a) - dot(b, b))
        c, s = cosine(angle), sine(angle)
        columns[one], columns[other] = a * c + b * s, b * c - a * s
    return [function("sqrt", dot(column, column)) for column in columns]


def sine(angle: Expr) -> Expr:
    """Return the sine of a number or a term."""
    return angle.sin() if isinstance(angle, ExpressionNode) else float(np.sin(angle))


def cosine(angle: Expr) -> Expr:
    """Return the cosine of a number or a term."""
    return angle.cos() if isinstance(angle, ExpressionNode) else float(np.cos(angle))
