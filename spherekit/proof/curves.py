"""All configuration curves over a range of one input, proven complete.

Chains of pieces are found from boxes that paving cannot decide, until every box is proven
empty or lies in a piece, in which there is one arc. So the arcs are all configurations.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from itertools import pairwise

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.errors import PlanError
from spherekit.guarantee import Completeness, Guarantee
from spherekit.proof.along import Chain, Range, StationaryPlace, UndecidedInterval, stops
from spherekit.proof.balls import bits, exact, middle, pi, upper
from spherekit.proof.construction import Construction, construct, turned_together
from spherekit.proof.equations import Equations
from spherekit.proof.folded import Arm, Crossings
from spherekit.proof.gears import Written
from spherekit.proof.paving import FIRST, Axis, CoveredBoxes, paved
from spherekit.proof.saddles import Saddle
from spherekit.proof.search import OVERLAPPING, Search
from spherekit.proof.tubes import CertifiedArc

PRECISION = 80
SMALLEST = 1e-6
"""Boxes (rad) are not halved further."""
MOST_BOXES = 6_000_000


@dataclass(frozen=True)
class CertifiedCurves:
    """What is proven of the configuration curves over a range of the only input.

    `low` and `high` (rad); all `laps` turns of the input if `whole`. Every closed
    configuration of the range is on one of the `chains`, on an arm of one of the
    `crossings`, or in one of the boxes left over in `paving`.
    `stopping` holds for each chain where the input stops along it, and undecided parts.
    """

    written: Written
    construction: Construction
    equations: Equations
    range_text: tuple[str, str]
    low: float
    high: float
    whole: bool
    chains: tuple[Chain, ...]
    crossings: Crossings
    paving: CoveredBoxes
    problems: tuple[str, ...]

    @property
    def driven(self) -> int:
        """The number of the input's variable."""
        return self.construction.unknowns

    @property
    def laps(self) -> int:
        """The turns of the input in which its variable goes round: 1 without wheels."""
        return self.construction.laps

    def input_at(self, place: Floats) -> float:
        """Return the input (rad) at a place (v,)."""
        return float(place[self.driven]) * self.laps

    @cached_property
    def stopping(self) -> tuple[tuple[list[StationaryPlace], list[UndecidedInterval]], ...]:
        """Where the input stops along each chain: type II, dead centres of the input."""
        return self.stops_of(self.driven)

    def stops_of(
        self, variable: int
    ) -> tuple[tuple[list[StationaryPlace], list[UndecidedInterval]], ...]:
        """Return where a variable stops along each chain, and undecided parts."""
        still = self.still_in(variable)
        with bits(PRECISION):
            return tuple(
                ([], []) if rests else stops(self.equations, chain, variable)
                for chain, rests in zip(self.chains, still, strict=True)
            )

    @cached_property
    def ends(self) -> tuple[tuple[Arm | None, Arm | None], ...]:
        """The arms of crossings that each chain begins and ends on, None where on none."""
        return tuple(self.crossings.ends(c.pieces, c.closed) for c in self.chains)

    @cached_property
    def still(self) -> tuple[bool, ...]:
        """Whether all of a chain is at one input exactly: a curve of modes there."""
        return self.still_in(self.driven)

    def still_in(self, variable: int) -> tuple[bool, ...]:
        """Return of each chain whether a variable is exactly the same all along it."""
        with bits(PRECISION):
            return tuple(
                self.crossings.still(chain.pieces, variable) for chain in self.chains
            )

    @property
    def undecided(self) -> list[tuple[float, float]]:
        """Parts of the range (rad) at which configurations may be missing."""
        centres, radii = self.paving.centres, self.paving.radii
        parts = (
            [
                (self.input_at(q - r), self.input_at(q + r))
                for q, r in zip(centres, radii, strict=True)
            ]
            if len(centres)
            else []
        )
        joined: list[tuple[float, float]] = []
        for low, high in sorted([*parts, *self._near_crossings(), *self._doubts()]):
            if joined and low <= joined[-1][1] + 1e-12:
                joined[-1] = joined[-1][0], max(joined[-1][1], high)
            else:
                joined.append((low, high))
        return joined

    def _doubts(self) -> list[tuple[float, float]]:
        """Return the inputs (rad) of parts of chains along which the input may stop."""
        parts = []
        for doubt in (doubt for _, doubts in self.stopping for doubt in doubts):
            first, width = self.laps * doubt.low, self.laps * (doubt.high - doubt.low)
            for part in (0.0, 0.5, 1.0):
                within = self.inside(first + part * width)
                if within is not None:
                    low = within - part * width
                    parts.append((low, low + width))
        return parts

    def open_arms(self, variable: int) -> int:
        """Return at how many crossings a variable may stop but at the crossing itself."""
        return sum(self._open_at(n, variable) > 0.0 for n in range(len(self.saddles)))

    def _open_at(self, number: int, variable: int) -> float:
        """Return how far (rad) from a crossing a variable may stop, 0 if it does not."""
        saddle, off = self.saddles[number], 0.0
        if saddle.level != 0 and not (saddle.passes and saddle.passes[variable]):
            off = float(saddle.zone[variable])
        for two, still in zip(self.ends, self.still_in(variable), strict=True):
            for arm in two:
                open_ = arm is not None and arm.saddle == number and not still
                if arm is not None and open_ and not saddle.rates[arm.quadrant][variable]:
                    off = max(off, saddle.reach[arm.quadrant][variable])
        return off

    def _near_crossings(self) -> list[tuple[float, float]]:
        """Return the inputs (rad) at crossings between which the input may stop."""
        parts = []
        for number, saddle in enumerate(self.saddles):
            off = self._open_at(number, self.driven) * self.laps
            within = self.inside(self.input_at(saddle.centre))
            if off and within is not None:
                parts.append((within - off, within + off))
        return parts

    @property
    def saddles(self) -> list[Saddle]:
        """The parts of space in which curves cross or just miss each other."""
        return self.crossings.saddles

    @cached_property
    def crossed(self) -> list[float]:
        """Inputs (rad) in the range at which curves cross, or all but do, in order."""
        return self._inputs_of(saddle.centre for saddle in self.saddles)

    def _inputs_of(self, places: Iterable[Floats]) -> list[float]:
        """Return the inputs (rad) of places (v,) that are in the range, in order."""
        inputs = (self.inside(self.input_at(place)) for place in places)
        return sorted(q for q in inputs if q is not None)

    @cached_property
    def still_at(self) -> list[float]:
        """Inputs (rad) in the range at which there are whole curves of modes."""
        both = zip(self.chains, self.still, strict=True)
        kept: list[float] = []
        for q in self._inputs_of(chain.pieces[0].centre for chain, still in both if still):
            if all(abs(_apart(q, other, self.laps * TURN)) > 1e-9 for other in kept):
                kept.append(q)
        return kept

    def inside(self, q: float) -> float | None:
        """Return an input less all laps if it is in the range, else None."""
        period = self.laps * TURN
        turned = self.low + np.remainder(q - self.low, period)
        if self.whole and turned > self.high - 1e-9:
            turned -= period
        for candidate in (turned, turned - period):
            if self.low - 1e-9 <= candidate <= self.high + 1e-9:
                return float(candidate)
        return None

    @cached_property
    def turning_points(self) -> list[float]:
        """Inputs (rad) in the range at which two modes meet, in order."""
        return self._inputs_of(s.place for stopped, _ in self.stopping for s in stopped)

    def modes_at(self, q: float) -> int:
        """Return the number of modes at an input (rad) that is no turning point."""
        # of the variable, which goes round once in all laps
        return sum(_crossings(low, high, q / self.laps) for low, high in self.segments)

    @cached_property
    def segments(self) -> list[tuple[float, float]]:
        """The input's variable (rad, turns counted) along parts of chains without stops."""
        segments = []
        for number, chain in enumerate(self.chains):
            if not self.still[number]:
                one, other = self.ends[number]
                ways = self._on(chain.pieces[0], one), self._on(chain.pieces[-1], other)
                segments += _segments(chain, self.stopping[number], self.driven, ways)
        return segments

    def _on(self, piece: CertifiedArc, arm: Arm | None) -> float:
        """Return how far the input goes from the end of a chain to a crossing there."""
        if arm is None:
            return 0.0
        goal = self.crossings.saddles[arm.saddle].centre[self.driven]
        return _apart(float(piece.centre[self.driven]), float(goal))

    @cached_property
    def intervals(self) -> list[tuple[float, float, int]]:
        """The range cut at turning points (rad), with the number of modes of each part.

        Undecided parts are left out; there are none where two chains may be of one curve.
        """
        if OVERLAPPING in self.problems:
            return []
        ends = [end for part in self.undecided for end in part]
        inner = [end for end in ends if self.low < end < self.high]
        special = [*self.turning_points, *self.crossed, *self.still_at, *inner]
        edges = [self.low, *sorted(q for q in special if self._is_within(q)), self.high]
        # places that are not told apart have no part of the range between them
        off = max(
            (stop.off for stopped, _ in self.stopping for stop in stopped), default=0.0
        )
        off *= self.laps
        return [
            (low, high, self.modes_at(0.5 * (low + high)))
            for low, high in pairwise(edges)
            if high - low > max(2.0 * off, 1e-12)
            and not self._is_undecided(0.5 * (low + high))
        ]

    def _is_within(self, q: float) -> bool:
        return self.low + 1e-12 < q < self.high - 1e-12

    def _is_undecided(self, q: float) -> bool:
        """Return whether an input of the range (rad) is in an undecided part of it."""
        period = self.laps * TURN
        turns = (-period, 0.0, period) if self.whole else (0.0,)
        return any(
            low <= q + turn <= high for low, high in self.undecided for turn in turns
        )

    @cached_property
    def claim(self) -> Completeness:
        """What is guaranteed, and what that rests on."""
        pieces = sum(len(chain.pieces) for chain in self.chains)
        rests = (
            f"{len(self.chains)} curves of {pieces} pieces with one arc each, "
            f"{self.paving.looked_at} boxes"
        )
        parts = self.undecided
        rests += _met(self.crossings.saddles)
        if OVERLAPPING in self.problems:
            rests = f"{OVERLAPPING}; {rests}"
        if parts:
            widest = max(high - low for low, high in parts)
            return Completeness(
                Guarantee.TO_BOX,
                f"{len(parts)} parts of the range are undecided; elsewhere {rests}",
                max(widest, float(2.0 * np.max(self.paving.radii, initial=0.0))),
            )
        if self.problems:
            return Completeness(Guarantee.COMPONENT, f"{self.problems[0]}; {rests}")
        return Completeness(Guarantee.CERTIFIED, f"all configurations; {rests}")


