"""Labels of arrows: arrows that cover each other share one label."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats, Integers
from spherekit.scenes.scene import Arrow, Primitive
from spherekit.wording import listing

COVERING_COSINE = np.cos(np.radians(1.0))
"""Cosine above which two arrows cover each other.

The radius of an arrow is 0.8 deg of the sphere, so its thickness is 1.6 deg.
"""

MAX_NAMES = 4
"""Largest number of names that a label lists; it states how many more there are."""


def arrow_labels(primitives: Sequence[Primitive]) -> dict[str, NDArray[np.object_]]:
    """Return the labels of pole axes in each row, by the paths of their arrows.

    A pole axis is the axis about which one link rotates relative to another. A row is one
    picture of the mechanism, at one sample of its motion. If arrows cover each other, the
    first arrow is labelled with all their names, and the other arrows have an empty label.
    Hidden arrows are left out, and so are the axes of pairs (joints), whose arrows have the
    attribute `primary`.

    Parameters
    ----------
    primitives
        The drawn objects of a scene. Arrows are among them. All have the same number of
        rows.
    """
    arrows = [
        item
        for item in primitives
        if isinstance(item, Arrow) and item.shown and not item.primary
    ]
    if not arrows:
        return {}
    directions = np.stack([arrow.directions for arrow in arrows], axis=1)
    # (rows, arrows) for each arrow the index of the arrow that is labelled with its name.
    label_owners = find_label_owners(directions)
    # Many rows of `label_owners` are equal, so the labels are written once for each
    # different row (pattern).
    patterns, pattern_of_row = np.unique(label_owners, axis=0, return_inverse=True)
    names = [arrow.label for arrow in arrows]
    labels = np.empty(patterns.shape, object)
    for number, pattern in enumerate(patterns):
        labels[number] = _join_names(names, pattern)
    return {arrow.path: labels[pattern_of_row, index] for index, arrow in enumerate(arrows)}


def find_label_owners(directions: Floats) -> Integers:
    """Return for each arrow the arrow in which its name is written.

    Two arrows of nearly equal direction cover each other, and their labels would overlap.
    An arrow's name is written in the label of the first arrow that covers it. If no earlier
    arrow covers it, the name is written in its own label. For example, let arrow 1 cover
    the arrows 0 and 2, which do not cover each other. The result is [0, 0, 1]: arrow 0 has
    the names of 0 and 1, arrow 1 has the name of 2, and arrow 2 has an empty label.

    Parameters
    ----------
    directions
        (rows, arrows, 3) unit vectors; NaN where an arrow has no direction.

    Returns
    -------
    (rows, arrows) index of the arrow that has the name of each arrow in its label.
    """
    cosines = directions @ np.swapaxes(directions, 1, 2)  # (rows, arrows, arrows)
    covers = cosines > COVERING_COSINE
    covers |= np.eye(directions.shape[1], dtype=bool)  # also for NaN
    # `argmax` finds the first true value.
    return np.argmax(covers, axis=2)


def _join_names(names: Sequence[str], label_owners: Integers) -> list[str]:
    """Return the label of each arrow of one picture.

    Arrows that cover each other share a label, which is at one of these arrows and lists
    their names. The labels of the other arrows are empty.

    Parameters
    ----------
    names
        The names of the arrows.
    label_owners
        (arrows,) for each name the index of the arrow that has the label with this name.
    """
    names_by_owner: list[list[str]] = [[] for _ in names]
    for name, owner in zip(names, label_owners, strict=True):
        names_by_owner[owner].append(name)
    return [listing(owned_names, MAX_NAMES) for owned_names in names_by_owner]
