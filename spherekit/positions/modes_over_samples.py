"""Finds the assembly modes of a mechanism over samples of several inputs.

If each group is a dyad, a train of wheels, or has an elimination, all configurations at
every sample are computed. Exceptions are redundant equations, free wheels, and an
elimination that fails. Otherwise some configurations are found, mostly from random starts.
A sheet is followed from each of them: the set of configurations that verified steps reach
from a start, at most one at each sample. In both cases a `ConfigurationGraph` divides the
configurations into assembly modes. Each configuration belongs to one mode.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.completeness import Completeness, Guarantee
from spherekit.geometry.vectors import nans
from spherekit.positions.assembly_enumeration import (
    MAX_ASSEMBLY_MODES,
    RANGE_ROUNDS,
    enumerate_assemblies,
    group_signs,
    random_starts,
)
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_graph import ConfigurationGraph, share_numbers
from spherekit.positions.elimination_order import find_elimination_orders
from spherekit.positions.group_solutions import (
    CLOSED_FORM,
    RANDOM_SEARCH,
    SolutionMethod,
    least_complete,
)
from spherekit.positions.input_grid import InputGrid, spread_rows
from spherekit.positions.mode_predictor import ModeOverGrid, sheets_through
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import SearchStatistics
from spherekit.positions.sample_configurations import (
    can_enumerate,
    enumerate_configurations,
)
from spherekit.progress import ProgressReporter
from spherekit.status import Status
from spherekit.wording import counted

MOST_MODE_ROWS = 2**21
"""Largest total number of rows (modes times samples) if more than `MAX_ASSEMBLY_MODES`
modes are kept. Larger: more modes are kept over short paths and grids; smaller: less
memory."""
MAX_SEARCHED_SAMPLES = 5
"""Largest number of samples that are chosen for a search from random starts, or for a test
whether configurations can be computed. Larger: fewer missed configurations, more time."""
REFERENCE_ONLY = Completeness(Guarantee.COMPONENT, "the mode of the reference pose")
"""Statement of completeness if only the mode of the reference pose was searched."""


class SolutionNumbers:
    """Gives a number to each solution that a search from random starts can reach.

    The search counts how often it reaches each solution, and ends if each was reached often
    enough. A solution is one of these:

    - a single configuration that was computed before the search,
    - a sheet: all configurations that verified steps reach from one start, at most one at
      each sample of the inputs.

    The configurations are nodes of a graph, numbered in the order in which they are added.

    Attributes
    ----------
    count
        Number of solutions of both kinds.
    sheet_count
        Number of sheets.
    """

    def __init__(self) -> None:
        """Begin without solutions."""
        self.count = 0
        self.sheet_count = 0
        # (nodes,) index of the solution to which each configuration belongs, or -1.
        self._solution_of_node = np.empty(0, dtype=np.intp)

    def number_nodes(self, is_solution: Bools) -> None:
        """Number single configurations as solutions of the search for assembly modes.

        A node of the graph is one configuration at one sample. `is_solution` (nodes,) is
        true for nodes at the samples that are searched. The search cannot reach the other
        nodes, so they get -1. The method is called before sheets (sets of configurations
        reached from one start) are followed.
        """
        self.count = int(np.sum(is_solution))
        self._solution_of_node = np.full(len(is_solution), -1, dtype=np.intp)
        self._solution_of_node[is_solution] = np.arange(self.count)

    def number_sheet(self, node_count: int) -> None:
        """Give the nodes of a new sheet the next solution number.

        A sheet is the set of configurations that verified steps reach from one start. Each
        configuration is a node of the graph. The new nodes are those that have no number
        yet. All other nodes keep their number. `node_count` is the number of all nodes.
        """
        new_count = node_count - len(self._solution_of_node)
        self._solution_of_node = np.append(
            self._solution_of_node, np.full(new_count, self.count)
        )
        self.count += 1
        self.sheet_count += 1

    def find(self, node: int) -> int:
        """Return the index of the solution to which a node belongs, -1 if to none."""
        return int(self._solution_of_node[node])


class SampledModes:
    """The assembly modes of a mechanism with several inputs over an input grid.

    The constructor runs the whole search.

    Parameters
    ----------
    solver
        The mechanism, ready to be evaluated.
    input_grid
        The n samples of its inputs.
    search
        Whether to search for modes other than the mode of the reference pose. They are also
        searched if there is no reference pose, or if its mode reaches no sample.
    shares_numbers
        Whether modes with the same signs of their groups become one mode if they have no
        neighbouring samples. The grid must then be a path.

    Attributes
    ----------
    assembly_modes
        The mode of the reference pose comes first. The other modes are sorted by their
        first sample, and at the same sample in the order of its configurations.
    methods
        How the configurations of each group were computed; None if nothing was computed.
    claim
        How complete the modes are.
    probes
        Number of samples at which configurations were computed, plus the number of random
        starts.
    mobilities
        Number of degrees of freedom, by the rank of the velocity equations, of each
        configuration from which verified steps were to lead to the samples. The number is
        computed only if a group has redundant equations.
    """

    def __init__(
        self,
        solver: PositionSolver,
        input_grid: InputGrid,
        search: bool = True,
        shares_numbers: bool = False,
    ) -> None:
        """Find the assembly modes of a mechanism at the samples of its inputs.

        An assembly mode is one way to assemble the mechanism. Configurations are nodes of a
        graph, and verified steps between neighbouring samples join them to modes. All nodes
        that such steps reach from one start are called a sheet: a mode, or a part of one.

        Parameters
        ----------
        solver, input_grid
            The mechanism, and the samples of its inputs.
        search
            Whether to search for modes other than that of the reference pose (the
            configuration in the file). If the mode of the reference pose is not found, the
            other modes are searched in any case.
        shares_numbers
            Whether some modes share one number, and so become one mode. These are modes on
            separate parts of a path of samples whose groups of links have equal signs. A
            dyad (two links) has the sign of the determinant of its three axes, another
            group the sign of the determinant of its velocity equations.
        """
        self.solver = solver
        self.input_grid = input_grid
        # Results. `claim` says how complete the modes are. `methods` says how each group of
        # links was solved. `probes` is the number of samples at which configurations were
        # computed, plus the number of random starts. `mobilities` are degrees of freedom at
        # starts of sheets.
        self.claim = REFERENCE_ONLY
        self.groups = solver.assembly.groups
        self.methods: list[SolutionMethod | None] = [None] * len(self.groups)
        self.probes = 0
        self.mobilities: list[int] = []
        self._graph = ConfigurationGraph(solver, input_grid)
        # Counts how often a search from random starts reaches each solution.
        self._solutions = SolutionNumbers()
        self._progress = ProgressReporter("searching assembly modes")

        # A node of the graph that belongs to the mode of the reference pose. None if this
        # mode is not found, for example because the pose reaches no sample.
        if search:
            reference_node = self._search_all()
        else:
            # Only the reference pose is followed. `is_enumerated` says whether all
            # configurations at the samples were computed before.
            reference_node = self._reach_reference(is_enumerated=False)
            if reference_node is None:
                # Now there is no mode at all. So other modes are searched although `search`
                # is false.
                self._search_other_modes()
        self.assembly_modes = self._collect_modes(reference_node, shares_numbers)

    def _search_all(self) -> int | None:
        """Search all assembly modes, and return a node of the mode of the reference pose.

        Configurations are stored as nodes of a graph. A node is one configuration at one
        sample. The result is None if the mode of the reference pose is not known. The
        attribute `claim` is set, which states how complete the modes are.

        If possible, all configurations at all samples are computed (enumerated). If not,
        modes are searched, first from the reference pose, then from random starts.
        """
        if self._can_enumerate:
            self._enumerate()  # sets `claim`, too
            return self._reach_reference(is_enumerated=True)
        reference_node = self._reach_reference(is_enumerated=False)
        self.claim = self._search_modes()
        return reference_node

    def _search_other_modes(self) -> None:
        """Search modes after the mode of the reference pose was not found."""
        if self._can_enumerate:
            self._enumerate()  # sets `claim`
        else:
            self.claim = self._search_modes()

    @property
    def _can_enumerate(self) -> bool:
        """Whether all configurations can be computed at one sample or more.

        Each group of links must be a dyad (two links) or a train of wheels, which have
        formulas, or reduce to a polynomial by elimination. Two kinds of mechanisms are
        excluded. With redundant equations, the Jacobian is not square, so the signs of its
        determinant cannot check the result. Free wheels roll by amounts that the inputs do
        not determine, so there are infinitely many configurations.
        """
        solver = self.solver
        gear_phases = solver.gear_phases
        has_free_wheels = gear_phases is not None and not gear_phases.all_known
        has_redundant_equations = any(group.redundant for group in self.groups)
        if not can_enumerate(solver) or has_redundant_equations or has_free_wheels:
            return False
        # Try a few samples; one success is enough. Elimination fails at every sample if
        # both axes of a link coincide (arc of 0 or 180 deg).
        rows = spread_rows(len(self.input_grid), MAX_SEARCHED_SAMPLES)
        tried_configurations = enumerate_configurations(solver, self.input_grid.q[rows])
        return bool(np.any(tried_configurations.is_complete))

    def _enumerate(self) -> None:
        """Compute all configurations at all samples, add them to the graph, and join them.

        A node of the graph is one configuration at one sample. Joined nodes become an
        assembly mode. At some of the samples at which configurations may be missing, random
        starts are tried as well. Three attributes are set for reports: the `methods` by
        which groups of links were solved, the `claim` how complete the modes are, and
        `probes`, the number of samples at which configurations were searched.
        """
        q = self.input_grid.q
        configurations = enumerate_configurations(self.solver, q)
        self.probes = len(q)
        self.methods = []
        for position, group in enumerate(self.groups):
            # A dyad (two links and three R pairs) and a train of wheels have closed forms.
            if group.is_dyad or position in self.solver.wheel_trains:
                self.methods.append(CLOSED_FORM)
            else:
                # There can be several orders in which unknowns are eliminated. The first
                # one is used.
                root_count = find_elimination_orders(group)[0].root_count
                self.methods.append(
                    SolutionMethod(f"elimination: all {root_count} complex roots")
                )
        self._graph.add(configurations.sample, configurations.values)
        # In each configuration the determinant of the velocity equations with locked inputs
        # has a sign. The signs of all configurations at a sample add up to zero, because
        # configurations appear and vanish in pairs of opposite signs. Another sum shows
        # that a configuration is missing.
        is_unbalanced = self._graph.find_unbalanced()
        is_complete = configurations.is_complete & ~is_unbalanced
        problem = configurations.problem or "the signs of their determinants do not cancel"
        self._graph.is_complete = is_complete
        self._graph.join()
        incomplete = np.flatnonzero(~is_complete)
        words = f"all configurations at {_count_samples(q, len(q) - len(incomplete))}"
        if len(incomplete):
            searched_samples = incomplete[
                spread_rows(len(incomplete), MAX_SEARCHED_SAMPLES)
            ]
            # The search counts how often it reaches the configurations that were computed
            # above. Few are missing if the search reaches these often and no others.
            self._solutions.number_nodes(np.isin(self._graph.sample, searched_samples))
            # The search adds its configurations to the graph.
            statistics = self._search(searched_samples)
            words += (
                f"; at the other {len(incomplete)} some may be missing ({problem}); "
                f"at {len(searched_samples)} of these "
                f"{statistics.describe('configurations')}"
            )
            self._graph.join()
        sentence = f"All assembly modes were found at {_count_samples(q, len(q))}."
        if len(incomplete):
            sentence = (
                f"At {len(incomplete)} of the {len(q)} samples, assembly modes could have "
                "been missed."
            )
        self.claim = Completeness(Guarantee.SAMPLED, words, sentence=sentence)

    def _reach_reference(self, is_enumerated: bool) -> int | None:
        """Return a node of the graph that belongs to the mode of the reference pose.

        The reference pose is the configuration that the file describes. Its assembly mode
        gets the number 0 in `_collect_modes`. A node of the graph is one configuration at
        one sample, and joined nodes are a mode. So one node is enough to identify the mode.

        The pose itself need not be at a sample. Verified steps lead from the pose to the
        samples. The configurations that they reach are called a sheet, and the result is
        the first of them that is a node.

        Parameters
        ----------
        is_enumerated
            Whether the configurations of all samples were computed and are in the graph. If
            not, the sheet of the reference pose is added to the graph.

        Returns
        -------
        The index of the node. None if there is no reference pose, if it reaches no node, or
        if its mobility is not the number of inputs.
        """
        reference_pose = self.solver.reference
        if reference_pose is None:
            return None
        # After a period of an input, all orientations repeat. The inputs of the pose are
        # shifted by whole periods, as near to the samples as possible.
        start = self.solver.shift_near_samples(reference_pose, self.input_grid.q)
        sheet = self._follow_sheet(start)
        if sheet is None:  # no sample is reached, or the mobility is wrong
            return None
        if not is_enumerated:
            self._add_sheet(sheet)
        return self._find_first_node(sheet)

    def _find_first_node(self, sheet: ModeOverGrid) -> int | None:
        """Return the first node of the graph that is a configuration of a sheet, or None.

        A node is one computed configuration at one sample. A sheet is the set of
        configurations that verified steps reach from one start. At some samples the
        configuration may be no node.
        """
        (samples,) = np.nonzero(sheet.status == Status.OK)
        # The node of each configuration of the sheet, -1 if it is not a node.
        nodes = self._graph.find(samples, sheet.values[samples])
        existing_nodes = nodes[nodes >= 0]
        return int(existing_nodes[0]) if len(existing_nodes) else None

    def _follow_sheet(self, values: Floats) -> ModeOverGrid | None:
        """Return the sheet that verified steps reach from a configuration.

        A sheet is a set of configurations of one assembly mode, at most one at each sample
        of the inputs. Steps lead from sample to neighbouring sample. Tests reject steps
        that could lead to another mode.

        Parameters
        ----------
        values
            (1, variables) the configuration (rad). Its loops are closed first, at constant
            inputs.

        Returns
        -------
        The configurations at the samples. None if no sample is reached, or if the mobility
        at the start is not the number of inputs.

        The mobility (degrees of freedom) is computed only if a group of links has redundant
        equations. The mobility is then appended to `mobilities`.
        """
        driven = list(self.solver.driven)
        closed_values = self.solver.closure.solve(values, driven).values
        if any(group.redundant for group in self.groups):
            mobility = self.solver.compute_mobility(closed_values[0])
            self.mobilities.append(mobility)
            if mobility != len(driven):
                return None
        # One configuration leads to one sheet.
        (sheet,) = sheets_through(
            self.solver.closure, driven, self.input_grid, values=closed_values
        )
        return sheet

    def _add_sheet(self, sheet: ModeOverGrid) -> None:
        """Add the configurations of a sheet as nodes to the graph, and number the sheet.

        A sheet is the set of configurations that verified steps reach from one start, at
        most one at each sample. Configurations that are nodes already keep their number.
        """
        self._graph.add_sheet(sheet.values)
        self._solutions.number_sheet(node_count=len(self._graph.sample))
        self._progress.report_if_due(lambda: f"{self._solutions.count} followed")

    def _assign_solutions(self, values: Floats, samples: Indices) -> Indices:
        """Return the indices of the solutions to which configurations belong.

        A search from random starts counts how often it reaches each solution. A solution
        is a sheet, or a single configuration that was computed before the search. A sheet
        is the set of configurations that verified steps reach from one start, at most one
        at each sample. If a configuration belongs to no known solution, the sheet through
        it is followed and becomes a new solution.

        Parameters
        ----------
        values
            (m, variables) closed configurations (rad) that the search has found.
        samples
            (m,) index of the sample of the inputs of each configuration.

        Returns
        -------
        (m,) index of the solution of each configuration. -1 if the configuration belongs to
        no solution, even after the sheet through it was followed.
        """
        return np.array(
            [
                self._assign_solution(values[row], sample)
                for row, sample in enumerate(samples.tolist())
            ],
            dtype=np.intp,
        )

    def _assign_solution(self, values: Floats, sample: int) -> int:
        """Return the index of the solution to which a configuration belongs.

        A search from random starts counts how often it reaches each solution. A solution
        is a sheet, or a single configuration that was computed before the search. A sheet
        is the set of configurations that verified steps reach from one start: the steps
        lead from sample to neighbouring sample of the inputs.

        All known configurations are nodes of a graph, and each node belongs to one solution
        at most. If the configuration is no node yet, the sheet through it is followed and
        added to the graph. There are at most `MAX_ASSEMBLY_MODES` sheets.

        Parameters
        ----------
        values, sample
            (variables,) the configuration (rad), and the index of its sample of the inputs.

        Returns
        -------
        Index of the solution, or -1 if there is none.
        """
        # The index of the node, -1 if the configuration is no node.
        node = self._find_node(values, sample)
        if node < 0 and not self._is_sheet_limit_reached:
            sheet = self._follow_sheet(values[None])
            if sheet is not None:
                self._add_sheet(sheet)
                # The configuration is a node now if it is on the sheet.
                node = self._find_node(values, sample)
        if node < 0:
            return -1
        return self._solutions.find(node)

    def _find_node(self, values: Floats, sample: int) -> int:
        """Return the node of the graph that is a configuration at a sample, or -1."""
        (node,) = self._graph.find(np.array([sample]), values[None])
        return int(node)

    @property
    def _is_sheet_limit_reached(self) -> bool:
        """Whether the search must end because `MAX_ASSEMBLY_MODES` sheets were followed.

        A sheet is the set of configurations that verified steps reach from one start, and
        is an assembly mode or a part of one.
        """
        return self._solutions.sheet_count >= MAX_ASSEMBLY_MODES

    @property
    def _mode_limit(self) -> int:
        """Largest number of assembly modes that are kept."""
        return max(MAX_ASSEMBLY_MODES, MOST_MODE_ROWS // len(self.input_grid))

    def _search_modes(self) -> Completeness:
        """Search assembly modes from random starts, and return how complete they are.

        Newton's method closes the loops from random starts. Each closed configuration is
        followed from sample to sample of the inputs, by verified steps. The configurations
        that are reached, at most one at each sample, are called a sheet. A sheet is an
        assembly mode or a part of one.
        """
        # Wheels roll on each other. `gear_phases` gives the rolled lengths as functions of
        # the inputs. It is None for a mechanism without wheels.
        gear_phases = self.solver.gear_phases
        if gear_phases is not None and not gear_phases.all_known:
            # The inputs do not determine all rolled lengths.
            return self._search_free_wheels()
        # Up to here, only the reference pose can have given a solution.
        has_reference_mode = self._solutions.count > 0
        has_wheels = gear_phases is not None
        if has_wheels and not has_reference_mode:
            # With wheels, all groups of links are first solved at the first sample. Random
            # starts follow.
            self._search_sample(0)
        self.methods = [
            CLOSED_FORM if group.is_dyad else RANDOM_SEARCH for group in self.groups
        ]
        statistics = self._search(np.arange(len(self.input_grid)))
        if not self._solutions.count:
            # Random starts leave out configurations near a dead centre. Solving all groups
            # at the middle sample can find these.
            self._search_sample(len(self.input_grid) // 2)
        # The statistics count sheets, which are called mode parts in the text for the user.
        # A mode can consist of several sheets.
        reason = statistics.describe("mode parts")
        sentence = statistics.sentence(len(self._graph.modes()))
        if self._is_sheet_limit_reached:
            count = self._solutions.count
            reason += f"; stopped at {count} mode parts, and there may be more"
            sentence = ""  # its probability is valid only for a search that was not stopped
        return Completeness(Guarantee.SAMPLED, reason, sentence=sentence)

    def _search_free_wheels(self) -> Completeness:
        """Find some assembly modes, if the inputs do not determine the rolling of wheels.

        The rolled length of two wheels is the arc by which they have rolled on each other.
        The loops also close if the wheels are put together one tooth or one revolution
        further on. If the inputs do not determine the rolled length, each possible length
        gives other modes. So there are infinitely many modes, and only some can be found.

        A mode of the reference pose (configuration in the file) is enough. Without it, up
        to `MAX_SEARCHED_SAMPLES` samples are searched, until one has configurations.

        Returns
        -------
        How complete the modes are.
        """
        # Up to here, only the reference pose can have given a solution.
        has_reference_mode = self._solutions.count > 0
        if has_reference_mode:
            # `REFERENCE_ONLY` states that only the mode of the reference pose was searched.
            limitation = "other ways to mesh the wheels were not searched"
            reason = REFERENCE_ONLY.reason
            return replace(
                REFERENCE_ONLY,
                reason=f"{reason}; {limitation}",
                sentence=f"Only {reason} was computed; {limitation}.",
            )
        for sample in spread_rows(len(self.input_grid), MAX_SEARCHED_SAMPLES).tolist():
            self._search_sample(sample)
            if self._solutions.count:
                break
        # `probes` is the number of samples of the inputs that were searched.
        reason = f"modes searched at {counted(self.probes, 'sample')}"
        return Completeness(Guarantee.SAMPLED, reason)

    def _search_sample(self, sample: int) -> None:
        """Solve all groups of links at one sample, and add the sheets of the solutions.

        A sheet is the set of configurations that verified steps reach from one solution, at
        most one at each sample. Solutions may be missing. `probes` and `methods` are
        updated.
        """
        sample_assemblies = enumerate_assemblies(self.solver, self.input_grid.q[sample])
        self.probes += 1
        self.methods = list(map(least_complete, self.methods, sample_assemblies.methods))
        for configuration in sample_assemblies.values:
            self._assign_solution(configuration, sample)

    def _search(self, samples: Indices) -> SearchStatistics:
        """Find configurations from random starts, and add the sheets through them.

        A sheet is a set of configurations of one assembly mode, at most one at each sample
        of the inputs. Verified steps from sample to sample lead from one configuration to
        all of its sheet.

        Parameters
        ----------
        samples
            (m,) indices of the samples at which starts are made.

        Returns
        -------
        Counts of how many starts have led to each solution. A solution is a sheet, or a
        single configuration that `_enumerate` had computed before the search. The search
        ends if these counts make a missing solution unlikely, or at the limit of sheets.
        """
        q = self.input_grid.q
        # The range of the inputs, in which the samples are.
        low = np.min(q, axis=0)
        high = np.max(q, axis=0)
        starts = random_starts(self.solver, low, high, samples=q[samples])
        variable_count = len(self.solver.mechanism.variable_owners)
        # With more variables each start takes longer, so fewer starts are allowed.
        statistics = SearchStatistics(variable_count, min_rounds=RANGE_ROUNDS)
        while statistics.needs_more_starts and not self._is_sheet_limit_reached:
            # Number of starts of this round, the closed configurations to which they led,
            # and the index in `samples` of each configuration.
            start_count, values, rows = next(starts)
            solutions = self._assign_solutions(values, samples[rows])
            statistics.add(start_count, hits=solutions, total=self._solutions.count)
            self.probes += start_count
            self._progress.report_if_due(lambda: statistics.progress_text("modes"))
        return statistics

    def _collect_modes(
        self, reference_node: int | None, shares_numbers: bool
    ) -> list[AssemblyMode]:
        """Return the assembly modes, sorted and numbered from 0.

        The nodes of `_graph` are configurations. Each assembly mode has at most one node at
        each sample of the inputs. The graph lists a mode as an array with the index of its
        node at each sample, -1 where it has none. At most `_mode_limit` modes stay: the
        mode of the reference pose, and those with most samples. If modes are left out,
        `claim` (the statement how complete the modes are) says so.

        Parameters
        ----------
        reference_node
            A node of the mode of the reference pose, which becomes mode 0. None if there is
            no such node.
        shares_numbers
            Whether some modes become one mode with one number. The samples are then a path.
            These modes are in separate parts of the path, and agree in the signs of all
            groups. A group is a set of links that are placed together. A dyad (two links)
            has the sign of the determinant of its three axes. Another group has the sign of
            the determinant of its velocity equations.
        """
        graph = self._graph
        # The largest modes come first.
        modes = graph.modes()
        if shares_numbers:
            modes = self._unite_separate_modes(modes)

        def is_reference(mode: Indices) -> bool:
            """Return whether a mode contains the node of the reference pose."""
            return reference_node is not None and bool(np.any(mode == reference_node))

        max_modes = self._mode_limit
        if len(modes) > max_modes:
            # The mode of the reference pose stays, however few samples it has.
            modes = sorted(modes, key=is_reference, reverse=True)
            kept = f"the {max_modes} with most samples are kept"
            if is_reference(modes[0]):
                kept = (
                    f"that of the reference pose and the {max_modes - 1} others with most "
                    "samples are kept"
                )
            reason = f"{self.claim.reason}; of {len(modes)} assembly modes, {kept}"
            self.claim = Completeness(Guarantee.SAMPLED, reason)

        def sort_key(mode: Indices) -> tuple[bool, tuple[int, int]]:
            """Return a key that puts the mode of the reference pose before all others.

            The other modes are sorted by their first sample, then by the index of their
            node there. `mode` (n,) has the index of the node at each sample.
            """
            return not is_reference(mode), graph.first_node(mode)

        sorted_modes = sorted(modes[:max_modes], key=sort_key)
        signs = self._signs_of_modes(sorted_modes)
        return [
            self._make_mode(number, mode, signs[number])
            for number, mode in enumerate(sorted_modes)
        ]

    def _signs_of_modes(self, modes: Sequence[Indices]) -> SmallIntegers:
        """Return the sign of each group of links in each assembly mode.

        The signs tell the modes of a group apart. A group is a set of links that are placed
        together. A dyad (two links) has the sign of the determinant of its three pair axes.
        Another group has the sign of the determinant of its velocity equations. The sign is
        constant in a mode, and is computed at one regular configuration.

        Parameters
        ----------
        modes
            For each mode the index (n,) of its configuration at each of n samples, -1 where
            the mode has none.

        Returns
        -------
        (modes, groups) the signs, 1 or -1.
        """
        # A mode with only singular configurations uses the first one. `least` is the least
        # reciprocal condition number of a reliable sign. With 0, a sign is returned even
        # near a singular matrix.
        regular_nodes = [self._graph.regular_node(mode) for mode in modes]
        return group_signs(self.solver, self._graph.values[regular_nodes], least=0.0)

    def _unite_separate_modes(self, modes: Sequence[Indices]) -> list[Indices]:
        """Unite modes with equal signs that occur at separate samples, to have fewer modes.

        Links are placed in groups, and each group has a sign in each assembly mode. The
        sign of a dyad (two links) is the sign of the determinant of its three axes. Another
        group has the sign of the determinant of its velocity equations.

        The samples are a path. A mode can end on the path, and a mode with the same sign
        for each group can begin later. Both modes get one number.

        Parameters
        ----------
        modes
            For each mode the index (n,) of its configuration (node of a graph) at each of n
            samples, -1 where the mode has none.

        Returns
        -------
        The united modes as arrays of the same kind. The mode with the most nodes comes
        first.
        """
        modes_by_signs: dict[tuple[int, ...], list[Indices]] = {}
        for mode, signs in zip(modes, self._signs_of_modes(modes).tolist(), strict=True):
            modes_by_signs.setdefault(tuple(signs), []).append(mode)
        united_modes = []
        for modes_of_signs in modes_by_signs.values():
            # `share_numbers` unites only modes with a gap (samples without either mode)
            # between them. Modes at the same sample, or at neighbouring ones, stay apart.
            united_modes += share_numbers(
                sorted(modes_of_signs, key=self._graph.first_node)
            )
        return sorted(united_modes, key=lambda mode: -int(np.sum(mode >= 0)))

    def _make_mode(
        self, number: int, configuration_numbers: Indices, group_signs: SmallIntegers
    ) -> AssemblyMode:
        """Return an assembly mode with all data from which it can be computed again.

        An assembly mode is one way to assemble the mechanism. Links are placed in groups,
        each of which can be placed in several ways. A mode selects one way for each group.

        Parameters
        ----------
        number
            Number of the mode.
        configuration_numbers
            (n,) the configuration of the mode at each sample of the inputs, as its number
            in the graph of all configurations; -1 if the mode has none there.
        group_signs
            (groups,) sign of the determinant of the velocity equations of each group. For a
            dyad (two links) it is the determinant of its three axes. A sign is constant in
            a mode.
        """
        return AssemblyMode(
            number=number,
            # A dyad is placed by a formula in two ways; its sign selects one.
            signs=self._select_dyad_solutions(group_signs),
            # The configurations at the samples. Groups without a formula are placed by
            # Newton's method, which starts from them.
            guide=self._collect_configurations(configuration_numbers),
            # A result with another sign than this belongs to another mode and is rejected.
            group_signs=tuple(group_signs.tolist()),
        )

    def _select_dyad_solutions(self, group_signs: SmallIntegers) -> tuple[int, ...]:
        """Return the sign that selects a solution of each dyad, and 0 for other groups.

        A dyad is a group of two links with three pair axes. The axes are the corners of a
        spherical triangle with given sides. There are two such triangles, one the mirror
        image of the other. In the order of the pairs, the corners run counterclockwise (+1)
        or clockwise (-1).

        Parameters
        ----------
        group_signs
            (groups,) sign of each group of links. For a dyad it is the sign of the triple
            product of its three axes.

        Returns
        -------
        +1 or -1 for each dyad, and 0 for each other group.
        """
        dyad_signs = []
        for group, sign in zip(self.groups, group_signs.tolist(), strict=True):
            if not group.is_dyad:
                dyad_signs.append(0)
            elif sign >= 0:
                # If the sign is 0, the three axes are in a plane. Both triangles are then
                # equal, and either sign is right.
                dyad_signs.append(1)
            else:
                dyad_signs.append(-1)
        return tuple(dyad_signs)

    def _collect_configurations(self, configuration_numbers: Indices) -> ModeOverGrid:
        """Return the configurations of a mode at all n samples of the inputs.

        The mode is one way to assemble the mechanism. At samples without a configuration,
        the pair variables are NaN, and the status is OUT_OF_REACH.

        Parameters
        ----------
        configuration_numbers
            (n,) the configuration at each sample, as its number in the graph of all
            configurations; -1 where the mode has none.
        """
        is_reached = configuration_numbers >= 0
        reached_configurations = configuration_numbers[is_reached]
        # (configurations, variables) pair variables of all configurations in the graph.
        values_in_graph = self._graph.values
        values = nans((len(configuration_numbers), values_in_graph.shape[1]))
        values[is_reached] = values_in_graph[reached_configurations]
        status = np.where(is_reached, Status.OK, Status.OUT_OF_REACH).astype(np.int8)
        return ModeOverGrid(values=values, status=status)


def _count_samples(q: Floats, complete: int) -> str:
    """Return a phrase for the number of samples at which all configurations were computed.

    `q` (n, inputs) are all samples of the inputs. `complete` is the number of samples at
    which all configurations were computed.
    """
    if complete < len(q):
        return f"{complete} of the {len(q)} samples"
    return "the only sample" if len(q) == 1 else f"each of the {len(q)} samples"
