"""The description of a spherical mechanism: links, pairs, geometry, masses and loads."""

import math
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.conventions import MAX_NAME_LENGTH, NAME_PATTERN, Names
from spherekit.errors import ModelError
from spherekit.escaping import html_text
from spherekit.markup import html_table
from spherekit.mechanism.elements import (
    Angles,
    Input,
    LinkSizes,
    Output,
    Pair,
    PoseGeometry,
    SizeGeometry,
    Source,
    resize_link,
)
from spherekit.mechanism.inertia import Mass, check_mass
from spherekit.mechanism.joint import JOINT_KINDS
from spherekit.mechanism.load import Load
from spherekit.mechanism.load_kinds import JointLimit, check_joint_limit
from spherekit.mechanism.sizes import (
    Sizes,
    as_float_rows,
    check_finite,
    to_radians,
    unit_vector_along,
)
from spherekit.number_text import degree_range_text, degrees_text
from spherekit.quantity import AngleUnit
from spherekit.wording import choices, counted, listing, nearest

ONE_TURN_RAD = 2.0 * math.pi
"""Range of an input that is driven without a range."""

UNCOMPARED = ("source", "user", "description", "angle_unit")
"""Fields on which no result depends. `Mechanism.content` leaves them out."""

_FIELD_KINDS: Mapping[type, Mapping[str, str]] = {
    Pair: {"links": "links", "profiles": "profiles"},
    Input: {"pair": "pair"},
    Output: {"link": "link", "relative_to": "link", "direction": "vector"},
    Mass: {"link": "link", "tensor": "tensor", "centre": "vector"},
    JointLimit: {"pair": "pair"},
}


def field_kinds(part: Any) -> Mapping[str, str]:
    """Return what each field of a part of a mechanism contains, by the field's name.

    Code that renames links or changes axes needs to know which fields are affected.
    `Load.field_kinds` describes the kinds, such as ``link`` or ``vector``. Fields without
    names or axes may be missing.

    Parameters
    ----------
    part
        A pair, input, output, mass, load or joint limit.
    """
    return part.field_kinds if isinstance(part, Load) else _FIELD_KINDS[type(part)]


