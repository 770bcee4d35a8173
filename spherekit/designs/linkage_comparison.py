"""Compares two linkages that are described differently."""

from itertools import combinations

import numpy as np

from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import pair_frames

SAME_LINKAGE = 1e-3
"""Largest difference of the same linkages: of cosines of arcs, or of points by range.

Larger: neighbouring optima count as one. Smaller: an optimum that two descents reach with
different accuracy is listed twice.
"""


def is_same_linkage(mechanism: Mechanism, other_mechanism: Mechanism) -> bool:
    """Return whether two mechanisms are the same linkage, or mirror images.

    An axis may point the other way in the second mechanism, which changes the arcs from it
    to 180 degrees minus the arc. All choices of signs of the axes are tried.

    Parameters
    ----------
    mechanism, other_mechanism
        Two mechanisms with the same links and pairs.

    Returns
    -------
    True if all links are equal up to the signs of the axes. False if there are other pairs
    than R pairs.
    """
    pairs = mechanism.pairs
    if not all(pair.kind.has_axis for pair in pairs):
        return False
    # Each row of `signs` is a choice of 1 or -1 for each axis; bit k of its number gives
    # the sign of axis k. Choices for which some link differs are left out one by one.
    choices = np.arange(2 ** len(pairs))[:, None]
    signs = 1.0 - 2.0 * (choices >> np.arange(len(pairs)) & 1)
    frames = [pair_frames(item) for item in (mechanism, other_mechanism)]
    for link in mechanism.links:
        # The pairs of the link, and whether the link is the first or the second of each.
        pair_numbers = [k for k, pair in enumerate(pairs) if link in pair.links]
        sides = [pairs[k].links.index(link) for k in pair_numbers]
        # (axes, 3) axes of the link, in its own axes.
        axes, other_axes = (
            np.array(
                [
                    frames_by_side[side][pairs[k].name][:, 2]
                    for k, side in zip(pair_numbers, sides, strict=True)
                ]
            )
            for frames_by_side in frames
        )
        signed_axes = signs[:, pair_numbers, None] * axes
        cosines = signed_axes @ np.swapaxes(signed_axes, 1, 2)
        is_equal = max_abs(cosines - other_axes @ other_axes.T, axis=(1, 2)) < SAME_LINKAGE
        # Equal cosines leave open which of two mirror images a link is. The triple products
        # tell. With all axes reversed a linkage becomes its mirror image, so that mirror
        # images of the whole linkage are among the choices of signs.
        for three_axes in map(list, combinations(range(len(pair_numbers)), 3)):
            differences = np.linalg.det(signed_axes[:, three_axes]) - np.linalg.det(
                other_axes[three_axes]
            )
            is_equal &= np.abs(differences) < SAME_LINKAGE
        signs = signs[is_equal]
    return len(signs) > 0
