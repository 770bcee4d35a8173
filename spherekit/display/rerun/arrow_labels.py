"""Labels of arrows: arrows that cover each other share one label."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.scenes.scene import Arrow, Primitive
from spherekit.wording import listing

COVERING_COSINE = np.cos(np.radians(1.0))
"""Cosine above which two arrows cover each other: each is 0.8 deg thick."""

MAX_NAMES = 4
"""Number of names that a label lists; it says how many more there are."""


def arrow_labels(primitives: Sequence[Primitive]) -> dict[str, NDArray[np.object_]]:
    """Return the labels (rows,) of pole axes, by the paths of their arrows.

    A row is one picture of the mechanism, at one sample of its motion. If arrows cover each
    other in a picture, the first one is labelled with the names of all of them, and the
    others have an empty label. Two sorts of arrows are left out: axes of pairs (`primary`)
    have no label, and hidden arrows cover nothing and keep their own.

    Parameters
    ----------
    primitives
        The primitives of a scene, with equally many rows.
    """
    arrows = [
        item
        for item in primitives
        if isinstance(item, Arrow) and item.shown and not item.primary
    ]
    if not arrows:
        return {}
    # Axes: row, arrow, component.
    directions = np.stack([arrow.directions for arrow in arrows], axis=1)
    covers = directions @ np.swapaxes(directions, 1, 2) > COVERING_COSINE
    covers |= np.eye(len(arrows), dtype=bool)  # arrows with NaN cover only themselves
    # label_owners[row, arrow] is the arrow whose label has the name of an arrow: the first
    # arrow that covers it, or itself. For example, let arrow 1 cover the arrows 0 and 2,
    # which do not cover each other. The owners are then [0, 0, 1]: arrow 0 is labelled
    # with the names of 0 and 1, arrow 1 with that of 2, and arrow 2 has an empty label.
    label_owners = np.argmax(covers, axis=2)
    # Most rows have one of a few patterns of owners, so the labels of each pattern are
    # written once.
    patterns, pattern_of_row = np.unique(label_owners, axis=0, return_inverse=True)
    labels = np.empty(patterns.shape, object)
    for pattern_index, pattern in enumerate(patterns):
        for arrow_index in range(len(arrows)):
            names = [
                arrow.label
                for arrow, owner in zip(arrows, pattern, strict=True)
                if owner == arrow_index
            ]
            labels[pattern_index, arrow_index] = listing(names, MAX_NAMES)
    return {arrow.path: labels[pattern_of_row, index] for index, arrow in enumerate(arrows)}
