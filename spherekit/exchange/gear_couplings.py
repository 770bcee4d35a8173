"""Bevel gears that have the same equations as couplings between hinges of a model.

A coupling is a linear equation between the rates of hinges. Two bevel gears give one too:
u x + v y = 0, where x is the rate at which their carrier turns about the axis A relative to
the first gear, and y that at which the second gear turns about the axis B relative to the
carrier. The pitch cones touch along v A - u B.

All couplings are examined together. A bevel differential is the reason: its couplings are
usually the sum and the difference of two motor angles. Neither of them alone is the
equation of two gears, but combinations of both are.

Hinges are numbered by their position in the list of hinges, links by their numbers in the
imported model.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
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
        Factor of each rate, by the number of the joint, in a sum that is zero.
    """

    name: str
    factors: Mapping[int, float]


class ImportedPair(NamedTuple):
    """An R pair of an imported mechanism.

    Attributes
    ----------
    name
        Name of the pair.
    links
        Numbers of the first and the second link.
    axis
        (3,) unit vector in world axes about which the second link turns.
    value
        Variable (rad) in the pose of the model.
    joint
        Number of its joint in the model, or -1 if the pair is no joint: it closes a loop,
        or carries an added wheel.
    """

    name: str
    links: tuple[int, int]
    axis: Floats
    value: float
    joint: int = -1


class PitchCircle(NamedTuple):
    """The pitch circle of a bevel gear on the unit sphere.

    Attributes
    ----------
    radius
        Angle (rad) from the centre to the circle.
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
    """Two pitch circles that roll on each other.

    Attributes
    ----------
    circles
        The two circles.
    external
        Whether they touch from outside. Otherwise the smaller one, which comes first, rolls
        inside the larger one.
    """

    circles: tuple[PitchCircle, PitchCircle]
    external: bool


@dataclass(frozen=True)
class IdlerWheel:
    """A wheel that is added to a mechanism between two coaxial gears.

    An imported model can state a ratio of two links that turn about one axis. Two gears
    with the same axis do not touch each other. A third wheel, whose axis is at right angles
    to theirs, rolls on both of them and gives them this ratio.

    Attributes
    ----------
    link
        Number of the new link that is the wheel.
    carrier
        Number of the link that carries it.
    axis
        (3,) unit vector of its axis, in world axes.
    """

    link: int
    carrier: int
    axis: Floats


@dataclass(frozen=True)
class CoupledGears:
    """The gears of all couplings, by name, and the idler wheels that have to be added."""

    gears: Mapping[str, BevelGears]
    idlers: Sequence[IdlerWheel]


class HingeOnPath(NamedTuple):
    """A hinge on the path between two links.

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
    """The path between two links through the tree of hinges.

    Attributes
    ----------
    first_link, last_link
        Numbers of the links.
    hinges
        The hinges from the first link to the last.
    """

    first_link: int
    last_link: int
    hinges: Sequence[HingeOnPath]


class CoaxialHinges(NamedTuple):
    """Hinges that follow each other on a path and turn about one axis.

    Attributes
    ----------
    axis
        (3,) unit vector of the axis.
    hinges
        The hinges. A positive rate of a hinge turns the end of the path relative to its
        beginning. The sense of the hinge is 1.0 if this rotation is positive about `axis`,
        and -1.0 if it is negative.
    """

    axis: Floats
    hinges: list[HingeOnPath]


