"""Real functions of the input that change their sign where two assembly modes meet.

With R pairs only, the modes of a group are the roots of an algebraic system, and real ones
can appear or vanish only where two roots meet. There the determinant of the group's
equations is zero for both. The product of this determinant over all complex modes of the
group, and of the groups before it, does not depend on the order of the modes. It is a real
analytic function of the input, and changes its sign exactly where two real modes meet.
"""

from collections.abc import Iterable, Sequence
from math import prod

import numpy as np

from spherekit.arrays import Complexes, Floats
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.joint import revolute
from spherekit.positions.arc_equations import GroupGeometry
from spherekit.positions.elimination_order import EliminationOrder, find_elimination_orders
from spherekit.positions.group_assembly import place_train_bodies
from spherekit.positions.position_solver import PositionSolver

MAX_COMPLEX_MODES = 64
"""Largest number of complex modes of a mechanism for which the functions are computed.

Larger: more mechanisms have them, but each value takes longer.
"""
MAX_LOOPS_IN_CHAIN = 2
"""A group of more loops has a function only if it is the only group of the mechanism."""
COSTS_S = {1: 1e-5, 2: 5e-4, 3: 1e-2}
"""Approximate time (s) to solve a group at one input, by the number of its loops."""
TEST_INPUTS_RAD = (0.3183, 1.7411, 2.9127, 4.0312, 5.3779)
"""Inputs in no special position, at which elimination orders and dependences are tested."""
SAME_DETERMINANT_RATIO = 1e-9
"""Determinants that differ by less, relative to the largest, are the same.

Larger: a group that depends weakly on an earlier one counts as independent. Smaller:
rounding errors count as a dependence, and each value takes longer.
"""


def make_mode_coalescence(
    solver: PositionSolver, max_cost_s: float = np.inf
) -> "ModeCoalescence | None":
    """Return the functions of a mechanism whose signs change where modes meet.

    An assembly mode is one of the ways in which the mechanism can be put together at an
    input: a solution of its closure equations. Two modes meet at an input where their
    configurations coincide.

    There is one function of the input for each group (links that are placed together). It
    is the product of the determinants of the group's equations in all real and complex
    modes. Before two modes meet, both are real, and their determinants have opposite signs,
    so their product is negative. Behind the meeting both are conjugate complex, and their
    product is positive. So the function changes its sign.

    The functions are known for mechanisms with one input whose groups are trains of wheels,
    dyads and triads, or a single group of three loops.

    Parameters
    ----------
    solver
        The mechanism.
    max_cost_s
        Longest time (s) that one value may take for a group of three loops.

    Returns
    -------
    The functions; None if they are not known or take too long.
    """
    groups = solver.assembly.groups
    if len(solver.driven) != 1:
        return None
    # Elimination orders of each group but trains of wheels: ways to solve its equations,
    # each with the same number of solutions (roots).
    orders_by_group = []
    for position, group in enumerate(groups):
        if position in solver.wheel_trains:
            continue
        # `COSTS_S` has the numbers of loops for which elimination is tried.
        can_have_orders = group.revolute and group.loops in COSTS_S
        orders = find_elimination_orders(group) if can_have_orders else ()
        if not orders:
            return None
        orders_by_group.append(orders)
    # A mode of the mechanism combines one root of each group.
    mode_count = prod(orders[0].root_count for orders in orders_by_group)
    if mode_count > MAX_COMPLEX_MODES:
        return None
    # Number of loops of each group: elimination removes one link for each loop.
    loop_counts = [len(orders[0].removed_links) for orders in orders_by_group]
    max_loops = max(loop_counts, default=0)
    if max_loops > MAX_LOOPS_IN_CHAIN:
        # Beside other groups, this group would have to be solved in each of their modes,
        # which takes too long in any case.
        if len(groups) > 1:
            return None
        if COSTS_S.get(max_loops, 0.0) > max_cost_s:
            return None
    return ModeCoalescence(solver)


