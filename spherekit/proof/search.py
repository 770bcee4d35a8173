"""Finds configuration curves and crossings in boxes that paving cannot decide."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import TURN
from spherekit.numeric.crossings import wrap
from spherekit.proof.along import Chain, Range, chain_through
from spherekit.proof.equations import Equations
from spherekit.proof.folded import MOST_SADDLES, Arm, Crossings
from spherekit.proof.paving import CoveredBoxes
from spherekit.proof.saddles import QUADRANTS, Saddle
from spherekit.proof.tubes import LONGEST, UP, corrected, piece_at

NEIGHBOURS = 8
"""Pieces with the nearest centres that a box is tried against."""


class Cover:
    """All pieces of chains, searched by place."""

    def __init__(self) -> None:
        self.chains: list[Chain] = []
        self.count = 0

    def add(self, chain: Chain) -> None:
        """Take a chain; those that lie on it, if it is closed, are of no more use."""
        from scipy.spatial import cKDTree

        if chain.closed:
            self.chains = [kept for kept in self.chains if not _on(kept, chain)]
        self.chains.append(chain)
        pieces = [piece for member in self.chains for piece in member.pieces]
        self.count = len(pieces)
        self._centres = np.array([piece.centre for piece in pieces])
        self._frames = np.array([piece.frame for piece in pieces])
        self._limits = np.array([piece.limits for piece in pieces])
        box = np.full(self._centres.shape[1], TURN)
        self._tree = cKDTree(_turned(self._centres), boxsize=box)

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return whether boxes (n, v) of radii (n, v) are inside a piece."""
        out = np.zeros(len(centres), dtype=bool)
        if not self.count:
            return out
        small = np.flatnonzero(np.max(radii, axis=1) < np.max(self._limits))
        tried = min(NEIGHBOURS, self.count)
        _, near = self._tree.query(_turned(centres[small]), k=tried)
        near = np.asarray(near).reshape(len(small), tried)
        for column in range(tried):
            left = np.flatnonzero(~out[small])
            rows, pieces = small[left], near[left, column]
            frames = self._frames[pieces]
            apart = centres[rows] - self._centres[pieces]
            apart = wrap(apart)
            inside = np.abs(np.einsum("nv,nvw->nw", apart, frames))
            inside += np.einsum("nv,nvw->nw", radii[rows], np.abs(frames)) * UP + 1e-13
            out[rows] = np.all(inside <= self._limits[pieces], axis=1)
        return out

    def may_hold(self, place: Floats, off: float) -> bool:
        """Return whether a configuration, off by at most `off`, may be in a piece."""
        if not self.count:
            return False
        apart = wrap(place - self._centres)
        inside = np.abs(np.einsum("nv,nvw->nw", apart, self._frames)) - off - 1e-13
        return bool(np.any(np.all(inside <= self._limits, axis=1)))


def _on(chain: Chain, closed: Chain) -> bool:
    """Return whether a chain's curve is proven to be that of a closed one."""
    start = chain.pieces[0]
    return any(piece.holds(start.centre, start.miss) for piece in closed.pieces)


def _turned(places: Floats) -> Floats:
    """Return angles in [0, 2 pi)."""
    turned = np.remainder(places, TURN)
    return np.where(turned >= TURN, 0.0, turned)


SEEDING = 0.12
"""Boxes (rad) so small are looked into for curves not known yet."""
MOST_VAIN = 400
"""Boxes looked into without a new curve, after which none are."""
OVERLAPPING = "two curves found may be one, so that modes are not counted"
OUTSIDE = 1e-9
"""Arms (rad) may reach so far into the range without a chain."""
TRIED = 6
"""Boxes of each batch that are looked into."""


