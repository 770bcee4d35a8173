"""Reads a mechanism from a TOML file of format 1."""

import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from spherekit.argument_validation import checked
from spherekit.conventions import TURN, AnyPath
from spherekit.errors import FileError, ModelError
from spherekit.files.library import find, is_study
from spherekit.files.schema import check
from spherekit.files.toml_document import Document, Table, parse, read_text
from spherekit.files.toml_lines import KeyPath
from spherekit.files.units import construct_element, convert_to_model
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
from spherekit.mechanism.sizes import Vector
from spherekit.mechanism.wheel_phase import find_contact_start
from spherekit.quantity import AngleUnit
from spherekit.wording import choices, nearest

Answer = TypeVar("Answer")

AnyMechanism = Mechanism | str | os.PathLike[str]
"""A mechanism, or where `load` finds it: its path, or the name of a shipped one."""

_ACTION_TABLES = ("mass", "loads", "joint_limits")
"""Tables that say how a mechanism is loaded; its geometry does not depend on them."""

_SIZE_KEYS = ("axes", "arcs", "angles", "signed_arcs", "unpaired")
"""Keys of links that state a geometry by sizes."""

_ARC_PAIR_KEYS = ("through_xyz", "through_lonlat")
"""Keys of P pairs that state two points of the great circle along which they slide."""

_POSE_KEYS = ("xyz", "lonlat", *_ARC_PAIR_KEYS, "value")
"""Keys of pairs that state a geometry by a reference pose."""

_AXIS_PAIR_TYPES = ("R", "P")
"""Types of pairs with an axis. A P pair on a sphere turns about the pole of its arc."""

_KEY_MESSAGE = re.compile(r"(\w+(?:\.\w+|\[\d+\])*): (.*)", re.S)
"""A message of the model that begins with the path of a key."""

_PATH_PART = re.compile(r"(\w+)|\[(\d+)\]")
"""A key or an index in the text of a path."""


@checked(FileError)
def load(name_or_path: AnyPath) -> Mechanism:
    """Read a mechanism file, given by its path or by the name of a shipped mechanism.

    Raises
    ------
    FileError
        If there is no such file, or if it has faults. The message has one line for each
        fault.

    Examples
    --------
    >>> import spherekit as sk
    >>> sk.load("four_bar").variable_names
    ('theta_21', 'theta_32', 'theta_43', 'theta_41')
    """
    path = _find_mechanism(name_or_path)
    return loads(read_text(path), str(path))


def _find_mechanism(name_or_path: AnyPath) -> Path:
    """Return the path of a mechanism file; raise `FileError` if it is a study."""
    path = find(name_or_path)
    if is_study(path):
        raise FileError(
            f"{path}: this is a study, not a mechanism; read it with load_study, or run it "
            "with spherekit run"
        )
    return path


def mechanism_of(mechanism: AnyMechanism) -> Mechanism:
    """Return a mechanism, read by `load` if its path or name is given."""
    return mechanism if isinstance(mechanism, Mechanism) else load(mechanism)


def angle_unit_of(name_or_path: AnyPath) -> AngleUnit:
    """Return the unit of the angles in a mechanism file.

    The errors are those of `load`.
    """
    unit: AngleUnit = checked_document(name_or_path).data["angle_unit"]
    return unit


def checked_document(name_or_path: AnyPath) -> Document:
    """Return the document of a mechanism file after a check of its format.

    The errors are those of `load`.
    """
    path = _find_mechanism(name_or_path)
    document = parse(read_text(path), str(path))
    check(document)
    return document


@checked(FileError)
def loads(text: str, name: str = "text") -> Mechanism:
    """Read a mechanism from the text of a file.

    Parameters
    ----------
    text
        The text.
    name
        Name of the file in messages.

    Raises
    ------
    FileError
        If the text has faults. The message has one line for each fault.
    """
    return read(parse(text, name))


