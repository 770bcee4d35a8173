"""All configuration curves over a range of one input, proven complete.

Chains of pieces are found from boxes that paving cannot decide, until every box is proven
empty or lies in a piece, in which there is one arc. So the arcs are all configurations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from itertools import pairwise
from typing import final

import numpy as np

from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.guarantee import Claim, Guarantee
from spherekit.proof.along import Stop, stops
from spherekit.proof.balls import bits, exact, middle, pi, upper
from spherekit.proof.chains import Chain, chain_through, laps
from spherekit.proof.construction import Construction, construct
from spherekit.proof.cover import TURN, Cover, may_meet
from spherekit.proof.equations import Equations
from spherekit.proof.paving import FIRST, Axis, Paved, paved
from spherekit.proof.tubes import Piece, corrected
from spherekit.proof.written import Written
from spherekit.sphere.rotation import Floats

PRECISION = 80
SMALLEST = 1e-6
"""Boxes (rad) are not halved further."""
MOST_BOXES = 6_000_000
SEEDING = 0.12
"""Boxes (rad) so small are looked into for curves not known yet."""
MOST_VAIN = 400
"""Boxes looked into without a new curve, after which none are."""
OVERLAPPING = "two curves found may be one, so that modes are not counted"
TRIED = 6
"""Boxes of each batch that are looked into."""


@final
@dataclass(frozen=True)
class CertifiedCurves:
    """What is proven of the configuration curves over a range of the only input.

    `low` and `high` (rad), a whole turn if `whole`. Every closed configuration of the
    range is on one of the `chains`, or in one of the boxes left over in `paving`.
    `stopping` holds for each chain where the input stops along it, and how many parts are
    undecided.
    """

    written: Written
    construction: Construction
    equations: Equations
    range_text: tuple[str, str]
    low: float
    high: float
    whole: bool
    chains: tuple[Chain, ...]
    paving: Paved
    problems: tuple[str, ...]

    @property
    def driven(self) -> int:
        """The number of the input's variable."""
        return self.construction.unknowns

    @cached_property
    def stopping(self) -> tuple[tuple[list[Stop], int], ...]:
        """Where the input stops along each chain: type II, dead centres of the input."""
        return self.stops_of(self.driven)

    def stops_of(self, variable: int) -> tuple[tuple[list[Stop], int], ...]:
        """Return where a variable stops along each chain, and undecided parts."""
        with bits(PRECISION):
            return tuple(stops(self.equations, chain, variable) for chain in self.chains)

    @property
    def undecided(self) -> list[tuple[float, float]]:
        """Parts of the range (rad) at which configurations may be missing."""
        centres, radii = self.paving.centres, self.paving.radii
        if not len(centres):
            return []
        q, r = centres[:, self.driven], radii[:, self.driven]
        order = np.argsort(q - r)
        parts: list[tuple[float, float]] = []
        for low, high in zip((q - r)[order], (q + r)[order], strict=True):
            if parts and low <= parts[-1][1] + 1e-12:
                parts[-1] = parts[-1][0], max(parts[-1][1], float(high))
            else:
                parts.append((float(low), float(high)))
        return parts

    def inside(self, q: float) -> float | None:
        """Return an input less whole turns if it is in the range, else None."""
        turned = self.low + np.remainder(q - self.low, TURN)
        for candidate in (turned, turned - TURN):
            if self.low - 1e-9 <= candidate <= self.high + 1e-9:
                return float(candidate)
        return None

    @cached_property
    def turning_points(self) -> list[float]:
        """Inputs (rad) in the range at which two modes meet, in order."""
        places = [
            stop.place[self.driven] for stopped, _ in self.stopping for stop in stopped
        ]
        return sorted(q for q in (self.inside(float(p)) for p in places) if q is not None)

    def modes_at(self, q: float) -> int:
        """Return the number of modes at an input (rad) that is no turning point."""
        return sum(_crossings(low, high, q) for low, high in self.segments)

    @cached_property
    def segments(self) -> list[tuple[float, float]]:
        """The inputs (rad, turns counted) that each part of a chain without stops spans."""
        segments = []
        for chain, (stopped, _) in zip(self.chains, self.stopping, strict=True):
            segments += _segments(chain, stopped, self.driven)
        return segments

    @cached_property
    def intervals(self) -> list[tuple[float, float, int]]:
        """The range cut at turning points (rad), with the number of modes of each part.

        Undecided parts are left out; there are none where two chains may be of one curve.
        """
        if OVERLAPPING in self.problems:
            return []
        ends = [end for part in self.undecided for end in part]
        inner = [end for end in ends if self.low < end < self.high]
        edges = [self.low, *sorted([*self.turning_points, *inner]), self.high]
        # places that are not told apart have no part of the range between them
        off = max(
            (stop.off for stopped, _ in self.stopping for stop in stopped), default=0.0
        )
        return [
            (low, high, self.modes_at(0.5 * (low + high)))
            for low, high in pairwise(edges)
            if high - low > max(2.0 * off, 1e-12)
            and not self._is_undecided(0.5 * (low + high))
        ]

    def _is_undecided(self, q: float) -> bool:
        """Return whether an input of the range (rad) is in an undecided part of it."""
        turns = (-TURN, 0.0, TURN) if self.whole else (0.0,)
        return any(
            low <= q + turn <= high for low, high in self.undecided for turn in turns
        )

    @cached_property
    def claim(self) -> Claim:
        """What is guaranteed, and what that rests on."""
        pieces = sum(len(chain.pieces) for chain in self.chains)
        rests = (
            f"{len(self.chains)} curves of {pieces} pieces with one arc each, "
            f"{self.paving.looked_at} boxes"
        )
        parts = self.undecided
        doubtful = sum(count for _, count in self.stopping)
        if OVERLAPPING in self.problems:
            rests = f"{OVERLAPPING}; {rests}"
        if parts:
            widest = max(high - low for low, high in parts)
            return Claim(
                Guarantee.TO_BOX,
                f"{len(parts)} parts of the range are undecided; elsewhere {rests}",
                max(widest, float(2.0 * np.max(self.paving.radii))),
            )
        if self.problems or doubtful:
            words = (
                self.problems[0]
                if self.problems
                else (f"{doubtful} parts in which the input may stop are undecided")
            )
            return Claim(Guarantee.COMPONENT, f"{words}; {rests}")
        return Claim(Guarantee.CERTIFIED, f"all configurations; {rests}")


