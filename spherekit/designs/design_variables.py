"""What is varied: numbers of a mechanism file, and where kernels take them."""

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.mechanism_reader import mechanism_from_document
from spherekit.files.number_change import number_at, number_path, with_numbers
from spherekit.files.schema import check_numbers
from spherekit.files.toml_document import Document
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.elements import PoseGeometry, SizeGeometry
from spherekit.mechanism.load_kinds import LOADS, PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.mechanism.pose_sizes import pose_sizes
from spherekit.velocities.row_quantities import row_quantities
from spherekit.wording import listing

DESIGNED = ("links", "pairs", "outputs", "mass", "loads")
"""Tables of a file whose numbers make a design."""

ACTIONS = ("mass", "loads")
POINTED = "pointed"
"""The kind of sizes that say where outputs point."""
"""Those that say nothing of where links are."""


@dataclass(frozen=True)
class DesignVariable:
    """A number of a mechanism file that is varied.

    Attributes
    ----------
    key
        As users name it, ``links.2.arc``.
    path
        Where it stands in the file.
    value
        What the file says, in the file's unit.
    is_angle
        Whether it is an angle, in the file's unit of angles.
    slot
        Which size of a kernel it is, if it is one.
    """

    key: str
    path: KeyPath
    value: float
    is_angle: bool
    slot: tuple[str, Any] | None

    @property
    def name(self) -> str:
        """Its name in tables and expressions."""
        return self.key.replace(".", "_").replace("-", "_")


def design_variable(document: Document, key: str) -> DesignVariable:
    """Return the variable of a key.

    Raises
    ------
    FileError, DesignError
        If the file has no such number, or it is none of a design.
    """
    path = number_path(document, key)
    if path[0] not in DESIGNED:
        raise DesignError(
            f"{document.name}: {key} is no size of a design: the samples, ranges "
            f"and joint limits "
            f"are the same for all; vary numbers of {listing(DESIGNED)}"
        )
    slot = _slot(document, path)
    return DesignVariable(key, path, number_at(document, path), slot is not None, slot)


def _slot(document: Document, path: KeyPath) -> tuple[str, Any] | None:
    match path:
        case ("links", str(link), "arcs" | "angles" as kind, int(k)):
            axes = document.data["links"][link]["axes"]
            return kind, (link, axes[k + (1 if kind == "arcs" else 2)])
        case ("pairs", str(pair), "zero" | "value" as kind):
            return f"{kind}s", pair
        case ("pairs", str(pair), "lonlat", int(k)):
            return ("longitudes", "latitudes")[k], pair
        case ("outputs", str(output), "lonlat", int(k)):
            return POINTED, (output, k)
    return None


def is_angle_of_load(document: Document, key: str) -> bool:
    """Return whether a number of a load is an angle, or an angle per second."""
    table, name, *rest = number_path(document, key)
    if table != "loads" or len(rest) != 1:
        return False
    kind = LOADS[document.data["loads"][name].get("kind", PairTorque.kind)]
    return kind.keys.get(str(rest[0])) in ("angle", "rate")


def designed(
    document: Document, variables: Sequence[DesignVariable], values: Iterable[float]
) -> Mechanism:
    """Return the mechanism of a design, with values in the file's units.

    Of a document that fits the format, only the values are held against it.

    Raises
    ------
    FileError
        If there is no such mechanism.
    """
    numbers = dict(zip([v.path for v in variables], map(float, values), strict=True))
    changed = with_numbers(document, numbers)
    check_numbers(changed, numbers)
    return mechanism_from_document(changed)


def check_variables(document: Document, variables: Sequence[DesignVariable]) -> None:
    """Raise `DesignError` where a number is named twice."""
    seen: dict[KeyPath, str] = {}
    for variable in variables:
        if variable.path in seen:
            raise DesignError(
                f"{document.name}: {variable.key} and {seen[variable.path]} are the same "
                "number; vary it once"
            )
        seen[variable.path] = variable.key


