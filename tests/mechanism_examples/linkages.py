"""Chains without sizes, and mechanisms made from them with random axes.

Any set of axes is a legal reference pose, so random geometry is always assembled.
"""

import networkx as nx
import numpy as np

from spherekit.errors import PlanError
from spherekit.geometry.parametric_curve import axes_about
from spherekit.mechanism.elements import Input, Pair, PoseGeometry, Profile
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import plan_assembly

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


def parse_chain(chain):
    """Return the joined links of a chain as pairs of integers."""
    return [tuple(int(word) for word in edge.split("-")) for edge in chain.split()]


def mechanism_from_chain(chain, axes, driven=None, name="chain", span=(-1e-3, 1e-3)):
    """Return a chain with these axes (pairs, 3) in its reference pose."""
    edges = parse_chain(chain) if isinstance(chain, str) else chain
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
        candidate = mechanism_from_chain(edges, random_axes(random, edges_wanted))
        if choose_random_inputs(random, candidate, freedoms) is None:
            continue
        return edges


def choose_random_inputs(random, made, freedoms):
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


POINTS = 96
"""Points that a profile runs through: its tangent there is a circle's but for 1e-9."""


def grow_dyad_chain(random, links, triads):
    """Return a four-bar with dyads, or dyads and triads, added at random links."""
    edges = _grown_edges(random, links, triads)
    return mechanism_from_chain(edges, random_axes(random, len(edges)))


def _grown_edges(random, links, triads):
    """Return the joined links of a grown chain.

    A dyad adds two links between two others, a triad four links between three; both
    keep the one freedom. What hangs on a triad has poles that no two lines give.
    """
    edges = [(1, 2), (2, 3), (3, 4), (1, 4)]
    count = 4
    while count < links:
        if triads and links - count >= 4 and random.random() < 0.5:
            ends = (random.choice(count, 3, replace=False) + 1).tolist()
            middle = count + 4
            for k, end in enumerate(ends, start=count + 1):
                edges += [(end, k), (k, middle)]
            count += 4
        else:
            one, other = (random.choice(count, 2, replace=False) + 1).tolist()
            edges += [(one, count + 1), (count + 1, count + 2), (other, count + 2)]
            count += 2
    return edges


def random_contact_chain(random, links, rolling, sliding, shaped=False):
    """Return a chain of dyads in which some pairs are contacts of circles.

    Where they are `shaped`, profiles are also Fourier series and run through points.

    A binary link and its two R pairs take the freedoms that one Cs pair takes, an R pair
    those that a Cr pair takes. So the chain is grown with `sliding` links more, which then
    become Cs pairs, and `rolling` of its R pairs become Cr pairs; it keeps one freedom and
    has as many links as asked for.
    """
    while True:
        edges = _grown_edges(random, links + sliding, False)
        kinds = dict.fromkeys(edges, "R")
        for link in random.permutation(np.arange(3, links + sliding + 1)).tolist():
            near = [edge for edge in kinds if link in edge]
            ends = tuple(sorted(sum(edge) - link for edge in near))
            if (
                list(kinds.values()).count("Cs") < sliding
                and len(near) == 2
                and all(kinds[edge] == "R" for edge in near)
                and ends not in kinds
            ):
                for edge in near:
                    del kinds[edge]
                kinds[ends[0], ends[1]] = "Cs"
        able = [edge for edge, kind in kinds.items() if kind == "R" and 1 not in edge]
        random.shuffle(able)
        kinds |= dict.fromkeys(able[:rolling], "Cr")
        if sorted(kinds.values()).count("Cs") < sliding or len(able) < rolling:
            continue
        made = _touching(random, kinds, shaped)
        try:
            groups = plan_assembly(made).groups
        except PlanError:
            continue
        if not any(group.redundant for group in groups):
            return made


def _touching(random, kinds, shaped):
    """Return a chain with random axes, and profiles that touch at random points."""
    axes, pairs = {}, []
    for (a, b), kind in kinds.items():
        name, ends = f"p{a}_{b}", (str(a), str(b))
        point, other = random_axes(random, 2)
        if kind == "R":
            axes[name] = as_float_tuple(point)
            pairs.append(Pair(name, "R", ends))
            continue
        across = np.cross(point, other)
        across /= np.linalg.norm(across)
        first, second = random.uniform(0.3, 1.0, 2)
        curves = (
            _profile(random, point, across, first, shaped),
            _profile(random, point, across, -second, shaped),
        )
        pairs.append(Pair(name, kind, ends, curves))
    links = tuple(str(k) for k in sorted({link for edge in kinds for link in edge}))
    drives = Input("p1_2", -1e-3, 1e-3)
    return Mechanism("chain", "1", links, tuple(pairs), PoseGeometry(axes), (drives,))


def _profile(random, point, across, angle, shaped):
    """Return a circle about a centre so far from a point of it, or what is nearly one."""
    centre, radius = _tilted(point, across, angle), abs(angle)
    kind = random.choice(["circle", "fourier", "points"]) if shaped else "circle"
    if kind == "circle":
        return Profile("circle", centre, radius)
    axes = axes_about(centre)
    start = float(np.arctan2(axes[:, 1] @ point, axes[:, 0] @ point))
    waves, height = int(random.integers(2, 4)), radius * random.uniform(-0.05, 0.05)
    if kind == "fourier":
        still = [0.0] * (waves - 1)
        cosine = height * np.cos(waves * start)
        sine = height * np.sin(waves * start)
        even = (radius - height, *still, float(cosine))
        odd = (0.0, *still, float(sine))
        return Profile("fourier", centre, cosines=even, sines=odd)
    around = start + np.linspace(0.0, 2.0 * np.pi, POINTS, endpoint=False)
    colatitude = radius + height * (np.cos(waves * (around - start)) - 1.0)
    sine, cosine = np.sin(colatitude)[:, None], np.cos(colatitude)[:, None]
    onward = np.outer(np.cos(around), axes[:, 0]) + np.outer(np.sin(around), axes[:, 1])
    places = sine * onward + cosine * axes[:, 2]
    return Profile("points", points=tuple(as_float_tuple(place) for place in places))


def _tilted(point, across, angle):
    return as_float_tuple(np.cos(angle) * point + np.sin(angle) * across)


def as_float_tuple(given):
    """Return the three components as floats of Python."""
    x, y, z = map(float, given)
    return x, y, z