@dataclass(frozen=True)
class Mechanism:
    """A spherical mechanism as a graph of links and pairs with its geometry.

    The object is immutable and complete: everything else is computed from it. The index of
    a link or pair is its position in `links` or `pairs`, from 0. It is also called its
    number.

    Attributes
    ----------
    name
        Name of the mechanism.
    ground
        Name of the fixed link.
    links
        Names of all links. The ground is always the first one.
    pairs
        The pairs with their links and, for contacts, profiles.
    geometry
        Arcs and angles of the links, or the axes of all pairs in a reference pose.
    inputs
        The driven pairs and their ranges. A mechanism that is made without inputs is driven
        at its first R pair, through one turn. `inputs` is therefore empty only if there is
        no R pair.
    outputs
        Links, or directions in links, whose motion is of interest.
    masses
        Inertia of links.
    loads
        Forces and torques, springs, friction and the like.
    joint_limits
        Ranges that variables of R pairs may not leave.
    modes
        Named assembly modes. Each is given by the variables (rad) of some R pairs, among
        them all inputs, in one configuration.
    source
        Publication from which the mechanism is taken.
    user
        Data of the user, which spherekit does not read.
    description
        What the mechanism is and what it is used for; empty if the file does not say.
    angle_unit
        Unit of angles of the file from which the mechanism was read. Texts without a unit,
        such as the parameters of analyses, are read in this unit. The unit has no influence
        on numbers in Python, which are in rad. A mechanism without a file has "rad".

    Raises
    ------
    ModelError
        If names repeat or are unknown, or the geometry does not fit the pairs.
    """

    name: str
    ground: str
    links: Names
    pairs: tuple[Pair, ...]
    geometry: SizeGeometry | PoseGeometry
    inputs: tuple[Input, ...] = ()
    outputs: tuple[Output, ...] = ()
    masses: tuple[Mass, ...] = ()
    loads: tuple[Load, ...] = ()
    joint_limits: tuple[JointLimit, ...] = ()
    modes: Mapping[str, Angles] = field(default_factory=dict)
    source: Source | None = None
    user: Mapping[str, Any] = field(default_factory=dict)
    description: str = ""
    angle_unit: AngleUnit = field(default="rad", compare=False)

    def __post_init__(self) -> None:
        """Put the ground first, check everything, and fill in the default input."""
        links = sorted(self.links, key=lambda name: name != self.ground)
        object.__setattr__(self, "links", tuple(links))
        _check(self)
        if not self.inputs:
            # The default input is the first R pair, driven through one turn.
            default_inputs = tuple(
                Input(pair, 0.0, ONE_TURN_RAD, is_default=True)
                for pair in list(self.angles)[:1]
            )
            object.__setattr__(self, "inputs", default_inputs)

    @cached_property
    def link_number(self) -> Mapping[str, int]:
        """Position of each link in `links`, by name."""
        return {name: number for number, name in enumerate(self.links)}

    @cached_property
    def pair_number(self) -> Mapping[str, int]:
        """Position of each pair in `pairs`, by name."""
        return {pair.name: number for number, pair in enumerate(self.pairs)}

    @cached_property
    def content(self) -> str:
        """Text of all fields except `UNCOMPARED`. Equal texts mean equal results."""
        compared = [part.name for part in fields(self) if part.name not in UNCOMPARED]
        with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
            return repr([getattr(self, name) for name in compared])

    @property
    def input_pairs(self) -> Names:
        """Names of the driven pairs, in the order of `inputs`."""
        return tuple(item.pair for item in self.inputs)

    def names_of(self, pairs: Iterable[int]) -> list[str]:
        """Return the names of pairs by their indices."""
        return [self.pairs[pair].name for pair in pairs]

    @cached_property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """The two link indices of every pair, in the order of `pairs`."""
        return tuple(
            (self.link_number[first_link], self.link_number[second_link])
            for first_link, second_link in (pair.links for pair in self.pairs)
        )

    @cached_property
    def variable_owners(self) -> tuple[int, ...]:
        """The pair index of every variable; R and Cr pairs have one variable, Cs two."""
        return tuple(
            number
            for number, pair in enumerate(self.pairs)
            for _ in range(pair.kind.variable_count)
        )

    @cached_property
    def variable_names(self) -> Names:
        """Names of variables: ``theta_PAIR`` (R), ``s_PAIR`` (Cr), ``s_PAIR_LINK`` (Cs)."""
        return tuple(
            name
            for pair in self.pairs
            for name in pair.kind.variable_names(pair.name, pair.links)
        )

    @cached_property
    def variable_meanings(self) -> tuple[str, ...]:
        """What each variable measures, in words for users."""
        return tuple(
            meaning
            for pair in self.pairs
            for meaning in pair.kind.variable_meanings(pair.name, pair.links)
        )

    @cached_property
    def angles(self) -> Mapping[str, int]:
        """The indices of the variables that are angles about fixed axes, by R pair."""
        return {
            self.pairs[owner].name: variable
            for variable, owner in enumerate(self.variable_owners)
            if self.pairs[owner].kind.has_axis
        }

    @property
    def has_contacts(self) -> bool:
        """Whether some pairs are not R pairs."""
        return len(self.angles) < len(self.pairs)

    @cached_property
    def pole_pairs(self) -> Mapping[tuple[int, int], int]:
        """Indices of the pairs (joints) whose axis or contact line is a pole axis.

        A pole axis is the axis of the relative rotation of two links. An R pair or a
        rolling contact gives the pole axis of the two links that it joins, so this axis
        needs no construction. Other poles are not in this mapping.

        The keys are the indices of the two links, the smaller one first. The values are the
        indices of the pairs.
        """
        return {
            (min(ends), max(ends)): number
            for number, (pair, ends) in enumerate(zip(self.pairs, self.ends, strict=True))
            if pair.kind.pole_line is not None
        }

    def angle_between(self, first_link: int, second_link: int) -> int | None:
        """Return the index of the variable for the angle between two links, or None.

        The variable belongs to the first R pair (revolute joint) that joins both links.
        """
        for name, variable in self.angles.items():
            if set(self.ends[self.pair_number[name]]) == {first_link, second_link}:
                return variable
        return None

    def variables_of(self, pair: int) -> tuple[int, ...]:
        """Return the indices of a pair's variables."""
        return tuple(n for n, owner in enumerate(self.variable_owners) if owner == pair)

    def pair(self, name: str) -> Pair:
        """Return the pair with this name.

        Raises
        ------
        ModelError
            If there is none. The message suggests a similar name.
        """
        if name not in self.pair_number:
            raise unknown_name_error(self.name, "pair", name, self.pair_number)
        return self.pairs[self.pair_number[name]]

    def link(self, name: str) -> int:
        """Return the index of the link with this name.

        Raises
        ------
        ModelError
            If there is none. The message suggests a similar name.
        """
        if name not in self.link_number:
            raise unknown_name_error(self.name, "link", name, self.links)
        return self.link_number[name]

    def _repr_html_(self) -> str:
        """Return tables of the pairs (joints) and of the links as HTML, for notebooks."""
        range_by_pair = {
            driven.pair: f"input from {degree_range_text(driven.start, driven.stop)} deg"
            for driven in self.inputs
        }
        pair_rows = [
            [
                pair.name,
                f"{pair.type} ({JOINT_KINDS[pair.type].description})",
                " and ".join(pair.links),
                range_by_pair.get(pair.name, ""),
            ]
            for pair in self.pairs
        ]
        links_with_mass = {mass.link for mass in self.masses}
        link_rows = []
        for number, link in enumerate(self.links):
            pairs = listing(pair.name for pair in self.pairs if link in pair.links)
            remarks = []
            if number == 0:
                remarks.append("ground")
            if link in links_with_mass:
                remarks.append("has inertia")
            link_rows.append([link, pairs, self._arcs_text(link), ", ".join(remarks)])
        pair_titles = ["pair", "type", "joins the links", "driven"]
        link_titles = ["link", "pairs", "arcs (deg)", "remarks"]
        # Columns 2 and 3 (arcs, remarks) are removed if they are empty.
        for column in (3, 2):
            if not any(row[column] for row in link_rows):
                del link_titles[column]
                link_rows = [row[:column] + row[column + 1 :] for row in link_rows]
        # `repr` encloses its text in < and >, which are removed.
        text_in_brackets = repr(self)
        summary = f"<p>{html_text(text_in_brackets[1:-1])}</p>"
        pair_table = html_table(pair_titles, pair_rows, f"Pairs of {self.name}")
        link_table = html_table(link_titles, link_rows, f"Links of {self.name}")
        return summary + pair_table + link_table

    def _arcs_text(self, link: str) -> str:
        """Return the arcs of a link in degrees as text, such as ``41 to 21: 60``.

        An arc is the angle between the first axis of the link and another axis. The text is
        empty if the geometry is given by a reference pose, or if the link has no arcs.
        """
        if not isinstance(self.geometry, SizeGeometry) or link not in self.geometry.links:
            return ""
        sizes = self.geometry.links[link]
        first_axis, *other_axes = sizes.axes
        return ", ".join(
            f"{first_axis} to {axis}: {degrees_text(arc)}"
            for axis, arc in zip(other_axes, sizes.arcs, strict=False)
        )

    def __repr__(self) -> str:
        types = Counter(pair.type for pair in self.pairs)
        parts = [
            counted(len(self.links), "link"),
            f"pairs {', '.join(f'{count} {kind}' for kind, count in types.items())}",
            f"inputs {listing(self.input_pairs) or 'none'}",
        ]
        named = {
            "inertia of": [mass.link for mass in self.masses],
            "loads": [load.name for load in self.loads],
            "joint limits of": [limit.pair for limit in self.joint_limits],
        }
        parts += [f"{what} {listing(names)}" for what, names in named.items() if names]
        return f"<Mechanism {self.name}: {'; '.join(parts)}>"

    @checked(ModelError)
    def with_inputs(
        self,
        *pairs: str,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        angle_unit: AngleUnit | None = None,
    ) -> "Mechanism":
        """Return the same mechanism with other inputs, or with other ranges of the inputs.

        The names of assembly modes are kept if the inputs remain the same.

        Parameters
        ----------
        pairs
            Names of the driven pairs. If no names are given, the inputs remain.
        ranges
            First and last value of the variable, by input. An input without a new range
            keeps its present range. A pair that was not an input before gets a range of one
            turn.
        angle_unit
            Unit of the ranges, ``"deg"`` or ``"rad"``.

        Raises
        ------
        ModelError
            If there is no such pair, or ranges are given without a unit.

        Examples
        --------
        >>> import spherekit as sk
        >>> driven = sk.load("four_bar").with_inputs("41")
        >>> half = driven.with_inputs(ranges={"41": (0, 90)}, angle_unit="deg")
        """
        # Inputs with a range, by pair: first those that the user has declared, then those
        # with new ranges. A mechanism without declared inputs has a default one, which
        # rotates through one turn.
        input_by_pair = {item.pair: item for item in self.inputs if not item.is_default}
        declared_names = set(input_by_pair)
        names = pairs or self.input_pairs
        if ranges and angle_unit is None:
            raise ModelError('with_inputs: ranges need angle_unit="deg" or "rad"')
        for name, (start, stop) in (ranges or {}).items():
            if self.pair(name).name not in names:
                raise ModelError(
                    f"with_inputs: ranges: {name} is not an input. Inputs: {listing(names)}"
                )
            input_by_pair[name] = Input(
                name, to_radians(start, angle_unit), to_radians(stop, angle_unit)
            )
        # Pairs without a range are driven through one turn.
        one_turn_inputs = (Input(self.pair(name).name, 0.0, ONE_TURN_RAD) for name in names)
        inputs = tuple(input_by_pair.get(item.pair, item) for item in one_turn_inputs)
        # The same mechanism is returned if nothing changes. Default inputs compare as equal
        # to declared ones, but the result must declare them.
        if declared_names and inputs == self.inputs:
            return self
        # A named assembly mode is given by angles of some pairs, among them all declared
        # inputs. If other pairs are driven, their angles can be missing, so the names are
        # dropped. If no inputs were declared, the names are kept. Those that lack the angle
        # of an input are reported later (`assign_mode_names`).
        keeps_modes = not declared_names or declared_names == set(names)
        return replace(self, inputs=inputs, modes=self.modes if keeps_modes else {})

    @checked(ModelError)
    def with_sizes(
        self,
        *,
        angle_unit: AngleUnit,
        arcs: Mapping[str, Sizes] | None = None,
        angles: Mapping[str, Sizes] | None = None,
        zeros: Angles | None = None,
        axes: Mapping[str, ArrayLike] | None = None,
        values: Angles | None = None,
    ) -> "Mechanism":
        """Return the same mechanism with other sizes.

        A mechanism is given in one of two forms, by the sizes of its links or by the axes
        of its pairs in a reference pose. Sizes that are not named do not change.

        Parameters
        ----------
        angle_unit
            Unit of all angles, ``"deg"`` or ``"rad"``.
        arcs, angles
            For a mechanism given by sizes, the new sizes of links, by name of the link. The
            arcs of a link lead from its first axis to each other axis. Its angles are at
            the first axis, from the first arc to each other arc. A number is enough for a
            link with only one arc (or angle). A sequence replaces all of them. A mapping
            replaces some of them, each named by the pair at whose axis the arc ends, as in
            ``{"3": {"43": 70.0}}``.
        zeros
            For a mechanism given by sizes, the new zeros of pairs, by name of the pair. At
            a pair, the reference arc of a link leads from the axis of the pair to the first
            other axis of the link that is not on the same line. The zero of the pair is the
            angle from the reference arc of its first link to that of its second link in the
            position where the variable of the pair is zero.
        axes, values
            For a mechanism given in a reference pose, by pair: its axis (3,) of any length,
            and the value of its variable.

        Raises
        ------
        ModelError
            If a link or R pair is unknown, a size is impossible, or an argument belongs to
            the other form.

        Examples
        --------
        >>> import spherekit as sk
        >>> longer = sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": 25.0})
        """
        geometry = self.geometry
        if isinstance(geometry, SizeGeometry):
            form = "arcs, angles and zeros"
            of_other_form: Mapping[str, Any] = {"axes": axes, "values": values}
        else:
            form = "axes and values in a pose"
            of_other_form = {"arcs": arcs, "angles": angles, "zeros": zeros}
        # A mechanism has sizes of links or a reference pose, and keeps this form.
        for key, argument in of_other_form.items():
            if argument is not None:
                raise ModelError(
                    f"{self.name}: with_sizes: {key} cannot be changed, because this "
                    f"mechanism is given by {form}; change one of those instead"
                )
        for name in {**(zeros or {}), **(axes or {}), **(values or {})}:
            if not self.pair(name).kind.has_axis:
                raise ModelError(
                    f'{self.name}: with_sizes: pair "{name}" is a contact pair; only R '
                    "pairs have an axis"
                )
        if isinstance(geometry, SizeGeometry):
            links = dict(geometry.links)
            for kind, sizes_by_link in (("arcs", arcs), ("angles", angles)):
                for link, sizes in (sizes_by_link or {}).items():
                    where = f"{self.name}: links.{link}.{kind}"
                    old = links.get(self.links[self.link(link)], LinkSizes(()))
                    links[link] = resize_link(where, old, kind, sizes, angle_unit)
            zeros = {**geometry.zeros, **self._to_radians_by_pair(zeros, angle_unit)}
            return replace(self, geometry=SizeGeometry(links, zeros))
        new_axes = {
            self.pair(name).name: unit_vector_along(f"{self.name}: pairs.{name}", axis)
            for name, axis in (axes or {}).items()
        }
        values = {**geometry.values, **self._to_radians_by_pair(values, angle_unit)}
        return replace(self, geometry=PoseGeometry({**geometry.axes, **new_axes}, values))

    def _to_radians_by_pair(
        self, angles: Angles | None, unit: AngleUnit
    ) -> dict[str, float]:
        """Return angles in rad by pair; `ModelError` if there is no such pair."""
        return {
            self.pair(name).name: to_radians(angle, unit)
            for name, angle in (angles or {}).items()
        }

    @checked(ModelError)
    def with_mass(
        self,
        link: str,
        tensor: ArrayLike | None,
        mass: float | None = None,
        centre: ArrayLike | None = None,
    ) -> "Mechanism":
        """Return the same mechanism with another inertia of a link.

        Parameters
        ----------
        link
            Name of the link.
        tensor
            (3, 3) inertia tensor (kg m2) about the centre of the sphere, in link axes. None
            removes the inertia of the link.
        mass, centre
            Mass (kg), and centre of mass (3,) (m) in link axes. Gravity needs them.

        Raises
        ------
        ModelError
            If there is no such link, or no body can have this inertia.

        Examples
        --------
        >>> import spherekit as sk
        >>> heavier = sk.load("four_bar").with_mass("4", [[4, 0, 0], [0, 4, 0], [0, 0, 1]])
        """
        self.link(link)  # checks that the link exists
        mass_by_link = {item.link: item for item in self.masses}
        if tensor is None:
            mass_by_link.pop(link, None)
        else:
            # Arrays become tuples. Other shapes are refused.
            where = f"{self.name}: mass.{link}"
            rows = as_float_rows(f"{where}.tensor", tensor, (3, 3))
            mass_centre = None
            if centre is not None:
                mass_centre = as_float_rows(f"{where}.centre", centre, (3,))
            mass_by_link[link] = Mass(link, tensor=rows, mass=mass, centre=mass_centre)
        return replace(self, masses=tuple(mass_by_link.values()))

    @checked(ModelError)
    def with_loads(self, *loads: Load, without: Sequence[str] = ()) -> "Mechanism":
        """Return the same mechanism with other loads.

        Parameters
        ----------
        loads
            Loads to add. Each replaces the load with the same name, if there is one.
        without
            Names of loads to remove.

        Raises
        ------
        ModelError
            If `without` names a load that does not exist, two of the loads have the same
            name, or a load does not fit the mechanism. For example, the mechanism may not
            have the pair on which the load acts.

        Examples
        --------
        >>> import spherekit as sk
        >>> spring = sk.Spring("return", "21", stiffness=2.0, rest=0.5)
        >>> sprung = sk.load("four_bar").with_loads(spring, without=["on_crank"])
        """
        _check_name_list(self.name, "load", [load.name for load in loads])
        load_by_name = {load.name: load for load in self.loads}
        for name in without:
            if name not in load_by_name:
                raise unknown_name_error(self.name, "load", name, load_by_name)
            del load_by_name[name]
        load_by_name |= {load.name: load for load in loads}
        return replace(self, loads=tuple(load_by_name.values()))