class ModeCoalescence:
    """The real analytic functions of the inputs whose signs change where modes meet.

    There is one function for each group: the product, over all modes, of the determinant of
    the group's equations. The modes are those of the group itself, in all modes of the
    earlier groups on which it depends. If the group does not depend on an earlier one, its
    determinant is the same in each mode of that earlier group. Only one of these equal
    factors is then taken. With all of them, the product would be a power of the function.

    Parameters
    ----------
    solver
        A mechanism whose groups have R pairs and an elimination, or are trains of wheels.

    Attributes
    ----------
    groups
        The groups in solving order.
    cost
        Approximate time (s) that one value of all functions takes.
    """

    def __init__(self, solver: PositionSolver) -> None:
        """Choose an elimination order for each group, and find on which groups it depends.

        A group is a set of bodies that are placed together, by equations for the unknown
        angles. A mode is one solution of these equations. The determinant of a mode is that
        of the matrix of derivatives of the equations by the angles. An instance computes,
        for each group, the product of the determinants of all modes. As a function of the
        input, this product changes its sign where two modes coincide.

        An elimination order states in which order the angles are eliminated. The first
        order whose determinants are finite at some test inputs is used. If there is none,
        the last one is used, and the products are NaN.

        The position of a group, and so its determinants, may differ between the modes of
        groups that are placed earlier.
        """
        self.solver = solver
        self.groups = solver.assembly.groups
        all_groups = frozenset(range(len(self.groups)))
        # (test inputs, inputs): a different value for each input.
        test_inputs = np.add.outer(TEST_INPUTS_RAD, np.arange(len(solver.driven)))
        # For each group its elimination order, None for trains of wheels, which have a
        # single mode and need no elimination.
        self._orders: list[EliminationOrder | None] = []
        # For each group the earlier groups on whose modes its determinants depend.
        self._dependences: list[frozenset[int]] = []
        for position, group in enumerate(self.groups):
            is_train = position in solver.wheel_trains
            candidates = (None,) if is_train else find_elimination_orders(group)
            self._orders.append(None)
            for candidate in candidates:
                self._orders[position] = candidate
                # On which groups the determinants depend is not known yet. They are
                # computed in all modes of all earlier groups.
                determinants = self._compute_determinants(
                    position, test_inputs, dependence=all_groups
                )
                if all_finite(determinants):
                    break
            # The group depends on an earlier one if the determinants at the test inputs are
            # not the same in all modes of that one.
            self._dependences.append(self._find_dependence(position, determinants))
        # Approximate time (s) to compute the products of all groups at one input. Each
        # group is solved once in each mode of the groups on which it depends. `COSTS_S` is
        # the time to solve a group, by its number of loops. A train of wheels with another
        # number of loops counts as two loops.
        self.cost = sum(
            COSTS_S.get(group.loops, COSTS_S[2]) * prod(map(self._count_modes, dependence))
            for group, dependence in zip(self.groups, self._dependences, strict=True)
        )

    def _count_modes(self, position: int) -> int:
        """Return the number of complex modes of a group; a train of wheels has one."""
        order = self._orders[position]
        return 1 if order is None else order.root_count

    def count_factors(self, position: int) -> int:
        """Return the number of determinants whose product is the function of a group.

        There is one for each complex mode of the group, in each complex mode of the earlier
        groups on which it depends.
        """
        return prod(map(self._count_modes, (*self._dependences[position], position)))

    def __call__(self, position: int, q: Floats) -> Floats:
        """Evaluate the function of a group, whose sign changes where two modes meet.

        A group is a set of bodies that are placed together, and a mode is one solution of
        its equations. The function is the product of the determinants of these equations in
        all modes, real and complex.

        The product of two real modes that are about to meet is negative, because their
        determinants have opposite signs. Beyond the meeting both modes are complex and
        conjugate, so their product is positive.

        Parameters
        ----------
        position
            Position of the group in solving order.
        q
            (n,) values of the only input (rad).

        Returns
        -------
        (n,) values. NaN if not all modes were computed, as when there are infinitely many,
        or if the product exceeds float64.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            determinants = self._compute_determinants(
                position, q[:, None], self._dependences[position]
            )
            # Complex modes come in conjugate pairs, so that the product is real.
            function = np.prod(determinants, axis=1).real
        return np.where(np.isfinite(function), function, np.nan)

    def configurations(self, q: Floats) -> Complexes:
        """Return the pair angles of all complex modes of a mechanism of R pairs.

        A mode is a solution of the equations of all groups. Complex ones have no
        configuration, but can become real if sizes or inputs change.

        Parameters
        ----------
        q
            (inputs,) values of the inputs (rad).

        Returns
        -------
        (modes, pairs) complex angles (rad). NaN for modes that were not computed, as when
        there are infinitely many.
        """
        with np.errstate(all="ignore"):
            # Place the links of all groups in all complex modes, at a single sample.
            group_count = len(self.groups)
            all_groups = frozenset(range(group_count))
            body_from_link = self._place_links(group_count, q[None], all_groups)
            pairs = range(len(self.solver.joints))
            first_frames, second_frames = self._pair_frames(pairs, body_from_link)
            # (pairs, modes, 3, 3) frames of each pair in common axes. The x axis x2 of the
            # second frame has the components cos(angle) and sin(angle) in the first frame,
            # so x . x2 + i y . x2 is exp(i angle). Complex axes are multiplied without
            # conjugation.
            x_and_iy = first_frames[..., 0] + 1j * first_frames[..., 1]
            exponentials = np.sum(x_and_iy * second_frames[..., 0], axis=-1)
            return -1j * np.log(exponentials).T

    def _compute_determinants(
        self, position: int, q: Floats, dependence: frozenset[int]
    ) -> Complexes:
        """Return the determinants of a group's equations in all complex modes.

        A group is a set of bodies that are placed together. A mode is one real or complex
        solution of its equations. The determinant of a mode is that of the matrix of
        derivatives of the equations by the unknown angles.

        Parameters
        ----------
        position
            Position of the group in solving order.
        q
            (n, inputs) values of the inputs (rad).
        dependence
            Positions of the earlier groups in all modes of which the determinants are
            computed. Other groups are placed in one mode only.

        Returns
        -------
        (n, modes) determinants. The number of modes is the product of the numbers of modes
        of the group and of the groups in `dependence`. A determinant is zero where two
        modes meet. A train of wheels has a single mode, which meets no other: its value is
        1.
        """
        # The order in which the angles are eliminated; None for a train of wheels.
        order = self._orders[position]
        group = self.groups[position]
        # Modes that could not be computed are NaN, which is no reason for a warning.
        with np.errstate(all="ignore"):
            # Rotations of the links in the modes of the earlier groups: (n, modes, 3, 3)
            # for each link.
            body_from_link = self._place_links(position, q, dependence)
            if order is None:
                mode_count = body_from_link[0].shape[1]
                return np.ones((len(q), mode_count), dtype=complex)
            geometry = GroupGeometry(group, self._pair_frames(group.pairs, body_from_link))
            # The determinants (n * modes of earlier groups, modes of the group) become
            # (n, modes).
            _, determinants = geometry.solve_equations(order)
            return determinants.reshape(len(q), -1)

    def _place_links(
        self, group_count: int, q: Floats, dependence: frozenset[int]
    ) -> list[Complexes]:
        """Place the first groups in their complex modes.

        A complex mode is one of the real or complex solutions of the equations of a group.
        A body is a set of links whose relative orientations are known. `_orders` has the
        elimination order of each group, by which its equations are solved (None for a train
        of wheels).

        Parameters
        ----------
        group_count
            Number of groups to place.
        q
            (n, inputs) values of the inputs (rad).
        dependence
            Positions of the groups that are placed in all their modes. The others are
            placed in their first mode only.

        Returns
        -------
        For each link the rotation (n, modes, 3, 3) from its axes to those of its body. It
        is complex in a complex mode.
        """
        state = self.solver.start(q)
        ends = self.solver.mechanism.ends
        body_from_link = [
            state.body_from_link[link][:, None].astype(complex)
            for link in sorted(state.body_from_link)
        ]
        train_angles = {
            pair: angle[:, None] for pair, angle in self.solver.gear_train_angles(q).items()
        }
        for position, group in enumerate(self.groups[:group_count]):
            order = self._orders[position]
            mode_count = self._count_modes(position)
            if order is None:
                rotations = place_train_bodies(
                    group,
                    body_from_link=body_from_link,
                    ends=ends,
                    joints=self.solver.joints,
                    angles=train_angles,
                )
            else:
                geometry = GroupGeometry(
                    group, self._pair_frames(group.pairs, body_from_link)
                )
                tree_angles, _ = geometry.solve_equations(order)
                placed = geometry.place_bodies(order, tree_angles)
                # From (n * modes before, modes of the group, bodies, 3, 3) to
                # (n, modes so far, bodies, 3, 3).
                placed = placed.reshape(len(q), -1, *placed.shape[2:])
                rotations = [placed[:, :, body] for body in range(placed.shape[2])]
                # Each earlier mode is followed by as many modes of this group.
                body_from_link = [
                    np.repeat(rotation, mode_count, axis=1) for rotation in body_from_link
                ]
            for rotation, links in zip(rotations, group.bodies, strict=True):
                for link in links:
                    body_from_link[link] = rotation @ body_from_link[link]
            # The modes of the group follow one another for each earlier mode. If only one
            # is needed, the first one is kept.
            if position not in dependence:
                body_from_link = [rotation[:, ::mode_count] for rotation in body_from_link]
        return body_from_link

    def _pair_frames(
        self, pairs: Iterable[int], body_from_link: Sequence[Complexes]
    ) -> Complexes:
        """Return the frames of pairs in both their bodies.

        A body is a set of links whose relative orientations are known. A mode is a real or
        complex solution of the closure equations. In a complex mode the frames are complex.

        Parameters
        ----------
        pairs
            Numbers of the pairs.
        body_from_link
            For each link the rotation (n, modes, 3, 3) from its axes to those of its body,
            at n values of the inputs.

        Returns
        -------
        (2, pairs, n * modes, 3, 3) frames in the first [0] and in the second [1] body.
        """
        # For each pair its two frames (n, modes, 3, 3).
        frames = []
        for pair in pairs:
            joint = revolute(self.solver.joints[pair])
            first_link, second_link = self.solver.mechanism.ends[pair]
            frames.append(
                (
                    body_from_link[first_link] @ joint.first,
                    body_from_link[second_link] @ joint.second,
                )
            )
        # Inputs and modes become one axis, and the axis of both frames comes first.
        frames_by_pair = np.reshape(frames, (len(frames), 2, -1, 3, 3))
        return np.swapaxes(frames_by_pair, 0, 1)

    def _find_dependence(self, position: int, determinants: Complexes) -> frozenset[int]:
        """Return the positions of the earlier groups on whose modes a group depends.

        A group is a set of bodies that are placed together, and a mode of it is one
        solution of its equations, with the determinant of their derivatives by the unknown
        angles. A group depends on the modes of an earlier group if its determinants differ
        between them.

        Parameters
        ----------
        position
            Position of the group in solving order.
        determinants
            (test inputs, modes) determinants of the group. For each mode of the earlier
            groups, the determinants in all modes of the group itself follow one another.
        """
        counts = [self._count_modes(number) for number in range(position + 1)]
        # The determinants have the axes test input, mode of each earlier group, mode of the
        # group itself. The modes of the last axis are multiplied, because their order can
        # differ between modes of the earlier groups.
        products = np.prod(determinants.reshape(len(TEST_INPUTS_RAD), *counts), axis=-1)
        dependence = set()
        for earlier in range(position):
            if counts[earlier] > 1:
                differences = np.diff(products, axis=1 + earlier)
                # The negated comparison is also true for NaN, which counts as a dependence.
                limit = SAME_DETERMINANT_RATIO * max_abs(products)
                if not max_abs(differences) < limit:
                    dependence.add(earlier)
        return frozenset(dependence)
