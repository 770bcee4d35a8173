"""Labels of arrows that cover each other: one for all, as none could be read."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.scene import Arrow, Primitive
from spherekit.conventions import listing

SAME = np.cos(np.radians(1.0))
"""Arrows whose cosine is greater cover each other: each is 0.8 deg thick."""
MOST = 4
"""Names that a label has at most; it says how many more there are."""


def labels_of_arrows(primitives: Sequence[Primitive]) -> dict[str, NDArray[np.object_]]:
    """Return what labels (n,) arrows have that share one at some rows, by their paths.

    The first of those that cover each other has the names of all, the others have none.
    Arrows of pairs have no labels, and those that are hidden keep theirs.
    """
    arrows = [
        item
        for item in primitives
        if isinstance(item, Arrow) and item.shown and not item.primary
    ]
    if len(arrows) < 2:
        return {}
    directions = np.stack([arrow.directions for arrow in arrows], axis=1)
    same = directions @ np.swapaxes(directions, 1, 2) > SAME
    same |= np.eye(len(arrows), dtype=bool)
    patterns, which = np.unique(np.argmax(same, axis=2), axis=0, return_inverse=True)
    words = np.empty(patterns.shape, dtype=object)
    for row, firsts in enumerate(patterns.tolist()):
        names: dict[int, list[str]] = {}
        for arrow, first in zip(arrows, firsts, strict=True):
            names.setdefault(first, []).append(arrow.label)
        words[row] = [listing(names.get(k, ()), MOST) for k in range(len(arrows))]
    labels = words[which.reshape(-1)]
    return {
        arrow.path: labels[:, k]
        for k, arrow in enumerate(arrows)
        if np.any(labels[:, k] != arrow.label)
    }
