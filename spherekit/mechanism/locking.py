"""Locking of R pairs: the two links of a locked pair become one link."""

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.parametric_curve import axes_about
from spherekit.geometry.rotation import about_z
from spherekit.mechanism.changed_axes import redescribe, rotate_profile
from spherekit.mechanism.elements import (
    Angles,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
    as_vector,
)
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import as_tensor
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import pair_frames
from spherekit.mechanism.sizes import to_radians
from spherekit.mechanism.sizes_from_frames import sizes_from_frames
from spherekit.number_text import degree_range_text, degrees_text
from spherekit.quantity import AngleUnit
from spherekit.wording import listing

REFERENCE_VALUE_TOLERANCE_RAD = 1e-12
"""Difference (rad) up to which a locked value is the value in the reference pose.

Larger: a pair is locked at a slightly different value. Smaller: rounded values lead to a
description by arcs and angles although the reference pose could be kept.
"""

DISPLACEMENT_SHIFT_TOLERANCE_RAD = 1e-12
"""Smallest change (rad) of the displacement along a circle that a warning states.

A smaller change is caused by rounding.
"""


@checked(ModelError)
def lock(mechanism: Mechanism, pairs: Angles, *, angle_unit: AngleUnit) -> Mechanism:
    """Return the mechanism with R pairs locked, so that the two links of each become one.

    The new link has the name of the ground, if this is one of the two links. Otherwise it
    has the name of the link with contacts, if only one has any, else of the first link of
    the pair. Masses, loads and outputs of the other link move to it. Loads,
    joint limits and an input at the pair are removed, and so are outputs between both
    links and all named modes.

    A mechanism can be described by the axes of its pairs in a reference pose (one
    configuration). If a pair is locked at another value than in this pose, the pose becomes
    impossible. The result is then described by the arcs and angles of its links.

    The profiles (contact curves) of the other link are described in the axes of the new
    link. The point of a circle from which arc lengths are counted may change with these
    axes. If this changes the displacement of a sliding contact, a warning (`UserWarning`)
    states the difference.

    Parameters
    ----------
    mechanism
        A mechanism of any mobility.
    pairs
        Value at which the variable is locked, by pair.
    angle_unit
        Unit of the values, ``"deg"`` or ``"rad"``.

    Raises
    ------
    ModelError
        If there is no such R pair, if its joint limits exclude the value, or if all
        declared inputs would be locked. The error is also raised if a profile of a rolling
        contact, or one that is a Fourier series, would need other link axes.

    Examples
    --------
    >>> import spherekit as sk
    >>> four_bar = sk.lock(sk.load("five_bar"), {"51": 80.0}, angle_unit="deg")
    >>> len(four_bar.links), [item.pair for item in four_bar.inputs]
    (4, ['21'])
    """
    # A mechanism that declares no input gets a default one, which may be locked.
    declared = [item.pair for item in mechanism.inputs if not item.is_default]
    if declared and set(declared) <= set(pairs):
        is_single = len(declared) == 1
        raise ModelError(
            f"{mechanism.name}: lock: with {'input' if is_single else 'the inputs'} "
            f"{listing(declared)} locked, no link can move; leave "
            f"{'this input' if is_single else 'one of them'} free"
        )
    for name, value in pairs.items():
        pair = mechanism.pair(name)
        mechanism = _lock_pair(mechanism, pair, to_radians(value, angle_unit))
    return mechanism


