"""A graph of configurations at samples of several inputs, divided into assembly modes.

Each node of the graph is one configuration at one sample of an `InputGrid`. An edge joins
two nodes at neighbouring samples if a verified path leads from one to the other. The inputs
move on a straight line from sample to sample along such a path, and each step of it is
verified (`spherekit.positions.input_paths`). A verified path passes no singular
configuration. A verified path can therefore be followed in both directions, and each start
has at most one end.

A connected component of the graph can have several configurations at one sample. This
occurs if a loop of paths around inputs at which modes meet leads from one of them to
another. Such a component is divided into assembly modes with at most one configuration per
sample:

1. A piece is a set of nodes with at most one node per sample. Each node begins as a piece
   of its own. An edge unites the two pieces of its ends, unless they share a sample.
2. Pieces of one component that share no sample are put into one mode, the largest first.

The order of these steps depends only on the nodes, so the modes are the same in every run.
Each configuration belongs to exactly one mode.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.input_paths import (
    determinant_sign,
    follow_inputs,
    is_nearly_singular,
)
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.position_solver import PositionSolver
from spherekit.progress import ProgressReporter
from spherekit.status import Status

SAME_CONFIGURATION_RAD = 1e-6
"""Configurations of one sample whose angles all differ by less are one node. Larger:
different modes near a meeting are taken for one; smaller: one configuration can become two
nodes."""
SINGULAR_NODE_RATIO = 1e-8
"""Largest reciprocal condition number of a singular configuration.

