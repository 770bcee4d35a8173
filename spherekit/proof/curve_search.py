"""Search for configuration curves and crossings near boxes that are not proven empty."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import TURN
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.chains import Chain, RangeSide, find_chain
from spherekit.proof.collinear_loops import MAX_SADDLES, Arm, Crossings
from spherekit.proof.paving import SEARCHED_BOXES, BoxSet
from spherekit.proof.saddle_arms import Quadrant
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
    """One arm of a saddle, and the number of curves that end on it.

    A saddle is a place where two configuration curves cross, or narrowly miss each other.
    Four branches of curves, its arms, leave it. A search is complete if exactly one known
    curve ends on each arm. A known curve is a chain, a row of certified arcs.

    Attributes
    ----------
    saddle
        The saddle that the arm leaves.
    quadrant
        Which of the four arms it is. The saddle has coordinates u and v; the quadrant is
        the pair of signs of u and v on the arm, such as (1, -1).
    chain_ends
        Number of ends of chains on the arm; there should be one.
    input_sign
        Sign of the rate of the input along the arm away from the saddle; 0 if not proven.
    """

    saddle: Saddle
    quadrant: Quadrant
    chain_ends: int
    input_sign: int

    def leads_out(self, side: int) -> bool:
        """Return whether the arm is proven to lead away from the range of the input.

        Only an arm that leads away from the range needs no known curve. `side` says where
        the arm is: 1 above the range, -1 below it, 0 within it. Above the range the input
        must grow along the arm. Below the range it must decrease. Within the range the
        result is False.
        """
        return self.input_sign * side > 0


class CurveSearch:
    """The configuration curves found so far in the range of the only input.

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

        A chain is a configuration curve as a row of arcs (pieces). Each arc has an oriented
        box that contains no other part of a curve. The arrays, and a search tree of the
        centres, speed up later tests of what is inside the boxes.
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

            # With `boxsize`, angles that differ by a whole turn are the same.
            periods = np.full(count, TURN)
            self._tree = cKDTree(_within_one_turn(self._centres), boxsize=periods)

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return a mask (n,) of boxes proven to be inside the box of a known arc or saddle.

        All configurations in such a box are on known curves, so it need not be searched.
        Each known arc has an oriented box, which contains no other part of a curve. The
        sides of this box are along the tangent and the normals of the arc. A saddle is a
        place where curves cross or nearly do. It has an oriented box, too. Only arcs with
        the nearest centres are tried, so some boxes may not be recognised.

        Parameters
        ----------
        centres, radii
            (n, v) centres and half widths (rad) of the boxes in the space of all variables.
        """
        is_covered = boxes_covered(self.crossings.saddles, centres, radii)
        tried_count = min(TRIED_NEIGHBOURS, len(self._centres))
        if not tried_count:
            return is_covered
        # A box wider than all boxes of arcs is hardly ever inside one, so it is not tried.
        # `_limits` has the half lengths of the boxes of arcs.
        can_fit = np.max(radii, axis=1) < np.max(self._limits)
        rows = np.flatnonzero(~is_covered & can_fit)
        is_inside_arc = self._are_inside_near_arcs(centres[rows], radii[rows], tried_count)
        is_covered[rows] = is_inside_arc
        return is_covered

    def _are_inside_near_arcs(
        self, centres: Floats, radii: Floats, tried_count: int
    ) -> Bools:
        """Return a mask (n,) of boxes that are certainly inside the box of one near arc.

        Each known arc of a configuration curve has an oriented box around it that contains
        no other part of any configuration curve.

        Parameters
        ----------
        centres, radii
            (n, v) centres and half widths (rad) of the boxes.
        tried_count
            Number of arcs with the nearest centres that are tried.
        """
        # (n, tried arcs) indices of the arcs, the nearest first. The tree requires angles
        # from 0 to 2 pi. `ranks` asks for the nearest arc (1), the second nearest (2), ...
        ranks = range(1, tried_count + 1)
        _, arcs = self._tree.query(_within_one_turn(centres), k=ranks)
        # (n, tried arcs, variables, sides) unit vectors along the sides of the box of an
        # arc. Half width of each box along each side: the sum of its half widths, times the
        # magnitudes of the components of the side. Letters: n boxes, a arcs, v variables,
        # w sides.
        sides = self._frames[arcs]
        half_widths = np.einsum("nv,navw->naw", radii, np.abs(sides))
        # Add bounds of rounding errors, so that no box outside counts as inside.
        reach = half_widths * ROUND_UP + COORDINATE_ROUNDING_RAD
        return np.any(self._are_inside(arcs, centres[:, None], reach), axis=1)

    def _are_inside(self, pieces: Any, positions: Floats, reach: Floats | float) -> Bools:
        """Return whether positions are inside the boxes of known arcs.

        A position is a point in the space of the v variables. Each known arc of a
        configuration curve has a box, with sides along the tangent and the normals of the
        arc. The box contains no other part of any configuration curve. So a configuration
        inside the box is on a curve that is already known.

        Parameters
        ----------
        pieces
            Indices (...) of the arcs, or a mask or Python slice that selects arcs.
        positions
            (..., v) positions (rad).
        reach
            Least distance (rad) that a position inside a box must have from all its sides.
            If it is negative, positions may be outside by this distance.
        """
        offsets = wrap(positions - self._centres[pieces])
        # Coordinates along the sides of each box, from its centre.
        coordinates = np.abs(np.einsum("...v,...vw->...w", offsets, self._frames[pieces]))
        return np.all(coordinates + reach <= self._limits[pieces], axis=-1)

    def add_configuration(self, position: Floats) -> bool:
        """Follow the curve through a configuration (v,), if it is in the range.

        The v variables are in rad. The last variable belongs to the input.

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

        The search divides the space of all variables into boxes, to prove that all
        configuration curves are known. A box is decided if it is proven to have no
        configuration, or if it is inside a box that a known curve passes alone. The
        returned boxes remain undecided: they may contain configurations on unknown curves.

        A saddle is a place where curves cross or narrowly miss each other. Curves cannot be
        followed there, so boxes near a saddle are undecided until it is found. Four
        branches of curves, the arms, leave a saddle.

        A known curve is stored as a chain, a row of arcs. A chain that passes a new saddle
        is divided there. Every arm needs a chain, because modes are counted by chains.
        """
        # A box may have been left undecided before a saddle that contains it was found.
        undecided = self._drop_boxes_in_saddles(undecided)
        for _ in range(MAX_SADDLES):
            new_saddle = self._add_saddle_near(undecided.centres)
            if new_saddle is None:
                break
            self._cut_chains([new_saddle])
            undecided = self._drop_boxes_in_saddles(undecided)
        # Curves are followed only within the range of the input. An arm that leaves this
        # range inside the box of its saddle has no chain yet. It gets a chain of one arc.
        self._add_chains_of_short_arms()
        return undecided

    def _drop_boxes_in_saddles(self, boxes: BoxSet) -> BoxSet:
        """Return the boxes that are not inside the box of a saddle."""
        is_outside = ~boxes_covered(self.crossings.saddles, boxes.centres, boxes.radii)
        return BoxSet(boxes.centres[is_outside], boxes.radii[is_outside])

    def _add_saddle_near(self, positions: Floats) -> Saddle | None:
        """Add the first saddle that is found near one of n positions, and return it.

        A saddle is a place where configuration curves cross or nearly do.

        Parameters
        ----------
        positions
            (n, v) values (rad) of all v variables. Neighbours lead to the same saddle, so
            only some of the positions are tried.

        Returns
        -------
        The saddle, or None if no new one is found.
        """
        step = max(1, len(positions) // SEARCHED_BOXES)
        for position in positions[::step]:
            # `find` adds a new saddle to the end of `saddles`.
            if self.crossings.find(position):
                return self.crossings.saddles[-1]
        return None

    def _add_curve(self, position: Floats) -> None:
        """Add the configuration curve through a configuration (v,), unless it is known.

        A curve is stored as a chain of arcs, each in a box without other configurations.
        The curve may lead to saddles, places where curves cross or nearly do. New saddles
        are added, and chains through them are cut there.
        """
        # The second argument is the error of the configuration. Here the given point itself
        # is tested, so the error is 0.
        if self._is_known(position, 0.0):
            return
        saddle_count = len(self.crossings.saddles)
        # The arc about the configuration; its direction along the curve does not matter.
        first = find_piece(
            self.equations, position, direction=None, longest=LONGEST_ARC_RAD
        )
        # The configuration at the centre of the arc has an error, and is tested with it.
        if first is None or self._is_known(first.centre, first.centre_error):
            return
        # Follow the curve until it closes, leaves the range of the input, or ends at a
        # saddle. The function `self.side` says whether an input is below (-1), in (0) or
        # above (1) the range. The result is None if the first arc turns out to be at a
        # saddle.
        chain = find_chain(self.equations, first, self.side, self.crossings)
        if chain is not None:
            other_chains = self.chains
            if chain.closed:
                # A closed chain is a whole curve. An earlier chain, which may have ended
                # too early, can be a part of it and is dropped.
                other_chains = [
                    earlier
                    for earlier in self.chains
                    if not _is_part_of_closed_chain(earlier, chain)
                ]
            self._set_chains([*other_chains, chain])
        # `find_chain` adds the saddles that it meets to `crossings`.
        if new_saddles := self.crossings.saddles[saddle_count:]:
            self._cut_chains(new_saddles)

    def _cut_chains(self, saddles: Sequence[Saddle]) -> None:
        """Replace chains that pass new saddles by chains that end at these saddles.

        A chain is a known configuration curve, as a row of certified arcs. A saddle is a
        place where curves cross or narrowly miss each other. Four branches of curves, its
        arms, leave it. A search is complete only if exactly one chain ends on each arm. So
        a chain that passes a saddle is removed. The parts of its curve between saddles are
        followed again, as separate chains.

        Parameters
        ----------
        saddles
            The new saddles.
        """
        untouched_chains: list[Chain] = []
        cut_chains: list[Chain] = []
        for chain in self.chains:
            if _may_pass_saddle(chain, saddles):
                cut_chains.append(chain)
            else:
                untouched_chains.append(chain)
        self._set_chains(untouched_chains)
        for chain in cut_chains:
            self._follow_parts(chain)

    def _follow_parts(self, old_chain: Chain) -> None:
        """Follow the curve of a removed chain again, as chains that end at saddles.

        A chain is a configuration curve as a row of arcs (pieces). A saddle is a place
        where curves cross or nearly do. Every chain must end there, but the old chain may
        have passed new saddles. It was removed, and the curve through the centre of each of
        its arcs is now followed again.

        Each arc should then be in the box of a new arc or of a saddle. Otherwise a part of
        the curve is lost, and `has_lost_piece` is set. `problems` then reports that modes
        are not counted.
        """
        pieces = self._pieces_in_range(old_chain)
        for piece in pieces:
            # Arcs that are known already, or near a saddle, are skipped.
            self._add_curve(piece.centre)
        self.has_lost_piece |= not all(
            self._is_known(piece.centre, piece.centre_error) for piece in pieces
        )

    def _pieces_in_range(self, chain: Chain) -> list[CertifiedArc]:
        """Return the arcs of a chain that have their centre in the range of the input.

        A chain is a configuration curve as a row of certified arcs: boxes that contain
        exactly one arc of the curve each.
        """
        return [piece for piece in chain.pieces if not self.side(piece.centre[-1], 0.0)]

    def _is_known(self, position: Floats, error: float) -> bool:
        """Return whether a configuration may be on a curve that was found before.

        True if the configuration may be in the box of a known arc or of a saddle (place
        where curves cross or nearly do). The Euclidean distance of the configuration
        from `position` (v,) is at most `error` (rad).
        """
        # A negative reach also accepts positions that are outside of a box by the error.
        reach = -error - COORDINATE_ROUNDING_RAD
        is_in_arc = self._are_inside(slice(None), position, reach)
        return bool(np.any(is_in_arc)) or self.crossings.may_contain(position, error)

    def _has_overlapping_chains(self) -> bool:
        """Return whether two chains may have a configuration in common.

        If so, one curve may have been found twice, and `problems` reports this. A chain is
        a configuration curve as a row of arcs (pieces), each in a box without other
        configurations. Two chains with a common configuration are the same curve in the
        range of the input. So the centre of an arc of one chain is in a box of the other.
        """
        counts = [len(chain.pieces) for chain in self.chains]
        chain_of_piece = np.repeat(np.arange(len(counts)), counts)
        for number, chain in enumerate(self.chains):
            is_other = chain_of_piece != number
            for piece in self._pieces_in_range(chain):
                # The exact centre may differ from the computed one by this distance. A
                # computed centre that is outside a box by at most this distance therefore
                # counts as inside. A negative `reach` has this effect.
                allowed_outside = piece.centre_error + COORDINATE_ROUNDING_RAD
                is_inside = self._are_inside(is_other, piece.centre, reach=-allowed_outside)
                if np.any(is_inside):
                    return True
        return False

    def _list_arm_uses(self) -> list[ArmUse]:
        """Return all arms of all saddles, with the number of curves that end on each.

        A saddle is a place where configuration curves cross or nearly do. An arm is one of
        the four branches of curves that leave it. Exactly one known curve (chain of arcs)
        should end on each arm.
        """
        # By index of the saddle and quadrant of the arm: how many chains end on this arm.
        end_counts = Counter(
            arm
            for chain in self.chains
            for arm in self.crossings.chain_ends(chain.pieces, chain.closed)
        )
        uses = []
        for number, saddle in enumerate(self.crossings.saddles):
            # The quadrant of an arm is the signs of the saddle's two coordinates u and v on
            # it. A fixed order of arms gives the same result in each run.
            for quadrant in sorted(saddle.outward_signs, reverse=True):
                # For each variable the sign of its rate along the arm, outwards.
                signs_of_rates = saddle.outward_signs[quadrant]
                use = ArmUse(
                    saddle=saddle,
                    quadrant=quadrant,
                    chain_ends=end_counts[number, quadrant],
                    # The input is the last variable.
                    input_sign=signs_of_rates[-1],
                )
                uses.append(use)
        return uses

    def _has_unmatched_arm(self) -> bool:
        """Return whether known curves and arms of saddles may fail to match one to one.

        Modes are counted by curves. If the result is True, the count could be wrong, so
        modes are not counted (`OVERLAPPING`).

        A saddle is a place where configuration curves cross or nearly do. An arm is one of
        the four branches of curves that leave it. Exactly one known curve (chain of arcs)
        must end on each arm. Only an arm that leads out of the range of the input needs
        none. No curve may pass through a saddle, since it would use two arms.
        """
        # A curve may touch saddles at its ends, but not between them.
        if any(self._touches_saddle_inside(chain) for chain in self.chains):
            return True
        for use in self._list_arm_uses():
            # The input is the last variable. `side` is 1 if the saddle is above the range
            # of the input, -1 below, 0 within. The negative margin makes the range
            # narrower. Without it, rounding would decide the side of a saddle at the end of
            # the range.
            saddle_input = use.saddle.centre[-1]
            side = self.side(saddle_input, -OUTSIDE_RANGE_RAD)
            lacks_chain = use.chain_ends == 0 and not use.leads_out(side)
            if lacks_chain or use.chain_ends > 1:
                return True
        return False

    def _add_chains_of_short_arms(self) -> None:
        """Add a chain of one arc for each arm that leaves the range near its saddle.

        At a saddle two curves cross or nearly do, and four branches leave it, its arms.
        Modes are counted by chains, one for each arm. A chain is a curve as a row of
        certified arcs. An arm without a chain may be short: it leaves the range of the
        input inside the box of the saddle, where no curve can be followed.
        """
        for use in self._list_arm_uses():
            if use.chain_ends > 0:
                continue
            chain = self._find_chain_outside_range(use)
            if chain is not None:
                self._set_chains([*self.chains, chain])

    def _find_chain_outside_range(self, use: ArmUse) -> Chain | None:
        """Return a chain of one arc for an arm that leaves the range of the input.

        A chain is a configuration curve as a row of arcs. An arm is one of the four
        branches of curves that leave a saddle, a box where curves cross or nearly do. Modes
        are counted by chains, so every arm should have one. An arm without a chain may
        leave the range of the input inside the box, where no curve can be followed.

        The arc of the result is a part of the arm near the border of the box. The result is
        None in three cases:

        - No arc is proven.
        - The arc is in the range.
        - It is not proven that the input moves farther away from the range along the arm.
        """
        piece = self._find_piece_on_arm(use)
        if piece is None:
            return None
        # The last variable belongs to the input.
        input_variable = piece.centre[-1]
        # 1 if the arc is above the range of the input, -1 below, 0 within.
        no_margin = 0.0
        side_of_range = self.side(input_variable, no_margin)
        # An arc within the range, or an arm that may lead back to the range, is refused.
        if not use.leads_out(side_of_range):
            return None
        return Chain((piece,), closed=False)

    def _find_piece_on_arm(self, use: ArmUse) -> CertifiedArc | None:
        """Return a certified arc on an arm, near the border of the box of its saddle.

        A saddle is a box, in the space of all variables, where configuration curves cross
        or nearly do. An arm is one of the four branches that leave it. Each arm is in
        another quadrant, named by the signs of two coordinates u and v. A certified arc is
        proven to be alone in a small box. The result is None if no arc is proven near the
        border, or if the arc may be on another arm.
        """
        saddle = use.saddle
        # A configuration on the arm.
        position = correct_configuration(
            self.equations, saddle.point_near_arm(use.quadrant)
        )
        if position is None:
            return None
        # The arc may have either direction along the curve.
        piece = find_piece(
            self.equations, position, direction=None, longest=LONGEST_ARC_RAD
        )
        if piece is None:
            return None
        # None if the error of the centre leaves the quadrant open.
        quadrant = saddle.find_quadrant(piece.centre, piece.centre_error)
        if quadrant != use.quadrant:
            return None
        return piece

    def _touches_saddle_inside(self, chain: Chain) -> bool:
        """Return whether a curve may enter the box of a saddle other than at its ends.

        A saddle is a place where configuration curves cross or nearly do. It has a box and
        four arms, the branches of curves that lead from it out of the box. A known curve is
        a chain of arcs. It may begin or end on an arm, but must not pass through a saddle.

        So the arcs on the arm at an end of the chain may be in the box of its saddle. All
        other arcs must be outside the boxes of saddles.
        """
        pieces = chain.pieces
        arms = [self.crossings.arm(piece) for piece in pieces]
        # The arms at both ends, None for an end on no arm. A closed chain has no ends.
        first_arm, last_arm = self.crossings.chain_ends(pieces, chain.closed)
        # Numbers of arcs on these arms, 0 if there is no arm.
        first_count = _count_leading_arcs(arms, first_arm)
        last_count = _count_leading_arcs(arms[::-1], last_arm)
        # If all arcs are on one arm, both counts include them, and no arc remains.
        inner_pieces = pieces[first_count : len(pieces) - last_count]
        return any(
            self.crossings.may_contain(piece.centre, piece.centre_error)
            for piece in inner_pieces
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


def _count_leading_arcs(arms: Sequence[Arm | None], end_arm: Arm | None) -> int:
    """Return how many arcs at one end of a chain are on the arm of this end.

    A chain is a configuration curve as a row of arcs. An arm is one of the branches of
    curves that leave a saddle, a place where curves cross or nearly do. The counted arcs
    may be at a saddle. The caller tests that all other arcs are away from saddles.

    Parameters
    ----------
    arms
        For each arc, from this end on, the arm that it is on, or None.
    end_arm
        The arm on which the chain ends here, or None.
    """
    if end_arm is None:
        return 0
    count = 0
    for arm in arms:
        if arm != end_arm:
            break
        count += 1
    return count


def _is_part_of_closed_chain(part: Chain, closed_chain: Chain) -> bool:
    """Return whether a chain is a part of the curve of a closed chain.

    A chain is a curve as a row of boxes, each with exactly one arc of the curve. The start
    of `part` is a point of its curve. If it is in a box of the closed chain, both curves
    are the same, since the box contains no other curve.
    """
    start = part.pieces[0]
    return any(
        piece.contains(start.centre, start.centre_error) for piece in closed_chain.pieces
    )


def _may_pass_saddle(chain: Chain, saddles: Sequence[Saddle]) -> bool:
    """Return whether the centre of an arc of a chain may be in the box of a saddle."""
    return any(
        saddle.may_contain(piece.centre, piece.centre_error)
        for saddle in saddles
        for piece in chain.pieces
    )


def _within_one_turn(angles: Floats) -> Floats:
    """Return angles (rad) in [0, 2 pi), as the search tree requires."""
    remainders = np.remainder(angles, TURN)
    # The remainder of a tiny negative number rounds to a whole turn.
    return np.where(remainders >= TURN, 0.0, remainders)
