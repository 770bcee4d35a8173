"""Links that move on the sphere, the link/pair graph and the plan of the poles.

Every recording shows them. Plots of the motion are in `spherekit.scenes.motion_plots`.
"""

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
from spherekit.scenes.scene import Body, Graph, Scene, Text
from spherekit.wording import listing

ARC_POINT_DISTANCE_RAD = np.radians(2.0)
"""Distance (rad) of neighbouring points on a great-circle arc that is drawn.

Larger: arcs look like polygons. Smaller: more points to store.
"""

PROFILE_POINT_COUNT = 181
"""Number of points on a profile that is drawn.

Larger: more points to store. Smaller: profiles look like polygons.
"""

SAME_DRAWN_POINT_RAD = 1e-6
"""Arc (rad) below which two points of a link are drawn as one.

Larger: short sides of links are not drawn. Smaller: arcs between coincident axes are drawn,
with a direction that is only rounding.
"""

MIN_MEAN_LENGTH = 1e-6
"""Smallest length of the sum of the axes of a link that has a direction.

Larger: sides of nearly symmetric links are ordered about their first axis. Smaller: the
direction may be rounding.
"""

COPLANAR_EXTENT = 1e-6
"""Extent of the axes of a link out of a plane below which they are on one great circle.

It is the root of the sum of squared distances. Larger: flat polygons may be ordered as if
they were on a great circle. Smaller: the order on a great circle may be rounding.
"""

POINT_ARC_SINE = 1e-12
"""Sine of an arc below which it has no plane and is drawn as a straight line."""


def link_shapes(mechanism: Mechanism) -> list[Body]:
    """Return the shapes of all links, in the axes of each link.

    A shape is drawn by great-circle arcs between the axes of the pairs (joints) of the
    link, and by its contact profiles. The rotations of moving links are added later.
    """
    shapes = []
    for number, (link, axes) in enumerate(link_axes(mechanism).items()):
        joints = np.array(list(axes.values())).reshape(-1, 3)
        curves = [*link_curves(joints), *profile_curves(mechanism, link, joints)]
        shapes.append(
            Body(
                path=f"link/{link}",
                label=link,
                curves=curves,
                joints=joints,
                joint_labels=list(axes),
                number=number,
                quaternions=None,
            )
        )
    return shapes


def static_scene(plans: Sequence[Plan], shapes: list[Body]) -> Scene:
    """Return a scene (drawing) with the ground, and the plans of the poles as a text.

    A pole is the axis of the relative rotation of two links. A plan is for a motion in
    which one input moves and the other inputs are locked. It lists the steps in which the
    poles of this motion are found.

    The search for poles has several rounds, called passes. In each pass poles are found as
    intersections of great circles through poles of earlier passes. Some poles follow
    together from one system of equations for a group of links, called an irreducible part.

    Parameters
    ----------
    plans
        The plan for each input.
    shapes
        The links from `link_shapes`. Only the first one, the ground, is shown here, since
        the other links move.
    """
    mechanism = plans[0].mechanism
    lines = [f"# Plan of {mechanism.name}"]
    for plan in plans:  # one for each input
        driven_pair = mechanism.pairs[plan.input]
        base, link = driven_pair.links
        locked_names = [markdown_text(name) for name in mechanism.names_of(plan.locked)]
        locked_words = f"; locked: {listing(locked_names)}" if locked_names else ""
        lines.append(
            f"Input: pair {markdown_text(driven_pair.name)}, link {markdown_text(link)} "
            f"relative to {markdown_text(base)}{locked_words}."
        )
        lines += ["", as_markdown(plan), ""]
        step_lines = _describe_steps(plan)
        if step_lines:
            lines += ["```", *step_lines, "```", ""]
    lines.append(
        "x: primary pole (axis of a pair). I, II, ...: the pass of the "
        "Aronhold-Kennedy theorem that finds it. *: found with an irreducible part."
    )
    if mechanism.source is not None:
        lines += ["", f"Source: {markdown_text(mechanism.source.citation)}"]
    # All pages of the viewer show this scene.
    page = None
    return Scene(page, (shapes[0], Text("plan", "Plan", "\n".join(lines))))


