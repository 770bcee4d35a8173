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

    If arrows cover each other in a row, the first one is labelled with the names of all of
    them, and the others have an empty label. Two sorts of arrows are left out: axes of
    pairs (`primary`) have no label, and hidden arrows cover nothing and keep their own.

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
    covers |= np.eye(len(arrows), dtype=bool)  # NaN rows cover nothing else
    # first_cover[row, arrow] is the first arrow that covers an arrow (possibly itself), and
    # whose label has the name of the arrow. In a chain, an arrow B between A and C may
    # cover both although they do not cover each other. Then A is labelled with A and B, and
    # B with C. Most rows have one of a few patterns, so the labels of each pattern are
    # written once.
    first_cover = np.argmax(covers, axis=2)
    patterns, pattern_of_row = np.unique(first_cover, axis=0, return_inverse=True)
    labels = np.empty(patterns.shape, object)
    for pattern_index, pattern in enumerate(patterns):
        for arrow_index in range(len(arrows)):
            names = [
                arrow.label
                for arrow, first in zip(arrows, pattern, strict=True)
                if first == arrow_index
            ]
            labels[pattern_index, arrow_index] = listing(names, MAX_NAMES)
    return {arrow.path: labels[pattern_of_row, index] for index, arrow in enumerate(arrows)}