def _lock_pair(mechanism: Mechanism, pair: Pair, value: float) -> Mechanism:
    """Return the mechanism with one R pair locked, so that its two links become one.

    The removed link becomes a part of the kept link. A reference pose (axes of all pairs in
    one configuration) remains only if the pair is locked at its value in this pose. If not,
    the geometry becomes sizes of links.

    Parameters
    ----------
    mechanism
        The mechanism.
    pair
        The R pair.
    value
        Value (rad) at which its variable is locked.
    """
    message_start = f'{mechanism.name}: lock: pair "{pair.name}"'
    # Whether the reference pose of the mechanism can be kept.
    is_at_reference = _is_at_reference_value(mechanism, pair, value, message_start)
    kept_link, removed_link = _choose_kept_link(mechanism, pair)
    for parallel in mechanism.pairs:
        if parallel.name != pair.name and set(parallel.links) == {kept_link, removed_link}:
            raise ModelError(
                f"{message_start} joins the same two links as pair {parallel.name}; "
                f"locking it would lock pair {parallel.name} too"
            )
    # In a reference pose the coordinate axes of all links coincide.
    rotation = np.eye(3)
    if not is_at_reference:
        rotation = _relative_rotation(mechanism, pair, value, kept_link)
    merge = _LinkMerge(kept_link, removed_link, rotation, message_start)

    # Expressions of loads get the value of the locked pair in place of its name.
    parts = redescribe(
        mechanism,
        link_names={removed_link: kept_link},
        rotations={removed_link: rotation},
        expression_names={
            f"theta_{pair.name}": f"({value!r})",
            f"dtheta_{pair.name}": "(0)",
        },
        rotate_pair_profile=merge.rotate_contact_profile,
    )
    remaining_pairs = tuple(item for item in parts["pairs"] if item.name != pair.name)
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry) and is_at_reference:
        geometry = PoseGeometry(
            _without_pair(geometry.axes, pair), _without_pair(geometry.values, pair)
        )
    else:
        geometry = _join_link_sizes(mechanism, pair, remaining_pairs, merge)
    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link != removed_link),
        pairs=remaining_pairs,
        geometry=geometry,
        inputs=tuple(item for item in mechanism.inputs if item.pair != pair.name),
        outputs=tuple(item for item in parts["outputs"] if item.link != item.relative_to),
        masses=_merge_masses(parts["masses"]),
        loads=tuple(x for x in parts["loads"] if getattr(x, "pair", "") != pair.name),
        joint_limits=tuple(x for x in mechanism.joint_limits if x.pair != pair.name),
        modes={},
    )


def _relative_rotation(
    mechanism: Mechanism, pair: Pair, value: float, kept_link: str
) -> Floats:
    """Return the rotation (3, 3) from the axes of one link of a pair to those of the other.

    Parameters
    ----------
    mechanism, pair
        The mechanism and an R pair of it.
    value
        Value (rad) of the variable of the pair.
    kept_link
        The link that remains after locking. The rotation leads to the axes of this link.
    """
    # Each link has a frame of the pair, with the axis as z axis. The value of the pair is
    # the rotation about z between both frames.
    first_frames, second_frames = pair_frames(mechanism)
    second_to_first = first_frames[pair.name] @ about_z(value) @ second_frames[pair.name].T
    return second_to_first if kept_link == pair.links[0] else second_to_first.T


@dataclass(frozen=True)
class _LinkMerge:
    """The two links of a locked pair, one of which becomes a part of the other.

    Attributes
    ----------
    kept_link
        The link whose name and axes the joined link has.
    removed_link
        The link that becomes a part of the kept link.
    rotation
        (3, 3) rotation from the axes of the removed link to those of the kept link.
    message_start
        Beginning of messages, with the names of the mechanism and of the locked pair.
    """

    kept_link: str
    removed_link: str
    rotation: Floats
    message_start: str

    def rotate_frame(self, frame: Floats, link: str) -> Floats:
        """Return the frame of a pair (joint) in the axes that its link has after the merge.

        Parameters
        ----------
        frame
            (3, 3) frame of the pair in the axes of the link.
        link
            A link of the mechanism. Only the removed link gets other axes.
        """
        return self.rotation @ frame if link == self.removed_link else frame

    def rotate_contact_profile(
        self, profile: Profile, rotation: Floats, contact: Pair
    ) -> Profile:
        """Return a profile of the removed link in the axes of the kept link.

        A profile is a contact curve. A locked pair makes two links one: the removed link
        becomes a part of the kept link, whose axes differ. What happens to a profile of the
        removed link depends on its contact and its kind:

        - Every profile of a rolling contact (Cr) is refused. The start, from which arc
          length is counted, could change. Then other points of both curves would touch.
        - A Fourier series is refused. Its azimuth is counted from a direction that depends
          on the link axes, so the same coefficients would give a turned curve.
        - A circle is rotated. Its displacement (arc length to the contact point) can then
          be counted from another point. A warning states the difference.
        - A profile by points is rotated. Its start remains the first point.

        Parameters
        ----------
        profile
            The profile, in axes of the removed link.
        rotation
            (3, 3) rotation to the axes of the kept link.
        contact
            The contact to which the profile belongs.

        Raises
        ------
        ModelError
            If the profile is refused.
        """
        if contact.type == "Cr" or profile.kind == "fourier":
            raise ModelError(
                f"{self.message_start}: locking this pair at this angle changes the axes "
                f"of a link with a profile of {contact.name}, so the start of the profile "
                f"would be lost. If {contact.name} slides, give the profile by points; or "
                "lock another pair, or this pair at another angle"
            )
        rotated_profile = rotate_profile(profile, rotation, contact)
        added_displacement = _arc_between_starts(profile, rotated_profile, rotation)
        # In an external contact, the arc length of the second curve grows clockwise.
        is_second_curve = contact.links[1] == self.removed_link
        if is_second_curve and contact.contact == "external":
            added_displacement = -added_displacement
        if abs(added_displacement) > DISPLACEMENT_SHIFT_TOLERANCE_RAD:
            warnings.warn(
                f"{self.message_start}: the displacement "
                f"s_{contact.name}_{self.removed_link} along a circle becomes "
                f"s_{contact.name}_{self.kept_link} and is counted from another point "
                f"of the circle, which adds {added_displacement:.9g} rad",
                stacklevel=2,
            )
        return rotated_profile


