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


def with_second_coupler(mechanism):
    """Return a four-bar whose coupler (link 3) is there twice, on the same joint axes.

    The copy 3b repeats the constraint of link 3: a redundant loop that still moves. In
    `LinkSizes`, an arc leads from the first joint axis of a link to each further axis. The
    angle of a later arc is measured from the first arc, about the first axis.
    """
    links = dict(mechanism.geometry.links)
    crank = links["2"]
    rocker = links["4"]
    links["3b"] = LinkSizes(("32b", "43b"), (links["3"].arcs[0],))
    # On link 2 the new axis coincides with the second axis: the same arc at the angle 0. On
    # link 4 it coincides with the first axis: the arc 0.
    links["2"] = replace(
        crank,
        axes=(*crank.axes, "32b"),
        arcs=(*crank.arcs, crank.arcs[0]),
        angles=(*crank.angles, 0.0),
    )
    links["4"] = replace(
        rocker,
        axes=(*rocker.axes, "43b"),
        arcs=(*rocker.arcs, 0.0),
        angles=(*rocker.angles, 0.0),
    )
    pairs = (
        *mechanism.pairs,
        Pair("32b", "R", ("2", "3b")),
        Pair("43b", "R", ("3b", "4")),
    )
    return replace(
        mechanism,
        links=(*mechanism.links, "3b"),
        pairs=pairs,
        geometry=SizeGeometry(links),
    )


def _circle(tilt, radius):
    """Return a circle in the axes of a link: its centre is `tilt` (deg) from the z axis."""
    angle = np.radians(tilt)
    centre = (float(np.sin(angle)), 0.0, float(np.cos(angle)))
    return Profile("circle", centre=centre, radius=float(np.radians(radius)))


def with_cam(mechanism, pivot_arc, cam, roller, cam_link="2"):
    """Return a mechanism with a cam on one of its links, and a follower that it moves.

    The follower is a link on the ground with a roller, which slides on the cam (pair of
    type Cs). Cam and roller are circles.

    Parameters
    ----------
    mechanism
        The mechanism of revolute pairs.
    pivot_arc
        Arc (deg) on the ground from its first joint axis to the pivot of the follower. The
        angle about the first axis, from the arc to the second axis to this one, is 200 deg.
    cam, roller
        The circles of the cam link and of the follower, each as a tuple: arc (deg) from the
        z axis of the link to its centre, in the plane of x and z, and its radius (deg).
    cam_link
        The link that has the cam on it.
    """
    links = dict(mechanism.geometry.links)
    ground = links["1"]
    links["1"] = replace(
        ground,
        axes=(*ground.axes, "f1"),
        arcs=(*ground.arcs, float(np.radians(pivot_arc))),
        angles=(*ground.angles, float(np.radians(200.0))),
    )
    links["f"] = LinkSizes(("f1",))
    contact = Pair("cam", "Cs", (cam_link, "f"), (_circle(*cam), _circle(*roller)))
    pairs = (*mechanism.pairs, Pair("f1", "R", ("1", "f")), contact)
    return replace(
        mechanism,
        links=(*mechanism.links, "f"),
        pairs=pairs,
        geometry=SizeGeometry(links),
    )


