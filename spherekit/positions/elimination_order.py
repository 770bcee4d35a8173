"""Which binary links of a group are removed, and in which order its angles are eliminated.

A binary link is a body with two R pairs. One binary link is removed for each loop of the
group, until the other bodies form a tree. Each removed link gives one equation in the
angles of the tree: it keeps the axes of its two pairs at a fixed arc
(`spherekit.positions.arc_equations`). This module reads only the graph of the group. It
contains no geometry.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools
from spherekit.geometry.trigonometric_system import eliminant_degree
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.planning.assembly_plan import Group

MAX_ORDERS = 8
"""Largest number of elimination orders of a group.

The orders are tried one after another until the checks of one order succeed. Larger: more
groups with special geometry are solved by elimination, after a longer time; smaller: more
of them need a random search.
"""


class BinaryLink(NamedTuple):
    """A body of a group with two R pairs that join it to two different bodies.

    A group is a set of bodies that are placed together by closing their loops. Binary links
    are removed to get fewer unknown angles. One equation remains for each removed link. Its
    two axes are fixed in the neighbours, and the angle between these axes must equal the
    arc (size) of the link.

    Attributes
    ----------
    body
        Position of the body in `Group.bodies`.
    pairs
        Positions of its two pairs in `Group.pairs`, rising.
    neighbours
        Positions of the bodies to which these pairs lead, in the same order.
    """

    body: int
    pairs: tuple[int, int]
    neighbours: tuple[int, int]


class EliminationOrder(NamedTuple):
    """The unknown angles and the equations of a group, in an order that can be solved.

    A group is a set of bodies that cannot move when the inputs are locked. With t loops, it
    has 2 t + 1 bodies and 3 t revolute pairs. Of these, t binary links (links with two
    pairs) are removed, together with their 2 t pairs. The other t + 1 bodies form a tree
    with t pairs. The angles of these t pairs are the unknowns. Each removed link gives one
    equation: its two axes are at a fixed arc.

    For example, a triad has two loops, five bodies and six pairs. Two removed links leave a
    tree of three bodies, with two unknown angles.

    All numbers are positions in `Group.bodies` and `Group.pairs`.

    Attributes
    ----------
    base_body
        A body of the tree, from which the other bodies of the tree are placed.
    tree_pairs
        The t pairs of the tree. Their angles are the unknowns. All except the first one are
        eliminated.
    removed_links
        The t binary links outside the tree, in the order of their equations.
    spanned_pairs
        For each removed link the pairs of the tree between its two neighbours, in order
        from the first neighbour to the second.
    """

    base_body: int
    tree_pairs: tuple[int, ...]
    removed_links: tuple[BinaryLink, ...]
    spanned_pairs: tuple[tuple[int, ...], ...]

    @property
    def incidence(self) -> Bools:
        """(t, t) whether the equation of a row contains the angle of a column."""
        return np.array(
            [[pair in path for pair in self.tree_pairs] for path in self.spanned_pairs]
        )

    @property
    def root_count(self) -> int:
        """Number of complex solutions with multiplicity; 0 if this order cannot be solved.

        The order says in which sequence angles are eliminated from the equations of a
        group. A polynomial in cos and sin of the first angle remains. Such a polynomial of
        degree d has 2 d complex roots. The degree follows from `incidence`: which equation
        contains which angle.
        """
        return 2 * eliminant_degree(self.incidence)


def has_elimination(group: Group) -> bool:
    """Return whether the configurations of a group can be found by elimination."""
    return (
        group.revolute
        and len(group.bodies) in (5, 7)
        and bool(find_elimination_orders(group))
    )


@lru_cache
def find_binary_links(group: Group) -> tuple[BinaryLink, ...]:
    """Return the binary links of a group of links, in the order of `group.bodies`.

    A binary link is a body with two pairs that join it to two different bodies. When a
    group is solved by elimination, some binary links are removed. Each gives an equation:
    the arc between its two axes is fixed.
    """
    binary_links = []
    for body in range(len(group.bodies)):
        pairs = [pair for pair, ends in enumerate(group.ends) if body in ends]
        # The sum of both ends less this body is the other end.
        neighbours = [sum(group.ends[pair]) - body for pair in pairs]
        if len(pairs) == len(set(neighbours)) == 2:
            binary_links.append(
                BinaryLink(body, (pairs[0], pairs[1]), (neighbours[0], neighbours[1]))
            )
    return tuple(binary_links)


@lru_cache
def find_elimination_orders(group: Group) -> tuple[EliminationOrder, ...]:
    """Return the elimination orders of a group that have the fewest complex solutions.

    A group is a set of bodies and pairs that is rigid when the inputs are locked (an Assur
    group). One link with two pairs is removed for each loop of the group, which leaves a
    tree. Each removed link gives one equation in the angles of the tree. All angles but the
    first are eliminated from these equations. This leaves one equation in the first angle,
    whose roots give the configurations of the group.

    An elimination order states which links are removed, and the sequences of the angles and
    of the equations. At most `MAX_ORDERS` are returned; none if the group cannot be solved
    in this way.
    """
    orders: list[EliminationOrder] = []
    # Only links with two pairs (binary links) can be removed.
    for removed_links in combinations(find_binary_links(group), group.loops):
        tree_pairs = _find_remaining_pairs(group, removed_links)
        if _can_form_equations(tree_pairs, removed_links):
            orders += _list_orders(group, tree_pairs, removed_links)
    # `root_count` is 0 for an order in which an angle cannot be eliminated.
    solvable_orders = [order for order in orders if order.root_count > 0]
    fewest_roots = min((order.root_count for order in solvable_orders), default=0)
    best_orders = [order for order in solvable_orders if order.root_count == fewest_roots]
    return tuple(best_orders[:MAX_ORDERS])


def _find_remaining_pairs(group: Group, removed_links: Sequence[BinaryLink]) -> list[int]:
    """Return the pairs of a group that are at none of the removed links."""
    removed_bodies = {link.body for link in removed_links}
    return [pair for pair, ends in enumerate(group.ends) if removed_bodies.isdisjoint(ends)]


def _can_form_equations(
    tree_pairs: Sequence[int], removed_links: Sequence[BinaryLink]
) -> bool:
    """Return whether the removed links give as many equations as there are unknown angles.

    Links with two pairs are removed so that a tree of bodies remains. The unknowns are the
    angles of the tree pairs. A removed link gives an equation between the axes of its pairs
    in its two neighbours. The neighbours must therefore be in the tree.
    """
    removed_bodies = {link.body for link in removed_links}
    has_neighbours = all(
        removed_bodies.isdisjoint(link.neighbours) for link in removed_links
    )
    return has_neighbours and len(tree_pairs) == len(removed_links)


def _list_orders(
    group: Group, tree_pairs: Sequence[int], removed_links: Sequence[BinaryLink]
) -> Iterator[EliminationOrder]:
    """List the sequences of angles and equations for one choice of removed links.

    The number of complex solutions depends on the sequences. The caller keeps those with
    the fewest solutions.

    The removed links have two pairs each. The other bodies form a tree of pairs, and the
    angles of these pairs are the unknowns. Each removed link gives one equation between
    these angles. There are as many equations as angles. The angles are eliminated one by
    one, from the last to the second, until one equation for the first angle remains. In the
    first step, the last two equations become one equation without the last angle.

    Parameters
    ----------
    group
        The group of bodies.
    tree_pairs
        The pairs of the tree. Their angles are the unknowns.
    removed_links
        The links that give the equations.
    """
    # Other bodies of the tree are placed from the base body, the first one that remains.
    removed_bodies = {link.body for link in removed_links}
    base_body = min({*range(len(group.bodies))} - removed_bodies)
    path_by_link = {
        link: find_tree_path(group, tree_pairs, *link.neighbours) for link in removed_links
    }
    for ordered_pairs in permutations(tree_pairs):
        for ordered_links in permutations(removed_links):
            # The order of the last two equations does not matter, as they are combined.
            # Only the order with rising indices of the bodies is listed.
            last_bodies = [link.body for link in ordered_links[-2:]]
            if last_bodies == sorted(last_bodies):
                yield EliminationOrder(
                    base_body,
                    tree_pairs=ordered_pairs,
                    removed_links=ordered_links,
                    spanned_pairs=tuple(path_by_link[link] for link in ordered_links),
                )


def find_tree_path(
    group: Group, tree_pairs: Sequence[int], start: int, goal: int
) -> tuple[int, ...]:
    """Return the pairs of a tree from one body to another, in order from the start."""
    step_to_body = {
        child: (pair, parent)
        for pair, parent, child in find_spanning_tree(group.ends, [start], tree_pairs)
    }
    path: list[int] = []
    body = goal
    while body in step_to_body:
        pair, body = step_to_body[body]
        path.insert(0, pair)
    return tuple(path)