def _arc_between_starts(
    profile: Profile, rotated_profile: Profile, rotation: Floats
) -> float:
    """Return the arc from the new to the old start of a circle in rotated link axes.

    Arc lengths along a circle are counted from its start. The start follows from the
    centre of the circle and the axes of the link. When two links become one, a circle can
    be described in other link axes. Its start is then another point of the same circle. The
    caller warns the user by how much the arc lengths change.

    Parameters
    ----------
    profile
        The profile in the old link axes.
    rotated_profile
        The same profile in the new link axes.
    rotation
        (3, 3) rotation from the old to the new link axes.

    Returns
    -------
    The arc length (rad), positive counter-clockwise about the centre. It is 0 for a profile
    by points, which starts at its first point in any link axes.
    """
    # `round_axis` is the axis of a circle or great circle. Other curves have none.
    if profile.round_axis is None or rotated_profile.round_axis is None:
        return 0.0
    # The three columns of `axes_about` point to azimuth 0 (the start), to azimuth 90
    # degrees and to the centre.
    old_start = rotation @ axes_about(profile.round_axis)[:, 0]
    new_start, new_quarter, _ = axes_about(rotated_profile.round_axis).T
    azimuth = np.arctan2(new_quarter @ old_start, new_start @ old_start)
    if profile.radius is None:
        # A great circle states no radius, because it is always 90 degrees from its axis.
        radius = 0.5 * np.pi
    else:
        radius = profile.radius
    return float(np.sin(radius) * azimuth)


def _choose_kept_link(mechanism: Mechanism, pair: Pair) -> tuple[str, str]:
    """Return which link of a locked pair keeps its name and axes.

    A locked pair joins its two links into one. The ground is always kept. Without the
    ground, a link with contacts is kept, so that its profiles (contact curves) need no
    rotation. If neither or both links have contacts, the first link is kept.

    Returns
    -------
    The names of the link that is kept and of the other link.
    """
    links_with_contacts: set[str] = set()
    for contact in mechanism.pairs:
        if not contact.kind.has_axis:
            links_with_contacts.update(contact.links)
    first, second = pair.links
    if mechanism.ground in pair.links:
        is_second_kept = second == mechanism.ground
    else:
        is_second_kept = second in links_with_contacts and first not in links_with_contacts
    if is_second_kept:
        return second, first
    return first, second


def _join_link_sizes(
    mechanism: Mechanism,
    locked: Pair,
    remaining_pairs: Sequence[Pair],
    merge: _LinkMerge,
) -> SizeGeometry:
    """Return the sizes of a mechanism in which the two links of a locked pair are one.

    Sizes are the arcs and angles between the axes of a link. The joined link gets new sizes
    from the frames of its pairs, and all other links keep theirs. If the mechanism is
    described by a reference pose (one configuration with all axes), no link has sizes yet.
    All links then get sizes from frames.

    Parameters
    ----------
    mechanism
        The mechanism with all links.
    locked
        The locked pair.
    remaining_pairs
        The other pairs, in which the joined link already replaces both links.
    merge
        The two links that are joined.
    """
    old_sizes = SizeGeometry({})
    if isinstance(mechanism.geometry, SizeGeometry):
        old_sizes = mechanism.geometry
    kept_sizes = {
        link: sizes
        for link, sizes in old_sizes.links.items()
        if link not in (merge.kept_link, merge.removed_link)
    }
    # The links without kept sizes get new ones, which follow from the frames of their R
    # pairs (hinges). So an R pair is needed if at least one of its two links gets new
    # sizes. Contacts have no axis and no frame.
    pairs_at_new_sizes = []
    for pair in mechanism.pairs:
        gets_new_sizes = any(link not in kept_sizes for link in pair.links)
        if pair != locked and pair.kind.has_axis and gets_new_sizes:
            pairs_at_new_sizes.append(pair)
    # A frame of a pair is a rotation (3, 3): its z column is the axis. Each pair has one in
    # the axes of each of its links. Frames in the removed link are rotated to the axes of
    # the kept link.
    frames = _frames_after_merge(mechanism, pairs_at_new_sizes, merge)
    new_sizes = sizes_from_frames(remaining_pairs, frames, kept_sizes)
    # The zero of a pair is the angle between its two links at which its variable is 0.
    # Pairs between two links that keep their sizes also keep their zeros.
    zeros = {**_without_pair(old_sizes.zeros, locked), **new_sizes.zeros}
    return SizeGeometry(new_sizes.links, zeros)


