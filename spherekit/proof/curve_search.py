"""Finds configuration curves and crossings in boxes that paving cannot decide."""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import takewhile
from typing import Any

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import TURN
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import Equations
from spherekit.proof.chains import Chain, Side, chain_through
from spherekit.proof.collinear_loops import MOST_SADDLES, Arm, Crossings
from spherekit.proof.paving import TRIED, Left
from spherekit.proof.saddles import Saddle
from spherekit.proof.tubes import LONGEST, UP, CertifiedArc, corrected, covered, piece_at

NEIGHBOURS = 8
"""Pieces with the nearest centres that a box is tried against."""
OVERLAPPING = "two curves found may be one, so that modes are not counted"
OUTSIDE = 1e-9
"""Arms (rad) may reach so far into the range without a chain."""


class Search:
    """Finds curves in boxes that are not decided; `chains` are those known so far."""

    def __init__(self, equations: Equations, side: Side) -> None:
        self.equations, self.side = equations, side
        self.crossings = Crossings(equations)
        self.lost = False
        self._keep([])

    def _keep(self, chains: list[Chain]) -> None:
        """Take chains as those known, and all their pieces to be searched by place."""
        self.chains = chains
        pieces = [piece for chain in chains for piece in chain.pieces]
        count = self.equations.variables
        self._centres = np.reshape([piece.centre for piece in pieces], (-1, count))
        self._frames = np.reshape([piece.frame for piece in pieces], (-1, count, count))
        self._limits = np.reshape([piece.limits for piece in pieces], (-1, count))
        if pieces:
            from scipy.spatial import cKDTree

            self._tree = cKDTree(_turned(self._centres), boxsize=np.full(count, TURN))

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return whether boxes (n, v) of radii (n, v) are in a piece or at a crossing."""
        out = covered(self.crossings.saddles, centres, radii)
        tried = min(NEIGHBOURS, len(self._centres))
        if not tried:
            return out
        small = np.flatnonzero(~out & (np.max(radii, axis=1) < np.max(self._limits)))
        _, near = self._tree.query(_turned(centres[small]), k=range(1, tried + 1))
        sizes = np.einsum("nv,nkvw->nkw", radii[small], np.abs(self._frames[near]))
        inside = self._inside(near, centres[small, None], sizes * UP + 1e-13)
        out[small] = np.any(inside, axis=1)
        return out

    def _inside(self, pieces: Any, places: Floats, reach: Floats | float) -> Bools:
        """Return whether places (..., v) are in pieces (...), with a reach along frames."""
        apart = wrap(places - self._centres[pieces])
        along = np.abs(np.einsum("...v,...vw->...w", apart, self._frames[pieces]))
        return np.all(along + reach <= self._limits[pieces], axis=-1)

    def take(self, place: Floats) -> bool:
        """Follow the curve through a configuration; return whether anything is new."""
        before = len(self.chains), len(self.crossings.saddles)
        if not self.side(place[-1], OUTSIDE):
            self._follow(place)
        return (len(self.chains), len(self.crossings.saddles)) != before

    def without_saddles(self, centres: Floats, radii: Floats) -> Left:
        """Look for crossings in boxes left over; return what is left without these.

        Arms that end the range are kept too.
        """
        for _ in range(MOST_SADDLES):
            some = centres[:: max(1, len(centres) // TRIED)]
            if not any(map(self.crossings.find, some)):
                break
            self._cut(self.crossings.saddles[-1:])
            open_ = ~covered(self.crossings.saddles, centres, radii)
            centres, radii = centres[open_], radii[open_]
        self._end_arms()
        return centres, radii

    def _follow(self, place: Floats) -> None:
        """Keep the curve through a configuration, if there is one that is not known."""
        if self._known(place, 0.0):
            return
        count = len(self.crossings.saddles)
        first = piece_at(self.equations, place, None, LONGEST)
        if first is None or self._known(first.centre, first.miss):
            return
        chain = chain_through(self.equations, first, self.side, self.crossings)
        if chain is not None:
            # those that are proven to lie on a closed one are of no more use
            closed = chain.pieces if chain.closed else ()
            kept = [
                earlier
                for earlier in self.chains
                for start in earlier.pieces[:1]
                if not any(piece.holds(start.centre, start.miss) for piece in closed)
            ]
            self._keep([*kept, chain])
        if new := self.crossings.saddles[count:]:
            self._cut(new)

    def _cut(self, saddles: Sequence[Saddle]) -> None:
        """Follow the chains again that go into saddles that were not known then."""
        parts: tuple[list[Chain], list[Chain]] = [], []
        for chain in self.chains:
            meet = any(s.may_hold(p.centre, p.miss) for s in saddles for p in chain.pieces)
            parts[meet].append(chain)
        self._keep(parts[0])
        for chain in parts[1]:
            within = self._within(chain)
            for piece in within:
                self._follow(piece.centre)
            self.lost |= not all(self._known(p.centre, p.miss) for p in within)

    def _within(self, chain: Chain) -> list[CertifiedArc]:
        """Return the pieces of a chain whose centre is in the range."""
        return [p for p in chain.pieces if not self.side(p.centre[-1], 0.0)]

    def _known(self, place: Floats, off: float) -> bool:
        """Return whether a place, off by at most `off`, may be in a piece or a saddle."""
        on = np.any(self._inside(slice(None), place, -off - 1e-13))
        return bool(on) or self.crossings.may_hold(place, off)

    def _overlapping(self) -> bool:
        """Return whether two chains may go through one configuration of the range."""
        counts = [len(chain.pieces) for chain in self.chains]
        owner = np.repeat(np.arange(len(counts)), counts)
        return any(
            np.any(self._inside(owner != number, piece.centre, -piece.miss - 1e-13))
            for number, chain in enumerate(self.chains)
            for piece in self._within(chain)
        )

    def _arms(self) -> Iterator[tuple[Arm, int, int]]:
        """Yield all arms, how many chains end there, and the sense of the input on them."""
        ends = Counter(
            arm
            for chain in self.chains
            for arm in self.crossings.ends(chain.pieces, chain.closed)
        )
        for number, saddle in enumerate(self.crossings.saddles):
            for quadrant, rates in sorted(saddle.rates.items(), reverse=True):
                arm = number, quadrant
                yield arm, ends[arm], rates[-1]

    def _unjoined(self) -> bool:
        """Return whether chains may go into crossings but on one arm at each end.

        An arm that only leads out of the range needs no chain.
        """
        if any(self._strays(chain) for chain in self.chains):
            return True
        for (number, _), count, rate in self._arms():
            q = self.crossings.saddles[number].centre[-1]
            if count > 1 or (count == 0 and rate * self.side(q, -OUTSIDE) <= 0):
                return True
        return False

    def _end_arms(self) -> None:
        """Add a chain of one piece for arms that leave the range before their saddle."""
        for arm, count, rate in self._arms():
            if count:
                continue
            place = corrected(self.equations, self.crossings.saddles[arm[0]].on(arm[1]))
            piece = place is not None and piece_at(self.equations, place, None, LONGEST)
            if not piece or self.crossings.arm(piece) != arm:
                continue
            if rate * self.side(piece.centre[-1], 0.0) > 0:
                self._keep([*self.chains, Chain((piece,), False)])

    def _strays(self, chain: Chain) -> bool:
        """Return whether a chain is at a crossing but where it begins or ends on an arm."""
        pieces, arms = chain.pieces, [self.crossings.arm(piece) for piece in chain.pieces]

        def on(end: Arm | None, way: list[Arm | None]) -> int:
            """Return how many pieces of a way are on the arm at its end."""
            return len([*takewhile(lambda arm: arm is not None and arm == end, way)])

        begin, end = self.crossings.ends(pieces, chain.closed)
        first, last = on(begin, arms), on(end, arms[::-1])
        return any(
            self.crossings.may_hold(piece.centre, piece.miss)
            for piece in pieces[first : len(pieces) - last]
        )

    def problems(self) -> list[str]:
        """Return why chains are not whole curves, or not known to be different."""
        problems = [chain.problem for chain in self.chains if chain.problem]
        if self.lost or self._overlapping() or self._unjoined():
            problems.append(OVERLAPPING)
        if any(chain.again() for chain in self.chains):
            problems.append("a curve may have been gone round twice")
        return problems


def _turned(places: Floats) -> Floats:
    """Return angles in [0, 2 pi)."""
    turned = np.remainder(places, TURN)
    return np.where(turned >= TURN, 0.0, turned)
