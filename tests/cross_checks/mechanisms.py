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
    """Return the random mechanism of a seed, with its name, kind and number of samples.

    `KINDS` has a function per kind that draws a mechanism; the kind changes with the seed.
    Mechanisms are drawn until `PositionAnalysis` accepts one. `PositionAnalysis` raises an
    error for a mechanism that cannot be assembled, or whose number of inputs is not its
    number of degrees of freedom.
    """
    kind = tuple(KINDS)[seed % len(KINDS)]
    draw_mechanism = KINDS[kind]
    # The second number gives a sequence that differs from that of `default_rng(seed)`.
    random = np.random.default_rng([seed, 20])
    while True:
        try:
            mechanism = draw_mechanism(random)
            # If only sizes are given, assembly modes have to be searched to learn whether
            # the mechanism can be assembled. A reference pose is an assembly already.
            has_sizes = isinstance(mechanism.geometry, SizeGeometry)
            PositionAnalysis(mechanism, samples=3, search=has_sizes)
        except sk.SpherekitError:
            continue  # draw the next one
        name = f"random_{seed}"
        mechanism = replace(with_masses(random, mechanism), name=name)
        # 91 samples are a quarter of the default number, and take less time.
        return Subject(name, kind, mechanism, samples=91)


def with_masses(random, mechanism):
    """Return a mechanism in which 60 % of the moving links have a random inertia tensor.

    A tensor is trace(S) I - S of a positive matrix S, as mass distributions have it.
    """
    masses = []
    for link in mechanism.links[1:]:
        if random.random() < 0.6:
            a = random.normal(size=(3, 3))
            second_moments = 1e-3 * (a @ a.T)
            tensor = np.trace(second_moments) * np.eye(3) - second_moments
            x_row, y_row, z_row = map(as_float_tuple, tensor)
            masses.append(Mass(link, (x_row, y_row, z_row)))
    return replace(mechanism, masses=tuple(masses))


def _range(random):
    return RANGES[random.integers(len(RANGES))]


def _special(links):
    """Return a function that draws special mechanisms with this number of links."""

    def draw(random):
        while True:
            _, mechanism, _ = special_mechanism(int(random.integers(1 << 30)))
            if len(mechanism.links) == links:
                return _driven_anywhere(random, mechanism)

    return draw


def _geared(random):
    """Return a five-bar of R pairs whose cranks on the ground are bevel wheels in mesh.

    The links are the ground g, the cranks a and b, and the couplers c and d. The pair
    "mesh" is the rolling contact (type Cr) of both pitch cones, which are circles on the
    unit sphere. Teeth, shaft angle and axes are random. The input is one of the cranks,
    over several turns.
    """
    first_teeth, second_teeth = TEETH[random.integers(len(TEETH))]
    shaft_angle = np.radians(random.uniform(40.0, 120.0))
    # Pitch cones: sin(first) / sin(shaft_angle - first) is the ratio of the teeth.
    first_half_angle = np.arctan2(
        np.sin(shaft_angle), second_teeth / first_teeth + np.cos(shaft_angle)
    )
    left_axis = np.array([0.0, 0.0, 1.0])
    right_axis = np.array([np.sin(shaft_angle), 0.0, np.cos(shaft_angle)])
    axes = [left_axis, right_axis, *random_axes(random, 3)]
    ends = {"left": "ga", "right": "gb", "ac": "ac", "cd": "cd", "bd": "bd"}
    second_half_angle = shaft_angle - first_half_angle
    wheels = (
        Profile("circle", as_float_tuple(left_axis), float(first_half_angle)),
        Profile("circle", as_float_tuple(right_axis), float(second_half_angle)),
    )
    pairs = [Pair(name, "R", tuple(links)) for name, links in ends.items()]
    pairs.append(Pair("mesh", "Cr", ("a", "b"), wheels))
    pose = PoseGeometry(dict(zip(ends, map(as_float_tuple, axes), strict=True)))
    # Ranges of the input, rad.
    span = ((0.0, 2 * TURN), (-TURN, TURN), (0.0, 3 * TURN))[random.integers(3)]
    inputs = (Input("left" if random.random() < 0.7 else "right", *span),)
    return sk.Mechanism("made", "g", tuple("gabcd"), tuple(pairs), pose, inputs)


