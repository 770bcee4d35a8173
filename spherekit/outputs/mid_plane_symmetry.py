"""Finds and proves that a mechanism has a mid-plane symmetric architecture.

The architecture is found from the graph and the sizes alone:

- legs of three R pairs with equal arcs lead from the base to the output link,
- the axes of the legs at the output link are the mirror image of those at the base,
- links that are hinged to the elbows all turn about one axis at right angles to their
  hinges, so that the elbows lie in one plane.

The architecture is proven numerically: with all links placed by the closed form, every pair
has to close, and the velocity equations have to leave two degrees of freedom. The closed
form then gives all configurations nearby.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.triangle import arc, frame_from
from spherekit.geometry.vectors import cross, max_abs, unit_rows
from spherekit.mechanism.elements import Output
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.joint import Joint, revolute
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.output_choice import chosen_output
from spherekit.outputs.mid_plane import MidPlane
from spherekit.outputs.mid_plane_architecture import (
    Leg,
    MidPlaneArchitecture,
    PairAxis,
    axis_in,
)
from spherekit.wording import counted, listing

EQUAL_SIZE_RAD = 1e-9
"""Difference (rad) of arcs and axes below which they are taken to be meant equal.

Larger: mechanisms that are not symmetric are accepted here, and refused by the proof.
Smaller: rounding errors of equal sizes count as differences.
"""

PROOF_RESIDUAL_RAD = 1e-12
"""Largest angle (rad), in the proof, between a pair axis as both its links carry it.

Larger: mechanisms with slightly different sizes are accepted. Smaller: rounding errors make
the proof fail.
"""

LegLinks = tuple[int, int]
"""Numbers of a leg's links, first the one at the base."""


@checked(ModelError)
def mid_plane_form(
    mechanism: AnyMechanism, output: str | None = None
) -> MidPlaneArchitecture:
    """Return closed-form kinematics of a mechanism with mid-plane symmetric architecture.

    The result computes poses, driving angles and rates from formulas. For example,
    `orientations` gives the pose of the end effector for a mid-plane, and `plane.solutions`
    gives all sets of driving angles for it.

    In this architecture the end effector is the mirror image of the base in a plane, the
    mid-plane. The normal of the mid-plane determines the pose of the end effector. At least
    three legs of two links with equal arcs lead from the base to the end effector. The
    elbow of a leg is the axis between its two links. Further links, the carriers, hold all
    elbows in the mid-plane. A carrier is hinged to an elbow and turns about the normal of
    the mid-plane. These two axes of a carrier are perpendicular to each other.

    Parameters
    ----------
    mechanism
        A mechanism of R and arc-prismatic pairs, driven at two pairs of the base.
    output
        Name of the output that is the end effector; may be left out if there is one.

    Raises
    ------
    ModelError
        If the mechanism has no such architecture. The message states the reason.
    """
    # 1. The link that the output is relative to becomes the base.
    mechanism = mechanism_of(mechanism)
    declared_output = chosen_output(mechanism, output)
    grounded = replace(mechanism, ground=declared_output.relative_to)
    for pair in grounded.pairs:
        if not pair.kind.has_axis:
            raise _error(
                grounded,
                f'pair "{pair.name}" is a contact pair; only R and arc-prismatic pairs fit',
            )

    # 2. Find legs and carriers in the graph of links.
    joints = make_joints(grounded)
    effector = grounded.link_number[declared_output.link]
    legs = _find_legs(grounded, joints, effector)
    structure = _find_elbow_carriers(grounded, joints, effector, legs)
    carriers = structure.elbow_carriers

    # 3. Carriers must hold the elbows of all legs, and all links must be parts of this
    # structure. The leg -1 stands for the normal of the mid-plane.
    held_legs = {
        pair_axis.leg
        for pair, pair_axis in structure.pair_axes.items()
        if not carriers.isdisjoint(grounded.ends[pair])
    }
    held_legs -= {-1}
    if len(held_legs) < 3 or len(held_legs) < len(legs):
        raise _error(
            grounded,
            "it needs at least three legs of two links with equal arcs, and other links "
            "that hold the middle axes of all legs in one plane; found "
            f"{counted(len(legs), 'leg')} of this kind, and links that hold the middle "
            f"axes of {counted(len(held_legs), 'leg')}",
        )
    leg_links = {link for links in legs.values() for link in links}
    other_links = set(range(len(grounded.links))) - {0, effector} - leg_links - carriers
    if other_links:
        names = listing(grounded.links[link] for link in sorted(other_links))
        raise _error(grounded, f"links {names} neither belong to a leg nor hold an elbow")

    _check_right_angles(grounded, joints, structure)

    # 4. Prove by numbers that all pairs close.
    form = _make_architecture(grounded, joints, declared_output, legs, structure.pair_axes)
    gap, freedoms = form.proof()
    if not (gap < PROOF_RESIDUAL_RAD and freedoms == 2):
        raise _error(
            grounded,
            f"with its halves placed as mirror images, its loops stay open by {gap:.3g} "
            f"rad, and its mobility by rank is {freedoms}, not 2",
        )
    return form


