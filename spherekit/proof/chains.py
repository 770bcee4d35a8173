"""Configuration curves as chains of certified arcs.

The box of each arc contains the centre of the next one. Neighbouring arcs therefore have a
configuration in common and belong to one curve.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from spherekit.arrays import Floats
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.collinear_loops import Arm, Crossings
from spherekit.proof.tubes import (
    LONGEST_ARC_RAD,
    CertifiedArc,
    correct_configuration,
    find_piece,
)

NEXT_CENTRE_RATIO = 0.9
"""Distance to the next centre that is tried first, over the half length of an arc.

Larger: fewer arcs, more trials that fail. Smaller: more arcs that overlap more.
"""

CENTRE_RATIO_REDUCTION = 0.6
"""Each distance to the next centre that is tried, over the one before it.

Larger: more trials. Smaller: arcs overlap more than necessary.
"""

MIN_CENTRE_RATIO = 1e-3
"""Smallest distance to the next centre that is tried, over the half length of an arc.

Larger: a curve is given up sooner. Smaller: chains of many overlapping arcs.
"""

LENGTH_GROWTH = 1.6
"""Half length that is tried for the next arc, over the half length of the last arc.

Larger: more trials that fail. Smaller: arcs stay short after a sharp bend.
"""

MAX_CHAIN_PIECES = 6000
"""Largest number of arcs in a chain.

Larger: long curves are followed longer. Smaller: they are reported as not followed.
"""

RANGE_OVERSHOOT_RAD = 1e-9
"""Distance (rad) beyond the range of the input that a chain reaches at least.

Larger: more of each curve outside the range. Smaller: below the rounding of the input, a
gap between chain and range cannot be excluded.
"""

RangeSide = Callable[[float, float], int]
"""Returns on which side of its range the input is.