def _wheels_by_a_cam(random):
    """Return a cam whose roller follower is a wheel that turns the crank of a four-bar.

    The profile of the cam is a Fourier series about a colatitude of 25 degrees. Sizes are
    random; arcs and angles are degrees.
    """
    # Arcs of the ground (three), crank, coupler and rocker.
    lowest_arcs = [50, 60, 40, 15, 40, 40]
    highest_arcs = [80, 100, 80, 35, 80, 80]
    arcs = random.uniform(lowest_arcs, highest_arcs).tolist()
    ground_angles = random.uniform(-120.0, 120.0, 2).tolist()
    teeth = list(TEETH[random.integers(len(TEETH))])
    roller_radius = random.uniform(5.0, 15.0)
    roller_latitude = random.uniform(35.0, 55.0)
    cosines = random.normal(0.0, 2.0, 2).tolist()
    sines = random.normal(0.0, 2.0, 2).tolist()
    cam_profile = {
        "kind": "fourier",
        "centre_xyz": [0.0, 0.0, 1.0],
        "cosines": [25.0, *cosines],
        "sines": [0.0, *sines],
    }
    roller = {
        "link": "wheel",
        "roller": roller_radius,
        "centre_lonlat": [90.0, roller_latitude],
    }
    mechanism = sk.build(
        "made",
        angle_unit="deg",
        ground="frame",
        links={
            "frame": {
                "axes": ["cam", "swing", "turn", "out"],
                "arcs": arcs[:3],
                "angles": ground_angles,
            },
            "disc": {"axes": ["cam"]},
            "wheel": {"axes": ["swing"]},
            "crank": {"axes": ["turn", "pin"], "arcs": arcs[3:4]},
            "coupler": {"axes": ["pin", "joint"], "arcs": arcs[4:5]},
            "rocker": {"axes": ["out", "joint"], "arcs": arcs[5:]},
        },
        pairs={
            "cam": ["frame", "disc"],
            "swing": ["frame", "wheel"],
            "turn": ["frame", "crank"],
            "pin": ["crank", "coupler"],
            "joint": ["coupler", "rocker"],
            "out": ["frame", "rocker"],
            "mesh": {
                "type": "Cr",
                "links": ["wheel", "crank"],
                "axes": ["swing", "turn"],
                "teeth": teeth,
            },
            "contact": {
                "type": "Cs",
                "links": ["disc", "wheel"],
                "follower": roller,
                "profiles": {"disc": cam_profile},
            },
        },
        inputs={"cam": (0.0, 360.0)},  # replaced below by a range in radians
        outputs={"rocker": {"link": "rocker"}},
    )
    return replace(mechanism, inputs=(Input("cam", *_range(random)),))


def _cams(random):
    sliding = int(random.integers(1, 3))
    links = int(random.choice([3, 4, 5]))
    links += (links + sliding) % 2
    made = random_contact_chain(random, links, int(random.integers(0, 2)), sliding)
    return _driven_anywhere(random, made)


def _legs(random, leg_count):
    """Return a platform on two or three legs of R pairs, driven at the ground.

    Two legs are a five-bar; its output is the direction of the axis of pair 3-4, as carried
    by link 3. Three legs are a 3-RRR; its output is the orientation of link 8. Axes are
    random; in 40 % of the mechanisms one of them is a coordinate axis.
    """
    if leg_count == 3:
        edges = [(1, 2), (2, 3), (3, 8), (1, 4), (4, 5), (5, 8), (1, 6), (6, 7), (7, 8)]
    else:
        edges = [(1, 2), (2, 3), (3, 4), (4, 5), (1, 5)]
    axes = random_axes(random, len(edges))
    if random.random() < 0.4:
        axes[random.integers(len(axes))] = np.eye(3)[random.integers(3)]
    mechanism = mechanism_from_chain(edges, axes)
    spans = [(-1.0, 1.2), (0.0, TURN), (-np.pi, np.pi)]
    low, high = spans[random.integers(len(spans))]
    ground_pairs = [pair.name for pair in mechanism.pairs if pair.links[0] == "1"]
    inputs = tuple(Input(name, low, high) for name in ground_pairs)
    if leg_count == 3:
        output = Output("body", "8", "1", None)
    else:
        output = Output("body", "3", "1", as_float_tuple(axes[2]))
    return replace(mechanism, inputs=inputs, outputs=(output,))


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
