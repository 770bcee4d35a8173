"""A mechanism to a TOML file of format 1, in canonical order."""

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

from spherekit.checked import checked
from spherekit.errors import FileError, OutputError
from spherekit.files.atomic import write_text
from spherekit.files.check import FORMAT
from spherekit.files.read import AnyMechanism, loads, mechanism_of
from spherekit.files.toml_text import assignment, tables
from spherekit.files.write_dynamics import angle_text, load_tables, mass_tables, stop_tables
from spherekit.model.changes import AngleUnit
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Output, Pair, PoseGeometry, Profile

_Table = dict[str, Any]


@checked(OutputError)
def dump(
    mechanism: AnyMechanism, path: str | os.PathLike[str], angle_unit: AngleUnit = "deg"
) -> None:
    """Write a mechanism file that reads back as exactly this mechanism.

    Raises
    ------
    OutputError
        If it cannot be written there, or the format cannot express the mechanism.
    """
    write_text(path, dumps(mechanism_of(mechanism), angle_unit))


@checked(OutputError)
def dumps(mechanism: Mechanism, angle_unit: AngleUnit = "deg") -> str:
    """Return the text of a file that reads back as exactly this mechanism.

    Raises
    ------
    OutputError
        If the format cannot express the mechanism: an axis that is not a unit vector, a
        profile with values its kind does not have, user data that TOML lacks.
    """
    if angle_unit not in ("deg", "rad"):
        raise OutputError(f'angle_unit is {angle_unit!r}; allowed: "deg", "rad"')
    try:
        text = canonical_text(mechanism, angle_unit)
    except (TypeError, RecursionError) as error:
        raise OutputError(f"{mechanism.name}: cannot be written: {error}") from None
    try:
        again = loads(text, mechanism.name)
    except FileError as error:
        raise OutputError(
            f"{mechanism.name}: the file would not be readable: {error}"
        ) from None
    changed = _first_difference(mechanism, again)
    if changed:
        raise OutputError(
            f"{mechanism.name}: {changed} would not read back the same; the format "
            "holds tuples, unit vectors, and in a profile only what its kind needs"
        )
    return text


def canonical_text(mechanism: Mechanism, angle_unit: AngleUnit) -> str:
    """Return the text `dumps` would check, unchecked: for fingerprints, not for files.

    Raises
    ------
    TypeError
        If the user data holds what TOML lacks.
    """
    return "\n".join([*_lines(mechanism, angle_unit), ""])


def mechanism_hash(mechanism: Mechanism) -> str:
    """Return the SHA-256 of a mechanism's canonical file in radians, in hexadecimal."""
    return hashlib.sha256(canonical_text(mechanism, "rad").encode()).hexdigest()


def _lines(mechanism: Mechanism, unit: AngleUnit) -> Iterator[str]:
    yield assignment("format", FORMAT)
    yield assignment("name", mechanism.name)
    yield assignment("angle_unit", unit)
    yield assignment("ground", mechanism.ground)
    for name, content in _content(mechanism, unit).items():
        yield from tables((name,), content)


def _content(mechanism: Mechanism, unit: AngleUnit) -> Mapping[str, _Table]:
    """Return the tables of the file; a table may be left out where it is empty."""
    content: dict[str, _Table] = {}
    if mechanism.source is not None:
        content["source"] = {"citation": mechanism.source.citation}
        if mechanism.source.assumed:
            content["source"]["assumed"] = mechanism.source.assumed
    content["links"] = {link: _link(mechanism, link, unit) for link in mechanism.links}
    content["pairs"] = {item.name: _pair(mechanism, item, unit) for item in mechanism.pairs}
    content["inputs"] = {
        item.pair: {"from": angle_text(item.start, unit), "to": angle_text(item.stop, unit)}
        for item in mechanism.inputs
    }
    content["outputs"] = {item.name: _output(item) for item in mechanism.outputs}
    content["mass"] = mass_tables(mechanism.masses)
    content["loads"] = load_tables(mechanism.loads, unit)
    content["stops"] = stop_tables(mechanism.stops, unit)
    content["modes"] = {
        mode.name: {pair: angle_text(x, unit) for pair, x in mode.values.items()}
        for mode in mechanism.modes
    }
    content["user"] = dict(mechanism.user)
    return {name: table for name, table in content.items() if table}