def _met(saddles: Sequence[Saddle]) -> str:
    """Return words for where curves cross or nearly do."""
    parts = []
    for words, level in (
        ("cross", (0,)),
        ("miss each other", (1, -1)),
        ("cross, or miss each other,", (None,)),
    ):
        count = sum(saddle.level in level for saddle in saddles)
        if count:
            parts.append(f", which {words} at {count} place{'s' * (count != 1)}")
    return "".join(parts)


def _crossings(low: float, high: float, q: float) -> int:
    """Return how often an input, of any turn, lies between two."""
    first, last = sorted((low, high))
    return int(np.floor((last - q) / TURN) - np.floor((first - q) / TURN))


def _segments(
    chain: Chain,
    stopping: tuple[Sequence[StationaryPlace], Sequence[UndecidedInterval]],
    driven: int,
    ways: tuple[float, float],
) -> list[tuple[float, float]]:
    """Return the spans of the input along a chain but where it stops or may stop.

    `ways` are how far it goes on at both ends.
    """
    q = float(chain.pieces[0].centre[driven])
    start = q
    breaks: list[tuple[float, float]] = []
    for number, (piece, further) in enumerate(chain.links):
        places = [(s.place, s.place) for s in stopping[0] if s.after == number]
        places += [(d.first, d.last) for d in stopping[1] if d.after == number]
        places.sort(key=lambda two: float(piece.coordinates(two[0])[0]))
        for first, last in places:
            one, other = (
                q + _apart(piece.centre[driven], p[driven]) for p in (first, last)
            )
            breaks.append((one, other))
        q += _apart(piece.centre[driven], further.centre[driven])
    if chain.closed and breaks:
        # the last one goes on into the first, as many turns on
        breaks.append((breaks[0][0] + q - start, breaks[0][1] + q - start))
    else:
        breaks = [(start, start + ways[0]), *breaks, (q + ways[1], q)]
    return [(one[1], other[0]) for one, other in pairwise(breaks)]


