"""Compares two linkages that are described differently."""

from itertools import combinations

import numpy as np

from spherekit.arrays import Bools, Floats
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

    A synthesis uses the result to list an optimum only once if several descents find it.
    Two links are equal if a rotation leads from the axes of one to those of the other. An
    axis has two opposite directions, and which one a file states does not matter. So all
    choices of directions (signs) are tried. Reversing all axes gives the mirror image.
    Outputs, zero angles, masses and loads are not compared.

    Parameters
    ----------
    mechanism, other_mechanism
        Two mechanisms with the same links and pairs.

    Returns
    -------
    True if all links are equal up to the signs of the axes. False if some pair (joint) is
    not a revolute pair.
    """
    pairs = mechanism.pairs
    if not all(pair.kind.has_axis for pair in pairs):
        return False
    # After each link, only those choices of signs remain with which all links so far are
    # equal.
    signs = list_sign_choices(len(pairs))
    for link in mechanism.links:
        pair_numbers = [k for k, pair in enumerate(pairs) if link in pair.links]
        axes = _axes_of_link(mechanism, link)
        other_axes = _axes_of_link(other_mechanism, link)
        signed_axes = signs[:, pair_numbers, None] * axes
        signs = signs[_are_congruent(signed_axes, other_axes)]
    return len(signs) > 0


def list_sign_choices(count: int) -> Floats:
    """Return all choices of 1 or -1 for each of `count` axes, (2 ** count, count)."""
    choice_numbers = np.arange(2**count)
    signs = np.ones((len(choice_numbers), count))
    for k in range(count):
        # Bit k of the number of a choice gives the sign of axis k.
        is_reversed = (choice_numbers >> k) % 2 == 1
        signs[is_reversed, k] = -1.0
    return signs


def _axes_of_link(mechanism: Mechanism, link: str) -> Floats:
    """Return the axes (axes, 3) of the pairs of a link, in the axes of the link."""
    # The frames of all pairs in their first links, and in their second links. The third
    # column of a frame is the axis of the pair.
    frames_by_side = pair_frames(mechanism)
    axes = []
    for pair in mechanism.pairs:
        if link in pair.links:
            frame_by_pair = frames_by_side[pair.links.index(link)]
            axes.append(frame_by_pair[pair.name][:, 2])
    return np.array(axes)


def _are_congruent(signed_axes: Floats, other_axes: Floats) -> Bools:
    """Return a mask of the choices of signs with which axes can be rotated to other axes.

    An axis has two opposite directions, so its unit vector can be stated with either sign.
    `is_same_linkage` keeps the choices that are true in this mask for every link.

    A rotation exists if all angles between axes are equal, and all triple products of axes.
    Mirror images have equal angles, but triple products of opposite sign.

    Parameters
    ----------
    signed_axes
        (choices, axes, 3) unit vectors of one link, for each choice of their signs.
    other_axes
        (axes, 3) unit vectors of the same link of the other mechanism.

    Returns
    -------
    (choices,) mask.
    """
    cosines = signed_axes @ np.swapaxes(signed_axes, 1, 2)
    other_cosines = other_axes @ other_axes.T
    is_equal = max_abs(cosines - other_cosines, axis=(1, 2)) < SAME_LINKAGE
    for three_axes in combinations(range(len(other_axes)), 3):
        triple_products = np.linalg.det(signed_axes[:, list(three_axes)])
        other_triple_product = np.linalg.det(other_axes[list(three_axes)])
        difference = np.abs(triple_products - other_triple_product)
        is_equal &= difference < SAME_LINKAGE
    return is_equal
