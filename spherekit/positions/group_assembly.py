"""Placing the bodies of one group: dyads in closed form, others by Newton's method.

While groups are assembled each body carries the orientations of its links in its own
axes (those of one of its links); `State` holds them for a batch of samples.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.geometry.rotation import nans, transpose
from spherekit.geometry.tilt_torsion import about_z
from spherekit.geometry.triangle import close_dyad
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.joint import Joint, revolute
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.positions.linearisation import Linearisation, LoopTree
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import pair_angle, pair_states
from spherekit.tolerances import REACH_SLACK


@dataclass
class State:
    """Orientations of links within their bodies while a batch is being assembled.

    `joints` are those of the mechanism's pairs, `ends` the links that these join, and
    `variables[pair]` the numbers of their variables; `within[link]` is (n, 3, 3), from the
    link's axes to those of its body; `values` (n, variables) are the variables known so
    far. `slack` (n,) rad is what bodies may be off by: nearly straight dyads enlarge it, at
    most to the root of rounding. `slenderness` (n,) is the least of any dyad placed, see
    `spherekit.geometry.triangle.close_dyad`.
    """

    joints: tuple[Joint, ...]
    ends: tuple[tuple[int, int], ...]
    variables: tuple[tuple[int, ...], ...]
    within: dict[int, Floats]
    values: Floats
    lost: Bools
    slack: Floats
    slenderness: Floats

    @staticmethod
    def start(
        mechanism: Mechanism, joints: tuple[Joint, ...], assembly: Assembly, q: Floats
    ) -> "State":
        """Return the state in which only the inputs have values q (n, inputs)."""
        n = len(q)
        unturned = np.broadcast_to(np.eye(3), (n, 3, 3))
        within = dict.fromkeys(range(len(mechanism.links)), unturned)
        variables = tuple(map(mechanism.variables_of, range(len(joints))))
        values = nans((n, len(mechanism.variable_owners)))
        for driven, column in zip(assembly.inputs, q.T, strict=True):
            values[:, variables[driven][0]] = column
        ways = find_spanning_tree(mechanism.ends, assembly.bodies, assembly.inputs)
        for driven, parent, child in ways:
            states = pair_states((joints[driven],), values[:, list(variables[driven])])
            turn = states.first[:, 0] @ transpose(states.second[:, 0])
            ahead = mechanism.ends[driven][0] == parent
            within[child] = within[parent] @ (turn if ahead else transpose(turn))
        lost, slack = np.zeros(n, dtype=bool), np.full(n, REACH_SLACK)
        slenderness = np.ones(n)
        return State(
            joints, mechanism.ends, variables, within, values, lost, slack, slenderness
        )

    def copy(self) -> "State":
        """Return a state that can be assembled differently from here on."""
        return replace(
            self, within=dict(self.within), values=self.values.copy(), lost=self.lost.copy()
        )

    def rows(self, chosen: Indices) -> "State":
        """Return the state of some samples, by their numbers (k,), which may repeat."""
        return replace(
            self,
            within={link: turn[chosen] for link, turn in self.within.items()},
            values=self.values[chosen],
            lost=self.lost[chosen],
            slack=self.slack[chosen],
            slenderness=self.slenderness[chosen],
        )

    @staticmethod
    def joined(states: Sequence["State"]) -> "State":
        """Return the samples of several states of one mechanism, state after state."""
        first = states[0]
        return replace(
            first,
            within={
                link: np.concatenate([state.within[link] for state in states])
                for link in first.within
            },
            values=np.concatenate([state.values for state in states]),
            lost=np.concatenate([state.lost for state in states]),
            slack=np.concatenate([state.slack for state in states]),
            slenderness=np.concatenate([state.slenderness for state in states]),
        )

    def merge(self, group: Group, placed: Floats) -> None:
        """Make the group one body, its bodies placed (n, bodies, 3, 3) in the first."""
        for position, links in enumerate(group.bodies):
            if position:
                for link in links:
                    self.within[link] = placed[:, position] @ self.within[link]

    def read_values(self, group: Group) -> None:
        """Set the variables of a group's R pairs from the orientations of its links."""
        for pair in group.pairs:
            if not self.joints[pair].has_axis:
                continue
            a, b = self.ends[pair]
            joint = revolute(self.joints[pair])
            self.values[:, self.variables[pair][0]] = pair_angle(
                self.within[a] @ joint.first, self.within[b] @ joint.second
            )