class Search:
    """Finds curves in boxes that are not decided."""

    def __init__(self, equations: Equations, inputs: Range) -> None:
        self.equations, self.inputs = equations, inputs
        self.cover = Cover()
        self.crossings = Crossings(equations)
        self.vain = 0
        self.lost = False

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return whether boxes (n, v) of radii (n, v) are in a piece or at a crossing."""
        return self.cover.covers(centres, radii) | self.crossings.covers(centres, radii)

    def look(self, centres: Floats, radii: Floats) -> bool:
        """Look for curves that go through boxes; return whether there is a new one."""
        before = len(self.cover.chains), len(self.crossings.saddles)
        small = np.flatnonzero(np.max(radii, axis=1) < SEEDING)
        for row in small[:: max(1, len(small) // TRIED)] if self.vain < MOST_VAIN else ():
            self.vain += 1
            place = corrected(self.equations, centres[row])
            if place is None:
                continue
            reach = 4.0 * float(np.max(radii[row]))
            if float(np.max(np.abs(place - centres[row]))) > reach:
                continue
            if not self.inputs.side(float(place[-1]), OUTSIDE) and self._follow(place):
                self.vain = 0
        return (len(self.cover.chains), len(self.crossings.saddles)) != before

    def without_saddles(self, done: CoveredBoxes) -> CoveredBoxes:
        """Look for crossings in boxes left over; return what is left without these.

        Arms that end the range are kept too.
        """
        centres, radii = done.centres, done.radii
        for _ in range(MOST_SADDLES):
            count = len(self.crossings.saddles)
            for row in range(0, len(centres), max(1, len(centres) // TRIED)):
                if self.crossings.find(centres[row]):
                    break
            if len(self.crossings.saddles) == count:
                break
            self._cut(self.crossings.saddles[count:])
            open_ = ~self.crossings.covers(centres, radii)
            centres, radii = centres[open_], radii[open_]
        self._end_arms()
        return replace(done, centres=centres, radii=radii)

    def _follow(self, place: Floats) -> bool:
        """Keep the curve through a configuration; return whether there is a new one."""
        if self._known(place, 0.0):
            return False
        count = len(self.crossings.saddles)
        first = piece_at(self.equations, place, None, LONGEST)
        if first is None or self._known(first.centre, first.miss):
            return False
        chain = chain_through(self.equations, first, self.inputs, self.crossings)
        if chain is not None:
            self.cover.add(chain)
        if len(self.crossings.saddles) > count:
            self._cut(self.crossings.saddles[count:])
        return chain is not None

    def _cut(self, saddles: Sequence[Saddle]) -> None:
        """Follow the chains again that go into saddles that were not known then."""
        kept: list[Chain] = []
        cut: list[Chain] = []
        for chain in self.cover.chains:
            meet = any(s.may_hold(p.centre, p.miss) for s in saddles for p in chain.pieces)
            (cut if meet else kept).append(chain)
        self.cover = Cover()
        for chain in kept:
            self.cover.add(chain)
        for chain in cut:
            within = [p for p in chain.pieces if not self.inputs.side(float(p.centre[-1]))]
            for piece in within:
                self._follow(piece.centre)
            self.lost |= not all(self._known(p.centre, p.miss) for p in within)

    def _known(self, place: Floats, off: float) -> bool:
        """Return whether a configuration is on a curve known already, or at a crossing."""
        return self.cover.may_hold(place, off) or self.crossings.may_hold(place, off)

    def overlapping(self) -> bool:
        """Return whether two chains may go through one configuration of the range."""
        for chain in self.cover.chains:
            within = [p for p in chain.pieces if not self.inputs.side(float(p.centre[-1]))]
            centres = np.array([piece.centre for piece in within])
            off = np.array([piece.miss for piece in within])
            for other in self.cover.chains:
                tried = other.pieces if other is not chain and within else ()
                if any(np.any(piece.may_hold(centres, off)) for piece in tried):
                    return True
        return False

    def unjoined(self) -> bool:
        """Return whether chains may go into crossings but on one arm at each end.

        An arm that only leads out of the range needs no chain.
        """
        if any(self._strays(chain) for chain in self.cover.chains):
            return True
        arms = self._joined()
        for number, saddle in enumerate(self.crossings.saddles):
            for quadrant in QUADRANTS:
                count = arms.count(Arm(number, quadrant))
                q, rate = float(saddle.centre[-1]), saddle.rates[quadrant][-1]
                away = not self.inputs.whole and (
                    (rate > 0 and q >= self.inputs.high - OUTSIDE)
                    or (rate < 0 and q <= self.inputs.low + OUTSIDE)
                )
                if count > 1 or (count == 0 and not away):
                    return True
        return False

    def _joined(self) -> list[Arm]:
        """Return the arms that chains begin or end on, as often as they do."""
        chains = self.cover.chains
        ends = (e for c in chains for e in self.crossings.ends(c.pieces, c.closed))
        return [end for end in ends if end is not None]

    def _end_arms(self) -> None:
        """Add a chain of one piece for arms that leave the range before their saddle."""
        arms = self._joined()
        for number, saddle in enumerate(self.crossings.saddles):
            for quadrant in QUADRANTS:
                arm = Arm(number, quadrant)
                if self.inputs.whole or arm in arms:
                    continue
                place = corrected(self.equations, saddle.on(quadrant))
                piece = place is not None and piece_at(self.equations, place, None, LONGEST)
                if not piece or self.crossings.arm(piece) != arm:
                    continue
                q, rate = float(piece.centre[-1]), saddle.rates[quadrant][-1]
                beyond = q > self.inputs.high if rate > 0 else q < self.inputs.low
                if rate and beyond:
                    self.cover.add(Chain((piece,), False))

    def _strays(self, chain: Chain) -> bool:
        """Return whether a chain is at a crossing but where it begins or ends on an arm."""
        inner = [self.crossings.may_hold(p.centre, p.miss) for p in chain.pieces]
        ends = self.crossings.ends(chain.pieces, chain.closed)
        for sense, end in ((1, ends[0]), (-1, ends[1])):
            for number in range(len(inner))[::sense]:
                on = end is not None and self.crossings.arm(chain.pieces[number]) == end
                if not on:
                    break
                inner[number] = False
        return any(inner)

    def problems(self) -> list[str]:
        """Return why chains are not whole curves, or not known to be different."""
        problems = [chain.problem for chain in self.cover.chains if chain.problem]
        if self.lost or self.overlapping() or self.unjoined():
            problems.append(OVERLAPPING)
        if any(chain.again() for chain in self.cover.chains):
            problems.append("a curve may have been gone round twice")
        return problems
