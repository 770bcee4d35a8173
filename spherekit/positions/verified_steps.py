"""Tests that a step along a path of configurations must pass to be accepted.

A step is predicted from a node by its derivatives and corrected by Newton's method. A small
closure residual does not prove that the result is on the same path, because Newton's method
may close the loops on a neighbouring one. A step is therefore accepted only if

- the prediction was nearly right,
- Newton's method contracted at once,
- the equations changed by less than would make them singular on the way,
- the tangent turned little,
- the Hermite polynomial through both ends predicts the middle.

Otherwise the step is tried again with half its length. All paths use these tests, whatever
their parameter: inputs on a straight line, the arc length of a curve, or the angle of a
rotation.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.positions.loop_closure import NewtonSteps
from spherekit.tolerances import CLOSURE_TOLERANCE

MAX_STEP_CONTRACTION = 0.1
"""Largest ratio of the second step of Newton's method to the first.

Larger: steps are accepted at which the method hardly converges, perhaps to another path.
Smaller: more steps are tried.
"""
STEP_PARTS = np.array([0.5, 1.0])
"""Fractions of a step at which it is verified: its middle and its end."""


@dataclass(frozen=True)
class Verification:
    """Limits for the tests of a step along a path of configurations.

    A step is predicted from a node by its derivatives, and corrected by Newton's method.
    The tests detect that the correction leads to another path. Larger limits accept longer
    and less certain steps. For `turn`, a smaller number does.

    Attributes
    ----------
    correction
        Largest error of the prediction, divided by the length of the step.
    slack
        Error of the prediction (rad) that is accepted in addition, because of rounding.
    settled
        A first step of Newton's method that is smaller than this (rad) is rounding. The
        method need not contract after it.
    change
        Largest change of the derivatives of the equations in the step. If A is the matrix
        of these derivatives at the node and dA its change, the number is the norm of A^-1
        dA, or the largest magnitude of the eigenvalues of A^-1 dA. Below 1, the matrix is
        regular all the way from A to A + dA.
    turn
        Least cosine of the angle between the tangents at both ends.
    middle
        Largest distance between the point about half-way on a step and its prediction from
        both ends, divided by the length of the step. The prediction is a Hermite
        polynomial.
    """

    correction: float = 0.05
    slack: float = CLOSURE_TOLERANCE
    settled: float = 1e-7
    change: float = 0.6
    turn: float = 0.9
    middle: float = 1e-4

    def accepts_correction(
        self, newton_steps: NewtonSteps, length: Floats | float
    ) -> Bools:
        """Return (n,) whether predictions were nearly right and Newton's method contracted.

        A step along a path predicts a configuration, which Newton's method corrects. If the
        correction is large, or the method converges slowly, it may have led to another
        path.

        Parameters
        ----------
        newton_steps
            The sizes of the first Newton steps, and the contraction in the second ones.
        length
            (n,) lengths of the steps along the path (rad).
        """
        # The first Newton step is the error of the prediction. It may be a small part,
        # `correction`, of the length of the step. Rounding may add up to `slack` (rad). A
        # first step below `settled` (rad) is only rounding. The contraction then has no
        # meaning.
        first_step = newton_steps.first_step
        is_near = first_step <= self.correction * length + self.slack
        contracts = (first_step <= self.settled) | (
            newton_steps.contraction <= MAX_STEP_CONTRACTION
        )
        return is_near & contracts

    def accepts_change(self, change: Floats, cosine: Floats | float = 1.0) -> Bools:
        """Return (n,) whether equations and tangents changed little enough.

        Parameters
        ----------
        change
            (n,) relative changes of the derivatives of the equations, see `change` of the
            class. If it is 1 or more, their matrix may be singular on the way.
        cosine
            (n,) cosines of the angles between the tangents at both ends.
        """
        return (change < self.change) & (np.asarray(cosine) > self.turn)

    def accepts_middle(
        self, miss: Floats | float, length: Floats | float, rounding: Floats | float = 0.0
    ) -> Bools:
        """Return (n,) whether the middles of steps are where both ends predict them.

        A step leads from one point of a path to another one. The values and derivatives of
        the path at both ends predict a point about half-way (Hermite polynomial), and
        Newton's method has found the true one. Their distance may be at most `self.middle`
        times the length of the step, plus rounding.

        Parameters
        ----------
        miss
            (n,) distances of the middles from their predictions (rad).
        length
            (n,) lengths of the steps (rad).
        rounding
            (n,) rounding errors of the middles (rad).
        """
        return np.asarray(miss <= self.middle * length + rounding)


def extrapolate(
    values: Floats, tangents: Floats, bends: Floats, distances: Floats
) -> Floats:
    """Return Taylor polynomials of second order from points of curves.

    Parameters
    ----------
    values, tangents, bends
        (n, variables) points (rad), with their first and second derivatives.
    distances
        (n, k) distances from each point along its tangent.

    Returns
    -------
    (n k, variables) predicted points (rad): those of the first curve, those of the second,
    and so on.
    """
    step = distances[:, :, None]
    points = values[:, None] + step * tangents[:, None] + 0.5 * step**2 * bends[:, None]
    return points.reshape(-1, values.shape[1])
