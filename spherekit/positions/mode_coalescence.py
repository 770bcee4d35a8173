"""Real functions of the input that change their sign where two assembly modes meet.

With R pairs only, the modes of a group are the roots of an algebraic system, and real ones
can appear or vanish only where two roots meet. There the determinant of the group's
equations is zero for both. The product of this determinant over all complex modes of the
group, and of the groups before it, does not depend on the order of the modes. This product
is a real analytic function of the input. It is zero where two real modes meet, and changes
its sign if both end there. Where curves cross and both modes continue, it keeps its sign.
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
    """Return the functions of the input that change their signs where assembly modes meet.

    An assembly mode is one way to assemble the mechanism at an input: a solution of its
    closure equations. Two modes meet at an input where their configurations coincide.
    Callers find this input as the place at which a function changes its sign.

    Each group (links that are placed together) has one function: the product of the
    determinants of its equations in all real and complex modes. Before two modes meet, both
    are real, and their determinants have opposite signs and a negative product. Behind the
    meeting both modes are conjugate complex, and their product is positive.

    The functions exist for mechanisms with one input. The groups must be trains of wheels,
    dyads (two links) or triads (four links). The only other case is a mechanism that is a
    single group of three loops.

    Parameters
    ----------
    solver
        The mechanism.
    max_cost_s
        Largest computing time (s) of one value, for a group of three loops.

    Returns
    -------
    The functions; None for other mechanisms, or if the computation takes too long.
    """
    if len(solver.driven) != 1:
        return None
    # An elimination order states how the equations of a group are solved. All orders of a
    # group give the same number of solutions (roots), so one order of each is enough here.
    orders = find_first_orders(solver)
    if orders is None:
        return None
    # A mode of the mechanism combines one root of each group.
    mode_count = prod(order.root_count for order in orders)
    if mode_count > MAX_COMPLEX_MODES:
        return None
    # An elimination order removes one link for each loop of its group.
    loop_counts = [len(order.removed_links) for order in orders]
    max_loops = max(loop_counts, default=0)
    # A group of three loops is slow. If the mechanism had other groups too, it would have
    # to be solved in each of their modes, which takes too long.
    if max_loops > MAX_LOOPS_BESIDE_OTHERS:
        is_only_group = len(solver.assembly.groups) == 1
        if not is_only_group or COSTS_S[max_loops] > max_cost_s:
            return None
    return ModeCoalescence(solver)


def find_first_orders(solver: PositionSolver) -> list[EliminationOrder] | None:
    """Return one elimination order of each group, to count the modes of the group.

    A group consists of links that are placed together. An elimination order states how its
    equations are solved. All orders of a group give the same number of solutions (roots),
    so the first order is enough. Trains of wheels are left out, since they have one mode.

    Returns
    -------
    The orders. None if a group has contacts, does not have one to three loops, or has no
    elimination order.
    """
    first_orders = []
    for position, group in enumerate(solver.assembly.groups):
        if position in solver.wheel_trains:
            continue
        # `COSTS_S` lists the computing time for one, two and three loops.
        if not group.revolute or group.loops not in COSTS_S:
            return None
        orders = find_elimination_orders(group)
        if not orders:
            return None
        first_orders.append(orders[0])
    return first_orders


@dataclass(frozen=True)
class OrderTrial:
    """An elimination order of a group, with the determinants that it gives at test inputs.

    A group consists of links that are placed together by equations for unknown angles. The
    equations are solved by elimination, which can fail in some orders. Each order is
    therefore tried at a few test inputs. It works if all determinants are finite. If
    they differ between the modes of an earlier group, the group depends on that group.

    Attributes
    ----------
    order
        The order in which the angles are eliminated. None for a train of wheels, which has
        one mode and needs no elimination.
    determinants
        (test inputs, modes) determinants of the derivatives of the equations with respect
        to the unknown angles. NaN where the elimination failed. A mode is a solution of the
        group, combined with a solution of each group that is placed before.
    """

    order: EliminationOrder | None
    determinants: Complexes


class ModeCoalescence:
    """The real analytic functions of the inputs whose signs change where modes meet.

    A group is a set of bodies that are placed together. A mode is one of its solutions,
    real or complex. Where two modes meet, the determinant of the velocity equations of the
    group is zero. Each group has one function: the product of this determinant over all its
    modes. If the determinant depends on earlier groups, the product runs over the modes of
    these groups too.

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
        """Prepare one function for each group, whose sign changes where two modes meet.

        A group is a set of bodies that are placed together by equations for unknown angles.
        Each solution of the equations is a mode of the group. The determinant of a mode is
        the determinant of the derivatives of the equations. The function of the group is
        the product of the determinants of all its modes. Two things are prepared for it:

        - The order in which the unknown angles are eliminated from the equations.
        - The earlier groups on whose modes the determinants depend. The product then runs
          over the combinations of modes of the group with modes of these groups only.
        """
        self.solver = solver
        self.groups = solver.assembly.groups
        # For each group its elimination order. None for a train of wheels: gear ratios give
        # its angles.
        self._orders: list[EliminationOrder | None] = []
        # For each group the indices of the earlier groups on which its determinants depend.
        self._dependences: list[frozenset[int]] = []
        for position in range(len(self.groups)):
            # Elimination fails in some orders, so they are tried at a few test inputs.
            # `trial` has the first order that works, and the determinants at these inputs.
            trial = self._choose_order(position)
            self._orders.append(trial.order)
            # The group depends on an earlier group if the determinants differ between the
            # modes of that group.
            dependence = self._find_dependence(position, trial.determinants)
            self._dependences.append(dependence)
        # Estimated time (s) to compute the functions of all groups at one input.
        self.cost = sum(map(self._estimate_cost, range(len(self.groups))))

    def _choose_order(self, position: int) -> OrderTrial:
        """Return an elimination order that works for a group at the test inputs.

        A group is a set of bodies that are placed together by equations for unknown angles.
        An elimination order is the order in which these angles are eliminated from the
        equations. Elimination fails in some orders, so the orders are tried one after the
        other.

        Each mode (solution of the equations) has a determinant: that of the derivatives of
        the equations with respect to the unknown angles. The function of the group is the
        product of these determinants. They are NaN where the elimination fails. So an order
        works if all determinants at the test inputs are finite.

        Parameters
        ----------
        position
            Position of the group in solving order. All earlier groups must have their
            orders.

        Returns
        -------
        The first order that works, or the last one if none works. The result also has the
        determinants. The caller finds from them on which earlier groups the group depends.
        """
        # Shape (test inputs, inputs): the inputs of a test differ from each other.
        test_inputs = np.add.outer(TEST_INPUTS_RAD, np.arange(len(self.solver.driven)))
        orders: Sequence[EliminationOrder | None]
        if position in self.solver.wheel_trains:
            # Gear ratios give the angles of a train of wheels, without elimination.
            orders = (None,)
        else:
            orders = find_elimination_orders(self.groups[position])
        for order in orders:
            # All modes of all earlier groups are combined, because the groups on which the
            # determinants depend are not known yet.
            determinants = self._compute_determinants(
                position, order, q=test_inputs, combined_groups=frozenset(range(position))
            )
            if all_finite(determinants):
                break
        return OrderTrial(order, determinants)

    def _estimate_cost(self, position: int) -> float:
        """Return the time (s) to compute the function of a group at one input.

        The function changes its sign where two modes (solutions) of the group meet. The
        group is solved once in each mode of the groups on which it depends. `COSTS_S` has
        the time of one solution by the number of loops. For other numbers, which only
        trains of wheels have, the time of two loops is taken.
        """
        solution_count = prod(map(self._count_modes, self._dependences[position]))
        return COSTS_S.get(self.groups[position].loops, COSTS_S[2]) * solution_count

    def _count_modes(self, position: int) -> int:
        """Return the number of complex modes of a group; a train of wheels has one."""
        order = self._orders[position]
        return 1 if order is None else order.root_count

    def count_factors(self, position: int) -> int:
        """Return the number of determinants whose product is the function of a group.

        The function changes its sign where two modes of the group meet. A complex mode is a
        real or complex solution of the equations of a group. There is one determinant for
        each complex mode of the group and of the earlier groups on which it depends.
        """
        return prod(map(self._count_modes, (*self._dependences[position], position)))

    def __call__(self, position: int, q: Floats) -> Floats:
        """Evaluate the function of a group, whose sign changes where two modes meet.

        A group is a set of bodies that are placed together. A mode is one solution of its
        equations, real or complex. The determinant of a mode is the determinant of the
        derivatives of the equations. The function is the product of the determinants of all
        modes.

        Two real modes that are about to meet have determinants with opposite signs. Their
        product is therefore negative. Beyond the meeting both modes are complex and
        conjugate, and their product is positive.

        Parameters
        ----------
        position
            Position of the group in solving order.
        q
            (n,) values of the only input (rad).

        Returns
        -------
        (n,) values. NaN if modes are missing (for example if there are infinitely many), or
        if the product exceeds float64.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            determinants = self._compute_determinants(
                position,
                # The order in which the unknown angles are eliminated from the equations.
                self._orders[position],
                q=q[:, None],
                # The determinants depend on the modes of these earlier groups. The product
                # therefore runs over all combinations of modes.
                combined_groups=self._dependences[position],
            )
            # Complex modes come in conjugate pairs, so the product is real.
            function = np.prod(determinants, axis=1).real
        return np.where(np.isfinite(function), function, np.nan)

    def configurations(self, q: Floats) -> Complexes:
        """Return the pair angles of all real and complex modes at one value of the inputs.

        A mode is a solution of the closure equations of a mechanism of revolute pairs. A
        complex mode is not a real configuration, but can become real if sizes or inputs
        change.

        Parameters
        ----------
        q
            (inputs,) values of the inputs (rad).

        Returns
        -------
        (modes, pairs) complex angles (rad). NaN for modes that were not found, for example
        if there are infinitely many.
        """
        # A group is a set of links that are placed together. A mode of the mechanism
        # combines one mode of each group. All modes of all groups are needed here.
        group_count = len(self.groups)
        all_groups = frozenset(range(group_count))
        with np.errstate(all="ignore"):
            body_from_link = self._place_links(
                group_count, q=q[None], combined_groups=all_groups
            )
            # All groups are placed, so all links are in the same axes now. The two frames
            # of a pair, one in each of its links, differ only by the angle of the pair.
            pairs = range(len(self.solver.joints))
            # (pairs, 1, modes, 3, 3). The second axis is the value of the inputs.
            first_frames, second_frames = self._pair_frames(pairs, body_from_link)
            angles = measure_complex_angles(first_frames[:, 0], second_frames[:, 0])
            return angles.T  # (modes, pairs)

    def _compute_determinants(
        self,
        position: int,
        order: EliminationOrder | None,
        q: Floats,
        combined_groups: frozenset[int],
    ) -> Complexes:
        """Return the determinants of a group's equations in all its complex modes.

        A group is a set of bodies that are placed together. A body is a set of links whose
        relative orientations are known. A mode is one real or complex solution of the
        equations of a group. The determinant is formed from the derivatives of the
        equations with respect to the unknown angles. The determinant is zero where two
        modes meet.

        Groups that are placed earlier have modes, too. The groups in `combined_groups` are
        placed in all their modes. The determinants do not depend on the modes of other
        earlier groups, of which only the first mode is used. An earlier combination has one
        mode of each earlier group. The determinants are computed for each earlier
        combination and each mode of this group.

        Parameters
        ----------
        position
            Position of the group in solving order.
        order
            The order in which the unknown angles are eliminated. None for a train of
            wheels. A train has one mode, and its determinant is set to 1.
        q
            (n, inputs) values of the inputs (rad).
        combined_groups
            Positions of the earlier groups on whose modes the determinants can depend.

        Returns
        -------
        (n, combinations) determinants: those of all modes of this group in the first
        earlier combination, then those in the next one.
        """
        group = self.groups[position]
        # Modes that could not be computed are NaN, without a warning of NumPy.
        with np.errstate(all="ignore"):
            # For each link the rotation (n, earlier combinations, 3, 3) from its axes to
            # those of its body.
            body_from_link = self._place_links(position, q, combined_groups)
            if order is None:
                combination_count = body_from_link[0].shape[1]
                return np.ones((len(q), combination_count), dtype=complex)
            # The group is solved at each input and in each earlier combination. The
            # determinants (n * earlier combinations, modes) get an axis for the inputs.
            geometry = self._form_geometry(group, body_from_link)
            _angles, determinants = geometry.solve_equations(order)
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
            Positions of the groups that are placed in all their modes. Other groups are
            placed in their first mode only.

        Returns
        -------
        For each link the rotation (n, modes, 3, 3) from its axes to those of its body. The
        rotation is complex in a complex mode.
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
            # The modes of the group follow one another for each earlier mode. If one mode
            # of the group is enough, the first one is kept.
            if position not in combined_groups:
                body_from_link = [rotation[:, ::mode_count] for rotation in body_from_link]
        return body_from_link

    def _form_geometry(
        self, group: Group, body_from_link: Sequence[Complexes]
    ) -> GroupGeometry:
        """Return the pair frames of a group, from which its equations are formed.

        A pair joins two bodies. It has two frames, one for each body. A frame is the
        rotation from the axes of the pair to those of the body.

        The frames depend on the inputs, and on the modes (solutions) of the groups placed
        before. In the result, inputs and modes share one axis of the arrays. On this axis,
        all modes at the first value of the inputs come first, then those at the second.

        Parameters
        ----------
        group
            The bodies that are placed together, and the pairs (joints) that join them.
        body_from_link
            For each link the rotation (n, modes, 3, 3) from its axes to those of its
            body (a set of links that are placed already), at n values of the inputs.
        """
        # Axes of `frames`: first or second body, pair, input value, mode, 3, 3.
        frames = self._pair_frames(group.pairs, body_from_link)
        return GroupGeometry(group, frames.reshape(2, len(group.pairs), -1, 3, 3))

    def _pair_frames(
        self, pairs: Iterable[int], body_from_link: Sequence[Complexes]
    ) -> Complexes:
        """Return the frames of revolute pairs in the axes of both their bodies.

        A body is a set of links with known relative orientations. A frame is the rotation
        from the axes of a pair to those of a body. The closure equations of the next group
        of links, or the angles of pairs, are computed from the frames. A mode is a solution
        of the closure equations. In complex modes the frames are complex, too.

        Parameters
        ----------
        pairs
            Indices of the pairs.
        body_from_link
            For each link the rotation (n, modes, 3, 3) from the axes of the link to those
            of its body, at n values of the inputs and in each mode.

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
        """Return the positions of the earlier groups on which the determinants depend.

        A group is a set of bodies that are placed together. Its modes are the solutions of
        its equations. Groups that are placed earlier have modes, too. The group depends on
        an earlier one if the determinants of the group differ between the modes of the
        earlier one. The function of the group then combines its modes with the modes of
        only these earlier groups, which saves time.

        Parameters
        ----------
        position
            Position of the group in solving order.
        determinants
            (test inputs, combinations) determinants of the derivatives of the group's
            equations. A combination has one mode of each earlier group and one mode of the
            group itself. The mode of the group itself changes fastest along the axis.
        """
        # The axes become: test input, mode of each earlier group, mode of the group itself.
        mode_counts = [self._count_modes(number) for number in range(position + 1)]
        determinants = determinants.reshape(len(TEST_INPUTS_RAD), *mode_counts)
        # In another mode of an earlier group, the modes of the group can be in another
        # order. Products over the modes of the group do not depend on their order.
        products = np.prod(determinants, axis=-1)
        first_earlier_axis = 1
        return frozenset(
            earlier
            for earlier in range(position)
            if differs_along(products, axis=first_earlier_axis + earlier)
        )


