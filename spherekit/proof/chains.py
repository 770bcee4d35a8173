"""Configuration curves as chains of pieces, each with the centre of the next one in it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.proof.equations import Equations
from spherekit.proof.folded import Crossings
from spherekit.proof.tubes import LONGEST, Piece, corrected, piece_at
from spherekit.sphere.rotation import Floats

FORWARD = 0.9
"""Where the next centre is looked for, over the half length of a piece."""
MOST_PIECES = 6000
MOST_BRIDGED = 64
"""Pieces put between two."""
BEYOND = 1e-9
"""How far (rad) out of the range a chain goes on at least."""
APART = "two pieces do not meet"
LONGER = 1.6
"""How much longer than the last the next piece is tried."""


@final
@dataclass(frozen=True)
class Range:
    """The range of the input (rad), of all turns if `whole`."""

    low: float
    high: float
    whole: bool

    def has(self, q: float, off: float = 0.0) -> bool:
        """Return whether an input may be in the range if it is off by at most `off`."""
        return self.whole or self.low - off <= q <= self.high + off


@final
@dataclass(frozen=True)
class Chain:
    """A curve, or the part of it that goes through the range of the input.

    Every piece but the last has the centre of the next one in it; if `closed`, the last has
    that of the first, up to whole turns. Else both ends are beyond the range or on an arm
    of a crossing, or `problem` says why the chain does not go on.
    """

    pieces: tuple[Piece, ...]
    closed: bool
    problem: str = ""
    first: int = 0

    @property
    def start(self) -> Piece:
        """The piece that the chain was followed from."""
        return self.pieces[self.first]


def laps(chain: Chain) -> bool:
    """Return whether a chain may come through its start a second time."""
    start, pieces = chain.start, chain.pieces
    following = [*pieces[1:], *(pieces[:1] if chain.closed else ())]
    before = (chain.first - 1) % len(pieces)
    for number, (piece, further) in enumerate(zip(pieces, following, strict=False)):
        if number in (chain.first, before):
            continue
        s = piece.coordinates(start.centre)
        reach = piece.coordinates(further.centre)[0]
        inside = np.all(np.abs(s[1:]) <= piece.radius + 1e-9)
        if inside and -1e-9 <= s[0] <= reach + 1e-9:
            return True
    return False


def chain_through(
    equations: Equations, start: Floats, inputs: Range, crossings: Crossings
) -> Chain | None:
    """Return the chain of pieces through a configuration, None if none is proven there.

    Crossings that it leads to are kept; a configuration in one of these has no chain.
    """
    first = piece_at(equations, start, None, LONGEST)
    if first is None:
        return None
    ahead, closed, problem = _followed(equations, first, first, inputs, crossings)
    if crossings.may_hold(first.centre, first.miss):
        return None
    if closed:
        return Chain((first, *ahead), True)
    back, _, behind = _followed(equations, _turned(first), None, inputs, crossings)
    if crossings.may_hold(first.centre, first.miss):
        return None
    before = [_turned(piece) for piece in reversed(back)]
    linked = _bridged(equations, [*before, first, *ahead], len(before))
    if linked is None:
        return Chain((first, *ahead), False, problem or APART)
    where = next(k for k, piece in enumerate(linked) if piece is first)
    if before and linked[0] is not before[0]:
        behind = behind or APART
    return Chain(tuple(linked), False, problem or behind, where)


def _turned(piece: Piece) -> Piece:
    """Return the same piece the other way round: its test has sizes only."""
    frame = piece.frame.copy()
    frame[:, 0] *= -1.0
    return replace(piece, frame=frame)


def _bridged(
    equations: Equations, pieces: Sequence[Piece], first: int
) -> list[Piece] | None:
    """Return pieces with others between them where a centre is in no piece before it.

    Pieces before the one of number `first` are left out where that cannot be: as short
    ones at a place where curves cross.
    """
    linked = list(pieces[:1])
    for number, piece in enumerate(pieces[1:], start=1):
        for _ in range(MOST_BRIDGED):
            if linked[-1].holds(piece.centre, piece.miss):
                linked.append(piece)
                break
            further = _next(equations, linked[-1])
            if further is None:
                break
            linked.append(further)
        if linked[-1] is not piece:
            if number > first:
                return None
            linked = [piece]
    return linked


def _next(equations: Equations, last: Piece, part: float = FORWARD) -> Piece | None:
    """Return the piece that goes on from one, with its centre in that one."""
    while part > 1e-3:
        guess = last.centre + part * last.half * last.tangent
        place = corrected(equations, guess)
        if place is not None:
            longest = min(LONGEST, LONGER * last.half)
            further = piece_at(equations, place, last.tangent, longest)
            ahead = further is not None and last.coordinates(place)[0] > 0
            if ahead and further is not None and last.holds(place, further.miss):
                return further
        part *= 0.6
    return None


def _followed(
    equations: Equations,
    start: Piece,
    goal: Piece | None,
    inputs: Range,
    crossings: Crossings,
) -> tuple[list[Piece], bool, str]:
    """Return the pieces after one, whether they come back to `goal`, and a problem."""
    pieces: list[Piece] = []
    last = start
    gone = 0.0
    driven = equations.variables - 1
    while len(pieces) < MOST_PIECES:
        if goal is not None and gone > 1.5 * goal.half:
            beyond = last.coordinates(goal.centre)[0] > 0
            same = last.tangent @ goal.tangent > 0.5
            if beyond and same and last.holds(goal.centre, goal.miss):
                return pieces, True, ""
        if not inputs.has(float(last.centre[driven]), max(last.tight, BEYOND)):
            return pieces, False, ""
        further = _next(equations, last)
        if further is None:
            crossings.find(last.centre)
            ends = [k for k, piece in enumerate(pieces) if crossings.arm(piece)]
            if ends:
                return pieces[: ends[0] + 1], False, ""
            return pieces, False, "a curve could not be followed to its end"
        gone += float(np.linalg.norm(further.centre - last.centre))
        pieces.append(further)
        if crossings.arm(further):
            return pieces, False, ""
        last = further
    return pieces, False, f"a curve has more than {MOST_PIECES} pieces"
