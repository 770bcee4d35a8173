"""Whether a mechanism can be one; the errors say where not, and what would be."""

import math
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from spherekit.conventions import MAX_NAME_LENGTH, NAME_PATTERN, counted, listing, nearest
from spherekit.errors import ModelError
from spherekit.model.dynamics_checks import check_mass, check_stop
from spherekit.model.joints import KINDS
from spherekit.model.parts import LinkSizes, PoseGeometry, SizeGeometry

if TYPE_CHECKING:
    from spherekit.model.mechanism import Mechanism


def not_named(where: str, what: str, name: str, names: Collection[str]) -> ModelError:
    """Return the error of a name that no link, pair or load has."""
    return ModelError(
        f'{where}: no {what} is named "{name}"{nearest(str(name), names) or ";"} '
        f"{what.capitalize()}s: {listing(names) or 'none'}"
    )


def check_mechanism(mechanism: "Mechanism") -> None:
    """Raise `ModelError` where names or geometry of a mechanism do not fit each other."""
    where = mechanism.name or "mechanism"
    if len(mechanism.links) < 2:
        raise ModelError(f"{where}: a mechanism has at least two links")
    _check_names(where, "link", mechanism.links)
    _check_names(where, "pair", [pair.name for pair in mechanism.pairs])
    _check_names(where, "input at a", [item.pair for item in mechanism.inputs])
    _check_names(where, "output", [output.name for output in mechanism.outputs])
    _check_names(where, "load", [load.name for load in mechanism.loads])
    _check_names(where, "mass of a", [mass.link for mass in mechanism.masses])
    _check_names(where, "stop of a", [stop.pair for stop in mechanism.stops])
    _check_names(where, "mode", [mode.name for mode in mechanism.modes])

    def need_link(name: str, key: str) -> None:
        if name not in mechanism.links:
            raise not_named(f"{where}: {key}", "link", name, mechanism.links)

    need_link(mechanism.ground, "ground")
    pair_names = [pair.name for pair in mechanism.pairs]
    for pair in mechanism.pairs:
        if pair.type not in KINDS:
            raise ModelError(
                f'{where}: pairs.{pair.name}: type "{pair.type}" is not one of '
                f"{listing(KINDS)}"
            )
        for name in pair.links:
            need_link(name, f"pairs.{pair.name}.links")
        if (pair.profiles is None) != pair.kind.has_axis:
            raise ModelError(
                f"{where}: pairs.{pair.name}: a contact pair (Cr, Cs) has a profile for "
                "each of its links, an R pair has none"
            )
        if pair.distance is not None and not 0.0 < pair.distance < math.inf:
            raise ModelError(
                f"{where}: pairs.{pair.name}.distance: found {pair.distance}, needs more "
                "than 0 m: how far from the centre the contact force acts"
            )
        teeth = pair.pressure_angle
        if teeth is not None and not (pair.rolls and 0.0 <= teeth < math.pi / 2):
            raise ModelError(
                f"{where}: pairs.{pair.name}.pressure_angle: found {teeth:g} rad in a "
                f"{pair.type} pair, needs a rolling contact (Cr) and at least 0, less than "
                "a right angle"
            )
        if pair.links[0] == pair.links[1]:
            raise ModelError(
                f'{where}: pairs.{pair.name}: joins link "{pair.links[0]}" to itself; '
                "a pair joins two different links"
            )

    def need_pair(name: str, key: str) -> None:
        if name not in pair_names:
            raise not_named(f"{where}: {key}", "pair", name, pair_names)

    for mode in mechanism.modes:
        if mode.name.isdecimal():
            raise ModelError(
                f"{where}: modes.{mode.name}: a number is that of a mode; name it by a word"
            )
        for name in mode.values:
            need_pair(name, f"modes.{mode.name}")
            if name not in mechanism.angles:
                raise ModelError(
                    f"{where}: modes.{mode.name}.{name}: is a contact pair; a mode is said "
                    "by angles of R pairs"
                )
    for item in mechanism.inputs:
        need_pair(item.pair, f"inputs.{item.pair}")
    for output in mechanism.outputs:
        need_link(output.link, f"outputs.{output.name}.link")
        need_link(output.relative_to, f"outputs.{output.name}.relative_to")
    for mass in mechanism.masses:
        need_link(mass.link, f"mass.{mass.link}")
    for load in mechanism.loads:
        for key, form in load.keys.items():
            if form == "link":
                need_link(getattr(load, key), f"loads.{load.name}.{key}")
            elif form == "pair":
                need_pair(getattr(load, key), f"loads.{load.name}.{key}")
    for stop in mechanism.stops:
        need_pair(stop.pair, f"stops.{stop.pair}")
    _check_dynamics(where, mechanism)
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry):
        named: Mapping[str, Any] = geometry.values
        for name in geometry.axes:
            need_pair(name, "pairs")
        for pair in mechanism.pairs:
            if pair.kind.has_axis and pair.name not in geometry.axes:
                raise ModelError(
                    f"{where}: pairs.{pair.name}: its axis in the reference pose is "
                    "missing; give xyz = [x, y, z] or lonlat = [longitude, latitude]"
                )
    else:
        named = geometry.zeros
        for name in geometry.links:
            need_link(name, "links")
        _check_sizes(where, mechanism, geometry)
    for name in named:
        need_pair(name, "pairs")