@dataclass(frozen=True)
class BevelEquation:
    """The equation u x + v y = 0 of two links that turn about crossing axes of a carrier.

    Here x is the angular velocity (rad/s) of the carrier relative to the first link, about
    the first axis. The angular velocity of the second link relative to the carrier, about
    the second axis, is y. Both are sums of rates of hinges (R pairs).

    Attributes
    ----------
    equation
        (hinges,) the same equation in terms of the rates of all hinges: the factors c of
        the sum c_1 rate_1 + c_2 rate_2 + ... = 0.
    links
        Numbers of the two links.
    axes
        The two axes (3,) of the carrier, unit vectors.
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
    relative to the carrier. Both are rates of hinges (R pairs), up to the sign. Two gears
    with one axis do not touch. An idler wheel whose axis is at right angles to theirs rolls
    on both.

    Attributes
    ----------
    equation
        (hinges,) the same equation in terms of the rates of all hinges: the factors c of
        the sum c_1 rate_1 + c_2 rate_2 + ... = 0.
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
        """Return the gears of first link and idler, and those of idler and second link.

        The equation of the links is u x + v y = 0, or y = ratio x with ratio = -u / v. Here
        x, z and y are the angular velocities of the first link, the idler and the second
        link relative to the carrier. The product of the ratios z / x and y / z of both
        meshes is the ratio of the links. Both have the size sqrt(abs(ratio)), so that no
        wheel is very small.

        Parameters
        ----------
        idler_link
            Number of the link that is the idler wheel.
        """
        # `construct_bevel_gears` takes the factors u and v of u a + v b = 0. Here a is the
        # velocity of the carrier relative to the first wheel of a mesh, and b that of its
        # second wheel relative to the carrier. Both follow the chain from the first wheel
        # over the carrier to the second wheel.
        # First mesh: a = -x and b = z, so ratio_size (-x) - z = 0 or z = -ratio_size x.
        # Second mesh: a = -z and b = y, so (ratio / ratio_size) (-z) - y = 0. Putting z in
        # gives y = ratio x.
        ratio = -self.factors[0] / self.factors[1]
        ratio_size = float(np.sqrt(abs(ratio)))
        return (
            construct_bevel_gears(
                (self.links[0], idler_link),
                (self.axis, self.idler_axis),
                (ratio_size, -1.0),
            ),
            construct_bevel_gears(
                (idler_link, self.links[1]),
                (self.idler_axis, self.axis),
                (ratio / ratio_size, -1.0),
            ),
        )


GearEquation = BevelEquation | CoaxialEquation
"""An equation that gears can have."""


def find_gears(
    hinges: Sequence[ImportedPair], couplings: Sequence[Coupling], first_new_link: int
) -> CoupledGears:
    """Return bevel gears that have the same equations as couplings of hinges.

    A coupling is a linear equation between the rates of hinges. For any two links, the
    couplings may imply the equation of two gears. All such equations are candidates. As
    many independent candidates are chosen as there are independent couplings.

    A coupling that is a pair of gears by itself keeps its name. The names of the others go
    to gears whose equations are combinations of couplings, in the order of the search.

    Parameters
    ----------
    hinges
        All hinges of the model. They form a tree of links.
    couplings
        The couplings, by joints. Factors of joints that are no hinges are ignored.
    first_new_link
        Number of the first link that may be added as an idler wheel.

    Raises
    ------
    ModelError
        If the equations of gears between links do not span those of the couplings.
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
    for coupling, equation in zip(couplings, equations, strict=True):
        if coupling.name in chosen_by_name:
            continue
        for candidate in candidates:
            if _find_rank([equation, candidate.equation]) > 1:
                continue
            if _find_rank([*chosen_rows, equation]) > len(chosen_rows):
                chosen_by_name[coupling.name] = candidate
                chosen_rows = np.vstack([chosen_rows, candidate.equation])
                break
    # Then choose further independent gears, with the names of the other couplings.
    free_names = [
        coupling.name for coupling in couplings if coupling.name not in chosen_by_name
    ]
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
        gears[name] = first_mesh
        gears[f"{name}_idler"] = second_mesh
    return CoupledGears(gears, idlers)


