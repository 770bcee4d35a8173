"""The same mechanism described otherwise gives the same result."""

from dataclasses import replace

import numpy as np
from chains import EIGHT_BARS, mechanism, random_axes
from common import field_of


def vectors(made):
    """Return pole vectors by link names, {(link, relative to): (n, 3)}."""
    _, field = field_of(made, samples=3, search=False)
    found = {}
    for (i, j), direction in field.direction.items():
        w = direction * field.velocity_coefficient[i, j][:, None]
        found[made.links[j], made.links[i]] = w
        found[made.links[i], made.links[j]] = -w
    return found


def test_another_ground_gives_the_same_relative_motions():
    """Only the axes in which directions are given change: those of the new ground."""
    made = mechanism(EIGHT_BARS[4], random_axes(np.random.default_rng(11), 10))
    one, other = vectors(made), vectors(replace(made, ground="5"))
    assert one.keys() == other.keys() and len(one) == 56
    for key, value in one.items():
        # At the reference pose, the middle sample, the axes of both grounds are one.
        scale = max(1.0, np.nanmax(np.abs(value[1])))
        off = np.abs(value[1] - other[key][1])
        assert np.max(off) < 1e-10 * scale, key
