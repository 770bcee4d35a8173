"""The same mechanism described otherwise gives the same result."""

from dataclasses import replace

import numpy as np
from helpers.analysis_runs import evaluate_poles_of_motion
from mechanism_examples.linkages import EIGHT_BARS, mechanism_from_chain, random_axes


def vectors(made):
    """Return pole vectors by link names, {(link, relative to): (n, 3)}."""
    _, field = evaluate_poles_of_motion(made, samples=3, search=False)
    found = {}
    for (i, j), direction in field.direction.items():
        w = direction * field.velocity_coefficient[i, j][:, None]
        found[made.links[j], made.links[i]] = w
        found[made.links[i], made.links[j]] = -w
    return found


def test_another_ground_gives_the_same_relative_motions():
    """Only the axes in which directions are given change: those of the new ground."""
    made = mechanism_from_chain(EIGHT_BARS[4], random_axes(np.random.default_rng(11), 10))
    one, other = vectors(made), vectors(replace(made, ground="5"))
    assert one.keys() == other.keys() and len(one) == 56
    for key, value in one.items():
        # At the reference pose, the middle sample, the axes of both grounds are one.
        scale = max(1.0, np.nanmax(np.abs(value[1])))
        off = np.abs(value[1] - other[key][1])
        assert np.max(off) < 1e-10 * scale, key
