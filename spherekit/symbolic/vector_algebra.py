"""Vectors and matrices whose entries are symbolic expressions.

They are NumPy object arrays of numbers and expressions. Nothing is simplified here, because
the expressions themselves drop products with 0 and 1 and share equal parts.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, function

Exprs = NDArray[np.object_]
"""An array of numbers and expressions."""

EXACT_COSINE_TOLERANCE = 1e-15
"""A direction cosine this close to 0, 1 or -1 differs from that number by rounding only.

Smaller: rounding errors such as 6e-17 remain, and products with them are computed. Larger:
small but real angles are lost.
"""

ROTATION_SWEEPS = 5
"""Number of sweeps over all pairs of three columns that make them orthogonal."""


def vector(items: Sequence[Expr]) -> Exprs:
    """Return a one-dimensional array of expressions."""
    entries = np.empty(len(items), dtype=object)
    entries[:] = items
    return entries


def vector_sum(parts: Iterable[Exprs]) -> Exprs:
    """Return the sum of vectors (3,), added in their order."""
    return sum(parts, vector([0.0, 0.0, 0.0]))


def cross(a: Exprs, b: Exprs) -> Exprs:
    """Return the cross product of two vectors (3,)."""
    return vector(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


def constants(matrix: Floats | Exprs) -> Exprs:
    """Return a matrix in which numbers close to an integer are replaced by the integer.

    For direction cosines the integers are 0, 1 and -1. This simplifies expressions, because
    products with exactly 0 and 1 are dropped. Expressions are not changed.
    """
    entries: Exprs = np.array(matrix, dtype=object)
    for index, item in np.ndenumerate(entries):
        if not isinstance(item, ExpressionNode):
            nearest_integer = round(float(item)) + 0.0
            is_exact = abs(item - nearest_integer) < EXACT_COSINE_TOLERANCE
            entries[index] = nearest_integer if is_exact else float(item)
    return entries


def determinant(rows: Sequence[Sequence[Expr]]) -> Expr:
    """Return the determinant of a square matrix by expansion along rows (Laplace).

    The entries are symbolic expressions, such as coefficients of velocity equations.
    Smaller determinants (minors) that occur several times are formed once.
    """
    # The minor of k columns is the determinant of these columns in the last k rows.
    minors: dict[tuple[int, ...], Expr] = {}

    def form_minor(columns: tuple[int, ...]) -> Expr:
        """Return the determinant of k columns in the last k rows of the whole matrix.

        For all columns this is the determinant of the matrix. The determinant is expanded
        along the first of the k rows. The sum has a term for each column: the entry of this
        row times the determinant of the other columns in the rows below. The signs of the
        terms alternate. `minors` keeps each determinant for further use.
        """
        if not columns:
            return 1.0  # the determinant of an empty matrix
        if columns in minors:
            return minors[columns]
        row = rows[len(rows) - len(columns)]
        total: Expr = 0.0
        for position, column in enumerate(columns):
            if row[column] == 0.0:
                continue
            other_columns = columns[:position] + columns[position + 1 :]
            term = row[column] * form_minor(other_columns)
            if position % 2 == 0:
                total = total + term
            else:
                total = total - term
        minors[columns] = total
        return total

    return form_minor(tuple(range(len(rows))))


def cofactors(rows: Sequence[Sequence[Expr]]) -> list[list[Expr]]:
    """Return the cofactors of a square matrix of symbolic expressions, as rows.

    The cofactor of entry (i, j) is the determinant without row i and column j, with the
    sign (-1)^(i + j).
    """
    indices = range(len(rows))

    def form_cofactor(i: int, j: int) -> Expr:
        """Return the cofactor of entry (i, j)."""
        remaining_rows = [rows[row] for row in indices if row != i]
        minor = [
            [row[column] for column in indices if column != j] for row in remaining_rows
        ]
        return (-1.0) ** (i + j) * determinant(minor)

    return [[form_cofactor(i, j) for j in indices] for i in indices]


def singular_values(columns: Sequence[Exprs]) -> list[Expr]:
    """Return the singular values of a matrix with two or three columns, the largest first.

    The entries are symbolic expressions, so the number of steps has to be fixed. Each step
    (one-sided Jacobi rotation, Hestenes 1958) makes two columns orthogonal, with the longer
    one first. Two columns need one step. Three columns need several sweeps over all pairs
    of columns. The lengths of the final columns are the singular values.
    """
    columns = [*columns]
    pairs = [*combinations(range(len(columns)), 2)]
    sweeps = ROTATION_SWEEPS if len(pairs) > 1 else 1
    for first, second in pairs * sweeps:
        a = columns[first]
        b = columns[second]
        # With tan(2 angle) = 2 a b / (a^2 - b^2) the rotated columns are orthogonal, and
        # the first one is the longer.
        angle = 0.5 * function("atan2", 2.0 * dot(a, b), dot(a, a) - dot(b, b))
        c = cosine(angle)
        s = sine(angle)
        columns[first] = a * c + b * s
        columns[second] = b * c - a * s
    return [function("sqrt", dot(column, column)) for column in columns]


def sine(angle: Expr) -> Expr:
    """Return the sine of a number or an expression (rad)."""
    return angle.sin() if isinstance(angle, ExpressionNode) else float(np.sin(angle))


def cosine(angle: Expr) -> Expr:
    """Return the cosine of a number or an expression (rad)."""
    return angle.cos() if isinstance(angle, ExpressionNode) else float(np.cos(angle))
