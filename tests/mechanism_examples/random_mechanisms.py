"""Random mechanisms of many topologies, with degenerate geometry mixed in, by seed."""

from dataclasses import replace

import networkx as nx
import numpy as np
from mechanism_examples.linkages import (
    EIGHT_BARS,
    grow_dyad_chain,
    mechanism_from_chain,
    random_axes,
    random_contact_chain,
)

from spherekit.errors import PlanError
from spherekit.mechanism.elements import Input, PoseGeometry
from spherekit.planning.assembly_plan import plan_assembly

SPANS = (1e-6, 1e-3, 0.05, 0.4)
"""Half the range of the input (rad): its middle is the reference pose."""

FAMILIES = ("dyads", "triads", "eight-bar", "chain", "contacts", "any graph")
"""What `random_mechanism` draws from, in this order with these odds."""

ODDS = (0.2, 0.2, 0.15, 0.2, 0.15, 0.1)

CORNERS = np.array(
    [
        (x, y, z)
        for x in (-1.0, 0.0, 1.0)
        for y in (-1.0, 0.0, 1.0)
        for z in (-1.0, 0.0, 1.0)
        if (x, y, z) != (0.0, 0.0, 0.0)
    ]
)


def random_mechanism(seed):
    """Return the family and the mechanism of a seed; it need not be able to move."""
    random = np.random.default_rng(seed)
    family = str(random.choice(FAMILIES, p=ODDS))
    made = _of_family(random, family)
    if random.random() < 0.5:
        made = degenerate(random, made)
    half = float(random.choice(SPANS))
    wanted = _inputs(random, made)
    ranges = tuple(Input(item, -half, half) for item in wanted)
    return family, replace(made, inputs=ranges)


def shaped_mechanism(seed):
    """Return a mechanism with contacts, of profiles that need not be circles, of a seed."""
    random = np.random.default_rng(seed)
    sliding = int(random.integers(1, 3))
    links = int(random.integers(4, 8))
    links += (links + sliding) % 2
    made = random_contact_chain(
        random, links, int(random.integers(0, 3)), sliding, shaped=True
    )
    half = float(random.choice(SPANS))
    return replace(made, inputs=(Input(made.inputs[0].pair, -half, half),))


def _of_family(random, family):
    if family in ("dyads", "triads"):
        links = int(random.choice([4, 6, 8, 10, 12]))
        return grow_dyad_chain(random, links, family == "triads")
    if family == "eight-bar":
        chain = EIGHT_BARS[int(random.integers(len(EIGHT_BARS)))]
        return mechanism_from_chain(chain, random_axes(random, 10))
    if family == "contacts":
        links = int(random.integers(4, 9))
        sliding = int(random.integers(0, 3))
        sliding += (links + sliding) % 2
        return random_contact_chain(random, links, int(random.integers(0, 3)), sliding)
    links = int(random.integers(4, 13))
    if family == "chain":
        freedoms = 1 + (links % 2)
        edges = (3 * (links - 1) - freedoms) // 2
    else:
        edges = int(random.integers(links - 1, 2 * links))
    graph = _graph(random, links, edges)
    return mechanism_from_chain(graph, random_axes(random, len(graph)))


def _graph(random, links, edges):
    """Return a random connected graph, for 100 tries one without links that hang on."""
    every = [(a, b) for a in range(1, links + 1) for b in range(a + 1, links + 1)]
    edges = min(edges, len(every))
    while True:
        for _ in range(100):
            chosen = random.choice(len(every), edges, replace=False)
            graph = nx.Graph([every[k] for k in sorted(chosen)])
            if len(graph) == links and nx.is_biconnected(graph):
                return [every[k] for k in sorted(chosen)]
        chosen = random.choice(len(every), edges, replace=False)
        found = [every[k] for k in sorted(chosen)]
        numbers = {
            link: k + 1 for k, link in enumerate(sorted({x for e in found for x in e}))
        }
        if nx.is_connected(nx.Graph(found)):
            return [(numbers[a], numbers[b]) for a, b in found]