def _error(mechanism: Mechanism, reason: str) -> ModelError:
    """Return the error that a mechanism has no mid-plane architecture."""
    return ModelError(f"{mechanism.name} has no mid-plane symmetric architecture: {reason}")


def _find_legs(
    mechanism: Mechanism, joints: Sequence[Joint], effector: int
) -> dict[Leg, LegLinks]:
    """Return the legs of two links from the base to the end effector, with their links.

    A leg is a chain: base, base pair, near link, elbow pair, far link, tip pair, end
    effector.

    Parameters
    ----------
    mechanism, joints
        The mechanism with its base as the ground, and the joints of its pairs.
    effector
        Number of the end effector.

    Returns
    -------
    By the numbers of the three pairs of a leg: the numbers of its near and far link.

    Raises
    ------
    ModelError
        If there is no leg, or if the arcs of the two links of a leg differ.
    """

    def list_neighbours(link: int) -> list[tuple[int, int]]:
        """Return the pairs of a link with the links on their other sides."""
        # The sum of both ends less one of them is the other one.
        return [
            (pair, sum(ends) - link)
            for pair, ends in enumerate(mechanism.ends)
            if link in ends
        ]

    # 1. All chains of three pairs from the base (link 0) to the end effector.
    legs: dict[Leg, LegLinks] = {}
    for base_pair, near_link in list_neighbours(0):
        for elbow, far_link in list_neighbours(near_link):
            for tip, end_link in list_neighbours(far_link):
                is_leg = {near_link, far_link}.isdisjoint({0, effector})
                if end_link == effector and is_leg:
                    legs[base_pair, elbow, tip] = (near_link, far_link)
    if not legs:
        raise _error(mechanism, "no leg of two links joins the base to the output")

    # 2. Both links of a leg must have the same arc.
    for (base_pair, elbow, tip), (near_link, far_link) in legs.items():
        near_arc = arc(
            axis_in(mechanism, joints, base_pair, near_link),
            axis_in(mechanism, joints, elbow, near_link),
        )
        far_arc = arc(
            axis_in(mechanism, joints, tip, far_link),
            axis_in(mechanism, joints, elbow, far_link),
        )
        if abs(near_arc - far_arc) > EQUAL_SIZE_RAD:
            raise _error(
                mechanism,
                f"the arcs of links {mechanism.links[near_link]} and "
                f"{mechanism.links[far_link]} differ, {np.degrees(near_arc):.9g} and "
                f"{np.degrees(far_arc):.9g} deg",
            )
    return legs


@dataclass(frozen=True)
class _ElbowStructure:
    """Roles of pair axes and links in a mechanism with a mid-plane.

    Base and output link mirror each other in the mid-plane. A leg is two links that join
    the base to the output link. Its elbow is the axis between these two links. The elbows
    of all legs lie in the mid-plane. Further links, the carriers, keep the elbows in this
    plane. Mechanisms that do not have this structure are rejected.

    Attributes
    ----------
    pair_axes
        The kind of the axis of each pair, by the number of the pair. An axis is an axis of
        a leg (at the base, at the output link, or the elbow) or the normal of the
        mid-plane.
    elbow_carriers
        Numbers of the carriers. Each is hinged to a leg along the elbow of the leg. The
        carriers are joined to each other by pairs along the normal of the mid-plane.
    """

    pair_axes: dict[int, PairAxis]
    elbow_carriers: set[int]