def _crossings(low: float, high: float, q: float) -> int:
    """Return how often an input, of any turn, lies between two."""
    first, last = sorted((low, high))
    return int(np.floor((last - q) / TURN) - np.floor((first - q) / TURN))


def _segments(
    chain: Chain, stopped: Sequence[Stop], driven: int
) -> list[tuple[float, float]]:
    """Return the spans of the input between its stops along a chain."""
    ends: list[float] = []
    q = float(chain.pieces[0].centre[driven])
    start = q
    following = [*chain.pieces[1:], *(chain.pieces[:1] if chain.closed else ())]
    for number, (piece, further) in enumerate(zip(chain.pieces, following, strict=False)):
        for stop in stopped:
            if stop.after == number:
                ends.append(q + _apart(piece.centre[driven], stop.place[driven]))
        q += _apart(piece.centre[driven], further.centre[driven])
    if not ends:
        return [(start, q)]
    spans = list(pairwise(ends))
    if chain.closed:
        # the last one goes on into the first, as many turns on
        return [*spans, (ends[-1], ends[0] + (q - start))]
    return [(start, ends[0]), *spans, (ends[-1], q)]


def _apart(one: float, other: float) -> float:
    """Return the shorter way from one angle to another."""
    return float(np.remainder(other - one + np.pi, TURN) - np.pi)


