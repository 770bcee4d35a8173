"""Where a variable stops along a chain: proven places, one in each, and none elsewhere.

Along a piece, z' = t + N w with (F_z N) w = -F_z t, so bounds of F_z in the piece are
bounds of the rates of all variables, and bounds of F_zz those of the rates' derivatives.
Between two neighbouring centres a rate that cannot vanish has no zero; one whose derivative
cannot vanish has one zero if its signs at both centres differ, and none if they do not.
All others are cut in two.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.numerics.angles import wrap
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.proof.arc_equations import Equations
from spherekit.proof.balls import circle
from spherekit.proof.chains import Chain, _ahead
from spherekit.proof.tubes import (
    ROUNDING,
    UP,
    CertifiedArc,
    corrected,
    frame_at,
    piece_at,
)

DEEPEST = 40
"""How often a part of a curve is cut in two at most."""
SHORTEST_PART = 1e-6
"""Shorter parts (rad) of a curve are not cut."""
SHORTEST_STILL = 0.02
"""Nor are these, if neither the rate nor its derivative has a sign at the centre."""
MOST_PARTS = 4000
PARTS_EACH = 40
"""Parts of a chain, and more for each piece, beyond which no short ones are made."""
NEAREST, WIDER = 3.6e-10, 4.0
"""Length (rad) of a part of a curve in which a zero is shown, and the next over it."""


def rates(piece: CertifiedArc, half: float) -> Floats:
    """Return bounds (2, 2, v) where |s| <= half: of the rates by s and their derivatives.

    Of each the lower ones come first.
    """
    test, t, normals = piece.test, piece.frame[:, 0], piece.frame[:, 1:]
    tight = piece.beside(half)
    _, rows, across = test.arc(half, tight)
    spread = np.sum(np.abs(normals), axis=1) * across * UP
    # z'' = -N (F' N)^-1 F''(z', z'), and z' along the frame is 1 and at most `across`
    reach, size = np.append(half, 0.0 * t[1:] + tight), np.append(1.0, 0.0 * t[1:] + across)
    sums = test.degrees @ reach
    varied = (test.constant * sums + test.error) * (test.degrees @ size) ** 2
    bend, sizes = -test.bent[:, 0, 0], np.abs(test.bent)
    off = (test.size @ varied + sizes @ size @ size - sizes[:, 0, 0]) * UP
    off = (off + rows / (1.0 - rows) * np.max(np.abs(bend) + off)) * UP + 1e-15
    middle, beside = normals @ bend, np.abs(normals) @ off * UP
    return np.array([[t - spread, t + spread], [middle - beside, middle + beside]])


def signs(piece: CertifiedArc, half: float, variable: int) -> Indices:
    """Return signs that a rate and its derivative have where |s| <= half, 0 if none."""
    low, high = rates(piece, half)[:, :, variable].T
    return (low > 0.0).astype(int) - (high < 0.0)


@dataclass(frozen=True)
class StationaryPlace:
    """A configuration where one variable stops along a curve, and nowhere else near it.

    Or, as is said beside it, where it may stop. `place` (v,) is off by at most `off` (rad)
    in every variable, or in that one. It comes `after` the centre of the piece of that
    number.
    """

    place: Floats
    off: float
    after: int = 0


Stops = tuple[list[StationaryPlace], list[StationaryPlace]]
"""Where a variable stops along a chain, and where it may stop."""


def stops(equations: Equations, chain: Chain, variable: int) -> Stops:
    """Return where a variable stops along a chain, and the parts that are undecided.

    Neighbours along which the derivative has one sign are seen as one, since the rate then
    passes all its zeros the same way: its sign where they meet may be open.
    """
    made: Stops = [], []
    budget, begun, sign, sense, kept = MOST_PARTS, chain.pieces[0], 0, 0, 0
    for number, (first, further) in enumerate(chain.links):
        budget += PARTS_EACH
        waiting = [(first, further.centre, further.miss, 0)]
        while waiting:
            budget -= 1
            piece, goal, off, depth = waiting.pop()
            part = _part(equations, variable, piece, goal, off, depth, budget > 0)
            if isinstance(part, CertifiedArc):
                waiting += [
                    (part, goal, off, depth + 1),
                    (piece, part.centre, part.miss, depth + 1),
                ]
                continue
            before, bend, end = part or (0, 0, 0)
            if not bend or bend != sense or not begun.holds(goal, off):
                begun, sign, kept = piece, before, len(made[1])
            decided = sign and bend and end
            if decided:
                del made[1][kept:]
            if decided and sign != end:
                place = _place(equations, begun, goal, off, variable, end)
                made[0].append(replace(place, after=number))
            elif part and not decided:
                place = _doubt(piece, goal, off, variable)
                made[1].append(replace(place, after=number))
            sense = 0 if decided else bend
    return made


def _part(
    equations: Equations,
    variable: int,
    piece: CertifiedArc,
    goal: Floats,
    off: float,
    depth: int,
    short: bool,
) -> tuple[int, int, int] | CertifiedArc | None:
    """Return what a variable does from a piece's centre to a goal in it, off by `off`.

    It does not stop; or signs say what it does, 0 where they are open: of its rate at the
    centre, of the derivative all along and of the rate at the goal; or it is seen in the
    two parts at the piece returned. Parts are `short` only if that is wanted, and helps.
    """
    reach = piece.coordinates(goal)[0] + off + 1e-13
    rate, bend = signs(piece, min(reach, piece.half), variable)
    if rate:
        return None
    before, end, least = signs(piece, 0.0, variable), 0, SHORTEST_STILL
    if bend:
        there = piece_at(equations, goal, piece.tangent, 1e-3)
        if there is not None and there.tangent @ piece.tangent > 1e-3:
            end = signs(there, 0.0, variable)[0]
        # an end whose sign is open stays one, however short the parts
    elif short and any(before):
        least = SHORTEST_PART
    if not (before[0] and end) and reach >= least and depth < DEEPEST:
        middle = _middle(equations, piece, goal, 0.5 if depth % 2 else 0.47)
        if middle is not None and middle.holds(goal, off):
            return middle
    return before[0], bend, end


def _doubt(piece: CertifiedArc, goal: Floats, off: float, variable: int) -> StationaryPlace:
    """Return where a variable may stop from a piece's centre to a goal, off by `off`."""
    reach = min(piece.coordinates(goal)[0] + off + 1e-13, piece.half)
    fastest = np.max(np.abs(rates(piece, reach)[0, :, variable]))
    beside = [piece.beside(reach)] * (len(goal) - 1)
    spread = np.abs(piece.frame[variable]) @ [reach, *beside]
    off = min(spread, 1.001 * fastest * reach + piece.miss) + 1e-12
    return StationaryPlace(piece.centre, off)