def _apart(one: float, other: float, period: float = TURN) -> float:
    """Return the shorter way from one angle to another."""
    return float(np.remainder(other - one + 0.5 * period, period) - 0.5 * period)


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
    with bits(PRECISION):
        if made.followers:
            made = turned_together(written, made)
        equations = Equations(written, made)
        # of the variable, that goes round once where the input has gone round all laps
        low, high = (written.input_angle(text) / made.laps for text in range_text)
        turns = middle(high - low) / TURN
        exact_turn = _all_laps(written, range_text, made.laps)
        if turns > 1.0 and not exact_turn:
            allowed = "a turn" if made.laps == 1 else f"{made.laps} turns"
            raise PlanError(
                f"{written.mechanism.name}: {range_text[0]} to {range_text[1]} is more "
                f"than {allowed}, after which everything returns; give at most that"
            )
        axes = [Axis(exact(FIRST), 2 * pi()) for _ in range(made.unknowns)]
        axes.append(Axis(low, 2 * pi()) if exact_turn else Axis(low, high - low))
        inputs = Range(middle(low), middle(high), exact_turn)
        search = Search(equations, inputs)
        done = paved(equations, axes, search.covers, search.look, smallest, most)
        done = search.without_saddles(done)
        assert upper(high - low) > 0.0
    return CertifiedCurves(
        written,
        made,
        equations,
        range_text,
        inputs.low * made.laps,
        inputs.high * made.laps,
        inputs.whole,
        tuple(search.cover.chains),
        search.crossings,
        done,
        tuple(search.problems()),
    )


def _all_laps(written: Written, range_text: tuple[str, str], laps: int) -> bool:
    """Return whether a range in degrees is exactly so many turns."""
    low, high = (Decimal(text) for text in range_text)
    return written.document.data["angle_unit"] == "deg" and high - low == 360 * laps