def unknown_name_error(
    where: str, what: str, name: str, names: Collection[str]
) -> ModelError:
    """Return the error about a name that does not exist, with a suggestion.

    Parameters
    ----------
    where
        Beginning of the message: the mechanism, and the key in its file.
    what
        The kind of thing that should have the name, such as ``link``.
    name
        The name.
    names
        Names that exist, from which the message suggests some.
    """
    suggestion = choices(name, names, f"{what.capitalize()}s")
    return ModelError(f'{where}: no {what} is named "{name}"{suggestion}')


def _check(mechanism: Mechanism) -> None:
    """Check a mechanism; raise `ModelError` at the first fault.

    Names are checked first, because later checks find links and pairs by their names.
    """
    where = mechanism.name or "mechanism"  # beginning of all messages
    if len(mechanism.links) < 2:
        raise ModelError(f"{where}: a mechanism has at least two links")
    _check_names(where, mechanism)
    for pair in mechanism.pairs:
        _check_pair(f"{where}: pairs.{pair.name}", pair)
    for item in mechanism.inputs:
        check_finite(f"{where}: inputs.{item.pair}", (item.start, item.stop))
    # A named mode (way to assemble the mechanism) has values of R pairs.
    for mode, values in mechanism.modes.items():
        if mode.isdecimal():
            raise ModelError(
                f"{where}: modes.{mode}: numbers are the automatic names of modes; use a "
                "word as the name"
            )
        for name in values:
            if name not in mechanism.angles:
                raise ModelError(
                    f"{where}: modes.{mode}.{name}: is a contact pair; a mode is described "
                    "by angles of R pairs"
                )
    # Messages of the next checks begin with a key of the file, such as `loads.NAME`. The
    # name of the mechanism is put in front of them.
    try:
        for mass in mechanism.masses:
            check_mass(mass)
        for load in mechanism.loads:
            load.check(f"loads.{load.name}", mechanism)
        for limit in mechanism.joint_limits:
            check_joint_limit(limit, mechanism)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from None
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry):
        _check_sizes(where, mechanism, geometry)
        return
    # Any other geometry has axes and values of R pairs in a reference pose.
    for name, value in geometry.values.items():
        check_finite(f"{where}: pairs.{name}.value", [value])
    for pair in mechanism.pairs:
        if pair.kind.has_axis and pair.name not in geometry.axes:
            raise ModelError(
                f"{where}: pairs.{pair.name}: its axis in the reference pose is missing; "
                "give xyz = [x, y, z] or lonlat = [longitude, latitude]"
            )


