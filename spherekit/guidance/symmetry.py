"""Finding, and proving, that a mechanism has a mid-plane symmetric architecture.

Found from the graph and the sizes alone: legs of three R pairs with equal arcs from the
base to the output link, whose axes there are the mirror image of those at the base; and
links hinged to the elbows that all turn about one axis at right angles to their hinges,
so that the elbows lie in one plane. Proven in numbers: all links are placed from the
closed form, every pair has to close, and the velocity equations have to leave two
freedoms. The poses that the closed form reaches are then all there are near each of them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.checked import checked
from spherekit.conventions import listing
from spherekit.errors import ModelError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.guidance.mid_plane_architecture import (
    Carrier,
    Leg,
    MidPlaneArchitecture,
    axis_in,
)
from spherekit.guidance.midplane import MidPlane
from spherekit.model.geometry import geometry_of
from spherekit.model.joints import Joint, revolute
from spherekit.model.mechanism import Mechanism
from spherekit.model.outputs import chosen_output
from spherekit.model.parts import Output
from spherekit.sphere.rotation import Floats, arc, cross

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
    joints = geometry_of(made).joints
    effector = made.link_number[end.link]
    legs = _legs(made, joints, effector)
    carriers = _carriers(made, joints, effector, legs)
    held = {carrier.leg for carrier in carriers}
    if not legs:
        raise _refusal(made, "no leg of two links joins the base to the output")
    if len(held) < 3 or len(held) < len(legs):
        raise _refusal(
            made,
            f"the elbows of {len(held)} of {len(legs)} legs with equal arcs are held in "
            "one plane, but those of all, and of three at least, have to be",
        )
    in_legs = {0, effector, *(n for leg in legs for n in (leg.near, leg.far))}
    others = set(range(len(made.links))) - in_legs - {c.link for c in carriers}
    if others:
        names = listing(made.links[n] for n in sorted(others))
        raise _refusal(made, f"links {names} belong to no leg and hold no elbow")
    at_base = {made.pairs[leg.base].name: k for k, leg in enumerate(legs)}
    inputs = [item.pair for item in made.inputs]
    if len(inputs) != 2 or any(name not in at_base for name in inputs):
        raise _refusal(
            made,
            f"the inputs are {listing(inputs)}, but two of the pairs at the base, "
            f"{listing(at_base)}, have to be driven",
        )
    driven = at_base[inputs[0]], at_base[inputs[1]]
    form = _assembled(made, joints, end, legs, carriers, driven)
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


def _legs(mechanism: Mechanism, joints: Sequence[Joint], effector: int) -> tuple[Leg, ...]:
    """Return the legs of two links with equal arcs from the base to the end effector."""
    at: dict[int, list[tuple[int, int]]] = {n: [] for n in range(len(mechanism.links))}
    for pair, (a, b) in enumerate(mechanism.ends):
        at[a].append((pair, b))
        at[b].append((pair, a))
    legs = []
    for base, near in at[0]:
        for elbow, far in at[near]:
            for tip, end in at[far]:
                if end != effector or {near, far} & {0, effector}:
                    continue
                arcs = [
                    arc(*(axis_in(mechanism, joints, pair, link) for pair in pairs))
                    for pairs, link in (((base, elbow), near), ((elbow, tip), far))
                ]
                if abs(arcs[0] - arcs[1]) > SAME:
                    raise _refusal(
                        mechanism,
                        f"the arcs of links {mechanism.links[near]} and "
                        f"{mechanism.links[far]} differ, {np.degrees(arcs[0]):.9g} and "
                        f"{np.degrees(arcs[1]):.9g} deg",
                    )
                legs.append(Leg(base, elbow, tip, near, far))
    return tuple(legs)


def _carriers(
    mechanism: Mechanism, joints: Sequence[Joint], effector: int, legs: tuple[Leg, ...]
) -> tuple[Carrier, ...]:
    """Return the links hinged to the elbows that all turn about one axis across them."""
    best: tuple[Carrier, ...] = ()
    inside = {0, effector, *(n for leg in legs for n in (leg.near, leg.far))}
    for pair, (a, b) in enumerate(mechanism.ends):
        if a in inside or b in inside:
            continue
        normals = _turning_together(mechanism, joints, pair, inside)
        carriers = []
        for number, (one, other) in enumerate(mechanism.ends):
            for link, holder in ((one, other), (other, one)):
                if link not in normals or holder not in inside:
                    continue
                hinge = axis_in(mechanism, joints, number, link)
                held = axis_in(mechanism, joints, number, holder)
                for k, leg in enumerate(legs):
                    if holder not in (leg.near, leg.far):
                        continue
                    elbow = axis_in(mechanism, joints, leg.elbow, holder)
                    sense = float(np.sign(held @ elbow))
                    if np.linalg.norm(held - sense * elbow) > SAME:
                        continue
                    if abs(hinge @ normals[link]) < SAME:
                        carriers.append(Carrier(link, k, hinge, normals[link], sense))
        if len({c.leg for c in carriers}) > len({c.leg for c in best}):
            best = tuple(carriers)
    return best


def _turning_together(
    mechanism: Mechanism, joints: Sequence[Joint], first: int, outside: set[int]
) -> dict[int, Floats]:
    """Return the links that turn about the axis of one pair, and that axis in each."""
    seed = mechanism.ends[first][0]
    normals = {seed: axis_in(mechanism, joints, first, seed)}
    queue = [seed]
    while queue:
        link = queue.pop()
        for pair, ends in enumerate(mechanism.ends):
            if link not in ends:
                continue
            other = ends[1] if ends[0] == link else ends[0]
            if other in normals or other in outside:
                continue
            axis = axis_in(mechanism, joints, pair, link)
            sense = float(np.sign(axis @ normals[link]))
            if np.linalg.norm(axis - sense * normals[link]) > SAME:
                continue
            normals[other] = sense * axis_in(mechanism, joints, pair, other)
            queue.append(other)
    return normals


def _assembled(
    mechanism: Mechanism,
    joints: tuple[Joint, ...],
    output: Output,
    legs: tuple[Leg, ...],
    carriers: tuple[Carrier, ...],
    driven: tuple[int, int],
) -> MidPlaneArchitecture:
    effector = mechanism.link_number[output.link]
    bases = np.stack([axis_in(mechanism, joints, leg.base, 0) for leg in legs])
    tips = np.stack([axis_in(mechanism, joints, leg.tip, effector) for leg in legs])
    first, second = bases[list(driven)]
    if np.linalg.norm(cross(first, second)) < SAME:
        raise _refusal(mechanism, "the axes of both driven pairs lie on one line")
    z = cross(first, second) / np.linalg.norm(cross(first, second))
    x = (first + second) / np.linalg.norm(first + second)
    frame = np.stack([x, cross(z, x), z], axis=1)
    axes = bases @ frame
    left, _, right = np.linalg.svd(axes.T @ tips)
    image = left @ np.diag([1.0, 1.0, -np.linalg.det(left @ right)]) @ right
    if np.max(np.abs(tips @ image.T - axes)) > SAME:
        raise _refusal(
            mechanism,
            "the axes on the end effector are not the mirror image of those on the base",
        )
    dials, phases, senses, arcs = [], [], [], []
    for leg in legs:
        joint = revolute(joints[leg.base])
        ahead = mechanism.ends[leg.base][0] == 0
        ours, its = (joint.first, joint.second) if ahead else (joint.second, joint.first)
        elbow = axis_in(mechanism, joints, leg.elbow, leg.near)
        along, aside, _ = its.T @ elbow
        dials.append(frame.T @ ours)
        phases.append(np.arctan2(aside, along))
        senses.append(1.0 if ahead else -1.0)
        arcs.append(arc(elbow, its[:, 2]))
    plane = MidPlane(
        axes,
        np.array(arcs),
        driven,
        np.stack(dials),
        np.array(phases),
        np.array(senses),
    )
    return MidPlaneArchitecture(
        mechanism, joints, plane, effector, frame, image, legs, carriers, output
    )
