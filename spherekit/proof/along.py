"""Where a variable stops along a chain: proven places, one in each, and none elsewhere.

Along a piece, z' = t + N w with (F_z N) w = -F_z t, so bounds of F_z in the piece are
bounds of the rates of all variables, and bounds of F_zz those of the rates' derivatives.
Between two neighbouring centres a rate that cannot vanish has no zero; one whose derivative
cannot vanish has one zero if its signs at both centres differ, and none if they do not.
All others are cut in two.

Configuration curves as chains of pieces, each with the centre of the next one in it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import final

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import SolveError
from spherekit.numeric.crossings import wrap
from spherekit.proof.equations import Equations
from spherekit.proof.folded import Crossings
from spherekit.proof.tubes import LONGEST, UP, Piece, corrected, piece_at

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


DEEPEST = 40
"""How often a part of a curve is cut in two at most."""
SHORTEST_PART = 1e-6
"""Shorter parts (rad) of a curve are not cut."""
SHORTEST_STILL = 0.02
"""Nor are these, if neither the rate nor its derivative has a sign at the centre."""
MOST_PARTS = 4000
PARTS_EACH = 40
"""Parts of a chain, and more for each piece, beyond which no short ones are made."""
NEAREST = 6e-10
"""Length (rad) of the part of a curve in which a zero is shown, about."""
STEPS = 60


@final
@dataclass(frozen=True)
class Rates:
    """Bounds of the rates (v,) by s in a part of a piece, and of their derivatives."""

    low: Floats
    high: Floats
    bend_low: Floats
    bend_high: Floats

    def sign(self, variable: int) -> int:
        """Return the sign that the rate of a variable has throughout, 0 if none."""
        return int(self.low[variable] > 0.0) - int(self.high[variable] < 0.0)

    def bend(self, variable: int) -> int:
        """Return the sign that the rate's derivative has throughout, 0 if none."""
        return int(self.bend_low[variable] > 0.0) - int(self.bend_high[variable] < 0.0)


def rates(piece: Piece, half: float) -> Rates:
    """Return bounds of the rates where |s| <= half."""
    at, t, normals = piece.at, piece.frame[:, 0], piece.frame[:, 1:]
    test = piece.test
    length = np.array(half)
    rows = float(np.max(test.rows(length, np.array(piece.radius)))) * UP
    tight = float(np.max(test.displacement(length))) / (1.0 - rows) * UP
    # the arc is in the piece; where rows come close to 1, that says more
    tight = min(tight, piece.radius)
    rows = float(np.max(test.rows(length, np.array(tight)))) * UP
    spare = 1.0 - rows
    change = test.sums(length, np.array(tight))
    inverse = test.inverse
    along = test.along
    crossed = np.sum(np.abs(np.einsum("ijl,j,lc->ic", at.curvatures, t, normals)), axis=1)
    third = 0.5 * at.constant * change**2 + at.error * (1.0 + change)
    slope = test.moved[:, 1] + half * test.moved[:, 2]
    slope = slope + inverse @ (crossed * tight + third * along)
    across = float(np.max(slope)) / spare * UP
    spread = np.sum(np.abs(normals), axis=1) * across * UP
    bend = -piece.inverse @ np.einsum("ijl,j,l->i", at.curvatures, t, t)
    size = np.abs(t) + spread
    ways = at.degrees @ size
    varied = (at.constant * change + at.error) * ways**2
    varied = varied + np.einsum(
        "ijl,j,l->i", np.abs(at.curvatures), np.abs(t) + size, spread
    )
    off = inverse @ varied + 1e-13 * (1.0 + inverse @ (at.constant * ways**2))
    off = (off + rows / spare * np.max(np.abs(bend) + off)) * UP
    middle = normals @ bend
    reach = np.abs(normals) @ off * UP + 1e-15 * (1.0 + np.abs(normals) @ np.abs(bend))
    return Rates(t - spread, t + spread, middle - reach, middle + reach)