def _write_equations(
    hinges: Sequence[ImportedPair], couplings: Sequence[Coupling]
) -> Floats:
    """Return the couplings as equations between the rates of hinges.

    Parameters
    ----------
    hinges
        All hinges of the model.
    couplings
        Equations between the rates of joints. Joints that are no hinges are ignored.

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


def construct_bevel_gears(
    links: tuple[int, int], axes: tuple[Floats, Floats], factors: tuple[float, float]
) -> BevelGears:
    """Return the pitch circles of two gears with the equation u x + v y = 0.

    Parameters
    ----------
    links
        Numbers of the two links.
    axes
        Unit vectors A and B (3,), which are fixed in the carrier. The carrier turns at the
        rate x about A relative to the first link. The second link turns at the rate y about
        B relative to the carrier.
    factors
        The factors u and v. Neither is zero.

    Returns
    -------
    The circles, in the order of the links if they touch from outside. Otherwise the smaller
    one, which rolls inside the larger one, comes first.
    """
    u, v = factors
    # The relative angular velocity of the links is x A + y B. It lies along the common line
    # of the pitch cones if u x + v y = 0.
    contact_line = unit_rows(v * axes[0] - u * axes[1])
    # A circle has two centres on the sphere, opposite to each other on its axis. The one
    # nearer to the contact line is taken, so that the radius is at most a quarter turn.
    centres = [axis if axis @ contact_line >= 0.0 else -axis for axis in axes]
    first, second = (
        PitchCircle(float(arc(centre, contact_line)), link, centre)
        for centre, link in zip(centres, links, strict=True)
    )
    # Gears that touch from outside have their centres on opposite sides of the contact
    # line.
    normals = np.cross(centres, contact_line)
    is_external = bool(normals[0] @ normals[1] < 0.0)
    # The smaller circle of an internal pair comes first, see `BevelGears`.
    if not is_external and second.radius < first.radius:
        first, second = second, first
    return BevelGears((first, second), is_external)


def _find_bevel_equations(
    hinges: Sequence[ImportedPair], equations: Floats
) -> Iterator[BevelEquation]:
    """Yield the equations of bevel gears that follow from the couplings of joints.

    A coupling is a linear equation between the rates of joints. Two bevel gears turn about
    two different axes on one link, their carrier. With their rates x and y relative to the
    carrier, their equation is u x + v y = 0.

    Each two links are tried as gears. Hinges lead from the first link over other links to
    the second one. The first hinges have to be about one axis, and all others about a
    second axis. The link between these is the carrier. If the couplings imply an equation
    u x + v y = 0 of the rotations about both axes, bevel gears on the two links have it
    too.

    Parameters
    ----------
    hinges
        All hinges.
    equations
        (couplings, hinges) equations between their rates.
    """
    for path in _link_paths(hinges):
        # Successive hinges about one axis are one group.
        axes = _group_by_axis(hinges, path)
        if len(axes) != 2:
            continue
        # x and y as sums of the rates of hinges, with their senses along the path.
        rotations = np.zeros((2, len(hinges)))
        for row, coaxial_hinges in enumerate(axes):
            for hinge, sense in coaxial_hinges.hinges:
                rotations[row, hinge] = sense
        # u and v, or None if the couplings imply no equation of x and y.
        factors = _find_implied_factors(rotations, equations)
        if factors is None:
            continue
        bevel_equation = BevelEquation(
            equation=factors @ rotations,
            links=(path.first_link, path.last_link),
            axes=(axes[0].axis, axes[1].axis),
            factors=(factors[0], factors[1]),
        )
        # A gear whose pitch circle is a point cannot roll. The radius (rad) is the angle
        # between the axis of the gear and the line of contact. If it is so small that both
        # count as one axis, the circle counts as a point.
        circles = bevel_equation.construct_gears().circles
        if min(circle.radius for circle in circles) > SAME_WHEEL_AXIS_SINE:
            yield bevel_equation


def _find_coaxial_equations(
    hinges: Sequence[ImportedPair], equations: Floats
) -> Iterator[CoaxialEquation]:
    """Yield the equations of coaxial gears that follow from the couplings of joints.

    Such gears are on two links that are hinged to a third one, the carrier, about the same
    axis. The equation is u x + v y = 0 for their rates x and y relative to the carrier. It
    has to be a linear combination of the couplings. Since coaxial gears do not touch, an
    idler wheel on the carrier transmits the motion from one to the other.

    Parameters
    ----------
    hinges
        All hinges.
    equations
        (couplings, hinges) equations between their rates.
    """
    for path in _link_paths(hinges):
        if len(path.hinges) != 2:
            continue
        axes = _group_by_axis(hinges, path)
        if len(axes) != 1:
            continue
        axis = axes[0].axis
        # Each hinge has a number, and its sense: -1 if the path goes against it.
        to_carrier, from_carrier = axes[0].hinges
        # Rotations of both links relative to the carrier. The path leads to the carrier by
        # its first hinge, so this rotation is reversed.
        rotations = np.zeros((2, len(hinges)))
        rotations[0, to_carrier.hinge] = -to_carrier.sense
        rotations[1, from_carrier.hinge] = from_carrier.sense
        factors = _find_implied_factors(rotations, equations)
        if factors is None:
            continue
        (carrier,) = {*hinges[to_carrier.hinge].links} & {*hinges[from_carrier.hinge].links}
        # The axis of the idler is at right angles to the axis of the gears. Any such
        # direction will do. The cross product with the coordinate axis that is farthest
        # from the axis of the gears is the most accurate one.
        farthest_axis = np.eye(3)[int(np.argmin(np.abs(axis)))]
        across = np.cross(axis, farthest_axis)
        yield CoaxialEquation(
            equation=factors @ rotations,
            links=(path.first_link, path.last_link),
            axis=axis,
            factors=(factors[0], factors[1]),
            carrier=carrier,
            idler_axis=across / np.linalg.norm(across),
        )


def _find_implied_factors(rotations: Floats, equations: Floats) -> Floats | None:
    """Return the factors (2,) of two rotations in an equation that the couplings imply.

    Couplings imply the equation u x + v y = 0 if the rates x and y of the two rotations
    satisfy it in every motion that the couplings allow.

    Parameters
    ----------
    rotations
        (2, hinges) two rotations as sums of the rates of hinges.
    equations
        (couplings, hinges) equations between the rates.

    Returns
    -------
    The factors, or None if there is no such equation, or if the couplings keep one or both
    of the rotations at zero.
    """
    # The motions that the couplings allow are the null space of `equations`. The right
    # singular vectors from `rank` on are a basis of it, one motion in each row.
    _, equation_values, motions = np.linalg.svd(equations)
    rank = int(np.sum(equation_values > COUPLING_TOLERANCE))
    # (2, allowed motions) the rates of both rotations in each motion. The factors combine
    # the two rows to zero. They exist if the rank is 1, so that the second singular value
    # is zero, and are the second left singular vector.
    allowed_rotations = rotations @ motions[rank:].T
    combinations, rotation_values, _ = np.linalg.svd(allowed_rotations)
    # With fewer than two motions there are fewer singular values; the others are zero.
    rotation_values = np.append(rotation_values, np.zeros(2 - len(rotation_values)))
    has_no_equation = rotation_values[1] > COUPLING_TOLERANCE
    are_both_at_rest = rotation_values[0] <= COUPLING_TOLERANCE
    if has_no_equation or are_both_at_rest:
        return None
    factors = combinations[:, 1]
    # A factor of zero means that the couplings keep the other rotation at zero.
    if np.min(np.abs(factors)) <= COUPLING_TOLERANCE:
        return None
    return factors


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
    """Yield the path between any two links of the tree of hinges, each path once.

    A path leads from the link with the smaller number to the other one.
    """
    ends = [hinge.links for hinge in hinges]
    links = sorted({link for links in ends for link in links})
    for first_link in links:
        path_by_link: dict[int, list[HingeOnPath]] = {first_link: []}
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