def _frames_after_merge(
    mechanism: Mechanism, pairs: Iterable[Pair], merge: _LinkMerge
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the frames of R pairs in the axes that their links have after a merge.

    A merge joins two links into one. Frames in the removed link are rotated to the axes of
    the joined link. All other frames stay the same.

    Parameters
    ----------
    mechanism
        The mechanism with all links.
    pairs
        The R pairs whose frames are returned.
    merge
        The two links that are joined.

    Returns
    -------
    The frames (3, 3) of the pairs in their first links, and those in their second links,
    each by pair.
    """
    old_first_frames, old_second_frames = pair_frames(mechanism)
    first_frames = {}
    second_frames = {}
    for pair in pairs:
        first_link, second_link = pair.links
        first_frames[pair.name] = merge.rotate_frame(
            old_first_frames[pair.name], first_link
        )
        second_frames[pair.name] = merge.rotate_frame(
            old_second_frames[pair.name], second_link
        )
    return first_frames, second_frames


def _is_at_reference_value(
    mechanism: Mechanism, pair: Pair, value: float, message_start: str
) -> bool:
    """Check that a pair can be locked at a value; return whether it is the reference value.

    A mechanism file can give the axes of all pairs in one configuration, the reference
    pose. The reference value of the pair is its value in this pose. If the pair is locked
    at it, all axes of the pose remain valid. Without a reference pose, the result is False.

    Parameters
    ----------
    mechanism, pair
        The mechanism and the pair to lock.
    value
        Value of its variable (rad).
    message_start
        Beginning of messages.

    Raises
    ------
    ModelError
        If the pair cannot be locked at this value.
    """
    if not pair.kind.has_axis:
        raise ModelError(f"{message_start} is a contact pair; only R pairs can be locked")
    if not math.isfinite(value):
        raise ModelError(f"{message_start}: found {value}, expected a finite angle")
    for limit in mechanism.joint_limits:
        if limit.pair == pair.name and not limit.low <= value <= limit.high:
            raise ModelError(
                f"{message_start}: {degrees_text(value)} deg ({value:.6g} rad) is outside "
                f"its joint limits, {degree_range_text(limit.low, limit.high)} deg "
                f"({limit.low:.6g} to {limit.high:.6g} rad)"
            )
    if isinstance(mechanism.geometry, SizeGeometry):
        return False
    reference_value = mechanism.geometry.values.get(pair.name, 0.0)
    difference = value - reference_value
    rolling = [contact.name for contact in mechanism.pairs if contact.rolls]
    if not rolling:
        # All axes are the same after a whole revolution.
        difference = math.remainder(difference, 2.0 * math.pi)
    if abs(difference) <= REFERENCE_VALUE_TOLERANCE_RAD:
        return True
    # At another value, the pose does not show where rolling contacts touch.
    if rolling:
        raise ModelError(
            f"{message_start} is locked at {value:.6g} rad, but is at "
            f"{reference_value:.6g} rad in the reference pose. The file does not determine "
            f"how far {rolling[0]} has rolled between these two angles; lock the pair at "
            "its angle in the reference pose, or define the mechanism by arcs and angles"
        )
    return False


def _without_pair(values_by_pair: Mapping[str, Any], pair: Pair) -> dict[str, Any]:
    """Return a mapping by pair without one of the pairs."""
    return {name: value for name, value in values_by_pair.items() if name != pair.name}


def _merge_masses(masses: Iterable[Mass]) -> tuple[Mass, ...]:
    """Return masses with one entry for each link. Several masses of one link are joined."""
    mass_by_link: dict[str, Mass] = {}
    for item in masses:
        if item.link in mass_by_link:
            item = _merge_two_masses(mass_by_link[item.link], item)
        mass_by_link[item.link] = item
    return tuple(mass_by_link.values())


def _merge_two_masses(first: Mass, second: Mass) -> Mass:
    """Return the joint inertia of two bodies that become one link.

    Tensors about the centre of the sphere add up. Mass and centre of mass of the result are
    known only if they are known for both bodies.
    """
    mass = None
    centre = None
    if None not in (first.mass, second.mass, first.centre, second.centre):
        masses = np.array([first.mass, second.mass])
        mass = float(np.sum(masses))
        centre = as_vector(masses @ np.array([first.centre, second.centre]) / mass)
    return Mass(first.link, as_tensor(np.add(first.tensor, second.tensor)), mass, centre)
