"""Aspects: parts of the configurations that are connected without a singularity.

Configurations over an input grid are connected if verified steps lead from one of them to
its neighbour. Verified steps never pass a singularity of type II. Connected configurations
are one aspect. Two reported aspects with the same signs of their determinants may in truth
be one aspect: a connection between them can exist that these samples miss.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.errors import AnalysisError
from spherekit.geometry.vectors import max_abs, nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.connectivity import label_components
from spherekit.positions import input_grid as grids
from spherekit.positions.gear_phases import variable_periods
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.input_paths import follow_inputs
from spherekit.positions.input_revolutions import less_periods, whole_laps
from spherekit.positions.position_solver import PositionSolver
from spherekit.singularities.locus import SingularityLocus
from spherekit.singularities.singularity_report import LocusName
from spherekit.singularities.slices import configurations, solver_of
from spherekit.singularities.stationarity import InputsLocked, OutputStationary, output_of
from spherekit.status import Status
from spherekit.time_limit import TimeLimit

SINGULAR_NODE_VALUE = 1e-8
"""A configuration with a smaller singular value is singular and belongs to no aspect.
Larger: aspects lose configurations near singularities."""
START_SAMPLES_PER_INPUT = 5
"""Number of samples along each input at which modes of mechanisms with groups larger
than dyads are searched. Larger: more aspects are found; smaller: faster."""
SAME_ASPECT_CONFIGURATION_RAD = 1e-6
"""Configurations whose variables differ by less count as the same configuration.
Larger: different modes near a singularity are taken for one; smaller: one configuration
is counted twice."""
MAX_ASPECT_CONFIGURATIONS = 200_000
"""Number of configurations after which no more are connected."""
NO_CONFIGURATION = -1
"""Stands for a missing configuration in arrays of indices of configurations."""


@dataclass(frozen=True)
class Aspects:
    """n regular configurations over a grid of inputs, each with the aspect that has it.

    An aspect is a part of the configurations that is connected without a singularity.
    A configuration is regular if it has no singularity of a type in `free_of`, and if its
    closure equations do not lose rank. At singularities of type II the output can move
    while the inputs rest, at type I inputs can move while the output rests.

    Attributes
    ----------
    input_grid
        The grid of samples of the inputs.
    row
        (n,) number of the grid sample to which each configuration belongs.
    values, inputs
        The variables (n, V) and inputs (n, g), rad.
    label
        (n,) number of the aspect; aspect 0 has the most configurations.
    sizes
        (aspects,) numbers of configurations.
    sign_two, sign_one
        (aspects,) sign of the determinant that vanishes at type II, and of the one that
        vanishes at type I. The signs depend on the sense of a basis of the rates that close
        the loops. If the loop equations are redundant, this sense is arbitrary. The signs
        then have no meaning, and are 0. `sign_one` is also 0 if there is no output, if the
        output has more or fewer degrees of freedom than there are inputs, or if the aspect
        has both signs.
    modes
        (aspects,) largest number of configurations of the aspect at one sample. These are
        different assembly modes (ways to assemble the mechanism at the same inputs). If the
        number exceeds one, the mechanism can change its assembly mode within the aspect,
        without a singularity.
    free_of
        The types of singularity that divide aspects, so that no aspect contains them.
    singular
        Number of singular configurations that were found. They belong to no aspect, and are
        not among the n configurations.
    note
        The part of the work that was left out because a limit was reached, or empty.
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


