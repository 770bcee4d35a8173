"""Four-bars whose assembly modes meet: flat vertices, kites, parallelograms, rhombi."""

import numpy as np

KINDS = ("vertex", "kite", "parallelogram", "rhombus")


def random_crossing_arcs(random, kind):
    """Return the arcs of a random four-bar whose configuration curves cross.

    Parameters
    ----------
    random
        Random number generator.
    kind
        One of `KINDS`. The arcs of a flat vertex satisfy Kawasaki's condition (opposite
        arcs add up to 180 degrees), or have equal sums of opposite arcs.

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
    """Return the file of a four-bar.

    Link s1 is the ground, and pair c1 joins it to s4. Link k has the axes of the pairs ck
    and c(k + 1).

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
    for k, arc in enumerate(arcs):
        link = f"s{k + 1}"
        link_before = f"s{(k + 3) % 4 + 1}"
        pair = f"c{k + 1}"
        next_pair = f"c{(k + 1) % 4 + 1}"
        links += f'[links.{link}]\naxes = ["{pair}", "{next_pair}"]\narcs = [{arc}]\n'
        pairs += f'[pairs.{pair}]\ntype = "R"\nlinks = ["{link_before}", "{link}"]\n'
        pairs += f"zero = {zero}\n"
    return (
        'format = 1\nname = "flat"\nangle_unit = "deg"\nground = "s1"\n'
        f"{links}{pairs}[inputs.{driven}]\nfrom = {low}\nto = {high}\n"
    )
