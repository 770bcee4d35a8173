"""Singularities over a range, proven: where the input or an output stops along the curves.

An output that a pair joins to the link it is seen from turns about one axis, so it rests
where that pair's variable stops: type I. The input rests where its own variable stops:
type II. Where neither does, the curves are free of both.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.guarantee import Guarantee
from spherekit.numeric.turns import wrap
from spherekit.proof.along import Stop
from spherekit.proof.curves import CertifiedCurves
from spherekit.proof.written import Written

ROUNDING = 1e-12
"""More than inputs (rad) are off by in float64."""


@final
@dataclass(frozen=True)
class CertifiedSingularity:
    """A singular configuration of an output: exactly one within `stop.off` of its place.

    `kind` is I, II, or "I or III" and "II or III" where the other one stops as near.
    `q` (rad) is the input, `inside` whether it is in the range.
    """

    output: str
    kind: str
    curve: int
    stop: Stop
    q: float
    inside: bool


@final
@dataclass(frozen=True)
class CertifiedSingularities:
    """All singularities of types I and II of outputs along certified curves.

    `undecided` counts the parts in which one may be; `skipped` are outputs that no variable
    of the construction is the rate of, of which only type II is known. `low` to `high`
    (rad) is the range of the input, a whole turn if `whole`; `complete` says that all
    curves are known. At `dead_centres` the input stops, at the inputs `crossed` (rad)
    curves cross or nearly do, and at those of `still` there are whole curves of modes.
    An output of `resting` is at rest all along the curve of that number. Inputs are `laps`
    times the variables of places.
    """

    points: tuple[CertifiedSingularity, ...]
    undecided: int
    skipped: tuple[str, ...]
    low: float
    high: float
    whole: bool
    complete: bool
    dead_centres: tuple[Stop, ...]
    crossed: tuple[tuple[float, float], ...] = ()
    still: tuple[float, ...] = ()
    resting: tuple[tuple[str, int], ...] = ()
    laps: int = 1

    def clearance(self, q: float) -> float:
        """Return how far (rad) the input may go from q before a singularity, at least.

        In all modes, both ways, and not beyond the range; 0 where not all is proven.
        """
        if not self.complete or self.undecided:
            return 0.0
        ends = [] if self.whole else [q - self.low, self.high - q]
        stops = (*self.dead_centres, *(point.stop for point in self.points))
        places = [
            *((self.laps * float(s.place[-1]), self.laps * s.off) for s in stops),
            *self.crossed,
            *((place, 0.0) for place in self.still),
        ]
        half = np.pi * self.laps
        gaps = [
            abs(float(np.remainder(place - q + half, 2.0 * half)) - half) - off
            for place, off in places
        ]
        return max(min([*gaps, *ends, half]) - self.laps * ROUNDING, 0.0)


def pair_of_output(written: Written, name: str) -> int | None:
    """Return the pair that joins an output to what it is seen from, None without one."""
    mechanism = written.mechanism
    output = next(declared for declared in mechanism.outputs if declared.name == name)
    two = {mechanism.link(output.link), mechanism.link(output.relative_to)}
    for number, ends in enumerate(written.structure.ends):
        if set(ends) == two:
            return number
    return None


def output_pairs(written: Written) -> list[int]:
    """Return the pairs that join outputs to what they are seen from."""
    pairs = (pair_of_output(written, output.name) for output in written.mechanism.outputs)
    return [pair for pair in pairs if pair is not None]


def singularities(curves: CertifiedCurves) -> CertifiedSingularities:
    """Return the singularities of all declared outputs but the input itself."""
    mechanism, made = curves.written.mechanism, curves.construction
    points: list[CertifiedSingularity] = []
    undecided = sum(len(doubts) for _, doubts in curves.stopping)
    undecided += curves.open_arms(curves.driven)
    skipped: list[str] = []
    resting: list[tuple[str, int]] = []
    for output in mechanism.outputs:
        pair = pair_of_output(curves.written, output.name)
        if pair == made.pairs[curves.driven] or pair in curves.equations.offsets:
            continue
        has_angle = pair is not None and pair in made.pairs
        variable = made.pairs.index(pair) if pair is not None and has_angle else None
        stops = None if variable is None else curves.stops_of(variable)
        if variable is not None:
            undecided += curves.open_arms(variable)
            still = enumerate(curves.still_in(variable))
            resting += [(output.name, curve) for curve, rests in still if rests]
        if stops is None:
            skipped.append(output.name)
        for curve, (driven, _) in enumerate(curves.stopping):
            rests, doubts = stops[curve] if stops is not None else ([], [])
            undecided += len(doubts)
            for kind, one, others in (("I", rests, driven), ("II", driven, rests)):
                for stop in one:
                    near = any(_meet(stop, other) for other in others)
                    words = f"{kind} or III" if near else kind
                    inside = curves.inside(curves.input_at(stop.place))
                    q = curves.input_at(stop.place) if inside is None else inside
                    points.append(
                        CertifiedSingularity(
                            output.name, words, curve, stop, q, inside is not None
                        )
                    )
    points.sort(key=lambda point: (point.output, point.kind, point.q))
    complete = curves.claim.guarantee is Guarantee.CERTIFIED
    return CertifiedSingularities(
        tuple(points),
        undecided,
        tuple(skipped),
        curves.low,
        curves.high,
        curves.whole,
        complete,
        tuple(stop for found_on, _ in curves.stopping for stop in found_on),
        tuple(
            (curves.input_at(saddle.centre), curves.input_at(saddle.zone))
            for saddle in curves.crossings.saddles
        ),
        tuple(curves.still_at),
        tuple(resting),
        curves.laps,
    )


def _meet(one: Stop, other: Stop) -> bool:
    """Return whether two stops may be at the same configuration."""
    apart = wrap(one.place - other.place)
    return bool(np.all(np.abs(apart) <= one.off + other.off))