def place_dyad(state: State, group: Group, sign: Floats | float) -> Floats:
    """Place the two free bodies of a dyad and merge; return the sine of its dead centre.

    The mode's `sign`, one for all samples or (n,), is that of u_1 . (u_2 x u_3), the axes
    of the group's pairs in file order. Samples whose arcs cannot close are marked in
    `state.lost`.
    """
    near, middle, far = group.dyad_positions

    def axis(which: int, body: int) -> Floats:
        pair, side = group.pairs[which], group.ends[which].index(body)
        joint = revolute(state.joints[pair])
        frame = (joint.first, joint.second)[side]
        return state.within[state.ends[pair][side]] @ frame[:, 2]

    near_turn, far_turn, sine, slenderness, closes = close_dyad(
        axis(near, 0),
        axis(far, 0),
        (axis(near, 1), axis(middle, 1)),
        (axis(far, 2), axis(middle, 2)),
        group.dyad_parity * sign,
        state.slack,
    )
    grown = state.slack / np.maximum(sine, np.sqrt(REACH_SLACK))
    state.slack = np.minimum(grown, np.sqrt(REACH_SLACK))
    state.slenderness = np.minimum(state.slenderness, slenderness)
    placed = np.broadcast_arrays(np.eye(3), near_turn, far_turn)
    state.merge(group, np.stack(placed, axis=1))
    state.read_values(group)
    state.lost |= ~closes
    return sine


def group_variables(state: State, group: Group) -> list[int]:
    """Return the numbers of the variables of a group's pairs."""
    return [number for pair in group.pairs for number in state.variables[pair]]


def group_tree(group: Group, joints: Sequence[Joint]) -> LoopTree:
    """Return the tree and the loops of a group's bodies; `joints` are of all pairs."""
    freedoms = [joints[pair].variable_count for pair in group.pairs]
    owners = np.repeat(np.arange(len(freedoms)), freedoms).tolist()
    return LoopTree(len(group.bodies), group.ends, tuple(owners))


def group_closure(state: State, group: Group) -> Closure:
    """Return the closure of the group's bodies at the state's samples."""
    first, second = (
        np.stack([state.within[state.ends[pair][side]] for pair in group.pairs], axis=1)
        for side in (0, 1)
    )
    joints = tuple(state.joints[pair] for pair in group.pairs)
    return Closure(group_tree(group, state.joints), joints, (first, second))


def place_group(state: State, group: Group, start: Floats) -> Linearisation:
    """Close an irreducible group from starting values (n, its variables), and merge it."""
    at = group_closure(state, group).solve(start)
    state.merge(group, at.placed)
    state.values[:, group_variables(state, group)] = at.values
    return at


def train_ways(group: Group, fixed: Collection[int]) -> tuple[tuple[int, int, int], ...]:
    """Return how bodies are reached by R pairs, by number, whose angles are `fixed`.

    Each way is the place of a pair in the group, the body it starts at, and the new one.
    """
    places = [place for place, pair in enumerate(group.pairs) if pair in fixed]
    return find_spanning_tree(group.ends, pairs=places)


def train_turns(
    group: Group,
    within: Mapping[int, Array] | Sequence[Array],
    ends: Sequence[tuple[int, int]],
    joints: Sequence[Joint],
    angles: Mapping[int, Floats],
) -> list[Array]:
    """Return the rotations (..., 3, 3) of the bodies of a train, in order, to the first.

    `within[link]` (..., 3, 3) are those of links in their bodies, of any real or complex
    numbers, `angles` (...,) rad those of pairs by number.
    """
    turns: dict[int, Array] = {0: np.eye(3)}
    for place, parent, child in train_ways(group, angles):
        pair = group.pairs[place]
        joint, (first, second) = revolute(joints[pair]), ends[pair]
        turn = within[first] @ joint.first @ about_z(angles[pair])
        turn = turn @ transpose(within[second] @ joint.second)
        ahead = group.ends[place][0] == parent
        turns[child] = turns[parent] @ (turn if ahead else transpose(turn))
    return [turns[body] for body in range(len(group.bodies))]
