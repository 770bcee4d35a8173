"""Places the bodies of one group: dyads in closed form, others by Newton's method.

While a mechanism is assembled it consists of bodies, which are sets of links whose relative
orientations are known already. An `AssemblyState` has the orientations of all links in
their bodies at n samples. Placing a group merges its bodies into one.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.geometry.rotation import about_z, transpose
from spherekit.geometry.triangle import close_dyad
from spherekit.geometry.vectors import nans
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.joint import Joint, revolute
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.pair_states import evaluate_pair_states, pair_angle
from spherekit.tolerances import REACH_SLACK


@dataclass
class AssemblyState:
    """The bodies of a mechanism at n samples (inputs), while its groups are placed.

    A body is a set of links with known relative orientations, in the beginning a single
    link. A group is a set of bodies that are placed together by closing their loops. The
    bodies of a placed group become one body.

    Attributes
    ----------
    joints
        The joint of each pair.
    ends
        The indices of the two links of each pair.
    variables
        The indices of the variables of each pair.
    body_from_link
        Rotations (n, 3, 3) from the axes of each link, by link index, to the axes of its
        body. The axes of a body are those of one of its links.
    values
        (n, variables) pair variables (rad), NaN as long as they are not known.
    is_open
        (n,) whether some group could not be closed.
    slack
        (n,) angle (rad) by which the sides of a triangle may miss closing. This angle is
        the error of the bodies placed so far. Nearly straight dyads enlarge it, at most to
        the square root of `REACH_SLACK`.
    side_ratio
        (n,) least side ratio of the dyads placed so far (see
        `spherekit.geometry.triangle.DyadClosure`).
    """

    joints: tuple[Joint, ...]
    ends: tuple[tuple[int, int], ...]
    variables: tuple[tuple[int, ...], ...]
    body_from_link: dict[int, Floats]
    values: Floats
    is_open: Bools
    slack: Floats
    side_ratio: Floats

    @staticmethod
    def start(
        mechanism: Mechanism, joints: tuple[Joint, ...], assembly: Assembly, q: Floats
    ) -> "AssemblyState":
        """Return the state in which only the links joined by inputs are placed.

        A body is a set of links whose relative orientations are known. In this state, links
        that inputs join form one body. Every other link is a body of its own.

        Parameters
        ----------
        mechanism, joints
            The mechanism and the joints of its pairs.
        assembly
            Its inputs, and the bodies.
        q
            (n, inputs) values of the inputs (rad).
        """
        n = len(q)
        variables = tuple(map(mechanism.variables_of, range(len(joints))))
        values = nans((n, len(mechanism.variable_owners)))
        for input_pair, input_values in zip(assembly.inputs, q.T, strict=True):
            input_variable = variables[input_pair][0]
            values[:, input_variable] = input_values
        rotations_of_inputs = {
            pair: rotation_in_pair(joints[pair], values[:, list(variables[pair])])
            for pair in assembly.inputs
        }
        body_from_link = orient_links_in_bodies(mechanism, assembly, rotations_of_inputs, n)
        return AssemblyState(
            joints=joints,
            ends=mechanism.ends,
            variables=variables,
            body_from_link=body_from_link,
            values=values,
            # No group is placed yet, so none has failed to close.
            is_open=np.zeros(n, dtype=bool),
            # Dyads (groups of two links) are placed by spherical triangles. A narrow
            # triangle enlarges the errors of the placed axes. `slack` bounds these errors
            # (rad). In the beginning there are only rounding errors.
            slack=np.full(n, REACH_SLACK),
            # The side ratio of a triangle is the smallest sine of a side, divided by the
            # largest. It is small for a narrow triangle. The state has the smallest ratio
            # of all triangles so far. The initial value 1 is the largest possible ratio.
            side_ratio=np.ones(n),
        )

    def copy(self) -> "AssemblyState":
        """Return a copy in which further groups can be placed independently."""
        return replace(
            self,
            body_from_link=dict(self.body_from_link),
            values=self.values.copy(),
            is_open=self.is_open.copy(),
        )

    def rows(self, chosen: Indices) -> "AssemblyState":
        """Return the state of some samples, by their indices (k,), which may repeat."""
        return replace(
            self,
            body_from_link={
                link: rotations[chosen] for link, rotations in self.body_from_link.items()
            },
            values=self.values[chosen],
            is_open=self.is_open[chosen],
            slack=self.slack[chosen],
            side_ratio=self.side_ratio[chosen],
        )

    @staticmethod
    def concatenate(states: Sequence["AssemblyState"]) -> "AssemblyState":
        """Return the samples of several states of one mechanism, state after state."""
        first = states[0]
        return replace(
            first,
            body_from_link={
                link: np.concatenate([state.body_from_link[link] for state in states])
                for link in first.body_from_link
            },
            values=np.concatenate([state.values for state in states]),
            is_open=np.concatenate([state.is_open for state in states]),
            slack=np.concatenate([state.slack for state in states]),
            side_ratio=np.concatenate([state.side_ratio for state in states]),
        )

    def merge(self, group: Group, rotations: Floats) -> None:
        """Merge the bodies of a group into one body, after they have been placed.

        A body is a set of links whose orientations are known in the axes of the body. The
        new body has the axes of the first body. Only the orientations `body_from_link`
        change, not the pair variables.

        Parameters
        ----------
        group
            The bodies, each with the indices of its links, and the pairs between them.
        rotations
            (n, bodies, 3, 3) rotations from the axes of each body of the group to the axes
            of its first body.
        """
        # The links of the first body keep their orientations.
        for position in range(1, len(group.bodies)):
            for link in group.bodies[position]:
                self.body_from_link[link] = (
                    rotations[:, position] @ self.body_from_link[link]
                )

    def read_values(self, group: Group) -> None:
        """Set the variables of a group's R pairs from the orientations of its links."""
        for pair in group.pairs:
            if not self.joints[pair].has_axis:
                continue
            first_link, second_link = self.ends[pair]
            joint = revolute(self.joints[pair])
            self.values[:, self.variables[pair][0]] = pair_angle(
                self.body_from_link[first_link] @ joint.first,
                self.body_from_link[second_link] @ joint.second,
            )


