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
    """Return a mechanism of revolute pairs from its joined links and joint axes.

    The axes are those in a reference pose, so any axes can be assembled.

    Parameters
    ----------
    chain
        Joined links as text ("1-2 2-3") or as tuples of two integers. The pair of the links
        a and b is named "pa_b"; the ground is the link of the lowest number.
    axes
        (pairs, 3) unit vectors of the pairs in the reference pose, in ground axes.
    driven
        Name of the input pair; the first pair by default.
    name
        Name of the mechanism.
    span
        Range of the input, rad; 0 is the reference pose.
    """
    edges = parse_chain(chain) if isinstance(chain, str) else chain
    names = [f"p{a}_{b}" for a, b in edges]
    links = sorted({link for edge in edges for link in edge})
    pairs = []
    axes_by_pair = {}
    for pair_name, (a, b), axis in zip(names, edges, axes, strict=True):
        pairs.append(Pair(pair_name, "R", (str(a), str(b))))
        axes_by_pair[pair_name] = tuple(map(float, axis))
    return Mechanism(
        name,
        str(links[0]),
        tuple(str(link) for link in links),
        tuple(pairs),
        PoseGeometry(axes_by_pair),
        inputs=(Input(driven or names[0], *span),),
    )


def random_axes(random, count):
    """Return unit vectors (count, 3), uniform on the sphere."""
    axes = random.normal(size=(count, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def random_chain(random, links, freedoms=1):
    """Return the edges of a random chain: the numbers of two links for each revolute pair.

    The chain has `links` links and as many degrees of freedom as `freedoms` says. Chains
    are drawn until one meets three conditions: every link has two pairs or more, no part
    hangs on one link only (the graph is biconnected), and some inputs move all links.
    """
    # Mobility formula of the sphere: 3 freedoms for each moving link, less 2 for each pair.
    pair_count = (3 * (links - 1) - freedoms) // 2
    possible = [(a, b) for a in range(1, links + 1) for b in range(a + 1, links + 1)]
    while True:
        chosen = random.choice(len(possible), pair_count, replace=False)
        edges = [possible[k] for k in sorted(chosen)]
        graph = nx.Graph(edges)
        if len(graph) < links or min(dict(graph.degree).values()) < 2:
            continue
        if not nx.is_biconnected(graph):
            continue
        candidate = mechanism_from_chain(edges, random_axes(random, pair_count))
        if choose_random_inputs(random, candidate, freedoms) is None:
            continue
        return edges


def choose_random_inputs(random, mechanism, freedoms):
    """Return the mechanism with random revolute pairs as its inputs.

    The number of inputs is `freedoms`. Up to 12 random choices are tried. The result is
    None if none of them determines the motion of all links.
    """
    revolute_pairs = [pair.name for pair in mechanism.pairs if pair.type == "R"]
    for _ in range(12):
        if len(revolute_pairs) < freedoms:
            return None
        names = random.choice(revolute_pairs, freedoms, replace=False)
        candidate = mechanism.with_inputs(*map(str, names))
        try:
            plan_assembly(candidate)
        except PlanError:
            continue
        return candidate
    return None


POINTS = 96
"""Points that a profile runs through: its tangent there is a circle's but for 1e-9."""


def grow_dyad_chain(random, links, triads):
    """Return a four-bar with dyads, or dyads and triads, added at random links."""
    edges = _grow_edges(random, links, triads)
    return mechanism_from_chain(edges, random_axes(random, len(edges)))


def _grow_edges(random, links, triads):
    """Return the joined links of a chain with one freedom, grown from a four-bar.

    Groups of links that do not change the freedom are added until there are `links` links.
    A dyad is two joined links between two links of the chain. A triad is four links: three
    arms that connect three links of the chain to a fourth, central link.

    Parameters
    ----------
    random
        Random number generator.
    links
        Number of links.
    triads
        Whether triads are added as well as dyads. With triads, some poles (axes of relative
        rotation) are no intersections of great circles through other poles.
    """
    edges = [(1, 2), (2, 3), (3, 4), (1, 4)]
    count = 4
    while count < links:
        if triads and links - count >= 4 and random.random() < 0.5:
            # Links are numbered from 1, the result of `choice` from 0.
            ends = (random.choice(count, 3, replace=False) + 1).tolist()
            middle = count + 4
            for k, end in enumerate(ends, start=count + 1):
                edges += [(end, k), (k, middle)]
            count += 4
        else:
            first_end, second_end = (random.choice(count, 2, replace=False) + 1).tolist()
            edges += [
                (first_end, count + 1),
                (count + 1, count + 2),
                (second_end, count + 2),
            ]
            count += 2
    return edges


def random_contact_chain(random, links, rolling, sliding, shaped=False):
    """Return a random mechanism of one freedom in which some pairs are contacts.

    It is derived from a chain of revolute (R) pairs with one freedom:

    - A sliding contact (Cs) takes away one freedom, just like a link with two R pairs. So
      the chain has `sliding` links too many, each of which is replaced by a Cs pair.
    - A rolling contact (Cr) takes away two freedoms, just like an R pair. So `rolling` of
      the R pairs become Cr pairs.

    Link 1 is the ground, and the pair of links 1 and 2 is the input.

    Parameters
    ----------
    random
        Random number generator.
    links
        Number of links of the result. Their numbers may have gaps.
    rolling, sliding
        Number of Cr pairs and of Cs pairs.
    shaped
        Whether profiles are also Fourier series and curves through points. By default all
        are circles.
    """
    while True:
        edges = _grow_edges(random, links + sliding, triads=False)
        types = dict.fromkeys(edges, "R")  # type of pair by its two link numbers
        # Replace links with two R pairs by Cs pairs between their neighbours. Links 1 and 2
        # stay, because their pair is the input.
        for link in random.permutation(np.arange(3, links + sliding + 1)).tolist():
            link_edges = [edge for edge in types if link in edge]
            # The two neighbours: the sum of both link numbers of an edge, less this link.
            ends = tuple(sorted(sum(edge) - link for edge in link_edges))
            if (
                list(types.values()).count("Cs") < sliding
                and len(link_edges) == 2
                and all(types[edge] == "R" for edge in link_edges)
                and ends not in types
            ):
                for edge in link_edges:
                    del types[edge]
                types[ends[0], ends[1]] = "Cs"
        # Pairs of the ground stay R pairs, because one of them is the input.
        may_roll = [edge for edge, kind in types.items() if kind == "R" and 1 not in edge]
        random.shuffle(may_roll)
        types |= dict.fromkeys(may_roll[:rolling], "Cr")
        if list(types.values()).count("Cs") < sliding or len(may_roll) < rolling:
            continue
        mechanism = _mechanism_with_contacts(random, types, shaped)
        try:
            groups = plan_assembly(mechanism).groups
        except PlanError:
            continue
        # Mechanisms in which constraints repeat each other are left out.
        if not any(group.redundant for group in groups):
            return mechanism


def _mechanism_with_contacts(random, types, shaped):
    """Return a mechanism with random joint axes, and profiles that touch at random points.

    The axes and profiles are those in a reference pose. The input is the pair p1_2, with a
    range of 1e-3 rad to both sides of this pose, which callers replace.

    Parameters
    ----------
    random
        Random number generator.
    types
        Type of pair (R revolute, Cr rolling contact, Cs sliding contact) by joined links
        (a, b). Links 1 and 2 are joined by an R pair.
    shaped
        Whether profiles need not be circles.
    """
    axes = {}
    pairs = []
    for (a, b), pair_type in types.items():
        name = f"p{a}_{b}"
        ends = (str(a), str(b))
        point, second_point = random_axes(random, 2)
        if pair_type == "R":
            axes[name] = as_float_tuple(point)
            pairs.append(Pair(name, "R", ends))
            continue
        # The profiles touch at `point`. Their centres lie on both sides of it, along
        # `normal`.
        normal = np.cross(point, second_point)
        normal /= np.linalg.norm(normal)
        first_radius, second_radius = random.uniform(0.3, 1.0, 2)
        profiles = (
            _profile(random, point, normal, first_radius, shaped),
            _profile(random, point, normal, -second_radius, shaped),
        )
        pairs.append(Pair(name, pair_type, ends, profiles))
    links = tuple(str(k) for k in sorted({link for edge in types for link in edge}))
    inputs = (Input("p1_2", -1e-3, 1e-3),)
    return Mechanism("chain", "1", links, tuple(pairs), PoseGeometry(axes), inputs)


def _profile(random, point, normal, signed_radius, shaped):
    """Return a circle through a point, or a closed curve that is nearly this circle.

    It is the profile of one link in a contact, and the two profiles touch at the point. The
    curve is the circle with 2 or 3 waves, whose amplitude is at most 5 % of the radius. One
    of their extrema is at the point. So the curve has the tangent of the circle there.

    Parameters
    ----------
    random
        Random number generator.
    point
        (3,) point of the profile, unit vector.
    normal
        (3,) unit vector perpendicular to the point, towards the centre of the circle.
    signed_radius
        Radius (rad); negative if the centre lies on the other side of the point.
    shaped
        Whether the profile may be a Fourier series or a curve through points.
    """
    centre = _tilted(point, normal, signed_radius)
    radius = abs(signed_radius)
    kind = random.choice(["circle", "fourier", "points"]) if shaped else "circle"
    if kind == "circle":
        return Profile("circle", centre, radius)
    axes = axes_about(centre)
    azimuth = float(np.arctan2(axes[:, 1] @ point, axes[:, 0] @ point))
    waves = int(random.integers(2, 4))
    height = radius * random.uniform(-0.05, 0.05)
    # Colatitude (angle from the centre) over the azimuth `angle`: radius - height + height
    # cos(waves (angle - azimuth)).
    if kind == "fourier":
        zeros = [0.0] * (waves - 1)
        cosine = float(height * np.cos(waves * azimuth))
        sine = float(height * np.sin(waves * azimuth))
        cosines = (radius - height, *zeros, cosine)
        sines = (0.0, *zeros, sine)
        return Profile("fourier", centre, cosines=cosines, sines=sines)
    angle = azimuth + np.linspace(0.0, 2.0 * np.pi, POINTS, endpoint=False)
    colatitude = radius + height * (np.cos(waves * (angle - azimuth)) - 1.0)
    sine = np.sin(colatitude)[:, None]
    cosine = np.cos(colatitude)[:, None]
    outward = np.outer(np.cos(angle), axes[:, 0]) + np.outer(np.sin(angle), axes[:, 1])
    points = sine * outward + cosine * axes[:, 2]
    return Profile("points", points=tuple(as_float_tuple(x) for x in points))


def _tilted(point, normal, angle):
    """Return the point turned by an angle (rad) towards a normal, as floats."""
    return as_float_tuple(np.cos(angle) * point + np.sin(angle) * normal)


def as_float_tuple(given):
    """Return the three components as floats of Python."""
    x, y, z = map(float, given)
    return x, y, z
