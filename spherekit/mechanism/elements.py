"""What a mechanism is made of: pairs with their profiles, sizes, inputs and outputs."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from spherekit.conventions import Names
from spherekit.errors import ModelError
from spherekit.mechanism.joint import KINDS, Ends, Kind, Links, Numbers, PairType
from spherekit.mechanism.sizes import AngleUnit, Sizes, Vector, in_radians
from spherekit.wording import choices, counted

Angles = Mapping[str, float]
"""Angles (rad) of pairs, by their names."""


def need_rows(
    key: str, name: str, times: Numbers, values: Numbers, least: int, more: str = ""
) -> None:
    """Refuse a table of values at times (s) that do not increase, or too short.

    `key` begins what faults say, `name` is that of the values, `more` says how fewer rows
    than the `least` would do.
    """
    has = len(times)
    if has != len(values):
        rows = counted(len(values), "value")
        raise ModelError(f"{key}{name}: has {rows}, but times has {has}")
    if has < least:
        rows = counted(has, "value")
        raise ModelError(f"{key}times: has {rows}, needs at least {least}{more}")
    for number, (one, other) in enumerate(pairwise(times)):
        if not other > one:
            raise ModelError(
                f"{key}times: must increase, but {other:g} s follows {one:g} s at "
                f"positions {number} and {number + 1}"
            )


def as_vector(numbers: Iterable[float]) -> Vector:
    """Return three numbers as floats."""
    x, y, z = map(float, numbers)
    return x, y, z


ProfileKind = Literal["circle", "great_circle", "points", "fourier"]


@dataclass(frozen=True)
class Profile:
    """The curve on the unit sphere along which a link touches in a contact pair.

    `centre` is a unit vector in link axes: the centre of a circle, the pole of a great
    circle, or the axis from which the colatitude of a Fourier profile is measured.
    `radius` (rad) belongs to a circle. `points` are unit vectors in link axes along a
    smooth curve. A Fourier profile has the colatitude ``sum cosines[k] cos(k a) +
    sines[k] sin(k a)`` (rad) at azimuth `a` about `centre`.
    """

    kind: ProfileKind
    centre: Vector | None = None
    radius: float | None = None
    points: tuple[Vector, ...] = ()
    closed: bool = True
    cosines: Numbers = ()
    sines: Numbers = ()

    @property
    def round_axis(self) -> Vector | None:
        """What a circle, a great circle too, is round about; None for other curves."""
        return self.centre if self.kind in ("circle", "great_circle") else None


@dataclass(frozen=True)
class Pair:
    """A kinematic pair; its variable moves the second link relative to the first.

    `profiles`, for contact pairs, are the curves of the two links in that order. In an
    external contact the two bodies lie on opposite sides of the common tangent, in an
    internal one on the same side, the first within the second. `start` are the arc
    lengths (rad) along both profiles at which the variable of a rolling contact is zero. A
    `one_sided` contact can press and not pull: a simulation ends where it lifts off. The
    force of a contact acts at `distance` (m) from the centre of the sphere, where it is
    said. Teeth with a `pressure_angle` (rad) press the wheels apart by its tangent times
    what they turn them by.
    """

    name: str
    type: PairType
    links: Links
    profiles: tuple[Profile, Profile] | None = None
    contact: Literal["external", "internal"] = "external"
    start: Ends = (0.0, 0.0)
    one_sided: bool = False
    distance: float | None = None
    pressure_angle: float | None = None

    @property
    def kind(self) -> Kind:
        """What all pairs of its type have in common."""
        return KINDS[self.type]

    @property
    def constraints(self) -> int:
        """How many relative freedoms it takes away, of three."""
        return 3 - self.kind.freedoms

    @property
    def rolls(self) -> bool:
        """Whether its links roll on each other, which may repeat constraints of others."""
        return not self.kind.has_axis and self.kind.freedoms == 1


@dataclass(frozen=True)
class LinkSizes:
    """Where the axes sit in one link, as arcs and angles (rad).

    The first of `axes` is the z axis of the link's frame. `arcs[k]` is the arc from
    it to `axes[k + 1]`. The arc to `axes[1]` lies in the half-plane of positive y (the
    frame of Di Gregorio 2024, Fig. 3); `angles[k]` is the angle, counter-clockwise
    about the first axis, from that arc to the arc to `axes[k + 2]`. `unpaired` are those
    of the axes that carry no pair: they stay because frames and zeros refer to them.

    Arcs are between 0 and pi, unless they are `signed`: one below 0 or above pi runs on
    around its great circle, to an axis on the other side of the first one.
    """

    axes: Names
    arcs: Numbers = ()
    angles: Numbers = ()
    unpaired: Names = ()
    signed: bool = False


def resized(
    where: str,
    link: LinkSizes,
    kind: str,
    given: Sizes,
    unit: AngleUnit,
) -> LinkSizes:
    """Return a link with other arcs or angles, all or some by the pair they lead to.

    Raises
    ------
    ModelError
        If none leads to a pair that is named; `where` says which are meant.
    """
    values: Iterable[float]
    if isinstance(given, Mapping):
        pairs = link.axes[1 if kind == "arcs" else 2 :]
        for name in given.keys() - set(pairs):
            said = choices(name, pairs, "they lead to")
            raise ModelError(f'{where}: none leads to "{name}"{said}')
        sizes = dict(zip(pairs, getattr(link, kind), strict=True))
        sizes |= {name: in_radians(size, unit) for name, size in given.items()}
        values = sizes.values()
    else:
        values = (in_radians(size, unit) for size in np.ravel(given).tolist())
    changed: dict[str, Any] = {kind: tuple(values)}
    return replace(link, **changed)


@dataclass(frozen=True)
class SizeGeometry:
    """Geometry given within the links; assembly modes are to be found.

    `zeros[pair]` is the angle (rad) about the pair's axis, from the reference arc of
    the first link to that of the second, at which the pair variable reads zero. The
    reference arc of a link at an axis leads to the first other axis it lists.
    """

    links: Mapping[str, LinkSizes]
    zeros: Angles = field(default_factory=dict)


@dataclass(frozen=True)
class PoseGeometry:
    """Geometry given by the axes of all pairs in one reference pose.

    `axes[pair]` is a unit vector in ground axes; the frames of all links coincide with
    the ground's there. `values[pair]` is the pair variable (rad) in that pose.
    """

    axes: Mapping[str, Vector]
    values: Angles = field(default_factory=dict)


@dataclass(frozen=True)
class Input:
    """A driven pair and the range (rad) of its variable, from `start` to `stop`.

    It may fall: `stop` is then below `start`. The input is the default one if its mechanism
    was made without inputs. It equals the same input stated explicitly.
    """

    pair: str
    start: float
    stop: float
    is_default: bool = field(default=False, compare=False, repr=False, kw_only=True)

    @property
    def range(self) -> Ends:
        """The least and the greatest value (rad)."""
        return min(self.start, self.stop), max(self.start, self.stop)

    @property
    def sense(self) -> float:
        """1.0 if the range rises, -1.0 if it falls."""
        return -1.0 if self.stop < self.start else 1.0


@dataclass(frozen=True)
class Output:
    """A link whose motion relative to another one is of interest.

    `direction` is the unit vector, in axes of the link, of what it points with.
    """

    name: str
    link: str
    relative_to: str
    direction: Vector | None = None


@dataclass(frozen=True)
class Source:
    """Where a mechanism comes from, and what had to be assumed."""

    citation: str
    assumed: str = ""
