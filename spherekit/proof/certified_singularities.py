"""Singularities over a range, proven: where the input or an output is stationary.

An output that a pair joins to the link it is seen from turns about one axis, so it rests
where that pair's variable stops: type I. The input rests where its own variable stops:
type II. Where neither does, the curves are free of both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.completeness import Guarantee
from spherekit.numerics.angles import wrap
from spherekit.proof.configuration_curves import CertifiedCurves
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.stationary_points import StationaryPlace, Stops

ROUNDING = 1e-12
"""More than inputs (rad) are off by in float64."""


@dataclass(frozen=True)
class CertifiedSingularities:
    """All singularities of types I and II of outputs along certified curves.

    Of the `points` each is the only singular configuration within `off` of its place: the
    output, I, II, or "I or III" and "II or III" where the other one stops as near, the
    input (rad), the number of the curve and the place. `undecided` counts the parts in
    which one may be; `skipped` are outputs that no variable of the construction is the rate
    of, of which only type II is known. An output of `resting` is at rest all along the
    curve of that number.
    """

    curves: CertifiedCurves
    points: Sequence[tuple[str, str, float, int, StationaryPlace]]
    undecided: int
    skipped: Sequence[str]
    resting: Sequence[tuple[str, int]]

    def clearance(self, q: float) -> float:
        """Return how far (rad) the input may go from q before a singularity, at least.

        In all modes, both ways, and not beyond the range; 0 where not all is proven.
        """
        curves = self.curves
        if curves.claim.guarantee is not Guarantee.CERTIFIED or self.undecided:
            return 0.0
        ends = [] if curves.whole else [q - curves.low, curves.high - q]
        stops = [stop for stopped, _ in curves.stopping for stop in stopped]
        stops += [stop for *_, stop in self.points]
        at = curves.input_at
        places = [(at(stop.place), curves.laps * stop.off) for stop in stops]
        places += [(at(saddle.centre), at(saddle.zone)) for saddle in curves.saddles]
        places += [(place, 0.0) for place in curves.still_at]
        half = np.pi * curves.laps
        gaps = [
            abs(np.remainder(place - q + half, 2.0 * half) - half) - off
            for place, off in places
        ]
        return max(min([*gaps, *ends, half]) - curves.laps * ROUNDING, 0.0)


def output_pairs(written: Written) -> dict[str, int]:
    """Return the pairs that join outputs to what they are seen from, by output."""
    mechanism, pairs = written.mechanism, dict[str, int]()
    for output in mechanism.outputs:
        two = {mechanism.link(output.link), mechanism.link(output.relative_to)}
        for number, ends in enumerate(written.structure.ends):
            if set(ends) == two:
                pairs.setdefault(output.name, number)
    return pairs


def singularities(curves: CertifiedCurves) -> CertifiedSingularities:
    """Return the singularities of all declared outputs but the input itself."""
    made, pairs = curves.construction, output_pairs(curves.written)
    points: list[tuple[str, str, float, int, StationaryPlace]] = []
    skipped: list[str] = []
    resting: list[tuple[str, int]] = []
    fixed = {made.pairs[curves.driven], *curves.equations.offsets}
    looked = [(curves.driven, curves.stopping)]
    for output in (item.name for item in curves.written.mechanism.outputs):
        pair = pairs.get(output)
        if pair in fixed:
            continue
        rests: list[Stops] = [([], []) for _ in curves.chains]
        if pair in made.pairs:
            variable = made.pairs.index(pair)
            rests = curves.stops_of(variable)
            looked.append((variable, rests))
            resting += [
                (output, k) for k, still in enumerate(curves.still_in(variable)) if still
            ]
        else:
            skipped.append(output)
        both = enumerate(zip(rests, curves.stopping, strict=True))
        for curve, ((resting_at, _), (driven_at, _)) in both:
            for kind, one, others in (
                ("I", resting_at, driven_at),
                ("II", driven_at, resting_at),
            ):
                for stop in one:
                    words = f"{kind} or III" if _meets(stop, others) else kind
                    q = curves.input_at(stop.place)
                    inside = curves.inside(q)
                    q = q if inside is None else inside
                    points.append((output, words, q, curve, stop))
    points.sort(key=lambda point: point[:3])
    undecided = sum(len(doubts) for _, stops in looked for _, doubts in stops)
    undecided += sum(
        off > 0.0 for variable, _ in looked for off in curves.open_at(variable)
    )
    return CertifiedSingularities(curves, points, undecided, skipped, resting)


def _meets(one: StationaryPlace, others: Sequence[StationaryPlace]) -> bool:
    """Return whether a stop may be at the same configuration as others."""
    return any(
        np.all(np.abs(wrap(one.place - other.place)) <= one.off + other.off)
        for other in others
    )
