"""Orientations of links as symbolic expressions of the pair variables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.loop_tree import LoopTree
from spherekit.symbolic.expression_graph import Expr, function
from spherekit.symbolic.vector_algebra import Exprs, constants, vector
from spherekit.velocities.axis_rotations import (
    AxisRotation,
    Entries,
    JointTransform,
    PairRotations,
)


@dataclass(frozen=True)
class LinkOrientation:
    """The orientation of a link as a product of an expression and a constant.

    The rotation R = basis @ basis_from_link converts from link axes to ground axes. The
    basis is a frame that is fixed in the link. It can differ from the frame of the link
    axes: for a link placed by an R pair (revolute pair), its z axis is the axis of the
    pair.

    The factors are not multiplied, because the product has longer expressions than `basis`.
    A vector in link axes is instead multiplied by the constant factor first.

    Attributes
    ----------
    basis
        (3, 3) expressions. Its columns are unit vectors in ground axes, fixed in the link.
    basis_from_link
        (3, 3) numbers, or expressions if the sizes of links are symbols: the rotation from
        link axes to the basis.
    depth
        A number that is larger if the expressions of `basis` are longer; 0 for the ground.
        A link that is placed relative to another has a larger depth than this other link.
    """

    basis: Exprs
    basis_from_link: Entries
    depth: int

    def direction(self, axis: Entries) -> Exprs:
        """Return a vector (3,) fixed in the link, or columns (3, 3), in ground axes."""
        return self.basis @ self.fixed_components(axis)

    def fixed_components(self, axis: Entries) -> Exprs:
        """Return the components (3,) along the basis of a vector given in link axes."""
        return constants(self.basis_from_link @ axis)

    def components(self, ground_vector: Exprs) -> Exprs:
        """Return the components (3,) along the basis of a vector given in ground axes."""
        return self.basis.T @ ground_vector

    def basis_tensor(self, inertia: Entries) -> Exprs:
        """Return an inertia tensor (3, 3), given in link axes, in the axes of the basis."""
        return constants(self.basis_from_link @ inertia @ self.basis_from_link.T)


GROUND_ORIENTATION = LinkOrientation(constants(np.eye(3)), np.eye(3), 0)
"""The orientation of the ground in its own axes."""


def place_link(
    chain: JointTransform, start: LinkOrientation, variables: Sequence[Expr]
) -> LinkOrientation:
    """Return the orientation of the link that a pair (joint) connects to a placed link.

    The pair has the chain of rotations C_0 Z_1 C_1 ... Z_k C_k. C are constants, and Z are
    rotations by the k variables of the pair. The orientation of the new link is the
    orientation of the placed link times this chain.

    An orientation is stored as two factors, `basis @ basis_from_link`. The first one has
    expressions of the variables. The second one is a constant rotation, here C_k. If
    another pair follows, C_k is multiplied by the first constant of this pair. This product
    has numbers only.

    Parameters
    ----------
    chain
        The constants C and the rotations Z, from the placed link to the other link of the
        pair.
    start
        Orientation of the placed link.
    variables
        Expressions (rad) of all variables of the mechanism.
    """
    basis = start.basis
    basis_from_link = start.basis_from_link
    # There is one more constant than rotations. The loop omits the last constant C_k.
    for constant, rotation in zip(chain.constants, chain.rotations, strict=False):
        # The function named `constants` replaces entries that are 0, 1 or -1 up to rounding
        # by exact values, so that products with these entries are left out.
        basis = basis @ constants(basis_from_link @ constant)
        # The basis now contains the constant factor of the placed link.
        basis_from_link = np.eye(3)
        # If a contact has a profile of any shape, the rotation is a matrix of symbols and
        # not a rotation about z by a variable.
        if not isinstance(rotation, AxisRotation):
            basis = basis @ rotation
            continue
        cosine, sine = _rotation_cos_sin(rotation, variables)
        # The product of the basis with a rotation about z.
        basis = np.stack(
            [
                basis[:, 0] * cosine + basis[:, 1] * sine,
                basis[:, 1] * cosine - basis[:, 0] * sine,
                basis[:, 2],
            ],
            axis=1,
        )
    # The depth is larger for longer expressions.
    depth = start.depth + 1
    return LinkOrientation(basis, chain.constants[-1], depth)


def _rotation_cos_sin(
    rotation: AxisRotation, variables: Sequence[Expr]
) -> tuple[Expr, Expr]:
    """Return the cosine and the sine of the angle of a rotation, as expressions.

    The angle is scale * variable + offset. If a path of links goes through a pair in the
    opposite direction, the angle has the opposite sign. Both directions share their
    expressions, since cos(-x) = cos(x) and sin(-x) = -sin(x). The expressions of the
    angle with the positive scale are used.
    """
    sense = 1.0 if rotation.scale > 0.0 else -1.0
    angle = abs(rotation.scale) * variables[rotation.variable] + sense * rotation.offset
    return function("cos", angle), sense * function("sin", angle)


def place_by_variables(
    mechanism: Mechanism,
    pairs: PairRotations,
    variables: Sequence[Expr],
    steps: Iterable[tuple[int, int, int]] | None = None,
) -> list[LinkOrientation]:
    """Return the orientations of links as expressions of the pair (joint) variables.

    Starting from the ground, each link is placed relative to a link that is already placed.

    Parameters
    ----------
    mechanism, pairs
        The mechanism and the rotations of its pairs.
    variables
        Expressions (rad) of all variables.
    steps
        The pair, the placed link and the new link of each step, in order. By default the
        steps follow shortest paths from the ground to all links.

    Returns
    -------
    The orientations of all links. A link without a step has the orientation of the ground.
    """
    placed = [GROUND_ORIENTATION] * len(mechanism.links)
    for pair, parent, child in (
        find_spanning_tree(mechanism.ends) if steps is None else steps
    ):
        chain = pairs.chains[pair]
        # A chain is a product of rotations that leads from the first link of the pair to
        # the second. It is reversed if the second link is the placed one.
        if mechanism.ends[pair][0] != parent:
            chain = chain.reversed()
        placed[child] = place_link(chain, placed[parent], variables)
    return placed


def sum_along_paths(tree: LoopTree, pair_vectors: Sequence[Exprs]) -> list[Exprs]:
    """Return, for each link, the sum (3,) of the vectors of pairs on the path to the link.

    For example, angular velocities of pairs add up to the angular velocity of a link. The
    path leads from the ground along pairs of the tree. A vector is subtracted if the path
    runs from the second link of its pair to the first.
    """
    sums = [vector([0.0, 0.0, 0.0])] * tree.count
    # In `placements`, the sum of a parent is complete before that of its children.
    for pair, parent, child in tree.placements:
        is_forward = tree.ends[pair][0] == parent
        pair_vector = pair_vectors[pair]
        sums[child] = (
            sums[parent] + pair_vector if is_forward else sums[parent] - pair_vector
        )
    return sums
