"""The parts of a mechanism other than masses, loads and joint limits.

These are pairs with their profiles, the geometry, inputs, outputs and the source.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from spherekit.conventions import Names
from spherekit.errors import ModelError
from spherekit.mechanism.joint import JOINT_KINDS, Ends, Kind, Links, Numbers, PairType
from spherekit.mechanism.sizes import Sizes, Vector, to_radians
from spherekit.quantity import AngleUnit
from spherekit.wording import choices, counted

Angles = Mapping[str, float]
"""Angles (rad) of pairs, by their names."""


def check_table_rows(
    key: str, name: str, times: Numbers, values: Numbers, min_rows: int, hint: str = ""
) -> None:
    """Check a table of values at times (s).

    Parameters
    ----------
    key
        Beginning of the key in messages, such as "loads.push.".
    name
        Key of the values.
    times, values
        The columns of the table. Times must increase.
    min_rows
        Smallest number of rows.
    hint
        Text at the end of the message on a table with too few rows. It says under which
        condition fewer rows are enough.

    Raises
    ------
    ModelError
        If times do not increase, or there are too few rows or not one value for each time.
    """
    row_count = len(times)
    if row_count != len(values):
        value_count = counted(len(values), "value")
        raise ModelError(
            f"{key}{name}: has {value_count}, but times has {row_count}; give one value "
            "for each time"
        )
    if row_count < min_rows:
        value_count = counted(row_count, "value")
        raise ModelError(
            f"{key}times: has {value_count}, expected at least {min_rows}{hint}"
        )
    for row, (time, next_time) in enumerate(pairwise(times)):
        if not next_time > time:
            raise ModelError(
                f"{key}times: must increase, but {next_time:g} s follows {time:g} s at "
                f"positions {row} and {row + 1} (counted from 0)"
            )


def as_vector(numbers: Iterable[float]) -> Vector:
    """Return three numbers as a tuple of floats."""
    x, y, z = map(float, numbers)
    return x, y, z


ProfileKind = Literal["circle", "great_circle", "points", "fourier"]


@dataclass(frozen=True)
class Profile:
    """The curve on the unit sphere along which a link touches in a contact pair.

    Attributes
    ----------
    kind
        Kind of the curve, such as a circle. It determines which other fields are used.
    centre
        Unit vector (3,) in link axes: the centre of a circle, the pole of a great circle,
        or the axis from which the colatitude of a Fourier profile is measured.
    radius
        Angular radius of a circle (rad).
    points
        Unit vectors (3,) in link axes along a smooth curve.
    closed
        Whether a curve through points returns to its first point.
    cosines, sines
        Coefficients (rad) of a Fourier profile. Its colatitude at azimuth `a` about
        `centre` is the sum of ``cosines[k] cos(k a) + sines[k] sin(k a)``.
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
        """Axis (unit vector) of a circle or great circle. None for other curves."""
        return self.centre if self.kind in ("circle", "great_circle") else None


@dataclass(frozen=True)
class Pair:
    """A kinematic pair (joint). Its variables move the second link relative to the first.

    A sliding contact has two variables, the other types of pairs have one.

    Attributes
    ----------
    name
        Name of the pair.
    type
        "R" revolute, "Cr" rolling contact, "Cs" sliding contact.
    links
        Names of the first and the second link.
    profiles
        Curves of the first and the second link of a contact. None for an R pair.
    contact
        External: the two bodies are on opposite sides of the common tangent. Internal: they
        are on the same side, and the first is inside the second.
    start
        Arc lengths (rad) along both profiles of the points that touch when the variable of
        a rolling contact is zero.
    one_sided
        Whether the contact can press but not pull. A simulation ends when it lifts off.
    distance
        Distance (m) from the centre of the sphere at which the contact force acts. None if
        it is not stated.
    pressure_angle
        Pressure angle (rad) of the teeth of a rolling contact. The force that presses the
        wheels apart is the tangential force of the teeth times the tangent of this angle.
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
        """The joint class of the pair's type."""
        return JOINT_KINDS[self.type]

    @property
    def constraints(self) -> int:
        """Number of relative degrees of freedom, of three, that the pair removes."""
        return 3 - self.kind.variable_count

    @property
    def rolls(self) -> bool:
        """Whether the pair is a rolling contact.

        Rolling contacts need special treatment. Their constraints may be redundant, for
        example those of bevel gears with axes on one carrier. A pose of the links does not
        show how far a contact has rolled.
        """
        return not self.kind.has_axis and self.kind.variable_count == 1


