"""The stage every recording has: links turning on the sphere, the graph, the plan."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.escaping import markdown_text
from spherekit.geometry.rotation import quaternion
from spherekit.geometry.triangle import arc, frame_toward
from spherekit.mechanism.graph import layout_graph
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import link_axes
from spherekit.planning.plan_text import as_markdown, describe
from spherekit.planning.pole_plan import Plan, PrimaryPole
from spherekit.positions.motion import Motion
from spherekit.scenes.scene import Body, Graph, Scene, Series, Text
from spherekit.wording import listing

CURVE_STEP = np.radians(2.0)
PROFILE_POINTS = 181
SAME_PLACE = 1e-6
"""Arc (rad) below which two places on a link are drawn as one."""


def link_shapes(mechanism: Mechanism) -> list[Body]:
    """Return every link in its own axes."""
    shapes = []
    for number, (link, axes) in enumerate(link_axes(mechanism).items()):
        joints = np.array(list(axes.values())).reshape(-1, 3)
        curves = [*link_curves(joints), *profile_curves(mechanism, link, joints)]
        shapes.append(Body(f"link/{link}", link, curves, joints, list(axes), number, None))
    return shapes


def static_scene(plans: Sequence[Plan], shapes: list[Body]) -> Scene:
    """Return what does not move: the ground and the plans' Tables."""
    mechanism = plans[0].mechanism
    lines = [f"# Plan of {mechanism.name}"]
    for plan in plans:
        driven = mechanism.pairs[plan.input]
        locked = mechanism.names_of(plan.locked)
        base, link = driven.links
        lines.append(
            f"Input: pair {markdown_text(driven.name)}, "
            f"link {markdown_text(link)} relative to {markdown_text(base)}"
            f"{f'; locked: {listing(map(markdown_text, locked))}' if locked else ''}."
        )
        lines += ["", as_markdown(plan), ""]
        steps = [
            describe(plan, step)
            for step in plan.steps
            if not isinstance(step, PrimaryPole) or step.round
        ]
        lines += ["```", *steps, "```", ""] if steps else []
    lines.append(
        "x: primary pole (axis of a pair). I, II, ...: the pass of the "
        "Aronhold-Kennedy theorem that finds it. *: found with an irreducible part."
    )
    if mechanism.source is not None:
        lines += ["", f"Source: {markdown_text(mechanism.source.citation)}"]
    return Scene(None, (shapes[0], Text("plan", "Plan", "\n".join(lines))))


def graph_scene(mechanism: Mechanism) -> Scene:
    """Return the link/pair graph, which takes a second to lay out."""
    nodes: list[tuple[str, str, int | None]] = [
        (f"link {name}", name if number else f"{name} (ground)", number)
        for number, name in enumerate(mechanism.links)
    ]
    nodes += [(f"pair {p.name}", f"{p.type} {p.name}", None) for p in mechanism.pairs]
    edges = [
        (f"link {link}", f"pair {pair.name}")
        for pair in mechanism.pairs
        for link in pair.links
    ]
    return Scene(None, (Graph("graph", nodes, edges, layout_graph(mechanism).tolist()),))


def motion_scenes(motion: Motion, shapes: list[Body], timed: bool = False) -> list[Scene]:
    """Return the turning links of every assembly mode of a block.

    With plots of the pairs' variables over time if the samples are times.
    """
    mechanism = motion.mechanism
    turns = {k: motion.quaternions(k) for k in range(1, len(mechanism.links))}
    scenes = []
    for position, assembly_mode in enumerate(motion.assembly_modes):
        rows = slice(position * motion.samples, (position + 1) * motion.samples)
        bodies = [
            replace(shapes[link], quaternions=turn[rows]) for link, turn in turns.items()
        ]
        plots: list[Series] = []
        named = zip(mechanism.variable_names, motion.values[rows].T, strict=True)
        for name, values in named if timed else ():
            # With a gap where an angle passes a whole turn.
            jumps = np.abs(np.diff(values, prepend=values[:1])) > np.pi
            shown = np.where(jumps, np.nan, values)
            path = f"plots/variable/{name}"
            plots.append(Series(path, name, "pair variables", shown, "rad"))
        scenes.append(Scene(assembly_mode.number, (*bodies, *plots)))
    return scenes


def link_bodies(mechanism: Mechanism, rotations: Floats) -> list[Body]:
    """Return the moving links at configurations, rotations (n, links, 3, 3)."""
    return [
        replace(shape, quaternions=quaternion(rotations[:, shape.number]))
        for shape in link_shapes(mechanism)[1:]
    ]


def profile_curves(mechanism: Mechanism, link: str, joints: Floats) -> list[Floats]:
    """Return what draws a link's profiles: the curves (k, 3), and arcs that hold them.

    Each curve is held by an arc from the link's first joint, if it has one, to the
    curve's centre, or to its nearest point where it has no centre beside it.
    """
    curves = []
    for pair, joint in zip(mechanism.pairs, make_joints(mechanism), strict=True):
        if pair.profiles is None or link not in pair.links:
            continue
        which = pair.links.index(link)
        curve = joint.contact_profiles[which].curve
        points = curve.evaluate(np.linspace(0.0, curve.length, PROFILE_POINTS)).frame[
            :, :, 2
        ]
        curves.append(points)
        if len(joints):
            profile = pair.profiles[which]
            foot = points[np.argmax(points @ joints[0])]
            if profile.centre is not None and profile.kind != "great_circle":
                foot = np.array(profile.centre)
            if arc(joints[0], foot) > SAME_PLACE:
                curves.append(great_arc(joints[0], foot))
    return curves


def link_curves(joints: Floats) -> list[Floats]:
    """Return the great-circle arcs (k, 3) that draw a link: its sides, in convex order."""
    kept: list[int] = []  # of joints on one axis the first
    for number, joint in enumerate(joints):
        if all(arc(joints[other], joint) > SAME_PLACE for other in kept):
            kept.append(number)
    joints = joints[kept]
    if len(joints) < 2:
        return []
    if len(joints) == 2:
        return [great_arc(joints[0], joints[1])]
    middle = joints.sum(axis=0)
    length = np.linalg.norm(middle)
    pole = middle / length if length > 1e-6 else joints[0]
    farthest = joints[np.argmin(np.abs(joints @ pole))]
    x, y, _ = (joints @ frame_toward(pole, farthest)).T
    order = np.argsort(np.arctan2(y, x), kind="stable")
    return [
        great_arc(joints[a], joints[b])
        for a, b in zip(order, np.roll(order, -1), strict=True)
    ]


def great_arc(a: Floats, b: Floats) -> Floats:
    """Return points (k, 3) along the shorter great-circle arc between unit vectors."""
    if np.linalg.norm(np.cross(a, b)) < 1e-12:
        return np.array([a, b])
    angle = arc(a, b)
    t = np.linspace(0.0, angle, int(np.ceil(angle / CURVE_STEP)) + 1)[:, None]
    return np.cos(t) * a + np.sin(t) * frame_toward(a, b)[:, 0]
