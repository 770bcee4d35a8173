"""Aspects: parts of the configuration manifold that no singular configuration divides.

Configurations over an input grid are joined where verified steps lead from one
to its neighbour: those never pass a configuration of type II. Joined configurations are
one aspect; the sign of a determinant tells others apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.completeness import TimeLimit
from spherekit.conventions import TURN
from spherekit.errors import AnalysisError
from spherekit.geometry.vectors import max_abs, nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.connectivity import label_components
from spherekit.positions import input_grid as grids
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.input_revolutions import less_periods
from spherekit.positions.path_continuation import follow_inputs
from spherekit.positions.position_solver import PositionSolver
from spherekit.singularities.several_inputs import LocusName
from spherekit.singularities.slices import SingularityLocus, configurations, solver_of
from spherekit.singularities.stationarity import InputsLocked, OutputStationary, output_of
from spherekit.status import Status

SINGULAR = 1e-8
"""Configurations with a smaller singular value are singular themselves."""
PROBES = 5
"""Samples along each axis at which modes of irreducible groups are looked for."""
SAME = 1e-6
"""Configurations whose variables differ by less (rad) are the same one."""
MOST_CONFIGURATIONS = 200_000


@dataclass(frozen=True)
class Aspects:
    """n configurations over an input grid, and the aspect of each.

    Attributes
    ----------
    input grid, row
        The samples, and the sample (n,) of each configuration.
    values, inputs
        The variables (n, V) and inputs (n, g), rad.
    label
        (n,) number of the aspect, the one with most configurations first.
    sizes
        (aspects,) numbers of configurations.
    sign_two, sign_one
        (aspects,) sign of the determinant of type II and of that of type I, 0 where it has
        none: the motions' sense is not fixed, or the output has more freedoms than there
        are inputs. Aspects free of type II only may hold both signs of type I: 0 too.
    modes
        (aspects,) greatest number of configurations at one sample. More than one: the
        mechanism changes its assembly mode within the aspect, without a singularity.
    free_of
        The types that divide aspects.
    singular
        Number of configurations met that are singular themselves, and so in no aspect.
    note
        What was not done as time was spent, or nothing.
    """

    input_grid: InputGrid
    row: Integers
    values: Floats
    inputs: Floats
    label: Integers
    sizes: Integers
    sign_two: SmallIntegers
    sign_one: SmallIntegers
    modes: Integers
    free_of: tuple[LocusName, ...]
    singular: int
    note: str

    @property
    def guarantee(self) -> str:
        """What the labels guarantee, in words."""
        return (
            "configurations of one aspect are joined by verified steps; two aspects of the "
            "same signs may be one that the samples do not join, and parts between the "
            "samples are not seen"
        ) + (f"; {self.note}" if self.note else "")


def aspects(
    mechanism: Mechanism,
    samples: int | Sequence[int] = 21,
    free_of: Sequence[LocusName] = ("II",),
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    budget: TimeLimit | None = None,
) -> Aspects:
    """Return the aspects of a mechanism with any number of inputs.

    Parameters
    ----------
    mechanism
        A mechanism with a freedom for each of its inputs.
    samples
        Number of values of each input.
    free_of
        Which types divide aspects: type II always does, type I if it is named.
    output, pointing
        Which output type I is about; see `spherekit.singularities.stationarity.output_of`.
    budget
        Time after which no more configurations are joined, unlimited by default.

    Raises
    ------
    AnalysisError
        If a type is unknown, or there is no such output, or it has fewer freedoms than
        there are inputs.
    PlanError
        If the mechanism has not one freedom for each input.
    """
    for kind in free_of:
        if kind not in ("I", "II"):
            raise AnalysisError(f'aspects are free of "I" and "II", not of "{kind}"')
    asked = mechanism.outputs or "I" in free_of
    rest = output_of(mechanism, output, pointing) if asked else None
    solver = solver_of(mechanism)
    count = len(solver.driven)
    if rest is not None and "I" in free_of and count > rest.count:
        raise AnalysisError(
            f"{mechanism.name}: the output has {rest.count} freedoms: {count} inputs can "
            "always move while it rests: no aspect is free of type I; leave that out"
        )
    counts = samples if isinstance(samples, Sequence) else [samples] * count
    input_grid = grids.make_grid(mechanism.inputs, counts)
    budget = budget or TimeLimit()
    spread = _Spread(solver, input_grid, rest, "I" in free_of, budget)
    if budget.goes_on("modes at samples of the input grid"):
        spread.add(*_starts(solver, input_grid))
    spread.run()
    return spread.labelled(("II", "I") if "I" in free_of else ("II",))


def _starts(solver: PositionSolver, input_grid: InputGrid) -> tuple[Floats, Indices]:
    """Return configurations (n, V) and their samples (n,): all of dyads, of groups some."""
    if solver.assembly.has_closed_form:
        rows = np.arange(len(input_grid))
    else:
        places = [
            np.unique(np.linspace(0, count - 1, min(PROBES, count)).astype(int))
            for count in input_grid.shape
        ]
        rows = np.ravel_multi_index(np.ix_(*places), input_grid.shape).ravel()
    values, which = configurations(solver, input_grid.q[rows])
    return values, rows[which]


@dataclass(frozen=True)
class _Nodes(ArrayRows):
    """n configurations at samples of an input grid, and the signs that part aspects.

    `row` (n,) is the sample, `regular` (n,) whether the configuration is singular of no
    type that divides; `two`, `one` (n,) the determinants of types II and I, 0 without a
    sign or an output, and `slope` (n, g) the derivatives of `one` by the inputs.
    """

    values: Floats
    row: Indices
    regular: Bools
    two: Floats
    one: Floats
    slope: Floats

    def __len__(self) -> int:
        return len(self.row)


class _Spread:
    """Configurations at the samples of an input grid, and which are joined.

    `at` (samples, k) has the numbers of a sample's configurations, -1 where there are no
    more; `done` (n, ways) says from which configuration a way to the sample beside it is
    known to lead, as it was gone from the other end.
    """

    def __init__(
        self,
        solver: PositionSolver,
        input_grid: InputGrid,
        output: OutputStationary | None,
        divides: bool,
        budget: TimeLimit,
    ) -> None:
        self.budget = budget
        self.solver, self.input_grid = solver, input_grid
        self.beside = input_grid.neighbours()
        self.driven = list(solver.driven)
        self.periods = variable_periods(solver.closure)
        self.output = output
        self.divides = divides
        self.signed = False
        self.nodes = self._judged(
            np.zeros((0, len(self.periods))), np.zeros(0, dtype=np.intp)
        )
        self.at = np.full((len(input_grid), 1), -1)
        self.done = np.zeros((0, len(self.beside)), dtype=bool)
        self.joined = [np.zeros((0, 2), dtype=np.intp)]

    def _judged(self, values: Floats, row: Indices) -> _Nodes:
        closure, count = self.solver.closure, len(self.driven)
        locus = SingularityLocus(closure, count, InputsLocked(self.solver.driven))
        space = locus.space(values)
        two = locus.measure(space)
        least = np.minimum(space.reciprocal_condition, two.smallest)
        signs = two.value if two.signed else np.zeros(len(values))
        one = np.zeros(len(values))
        slope = np.zeros((len(values), count))
        if self.output is not None:
            measure = SingularityLocus(closure, count, self.output).measure(space)
            self.signed = measure.signed
            one = measure.value
            if self.divides:
                least = np.minimum(least, measure.smallest)
                inverse = nans(slope.shape + (count,))
                good = least > SINGULAR
                inverse[good] = np.linalg.inv(space.basis[good][:, self.driven])
                slope = np.vecmat(measure.gradient, inverse)
        return _Nodes(values, row, least > SINGULAR, signs, one, slope)

    def add(self, values: Floats, row: Indices) -> Indices:
        """Return the numbers (n,) of configurations (n, V) at samples, new or known."""
        numbers = np.full(len(values), -1)
        left = np.arange(len(values))
        column = 0
        while len(left):
            if column == self.at.shape[1]:
                self.at = np.pad(self.at, ((0, 0), (0, 1)), constant_values=-1)
            free = left[self.at[row[left], column] < 0]
            samples, first = np.unique(row[free], return_index=True)
            new = free[first]
            self.at[samples, column] = len(self.nodes) + np.arange(len(new))
            self.nodes = _Nodes.joined([self.nodes, self._judged(values[new], samples)])
            there = self.at[row[left], column]
            away = less_periods(values[left] - self.nodes.values[there], self.periods)
            same = max_abs(away, axis=1) < SAME
            numbers[left[same]] = there[same]
            left = left[~same]
            column += 1
        self.done = np.pad(self.done, ((0, len(self.nodes) - len(self.done)), (0, 0)))
        return numbers

    def run(self) -> None:
        """Join every configuration to those that straight ways lead to."""
        walked = 0
        while walked < len(self.nodes) < MOST_CONFIGURATIONS:
            if not self.budget.goes_on(f"configuration {walked + 1} of aspects"):
                return
            new = walked + np.flatnonzero(self.nodes.regular[walked:])
            walked = len(self.nodes)
            for sense in (0, 1):
                start, way = np.nonzero(~self.done[new, sense::2])
                self._walk(new[start], 2 * way + sense)

    def _walk(self, start: Indices, way: Indices) -> None:
        """Go from configurations (n,) to the samples beside them; join what is there."""
        stop = self.beside[way, self.nodes.row[start]]
        start, way, stop = (part[stop >= 0] for part in (start, way, stop))
        values = self.nodes.values[start]
        goal = self.input_grid.q[stop]
        goal += TURN * np.round((values[:, self.driven] - goal) / TURN)
        reached, status, _ = follow_inputs(self.solver.closure, self.driven, values, goal)
        good = status == Status.OK
        there = self.add(reached.values[good], stop[good])
        # From there the same way leads back: ways are in pairs, there and back.
        self.done[there, way[good] ^ 1] = True
        ends = np.stack([start[good], there], axis=1)
        clear = np.all(self.nodes.regular[ends], axis=1)
        if self.divides:  # nothing singular that divides is between, by cubics
            moved = (reached.values - values)[good][:, self.driven]
            slope = np.matvec(self.nodes.slope[ends], moved)
            value = self.nodes.one[ends]
            signs = np.sign(np.append(value, value + slope * [1.0, -1.0] / 3.0, axis=1))
            clear &= (signs[:, 0] != 0.0) & np.all(signs == signs[:, :1], axis=1)
        self.joined.append(ends[clear])

    def labelled(self, free_of: tuple[LocusName, ...]) -> Aspects:
        """Return the regular configurations with their aspects."""
        kept = np.flatnonzero(self.nodes.regular)
        nodes = self.nodes.rows(kept)
        label = label_components(
            len(kept), np.searchsorted(kept, np.concatenate(self.joined))
        )
        sizes = np.bincount(label)
        order = np.argsort(-sizes, kind="stable")
        label, sizes = np.argsort(order)[label], sizes[order]
        modes = np.zeros(len(sizes), dtype=np.int64)
        pairs, often = np.unique(np.stack([label, nodes.row]), axis=1, return_counts=True)
        np.maximum.at(modes, pairs[0], often)
        return Aspects(
            self.input_grid,
            nodes.row,
            nodes.values,
            nodes.values[:, self.driven],
            label,
            sizes,
            _signs(nodes.two, label, sizes),
            _signs(nodes.one * self.signed, label, sizes),
            modes,
            free_of,
            len(self.nodes) - len(kept),
            self.budget.note,
        )


def _signs(value: Floats, label: Integers, sizes: Integers) -> SmallIntegers:
    """Return the sign that all configurations of each aspect have, or 0."""
    total = np.bincount(label, np.sign(value), len(sizes))
    return np.where(np.abs(total) == sizes, np.sign(total), 0.0).astype(np.int8)
