"""Graphs of links and pairs: spanning trees, connected components, and a drawing.

This is the only module that uses networkx. It imports networkx only when a graph is drawn.
"""

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.mechanism import Mechanism

NODE_GAP = 0.12
"""Smallest distance of two nodes in a drawing, in units of the drawing's width.

Larger: nodes are pushed farther apart. Smaller: nodes cover each other's names.
"""

MAX_NODE_SHIFTS = 100
"""Largest number of times that nodes are pushed apart.

Larger: crowded drawings take longer. Smaller: some nodes may stay too close to each other.
"""


def find_spanning_tree(
    ends: Sequence[tuple[int, int]],
    start: Iterable[int] = (0,),
    pairs: Collection[int] | None = None,
) -> tuple[tuple[int, int, int], ...]:
    """Return pairs (joints) that join all bodies without a loop, from start bodies on.

    Parameters
    ----------
    ends
        Indices of the two bodies of every pair.
    start
        Indices of the bodies from which the search starts, breadth first. Each of them is
        the root of its own tree.
    pairs
        Indices of the pairs that may be used. By default all.

    Returns
    -------
    The branches in the order in which they are found: the index of the pair, the body from
    which it leads, and the body that it reaches. Bodies that no pair reaches are missing.
    """
    usable_pairs = range(len(ends)) if pairs is None else sorted(pairs)
    reached = list(dict.fromkeys(start))
    branches = []
    for body in reached:  # new bodies are appended during the loop
        for pair in usable_pairs:
            first, second = ends[pair]
            next_body = first if second == body else second
            if body in (first, second) and next_body not in reached:
                reached.append(next_body)
                branches.append((pair, body, next_body))
    return tuple(branches)


def component_labels(count: int, couples: Iterable[tuple[int, int]]) -> list[int]:
    """Return, for each node of a graph, the connected component that contains it.

    Parameters
    ----------
    count
        Number of nodes, which are numbered from 0.
    couples
        The two nodes of every edge.

    Returns
    -------
    (count,) label for each node: the smallest node of its component.
    """
    # In the beginning, each node is a component of its own. An edge joins two components
    # under the smaller label.
    labels = list(range(count))
    for couple in couples:
        low, high = sorted(labels[node] for node in couple)
        labels = [low if label == high else label for label in labels]
    return labels


def connected_components(count: int, couples: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return the nodes of each connected component, sorted by their smallest node.

    The `count` nodes are numbered from 0. `couples` has the two nodes of every edge.
    """
    labels = component_labels(count, couples)
    return [
        [node for node in range(count) if labels[node] == label]
        for label in sorted(set(labels))
    ]


def layout_graph(mechanism: Mechanism) -> Floats:
    """Return positions for a drawing of the graph of links and pairs.

    Returns
    -------
    (links + pairs, 2) positions of the nodes. They fill about the unit square, and no two
    nodes cover each other.
    """
    import networkx as nx

    # Nodes are numbers, links first. Texts would give another drawing in every process,
    # because the layout depends on the order of sets.
    graph: nx.Graph[Any] = nx.Graph()
    link_count = len(mechanism.links)
    node_count = link_count + len(mechanism.pairs)
    graph.add_nodes_from(range(node_count))
    for pair_number, ends in enumerate(mechanism.ends):
        graph.add_edges_from((link_count + pair_number, link) for link in ends)
    # The spring model of Kamada and Kawai preserves the order of its start. A planar start
    # therefore leads to few crossings.
    is_planar, _ = nx.check_planarity(graph)
    start = nx.planar_layout(graph) if is_planar else nx.circular_layout(graph)
    position_of = nx.kamada_kawai_layout(graph, pos=start)
    positions = np.array([position_of[node] for node in range(node_count)])
    extent = np.ptp(positions, axis=0)
    positions = (positions - positions.min(axis=0)) / np.where(extent > 0.0, extent, 1.0)
    return _separate_nodes(positions)


def _separate_nodes(positions: Floats) -> Floats:
    """Return positions (n, 2) of drawn nodes, pushed apart until none covers another."""
    # Between nodes at the same position, the direction of the push is undefined. A tiny
    # upward offset, different for each node, separates them.
    positions = positions + 1e-6 * np.arange(len(positions))[:, None] * [0.0, 1.0]
    for _ in range(MAX_NODE_SHIFTS):
        # For all pairs of nodes: differences (n, n, 2), and how far each node is pushed. If
        # nodes are too near, each is pushed by half of the lacking distance and 1e-3 more.
        differences = positions[:, None] - positions
        distances = np.linalg.norm(differences, axis=2, keepdims=True)
        push = np.where(distances < NODE_GAP, 0.5 * (NODE_GAP - distances) + 1e-3, 0.0)
        shifts = np.sum(push * differences / np.maximum(distances, 1e-9), axis=1)
        if not np.any(shifts):
            break
        positions = positions + shifts
    return positions