@checked(AnalysisError)
def aspects(
    mechanism: Mechanism,
    samples: int | Sequence[int] = 21,
    free_of: Sequence[str] = ("II",),
    output: str | None = None,
    pointing: str | Sequence[float] | None = None,
    budget: TimeLimit | None = None,
) -> Aspects:
    """Return the aspects of a mechanism with any number of inputs.

    An aspect is a part of the configurations that is connected without a singularity.
    Configurations are searched at the samples of a grid of the inputs, and those at
    neighbouring samples are connected by verified steps.

    Parameters
    ----------
    mechanism
        A mechanism with as many degrees of freedom as inputs.
    samples
        Number of values of each input.
    free_of
        Which types of singularity divide aspects. Type II (the output can move while the
        inputs rest) always does; type I (inputs can move while the output rests) does if it
        is named.
    output, pointing
        The output that rests at type I: the name of the output, and its direction that
        has to rest; see `spherekit.singularities.stationarity.output_of`.
    budget
        Time after which no more configurations are joined, unlimited by default.

    Returns
    -------
    The regular configurations at the samples, with the aspect of each.

    Raises
    ------
    AnalysisError
        If an argument has a wrong type, if a type of singularity is unknown, or if type I
        is named and the output has fewer degrees of freedom than there are inputs.
    ModelError
        If the mechanism has no such output.
    PlanError
        If the mechanism does not have as many degrees of freedom as inputs.
    SolveError
        If the samples do not fit the inputs.
    """
    for kind in free_of:
        if kind not in ("I", "II"):
            raise AnalysisError(f'aspects: free_of: found "{kind}", allowed: I, II')
    divides_by_type_one = "I" in free_of
    output_condition = None
    if mechanism.outputs or divides_by_type_one:
        output_condition = output_of(mechanism, output, pointing)
    solver = solver_of(mechanism)
    input_count = len(solver.driven)
    if output_condition is not None and input_count > output_condition.equation_count:
        output_freedoms = output_condition.equation_count
        if divides_by_type_one:
            raise AnalysisError(
                f"{mechanism.name}: the output has {output_freedoms} degrees of freedom, "
                f"so {input_count} inputs can always move while it is at rest and no "
                "aspect is free of type I; leave I out of free_of"
            )
        # Every configuration is of type I, so there is no sign.
        output_condition = None
    if isinstance(samples, int | np.integer):
        sample_counts = [int(samples)] * input_count
    else:
        sample_counts = [int(count) for count in samples]
    grids.check_sample_counts(mechanism, sample_counts)
    input_grid = grids.make_grid(mechanism.inputs, sample_counts)
    time_limit = budget or TimeLimit()
    graph = _AspectGraph(
        solver, input_grid, output_condition, divides_by_type_one, time_limit
    )
    if time_limit.goes_on("modes at samples of the input grid"):
        graph.add_configurations(*_start_configurations(solver, input_grid))
    graph.connect_neighbours()
    return graph.label_aspects(("II", "I") if divides_by_type_one else ("II",))


def _start_configurations(
    solver: PositionSolver, input_grid: InputGrid
) -> tuple[Floats, Indices]:
    """Return configurations at samples of the inputs from which a search starts.

    The search follows paths from these configurations to further ones. If the assembly
    modes (ways to assemble the mechanism) have a closed form, the result has all modes at
    all samples. Otherwise the result has all modes at a few samples, evenly spread over the
    grid.

    Returns
    -------
    values, samples
        (n, V) variables (rad), and (n,) the sample of each configuration.
    """
    if solver.assembly.has_closed_form:
        rows = np.arange(len(input_grid))
    else:
        # The rows of a coarse grid within the grid.
        indices_by_input = []
        for count in input_grid.shape:
            indices = np.linspace(0, count - 1, min(START_SAMPLES_PER_INPUT, count))
            indices_by_input.append(np.unique(indices.astype(int)))
        rows = np.ravel_multi_index(np.ix_(*indices_by_input), input_grid.shape).ravel()
    # `input_rows` is the position in `rows` of each configuration.
    values, input_rows = configurations(solver, input_grid.q[rows])
    return values, rows[input_rows]


@dataclass(frozen=True)
class _AspectNodes(ArrayRows):
    """n configurations at samples of an input grid, and the signs that separate aspects.

    An aspect is a part of the configurations that is connected without a singularity. At a
    singularity of type II the output can move while the inputs rest, at type I inputs can
    move while the output rests. Type II always divides aspects. Type I divides them only if
    the user asks for it.

    Attributes
    ----------
    values
        (n, V) variables (rad).
    sample
        (n,) index of the sample at which each configuration is.
    is_regular
        (n,) whether the configuration has no singularity of a type that divides aspects.
    determinant_two
        (n,) a determinant that is zero at type II. Its sign tells aspects apart. The value
        is 0 in mechanisms where the determinant does not change its sign at type II.
    determinant_one
        (n,) a determinant that is zero at type I. Its sign tells aspects apart, except in
        mechanisms where it is never negative. The value is 0 if there is no output.
    slope_one
        (n, g) derivatives of `determinant_one` with respect to the g inputs. With them, a
        path between two configurations is tested for a zero of the determinant. They are 0
        if type I does not divide aspects, because paths are then not tested.
    """

    values: Floats
    sample: Indices
    is_regular: Bools
    determinant_two: Floats
    determinant_one: Floats
    slope_one: Floats

    def __len__(self) -> int:
        return len(self.sample)