def read(document: Document) -> Mechanism:
    """Check a document against the format and return its mechanism.

    Raises
    ------
    FileError
        If the document has faults. The message has one line for each fault. If the document
        was built from data in code, without a text, the error is a `ModelError`.
    """
    check(document)
    return mechanism_from_document(document)


def mechanism_from_document(document: Document) -> Mechanism:
    """Construct the mechanism from a parsed file that has passed the check of its format.

    Raises
    ------
    FileError
        If the values of the file contradict each other. The message has the line and the
        key.
    ModelError
        In place of `FileError`, if a program has passed the data as a mapping, so that
        there is no text with lines.
    """
    try:
        # Angles are converted to rad, directions to unit vectors.
        reader = _MechanismReader(document, convert_to_model(document, document.data))
        # Actions are masses, loads and joint limits.
        return reader.add_actions(reader.mechanism())
    except ModelError as error:
        # An error that names no key belongs to the whole file, which has an empty path.
        raise _locate(document, error, ()) from None


def _locate(document: Document, error: ModelError, path: KeyPath) -> FileError | ModelError:
    """Return an error with file, line and key that replaces an error of the model.

    The classes of the model know no file. The caller raises the result in place of their
    error. The result is a `FileError` with the line of the key, or a `ModelError` if the
    document has no text.

    Parameters
    ----------
    document
        The document.
    error
        The error of the model. Its message can begin with a key, as "pairs.21.links: ...".
    path
        Path of the key for a message that does not begin with a key.
    """
    message = str(error).removeprefix(f"{document.data['name']}: ")
    own_path, message_after_key = _split_key_message(message)
    if own_path and own_path[0] in document.data:
        return document.fault(own_path, message_after_key)
    return document.fault(path, message)


def _split_key_message(message: str) -> tuple[KeyPath, str]:
    """Return the path of the key with which a message begins, and the rest of the message.

    From "pairs.21.links: ..." follows the path ("pairs", "21", "links"). The path is empty
    if the message does not begin with a key.
    """
    key_message = _KEY_MESSAGE.fullmatch(message)
    if key_message is None:
        return (), message
    key_text, rest = key_message.groups()
    path: KeyPath = ()
    for key, index in _PATH_PART.findall(key_text):
        path = (*path, int(index) if index else key)
    return path, rest


def replace_actions(mechanism: Mechanism, document: Document) -> Mechanism:
    """Return a mechanism with the masses, loads and joint limits of a document.

    The document must have the same links, pairs and sizes as the mechanism, which is not
    checked.
    """
    tables = {name: document.data[name] for name in _ACTION_TABLES if name in document.data}
    reader = _MechanismReader(document, convert_to_model(document, tables))
    return reader.add_actions(mechanism)


