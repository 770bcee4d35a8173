"""The mechanisms that are examined: all shipped ones, and random ones of every kind."""

from dataclasses import dataclass, replace

import numpy as np
from mechanism_examples.linkages import (
    EIGHT_BARS,
    as_float_tuple,
    grow_dyad_chain,
    mechanism_from_chain,
    random_axes,
    random_contact_chain,
)
from mechanism_examples.random_mechanisms import random_mechanism
from mechanism_examples.special_mechanisms import special_mechanism

import spherekit as sk
from spherekit.files.library import shipped
from spherekit.mechanism.elements import (
    Input,
    Output,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
)
from spherekit.mechanism.inertia import Mass
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.position_analysis import PositionAnalysis

TURN = 2.0 * np.pi
RANGES = ((0.0, TURN), (-np.pi, np.pi), (0.0, 2.0 * TURN), (-0.7, 1.9), (-TURN, TURN))
"""Ranges of inputs (rad), two of them of more than one turn."""
TEETH = ((20, 40), (30, 30), (18, 36), (17, 23), (40, 20))


@dataclass(frozen=True)
class Subject:
    """A mechanism under its name, the kind it is of, and the samples it is run with."""

    name: str
    kind: str
    mechanism: sk.Mechanism
    samples: int | None = None


def shipped_subjects(names=()):
    """Return the shipped mechanisms of these names, by default all."""
    every = sorted(name for pack in shipped() for name in pack.files)
    return [Subject(name, "shipped", driven_at(sk.load(name))) for name in names or every]


def random_subject(seed):
    """Return the mechanism of a seed."""
    kind = tuple(KINDS)[seed % len(KINDS)]
    random = np.random.default_rng([seed, 20])
    while True:
        try:
            made = KINDS[kind](random)
            PositionAnalysis(
                made, samples=3, search=isinstance(made.geometry, SizeGeometry)
            )
        except sk.SpherekitError:
            continue
        made = replace(with_masses(random, made), name=f"random_{seed}")
        return Subject(f"random_{seed}", kind, made, 91)


def with_masses(random, made):
    """Return a mechanism some of whose links have inertia; the others have none."""
    masses = []
    for link in made.links[1:]:
        if random.random() < 0.6:
            a = random.normal(size=(3, 3))
            spread = 1e-3 * (a @ a.T)
            tensor = np.trace(spread) * np.eye(3) - spread
            one, two, three = map(as_float_tuple, tensor)
            masses.append(Mass(link, (one, two, three)))
    return replace(made, masses=tuple(masses))


def _range(random):
    return RANGES[random.integers(len(RANGES))]


def _special(links):
    """Return what draws a mechanism of so many links and of special geometry."""

    def drawn(random):
        while True:
            _, made, _ = special_mechanism(int(random.integers(1 << 30)))
            if len(made.links) == links:
                return _driven_anywhere(random, made)

    return drawn


def _geared(random):
    """Return a five-bar whose cranks on the ground mesh, over several turns."""
    one, other = TEETH[random.integers(len(TEETH))]
    shafts = np.radians(random.uniform(40.0, 120.0))
    first = np.arctan2(np.sin(shafts), other / one + np.cos(shafts))
    left = np.array([0.0, 0.0, 1.0])
    right = np.array([np.sin(shafts), 0.0, np.cos(shafts)])
    axes = [left, right, *random_axes(random, 3)]
    ends = {"left": "ga", "right": "gb", "ac": "ac", "cd": "cd", "bd": "bd"}
    wheels = (
        Profile("circle", as_float_tuple(left), float(first)),
        Profile("circle", as_float_tuple(right), float(shafts - first)),
    )
    pairs = [Pair(name, "R", tuple(links)) for name, links in ends.items()]
    pairs = (*pairs, Pair("mesh", "Cr", ("a", "b"), wheels))
    pose = PoseGeometry(dict(zip(ends, map(as_float_tuple, axes), strict=True)))
    span = ((0.0, 2 * TURN), (-TURN, TURN), (0.0, 3 * TURN))[random.integers(3)]
    inputs = (Input("left" if random.random() < 0.7 else "right", *span),)
    return sk.Mechanism("made", "g", tuple("gabcd"), pairs, pose, inputs)


