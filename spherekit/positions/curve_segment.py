"""Points of a configuration curve: position, tangent and second derivative.

The configurations of a mechanism with one degree of freedom form a curve in the space of
its variables. A point of the curve is determined by the closure equations together with one
linear equation, border . values = target. The Jacobian of both is called bordered. Its
inverse gives

- Newton's step towards the point,
- the tangent, which is the last column, normalised,
- with the bias acceleration along the tangent, the second derivative with respect to the
  arc length.

The bordered Jacobian is regular wherever the motion is unique, also at the dead centres of
all pairs.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import unit_rows
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.hermite import quintic_hermite
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure, NewtonSteps, newton

MAX_CORRECTION_STEPS = 6
"""Largest number of Newton steps from a predicted to an exact point of a curve.

Larger: worse predictions are corrected, perhaps to another curve. Smaller: points near
crossings of curves are not reached.
"""
LAST_CORRECTION_RAD = 1e-10
"""Newton's method ends with a step that is smaller.

It converges quadratically, so that the error after this step is about the square of the
step.
"""


@dataclass(frozen=True)
class CurvePoints(ArrayRows):
    """n points of a configuration curve, with derivatives along the curve.

    The curve consists of the closed configurations of a mechanism with one degree of
    freedom. The arc length s (rad) of the curve is measured in the space of all variables.
    A point that is not on the curve is NaN.

    Attributes
    ----------
    values
        (n, variables) pair variables (rad).
    tangents
        (n, variables) unit vectors dv/ds, derivatives of the values v.
    bends
        (n, variables) second derivatives d2v/ds2 (1/rad), normal to the tangents.
    residual
        (n,) largest component of the closure residual (rad).
    """

    values: Floats
    tangents: Floats
    bends: Floats
    residual: Floats

    @property
    def plain(self) -> "CurvePoints":
        """The points without the fields that a subclass adds, such as equations."""
        return CurvePoints(self.values, self.tangents, self.bends, self.residual)

    def set_nan_except(self, is_valid: Bools) -> "CurvePoints":
        """Set points that are not valid (n,) to NaN, in place, and return all n points."""
        for array in (self.values, self.tangents, self.bends, self.residual):
            array[~is_valid] = np.nan
        return self

    @property
    def reversed(self) -> "CurvePoints":
        """The points in reverse order, with tangents of the curve run backwards."""
        reversed_points = self.rows(slice(None, None, -1))
        return replace(reversed_points, tangents=-reversed_points.tangents)


def interpolate_between(
    starts: CurvePoints, stops: CurvePoints, fractions: Floats
) -> Floats:
    """Interpolate n curves between two points each, by polynomials of degree 5.

    The polynomials have the position and the first two derivatives at both ends (quintic
    Hermite interpolation). Their parameter u is the projection on the chord, which is the
    straight line from start to stop.

    Parameters
    ----------
    starts, stops
        n points each, with variables v (`values`) and their derivatives with respect to the
        arc length s of the curve: `tangents` dv/ds and `bends` d2v/ds2.
    fractions
        (n,) projections on the chords, 0 at the start and 1 at the stop.

    Returns
    -------
    (n, variables) interpolated variables (rad).
    """
    differences = stops.values - starts.values
    lengths = np.linalg.norm(differences, axis=1)
    directions = differences / lengths[:, None]

    def end_values(points: CurvePoints) -> tuple[Floats, Floats, Floats]:
        """Return the variables v, and the derivatives dv/du and d2v/du2."""
        speed = np.vecdot(points.tangents, directions)[:, None]  # du/ds
        acceleration = np.vecdot(points.bends, directions)[:, None]  # d2u/ds2
        # The chain rule: dv/ds = v' du/ds and d2v/ds2 = v'' (du/ds)^2 + v' d2u/ds2, where
        # v' and v'' are the derivatives with respect to u.
        first = points.tangents / speed
        second = (points.bends - first * acceleration) / speed**2
        return points.values, first, second

    return quintic_hermite(end_values(starts), end_values(stops), lengths, fractions)


def bordered(jacobian: Floats, borders: Floats) -> Floats:
    """Return closure Jacobians J with one more row, the border b.

    The closure equations J rates = 0 leave one motion of unknown speed. An additional
    equation, in which the scalar product of b and the rates is given, determines the speed.
    Callers compute left inverses of the matrices, because redundant loop equations can
    make them non-square.

    Parameters
    ----------
    jacobian
        (n, equations, variables) closure Jacobians.
    borders
        (n, variables) the coefficients b of the additional equation.

    Returns
    -------
    (n, equations + 1, variables) matrices, the additional equation last.
    """
    return np.concatenate([jacobian, borders[:, None, :]], axis=1)


def bordered_reciprocal_condition(equations: Floats, inverse: Floats) -> Floats:
    """Return the reciprocal condition numbers (n,) of bordered Jacobians.

    A bordered Jacobian has the derivatives of the loop equations at a point of a curve, and
    the tangent of the curve as a further row. Callers divide by the numbers to estimate the
    effect of rounding errors, or stop a curve where the numbers are small. The numbers are
    computed in the Frobenius norm, and are 0 for singular matrices.

    Parameters
    ----------
    equations
        (n, rows, variables) bordered Jacobians.
    inverse
        (n, variables, rows) inverses of these matrices, NaN for singular matrices.
    """
    norm = np.linalg.norm(equations, axis=(1, 2))
    return np.nan_to_num(1.0 / (np.linalg.norm(inverse, axis=(1, 2)) * norm))


def curve_points(
    closure: Closure, values: Floats, borders: Floats
) -> tuple[CurvePoints, Linearisation]:
    """Return the tangents and second derivatives of configuration curves at some points.

    Tangents and second derivatives follow from the closure Jacobian J with a further row b
    (border). The tangent t solves J t = 0 with b . t > 0. The second derivative dt/ds with
    respect to the arc length s solves J dt/ds + dJ/ds t = 0.

    Parameters
    ----------
    closure
        The loops.
    values
        (n, variables) closed configurations (rad).
    borders
        (n, variables) vectors b that are not normal to the curve. The tangents have a
        positive component along them.

    Returns
    -------
    points
        The points with their derivatives.
    linearisation
        The closure at the configurations.
    """
    linearisation = closure.linearise(values)
    # The matrix has more rows than columns if equations of the loops are redundant, so a
    # left inverse is used.
    inverse = left_inverse(bordered(linearisation.jacobian, borders))
    # The last column solves J t = 0, border . t = 1.
    tangents = unit_rows(inverse[:, :, -1])
    # `bias` is dJ/ds t. The part along the tangent is removed, since |t| = 1 is constant.
    bends = -np.einsum("nij,nj->ni", inverse[:, :, :-1], linearisation.bias(tangents))
    bends -= np.sum(bends * tangents, axis=1, keepdims=True) * tangents
    points = CurvePoints(values, tangents, bends, linearisation.closure_residual)
    return points, linearisation


def correct(
    closure: Closure, values: Floats, borders: Floats, targets: Floats
) -> tuple[Floats, NewtonSteps]:
    """Correct predicted points to exact points of a configuration curve.

    Newton's method solves the closure equations together with one linear equation,
    ``border . values = target``, which selects one point of the curve. A border has the
    coefficients of this equation.

    Parameters
    ----------
    closure
        The loops.
    values
        (n, variables) predicted points (rad).
    borders
        (n, variables) coefficients of the linear equation.
    targets
        (n,) right-hand sides of the linear equation.

    Returns
    -------
    values
        (n, variables) corrected points (rad). A point that has not converged is NaN, or its
        loops are open. The caller checks this.
    newton_steps
        The first step (rad), and the ratio of the second to the first. Both are small if
        the prediction was good.
    """

    def compute_steps(current_values: Floats, rows: Indices) -> Floats:
        """Return Newton's steps (k, variables) at the current values of some points."""
        misses = targets[rows] - np.vecdot(borders[rows], current_values)
        return bordered_step(
            closure.select_rows(rows).linearise(current_values), borders[rows], misses
        )

    return newton(
        compute_steps,
        values,
        max_steps=MAX_CORRECTION_STEPS,
        last_step=LAST_CORRECTION_RAD,
    )


def bordered_step(linearisation: Linearisation, borders: Floats, misses: Floats) -> Floats:
    """Return Newton's steps (n, variables) for the loop closure and one linear equation.

    The linear equation, border . values = target, selects a point of the curve of closed
    configurations. With the closure Jacobian J and the residual F, the step d satisfies J d
    = -F and border . d = miss.

    Parameters
    ----------
    linearisation
        The closure at the current configurations.
    borders
        (n, variables) coefficients of the linear equation.
    misses
        (n,) target less border . values at the current configurations.
    """
    # The last column of the inverse belongs to the linear equation.
    inverse = left_inverse(bordered(linearisation.jacobian, borders))
    steps = np.einsum("nij,nj->ni", inverse[:, :, :-1], -linearisation.residual)
    return steps + inverse[:, :, -1] * misses[:, None]
