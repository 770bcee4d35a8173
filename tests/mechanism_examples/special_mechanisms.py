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
    """Return the family and the mechanism of a seed, and inputs (n, 1) in rising order."""
    random = np.random.default_rng(seed)
    kind = KINDS[random.integers(len(KINDS))]
    dyads = int(random.choice([0, 1, 2], p=[0.5, 0.3, 0.2]))
    arcs = _arcs(random, kind)
    near = random.random() < 0.5
    if near:
        which = random.integers(4)
        arcs[which] = float(f"{arcs[which] + _tiny(random, 3, 12):.12f}")
    made = four_bar(arcs)
    for _ in range(dyads):
        made = _with_dyad(random, made, sorted({90.0, *arcs}))
    driven = str(random.choice(["21", "41", "32"], p=[0.7, 0.2, 0.1]))
    made = replace(made, inputs=(Input(driven, 0.0, 2.0 * np.pi),))
    bars = ("four-bar", "six-bar", "eight-bar")[dyads]
    return f"{bars}, {kind}", made, np.radians(_inputs(random))[:, None]


def straight_mechanism(seed):
    """Return a mechanism of a seed with an arc near 0 or 180 degrees, and inputs (n, 1).

    A four-bar, alone or with one or two dyads. The arc is off by 1e-2 to 1e-9 degrees; of
    some seeds it is an arc of a dyad, and of others the four-bar is near a change point.
    """
    random = np.random.default_rng(seed + 10**6)
    arcs = [float(np.round(random.uniform(20.0, 150.0), 3)) for _ in range(4)]
    kind = random.integers(3)
    if kind == 0:
        arcs[random.integers(4)] = _nearly_straight(random)
    elif kind == 1:
        a, b, c, _ = arcs
        total = abs(a + c - b) + 10.0 ** -random.integers(1, 10)
        arcs[3] = float(f"{total if total < 180.0 else 60.0:.12f}")
    sizes = sorted(float(np.round(random.uniform(10.0, 170.0), 3)) for _ in range(4))
    if kind == 2:
        sizes.append(_nearly_straight(random))
    made = four_bar(arcs)
    for _ in range(int(random.integers(int(kind == 2), 3))):
        made = _with_dyad(random, made, sizes)
    driven = str(random.choice(["21", "41", "32"]))
    near = [0.0, 90.0, 180.0] + 10.0 ** -random.integers(1, 9, 3)
    path = np.unique([*random.uniform(0.0, 360.0, 6), *near])
    drives = (Input(driven, 0.0, 2.0 * np.pi),)
    return replace(made, inputs=drives), np.radians(path)[:, None]


def _nearly_straight(random):
    off = 10.0 ** -random.integers(2, 10)
    return float(f"{abs(random.choice([0.0, 180.0]) - off):.12f}")


def _arcs(random, kind):
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


def _with_dyad(random, made, sizes):
    """Return the mechanism with two more links between two of it, of special sizes."""
    links = dict(made.geometry.links)
    one, other = (str(k) for k in random.choice(made.links, 2, replace=False))
    first, second = str(len(links) + 1), str(len(links) + 2)
    names = (f"{one}_{first}", f"{first}_{second}", f"{other}_{second}")
    for link, name in ((one, names[0]), (other, names[2])):
        own = links[link]
        arc, angle = random.choice(sizes), 30.0 * random.integers(1, 12)
        links[link] = replace(
            own,
            axes=(*own.axes, name),
            arcs=(*own.arcs, float(np.radians(arc))),
            angles=(*own.angles, float(np.radians(angle))),
        )
    arcs = random.choice(sizes, 2) if random.random() < 0.5 else [random.choice(sizes)] * 2
    for link, axes, arc in ((first, names[:2], arcs[0]), (second, names[1:], arcs[1])):
        links[link] = LinkSizes(axes, (float(np.radians(arc)),))
    ends = ((one, first), (first, second), (other, second))
    pairs = tuple(Pair(n, "R", pair) for n, pair in zip(names, ends, strict=True))
    return replace(
        made, links=tuple(links), pairs=(*made.pairs, *pairs), geometry=SizeGeometry(links)
    )
