"""Singular mid-planes: the loci of a mechanism in its mid-plane architecture, mode by mode.

The unit normal n of the mid-plane is the whole pose, and a mode says the rest. The output
rests while an input moves where a driven leg is at the limit of its reach, |n . b| = sin a
with the base axis b and the arcs a of the leg: circles of n. With the inputs locked as many
velocity equations as unknowns are left. Their determinant is a smooth function of n in each
mode, which changes its sign where the output moves with the inputs at rest: also where the
loops lose their rank, beside which the regular equations of `spherekit.singular.locus` do
not hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.budget import Budget
from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.errors import ModelError
from spherekit.guarantee import Claim, Guarantee
from spherekit.guidance.mid_plane_architecture import MidPlaneArchitecture
from spherekit.guidance.symmetry import mid_plane_form
from spherekit.model.mechanism import Mechanism
from spherekit.numeric.brackets import bracketed_zeros
from spherekit.region.mesh import edges_of, hemisphere
from spherekit.singular.curves import SingularCurves
from spherekit.singular.points import LocusName, SingularPoints, View
from spherekit.singular.slices import solver_of
from spherekit.singular.stationarity import output_of
from spherekit.sphere.rotation import Floats, cross, perpendicular

SIDE = float(np.radians(4.0))
"""Longest side (rad) of the triangles, and the distance of points on circles."""
ALONG = 1e-6
"""Elbows with a smaller sine lie along one line."""


@final
@dataclass(frozen=True)
class MidPlaneCurve:
    """Singular mid-planes in order, in one mode of the legs.

    `s` (n,) is the length of their way on the sphere of normals (rad). What is of both
    types is not singled out. `why` says in words what is singular.
    """

    points: SingularPoints
    modes: tuple[int, ...]
    s: Floats
    closed: bool
    why: str

    @property
    def both(self) -> SingularPoints:
        """No points."""
        return self.points.rows(np.zeros(0, dtype=np.intp))

    def dense(self, parts: int) -> SingularPoints:
        """Return the points, which are dense already."""
        del parts
        return self.points


def mid_plane_loci(
    mechanism: Mechanism,
    kind: LocusName,
    output: str | None = None,
    budget: Budget | None = None,
) -> SingularCurves | None:
    """Return the singular curves of a type, of the mid-plane architecture of a mechanism.

    None if it has none. Mid-planes are taken once, n_z >= 0 in mirror axes, and carriers
    on one side: those turned over have the same inputs and poses.
    """
    try:
        form = mid_plane_form(mechanism, output)
    except ModelError:
        return None
    budget = budget or Budget()
    modes = _Modes(form, mechanism, kind, output)
    curves = list(modes.borders() if kind == "I" else modes.contours(budget))
    none = np.zeros((0, len(mechanism.variable_owners)))
    beyond = "configurations in which the output is not a mirror image of the base"
    if kind == "I":
        words = f"borders of the reach of driven legs in closed form, without {beyond}"
        claim = Claim(Guarantee.COMPONENT, words)
    elif budget.note:
        claim = Claim(Guarantee.SAMPLED, budget.note)
    else:
        words = f"changes of sign over the mid-planes of every mode, without {beyond}"
        claim = Claim(Guarantee.TO_BOX, words, SIDE)
    return SingularCurves(kind, tuple(curves), claim, none)


@final
class _Modes:
    """Puts the mechanism at mid-planes, mode by mode."""

    def __init__(
        self,
        form: MidPlaneArchitecture,
        mechanism: Mechanism,
        kind: LocusName,
        output: str | None,
    ) -> None:
        self.form = form
        solver = solver_of(mechanism)
        rest = output_of(mechanism, output)
        self.view = View(solver, rest, kind)
        self.locus = self.view.locus
        self.passive = [
            v for v in range(len(mechanism.variable_owners)) if v not in solver.driven
        ]

    def borders(self) -> Iterator[MidPlaneCurve]:
        """Yield the circles on which a driven leg is at its limit, where others reach."""
        plane = self.form.plane
        count = round(2.0 * np.pi / SIDE)
        angle = np.arange(count + 1) * (2.0 * np.pi / count)
        for leg, sense in product(plane.driven, (1.0, -1.0)):
            axis, height = plane.axes[leg], sense * np.sin(plane.arcs[leg])
            side = perpendicular(axis)
            flat = np.outer(np.cos(angle), side)
            flat += np.outer(np.sin(angle), cross(axis, side))
            normals = height * axis + np.sqrt(1.0 - height**2) * flat
            others = [k for k in range(len(plane.axes)) if k != leg]
            for signs in product((1, -1), repeat=len(others)):
                modes = np.ones(len(plane.axes), dtype=np.int64)
                modes[others] = signs
                reached = np.isfinite(plane.elbows(normals, modes)[0]).all(axis=(1, 2))
                reached &= normals[:, 2] >= 0.0
                why = f"leg of {self._name(leg)} at the limit of its reach"
                for rows, closed in _runs(reached):
                    yield self._curve(normals[rows], modes, closed, why)

    def contours(self, budget: Budget) -> Iterator[MidPlaneCurve]:
        """Yield the lines on which the determinant of the locked mechanism changes sign."""
        nodes, triangles = hemisphere(SIDE)
        edges, sides = edges_of(triangles)
        for signs in product((1, -1), repeat=len(self.form.legs)):
            if not budget.goes_on(f"mode {signs}"):
                return
            modes = np.array(signs)
            values = self._determinants(nodes, modes)
            finite = np.all(np.isfinite(values[edges]), axis=1)
            changes = finite & (values[edges[:, 0]] * values[edges[:, 1]] < 0.0)
            cut = edges[changes]
            roots = self._roots(nodes[cut[:, 0]], nodes[cut[:, 1]], modes)
            number = np.where(changes, np.cumsum(changes) - 1, -1)
            for line, closed in _lines(number[sides], len(cut)):
                why = self._why(roots[line], modes)
                yield self._curve(roots[line], modes, closed, why)

    def _name(self, leg: int) -> str:
        return self.form.mechanism.pairs[self.form.legs[leg].base].name

    def _why(self, normals: Floats, modes: NDArray[np.int64]) -> str:
        """Return why inputs at rest allow a motion at the mid-planes of one line."""
        first, second = self.form.plane.driven
        elbows, _ = self.form.plane.elbows(normals, modes)
        apart = np.linalg.norm(cross(elbows[:, first], elbows[:, second]), axis=1)
        if np.nanmedian(apart) < ALONG:
            names = f"{self._name(first)} and {self._name(second)}"
            return f"elbows of the legs of {names} along one line"
        return "the loops lose rank"

    def _roots(self, low: Floats, high: Floats, modes: NDArray[np.int64]) -> Floats:
        """Return where the determinant vanishes between normals (n, 3)."""

        def between(part: Floats, rows: NDArray[np.intp]) -> Floats:
            normals = low[rows] + part[:, None] * (high - low)[rows]
            return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

        every = np.arange(len(low))
        part, _ = bracketed_zeros(
            lambda x, rows: self._determinants(between(x, rows), modes),
            np.zeros(len(low)),
            np.ones(len(low)),
            self._determinants(low, modes),
            self._determinants(high, modes),
        )
        return between(part, every)

    def _values(self, normals: Floats, modes: NDArray[np.int64]) -> Floats:
        values, _ = self.form.values(self.form.place(normals, modes))
        return np.where(np.all(np.isfinite(values), axis=1)[:, None], values, np.nan)

    def _determinants(self, normals: Floats, modes: NDArray[np.int64]) -> Floats:
        """Return (n,) the determinant of the locked mechanism, NaN out of reach."""
        values = self._values(normals, modes)
        determinants = np.full(len(normals), np.nan)
        rows = np.flatnonzero(np.isfinite(values[:, 0]))
        jacobian = self.locus.closure.at(values[rows]).jacobian
        determinants[rows] = np.linalg.det(jacobian[:, :, self.passive])
        return determinants

    def _curve(
        self, normals: Floats, modes: NDArray[np.int64], closed: bool, why: str
    ) -> MidPlaneCurve:
        """Return a curve; points that do not close, at a limit, are left out.

        The residual is the least singular value of the loops' velocity equations together
        with those of what stands still, or the gap of the loops.
        """
        values = self._values(normals, modes)
        space = self.locus.space(values)
        rows = self.locus.rest.equations(space.at)
        jacobian = space.at.jacobian
        stacked = np.nan_to_num(np.concatenate([jacobian, rows], axis=1))
        _, sizes, right = np.linalg.svd(stacked)
        residual = np.maximum(np.nan_to_num(space.at.gap, nan=np.inf), sizes[:, -1])
        points = self.view.seen(values, right[:, -1], residual)
        of_type = self.view.is_own(points.type)
        kept = np.flatnonzero((residual < CLOSURE_TOLERANCE) & of_type)
        ways = np.arccos(np.clip(np.sum(normals[1:] * normals[:-1], axis=1), -1.0, 1.0))
        s = np.concatenate([[0.0], np.cumsum(ways)])
        whole = closed and len(kept) == len(normals)
        return MidPlaneCurve(points.rows(kept), tuple(modes.tolist()), s[kept], whole, why)


def _lines(sides: NDArray[np.intp], count: int) -> Iterator[tuple[list[int], bool]]:
    """Yield the numbers of the roots in order along each line, and whether it closes.

    `sides` (triangles, 3) has the number of the root on each side, -1 for none, of `count`.
    """
    beside: dict[int, list[int]] = {k: [] for k in range(count)}
    for triangle in sides.tolist():
        ends = [k for k in triangle if k >= 0]
        if len(ends) == 2:
            beside[ends[0]].append(ends[1])
            beside[ends[1]].append(ends[0])
    left = set(beside)
    for start in sorted(left, key=lambda k: len(beside[k])):
        if start not in left:
            continue
        line = [start]
        left.discard(start)
        while ahead := [k for k in beside[line[-1]] if k in left]:
            line.append(ahead[0])
            left.discard(ahead[0])
        closed = len(line) > 2 and start in beside[line[-1]]
        yield [*line, start] if closed else line, closed


def _runs(wanted: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.intp], bool]]:
    """Yield the rows of each part of a closed line that is wanted, and if it closes."""
    if np.all(wanted):
        yield np.arange(len(wanted)), True
        return
    n = len(wanted) - 1
    order = (np.arange(n) + np.argmin(wanted[:-1])) % n  # the first is none of them
    for rows in np.split(order, np.flatnonzero(np.diff(wanted[order])) + 1):
        if wanted[rows[0]]:
            yield rows, False