@final
@dataclass(frozen=True)
class Stop:
    """A configuration where one variable stops along a curve, and nowhere else near it.

    `place` (v,) is off by at most `off` (rad) in every variable. `before` is the sign of
    the rate before it, in the sense of the chain, in which it comes `after` the centre of
    the piece of that number.
    """

    place: Floats
    off: float
    before: int
    after: int = 0


@final
@dataclass(frozen=True)
class Doubt:
    """A part of a chain, between two configurations, in which a variable may stop.

    It lies between the centre of piece number `after` and that of the next one; the
    variable is between `low` and `high` (rad) in it.
    """

    first: Floats
    last: Floats
    low: float
    high: float
    after: int = 0


def stops(
    equations: Equations, chain: Chain, variable: int
) -> tuple[list[Stop], list[Doubt]]:
    """Return where a variable stops along a chain, and the parts that are undecided.

    Raises
    ------
    SolveError
        If its rate does not change its sign back from one place to the next.
    """
    places: list[Stop] = []
    undecided: list[Doubt] = []
    parts = _Parts(equations, variable)
    for number, (piece, centre, off) in enumerate(_parts(chain)):
        parts.budget += PARTS_EACH
        for stop in parts.within(piece, centre, off, 0):
            if isinstance(stop, Stop):
                places.append(replace(stop, after=number))
            else:
                undecided.append(replace(stop, after=number))
    around = [*places, *(places[:1] if chain.closed else ())]
    if not undecided and any(one.before == two.before for one, two in pairwise(around)):
        raise SolveError(
            f"bounds of the rate of variable {variable} contradict each other along a "
            "curve, so nothing is certified; please report the mechanism"
        )
    return places, undecided


def _parts(chain: Chain) -> Iterator[tuple[Piece, Floats, float]]:
    """Yield every piece with the centre of the next one, and by how much that is off."""
    pieces: Sequence[Piece] = chain.pieces
    following = [*pieces[1:], *(pieces[:1] if chain.closed else ())]
    for piece, further in zip(pieces, following, strict=False):
        yield piece, further.centre, further.miss


@final
class _Parts:
    """The parts of a chain in which a rate is looked at."""

    def __init__(self, equations: Equations, variable: int) -> None:
        self.equations, self.variable = equations, variable
        self.budget = MOST_PARTS

    def within(
        self, piece: Piece, goal: Floats, off: float, depth: int
    ) -> Iterator[Stop | Doubt]:
        """Yield the zeros of the rate from a piece's centre to a goal in it, or doubts."""
        equations, variable = self.equations, self.variable
        self.budget -= 1
        reach = float(piece.coordinates(goal)[0]) + off + 1e-13
        here = rates(piece, min(reach, piece.half))
        if here.sign(variable):
            return
        if here.bend(variable):
            start = rates(piece, 0.0).sign(variable)
            end = _sign_at(equations, piece, goal, variable)
            if start and end:
                if start != end:
                    yield _place(equations, piece, goal, variable, start)
                return
            # an end whose sign is open stays one, however short the parts
            if reach < SHORTEST_STILL:
                yield _doubt(equations, piece, goal, reach, variable)
                return
        short = self.budget > 0 and _decidable(piece, variable)
        if reach < (SHORTEST_PART if short else SHORTEST_STILL):
            yield _doubt(equations, piece, goal, reach, variable)
            return
        middle = _middle(equations, piece, goal, 0.5 if depth % 2 else 0.47)
        if middle is None or depth >= DEEPEST or not middle.holds(goal, off):
            yield _doubt(equations, piece, goal, reach, variable)
            return
        yield from self.within(piece, middle.centre, middle.miss, depth + 1)
        yield from self.within(middle, goal, off, depth + 1)


