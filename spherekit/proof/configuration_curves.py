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
from spherekit.completeness import Completeness, Guarantee
from spherekit.conventions import TURN
from spherekit.errors import PlanError
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import Equations
from spherekit.proof.ball_frames import exact
from spherekit.proof.balls import Ball, bits, middle, pi
from spherekit.proof.chains import Chain
from spherekit.proof.collinear_loops import Arm, Crossings
from spherekit.proof.construction import Construction, construct, turned_together
from spherekit.proof.curve_search import OVERLAPPING, Search
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.paving import FIRST, Left, Ranges, paved
from spherekit.proof.saddles import Saddle
from spherekit.proof.stationary_points import Stops, stops
from spherekit.wording import counted

PRECISION = 80
MOST_BOXES = 6_000_000


@dataclass(frozen=True)
class CertifiedCurves:
    """What is proven of the configuration curves over a range of the only input.

    `low` and `high` (rad); all `laps` turns of the input if `whole`. Every closed
    configuration of the range is on one of the `chains`, on an arm of one of the
    `crossings`, or in one of those `left` of so many `boxes`.
    `stopping` holds for each chain where the input stops along it, and undecided parts.
    """

    written: Written
    construction: Construction
    equations: Equations
    range_text: tuple[str, str]
    low: float
    high: float
    whole: bool
    chains: Sequence[Chain]
    crossings: Crossings
    boxes: int
    left: Left
    problems: Sequence[str]

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
        return place[self.driven] * self.laps

    @cached_property
    def stopping(self) -> list[Stops]:
        """Where the input stops along each chain: type II, dead centres of the input."""
        return self.stops_of(self.driven)

    def stops_of(self, variable: int) -> list[Stops]:
        """Return where a variable stops along each chain, and undecided parts."""
        with bits(PRECISION):
            return [
                ([], []) if rests else stops(self.equations, chain, variable)
                for chain, rests in zip(self.chains, self.still_in(variable), strict=True)
            ]

    @cached_property
    def ends(self) -> list[tuple[Arm | None, Arm | None]]:
        """The arms of crossings that each chain begins and ends on, None where on none."""
        return [self.crossings.ends(c.pieces, c.closed) for c in self.chains]

    @cached_property
    def still(self) -> list[bool]:
        """Whether all of a chain is at one input exactly: a curve of modes there."""
        return self.still_in(self.driven)

    def still_in(self, variable: int) -> list[bool]:
        """Return of each chain whether a variable is exactly the same all along it."""
        with bits(PRECISION):
            return [self.crossings.still(chain.pieces, variable) for chain in self.chains]

    @cached_property
    def undecided(self) -> list[tuple[float, float]]:
        """Parts of the range (rad) at which configurations may be missing."""
        parts = [
            (self.input_at(q - r), self.input_at(q + r))
            for q, r in zip(*self.left, strict=True)
        ]
        around = [
            (saddle.centre, off, 0.0)
            for saddle, off in zip(self.saddles, self.open_at(self.driven), strict=True)
            if off
        ]
        # parts of chains along which the input may stop, that may reach into the range
        around += [
            (doubt.place, doubt.off, part)
            for _, doubts in self.stopping
            for doubt in doubts
            for part in (-1.0, 0.0, 1.0)
        ]
        for place, off, part in around:
            half = off * self.laps
            within = self.inside(self.input_at(place) + part * half)
            if within is not None:
                middle = within - part * half
                parts.append((middle - half, middle + half))
        joined: list[tuple[float, float]] = []
        for low, high in sorted(parts):
            if joined and low <= joined[-1][1] + 1e-12:
                low, last = joined.pop()
                high = max(last, high)
            joined.append((low, high))
        return joined

    def open_at(self, variable: int) -> list[float]:
        """Return how far (rad) from each crossing a variable may stop, 0 if nowhere.

        That is but at the crossing itself.
        """
        still = self.still_in(variable)
        moving = [two for two, rests in zip(self.ends, still, strict=True) if not rests]
        offs = []
        for number, saddle in enumerate(self.saddles):
            passed = saddle.level == 0 or saddle.passes[variable]
            parts = [0.0 if passed else saddle.zone[variable]]
            parts += [
                saddle.reach[arm[1]][variable]
                for two in moving
                for arm in two
                if arm and arm[0] == number and not saddle.rates[arm[1]][variable]
            ]
            offs.append(max(parts))
        return offs

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
        kept: list[float] = []
        for q in self._inputs_of(
            chain.pieces[0].centre
            for chain, still in zip(self.chains, self.still, strict=True)
            if still
        ):
            if all(abs(wrap((q - other) / self.laps)) > 1e-9 / self.laps for other in kept):
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
                return candidate
        return None

    @cached_property
    def turning_points(self) -> list[float]:
        """Inputs (rad) in the range at which two modes meet, in order."""
        return self._inputs_of(s.place for stopped, _ in self.stopping for s in stopped)

    def modes_at(self, q: float) -> int:
        """Return the number of modes at an input (rad) that is no turning point."""
        # of the variable, which goes round once in all laps
        turns = (np.floor((way - q / self.laps) / TURN) for way in self.ways)
        return int(sum(np.sum(np.abs(np.diff(turn))) for turn in turns))

    @cached_property
    def ways(self) -> list[Floats]:
        """The input's variable (rad, turns counted) along chains, monotonic in between.

        It is given at centres of pieces, at all stops, and at the crossings at the ends.
        """
        ways = []
        for chain, (stopped, doubts), arms, still in zip(
            self.chains, self.stopping, self.ends, self.still, strict=True
        ):
            places = []
            for number, (piece, _) in enumerate(chain.links):
                inner = [s.place for s in (*stopped, *doubts) if s.after == number]
                inner.sort(key=lambda place: piece.coordinates(place)[0])
                places += [piece.centre, *inner]
            first, last = (
                [] if arm is None else [self.saddles[arm[0]].centre] for arm in arms
            )
            end = chain.pieces[0 if chain.closed else -1].centre
            q = np.array([*first, *places, end, *last])[:, self.driven]
            if not still:
                ways.append(np.cumsum([q[0], *wrap(np.diff(q))]))
        return ways

    @cached_property
    def intervals(self) -> list[tuple[float, float, int]]:
        """The range cut at turning points (rad), with the number of modes of each part.

        Undecided parts are left out; there are none where two chains may be of one curve.
        """
        if OVERLAPPING in self.problems:
            return []
        ends = [end for part in self.undecided for end in part]
        special = [*self.turning_points, *self.crossed, *self.still_at, *ends]
        within = (q for q in special if self.low + 1e-12 < q < self.high - 1e-12)
        # places that are not told apart have no part of the range between them
        offs = [stop.off * self.laps for stopped, _ in self.stopping for stop in stopped]
        least = max(2.0 * max(offs, default=0.0), 1e-12)
        period = self.laps * TURN
        turns = (-period, 0.0, period) if self.whole else (0.0,)
        return [
            (low, high, self.modes_at(middle))
            for low, high in pairwise([self.low, *sorted(within), self.high])
            if high - low > least
            for middle in [0.5 * (low + high)]
            if not any(a <= middle + t <= b for a, b in self.undecided for t in turns)
        ]

    @cached_property
    def claim(self) -> Completeness:
        """What is guaranteed, and what that rests on."""
        pieces = sum(len(chain.pieces) for chain in self.chains)
        rests = (
            f"{counted(len(self.chains), 'curve')} of {pieces} pieces with one arc each, "
            f"{self.boxes} boxes{_met(self.saddles)}"
        )
        parts = self.undecided
        if OVERLAPPING in self.problems:
            rests = f"{OVERLAPPING}; {rests}"
        if parts:
            widest = max(high - low for low, high in parts)
            return Completeness(
                Guarantee.TO_BOX,
                f"{len(parts)} parts of the range are undecided; elsewhere {rests}",
                max(widest, 2.0 * np.max(self.left[1], initial=0.0)),
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
            parts.append(f", which {words} at {counted(count, 'place')}")
    return "".join(parts)


def certified_curves(
    written: Written,
    range_text: tuple[str, str],
    construction: Construction | None = None,
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
        first, last = map(Decimal, range_text)
        exact_turn = written.in_degrees and last - first == 360 * made.laps
        if middle(high - low) > TURN and not exact_turn:
            raise PlanError(
                f"{written.mechanism.name}: {first} to {last} is more than "
                f"{counted(made.laps, 'turn')}, after which everything returns; give at "
                "most that"
            )
        search, boxes, left = _searched(equations, low, high, exact_turn)
    return CertifiedCurves(
        written,
        made,
        equations,
        range_text,
        middle(low) * made.laps,
        middle(high) * made.laps,
        exact_turn,
        search.chains,
        search.crossings,
        boxes,
        left,
        search.problems(),
    )


def _searched(
    equations: Equations, low: Ball, high: Ball, whole: bool
) -> tuple[Search, int, Left]:
    """Return the search between values of the input's variable, its boxes and those left.

    They are a whole turn apart if `whole`.
    """
    count, turn, start, end = equations.unknowns, 2 * pi(), middle(low), middle(high)
    width = [*[turn] * count, turn if whole else high - low]
    ranges = Ranges([*[exact(FIRST)] * count, low], width)

    def side(q: float, off: float) -> int:
        return 0 if whole else int(q > end + off) - int(q < start - off)

    search = Search(equations, side)
    boxes, left = paved(equations, ranges, search.covers, search.take, MOST_BOXES)
    return search, boxes, search.without_saddles(*left)