def rotation_in_pair(joint: Joint, values: Floats) -> Floats:
    """Return the rotation from the axes of the second link of a pair to those of its first.

    With the angles of the input pairs, the caller joins the links of these pairs into rigid
    bodies.

    Parameters
    ----------
    joint
        The joint of the pair.
    values
        (n, variables of the pair) rad.

    Returns
    -------
    (n, 3, 3) rotations.
    """
    states = evaluate_pair_states((joint,), values)
    # The frame of the pair in the axes of each link. The states have a single pair.
    frame_in_first = states.first[:, 0]
    frame_in_second = states.second[:, 0]
    return frame_in_first @ transpose(frame_in_second)


def orient_links_in_bodies(
    mechanism: Mechanism,
    assembly: Assembly,
    rotations_of_inputs: Mapping[int, Floats],
    sample_count: int,
) -> dict[int, Floats]:
    """Return the orientation of each link in its body, from the inputs alone.

    A body is a set of links whose relative orientations are known. Placing a group of links
    joins more bodies; this function is called before the first group is placed. Links that
    are joined by an input, or by a chain of inputs, form one body. The axes of a body are
    those of one of its links, and the body has the index of this link. A link without
    inputs is a body of its own.

    Parameters
    ----------
    mechanism, assembly
        The mechanism, and its inputs and bodies.
    rotations_of_inputs
        For each input pair the rotation (n, 3, 3) from its second link to its first.
    sample_count
        The number n of samples (choices of the inputs).

    Returns
    -------
    For each link the rotation (n, 3, 3) from its axes to those of its body.
    """
    identity = np.broadcast_to(np.eye(3), (sample_count, 3, 3))
    body_from_link = dict.fromkeys(range(len(mechanism.links)), identity)
    # The links that give the bodies their axes. A body has the index of this link.
    first_links = assembly.body_of_link
    # Each input leads from a link with a known orientation (parent) to another link of the
    # body (child).
    branches = find_spanning_tree(mechanism.ends, start=first_links, pairs=assembly.inputs)
    for input_pair, parent, child in branches:
        first_from_second = rotations_of_inputs[input_pair]
        first_link, _second_link = mechanism.ends[input_pair]
        if parent == first_link:
            parent_from_child = first_from_second
        else:
            parent_from_child = transpose(first_from_second)
        body_from_link[child] = body_from_link[parent] @ parent_from_child
    return body_from_link


