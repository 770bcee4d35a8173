"""Labels of arrows: arrows that cover each other share one label."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats, Integers
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
    directions = np.stack([arrow.directions for arrow in arrows], axis=1)
    label_owners = find_label_owners(directions)
    # Most rows have one of a few patterns of owners, so the labels of each pattern are
    # written once.
    patterns, pattern_of_row = np.unique(label_owners, axis=0, return_inverse=True)
    names = [arrow.label for arrow in arrows]
    labels = np.empty(patterns.shape, object)
    for number, pattern in enumerate(patterns):
        labels[number] = _join_names(names, pattern)
    return {arrow.path: labels[pattern_of_row, index] for index, arrow in enumerate(arrows)}


def find_label_owners(directions: Floats) -> Integers:
    """Return for each arrow the arrow whose label has its name.

    It is the first arrow that covers it, or the arrow itself. For example, let arrow 1
    cover the arrows 0 and 2, which do not cover each other. The owners are then [0, 0, 1]:
    arrow 0 is labelled with the names of 0 and 1, arrow 1 with that of 2, and arrow 2 has
    an empty label.

    Parameters
    ----------
    directions
        (rows, arrows, 3) unit vectors; NaN where an arrow has no direction.

    Returns
    -------
    (rows, arrows) numbers of arrows.
    """
    cosines = directions @ np.swapaxes(directions, 1, 2)  # (rows, arrows, arrows)
    covers = cosines > COVERING_COSINE
    covers |= np.eye(directions.shape[1], dtype=bool)  # with NaN, too
    # The first arrow that covers is the first true value of each row of `covers`.
    return np.argmax(covers, axis=2)


def _join_names(names: Sequence[str], label_owners: Integers) -> list[str]:
    """Return the label of each arrow of one picture.

    Parameters
    ----------
    names
        The names of the arrows.
    label_owners
        (arrows,) for each name the number of the arrow in whose label it is.
    """
    names_by_owner: list[list[str]] = [[] for _ in names]
    for name, owner in zip(names, label_owners, strict=True):
        names_by_owner[owner].append(name)
    return [listing(owned_names, MAX_NAMES) for owned_names in names_by_owner]