def _check_names(where: str, mechanism: Mechanism) -> None:
    """Check all names: their characters, that they are unique, and that they exist.

    Parameters
    ----------
    where
        Beginning of messages.
    mechanism
        The mechanism.

    Raises
    ------
    ModelError
        If a name has wrong characters, is used twice, or refers to nothing.
    """
    _check_name_list(where, "link", mechanism.links)
    _check_name_list(where, "pair", [pair.name for pair in mechanism.pairs])
    # Inputs, masses and joint limits have no names of their own, but that of their pair or
    # link. So the advice for two of them with one name is not to rename one.
    advice = "remove one of them"
    _check_name_list(where, "input at pair", mechanism.input_pairs, advice)
    _check_name_list(where, "output", [output.name for output in mechanism.outputs])
    _check_name_list(where, "load", [load.name for load in mechanism.loads])
    mass_links = [mass.link for mass in mechanism.masses]
    _check_name_list(where, "mass of link", mass_links, advice)
    limited_pairs = [limit.pair for limit in mechanism.joint_limits]
    _check_name_list(where, "joint limit of pair", limited_pairs, advice)
    _check_name_list(where, "mode", [*mechanism.modes])

    for reference in _name_references(mechanism):
        if reference.what == "link":
            names = mechanism.links
        else:
            names = tuple(mechanism.pair_number)
        if reference.name not in names:
            raise unknown_name_error(
                f"{where}: {reference.key}",
                what=reference.what,
                name=reference.name,
                names=names,
            )


