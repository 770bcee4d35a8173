"""Bevel gears that have the same equations as couplings between hinges of a model.

A coupling is a linear equation between the rates of hinges. Two bevel gears give such an
equation too: u x + v y = 0. Here x is the rate at which their carrier turns about the axis
A relative to the first gear, and y the rate at which the second gear turns about the axis B
relative to the carrier. The pitch cones touch along v A - u B.

All couplings are examined together. A bevel differential is the reason: its couplings are
usually the sum and the difference of two motor angles. Neither of these couplings by itself
is the equation of two gears, but combinations of both are.

Hinges are numbered by their position in the list of hinges, links by their numbers in the
imported model.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.exchange.identifiers import unique_names
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import unit_rows
from spherekit.mechanism.graph import find_spanning_tree

SAME_WHEEL_AXIS_SINE = 1e-6
"""Sine of the angle below which two axes are one.

Larger: gears with tiny pitch cones are taken for coaxial wheels; smaller: axes that differ
by rounding of the file stay apart.
"""

COUPLING_TOLERANCE = 1e-9
"""Relative error up to which an equation is accepted as a combination of couplings.

Larger: gears are accepted whose ratio differs in digits that the file states; smaller:
couplings with rounded ratios are refused.
"""


class Coupling(NamedTuple):
    """A linear equation between the rates of joints of a model.

    Attributes
    ----------
    name
        Name of the coupling.
    factors
        Factor of the rate of each joint, by the number of the joint. The sum of all factors
        times rates is zero.
    """

    name: str
    factors: Mapping[int, float]


class ImportedPair(NamedTuple):
    """An R pair (revolute joint) of an imported mechanism.

    Attributes
    ----------
    name
        Name of the pair.
    links
        Numbers of the first and the second link.
    axis
        (3,) unit vector in world axes about which the second link turns.
    value
        Variable (joint angle, rad) in the pose of the model.
    joint
        Index of the pair's joint in the model. The index is -1 for a pair that is no joint
        in the model: a pair that closes a loop, or a pair that carries an idler wheel (a
        wheel added between two gears).
    """

    name: str
    links: tuple[int, int]
    axis: Floats
    value: float
    joint: int = -1


class PitchCircle(NamedTuple):
    """The pitch circle of a bevel gear, where its pitch cone meets the unit sphere.

    Attributes
    ----------
    radius
        Angle (rad) from the axis of the gear to the circle.
    link
        Number of the link that is the gear.
    centre
        (3,) unit vector of the axis of the gear, in world axes.
    """

    radius: float
    link: int
    centre: Floats


@dataclass(frozen=True)
class BevelGears:
    """Two pitch circles on the sphere that roll on each other, as two bevel gears do.

    Attributes
    ----------
    circles
        The two circles.
    external
        Whether the circles touch from outside. Otherwise the smaller circle, which comes
        first, rolls inside the larger circle.
    """

    circles: tuple[PitchCircle, PitchCircle]
    external: bool


@dataclass(frozen=True)
class IdlerWheel:
    """A wheel that is added to an imported mechanism between two gears with the same axis.

    A model can state a ratio of two links that turn about one axis. Gears with the same
    axis do not touch each other. A third wheel, with its axis at right angles to the axis
    of the gears, rolls on both gears and gives them this ratio.

    Attributes
    ----------
    link
        Number of the new link that is the wheel.
    carrier
        Number of the link that carries the wheel.
    axis
        (3,) unit vector of the axis of the wheel, in world axes.
    """

    link: int
    carrier: int
    axis: Floats


@dataclass(frozen=True)
class CoupledGears:
    """Gears of all couplings, by name, and idler wheels to be added between gears."""

    gears: Mapping[str, BevelGears]
    idlers: Sequence[IdlerWheel]


class HingeOnPath(NamedTuple):
    """A hinge that is passed on the way from one link to another.

    Attributes
    ----------
    hinge
        Number of the hinge.
    sense
        1.0 if the path leads from the first link of the hinge to its second, else -1.0.
    """

    hinge: int
    sense: float


class LinkPath(NamedTuple):
    """The path between two links through the hinges of a model without loops.

    Attributes
    ----------
    first_link, last_link
        Numbers of the links.
    hinges
        The hinges in the order from the first link to the last.
    """

    first_link: int
    last_link: int
    hinges: Sequence[HingeOnPath]


class CoaxialHinges(NamedTuple):
    """Successive hinges on a path from link to link that turn about one axis.

    Attributes
    ----------
    axis
        (3,) unit vector of the axis.
    hinges
        The hinges in the order of the path. Each has the sense 1.0 or -1.0. If a hinge has
        the sense 1.0 and a positive rate, the link after it rotates positively about `axis`
        relative to the link before it.
    """

    axis: Floats
    hinges: list[HingeOnPath]


class Extent(NamedTuple):
    """How far points of a plane extend from the origin.

    Each point has the rates (x, y) of two rotations in a motion that the couplings allow.
    The extents tell whether the points fill the plane, are on a line through the origin, or
    are all at the origin. Two links can be gears only if the points are on a line; see
    `_find_implied_factors`.

    The extent along a direction is the root of the sum of the squares of the components of
    all points along this direction.

    Attributes
    ----------
    largest
        Extent along the direction in which it is largest.
    smallest
        Extent at right angles to this direction; 0 if the points are on a line through the
        origin.
    smallest_direction
        (2,) unit vector at right angles to the direction of the largest extent. If the
        points are on a line, it is the normal of this line.
    """

    largest: float
    smallest: float
    smallest_direction: Floats


@dataclass(frozen=True)
class BevelEquation:
    """The equation u x + v y = 0 of two links that turn about crossing axes of a carrier.

    x is the angular velocity (rad/s) of the carrier relative to the first link, about the
    first axis. y is the angular velocity of the second link relative to the carrier, about
    the second axis. Both x and y are sums of rates of hinges (revolute joints).

    The equation follows from couplings of an imported file: linear equations between the
    rates of joints. Two bevel gears on the two links move by the same equation, so they can
    replace the couplings.

    Attributes
    ----------
    equation
        (hinges,) the factors c of the same equation, written with the rates of all hinges
        of the mechanism: c_1 rate_1 + c_2 rate_2 + ... = 0.
    links
        Numbers of the two links.
    axes
        The two axes (3,) of the carrier, unit vectors in world axes at the imported pose.
    factors
        The factors u and v.
    """

    equation: Floats
    links: tuple[int, int]
    axes: tuple[Floats, Floats]
    factors: tuple[float, float]

    def construct_gears(self) -> BevelGears:
        """Return the gears that have this equation."""
        return construct_bevel_gears(self.links, self.axes, self.factors)


@dataclass(frozen=True)
class CoaxialEquation:
    """The equation u x + v y = 0 of two links that turn about one axis of a carrier.

    Here x and y are the angular velocities (rad/s) of the first and the second link
    relative to the carrier. Each is the rate of a hinge (revolute joint), or minus this
    rate.
    Two gears with one axis do not touch. An idler wheel, with its axis at right angles to
    the axis of the gears, rolls on both gears, and gives them this equation.

    Attributes
    ----------
    equation
        (hinges,) the factors c of the same equation, written with the rates of all hinges
        of the mechanism: c_1 rate_1 + c_2 rate_2 + ... = 0.
    links
        Numbers of the two links.
    axis
        (3,) unit vector of their axis.
    factors
        The factors u and v.
    carrier
        Number of the carrier.
    idler_axis
        (3,) unit vector of the axis of the idler wheel on the carrier.
    """

    equation: Floats
    links: tuple[int, int]
    axis: Floats
    factors: tuple[float, float]
    carrier: int
    idler_axis: Floats

    def construct_gears(self, idler_link: int) -> tuple[BevelGears, BevelGears]:
        """Return the gears of first link and idler, and the gears of idler and second link.

        The two links turn about one axis of a carrier, so their gears do not touch. The
        idler is a wheel that meshes with both gears. Together the gears give the two links
        the equation of the couplings.

        Let x, z and y be the angular velocities of the first link, the idler and the second
        link relative to the carrier, each about its own axis. The equation u x + v y = 0
        determines the ratio y / x, which is the product of the ratios z / x and y / z of
        the two meshes. Both mesh ratios get the same magnitude, sqrt(abs(y / x)), so that
        no wheel is very small. The sign of z / x is free, and is chosen negative.

        Parameters
        ----------
        idler_link
            Number of the link that is the idler wheel.
        """
        first_link, second_link = self.links
        u, v = self.factors
        ratio = -u / v  # y / x
        first_mesh_ratio = -float(np.sqrt(abs(ratio)))  # z / x
        second_mesh_ratio = ratio / first_mesh_ratio  # y / z
        first_mesh = construct_gears_with_ratio(
            (first_link, idler_link), (self.axis, self.idler_axis), first_mesh_ratio
        )
        second_mesh = construct_gears_with_ratio(
            (idler_link, second_link), (self.idler_axis, self.axis), second_mesh_ratio
        )
        return first_mesh, second_mesh


GearEquation = BevelEquation | CoaxialEquation
"""An equation that gears can have."""


def find_gears(
    hinges: Sequence[ImportedPair], couplings: Sequence[Coupling], first_new_link: int
) -> CoupledGears:
    """Return bevel gears that have the same equations as couplings of hinges.

    A coupling is a linear equation between the rates of hinges, as some models state it. A
    mechanism file has gears in place of couplings. For any two links, the couplings may
    imply the equation of two gears. All such equations are candidates. Independent
    candidates are chosen, one for each independent coupling.

    A coupling that is the equation of two gears by itself gives these gears its name. The
    names of all other couplings go to gears that follow from combinations of couplings, in
    the order of the search. Equal names are told apart by numbers.

    Parameters
    ----------
    hinges
        All hinges of the model, which form a tree of links.
    couplings
        The couplings, by joints. Factors of joints that are no hinges are ignored.
    first_new_link
        Number of the first link that may be added as an idler wheel.

    Raises
    ------
    ModelError
        If the equations of gears between links do not span the equations of the couplings.
    """
    # Equations are rows: factors of the rates of all hinges, in a sum that is zero. Two
    # rows of rank 1 are the same equation. A row that raises the rank is independent.
    equations = _write_equations(hinges, couplings)
    candidates: list[GearEquation] = [
        *_find_bevel_equations(hinges, equations),
        *_find_coaxial_equations(hinges, equations),
    ]
    chosen_by_name: dict[str, GearEquation] = {}
    chosen_rows = np.empty((0, len(hinges)))
    # First choose gears for couplings that are gears by themselves: these keep their names.
    names = unique_names(coupling.name for coupling in couplings)
    for coupling_name, equation in zip(names, equations, strict=True):
        for candidate in candidates:
            if _find_rank([equation, candidate.equation]) > 1:
                continue
            if _find_rank([*chosen_rows, equation]) > len(chosen_rows):
                chosen_by_name[coupling_name] = candidate
                chosen_rows = np.vstack([chosen_rows, candidate.equation])
                break
    # Then choose further independent gears, with the names of the other couplings.
    free_names = [name for name in names if name not in chosen_by_name]
    for candidate in candidates:
        if _find_rank([*chosen_rows, candidate.equation]) > len(chosen_rows):
            chosen_by_name[free_names.pop(0)] = candidate
            chosen_rows = np.vstack([chosen_rows, candidate.equation])
    if len(chosen_rows) < _find_rank(equations):
        raise ModelError(_describe_missing_gears(hinges, equations))

    # Construct the gears. Coaxial links need an idler wheel between them, a new link.
    gears: dict[str, BevelGears] = {}
    idlers: list[IdlerWheel] = []
    for name, candidate in chosen_by_name.items():
        if isinstance(candidate, BevelEquation):
            gears[name] = candidate.construct_gears()
            continue
        idler_link = first_new_link + len(idlers)
        idlers.append(IdlerWheel(idler_link, candidate.carrier, candidate.idler_axis))
        first_mesh, second_mesh = candidate.construct_gears(idler_link)
        (idler_name,) = unique_names([f"{name}_idler"], taken=[*names, *gears])
        gears[name] = first_mesh
        gears[idler_name] = second_mesh
    return CoupledGears(gears, idlers)


def _write_equations(
    hinges: Sequence[ImportedPair], couplings: Sequence[Coupling]
) -> Floats:
    """Return the couplings of an imported model as equations between the rates of hinges.

    A coupling is a linear equation between the rates of joints. Each coupling becomes a row
    of a matrix, with a column for each hinge (revolute joint). The caller searches for
    gears that give the same equations.

    Parameters
    ----------
    hinges
        All hinges of the model.
    couplings
        The couplings. Joints of other kinds than hinges are ignored.

    Returns
    -------
    (couplings, hinges) factors of the rates in sums that are zero. The largest factor of
    each row is 1 or -1.

    Raises
    ------
    ModelError
        If a coupling has no factors of hinges.
    """
    column_by_joint = {hinge.joint: column for column, hinge in enumerate(hinges)}
    equations = np.zeros((len(couplings), len(hinges)))
    for row, coupling in enumerate(couplings):
        for joint, factor in coupling.factors.items():
            if joint in column_by_joint:
                equations[row, column_by_joint[joint]] = factor
    scales = np.max(np.abs(equations), axis=1, keepdims=True, initial=0.0)
    if not np.all(scales):
        name = couplings[int(np.argmin(scales))].name
        raise ModelError(
            f"all factors of {name} are zero or belong to joints that do not turn"
        )
    return equations / scales


def construct_gears_with_ratio(
    links: tuple[int, int], axes: tuple[Floats, Floats], ratio: float
) -> BevelGears:
    """Return the pitch circles of two bevel gears with a ratio of their angular velocities.

    Parameters
    ----------
    links
        Numbers of the two links that are the gears.
    axes
        (3,) unit vectors of the axes of the gears. Angular velocities are counted about
        these.
    ratio
        Angular velocity of the second gear, divided by the angular velocity of the first
        gear. Both angular velocities are relative to the carrier of the gears.
    """
    # `construct_bevel_gears` needs the factors u and v of an equation u x + v y = 0. There,
    # x is the angular velocity of the carrier relative to the first gear. So relative to
    # the carrier, the first gear has the angular velocity -x and the second gear y. Then y
    # = ratio (-x), which is -ratio x - y = 0.
    u = -ratio
    v = -1.0
    return construct_bevel_gears(links, axes, factors=(u, v))


def construct_bevel_gears(
    links: tuple[int, int], axes: tuple[Floats, Floats], factors: tuple[float, float]
) -> BevelGears:
    """Return the pitch circles of two bevel gears with the equation u x + v y = 0.

    x and y are the angular velocities about the axes of the gears, as defined below.

    Parameters
    ----------
    links
        Numbers of the two links that are the gears.
    axes
        Unit vectors A and B (3,), which are fixed in the carrier of the gears. The carrier
        turns at the rate x about A relative to the first link. The second link turns at the
        rate y about B relative to the carrier.
    factors
        The factors u and v. Neither is zero.

    Returns
    -------
    The circles, in the order of the links if they touch from outside. Otherwise the smaller
    circle, which rolls inside the larger one, comes first.
    """
    u, v = factors
    # Pitch cones roll on each other about the line along which they touch, so this line has
    # the direction of the relative angular velocity x A + y B of the links. The rates x =
    # v, y = -u satisfy the equation.
    contact_line = unit_rows(v * axes[0] - u * axes[1])
    first = _construct_pitch_circle(links[0], axes[0], contact_line)
    second = _construct_pitch_circle(links[1], axes[1], contact_line)
    is_external = _is_line_between(contact_line, first.centre, second.centre)
    # The smaller circle of an internal pair comes first.
    if not is_external and second.radius < first.radius:
        first, second = second, first
    return BevelGears((first, second), is_external)


def _construct_pitch_circle(link: int, axis: Floats, contact_line: Floats) -> PitchCircle:
    """Return the pitch circle of a gear: about its axis on the sphere, through a point.

    Such a circle has two centres on the sphere, at both ends of its axis. The centre nearer
    to the point is used, so that the radius is at most a quarter turn.

    Parameters
    ----------
    link
        Number of the link that is the gear.
    axis
        (3,) unit vector of its axis.
    contact_line
        (3,) unit vector to the point, at which the circle touches the circle of another
        gear.
    """
    centre = axis if axis @ contact_line >= 0.0 else -axis
    return PitchCircle(float(arc(centre, contact_line)), link, centre)


def _is_line_between(line: Floats, first_centre: Floats, second_centre: Floats) -> bool:
    """Return whether two centres are on opposite sides of a line through the origin.

    Two pitch circles (gears) touch at a line from the centre of the sphere. If their
    centres are on opposite sides of this line, they touch from outside.

    The line and both centres are in one plane. So the cross products centre x line are
    perpendicular to this plane. They are opposite to each other if the centres are on
    opposite sides of the line.

    Parameters
    ----------
    line
        (3,) unit vector in the plane of both centres.
    first_centre, second_centre
        (3,) unit vectors to the centres.
    """
    first_normal = np.cross(first_centre, line)
    second_normal = np.cross(second_centre, line)
    return bool(first_normal @ second_normal < 0.0)


def _find_bevel_equations(
    hinges: Sequence[ImportedPair], equations: Floats
) -> Iterator[BevelEquation]:
    """Yield the equations of bevel gears that follow from the couplings of joints.

    A coupling is a linear equation between the rates of joints. Two bevel gears turn about
    two different axes on one link, their carrier. With constants u and v, bevel gears have
    the equation u x + v y = 0. Here x is the rate of the carrier about the first axis,
    relative to the first gear. y is the rate of the second gear about the second axis,
    relative to the carrier.

    All couples of links are tried as gears. A path of hinges (revolute joints) leads from
    the first link to the second. The first hinges of the path must have one common axis,
    and all others a second common axis. The link in between is the carrier. x is the sum of
    the rates of the first hinges, and y the sum of the others. A rate has the factor -1 if
    it is counted in the opposite sense: a positive rate turns the next link of the path
    negatively about the common axis. The two links are gears if the couplings imply such an
    equation of x and y.

    Parameters
    ----------
    hinges
        All hinges.
    equations
        (couplings, hinges) the couplings as factors of the rates of hinges.
    """
    for path in _link_paths(hinges):
        # Successive hinges about one axis are one group.
        groups = _group_by_axis(hinges, path)
        if len(groups) != 2:
            continue
        # Rows for x and y: the factors of all hinge rates in the sums. A factor is the
        # sense 1.0 or -1.0 of a hinge along the path, or 0.0 for a hinge that is not in the
        # sum.
        rotations = np.zeros((2, len(hinges)))
        for row, coaxial_hinges in enumerate(groups):
            for hinge, sense in coaxial_hinges.hinges:
                rotations[row, hinge] = sense
        # u and v, or None if the couplings imply no equation of x and y.
        factors = _find_implied_factors(rotations, equations)
        if factors is None:
            continue
        bevel_equation = BevelEquation(
            equation=factors @ rotations,  # u x + v y as factors of the hinge rates
            links=(path.first_link, path.last_link),
            axes=(groups[0].axis, groups[1].axis),
            factors=(factors[0], factors[1]),
        )
        # A gear with a pitch circle of zero radius can't roll. The radius is an angle
        # (rad). The limit is a sine, which equals a small angle.
        circles = bevel_equation.construct_gears().circles
        if min(circle.radius for circle in circles) > SAME_WHEEL_AXIS_SINE:
            yield bevel_equation


def _find_coaxial_equations(
    hinges: Sequence[ImportedPair], equations: Floats
) -> Iterator[CoaxialEquation]:
    """Yield the equations of coaxial gears that follow from the couplings of joints.

    Two links hinged to a third link, the carrier, about the same axis can be coaxial gears.
    x and y are their angular velocities relative to the carrier. A coupling is a linear
    equation between the rates of joints. The links are gears if the couplings imply an
    equation u x + v y = 0 with constant factors u and v. Coaxial gears do not touch. The
    caller therefore adds a wheel on the carrier, the idler, that meshes with both gears.

    Parameters
    ----------
    hinges
        All hinges (revolute joints).
    equations
        (couplings, hinges) the couplings as factors of the rates of hinges.
    """
    for path in _link_paths(hinges):
        if len(path.hinges) != 2:
            continue
        # Successive hinges about one axis are one group. Both hinges must be in one group.
        groups = _group_by_axis(hinges, path)
        if len(groups) != 1:
            continue
        axis = groups[0].axis
        # The path leads from the first link over the carrier to the second link. At each
        # hinge, the link after the hinge turns relative to the link before it. The relative
        # angular velocity about `axis` is the rate of the hinge times `sense`, which is 1
        # or -1.
        to_carrier, from_carrier = groups[0].hinges
        # x and y as sums of factors times the rates of all hinges.
        rotations = np.zeros((2, len(hinges)))
        # x is the first link relative to the carrier. The hinge has the carrier relative to
        # the first link, so the sign changes.
        rotations[0, to_carrier.hinge] = -to_carrier.sense
        # y is the second link relative to the carrier.
        rotations[1, from_carrier.hinge] = from_carrier.sense
        # u and v, or None if the couplings imply no equation of x and y.
        factors = _find_implied_factors(rotations, equations)
        if factors is None:
            continue
        yield CoaxialEquation(
            equation=factors @ rotations,
            links=(path.first_link, path.last_link),
            axis=axis,
            factors=(factors[0], factors[1]),
            carrier=_find_common_link(hinges[to_carrier.hinge], hinges[from_carrier.hinge]),
            # Any axis at right angles to the axis of the links will do.
            idler_axis=_find_perpendicular(axis),
        )


def _find_common_link(first_hinge: ImportedPair, second_hinge: ImportedPair) -> int:
    """Return the number of the only link that two hinges have in common."""
    (link,) = {*first_hinge.links} & {*second_hinge.links}
    return link


def _find_perpendicular(axis: Floats) -> Floats:
    """Return any unit vector (3,) at right angles to a unit vector (3,).

    The result is along the cross product of the vector and a coordinate axis. Of the three
    axes, the one most nearly at right angles to the vector gives the longest, most accurate
    product.
    """
    coordinate_axis = np.eye(3)[int(np.argmin(np.abs(axis)))]
    perpendicular = np.cross(axis, coordinate_axis)
    return perpendicular / np.linalg.norm(perpendicular)


def _find_implied_factors(rotations: Floats, equations: Floats) -> Floats | None:
    """Return the factors u, v of an equation of two rotations that the couplings imply.

    The caller tells by these factors whether two links can be gears. The equation is
    u x + v y = 0 with the rates x and y of the rotations of the two links. The couplings
    imply the equation if x and y satisfy it in every motion that the couplings allow. Each
    motion gives a point (x, y) of a plane. There are three cases:

    - The points fill the plane: x and y are independent, so there is no equation.
    - The points are on a line through the origin: (u, v) is the normal of this line. If one
      factor is zero, the line is a coordinate axis, and one rotation is always at rest.
    - The only point is the origin: both rotations are always at rest.

    Two links can be gears only in the second case, with both factors different from zero.

    Parameters
    ----------
    rotations
        (2, hinges) the rates x and y as sums of the rates of hinges (revolute joints).
    equations
        (couplings, hinges) the couplings as factors of the rates of hinges.

    Returns
    -------
    The factors (2,), or None if the two links can't be gears.
    """
    # Each column is the point (x, y) of a motion. All motions are combinations of these.
    points = rotations @ _find_allowed_motions(equations).T
    extent = _measure_extent(points)
    if extent.smallest > COUPLING_TOLERANCE:
        return None  # the points fill the plane
    if extent.largest <= COUPLING_TOLERANCE:
        return None  # the only point is the origin
    factors = extent.smallest_direction  # the normal of the line
    if np.min(np.abs(factors)) <= COUPLING_TOLERANCE:
        return None  # one rotation is always at rest
    return factors


def _measure_extent(points: Floats) -> Extent:
    """Return how far points (2, n) of a plane spread from the origin, in two directions.

    The points are columns. The two directions, at right angles, are the directions of the
    largest and the smallest extent; see `Extent`. Without points both extents are 0.
    """
    # The singular value decomposition has the directions in columns and their extents, with
    # the largest first. A single point has only one extent.
    directions, extents, _ = np.linalg.svd(points)
    largest, smallest = _pad_with_zeros(extents, 2)
    return Extent(largest, smallest, smallest_direction=directions[:, 1])


def _find_allowed_motions(equations: Floats) -> Floats:
    """Return a basis of the motions that satisfy the couplings.

    The caller examines how two links rotate in these motions, to find out whether the links
    are gears.

    Parameters
    ----------
    equations
        (couplings, hinges) the factors of the rates of hinges (revolute joints) in the
        equation of each coupling. The sum of the products of factors and rates is zero.

    Returns
    -------
    (motions, hinges) rates of the hinges in each motion. Rows are orthonormal.
    """
    # These motions are the null space of `equations`: the right singular vectors (rows)
    # after those with nonzero singular values.
    _, singular_values, right_vectors = np.linalg.svd(equations)
    rank = int(np.sum(singular_values > COUPLING_TOLERANCE))
    return right_vectors[rank:]


def _pad_with_zeros(values: Floats, length: int) -> Floats:
    """Return values with zeros appended, up to a length."""
    return np.append(values, np.zeros(length - len(values)))


def _group_by_axis(hinges: Sequence[ImportedPair], path: LinkPath) -> list[CoaxialHinges]:
    """Return the hinges along a path, with successive hinges of one axis as one group."""
    groups: list[CoaxialHinges] = []
    for hinge, sense in path.hinges:
        axis = hinges[hinge].axis
        is_same_axis = bool(groups) and (
            np.linalg.norm(np.cross(axis, groups[-1].axis)) <= SAME_WHEEL_AXIS_SINE
        )
        if not is_same_axis:
            groups.append(CoaxialHinges(axis, []))
        # The axis of the hinge may be opposite to the axis of the group.
        axis_sense = float(np.sign(axis @ groups[-1].axis))
        groups[-1].hinges.append(HingeOnPath(hinge, sense * axis_sense))
    return groups


def _link_paths(hinges: Sequence[ImportedPair]) -> Iterator[LinkPath]:
    """Yield the path of hinges between any two links, each path once.

    The links and hinges (revolute joints) form a tree, so there is only one path. The path
    leads from the link with the smaller number to the other link. The callers examine for
    each path whether couplings make its two links a pair of gears.
    """
    ends = [hinge.links for hinge in hinges]
    links = sorted({link for links in ends for link in links})
    for first_link in links:
        path_by_link: dict[int, list[HingeOnPath]] = {first_link: []}
        # Each link is reached from its parent by one more hinge. The sense of a hinge is
        # 1.0 if the path leads from its first link to its second, else -1.0.
        for hinge, parent, child in find_spanning_tree(ends, [first_link]):
            sense = 1.0 if ends[hinge][0] == parent else -1.0
            path_by_link[child] = [*path_by_link[parent], HingeOnPath(hinge, sense)]
        for last_link, path in path_by_link.items():
            if last_link > first_link:
                yield LinkPath(first_link, last_link, path)


def _describe_missing_gears(hinges: Sequence[ImportedPair], equations: Floats) -> str:
    """Return the reason why couplings are no gears, with the hinges that they tie."""
    names = ", ".join(
        hinge.name for column, hinge in enumerate(hinges) if np.any(equations[:, column])
    )
    return (
        f"these ratios between {names} are possible neither with two wheels on crossing "
        "axes of one carrier nor with an idler wheel between coaxial wheels"
    )


def _find_rank(rows: Sequence[Floats] | Floats) -> int:
    """Return the rank of equations (rows, hinges) whose largest factors are about 1."""
    if not len(rows):
        return 0
    return int(np.linalg.matrix_rank(np.asarray(rows), tol=COUPLING_TOLERANCE))