def certified_curves(
    written: Written,
    range_text: tuple[str, str],
    construction: Construction | None = None,
    smallest: float = SMALLEST,
    most: int = MOST_BOXES,
) -> CertifiedCurves:
    """Return all configuration curves over a range of the only input, as far as proven.

    Parameters
    ----------
    written
        The mechanism, with one input.
    range_text
        The ends of the range as decimal numbers in the unit of the file.
    construction
        By default that of `construct`.
    smallest, most
        Least radius of boxes (rad), and how many are looked at.

    Raises
    ------
    PlanError
        If the mechanism is none that proofs are for.
    """
    made = construction or construct(written.structure)
    if made.followers:
        raise PlanError(
            f"{written.mechanism.name}: wheels turn "
            f"{listing(written.structure.pairs[pair] for pair in made.followers)} with the "
            "input; proofs over ranges are for mechanisms without rolling contacts: give "
            "values of the inputs with --at"
        )
    with bits(PRECISION):
        equations = Equations(written, made)
        low, high = (written.input_angle(text) for text in range_text)
        turns = middle(high - low) / TURN
        exact_turn = _whole_turn(written, range_text)
        if turns > 1.0 and not exact_turn:
            raise PlanError(
                f"{written.mechanism.name}: {range_text[0]} to {range_text[1]} is more "
                "than a turn, after which everything returns; give at most one"
            )
        axes = [Axis(exact(FIRST), 2 * pi()) for _ in range(made.unknowns)]
        axes.append(Axis(low, 2 * pi()) if exact_turn else Axis(low, high - low))
        search = _Search(equations, middle(low), middle(high), exact_turn)
        done = paved(equations, axes, search.cover.covers, search.look, smallest, most)
        assert upper(high - low) > 0.0
    return CertifiedCurves(
        written,
        made,
        equations,
        range_text,
        middle(low),
        middle(high),
        search.whole,
        tuple(search.cover.chains),
        done,
        tuple(search.problems()),
    )


def _whole_turn(written: Written, range_text: tuple[str, str]) -> bool:
    """Return whether a range in degrees is exactly one turn."""
    low, high = (Decimal(text) for text in range_text)
    return written.document.data["angle_unit"] == "deg" and high - low == 360


@final
class _Search:
    """Finds curves in boxes that are not decided."""

    def __init__(self, equations: Equations, low: float, high: float, whole: bool) -> None:
        self.equations, self.low, self.high, self.whole = equations, low, high, whole
        self.cover = Cover()
        self.vain = 0

    def look(self, centres: Floats, radii: Floats) -> bool:
        """Look for curves that go through boxes; return whether there is a new one."""
        before = len(self.cover.chains)
        small = np.flatnonzero(np.max(radii, axis=1) < SEEDING)
        for row in small[:: max(1, len(small) // TRIED)] if self.vain < MOST_VAIN else ():
            self.vain += 1
            place = corrected(self.equations, centres[row])
            if place is None:
                continue
            reach = 4.0 * float(np.max(radii[row]))
            if float(np.max(np.abs(place - centres[row]))) > reach:
                continue
            if not self.in_range(float(place[-1])):
                continue
            if self.cover.count and self.cover.holds(place, 0.0):
                continue
            chain = chain_through(self.equations, place, self.low, self.high, self.whole)
            if chain is None or self._known(chain.start):
                continue
            self.cover.add(chain)
            self.vain = 0
        return len(self.cover.chains) > before

    def _known(self, start: Piece) -> bool:
        """Return whether a configuration found is on a curve known already."""
        return bool(self.cover.count) and self.cover.holds(start.centre, start.miss)

    def in_range(self, q: float) -> bool:
        """Return whether an input is in the range."""
        return self.whole or self.low <= q <= self.high

    def overlapping(self) -> bool:
        """Return whether two chains may go through one configuration of the range."""
        for chain in self.cover.chains:
            within = [p for p in chain.pieces if self.in_range(float(p.centre[-1]))]
            centres = np.array([piece.centre for piece in within])
            off = np.array([piece.miss for piece in within])
            for other in self.cover.chains:
                if other is not chain and within and may_meet(other, centres, off):
                    return True
        return False

    def problems(self) -> list[str]:
        """Return why chains are not whole curves, or not known to be different."""
        problems = [chain.problem for chain in self.cover.chains if chain.problem]
        if self.overlapping():
            problems.append(OVERLAPPING)
        if any(laps(chain) for chain in self.cover.chains):
            problems.append("a curve may have been gone round twice")
        return problems
