"""Mechanisms that several tests are about."""

from dataclasses import replace

import numpy as np
from mechanism_examples.linkages import mechanism_from_chain, random_axes
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.mechanism.elements import (
    Input,
    LinkSizes,
    Output,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
)

DEGREE = np.pi / 180


def direction_at_colatitude(colatitude):
    """Return the direction at this colatitude from z, towards y (as link arcs lie)."""
    return (0.0, float(np.sin(colatitude)), float(np.cos(colatitude)))


def cam_with_follower(ground, profile, follower, contact="external"):
    """Return a cam (link 2) and an oscillating follower (link 3) in sliding contact.

    Both turn about axes in the ground, link 1. The cam is driven.

    Parameters
    ----------
    ground
        Arc (rad) between the axes of cam (pair 12) and follower (pair 13).
    profile, follower
        Profiles of cam and follower in the axes of their links.
    contact
        `"external"` or `"internal"`.
    """
    sizes = {
        "1": LinkSizes(("12", "13"), (ground,)),
        "2": LinkSizes(("12",)),
        "3": LinkSizes(("13",)),
    }
    pairs = (
        Pair("12", "R", ("1", "2")),
        Pair("13", "R", ("1", "3")),
        Pair("23", "Cs", ("2", "3"), (profile, follower), contact),
    )
    inputs = (Input("12", 0.0, 2 * np.pi),)
    links = ("1", "2", "3")
    return sk.Mechanism("cam", "1", links, pairs, SizeGeometry(sizes), inputs=inputs)


def one_link_mechanism(
    tensor, *loads, mass=None, centre=None, axis=(1.0, 0.0, 0.0), **more
):
    """Return a link that turns about an axis in the ground, at the pair 12."""
    pairs, axes = (Pair("12", "R", ("1", "2")),), PoseGeometry({"12": axis})
    made = sk.Mechanism("one_link", "1", ("1", "2"), pairs, axes).with_inputs("12")
    return replace(made.with_mass("2", tensor, mass, centre), loads=loads, **more)


def open_cam():
    """Return a cam whose profile is an open arc of waves, and a roller on it."""
    azimuth = np.linspace(-1.0, 1.0, 60)
    colatitude_deg = 25 + 4 * np.cos(azimuth) + 3 * np.cos(2 * azimuth)
    colatitude_deg = colatitude_deg + np.sin(2 * azimuth)
    sine = np.sin(DEGREE * colatitude_deg)
    cosine = np.cos(DEGREE * colatitude_deg)
    points = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=1)
    profile = Profile("points", points=tuple(map(tuple, points)), closed=False)
    roller = Profile("circle", direction_at_colatitude(ARM), ROLLER)
    return cam_with_follower(GROUND, profile, roller)


GROUND, ECCENTRICITY, DISC, ROLLER, ARM = (
    x * DEGREE for x in (60.0, 10.0, 25.0, 12.0, 45.0)
)


TURN = (0.0, 2 * np.pi)


def four_bar(arcs, span=TURN):
    """Return the four-bar of Di Gregorio 2024, Fig. 5, with these arcs (4,) rad."""
    base = sk.load("four_bar")
    sizes = {
        link: replace(size, arcs=(float(arcs[int(link) - 1]),))
        for link, size in base.geometry.links.items()
    }
    return replace(
        base, geometry=replace(base.geometry, links=sizes), inputs=(Input("21", *span),)
    )


def dixon_mechanism(random):
    """Return Dixon's movable framework K(3,3) on the sphere: nine bars join six points.

    Three points lie on one great circle and three on another at right angles; every bar
    joins a point of one to a point of the other. With azimuths x and y on the great
    circles, a bar has the cosine cos x cos y. It is unchanged if all cos x are multiplied
    by a factor and all cos y divided by it, so the framework moves. By the count of bars
    and points it is rigid.
    """
    x = random.uniform(0.5, 1.2, 3)
    y = random.uniform(0.5, 1.2, 3)
    first_points = np.stack([np.cos(x), np.sin(x), np.zeros(3)], axis=1)
    second_points = np.stack([np.cos(y), np.zeros(3), np.sin(y)], axis=1)
    points = np.concatenate([first_points, second_points])
    bars = [(a, b + 3) for a in range(3) for b in range(3)]
    pairs = []
    axes = {}
    for point in range(6):
        # Three bars meet in a point: two R pairs join them to the first of them.
        first_bar, *further_bars = [k for k, ends in enumerate(bars) if point in ends]
        for bar in further_bars:
            name = f"p{point}_{bar}"
            pairs.append(Pair(name, "R", (f"bar{first_bar}", f"bar{bar}")))
            axes[name] = tuple(points[point])
    return sk.Mechanism(
        "dixon",
        "bar0",
        tuple(f"bar{k}" for k in range(9)),
        tuple(pairs),
        PoseGeometry(axes),
        inputs=(Input("p0_1", -0.05, 0.05),),
    )