def _check_name_list(
    where: str,
    what: str,
    names: Iterable[str],
    advice: str = "remove or rename one of them",
) -> None:
    """Check that all names in a list have allowed characters, and that none occurs twice.

    Parameters
    ----------
    where
        Beginning of messages.
    what
        What has the names, for messages such as 'link "crank" is given twice'.
    names
        The names.
    advice
        What to do if a name occurs twice.

    Raises
    ------
    ModelError
        If a name has wrong characters, or is used twice.
    """
    for name, times in Counter(names).items():
        if not NAME_PATTERN.fullmatch(name) or len(name) > MAX_NAME_LENGTH:
            raise ModelError(
                f"{where}: {what} {name[:80]!r}: use 1 to {MAX_NAME_LENGTH} letters "
                "(A-Z, a-z), digits and underscores as a name"
            )
        if times > 1:
            raise ModelError(f'{where}: {what} "{name}" is given twice; {advice}')


class _NameReference(NamedTuple):
    """A place at which a mechanism refers to a link or a pair by its name.

    The mechanism checks that the link or pair exists. Messages give the key.

    Attributes
    ----------
    what
        Whether it is the name of a link or of a pair.
    key
        Key in the mechanism file, such as "loads.spring.pair".
    name
        The name.
    """

    what: Literal["link", "pair"]
    key: str
    name: str


