"""Chains without sizes, and mechanisms made from them with random axes.

Any set of axes is a legal reference pose, so random geometry is always assembled.
"""

import networkx as nx
import numpy as np

from spherekit.errors import PlanError
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Input, Pair, PoseGeometry
from spherekit.planning.assembly import plan_assembly

EIGHT_BARS = (
    "1-2 1-4 1-5 2-3 2-6 3-4 3-7 4-8 5-6 7-8",
    "1-2 1-4 1-5 2-3 2-6 3-4 3-7 5-6 5-8 7-8",
    "1-2 1-4 1-5 2-3 2-6 3-4 3-7 5-6 6-8 7-8",
    "1-2 1-4 1-5 2-3 2-7 3-4 3-6 4-8 5-6 7-8",
    "1-2 1-4 1-5 2-3 2-7 3-4 3-8 5-6 5-8 6-7",
    "1-2 1-4 1-5 2-3 2-7 3-4 3-8 5-6 6-7 6-8",
    "1-2 1-4 1-5 2-3 2-7 3-4 5-6 5-8 6-7 7-8",
    "1-2 1-4 1-5 2-3 3-4 3-7 5-6 5-8 6-7 7-8",
    "1-2 1-5 1-6 2-3 2-8 3-4 4-5 4-7 6-7 7-8",
    "1-2 1-4 1-5 1-7 2-3 2-6 3-4 3-8 5-6 7-8",
    "1-2 1-4 1-5 1-7 2-3 2-6 3-4 4-8 5-6 7-8",
    "1-2 1-4 1-5 1-7 2-3 3-4 3-6 5-6 6-8 7-8",
    "1-2 1-4 1-5 1-8 2-3 2-7 3-4 5-6 6-7 6-8",
    "1-2 1-4 1-5 1-8 2-3 3-4 3-7 5-6 6-7 6-8",
    "1-2 1-4 1-5 1-7 2-3 2-6 2-8 3-4 5-6 7-8",
    "1-2 1-4 1-5 1-7 2-3 3-4 3-6 3-8 5-6 7-8",
)
"""All 16 chains of eight links, ten simple R pairs and one freedom."""

FOUR_BAR = "1-2 2-3 3-4 1-4"
WATT = "1-2 2-3 3-4 1-4 4-5 5-6 1-6"
STEPHENSON = "1-2 1-4 1-6 2-3 3-4 3-5 5-6"


def joints(chain):
    """Return the joined links of a chain as pairs of integers."""
    return [tuple(int(word) for word in edge.split("-")) for edge in chain.split()]


def mechanism(chain, axes, driven=None, name="chain", span=(-1e-3, 1e-3)):
    """Return a chain with these axes (pairs, 3) in its reference pose."""
    edges = joints(chain) if isinstance(chain, str) else chain
    names = [f"p{a}_{b}" for a, b in edges]
    links = sorted({link for edge in edges for link in edge})
    pairs = tuple(
        Pair(n, "R", (str(a), str(b))) for n, (a, b) in zip(names, edges, strict=True)
    )
    return Mechanism(
        name,
        str(links[0]),
        tuple(str(link) for link in links),
        pairs,
        PoseGeometry({n: tuple(map(float, u)) for n, u in zip(names, axes, strict=True)}),
        inputs=(Input(driven or names[0], *span),),
    )


def random_axes(random, count):
    """Return unit vectors (count, 3), uniform on the sphere."""
    axes = random.normal(size=(count, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def random_chain(random, links, freedoms=1):
    """Return a random simple-jointed chain with so many freedoms and no rigid part."""
    edges_wanted = (3 * (links - 1) - freedoms) // 2
    while True:
        every = [(a, b) for a in range(1, links + 1) for b in range(a + 1, links + 1)]
        chosen = random.choice(len(every), edges_wanted, replace=False)
        edges = [every[k] for k in sorted(chosen)]
        graph = nx.Graph(edges)
        if len(graph) < links or min(dict(graph.degree).values()) < 2:
            continue
        if not nx.is_biconnected(graph):
            continue
        candidate = mechanism(edges, random_axes(random, edges_wanted))
        if any_inputs(random, candidate, freedoms) is None:
            continue
        return edges


def any_inputs(random, made, freedoms):
    """Return the mechanism with that many random R pairs as inputs, None if none do."""
    turning = [pair.name for pair in made.pairs if pair.type == "R"]
    for _ in range(12):
        if len(turning) < freedoms:
            return None
        names = random.choice(turning, freedoms, replace=False)
        chosen = made.with_inputs(*map(str, names))
        try:
            plan_assembly(chosen)
        except PlanError:
            continue
        return chosen
    return None


def dyads_on(random, places):
    """Return a four-bar of links 1 to 4 with a dyad on each two links of `places`.

    The dyad at position k has links 2k + 5 and 2k + 6.
    """
    edges = joints(FOUR_BAR)
    for k, (one, other) in enumerate(places):
        a, b = 2 * k + 5, 2 * k + 6
        edges += [(one, a), (a, b), (other, b)]
    return mechanism(edges, random_axes(random, len(edges)))