def place_dyad(state: AssemblyState, group: Group, sign: Floats | float) -> Floats:
    """Place the two free bodies of a dyad in closed form, and merge its three bodies.

    A body is a set of links whose relative orientations are known. A dyad is two bodies
    that three R pairs join to each other and to a base body. The three axes are the
    vertices of a spherical triangle, which can be assembled in two ways.

    Parameters
    ----------
    state
        The bodies placed so far; changed in place. `state.is_open` becomes True at samples
        at which the arcs of the dyad cannot close.
    group
        The dyad.
    sign
        Sign of the assembly mode, one for all samples or (n,). It is the sign of
        u_1 . (u_2 x u_3), where the u are the axes of the pairs in file order.

    Returns
    -------
    (n,) sine of the angle between the arcs of both bodies at the middle axis. It is zero at
    the dead centre of the dyad, where its two modes meet.
    """
    # Positions of the pairs in the group: the outer pairs join the two free bodies 1 and 2
    # to the base body 0, and the middle pair joins them to each other.
    first_outer, middle, second_outer = group.dyad_positions

    def pair_axis(position: int, body: int) -> Floats:
        """Return the axis (n, 3) of a pair of the group, in the axes of a body."""
        pair = group.pairs[position]
        side = group.ends[position].index(body)
        joint = revolute(state.joints[pair])
        frame = (joint.first, joint.second)[side]
        return state.body_from_link[state.ends[pair][side]] @ frame[:, 2]

    closure = close_dyad(
        first=pair_axis(first_outer, 0),
        second=pair_axis(second_outer, 0),
        first_body=(pair_axis(first_outer, 1), pair_axis(middle, 1)),
        second_body=(pair_axis(second_outer, 2), pair_axis(middle, 2)),
        # The parity converts the sign to the order middle, first outer, second outer.
        sign=group.dyad_parity * sign,
        slack=state.slack,
    )
    # The slack is the error of the placed axes (rad), by which later triangles may miss
    # closing. The slack grows by the reciprocal of the sine, which is zero at a dead
    # centre. At a dead centre, an error e of the axes causes an error of about sqrt(e). The
    # slack is therefore limited to the root of `REACH_SLACK`, the rounding error of the
    # axes.
    max_slack = np.sqrt(REACH_SLACK)
    grown_slack = state.slack / np.maximum(closure.sine, max_slack)
    state.slack = np.minimum(grown_slack, max_slack)
    # The smallest over the largest sine of the sides of the triangle. A small ratio means
    # large rounding errors of directions.
    state.side_ratio = np.minimum(state.side_ratio, closure.side_ratio)
    rotations = np.broadcast_arrays(
        np.eye(3), closure.first_rotation, closure.second_rotation
    )
    state.merge(group, np.stack(rotations, axis=1))
    # The variables of the three pairs, from the orientations of the bodies.
    state.read_values(group)
    state.is_open |= ~closure.closes
    return closure.sine


def group_variables(state: AssemblyState, group: Group) -> list[int]:
    """Return the indices of the variables of a group's pairs, among all variables."""
    return [number for pair in group.pairs for number in state.variables[pair]]


def group_tree(group: Group, joints: Sequence[Joint]) -> LoopTree:
    """Return the loops of a group. `joints` has the joint of each pair of the mechanism."""
    variable_counts = [joints[pair].variable_count for pair in group.pairs]
    owners = np.repeat(np.arange(len(variable_counts)), variable_counts).tolist()
    return LoopTree(len(group.bodies), group.ends, tuple(owners))


def group_closure(state: AssemblyState, group: Group) -> Closure:
    """Return the loop-closure equations of a group, at the samples of a state.

    A body is a set of links whose orientations relative to each other are known. A group is
    a set of bodies that become one body when their loops are closed. The equations are
    solved for the variables of the pairs between the bodies.

    Parameters
    ----------
    state
        The bodies placed so far, at n samples (choices of the inputs).
    group
        The group.
    """
    # For each pair, the rotations from its first and second link to their bodies.
    body_from_first, body_from_second = (
        np.stack(
            [state.body_from_link[state.ends[pair][side]] for pair in group.pairs], axis=1
        )
        for side in (0, 1)
    )
    joints = tuple(state.joints[pair] for pair in group.pairs)
    return Closure(
        group_tree(group, state.joints), joints, (body_from_first, body_from_second)
    )


