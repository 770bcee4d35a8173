"""Folding mechanisms with contacts, and with loops whose constraints repeat, by seed.

A special four-bar (`special_mechanisms`) has a cam beside it, or the same coupler twice.
Sizes are decimal numbers of degrees, as a file has them.
"""

from dataclasses import replace

import numpy as np
from mechanism_examples.special_mechanisms import special_mechanism

from spherekit.mechanism.elements import Input, LinkSizes, Pair, Profile, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.mode_predictor import ModeCurve
from spherekit.positions.position_analysis import PositionAnalysis


def with_second_coupler(made):
    """Return a special mechanism whose link 3 is there twice, on the same axes."""
    links = dict(made.geometry.links)
    arc = links["3"].arcs[0]
    links["3b"] = LinkSizes(("32b", "43b"), (arc,))
    # The new axis is collinear with the one of link 3, which is the second axis of link 2,
    # and the first of link 4.
    (crank, *crank_arcs), (rocker, *rocker_arcs) = (
        (links[name], *links[name].arcs) for name in ("2", "4")
    )
    links["2"] = replace(
        crank,
        axes=(*crank.axes, "32b"),
        arcs=(*crank_arcs, crank_arcs[0]),
        angles=(*crank.angles, 0.0),
    )
    links["4"] = replace(
        rocker,
        axes=(*rocker.axes, "43b"),
        arcs=(*rocker_arcs, 0.0),
        angles=(*rocker.angles, 0.0),
    )
    pairs = (
        *made.pairs,
        Pair("32b", "R", ("2", "3b")),
        Pair("43b", "R", ("3b", "4")),
    )
    return replace(
        made, links=(*made.links, "3b"), pairs=pairs, geometry=SizeGeometry(links)
    )


def _circle(tilt, radius):
    """Return a circle in the axes of a link: its centre is `tilt` (deg) from the z axis."""
    angle = np.radians(tilt)
    centre = (float(np.sin(angle)), 0.0, float(np.cos(angle)))
    return Profile("circle", centre=centre, radius=float(np.radians(radius)))


def with_cam(made, pivot_arc, cam, roller, driving="2"):
    """Return a special mechanism with a roller follower on the ground.

    Parameters
    ----------
    made
        The mechanism of R pairs.
    pivot_arc
        Arc (deg) on the ground from its first axis to the pivot of the follower.
    cam, roller
        Tilt of the centre from the z axis of the link (deg), and radius (deg), of the
        circles of the driving link and of the follower.
    driving
        The link that carries the cam.
    """
    links = dict(made.geometry.links)
    ground = links["1"]
    links["1"] = replace(
        ground,
        axes=(*ground.axes, "f1"),
        arcs=(*ground.arcs, float(np.radians(pivot_arc))),
        angles=(*ground.angles, float(np.radians(200.0))),
    )
    links["f"] = LinkSizes(("f1",))
    contact = Pair("cam", "Cs", (driving, "f"), (_circle(*cam), _circle(*roller)))
    pairs = (*made.pairs, Pair("f1", "R", ("1", "f")), contact)
    return replace(
        made, links=(*made.links, "f"), pairs=pairs, geometry=SizeGeometry(links)
    )


def limited_cam(random):
    """Return a cam with a roller follower, whose cam cannot turn fully.

    Links between the centres make it a four-bar with the arcs of frame, cam, the sum of
    both radii, and follower. The last two are in line somewhere in the turn of the cam.
    """
    frame = float(random.integers(35, 80))
    tilt = float(random.integers(8, 30))
    radii = (float(random.integers(8, 25)), float(random.integers(4, 15)))
    distance = frame + tilt * random.uniform(-0.9, 0.9)
    arm = float(np.round(distance - sum(radii), random.integers(0, 6)))
    arm = abs(arm) if random.random() < 0.5 else float(np.round(distance + sum(radii), 2))
    links = {
        "1": LinkSizes(("21", "f1"), (float(np.radians(frame)),)),
        "2": LinkSizes(("21",)),
        "f": LinkSizes(("f1",)),
    }
    profiles = _circle(tilt, radii[0]), _circle(max(arm, 3.0), radii[1])
    pairs = (
        Pair("21", "R", ("1", "2")),
        Pair("f1", "R", ("1", "f")),
        Pair("cam", "Cs", ("2", "f"), profiles),
    )
    inputs = (Input("21", 0.0, 2.0 * np.pi),)
    return Mechanism("limited", "1", tuple(links), pairs, SizeGeometry(links), inputs)


def folding_mechanism(seed):
    """Return the kind ("cam", "contact" or "redundant") and the mechanism of a seed."""
    random = np.random.default_rng(seed + 10**7)
    kind = str(random.choice(["cam", "contact", "redundant"], p=[0.4, 0.2, 0.4]))
    if kind == "cam":
        return kind, limited_cam(random)
    _, made, _ = special_mechanism(seed)
    if kind == "redundant":
        return kind, with_second_coupler(made)
    pivot = float(random.integers(30, 90))
    cam = (float(random.integers(5, 30)), float(random.integers(10, 30)))
    roller = (float(random.integers(30, 60)), float(random.integers(5, 20)))
    driving = str(random.choice(["2", "4"]))
    return kind, with_cam(made, pivot, cam, roller, driving)


def inputs_beside_folds(made, seed):
    """Return inputs (n, 1) rad, 1e-6 to 1e-16 beside multiples of 90 deg and ends of modes.

    Raises
    ------
    SpherekitError
        If the mechanism can be assembled nowhere.
    """
    random = np.random.default_rng(seed)
    folds = np.radians(90.0 * random.integers(0, 5, 6)).tolist()
    for mode in PositionAnalysis(made, samples=9).assembly_modes:
        if isinstance(mode.guide, ModeCurve):
            folds += [q for q in mode.guide.inputs[[0, -1]] for _ in range(3)]
    count = len(folds)
    off = random.choice([-1.0, 1.0], count) * 10.0 ** -random.uniform(6.0, 16.0, count)
    off[:2] = 0.0
    return np.unique(np.array(folds) + off)[:, None]
