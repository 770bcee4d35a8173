"""Evaluates the pairs of a mechanism: their frames, profiles and measured angles.

`spherekit.mechanism.joint` defines the kinematics of each kind of pair. Here the pairs of
one kind are evaluated together, which takes one array operation instead of many.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.triangle import arc
from spherekit.mechanism.joint import ContactProfile, Joint, Kind, PairStates, Revolute
from spherekit.tolerances import EQUAL_CURVATURE

IndexRange = slice | list[int]
"""Indices along an array axis, as a slice if they have no gap and otherwise as a list."""


def pair_angle(first_frames: Floats, second_frames: Floats) -> Floats:
    """Return the angles (...) of revolute pairs (rad), from the frames of their two links.

    Parameters
    ----------
    first_frames, second_frames
        (..., 3, 3) frames of the pair in its first and its second link, turned to common
        axes. Columns are x, y and z, with z along the pair axis.

    Returns
    -------
    Angle about z from the x axis of the first frame to the x axis of the second.
    """
    # The second x axis has the components cos and sin of the angle along the first x and y.
    x_of_second = second_frames[..., 0]
    cosine = np.sum(first_frames[..., 0] * x_of_second, axis=-1)
    sine = np.sum(first_frames[..., 1] * x_of_second, axis=-1)
    return np.arctan2(sine, cosine)


def measure_pair_angles(
    ends: Sequence[tuple[int, int]], joints: Sequence[Revolute], rotations: Floats
) -> tuple[Floats, Floats]:
    """Measure the angles of revolute pairs between links with known orientations.

    The gaps of the axes show whether the orientations fit together.

    Parameters
    ----------
    ends
        Indices of the first and the second link of each pair.
    joints
        The geometry of each pair: its frame (z along the axis) in each of its two links.
    rotations
        (n, links, 3, 3) rotations from link axes to common axes.

    Returns
    -------
    angles
        (n, pairs) variables of the pairs (rad).
    axis_gaps
        (n, pairs) angle (rad) between the axis of the pair fixed in its first link and that
        fixed in its second link. Zero if the orientations close all loops.
    """
    first_links, second_links = np.array(ends).T
    first_frames = rotations[:, first_links] @ np.array([joint.first for joint in joints])
    second_frames = rotations[:, second_links] @ np.array(
        [joint.second for joint in joints]
    )
    angles = pair_angle(first_frames, second_frames)
    return angles, arc(first_frames[..., 2], second_frames[..., 2])


def enumerate_joints(joints: Sequence[Joint]) -> Iterator[tuple[int, int, Joint]]:
    """Yield the index of each pair, the index of its first variable, and its joint."""
    first_variable = 0
    for pair, joint in enumerate(joints):
        yield pair, first_variable, joint
        first_variable += joint.variable_count


def iterate_contact_profiles(
    joints: Sequence[Joint],
) -> Iterator[tuple[int, tuple[ContactProfile, ...]]]:
    """Yield the index of each contact pair, and the profiles of its two links.

    A contact pair joins two links by rolling or sliding profiles. Revolute pairs are left
    out. A joint numbers its variables from 0. In the result, `ContactProfile.variable` is
    an index among the variables of all joints, with which callers find the value of the
    variable in a configuration.
    """
    for pair, first_variable, joint in enumerate_joints(joints):
        profiles = joint.contact_profiles
        if profiles:
            renumbered = [
                profile._replace(variable=first_variable + profile.variable)
                for profile in profiles
            ]
            yield pair, tuple(renumbered)


def list_rolling_variables(joints: Sequence[Joint]) -> list[tuple[int, Joint]]:
    """Return the variables that count how far two wheels have rolled on each other.

    A joint (the geometry of a pair) has one or more variables, numbered through all joints.

    Returns
    -------
    For each such variable its index among the variables of all joints, and its joint.
    """
    return [
        (first_variable + variable, joint)
        for _, first_variable, joint in enumerate_joints(joints)
        for variable in joint.rolling_variables
    ]


class JointsOfKind(NamedTuple):
    """The pairs of one kind, with their positions in a list of pairs of several kinds.

    Pairs of one kind are evaluated together, in one array operation. A `Joint` is the
    geometry of a pair.

    Attributes
    ----------
    kind
        The class of the joints, for example `Revolute`.
    joints
        The geometry of each pair of this kind: its axis, or the profiles of a contact.
    pairs
        Indices of these pairs in the list of all kinds.
    variables
        Indices of their variables among the variables of all pairs in that list.
    """

    kind: Kind
    joints: tuple[Joint, ...]
    pairs: IndexRange
    variables: IndexRange


@lru_cache(maxsize=512)
def group_joints_by_kind(joints: tuple[Joint, ...]) -> tuple[JointsOfKind, ...]:
    """Return the joints grouped by kind (revolute, rolling, sliding).

    Joints of one kind are then evaluated together, in one array operation. Kinds are in the
    order of their first occurrence. The results are cached, because the same joints are
    evaluated again and again.
    """
    # Variables are numbered pair after pair. For each kind: indices of its pairs and
    # variables.
    pairs_by_kind: dict[Kind, list[int]] = {}
    variables_by_kind: dict[Kind, list[int]] = {}
    for pair, first_variable, joint in enumerate_joints(joints):
        kind = type(joint)
        pairs_by_kind.setdefault(kind, []).append(pair)
        variables_by_kind.setdefault(kind, []).extend(
            range(first_variable, first_variable + joint.variable_count)
        )
    kinds = []
    for kind, pairs in pairs_by_kind.items():
        joints_of_kind = JointsOfKind(
            kind=kind,
            joints=tuple(joints[pair] for pair in pairs),
            pairs=_as_slice(pairs),
            variables=_as_slice(variables_by_kind[kind]),
        )
        kinds.append(joints_of_kind)
    return tuple(kinds)


def _as_slice(indices: list[int]) -> IndexRange:
    """Return rising indices, as a slice if they have no gap. A slice copies nothing."""
    start = indices[0]
    stop = indices[-1] + 1
    return slice(start, stop) if stop - start == len(indices) else indices


def evaluate_pair_states(joints: tuple[Joint, ...], values: Floats) -> PairStates:
    """Return the frames and curvatures of all pairs (joints) at n samples.

    The states contain the frame of each pair in its first and in its second link, and for
    contacts the curvatures of both profiles.

    Parameters
    ----------
    joints
        The geometry of each pair, for example its axis, or the profiles of a contact.
    values
        (n, variables) values of their variables (rad), pair after pair.
    """
    # All pairs of one kind (revolute, rolling, sliding) are evaluated together.
    n = len(values)
    states_of_kinds: list[PairStates] = []
    pairs_of_kinds: list[IndexRange] = []
    for kind, joints_of_kind, pairs, variables in group_joints_by_kind(joints):
        values_by_joint = values[:, variables].reshape(
            n, len(joints_of_kind), kind.variable_count
        )
        states_of_kinds.append(kind.evaluate_states(joints_of_kind, values_by_joint))
        pairs_of_kinds.append(pairs)
    # The states of a single kind are in the order of the pairs already.
    if len(states_of_kinds) == 1:
        return states_of_kinds[0]
    # Put the results of the kinds back into the order of the pairs.
    states = PairStates.blank(n, len(joints))
    for pairs, states_of_kind in zip(pairs_of_kinds, states_of_kinds, strict=True):
        states.assign_pairs(pairs, states_of_kind)
    return states


def has_penetration(joints: Sequence[Joint], states: PairStates) -> Bools:
    """Return a mask (n,) of the samples at which profiles in contact enter each other.

    Two profiles touch at a point with a common tangent. The first body is on the left of
    its profile, the second body on the right of its own. The curvature of a profile is
    positive if the profile turns to the left.

    If the second profile turns more to the left, the strip between the profiles belongs to
    both bodies, so the bodies enter each other. Equal curvatures (up to `EQUAL_CURVATURE`)
    also give True, because such profiles do not determine the motion.

    Parameters
    ----------
    joints
        The geometry of all pairs, contacts and others.
    states
        The curvatures and frames of all pairs at n samples.
    """
    is_contact = [bool(joint.contact_profiles) for joint in joints]
    curvatures = states.curvatures[:, is_contact]
    first_curvature = curvatures[..., 0]
    second_curvature = curvatures[..., 1]
    is_entering = first_curvature - second_curvature < EQUAL_CURVATURE
    return np.any(is_entering, axis=1)
