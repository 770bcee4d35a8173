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
    """Return a cam (link 2) and an oscillating follower (link 3) touching it."""
    axes = {"1": ("12", "13"), "2": ("12",), "3": ("13",)}
    sizes = {link: LinkSizes(own, (ground,) * (len(own) - 1)) for link, own in axes.items()}
    pairs = [Pair(name, "R", tuple(name)) for name in ("12", "13")]
    touch = Pair("23", "Cs", ("2", "3"), (profile, follower), contact)
    inputs = (Input("12", 0.0, 2 * np.pi),)
    links = ("1", "2", "3")
    pairs = (*pairs, touch)
    return sk.Mechanism("cam", "1", links, pairs, SizeGeometry(sizes), inputs=inputs)


def one_link_mechanism(
    tensor, *loads, mass=None, centre=None, axis=(1.0, 0.0, 0.0), **more
):
    """Return a link that turns about an axis in the ground, at the pair 12."""
    pairs, axes = (Pair("12", "R", ("1", "2")),), PoseGeometry({"12": axis})
    made = sk.Mechanism("one_link", "1", ("1", "2"), pairs, axes).with_inputs("12")
    return replace(made.with_mass("2", tensor, mass, centre), loads=loads, **more)


def open_cam():
    """Return a cam whose profile of waves is an arc alone, and a roller on it."""
    angles = np.linspace(-1.0, 1.0, 60)
    waves = 25 + 4 * np.cos(angles) + 3 * np.cos(2 * angles) + np.sin(2 * angles)
    across, up = np.sin(DEGREE * waves), np.cos(DEGREE * waves)
    points = np.stack([across * np.cos(angles), across * np.sin(angles), up], axis=1)
    part = Profile("points", points=tuple(map(tuple, points)), closed=False)
    return cam_with_follower(
        GROUND, part, Profile("circle", direction_at_colatitude(ARM), ROLLER)
    )


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
    """Return the movable K(3,3) of Dixon on the sphere: nine bars, six points.

    Three points on one great circle, three on one across it; with azimuths x and y on
    them a bar has the cosine cos x cos y, which a common factor of all cos x and its
    inverse for all cos y leaves unchanged. By counting it is rigid.
    """
    x, y = random.uniform(0.5, 1.2, 3), random.uniform(0.5, 1.2, 3)
    here = np.stack([np.cos(x), np.sin(x), np.zeros(3)], axis=1)
    there = np.stack([np.cos(y), np.zeros(3), np.sin(y)], axis=1)
    bars = [(a, b) for a in range(3) for b in range(3)]
    pairs, axes = [], {}
    for point in range(6):
        ends = [k for k, (a, b) in enumerate(bars) if point in (a, b + 3)]
        axis = tuple(here[point] if point < 3 else there[point - 3])
        for other in ends[1:]:
            name = f"p{point}_{other}"
            pairs.append(Pair(name, "R", (f"bar{ends[0]}", f"bar{other}")))
            axes[name] = axis
    return sk.Mechanism(
        "dixon",
        "bar0",
        tuple(f"bar{k}" for k in range(9)),
        tuple(pairs),
        PoseGeometry(axes),
        inputs=(Input("p0_1", -0.05, 0.05),),
    )


def mechanism_from_sizes(links, pairs, inputs, output, zeros=None):
    """A mechanism from link sizes in degrees and pairs as name -> two links."""
    names = "axes", "arcs", "angles"
    made = sk.build(
        "made",
        angle_unit="deg",
        ground=next(iter(links)),
        links={
            link: dict(zip(names, (axes.split(), *sizes), strict=True))
            for link, (axes, *sizes) in links.items()
        },
        pairs={name: ends.split() for name, ends in pairs.items()},
        inputs=list(inputs),
    )
    geometry = replace(made.geometry, zeros=zeros or {})
    inputs = tuple(Input(name, 0.0, 6.0) for name in inputs)
    return replace(made, geometry=geometry, inputs=inputs, outputs=(output,))


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
    """Three legs: RRR driven at the base, one through a four-bar, one at its elbow."""
    return mechanism_from_sizes(
        {
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
        },
        dict(
            **{"a1": "base crank1", "b1": "coupler1 crank1", "c1": "coupler1 platform"},
            **{"d2": "drive base", "e2": "drive rod", "f2": "rod crank2"},
            **{"a2": "base crank2", "b2": "crank2 coupler2", "c2": "platform coupler2"},
            **{"a3": "base crank3", "b3": "crank3 coupler3", "c3": "coupler3 platform"},
        ),
        ["b3", "a1", "d2"],
        Output("pose", "platform", "base"),
        {"a1": 0.4, "b3": -0.7, "c2": 0.3},
    )


def serial_chain(count):
    """An open chain of two or three links, whose output link has a single pair."""
    links = {
        "base": ("p", [], []),
        "yoke": ("p q", [80.0], []),
        "fork": ("q r", [65.0], []),
        "tool": ("r", [], []),
    }
    pairs = {"p": "base yoke", "q": "fork yoke", "r": "fork tool"}
    if count == 2:
        links = {**{k: links[k] for k in ("base", "yoke")}, "fork": ("q", [], [])}
        del pairs["r"]
    tool = list(links)[-1]
    x = np.array([0.36, -0.48, 0.8]) if count == 2 else None
    direction = None if x is None else tuple(float(v) for v in x)
    return mechanism_from_sizes(
        links, pairs, list(pairs), Output("pose", tool, "base", direction), {"q": 0.5}
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
