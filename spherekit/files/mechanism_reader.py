"""A mechanism from a TOML file of format 1."""

import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, NoReturn, TypeVar

import numpy as np

from spherekit.argument_validation import checked
from spherekit.conventions import TURN, AnyPath
from spherekit.errors import FileError, ModelError
from spherekit.files.library import find, is_study
from spherekit.files.schema import check
from spherekit.files.toml_document import Document, Table, parse, read_text
from spherekit.files.toml_lines import KeyPath
from spherekit.files.units import converted, made
from spherekit.mechanism.bevel_gears import (
    check_half_angles,
    find_gear_carrier,
    pitch_angles,
)
from spherekit.mechanism.elements import (
    Input,
    LinkSizes,
    Output,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
    Source,
    as_vector,
)
from spherekit.mechanism.inertia import (
    Mass,
    axes_frame,
    check_tensor,
    shift_to_sphere_centre,
    uniform_arc,
)
from spherekit.mechanism.joint import Links
from spherekit.mechanism.load import Load
from spherekit.mechanism.load_kinds import LOADS, JointLimit, PairTorque, as_tensor
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import LinkAxes, arc_pole, axis_in_link, link_axes
from spherekit.mechanism.sizes import AngleUnit, Vector
from spherekit.mechanism.wheel_phase import find_contact_start
from spherekit.wording import choices, nearest

Given = TypeVar("Given")

AnyMechanism = Mechanism | str | os.PathLike[str]
"""A mechanism, or where `load` finds it: its path, or the name of a shipped one."""

_ACTIONS = ("mass", "loads", "joint_limits")
_SIZES_OF_LINK = ("axes", "arcs", "angles", "signed_arcs", "unpaired")
_ARC_OF_PAIR = ("through_xyz", "through_lonlat")
_AXIS_OF_PAIR = ("xyz", "lonlat", *_ARC_OF_PAIR)
_POSE_OF_PAIR = (*_AXIS_OF_PAIR, "value")
_TURNING = ("R", "P")
_PART = re.compile(r"(\w+)|\[(\d+)\]")
_KEYED = re.compile(r"(\w+(?:\.\w+|\[\d+\])*): (.*)", re.S)


@checked(FileError)
def load(name_or_path: AnyPath) -> Mechanism:
    """Read a mechanism file, given by its path or by the name of a shipped mechanism.

    Raises
    ------
    FileError
        If there is no such file, or with one line for each fault in it.

    Examples
    --------
    >>> import spherekit as sk
    >>> sk.load("four_bar").variable_names
    ('theta_21', 'theta_32', 'theta_43', 'theta_41')
    """
    path = find(name_or_path)
    if is_study(path):
        raise FileError(
            f"{path}: is a study, not a mechanism; read it with load_study, or run it "
            "with spherekit run"
        )
    return loads(read_text(path), str(path))


def mechanism_of(given: AnyMechanism) -> Mechanism:
    """Return the mechanism that is given, or named; errors as of `load`."""
    return given if isinstance(given, Mechanism) else load(given)


def angle_unit_of(name_or_path: AnyPath) -> AngleUnit:
    """Return the unit of the angles in a mechanism file; errors as of `load`."""
    unit: AngleUnit = checked_document(name_or_path).data["angle_unit"]
    return unit


def checked_document(name_or_path: AnyPath) -> Document:
    """Return the document of a file that keeps to the format; errors as of `load`."""
    path = find(name_or_path)
    document = parse(read_text(path), str(path))
    check(document)
    return document


@checked(FileError)
def loads(text: str, name: str = "text") -> Mechanism:
    """Read a mechanism from the text of a file; errors call the file `name`.

    Raises
    ------
    FileError
        With one line for each fault.
    """
    return read(parse(text, name))


def read(document: Document) -> Mechanism:
    """Return the mechanism that a document states.

    Raises
    ------
    FileError
        With one line for each fault; of data without a text `ModelError`.
    """
    check(document)
    return stated(document)


