"""What is varied: a number of a mechanism file, and where kernels take it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from spherekit.conventions import listing
from spherekit.engine.frames import DesignGeometry
from spherekit.engine.turns import TurningPairs, turning_pairs
from spherekit.errors import DesignError
from spherekit.files.change import number_at, number_path, with_numbers
from spherekit.files.document import Document
from spherekit.files.locate import KeyPath
from spherekit.files.read import acted_on, stated
from spherekit.files.schema import Limits, check, limits_of
from spherekit.model.dynamics import LOADS, PairTorque
from spherekit.model.mechanism import Mechanism

DESIGNED = ("links", "pairs", "mass", "loads")
"""Tables of a file whose numbers make a design."""

ACTIONS = ("mass", "loads")
"""Those that say nothing of where links are."""

_GEOMETRY = ("arcs", "angles", "zeros", "values", "longitudes", "latitudes")


@final
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
    limits
        Which numbers the format allows there.
    """

    key: str
    path: KeyPath
    value: float
    is_angle: bool
    slot: tuple[str, Any] | None
    limits: Limits

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
            f"{document.name}: {key} is no size of a design: the samples, ranges and stops "
            f"are the same for all; vary numbers of {listing(DESIGNED)}"
        )
    slot = _slot(document, path)
    limits = limits_of(document, path)
    return DesignVariable(
        key, path, number_at(document, path), slot is not None, slot, limits
    )


def _slot(document: Document, path: KeyPath) -> tuple[str, Any] | None:
    match path:
        case ("links", str(link), "arcs" | "angles" as kind, int(k)):
            axes = document.data["links"][link]["axes"]
            return kind, (link, axes[k + (1 if kind == "arcs" else 2)])
        case ("pairs", str(pair), "zero" | "value" as kind):
            return f"{kind}s", pair
        case ("pairs", str(pair), "lonlat", int(k)):
            return ("longitudes", "latitudes")[k], pair
    return None


def design_geometry(
    variables: Sequence[DesignVariable], numbers: Mapping[str, Any]
) -> DesignGeometry:
    """Return the geometry in which variables have these numbers or terms, by name."""
    made: dict[str, dict[Any, Any]] = {kind: {} for kind in _GEOMETRY}
    for variable in variables:
        if variable.slot is not None:
            kind, place = variable.slot
            made[kind][place] = numbers[variable.name]
    return DesignGeometry(**made)


def is_angle_of_load(document: Document, key: str) -> bool:
    """Return whether a number of a load is an angle, or an angle per second."""
    table, name, *rest = number_path(document, key)
    if table != "loads" or len(rest) != 1:
        return False
    kind = LOADS[document.data["loads"][name].get("kind", PairTorque.kind)]
    return kind.keys.get(str(rest[0])) in ("angle", "rate")


def designed_pairs(
    mechanism: Mechanism,
    variables: Sequence[DesignVariable],
    numbers: Mapping[str, Any],
    as_columns: bool = False,
) -> TurningPairs:
    """Return the pairs of a mechanism in which variables have these numbers or terms.

    What profiles are is handed in `as_columns`, or follows from circles.
    """
    geometry = design_geometry(variables, numbers)
    return turning_pairs(mechanism, geometry, as_columns=as_columns)


def designed(
    document: Document, variables: Sequence[DesignVariable], values: Sequence[float]
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
    if not all(variable.limits.allow(numbers[variable.path]) for variable in variables):
        check(changed)
    return stated(changed)


def with_actions(
    document: Document,
    mechanism: Mechanism,
    variables: Sequence[DesignVariable],
    values: Sequence[float],
) -> Mechanism:
    """Return a mechanism with the masses and loads of a design, its geometry its own.

    Raises
    ------
    FileError, ModelError
        If there are no such masses or loads.
    """
    chosen = [k for k, variable in enumerate(variables) if variable.path[0] in ACTIONS]
    numbers = {variables[k].path: float(values[k]) for k in chosen}
    return acted_on(mechanism, with_numbers(document, numbers))


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
