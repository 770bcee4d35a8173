"""Four-bars and vertices whose modes meet: flat folds, kites, parallelograms, rhombi."""

import numpy as np

KINDS = ("vertex", "kite", "parallelogram", "rhombus")


def random_crossing_arcs(random, kind):
    """Return the arcs of a random four-bar whose curves cross, whole degrees as texts.

    Those of a flat vertex add up so that opposite ones have 180 degrees (Kawasaki), or so
    that all four have less than a turn and opposite ones the same sum.
    """
    one, other = (int(angle) for angle in random.integers(20, 160, 2))
    if kind == "vertex":
        if random.random() < 0.5:
            arcs = [one, other, 180 - one, 180 - other]
        else:
            third = int(random.integers(20, 160))
            arcs = [one, other, third, one + third - other]
            while not 15 <= arcs[3] <= 165:
                third = int(random.integers(20, 160))
                other = int(random.integers(20, 160))
                arcs = [one, other, third, one + third - other]
    elif kind == "kite":
        arcs = [one, one, other, other]
    elif kind == "parallelogram":
        arcs = [one, other, one, other]
    else:
        arcs = [one] * 4
    return list(map(str, np.roll(arcs, int(random.integers(4)))))


def four_bar_text(arcs, low, high, zero="180", driven="c1"):
    """Return the file of a four-bar with these arcs over a range, all in degrees."""
    links = "".join(
        f'[links.s{k + 1}]\naxes = ["c{k + 1}", "c{(k + 1) % 4 + 1}"]\narcs = [{arc}]\n'
        for k, arc in enumerate(arcs)
    )
    pairs = "".join(
        f'[pairs.c{k + 1}]\ntype = "R"\nlinks = ["s{(k + 3) % 4 + 1}", "s{k + 1}"]\n'
        f"zero = {zero}\n"
        for k in range(4)
    )
    return (
        'format = 1\nname = "flat"\nangle_unit = "deg"\nground = "s1"\n'
        f"{links}{pairs}[inputs.{driven}]\nfrom = {low}\nto = {high}\n"
    )
