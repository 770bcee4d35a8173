"""Continuation: paths of configurations, followed by verified steps.

Every path is followed in the same way, whatever its parameter: inputs on a straight way,
the arc length of a curve, the angle of a rotation. A step is predicted from the last node
by its derivatives, corrected by Newton's method, and accepted only if

- the prediction was nearly right,
- Newton's method contracted at once,
- the equations changed by less than would make them singular on the way, or the
  determinant kept its sign,
- the tangent turned little,
- the Hermite polynomial through both ends predicts the middle.

Otherwise it is halved. After a step that holds, the next one may be longer. A path ends
where it arrives, where its owner says so (a limit, a closed lap), or where no step holds.
"""

from dataclasses import dataclass
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.sphere.rotation import Floats

Rows = NDArray[np.intp]

CONTRACTION = 0.1
"""The second step of Newton's method may be this part of the first."""


@final
@dataclass(frozen=True)
class Verification:
    """How well steps have to be predicted and corrected; `size` is that of a step.

    Attributes
    ----------
    correction, slack
        A prediction may be wrong by this part of the step and so much (rad) besides.
    settled
        Newton's method need not contract after a first step smaller than this (rad).
    change
        Change of the equations, relative; at 1 they may be singular on the way.
    turn
        Least cosine of the angle by which the tangent turns.
    middle
        The prediction of the middle from both ends may be wrong by this part of the step.
    """

    correction: float = 0.05
    slack: float = CLOSURE_TOLERANCE
    settled: float = 1e-7
    change: float = 0.6
    turn: float = 0.9
    middle: float = 1e-4

    def corrected(
        self, first: Floats, ratio: Floats, size: Floats | float
    ) -> NDArray[np.bool_]:
        """Return (n,) whether Newton's first steps (n,), and second by first, are fine."""
        near = first <= self.correction * size + self.slack
        return np.asarray(near & ((first <= self.settled) | (ratio <= CONTRACTION)))

    def regular(self, change: Floats, cosine: Floats | float = 1.0) -> NDArray[np.bool_]:
        """Return (n,) whether equations and tangents changed little enough."""
        return np.asarray((change < self.change) & (np.asarray(cosine) > self.turn))

    def predicted(
        self, miss: Floats | float, size: Floats | float, rounding: Floats | float = 0.0
    ) -> NDArray[np.bool_]:
        """Return (n,) whether the middles of steps lie where both ends predict them."""
        return np.asarray(miss <= self.middle * size + rounding)


class Paths(Protocol):
    """Paths that are followed side by side, each by steps of its own length."""

    @property
    def going(self) -> Rows:
        """The paths that have not ended."""

    def allowed(self, rows: Rows, step: Floats) -> Floats:
        """Return the steps (k,) to try on these paths, at most as long as `step`."""

    def advance(self, rows: Rows, step: Floats) -> Floats:
        """Go on by steps that hold; return how (k,) the next may grow, 0 if none holds."""

    def smallest(self, rows: Rows) -> Floats:
        """Return the steps (k,) at which these paths end if not even they hold."""

    def stop(self, row: int) -> None:
        """End a path that no step leaves."""


def follow_paths(paths: Paths, step: Floats) -> None:
    """Follow paths to their ends, the first steps `step` (n,)."""
    step = step.copy()
    while len(rows := paths.going):
        step[rows] = paths.allowed(rows, step[rows])
        growth = paths.advance(rows, step[rows])
        held = growth > 0.0
        failed = rows[~held]
        for row in failed[~(step[failed] > paths.smallest(failed))]:
            paths.stop(int(row))
        step[rows] *= np.where(held, growth, 0.5)
