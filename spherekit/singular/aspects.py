"""Aspects: parts of the configuration manifold that no singular configuration divides.

Configurations over an input grid are joined where verified steps lead from one
to its neighbour: those never pass a configuration of type II. Joined configurations are
one aspect; the sign of a determinant tells others apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.budget import Budget
from spherekit.conventions import Status
from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Mechanism
from spherekit.motion import input_grid as grids
from spherekit.motion.arc_length import periods_of
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.input_grid import InputGrid
from spherekit.motion.steps import walk
from spherekit.motion.turns import less_periods
from spherekit.region.mesh import labels
from spherekit.singular.locus import Locus, Measure
from spherekit.singular.points import TypeName
from spherekit.singular.slices import configurations, solver_of
from spherekit.singular.stationarity import InputsLocked, OutputStationary, output_of
from spherekit.sphere.rotation import Floats

SINGULAR = 1e-8
"""Configurations with a smaller singular value are singular themselves."""
PROBES = 5
"""Samples along each axis at which modes of irreducible groups are looked for."""
SAME = 1e-6
"""Configurations whose variables differ by less (rad) are the same one."""
MOST_CONFIGURATIONS = 200_000


@final
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
    row: NDArray[np.int64]
    values: Floats
    inputs: Floats
    label: NDArray[np.int64]
    sizes: NDArray[np.int64]
    sign_two: NDArray[np.int8]
    sign_one: NDArray[np.int8]
    modes: NDArray[np.int64]
    free_of: tuple[TypeName, ...]
    singular: int
    note: str

    @property
    def guarantee(self) -> str:
        """What the labels guarantee, in words."""
        words = (
            "configurations of one aspect are joined by verified steps; two aspects of the "
            "same signs may be one that the samples do not join, and parts between the "
            "samples are not seen"
        )
        return "; ".join(filter(None, [words, self.note]))


def aspects(
    mechanism: Mechanism,
    samples: int | Sequence[int] = 21,
    free_of: Sequence[TypeName] = ("II",),
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    whole_turn: bool = False,
    budget: Budget | None = None,
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
        Which output type I is about; see `spherekit.singular.stationarity.output_of`.
    whole_turn
        Whether every input runs through one turn, its ends joined, and not through its
        declared range.
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
    unknown = [kind for kind in free_of if kind not in ("I", "II")]
    if unknown:
        raise AnalysisError(f'aspects are free of "I" and "II", not of "{unknown[0]}"')
    rest = output_of(mechanism, output, pointing) if mechanism.outputs else None
    if rest is None and "I" in free_of:
        rest = output_of(mechanism, output, pointing)
    solver = solver_of(mechanism)
    count = len(solver.driven)
    if rest is not None and "I" in free_of and count > rest.count:
        raise AnalysisError(
            f"{mechanism.name}: the output has {rest.count} freedoms: {count} inputs can "
            "always move while it rests: no aspect is free of type I; leave that out"
        )
    counts = list(samples) if isinstance(samples, Sequence) else [samples] * count
    input_grid, beside = _lattice(mechanism, counts, whole_turn)
    budget = budget or Budget()
    spread = _Spread(solver, input_grid, beside, rest if "I" in free_of else None, budget)
    going = budget.goes_on("modes at samples of the input grid")
    starts = _starts(solver, input_grid) if going else []
    values = np.array([configuration for configuration, _ in starts]).reshape(
        len(starts), len(spread.periods)
    )
    for k in np.flatnonzero(spread.regular(values)):
        spread.add(*starts[k])
    spread.singular = len(starts) - len(spread.values)
    spread.run()
    return _labelled(spread, rest, ("II", "I") if "I" in free_of else ("II",))


def _lattice(
    mechanism: Mechanism, samples: list[int], whole_turn: bool
) -> tuple[InputGrid, NDArray[np.intp]]:
    """Return the input grid and its neighbours (2 axes, n), over whole turns."""
    if not whole_turn:
        made = grids.grid(mechanism.inputs, samples)
        return made, made.neighbours()
    axes = [-np.pi + 2.0 * np.pi * np.arange(count) / count for count in samples]
    mesh = np.meshgrid(*axes, indexing="ij")
    made = InputGrid(np.stack([axis.ravel() for axis in mesh], axis=1), tuple(samples))
    number = np.arange(len(made)).reshape(made.shape)
    rolled = [
        np.roll(number, shift, axis).ravel()
        for axis in range(len(samples))
        for shift in (-1, 1)
    ]
    return made, np.stack(rolled)


def _starts(solver: Solver, input_grid: InputGrid) -> list[tuple[Floats, int]]:
    """Return configurations (V,) and their samples: all of dyads, of groups some."""
    if solver.assembly.has_closed_form:
        rows = np.arange(len(input_grid))
    else:
        places = [
            np.unique(np.linspace(0, count - 1, min(PROBES, count)).astype(int))
            for count in input_grid.shape
        ]
        mesh = np.meshgrid(*places, indexing="ij")
        rows = np.ravel_multi_index([axis.ravel() for axis in mesh], input_grid.shape)
    values, which = configurations(solver, input_grid.q[rows])
    return [
        (configuration, int(rows[k]))
        for configuration, k in zip(values, which, strict=True)
    ]


class _Spread:
    """Configurations at the samples of an input grid, and which are joined."""

    def __init__(
        self,
        solver: Solver,
        input_grid: InputGrid,
        beside: NDArray[np.intp],
        output: OutputStationary | None,
        budget: Budget,
    ) -> None:
        self.budget = budget
        self.solver, self.input_grid, self.beside = solver, input_grid, beside
        self.periods = periods_of(solver.closure)
        self.output = output
        self.values: list[Floats] = []
        self.rows: list[int] = []
        self.joined: list[tuple[int, int]] = []
        self.at: dict[int, list[int]] = {}
        self.walked = self.singular = 0

    def locus(self, rest: InputsLocked | OutputStationary) -> Locus:
        """Return the singular configurations with something at rest."""
        return Locus(self.solver.closure, len(self.solver.driven), rest)

    def add(self, values: Floats, row: int) -> int:
        """Return the number of a configuration (V,) at a sample, new or known."""
        for number in self.at.setdefault(row, []):
            away = less_periods(values - self.values[number], self.periods)
            if np.max(np.abs(away)) < SAME:
                return number
        node = len(self.values)
        self.values.append(values)
        self.rows.append(row)
        self.at[row].append(node)
        return node

    def run(self) -> None:
        """Join every configuration to those that straight ways lead to."""
        driven = list(self.solver.driven)
        while self.walked < len(self.values) < MOST_CONFIGURATIONS:
            words = f"configuration {self.walked + 1} of aspects"
            if not self.budget.goes_on(words):
                return
            new = np.arange(self.walked, len(self.values))
            self.walked = len(self.values)
            start = np.repeat(new, len(self.beside))
            stop = self.beside[:, np.array(self.rows)[new]].T.ravel()
            start, stop = start[stop >= 0], stop[stop >= 0]
            values = np.array([self.values[node] for node in start])
            goal = self.input_grid.q[stop]
            turns = np.round((values[:, driven] - goal) / (2.0 * np.pi))
            goal = goal + 2.0 * np.pi * turns
            arrived, status = walk(self.solver.closure, driven, values, goal)
            good = status == Status.OK
            arrived_well = np.flatnonzero(good)
            good[good] = self.regular(arrived[good])
            self.singular += len(arrived_well) - int(np.sum(good))
            good[good] = self._clear(values[good], arrived[good])
            for k in np.flatnonzero(good):
                self.joined.append((int(start[k]), self.add(arrived[k], int(stop[k]))))

    def regular(self, values: Floats) -> NDArray[np.bool_]:
        """Return which configurations (n, V) are singular of no type that divides."""
        if not len(values):
            return np.zeros(0, dtype=bool)
        inputs = self.locus(InputsLocked(self.solver.driven))
        space = inputs.space(values)
        least = [space.reciprocal_condition, inputs.measure(space).smallest]
        if self.output is not None:
            least.append(self.locus(self.output).measure(space).smallest)
        return np.asarray(np.min(least, axis=0) > SINGULAR)

    def _clear(self, start: Floats, stop: Floats) -> NDArray[np.bool_]:
        """Return (n,) whether no type I lies between, by cubic polynomials."""
        if self.output is None or not len(start):
            return np.ones(len(start), dtype=bool)
        locus = self.locus(self.output)
        driven = list(self.solver.driven)
        way = (stop - start)[:, driven]
        control = []
        for values, sense in ((start, 1.0), (stop, -1.0)):
            space = locus.space(values)
            measure = locus.measure(space)
            try:
                along = np.linalg.solve(space.basis[:, driven], way[..., None])[..., 0]
            except np.linalg.LinAlgError:
                along = np.full_like(way, np.nan)
            slope = np.sum(measure.gradient * along, axis=1)
            control += [measure.value, measure.value + sense * slope / 3.0]
        signs = np.sign(np.stack(control))
        return np.asarray((signs[0] != 0.0) & np.all(signs == signs[0], axis=0))


def _labelled(
    spread: _Spread, rest: OutputStationary | None, free_of: tuple[TypeName, ...]
) -> Aspects:
    n = len(spread.values)
    values = np.array(spread.values).reshape(n, len(spread.periods))
    label = labels(n, np.array(spread.joined, dtype=np.intp).reshape(-1, 2))
    sizes = np.bincount(label)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    label, sizes = rank[label], sizes[order]
    row = np.array(spread.rows, dtype=np.int64)
    signs = []
    for constraint in (InputsLocked(spread.solver.driven), rest):
        sign = np.zeros(len(sizes), dtype=np.int8)
        if constraint is not None and n:
            locus = spread.locus(constraint)
            sign = _signs(locus.measure(locus.space(values)), label, len(sizes))
        signs.append(sign)
    modes = np.zeros(len(sizes), dtype=np.int64)
    pairs, often = np.unique(np.stack([label, row]), axis=1, return_counts=True)
    np.maximum.at(modes, pairs[0], often)
    return Aspects(
        spread.input_grid,
        row,
        values,
        values[:, list(spread.solver.driven)],
        label,
        sizes,
        signs[0],
        signs[1],
        modes,
        free_of,
        spread.singular,
        spread.budget.note,
    )


def _signs(measure: Measure, label: NDArray[np.int64], count: int) -> NDArray[np.int8]:
    """Return the sign that all configurations of each aspect have, or 0."""
    signs = np.zeros(count, dtype=np.int8)
    if measure.signed:
        for number in range(count):
            of_aspect = np.unique(np.sign(measure.value[label == number]))
            signs[number] = of_aspect[0] if len(of_aspect) == 1 else 0
    return signs