_REFERENCE_OF_FIELD_KIND: Mapping[str, Literal["link", "pair"]] = {
    "link": "link",
    "links": "link",
    "pair": "pair",
    "contact": "pair",
}
"""Whether fields with names contain those of links or of pairs, by `field_kinds`."""


def _name_references(mechanism: Mechanism) -> Iterator[_NameReference]:
    """Yield all places at which a mechanism refers to a link or a pair by its name.

    The caller checks that each such name exists. For example, a spring at pair 21 refers to
    this pair. If "spring" is the name of the load, the key in the mechanism file is
    "loads.spring.pair".
    """
    yield _NameReference("link", "ground", mechanism.ground)
    for table, parts in (
        ("pairs", mechanism.pairs),
        ("outputs", mechanism.outputs),
        ("mass", mechanism.masses),
        ("loads", mechanism.loads),
        ("inputs", mechanism.inputs),
        ("joint_limits", mechanism.joint_limits),
    ):
        for part in parts:
            # The kind of a field says what the field contains. Fields of the kinds "link",
            # "links", "pair" and "contact" contain names of links or pairs.
            for field_name, field_kind in field_kinds(part).items():
                if field_kind not in _REFERENCE_OF_FIELD_KIND:
                    continue
                # The field contains one name, or a tuple with the names of both links of a
                # pair.
                value = getattr(part, field_name)
                names = (value,) if isinstance(value, str) else value
                for name in names:
                    # In files, a part without a name (mass, input, joint limit) has the
                    # name of its link or pair as key.
                    part_key = (
                        f"{part.name}.{field_name}" if hasattr(part, "name") else name
                    )
                    yield _NameReference(
                        what=_REFERENCE_OF_FIELD_KIND[field_kind],
                        key=f"{table}.{part_key}",
                        name=name,
                    )
    for mode, values in mechanism.modes.items():
        for pair in values:
            yield _NameReference("pair", f"modes.{mode}", pair)
    # The geometry has numbers by name of their link or pair.
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry):
        for link in geometry.links:
            yield _NameReference("link", "links", link)
        for pair in geometry.zeros:
            yield _NameReference("pair", "pairs", pair)
    else:
        for pair in (*geometry.axes, *geometry.values):
            yield _NameReference("pair", "pairs", pair)


