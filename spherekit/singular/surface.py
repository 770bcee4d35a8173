"""Surfaces of singular configurations of a mechanism with three inputs, as triangles.

An advancing front: every open edge of the mesh gets a triangle, with a vertex of the
front that lies near its ideal place or with a new one, which Newton's method brings onto
the locus to rounding. Seeds are singular configurations of slices with two inputs locked.

Triangles between singular configurations: split more finely, and cut at a range.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Self, final

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers
from spherekit.errors import AnalysisError
from spherekit.guarantee import Budget, Claim
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_length import periods_of
from spherekit.motion.turns import in_range, into_range, less_periods
from spherekit.singular.locus import Cut, Locus, LocusPoints, solver_of
from spherekit.singular.several import LocusName, SingularPoints, View
from spherekit.singular.starts import EVERYWHERE, Seeding
from spherekit.singular.stationarity import output_of

SIDES = ((0, 1), (1, 2), (2, 0))


@final
@dataclass(frozen=True)
class Mesh:
    """Triangles of vertices on a locus.

    Attributes
    ----------
    locus, points
        The locus, and the vertices (n).
    triangles
        (m, 3) numbers of vertices.
    component
        (n,) number of the seed each vertex was reached from.
    held
        (n, V) which variables of vertices are at an end of a range that cuts the mesh.
    """

    locus: Locus
    points: LocusPoints
    triangles: Integers
    component: Integers
    held: Bools

    @property
    def border(self) -> Integers:
        """(k, 2) the edges with one triangle."""
        edges, _, often = self._edges()
        return np.asarray(edges[often == 1])

    def split(self) -> Self:
        """Return the mesh with every edge halved, at a point of the locus.

        An edge whose middle Newton's method does not find is kept.
        """
        edges, of_triangle, _ = self._edges()
        guess, motions = self._between(edges, np.full(len(edges), 0.5))
        borders = np.swapaxes(self.points.tangents[edges[:, 0]], 1, 2)
        made = self._found(guess, motions, borders, edges)
        count = len(self.points)
        middle = np.full(len(edges), -1)
        middle[made.good] = count + np.arange(int(made.good.sum()))
        triangles: list[tuple[int, int, int]] = []
        for corners, sides in zip(self.triangles.tolist(), of_triangle, strict=True):
            triangles += _parts(corners, middle[sides].tolist())
        held = np.zeros_like(self.held, shape=(len(edges), self.held.shape[1]))
        return self._with(made, held, edges, triangles)

    def within(self, driven: int, low: float, high: float) -> Self:
        """Return what of the mesh has a variable (rad) in a range, cut at its ends."""
        mesh = self._cut(driven, low, high, low, 1.0)
        return mesh._cut(driven, low, high, high, -1.0)

    def only(self, wanted: Bools) -> Self:
        """Return the triangles whose vertices are all wanted (n,)."""
        if np.all(wanted):
            return self
        none = self.points.rows(np.zeros(0, dtype=np.intp))
        kept = self.triangles[np.all(wanted[self.triangles], axis=1)]
        corners = [(a, b, c) for a, b, c in kept.tolist()]
        return self._with(none, self.held[:0], np.zeros((0, 2), dtype=np.int64), corners)

    def _cut(self, driven: int, low: float, high: float, end: float, way: float) -> Self:
        period = periods_of(self.locus.closure)[driven]
        q = into_range(self.points.values[:, driven], low, high, period)
        beyond = way * (q - end)
        inside = in_range(beyond, 0.0, np.inf)
        edges, of_triangle, _ = self._edges()
        crossed = inside[edges[:, 0]] != inside[edges[:, 1]]
        crossing = edges[crossed]
        one, other = np.abs(beyond[crossing]).T
        guess, motions = self._between(crossing, one / (one + other))
        every = np.eye(guess.shape[1])
        held = np.all(self.held[crossing], axis=1)
        tangents = self.points.tangents[crossing[:, 0]]
        slope = tangents[:, driven]
        along = np.stack([-slope[:, 1], slope[:, 0]], axis=1)
        beside = np.einsum("nvk,nk->nv", tangents, along)
        beside = np.where(held.any(axis=1)[:, None], every[held.argmax(axis=1)], beside)
        borders = np.stack([np.broadcast_to(every[driven], guess.shape), beside], axis=1)
        miss = less_periods(end - guess[:, driven], np.full(len(guess), period))
        guess[:, driven] += miss
        made = self._found(guess, motions, borders, crossing)
        at = np.full(len(edges), -1)
        numbers = np.full(len(crossing), -1)
        numbers[made.good] = len(self.points) + np.arange(int(made.good.sum()))
        at[crossed] = numbers
        triangles: list[tuple[int, int, int]] = []
        for corners, sides in zip(self.triangles.tolist(), of_triangle, strict=True):
            triangles += _inner(corners, at[sides].tolist(), inside[corners].tolist())
        held[:, driven] = True
        return self._with(made, held, crossing, triangles)

    def _edges(self) -> tuple[Integers, Integers, Integers]:
        """Return edges (k, 2), those (m, 3) of triangles, and how many have each."""
        sides = np.stack([self.triangles[:, pair] for pair in SIDES], axis=1)
        edges, which, often = np.unique(
            np.sort(sides.reshape(-1, 2), axis=1),
            axis=0,
            return_inverse=True,
            return_counts=True,
        )
        return edges, which.reshape(-1, 3), often

    def _between(self, edges: Integers, part: Floats) -> tuple[Floats, Floats]:
        """Return values and motions (k, V) at a part (k,) of the way along edges."""
        values, motions = self.points.values, self.points.motions
        one, other = edges.T
        away = less_periods(values[other] - values[one], periods_of(self.locus.closure))
        sense = np.sign(np.sum(motions[one] * motions[other], axis=1))[:, None]
        turned = sense * motions[other] - motions[one]
        step = part[:, None]
        return values[one] + step * away, motions[one] + step * turned

    def _found(
        self, guess: Floats, motions: Floats, borders: Floats, edges: Integers
    ) -> LocusPoints:
        """Return the locus near guesses, NaN where that is not between the edge's ends."""
        targets = np.einsum("nkv,nv->nk", borders, guess)
        made = self.locus.correct(guess, motions, borders, targets)
        ends = self.points.values[edges]
        length = np.linalg.norm(
            less_periods(ends[:, 1] - ends[:, 0], periods_of(self.locus.closure)), axis=1
        )
        far = ~(np.linalg.norm(made.values - guess, axis=1) < 0.5 * length)
        made.residual[far] = np.nan
        return made

    def _with(
        self,
        points: LocusPoints,
        held: Bools,
        edges: Integers,
        triangles: list[tuple[int, int, int]],
    ) -> Self:
        """Return the mesh with the good points on edges (k, 2), and other triangles.

        Vertices of no triangle go.
        """
        good = points.good
        every = LocusPoints.joined([self.points, points.rows(good)])
        component = np.concatenate([self.component, self.component[edges[good, 0]]])
        corners = np.array(triangles, dtype=np.int64).reshape(-1, 3)
        used, numbers = np.unique(corners, return_inverse=True)
        return type(self)(
            self.locus,
            every.rows(used),
            numbers.reshape(-1, 3).astype(np.int64),
            component[used],
            np.concatenate([self.held, held[good]])[used],
        )


