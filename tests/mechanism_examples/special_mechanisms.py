"""Mechanisms of special geometry, by seed, and the inputs at which rounding shows most.

Right angles, equal arcs, kites, rhombi, parallelograms, and four-bars that fold flat, all
of them exactly or nearly; by themselves, or with dyads grown on them. Sizes are decimal
numbers of degrees, as a file has them.
"""

from dataclasses import replace

import numpy as np

from spherekit.mechanism.elements import Input, LinkSizes, Pair, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism

KINDS = (
    *("right angles", "rhombus", "parallelogram", "kite"),
    *("folding", "supplementary", "some right angles"),
)

FOUR_BAR = (("41", 1, 4), ("21", 1, 2), ("32", 2, 3), ("43", 3, 4))


def special_mechanism(seed):
    """Return a random mechanism of special geometry, and inputs, many near right angles.

    Special are right angles, equal arcs, and arcs with which all links can lie in line.
    Rounding errors are then largest. The mechanism is a four-bar with none, one
    or two dyads (two links joined by a pair). In half of the cases one arc of the four-bar
    is changed by 1e-3 to 1e-12 degrees, so its geometry is only nearly special.

    Returns
    -------
    family
        Words for number of bars and special geometry.
    mechanism
        Mechanism with one input.
    inputs
        (n, 1) rad, in rising order.
    """
    random = np.random.default_rng(seed)
    kind = KINDS[random.integers(len(KINDS))]
    dyad_count = int(random.choice([0, 1, 2], p=[0.5, 0.3, 0.2]))
    arcs_deg = _arcs(random, kind)
    if random.random() < 0.5:
        k = random.integers(4)
        # A change of either sign, 1e-3 to 1e-12 in size.
        changed_deg = arcs_deg[k] + _tiny(random, 3, 12)
        arcs_deg[k] = float(f"{changed_deg:.12f}")  # 12 decimals, as in a file
    mechanism = four_bar(arcs_deg)
    # Arcs of dyads are right angles or arcs of the four-bar, which makes special geometry
    # likely. A set has no order, so they are sorted to get the same mechanism each time.
    for _ in range(dyad_count):
        mechanism = _with_dyad(random, mechanism, sorted({90.0, *arcs_deg}))
    driven = str(random.choice(["21", "41", "32"], p=[0.7, 0.2, 0.1]))
    mechanism = replace(mechanism, inputs=(Input(driven, 0.0, 2.0 * np.pi),))
    bars = ("four-bar", "six-bar", "eight-bar")[dyad_count]
    return f"{bars}, {kind}", mechanism, np.radians(_inputs(random))[:, None]


def straight_mechanism(seed):
    """Return a random mechanism with nearly special arcs, and inputs (n, 1) rad.

    It is a four-bar with none, one or two dyads (two links joined by a pair), of one of
    three kinds:

    - 0: an arc of the four-bar differs from 0 or 180 degrees by 1e-2 to 1e-9 degrees.
    - 1: the four-bar nearly has a change point, at which all its links are on one great
      circle. Its fourth arc is 1e-1 to 1e-9 degrees longer than that of a four-bar with a
      change point.
    - 2: one of the arcs of which dyads are made differs from 0 or 180 degrees by 1e-2 to
      1e-9 degrees.
    """
    # The offset gives other random numbers than those of `special_mechanism(seed)`.
    random = np.random.default_rng(seed + 10**6)
    arcs_deg = [float(np.round(random.uniform(20.0, 150.0), 3)) for _ in range(4)]
    kind = random.integers(3)
    if kind == 0:
        arcs_deg[random.integers(4)] = _nearly_straight(random)
    elif kind == 1:
        a, b, c, _ = arcs_deg
        # All links can be on one great circle if b + d = a + c, or if b = a + c + d. One of
        # the two equations has a solution d >= 0, which is abs(a + c - b).
        fourth_deg = abs(a + c - b) + 10.0 ** -random.integers(1, 10)
        # An arc must be less than 180 degrees. Otherwise an ordinary arc replaces it.
        if not fourth_deg < 180.0:
            fourth_deg = 60.0
        arcs_deg[3] = float(f"{fourth_deg:.12f}")  # 12 decimals, as in a file
    # `_with_dyad` draws the arcs of a dyad from this list. Its order has no meaning.
    dyad_arcs_deg = sorted(
        float(np.round(random.uniform(10.0, 170.0), 3)) for _ in range(4)
    )
    if kind == 2:
        dyad_arcs_deg.append(_nearly_straight(random))
    mechanism = four_bar(arcs_deg)
    fewest_dyads = 1 if kind == 2 else 0
    for _ in range(int(random.integers(fewest_dyads, 3))):
        mechanism = _with_dyad(random, mechanism, dyad_arcs_deg)
    driven = str(random.choice(["21", "41", "32"]))  # a pair of the four-bar
    # Inputs beside 0, 90 and 180 degrees, above them by 1e-1 to 1e-8 degrees.
    distances_deg = 10.0 ** -random.integers(1, 9, 3)
    near_special_deg = np.array([0.0, 90.0, 180.0]) + distances_deg
    path_deg = np.unique([*random.uniform(0.0, 360.0, 6), *near_special_deg])
    inputs = (Input(driven, 0.0, 2.0 * np.pi),)
    return replace(mechanism, inputs=inputs), np.radians(path_deg)[:, None]


