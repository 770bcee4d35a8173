"""Surfaces of singular configurations of a mechanism with three inputs, as triangles.

An advancing front: every open edge of the mesh gets a triangle, with a vertex of the
front that lies near its ideal place or with a new one, which Newton's method brings onto
the locus to rounding. Seeds are singular configurations of slices with two inputs locked.

Triangles between singular configurations: split more finely, and cut at a range.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice, pairwise
from typing import Self

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.completeness import Completeness, TimeLimit
from spherekit.geometry.sphere_mesh import list_edges
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.connectivity import label_components
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.input_revolutions import in_range, less_periods
from spherekit.singularities.curve_starts import StartPoints
from spherekit.singularities.several_inputs import (
    LocusName,
    SingularityReport,
    SingularPoints,
)
from spherekit.singularities.slices import LockedInputSection, LocusPoints


@dataclass(frozen=True)
class SingularSurface:
    """A mesh of singular configurations.

    Attributes
    ----------
    view, nodes
        The singularities of a type, and the vertices (n): each is singular to
        `points.residual`.
    triangles
        (m, 3) numbers of vertices. Edges of triangles may join values of angles that are
        whole turns apart.
    side
        Length (rad, in the variables) of the edges aimed at, after halving.
    claim
        What is known of surfaces that were not found.
    irregular
        How many singular configurations met within the ranges lie where the locus is not a
        regular surface: it crosses itself there, or fills a part of the configurations.
    everywhere
        Whether every configuration is of the type, so that there is no surface.
    """

    view: SingularityReport
    nodes: LocusPoints
    triangles: Indices
    side: float
    claim: Completeness
    irregular: int
    everywhere: bool

    @property
    def kind(self) -> LocusName:
        """The type."""
        return self.view.kind

    @cached_property
    def points(self) -> SingularPoints:
        """The vertices, as the inputs and the output see them."""
        return self.view.points(self.nodes)

    @property
    def component(self) -> Indices:
        """(n,) number of the connected part that each vertex is in."""
        return label_components(len(self.nodes), list_edges(self.triangles)[0])

    @property
    def guarantee(self) -> str:
        """What the mesh guarantees, in words."""
        return (
            "vertices are exact; between them the mesh is flat, with edges of about "
            f"{np.degrees(self.side):.3g} deg; {self.claim}"
        )

    @property
    def border(self) -> Indices:
        """(k, 2) edges with one triangle.

        There the surface leaves the ranges, comes near to a crossing of surfaces, or was
        not closed.
        """
        edges, sides = list_edges(self.triangles)
        return edges[np.bincount(sides.ravel(), minlength=len(edges)) == 1]

    def split(self) -> Self:
        """Return the mesh with every edge halved, at a point of the locus.

        An edge whose middle Newton's method does not find is kept.
        """
        edges, _ = list_edges(self.triangles)
        borders = np.swapaxes(self.nodes.tangents[edges[:, 0]], 1, 2)
        made = self._found(*self._between(edges, 0.5), borders)
        every = np.ones(len(self.nodes), dtype=bool)
        mesh = self._divided(np.arange(len(edges)), made, every)
        return replace(mesh, side=0.5 * self.side)

    def reported(self) -> Self:
        """Return what is of the type, with inputs in their ranges, cut at their ends."""
        mesh, none = self, np.zeros(0, dtype=np.intp)
        for number, (low, high) in enumerate(self.view.ranges.T):
            for end, way in ((low, 1.0), (high, -1.0)):
                mesh = mesh._cut(number, end, way)
        wanted = self.view.is_own(self.view.types(mesh.nodes.values))
        return mesh._divided(none, mesh.nodes.rows(none), wanted)

    def _cut(self, number: int, end: float, way: float) -> Self:
        """Return the part where an input is on one side (1, -1) of an end of its range."""
        beyond = way * (self.view.inputs_of(self.nodes.values)[:, number] - end)
        edges, _ = list_edges(self.triangles)
        inside = in_range(beyond, 0.0, np.inf)
        (which,) = np.nonzero(inside[edges[:, 0]] != inside[edges[:, 1]])
        driven = self.view.solver.driven
        crossing, column = edges[which], driven[number]
        one, other = np.abs(beyond[crossing]).T
        guess, motions, away = self._between(crossing, (one / (one + other))[:, None])
        every = np.eye(guess.shape[1])
        tangents = self.nodes.tangents[crossing[:, 0]]
        beside = np.vecmat(
            tangents[:, column, ::-1] * [-1.0, 1.0], np.swapaxes(tangents, 1, 2)
        )
        for held in driven:
            beside[np.abs(away[:, held]) < LEVEL] = every[held]
        borders = np.stack([np.broadcast_to(every[column], guess.shape), beside], axis=1)
        guess[:, column] += less_periods(end - guess[:, column], self.periods[column])
        return self._divided(which, self._found(guess, motions, away, borders), inside)

    @property
    def periods(self) -> Floats:
        """(V,) growth of each variable that changes nothing."""
        return variable_periods(self.view.locus.closure)

    def _between(
        self, edges: Indices, part: Floats | float
    ) -> tuple[Floats, Floats, Floats]:
        """Return values and motions (k, V) at a part (k, 1) along edges, and the ways."""
        one, other = self.nodes.values[edges.T]
        motion, turned = self.nodes.motions[edges.T]
        away = less_periods(other - one, self.periods)
        turned *= np.sign(np.vecdot(motion, turned))[:, None]
        return one + part * away, motion + part * (turned - motion), away

    def _found(
        self, guess: Floats, motions: Floats, away: Floats, borders: Floats
    ) -> LocusPoints:
        """Return the locus near guesses, NaN where it is not between the ends of a way."""
        targets = np.matvec(borders, guess)
        made = self.view.locus.correct(guess, motions, borders, targets)
        moved = np.linalg.norm(made.values - guess, axis=1)
        made.residual[~(moved < 0.5 * np.linalg.norm(away, axis=1))] = np.nan
        return made

    def _divided(self, which: Indices, made: LocusPoints, inside: Bools) -> Self:
        """Return what is inside, with the good ones of points on some edges.

        Vertices of no triangle go.
        """
        edges, sides = list_edges(self.triangles)
        (good,) = np.nonzero(made.good)
        number = np.full(len(edges), -1)
        number[which[good]] = len(self.nodes) + np.arange(len(good))
        rows = (
            part.tolist()
            for part in (self.triangles, number[sides], inside[self.triangles])
        )
        triangles = [part for row in zip(*rows, strict=True) for part in _parts(*row)]
        used, numbers = np.unique(
            np.array(triangles, dtype=np.intp).reshape(-1, 3), return_inverse=True
        )
        nodes = LocusPoints.joined([self.nodes, made.rows(good)]).rows(used)
        return replace(self, nodes=nodes, triangles=numbers.reshape(-1, 3))


def _parts(
    corners: list[int], middles: list[int], inside: list[bool]
) -> list[tuple[int, ...]]:
    """Return the triangles of what of one is inside, with points on its sides.

    A side without a point has -1; where the inside ends on it there is no triangle.
    """
    ring: list[int] = []
    for k, (corner, middle) in enumerate(zip(corners, middles, strict=True)):
        ring += [corner] * inside[k]
        ring += [middle] * (middle >= 0)
        if middle < 0 and inside[k] != inside[k - 2]:
            return []
    if len(ring) == 6:
        a, ab, b, bc, c, ca = ring
        return [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    first = next((k for k, vertex in enumerate(ring) if vertex in middles), 0)
    top, *others = ring[first:] + ring[:first] or [-1]
    return [(top, *side) for side in pairwise(others)]


HEIGHT = 0.75**0.5
"""Height of an equilateral triangle of side 1."""
MERGED = 0.75
"""A vertex of the front this near to the ideal place, in sides, is taken for it."""
CROWDED = 0.5
"""A new vertex keeps this distance from others, in sides."""
STRETCHED = 1.5
"""Longest edge, in sides."""
LOWEST = 0.2
"""Least height of a triangle, in sides."""
TURNED = 0.8
"""Least cosine between tangent planes, and between singular motions, at an edge's ends."""
BEYOND = 0.25
"""So far beyond the ranges (in sides) a vertex still counts as within them."""
HALVING = 0.25
"""Time that a vertex takes which halving adds, in that of one that is laid."""
LEVEL = 1e-9
"""An edge at whose ends an input is the same (rad) lies along the end of its range."""
AHEAD = 32
"""Edges for which new vertices are corrected at once."""
MOST_VERTICES = 20_000
"""Vertices at which a mesh ends, before halving."""
FLAT = 1e-4
"""A point whose equations have this reciprocal condition is where surfaces cross."""

