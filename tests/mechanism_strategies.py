"""What hypothesis makes: link/pair graphs grown step by step, and geometries for them.

Everything is drawn from small integers, so that what fails shrinks to few links and to
the axes at the head of the list.
"""

from dataclasses import dataclass, replace

import numpy as np
import strategies  # noqa: F401  (its settings apply here too)
from hypothesis import strategies as st

from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Input, Pair, PoseGeometry, Profile

MOST_LINKS = 9
SPAN = 0.05
"""Half the range of each input (rad)."""


def _spread(count):
    """Return unit vectors, spread over the sphere and in no special position."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    around = 2.399963229728653 * k + 0.3
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=1)


AXES = _spread(61)[np.random.default_rng(0).permutation(61)]
CORNERS = np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class Graph:
    """Joined links with the kinds of their pairs, and the places of the inputs."""

    edges: tuple[tuple[int, int], ...]
    kinds: tuple[str, ...]
    driven: tuple[int, ...]

    @property
    def count(self):
        return 1 + max(max(edge) for edge in self.edges)


@st.composite
def graphs(draw, contacts=True, legal=True):
    """Return a graph: a driven link or a four-bar, grown by what keeps every freedom.

    Dyads, triads and links in a cam contact keep the number of freedoms, a link hung on
    another has one of its own and is driven. An illegal graph has some pair too many, a
    link too few, or another input.
    """
    edges, kinds = [(0, 1)], ["R"]
    driven, count = [0], 2
    if draw(st.booleans()):
        edges += [(1, 2), (2, 3), (0, 3)]
        kinds += ["R"] * 3
        count = 4
    steps = ("dyad", "dyad", "triad", "hang") + (("rolling", "cam") if contacts else ())
    for step in draw(st.lists(st.sampled_from(steps), max_size=3)):
        ends = draw(st.permutations(range(count)))[:3]
        if step == "hang":
            driven.append(len(edges))
            edges.append((ends[0], count))
            kinds.append("R")
            count += 1
        elif step == "cam":
            edges += [(ends[0], count), (ends[1], count)]
            kinds += ["R", "Cs"]
            count += 1
        elif step == "triad" and len(ends) == 3 and count + 4 <= MOST_LINKS:
            for k, end in enumerate(ends):
                edges += [(end, count + k), (count + k, count + 3)]
            kinds += ["R"] * 6
            count += 4
        else:
            edges += [(ends[0], count), (count, count + 1), (ends[1], count + 1)]
            kinds += ["R", "Cr" if step == "rolling" else "R", "R"]
            count += 2
        if count >= MOST_LINKS:
            break
    if not legal:
        way = draw(st.sampled_from(("more", "fewer", "undriven", "driven")))
        if way == "more":
            one, other = draw(st.permutations(range(count)))[:2]
            edges.append((min(one, other), max(one, other)))
            kinds.append(draw(st.sampled_from(("R", "Cr", "Cs") if contacts else ("R",))))
        elif way == "fewer" and len(edges) > 1:
            k = draw(st.integers(1, len(edges) - 1))
            edges, kinds = edges[:k] + edges[k + 1 :], kinds[:k] + kinds[k + 1 :]
            driven = [0]
        elif way == "driven":
            driven.append(draw(st.integers(0, len(edges) - 1)))
        else:
            driven = driven[:-1]
    return Graph(tuple(edges), tuple(kinds), tuple(dict.fromkeys(driven)))


@st.composite
def axes_of(draw, count, special):
    """Return unit vectors (count, 3), all different, or in special positions too."""
    chosen = draw(st.permutations(range(len(AXES))))[:count]
    axes = AXES[chosen]
    if special:
        ways = ("equal", "opposite", "right angle", "corner", "coplanar")
        for way in draw(st.lists(st.sampled_from(ways), min_size=1, max_size=3)):
            k, m, n = (draw(st.integers(0, count - 1)) for _ in range(3))
            made = {
                "equal": axes[m],
                "opposite": -axes[m],
                "right angle": np.cross(axes[m], axes[k]),
                "corner": CORNERS[draw(st.integers(0, 5))],
                "coplanar": axes[m] + 0.6 * axes[n],
            }[way]
            length = np.linalg.norm(made)
            if length > 1e-6:
                axes[k] = made / length
    return axes


@st.composite
def mechanisms(draw, contacts=True, legal=True, special=False, span=SPAN):
    """Return a mechanism whose reference pose closes, whatever its axes are."""
    graph = draw(graphs(contacts, legal))
    axes = draw(axes_of(len(graph.edges), special))
    names, given, pairs = [], {}, []
    for k, ((a, b), kind) in enumerate(zip(graph.edges, graph.kinds, strict=True)):
        name = f"p{k}"
        names.append(name)
        ends = str(a + 1), str(b + 1)
        if kind == "R":
            given[name] = tuple(map(float, axes[k]))
            pairs.append(Pair(name, "R", ends))
            continue
        across = np.cross(axes[k], AXES[(7 * k) % len(AXES)] + 0.01)
        across /= np.linalg.norm(across)
        radii = 0.4 + 0.1 * (k % 3), 0.7
        circles = tuple(
            Profile("circle", tuple(map(float, np.cos(r) * axes[k] + s * across)), r)
            for r, s in ((radii[0], np.sin(radii[0])), (radii[1], -np.sin(radii[1])))
        )
        pairs.append(Pair(name, kind, ends, circles))
    links = tuple(str(k + 1) for k in range(graph.count))
    inputs = tuple(Input(names[k], -span, span) for k in graph.driven)
    return Mechanism("made", "1", links, tuple(pairs), PoseGeometry(given), inputs)


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
            pair,
            profiles=tuple(replace(p, centre=moved(p.centre)) for p in pair.profiles),
        )
        for pair in made.pairs
    )
    return replace(made, geometry=replace(made.geometry, axes=axes), pairs=pairs)
