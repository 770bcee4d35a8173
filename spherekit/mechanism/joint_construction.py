"""Construction of the joints of a mechanism from its geometry and the profiles of contacts.

R pairs get their frames from `spherekit.mechanism.pair_frames`. Contacts get the curves of
their profiles.
"""

from functools import lru_cache

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.curve_contact import nearest_frames
from spherekit.geometry.profile_curve import Curve, circle, fourier, great_circle, through
from spherekit.mechanism.elements import Pair, PoseGeometry, Profile
from spherekit.mechanism.joint import Ends, Joint, Revolute, Rolling, Sliding
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import pair_frames

PROFILE_GAP_RAD = 1e-6
"""Largest angle (rad) between the frames of two profiles that are taken to touch.

Profiles with a smaller gap are moved so that they touch exactly. Larger: rougher numbers
are accepted and changed more. Smaller: rounded numbers are refused.
"""


def make_joints(
    mechanism: Mechanism, profile_gap: float = PROFILE_GAP_RAD
) -> tuple[Joint, ...]:
    """Return the joints of a mechanism in the order of its pairs.

    A pair has names of links and numbers from the mechanism file. Its joint has the axis or
    the contact curves that follow from these numbers.

    Parameters
    ----------
    mechanism
        The mechanism. Its geometry consists of sizes of links, or of a reference pose (one
        configuration with all axes).
    profile_gap
        Largest angle (rad) between two contact profiles (curves) in the reference pose that
        still counts as touching.

    Raises
    ------
    ModelError
        If the numbers of a profile define no curve, or profiles do not touch in the
        reference pose.
    """
    joints, _pose_variables = make_joints_in_pose(mechanism, profile_gap)
    return joints


def make_joints_in_pose(
    mechanism: Mechanism, profile_gap: float = PROFILE_GAP_RAD
) -> tuple[tuple[Joint, ...], Floats | None]:
    """Return the joints of a mechanism and its variables in the reference pose.

    A reference pose is one configuration for which the file states the axes of all pairs.
    Two contact profiles (curves) touch at a common point with a common tangent. Their
    frames (tangent, normal, point) are equal there.

    Parameters
    ----------
    mechanism
        The mechanism. Its geometry consists of sizes of links, or of a reference pose.
    profile_gap
        Largest angle (rad) between the frames of two profiles that count as touching.
        Numbers in a file are rounded, so the frames are nowhere exactly equal.

    Returns
    -------
    joints
        The joints in the order of the mechanism's pairs.
    pose_variables
        (variables,) pair variables in the reference pose (rad). None if there is no such
        pose, but sizes of links.

    Raises
    ------
    ModelError
        If the numbers of a profile define no curve, or profiles do not touch in the
        reference pose.
    """
    geometry = mechanism.geometry
    # None if the geometry consists of sizes of links.
    pose = geometry if isinstance(geometry, PoseGeometry) else None
    first_frames, second_frames = pair_frames(mechanism)
    joints: list[Joint] = []
    # Without a reference pose, these numbers have no meaning and are not returned.
    pose_variables: list[float] = []
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            joints.append(Revolute(first_frames[pair.name], second_frames[pair.name]))
            angle = 0.0
            if pose:
                angle = pose.values.get(pair.name, 0.0)
            pose_variables.append(angle)
            continue
        curves = make_contact_curves(mechanism, pair)
        # Arc lengths along both profiles at the contact. Without a pose, only a rolling
        # contact needs them. The file then states those at which its variable is zero.
        start = pair.start
        if pose:
            start = find_contact_lengths(mechanism, pair, curves, profile_gap)
        if pair.type == "Cr":
            # A rolling contact. Its variable is the arc length that has rolled, counted
            # from the contact at `start`.
            joints.append(Rolling(*curves, start))
            pose_variables.append(0.0)
        else:
            # A sliding contact. Its two variables are the arc lengths along both profiles.
            # In a reference pose, the variables have their values at the contact.
            joints.append(Sliding(*curves))
            pose_variables.extend(start)
    return tuple(joints), np.array(pose_variables) if pose else None


def make_contact_curves(mechanism: Mechanism, pair: Pair) -> tuple[Curve, Curve]:
    """Return the curves of both links of a contact, each in the axes of its link.

    The joint of a contact needs curves with equal tangents at the contact, because the
    frames of both curves have to coincide there. In an external contact, the profiles that
    the mechanism file states have opposite tangents, such as two counter-clockwise circles
    side by side. The second curve is then returned with its sense reversed.

    Raises
    ------
    ModelError
        If the numbers of a profile define no curve.
    """
    assert pair.profiles is not None
    curves = []
    for link, profile in zip(pair.links, pair.profiles, strict=True):
        try:
            curves.append(_make_curve(profile))
        except ValueError as problem:
            raise ModelError(
                f"{mechanism.name}: pairs.{pair.name}.profiles.{link}: {problem}"
            ) from None
    first, second = curves
    if pair.contact == "external":
        second = second.reversed()
    return first, second


# Planning, position analysis and kernels construct the joints of the same mechanism.
@lru_cache(maxsize=64)
def _make_curve(profile: Profile) -> Curve:
    """Return the curve of a profile."""
    if profile.kind == "points":
        return through(np.array(profile.points), profile.closed)
    centre = np.array(profile.centre)
    if profile.kind == "circle":
        return circle(centre, float(profile.radius or 0.0))
    if profile.kind == "great_circle":
        return great_circle(centre)
    return fourier(centre, np.array(profile.cosines), np.array(profile.sines))


def find_contact_lengths(
    mechanism: Mechanism, pair: Pair, curves: tuple[Curve, Curve], profile_gap: float
) -> Ends:
    """Return the arc lengths (rad) at which two profiles touch in the reference pose.

    The moving frame of a curve has the columns tangent, normal and point. Two curves touch
    at a common point with a common tangent. Their moving frames are then equal.

    Parameters
    ----------
    mechanism, pair
        The contact, and its mechanism, whose file describes one configuration, the
        reference pose.
    curves
        Curves of the first and the second profile, in link axes. In the reference pose, the
        coordinate axes of all links coincide.
    profile_gap
        Accepted angle (rad) of the rotation between both frames, because numbers in a file
        are rounded.

    Returns
    -------
    The arc lengths along the first and the second profile.

    Raises
    ------
    ModelError
        If the most similar moving frames differ by a larger angle.
    """
    lengths, gap = nearest_frames(*curves)
    # The key `contact` tells whether the links are on different sides of the common
    # tangent. If the key is wrong, the tangents are opposite, and the frames differ by 180
    # deg.
    if not gap < profile_gap:
        raise ModelError(
            f"{mechanism.name}: pairs.{pair.name}: the profiles do not touch in the "
            f"reference pose; to touch, one of them would have to turn by {gap:.3g} rad; "
            'move a profile, or set contact = "internal" or "external"'
        )
    return float(lengths[0]), float(lengths[1])
