"""Links that always turn about one common axis, by the geometry within the links.

If P_ik and P_jk coincide, their great circle is undefined, but P_ij is that same axis:
the three relative motions share it. Two R pairs with one axis in a common link, such as
the two sliders of an arc guide or the coaxial wheels of a gear train, make it so in every
configuration.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.model.geometry import SAME_AXIS, link_axes
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
    owner = list(range(len(mechanism.pairs)))
    rounded: set[int] = set()
    for axes in link_axes(mechanism).values():
        names = list(axes)
        for position, one in enumerate(names):
            for other in names[:position]:
                sine = np.linalg.norm(np.cross(axes[one], axes[other]))
                if sine < SAME_AXIS:
                    if not np.array_equal(axes[one], axes[other]) and not np.array_equal(
                        axes[one], -axes[other]
                    ):
                        rounded |= {number[one], number[other]}
                    low, high = sorted((owner[number[one]], owner[number[other]]))
                    owner = [
                        low if representative == high else representative
                        for representative in owner
                    ]
    sets = []
    for first in sorted(set(owner)):
        pairs = [
            pair for pair, representative in enumerate(owner) if representative == first
        ]
        if len(pairs) > 1:
            links = frozenset(link for pair in pairs for link in mechanism.ends[pair])
            sets.append(Coaxial(links, first, not rounded & set(pairs)))
    return tuple(sets)
