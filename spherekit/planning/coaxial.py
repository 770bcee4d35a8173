"""Links that always turn about one common axis, by the geometry within the links.

If P_ik and P_jk coincide, their great circle is undefined, but P_ij is that same axis:
the three relative motions share it. Two R pairs with one axis in a common link, such as
the two sliders of an arc guide or the coaxial wheels of a gear train, make it so in every
configuration.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np

from spherekit.model.geometry import SAME_AXIS, link_axes
from spherekit.model.graph import joined
from spherekit.model.mechanism import Mechanism


@final
@dataclass(frozen=True)
class Coaxial:
    """Links whose relative motions share one axis, that of R pair `pair`.

    `exactly` says that the axes are equal numbers; others are equal but for rounding.
    """

    links: frozenset[int]
    pair: int
    exactly: bool


def coaxial_links(mechanism: Mechanism) -> tuple[Coaxial, ...]:
    """Return the sets of three or more links that turn about a common axis."""
    number = mechanism.pair_number
    couples: list[tuple[int, int]] = []
    rounded: set[int] = set()
    for axes in link_axes(mechanism).values():
        for one, other in combinations(axes, 2):
            if np.linalg.norm(np.cross(axes[one], axes[other])) < SAME_AXIS:
                couples.append((number[one], number[other]))
                same = [np.array_equal(axes[one], s * axes[other]) for s in (1.0, -1.0)]
                rounded |= set() if any(same) else set(couples[-1])
    owner = joined(len(mechanism.pairs), couples)
    sets = []
    for first in sorted(set(owner)):
        pairs = [
            pair for pair, representative in enumerate(owner) if representative == first
        ]
        if len(pairs) > 1:
            links = frozenset(link for pair in pairs for link in mechanism.ends[pair])
            sets.append(Coaxial(links, first, not rounded & set(pairs)))
    return tuple(sets)
