"""Certificates: what was proven, with all that a checker needs to prove it again.

Singularities over a range, proven: where the input or an output stops along the curves.

An output that a pair joins to the link it is seen from turns about one axis, so it rests
where that pair's variable stops: type I. The input rests where its own variable stops:
type II. Where neither does, the curves are free of both.

Enclosures of pole axes and velocity coefficients of certified modes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from spherekit.guarantee import Guarantee
from spherekit.numeric.crossings import wrap
from spherekit.proof.along import StationaryPlace, UndecidedInterval
from spherekit.proof.balls import (
    Ball,
    bits,
    complex_ball,
    exact,
    lower,
    matrix,
    middle,
    parts_of,
    solved,
    upper,
)
from spherekit.proof.construction import Construction, PlacedByJoint
from spherekit.proof.curves import CertifiedCurves
from spherekit.proof.equations import Equations
from spherekit.proof.gears import Written
from spherekit.proof.modes import CertifiedModes
from spherekit.proof.paving import CONTAINS, REGULAR, UNDECIDED, InputMap
from spherekit.proof.roots import Root
from spherekit.proof.systems import SolvedSystem
from spherekit.version import __version__

ROUNDING = 1e-12
"""More than inputs (rad) are off by in float64."""


@dataclass(frozen=True)
class CertifiedSingularity:
    """A singular configuration of an output: exactly one within `stop.off` of its place.

    `kind` is I, II, or "I or III" and "II or III" where the other one stops as near.
    `q` (rad) is the input, `inside` whether it is in the range.
    """

    output: str
    kind: str
    curve: int
    stop: StationaryPlace
    q: float
    inside: bool


@dataclass(frozen=True)
class CertifiedSingularities:
    """All singularities of types I and II of outputs along certified curves.

    `undecided` counts the parts in which one may be; `skipped` are outputs that no variable
    of the construction is the rate of, of which only type II is known. An output of
    `resting` is at rest all along the curve of that number.
    """

    curves: CertifiedCurves
    points: tuple[CertifiedSingularity, ...]
    undecided: int
    skipped: tuple[str, ...]
    resting: tuple[tuple[str, int], ...]

    @property
    def complete(self) -> bool:
        """Whether all curves are known."""
        return self.curves.claim.guarantee is Guarantee.CERTIFIED

    def clearance(self, q: float) -> float:
        """Return how far (rad) the input may go from q before a singularity, at least.

        In all modes, both ways, and not beyond the range; 0 where not all is proven.
        """
        curves = self.curves
        if not self.complete or self.undecided:
            return 0.0
        ends = [] if curves.whole else [q - curves.low, curves.high - q]
        stops = [stop for stopped, _ in curves.stopping for stop in stopped]
        stops += [point.stop for point in self.points]
        places = [(curves.input_at(s.place), curves.laps * s.off) for s in stops]
        at = curves.input_at
        places += [(at(saddle.centre), at(saddle.zone)) for saddle in curves.saddles]
        places += [(place, 0.0) for place in curves.still_at]
        half = np.pi * curves.laps
        gaps = [
            abs(float(np.remainder(place - q + half, 2.0 * half)) - half) - off
            for place, off in places
        ]
        return max(min([*gaps, *ends, half]) - curves.laps * ROUNDING, 0.0)


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
        variable = next((v for v, p in enumerate(made.pairs) if p == pair), None)
        stops: Sequence[tuple[list[StationaryPlace], list[UndecidedInterval]]] = [
            ([], [])
        ] * len(curves.chains)
        if variable is None:
            skipped.append(output.name)
        else:
            stops = curves.stops_of(variable)
            undecided += curves.open_arms(variable)
            still = enumerate(curves.still_in(variable))
            resting += [(output.name, curve) for curve, rests in still if rests]
        for curve, (driven, _) in enumerate(curves.stopping):
            rests, doubts = stops[curve]
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
    return CertifiedSingularities(
        curves, tuple(points), undecided, tuple(skipped), tuple(resting)
    )


def _meet(one: StationaryPlace, other: StationaryPlace) -> bool:
    """Return whether two stops may be at the same configuration."""
    apart = wrap(one.place - other.place)
    return bool(np.all(np.abs(apart) <= one.off + other.off))


@dataclass(frozen=True)
class CertifiedPole:
    """The pole of link `first` relative to `second`, while one input moves at unit rate.

    `direction` are three balls in ground axes, `coefficient` a ball, not negative: the
    angular velocity is the coefficient times the direction. Where it may vanish,
    `direction` is None.
    """

    mode: int
    driven: int
    first: int
    second: int
    direction: tuple[Ball, Ball, Ball] | None
    coefficient: Ball


def certified_poles(modes: CertifiedModes) -> list[CertifiedPole]:
    """Return the poles of all pairs of links in all certified real modes.

    With several inputs each moves in turn, the others locked.
    """
    with modes.sharp() as (equations, places):
        return [
            pole
            for number, place in enumerate(places)
            for pole in enclosed_poles(equations, place, number)
        ]


def enclosed_poles(
    equations: Equations, places: Sequence[Ball], mode: int = 0
) -> Iterator[CertifiedPole]:
    """Yield the poles of all pairs of links at narrow balls of all variables."""
    made = equations.construction
    for column in range(made.unknowns, made.unknowns + made.inputs):
        turning = _angular_velocities(equations, places, column)
        yield from _poles(mode, made.pairs[column], turning)


def _angular_velocities(
    equations: Equations, places: Sequence[Ball], driven: int
) -> list[list[Ball]]:
    """Return the angular velocities of all links relative to the root, in ground axes."""
    _, slopes = equations.arrays(places)
    count, bodies = equations.unknowns, equations.written.structure.bodies
    inputs = [float(v + count == driven) for v in range(equations.construction.inputs)]
    following = [row[driven - count] for row in equations.written.ratios()]
    rates = [complex_ball(rate) for rate in (*map(exact, inputs), *following)]
    if count:
        right = -(slopes[:, count:] @ np.array(rates))
        unknown = solved(matrix(slopes[:, :count]), matrix(right[:, None])).entries()
        rates = [*unknown, *rates]
    placed = equations.orientations(places, 1)
    velocities = np.full((bodies, 3), complex_ball(0j), dtype=object)
    for link, jet in placed.items():
        parts = [jet[(v,)] * rate for v, rate in enumerate(rates) if (v,) in jet]
        if parts and link < bodies:
            spin = sum(parts[1:], parts[0]) * jet[()].transpose()
            velocities[link] = spin[2, 1], spin[0, 2], spin[1, 0]
    if equations.construction.root != 0:
        velocities = velocities @ np.array(placed[0][()].tolist())
    return [[entry.real for entry in velocity] for velocity in velocities]


def _poles(
    mode: int, driven: int, turning: Sequence[Sequence[Ball]]
) -> Iterator[CertifiedPole]:
    for second, first in combinations(range(len(turning)), 2):
        pairs = zip(turning[first], turning[second], strict=True)
        x, y, z = (a - b for a, b in pairs)
        size = (x * x + y * y + z * z).sqrt()
        turns = lower(size) > 0.0
        direction = (x / size, y / size, z / size) if turns else None
        yield CertifiedPole(mode, driven, first, second, direction, size)


FORMAT = 1
WHEEL_BITS = 80
CROSSING = {
    0: "curves cross",
    1: "curves miss each other, above and below",
    -1: "curves miss each other, left and right",
    None: "curves cross or miss each other",
}
"""What is proven of a crossing, by the sign of its level; the first rows of its frame are
to the right and upwards."""


def heading(statement: str, written: Written) -> dict[str, Any]:
    """Return the entries that all certificates begin with."""
    return {
        "certificate": FORMAT,
        "made_by": f"spherekit {__version__}",
        "statement": statement,
        "mechanism": written.document.text or "",
        "tolerance_rad": written.tolerance,
    }


def modes_certificate(modes: CertifiedModes) -> dict[str, Any]:
    """Return the certificate of the modes at inputs.

    The root centres are exact: mantissa and exponent of 2 of real and imaginary parts.
    """
    written = modes.written
    driven = [written.structure.pairs[pair] for pair in modes.construction.driven]
    return {
        **heading("modes at inputs", written),
        "inputs": dict(zip(driven, modes.inputs, strict=True)),
        "construction": construction_table(written, modes.construction),
        "bound": modes.bound,
        "complete": modes.complete,
        "counted": modes.counted,
        "undecided_rad": [
            {"centre": centre.tolist(), "half": half.tolist()}
            for centre, half in modes.clusters
        ],
        "modes": len(modes.real),
        "precision_bits": modes.precision,
        "systems": _systems(written, modes.construction, modes.systems),
        "roots": [_root(root) for root in modes.roots],
    }


def construction_table(written: Written, construction: Construction) -> Mapping[str, Any]:
    """Return an order of placing links with names."""
    structure = written.structure
    links, names = structure.links, structure.pairs
    steps: list[dict[str, Any]] = []
    for step in construction.steps:
        if isinstance(step, PlacedByJoint):
            parents, pairs = [links[step.parent]], [names[step.pair]]
        else:
            parents = [links[parent] for parent in step.parents]
            pairs = [names[pair] for pair in step.pairs]
        steps.append({"link": links[step.link], "on": parents, "by": pairs})
    return {
        "root": links[construction.root],
        "steps": steps,
        "unknowns": [names[pair] for pair in construction.pairs[: construction.unknowns]],
        "couplers": {
            written.mechanism.pairs[coupler.contact].name: {
                "link": links[coupler.link],
                "pairs": [names[pair] for pair in coupler.pairs],
            }
            for coupler in structure.couplers
        },
        "follow": [names[pair] for pair in structure.followers],
    }


def curves_certificate(curves: CertifiedCurves) -> dict[str, Any]:
    """Return the certificate of the curves over a range of the only input.

    Centres and frames are the float64 numbers that they are. A checker has to pave space
    again: the boxes are not in it.
    """
    written, made = curves.written, curves.construction
    names = written.structure.pairs
    return {
        **heading("curves over a range", written),
        "inputs": {names[made.pairs[curves.driven]]: list(curves.range_text)},
        "construction": construction_table(written, made),
        "input_turns_of_its_variable": made.laps,
        "wheels": _wheels(written, made),
        "complete": curves.claim.guarantee is Guarantee.CERTIFIED,
        "undecided_rad": [list(part) for part in curves.undecided],
        "problems": list(curves.problems),
        "boxes": curves.paving.looked_at,
        "turning_points_rad": curves.turning_points,
        "modes": [list(part) for part in curves.intervals],
        "curves_at_one_input_rad": curves.still_at,
        "crossings": [
            {
                "centre": saddle.centre.tolist(),
                "frame": saddle.frame.T.tolist(),
                "limits": saddle.limits.tolist(),
                "is": CROSSING[saddle.level],
                "gap_at_most": saddle.gap,
            }
            for saddle in curves.saddles
        ],
        "curves": [
            {
                "closed": chain.closed,
                "ends_at_crossings": [
                    None if arm is None else [arm.saddle, *arm.quadrant] for arm in ends
                ],
                "at_one_input": still,
                "input_stops": [
                    {"place": stop.place.tolist(), "off": stop.off} for stop in stopped
                ],
                "pieces": [
                    {
                        "centre": piece.centre.tolist(),
                        "frame": piece.frame.T.tolist(),
                        "half": piece.half,
                        "radius": piece.radius,
                    }
                    for piece in chain.pieces
                ],
            }
            for chain, (stopped, _), ends, still in zip(
                curves.chains, curves.stopping, curves.ends, curves.still, strict=True
            )
        ],
    }


def _near(balls: Sequence[Ball]) -> tuple[list[float], list[float]]:
    """Return float64 numbers next to balls, and by how much each is off at most."""
    numbers = [middle(ball) for ball in balls]
    pairs = zip(balls, numbers, strict=True)
    return numbers, [upper(ball - exact(number)) for ball, number in pairs]


def _wheels(written: Written, made: Construction) -> list[dict[str, Any]]:
    """Return by how much wheels turn with the only variable, and their angles at zero."""
    structure = written.structure
    turns = {
        step.pair: step.turns for step in made.steps if isinstance(step, PlacedByJoint)
    }
    with bits(WHEEL_BITS):
        angles, off = _near(written.given([exact(0.0)])[1:])
    keys = "pair", "turns", "at_zero_rad", "off"
    names = [structure.pairs[pair] for pair in structure.followers]
    every = [turns[pair] for pair in structure.followers]
    rows = zip(names, every, angles, off, strict=True)
    return [dict(zip(keys, row, strict=True)) for row in rows]


def map_certificate(boxes: InputMap) -> dict[str, Any]:
    """Return the certificate of boxes of several inputs: what was proven of each."""
    written, made = boxes.written, boxes.construction
    driven = [written.structure.pairs[pair] for pair in made.driven]
    kinds = {REGULAR: "regular", CONTAINS: "contains type II", UNDECIDED: "undecided"}
    return {
        **heading("modes over boxes", written),
        "inputs": dict(zip(driven, map(list, boxes.range_texts), strict=True)),
        "construction": construction_table(written, made),
        "systems": _systems(written, made, boxes.systems),
        "shares": {words: boxes.share(kind) for kind, words in kinds.items()},
        "boxes": [
            {
                "centre_rad": centre.tolist(),
                "half_rad": half.tolist(),
                "is": kinds[int(kind)],
                "modes": int(modes) if kind == REGULAR else None,
            }
            for centre, half, kind, modes in zip(
                boxes.centres, boxes.radii, boxes.kind, boxes.modes, strict=True
            )
        ],
    }


def wheels_certificate(
    written: Written, ratios: Sequence[Sequence[Ball]]
) -> dict[str, Any]:
    """Return the certificate of wheels that fix all angles: their rates by the inputs."""
    structure = written.structure
    return {
        **heading("wheels fix all angles", written),
        "inputs": [structure.pairs[pair] for pair in structure.inputs],
        "ratios": [
            {
                "pair": structure.pairs[pair],
                "ratios": _near(row)[0],
                "off": max(_near(row)[1]),
            }
            for pair, row in zip(structure.followers, ratios, strict=True)
        ],
    }


def pole_table(
    modes: CertifiedModes, poles: Sequence[CertifiedPole]
) -> list[dict[str, Any]]:
    """Return enclosures of poles: float64 numbers, and how far off they are at most."""
    structure = modes.written.structure
    table = []
    for pole in poles:
        numbers, off = _near((*(pole.direction or ()), pole.coefficient))
        table.append(
            {
                "mode": pole.mode,
                "moving": structure.pairs[pole.driven],
                "link": structure.links[pole.first],
                "relative_to": structure.links[pole.second],
                "direction": numbers[:-1] or None,
                "direction_off": max(off[:-1], default=None),
                "velocity_coefficient": numbers[-1],
                "velocity_coefficient_off": off[-1],
            }
        )
    return table


def singular_table(located: CertifiedSingularities) -> dict[str, Any]:
    """Return the singularities of a range."""
    return {
        "undecided_parts": located.undecided,
        "outputs_without_pair": list(located.skipped),
        "at_rest_along_curves": [list(two) for two in located.resting],
        "found": [
            {
                "output": point.output,
                "type": point.kind,
                "curve": point.curve,
                "place": point.stop.place.tolist(),
                "off": point.stop.off,
            }
            for point in located.points
        ],
    }


def _systems(
    written: Written, made: Construction, systems: Sequence[SolvedSystem]
) -> list[dict[str, Any]]:
    """Return systems with the approximations of all their solutions for each mode.

    A solution has e^(i angle) of each unknown, or its inverse where that says so.
    """
    structure = written.structure
    names = [structure.pairs[pair] for pair in made.pairs]
    return [
        {
            "equations": [
                structure.links[made.equations[k].link] for k in system.equations
            ],
            "unknowns": [names[k] for k in system.unknowns],
            "solved": [
                {
                    "given": dict(
                        zip(
                            (names[k] for k in system.given), roots.at.tolist(), strict=True
                        )
                    ),
                    "solutions": [
                        {
                            "inverse": inverse.tolist(),
                            "z": [[float(e.real), float(e.imag)] for e in z],
                        }
                        for inverse, z in zip(
                            roots.points.inverse, roots.points.z, strict=True
                        )
                    ],
                }
                for roots in system.solved
            ],
        }
        for system in systems
    ]


def _root(root: Root) -> dict[str, Any]:
    return {
        "real": root.real,
        "centre": [
            [list(parts_of(part)) for part in (number.real, number.imag)]
            for number in root.centre
        ],
        "radius": root.radius,
        "alone_within": root.unique,
    }
