"""Assembly modes over samples of several inputs, as sets of joined configurations.

The nodes of the graph are the configurations at all samples. An edge joins configurations
at two neighbouring samples if verified steps on the straight way between them lead from one
to the other. Such a way passes no singular configuration, so it can be walked both ways and
has one end at most for each start.

A connected part of the graph can have several configurations at one sample: a loop around
inputs at which modes meet leads from one of them to another. Such a part is divided into
assembly modes with one configuration at most for each sample:

1. Pieces grow along edges. Two pieces that an edge joins become one, unless that would put
   two configurations of one sample into it.
2. Pieces of one part that share no sample become one mode, the largest first.

The order is a fixed one, so the modes are the same every time. Each configuration is in one
mode only.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import Status
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.input_grid import InputGrid
from spherekit.motion.steps import determinant_sign, flat, follow_inputs
from spherekit.motion.turns import whole_laps
from spherekit.numeric.crossings import wrap
from spherekit.progress import ProgressReporter
from spherekit.sphere.rotation import max_abs

SAME_CONFIGURATION_RAD = 1e-6
"""Configurations of one sample whose angles differ by less (rad) are the same one."""
SINGULAR = 1e-8
"""A configuration of a smaller relative singular value is joined to no other."""
SMALLEST_STEP_RAD = 1e-7
"""A way between two samples that needs a smaller step (rad) is given up. It comes that near
to a singular configuration; smaller steps cost time and join hardly any more."""
WAYS_AT_ONCE = 4096
"""Ways that are followed together. More need more memory; fewer take longer."""
DOUBLE_PORTIONS = 2
"""Growth of the number of ways that are tried for one piece in a round. In a regular grid
one way joins two pieces; where modes meet, many have to be tried."""


class ConfigurationGraph:
    """Configurations at the samples of an input grid, and which of them are joined.

    Attributes
    ----------
    sample, values
        (k,) the sample of each node, and (k, variables) rad its configuration.
    is_complete
        (n,) whether all configurations of a sample are nodes; False by default. Only ways
        to samples that are not complete can lead to new nodes.
    """

    def __init__(self, solver: Solver, input_grid: InputGrid) -> None:
        self.solver = solver
        self.input_grid = input_grid
        variables = len(solver.mechanism.variable_owners)
        self.sample = np.empty(0, dtype=np.intp)
        self.values = np.empty((0, variables))
        self.is_complete = np.zeros(len(input_grid), dtype=bool)
        self._driven = list(solver.driven)
        self._angles = solver.angles
        self._sign = np.empty(0)
        self._is_regular = np.empty(0, dtype=bool)
        # Row s lists the nodes of sample s, padded by -1.
        self._nodes_at = np.full((len(input_grid), 0), -1, dtype=np.intp)
        self._neighbours = input_grid.neighbours()
        # Index 0 is the direction, in which `neighbours` has one row each: a way was tried
        # from this node, and the node to which it led, or -1.
        self._is_tried = np.empty((len(self._neighbours), 0), dtype=bool)
        self._partner = np.empty((len(self._neighbours), 0), dtype=np.intp)
        self._piece = np.empty(0, dtype=np.intp)
        self._members: dict[int, list[Indices]] = {}
        self._edges: list[tuple[Indices, Indices]] = []
        self._working = ProgressReporter(
            "joining the configurations of neighbouring samples"
        )

    def add(self, sample: Indices, values: Floats) -> Indices:
        """Add configurations (m, variables) at samples (m,); return their nodes (m,).

        A configuration that is known already keeps its node. Those of one call must be
        different.
        """
        nodes = self.find(sample, values)
        (new,) = np.nonzero(nodes < 0)
        if not len(new):
            return nodes
        first = len(self.sample)
        nodes[new] = np.arange(first, first + len(new))
        at = self.solver.closure.at(values[new])
        square = np.delete(at.jacobian, self._driven, axis=2)
        self._sign = np.append(self._sign, determinant_sign(square))
        is_regular = ~flat(at, self._driven, SINGULAR)
        self._is_regular = np.append(self._is_regular, is_regular)
        self.sample = np.append(self.sample, sample[new])
        self.values = np.concatenate([self.values, values[new]])
        directions = len(self._neighbours)
        tried = np.zeros((directions, len(new)), dtype=bool)
        self._is_tried = np.concatenate([self._is_tried, tried], axis=1)
        partner = np.full((directions, len(new)), -1, dtype=np.intp)
        self._partner = np.concatenate([self._partner, partner], axis=1)
        self._piece = np.append(self._piece, nodes[new])
        self._members |= {node: [np.array([node])] for node in nodes[new].tolist()}
        self._list_nodes()
        return nodes

    def find(self, sample: Indices, values: Floats) -> Indices:
        """Return the nodes (m,) of configurations (m, variables) at samples, or -1."""
        nodes = np.full(len(sample), -1, dtype=np.intp)
        if not self._nodes_at.shape[1]:
            return nodes
        for first in range(0, len(sample), WAYS_AT_ONCE):
            some = slice(first, first + WAYS_AT_ONCE)
            candidates = self._nodes_at[sample[some]]
            apart = wrap(self.values[candidates] - values[some, None])[..., self._angles]
            distance = np.where(candidates < 0, np.inf, max_abs(apart, axis=2))
            best = np.argmin(distance, axis=1)[:, None]
            is_same = np.take_along_axis(distance, best, axis=1) < SAME_CONFIGURATION_RAD
            best_nodes = np.take_along_axis(candidates, best, axis=1)
            nodes[some] = np.where(is_same, best_nodes, -1)[:, 0]
        return nodes

    def _list_nodes(self) -> None:
        """Set the table of the nodes of each sample."""
        order = np.argsort(self.sample, kind="stable")
        counts = np.bincount(self.sample, minlength=len(self.input_grid))
        column = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
        self._nodes_at = np.full(
            (len(counts), np.max(counts, initial=0)), -1, dtype=np.intp
        )
        self._nodes_at[self.sample[order], column] = order

    def add_sheet(self, values: Floats) -> None:
        """Add joined configurations (n, variables), one at most for each sample.

        Rows of samples without one are NaN.
        """
        (sample,) = np.nonzero(np.all(np.isfinite(values), axis=1))
        first = len(self.sample)
        nodes = self.add(sample, values[sample])
        self._edges.append((nodes[:-1], nodes[1:]))
        # The new nodes are one piece. It then takes in those on which the sheet comes.
        new = nodes[nodes >= first]
        order = np.concatenate([new, nodes[nodes < first]])
        for node in order[1:].tolist():
            self._unite(int(order[0]), node)

    def find_unbalanced(self) -> Bools:
        """Return (n,) at which samples the signs of the nodes do not cancel.

        The signs of the determinants of all configurations sum up to the degree of the map
        from passive angles to loops. It does not depend on the inputs or the arcs, so it is
        zero: links can be so short that nothing closes. Singular nodes have no sign.
        """
        count = len(self.input_grid)
        sums = np.bincount(self.sample, np.where(self._is_regular, self._sign, 0.0), count)
        singular = np.bincount(self.sample, ~self._is_regular, count)
        return (sums != 0.0) & (singular == 0)

    def join(self) -> None:
        """Join all nodes at neighbouring samples, as far as that is needed for the modes.

        Along the last axis all ways are walked. That gives strands of nodes. Across them a
        way is walked only if it can make a piece larger: a single one joins two strands
        that run side by side.
        """
        last_axis = len(self._neighbours) - 1
        self._walk(np.flatnonzero(self._may_lead_on(last_axis)), last_axis)
        for direction in range(last_axis - 2, -1, -2):
            self._join_in([direction])
        self._join_in(range(len(self._neighbours)))

    def _join_in(self, directions: Sequence[int]) -> None:
        """Walk ways in some directions until none is left that can join two pieces."""
        portion = 1
        while True:
            count = 0
            for direction in directions:
                nodes = self._select(direction, portion)
                count += len(nodes)
                self._walk(nodes, direction)
            if not count:
                return
            portion *= DOUBLE_PORTIONS

    def _may_lead_on(self, direction: int) -> Bools:
        """Return (k,) from which nodes a way in a direction may join two pieces.

        Its piece must have no node at the sample that it leads to. If that is complete,
        it must have a node of the same sign of the determinant to which no way leads yet.
        """
        target = self._neighbours[direction][self.sample]
        may = (target >= 0) & self._is_regular & ~self._is_tried[direction]
        for first in range(0, len(target), WAYS_AT_ONCE):
            rows = first + np.flatnonzero(may[first : first + WAYS_AT_ONCE])
            ends = self._nodes_at[target[rows]]
            is_node = ends >= 0
            is_open = is_node & self._is_regular[ends]
            is_open &= self._sign[ends] == self._sign[rows, None]
            is_open &= self._partner[direction ^ 1][ends] < 0
            is_own = is_node & (self._piece[ends] == self._piece[rows, None])
            leads_on = np.any(is_open, axis=1) | ~self.is_complete[target[rows]]
            may[rows] = leads_on & ~np.any(is_own, axis=1)
        return may

    def _select(self, direction: int, portion: int) -> Indices:
        """Return at most so many nodes of each piece and block from which to walk.

        A block are the samples of a grid with the same indices up to the direction's axis.
        """
        (nodes,) = np.nonzero(self._may_lead_on(direction))
        axis = direction // 2
        stride = int(np.prod(self.input_grid.shape[axis + 1 :], dtype=np.intp))
        block = self._neighbours[direction][self.sample[nodes]] // stride
        order = np.lexsort((nodes, block, self._piece[nodes]))
        keys = np.stack([self._piece[nodes], block], axis=1)[order]
        begins = np.any(np.diff(keys, axis=0, prepend=-1) != 0, axis=1)
        starts = np.flatnonzero(begins)
        rank = np.arange(len(order)) - np.repeat(starts, np.diff(starts, append=len(order)))
        return np.sort(nodes[order[rank < portion]])

    def _walk(self, nodes: Indices, direction: int) -> None:
        """Walk from nodes in a direction, and join what is found there."""
        self._is_tried[direction, nodes] = True
        for first in range(0, len(nodes), WAYS_AT_ONCE):
            starts = nodes[first : first + WAYS_AT_ONCE]
            self._working.tell(lambda: f"{len(self._members)} pieces")
            sample = self._neighbours[direction][self.sample[starts]]
            arrived, values = self._follow(starts, sample)
            starts = starts[arrived]
            node_count = len(self.sample)
            ends = self.add(sample[arrived], values[arrived])
            # Two ways cannot end at one node: then a step went wrong, and neither counts.
            ways_to = np.bincount(ends, minlength=len(self.sample))[ends]
            sound = (ways_to == 1) & (self._partner[direction ^ 1][ends] < 0)
            sound &= (ends >= node_count) | (self._sign[ends] == self._sign[starts])
            starts, ends = starts[sound], ends[sound]
            self._partner[direction, starts] = ends
            self._partner[direction ^ 1, ends] = starts
            self._is_tried[direction ^ 1, ends] = True
            self._edges.append((starts, ends))
            for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
                self._unite(start, end)

    def _follow(self, nodes: Indices, sample: Indices) -> tuple[Bools, Floats]:
        """Return which straight ways to samples are verified, and where they end.

        Inputs go the shorter way where whole periods change nothing.
        """
        starts = self.values[nodes]
        goals = self.input_grid.q[sample]
        goals = goals - whole_laps(goals - starts[:, self._driven], self.solver.periods)
        reached, status, _ = follow_inputs(
            self.solver.closure,
            self._driven,
            starts,
            goals,
            smallest_step=SMALLEST_STEP_RAD,
        )
        values = self.solver.moved(reached.values, self.input_grid.q[sample])
        return status == Status.OK, values

    def _unite(self, node: int, other: int) -> None:
        """Make one piece of those of two nodes, unless they share a sample."""
        large, small = int(self._piece[node]), int(self._piece[other])
        if large == small:
            return
        sizes = [sum(map(len, self._members[piece])) for piece in (large, small)]
        if sizes[0] < sizes[1]:
            large, small = small, large
        moved = np.concatenate(self._members[small])
        beside = self._nodes_at[self.sample[moved]]
        if np.any((beside >= 0) & (self._piece[beside] == large)):
            return
        self._piece[moved] = large
        self._members[large].append(moved)
        del self._members[small]

    def modes(self) -> list[Indices]:
        """Return the nodes (n,) of each assembly mode at the samples, -1 where it has none.

        The largest comes first; of modes of one size that with the first node.
        """
        count = len(self.sample)
        starts = np.concatenate(
            [np.empty(0, np.intp), *(start for start, _ in self._edges)]
        )
        ends = np.concatenate([np.empty(0, np.intp), *(end for _, end in self._edges)])
        edges = coo_array((np.ones(len(starts)), (starts, ends)), shape=(count, count))
        part = connected_components(edges, directed=False)[1]
        modes_of_parts: dict[int, list[Indices]] = {}
        for nodes in self._pieces():
            modes = modes_of_parts.setdefault(int(part[nodes[0]]), [])
            _put_into_first(modes, nodes, self.sample[nodes], len(self.input_grid))
        every = [mode for modes in modes_of_parts.values() for mode in modes]

        def size_and_start(mode: Indices) -> tuple[int, tuple[int, int]]:
            return -int(np.sum(mode >= 0)), self.first_node(mode)

        return sorted(every, key=size_and_start)

    def first_node(self, mode: Indices) -> tuple[int, int]:
        """Return the first sample at which a mode has a node, and that node."""
        sample = int(np.argmax(mode >= 0))
        return sample, int(mode[sample])

    def _pieces(self) -> Iterator[Indices]:
        """Yield the nodes of all pieces, the largest first."""
        pieces = [np.sort(np.concatenate(nodes)) for nodes in self._members.values()]
        yield from sorted(pieces, key=lambda nodes: (-len(nodes), int(nodes[0])))

    def regular_node(self, mode: Indices) -> int:
        """Return the first node of a mode that is not singular, or else its first one."""
        nodes = mode[mode >= 0]
        return int(nodes[np.argmax(self._is_regular[nodes])])


def _put_into_first(
    modes: list[Indices], nodes: Indices, sample: Indices, count: int
) -> None:
    """Put nodes at samples (m,) into the first of the modes that has none there.

    If there is none, a new mode of `count` samples is appended.
    """
    for mode in modes:
        if np.all(mode[sample] < 0):
            mode[sample] = nodes
            return
    modes.append(np.full(count, -1, dtype=np.intp))
    modes[-1][sample] = nodes


def share_numbers(modes: Sequence[Indices]) -> list[Indices]:
    """Return the modes of a path, those that keep apart put together.

    Modes (n,) as those of `ConfigurationGraph.modes` become one if no sample of one is a
    sample of the other, or next to one. They are taken in the order given.
    """
    shared: list[Indices] = []
    for mode in modes:
        near = mode >= 0
        near = near | np.append(near[1:], False) | np.append(False, near[:-1])
        for other in shared:
            if np.all(other[near] < 0):
                other[mode >= 0] = mode[mode >= 0]
                break
        else:
            shared.append(mode.copy())
    return shared
