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
    """One arm of a saddle, and the number of chains that end on it.

    A saddle is a place where two configuration curves cross, or narrowly miss each other.
    Four branches of curves leave it, its arms. A chain is a curve as a row of certified
    arcs.

    Attributes
    ----------
    saddle
        The saddle that the arm leaves.
    quadrant
        Which of the four arms it is. The saddle has two coordinates u and v, and each arm
        is in one quadrant of the plane (u, v). The quadrant is the pair of signs of u and v
        on the arm, such as (1, -1).
    chain_ends
        Number of ends of chains on the arm; there should be one.
    input_sign
        Sign of the rate of the input along the arm, away from the saddle; 0 if not proven.
    """

    saddle: Saddle
    quadrant: Quadrant
    chain_ends: int
    input_sign: int

    def leads_out(self, side: int) -> bool:
        """Return whether the arm leads farther out of the range of the input on a side.

        The side is 1 above the range, where the input must grow along the arm, and -1 below
        it, where the input must decrease. On the side 0, within the range, no arm does.
        """
        return self.input_sign * side > 0


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
        is_inside_arc = self._are_inside_near_arcs(centres[rows], radii[rows], tried_count)
        is_covered[rows] = is_inside_arc
        return is_covered

    def _are_inside_near_arcs(
        self, centres: Floats, radii: Floats, tried_count: int
    ) -> Bools:
        """Return which boxes (n,) are surely inside the box of one of the nearest arcs.

        Parameters
        ----------
        centres, radii
            (n, v) centres and half widths (rad) of the boxes.
        tried_count
            Number of arcs with the nearest centres that are tried.
        """
        # (n, tried arcs) the numbers of the arcs, the nearest first. The search tree
        # accepts only angles from 0 to 2 pi. A range of ranks keeps the axis of the arcs
        # also if there is only one.
        _, arcs = self._tree.query(_within_one_turn(centres), k=range(1, tried_count + 1))
        # The half width of a box along a direction is the sum over the variables of its
        # half widths times the magnitudes of the direction's components. The directions are
        # the sides of the box of an arc: n boxes, k arcs, v variables, w sides.
        half_widths = np.einsum("nv,nkvw->nkw", radii, np.abs(self._frames[arcs]))
        # They are enlarged by bounds of the rounding errors of this sum and of coordinates,
        # so that a box outside cannot count as inside.
        reach = half_widths * ROUND_UP + COORDINATE_ROUNDING_RAD
        return np.any(self._are_inside(arcs, centres[:, None], reach), axis=1)

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

        A saddle is a place where curves cross or narrowly miss each other. Near it a curve
        cannot be followed, so the boxes there stay undecided: they are neither proven to
        contain no configurations, nor inside the box of a known curve.

        A chain is a known curve as a row of certified arcs. Chains that pass a new saddle
        are divided there. Four branches of curves leave a saddle, its arms. At the end, a
        chain is added for each short arm, which leaves the range of the input so near to
        the saddle that no curve has been followed along it.
        """
        for _ in range(MAX_SADDLES):
            new_saddle = self._add_saddle_near(undecided.centres)
            if new_saddle is None:
                break
            self._cut_chains([new_saddle])
            undecided = self._drop_boxes_in_saddles(undecided)
        self._add_chains_of_short_arms()
        return undecided

    def _drop_boxes_in_saddles(self, boxes: BoxSet) -> BoxSet:
        """Return the boxes that are not inside the box of a saddle."""
        is_outside = ~boxes_covered(self.crossings.saddles, boxes.centres, boxes.radii)
        return BoxSet(boxes.centres[is_outside], boxes.radii[is_outside])

    def _add_saddle_near(self, positions: Floats) -> Saddle | None:
        """Add the first saddle that is found near one of n positions, and return it.

        A saddle is a place where curves cross or nearly do. Only a few of the positions
        (n, v), in rad, are tried: those near the same saddle would find it again.

        Returns
        -------
        None if no new saddle is found.
        """
        step = max(1, len(positions) // SEARCHED_BOXES)
        for position in positions[::step]:
            if self.crossings.find(position):
                return self.crossings.saddles[-1]
        return None

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
            other_chains = self.chains
            if chain.closed:
                # A closed chain is a whole curve. An earlier chain that could not be
                # followed further may be a part of it, and is dropped.
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

        A chain is a known curve, as a row of certified arcs (`pieces`). A saddle is a place
        where curves cross or narrowly miss each other. It may divide a curve into several
        parts. A chain that passes a saddle is therefore forgotten, and the parts of its
        curve are followed again.
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
        """Add the parts, between saddles, of a curve whose old chain has been forgotten.

        A chain is a curve as a row of certified arcs. Near a saddle curves cross or nearly
        do. Each part of the curve ends at a saddle or outside the range of the input, so a
        part is followed from every arc of the old chain, unless the arc is on a part that
        has been added already. If the curve could not be followed from an arc outside all
        saddles, `has_lost_piece` is set.
        """
        pieces = self._pieces_in_range(old_chain)
        for piece in pieces:
            # This does nothing if a known chain or saddle contains the position.
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

    def _list_arm_uses(self) -> list[ArmUse]:
        """Return all arms of all saddles with the number of chains that end on them.

        A saddle is a place where curves of configurations cross or nearly do. An arm is one
        of the four branches of curves that leave it. A chain is a curve as a row of arcs;
        exactly one chain should end on each arm.
        """
        # By arm, which is given by the number of its saddle and its quadrant.
        end_counts = Counter(
            arm
            for chain in self.chains
            for arm in self.crossings.chain_ends(chain.pieces, chain.closed)
        )
        uses = []
        for number, saddle in enumerate(self.crossings.saddles):
            # The order is fixed, so that chains that are added for arms are repeatable.
            for quadrant in sorted(saddle.outward_signs, reverse=True):
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
            # The input is the last variable. The saddle is above the range of the input
            # (side 1), below (-1) or within (0). Less than `OUTSIDE_RANGE_RAD` inside an
            # end counts as outside.
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
        """Return the chain of one arc on an arm, if the arm has left the range there.

        An arm is a branch of a curve that leaves a saddle. The arc is near the border of
        the box of the saddle. The result is None if no arc is proven there, if the arc is
        in the range of the input, or if the arm may lead back to the range.
        """
        piece = self._find_piece_on_arm(use)
        if piece is None:
            return None
        # 1 if the arc is above the range, -1 below, 0 within. The input is the last
        # variable.
        side_of_range = self.side(piece.centre[-1], 0.0)
        if not use.leads_out(side_of_range):
            return None
        return Chain((piece,), closed=False)

    def _find_piece_on_arm(self, use: ArmUse) -> CertifiedArc | None:
        """Return a certified arc on an arm, near the border of the box of its saddle.

        The result is None if no arc is proven there, or if it is not proven to be on this
        arm.
        """
        saddle = use.saddle
        position = correct_configuration(
            self.equations, saddle.point_near_arm(use.quadrant)
        )
        if position is None:
            return None
        piece = find_piece(
            self.equations, position, direction=None, longest=LONGEST_ARC_RAD
        )
        if piece is None:
            return None
        quadrant = saddle.find_quadrant(piece.centre, piece.centre_error)
        return piece if quadrant == use.quadrant else None

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
        first_arm, last_arm = self.crossings.chain_ends(pieces, chain.closed)
        first_count = _count_leading_arcs(arms, first_arm)
        last_count = _count_leading_arcs(arms[::-1], last_arm)
        # Both counts overlap if all arcs are on one arm. The slice is then empty.
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

    An arm is one of the branches of curves that leave a saddle, a place where curves cross
    or nearly do.

    Parameters
    ----------
    arms
        The arm of each arc of the chain, None for no arm, beginning at this end.
    end_arm
        The arm on which the chain ends there, None for no arm.
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
    """Return whether a chain is a part of the curve that a closed chain represents.

    It is if its start is in the box of an arc of the closed chain, because this box
    contains no other curve.
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