Edge = tuple[int, int]


def singular_surface(
    mechanism: Mechanism,
    kind: LocusName = "II",
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    side: float = 0.15,
    halved: int = 0,
    slices_of_each: int = 4,
    made: LockedInputSection | None = None,
    budget: TimeLimit | None = None,
) -> SingularSurface:
    """Return the surfaces of singular configurations of a mechanism with three inputs.

    Parameters
    ----------
    mechanism, kind, output, pointing, slices_of_each, made, budget
        As for `spherekit.singularities.singular_curves.singular_curves`, with two inputs
        locked in each slice; type I is that of an orientation.
    side, halved
        Length (rad, in the variables) of the edges of the triangles that are laid, and how
        often each is halved afterwards, at a point of the surface.

    Raises
    ------
    AnalysisError, PlanError
        If there are not three inputs with a freedom each, no such output, or type I of a
        direction is asked for: three inputs never leave it so along a surface only.
    """
    source = StartPoints(mechanism, 3, kind, output, pointing, made, slices_of_each, budget)
    budget = source.budget
    if halved:
        source.budget = budget.part(1.0 / (1.0 + HALVING * 4**halved))
    front = _Front(source, side)
    irregular = front.grow_all()
    mesh = SingularSurface(
        source.view,
        front.nodes,
        np.array(front.triangles, dtype=np.intp).reshape(-1, 3),
        side,
        source.claim("surface"),
        irregular,
        source.everywhere,
    )
    for _ in range(halved):
        budget.tell(f"halving the edges of {len(mesh.triangles)} triangles")
        mesh = mesh.split()
    return mesh.reported()


