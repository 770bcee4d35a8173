"""The chains and oracles of the tests, and chains grown to any number of links."""

import sys
from pathlib import Path

import numpy as np

from spherekit.model.mechanism import Mechanism

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from chains import EIGHT_BARS, mechanism, random_axes
from oracles import null_space, off_axis

__all__ = ["EIGHT_BARS", "grown", "mechanism", "null_space", "off_axis", "random_axes"]


def grown(random: np.random.Generator, links: int, triads: bool) -> Mechanism:
    """Return a four-bar with dyads, or dyads and triads, added at random links.

    A dyad adds two links between two others, a triad four links between three; both
    keep the one freedom. What hangs on a triad has poles that no two lines give.
    """
    edges = [(1, 2), (2, 3), (3, 4), (1, 4)]
    count = 4
    while count < links:
        if triads and links - count >= 4 and random.random() < 0.5:
            ends = (random.choice(count, 3, replace=False) + 1).tolist()
            middle = count + 4
            for k, end in enumerate(ends, start=count + 1):
                edges += [(end, k), (k, middle)]
            count += 4
        else:
            one, other = (random.choice(count, 2, replace=False) + 1).tolist()
            edges += [(one, count + 1), (count + 1, count + 2), (other, count + 2)]
            count += 2
    return mechanism(edges, random_axes(random, len(edges)))
