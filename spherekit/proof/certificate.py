"""Certificates: what was proven, with all that a checker needs to prove it again."""

from collections.abc import Mapping
from typing import Any

from spherekit.proof.balls import Ball, parts_of
from spherekit.proof.construction import Across, Construction
from spherekit.proof.modes import CertifiedModes
from spherekit.proof.roots import Root
from spherekit.version import __version__

FORMAT = 1


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
    names = [pair.name for pair in written.mechanism.pairs]
    driven = [
        names[pair] for pair in modes.construction.pairs[modes.construction.unknowns :]
    ]
    return {
        **heading("modes at inputs", written.document.text or "", written.tolerance),
        "inputs": dict(zip(driven, modes.inputs, strict=True)),
        "construction": construction_table(written.mechanism, modes.construction),
        "bound": modes.bound,
        "complete": modes.complete,
        "modes": len(modes.real),
        "precision_bits": modes.precision,
        "roots": [_root(root) for root in modes.roots],
    }


def construction_table(mechanism: Any, construction: Construction) -> Mapping[str, Any]:
    """Return an order of placing links with names."""
    links = mechanism.links
    names = [pair.name for pair in mechanism.pairs]
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
    }


def _root(root: Root) -> dict[str, Any]:
    return {
        "real": root.real,
        "centre": [[_exact(each.real), _exact(each.imag)] for each in root.centre],
        "radius": root.radius,
        "alone_within": root.unique,
    }


def _exact(ball: Ball) -> list[int]:
    return list(parts_of(ball))