def limited_cam(random):
    """Return a random cam with a roller follower, in which the cam cannot turn fully.

    Cam and roller are circles in sliding contact (pair of type Cs). The eccentricity of the
    cam is the arc from its axis of rotation to the centre of its circle. The arc of the
    follower leads from its pivot to the centre of the roller.

    The contact of two circles acts like a link between their centres, with the sum of both
    radii as its arc. This link and the follower connect the centre of the cam to the pivot
    of the follower. The follower arc is chosen so that both are in line at one angle of the
    cam, where the cam can turn no further.
    """
    ground_deg = float(random.integers(35, 80))
    eccentricity_deg = float(random.integers(8, 30))
    cam_radius_deg = float(random.integers(8, 25))
    roller_radius_deg = float(random.integers(4, 15))
    radii_deg = cam_radius_deg + roller_radius_deg
    # Distance from the centre of the cam to the pivot of the follower where both are in
    # line. As the cam turns, the distance varies by the eccentricity to both sides of the
    # ground arc.
    distance_deg = ground_deg + eccentricity_deg * random.uniform(-0.9, 0.9)
    # Both are in line in one of two ways. Stretched out, they add up to the distance:
    # follower arc = distance - radii. Folded onto each other, their difference is the
    # distance: follower arc = radii - distance or radii + distance. Sizes are rounded as in
    # a file.
    difference_deg = float(np.round(distance_deg - radii_deg, random.integers(0, 6)))
    if random.random() < 0.5:
        follower_arc_deg = abs(difference_deg)
    else:
        follower_arc_deg = float(np.round(distance_deg + radii_deg, 2))
    # With an arc of 0 the roller would turn about its own centre, so a smaller arc is
    # raised to 3 deg. The two are then in line at other distances, radii - 3 and radii + 3
    # deg, between which the distance must lie. The cam still cannot turn fully: over a
    # whole turn, the distance would vary by twice the eccentricity, which is at least 16
    # deg.
    follower_arc_deg = max(follower_arc_deg, 3.0)
    links = {
        "1": LinkSizes(("21", "f1"), (float(np.radians(ground_deg)),)),
        "2": LinkSizes(("21",)),
        "f": LinkSizes(("f1",)),
    }
    cam = _circle(eccentricity_deg, cam_radius_deg)
    roller = _circle(follower_arc_deg, roller_radius_deg)
    pairs = (
        Pair("21", "R", ("1", "2")),
        Pair("f1", "R", ("1", "f")),
        Pair("cam", "Cs", ("2", "f"), (cam, roller)),
    )
    inputs = (Input("21", 0.0, 2.0 * np.pi),)
    return Mechanism("limited", "1", tuple(links), pairs, SizeGeometry(links), inputs)


def folding_mechanism(seed):
    """Return a random mechanism whose links can come in line (a fold), and its kind.

    At a fold two assembly modes meet, and joint angles are inaccurate. Tests of error
    bounds need such mechanisms. There are three kinds:

    - "cam": only a cam and its roller follower. The cam cannot turn fully (`limited_cam`).
    - "contact": a four-bar of special geometry, for example a rhombus, perhaps with dyads
      (two links joined by a pair). Its crank or rocker has a cam, which moves a follower
      on the ground (`with_cam`).
    - "redundant": such a four-bar with the same coupler twice (`with_second_coupler`).

    Returns
    -------
    The kind, with which a test can leave out a kind, and the mechanism.
    """
    # Another seed than that of `special_mechanism(seed)`, for independent numbers.
    random = np.random.default_rng(seed + 10**7)
    kind = str(random.choice(["cam", "contact", "redundant"], p=[0.4, 0.2, 0.4]))
    if kind == "cam":
        return kind, limited_cam(random)
    _geometry_name, mechanism, _inputs = special_mechanism(seed)
    if kind == "redundant":
        return kind, with_second_coupler(mechanism)
    # All sizes are in degrees. A link has joint axes, and the first one is its z axis. The
    # pivot arc is the angle between the first axis of the ground and the pivot axis of the
    # follower. A centre arc is the angle between the first axis of a link and the centre of
    # its circle (cam or roller).
    pivot_arc = float(random.integers(30, 90))
    cam_centre_arc = float(random.integers(5, 30))
    cam_radius = float(random.integers(10, 30))
    roller_centre_arc = float(random.integers(30, 60))
    roller_radius = float(random.integers(5, 20))
    cam_link = str(random.choice(["2", "4"]))  # the crank or the rocker of the four-bar
    cam = (cam_centre_arc, cam_radius)
    roller = (roller_centre_arc, roller_radius)
    return kind, with_cam(mechanism, pivot_arc, cam, roller, cam_link)


def inputs_beside_folds(mechanism, seed):
    """Return inputs (n, 1) in rad at which a mechanism may be folded (in line), or nearly.

    A fold is sought at random multiples of 90 degrees, and at the ends of assembly modes
    (ways to assemble the links). The inputs lie 1e-6 to 1e-16 rad beside these angles, and
    two of them exactly there.

    Raises
    ------
    SpherekitError
        If the mechanism cannot be assembled at any input.
    """
    random = np.random.default_rng(seed)
    folds = np.radians(90.0 * random.integers(0, 5, 6)).tolist()
    for mode in PositionAnalysis(mechanism, samples=9).assembly_modes:
        # A mode that ends within the range of the input has a curve as its guide. The first
        # and last inputs of this curve are the ends of the mode.
        if isinstance(mode.guide, ModeCurve):
            for end in mode.guide.inputs[[0, -1]]:
                folds += [end] * 3
    count = len(folds)
    signs = random.choice([-1.0, 1.0], count)
    distances = signs * 10.0 ** -random.uniform(6.0, 16.0, count)
    distances[:2] = 0.0
    return np.unique(np.array(folds) + distances)[:, None]