The number belongs to the closure Jacobian without the columns of the inputs. No path starts
from a singular node. Larger: more nodes are joined to no other; smaller: signs of
determinants can be rounding.
"""
SMALLEST_STEP_RAD = 1e-7
"""A path between two samples that needs a smaller step of the inputs fails. It passes so
near to a singular configuration that smaller steps cost time and join hardly any more
nodes."""
PATHS_AT_ONCE = 4096
"""Number of paths that are followed together. More need more memory; fewer take longer."""
PORTION_GROWTH = 2
"""Growth, from round to round, of the number of paths that are tried for each piece. Away
from inputs at which modes meet, one path joins two pieces; near them, many have to be
tried."""


@dataclass(frozen=True)
class DeterminantSigns:
    """Signs of the closure Jacobians of m configurations, with the inputs locked.

    The sign changes only at singular configurations, where assembly modes meet, so it helps
    to tell modes apart.

    Attributes
    ----------
    sign
        (m,) sign of the determinant.
    is_regular
        (m,) whether the sign is reliable. Near a singular configuration rounding decides.
    """

    sign: Floats
    is_regular: Bools

    def select(self, chosen: Indices) -> "DeterminantSigns":
        """Return the signs of some of the m configurations, by their indices."""
        return DeterminantSigns(self.sign[chosen], self.is_regular[chosen])


class NodeEdges(NamedTuple):
    """Edges of the configuration graph, by the nodes that they join.

    A node is one configuration of the mechanism at one sample of the inputs. There are two
    kinds of edges:

    - A verified path leads from one configuration to another at a neighbouring sample.
    - Both configurations are in a sheet: a set of configurations that paths reach from one
      start (see `ConfigurationGraph.add_sheet`). Their samples need not be neighbours.

    Attributes
    ----------
    starts, ends
        (m,) node at the start and at the end of each edge.
    """

    starts: Indices
    ends: Indices


class NodeTable:
    """The samples of all nodes, and the nodes of all samples.

    A node is one configuration of the mechanism at one sample (choice of the inputs). A
    sample can have several nodes. Nodes are numbered from 0 in the order in which they are
    added.

    Attributes
    ----------
    sample
        (k,) index of the sample of each node.
    """

    def __init__(self, sample_count: int) -> None:
        """Begin without nodes at the samples."""
        self.sample = np.empty(0, dtype=np.intp)
        self._sample_count = sample_count
        # (samples, largest number of nodes of a sample): row s lists the nodes of sample s,
        # padded by -1.
        self._nodes_of_sample = np.full((sample_count, 0), -1, dtype=np.intp)

    def append(self, sample: Indices) -> Indices:
        """Add nodes at samples (m,), and return the indices (m,) of the new nodes."""
        first_new_node = len(self.sample)
        self.sample = np.append(self.sample, sample)
        # Make the table of the nodes anew. The table has a row for each sample. The i-th
        # node of a sample is in column i, and unused places are -1.
        column = _number_within_groups(self.sample)
        column_count = np.max(column, initial=-1) + 1
        shape = (self._sample_count, column_count)
        self._nodes_of_sample = np.full(shape, -1, dtype=np.intp)
        self._nodes_of_sample[self.sample, column] = np.arange(len(column))
        return np.arange(first_new_node, len(self.sample))

    def list_nodes_at(self, sample: Indices) -> Indices:
        """Return all nodes (m, largest number of nodes) of samples (m,), padded by -1."""
        return self._nodes_of_sample[sample]


class NodePieces:
    """The division of the nodes into pieces, from which assembly modes are made.

    A node is one configuration at one sample of the inputs. An assembly mode (one way to
    assemble the links) has at most one node per sample. A piece is a set of nodes that
    paths join, with at most one node per sample. A new node is a piece of its own. Pieces
    that a path joins are united, unless both have a node at the same sample.

    Attributes
    ----------
    piece_of_node
        (k,) identifier of the piece of each node.
    """

    def __init__(self, node_table: NodeTable) -> None:
        """Begin without pieces of the nodes in a table."""
        self.piece_of_node = np.empty(0, dtype=np.intp)
        self._node_table = node_table
        # The nodes of each piece, by its identifier, in the parts that were united.
        self._parts: dict[int, list[Indices]] = {}

    def __len__(self) -> int:
        """Return the number of pieces."""
        return len(self._parts)

    def append(self, new_nodes: Indices) -> None:
        """Make each of the new nodes (m,) a piece. Its identifier is the node."""
        self.piece_of_node = np.append(self.piece_of_node, new_nodes)
        self._parts |= {node: [np.array([node])] for node in new_nodes.tolist()}

    def have_nodes_at(self, piece: Indices | int, sample: Indices) -> Bools:
        """Return whether pieces have nodes at samples (m,).

        A piece is a set of joined nodes (configurations) with at most one node per sample
        of the inputs. Pieces with nodes at the same sample cannot be united.

        `piece` is the identifier of one piece, or of a piece (m,) for each sample.
        """
        nodes = self._node_table.list_nodes_at(sample)
        is_in_piece = self.piece_of_node[nodes] == np.asarray(piece)[..., None]
        return np.any((nodes >= 0) & is_in_piece, axis=1)

    def unite(self, first_node: int, second_node: int) -> None:
        """Unite the pieces of two nodes, unless these pieces share a sample.

        A node is one configuration at one sample of the inputs. A piece is a set of joined
        nodes with at most one node per sample. Assembly modes are later made of pieces, and
        a mode may have only one configuration per sample.
        """
        larger = int(self.piece_of_node[first_node])
        smaller = int(self.piece_of_node[second_node])
        if larger == smaller:
            return
        if self._count_nodes(larger) < self._count_nodes(smaller):
            larger, smaller = smaller, larger
        # The nodes of the smaller piece get the identifier of the larger one. `_parts` has
        # the nodes of each piece, in several arrays.
        moved_nodes = np.concatenate(self._parts[smaller])
        moved_samples = self._node_table.sample[moved_nodes]
        if np.any(self.have_nodes_at(larger, moved_samples)):
            return
        self.piece_of_node[moved_nodes] = larger
        self._parts[larger].append(moved_nodes)
        del self._parts[smaller]

    def _count_nodes(self, piece: int) -> int:
        """Return the number of nodes of a piece."""
        return sum(map(len, self._parts[piece]))

    def sort_by_size(self) -> list[Indices]:
        """Return the nodes (m,) of each piece in rising order, the largest piece first."""
        pieces = [np.sort(np.concatenate(parts)) for parts in self._parts.values()]
        return sorted(pieces, key=lambda nodes: (-len(nodes), int(nodes[0])))


class ConfigurationGraph:
    """Configurations at the n samples of an input grid, and the paths that join them.

    A sample is one choice of the inputs. Each configuration at a sample is a node. Joined
    nodes become assembly modes (ways to assemble the links). A mode has at most one node at
    each sample. Nodes are numbered 0 to k - 1 as they are added. A direction is a row of
    `InputGrid.neighbours`: row 2 a leads to the next sample along axis a (an input), and
    row 2 a + 1 to the previous sample. The opposite direction is ``direction ^ 1``.

    Parameters
    ----------
    solver
        The mechanism, ready to be evaluated.
    input_grid
        The n samples of its inputs.

    Attributes
    ----------
    values
        (k, variables) configuration of each node (rad).
    is_complete
        (n,) whether all configurations of a sample are nodes already; False until the
        caller sets it to True. Only paths to samples that are not complete can lead to new
        nodes.
    """

    def __init__(self, solver: PositionSolver, input_grid: InputGrid) -> None:
        """Start with an empty graph of configurations at the n samples of a grid.

        A sample is one choice of the inputs. A node of the graph is one closed
        configuration of the mechanism at one sample. An edge is a verified path between two
        nodes at neighbouring samples.

        Parameters
        ----------
        solver
            The mechanism, ready to be evaluated.
        input_grid
            The n samples of its inputs.
        """
        self.solver = solver
        self.input_grid = input_grid
        variables = len(solver.mechanism.variable_owners)
        # (k, variables) values of the pair variables (rad) of the k nodes.
        self.values = np.empty((0, variables))
        # (n,) whether all configurations of a sample are nodes. The caller sets it.
        self.is_complete = np.zeros(len(input_grid), dtype=bool)
        # Indices of the variables of the inputs.
        self._driven = list(solver.driven)
        # Indices of the variables that are angles of R pairs. Configurations at a sample
        # are equal if these angles are equal. The other variables, which are arc lengths
        # along profiles at contacts, are not compared.
        self._angles = solver.angles
        # (k,) sign of the determinant of the closure Jacobian with locked inputs (without
        # their columns). It helps to tell assembly modes apart.
        self._determinant_sign = np.empty(0)
        # (k,) whether this matrix is so far from singular that rounding cannot change the
        # sign.
        self._is_regular = np.empty(0, dtype=bool)
        # The samples of all nodes, and the nodes of all samples.
        self._node_table = NodeTable(len(input_grid))
        # Pieces are sets of joined nodes with at most one node per sample.
        self._pieces = NodePieces(self._node_table)
        # (directions, n) sample next to each sample in each direction, or -1. There are two
        # directions for each axis of the grid: 2 a leads to the next sample along axis a,
        # and 2 a + 1 to the previous one.
        self._neighbours = input_grid.neighbours()
        # (directions, k) whether a path that starts at the node was tried in the direction.
        self._is_tried = np.empty((len(self._neighbours), 0), dtype=bool)
        # (directions, k) whether the node is the end of a verified path that was followed
        # in the direction, from the sample before.
        self._is_reached = np.empty((len(self._neighbours), 0), dtype=bool)
        # The nodes at the start and at the end of each edge.
        self._edges: list[NodeEdges] = []
        self._progress = ProgressReporter(
            "joining the configurations of neighbouring samples"
        )

    @property
    def sample(self) -> Indices:
        """(k,) index of the sample of each node."""
        return self._node_table.sample

    def add(self, sample: Indices, values: Floats) -> Indices:
        """Add configurations as nodes of the graph, and return the node of each.

        A node is one configuration at one sample (choice of the inputs). A new node is
        joined to nodes at neighbouring samples later. Sets of joined nodes are called
        pieces.

        Parameters
        ----------
        sample
            (m,) index of the sample of each configuration.
        values
            (m, variables) closed configurations (rad). A configuration that is a node
            already is not added again. Configurations that are equal to each other become
            one node.

        Returns
        -------
        (m,) node of each configuration, new or already present. Each new node is a piece of
        its own.
        """
        # `find` returns -1 for a configuration that is no node yet.
        nodes = self.find(sample, values)
        (missing,) = np.nonzero(nodes < 0)
        if len(missing):
            nodes[missing] = self._add_missing(sample[missing], values[missing])
        return nodes

    def _add_missing(self, sample: Indices, values: Floats) -> Indices:
        """Add configurations that are no nodes yet, equal ones as a single node.

        A node is one configuration at one sample (choice of the inputs). Configurations
        whose closure Jacobians have determinants of opposite signs do not count as equal,
        because a singular configuration separates them. A nearly singular configuration has
        no reliable sign, so it can be equal to two others that have opposite signs.
        Depending on their order, all three may then become one node.

        Parameters
        ----------
        sample
            (m,) index of the sample of each configuration.
        values
            (m, variables) closed configurations (rad).

        Returns
        -------
        (m,) node of each configuration.
        """
        signs = self._determinant_signs(values)
        # Of equal configurations only the first becomes a node, which represents all of
        # them. `representative` has its index for each configuration, so the first one has
        # its own index.
        representative = self._find_equal(sample, values, signs)
        (rows_of_new_nodes,) = np.nonzero(representative == np.arange(len(sample)))
        new_nodes = self._append_nodes(
            sample[rows_of_new_nodes],
            values[rows_of_new_nodes],
            signs=signs.select(rows_of_new_nodes),
        )
        # For each configuration, the position of its representative among the new nodes.
        # `searchsorted` finds it, because `rows_of_new_nodes` is in ascending order.
        position = np.searchsorted(rows_of_new_nodes, representative)
        return new_nodes[position]

    def _determinant_signs(self, values: Floats) -> DeterminantSigns:
        """Return the signs of the determinants of closure Jacobians with locked inputs.

        The sign changes only at singular configurations, so it helps to tell assembly modes
        apart. Near a singular configuration the sign is not reliable. `values` are (m,
        variables) closed configurations (rad).
        """
        linearisation = self.solver.closure.linearise(values)
        # Locked inputs have no columns in the Jacobian. `_driven` has the indices of the
        # inputs.
        passive_jacobian = np.delete(linearisation.jacobian, self._driven, axis=2)
        return DeterminantSigns(
            sign=determinant_sign(passive_jacobian),
            is_regular=~is_nearly_singular(
                linearisation, self._driven, SINGULAR_NODE_RATIO
            ),
        )

    def _append_nodes(
        self, sample: Indices, values: Floats, signs: DeterminantSigns
    ) -> Indices:
        """Append new nodes to all arrays of the graph that have one item for each node.

        A node is one configuration at one sample (choice of the inputs). A new node is not
        joined to others, so it is a piece of its own. Paths lead from a node to a
        neighbouring sample. No path starts or ends at a new node.

        Parameters
        ----------
        sample, values
            (m,) sample of each new node, and (m, variables) its configuration (rad).
        signs
            The signs of the determinants of the closure Jacobians, with locked inputs, at
            the new nodes.

        Returns
        -------
        (m,) indices of the new nodes.
        """
        new_nodes = self._node_table.append(sample)
        self._pieces.append(new_nodes)
        self.values = np.concatenate([self.values, values])
        self._determinant_sign = np.append(self._determinant_sign, signs.sign)
        self._is_regular = np.append(self._is_regular, signs.is_regular)
        # For each direction in the grid of inputs (rows) and each node (columns): whether a
        # path from the node was tried, and whether a path ends at the node.
        direction_count = len(self._neighbours)
        no_paths = np.zeros((direction_count, len(sample)), dtype=bool)
        self._is_tried = np.concatenate([self._is_tried, no_paths], axis=1)
        self._is_reached = np.concatenate([self._is_reached, no_paths], axis=1)
        return new_nodes

    def _find_equal(
        self, sample: Indices, values: Floats, signs: DeterminantSigns
    ) -> Indices:
        """Return, for each configuration, the one of them that represents it.

        The representative is the earliest configuration that is equal. If this one is
        itself represented by an even earlier one, the even earlier one represents both.

        Parameters
        ----------
        sample
            (m,) index of the sample (choice of the inputs) of each configuration.
        values
            (m, variables) configurations (rad).
        signs
            Signs of the determinants of their closure Jacobians. Configurations with
            opposite signs differ, because a singular configuration separates them. A nearly
            singular configuration has no reliable sign.

        Returns
        -------
        (m,) index of the representative, which can be the configuration itself. Equal means
        the same sample, no opposite sign, and the same angles of R pairs up to
        `SAME_CONFIGURATION_RAD`.
        """
        # In the beginning, each configuration represents itself.
        representative = np.arange(len(sample))
        reliable_signs = np.where(signs.is_regular, signs.sign, 0.0)
        # All pairs of configurations at the same sample. The first pass of the loop
        # compares each with the one before it, the next pass with the one before that, and
        # so on. A later pass overwrites the result of a pass before. So the earliest equal
        # configuration remains.
        for earlier, later in _pairs_with_equal_keys(sample):
            # The product is 0 if one sign is not reliable.
            has_no_opposite_sign = reliable_signs[earlier] * reliable_signs[later] >= 0.0
            earlier = earlier[has_no_opposite_sign]
            later = later[has_no_opposite_sign]
            # `_angles` has the indices of the variables that are angles of R pairs.
            differences = wrap(values[earlier] - values[later])[:, self._angles]
            is_same = max_abs(differences, axis=1) < SAME_CONFIGURATION_RAD
            representative[later[is_same]] = earlier[is_same]
        # A representative may itself be represented by an earlier configuration. Go on to
        # the first one.
        while np.any(representative != representative[representative]):
            representative = representative[representative]
        return representative

    def find(self, sample: Indices, values: Floats) -> Indices:
        """Return the nodes that are equal to some configurations.

        A node is one stored configuration at one sample (choice of the inputs).

        Parameters
        ----------
        sample
            (m,) index of the sample of each configuration.
        values
            (m, variables) configurations (rad).

        Returns
        -------
        (m,) the nearest node of the same sample, if all its angles of R pairs differ by
        less than `SAME_CONFIGURATION_RAD`; otherwise -1.
        """
        nodes = np.full(len(sample), -1, dtype=np.intp)
        if not len(self.sample):
            return nodes
        # Chunks limit the memory for the differences between configurations and nodes.
        for first in range(0, len(sample), PATHS_AT_ONCE):
            chunk = slice(first, first + PATHS_AT_ONCE)
            nodes_of_sample = self._node_table.list_nodes_at(sample[chunk])
            nodes[chunk] = self._find_among(nodes_of_sample, values[chunk])
        return nodes

    def _find_among(self, candidates: Indices, values: Floats) -> Indices:
        """Return, for each configuration, the candidate node with the same angles.

        Compared are the angles of R pairs (revolute pairs), up to `SAME_CONFIGURATION_RAD`.

        Parameters
        ----------
        candidates
            (m, c) nodes (stored configurations) with which each configuration is compared.
            Unused places are -1.
        values
            (m, variables) configurations (rad).

        Returns
        -------
        (m,) the nearest candidate, or -1 if it differs from the configuration.
        """
        # (m, c, variables) differences. `_angles` has the indices of the variables that are
        # angles of R pairs.
        differences = wrap(self.values[candidates] - values[:, None])
        angle_differences = differences[..., self._angles]
        # (m, c) distances, infinite for unused places.
        largest_differences = max_abs(angle_differences, axis=2)
        distances = np.where(candidates < 0, np.inf, largest_differences)
        # The nearest candidate of each configuration.
        rows = np.arange(len(values))
        nearest = np.argmin(distances, axis=1)
        is_same = distances[rows, nearest] < SAME_CONFIGURATION_RAD
        return np.where(is_same, candidates[rows, nearest], -1)

    def add_sheet(self, values: Floats) -> None:
        """Add the configurations of a sheet as nodes, and join them.

        A sheet is the set of configurations that paths over the grid of inputs reach from
        one start, at most one per sample (choice of the inputs). All of them belong to one
        assembly mode (way to assemble the links).

        Parameters
        ----------
        values
            (n, variables) configurations (rad) of the sheet at all samples of the grid. The
            row of a sample that the sheet does not reach is NaN.
        """
        (sample,) = np.nonzero(np.all(np.isfinite(values), axis=1))
        old_node_count = len(self.sample)
        # If a configuration is a node already, `add` returns this node, not a new one.
        nodes = self.add(sample, values[sample])
        # Edges from each node to the next make the whole sheet one connected component of
        # the graph.
        self._edges.append(NodeEdges(starts=nodes[:-1], ends=nodes[1:]))
        # A connected component can have several nodes at one sample, but an assembly mode
        # has at most one. Modes are therefore made from pieces: sets of joined nodes with
        # at most one node per sample. Unite the nodes of the sheet to a piece. New nodes
        # come first, because they can always be united. The piece of an earlier node may
        # share a sample with them and then stays separate.
        new_nodes = nodes[nodes >= old_node_count]
        earlier_nodes = nodes[nodes < old_node_count]
        ordered_nodes = np.concatenate([new_nodes, earlier_nodes]).tolist()
        for node in ordered_nodes[1:]:
            self._pieces.unite(ordered_nodes[0], node)

    def find_unbalanced(self) -> Bools:
        """Return a mask of the samples (input choices) at which a configuration is missing.

        Each configuration has the sign of the determinant of its closure Jacobian (without
        the inputs). At each sample, the signs of all configurations add up to zero. The
        reason is that configurations appear and vanish only in pairs with opposite signs
        when sizes or inputs change. A sum that is not zero shows that a configuration was
        not found.

        Returns
        -------
        (n,) whether the sum of the signs at a sample is not zero. False for samples with a
        singular configuration, which has no sign.
        """
        # A node is one configuration at one sample. Over the nodes of each sample, the
        # signs are added up, and the singular nodes are counted, which have no sign.
        count = len(self.input_grid)
        signs = np.where(self._is_regular, self._determinant_sign, 0.0)
        sign_sums = np.bincount(self.sample, weights=signs, minlength=count)
        singular_counts = np.bincount(
            self.sample, weights=~self._is_regular, minlength=count
        )
        return (sign_sums != 0.0) & (singular_counts == 0)

    def join(self) -> None:
        """Join nodes at neighbouring samples by paths, until the assembly modes are known.

        A node is a configuration at one sample (choice of the inputs). The samples form a
        grid with one axis for each input. A path follows a configuration while the inputs
        move to the next sample along an axis. A piece is a set of joined nodes with at most
        one node per sample. Pieces are united, and become the assembly modes in the end.

        First, paths along the last axis of the grid make long pieces. After this, paths are
        followed along the other axes. They are followed in rounds, with few paths from each
        piece in the first round, because one path is often enough to join two long pieces.
        A path joins two nodes whichever of them it starts from. So paths are at first
        followed in only one of the two directions of each axis, and later in both.

        A path can end at a new configuration, which becomes a node.
        """
        # Direction 2 a leads to the next sample along axis a, and 2 a + 1 to the previous
        # one. `_neighbours` has a row for each direction.
        direction_count = len(self._neighbours)
        axis_count = direction_count // 2
        back_along_last_axis = 2 * (axis_count - 1) + 1
        # The nodes from which a path may join two pieces.
        starts = self._find_useful_starts(back_along_last_axis)
        self._join_along_paths(starts, back_along_last_axis)
        # Follow paths to previous samples, from the last axis but one to the first axis.
        for axis in range(axis_count - 2, -1, -1):
            self._join_in_directions([2 * axis + 1])
        # Follow paths in all directions, because new nodes may have been added.
        self._join_in_directions(range(direction_count))

    def _join_in_directions(self, directions: Sequence[int]) -> None:
        """Follow paths in some directions until no untried path can join two pieces.

        A piece is a set of joined nodes (configurations at samples of the inputs) with at
        most one node per sample. Pieces become the assembly modes. A path leads from a node
        to the next sample in a direction of the grid.

        One path is often enough to join two pieces, so few paths are followed for each
        piece in the first round. The number of paths grows from round to round, because
        many are needed near inputs at which assembly modes meet.

        Parameters
        ----------
        directions
            Indices of directions: 2 a leads to the next sample along axis a of the grid,
            and 2 a + 1 to the previous one.
        """
        paths_per_piece = 1
        while True:
            # The number of paths that are followed in this round.
            path_count = 0
            for direction in directions:
                nodes = self._select_starts(direction, paths_per_piece)
                path_count += len(nodes)
                self._join_along_paths(nodes, direction)
            if not path_count:
                return
            paths_per_piece *= PORTION_GROWTH

    def _find_useful_starts(self, direction: int) -> Indices:
        """Return the nodes from which an untried path in a direction may join two pieces.

        A path leads from a node (a configuration at a sample of the inputs) to the
        neighbouring sample. A piece is a set of joined nodes with at most one node per
        sample. A path is useful under two conditions. First, the piece of its start has no
        node at the neighbouring sample. Second, the path can end at a node or a new
        configuration there.

        Parameters
        ----------
        direction
            Direction in the grid of inputs: 2 a leads to the next sample along axis a, and
            2 a + 1 to the previous one.

        Returns
        -------
        (m,) nodes in rising order.
        """
        # Sample at which a path from each node ends, -1 at the border of the grid.
        target = self._neighbours[direction][self.sample]
        # No path can be followed from a singular node, which is not regular. `_is_tried` is
        # true for nodes from which a path in the direction was followed before.
        can_start = (target >= 0) & self._is_regular & ~self._is_tried[direction]
        (starts,) = np.nonzero(can_start)
        useful_starts = [np.empty(0, dtype=np.intp)]
        # Portions limit the memory, since each start is compared with all nodes at its
        # target.
        for first in range(0, len(starts), PATHS_AT_ONCE):
            portion = starts[first : first + PATHS_AT_ONCE]
            can_join = self._can_have_end(portion, direction)
            own_pieces = self._pieces.piece_of_node[portion]
            can_join &= ~self._pieces.have_nodes_at(own_pieces, target[portion])
            useful_starts.append(portion[can_join])
        return np.concatenate(useful_starts)

    def _can_have_end(self, starts: Indices, direction: int) -> Bools:
        """Return whether paths in a direction can end at a configuration.

        A path leads from a node (a configuration at a sample of the inputs) to the
        neighbouring sample. The path can end at a node there that is not singular, has the
        same sign of the determinant of the closure Jacobian, and is not the end of another
        path in this direction. If configurations may be missing among the nodes of the
        sample, the path can also end at a new configuration. The caller follows only paths
        that can have an end.

        Parameters
        ----------
        starts
            (m,) nodes at which the paths start.
        direction
            Direction in the grid of inputs, in which all starts have a neighbouring sample.

        Returns
        -------
        (m,) whether the path from each start can have an end.
        """
        # (m,) samples to which the paths lead.
        target = self._neighbours[direction][self.sample[starts]]
        # All nodes at the target of each path: (m, nodes of a sample). Unused places are
        # -1, and `is_node` excludes them.
        ends = self._node_table.list_nodes_at(target)
        is_node = ends >= 0
        is_regular = self._is_regular[ends]
        # Nodes that are the end of another path in this direction are reached.
        is_free = ~self._is_reached[direction][ends]
        has_sign_of_start = (
            self._determinant_sign[ends] == self._determinant_sign[starts, None]
        )
        can_be_end = is_node & is_regular & is_free & has_sign_of_start
        can_end_at_node = np.any(can_be_end, axis=1)
        # A sample is complete if all its configurations are nodes already.
        can_end_at_new_node = ~self.is_complete[target]
        return can_end_at_node | can_end_at_new_node

    def _select_starts(self, direction: int, paths_per_piece: int) -> Indices:
        """Return the nodes from which paths in a direction are followed next.

        A node is a configuration at a sample of the inputs. A piece is a set of joined
        nodes. One path is often enough to join two pieces, so only a few paths are selected
        from each piece.

        The number is limited for each block of samples to which the paths lead, so that
        they are spread over the grid. Samples belong to one block if they differ only in
        inputs whose axes come after the axis of the path. In a grid of two inputs, for
        example, a block for paths along axis 0 is a row of samples with one value of the
        first input.

        Parameters
        ----------
        direction
            Direction in the grid of inputs: 2 a leads to the next sample along axis a, and
            2 a + 1 to the previous one.
        paths_per_piece
            Largest number of paths from one piece to one block.

        Returns
        -------
        (m,) nodes in rising order. A path from each of them may join two pieces.
        """
        starts = self._find_useful_starts(direction)
        # The samples to which the paths lead, and the block of each.
        target = self._neighbours[direction][self.sample[starts]]
        # Samples are numbered with the last axis running fastest, so the samples of a block
        # have successive numbers. In a grid of 3 x 5 samples, for example, the first block
        # of axis 0 has the samples 0 to 4.
        axis = direction // 2
        samples_per_block = int(np.prod(self.input_grid.shape[axis + 1 :], dtype=np.intp))
        block = target // samples_per_block
        # Number the paths from one piece to one block (0, 1, ...), and take the first ones.
        own_pieces = self._pieces.piece_of_node[starts]
        number_within_piece_and_block = _number_within_groups(own_pieces, block)
        return starts[number_within_piece_and_block < paths_per_piece]

    def _join_along_paths(self, nodes: Indices, direction: int) -> None:
        """Follow paths from nodes to the next samples in a direction, and join their ends.

        A node is one closed configuration at one sample of the inputs. A path leads from a
        node to a configuration at the neighbouring sample, which is added to the nodes. A
        path is sound if it cannot have jumped to another assembly mode. The pieces of its
        two nodes are united, unless they have nodes at the same sample. These attributes
        are updated:

        - `_is_tried`: whether a path from a node in a direction was followed,
        - `_is_reached`: whether a path that was followed in a direction ends at a node,
        - `_edges`: the nodes at the starts and at the ends of the paths,
        - `_pieces`: the sets of joined nodes with at most one node per sample.

        Parameters
        ----------
        nodes
            (m,) nodes at which the paths start.
        direction
            Row of `InputGrid.neighbours`: 2 a leads to the next sample along axis a, and
            2 a + 1 to the previous one. All nodes have a neighbour in this direction.
        """
        self._is_tried[direction, nodes] = True
        # Nodes from this number on are new: they are added at the ends of these paths.
        old_node_count = len(self.sample)
        starts, ends = self._find_ends_of_paths(nodes, direction)
        # Paths that are not sound join no nodes.
        is_sound = self._are_paths_sound(starts, ends, direction, old_node_count)
        starts = starts[is_sound]
        ends = ends[is_sound]
        self._is_reached[direction, ends] = True
        # Each path also leads back, from its end to its start. The directions 2 a and
        # 2 a + 1 are opposite.
        opposite_direction = direction + 1 if direction % 2 == 0 else direction - 1
        self._is_tried[opposite_direction, ends] = True
        self._is_reached[opposite_direction, starts] = True
        self._edges.append(NodeEdges(starts, ends))
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            self._pieces.unite(start, end)

    def _find_ends_of_paths(
        self, nodes: Indices, direction: int
    ) -> tuple[Indices, Indices]:
        """Follow paths from nodes in a direction, and return the nodes at both ends.

        A node is one closed configuration at one sample of the inputs. A path leads to the
        next sample in the direction. The configuration at the end of a path becomes a node,
        if it is new.

        Parameters
        ----------
        nodes
            (m,) nodes at which the paths start.
        direction
            Direction in the grid of inputs, in which all nodes have a neighbouring sample.

        Returns
        -------
        starts, ends
            (p,) the nodes at the start and at the end of each path. A path is left out if
            one of its steps failed the tests of `_follow_paths`.
        """
        starts_of_chunks = [np.empty(0, dtype=np.intp)]
        ends_of_chunks = [np.empty(0, dtype=np.intp)]
        for first in range(0, len(nodes), PATHS_AT_ONCE):
            chunk = nodes[first : first + PATHS_AT_ONCE]
            self._progress.report_if_due(lambda: f"{len(self._pieces)} pieces")
            # The sample next to that of each node.
            target = self._neighbours[direction][self.sample[chunk]]
            is_verified, values = self._follow_paths(chunk, target)
            starts_of_chunks.append(chunk[is_verified])
            # `add` returns the node of each configuration, new or already present.
            ends_of_chunks.append(self.add(target[is_verified], values[is_verified]))
        return np.concatenate(starts_of_chunks), np.concatenate(ends_of_chunks)

    def _are_paths_sound(
        self, starts: Indices, ends: Indices, direction: int, old_node_count: int
    ) -> Bools:
        """Return a mask (p,) of the paths that cannot have jumped to another assembly mode.

        A node is one closed configuration at one sample of the inputs. A path leads from a
        node to a node at the next sample.

        - A path can be followed back to its start, so two paths cannot end at one node. If
          two do, one of them has jumped, and neither is sound. `_is_reached` marks the ends
          of earlier sound paths.
        - The determinant of the closure Jacobian with locked inputs keeps its sign along a
          path. An old node at the end must have the sign of the start. For a new node, each
          step to it was tested for this.

        Parameters
        ----------
        starts, ends
            (p,) nodes at the start and at the end of each path.
        direction
            Direction of the paths in the grid of inputs.
        old_node_count
            Number of nodes before these paths were followed. New nodes have this index or a
            greater one.
        """
        paths_to_end = np.bincount(ends, minlength=len(self.sample))[ends]
        is_reached_once = (paths_to_end == 1) & ~self._is_reached[direction, ends]
        # A path ends at an old node if its last configuration differs from this node by at
        # most `SAME_CONFIGURATION_RAD`. Between both there may be a singular configuration,
        # at which the sign of the determinant changes.
        is_new = ends >= old_node_count
        has_equal_signs = self._determinant_sign[ends] == self._determinant_sign[starts]
        return is_reached_once & (is_new | has_equal_signs)

    def _follow_paths(self, nodes: Indices, sample: Indices) -> tuple[Bools, Floats]:
        """Follow straight paths of the inputs from configurations to other samples.

        A node of the graph is a configuration at a sample (choice of the inputs). Each
        input takes the shorter of the two routes around its period, if it has one. Each
        step is tested: Newton's method has to change the predicted configuration little,
        and the determinant of the closure Jacobian with locked inputs has to keep its sign.
        Steps that fail are shortened.

        Parameters
        ----------
        nodes
            (m,) nodes at which the paths start.
        sample
            (m,) index of the sample to which each path leads.

        Returns
        -------
        is_verified
            (m,) whether all steps of the path passed their tests.
        values
            (m, variables) configurations (rad) at the samples. The configurations are valid
            only where `is_verified`.
        """
        starts = self.values[nodes]
        start_inputs = starts[:, self._driven]  # `_driven`: indices of the inputs
        goals = self.input_grid.q[sample]
        # Remove whole periods from the inputs, so that the goals are at most half a period
        # away.
        goals = goals - whole_laps(goals - start_inputs, self.solver.periods)
        followed = follow_inputs(
            self.solver.closure,
            self._driven,
            values=starts,
            q=goals,
            smallest_step=SMALLEST_STEP_RAD,
        )
        # The configurations at the ends of the paths. Add the whole periods again.
        end_values = followed.nodes.values
        values = self.solver.shift_inputs(end_values, self.input_grid.q[sample])
        return followed.status == Status.OK, values

    def modes(self) -> list[Indices]:
        """Return the assembly modes, by their configurations (nodes) at the samples.

        Returns
        -------
        list of (n,) arrays, one for each mode: the index of its node at each sample, or -1.
        The mode with the most nodes comes first. Modes with equally many are sorted by
        their first sample.
        """
        # Paths between nodes at neighbouring samples join nodes to connected components. A
        # component can have several nodes at one sample, which need different modes. It
        # consists of pieces, sets of nodes with at most one node per sample. Each piece,
        # the largest first, is put into the first mode of its component that has no nodes
        # at the samples of the piece.
        component_of_node = self._find_components()
        modes_of_component: dict[int, list[Indices]] = {}
        for nodes in self._pieces.sort_by_size():
            component = int(component_of_node[nodes[0]])
            _put_into_first_mode(
                modes_of_component.setdefault(component, []),
                nodes,
                sample=self.sample[nodes],
                count=len(self.input_grid),
            )

        def size_and_start(mode: Indices) -> tuple[int, tuple[int, int]]:
            """Return the sort key of a mode: large modes first, then by the first node."""
            return -int(np.sum(mode >= 0)), self.first_node(mode)

        all_modes = chain.from_iterable(modes_of_component.values())
        return sorted(all_modes, key=size_and_start)

    def _find_components(self) -> Indices:
        """Return the index (k,) of the connected component of each node.

        A node is one configuration at one sample of the inputs, and an edge is a path
        between two of them. A connected component consists of all nodes that are joined by
        edges, directly or through other nodes.
        """
        no_nodes = np.empty(0, np.intp)
        starts = np.concatenate([no_nodes, *(edges.starts for edges in self._edges)])
        ends = np.concatenate([no_nodes, *(edges.ends for edges in self._edges)])
        count = len(self.sample)
        adjacency = coo_array((np.ones(len(starts)), (starts, ends)), shape=(count, count))
        _, component = connected_components(adjacency, directed=False)
        return component.astype(np.intp)

    def first_node(self, mode: Indices) -> tuple[int, int]:
        """Return the first sample at which a mode has a node (configuration), and the node.

        `mode` (n,) lists the node at each sample, or -1 where it has none.
        """
        # argmax of booleans is the position of the first True.
        sample = int(np.argmax(mode >= 0))
        return sample, int(mode[sample])

    def regular_node(self, mode: Indices) -> int:
        """Return the first regular node (configuration) of a mode.

        If all nodes of the mode are singular, its first node is returned.
        `mode` (n,) lists the node at each sample, or -1 where it has none.
        """
        nodes = mode[mode >= 0]
        # argmax is the position of the first True, and 0 if there is none.
        return int(nodes[np.argmax(self._is_regular[nodes])])


def _number_within_groups(*keys: Indices) -> Indices:
    """Return the index (m,) of each element within its group, from 0.

    Elements that are equal in all `keys` (m,) form a group, and are numbered in their
    order. Keys are numbers from 0. For example, the key [5, 3, 5, 5] gives the numbers [0,
    0, 1, 2].
    """
    if not len(keys[0]):
        return np.empty(0, dtype=np.intp)
    # After this stable sort, the elements of a group follow each other in their old order.
    order = np.lexsort(keys)
    sorted_keys = np.stack(keys)[:, order]
    begins_group = np.any(sorted_keys[:, 1:] != sorted_keys[:, :-1], axis=0)
    # Number of the group of each sorted element, and the position of its first element.
    group = np.append(0, np.cumsum(begins_group))
    start_of_group = np.searchsorted(group, group)
    # Write the indices of the sorted elements to their old places.
    numbers = np.empty(len(order), dtype=np.intp)
    numbers[order] = np.arange(len(order)) - start_of_group
    return numbers


def _pairs_with_equal_keys(key: Indices) -> Iterator[tuple[Indices, Indices]]:
    """Yield all pairs of elements with equal keys (m,), as two arrays of indices.

    The first array has the earlier element of each pair, the second one the later element.
    Elements with equal keys form a group. First come all pairs of elements that follow each
    other in their group, then those with one element between them, and so on. For example,
    the key [5, 3, 5, 5] gives the pairs (0, 2) and (2, 3), and then (0, 3).
    """
    # Elements with equal keys follow each other in `order`.
    order = np.argsort(key, kind="stable")
    largest_group = np.max(np.bincount(key), initial=1)
    for offset in range(1, largest_group):
        earlier = order[:-offset]
        later = order[offset:]
        is_pair = key[earlier] == key[later]
        yield earlier[is_pair], later[is_pair]


def _put_into_first_mode(
    modes: list[Indices], nodes: Indices, sample: Indices, count: int
) -> None:
    """Put a piece (a set of configurations) into the first assembly mode in which it fits.

    A node is one configuration at one sample (choice of the inputs). A mode can have only
    one node at each sample. A piece fits into a mode that has no node at any sample of the
    piece. A piece that fits into no mode becomes a new mode.

    Parameters
    ----------
    modes
        The modes so far, as arrays (count,): the node at each sample, or -1 if there is
        none. One array is changed, or a new one is appended.
    nodes
        (m,) nodes of the piece.
    sample
        (m,) sample of each of these nodes.
    count
        Number of all samples.
    """
    for mode in modes:
        fits = np.all(mode[sample] < 0)
        if fits:
            mode[sample] = nodes
            return
    new_mode = np.full(count, -1, dtype=np.intp)
    new_mode[sample] = nodes
    modes.append(new_mode)


def share_numbers(modes: Sequence[Indices]) -> list[Indices]:
    """Unite assembly modes that occur on separate parts of a path of samples.

    United modes share one number, so that users see fewer of them. A sample is one choice
    of the inputs. At least one sample without a configuration separates two modes that are
    united.

    Parameters
    ----------
    modes
        Node (configuration) (n,) of each mode at each sample of the path, or -1, as
        `ConfigurationGraph.modes` returns them.

    Returns
    -------
    The united modes, as arrays of the same kind. Each mode is put into the first united
    mode that has no node at its samples, or next to them.
    """
    united_modes: list[Indices] = []
    for mode in modes:
        has_node = mode >= 0
        # A united mode must have no nodes at the samples of this mode, and none at the
        # samples before and after them.
        is_before_node = np.append(has_node[1:], False)
        is_after_node = np.append(False, has_node[:-1])
        must_be_free = has_node | is_before_node | is_after_node
        for united_mode in united_modes:
            if np.all(united_mode[must_be_free] < 0):
                united_mode[has_node] = mode[has_node]
                break
        else:
            # This mode fits into no united mode.
            united_modes.append(mode.copy())
    return united_modes
