"""Tests of a step along a path of configurations.

A step is predicted from a node by its derivatives and corrected by Newton's method. A small
closure residual does not prove that the result is on the same path, because Newton's method
may close the loops on a neighbouring one. The tests are therefore that

- the prediction was nearly right,
- Newton's method contracted at once,
- the equations changed by less than would make them singular on the way,
- the tangent turned little,
- the Hermite polynomial through both ends predicts the middle.

If a test fails, the step is tried again with half its length. Paths whose parameter is the
arc length of a curve use all tests. If the inputs move on a straight line, the sign of a
determinant is tested instead of the change of the equations, and the middle is not tested.
If the parameter is the angle of a rotation, the tangent is not tested.
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
    The tests detect that the correction leads to another path. A node is a computed point
    of the path. Larger limits, and a smaller `turn`, accept longer and less certain steps.

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
        """Return a mask (n,) of the steps whose predictions needed only small corrections.

        A path is a curve of configurations. Each step predicts the next configuration,
        which Newton's method corrects. After a large correction, or slow convergence, the
        result may be on another path, and the step is not accepted.

        Parameters
        ----------
        newton_steps
            For each step the first Newton step (rad), and the ratio of the second to the
            first.
        length
            (n,) lengths of the steps along the path (rad).
        """
        # The first Newton step is the error of the prediction. This error may be the
        # fraction `correction` of the step length, plus `slack` (rad) for rounding. If it
        # is below `settled` (rad), it is only rounding, and the contraction is not tested.
        first_step = newton_steps.first_step
        is_near = first_step <= self.correction * length + self.slack
        contracts = (first_step <= self.settled) | (
            newton_steps.contraction <= MAX_STEP_CONTRACTION
        )
        return is_near & contracts

    def accepts_change(self, change: Floats, cosine: Floats | float = 1.0) -> Bools:
        """Return a mask (n,) of the steps in which Jacobian and tangent changed little.

        Large changes are a sign that the step has left its path.

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
        """Return a mask (n,) of the steps whose middles are where both ends predict them.

        This test detects steps that jump to another path of configurations. The values and
        derivatives at both ends of a step predict a point about half-way (Hermite
        polynomial). Newton's method has found the true point. The distance between both
        points may be at most the part `self.middle` of the step length, plus rounding.

        Parameters
        ----------
        miss
            (n,) distances (rad) of the true middles from the predicted ones.
        length
            (n,) lengths of the steps (rad).
        rounding
            (n,) rounding errors of the middles (rad).
        """
        return np.asarray(miss <= self.middle * length + rounding)


def extrapolate(
    values: Floats, tangents: Floats, bends: Floats, distances: Floats
) -> Floats:
    """Return predicted points of curves, by Taylor polynomials of second order.

    Parameters
    ----------
    values, tangents, bends
        (n, variables) points (rad), with their first and second derivatives.
    distances
        (n, k) parameter differences from each point at which the curve is predicted.

    Returns
    -------
    (n k, variables) predicted points (rad): first the k points of the first curve, then
    those of the second, and so on.
    """
    step = distances[:, :, None]
    points = values[:, None] + step * tangents[:, None] + 0.5 * step**2 * bends[:, None]
    return points.reshape(-1, values.shape[1])