def _doubt(
    equations: Equations, piece: Piece, goal: Floats, reach: float, variable: int
) -> Doubt:
    """Return the part of an arc from a piece's centre to a goal in it as undecided."""
    start = float(piece.centre[variable])
    end = start + float(wrap(goal - piece.centre)[variable])
    off = np.inf
    for longest in (1.1 * reach, 1.5 * reach, 3.0 * reach, None):
        near = piece
        if longest is not None:
            made = piece_at(equations, piece.centre, piece.tangent, longest, longest / 1.3)
            if made is None or not made.half >= reach:
                continue
            near = made
        here = rates(near, min(reach, near.half))
        rate = max(abs(float(here.low[variable])), abs(float(here.high[variable])))
        across = np.sum(np.abs(near.frame[variable, 1:])) * near.tight
        ahead = abs(float(near.frame[variable, 0])) * reach
        off = min(off, ahead + float(across), 1.001 * rate * reach + near.miss)
    off += 1e-12
    return Doubt(piece.centre, goal, min(start - off, end), max(start + off, end))


def _decidable(piece: Piece, variable: int) -> bool:
    """Return whether a rate, or its derivative, has a sign at a piece's centre."""
    here = rates(piece, 0.0)
    return bool(here.sign(variable) or here.bend(variable))


def _sign_at(equations: Equations, piece: Piece, goal: Floats, variable: int) -> int:
    """Return the sign of a rate at a configuration in a piece, in the piece's sense."""
    there = piece_at(equations, goal, piece.tangent, 1e-3)
    if there is None or not there.tangent @ piece.tangent > 1e-3:
        return 0
    return rates(there, 0.0).sign(variable)


def _middle(equations: Equations, piece: Piece, goal: Floats, part: float) -> Piece | None:
    """Return a piece around a configuration between a piece's centre and a goal in it."""
    apart = wrap(goal - piece.centre)
    place = corrected(equations, piece.centre + part * apart)
    if place is None:
        return None
    reach = float(piece.coordinates(goal)[0])
    there = float(piece.coordinates(place)[0])
    halfway = piece_at(equations, place, piece.tangent, max(2.0 * reach, SHORTEST_PART))
    if halfway is None or not 0.0 < there < reach or not piece.holds(place, halfway.miss):
        return None
    forward = halfway.coordinates(goal)[0] > 0.0
    return halfway if forward and halfway.tangent @ piece.tangent > 1e-3 else None


def _place(
    equations: Equations, piece: Piece, goal: Floats, variable: int, before: int
) -> Stop:
    """Return the only zero of a rate from a piece's centre to a goal, near its place."""
    beyond = 0.0
    for step in range(STEPS):
        length = float(np.max(np.abs(wrap(goal - piece.centre))))
        if length < NEAREST:
            break
        rate, part = float(piece.tangent[variable]), 0.5
        if step % 3 < 2 and rate * beyond < 0.0:
            # a little to the farther side, so that both ends move
            aside = 0.4 * NEAREST / length
            part = rate / (rate - beyond) + aside * (1 - 2 * (step % 2))
            part = float(np.clip(part, aside, 1.0 - aside))
        middle = _middle(equations, piece, goal, part)
        sign = 0 if middle is None else rates(middle, 0.0).sign(variable)
        if middle is not None and sign == -before:
            goal, beyond = middle.centre, float(middle.tangent[variable])
        elif middle is not None and sign and middle.holds(goal, 1e-10):
            piece = middle
        elif part == 0.5:
            break
        else:
            beyond = 0.0
    apart = wrap(goal - piece.centre)
    longest = max(4.0 * float(np.max(np.abs(apart))), 1e-8)
    around = piece_at(equations, piece.centre, piece.tangent, longest, 1e-12)
    if around is None or not around.holds(goal, 1e-10):
        around = piece
    reach = float(np.max(np.abs(around.coordinates(goal))))
    return Stop(piece.centre + 0.5 * apart, reach + 2.0 * around.tight + 1e-10, before)