def _check_dynamics(where: str, mechanism: "Mechanism") -> None:
    try:
        for mass in mechanism.masses:
            check_mass(mass)
        for load in mechanism.loads:
            load.check(f"loads.{load.name}", mechanism)
        for stop in mechanism.stops:
            check_stop(stop, mechanism)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from None


def _check_names(where: str, what: str, names: "list[str] | tuple[str, ...]") -> None:
    seen: set[str] = set()
    for name in names:
        if not NAME_PATTERN.fullmatch(name) or len(name) > MAX_NAME_LENGTH:
            raise ModelError(
                f"{where}: {what} name {name[:80]!r}: use 1 to {MAX_NAME_LENGTH} "
                "letters (A-Z, a-z), digits and underscores"
            )
        if name in seen:
            raise ModelError(f'{where}: {what} "{name}" is given twice; names are unique')
        seen.add(name)


def _check_sizes(where: str, mechanism: "Mechanism", geometry: SizeGeometry) -> None:
    on_link: dict[str, list[str]] = {link: [] for link in mechanism.links}
    for pair in mechanism.pairs:
        for link in pair.links:
            if pair.kind.has_axis:
                on_link[link].append(pair.name)
    for link, expected in on_link.items():
        sizes = geometry.links.get(link, LinkSizes(()))
        key = f"{where}: links.{link}"
        if sorted(sizes.axes) != sorted([*expected, *sizes.unpaired]):
            raise ModelError(
                f"{key}.axes: has [{listing(sizes.axes)}], but the R pairs on this link "
                f"are [{listing(expected)}]; list each of them once"
            )
        for place, arc in enumerate(sizes.arcs):
            if not (0.0 <= arc <= math.pi or (sizes.signed and math.isfinite(arc))):
                raise ModelError(f"{key}.arcs[{place}]: {_no_arc(arc)}")
        count = len(sizes.axes)
        arcs, angles = max(count - 1, 0), max(count - 2, 0)
        if len(sizes.arcs) != arcs:
            raise ModelError(
                f"{key}.arcs: has {counted(len(sizes.arcs), 'value')}, needs {arcs}: the "
                "arcs from the first axis to each of the others"
            )
        if len(sizes.angles) != angles:
            raise ModelError(
                f"{key}.angles: has {counted(len(sizes.angles), 'value')}, needs {angles}: "
                "at the first axis, from the first arc to each further arc"
            )


def _no_arc(arc: float) -> str:
    """Return what to say of an arc (rad) that is none between two axes."""
    if not math.isfinite(arc):
        return f"found {arc}, needs a finite number"
    shorter = abs(math.remainder(arc, 2.0 * math.pi))
    return (
        f"found {math.degrees(arc):.6g} deg ({arc:.6g} rad); an arc between two axes is "
        f"between 0 and 180 deg. This one leads to an axis {math.degrees(shorter):.6g} deg "
        "away, perhaps on the other side of the first; if that is meant, say "
        "signed_arcs = true in the link"
    )