def stated(document: Document) -> Mechanism:
    """Return the mechanism that a document states which fits the format.

    Raises
    ------
    FileError
        With what makes no sense in it; of data without a text `ModelError`.
    """
    try:
        reader = _Reader(document, converted(document, document.data))
        return reader.acted_on(reader.mechanism())
    except ModelError as error:
        # The model's complaint, with the line of the key that it names.
        message = str(error).removeprefix(f"{document.data['name']}: ")
        keyed = _KEYED.fullmatch(message)
        if keyed:
            path = tuple(int(k) if k else name for name, k in _PART.findall(keyed[1]))
            if path[0] in document.data:
                raise document.fault(path, keyed[2]) from None
        raise document.fault((), message) from None


def acted_on(mechanism: Mechanism, document: Document) -> Mechanism:
    """Return a mechanism with the masses, loads and joint limits that a document states.

    Everything else of the document is as the mechanism has it.
    """
    given = {key: document.data[key] for key in _ACTIONS if key in document.data}
    return _Reader(document, converted(document, given)).acted_on(mechanism)


@dataclass(frozen=True)
class _Reader:
    """Builds a mechanism from data that fits the schema, converted as the model has it."""

    document: Document
    data: Table

    def fail(self, path: KeyPath, message: str) -> NoReturn:
        """Raise the `FileError` about a key path."""
        raise self.document.fault(path, message)

    def at(self, path: KeyPath, ask: Callable[..., Given], *args: Any) -> Given:
        """Return what the model answers; it complains about this key."""
        try:
            return ask(*args)
        except ModelError as error:
            self.fail(path, str(error))

    def mechanism(self) -> Mechanism:
        """Return the mechanism without masses, loads and joint limits."""
        data = self.data
        stated = Mechanism(
            name=data["name"],
            ground=data["ground"],
            links=tuple(data["links"]),
            pairs=tuple(self.pair(name) for name in data["pairs"]),
            geometry=self.geometry,
            inputs=tuple(
                made(Input, {"from": 0.0, "to": TURN, **item}, {"pair": pair})
                for pair, item in data.get("inputs", {}).items()
            ),
            outputs=tuple(
                self.output(name, item) for name, item in data.get("outputs", {}).items()
            ),
            modes=data.get("modes", {}),
            source=made(Source, data["source"]) if "source" in data else None,
            user=_plain(data.get("user", {})),
        )
        pairs = tuple(self.in_phase(stated, pair) for pair in stated.pairs)
        return replace(stated, pairs=pairs) if pairs != stated.pairs else stated

    def acted_on(self, mechanism: Mechanism) -> Mechanism:
        """Return a mechanism with masses, loads and joint limits, tensors in link axes."""
        masses, loads, limits = (self.data.get(key, {}).items() for key in _ACTIONS)
        axes = cache(partial(link_axes, mechanism))
        for link, _ in masses:
            if link not in mechanism.link_number:
                self.fail(
                    ("mass", link),
                    f'no link is named "{link}"{choices(link, mechanism.links, "Links")}',
                )
        return replace(
            mechanism,
            masses=tuple(self.mass(link, item, axes) for link, item in masses),
            loads=tuple(self.load(name, item) for name, item in loads),
            joint_limits=tuple(
                made(JointLimit, item, {"pair": pair}) for pair, item in limits
            ),
        )

    def load(self, name: str, item: Table) -> Load:
        kind: Any = LOADS[item.get("kind", PairTorque.kind)]
        fields = {key: item[key] for key in kind.keys if key in item}
        return kind(name, **{**kind.absent, **fields})  # type: ignore[no-any-return]

    def mass(self, link: str, item: Table, axes: Callable[[], LinkAxes]) -> Mass:
        mass, centre = item.get("mass"), item.get("centre")

        def framed(key: str, ask: Callable[..., Given], *args: Any) -> Given:
            """Return what the model makes of the axes of two R pairs of the link."""
            path = ("mass", link, key)
            two = [
                np.array(self.at((*path, number), axis_in_link, axes(), link, pair))
                for number, pair in enumerate(item[key])
            ]
            return self.at(path, ask, *two, *args)

        if "arc" in item:
            if not item["radius"] > 0:
                self.fail(
                    ("mass", link, "radius"),
                    f"found {item['radius']:g} m, needs more than 0",
                )
            tensor, centre = framed("arc", uniform_arc, mass, item["radius"])
        else:
            key = "tensor" if "tensor" in item else "tensor_at_centre"
            tensor = np.array(item[key])
            check_tensor(f"mass.{link}.{key}", tensor)
            if key == "tensor_at_centre":
                tensor = shift_to_sphere_centre(tensor, item["mass"], np.array(centre))
            if "frame" in item:
                frame = framed("frame", axes_frame)
                tensor = frame @ tensor @ frame.T
                centre = None if centre is None else frame @ centre
        if centre is not None:
            centre = as_vector(centre)
        # The rounding of mirrored entries is made equal.
        return Mass(link, as_tensor((tensor + tensor.T) / 2), mass, centre)

    def in_phase(self, stated: Mechanism, pair: Pair) -> Pair:
        """Return a pair, where the file says its phase with the start that this means."""
        item, path = self.data["pairs"][pair.name], ("pairs", pair.name, "phase")
        if "phase" not in item:
            return pair
        if "start" in item:
            self.fail(path, "start says that already; give one of both")
        start = self.at(path, find_contact_start, stated, pair, item["phase"])
        return replace(pair, start=start)

    @cached_property
    def geometry(self) -> SizeGeometry | PoseGeometry:
        """Return the sizes of links, or the axes of all pairs in one pose."""
        pairs, links = self.data["pairs"], self.data["links"]
        sizes = self.given("links", _SIZES_OF_LINK) + self.given("pairs", ("zero",))
        pose = self.given("pairs", _POSE_OF_PAIR)
        if sizes and pose:
            first, second = sorted((sizes[0], pose[0]), key=self.document.line)
            self.fail(
                second,
                f"two geometries: {'.'.join(map(str, first))} (line "
                f"{self.document.line(first)}) belongs to the "
                f"{'sizes' if first in sizes else 'reference-pose'} form, this key to "
                "the other; keep the sizes (axes, arcs, angles in links, zero in "
                "pairs) or the reference pose (xyz or lonlat and value in pairs)",
            )
        if pose:
            posed = {name: self.axis(name, item) for name, item in pairs.items()}
            axes = {name: axis for name, axis in posed.items() if axis is not None}
            return PoseGeometry(axes, _numbers(pairs, "value"))
        if self.joined and not sizes:
            self.fail(
                ("pairs", next(iter(self.joined))),
                "no geometry: give axes and arcs in every link, or xyz or lonlat in "
                "every R pair",
            )
        sized: dict[Any, LinkSizes] = {}
        for _, link, _ in self.given("links", _SIZES_OF_LINK):
            if "axes" not in links[link]:
                self.fail(
                    ("links", link),
                    "the key axes is missing: the names of the R pairs on it",
                )
            sized[link] = made(LinkSizes, links[link])
        return SizeGeometry(sized, _numbers(pairs, "zero"))

    def given(self, table: str, keys: Sequence[str]) -> list[KeyPath]:
        """Return the paths of those of these keys that any entry of a table has."""
        return [
            (table, name, key)
            for name, item in self.data[table].items()
            for key in keys
            if key in item
        ]

    def axis(self, name: str, item: Table) -> Vector | None:
        """Return the axis of a pair in the reference pose: of an arc, its pole."""
        for key in _ARC_OF_PAIR:
            if key in item:
                return self.at(("pairs", name, key), arc_pole, *item[key])
        return _vector(item)

    @cached_property
    def joined(self) -> dict[str, Links]:
        """Return the two links of every pair with an axis: R, and P about its pole."""
        return {
            name: item["links"]
            for name, item in self.data["pairs"].items()
            if item["type"] in _TURNING
        }

    @cached_property
    def axes(self) -> LinkAxes:
        """Return the axes of pairs that have one, in their links."""
        data = self.data
        turning = tuple(Pair(name, "R", links) for name, links in self.joined.items())
        names = data["name"], data["ground"], tuple(data["links"])
        return link_axes(Mechanism(*names, turning, self.geometry))

    def output(self, name: str, item: Table) -> Output:
        """Return an output with its direction, in axes of its link."""
        path: KeyPath = ("outputs", name)
        given = [key for key in ("axis", "xyz", "lonlat") if key in item]
        if len(given) > 1:
            self.fail((*path, given[1]), f"the direction is given by {given[0]} already")
        direction = self.axis_or_vector((*path, "axis"), item)
        relative_to = item.get("relative_to", self.data["ground"])
        return Output(name, item["link"], relative_to, direction)

    def axis_or_vector(self, path: KeyPath, item: Table, prefix: str = "") -> Vector | None:
        """Return a direction in axes of a link, given by an R pair or by itself."""
        if "axis" not in item:
            return _vector(item, prefix)
        return self.at(path, axis_in_link, self.axes, item["link"], item["axis"])

    def pair(self, name: str) -> Pair:
        """Return a pair, a contact with the curves of both its links."""
        item, path = self.data["pairs"][name], ("pairs", name)
        if name in self.joined:
            return Pair(name, "R", self.joined[name])
        rolls = "teeth" in item or "half_angles" in item
        profiles = (self.cones if rolls else self.profiles)(path, item)
        return made(Pair, item, {"name": name, "profiles": profiles})

    def cones(self, path: KeyPath, item: Table) -> tuple[Profile, ...]:
        """Return the circles in which two cones, or the pitch cones of gears, roll."""
        at = item["links"], item["axes"]

        def carried() -> tuple[list[Vector], float]:
            shaft_angle = find_gear_carrier(self.joined, self.axes, *at).shaft_angle
            return [axis_in_link(self.axes, *x) for x in zip(*at, strict=True)], shaft_angle

        centres, shaft_angle = self.at((*path, "axes"), carried)
        key, radii_of = "half_angles", check_half_angles
        if "teeth" in item:
            key, radii_of = "teeth", pitch_angles  # type: ignore[assignment]
        contact = item.get("contact", "external")
        radii = self.at((*path, key), radii_of, item[key], shaft_angle, contact)
        return tuple(Profile("circle", *one) for one in zip(centres, radii, strict=True))

    def profiles(self, path: KeyPath, item: Table) -> tuple[Profile, ...]:
        """Return the curves given under profiles and follower, in the order of links."""
        given = item["profiles"]
        tables: dict[str, KeyPath] = {link: (*path, "profiles", link) for link in given}
        curves = {link: made(Profile, given[link]) for link in given}
        follower = item.get("follower")
        if follower is not None:
            link, place = follower["link"], (*path, "follower", "link")
            if link in tables:
                self.fail(
                    place,
                    f'the profile of "{link}" is given already (line '
                    f"{self.document.line(tables[link])}); profiles holds the curve of "
                    "the other link only",
                )
            tables[link] = place
            curves[link] = self.follower((*path, "follower"), follower)
        links = item["links"]
        for link, place in tables.items():
            if link not in links:
                self.fail(
                    place,
                    f'the pair joins "{links[0]}" and "{links[1]}", not "{link}"'
                    f"{nearest(link, links)}",
                )
        for link in links:
            if link not in curves:
                self.fail(
                    (*path, "profiles"),
                    f'the curve of link "{link}" is missing; give its profile, or the '
                    "key follower for a roller or a flat face",
                )
        return tuple(curves[link] for link in links)

    def follower(self, path: KeyPath, item: Table) -> Profile:
        """Return the circle of a roller or the great circle of a flat face."""
        if "flat" in item:
            return Profile("great_circle", _vector(item, "pole_"))
        radius = item["roller"]
        if not 0.0 < radius < math.pi:
            self.fail(
                (*path, "roller"),
                f"the angular radius is {math.degrees(radius):.6g} deg; it has to lie "
                "between 0 and 180 deg, both excluded",
            )
        centre = self.axis_or_vector((*path, "axis"), item, "centre_")
        return Profile("circle", centre, radius)


def _vector(item: Table, prefix: str = "") -> Vector | None:
    """Return the direction given by its components or by longitude and latitude."""
    vector: Vector | None = item.get(f"{prefix}xyz", item.get(f"{prefix}lonlat"))
    return vector


def _numbers(tables: Table, key: str) -> dict[str, float]:
    """Return the numbers that tables have under a key, by the names of the tables."""
    return {name: item[key] for name, item in tables.items() if key in item}


def _plain(value: Any) -> Any:
    """Return user data with ordinary floats."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(value) if isinstance(value, float) else value
