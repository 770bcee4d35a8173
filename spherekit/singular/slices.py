"""Slices of a mechanism with several freedoms: all inputs but one locked.

A slice is the set of configurations with those inputs at given values: curves, each
followed in its own arc length through dead points of the free input.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.budget import Budget
from spherekit.conventions import Status, counted
from spherekit.errors import CountError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arcs
from spherekit.motion.assemblies import assemblies
from spherekit.motion.assembly_modes import AssemblyMode, Solver
from spherekit.motion.closure import Locked, lock
from spherekit.motion.segments import CurvePoints
from spherekit.planning.assembly import plan_assembly
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.sphere.rotation import Floats

PROBED = 181
"""Values of the free input, over one turn, at which modes of dyads are looked for."""
PROBES = 7
"""The same for mechanisms with irreducible groups."""
LONGEST = 200.0
TOGETHER = 12
"""Slices of dyads that are followed side by side."""


@final
@dataclass(frozen=True)
class Slice:
    """One curve of configurations with all inputs but one locked.

    `locked` leads back to all variables.
    """

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


def configurations(solver: Solver, q: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the closed configurations (n, V) of all modes at inputs q (k, inputs).

    With them the row (n,) of q that each belongs to.
    """
    variables = len(solver.mechanism.variable_owners)
    parts, rows = [np.zeros((0, variables))], [np.zeros(0, dtype=np.intp)]
    if solver.assembly.has_closed_form:
        for signs in product((1, -1), repeat=len(solver.assembly.groups)):
            here = solver.evaluate(AssemblyMode(0, signs), q)
            closed = np.flatnonzero(here.status == Status.OK)
            parts.append(here.values[closed])
            rows.append(closed)
    else:
        for row, wanted in enumerate(q):
            modes = assemblies(solver, wanted).modes
            parts += [values[None] for _, values in modes]
            rows.append(np.full(len(modes), row))
    return np.concatenate(parts), np.concatenate(rows)


def slices(
    solver: Solver,
    free: int,
    held: Floats,
    budget: Budget | None = None,
) -> Iterator[Slice]:
    """Yield all curves found with all inputs but one locked at some values.

    Modes are looked for at values of the free input over one turn: a curve that meets none
    of them is missed.

    Parameters
    ----------
    solver
        A mechanism with at least two inputs.
    free
        Position in `solver.driven` of the input that is not locked.
    held
        (m, inputs) values (rad) at which the others are locked; the free one's are not
        read.
    budget
        Time that the curves of all slices may take, unlimited by default.
    """
    budget = budget or Budget()
    many = TOGETHER if solver.assembly.has_closed_form else 1
    for first in range(0, len(held), many):
        if not budget.goes_on(f"slice {first + 1} of {len(held)}"):
            return
        yield from _together(solver, free, held[first : first + many], budget)


def _together(solver: Solver, free: int, held: Floats, budget: Budget) -> Iterator[Slice]:
    """Yield the curves of some slices, a curve of each followed side by side."""
    probes = PROBED if solver.assembly.has_closed_form else PROBES
    turn = (np.arange(probes) + 0.5) * (2.0 * np.pi / probes) - np.pi
    q = np.repeat(held, probes, axis=0)
    q[:, free] = np.tile(turn, len(held))
    starts, row = configurations(solver, q)
    others = [k for k in range(len(solver.driven)) if k != free]
    locked = [
        lock(solver.closure, {solver.driven[k]: float(values[k]) for k in others})
        for values in held
    ]
    kept = list(locked[0].kept)
    todo = {k: starts[row // probes == k][:, kept] for k in range(len(held))}
    while left := [k for k, values in todo.items() if len(values)]:
        if not budget.goes_on(f"curves of {counted(len(left), 'slice')}"):
            return
        closures = [locked[k].closure for k in left]
        first = np.stack([todo[k][0] for k in left])
        curves = follow_arcs(closures, first, longest=LONGEST)
        for k, curve in zip(left, curves, strict=True):
            todo[k] = todo[k][1:]
            if curve is not None:
                todo[k] = todo[k][~curve.passes(todo[k])]
                yield Slice(locked[k], curve)


@final
@dataclass(frozen=True)
class Cut:
    """The slices of a mechanism at some values of each input, in the order made.

    `gaps` (rad) are the distances of the values of each input; `note` says what was left
    out as time was spent, or is empty.
    """

    slices: tuple[Slice, ...]
    gaps: tuple[float, ...]
    note: str


def cut(
    solver: Solver,
    ranges: Sequence[tuple[float, float]],
    values_of_each: int,
    budget: Budget | None = None,
) -> Cut:
    """Return the slices with each input free, the others at values over their ranges.

    The values are taken in an order that is spread out wherever time is spent.
    """
    budget = budget or Budget()
    spread = [
        low + (high - low) * (np.arange(values_of_each) + 0.5) / values_of_each
        for low, high in ranges
    ]
    sections: list[Slice] = []
    notes = []
    count = len(ranges)
    for free in range(count):
        others = [k for k in range(count) if k != free]
        mesh = np.meshgrid(*(spread[k] for k in others), indexing="ij")
        held = np.zeros((mesh[0].size, count))
        held[:, others] = np.stack([axis.ravel() for axis in mesh], axis=1)
        held = held[_spread_out(len(held))]
        share = budget.part(1.0 / (count - free))
        sections += slices(solver, free, held, share)
        if share.note:
            notes.append(f"{share.note} with input {free + 1} free")
    gaps = tuple((high - low) / values_of_each for low, high in ranges)
    return Cut(tuple(sections), gaps, "; ".join(notes))


def _spread_out(count: int) -> NDArray[np.intp]:
    """Return numbers below `count` in an order whose every beginning is spread out."""
    digits = max(1, (count - 1).bit_length())
    order = sorted(range(count), key=lambda k: f"{k:0{digits}b}"[::-1])
    return np.array(order, dtype=np.intp)


def seeds(section: Slice, locus: Locus) -> LocusPoints:
    """Return the singular configurations on a slice."""

    def along(points: CurvePoints) -> tuple[Floats, Floats]:
        space = locus.space(section.locked.whole(points.values))
        measure = locus.measure(space)
        ways = (
            np.swapaxes(space.basis, 1, 2)
            @ section.locked.rates(points.tangents)[..., None]
        )
        return measure.value, np.sum(measure.gradient * ways[..., 0], axis=1)

    places = section.curve.locate(along).places
    locus_points = locus.onto(section.locked.whole(section.curve.at(places).values))
    return locus_points.rows(np.flatnonzero(locus_points.good))