The arguments are the input's variable (rad) and a margin (rad). The result is 1 if the
variable exceeds the range by more than the margin, -1 if it is below the range by more than
the margin, else 0.
"""


@dataclass(frozen=True)
class Chain:
    """A configuration curve, or its part in the range of the input, as a row of boxes.

    Attributes
    ----------
    pieces
        The boxes, in the space of the variables, in order. Each is proven to contain
        exactly one arc (piece) of the curve, and contains the centre of the next box.
    closed
        Whether the curve returns to its start, up to whole turns of the variables. The ends
        of an open curve should be beyond the range, or where curves cross or nearly do.
    problem
        The reason if an end is at none of these places; otherwise empty.
    """

    pieces: Sequence[CertifiedArc]
    closed: bool
    problem: str = ""

    @property
    def successive_pieces(self) -> list[tuple[CertifiedArc, CertifiedArc]]:
        """Each piece with the next one; in a closed chain the first follows the last."""
        pieces = [*self.pieces]
        if self.closed:
            pieces.append(self.pieces[0])
        return list(pairwise(pieces))

    def may_repeat_start(self) -> bool:
        """Return whether the chain may pass through its start a second time.

        The start is the centre of the first piece (arc). A chain should go along its curve
        once. If it went round the curve twice, the assembly modes on the curve would be
        counted twice. The caller therefore reports a problem.
        """
        start = self.pieces[0].centre
        # Each section of the curve leads from the centre of a piece to that of the next.
        # The first section begins at the start. In a closed chain the last one ends there.
        sections = self.successive_pieces
        other_sections = sections[1:-1] if self.closed else sections[1:]
        return any(
            _may_be_between(start, piece, next_piece)
            for piece, next_piece in other_sections
        )


def _may_be_between(
    configuration: Floats, piece: CertifiedArc, next_piece: CertifiedArc
) -> bool:
    """Return whether a curve may pass a configuration between the centres of two arcs.

    The caller tests in this way whether a curve may pass its start a second time.

    Parameters
    ----------
    configuration
        (v,) values of all variables (rad).
    piece
        An arc (piece) of the curve, with a box about it that contains no other part of any
        curve. The axis of the box is the tangent of the arc at the centre of the arc.
    next_piece
        The next arc. Its centre is in the box of `piece`.
    """
    # Coordinates in the box: `along` its axis, 0 at the centre of the arc, and `across` it,
    # where the box ends at `radius`.
    along, *across = piece.coordinates(configuration)
    next_centre_along = piece.coordinates(next_piece.centre)[0]
    # The box is enlarged by 1e-9 rad for rounding, so that no passage is missed.
    is_near_axis = np.all(np.abs(across) <= piece.radius + 1e-9)
    return bool(is_near_axis and -1e-9 <= along <= next_centre_along + 1e-9)


def find_chain(
    equations: ArcEquations, first: CertifiedArc, side: RangeSide, crossings: Crossings
) -> Chain | None:
    """Return the whole curve of configurations through an arc, as a chain of arcs.

    Each arc is certified: it is proven to be the only arc in a box. The curve is followed
    until it closes, leaves the range of the input, or ends at a crossing (a place where
    curves cross or narrowly miss each other). New crossings are added to `crossings`.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    first
        An arc of the curve.
    side
        Function of the input's variable and of a margin (both rad). It returns 1 if the
        variable is above its range by more than the margin, -1 if it is below by more than
        the margin, else 0.
    crossings
        The crossings that the search has found so far.

    Returns
    -------
    The chain. If it ends at another place, its `problem` says why. None if the first arc
    turns out to be at a crossing.
    """
    chain = _follow_forward(equations, first, side, crossings)
    if not chain.closed:
        # From the end, follow the curve back to its other end. This chain is complete, but
        # its `problem` is only that of the other end. A problem of the first end is kept.
        problem = chain.problem
        last = _reverse(chain.pieces[-1])
        chain = _follow_forward(equations, last, side, crossings)
        chain = replace(chain, problem=problem or chain.problem)
    # Following the curve can add a crossing at its start, so this is tested last.
    return None if crossings.may_contain(first.centre, first.centre_error) else chain


def _reverse(piece: CertifiedArc) -> CertifiedArc:
    """Return the same certified arc with the opposite tangent, to follow it backward.

    The arc is the only one in a box. The proof stays valid: the box is symmetric about its
    centre, and the bounds of the `test` apply to both directions.
    """
    frame = piece.frame.copy()
    frame[:, 0] *= -1.0
    return replace(piece, frame=frame)


def find_piece_ahead(
    equations: ArcEquations, piece: CertifiedArc, position: Floats, longest: float
) -> CertifiedArc | None:
    """Return a certified arc that continues another arc of a configuration curve.

    A certified arc, or piece, is a box in which all configurations form exactly one arc of
    a curve. The new arc must satisfy two conditions. The new centre is in the box of the
    previous arc, so that both arcs belong to one curve. And the new centre is ahead of the
    previous one, so that the curve is followed in one direction.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    piece
        The arc that is continued. Its tangent points in the direction of the continuation.
    position
        (v,) position (rad) near which the centre of the new arc is searched.
    longest
        Largest half length (rad) that is tried.

    Returns
    -------
    The new arc. None if no arc is proven near the position, or if a condition fails.
    """
    configuration = correct_configuration(equations, position)
    if configuration is None:
        return None
    next_piece = find_piece(equations, configuration, piece.tangent, longest)
    if next_piece is None:
        return None
    # The first coordinate in the box of an arc is along its tangent.
    distance_ahead = piece.coordinates(next_piece.centre)[0]
    if not distance_ahead > 0.0:
        return None
    if not piece.contains(next_piece.centre, next_piece.centre_error):
        return None
    return next_piece


def _find_next_piece(equations: ArcEquations, last: CertifiedArc) -> CertifiedArc | None:
    """Return the arc that continues a chain after its last arc, None if none is proven.

    A chain is a configuration curve as a row of certified arcs (pieces), each in a box that
    contains no other configurations. The centre of the next arc is searched ahead of the
    centre of the last arc, on its tangent. Shorter and shorter distances between both
    centres are tried, until an arc can be proven.
    """
    # The distance between both centres, divided by the half length of the last arc.
    ratio = NEXT_CENTRE_RATIO
    # An arc is at most `LENGTH_GROWTH` times as long as the one before.
    longest_half_length = min(LONGEST_ARC_RAD, LENGTH_GROWTH * last.half_length)
    while ratio > MIN_CENTRE_RATIO:
        position = last.centre + ratio * last.half_length * last.tangent
        next_arc = find_piece_ahead(equations, last, position, longest_half_length)
        if next_arc is not None:
            return next_arc
        ratio *= CENTRE_RATIO_REDUCTION
    return None


def _follow_forward(
    equations: ArcEquations, start: CertifiedArc, side: RangeSide, crossings: Crossings
) -> Chain:
    """Return the chain from an arc on, until it closes or ends.

    The curve is followed in the direction of the tangent of the first arc. The curve ends
    outside the range of the input, or on an arm: a branch that leaves a crossing of curves.
    If the start is already at such an end, the curve is followed until it has left this end
    and arrives at another one.

    Parameters
    ----------
    equations, side, crossings
        See `find_chain`.
    start
        The first arc of the chain.
    """

    def end_of_curve(piece: CertifiedArc) -> Arm | int | None:
        """Return the end of the curve that an arc has reached, 0 if it is at no end.

        The curve ends where it meets a crossing of curves, or leaves the range of the
        input. The result is then an arm (branch that leaves the crossing), or 1 above the
        range and -1 below it.
        """
        # The input's variable is the last one.
        overshoot = max(piece.euclidean_distance, RANGE_OVERSHOOT_RAD)
        return crossings.arm(piece) or side(piece.centre[-1], overshoot)

    pieces = [start]
    distance_covered = 0.0
    end_to_leave = end_of_curve(start)
    while True:
        last = pieces[-1]
        end = end_of_curve(last)
        if end and end != end_to_leave:
            return Chain(pieces, closed=False)
        # Here the arc is at no end, or still at the end where the curve started. Once the
        # curve has left that end, any end stops it.
        if not end:
            end_to_leave = end
        # The chain closes if the start is in the box of the last arc, ahead of its centre,
        # and both tangents have the same sense. At first the curve must leave the box of
        # the first arc.
        has_left_start = distance_covered > 1.5 * start.half_length
        start_is_ahead = has_left_start and last.coordinates(start.centre)[0] > 0
        has_same_sense = last.tangent @ start.tangent > 0.5
        if (
            start_is_ahead
            and has_same_sense
            and last.contains(start.centre, start.centre_error)
        ):
            return Chain(pieces, closed=True)
        if len(pieces) >= MAX_CHAIN_PIECES:
            problem = f"a curve has more than {MAX_CHAIN_PIECES} pieces"
            return Chain(pieces, closed=False, problem=problem)
        next_piece = _find_next_piece(equations, last)
        if next_piece is None:
            # Near a crossing no arc can be proven. If a new crossing is found here, it is
            # added to `crossings`. Its box may contain earlier arcs of this chain, so the
            # curve is followed once more. The number of crossings is limited, and so is the
            # number of repetitions.
            if crossings.find(last.centre):
                return _follow_forward(equations, start, side, crossings)
            return Chain(
                pieces, closed=False, problem="a curve could not be followed to its end"
            )
        distance_covered += float(np.linalg.norm(next_piece.centre - last.centre))
        pieces.append(next_piece)
