"""Finding assembly modes over samples of several inputs, with groups that are no dyads.

If all groups are dyads or have an elimination, all configurations at every sample are
computed. Otherwise random starts at samples lead to some, and from each the neighbouring
samples are reached by verified steps. In both cases a `ConfigurationGraph` divides the
configurations into assembly modes, each configuration into one.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from spherekit.arrays import Floats, Indices, SmallIntegers
from spherekit.conventions import Status, counted
from spherekit.guarantee import Completeness, Guarantee
from spherekit.motion.assembly_modes import AssemblyMode, Solver
from spherekit.motion.configuration_graph import ConfigurationGraph, share_numbers
from spherekit.motion.elimination import (
    CLOSED_FORM,
    MOST_ASSEMBLY_MODES,
    RANGE_ROUNDS,
    SEARCH,
    Method,
    assemblies,
    group_signs,
    least_complete,
    orders_of,
    random_starts,
)
from spherekit.motion.guides import ModeOverGrid, sheets_through
from spherekit.motion.input_grid import InputGrid, spread_rows
from spherekit.motion.sample_configurations import can_enumerate, enumerate_configurations
from spherekit.motion.search import SearchStatistics
from spherekit.motion.turns import whole_laps
from spherekit.progress import ProgressReporter
from spherekit.sphere.rotation import nans

MOST_MODE_ROWS = 2**21
"""Rows that further assembly modes than `MOST_ASSEMBLY_MODES` may have in all. More: inputs
given far apart from each other keep all their configurations; less: less memory."""
MOST_SEARCHED = 5
"""Samples, of those at which elimination is doubtful, where random starts are made."""
REFERENCE_ONLY = Completeness(Guarantee.COMPONENT, "the mode of the reference pose")


class SampledModes:
    """The assembly modes of a mechanism with several inputs over an input grid.

    Parameters
    ----------
    solver, input_grid
        The mechanism, and the samples.
    search
        Whether to look for modes beside that of a reference pose.
    shares_numbers
        Whether modes of the same signs that have no neighbouring samples are put together.
        The grid is a path then.

    Attributes
    ----------
    assembly_modes
        That of the reference pose first, then in the order of their first samples, and in
        that of the configurations there.
    methods, claim, probes
        As those of `spherekit.motion.modes.ModeSearch`.
    mobilities
        Numbers of degrees of freedom by rank of the configurations of an over-constrained
        mechanism, as far as they were computed.
    """

    def __init__(
        self,
        solver: Solver,
        input_grid: InputGrid,
        search: bool = True,
        shares_numbers: bool = False,
    ) -> None:
        self.solver = solver
        self.input_grid = input_grid
        self.claim = REFERENCE_ONLY
        self.groups = solver.assembly.groups
        self.methods: list[Method | None] = [None] * len(self.groups)
        self.probes = 0
        self.mobilities: list[int] = []
        self._graph = ConfigurationGraph(solver, input_grid)
        # Number of the sheet of verified steps that reached each node first.
        self._sheet_of_node = np.empty(0, dtype=np.intp)
        self._sheet_count = 0
        self._numbered_count = 0
        self._working = ProgressReporter("searching the assembly modes")

        is_enumerated = (search or solver.reference is None) and self._can_enumerate
        if is_enumerated:
            self._enumerate()
        reference_node = self._reach_reference(is_enumerated)
        if not is_enumerated and (search or reference_node is None):
            self.claim = self._search_all()
        self.assembly_modes = self._make_modes(reference_node, shares_numbers)

    @property
    def _can_enumerate(self) -> bool:
        """Whether all configurations can be computed at some of the samples at least."""
        solver = self.solver
        if (
            not can_enumerate(solver)
            or any(group.redundant for group in self.groups)
            or (solver.meshes is not None and not solver.meshes.all_known)
        ):
            return False
        # A link of an arc of 0 or 180 deg makes eliminations fail everywhere.
        rows = spread_rows(len(self.input_grid), MOST_SEARCHED)
        probes = enumerate_configurations(solver, self.input_grid.q[rows])
        return bool(np.any(probes.is_complete))

    def _enumerate(self) -> None:
        """Find all configurations at all samples, and join them."""
        q = self.input_grid.q
        configurations = enumerate_configurations(self.solver, q)
        self.probes = len(q)
        self.methods = [
            CLOSED_FORM
            if group.is_dyad or number in self.solver.trains
            else Method(f"elimination: all {orders_of(group)[0].roots} complex roots")
            for number, group in enumerate(self.groups)
        ]
        self._graph.add(configurations.sample, configurations.values)
        is_unbalanced = self._graph.find_unbalanced()
        is_complete = configurations.is_complete & ~is_unbalanced
        problem = configurations.problem or "the signs of their determinants do not cancel"
        self._graph.is_complete = is_complete
        self._graph.join()
        incomplete = np.flatnonzero(~is_complete)
        words = f"all configurations at {_count_samples(q, len(q) - len(incomplete))}"
        if len(incomplete):
            chosen = incomplete[spread_rows(len(incomplete), MOST_SEARCHED)]
            self._number_nodes(chosen)
            statistics = self._search(chosen)
            words += (
                f"; at the other {len(incomplete)} some may be missing ({problem}); "
                f"at {len(chosen)} of these {statistics.words('configurations')}"
            )
            self._graph.join()
        self.claim = Completeness(Guarantee.SAMPLED, words)

    def _number_nodes(self, samples: Indices) -> None:
        """Give each node of some samples a number of its own, as if it were a sheet."""
        is_there = np.isin(self._graph.sample, samples)
        self._sheet_count = self._numbered_count = int(np.sum(is_there))
        self._sheet_of_node = np.full(len(is_there), -1, dtype=np.intp)
        self._sheet_of_node[is_there] = np.arange(self._sheet_count)

    def _reach_reference(self, is_enumerated: bool) -> int | None:
        """Return a node of the mode of the reference pose, None if there is none."""
        solver, q = self.solver, self.input_grid.q
        reference = solver.reference
        if reference is None:
            return None
        inputs = reference[list(solver.driven)]
        away = 0.5 * (np.min(q, axis=0) + np.max(q, axis=0)) - inputs
        is_outside = np.abs(away) > 0.5 * np.ptp(q, axis=0)
        laps = np.where(is_outside, whole_laps(away, solver.periods), 0.0)
        values = solver.moved(reference[None], inputs + laps)
        sheet = self._spread(values)
        if sheet is None:
            return None
        (sample,) = np.nonzero(sheet.status == Status.OK)
        if is_enumerated:
            nodes = self._graph.find(sample, sheet.values[sample])
            return int(nodes[np.argmax(nodes >= 0)]) if np.any(nodes >= 0) else None
        self._add_sheet(sheet)
        return int(self._graph.find(sample[:1], sheet.values[sample[:1]])[0])

    def _spread(self, values: Floats) -> ModeOverGrid | None:
        """Return the configurations that verified steps reach from one (1, variables).

        None if it has another mobility than there are inputs, or no sample is reached.
        """
        driven = list(self.solver.driven)
        closed = self.solver.closure.solve(values, driven).values
        if any(group.redundant for group in self.groups):
            self.mobilities.append(self.solver.freedoms(closed[0]))
            if self.mobilities[-1] != len(driven):
                return None
        return sheets_through(self.solver.closure, driven, self.input_grid, closed)[0]

    def _add_sheet(self, sheet: ModeOverGrid) -> None:
        self._graph.add_sheet(sheet.values)
        new = len(self._graph.sample) - len(self._sheet_of_node)
        numbers = np.full(new, self._sheet_count)
        self._sheet_of_node = np.append(self._sheet_of_node, numbers)
        self._sheet_count += 1
        self._working.tell(lambda: f"{self._sheet_count} followed")

    def _add_sheets(self, values: Floats, samples: Indices) -> Indices:
        """Add the sheets of configurations (m, variables) at samples (m,).

        Returns the sheet (m,) of each, -1 if no sheet has it.
        """
        sheets = np.full(len(samples), -1, dtype=np.intp)
        for row in range(len(samples)):
            node = self._graph.find(samples[row : row + 1], values[row : row + 1])[0]
            if node < 0 and not self._is_full:
                sheet = self._spread(values[row : row + 1])
                if sheet is None:
                    continue
                self._add_sheet(sheet)
                node = self._graph.find(samples[row : row + 1], values[row : row + 1])[0]
            if node >= 0:
                sheets[row] = self._sheet_of_node[node]
        return sheets

    @property
    def _is_full(self) -> bool:
        """Whether no further sheet is followed."""
        return self._sheet_count - self._numbered_count >= MOST_ASSEMBLY_MODES

    @property
    def _most_modes(self) -> int:
        """Number of assembly modes that are kept."""
        return max(MOST_ASSEMBLY_MODES, MOST_MODE_ROWS // len(self.input_grid))

    def _search_all(self) -> Completeness:
        """Look for modes where not all configurations at a sample can be computed."""
        solver = self.solver
        if solver.meshes is not None:
            if not self._sheet_count:
                self._probe(0)
            if not solver.meshes.all_known:
                for sample in spread_rows(len(self.input_grid), MOST_SEARCHED).tolist():
                    if not self._sheet_count:
                        self._probe(sample)
                words = f"modes found at {counted(self.probes, 'input')}"
                as_assembled = "wheels put together otherwise were not looked for"
                if not self.probes:
                    return replace(
                        REFERENCE_ONLY, reason=f"{REFERENCE_ONLY.reason}; {as_assembled}"
                    )
                return Completeness(Guarantee.SAMPLED, words)
        self.methods = [CLOSED_FORM if group.is_dyad else SEARCH for group in self.groups]
        statistics = self._search(np.arange(len(self.input_grid)))
        if not self._sheet_count:
            # Random starts leave out what is next to a dead centre.
            self._probe(len(self.input_grid) // 2)
        words = statistics.words("modes")
        if self._is_full:
            words += f"; stopped at {self._sheet_count} modes, there may be more"
        return Completeness(Guarantee.SAMPLED, words)

    def _probe(self, sample: int) -> None:
        """Add the modes of the configurations that a search finds at one sample."""
        here = assemblies(self.solver, self.input_grid.q[sample])
        self.probes += 1
        self.methods = list(map(least_complete, self.methods, here.methods))
        self._add_sheets(here.values, np.full(len(here.values), sample))

    def _search(self, samples: Indices) -> SearchStatistics:
        """Add what random starts at some samples lead to; return how often they did."""
        q = self.input_grid.q
        low = np.min(q, axis=0)
        high = np.max(q, axis=0)
        starts = random_starts(self.solver, low, high, q[samples])
        variables = len(self.solver.mechanism.variable_owners)
        statistics = SearchStatistics(variables, RANGE_ROUNDS)
        while statistics.goes_on and not self._is_full:
            start_count, values, rows = next(starts)
            sheets = self._add_sheets(values, samples[rows])
            statistics.add(start_count, sheets, self._sheet_count)
            self.probes += start_count
            self._working.tell(lambda: statistics.words("modes"))
        return statistics

    def _make_modes(
        self, reference_node: int | None, shares_numbers: bool
    ) -> list[AssemblyMode]:
        """Return the assembly modes, and state in the claim if some are left out."""
        graph = self._graph
        modes = graph.modes()
        if shares_numbers:
            modes = self._share_numbers(modes)
        most = self._most_modes
        if len(modes) > most:
            words = (
                f"{self.claim.reason}; the {most} assembly modes with most samples are kept"
                f" of {len(modes)}"
            )
            self.claim = Completeness(Guarantee.SAMPLED, words)
        kept = sorted(modes[:most], key=graph.first_node)
        if reference_node is not None:
            is_reference = [bool(np.any(mode == reference_node)) for mode in kept]
            others = [not item for item in is_reference]
            kept = [*compress(kept, is_reference), *compress(kept, others)]
        signs = self._signs(kept)
        return [
            self._make_mode(number, mode, signs[number]) for number, mode in enumerate(kept)
        ]

    def _signs(self, modes: Sequence[Indices]) -> SmallIntegers:
        """Return the signs (modes, groups) that tell the configurations of modes apart."""
        typical = [self._graph.regular_node(mode) for mode in modes]
        return group_signs(self.solver, self._graph.values[typical], 0.0)

    def _share_numbers(self, modes: Sequence[Indices]) -> list[Indices]:
        """Return modes put together as far as they keep apart and have the same signs."""
        modes_by_signs: dict[tuple[int, ...], list[Indices]] = {}
        for mode, signs in zip(modes, self._signs(modes).tolist(), strict=True):
            modes_by_signs.setdefault(tuple(signs), []).append(mode)
        shared = []
        for alike in modes_by_signs.values():
            shared += share_numbers(sorted(alike, key=self._graph.first_node))
        return sorted(shared, key=lambda mode: -int(np.sum(mode >= 0)))

    def _make_mode(self, number: int, mode: Indices, signs: SmallIntegers) -> AssemblyMode:
        """Return the assembly mode of nodes (n,) at the samples, -1 where it has none."""
        has_node = mode >= 0
        values = nans((len(mode), self._graph.values.shape[1]))
        values[has_node] = self._graph.values[mode[has_node]]
        status = np.where(has_node, Status.OK, Status.OUT_OF_REACH).astype(np.int8)
        dyad_signs = [
            (1 if sign >= 0 else -1) if group.is_dyad else 0
            for group, sign in zip(self.groups, signs.tolist(), strict=True)
        ]
        return AssemblyMode(
            number, tuple(dyad_signs), ModeOverGrid(values, status), tuple(signs.tolist())
        )


def _count_samples(q: Floats, complete: int) -> str:
    """Return how many of samples q (n, inputs) have all their configurations, in words."""
    if complete < len(q):
        return f"{complete} of the {len(q)} samples"
    return "the only sample" if len(q) == 1 else f"each of the {len(q)} samples"
