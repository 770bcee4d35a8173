"""A synthesis from a file."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.api.sweep import sweep_of
from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath
from spherekit.designs.design_space import DesignSpace, range_variation
from spherekit.designs.synthesis import Synthesis, synthesize_dimensions
from spherekit.designs.synthesis_requirements import Specification
from spherekit.errors import DesignError
from spherekit.files.library import named_in
from spherekit.files.mechanism_reader import angle_unit_of
from spherekit.files.schema import check
from spherekit.files.toml_document import Document, parse, read_text
from spherekit.files.toml_lines import KeyPath
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.tilt_torsion import from_tilt_torsion, pointing
from spherekit.mechanism.sizes import to_radians

SAMPLES = 181
DESIGNS = 16384


@checked(DesignError)
def synthesize(
    path: AnyPath,
    *,
    designs: int = DESIGNS,
    starts: int = 12,
    seed: int = 0,
) -> Synthesis:
    """Return the designs that a synthesis file asks for, the first objective's best first.

    Parameters
    ----------
    path
        A synthesis file: a mechanism, the sizes that vary, figures, precision points, an
        objective and conditions.
    designs, seed
        How many designs of a scrambled Sobol sequence are looked at first.
    starts
        From how many of the best rows one objective is followed down. With several
        from five times as many points of the front of each mode.

    Raises
    ------
    FileError
        With one line for each fault in the file.
    DesignError
        If an expression has other names, or no design meets the conditions.

    Examples
    --------
    >>> from pathlib import Path
    >>> import spherekit as sk
    >>> wanted = '''
    ... format = 1
    ... mechanism = "four_bar"
    ... minimise = "peak"
    ... vary = {"links.2.arc" = [15, 30], "links.4.arc" = [30, 60]}
    ... figures = {peak = "max(abs(torque))"}
    ... '''
    >>> _ = Path("wanted.toml").write_text(wanted)
    >>> sk.synthesize("wanted.toml", designs=64, starts=1).mechanism().name
    'four_bar'
    """
    return synthesize_dimensions(specification_of(path, designs, seed), starts)


def specification_of(path: AnyPath, designs: int = DESIGNS, seed: int = 0) -> Specification:
    """Return what a synthesis file asks for."""
    document = parse(read_text(Path(path)), str(path))
    check(document, "synthesis")
    data = document.data
    variations = [
        range_variation(key, *map(float, ends)) for key, ends in data["vary"].items()
    ]
    figures = [f"{name}={text}" for name, text in data.get("figures", {}).items()]
    subject = named_in(data["mechanism"], Path(path).parent)
    missed, points = _missed(document, to_radians(1.0, angle_unit_of(subject)))
    sweep = sweep_of(
        subject,
        DesignSpace.from_variations(variations, designs, "sobol", seed),
        [*figures, *missed.values()],
        samples=data.get("samples", SAMPLES),
    )
    sweep = replace(sweep, where=tuple(data.get("where", ())))
    wanted = data["minimise"]
    objectives = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    return Specification(sweep, objectives, tuple(missed), points)


def _missed(document: Document, unit: float) -> tuple[dict[str, str], int]:
    """Return the figures that say by how much precision points are missed.

    And how many points there are.
    """
    match = document.data.get("match", [])
    made, points = dict[str, str](), 0
    for number, table in enumerate(match if isinstance(match, list) else [match]):
        path = ("match", number, "values") if match is not table else ("match", "values")
        inputs, values = table["at"], table["values"]
        if len(inputs) != len(values):
            raise document.fault(
                path,
                f"has {len(values)} values for {len(inputs)} inputs; give one for each",
            )
        points += len(inputs)
        for place, value in zip(inputs, values, strict=True):
            at = ", ".join(repr(float(x)) for x in np.atleast_1d(place))
            for miss in _misses(document, path, table["quantity"], value, unit):
                name = f"missed_{len(made) + 1}"
                made[name] = f"{name}=at({miss}, {at})"
    return made, points


def _misses(
    document: Document, path: KeyPath, quantity: str, value: Any, unit: float
) -> list[str]:
    """Return by how much a quantity misses a value, part by part."""
    if isinstance(value, int | float):
        if not quantity.startswith(("theta_", "transmission_angle_")):
            return [f"{quantity} - ({value!r})"]
        off = f"{quantity} - ({value * unit!r})"
        return [f"{1.0 / unit!r}*atan2(sin({off}), cos({off}))"]
    turned = quantity.startswith("orientation_")
    numbers = np.array(value, dtype=float)
    of_any_length = len(numbers) == (4 if turned else 3)
    if len(numbers) - turned not in (2, 3) or (of_any_length and not np.any(numbers)):
        poses = "azimuth, tilt and torsion, or qx, qy, qz, qw" if turned else ""
        raise document.fault(
            path,
            f"{value} is no value of {quantity}: give "
            f"{poses or 'x, y, z, or azimuth and tilt'}",
        )
    if of_any_length:
        numbers = numbers / np.linalg.norm(numbers)
        wanted = from_quaternion(numbers) if turned else numbers
    else:
        made = from_tilt_torsion if turned else pointing
        wanted = made(numbers[None] * unit)[0]
    # Twice the sine of half the angle is the chord of a direction; a rotation has it twice.
    share = 1.0 / (unit * np.sqrt(wanted.ndim))
    parts = ("".join(axes) for axes in product("xyz", repeat=wanted.ndim))
    return [
        f"{float(share)!r}*({quantity}_{part} - ({float(x)!r}))"
        for part, x in zip(parts, wanted.ravel(), strict=True)
    ]
