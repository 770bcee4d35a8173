"""Trains of wheels as balls: angles that follow from the inputs through rolling circles.

Where the relations of all rolling contacts (`planning.gear_train`) fix the angles that
they relate by the inputs, the pairs are known like inputs. A wheel repeats what its carrier
says of the distance of the axes; decimal numbers can say both only nearly, so that
circles that touch nearly are taken to touch.

The geometry of a mechanism as balls around the numbers of its file as they are written.

An angle of 45.1 degrees is 45.1 pi / 180 here, and no float64 number next to it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from spherekit.arrays import Array
from spherekit.errors import PlanError
from spherekit.files.mechanism_reader import read
from spherekit.files.mechanism_writer import dumps
from spherekit.files.toml_document import Document, LiteralNumber, parse
from spherekit.mechanism.bevel_gears import find_gear_carrier
from spherekit.mechanism.coaxial_links import SAME_AXIS_RAD
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.planning.gear_mesh import (
    GearMesh,
    PairPath,
    find_carried_contact,
    reverse_path,
)
from spherekit.planning.gear_train import find_gear_train
from spherekit.proof.ball_frames import (
    Frame,
    Frames,
    Vector,
    axes_about,
    exact,
    exactly,
    frames_of_pose,
    frames_of_sizes,
    unit,
)
from spherekit.proof.balls import (
    Ball,
    angle_of,
    floats,
    library,
    lower,
    middle,
    pi,
    solved,
    upper,
    wide,
)
from spherekit.proof.structure import Structure, structure_of
from spherekit.wording import listing


@dataclass(frozen=True)
class Touching:
    """Two circles that touch, each in the axes of its link.

    `axes` of each have the directions of azimuth 0 and 90 degrees about the centre, and
    the centre, or the pole of a great circle; `radii` are angles, and `sines` in the ratio
    of theirs. `sense` is 1 for circles one within the other and -1 beside each other: how
    the arc length runs about the second centre.
    """

    axes: Sequence[Frame]
    radii: Sequence[Ball]
    sines: Sequence[Ball]
    sense: int

    @property
    def arc(self) -> Ball:
        """The signed arc from the first centre over the contact on to the second."""
        return self.radii[0] - self.sense * self.radii[1]

    def towards(self, first: Vector, second: Vector) -> tuple[Vector, Vector]:
        """Return the directions of the contact at both centres, where these are."""
        sine, cosine = self.arc.sin_cos()
        return (second - cosine * first) / sine, self.sense * (
            cosine * second - first
        ) / sine


SAME_TURN = 1e-6
"""Numbers of turns are one if the train of the plan is so near to it."""
AXES = {"through_xyz", "through_lonlat", "xyz", "lonlat"}
"""Keys of pairs in files that say where their axis is."""
MOST_TEETH = 10**6
"""Largest denominator of ratios of teeth."""
PHASE = 1e-13
"""A start that the reader finds of a phase is known to this (rad)."""


@dataclass(frozen=True)
class Written:
    """A mechanism with the text of its file, and by how much its sizes may be off.

    `tolerance` (rad) is that of every arc, angle, zero and direction of the file.
    `structure` are the links and R pairs that it stands for, `meshes` its wheels in mesh
    and `lengths` about those that they have rolled where all angles are zero.
    """

    mechanism: Mechanism
    document: Document
    tolerance: float
    structure: Structure
    meshes: Sequence[GearMesh] = ()
    lengths: Sequence[Sequence[float]] = ()

    @staticmethod
    def of(
        mechanism: Mechanism, document: Document | None = None, tolerance: float = 0.0
    ) -> "Written":
        """Return a mechanism with its document, by default the one it is written as.

        Raises
        ------
        PlanError
            If it has contacts that are not of circles, or circles that roll by what does
            not follow from the inputs, or the tolerance is negative.
        """
        structure = structure_of(mechanism)
        if not 0.0 <= tolerance < 0.1:
            raise PlanError(
                f"a tolerance of {tolerance} rad makes no sense; give 1e-9, say"
            )
        if document is None:
            document = parse(dumps(mechanism), mechanism.name)
            assert read(document) == mechanism or mechanism.user
        made = Written(mechanism, document, tolerance, structure)
        return made._in_mesh() if structure.wheels else made

    @property
    def in_degrees(self) -> bool:
        """Whether angles of the file are in degrees, not in radians."""
        return bool(self.document.data["angle_unit"] == "deg")

    def frames(self) -> list[tuple[Frame, Frame]]:
        """Return the frames of every pair of the structure in its two links."""
        made = self.r_frames()
        frames = [made[name] for name in self.structure.pairs if name in made]
        for contact in self.structure.couplers:
            touch = self._touching(contact)
            # the angle of each pair is the azimuth of the contact about the centre
            sine, cosine = touch.arc.sin_cos()
            axes = exactly([0.0, 0.0, 1.0]), np.array([exact(0.0), sine, cosine])
            for to, axis, ahead in zip(touch.axes, axes, touch.towards(*axes), strict=True):
                frames.append((to, np.stack([ahead, np.cross(axis, ahead), axis])))
        return frames

    def given(self, inputs: Sequence[Ball]) -> list[Ball]:
        """Return the angles (rad) of the inputs and of all pairs that follow from them."""
        if not self.meshes:
            return [*inputs]
        structure, rows = self.structure, self._relations()
        if isinstance(self.mechanism.geometry, PoseGeometry):
            # nothing has rolled in the reference pose
            values = self._angles("value")
            constants = rows @ [values.get(pair, exact(0.0)) for pair in structure.pairs]
        else:
            constants = self._rolled() @ exactly([1.0, -1.0])
        right = constants - rows[:, structure.inputs] @ np.array(inputs)
        return [*inputs, *self._followed(rows, right[:, None])[:, 0]]

    def ratios(self) -> Array:
        """Return the rates (followers, inputs) of the angles that wheels fix."""
        rows = self._relations()
        return self._followed(rows, -rows[:, self.structure.inputs])

    def exact_ratios(self) -> list[Fraction] | None:
        """Return the rates of followers by the only input, None unless all have teeth.

        They are ratios of determinants of teeth, and balls of 80 bits have just one such.
        """
        if not all(factor.is_exact() for factor in self._relations().flat):
            return None
        made = []
        for (ball,) in self.ratios():
            ratio = Fraction(middle(ball)).limit_denominator(MOST_TEETH)
            if not (ball * ratio.denominator).contains(ratio.numerator):
                return None
            made.append(ratio)
        return made

    def _followed(self, rows: Array, right: Array) -> Array:
        """Return the angles that follow, or their rates, from the columns of `right`."""
        return solved(rows[:, self.structure.followers], right)

    def _relations(self) -> Array:
        """Return the factors (meshes, pairs) of sums of angles that stay the same."""
        rows = exactly(np.zeros((len(self.meshes), len(self.structure.pairs))))
        for row, mesh in zip(rows, self.meshes, strict=True):
            one, other = self._touching(mesh.contact).sines
            for pair, factor in mesh.angle_factors((one, -other)).items():
                row[self._number(pair)] = factor
        return rows

    def _rolled(self) -> Array:
        """Return the lengths (meshes, 2) rolled along circles with all angles zero.

        It is the sine of the radius times the azimuth of the contact, less where it starts;
        in teeth, if these are given.
        """
        frames, rolled = self.frames(), list[Array]()

        def along(vector: Vector, way: PairPath) -> Vector:
            """Return a vector of the first link of a way in the last, all angles zero."""
            for pair, side in way:
                ends = frames[self._number(pair)]
                vector = ends[1 - side].T @ (ends[side] @ vector)
            return vector

        for mesh, near in zip(self.meshes, self.lengths, strict=True):
            touch = self._touching(mesh.contact)
            sines, centres = np.array(touch.sines), [axes[2] for axes in touch.axes]
            ahead = touch.towards(*map(along, centres, mesh.paths))
            azimuths = [
                angle_of(*(axes[:2] @ along(direction, reverse_path(way))))
                for axes, way, direction in zip(touch.axes, mesh.paths, ahead, strict=True)
            ]
            scales = sines / [radius.sin() for radius in touch.radii]
            starts = scales * self._starts(mesh.contact)
            length = sines * azimuths * (1, touch.sense) - starts
            lap = 2 * pi() * sines
            away = (scales * near - length) / lap
            turns = np.round(floats(away))
            for miss in away - turns:
                if not (lower(miss) < SAME_TURN and upper(miss) < 0.25):
                    raise PlanError(
                        f"{self.structure.name}: the sizes leave open how many turns "
                        "wheels have rolled"
                    )
            rolled.append(length + lap * turns)
        return np.array(rolled)

    def motion_columns(self) -> list[tuple[str, float]]:
        """Return the column of the table motion and the factor of each pair's angle.

        The angles of couplers are lengths over the sines of radii there.
        """
        columns = [(f"theta_{name}", 1.0) for name in self.structure.pairs]
        for number, contact in enumerate(self.structure.couplers):
            pair, touch = self.mechanism.pairs[contact], self._touching(contact)
            _, both = self.structure.coupler(number)
            names = pair.kind.variable_names(pair.name, pair.links)
            for k, name, sense, radius in zip(
                both, names, (1, touch.sense), touch.radii, strict=True
            ):
                columns[k] = name, sense / middle(radius.sin())
        return columns

    def item(self, pair: str) -> Mapping[str, Any]:
        """Return the table of a pair in the file."""
        table: Mapping[str, Any] = self.document.data["pairs"][pair]
        return table

    def _starts(self, contact: int) -> Array:
        """Return the lengths (2,) rad along both circles at which a contact starts."""
        pair = self.mechanism.pairs[contact]
        item = self.item(pair.name)
        if "phase" in item:
            return np.array([wide(length, PHASE) for length in pair.start])
        return np.array([self.angle(s, False) for s in item.get("start", (0.0, 0.0))])

    def _in_mesh(self) -> "Written":
        """Return the same with its wheels in mesh, put together as the file means.

        Raises
        ------
        PlanError
            If no link carries the wheels of a contact, or the meshes do not fix all angles
            that they relate by the inputs.
        """
        structure, mechanism = self.structure, self.mechanism
        joints, meshes = make_joints(mechanism), list[GearMesh]()
        for contact in structure.wheels:
            held = find_carried_contact(mechanism, joints, contact, SAME_AXIS_RAD)
            if held is None:
                pair = mechanism.pairs[contact]
                raise PlanError(
                    f"{mechanism.name}: pair {pair.name} is a rolling contact, and no link "
                    f"carries {pair.links[0]} and {pair.links[1]} each about the centre of "
                    "its circle so that they touch; of rolling contacts proofs are for "
                    "wheels that a link carries so, and for sliding contacts of circles"
                )
            meshes.append(held.mesh)
        every = {self._number(pair) for mesh in meshes for pair in mesh.pairs}
        followers = tuple(sorted(every - set(structure.inputs)))
        train = find_gear_train(mechanism, driven_pairs(mechanism))
        with suppress(ZeroDivisionError):
            if train is not None and len(followers) == len(meshes):
                made = replace(
                    self,
                    structure=replace(structure, followers=followers),
                    meshes=meshes,
                    lengths=train.rolled.tolist(),
                )
                made.ratios()
                return made
        where = listing(structure.names_of(followers))
        raise PlanError(
            f"{structure.name}: its {len(meshes)} rolling contacts relate the angles "
            f"{where} to the inputs, and do not fix each of them, or in more ways than can "
            "be tried; proofs are for wheels whose turning follows from the inputs alone: "
            "drive another pair, or give a reference pose"
        )

    def _number(self, pair: int) -> int:
        """Return the number in the structure of an R pair of the mechanism."""
        return self.structure.pairs.index(self.mechanism.pairs[pair].name)

    def angle(self, number: float, tolerance: bool = True) -> Ball:
        """Return an angle of the file in rad."""
        turn = pi() / 180 if self.in_degrees else exact(1.0)
        return wide(_number(number) * turn, self.tolerance if tolerance else 0.0)

    def input_angle(self, text: str) -> Ball:
        """Return an input given as a decimal number in the unit of the file, in rad."""
        return self.angle(LiteralNumber(text), tolerance=False)

    def input_range(self, pair: str) -> tuple[str, str]:
        """Return the ends of an input's range as the file has them, the lower first."""
        item = self.document.data.get("inputs", {}).get(pair, {})
        turn = 360 if self.in_degrees else 2 * math.pi
        ends = text_of(item.get("from", 0)), text_of(item.get("to", turn))
        low, high = sorted(ends, key=float)
        return low, high

    def r_frames(self) -> Frames:
        """Return the frames of the R pairs, by name."""
        given = self.mechanism.geometry
        if isinstance(given, PoseGeometry):
            axes = {name: self._axis(self.item(name)) for name in given.axes}
            return frames_of_pose(given, axes, self._angles("value"))
        sizes = {
            link: [
                [self.angle(number) for number in item.get(key, [])]
                for key in ("arcs", "angles")
            ]
            for link, item in self.document.data["links"].items()
            if link in given.links
        }
        return frames_of_sizes(self.mechanism, given, sizes, self._angles("zero"))

    def _angles(self, key: str) -> dict[str, Ball]:
        """Return the angles (rad) that pairs of the file have under a key."""
        return {
            name: self.angle(item[key])
            for name, item in self.document.data["pairs"].items()
            if key in item
        }

    def _axis(self, item: Mapping[str, Any]) -> Vector:
        (key,) = AXES & item.keys()
        if key.startswith("through"):
            one, other = (self._direction(row, key) for row in item[key])
            return unit(np.cross(one, other))
        return self._direction(item[key], key)

    def _direction(self, row: Any, key: str) -> Vector:
        """Return a direction of the file, by coordinates or longitude and latitude."""
        if key.endswith("xyz"):
            along = unit(np.array([_number(number) for number in row]))
            return along + wide(0.0, self.tolerance)
        (s, c), (up, across) = (self.angle(number).sin_cos() for number in row)
        return np.array([c * across, s * across, up])

    def _touching(self, contact: int) -> Touching:
        """Return the circles of a contact."""
        mechanism, frames = self.mechanism, self.r_frames()
        pair = mechanism.pairs[contact]
        item = self.item(pair.name)
        sense = -1 if pair.contact == "external" else 1

        def axis(name: str, link: str) -> Vector:
            return frames[name][mechanism.pair(name).links.index(link)][2]

        if "axes" in item:
            centres = tuple(map(axis, item["axes"], pair.links))
            joined = {name: mechanism.pair(name).links for name in frames}
            gear_carrier = find_gear_carrier(
                joined, link_axes(mechanism), pair.links, item["axes"]
            )
            one, other = (
                shaft.sense * axis(shaft.pair, gear_carrier.link)
                for shaft in gear_carrier.shafts
            )
            radii = self._cones(item, one, other, sense)
        else:
            circles = (self._circle(item, link, axis) for link in pair.links)
            centres, radii = zip(*circles, strict=True)
        sines = map(exact, item["teeth"]) if "teeth" in item else (r.sin() for r in radii)
        return Touching([*map(axes_about, centres)], radii, [*sines], sense)

    def _cones(
        self, item: Mapping[str, Any], one: Vector, other: Vector, sense: int
    ) -> tuple[Ball, Ball]:
        """Return half angles of cones that touch."""
        normal = np.cross(one, other)
        between = angle_of(one @ other, (normal @ normal).sqrt())
        if "teeth" in item:
            s, c = between.sin_cos()
            first = angle_of(exact(item["teeth"][1]) / item["teeth"][0] - sense * c, s)
        else:
            first = self.angle(item["half_angles"][0])
        return first, between + sense * first

    def _circle(
        self, item: Mapping[str, Any], link: str, axis: Callable[[str, str], Vector]
    ) -> tuple[Vector, Ball]:
        """Return centre and radius of the circle of one link."""
        circle = item.get("follower", {})
        if circle.get("link") != link:
            circle = item["profiles"][link]
        if "axis" in circle:
            centre = axis(circle["axis"], link)
        else:
            key = next(key for key in circle if key.startswith(("centre", "pole")))
            centre = self._direction(circle[key], key)
        number = circle.get("roller", circle.get("radius"))
        return centre, pi() / 2 if number is None else self.angle(number)


def text_of(number: float) -> str:
    """Return a number of a file as it is written."""
    return number.text if isinstance(number, LiteralNumber) else str(number)


def _number(number: float) -> Ball:
    """Return a number of a file as it is written."""
    if isinstance(number, LiteralNumber):
        made = library().arb(number.text.replace("_", ""))
        assert made.is_finite()
        return made
    return exact(number)