def place_group(state: AssemblyState, group: Group, start: Floats) -> Linearisation:
    """Close the loops of a group by Newton's method, and make its bodies one body.

    A body is a set of links whose relative orientations are known. A group (Assur group) is
    bodies that are placed together by closing their loops.

    Parameters
    ----------
    state
        The orientation of each link in its body, and the pair variables; changed in place.
    group
        The bodies, and the pairs between them.
    start
        (n, variables of the group) values (rad) from which Newton's method starts, at n
        samples (choices of the inputs).

    Returns
    -------
    The loop equations of the group, linearised at the values after the last step of
    Newton's method. The method may fail. The caller must test by the `closure_residual` of
    the result whether the loops are closed.
    """
    linearisation = group_closure(state, group).solve(start)
    state.merge(group, linearisation.rotations)
    state.values[:, group_variables(state, group)] = linearisation.values
    return linearisation


def find_train_paths(
    group: Group, fixed_pairs: Collection[int]
) -> tuple[tuple[int, int, int], ...]:
    """Return the order in which pair angles place the bodies of a train of wheels.

    A train is a group of bodies (sets of rigidly joined links) that are placed together.
    The angles of some of its R pairs follow from the inputs by gear ratios. Beginning at
    the first body, each of these pairs places another body.

    Parameters
    ----------
    group
        The train. Its first body is placed already.
    fixed_pairs
        Indices of the R pairs whose angles are known from the inputs.

    Returns
    -------
    For each body that is reached: the position of the pair in `group.pairs`, the body from
    which the pair leads, and the body that it places.
    """
    positions = [
        position for position, pair in enumerate(group.pairs) if pair in fixed_pairs
    ]
    return find_spanning_tree(group.ends, pairs=positions)


def place_train_bodies(
    group: Group,
    body_from_link: Mapping[int, Array] | Sequence[Array],
    ends: Sequence[tuple[int, int]],
    joints: Sequence[Joint],
    angles: Mapping[int, Floats],
) -> list[Array]:
    """Return the orientations of the bodies of a train of wheels.

    A body is a set of links whose relative orientations are known. The angles of some R
    pairs follow from the inputs by gear ratios. These pairs connect all bodies, so the
    rolling contacts are not needed.

    Parameters
    ----------
    group
        The train: bodies that R pairs and rolling contacts join.
    body_from_link
        Rotations (..., 3, 3) from the axes of each link to those of its body. The index or
        key is the index of the link. The rotations are complex at complex solutions of the
        loop equations.
    ends
        Indices of the two links of each pair of the mechanism.
    joints
        The joint of each pair of the mechanism.
    angles
        Angles (...) in rad of the R pairs that the inputs determine, by index of the pair.

    Returns
    -------
    The rotation (..., 3, 3) from the axes of each body of the group to those of its first
    body.
    """
    # The bodies are placed one after another, from the first one. In each step a pair (by
    # its position in the group) leads from the parent, a body that is placed already, to
    # the child.
    rotations: dict[int, Array] = {0: np.eye(3)}
    for position, parent, child in find_train_paths(group, angles):
        pair = group.pairs[position]
        joint = revolute(joints[pair])
        first_link, second_link = ends[pair]
        # The rotation from the second to the first body is F_first Z(angle) F_second^T. The
        # columns of F are axes of the pair in each body, and Z turns about the pair axis.
        first_frame = body_from_link[first_link] @ joint.first
        second_frame = body_from_link[second_link] @ joint.second
        first_from_second = first_frame @ about_z(angles[pair])
        first_from_second = first_from_second @ transpose(second_frame)
        # The pair can lead from the parent to the child, or the other way round.
        is_forward = group.ends[position][0] == parent
        if is_forward:
            parent_from_child = first_from_second
        else:
            parent_from_child = transpose(first_from_second)
        rotations[child] = rotations[parent] @ parent_from_child
    return [rotations[body] for body in range(len(group.bodies))]
