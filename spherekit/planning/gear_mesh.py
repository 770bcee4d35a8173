"""Rolling contacts of two wheels on a carrier, and how they relate the angles of pairs.

A link is the carrier of a contact if both wheels rotate relative to it, each about the
centre of its circle. Rolling keeps sin(r) f - sin(s) g constant, with the angles f and g of
the two rotations and the radii r and s of the circles (rad on the unit sphere). A circle
has two opposite centres. For both circles the centre on the same side of their common
tangent is taken. With this choice, f and g change in the same sense. Each angle is a sum of
pair variables with signs, so the contact is one linear relation of pair variables.

A rolling contact has two constraints: the wheels touch, and they roll. The carrier already
ensures that they touch. Only the second constraint is therefore independent.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.coaxial_links import are_same_line, find_coaxial_links
from spherekit.mechanism.joint import Joint, revolute
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.wheel_phase import Wheel

PairPath = tuple[tuple[int, int], ...]
"""R pairs that lead from one link to another.

Each item of the path has the index of the pair, and which of its two links (0 or 1) comes
first on the way.
"""


class GearMesh(NamedTuple):
    """A rolling contact of two wheels on a carrier, as a linear relation of pair angles.

    The carrier is a link relative to which both wheels rotate about their centres, by the
    angles f and g. Their circles have the radii r and s (rad) on the unit sphere. While the
    wheels roll, the point of contact moves by the same length along both circles: sin(r) f
    on the first one, sin(s) g on the second one. So sin(r) f - sin(s) g is constant.

    Wheels that touch from outside turn in opposite senses about their own centres. So one
    of their angles is counted about the opposite point of the sphere. With this choice, f
    and g always grow together.

    Attributes
    ----------
    contact
        Index of the rolling contact among the pairs of the mechanism.
    angle_signs
        For the first and the second wheel: the R pairs from the wheel to the carrier with
        their signs, 1 or -1. The angle of the wheel relative to the carrier is the sum of
        the pair variables times these signs.
    paths
        The same pairs in their order from each wheel to the carrier. Each item has the
        index of the pair, and which of its two links (0 or 1) is nearer to the wheel.
        Rotations from the wheel to the carrier are multiplied in this order.
    """

    contact: int
    angle_signs: tuple[Mapping[int, float], Mapping[int, float]]
    paths: tuple[PairPath, PairPath]

    @property
    def pairs(self) -> set[int]:
        """Indices of the R pairs whose variables the rolling contact relates."""
        return {*self.angle_signs[0], *self.angle_signs[1]}

    def angle_factors(self, first_sine: Any, second_sine: Any) -> dict[int, Any]:
        """Return the factor of each pair variable in sin(r) f - sin(s) g.

        This expression is constant while the wheels roll on each other: sin(r) f and sin(s)
        g are the lengths that they have rolled. So the factors are the coefficients of a
        linear equation between pair variables.

        The first wheel has the radius r (rad on the unit sphere), and the second one s. The
        wheels rotate by f and g relative to their carrier. If they touch from outside, one
        of the angles is counted in the opposite sense, so that f and g grow together. Each
        angle is a sum of variables of R pairs, each times a sign, 1 or -1 (`angle_signs`).

        Parameters
        ----------
        first_sine, second_sine
            sin(r) and sin(s): floats, or balls (floats with error bounds).
        """
        signs_of_first_wheel, signs_of_second_wheel = self.angle_signs
        factor_by_pair = {}
        # The axes of these pairs are the axes of the wheels, so no pair belongs to both.
        for pair, sign in signs_of_first_wheel.items():
            factor_by_pair[pair] = first_sine if sign > 0.0 else -first_sine
        for pair, sign in signs_of_second_wheel.items():
            factor_by_pair[pair] = -second_sine if sign > 0.0 else second_sine
        return factor_by_pair


def reverse_path(path: PairPath) -> PairPath:
    """Return the same path from its end to its start."""
    return tuple((pair, 1 - side) for pair, side in reversed(path))


class CarriedContact(NamedTuple):
    """A rolling contact of two wheels on a carrier, with the circles of the wheels.

    The carrier is a link relative to which both wheels rotate about their centres, by the
    angles f and g. The circles have the radii r and s (rad) on the unit sphere. While the
    wheels roll, the point of contact moves by the same length along both circles, sin(r) f
    and sin(s) g. So sin(r) f - sin(s) g is constant.

    Wheels that touch from outside turn in opposite senses about their own centres, so that
    sin(r) f + sin(s) g would be constant. For one of the wheels, the opposite point of the
    sphere is therefore taken as centre. The angle about this centre has the opposite sign.
    The radius is 180 degrees minus the usual radius, with the same sine.

    Attributes
    ----------
    mesh
        The relation, with each angle as a sum of variables of R pairs with signs.
    first_wheel, second_wheel
        Circles of the first and the second link of the contact.
    """

    mesh: GearMesh
    first_wheel: Wheel
    second_wheel: Wheel

    @property
    def wheels(self) -> tuple[Wheel, Wheel]:
        """The wheel of the first and the wheel of the second link of the contact."""
        return self.first_wheel, self.second_wheel

    def angle_factors(self) -> dict[int, float]:
        """Return the factors of the R pair variables in sin(r) f - sin(s) g = constant."""
        return self.mesh.angle_factors(
            first_sine=np.sin(self.first_wheel.radius),
            second_sine=np.sin(self.second_wheel.radius),
        )


def find_carried_contacts(mechanism: Mechanism) -> frozenset[int]:
    """Return the indices of the rolling contacts whose wheels have a carrier."""
    joints = make_joints(mechanism)
    return frozenset(
        number
        for number in rolling_contacts(joints)
        if find_carried_contact(mechanism, joints, number)
    )


def rolling_contacts(joints: Sequence[Joint]) -> list[int]:
    """Return the indices of the rolling contacts among joints."""
    return [number for number, joint in enumerate(joints) if joint.rolling_variables]


def find_carried_contact(
    mechanism: Mechanism,
    joints: Sequence[Joint],
    number: int,
    cosine_tolerance: float = np.inf,
    pairs: Iterable[int] | None = None,
) -> CarriedContact | None:
    """Find the link that carries both wheels of a rolling contact.

    Both wheels rotate relative to this carrier, each about the centre of its circle. If
    there are several carriers, the one that is reached by the fewest pairs is chosen.

    Parameters
    ----------
    mechanism
        The mechanism.
    joints
        The joints of all its pairs.
    number
        Index of the contact.
    cosine_tolerance
        Largest error of the arc between the centres of the two circles on the carrier,
        measured by its cosine. An arc without an error lets the circles touch exactly.
    pairs
        Indices of the pairs that may lead to the carrier; by default all.

    Returns
    -------
    The contact on its carrier. None if the pair does not roll, if a profile is no circle,
    or if the wheels have no carrier.
    """
    profiles = mechanism.pairs[number].profiles or ()
    has_other_profile = any(profile.round_axis is None for profile in profiles)
    if has_other_profile or not joints[number].rolling_variables:
        return None
    first_wheel, second_wheel = (
        Wheel.from_curve(track.curve, track.start)
        for track in joints[number].contact_profiles
    )
    allowed_pairs = range(len(joints)) if pairs is None else pairs
    # The axes of all R pairs in both of their links, by the index of the pair.
    axes: dict[int, tuple[Floats, Floats]] = {}
    for pair in allowed_pairs:
        if joints[pair].has_axis:
            hinge = revolute(joints[pair])
            axes[pair] = (hinge.first[:, 2], hinge.second[:, 2])
    # For each wheel, the links relative to which it rotates about its centre, by number. A
    # carrier is such a link of both wheels.
    first_link, second_link = mechanism.ends[number]
    links_by_pair = dict(enumerate(mechanism.ends))
    first_links = find_coaxial_links(links_by_pair, axes, first_link, first_wheel.centre)
    second_links = find_coaxial_links(links_by_pair, axes, second_link, second_wheel.centre)
    # Circles with the radii r and s that touch have centres at the arc r - s. (For both
    # circles, the centre on the same side of their common tangent is used.)
    touching_cosine = np.cos(first_wheel.radius - second_wheel.radius)
    meshes = []
    for carrier in sorted(first_links.keys() & second_links.keys()):
        first = first_links[carrier]
        second = second_links[carrier]
        # `line` is the direction to the centre of the wheel, in the axes of the carrier.
        deviation = abs(np.vecdot(first.line, second.line) - touching_cosine)
        # Wheels that rotate about the same line cannot roll on each other.
        if deviation <= cosine_tolerance and not are_same_line(first.line, second.line):
            meshes.append(
                GearMesh(
                    number,
                    angle_signs=(first.angle_signs, second.angle_signs),
                    paths=(first.path, second.path),
                )
            )
    if not meshes:
        return None
    nearest = min(meshes, key=lambda mesh: len(mesh.pairs))
    return CarriedContact(nearest, first_wheel, second_wheel)