@dataclass(frozen=True)
class _MechanismReader:
    """Constructs a mechanism from the data of a file.

    Attributes
    ----------
    document
        The file, for messages.
    data
        The data of the file, which fits the schema, as `convert_to_model` returns it: with
        angles in rad and directions as unit vectors.
    """

    document: Document
    data: Table

    def fail(self, path: KeyPath, message: str) -> NoReturn:
        """Raise the `FileError` about a key path."""
        raise self.document.fault(path, message)

    def line_text(self, path: KeyPath) -> str:
        """Return `` (line 7)`` for a key of a file; empty for data from a program."""
        if self.document.text is None:
            return ""
        return f" (line {self.document.line(path)})"

    def check_link(self, path: KeyPath, link: str) -> None:
        """Raise an error about a key path if there is no link of a name."""
        links = self.data["links"]
        if link not in links:
            self.fail(path, f'no link is named "{link}"{choices(link, links, "Links")}')

    def call_model(
        self, path: KeyPath, function: Callable[..., Answer], *arguments: Any
    ) -> Answer:
        """Call a function of the model, and add file, line and key to its errors.

        Parameters
        ----------
        path
            Keys that lead to the value in the file that an error is about.
        function, arguments
            The function and its positional arguments.

        Returns
        -------
        The result of the function.

        Raises
        ------
        FileError
            If the function raises a `ModelError`. The new error has the same message, with
            the line and the key. If the message begins with a key, this key is stated
            instead of `path`.
        """
        try:
            return function(*arguments)
        except ModelError as error:
            raise _locate(self.document, error, path) from None

    def mechanism(self) -> Mechanism:
        """Return the mechanism in the file, without masses, loads and joint limits."""
        data = self.data
        # Tables in the file become objects of the model. An input (driven pair) without a
        # range moves through a full revolution.
        mechanism = Mechanism(
            name=data["name"],
            ground=data["ground"],
            links=tuple(data["links"]),
            pairs=tuple(self.pair(name) for name in data["pairs"]),
            geometry=self.geometry,
            inputs=tuple(
                construct_element(Input, {"from": 0.0, "to": TURN, **item}, {"pair": pair})
                for pair, item in data.get("inputs", {}).items()
            ),
            outputs=tuple(
                self.output(name, item) for name, item in data.get("outputs", {}).items()
            ),
            modes=data.get("modes", {}),
            source=construct_element(Source, data["source"]) if "source" in data else None,
            # Free data of the user, in which numbers become ordinary floats.
            user=_plain(data.get("user", {})),
            description=data.get("description", ""),
            # The unit of angles in parameters of analyses that users write without a unit.
            angle_unit=self.document.data["angle_unit"],
        )
        # Two wheels are a contact of two circles that roll on each other. The variable of
        # the contact is the rolled arc length. A file can state the phase of the wheels,
        # which are angles of their shafts at which they mesh. The phase and all sizes
        # determine the start of the contact: the arc lengths on both circles at which the
        # variable is 0.
        pairs = tuple(self.with_start(mechanism, pair) for pair in mechanism.pairs)
        return replace(mechanism, pairs=pairs) if pairs != mechanism.pairs else mechanism

    def add_actions(self, mechanism: Mechanism) -> Mechanism:
        """Return a copy of a mechanism with the masses, loads and joint limits of the file.

        Parameters
        ----------
        mechanism
            The mechanism, as it was read from the other tables of the file. Masses, loads
            and joint limits refer to its links and pairs (joints).

        Raises
        ------
        FileError
            If a link does not exist, or if a link lacks an R pair that its mass names.
        ModelError
            If values contradict each other.
        """
        masses = self.data.get("mass", {})
        loads = self.data.get("loads", {})
        limits = self.data.get("joint_limits", {})
        for link in masses:
            if link not in mechanism.link_number:
                self.fail(
                    ("mass", link),
                    f'no link is named "{link}"{choices(link, mechanism.links, "Links")}',
                )
        # The file can state the place of a mass by the axes of pairs in its link. The axes
        # are computed at the first call of this function, and only if a mass needs them.
        axes_in_links = cache(partial(link_axes, mechanism))
        return replace(
            mechanism,
            masses=tuple(
                self.mass(link, item, axes_in_links) for link, item in masses.items()
            ),
            loads=tuple(self.load(name, item) for name, item in loads.items()),
            joint_limits=tuple(
                construct_element(JointLimit, item, {"pair": pair})
                for pair, item in limits.items()
            ),
        )

    def load(self, name: str, item: Table) -> Load:
        """Return a load from its table in the file.

        Fields that the table lacks get defaults.
        """
        kind: Any = LOADS[item.get("kind", PairTorque.kind)]
        fields = {key: item[key] for key in kind.field_kinds if key in item}
        return kind(name, **{**kind.defaults_in_files, **fields})  # type: ignore[no-any-return]

    def mass(self, link: str, item: Table, axes_in_links: Callable[[], LinkAxes]) -> Mass:
        """Return the mass, inertia tensor and centre of mass of a link.

        The tensor is about the centre of the sphere. Tensor and centre of mass are in the
        axes of the link.

        Parameters
        ----------
        link
            Name of the link.
        item
            The table of the link in the file. It has one of these keys:

            - "arc", the names of two R pairs: the link is a uniform arc between their axes,
              with the key "radius" (m),
            - "tensor", the inertia tensor (kg m2) about the centre of the sphere,
            - "tensor_at_centre", the inertia tensor (kg m2) about the centre of mass.

            Tensor and centre are in the axes of the link. With the key "frame" (names of
            two R pairs), they are in a frame that the axes of these pairs define.
        axes_in_links
            Function that returns the axes of pairs in their links.

        Raises
        ------
        FileError
            If the radius is not positive, or the R pairs do not define an arc or a frame.
            The message names the key.
        ModelError
            If no body can have the tensor.
        """
        # Mass and centre of mass; None if the file does not give them.
        mass = item.get("mass")
        centre = item.get("centre")

        def from_two_axes(key: str, function: Callable[..., Answer], *args: Any) -> Answer:
            """Call a function with the axes of the two R pairs that a key names.

            The arguments are the two axes (vectors in the axes of the link) and `args`.
            Errors name the key.
            """
            path = ("mass", link, key)
            axes = []
            for index, pair in enumerate(item[key]):
                axis = self.call_model(
                    (*path, index), axis_in_link, axes_in_links(), link, pair
                )
                axes.append(np.array(axis))
            return self.call_model(path, function, *axes, *args)

        if "arc" in item:
            if not item["radius"] > 0:
                self.fail(
                    ("mass", link, "radius"),
                    f"found {item['radius']:g} m, expected more than 0",
                )
            # The tensor of a uniform arc is about the centre of the sphere.
            tensor, centre = from_two_axes("arc", uniform_arc, mass, item["radius"])
        else:
            key = "tensor" if "tensor" in item else "tensor_at_centre"
            tensor = np.array(item[key])
            check_tensor(f"mass.{link}.{key}", tensor)
            if key == "tensor_at_centre":
                tensor = shift_to_sphere_centre(tensor, item["mass"], np.array(centre))
            if "frame" in item:
                # Rotate tensor and centre from the frame to the axes of the link.
                frame = from_two_axes("frame", axes_frame)
                tensor = frame @ tensor @ frame.T
                centre = None if centre is None else frame @ centre
        if centre is not None:
            centre = as_vector(centre)
        # The products above round entries (i, j) and (j, i) differently. The mean of both
        # entries makes the tensor exactly symmetric.
        symmetric_tensor = as_tensor((tensor + tensor.T) / 2)
        return Mass(link, symmetric_tensor, mass, centre)

    def with_start(self, mechanism: Mechanism, pair: Pair) -> Pair:
        """Return a pair of wheels with the start of the contact, computed from the phase.

        The file can state a phase: the angles of the shafts of two wheels in one
        configuration in which they mesh. The start consists of two arc lengths, which
        locate the contact point on both pitch circles where the variable of the contact is
        0. This is the configuration of the phase or, if a shaft is driven, the one in which
        this shaft is at 0. Pairs without a phase are returned unchanged.

        Parameters
        ----------
        mechanism
            The mechanism. Its contacts with a phase have no start yet.
        pair
            One of its pairs.
        """
        item = self.data["pairs"][pair.name]
        path = ("pairs", pair.name, "phase")
        if "phase" not in item:
            return pair
        if "start" in item:
            self.fail(path, "start already determines this; give only one of the two")
        start = self.call_model(path, find_contact_start, mechanism, pair, item["phase"])
        return replace(pair, start=start)

    @cached_property
    def geometry(self) -> SizeGeometry | PoseGeometry:
        """The geometry in the file: sizes of links, or the axes of all pairs in one pose.

        A file has keys of one of these two forms. Sizes are the arcs and angles of links,
        and for each pair the ``zero`` from which its angle is counted. A pose is one
        configuration, with the directions of all axes. A file with R or P pairs must have
        exactly one of both forms.
        """
        pairs = self.data["pairs"]
        links = self.data["links"]
        # All keys of both forms in the file, as paths (table, name, key).
        size_paths = self.paths_of("links", _SIZE_KEYS) + self.paths_of("pairs", ("zero",))
        pose_paths = self.paths_of("pairs", _POSE_KEYS)
        if size_paths and pose_paths:
            first, second = sorted((size_paths[0], pose_paths[0]), key=self.document.line)
            first_form, second_form = (
                ("dimensions", "reference pose")
                if first in size_paths
                else ("reference pose", "dimensions")
            )
            self.fail(
                second,
                "the file mixes two ways to state the geometry: "
                f"{'.'.join(map(str, first))}{self.line_text(first)} belongs to the "
                f"{first_form}, but this key belongs to the {second_form}. "
                "Keep either the dimensions (in links: axes, arcs and angles; in pairs: "
                "zero) or the reference pose (in pairs: value, and one of "
                f"{', '.join(_POSE_KEYS[:-1])})",
            )
        # A reference pose: the axes of pairs, and the variables of the pairs in the pose.
        if pose_paths:
            axes: dict[str, Vector] = {}
            for name, item in pairs.items():
                # A contact has no axis. If an R or P pair has none, `Mechanism` raises the
                # error when it is made.
                axis = self.axis(name, item)
                if axis is not None:
                    axes[name] = axis
            return PoseGeometry(axes, _numbers(pairs, "value"))
        # `joined_links` has the two links of each R and P pair. Without these, all pairs
        # are contacts of profiles, and links need no sizes.
        if self.joined_links and not size_paths:
            first_pair = next(iter(self.joined_links))
            self.fail(
                ("pairs", first_pair),
                "no geometry: give axes and arcs in every link, or xyz or lonlat in "
                "every R pair",
            )
        # Sizes of links. A link with several of the keys is listed once.
        links_with_sizes = dict.fromkeys(
            link for _, link, _ in self.paths_of("links", _SIZE_KEYS)
        )
        sizes: dict[Any, LinkSizes] = {}
        for link in links_with_sizes:
            if "axes" not in links[link]:
                self.fail(
                    ("links", link),
                    'the key "axes" is missing; add it. It lists the names of the R pairs '
                    "on the link",
                )
            sizes[link] = construct_element(LinkSizes, links[link])
        return SizeGeometry(sizes, _numbers(pairs, "zero"))

    def paths_of(self, table: str, keys: Sequence[str]) -> list[KeyPath]:
        """Return the paths (table, element, key) of all of the keys that elements have."""
        return [
            (table, name, key)
            for name, item in self.data[table].items()
            for key in keys
            if key in item
        ]

    def axis(self, name: str, item: Table) -> Vector | None:
        """Return the axis (unit vector) of a pair in the reference pose, or None.

        The table states the axis itself, or for a P pair two points. A P pair slides along
        a great circle through these points. The axis of a P pair is the pole of the circle.
        """
        for key in _ARC_PAIR_KEYS:
            if key in item:
                return self.call_model(("pairs", name, key), arc_pole, *item[key])
        return _vector(item)

    @cached_property
    def joined_links(self) -> dict[str, Links]:
        """The two links of every pair with an axis."""
        return {
            name: item["links"]
            for name, item in self.data["pairs"].items()
            if item["type"] in _AXIS_PAIR_TYPES
        }

    @cached_property
    def axes_in_links(self) -> LinkAxes:
        """The unit vector along each R pair, in the coordinates of each of its two links.

        The file can place other things by these vectors, such as the circles of gear wheels
        and the directions of outputs. The vectors are computed from a mechanism with only
        the R pairs (hinges) of the file, because the other pairs are not read yet.
        """
        pairs = tuple(Pair(name, "R", links) for name, links in self.joined_links.items())
        mechanism = Mechanism(
            name=self.data["name"],
            ground=self.data["ground"],
            links=tuple(self.data["links"]),
            pairs=pairs,
            geometry=self.geometry,
        )
        return link_axes(mechanism)

    def output(self, name: str, item: Table) -> Output:
        """Return an output: a link whose motion relative to another link is of interest.

        Parameters
        ----------
        name
            Name of the output.
        item
            The table of the output in the file. The observed direction on the link is the
            axis of a pair ("axis"), a vector ("xyz") or two angles ("lonlat"). The motion
            is relative to the ground, or to the link that "relative_to" names.
        """
        path: KeyPath = ("outputs", name)
        direction_keys = [key for key in ("axis", "xyz", "lonlat") if key in item]
        if len(direction_keys) > 1:
            self.fail(
                (*path, direction_keys[1]),
                f"the direction is already given by {direction_keys[0]}; leave one of the "
                "two keys out",
            )
        # The path is used only in messages about an axis. The direction may be a vector.
        direction = self.axis_or_vector((*path, "axis"), item)
        relative_to = item.get("relative_to", self.data["ground"])
        return Output(name, item["link"], relative_to, direction)

    def axis_or_vector(self, path: KeyPath, item: Table, prefix: str = "") -> Vector | None:
        """Return the direction in a table of the file, in the axes of the table's link.

        Parameters
        ----------
        path
            Keys that lead to the key ``axis``, for messages.
        item
            The table, with the key ``link``. The direction is ``axis`` (the name of an R
            pair, a hinge) or a vector.
        prefix
            Beginning of the keys of a vector, such as "centre_" for ``centre_xyz``.

        Returns
        -------
        (3,) the unit vector, or None if the table has neither an axis nor a vector.
        """
        if "axis" not in item:
            return _vector(item, prefix)
        self.check_link((*path[:-1], "link"), item["link"])
        return self.call_model(
            path, axis_in_link, self.axes_in_links, item["link"], item["axis"]
        )

    def pair(self, name: str) -> Pair:
        """Return a pair (joint) from its table in the file.

        R pairs (hinges) and P pairs (sliders) have an axis. P pairs become R pairs, because
        sliding along a great circle is turning about its pole. The axis is not stored in
        the `Pair`, but in the geometry of the mechanism. All other pairs are contacts of
        two curves, the profiles.
        """
        item = self.data["pairs"][name]
        path = ("pairs", name)
        # `joined_links` has the two links of every pair with an axis.
        if name in self.joined_links:
            return Pair(name, "R", self.joined_links[name])
        # The profiles of gears and cones are circles, which are computed from the table.
        # The file states the profiles of other contacts.
        if "teeth" in item or "half_angles" in item:
            profiles = self.cones(path, item)
        else:
            profiles = self.profiles(path, item)
        # The table of the contact has its other fields, such as the type ("Cr" for rolling,
        # "Cs" for sliding contact) and the two links.
        return construct_element(Pair, item, {"name": name, "profiles": profiles})

    def cones(self, path: KeyPath, item: Table) -> tuple[Profile, ...]:
        """Return the two circles of a contact of cones, or of bevel gears.

        A cone with its apex in the centre of the sphere intersects the sphere in a circle.
        Bevel gears roll on each other like their pitch cones.

        Parameters
        ----------
        path
            Keys that lead to the pair, for messages.
        item
            The table of the pair: its links, the axes of the cones, and their half angles
            (rad) or numbers of teeth.

        Returns
        -------
        A circle for each link, with its centre (axis of the cone) in the axes of the link.
        """
        links = item["links"]
        axes = item["axes"]

        def find_centres() -> tuple[list[Vector], float]:
            """Return the axes of both cones in their links, and the angle between them.

            The carrier is the link in which both axes are fixed. The angle (rad) between
            the axes is the shaft angle.
            """
            carrier = find_gear_carrier(self.joined_links, self.axes_in_links, links, axes)
            centres = [
                axis_in_link(self.axes_in_links, link, axis)
                for link, axis in zip(links, axes, strict=True)
            ]
            return centres, carrier.shaft_angle

        for link in links:
            self.check_link((*path, "links"), link)
        # `call_model` adds file, line and key to the message of any error in a function.
        centres, shaft_angle = self.call_model((*path, "axes"), find_centres)
        # The radius of a circle is the half angle of its cone. If the file states only one
        # half angle, `check_half_angles` adds the second. If both are stated, small
        # deviations from contact are removed by a change of the second.
        contact = item.get("contact", "external")
        if "teeth" in item:
            radii = self.call_model(
                (*path, "teeth"), pitch_angles, item["teeth"], shaft_angle, contact
            )
        else:
            radii = self.call_model(
                (*path, "half_angles"),
                check_half_angles,
                item["half_angles"],
                shaft_angle,
                contact,
            )
        return tuple(
            Profile("circle", centre, radius)
            for centre, radius in zip(centres, radii, strict=True)
        )

    def profiles(self, path: KeyPath, item: Table) -> tuple[Profile, ...]:
        """Return the two curves of a contact, in the order of its links.

        A contact is between two curves, one on each link of the pair. The table
        ``profiles`` has curves by link. In place of one curve, the table ``follower`` can
        describe a cam follower: a roller or a flat face.

        Parameters
        ----------
        path
            Keys that lead to the pair, for messages.
        item
            The table of the pair.
        """
        # The curve of each link, and its location in the file for messages.
        path_of_link: dict[str, KeyPath] = {}
        curve_of_link: dict[str, Profile] = {}
        for link, profile in item["profiles"].items():
            path_of_link[link] = (*path, "profiles", link)
            curve_of_link[link] = construct_element(Profile, profile)
        follower = item.get("follower")
        if follower is not None:
            link = follower["link"]
            follower_path = (*path, "follower", "link")
            if link in path_of_link:
                self.fail(
                    follower_path,
                    f'link "{link}" already has a curve in "profiles"'
                    f"{self.line_text(path_of_link[link])}; remove this curve or the "
                    "follower",
                )
            path_of_link[link] = follower_path
            curve_of_link[link] = self.follower((*path, "follower"), follower)
        # There must be one curve for each of the two links, and no other.
        links = item["links"]
        for link, link_path in path_of_link.items():
            if link not in links:
                self.fail(
                    link_path,
                    f'the pair joins "{links[0]}" and "{links[1]}", not "{link}"'
                    f"{nearest(link, links)}",
                )
        for link in links:
            if link not in curve_of_link:
                self.fail(
                    (*path, "profiles"),
                    f'the curve of link "{link}" is missing; give its profile, or the '
                    "key follower for a roller or a flat face",
                )
        return tuple(curve_of_link[link] for link in links)

    def follower(self, path: KeyPath, item: Table) -> Profile:
        """Return the curve of a cam follower.

        On the sphere, a roller is a circle, and a flat face is a great circle.

        Parameters
        ----------
        path
            Keys that lead to the table of the follower, for messages.
        item
            The table of the follower. A flat face has the key "flat" and the pole of the
            great circle (``pole_xyz`` or ``pole_lonlat``). A roller has the key "roller"
            (angular radius, rad) and the centre of the circle. The centre is a vector
            (``centre_xyz`` or ``centre_lonlat``), or the name of an R pair (hinge) on
            whose axis it is (``axis``).
        """
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
    """Return the unit vector that a table states under ``xyz`` or ``lonlat``, or None.

    The name of the key can have a prefix. Longitudes and latitudes were converted to unit
    vectors before.
    """
    vector: Vector | None = item.get(f"{prefix}xyz", item.get(f"{prefix}lonlat"))
    return vector


def _numbers(tables: Table, key: str) -> dict[str, float]:
    """Return the numbers under a key, by name, for those inner tables that have the key."""
    return {name: item[key] for name, item in tables.items() if key in item}


def _plain(value: Any) -> Any:
    """Return user data with ordinary floats in place of `LiteralNumber`."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return float(value) if isinstance(value, float) else value