class _AspectGraph:
    """A graph of configurations at the samples of an input grid.

    Two configurations at neighbouring samples are connected if a straight path of the
    inputs leads from one to the other without a singularity. Connected parts of the graph
    are the aspects. At singularities of type II the output can move while the inputs
    rest, at type I inputs can move while the output rests.

    Parameters
    ----------
    solver, input_grid
        Position solver of the mechanism, and the samples.
    output
        The output of type I, or None.
    divides_by_type_one
        Whether singularities of type I divide aspects. Those of type II always do.
    time_limit
        Time after which no more configurations are connected.

    Attributes
    ----------
    neighbours
        (directions, samples) index of the neighbouring sample in each direction of the
        grid, -1 if there is none. Direction 2 k leads upwards along input k, 2 k + 1
        downwards.
    nodes
        The configurations.
    limit_note
        The part of the work that was left out because `MAX_ASPECT_CONFIGURATIONS` was
        reached, or empty.
    numbers_at_sample
        (samples, k) indices of the configurations at each sample. A sample with fewer than
        k configurations has `NO_CONFIGURATION` in its last columns.
    is_path_known
        (n, directions) whether the path from a configuration in a direction was
        followed from its other end, so that it is not followed again.
    connections
        Arrays (m, 2) of the indices of connected configurations.
    """

    def __init__(
        self,
        solver: PositionSolver,
        input_grid: InputGrid,
        output: OutputStationary | None,
        divides_by_type_one: bool,
        time_limit: TimeLimit,
    ) -> None:
        """Create an empty graph of configurations.

        Its nodes will be configurations at samples of the inputs. An edge joins two nodes
        if a path of the inputs leads from one to the other without a singularity. Connected
        parts of the graph are called aspects.

        Parameters
        ----------
        solver
            Position solver of the mechanism.
        input_grid
            The samples of the inputs.
        output
            The condition that the output rests, for singularities of type I (inputs can
            move while the output rests). None if the mechanism has no output.
        divides_by_type_one
            Whether singularities of type I divide aspects. Those of type II (the output can
            move while the inputs rest) always do.
        time_limit
            Time after which no more configurations are connected.
        """
        self.time_limit = time_limit
        self.limit_note = ""
        self.solver = solver
        self.input_grid = input_grid
        self.neighbours = input_grid.neighbours()
        self.driven = list(solver.driven)
        self.periods = variable_periods(solver.closure)
        self.output = output
        self.divides_by_type_one = divides_by_type_one
        # Whether the determinant that is zero at type I changes its sign there. If so, its
        # sign tells aspects apart. `_make_nodes` sets this attribute.
        self.has_sign_of_type_one = False
        self.nodes = self._make_nodes(
            np.zeros((0, len(self.periods))), np.zeros(0, dtype=np.intp)
        )
        # One row for each sample. More columns are added for more configurations.
        self.numbers_at_sample = np.full((len(input_grid), 1), NO_CONFIGURATION)
        # For each configuration and direction of the grid: whether the path in this
        # direction was already followed from its other end.
        self.is_path_known = np.zeros((0, len(self.neighbours)), dtype=bool)
        # The edges, as arrays (m, 2) of indices of configurations.
        self.connections = [np.zeros((0, 2), dtype=np.intp)]

    def _make_nodes(self, values: Floats, samples: Indices) -> _AspectNodes:
        """Return nodes with the determinants whose signs separate aspects.

        A node is a configuration at a sample of the grid of inputs. An aspect is a part of
        the configurations that is connected without a singularity. A determinant vanishes
        at singularities of its type, and generally changes its sign there. At type II (two)
        the output can move while the inputs rest. At type I (one) inputs can move while the
        output rests. Type II always divides aspects, and type I if the caller asks for it.
        A node is regular if the closure equations, and the conditions that divide aspects,
        have no small singular value.

        Parameters
        ----------
        values
            (n, V) variables of the configurations (rad).
        samples
            (n,) index of the sample of each configuration.
        """
        closure = self.solver.closure
        input_count = len(self.driven)
        locus_two = SingularityLocus(closure, input_count, InputsLocked(self.solver.driven))
        # `space` has all rates that close the loops. `reciprocal_condition` is 0 where the
        # closure equations lose rank.
        space = locus_two.tangent_space(values)
        # `measure_two` says how small the rates of the inputs can be in a motion with unit
        # rates. They can be 0 at type II.
        measure_two = locus_two.measure(space)
        smallest_value = np.minimum(
            space.reciprocal_condition, measure_two.smallest_singular_value
        )
        # If `changes_sign` is False, the sign of the determinant has no meaning, and the
        # value is set to 0.
        determinant_two = np.zeros(len(values))
        if measure_two.changes_sign:
            determinant_two = measure_two.value
        determinant_one = np.zeros(len(values))
        slope_one = np.zeros((len(values), input_count))
        if self.output is not None:
            locus_one = SingularityLocus(closure, input_count, self.output)
            measure_one = locus_one.measure(space)
            self.has_sign_of_type_one = measure_one.changes_sign
            determinant_one = measure_one.value
            if self.divides_by_type_one:
                smallest_value = np.minimum(
                    smallest_value, measure_one.smallest_singular_value
                )
                # `gradient` has derivatives along the basis of `space`. The inverse of the
                # inputs' rates along this basis converts these to derivatives with respect
                # to the inputs. The inverse exists at regular nodes.
                is_regular = smallest_value > SINGULAR_NODE_VALUE
                inverse = nans((*slope_one.shape, input_count))
                inverse[is_regular] = np.linalg.inv(space.basis[is_regular][:, self.driven])
                slope_one = np.vecmat(measure_one.gradient, inverse)
        return _AspectNodes(
            values=values,
            sample=samples,
            is_regular=smallest_value > SINGULAR_NODE_VALUE,
            determinant_two=determinant_two,
            determinant_one=determinant_one,
            slope_one=slope_one,
        )

    def add_configurations(self, values: Floats, samples: Indices) -> Indices:
        """Add configurations at samples of the grid, if the graph does not have these yet.

        The table `numbers_at_sample` has one row per sample, with the indices of the
        configurations at this sample:

            sample 0:  configurations 4,  7
            sample 1:  configuration  5,  none

        The columns are treated one after another, with all samples together. A
        configuration that has a place in the column, or gets a free place there, is done.
        All others continue with the next column.

        Parameters
        ----------
        values
            (n, V) variables (rad).
        samples
            (n,) sample of each configuration.

        Returns
        -------
        (n,) indices of the configurations.
        """
        numbers = np.full(len(values), NO_CONFIGURATION)
        # Positions of the configurations whose index is not known yet.
        remaining = np.arange(len(values))
        column = 0
        while len(remaining):
            numbers[remaining] = self._place_in_column(
                column, values[remaining], samples[remaining]
            )
            is_without_place = numbers[remaining] == NO_CONFIGURATION
            remaining = remaining[is_without_place]
            column += 1
        return numbers

    def _place_in_column(self, column: int, values: Floats, samples: Indices) -> Indices:
        """Find configurations in one column of `numbers_at_sample`, or add them there.

        A sample (values of the inputs) can have several configurations. The table has a row
        for each sample, with the indices of its known configurations:

            sample 0:  configurations 4,  7
            sample 1:  configuration  5,  none

        The caller needs the indices of configurations that may be known. It calls this
        method for all of them with column 0, for those without an index with column 1, and
        so on. If the place of a sample in the column is free, the configuration is new, and
        gets this place.

        Parameters
        ----------
        column
            Index of the column. All columns before were searched without success.
        values, samples
            (n, V) variables (rad) and (n,) samples of the configurations.

        Returns
        -------
        (n,) indices of the configurations. `NO_CONFIGURATION` where another configuration
        has the place.
        """
        self._fill_free_places(column, values, samples)
        # The configurations that were just added are found like all others.
        return self._find_in_column(column, values, samples)

    def _fill_free_places(self, column: int, values: Floats, samples: Indices) -> None:
        """Store one new configuration at each sample that has a free place in a column.

        The table `numbers_at_sample` has a row for each sample, with the indices of its
        configurations in successive columns. The caller has compared the configurations
        with all former columns. If the place in this column is free, the row ends here,
        and the configuration is new. If several new configurations belong to one
        sample, only the first is stored. The others are then compared with it. If they
        differ from it, they go on to the next column.

        Parameters
        ----------
        column
            The column of `numbers_at_sample`. If the table has no such column, it is added.
        values, samples
            (n, V) variables (rad) and (n,) samples of the configurations.
        """
        if column == self.numbers_at_sample.shape[1]:
            self.numbers_at_sample = np.pad(
                self.numbers_at_sample, ((0, 0), (0, 1)), constant_values=NO_CONFIGURATION
            )
        is_free = self.numbers_at_sample[samples, column] == NO_CONFIGURATION
        free_samples, first_positions = np.unique(samples[is_free], return_index=True)
        new_values = values[is_free][first_positions]
        new_numbers = len(self.nodes) + np.arange(len(free_samples))
        self.numbers_at_sample[free_samples, column] = new_numbers
        self._append_nodes(new_values, free_samples)

    def _append_nodes(self, values: Floats, samples: Indices) -> None:
        """Append n configurations, from which no path to a neighbouring sample is known.

        Parameters
        ----------
        values, samples
            (n, V) variables (rad) and (n,) samples of the configurations.
        """
        new_nodes = self._make_nodes(values, samples)
        self.nodes = _AspectNodes.concatenate([self.nodes, new_nodes])
        # `np.pad` appends False for the new configurations.
        self.is_path_known = np.pad(self.is_path_known, ((0, len(samples)), (0, 0)))

    def _find_in_column(self, column: int, values: Floats, samples: Indices) -> Indices:
        """Compare configurations with the ones that a table column has at the same samples.

        In this way the graph recognises configurations that it already has. The table
        `numbers_at_sample` has a row for each sample, with the indices of its
        configurations in successive columns. Two configurations are the same if their
        variables differ by whole periods only, within a tolerance.

        Parameters
        ----------
        column
            The column of `numbers_at_sample`. It has a configuration at each of `samples`.
        values, samples
            (n, V) variables (rad) and (n,) samples of the configurations.

        Returns
        -------
        (n,) index of the stored configuration if it is the same, else `NO_CONFIGURATION`.
        """
        stored_numbers = self.numbers_at_sample[samples, column]
        stored_values = self.nodes.values[stored_numbers]
        differences = less_periods(values - stored_values, self.periods)
        is_same = max_abs(differences, axis=1) < SAME_ASPECT_CONFIGURATION_RAD
        return np.where(is_same, stored_numbers, NO_CONFIGURATION)

    def connect_neighbours(self) -> None:
        """Connect configurations at neighbouring samples by paths without singularities.

        A path changes one input from a sample to a neighbouring one. Connected
        configurations are in one aspect (a part of the configurations without a singularity
        inside).

        If a path leads to a configuration that is not in the graph yet, the configuration
        is added, and paths are followed from there. The search ends when no path leads to a
        new configuration, or at the limit of time or of the number of configurations.
        """
        # Direction 2 k of the grid leads upwards along input k, and 2 k + 1 downwards.
        directions = np.arange(len(self.neighbours))
        upwards = directions[0::2]
        downwards = directions[1::2]
        processed_count = 0
        while processed_count < len(self.nodes) < MAX_ASPECT_CONFIGURATIONS:
            next_step = f"configuration {processed_count + 1} of aspects"
            if not self.time_limit.goes_on(next_step):
                return
            # Singular configurations cannot be connected to others.
            is_regular = self.nodes.is_regular[processed_count:]
            starts = processed_count + np.flatnonzero(is_regular)
            processed_count = len(self.nodes)
            # The second call leaves out paths that the first one followed from their other
            # end.
            self._follow_unknown_paths(starts, upwards)
            self._follow_unknown_paths(starts, downwards)
        if processed_count < len(self.nodes):
            self.limit_note = (
                f"stopped at {len(self.nodes)} configurations before paths from "
                f"{len(self.nodes) - processed_count} of them were followed"
            )

    def _follow_unknown_paths(self, starts: Indices, directions: Indices) -> None:
        """Follow the paths that were not yet followed from their other end.

        A path leads from a configuration to a neighbouring sample of the grid of inputs. It
        is known if it was followed before in the opposite direction, from the configuration
        at the neighbouring sample.

        Parameters
        ----------
        starts
            Indices of the configurations.
        directions
            Directions of the grid, numbered as in `neighbours`. A path starts at each
            configuration in each direction.
        """
        # Rows are the configurations, columns are the directions.
        needs_path = ~self.is_path_known[np.ix_(starts, directions)]
        start_rows, direction_columns = np.nonzero(needs_path)
        self._follow_paths(starts[start_rows], directions[direction_columns])

    def _follow_paths(self, starts: Indices, directions: Indices) -> None:
        """Follow straight paths of the inputs, and connect configurations at their ends.

        A path leads from a configuration to a neighbouring sample of the inputs. It is
        followed by steps that cannot pass a singularity of type II (the output can move
        while the inputs rest). A new configuration at its end is added to the graph. Both
        ends are connected if they are not singular.

        Connected configurations are an aspect (a part without singularities). Singularities
        of type I (inputs can move while the output rests) may divide aspects, too. In this
        case the ends are connected only if a determinant that vanishes at type I keeps its
        sign on the path.

        Parameters
        ----------
        starts
            (n,) indices of the configurations at which paths start.
        directions
            (n,) direction of the grid in which each path leads: 2 k upwards along input k,
            2 k + 1 downwards.
        """
        goal_samples = self.neighbours[directions, self.nodes.sample[starts]]
        has_goal = goal_samples >= 0
        starts = starts[has_goal]
        directions = directions[has_goal]
        goal_samples = goal_samples[has_goal]
        values = self.nodes.values[starts]
        goals = self.input_grid.q[goal_samples]
        # The inputs of a configuration can differ from those of its sample by whole periods
        # (growths after which configurations repeat). The goals get the same periods, so
        # that the paths are short.
        goals += whole_laps(values[:, self.driven] - goals, self.solver.periods)
        followed = follow_inputs(self.solver.closure, self.driven, values, goals)
        end_nodes = followed.nodes
        arrived = followed.status == Status.OK
        ends = self.add_configurations(end_nodes.values[arrived], goal_samples[arrived])
        # The paths back are the same, and need not be followed.
        ways_back = _opposite_directions(directions[arrived])
        self.is_path_known[ends, ways_back] = True
        pairs = np.stack([starts[arrived], ends], axis=1)
        is_connected = np.all(self.nodes.is_regular[pairs], axis=1)
        if self.divides_by_type_one:
            # (paths, inputs) how far each input moves on each path.
            input_changes = (end_nodes.values - values)[arrived][:, self.driven]
            is_connected &= self._keeps_sign_of_type_one(pairs, input_changes)
        self.connections.append(pairs[is_connected])

    def _keeps_sign_of_type_one(self, pairs: Indices, input_changes: Floats) -> Bools:
        """Return whether the determinant of type I keeps its sign on paths of the inputs.

        On a straight path of the inputs, all inputs change in proportion. The determinant
        vanishes at singularities of type I, where inputs can move while the output rests.
        If it may change its sign, the caller does not connect the ends of the path.

        On a path the determinant is interpolated by a cubic from its values and slopes at
        both ends. The cubic has no zero if its four Bernstein coefficients have the same
        sign.

        Parameters
        ----------
        pairs
            (n, 2) indices of the configurations at the start and end of each path.
        input_changes
            (n, g) changes of the g inputs along the path (rad).
        """
        start_value, end_value = self.nodes.determinant_one[pairs].T
        # Derivatives with respect to the position on the path, which rises from 0 to 1:
        # the scalar products of (n, 2, g) derivatives with respect to the inputs with
        # the changes (n, g).
        slopes = np.matvec(self.nodes.slope_one[pairs], input_changes)
        start_slope, end_slope = slopes.T
        coefficients = [
            start_value,
            start_value + start_slope / 3.0,
            end_value - end_slope / 3.0,
            end_value,
        ]
        is_positive = np.all([c > 0.0 for c in coefficients], axis=0)
        is_negative = np.all([c < 0.0 for c in coefficients], axis=0)
        return is_positive | is_negative

    def label_aspects(self, free_of: tuple[LocusName, ...]) -> Aspects:
        """Return the regular configurations with their aspects.

        An aspect is a part of the configurations that is connected without a singularity.
        Aspects are the connected components of the graph, and the largest one has number 0.

        Parameters
        ----------
        free_of
            The types of singularity ("I", "II") that divide aspects, for which the graph
            was built. The result states these types.
        """
        # Indices of the regular configurations among all, rising.
        regular_numbers = np.flatnonzero(self.nodes.is_regular)
        nodes = self.nodes.rows(regular_numbers)
        # (m, 2) each connection joins two regular configurations. Indices among all
        # configurations are converted to positions among the regular ones.
        edges = np.searchsorted(regular_numbers, np.concatenate(self.connections))
        # (n,) number of the aspect of each configuration.
        label = _number_by_size(label_components(len(regular_numbers), edges))
        sizes = np.bincount(label)
        # The signs of two determinants tell aspects apart. `determinant_two` is zero at
        # type II, where the output can move while the inputs rest. `determinant_one` is
        # zero at type I, where inputs can move while the output rests.
        determinant_two = nodes.determinant_two
        determinant_one = nodes.determinant_one
        if not self.has_sign_of_type_one:
            # `determinant_one` is never negative in this mechanism, so its sign tells
            # nothing. Zeros have the sign 0.
            determinant_one = np.zeros_like(determinant_one)
        return Aspects(
            input_grid=self.input_grid,
            # A sample is a row of the input grid.
            row=nodes.sample,
            values=nodes.values,
            inputs=nodes.values[:, self.driven],
            label=label,
            sizes=sizes,
            # For each aspect, the sign of a determinant in all its configurations. It is 0
            # if they have no common sign.
            sign_two=_common_signs(determinant_two, label, sizes),
            sign_one=_common_signs(determinant_one, label, sizes),
            # For each aspect, the largest number of its configurations at one sample.
            modes=_most_modes_at_a_sample(label, nodes.sample, len(sizes)),
            free_of=free_of,
            # The number of singular configurations, which belong to no aspect.
            singular=len(self.nodes) - len(regular_numbers),
            note="; ".join(filter(None, [self.limit_note, self.time_limit.note])),
        )


