"""The one description of a spherical mechanism: links, pairs, sizes, loads.

Which output of a mechanism is meant.
"""

import math
import sys
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.conventions import MAX_NAME_LENGTH, NAME_PATTERN, Names
from spherekit.errors import ModelError
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
from spherekit.mechanism.joint import KINDS
from spherekit.mechanism.load import Load
from spherekit.mechanism.load_kinds import JointLimit, check_stop
from spherekit.mechanism.sizes import (
    AngleUnit,
    Sizes,
    as_float_rows,
    check_finite,
    to_radians,
    unit_vector_along,
)
from spherekit.wording import choices, counted, listing

ONE_TURN_RAD = 2.0 * math.pi
"""Range of an input that is driven without a range."""

_HOLDS: Mapping[type, Mapping[str, str]] = {
    Pair: {"links": "links", "profiles": "profiles"},
    Input: {"pair": "pair"},
    Output: {"link": "link", "relative_to": "link", "direction": "vector"},
    Mass: {"link": "link", "tensor": "tensor", "centre": "vector"},
    JointLimit: {"pair": "pair"},
}


def holds(part: Any) -> Mapping[str, str]:
    """Return what fields of a pair, input, output, mass, load or limit hold.

    That is said as in `Load.keys`; of those that hold numbers and words alone, nothing.
    """
    return part.keys if isinstance(part, Load) else _HOLDS[type(part)]


