"""Four-bars whose assembly modes meet: flat vertices, kites, parallelograms, rhombi."""

import numpy as np
from mechanism_examples.linkages import mechanism_from_chain, random_axes

from spherekit.files.mechanism_reader import read
from spherekit.files.toml_document import parse

KINDS = ("vertex", "kite", "parallelogram", "rhombus")


def random_crossing_arcs(random, kind):
    """Return the arcs of a random four-bar that can fold flat.

    In the flat pose its configuration curves (assembly modes) cross.

    Parameters
    ----------
    random
        Random number generator.
    kind
        One of `KINDS`. A vertex has arcs a, b, c, d, one after another, that satisfy one of
        two conditions: a + c = b + d = 180 degrees (Kawasaki's condition for a sheet of
        paper), or a + c = b + d with another sum. A kite has two pairs of equal adjacent
        arcs. A parallelogram has equal opposite arcs. All arcs of a rhombus are equal.

    Returns
    -------
    Four arcs as texts of whole degrees, in a random cyclic order.
    """
    first, second = (int(angle) for angle in random.integers(20, 160, 2))
    if kind == "vertex":
        if random.random() < 0.5:
            arcs = [first, second, 180 - first, 180 - second]
        else:
            third = int(random.integers(20, 160))
            arcs = [first, second, third, first + third - second]
            # The fourth arc follows from the others; very short or long ones are drawn
            # again.
            while not 15 <= arcs[3] <= 165:
                third = int(random.integers(20, 160))
                second = int(random.integers(20, 160))
                arcs = [first, second, third, first + third - second]
    elif kind == "kite":
        arcs = [first, first, second, second]
    elif kind == "parallelogram":
        arcs = [first, second, first, second]
    else:
        arcs = [first] * 4
    return list(map(str, np.roll(arcs, int(random.integers(4)))))


def four_bar_text(arcs, low, high, zero="180", driven="c1"):
    """Return the text of the mechanism file of a four-bar.

    The links s1 to s4 form a closed loop, in which s1 is the ground. Pair c1 joins s4 and
    s1, c2 joins s1 and s2, c3 joins s2 and s3, and c4 joins s3 and s4. The arc of a link is
    that between the axes of its two pairs.

    Parameters
    ----------
    arcs
        Arcs of the links s1 to s4, degrees.
    low, high
        Range of the input, degrees.
    zero
        Zero position of all pairs, degrees.
    driven
        Name of the input pair.
    """
    links = ""
    pairs = ""
    loop = (
        ("s4", "c1", "s1", "c2"),
        ("s1", "c2", "s2", "c3"),
        ("s2", "c3", "s3", "c4"),
        ("s3", "c4", "s4", "c1"),
    )
    for (link_before, pair, link, next_pair), arc in zip(loop, arcs, strict=True):
        links += f'[links.{link}]\naxes = ["{pair}", "{next_pair}"]\narcs = [{arc}]\n'
        pairs += f'[pairs.{pair}]\ntype = "R"\nlinks = ["{link_before}", "{link}"]\n'
        pairs += f"zero = {zero}\n"
    return (
        'format = 1\nname = "flat"\nangle_unit = "deg"\nground = "s1"\n'
        f"{links}{pairs}[inputs.{driven}]\nfrom = {low}\nto = {high}\n"
    )


def loaded(text):
    """Return the mechanism of the text of a mechanism file."""
    return read(parse(text, "made"))


def two_vertices(low=-40.0, high=40.0):
    """Return two flat-foldable vertices on one crease, flat at the input 0.

    Both vertices are four-bars driven by the crease; their dyads change together. `low` and
    `high` are the ends of the range in degrees.
    """
    sectors = np.radians([100.0, 60.0, 80.0])
    first = np.cumsum([0.0, *sectors])
    second = -np.cumsum(np.radians([70.0, 50.0, 110.0]))
    angles = [*first, *second]
    axes = np.array([[np.cos(a), np.sin(a), 0.0] for a in angles])
    # c1 joins links 1 and 2; the first vertex has links 3 and 4, the second 5 and 6.
    chain = ((1, 2), (1, 3), (3, 4), (2, 4), (1, 5), (5, 6), (2, 6))
    return mechanism_from_chain(chain, axes, span=tuple(np.radians([low, high])))


def six_bar_with_a_flat_loop(seed=0):
    """Return a six-bar driven as a triad, one of whose loops is flat at the input 0."""
    axes = random_axes(np.random.default_rng(seed), 7)
    flat = [1, 2, 5, 6]  # the pairs of the loop of links 2, 3, 4 and 6
    axes[flat, 2] = 0.0
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    chain = ((1, 2), (2, 3), (3, 4), (4, 5), (1, 5), (2, 6), (4, 6))
    return mechanism_from_chain(chain, axes, driven="p1_2", span=(-0.3, 0.35))
