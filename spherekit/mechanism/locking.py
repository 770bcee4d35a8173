"""Locking of R pairs: the two links of a locked pair become one link."""

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.parametric_curve import axes_about
from spherekit.geometry.rotation import about_z
from spherekit.mechanism.changed_axes import AxisRotations, redescribe, rotate_profile
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
"""Smallest change of the zero of a displacement that a warning states.

A smaller change is caused by rounding.
"""


@checked(ModelError)
def lock(mechanism: Mechanism, pairs: Angles, *, angle_unit: AngleUnit) -> Mechanism:
    """Return the mechanism with R pairs locked, so that the two links of each become one.

    The new link has the name of the ground, of the link with contacts, or of the first link
    of the pair, in this order. Masses, loads and outputs of the other link are moved to it.
    Loads and joint limits at the pair are removed, and so are an input at it and outputs
    between both links.

    A mechanism can be given by the axes of its pairs in a reference pose. If a pair is
    locked at another value than it has in this pose, the pose is impossible afterwards. The
    result is then given by the arcs and angles of its links.

    If both links have contacts, the profiles of one of them get new link axes. These define
    the point of a circle from which its displacement is counted. If this point changes, a
    warning (`UserWarning`) states by how much the displacement changes.

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
        If there is no such R pair, if its joint limits exclude the value, if all declared
        inputs would be locked, or if the point of a contact from which the arc lengths of
        its profile are measured would be lost.

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
        raise ModelError(
            f"{mechanism.name}: lock: with the inputs {listing(declared)} locked, no link "
            "can move; leave one of them free"
        )
    for name, value in pairs.items():
        pair = mechanism.pair(name)
        mechanism = _lock_pair(mechanism, pair, to_radians(value, angle_unit))
    return mechanism


def _lock_pair(mechanism: Mechanism, pair: Pair, value: float) -> Mechanism:
    """Return the mechanism with one R pair locked, its two links being one.

    The new link has the name and the axes of one of them, the kept link. The parts of the
    removed link are moved to it. If the geometry is a reference pose, it stays one only if
    the pair is locked at its value in this pose. Otherwise it becomes sizes of links.

    Parameters
    ----------
    mechanism
        The mechanism.
    pair
        The R pair.
    value
        Value (rad) at which its variable is locked.
    """
    where = f"{mechanism.name}: lock: pair {pair.name}"
    # Whether the reference pose of the mechanism can be kept.
    is_at_reference = _is_at_reference_value(mechanism, pair, value, where)
    kept_link, removed_link = _choose_kept_link(mechanism, pair)
    for parallel in mechanism.pairs:
        if parallel.name != pair.name and set(parallel.links) == {kept_link, removed_link}:
            raise ModelError(
                f"{where} joins the same two links as pair {parallel.name}; locking it "
                f"would lock pair {parallel.name} too"
            )
    # Rotation from the axes of the removed link to those of the kept link. In a reference
    # pose the axes of all links coincide. Otherwise the second link is turned relative to
    # the first by the value of the pair, between the frames of the pair in both links.
    rotation = np.eye(3)
    if not is_at_reference:
        first_frame, second_frame = (
            frames_of_end[pair.name] for frames_of_end in pair_frames(mechanism)
        )
        rotation = first_frame @ about_z(value) @ second_frame.T
        if kept_link != pair.links[0]:
            rotation = rotation.T

    def rotate_contact_profile(
        profile: Profile, rotation: Floats, contact: Pair
    ) -> Profile:
        """Return a profile in rotated link axes, or raise `ModelError`.

        A circle or a Fourier series starts at azimuth 0 about its centre. The link axes
        define this azimuth, so in rotated axes another point is the start, from which arc
        lengths are counted. That changes the position of a Fourier series, and the rolling
        of a contact (Cr), in which both arc lengths belong together. These two are refused.
        If a circle slides, only the displacement along it gets another zero. A warning
        states this.
        """
        if contact.type == "Cr" or profile.kind == "fourier":
            raise ModelError(
                f"{where}: locking this pair at this angle changes the axes of a link with "
                f"a profile of {contact.name}, so the start of the profile would be lost. "
                f"If {contact.name} slides, give the profile by points; or lock another "
                "pair, or this pair at another angle"
            )
        rotated_profile = rotate_profile(profile, rotation, contact)
        shift = _displacement_shift(profile, rotated_profile, rotation)
        # The second curve of an external contact is measured clockwise about its centre.
        is_second = contact.links[1] == removed_link
        if is_second and contact.contact == "external":
            shift = -shift
        if abs(shift) > DISPLACEMENT_SHIFT_TOLERANCE_RAD:
            warnings.warn(
                f"{where}: the displacement s_{contact.name}_{removed_link} along a circle "
                f"becomes s_{contact.name}_{kept_link} and is counted from another point "
                f"of the circle, which adds {shift:.9g} rad",
                stacklevel=2,
            )
        return rotated_profile

    # Expressions of loads get the value of the locked pair in place of its name.
    parts = redescribe(
        mechanism,
        link_names={removed_link: kept_link},
        rotations={removed_link: rotation},
        expression_names={
            f"theta_{pair.name}": f"({value!r})",
            f"dtheta_{pair.name}": "(0)",
        },
        rotate_pair_profile=rotate_contact_profile,
    )
    remaining_pairs = tuple(item for item in parts["pairs"] if item.name != pair.name)
    geometry = mechanism.geometry
    if isinstance(geometry, PoseGeometry) and is_at_reference:
        geometry = PoseGeometry(
            _without_pair(geometry.axes, pair), _without_pair(geometry.values, pair)
        )
    else:
        rotations = {kept_link: np.eye(3), removed_link: rotation}
        geometry = _join_link_sizes(mechanism, pair, remaining_pairs, rotations)
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


def _displacement_shift(
    profile: Profile, rotated_profile: Profile, rotation: Floats
) -> float:
    """Return the arc by which rotated link axes move the zero of a circle.

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
    The arc length (rad) from the new zero of the displacement to the old one, positive
    counter-clockwise about the centre. It is 0 for profiles by points, which have their
    zero at the first point.
    """
    if profile.round_axis is None or rotated_profile.round_axis is None:
        return 0.0
    # Unit vectors to azimuth 0, 90 degrees and the centre are the columns of `axes_about`.
    old_zero = rotation @ axes_about(profile.round_axis)[:, 0]
    new_axes = axes_about(rotated_profile.round_axis)
    azimuth = np.arctan2(new_axes[:, 1] @ old_zero, new_axes[:, 0] @ old_zero)
    radius = 0.5 * np.pi if profile.radius is None else profile.radius
    return float(np.sin(radius) * azimuth)


def _choose_kept_link(mechanism: Mechanism, pair: Pair) -> tuple[str, str]:
    """Return the link of a locked pair whose name and axes are kept, and the other link.

    The ground is kept in any case. Otherwise a link with contacts is kept, since the
    profiles of a kept link are not rotated. If neither or both links have contacts, the
    first link of the pair is kept.

    Returns
    -------
    The names of the kept link and of the other link.
    """
    links_with_contacts: set[str] = set()
    for contact in mechanism.pairs:
        if not contact.kind.has_axis:
            links_with_contacts.update(contact.links)
    first, second = pair.links
    has_reason_for_first = first == mechanism.ground or first in links_with_contacts
    is_second_kept = second == mechanism.ground or (
        second in links_with_contacts and not has_reason_for_first
    )
    return (second, first) if is_second_kept else (first, second)


def _join_link_sizes(
    mechanism: Mechanism,
    locked: Pair,
    pairs: Sequence[Pair],
    rotations: AxisRotations,
) -> SizeGeometry:
    """Return the sizes of a mechanism in which the two links of a locked pair are one.

    Sizes are the arcs and angles between the axes of a link. Each pair also has a zero: the
    angle in its first link from which its variable is counted. The joined link, and all
    links without sizes, get sizes from the frames of their pairs. The sizes of all other
    links stay as they are.

    Parameters
    ----------
    mechanism
        The mechanism with all links.
    locked
        The locked pair.
    pairs
        The other pairs, with the joined link.
    rotations
        Rotations of the two joined links to the axes of the new link.
    """
    # A mechanism that is given in a reference pose has axes instead of sizes. All links
    # then get sizes.
    sizes = SizeGeometry({})
    if isinstance(mechanism.geometry, SizeGeometry):
        sizes = mechanism.geometry
    other_links = {
        link: link_sizes
        for link, link_sizes in sizes.links.items()
        if link not in rotations
    }
    # Pairs between two links that keep their sizes also keep their zeros.
    changed_pairs = []
    for pair in mechanism.pairs:
        has_unchanged_links = all(link in other_links for link in pair.links)
        if pair.kind.has_axis and pair != locked and not has_unchanged_links:
            changed_pairs.append(pair)
    # The frames of these pairs in their first and second links. Frames in the two joined
    # links are rotated to the axes of the new link.
    old_first_frames, old_second_frames = pair_frames(mechanism)
    first_frames = {}
    second_frames = {}
    for pair in changed_pairs:
        first_rotation, second_rotation = (
            rotations.get(link, np.eye(3)) for link in pair.links
        )
        first_frames[pair.name] = first_rotation @ old_first_frames[pair.name]
        second_frames[pair.name] = second_rotation @ old_second_frames[pair.name]
    joined = sizes_from_frames(pairs, (first_frames, second_frames), other_links)
    zeros = {**_without_pair(sizes.zeros, locked), **joined.zeros}
    return SizeGeometry(joined.links, zeros)


def _is_at_reference_value(
    mechanism: Mechanism, pair: Pair, value: float, where: str
) -> bool:
    """Check that a pair can be locked, and return whether its axes need not change.

    They need not change if the mechanism is given in a reference pose, in which the pair
    has this value.

    Parameters
    ----------
    mechanism, pair
        The mechanism and the pair to lock.
    value
        Value of its variable (rad).
    where
        Beginning of messages.

    Raises
    ------
    ModelError
        If the pair cannot be locked at this value.
    """
    if not pair.kind.has_axis:
        raise ModelError(f"{where} is a contact; only R pairs can be locked")
    if not math.isfinite(value):
        raise ModelError(f"{where}: found {value}, needs a finite angle")
    for limit in mechanism.joint_limits:
        if limit.pair == pair.name and not limit.low <= value <= limit.high:
            raise ModelError(
                f"{where}: {degrees_text(value)} deg ({value:.6g} rad) is outside its "
                f"joint limits, {degree_range_text(limit.low, limit.high)} deg "
                f"({limit.low:.6g} to {limit.high:.6g} rad)"
            )
    # Only a mechanism given in a reference pose has a value that is kept.
    if isinstance(mechanism.geometry, SizeGeometry):
        return False
    reference_value = mechanism.geometry.values.get(pair.name, 0.0)
    difference = math.remainder(value - reference_value, 2.0 * math.pi)
    if abs(difference) <= REFERENCE_VALUE_TOLERANCE_RAD:
        return True
    # At another value, the pose does not show where rolling contacts touch.
    rolling = [contact.name for contact in mechanism.pairs if contact.rolls]
    if rolling:
        raise ModelError(
            f"{where} is locked at {value:.6g} rad, but is at {reference_value:.6g} rad in "
            f"the reference pose. The file does not determine how far {rolling[0]} has "
            "rolled between these two angles; lock the pair at its angle in the "
            "reference pose, or "
            "define the mechanism by arcs and angles"
        )
    return False


def _without_pair(values_by_pair: Mapping[str, Any], pair: Pair) -> dict[str, Any]:
    """Return a mapping by pair without one of the pairs."""
    return {name: value for name, value in values_by_pair.items() if name != pair.name}


def _merge_masses(masses: Iterable[Mass]) -> tuple[Mass, ...]:
    """Return masses with one entry for each link. Entries of one link are joined."""
    mass_by_link: dict[str, Mass] = {}
    for item in masses:
        if item.link in mass_by_link:
            item = _merge_two_masses(mass_by_link[item.link], item)
        mass_by_link[item.link] = item
    return tuple(mass_by_link.values())


def _merge_two_masses(first: Mass, second: Mass) -> Mass:
    """Return the inertia of two bodies of one link together.

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