def _nearly_straight(random):
    """Return an arc (degrees) that differs from 0 or 180 by 1e-2 to 1e-9."""
    off = 10.0 ** -random.integers(2, 10)
    return float(f"{abs(random.choice([0.0, 180.0]) - off):.12f}")


def _arcs(random, kind):
    """Return the four arcs (degrees) of a four-bar of one of `KINDS`, at random.

    A "folding" four-bar can lie flat: both pairs of opposite arcs have equal sums.
    """
    a, b, c = (float(5 * random.integers(4, 32)) for _ in range(3))
    if kind == "right angles":
        return [90.0] * 4
    if kind == "rhombus":
        return [a] * 4
    if kind == "parallelogram":
        return [a, b, a, b]
    if kind == "kite":
        return [a, a, b, b] if random.random() < 0.5 else [a, b, b, a]
    if kind == "supplementary":
        return [a, 180.0 - a, b, 180.0 - b]
    if kind == "some right angles":
        return list(random.permutation([90.0, 90.0, a, b]))
    # Only a "folding" four-bar is left: a + c = b + d.
    d = a + c - b
    while not 10.0 <= d <= 170.0:
        a, b, c = (float(5 * random.integers(4, 32)) for _ in range(3))
        d = a + c - b
    return [a, b, c, d]


def _inputs(random):
    """Return inputs, degrees: near multiples of 90, multiples of 15, and any."""
    near = [90.0 * random.integers(0, 5) + _tiny(random, 0, 9) for _ in range(8)]
    round_ = [15.0 * random.integers(0, 25) for _ in range(4)]
    return np.unique([*near, *round_, *random.uniform(0.0, 360.0, 4)])


def _tiny(random, low, high):
    """Return a number of random sign and of size 10^-low to 10^-high."""
    return float(random.choice([-1.0, 1.0]) * 10.0 ** -random.integers(low, high + 1))


def four_bar(arcs):
    links = {
        str(k + 1): LinkSizes(axes, (float(np.radians(arc)),))
        for k, (axes, arc) in enumerate(
            zip((("41", "21"), ("21", "32"), ("32", "43"), ("43", "41")), arcs, strict=True)
        )
    }
    pairs = tuple(Pair(name, "R", (str(a), str(b))) for name, a, b in FOUR_BAR)
    drives = (Input("21", 0.0, 2.0 * np.pi),)
    return Mechanism("special", "1", tuple(links), pairs, SizeGeometry(links), drives)


def _with_dyad(random, mechanism, sizes_deg):
    """Return the mechanism with a dyad: two links in a row between two of its links.

    In this way a four-bar becomes a six-bar, and a six-bar an eight-bar. The two links are
    chosen at random. Each gets a further axis, to which the dyad is joined.

    Parameters
    ----------
    random
        Random number generator.
    mechanism
        Mechanism with links numbered from 1.
    sizes_deg
        The arcs (degrees) from which each new arc is chosen at random. In half the cases,
        both new links have the same arc.
    """
    links = dict(mechanism.geometry.links)
    first_end, second_end = map(str, random.choice(mechanism.links, 2, replace=False))
    first, second = str(len(links) + 1), str(len(links) + 2)
    first_pair = f"{first_end}_{first}"
    middle_pair = f"{first}_{second}"
    second_pair = f"{second_end}_{second}"
    for link, pair in ((first_end, first_pair), (second_end, second_pair)):
        sizes = links[link]
        arc_deg = random.choice(sizes_deg)
        angle_deg = 30.0 * random.integers(1, 12)
        links[link] = replace(
            sizes,
            axes=(*sizes.axes, pair),
            arcs=(*sizes.arcs, float(np.radians(arc_deg))),
            angles=(*sizes.angles, float(np.radians(angle_deg))),
        )
    if random.random() < 0.5:
        first_arc_deg, second_arc_deg = random.choice(sizes_deg, 2)
    else:
        first_arc_deg = second_arc_deg = random.choice(sizes_deg)
    links[first] = LinkSizes((first_pair, middle_pair), (float(np.radians(first_arc_deg)),))
    links[second] = LinkSizes(
        (middle_pair, second_pair), (float(np.radians(second_arc_deg)),)
    )
    pairs = (
        *mechanism.pairs,
        Pair(first_pair, "R", (first_end, first)),
        Pair(middle_pair, "R", (first, second)),
        Pair(second_pair, "R", (second_end, second)),
    )
    return replace(mechanism, links=tuple(links), pairs=pairs, geometry=SizeGeometry(links))
