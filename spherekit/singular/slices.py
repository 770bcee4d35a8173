"""Slices of a mechanism with two freedoms: one input locked, the other free to run.

A slice is the set of configurations with a locked input at one value: curves, each
followed in its own arc length through dead points of the free input.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np

from spherekit.conventions import Status
from spherekit.errors import CountError, SolveError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.branches import Branch, Solver
from spherekit.motion.locked import Locked, lock
from spherekit.motion.modes import assemblies
from spherekit.planning.assembly import plan_assembly
from spherekit.sphere.rotation import Floats

PROBED = 181
"""Values of the free input, over one turn, at which modes of dyads are looked for."""
PROBES = 7
"""The same for mechanisms with irreducible groups."""
LONGEST = 200.0


@final
@dataclass(frozen=True)
class Slice:
    """One curve of configurations with an input's variable locked.

    `variable` and `value` (rad) say which and where; `locked` leads back to all variables.
    """

    variable: int
    value: float
    locked: Locked
    curve: ArcCurve


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


def configurations(solver: Solver, q: Floats) -> Floats:
    """Return the closed configurations (n, V) of all modes at inputs q (k, inputs)."""
    found: list[Floats] = []
    if solver.assembly.has_closed_form:
        for signs in product((1, -1), repeat=len(solver.assembly.groups)):
            here = solver.evaluate(Branch(0, signs), q)
            found.append(here.values[here.status == Status.OK])
    else:
        found += [
            np.array([values for _, values in assemblies(solver, row).modes]).reshape(
                -1, len(solver.mechanism.variable_owners)
            )
            for row in q
        ]
    return np.concatenate(found)


def slices(
    solver: Solver, number: int, values: Floats, probes: int | None = None
) -> Iterator[Slice]:
    """Yield all curves found with an input locked at each of some values (m,) rad.

    Parameters
    ----------
    solver
        A mechanism with two inputs.
    number
        Position of the locked input in `solver.driven`.
    probes
        Values of the free input, over one turn, at which modes are looked for: a curve
        that meets none of them is missed.
    """
    if probes is None:
        probes = PROBED if solver.assembly.has_closed_form else PROBES
    free = (np.arange(probes) + 0.5) * (2.0 * np.pi / probes) - np.pi
    for value in values:
        q = np.empty((probes, 2))
        q[:, number], q[:, 1 - number] = value, free
        variable = solver.driven[number]
        locked = lock(solver.closure, {variable: float(value)})
        todo = configurations(solver, q)[:, list(locked.kept)]
        while len(todo):
            given, todo = todo[0], todo[1:]
            try:
                curve = follow_arc(locked.closure, given, longest=LONGEST)
            except SolveError:
                continue
            yield Slice(variable, float(value), locked, curve)
            todo = todo[np.isnan(curve.find(todo))]
