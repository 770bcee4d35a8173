"""Configuration curves as chains of pieces, each with the centre of the next one in it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from spherekit.arrays import Floats
from spherekit.proof.arc_equations import Equations
from spherekit.proof.collinear_loops import Arm, Crossings
from spherekit.proof.tubes import (
    LONGEST,
    CertifiedArc,
    corrected,
    piece_at,
)

FORWARD = 0.9
"""Where the next centre is looked for, over the half length of a piece."""


MOST_PIECES = 6000


BEYOND = 1e-9
"""How far (rad) out of the range a chain goes on at least."""


LONGER = 1.6
"""How much longer than the last the next piece is tried."""


Side = Callable[[float, float], int]
"""Returns 1 for inputs above the range (rad) by more than a second number, -1 for those
below it, else 0."""


@dataclass(frozen=True)
class Chain:
    """A curve, or the part of it that goes through the range of the input.

    Every piece but the last has the centre of the next one in it; if `closed`, the last has
    that of the first, up to whole turns. Else both ends are beyond the range or on an arm
    of a crossing, or `problem` says why the chain does not go on.
    """

    pieces: Sequence[CertifiedArc]
    closed: bool
    problem: str = ""

    @property
    def links(self) -> list[tuple[CertifiedArc, CertifiedArc]]:
        """Every piece with the one whose centre is in it."""
        return list(pairwise([*self.pieces, *self.pieces[: self.closed]]))

    def again(self) -> bool:
        """Return whether it may come through its start a second time."""
        for piece, further in self.links[1 : len(self.pieces) - 1]:
            s = piece.coordinates(self.pieces[0].centre)
            reach = piece.coordinates(further.centre)[0]
            inside = np.all(np.abs(s[1:]) <= piece.radius + 1e-9)
            if inside and -1e-9 <= s[0] <= reach + 1e-9:
                return True
        return False


def chain_through(
    equations: Equations, first: CertifiedArc, side: Side, crossings: Crossings
) -> Chain | None:
    """Return the chain of the curve through a piece, from one of its ends to the other.

    Crossings that it leads to are kept; a configuration in one of these has no chain.
    """
    made = _followed(equations, first, side, crossings)
    if not made.closed:
        problem, last = made.problem, _turned(made.pieces[-1])
        made = _followed(equations, last, side, crossings)
        made = replace(made, problem=problem or made.problem)
    return None if crossings.may_hold(first.centre, first.miss) else made


def _turned(piece: CertifiedArc) -> CertifiedArc:
    """Return the same piece the other way round: its test has sizes only."""
    frame = piece.frame.copy()
    frame[:, 0] *= -1.0
    return replace(piece, frame=frame)


def _ahead(
    equations: Equations, piece: CertifiedArc, place: Floats, longest: float
) -> CertifiedArc | None:
    """Return a piece next to a place, the centre of which is ahead in another, or None."""
    on = corrected(equations, place)
    made = None if on is None else piece_at(equations, on, piece.tangent, longest)
    if made is None or not piece.coordinates(made.centre)[0] > 0.0:
        return None
    return made if piece.holds(made.centre, made.miss) else None


def _next(equations: Equations, last: CertifiedArc) -> CertifiedArc | None:
    """Return the piece that goes on from one, with its centre in that one."""
    part, longest = FORWARD, min(LONGEST, LONGER * last.half)
    while part > 1e-3:
        place = last.centre + part * last.half * last.tangent
        if further := _ahead(equations, last, place, longest):
            return further
        part *= 0.6
    return None


def _followed(
    equations: Equations, start: CertifiedArc, side: Side, crossings: Crossings
) -> Chain:
    """Return the chain from a piece on: round to it, or until the curve ends.

    It ends out of the range or on an arm. Where it starts on one of these it goes on until
    it is in the range and on none, or on another one.
    """

    def outside(piece: CertifiedArc) -> Arm | int | None:
        return crossings.arm(piece) or side(piece.centre[-1], max(piece.tight, BEYOND))

    pieces, gone, begun = [start], 0.0, outside(start)
    while len(pieces) < MOST_PIECES:
        last = pieces[-1]
        here = outside(last)
        if here and here != begun:
            return Chain(pieces, False)
        begun = here and begun
        ahead = gone > 1.5 * start.half and last.coordinates(start.centre)[0] > 0
        same = last.tangent @ start.tangent > 0.5
        if ahead and same and last.holds(start.centre, start.miss):
            return Chain(pieces, True)
        further = _next(equations, last)
        if further is None:
            if crossings.find(last.centre):
                return _followed(equations, start, side, crossings)
            return Chain(pieces, False, "a curve could not be followed to its end")
        gone += float(np.linalg.norm(further.centre - last.centre))
        pieces.append(further)
    return Chain(pieces, False, f"a curve has more than {MOST_PIECES} pieces")