class _Front:
    """A growing mesh. `open` has the edges with one triangle, and its third vertex.

    `ways` are the edges in the sense in which triangles have them, `queue` those that may
    get a second one, `ready` new vertices for open edges, None where the locus is not
    found. Places in the tangent plane at a vertex are complex numbers.

    It grows from edges with an end inside of the ranges, by one triangle beyond these.
    """

    def __init__(self, source: StartPoints, side: float) -> None:
        self.source = source
        self.view = source.view
        self.side = side
        self.periods = variable_periods(self.view.locus.closure)
        self.nodes = self.view.locus.onto(np.zeros((0, len(self.periods))))
        self.triangles: list[tuple[int, int, int]] = []
        self.inside: list[bool] = []
        self.open: dict[Edge, int] = {}
        self.ready: dict[Edge, LocusPoints | None] = {}
        self.ways: set[Edge] = set()
        self.queue: deque[Edge] = deque()

    def near(self, values: Floats, motion: Floats, radius: float) -> Indices:
        """Return the vertices within a radius on the same sheet of the surface."""
        away = less_periods(self.nodes.values - values, self.periods)
        same = np.abs(self.nodes.motions @ motion) > TURNED
        return np.flatnonzero((np.linalg.norm(away, axis=1) < radius) & same)

    def grow_all(self) -> int:
        """Mesh the surfaces through all seeds; return how many of these are irregular."""
        irregular = 0
        for points in self.source.batches():
            inside = self.view.points(points).inside
            irregular += int(np.sum(inside & (points.reciprocal_condition < FLAT)))
            for row in np.flatnonzero(inside):
                if self.grow(points.rows(slice(row, row + 1))):
                    self.source.met()
            if self.source.budget.note:
                break
        return irregular

    def _goes_on(self) -> bool:
        """Return whether there is room and time for one vertex more."""
        budget, count = self.source.budget, len(self.nodes)
        if count < MOST_VERTICES:
            return budget.goes_on(f"vertex {count} of a mesh")
        budget.note = f"stopped at {count} vertices"
        return False

    def grow(self, seed: LocusPoints) -> bool:
        """Mesh the surface through a seed, unless a mesh covers it; return whether."""
        crossed = seed.reciprocal_condition[0] < FLAT
        covered = len(self.near(seed.values[0], seed.motions[0], self.side))
        if crossed or covered or not self._goes_on():
            return False
        first = self._add(seed)
        beside = self._beside([first] * 2, [self.side, self.side * (0.5 + 1j * HEIGHT)])
        corners = [*map(self._add, filter(None, beside))]
        if len(corners) == 2:
            self._join(first, *corners)
        while self.queue and self._goes_on():
            edge = self.queue.popleft()
            if self._grows(edge):
                self._advance(edge)
        return True

    def _grows(self, edge: Edge) -> bool:
        """Return whether an edge gets a triangle."""
        return edge in self.open and any(self.inside[vertex] for vertex in edge)

    def _add(self, point: LocusPoints) -> int:
        self.nodes = LocusPoints.joined([self.nodes, point])
        # The surface curves back over the end of a range between vertices beyond it.
        (low, high), room = self.view.ranges, BEYOND * self.side
        inside = in_range(self.view.inputs_of(point.values), low - room, high + room)
        self.inside.append(bool(np.all(inside)))
        return len(self.nodes) - 1

    def _join(self, a: int, b: int, c: int) -> None:
        """Add a triangle, turned like that on the other side of its edge from a to b."""
        if (a, b) in self.ways:
            a, b = b, a
        self.triangles.append((a, b, c))
        for one, other, opposite in ((a, b, c), (b, c, a), (c, a, b)):
            self.ways.add((one, other))
            edge = (min(one, other), max(one, other))
            if self.open.pop(edge, None) is None:
                self.open[edge] = opposite
                self.queue.append(edge)

    def _beside(
        self, bases: list[int], ways: Sequence[complex]
    ) -> list[LocusPoints | None]:
        """Return the locus where ways in the tangent planes at vertices lead."""
        starts = self.nodes.rows(np.array(bases))
        parts = np.stack([np.real(ways), np.imag(ways)], axis=1)
        guess = starts.values + np.matvec(starts.tangents, parts)
        turned = starts.motions + np.matvec(starts.turns, parts)
        borders = np.swapaxes(starts.tangents, 1, 2)
        targets = np.matvec(borders, guess)
        points = self.view.locus.correct(guess, turned, borders, targets)
        regular = points.good & ~(points.reciprocal_condition < FLAT)
        across = np.where(regular[:, None, None], borders @ points.tangents, 0.0)
        aligned = np.linalg.svd(across, compute_uv=False)[:, -1]
        moved = np.linalg.norm(points.values - guess, axis=1)
        same = np.abs(np.vecdot(points.motions, starts.motions))
        fits = regular & (aligned >= TURNED) & (same >= TURNED) & (moved <= 0.5 * self.side)
        return [
            points.rows(slice(row, row + 1)) if fit else None
            for row, fit in enumerate(fits.tolist())
        ]

    def _flat(self, base: int, rows: Indices | list[int]) -> list[complex]:
        """Return vertices in the tangent plane at another one."""
        away = self.nodes.values[rows] - self.nodes.values[base]
        seen = less_periods(away, self.periods) @ self.nodes.tangents[base]
        return [*map(complex, *seen.T)]

    def _ideal(self, edge: Edge) -> complex:
        """Return where a vertex makes the triangle on an edge's open side equilateral."""
        along, third = self._flat(edge[0], [edge[1], self.open[edge]])
        height = HEIGHT * self.side * along / abs(along)
        sense = -1j if _turn(0.0, along, third) > 0.0 else 1j
        return 0.5 * along + height * sense

    def _made(self, edge: Edge) -> LocusPoints | None:
        """Return the new vertex for an edge, made with those for the next in the queue.

        They depend on nothing but their edges and the triangles on these.
        """
        if edge not in self.ready:
            ahead = (
                one for one in self.queue if self._grows(one) and one not in self.ready
            )
            edges = [edge, *islice(ahead, AHEAD - 1)]
            made = self._beside([one[0] for one in edges], [*map(self._ideal, edges)])
            self.ready |= dict(zip(edges, made, strict=True))
        return self.ready.pop(edge)

    def _advance(self, edge: Edge) -> None:
        """Put a triangle on the open side of an edge, if one can be."""
        a, b = edge
        ideal = self._ideal(edge)
        middle = self.nodes.values[a] + self.nodes.tangents[a] @ [ideal.real, ideal.imag]
        around = self.near(middle, self.nodes.motions[a], 2.5 * self.side)
        place = dict(zip(around.tolist(), self._flat(a, around), strict=True))
        place |= {a: 0.0, b: self._flat(a, [b])[0], -1: ideal}
        walls = [wall for wall in self.open if place.keys() >= {*wall}]
        ends = {*chain(*walls)} - {a, b}
        ranked = sorted((abs(place[k] - ideal) / self.side, k) for k in ends)
        near, far = (
            [k for away, k in ranked if away < room] for room in (MERGED, STRETCHED)
        )
        for vertex in (*near, -1, *far):
            made = self._made(edge) if vertex < 0 else None
            if vertex < 0:
                if made is None:
                    continue
                if len(self.near(made.values[0], made.motions[0], CROWDED * self.side)):
                    continue
            if self._fits(edge, vertex, place, walls):
                self._join(a, b, vertex if made is None else self._add(made))
                return

    def _fits(
        self, edge: Edge, vertex: int, place: dict[int, complex], walls: list[Edge]
    ) -> bool:
        """Return whether the triangle overlaps nothing, in the tangent plane."""
        a, b, top = place[edge[0]], place[edge[1]], place[vertex]
        outwards = np.sign(_turn(a, b, place[-1]))
        if outwards * _turn(a, b, top) < LOWEST * self.side * abs(b - a):
            return False
        for end in edge:
            side = (min(end, vertex), max(end, vertex))
            if side not in self.open and {side, side[::-1]} & self.ways:
                return False
            if abs(top - place[end]) > STRETCHED * self.side:
                return False
            for one, other in walls:
                apart = {end, vertex}.isdisjoint((one, other))
                if apart and _cross(place[end], top, place[one], place[other]):
                    return False
        ends = {*chain(*walls)} - {*edge, vertex}
        return not any(_within(place[k], a, b, top) for k in ends)


def _turn(a: complex, b: complex, c: complex) -> float:
    """Return the product of the sides from a to b and to c, positive to the left."""
    return ((b - a).conjugate() * (c - a)).imag


def _cross(a: complex, b: complex, c: complex, d: complex) -> bool:
    """Return whether two segments of a plane cross."""
    return (_turn(a, b, c) * _turn(a, b, d) < 0.0) and _turn(c, d, a) * _turn(c, d, b) < 0.0


def _within(point: complex, a: complex, b: complex, c: complex) -> bool:
    """Return whether a point lies in a triangle of a plane."""
    signs = [_turn(a, b, point), _turn(b, c, point), _turn(c, a, point)]
    return min(signs) > 0.0 or max(signs) < 0.0