def _find_elbow_carriers(
    mechanism: Mechanism,
    joints: Sequence[Joint],
    effector: int,
    legs: Mapping[Leg, LegLinks],
) -> _ElbowStructure:
    """Return the kind of every pair axis, and the links that hold the elbows in a plane.

    A leg has an axis at the base, one at the end effector (tip), and the elbow between its
    two links. Every other pair (joint) belongs to a carrier, a link outside of legs, base
    and end effector. A pair between a carrier and a leg is assumed to be on the axis of the
    elbow. All other pairs of carriers are assumed to be on the normal of the mid-plane. A
    later proof shows whether these assumptions are true.

    Parameters
    ----------
    mechanism, joints
        The mechanism with its base as the ground, and the joints of its pairs.
    effector
        Number of the end effector.
    legs
        The legs with their links.
    """
    axis = partial(axis_in, mechanism, joints)
    ends = mechanism.ends
    leg_of_link = {
        link: number for number, links in enumerate(legs.values()) for link in links
    }
    elbows = [elbow for _, elbow, _ in legs]
    # 1. The pairs of the legs.
    pair_axes: dict[int, PairAxis] = {}
    for number, (base_pair, elbow, tip) in enumerate(legs):
        pair_axes[base_pair] = PairAxis("base", number, 1.0)
        pair_axes[elbow] = PairAxis("elbow", number, 1.0)
        pair_axes[tip] = PairAxis("tip", number, 1.0)

    # 2. The pairs between legs and carriers, and those between carriers.
    links_without_carriers = {0, effector, *leg_of_link}
    hinged_links: set[int] = set()
    carrier_pairs: list[int] = []
    for pair, (first_link, second_link) in enumerate(ends):
        if first_link in leg_of_link:
            leg_link = first_link
            other_link = second_link
        else:
            leg_link = second_link
            other_link = first_link
        if leg_link in leg_of_link and other_link not in links_without_carriers:
            # A hinge of a carrier on a leg. It may point along the elbow or opposite.
            leg = leg_of_link[leg_link]
            elbow_axis = axis(elbows[leg], leg_link)
            sense = float(np.copysign(1.0, axis(pair, leg_link) @ elbow_axis))
            pair_axes[pair] = PairAxis("elbow", leg, sense)
            hinged_links.add(other_link)
        elif links_without_carriers.isdisjoint({first_link, second_link}):
            carrier_pairs.append(pair)

    # 3. The common axis of the carriers, by the number of the carrier and in its own axes.
    # Pairs between carriers lead from one carrier to the next; their axes may be opposite,
    # and the signs make the common axis have the same sense in all carriers.
    normals: dict[int, Floats] = {}
    if carrier_pairs:
        first_carrier = ends[carrier_pairs[0]][:1]
        for pair, link, next_link in find_spanning_tree(ends, first_carrier, carrier_pairs):
            normal = normals.setdefault(link, axis(pair, link))
            sense = float(np.copysign(1.0, axis(pair, link) @ normal))
            normals[next_link] = sense * axis(pair, next_link)
    # Pairs that are not in the mapping yet are the pairs along the normal.
    for pair in range(len(ends)):
        link = ends[pair][0]
        sense = float(np.copysign(1.0, axis(pair, link) @ normals.get(link, np.ones(3))))
        pair_axes.setdefault(pair, PairAxis("normal", -1, sense))
    return _ElbowStructure(pair_axes, elbow_carriers=hinged_links & set(normals))


def _check_right_angles(
    mechanism: Mechanism, joints: Sequence[Joint], structure: _ElbowStructure
) -> None:
    """Raise `ModelError` if a carrier has an elbow axis not at right angles to the normal.

    An elbow is the middle axis of a leg. A carrier is a link that keeps elbows in the
    mid-plane. It has axes along elbows and along the normal of the mid-plane. If an elbow
    lies in the mid-plane, it is at right angles to the normal. A carrier with another angle
    cannot keep its elbow in the mid-plane, so the mechanism has another architecture.
    """
    for link in structure.elbow_carriers:
        # Axes of the carrier by their kind.
        axes: dict[str, list[Floats]] = {"elbow": [], "normal": []}
        for pair, pair_axis in structure.pair_axes.items():
            if link in mechanism.ends[pair]:
                axes[pair_axis.kind].append(axis_in(mechanism, joints, pair, link))
        if max_abs(np.array(axes["elbow"]) @ np.array(axes["normal"]).T) > EQUAL_SIZE_RAD:
            raise _error(
                mechanism,
                f"in link {mechanism.links[link]}, the axis of an elbow is not at right "
                "angles to the normal of the mid-plane",
            )