def mechanism_from_sizes(links, pairs, inputs, output, zeros=None):
    """Return a mechanism of R pairs (revolute joints) from a short notation.

    Parameters
    ----------
    links
        By link: its axes as words, then its arcs and its angles in degrees. The arcs lead
        from the first axis to each of the other axes. The angles are about the first axis,
        from the first arc to each of the other arcs. The first link is the ground.
    pairs
        By pair: its two links as words.
    inputs
        Names of the input pairs; each moves from 0 to 6 rad.
    output
        `Output` of the mechanism.
    zeros
        By pair: angle (rad) between the first arcs of its two links at which its variable
        is 0. The default is 0.
    """
    links_by_name = {}
    for link, (axes, arcs, angles) in links.items():
        links_by_name[link] = {"axes": axes.split(), "arcs": arcs, "angles": angles}
    mechanism = sk.build(
        "made",
        angle_unit="deg",
        ground=next(iter(links)),
        links=links_by_name,
        pairs={name: ends.split() for name, ends in pairs.items()},
        inputs=list(inputs),
    )
    return replace(
        mechanism,
        geometry=replace(mechanism.geometry, zeros=zeros or {}),
        inputs=tuple(Input(name, 0.0, 6.0) for name in inputs),
        outputs=(output,),
    )


def posed_three_rrr():
    """Return the 3-RRR given by a reference pose of random axes, some angles not 0."""
    made = sk.load("three_rrr")
    axes = Rotation.random(9, random_state=5).as_matrix()[:, :, 2].tolist()
    names = [f"{leg}{k}" for k in (1, 2, 3) for leg in "abc"]
    return replace(
        made,
        geometry=PoseGeometry(
            {name: tuple(axis) for name, axis in zip(names, axes, strict=True)},
            {"a1": 0.3, "a2": -0.4, "c2": -0.8},
        ),
        inputs=tuple(Input(f"a{k}", -0.1, 0.1) for k in (1, 2, 3)),
    )


def platform_with_unlike_legs():
    """Return a platform on three legs that are driven in three ways.

    Leg 1 is driven at the base, leg 2 through a four-bar (drive, rod, crank2), and leg 3 at
    its elbow.
    """
    # For each link: the names of its axes, the arcs (deg) from the first axis to each other
    # axis, and the angles (deg) about the first axis from the first arc to each other arc.
    links = {
        "base": ("a1 a2 d2 a3", [70.0, 95.0, 110.0], [30.0, 140.0]),
        "crank1": ("a1 b1", [50.0], []),
        "coupler1": ("b1 c1", [75.0], []),
        "drive": ("d2 e2", [35.0], []),
        "rod": ("e2 f2", [48.0], []),
        "crank2": ("a2 f2 b2", [40.0, 65.0], [75.0]),
        "coupler2": ("b2 c2", [70.0], []),
        "crank3": ("b3 a3", [58.0], []),
        "coupler3": ("c3 b3", [66.0], []),
        "platform": ("c2 c1 c3", [60.0, 75.0], [110.0]),
    }
    # The two links of each pair.
    pairs = {
        "a1": "base crank1",
        "b1": "coupler1 crank1",
        "c1": "coupler1 platform",
        "d2": "drive base",
        "e2": "drive rod",
        "f2": "rod crank2",
        "a2": "base crank2",
        "b2": "crank2 coupler2",
        "c2": "platform coupler2",
        "a3": "base crank3",
        "b3": "crank3 coupler3",
        "c3": "coupler3 platform",
    }
    # The zero of a pair is the angle (rad) between the first arcs of both links when the
    # variable of the pair is 0. Any zeros other than 0 will do, for two inputs and a
    # passive pair.
    zeros = {"a1": 0.4, "b3": -0.7, "c2": 0.3}
    return mechanism_from_sizes(
        links,
        pairs,
        inputs=["b3", "a1", "d2"],
        output=Output("pose", "platform", "base"),
        zeros=zeros,
    )


def serial_chain(count):
    """Return an open chain of two or three R pairs in a row, all of them driven.

    Links are base, yoke, fork and, with three pairs, tool. With two pairs the output is a
    direction of the last link, with three its orientation.

    The zero of a pair is the angle (rad) between the arcs of its links at which its
    variable is 0. Pair q has the zero 0.5, so that tests also see a zero other than the
    default 0.
    """
    # By link: names of its axes, arcs from the first axis to the other axes, and angles
    # between arcs (both deg). An angle needs three axes, so there is none here.
    links = {"base": ("p", [], []), "yoke": ("p q", [80.0], [])}
    pairs = {"p": "base yoke", "q": "fork yoke"}
    if count == 2:
        links["fork"] = ("q", [], [])
        output = Output("pose", "fork", "base", (0.36, -0.48, 0.8))
    else:
        links["fork"] = ("q r", [65.0], [])
        links["tool"] = ("r", [], [])
        pairs["r"] = "fork tool"
        output = Output("pose", "tool", "base")
    return mechanism_from_sizes(
        links, pairs, inputs=list(pairs), output=output, zeros={"q": 0.5}
    )


