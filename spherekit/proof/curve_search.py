"""Search for configuration curves and crossings near boxes that are not proven empty."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import TURN
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.chains import Chain, RangeSide, find_chain
from spherekit.proof.collinear_loops import MAX_SADDLES, Arm, Crossings
from spherekit.proof.paving import SEARCHED_BOXES, BoxSet
from spherekit.proof.saddles import Saddle
from spherekit.proof.tubes import (
    COORDINATE_ROUNDING_RAD,
    LONGEST_ARC_RAD,
    ROUND_UP,
    CertifiedArc,
    boxes_covered,
    correct_configuration,
    find_piece,
)

TRIED_NEIGHBOURS = 8
"""Number of arcs with the nearest centres that are tried to cover a box.

Larger: longer tests of each box. Smaller: boxes inside an arc are overlooked and halved.
"""

OVERLAPPING = "two curves found may be one, so that modes are not counted"
"""The problem of a search in which two chains may belong to one curve."""

OUTSIDE_RANGE_RAD = 1e-9
"""Distance (rad) of the input from its range beyond which a configuration is ignored.

Larger: curves just outside the range are found too. Smaller: rounding decides whether a
configuration at the end of the range counts.
"""


@dataclass(frozen=True)
class ArmUse:
    """One arm of a saddle and the chains that end on it.

    Where two configuration curves cross, or narrowly miss each other, they are the zeros of
    a function g(u, v) near a saddle point of g. This place is called a saddle. The four
    branches of curves that leave it, its arms, are each in one quadrant of u and v. A chain
    is a curve as a row of certified arcs.

    Attributes
    ----------
    arm
        The number of the saddle, and the quadrant of the arm: the signs of u and v on it.
    chain_ends
        Number of ends of chains on the arm; there should be one.
    input_sign
        Sign of the rate of the input along the arm, away from the saddle; 0 if not proven.
    """

    arm: Arm
    chain_ends: int
    input_sign: int


class CurveSearch:
    """The configuration curves that are known so far in the range of the only input.

    Parameters
    ----------
    equations
        The equations of the mechanism. The input's variable is the last one.
    side
        Function of the input's variable (rad) and of a margin (rad). It returns on which
        side of its range the input is: 1 above, -1 below, 0 within.

    Attributes
    ----------
    chains
        The curves as chains of certified arcs: boxes that contain exactly one arc each.
    crossings
        The saddles: places where curves cross or narrowly miss each other.
    has_lost_piece
        Whether a part of a chain was not found again after a saddle had been added.
    """

    def __init__(self, equations: ArcEquations, side: RangeSide) -> None:
        """Begin without curves and saddles."""
        self.equations = equations
        self.side = side
        self.crossings = Crossings(equations)
        self.has_lost_piece = False
        self._set_chains([])

    def _set_chains(self, chains: list[Chain]) -> None:
        """Replace the chains, and store the boxes of their arcs in arrays.

        A chain is a curve as a row of arcs (pieces), each alone in an oriented box. Later
        tests ask which configurations or boxes are inside the box of an arc. They use the
        arrays, and a search tree of the centres of the boxes.
        """
        self.chains = chains
        pieces = [piece for chain in chains for piece in chain.pieces]
        count = self.equations.variable_count
        # Arrays (pieces, ...) of centres, frames and limits, for tests of many boxes.
        self._centres = np.reshape([piece.centre for piece in pieces], (-1, count))
        self._frames = np.reshape([piece.frame for piece in pieces], (-1, count, count))
        self._limits = np.reshape([piece.limits for piece in pieces], (-1, count))
        if pieces:
            from scipy.spatial import cKDTree

            # A tree cannot be made without boxes, and `covers` needs none then. Angles that
            # differ by a turn are the same.
            periods = np.full(count, TURN)
            self._tree = cKDTree(_within_one_turn(self._centres), boxsize=periods)

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return which boxes (n,) are surely inside the box of a known arc or saddle.

        All configurations in such a box are on known curves, so it need not be searched.
        Each known arc has an oriented box, with sides along its tangent and normals. This
        box is proven to contain no other configurations. Saddles, places where curves cross
        or nearly do, have oriented boxes too. Only the arcs with the nearest centres are
        tried, so a box inside the box of a farther arc may be overlooked.

        Parameters
        ----------
        centres, radii
            (n, v) centres and half widths (rad) of the boxes in the space of all variables.
        """
        is_covered = boxes_covered(self.crossings.saddles, centres, radii)
        tried_count = min(TRIED_NEIGHBOURS, len(self._centres))
        if not tried_count:
            return is_covered
        # Boxes that are larger than the box of every arc are not tried. `_limits` are the
        # half lengths of the boxes of arcs.
        can_fit = np.max(radii, axis=1) < np.max(self._limits)
        rows = np.flatnonzero(~is_covered & can_fit)
        # (n, tried arcs) the numbers of the arcs with the nearest centres, the nearest
        # first. The search tree accepts only angles from 0 to 2 pi.
        _, neighbours = self._tree.query(
            _within_one_turn(centres[rows]), k=range(1, tried_count + 1)
        )
        # Half width of each box along the sides of the oriented box: n boxes, k arcs, v
        # variables, w sides.
        reach = np.einsum("nv,nkvw->nkw", radii[rows], np.abs(self._frames[neighbours]))
        # It is enlarged by bounds of the rounding errors of this sum and of coordinates, so
        # that a box outside cannot count as inside.
        is_inside = self._are_inside(
            neighbours, centres[rows, None], reach * ROUND_UP + COORDINATE_ROUNDING_RAD
        )
        is_covered[rows] = np.any(is_inside, axis=1)
        return is_covered

    def _are_inside(self, pieces: Any, positions: Floats, reach: Floats | float) -> Bools:
        """Return whether positions (..., v) with a reach are inside the boxes of arcs.

        The box of an arc is oriented along its tangent and normals, the frame.

        Parameters
        ----------
        pieces
            Numbers (...) of the arcs, or a mask or slice that chooses arcs.
        positions
            (..., v) positions (rad).
        reach
            Distance (rad) by which a position must be inside, along each frame direction.
            A negative reach also accepts positions outside by this distance.
        """
        offsets = wrap(positions - self._centres[pieces])
        coordinates = np.abs(np.einsum("...v,...vw->...w", offsets, self._frames[pieces]))
        return np.all(coordinates + reach <= self._limits[pieces], axis=-1)

    def add_configuration(self, position: Floats) -> bool:
        """Follow the curve through a configuration (v,), if it is in the range.

        v variables are in rad, the input's variable is the last one.

        Returns
        -------
        Whether the number of known curves (chains) or of crossings (saddles) has changed.
        """
        counts_before = len(self.chains), len(self.crossings.saddles)
        if not self.side(position[-1], OUTSIDE_RANGE_RAD):
            self._add_curve(position)
        return (len(self.chains), len(self.crossings.saddles)) != counts_before

    def resolve_undecided(self, undecided: BoxSet) -> BoxSet:
        """Search saddles in undecided boxes, and return the boxes outside all saddles.

        An undecided box is neither proven to contain no configurations, nor inside the box
        of a known arc. A saddle is a place where curves cross or narrowly miss each other.
        Curves that are known so far (chains) and pass a new saddle are cut there.
        """
        centres = undecided.centres
        radii = undecided.radii
        # Each round adds one saddle, or ends the search.
        for _ in range(MAX_SADDLES):
            # A few evenly chosen boxes are enough: a saddle covers many of them.
            some_centres = centres[:: max(1, len(centres) // SEARCHED_BOXES)]
            # `find` adds the saddle near a box, if there is one. The first one is enough,
            # since it may cover the boxes that would be tried next.
            has_new_saddle = any(self.crossings.find(centre) for centre in some_centres)
            if not has_new_saddle:
                break
            new_saddle = self.crossings.saddles[-1]
            self._cut_chains([new_saddle])
            is_open = ~boxes_covered(self.crossings.saddles, centres, radii)
            centres = centres[is_open]
            radii = radii[is_open]
        # An arm, a branch of a curve that leaves a saddle, may leave the range of the input
        # inside the box of the saddle. No curve was followed along it so far.
        self._add_chains_of_short_arms()
        return BoxSet(centres, radii)

    def _add_curve(self, position: Floats) -> None:
        """Add the curve through a configuration (v,), unless it is known already.

        A chain represents a curve by successive arcs. Each arc is in a box without other
        configurations. The new curve may lead to saddles, places where curves cross or
        nearly do. New saddles are added, and earlier chains through them are cut there.
        """
        # The error of the position is 0 here, because only the point itself is tested.
        if self._is_known(position, 0.0):
            return
        saddle_count = len(self.crossings.saddles)
        # The arc about the configuration. Its tangent may point either way along the curve.
        first = find_piece(
            self.equations, position, direction=None, longest=LONGEST_ARC_RAD
        )
        if first is None or self._is_known(first.centre, first.centre_error):
            return
        # The curve is followed to the ends of the range of the input, or to arms of saddles
        # (the four branches of curves that leave a saddle). `self.side` returns -1, 0
        # or 1 if the input is below, in or above the range.
        chain = find_chain(self.equations, first, self.side, self.crossings)
        if chain is not None:
            # A closed chain is a whole curve. An earlier chain may be a part of it that
            # could not be followed further. It is such a part if its start is in the box of
            # an arc of the closed chain, which contains no other curve. It is then dropped.
            closed_pieces = chain.pieces if chain.closed else ()
            other_chains = []
            for earlier in self.chains:
                start = earlier.pieces[0]
                if not any(
                    piece.contains(start.centre, start.centre_error)
                    for piece in closed_pieces
                ):
                    other_chains.append(earlier)
            self._set_chains([*other_chains, chain])
        if new_saddles := self.crossings.saddles[saddle_count:]:
            self._cut_chains(new_saddles)

    def _cut_chains(self, saddles: Sequence[Saddle]) -> None:
        """Replace chains that pass new saddles by chains that end at these saddles.

        A chain is a curve as a row of certified arcs (`pieces`). A saddle is a place where
        curves cross or narrowly miss each other. It may divide a curve into several parts,
        so the curve is followed again from every arc of the old chain that is in the range
        of the input. Each part then ends on an arm: a branch of a curve that leaves a
        saddle. If an arc of the old chain is finally on no new chain and in no saddle,
        `has_lost_piece` is set.
        """
        untouched_chains: list[Chain] = []
        cut_chains: list[Chain] = []
        for chain in self.chains:
            passes_saddle = any(
                saddle.may_contain(piece.centre, piece.centre_error)
                for saddle in saddles
                for piece in chain.pieces
            )
            if passes_saddle:
                cut_chains.append(chain)
            else:
                untouched_chains.append(chain)
        # From now on, the cut chains are no longer known.
        self._set_chains(untouched_chains)
        for chain in cut_chains:
            pieces = self._pieces_in_range(chain)
            for piece in pieces:
                # This does nothing if the arc is on a new chain already, or in a saddle.
                self._add_curve(piece.centre)
            self.has_lost_piece |= not all(
                self._is_known(piece.centre, piece.centre_error) for piece in pieces
            )

    def _pieces_in_range(self, chain: Chain) -> list[CertifiedArc]:
        """Return the arcs of a chain whose centre is in the range of the input.

        A chain is a configuration curve as a row of certified arcs.
        """
        return [piece for piece in chain.pieces if not self.side(piece.centre[-1], 0.0)]

    def _is_known(self, position: Floats, error: float) -> bool:
        """Return whether a known arc or saddle may contain a configuration.

        A saddle is a place where curves cross or nearly do. The configuration is at most
        `error` (rad) from `position` (v,) in each variable.
        """
        # A negative reach also accepts positions that are outside of a box by the error.
        reach = -error - COORDINATE_ROUNDING_RAD
        is_in_arc = self._are_inside(slice(None), position, reach)
        return bool(np.any(is_in_arc)) or self.crossings.may_contain(position, error)

    def _has_overlapping_chains(self) -> bool:
        """Return whether two chains may have a configuration in common.

        A chain is a curve as a row of certified arcs, each in a box without other
        configurations. The centres of arcs that are in the range of the input are tested:
        none may be in the box of an arc of another chain.
        """
        counts = [len(chain.pieces) for chain in self.chains]
        chain_of_piece = np.repeat(np.arange(len(counts)), counts)
        for number, chain in enumerate(self.chains):
            is_other = chain_of_piece != number
            for piece in self._pieces_in_range(chain):
                # The centre is known up to an error. A negative reach also accepts centres
                # that are outside of a box by this error.
                reach = -piece.centre_error - COORDINATE_ROUNDING_RAD
                if np.any(self._are_inside(is_other, piece.centre, reach)):
                    return True
        return False

    def _list_arm_uses(self) -> Iterator[ArmUse]:
        """Yield all arms of all saddles with the number of chains that end on them.

        A saddle is a place where curves of configurations cross or nearly do. An arm is one
        of the four branches of curves that leave it. A chain is a curve as a row of arcs;
        exactly one chain should end on each arm.
        """
        end_counts = Counter(
            arm
            for chain in self.chains
            for arm in self.crossings.chain_ends(chain.pieces, chain.closed)
        )
        for number, saddle in enumerate(self.crossings.saddles):
            # The quadrants (1, 1), (1, -1), (-1, 1), (-1, -1) in this order. A fixed order
            # makes results repeatable, because the caller may add a chain for each arm.
            for quadrant in sorted(saddle.outward_signs, reverse=True):
                arm = number, quadrant
                # The signs of the rates of all variables along the arm, away from the
                # saddle. The input's variable is the last one.
                rate_signs = saddle.outward_signs[quadrant]
                yield ArmUse(arm, end_counts[arm], input_sign=rate_signs[-1])

    def _has_unmatched_arm(self) -> bool:
        """Return whether arms and ends of chains may fail to match one to one.

        A chain is a curve as a row of arcs. A saddle is a place where curves cross or
        nearly do, and an arm is one of the four branches of curves that leave it. Exactly
        one chain has to end on each arm. Only an arm that leads out of the range of the
        input needs no chain. A chain that passes a saddle without ending there would stand
        for two arms, and is not allowed either.
        """
        if any(self._touches_saddle_inside(chain) for chain in self.chains):
            return True
        for use in self._list_arm_uses():
            saddle_number, _quadrant = use.arm
            saddle = self.crossings.saddles[saddle_number]
            # The last variable of a configuration is the input. The side is 1 if the saddle
            # is above the range of the input, -1 if it is below, else 0. A saddle less than
            # `OUTSIDE_RANGE_RAD` inside an end counts as outside.
            saddle_input = saddle.centre[-1]
            side = self.side(saddle_input, -OUTSIDE_RANGE_RAD)
            # `input_sign` is 1 if the input grows along the arm, away from the saddle, -1
            # if it decreases. The arm leads out of the range if both signs are equal.
            leads_out = use.input_sign * side > 0
            if use.chain_ends > 1 or (use.chain_ends == 0 and not leads_out):
                return True
        return False

    def _add_chains_of_short_arms(self) -> None:
        """Add a chain of one arc for each arm that leaves the range near its saddle.

        A saddle is a place where curves cross or nearly do. An arm is one of the four
        branches of curves that leave it, each in one quadrant of two coordinates. A chain
        is a curve as a row of arcs. If the part of an arm in the range of the input is
        inside the box of the saddle, no chain was followed there. Modes are counted along
        chains, from the saddle to the other end. The arm therefore gets a chain of one arc,
        just outside of the range.
        """
        # Each `use` is an arm with the number of chains that end on it.
        for use in self._list_arm_uses():
            if use.chain_ends:
                continue
            # Find a certified arc on the arm, near the border of the box of the saddle.
            saddle_number, quadrant = use.arm
            saddle = self.crossings.saddles[saddle_number]
            position = correct_configuration(
                self.equations, saddle.point_near_arm(quadrant)
            )
            if position is None:
                continue
            piece = find_piece(
                self.equations, position, direction=None, longest=LONGEST_ARC_RAD
            )
            if piece is None or self.crossings.arm(piece) != use.arm:
                continue
            # The arc has to be outside the range: above it (side 1) if the input grows
            # along the arm (sign 1), below it (side -1) if the input decreases (sign -1).
            # The input's variable is the last one.
            input_variable = piece.centre[-1]
            no_margin = 0.0
            side = self.side(input_variable, no_margin)
            if use.input_sign * side > 0:
                self._set_chains([*self.chains, Chain((piece,), closed=False)])

    def _touches_saddle_inside(self, chain: Chain) -> bool:
        """Return whether a chain may touch a saddle other than on the arms at its ends.

        A chain represents a curve by successive arcs. A saddle is a place where curves
        cross or nearly do, and an arm is one of the four branches of curves that leave it.
        A chain should begin and end on arms and must not pass through a saddle. Arcs at its
        ends that are on the arm of this end are therefore allowed. Every other arc is
        tested: none may be in the box of a saddle. If all arcs are on one arm, none is left
        to test.
        """
        pieces = chain.pieces
        arms = [self.crossings.arm(piece) for piece in pieces]

        def count_on_arm(end_arm: Arm | None, arms_from_end: list[Arm | None]) -> int:
            """Return how many arcs at one end of the chain are on the arm of this end.

            An arm is one of the branches of curves that leave a crossing. `end_arm` is the
            arm on which the chain ends there. `arms_from_end` has the arm of each arc of
            the chain, beginning at this end. None stands for no arm. The count stops at the
            first arc that is not on `end_arm`.
            """
            on_arm = takewhile(
                lambda arm: arm is not None and arm == end_arm, arms_from_end
            )
            return len([*on_arm])

        first_arm, last_arm = self.crossings.chain_ends(pieces, chain.closed)
        first_count = count_on_arm(first_arm, arms)
        last_count = count_on_arm(last_arm, arms[::-1])
        return any(
            self.crossings.may_contain(piece.centre, piece.centre_error)
            for piece in pieces[first_count : len(pieces) - last_count]
        )

    def problems(self) -> list[str]:
        """Return why chains are not whole curves, or may belong to one curve."""
        problems = [chain.problem for chain in self.chains if chain.problem]
        if (
            self.has_lost_piece
            or self._has_overlapping_chains()
            or self._has_unmatched_arm()
        ):
            problems.append(OVERLAPPING)
        if any(chain.may_repeat_start() for chain in self.chains):
            problems.append("a curve may have been gone round twice")
        return problems


def _within_one_turn(angles: Floats) -> Floats:
    """Return angles (rad) in [0, 2 pi), as the search tree requires."""
    remainders = np.remainder(angles, TURN)
    # The remainder of a tiny negative number rounds to a whole turn.
    return np.where(remainders >= TURN, 0.0, remainders)
