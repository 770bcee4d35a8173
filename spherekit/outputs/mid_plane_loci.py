"""Singular mid-planes: the loci of a mechanism in its mid-plane architecture, mode by mode.

The unit normal n of the mid-plane is the whole pose, and a mode says the rest. The output
rests while an input moves where a driven leg is at the limit of its reach, |n . b| = sin a
with the base axis b and the arcs a of the leg: circles of n. With the inputs locked as many
velocity equations as unknowns are left. Their determinant is a smooth function of n in each
mode, which changes its sign where the output moves with the inputs at rest: also where the
loops lose their rank, beside which the regular equations of `spherekit.singularities.locus`
do not hold.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product

import numpy as np

from spherekit.arrays import Floats, Indices, Integers
from spherekit.completeness import Completeness, Guarantee, TimeLimit
from spherekit.errors import ModelError
from spherekit.geometry.sphere_mesh import hemisphere, list_edges
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import all_finite, cross, nans, unit_rows
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.numerics.connectivity import order_chains
from spherekit.outputs.mid_plane_architecture import MidPlaneArchitecture
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.singularities.singular_curves import CurveSeen, SingularCurves
from spherekit.singularities.singularity_report import LocusName, SingularityReport
from spherekit.singularities.slices import solver_of
from spherekit.singularities.stationarity import output_of
from spherekit.tolerances import CLOSURE_TOLERANCE

SIDE = float(np.radians(4.0))
"""Longest side (rad) of the triangles."""
ALONG = 1e-6
"""Elbows with a smaller sine lie along one line."""


def mid_plane_loci(
    mechanism: Mechanism,
    kind: LocusName,
    output: str | None = None,
    budget: TimeLimit | None = None,
) -> SingularCurves | None:
    """Return the singular curves of a type, of the mid-plane architecture of a mechanism.

    None if it has none. Mid-planes are taken once, n_z >= 0 in mirror axes, and carriers
    on one side: those turned over have the same inputs and poses.
    """
    try:
        form = mid_plane_form(mechanism, output)
    except ModelError:
        return None
    budget = budget or TimeLimit()
    modes = _Modes(form, mechanism, kind, output)
    curves = list(modes.borders() if kind == "I" else modes.contours(budget))
    none = np.zeros((0, len(mechanism.variable_owners)))
    beyond = "configurations in which the output is not a mirror image of the base"
    if kind == "I":
        words = f"borders of the reach of driven legs in closed form, without {beyond}"
        claim = Completeness(Guarantee.COMPONENT, words)
    elif budget.note:
        claim = Completeness(Guarantee.SAMPLED, budget.note)
    else:
        words = f"changes of sign over the mid-planes of every mode, without {beyond}"
        claim = Completeness(Guarantee.TO_BOX, words, SIDE)
    return SingularCurves(kind, tuple(curves), claim, none)


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
        self.view = SingularityReport(solver, output_of(mechanism, output), kind)
        self.locus = self.view.locus
        self.passive = [
            v for v in range(len(mechanism.variable_owners)) if v not in solver.driven
        ]

    def borders(self) -> Iterator[CurveSeen]:
        """Yield the circles on which a driven leg is at its limit, where others reach."""
        for leg in self.form.plane.driven:
            why = f"leg of {self.form.name_of(leg)} at the limit of its reach"
            for signs in product((1, -1), repeat=len(self.form.legs) - 1):
                modes = np.insert(np.array(signs), leg, 1)
                margins, axis = partial(self._margins, leg), self.form.plane.axes[leg]
                yield from self._zeros(margins, modes, why, (axis, -axis))

    def contours(self, budget: TimeLimit) -> Iterator[CurveSeen]:
        """Yield the lines on which the determinant of the locked mechanism changes sign."""
        for signs in product((1, -1), repeat=len(self.form.legs)):
            if not budget.goes_on(f"mode {signs}"):
                return
            modes = np.array(signs)
            yield from self._zeros(partial(self._determinants, modes), modes)

    def _zeros(
        self,
        function: Callable[[Floats], Floats],
        modes: Integers,
        why: str = "",
        centres: Sequence[Floats] = (),
    ) -> Iterator[CurveSeen]:
        """Yield the lines on which a function of normals changes its sign in a mode.

        Around `centres` (3,) however short they are.
        """
        nodes, triangles = hemisphere(SIDE)
        nodes = nodes.copy()
        for centre in centres:
            nodes[np.argmax(nodes @ centre)] = centre
        edges, sides = list_edges(triangles)
        values = function(nodes)[edges]
        changes = all_finite(values, 1) & (values[:, 0] * values[:, 1] < 0.0)
        low, high = nodes[edges[changes]].swapaxes(0, 1)

        def between(part: Floats, rows: Indices) -> Floats:
            return unit_rows(low[rows] + part[:, None] * (high - low)[rows])

        part, _ = find_bracketed_zeros(
            lambda x, rows: function(between(x, rows)),
            np.zeros(len(low)),
            np.ones(len(low)),
            *values[changes].T,
        )
        roots = between(part, np.arange(len(low)))
        number = np.where(changes, np.cumsum(changes) - 1, -1)
        ends = np.sort(number[sides], axis=1)
        links = ends[np.sum(ends >= 0, axis=1) == 2, 1:]
        for line in order_chains(len(low), links):
            closed = bool(np.count_nonzero(links == line[0]) == 2 < len(line))
            normals = roots[np.append(line, line[:1]) if closed else line]
            yield self._curve(normals, modes, closed, why or self._why(normals, modes))

    def _margins(self, leg: int, normals: Floats) -> Floats:
        """Return how far (n,) a leg is inside its reach, NaN where another one is not."""
        _, _, left = self.form.plane.nearest_elbows(normals)
        reached = np.all(np.delete(left, leg, axis=1) >= 0.0, axis=1)
        return np.where(reached, left[:, leg], np.nan)

    def _why(self, normals: Floats, modes: Integers) -> str:
        """Return why inputs at rest allow a motion at the mid-planes of one line."""
        first, second = self.form.plane.driven
        elbows, _ = self.form.plane.elbows(normals, modes)
        apart = np.linalg.norm(cross(elbows[:, first], elbows[:, second]), axis=1)
        if np.nanmedian(apart) < ALONG:
            names = " and ".join(self.form.mechanism.input_pairs)
            return f"elbows of the legs of {names} along one line"
        return "the loops lose rank"

    def _determinants(self, modes: Integers, normals: Floats) -> Floats:
        """Return (n,) the determinant of the locked mechanism, NaN out of reach."""
        values, _ = self.form.values(self.form.place(normals, modes))
        determinants = nans(len(normals))
        rows = np.flatnonzero(all_finite(values, 1))
        jacobian = self.locus.closure.at(values[rows]).jacobian
        determinants[rows] = np.linalg.det(jacobian[:, :, self.passive])
        return determinants

    def _curve(self, normals: Floats, modes: Integers, closed: bool, why: str) -> CurveSeen:
        """Return a curve; points that do not close, at a limit, are left out.

        The residual is the least singular value of the loops' velocity equations together
        with those of what stands still, or the gap of the loops.
        """
        values, _ = self.form.values(self.form.place(normals, modes))
        linearisation = self.locus.tangent_space(values).linearisation
        constraint = self.locus.constraint.equations(linearisation)
        stacked = np.hstack([linearisation.jacobian, constraint])
        _, sizes, right = np.linalg.svd(np.nan_to_num(stacked))
        residual = np.maximum(np.nan_to_num(linearisation.gap, nan=np.inf), sizes[:, -1])
        points = self.view.describe(values, right[:, -1], residual)
        closes = residual < CLOSURE_TOLERANCE
        kept = np.flatnonzero(closes & self.view.has_type(points.type))
        s = np.append(0.0, np.cumsum(arc(normals[1:], normals[:-1])))
        whole = closed and len(kept) == len(normals)
        none, signs = points.rows(slice(0)), tuple(modes.tolist())
        return CurveSeen(points.rows(kept), none, s[kept], whole, why, signs)