@dataclass(frozen=True)
class LinkSizes:
    """Positions of the axes in one link, as arcs and angles (rad).

    Attributes
    ----------
    axes
        Names of the axes. An axis has the name of its pair (joint). The first is the z axis
        of the link. The second is in the half-plane x = 0, y > 0 (the frame of Di Gregorio
        2024, Fig. 3).
    arcs
        `arcs[k]` is the arc of the great circle from the first axis to `axes[k + 1]`.
    angles
        `angles[k]` is the angle at the first axis from the arc that ends at `axes[1]` to
        the arc that ends at `axes[k + 2]`. The angle is positive counter-clockwise, seen
        from outside the sphere.
    unpaired
        Names of those `axes` that have no pair, such as the former axis of a pair that was
        locked. Arcs and angles can be measured from such an axis, so the axis is kept.
    signed
        Whether arcs may be below 0 or above pi. A negative arc leads from the first axis
        in the opposite direction. An arc above pi continues beyond the point opposite to
        the first axis.
    """

    axes: Names
    arcs: Numbers = ()
    angles: Numbers = ()
    unpaired: Names = ()
    signed: bool = False


def resize_link(
    where: str,
    link: LinkSizes,
    kind: str,
    new_sizes: Sizes,
    unit: AngleUnit,
) -> LinkSizes:
    """Return a link with other arcs or angles.

    A link has the axes A, B, C, ... on the sphere, each the axis of a pair (joint). Its
    arcs are AB, AC, AD, ... Its angles are at A: from AB to AC, from AB to AD, ... Each
    size has the name of the pair at its last axis, such as C for the arc AC.

    Parameters
    ----------
    where
        Beginning of error messages: the place in the mechanism file.
    link
        The link whose sizes change.
    kind
        "arcs" or "angles".
    new_sizes
        All sizes of this kind in order, or some of them by name of the pair.
    unit
        Unit of the new sizes.

    Raises
    ------
    ModelError
        If no size leads to a pair that is named.
    """
    values: Iterable[float]
    if isinstance(new_sizes, Mapping):
        # Arcs lead to all axes but the first one, angles to all but the first two.
        pairs = link.axes[1 if kind == "arcs" else 2 :]
        for name in (size for size in new_sizes if size not in pairs):
            hint = choices(name, pairs, f"{kind.capitalize()} lead to")
            raise ModelError(f'{where}: none of the {kind} leads to pair "{name}"{hint}')
        sizes = dict(zip(pairs, getattr(link, kind), strict=True))
        sizes |= {name: to_radians(size, unit) for name, size in new_sizes.items()}
        values = sizes.values()
    else:
        values = (to_radians(size, unit) for size in np.ravel(new_sizes).tolist())
    changes: dict[str, Any] = {kind: tuple(values)}
    return replace(link, **changes)


@dataclass(frozen=True)
class SizeGeometry:
    """Geometry of a mechanism by the sizes of its links.

    Sizes do not say how the links are assembled.

    Attributes
    ----------
    links
        Sizes of each link, by name.
    zeros
        Zeros (rad) of pairs (joints), by name of the pair; 0 for missing pairs. At a pair,
        the reference arc of a link leads from the axis of the pair to the first axis in
        `LinkSizes.axes` that is not on the same line. The zero of the pair is the angle
        about its axis, from the reference arc of its first link to that of its second link,
        in the position where the variable of the pair is zero.
    """

    links: Mapping[str, LinkSizes]
    zeros: Angles = field(default_factory=dict)


@dataclass(frozen=True)
class PoseGeometry:
    """Geometry of a mechanism by the axes of all pairs (joints) in one reference pose.

    In this pose, the coordinate axes of all links coincide with those of the ground.

    Attributes
    ----------
    axes
        Axis of each R pair, a unit vector in ground axes, by the name of the pair.
    values
        Variable (rad) of R pairs in the pose, by the name of the pair. The variable of a
        pair that is missing is 0.
    """

    axes: Mapping[str, Vector]
    values: Angles = field(default_factory=dict)


@dataclass(frozen=True)
class Input:
    """A driven pair (joint) and the range (rad) of its variable, from `start` to `stop`.

    If `stop` is below `start`, the variable falls. `is_default` is true if the user stated
    no inputs. Comparisons ignore it.
    """

    pair: str
    start: float
    stop: float
    is_default: bool = field(default=False, compare=False, repr=False, kw_only=True)

    @property
    def range(self) -> Ends:
        """The smallest and the largest value (rad)."""
        return min(self.start, self.stop), max(self.start, self.stop)

    @property
    def sense(self) -> float:
        """1.0 if the range rises, -1.0 if it falls."""
        return -1.0 if self.stop < self.start else 1.0


@dataclass(frozen=True)
class Output:
    """A link whose motion relative to another one is of interest.

    Attributes
    ----------
    name
        Name of the output.
    link, relative_to
        Names of the link that moves and of the link relative to which it moves.
    direction
        Observed direction, a unit vector (3,) in the axes of `link`. None if the output is
        an orientation.
    """

    name: str
    link: str
    relative_to: str
    direction: Vector | None = None


@dataclass(frozen=True)
class Source:
    """The publication from which a mechanism is taken.

    Attributes
    ----------
    citation
        The publication.
    assumed
        Assumptions about what the publication leaves open.
    """

    citation: str
    assumed: str = ""
