"""Real functions of the input that change their sign where two assembly modes meet.

With R pairs only, the modes of a group are the roots of an algebraic system, and real ones
can appear or vanish only where two roots meet. There the determinant of the group's
equations is zero for both. The product of this determinant over all complex modes of the
group, and of the groups before it, does not depend on the order of the modes. It is a real
analytic function of the input, and changes its sign exactly where two real modes meet.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import prod

import numpy as np

from spherekit.arrays import Complexes, Floats
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.joint import revolute
from spherekit.planning.assembly_plan import Group
from spherekit.positions.arc_equations import GroupGeometry
from spherekit.positions.elimination_order import EliminationOrder, find_elimination_orders
from spherekit.positions.group_assembly import place_train_bodies
from spherekit.positions.position_solver import PositionSolver

MAX_COMPLEX_MODES = 64
"""Largest number of complex modes of a mechanism for which the functions are computed.

Larger: more mechanisms have them, but each value takes longer.
"""
MAX_LOOPS_BESIDE_OTHERS = 2
"""Largest number of loops of a group in a mechanism that has other groups, too.

A group beside others is solved in each of their modes, which takes too long for more loops.
"""
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
    if len(solver.driven) != 1:
        return None
    orders = find_first_orders(solver)
    if orders is None:
        return None
    # A mode of the mechanism combines one root of each group.
    mode_count = prod(order.root_count for order in orders)
    if mode_count > MAX_COMPLEX_MODES:
        return None
    # One link is removed for each loop of a group.
    max_loops = max((len(order.removed_links) for order in orders), default=0)
    if max_loops > MAX_LOOPS_BESIDE_OTHERS:
        is_only_group = len(solver.assembly.groups) == 1
        if not is_only_group or COSTS_S[max_loops] > max_cost_s:
            return None
    return ModeCoalescence(solver)


def find_first_orders(solver: PositionSolver) -> list[EliminationOrder] | None:
    """Return an elimination order of each group that is not a train of wheels.

    An elimination order states how the equations of a group are solved. All orders of a
    group give the same number of solutions (roots), so the first one shows how many modes
    the group has. The result is None if the equations of a group cannot be solved by
    elimination: if it has contacts, more loops than `COSTS_S` has, or no order.
    """
    first_orders = []
    for position, group in enumerate(solver.assembly.groups):
        if position in solver.wheel_trains:
            continue
        if not group.revolute or group.loops not in COSTS_S:
            return None
        orders = find_elimination_orders(group)
        if not orders:
            return None
        first_orders.append(orders[0])
    return first_orders


@dataclass(frozen=True)
class OrderTrial:
    """An elimination order of a group, with what it gives at the test inputs.

    Attributes
    ----------
    order
        The order in which the angles are eliminated. None for a train of wheels, which has
        a single mode and needs no elimination.
    determinants
        (test inputs, modes) determinants of the group's equations. The modes of the group
        are combined with all modes of the groups that are placed before.
    """

    order: EliminationOrder | None
    determinants: Complexes


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
        angles. Its elimination order states in which order these angles are eliminated. A
        group depends on another one that is placed before if it has other determinants in
        other modes of that group.
        """
        self.solver = solver
        self.groups = solver.assembly.groups
        # For each group its elimination order, None for trains of wheels.
        self._orders: list[EliminationOrder | None] = []
        # For each group the earlier groups on whose modes its determinants depend.
        self._dependences: list[frozenset[int]] = []
        for position in range(len(self.groups)):
            trial = self._choose_order(position)
            self._orders.append(trial.order)
            self._dependences.append(self._find_dependence(position, trial.determinants))
        self.cost = sum(map(self._estimate_cost, range(len(self.groups))))

    def _choose_order(self, position: int) -> OrderTrial:
        """Return an elimination order that works for a group at the test inputs.

        It is the first order whose determinants are finite at these inputs. If there is
        none, it is the last one, and the functions of this class are NaN. All earlier
        groups must have their orders already.
        """
        # A different value for each input: (test inputs, inputs).
        test_inputs = np.add.outer(TEST_INPUTS_RAD, np.arange(len(self.solver.driven)))
        orders: Sequence[EliminationOrder | None] = (None,)
        if position not in self.solver.wheel_trains:
            orders = find_elimination_orders(self.groups[position])
        for order in orders:
            # On which earlier groups the determinants depend is not known yet, so the modes
            # of all of them are combined.
            determinants = self._compute_determinants(
                position, order, q=test_inputs, combined_groups=frozenset(range(position))
            )
            if all_finite(determinants):
                break
        return OrderTrial(order, determinants)

    def _estimate_cost(self, position: int) -> float:
        """Return the time (s) to compute the function of a group at one input.

        The group is solved once in each mode of the groups on which it depends. A train of
        wheels with a number of loops that `COSTS_S` does not have counts as two loops.
        """
        solution_count = prod(map(self._count_modes, self._dependences[position]))
        return COSTS_S.get(self.groups[position].loops, COSTS_S[2]) * solution_count

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
                position,
                self._orders[position],
                q=q[:, None],
                combined_groups=self._dependences[position],
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
            body_from_link = self._place_links(
                group_count=len(self.groups),
                q=q[None],
                combined_groups=frozenset(range(len(self.groups))),
            )
            # All links are in one body now, so both frames of a pair have the same axes.
            # There is one value of the inputs, at index 0: (pairs, modes, 3, 3) remains.
            pairs = range(len(self.solver.joints))
            first_frames, second_frames = self._pair_frames(pairs, body_from_link)[:, :, 0]
            return measure_complex_angles(first_frames, second_frames).T

    def _compute_determinants(
        self,
        position: int,
        order: EliminationOrder | None,
        q: Floats,
        combined_groups: frozenset[int],
    ) -> Complexes:
        """Return the determinants of a group's equations in all its complex modes.

        A group is a set of bodies that are placed together. A mode is one real or complex
        solution of its equations. The determinant of a mode is that of the matrix of
        derivatives of the equations by the unknown angles. It is zero where two modes meet.

        Groups that are placed earlier have modes, too. The determinants are computed for
        each combination of a mode of the group with one mode of each combined group.

        Parameters
        ----------
        position
            Position of the group in solving order.
        order
            The order in which its angles are eliminated. None for a train of wheels, which
            has a single mode that meets no other: its determinant is set to 1.
        q
            (n, inputs) values of the inputs (rad).
        combined_groups
            Positions of the earlier groups all of whose modes are combined. The other
            earlier groups are placed in their first mode only, which is enough if the
            determinants are the same in each of their modes.

        Returns
        -------
        (n, combinations) determinants. For each combination of modes of earlier groups, the
        modes of the group itself follow one another.
        """
        group = self.groups[position]
        # Modes that could not be computed are NaN, which is no reason for a warning.
        with np.errstate(all="ignore"):
            body_from_link = self._place_links(position, q, combined_groups)
            if order is None:
                mode_count = body_from_link[0].shape[1]
                return np.ones((len(q), mode_count), dtype=complex)
            geometry = self._form_geometry(group, body_from_link)
            _, determinants = geometry.solve_equations(order)
            return separate_inputs(determinants, input_count=len(q))

    def _place_links(
        self, group_count: int, q: Floats, combined_groups: frozenset[int]
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
        combined_groups
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
                geometry = self._form_geometry(group, body_from_link)
                tree_angles, _ = geometry.solve_equations(order)
                # (n, modes of the groups so far, bodies, 3, 3)
                placed = separate_inputs(
                    geometry.place_bodies(order, tree_angles), input_count=len(q)
                )
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
            if position not in combined_groups:
                body_from_link = [rotation[:, ::mode_count] for rotation in body_from_link]
        return body_from_link

    def _form_geometry(
        self, group: Group, body_from_link: Sequence[Complexes]
    ) -> GroupGeometry:
        """Return the equations of a group, in each mode of the earlier groups.

        The geometry has a single axis of samples. Its samples are all modes at the first
        value of the inputs, then all modes at the next value, and so on. Results are
        divided by value of the inputs again with `separate_inputs`.

        Parameters
        ----------
        group
            The group.
        body_from_link
            For each link the rotation (n, modes, 3, 3) from its axes to those of its body,
            at n values of the inputs, in the modes of the earlier groups.
        """
        frames = self._pair_frames(group.pairs, body_from_link)
        return GroupGeometry(group, frames.reshape(2, len(group.pairs), -1, 3, 3))

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
        (2, pairs, n, modes, 3, 3) frames in the first [0] and in the second [1] body.
        """
        first_frames = []
        second_frames = []
        for pair in pairs:
            joint = revolute(self.solver.joints[pair])
            first_link, second_link = self.solver.mechanism.ends[pair]
            first_frames.append(body_from_link[first_link] @ joint.first)
            second_frames.append(body_from_link[second_link] @ joint.second)
        return np.array([first_frames, second_frames])

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
        # The axes become: test input, mode of each earlier group, mode of the group itself.
        mode_counts = [self._count_modes(number) for number in range(position + 1)]
        determinants = determinants.reshape(len(TEST_INPUTS_RAD), *mode_counts)
        # The modes of the group itself can have another order in another mode of an earlier
        # group. The product of their determinants does not depend on this order.
        products = np.prod(determinants, axis=-1)
        first_earlier_axis = 1
        return frozenset(
            earlier
            for earlier in range(position)
            if differs_along(products, axis=first_earlier_axis + earlier)
        )


def measure_complex_angles(first_frames: Complexes, second_frames: Complexes) -> Complexes:
    """Return the complex angles about the z axis from first frames to second frames.

    If x and y are axes of the first frame, the x axis x2 of the second frame is
    x cos(angle) + y sin(angle). So x . x2 + i y . x2 = exp(i angle). The equations also
    hold for complex angles, with scalar products without conjugation.

    Parameters
    ----------
    first_frames, second_frames
        (..., 3, 3) frames with the same z axis. Their columns are the x, y and z axes.

    Returns
    -------
    (...) complex angles (rad).
    """
    first_x = first_frames[..., 0]
    first_y = first_frames[..., 1]
    second_x = second_frames[..., 0]
    exponentials = np.sum((first_x + 1j * first_y) * second_x, axis=-1)
    return -1j * np.log(exponentials)


def separate_inputs(solutions: Complexes, input_count: int) -> Complexes:
    """Divide the solutions of a group by value of the inputs.

    Parameters
    ----------
    solutions
        (n * earlier modes, modes of the group, ...) solutions, first those at the first
        value of the inputs.
    input_count
        Number n of values of the inputs.

    Returns
    -------
    (n, earlier modes * modes of the group, ...) solutions. For each earlier mode, the modes
    of the group follow one another.
    """
    return solutions.reshape(input_count, -1, *solutions.shape[2:])


def differs_along(products: Complexes, axis: int) -> bool:
    """Return whether neighbouring numbers along an axis differ by more than rounding.

    Differences are compared with the largest number of the whole array. NaN counts as a
    difference.
    """
    if products.shape[axis] == 1:
        return False
    limit = SAME_DETERMINANT_RATIO * max_abs(products)
    is_same = max_abs(np.diff(products, axis=axis)) < limit
    return not is_same
