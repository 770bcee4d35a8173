"""Finds independent loops of a group whose velocity equations are short.

A *leaf* of a group is a body that two pairs join to two different other bodies, neither of
which is a leaf too. Without its leaves, the group stays connected. A dyad has one leaf. For
each leaf a loop is chosen that passes through it. The variables of its two pairs occur in
this loop only, so they can be eliminated from its equations beforehand. The remaining loops
are closed by pairs outside a spanning tree of the other bodies.
"""

from collections.abc import Sequence

from spherekit.mechanism.graph import component_labels, find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Group

LoopPath = tuple[tuple[int, int], ...]
"""Pairs along a path, each with the sense +1 (from its first link to its second) or -1."""


def find_group_loops(
    mechanism: Mechanism, group: Group, closed_pairs: Sequence[int]
) -> list[LoopPath]:
    """Return independent loops of a group: one for each leaf, then the others.

    A group is a set of bodies that are closed together, such as a dyad. A leaf is a body
    that two pairs join to two different other bodies. These two bodies must not be
    leaves, and the group must stay connected without its leaves. A dyad has one leaf. Only
    one loop passes through a leaf, so the variables of its two pairs occur in this loop
    only. The other loops are closed by pairs outside a spanning tree of the bodies that
    are no leaves.

    Parameters
    ----------
    mechanism, group
        The mechanism, and the group.
    closed_pairs
        Indices of the driven pairs and of the pairs of earlier groups. A body of the group
        can consist of several links, which these pairs join. Loops lead through such a body
        along these pairs.

    Returns
    -------
    The closed path of each loop: its pairs with their senses. The last pair closes the
    loop. If possible, sliding contacts close the loops without a leaf.
    """
    # Until the loops are listed, `k` is the position of a pair in the group; its index
    # in the mechanism is `group.pairs[k]`. `ends[k]` are the positions of its two
    # bodies.
    ends = group.ends
    leaves = _find_leaves(group)
    # The pairs that join no leaf.
    inner_pairs = [k for k, bodies in enumerate(ends) if not leaves.keys() & set(bodies)]
    # Pairs with few variables come first into the tree. Sliding contacts, with two
    # variables each, come last and close the loops, so that both variables occur in one
    # loop only.
    tree: list[int] = []
    for k in sorted(inner_pairs, key=lambda k: len(mechanism.variables_of(group.pairs[k]))):
        labels = component_labels(len(group.bodies), [ends[j] for j in tree])
        first, second = ends[k]
        if labels[first] != labels[second]:
            tree.append(k)

    # Each loop: its closing pair, further pairs that are not in the tree, and the sense in
    # which it passes the closing pair.
    closings: list[tuple[int, list[int], int]] = []
    for body, (first_pair, second_pair) in leaves.items():
        # The loop arrives at the leaf by its first pair and leaves it by its second one.
        sense = 1 if ends[second_pair][0] == body else -1
        closings.append((second_pair, [first_pair], sense))
    closings += [(k, [], 1) for k in inner_pairs if k not in tree]

    # The loops lead along pairs and links, given by their indices in the mechanism.
    loops: list[LoopPath] = []
    for closing_pair, further_pairs, sense in closings:
        pair = group.pairs[closing_pair]
        loop_pairs = [group.pairs[k] for k in (*tree, *further_pairs)]
        # The closing pair leads from `start` to `end`, the path back to `start`.
        start, end = mechanism.ends[pair]
        if sense == -1:
            start, end = end, start
        path = _find_path(mechanism.ends, [*closed_pairs, *loop_pairs], end, start)
        loops.append((*path, (pair, sense)))
    return loops


def _find_leaves(group: Group) -> dict[int, list[int]]:
    """Return the leaves of a group, each with its two pairs (joints).

    A group is a set of bodies that are closed together. A leaf is a body with two pairs,
    which join it to two different bodies, its neighbours.

    The loops of the group are chosen such that each leaf is in one loop only, so that the
    rates of its two pairs can be eliminated from the equations of this loop. The loop
    consists of the leaf and a path between its neighbours that meets no other leaf. Such a
    path exists under two conditions, which are checked here:

    - The neighbours of a leaf are no leaves.
    - The bodies that are no leaves stay connected if all leaves are taken away.

    Bodies and pairs are numbered by their indices in the group.
    """
    leaves: dict[int, list[int]] = {}
    # If only one of two neighbours can be a leaf, it is the one that is tried first. Any
    # order of the bodies gives valid leaves.
    for body in reversed(range(len(group.bodies))):
        body_pairs = [k for k, ends in enumerate(group.ends) if body in ends]
        neighbours: set[int] = set()
        for k in body_pairs:
            neighbours.update(group.ends[k])
        neighbours.discard(body)
        has_two_neighbours = len(body_pairs) == 2 and len(neighbours) == 2
        has_leaf_as_neighbour = bool(neighbours & leaves.keys())
        if not has_two_neighbours or has_leaf_as_neighbour:
            continue
        if _is_connected_without(group, {*leaves, body}):
            leaves[body] = body_pairs
    return leaves


def _is_connected_without(group: Group, left_out: set[int]) -> bool:
    """Return whether the bodies of a group stay connected if some are taken away.

    A group is a set of bodies (links or rigid sets of links) that are closed together.

    The other bodies are connected if a tree of pairs (joints) reaches all of them. Such a
    tree has one pair less than bodies. If no body is left, the result is False.
    """
    inner_pairs = [k for k, ends in enumerate(group.ends) if not left_out & set(ends)]
    inner_bodies = [k for k in range(len(group.bodies)) if k not in left_out]
    root = inner_bodies[:1]  # where the tree starts; empty if no body is left
    tree = find_spanning_tree(group.ends, root, inner_pairs)
    return len(tree) == len(inner_bodies) - 1


def _find_path(
    ends: Sequence[tuple[int, int]], pairs: Sequence[int], start: int, end: int
) -> LoopPath:
    """Return a path from one link to another along pairs (joints).

    Parameters
    ----------
    ends
        The two links of every pair of the mechanism.
    pairs
        Indices of the pairs that the path can use.
    start, end
        Indices of the first and the last link. The pairs must connect them.

    Returns
    -------
    The pairs of the path, each with a sense: 1 from the first link of the pair to the
    second, otherwise -1.
    """
    # The path from the start to each link, along a spanning tree.
    paths: dict[int, LoopPath] = {start: ()}
    for pair, placed_link, new_link in find_spanning_tree(ends, [start], pairs):
        sense = 1 if ends[pair][0] == placed_link else -1
        paths[new_link] = (*paths[placed_link], (pair, sense))
    return paths[end]