def link_sizes(mechanism: Mechanism) -> dict[str, DesignVariable]:
    """Return the arcs and angles (rad) of the links of a reference pose by their keys.

    They are named as in a file of sizes. Mechanisms with contacts have none here: their
    profiles stand in the axes of the pose.
    """
    if not isinstance(mechanism.geometry, PoseGeometry) or mechanism.has_contacts:
        return {}
    made = {}
    for link in mechanism.links:
        sizes = pose_sizes(mechanism, link)
        for kind, pair, value, _ in sizes:
            alone = sum(other == kind for other, *_ in sizes) == 1
            key = f"links.{link}.{kind[:-1] if alone else f'{kind}.{pair}'}"
            path = ("links", link, kind, pair)
            made[key] = DesignVariable(key, path, value, True, (kind, (link, pair)))
    return made


def sizes_of(mechanism: Mechanism) -> Names:
    """Return the keys of all arcs and angles, or of all axes in a reference pose.

    Without those of links with two axes on one line, which no small size parts.
    """
    if isinstance(mechanism.geometry, SizeGeometry):
        coaxial = coaxial_links(mechanism.geometry)
        return tuple(
            f"links.{link}.{kind}" + (f"s.{pair}" if len(axes) > 1 else "")
            for link, sizes in mechanism.geometry.links.items()
            if link not in coaxial
            for kind, axes in (("arc", sizes.axes[1:]), ("angle", sizes.axes[2:]))
            for pair in axes
        )
    return tuple(
        f"pairs.{pair.name}.{kind}"
        for pair in mechanism.pairs
        if pair.kind.has_axis
        for kind in ("longitude", "latitude")
    )


def coaxial_links(geometry: SizeGeometry) -> Names:
    """Return the links with an axis on one line with the first."""
    return tuple(
        link
        for link, sizes in geometry.links.items()
        if any(abs(np.sin(arc)) <= COLLINEAR_SINE for arc in sizes.arcs)
    )


def quantities_of(mechanism: Mechanism) -> Names:
    """Return the angles that say where outputs are, else those of all passive pairs.

    Without any, how outputs turn while the inputs move.
    """
    driven = mechanism.input_pairs
    ends = {frozenset((output.link, output.relative_to)) for output in mechanism.outputs}
    passive = [p for p in mechanism.pairs if p.kind.has_axis and p.name not in driven]
    chosen = [p for p in passive if frozenset(p.links) in ends] or passive
    if chosen:
        return tuple(f"theta_{pair.name}" for pair in chosen)
    speeds = [f"velocity_coefficient_{o.link}_{o.relative_to}" for o in mechanism.outputs]
    return tuple(
        name
        for name in row_quantities(mechanism)
        if any(name == speed or name.startswith(f"{speed}_by_") for speed in speeds)
    )


OK = "OK"
EIGHTH = (0.8, -0.2, 4.0 / 105.0, -1.0 / 280.0)
"""Weights of central differences of the eighth order, from the nearest on."""
ONE_SIDED = (
    8.0,
    -14.0,
    56.0 / 3.0,
    -17.5,
    11.2,
    -14.0 / 3.0,
    8.0 / 7.0,
    -0.125,
)
"""Weights of differences of the same order from the value on, where it is a limit."""
_PLACE = re.compile(r"^[^\s:]+\.toml(?::\d+)?: ", re.MULTILINE)
"""A file's name, and perhaps a line, before what is wrong."""


def slope_by(
    read: Callable[[Floats], Floats], values: Floats, k: int, steps: Floats
) -> Floats | None:
    """Return the derivatives (n,) of numbers by one of the values (variables,).

    By differences of the eighth order, exact for polynomials, with the first of the steps,
    central or to one side, at which `read` raises no `SpherekitError` at any place; None
    without.
    """
    ahead = np.arange(9.0)
    weights = np.array([-np.sum(ONE_SIDED), *ONE_SIDED])
    near = ahead[1:5]
    central = np.concatenate([near, -near]), np.concatenate([EIGHTH, np.negative(EIGHTH)])
    stencils = central, (ahead, weights), (-ahead, -weights)
    for step in steps:
        for places, weighing in stencils:
            total = np.zeros(())
            with suppress(SpherekitError):
                for place, weight in zip(places[::-1], weighing[::-1], strict=True):
                    beside = values.copy()
                    beside[k] += step * place
                    total = total + weight * read(beside)
                return total / step
    return None


def reason_of(problem: SpherekitError) -> str:
    """Return what is wrong with a design in one line, without the file's name."""
    return " ".join(_PLACE.sub("", str(problem)).split())
