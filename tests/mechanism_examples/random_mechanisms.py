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

CUBE_SYMMETRY_AXES = np.array(
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
    made = _mechanism_of_family(random, family)
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
    # Each sliding contact replaces a link of a chain with an even number of links.
    if (links + sliding) % 2 == 1:
        links += 1
    made = random_contact_chain(
        random, links, int(random.integers(0, 3)), sliding, shaped=True
    )
    half = float(random.choice(SPANS))
    return replace(made, inputs=(Input(made.inputs[0].pair, -half, half),))


def _mechanism_of_family(random, family):
    """Return a random mechanism of one of the families, with random joint axes.

    R pairs are revolute joints.

    - "dyads": a four-bar with dyads added (a dyad is two links in a row).
    - "triads": the same, with triads too (a triad is a link that three links join to the
      rest).
    - "eight-bar": one of the 16 chains of eight links with one freedom.
    - "contacts": a four-bar with dyads, in which some pairs are contacts.
    - "chain": as many R pairs as one or two freedoms require, between random links.
    - "any graph": any number of R pairs. It need not be able to move.
    """
    if family in ("dyads", "triads"):
        links = int(random.choice([4, 6, 8, 10, 12]))
        return grow_dyad_chain(random, links, triads=family == "triads")
    if family == "eight-bar":
        chain = EIGHT_BARS[int(random.integers(len(EIGHT_BARS)))]
        return mechanism_from_chain(chain, random_axes(random, 10))
    if family == "contacts":
        links = int(random.integers(4, 9))
        sliding = int(random.integers(0, 3))
        # Each sliding contact replaces a link of a chain of dyads, which has an even number
        # of links.
        if (links + sliding) % 2 == 1:
            sliding += 1
        rolling = int(random.integers(0, 3))
        return random_contact_chain(random, links, rolling, sliding)
    links = int(random.integers(4, 13))
    if family == "chain":
        # So that the number of pairs is an integer.
        freedoms = 1 if links % 2 == 0 else 2
        pair_count = (3 * (links - 1) - freedoms) // 2
    else:
        pair_count = int(random.integers(links - 1, 2 * links))
    edges = _random_connected_edges(random, links, pair_count)
    return mechanism_from_chain(edges, random_axes(random, len(edges)))


def _random_connected_edges(random, links, pair_count):
    """Return the joined links of a random connected graph, as tuples of two numbers.

    The first of 100 random graphs is taken that has all links and is biconnected (no part
    hangs on one link only). If there is none, any connected graph is taken, with its links
    numbered from 1 without gaps.

    Parameters
    ----------
    random
        Random number generator.
    links, pair_count
        Number of links, and number of pairs (joints) between them.
    """
    possible = [(a, b) for a in range(1, links + 1) for b in range(a + 1, links + 1)]
    pair_count = min(pair_count, len(possible))
    while True:
        for _ in range(100):
            chosen = random.choice(len(possible), pair_count, replace=False)
            edges = [possible[k] for k in sorted(chosen)]
            graph = nx.Graph(edges)
            if len(graph) == links and nx.is_biconnected(graph):
                return edges
        chosen = random.choice(len(possible), pair_count, replace=False)
        edges = [possible[k] for k in sorted(chosen)]
        if nx.is_connected(nx.Graph(edges)):
            joined_links = sorted({link for edge in edges for link in edge})
            numbers = {link: k for k, link in enumerate(joined_links, start=1)}
            return [(numbers[a], numbers[b]) for a, b in edges]


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


def degenerate(random, mechanism):
    """Return a mechanism with one to three changes that make its joint axes special.

    Tests with it find faults that generic axes do not show. A change makes an axis equal or
    opposite to another, puts three axes on a great circle, puts one or all axes on symmetry
    axes of the cube, or projects many axes onto one plane. After half of the changes the
    first axis is disturbed by 1e-1 to 1e-17, so that it is only nearly special. Changes
    prefer axes that share a link.
    """
    assert isinstance(mechanism.geometry, PoseGeometry)
    axes = {name: np.array(axis) for name, axis in mechanism.geometry.axes.items()}
    names = list(axes)
    neighbours = [  # the names of any two R pairs that share a link
        (p.name, q.name)
        for k, p in enumerate(mechanism.pairs)
        for q in mechanism.pairs[:k]
        if p.name in axes and q.name in axes and set(p.links) & set(q.links)
    ]
    for _ in range(int(random.integers(1, 4))):
        change = random.integers(6)
        first = names[random.integers(len(names))]
        second = names[random.integers(len(names))]
        third = names[random.integers(len(names))]
        if neighbours and random.random() < 0.7:
            first, second = neighbours[random.integers(len(neighbours))]
            beside_second = [
                q if p == second else p for p, q in neighbours if second in (p, q)
            ]
            third = beside_second[random.integers(len(beside_second))]
        # 0, 1: equal or opposite axes. 2: three axes on a great circle. 3, 4: one or all
        # axes on axes of symmetry. 5: many axes in one plane.
        if change == 0:
            axes[first] = axes[second].copy()
        elif change == 1:
            axes[first] = -axes[second]
        elif change == 2:
            p, q = random.normal(size=2)
            axes[first] = p * axes[second] + q * axes[third]
        elif change == 3:
            axes[first] = CUBE_SYMMETRY_AXES[random.integers(len(CUBE_SYMMETRY_AXES))]
        elif change == 4:
            axes = {
                k: CUBE_SYMMETRY_AXES[random.integers(len(CUBE_SYMMETRY_AXES))]
                for k in axes
            }
        else:
            normal = random_axes(random, 1)[0]
            chosen = [k for k in names if random.random() < 0.6]
            for name in chosen:
                axes[name] = axes[name] - normal * (normal @ axes[name])
        if random.random() < 0.5:
            disturbance = 10.0 ** -random.uniform(1, 17)
            axes[first] = axes[first] + disturbance * random_axes(random, 1)[0]
        for name, axis in axes.items():
            length = np.linalg.norm(axis)
            # A projection that vanished has no direction: z replaces it.
            axes[name] = axis / length if length > 1e-8 else np.array([0.0, 0.0, 1.0])
    unit = {name: (float(x), float(y), float(z)) for name, (x, y, z) in axes.items()}
    return replace(mechanism, geometry=PoseGeometry(unit))


def reordered(mechanism, order):
    """Return the same mechanism with other names of links and another order of parts.

    Results must not depend on them. The pairs get the reverse order. Of every other pair
    the two links are exchanged, if the pair is revolute and no input.

    Parameters
    ----------
    mechanism
        Mechanism that is renamed.
    order
        (links - 1,) new order of the moving links, numbers from 0.

    Returns
    -------
    mechanism
        Mechanism with the links "base", "link_0", ...
    names
        New names of the links by old ones.
    """
    names = {mechanism.ground: "base"}
    # The ground is the first of the links.
    old_links = [mechanism.links[1 + number] for number in order]
    for number, old_link in enumerate(old_links):
        names[old_link] = f"link_{number}"
    input_pairs = {item.pair for item in mechanism.inputs}
    pairs = []
    for place, pair in enumerate(reversed(mechanism.pairs)):
        ends = tuple(names[link] for link in pair.links)
        may_be_exchanged = pair.type == "R" and pair.name not in input_pairs
        if may_be_exchanged and place % 2 == 0:
            ends = ends[::-1]
        pairs.append(replace(pair, links=ends))
    links = ["base", *(names[old_link] for old_link in old_links)]
    renamed = replace(mechanism, ground="base", links=tuple(links), pairs=tuple(pairs))
    return renamed, names


def turned(mechanism, rotation):
    """Return a mechanism whose reference pose is rotated as a whole by a matrix (3, 3)."""

    def rotate(vector):
        return tuple(map(float, rotation @ np.array(vector)))

    axes = {name: rotate(axis) for name, axis in mechanism.geometry.axes.items()}
    pairs = []
    for pair in mechanism.pairs:
        if pair.profiles is not None:
            profiles = tuple(replace(p, centre=rotate(p.centre)) for p in pair.profiles)
            pair = replace(pair, profiles=profiles)
        pairs.append(pair)
    geometry = replace(mechanism.geometry, axes=axes)
    return replace(mechanism, geometry=geometry, pairs=tuple(pairs))
