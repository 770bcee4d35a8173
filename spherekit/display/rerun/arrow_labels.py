"""Labels of arrows that cover each other: one label for all of them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.scenes.scene import Arrow, Primitive
from spherekit.wording import listing

SAME = np.cos(np.radians(1.0))
"""Arrows whose cosine is greater cover each other: each is 0.8 deg thick."""


MOST = 4
"""Names that a label has at most; it says how many more there are."""


def labels_of_arrows(primitives: Sequence[Primitive]) -> dict[str, NDArray[np.object_]]:
    """Return what labels (n,) arrows have, by their paths.

    The first of those that cover each other has the names of all, the others have none.
    Arrows of pairs have no labels, and those that are hidden keep theirs.
    """
    arrows = [
        item
        for item in primitives
        if isinstance(item, Arrow) and item.shown and not item.primary
    ]
    if not arrows:
        return {}
    directions = np.stack([arrow.directions for arrow in arrows], axis=1)
    same = directions @ np.swapaxes(directions, 1, 2) > SAME
    same |= np.eye(len(arrows), dtype=bool)
    patterns, which = np.unique(np.argmax(same, axis=2), axis=0, return_inverse=True)
    words = np.empty(patterns.shape, object)
    for row, firsts in enumerate(patterns):
        words[row] = [
            listing(
                [x.label for x, first in zip(arrows, firsts, strict=True) if first == k],
                MOST,
            )
            for k in range(len(arrows))
        ]
    return {arrow.path: words[which, k] for k, arrow in enumerate(arrows)}