@dataclass(frozen=True)
class Mechanism:
    """A spherical mechanism as a graph of links and pairs with its geometry.

    Frozen and complete: everything else is computed from it. The ground is always
    `links[0]`; link and pair numbers used elsewhere are positions in `links` and
    `pairs`.

    Raises
    ------
    ModelError
        If names repeat or are unknown, or the geometry does not fit the pairs.

    Notes
    -----
    A mechanism that is made without inputs is driven at its first R pair, through one turn.
    `inputs` is therefore empty only where there is no R pair.

    `modes` name assembly modes by the variables (rad) of some R pairs in a configuration
    of theirs, those of all inputs among them.
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

    def __post_init__(self) -> None:
        links = sorted(self.links, key=lambda name: name != self.ground)
        object.__setattr__(self, "links", tuple(links))
        _check(self)
        if not self.inputs:
            # The default is filled in here and nowhere else, so that every analysis and
            # every part of a mechanism has the same input.
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
        """All but where it comes from and the user's data; equal where these are."""
        with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
            return repr([getattr(self, part.name) for part in fields(self)[:-2]])

    @property
    def input_pairs(self) -> Names:
        """Names of the driven pairs, in the order of `inputs`."""
        return tuple(item.pair for item in self.inputs)

    def names_of(self, pairs: Iterable[int]) -> list[str]:
        """Return the names of pairs by their numbers."""
        return [self.pairs[pair].name for pair in pairs]

    @cached_property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """The two link numbers of every pair, in the order of `pairs`."""
        number = self.link_number
        return tuple((number[a], number[b]) for a, b in (p.links for p in self.pairs))

    @cached_property
    def variable_owners(self) -> tuple[int, ...]:
        """The pair number of every variable: R and Cr pairs have one, Cs pairs two."""
        return tuple(
            number
            for number, pair in enumerate(self.pairs)
            for _ in range(pair.kind.variable_count)
        )

    @cached_property
    def variable_names(self) -> Names:
        """``theta_PAIR`` (R), ``s_PAIR`` (Cr), ``s_PAIR_LINK`` for both links (Cs)."""
        return tuple(
            name
            for pair in self.pairs
            for name in pair.kind.variable_names(pair.name, pair.links)
        )

    @cached_property
    def angles(self) -> Mapping[str, int]:
        """The numbers of the variables that are angles about fixed axes, by R pair."""
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
        """The pairs whose axis or contact line is a pole, by its links, smaller first."""
        return {
            (min(ends), max(ends)): number
            for number, (pair, ends) in enumerate(zip(self.pairs, self.ends, strict=True))
            if pair.kind.pole_line is not None
        }

    def angle_between(self, one: int, other: int) -> int | None:
        """Return the number of the angle of the first R pair of two links, if any."""
        for name, variable in self.angles.items():
            if set(self.ends[self.pair_number[name]]) == {one, other}:
                return variable
        return None

    def variables_of(self, pair: int) -> tuple[int, ...]:
        """Return the numbers of a pair's variables."""
        return tuple(n for n, owner in enumerate(self.variable_owners) if owner == pair)

    def pair(self, name: str) -> Pair:
        """Return the pair of this name; `ModelError` with the nearest match if none."""
        if name not in self.pair_number:
            raise not_named(self.name, "pair", name, self.pair_number)
        return self.pairs[self.pair_number[name]]

    def link(self, name: str) -> int:
        """Return the number of the link of this name; `ModelError` as of `pair`."""
        if name not in self.link_number:
            raise not_named(self.name, "link", name, self.links)
        return self.link_number[name]

    def _repr_html_(self) -> str:
        """Return its pairs with their links, and what else it has, as HTML."""
        inputs = self.input_pairs
        rows = [
            [pair.name, pair.type, *pair.links, "input" * (pair.name in inputs)]
            for pair in self.pairs
        ]
        return html_table(["pair", "type", "link", "link", ""], rows, repr(self)[1:-1])

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
            "joint limits of": [stop.pair for stop in self.joint_limits],
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
        """Return the same mechanism driven at these pairs.

        Pairs that are not input yet get a range of one turn, unless `ranges` has the first
        and the last value of their variable, in `angle_unit`. Without `pairs` the inputs
        stay, and only ranges change. Names of modes are those of the inputs they had.

        Raises
        ------
        ModelError
            If there is no such pair, or a range has no unit.

        Examples
        --------
        >>> import spherekit as sk
        >>> driven = sk.load("four_bar").with_inputs("41")
        >>> half = driven.with_inputs(ranges={"41": (0, 90)}, angle_unit="deg")
        """
        driven = {item.pair: item for item in self.inputs if not item.is_default}
        before, names = set(driven), pairs or self.input_pairs
        if ranges and angle_unit is None:
            raise ModelError('with_inputs: ranges need angle_unit="deg" or "rad"')
        for name, (start, stop) in (ranges or {}).items():
            if self.pair(name).name not in names:
                raise ModelError(
                    f"with_inputs: ranges: {name} is not an input; inputs: {listing(names)}"
                )
            driven[name] = Input(
                name, to_radians(start, angle_unit), to_radians(stop, angle_unit)
            )
        whole = (Input(self.pair(name).name, 0.0, ONE_TURN_RAD) for name in names)
        made = tuple(driven.get(item.pair, item) for item in whole)
        if before and made == self.inputs:
            return self
        as_named = before in (set(), set(names))
        return replace(self, inputs=made, modes=self.modes if as_named else {})

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
        """Return the same mechanism with other sizes, as its file states them.

        Parameters
        ----------
        angle_unit
            Unit of all angles given, ``"deg"`` or ``"rad"``.
        arcs, angles
            By link: a number where it has one only, all of them, or some of them by the
            pair that they lead to, as in ``{"3": {"43": 70.0}}``.
        zeros
            By pair: the angle at which its variable reads zero.
        axes, values
            Of one in a reference pose, by pair: its axis (3,), of any length, its variable.

        Raises
        ------
        ModelError
            If a link or pair is unknown, sizes are impossible, or of the other form.

        Examples
        --------
        >>> import spherekit as sk
        >>> longer = sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": 25.0})
        """
        geometry = self.geometry
        form = "axes and values in a pose"
        other: Mapping[str, Any] = {"arcs": arcs, "angles": angles, "zeros": zeros}
        if isinstance(geometry, SizeGeometry):
            form, other = "arcs, angles and zeros", {"axes": axes, "values": values}
        for key in [key for key, given in other.items() if given is not None]:
            raise ModelError(
                f"{self.name}: with_sizes: {key} belongs to the other form of geometry; "
                f"this mechanism is given by {form}"
            )
        if isinstance(geometry, SizeGeometry):
            links = dict(geometry.links)
            for kind, of_links in (("arcs", arcs), ("angles", angles)):
                for link, sizes in (of_links or {}).items():
                    where = f"{self.name}: links.{link}.{kind}"
                    old = links.get(self.links[self.link(link)], LinkSizes(()))
                    links[link] = resize_link(where, old, kind, sizes, angle_unit)
            zeros = {**geometry.zeros, **self._by_pair(zeros, angle_unit)}
            return replace(self, geometry=SizeGeometry(links, zeros))
        turned = {
            self.pair(name).name: unit_vector_along(f"{self.name}: pairs.{name}", axis)
            for name, axis in (axes or {}).items()
        }
        values = {**geometry.values, **self._by_pair(values, angle_unit)}
        return replace(self, geometry=PoseGeometry({**geometry.axes, **turned}, values))

    def _by_pair(self, given: Angles | None, unit: AngleUnit) -> dict[str, float]:
        """Return angles in rad by the names of pairs, which are looked up."""
        return {self.pair(n).name: to_radians(x, unit) for n, x in (given or {}).items()}

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
            Its name.
        tensor
            (3, 3) kg m2 about the centre of the sphere, in link axes; None takes the
            inertia of the link away.
        mass, centre
            kg, and the centre of mass (3,) in m in link axes: gravity needs them.

        Raises
        ------
        ModelError
            If there is no such link, or no body has such an inertia.

        Examples
        --------
        >>> import spherekit as sk
        >>> heavier = sk.load("four_bar").with_mass("4", [[4, 0, 0], [0, 4, 0], [0, 0, 1]])
        """
        self.link(link)
        masses = {item.link: item for item in self.masses}
        if tensor is None:
            masses.pop(link, None)
        else:
            where = f"{self.name}: mass.{link}"
            rows = as_float_rows(f"{where}.tensor", tensor, (3, 3))
            place = (
                None if centre is None else as_float_rows(f"{where}.centre", centre, (3,))
            )
            masses[link] = Mass(link, rows, mass, place)
        return replace(self, masses=tuple(masses.values()))

    @checked(ModelError)
    def with_loads(self, *loads: Load, without: Sequence[str] = ()) -> "Mechanism":
        """Return the same mechanism with other loads, by their names.

        Each of `loads` takes the place of the one that has its name, or comes to those
        that there are; those named in `without` go.

        Raises
        ------
        ModelError
            If there is no load of a name in `without`, or a load is not meaningful.

        Examples
        --------
        >>> import spherekit as sk
        >>> spring = sk.Spring("return", "21", stiffness=2.0, rest=0.5)
        >>> sprung = sk.load("four_bar").with_loads(spring, without=["on_crank"])
        """
        kept = {load.name: load for load in self.loads}
        for name in without:
            if name not in kept:
                raise not_named(self.name, "load", name, kept)
            del kept[name]
        kept |= {load.name: load for load in loads}
        return replace(self, loads=tuple(kept.values()))


def not_named(where: str, what: str, name: str, names: Collection[str]) -> ModelError:
    """Return the error of a name that no link, pair or load has."""
    said = choices(name, names, f"{what.capitalize()}s")
    return ModelError(f'{where}: no {what} is named "{name}"{said}')


def _check(mechanism: Mechanism) -> None:
    """Raise `ModelError` where names or geometry of a mechanism do not fit each other."""
    where = mechanism.name or "mechanism"
    if len(mechanism.links) < 2:
        raise ModelError(f"{where}: a mechanism has at least two links")
    _check_names(where, mechanism)
    for pair in mechanism.pairs:
        _check_pair(f"{where}: pairs.{pair.name}", pair)
    for mode, values in mechanism.modes.items():
        if mode.isdecimal():
            raise ModelError(
                f"{where}: modes.{mode}: a number is that of a mode; name it by a word"
            )
        for name in values:
            if name not in mechanism.angles:
                raise ModelError(
                    f"{where}: modes.{mode}.{name}: is a contact pair; a mode is said "
                    "by angles of R pairs"
                )
    try:
        for mass in mechanism.masses:
            check_mass(mass)
        for load in mechanism.loads:
            load.check(f"loads.{load.name}", mechanism)
        for stop in mechanism.joint_limits:
            check_stop(stop, mechanism)
    except ModelError as error:
        raise ModelError(f"{where}: {error}") from None
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry):
        _check_sizes(where, mechanism, geometry)
        return
    for name, value in geometry.values.items():
        check_finite(f"{where}: pairs.{name}.value", [value])
    for pair in mechanism.pairs:
        if pair.kind.has_axis and pair.name not in geometry.axes:
            raise ModelError(
                f"{where}: pairs.{pair.name}: its axis in the reference pose is missing; "
                "give xyz = [x, y, z] or lonlat = [longitude, latitude]"
            )


def _check_names(where: str, mechanism: Mechanism) -> None:
    """Refuse names that cannot be one, are given twice, or that nothing has."""
    for what, names in (
        ("link", mechanism.links),
        ("pair", [pair.name for pair in mechanism.pairs]),
        ("input at a", mechanism.input_pairs),
        ("output", [output.name for output in mechanism.outputs]),
        ("load", [load.name for load in mechanism.loads]),
        ("mass of a", [mass.link for mass in mechanism.masses]),
        ("joint limit of a", [stop.pair for stop in mechanism.joint_limits]),
        ("mode", [*mechanism.modes]),
    ):
        for name, times in Counter(names).items():
            if not NAME_PATTERN.fullmatch(name) or len(name) > MAX_NAME_LENGTH:
                raise ModelError(
                    f"{where}: {what} name {name[:80]!r}: use 1 to {MAX_NAME_LENGTH} "
                    "letters (A-Z, a-z), digits and underscores"
                )
            if times > 1:
                raise ModelError(
                    f'{where}: {what} "{name}" is given twice; names are unique'
                )
    for what, key, name in _named(mechanism):
        names = mechanism.links if what == "link" else [*mechanism.pair_number]
        if name not in names:
            raise not_named(f"{where}: {key}", what, name, names)


def _named(mechanism: Mechanism) -> Iterator[tuple[str, str, str]]:
    """Yield what a mechanism names: a link or a pair, the key that does, and the name."""
    yield "link", "ground", mechanism.ground
    whose = {"link": "link", "links": "link", "pair": "pair", "contact": "pair"}
    for table, parts in (
        ("pairs", mechanism.pairs),
        ("outputs", mechanism.outputs),
        ("mass", mechanism.masses),
        ("loads", mechanism.loads),
        ("inputs", mechanism.inputs),
        ("joint_limits", mechanism.joint_limits),
    ):
        for part in parts:
            for key, form in holds(part).items():
                said = getattr(part, key) if form in whose else ()
                for name in (said,) if isinstance(said, str) else said:
                    of = f"{part.name}.{key}" if hasattr(part, "name") else name
                    yield whose[form], f"{table}.{of}", name
    for mode, values in mechanism.modes.items():
        yield from (("pair", f"modes.{mode}", pair) for pair in values)
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry):
        yield from (("link", "links", link) for link in geometry.links)
        yield from (("pair", "pairs", pair) for pair in geometry.zeros)
    else:
        yield from (("pair", "pairs", x) for x in (*geometry.axes, *geometry.values))


def _check_pair(where: str, pair: Pair) -> None:
    """Refuse a pair that cannot be one."""
    if pair.type not in KINDS:
        raise ModelError(f'{where}: type "{pair.type}" is not one of {listing(KINDS)}')
    if (pair.profiles is None) != pair.kind.has_axis:
        raise ModelError(
            f"{where}: a contact pair (Cr, Cs) has a profile for each of its links, an R "
            "pair has none"
        )
    if pair.distance is not None and not 0.0 < pair.distance < math.inf:
        raise ModelError(
            f"{where}.distance: found {pair.distance}, needs more than 0 m: how far from "
            "the centre the contact force acts"
        )
    teeth = pair.pressure_angle
    if teeth is not None and not (pair.rolls and 0.0 <= teeth < math.pi / 2):
        raise ModelError(
            f"{where}.pressure_angle: found {teeth:g} rad in a {pair.type} pair, needs a "
            "rolling contact (Cr) and at least 0, less than a right angle"
        )
    if pair.links[0] == pair.links[1]:
        raise ModelError(
            f'{where}: joins link "{pair.links[0]}" to itself; a pair joins two different '
            "links"
        )


def _check_sizes(where: str, mechanism: Mechanism, geometry: SizeGeometry) -> None:
    for name, zero in geometry.zeros.items():
        check_finite(f"{where}: pairs.{name}.zero", [zero])
    for link in mechanism.links:
        expected = [x.name for x in mechanism.pairs if x.kind.has_axis and link in x.links]
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
        check_finite(f"{key}.angles", sizes.angles)
        for kind, fewer, what in (
            ("arcs", 1, "the arcs from the first axis to each of the others"),
            ("angles", 2, "at the first axis, from the first arc to each further arc"),
        ):
            has, needs = len(getattr(sizes, kind)), max(len(sizes.axes) - fewer, 0)
            if has != needs:
                raise ModelError(
                    f"{key}.{kind}: has {counted(has, 'value')}, needs {needs}: {what}"
                )


def _no_arc(arc: float) -> str:
    """Return what to say of an arc (rad) that is none between two axes."""
    if not math.isfinite(arc):
        return f"found {arc}, needs a finite number"
    degrees = math.degrees(arc)
    return (
        f"found {degrees:.6g} deg ({arc:.6g} rad); an arc between two axes is between 0 "
        f"and 180 deg. This one leads to an axis {abs(math.remainder(degrees, 360)):.6g} "
        "deg away, perhaps on the other side of the first; if that is meant, say "
        "signed_arcs = true in the link"
    )


def chosen_output(mechanism: Mechanism, name: str | None = None) -> Output:
    """Return the declared output of this name, or the only one.

    Raises
    ------
    ModelError
        If there is none, or there are several and no name is given.
    """
    outputs = {output.name: output for output in mechanism.outputs}
    if name is None and len(outputs) == 1:
        return mechanism.outputs[0]
    if not outputs:
        raise ModelError(
            f"{mechanism.name}: no output is declared; declare one in the file as "
            "[outputs.NAME] with its link, and for a pointing output axis or xyz"
        )
    if name is None:
        raise ModelError(
            f"{mechanism.name}: there are several outputs, {listing(outputs)}; say which "
            "is meant"
        )
    if name not in outputs:
        raise not_named(mechanism.name, "output", name, outputs)
    return outputs[name]
