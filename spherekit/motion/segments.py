"""The configuration curve between two nodes, by its projection on their chord.

With the closure equations one linear equation, border . values = given, is solved: it
picks one point of the curve. The inverse of both together gives Newton's step, the
tangent (its last column) and, with the rate of the Jacobian along the tangent, the second
derivative by arc length. It is regular wherever the motion is unique, at the dead
centres of every pair too.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, EPS
from spherekit.errors import SolveError
from spherekit.motion.closure import Closure
from spherekit.motion.continuation import NewtonSteps, newton
from spherekit.motion.linearisation import Linearisation
from spherekit.motion.loops import left_inverse
from spherekit.numeric.hermite import hermite
from spherekit.numeric.rows import ArrayRows
from spherekit.sphere.rotation import Floats

MOST_CORRECTIONS = 6
CORRECTED = 1e-10
"""A Newton step (rad) below this leaves an error that its square bounds."""
LARGEST_MISS = 0.05
"""A predicted point may be this part of the chord beside the curve."""


@final
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
    return np.asarray(np.nan_to_num(1.0 / (np.linalg.norm(inverse, axis=(1, 2)) * size)))


def curve_points(
    closure: Closure, values: Floats, borders: Floats
) -> tuple[CurvePoints, Linearisation]:
    """Return the curve at closed configurations, its tangents along the borders.

    `values`, `borders` (n, variables); a border only has to have a part along the curve.
    """
    at = closure.at(values)
    inverse = left_inverse(bordered(at.jacobian, borders))
    tangents = inverse[:, :, -1]
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    bends = -np.einsum("nij,nj->ni", inverse[:, :, :-1], at.bias(tangents))
    bends -= np.sum(bends * tangents, axis=1, keepdims=True) * tangents
    return CurvePoints(values, tangents, bends, at.gap), at


def correct(
    closure: Closure, values: Floats, borders: Floats, targets: Floats
) -> tuple[Floats, NewtonSteps]:
    """Return values that close the loops with border . values = target, and the steps.

    `values`, `borders` (n, variables), `targets` (n,). What does not converge is NaN or
    has a residual; the caller judges.
    """

    def change(here: Floats, rows: NDArray[np.intp]) -> Floats:
        miss = targets[rows] - np.sum(borders[rows] * here, axis=1)
        return bordered_step(closure.take(rows).at(here), borders[rows], miss)

    return newton(change, values, MOST_CORRECTIONS, CORRECTED)


def bordered_step(at: Linearisation, borders: Floats, miss: Floats) -> Floats:
    """Return Newton's steps (n, variables) that close the loops and make up for a miss.

    `miss` (n,) is by how much border . values has to grow, `borders` (n, variables).
    """
    inverse = left_inverse(bordered(at.jacobian, borders))
    change = np.einsum("nij,nj->ni", inverse[:, :, :-1], -at.residual)
    return np.asarray(change + inverse[:, :, -1] * miss[:, None])


@final
@dataclass(frozen=True)
class Segments:
    """The curve through k nodes; u, the sum of the chords' lengths, is its parameter."""

    closure: Closure
    nodes: CurvePoints

    @cached_property
    def chords(self) -> Floats:
        """Lengths (k - 1,) of the chords (rad)."""
        return np.asarray(np.linalg.norm(np.diff(self.nodes.values, axis=0), axis=1))

    @cached_property
    def directions(self) -> Floats:
        """Unit vectors (k - 1, variables) of the chords."""
        return np.asarray(np.diff(self.nodes.values, axis=0) / self.chords[:, None])

    @cached_property
    def starts(self) -> Floats:
        """The parameter u (k,) of the nodes."""
        return np.concatenate([[0.0], np.cumsum(self.chords)])

    @cached_property
    def rounding(self) -> Floats:
        """Relative error (k - 1,) of a tangent between two nodes, from their condition."""
        jacobian = self.closure.at(self.nodes.values).jacobian
        equations = bordered(jacobian, self.nodes.tangents)
        condition = bordered_condition(equations, left_inverse(equations))
        return np.asarray(8.0 * EPS / np.minimum(condition[:-1], condition[1:]))

    def predict(self, which: NDArray[np.intp], along: Floats) -> Floats:
        """Return quintic Hermite values (n, variables) at parts of chords (n,), 0 to 1."""
        e = self.directions[which]

        def end(node: NDArray[np.intp]) -> tuple[Floats, Floats, Floats]:
            tangent, bend = self.nodes.tangents[node], self.nodes.bends[node]
            speed = np.sum(tangent * e, axis=1, keepdims=True)
            swing = np.sum(bend * e, axis=1, keepdims=True)
            slope = tangent / speed
            return self.nodes.values[node], slope, (bend - slope * swing) / speed**2

        return hermite(end(which), end(which + 1), self.chords[which], along)

    def at(self, u: Floats) -> CurvePoints:
        """Return the curve at u (n,), to closure precision."""
        return self.on(*self._places(u))

    def _places(self, u: Floats) -> tuple[NDArray[np.intp], Floats]:
        """Return the chords (n,) of u (n,), and how far from their starts (n,) it is."""
        which = np.clip(np.searchsorted(self.starts, u) - 1, 0, len(self.chords) - 1)
        return which, u - self.starts[which]

    def on(self, which: NDArray[np.intp], way: Floats) -> CurvePoints:
        """Return the curve where its projection on the chord `which` (n,) is `way` (n,)."""
        chords, e = self.chords[which], self.directions[which]
        guess = self.predict(which, way / chords)
        targets = np.sum(e * self.nodes.values[which], axis=1) + way
        values, _ = correct(self.closure, guess, e, targets)
        points, _ = curve_points(self.closure, values, e)
        miss = np.max(np.abs(values - guess), axis=1)
        good = (points.residual < CLOSURE_TOLERANCE) & (miss <= LARGEST_MISS * chords)
        for array in (points.values, points.tangents, points.bends, points.residual):
            array[~good] = np.nan
        return points

    def speed(self, u: Floats) -> Floats:
        """Return ds/du at u of any shape.

        Raises
        ------
        SolveError
            If the curve cannot be found between its nodes.
        """
        flat = u.ravel()
        which, way = self._places(flat)
        points = self.on(which, way)
        cosine = np.sum(points.tangents * self.directions[which], axis=1)
        if not np.all(np.isfinite(cosine)):
            lost = float(flat[~np.isfinite(cosine)][0])
            raise SolveError(
                f"the configuration curve is lost {self.place(lost)}: Newton's method does "
                "not close the loops between two nodes; follow it with a smaller `step`"
            )
        return np.asarray((1.0 / cosine).reshape(u.shape))

    def place(self, u: float) -> str:
        """Return words for where u is."""
        return f"at the length {u:.6g} rad of its chords"
