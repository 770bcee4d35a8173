"""A mechanism with pairs locked: the two links of each become one."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.geometry.rotation import about_z
from spherekit.mechanism.changed_axes import _NONE, Turns, restated, turned
from spherekit.mechanism.elements import (
    Angles,
    LinkSizes,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
    as_vector,
)
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import as_tensor
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import pair_frames, pair_frames_from_sizes
from spherekit.mechanism.sizes import AngleUnit, to_radians
from spherekit.wording import listing

Frames = Mapping[str, Floats]
"""Frames (3, 3) of R pairs in one of their links, by name."""

SAME = 1e-12
"""Angles (rad) that differ by no more are that of the reference pose."""


@checked(ModelError)
def lock(mechanism: Mechanism, pairs: Angles, *, angle_unit: AngleUnit) -> Mechanism:
    """Return the mechanism with R pairs locked, the two links of each joined to one.

    The link that stays is the ground, or the one with contacts, or the pair's first;
    masses, loads and outputs of the other go over to it. Loads and joint limits at the pair
    go, as do an input there and outputs between both links. A mechanism given in a
    reference pose is given by arcs and angles if a pair is locked at another value than it
    has there.

    Parameters
    ----------
    mechanism
        Of any mobility.
    pairs
        The variable of each pair that is locked.
    angle_unit
        Their unit, ``"deg"`` or ``"rad"``.

    Raises
    ------
    ModelError
        If there is no such R pair, its joint limits exclude the value, they are all inputs
        that the mechanism states, or a contact would lose the place from which lengths
        along its profiles are measured.

    Examples
    --------
    >>> import spherekit as sk
    >>> four_bar = sk.lock(sk.load("five_bar"), {"51": 80.0}, angle_unit="deg")
    >>> len(four_bar.links), [item.pair for item in four_bar.inputs]
    (4, ['21'])
    """
    declared = [item.pair for item in mechanism.inputs if not item.is_default]
    if declared and set(declared) <= set(pairs):
        raise ModelError(
            f"{mechanism.name}: lock: without the inputs {listing(declared)} nothing would "
            "move; leave one of them free"
        )
    for name, value in pairs.items():
        mechanism = _locked(mechanism, mechanism.pair(name), to_radians(value, angle_unit))
    return mechanism


def _locked(made: Mechanism, pair: Pair, value: float) -> Mechanism:
    where = f"{made.name}: lock: pair {pair.name}"
    in_pose = _check_lockable(made, pair, value, where)
    touching = {x for other in made.pairs if not other.kind.has_axis for x in other.links}
    kept, gone = pair.links
    if gone == made.ground or (gone in touching and kept not in touching | {made.ground}):
        kept, gone = gone, kept
    rest = [other for other in made.pairs if other.name != pair.name]
    between = [other.name for other in rest if set(other.links) == {kept, gone}]
    if between:
        raise ModelError(
            f"{where} joins the same two links as pair {between[0]}, which could not move"
        )
    turn = np.eye(3)
    if not in_pose:
        first, second = (of_end[pair.name] for of_end in pair_frames(made))
        turn = first @ about_z(value) @ second.T
        turn = turn if kept == pair.links[0] else turn.T

    def turned_profile(profile: Profile, turn: Floats, contact: Pair) -> Profile:
        if contact.type == "Cr" or profile.kind == "fourier":
            raise ModelError(
                f"{where}: axes of a link with a profile of {contact.name} change with it, "
                "so that where the profile begins would be lost; give it by points if it "
                "slides, or lock another pair, or another value"
            )
        return turned(profile, turn, contact)

    parts = restated(
        made,
        names={gone: kept},
        turns={gone: turn},
        words={f"theta_{pair.name}": f"({value!r})", f"dtheta_{pair.name}": "(0)"},
        turned_profile=turned_profile,
    )
    pairs = tuple(other for other in parts["pairs"] if other.name != pair.name)
    geometry = made.geometry
    if isinstance(geometry, PoseGeometry) and in_pose:
        geometry = PoseGeometry(*(_but(x, pair) for x in (geometry.axes, geometry.values)))
    else:
        geometry = _joined(made, pair, pairs, {kept: np.eye(3), gone: turn})
    return replace(
        made,
        links=tuple(link for link in made.links if link != gone),
        pairs=pairs,
        geometry=geometry,
        inputs=tuple(item for item in made.inputs if item.pair != pair.name),
        outputs=tuple(item for item in parts["outputs"] if item.link != item.relative_to),
        masses=_added(parts["masses"]),
        loads=tuple(x for x in parts["loads"] if getattr(x, "pair", "") != pair.name),
        joint_limits=tuple(stop for stop in made.joint_limits if stop.pair != pair.name),
        modes={},
    )


def _joined(
    made: Mechanism, locked: Pair, pairs: Sequence[Pair], turns: Turns
) -> SizeGeometry:
    """Return the sizes of pairs with two links as one, by the turns of these into it."""
    sizes = made.geometry if isinstance(made.geometry, SizeGeometry) else SizeGeometry({})
    untouched = {link: of for link, of in sizes.links.items() if link not in turns}
    first, second = (
        {
            x.name: turns.get(x.links[end], np.eye(3)) @ of_end[x.name]
            for x in made.pairs
            if x.kind.has_axis and x != locked and not untouched.keys() >= set(x.links)
        }
        for end, of_end in enumerate(pair_frames(made))
    )
    located = sizes_by_frames(pairs, (first, second), untouched)
    return SizeGeometry(located.links, {**_but(sizes.zeros, locked), **located.zeros})


def _check_lockable(made: Mechanism, pair: Pair, value: float, where: str) -> bool:
    """Return whether a pair is locked as it is in the given pose; `where` begins faults."""
    if not pair.kind.has_axis:
        raise ModelError(f"{where} is a contact; only R pairs can be locked")
    if not math.isfinite(value):
        raise ModelError(f"{where}: found {value}, needs a finite angle")
    for stop in made.joint_limits:
        if stop.pair == pair.name and not stop.low <= value <= stop.high:
            raise ModelError(
                f"{where}: {value:.6g} rad is outside its joint limits, {stop.low:.6g} to "
                f"{stop.high:.6g} rad"
            )
    if isinstance(made.geometry, SizeGeometry):
        return False
    posed = made.geometry.values.get(pair.name, 0.0)
    if abs(math.remainder(value - posed, 2.0 * math.pi)) <= SAME:
        return True
    rolling = [other.name for other in made.pairs if other.rolls]
    if rolling:
        raise ModelError(
            f"{where} has {posed:.6g} rad in the reference pose, not {value:.6g} rad: "
            f"without that pose it is not known how far {rolling[0]} has rolled; lock the "
            "pair there, or give the mechanism by arcs and angles"
        )
    return False


def _but(of_pairs: Mapping[str, Any], pair: Pair) -> dict[str, Any]:
    """Return what pairs have, without one of them."""
    return {name: x for name, x in of_pairs.items() if name != pair.name}


def _added(masses: Iterable[Mass]) -> tuple[Mass, ...]:
    """Return masses in which those of one link are one."""
    added: dict[str, Mass] = {}
    for item in masses:
        added[item.link] = _sum(added[item.link], item) if item.link in added else item
    return tuple(added.values())


def _sum(one: Mass, other: Mass) -> Mass:
    """Return the mass of two bodies that are one."""
    mass, centre = None, None
    if None not in (one.mass, other.mass, one.centre, other.centre):
        weights = np.array([one.mass, other.mass])
        mass = float(np.sum(weights))
        centre = as_vector(weights @ np.array([one.centre, other.centre]) / mass)
    return Mass(one.link, as_tensor(np.add(one.tensor, other.tensor)), mass, centre)


def sizes_by_frames(
    pairs: Sequence[Pair],
    frames: tuple[Frames, Frames],
    kept: Mapping[str, LinkSizes] = _NONE,
) -> SizeGeometry:
    """Return the sizes by which R pairs have these frames (3, 3) in their links' axes.

    The z and y axes of a link stand first in its list, so that its frame stays. Links that
    are `kept` have those sizes.
    """
    carried: dict[str, dict[str, Floats]] = {}
    for pair in pairs:
        for link, of_end in zip(pair.links, frames, strict=True):
            axes = carried.setdefault(link, {})
            if pair.name in of_end:
                axes[pair.name] = of_end[pair.name][:, 2]
    links = {}
    for link, axes in carried.items():
        unpaired = (f"{link}_z", f"{link}_y")
        arcs, angles = [0.5 * np.pi], []
        for x, y, z in axes.values():
            arcs.append(float(np.arctan2(np.hypot(x, y), z)))
            angles.append(float(np.arctan2(-x, y)))
        made = LinkSizes((*unpaired, *axes), tuple(arcs), tuple(angles), unpaired)
        links[link] = kept.get(link, made)
    # Only the sum of zeros over both links of a pair counts: frames may be turned alike.
    have = pair_frames_from_sizes(pairs, SizeGeometry(links, {}))
    zeros = {}
    for name in frames[0]:
        ahead, back = (
            want[name].T @ of_end[name] for want, of_end in zip(frames, have, strict=True)
        )
        zeros[name] = _about(back) - _about(ahead)
    return SizeGeometry(links, zeros)


def _about(turn: Floats) -> float:
    """Return the angle of a rotation about z."""
    return float(np.arctan2(turn[1, 0], turn[0, 0]))
