"""Wheels on carriers: how a rolling contact relates the angles of pairs.

Two wheels that one link carries, each about the centre of its circle, turn relative to
it by angles f and g with sin(r) f - sin(s) g constant, r and s the radii, both centres
on the side of the contact's normal: a linear relation of the angles of the pairs between
them. That the wheels touch is then said twice, by the contact and by the carrier.

Wheels whose turning follows from the inputs: rolling circles on common carriers.

Where the relations of all contacts (`wheels`) fix the angles that they relate by those of
the inputs, these and the lengths rolled are linear functions of the inputs.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.coaxial_links import (
    SAME_AXIS_RAD,
    are_same_line,
    find_coaxial_links,
)
from spherekit.mechanism.joint import Joint, revolute
from spherekit.mechanism.joint_construction import make_joints, make_joints_in_pose
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.wheel_phase import Wheel, find_wheel_contact
from spherekit.planning.gear_mesh import SAME_LENGTH, GearMesh, _least, least_rolled

SINGULAR = 1e-9
"""Relations of a smaller relative singular value do not fix the angles."""
MOST_TEETH = 64
"""Whole turns by which wheels are tried whose contact repeats those of others."""


class GearTrain(NamedTuple):
    """The angles of pairs, and the lengths rolled, that follow from the inputs.

    `followers` are the numbers of pairs; `ratios` (followers, inputs) the rates of their
    angles, and `offsets` (followers,) these at inputs of zero, rad. Of `contacts`, pairs as
    well, `length_ratios` (contacts, inputs) and `lengths` (contacts,), rad, say the same;
    `rolled` (contacts, 2) are lengths along both circles where all angles are zero, NaN
    where a reference pose says how it is put together.
    """

    followers: tuple[int, ...]
    ratios: Floats
    offsets: Floats
    contacts: tuple[int, ...]
    length_ratios: Floats
    lengths: Floats
    rolled: Floats

    @property
    def numbers(self) -> list[float]:
        """The ratios and the offset of each follower."""
        return list(np.column_stack([self.ratios, self.offsets]).ravel().tolist())


RollingOnCarrier = tuple[GearMesh, Wheel, Wheel]
"""A contact with both its wheels, on a carrier."""


def rolled_angles(contact: RollingOnCarrier) -> dict[int, float]:
    """Return the factors by pair of the sum of angles that stays the same."""
    mesh, one, other = contact
    return mesh.relation((np.sin(one.radius), -np.sin(other.radius)))


def _lengths(contact: RollingOnCarrier, joints: Sequence[Joint]) -> list[float]:
    """Return the lengths (2,) along both circles, rad, where all angles are zero."""
    mesh, *wheels = contact
    turns = []
    for way in mesh.ways:
        turn = np.eye(3)
        for pair, side in way:
            joint = revolute(joints[pair])
            frames = joint.first, joint.second
            turn = frames[1 - side] @ frames[side].T @ turn
        turns.append(turn)
    return find_wheel_contact(wheels, turns)


def find_carried_contacts(mechanism: Mechanism) -> frozenset[int]:
    """Return the numbers of the rolling pairs whose wheels another link carries.

    That the wheels touch is then said twice, by the contact and by the link that carries
    both axes; of the two constraints of the contact one is left, that they roll.
    """
    joints = make_joints(mechanism)
    return frozenset(n for n in _rolling(joints) if on_carrier(mechanism, joints, n))


def _rolling(joints: Sequence[Joint]) -> list[int]:
    return [number for number, joint in enumerate(joints) if joint.rolling_variables]


def on_carrier(
    mechanism: Mechanism,
    joints: Sequence[Joint],
    number: int,
    apart: float = np.inf,
    pairs: Iterable[int] | None = None,
) -> RollingOnCarrier | None:
    """Return a rolling contact on its carrier; None unless a link carries two circles.

    It is the nearest one. On it the cosine of the arc between centres may miss that of
    circles that touch by `apart`. Only R pairs among `pairs`, where these are given, lead
    to the carrier.
    """
    profiles = mechanism.pairs[number].profiles or ()
    if (
        any(profile.round_axis is None for profile in profiles)
        or not joints[number].rolling_variables
    ):
        return None
    wheels = [
        Wheel.from_curve(track.curve, track.start)
        for track in joints[number].contact_profiles
    ]
    one, other = wheels
    numbers = range(len(joints)) if pairs is None else pairs
    hinges = {n: revolute(joints[n]) for n in numbers if joints[n].has_axis}
    axes = {n: (hinge.first[:, 2], hinge.second[:, 2]) for n, hinge in hinges.items()}
    ends, cosine = mechanism.ends, np.cos(one.radius - other.radius)
    tables = [
        find_coaxial_links(dict(enumerate(ends)), axes, link, wheel.centre)
        for link, wheel in zip(ends[number], wheels, strict=True)
    ]
    meshes = []
    for link in sorted(tables[0].keys() & tables[1].keys()):
        seen = [table[link] for table in tables]
        lines, turned, ways = zip(
            *((x.line, x.angle_signs, x.path) for x in seen), strict=True
        )
        if abs(np.vecdot(*lines) - cosine) <= apart and not are_same_line(*lines):
            meshes.append(GearMesh(number, turned, ways))
    if not meshes:
        return None
    return min(meshes, key=lambda mesh: len(mesh.pairs)), one, other


def wheel_train(
    mechanism: Mechanism,
    driven: Sequence[int],
    apart: float = SAME_AXIS_RAD,
    whole: bool = True,
) -> GearTrain | None:
    """Return how wheels follow the inputs, pairs `driven`.

    None without rolling contacts; of a `whole` train also if one of them has no common
    carrier, or if they do not just fix all the angles that they relate: else contacts are
    left out that turn by more than the inputs. Wheels are put together as the reference
    pose has them, without one so that they have rolled least at inputs of zero. Circles
    that miss each other by less than `apart` (rad) roll where they are
    nearest, as gears do.
    """
    joints = make_joints(mechanism)
    contacts = _rolling(joints)
    rolling = [on_carrier(mechanism, joints, number, apart) for number in contacts]
    made = [contact for contact in rolling if contact]
    if whole and len(made) < len(contacts):
        return None
    while made:
        rows, first = np.zeros((2, len(made), len(mechanism.pairs)))
        for k, contact in enumerate(made):
            for pair, factor in rolled_angles(contact).items():
                rows[k, pair] = factor
                first[k, pair] = factor * (pair in contact[0].turned[0])
        related = np.flatnonzero(np.any(rows, axis=0))
        followers = np.setdiff1d(related, driven).tolist()
        square = rows[:, followers]
        _, sizes, right = np.linalg.svd(square)
        rank = np.sum(sizes > SINGULAR * np.max(sizes, initial=0.0))
        loose = np.any(np.abs(right[rank:]) > SINGULAR, axis=0)
        held = ~np.any(square[:, loose], axis=1)
        if np.all(held) and (rank == len(made) or not whole):
            return _fixed(mechanism, list(driven), made, followers, rows, first)
        if whole or np.all(held):
            return None
        made = [contact for contact, fixed in zip(made, held, strict=True) if fixed]
    return None


def _fixed(
    mechanism: Mechanism,
    inputs: list[int],
    made: Sequence[RollingOnCarrier],
    followers: list[int],
    rows: Floats,
    first: Floats,
) -> GearTrain | None:
    """Return the train of contacts whose relations `rows` (contacts, pairs) fix all angles.

    `first` are the parts of the first wheels in these. Contacts that repeat others are
    put together as those say; None where they cannot be.
    """
    joints, reference = make_joints_in_pose(mechanism)
    basis: list[int] = []
    for k in range(len(made)):
        if np.linalg.matrix_rank(rows[[*basis, k]][:, followers]) > len(basis):
            basis.append(k)
    square, by_angles = rows[basis][:, followers], first[:, followers]
    ratios = np.asarray(-np.linalg.solve(square, rows[basis][:, inputs]))
    if max_abs(rows[:, followers] @ ratios + rows[:, inputs]) > SINGULAR:
        return None
    length_ratios = -(by_angles @ ratios + first[:, inputs])
    contacts = [mesh.contact for mesh, _, _ in made]
    unrolled = np.full((len(made), 2), np.nan)
    if reference is not None:
        at, turned, rolled = (
            reference[[mechanism.variables_of(pair)[0] for pair in pairs]]
            for pairs in (inputs, followers, contacts)
        )
        offsets, lengths = turned - ratios @ at, rolled - length_ratios @ at
    else:
        unrolled = np.array([_lengths(contact, joints) for contact in made])
        laps = TURN * np.abs(np.sin([[x.radius for x in wheels] for _, *wheels in made]))
        turns = least_rolled(unrolled[basis], laps[basis], by_angles[basis], square)
        if turns is None:
            return None
        unrolled[basis] += turns * laps[basis]
        offsets = np.linalg.solve(square, unrolled[basis, 0] - unrolled[basis, 1])
        counts = np.indices((2 * MOST_TEETH + 1,) * 2).reshape(2, -1).T - MOST_TEETH
        for k in set(range(len(made))) - set(basis):
            tried = unrolled[k] + counts * laps[k]
            away = np.abs(tried[:, 0] - tried[:, 1] - rows[k, followers] @ offsets)
            fits = tried[away < SAME_LENGTH]
            if not len(fits):
                return None
            unrolled[k] = fits[_least(fits[:, :1] - by_angles[k] @ offsets)]
        lengths = unrolled[:, 0] - by_angles @ offsets
    return GearTrain(
        tuple(followers),
        ratios,
        offsets,
        tuple(contacts),
        length_ratios,
        lengths,
        unrolled,
    )