def _check_pair(where: str, pair: Pair) -> None:
    """Check the type, profiles, contact data and links of a pair (joint).

    Parameters
    ----------
    where
        Beginning of messages.
    pair
        The pair.

    Raises
    ------
    ModelError
        If a pair with these data is impossible.
    """
    if pair.type not in JOINT_KINDS:
        raise ModelError(
            f'{where}: type "{pair.type}" is not one of {listing(JOINT_KINDS)}'
        )
    # Contacts have profiles. R pairs have an axis and no profiles.
    if (pair.profiles is None) != pair.kind.has_axis:
        raise ModelError(
            f"{where}: a contact pair (Cr, Cs) has a profile for each of its links, an R "
            "pair has none"
        )
    if pair.distance is not None and not 0.0 < pair.distance < math.inf:
        raise ModelError(
            f"{where}.distance: found {pair.distance}, expected more than 0 m; it is the "
            "distance from the centre at which the contact force acts"
        )
    pressure_angle = pair.pressure_angle
    if pressure_angle is not None and not (
        pair.rolls and 0.0 <= pressure_angle < math.pi / 2
    ):
        raise ModelError(
            f"{where}.pressure_angle: found {pressure_angle:g} rad in a pair of type "
            f"{pair.type}; a pressure angle belongs to a rolling contact (Cr), and must be "
            "at least 0 and less than a right angle"
        )
    if pair.links[0] == pair.links[1]:
        raise ModelError(
            f'{where}: joins link "{pair.links[0]}" to itself; a pair joins two different '
            "links"
        )