def _describe_steps(plan: Plan) -> list[str]:
    """Return a line for each step of a plan that finds a pole.

    A pole is the axis of the relative rotation of two links. A primary pole is the axis of
    a pair. Steps of primary poles that are known from the start (pass 0 of the search) are
    left out: the two links of such a pole are joined by a pair.
    """
    lines = []
    for step in plan.steps:
        # Links without a pair between them can have a common axis of other pairs as their
        # pole. Such a primary pole is found in a later pass.
        is_known_from_start = isinstance(step, PrimaryPole) and step.pass_number == 0
        if not is_known_from_start:
            lines.append(describe(plan, step))
    return lines


def graph_scene(mechanism: Mechanism) -> Scene:
    """Return a drawing of the link/pair graph of a mechanism.

    Links and pairs (joints) are nodes. Each pair is joined by edges to its two links. The
    layout takes about a second.
    """
    # For each node (link or pair in the diagram): an identifier, a label, and the index of
    # the link (None for a pair).
    nodes: list[tuple[str, str, int | None]] = [
        (f"link {name}", name if number else f"{name} (ground)", number)
        for number, name in enumerate(mechanism.links)
    ]
    nodes += [
        (f"pair {pair.name}", f"{pair.type} {pair.name}", None) for pair in mechanism.pairs
    ]
    edges = [
        (f"link {link}", f"pair {pair.name}")
        for pair in mechanism.pairs
        for link in pair.links
    ]
    positions = layout_graph(mechanism).tolist()
    graph = Graph("graph", nodes, edges, positions)
    # With `page=None` the viewer shows the graph on every page.
    return Scene(page=None, primitives=(graph,))


def moving_link_scenes(motion: Motion, shapes: list[Body]) -> list[Scene]:
    """Return drawings of the moving links at the samples of a block.

    A block is a group of samples that are computed together. There is one scene (drawing)
    for each assembly mode (way to assemble the mechanism).

    Parameters
    ----------
    motion
        The motion of the block.
    shapes
        The shapes of all links from `link_shapes`, in link axes.
    """
    link_quaternions = {
        link: motion.quaternions(link) for link in range(1, len(motion.mechanism.links))
    }
    scenes = []
    for position, assembly_mode in enumerate(motion.assembly_modes):
        # A motion has all samples of the first mode, then all samples of the second, ...
        rows = slice(position * motion.samples, (position + 1) * motion.samples)
        bodies = [
            replace(shapes[link], quaternions=quaternions[rows])
            for link, quaternions in link_quaternions.items()
        ]
        scenes.append(Scene(assembly_mode.number, tuple(bodies)))
    return scenes


def link_bodies(mechanism: Mechanism, rotations: Floats) -> list[Body]:
    """Return the drawings of the moving links in n configurations.

    Parameters
    ----------
    mechanism
        The mechanism.
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes.
    """
    return [
        replace(shape, quaternions=quaternion(rotations[:, shape.number]))
        for shape in link_shapes(mechanism)[1:]
    ]