def _make_architecture(
    mechanism: Mechanism,
    joints: tuple[Joint, ...],
    output: Output,
    legs: Mapping[Leg, LegLinks],
    pair_axes: Mapping[int, PairAxis],
) -> MidPlaneArchitecture:
    """Return the mid-plane architecture from its legs and pair axes, without a proof.

    Parameters
    ----------
    mechanism, joints
        The mechanism with its base as the ground, and the joints of its pairs.
    output
        The output whose link is the end effector.
    legs
        The legs with their links.
    pair_axes
        What the axis of each pair (joint) is: an axis of a leg or the normal of the
        mid-plane.

    Raises
    ------
    ModelError
        If other pairs than two at the base are driven, their axes are on one line, or the
        axes on the end effector are not the mirror image of those on the base.
    """
    leg_of_base_pair = {
        mechanism.pairs[base_pair].name: number
        for number, (base_pair, _, _) in enumerate(legs)
    }
    inputs = mechanism.input_pairs
    if len(inputs) != 2 or not set(inputs) <= set(leg_of_base_pair):
        raise _error(
            mechanism,
            f"the inputs are {listing(inputs)}, but two of the pairs at the base, "
            f"{listing(leg_of_base_pair)}, have to be driven",
        )
    driven_legs = [leg_of_base_pair[name] for name in inputs]

    # Mirror axes: z along the product of both driven axes, x half-way between them.
    axis = partial(axis_in, mechanism, joints)
    effector = mechanism.link_number[output.link]
    base_axes = np.stack([axis(base_pair, 0) for base_pair, _, _ in legs])
    tip_axes = np.stack([axis(tip, effector) for _, _, tip in legs])
    # The axis of each elbow in the link at the base.
    elbow_axes = np.stack(
        [axis(elbow, near_link) for (_, elbow, _), (near_link, _) in legs.items()]
    )
    first_driven_axis, second_driven_axis = base_axes[driven_legs]
    product = cross(first_driven_axis, second_driven_axis)
    if np.linalg.norm(product) < EQUAL_SIZE_RAD:
        raise _error(mechanism, "the axes of both driven pairs lie on one line")
    frame = frame_from(
        unit_rows(product), unit_rows(first_driven_axis + second_driven_axis)
    )
    mirror_axes = base_axes @ frame

    # The improper orthogonal matrix that maps the axes of the end effector best to those of
    # the base (orthogonal Procrustes problem).
    # The sign of the last diagonal entry gives the determinant -1.
    left_vectors, _, right_vectors = np.linalg.svd(mirror_axes.T @ tip_axes)
    last_entry = -np.linalg.det(left_vectors @ right_vectors)
    image = left_vectors @ np.diag([1.0, 1.0, last_entry]) @ right_vectors
    if max_abs(tip_axes @ image.T - mirror_axes) > EQUAL_SIZE_RAD:
        raise _error(
            mechanism,
            "the axes on the end effector are not the mirror image of those on the base",
        )

    # The frames of the pairs at the base, from which their variables are counted.
    base_pairs = [base_pair for base_pair, _, _ in legs]
    base_is_first = np.array([mechanism.ends[pair][0] == 0 for pair in base_pairs])
    base_joints = [revolute(joints[pair]) for pair in base_pairs]
    # (legs, 2, 3, 3) frames of the pairs in the base and in the near link.
    pair_frames = np.array([(joint.first, joint.second) for joint in base_joints])
    pair_frames[~base_is_first] = pair_frames[~base_is_first, ::-1]
    base_frames, link_frames = np.swapaxes(pair_frames, 0, 1)
    elbow_components = np.vecmat(elbow_axes, link_frames)
    plane = MidPlane(
        axes=mirror_axes,
        arcs=arc(elbow_axes, link_frames[..., 2]),
        driven=driven_legs,
        dials=frame.T @ base_frames,
        # At the variable 0 the frames coincide, and the elbow has the azimuth that it has
        # in the near link.
        phases=np.arctan2(elbow_components[:, 1], elbow_components[:, 0]),
        senses=np.where(base_is_first, 1.0, -1.0),
    )
    return MidPlaneArchitecture(
        mechanism=mechanism,
        joints=joints,
        plane=plane,
        effector=effector,
        frame=frame,
        image=image,
        legs=tuple(legs),
        along=tuple(pair_axes[pair] for pair in sorted(pair_axes)),
        output=output,
    )