def _check_sizes(where: str, mechanism: Mechanism, geometry: SizeGeometry) -> None:
    """Check that the arcs, angles and zeros of a mechanism fit its pairs.

    Arcs and angles locate the axes of pairs (joints) in their links. The variable of an R
    pair (hinge) is the angle between its two links minus a constant (rad), its zero.

    Parameters
    ----------
    where
        Beginning of messages.
    mechanism
        The mechanism, for its links and pairs.
    geometry
        The sizes: arcs and angles of links, and zeros.

    Raises
    ------
    ModelError
        If sizes are missing, superfluous or impossible.
    """
    for name, zero in geometry.zeros.items():
        check_finite(f"{where}: pairs.{name}.zero", [zero])
    for link in mechanism.links:
        # The axes of a link must be those of its R pairs, and those that the file declares
        # to have no pair.
        r_pairs = [
            pair.name
            for pair in mechanism.pairs
            if pair.kind.has_axis and link in pair.links
        ]
        sizes = geometry.links.get(link, LinkSizes(()))
        key = f"{where}: links.{link}"
        if sorted(sizes.axes) != sorted([*r_pairs, *sizes.unpaired]):
            raise ModelError(
                f"{key}.axes: has [{listing(sizes.axes)}], but the R pairs on this link "
                f"are [{listing(r_pairs)}]; "
                f"{_advise_on_axes(link, mechanism, geometry, r_pairs)}"
            )
        # Arcs are from 0 to pi, or any finite number if the link allows signed arcs.
        for index, arc in enumerate(sizes.arcs):
            may_be_signed = sizes.signed and math.isfinite(arc)
            if not (0.0 <= arc <= math.pi or may_be_signed):
                raise ModelError(f"{key}.arcs[{index}]: {_describe_wrong_arc(arc)}")
        check_finite(f"{key}.angles", sizes.angles)
        # The first axis has no arc, and the first two axes have no angle.
        for kind, axes_without, what in (
            ("arcs", 1, "the arcs from the first axis to each of the others"),
            ("angles", 2, "at the first axis, from the first arc to each further arc"),
        ):
            count = len(getattr(sizes, kind))
            needed = max(len(sizes.axes) - axes_without, 0)
            if count != needed:
                raise ModelError(
                    f"{key}.{kind}: has {counted(count, 'value')}, expected {needed}: "
                    f"{what}"
                )


def _advise_on_axes(
    link: str, mechanism: Mechanism, geometry: SizeGeometry, r_pairs: Sequence[str]
) -> str:
    """Return advice for the user if the axes of a link are not those of its R pairs.

    Each axis of a link should have the name of an R pair (hinge) on this link. Axes
    that the file declares as unpaired need no pair. There are several faults: the pair does
    not exist or is on another link, or the list of axes lacks an axis or has it twice. A
    missing pair probably joins the links that list its axis.

    Parameters
    ----------
    link
        The link whose list of axes does not fit.
    mechanism, geometry
        The mechanism, and its sizes.
    r_pairs
        Names of the R pairs on the link.
    """
    axes = geometry.links.get(link, LinkSizes(())).axes
    unpaired_axes = geometry.links.get(link, LinkSizes(())).unpaired
    existing_pairs = {pair.name for pair in mechanism.pairs}
    missing_axes = [pair for pair in r_pairs if pair not in axes]
    for axis in axes:
        if axis in r_pairs or axis in unpaired_axes:
            continue
        if axis in existing_pairs:
            return (
                f'"{axis}" is not an R pair on this link; correct the links of pair '
                f'"{axis}", or remove the axis'
            )
        # A suggestion is "; did you mean ...?", or an empty text.
        suggestion = nearest(axis, missing_axes)
        if suggestion:
            return f'there is no pair "{axis}"{suggestion}'
        joined_links = [
            name
            for name in mechanism.links
            if axis in geometry.links.get(name, LinkSizes(())).axes
        ]
        names = ", ".join(f'"{name}"' for name in joined_links)
        advice_on_axis = (
            f"or replace {axis} by {missing_axes[0]} in the axes"
            if len(missing_axes) == 1
            else f"or remove {axis} from the axes"
        )
        if len(joined_links) == 2:
            return (
                f'there is no pair "{axis}": add [pairs.{axis}] with type = "R" and '
                f"links = [{names}], or remove {axis} from the axes of these two links"
            )
        return (
            f'there is no pair "{axis}": add [pairs.{axis}] with type = "R" and the two '
            f"links that it joins, {advice_on_axis}"
        )
    if missing_axes:
        return f"add {listing(missing_axes)} to the axes, or correct the links of the pairs"
    return "list each of them once"


def _describe_wrong_arc(arc: float) -> str:
    """Return what is wrong with an arc (rad) that is not between 0 and 180 degrees."""
    if not math.isfinite(arc):
        return f"found {arc}, expected a finite number"
    degrees = math.degrees(arc)
    if not math.isfinite(degrees):
        return f"found {arc:.6g} rad; an arc between two axes is between 0 and pi"
    return (
        f"found {degrees:.6g} deg ({arc:.6g} rad); an arc between two axes is between 0 "
        "and 180 deg. Measured the shorter way, the two axes are "
        f"{abs(math.remainder(degrees, 360)):.6g} deg apart; to allow arcs below 0 and "
        "above 180 deg, set signed_arcs = true in the link"
    )