def _output(output: Output) -> _Table:
    table: _Table = {"link": output.link, "relative_to": output.relative_to}
    if output.direction is not None:
        table["xyz"] = [float(x) for x in output.direction]
    return table


def _link(mechanism: Mechanism, link: str, unit: AngleUnit) -> _Table:
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry) or link not in geometry.links:
        return {}
    sizes = geometry.links[link]
    table: _Table = {"axes": list(sizes.axes)}
    if sizes.arcs:
        table["arcs"] = [angle_text(arc, unit) for arc in sizes.arcs]
    if sizes.angles:
        table["angles"] = [angle_text(angle, unit) for angle in sizes.angles]
    if sizes.signed:
        table["signed_arcs"] = True
    if sizes.unpaired:
        table["unpaired"] = list(sizes.unpaired)
    return table


def _pair(mechanism: Mechanism, pair: Pair, unit: AngleUnit) -> _Table:
    table: _Table = {"type": pair.type, "links": list(pair.links)}
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry):
        if pair.name in geometry.axes:
            table["xyz"] = [float(x) for x in geometry.axes[pair.name]]
        if pair.name in geometry.values:
            table["value"] = angle_text(geometry.values[pair.name], unit)
    elif pair.name in geometry.zeros:
        table["zero"] = angle_text(geometry.zeros[pair.name], unit)
    if pair.contact != "external":
        table["contact"] = pair.contact
    if any(pair.start):
        table["start"] = [angle_text(angle, unit) for angle in pair.start]
    if pair.one_sided:
        table["one_sided"] = True
    if pair.distance is not None:
        table["distance"] = float(pair.distance)
    if pair.pressure_angle is not None:
        table["pressure_angle"] = angle_text(pair.pressure_angle, unit)
    if pair.profiles is not None:
        table["profiles"] = {
            link: _profile(profile, unit)
            for link, profile in zip(pair.links, pair.profiles, strict=True)
        }
    return table


def _profile(profile: Profile, unit: AngleUnit) -> _Table:
    table: _Table = {"kind": profile.kind}
    if profile.centre is not None:
        table["centre_xyz"] = [float(x) for x in profile.centre]
    if profile.radius is not None:
        table["radius"] = angle_text(profile.radius, unit)
    if profile.points:
        table["points_xyz"] = [[float(x) for x in point] for point in profile.points]
    if profile.points or not profile.closed:
        table["closed"] = profile.closed
    if profile.cosines:
        table["cosines"] = [angle_text(value, unit) for value in profile.cosines]
    if profile.sines:
        table["sines"] = [angle_text(value, unit) for value in profile.sines]
    return table


def _first_difference(mechanism: Mechanism, again: Mechanism) -> str:
    for field in fields(mechanism):
        ours, theirs = getattr(mechanism, field.name), getattr(again, field.name)
        if field.name == "user":
            # As text, since a NaN in it differs from itself, and a tuple from a list.
            same = list(tables((), ours)) == list(tables((), theirs))
        else:
            try:
                same = bool(ours == theirs)
            except ValueError:  # NumPy arrays have no single truth value
                same = False
        if not same:
            return f"{field.name}{_place(ours, theirs)}"
    return ""


def _place(ours: object, theirs: object) -> str:
    if not isinstance(ours, tuple) or not isinstance(theirs, tuple):
        return ""
    for one, other in zip(ours, theirs, strict=False):
        if one is not other and repr(one) != repr(other):
            return f' of "{getattr(one, "name", one)}"'
    return ""
