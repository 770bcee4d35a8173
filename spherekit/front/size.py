"""A sizing from a file."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from spherekit.checked import checked
from spherekit.design.sizing import Sized, size
from spherekit.design.space import DesignSpace, between
from spherekit.design.varied import DEG
from spherekit.design.wanted import Sizing
from spherekit.errors import DesignError
from spherekit.files.change import document_of
from spherekit.files.document import Document, parse, read_text
from spherekit.files.library import named_in
from spherekit.files.schema import check
from spherekit.front.sweep import sweep_of

SAMPLES, DESIGNS = 181, 16384


@checked(DesignError)
def size_of(
    path: str | os.PathLike[str],
    *,
    designs: int = DESIGNS,
    starts: int = 12,
    seed: int = 0,
) -> Sized:
    """Return the designs that a sizing file asks for, the first objective's best first.

    Parameters
    ----------
    path
        A sizing file: a mechanism, the sizes that vary, figures, precision points, an
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
    >>> sk.size_of("wanted.toml", designs=64, starts=1).mechanism().name
    'four_bar'
    """
    return size(sizing_of(path, designs, seed), starts)


def sizing_of(
    path: str | os.PathLike[str], designs: int = DESIGNS, seed: int = 0
) -> Sizing:
    """Return what a sizing file asks for."""
    document = parse(read_text(Path(path)), str(path))
    check(document, "sizing")
    data = document.data
    variations = [between(key, *map(float, ends)) for key, ends in data["vary"].items()]
    figures = [f"{name}={text}" for name, text in data.get("figures", {}).items()]
    subject = named_in(data["mechanism"], Path(path).parent)
    degrees = document_of(subject).data["angle_unit"] == "deg"
    missed = _missed(document, data.get("match"), degrees)
    sweep = sweep_of(
        subject,
        DesignSpace.of(variations, designs, "sobol", seed),
        [*figures, *missed.values()],
        samples=data.get("samples", SAMPLES),
    )
    sweep = replace(sweep, where=tuple(data.get("where", ())))
    wanted = data["minimise"]
    objectives = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    return Sizing(sweep, objectives, tuple(missed))


def _missed(
    document: Document, match: Mapping[str, Any] | None, degrees: bool
) -> dict[str, str]:
    """Return the figures that say by how much each precision point is missed."""
    if match is None:
        return {}
    inputs, values = match["at"], match["values"]
    if len(inputs) != len(values):
        raise document.fault(
            ("match", "values"),
            f"has {len(values)} values for {len(inputs)} inputs; give one for each",
        )
    quantity = match["quantity"]
    made = {}
    for k, (place, value) in enumerate(zip(inputs, values, strict=True)):
        name = f"missed_{k + 1}"
        if quantity.startswith(("theta_", "transmission_angle_")):
            unit = DEG if degrees else 1.0
            off = f"{quantity} - ({value * unit!r})"
            miss = f"{1.0 / unit!r}*atan2(sin({off}), cos({off}))"
        else:
            miss = f"{quantity} - ({value!r})"
        points = place if isinstance(place, list) else [place]
        made[name] = (
            f"{name}=at({miss}, {', '.join(repr(float(point)) for point in points)})"
        )
    return made
