"""Saddles met by chains: where arms begin and end, and what is still at them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.numeric.turns import wrap
from spherekit.proof.balls import middle
from spherekit.proof.equations import Equations
from spherekit.proof.folded import BALL, Foldings
from spherekit.proof.saddles import Saddle, saddle_near
from spherekit.proof.slopes import Quadrant
from spherekit.proof.tubes import Piece
from spherekit.sphere.rotation import Floats

FARTHEST = 0.02
"""How far (rad) from where a curve could not be followed a saddle is looked for."""
MOST_SADDLES = 64


@final
@dataclass(frozen=True)
class Arm:
    """One of the four arms of a saddle, by the saddle's number and its quadrant."""

    saddle: int
    quadrant: Quadrant


@final
class Crossings:
    """All saddles of a search, whose parts of space have no point in common."""

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self.foldings = Foldings(equations)
        self.saddles: list[Saddle] = []

    def find(self, place: Floats) -> bool:
        """Look for a saddle next to a place; return whether there is a new one."""
        if len(self.saddles) >= MOST_SADDLES:
            return False
        made = saddle_near(self.equations, place, FARTHEST, self._crosses, self._fits)
        if made is not None:
            self.saddles.append(made)
        return made is not None

    def arm(self, piece: Piece) -> Arm | None:
        """Return the arm that the middle of a piece's arc is on, None if on none."""
        for number, saddle in enumerate(self.saddles):
            quadrant = saddle.quadrant(piece.centre, piece.miss)
            if quadrant is not None:
                return Arm(number, quadrant)
        return None

    def ends(self, pieces: Sequence[Piece], closed: bool) -> tuple[Arm | None, Arm | None]:
        """Return the arms that a chain begins and ends on, None where on none.

        A chain of one piece on an arm comes from beyond the range.
        """
        if closed:
            return None, None
        return None if len(pieces) == 1 else self.arm(pieces[0]), self.arm(pieces[-1])

    def may_hold(self, place: Floats, off: float) -> bool:
        """Return whether a configuration, off by at most `off`, may be in a saddle."""
        return any(saddle.may_hold(place, off) for saddle in self.saddles)

    def covers(self, centres: Floats, radii: Floats) -> NDArray[np.bool_]:
        """Return whether boxes of radii (n, v) are in the part of space of a saddle."""
        out = np.zeros(len(centres), dtype=bool)
        for saddle in self.saddles:
            out |= saddle.covers(centres, radii)
        return out

    def still(self, pieces: Sequence[Piece], variable: int) -> bool:
        """Return whether a variable is proven the same along a whole chain of pieces.

        One configuration of it is enough: where the slopes of the loop's equation by the
        other variable vanish, and not all do, there is no other near by.
        """
        piece = pieces[len(pieces) // 2]
        balls = self.foldings.still(variable, piece.centre)
        if balls is None:
            return False
        return piece.holds(np.array([middle(ball) for ball in balls]), 2.0 * BALL)

    def _crosses(self, part: Saddle) -> bool:
        balls = self.foldings.closed_at(part.centre, 1e-3 * np.min(part.limits))
        return balls is not None

    def _fits(self, made: Saddle) -> bool:
        return all(_disjoint(made, other) for other in self.saddles)


def _disjoint(one: Saddle, other: Saddle) -> bool:
    """Return whether a face of one of two parts of space has them on both its sides."""
    apart = wrap(other.centre - one.centre)
    for first, second in ((one, other), (other, one)):
        inner = np.abs(first.frame.T @ second.frame) @ second.limits
        if np.any(np.abs(apart @ first.frame) > first.limits + inner + 1e-9):
            return True
    return False
