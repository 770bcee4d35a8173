"""The configuration curve between two nodes, by its projection on their chord.

With the closure equations one linear equation, border . values = given, is solved: it
picks one point of the curve. The inverse of both together gives Newton's step, the
tangent (its last column) and, with the rate of the Jacobian along the tangent, the second
derivative by arc length. It is regular wherever the motion is unique, at the dead
centres of every pair too.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import unit_rows
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure, newton

MOST_CORRECTIONS = 6


CORRECTED = 1e-10
"""A Newton step (rad) below this leaves an error that its square bounds."""


LARGEST_MISS = 0.05
"""A predicted point may be this part of the chord beside the curve."""


@dataclass(frozen=True)
class CurvePoints(ArrayRows):
    """n points of a configuration curve, s its arc length in the variables (rad).

    `values`, `tangents` dv/ds of unit length and `bends` d2v/ds2 are (n, variables);
    `residual` (n,) is the largest component of the closure's residual (rad). A point that
    is not on the curve is NaN.
    """

    values: Floats
    tangents: Floats
    bends: Floats
    residual: Floats

    @property
    def plain(self) -> "CurvePoints":
        """The points without what else is known of them."""
        return CurvePoints(self.values, self.tangents, self.bends, self.residual)

    def only(self, good: Bools) -> "CurvePoints":
        """Return the points, with NaN for those that are not good (n,)."""
        for array in (self.values, self.tangents, self.bends, self.residual):
            array[~good] = np.nan
        return self

    @property
    def reversed(self) -> "CurvePoints":
        """The same points, last first, with the curve run backwards."""
        back = self.rows(slice(None, None, -1))
        return replace(back, tangents=-back.tangents)


def bordered(jacobian: Floats, borders: Floats) -> Floats:
    """Return the equations (n, rows + 1, variables) with the borders as last row."""
    return np.concatenate([jacobian, borders[:, None, :]], axis=1)


def bordered_condition(equations: Floats, inverse: Floats) -> Floats:
    """Return the reciprocal condition (n,) of bordered equations; 0 where singular."""
    size = np.linalg.norm(equations, axis=(1, 2))
    return np.nan_to_num(1.0 / (np.linalg.norm(inverse, axis=(1, 2)) * size))


def curve_points(
    closure: Closure, values: Floats, borders: Floats
) -> tuple[CurvePoints, Linearisation]:
    """Return the curve at closed configurations, its tangents along the borders.

    `values`, `borders` (n, variables); a border only has to have a part along the curve.
    """
    at = closure.at(values)
    inverse = left_inverse(bordered(at.jacobian, borders))
    tangents = unit_rows(inverse[:, :, -1])
    bends = -np.einsum("nij,nj->ni", inverse[:, :, :-1], at.bias(tangents))
    bends -= np.sum(bends * tangents, axis=1, keepdims=True) * tangents
    return CurvePoints(values, tangents, bends, at.gap), at


def correct(
    closure: Closure, values: Floats, borders: Floats, targets: Floats
) -> tuple[Floats, Floats]:
    """Return values that close the loops with border . values = target, and step sizes.

    `values`, `borders` (n, variables), `targets` (n,). What does not converge is NaN or
    has a residual; the caller judges.
    """

    def change(here: Floats, rows: Indices) -> Floats:
        miss = targets[rows] - np.vecdot(borders[rows], here)
        return bordered_step(closure.take(rows).at(here), borders[rows], miss)

    return newton(change, values, MOST_CORRECTIONS, CORRECTED)


def bordered_step(at: Linearisation, borders: Floats, miss: Floats) -> Floats:
    """Return Newton's steps (n, variables) that close the loops and make up for a miss.

    `miss` (n,) is by how much border . values has to grow, `borders` (n, variables).
    """
    inverse = left_inverse(bordered(at.jacobian, borders))
    change = np.einsum("nij,nj->ni", inverse[:, :, :-1], -at.residual)
    return change + inverse[:, :, -1] * miss[:, None]
