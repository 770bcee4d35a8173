"""Finding, and proving, that a mechanism has a mid-plane symmetric architecture.

Found from the graph and the sizes alone: legs of three R pairs with equal arcs from the
base to the output link, whose axes there are the mirror image of those at the base; and
links hinged to the elbows that all turn about one axis at right angles to their hinges,
so that the elbows lie in one plane. Proven in numbers: all links are placed from the
closed form, every pair has to close, and the velocity equations have to leave two
freedoms. The poses that the closed form reaches are then all there are near each of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
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
from spherekit.mechanism.mechanism import Mechanism, chosen_output
from spherekit.outputs.mid_plane import MidPlane
from spherekit.outputs.mid_plane_architecture import (
    Leg,
    MidPlaneArchitecture,
    PairAxis,
    axis_in,
)
from spherekit.wording import listing

SAME = 1e-9
"""Arcs and axes that differ by less (rad) are taken to be meant equal."""


CLOSED = 1e-12
"""How well every pair has to close in the proof (rad)."""


@checked(ModelError)
def mid_plane_form(
    mechanism: AnyMechanism, output: str | None = None
) -> MidPlaneArchitecture:
    """Return the mid-plane symmetric architecture of a mechanism.

    Parameters
    ----------
    mechanism
        A mechanism of R and arc-prismatic pairs, driven at two pairs of the base.
    output
        Name of the output that is the end effector; may be left out if there is one.

    Raises
    ------
    ModelError
        If it has no such form, with the reason.
    """
    mechanism = mechanism_of(mechanism)
    end = chosen_output(mechanism, output)
    made = replace(mechanism, ground=end.relative_to)
    for pair in made.pairs:
        if not pair.kind.has_axis:
            raise _refusal(made, f"pair {pair.name} is a contact pair; only R pairs fit")
    joints = make_joints(made)
    effector = made.link_number[end.link]
    legs = _legs(made, joints, effector)
    along, carried = _along(made, joints, effector, legs)
    held = {at[1] for pair, at in along.items() if carried & {*made.ends[pair]}} - {-1}
    if len(held) < 3 or len(held) < len(legs):
        raise _refusal(
            made,
            f"the elbows of {len(held)} of {len(legs)} legs with equal arcs are held in "
            "one plane, but those of all, and of three at least, have to be",
        )
    in_legs = {0, effector, *(link for links in legs.values() for link in links)}
    others = set(range(len(made.links))) - in_legs - carried
    if others:
        names = listing(made.links[n] for n in sorted(others))
        raise _refusal(made, f"links {names} belong to no leg and hold no elbow")
    form = _assembled(made, joints, end, legs, along)
    gap, freedoms = form.proof()
    if not (gap < CLOSED and freedoms == 2):
        raise _refusal(
            made,
            f"placed as mirror images its pairs stay open by {gap:.3g} rad, and its "
            f"mobility by rank is {freedoms}, not 2",
        )
    return form


def _refusal(mechanism: Mechanism, why: str) -> ModelError:
    return ModelError(f"{mechanism.name} has no mid-plane symmetric architecture: {why}")


def _legs(
    mechanism: Mechanism, joints: Sequence[Joint], effector: int
) -> dict[Leg, tuple[int, int]]:
    """Return the legs of equal arcs from the base to the end effector, with both links."""

    def beside(link: int) -> list[tuple[int, int]]:
        return [
            (pair, sum(ends) - link)
            for pair, ends in enumerate(mechanism.ends)
            if link in ends
        ]

    legs = {
        (base, elbow, tip): (near, far)
        for base, near in beside(0)
        for elbow, far in beside(near)
        for tip, end in beside(far)
        if end == effector and not {near, far} & {0, effector}
    }
    if not legs:
        raise _refusal(mechanism, "no leg of two links joins the base to the output")
    for (base, elbow, tip), links in legs.items():
        near, far = (
            arc(*(axis_in(mechanism, joints, pair, link) for pair in (outer, elbow)))
            for outer, link in zip((base, tip), links, strict=True)
        )
        if abs(near - far) > SAME:
            first, second = (mechanism.links[link] for link in links)
            raise _refusal(
                mechanism,
                f"the arcs of links {first} and {second} differ, {np.degrees(near):.9g} "
                f"and {np.degrees(far):.9g} deg",
            )
    return legs


def _along(
    mechanism: Mechanism,
    joints: Sequence[Joint],
    effector: int,
    legs: Mapping[Leg, tuple[int, int]],
) -> tuple[dict[int, PairAxis], set[int]]:
    """Return along what the axes of pairs are, and the links that hold elbows in a plane.

    Those links are hinged to elbows, and turn about one axis if all pairs close.
    """
    axis, ends = partial(axis_in, mechanism, joints), mechanism.ends
    owner = {link: k for k, links in enumerate(legs.values()) for link in links}
    elbows = [elbow for _, elbow, _ in legs]
    along: dict[int, PairAxis] = {
        pair: (kind, k, 1.0)
        for k, leg in enumerate(legs)
        for pair, kind in zip(leg, ("base", "elbow", "tip"), strict=True)
    }
    hinged, about = set[int](), list[int]()
    for pair, (a, b) in enumerate(ends):
        holder, link = (a, b) if a in owner else (b, a)
        if holder in owner and link not in {0, effector, *owner}:
            elbow = axis(elbows[owner[holder]], holder)
            ahead = float(np.sign(axis(pair, holder) @ elbow))
            along[pair] = "elbow", owner[holder], ahead
            hinged.add(link)
        elif not {a, b} & {0, effector, *owner}:
            about.append(pair)
    normals: dict[int, Floats] = {}
    for pair, link, further in (
        find_spanning_tree(ends, ends[about[0]][:1], about) if about else ()
    ):
        turned = np.sign(axis(pair, link) @ normals.setdefault(link, axis(pair, link)))
        normals[further] = turned * axis(pair, further)
    for pair in range(len(ends)):
        link = ends[pair][0]
        sense = float(np.sign(axis(pair, link) @ normals.get(link, np.ones(3))))
        along.setdefault(pair, ("normal", -1, sense))
    return along, hinged & {*normals}


def _assembled(
    mechanism: Mechanism,
    joints: tuple[Joint, ...],
    output: Output,
    legs: Mapping[Leg, tuple[int, int]],
    along: dict[int, PairAxis],
) -> MidPlaneArchitecture:
    at_base = {mechanism.pairs[base].name: k for k, (base, _, _) in enumerate(legs)}
    inputs = mechanism.input_pairs
    if len(inputs) != 2 or not {*inputs} <= {*at_base}:
        raise _refusal(
            mechanism,
            f"the inputs are {listing(inputs)}, but two of the pairs at the base, "
            f"{listing(at_base)}, have to be driven",
        )
    driven = [at_base[name] for name in inputs]
    axis = partial(axis_in, mechanism, joints)
    effector = mechanism.link_number[output.link]
    at_bases, at_elbows, at_tips = zip(*legs, strict=True)
    nears, _ = zip(*legs.values(), strict=True)
    bases = np.stack([axis(pair, 0) for pair in at_bases])
    tips = np.stack([axis(pair, effector) for pair in at_tips])
    elbows = np.stack([*map(axis, at_elbows, nears)])
    first, second = bases[driven]
    across = cross(first, second)
    if np.linalg.norm(across) < SAME:
        raise _refusal(mechanism, "the axes of both driven pairs lie on one line")
    frame = frame_from(unit_rows(across), unit_rows(first + second))
    axes = bases @ frame
    left, _, right = np.linalg.svd(axes.T @ tips)
    image = left @ np.diag([1.0, 1.0, -np.linalg.det(left @ right)]) @ right
    if max_abs(tips @ image.T - axes) > SAME:
        raise _refusal(
            mechanism,
            "the axes on the end effector are not the mirror image of those on the base",
        )
    ahead = np.array([mechanism.ends[pair][0] == 0 for pair in at_bases])
    every = (revolute(joints[pair]) for pair in at_bases)
    sides = np.array([(joint.first, joint.second) for joint in every])
    sides[~ahead] = sides[~ahead, ::-1]
    ours, its = np.swapaxes(sides, 0, 1)
    seen = np.vecmat(elbows, its)
    plane = MidPlane(
        axes,
        arc(elbows, its[..., 2]),
        driven,
        frame.T @ ours,
        np.arctan2(seen[:, 1], seen[:, 0]),
        np.where(ahead, 1.0, -1.0),
    )
    every_axis = tuple(along[pair] for pair in sorted(along))
    return MidPlaneArchitecture(
        mechanism, joints, plane, effector, frame, image, tuple(legs), every_axis, output
    )