def _inputs(random, made):
    """Return R pairs that count as inputs, or any R pair if none does."""
    turning = [pair.name for pair in made.pairs if pair.type == "R"]
    for freedoms in (1, 1, 1, 2, 2, 2, 3):
        names = [str(n) for n in random.permutation(turning)[:freedoms]]
        try:
            plan_assembly(made.with_inputs(*names))
        except PlanError:
            continue
        return names
    return turning[:1]


def degenerate(random, made):
    """Return the mechanism with some axes made special, exactly or nearly."""
    assert isinstance(made.geometry, PoseGeometry)
    axes = {name: np.array(axis) for name, axis in made.geometry.axes.items()}
    names = list(axes)
    near = [
        (p.name, q.name)
        for k, p in enumerate(made.pairs)
        for q in made.pairs[:k]
        if p.name in axes and q.name in axes and set(p.links) & set(q.links)
    ]
    for _ in range(int(random.integers(1, 4))):
        kind = random.integers(6)
        one = names[random.integers(len(names))]
        other, third = (
            names[random.integers(len(names))],
            names[random.integers(len(names))],
        )
        if near and random.random() < 0.7:
            one, other = near[random.integers(len(near))]
            beside = [q if p == other else p for p, q in near if other in (p, q)]
            third = beside[random.integers(len(beside))]
        if kind == 0:
            axes[one] = axes[other].copy()
        elif kind == 1:
            axes[one] = -axes[other]
        elif kind == 2:
            p, q = random.normal(size=2)
            axes[one] = p * axes[other] + q * axes[third]
        elif kind == 3:
            axes[one] = CORNERS[random.integers(len(CORNERS))]
        elif kind == 4:
            axes = {k: CORNERS[random.integers(len(CORNERS))] for k in axes}
        else:
            plane = random_axes(random, 1)[0]
            chosen = [k for k in names if random.random() < 0.6]
            for name in chosen:
                axes[name] = axes[name] - plane * (plane @ axes[name])
        if random.random() < 0.5:
            off = 10.0 ** -random.uniform(1, 17)
            axes[one] = axes[one] + off * random_axes(random, 1)[0]
        for name, axis in axes.items():
            length = np.linalg.norm(axis)
            # A vector that vanished has no direction: it stays one of the frame's.
            axes[name] = axis / length if length > 1e-8 else np.array([0.0, 0.0, 1.0])
    unit = {name: (float(x), float(y), float(z)) for name, (x, y, z) in axes.items()}
    return replace(made, geometry=PoseGeometry(unit))


def reordered(made, order):
    """Return a mechanism with other names and orders of links and pairs, R pairs turned.

    `order` (links - 1,) is that of the moving links; every other R pair that is not an
    input is given with its links exchanged.
    """
    names = {made.ground: "base"}
    names |= {made.links[1 + k]: f"link_{n}" for n, k in enumerate(order)}
    driven = {item.pair for item in made.inputs}
    pairs = []
    for k, pair in enumerate(reversed(made.pairs)):
        ends = tuple(names[link] for link in pair.links)
        swapped = pair.type == "R" and pair.name not in driven and k % 2 == 0
        pairs.append(replace(pair, links=ends[::-1] if swapped else ends))
    links = tuple(
        names[link] for link in (made.ground, *(made.links[1 + k] for k in order))
    )
    return replace(made, ground="base", links=links, pairs=tuple(pairs)), names


def turned(made, rotation):
    """Return a mechanism rotated as a whole, `rotation` (3, 3)."""

    def moved(vector):
        return tuple(map(float, rotation @ np.array(vector)))

    axes = {name: moved(axis) for name, axis in made.geometry.axes.items()}
    pairs = tuple(
        pair
        if pair.profiles is None
        else replace(
            pair, profiles=tuple(replace(p, centre=moved(p.centre)) for p in pair.profiles)
        )
        for pair in made.pairs
    )
    return replace(made, geometry=replace(made.geometry, axes=axes), pairs=pairs)
