"""Slices of a mechanism with several freedoms: all inputs but one locked.

A slice is the set of configurations with those inputs at given values: curves, each
followed in its own arc length through dead points of the free input.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.errors import CountError, SolveError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.branches import Branch, Solver
from spherekit.motion.locked import Locked, lock
from spherekit.motion.modes import assemblies
from spherekit.motion.segments import CurvePoints
from spherekit.planning.assembly import plan_assembly
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.sphere.rotation import Floats

PROBED = 181
"""Values of the free input, over one turn, at which modes of dyads are looked for."""
PROBES = 7
"""The same for mechanisms with irreducible groups."""
LONGEST = 200.0


@final
@dataclass(frozen=True)
class Slice:
    """One curve of configurations with all inputs but one locked.

    `locked` leads back to all variables.
    """

    locked: Locked
    curve: ArcCurve

    @property
    def crossings(self) -> Floats:
        """Configurations (n, V) beside the crossings of curves that the curve ends in."""
        ends = [
            end
            for end, why in zip((0, -1), self.curve.ends, strict=True)
            if why == Status.AT_SINGULARITY
        ]
        return self.locked.whole(self.curve.nodes.values[ends])


def solver_of(mechanism: Mechanism) -> Solver:
    """Return the solver of a mechanism, its modes not looked for.

    Raises
    ------
    PlanError
        If the mechanism has not one freedom for each input.
    """
    try:
        return Solver(mechanism, plan_assembly(mechanism))
    except CountError:
        return Solver(mechanism, plan_assembly(mechanism, by_rank=True))


def configurations(solver: Solver, q: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the closed configurations (n, V) of all modes at inputs q (k, inputs).

    With them the row (n,) of q that each belongs to.
    """
    variables = len(solver.mechanism.variable_owners)
    found, rows = [np.zeros((0, variables))], [np.zeros(0, dtype=np.intp)]
    if solver.assembly.has_closed_form:
        for signs in product((1, -1), repeat=len(solver.assembly.groups)):
            here = solver.evaluate(Branch(0, signs), q)
            closed = np.flatnonzero(here.status == Status.OK)
            found.append(here.values[closed])
            rows.append(closed)
    else:
        for row, wanted in enumerate(q):
            modes = assemblies(solver, wanted).modes
            found += [values[None] for _, values in modes]
            rows.append(np.full(len(modes), row))
    return np.concatenate(found), np.concatenate(rows)


def slices(
    solver: Solver, free: int, held: Floats, probes: int | None = None
) -> Iterator[Slice]:
    """Yield all curves found with all inputs but one locked at some values.

    Parameters
    ----------
    solver
        A mechanism with at least two inputs.
    free
        Position in `solver.driven` of the input that is not locked.
    held
        (m, inputs) values (rad) at which the others are locked; the free one's are not
        read.
    probes
        Values of the free input, over one turn, at which modes are looked for: a curve
        that meets none of them is missed.
    """
    if probes is None:
        probes = PROBED if solver.assembly.has_closed_form else PROBES
    turn = (np.arange(probes) + 0.5) * (2.0 * np.pi / probes) - np.pi
    for row in held:
        q = np.tile(row, (probes, 1))
        q[:, free] = turn
        fixed = {
            variable: float(value)
            for k, (variable, value) in enumerate(zip(solver.driven, row, strict=True))
            if k != free
        }
        locked = lock(solver.closure, fixed)
        found, _ = configurations(solver, q)
        todo = found[:, list(locked.kept)]
        while len(todo):
            given, todo = todo[0], todo[1:]
            try:
                curve = follow_arc(locked.closure, given, longest=LONGEST)
            except SolveError:
                continue
            yield Slice(locked, curve)
            todo = todo[np.isnan(curve.find(todo))]


def seeds(each: Slice, locus: Locus) -> LocusPoints:
    """Return the singular configurations on a slice."""

    def along(points: CurvePoints) -> tuple[Floats, Floats]:
        space = locus.space(each.locked.whole(points.values))
        measure = locus.measure(space)
        ways = (
            np.swapaxes(space.basis, 1, 2) @ each.locked.rates(points.tangents)[..., None]
        )
        return measure.value, np.sum(measure.gradient * ways[..., 0], axis=1)

    places = each.curve.locate(along).places
    found = locus.onto(each.locked.whole(each.curve.at(places).values))
    return found.rows(np.flatnonzero(found.good))
