"""Certificates: what was proven, with all that a checker needs to prove it again."""

from collections.abc import Mapping, Sequence
from typing import Any

from spherekit.completeness import Guarantee
from spherekit.proof.ball_frames import exact
from spherekit.proof.balls import Ball, bits, middle, upper
from spherekit.proof.certified_modes import CertifiedModes
from spherekit.proof.certified_singularities import CertifiedSingularities
from spherekit.proof.configuration_curves import CertifiedCurves
from spherekit.proof.construction import Construction
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.enclosed_poles import enclosed_poles
from spherekit.proof.input_map import CONTAINS, REGULAR, UNDECIDED, InputMap
from spherekit.proof.modes_over_boxes import System
from spherekit.proof.root_ball import Root
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
    driven = written.structure.names_of(modes.construction.driven)
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
    links = structure.links
    return {
        "root": links[construction.root],
        "steps": [
            {
                "link": links[step.link],
                "on": [links[parent] for parent in step.parents],
                "by": structure.names_of(step.pairs),
            }
            for step in construction.steps
        ],
        "unknowns": structure.names_of(construction.pairs[: construction.unknowns]),
        "couplers": {
            written.mechanism.pairs[contact].name: {
                "link": links[link],
                "pairs": structure.names_of(pairs),
            }
            for number, contact in enumerate(structure.couplers)
            for link, pairs in [structure.coupler(number)]
        },
        "follow": structure.names_of(structure.followers),
    }


def curves_certificate(curves: CertifiedCurves) -> dict[str, Any]:
    """Return the certificate of the curves over a range of the only input.

    Centres and frames are the float64 numbers that they are. A checker has to pave space
    again: the boxes are not in it.
    """
    written, made = curves.written, curves.construction
    return {
        **heading("curves over a range", written),
        "inputs": {written.structure.pairs[made.pairs[curves.driven]]: curves.range_text},
        "construction": construction_table(written, made),
        "input_turns_of_its_variable": made.laps,
        "wheels": _wheels(written, made),
        "complete": curves.claim.guarantee is Guarantee.CERTIFIED,
        "undecided_rad": curves.undecided,
        "problems": curves.problems,
        "boxes": curves.boxes,
        "turning_points_rad": curves.turning_points,
        "modes": curves.intervals,
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
                    None if arm is None else [arm[0], *arm[1]] for arm in ends
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
    return numbers, [upper(x - number) for x, number in zip(balls, numbers, strict=True)]


def _wheels(written: Written, made: Construction) -> list[dict[str, Any]]:
    """Return by how much wheels turn with the only variable, and their angles at zero."""
    structure = written.structure
    turns = {step.pairs: step.turns for step in made.steps}
    with bits(WHEEL_BITS):
        angles, off = _near(written.given([exact(0.0)])[1:])
    return [
        {
            "pair": structure.pairs[pair],
            "turns": turns[(pair,)],
            "at_zero_rad": angle,
            "off": spare,
        }
        for pair, angle, spare in zip(structure.followers, angles, off, strict=True)
    ]


def map_certificate(boxes: InputMap) -> dict[str, Any]:
    """Return the certificate of boxes of several inputs: what was proven of each."""
    written, made = boxes.written, boxes.construction
    driven = written.structure.names_of(made.driven)
    kinds = {REGULAR: "regular", CONTAINS: "contains type II", UNDECIDED: "undecided"}
    return {
        **heading("modes over boxes", written),
        "inputs": dict(zip(driven, boxes.range_texts, strict=True)),
        "construction": construction_table(written, made),
        "systems": _systems(written, made, boxes.systems),
        "shares": {words: boxes.share(kind) for kind, words in kinds.items()},
        "boxes": [
            {
                "centre_rad": centre.tolist(),
                "half_rad": half.tolist(),
                "is": kinds[kind],
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
        "inputs": structure.names_of(structure.inputs),
        "ratios": [
            {
                "pair": structure.pairs[pair],
                "ratios": _near(row)[0],
                "off": max(_near(row)[1]),
            }
            for pair, row in zip(structure.followers, ratios, strict=True)
        ],
    }


def pole_table(modes: CertifiedModes) -> list[dict[str, Any]]:
    """Return enclosures of all poles in all certified real modes.

    As float64 numbers, and how far these are off at most.
    """
    structure, table = modes.written.structure, []
    with modes.sharp() as (equations, places):
        for mode, place in enumerate(places):
            for key, direction, coefficient in enclosed_poles(equations, place):
                (*numbers, size), (*off, spare) = _near(
                    [*(() if direction is None else direction), coefficient]
                )
                table.append(
                    {
                        "mode": mode,
                        "moving": structure.pairs[key[0]],
                        "link": structure.links[key[1]],
                        "relative_to": structure.links[key[2]],
                        "direction": numbers or None,
                        "direction_off": max(off, default=None),
                        "velocity_coefficient": size,
                        "velocity_coefficient_off": spare,
                    }
                )
    return table


def singular_table(located: CertifiedSingularities) -> dict[str, Any]:
    """Return the singularities of a range."""
    return {
        "undecided_parts": located.undecided,
        "outputs_without_pair": located.skipped,
        "at_rest_along_curves": located.resting,
        "found": [
            {
                "output": output,
                "type": kind,
                "curve": curve,
                "place": stop.place.tolist(),
                "off": stop.off,
            }
            for output, kind, _, curve, stop in located.points
        ],
    }


def _systems(
    written: Written, made: Construction, systems: Sequence[System]
) -> list[dict[str, Any]]:
    """Return systems with the approximations of all their solutions for each mode.

    A solution has e^(i angle) of each unknown, or its inverse where that says so.
    """
    structure = written.structure
    names = structure.names_of(made.pairs)
    return [
        {
            "equations": [structure.links[made.equations[k].link] for k in system.rows],
            "unknowns": [names[k] for k in system.unknowns],
            "solved": [
                {
                    "given": dict(
                        zip((names[k] for k in system.given), place.tolist(), strict=True)
                    ),
                    "solutions": [
                        {
                            "inverse": inverse.tolist(),
                            "z": [[e.real, e.imag] for e in z],
                        }
                        for inverse, z in zip(roots.inverse, roots.z, strict=True)
                    ],
                }
                for place, roots in system.solved
            ],
        }
        for system in systems
    ]


def _root(root: Root) -> dict[str, Any]:
    return {
        "real": root.real,
        "centre": [
            [list(map(int, part.man_exp())) for part in (number.real, number.imag)]
            for number in root.centre
        ],
        "radius": root.radius,
        "alone_within": root.unique,
    }
