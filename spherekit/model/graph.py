"""Graph views of a mechanism; the only module that imports networkx, when called."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, final

from spherekit.model.mechanism import Mechanism


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
            if body in ends[pair]:
                other = ends[pair][1] if ends[pair][0] == body else ends[pair][0]
                if other not in reached:
                    reached.append(other)
                    ways.append((pair, body, other))
    return tuple(ways)


def joined(count: int, couples: Iterable[tuple[int, int]]) -> list[int]:
    """Return for each of so many things the smallest of those that couples join it to."""
    owner = list(range(count))
    for couple in couples:
        low, high = sorted((owner[couple[0]], owner[couple[1]]))
        owner = [low if label == high else label for label in owner]
    return owner


def pieces(mechanism: Mechanism) -> list[list[str]]:
    """Return the connected pieces, label as its links in file order, ground's first."""
    left = list(range(len(mechanism.links)))
    components: list[list[str]] = []
    while left:
        ways = spanning(mechanism.ends, left[:1])
        reached = {left[0], *(link for _, _, link in ways)}
        components.append([mechanism.links[link] for link in sorted(reached)])
        left = [link for link in left if link not in reached]
    return components


@final
@dataclass(frozen=True)
class GraphLayout:
    """Positions in the unit square of links and pairs, for drawing."""

    links: tuple[tuple[float, float], ...]
    pairs: tuple[tuple[float, float], ...]


def layout(mechanism: Mechanism) -> GraphLayout:
    """Return positions for drawing the link/pair graph: few crossings, same every time."""
    import networkx as nx

    graph: nx.Graph[Any] = nx.Graph()
    links = [("link", name) for name in mechanism.links]
    graph.add_nodes_from(links)
    for pair in mechanism.pairs:
        graph.add_edges_from((("pair", pair.name), ("link", name)) for name in pair.links)
    planar, _ = nx.check_planarity(graph)
    start = nx.planar_layout(graph) if planar else nx.circular_layout(graph)
    spread = nx.kamada_kawai_layout(graph, pos=start)
    low = [min(point[axis] for point in spread.values()) for axis in (0, 1)]
    high = [max(point[axis] for point in spread.values()) for axis in (0, 1)]

    def unit(node: tuple[str, str]) -> tuple[float, float]:
        scaled: Sequence[float] = [
            (float(spread[node][axis]) - low[axis]) / ((high[axis] - low[axis]) or 1.0)
            for axis in (0, 1)
        ]
        return scaled[0], scaled[1]

    nodes = [*links, *(("pair", pair.name) for pair in mechanism.pairs)]
    places = _apart([unit(node) for node in nodes])
    return GraphLayout(tuple(places[: len(links)]), tuple(places[len(links) :]))


NODE_GAP = 0.12
"""Nodes nearer than this would cover each other's names."""


def _apart(places: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Push nodes away from each other until none covers another."""
    for _ in range(50):
        moved = False
        for a in range(len(places)):
            for b in range(a):
                dx = places[a][0] - places[b][0]
                dy = places[a][1] - places[b][1]
                size = (dx * dx + dy * dy) ** 0.5
                if size >= NODE_GAP:
                    continue
                moved = True
                push = 0.5 * (NODE_GAP - size) + 1e-3
                ux, uy = (dx / size, dy / size) if size > 1e-6 else (0.0, 1.0)
                places[a] = (places[a][0] + push * ux, places[a][1] + push * uy)
                places[b] = (places[b][0] - push * ux, places[b][1] - push * uy)
        if not moved:
            break
    return places
