"""The circles of contacts as balls around the numbers of the file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, final

from spherekit.model.gears import carrier_of
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Pair
from spherekit.proof.balls import Ball, angle_of, exact, pi
from spherekit.proof.vectors import Frame, Vector, cross, dot, unit


class Sizes(Protocol):
    """The numbers of a file."""

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""

    def item(self, pair: str) -> Mapping[str, Any]:
        """Return the table of a pair."""

    def angle(self, number: float, tolerance: bool = True) -> Ball:
        """Return an angle (rad)."""

    def direction(self, row: Any, is_xyz: bool) -> Vector:
        """Return a direction in link axes."""


@final
@dataclass(frozen=True)
class Circle:
    """A circle in link axes: centre, angular radius, its sine, and where arcs begin.

    `axes` has the directions of azimuth 0 and 90 degrees about the centre, and the centre.
    """

    axes: Frame
    radius: Ball
    sine: Ball

    @property
    def centre(self) -> Vector:
        """The centre, or the pole of a great circle."""
        return self.axes[2]

    def azimuth(self, direction: Vector) -> Ball:
        """Return the azimuth (rad) of a direction at right angles to the centre."""
        ahead, side, _ = self.axes
        return angle_of(dot(direction, ahead), dot(direction, side))


@final
@dataclass(frozen=True)
class Touching:
    """The circles of a contact, and the way from one centre to the other.

    `arc` is the signed arc from the first centre over the contact on to the second, `sense`
    1 for circles one within the other and -1 beside each other: how the arc length runs
    about the second centre.
    """

    circles: tuple[Circle, Circle]
    arc: Ball
    sense: int

    def towards(self, first: Vector, second: Vector) -> tuple[Vector, Vector]:
        """Return the directions of the contact at both centres, where these are."""
        sine, cosine = self.arc.sin_cos()
        ahead = [(b - cosine * a) / sine for a, b in zip(first, second, strict=True)]
        back = [(a - cosine * b) / sine for a, b in zip(first, second, strict=True)]
        if self.sense > 0:
            back = [-entry for entry in back]
        return (ahead[0], ahead[1], ahead[2]), (back[0], back[1], back[2])


def touching(
    sizes: Sizes, pair: Pair, frames: Mapping[str, tuple[Frame, Frame]]
) -> Touching:
    """Return the circles of a contact; `frames` are those of the R pairs."""
    item = sizes.item(pair.name)
    sense = -1 if pair.contact == "external" else 1
    if "axes" in item:
        centres = [
            _axis(sizes.mechanism, frames, name, link)
            for name, link in zip(item["axes"], pair.links, strict=True)
        ]
        first, second, sine, other = _cones(sizes, pair, frames, sense)
        sines = [sine, other]
        radii = [first, second]
    else:
        made = [_given(sizes, item, link, frames) for link in pair.links]
        centres = [centre for centre, _ in made]
        radii = [radius for _, radius in made]
        sines = [radius.sin() for radius in radii]
    circles = [
        Circle(_axes_about(centre), radius, sine)
        for centre, radius, sine in zip(centres, radii, sines, strict=True)
    ]
    arc = radii[0] - sense * radii[1]
    return Touching((circles[0], circles[1]), arc, sense)


def _axis(
    mechanism: Mechanism, frames: Mapping[str, tuple[Frame, Frame]], pair: str, link: str
) -> Vector:
    return frames[pair][mechanism.pair(pair).links.index(link)][2]


def _cones(
    sizes: Sizes, pair: Pair, frames: Mapping[str, tuple[Frame, Frame]], sense: int
) -> tuple[Ball, Ball, Ball, Ball]:
    """Return half angles of cones that touch, and numbers in the ratio of their sines."""
    item, mechanism = sizes.item(pair.name), sizes.mechanism
    joined = {name: mechanism.pair(name).links for name in frames}
    axes = (item["axes"][0], item["axes"][1])
    carrier, carried = carrier_of(mechanism.geometry, joined, pair.links, axes)
    one, other = (
        _turned(_axis(mechanism, frames, name, carrier), sense) for name, sense in carried
    )
    normal = cross(one, other)
    between = angle_of(dot(one, other), dot(normal, normal).sqrt())
    if "teeth" in item:
        teeth = [exact(float(count)) for count in item["teeth"]]
        s, c = between.sin_cos()
        first = angle_of(teeth[1] / teeth[0] - sense * c, s)
        second = between - first if sense < 0 else between + first
        return first, second, teeth[0], teeth[1]
    first = sizes.angle(item["half_angles"][0])
    second = between - first if sense < 0 else between + first
    return first, second, first.sin(), second.sin()


def _turned(axis: Vector, sense: int) -> Vector:
    return axis if sense > 0 else (-axis[0], -axis[1], -axis[2])


def _given(
    sizes: Sizes,
    item: Mapping[str, Any],
    link: str,
    frames: Mapping[str, tuple[Frame, Frame]],
) -> tuple[Vector, Ball]:
    """Return centre and radius of the circle of one link."""
    follower = item.get("follower")
    profile = follower if follower and follower["link"] == link else item["profiles"][link]
    if "axis" in profile:
        centre = _axis(sizes.mechanism, frames, profile["axis"], link)
    else:
        key = next(key for key in profile if key.split("_")[0] in ("centre", "pole"))
        centre = sizes.direction(profile[key], key.endswith("xyz"))
    number = profile.get("roller", profile.get("radius"))
    return centre, pi() / 2 if number is None else sizes.angle(number)


def _axes_about(centre: Vector) -> Frame:
    """Return the axes from which azimuths about a centre are counted."""
    helper = [exact(0.0)] * 3
    helper[1 if abs(float(centre[0].mid())) > 0.9 else 0] = exact(1.0)
    along = dot((helper[0], helper[1], helper[2]), centre)
    first = unit(
        (
            helper[0] - along * centre[0],
            helper[1] - along * centre[1],
            helper[2] - along * centre[2],
        )
    )
    return first, cross(centre, first), centre
