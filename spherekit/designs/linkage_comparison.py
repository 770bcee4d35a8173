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

    A link is given by the directions of its axes. If an axis points the other way, the
    linkage is the same, although the arcs from this axis become 180 degrees minus the arc.
    All choices of signs of the axes are therefore tried.

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
    # (choices, pairs) each row is a choice of 1 or -1 for each axis; bit k of its number
    # gives the sign of axis k. The loop over the links keeps the choices with which all
    # links so far are equal.
    choices = np.arange(2 ** len(pairs))[:, None]
    signs = 1.0 - 2.0 * (choices >> np.arange(len(pairs)) & 1)
    frames = pair_frames(mechanism)
    other_frames = pair_frames(other_mechanism)
    for link in mechanism.links:
        # (axes, 3) axes of the pairs of this link, in the axes of the link.
        pair_numbers = []
        link_axes = []
        other_link_axes = []
        for k, pair in enumerate(pairs):
            if link in pair.links:
                # A pair has one frame in each of its two links. The third column is its
                # axis.
                side = pair.links.index(link)
                pair_numbers.append(k)
                link_axes.append(frames[side][pair.name][:, 2])
                other_link_axes.append(other_frames[side][pair.name][:, 2])
        other_axes = np.array(other_link_axes)
        # (choices, axes, 3)
        signed_axes = signs[:, pair_numbers, None] * np.array(link_axes)

        # The cosines of the angles between all axes must be equal.
        cosines = signed_axes @ np.swapaxes(signed_axes, 1, 2)
        is_equal = max_abs(cosines - other_axes @ other_axes.T, axis=(1, 2)) < SAME_LINKAGE
        # A link and its mirror image have equal cosines, but triple products of opposite
        # sign. Reversing all axes gives the mirror image of the whole linkage, which is
        # therefore among the choices of signs.
        for three_axes in combinations(range(len(pair_numbers)), 3):
            triple_products = np.linalg.det(signed_axes[:, list(three_axes)])
            other_triple_product = np.linalg.det(other_axes[list(three_axes)])
            difference = np.abs(triple_products - other_triple_product)
            is_equal &= difference < SAME_LINKAGE
        signs = signs[is_equal]
    return len(signs) > 0
