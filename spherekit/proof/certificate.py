"""Certificates: what was proven, with all that a checker needs to prove it again."""

from collections.abc import Mapping, Sequence
from typing import Any

from spherekit.guarantee import Guarantee
from spherekit.proof.balls import Ball, bits, exact, middle, parts_of, upper
from spherekit.proof.construction import Across, Construction
from spherekit.proof.curves import CertifiedCurves
from spherekit.proof.input_map import CONTAINS, REGULAR, UNDECIDED, InputMap
from spherekit.proof.modes import CertifiedModes
from spherekit.proof.poles import CertifiedPole
from spherekit.proof.roots import Root
from spherekit.proof.singular import CertifiedSingularities
from spherekit.proof.systems import SolvedSystem
from spherekit.proof.written import Written
from spherekit.version import __version__

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


def heading(statement: str, text: str, tolerance: float) -> dict[str, Any]:
    """Return the entries that all certificates begin with."""
    return {
        "certificate": FORMAT,
        "made_by": f"spherekit {__version__}",
        "statement": statement,
        "mechanism": text,
        "tolerance_rad": tolerance,
    }


def modes_certificate(modes: CertifiedModes) -> dict[str, Any]:
    """Return the certificate of the modes at inputs.

    The root centres are exact: mantissa and exponent of 2 of real and imaginary parts.
    """
    written = modes.written
    driven = [written.structure.pairs[pair] for pair in modes.construction.driven]
    return {
        **heading("modes at inputs", written.document.text or "", written.tolerance),
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
        if isinstance(step, Across):
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
        **heading("curves over a range", written.document.text or "", written.tolerance),
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


def _wheels(written: Written, made: Construction) -> list[dict[str, Any]]:
    """Return by how much wheels turn with the only variable, and their angles at zero."""
    structure = written.structure
    turns = {step.pair: step.turns for step in made.steps if isinstance(step, Across)}
    with bits(WHEEL_BITS):
        angles = written.given([exact(0.0)])[1:]
        return [
            {
                "pair": structure.pairs[pair],
                "turns": turns[pair],
                "at_zero_rad": middle(angle),
                "off": upper(angle - exact(middle(angle))),
            }
            for pair, angle in zip(structure.followers, angles, strict=True)
        ]


def map_certificate(boxes: InputMap) -> dict[str, Any]:
    """Return the certificate of boxes of several inputs: what was proven of each."""
    written, made = boxes.written, boxes.construction
    driven = [written.structure.pairs[pair] for pair in made.driven]
    kinds = {REGULAR: "regular", CONTAINS: "contains type II", UNDECIDED: "undecided"}
    return {
        **heading("modes over boxes", written.document.text or "", written.tolerance),
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
        **heading("wheels fix all angles", written.document.text or "", written.tolerance),
        "inputs": [structure.pairs[pair] for pair in structure.inputs],
        "ratios": [
            {
                "pair": structure.pairs[pair],
                "ratios": [middle(ratio) for ratio in row],
                "off": max(upper(ratio - exact(middle(ratio))) for ratio in row),
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
        balls = (*(pole.direction or ()), pole.coefficient)
        numbers = [middle(ball) for ball in balls]
        off = [
            upper(ball - exact(number)) for ball, number in zip(balls, numbers, strict=True)
        ]
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
        "centre": [[_exact(number.real), _exact(number.imag)] for number in root.centre],
        "radius": root.radius,
        "alone_within": root.unique,
    }


def _exact(ball: Ball) -> list[int]:
    return list(parts_of(ball))