def _parts(corners: list[int], middles: list[int]) -> list[tuple[int, int, int]]:
    """Return the triangles of one with the middles of its sides, -1 for a side kept."""
    (a, b, c), (ab, bc, ca) = corners, middles
    split = sum(middle >= 0 for middle in middles)
    if split == 0:
        return [(a, b, c)]
    if split == 3:
        return [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    while ab < 0 or (split == 2 and bc < 0):
        a, b, c, ab, bc, ca = b, c, a, bc, ca, ab
    if split == 1:
        return [(a, ab, c), (ab, b, c)]
    return [(ab, b, bc), (a, ab, bc), (a, bc, c)]


def _inner(
    corners: list[int], cuts: list[int], inside: list[bool]
) -> list[tuple[int, int, int]]:
    """Return the triangles of what of one is inside; none where a cut is missing."""
    count = sum(inside)
    if count in (0, 3):
        return [(corners[0], corners[1], corners[2])] if count else []
    odd = inside.index(count == 1)
    a, b, c = (corners[(odd + k) % 3] for k in range(3))
    ab, ca = cuts[odd], cuts[(odd + 2) % 3]
    if ab < 0 or ca < 0:
        return []
    return [(a, ab, ca)] if count == 1 else [(ab, b, c), (ab, c, ca)]


HEIGHT = 0.5 * np.sqrt(3.0)
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
AHEAD = 32
"""Edges for which new vertices are corrected at once."""
FLAT = 1e-4
"""A point whose equations have this reciprocal condition is where surfaces cross."""

Edge = tuple[int, int]


@final
@dataclass(frozen=True)
class SingularSurface:
    """A mesh of singular configurations.

    Attributes
    ----------
    kind, points
        The type, and the vertices (n): each is singular to `points.residual`.
    triangles
        (m, 3) numbers of vertices. Edges of triangles may join values of angles that are
        whole turns apart.
    border
        (k, 2) edges with one triangle: where the surface leaves the ranges, comes near to
        a crossing of surfaces, or was not closed.
    component
        (n,) number of the seed each vertex was reached from.
    side
        Length (rad, in the variables) of the edges aimed at, after halving.
    claim
        What is known of surfaces that were not found.
    irregular
        How many singular configurations met within the ranges lie where the locus is not a
        regular surface: it crosses itself there, or fills a part of the configurations.
    full
        Whether the mesh ended at the greatest number of vertices.
    everywhere
        Whether every configuration is of the type, so that there is no surface.
    """

    kind: LocusName
    points: SingularPoints
    triangles: Integers
    border: Integers
    component: Integers
    side: float
    claim: Claim
    irregular: int
    full: bool
    everywhere: bool = False

    @property
    def guarantee(self) -> str:
        """What the mesh guarantees, in words."""
        return (
            "vertices are exact; between them the mesh is flat, with edges of about "
            f"{np.degrees(self.side):.3g} deg; {self.claim}"
        )


def singular_surface(
    mechanism: Mechanism,
    kind: LocusName = "II",
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    side: float = 0.15,
    halved: int = 0,
    slices_of_each: int = 4,
    whole_turn: bool = False,
    most: int = 20_000,
    made: Cut | None = None,
    budget: Budget | None = None,
) -> SingularSurface:
    """Return the surfaces of singular configurations of a mechanism with three inputs.

    Parameters
    ----------
    mechanism, kind, output, pointing, slices_of_each, made, budget
        As for `spherekit.singular.curves.singular_curves`, with two inputs locked in each
        slice; type I is that of an orientation.
    side, halved
        Length (rad, in the variables) of the edges of the triangles that are laid, and how
        often each is halved afterwards, at a point of the surface.
    whole_turn, most
        Whether to mesh more than the declared ranges, and most vertices before halving.

    Raises
    ------
    AnalysisError, PlanError
        If there are not three inputs with a freedom each, no such output, or type I of a
        direction is asked for: three inputs never leave it so along a surface only.
    """
    rest, solver = output_of(mechanism, output, pointing), solver_of(mechanism)
    wrong = ""
    if len(solver.driven) != 3:
        wrong = f" has {len(solver.driven)} inputs; surfaces are those of three"
    elif kind == "I" and rest.count < 3:
        wrong = ": three inputs move a direction in more ways than it has; ask for type I "
        wrong += "of the link's orientation, without `pointing`"
    if wrong:
        raise AnalysisError(mechanism.name + wrong)
    view, budget = View.of(solver, rest, kind), budget or Budget()
    source = Seeding(view, whole_turn, made, slices_of_each, budget)
    front = _Front(view, whole_turn, side, most, budget)
    if halved:
        source.budget = front.budget = budget.part(1.0 / (1.0 + HALVING * 4**halved))
    irregular = 0 if source.everywhere else front.grow_all(source)
    mesh = front.finished(halved, budget)
    return SingularSurface(
        kind,
        view.points(mesh.points),
        mesh.triangles,
        mesh.border,
        mesh.component,
        side / 2**halved,
        EVERYWHERE if source.everywhere else source.claim("surface"),
        irregular,
        len(front.values) >= most,
        source.everywhere,
    )


@final
class _Front:
    """A growing mesh. `open` has the edges with one triangle, and its third vertex.

    `ways` are the edges in the sense in which triangles have them, `ready` new vertices for
    open edges, None where the locus is not found.

    It grows from edges with an end inside of the ranges, by one triangle beyond these.
    """

    def __init__(
        self, view: View, whole_turn: bool, side: float, most: int, budget: Budget
    ) -> None:
        self.locus, self.view, self.whole_turn = view.locus, view, whole_turn
        self.side, self.most, self.budget = side, most, budget
        self.periods = periods_of(self.locus.closure)
        self.parts: list[LocusPoints] = []
        self.values = np.zeros((0, len(self.periods)))
        self.motions = np.zeros((0, len(self.periods)))
        self.triangles: list[tuple[int, int, int]] = []
        self.component: list[int] = []
        self.inside: list[bool] = []
        self.open: dict[Edge, int] = {}
        self.ready: dict[Edge, LocusPoints | None] = {}
        self.ways: set[Edge] = set()
        self.closed: set[Edge] = set()

    @property
    def mesh(self) -> Mesh:
        """What is laid, that no range has cut."""
        none = self.locus.onto(np.zeros((0, len(self.periods))))
        return Mesh(
            self.locus,
            LocusPoints.joined([none, *self.parts]),
            np.array(self.triangles, dtype=np.int64).reshape(-1, 3),
            np.array(self.component, dtype=np.int64),
            np.zeros(self.values.shape, dtype=bool),
        )

    def finished(self, halved: int, budget: Budget) -> Mesh:
        """Return it with its edges halved so often, cut at the ranges of the inputs."""
        mesh, solver = self.mesh, self.view.solver
        for _ in range(halved):
            budget.tell(f"halving the edges of {len(mesh.triangles)} triangles")
            mesh = mesh.split()
        if not self.whole_turn:
            for number, item in zip(solver.driven, solver.mechanism.inputs, strict=True):
                mesh = mesh.within(number, *item.range)
        return mesh.only(self.view.is_own(self.view.types(mesh.points.values)))

    def away(self, origin: Floats, rows: Indices | slice) -> Floats:
        """Return vertices (n, V) as seen from a configuration, less whole periods."""
        return less_periods(self.values[rows] - origin, self.periods)

    def near(self, values: Floats, motion: Floats, radius: float) -> Indices:
        """Return the vertices within a radius on the same sheet of the surface."""
        distance = np.linalg.norm(self.away(values, slice(None)), axis=1)
        same = np.abs(self.motions @ motion) > TURNED
        return np.flatnonzero((distance < radius) & same)

    def grow_all(self, source: Seeding) -> int:
        """Mesh the surfaces through all seeds; return how many of these are irregular."""
        irregular = 0
        for points in source.batches():
            inside = self.whole_turn | self.view.points(points).inside
            irregular += int(np.sum(inside & (points.reciprocal_condition < FLAT)))
            for row in np.flatnonzero(inside):
                source.met(self.grow(points.rows(slice(row, row + 1))))
        return irregular

    def grow(self, seed: LocusPoints) -> bool:
        """Mesh the surface through a seed, unless a mesh covers it; return whether."""
        if len(self.values) >= self.most or seed.reciprocal_condition[0] < FLAT:
            return False
        if len(self.near(seed.values[0], seed.motions[0], self.side)):
            return False
        if not self.budget.goes_on(f"vertex {len(self.values)} of a mesh"):
            return False
        number = self.component[-1] + 1 if self.component else 0
        a = self._add(seed, number)
        (first,) = self._beside([a], np.array([[self.side, 0.0]]))
        if first is None:
            return True
        b = self._add(first, number)
        (third,) = self._beside([a], self.side * np.array([[0.5, HEIGHT]]))
        if third is None:
            return True
        c = self._add(third, number)
        queue: deque[Edge] = deque()
        self._join(a, b, c, queue)
        while queue and len(self.values) < self.most:
            edge = queue.popleft()
            if not self.budget.goes_on(f"vertex {len(self.values)} of a mesh"):
                break
            if edge in self.open and (self.inside[edge[0]] or self.inside[edge[1]]):
                self._advance(edge, queue, number)
        self.ready.clear()
        return True

    def _add(self, point: LocusPoints, number: int) -> int:
        self.parts.append(point)
        self.values = np.concatenate([self.values, point.values])
        self.motions = np.concatenate([self.motions, point.motions])
        self.component.append(number)
        self.inside.append(self._inside(point))
        return len(self.values) - 1

    def _join(self, a: int, b: int, c: int, queue: deque[Edge]) -> None:
        """Add a triangle, turned like that on the other side of its edge from a to b."""
        if (a, b) in self.ways:
            a, b = b, a
        self.triangles.append((a, b, c))
        self.ways |= {(a, b), (b, c), (c, a)}
        for one, other, opposite in ((a, b, c), (b, c, a), (c, a, b)):
            edge = (min(one, other), max(one, other))
            if edge in self.open:
                del self.open[edge]
                self.closed.add(edge)
            else:
                self.open[edge] = opposite
                queue.append(edge)

    def _inside(self, point: LocusPoints) -> bool:
        """Return whether a vertex is within the ranges, or just beyond them.

        The surface curves back over an end between vertices beyond it.
        """
        (low, high), room = self.view.ranges, BEYOND * self.side
        inputs = self.view.inputs_of(point.values)[0]
        return self.whole_turn or bool(np.all(in_range(inputs, low - room, high + room)))

    def _beside(self, bases: list[int], ways: Floats) -> list[LocusPoints | None]:
        """Return the locus where ways (k, 2) in the tangent planes at vertices lead."""
        starts = LocusPoints.joined([self.parts[base] for base in bases])
        tangents = starts.tangents
        guess = starts.values + np.einsum("nvk,nk->nv", tangents, ways)
        turned = starts.motions + np.einsum("nvk,nk->nv", starts.turns, ways)
        borders = np.swapaxes(tangents, 1, 2)
        targets = np.einsum("nkv,nv->nk", borders, guess)
        points = self.locus.correct(guess, turned, borders, targets)
        regular = points.good & ~(points.reciprocal_condition < FLAT)
        across = np.where(regular[:, None, None], borders @ points.tangents, 0.0)
        aligned = np.linalg.svd(across, compute_uv=False)[:, -1]
        moved = np.linalg.norm(points.values - guess, axis=1)
        same = np.abs(np.sum(points.motions * starts.motions, axis=1))
        fits = regular & (aligned >= TURNED) & (same >= TURNED) & (moved <= 0.5 * self.side)
        return [
            points.rows(slice(row, row + 1)) if fit else None
            for row, fit in enumerate(fits.tolist())
        ]

    def _outwards(self, edge: Edge) -> tuple[Floats, Floats]:
        """Return the plane (V, 2) of an open edge, along it and out, and the ideal place.

        That is where a third vertex makes the triangle on its open side equilateral.
        """
        a, b = edge
        origin, tangents = self.values[a], self.parts[a].tangents[0]
        along = self.away(origin, slice(b, b + 1))[0] @ tangents
        length = float(np.linalg.norm(along))
        e = along / length
        out = np.array([-e[1], e[0]])
        third = self.open[edge]
        back = self.away(origin, slice(third, third + 1))[0] @ tangents
        if back @ out > 0.0:
            out = -out
        plane = tangents @ np.stack([e, out], axis=1)
        return plane, np.array([0.5 * length, HEIGHT * self.side])

    def _made(self, edge: Edge, queue: deque[Edge]) -> LocusPoints | None:
        """Return the new vertex for an edge, made with those for the next in the queue.

        They depend on nothing but their edges and the triangles on these.
        """
        if edge not in self.ready:
            ahead = (other for other in queue if self._wanted(other))
            edges = [edge, *islice(ahead, AHEAD - 1)]
            ways = []
            for other in edges:
                plane, ideal = self._outwards(other)
                ways.append(self.parts[other[0]].tangents[0].T @ plane @ ideal)
            made = self._beside([other[0] for other in edges], np.array(ways))
            self.ready |= dict(zip(edges, made, strict=True))
        return self.ready.pop(edge)

    def _wanted(self, edge: Edge) -> bool:
        """Return whether an edge gets a triangle, and no vertex was made for it."""
        if edge not in self.open or edge in self.ready:
            return False
        return self.inside[edge[0]] or self.inside[edge[1]]

    def _advance(self, edge: Edge, queue: deque[Edge], number: int) -> None:
        """Put a triangle on the open side of an edge, if one can be."""
        a, b = edge
        plane, ideal = self._outwards(edge)
        origin, length = self.values[a], 2.0 * float(ideal[0])
        middle = origin + plane @ ideal
        around = self.near(middle, self.motions[a], 2.5 * self.side)
        flat = self.away(origin, around) @ plane
        place = dict(zip(around.tolist(), flat, strict=True))
        place[a], place[b] = np.zeros(2), np.array([length, 0.0])
        walls = [wall for wall in self.open if wall[0] in place and wall[1] in place]
        edges = {vertex for wall in walls for vertex in wall} - {a, b}
        ranked = sorted(
            (float(np.linalg.norm(place[vertex] - ideal)), vertex) for vertex in edges
        )
        for distance, vertex in ranked:
            if distance < MERGED * self.side and self._fits(edge, vertex, place, walls):
                self._join(a, b, vertex, queue)
                return
        made = self._made(edge, queue)
        if made is not None:
            away = self.away(made.values[0], around)
            crowded = np.min(np.linalg.norm(away, axis=1), initial=np.inf)
            if crowded > CROWDED * self.side:
                place[-1] = ideal
                if self._fits(edge, -1, place, walls):
                    self._join(a, b, self._add(made, number), queue)
                    return
        for distance, vertex in ranked:
            if distance < STRETCHED * self.side and self._fits(edge, vertex, place, walls):
                self._join(a, b, vertex, queue)
                return

    def _fits(
        self, edge: Edge, vertex: int, place: dict[int, Floats], walls: list[Edge]
    ) -> bool:
        """Return whether the triangle overlaps nothing, in the tangent plane."""
        a, b = edge
        top = place[vertex]
        if top[1] < LOWEST * self.side:
            return False
        for end in edge:
            side = (min(end, vertex), max(end, vertex))
            if side in self.closed:
                return False
            if np.linalg.norm(top - place[end]) > STRETCHED * self.side:
                return False
            for wall in walls:
                if {end, vertex} & set(wall):
                    continue
                if _cross(place[end], top, place[wall[0]], place[wall[1]]):
                    return False
        ends = {vertex for wall in walls for vertex in wall} - {a, b, vertex}
        return not any(_within(place[k], place[a], place[b], top) for k in ends)


def _turn(a: Floats, b: Floats, c: Floats) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _cross(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    """Return whether two segments of a plane cross."""
    one = _turn(a, b, c) * _turn(a, b, d) < 0.0
    return one and _turn(c, d, a) * _turn(c, d, b) < 0.0


def _within(point: Floats, a: Floats, b: Floats, c: Floats) -> bool:
    """Return whether a point lies in a triangle of a plane."""
    signs = [_turn(a, b, point), _turn(b, c, point), _turn(c, a, point)]
    return min(signs) > 0.0 or max(signs) < 0.0
