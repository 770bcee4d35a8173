"""Graph views of a mechanism; the only module that imports networkx, when called."""

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.mechanism import Mechanism


def spanning(
    ends: Sequence[tuple[int, int]],
    start: Iterable[int] = (0,),
    pairs: Collection[int] | None = None,
) -> tuple[tuple[int, int, int], ...]:
    """Return how bodies are reached from some of them, breadth first.

    Each way is the number of a pair, the body it starts at, and the new one that it leads
    to. `ends` are the bodies of every pair; only `pairs` are used, where they are given.
    """
    used = range(len(ends)) if pairs is None else sorted(pairs)
    reached = list(dict.fromkeys(start))
    ways = []
    for body in reached:
        for pair in used:
            one, two = ends[pair]
            other = two if one == body else one
            if body in (one, two) and other not in reached:
                reached.append(other)
                ways.append((pair, body, other))
    return tuple(ways)


def joined(count: int, couples: Iterable[tuple[int, int]]) -> list[int]:
    """Return for each of so many things the smallest of those that couples join it to."""
    owner = list(range(count))
    for couple in couples:
        low, high = sorted(owner[k] for k in couple)
        owner = [low if label == high else label for label in owner]
    return owner


def clusters(count: int, couples: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return so many things, those together that couples join, by their smallest."""
    owner = joined(count, couples)
    return [[k for k in range(count) if owner[k] == one] for one in sorted(set(owner))]


def layout(mechanism: Mechanism) -> Floats:
    """Return positions (links + pairs, 2) for drawing the graph, about the unit square."""
    import networkx as nx

    graph: nx.Graph[Any] = nx.Graph()
    links = [("link", name) for name in mechanism.links]
    graph.add_nodes_from(links)
    for pair in mechanism.pairs:
        graph.add_edges_from((("pair", pair.name), ("link", name)) for name in pair.links)
    planar, _ = nx.check_planarity(graph)
    start = nx.planar_layout(graph) if planar else nx.circular_layout(graph)
    spread = nx.kamada_kawai_layout(graph, pos=start)
    nodes = [*links, *(("pair", pair.name) for pair in mechanism.pairs)]
    places = np.array([spread[node] for node in nodes])
    extent = np.ptp(places, axis=0)
    places = (places - places.min(axis=0)) / np.where(extent > 0.0, extent, 1.0)
    return _apart(places)


NODE_GAP = 0.12
"""Nodes nearer than this would cover each other's names."""


def _apart(places: Floats) -> Floats:
    """Return places (n, 2), pushed from each other until none covers another."""
    # Those that coincide go upwards.
    places = places + 1e-6 * np.arange(len(places))[:, None] * [0.0, 1.0]
    for _ in range(100):
        away = places[:, None] - places
        size = np.linalg.norm(away, axis=2, keepdims=True)
        push = np.where(size < NODE_GAP, 0.5 * (NODE_GAP - size) + 1e-3, 0.0)
        moved = np.sum(push * away / np.maximum(size, 1e-9), axis=1)
        if not np.any(moved):
            break
        places = places + moved
    return places
