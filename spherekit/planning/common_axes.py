"""Links that turn about one common axis in every configuration.

Two R pairs of one link may have the same axis. Examples are the two sliders of an arc guide
and the coaxial wheels of a gear train. All links of these pairs then turn about this axis
relative to each other. The Aronhold-Kennedy theorem cannot find their pole axes: it
intersects great circles through two poles, and the two poles coincide.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from spherekit.mechanism.graph import connected_components
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import SAME_AXIS_SINE, link_axes


class CommonAxis(NamedTuple):
    """The common axis of several R pairs, about which their links turn.

    Attributes
    ----------
    links
        Indices of these links.
    pair
        Lowest index of an R pair about this axis.
    is_exact
        Whether, in each link, all R pairs about this axis have exactly equal or opposite
        axis vectors. Otherwise some vectors differ by rounding errors, and the poles along
        this axis get larger error bounds.
    """

    links: frozenset[int]
    pair: int
    is_exact: bool


def find_common_axes(mechanism: Mechanism) -> tuple[CommonAxis, ...]:
    """Return the axes that several R pairs of one link have in common.

    Examples are the axes of coaxial wheels in a gear train. All links that such pairs join
    turn about the common axis relative to each other. So the common axis is the pole of any
    two of these links (the axis of their relative rotation). Such poles are listed here,
    because the Aronhold-Kennedy theorem cannot find them.
    """
    number = mechanism.pair_number
    # Couples of R pairs (by index) that have the same axis in a link that they share.
    coaxial_couples: list[tuple[int, int]] = []
    # R pairs in a couple whose axis vectors differ by rounding errors.
    rounded_pairs: set[int] = set()
    for axes in link_axes(mechanism).values():
        for name_a, name_b in combinations(axes, 2):
            axis_a = axes[name_a]
            axis_b = axes[name_b]
            if np.linalg.norm(np.cross(axis_a, axis_b)) >= SAME_AXIS_SINE:
                continue
            couple = number[name_a], number[name_b]
            coaxial_couples.append(couple)
            # Two vectors of one line may be opposite.
            is_equal = np.array_equal(axis_a, axis_b) or np.array_equal(axis_a, -axis_b)
            if not is_equal:
                rounded_pairs.update(couple)
    # Couples with a common pair belong to one axis (connected components).
    common_axes = []
    for pairs in connected_components(len(mechanism.pairs), coaxial_couples):
        if len(pairs) > 1:
            links: set[int] = set()
            for pair in pairs:
                links.update(mechanism.ends[pair])
            is_exact = rounded_pairs.isdisjoint(pairs)
            common_axes.append(CommonAxis(frozenset(links), pairs[0], is_exact))
    return tuple(common_axes)