def measure_complex_angles(first_frames: Complexes, second_frames: Complexes) -> Complexes:
    """Return the complex angles about the z axis that turn first frames into second frames.

    Complex angles occur in complex solutions of the closure equations. The caller knows the
    frames of a pair (joint) on its two links, and needs the angle of the pair.

    With the axes x and y of the first frame, the x axis of the second frame is
    x2 = x cos(angle) + y sin(angle). Therefore x . x2 + i y . x2 = exp(i angle). For
    complex angles, the scalar products must be formed without complex conjugation.

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
    """Reshape the solutions of a group so that values of the inputs have their own axis.

    A group is a set of bodies that are placed together; its solutions are its modes. The
    group is solved for each value of the inputs and each mode of the groups placed earlier.

    Parameters
    ----------
    solutions
        (n * earlier modes, modes of the group, ...) solutions. All those at the first value
        of the inputs come first.
    input_count
        Number n of different values of the inputs.

    Returns
    -------
    (n, earlier modes * modes of the group, ...) solutions. The mode of the group changes
    fastest along the second axis.
    """
    return solutions.reshape(input_count, -1, *solutions.shape[2:])


def differs_along(products: Complexes, axis: int) -> bool:
    """Return whether products of determinants vary along an axis by more than rounding.

    Only neighbours along the axis are compared. The limit is relative to the largest
    product. NaN counts as a difference.
    """
    if products.shape[axis] == 1:
        return False
    limit = SAME_DETERMINANT_RATIO * max_abs(products)
    is_same = max_abs(np.diff(products, axis=axis)) < limit
    return not is_same