LINKS = {
    "base": {"axes": ["drive", "hinge"], "arcs": [60]},
    "crank": {"axes": ["drive", "tip"], "arcs": (np.float32(20),)},
    "coupler": {"axes": ["tip", "joint"], "arcs": np.array([70.0])},
    "rocker": {"axes": ["hinge", "joint"], "arcs": [40]},
}
PAIRS = {
    "drive": ["base", "crank"],
    "tip": ["crank", "coupler"],
    "joint": ["coupler", "rocker"],
    "hinge": {"links": ["base", "rocker"], "zero": 180},
}


def four_bar_from_file(**changes):
    given = {"angle_unit": "deg", "ground": "base", "links": LINKS, "pairs": PAIRS}
    return sk.build("crank_rocker", **{**given, **changes})


def two_four_bars():
    """Return two four-bars that share link 1: two freedoms, one in each loop."""
    edges = [(1, 2), (2, 3), (3, 4), (1, 4), (1, 5), (5, 6), (6, 7), (1, 7)]
    return mechanism_from_chain(edges, random_axes(np.random.default_rng(0), len(edges)))


def crank_rocker(base=60.0, crank=20.0, coupler=70.0, rocker=40.0, zero=0.0, **more):
    """Return the four-bar of `built` with these arcs and this zero of the hinge (deg)."""
    arcs = {"base": base, "crank": crank, "coupler": coupler, "rocker": rocker}
    links = {link: {**LINKS[link], "arcs": [arc]} for link, arc in arcs.items()}
    hinge = {"links": ["base", "rocker"], "zero": zero}
    return four_bar_from_file(links=links, pairs={**PAIRS, "hinge": hinge}, **more)


def two_followers(contact_links=("3", "5"), contact="external"):
    """Return a mechanism with two inputs, two cams in series and a follower for each cam.

    Cam 2 turns about the ground, and cam 3 about cam 2 (pairs 12 and 23, the inputs). The
    followers 4 and 5 turn about the ground. Cam 2 slides on follower 4 and cam 3 on
    follower 5 (contacts 24 and 35, of type Cs). All profiles are circles. If input 23 is
    locked, cam 3 becomes a part of cam 2, which then has both contacts.

    Parameters
    ----------
    contact_links
        The links of contact 35 in the order of the file: `("3", "5")` or `("5", "3")`.
    contact
        `"external"` or `"internal"`. In an internal contact, the circle of the first link
        lies within that of the second link.
    """
    degree = np.pi / 180.0
    # On the ground, the arcs from axis 12 to the axes 14 and 15 form an angle of 50 deg.
    arcs = (60.0 * degree, 80.0 * degree)
    sizes = {
        "1": LinkSizes(("12", "14", "15"), arcs, (50.0 * degree,)),
        "2": LinkSizes(("12", "23"), (40.0 * degree,)),
        "3": LinkSizes(("23",)),
        "4": LinkSizes(("14",)),
        "5": LinkSizes(("15",)),
    }

    def circle(colatitude_deg, radius_deg):
        """Return a circle; `colatitude_deg` is the arc from the z axis to its centre."""
        centre = direction_at_colatitude(colatitude_deg * degree)
        return Profile("circle", centre, radius_deg * degree)

    # The second circle of an internal contact has to be the larger one.
    first, second = contact_links
    radii_deg = {first: 15.0, second: 60.0 if contact == "internal" else 20.0}
    circles = {"3": circle(12.0, radii_deg["3"]), "5": circle(50.0, radii_deg["5"])}
    pairs = (
        Pair("12", "R", ("1", "2")),
        Pair("23", "R", ("2", "3")),
        Pair("14", "R", ("1", "4")),
        Pair("15", "R", ("1", "5")),
        Pair("24", "Cs", ("2", "4"), (circle(10.0, 20.0), circle(45.0, 12.0))),
        Pair("35", "Cs", (first, second), (circles[first], circles[second]), contact),
    )
    inputs = (Input("12", 0.0, 1.0), Input("23", 0.5, 0.9))
    geometry = SizeGeometry(sizes)
    return sk.Mechanism("cams", "1", tuple("12345"), pairs, geometry, inputs=inputs)
