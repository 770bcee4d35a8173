"""The chains and oracles of the tests, and chains grown to any number of links."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from spherekit.errors import PlanError
from spherekit.model.joints import PairType
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Input, Pair, PoseGeometry, Profile
from spherekit.planning.assembly import plan_assembly
from spherekit.sphere.paths import axes_about
from spherekit.sphere.rotation import Floats

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import chains
from mode_judge import Structure
from oracles import link_rates, null_space, off_axis

__all__ = [
    "EIGHT_BARS",
    "Structure",
    "grown",
    "link_rates",
    "mechanism",
    "null_space",
    "off_axis",
    "random_axes",
    "random_chain",
    "vector",
    "with_contacts",
]


Edge = tuple[int, int]

POINTS = 96
"""Points that a profile runs through: its tangent there is a circle's but for 1e-9."""

EIGHT_BARS: Sequence[Sequence[Edge]] = chains.EIGHT_BARS
mechanism: Callable[..., Mechanism] = chains.mechanism
random_axes: Callable[..., Floats] = chains.random_axes
random_chain: Callable[..., Sequence[Edge]] = chains.random_chain


def grown(random: np.random.Generator, links: int, triads: bool) -> Mechanism:
    """Return a four-bar with dyads, or dyads and triads, added at random links."""
    edges = _grown_edges(random, links, triads)
    return mechanism(edges, random_axes(random, len(edges)))


def _grown_edges(random: np.random.Generator, links: int, triads: bool) -> list[Edge]:
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


def with_contacts(
    random: np.random.Generator,
    links: int,
    rolling: int,
    sliding: int,
    shaped: bool = False,
) -> Mechanism:
    """Return a chain of dyads in which some pairs are contacts of circles.

    Where they are `shaped`, profiles are also Fourier series and run through points.

    A binary link and its two R pairs take the freedoms that one Cs pair takes, an R pair
    those that a Cr pair takes. So the chain is grown with `sliding` links more, which then
    become Cs pairs, and `rolling` of its R pairs become Cr pairs; it keeps one freedom and
    has as many links as asked for.
    """
    while True:
        edges = _grown_edges(random, links + sliding, False)
        kinds: dict[Edge, PairType] = dict.fromkeys(edges, "R")
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


def _touching(
    random: np.random.Generator, kinds: dict[Edge, PairType], shaped: bool
) -> Mechanism:
    """Return a chain with random axes, and profiles that touch at random points."""
    axes, pairs = {}, []
    for (a, b), kind in kinds.items():
        name, ends = f"p{a}_{b}", (str(a), str(b))
        point, other = random_axes(random, 2)
        if kind == "R":
            axes[name] = vector(point)
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


def _profile(
    random: np.random.Generator,
    point: Floats,
    across: Floats,
    angle: float,
    shaped: bool,
) -> Profile:
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
    return Profile("points", points=tuple(vector(place) for place in places))


def _tilted(point: Floats, across: Floats, angle: float) -> tuple[float, float, float]:
    return vector(np.cos(angle) * point + np.sin(angle) * across)


def vector(given: Floats) -> tuple[float, float, float]:
    """Return the three components as floats of Python."""
    x, y, z = map(float, given)
    return x, y, z
