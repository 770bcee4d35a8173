"""Mechanisms whose modes have to be searched."""

from dataclasses import replace

import numpy as np
from mechanism_examples.linkages import (
    mechanism_from_chain,
    random_axes,
    random_chain,
    random_contact_chain,
)

from spherekit.errors import PlanError
from spherekit.mechanism.elements import Input
from spherekit.planning.assembly_plan import plan_assembly

HALF = np.radians(30.0)
"""Half of the range of the input (rad), its middle the reference pose."""


def ten_bar(seed):
    """Return a random ten-bar whose locked structure is one group of nine bodies."""
    random = np.random.default_rng(seed)
    while True:
        edges = random_chain(random, 10)
        made = mechanism_from_chain(edges, random_axes(random, len(edges)))
        for pair in random.permutation(len(edges)):
            driven = made.with_inputs(made.pairs[pair].name)
            try:
                groups = plan_assembly(driven).groups
            except PlanError:
                continue
            if [len(group.bodies) for group in groups] == [9]:
                return _over_range(driven)


def random_cam_chain(seed):
    """Return a chain of up to five links, one to three of its pairs contacts of circles."""
    random = np.random.default_rng(seed)
    links, sliding = int(random.integers(3, 6)), int(random.integers(1, 3))
    if (links + sliding) % 2:  # no chain grows to that; three links have no room for three
        sliding += 1 if links > 3 else -1
    return _over_range(random_contact_chain(random, links, 0, sliding))


def _over_range(made):
    return replace(made, inputs=(Input(made.inputs[0].pair, -HALF, HALF),))