def profile_curves(mechanism: Mechanism, link: str, joints: Floats) -> list[Floats]:
    """Return the curves that draw the contact profiles of a link, and arcs to them.

    A link can have joints with an axis, and contacts. At a contact, a curve of this link
    (its profile) touches a curve of another link. An arc joins each profile with the axis
    of the first joint of the link, if there is one. A small circle and a Fourier
    profile (a Fourier series of the angle from a centre) have a centre, at which the arc
    ends. For any other profile the arc ends at the nearest point.

    Parameters
    ----------
    mechanism
        The mechanism.
    link
        Name of the link.
    joints
        (j, 3) axes of the link's joints in link axes.

    Returns
    -------
    Polylines (k, 3) of unit vectors in link axes.
    """
    curves = []
    pair_geometries = make_joints(mechanism)
    for pair, geometry in zip(mechanism.pairs, pair_geometries, strict=True):
        # Only contacts have profiles, one on each of the two links.
        if pair.profiles is None or link not in pair.links:
            continue
        side = pair.links.index(link)
        curve = geometry.contact_profiles[side].curve
        arc_lengths = np.linspace(0.0, curve.length, PROFILE_POINT_COUNT)
        # The third column of the curve's frame is the point.
        points = curve.evaluate(arc_lengths).frame[:, :, 2]
        curves.append(points)
        if len(joints):
            profile = pair.profiles[side]
            arc_end = points[np.argmax(points @ joints[0])]  # nearest to the first joint
            if profile.centre is not None and profile.kind != "great_circle":
                arc_end = np.array(profile.centre)
            if arc(joints[0], arc_end) > SAME_DRAWN_POINT_RAD:
                curves.append(great_arc(joints[0], arc_end))
    return curves


def link_curves(joints: Floats) -> list[Floats]:
    """Return the great-circle arcs that draw the sides of a link, in convex order.

    Parameters
    ----------
    joints
        (j, 3) axes of the link's joints, unit vectors in link axes.

    Returns
    -------
    Polylines (k, 3) of unit vectors in link axes.
    """
    # Of several joints on one axis, only the first is used.
    distinct: list[int] = []
    for number, joint in enumerate(joints):
        if all(arc(joints[earlier], joint) > SAME_DRAWN_POINT_RAD for earlier in distinct):
            distinct.append(number)
    joints = joints[distinct]
    if len(joints) < 2:
        return []
    if len(joints) == 2:
        return [great_arc(joints[0], joints[1])]
    # With three or more joints the link is a spherical polygon.
    corners = _order_corners(joints)
    arcs = []
    for number, corner in enumerate(corners):
        next_corner = corners[(number + 1) % len(corners)]
        arcs.append(great_arc(corner, next_corner))
    return arcs


def _order_corners(corners: Floats) -> Floats:
    """Return the corners (k, 3) of a spherical polygon in convex order, as unit vectors.

    The caller draws the sides of a link between successive corners. The corners are sorted
    by their azimuth about the middle, which is the direction of their sum. There are two
    exceptions. Corners on one great circle are sorted about the normal of its plane. If the
    sum of other corners is nearly zero, the first corner serves as the middle. The order is
    then at least determined.
    """
    # The direction in which the corners extend least: the normal, if they are in a plane.
    _, extents, directions = np.linalg.svd(corners)
    vector_sum = corners.sum(axis=0)
    length = np.linalg.norm(vector_sum)
    if extents[-1] < COPLANAR_EXTENT:
        middle = directions[-1]
    elif length > MIN_MEAN_LENGTH:
        middle = vector_sum / length
    else:
        middle = corners[0]
    # Azimuths are measured from the corner that is nearest to 90 degrees from the middle.
    reference = corners[np.argmin(np.abs(corners @ middle))]
    # The z axis of the frame is the middle, and the x axis points toward the reference.
    frame = frame_toward(middle, reference)
    x, y, _ = (corners @ frame).T
    azimuths = np.arctan2(y, x)
    return corners[np.argsort(azimuths, kind="stable")]


def great_arc(a: Floats, b: Floats) -> Floats:
    """Return points (k, 3) along the shorter great-circle arc between unit vectors.

    Coincident or opposite vectors have no such arc: only these two points are returned.
    """
    if np.linalg.norm(np.cross(a, b)) < POINT_ARC_SINE:
        return np.array([a, b])
    angle = arc(a, b)
    step_count = int(np.ceil(angle / ARC_POINT_DISTANCE_RAD))
    t = np.linspace(0.0, angle, step_count + 1)[:, None]
    tangent = frame_toward(a, b)[:, 0]
    return np.cos(t) * a + np.sin(t) * tangent
