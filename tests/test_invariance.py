"""The same mechanism described otherwise gives the same result."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.analysis_runs import evaluate_poles_of_motion
from mechanism_examples.linkages import EIGHT_BARS, mechanism_from_chain, random_axes


def relative_angular_velocities(mechanism):
    """Return the relative velocities (3, 3) of links as {(link, relative to): w}.

    Row k is the direction of the pole times the velocity coefficient at sample k, in the
    axes of the ground. The links are given by their names, in both orders.
    """
    _, field = evaluate_poles_of_motion(mechanism, samples=3, search=False)
    velocities = {}
    for (i, j), direction in field.direction.items():
        w = direction * field.velocity_coefficient[i, j][:, None]
        velocities[mechanism.links[j], mechanism.links[i]] = w
        velocities[mechanism.links[i], mechanism.links[j]] = -w
    return velocities


@pytest.mark.slow
def test_another_ground_gives_the_same_relative_velocities():
    """The relative angular velocities of an eight-bar do not depend on the ground link.

    There are 56 of them, for all ordered pairs of links. Vectors have components in the
    axes of the ground. At the middle of three samples, the reference pose, the axes of all
    links coincide, so vectors can be compared.
    """
    mechanism = mechanism_from_chain(
        EIGHT_BARS[4], random_axes(np.random.default_rng(11), 10)
    )
    velocities = relative_angular_velocities(mechanism)
    on_other_ground = relative_angular_velocities(replace(mechanism, ground="5"))
    assert velocities.keys() == on_other_ground.keys()
    assert len(velocities) == 56
    for links, w in velocities.items():
        expected = w[1]
        scale = max(1.0, np.nanmax(np.abs(expected)))
        error = np.abs(expected - on_other_ground[links][1])
        assert np.max(error) < 1e-10 * scale, links