def _opposite_directions(directions: Indices) -> Indices:
    """Return the opposite of each direction (n,) in a grid of inputs.

    Direction 2 k leads to the next value of input k, and 2 k + 1 to the previous one.
    """
    leads_upwards = directions % 2 == 0
    return np.where(leads_upwards, directions + 1, directions - 1)


def _number_by_size(label: Indices) -> Indices:
    """Renumber aspects by their size, so that the largest one has number 0.

    An aspect is a set of configurations that are connected without a singularity. Aspects
    of the same size keep their order.

    Parameters
    ----------
    label
        (n,) old number of the aspect of each configuration.

    Returns
    -------
    (n,) new number of the aspect of each configuration.
    """
    sizes = np.bincount(label)
    old_numbers = np.argsort(-sizes, kind="stable")
    new_numbers = np.empty_like(old_numbers)
    new_numbers[old_numbers] = np.arange(len(sizes))
    return new_numbers[label]


def _most_modes_at_a_sample(
    label: Integers, sample: Integers, aspect_count: int
) -> Integers:
    """Return the largest number of configurations that each aspect has at one sample.

    An aspect is a set of configurations that are connected without a singularity. Several
    configurations at one sample of the inputs are different assembly modes: ways to
    assemble the mechanism. If the number exceeds one, the mechanism can change its assembly
    mode within the aspect, without a singularity.

    Parameters
    ----------
    label, sample
        (n,) aspect and sample of each configuration.
    aspect_count
        Number of aspects.

    Returns
    -------
    (aspects,) numbers of configurations.
    """
    # One column for each aspect and sample at which it has configurations.
    aspect_and_sample, mode_counts = np.unique(
        np.stack([label, sample]), axis=1, return_counts=True
    )
    most_modes = np.zeros(aspect_count, dtype=np.int64)
    np.maximum.at(most_modes, aspect_and_sample[0], mode_counts)
    return most_modes


def _common_signs(values: Floats, label: Integers, sizes: Integers) -> SmallIntegers:
    """Return, for each aspect, the common sign of all values, or 0 if the signs differ.

    An aspect is a part of the configurations that is connected without a singularity.

    Parameters
    ----------
    values, label
        (n,) values at configurations, and the aspect of each.
    sizes
        (aspects,) number of configurations of each aspect.
    """
    sum_of_signs = np.bincount(label, np.sign(values), len(sizes))
    is_common = np.abs(sum_of_signs) == sizes
    return np.where(is_common, np.sign(sum_of_signs), 0.0).astype(np.int8)