def _middle(
    equations: Equations, piece: CertifiedArc, goal: Floats, part: float
) -> CertifiedArc | None:
    """Return a piece between a piece's centre and a goal in it, about so far on the way."""
    reach = piece.coordinates(goal)[0]
    place = piece.centre + part * wrap(goal - piece.centre)
    halfway = _ahead(equations, piece, place, max(2.0 * reach, SHORTEST_PART))
    if halfway is None or not piece.coordinates(halfway.centre)[0] < reach:
        return None
    forward = halfway.coordinates(goal)[0] > 0.0
    return halfway if forward and halfway.tangent @ piece.tangent > 1e-3 else None


def _place(
    equations: Equations,
    piece: CertifiedArc,
    goal: Floats,
    off: float,
    variable: int,
    beyond: int,
) -> StationaryPlace:
    """Return the only zero of a rate from a piece's centre to a goal in it, near its place.

    `beyond` is the sign of the rate at the goal, which is off by `off`.
    """
    way = wrap(goal - piece.centre)
    length = np.max(np.abs(way))

    def rate(parts: Floats, _: Indices) -> Floats:
        """Return the rate, negative at the centre, part of the way; nothing rests on it."""
        place = corrected(equations, piece.centre + parts[0] * way)
        turns = circle((piece.centre if place is None else place)[None])
        made = frame_at(equations.real.derivatives(turns, 1)[1][0], piece.tangent)
        return beyond * (np.zeros(1) if made is None else made[0][variable, :1])

    one = np.ones(1)
    (part,), _ = find_bracketed_zeros(rate, 0.0 * one, one, -one, one, ROUNDING)
    start, end, width = piece, goal, NEAREST
    while width < length and (start is piece or end is goal):
        for side in (1, -1):
            made = _middle(equations, piece, goal, part + 0.5 * side * width / length)
            if made is None or signs(made, 0.0, variable)[0] != side * beyond:
                continue
            if side > 0:
                end, off = made.centre, made.miss
            elif made.holds(end, off):
                start = made
        width *= WIDER
    reach = start.coordinates(end)[0] + off + 1e-13
    # the middle of start and end is about as far beside the axis as the zero
    beside = [2.0 * start.beside(reach) + off] * (len(goal) - 1)
    spread = np.max(np.abs(start.frame) @ [0.5 * (reach + off), *beside]) + 1e-12
    return StationaryPlace(start.centre + 0.5 * wrap(end - start.centre), spread)