def _wheels_by_a_cam(random):
    """Return a cam whose roller swings a wheel, which turns the crank of a four-bar."""
    low, high = [50, 60, 40, 15, 40, 40], [80, 100, 80, 35, 80, 80]
    arcs = random.uniform(low, high).tolist()
    angles = random.uniform(-120.0, 120.0, 2).tolist()
    frame = {"axes": ["cam", "swing", "turn", "out"], "arcs": arcs[:3], "angles": angles}
    pairs = {
        **{name: ["frame", link] for name, link in (("cam", "disc"), ("swing", "wheel"))},
        **{"turn": ["frame", "crank"], "pin": ["crank", "coupler"]},
        **{"joint": ["coupler", "rocker"], "out": ["frame", "rocker"]},
    }
    mesh = {"type": "Cr", "links": ["wheel", "crank"], "axes": ["swing", "turn"]}
    mesh["teeth"] = list(TEETH[random.integers(len(TEETH))])
    roller, height = random.uniform(5.0, 15.0), random.uniform(35.0, 55.0)
    cosines, sines = random.normal(0.0, 2.0, 2), random.normal(0.0, 2.0, 2)
    waves = {"cosines": [25.0, *cosines.tolist()], "sines": [0.0, *sines.tolist()]}
    disc = {"kind": "fourier", "centre_xyz": [0.0, 0.0, 1.0], **waves}
    follower = {"link": "wheel", "roller": roller, "centre_lonlat": [90.0, height]}
    touch = {"type": "Cs", "links": ["disc", "wheel"], "follower": follower}
    made = sk.build(
        "made",
        angle_unit="deg",
        ground="frame",
        links={
            **{"frame": frame, "disc": {"axes": ["cam"]}, "wheel": {"axes": ["swing"]}},
            "crank": {"axes": ["turn", "pin"], "arcs": arcs[3:4]},
            "coupler": {"axes": ["pin", "joint"], "arcs": arcs[4:5]},
            "rocker": {"axes": ["out", "joint"], "arcs": arcs[5:]},
        },
        pairs={**pairs, "mesh": mesh, "contact": {**touch, "profiles": {"disc": disc}}},
        inputs={"cam": (0.0, 360.0)},
        outputs={"rocker": {"link": "rocker"}},
    )
    return replace(made, inputs=(Input("cam", *_range(random)),))


def _cams(random):
    sliding = int(random.integers(1, 3))
    links = int(random.choice([3, 4, 5]))
    links += (links + sliding) % 2
    made = random_contact_chain(random, links, int(random.integers(0, 2)), sliding)
    return _driven_anywhere(random, made)


def _legs(random, count):
    """Return a five-bar that points, or a 3-RRR, with random or special axes."""
    edges = [(1, 2), (2, 3), (3, 4), (4, 5), (1, 5)]
    if count == 3:
        edges = [(1, 2), (2, 3), (3, 8), (1, 4), (4, 5), (5, 8), (1, 6), (6, 7), (7, 8)]
    axes = random_axes(random, len(edges))
    if random.random() < 0.4:
        axes[random.integers(len(axes))] = np.eye(3)[random.integers(3)]
    made = mechanism_from_chain(edges, axes)
    spans = [(-1.0, 1.2), (0.0, TURN), (-np.pi, np.pi)]
    low, high = spans[random.integers(len(spans))]
    driven = [p.name for p in made.pairs if p.links[0] == "1"]
    inputs = tuple(Input(name, low, high) for name in driven)
    direction = None if count == 3 else as_float_tuple(axes[2])
    output = Output("body", "8" if count == 3 else "3", "1", direction)
    return replace(made, inputs=inputs, outputs=(output,))


def _driven_anywhere(random, made):
    turning = [pair.name for pair in made.pairs if pair.type == "R"]
    driven = str(random.choice(turning))
    return replace(made, inputs=(Input(driven, *_range(random)),))


def _grown(random):
    made = grow_dyad_chain(
        random, int(random.choice([6, 6, 8])), bool(random.random() < 0.5)
    )
    return _driven_anywhere(random, made)


def _any(random):
    """Return what the fuzzing of poles draws from, with a range that is worth it."""
    _, made = random_mechanism(int(random.integers(1 << 30)))
    if len(made.links) > 8:
        raise sk.SpherekitError("too large to examine many of")
    inputs = tuple(Input(item.pair, *_range(random)) for item in made.inputs)
    return replace(made, inputs=inputs)


def _eight_bar(random):
    chain = EIGHT_BARS[int(random.integers(len(EIGHT_BARS)))]
    return _driven_anywhere(random, mechanism_from_chain(chain, random_axes(random, 10)))


KINDS = {
    "four-bar of special arcs": _special(4),
    "geared five-bar": _geared,
    "two inputs": lambda random: _legs(random, 2),
    "six-bar of special arcs": _special(6),
    "cams": _cams,
    "dyads and triads": _grown,
    "any graph": _any,
    "three inputs": lambda random: _legs(random, 3),
    "eight-bar": _eight_bar,
    "wheels turned by a cam": _wheels_by_a_cam,
}
"""What random mechanisms are of, in turn."""
